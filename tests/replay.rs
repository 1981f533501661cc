//! `hysteron replay` as a user meets it: logs that are longer than what is kept of them, the prediction's times, forces.

use crate::support::{Folder, column, good_csv, json, run, succeeded};
use std::fmt::Write as _;

/// Rows of the run-in: as many as replay keeps for the fit of a start.
const RUN_IN: usize = 200_000;

/// Ten seconds at 20 kHz are run in, and what comes after them tells how the log starts.
#[test]
fn a_start_is_fitted_to_what_comes_after_a_long_run_in() {
    let folder = Folder::new("run-in");
    let mut text = "# rate_hz: 20000\ntime_s,command_V,displacement_um\n".to_owned();
    for row in 0..RUN_IN + 2000 {
        let command_v = 20.0 * (std::f64::consts::TAU * row as f64 / 2000.0).sin();
        // Zero volts rest at 0.5 um. In the run-in the sensor is not even there.
        let displacement_um = if row < RUN_IN { 0.0 } else { 0.5 + 1.7590 * command_v };
        writeln!(text, "{:.5},{command_v:.6},{displacement_um:.6}", row as f64 / 20e3).expect("memory takes it");
    }
    folder.write("log.csv", text);
    let call =
        "replay --plant models/thesis-newid2.toml @/log.csv --run-in 10 --free-offset --out @/p.csv --no-page --json";
    let output = run(&folder, call);
    succeeded(&output);
    let said = json(&output);
    assert_eq!(said["rows"], 2000, "{said:?}");
    // 10 Hz is slow for a resonance at 490 Hz: alpha/k is 1.759 um/V, and 0.96 degrees of lag are 1.7 % of the amplitude.
    assert!((97.0..99.9).contains(&said["fit_percent"].as_f64().expect("a number")), "{said:?}");
    assert!((said["offset_um"].as_f64().expect("a number") - 0.5).abs() < 0.02, "{said:?}");
}

/// Of a log that is longer than what is kept of it nobody can say that it stands still throughout.
#[test]
fn a_log_that_rests_at_first_is_not_said_to_rest_throughout() {
    let folder = Folder::new("rests");
    let mut text = "# rate_hz: 20000\ntime_s,command_V,displacement_um\n".to_owned();
    for row in 0..RUN_IN + 2000 {
        let command_v = if row < RUN_IN { 0.0 } else { 20.0 };
        writeln!(text, "{:.5},{command_v},{:.3}", row as f64 / 20e3, 1.759 * command_v).expect("memory takes it");
    }
    folder.write("log.csv", text);
    let call = "replay --plant models/thesis-newid2.toml @/log.csv --initial relaxed --out @/p.csv --no-page --json";
    let output = run(&folder, call);
    let said = succeeded(&output);
    assert!(!said.contains("throughout"), "{said}");
    assert_eq!(json(&output)["rows"], RUN_IN + 2000);
}

/// A rate that is asked for, or that a log's times contradict, is not what the prediction's times were rounded by.
#[test]
fn the_times_of_a_prediction_are_those_that_were_replayed() {
    let folder = Folder::new("replay-times");
    folder.write("log.csv", good_csv(40));
    folder.write("wrong.csv", good_csv(40).replace("# rate_hz: 1000", "# rate_hz: 10"));
    for (arguments, dt_s) in [("@/log.csv --rate 20000", 5e-5), ("@/wrong.csv", 1e-3), ("@/log.csv", 1e-3)] {
        let call =
            format!("replay --plant models/thesis-newid2.toml {arguments} --initial relaxed --out @/p.csv --no-page");
        succeeded(&run(&folder, &call));
        let prediction = folder.read("p.csv");
        let time_s = column(&prediction, "time_s");
        let is_there = |(row, time_s): (usize, &f64)| (time_s - row as f64 * dt_s).abs() < 1e-3 * dt_s;
        assert!(time_s.iter().enumerate().all(is_there), "{arguments}: {time_s:?}");
        let stated = prediction.lines().next().and_then(|line| line.strip_prefix("# rate_hz: "));
        let rate_hz: f64 = stated.and_then(|text| text.parse().ok()).expect("a rate");
        assert!((rate_hz * dt_s - 1.0).abs() < 1e-9, "{arguments}: {rate_hz}");
    }
}

/// Where a kind has no structure nothing stands for newtons.
#[test]
fn a_force_is_left_out_where_no_structure_takes_it() {
    let folder = Folder::new("replay-force");
    let more = |line: &str| match line.as_bytes() {
        [b'#', ..] => line.to_owned(),
        [b't', ..] => format!("{line},force_N"),
        _ => format!("{line},5"),
    };
    let forced = good_csv(40).lines().map(more).collect::<Vec<String>>().join("\n") + "\n";
    folder.write("weight.csv", forced.replace("force_N", "weight"));
    folder.write("force.csv", forced);
    let predicted = |plant: &str, log: &str| {
        let call = format!("replay --plant models/{plant}.toml @/{log}.csv --initial relaxed --out @/p.csv --no-page");
        let said = succeeded(&run(&folder, &call));
        (column(&folder.read("p.csv"), "predicted_um"), said.contains("its force_N is left out"))
    };
    for (plant, takes_force) in [("thesis-bouc-wen-static", false), ("thesis-newid2", true)] {
        let ((without, _), (with, is_said)) = (predicted(plant, "weight"), predicted(plant, "force"));
        assert_eq!((with != without, is_said), (takes_force, !takes_force), "{plant}");
    }
}
