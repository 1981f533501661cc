//! What the limited controllers promise on the thesis' bender at the boards' rates, and what simulate writes and replay reads.

use crate::support::{Folder, PI1, PLANT, column, json, number, root, run, stderr, stdout, succeeded};
use control_core::Limits;
use plant_sim::controller::Controller;
use plant_sim::effects::{Kind, REGISTRY, Scales, sane};
use plant_sim::experiment::{Program, Recording, Setup, closed_loop};
use plant_sim::log::{self, Hold, Log, ReadOptions};
use plant_sim::model::Model;
use plant_sim::param::Param;
use plant_sim::replay::{Start, predict};
use plant_sim::spec::Spec;
use std::fs;

const PI2: &str = "controllers/pi2.toml";

fn simulated(controller: &str, rate_hz: f64, reference: &str, seconds: f64) -> Recording {
    let chain = Model::read(&root().join(PLANT)).expect("a plant of the project").chain();
    let settings = Controller::read(&root().join(controller)).expect("a controller of the project").settings(rate_hz);
    let start = Start::relaxed(&chain);
    let program = Program::new(&Spec::parse(reference).expect("a SPEC"), rate_hz).expect("playable");
    let samples = (seconds * rate_hz).round() as usize;
    let setup = Setup { chain: &chain, start: &start, rate_hz, samples, latency_s: 10e-6, seed: 1 };
    closed_loop(&setup, &settings, &program, &|_| {}).expect("settings of the project")
}

#[test]
fn shaped_steps_and_sines_stay_within_every_limit() {
    let mut runs = vec![("step:80um,shaped".to_owned(), 0.05), ("step:80um".to_owned(), 0.05)];
    for amplitude in [80, 100] {
        for (hz, seconds) in [(1, 2.0), (50, 0.1), (100, 0.1), (150, 0.1)] {
            runs.push((format!("sine:{amplitude}um@{hz}Hz"), seconds));
        }
    }
    for controller in [PI1, PI2] {
        for rate_hz in [20e3, 40e3] {
            for (reference, seconds) in &runs {
                let run = simulated(controller, rate_hz, reference, *seconds);
                let context = format!("{controller}, {rate_hz} Hz, {reference}");
                assert_eq!(run.command_v.len(), (seconds * rate_hz).round() as usize);
                // 10 um below what may break the bender. The least that a run reaches says that it ran.
                let peak_um = run.peak_m * 1e6;
                assert!(peak_um > 50.0 && peak_um <= 110.0, "{context}: {peak_um} um");
                // 4e5 V/s and +-90 V; the drive is f32, whose steps below 90 V are 7.6e-6 V.
                let (most_v, rounding_v) = (4e5 / rate_hz, 7.7e-6);
                let mut before_v = 0.0;
                for (sample, &drive_v) in run.command_v.iter().enumerate() {
                    assert!((-90.0..=90.0).contains(&drive_v), "{context}, {sample}: {drive_v} V");
                    assert!((drive_v - before_v).abs() <= most_v + rounding_v, "{context}, {sample}");
                    before_v = drive_v;
                }
                let gave_up = Limits::TRIP | Limits::NOT_A_NUMBER | Limits::RAMP;
                assert!(!run.limited_by.iter().any(|l| l.intersects(gave_up)), "{context}: tripped");
            }
        }
    }
}

#[test]
fn a_reference_beyond_the_clamp_is_clamped_and_said() {
    let folder = Folder::new("clamp");
    let output = run(
        &folder,
        &format!(
            "simulate --plant {PLANT} --controller {PI1} --reference step:115um --rate 20000 --seconds 0.02 --out @/l.csv --json"
        ),
    );
    assert_eq!(succeeded(&output), "warning: limits acted in 400 of 400 samples: reference clamp\n");
    let printed = json(&output);
    // The clamp holds from the first to the last sample; only on the way is the reference shaped.
    assert_eq!(number(&printed, "limited_samples"), 400.0);
    assert!(number(&printed, "shaped_samples") < 100.0);
    assert!(number(&printed, "peak_um") < 101.0);
}

/// The contract's keys, and `shaped_samples`, which is ours.
const SIMULATE_KEYS: [&str; 11] = [
    "gain",
    "limited_samples",
    "overshoot_percent",
    "peak_V",
    "peak_um",
    "phase_deg",
    "rise_ms",
    "rms_error_percent",
    "rms_error_um",
    "settle_2_percent_ms",
    "shaped_samples",
];

