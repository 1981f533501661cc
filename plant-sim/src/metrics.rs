//! What a run is judged by: fit percent and rms for a replay, step and sine figures for a loop.

use control_core::Limits;
use std::f64::consts::TAU;

/// Root of the mean square.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, n) = values.into_iter().fold((0.0, 0usize), |(sum, n), v| (sum + v * v, n + 1));
    if n == 0 { 0.0 } else { (sum / n as f64).sqrt() }
}

/// Residual statistics that grow row by row, so that a log of any length needs no memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    rows: f64,
    measured_mean: f64,
    measured_square: f64,
    residual_mean: f64,
    residual_square: f64,
}

impl Score {
    /// Adds one row: measured and predicted displacement in metres.
    pub fn add(&mut self, measured_m: f64, predicted_m: f64) {
        self.rows += 1.0;
        let residual = measured_m - predicted_m;
        // Welford's update: sums of squares about the running mean, without cancellation.
        let from_mean = measured_m - self.measured_mean;
        self.measured_mean += from_mean / self.rows;
        self.measured_square += from_mean * (measured_m - self.measured_mean);
        let from_mean = residual - self.residual_mean;
        self.residual_mean += from_mean / self.rows;
        self.residual_square += from_mean * (residual - self.residual_mean);
    }

    /// Rows added.
    pub fn rows(&self) -> usize {
        self.rows as usize
    }

    /// Mean of measured minus predicted, in metres: the offset that a free offset would take.
    pub fn offset_m(&self) -> f64 {
        self.residual_mean
    }

    /// Rms of the residual in metres, with its mean taken out if `free_offset`.
    pub fn rms_m(&self, free_offset: bool) -> f64 {
        let mean = if free_offset { 0.0 } else { self.residual_mean };
        if self.rows == 0.0 { 0.0 } else { (self.residual_square / self.rows + mean * mean).sqrt() }
    }

    /// Fit percent, 100 (1 - ||y - yhat|| / ||y - mean(y)||); minus infinity where the measurement is constant; NaN where
    /// nothing is left of it either, and without rows.
    pub fn fit_percent(&self, free_offset: bool) -> f64 {
        let spread_m = (self.measured_square / self.rows).sqrt();
        100.0 * (1.0 - self.rms_m(free_offset) / spread_m)
    }
}

/// What a closed or open loop did; `None` where the figure has no meaning for the drive that was asked for.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LoopMetrics {
    /// 10 to 90 % of the step, in milliseconds.
    pub rise_ms: Option<f64>,
    /// Peak beyond the step, in percent of it.
    pub overshoot_percent: Option<f64>,
    /// Last time outside +-2 % of the step, in milliseconds.
    pub settle_2_percent_ms: Option<f64>,
    /// Rms of reference minus displacement, in micrometres.
    pub rms_error_um: Option<f64>,
    /// The same in percent of the amplitude.
    pub rms_error_percent: Option<f64>,
    /// Displacement over reference at the fundamental.
    pub gain: Option<f64>,
    /// Its phase in degrees.
    pub phase_deg: Option<f64>,
    /// Largest displacement by magnitude, in micrometres.
    pub peak_um: f64,
    /// Largest command by magnitude, in volts.
    #[serde(rename = "peak_V")]
    pub peak_v: f64,
    /// Samples in which a limit, the clamp or the trip acted; shaping the reference is no limit.
    pub limited_samples: usize,
    /// Samples in which the reference was shaped.
    pub shaped_samples: usize,
}

/// What held a run's drive or reference back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limited {
    /// Samples in which a limit, the clamp or the trip acted.
    pub samples: usize,
    /// Samples in which the reference was shaped: its rate and acceleration are bounded in normal work, which is no limit.
    pub shaped_samples: usize,
    /// All limits that acted.
    pub limits: Limits,
}

impl Limited {
    const SHAPING: Limits = Limits::REFERENCE_RATE.union(Limits::REFERENCE_ACCELERATION);

    /// Of a run whose samples were limited by these.
    pub fn of(samples: impl IntoIterator<Item = Limits>) -> Self {
        let mut limited = Self::default();
        samples.into_iter().for_each(|limits| limited.count(limits));
        limited
    }

    /// Counts one sample.
    pub fn count(&mut self, limited_by: Limits) {
        let limits = Limits::from_bits(limited_by.bits() & !Self::SHAPING.bits());
        self.samples += usize::from(!limits.is_empty());
        self.shaped_samples += usize::from(limited_by.intersects(Self::SHAPING));
        self.limits |= limits;
    }

    /// One line for people where a limit acted in a run of `samples`: it was not what was asked for. That the edge of a step is slewed says nothing
    /// where no loop follows it.
    pub fn warning(&self, samples: usize, is_closed_loop: bool) -> Option<String> {
        if !is_closed_loop && self.limits == Limits::SLEW {
            return None;
        }
        let words = self.limits.words().collect::<Vec<_>>().join(", ").replace('_', " ");
        (self.samples > 0).then(|| format!("limits acted in {} of {samples} samples: {words}", self.samples))
    }
}

