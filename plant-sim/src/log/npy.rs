//! NPY logs, streamed: a structured array of one dimension, or a table (samples, columns).
//!
//! The header and the numbers are `npyz`'s. Its header parser trusts the file, so [`guarded_header`] looks first:
//! a long or deeply nested header overflows its stack or takes exponential time, and a shape whose product overflows
//! panics in a debug build.

use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

use npyz::{DType, Deserialize, NpyHeader, Order, TypeRead};

use super::ReadOptions;
use super::column::{Column, N_READ, Scale, Wanted, others};
use super::csv_file::excerpt_list;
use super::error::{LogError, Place, excerpt};
use super::grid::TimePrint;
use super::meta::Meta;
use super::source::{Opened, RawRow, Source};

/// The first bytes of every NPY file.
pub(crate) const MAGIC: &[u8] = b"\x93NUMPY";

/// Longest header accepted. numpy itself reads 10 000 characters unless told otherwise.
const MAX_HEADER_BYTES: usize = 1 << 14;

/// Deepest nesting accepted: a dictionary, a list of fields, a field, its shape are four.
const MAX_NESTING: usize = 6;

/// Longest row accepted, so that a header alone cannot ask for gigabytes.
const MAX_ROW_BYTES: usize = 1 << 20;

/// Turns the bytes of one number into an f64.
type Decode = Box<dyn Fn(&[u8]) -> io::Result<f64> + Send>;