#[test]
fn the_json_has_the_keys_of_the_contract_and_numbers_where_they_have_a_meaning() {
    let folder = Folder::new("json");
    let closed = |spec: &str| format!("--controller {PI1} --reference {spec}");
    let step = [
        "limited_samples",
        "overshoot_percent",
        "peak_V",
        "peak_um",
        "rise_ms",
        "rms_error_percent",
        "rms_error_um",
        "settle_2_percent_ms",
        "shaped_samples",
    ];
    let sine = [
        "gain",
        "limited_samples",
        "peak_V",
        "peak_um",
        "phase_deg",
        "rms_error_percent",
        "rms_error_um",
        "shaped_samples",
    ];
    for (drive, with_numbers) in [
        (closed("step:80um"), &step[..]),
        (closed("sine:80um@100Hz"), &sine),
        (closed("ladder:80um/4,hold=5ms"), &["limited_samples", "peak_V", "peak_um", "rms_error_um", "shaped_samples"]),
        ("--command step:20V".to_owned(), &["limited_samples", "peak_V", "peak_um", "shaped_samples"]),
    ] {
        let call =
            format!("simulate --plant {PLANT} {drive} --rate 20000 --seconds 0.04 --no-page --out @/l.csv --json");
        let output = run(&folder, &call);
        assert_eq!(succeeded(&output), "", "{drive}");
        let printed = json(&output);
        assert_eq!(printed.keys().map(String::as_str).collect::<Vec<_>>(), SIMULATE_KEYS, "{drive}");
        let numbers: Vec<&str> = printed.iter().filter(|(_, v)| v.is_number()).map(|(key, _)| key.as_str()).collect();
        assert_eq!(numbers, with_numbers, "{drive}");
        assert!(printed.values().all(|v| v.is_number() || v.is_null()), "{drive}");
    }
    assert_eq!(folder.names(), ["l.csv"]);
    let output = run(&folder, &format!("replay --plant {PLANT} @/l.csv --no-page --out @/p.csv --json"));
    succeeded(&output);
    assert_eq!(json(&output).keys().collect::<Vec<_>>(), ["fit_percent", "offset_um", "rms_um", "rows"]);
    // A displacement that never moves has no fit: null, and still valid JSON.
    let output = run(
        &folder,
        &format!("simulate --plant {PLANT} --command zero --rate 1000 --seconds 0.1 --out @/z.csv --no-page"),
    );
    succeeded(&output);
    let output =
        run(&folder, &format!("replay --plant {PLANT} @/z.csv --initial relaxed --no-page --out @/p.csv --json"));
    succeeded(&output);
    assert!(json(&output)["fit_percent"].is_null());
}

#[test]
fn a_run_shorter_than_a_period_says_why_figures_are_missing() {
    let folder = Folder::new("short");
    let output = run(
        &folder,
        &format!(
            "simulate --plant {PLANT} --controller {PI1} --reference sine:80um@1Hz --rate 20000 --seconds 0.1 --out @/l.csv --json"
        ),
    );
    assert_eq!(
        succeeded(&output),
        "warning: the run is shorter than one period of 1 Hz, so that it has no gain, phase or error: give --seconds 1 or more\n"
    );
    assert!(json(&output)["gain"].is_null());
}

#[test]
fn the_log_is_the_contract_s() {
    let folder = Folder::new("log");
    let output = run(
        &folder,
        &format!(
            "simulate --plant {PLANT} --controller {PI1} --reference step:80um --rate 20000 --seconds 0.01 --delay-us 9.345678 --seed 5 --out @/l.csv"
        ),
    );
    assert_eq!(succeeded(&output), "");
    let text = folder.read("l.csv");
    let head: Vec<&str> = text.lines().take_while(|line| !line.starts_with("0.")).collect();
    assert_eq!(
        head,
        [
            "# rate_hz: 20000",
            "# hold: zoh",
            "# latency_us: 9.345678",
            "# controller: pi1.toml",
            "# seed: 5",
            "# plant: thesis-phs.toml",
            &format!("# simulated_by: hysteron {}", env!("CARGO_PKG_VERSION")),
            "time_s,command_V,displacement_um,reference_um,limited_by",
        ]
    );
    let log = log::read(&folder.path("l.csv"), &ReadOptions::default()).expect("our own log");
    assert_eq!((log.len(), log.dt_s, log.meta.latency_s), (200, 5e-5, 9.345678e-6));
    // Open loop has neither reference nor controller; the limits are the drive's.
    let output = run(
        &folder,
        &format!("simulate --plant {PLANT} --command sine:30V@50Hz --rate 10000 --seconds 0.04 --out @/o.csv"),
    );
    assert_eq!(succeeded(&output), "");
    assert!(folder.read("o.csv").contains("\ntime_s,command_V,displacement_um,limited_by\n"));
    assert!(!folder.read("o.csv").contains("controller"));
    assert_eq!(folder.names(), ["l.csv", "l.html", "o.csv", "o.html"]);
}

