//! Harmonics of the drive in the residual, and what of it comes back period after period.

use super::power::percent;
use super::{Trace, drive};
use crate::spectra::repeats;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Harmonics told, the fundamental included.
const N_HARMONICS: usize = 7;
/// Unknowns of the fit: offset, slope, and a cosine and a sine per harmonic.
const N_TERMS: usize = 2 + 2 * N_HARMONICS;
/// Half-width of the band, as part of the drive's range, that a crossing must leave: above a monitor's noise, below small sines.
const CROSSING_BAND: f64 = 0.03;
/// Successive periods of one sine agree to this part in length and in height.
const SAME_PERIOD: f64 = 0.03;
/// Part of the drive's power that offset and harmonics may leave: a square wave leaves 5 %.
const MOST_FOREIGN: f64 = 0.08;
/// Samples per period below which the 7th harmonic has no place under the Nyquist frequency.
const MIN_PERIOD_SAMPLES: f64 = 2.2 * N_HARMONICS as f64;

/// The residual in the stretches where the drive is periodic.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Harmonics {
    /// Share of the reducible power in these stretches that is the same in every period, 0 to 100; none without such a stretch.
    pub coherent_percent: Option<f64>,
    /// One entry per periodic stretch with a dominant frequency, log after log.
    pub stretches: Vec<PeriodicStretch>,
}

/// At least two periods of one sine, triangle or square in a log.
#[derive(Clone, Debug, Serialize)]
pub struct PeriodicStretch {
    /// Name of the log.
    pub log: String,
    /// Beginning, from the first sample of the log.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
    /// Fundamental frequency of the drive.
    pub fundamental_hz: f64,
    /// Amplitude of the drive's fundamental.
    pub drive_amplitude_v: f64,
    /// Fundamental (order 1) to the 7th harmonic of the residual.
    pub harmonics: Vec<Harmonic>,
}

/// One harmonic of the residual: `amplitude cos(order w t + phase)` where the drive's fundamental is `cos(w t)`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Harmonic {
    /// Multiple of the fundamental.
    pub order: u32,
    /// Amplitude.
    pub amplitude_um: f64,
    /// Standard deviation of the amplitude that white noise alone would give.
    pub sigma_um: f64,
    /// Phase against the drive, -180 to 180.
    pub phase_deg: f64,
}

/// Samples `start..` of one log in which the drive repeats every `period` samples.
struct Stretch {
    start: f64,
    period: f64,
    n_periods: usize,
}

impl Stretch {
    fn from(&self) -> usize {
        self.start.round() as usize
    }

    fn to(&self, n_samples: usize) -> usize {
        ((self.start + self.period * self.n_periods as f64).round() as usize).min(n_samples)
    }
}

