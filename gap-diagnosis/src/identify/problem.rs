//! The least-squares problem: residuals of all logs in units of their uncertainty, priors, and sensitivities by re-simulation.

use super::parameters::{Free, StartCoordinates};
use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::model::EffectSection;
use plant_sim::replay::{Initial, Start, predict};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Step of the coordinates for sensitivities. The simulator is exact to about 1e-13 of full scale, so a step of 1e-6 leaves
/// seven digits of a sensitivity of order one, more than the curvature of the model does.
const STEP: f64 = 1e-6;

/// One log as the fit sees it.
#[derive(Clone, Debug)]
pub struct Record<'a> {
    /// The log.
    pub log: &'a Log,
    /// Rows at the start that are simulated but not scored.
    pub run_in: usize,
    /// Rows that are used at all.
    pub rows: usize,
    /// Rms of its noise in metres.
    pub noise_m: f64,
    /// Unit of its residuals in metres: what one independent sample is uncertain by.
    pub unit_m: f64,
    /// Its start.
    pub start: StartCoordinates,
    /// Whether its offset is fitted, or stays the chain's.
    pub offset_free: bool,
}

impl Record<'_> {
    fn scored(&self) -> usize {
        self.rows - self.run_in
    }
}

/// The chain whose numbers are fitted, and the effects that stay as they are stated, on top of it.
///
/// Effects are put in anew at every point, because some of their parts are stated relative to the plant.
#[derive(Clone, Debug)]
pub struct Base {
    /// The chain without the effects.
    pub chain: Chain,
    /// The effects.
    pub effects: Vec<EffectSection>,
}

impl Base {
    /// The whole chain, its free numbers at coordinates `z`.
    pub fn at(&self, free: &[Free], z: &[f64]) -> Chain {
        let mut chain = self.chain.clone();
        for (free, &z) in free.iter().zip(z) {
            *free.quantity.number(&mut chain) = free.at(z);
        }
        self.effects.iter().for_each(|effect| effect.install(&mut chain));
        chain
    }

    /// Hysterons of the whole chain.
    pub fn hysterons(&self) -> usize {
        self.at(&[], &[]).plant.hysterons.len()
    }
}

/// Coordinates: the free quantities, then for each log its offset (in its unit-free span) and its start.
#[derive(Clone)]
pub struct Problem<'a> {
    records: &'a [Record<'a>],
    free: &'a [Free],
    base: &'a Base,
    /// Hysterons of the whole chain.
    hysterons: usize,
    simulations: &'a AtomicUsize,
    offset_unit_m: f64,
    z: DVector<f64>,
    /// Predictions at `z` in the records' units, scored rows of all logs.
    scaled: Vec<f64>,
    residuals: DVector<f64>,
}

