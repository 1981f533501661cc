//! What can go wrong with a log, with the facts a person needs to put it right.
//!
//! Every message is one line: what, where (file, line or sample, column), what to do. Nothing here prints.

use std::fmt;
use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Where in a log: text files have lines, binary ones have samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line of a text file, counted from 1, comments and blank lines included: what an editor shows.
    Line(u64),
    /// Sample of a binary file, counted from 0: what numpy and row k of the contract count.
    Sample(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(n) => write!(f, "line {n}"),
            Self::Sample(n) => write!(f, "sample {n}"),
        }
    }
}

/// Why a log could not be read or written. `Display` is one line.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file does not exist.
    #[error("{}: no such file; check the path", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// The operating system does not let us read the file.
    #[error("{}: no permission to read it; check owner and mode", path.display())]
    NoPermission {
        /// The file.
        path: PathBuf,
    },
    /// The path is a directory.
    #[error("{}: is a directory; name a log file in it", path.display())]
    IsDirectory {
        /// The path.
        path: PathBuf,
    },
    /// Reading failed for another reason (disk, network).
    #[error("{}: reading failed: {source}; check the disk and try again", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// Writing failed; nothing was left behind.
    #[error("{}: cannot be written: {source}; nothing was left there, name another place with --out", path.display())]
    Unwritable {
        /// The file that should have been written.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A log that is read while it is written can't grow any more; its rows so far stay.
    #[error("{}: no row can be added: {source}; those before stay there, make room or name another place with --out", path.display())]
    Ended {
        /// The log.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file holds no byte, or nothing but blank lines and comments.
    #[error("{}: is empty; a log has a header line and at least 16 samples", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is neither text nor one of the binary formats.
    #[error("{}: is not a text file ({what} at byte {offset}); logs are CSV, NPY or MAT v5", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// What was found that text does not have.
        what: &'static str,
        /// Where, counted from 0.
        offset: u64,
    },
    /// The first line that is not a comment holds numbers.
    #[error("{}, line {line}: numbers ({text}) where the header should be; add a first line with the column names", path.display())]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: u64,
        /// Its beginning.
        text: String,
    },
    /// A metadata line has a known key and a value that cannot be used.
    #[error("{}{}: metadata {key}: `{text}` is not {expected}; correct or remove it", path.display(), line.map_or(String::new(), |line| format!(", line {line}")))]
    MetaValue {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1; `None` in a binary file.
        line: Option<u64>,
        /// The key.
        key: String,
        /// The value as written.
        text: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A column that is needed is not in the file.
    #[error("{}: no column `{name}` ({wanted}); it has {exists}; map one with --columns {wanted}=NAME{}", path.display(), if *wanted == "time" { " or give --rate HZ" } else { "" })]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The canonical key.
        wanted: &'static str,
        /// The name looked for.
        name: String,
        /// The columns there are, joined by commas.
        exists: String,
    },
    /// Two columns answer to the same name.
    #[error("{}: {n} columns answer to `{name}` ({wanted}); rename them or give the full name with --columns {wanted}=NAME", path.display())]
    AmbiguousColumn {
        /// The file.
        path: PathBuf,
        /// The canonical key.
        wanted: &'static str,
        /// The name looked for.
        name: String,
        /// How many there are.
        n: usize,
    },
    /// A row has more or fewer fields than the header.
    #[error("{}, line {line}: {found} fields where the header has {expected}; the line is cut or has a stray separator", path.display())]
    RaggedRow {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: u64,
        /// Fields in this row.
        found: usize,
        /// Fields in the header.
        expected: usize,
    },
    /// A cell that should hold a number holds something else.
    #[error("{}, line {line}, column {column}: `{text}` is not a number; {}", path.display(), number_advice(text))]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: u64,
        /// The column's name in the file.
        column: String,
        /// The cell's text.
        text: String,
    },
    /// A number is NaN or infinite.
    #[error("{}, {place}, column {column}: {value} is not finite; cut the log there or repair the sample", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Where.
        place: Place,
        /// The column's name in the file.
        column: String,
        /// The value as written.
        value: String,
    },
    /// Samples are missing between two rows.
    #[error("{}, {place}: {n_missing} row{} lost before it (row {row} should be here, the time jumps from {from_s} s to {to_s} s); record again or cut the log there", path.display(), if *n_missing == 1 { "" } else { "s" })]
    LostRows {
        /// The file.
        path: PathBuf,
        /// The first row after the hole.
        place: Place,
        /// Number of the first lost row, counted from 0.
        row: u64,
        /// How many are missing.
        n_missing: u64,
        /// Time of the row before, seconds.
        from_s: f64,
        /// Time of the row after, seconds.
        to_s: f64,
    },
    /// A time is not later than the one before.
    #[error("{}, {place}: time {}: {to_s} s after {from_s} s; remove the row, or use --rate HZ in place of the time column", path.display(), if to_s == from_s { "is repeated" } else { "goes backwards" })]
    TimeNotIncreasing {
        /// The file.
        path: PathBuf,
        /// The row.
        place: Place,
        /// Time of the row before, seconds.
        from_s: f64,
        /// Its own time, seconds.
        to_s: f64,
    },
    /// A time lies off every uniform grid through the rows before.
    #[error("{}, {place}: time {time_s} s is {deviation_percent:.1} % of a sample off the uniform grid (1 % is allowed, plus the rounding of the printed time); resample the log, or use --rate HZ if only the time stamps jitter", path.display())]
    NotUniform {
        /// The file.
        path: PathBuf,
        /// The row.
        place: Place,
        /// Its time, seconds.
        time_s: f64,
        /// Distance from the grid in percent of a sample.
        deviation_percent: f64,
    },
    /// The log is too short to say anything about a plant.
    #[error("{}: only {n_samples} samples; at least 16 are needed", path.display())]
    TooFewSamples {
        /// The file.
        path: PathBuf,
        /// How many there are.
        n_samples: u64,
    },
    /// An NPY file that breaks its own format.
    #[error("{}: broken NPY file: {what}; save it again with numpy.save", path.display())]
    NpyBroken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// An NPY array that is not a table.
    #[error("{}: the array has shape {shape}; save one realization as (samples, columns), or as a structured array with one field per column", path.display())]
    NpyShape {
        /// The file.
        path: PathBuf,
        /// The shape as Python prints it.
        shape: String,
    },
    /// An NPY column holds something that is not a real number.
    #[error("{}, column {column}: {dtype} is not a real number type; save it as float64", path.display())]
    NpyType {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Its type as numpy names it.
        dtype: String,
    },
    /// A MAT file that breaks its own format.
    #[error("{}: broken MAT file: {what} at byte {offset}; save it again", path.display())]
    MatBroken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: &'static str,
        /// Offset in the file, or inside the compressed variable.
        offset: usize,
    },
    /// A MAT v7.3 file, which is HDF5.
    #[error("{}: is a MAT v7.3 (HDF5) file; save it in MATLAB with save(..., '-v7')", path.display())]
    Mat73 {
        /// The file.
        path: PathBuf,
    },
    /// A MAT variable that is not a real vector.
    #[error("{}, variable {column}: is {found}, not a real vector; save one vector per column", path.display())]
    MatNotVector {
        /// The file.
        path: PathBuf,
        /// The variable.
        column: String,
        /// What it is.
        found: String,
    },
    /// Two columns were captured in different rasters.
    #[error("{}: {column} and {other} were captured in different rasters; capture them in one", path.display())]
    MatRasters {
        /// The file.
        path: PathBuf,
        /// One column.
        column: String,
        /// The other.
        other: String,
    },
    /// Two columns of one log differ in length.
    #[error("{}: {column} has {n} samples and {other} has {n_other}; a log needs equal lengths", path.display())]
    Lengths {
        /// The file.
        path: PathBuf,
        /// One column.
        column: String,
        /// Its length.
        n: usize,
        /// The other.
        other: String,
        /// Its length.
        n_other: usize,
    },
    /// The file has neither a time column nor a rate.
    #[error("{}: no time column and no rate; give --rate HZ", path.display())]
    NoRate {
        /// The file.
        path: PathBuf,
    },
    /// `--columns` or `--scale` names something that is no column of a log.
    #[error("{option}: `{key}` is no column of a log; use one of {known}")]
    UnknownKey {
        /// The option's name.
        option: &'static str,
        /// The key given.
        key: String,
        /// The keys there are, joined by commas.
        known: String,
    },
    /// A column's name ends in a unit that is not read from names.
    #[error(
        "--columns {key}={name}: {unit} is no unit of this that is known by its name; say what one of it is in SI, --scale {key}=FACTOR"
    )]
    OtherUnit {
        /// The column's name.
        name: String,
        /// Its ending.
        unit: String,
        /// The canonical key.
        key: &'static str,
    },
    /// A number given on the command line cannot be used.
    #[error("{option}: {value} cannot be used; give a finite number {expected}")]
    BadOption {
        /// The option, with its key where it has one.
        option: String,
        /// The value given.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// A log is written by extension, and this one is not known.
    #[error("{}: unknown kind of log; end its name in .csv, .npy or .mat, or .parquet or .mf4 where they were built in", path.display())]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// A kind of log that this program was built without.
    #[error("{}: this program was built without {feature}: build it with --features {feature}, or end the name in .csv, .npy or .mat", path.display())]
    NotBuilt {
        /// The file.
        path: PathBuf,
        /// The cargo feature that brings it.
        feature: &'static str,
    },
    /// A row handed to the writer has the wrong number of values.
    #[error("{}: a row of {found} values for {expected} columns; a mistake of the program that writes it", path.display())]
    RowWidth {
        /// The file.
        path: PathBuf,
        /// Values handed over.
        found: usize,
        /// Columns declared.
        expected: usize,
    },
}

