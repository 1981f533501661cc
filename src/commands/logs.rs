//! Logs that a command keeps in memory, read under one name each, and refused where they would not fit.

use crate::arguments::ReadArguments;
use crate::failure::Failure;
use crate::output;
use plant_sim::log::{self, Column, Log};
use std::path::{Path, PathBuf};

/// Files below this size can't hold millions of rows.
const LARGE_BYTES: u64 = 100_000_000;

/// Reads whole logs of at most `most_rows` each, named by their files; by their paths where these and those `beside` them have one of the same name. A log
/// that is named twice is refused.
pub fn read(
    paths: &[PathBuf],
    beside: &[PathBuf],
    arguments: &ReadArguments,
    most_rows: usize,
) -> Result<Vec<Log>, Failure> {
    refuse_twice(paths, beside)?;
    let mut logs = Vec::new();
    for path in paths {
        refuse_too_long(path, arguments, most_rows)?;
        let mut log = log::read(path, &arguments.options())?;
        // A compressed file may hold many rows in few bytes.
        if log.len() > most_rows {
            return Err(too_long(path, most_rows));
        }
        let of_name = |other: &&PathBuf| output::file_name(other) == output::file_name(path);
        let is_alone = paths.iter().chain(beside).filter(of_name).count() == 1;
        log.name = if is_alone { output::file_name(path) } else { path.display().to_string() };
        logs.push(log);
    }
    Ok(logs)
}

/// A log that was fitted can't score the fit, and one that is there twice would count as two.
fn refuse_twice(paths: &[PathBuf], beside: &[PathBuf]) -> Result<(), Failure> {
    let all: Vec<&PathBuf> = paths.iter().chain(beside).collect();
    for (index, path) in all.iter().enumerate() {
        let Some(earlier) = all[..index].iter().position(|other| output::same_file(other, path)) else { continue };
        let is_in_both = earlier < paths.len() && index >= paths.len();
        return Err(Failure::call(if is_in_both {
            format!("{}: is fitted and held out: leave it out of one of them", path.display())
        } else {
            format!("{}: is named twice: leave it out once", path.display())
        }));
    }
    Ok(())
}

/// Leaves out the forces of logs for a plant of `kind`, which has no structure that they could act on; a warning for each.
pub fn leave_out_forces(logs: &mut [Log], kind: &str) -> Vec<String> {
    logs.iter_mut().filter_map(|log| log.force_n.take().map(|_| no_structure(&log.name, kind))).collect()
}

/// The warning about a log whose force is left out.
pub fn no_structure(log: &str, kind: &str) -> String {
    let column = Column::Force.file_name();
    format!("{log}: its {column} is left out: a plant of kind {kind} has no structure that it could act on")
}

/// A log that would not fit is refused after a look that needs no memory.
fn refuse_too_long(path: &Path, arguments: &ReadArguments, most_rows: usize) -> Result<(), Failure> {
    let large = std::fs::metadata(path).is_ok_and(|file| file.len() > LARGE_BYTES);
    if large && log::open(path, &arguments.options())?.take(most_rows + 1).count() > most_rows {
        return Err(too_long(path, most_rows));
    }
    Ok(())
}

fn too_long(path: &Path, most_rows: usize) -> Failure {
    Failure::file(format!(
        "{}: more than {most_rows} rows: cut the log or lower its rate; a fit needs seconds of data, not hours",
        path.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small file is read before its rows are counted, as a compressed one would be.
    #[test]
    fn rows_count_in_small_files_as_well() {
        let path = std::env::temp_dir().join(format!("hysteron-rows-{}.csv", std::process::id()));
        let rows = (0..20).map(|k| format!("{:.3},0.0,{k}.5\n", f64::from(k) / 1e3)).collect::<String>();
        std::fs::write(&path, format!("time_s,command_V,displacement_um\n{rows}")).expect("a temporary file");
        let arguments = ReadArguments { columns: Vec::new(), scale: Vec::new(), rate_hz: None };
        let of = |most_rows| read(std::slice::from_ref(&path), &[], &arguments, most_rows).map(|logs| logs[0].len());
        let (fits, refused) = (of(20).ok(), of(19).err().map(|failure| failure.line()));
        std::fs::remove_file(&path).expect("still there");
        assert_eq!(fits, Some(20));
        assert!(refused.as_ref().is_some_and(|line| line.contains("more than 19 rows")), "{refused:?}");
    }
}
