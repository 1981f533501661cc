//! `hysteron blind-check`: makes cases whose effect is withheld, has them diagnosed, and scores the answers.

use crate::arguments::BlindCheckCall;
use crate::blind::books::{self, Shown};
use crate::blind::made::{case, lay_out, seal_truth};
use crate::blind::plan::{Label, Order};
use crate::blind::runner::{self, Asked, ask, each};
use crate::blind::store::{Store, json, read, read_json, write};
use crate::blind::{again, measured, verify};
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::score::LeftOut;
use std::fs;
use std::path::PathBuf;

pub fn blind_check(call: &BlindCheckCall) -> Result<(), Failure> {
    let jobs = call.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    if let Some(folder) = &call.verify {
        return verify::verify(&Store(folder.clone()), jobs);
    }
    let out = call.out.as_ref().ok_or_else(|| Failure::call("nowhere to write: name a directory with --out"))?;
    let store = Store(out.clone());
    let program = runner::program(call.program.as_deref())?;
    if let Some(manifest) = &call.manifest {
        return measured::measured(&store, manifest, &program, jobs);
    }
    let is_part = call.shard.is_some_and(|shard| shard.of > 1);
    if is_part && (call.leave_one_out || call.active) {
        return Err(Failure::call(
            "--leave-one-out and --active know the labels, which stay sealed until all parts are answered: give them with --merge, not with --shard",
        ));
    }
    let order = if call.merge.is_empty() { order(call)? } else { order_of(&call.merge)? };
    let labels = order.labels().map_err(Failure::file)?;
    let is_opening = order.split == "report";
    let book = books::openings(call.openings.as_deref());
    if let Some(book) = book.as_ref().filter(|_| is_opening) {
        books::refuse_second_opening(book, &order)?;
    }
    store.settle("order.json", &json(&order)?)?;
    let labels_sha256 = books::seal(&store, &json(&labels)?, labels.len())?;

    let ids: Vec<&str> = labels.iter().map(|label| label.id.as_str()).collect();
    let part = |at: usize| call.shard.is_none_or(|shard| shard.holds(at));
    let mine: Vec<Label> =
        labels.iter().enumerate().filter(|(at, _)| part(*at)).map(|(_, label)| label.clone()).collect();
    if call.merge.is_empty() {
        program.settle(&store, &ids)?;
        answer(&store, &order, &mine, &program, jobs)?;
    } else {
        merge(&store, &labels, &call.merge)?;
    }
    if let Some(shard) = call.shard.as_ref().filter(|_| is_part) {
        output::line(&format!(
            "part {shard} is done, {} cases; put all parts together with `hysteron blind-check --merge DIR... --out DIR`",
            mine.len()
        ));
        return Ok(());
    }
    // From here on everything is answered, that of other parts too, and the seal may be opened.
    books::unseal(&store)?;
    if call.leave_one_out || call.active {
        program.settle(&store, &ids)?;
    }
    if call.leave_one_out {
        again::leave_one_out(&store, &order, &labels, &program, jobs)?;
    }
    if call.active {
        again::make_experiments(&store, &order, &labels, &program, jobs)?;
    }

    let score = books::score_made(&store, &labels)?;
    if let Some(left_out) = score.left_out.as_ref().filter(|left_out| left_out.made < left_out.of) {
        let LeftOut { made, of, .. } = left_out;
        output::warn(&[format!(
            "of {of} cases with one effect {made} were diagnosed without it: --leave-one-out goes on"
        )]);
    }
    if let Some(active) = score.active.as_ref().filter(|active| active.open > 0) {
        output::warn(&[format!("{} proposed experiments are still to be made: --active goes on", active.open)]);
    }
    let provenance = books::provenance(&store, &order, &labels_sha256, &ids, &call.commit)?;
    if is_opening {
        match &book {
            Some(path) => books::book(path, &order, &score, &provenance)?,
            None => output::warn(&[
                "this opening of the report split is written down nowhere: name its book with --openings".into(),
            ]),
        }
    }
    let subtitle = format!(
        "{} cases of {} logs, split {}, seed {}, labels sealed by sha256 {}",
        labels.len(),
        order.size,
        order.split,
        order.seed,
        &labels_sha256[..16]
    );
    let seed = Some(order.seed);
    books::publish(
        &store,
        &Shown { title: "Blind check", subtitle, score: &score, provenance: &provenance, ids: &ids, seed },
    )
}

