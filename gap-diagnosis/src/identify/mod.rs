//! Grey-box identification: the plant's numbers from logs, with what the logs can and can't say about each.
//!
//! * The mass is fixed: displacement alone determines only ratios to it.
//! * Positive numbers are fitted as bounded logarithms ([`parameters`]) by Levenberg-Marquardt from several starts, in units of
//!   each log's noise, under wide priors around the start; sensitivities come from re-simulation ([`problem`]).
//! * Effects that a stated plant carries stay as they are stated.
//! * A number whose uncertainty after the fit is hardly smaller than before is put back at its prior and said to be unseen.
//! * Uncertainties count independent samples, not samples: they are widened by the residual's correlation time.

pub mod compare;
mod guess;
pub mod parameters;
pub mod problem;
mod report;
mod search;
pub mod tfest;

use crate::residual::{Autocorrelation, aic_bic};
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::model::{Kind, Model};
use plant_sim::replay::{Initial, Start};
use search::{Basis, Session};
use std::fmt;
use std::sync::atomic::AtomicUsize;

/// Most hysterons that `Hysterons::Auto` tries.
const MOST_HYSTERONS: usize = 6;
/// Least rows after a run-in.
const LEAST_ROWS: usize = 16;
/// Share of a held-out log, the run-in left out, that its start and its zero are fitted to.
pub(crate) const START_SHARE: f64 = 0.3;

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
    /// The logs alone, for a linear plant: hysterons without dead zones (`greyest`).
    Linear {
        /// How many of them.
        hysterons: Hysterons,
        /// The weighed mass.
        mass_kg: f64,
    },
    /// The logs alone, for a Bouc-Wen actuator, with or without mechanics (`nlgreyest`).
    BoucWen {
        /// The weighed mass; `None` for static mechanics.
        mass_kg: Option<f64>,
    },
    /// The logs alone, for an actuator with another hysteresis operator.
    Operator {
        /// Which: [`Kind::is_actuator_with_operator`].
        kind: Kind,
        /// The weighed mass.
        mass_kg: f64,
    },
}

/// Where a hysteron is tried at a log's start, in coordinates of [`parameters::StartCoordinates`].
const AWAY: f64 = 1.5;

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
    #[error("{log}: {rows} rows are left after {run_in}; at least 16 are needed: {}", run_in.how_to_shorten())]
    RunInTooLong {
        /// The log.
        log: String,
        /// Rows left.
        rows: usize,
        /// The run-in.
        run_in: RunIn,
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
    #[error("{log}: the displacement falls when the command rises: turn its sign {}", how_to_turn(*.all))]
    Inverted {
        /// The log.
        log: String,
        /// Whether all logs are like it.
        all: bool,
    },
    /// Too little to tell the start and to be scored as well.
    #[error(
        "{log}: {rows} rows are left after the run-in; a held-out log needs 32, of which the first tell how it starts"
    )]
    HeldOutTooShort {
        /// The log.
        log: String,
        /// Rows left.
        rows: usize,
    },
    /// No start led to a finite fit.
    #[error("none of {starts} starts led to a fit: check the units of the logs and the start plant")]
    NoFit {
        /// Starts tried.
        starts: usize,
    },
}

/// A run-in that leaves too little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunIn {
    /// Seconds.
    pub seconds: f64,
    /// Whether the call asks for it, and not the log itself.
    pub is_asked: bool,
}

impl RunIn {
    /// Of so many rows of `log`.
    pub fn new(log: &Log, rows: usize) -> Self {
        Self { seconds: rows as f64 * log.dt_s, is_asked: rows != log.meta.run_in_rows(None, log.dt_s) }
    }

    /// What to do about it.
    pub(crate) fn how_to_shorten(self) -> &'static str {
        if self.is_asked { "shorten --run-in" } else { "give a shorter --run-in" }
    }
}

impl fmt::Display for RunIn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = if self.is_asked || self.seconds == 0.0 { "" } else { " that it states" };
        write!(f, "a run-in of {} s{by}", self.seconds)
    }
}

impl IdentifyError {
    /// So many rows of `log` are simulated and not scored, of `rows` that there are.
    pub fn run_in_too_long(log: &Log, rows: usize, run_in: usize) -> Self {
        Self::RunInTooLong { log: log.name.clone(), rows: rows.saturating_sub(run_in), run_in: RunIn::new(log, run_in) }
    }
}

