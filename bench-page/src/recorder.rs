//! A recording: the loop's samples into a run directory, and beside it what was done meanwhile.
//!
//! The directory is `hil-bridge`'s; what the page adds is `events.jsonl`, one line an event with the row it came before, because on a page
//! parameters and references change while it records. What this does not do: decide when.

use hil_bridge::link::Place;
use hil_bridge::lockstep::{Outcome, Ready, Row};
use hil_bridge::run_directory::{Facts, RunDirectory, RunError};
use hil_bridge::statistics::Statistics;
use serde_json::json;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What is recorded.
pub struct Subject<'a> {
    /// Where the board is.
    pub place: &'a Place,
    /// The board and its parameters.
    pub ready: &'a Ready,
    /// Name and content of the flash image, if it is a file here.
    pub image: Option<(&'a str, &'a [u8])>,
    /// Name and content of the plant's file.
    pub plant: (&'a str, &'a [u8]),
    /// The SPEC that plays as the recording begins.
    pub spec: &'a str,
    /// Samples to come; 0 where nobody knows.
    pub samples: usize,
    /// Seed of the bench's noise.
    pub seed: u64,
}

/// A recording that goes on.
pub struct Recorder {
    /// Where it goes.
    pub path: PathBuf,
    /// Rows so far.
    pub rows: usize,
    rate_hz: f64,
    directory: RunDirectory,
    events: File,
    outcome: Outcome,
}

impl Recorder {
    /// Begins a recording in `path`, which must be empty or not there.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn begin(path: &Path, subject: &Subject<'_>) -> Result<Recorder, RunError> {
        let ready = subject.ready;
        let settings = ready.parameters.settings();
        // The set in force, which need not be any file's any more.
        let controller = toml::to_string(&crate::parameters::controller("as recorded", &settings)).unwrap_or_default();
        let rate_hz = f64::from(settings.rate_hz);
        let facts = Facts {
            place: subject.place,
            ready,
            image: subject.image,
            plant: subject.plant,
            controller: ("controller.toml", controller.as_bytes()),
            reference: subject.spec,
            reference_files: &[],
            rate_hz,
            samples: subject.samples,
            seed: subject.seed,
            link_faults: None,
            is_paced: false,
        };
        let directory = RunDirectory::create(path, &facts)?;
        let events_path = path.join("events.jsonl");
        let events = File::create(&events_path).map_err(|source| RunError::Unwritable { path: events_path, source })?;
        Ok(Recorder { path: path.to_owned(), rows: 0, rate_hz, directory, events, outcome: Outcome::default() })
    }

    /// Appends a row at `now`, the link's time.
    ///
    /// # Errors
    /// [`RunError`]; what was appended before stays.
    pub fn row(&mut self, row: &Row, now: Duration, statistics: &Statistics) -> Result<(), RunError> {
        let own = Row { index: self.rows, ..*row };
        self.directory.row(&own, now, statistics)?;
        if row.is_lost {
            self.outcome.lost.push(self.rows);
        } else {
            self.outcome.limited.count(row.limited_by);
        }
        self.outcome.peak_m = self.outcome.peak_m.max(row.displacement_m.abs());
        self.rows += 1;
        Ok(())
    }

    /// Notes a fault of the board: a run with one is not whole, even where it was cleared before the end.
    pub fn fault(&mut self, fault: control_core::FaultCode) {
        self.outcome.fault.get_or_insert(fault);
    }

    /// Notes what happened before the next row.
    ///
    /// # Errors
    /// [`RunError::Unwritable`].
    pub fn event(&mut self, text: &str) -> Result<(), RunError> {
        let line = json!({ "row": self.rows, "time_s": self.rows as f64 / self.rate_hz, "event": text });
        writeln!(self.events, "{line}")
            .map_err(|source| RunError::Unwritable { path: self.path.join("events.jsonl"), source })
    }

    /// What there is of a recording that something ended.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn keep(&mut self, statistics: &Statistics) -> Result<(), RunError> {
        self.directory.keep(statistics)
    }

    /// Ends it.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn finish(self, statistics: &Statistics, fault: Option<control_core::FaultCode>) -> Result<(), RunError> {
        let outcome = Outcome { fault: self.outcome.fault.or(fault), ..self.outcome };
        self.directory.finish(statistics, &outcome)
    }
}

/// A directory name made of what a person typed: letters, digits, `-` and `_`; others become `-`.
pub fn file_name(typed: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    typed.trim().chars().take(60).map(plain).collect::<String>().trim_matches('-').to_owned()
}

/// `stem`, or `stem-2`, `stem-3`, ... : the first that is not in `folder` yet.
///
/// # Errors
/// Where `folder` cannot be looked at.
pub fn free_name(folder: &Path, stem: &str) -> io::Result<PathBuf> {
    let names = (1..).map(|n| if n == 1 { stem.to_owned() } else { format!("{stem}-{n}") });
    for name in names {
        let path = folder.join(name);
        if !path.try_exists()? {
            return Ok(path);
        }
    }
    Ok(folder.join(stem))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_their_folder() {
        assert_eq!(file_name("../../etc/passwd"), "etc-passwd");
        assert_eq!(file_name("  step 80um, Kp=0.5 "), "step-80um--Kp-0-5");
        assert_eq!(file_name("..."), "");
        assert!(file_name(&"x".repeat(1000)).len() <= 60);
    }
}