impl LogError {
    /// Whether the call is at fault (exit code 2) and not a file (exit code 3).
    pub fn is_wrong_call(&self) -> bool {
        matches!(
            self,
            Self::UnknownKey { .. }
                | Self::OtherUnit { .. }
                | Self::BadOption { .. }
                | Self::UnknownKind { .. }
                | Self::NotBuilt { .. }
        )
    }

    /// Turns what the operating system said on opening or reading `path` into the line a user can act on.
    pub(crate) fn from_read(path: &std::path::Path, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            io::ErrorKind::NotFound => Self::NotFound { path },
            io::ErrorKind::PermissionDenied => Self::NoPermission { path },
            io::ErrorKind::IsADirectory => Self::IsDirectory { path },
            _ => Self::Read { path, source },
        }
    }
}

/// What to do about a cell that is no number. A decimal comma is not guessed at: `1,234` may be either.
fn number_advice(text: &str) -> &'static str {
    if text.is_empty() {
        "the cell is empty: fill it or cut the log there"
    } else if text.contains(',') && text.chars().all(|c| c.is_ascii_digit() || "+-,.eE".contains(c)) {
        "write decimal points, not commas"
    } else {
        "correct the cell or cut the log there"
    }
}

/// Text from a file, made fit for one line of a message: no control characters, at most 40 characters.
pub(crate) fn excerpt(text: &str) -> String {
    let mut chars = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let mut short: String = chars.by_ref().take(40).collect();
    if chars.next().is_some() {
        short.push_str("...");
    }
    short
}