/// `--scale` is for every log.
fn how_to_turn(all: bool) -> &'static str {
    if all { "with --scale displacement=-1e-6" } else { "in the file, as the other logs go with the command" }
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
    /// Scored rows that count, were they independent.
    pub independent_samples: f64,
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
    /// Akaike's and the Bayesian information criterion of all scored rows as they are: the logs' N ln(RSS/N) + 2p, + p ln of all N.
    pub aic: f64,
    /// See `aic`.
    pub bic: f64,
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
    /// independent samples, of each log the fewer of the two.
    fn beats(&self, other: &Fit) -> bool {
        let both = || self.logs.iter().zip(&other.logs);
        let samples = || both().map(|(a, b)| a.independent_samples.min(b.independent_samples));
        let criterion = |fit: &Fit| {
            let counted: Vec<[f64; 2]> = samples().zip(&fit.logs).map(|(samples, log)| [samples, log.rms_m]).collect();
            aic_bic(&counted, fit.coordinates)[1]
        };
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
    let fit = |nominal: Model, basis: Basis| {
        check_signs(logs, options, &nominal)?;
        let session = Session::new(logs, options, nominal, basis, &simulations, progress);
        session.run().map(|found| report::report(&session, &found))
    };
    let seen: Vec<(&Log, usize)> = logs.iter().map(|log| (log, run_in_rows(log, options))).collect();
    match &options.from {
        From::Plant(model) => fit(model.as_ref().clone(), Basis::Stated),
        From::BoucWen { mass_kg } => {
            let looks = looks(logs, options)?;
            // Its loop is wide enough to hide a damped resonance from a linear scan, so that its numbers are always fitted.
            let model = guess::bouc_wen(&seen, &looks, *mass_kg);
            fit(model, Basis::Guessed { resonance_seen: true })
        }
        From::Operator { kind, mass_kg } => {
            let looks = looks(logs, options)?;
            let model = guess::operator(*kind, &seen, &looks, *mass_kg);
            fit(model, Basis::Guessed { resonance_seen: true })
        }
        From::Logs { hysterons, mass_kg } | From::Linear { hysterons, mass_kg } => {
            let linear = matches!(options.from, From::Linear { .. });
            let looks = looks(logs, options)?;
            let guessed = |n: usize| {
                let (mut model, resonance_seen) = guess::guess(&seen, &looks, n, *mass_kg);
                if linear {
                    guess::without_dead_zones(&mut model);
                }
                fit(model, Basis::Guessed { resonance_seen })
            };
            match hysterons {
                Hysterons::Fixed(n) => guessed(*n),
                Hysterons::Auto => {
                    let mut best = guessed(0)?;
                    for n in 1..=MOST_HYSTERONS {
                        let next = guessed(n)?;
                        if next.beats(&best) {
                            best = next;
                        } else if n > 1 {
                            // One hysteron alone may be no better than none; two are where the thesis begins.
                            break;
                        }
                    }
                    Ok(best)
                }
            }
        }
    }
}

/// What the first log looks like after its run-in.
fn looks(logs: &[Log], options: &Options) -> Result<guess::Looks, IdentifyError> {
    let of = |log: &Log| guess::looks_at_all(log, run_in_rows(log, options));
    let falls = |looks: &guess::Looks| looks.gain_m_per_v < 0.0;
    let looks = of(&logs[0]);
    if falls(&looks) {
        let all = logs.iter().all(|log| falls(&of(log)));
        return Err(IdentifyError::Inverted { log: logs[0].name.clone(), all });
    }
    Ok(looks)
}

/// Logs that go against the plant that their fit would begin with.
fn check_signs(logs: &[Log], options: &Options, nominal: &Model) -> Result<(), IdentifyError> {
    let chain = nominal.chain();
    let is_inverted = |log: &&Log| guess::is_inverted(log, run_in_rows(log, options), &chain);
    let inverted: Vec<&Log> = logs.iter().filter(is_inverted).collect();
    let all = inverted.len() == logs.len();
    inverted.first().map_or(Ok(()), |log| Err(IdentifyError::Inverted { log: log.name.clone(), all }))
}

/// First row of a held-out log of so many rows that is scored.
pub(crate) fn scored_from(rows: usize, run_in: usize) -> usize {
    run_in + ((rows - run_in) as f64 * START_SHARE) as usize
}

