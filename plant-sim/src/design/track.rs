//! How well a loop follows sines.

use super::{Frame, single};
use crate::experiment::ExperimentError;
use crate::metrics::{Task, loop_metrics};
use crate::spec::Shape;

/// Frequencies of the tracking table.
pub const SINES_HZ: [f64; 5] = [1.0, 10.0, 50.0, 100.0, 150.0];
/// Amplitude of the tracking table, where the reference's clamp lets it through.
pub const AMPLITUDE_M: f64 = 80e-6;

/// Rms error of the last of three periods in percent of the amplitude, at each of [`SINES_HZ`]; NaN at half the rate and above, where samples tell
/// no sine.
///
/// # Errors
/// A loop that can't be run.
pub fn tracking(frame: &Frame<'_>) -> Result<[f64; 5], ExperimentError> {
    let amplitude_m = AMPLITUDE_M.min(f64::from(frame.settings.reference_max_m));
    let mut errors = [f64::NAN; 5];
    for (error, hz) in errors.iter_mut().zip(SINES_HZ).filter(|(_, hz)| *hz < 0.5 * frame.rate_hz()) {
        let run = frame.run(&single(Shape::Sine { hz }, amplitude_m), 3.0 / hz)?;
        let task = Task::Sine { amplitude_m, hz };
        let metrics = loop_metrics(task, run.dt_s, Some(&run.reference_m), &run.displacement_m);
        *error = metrics.rms_error_percent.unwrap_or(f64::NAN);
    }
    Ok(errors)
}
