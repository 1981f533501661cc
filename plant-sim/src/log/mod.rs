//! Logs: what a bench or a simulation recorded, read from CSV, NPY and MAT v5 and written to them.
//!
//! Row k is the displacement sampled at `time[k]`; `command[k]` applies from `time[k] + latency` until the next.
//! Inside everything is in SI; micrometres exist only in files, and the step between the two is in `column`.
//!
//! **Invariants.** A log is uniform in time, finite and at least 16 samples long, or it is an error with file, place
//! and column. No bytes make the readers panic. CSV and NPY are streamed in constant memory; MAT v5, and an NPY table
//! in Fortran order, are loaded, since their rows are spread over the file. Nothing here guesses units from the data:
//! [`warnings`] says what looks wrong, and the person decides.
//!
//! ```
//! use plant_sim::log::{ReadOptions, RowReader};
//! let text = (0..20).fold("t_s,u_V,y_um\n".to_owned(), |text, k| text + &format!("{:.3},{k},1.5\n", f64::from(k) / 1e3));
//! let mut options = ReadOptions::default();
//! for (key, name) in [("time", "t_s"), ("command", "u_V"), ("displacement", "y_um")] {
//!     options.columns.insert(key.into(), name.into());
//! }
//! let log = RowReader::from_csv("bench.csv".as_ref(), std::io::Cursor::new(text), &options)?.into_log()?;
//! assert_eq!((log.len(), log.dt_s, log.displacement_m[0]), (20, 1e-3, 1.5e-6));
//! # Ok::<(), plant_sim::log::LogError>(())
//! ```

mod column;
mod csv_file;
mod error;
mod export;
mod grid;
mod mat;
mod mat5;
mod meta;
mod npy;
mod plausibility;
mod source;
mod writer;

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

pub use column::Column;
pub use csv_file::excerpt_list;
pub use error::{LogError, Place};
pub use export::export;
pub use meta::{Hold, Meta};
pub use plausibility::{warnings, warnings_of_head};
pub use writer::{Writer, write};

use column::N_READ;
use grid::Grid;
use source::{Opened, RawRow, Source};

/// Fewest samples that say anything about a plant.
pub const MIN_SAMPLES: usize = 16;

/// Rows read ahead to learn the usual step of the time.
pub(crate) const LOOK_AHEAD: usize = 64;

/// A log in memory, in SI.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    /// Where it comes from, for messages.
    pub name: String,
    /// Time of the first sample, seconds.
    pub time_start_s: f64,
    /// Sampling interval, seconds.
    pub dt_s: f64,
    /// Command, volts; applies from the sample's time plus `meta.latency_s` until the next.
    pub command_v: Vec<f64>,
    /// Measured displacement, metres.
    pub displacement_m: Vec<f64>,
    /// Reference displacement, metres.
    pub reference_m: Option<Vec<f64>>,
    /// The amplifier's output monitor, volts.
    pub drive_v: Option<Vec<f64>>,
    /// Force from outside, against positive displacement (the thesis' Fext), newtons.
    pub force_n: Option<Vec<f64>>,
    /// Current, amperes.
    pub current_a: Option<Vec<f64>>,
    /// Temperature, degrees Celsius.
    pub temperature_c: Option<Vec<f64>>,
    /// What limited the controller, its stable code.
    pub limited_by: Option<Vec<f64>>,
    /// Sequence numbers of the records.
    pub seq: Option<Vec<f64>>,
    /// How it was recorded.
    pub meta: Meta,
    /// Names of columns of its file that are none of the above, and were not read.
    pub others: Vec<String>,
}

