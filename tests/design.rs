//! `hysteron design`, its check and `hysteron reproduce`, as a user meets them.

use crate::support::{Folder, PI1, PLANT, json, number, root, run, stderr, stdout, succeeded};

const WISH: &str = "--rate 40000 --settle-ms 5 --overshoot 2 --gain-margin-db 6 --no-page --json";

#[test]
fn a_design_runs_as_it_says_and_its_inverse_follows_better() {
    let folder = Folder::new("design");
    let mut errors = Vec::new();
    for (name, inverse) in [("own", ""), ("inverse", "--inverse")] {
        let call = format!("design --plant {PLANT} {WISH} {inverse} --track --out @/{name}.toml");
        let output = run(&folder, &call);
        succeeded(&output);
        let said = json(&output);
        assert!(number(&said, "settle_2_percent_ms") <= 5.0 && number(&said, "overshoot_percent") <= 2.0, "{said:?}");
        assert!(number(&said, "gain_margin_dB") >= 6.0, "{said:?}");
        // The file does in `simulate` what the design said it would.
        let call = format!(
            "simulate --plant {PLANT} --controller @/{name}.toml --reference sine:80um@100Hz --rate 40000 --seconds 0.03 \
             --out @/{name}.csv --no-page --json"
        );
        let output = run(&folder, &call);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let error = number(&json(&output), "rms_error_percent");
        let tracked = said["tracking_rms_percent"][3][1].as_f64().expect("a number");
        assert!((error - tracked).abs() <= 1e-9 * tracked, "{error} {tracked}");
        errors.push(error);
    }
    assert!(errors[1] < 0.1 * errors[0], "{errors:?}");
}

/// A plant whose stage stands 30 um.
fn small(plant: &str) -> String {
    let line = plant.lines().find(|line| line.starts_with("displacement_max_um")).expect("a rig");
    plant.replace(line, "displacement_max_um = { value = 30.0 }")
}

#[test]
fn limits_of_another_stage_are_told() {
    let folder = Folder::new("design-no-rig");
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    folder.write("plant.toml", plant.split_once("[rig]").expect("its last section").0);
    let said = |plant: &str| succeeded(&run(&folder, &format!("design --plant {plant} {WISH} --out @/own.toml")));
    assert!(said("@/plant.toml").contains("--plant has no [rig]: the limits are those of the thesis' bender"));
    assert!(!said(PLANT).contains("[rig]"));
    let text = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    folder.write("small.toml", small(&text));
    let output = run(&folder, &format!("design --plant @/small.toml {WISH} --out @/small-own.toml"));
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("--step-um 80 lies beyond the clamp of the reference, 25.0 um"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn a_controller_with_limits_of_another_stage_is_refused_or_told() {
    let folder = Folder::new("design-rig");
    let text = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    folder.write("small.toml", small(&text).replace("drive_max_V = { value = 90.0", "drive_max_V = { value = 50.0"));
    let trip = "the displacement trip of 120 um lies above [rig] displacement_max_um = 30: set it to 30 um at the most";
    let drive =
        "the drive limits of -90 to 90 V reach beyond [rig] drive_min_V = -90 and drive_max_V = 50: set them within";
    let given = format!("--plant @/small.toml --controller {PI1}");
    let output = run(&folder, &format!("design {given} {WISH} --step-um 20 --out @/own.toml"));
    let said = stderr(&output);
    assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{said}");
    assert!(said.contains(&format!("pi1.toml: {trip}; {drive}")), "{said}");
    assert!(!folder.path("own.toml").exists());
    let said = succeeded(&run(&folder, &format!("design --check {given} --rate 20000 --no-page --out @/c.json")));
    for words in [trip, drive, "the worst peak, 101."] {
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn a_check_says_where_the_edges_are_and_refuses_beyond_them() {
    let folder = Folder::new("design-check");
    let call =
        |rate: u32| format!("design --check --plant {PLANT} --controller {PI1} --rate {rate} --no-page --out @/c.json");
    let output = run(&folder, &call(20_000));
    succeeded(&output);
    let found: serde_json::Value = serde_json::from_str(&folder.read("c.json")).expect("JSON");
    let lowest = number(found.as_object().expect("an object"), "lowest_stable_rate_hz");
    assert!(lowest > 5e3 && lowest < 9e3, "{found}");
    assert!(found["certified"].as_bool() == Some(true));
    assert!(stdout(&output).contains("certified: from every state"));
    let output = run(&folder, &call((lowest * 0.99) as u32));
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output)
            .lines()
            .last()
            .expect("an error")
            .starts_with("hysteron: controllers/pi1.toml: unstable: spectral radius 1.")
    );
}

#[test]
fn what_cannot_be_designed_is_said_in_one_line() {
    let folder = Folder::new("design-wrong");
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    let (before, hysterons) = plant.split_at(plant.find("[[actuator.hysteron]]").expect("hysterons"));
    let (one, after) = hysterons.split_at(2 + hysterons[2..].find("\n[").expect("another section"));
    folder.write("seven.toml", format!("{before}{}{after}", format!("{one}\n").repeat(6)));
    let cases = [
        (format!("design --plant {PLANT} --settle-ms 0.2 --out @/x.toml"), 4, "can't settle in 0.200 ms"),
        (format!("design --plant {PLANT} --settle-ms 1.2 --out @/x.toml"), 4, "the nearest settles in"),
        (format!("design --plant {PLANT} --gain-margin-db 60 --out @/x.toml"), 4, "no placement keeps 60 dB"),
        (
            "design --plant models/thesis-bouc-wen-static.toml --out @/x.toml".to_owned(),
            2,
            "no second-order skeleton to place poles on: it has no mass",
        ),
        (
            "design --plant models/thesis-bouc-wen.toml --inverse --out @/x.toml".to_owned(),
            2,
            "--inverse inverts hysterons",
        ),
        (format!("design --check --plant {PLANT} --out @/x.json"), 2, "--controller"),
        (
            format!("design --check --plant {PLANT} --controller {PI1} --settle-ms 1 --out @/x.json"),
            2,
            "'--check' cannot be used with '--settle-ms <MS>'",
        ),
        (
            "design --plant @/seven.toml --inverse --out @/x.toml".to_owned(),
            2,
            "--inverse inverts at most 6 hysterons, and --plant has 7",
        ),
        (
            format!("diagnose --plant models/thesis-bouc-wen.toml {PLANT} --out @/d"),
            2,
            "a plant of kind bouc-wen can't be diagnosed",
        ),
    ];
    for (call, code, expected) in cases {
        let output = run(
            &folder,
            &call.replace("--settle-ms 5 --overshoot 2", "--overshoot 2").replace("--gain-margin-db 6 ", ""),
        );
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {error}");
        assert!(error.contains(expected) && error.lines().count() == 1, "{call}: {error}");
    }
}

#[test]
fn the_reproduction_writes_its_page_and_says_how_many_agree() {
    let folder = Folder::new("reproduce");
    let output = run(&folder, "reproduce --json --out @/report.html");
    succeeded(&output);
    let said = json(&output);
    let entries = said["entries"].as_array().expect("entries");
    assert!(entries.len() > 150 && entries.iter().all(|entry| entry["verdict"] != "differs"), "{said:?}");
    let page = folder.read("report.html");
    for text in ["Errata", "Figure 3.10: 150 Hz", "Figure 2.2", "22.072", "0.022653084227172"] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("http://") || !page.contains("<script src"), "a page loads nothing");
}
