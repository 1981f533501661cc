//! All kinds of models on the same logs: the kind that made them comes first, and what was held out decides.

use gap_diagnosis::identify::compare::{Comparison, compare};
use gap_diagnosis::identify::{From, Hysterons, Options};
use plant_sim::log::Log;
use plant_sim::model::{Kind, Model};
use plant_sim::replay::{Initial, Start, predict};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use std::path::Path;

const RATE_HZ: f64 = 10e3;
const NOISE_M: f64 = 20e-9;

fn model(name: &str) -> Model {
    Model::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(name)).expect("a model of the project")
}

fn made(model: &Model, name: &str, seed: u64, command_v: Vec<f64>) -> Log {
    let chain = model.chain();
    let zeros = vec![0.0; command_v.len()];
    let mut log = Log { name: name.into(), dt_s: 1.0 / RATE_HZ, displacement_m: zeros, command_v, ..Log::default() };
    log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
    let mut random = Pcg64::seed_from_u64(seed);
    let noise = Normal::new(0.0, NOISE_M).expect("a spread");
    log.displacement_m.iter_mut().for_each(|y| *y += noise.sample(&mut random));
    log
}

fn sine(hz: f64, volts: f64, rows: usize) -> Vec<f64> {
    (0..rows).map(|k| volts * (std::f64::consts::TAU * hz * k as f64 / RATE_HZ).sin()).collect()
}

fn steps(rows: usize) -> Vec<f64> {
    let levels = [0.0, 30.0, 60.0, 20.0, -40.0, -60.0, 0.0, 50.0];
    (0..rows).map(|k| levels[k * levels.len() / rows]).collect()
}

fn ranked(model: &Model, held_out: &[Log]) -> Comparison {
    let logs = [made(model, "steps", 1, steps(2400)), made(model, "sine 50", 2, sine(50.0, 60.0, 1200))];
    let options = Options {
        from: From::Logs { hysterons: Hysterons::Auto, mass_kg: 1e-3 },
        initial: Initial::Relaxed,
        run_in_s: None,
        starts: 2,
        seed: 1,
    };
    let mass_kg = model.structure.mass_kg.value;
    compare(&logs, held_out, None, mass_kg, &options, &|_, _| {}).expect("fitted")
}

fn table(found: &Comparison) -> String {
    let line = |c: &gap_diagnosis::identify::compare::Candidate| {
        format!(
            "{:9.1} nm {:7.3} % {:7.3} % {:3} {:9.0} {}",
            c.held_out_rms_m * 1e9,
            c.held_out_percent,
            c.fitted_percent,
            c.coordinates,
            c.evidence,
            c.kind
        )
    };
    found.candidates.iter().map(line).collect::<Vec<_>>().join("\n")
}

#[test]
fn hysterons_come_first_where_hysterons_made_the_logs() {
    let plant = model("thesis-phs.toml");
    let other = made(&plant, "sine 10", 3, sine(10.0, 45.0, 1500));
    let found = ranked(&plant, &[other]);
    let best = &found.candidates[0];
    assert!(
        best.kind.starts_with("port-Hamiltonian, 2") || best.kind.starts_with("port-Hamiltonian, 3"),
        "{}",
        table(&found)
    );
    assert!((0.9 * NOISE_M..1.3 * NOISE_M).contains(&best.held_out_rms_m), "{}", table(&found));
    // Every kind took part, and none that knows no dead zone comes near.
    assert!(found.candidates.len() == 16 && found.failed.is_empty(), "{:?}", found.failed);
    let others = found.candidates.iter().filter(|c| c.model.kind != Kind::Phs);
    assert!(others.into_iter().all(|c| c.held_out_rms_m > 5.0 * best.held_out_rms_m), "{}", table(&found));
}

#[test]
fn bouc_wen_comes_first_where_it_made_the_logs() {
    let found = ranked(&model("thesis-bouc-wen.toml"), &[]);
    let best = &found.candidates[0];
    assert_eq!(best.kind, "Bouc-Wen actuator", "{}", table(&found));
    assert!((0.9 * NOISE_M..1.2 * NOISE_M).contains(&best.held_out_rms_m), "{}", table(&found));
    assert!(!found.whole_logs && best.held_out.iter().all(|h| h.name.ends_with("last 30 %")));
    assert_eq!(best.evidence, 0.0, "{}", table(&found));
}
