//! The open loop along the upper half of the unit circle, and where it meets the negative real axis and the unit circle.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::sampled::SampledLoop;
use super::search;

/// Neighbouring points of the traced curve differ by less than this in angle (rad) and in the logarithm of their size.
const FINEST_TURN: f64 = 0.15;
/// A step is halved at most this often: past a pole on the unit circle no halving makes it small.
const MAX_HALVINGS: u32 = 24;
/// More points than this between two neighbours of the first grid mean that L is lost in rounding, and halving shows only more of it.
/// A pole on the circle takes a few hundred.
const MAX_POINTS_IN_STEP: usize = 2000;
/// The last point before the Nyquist frequency, where the curve reaches the real axis of itself; that end is looked at by its own.
/// The size of L is even about that frequency, so a crossing nearer than this differs from the end by 1e-12.
const LAST_ANGLE: f64 = PI * (1.0 - 1e-6);

pub(super) struct Curve<'a> {
    sampled: &'a SampledLoop,
    angles: Vec<f64>,
    values: Vec<Complex<f64>>,
}

/// A gain factor that puts an eigenvalue of the closed loop on the unit circle, and the angle at which it lands there.
#[derive(Clone, Copy)]
pub(super) struct CriticalGain {
    pub(super) gain: f64,
    pub(super) angle: f64,
}

impl<'a> Curve<'a> {
    /// Traces the curve from well below the slowest of `eigenvalues` (of the plant and of the closed loop) up to Nyquist: on a
    /// logarithmic and a linear grid, around every eigenvalue however narrow its resonance, and halving until the curve turns
    /// little from point to point. `None` if the curve cannot be resolved because rounding hides it.
    pub(super) fn trace(sampled: &'a SampledLoop, eigenvalues: &[Complex<f64>]) -> Option<Self> {
        // Closer to 1 than rounding tells from 1 is the memory of a hysteron, and no time scale.
        let distances = eigenvalues.iter().map(|z| (z - 1.0).norm()).filter(|&distance| distance > 1e-13);
        let first_angle = (1e-3 * distances.fold(1.0, f64::min)).clamp(1e-12, 1e-3);

        let mut angles = Vec::new();
        let n_log = (32.0 * (LAST_ANGLE / first_angle).log10()).ceil();
        let ratio = (LAST_ANGLE / first_angle).powf(1.0 / n_log);
        let mut angle = first_angle;
        while angle < LAST_ANGLE {
            angles.push(angle);
            angle *= ratio;
        }
        const N_LINEAR: u32 = 64;
        angles.extend((1..N_LINEAR).map(|i| LAST_ANGLE * f64::from(i) / f64::from(N_LINEAR)));
        for z in eigenvalues {
            let width = (1.0 - z.norm()).abs();
            let around = [-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0].map(|factor| z.arg().abs() + factor * width);
            angles.extend(around.into_iter().filter(|&angle| angle > first_angle && angle < LAST_ANGLE));
        }
        angles.push(LAST_ANGLE);
        angles.sort_by(f64::total_cmp);
        angles.dedup();

        let mut curve = Self { sampled, angles: Vec::new(), values: Vec::new() };
        let mut previous: Option<(f64, Complex<f64>)> = None;
        for angle in angles {
            let value = sampled.open_loop(angle);
            if let Some(previous) = previous {
                let most_points = curve.angles.len() + MAX_POINTS_IN_STEP;
                curve.halve(previous, (angle, value), MAX_HALVINGS, most_points);
                if curve.angles.len() >= most_points {
                    return None;
                }
            }
            curve.push(angle, value);
            previous = Some((angle, value));
        }
        Some(curve)
    }

    fn push(&mut self, angle: f64, value: Complex<f64>) {
        self.angles.push(angle);
        self.values.push(value);
    }

    fn halve(&mut self, left: (f64, Complex<f64>), right: (f64, Complex<f64>), halvings_left: u32, most_points: usize) {
        let change = (right.1 / left.1).ln();
        let is_smooth = change.re.abs() < FINEST_TURN && change.im.abs() < FINEST_TURN;
        let is_finite = change.re.is_finite() && change.im.is_finite();
        if halvings_left == 0 || is_smooth || !is_finite || self.angles.len() >= most_points {
            return;
        }
        let angle = 0.5 * (left.0 + right.0);
        let middle = (angle, self.sampled.open_loop(angle));
        self.halve(left, middle, halvings_left - 1, most_points);
        self.push(middle.0, middle.1);
        self.halve(middle, right, halvings_left - 1, most_points);
    }

    /// All gain factors at which an eigenvalue of the closed loop lies on the unit circle, smallest first: there `gain L = -1`.
    pub(super) fn critical_gains(&self) -> Vec<CriticalGain> {
        let sine = |value: Complex<f64>| value.im / value.norm();
        let sines: Vec<f64> = self.values.iter().map(|&value| sine(value)).collect();
        let mut found: Vec<CriticalGain> =
            search::roots(|angle| sine(self.sampled.open_loop(angle)), &self.angles, &sines, 2.0 * FINEST_TURN)
                .into_iter()
                .map(|angle| (angle, self.sampled.open_loop(angle)))
                // A sign also changes on the positive axis, and across a pole on the circle, where the value is no crossing.
                .filter(|(_, value)| value.re < 0.0 && sine(*value).abs() < 1e-6)
                .map(|(angle, value)| CriticalGain { gain: 1.0 / value.norm(), angle })
                .collect();
        // The two ends of the curve lie on the real axis and do not change sign there. At the lower end that is so only without
        // an integrator.
        let lower_end = self.angles.first().filter(|_| !self.sampled.integrates());
        for angle in lower_end.copied().into_iter().chain([PI]) {
            let value = self.sampled.open_loop(angle);
            if value.re < 0.0 && value.norm().is_finite() {
                found.push(CriticalGain { gain: 1.0 / value.norm(), angle });
            }
        }
        found.sort_by(|left, right| left.gain.total_cmp(&right.gain));
        found
    }

    /// Where `|L| = 1`: angle of z and the value of L.
    pub(super) fn unity_crossings(&self) -> Vec<(f64, Complex<f64>)> {
        let sizes: Vec<f64> = self.values.iter().map(|value| value.norm().ln()).collect();
        search::roots(|angle| self.sampled.open_loop(angle).norm().ln(), &self.angles, &sizes, 2.0 * FINEST_TURN)
            .into_iter()
            .map(|angle| (angle, self.sampled.open_loop(angle)))
            .filter(|(_, value)| (value.norm() - 1.0).abs() < 1e-6)
            .collect()
    }

    /// The least distance of the curve from -1.
    pub(super) fn modulus(&self) -> f64 {
        let distance = |value: Complex<f64>| (value + 1.0).norm();
        let distances: Vec<f64> = self.values.iter().map(|&value| distance(value)).collect();
        let (_, inside) = search::least(|angle| distance(self.sampled.open_loop(angle)), &self.angles, &distances);
        inside.min(distance(self.sampled.open_loop(PI)))
    }
}
