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

/// The chain of a log, and one for each of the log's coordinates a small step away, in lockstep.
pub(super) struct Lockstep<'a> {
    record: &'a Record<'a>,
    base: Reader<'a>,
    moved: Vec<(Reader<'a>, f64)>,
}

impl<'a> Lockstep<'a> {
    /// Log `index` at `z`; without moved chains if not `sensitive`.
    pub fn new(bench: &'a Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize, sensitive: bool) -> Self {
        let rules = bench.rules(hypothesis);
        let coordinates = if sensitive { bench.coordinates_of(hypothesis, index) } else { Vec::new() };
        let moved = coordinates.into_iter().map(|place| {
            let step = rules[place].inward_step(z[place]);
            let mut there = z.to_vec();
            there[place] += step;
            (reader(bench, hypothesis, &there, index), step)
        });
        let record = &bench.records[index];
        Self { record, moved: moved.collect(), base: reader(bench, hypothesis, z, index) }
    }

    /// Predictions of the next rows and their derivatives by each coordinate; see [`predict`].
    pub fn next(&mut self, rows: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
        let predicted = predict(self.record, &mut self.base, rows);
        let derivative = |(reader, step): &mut (Reader<'_>, f64)| {
            let mut moved = predict(self.record, reader, rows);
            moved.iter_mut().zip(&predicted).for_each(|(moved, p)| *moved = (*moved - p) / *step);
            moved
        };
        let columns = self.moved.par_iter_mut().map(derivative).collect();
        (predicted, columns)
    }
}

/// What is predicted for the next rows: displacement and, where the log has a monitor, the drive behind it, as metres of equal weight.
pub(super) fn predict(record: &Record<'_>, reader: &mut Reader<'_>, rows: usize) -> Vec<f64> {
    let Some(m_per_v) = record.monitor_m_per_v() else { return (0..rows).map(|_| reader.next_m()).collect() };
    let mut predicted = vec![0.0; 2 * rows];
    for k in 0..rows {
        predicted[k] = reader.next_m();
        predicted[rows + k] = m_per_v * reader.drive_v;
    }
    predicted
}

/// A fitted or held-out place of `predicted` and its residual.
pub(super) struct Residual {
    /// Index into what was predicted.
    pub at: usize,
    /// Measured minus predicted.
    pub residual_m: f64,
    /// Whether it is kept from the fits.
    pub is_held_out: bool,
}

/// Residuals of the rows after `from`, run-ins left out.
pub(super) fn residuals<'a>(
    record: &'a Record<'_>,
    predicted: &'a [f64],
    from: usize,
    rows: usize,
) -> impl Iterator<Item = Residual> + 'a {
    (0..predicted.len()).filter(move |at| from + at % rows >= record.run_in).map(move |at| {
        let row = from + at % rows;
        let monitor = record.log.drive_v.as_ref().zip(record.monitor_m_per_v()).filter(|_| at >= rows);
        let residual_m = match monitor {
            Some((drive_v, m_per_v)) => m_per_v * drive_v[row] - predicted[at],
            None => record.off_lattice_m(record.log.displacement_m[row] - predicted[at]),
        };
        Residual { at, residual_m, is_held_out: record.holds_out(row) }
    })
}

/// The sums at `z`; with sensitivities if `sensitive`, else squares alone. `simulations` counts simulated logs.
pub fn evaluate(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    z: &[f64],
    sensitive: bool,
    simulations: &AtomicUsize,
) -> Normal {
    let one_log = |index: usize| {
        let record = &bench.records[index];
        let mut lockstep = Lockstep::new(bench, hypothesis, z, index, sensitive);
        let count = lockstep.moved.len();
        simulations.fetch_add(1 + count, Ordering::Relaxed);
        let mut sums = Sums {
            products: DMatrix::zeros(count, count),
            gradient: DVector::zeros(count),
            squares_m2: 0.0,
            rows: 0,
            held_squares_m2: 0.0,
            held_rows: 0,
        };
        let n = record.log.len();
        for from in (0..n).step_by(CHUNK) {
            let rows = CHUNK.min(n - from);
            let (predicted, columns) = lockstep.next(rows);
            let mut fitted = Vec::with_capacity(rows);
            let mut residuals_m = Vec::with_capacity(rows);
            for Residual { at, residual_m, is_held_out } in residuals(record, &predicted, from, rows) {
                if is_held_out {
                    sums.held_squares_m2 += residual_m * residual_m;
                    sums.held_rows += 1;
                } else {
                    sums.squares_m2 += residual_m * residual_m;
                    sums.rows += 1;
                    fitted.push(at);
                    residuals_m.push(residual_m);
                }
            }
            if count > 0 && !fitted.is_empty() {
                let matrix = DMatrix::from_fn(fitted.len(), count, |k, j| columns[j][fitted[k]]);
                sums.products.gemm_tr(1.0, &matrix, &matrix, 1.0);
                sums.gradient.gemv_tr(1.0, &matrix, &DVector::from_vec(residuals_m), 1.0);
            }
        }
        sums
    };
    let logs = (0..bench.records.len()).into_par_iter().map(one_log).collect();
    Normal { logs, shared: bench.shared(hypothesis), own: bench.own(hypothesis) }
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
