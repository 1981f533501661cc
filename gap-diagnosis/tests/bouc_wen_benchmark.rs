//! The Bouc-Wen benchmark (Noel and Schoukens 2016): a grey-box oscillator from the estimation data, judged on the official tests, and what a diagnosis
//! says of the same logs with the thesis' class of plant.
//!
//! Force in, displacement out, 750 Hz, band-limited between samples. The search starts from the linear baseline that comes with the data (2 kg,
//! 10 N s/m, 50 kN/m) and from a hysteresis of that stiffness whose loops bend over the data's own displacement.

use crate::shared_data::bouc_wen::{FITTED, PERIOD, RATE_HZ, RUN_IN, log, start};
use gap_diagnosis::diagnose::{self, Verdict, diagnose};
use gap_diagnosis::identify::{From, Hysterons, Options, identify};
use plant_sim::chain::Sensor;
use plant_sim::log::{Hold, Log};
use plant_sim::metrics::rms;
use plant_sim::model::Model;
use plant_sim::replay::{Initial, Start, predict};

/// Rms error over the last `scored` rows.
fn error(model: &Model, log: &Log, scored: usize) -> f64 {
    let mut chain = model.chain();
    chain.sensor = Sensor::IDEAL;
    let predicted = predict(&chain, log, &Start::relaxed(&chain), log.len());
    let from = log.len() - scored;
    rms(log.displacement_m[from..].iter().zip(&predicted[from..]).map(|(y, p)| y - p))
}

#[test]
fn the_grey_box_knows_the_oscillator() {
    let names =
        ["uest_multisine", "yest_multisine", "uval_multisine", "yval_multisine", "uval_sinesweep", "yval_sinesweep"];
    let Some(data) = names.iter().map(|name| crate::shared_data::bouc_wen_record(name)).collect::<Option<Vec<_>>>()
    else {
        return;
    };
    // The estimation data are four periods of a steady state with noise: their mean has half of it. A tenth of a period settles from rest.
    let mean = |k: usize| (0..4).map(|p| data[1][p * PERIOD + k]).sum::<f64>() / 4.0;
    let displacement_m: Vec<f64> = (0..RUN_IN + FITTED).map(mean).collect();
    let training = log("estimation", &data[0][..RUN_IN + FITTED], &displacement_m);
    let options = Options {
        from: From::Plant(Box::new(start(rms(data[1].iter().copied())))),
        initial: Initial::Relaxed,
        run_in_s: Some(RUN_IN as f64 / RATE_HZ),
        starts: 1,
        seed: 1,
    };
    let fit = identify(&[training], &options, &|_, _| {}).expect("fitted");
    // The official test is one period of a steady state.
    let twice = |signal: &[f64]| signal.iter().chain(signal).copied().collect::<Vec<f64>>();
    let test = log("test", &twice(&data[2]), &twice(&data[3]));
    let multisine = error(&fit.model, &test, PERIOD);
    let sweep = error(&fit.model, &log("sweep", &data[4], &data[5]), data[4].len());
    // Measured 1.5e-7 m; the best published black box has 7.5e-6, and below 1e-8 the test would know the test.
    assert!((1e-8..=7.5e-7).contains(&multisine), "{multisine:e}");
    // The sweep measures 2.4e-6 m.
    assert!((1e-7..3.5e-6).contains(&sweep), "{sweep:e}");
    // What made the data, as the benchmark states it: 2 kg, 10 N s/m, 5e4 N/m and z' = 5e4 q' - 800 |q'| z + 1100 q' |z|.
    let truth = [2.0, 5e4, 10.0, 5e4, 800.0, -1100.0];
    for (p, truth) in fit.parameters.iter().zip(truth) {
        assert!((p.value - truth).abs() < 4.0 * p.sigma.max(1e-3 * truth.abs()), "{} {} {}", p.name, p.value, p.sigma);
    }
}

/// With port-Hamiltonian hysterons, the wrong class: two of these leave 27 % of the motion about the resonance. That rises with the velocity, as errors of
/// the instants do, but most of it stays where the velocity is zero. It may be unknown, but nothing may be sure.
#[test]
fn a_plant_of_another_class_has_no_cause_of_ours() {
    let names = ["uest_multisine", "yest_multisine", "uval_multisine", "yval_multisine"];
    let Some(data) = names.iter().map(|name| crate::shared_data::bouc_wen_record(name)).collect::<Option<Vec<_>>>()
    else {
        return;
    };
    // As a log comes from a file that says nothing of what lies between its rows.
    let held = |name: &str, of: usize, rows: std::ops::Range<usize>| {
        let mut log = log(name, &data[of][rows.clone()], &data[of + 1][rows]);
        log.meta.hold = Hold::default();
        log
    };
    let fitted = [held("one", 0, 0..PERIOD / 2), held("two", 0, PERIOD / 2..PERIOD * 3 / 4)];
    let options = Options {
        from: From::Logs { hysterons: Hysterons::Fixed(2), mass_kg: 2.0 },
        initial: Initial::Rest,
        run_in_s: None,
        starts: 4,
        seed: 1,
    };
    let plant = identify(&fitted[..1], &options, &|_, _| {}).expect("fitted").model;
    let held_out = held("shown to none", 2, 0..PERIOD);
    let found = diagnose(&plant, &fitted, &[held_out], &diagnose::Options::default(), &|_, _| {}).expect("good logs");
    let jitter = found.ranking.iter().find(|ranked| ranked.effect == "sampling_jitter").expect("an entry");
    assert_eq!(found.verdict, Verdict::Unknown, "{:?}", found.ranking);
    assert!(jitter.probability < 0.2, "{:?}", found.ranking);
}
