//! What a reader of one file format gives to the common part: rows in SI, not yet checked for uniform time.

use super::column::{Column, N_READ};
use super::error::{LogError, Place};
use super::grid::TimePrint;
use super::meta::Meta;

/// One row as a file has it, in SI.
#[derive(Clone, Debug)]
pub(crate) struct RawRow {
    pub(crate) place: Place,
    /// By [`Column::idx`]; only the columns that the file has are meaningful.
    pub(crate) values: [f64; N_READ],
    /// How exactly the time is known.
    pub(crate) print: TimePrint,
}

/// What the beginning of a file says.
pub(crate) struct Opened {
    pub(crate) meta: Meta,
    /// Rate told by the format itself (dSPACE's sampling period), in place of a time column.
    pub(crate) rate_hz: Option<f64>,
    /// By [`Column::idx`].
    pub(crate) has: [bool; N_READ],
    /// Names of columns that are none of a log's.
    pub(crate) others: Vec<String>,
    pub(crate) rows: Box<dyn Source>,
}

impl Opened {
    pub(crate) fn has(&self, column: Column) -> bool {
        self.has[column.idx()]
    }
}

/// Rows of a file, one after the other.
pub(crate) trait Source: Send {
    /// The next row, finite in all its columns; `None` at the end.
    fn next_row(&mut self) -> Result<Option<RawRow>, LogError>;
}