pub(super) fn harmonics(traces: &[Trace<'_>]) -> Harmonics {
    let mut found = Harmonics::default();
    let (mut coherent_m2_s, mut reducible_m2_s) = (0.0, 0.0);
    let mut is_periodic = false;
    for trace in traces {
        let mut stretches = sine_stretches(trace.drive_v);
        for stretch in &stretches {
            found.stretches.extend(fit(trace, stretch));
        }
        if stretches.is_empty() {
            // A multisine has no dominant frequency, but periods.
            stretches = repeats(trace.drive_v, None)
                .iter()
                .map(|found| Stretch {
                    start: found.start as f64,
                    period: found.period_samples as f64,
                    n_periods: found.n_periods,
                })
                .collect();
        }
        for stretch in &stretches {
            is_periodic = true;
            coherent_m2_s += trace.dt_s * coherent_m2(trace.residual_m, stretch);
            let part = super::part(trace, stretch.from(), stretch.to(trace.residual_m.len()));
            reducible_m2_s += part.reducible_m2_s();
        }
    }
    found.coherent_percent = (is_periodic && reducible_m2_s > 0.0).then(|| percent(coherent_m2_s, reducible_m2_s));
    found
}

/// Runs of at least two periods between upward crossings of the drive's middle that agree in length and height.
fn sine_stretches(drive_v: &[f64]) -> Vec<Stretch> {
    let (low_v, high_v) = drive::range(drive_v);
    let (middle_v, band_v) = (0.5 * (low_v + high_v), CROSSING_BAND * (high_v - low_v));
    if band_v == 0.0 {
        return Vec::new();
    }
    // Where the drive last passed the middle before it left the band upwards, having been below the band or begun at the middle.
    let mut crossings: Vec<f64> = Vec::new();
    let mut heights_v: Vec<f64> = Vec::new();
    let rounding_v = 1e-9 * band_v;
    let mut was_below = drive_v[0] - middle_v <= rounding_v;
    let (mut passed, mut height_v) = (0.0, 0.0_f64);
    for k in 1..drive_v.len() {
        let (before_v, above_v) = (drive_v[k - 1] - middle_v, drive_v[k] - middle_v);
        height_v = height_v.max(above_v.abs());
        if above_v > rounding_v && before_v <= rounding_v {
            passed = (k - 1) as f64 + (-before_v / (above_v - before_v)).max(0.0);
        }
        if above_v < -band_v {
            was_below = true;
        } else if above_v > band_v && was_below {
            was_below = false;
            crossings.push(passed);
            heights_v.push(std::mem::take(&mut height_v));
        }
    }
    let alike = |a: f64, b: f64| (a - b).abs() <= SAME_PERIOD * a.abs().max(b.abs());
    let mut stretches = Vec::new();
    let mut first = 0;
    while first + 2 < crossings.len() {
        let period = crossings[first + 1] - crossings[first];
        let mut last = first + 1;
        while last + 1 < crossings.len()
            && alike(crossings[last + 1] - crossings[last], period)
            // The height of a period is known at the crossing that ends it.
            && alike(heights_v[last + 1], heights_v[first + 1])
        {
            last += 1;
        }
        let n_periods = last - first;
        if n_periods >= 2 && period >= MIN_PERIOD_SAMPLES {
            let period = (crossings[last] - crossings[first]) / n_periods as f64;
            stretches.push(Stretch { start: crossings[first], period, n_periods });
        }
        first = last;
    }
    stretches
}

/// Least squares of offset, slope and seven harmonics over the whole periods; none where they leave the drive mostly unexplained.
fn fit(trace: &Trace<'_>, stretch: &Stretch) -> Option<PeriodicStretch> {
    let (from, to) = (stretch.from(), stretch.to(trace.residual_m.len()));
    let step_rad = TAU / stretch.period;
    let mut normal = DMatrix::<f64>::zeros(N_TERMS, N_TERMS);
    let (mut of_residual, mut of_drive) = (DVector::<f64>::zeros(N_TERMS), DVector::<f64>::zeros(N_TERMS));
    let mut terms = [0.0; N_TERMS];
    let (mut n_scored, mut drive_sum_v, mut drive_squares_v2) = (0.0_f64, 0.0, 0.0);
    for k in from..to {
        if !trace.residual_m[k].is_finite() {
            continue;
        }
        n_scored += 1.0;
        drive_sum_v += trace.drive_v[k];
        drive_squares_v2 += trace.drive_v[k] * trace.drive_v[k];
        terms[0] = 1.0;
        terms[1] = 2.0 * (k - from) as f64 / (to - from) as f64 - 1.0;
        let (sin, cos) = (step_rad * (k as f64 - stretch.start)).sin_cos();
        (terms[2], terms[3]) = (cos, sin);
        for order in 2..=N_HARMONICS {
            // The next harmonic is the last one turned once more: one sine per sample instead of seven.
            let (last_cos, last_sin) = (terms[2 * order - 2], terms[2 * order - 1]);
            (terms[2 * order], terms[2 * order + 1]) =
                (last_cos * cos - last_sin * sin, last_sin * cos + last_cos * sin);
        }
        for row in 0..N_TERMS {
            of_residual[row] += terms[row] * trace.residual_m[k];
            of_drive[row] += terms[row] * trace.drive_v[k];
            for column in 0..=row {
                normal[(row, column)] += terms[row] * terms[column];
            }
        }
    }
    // The decomposition reads the lower triangle only.
    let solver = normal.cholesky()?;
    let (residual, drive) = (solver.solve(&of_residual), solver.solve(&of_drive));
    // A step within two periods of a sine passes for their period, but not for their harmonics.
    let motion_v2 = drive_squares_v2 - drive_sum_v * drive_sum_v / n_scored;
    let foreign_v2 = drive_squares_v2 - drive.dot(&of_drive) + drive[1] * drive[1] * n_scored / 3.0;
    if foreign_v2 > MOST_FOREIGN * motion_v2 {
        return None;
    }
    // a cos + b sin = r cos(angle + phase), phase = -atan2(b, a).
    let polar = |fit: &DVector<f64>, order: usize| {
        let (a, b) = (fit[2 * order], fit[2 * order + 1]);
        (a.hypot(b), -b.atan2(a))
    };
    let (drive_amplitude_v, drive_phase_rad) = polar(&drive, 1);
    let harmonics = (1..=N_HARMONICS)
        .map(|order| {
            let (amplitude_m, phase_rad) = polar(&residual, order);
            let phase_rad = phase_rad - order as f64 * drive_phase_rad;
            Harmonic {
                order: order as u32,
                amplitude_um: 1e6 * amplitude_m,
                sigma_um: 1e6 * trace.noise_m * (2.0 / n_scored).sqrt(),
                phase_deg: (phase_rad + PI).rem_euclid(TAU).to_degrees() - 180.0,
            }
        })
        .collect();
    Some(PeriodicStretch {
        log: trace.name.to_owned(),
        from_s: from as f64 * trace.dt_s,
        to_s: to as f64 * trace.dt_s,
        fundamental_hz: 1.0 / (stretch.period * trace.dt_s),
        drive_amplitude_v,
        harmonics,
    })
}

/// Energy (over the whole stretch, per unit of dt) of what all periods share: the mean product of different periods at the same
/// phase, `(|sum r|^2 - sum |r|^2) / (P (P - 1))` per phase, in which noise has no expectation.
fn coherent_m2(residual_m: &[f64], stretch: &Stretch) -> f64 {
    let period = stretch.period.floor() as usize;
    let mut products_m2 = 0.0;
    for phase in 0..period {
        let (mut sum_m, mut squares_m2, mut n) = (0.0, 0.0, 0.0);
        for period_idx in 0..stretch.n_periods {
            let k = (stretch.start + stretch.period * period_idx as f64).round() as usize + phase;
            if let Some(value_m) = residual_m.get(k).filter(|value_m| value_m.is_finite()) {
                sum_m += value_m;
                squares_m2 += value_m * value_m;
                n += 1.0;
            }
        }
        if n > 1.0 {
            products_m2 += (sum_m * sum_m - squares_m2) / (n * (n - 1.0));
        }
    }
    products_m2 * stretch.n_periods as f64 * stretch.period / period as f64
}

#[cfg(test)]
mod tests {
    use super::super::locate;
    use super::super::tests::{Made, NOISE_M, sine};
    use super::*;

    #[test]
    fn the_third_harmonic_of_a_cubic_is_found_with_its_phase() {
        // u = 60 sin, u^3 = 60^3 (3 sin - sin 3wt) / 4. Against cos(wt) with the sine's phase -90 degrees: the third harmonic of
        // sin^3 is -sin(3wt)/4 = cos(3wt + 90)/4, and 90 - 3(-90) = 360: in phase.
        let a = 1e-12;
        let made = Made::new("cubic", 1.01, sine(150.0), |_, v, _| a * v * v * v);
        let found = locate(&[made.trace()]);
        assert_eq!(found.harmonics.stretches.len(), 1);
        let stretch = &found.harmonics.stretches[0];
        assert!((stretch.fundamental_hz - 150.0).abs() < 1e-3, "{}", stretch.fundamental_hz);
        assert!((stretch.drive_amplitude_v - 60.0).abs() < 0.01);
        let unit_um = 1e6 * a * 60f64.powi(3) / 4.0;
        // Five sigma of the noise in 20000 samples.
        let bound_um = 5.0 * 1e6 * NOISE_M * (2.0 / 20_000.0_f64).sqrt();
        for (order, expected_um) in
            [3.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0].map(|part| part * unit_um).into_iter().enumerate()
        {
            assert!((stretch.harmonics[order].amplitude_um - expected_um).abs() < bound_um, "{:?}", stretch.harmonics);
        }
        assert!(stretch.harmonics[2].phase_deg.abs() < 2.0, "{:?}", stretch.harmonics[2]);
        assert!(found.harmonics.coherent_percent.is_some_and(|percent| percent > 98.0));
    }

    #[test]
    fn a_step_among_the_periods_is_no_period() {
        let made = Made::new(
            "loop",
            1.3,
            |t| 30.0 * (TAU * 25.0 * t).sin() + if t > 0.6 { 20.0 } else { 0.0 },
            |_, v, _| 1e-8 * v,
        );
        let found = locate(&[made.trace()]).harmonics;
        assert!(found.stretches.iter().all(|stretch| (stretch.fundamental_hz - 25.0).abs() < 0.01), "{found:?}");
        assert_eq!(found.stretches.len(), 2);
    }

    #[test]
    fn every_sine_of_a_sequence_has_its_own_line_and_a_decaying_one_has_none() {
        let sequence = |t: f64| match t {
            t if t < 0.5 => 60.0 * (TAU * 10.0 * t).sin(),
            t if t < 0.7 => 60.0 * (TAU * 50.0 * (t - 0.5)).sin(),
            t => 60.0 * (-(t - 0.7) * 3.0).exp() * (TAU * 8.0 * (t - 0.7)).sin(),
        };
        let made = Made::new("sines", 1.5, sequence, |_, v, _| 1e-8 * v);
        let found = locate(&[made.trace()]).harmonics;
        let fundamentals: Vec<f64> = found.stretches.iter().map(|stretch| stretch.fundamental_hz.round()).collect();
        assert_eq!(fundamentals, [10.0, 50.0]);
        assert!((found.stretches[0].harmonics[0].amplitude_um - 0.6).abs() < 0.002);
        assert!(found.stretches[0].harmonics[0].phase_deg.abs() < 0.5);
    }

    #[test]
    fn what_differs_from_period_to_period_is_not_coherent() {
        // A hum of 50 Hz under a drive of 37 Hz.
        let made = Made::new("hum", 2.0, sine(37.0), |t, _, _| 1e-7 * (TAU * 50.0 * t).sin());
        let found = locate(&[made.trace()]).harmonics;
        assert!(found.coherent_percent.is_some_and(|percent| percent < 3.0), "{:?}", found.coherent_percent);
        let steps = Made::new("step", 0.3, |t| if t < 0.1 { 0.0 } else { 40.0 }, |_, _, _| 1e-7);
        assert_eq!(locate(&[steps.trace()]).harmonics.coherent_percent, None);
    }
}
