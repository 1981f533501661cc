//! `hysteron replay` as a user meets it: a run-in that is longer than what is kept of a log.

use crate::support::{Folder, json, run, succeeded};
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
