//! How far a loop is from its edges: delay, rate, and the peak that the chosen shaping may lead to.

use super::{DesignError, Frame, single};
use crate::chain::Chain;
use crate::margins::{Assessment, Loop, Verdict, assess};
use crate::model::Model;
use crate::spec::Shape;
use crate::stability::{Certificate, Law, certify};
use control_core::Settings;

/// The largest displacement of a scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Peak {
    /// What was asked for, in words.
    pub scenario: String,
    /// Which plant: nominal, or a corner of its stated uncertainty.
    pub plant: &'static str,
    /// Largest |q| in metres.
    pub peak_m: f64,
    /// What was asked for at most, in metres.
    pub asked_m: f64,
    /// Largest |u| in volts.
    pub peak_v: f64,
    /// Whether the law tripped and went to its safe state.
    pub tripped: bool,
}

/// Down to which rate a loop is stable, in hertz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LowestRate {
    /// Below this one it is not.
    Edge(f64),
    /// To this one at the least: no lower one was tried.
    AtMost(f64),
}

/// What `design --check` says.
#[derive(Clone, Debug)]
pub struct Check {
    /// Margins as they are.
    pub assessment: Assessment,
    /// Largest delay at this rate up to which every region is stable, in seconds; `None` for a loop that is unstable as it is.
    pub largest_delay_s: Option<f64>,
    /// Lowest rate at this delay down to which every region is stable; `None` likewise.
    pub lowest_rate: Option<LowestRate>,
    /// A proof of global stability, or why there is none; for hysterons only.
    pub certificate: Option<Certificate>,
    /// Peaks, the worst first.
    pub peaks: Vec<Peak>,
}

/// Rates are stepped down by this factor until a region is unstable.
const RATE_STEP: f64 = 0.98;
/// And no further than this share of the rate.
const LOWEST_SHARE: f64 = 1e-2;
/// Seconds of each scenario, at the least and at the most: several settling times of usual loops; a minute of computing.
const SCENARIO_S: [f64; 2] = [0.06, 10.0];
/// Time constants after which a loop has settled, to 1 %.
const SETTLED: f64 = 5.0;

/// Checks the loop in `frame`. `model` states how far the plant may be off; peaks are sought at its corners too.
///
/// # Errors
/// Margins that can't be computed, or a loop that can't be run.
pub fn check(frame: &Frame<'_>, model: &Model) -> Result<Check, DesignError> {
    let regions = frame.chain.linear_regions()?;
    let law = frame.law(&frame.settings);
    let assessment = assess(&regions, &law)?;
    let stable =
        |law: &Loop| assess(&regions, law).is_ok_and(|found| !matches!(found.verdict, Verdict::Unstable { .. }));
    let is_stable = !matches!(assessment.verdict, Verdict::Unstable { .. });
    let margin_s = assessment.delay_margin_s.value;
    let largest_delay_s = is_stable.then_some(frame.delay_s + margin_s);
    let lowest_rate = is_stable.then(|| lowest_rate(&law, stable));
    let parts = &frame.chain.parts;
    let has_hysterons = parts.linear.is_none() && parts.transducer.is_none();
    let certificate = has_hysterons.then(|| {
        if frame.chain.is_bare() {
            certify(&frame.chain.plant, Law::Sampled(law))
        } else {
            Certificate::refused(
                "the proof knows mass, spring, damper and hysterons, sampled in time, and the plant states more than these",
            )
        }
    });
    let mut peaks = Vec::new();
    if is_stable {
        // A radius of zero is over at once.
        let settles_s = -SETTLED / (assessment.spectral_radius.value.ln() * frame.rate_hz());
        for (plant, chain) in corners(model, frame.chain) {
            peaks.extend(peaks_of(&Frame { chain: &chain, ..*frame }, plant, settles_s)?);
        }
    }
    peaks.sort_by(|a, b| b.peak_m.total_cmp(&a.peak_m));
    Ok(Check { assessment, largest_delay_s, lowest_rate, certificate, peaks })
}

