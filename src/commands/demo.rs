//! `hysteron` alone: a bench is made with an effect that nobody is told of, diagnosed, and only then is the seal opened.

use crate::arguments::{Arguments, Command};
use crate::failure::Failure;
use crate::output;
use blind_truth::{Case, EffectId, Request, Size, Split, Subject, make};
use clap::Parser;
use gap_diagnosis::diagnose::Diagnosis;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Seeds from the clock have so many digits that a person can type them again.
const SEEDS: u64 = 1_000_000;

pub fn demo(seed: Option<u64>) -> Result<(), Failure> {
    output::line("hysteron makes a piezo actuator's simulation match its bench:\n");
    output::line("  simulate   the board's control law against a plant, or a plant alone");
    output::line("  replay     a measured log's command through a plant: how far off is the simulation?");
    output::line("  identify   fits a plant with hysterons to measured logs");
    output::line("  diagnose   where plant and bench differ, which effect makes the difference, how far it shrinks");
    output::line("  effects    what a bench may do beyond its nominal plant, and how that shows");
    output::line("  blind-check  the diagnosis tested on cases whose effect is withheld");
    output::line("  design     a controller from a wish, or a check of one");
    output::line("  reproduce  the thesis' numbers and figures, printed beside recomputed");
    output::line("  board      the flash image on the virtual board");
    output::line("  hil        the control code on a board against the simulated plant");
    output::line("  record     experiments on a bench that hangs on the board's own pins");
    output::line("  serve      the bench in a browser");
    output::line("  export     a log as CSV, NPY, MAT v5, Parquet or MDF 4");
    output::line("\nhysteron COMMAND --help says more. Here is a demonstration; it takes about a minute.");

    let seed = seed.unwrap_or_else(clock);
    let folder = std::env::temp_dir().join(format!("hysteron-demo-{seed}"));
    fs::create_dir_all(&folder).map_err(|e| Failure::unwritable(&folder, &e))?;
    output::line(&format!(
        "\n1. A bench is made from seed {seed}: the thesis' actuator, its numbers off by their sigma, its sensor noisy, and one\n   \
         effect that the nominal plant lacks. It is driven and logged; the effect's name is sealed."
    ));
    let case = made(seed);
    let sealed = write(&folder.join("sealed.txt"), &label(&case))?;
    let plant = write(&folder.join("nominal.toml"), &case.plant_toml)?;
    let log = |log: &blind_truth::Record| write(&folder.join(format!("{}.csv", log.name)), &log.to_csv());
    let logs = case.logs.iter().map(log).collect::<Result<Vec<_>, _>>()?;
    let held_out = case.held_out.iter().map(log).collect::<Result<Vec<_>, _>>()?;
    let seal = sha256(&sealed)?;
    output::line(&format!("   {}: sha256 {seal}", sealed.display()));

    output::line("\n2. The gap between the nominal plant and the logs is diagnosed; held-out logs score the answer.");
    let out = folder.join("diagnosis");
    let mut words = vec!["diagnose".to_owned(), "--plant".to_owned(), plant.display().to_string()];
    words.extend(logs.iter().map(|path| path.display().to_string()));
    words.push("--held-out".to_owned());
    words.extend(held_out.iter().map(|path| path.display().to_string()));
    words.extend(["--out".to_owned(), out.display().to_string()]);
    let found = call(&words)?;

    output::line("\n3. The seal is opened.");
    let intact = sha256(&sealed)? == seal;
    let truth: Vec<&str> = case.truth.effects.iter().map(|effect| effect.id()).collect();
    output::line(&format!("   sha256 {} as before", if intact { "is" } else { "IS NOT" }));
    output::line(&format!("   on the bench: {} ({})", truth.join(", "), case.truth.form));
    output::line(&format!("   the diagnosis is {}", compared(&truth, &found)));
    output::line("\nThe report, to be opened in a browser:");
    output::line(&out.join("report.html").display().to_string());
    Ok(())
}

fn clock() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |time| time.as_nanos() as u64 % SEEDS)
}

/// A short case with one effect drawn from the seed.
fn made(seed: u64) -> Case {
    let effects: Vec<EffectId> = EffectId::all().collect();
    let effect = effects[Pcg64::seed_from_u64(seed).random_range(0..effects.len())];
    let subject = Subject::Effects(vec![effect]);
    make(&Request { seed, subject, split: Split::Develop, size: Size::Short, strength: None })
}

/// What is sealed. The numbers keep a short name from being guessed from its hash.
fn label(case: &Case) -> String {
    let effects: Vec<&str> = case.truth.effects.iter().map(|effect| effect.id()).collect();
    let mut text = format!("effect: {}\nform: {}\n", effects.join(", "), case.truth.form);
    for (name, value) in &case.truth.parameters {
        text += &format!("{name} = {value:e}\n");
    }
    text
}

fn write(path: &Path, text: &str) -> Result<PathBuf, Failure> {
    output::save(path, text.as_bytes())?;
    Ok(path.to_owned())
}

fn sha256(path: &Path) -> Result<String, Failure> {
    let bytes = fs::read(path).map_err(|e| Failure::file(format!("{}: cannot be read: {e}", path.display())))?;
    Ok(Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Shows a diagnosis' call and makes it.
fn call(words: &[String]) -> Result<Diagnosis, Failure> {
    output::line(&format!("   $ hysteron {}\n", words.join(" ")));
    let arguments = Arguments::try_parse_from(std::iter::once("hysteron").chain(words.iter().map(String::as_str)));
    match arguments.map_err(|e| Failure::call(e.to_string()))?.command {
        Some(Command::Diagnose(call)) => super::diagnose::run(&call),
        _ => Err(Failure::call("the demonstration's call is no diagnosis")),
    }
}

/// How the diagnosis did.
fn compared(truth: &[&str], found: &Diagnosis) -> String {
    let holds = |list: &[String]| truth.iter().all(|id| list.iter().any(|named| named == id));
    if holds(&found.effects) && found.effects.len() == truth.len() {
        "right.".to_owned()
    } else if found.classes.iter().any(|class| holds(&class.members)) {
        "right as far as these logs go: the truth is in the class that it names.".to_owned()
    } else if holds(&found.set90) || holds(&found.effects) {
        "not alone: the truth is among what it names.".to_owned()
    } else {
        let why = if found.effects.is_empty() { "it names none" } else { "it names another" };
        format!("wrong: {why}. Please report the seed.")
    }
}
