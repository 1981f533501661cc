//! Normal equations by re-simulation, in chunks: every perturbed chain runs in lockstep with the unperturbed one, so that no
//! sensitivity is ever stored. Ten minutes at 20 kHz cost what the logs themselves take.

use super::bench::{Bench, Record};
use super::hypothesis::Hypothesis;
use nalgebra::{DMatrix, DVector};
use plant_sim::chain::{Chain, Reading};
use plant_sim::log::Log;
use plant_sim::replay::{Reader, Start, reading_of};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rows that the chains run ahead before their differences are added up; a multiple of every thinning.
pub(super) const CHUNK: usize = 4096;
/// What a plant that is no number any more is taken to be off by in each row: more than any that is one.
const RUN_AWAY_M: f64 = 1.0;
/// Most sensitivities that are kept, of all rows of all logs: 64 MB.
const MOST_KEPT: usize = 8_000_000;

/// Where a plant's reading is one in a log that it is played on, else far off: what it misses stays a number.
pub(super) fn or_far_off_m(reading_m: f64) -> f64 {
    // Not a number is no less than anything.
    if reading_m.abs() < RUN_AWAY_M { reading_m } else { RUN_AWAY_M }
}

/// Sums over the fitted rows of one log.
#[derive(Clone, Debug)]
pub struct Sums {
    /// Inner products of the sensitivities, metres squared; shared coordinates first, then the log's own.
    pub products: DMatrix<f64>,
    /// Inner products of sensitivities and residual (measured minus predicted).
    pub gradient: DVector<f64>,
    /// Sum of squared residuals, those of a monitor included.
    pub squares_m2: f64,
    /// What of it a monitor is off by within its own error: it is fitted, and neither adds to a gap nor makes up for one.
    within_m2: f64,
    /// Fitted rows.
    pub rows: usize,
    /// Rows that one row of the sensitivities stands for.
    thin: usize,
    /// The sensitivities themselves, chunk by chunk, as long as they may be carried on; none where they would take too much memory.
    kept: Vec<Kept>,
}

/// Sensitivities at some rows, and the residuals there: see [`Chunk`].
#[derive(Clone, Debug)]
struct Kept {
    /// The log's row at which the chunk begins.
    from: usize,
    places: Vec<usize>,
    columns: DMatrix<f64>,
    residuals_m: DVector<f64>,
}

