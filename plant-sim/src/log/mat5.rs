//! The MAT v5 format, as far as logs need it: real vectors, text and structures, compressed or not; written
//! uncompressed. From the format's public description ("MAT-File Format", MathWorks).
//!
//! Why not a library: `matrw` reads structures but panics on 98 % of files with one flipped byte (it unwraps the
//! inflater's result), `matfile` cannot read structures and prints to standard error. `matrw` is the oracle of the
//! tests instead.
//!
//! **Invariant:** every length is checked against the bytes that are there before anything is allocated or indexed,
//! and nesting is bounded, so no input panics or overflows the stack. What logs do not need (cells, objects, sparse
//! arrays, function handles) is named and skipped.

use std::io::Read;

/// Length of the file's header.
const HEADER_BYTES: usize = 128;

/// Deepest nesting of structures.
const MAX_NESTING: usize = 16;

/// A variable of MAT v5 holds less than 2 GB; a compressed one that claims more is broken.
const MAX_INFLATED_BYTES: u64 = 1 << 31;

// Data types of elements.
const MI_INT8: u32 = 1;
const MI_UINT8: u32 = 2;
const MI_INT16: u32 = 3;
const MI_UINT16: u32 = 4;
const MI_INT32: u32 = 5;
const MI_UINT32: u32 = 6;
const MI_SINGLE: u32 = 7;
const MI_DOUBLE: u32 = 9;
const MI_INT64: u32 = 12;
const MI_UINT64: u32 = 13;
const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
const MI_UTF8: u32 = 16;
const MI_UTF16: u32 = 17;
const MI_UTF32: u32 = 18;

// Classes of arrays.
const MX_STRUCT: u8 = 2;
const MX_CHAR: u8 = 4;
const MX_DOUBLE: u8 = 6;
const MX_SINGLE: u8 = 7;
const MX_UINT64: u8 = 15;

/// A variable's value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// A real array, in column order.
    Real {
        /// Its dimensions.
        dims: Vec<usize>,
        /// Its numbers; integers above 2^53 are rounded.
        numbers: Vec<f64>,
        /// Whether it was stored as single precision.
        single: bool,
    },
    /// A text.
    Text(String),
    /// An array of structures.
    Struct {
        /// The names of the fields.
        names: Vec<String>,
        /// The values by element, then by field.
        elements: Vec<Vec<Value>>,
    },
    /// Something that logs do not need, by its name.
    Other(&'static str),
}

impl Value {
    /// A field of a structure's first element.
    pub(crate) fn field(&self, name: &str) -> Option<&Self> {
        self.field_of(0, name)
    }

    /// A field of a structure's element.
    pub(crate) fn field_of(&self, element: usize, name: &str) -> Option<&Self> {
        let Self::Struct { names, elements } = self else {
            return None;
        };
        elements.get(element)?.get(names.iter().position(|n| n == name)?)
    }

    /// A number, if it is a single one.
    pub(crate) fn number(&self) -> Option<f64> {
        match self {
            Self::Real { numbers, .. } => numbers.first().copied().filter(|_| numbers.len() == 1),
            _ => None,
        }
    }