/// Opens an NPY log.
///
/// A structured array is mapped by field name; a table of two dimensions by column index (`--columns command=0`) and
/// has no column at all unless mapped. NPY has no room for metadata.
pub(crate) fn open<R: Read + Send + 'static>(
    path: &Path,
    mut reader: R,
    options: &ReadOptions,
    wanted: &[Wanted],
) -> Result<Opened, LogError> {
    let header = guarded_header(path, &mut reader)?;
    let shape = header.shape().to_vec();
    let bad_shape = || LogError::NpyShape {
        path: path.to_path_buf(),
        shape: match shape.as_slice() {
            [one] => format!("({one},)"),
            many => format!("({})", many.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
        },
    };
    // Offset and type of every column in a row, by name.
    let mut columns: Vec<(String, usize, DType)> = Vec::new();
    let mut row_bytes = 0usize;
    let (n_rows, table) = match (header.dtype(), shape.as_slice()) {
        (DType::Record(fields), [n]) => {
            for field in fields {
                let n_bytes = field.dtype.num_bytes().ok_or_else(bad_shape)?;
                columns.push((field.name, row_bytes, field.dtype));
                row_bytes = row_bytes.checked_add(n_bytes).ok_or_else(bad_shape)?;
            }
            (*n, false)
        }
        (dtype @ DType::Plain(_), [n, n_columns]) => {
            let n_bytes = dtype.num_bytes().ok_or_else(bad_shape)?;
            // More columns than that are more likely samples: a transposed table.
            if *n_columns > 1024 {
                return Err(bad_shape());
            }
            for idx in 0..*n_columns {
                columns.push((idx.to_string(), row_bytes, dtype.clone()));
                row_bytes = row_bytes.saturating_add(n_bytes);
            }
            (*n, true)
        }
        _ => return Err(bad_shape()),
    };
    if row_bytes > MAX_ROW_BYTES {
        return Err(bad_shape());
    }

    let names: Vec<&str> = columns.iter().map(|column| column.0.as_str()).collect();
    let mut fields = Vec::new();
    let mut has = [false; N_READ];
    for want in wanted {
        let mut hits = columns.iter().filter(|column| column.0 == want.name);
        let Some((name, offset, dtype)) = hits.next() else {
            // Without a rate, a file without time is asked for one or the other.
            if want.is_required() || want.column == Column::Time {
                return Err(LogError::MissingColumn {
                    path: path.to_path_buf(),
                    wanted: want.column.key(),
                    name: want.name.clone(),
                    exists: if table {
                        format!("columns 0 to {} without names", names.len().saturating_sub(1))
                    } else {
                        excerpt_list(&names)
                    },
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
        let (decode, epsilon) = decoder(dtype).ok_or_else(|| LogError::NpyType {
            path: path.to_path_buf(),
            column: excerpt(name),
            dtype: excerpt(&dtype.descr()),
        })?;
        has[want.column.idx()] = true;
        fields.push(Field {
            column: want.column,
            name: name.clone(),
            from: *offset,
            to: offset + dtype.num_bytes().unwrap_or(0),
            // A mere index carries no unit.
            scale: Scale::of(want.column, &want.name, None, options)?,
            decode,
            epsilon,
        });
    }

    let rows: Box<dyn Read + Send> = if table && header.order() == Order::Fortran && columns.len() > 1 {
        let n_bytes = columns[0].2.num_bytes().unwrap_or(0);
        Box::new(Cursor::new(transposed(path, reader, n_rows, columns.len(), n_bytes)?))
    } else {
        Box::new(io::BufReader::with_capacity(1 << 16, reader))
    };
    Ok(Opened {
        meta: Meta::default(),
        rate_hz: None,
        has,
        others: others(columns.iter().map(|(name, ..)| name), wanted),
        rows: Box::new(NpyRows {
            path: path.to_path_buf(),
            rows,
            bytes: vec![0; row_bytes],
            fields,
            n_rows,
            n_read: 0,
        }),
    })
}

/// A column to be read.
struct Field {
    column: Column,
    name: String,
    from: usize,
    to: usize,
    scale: Scale,
    decode: Decode,
    epsilon: f64,
}

struct NpyRows {
    path: PathBuf,
    rows: Box<dyn Read + Send>,
    bytes: Vec<u8>,
    fields: Vec<Field>,
    n_rows: u64,
    n_read: u64,
}

impl Source for NpyRows {
    fn next_row(&mut self) -> Result<Option<RawRow>, LogError> {
        if self.n_read == self.n_rows {
            return Ok(None);
        }
        self.rows.read_exact(&mut self.bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => LogError::NpyBroken {
                path: self.path.clone(),
                what: format!("it ends after sample {} of {}", self.n_read, self.n_rows),
            },
            _ => LogError::from_read(&self.path, error),
        })?;
        let mut row = RawRow {
            place: Place::Sample(self.n_read),
            values: [0.0; N_READ],
            print: TimePrint::Binary { epsilon: f64::EPSILON },
        };
        self.n_read += 1;
        for field in &self.fields {
            // The slice is within the row by construction; a decoder that wants more would be a broken type.
            let value = (field.decode)(&self.bytes[field.from..field.to])
                .map_err(|error| LogError::from_read(&self.path, error))?;
            let value = field.scale.apply(value);
            if !value.is_finite() {
                return Err(LogError::NotFinite {
                    path: self.path.clone(),
                    place: row.place,
                    column: excerpt(&field.name),
                    value: value.to_string(),
                });
            }
            if field.column == Column::Time {
                row.print = TimePrint::Binary { epsilon: field.epsilon };
            }
            row.values[field.column.idx()] = value;
        }
        Ok(Some(row))
    }
}

/// Reads the header after making sure that `npyz` can take it.
fn guarded_header(path: &Path, reader: &mut impl Read) -> Result<NpyHeader, LogError> {
    let broken = |what: &str| LogError::NpyBroken { path: path.to_path_buf(), what: excerpt(what) };
    let mut head = Vec::new();
    let mut take = |n: usize, head: &mut Vec<u8>| {
        let from = head.len();
        head.resize(from + n, 0);
        reader.read_exact(&mut head[from..]).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => broken("it ends within the header"),
            _ => LogError::from_read(path, error),
        })
    };
    take(8, &mut head)?;
    if !head.starts_with(MAGIC) {
        return Err(broken("it does not begin with \\x93NUMPY"));
    }
    let size_bytes = if head[6] == 1 { 2 } else { 4 };
    take(size_bytes, &mut head)?;
    let n_header = head[8..].iter().rev().fold(0usize, |sum, &byte| (sum << 8) | usize::from(byte));
    if n_header > MAX_HEADER_BYTES {
        return Err(broken("its header is too long"));
    }
    let from = head.len();
    take(n_header, &mut head)?;

    let text = str::from_utf8(&head[from..]).map_err(|_| broken("its header is not text"))?;
    let mut depth = 0usize;
    for c in text.chars() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            // numpy writes neither; the parser's rules for escapes are of no use here and a risk.
            '\\' => return Err(broken("its header has a backslash")),
            _ => {}
        }
        if depth > MAX_NESTING {
            return Err(broken("its header is nested too deeply"));
        }
    }
    let value: py_literal::Value =
        text.trim_end_matches('\n').parse().map_err(|_| broken("its header is no Python dictionary"))?;
    let n_bytes = value
        .as_dict()
        .and_then(|dict| dict.iter().find(|(key, _)| key.as_string().is_some_and(|key| key == "shape")))
        .and_then(|(_, shape)| shape.as_tuple().or_else(|| shape.as_list()))
        .and_then(|shape| {
            shape.iter().try_fold(1u64, |product, length| {
                // A length of zero would hide an overflow of the others.
                let length: u64 = length.as_integer()?.to_string().parse().ok()?;
                product.checked_mul(length.max(1)).filter(|&product| product < 1 << 48)
            })
        });
    if n_bytes.is_none() {
        return Err(broken("its header has no usable shape"));
    }
    NpyHeader::from_reader(Cursor::new(&head)).map_err(|error| broken(&error.to_string()))
}

