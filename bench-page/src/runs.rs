//! Run directories on disk: listed, and set beside one another.
//!
//! A run is read from its files alone, so that runs of `hysteron hil` and of earlier days are there, too. What this does not do: write.

use plant_sim::log::{ReadOptions, open};
use plant_sim::metrics::rms;
use serde::Serialize;
use serde_json::Value;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// The log of a run that has one.
const LOG: &str = "log.csv";
/// Runs that are listed, newest first.
const LISTED: usize = 200;
/// Runs that are compared at once, and columns of each.
const COMPARED: usize = 4;
const COLUMNS: usize = 1200;
/// Rows of a log that are read into memory: ten minutes at 20 kHz.
const MOST_ROWS: u64 = 13_000_000;

/// A run as the list shows it; of a directory with several logs, each of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listed {
    /// Path below the folder of runs, of the directory or of one of its logs.
    pub name: String,
    /// Seconds since 1970 of its last change.
    pub changed_s: u64,
    /// SPEC.
    pub spec: String,
    /// Board.
    pub board: String,
    /// Rows that are stated beside it.
    pub rows: Option<u64>,
    /// Length.
    pub seconds: Option<f64>,
    /// Fault it ended in, `none`, or nothing where it did not come to its end.
    pub fault: Option<String>,
}

/// The runs in `folder` and in its folders, newest first.
pub fn list(folder: &Path) -> Vec<Listed> {
    let mut runs = Vec::new();
    for path in folders(folder) {
        runs.extend(listed(folder, &path));
        for inner in folders(&path) {
            runs.extend(listed(folder, &inner));
        }
    }
    runs.sort_by(|a, b| b.changed_s.cmp(&a.changed_s).then_with(|| b.name.cmp(&a.name)));
    runs.truncate(LISTED);
    runs
}

fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
}

fn listed(root: &Path, path: &Path) -> Vec<Listed> {
    let json = |name: &str| -> Option<Value> { serde_json::from_str(&fs::read_to_string(path.join(name)).ok()?).ok() };
    let Some(run) = json("run.json") else { return Vec::new() };
    let link = json("link.json").unwrap_or_default();
    let Some(experiments) = run["experiments"].as_array() else {
        return entry(root, path, LOG, &run, &run["reference"], &link).into_iter().collect();
    };
    // What `hysteron record` has made: a log for each experiment that was begun.
    let each = |experiment: &Value| {
        let log = experiment["log"].as_str().filter(|log| !log.contains(['/', '\\']))?;
        entry(root, path, log, &run, &experiment["spec"], &link["logs"][log])
    };
    experiments.iter().filter_map(each).collect()
}

/// The entry of a log in `path`, of which `state` says how it stands; nothing where it is not there.
fn entry(root: &Path, path: &Path, log: &str, run: &Value, spec: &Value, state: &Value) -> Option<Listed> {
    let below = path.strip_prefix(root).ok()?.to_str()?;
    let changed = fs::metadata(path.join(log)).and_then(|found| found.modified()).ok()?;
    let rows = state["rows"].as_u64();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    Some(Listed {
        name: if log == LOG { below.to_owned() } else { format!("{below}/{log}") },
        changed_s: changed.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
        spec: text(spec),
        board: text(&run["board"]),
        rows,
        seconds: rows.zip(run["rate_hz"].as_f64()).map(|(rows, rate_hz)| rows as f64 / rate_hz),
        fault: state["fault"].as_str().map(|fault| fault.replace('_', " ")),
    })
}

/// The log of a listed run: that of its directory, or the one that is named.
fn log_of(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    let is_log = path.extension().is_some_and(|ending| ending == "csv") && !path.is_dir();
    if is_log { path } else { path.join(LOG) }
}

/// Names of the saved sets.
pub fn sets(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let stem = |path: PathBuf| {
        let is_set = path.extension().is_some_and(|ending| ending == "toml");
        if is_set { path.file_stem().map(|stem| stem.to_string_lossy().into_owned()) } else { None }
    };
    let mut names: Vec<String> = entries.filter_map(|entry| stem(entry.path())).collect();
    names.sort();
    names
}

