//! Diagnosis: where a nominal plant and its bench differ, which effect makes the difference, and how far it shrinks.
//!
//! The course, one file each: what the logs say before any fit ([`records`]), what is fitted ([`mod@bench`], [`hypothesis`]), normal equations in chunks
//! ([`normal`]), the annealed descent ([`descend`]), the nominal plant refitted (`refit`), the score test over the registry ([`screen`])
//! and where its shapes promise most (`refine`), full fits ([`search`], in the order of `fits`), what only scatter tells ([`spread`], and
//! `octaves`: whether it is noise) and what that hides (`hidden`), periods over place ([`cycles`]), which commands and readings were lost
//! (`events`), what only priors decide ([`symmetry`]) and which of it is sure (`directions`), what explains a gap ([`explanation`]),
//! probabilities ([`evidence`]), and the order of it all ([`judge`]).
//! Then the answer: the verdict, the plant with the effects in, the gap before and after on rows that no fit saw, what stays (`zeros`: mostly
//! a constant), and what to measure next ([`Diagnosis`]), and the page about it ([`report`]).
//!
//! What it does not do: read or write files, or name the nearest entry where none fits: then the verdict is `unknown`, or a class.

mod answer;
mod augment;
pub mod bench;
mod closed_loop;
pub mod cycles;
pub mod descend;
mod directions;
mod error;
mod events;
pub mod evidence;
pub mod explanation;
mod fits;
mod gap;
mod hidden;
pub mod hypothesis;
pub mod judge;
pub mod lines;
mod next;
pub mod normal;
mod octaves;
mod plants;
mod random;
pub mod records;
mod refine;
mod refit;
pub mod report;
pub mod screen;
pub mod search;
pub mod spread;
mod starts;
pub mod symmetry;
mod usual;
mod verdict;
mod zeros;

pub use answer::{BestFit, Diagnosis, Evidence, LogEvidence, Rival, SCHEMA, Unexplained};
pub use augment::{Changed, Estimate};
pub use closed_loop::{ClosedLoop, Loop};
pub use error::DiagnoseError;
pub use gap::{Gap, ShareOf};
pub use judge::Say;
pub use next::NextExperiment;
pub(crate) use verdict::leading;
pub use verdict::{Class, Ranked, Verdict};

use bench::Bench;
use events::{Losses, Lost};
use hypothesis::Freedom;
use plant_sim::effects;
use plant_sim::log::Log;
use plant_sim::model::Model;
use plant_sim::replay::Initial;
use search::Search;
use std::cell::OnceCell;
use std::sync::atomic::AtomicUsize;

/// Rounds of looking for what was lost.
const LOSS_ROUNDS: usize = 3;

/// What to assume.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Of each log's first row.
    pub initial: Initial,
    /// Seconds at each log's start that are simulated, neither fitted nor scored; a log's own `run_in_s` where `None`.
    pub run_in_s: Option<f64>,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Entries to strike out of the registry: what would be said if nobody had thought of them?
    pub without: Vec<String>,
    /// A loop whose tracking error is to be predicted with the nominal and with the diagnosed plant.
    pub predict: Option<Loop>,
}

