//! MAT files against another program's code: what it writes our reader takes, what ours writes it reads. Outside the workspace, because
//! that code takes a minute to compile and changes never; `cargo xtask long` runs this.

use matrw::{MatFile, load_matfile, matfile, matvar, save_matfile_v7};
use plant_sim::log::{self, Log, ReadOptions};
use std::path::{Path, PathBuf};

/// Captures as ControlDesk saves them, which the tests of `plant-sim` read.
const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../plant-sim/tests/data");

fn capture(with_axis: bool) -> MatFile {
    let n = 40;
    let ramp = |scale: f64| -> Vec<f64> { (0..n).map(|k| scale * f64::from(k)).collect() };
    let axis = if with_axis { ramp(1e-3) } else { Vec::new() };
    let capture = matvar!({ SamplingPeriod: 1e-3 });
    let x = matvar!([
        { Name: "T", Data: Vec::<f64>::new(), Raster: "slow" },
        { Name: "T", Data: axis, Raster: "HostService" },
    ]);
    let y = matvar!([
        { Name: "\"Model Root\"/\"Drive\"/u_V", Data: ramp(2.0), XIndex: 2 },
        { Name: "\"Model Root\"/\"Sensor\"/y_um", Data: ramp(0.5), XIndex: 2 },
        { Name: "\"Model Root\"/\"Other\"/y_um", Data: ramp(9.0), XIndex: 2 },
        { Name: "\"Model Root\"/temperature", Data: ramp(1.0), XIndex: 1 },
    ]);
    matfile!(cap_001: matvar!({ X: x, Y: y, Capture: capture, Description: "a test" }))
}

fn small_capture() -> MatFile {
    let ramp: Vec<f64> = (0..20).map(f64::from).collect();
    let y = matvar!([
        { Name: "u", Data: ramp.clone(), XIndex: 1 },
        { Name: "y", Data: ramp.clone(), XIndex: 1 },
    ]);
    let x = matvar!([{ Data: ramp, Raster: "a" }, { Data: Vec::<f64>::new(), Raster: "b" }]);
    matfile!(cap: matvar!({ X: x, Y: y }))
}

fn scratch(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("mat_oracle-{}-{name}.mat", std::process::id()))
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// With MAT_FIXTURES=write they are written anew.
#[test]
fn the_fixtures_are_what_the_other_program_writes() {
    let write = std::env::var("MAT_FIXTURES").is_ok_and(|word| word == "write");
    for (name, file, compress) in [
        ("capture", capture(true), false),
        ("capture-compressed", capture(true), true),
        ("capture-without-axis-compressed", capture(false), true),
        ("small-capture", small_capture(), false),
        ("small-capture-compressed", small_capture(), true),
    ] {
        let path = scratch(name);
        save_matfile_v7(text(&path), file, compress).expect("saved");
        let bytes = std::fs::read(&path).expect("there");
        std::fs::remove_file(&path).expect("removed");
        let fixture = Path::new(FIXTURES).join(format!("{name}.mat"));
        if write {
            std::fs::write(&fixture, &bytes).expect("written");
        }
        // The header is free text.
        assert_eq!(std::fs::read(&fixture).expect("a fixture")[124..], bytes[124..], "{name}");
    }
}

#[test]
fn files_that_are_written_are_what_the_other_reader_takes() {
    let command_v: Vec<f64> = (0..64).map(|k| 0.1 * f64::from(k)).collect();
    let displacement_m = command_v.iter().map(|v| 1e-6 * v).collect();
    let log = Log { dt_s: 1e-4, command_v, displacement_m, ..Log::default() };
    let path = scratch("ours");
    log::write(&path, &log).expect("written");
    let mat = load_matfile(text(&path)).expect("matrw reads it");
    std::fs::remove_file(&path).expect("removed");
    assert_eq!(mat["command_V"].to_vec_f64().expect("a vector"), log.command_v);
}

#[test]
fn a_benchmarks_file_is_read_alike() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/boucwen-benchmark"));
    let names =
        ["uest_multisine", "yest_multisine", "uval_multisine", "yval_multisine", "uval_sinesweep", "yval_sinesweep"];
    for name in names {
        let path = data.join(format!("{name}.mat"));
        if !path.exists() {
            println!("not run: {} absent", path.display());
            continue;
        }
        let mat = load_matfile(text(&path)).expect("matrw reads it");
        let variable = mat.iter().next().expect("a variable").0.clone();
        let mut options = ReadOptions { rate_hz: Some(750.0), ..ReadOptions::default() };
        options.columns.insert("command".into(), variable.clone());
        options.columns.insert("displacement".into(), variable.clone());
        let log = log::read(&path, &options).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Some(log.command_v), mat[variable.as_str()].to_vec_f64(), "{name}");
    }
}