/// The thesis' plant with more sections.
fn plant_with(folder: &Folder, name: &str, sections: &str) {
    let plant = fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    folder.write(name, format!("{plant}\n{sections}\n"));
}

#[test]
fn the_seed_decides_the_noise_and_nothing_else() {
    let folder = Folder::new("seed");
    plant_with(&folder, "noisy.toml", "[sensor]\nnoise_um = { value = 0.02 }");
    let simulate = |plant: &str, seed: u32| {
        let call = format!(
            "simulate --plant {plant} --command sine:30V@50Hz --rate 10000 --seconds 0.4 --seed {seed} --no-page --out @/l.csv"
        );
        succeeded(&run(&folder, &call));
        folder.read("l.csv")
    };
    let (first, again, other) = (simulate("@/noisy.toml", 1), simulate("@/noisy.toml", 1), simulate("@/noisy.toml", 2));
    assert!(first == again);
    let clean = column(&simulate(PLANT, 1), "displacement_um");
    let noise =
        |text: &str| column(text, "displacement_um").iter().zip(&clean).map(|(y, c)| y - c).collect::<Vec<f64>>();
    let rms = |noise: &[f64]| (noise.iter().map(|v| v * v).sum::<f64>() / noise.len() as f64).sqrt();
    let (a, b) = (noise(&first), noise(&other));
    // 4000 samples estimate sigma within 1/sqrt(8000) = 1.1 %: four standard deviations. Independent noises differ by sqrt(2) sigma.
    assert!((rms(&a) / 0.02 - 1.0).abs() < 0.045 && (rms(&b) / 0.02 - 1.0).abs() < 0.045);
    let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    assert!((rms(&difference) / (0.02 * 2f64.sqrt()) - 1.0).abs() < 0.06);
    // In open loop the command doesn't know of it.
    assert!(column(&first, "command_V") == column(&other, "command_V"));
}

/// Asserts that `prediction` (a CSV) meets its measured column within 1e-9 um.
fn assert_reproduced(prediction: &str, context: &str) {
    let (measured, predicted) = (column(prediction, "displacement_um"), column(prediction, "predicted_um"));
    let worst = measured.iter().zip(&predicted).fold(0.0f64, |m, (y, p)| m.max((y - p).abs()));
    assert!(worst < 1e-9 && measured.iter().any(|y| y.abs() > 10.0), "{context}: {worst:e} um");
}

#[test]
fn a_replay_of_a_simulated_log_reproduces_it() {
    let folder = Folder::new("replay");
    plant_with(
        &folder,
        "late.toml",
        "[drive]\ndelay_us = { value = 33.3 }\nmin_V = { value = -40.0 }\nmax_V = { value = 45.0 }",
    );
    for (plant, drive, delay_us) in [
        (PLANT, format!("--controller {PI1} --reference step:80um"), "10"),
        (PLANT, format!("--controller {PI1} --reference sine:80um@150Hz"), "7.3"),
        (PLANT, "--command multisine:30V@10-500Hz,seed=3,periods=2".to_owned(), "0"),
        (PLANT, "--command ladder:60V/3,hold=15ms".to_owned(), "123.456"),
        ("@/late.toml", "--command sine:60V@50Hz".to_owned(), "10"),
    ] {
        let call = format!(
            "simulate --plant {plant} {drive} --rate 20000 --seconds 0.1 --delay-us {delay_us} --no-page --out @/l.csv"
        );
        run(&folder, &call);
        for initial in ["relaxed", "rest"] {
            let call = format!("replay --plant {plant} @/l.csv --initial {initial} --no-page --out @/p.csv --json");
            let output = run(&folder, &call);
            assert_eq!(succeeded(&output), "", "{drive}");
            let printed = json(&output);
            let context = format!("{drive}, {initial}: {printed:?}");
            assert_eq!(number(&printed, "rows"), 2000.0);
            if initial == "relaxed" {
                assert_reproduced(&folder.read("p.csv"), &context);
                assert!(number(&printed, "fit_percent") > 100.0 - 1e-9, "{context}");
            } else {
                // The fit of the equilibrium stops at relative changes of 1e-7, and 1e-7 of 100 um is 1e-5 um.
                assert!(number(&printed, "rms_um") < 1e-5 && number(&printed, "fit_percent") > 99.9999, "{context}");
            }
        }
    }
}

