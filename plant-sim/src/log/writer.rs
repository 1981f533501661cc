//! Writing logs: CSV row by row, or a whole log as CSV, NPY or MAT v5.
//!
//! What is written goes to a file beside the target, which takes the target's name only when all is there. A program
//! that fails half-way leaves nothing.
//!
//! A CSV gives back the same bits: numbers are printed with the fewest digits that identify them, and metres become
//! micrometres by moving the decimal point in the text, not by a multiplication. NPY and MAT hold micrometres as
//! binary numbers; there the way there and back rounds twice, which is at most 2.3e-16 of the value.

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use npyz::WriterBuilder as _;

use super::column::Column;
use super::error::{LogError, Place};
use super::mat5;
use super::meta::Meta;
use super::{Kind, Log};
use crate::whole_file::WholeFile;

/// Most digits after the point of a printed time: a picosecond.
const MAX_TIME_DECIMALS: usize = 12;

/// Writes a CSV log row by row.
///
/// Dropped without [`Writer::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    /// `None` once a row has failed.
    staged: Option<Staged>,
    columns: Vec<Column>,
    interval_s: Option<f64>,
    time_decimals: Option<usize>,
    n_rows: u64,
    /// Bytes of whole rows that the operating system has, for a live log.
    handed_over: Option<u64>,
    line: Vec<u8>,
    scratch: String,
}

impl Writer {
    /// Begins a CSV log at `path`, whatever its extension, with its metadata and header.
    ///
    /// # Errors
    /// [`LogError::Unwritable`], [`LogError::IsDirectory`].
    pub fn create(path: &Path, meta: &Meta, columns: &[Column]) -> Result<Self, LogError> {
        Self::with_interval(path, meta, columns, meta.rate_hz.map(f64::recip))
    }

    /// As [`Writer::create`], but under its own name from the start and never taken back: what [`Writer::flush`] has handed over stays
    /// readable however the program ends.
    ///
    /// # Errors
    /// [`LogError::Unwritable`], also for a file that is there already.
    pub fn create_live(path: &Path, meta: &Meta, columns: &[Column]) -> Result<Self, LogError> {
        let mut writer = Self::begin(Staged::live(path)?, path, meta, columns, meta.rate_hz.map(f64::recip))?;
        writer.handed_over = Some(0);
        Ok(writer)
    }

    /// Hands all rows so far to the operating system. Called at least every few hundred rows, no row is cut in two on disk, unless
    /// a kill or a power cut comes in the middle of a call: readers leave such a row out.
    ///
    /// # Errors
    /// [`LogError::Unwritable`], [`LogError::Ended`]. A live log then ends with the rows handed over before, and is given up.
    pub fn flush(&mut self) -> Result<(), LogError> {
        let Some(staged) = &mut self.staged else { return Err(gave_up(&self.path)) };
        match staged.file.hand_over() {
            Ok(bytes) => {
                self.handed_over = self.handed_over.map(|_| bytes);
                Ok(())
            }
            Err(source) => {
                // Closed first: it tries once more to write what it holds.
                self.staged = None;
                if let Some(bytes) = self.handed_over {
                    // Nobody is left to be told if this fails too.
                    let _ = OpenOptions::new().write(true).open(&self.path).and_then(|file| file.set_len(bytes));
                }
                Err(self.ended(source))
            }
        }
    }

    /// What is to be said where no row can be added.
    fn ended(&self, source: io::Error) -> LogError {
        let path = self.path.clone();
        if self.handed_over.is_some() {
            LogError::Ended { path, source }
        } else {
            LogError::Unwritable { path, source }
        }
    }

    fn with_interval(path: &Path, meta: &Meta, columns: &[Column], interval_s: Option<f64>) -> Result<Self, LogError> {
        Self::begin(Staged::create(path)?, path, meta, columns, interval_s)
    }

    fn begin(
        mut staged: Staged,
        path: &Path,
        meta: &Meta,
        columns: &[Column],
        interval_s: Option<f64>,
    ) -> Result<Self, LogError> {
        let mut head = String::new();
        for (key, value) in meta.entries() {
            head.push_str(&format!("# {key}: {value}\n"));
        }
        let names: Vec<&str> = columns.iter().map(|column| column.file_name()).collect();
        head.push_str(&names.join(","));
        head.push('\n');
        staged.put(head.as_bytes())?;
        Ok(Self {
            path: path.to_path_buf(),
            staged: Some(staged),
            columns: columns.to_vec(),
            interval_s,
            time_decimals: None,
            n_rows: 0,
            handed_over: None,
            line: Vec::new(),
            scratch: String::new(),
        })
    }

