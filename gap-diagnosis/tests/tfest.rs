//! Transfer functions and linear grey boxes from logs: known coefficients come back, and the order is that of the plant.

use gap_diagnosis::identify::tfest::tfest;
use gap_diagnosis::identify::{From, Hysterons, LogFit, Options, Verdict, identify};
use plant_sim::chain::Chain;
use plant_sim::linear::TransferFunction;
use plant_sim::log::Log;
use plant_sim::model::Model;
use plant_sim::replay::{Initial, Start, predict};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use std::path::Path;

fn model(name: &str) -> Model {
    Model::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(name)).expect("a model of the project")
}

/// A log of `chain` with white noise.
fn made(chain: &Chain, rate_hz: f64, command_v: Vec<f64>, noise_m: f64) -> Log {
    let mut log = Log {
        name: "made".into(),
        dt_s: 1.0 / rate_hz,
        displacement_m: vec![0.0; command_v.len()],
        command_v,
        ..Log::default()
    };
    log.displacement_m = predict(chain, &log, &Start::relaxed(chain), log.len());
    let mut random = Pcg64::seed_from_u64(7);
    let noise = Normal::new(0.0, noise_m).expect("a spread");
    log.displacement_m.iter_mut().for_each(|y| *y += noise.sample(&mut random));
    log
}

fn options(from: From) -> Options {
    Options { from, initial: Initial::Relaxed, run_in_s: None, starts: 3, seed: 1 }
}

/// Zero for a tenth, then `levels_v` for equal times.
fn steps(levels_v: &[f64], rows: usize) -> Vec<f64> {
    let each = rows * 9 / 10 / levels_v.len();
    let mut command_v = vec![0.0; rows / 10];
    command_v.extend(levels_v.iter().flat_map(|v| std::iter::repeat_n(*v, each)));
    command_v
}

const ANY: From = From::Linear { hysterons: Hysterons::Fixed(0), mass_kg: 1.0148e-3 };

#[test]
fn a_second_order_plant_comes_back_with_its_order() {
    let chain = model("thesis-newid2.toml").chain();
    let log = made(&chain, 20e3, steps(&[60.0, 20.0, -40.0], 2000), 50e-9);
    // Mass weighed, k and b from the step train: the thesis' linear grey box.
    let mass_kg = 1.0148e-3;
    let from = From::Logs { hysterons: Hysterons::Fixed(0), mass_kg };
    let grey = identify(std::slice::from_ref(&log), &options(from), &|_, _| {}).expect("fitted");
    let number = |name: &str| grey.parameters.iter().find(|p| p.name == name).expect("a number of the plant").value;
    assert!((number("stiffness_N_per_m") / 9680.2 - 1.0).abs() < 2e-3);
    assert!((number("damping_N_s_per_m") / 2.5928 - 1.0).abs() < 5e-3);
    let found = tfest(&[log], &options(ANY), None).expect("estimated");
    let best = &found[0];
    assert_eq!((best.order, best.zeros), (2, 0));
    // 2555 and 9.539e6 and 16.78, as the model file has them; 2000 samples at 50 nm in 100 um leave some 1e-3.
    let plant = &chain.plant;
    let truth = [
        plant.damping_n_s_per_m / plant.mass_kg,
        plant.stiffness_n_per_m / plant.mass_kg,
        plant.transduction_c_per_m / plant.mass_kg,
    ];
    let coefficients = best.coefficients();
    let names: Vec<&str> = coefficients.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["denominator_1", "denominator_2", "numerator_0"]);
    for (ours, truth) in coefficients.iter().zip(truth) {
        assert!((ours.value / truth - 1.0).abs() < 2e-3, "{:?}", best.tf);
        // Four sigma, which are some 1e-4 for 2000 samples at 50 nm in 100 um.
        assert!((ours.value - truth).abs() < 4.0 * ours.sigma, "{ours:?} {truth}");
        assert!((1e-5..1e-3).contains(&(ours.sigma / ours.value)), "{ours:?}");
    }
}

/// More rows of rest than are looked at for a resonance or begun with show neither; a slow log before the one that rings hides nothing.
#[test]
fn a_resonance_is_seen_behind_rest_and_behind_another_log() {
    let chain = model("thesis-newid2.toml").chain();
    let behind_rest = [vec![0.0; 22_000], steps(&[60.0, 20.0, -40.0], 2000)].concat();
    let behind_rest = made(&chain, 20e3, behind_rest, 50e-9);
    let slow = (0..2000).map(|k| 20.0 * (std::f64::consts::TAU * 10.0 * f64::from(k) / 20e3).sin()).collect();
    let slow = made(&chain, 20e3, slow, 50e-9);
    let from = From::Logs { hysterons: Hysterons::Fixed(0), mass_kg: 1.0148e-3 };
    for logs in [vec![behind_rest.clone()], vec![slow, behind_rest.clone()]] {
        let grey = identify(&logs, &options(from.clone()), &|_, _| {}).expect("fitted");
        let stiffness = grey.parameters.iter().find(|p| p.name == "stiffness_N_per_m").expect("a number of the plant");
        assert_eq!(stiffness.verdict, Verdict::Fitted, "{}", stiffness.note);
        assert!((stiffness.value / 9680.2 - 1.0).abs() < 5e-3, "{}", stiffness.value);
    }
    let run_in = Options { run_in_s: Some(1.05), ..options(ANY) };
    for (said, options) in [("rest", options(ANY)), ("run-in", run_in)] {
        let found = tfest(std::slice::from_ref(&behind_rest), &options, None).expect("estimated");
        assert_eq!((found[0].order, found[0].zeros), (2, 0), "{said}");
        let natural2 = found[0].coefficients().iter().find(|c| c.name == "denominator_2").expect("a coefficient").value;
        assert!((natural2 * chain.plant.mass_kg / chain.plant.stiffness_n_per_m - 1.0).abs() < 5e-3, "{said}");
    }
}

