//! CSV logs, streamed: `# key: value` lines, a header, numbers.
//!
//! Splitting is the `csv` crate's. Around it, [`Lines`] makes every line end a single `\n` (so that its line numbers
//! are an editor's) and refuses what is not text before it can fill the memory.
//!
//! Quotes are taken off cells but do not protect a separator inside a row of data: a stray quote would otherwise
//! swallow the rest of a 2 GB file. In the header they do protect.
//!
//! A last row that lacks both cells and its end is what a killed recording leaves of a write: it is left out.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use super::ReadOptions;
use super::column::{Column, N_READ, Scale, Wanted, others};
use super::error::{LogError, Place, excerpt};
use super::grid::TimePrint;
use super::meta::Meta;
use super::source::{Opened, RawRow, Source};

/// No line of a log is longer; a binary file soon has one that is.
const MAX_LINE_BYTES: u64 = 1 << 16;

/// Bytes read at once.
const BUFFER_BYTES: usize = 1 << 16;

/// Opens a CSV log.
pub(crate) fn open<R: Read + Send + 'static>(
    path: &Path,
    reader: R,
    options: &ReadOptions,
    wanted: &[Wanted],
) -> Result<Opened, LogError> {
    let mut lines = BufReader::with_capacity(BUFFER_BYTES, Lines::new(reader));
    let mut meta = Meta::default();
    let mut line = 0;
    let header = loop {
        let Some(text) = next_line(path, &mut lines)? else {
            return Err(LogError::Empty { path: path.to_path_buf() });
        };
        line += 1;
        match text.strip_prefix('#') {
            Some(comment) => {
                // A comment without a colon is a remark, and a remark is nobody's error.
                if let Some((key, value)) = comment.split_once(':') {
                    meta.set(path, Some(line), key.trim(), value.trim())?;
                }
            }
            None if is_blank(&text) => {}
            None => break text,
        }
    };
    let separator = separator_of(&header);
    let names = split_header(&header, separator);
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        return Err(LogError::NoHeader { path: path.to_path_buf(), line, text: excerpt(header.trim()) });
    }

    let mut fields = Vec::new();
    let mut has = [false; N_READ];
    for want in wanted {
        let mut hits = names.iter().enumerate().filter(|(_, name)| **name == want.name).map(|(idx, _)| idx);
        let Some(idx) = hits.next() else {
            if want.is_required() {
                return Err(LogError::MissingColumn {
                    path: path.to_path_buf(),
                    wanted: want.column.key(),
                    name: want.name.clone(),
                    exists: told(&names),
                });
            }
            continue;
        };
        let n_more = hits.count();
        if n_more > 0 {
            return Err(LogError::AmbiguousColumn {
                path: path.to_path_buf(),
                wanted: want.column.key(),
                name: want.name.clone(),
                n: n_more + 1,
            });
        }
        has[want.column.idx()] = true;
        fields.push(Field {
            idx,
            column: want.column,
            name: want.name.clone(),
            scale: Scale::of(want.column, &want.name, None, options)?,
        });
    }
    let no_time = wanted
        .iter()
        .find(|want| want.column == Column::Time)
        .filter(|_| !has[Column::Time.idx()] && meta.rate_hz.is_none());
    if let Some(want) = no_time {
        return Err(LogError::MissingColumn {
            path: path.to_path_buf(),
            wanted: want.column.key(),
            name: want.name.clone(),
            exists: told(&names),
        });
    }

    let rows = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .quoting(false)
        .delimiter(separator)
        .comment(Some(b'#'))
        .buffer_capacity(BUFFER_BYTES)
        .from_reader(lines);
    Ok(Opened {
        meta,
        rate_hz: None,
        has,
        others: others(&names, wanted),
        rows: Box::new(CsvRows {
            path: path.to_path_buf(),
            rows,
            record: csv::ByteRecord::new(),
            ahead: csv::ByteRecord::new(),
            fields,
            n_fields: names.len(),
            header_line: line,
            blank_line: None,
            scratch: String::new(),
        }),
    })
}

/// A column to be read.
struct Field {
    idx: usize,
    column: Column,
    name: String,
    scale: Scale,
}

struct CsvRows<R> {
    path: PathBuf,
    rows: csv::Reader<BufReader<Lines<R>>>,
    record: csv::ByteRecord,
    ahead: csv::ByteRecord,
    fields: Vec<Field>,
    n_fields: usize,
    header_line: u64,
    /// The first row of nothing but separators, as spreadsheets leave them at the end; an error if data follow.
    blank_line: Option<u64>,
    scratch: String,
}