    /// A text.
    pub(crate) fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// What is wrong with a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// It is a v7.3 file.
    Version73,
    /// What, and at which byte (of the file, or of the inflated variable).
    Broken(&'static str, usize),
}

type Found<T> = Result<T, Fault>;

/// Whether bytes begin like a MAT file of any version that has this header.
pub(crate) fn is_mat(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB 5.0 MAT-file") || bytes.starts_with(b"MATLAB 7.3 MAT-file")
}

/// Reads all variables.
pub(crate) fn parse(bytes: &[u8]) -> Found<Vec<(String, Value)>> {
    // The version is told by the text; Octave and scipy write the same text for v5.
    if bytes.starts_with(b"MATLAB 7.3") || bytes.starts_with(b"\x89HDF\r\n\x1a\n") {
        return Err(Fault::Version73);
    }
    let endian = bytes.get(126..HEADER_BYTES);
    let big = match endian {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err(Fault::Broken("no MAT v5 header", bytes.len().min(126))),
    };
    if bytes.get(if big { 124 } else { 125 }) == Some(&2) {
        return Err(Fault::Version73);
    }
    let mut cursor = Cursor { bytes, at: HEADER_BYTES, big };
    let mut variables = Vec::new();
    while cursor.at < bytes.len() {
        let (kind, at, data) = cursor.element()?;
        let inflated;
        let found = match kind {
            MI_COMPRESSED => {
                let mut buffer = Vec::new();
                flate2::read::ZlibDecoder::new(data)
                    .take(MAX_INFLATED_BYTES)
                    .read_to_end(&mut buffer)
                    .map_err(|_| Fault::Broken("a compressed variable that does not inflate", at))?;
                inflated = buffer;
                let mut inner = Cursor { bytes: &inflated, at: 0, big };
                match inner.element()? {
                    (MI_MATRIX, _, data) => array(data, big, 0)?,
                    _ => {
                        return Err(Fault::Broken("a compressed element that is no variable", at));
                    }
                }
            }
            MI_MATRIX => array(data, big, 0)?,
            _ => return Err(Fault::Broken("an element that is no variable", at)),
        };
        variables.push(found);
    }
    Ok(variables)
}

/// A place in bytes, from which elements are taken.
#[derive(Clone, Copy)]
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, n: usize) -> Found<&'a [u8]> {
        let end = self.at.checked_add(n);
        let data = end
            .and_then(|end| self.bytes.get(self.at..end))
            .ok_or(Fault::Broken("an element longer than the file", self.at))?;
        self.at += n;
        Ok(data)
    }

    fn u32(&mut self) -> Found<u32> {
        Ok(number(self.take(4)?, self.big, u32::from_le_bytes, u32::from_be_bytes).unwrap_or(0))
    }

    /// The next element: type, offset of its data, data.
    fn element(&mut self) -> Found<(u32, usize, &'a [u8])> {
        let word = self.u32()?;
        // A small element packs type and length into one word and its data, at most four bytes, into the next.
        if word >> 16 != 0 {
            let at = self.at;
            let data = self.take(4)?;
            let small = data.get(..(word >> 16) as usize);
            let small = small.ok_or(Fault::Broken("a small element of more than four bytes", at))?;
            return Ok((word & 0xffff, at, small));
        }
        let n = self.u32()? as usize;
        let at = self.at;
        let data = self.take(n)?;
        // Compressed variables are not padded; everything else is, save perhaps at the very end.
        if word != MI_COMPRESSED {
            self.at = self.at.next_multiple_of(8).min(self.bytes.len());
        }
        Ok((word, at, data))
    }
}

/// A number of `N` bytes in either order, `None` if there are not exactly that many.
fn number<T, const N: usize>(bytes: &[u8], big: bool, le: fn([u8; N]) -> T, be: fn([u8; N]) -> T) -> Option<T> {
    let bytes: [u8; N] = bytes.try_into().ok()?;
    Some(if big { be(bytes) } else { le(bytes) })
}

