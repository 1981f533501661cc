//! The search: several starts on shortened logs, the best one polished on all rows, a delay if the logs show one, and numbers that
//! they don't show put back.

use super::parameters::{Free, LawNumber, Quantity, Scale, StartCoordinates};
use super::problem::{Base, Problem, Record, spread_m};
use super::{IdentifyError, Options, Progress, guess, run_in_rows};
use crate::residual::{noise_rms, samples_per_independent};
use levenberg_marquardt::LevenbergMarquardt;
use nalgebra::{DMatrix, DVector};
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::metrics::rms;
use plant_sim::model::Model;
use plant_sim::replay::Initial;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bound of a logarithm around a stated plant, and around a guessed one.
const BOUND_STATED: f64 = 0.75;
const BOUND_GUESSED: f64 = 4.0;
/// Spread of the random starts around a stated plant, and around a guessed one, in logarithms.
const SPREAD_STATED: f64 = 0.3;
const SPREAD_GUESSED: f64 = 0.7;
/// A fit whose residual is below this multiple of the noise is at the noise.
const AT_NOISE: f64 = 1.05;
/// A number is unseen if the logs leave more than this fraction of its prior standard deviation.
pub(super) const UNSEEN: f64 = 0.5;
/// Putting unseen numbers back at their priors may cost this much chi-square; beyond, they are seen together if not one by one.
const UNSEEN_COST: f64 = 4.0;
/// The first descents count residuals in units of at least these fractions of the log's span, one after the other, so that the
/// priors hold them together until the fit is near; at full weight, valleys that are almost flat lead astray.
const ANNEALING: [f64; 2] = [0.1, 0.02];
/// The same for the last of them, after which the residual itself says what it is worth.
const LAST_UNIT: f64 = 0.003;
/// Work of one simulation (rows times moves per row) above which the first descents use only a part of each log.
const CHEAP: usize = 60_000;
/// Least rows a shortened log keeps.
const LEAST_ROWS: usize = 1500;
/// Floor of a log's noise, metres: a noise-free simulation still has rounding.
const LEAST_NOISE_M: f64 = 1e-12;
/// Relative change of cost and coordinates at which a descent ends: among the starts, and for the one that is kept.
pub(super) const COARSE: f64 = 1e-5;
pub(super) const FINE: f64 = 1e-7;
/// Relative change of a residual's unit below which the fit would not move with it.
const SETTLED: f64 = 0.05;
/// Evaluations that a descent may take.
const EVALUATIONS: usize = 60;
/// A delay is added if it lies this many standard deviations from zero.
const DELAY_SIGMAS: f64 = 4.0;
/// What the nominal plant rests on.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Basis {
    /// Somebody states it.
    Stated,
    /// It was guessed from the logs, which may be too slow to show a resonance.
    Guessed { resonance_seen: bool },
}

/// What a search found.
pub(super) struct Found<'a> {
    /// The logs, each with the unit by which its residuals were weighed in the end.
    pub(super) records: Vec<Record<'a>>,
    /// What was fitted.
    pub(super) free: Vec<Free>,
    /// What these logs can't see.
    pub(super) unseen: Vec<Free>,
    /// The coordinates.
    pub(super) z: DVector<f64>,
    /// Their covariance, if it exists.
    pub(super) covariance: Option<DMatrix<f64>>,
    /// Rms at the end of each start, best first, metres.
    pub(super) starts_rms_m: Vec<f64>,
}

/// One fit of one nominal plant to the logs.
pub(super) struct Session<'a> {
    pub(super) logs: &'a [Log],
    pub(super) options: &'a Options,
    pub(super) nominal: Model,
    pub(super) base: Base,
    pub(super) basis: Basis,
    pub(super) simulations: &'a AtomicUsize,
    progress: Progress<'a>,
}

impl<'a> Session<'a> {
    pub(super) fn new(
        logs: &'a [Log],
        options: &'a Options,
        nominal: Model,
        basis: Basis,
        simulations: &'a AtomicUsize,
        progress: Progress<'a>,
    ) -> Self {
        let mut chain = nominal.nominal_chain();
        // The fit sees the ideal sensor; noise and quantisation are what the residual is made of.
        chain.sensor = plant_sim::chain::Sensor::IDEAL;
        let base = Base { chain, effects: nominal.effects.clone() };
        Self { logs, options, nominal, base, basis, simulations, progress }
    }

    fn say(&self, phase: &str) {
        (self.progress)(phase, self.simulations.load(Ordering::Relaxed));
    }