impl<R: Read + Send> Source for CsvRows<R> {
    fn next_row(&mut self) -> Result<Option<RawRow>, LogError> {
        let line = loop {
            let more = self.rows.read_byte_record(&mut self.record).map_err(|error| from_csv(&self.path, error))?;
            if !more {
                return Ok(None);
            }
            // After the row rather than before it: the crate counts skipped lines to the row that follows them.
            // Every line ends in one `\n` here, the last one too.
            let line = self.header_line + self.rows.position().line().saturating_sub(1);
            if !self.record.iter().all(|cell| cell.trim_ascii().is_empty()) {
                break line;
            }
            self.blank_line.get_or_insert(line);
        };
        let line = self.blank_line.unwrap_or(line);
        let found = self.record.len();
        // One separator too many at the end of every line is common and harmless; a missing cell is not.
        let extra = found.checked_sub(self.n_fields);
        let is_empty = |cell: &[u8]| cell.trim_ascii().is_empty();
        let trailing = extra == Some(1) && self.record.get(found - 1).is_some_and(is_empty);
        let is_read = |cell: usize| self.fields.iter().any(|field| field.idx == cell);
        let is_short = match extra {
            Some(0) => is_read(found - 1) && self.record.get(found - 1).is_some_and(is_empty),
            _ => extra.is_none(),
        };
        if is_short && self.is_cut_off()? {
            return Ok(None);
        }
        if extra != Some(0) && !trailing && self.blank_line.is_none() {
            return Err(LogError::RaggedRow { path: self.path.clone(), line, found, expected: self.n_fields });
        }
        let mut row = RawRow {
            place: Place::Line(line),
            values: [0.0; N_READ],
            print: TimePrint::Binary { epsilon: f64::EPSILON },
        };
        for field in &self.fields {
            let cell = match self.blank_line {
                Some(_) => &[],
                None => bare(self.record.get(field.idx).unwrap_or_default()),
            };
            let text = str::from_utf8(cell).ok();
            let value = text.and_then(|text| field.scale.parse(text, &mut self.scratch));
            let Some((text, value)) = text.zip(value) else {
                return Err(LogError::NotANumber {
                    path: self.path.clone(),
                    line,
                    column: excerpt(&field.name),
                    text: excerpt(&String::from_utf8_lossy(cell)),
                });
            };
            if !value.is_finite() {
                return Err(LogError::NotFinite {
                    path: self.path.clone(),
                    place: row.place,
                    column: excerpt(&field.name),
                    value: excerpt(text),
                });
            }
            if field.column == Column::Time {
                row.print = match field.scale {
                    Scale::Power(exponent) => TimePrint::of_text(text, exponent),
                    // The unit is no power of ten: its logarithm, rounded up, is coarse enough.
                    Scale::Factor(factor) => TimePrint::of_text(text, factor.abs().log10().ceil() as i32),
                };
            }
            row.values[field.column.idx()] = value;
        }
        Ok(Some(row))
    }
}

impl<R: Read> CsvRows<R> {
    /// Whether the row just read is the last and lacks its end: what wrote it was killed in the middle, and nothing before it is in doubt.
    fn is_cut_off(&mut self) -> Result<bool, LogError> {
        if !self.rows.get_ref().get_ref().lacked_end {
            return Ok(false);
        }
        let is_last = !self.rows.read_byte_record(&mut self.ahead).map_err(|error| from_csv(&self.path, error))?;
        Ok(is_last)
    }
}

/// A cell without the spaces and quotes around it.
fn bare(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    cell.strip_prefix(b"\"").and_then(|cell| cell.strip_suffix(b"\"")).map_or(cell, <[u8]>::trim_ascii)
}

/// Whether a line holds nothing but spaces and separators.
fn is_blank(line: &str) -> bool {
    line.chars().all(|c| c.is_whitespace() || c == ',' || c == ';')
}

/// The comma, unless the header has none and does have another separator.
fn separator_of(header: &str) -> u8 {
    match header {
        header if header.contains(',') => b',',
        header if header.contains(';') => b';',
        header if header.contains('\t') => b'\t',
        _ => b',',
    }
}

fn split_header(header: &str, separator: u8) -> Vec<String> {
    let mut record = csv::StringRecord::new();
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(separator)
        .trim(csv::Trim::All)
        .from_reader(header.as_bytes());
    // Text in memory that is valid UTF-8 cannot fail; were it to, no column would be found, which is reported.
    let _ = reader.read_record(&mut record);
    let mut names: Vec<String> = record.iter().map(|name| name.trim().to_owned()).collect();
    // A separator at the end of the line makes no column.
    if names.len() > 1 && names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    names
}

/// The names of a header for a message. One name with blanks in it is a table that blanks part.
fn told(names: &[String]) -> String {
    match names {
        [only] if only.contains(char::is_whitespace) => {
            format!(
                "one column, {}, since a comma, a semicolon or a tab parts columns and blanks do not",
                excerpt(only)
            )
        }
        _ => excerpt_list(names),
    }
}

/// The names of the columns for a message, the first twenty of them.
pub fn excerpt_list<S: AsRef<str>>(names: &[S]) -> String {
    let mut list: Vec<String> = names.iter().take(20).map(|name| excerpt(name.as_ref())).collect();
    if names.len() > 20 {
        list.push(format!("... ({} in all)", names.len()));
    }
    if list.is_empty() {
        return "none".to_owned();
    }
    list.join(", ")
}