/// Whatever a plant carries acts in a simulation and in a replay, and in the same way: there is one chain.
#[test]
fn a_replay_knows_every_effect_that_a_simulation_does() {
    let folder = Folder::new("replay-effects");
    let nominal = Model::read(&root().join(PLANT)).expect("a plant of the project");
    let plant = nominal.chain().plant;
    let scales = Scales { plant: &plant, ..sane::EXAMPLE };
    for effect in REGISTRY {
        for form in effect.forms().iter().filter(|form| form.kind == Kind::Predictable) {
            let values: Vec<Param> =
                form.typical(&scales).iter().map(|value| Param::absolute(*value, 0.0, "typical")).collect();
            let model = nominal.clone().with_effect(*effect, form, &values);
            model.write(&folder.path("plant.toml")).expect("room on the disk");
            let drive = "--command multisine:60V@10-500Hz,seed=3,periods=2 --rate 20000 --seconds 0.2";
            succeeded(&run(&folder, &format!("simulate --plant @/plant.toml {drive} --no-page --out @/l.csv")));
            let replay = |plant: &str| {
                let call = format!("replay --plant {plant} @/l.csv --initial relaxed --no-page --out @/p.csv --json");
                number(&json(&run(&folder, &call)), "rms_um")
            };
            let context = format!("{}, {}", effect.id(), form.name);
            assert!(replay(PLANT) > 1e-5, "{context}: the simulation does not know it");
            replay("@/plant.toml");
            assert_reproduced(&folder.read("p.csv"), &context);
        }
    }
}

#[test]
fn a_sensor_with_its_own_clock_moves_the_recording_and_not_the_loop() {
    let folder = Folder::new("clock");
    let effect =
        "[[effect]]\nid = \"clock_error\"\nform = \"ratio\"\n[effect.parameters]\nclock_ratio = { value = 1e-3 }";
    plant_with(&folder, "clock.toml", effect);
    let simulated = |plant: &str| {
        let drive = format!("--controller {PI1} --reference sine:80um@50Hz --rate 20000 --seconds 0.3");
        succeeded(&run(&folder, &format!("simulate --plant {plant} {drive} --no-page --out @/l.csv")));
        folder.read("l.csv")
    };
    let (in_time, late) = (simulated(PLANT), simulated("@/clock.toml"));
    assert_eq!(column(&in_time, "command_V"), column(&late, "command_V"));
    // After 0.3 s readings come 0.3 ms late, of a sine that moves by 25 um in a millisecond. 6000 rows are more than a replay keeps.
    let moved = column(&in_time, "displacement_um").into_iter().zip(column(&late, "displacement_um"));
    let most = moved.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!((6.5..8.5).contains(&most), "{most}");
    succeeded(&run(&folder, "replay --plant @/clock.toml @/l.csv --initial relaxed --no-page --out @/p.csv"));
    assert_reproduced(&folder.read("p.csv"), "closed loop");
    let live = format!(
        "hil --board in-process --plant @/clock.toml --controller {PI1} --reference step:10um --rate 10000 --seconds 0.01 --out @/run"
    );
    let warned = format!("warning: {}: clock_error moves rows of a recording", folder.path("clock.toml").display());
    assert!(stderr(&run(&folder, &live)).contains(&warned));
}

#[test]
fn a_replay_reads_hold_force_and_latency_from_the_log() {
    let folder = Folder::new("holds");
    let chain = Model::read(&root().join(PLANT)).expect("a plant of the project").chain();
    let rows = 600;
    let wave = |k: usize| 40.0 * (std::f64::consts::TAU * 130.0 * k as f64 / 1e4).sin();
    for hold in [Hold::Zoh, Hold::Foh, Hold::Bandlimited] {
        let mut log = Log { dt_s: 1e-4, command_v: (0..rows).map(wave).collect(), ..Log::default() };
        log.force_n = Some((0..rows).map(|k| if k < 300 { 0.0 } else { 0.1 }).collect());
        log.meta.hold = hold;
        log.meta.latency_s = 42.5e-6;
        log.displacement_m = vec![0.0; rows];
        log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), rows);
        log::write(&folder.path("l.csv"), &log).expect("room on the disk");
        let call = format!("replay --plant {PLANT} @/l.csv --initial relaxed --no-page --out @/p.csv");
        assert_eq!(succeeded(&run(&folder, &call)), "");
        assert_reproduced(&folder.read("p.csv"), &format!("{hold:?}"));

        // Each of them matters: a log that says nothing is taken for another one.
        let text = folder.read("l.csv");
        for (line, without) in
            [("# latency_us: 42.5\n", ""), ("force_N", "weight"), ("# hold: foh\n", ""), ("# hold: bandlimited\n", "")]
        {
            if text.contains(line) {
                folder.write("l.csv", text.replace(line, without));
                let output = run(&folder, &format!("{call} --json"));
                assert!(number(&json(&output), "rms_um") > 0.05, "{hold:?} without {line}");
            }
        }
    }
}