    /// The quantities to be fitted, and those that these logs can't see at all.
    fn free(&self) -> (Vec<Free>, Vec<Free>) {
        let mut chain = self.base.chain.clone();
        let (bound, prior_sigma) = match self.basis {
            Basis::Stated => (BOUND_STATED, BOUND_STATED),
            Basis::Guessed { .. } => (BOUND_GUESSED, BOUND_GUESSED / 2.0),
        };
        let free_of = |quantity: Quantity| {
            let prior = *quantity.number(&mut chain);
            if quantity == Quantity::Law(LawNumber::Gamma) {
                // Of either sign, and of beta's size.
                let unit = prior.abs().max(*Quantity::Law(LawNumber::Beta).number(&mut chain));
                return Free { quantity, prior, scale: Scale::Shift { unit }, prior_sigma };
            }
            Free { quantity, prior, scale: Scale::Log { bound }, prior_sigma }
        };
        let mut free: Vec<Free> = Quantity::of(&self.nominal)
            .into_iter()
            .map(free_of)
            // A number that is exactly zero (no damping, no dead zone) states a structure, not a guess.
            .filter(|free| free.prior > 0.0 || matches!(free.scale, Scale::Shift { .. }))
            .collect();
        if chain.drive.delay_s > 0.0 {
            free.push(self.delay());
        }
        // Without a resonance in the logs only alpha/k shows, and damping not at all.
        let hidden = |f: &Free| {
            self.basis == Basis::Guessed { resonance_seen: false }
                && matches!(f.quantity, Quantity::Stiffness | Quantity::Damping)
        };
        free.into_iter().partition(|f| !hidden(f))
    }

    fn delay(&self) -> Free {
        Free {
            quantity: Quantity::Delay,
            prior: self.base.chain.drive.delay_s,
            scale: Scale::NotNegative { unit: self.logs[0].dt_s },
            prior_sigma: 10.0,
        }
    }

