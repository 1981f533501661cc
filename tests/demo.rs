//! `hysteron` alone: the seal is printed before the diagnosis and opened after it, and the report comes last.

use crate::support::{hysteron, stdout, succeeded};
use std::path::Path;

#[test]
fn the_seal_comes_first_and_the_report_last() {
    // Thermal gain: quick to diagnose.
    let output = hysteron(["--seed", "4"]);
    succeeded(&output);
    let said = stdout(&output);
    let at = |text: &str| said.find(text).unwrap_or_else(|| panic!("{text:?} in {said}"));
    assert!(at("seed 4") < at("sha256 ") && at("sha256 ") < at("$ hysteron diagnose"));
    assert!(
        at("The gap is") < at("The seal is opened") && at("sha256 is as before") < at("on the bench: thermal_gain")
    );
    assert!(said.contains("the diagnosis is right"), "{said}");
    let report = said.lines().last().expect("a last line");
    assert!(report.ends_with("report.html") && Path::new(report).is_file(), "{report}");
    assert_eq!(output.status.code(), Some(0));
}
