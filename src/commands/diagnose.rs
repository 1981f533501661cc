//! `hysteron diagnose`: where plant and logs differ, which effect makes the difference, how far it shrinks.

use crate::arguments::DiagnoseCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::diagnose::{self, Diagnosis, Loop, Options};
use gap_diagnosis::locate::strongest;
use gap_diagnosis::responses::MOST_ROWS as MOST_ROWS_OF_RESPONSE;
use plant_sim::controller::Controller;
use plant_sim::log::Log;
use plant_sim::model::{Kind, Model};
use std::fs;
use std::path::{Path, PathBuf};

/// What is written into the directory.
pub const FILES: [&str; 3] = ["diagnosis.json", "augmented.toml", "report.html"];
/// Entries that the terminal ranks, and the least probability that is worth a line.
const RANKED: usize = 5;
const LEAST: f64 = 0.01;
/// Rows of a log that are read into memory: ten minutes at 20 kHz are 12 million.
const MOST_ROWS: usize = 13_000_000;
/// Steps of the progress bar.
const STEPS: u64 = 1000;

pub fn diagnose(call: &DiagnoseCall) -> Result<(), Failure> {
    run(call).map(|_| ())
}

/// Diagnoses, writes and prints; the demonstration looks at what was found.
pub fn run(call: &DiagnoseCall) -> Result<Diagnosis, Failure> {
    check_directory(call)?;
    let plant = Model::read(&call.plant)?;
    if plant.kind != Kind::Phs {
        return Err(Failure::call(format!(
            "{}: a plant of kind {} can't be diagnosed: the registry's effects are stated about hysterons; give a plant of kind phs",
            call.plant.display(),
            plant.kind.name()
        )));
    }
    let mut logs = super::logs::read(&call.logs, &call.held_out, &call.read, MOST_ROWS)?;
    let mut held_out = super::logs::read(&call.held_out, &call.logs, &call.read, MOST_ROWS)?;
    for log in logs.iter_mut().chain(&mut held_out) {
        forget_unused(log);
    }
    let options = Options {
        initial: call.start.initial,
        run_in_s: call.start.run_in,
        seed: call.seed,
        without: call.without.clone(),
        predict: match &call.controller {
            Some(path) => Some(Loop { controller: Controller::read(path)?, reference: call.reference.clone() }),
            None => None,
        },
    };
    let bar = output::bar(STEPS, "");
    let mut found = diagnose::diagnose(&plant, &logs, &held_out, &options, &|what, share| {
        bar.set_message(what.to_owned());
        bar.set_position((share * STEPS as f64) as u64);
    })?;
    bar.finish_and_clear();
    found.warnings.splice(0..0, output::about(&call.plant, plant.warnings()));
    let unsaid = |e: serde_json::Error| Failure::call(format!("diagnosis.json: {e}"));
    write(call, &found, &serde_json::to_string_pretty(&found).map_err(unsaid)?)?;
    output::warn(&found.warnings);
    if call.json {
        output::line(&serde_json::to_string(&found).map_err(unsaid)?);
    } else {
        print(call, &found);
    }
    Ok(found)
}

/// Refuses a place that can't take the files, before any work is done.
fn check_directory(call: &DiagnoseCall) -> Result<(), Failure> {
    let out = &call.out;
    let refuse = |what: &str| Err(Failure::call(format!("{}: {what} with --out", out.display())));
    if out.exists() && !out.is_dir() {
        return refuse("is not a directory; name one");
    }
    let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !out.exists() && !parent.is_dir() {
        return refuse(&format!("the directory {} is not there; make it or name another", parent.display()));
    }
    if out.metadata().is_ok_and(|found| found.permissions().readonly()) {
        return refuse("may not be written into; make it writable or name another");
    }
    let inputs = [&call.plant].into_iter().chain(&call.logs).chain(&call.held_out);
    let read: Vec<PathBuf> = inputs.filter_map(|path| path.canonicalize().ok()).collect();
    for name in FILES {
        let path = out.join(name);
        if path.canonicalize().is_ok_and(|path| read.contains(&path)) {
            return Err(Failure::call(format!(
                "{}: is read by this call and would be overwritten; name another directory with --out",
                path.display()
            )));
        }
        if path.is_dir() {
            return Err(Failure::call(format!("{}: is a directory; name another with --out", path.display())));
        }
    }
    Ok(())
}