    /// Writes one row: values in SI (metres, volts, seconds), in the order of the columns given to
    /// [`Writer::create`].
    ///
    /// # Errors
    /// [`LogError::NotFinite`] and [`LogError::RowWidth`] for a row that no reader would take,
    /// [`LogError::Unwritable`], [`LogError::Ended`]. After any of them the log is given up.
    pub fn row(&mut self, values: &[f64]) -> Result<(), LogError> {
        let result = self.try_row(values);
        if result.is_err() {
            self.staged = None;
        }
        result.map_err(|error| match error {
            LogError::Unwritable { source, .. } => self.ended(source),
            other => other,
        })
    }

    fn try_row(&mut self, values: &[f64]) -> Result<(), LogError> {
        if values.len() != self.columns.len() {
            return Err(LogError::RowWidth {
                path: self.path.clone(),
                found: values.len(),
                expected: self.columns.len(),
            });
        }
        self.line.clear();
        for (&column, &value) in self.columns.iter().zip(values) {
            if !value.is_finite() {
                return Err(LogError::NotFinite {
                    path: self.path.clone(),
                    place: Place::Sample(self.n_rows),
                    column: column.file_name().to_owned(),
                    value: value.to_string(),
                });
            }
            if !self.line.is_empty() {
                self.line.push(b',');
            }
            match (column, self.interval_s) {
                (Column::Time, Some(interval_s)) => {
                    let decimals = *self.time_decimals.get_or_insert_with(|| time_decimals(interval_s, value));
                    // Writing to memory cannot fail.
                    let _ = write!(self.line, "{value:.decimals$}");
                }
                _ => push_shortest(&mut self.line, &mut self.scratch, value, column.file_exponent()),
            }
        }
        self.line.push(b'\n');
        self.n_rows += 1;
        match &mut self.staged {
            Some(staged) => staged.put(&self.line),
            None => Err(gave_up(&self.path)),
        }
    }

    /// Gives the log its name.
    ///
    /// # Errors
    /// [`LogError::Unwritable`], also if a row failed before.
    pub fn finish(mut self) -> Result<(), LogError> {
        match self.staged.take() {
            Some(staged) => staged.finish(),
            None => Err(gave_up(&self.path)),
        }
    }
}

fn gave_up(path: &Path) -> LogError {
    LogError::Unwritable { path: path.to_path_buf(), source: io::Error::other("an earlier row could not be written") }
}

/// Writes a whole log; the extension (`.csv`, `.npy`, `.mat`) says how.
///
/// The rate is written too if the log does not state one. NPY has no room for metadata: they are lost there.
///
/// # Errors
/// [`LogError::UnknownKind`], [`LogError::NotFinite`], [`LogError::Unwritable`]; [`LogError::Lengths`] if the
/// columns differ in length.
pub fn write(path: &Path, log: &Log) -> Result<(), LogError> {
    check(path, log)?;
    let columns = log.columns();
    let n_rows = log.len();
    let mut meta = log.meta.clone();
    meta.rate_hz.get_or_insert(log.dt_s.recip());
    let names: Vec<Column> = std::iter::once(Column::Time).chain(columns.iter().map(|(column, _)| *column)).collect();
    let mut values = Vec::with_capacity(names.len());
    let fill = |row: usize, values: &mut Vec<f64>| {
        values.clear();
        values.push(log.time_s(row));
        values.extend(columns.iter().map(|(_, column)| column[row]));
    };
    let kind = Kind::of_extension(path).ok_or_else(|| LogError::UnknownKind { path: path.to_path_buf() })?;
    if kind == Kind::Csv {
        let mut writer = Writer::with_interval(path, &meta, &names, Some(log.dt_s))?;
        for row in 0..n_rows {
            fill(row, &mut values);
            writer.row(&values)?;
        }
        return writer.finish();
    }

    check_finite(path, log)?;
    let mut staged = Staged::create(path)?;
    let in_file = |column: Column, value: f64| value * 10f64.powi(-column.file_exponent());
    if kind == Kind::Npy {
        let rows = (0..n_rows).map(|row| {
            let mut values = Vec::with_capacity(names.len());
            fill(row, &mut values);
            for (value, &column) in values.iter_mut().zip(&names) {
                *value = in_file(column, *value);
            }
            NpyRow(values)
        });
        let written = write_npy(&mut staged.file, &names, n_rows, rows);
        written.map_err(|source| staged.unwritable(source))?;
    } else {
        staged.put(&mat5::header())?;
        for (key, value) in meta.entries() {
            // Only what is a quantity becomes a number: a seed or a version that looks like one is a name.
            let number = value.parse::<f64>().ok().filter(|_| NUMERIC_KEYS.contains(&key.as_str()));
            let out = match &number {
                Some(number) => mat5::Out::Real(std::slice::from_ref(number)),
                None => mat5::Out::Text(&value),
            };
            let variable = mat5::variable(&identifier(&key), &out);
            staged.put_variable(variable)?;
        }
        let time_s: Vec<f64> = (0..n_rows).map(|row| log.time_s(row)).collect();
        let time = std::iter::once((Column::Time, time_s.as_slice()));
        for (column, values_si) in time.chain(columns) {
            let values: Vec<f64> = values_si.iter().map(|&value| in_file(column, value)).collect();
            staged.put_variable(mat5::variable(column.file_name(), &mat5::Out::Real(&values)))?;
        }
    }
    staged.finish()
}