    fn records(&self) -> Vec<Record<'a>> {
        self.logs.iter().map(|log| record(log, run_in_rows(log, self.options), self.options.initial, true)).collect()
    }

    pub(super) fn run(&self) -> Result<Found<'a>, IdentifyError> {
        let records = self.records();
        let short = shortened(&self.base.chain, &records);
        let (free, hidden) = self.free();
        let starts = self.options.starts.max(1);
        let hysterons = self.base.chain.plant.hysterons.len();
        // The plant has the sign and size of the line at least; offsets come from it.
        let origin = origin(&self.base, &short, &free, self.simulations);
        let mut random = Pcg64::seed_from_u64(self.options.seed);
        let spread = if self.basis == Basis::Stated { SPREAD_STATED } else { SPREAD_GUESSED };
        let mut ends: Vec<Problem<'_>> = Vec::new();
        for start in 0..starts {
            self.say(&format!("{hysterons} hysterons, start {} of {starts}", start + 1));
            let mut z = origin.clone();
            if start > 0 {
                for coordinate in z.iter_mut().take(free.len()) {
                    *coordinate += random.random_range(-spread..spread);
                }
            }
            let end = self.anneal(&short, &free, z);
            if !at_noise(&short, &end) && self.options.initial != Initial::Relaxed {
                // A start state that an early step got wrong holds the rest in a near miss: try again from where it began.
                let mut z = end.coordinates_now().clone();
                let own = free.len()..z.len();
                z.rows_range_mut(own.clone()).copy_from(&origin.rows_range(own));
                ends.push(self.anneal(&short, &free, z));
            }
            ends.push(end);
            if ends.iter().rev().take(2).any(|end| at_noise(&short, end)) {
                break;
            }
        }
        ends.retain(|p| p.cost().is_finite());
        ends.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        let starts_rms_m: Vec<f64> = ends.iter().map(|p| rms((0..short.len()).flat_map(|i| p.residual_m(i)))).collect();
        let Some(best) = ends.first() else {
            return Err(IdentifyError::NoFit { starts });
        };
        self.say(&format!("{hysterons} hysterons, polishing"));
        let mut z = best.coordinates_now().clone();
        let mut problem = Problem::new(&records, &free, &self.base, self.simulations, z.clone());
        drop(ends);
        // What one independent sample is uncertain by is known once the fit is near; twice, where the fit moves with it.
        let mut weighed = weigh(&records, &problem);
        for _ in 0..2 {
            problem = descend(Problem::new(&weighed, &free, &self.base, self.simulations, z), FINE);
            z = problem.coordinates_now().clone();
            let again = weigh(&weighed, &problem);
            let settled = weighed.iter().zip(&again).all(|(a, b)| (a.unit_m / b.unit_m - 1.0).abs() < SETTLED);
            weighed = again;
            if settled {
                break;
            }
        }
        let records = weighed;
        let problem = Problem::new(&records, &free, &self.base, self.simulations, z);
        if !free.iter().any(|f| f.quantity == Quantity::Delay)
            && let Some(z) = self.with_delay(&records, &free, problem.coordinates_now())
        {
            self.say(&format!("{hysterons} hysterons, with a delay"));
            let mut delayed = free.clone();
            delayed.push(self.delay());
            let found = descend(Problem::new(&records, &delayed, &self.base, self.simulations, z), FINE);
            if found.cost() + DELAY_SIGMAS * DELAY_SIGMAS < problem.cost() {
                let weighed = weigh(&records, &found);
                let z = found.coordinates_now().clone();
                let problem = descend(Problem::new(&weighed, &delayed, &self.base, self.simulations, z), FINE);
                let (free, unseen, z, covariance) = self.without_unseen(&weighed, &problem, delayed.clone(), hidden);
                return Ok(Found { records: weighed, free, unseen, z, covariance, starts_rms_m });
            }
        }
        let (free, unseen, z, covariance) = self.without_unseen(&records, &problem, free.clone(), hidden);
        Ok(Found { records, free, unseen, z, covariance, starts_rms_m })
    }

    /// Descends at falling units, the last the records' own.
    fn anneal<'p>(&'p self, records: &'p [Record<'a>], free: &'p [Free], mut z: DVector<f64>) -> Problem<'p> {
        for fraction in ANNEALING {
            let at = |r: &Record<'a>| Record { unit_m: r.noise_m.max(fraction * spread_m(r)), ..r.clone() };
            let softened: Vec<Record<'a>> = records.iter().map(at).collect();
            let problem = descend(Problem::new(&softened, free, &self.base, self.simulations, z), COARSE);
            z = problem.coordinates_now().clone();
        }
        descend(Problem::new(records, free, &self.base, self.simulations, z), COARSE)
    }

    /// Coordinates with a delay, if its linear estimate, with every other coordinate free to move, lies well above zero.
    fn with_delay(&self, records: &[Record<'_>], free: &[Free], z: &DVector<f64>) -> Option<DVector<f64>> {
        let mut free = free.to_vec();
        let at = free.len();
        free.push(self.delay());
        // A thousandth of a sample, because at zero the delay is at its bound and has no gradient to one side.
        let problem = Problem::new(records, &free, &self.base, self.simulations, z.clone().insert_row(at, 1e-3));
        let sensitivities = problem.sensitivities();
        let covariance = covariance_of(&problem, &sensitivities)?;
        let prior = problem.coordinates_now().component_div(&problem.prior_sigma().map(|s| s * s));
        let step = -(&covariance * (sensitivities.tr_mul(&problem.data_residuals()) + prior));
        (step[at] > DELAY_SIGMAS * covariance[(at, at)].sqrt()).then(|| problem.coordinates_now() + step)
    }

    /// Puts numbers that the logs can't see back at their priors and refits the rest: what is fitted, what is unseen, coordinates
    /// and their covariance.
    fn without_unseen(
        &self,
        records: &[Record<'_>],
        problem: &Problem<'_>,
        free: Vec<Free>,
        hidden: Vec<Free>,
    ) -> (Vec<Free>, Vec<Free>, DVector<f64>, Option<DMatrix<f64>>) {
        let z = problem.coordinates_now();
        let known = covariance(problem);
        if let Some(covariance) = &known {
            let dim = |i: usize, reach: f64| {
                let sigma = covariance[(i, i)].sqrt();
                i < free.len() && sigma > UNSEEN * free[i].prior_sigma && z[i].abs() < reach * sigma
            };
            // What has moved away from its prior by more than it is uncertain was moved by the logs, if only along with others.
            // If even the rest can't go back together (a hysteron would open that the logs keep shut), what never moved can.
            for reach in [2.0, 0.05] {
                let (dims, lit): (Vec<usize>, Vec<usize>) = (0..z.len()).partition(|&i| dim(i, reach));
                if dims.is_empty() {
                    break;
                }
                self.say("putting unseen numbers back");
                let pick =
                    |indices: &[usize]| indices.iter().filter_map(|&i| free.get(i).copied()).collect::<Vec<Free>>();
                let seen = pick(&lit);
                let z = with_set_to_zero(covariance, z, &dims, &lit);
                let refitted = descend(Problem::new(records, &seen, &self.base, self.simulations, z), FINE);
                if refitted.data_cost() - problem.data_cost() < UNSEEN_COST {
                    let unseen: Vec<Free> = hidden.iter().copied().chain(pick(&dims)).collect();
                    let z = refitted.coordinates_now().clone();
                    let covariance = self::covariance(&refitted);
                    return (seen, unseen, z, covariance);
                }
            }
        }
        let z = z.clone();
        (free, hidden, z, known)
    }
}

/// A log as a fit sees it first: its noise, and what its rows say of its start.
pub(super) fn record(log: &Log, run_in: usize, initial: Initial, offset_free: bool) -> Record<'_> {
    let u = &log.command_v;
    let (low, high) = u.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    // Before a log that starts with a step the drive was something else than its first command: the first displacement tells,
    // up to the offset, which the line through the log gives.
    let looks = guess::looks(log, run_in);
    let drive_v = (log.displacement_m[0] - looks.offset_m) / looks.gain_m_per_v;
    let noise_m = noise_rms(&log.displacement_m[run_in..]).max(LEAST_NOISE_M);
    let start = StartCoordinates {
        initial,
        drive_v: if drive_v.is_finite() { drive_v.clamp(low.min(0.0), high.max(0.0)) } else { u[0] },
        span_v: (high - low).max(1e-3),
    };
    let mut record = Record { log, run_in, rows: u.len(), noise_m, unit_m: noise_m, start, offset_free };
    record.unit_m = noise_m.max(LAST_UNIT * spread_m(&record));
    record
}