#[test]
fn rounded_times_don_t_change_the_interval() {
    // 3 kHz printed to 0.1 ms: the first two times say 0.3 ms, which is 10 % off; only many rows say what the interval is.
    let folder = Folder::new("rounded");
    let chain = Model::read(&root().join(PLANT)).expect("a plant of the project").chain();
    let rows = 3000;
    let mut log =
        Log { dt_s: 1.0 / 3e3, command_v: vec![0.0; rows], displacement_m: vec![0.0; rows], ..Log::default() };
    for (k, command_v) in log.command_v.iter_mut().enumerate() {
        *command_v = 40.0 * (std::f64::consts::TAU * 20.0 * k as f64 / 3e3).sin();
    }
    log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), rows);
    let mut text = "time_s,command_V,displacement_um\n".to_owned();
    for k in 0..rows {
        text.push_str(&format!("{:.4},{},{}\n", log.time_s(k), log.command_v[k], log.displacement_m[k] * 1e6));
    }
    folder.write("l.csv", text);
    let output =
        run(&folder, &format!("replay --plant {PLANT} @/l.csv --initial relaxed --no-page --out @/p.csv --json"));
    succeeded(&output);
    // Times rounded by 50 us at both ends of 1 s leave 100 us of doubt at its end, where the wave moves by 9.4 mm/s at the most.
    assert!(number(&json(&output), "rms_um") < 1.0, "{:?}", json(&output));
    assert!(number(&json(&output), "fit_percent") > 97.0, "{:?}", json(&output));
}

#[test]
fn a_wrong_plant_says_so() {
    let folder = Folder::new("wrong");
    let call =
        format!("simulate --plant {PLANT} --command sine:50V@20Hz --rate 10000 --seconds 0.2 --no-page --out @/l.csv");
    succeeded(&run(&folder, &call));
    let replay = |plant: &str| run(&folder, &format!("replay --plant {plant} @/l.csv --no-page --out @/p.csv --json"));
    // Another bender of the same kind fits worse, and one that moves the other way or not at all is called wrong.
    let output = replay("models/thesis-newid2.toml");
    succeeded(&output);
    let fit = number(&json(&output), "fit_percent");
    assert!(fit > 50.0 && fit < 95.0, "{fit}");
    let plant = fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    folder.write("strong.toml", plant.replace("value = 0.046311", "value = 0.2"));
    let output = replay("@/strong.toml");
    let said = succeeded(&output);
    assert!(number(&json(&output), "fit_percent") < 0.0);
    assert!(said.contains("does this plant belong to this log, and are the units right?"), "{said}");
}

#[test]
fn the_terminal_shows_facts_and_no_noise() {
    let folder = Folder::new("terminal");
    let output = run(
        &folder,
        &format!(
            "simulate --plant {PLANT} --controller {PI1} --reference sine:80um@100Hz --rate 20000 --seconds 0.02 --out @/l.csv"
        ),
    );
    assert_eq!(stderr(&output), "", "shaping is normal work and no warning");
    let said = stdout(&output);
    assert!(said.is_ascii() && said.lines().all(|line| line == line.trim_end() && line.len() < 120), "{said}");
    // Labels and values in two columns.
    let facts: Vec<&str> = said.lines().filter(|line| line.starts_with("  ")).collect();
    let columns: Vec<Option<usize>> = facts
        .iter()
        .map(|line| line[2..].find("  ").map(|at| at + line[2 + at..].chars().take_while(|c| *c == ' ').count()))
        .collect();
    assert!(facts.len() >= 8 && columns.iter().all(|column| *column == columns[0]), "{said}");
    assert!(said.contains("reference shaped") && said.contains("phase                   -"), "{said}");
    assert!(said.ends_with(&folder.fill_in("log: @/l.csv\npage: @/l.html\n")), "{said}");
}
