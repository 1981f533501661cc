//! Reading and writing parameter files: one line per error, nothing half-written.

use crate::toml_layout::lay_out;
use crate::whole_file;
use serde::{Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

/// What can go wrong with a parameter file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file can't be read at all.
    #[error("{}: cannot be read: {reason}; check the path", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// Bytes that are no text.
    #[error("{}: is not a text file (byte {offset}); a parameter file is TOML", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Where, counted from 0.
        offset: usize,
    },
    /// Not TOML, or a key is missing, unknown or of the wrong type.
    #[error("{}, line {line}: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1.
        line: usize,
        /// What is wrong there.
        reason: String,
    },
    /// Another kind of file, or another version.
    #[error("{}: {} and {expected:?} is wanted here; name another file", path.display(), match found { Some(found) => format!("schema is {found:?}"), None => "no schema is stated".to_owned() })]
    Schema {
        /// The file.
        path: PathBuf,
        /// The schema it names, if it names one.
        found: Option<String>,
        /// The schema that was wanted.
        expected: &'static str,
    },
    /// The numbers can't be.
    #[error("{}: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Key, value and what it must be.
        reason: String,
    },
    /// The file can't be written.
    #[error("{}: cannot be written: {reason}; name another place", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
}

/// Reads `path` as `T`, whose `schema` key must be `schema`.
///
/// # Errors
/// See [`FileError`].
pub(crate) fn read<T: DeserializeOwned>(path: &Path, schema: &'static str) -> Result<T, FileError> {
    let bytes =
        std::fs::read(path).map_err(|e| FileError::Unreadable { path: path.to_owned(), reason: e.to_string() })?;
    let text = String::from_utf8(bytes)
        .map_err(|e| FileError::NotText { path: path.to_owned(), offset: e.utf8_error().valid_up_to() })?;
    parse(&text, path, schema)
}

/// Reads `text`, which came from `path`, as `T`.
///
/// # Errors
/// See [`FileError`].
pub(crate) fn parse<T: DeserializeOwned>(text: &str, path: &Path, schema: &'static str) -> Result<T, FileError> {
    let syntax = |e: toml::de::Error| FileError::Syntax {
        path: path.to_owned(),
        line: e.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1),
        reason: e.message().trim().replace('\n', "; "),
    };
    let table: toml::Table = text.parse().map_err(syntax)?;
    match table.get("schema").and_then(toml::Value::as_str) {
        Some(found) if found == schema => {}
        found => {
            return Err(FileError::Schema { path: path.to_owned(), found: found.map(str::to_owned), expected: schema });
        }
    }
    toml::from_str(text).map_err(syntax)
}

/// Writes `value` as TOML, so that `path` is whole or untouched.
///
/// # Errors
/// [`FileError::Unwritable`].
pub(crate) fn write<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    let unwritable = |reason: String| FileError::Unwritable { path: path.to_owned(), reason };
    let text = toml::to_string(value).map_err(|e| unwritable(e.to_string()))?;
    let text = lay_out(&text).map_err(|e| unwritable(e.to_string()))?;
    whole_file::write(path, text.as_bytes()).map_err(|e| unwritable(e.to_string()))
}