/// Records cut so that one simulation of all of them is cheap.
pub(super) fn shortened<'a>(chain: &Chain, records: &[Record<'a>]) -> Vec<Record<'a>> {
    let turning_per_s = (chain.plant.stiffness_n_per_m / chain.plant.mass_kg).sqrt();
    let work: usize = records.iter().map(|r| r.rows * (1 + (r.log.dt_s * turning_per_s) as usize)).sum();
    let share = CHEAP as f64 / work as f64;
    let cut = |record: &Record<'a>| {
        let scored = (((record.rows - record.run_in) as f64 * share) as usize).max(LEAST_ROWS);
        let from = guess::moves_from(record.log, record.run_in);
        Record { rows: record.rows.min(from + scored), ..record.clone() }
    };
    if share < 1.0 { records.iter().map(cut).collect() } else { records.to_vec() }
}

/// Coordinates of the first start: the prior, and for each log with a free offset the mean residual there.
pub(super) fn origin(base: &Base, records: &[Record<'_>], free: &[Free], simulations: &AtomicUsize) -> DVector<f64> {
    let mut z = DVector::zeros(Problem::coordinates(records, free, base.hysterons()));
    let problem = Problem::new(records, free, base, simulations, z.clone());
    for (index, record) in records.iter().enumerate().filter(|(_, r)| r.offset_free) {
        let residual_m = problem.residual_m(index);
        problem.set_offset(&mut z, index, -residual_m.iter().sum::<f64>() / (record.rows - record.run_in) as f64);
    }
    z
}

pub(super) fn descend(problem: Problem<'_>, tolerance: f64) -> Problem<'_> {
    // The library multiplies its patience by one more than the coordinates.
    let patience = (EVALUATIONS / (problem.coordinates_now().len() + 1)).max(1);
    let fit =
        LevenbergMarquardt::new().with_ftol(tolerance).with_xtol(tolerance).with_gtol(1e-10).with_patience(patience);
    fit.minimize(problem).0
}

/// Whether nothing but noise is left: no other start could do better.
pub(super) fn at_noise(records: &[Record<'_>], problem: &Problem<'_>) -> bool {
    records.iter().enumerate().all(|(i, record)| rms(problem.residual_m(i)) < AT_NOISE * record.noise_m)
}

/// Records whose unit is what an independent sample of their present residual is uncertain by, but at least what rounding leaves.
fn weigh<'a>(records: &[Record<'a>], problem: &Problem<'_>) -> Vec<Record<'a>> {
    let weighed = |(index, record): (usize, &Record<'a>)| {
        let residual_m = problem.residual_m(index);
        let unit_m = rms(residual_m.iter().copied()) * samples_per_independent(&residual_m).sqrt();
        Record { unit_m: unit_m.max(LEAST_NOISE_M), ..record.clone() }
    };
    records.iter().enumerate().map(weighed).collect()
}

/// Covariance of the coordinates: the logs' information plus the priors'.
fn covariance(problem: &Problem<'_>) -> Option<DMatrix<f64>> {
    covariance_of(problem, &problem.sensitivities())
}

fn covariance_of(problem: &Problem<'_>, sensitivities: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut information = sensitivities.tr_mul(sensitivities);
    for (i, sigma) in problem.prior_sigma().iter().enumerate() {
        information[(i, i)] += 1.0 / (sigma * sigma);
    }
    information.cholesky().map(|c| c.inverse())
}

/// The coordinates `kept` of `z` once those in `zeroed` are zero, to first order: what their covariance carries along.
fn with_set_to_zero(covariance: &DMatrix<f64>, z: &DVector<f64>, zeroed: &[usize], kept: &[usize]) -> DVector<f64> {
    let block = |rows: &[usize]| DMatrix::from_fn(rows.len(), zeroed.len(), |i, j| covariance[(rows[i], zeroed[j])]);
    let back = DVector::from_fn(zeroed.len(), |i, _| -z[zeroed[i]]);
    let along = block(zeroed).cholesky().map_or(DVector::zeros(kept.len()), |c| block(kept) * c.solve(&back));
    DVector::from_fn(kept.len(), |i, _| z[kept[i]]) + along
}