/// Diagnoses the gap between `plant` and `logs`; `held_out` logs are never fitted, save their starts, and make the headline.
///
/// `progress` is told what is going on and which share of the work lies behind.
///
/// # Errors
/// See [`DiagnoseError`].
pub fn diagnose(
    plant: &Model,
    logs: &[Log],
    held_out: &[Log],
    options: &Options,
    progress: Say<'_>,
) -> Result<Diagnosis, DiagnoseError> {
    if logs.is_empty() {
        return Err(DiagnoseError::NoLog);
    }
    for id in &options.without {
        if effects::find(id).is_none() && id != "parameter_error" {
            return Err(DiagnoseError::NoSuchEntry { id: id.clone(), nearest: effects::nearest(id) });
        }
    }
    if let Some(wanted) = &options.predict {
        // A loop that can't run is refused before the work.
        closed_loop::predict(wanted, plant, plant, &logs[0])?;
    }
    let run_in = |log: &Log| log.meta.run_in_rows(options.run_in_s, log.dt_s);
    error::check_rows(logs, &run_in)?;
    error::check_rows(held_out, &run_in)?;
    let chain = plant.chain();
    let are_losses_known = !options.without.iter().any(|id| id == "lost_samples");
    let records = |logs| -> Vec<bench::Record<'_>> {
        let logs: &[Log] = logs;
        let record = |log| records::record(log, &chain, options.run_in_s);
        let record = |log| if held_out.is_empty() { record(log) } else { record(log).whole() };
        let mut records: Vec<_> = logs.iter().map(record).collect();
        if !are_losses_known {
            // If nobody had thought of lost rows, they would be readings like others.
            records.iter_mut().for_each(|record| record.is_lost = Vec::new());
        }
        records
    };
    let arrived: [OnceCell<Vec<Log>>; LOSS_ROUNDS] = Default::default();
    let mut bench = Bench::new(plant, records(logs));
    error::check_plant(&bench, true)?;
    let mut benches = plants::Benches::new(plant, bench.records.clone(), held_out, options.run_in_s);
    if let Some(held) = &benches.held {
        error::check_plant(held, false)?;
    }
    let freedom = match options.initial {
        Initial::Relaxed => Freedom::Relaxed,
        Initial::Rest => Freedom::Rest,
        Initial::Fit => Freedom::Any,
    };
    let simulations = AtomicUsize::new(0);
    let without: Vec<&str> = options.without.iter().map(String::as_str).collect();
    let mut search = Search { bench: &bench, simulations: &simulations };
    let mut course = judge::course(&search, freedom, &without, progress);
    let mut warnings = error::warnings(logs, held_out);
    let mut losses: Option<Losses> = None;
    let whole = course.refit.chi - 1.0;
    for arrived in &arrived {
        let more = if are_losses_known && course.has_gap() { events::losses(&search, &course) } else { None };
        let Some(more) = more.filter(|more| losses.as_ref().is_none_or(|known| known.lost == more.lost)) else { break };
        // What never arrived is no matter of the plant: everything again with the commands that did, or without the readings that stayed. A
        // fit without the first that were found shows others.
        let all = match losses.take() {
            Some(known) => known.and(more),
            None => more,
        };
        let known = losses.insert(all);
        let records = match known.lost {
            Lost::Commands => records(arrived.get_or_init(|| known.logs(logs))),
            Lost::Readings => {
                let mut records = records(logs);
                records.iter_mut().zip(&known.is_lost).for_each(|(record, lost)| record.is_lost.clone_from(lost));
                records
            }
        };
        bench = Bench::new(plant, records);
        benches = benches.with_fitted(plant, bench.records.clone());
        search = Search { bench: &bench, simulations: &simulations };
        course = judge::course(&search, freedom, &without, progress);
    }
    if let Some(losses) = &losses {
        course.stays_of(whole);
        if benches.held.is_none() && losses.lost == Lost::Commands {
            warnings.push(
                "commands that never arrived were read off all rows of these logs, those too that no fit saw: with --held-out the gap is that of rows \
                 which nothing has looked at"
                    .to_owned(),
            );
        }
    }
    let mut found = answer::answer(&search, &course, &benches, options, losses.as_ref(), warnings, progress);
    if let Some(wanted) = &options.predict {
        let (closed_loop, warnings) = closed_loop::predict(wanted, plant, &found.augmented, &logs[0])?;
        found.closed_loop = Some(closed_loop);
        found.warnings.extend(warnings);
    }
    Ok(found)
}

/// The thesis' plant, on which tests of the parts rest.
#[cfg(test)]
fn thesis() -> Model {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    Model::read(&path).expect("the thesis' plant")
}