impl Sums {
    /// Of no rows, for `count` coordinates.
    fn of(count: usize) -> Self {
        let (products, gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        Self { products, gradient, squares_m2: 0.0, within_m2: 0.0, rows: 0, thin: 1, kept: Vec::new() }
    }

    /// The sums at a point that lies `change` away (the log's coordinates), of which `there` has the residuals: sensitivities change as
    /// little as the residuals' change asks for, each coordinate counted in `units` (Broyden 1965).
    fn carried(&self, there: &Self, change: &DVector<f64>, units: &DVector<f64>) -> Option<Self> {
        let along = change.component_div(units).component_div(units);
        let length2 = along.dot(change);
        if self.kept.is_empty() || self.kept.len() != there.kept.len() || !there.squares_m2.is_finite() {
            return None;
        }
        let turn = if length2 > 0.0 { along / length2 } else { along };
        let mut carried = Self { squares_m2: there.squares_m2, within_m2: there.within_m2, ..self.clone() };
        carried.gradient.fill(0.0);
        let (mut crossed, mut missed2) = (DVector::zeros(change.len()), 0.0);
        for (kept, there) in carried.kept.iter_mut().zip(&there.kept) {
            // What the sensitivities did not foresee of the prediction's change.
            let mut missed = (&kept.residuals_m - &there.residuals_m) / self.thin as f64;
            missed.gemv(-1.0, &kept.columns, change, 1.0);
            crossed.gemv_tr(1.0, &kept.columns, &missed, 1.0);
            missed2 += missed.norm_squared();
            kept.columns.ger(1.0, &missed, &turn, 1.0);
            kept.residuals_m.copy_from(&there.residuals_m);
            carried.gradient.gemv_tr(1.0, &kept.columns, &kept.residuals_m, 1.0);
        }
        let thin = self.thin as f64;
        carried.products.ger(thin, &crossed, &turn, 1.0);
        carried.products.ger(thin, &turn, &crossed, 1.0);
        carried.products.ger(thin * missed2, &turn, &turn, 1.0);
        Some(carried)
    }

    /// Sum of squared residuals, of a monitor what is beyond its own error.
    pub fn misfit_m2(&self) -> f64 {
        self.squares_m2 - self.within_m2
    }

    /// Mean square of the fitted rows, metres squared.
    pub fn mean_m2(&self) -> f64 {
        self.misfit_m2() / self.rows.max(1) as f64
    }

    /// These, or, of a plant that is no number any more (a spring that softens without end lets go), those of one that is far off in all
    /// `rows`: it explains nothing, and sums stay numbers.
    fn or_far_off(self, rows: usize) -> Self {
        if self.squares_m2.is_finite() {
            return self;
        }
        Self { squares_m2: RUN_AWAY_M * RUN_AWAY_M * rows as f64, rows, ..Self::of(self.gradient.len()) }
    }
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

/// Which rows sensitivities are taken at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensitivities {
    /// None: squares alone.
    None,
    /// None, but residuals at the rows at which others are taken: thinned or all.
    Carried {
        /// Where the log is thinned.
        thinned: bool,
    },
    /// Some of them, where the log is thinned: for steps, and for leads.
    Thinned,
    /// All: for where a fit ends.
    All,
}

/// Log `index` played at coordinates `z`.
pub(super) fn reader<'a>(bench: &'a Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Reader<'a> {
    let (chain, start) = at(bench, hypothesis, z, index);
    Reader::new(&chain, bench.records[index].log, &start)
}

/// Plant and start of log `index` at `z`.
pub(super) fn at(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize) -> (Chain, Start) {
    let chain = bench.chain_at(hypothesis, z, index);
    let start = bench.start_at(hypothesis, z, index, &chain);
    (chain, start)
}

/// A plant beside another one, in lockstep.
#[expect(clippy::large_enum_variant, reason = "a handful, each made once for a log")]
pub(super) enum Beside<'a> {
    /// Played for itself.
    Played(Reader<'a>),
    /// The same plant as the other one, read by another sensor: what that one saw is all that it takes.
    Read(Reading),
}

impl<'a> Beside<'a> {
    /// `hypothesis` at `z` beside the plant and start `other`.
    pub fn new(
        bench: &Bench<'_>,
        (hypothesis, z): (&Hypothesis, &[f64]),
        index: usize,
        log: &'a Log,
        other: &(Chain, Start),
    ) -> Self {
        let (chain, start) = at(bench, hypothesis, z, index);
        if !chain.sensor.has_own_clock() && start == other.1 && chain.differs_in_reading_only(&other.0) {
            return Self::Read(reading_of(&chain, log));
        }
        Self::Played(Reader::new(&chain, log, &start))
    }

    /// Its next rows, where the other one's were `base` and saw `seen`.
    pub fn predict(&mut self, record: &Record<'_>, base: &[f64], seen: &[(f64, u64)]) -> Vec<f64> {
        match self {
            Self::Played(reader) => predict(record, reader, seen.len()),
            Self::Read(reading) => {
                let read = seen.iter().map(|&(displacement_m, sample)| reading.at_m(displacement_m, sample));
                read.chain(base[seen.len()..].iter().copied()).collect()
            }
        }
    }
}

/// The chain of a log, and one for each of the log's coordinates a small step away, in lockstep.
pub(super) struct Lockstep<'a> {
    record: &'a Record<'a>,
    base: Reader<'a>,
    /// Rows that one row of the sensitivities stands for, and the base as they see it if that is not one.
    thin: usize,
    thinned: Option<Reader<'a>>,
    moved: Vec<(Beside<'a>, f64)>,
}