/// Whether all columns have one length.
pub(super) fn check(path: &Path, log: &Log) -> Result<(), LogError> {
    let n_rows = log.len();
    match log.columns().iter().find(|(_, values)| values.len() != n_rows) {
        Some((column, values)) => Err(LogError::Lengths {
            path: path.to_path_buf(),
            column: column.file_name().to_owned(),
            n: values.len(),
            other: Column::Command.file_name().to_owned(),
            n_other: n_rows,
        }),
        None => Ok(()),
    }
}

/// Whether there is no number that no reader would take.
pub(super) fn check_finite(path: &Path, log: &Log) -> Result<(), LogError> {
    let columns = log.columns();
    for row in 0..log.len() {
        if let Some((column, values)) = columns.iter().find(|(_, values)| !values[row].is_finite()) {
            return Err(LogError::NotFinite {
                path: path.to_path_buf(),
                place: Place::Sample(row as u64),
                column: column.file_name().to_owned(),
                value: values[row].to_string(),
            });
        }
    }
    Ok(())
}

/// Metadata that are quantities.
const NUMERIC_KEYS: [&str; 6] = ["rate_hz", "latency_us", "adc_lsb_um", "dac_lsb_V", "period_samples", "run_in_s"];

/// A name that MATLAB takes: letters, digits and underscores, at most 63, a letter first.
fn identifier(key: &str) -> String {
    let mut name: String = key.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
        name.insert(0, 'x');
    }
    name.truncate(63);
    name
}

/// Digits after the point for times on a grid: those of the interval and of the first time if they end, else enough
/// to keep the rounding below 1e-4 of a sample.
fn time_decimals(interval_s: f64, first_s: f64) -> usize {
    let ends_at = |value: f64| {
        (0..=MAX_TIME_DECIMALS).find(|&decimals| {
            let units = value.abs() * 10f64.powi(decimals as i32);
            (units - units.round()).abs() <= 1e-9 * units
        })
    };
    let fine = (4.0 - interval_s.log10()).ceil().clamp(0.0, 15.0) as usize;
    ends_at(interval_s).unwrap_or(fine).max(ends_at(first_s).unwrap_or(fine.max(MAX_TIME_DECIMALS)))
}

/// The shortest text that gives `value` back when read in the unit `10^exponent`.
pub(crate) fn shortest(value: f64, exponent: i32) -> String {
    let (mut line, mut scratch) = (Vec::new(), String::new());
    push_shortest(&mut line, &mut scratch, value, exponent);
    String::from_utf8_lossy(&line).into_owned()
}

