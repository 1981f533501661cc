//! Fits a plant with two hysterons to a CSV log and says what the log tells about each number.
//!
//! `cargo run --release -p gap-diagnosis --example identify -- LOG.csv`

use gap_diagnosis::identify::{From, Hysterons, Options, identify};
use plant_sim::log::{ReadOptions, read};
use plant_sim::replay::Initial;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give a log with time_s, command_V and displacement_um")?;
    let log = read(Path::new(&path), &ReadOptions::default())?;
    let options = Options {
        from: From::Logs { hysterons: Hysterons::Fixed(2), mass_kg: 1.0148e-3 },
        initial: Initial::Rest,
        run_in_s: None,
        starts: 4,
        seed: 1,
    };
    let fit = identify(&[log], &options, &|phase, _| eprintln!("{phase}"))?;
    for parameter in &fit.parameters {
        println!("{:22} {:12.5e} +- {:9.2e}  {}", parameter.name, parameter.value, parameter.sigma, parameter.note);
    }
    println!("fit {:.2} %, noise {:.4} um", fit.logs[0].fit_percent, fit.logs[0].noise_m * 1e6);
    Ok(())
}
