//! The predictable half of the sensor in motion: play, the lag behind it, and the clock that drift and lines run on.
//!
//! A lag without play before it is linear and belongs to the engine, which steps it exactly.

use super::lag::LagState;
use super::{Relaxation, Sensor};

/// The sensor's state.
pub(super) struct Readout {
    sensor: Sensor,
    sample_s: f64,
    sample: u64,
    /// Displacement and velocity at this sample behind the play.
    behind_m: f64,
    behind_m_per_s: f64,
    lag: LagState,
    creep: Vec<Relaxation>,
    /// What each element of the creep has relaxed to, metres.
    relaxed_m: Vec<f64>,
    structure_m: f64,
}

impl Readout {
    /// `lagged` says that what arrives here has passed the lag already.
    pub(super) fn new(sensor: &Sensor, creep: &[Relaxation], sample_s: f64, lagged: bool) -> Self {
        let lag = if lagged { None } else { sensor.lag };
        Self {
            sensor: Sensor { lag, ..sensor.clone() },
            sample_s,
            sample: 0,
            behind_m: 0.0,
            behind_m_per_s: 0.0,
            lag: LagState::default(),
            creep: creep.to_vec(),
            relaxed_m: vec![0.0; creep.len()],
            structure_m: 0.0,
        }
    }

    /// At rest at `displacement_m`, at the middle of the play.
    pub(super) fn rest_at(&mut self, displacement_m: f64) {
        self.relaxed_m.fill(displacement_m);
        self.structure_m = displacement_m;
        let seen_m = self.crept_m(displacement_m);
        (self.behind_m, self.behind_m_per_s, self.lag) = (seen_m, 0.0, LagState::at(seen_m));
    }

    /// One sample has passed, and the structure is at `displacement_m` and moves at `velocity_m_per_s`.
    #[inline]
    pub(super) fn advance(&mut self, displacement_m: f64, velocity_m_per_s: f64) {
        self.sample += 1;
        let displacement_m = if self.creep.is_empty() { displacement_m } else { self.relax(displacement_m) };
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

    /// Lets every element follow the mean of the displacement over the sample; returns the displacement with all of them.
    fn relax(&mut self, displacement_m: f64) -> f64 {
        let mean_m = 0.5 * (self.structure_m + displacement_m);
        for (element, relaxed_m) in self.creep.iter().zip(&mut self.relaxed_m) {
            *relaxed_m -= (-self.sample_s / element.time_constant_s).exp_m1() * (mean_m - *relaxed_m);
        }
        self.structure_m = displacement_m;
        self.crept_m(displacement_m)
    }

    fn crept_m(&self, displacement_m: f64) -> f64 {
        displacement_m + self.creep.iter().zip(&self.relaxed_m).map(|(c, relaxed_m)| c.share * relaxed_m).sum::<f64>()
    }

    /// The reading at this sample.
    #[inline]
    pub(super) fn reading_m(&self) -> f64 {
        let seen_m = if self.sensor.lag.is_some() { self.lag.value() } else { self.behind_m };
        self.sensor.predictable_m(seen_m, self.sample as f64 * self.sample_s)
    }
}
