//! Tracking with each controller on a bench that hides an amplifier's lag, before and after the lag was diagnosed and added to the plant.

use gap_diagnosis::diagnose::{self, Diagnosis};
use plant_sim::chain::{Chain, Lag, SensorState};
use plant_sim::controller::{Controller, InverseSection};
use plant_sim::design::{Frame, Wish, design, tracking};
use plant_sim::log::Log;
use plant_sim::model::Model;
use plant_sim::replay::{Initial, Start, predict};
use std::f64::consts::TAU;
use std::path::Path;

/// Rate and delay of the loop.
pub const RATE_HZ: f64 = 40e3;
const DELAY_S: f64 = 10e-6;
/// Corner of the hidden lag, in Hz.
pub const HIDDEN_HZ: f64 = 900.0;
/// Noise of the bench's sensor.
const NOISE_M: f64 = 20e-9;

/// A row: controller, and rms error in percent of 80 um at each sine.
pub type Row = (String, [f64; 5]);

pub struct Table {
    pub rows: Vec<Row>,
    pub diagnosis: Diagnosis,
}

fn file(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn controller(name: &str) -> Controller {
    Controller::read(&file(&format!("controllers/{name}.toml"))).expect("a controller of the project")
}

/// A log of the bench at 20 kHz.
fn made(bench: &Chain, name: &str, command_v: Vec<f64>) -> Log {
    let mut log = Log {
        name: name.into(),
        dt_s: 1.0 / 20e3,
        displacement_m: vec![0.0; command_v.len()],
        command_v,
        ..Log::default()
    };
    let mut noisy = bench.sensor.clone();
    noisy.noise_m = NOISE_M;
    let mut sensor = SensorState::new(&noisy, name.len() as u64);
    let ideal = predict(bench, &log, &Start::relaxed(bench), log.len());
    log.displacement_m = ideal.into_iter().map(|y| sensor.read_m(y, 0.0, log.dt_s)).collect();
    log
}

fn steps(rows: usize) -> Vec<f64> {
    let levels = [0.0, 20.0, 40.0, 60.0, 30.0, 0.0, -30.0, -60.0, -20.0, 0.0];
    (0..rows).map(|k| levels[k * levels.len() / rows]).collect()
}

fn sine(hz: f64, volts: f64, rows: usize) -> Vec<f64> {
    (0..rows).map(|k| volts * (TAU * hz * k as f64 / 20e3).sin()).collect()
}

/// Lines from 4 Hz to 1.3 kHz whose phases are Schroeder's, four periods.
fn multisine() -> Vec<f64> {
    let lines = 320;
    let one = |k: usize| {
        let phase = |n: usize| std::f64::consts::PI * (n * n) as f64 / lines as f64;
        (1..=lines).map(|n| (TAU * 4.0 * n as f64 * k as f64 / 20e3 - phase(n)).cos()).sum::<f64>()
    };
    let period: Vec<f64> = (0..5000).map(one).collect();
    let peak = period.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    period.iter().cycle().take(20_000).map(|v| 40.0 * v / peak).collect()
}

pub fn table() -> Table {
    let nominal = Model::read(&file("models/thesis-phs.toml")).expect("a plant of the project");
    let known = nominal.chain();
    let mut bench = known.clone();
    bench.drive.lag = Some(Lag::First { time_constant_s: 1.0 / (TAU * HIDDEN_HZ) });
    let run = |controller: &Controller, chain: &Chain| {
        let inverse = controller.inverse(RATE_HZ, DELAY_S).expect("few hysterons");
        let settings = controller.settings(RATE_HZ);
        tracking(&Frame { chain, settings, delay_s: DELAY_S, inverse: inverse.as_ref() }).expect("a loop that runs")
    };
    let designed = |on: &Model, with_inverse: bool| {
        let chain = on.chain();
        let mut own = controller("pi1");
        own.feedforward_v_per_m.value = 1.0 / chain.plant.static_gain_m_per_v();
        let wish = Wish {
            settling_s: 5e-3,
            overshoot_percent: 2.0,
            step_m: 80e-6,
            gain_margin_db: 6.0,
            phase_margin_deg: 40.0,
        };
        let frame = Frame { chain: &chain, settings: own.settings(RATE_HZ), delay_s: DELAY_S, inverse: None };
        let found = design(&frame, &wish).expect("a modest wish");
        own.kp_v_per_m.value = found.placement.kp_v_per_m;
        own.ki_v_per_m_s.value = found.placement.ki_v_per_m_s;
        own.inverse = with_inverse.then(|| InverseSection::of(&chain, "design"));
        own
    };
    let logs = [
        made(&bench, "steps", steps(20_000)),
        made(&bench, "sine 10 Hz", sine(10.0, 60.0, 6000)),
        made(&bench, "sine 150 Hz", sine(150.0, 60.0, 2000)),
        made(&bench, "multisine", multisine()),
    ];
    let held_out = [made(&bench, "sine 100 Hz", sine(100.0, 50.0, 3000))];
    let options =
        diagnose::Options { initial: Initial::Relaxed, run_in_s: None, seed: 1, without: Vec::new(), predict: None };
    let diagnosis =
        diagnose::diagnose(&nominal, &logs, &held_out, &options, &|_, _| {}).expect("logs that can be diagnosed");
    let inverted = designed(&nominal, true);
    let rows = vec![
        ("PI 1".to_owned(), run(&controller("pi1"), &known)),
        ("PI 2".to_owned(), run(&controller("pi2"), &known)),
        ("own design".to_owned(), run(&designed(&nominal, false), &known)),
        ("own design, inverse feedforward".to_owned(), run(&inverted, &known)),
        (format!("the same where an amplifier's lag of {HIDDEN_HZ:.0} Hz hides"), run(&inverted, &bench)),
        ("the same there, after the diagnosis".to_owned(), run(&designed(&diagnosis.augmented, true), &bench)),
    ];
    Table { rows, diagnosis }
}