#[test]
fn a_step_needs_two_hysterons() {
    let chain = model("thesis-phs.toml").chain();
    let log = made(&chain, 20e3, steps(&[60.0], 2000), 20e-9);
    let rms_of = |from: From| identify(std::slice::from_ref(&log), &options(from), &|_, _| {}).expect("fitted").rms_m;
    let mass_kg = 1.0148e-3;
    // Linear grey box: measured 877, 55.7, 27.3 and 27.4 nm for 0 to 3 hysterons, the noise 20 nm.
    let linear: Vec<f64> = (0..=3).map(|n| rms_of(From::Linear { hysterons: Hysterons::Fixed(n), mass_kg })).collect();
    assert!(linear[0] > 10.0 * linear[1] && linear[1] > 1.8 * linear[2], "{linear:?}");
    assert!(linear[3] > 0.95 * linear[2], "a third adds nothing: {linear:?}");
    // With dead zones two explain the step to its noise, and one does not.
    let [one, two] = [1, 2].map(|n| rms_of(From::Logs { hysterons: Hysterons::Fixed(n), mass_kg }));
    assert!((19e-9..21e-9).contains(&two) && one > 10.0 * two, "{one:e} {two:e}");
    // As a transfer function two mechanical poles and one for each hysteron leave 25 nm, measured with three seeds, as one pole less leaves 55; a
    // fifth, which no part of the plant has, makes up for the dead zones and leaves the noise.
    let found = tfest(std::slice::from_ref(&log), &options(ANY), None).expect("estimated");
    assert_eq!((found[0].order, found[0].zeros), (5, 4));
    let [third, fourth] = [3, 4].map(|n| found.iter().find(|e| (e.order, e.zeros) == (n, n - 1)).expect("tried").rms_m);
    assert!((19e-9..22e-9).contains(&found[0].rms_m), "{:e}", found[0].rms_m);
    assert!((22e-9..28e-9).contains(&fourth) && third > 2.0 * fourth, "{third:e} {fourth:e}");
    assert!(found[0].tf.poles().iter().all(|pole| pole.re < 0.0));
}

/// Below 75 Hz no bandwidth in hertz lies within the log's.
#[test]
fn a_slow_stage_is_estimated_from_a_slow_log() {
    let turning = std::f64::consts::TAU * 2.0;
    let tf = TransferFunction {
        numerator: vec![1e-6 * turning * turning],
        denominator: vec![1.0, 0.6 * turning, turning * turning],
    };
    let chain = Model::of_transfer_function("slow", &tf, "made").chain();
    let log = made(&chain, 50.0, steps(&[60.0, 20.0, -40.0, 10.0], 1000), 50e-9);
    let found = tfest(&[log], &options(ANY), Some((2, 0))).expect("estimated");
    // 1000 samples at 50 nm in 60 um leave some 1e-4.
    for (ours, truth) in found[0].coefficients().iter().zip([tf.denominator[1], tf.denominator[2], tf.numerator[0]]) {
        assert!((ours.value / truth - 1.0).abs() < 2e-3, "{ours:?} {truth}");
    }
}

#[test]
fn as_many_hysterons_are_taken_as_the_log_calls_for() {
    let chain = model("thesis-phs.toml").chain();
    let log = made(&chain, 20e3, steps(&[60.0, 20.0, -40.0], 2000), 20e-9);
    let from = From::Logs { hysterons: Hysterons::Auto, mass_kg: 1.0148e-3 };
    let fit = identify(std::slice::from_ref(&log), &options(from), &|_, _| {}).expect("fitted");
    // One leaves a micrometre, two the noise, and a third nothing less.
    assert_eq!(fit.model.actuator.hysterons.len(), 2, "{:e}", fit.rms_m);
    assert!((19e-9..21e-9).contains(&fit.rms_m), "{:e}", fit.rms_m);
}

#[test]
fn each_log_counts_by_what_it_leaves_itself() {
    let chain = model("thesis-phs.toml").chain();
    let logs = [20e-9, 5e-6].map(|noise_m| made(&chain, 20e3, steps(&[60.0, 20.0, -40.0], 2000), noise_m));
    let from = From::Logs { hysterons: Hysterons::Fixed(0), mass_kg: 1.0148e-3 };
    let fit = identify(&logs, &options(from), &|_, _| {}).expect("fitted");
    // N ln(RSS/N) of each, and 2 for each coordinate.
    let left = |log: &LogFit| log.predicted_m.len() as f64 * 2.0 * log.rms_m.ln();
    let aic = fit.logs.iter().map(left).sum::<f64>() + 2.0 * fit.coordinates as f64;
    assert!((fit.aic - aic).abs() < 1e-9 * aic.abs(), "{} {aic}", fit.aic);
}