/// An array: its name and value.
fn array(data: &[u8], big: bool, depth: usize) -> Found<(String, Value)> {
    let mut cursor = Cursor { bytes: data, at: 0, big };
    // An empty matrix may be stored as nothing at all.
    if data.is_empty() {
        let value = Value::Real { dims: vec![0, 0], numbers: Vec::new(), single: false };
        return Ok((String::new(), value));
    }
    if depth > MAX_NESTING {
        return Err(Fault::Broken("structures nested too deeply", 0));
    }
    let (kind, at, flags) = cursor.element()?;
    let word = flags.get(..4).and_then(|word| number(word, big, u32::from_le_bytes, u32::from_be_bytes));
    let Some(word) = word.filter(|_| kind == MI_UINT32) else {
        return Err(Fault::Broken("an array without flags", at));
    };
    let class = (word & 0xff) as u8;
    let is_complex = word & 0x800 != 0;
    let skipped = match class {
        1 => Some("a cell array"),
        3 | 17 | 18 => Some("an object"),
        5 => Some("a sparse array"),
        16 => Some("a function handle"),
        MX_STRUCT | MX_CHAR | MX_DOUBLE | MX_SINGLE..=MX_UINT64 => None,
        _ => return Err(Fault::Broken("an array of unknown class", at)),
    };
    // Objects (class 17) have no dimensions; none of the skipped is looked into beyond its name.
    if class == 17 {
        let (_, _, name) = cursor.element()?;
        return Ok((latin(name), Value::Other("an object")));
    }
    let (kind, at, lengths) = cursor.element()?;
    let mut dims = Vec::new();
    for length in lengths.chunks(4) {
        let length = number(length, big, i32::from_le_bytes, i32::from_be_bytes);
        let length = length.and_then(|length| usize::try_from(length).ok());
        dims.push(length.ok_or(Fault::Broken("a dimension that is no length", at))?);
    }
    let n = dims.iter().try_fold(1usize, |n, &length| n.checked_mul(length));
    let Some(n) = n.filter(|_| kind == MI_INT32) else {
        return Err(Fault::Broken("dimensions that overflow", at));
    };
    let (_, _, name) = cursor.element()?;
    let name = latin(name);
    if let Some(what) = skipped {
        return Ok((name, Value::Other(what)));
    }
    let value = match class {
        MX_STRUCT => structure(&mut cursor, n, depth)?,
        MX_CHAR => {
            let (kind, at, data) = cursor.element()?;
            Value::Text(text(kind, at, data, big)?)
        }
        _ if is_complex => Value::Other("complex"),
        _ => {
            // Empty arrays may come without data.
            let numbers = if n == 0 && cursor.at == data.len() {
                Vec::new()
            } else {
                let (kind, at, data) = cursor.element()?;
                let numbers = numbers(kind, at, data, big)?;
                if numbers.len() != n {
                    return Err(Fault::Broken("an array whose length differs from its dimensions", at));
                }
                numbers
            };
            Value::Real { dims, numbers, single: class == MX_SINGLE }
        }
    };
    Ok((name, value))
}

/// The fields of `n` structures.
fn structure(cursor: &mut Cursor<'_>, n: usize, depth: usize) -> Found<Value> {
    let big = cursor.big;
    let (_, at, width) = cursor.element()?;
    let width = number(width, big, i32::from_le_bytes, i32::from_be_bytes)
        .and_then(|width| usize::try_from(width).ok())
        .filter(|&width| width > 0)
        .ok_or(Fault::Broken("field names without a length", at))?;
    let (_, _, data) = cursor.element()?;
    let names: Vec<String> = data.chunks_exact(width).map(latin).collect();
    let mut elements = Vec::new();
    // Without fields, elements take no bytes, and their number is not to be trusted.
    for _ in 0..if names.is_empty() { 0 } else { n } {
        let mut values = Vec::new();
        for _ in &names {
            let (kind, at, data) = cursor.element()?;
            if kind != MI_MATRIX {
                return Err(Fault::Broken("a field that is no array", at));
            }
            values.push(array(data, big, depth + 1)?.1);
        }
        elements.push(values);
    }
    Ok(Value::Struct { names, elements })
}

/// The numbers of an element, whatever type they were packed into.
#[expect(clippy::cast_lossless, reason = "one expression for ten types, of which two lose digits")]
fn numbers(kind: u32, at: usize, data: &[u8], big: bool) -> Found<Vec<f64>> {
    macro_rules! unpack {
        ($real:ty) => {{
            let chunks = data.chunks_exact(size_of::<$real>());
            if !chunks.remainder().is_empty() {
                return Err(Fault::Broken("an array that ends within a number", at));
            }
            chunks
                .filter_map(|bytes| number(bytes, big, <$real>::from_le_bytes, <$real>::from_be_bytes))
                .map(|value| value as f64)
                .collect()
        }};
    }
    Ok(match kind {
        MI_INT8 => unpack!(i8),
        MI_UINT8 => unpack!(u8),
        MI_INT16 => unpack!(i16),
        MI_UINT16 => unpack!(u16),
        MI_INT32 => unpack!(i32),
        MI_UINT32 => unpack!(u32),
        MI_SINGLE => unpack!(f32),
        MI_DOUBLE => unpack!(f64),
        MI_INT64 => unpack!(i64),
        MI_UINT64 => unpack!(u64),
        _ => return Err(Fault::Broken("numbers of unknown type", at)),
    })
}