/// Some rows of a log: what is predicted, what is left, and the derivatives of the prediction.
#[derive(Default)]
pub(super) struct Chunk {
    /// Sum of squared residuals of the fitted rows.
    pub squares_m2: f64,
    /// What of it is the monitor's.
    pub monitor_m2: f64,
    /// Fitted rows.
    pub rows: usize,
    /// Prediction at the rows of the sensitivities; see [`predict`].
    pub base: Vec<f64>,
    /// What the sensor made it of, and the number of that sample; see [`plant_sim::replay::Stream::before_reading`].
    pub seen: Vec<(f64, u64)>,
    /// Derivatives of that by each coordinate.
    pub columns: Vec<Vec<f64>>,
    /// Which of these rows are fitted, ..
    pub places: Vec<usize>,
    /// .. and the sum of the residuals of all rows that each stands for.
    pub residuals_m: Vec<f64>,
}

impl Chunk {
    /// Derivatives at the fitted rows, a column for each coordinate.
    pub fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.places.len(), self.columns.len(), |k, j| self.columns[j][self.places[k]])
    }
}

impl<'a> Lockstep<'a> {
    /// Log `index` at `z`.
    pub fn new(
        bench: &'a Bench<'_>,
        hypothesis: &Hypothesis,
        z: &[f64],
        index: usize,
        sensitivities: Sensitivities,
    ) -> Self {
        let rules = bench.rules(hypothesis);
        let record = &bench.records[index];
        let is_thinned = matches!(sensitivities, Sensitivities::Thinned | Sensitivities::Carried { thinned: true });
        let (thin, log) = match &bench.thinned[index] {
            Some(thinned) if is_thinned => (thinned.factor, &thinned.log),
            _ => (1, record.log),
        };
        let coordinates = match sensitivities {
            Sensitivities::None | Sensitivities::Carried { .. } => Vec::new(),
            _ => bench.coordinates_of(hypothesis, index),
        };
        let here = at(bench, hypothesis, z, index);
        let moved = coordinates.into_iter().map(|place| {
            let step = rules[place].inward_step(z[place]);
            let mut there = z.to_vec();
            there[place] += step;
            (Beside::new(bench, (hypothesis, &there), index, log, &here), step)
        });
        let moved = moved.collect();
        let played = |log| Reader::new(&here.0, log, &here.1);
        let thinned = (thin > 1 && sensitivities == Sensitivities::Thinned).then(|| played(log));
        Self { record, base: played(record.log), thin, thinned, moved }
    }

    /// Rows that one row of the sensitivities stands for.
    pub fn thin(&self) -> usize {
        self.thin
    }

    /// The next `rows` rows, which begin at `from`.
    pub fn next(&mut self, from: usize, rows: usize) -> Chunk {
        let mut seen = Vec::with_capacity(rows);
        let predicted = predict_seeing(self.record, &mut self.base, rows, |made_of| seen.push(made_of));
        let thin_rows = rows / self.thin;
        let mut chunk = Chunk::default();
        let mut sums = vec![0.0; predicted.len() / rows * thin_rows];
        let mut counts = vec![0; sums.len()];
        for (at, residual_m) in residuals(self.record, &predicted, from, rows) {
            chunk.squares_m2 += residual_m * residual_m;
            if at < rows {
                chunk.rows += 1;
            } else {
                chunk.monitor_m2 += residual_m * residual_m;
            }
            let thin_row = at % rows / self.thin;
            if thin_row < thin_rows {
                let place = at / rows * thin_rows + thin_row;
                sums[place] += residual_m;
                counts[place] += 1;
            }
        }
        chunk.places = (0..sums.len()).filter(|place| counts[*place] == self.thin).collect();
        chunk.residuals_m = chunk.places.iter().map(|place| sums[*place]).collect();
        (chunk.base, chunk.seen) = (predicted, seen);
        self.with_columns(chunk, rows)
    }

