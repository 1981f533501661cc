//! Section 5: three closed loops with and without feedforward, their table and what Figures 3.9 and 3.10 show of them.

use super::{Entry, Thesis, Verdict, half_digit, value};
use plant_sim::experiment::{Program, Recording, Setup, closed_loop};
use plant_sim::metrics::{LoopMetrics, Task, loop_metrics};
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use rayon::prelude::*;

/// So fast that the board's sampled law is the thesis' continuous one: half a sample of its integral is 0.1 % of a rise time.
pub const RATE_HZ: f64 = 1e6;
/// Every reference of the thesis.
pub const AMPLITUDE_M: f64 = 120e-6;
/// The sines.
pub const SINES_HZ: [f64; 4] = [1.0, 50.0, 100.0, 150.0];
/// Length of a step's run.
const STEP_S: f64 = 0.02;
/// Rows that a figure keeps of a run.
const KEPT: usize = 2000;

/// The plant in a loop, which fixes the controller: the feedforward's volts are k/alpha of the controller's own plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plant {
    /// The second-order reduction with PI 1.
    Phs2,
    /// The nonlinear plant with PI 1.
    PhsNl,
    /// The second identification with PI 2.
    NewId2,
}

/// A loop of the table and its row as printed.
#[derive(Debug)]
pub struct Row {
    /// Its name in the table.
    pub name: &'static str,
    /// Plant and controller.
    pub plant: Plant,
    /// Whether the feedforward acts.
    pub feedforward: bool,
    /// Rise 10-90 % in ms, overshoot in %, settling to 2 % in ms.
    pub step: [&'static str; 3],
    /// At [`SINES_HZ`]: rms error in % of the amplitude, gain, phase in degrees.
    pub sines: [[&'static str; 3]; 4],
}

/// Section 5 as printed.
pub const TABLE: [Row; 6] = [
    Row {
        name: "PHS2",
        plant: Plant::Phs2,
        feedforward: false,
        step: ["1.098", "0", "2.073"],
        sines: [
            ["0.244", "0.9998", "-0.20"],
            ["12.000", "0.9866", "-9.77"],
            ["23.034", "0.9511", "-19.01"],
            ["32.601", "0.9016", "-27.45"],
        ],
    },
    Row {
        name: "PHS2 + ff",
        plant: Plant::Phs2,
        feedforward: true,
        step: ["0.450", "14.66", "3.730"],
        sines: [
            ["0.001", "0.9999", "0.00"],
            ["3.308", "1.0426", "-1.07"],
            ["11.570", "1.1188", "-6.09"],
            ["21.685", "1.1637", "-13.81"],
        ],
    },
    Row {
        name: "PHSNL",
        plant: Plant::PhsNl,
        feedforward: false,
        step: ["0.250", "0.20", "4.333"],
        sines: [
            ["0.291", "1.0001", "-0.23"],
            ["14.245", "0.9456", "-11.45"],
            ["22.912", "0.8276", "-17.35"],
            ["26.893", "0.7409", "-18.63"],
        ],
    },
    Row {
        name: "PHSNL + ff",
        plant: Plant::PhsNl,
        feedforward: true,
        step: ["0.153", "46.15", "2.413"],
        sines: [
            ["0.055", "1.0001", "-0.04"],
            ["3.351", "1.0008", "-2.70"],
            ["5.591", "0.9812", "-4.44"],
            ["6.804", "0.9697", "-5.31"],
        ],
    },
    Row {
        name: "NewId2",
        plant: Plant::NewId2,
        feedforward: false,
        step: ["6.338", "0", "11.729"],
        sines: [
            ["1.374", "0.9997", "-1.11"],
            ["50.227", "0.7368", "-45.21"],
            ["65.054", "0.4882", "-66.35"],
            ["69.849", "0.3629", "-77.61"],
        ],
    },
    Row {
        name: "NewId2 + ff",
        plant: Plant::NewId2,
        feedforward: true,
        step: ["0.435", "37.60", "4.091"],
        sines: [
            ["0.002", "0.9999", "0.00"],
            ["4.287", "1.0467", "-2.15"],
            ["11.587", "1.0976", "-7.20"],
            ["19.987", "1.1509", "-12.79"],
        ],
    },
];

/// What a figure keeps of a run.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Seconds.
    pub time_s: Vec<f64>,
    /// Micrometres.
    pub reference_um: Vec<f64>,
    /// Micrometres.
    pub displacement_um: Vec<f64>,
}

/// All runs: the table's numbers, and the figures' curves.
#[derive(Clone, Debug, Default)]
pub struct Loops {
    /// Every number of the table.
    pub entries: Vec<Entry>,
    /// The step of each row.
    pub steps: Vec<Run>,
    /// The last period of each sine of each row.
    pub sines: Vec<[Run; 4]>,
    /// A square wave through each row.
    pub squares: Vec<Run>,
}

/// Runs one loop of the table with `spec` as its reference.
pub fn record(thesis: &Thesis, row: &Row, spec: &str, seconds: f64) -> Recording {
    let (model, controller) = match row.plant {
        Plant::Phs2 => (&thesis.phs2, &thesis.pi1),
        Plant::PhsNl => (&thesis.phs, &thesis.pi1),
        Plant::NewId2 => (&thesis.newid2, &thesis.pi2),
    };
    let chain = model.chain();
    let mut settings = controller.settings(RATE_HZ);
    if !row.feedforward {
        settings.feedforward_v_per_m = 0.0;
    }
    let start = Start::relaxed(&chain);
    let samples = (seconds * RATE_HZ).round() as usize;
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples, latency_s: 0.0, seed: 1 };
    // SPECs and settings are constants of the project, run by its tests.
    Spec::parse(spec)
        .ok()
        .and_then(|spec| Program::new(&spec, RATE_HZ).ok())
        .and_then(|program| closed_loop(&setup, &settings, &program, &|_| {}).ok())
        .unwrap_or_default()
}

/// Everything.
pub(super) fn run(thesis: &Thesis) -> Loops {
    let parts: Vec<Loops> = TABLE.par_iter().map(|row| of_row(thesis, row)).collect();
    let mut all = Loops::default();
    for part in parts {
        all.entries.extend(part.entries);
        all.steps.extend(part.steps);
        all.sines.extend(part.sines);
        all.squares.extend(part.squares);
    }
    all
}

fn of_row(thesis: &Thesis, row: &Row) -> Loops {
    let mut loops = Loops::default();
    let run = record(thesis, row, "step:120um", STEP_S);
    let found = measured(&run, Task::Step { height_m: AMPLITUDE_M });
    let step = [
        ("rise 10-90 %", found.rise_ms, "ms"),
        ("overshoot", found.overshoot_percent, "%"),
        ("settling to 2 %", found.settle_2_percent_ms, "ms"),
    ];
    for ((what, ours, unit), printed) in step.into_iter().zip(row.step) {
        loops.entries.push(entry(row, &format!("step, {what}"), printed, ours, unit, one_percent(printed)));
    }
    loops.steps.push(kept(&run, 0));
    let sines = SINES_HZ.iter().zip(&row.sines).map(|(&hz, printed)| {
        let run = record(thesis, row, &format!("sine:120um@{hz}Hz"), 3.0 / hz);
        let found = measured(&run, Task::Sine { amplitude_m: AMPLITUDE_M, hz });
        // Gains are near one and come out much closer than to 1 %.
        let numbers = [
            ("rms error", found.rms_error_percent, "%", one_percent(printed[0])),
            ("gain", found.gain, "", 0.002),
            ("phase", found.phase_deg, "deg", one_percent(printed[2])),
        ];
        for ((what, ours, unit, allowed), printed) in numbers.into_iter().zip(printed) {
            loops.entries.push(entry(row, &format!("{hz} Hz, {what}"), printed, ours, unit, allowed));
        }
        kept(&run, run.displacement_m.len() * 2 / 3)
    });
    let sines: Vec<Run> = sines.collect();
    loops.sines.extend(<[Run; 4]>::try_from(sines).ok());
    loops.squares.push(kept(&record(thesis, row, "square:120um@20Hz", 0.1), 0));
    loops
}

fn measured(run: &Recording, task: Task) -> LoopMetrics {
    loop_metrics(task, run.dt_s, Some(&run.reference_m), &run.displacement_m)
}

/// The larger of 1 % and half a unit of the last printed digit.
fn one_percent(printed: &str) -> f64 {
    half_digit(printed).max(0.01 * value(printed).abs())
}

fn entry(row: &Row, what: &str, printed: &str, ours: Option<f64>, unit: &'static str, allowed: f64) -> Entry {
    let ours = ours.unwrap_or(f64::NAN);
    // A hair more, because a number may lie on the edge that its printing was rounded at.
    let within = (ours - value(printed)).abs() <= allowed * (1.0 + 1e-9);
    let verdict = if within { Verdict::Within } else { Verdict::Differs };
    Entry::new("Section 5", &format!("{}: {what}", row.name), printed, ours, unit, verdict)
}

fn kept(run: &Recording, from: usize) -> Run {
    let stride = ((run.displacement_m.len() - from) / KEPT).max(1);
    let pick = |values: &[f64], scale: f64| values[from..].iter().step_by(stride).map(|v| v * scale).collect();
    Run {
        time_s: (from..run.displacement_m.len()).step_by(stride).map(|k| (k - from) as f64 * run.dt_s).collect(),
        reference_um: pick(&run.reference_m, 1e6),
        displacement_um: pick(&run.displacement_m, 1e6),
    }
}