impl Log {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.command_v.len()
    }

    /// Whether there is no sample. A log that was read has at least [`MIN_SAMPLES`].
    pub fn is_empty(&self) -> bool {
        self.command_v.is_empty()
    }

    /// Its first `rows` samples, in every column.
    pub fn first(&self, rows: usize) -> Log {
        let mut first = self.clone();
        let Log { reference_m, drive_v, force_n, current_a, temperature_c, limited_by, seq, .. } = &mut first;
        let optional = [reference_m, drive_v, force_n, current_a, temperature_c, limited_by, seq];
        optional.into_iter().flatten().for_each(|column| column.truncate(rows));
        first.command_v.truncate(rows);
        first.displacement_m.truncate(rows);
        first
    }

    /// Time of sample `k`, seconds.
    pub fn time_s(&self, k: usize) -> f64 {
        self.time_start_s + k as f64 * self.dt_s
    }

    /// The columns there are, without the time, in the order in which they are written.
    pub(crate) fn columns(&self) -> Vec<(Column, &[f64])> {
        let optional = [
            (Column::Reference, &self.reference_m),
            (Column::Drive, &self.drive_v),
            (Column::Force, &self.force_n),
            (Column::Current, &self.current_a),
            (Column::Temperature, &self.temperature_c),
            (Column::LimitedBy, &self.limited_by),
            (Column::Seq, &self.seq),
        ];
        let mut columns: Vec<(Column, &[f64])> =
            vec![(Column::Command, &self.command_v), (Column::Displacement, &self.displacement_m)];
        columns.extend(optional.into_iter().filter_map(|(column, values)| Some((column, values.as_deref()?))));
        columns
    }
}

/// How to read a log that was not written by this project.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// From a column's key (`time`, `command`, `displacement`, `reference`, `drive`, `force`, `current`,
    /// `temperature`, `limited_by`, `seq`) to its name in the file; an index for an NPY table. A name's ending is
    /// its unit (`y_nm`, `t_ms`, `u_mV`); without one, `time_s`, `command_V`, `displacement_um` and so on are meant.
    pub columns: BTreeMap<String, String>,
    /// From a column's key to the SI value of one unit of the file: `displacement = 1e-6` means micrometres.
    /// Goes before what the name's ending says.
    pub scale: BTreeMap<String, f64>,
    /// The sampling rate, hertz, in place of a time column, which is then not read even if there is one.
    pub rate_hz: Option<f64>,
}

/// One sample, in SI.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Its time, seconds, as in the file.
    pub time_s: f64,
    /// Command, volts.
    pub command_v: f64,
    /// Measured displacement, metres.
    pub displacement_m: f64,
    /// Reference displacement, metres.
    pub reference_m: Option<f64>,
    /// The amplifier's output monitor, volts.
    pub drive_v: Option<f64>,
    /// Force, newtons.
    pub force_n: Option<f64>,
    /// Current, amperes.
    pub current_a: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// What limited the controller, its stable code.
    pub limited_by: Option<f64>,
    /// Sequence number of the record.
    pub seq: Option<f64>,
}

/// Kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Text.
    Csv,
    /// numpy.
    Npy,
    /// MATLAB.
    Mat,
}

impl Kind {
    /// By the end of a path, in any case.
    pub(crate) fn of_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "csv" => Some(Self::Csv),
            "npy" => Some(Self::Npy),
            "mat" => Some(Self::Mat),
            _ => None,
        }
    }
}

/// Reads a whole log.
///
/// The format is told by the extension `.npy` or `.mat` or by the first bytes; everything else is taken for CSV.
///
/// # Errors
/// Any reading variant of [`LogError`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Log, LogError> {
    open(path, options)?.into_log()
}

/// Opens a log for reading row by row, in constant memory for CSV and NPY.
///
/// # Errors
/// Any reading variant of [`LogError`] that the first rows show.
pub fn open(path: &Path, options: &ReadOptions) -> Result<RowReader, LogError> {
    RowReader::open(path, options)
}

/// A log, row by row: an iterator of checked rows that ends after the first error.
pub struct RowReader {
    path: PathBuf,
    meta: Meta,
    /// The rate that stands in for a time column, and the time of its first row is zero.
    rate_hz: Option<f64>,
    has: [bool; N_READ],
    others: Vec<String>,
    rows: Box<dyn Source>,
    ahead: VecDeque<RawRow>,
    grid: Option<Grid>,
    n_rows: u64,
    ended: bool,
}

impl std::fmt::Debug for RowReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RowReader")
            .field("path", &self.path)
            .field("meta", &self.meta)
            .field("n_rows", &self.n_rows)
            .finish_non_exhaustive()
    }
}

