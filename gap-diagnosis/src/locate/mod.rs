//! Where the gap lies: in which log, stretch of time, frequency band, harmonic, amplitude, rate and state.
//!
//! Input is the residual (measured minus predicted) of each log beside the predicted motion; output is [`Where`], plain data for
//! `diagnosis.json` and the page, and [`strongest`], one sentence. Everywhere the noise floor is taken off first: what counts is the
//! reducible power, residual power minus noise power, never negative, and the noise's share is reported beside it.
//!
//! What it does not do: simulate, estimate the noise, or say why (the registry's statistics do).

mod bands;
mod character;
mod drive;
mod harmonics;
mod power;
mod states;
mod words;

use serde::Serialize;

pub use bands::Band;
pub use character::Character;
pub use harmonics::{Harmonic, Harmonics, PeriodicStretch};
pub use power::Power;
pub use states::{AmplitudeBin, MapAxis, RateBin, StateMap};
pub use words::strongest;

use drive::{Direction, directions};
use power::{Part, powers};

/// Segments per log. Chosen: a twentieth of a page's width is still a bar that one can point at.
const SEGMENTS_PER_LOG: usize = 20;
/// Samples a segment has at least; fewer would show the noise's own fluctuations.
const MIN_SEGMENT_SAMPLES: usize = 16;

/// One log as the nominal (or refitted) plant sees it. All slices have one length, a sample each.
#[derive(Clone, Copy, Debug)]
pub struct Trace<'a> {
    /// Name of the log, for the reader.
    pub name: &'a str,
    /// Sample period.
    pub dt_s: f64,
    /// Drive: the logged amplifier output where there is one, else the command.
    pub drive_v: &'a [f64],
    /// Predicted displacement.
    pub displacement_m: &'a [f64],
    /// Measured minus predicted displacement; NaN where it is not scored.
    pub residual_m: &'a [f64],
    /// Rms of the log's noise, taken as white.
    pub noise_m: f64,
}

impl Trace<'_> {
    /// Predicted velocity at sample `k`, by central differences: a map of velocities needs no more, and ten minutes of them would cost
    /// as much memory as a column of the log.
    fn velocity_m_per_s(&self, k: usize) -> f64 {
        self.slope(k, 1, |k| self.displacement_m[k])
    }

    /// Central difference of `value` at sample `k` over `half` samples to either side, as far as the log goes; per second.
    fn slope(&self, k: usize, half: usize, value: impl Fn(usize) -> f64) -> f64 {
        let (before, after) = (k.saturating_sub(half), (k + half).min(self.residual_m.len() - 1));
        (value(after) - value(before)) / ((after - before).max(1) as f64 * self.dt_s)
    }
}

/// Where the gap lies. Micrometres, since this is what `diagnosis.json` and the page show.
///
/// Within each list the shares of reducible power sum to 100 %, or are all 0 where nothing stands out of the noise.
#[derive(Clone, Debug, Serialize)]
pub struct Where {
    /// All logs together.
    pub total: Power,
    /// Per frequency band, ascending, from 0 to the highest Nyquist frequency.
    pub bands: Vec<Band>,
    /// Per log, in the order given.
    pub logs: Vec<LogPart>,
    /// Per stretch of time, log after log.
    pub segments: Vec<Segment>,
    /// Harmonics of the drive in the stretches where the drive is periodic.
    pub harmonics: Harmonics,
    /// Per amplitude of the drive, ascending.
    pub amplitudes: Vec<AmplitudeBin>,
    /// Per rate of the drive, at rest first, ascending.
    pub rates: Vec<RateBin>,
    /// Maps of the residual: over drive and its rate, and over displacement and velocity.
    pub states: Vec<StateMap>,
    /// Numbers that say in words how the residual goes with the motion.
    pub character: Character,
    /// Per stage of the chain, from the drive to the timing; empty where no registry was screened.
    pub stages: Vec<StagePart>,
}

/// What one stage of the chain could explain. Stages overlap, so that these shares don't sum to 100 %.
#[derive(Clone, Debug, Serialize)]
pub struct StagePart {
    /// Its name.
    pub stage: &'static str,
    /// The part of the reducible power that its most promising entry takes in a score test.
    pub share_percent: f64,
    /// That entry.
    pub effect: &'static str,
}

