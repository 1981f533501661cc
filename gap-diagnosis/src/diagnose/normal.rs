//! Normal equations by re-simulation, in chunks: every perturbed chain runs in lockstep with the unperturbed one, so that no
//! sensitivity is ever stored. Ten minutes at 20 kHz cost what the logs themselves take.

use super::bench::{Bench, Hypothesis, Record};
use nalgebra::{DMatrix, DVector};
use plant_sim::replay::Reader;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rows that the chains run ahead before their differences are added up.
const CHUNK: usize = 4096;

/// Sums over the fitted rows of one log, and the squares of its held-out rows.
#[derive(Clone, Debug)]
pub struct Sums {
    /// Inner products of the sensitivities, metres squared; shared coordinates first, then the log's own.
    pub products: DMatrix<f64>,
    /// Inner products of sensitivities and residual (measured minus predicted).
    pub gradient: DVector<f64>,
    /// Sum of squared residuals.
    pub squares_m2: f64,
    /// Fitted rows.
    pub rows: usize,
    /// Sum of squared residuals of the rows that are held out.
    pub held_squares_m2: f64,
    /// Rows held out.
    pub held_rows: usize,
}

/// Sums of all logs at one point.
#[derive(Clone, Debug)]
pub struct Normal {
    /// One for each log.
    pub logs: Vec<Sums>,
    /// Shared coordinates.
    pub shared: usize,
    /// Own coordinates of each log.
    pub own: usize,
}

/// Log `index` played at coordinates `z`.
pub(super) fn reader<'a>(bench: &'a Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Reader<'a> {
    let chain = bench.chain_at(hypothesis, z, index);
    let start = bench.start_at(hypothesis, z, index, &chain);
    Reader::new(&chain, bench.records[index].log, &start)
}

/// Residual of one row: what a reading on a lattice leaves open is no residual.
#[inline]
pub(super) fn residual_m(record: &Record<'_>, measured_m: f64, predicted_m: f64) -> f64 {
    let residual = measured_m - predicted_m;
    if record.lattice_m > 0.0 {
        (residual.abs() - 0.5 * record.lattice_m).max(0.0).copysign(residual)
    } else {
        residual
    }
}

/// The sums at `z`; with sensitivities if `sensitive`, else squares alone. `simulations` counts simulated logs.
pub fn evaluate(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    z: &[f64],
    sensitive: bool,
    simulations: &AtomicUsize,
) -> Normal {
    let rules = bench.rules(hypothesis);
    let (shared, own) = (bench.shared(hypothesis), bench.own(hypothesis));
    let one_log = |index: usize| {
        let record = &bench.records[index];
        let mut base = reader(bench, hypothesis, z, index);
        let places: Vec<usize> = if sensitive && record.held_out != super::bench::HeldOut::Everything {
            (0..shared).chain(bench.own_start(hypothesis, index)..bench.own_start(hypothesis, index) + own).collect()
        } else {
            Vec::new()
        };
        let mut moved: Vec<(Reader<'_>, f64)> = places
            .iter()
            .map(|&place| {
                let rule = &rules[place];
                // Towards the inside, so that a bound doesn't swallow the step.
                let step = if z[place] + rule.step > rule.bounds[1] { -rule.step } else { rule.step };
                let mut there = z.to_vec();
                there[place] += step;
                (reader(bench, hypothesis, &there, index), step)
            })
            .collect();
        simulations.fetch_add(1 + moved.len(), Ordering::Relaxed);
        let count = moved.len();
        let mut sums = Sums {
            products: DMatrix::zeros(count, count),
            gradient: DVector::zeros(count),
            squares_m2: 0.0,
            rows: 0,
            held_squares_m2: 0.0,
            held_rows: 0,
        };
        let n = record.log.len();
        let mut predicted = vec![0.0; CHUNK];
        for from in (0..n).step_by(CHUNK) {
            let rows = CHUNK.min(n - from);
            predicted[..rows].iter_mut().for_each(|p| *p = base.next_m());
            let columns: Vec<Vec<f64>> = moved
                .par_iter_mut()
                .map(|(reader, step)| predicted[..rows].iter().map(|p| (reader.next_m() - p) / *step).collect())
                .collect();
            let mut fitted = Vec::with_capacity(rows);
            let mut residuals = Vec::with_capacity(rows);
            for k in 0..rows {
                let row = from + k;
                if row < record.run_in {
                    continue;
                }
                let residual = residual_m(record, record.log.displacement_m[row], predicted[k]);
                if record.held_out.holds(row) {
                    sums.held_squares_m2 += residual * residual;
                    sums.held_rows += 1;
                } else {
                    sums.squares_m2 += residual * residual;
                    sums.rows += 1;
                    fitted.push(k);
                    residuals.push(residual);
                }
            }
            if count > 0 && !fitted.is_empty() {
                let matrix = DMatrix::from_fn(fitted.len(), count, |k, j| columns[j][fitted[k]]);
                sums.products.gemm_tr(1.0, &matrix, &matrix, 1.0);
                sums.gradient.gemv_tr(1.0, &matrix, &DVector::from_vec(residuals), 1.0);
            }
        }
        sums
    };
    Normal { logs: (0..bench.records.len()).into_par_iter().map(one_log).collect(), shared, own }
}

impl Normal {
    /// Weighted sum of squares of the fitted rows; `weights` are one over the variance, per square metre, one for each log.
    pub fn cost(&self, weights: &[f64]) -> f64 {
        self.logs.iter().zip(weights).map(|(sums, weight)| weight * sums.squares_m2).sum()
    }

    /// Information and gradient over all coordinates.
    pub fn assemble(&self, weights: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let size = self.shared + self.logs.len() * self.own;
        let mut information = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        for (index, (sums, &weight)) in self.logs.iter().zip(weights).enumerate() {
            if sums.products.nrows() == 0 {
                continue;
            }
            let place = |i: usize| if i < self.shared { i } else { self.shared + index * self.own + i - self.shared };
            for i in 0..sums.products.nrows() {
                gradient[place(i)] += weight * sums.gradient[i];
                for j in 0..sums.products.nrows() {
                    information[(place(i), place(j))] += weight * sums.products[(i, j)];
                }
            }
        }
        (information, gradient)
    }

    /// Rms of the fitted rows of all logs, metres.
    pub fn rms_m(&self) -> f64 {
        let (squares, rows) = self.logs.iter().fold((0.0, 0), |(s, n), log| (s + log.squares_m2, n + log.rows));
        (squares / rows.max(1) as f64).sqrt()
    }
}