    /// The next `rows` rows of a log that is thinned, where squares are known already, and `known` is what was kept of these rows.
    fn next_again(&mut self, known: Option<&Kept>, rows: usize) -> Chunk {
        let places = |known: &Kept| (known.places.clone(), known.residuals_m.as_slice().to_vec());
        let (places, residuals_m) = known.map(places).unwrap_or_default();
        self.with_columns(Chunk { places, residuals_m, ..Chunk::default() }, rows)
    }

    /// A chunk of `rows` rows with its derivatives.
    fn with_columns(&mut self, mut chunk: Chunk, rows: usize) -> Chunk {
        if let Some(reader) = &mut self.thinned {
            chunk.seen.clear();
            let seen = &mut chunk.seen;
            chunk.base = predict_seeing(self.record, reader, rows / self.thin, |made_of| seen.push(made_of));
        }
        let (base, seen) = (&chunk.base, &chunk.seen);
        let derivative = |(plant, step): &mut (Beside<'_>, f64)| {
            let mut moved = plant.predict(self.record, base, seen);
            // A plant that runs away a step further tells nothing, and must not make nothing of the others.
            for (moved, p) in moved.iter_mut().zip(base) {
                let slope = (*moved - p) / *step;
                *moved = if slope.is_finite() { slope } else { 0.0 };
            }
            moved
        };
        chunk.columns = self.moved.par_iter_mut().map(derivative).collect();
        chunk
    }
}

/// What is predicted for the next rows: displacement and, where the log has a monitor, the drive behind it, as metres of equal weight.
fn predict(record: &Record<'_>, reader: &mut Reader<'_>, rows: usize) -> Vec<f64> {
    predict_seeing(record, reader, rows, |_| {})
}

/// The same; `see` gets what the sensor made each displacement of.
fn predict_seeing(
    record: &Record<'_>,
    reader: &mut Reader<'_>,
    rows: usize,
    mut see: impl FnMut((f64, u64)),
) -> Vec<f64> {
    let monitor = record.monitor_m_per_v();
    let mut predicted = vec![0.0; if monitor.is_some() { 2 * rows } else { rows }];
    for k in 0..rows {
        predicted[k] = reader.next_m();
        see(reader.stream.before_reading);
        if let Some(m_per_v) = monitor {
            predicted[rows + k] = m_per_v * reader.stream.drive_v;
        }
    }
    predicted
}

/// Places of what was predicted and their residuals, for the rows after `from` that are fitted: neither run-in nor held out.
fn residuals<'a>(
    record: &'a Record<'_>,
    predicted: &'a [f64],
    from: usize,
    rows: usize,
) -> impl Iterator<Item = (usize, f64)> + 'a {
    (0..predicted.len()).filter(move |at| record.fits(from + at % rows)).map(move |at| {
        let row = from + at % rows;
        let monitor = record.log.drive_v.as_ref().zip(record.monitor_m_per_v()).filter(|_| at >= rows);
        let residual_m = match monitor {
            Some((drive_v, m_per_v)) => m_per_v * drive_v[row] - predicted[at],
            None => record.off_lattice_m(record.log.displacement_m[row] - predicted[at]),
        };
        (at, residual_m)
    })
}

/// The sums at `z`. `simulations` counts simulated logs.
pub fn evaluate(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    z: &[f64],
    sensitivities: Sensitivities,
    simulations: &AtomicUsize,
) -> Normal {
    evaluate_again(bench, hypothesis, z, sensitivities, None, simulations)
}