/// One log's part of the gap.
#[derive(Clone, Debug, Serialize)]
pub struct LogPart {
    /// Name of the log.
    pub log: String,
    /// Its duration.
    pub duration_s: f64,
    /// Its residual.
    #[serde(flatten)]
    pub power: Power,
}

/// One stretch of a log.
#[derive(Clone, Debug, Serialize)]
pub struct Segment {
    /// Name of the log.
    pub log: String,
    /// Beginning, from the first sample of the log.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
    /// Its residual.
    #[serde(flatten)]
    pub power: Power,
}

/// Locates the gap in `traces`. Logs are weighted by their duration.
///
/// # Panics
/// If the slices of a trace differ in length.
pub fn locate(traces: &[Trace<'_>]) -> Where {
    for trace in traces {
        let n = trace.residual_m.len();
        let lengths = [trace.drive_v.len(), trace.displacement_m.len()];
        assert!(lengths.iter().all(|&length| length == n), "{}: one value per sample in every column", trace.name);
    }
    let directions: Vec<Vec<Direction>> = traces.iter().map(directions).collect();
    let (amplitudes, rates) = states::amplitudes_and_rates(traces, &directions);
    let harmonics = harmonics::harmonics(traces);
    let per_log: Vec<Part> = traces.iter().map(|trace| part(trace, 0, trace.residual_m.len())).collect();
    let whole = per_log.iter().fold(Part::default(), |sum, part| sum.and(part));
    Where {
        total: powers(&[whole])[0],
        bands: bands::bands(traces),
        logs: traces
            .iter()
            .zip(powers(&per_log))
            .map(|(trace, power)| LogPart { log: trace.name.to_owned(), duration_s: duration_s(trace), power })
            .collect(),
        segments: segments(traces),
        amplitudes,
        rates,
        stages: Vec::new(),
        states: states::maps(traces),
        character: character::character(traces, &directions, &harmonics, &whole),
        harmonics,
    }
}

fn duration_s(trace: &Trace<'_>) -> f64 {
    trace.residual_m.len() as f64 * trace.dt_s
}

/// The scored samples of `from..to`.
fn part(trace: &Trace<'_>, from: usize, to: usize) -> Part {
    let mut part = Part::default();
    for residual_m in trace.residual_m[from..to].iter().filter(|residual_m| residual_m.is_finite()) {
        part.add(residual_m * residual_m * trace.dt_s, trace.noise_m.powi(2) * trace.dt_s, trace.dt_s);
    }
    part
}

fn segments(traces: &[Trace<'_>]) -> Vec<Segment> {
    let mut parts = Vec::new();
    let mut places = Vec::new();
    for trace in traces {
        let n = trace.residual_m.len();
        let n_segments = (n / MIN_SEGMENT_SAMPLES).clamp(1, SEGMENTS_PER_LOG);
        for segment_idx in 0..n_segments {
            let (from, to) = (n * segment_idx / n_segments, n * (segment_idx + 1) / n_segments);
            parts.push(part(trace, from, to));
            places.push((trace.name, from as f64 * trace.dt_s, to as f64 * trace.dt_s));
        }
    }
    places
        .into_iter()
        .zip(powers(&parts))
        .map(|((log, from_s, to_s), power)| Segment { log: log.to_owned(), from_s, to_s, power })
        .collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use std::f64::consts::TAU;

    pub const DT_S: f64 = 5e-5;
    pub const NOISE_M: f64 = 2e-8;

    /// A log that owns its columns; the motion is the drive times 1 um/V.
    pub struct Made {
        pub name: &'static str,
        pub drive_v: Vec<f64>,
        pub displacement_m: Vec<f64>,
        pub residual_m: Vec<f64>,
    }

    impl Made {
        /// `drive` over time; `residual` from (time, drive, rate), white noise on top.
        pub fn new(
            name: &'static str,
            seconds: f64,
            drive: impl Fn(f64) -> f64,
            residual: impl Fn(f64, f64, f64) -> f64,
        ) -> Self {
            let n = (seconds / DT_S).round() as usize;
            let mut rng = rand_pcg::Pcg64::seed_from_u64(n as u64 + name.len() as u64);
            let time_s = |k: usize| k as f64 * DT_S;
            let drive_v: Vec<f64> = (0..n).map(|k| drive(time_s(k))).collect();
            let rate = |k: usize| {
                (drive(time_s(k) + 1e-7) - drive((time_s(k) - 1e-7).max(0.0)))
                    / (time_s(k) + 1e-7 - (time_s(k) - 1e-7).max(0.0))
            };
            let residual_m = (0..n)
                .map(|k| residual(time_s(k), drive_v[k], rate(k)) + NOISE_M * rng.sample::<f64, _>(StandardNormal))
                .collect();
            Self { name, displacement_m: drive_v.iter().map(|v| 1e-6 * v).collect(), drive_v, residual_m }
        }

        pub fn trace(&self) -> Trace<'_> {
            Trace {
                name: self.name,
                dt_s: DT_S,
                drive_v: &self.drive_v,
                displacement_m: &self.displacement_m,
                residual_m: &self.residual_m,
                noise_m: NOISE_M,
            }
        }
    }

    pub fn sine(hz: f64) -> impl Fn(f64) -> f64 {
        move |t| 60.0 * (TAU * hz * t).sin()
    }

    #[test]
    fn noise_alone_has_no_share_anywhere() {
        let made = [Made::new("a", 1.0, sine(10.0), |_, _, _| 0.0), Made::new("b", 0.5, sine(50.0), |_, _, _| 0.0)];
        let found = locate(&made.each_ref().map(Made::trace));
        assert_eq!(found.total.share_percent, 0.0);
        // 30000 samples know their variance to 0.8 %.
        assert!((found.total.rms_um / 0.02 - 1.0).abs() < 0.02, "{}", found.total.rms_um);
        assert!(found.total.noise_percent > 98.0);
        let shares = found.logs.iter().map(|part| part.power.share_percent);
        assert!(shares.chain(found.bands.iter().map(|band| band.power.share_percent)).all(|share| share == 0.0));
        assert!(found.segments.iter().all(|segment| segment.power.share_percent == 0.0));
        assert!(strongest(&found).contains("noise"), "{}", strongest(&found));
    }

    #[test]
    fn a_burst_is_found_in_its_log_and_its_stretch() {
        let burst = |t: f64, _: f64, _: f64| if (0.30..0.35).contains(&t) { 1e-6 } else { 0.0 };
        let made = [Made::new("quiet", 1.0, sine(10.0), |_, _, _| 0.0), Made::new("burst", 1.0, sine(10.0), burst)];
        let found = locate(&made.each_ref().map(Made::trace));
        assert_eq!(found.logs[0].power.share_percent, 0.0);
        assert_eq!(found.logs[1].power.share_percent, 100.0);
        assert_eq!(found.segments.len(), 40);
        let loudest = found.segments.iter().max_by(|a, b| a.power.share_percent.total_cmp(&b.power.share_percent));
        let loudest = loudest.expect("forty segments");
        assert_eq!((loudest.log.as_str(), loudest.from_s), ("burst", 0.3));
        assert!(loudest.power.share_percent > 99.0);
        // 1 um and 20 nm of noise: the noise holds 4e-4 of the power.
        assert!((loudest.power.rms_um - 1.0).abs() < 0.005 && loudest.power.noise_percent < 0.05);
    }

    #[test]
    fn samples_that_are_not_scored_have_no_say() {
        let mut made = Made::new("gap", 1.0, sine(10.0), |t, _, _| if t < 0.2 { 5e-6 } else { 0.0 });
        made.residual_m[..4000].fill(f64::NAN);
        let found = locate(&[made.trace()]);
        assert_eq!(found.total.share_percent, 0.0);
        assert!(found.total.rms_um < 0.021);
    }

    #[test]
    fn json_has_a_unit_in_every_key_and_no_log_is_no_trouble() {
        let made = Made::new("a", 0.3, sine(10.0), |_, v, _| 1e-9 * v * v);
        let json = serde_json::to_value(locate(&[made.trace()])).expect("serialises");
        for key in ["from_hz", "to_hz", "share_percent", "noise_percent", "rms_um"] {
            assert!(json["bands"][0][key].is_number(), "{key}");
        }
        assert!(json["harmonics"].is_object() && json["states"].is_array());
        let empty = locate(&[]);
        assert!(empty.segments.is_empty() && strongest(&empty).contains("noise"));
        let short = Made::new("s", 2.0 * DT_S, sine(10.0), |_, _, _| 0.0);
        assert_eq!(locate(&[short.trace()]).segments.len(), 1);
    }
}
