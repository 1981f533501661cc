//! A run on disk: what went in, copied; what came out, row by row. Whatever ends the program, what is there can be read.
//!
//! | file | what | written |
//! | --- | --- | --- |
//! | `run.json` | board, firmware, what it is set to, rate, seeds, reference, hashes: what a repetition needs | before the first sample |
//! | `plant.toml`, `controller.toml` | the files as they were, byte for byte | before the first sample |
//! | `reference-NAME` | the files that the reference's SPEC plays, likewise | before the first sample |
//! | `log.csv` | the samples, as the converters had them | row by row; handed over every 256 rows or half a second |
//! | `link.json` | the link's statistics and the samples it lost | every second, and at the end with the outcome |

use crate::link::Place;
use crate::lockstep::{Outcome, Ready, Row};
use crate::statistics::Statistics;
use plant_sim::log::{Column, LogError, Meta, Writer};
use plant_sim::whole_file;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;
use wire::Parameters;

/// Rows between two hand-overs: 25 KB, less than the writer's buffer, so that only a kill in the middle of one cuts a row in two.
const ROWS: usize = 256;
const FLUSH: Duration = Duration::from_millis(500);
pub(crate) const STATE: Duration = Duration::from_secs(1);
/// Lost samples that are listed one by one.
const LISTED: usize = 1000;

/// Why a run can't be kept, or goes on no longer.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RunError {
    #[error("{}: holds files already; name a directory that is empty or not there", path.display())]
    NotEmpty { path: PathBuf },
    #[error("{}: cannot be written: {source}; name another place", path.display())]
    Unwritable { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Log(#[from] LogError),
    /// Whoever writes it was asked to end.
    #[error("interrupted: what was recorded before is there")]
    Interrupted,
}

/// What a run is made from.
#[derive(Clone, Debug)]
pub struct Facts<'a> {
    /// Where the board is.
    pub place: &'a Place,
    /// The board.
    pub ready: &'a Ready,
    /// Name and content of the flash image, if it is a file here.
    pub image: Option<(&'a str, &'a [u8])>,
    /// Name and content of the plant's file.
    pub plant: (&'a str, &'a [u8]),
    /// Name and content of the controller's file.
    pub controller: (&'a str, &'a [u8]),
    /// The reference's SPEC.
    pub reference: &'a str,
    /// Names and contents of the files that the SPEC plays.
    pub reference_files: &'a [(String, Vec<u8>)],
    /// Samples per second.
    pub rate_hz: f64,
    /// Samples to record.
    pub samples: usize,
    /// Seed of the sensor's noise and of lost commands.
    pub seed: u64,
    /// The plant kept to the clock.
    pub is_paced: bool,
    /// Faults of the link, made on purpose, with their seed.
    pub link_faults: Option<(&'a str, u64)>,
}

/// A log that grows: its rows are handed over every 256 of them or half a second.
#[derive(Debug)]
pub(crate) struct Growing {
    writer: Writer,
    unflushed: usize,
    flushed_at: Duration,
    /// Rows so far.
    pub rows: usize,
    /// Samples that were lost, the first thousand.
    pub lost: Vec<usize>,
}

impl Growing {
    /// Begins a log that is not there yet.
    pub fn begin(path: &Path, meta: &Meta, columns: &[Column]) -> Result<Growing, RunError> {
        let writer = Writer::create_live(path, meta, columns)?;
        Ok(Growing { writer, unflushed: 0, flushed_at: Duration::ZERO, rows: 0, lost: Vec::new() })
    }

    /// Appends a row at `now`, the link's time.
    pub fn row(&mut self, values: &[f64], now: Duration) -> Result<(), RunError> {
        self.writer.row(values)?;
        self.rows += 1;
        self.unflushed += 1;
        if self.unflushed >= ROWS || now.saturating_sub(self.flushed_at) >= FLUSH {
            self.writer.flush()?;
            (self.unflushed, self.flushed_at) = (0, now);
        }
        Ok(())
    }

    /// Takes note of lost samples.
    pub fn note_lost(&mut self, indices: impl IntoIterator<Item = usize>) {
        let room = LISTED - self.lost.len();
        self.lost.extend(indices.into_iter().take(room));
    }

    /// Hands over what there is.
    pub fn flush(&mut self) -> Result<(), RunError> {
        Ok(self.writer.flush()?)
    }

    /// The log's end.
    pub fn finish(self) -> Result<(), RunError> {
        Ok(self.writer.finish()?)
    }
}

/// A run that is being written.
#[derive(Debug)]
pub struct RunDirectory {
    path: PathBuf,
    log: Growing,
    rate_hz: f64,
    stated_at: Duration,
}

impl RunDirectory {
    /// Makes `path`, which must be empty or not there, and writes what is known before the first sample.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn create(path: &Path, facts: &Facts<'_>) -> Result<RunDirectory, RunError> {
        check_place(path)?;
        std::fs::create_dir_all(path).map_err(unwritable(path))?;
        let Facts { ready, rate_hz, .. } = *facts;
        write(&path.join("plant.toml"), facts.plant.1)?;
        write(&path.join("controller.toml"), facts.controller.1)?;
        for (name, content) in facts.reference_files {
            write(&path.join(format!("reference-{name}")), content)?;
        }
        write_json(&path.join("run.json"), &json(facts))?;
        let mut meta = meta(ready, rate_hz, facts.seed);
        meta.controller = Some(facts.controller.0.to_owned());
        meta.other.insert("plant".into(), facts.plant.0.to_owned());
        let columns = [Column::Time, Column::Command, Column::Displacement, Column::Reference, Column::LimitedBy];
        let log = Growing::begin(&path.join("log.csv"), &meta, &columns)?;
        Ok(RunDirectory { path: path.to_owned(), log, rate_hz, stated_at: Duration::ZERO })
    }

    /// Appends a row at `now`, the link's time.
    ///
    /// # Errors
    /// [`RunError`]; what was appended before stays.
    pub fn row(&mut self, row: &Row, now: Duration, statistics: &Statistics) -> Result<(), RunError> {
        let time_s = row.index as f64 / self.rate_hz;
        let limited_by = f64::from(row.limited_by.bits());
        self.log.row(&[time_s, row.command_v, row.displacement_m, row.reference_m, limited_by], now)?;
        self.log.note_lost(row.is_lost.then_some(row.index));
        if now.saturating_sub(self.stated_at) >= STATE {
            self.stated_at = now;
            self.state(statistics, None)?;
        }
        Ok(())
    }

    /// The end of the run.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn finish(mut self, statistics: &Statistics, outcome: &Outcome) -> Result<(), RunError> {
        self.log.flush()?;
        self.state(statistics, Some(outcome))?;
        self.log.finish()
    }

    /// What there is of a run that something ended.
    ///
    /// # Errors
    /// [`RunError`].
    pub fn keep(&mut self, statistics: &Statistics) -> Result<(), RunError> {
        let flushed = self.log.flush();
        self.state(statistics, None)?;
        flushed
    }

    fn state(&self, statistics: &Statistics, outcome: Option<&Outcome>) -> Result<(), RunError> {
        let mut value = statistics.json();
        value["rows"] = self.log.rows.into();
        // So many; which ones, for the first thousand.
        value["lost_samples"] = json!(self.log.lost);
        value["is_complete"] = outcome.is_some().into();
        if let Some(outcome) = outcome {
            value["lost_samples_total"] = outcome.lost.len().into();
            value["overruns"] = outcome.overruns.into();
            value["slips"] = outcome.slips.into();
            value["limited_samples"] = outcome.limited.samples.into();
            value["peak_um"] = (outcome.peak_m * 1e6).into();
            value["fault"] = outcome.fault.map_or("none", |fault| fault.word()).into();
        }
        write_json(&self.path.join("link.json"), &value)
    }
}