/// Text in any of the encodings that MATLAB has used. Several rows run on, column by column.
fn text(kind: u32, at: usize, data: &[u8], big: bool) -> Found<String> {
    Ok(match kind {
        MI_UTF8 => String::from_utf8_lossy(data).into_owned(),
        MI_UINT16 | MI_UTF16 => {
            let units: Vec<u16> = data
                .chunks_exact(2)
                .filter_map(|unit| number(unit, big, u16::from_le_bytes, u16::from_be_bytes))
                .collect();
            String::from_utf16_lossy(&units)
        }
        MI_UTF32 => data
            .chunks_exact(4)
            .filter_map(|unit| number(unit, big, u32::from_le_bytes, u32::from_be_bytes))
            .map(|unit| char::from_u32(unit).unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect(),
        MI_INT8 | MI_UINT8 => latin(data),
        _ => return Err(Fault::Broken("text of unknown type", at)),
    })
}

/// One byte, one character, up to the first zero.
fn latin(bytes: &[u8]) -> String {
    bytes.iter().take_while(|&&byte| byte != 0).map(|&byte| char::from(byte)).collect()
}

/// A value to be written.
pub(crate) enum Out<'a> {
    /// A column of numbers.
    Real(&'a [f64]),
    /// A text.
    Text(&'a str),
}

/// The header of a file. Without a date: the same log gives the same bytes.
pub(crate) fn header() -> [u8; HEADER_BYTES] {
    let mut header = [b' '; HEADER_BYTES];
    let text = b"MATLAB 5.0 MAT-file, written by hysteron";
    header[..text.len()].copy_from_slice(text);
    header[116..124].fill(0);
    header[124..].copy_from_slice(&[0, 1, b'I', b'M']);
    header
}

/// One variable, to be put after the header. `None` if it is too long for the format (2 GB).
pub(crate) fn variable(name: &str, value: &Out<'_>) -> Option<Vec<u8>> {
    let (class, kind, n, data): (u8, u32, usize, Vec<u8>) = match value {
        Out::Real(numbers) => {
            let data = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
            (MX_DOUBLE, MI_DOUBLE, numbers.len(), data)
        }
        Out::Text(text) => {
            // UTF-8 as scipy writes it: MATLAB, Octave and matrw all take it, 16-bit units not all of them.
            (MX_CHAR, MI_UTF8, text.encode_utf16().count(), text.as_bytes().to_vec())
        }
    };
    let n = i32::try_from(n).ok()?;
    // A text is a row, a vector a column.
    let dims = if class == MX_CHAR { [1, n] } else { [n, 1] };
    let mut body = Vec::with_capacity(data.len() + 64);
    put(&mut body, MI_UINT32, &[class, 0, 0, 0, 0, 0, 0, 0])?;
    put(&mut body, MI_INT32, &dims.map(i32::to_le_bytes).concat())?;
    put(&mut body, MI_INT8, name.as_bytes())?;
    put(&mut body, kind, &data)?;
    let mut whole = Vec::with_capacity(body.len() + 8);
    put(&mut whole, MI_MATRIX, &body)?;
    Some(whole)
}

/// Appends one element, padded.
fn put(to: &mut Vec<u8>, kind: u32, data: &[u8]) -> Option<()> {
    let n = i32::try_from(data.len()).ok()?;
    to.extend_from_slice(&kind.to_le_bytes());
    to.extend_from_slice(&n.to_le_bytes());
    to.extend_from_slice(data);
    to.resize(to.len().next_multiple_of(8), 0);
    Some(())
}
