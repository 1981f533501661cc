//! Low-passes in motion: exact responses to straight lines (the drive's side) and to cubics (the sensor's side).

use nalgebra::Complex;

/// A linear low-pass with unit gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lag {
    /// 1 / (1 + s T).
    First {
        /// T in seconds.
        time_constant_s: f64,
    },
    /// w^2 / (s^2 + 2 z w s + w^2).
    Second {
        /// w in rad/s.
        natural_rad_per_s: f64,
        /// z.
        damping_ratio: f64,
    },
}

/// A time constant below this acts as none, in seconds; the closed forms divide by it.
const NEGLIGIBLE_S: f64 = 1e-12;
/// How far a damping ratio keeps from 1, where the two poles of a second-order lag meet and the closed forms divide by zero. The
/// response changes by about as much.
const APART: f64 = 1e-6;

/// Output of a lag and, for one of second order, the output's slope.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LagState {
    value: f64,
    slope: f64,
}

/// What a piece of output adds up to over its duration.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    /// Integral of the output.
    pub zeroth: f64,
    /// Integral of the output times the time since the piece began.
    pub first: f64,
}

impl LagState {
    /// At rest on `value`.
    pub(super) fn at(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    pub(super) fn value(&self) -> f64 {
        self.value
    }

    /// Moves through `duration_s` of the input `input[0] + input[1] t + input[2] t^2 + input[3] t^3` and returns the moments of the
    /// output.
    pub(super) fn pass(&mut self, lag: Option<Lag>, input: [f64; 4], duration_s: f64) -> Moments {
        match lag {
            Some(Lag::First { time_constant_s }) if time_constant_s > NEGLIGIBLE_S => {
                let settled = settled(input, time_constant_s, 0.0);
                let away = self.value - settled[0];
                let rate = Complex::new(-1.0 / time_constant_s, 0.0);
                self.value = at(settled, duration_s) + away * (-duration_s / time_constant_s).exp();
                self.slope = 0.0;
                moments(settled, duration_s).plus(decay(rate, duration_s), Complex::new(away, 0.0))
            }
            Some(Lag::Second { natural_rad_per_s: w, damping_ratio }) => {
                let z = if (damping_ratio - 1.0).abs() < APART { 1.0 + APART } else { damping_ratio };
                let settled = settled(input, 2.0 * z / w, 1.0 / (w * w));
                let root = Complex::new(z * z - 1.0, 0.0).sqrt() * w;
                let poles = [root - z * w, -root - z * w];
                // Amplitudes of the two modes that start from where the state is and where it would have settled.
                let away = Complex::new(self.value - settled[0], 0.0);
                let moving = Complex::new(self.slope - settled[1], 0.0);
                let second = (moving - poles[0] * away) / (poles[1] - poles[0]);
                let amplitudes = [away - second, second];
                let mut sum = moments(settled, duration_s);
                (self.value, self.slope) = (at(settled, duration_s), slope_at(settled, duration_s));
                for (pole, amplitude) in poles.into_iter().zip(amplitudes) {
                    let now = amplitude * (pole * duration_s).exp();
                    self.value += now.re;
                    self.slope += (now * pole).re;
                    sum = sum.plus(decay(pole, duration_s), amplitude);
                }
                sum
            }
            _ => {
                *self = Self { value: at(input, duration_s), slope: 0.0 };
                moments(input, duration_s)
            }
        }
    }
}

/// What 1 / (1 + a s + b s^2) makes of a cubic once everything else has died out: u - a u' + (a^2 - b) u'' + (2 a b - a^3) u'''.
fn settled([c0, c1, c2, c3]: [f64; 4], a: f64, b: f64) -> [f64; 4] {
    let (second, third) = (a * a - b, 2.0 * a * b - a * a * a);
    [c0 - a * c1 + 2.0 * second * c2 + 6.0 * third * c3, c1 - 2.0 * a * c2 + 6.0 * second * c3, c2 - 3.0 * a * c3, c3]
}

fn at([c0, c1, c2, c3]: [f64; 4], t: f64) -> f64 {
    c0 + t * (c1 + t * (c2 + t * c3))
}

fn slope_at([_, c1, c2, c3]: [f64; 4], t: f64) -> f64 {
    c1 + t * (2.0 * c2 + t * 3.0 * c3)
}

fn moments([c0, c1, c2, c3]: [f64; 4], t: f64) -> Moments {
    Moments {
        zeroth: t * (c0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0))),
        first: t * t * (c0 / 2.0 + t * (c1 / 3.0 + t * (c2 / 4.0 + t * c3 / 5.0))),
    }
}

/// Zeroth and first moment of exp(rate t) over a duration.
fn decay(rate: Complex<f64>, duration_s: f64) -> [Complex<f64>; 2] {
    let end = (rate * duration_s).exp();
    let zeroth = (end - 1.0) / rate;
    [zeroth, (end * duration_s - zeroth) / rate]
}

impl Moments {
    fn plus(self, moments: [Complex<f64>; 2], amplitude: Complex<f64>) -> Self {
        Self { zeroth: self.zeroth + (moments[0] * amplitude).re, first: self.first + (moments[1] * amplitude).re }
    }
}