/// Appends that text. The digits are the standard library's shortest ones; only the point moves.
fn push_shortest(line: &mut Vec<u8>, scratch: &mut String, value: f64, exponent: i32) {
    scratch.clear();
    // Writing to memory cannot fail, and the format below is `d.ddde-n`, with a sign if negative.
    let _ = write!(scratch, "{value:e}");
    let (mantissa, printed) = scratch.split_once('e').unwrap_or((scratch, "0"));
    let mut mantissa = mantissa.as_bytes();
    if let Some(rest) = mantissa.strip_prefix(b"-") {
        line.push(b'-');
        mantissa = rest;
    }
    let (head, tail) = match mantissa {
        [head, b'.', tail @ ..] => (*head, tail),
        [head, tail @ ..] => (*head, tail),
        [] => (b'0', [].as_slice()),
    };
    if head == b'0' {
        line.push(b'0');
        return;
    }
    let power = printed.parse::<i32>().unwrap_or(0) - exponent;
    match power {
        0..=16 => {
            let n_integer = power as usize;
            line.push(head);
            let (integer, fraction) = tail.split_at(n_integer.min(tail.len()));
            line.extend_from_slice(integer);
            line.extend(std::iter::repeat_n(b'0', n_integer - integer.len()));
            if !fraction.is_empty() {
                line.push(b'.');
                line.extend_from_slice(fraction);
            }
        }
        -6..=-1 => {
            line.extend_from_slice(b"0.");
            line.extend(std::iter::repeat_n(b'0', (-power - 1) as usize));
            line.push(head);
            line.extend_from_slice(tail);
        }
        _ => {
            line.push(head);
            if !tail.is_empty() {
                line.push(b'.');
                line.extend_from_slice(tail);
            }
            let _ = write!(line, "e{power}");
        }
    }
}

/// A row of a structured array, all f64.
struct NpyRow(Vec<f64>);

/// Writes an [`NpyRow`].
struct NpyRowWriter;

impl npyz::TypeWrite for NpyRowWriter {
    type Value = NpyRow;

    fn write_one<W: Write>(&self, mut writer: W, row: &NpyRow) -> io::Result<()> {
        row.0.iter().try_for_each(|value| writer.write_all(&value.to_le_bytes()))
    }
}

impl npyz::Serialize for NpyRow {
    type TypeWriter = NpyRowWriter;

    fn writer(_: &npyz::DType) -> Result<NpyRowWriter, npyz::DTypeError> {
        Ok(NpyRowWriter)
    }
}

fn write_npy(
    to: &mut impl Write,
    columns: &[Column],
    n_rows: usize,
    rows: impl Iterator<Item = NpyRow>,
) -> io::Result<()> {
    let real: npyz::TypeStr = "<f8".parse().map_err(io::Error::other)?;
    let fields = columns.iter().map(|column| npyz::Field {
        name: column.file_name().to_owned(),
        dtype: npyz::DType::new_scalar(real.clone()),
    });
    let mut writer = npyz::WriteOptions::new()
        .dtype(npyz::DType::Record(fields.collect()))
        .shape(&[n_rows as u64])
        .writer(to)
        .begin_nd()?;
    writer.extend(rows)?;
    writer.finish()
}

/// The file of a log, with its errors.
#[derive(Debug)]
pub(super) struct Staged {
    path: PathBuf,
    pub(super) file: WholeFile,
}

impl Staged {
    pub(super) fn create(path: &Path) -> Result<Self, LogError> {
        let file = WholeFile::create(path).map_err(|source| match source.kind() {
            io::ErrorKind::IsADirectory => LogError::IsDirectory { path: path.to_path_buf() },
            _ => LogError::Unwritable { path: path.to_path_buf(), source },
        })?;
        Ok(Self { path: path.to_path_buf(), file })
    }

    /// A new file under its own name.
    fn live(path: &Path) -> Result<Self, LogError> {
        let unwritable = |source| LogError::Unwritable { path: path.to_path_buf(), source };
        Ok(Self { path: path.to_path_buf(), file: WholeFile::live(path).map_err(unwritable)? })
    }

    pub(super) fn unwritable(&self, source: io::Error) -> LogError {
        LogError::Unwritable { path: self.path.clone(), source }
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), LogError> {
        self.file.write_all(bytes).map_err(|source| self.unwritable(source))
    }

    fn put_variable(&mut self, variable: Option<Vec<u8>>) -> Result<(), LogError> {
        let bytes = variable.ok_or_else(|| {
            self.unwritable(io::Error::new(io::ErrorKind::FileTooLarge, "a MAT v5 variable holds less than 2 GB"))
        })?;
        self.put(&bytes)
    }

    pub(super) fn finish(self) -> Result<(), LogError> {
        let Self { path, file } = self;
        file.finish().map_err(|source| LogError::Unwritable { path, source })
    }
}
