//! Controller design: poles placed from a wish on a reduced plant, then judged on the whole one, sampled and delayed.
//!
//! * [`Skeleton`]: the second-order plant q'' + psi q' + c q = g u that the poles are placed on. Fast hysterons become dashpots, slow
//!   ones springs, whichever is right for the loop's band; [`crate::reduce`] says what the thesis' choice (all dashpots) costs.
//! * [`place()`]: PI gains for a real pole and a pair. The sum of the three is -psi whatever the gains, so two numbers are free.
//! * [`design()`]: of all placements that keep the margins, in every region, exactly sampled and with the true delay, the one
//!   with the most integral action whose simulated step settles and overshoots as wished.
//! * [`check()`]: largest stable delay, lowest stable rate, worst peak for the chosen shaping.
//!
//! Not here: drawing, files.

mod check;
mod locus;
mod place;
mod track;

pub use check::{Check, LowestRate, Peak, check};
pub use locus::{Branch, continuous, sampled_locus};
pub use place::{Placement, Skeleton, place};
pub use track::{AMPLITUDE_M, SINES_HZ, tracking};

use crate::chain::Chain;
use crate::experiment::{ExperimentError, Program, Recording, Setup, closed_loop_inverse, sampled_loop};
use crate::margins::{Assessment, Loop, MarginError, Verdict, assess};
use crate::metrics::{LoopMetrics, Task, loop_metrics};
use crate::replay::Start;
use crate::spec::{Part, Shape, Spec, Unit};
use control_core::{Inverse, Settings};

/// What a loop shall do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wish {
    /// Time to settle within 2 % of a step, shaping included, in seconds.
    pub settling_s: f64,
    /// Overshoot of the same step in percent of it.
    pub overshoot_percent: f64,
    /// Height of that step in metres.
    pub step_m: f64,
    /// Least gain margin in dB, up or down.
    pub gain_margin_db: f64,
    /// Least phase margin in degrees.
    pub phase_margin_deg: f64,
}

/// A loop that was found.
#[derive(Clone, Debug)]
pub struct Design {
    /// Where the poles were placed.
    pub placement: Placement,
    /// Stability and margins of the sampled loop in every region.
    pub assessment: Assessment,
    /// The step on the whole plant.
    pub step: LoopMetrics,
    /// Its recording.
    pub recording: Recording,
    /// Placements tried, and those that kept the margins.
    pub tried: [usize; 2],
}

/// Why there is no design.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// The plant can't be reduced to second order.
    #[error("the plant has no second-order skeleton to place poles on: {why}")]
    NoSkeleton {
        /// What is missing.
        why: &'static str,
    },
    /// The plant's own damping leaves no room for so fast a real pole.
    #[error(
        "a PI law can't settle in {settling_ms:.3} ms: its poles' sum is the plant's own damping, so that {least_ms:.3} ms is the least; wish for more"
    )]
    TooFast {
        /// As wished.
        settling_ms: f64,
        /// 4/psi times the slowest multiple that is tried.
        least_ms: f64,
    },
    /// No placement keeps the margins.
    #[error(
        "no placement keeps {gain_margin_db} dB and {phase_margin_deg} degrees at {rate_hz} Hz; the best has {best_db:.1} dB: raise --rate, shorten \
         --delay-us or ask for slower settling"
    )]
    NoMargin {
        /// As wished.
        gain_margin_db: f64,
        /// As wished.
        phase_margin_deg: f64,
        /// As given.
        rate_hz: f64,
        /// What the best placement has.
        best_db: f64,
    },
    /// Margins are kept, but no step is as wished.
    #[error(
        "no placement with these margins settles within {settling_ms:.3} ms and overshoots by at most {overshoot_percent} %; the nearest settles in \
         {best_ms:.3} ms with {best_percent:.2} %: relax the wish, the margins or the shaping"
    )]
    NoStep {
        /// As wished.
        settling_ms: f64,
        /// As wished.
        overshoot_percent: f64,
        /// What the nearest does; infinite if it doesn't settle.
        best_ms: f64,
        /// What the nearest does.
        best_percent: f64,
    },
    /// Margins can't be computed.
    #[error(transparent)]
    Margin(#[from] MarginError),
    /// The loop can't be run.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
}

/// The loop around which a design is made: limits and shaping, timing, and the feedforward.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The plant.
    pub chain: &'a Chain,
    /// Limits, shaping and static feedforward; the gains are what is sought.
    pub settings: Settings,
    /// From sampling to the new drive, seconds.
    pub delay_s: f64,
    /// The plant's inverse as feedforward.
    pub inverse: Option<&'a Inverse>,
}