/// Whether a run can go to `path`; said before a board is spoken to.
///
/// # Errors
/// [`RunError::NotEmpty`], [`RunError::Unwritable`].
pub fn check_place(path: &Path) -> Result<(), RunError> {
    match std::fs::read_dir(path) {
        Ok(mut entries) => match entries.next() {
            Some(_) => Err(RunError::NotEmpty { path: path.to_owned() }),
            None => Ok(()),
        },
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(source) => Err(RunError::Unwritable { path: path.to_owned(), source }),
    }
}

/// What a log says of its board.
pub(crate) fn meta(ready: &Ready, rate_hz: f64, seed: u64) -> Meta {
    let calibration = &ready.checked.calibration;
    let mut meta = Meta {
        rate_hz: Some(rate_hz),
        latency_s: ready.latency_s,
        adc_lsb_m: Some(f64::from(calibration.displacement_m_per_code()).abs()),
        dac_lsb_v: Some(f64::from(calibration.drive_v_per_code()).abs()),
        firmware: Some(ready.board.firmware.clone()),
        seed: Some(seed.to_string()),
        ..Meta::default()
    };
    meta.other.insert("board".into(), ready.board.board.clone());
    meta
}

/// What a board is set to as JSON, its numbers in the decimals of their 32 bits; infinity is null.
pub fn parameters_json(parameters: &Parameters) -> Value {
    // By way of its text: as numbers of 64 bits they would have all the digits of these.
    let text = serde_json::to_string(parameters).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// A file as `run.json` names it.
pub(crate) fn file_json(name: &str, content: &[u8]) -> Value {
    json!({ "file": name, "sha256": sha256(content) })
}

fn json(facts: &Facts<'_>) -> Value {
    let file = |(name, content): (&str, &[u8])| file_json(name, content);
    json!({
        "schema": "hysteron-run-1",
        "program": format!("hysteron {}", env!("CARGO_PKG_VERSION")),
        "mode": if facts.is_paced { "paced" } else { "lockstep" },
        "link": facts.place.to_string(),
        "link_faults": facts.link_faults.map(|(faults, seed)| json!({ "shares": faults, "seed": seed })),
        "board": facts.ready.board.board,
        "firmware": facts.ready.board.firmware,
        "image": facts.image.map(file),
        "parameters": parameters_json(&facts.ready.parameters),
        "wire_version": wire::VERSION,
        "plant": file(facts.plant),
        "controller": file(facts.controller),
        "reference": facts.reference,
        "reference_files": facts.reference_files.iter().map(|(name, content)| file((name, content))).collect::<Vec<_>>(),
        "rate_hz": facts.rate_hz,
        "samples": facts.samples,
        "latency_us": facts.ready.latency_s * 1e6,
        "seed": facts.seed,
    })
}

fn sha256(content: &[u8]) -> String {
    Sha256::digest(content).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes a file that is whole or as it was.
pub(crate) fn write(path: &Path, content: &[u8]) -> Result<(), RunError> {
    whole_file::write(path, content).map_err(unwritable(path))
}

pub(crate) fn write_json(path: &Path, value: &Value) -> Result<(), RunError> {
    write(path, format!("{value:#}\n").as_bytes())
}

pub(crate) fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> RunError {
    let path = path.to_owned();
    |source| RunError::Unwritable { path, source }
}
