//! A Duhem operator with straight shape functions: the backlash-like hysteresis.

use super::{LENGTHS, Operator};

/// dh/dV = s rho (b V - h) + g, s = sign V': far along a branch h runs along b V at a distance of (b - g) / rho behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duhem {
    /// rho: how fast a branch is joined, per volt.
    pub rate_per_v: f64,
    /// b: slope of the branches, per volt.
    pub slope_per_v: f64,
    /// g: slope on the line h = b V, per volt; 2 g - b is the slope right after a turn.
    pub inner_slope_per_v: f64,
}

impl Operator for Duhem {
    fn relaxed(&self) -> Vec<f64> {
        vec![0.0]
    }

    fn pass(&self, memory: &mut Vec<f64>, from_v: f64, to_v: f64) {
        let towards = (to_v - from_v).signum();
        let by = self.rate_per_v * (to_v - from_v).abs();
        let behind = towards * (self.inner_slope_per_v - self.slope_per_v) / self.rate_per_v;
        let off = memory[0] - self.slope_per_v * from_v;
        // off decays to `behind`; the difference in one rounding.
        memory[0] = self.slope_per_v * to_v + off + (off - behind) * (-by).exp_m1();
    }

    fn h(&self, memory: &[f64], _: f64) -> f64 {
        memory[0]
    }

    fn smooth_v(&self, _: &[f64], _: f64, _: f64) -> f64 {
        LENGTHS / self.rate_per_v
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        let [b, turned] = [self.slope_per_v, 2.0 * self.inner_slope_per_v - self.slope_per_v];
        [b.min(turned), b.max(turned)]
    }
}
