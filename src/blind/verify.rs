//! Repeats a run's books from its artefacts: is what was sealed what is so, and the score what the answers are worth?

use super::books::{provenance, score_made, score_text, unseal};
use super::made::{case, truth_text};
use super::plan::{Label, Order};
use super::runner::{NOT_KNOWN, as_written, each, program_of, ran};
use super::store::{Store, json, read, read_json, sha256};
use crate::failure::Failure;
use crate::output;
use std::collections::BTreeSet;
use std::sync::Mutex;

/// Verifies the run in `store`, one line for each question.
///
/// # Errors
/// If anything does not agree, or can't be read.
pub fn verify(store: &Store, jobs: usize) -> Result<(), Failure> {
    if !store.path("order.json").exists() && store.path("score.json").exists() {
        return Err(Failure::file(format!(
            "{}: nothing to make again: what was measured has no seed. Its answers are what their run.json states, and --manifest scores them again",
            store.0.display()
        )));
    }
    let order: Order = read_json(&store.path("order.json"))?;
    let labels: Vec<Label> = order.labels().map_err(Failure::file)?;
    let ids: Vec<&str> = labels.iter().map(|label| label.id.as_str()).collect();
    let mut doubts = Vec::new();
    let mut ask = |question: &str, doubt: Option<String>| {
        output::line(&format!("  {question}: {}", if doubt.is_none() { "yes" } else { "NO" }));
        doubts.extend(doubt);
    };

    let sealed = unseal(store);
    ask("the labels are what was sealed", sealed.as_ref().err().map(Failure::line));
    let made = json(&labels)?;
    let is_made = sealed.as_ref().is_ok_and(|sealed| *sealed == made);
    ask("the labels follow from the seed", (!is_made).then(|| "sealed/labels.json is not what the seed gives".into()));

    let wrong = Mutex::new(Vec::new());
    each(&labels, jobs, "making the cases again", |label| {
        let is_same = truth_text(&case(label, &order)?)? == read(&store.truth(&label.id)).unwrap_or_default();
        if !is_same && let Ok(mut wrong) = wrong.lock() {
            wrong.push(label.id.clone());
        }
        Ok(())
    })?;
    let wrong = wrong.into_inner().unwrap_or_default();
    ask("the truths follow from the labels", first(&wrong, "truths differ"));

    let is_touched = |id: &&&str| match ran(&store.case(id)) {
        None => true,
        // A diagnosis that failed has no answer to touch.
        Some(ran) => ran.diagnosis_sha256.is_some() && as_written(&store.case(id), &ran).is_err(),
    };
    let touched: Vec<String> = ids.iter().filter(is_touched).map(|id| (*id).to_owned()).collect();
    ask("the answers are there as they were written", first(&touched, "answers are missing or changed"));

    // Second answers are the same program's.
    let folders = ids.iter().flat_map(|id| [store.case(id), store.left_out(id), store.active(id)]);
    let stated = folders.filter_map(|folder| ran(&folder)).map(|ran| ran.program_sha256).chain([program_of(store)?]);
    let programs: BTreeSet<Option<String>> = stated.collect();
    let count = programs.iter().flatten().count();
    if count < 2 && programs.contains(&None) {
        output::line(&format!("  one program gave all answers: {NOT_KNOWN}"));
    } else {
        ask("one program gave all answers", (count > 1).then(|| format!("the answers are of {count} programs")));
    }

    let written = read(&store.path("score.json")).unwrap_or_default();
    let commit = serde_json::from_str::<serde_json::Value>(&written).unwrap_or_default();
    let commit = commit["provenance"]["commit"].as_str().unwrap_or("unknown");
    let provenance = provenance(store, &order, &sha256(made.as_bytes()), &ids, commit)?;
    // Truths that are gone leave nothing to score.
    let again = score_made(store, &labels).and_then(|score| score_text(&score, &provenance)).unwrap_or_default();
    ask(
        "the score follows from the answers",
        (again != written).then(|| "score.json differs from the score of the answers".into()),
    );

    match doubts.first() {
        None => {
            output::line("everything agrees");
            Ok(())
        }
        Some(doubt) => Err(Failure::file(format!("{}: {doubt}", store.0.display()))),
    }
}

fn first(ids: &[String], what: &str) -> Option<String> {
    ids.first().map(|id| format!("{} {what}, the first is {id}", ids.len()))
}
