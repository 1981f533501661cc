//! Grey-box identification: the plant's numbers from logs, with what the logs can and can't say about each.
//!
//! * The mass is fixed: displacement alone determines only ratios to it.
//! * Positive numbers are fitted as bounded logarithms ([`parameters`]) by Levenberg-Marquardt from several starts, in units of
//!   each log's noise, under wide priors around the start; sensitivities come from re-simulation ([`problem`]).
//! * A number whose uncertainty after the fit is hardly smaller than before is put back at its prior and said to be unseen.
//! * Uncertainties count independent samples, not samples: they are widened by the residual's correlation time.

mod guess;
pub mod parameters;
pub mod problem;

use crate::residual::{Autocorrelation, LAGS, noise_rms, samples_per_independent};
use levenberg_marquardt::LevenbergMarquardt;
use nalgebra::{DMatrix, DVector};
use parameters::{Free, Quantity, Scale, StartCoordinates};
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::metrics::{Score, rms};
use plant_sim::model::Model;
use plant_sim::param::Param;
use plant_sim::replay::{Initial, Start};
use problem::{Problem, Record, spread_m};
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
const UNSEEN: f64 = 0.5;
/// Putting unseen numbers back at their priors may cost this much chi-square; beyond, they are seen together if not one by one.
const UNSEEN_COST: f64 = 4.0;
/// The first descents count residuals in units of at least this fraction of the log's span, so that the priors hold them together
/// until the fit is near; at full weight, valleys that are almost flat lead astray.
const FIRST_UNIT: f64 = 0.003;
/// Work of one simulation (rows times moves per row) above which the first descents use only a part of each log.
const CHEAP: usize = 60_000;
/// Least rows a shortened log keeps.
const LEAST_ROWS: usize = 1500;
/// Floor of a log's noise, metres: a noise-free simulation still has rounding.
const LEAST_NOISE_M: f64 = 1e-12;
/// Relative change of cost and coordinates at which a descent ends: among the starts, and for the one that is kept.
const COARSE: f64 = 1e-5;
const FINE: f64 = 1e-7;
/// Evaluations that a descent may take.
const EVALUATIONS: usize = 60;
/// A delay is added if it lies this many standard deviations from zero.
const DELAY_SIGMAS: f64 = 4.0;
/// Most hysterons that `Hysterons::Auto` tries.
const MOST_HYSTERONS: usize = 6;

/// Where the fit starts and what its priors are centred on.
#[derive(Clone, Debug)]
pub enum From {
    /// A plant somebody states.
    Plant(Box<Model>),
    /// The logs alone.
    Logs {
        /// How many hysterons.
        hysterons: Hysterons,
        /// The weighed mass.
        mass_kg: f64,
    },
}

/// Number of hysterons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hysterons {
    /// This many.
    Fixed(usize),
    /// As many as lower the Bayesian information criterion, counted in independent samples.
    Auto,
}

/// What to do.
#[derive(Clone, Debug)]
pub struct Options {
    /// Start.
    pub from: From,
    /// What is assumed of each log's first row.
    pub initial: Initial,
    /// Seconds at each log's start that are simulated but not scored; a log's own `run_in_s` where `None`.
    pub run_in_s: Option<f64>,
    /// Starts of the multistart, at least one.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
}

/// Why logs can't be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// No log.
    #[error("no log to identify from")]
    NoLog,
    /// Too little left after the run-in.
    #[error("{log}: {rows} rows are left after a run-in of {run_in_s} s; at least 16 are needed: shorten --run-in")]
    RunInTooLong {
        /// The log.
        log: String,
        /// Rows left.
        rows: usize,
        /// Run-in asked for.
        run_in_s: f64,
    },
    /// The command doesn't move.
    #[error("{log}: the command never changes, so nothing can be identified from it: drive it with steps or sines")]
    NoExcitation {
        /// The log.
        log: String,
    },
    /// The displacement doesn't move.
    #[error("{log}: the displacement never changes: check the sensor's column")]
    NoResponse {
        /// The log.
        log: String,
    },
    /// Displacement falls while the command rises.
    #[error("{log}: the displacement falls when the command rises: turn its sign with --scale displacement=-1e-6")]
    Inverted {
        /// The log.
        log: String,
    },
    /// No start led to a finite fit.
    #[error("none of {starts} starts led to a fit: check the units of the logs and the start plant")]
    NoFit {
        /// Starts tried.
        starts: usize,
    },
}