/// The same where `known` may hold the sums without sensitivities ([`Sensitivities::Carried`]) at the same place: logs whose sensitivities are of
/// thinned rows need not be played in all rows again.
pub fn evaluate_again(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    z: &[f64],
    sensitivities: Sensitivities,
    known: Option<&Normal>,
    simulations: &AtomicUsize,
) -> Normal {
    let rows: usize = bench.records.iter().map(|record| record.log.len()).sum();
    let one_log = |index: usize| {
        let mut lockstep = Lockstep::new(bench, hypothesis, z, index, sensitivities);
        let count = lockstep.moved.len();
        simulations.fetch_add(1 + count, Ordering::Relaxed);
        let known = known.map(|known| &known.logs[index]);
        let known = known.filter(|known| lockstep.thinned.is_some() && !known.kept.is_empty());
        let thin = lockstep.thin;
        let mut sums = Sums { thin, ..Sums::of(count) };
        if let Some(known) = known {
            (sums.squares_m2, sums.within_m2, sums.rows) = (known.squares_m2, known.within_m2, known.rows);
        }
        let n = bench.records[index].log.len();
        let keeps = match sensitivities {
            Sensitivities::None => false,
            Sensitivities::Carried { .. } => true,
            Sensitivities::Thinned | Sensitivities::All => rows * count < MOST_KEPT,
        };
        for from in (0..n).step_by(CHUNK) {
            let rows = CHUNK.min(n - from);
            let chunk = match known {
                Some(known) => lockstep.next_again(known.kept.iter().find(|kept| kept.from == from), rows),
                None => lockstep.next(from, rows),
            };
            sums.squares_m2 += chunk.squares_m2;
            sums.within_m2 += chunk.monitor_m2;
            sums.rows += chunk.rows;
            if chunk.places.is_empty() {
                continue;
            }
            let columns = chunk.matrix();
            let residuals_m = DVector::from_vec(chunk.residuals_m);
            if count > 0 {
                sums.products.gemm_tr(thin as f64, &columns, &columns, 1.0);
                sums.gradient.gemv_tr(1.0, &columns, &residuals_m, 1.0);
            }
            if keeps {
                sums.kept.push(Kept { from, places: chunk.places, columns, residuals_m });
            }
        }
        sums.within_m2 = sums.within_m2.min(sums.rows as f64 * bench.records[index].noise_m.powi(2));
        sums.or_far_off(n)
    };
    let logs = (0..bench.records.len()).into_par_iter().map(one_log).collect();
    Normal { logs, shared: bench.shared(hypothesis), own: bench.own(hypothesis) }
}

impl Normal {
    /// Weighted sum of squares of the fitted rows; `weights` are one over the variance, per square metre, one for each log.
    pub fn cost(&self, weights: &[f64]) -> f64 {
        self.logs.iter().zip(weights).map(|(sums, weight)| weight * sums.squares_m2).sum()
    }

    /// The same of what is beyond a monitor's own error: about as much as there are rows where nothing but noise is left.
    pub fn misfit(&self, weights: &[f64]) -> f64 {
        self.logs.iter().zip(weights).map(|(sums, weight)| weight * sums.misfit_m2()).sum()
    }

    /// These sums at a point that lies `change` away, of which `there` has the residuals, with sensitivities that are carried on; `None` if
    /// they were not kept. `units` is what each coordinate is counted in.
    pub fn carried(&self, there: &Self, change: &DVector<f64>, units: &DVector<f64>) -> Option<Self> {
        let of_log = |all: &DVector<f64>, index: usize| {
            let places = (0..self.shared + self.own).map(|i| self.place(index, i));
            DVector::from_iterator(self.shared + self.own, places.map(|place| all[place]))
        };
        let logs = self.logs.iter().zip(&there.logs).enumerate();
        let carried = |(index, (here, there)): (usize, (&Sums, &Sums))| {
            here.carried(there, &of_log(change, index), &of_log(units, index))
        };
        Some(Self { logs: logs.map(carried).collect::<Option<_>>()?, ..*self })
    }

    /// The same without sensitivities to carry on.
    pub fn settled(mut self) -> Self {
        self.logs.iter_mut().for_each(|log| log.kept = Vec::new());
        self
    }

