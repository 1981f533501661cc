//! The predictable half of the sensor in motion: play, the lag behind it, and the clock that drift and lines run on.
//!
//! A lag without play before it is linear and belongs to the engine, which steps it exactly.

use super::Sensor;
use super::lag::LagState;

/// The sensor's state.
pub(super) struct Readout {
    sensor: Sensor,
    sample_s: f64,
    sample: u64,
    /// Displacement and velocity at this sample behind the play.
    behind_m: f64,
    behind_m_per_s: f64,
    lag: LagState,
}

impl Readout {
    /// `lagged` says that what arrives here has passed the lag already.
    pub(super) fn new(sensor: &Sensor, sample_s: f64, lagged: bool) -> Self {
        let lag = if lagged { None } else { sensor.lag };
        Self {
            sensor: Sensor { lag, ..sensor.clone() },
            sample_s,
            sample: 0,
            behind_m: 0.0,
            behind_m_per_s: 0.0,
            lag: LagState::default(),
        }
    }

    /// At rest at `displacement_m`, at the middle of the play.
    pub(super) fn rest_at(&mut self, displacement_m: f64) {
        (self.behind_m, self.behind_m_per_s, self.lag) = (displacement_m, 0.0, LagState::at(displacement_m));
    }

    /// One sample has passed, and the structure is at `displacement_m` and moves at `velocity_m_per_s`.
    #[inline]
    pub(super) fn advance(&mut self, displacement_m: f64, velocity_m_per_s: f64) {
        self.sample += 1;
        let half_m = 0.5 * self.sensor.play_m;
        let now_m = self.behind_m.clamp(displacement_m - half_m, displacement_m + half_m);
        let now_m_per_s = if now_m == self.behind_m && half_m > 0.0 { 0.0 } else { velocity_m_per_s };
        if self.sensor.lag.is_some() {
            let (t, from, to) = (self.sample_s, self.behind_m_per_s, now_m_per_s);
            let mean = (now_m - self.behind_m) / t;
            // Hermite's cubic through both ends.
            let cubic = [self.behind_m, from, (3.0 * mean - 2.0 * from - to) / t, (from + to - 2.0 * mean) / (t * t)];
            self.lag.pass(self.sensor.lag, cubic, t);
        }
        (self.behind_m, self.behind_m_per_s) = (now_m, now_m_per_s);
    }

    /// The reading at this sample.
    #[inline]
    pub(super) fn reading_m(&self) -> f64 {
        let seen_m = if self.sensor.lag.is_some() { self.lag.value() } else { self.behind_m };
        self.sensor.predictable_m(seen_m, self.sample as f64 * self.sample_s)
    }
}