/// What became of a number.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Fitted.
    Fitted,
    /// These logs can't see it; it stays at its prior.
    Unseen,
    /// It ran into its bound: the start was too far off, or the model is wrong.
    AtBound,
    /// Given, never fitted.
    Given,
}

/// A number of the fitted plant.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Name with unit, as in the model file.
    pub name: String,
    /// The same in words, and the unit as a reader writes it.
    pub words: (String, &'static str),
    /// Value in that unit.
    pub value: f64,
    /// Standard deviation in that unit.
    pub sigma: f64,
    /// Value before the fit, in that unit.
    pub prior: f64,
    /// What became of it.
    pub verdict: Verdict,
    /// The same in words, with the reason.
    pub note: String,
}

/// How one log is fitted.
#[derive(Clone, Debug)]
pub struct LogFit {
    /// Name of the log.
    pub name: String,
    /// Prediction for every row, its offset included, metres.
    pub predicted_m: Vec<f64>,
    /// Rows that are not scored.
    pub run_in_rows: usize,
    /// Rms of measured minus predicted, metres.
    pub rms_m: f64,
    /// Fit percent.
    pub fit_percent: f64,
    /// Rms of the log's noise, estimated from its differences, metres.
    pub noise_m: f64,
    /// Reading at zero displacement, metres.
    pub offset_m: f64,
    /// State at the first row.
    pub start: Start,
    /// Autocorrelation of the residual.
    pub autocorrelation: Autocorrelation,
}

/// A fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The fitted plant, ready to be written.
    pub model: Model,
    /// Its numbers.
    pub parameters: Vec<Fitted>,
    /// Its logs.
    pub logs: Vec<LogFit>,
    /// Rms over all logs at the end of each start, metres, best first.
    pub starts_rms_m: Vec<f64>,
    /// Akaike's and the Bayesian information criterion of all scored rows as they are: N ln(RSS/N) + 2p, + p ln N.
    pub aic: f64,
    /// See `aic`.
    pub bic: f64,
    /// Scored rows that count, were they independent.
    pub independent_samples: f64,
    /// Coordinates fitted, the logs' offsets and starts included.
    pub coordinates: usize,
    /// Rms over all logs, metres.
    pub rms_m: f64,
    /// Logs simulated on the way.
    pub simulations: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Fit {
    /// Whether the logs prefer this fit to `other` although it may have more coordinates: the Bayesian criterion, counted in
    /// independent samples, the fewer of the two.
    fn beats(&self, other: &Fit) -> bool {
        let samples = self.independent_samples.min(other.independent_samples);
        let criterion = |fit: &Fit| samples * 2.0 * fit.rms_m.ln() + fit.coordinates as f64 * samples.ln();
        criterion(self) < criterion(other)
    }
}

/// What a long fit tells while it runs: a phase in words, and the simulations so far.
pub type Progress<'a> = &'a (dyn Fn(&str, usize) + Sync);

