//! The board's control law against the thesis' plant: an 80 um step at 20 kHz, 10 us from sampling to the new drive.
//!
//! `cargo run --release -p plant-sim --example step`

use plant_sim::controller::Controller;
use plant_sim::experiment::{Program, Setup, closed_loop};
use plant_sim::metrics::{Task, loop_metrics};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rate_hz = 20e3;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let chain = Model::read(&root.join("models/thesis-phs.toml"))?.chain();
    let settings = Controller::read(&root.join("controllers/pi1.toml"))?.settings(rate_hz);
    let program = Program::new(&Spec::parse("step:80um")?, rate_hz)?;
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz, samples: 400, latency_s: 10e-6, seed: 1 };
    let run = closed_loop(&setup, &settings, &program, &|_| ())?;
    let task = Task::Step { height_m: 80e-6 };
    let metrics = loop_metrics(task, run.dt_s, Some(&run.reference_m), &run.displacement_m);
    println!(
        "rise {:?} ms, overshoot {:?} %, peak {:.2} um",
        metrics.rise_ms, metrics.overshoot_percent, metrics.peak_um
    );
    Ok(())
}
