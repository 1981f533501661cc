//! Experiments on disk, one after the other in one run directory. Whatever ends the program, what is there can be read.
//!
//! | file | what | written |
//! | --- | --- | --- |
//! | `run.json` | board, firmware, rate, seed, experiments with what the board is set to, hashes: what a repetition needs | before the first sample |
//! | `plant.toml`, `controller-NAME`, `reference-NAME` | files that were read, byte for byte | before the first sample |
//! | `log.csv`, or `NN-NAME.csv` where there are several | an experiment each, as the converters had it | row by row; handed over every 256 rows or half a second |
//! | `link.json` | the link's statistics, and of every log its rows, losses and end | every second, and behind every experiment |

use crate::experiments::Experiment;
use crate::link::Place;
use crate::lockstep::{Outcome, Ready, Row};
use crate::run_directory::{
    Growing, RunError, STATE, check_place, file_json, meta, parameters_json, unwritable, write, write_json,
};
use crate::session::Board;
use crate::statistics::Statistics;
use plant_sim::log::Column;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;
use wire::Parameters;

/// Most rows of a recording: an hour at 20 kHz.
pub const MOST_ROWS: usize = 72_000_000;

/// Columns of a log. Only a monitor that is wired reads a drive: in process there is no amplifier, and without one an infinite tolerance says so.
fn columns(is_closed_loop: bool, place: &Place, parameters: &Parameters) -> Vec<Column> {
    let is_watched = *place != Place::InProcess && parameters.monitor_tolerance_v.is_finite();
    [
        Some(Column::Time),
        Some(Column::Command),
        Some(Column::Displacement),
        is_closed_loop.then_some(Column::Reference),
        is_watched.then_some(Column::Drive),
        Some(Column::LimitedBy),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// What a recording is made from. Files are names and contents.
#[derive(Clone, Debug)]
pub struct Facts<'a> {
    /// Where the board is.
    pub place: &'a Place,
    /// Who it is.
    pub board: &'a Board,
    /// The flash image of a virtual board.
    pub image: Option<(&'a str, &'a [u8])>,
    /// The plant, if one was given.
    pub plant: Option<(&'a str, &'a [u8])>,
    /// The controllers.
    pub controllers: &'a [(String, Vec<u8>)],
    /// Files that SPECs play.
    pub reference_files: &'a [(String, Vec<u8>)],
    /// What is recorded.
    pub experiments: &'a [Experiment],
    /// Length of each, in samples.
    pub samples: &'a [usize],
    /// What the board is set to in each.
    pub parameters: &'a [Parameters],
    /// Name of the set that they are, if they are one.
    pub set: Option<&'a str>,
    /// What is played before each, a SPEC.
    pub before: Option<&'a str>,
    /// Samples per second.
    pub rate_hz: f64,
    /// Seed of a simulated sensor's noise and of faults made on purpose.
    pub seed: u64,
    /// Faults of the link, made on purpose.
    pub link_faults: Option<&'a str>,
}

/// A recording that is being written.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    rate_hz: f64,
    logs: Vec<Log>,
    stated_at: Duration,
}

/// A log of it.
#[derive(Debug)]
struct Log {
    name: String,
    growing: Option<Growing>,
    columns: Vec<Column>,
    said: Value,
}

impl Log {
    /// How it stands.
    fn state(&self) -> Value {
        match &self.growing {
            Some(growing) => json!({ "rows": growing.rows, "lost_samples": growing.lost, "is_complete": false }),
            None => self.said.clone(),
        }
    }
}

