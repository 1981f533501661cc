//! Measured logs whose label somebody else keeps: the same check on a real bench (docs/blind-check.md).

use super::books::{Shown, answers_sha256, cases, publish};
use super::runner::{Asked, Input, PLANT, ask, each, program_of};
use super::store::{Store, json, read, sha256, write};
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::score::{Truth, score};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// What was measured; every path is relative to the manifest.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    /// Title of the report.
    #[serde(default)]
    title: Option<String>,
    /// Plant of every group that has none of its own.
    #[serde(default)]
    plant: Option<PathBuf>,
    /// Who keeps the labels.
    labels: Labels,
    /// One diagnosis each.
    group: Vec<Group>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Labels {
    /// The file, which may come when the answers are there.
    file: PathBuf,
    /// Its hash, which must be here from the start.
    sha256: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Group {
    id: String,
    #[serde(default)]
    plant: Option<PathBuf>,
    logs: Vec<PathBuf>,
    #[serde(default)]
    held_out: Vec<PathBuf>,
    /// Further arguments of `hysteron diagnose`, such as --columns.
    #[serde(default)]
    arguments: Vec<String>,
}

/// The file of labels: group -> effects; `[]` is nothing, `["unknown"]` something outside the registry.
type Sealed = BTreeMap<String, Vec<String>>;

/// Diagnoses every group, and scores when the labels are there.
///
/// # Errors
/// If manifest or labels are not what they should be, or files can't be read or written.
pub fn measured(store: &Store, manifest: &Path, program: &Asked, jobs: usize) -> Result<(), Failure> {
    let text = read(manifest)?;
    let said = |e: &dyn std::fmt::Display| Failure::file(format!("{}: {e}", manifest.display()));
    let found: Manifest = toml::from_str(&text).map_err(|e| said(&e))?;
    let beside = |path: &Path| manifest.parent().unwrap_or(Path::new("")).join(path);
    // An identifier that tells nothing, whatever a group is called.
    let id = |group: &Group| sha256(format!("{} {}", found.labels.sha256, group.id).as_bytes())[..12].to_owned();
    if let Some(twin) =
        (1..found.group.len()).find(|&i| found.group[..i].iter().any(|other| other.id == found.group[i].id))
    {
        return Err(said(&format!("two groups are called {:?}: rename one", found.group[twin].id)));
    }
    store.settle("manifest.toml", &text)?;
    store.settle("seal.txt", &format!("{}  {}\n", found.labels.sha256, found.labels.file.display()))?;
    output::line(&format!("labels of {} groups, sealed by sha256 {}", found.group.len(), found.labels.sha256));
    let ids: Vec<String> = found.group.iter().map(id).collect();
    let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
    program.settle(store, &ids)?;

    each(&found.group, jobs, "diagnosing", |group| {
        ask(program, &store.case(&id(group)), |folder| {
            let plant = group.plant.as_ref().or(found.plant.as_ref());
            let plant =
                plant.ok_or_else(|| said(&format!("group {:?} has no plant, and there is none for all", group.id)))?;
            copy(&beside(plant), &folder.join(PLANT))?;
            let lay = |paths: &[PathBuf], name: &str| -> Result<Vec<String>, Failure> {
                let lay = |(at, path): (usize, &PathBuf)| {
                    let ending = path.extension().map_or("csv".into(), |ending| ending.to_string_lossy());
                    let name = format!("{name}-{}.{ending}", at + 1);
                    copy(&beside(path), &folder.join(&name)).map(|()| name)
                };
                paths.iter().enumerate().map(lay).collect()
            };
            let (logs, held_out) = (lay(&group.logs, "log")?, lay(&group.held_out, "held-out")?);
            Ok(Ok(Input { logs, held_out, arguments: group.arguments.clone() }))
        })
    })?;

    let labels = beside(&found.labels.file);
    if !labels.is_file() {
        output::line(&format!(
            "every answer is written, in {}; put the labels to {} and give the same call again to score them",
            store.path("cases").display(),
            labels.display()
        ));
        return Ok(());
    }
    let sealed_text = read(&labels)?;
    if sha256(sealed_text.as_bytes()) != found.labels.sha256.to_lowercase() {
        return Err(Failure::file(format!(
            "{}: is not what was sealed: its sha256 is {}, the manifest has {}",
            labels.display(),
            sha256(sealed_text.as_bytes()),
            found.labels.sha256
        )));
    }
    let sealed: Sealed =
        toml::from_str(&sealed_text).map_err(|e| Failure::file(format!("{}: {e}", labels.display())))?;
    for group in &found.group {
        let effects = sealed
            .get(&group.id)
            .ok_or_else(|| Failure::file(format!("{}: has no label for group {:?}", labels.display(), group.id)))?;
        write(&store.truth(&id(group)), json(&truth(effects)?)?.as_bytes())?;
    }
    let score = score(&cases(store, &ids)?, None, None);
    let provenance = serde_json::json!({
        "version": env!("CARGO_PKG_VERSION"), "commit": "unknown", "manifest_sha256": sha256(text.as_bytes()),
        "labels_sha256": found.labels.sha256, "answers_sha256": answers_sha256(store, &ids),
        "program_sha256": program_of(store)?,
    });
    let title = found.title.as_deref().unwrap_or("Blind check on measured logs");
    let subtitle = format!("{} groups of logs", ids.len());
    publish(store, &Shown { title, subtitle, score: &score, provenance: &provenance, ids: &ids, seed: None })
}

fn truth(effects: &[String]) -> Result<Truth, Failure> {
    if effects.len() == 1 && effects[0] == "unknown" {
        return Ok(Truth { foreign: Some("on this bench".into()), is_textbook_form: true, ..Truth::default() });
    }
    if let Some(wrong) = effects.iter().find(|id| blind_truth::EffectId::from_id(id).is_none()) {
        return Err(Failure::file(format!(
            "label {wrong:?} is no effect; did you mean {:?}? `hysteron effects` lists all",
            plant_sim::effects::nearest(wrong)
        )));
    }
    let stage = match effects {
        [effect] => plant_sim::effects::find(effect).map(|entry| entry.stage().name().to_owned()),
        _ => None,
    };
    // On a real bench nobody knows the form; no failure is excused by it.
    Ok(Truth { effects: effects.to_vec(), stage, is_textbook_form: true, ..Truth::default() })
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::copy(from, to)
        .map(drop)
        .map_err(|e| Failure::file(format!("{}: cannot be read: {e}; check the name", from.display())))
}
