//! Dahl's law of friction, driven by volts.

use super::{LENGTHS, Operator};

/// dh/dV = rho (1 - s h)^i, s = sign V'; h stays within -1 and 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dahl {
    /// rho: dh/dV at h = 0, per volt.
    pub rate_per_v: f64,
    /// i: how h nears its end; 1 is an exponential, and less reaches the end at a finite distance.
    pub exponent: f64,
}

impl Operator for Dahl {
    fn relaxed(&self) -> Vec<f64> {
        vec![0.0]
    }

    fn pass(&self, memory: &mut Vec<f64>, from_v: f64, to_v: f64) {
        let towards = (to_v - from_v).signum();
        // u = 1 - s h is what is left to the end: du/d|V| = -rho u^i.
        let left = (1.0 - towards * memory[0]).max(0.0);
        let by = self.rate_per_v * (to_v - from_v).abs();
        let power = 1.0 - self.exponent;
        let then = if power.abs() < 1e-9 {
            left * (-by).exp()
        } else if left == 0.0 {
            0.0
        } else {
            (left.powf(power) - power * by).max(0.0).powf(power.recip())
        };
        memory[0] = towards * (1.0 - then);
    }

    fn h(&self, memory: &[f64], _: f64) -> f64 {
        memory[0]
    }

    fn smooth_v(&self, memory: &[f64], _: f64, towards: f64) -> f64 {
        let left = (1.0 - towards.signum() * memory[0]).max(0.0);
        // ln u bends over u^(1-i)/rho; where u reaches zero, for i < 1, is a kink.
        let length_v = LENGTHS / (self.rate_per_v * self.exponent.max(1.0));
        if self.exponent < 1.0 && left < 1e-6 {
            return f64::INFINITY;
        }
        length_v * left.powf(1.0 - self.exponent).min(1.0)
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        [0.0, self.rate_per_v * 2f64.powf(self.exponent)]
    }
}
