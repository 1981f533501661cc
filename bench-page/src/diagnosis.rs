//! A diagnosis beside the running loop: reads a pass of the experiment set, diagnoses, writes the files that `hysteron diagnose` writes.
//!
//! What this does not do: decide anything about the bench. The thread may take a minute; the loop goes on meanwhile.

use crate::access::Token;
use crate::engine::{Found, Shared, Source, Task};
use gap_diagnosis::diagnose::{Options, diagnose};
use gap_diagnosis::locate::strongest;
use plant_sim::log::{Log, ReadOptions, read};
use plant_sim::model::Kind;
use plant_sim::whole_file;
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Entries of the ranking that are shown, and the least probability worth a line.
const RANKED: usize = 6;
const LEAST: f64 = 0.005;

/// Said of a diagnosis that panicked.
const FAULT: &str = "a fault in hysteron ended it; the terminal says where";

/// What is to be diagnosed.
pub struct Case {
    /// The plant.
    pub plant: Source,
    /// Logs to fit.
    pub logs: Vec<PathBuf>,
    /// Logs to score on.
    pub held_out: Vec<PathBuf>,
    /// Folder of the pass that made the logs.
    pub pass: PathBuf,
    /// Directory for the files, not there yet.
    pub folder: PathBuf,
    /// Seed of the bootstrap.
    pub seed: u64,
}

/// Begins a diagnosis in a thread of its own; `shared` learns its progress and its end.
///
/// # Errors
/// The plant can't be diagnosed, or the thread can't be started.
pub fn begin(shared: Arc<Shared>, case: Case) -> Result<(), String> {
    let kind = case.plant.model.kind;
    if kind != Kind::Phs {
        return Err(format!(
            "a plant of kind {} can't be diagnosed: the registry's effects are stated about hysterons",
            kind.name()
        ));
    }
    shared.set_task(Some(Task { what: "reading the logs".to_owned(), share: 0.0 }));
    let worker = shared.clone();
    let begun = std::thread::Builder::new().name("diagnosis".into()).spawn(move || {
        end(&worker, || run(&worker, &case));
    });
    begun.map(|_| ()).map_err(|error| {
        shared.set_task(None);
        format!("the diagnosis can't be started: {error}")
    })
}

/// Does the work and says how it ended: also where a fit panics, or the page would wait for it for ever.
fn end(shared: &Shared, work: impl FnOnce() -> Result<Found, String>) {
    // Nothing of what a panic leaves behind is used again.
    let done = catch_unwind(AssertUnwindSafe(work));
    shared.set_task(None);
    shared.set_found(done.unwrap_or_else(|_| Err(FAULT.to_owned())));
}

/// Where a report comes from.
fn provenance(case: &Case) -> [String; 3] {
    [
        format!("hysteron serve, the experiment set in {}", case.pass.display()),
        format!("hysteron {}", env!("CARGO_PKG_VERSION")),
        format!("seed {}", case.seed),
    ]
}

fn run(shared: &Shared, case: &Case) -> Result<Found, String> {
    let logs = read_all(&case.logs)?;
    let held_out = read_all(&case.held_out)?;
    let options = Options { seed: case.seed, ..Options::default() };
    let say = |what: &str, share: f64| shared.set_task(Some(Task { what: what.to_owned(), share }));
    let found = diagnose(&case.plant.model, &logs, &held_out, &options, &say).map_err(|error| error.to_string())?;
    let subtitle = format!("{}, {} logs of the bench, {} held out", case.plant.name, logs.len(), held_out.len());
    let report = found.page("Diagnosis of the bench", &subtitle, &provenance(case)).to_html();
    let path = |name: &str| case.folder.join(name);
    let unwritable = |path: &Path, error: std::io::Error| format!("{}: cannot be written: {error}", path.display());
    std::fs::create_dir_all(&case.folder).map_err(|error| unwritable(&case.folder, error))?;
    let text = serde_json::to_string_pretty(&found).map_err(|error| error.to_string())?;
    for (name, content) in [("diagnosis.json", text.as_str()), ("report.html", report.as_str())] {
        whole_file::write(&path(name), content.as_bytes()).map_err(|error| unwritable(&path(name), error))?;
    }
    found.augmented.write(&path("augmented.toml")).map_err(|error| error.to_string())?;
    Ok(Found {
        diagnosis: Arc::new(found),
        report: report.into(),
        ticket: Token::draw().text().to_owned(),
        folder: case.folder.clone(),
        is_in_use: false,
    })
}

fn read_all(paths: &[PathBuf]) -> Result<Vec<Log>, String> {
    let named = |path: &PathBuf| -> Result<Log, String> {
        let mut log = read(path, &ReadOptions::default()).map_err(|error| error.to_string())?;
        // Its folder is the experiment's name, which says more than where that lies.
        if let Some(folder) = path.parent().and_then(Path::file_name) {
            log.name = folder.to_string_lossy().into_owned();
        }
        Ok(log)
    };
    paths.iter().map(named).collect()
}

/// What the panel shows.
pub fn summary(found: &Found) -> Value {
    let diagnosis = &found.diagnosis;
    let ranking: Vec<Value> = diagnosis
        .ranking
        .iter()
        .filter(|ranked| ranked.probability >= LEAST)
        .take(RANKED)
        .map(|ranked| json!({ "effect": ranked.effect, "probability": ranked.probability }))
        .collect();
    let next = diagnosis.next_experiment.as_ref();
    json!({
        "sentence": diagnosis.sentence(),
        "verdict": diagnosis.verdict,
        "where": strongest(&diagnosis.location),
        "stage": diagnosis.stage,
        "effects": diagnosis.effects,
        "ranking": ranking,
        "class_reasons": diagnosis.class_reasons,
        "parameters": diagnosis.parameters,
        "changed": diagnosis.changed,
        "gap": diagnosis.gap,
        "next": next.map(|next| json!({ "spec": next.spec, "splits": next.splits, "reason": next.reason })),
        "warnings": diagnosis.warnings,
        "report": format!("/report/{}/report.html", found.ticket),
        "folder": found.folder.display().to_string(),
        "is_in_use": found.is_in_use,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant_sim::model::Model;

    #[test]
    fn a_report_names_the_folder_of_its_logs() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
        let plant = Source { name: "thesis-phs.toml".into(), bytes: Vec::new(), model: Model::read(&path).unwrap() };
        let (pass, folder) = ("runs/pass-2".into(), "runs/diagnosis-2".into());
        let case = Case { plant, logs: Vec::new(), held_out: Vec::new(), pass, folder, seed: 7 };
        let [from, _, seed] = provenance(&case);
        assert_eq!((from.as_str(), seed.as_str()), ("hysteron serve, the experiment set in runs/pass-2", "seed 7"));
    }

    #[test]
    fn a_diagnosis_that_panics_ends() {
        let shared = Shared::default();
        shared.set_task(Some(Task { what: "fitting".into(), share: 0.5 }));
        end(&shared, || panic!("on purpose: this test looks at what is left"));
        assert_eq!((shared.task(), shared.take_ended()), (None, Some(Err(FAULT.to_owned()))));
    }
}
