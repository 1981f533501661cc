//! `hysteron` alone: what it can do, shown on a made bench, each step as a call that can be repeated.

use crate::arguments::Arguments;
use crate::failure::Failure;
use crate::output;
use clap::Parser;
use plant_sim::model::Model;
use plant_sim::param::Param;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::Path;

/// The thesis' plant and controller; the demonstration works wherever the command is run.
const PLANT: &str = include_str!("../../models/thesis-phs.toml");
const CONTROLLER: &str = include_str!("../../controllers/pi1.toml");
/// How far the made bench is from its model, as a natural logarithm, and its sensor's noise.
const SPREAD: f64 = 0.1;
const NOISE_UM: f64 = 0.02;
const SEED: u64 = 1;
/// Steps and sines that open the dead zones of both hysterons within a second.
const DRIVE: &str =
    "hold:30V@0.1s+hold:55V@0.1s+hold:20V@0.1s+hold:-20V@0.1s+sine:74V@20Hz,for=0.3s+sine:68V@100Hz,for=0.3s";

pub fn demo() -> Result<(), Failure> {
    output::line("hysteron makes a piezo actuator's simulation match its bench:\n");
    output::line("  simulate   the board's control law against a plant, or a plant alone");
    output::line("  replay     a measured log's command through a plant: how far off is the simulation?");
    output::line("  identify   fits a plant with hysterons to measured logs");
    output::line("  effects    what a bench may do beyond its nominal plant, and how that shows");
    output::line("  blind-check  the diagnosis tested on cases whose effect is withheld");
    output::line("\nhysteron COMMAND --help says more. Here is a short demonstration.");

    let folder = std::env::temp_dir().join("hysteron-demo");
    std::fs::create_dir_all(&folder).map_err(|e| Failure::unwritable(&folder, &e))?;
    let file = |name: &str| folder.join(name).display().to_string();
    for (name, text) in [("thesis-phs.toml", PLANT), ("pi1.toml", CONTROLLER)] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| Failure::unwritable(&path, &e))?;
    }
    let bench = made_bench(&folder.join("thesis-phs.toml"))?;
    bench.write(&folder.join("made-bench.toml"))?;

    output::line(&format!(
        "\n1. A bench is made: the thesis' actuator with every number off by up to 10 % (seed {SEED}). It is driven and logged."
    ));
    let (plant, log) = (file("thesis-phs.toml"), file("bench.csv"));
    call(&["simulate", "--plant", &file("made-bench.toml"), "--command", DRIVE, "--rate", "10000", "--out", &log])?;
    output::line("\n2. How far is the nominal model from that bench?");
    call(&["replay", "--plant", &plant, &log, "--out", &file("before.csv")])?;
    output::line("\n3. The model is fitted to the log.");
    call(&["identify", "--model", "phs", "--plant", &plant, &log, "--out", &file("fitted.toml")])?;
    output::line("\n4. How far is it now?");
    call(&["replay", "--plant", &file("fitted.toml"), &log, "--out", &file("after.csv")])?;
    output::line("\n5. The control law of the board on the fitted model, an 80 um step at 20 kHz.");
    call(&[
        "simulate",
        "--plant",
        &file("fitted.toml"),
        "--controller",
        &file("pi1.toml"),
        "--reference",
        "step:80um",
        "--rate",
        "20000",
        "--seconds",
        "0.02",
        "--out",
        &file("step.csv"),
    ])?;
    output::line(&format!("\nOpen {} in a browser to see step 3.", file("fitted.html")));
    Ok(())
}

/// Shows a call and makes it.
fn call(words: &[&str]) -> Result<(), Failure> {
    let quoted = |word: &&str| if word.contains(['+', ' ']) { format!("'{word}'") } else { (*word).to_owned() };
    output::line(&format!("   $ hysteron {}", words.iter().map(quoted).collect::<Vec<_>>().join(" ")));
    let arguments = Arguments::try_parse_from(std::iter::once("hysteron").chain(words.iter().copied()));
    arguments.map_err(|e| Failure::call(e.to_string())).and_then(|arguments| super::run(&arguments))
}

/// The nominal plant with every number moved, and a noisy sensor.
fn made_bench(nominal: &Path) -> Result<Model, Failure> {
    let mut model = Model::read(nominal)?;
    let mut random = Pcg64::seed_from_u64(SEED);
    model.name = "made bench".into();
    let mut records = vec![
        &mut model.structure.damping_n_s_per_m,
        &mut model.structure.stiffness_n_per_m,
        &mut model.actuator.transduction_c_per_m,
    ];
    for hysteron in &mut model.actuator.hysterons {
        records.extend([&mut hysteron.capacitance_f, &mut hysteron.slope_s, &mut hysteron.dead_zone_v]);
    }
    for record in records {
        record.value *= random.random_range(-SPREAD..SPREAD).exp();
        record.source = format!("made, seed {SEED}");
    }
    model.sensor.noise_um = Some(Param::new(NOISE_UM, 0.0, "made"));
    Ok(model)
}