    /// Where coordinate `i` of log `index` stands among all.
    fn place(&self, index: usize, i: usize) -> usize {
        if i < self.shared { i } else { self.shared + index * self.own + i - self.shared }
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
            let place = |i: usize| self.place(index, i);
            for i in 0..sums.products.nrows() {
                gradient[place(i)] += weight * sums.gradient[i];
                for j in 0..sums.products.nrows() {
                    information[(place(i), place(j))] += weight * sums.products[(i, j)];
                }
            }
        }
        (information, gradient)
    }

    /// Fitted rows.
    pub fn rows(&self) -> usize {
        self.logs.iter().map(|log| log.rows).sum()
    }

    /// Rms of the fitted rows of all logs, metres.
    pub fn rms_m(&self) -> f64 {
        (self.logs.iter().map(Sums::misfit_m2).sum::<f64>() / self.rows().max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::hypothesis::Freedom;
    use crate::diagnose::records::record;
    use crate::diagnose::starts::play_log;
    use crate::diagnose::thesis;
    use plant_sim::effects::find_form;

    /// A spring that softens with the cube lets go beyond some displacement, and the plant is no number any more.
    #[test]
    fn a_fit_that_has_run_away_is_far_off() {
        let model = thesis();
        let mut log =
            Log { dt_s: 5e-5, displacement_m: vec![0.0; 4000], command_v: vec![60.0; 4000], ..Log::default() };
        log.displacement_m.iter_mut().enumerate().for_each(|(k, y)| *y = 1e-4 + 1e-8 * (k % 7) as f64);
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let (effect, cubic) = find_form("nonlinear_stiffness", "cubic").expect("a form");
        let hypothesis = Hypothesis::nominal(Freedom::Relaxed).with(effect, cubic, &bench.scales());
        let mut z = bench.origin(&hypothesis);
        bench.set_last(&hypothesis, &mut z, &[f64::MIN]);
        let mut reader = reader(&bench, &hypothesis, &z, 0);
        assert!((0..log.len()).any(|_| !reader.next_m().is_finite()), "the test needs a plant that runs away");
        let normal = evaluate(&bench, &hypothesis, &z, Sensitivities::All, &AtomicUsize::new(0));
        assert_eq!(normal.rms_m(), RUN_AWAY_M);
        // What is played for a reader as well: a miss that is no number would be none.
        let played = play_log(&bench, &hypothesis, &z, 0);
        assert!(played.iter().all(|y| y.abs() <= RUN_AWAY_M) && played.contains(&RUN_AWAY_M));
    }

    /// A monitor that reads what it should has errors far below what it may be off by: they make up for nothing that the displacement is off by.
    #[test]
    fn a_monitor_hides_no_gap() {
        let model = thesis();
        let wave = |k: u32, by: f64| (by * f64::from(k)).sin();
        let mut log = Log {
            dt_s: 5e-5,
            command_v: (0..4000).map(|k| 50.0 * wave(k, 0.013)).collect(),
            displacement_m: vec![0.0; 4000],
            ..Log::default()
        };
        let chain = model.chain();
        let mut reader = Reader::new(&chain, &log, &Start::relaxed(&chain));
        // A gap as loud as the noise, which wanders from row to row.
        let noise_m = |k: u32| 2e-8 * if k.wrapping_mul(2654435761) >> 31 == 0 { 1.0 } else { -1.0 };
        let mut drive_v = Vec::new();
        let mut measured = |k: u32| {
            let displacement_m = reader.next_m() + noise_m(k) + 2.83e-8 * wave(k, 0.005);
            drive_v.push(reader.stream.drive_v);
            displacement_m
        };
        log.displacement_m = (0..4000).map(&mut measured).collect();
        let sums = |log: &Log| {
            let records = vec![Record { noise_m: 2e-8, ..record(log, &chain, None) }];
            let bench = Bench::new(&model, records);
            let hypothesis = Hypothesis::nominal(Freedom::Relaxed);
            let z = bench.origin(&hypothesis);
            let normal = evaluate(&bench, &hypothesis, &z, Sensitivities::None, &AtomicUsize::new(0));
            let noise2 = bench.records[0].noise_m.powi(-2);
            (normal.misfit(&[noise2]) / normal.rows() as f64, normal.rows(), normal.cost(&[noise2]))
        };
        let (chi, rows, cost) = sums(&log);
        assert!((chi - 2.0).abs() < 0.1 && (cost - chi * rows as f64).abs() < 1e-6 * cost, "{chi}");
        log.drive_v = Some(drive_v);
        assert_eq!(sums(&log), (chi, rows, cost));
        // Half a volt of a hundred is two and a half times what the monitor may be off by.
        log.drive_v.iter_mut().flatten().for_each(|v| *v += 0.5);
        let (off, rows_off, cost_off) = sums(&log);
        assert!(rows_off == rows && (off - chi - 5.25).abs() < 0.01 && cost_off > cost, "{off} {chi}");
    }

    /// Sensitivities that are carried on tell of the way back what the simulation tells: residuals here are those there and what the
    /// sensitivities make of the change, and so are their squares.
    #[test]
    fn sensitivities_carried_on_know_the_way_that_was_gone() {
        let model = thesis();
        let log = Log {
            dt_s: 5e-5,
            displacement_m: vec![0.0; 4000],
            command_v: (0..4000).map(|k| 50.0 * (0.013 * f64::from(k)).sin()).collect(),
            ..Log::default()
        };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let hypothesis = Hypothesis::nominal(Freedom::Rest);
        let z = bench.origin(&hypothesis);
        let change = DVector::from_fn(z.len(), |i, _| if i % 2 == 0 { 1.5 } else { -1.0 });
        let to: Vec<f64> = z.iter().zip(change.iter()).map(|(z, change)| z + change).collect();
        let sums = |z: &[f64], sensitivities| evaluate(&bench, &hypothesis, z, sensitivities, &AtomicUsize::new(0));
        for (sensitivities, thinned) in [(Sensitivities::All, false), (Sensitivities::Thinned, true)] {
            let (here, there) = (sums(&z, sensitivities), sums(&to, Sensitivities::Carried { thinned }));
            let units = DVector::from_fn(z.len(), |i, _| 1.0 + i as f64);
            let carried = here.carried(&there, &change, &units).expect("sensitivities that were kept");
            let back2_m2 = |from: &Normal| {
                let Sums { products, gradient, thin, kept, .. } = &from.logs[0];
                let of_rows = kept.iter().map(|kept| kept.residuals_m.norm_squared()).sum::<f64>() / *thin as f64;
                of_rows + 2.0 * gradient.dot(&change) + change.dot(&(products * &change))
            };
            let is = here.logs[0].kept.iter().map(|kept| kept.residuals_m.norm_squared()).sum::<f64>();
            let is_m2 = is / here.logs[0].thin as f64;
            assert!((back2_m2(&carried) / is_m2 - 1.0).abs() < 1e-9, "{} {is_m2}", back2_m2(&carried));
            // The ones from before are off by what the plant bends on the way.
            let stale =
                Normal { logs: vec![Sums { kept: there.logs[0].kept.clone(), ..here.logs[0].clone() }], ..here };
            assert!((back2_m2(&stale) / is_m2 - 1.0).abs() > 1e-5, "{} {is_m2}", back2_m2(&stale));
        }
    }

    /// Squares that are known are not played again, and nothing else differs.
    #[test]
    fn what_is_known_of_a_place_is_taken_over() {
        let model = thesis();
        let mut log = Log {
            dt_s: 5e-5,
            displacement_m: vec![1e-7; 9000],
            command_v: (0..9000).map(|k| 50.0 * (0.013 * f64::from(k)).sin()).collect(),
            ..Log::default()
        };
        log.displacement_m[500] = 2e-7;
        let lost =
            Record { is_lost: (0..9000).map(|row| row % 700 == 0).collect(), ..record(&log, &model.chain(), None) };
        let bench = Bench::new(&model, vec![lost]);
        let hypothesis = Hypothesis::nominal(Freedom::Rest);
        let (z, simulations) = (bench.origin(&hypothesis), AtomicUsize::new(0));
        let sums = |sensitivities| evaluate(&bench, &hypothesis, &z, sensitivities, &simulations);
        let (there, played) = (sums(Sensitivities::Carried { thinned: true }), sums(Sensitivities::Thinned));
        let again = |known| evaluate_again(&bench, &hypothesis, &z, Sensitivities::Thinned, Some(known), &simulations);
        let all = |normal: &Normal| {
            let Sums { products, gradient, squares_m2, within_m2, rows, thin, kept } = normal.logs[0].clone();
            let residuals_m: Vec<DVector<f64>> = kept.into_iter().map(|kept| kept.residuals_m).collect();
            (products, gradient, [squares_m2, within_m2], [rows, thin], residuals_m)
        };
        assert!(bench.thinned[0].is_some() && all(&played).1.norm() > 0.0);
        assert_eq!(all(&again(&there)), all(&played));
        // They are taken over indeed.
        let mut other = there.clone();
        other.logs[0].squares_m2 *= 2.0;
        assert_eq!(again(&other).logs[0].squares_m2, 2.0 * played.logs[0].squares_m2);
    }

    /// What only the sensor makes of a displacement needs no plant of its own, and comes out the same to the last digit.
    #[test]
    fn a_plant_read_by_another_sensor_is_not_played_again() {
        let model = thesis();
        let command_v: Vec<f64> = (0..3000).map(|k| 50.0 * (0.013 * f64::from(k)).sin()).collect();
        let log = Log {
            dt_s: 5e-5,
            displacement_m: command_v.iter().map(|u| 1e-6 * u).collect(),
            command_v,
            ..Log::default()
        };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let nominal = Hypothesis::nominal(Freedom::Rest);
        let z = bench.origin(&nominal);
        let here = at(&bench, &nominal, &z, 0);
        let mut seen = Vec::new();
        let base = predict_seeing(&bench.records[0], &mut Reader::new(&here.0, &log, &here.1), 3000, |made_of| {
            seen.push(made_of)
        });
        let mut read = Vec::new();
        for form in
            plant_sim::effects::REGISTRY.iter().flat_map(|effect| effect.forms().iter().map(move |f| (*effect, f)))
        {
            let (effect, form) = form;
            let hypothesis = nominal.with(effect, form, &bench.scales());
            let mut z = bench.origin(&hypothesis);
            let values: Vec<f64> = hypothesis.installed[0].axes.iter().map(|axis| axis.starts()[0]).collect();
            bench.set_last(&hypothesis, &mut z, &values);
            let mut beside = Beside::new(&bench, (&hypothesis, &z), 0, &log, &here);
            if matches!(beside, Beside::Played(_)) {
                continue;
            }
            let (chain, start) = at(&bench, &hypothesis, &z, 0);
            let played = predict(&bench.records[0], &mut Reader::new(&chain, &log, &start), 3000);
            assert_eq!(beside.predict(&bench.records[0], &base, &seen), played, "{} {}", effect.id(), form.name);
            read.push((effect.id(), form.name));
        }
        for wanted in [("mains_hum", "50 Hz"), ("sensor_drift", "wander"), ("sensor_nonlinearity", "curve")] {
            assert!(read.contains(&wanted), "{wanted:?} is played, though only the sensor knows of it");
        }
    }

    #[test]
    fn a_plant_that_has_run_away_is_far_off_and_finite() {
        let sums = |squares_m2| Sums { squares_m2, rows: 7, products: DMatrix::repeat(2, 2, f64::NAN), ..Sums::of(2) };
        for squares_m2 in [f64::NAN, f64::INFINITY] {
            let far = Normal { logs: vec![sums(squares_m2).or_far_off(10)], shared: 2, own: 0 };
            assert_eq!((far.rms_m(), far.rows()), (RUN_AWAY_M, 10));
            let (information, gradient) = far.assemble(&[1e16]);
            assert!(information.iter().chain(gradient.iter()).all(|v| *v == 0.0));
        }
        let kept = sums(2.0).or_far_off(10);
        assert_eq!((kept.squares_m2, kept.rows), (2.0, 7));
    }
}
