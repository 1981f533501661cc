//! Preisach's operator with a weight that is even over each cell of a grid.

use super::{Operator, next_kink, signed_sums};

/// h = integral over up >= down of w(up, down) times a relay, which is 1 since the voltage last rose to `up` and -1 since it last fell to
/// `down`.
///
/// Beyond the grid nothing changes. h is counted from the relaxed state, the end of ever smaller swings about zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Preisach {
    /// Edges of the cells in volts, rising: one more than there are rows.
    pub level_v: Vec<f64>,
    /// Weight of each cell (up, down) as a whole, row by row: (0, 0), (1, 0), (1, 1), ...; those with up = down are triangles.
    pub weight: Vec<f64>,
}

/// Swings of the relaxation for each cell of a row.
const SWINGS: usize = 4;
/// Memory: h of the relaxed state; then voltage and h of every reversal that isn't wiped out, the first of them the grid's lower end;
/// then the voltage.
const FIRST: usize = 1;

impl Preisach {
    fn low_v(&self) -> f64 {
        self.level_v.first().copied().unwrap_or_default()
    }

    fn high_v(&self) -> f64 {
        self.level_v.last().copied().unwrap_or_default()
    }

    /// Half of what a rise from `low_v` to `high_v` adds: the weight between the two (Everett's function).
    fn between(&self, low_v: f64, high_v: f64) -> f64 {
        let cells = self.level_v.windows(2).enumerate();
        let mut sum = 0.0;
        for (up, edge_v) in cells {
            let top = high_v.min(edge_v[1]) - edge_v[0];
            if top <= 0.0 {
                break;
            }
            let height_v = edge_v[1] - edge_v[0];
            let row = &self.weight[up * (up + 1) / 2..];
            for (down, edge_v) in self.level_v.windows(2).enumerate().take(up) {
                let width_v = edge_v[1] - edge_v[0];
                let right = edge_v[1] - low_v.max(edge_v[0]);
                if right > 0.0 {
                    sum += row[down] * (top / height_v) * (right / width_v);
                }
            }
            let side_v = high_v.min(edge_v[1]) - low_v.max(edge_v[0]);
            if side_v > 0.0 {
                sum += row[up] * (side_v / height_v).powi(2);
            }
        }
        sum
    }

    /// h at the tip, from the reversal before it.
    fn raw(&self, memory: &[f64]) -> f64 {
        let at_v = memory[memory.len() - 1];
        let (from_v, from) = (memory[memory.len() - 3], memory[memory.len() - 2]);
        if at_v >= from_v { from + 2.0 * self.between(from_v, at_v) } else { from - 2.0 * self.between(at_v, from_v) }
    }

    /// Reversals in memory; those of even number are minima.
    fn reversals(memory: &[f64]) -> usize {
        (memory.len() - FIRST - 1) / 2
    }

    fn reversal_v(memory: &[f64], number: usize) -> f64 {
        memory[FIRST + 2 * number]
    }

    fn go(&self, memory: &mut Vec<f64>, to_v: f64) {
        let to_v = to_v.clamp(self.low_v(), self.high_v());
        let at_v = memory[memory.len() - 1];
        if to_v == at_v {
            return;
        }
        let rises = to_v > at_v;
        let last = Self::reversals(memory) - 1;
        // Rising goes on from a minimum and begins a new branch below a maximum, and the other way round.
        if rises == (last % 2 == 1) {
            let h = self.raw(memory);
            memory.push(h);
            memory.push(at_v);
        }
        loop {
            let last = Self::reversals(memory) - 1;
            let is_wiped = last >= 1 && {
                let before_v = Self::reversal_v(memory, last - 1);
                if rises { to_v >= before_v } else { to_v <= before_v }
            };
            if !is_wiped {
                break;
            }
            // The grid's lower end stays: below it nothing is left to remember.
            let kept = if last == 1 { 1 } else { last - 1 };
            memory.truncate(FIRST + 2 * kept);
            memory.push(to_v);
            if last == 1 {
                break;
            }
        }
        let tip = memory.len() - 1;
        memory[tip] = to_v;
    }
}

impl Operator for Preisach {
    fn relaxed(&self) -> Vec<f64> {
        let all: f64 = self.weight.iter().sum();
        let mut memory = vec![0.0, self.low_v(), -all, self.low_v()];
        let reach_v = self.low_v().abs().max(self.high_v().abs());
        let swings = SWINGS * self.level_v.len();
        for swing in 0..swings {
            let size_v = reach_v * (1.0 - swing as f64 / swings as f64);
            self.go(&mut memory, size_v);
            self.go(&mut memory, -size_v * (1.0 - 0.5 / swings as f64));
        }
        self.go(&mut memory, 0.0);
        memory[0] = self.raw(&memory);
        memory
    }

    fn pass(&self, memory: &mut Vec<f64>, _: f64, to_v: f64) {
        self.go(memory, to_v);
    }

    fn h(&self, memory: &[f64], _: f64) -> f64 {
        self.raw(memory) - memory[0]
    }

    fn smooth_v(&self, memory: &[f64], at_v: f64, towards: f64) -> f64 {
        let reversals = (0..Self::reversals(memory)).map(|number| Self::reversal_v(memory, number));
        next_kink(self.level_v.iter().copied().chain(reversals), at_v, towards)
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        let width_v = |number: usize| self.level_v[number + 1] - self.level_v[number];
        let rows = self.level_v.len().saturating_sub(1);
        let cell = |up: usize, down: usize| self.weight[up * (up + 1) / 2 + down];
        // A branch from end to end; a triangle is widest where the branch leaves it.
        let twice =
            |of: f64, number: usize, is_triangle: bool| if is_triangle { 4.0 * of } else { 2.0 * of } / width_v(number);
        let rising = (0..rows).map(|up| signed_sums((0..=up).map(|down| twice(cell(up, down), up, up == down))));
        let falling = (0..rows).map(|down| signed_sums((down..rows).map(|up| twice(cell(up, down), down, up == down))));
        rising.chain(falling).fold([0.0; 2], |[a, b], [c, d]| [a.min(c), b.max(d)])
    }
}