impl Frame<'_> {
    /// Samples per second.
    pub fn rate_hz(&self) -> f64 {
        f64::from(self.settings.rate_hz)
    }

    /// The sampled loop that `settings` close, for margins.
    pub fn law(&self, settings: &Settings) -> Loop {
        sampled_loop(settings, self.rate_hz(), self.delay_s, self.chain)
    }

    /// Runs `spec` through the loop with the frame's own gains, from the relaxed plant.
    ///
    /// # Errors
    /// Settings or a SPEC that can't be run.
    pub fn run(&self, spec: &Spec, seconds: f64) -> Result<Recording, ExperimentError> {
        let start = Start::relaxed(self.chain);
        let samples = (seconds * self.rate_hz()).round() as usize;
        let setup = Setup {
            chain: self.chain,
            start: &start,
            rate_hz: self.rate_hz(),
            samples,
            latency_s: self.delay_s,
            seed: 1,
        };
        let program = Program::new(spec, self.rate_hz())?;
        closed_loop_inverse(&setup, &self.settings, self.inverse, &program, &|_| {})
    }
}

/// A SPEC of one part.
pub(crate) fn single(shape: Shape, amplitude_m: f64) -> Spec {
    let part = Part { shape, amplitude: amplitude_m, seconds: None, shaped: false };
    Spec { parts: vec![part], unit: Some(Unit::Micrometre) }
}

/// Settling times longer than wished by this factor are still looked at.
const STEP_LENGTH: f64 = 4.0;
/// Real poles tried, in multiples of the one whose own settling is the wish.
const REAL: [f64; 9] = [0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0];
/// Frequencies of the pair tried, in multiples of the skeleton's own.
const PAIR: [f64; 14] = [0.7, 0.8, 0.9, 1.0, 1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 1.6, 1.8, 2.1, 2.5];

/// Finds gains for `wish`; those in the frame's settings are ignored.
///
/// # Errors
/// See [`DesignError`].
pub fn design(frame: &Frame<'_>, wish: &Wish) -> Result<Design, DesignError> {
    let skeleton = Skeleton::of(frame.chain)?;
    let regions = frame.chain.linear_regions()?;
    let mut kept: Vec<(Placement, Assessment)> = Vec::new();
    let (mut tried, mut best_db) = (0, f64::NEG_INFINITY);
    for real in REAL {
        for pair in PAIR {
            let Some(placement) = place(&skeleton, real * 4.0 / wish.settling_s, pair * skeleton.natural_per_s())
            else {
                continue;
            };
            tried += 1;
            let settings = with_gains(frame, &placement);
            let assessment = assess(&regions, &frame.law(&settings))?;
            if matches!(assessment.verdict, Verdict::Unstable { .. }) {
                continue;
            }
            best_db = best_db.max(assessment.gain_margin_db.value);
            if assessment.gain_margin_db.value >= wish.gain_margin_db
                && assessment.phase_margin_deg.value >= wish.phase_margin_deg
            {
                kept.push((placement, assessment));
            }
        }
    }
    if tried == 0 {
        return Err(DesignError::TooFast {
            settling_ms: wish.settling_s * 1e3,
            least_ms: REAL[0] * 4.0 / skeleton.damping_per_s * 1e3,
        });
    }
    if kept.is_empty() {
        return Err(DesignError::NoMargin {
            gain_margin_db: wish.gain_margin_db,
            phase_margin_deg: wish.phase_margin_deg,
            rate_hz: frame.rate_hz(),
            best_db,
        });
    }
    let n_kept = kept.len();
    // The margins are kept by all; of these the one with the most integral action follows and rejects best.
    kept.sort_by(|a, b| b.0.ki_v_per_m_s.total_cmp(&a.0.ki_v_per_m_s));
    let mut nearest = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    for (placement, assessment) in kept {
        let own = Frame { settings: with_gains(frame, &placement), ..*frame };
        let recording = own.run(&single(Shape::Step, wish.step_m), STEP_LENGTH * wish.settling_s)?;
        let task = Task::Step { height_m: wish.step_m };
        let step = loop_metrics(task, recording.dt_s, Some(&recording.reference_m), &recording.displacement_m);
        let settling_s = step.settle_2_percent_ms.map_or(f64::INFINITY, |ms| ms * 1e-3);
        let overshoot = step.overshoot_percent.unwrap_or(f64::INFINITY);
        if settling_s <= wish.settling_s && overshoot <= wish.overshoot_percent {
            return Ok(Design { placement, assessment, step, recording, tried: [tried, n_kept] });
        }
        let miss =
            (settling_s / wish.settling_s).max(1.0) * (1.0 + (overshoot - wish.overshoot_percent).max(0.0) / 10.0);
        if miss < nearest.0 {
            nearest = (miss, settling_s, overshoot);
        }
    }
    Err(DesignError::NoStep {
        settling_ms: wish.settling_s * 1e3,
        overshoot_percent: wish.overshoot_percent,
        best_ms: nearest.1 * 1e3,
        best_percent: nearest.2,
    })
}

fn with_gains(frame: &Frame<'_>, placement: &Placement) -> Settings {
    Settings { kp_v_per_m: placement.kp_v_per_m as f32, ki_v_per_m_s: placement.ki_v_per_m_s as f32, ..frame.settings }
}