impl<'a> Problem<'a> {
    /// A problem at coordinates `z`; `simulations` counts simulated logs, for progress.
    pub fn new(
        records: &'a [Record<'a>],
        free: &'a [Free],
        base: &'a Base,
        simulations: &'a AtomicUsize,
        z: DVector<f64>,
    ) -> Self {
        let offset_unit_m = records.iter().map(|r| spread_m(r)).fold(0.0, f64::max);
        let mut problem = Self {
            records,
            free,
            base,
            hysterons: base.hysterons(),
            simulations,
            offset_unit_m,
            z: z.clone(),
            scaled: Vec::new(),
            residuals: DVector::zeros(0),
        };
        problem.set_params(&z);
        problem
    }

    /// Coordinates in all.
    pub fn coordinates(records: &[Record<'_>], free: &[Free], hysterons: usize) -> usize {
        free.len() + records.iter().map(|r| 1 + r.start.count(hysterons)).sum::<usize>()
    }

    /// The chain at coordinates `z`.
    pub fn chain(&self, z: &DVector<f64>) -> Chain {
        self.base.at(self.free, z.as_slice())
    }

    /// Where the coordinates of log `index` begin.
    fn own(&self, index: usize) -> usize {
        self.free.len() + self.records[..index].iter().map(|r| 1 + r.start.count(self.hysterons)).sum::<usize>()
    }

    /// The present coordinates.
    pub fn coordinates_now(&self) -> &DVector<f64> {
        &self.z
    }

    /// Coordinate of the offset of log `index`.
    pub fn offset_place(&self, index: usize) -> usize {
        self.own(index)
    }

    /// One unit of an offset's coordinate, metres.
    pub fn offset_unit_m(&self) -> f64 {
        self.offset_unit_m
    }

    /// Moves the offset of log `index` in `z` by `offset_m`.
    pub fn set_offset(&self, z: &mut DVector<f64>, index: usize, offset_m: f64) {
        z[self.own(index)] += offset_m / self.offset_unit_m;
    }

    /// The same with a start of log `index` that is free moved to where the first row reads it, hysterons as they are.
    pub fn begun_at_first_row(mut self, index: usize) -> Self {
        let record = &self.records[index];
        if record.start.initial != Initial::Fit {
            return self;
        }
        let (place, mut z) = (self.places_of_hysterons(index).end, self.z.clone());
        z[place] = 0.0;
        let chain = self.chain(&z);
        let sensor = &chain.sensor;
        let offset_m = sensor.offset_m + self.offset_unit_m * z[self.own(index)];
        let displacement_m = (record.log.displacement_m[0] - offset_m) / sensor.gain;
        let equilibrium_m = record.start.at(&chain, &z.as_slice()[self.own(index) + 1..]).state.displacement_m;
        z[place] = (displacement_m - equilibrium_m) / record.start.travel_m(&chain);
        self.set_params(&z);
        self
    }

    /// Residuals of the data rows in the records' units.
    pub fn data_residuals(&self) -> DVector<f64> {
        self.residuals.rows(0, self.data_rows()).into_owned()
    }

    /// Offset in metres and start of log `index` at the present coordinates.
    pub fn own_start(&self, index: usize) -> (f64, Start) {
        let chain = self.chain(&self.z);
        let at = self.own(index);
        (self.offset_unit_m * self.z[at], self.records[index].start.at(&chain, &self.z.as_slice()[at + 1..]))
    }

    /// Coordinates of the hysterons' voltages at the start of log `index`.
    pub fn places_of_hysterons(&self, index: usize) -> std::ops::Range<usize> {
        let from = self.own(index) + 2;
        from..from + self.records[index].start.count(self.hysterons).min(self.hysterons)
    }

    /// Prediction of log `index` at `z` in metres, its offset included.
    pub fn prediction_m(&self, index: usize, z: &DVector<f64>) -> Vec<f64> {
        self.simulations.fetch_add(1, Ordering::Relaxed);
        let record = &self.records[index];
        let chain = self.chain(z);
        let at = self.own(index);
        let start = record.start.at(&chain, &z.as_slice()[at + 1..]);
        let offset_m = self.offset_unit_m * z[at];
        let mut predicted = predict(&chain, record.log, &start, record.rows);
        predicted.iter_mut().for_each(|p| *p += offset_m);
        predicted
    }

    /// Prediction of the scored rows of log `index` in its unit.
    fn scaled_log(&self, index: usize, z: &DVector<f64>) -> Vec<f64> {
        let record = &self.records[index];
        self.prediction_m(index, z)[record.run_in..].iter().map(|p| p / record.unit_m).collect()
    }

    /// Scored rows of log `index` within the rows of all logs.
    fn rows_of(&self, index: usize) -> std::ops::Range<usize> {
        let from: usize = self.records[..index].iter().map(Record::scored).sum();
        from..from + self.records[index].scored()
    }

    /// Change of all scaled predictions when coordinate `j` moves by `step`; a log's own coordinates move no other log.
    fn moved(&self, j: usize, step: f64) -> Vec<f64> {
        let mut change = vec![0.0; self.data_rows()];
        let mut z = self.z.clone();
        z[j] += step;
        for index in 0..self.records.len() {
            let own = self.own(index)..self.own(index + 1);
            if j >= self.free.len() && !own.contains(&j) {
                continue;
            }
            let rows = self.rows_of(index);
            if j == own.start {
                // The offset is known without simulating.
                change[rows].fill(step * self.offset_unit_m / self.records[index].unit_m);
            } else {
                let moved = self.scaled_log(index, &z);
                for ((change, moved), at) in change[rows.clone()].iter_mut().zip(moved).zip(&self.scaled[rows]) {
                    *change = moved - at;
                }
            }
        }
        change
    }

    /// Scored rows of all logs.
    pub fn data_rows(&self) -> usize {
        self.records.iter().map(Record::scored).sum()
    }

    /// Predicted minus measured in metres for log `index`, scored rows only.
    pub fn residual_m(&self, index: usize) -> Vec<f64> {
        let unit_m = self.records[index].unit_m;
        self.residuals.as_slice()[self.rows_of(index)].iter().map(|r| r * unit_m).collect()
    }

    /// Sum of squares of the data rows, in the records' units.
    pub fn data_cost(&self) -> f64 {
        self.residuals.rows(0, self.data_rows()).norm_squared()
    }

    /// Sum of squares of everything.
    pub fn cost(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Data rows of the sensitivities: the records' units per coordinate, one column after the other.
    fn sensitivity_columns(&self) -> Vec<Vec<f64>> {
        let column = |j| {
            let mut column = self.moved(j, STEP);
            column.iter_mut().for_each(|c| *c /= STEP);
            column
        };
        (0..self.z.len()).into_par_iter().map(column).collect()
    }

    /// The same as a matrix.
    pub fn sensitivities(&self) -> DMatrix<f64> {
        DMatrix::from_vec(self.data_rows(), self.z.len(), self.sensitivity_columns().concat())
    }

    /// Standard deviation of every coordinate under the prior.
    pub fn prior_sigma(&self) -> DVector<f64> {
        // A start at rest can lie anywhere in its range, and an offset anywhere in several spans: one and ten units.
        let mut sigma: Vec<f64> = self.free.iter().map(|f| f.prior_sigma).collect();
        for record in self.records {
            sigma.push(if record.offset_free { 10.0 } else { 1e-9 });
            sigma.extend(vec![1.0; record.start.count(self.hysterons)]);
        }
        DVector::from_vec(sigma)
    }
}

/// Spread of the scored measurement in metres.
pub(super) fn spread_m(record: &Record<'_>) -> f64 {
    let y = &record.log.displacement_m[record.run_in..record.rows];
    let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    (high - low).max(1e-9)
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, z: &DVector<f64>) {
        self.z.copy_from(z);
        self.scaled = (0..self.records.len()).flat_map(|index| self.scaled_log(index, z)).collect();
        let measured = self
            .records
            .iter()
            .flat_map(|record| record.log.displacement_m[record.run_in..record.rows].iter().map(|y| y / record.unit_m));
        let prior = self.z.component_div(&self.prior_sigma());
        let residuals = self.scaled.iter().zip(measured).map(|(p, y)| p - y).chain(prior.iter().copied()).collect();
        self.residuals = DVector::from_vec(residuals);
    }

    fn params(&self) -> DVector<f64> {
        self.z.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.residuals.iter().all(|r| r.is_finite()).then(|| self.residuals.clone())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let count = self.z.len();
        let prior = self.prior_sigma();
        let mut columns = self.sensitivity_columns();
        for (j, column) in columns.iter_mut().enumerate() {
            column.extend((0..count).map(|i| if i == j { 1.0 / prior[i] } else { 0.0 }));
        }
        let jacobian = DMatrix::from_vec(self.data_rows() + count, count, columns.concat());
        jacobian.iter().all(|v| v.is_finite()).then_some(jacobian)
    }
}
