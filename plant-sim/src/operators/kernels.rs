//! Krasnosel'skii and Pokrovskii's operator: relays whose jumps are ramps.

use super::{Operator, next_kink, signed_sums};

/// h = sum of w k over pairs of levels, k = max(r(V - up), min(r(V - down), k)); r rises from -1 at 0 to 1 at `ramp_v`.
///
/// h is counted from the relaxed state, in which every kernel is as near to zero as zero volts let it be.
#[derive(Clone, Debug, PartialEq)]
pub struct KrasnoselskiiPokrovskii {
    /// Levels in volts, rising.
    pub level_v: Vec<f64>,
    /// w of each pair (up, down) with down <= up, row by row: (0, 0), (1, 0), (1, 1), ...
    pub weight: Vec<f64>,
    /// Length of the ramps, volts.
    pub ramp_v: f64,
}

impl KrasnoselskiiPokrovskii {
    fn ramp(&self, over_v: f64) -> f64 {
        (2.0 * over_v / self.ramp_v - 1.0).clamp(-1.0, 1.0)
    }

    /// Levels of every pair, up and down, in the order of the weights.
    fn pairs(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        (0..self.level_v.len()).flat_map(move |up| (0..=up).map(move |down| [self.level_v[up], self.level_v[down]]))
    }

    fn follow(&self, kernels: &mut [f64], at_v: f64) {
        for (kernel, [up_v, down_v]) in kernels.iter_mut().zip(self.pairs()) {
            *kernel = kernel.max(self.ramp(at_v - up_v)).min(self.ramp(at_v - down_v));
        }
    }

    fn sum(&self, kernels: &[f64]) -> f64 {
        self.weight.iter().zip(kernels).map(|(weight, kernel)| weight * kernel).sum()
    }

    /// Greatest slope of the branch from end to end on which the level `of` a pair counts.
    fn steepest(&self, of: usize) -> [f64; 2] {
        let on = |at_v: f64| {
            let moving = self
                .weight
                .iter()
                .zip(self.pairs())
                .filter(|(_, pair)| (0.0..self.ramp_v).contains(&(at_v - pair[of])));
            signed_sums(moving.map(|(weight, _)| 2.0 * weight / self.ramp_v))
        };
        self.level_v.iter().map(|&level_v| on(level_v)).fold([0.0; 2], |[a, b], [c, d]| [a.min(c), b.max(d)])
    }
}

impl Operator for KrasnoselskiiPokrovskii {
    fn relaxed(&self) -> Vec<f64> {
        let mut memory = vec![0.0; self.weight.len()];
        self.follow(&mut memory, 0.0);
        let zero = self.sum(&memory);
        memory.push(zero);
        memory
    }

    fn pass(&self, memory: &mut Vec<f64>, _: f64, to_v: f64) {
        let kernels = self.weight.len();
        self.follow(&mut memory[..kernels], to_v);
    }

    fn h(&self, memory: &[f64], _: f64) -> f64 {
        self.sum(memory) - memory[self.weight.len()]
    }

    fn smooth_v(&self, memory: &[f64], at_v: f64, towards: f64) -> f64 {
        let of = usize::from(towards < 0.0);
        let ends = self.pairs().zip(memory).flat_map(|(pair, kernel)| {
            // Where its ramp meets the kernel, and where the ramp ends.
            let met = pair[of] + 0.5 * self.ramp_v * (kernel + 1.0);
            [met, pair[of], pair[of] + self.ramp_v]
        });
        next_kink(ends, at_v, towards)
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        let ([a, b], [c, d]) = (self.steepest(0), self.steepest(1));
        [a.min(c), b.max(d)]
    }
}