/// Leaves the columns that a diagnosis reads: of ten minutes at 20 kHz each takes a hundred megabytes. A reference is read for the frequency
/// response only, which logs as long as that have none of.
fn forget_unused(log: &mut Log) {
    let is_long = log.len() > MOST_ROWS_OF_RESPONSE;
    let Log { reference_m, current_a, temperature_c, limited_by, seq, .. } = log;
    [current_a, temperature_c, limited_by, seq].into_iter().for_each(|column| *column = None);
    reference_m.take_if(|_| is_long);
}

/// Writes all files beside their places and then puts them there, so that a failure leaves what was.
fn write(call: &DiagnoseCall, found: &Diagnosis, json: &str) -> Result<(), Failure> {
    let unwritable = |path: &Path, error: std::io::Error| Failure::unwritable(path, &error);
    fs::create_dir_all(&call.out).map_err(|e| unwritable(&call.out, e))?;
    let part = call.out.join(format!(".{}.part", std::process::id()));
    let written = fs::create_dir(&part).map_err(|e| unwritable(&part, e)).and_then(|()| {
        let [json_path, model_path, page_path] = FILES.map(|name| part.join(name));
        fs::write(&json_path, format!("{json}\n")).map_err(|e| unwritable(&json_path, e))?;
        found.augmented.write(&model_path)?;
        page(call, found).save(&page_path).map_err(|e| unwritable(&page_path, e))?;
        for name in FILES {
            let path = call.out.join(name);
            fs::rename(part.join(name), &path).map_err(|e| unwritable(&path, e))?;
        }
        Ok(())
    });
    let _ = fs::remove_dir_all(&part);
    written
}

fn page(call: &DiagnoseCall, found: &Diagnosis) -> gap_diagnosis::page::Page {
    let count = |n: usize| if n == 1 { "1 log".to_owned() } else { format!("{n} logs") };
    let held_out = match call.held_out.len() {
        0 => String::new(),
        n => format!(", {} held out", count(n)),
    };
    let subtitle = format!("{}, {}{held_out}", output::file_name(&call.plant), count(call.logs.len()));
    found.page("Diagnosis", &subtitle, &output::provenance(Some(call.seed)))
}

fn print(call: &DiagnoseCall, found: &Diagnosis) {
    output::line(&found.sentence());
    output::line(&format!("fit: {} (nominal, refitted, with what is named)", found.gap.fits(", ")));
    output::line(&format!("where: {}", strongest(&found.location)));
    for ranked in found.ranking.iter().take(RANKED).filter(|ranked| ranked.probability >= LEAST) {
        output::line(&format!("  {:28} {:5.1} %", ranked.effect, 100.0 * ranked.probability));
    }
    for estimate in &found.parameters {
        let name = format!("{}.{}", estimate.effect, estimate.name);
        output::line(&format!("  {name:44} {:>11.4e} +- {:.1e} {}", estimate.value, estimate.sigma, estimate.unit));
    }
    for changed in &found.changed {
        output::line(&format!(
            "  {:44} {:>11.4e}, stated {:.4e} +- {:.1e}",
            changed.name, changed.refit, changed.nominal, changed.sigma
        ));
    }
    if let Some(of) = &found.closed_loop {
        output::line(&format!(
            "tracking error of {} on {}: {:.4} um with the nominal plant, {:.4} um with the diagnosed one",
            of.controller, of.reference, of.nominal_error_um, of.augmented_error_um
        ));
    }
    match &found.next_experiment {
        Some(next) => {
            output::line(&format!("next: {} at {} Hz splits {}", next.spec, next.rate_hz, next.splits.join(", ")))
        }
        None => {
            if let Some(reason) = found.no_experiment_reason.as_ref().filter(|_| !found.classes.is_empty()) {
                output::line(&format!("next: {reason}"));
            }
        }
    }
    output::line(&format!("files: {}", FILES.map(|name| call.out.join(name).display().to_string()).join(", ")));
}