fn run_in_rows(log: &Log, options: &Options) -> usize {
    log.meta.run_in_rows(options.run_in_s, log.dt_s)
}

fn check(logs: &[Log], options: &Options) -> Result<(), IdentifyError> {
    if logs.is_empty() {
        return Err(IdentifyError::NoLog);
    }
    for log in logs {
        let run_in = run_in_rows(log, options);
        let rows = log.displacement_m.len();
        if rows < run_in + LEAST_ROWS {
            return Err(IdentifyError::run_in_too_long(log, rows, run_in));
        }
        let constant = |values: &[f64]| values.iter().all(|v| *v == values[0]);
        // A step in the run-in, or at its end, moves what comes after it.
        if constant(&log.command_v) {
            return Err(IdentifyError::NoExcitation { log: log.name.clone() });
        }
        if constant(&log.displacement_m[run_in..]) {
            return Err(IdentifyError::NoResponse { log: log.name.clone() });
        }
    }
    Ok(())
}

/// The start that lets `chain` replay the beginning of a log best, and the offset of the log's sensor if that is free.
///
/// `log` may be the beginning of a longer one.
///
/// # Errors
/// A run-in that leaves nothing.
pub fn fit_start(
    chain: &Chain,
    log: &Log,
    initial: Initial,
    run_in: usize,
    offset_free: bool,
) -> Result<(Start, f64), IdentifyError> {
    if log.displacement_m.len() < run_in + LEAST_ROWS {
        return Err(IdentifyError::run_in_too_long(log, log.displacement_m.len(), run_in));
    }
    let simulations = AtomicUsize::new(0);
    let mut chain = chain.clone();
    if offset_free {
        chain.sensor.offset_m = 0.0;
    }
    let records = [search::record(log, run_in, initial, offset_free)];
    let records = search::shortened(&chain, &records);
    let base = problem::Base { chain, effects: Vec::new() };
    let problem = |z| problem::Problem::new(&records, &[], &base, &simulations, z);
    let found_from = |z| search::descend(problem(z).begun_at_first_row(0), search::COARSE);
    let mut best = found_from(search::origin(&base, &records, &[], &simulations));
    // A hysteron's memory moves nothing until an edge is met: each is tried on either side as well, beside the best of the others.
    for (place, side) in best.places_of_hysterons(0).flat_map(|place| [(place, -AWAY), (place, AWAY)]) {
        if search::at_noise(&records, &best) {
            break;
        }
        let mut z = best.coordinates_now().clone();
        z[place] = side;
        let found = found_from(z);
        if found.cost() < best.cost() {
            best = found;
        }
    }
    let best = search::descend(best, search::FINE);
    let (offset_m, start) = best.own_start(0);
    Ok((start, offset_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What more hysterons explain of a good log is nothing beside what a bad one leaves in any case.
    #[test]
    fn a_bad_log_does_not_drown_what_a_good_one_calls_for() {
        let model = crate::reproduce::Thesis::default().phs;
        let of = |coordinates: usize, rms_m: [f64; 2]| Fit {
            logs: rms_m.map(|rms_m| log(&model, rms_m)).to_vec(),
            model: model.clone(),
            parameters: Vec::new(),
            starts_rms_m: Vec::new(),
            aic: 0.0,
            bic: 0.0,
            coordinates,
            rms_m: ((rms_m[0].powi(2) + rms_m[1].powi(2)) / 2.0).sqrt(),
            simulations: 0,
            seed: 0,
        };
        let (more, fewer) = (of(10, [20e-9, 5e-6]), of(7, [60e-9, 5e-6]));
        assert!(more.beats(&fewer) && !fewer.beats(&more));
        // Three coordinates that explain a thousandth do not pay.
        assert!(of(7, [20e-9, 5e-6]).beats(&of(10, [19.98e-9, 4.995e-6])));
    }

    fn log(model: &Model, rms_m: f64) -> LogFit {
        LogFit {
            name: String::new(),
            predicted_m: Vec::new(),
            run_in_rows: 0,
            rms_m,
            fit_percent: 99.0,
            noise_m: rms_m,
            offset_m: 0.0,
            start: Start::relaxed(&model.chain()),
            autocorrelation: Autocorrelation::of(&[], 0),
            independent_samples: 1000.0,
        }
    }
}