fn lowest_rate(law: &Loop, stable: impl Fn(&Loop) -> bool) -> LowestRate {
    let at = |rate_hz: f64| stable(&Loop { rate_hz, ..*law });
    let mut rate_hz = law.rate_hz;
    while rate_hz * RATE_STEP > LOWEST_SHARE * law.rate_hz {
        if !at(rate_hz * RATE_STEP) {
            let (mut low, mut high) = (rate_hz * RATE_STEP, rate_hz);
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                if at(middle) { high = middle } else { low = middle }
            }
            return LowestRate::Edge(high);
        }
        rate_hz *= RATE_STEP;
    }
    LowestRate::AtMost(rate_hz)
}

/// The plant, and the same softer and stiffer, with more and less drive, by its stated sigma.
fn corners(model: &Model, nominal: &Chain) -> Vec<(&'static str, Chain)> {
    let mut corners = vec![("nominal", nominal.clone())];
    if model.kind.has_structure() {
        let stiffness = model.structure.stiffness_n_per_m.relative_sigma();
        let gain = model.actuator.transduction_c_per_m.relative_sigma();
        let mut corner = |name, stiffer: f64, stronger: f64| {
            let mut chain = nominal.clone();
            chain.plant.stiffness_n_per_m *= 1.0 + stiffer * 2.0 * stiffness;
            chain.plant.transduction_c_per_m *= 1.0 + stronger * 2.0 * gain;
            corners.push((name, chain));
        };
        corner("softer and stronger by 2 sigma", -1.0, 1.0);
        corner("stiffer and weaker by 2 sigma", 1.0, -1.0);
    }
    corners
}

/// How long a shaped reference takes over a distance, from rest to rest.
fn move_s(distance_m: f64, settings: &Settings) -> f64 {
    let rate = f64::from(settings.reference_rate_m_per_s);
    let acceleration = f64::from(settings.reference_acceleration_m_per_s2);
    if rate * rate >= distance_m * acceleration {
        2.0 * (distance_m / acceleration).sqrt()
    } else {
        distance_m / rate + rate / acceleration
    }
}

fn peaks_of(frame: &Frame<'_>, plant: &'static str, settles_s: f64) -> Result<Vec<Peak>, DesignError> {
    let clamp_m = f64::from(frame.settings.reference_max_m);
    let asked_m = if clamp_m.is_finite() { clamp_m } else { 100e-6 };
    let um = asked_m * 1e6;
    let resonance = frame.chain.linear_regions()?;
    // The first resonance of the plant with every hysteron shut: what a reference excites most.
    let shut = resonance.last().map(|region| crate::linear::poles(&region.a)).unwrap_or_default();
    let first = shut.iter().map(|z| z.im.abs()).filter(|im| *im > 0.0).reduce(f64::min);
    let hz = first.unwrap_or(0.0) / std::f64::consts::TAU;
    let mut waves = vec![
        (format!("square wave of {um:.0} um at 40 Hz, full reversals"), 40.0, Shape::Square { hz: 40.0 }),
        (format!("sine of {um:.0} um at 150 Hz"), 150.0, Shape::Sine { hz: 150.0 }),
    ];
    if hz > 0.0 && hz < 0.2 * frame.rate_hz() {
        let words = format!("square wave of {um:.0} um at a third of the resonance, {:.0} Hz", hz / 3.0);
        waves.push((words, hz / 3.0, Shape::Square { hz: hz / 3.0 }));
    }
    // No samples tell a faster one.
    waves.retain(|(_, hz, _)| *hz < 0.5 * frame.rate_hz());
    let slowest_hz = waves.iter().map(|(_, hz, _)| *hz).fold(f64::INFINITY, f64::min);
    let [least_s, most_s] = SCENARIO_S;
    let whole_s = least_s.max(move_s(asked_m, &frame.settings) + settles_s).max(2.0 / slowest_hz);
    let seconds = whole_s.min(most_s);
    let of = if seconds < whole_s { format!(", the first {seconds:.0} s of {whole_s:.0} s") } else { String::new() };
    let step = (format!("step to {um:.0} um"), Shape::Step);
    std::iter::once(step)
        .chain(waves.into_iter().map(|(words, _, shape)| (words, shape)))
        .map(|(words, shape)| {
            let run = frame.run(&single(shape, asked_m), seconds)?;
            Ok(Peak {
                scenario: words + &of,
                plant,
                peak_m: run.peak_m,
                asked_m,
                peak_v: run.command_v.iter().fold(0.0f64, |m, v| m.max(v.abs())),
                tripped: run.limited_by.iter().any(|limits| limits.is_safe_state()),
            })
        })
        .collect()
}