/// A run, thinned for a plot, and its numbers.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// As in [`Listed`].
    pub name: String,
    /// Seconds a column lasts.
    pub column_s: f64,
    /// Least and greatest displacement of each column, micrometres.
    pub displacement_um: [Vec<f32>; 2],
    /// Of the error, where there is a reference.
    pub error_um: Option<[Vec<f32>; 2]>,
    /// Of the command, volts.
    pub command_v: [Vec<f32>; 2],
    /// Largest magnitude of the displacement.
    pub peak_um: f64,
    /// Rms of reference minus displacement, from the first row to the last in which anything is asked for or commanded.
    pub error_rms_um: Option<f64>,
    /// Largest magnitude of the command.
    pub peak_v: f64,
}

/// Reads runs of `folder` for a comparison.
///
/// # Errors
/// One line: which run, and what is wrong with it.
pub fn compare(folder: &Path, names: &[String]) -> Result<Vec<Compared>, String> {
    if names.is_empty() || names.len() > COMPARED {
        return Err(format!("choose one to {COMPARED} runs"));
    }
    names.iter().map(|name| compared(folder, name)).collect()
}

fn compared(folder: &Path, name: &str) -> Result<Compared, String> {
    // Folders have any name; what leads out of this one does not: a root, a drive, and what is nothing or dots alone (on Windows with blanks behind).
    let is_plain = |part: &str| !part.trim_end_matches(['.', ' ']).is_empty() && !part.contains(['\\', ':']);
    if !name.split('/').all(is_plain) {
        return Err(format!("{name:?}: no run of this folder"));
    }
    let said = |error: plant_sim::log::LogError| error.to_string();
    let reader = open(&log_of(folder, name), &ReadOptions::default()).map_err(said)?;
    if reader.n_rows() > MOST_ROWS {
        return Err(format!("{name}: {} rows are too many for a comparison", reader.n_rows()));
    }
    let log = reader.into_log().map_err(said)?;
    let length = log.len().div_ceil(COLUMNS).max(1);
    let thinned = |values: &mut dyn Iterator<Item = f64>| -> [Vec<f32>; 2] {
        let values: Vec<f32> = values.map(|value| value as f32).collect();
        let of = |join: fn(f32, f32) -> f32| {
            values.chunks(length).map(|part| part.iter().copied().fold(f32::NAN, join)).collect()
        };
        [of(f32::min), of(f32::max)]
    };
    let peak = |values: &[f64]| values.iter().fold(0.0, |peak: f64, value| peak.max(value.abs()));
    // A run in open loop has a column of zeros.
    let is_followed = |reference_m: &&Vec<f64>| reference_m.iter().any(|wanted| *wanted != 0.0);
    let error_m: Option<Vec<f64>> = log
        .reference_m
        .as_ref()
        .filter(is_followed)
        .map(|reference_m| reference_m.iter().zip(&log.displacement_m).map(|(wanted, is)| wanted - is).collect());
    Ok(Compared {
        name: name.to_owned(),
        column_s: length as f64 * log.dt_s,
        displacement_um: thinned(&mut log.displacement_m.iter().map(|m| m * 1e6)),
        error_um: error_m.as_ref().map(|error_m| thinned(&mut error_m.iter().map(|m| m * 1e6))),
        command_v: thinned(&mut log.command_v.iter().copied()),
        peak_um: peak(&log.displacement_m) * 1e6,
        error_rms_um: log
            .reference_m
            .as_ref()
            .zip(error_m.as_ref())
            .map(|(reference_m, error_m)| rms(error_m[busy(reference_m, &log.command_v)].iter().copied()) * 1e6),
        peak_v: peak(&log.command_v),
    })
}