impl Recording {
    /// Makes `path`, which must be empty or not there, and writes what is known before the first sample.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn create(path: &Path, facts: &Facts<'_>) -> Result<Recording, RunError> {
        check_place(path)?;
        std::fs::create_dir_all(path).map_err(unwritable(path))?;
        if let Some((_, content)) = facts.plant {
            write(&path.join("plant.toml"), content)?;
        }
        for (prefix, files) in [("controller", facts.controllers), ("reference", facts.reference_files)] {
            for (name, content) in files {
                write(&path.join(format!("{prefix}-{name}")), content)?;
            }
        }
        let names = log_names(facts.experiments);
        write(&path.join("run.json"), format!("{:#}\n", run_json(facts, &names)).as_bytes())?;
        let log =
            |name| Log { name, growing: None, columns: Vec::new(), said: json!({ "rows": 0, "is_complete": false }) };
        Ok(Recording {
            path: path.to_owned(),
            rate_hz: facts.rate_hz,
            logs: names.into_iter().map(log).collect(),
            stated_at: Duration::ZERO,
        })
    }

    /// Names of the logs, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.logs.iter().map(|log| log.name.as_str())
    }

    /// Begins the log of experiment `index`.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn begin(&mut self, index: usize, ready: &Ready, facts: &Facts<'_>) -> Result<(), RunError> {
        let experiment = &facts.experiments[index];
        let mut meta = meta(ready, self.rate_hz, facts.seed);
        meta.controller = experiment.controller.map(|index| facts.controllers[index].0.clone());
        if let Some((name, _)) = facts.plant {
            meta.other.insert("plant".into(), name.to_owned());
        }
        meta.other.insert("spec".into(), experiment.spec.clone());
        let columns = columns(experiment.controller.is_some(), facts.place, &ready.parameters);
        let log = &mut self.logs[index];
        log.growing = Some(Growing::begin(&self.path.join(&log.name), &meta, &columns)?);
        log.columns = columns;
        Ok(())
    }

    /// Appends a row to the log of experiment `index` at `now`, the link's time.
    ///
    /// # Errors
    /// [`RunError`]; what was appended before stays.
    pub fn row(&mut self, index: usize, row: &Row, now: Duration, statistics: &Statistics) -> Result<(), RunError> {
        let log = &mut self.logs[index];
        if let Some(growing) = &mut log.growing {
            let value = |column: &Column| match column {
                Column::Time => row.index as f64 / self.rate_hz,
                Column::Command => row.command_v,
                Column::Reference => row.reference_m,
                Column::Drive => row.monitor_v.unwrap_or(row.command_v),
                Column::LimitedBy => f64::from(row.limited_by.bits()),
                _ => row.displacement_m,
            };
            let values: Vec<f64> = log.columns.iter().map(value).collect();
            growing.row(&values, now)?;
            growing.note_lost(row.is_lost.then_some(row.index));
        }
        if now.saturating_sub(self.stated_at) >= STATE {
            self.stated_at = now;
            self.state(statistics, false)?;
        }
        Ok(())
    }

    /// The end of experiment `index`.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn end(&mut self, index: usize, statistics: &Statistics, outcome: &Outcome) -> Result<(), RunError> {
        let log = &mut self.logs[index];
        if let Some(mut growing) = log.growing.take() {
            growing.lost.clear();
            growing.note_lost(outcome.lost.iter().copied());
            log.said = json!({
                "rows": growing.rows,
                "lost_samples": growing.lost,
                "lost_samples_total": outcome.lost.len(),
                "overruns": outcome.overruns,
                "limited_samples": outcome.limited.samples,
                "peak_um": outcome.peak_m * 1e6,
                "fault": outcome.fault.map_or("none", |fault| fault.word()),
                "is_complete": true,
            });
            growing.flush()?;
            growing.finish()?;
        }
        self.state(statistics, false)
    }

    /// The end of all of them.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn finish(self, statistics: &Statistics) -> Result<(), RunError> {
        self.state(statistics, true)
    }

    /// What there is of a recording that something ended.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn keep(&mut self, statistics: &Statistics) -> Result<(), RunError> {
        let flushed = self.logs.iter_mut().filter_map(|log| log.growing.as_mut()).try_for_each(Growing::flush);
        self.state(statistics, false)?;
        flushed
    }

    fn state(&self, statistics: &Statistics, is_complete: bool) -> Result<(), RunError> {
        let mut value = statistics.json();
        value["logs"] = self.logs.iter().map(|log| (log.name.clone(), log.state())).collect();
        value["is_complete"] = is_complete.into();
        write_json(&self.path.join("link.json"), &value)
    }
}

/// One experiment is `log.csv`, as a run in lockstep; of several each has its number and name.
fn log_names(experiments: &[Experiment]) -> Vec<String> {
    match experiments {
        [_] => vec!["log.csv".into()],
        several => several.iter().enumerate().map(|(k, one)| format!("{:02}-{}.csv", k + 1, one.name)).collect(),
    }
}

fn run_json(facts: &Facts<'_>, names: &[String]) -> Value {
    let files = |files: &[(String, Vec<u8>)]| -> Vec<Value> {
        files.iter().map(|(name, content)| file_json(name, content)).collect()
    };
    let named = facts.experiments.iter().zip(names);
    let experiments = named.zip(facts.samples).zip(facts.parameters).map(|(((one, log), samples), parameters)| {
        json!({
            "log": log,
            "spec": one.spec,
            "controller": one.controller.map(|index| facts.controllers[index].0.as_str()),
            "samples": samples,
            "parameters": parameters_json(parameters),
        })
    });
    json!({
        "schema": "hysteron-run-1",
        "program": format!("hysteron {}", env!("CARGO_PKG_VERSION")),
        "mode": if *facts.place == Place::InProcess { "lockstep" } else { "bench" },
        "link": facts.place.to_string(),
        "link_faults": facts.link_faults.map(|faults| json!({ "shares": faults, "seed": facts.seed })),
        "board": facts.board.board,
        "firmware": facts.board.firmware,
        "image": facts.image.map(|(name, content)| file_json(name, content)),
        "wire_version": wire::VERSION,
        "plant": facts.plant.map(|(name, content)| file_json(name, content)),
        "controllers": files(facts.controllers),
        "reference_files": files(facts.reference_files),
        "set": facts.set,
        "before_each": facts.before,
        "experiments": experiments.collect::<Vec<_>>(),
        "rate_hz": facts.rate_hz,
        "seed": facts.seed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_monitor_that_is_not_wired_is_no_column() {
        let wired = Parameters::NUCLEO_PI1;
        let none = Parameters { monitor_tolerance_v: f32::INFINITY, ..wired };
        let has_drive =
            |place: &Place, parameters: &Parameters| columns(false, place, parameters).contains(&Column::Drive);
        let there = Place::Tcp("127.0.0.1:1".to_owned());
        assert!(has_drive(&there, &wired) && !has_drive(&there, &none) && !has_drive(&Place::InProcess, &wired));
        assert_eq!(columns(true, &Place::InProcess, &wired)[3], Column::Reference);
    }
}
