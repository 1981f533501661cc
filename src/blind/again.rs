//! Second diagnoses of cases that were answered: without their own entry, and with the experiment that the first asked for.
//!
//! Both begin when every first answer of the whole run is written, those of all its parts: they know the labels.

use super::made::{case, lay_log, lay_out};
use super::plan::{Label, Order};
use super::runner::{Asked, PLANT, REPORT, answer, ask, each, ran};
use super::store::Store;
use crate::failure::Failure;
use blind_truth::{Bench, Record, run};
use gap_diagnosis::score::{self, Active, Case, LeftOut, NextExperiment, Then, Tried, Truth, active, left_out};
use plant_sim::experiment::{Program, Setup, open_loop};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use plant_sim::spec::{Spec, Unit};
use std::path::Path;

/// Rows of an experiment that may be asked for: 5 million are a minute at 80 kHz.
const MOST_ROWS: usize = 5_000_000;

/// Diagnoses every single again with its own entry struck out.
///
/// # Errors
/// As [`ask`].
pub fn leave_one_out(
    store: &Store,
    order: &Order,
    labels: &[Label],
    program: &Asked,
    jobs: usize,
) -> Result<(), Failure> {
    let singles: Vec<&Label> = labels.iter().filter(|label| label.single().is_some()).collect();
    each(&singles, jobs, "without the true entry", |label| {
        let folder = store.left_out(&label.id);
        ask(program, &folder, |folder| {
            let mut input = lay_out(&case(label, order)?, folder)?;
            input.arguments.extend(["--without".to_owned(), label.subject.clone()]);
            Ok(Ok(input))
        })?;
        drop_report(&folder)
    })
}

/// Makes the proposed experiment where a set has several members, and diagnoses again with its log.
///
/// # Errors
/// As [`ask`].
pub fn make_experiments(
    store: &Store,
    order: &Order,
    labels: &[Label],
    program: &Asked,
    jobs: usize,
) -> Result<(), Failure> {
    let open: Vec<(&Label, NextExperiment)> =
        labels.iter().filter_map(|label| Some((label, proposed(&answer(&store.case(&label.id)).ok()?)??))).collect();
    each(&open, jobs, "with one more experiment", |(label, next)| {
        let folder = store.active(&label.id);
        ask(program, &folder, |folder| {
            let case = case(label, order)?;
            let mut input = lay_out(&case, folder)?;
            // A seed of its own: the sensor's noise does not repeat.
            let record = match experiment(next, &folder.join(PLANT), &case.bench, label.seed ^ 0x0A17) {
                Ok(record) => record,
                Err(why) => return Ok(Err(why)),
            };
            input.logs.push(lay_log(&record, folder)?);
            Ok(Ok(input))
        })?;
        drop_report(&folder)
    })
}

/// Where the set has several members: the experiment that was proposed, if one was that has a command.
fn proposed(answer: &score::Answer) -> Option<Option<NextExperiment>> {
    (answer.set90.len() > 1).then(|| answer.next_experiment.clone().filter(|next| next.spec.is_some()))
}

/// What the true bench records when it is driven so.
fn experiment(next: &NextExperiment, plant: &Path, bench: &Bench, seed: u64) -> Result<Record, String> {
    let command_v = command_v(next, plant)?;
    let rate_hz = next.rate_hz.unwrap_or_default();
    Ok(Record { name: "log-more".into(), ..run(bench, &command_v, rate_hz, seed) })
}

/// The SPEC as volts per row, as `hysteron simulate --command` plays it on the nominal plant.
fn command_v(next: &NextExperiment, plant: &Path) -> Result<Vec<f64>, String> {
    let text = next.spec.as_deref().unwrap_or_default();
    let said = |e: &dyn std::fmt::Display| format!("next_experiment {text:?}: {e}");
    let rate_hz = next.rate_hz.filter(|rate_hz| *rate_hz > 0.0).ok_or_else(|| said(&"has no rate_hz"))?;
    let spec: Spec = text.parse().map_err(|e| said(&e))?;
    let program = Program::new(&spec, rate_hz).map_err(|e| said(&e))?;
    if program.unit() == Some(Unit::Micrometre) {
        return Err(said(&"needs a closed loop"));
    }
    let samples = program
        .samples()
        .filter(|n| (1..=MOST_ROWS).contains(n))
        .ok_or_else(|| said(&"has no length, or too great a one"))?;
    let chain = Model::read(plant).map_err(|e| said(&e))?.chain();
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz, samples, latency_s: 1e-5, seed: 1 };
    Ok(open_loop(&setup, &program, &|_| {}).map_err(|e| said(&e))?.command_v)
}

fn drop_report(folder: &Path) -> Result<(), Failure> {
    let path = folder.join(REPORT);
    if path.exists() { std::fs::remove_file(&path).map_err(|e| Failure::unwritable(&path, &e)) } else { Ok(()) }
}

/// Figures of what was diagnosed in `left-out/`, if anything was; what a killed run left there is no answer.
pub fn score_left_out(store: &Store, labels: &[Label], truths: &[Truth]) -> Option<LeftOut> {
    let singles: Vec<(&Label, &Truth)> =
        labels.iter().zip(truths).filter(|(label, _)| label.single().is_some()).collect();
    let done = singles.iter().filter(|(label, _)| ran(&store.left_out(&label.id)).is_some());
    let cases: Vec<Case> = done
        .map(|(label, truth)| Case {
            id: label.id.clone(),
            truth: (*truth).clone(),
            answer: answer(&store.left_out(&label.id)),
        })
        .collect();
    (!cases.is_empty()).then(|| left_out(&cases, singles.len()))
}

/// Figures of what was diagnosed in `active/`, if anything was.
pub fn score_active(store: &Store, cases: &[Case]) -> Option<Active> {
    if !store.path("active").is_dir() {
        return None;
    }
    let tried = |before| {
        let Case { id, truth, answer: first }: &Case = before;
        let folder = store.active(id);
        let after = || Case { id: id.clone(), truth: truth.clone(), answer: answer(&folder) };
        let then = match proposed(first.as_ref().ok()?)? {
            None => Then::NoCommand,
            Some(_) if ran(&folder).is_some() => Then::Made(Box::new(after())),
            Some(_) => Then::Open,
        };
        Some(Tried { before, then })
    };
    Some(active(&cases.iter().filter_map(tried).collect::<Vec<_>>()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_proposed_command_is_what_simulate_would_play() {
        let plant = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/thesis-phs.toml");
        let volts = |spec: &str, rate_hz| command_v(&NextExperiment { spec: Some(spec.into()), rate_hz }, &plant);
        let ladder = volts("ladder:60V/3,hold=0.01s", Some(1000.0)).unwrap();
        assert!(ladder.len() >= 30 && ladder.iter().fold(0.0, |top: f64, v| top.max(*v)) == 60.0, "{ladder:?}");
        for (spec, rate_hz, why) in [
            ("ladder:60V/3,hold=0.01s", None, "rate_hz"),
            ("step:80um@0.1s", Some(1000.0), ""),
            ("sine:10V@10Hz", Some(1000.0), "length"),
            ("wobble:3V", Some(1000.0), ""),
        ] {
            let said = volts(spec, rate_hz).unwrap_err();
            assert!(said.contains(why) && said.contains(spec), "{said}");
        }
    }
}
