//! What a diagnosis costs: `cargo xtask bench diagnosis`.
//!
//! Five logs at 20 kHz, 11 s in all, of made benches: a diagnosis with the whole registry beside an identification of the nominal plant from
//! the same logs, as `hysteron identify --plant` makes it from one start, one after the other in one run. The ratio is
//! time over time; 40 is the most that is wanted. Then how a diagnosis grows with samples and with entries.

use blind_truth::{EffectId, Request, Size, Split, Subject, make};
use gap_diagnosis::diagnose::{self, Verdict, diagnose};
use gap_diagnosis::identify::{self, From, identify};
use plant_sim::effects;
use plant_sim::log::{Log, ReadOptions, read};
use plant_sim::model::Model;
use plant_sim::replay::Initial;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Of all cases.
const SEED: u64 = 11;
/// Shares of each log for the table of growth.
const SHARES: [f64; 4] = [0.125, 0.25, 0.5, 1.0];
/// Entries that are struck out for it: all but this many stay.
const ENTRIES: [usize; 4] = [4, 8, 16, usize::MAX];

struct Case {
    plant: Model,
    logs: Vec<Log>,
}

fn main() {
    println!("seed {SEED}, forms of the develop split, {} entries", effects::REGISTRY.len());
    println!(
        "{:<26} {:>7} {:>12} {:>12} {:>7} {:>12}  verdict",
        "bench", "s", "identify s", "diagnose s", "ratio", "simulations"
    );
    let subjects: [&[EffectId]; 6] = [
        &[],
        &[EffectId::Creep],
        &[EffectId::SensorBandwidth],
        &[EffectId::AsymmetricHysteresis],
        &[EffectId::CoulombFriction],
        &[EffectId::Backlash, EffectId::ThermalGain],
    ];
    for subject in subjects {
        let case = made(subject);
        let (fitted_s, _) = timed(|| {
            let options = identify::Options {
                from: From::Plant(Box::new(case.plant.clone())),
                initial: Initial::Rest,
                run_in_s: None,
                starts: 1,
                seed: SEED,
            };
            identify(&case.logs, &options, &|_, _| {}).expect("logs that can be fitted")
        });
        let (diagnosed_s, found) = timed(|| diagnosed(&case, &case.logs, &[]));
        let verdict = match found.verdict {
            Verdict::Explained => found.effects.join(" + "),
            Verdict::NoGap => "no_gap".to_owned(),
            Verdict::Unknown => "unknown".to_owned(),
        };
        println!(
            "{:<26} {:>7.1} {fitted_s:>12.1} {diagnosed_s:>12.1} {:>7.1} {:>12}  {verdict}",
            name(subject),
            seconds(&case.logs),
            diagnosed_s / fitted_s,
            found.simulations
        );
    }
    let case = made(&[EffectId::Creep]);
    println!("\ncreep, by samples");
    for share in SHARES {
        let logs: Vec<Log> = case.logs.iter().map(|log| log.first((share * log.len() as f64) as usize)).collect();
        let (wall_s, found) = timed(|| diagnosed(&case, &logs, &[]));
        let rows: usize = logs.iter().map(Log::len).sum();
        println!(
            "{rows:>9} rows {wall_s:>8.1} s {:>9} simulations {:>8.1} us a row",
            found.simulations,
            1e6 * wall_s / rows as f64
        );
    }
    println!("\ncreep, by entries");
    for entries in ENTRIES {
        let others = effects::REGISTRY.iter().map(|effect| effect.id()).filter(|id| *id != "creep");
        let without: Vec<String> = others.skip(entries.saturating_sub(1)).map(str::to_owned).collect();
        let (wall_s, found) = timed(|| diagnosed(&case, &case.logs, &without));
        println!(
            "{:>9} entries {wall_s:>8.1} s {:>9} simulations",
            effects::REGISTRY.len() - without.len(),
            found.simulations
        );
    }
}

fn name(subject: &[EffectId]) -> String {
    if subject.is_empty() {
        "no effect".into()
    } else {
        subject.iter().map(|id| id.id()).collect::<Vec<_>>().join(" + ")
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let begun = Instant::now();
    let done = work();
    (begun.elapsed().as_secs_f64(), done)
}

fn diagnosed(case: &Case, logs: &[Log], without: &[String]) -> diagnose::Diagnosis {
    let options = diagnose::Options { seed: SEED, without: without.to_vec(), ..diagnose::Options::default() };
    diagnose(&case.plant, logs, &[], &options, &|_, _| {}).expect("logs that can be diagnosed")
}

fn seconds(logs: &[Log]) -> f64 {
    logs.iter().map(|log| log.len() as f64 * log.dt_s).sum()
}

/// A bench with these effects, its files read as a user's would be.
fn made(subject: &[EffectId]) -> Case {
    let subject = if subject.is_empty() { Subject::Null } else { Subject::Effects(subject.to_vec()) };
    let case = make(&Request { seed: SEED, subject, split: Split::Develop, size: Size::Full, strength: None });
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/diagnosis");
    fs::create_dir_all(&folder).expect("a folder to write to");
    let plant = folder.join("nominal.toml");
    fs::write(&plant, &case.plant_toml).expect("room on the disk");
    let logs = case.logs.iter().map(|log| {
        let path = folder.join(format!("{}.csv", log.name));
        fs::write(&path, log.to_csv()).expect("room on the disk");
        read(&path, &ReadOptions::default()).expect("a log")
    });
    Case { logs: logs.collect(), plant: Model::read(&plant).expect("a model") }
}