/// A decoder for a real number type, and the relative spacing of its numbers.
#[expect(clippy::cast_lossless, reason = "one expression for ten types, of which two lose digits")]
fn decoder(dtype: &DType) -> Option<(Decode, f64)> {
    // One attempt per type that numpy has; `npyz` says no to all but the right one, byte order included.
    macro_rules! attempt {
        ($($real:ty => $epsilon:expr),*) => {$(
            if let Ok(reader) = <$real as Deserialize>::reader(dtype) {
                let decode = move |bytes: &[u8]| reader.read_one(bytes).map(|value| value as f64);
                return Some((Box::new(decode), $epsilon));
            }
        )*};
    }
    attempt!(
        f64 => f64::EPSILON, f32 => f64::from(f32::EPSILON),
        i64 => f64::EPSILON, i32 => f64::EPSILON, i16 => f64::EPSILON, i8 => f64::EPSILON,
        u64 => f64::EPSILON, u32 => f64::EPSILON, u16 => f64::EPSILON, u8 => f64::EPSILON
    );
    None
}

/// A table stored column by column, turned into rows. It has to be loaded: a row is spread over the whole file.
fn transposed(
    path: &Path,
    reader: impl Read,
    n_rows: u64,
    n_columns: usize,
    n_bytes: usize,
) -> Result<Vec<u8>, LogError> {
    let broken =
        || LogError::NpyBroken { path: path.to_path_buf(), what: format!("it ends before its {n_rows} samples") };
    let total =
        usize::try_from(n_rows).ok().and_then(|n| n.checked_mul(n_columns)?.checked_mul(n_bytes)).ok_or_else(broken)?;
    let mut by_column = Vec::new();
    reader.take(total as u64).read_to_end(&mut by_column).map_err(|error| LogError::from_read(path, error))?;
    // Only what was really there is allocated, whatever the header claims.
    if by_column.len() < total {
        return Err(broken());
    }
    let column_bytes = total / n_columns;
    let mut by_row = Vec::with_capacity(total);
    for row_from in (0..column_bytes).step_by(n_bytes.max(1)) {
        for column in 0..n_columns {
            let from = column * column_bytes + row_from;
            by_row.extend_from_slice(&by_column[from..from + n_bytes]);
        }
    }
    Ok(by_row)
}
