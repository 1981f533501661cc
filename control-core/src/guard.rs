//! The displacement trip: is the measured value a number, and does the plant still stop in time?
//!
//! Condition: abs(y) + abs(dy/dt) t_stop > trip, with dy/dt from the last two samples and 0 on the first.
//! A verdict is latched in the state; only a fresh state forgets it. The guard itself drives nothing.

use crate::limits::Limits;
use crate::settings::Settings;

/// The trip's numbers, fixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Trip level; the greatest f32 when there is none, so that an infinite measurement still fails the comparison.
    trip_m: f32,
    /// t_stop in samples: turns the difference of two samples into the way still travelled. 0 when there is no trip.
    stop_samples: f32,
}

/// What the guard remembers.
#[derive(Clone, Copy, Debug)]
pub struct GuardState {
    /// The last sample. NaN while there is none and again once latched: NaN fails the guard's one comparison, so the
    /// common path pays nothing for the first sample and for the latch.
    measured_m: f32,
    /// Why the guard has tripped; empty while it has not.
    latched: Limits,
}

impl Default for GuardState {
    fn default() -> Self {
        GuardState { measured_m: f32::NAN, latched: Limits::NONE }
    }
}

impl GuardState {
    /// Why the guard has tripped, empty while it has not.
    pub fn latched(&self) -> Limits {
        self.latched
    }

    /// The last healthy sample, or NaN when there is none (none came yet, or the guard has tripped).
    pub fn measured_m(&self) -> f32 {
        self.measured_m
    }

    /// Latches a verdict from outside; all that are latched now.
    #[cold]
    pub(crate) fn latch(&mut self, why: Limits) -> Limits {
        self.latched |= why;
        self.measured_m = f32::NAN;
        self.latched
    }
}

impl Guard {
    /// Takes checked settings.
    pub(crate) fn build(settings: &Settings) -> Guard {
        let tripless = settings.trip_m.is_infinite();
        Guard {
            trip_m: if tripless { f32::MAX } else { settings.trip_m },
            stop_samples: if tripless { 0.0 } else { settings.stop_time_s * settings.rate_hz },
        }
    }

    /// Looks at one sample; returns the latched reasons, empty while all is well.
    #[inline]
    pub fn watch(&self, state: &mut GuardState, measured_m: f32) -> Limits {
        let moved_m = measured_m - state.measured_m;
        if measured_m.abs() + moved_m.abs() * self.stop_samples <= self.trip_m {
            state.measured_m = measured_m;
            return Limits::NONE;
        }
        self.examine(state, measured_m)
    }

    /// Sorts out why the common comparison failed: latched before, first sample, no number, or a real trip.
    #[cold]
    fn examine(&self, state: &mut GuardState, measured_m: f32) -> Limits {
        if !state.latched.is_empty() {
            return state.latched;
        }
        if !measured_m.is_finite() {
            return state.latch(Limits::NOT_A_NUMBER);
        }
        let moved_m = if state.measured_m.is_nan() { 0.0 } else { measured_m - state.measured_m };
        let reach_m = measured_m.abs() + moved_m.abs() * self.stop_samples;
        // Without a trip the reach can still overflow to NaN (infinity times 0); that is no trip.
        if reach_m <= self.trip_m || self.trip_m == f32::MAX {
            state.measured_m = measured_m;
        } else {
            state.latch(Limits::TRIP);
        }
        state.latched
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard(trip_m: f32, stop_samples: f32) -> Guard {
        Guard { trip_m, stop_samples }
    }

    #[test]
    fn the_first_sample_has_no_velocity() {
        let mut state = GuardState::default();
        // 100 um at once would count as 100 um + 100 um * 2 if the sample before were taken as 0.
        assert!(guard(120e-6, 2.0).watch(&mut state, 100e-6).is_empty());
        // 1 um per sample times 2 samples: 101 + 2 <= 120.
        assert!(guard(120e-6, 2.0).watch(&mut state, 101e-6).is_empty());
    }

    #[test]
    fn speed_trips_before_the_level_and_stays_latched() {
        let mut state = GuardState::default();
        let guard = guard(120e-6, 2.0);
        assert!(guard.watch(&mut state, 0.0).is_empty());
        assert!(guard.watch(&mut state, 39e-6).is_empty());
        // 80 + 2 * 41 = 162 um.
        assert_eq!(guard.watch(&mut state, 80e-6), Limits::TRIP);
        assert_eq!(guard.watch(&mut state, 0.0), Limits::TRIP);
        assert_eq!(guard.watch(&mut state, f32::NAN), Limits::TRIP);
    }

    #[test]
    fn a_first_sample_beyond_the_level_trips() {
        let mut state = GuardState::default();
        assert_eq!(guard(120e-6, 0.0).watch(&mut state, -121e-6), Limits::TRIP);
    }

    #[test]
    fn without_a_trip_only_non_numbers_count() {
        let guard = guard(f32::MAX, 0.0);
        let mut state = GuardState::default();
        for measured_m in [0.0, 3e38, -3e38, 1e-45, f32::MAX, f32::MIN] {
            assert!(guard.watch(&mut state, measured_m).is_empty(), "{measured_m}");
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut state = GuardState::default();
            assert!(guard.watch(&mut state, 0.0).is_empty());
            assert_eq!(guard.watch(&mut state, bad), Limits::NOT_A_NUMBER);
        }
    }
}