impl RowReader {
    /// Opens a file; see [`open`].
    ///
    /// # Errors
    /// Any reading variant of [`LogError`] that the first rows show.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Self, LogError> {
        let wanted = column::wanted(options)?;
        let fail = |error| LogError::from_read(path, error);
        let mut file = File::open(path).map_err(fail)?;
        if file.metadata().map_err(fail)?.is_dir() {
            return Err(LogError::IsDirectory { path: path.to_path_buf() });
        }
        let mut head = Vec::new();
        file.by_ref().take(128).read_to_end(&mut head).map_err(fail)?;
        if head.is_empty() {
            return Err(LogError::Empty { path: path.to_path_buf() });
        }
        // The bytes go before the name: a MAT file called .csv would only give a riddle.
        let kind = if head.starts_with(npy::MAGIC) {
            Kind::Npy
        } else if mat5::is_mat(&head) {
            Kind::Mat
        } else {
            Kind::of_extension(path).unwrap_or(Kind::Csv)
        };
        let whole = Cursor::new(head).chain(file);
        let opened = match kind {
            Kind::Csv => csv_file::open(path, whole, options, &wanted),
            Kind::Npy => npy::open(path, whole, options, &wanted),
            Kind::Mat => mat::open(path, whole, options, &wanted),
        }?;
        Self::begin(path, opened, options)
    }

    /// Reads CSV from anything; `name` stands for the file in messages.
    ///
    /// # Errors
    /// Any reading variant of [`LogError`] that the first rows show.
    pub fn from_csv<R: Read + Send + 'static>(name: &Path, reader: R, options: &ReadOptions) -> Result<Self, LogError> {
        let wanted = column::wanted(options)?;
        let opened = csv_file::open(name, reader, options, &wanted)?;
        Self::begin(name, opened, options)
    }

    /// Reads NPY from anything; see [`RowReader::from_csv`].
    ///
    /// # Errors
    /// Any reading variant of [`LogError`] that the first rows show.
    pub fn from_npy<R: Read + Send + 'static>(name: &Path, reader: R, options: &ReadOptions) -> Result<Self, LogError> {
        let wanted = column::wanted(options)?;
        let opened = npy::open(name, reader, options, &wanted)?;
        Self::begin(name, opened, options)
    }

    /// Reads MAT v5 from anything; see [`RowReader::from_csv`]. Loads it as a whole.
    ///
    /// # Errors
    /// Any reading variant of [`LogError`] that the first rows show.
    pub fn from_mat<R: Read>(name: &Path, reader: R, options: &ReadOptions) -> Result<Self, LogError> {
        let wanted = column::wanted(options)?;
        let opened = mat::open(name, reader, options, &wanted)?;
        Self::begin(name, opened, options)
    }

    /// Reads the first rows and learns the usual step from them.
    fn begin(path: &Path, opened: Opened, options: &ReadOptions) -> Result<Self, LogError> {
        let has_time = opened.has(Column::Time);
        let rate_hz = options.rate_hz.or(if has_time { None } else { opened.rate_hz.or(opened.meta.rate_hz) });
        if !has_time && rate_hz.is_none() {
            return Err(LogError::NoRate { path: path.to_path_buf() });
        }
        let mut meta = opened.meta;
        // What is asked for goes before what the file states.
        meta.rate_hz = options.rate_hz.or(meta.rate_hz);
        let mut reader = Self {
            path: path.to_path_buf(),
            meta,
            rate_hz,
            has: opened.has,
            others: opened.others,
            rows: opened.rows,
            ahead: VecDeque::with_capacity(LOOK_AHEAD),
            grid: None,
            n_rows: 0,
            ended: false,
        };
        while reader.ahead.len() < LOOK_AHEAD {
            match reader.rows.next_row()? {
                Some(row) => reader.ahead.push_back(row),
                None => break,
            }
        }
        if reader.ahead.len() < MIN_SAMPLES {
            return Err(reader.too_few(reader.ahead.len() as u64));
        }
        if has_time && options.rate_hz.is_none() {
            let times_s: Vec<f64> = reader.ahead.iter().map(time_of).collect();
            let prints: Vec<_> = reader.ahead.iter().map(|row| row.print).collect();
            reader.grid = Grid::new(&times_s, &prints);
            if reader.grid.is_none() {
                let idx = times_s.windows(2).position(|pair| pair[1] <= pair[0]).unwrap_or(0);
                return Err(LogError::TimeNotIncreasing {
                    path: path.to_path_buf(),
                    place: reader.ahead[idx + 1].place,
                    from_s: times_s[idx],
                    to_s: times_s[idx + 1],
                });
            }
        }
        Ok(reader)
    }

    fn too_few(&self, n_samples: u64) -> LogError {
        LogError::TooFewSamples { path: self.path.clone(), n_samples }
    }

    /// How the log was recorded.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// Rows given so far.
    pub fn n_rows(&self) -> u64 {
        self.n_rows
    }

    /// Whether the log has this column. `Time` is false where a rate stands in for it.
    pub fn has(&self, column: Column) -> bool {
        self.has.get(column.idx()).copied().unwrap_or(false)
    }

    /// The sampling interval, seconds: final after the last row, before it the best that the rows so far allow.
    ///
    /// `1 / rate_hz` where the metadata state a rate and all times agree with it, else from the first and last time.
    pub fn dt_s(&self) -> f64 {
        match (&self.grid, self.rate_hz) {
            (Some(grid), _) => grid.interval_s(self.meta.rate_hz),
            (None, rate_hz) => rate_hz.map_or(f64::NAN, f64::recip),
        }
    }

    /// Reads the rest into memory.
    ///
    /// # Errors
    /// Any reading variant of [`LogError`].
    pub fn into_log(mut self) -> Result<Log, LogError> {
        let mut columns: [Vec<f64>; N_READ] = Default::default();
        let mut time_start_s = None;
        while let Some(row) = self.next_raw()? {
            time_start_s.get_or_insert(time_of(&row));
            for (idx, column) in columns.iter_mut().enumerate().skip(1) {
                if self.has[idx] {
                    column.push(row.values[idx]);
                }
            }
        }
        // What grew by doubling may hold twice what it needs.
        columns.iter_mut().for_each(Vec::shrink_to_fit);
        let mut take = |column: Column| std::mem::take(&mut columns[column.idx()]);
        let mut optional = |column: Column| self.has[column.idx()].then(|| take(column));
        Ok(Log {
            name: self.path.display().to_string(),
            time_start_s: time_start_s.unwrap_or(0.0),
            dt_s: self.dt_s(),
            reference_m: optional(Column::Reference),
            drive_v: optional(Column::Drive),
            force_n: optional(Column::Force),
            current_a: optional(Column::Current),
            temperature_c: optional(Column::Temperature),
            limited_by: optional(Column::LimitedBy),
            seq: optional(Column::Seq),
            command_v: take(Column::Command),
            displacement_m: take(Column::Displacement),
            meta: self.meta,
            others: self.others,
        })
    }

    /// The next row, its time checked or made.
    fn next_raw(&mut self) -> Result<Option<RawRow>, LogError> {
        let next = match self.ahead.pop_front() {
            Some(row) => Some(row),
            None => self.rows.next_row()?,
        };
        let Some(mut row) = next else {
            return Ok(None);
        };
        match (&mut self.grid, self.rate_hz) {
            (Some(grid), _) => grid.push(&self.path, row.place, time_of(&row), row.print)?,
            (None, rate_hz) => {
                row.values[Column::Time.idx()] = rate_hz.map_or(f64::NAN, |rate_hz| self.n_rows as f64 / rate_hz);
            }
        }
        self.n_rows += 1;
        Ok(Some(row))
    }
}

fn time_of(row: &RawRow) -> f64 {
    row.values[Column::Time.idx()]
}

impl Iterator for RowReader {
    type Item = Result<Row, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        match self.next_raw() {
            Ok(Some(row)) => {
                let value = |column: Column| row.values[column.idx()];
                let optional = |column: Column| self.has[column.idx()].then(|| value(column));
                Some(Ok(Row {
                    time_s: value(Column::Time),
                    command_v: value(Column::Command),
                    displacement_m: value(Column::Displacement),
                    reference_m: optional(Column::Reference),
                    drive_v: optional(Column::Drive),
                    force_n: optional(Column::Force),
                    current_a: optional(Column::Current),
                    temperature_c: optional(Column::Temperature),
                    limited_by: optional(Column::LimitedBy),
                    seq: optional(Column::Seq),
                }))
            }
            Ok(None) => {
                self.ended = true;
                None
            }
            Err(error) => {
                self.ended = true;
                Some(Err(error))
            }
        }
    }
}