/// What the metrics are to be computed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// A step of this many metres at the first sample.
    Step {
        /// Height in metres.
        height_m: f64,
    },
    /// A sine; evaluated over its last whole period.
    Sine {
        /// Amplitude in metres.
        amplitude_m: f64,
        /// Frequency in hertz.
        hz: f64,
    },
    /// Anything else: only error, peaks and limits.
    Other,
}

/// Metrics of a run sampled every `dt_s`, from displacement and reference (`None` in open loop) in metres.
pub fn loop_metrics(task: Task, dt_s: f64, reference_m: Option<&[f64]>, displacement_m: &[f64]) -> LoopMetrics {
    let peak = |values: &[f64]| values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let mut metrics = LoopMetrics { peak_um: peak(displacement_m) * 1e6, ..LoopMetrics::default() };
    let Some(reference_m) = reference_m else {
        return metrics;
    };
    let error_rms = |range: std::ops::Range<usize>| rms(range.map(|k| reference_m[k] - displacement_m[k]));
    let rows = displacement_m.len();
    match task {
        Task::Step { height_m } if height_m != 0.0 => {
            let y: Vec<f64> = displacement_m.iter().map(|y| y / height_m).collect();
            metrics.rise_ms = crossing(&y, 0.9).zip(crossing(&y, 0.1)).map(|(high, low)| (high - low) * dt_s * 1e3);
            let highest = y.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
            metrics.overshoot_percent = Some((highest - 1.0).max(0.0) * 100.0);
            // Unsettled at the end of the record means no settling time, not the record's length.
            let last_outside = y.iter().rposition(|v| (v - 1.0).abs() > 0.02);
            metrics.settle_2_percent_ms = match last_outside {
                Some(k) if k + 1 == rows => None,
                Some(k) => {
                    let band = 1.0 + 0.02f64.copysign(y[k] - 1.0);
                    Some((k as f64 + (band - y[k]) / (y[k + 1] - y[k])) * dt_s * 1e3)
                }
                None => Some(0.0),
            };
            let error_m = error_rms(0..rows);
            metrics.rms_error_um = Some(error_m * 1e6);
            metrics.rms_error_percent = Some(error_m / height_m.abs() * 100.0);
        }
        Task::Sine { amplitude_m, hz } if amplitude_m != 0.0 => {
            let period = 1.0 / (hz * dt_s);
            if let Some((from, weights)) = last_period(rows, period) {
                let phasor = |values: &[f64]| {
                    values[from..].iter().zip(&weights).enumerate().fold((0.0, 0.0), |(re, im), (k, (v, weight))| {
                        let angle = TAU * (from + k) as f64 / period;
                        (re + weight * v * angle.cos(), im - weight * v * angle.sin())
                    })
                };
                let ((yr, yi), (rr, ri)) = (phasor(displacement_m), phasor(reference_m));
                metrics.gain = Some(yr.hypot(yi) / rr.hypot(ri));
                let phase = (yi.atan2(yr) - ri.atan2(rr)).to_degrees();
                metrics.phase_deg = Some((phase + 180.0).rem_euclid(360.0) - 180.0);
                let square = |(k, weight): (usize, &f64)| weight * (reference_m[k] - displacement_m[k]).powi(2);
                let error_m = ((from..rows).zip(&weights).map(square).sum::<f64>() / period).sqrt();
                metrics.rms_error_um = Some(error_m * 1e6);
                metrics.rms_error_percent = Some(error_m / amplitude_m.abs() * 100.0);
            }
        }
        _ => metrics.rms_error_um = Some(error_rms(0..rows) * 1e6),
    }
    metrics
}

/// First time, in samples, at which `values` reach `level` from below.
fn crossing(values: &[f64], level: f64) -> Option<f64> {
    let k = values.iter().position(|v| *v >= level)?;
    let before = values[..k].last()?;
    Some(k as f64 - (values[k] - level) / (values[k] - before))
}

/// First row and weights that integrate over exactly the last period, also where that isn't a whole number of samples; `None` if the
/// record is shorter than one.
///
/// The trapezoid rule from `rows - period`, where the value is interpolated, to `rows`, where it is the same because the signal is
/// periodic. Between whole samples this errs by the square of the sample's phase, where a rounded period would err by the phase itself:
/// 3e-4 and 2e-2 at 150 Hz and 20 kHz.
fn last_period(rows: usize, period: f64) -> Option<(usize, Vec<f64>)> {
    let start = rows as f64 - period;
    // A record of one period, its length rounded to samples, counts as one period.
    if start < -0.5 {
        return None;
    }
    let first = start.max(0.0).ceil();
    let fraction = first - start.max(0.0);
    let mut weights = vec![1.0; rows - first as usize];
    let from = if fraction > 0.0 {
        weights.insert(0, (1.0 + fraction) * fraction / 2.0);
        first as usize - 1
    } else {
        first as usize
    };
    if let Some(weight) = weights.get_mut(first as usize - from) {
        *weight = (1.0 + fraction) * (2.0 - fraction) / 2.0;
    }
    Some((from, weights))
}
