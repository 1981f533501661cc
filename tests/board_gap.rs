//! The gap that a board makes by itself, found by the diagnosis: what it samples, drives and delays, against an ideal simulation.

mod support;

use serde_json::Value;
use support::{Folder, PLANT, image, number, root, run, succeeded};

/// Levels, two sines, and multisines to 1280 Hz, of which the last is never fitted; 1.2 s at 20 kHz.
const SPECS: [&str; 4] = [
    "hold:20V@0.05s+hold:60V@0.05s+hold:-30V@0.05s+zero@0.05s",
    "sine:60V@10Hz/0.3s+sine:60V@100Hz/0.1s",
    "multisine:60V@5-1280Hz,periods=2,seed=1",
    "multisine:40V@5-1280Hz,periods=1,seed=2",
];
const LOGS: [&str; 4] = ["01-drive-1.csv", "02-drive-2.csv", "03-drive-3.csv", "04-drive-4.csv"];

/// Diagnoses the logs of `logs` with `plant`; the answer.
fn diagnosis(folder: &Folder, plant: &str, logs: &str, out: &str) -> Value {
    let fitted: String = LOGS[..3].iter().map(|name| format!("@/{logs}/{name} ")).collect();
    let held_out = LOGS[3];
    succeeded(&run(folder, &format!("diagnose --plant {plant} {fitted} --held-out @/{logs}/{held_out} --out @/{out}")));
    serde_json::from_str(&folder.read(&format!("{out}/diagnosis.json"))).expect("JSON")
}

fn names(found: &Value) -> Vec<&str> {
    found["effects"].as_array().expect("a list").iter().filter_map(Value::as_str).collect()
}

fn parameter(found: &Value, name: &str) -> [f64; 2] {
    let all = found["parameters"].as_array().expect("a list");
    let one =
        all.iter().find(|p| p["name"] == name).and_then(Value::as_object).unwrap_or_else(|| panic!("{name}: {all:?}"));
    [number(one, "value"), number(one, "sigma")]
}

#[test]
fn its_delay_and_its_quantisation_are_named_with_their_sizes() {
    let Some(image) = image() else { return };
    let folder = Folder::new("board-gap");
    // A sensor of 5 nm, as its file states: a quarter of what the ADC's step adds.
    let thesis = std::fs::read_to_string(root().join(PLANT)).expect("ours");
    let sensor = "\n[sensor]\nnoise_um = { value = 0.005, sigma = 0.2, source = \"data sheet\" }\n";
    folder.write("nominal.toml", thesis + sensor);
    let specs: String = SPECS.iter().map(|spec| format!("--spec {spec} ")).collect();
    let call = format!("record --board virtual --image {image} --plant @/nominal.toml {specs} --out @/run");
    succeeded(&run(&folder, &call));

    // 12 bits over +-130 um in 3.3 V: 63.477 nm.
    let check_lattice = |found: &Value| {
        let [quantum_m, _] = parameter(found, "quantum_m");
        assert!((quantum_m / 63.477e-9 - 1.0).abs() < 1e-3, "{quantum_m}");
    };
    // As recorded, the logs say when commands act: what is left is the ADC.
    let found = diagnosis(&folder, "@/nominal.toml", "run", "as-recorded");
    assert_eq!(names(&found), ["quantisation"]);
    check_lattice(&found);

    // An ideal simulation knows of no time between a sample and its drive: it sees what the board needs, 10 us.
    std::fs::create_dir(folder.path("ideal")).expect("a folder");
    for name in LOGS {
        let log = folder.read(&format!("run/{name}"));
        let rest: String =
            log.lines().filter(|line| !line.contains("latency_us")).map(|line| format!("{line}\n")).collect();
        assert!(rest.len() < log.len());
        folder.write(&format!("ideal/{name}"), rest);
    }
    let found = diagnosis(&folder, "@/nominal.toml", "ideal", "delay");
    assert_eq!(names(&found), ["transport_delay", "quantisation"]);
    check_lattice(&found);
    let [delay_s, sigma_s] = parameter(&found, "delay_s");
    // Rounding is no white noise, so that its sigma is known to a factor only.
    assert!((delay_s - 10e-6).abs() < (8.0 * sigma_s).max(2e-8) && sigma_s < 1e-7, "{delay_s} +- {sigma_s}");
    assert!(found["gap"]["shrink_percent"].as_f64().expect("a number") > 95.0, "{}", found["gap"]);

    // The plant that it wrote has both: nothing is left to find.
    let found = diagnosis(&folder, "@/delay/augmented.toml", "ideal", "both");
    assert_eq!((found["verdict"].as_str(), names(&found).len()), (Some("no_gap"), 0), "{}", found["ranking"]);
}