/// The rows but those at either end where the loop rests: how long a recording goes on beside its run is nothing of the loop's.
fn busy(reference_m: &[f64], command_v: &[f64]) -> Range<usize> {
    let is_busy = |(wanted, volts): (&f64, &f64)| *wanted != 0.0 || *volts != 0.0;
    let from = reference_m.iter().zip(command_v).position(is_busy).unwrap_or(0);
    let to = reference_m.iter().zip(command_v).rposition(is_busy).map_or(0, |last| last + 1);
    from..to.max(from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_name_leads_nowhere_but_into_the_folder() {
        for name in ["", "..", "../x", "/etc", "a//b", "a/../b", "a\\b", "a/.", "C:", "a/.. ", "..."] {
            let error = compare(Path::new("/nowhere"), &[name.to_owned()]).unwrap_err();
            assert!(error.contains("no run of this folder"), "{name}: {error}");
        }
        assert!(compare(Path::new("/nowhere"), &[]).is_err());
        assert!(compare(Path::new("/nowhere"), &vec!["a".to_owned(); 5]).is_err());
    }

    #[test]
    fn whatever_is_listed_is_compared() {
        let folder = std::env::temp_dir().join(format!("hysteron-runs-{}", std::process::id()));
        let rows: String = (0..20).map(|k| format!("{:.3},{k},{}\n", f64::from(k) * 1e-3, 2 * k)).collect();
        for name in ["step.80", "my run", "pass 1/Kp=0.5"] {
            let path = folder.join(name);
            fs::create_dir_all(&path).unwrap();
            fs::write(path.join("run.json"), "{}").unwrap();
            fs::write(path.join("log.csv"), format!("time_s,command_V,displacement_um\n{rows}")).unwrap();
        }
        let names: Vec<String> = list(&folder).into_iter().map(|run| run.name).collect();
        let compared = compare(&folder, &names).map(|runs| runs.len());
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!((names.len(), compared), (3, Ok(3)));
    }

    /// What `hysteron record` makes of a set is a log for each experiment: each is whole, in a fault or cut short by itself.
    #[test]
    fn a_directory_of_several_logs_is_listed_and_compared_log_by_log() {
        let folder = std::env::temp_dir().join(format!("hysteron-several-{}", std::process::id()));
        let path = folder.join("set");
        fs::create_dir_all(&path).unwrap();
        let names = ["01-a.csv", "02-b.csv", "03-c.csv", "04-d.csv"];
        let experiments: Vec<Value> = names.iter().map(|log| json!({ "log": log, "spec": "hold:1V@0.02s" })).collect();
        let run = json!({ "board": "nucleo", "rate_hz": 1000.0, "experiments": experiments });
        fs::write(path.join("run.json"), run.to_string()).unwrap();
        let done = |fault: &str| json!({ "rows": 20, "fault": fault, "is_complete": true });
        let begun = json!({ "rows": 7, "is_complete": false });
        let logs = json!({ names[0]: done("none"), names[1]: done("link_loss"), names[2]: begun });
        fs::write(path.join("link.json"), json!({ "logs": logs, "is_complete": false }).to_string()).unwrap();
        let rows: String = (0..20).map(|k| format!("{:.3},{k},{}\n", f64::from(k) * 1e-3, 2 * k)).collect();
        for name in &names[..3] {
            fs::write(path.join(name), format!("time_s,command_V,displacement_um\n{rows}")).unwrap();
        }
        let mut found = list(&folder);
        found.sort_by(|a, b| a.name.cmp(&b.name));
        let listed: Vec<String> = found.iter().map(|run| run.name.clone()).collect();
        let compared = compare(&folder, &listed).map(|runs| runs.len());
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(listed, ["set/01-a.csv", "set/02-b.csv", "set/03-c.csv"]);
        assert_eq!(compared, Ok(3));
        let ended: Vec<Option<&str>> = found.iter().map(|run| run.fault.as_deref()).collect();
        assert_eq!(ended, [Some("none"), Some("link loss"), None]);
        assert_eq!((found[0].seconds, found[2].seconds), (Some(0.02), Some(0.007)));
        assert!(found.iter().all(|run| run.changed_s > 0 && run.spec == "hold:1V@0.02s" && run.board == "nucleo"));
    }

    /// Ten runs of rest beside a run make its error no smaller.
    #[test]
    fn the_error_is_of_what_was_asked_for() {
        let folder = std::env::temp_dir().join(format!("hysteron-busy-{}", std::process::id()));
        let path = folder.join("run");
        fs::create_dir_all(&path).unwrap();
        let row = |k: u32| match k {
            20..40 => format!("{:.3},5,8,10\n", f64::from(k) * 1e-3),
            _ => format!("{:.3},0,0.5,0\n", f64::from(k) * 1e-3),
        };
        let rows: String = (0..220).map(row).collect();
        fs::write(path.join("log.csv"), format!("time_s,command_V,displacement_um,reference_um\n{rows}")).unwrap();
        let compared = compare(&folder, &["run".to_owned()]);
        fs::remove_dir_all(&folder).unwrap();
        assert!((compared.unwrap()[0].error_rms_um.unwrap() - 2.0).abs() < 1e-9);
        assert_eq!([busy(&[0.0; 3], &[0.0; 3]), busy(&[0.0, 1.0, 0.0], &[0.0, 0.0, 2.0])], [0..0, 1..3]);
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_empty_list() {
        assert!(list(Path::new("/nowhere/at/all")).is_empty());
        assert!(sets(Path::new("/nowhere/at/all")).is_empty());
    }
}