fn order(call: &BlindCheckCall) -> Result<Order, Failure> {
    let seed = call.seed.ok_or_else(|| Failure::call("which cases? give a number with --seed"))?;
    Ok(Order {
        seed,
        split: call.split.clone(),
        size: call.size.clone(),
        scale: call.scale,
        quick: call.quick,
        first: call.first,
    })
}

/// Makes and diagnoses what is not done yet.
fn answer(store: &Store, order: &Order, labels: &[Label], program: &Asked, jobs: usize) -> Result<(), Failure> {
    each(labels, jobs, "diagnosing", |label| {
        ask(program, &store.case(&label.id), |folder| {
            let case = case(label, order)?;
            seal_truth(store, &label.id, &case)?;
            Ok(Ok(lay_out(&case, folder)?))
        })
    })
}

/// What the parts of a run were ordered as, which must be one order under one seal.
fn order_of(parts: &[PathBuf]) -> Result<Order, Failure> {
    let read_part = |part: &PathBuf| -> Result<(Order, String), Failure> {
        let part = Store(part.clone());
        Ok((read_json(&part.path("order.json"))?, read(&part.path("seal.txt"))?))
    };
    let first = parts.first().ok_or_else(|| Failure::call("nothing to merge: name the directories of the parts"))?;
    let order = read_part(first)?;
    for part in parts {
        if read_part(part)? != order {
            let (part, first) = (part.display(), first.display());
            return Err(Failure::file(format!("{part}: is a part of another run than {first}")));
        }
    }
    Ok(order.0)
}

/// Copies the parts of a run together, which one program must have answered.
fn merge(store: &Store, labels: &[Label], parts: &[PathBuf]) -> Result<(), Failure> {
    let of_part = |part: &PathBuf| runner::program_of(&Store(part.clone()));
    let programs = parts.iter().map(of_part).collect::<Result<Vec<Option<String>>, Failure>>()?;
    let known = programs.iter().zip(parts).find_map(|(program, part)| Some((program.as_deref()?, part)));
    if let Some((sha256, of)) = known {
        let is_other =
            |(program, _): &(&Option<String>, &PathBuf)| program.as_deref().is_some_and(|program| program != sha256);
        if let Some((_, other)) = programs.iter().zip(parts).find(is_other) {
            return Err(Failure::file(format!(
                "{}: was answered by another program than {} (program.txt): run one of them again",
                other.display(),
                of.display()
            )));
        }
    }
    match known {
        Some((sha256, _)) if programs.iter().all(Option::is_some) => {
            runner::settle_program(store, runner::program_of(store)?.as_deref(), sha256)?;
        }
        _ => output::warn(&[runner::NOT_KNOWN.to_owned()]),
    }
    let mut missing = Vec::new();
    for label in labels {
        let holds = |part: &&PathBuf| runner::ran(&Store((*part).clone()).case(&label.id)).is_some();
        match parts.iter().find(holds) {
            None => missing.push(label),
            Some(part) => take(&Store(part.clone()), store, &label.id)?,
        }
    }
    let Some(label) = missing.first() else { return Ok(()) };
    Err(Failure::file(format!(
        "{} of {} cases are in no part, the first is {}: run the other parts too",
        missing.len(),
        labels.len(),
        label.id
    )))
}

/// Copies one case with all that belongs to it.
fn take(from: &Store, to: &Store, id: &str) -> Result<(), Failure> {
    write(&to.truth(id), read(&from.truth(id))?.as_bytes())?;
    let folders: [fn(&Store, &str) -> PathBuf; 3] = [Store::case, Store::left_out, Store::active];
    for folder in folders {
        let (from, to) = (folder(from, id), folder(to, id));
        // A second diagnosis that was killed is none.
        if runner::ran(&from).is_none() {
            continue;
        }
        let unreadable = |e| Failure::file(format!("{}: {e}", from.display()));
        let entries = fs::read_dir(&from).map_err(unreadable)?;
        let mut paths: Vec<PathBuf> =
            entries.map(|entry| Ok(entry.map_err(unreadable)?.path())).collect::<Result<_, Failure>>()?;
        // What says that all is there comes last.
        paths.sort_by_key(|path| path.ends_with(runner::DONE));
        for path in paths {
            write(&to.join(output::file_name(&path)), read(&path)?.as_bytes())?;
        }
    }
    Ok(())
}
