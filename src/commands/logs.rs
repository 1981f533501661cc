//! Logs that a command keeps in memory, read under one name each, and refused where they would not fit.

use crate::arguments::ReadArguments;
use crate::failure::Failure;
use crate::output;
use plant_sim::log::{self, Log};
use std::path::{Path, PathBuf};

/// Rows that are read into memory: 10 million are about 1 GB with what a fit makes of them.
const MOST_ROWS: usize = 10_000_000;
/// Files below this size can't hold that many rows.
const LARGE_BYTES: u64 = 100_000_000;

/// Reads whole logs, named by their files.
pub fn read(paths: &[PathBuf], arguments: &ReadArguments) -> Result<Vec<Log>, Failure> {
    let mut logs = Vec::new();
    for path in paths {
        refuse_too_long(path, arguments)?;
        let mut log = log::read(path, &arguments.options())?;
        log.name = output::file_name(path);
        logs.push(log);
    }
    Ok(logs)
}

/// A log that would not fit is refused after a look that needs no memory.
fn refuse_too_long(path: &Path, arguments: &ReadArguments) -> Result<(), Failure> {
    let large = std::fs::metadata(path).is_ok_and(|file| file.len() > LARGE_BYTES);
    if large && log::open(path, &arguments.options())?.take(MOST_ROWS + 1).count() > MOST_ROWS {
        return Err(Failure::file(format!(
            "{}: more than {MOST_ROWS} rows: cut the log or lower its rate; a fit needs seconds of data, not hours",
            path.display()
        )));
    }
    Ok(())
}
