//! Reading and writing parameter files: one line per error, nothing half-written.

use crate::toml_layout::lay_out;
use serde::{Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

/// What can go wrong with a parameter file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file can't be read at all.
    #[error("{}: cannot be read: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// Not TOML, or a key is missing, unknown or of the wrong type.
    #[error("{}:{line}: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1.
        line: usize,
        /// What is wrong there.
        reason: String,
    },
    /// Another kind of file, or another version.
    #[error("{}: schema is {found:?}, this version reads {expected:?}", path.display())]
    Schema {
        /// The file.
        path: PathBuf,
        /// The schema it names.
        found: String,
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
    #[error("{}: cannot be written: {reason}", path.display())]
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
    let text = std::fs::read_to_string(path)
        .map_err(|e| FileError::Unreadable { path: path.to_owned(), reason: e.to_string() })?;
    let syntax = |e: toml::de::Error| FileError::Syntax {
        path: path.to_owned(),
        line: e.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1),
        reason: e.message().replace('\n', "; "),
    };
    let table: toml::Table = text.parse().map_err(syntax)?;
    match table.get("schema").and_then(toml::Value::as_str) {
        Some(found) if found == schema => {}
        found => {
            return Err(FileError::Schema {
                path: path.to_owned(),
                found: found.unwrap_or("missing").to_owned(),
                expected: schema,
            });
        }
    }
    toml::from_str(&text).map_err(syntax)
}

/// Writes `value` as TOML to a temporary file beside `path` and renames it, so that `path` is whole or untouched.
///
/// # Errors
/// [`FileError::Unwritable`].
pub(crate) fn write<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    let unwritable = |reason: String| FileError::Unwritable { path: path.to_owned(), reason };
    let text = toml::to_string(value).map_err(|e| unwritable(e.to_string()))?;
    let text = lay_out(&text).map_err(|e| unwritable(e.to_string()))?;
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(".part");
    std::fs::write(&temporary, text).and_then(|()| std::fs::rename(&temporary, path)).map_err(|e| {
        let _ = std::fs::remove_file(&temporary);
        unwritable(e.to_string())
    })
}
