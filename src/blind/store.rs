//! Where things lie in the directory of a run, and how they get there whole.
//!
//! ```text
//! order.json               what was ordered
//! seal.txt                 sha256 of the labels, as `sha256sum -c` reads it
//! program.txt              sha256 of the program that gives all answers
//! sealed/labels.json       what is so
//! sealed/truths/ID.json    forms and sizes, which follow from the labels
//! cases/ID/                where a diagnosis ran: run.json, diagnosis.json, report.html
//! left-out/ID/, active/ID/ the same of second diagnoses
//! score.json, report.html, timing.json
//! ```

use crate::failure::Failure;
use crate::output;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The directory of a run.
#[derive(Clone, Debug)]
pub struct Store(pub PathBuf);

impl Store {
    /// A file or folder in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Where the truth of a case lies.
    pub fn truth(&self, id: &str) -> PathBuf {
        self.0.join("sealed/truths").join(format!("{id}.json"))
    }

    /// Where a case is diagnosed.
    pub fn case(&self, id: &str) -> PathBuf {
        self.0.join("cases").join(id)
    }

    /// Where it is diagnosed without its own entry.
    pub fn left_out(&self, id: &str) -> PathBuf {
        self.0.join("left-out").join(id)
    }

    /// Where it is diagnosed with one more experiment.
    pub fn active(&self, id: &str) -> PathBuf {
        self.0.join("active").join(id)
    }

    /// Writes `text` to `name`, or finds that it is there already.
    ///
    /// # Errors
    /// If something else is there: the directory belongs to another run.
    pub fn settle(&self, name: &str, text: &str) -> Result<(), Failure> {
        let path = self.path(name);
        match read_if_there(&path)? {
            Some(found) if found == text => Ok(()),
            Some(_) => Err(Failure::call(format!(
                "{}: belongs to another run; name another directory with --out",
                path.display()
            ))),
            None => write(&path, text.as_bytes()),
        }
    }
}

/// Sha256 in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes a file so that it is whole or absent, whenever the process is killed; its folder is made if need be.
///
/// # Errors
/// What the file system says.
pub fn write(path: &Path, content: &[u8]) -> Result<(), Failure> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| Failure::unwritable(path, &e))?;
    }
    output::save(path, content)
}

/// A value as a JSON text for people too.
///
/// # Errors
/// If it has no JSON, which none of ours brings about.
pub fn json(value: &impl Serialize) -> Result<String, Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::call(format!("no JSON: {e}")))?;
    Ok(text + "\n")
}

/// Text of a file.
///
/// # Errors
/// If it can't be read.
pub fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path)
        .map_err(|e| Failure::file(format!("{}: cannot be read: {e}; check the name", path.display())))
}

/// Text of a file that need not be there; what can't be read is somebody's all the same.
///
/// # Errors
/// If it is there and can't be read.
pub fn read_if_there(path: &Path) -> Result<Option<String>, Failure> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Failure::file(format!("{}: cannot be read: {e}; mend or move it", path.display()))),
    }
}

/// A value from a JSON file.
///
/// # Errors
/// If it can't be read or means nothing.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    serde_json::from_str(&read(path)?).map_err(|e| Failure::file(format!("{}: {e}", path.display())))
}
