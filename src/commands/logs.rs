//! Logs that a command keeps in memory, read under one name each, and refused where they would not fit.

use crate::arguments::ReadArguments;
use crate::failure::Failure;
use crate::output;
use plant_sim::log::{self, Log};
use std::path::{Path, PathBuf};

/// Files below this size can't hold millions of rows.
const LARGE_BYTES: u64 = 100_000_000;

/// Reads whole logs of at most `most_rows` each, named by their files; by their paths where these and those `beside` them have one of the same name.
pub fn read(
    paths: &[PathBuf],
    beside: &[PathBuf],
    arguments: &ReadArguments,
    most_rows: usize,
) -> Result<Vec<Log>, Failure> {
    let mut logs = Vec::new();
    for path in paths {
        refuse_too_long(path, arguments, most_rows)?;
        let mut log = log::read(path, &arguments.options())?;
        let of_name = |other: &&PathBuf| output::file_name(other) == output::file_name(path);
        let is_alone = paths.iter().chain(beside).filter(of_name).count() == 1;
        log.name = if is_alone { output::file_name(path) } else { path.display().to_string() };
        logs.push(log);
    }
    Ok(logs)
}

/// A log that would not fit is refused after a look that needs no memory.
fn refuse_too_long(path: &Path, arguments: &ReadArguments, most_rows: usize) -> Result<(), Failure> {
    let large = std::fs::metadata(path).is_ok_and(|file| file.len() > LARGE_BYTES);
    if large && log::open(path, &arguments.options())?.take(most_rows + 1).count() > most_rows {
        return Err(Failure::file(format!(
            "{}: more than {most_rows} rows: cut the log or lower its rate; a fit needs seconds of data, not hours",
            path.display()
        )));
    }
    Ok(())
}
