//! Diagnoses the gap between a plant and logs: `cargo run --release -p gap-diagnosis --example diagnose -- PLANT.toml LOG.csv...`

use gap_diagnosis::diagnose::{Options, diagnose};
use plant_sim::log::{Log, LogError, ReadOptions, read};
use plant_sim::model::Model;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let plant = Model::read(Path::new(&arguments.next().ok_or("give a plant and logs")?))?;
    let logs: Vec<Log> =
        arguments.map(|path| read(Path::new(&path), &ReadOptions::default())).collect::<Result<_, LogError>>()?;
    let found = diagnose(&plant, &logs, &[], &Options::default(), &|what, _| eprintln!("{what}"))?;
    println!("{}", found.sentence());
    for ranked in found.ranking.iter().take(3) {
        println!("{:28} {:6.1} %", ranked.effect, 100.0 * ranked.probability);
    }
    for estimate in &found.parameters {
        println!("{}: {:.4e} +- {:.1e} {}", estimate.name, estimate.value, estimate.sigma, estimate.unit);
    }
    found.augmented.write(Path::new("augmented.toml"))?;
    found.page("Diagnosis", &plant.name, &[]).save(Path::new("diagnosis.html"))?;
    Ok(())
}