/// Fits a plant to logs.
///
/// # Errors
/// See [`IdentifyError`].
pub fn identify(logs: &[Log], options: &Options, progress: Progress<'_>) -> Result<Fit, IdentifyError> {
    check(logs, options)?;
    let simulations = AtomicUsize::new(0);
    let fit = |nominal: Model, basis: Basis| Session::new(logs, options, nominal, basis, &simulations, progress).run();
    match &options.from {
        From::Plant(model) => fit(model.as_ref().clone(), Basis::Stated),
        From::Logs { hysterons, mass_kg } => {
            let run_in = run_in_rows(&logs[0], options);
            let looks = guess::looks(&logs[0], run_in);
            if looks.gain_m_per_v < 0.0 {
                return Err(IdentifyError::Inverted { log: logs[0].name.clone() });
            }
            let guessed = |n: usize| {
                let (model, resonance_seen) = guess::guess(&logs[0], run_in, &looks, n, *mass_kg);
                fit(model, Basis::Guessed { resonance_seen })
            };
            match hysterons {
                Hysterons::Fixed(n) => guessed(*n),
                Hysterons::Auto => {
                    let mut best = guessed(0)?;
                    let mut worse_in_a_row = 0;
                    for n in 1..=MOST_HYSTERONS {
                        let next = guessed(n)?;
                        if next.beats(&best) {
                            best = next;
                            worse_in_a_row = 0;
                        } else {
                            worse_in_a_row += 1;
                            // One hysteron alone may be no better than none; two are where the thesis begins.
                            if n > 1 || worse_in_a_row == 2 {
                                break;
                            }
                        }
                    }
                    Ok(best)
                }
            }
        }
    }
}

fn run_in_rows(log: &Log, options: &Options) -> usize {
    let run_in_s = options.run_in_s.or(log.meta.run_in_s).unwrap_or(0.0);
    (run_in_s / log.dt_s).round().max(0.0) as usize
}

fn check(logs: &[Log], options: &Options) -> Result<(), IdentifyError> {
    if logs.is_empty() {
        return Err(IdentifyError::NoLog);
    }
    for log in logs {
        let run_in = run_in_rows(log, options);
        let rows = log.displacement_m.len();
        if rows < run_in + 16 {
            return Err(IdentifyError::RunInTooLong {
                log: log.name.clone(),
                rows: rows.saturating_sub(run_in),
                run_in_s: run_in as f64 * log.dt_s,
            });
        }
        let constant = |values: &[f64]| values.iter().all(|v| *v == values[0]);
        if constant(&log.command_v[run_in..]) && constant(&log.command_v[..run_in.max(1)]) {
            return Err(IdentifyError::NoExcitation { log: log.name.clone() });
        }
        if constant(&log.displacement_m[run_in..]) {
            return Err(IdentifyError::NoResponse { log: log.name.clone() });
        }
    }
    Ok(())
}

/// What the nominal plant rests on.
#[derive(Clone, Copy, PartialEq)]
enum Basis {
    /// Somebody states it.
    Stated,
    /// It was guessed from the logs, which may be too slow to show a resonance.
    Guessed { resonance_seen: bool },
}

/// One fit of one nominal plant to the logs.
struct Session<'a> {
    logs: &'a [Log],
    options: &'a Options,
    nominal: Model,
    chain: Chain,
    basis: Basis,
    simulations: &'a AtomicUsize,
    progress: Progress<'a>,
}

impl<'a> Session<'a> {
    fn new(
        logs: &'a [Log],
        options: &'a Options,
        nominal: Model,
        basis: Basis,
        simulations: &'a AtomicUsize,
        progress: Progress<'a>,
    ) -> Self {
        let mut chain = nominal.chain();
        // The fit sees the ideal sensor; noise and quantisation are what the residual is made of.
        chain.sensor = plant_sim::chain::Sensor::IDEAL;
        Self { logs, options, nominal, chain, basis, simulations, progress }
    }

    fn say(&self, phase: &str) {
        (self.progress)(phase, self.simulations.load(Ordering::Relaxed));
    }

