//! A sensor's reading sample by sample: what waves in it turns by the same angle from each sample to the next, and one sine and cosine tell many.

use super::Sensor;
use std::cell::Cell;
use std::f64::consts::TAU;

/// Samples that one sine and cosine serve: from there on they are turned by angles that are known beforehand.
const SERVED: u64 = 64;

/// The predictable part of a sensor that is read once a sample: [`Sensor::predictable_m`], and the same number but for rounding.
pub struct Reading {
    pub(super) sensor: Sensor,
    /// A gain and an offset, which need none of the rest at every sample.
    is_affine: bool,
    sample_s: f64,
    /// Of its swings, then of its lines.
    phasors: Vec<Phasor>,
}

impl Reading {
    /// Of a `sensor` that is read every `sample_s`, from time zero on.
    pub fn new(sensor: &Sensor, sample_s: f64) -> Self {
        let swings = sensor.swings.iter().map(|swing| swing.hz);
        let waves_hz = swings.chain(sensor.lines.iter().map(|line| line.hz));
        Self {
            is_affine: sensor.is_affine(),
            sample_s,
            phasors: waves_hz.map(|hz| Phasor::new(hz, sample_s, 0.0)).collect(),
            sensor: sensor.clone(),
        }
    }

    /// The reading, in metres, of a displacement (behind play and lag) at sample number `sample`.
    #[inline]
    pub fn at_m(&self, displacement_m: f64, sample: u64) -> f64 {
        if self.is_affine {
            return self.sensor.gain * displacement_m + self.sensor.offset_m;
        }
        self.bent_m(displacement_m, sample)
    }

    #[inline(never)]
    fn bent_m(&self, displacement_m: f64, sample: u64) -> f64 {
        let time_s = sample as f64 * self.sample_s;
        self.sensor.reading_m(displacement_m, time_s, |wave, _| self.phasors[wave].at(sample))
    }
}

/// Sine and cosine of a phase that grows by the same from sample to sample.
pub(super) struct Phasor {
    rad_per_s: f64,
    sample_s: f64,
    /// Time of sample zero.
    first_s: f64,
    /// Sine and cosine of the angles from a sample that is looked up to those that it serves.
    turns: Vec<(f64, f64)>,
    /// The sample that was looked up last, with its own.
    known: Cell<(u64, (f64, f64))>,
}

impl Phasor {
    pub(super) fn new(hz: f64, sample_s: f64, first_s: f64) -> Self {
        let rad_per_s = TAU * hz;
        let turns = (0..SERVED).map(|sample| (rad_per_s * (sample as f64 * sample_s)).sin_cos()).collect();
        Self { rad_per_s, sample_s, first_s, turns, known: Cell::new((0, (rad_per_s * first_s).sin_cos())) }
    }

    /// Sine and cosine at sample number `sample`.
    #[inline]
    pub(super) fn at(&self, sample: u64) -> (f64, f64) {
        let at = sample % SERVED;
        let first = sample - at;
        let (known, mut wave) = self.known.get();
        if known != first {
            wave = (self.rad_per_s * (first as f64 * self.sample_s + self.first_s)).sin_cos();
            self.known.set((first, wave));
        }
        let ((sin, cos), (by_sin, by_cos)) = (wave, self.turns[at as usize]);
        (sin * by_cos + cos * by_sin, cos * by_cos - sin * by_sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::{Line, Swing};

    /// In the middle of samples, forwards and backwards across what one sine serves.
    #[test]
    fn a_phase_begins_where_it_is_said_to() {
        let (hz, sample_s) = (37.3, 5e-5);
        let phasor = Phasor::new(hz, sample_s, 0.5 * sample_s);
        for sample in [0u64, 1, 62, 63, 64, 65, 127, 128, 64, 63, 1, 0, 1_000_000] {
            let (sin, cos) = (TAU * hz * (sample as f64 + 0.5) * sample_s).sin_cos();
            let wave = phasor.at(sample);
            assert!((wave.0 - sin).abs() < 1e-12 && (wave.1 - cos).abs() < 1e-12, "{sample}: {wave:?} {sin} {cos}");
        }
    }

    /// An hour at 20 kHz, looked at here and there and in any order.
    #[test]
    fn a_reading_sample_by_sample_is_that_at_any_time() {
        let mut sensor = Sensor { offset_m: 1e-6, cubic_per_m2: 1e6, ..Sensor::IDEAL };
        sensor.swings.push(Swing { hz: 0.31, cos_share: 0.02, sin_share: -0.01 });
        sensor.lines.extend([50.02, 150.06, 9_999.0].map(|hz| Line { hz, cos_m: 1e-7, sin_m: -2e-7 }));
        let sample_s = 5e-5;
        let reading = Reading::new(&sensor, sample_s);
        for k in 0..20_000u64 {
            let sample = k * 7_919 % 72_000_000;
            let displacement_m = 1e-4 * (0.37 * k as f64).sin();
            let (fast_m, at_once_m) =
                (reading.at_m(displacement_m, sample), sensor.predictable_m(displacement_m, sample as f64 * sample_s));
            // Of the fastest line the angle itself is known to 2e-16 of 2e8.
            assert!((fast_m - at_once_m).abs() < 3e-14, "{sample}: {fast_m:e} {at_once_m:e}");
        }
        assert_eq!(Reading::new(&sensor, sample_s).at_m(1e-5, 12_345), reading.at_m(1e-5, 12_345));
    }
}
