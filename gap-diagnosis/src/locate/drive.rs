//! How the drive moves at each sample: its rate, and whether it rises, falls or rests.

use super::Trace;
use crate::residual::noise_rms;

/// Time on either side over which the rate is taken: 0.1 ms. One sample alone would show a monitor's noise.
const HALF_WIDTH_S: f64 = 1e-4;
/// Time without a change after which the drive is at rest.
const REST_AFTER_S: f64 = 0.02;
/// A change smaller than this part of the drive's range is none: a 1 Hz sine of full range is slower than it for 9 ms at its peak.
const STILL_RANGE: f64 = 2e-4;

/// What the drive does at a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// Unchanged for more than 20 ms.
    Rest,
    /// Going up, or unchanged for less since it did.
    Rising,
    /// Going down, or unchanged for less since it did.
    Falling,
}

/// Direction per sample.
pub(super) fn directions(trace: &Trace<'_>) -> Vec<Direction> {
    let (drive_v, dt_s) = (trace.drive_v, trace.dt_s);
    let (lowest_v, highest_v) = range(drive_v);
    // Six sigma of a monitor's noise are not a motion either.
    let still_v = (STILL_RANGE * (highest_v - lowest_v)).max(6.0 * noise_rms(drive_v));
    let mut direction = Vec::with_capacity(drive_v.len());
    let (mut anchor_v, mut anchor_idx) = (drive_v.first().copied().unwrap_or(0.0), 0);
    let mut last = Direction::Rest;
    // Before its first change a drive has been where it is for ever.
    let mut has_moved = false;
    for (k, &at_v) in drive_v.iter().enumerate() {
        if (at_v - anchor_v).abs() > still_v {
            last = if at_v > anchor_v { Direction::Rising } else { Direction::Falling };
            (anchor_v, anchor_idx, has_moved) = (at_v, k, true);
        }
        let is_resting = !has_moved || (k - anchor_idx) as f64 * dt_s > REST_AFTER_S;
        direction.push(if is_resting { Direction::Rest } else { last });
    }
    direction
}

/// Rate of the drive at sample `k`.
pub(super) fn rate_v_per_s(trace: &Trace<'_>, k: usize) -> f64 {
    let half = ((HALF_WIDTH_S / trace.dt_s).round() as usize).max(1);
    trace.slope(k, half, |k| trace.drive_v[k])
}

/// Smallest and largest finite value; (0, 0) where there is none.
pub(super) fn range(values: &[f64]) -> (f64, f64) {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    if low <= high { (low, high) } else { (0.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DT_S, Made};
    use super::*;

    #[test]
    fn a_step_moves_then_rests() {
        let step = |t: f64| {
            if t < 0.1 {
                0.0
            } else if t < 0.2 {
                40.0
            } else {
                10.0
            }
        };
        let made = Made::new("step", 0.3, step, |_, _, _| 0.0);
        let directions = directions(&made.trace());
        let at = |t_s: f64| directions[(t_s / DT_S) as usize];
        assert_eq!([0.05, 0.11, 0.15, 0.21, 0.25].map(at), {
            use Direction::{Falling, Rest, Rising};
            [Rest, Rising, Rest, Falling, Rest]
        });
    }

    #[test]
    fn a_slow_sine_never_rests_and_its_rate_is_right() {
        let made = Made::new("sine", 2.0, super::super::tests::sine(1.0), |_, _, _| 0.0);
        assert!(directions(&made.trace())[4000..].iter().all(|direction| *direction != Direction::Rest));
        // 60 V times 2 pi 1 Hz at the zero crossing after one period.
        assert!((rate_v_per_s(&made.trace(), 20_000) - 376.99).abs() < 0.05);
    }
}