    /// The quantities to be fitted, and those that these logs can't see at all.
    fn free(&self) -> (Vec<Free>, Vec<Free>) {
        let mut chain = self.chain.clone();
        let (bound, prior_sigma) = match self.basis {
            Basis::Stated => (BOUND_STATED, BOUND_STATED),
            Basis::Guessed { .. } => (BOUND_GUESSED, BOUND_GUESSED / 2.0),
        };
        let mut free: Vec<Free> = Quantity::of(&self.nominal)
            .into_iter()
            .map(|quantity| Free {
                quantity,
                prior: *quantity.number(&mut chain),
                scale: Scale::Log { bound },
                prior_sigma,
            })
            // A number that is exactly zero (no damping, no dead zone) states a structure, not a guess.
            .filter(|free| free.prior > 0.0)
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
            prior: self.chain.drive.delay_s,
            scale: Scale::NotNegative { unit: self.logs[0].dt_s },
            prior_sigma: 10.0,
        }
    }

    fn records(&self) -> Vec<Record<'a>> {
        self.logs.iter().map(|log| record(log, run_in_rows(log, self.options), self.options.initial, true)).collect()
    }

    fn run(&self) -> Result<Fit, IdentifyError> {
        let records = self.records();
        let short = shortened(&self.chain, &records);
        let (free, hidden) = self.free();
        let starts = self.options.starts.max(1);
        let hysterons = self.chain.plant.hysterons.len();
        // The plant has the sign and size of the line at least; offsets come from it.
        let origin = origin(&self.chain, &short, &free, self.simulations);
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
            let end = descend(Problem::new(&short, &free, &self.chain, self.simulations, z), COARSE);
            if !at_noise(&short, &end) {
                // A start state that an early step got wrong holds the rest in a near miss: try again from where it began.
                let mut z = end.coordinates_now().clone();
                let own = free.len()..z.len();
                z.rows_range_mut(own.clone()).copy_from(&origin.rows_range(own));
                ends.push(descend(Problem::new(&short, &free, &self.chain, self.simulations, z), COARSE));
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
        let mut problem = Problem::new(&records, &free, &self.chain, self.simulations, z.clone());
        drop(ends);
        // What one independent sample is uncertain by is known once the fit is near; twice, because the fit moves with it.
        let weighed = weigh(&records, &problem);
        problem = descend(Problem::new(&weighed, &free, &self.chain, self.simulations, z.clone()), FINE);
        let records = weigh(&weighed, &problem);
        z = problem.coordinates_now().clone();
        let problem = descend(Problem::new(&records, &free, &self.chain, self.simulations, z), FINE);
        if !free.iter().any(|f| f.quantity == Quantity::Delay)
            && let Some(z) = self.with_delay(&records, &free, problem.coordinates_now())
        {
            self.say(&format!("{hysterons} hysterons, with a delay"));
            let mut delayed = free.clone();
            delayed.push(self.delay());
            let found = descend(Problem::new(&records, &delayed, &self.chain, self.simulations, z), FINE);
            if found.cost() + DELAY_SIGMAS * DELAY_SIGMAS < problem.cost() {
                let weighed = weigh(&records, &found);
                let z = found.coordinates_now().clone();
                let problem = descend(Problem::new(&weighed, &delayed, &self.chain, self.simulations, z), FINE);
                return Ok(self.finish(&weighed, problem, &delayed, hidden, starts_rms_m));
            }
        }
        Ok(self.finish(&records, problem, &free, hidden, starts_rms_m))
    }

    /// Coordinates with a delay, if its linear estimate, with every other coordinate free to move, lies well above zero.
    fn with_delay(&self, records: &[Record<'_>], free: &[Free], z: &DVector<f64>) -> Option<DVector<f64>> {
        let mut free = free.to_vec();
        let at = free.len();
        free.push(self.delay());
        // A thousandth of a sample, because at zero the delay is at its bound and has no gradient to one side.
        let problem = Problem::new(records, &free, &self.chain, self.simulations, z.clone().insert_row(at, 1e-3));
        let covariance = covariance(&problem)?;
        let sensitivities = problem.sensitivities();
        let prior = problem.coordinates_now().component_div(&problem.prior_sigma().map(|s| s * s));
        let step = -(&covariance * (sensitivities.tr_mul(&problem.data_residuals()) + prior));
        (step[at] > DELAY_SIGMAS * covariance[(at, at)].sqrt()).then(|| problem.coordinates_now() + step)
    }

    /// Puts numbers that the logs can't see back at their priors, refits the rest, and reports.
    fn finish(
        &self,
        records: &[Record<'_>],
        problem: Problem<'_>,
        free: &[Free],
        hidden: Vec<Free>,
        starts_rms_m: Vec<f64>,
    ) -> Fit {
        let z = problem.coordinates_now();
        if let Some(covariance) = covariance(&problem) {
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
                let z = with_set_to_zero(&covariance, z, &dims, &lit);
                let refitted = descend(Problem::new(records, &seen, &self.chain, self.simulations, z), FINE);
                if refitted.data_cost() - problem.data_cost() < UNSEEN_COST {
                    let unseen: Vec<Free> = hidden.iter().copied().chain(pick(&dims)).collect();
                    return self.report(records, &refitted, &seen, &unseen, starts_rms_m);
                }
            }
        }
        self.report(records, &problem, free, &hidden, starts_rms_m)
    }

    fn report(
        &self,
        records: &[Record<'_>],
        problem: &Problem<'_>,
        free: &[Free],
        unseen: &[Free],
        starts_rms_m: Vec<f64>,
    ) -> Fit {
        let z = problem.coordinates_now();
        let covariance = covariance(problem);
        let fitted_chain = problem.chain(z);
        let logs: Vec<LogFit> = (0..records.len()).map(|index| log_fit(&records[index], problem, index)).collect();
        let reach_v = largest_hysteron_voltages(records, problem, &fitted_chain);
        let mut model = self.nominal.clone();
        let names: Vec<&str> = self.logs.iter().map(|l| l.name.as_str()).collect();
        let source = format!("identified from {}", names.join(", "));
        let mut parameters = vec![Fitted {
            name: "mass_kg".into(),
            words: ("mass".into(), "kg"),
            value: self.chain.plant.mass_kg,
            sigma: self.chain.plant.mass_kg * model.structure.mass_kg.relative_sigma(),
            prior: self.chain.plant.mass_kg,
            verdict: Verdict::Given,
            note: "given; displacement alone determines only ratios to the mass".into(),
        }];
        for (i, free) in free.iter().enumerate() {
            let coordinate_sigma = covariance.as_ref().map_or(f64::NAN, |c| c[(i, i)].sqrt());
            let (value, per_si) = (free.at(z[i]), free.quantity.per_si());
            let number_sigma = free.number_sigma(z[i], coordinate_sigma);
            let record = free.quantity.record(&mut model);
            let sigma = match free.scale {
                Scale::Log { .. } => {
                    *record = Param::new(value * per_si, number_sigma, &source);
                    number_sigma * value * per_si
                }
                Scale::NotNegative { .. } => {
                    *record = Param::absolute(value * per_si, number_sigma * per_si, &source);
                    number_sigma * per_si
                }
            };
            let at_bound = free.at_bound(z[i]);
            let dim = coordinate_sigma > UNSEEN * free.prior_sigma;
            parameters.push(Fitted {
                name: free.quantity.name(),
                words: free.quantity.words(),
                value: value * per_si,
                sigma,
                prior: free.prior * per_si,
                verdict: if at_bound { Verdict::AtBound } else { Verdict::Fitted },
                note: match (at_bound, dim) {
                    (true, _) => "at its bound: start nearer to it (--plant), or the model lacks an effect".into(),
                    (false, true) => "fitted together with others; by itself these logs hardly see it".into(),
                    (false, false) => "fitted".into(),
                },
            });
        }
        for free in unseen {
            let per_si = free.quantity.per_si();
            parameters.push(Fitted {
                name: free.quantity.name(),
                words: free.quantity.words(),
                value: free.prior * per_si,
                sigma: match free.scale {
                    Scale::Log { .. } => free.prior * per_si * free.prior_sigma,
                    Scale::NotNegative { unit } => free.prior_sigma * unit * per_si,
                },
                prior: free.prior * per_si,
                verdict: Verdict::Unseen,
                note: why_unseen(free.quantity, &fitted_chain, &reach_v),
            });
            let record = free.quantity.record(&mut model);
            record.source = format!("not seen by {}; {}", names.join(", "), record.source);
            // What nobody has seen is as uncertain as its prior, whatever a guess may have assumed.
            record.sigma = record.sigma.map(|sigma| sigma.max(free.prior_sigma));
        }
        let order: Vec<String> = std::iter::once("mass_kg".into())
            .chain(Quantity::of(&self.nominal).into_iter().map(Quantity::name))
            .collect();
        parameters.sort_by_key(|p| order.iter().position(|name| *name == p.name).unwrap_or(usize::MAX));

        let offset_m = logs.iter().map(|l| l.offset_m).sum::<f64>() / logs.len() as f64;
        model.sensor.offset_um = Some(Param::absolute(offset_m * 1e6, logs[0].noise_m * 1e6, &source));
        model.sensor.noise_um = Some(Param::new(logs[0].noise_m * 1e6, 0.1, &source));
        let rows = problem.data_rows() as f64;
        let count = z.len() as f64;
        let residual_m: Vec<f64> = (0..records.len()).flat_map(|i| problem.residual_m(i)).collect();
        let log_mean_square = 2.0 * rms(residual_m.iter().copied()).ln();
        let independent: f64 = (0..records.len())
            .map(|i| problem.residual_m(i))
            .map(|residual| residual.len() as f64 / samples_per_independent(&residual))
            .sum();
        Fit {
            model,
            parameters,
            logs,
            starts_rms_m,
            aic: rows * log_mean_square + 2.0 * count,
            bic: rows * log_mean_square + count * rows.ln(),
            independent_samples: independent,
            coordinates: z.len(),
            rms_m: rms(residual_m),
            simulations: self.simulations.load(Ordering::Relaxed),
            seed: self.options.seed,
        }
    }
}

/// A log as a fit sees it first: its noise, and what its rows say of its start.
fn record(log: &Log, run_in: usize, initial: Initial, offset_free: bool) -> Record<'_> {
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
    record.unit_m = noise_m.max(FIRST_UNIT * spread_m(&record));
    record
}

/// Records cut so that one simulation of all of them is cheap.
fn shortened<'a>(chain: &Chain, records: &[Record<'a>]) -> Vec<Record<'a>> {
    let turning_per_s = (chain.plant.stiffness_n_per_m / chain.plant.mass_kg).sqrt();
    let work: usize = records.iter().map(|r| r.rows * (1 + (r.log.dt_s * turning_per_s) as usize)).sum();
    let share = CHEAP as f64 / work as f64;
    let cut = |record: &Record<'a>| {
        let scored = (((record.rows - record.run_in) as f64 * share) as usize).max(LEAST_ROWS);
        Record { rows: record.rows.min(record.run_in + scored), ..record.clone() }
    };
    if share < 1.0 { records.iter().map(cut).collect() } else { records.to_vec() }
}

