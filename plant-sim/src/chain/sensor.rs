//! The sensor: what turns the structure's displacement into the logged number.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Offset, noise and quantisation, in the order of the signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Reading at zero displacement, in metres.
    pub offset_m: f64,
    /// White noise, rms in metres.
    pub noise_m: f64,
    /// Step of the converter in metres; zero for none.
    pub quantum_m: f64,
}

impl Sensor {
    /// A sensor that reads the displacement.
    pub const IDEAL: Sensor = Sensor { offset_m: 0.0, noise_m: 0.0, quantum_m: 0.0 };
}

/// A sensor at work: its parameters and its noise generator.
pub struct SensorState {
    sensor: Sensor,
    noise: Pcg64,
}

impl SensorState {
    /// A sensor whose noise is determined by `seed`.
    pub fn new(sensor: &Sensor, seed: u64) -> Self {
        Self { sensor: sensor.clone(), noise: Pcg64::seed_from_u64(seed) }
    }

    /// The logged number for an ideal reading (which contains the offset already), in metres.
    pub fn read_m(&mut self, ideal_m: f64) -> f64 {
        let mut reading_m = ideal_m;
        if self.sensor.noise_m > 0.0 {
            let normal: f64 = StandardNormal.sample(&mut self.noise);
            reading_m += self.sensor.noise_m * normal;
        }
        if self.sensor.quantum_m > 0.0 {
            reading_m = (reading_m / self.sensor.quantum_m).round() * self.sensor.quantum_m;
        }
        reading_m
    }
}