/// The next line without its end, `None` at the end of the file.
///
/// UTF-8, or Latin-1 where it is not that: old loggers write a micro sign as one byte.
fn next_line<R: Read>(path: &Path, lines: &mut BufReader<Lines<R>>) -> Result<Option<String>, LogError> {
    let mut bytes = Vec::new();
    lines.read_until(b'\n', &mut bytes).map_err(|error| from_io(path, error))?;
    if bytes.is_empty() {
        return Ok(None);
    }
    if bytes.last() == Some(&b'\n') {
        bytes.pop();
    }
    Ok(Some(match String::from_utf8(bytes) {
        Ok(text) => text,
        Err(error) => error.as_bytes().iter().map(|&byte| char::from(byte)).collect(),
    }))
}

fn from_csv(path: &Path, error: csv::Error) -> LogError {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => from_io(path, error),
        // With flexible byte records nothing else is reported; should that change, it is a failed read.
        kind => LogError::from_read(path, io::Error::other(format!("{kind:?}"))),
    }
}

fn from_io(path: &Path, error: io::Error) -> LogError {
    match error.get_ref().and_then(|inner| inner.downcast_ref::<NotText>()) {
        Some(fault) => LogError::NotText { path: path.to_path_buf(), what: fault.what, offset: fault.offset },
        None => LogError::from_read(path, error),
    }
}

/// Carried through `io::Error`, which is all that a `Read` can return.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("{what} at byte {offset}")]
struct NotText {
    what: &'static str,
    offset: u64,
}

/// Text with every line end made one `\n`, the last line's too, without a byte order mark.
struct Lines<R> {
    inner: R,
    raw: Vec<u8>,
    at: usize,
    offset: u64,
    line_bytes: u64,
    after_cr: bool,
    ended: bool,
    /// The file ended in the middle of a line.
    lacked_end: bool,
    fault: Option<NotText>,
}

impl<R: Read> Lines<R> {
    fn new(inner: R) -> Self {
        Self {
            inner,
            raw: Vec::new(),
            at: 0,
            offset: 0,
            line_bytes: 0,
            after_cr: false,
            ended: false,
            lacked_end: false,
            fault: None,
        }
    }

    /// Reads the next piece. At the start of the file it is at least as long as a byte order mark.
    fn fill(&mut self) -> io::Result<()> {
        let at_start = self.offset == 0;
        self.raw.resize(BUFFER_BYTES, 0);
        self.at = 0;
        let mut n = 0;
        while n < if at_start { 3 } else { 1 } {
            match self.inner.read(&mut self.raw[n..]) {
                Ok(0) => break,
                Ok(more) => n += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.raw.clear();
                    return Err(error);
                }
            }
        }
        self.raw.truncate(n);
        if at_start {
            if self.raw.starts_with(b"\xef\xbb\xbf") {
                self.at = 3;
                self.offset = 3;
            } else if self.raw.starts_with(b"\xff\xfe") || self.raw.starts_with(b"\xfe\xff") {
                self.fault = Some(NotText { what: "UTF-16, save it as UTF-8", offset: 0 });
            }
        }
        Ok(())
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut n = 0;
        while n == 0 && !out.is_empty() {
            if let Some(fault) = self.fault {
                return Err(io::Error::new(io::ErrorKind::InvalidData, fault));
            }
            if self.at == self.raw.len() {
                if self.ended {
                    return Ok(0);
                }
                self.fill()?;
                if self.at == self.raw.len() && self.fault.is_none() {
                    self.ended = true;
                    // The last line may lack its end; the file may also be empty, or end in a line's end.
                    if self.line_bytes > 0 {
                        self.lacked_end = true;
                        out[0] = b'\n';
                        return Ok(1);
                    }
                }
                continue;
            }
            while n < out.len() && self.at < self.raw.len() {
                let byte = self.raw[self.at];
                self.at += 1;
                self.offset += 1;
                let was_cr = std::mem::replace(&mut self.after_cr, byte == b'\r');
                match byte {
                    b'\n' if was_cr => continue,
                    b'\n' | b'\r' => {
                        self.line_bytes = 0;
                        out[n] = b'\n';
                    }
                    _ => {
                        self.line_bytes += 1;
                        out[n] = byte;
                        let what = match byte {
                            0..=8 | 14..=31 => "a control byte",
                            _ if self.line_bytes > MAX_LINE_BYTES => "a line without end",
                            _ => {
                                n += 1;
                                continue;
                            }
                        };
                        // What came before is still delivered, so that an error in it is found first.
                        self.fault = Some(NotText { what, offset: self.offset - 1 });
                        self.at = self.raw.len();
                        continue;
                    }
                }
                n += 1;
            }
        }
        Ok(n)
    }
}