/// Coordinates of the first start: the prior, and for each log with a free offset the mean residual there.
fn origin(chain: &Chain, records: &[Record<'_>], free: &[Free], simulations: &AtomicUsize) -> DVector<f64> {
    let hysterons = chain.plant.hysterons.len();
    let mut z = DVector::zeros(Problem::coordinates(records, free, hysterons));
    let problem = Problem::new(records, free, chain, simulations, z.clone());
    for (index, record) in records.iter().enumerate().filter(|(_, r)| r.offset_free) {
        let residual_m = problem.residual_m(index);
        problem.set_offset(&mut z, index, -residual_m.iter().sum::<f64>() / (record.rows - record.run_in) as f64);
    }
    z
}

fn descend(problem: Problem<'_>, tolerance: f64) -> Problem<'_> {
    // The library multiplies its patience by one more than the coordinates.
    let patience = (EVALUATIONS / (problem.coordinates_now().len() + 1)).max(1);
    let fit =
        LevenbergMarquardt::new().with_ftol(tolerance).with_xtol(tolerance).with_gtol(1e-10).with_patience(patience);
    fit.minimize(problem).0
}

/// The start that lets `chain` replay the beginning of a log best, and the offset of the log's sensor if that is free.
///
/// `log` may be the beginning of a longer one.
///
/// # Errors
/// A run-in that leaves nothing, or a log that doesn't move.
pub fn fit_start(
    chain: &Chain,
    log: &Log,
    initial: Initial,
    run_in: usize,
    offset_free: bool,
) -> Result<(Start, f64), IdentifyError> {
    if log.displacement_m.len() < run_in + 16 {
        let run_in_s = run_in as f64 * log.dt_s;
        let rows = log.displacement_m.len().saturating_sub(run_in);
        return Err(IdentifyError::RunInTooLong { log: log.name.clone(), rows, run_in_s });
    }
    let simulations = AtomicUsize::new(0);
    let mut chain = chain.clone();
    if offset_free {
        chain.sensor.offset_m = 0.0;
    }
    let records = [record(log, run_in, initial, offset_free)];
    let records = shortened(&chain, &records);
    let z = origin(&chain, &records, &[], &simulations);
    let problem = descend(Problem::new(&records, &[], &chain, &simulations, z), FINE);
    let (offset_m, start) = problem.own_start(0);
    Ok((start, offset_m))
}

/// Whether nothing but noise is left: no other start could do better.
fn at_noise(records: &[Record<'_>], problem: &Problem<'_>) -> bool {
    records.iter().enumerate().all(|(i, record)| rms(problem.residual_m(i)) < AT_NOISE * record.noise_m)
}

/// Records whose unit is what an independent sample of their present residual is uncertain by, but at least their noise.
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
    let sensitivities = problem.sensitivities();
    let mut information = sensitivities.tr_mul(&sensitivities);
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

fn log_fit(record: &Record<'_>, problem: &Problem<'_>, index: usize) -> LogFit {
    let predicted_m = problem.prediction_m(index, problem.coordinates_now());
    let mut score = Score::default();
    for (y, p) in record.log.displacement_m.iter().zip(&predicted_m).skip(record.run_in) {
        score.add(*y, *p);
    }
    let (offset_m, start) = problem.own_start(index);
    LogFit {
        name: record.log.name.clone(),
        predicted_m,
        run_in_rows: record.run_in,
        rms_m: score.rms_m(false),
        fit_percent: score.fit_percent(false),
        noise_m: record.noise_m,
        offset_m,
        start,
        autocorrelation: Autocorrelation::of(&problem.residual_m(index), LAGS),
    }
}

/// Largest voltage that each hysteron reaches in any log: whether its dead zone ever opens.
fn largest_hysteron_voltages(records: &[Record<'_>], problem: &Problem<'_>, chain: &Chain) -> Vec<f64> {
    let mut largest = vec![0.0f64; chain.plant.hysterons.len()];
    for (index, record) in records.iter().enumerate() {
        let (_, start) = problem.own_start(index);
        let log = record.log;
        let mut player = plant_sim::replay::Player::new(chain, log.dt_s, log.meta.latency_s, log.meta.hold, &start);
        for (k, &u) in log.command_v.iter().enumerate() {
            let next = log.command_v.get(k + 1).copied().unwrap_or(u);
            player.row(u, next, log.force_n.as_ref().map_or(0.0, |f| f[k]));
            for (largest, v) in largest.iter_mut().zip(player.hysteron_v()) {
                *largest = largest.max(v.abs());
            }
        }
    }
    largest
}

fn why_unseen(quantity: Quantity, chain: &Chain, reach_v: &[f64]) -> String {
    let kept = "these logs can't see it; kept at its prior";
    if matches!(quantity, Quantity::Stiffness | Quantity::Damping) {
        return format!("{kept}: they show no resonance, so only alpha/k is theirs to say");
    }
    let (Quantity::DeadZone(i) | Quantity::Slope(i)) = quantity else { return kept.into() };
    let (hysteron, reach_v) = (&chain.plant.hysterons[i], reach_v[i]);
    if reach_v < hysteron.edge_v() {
        return format!(
            "{kept}: hysteron {} reaches {reach_v:.2} V and never opens at {:.2} V; drive it further",
            i + 1,
            hysteron.edge_v()
        );
    }
    match quantity {
        Quantity::Slope(_) => format!(
            "{kept}: once open, hysteron {} follows within {:.1e} s, faster than the logs resolve",
            i + 1,
            hysteron.capacitance_f / hysteron.slope_s
        ),
        _ => kept.into(),
    }
}
