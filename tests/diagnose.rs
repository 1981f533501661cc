//! `hysteron diagnose` as a user meets it: made cases whose truth is known, the contract's keys, and inputs that can't be used.

use crate::support::{
    Folder, PLANT, asked, column, good_csv, is_long, json, number, root, run, stderr, stdout, succeeded,
};
use blind_truth::{Case, EffectId, Request, Size, Split, Subject, make};
use serde_json::Value;

/// A case's plant and logs in the folder, and the call that diagnoses those of its logs that `wanted` names.
fn call(folder: &Folder, case: &Case, wanted: &[&str]) -> String {
    folder.write("nominal.toml", &case.plant_toml);
    for log in case.logs.iter().chain(&case.held_out) {
        folder.write(&format!("{}.csv", log.name), log.to_csv());
    }
    let logs: Vec<String> = case
        .logs
        .iter()
        .filter(|log| wanted.iter().any(|name| log.name.ends_with(name)))
        .map(|log| format!("@/{}.csv", log.name))
        .collect();
    assert_eq!(logs.len(), wanted.len());
    format!("diagnose --plant @/nominal.toml {} --held-out @/{}.csv --out @/out", logs.join(" "), case.held_out[0].name)
}

fn case(subject: Subject) -> Case {
    make(&Request { seed: 7, subject, split: Split::Develop, size: Size::Short, strength: None })
}

fn of(effect: EffectId) -> Case {
    case(Subject::Effects(vec![effect]))
}

fn diagnosis(folder: &Folder) -> Value {
    serde_json::from_str(&folder.read("out/diagnosis.json")).expect("diagnosis.json is JSON")
}

fn list(value: &Value) -> Vec<&str> {
    let items = value.as_array().unwrap_or_else(|| panic!("{value} is a list"));
    items.iter().map(|item| item.as_str().unwrap_or_else(|| panic!("{item} is text"))).collect()
}

/// Every key of the contract with the right type.
fn check_contract(found: &Value) {
    assert_eq!(found["schema"], "hysteron-diagnosis-1");
    assert!(["no_gap", "explained", "unknown"].contains(&found["verdict"].as_str().expect("a verdict")));
    assert!(found["stage"].is_string() || found["stage"].is_null());
    list(&found["effects"]);
    let ranking = found["ranking"].as_array().expect("a ranking");
    // The registry's 30, a wrong number, no gap, unknown.
    assert_eq!(ranking.len(), 33);
    let sum: f64 = ranking.iter().map(|r| r["probability"].as_f64().expect("a probability")).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    assert!(ranking.iter().all(|r| r["effect"].is_string()));
    let set90 = list(&found["set90"]);
    let held: f64 = ranking[..set90.len()].iter().map(|r| r["probability"].as_f64().expect("a probability")).sum();
    assert!(held >= 0.9, "{set90:?} holds {held}");
    found["classes"].as_array().expect("classes").iter().for_each(|class| assert!(list(class).len() > 1));
    let gap = &found["gap"];
    assert!(["held-out log", "held-out stretches"].contains(&gap["headline"].as_str().expect("a headline")));
    for key in [
        "nominal_rms_um",
        "refit_rms_um",
        "augmented_rms_um",
        "noise_rms_um",
        "nominal_fit_percent",
        "refit_fit_percent",
        "augmented_fit_percent",
        "shrink_percent",
        "closure_percent",
        "predicted_shrink_percent",
    ] {
        assert!(gap[key].is_number(), "gap.{key}");
    }
    let interval = gap["shrink_percent_ci95"].as_array().expect("an interval");
    let (low, high) = (interval[0].as_f64().expect("low"), interval[1].as_f64().expect("high"));
    let shrink = gap["shrink_percent"].as_f64().expect("a shrink");
    assert!(interval.len() == 2 && low <= shrink && shrink <= high, "{gap}");
    let shares = found["shares"].as_array().expect("shares");
    let sum: f64 = shares.iter().map(|s| s["percent"].as_f64().expect("a percentage")).sum();
    assert!((sum - 100.0).abs() < 1e-9 && shares.iter().all(|s| s["effect"].is_string()), "{shares:?}");
    for (list, keys) in [
        ("parameters", &["effect", "name", "value", "sigma", "unit"][..]),
        ("changed", &["name", "nominal", "refit", "sigma"]),
    ] {
        for item in found[list].as_array().expect(list) {
            keys.iter().for_each(|key| assert!(item[key].is_number() || item[key].is_string(), "{list}.{key}: {item}"));
        }
    }
    let location = &found["where"];
    for key in ["bands", "logs", "segments", "states"] {
        assert!(location[key].is_array(), "where.{key}");
    }
    assert!(location["harmonics"].is_object());
    for key in ["from_hz", "to_hz", "share_percent"] {
        assert!(location["bands"][0][key].is_number(), "where.bands.{key}");
    }
    let left = &found["unexplained"];
    for key in ["rms_um", "structured_share_percent", "max_abs_autocorrelation", "lag_s"] {
        assert!(left[key].is_number(), "unexplained.{key}");
    }
    assert!(left["strongest"].is_string());
    match &found["next_experiment"] {
        Value::Null => assert!(found["no_experiment_reason"].is_string()),
        next => {
            assert!(next["spec"].is_string() && next["rate_hz"].is_number() && next["reason"].is_string(), "{next}");
            assert!(list(&next["splits"]).len() > 1);
        }
    }
}

/// Rms in micrometres that `plant` leaves on the held-out log, and what it lacks of a fit of 100 %.
fn replayed(folder: &Folder, case: &Case, plant: &str) -> [f64; 2] {
    let log = &case.held_out[0].name;
    let output = run(folder, &format!("replay --plant @/{plant} @/{log}.csv --out @/pred.csv --no-page --json"));
    succeeded(&output);
    let said = json(&output);
    [number(&said, "rms_um"), 100.0 - number(&said, "fit_percent")]
}

/// An effect that is on the bench is named first, alone, and the plant with it replays the held-out log as the diagnosis says.
fn is_named(effect: EffectId, logs: &[&str]) {
    let folder = Folder::new(&format!("diagnose-{}", effect.id()));
    let case = of(effect);
    let output = run(&folder, &call(&folder, &case, logs));
    succeeded(&output);
    assert!(stdout(&output).starts_with("The gap is "), "{}", stdout(&output));
    let found = diagnosis(&folder);
    check_contract(&found);
    assert_eq!((found["verdict"].as_str(), found["stage"].as_str()), (Some("explained"), Some(effect.stage())));
    assert_eq!(list(&found["effects"]), [effect.id()]);
    assert_eq!(found["ranking"][0]["effect"], effect.id());
    assert_eq!(found["gap"]["headline"], "held-out log");
    assert!(found["gap"]["closure_percent"].as_f64().expect("a closure") > 90.0, "{}", found["gap"]);
    let (before, after) = (replayed(&folder, &case, "nominal.toml"), replayed(&folder, &case, "out/augmented.toml"));
    assert!(after[0] < 0.5 * before[0], "{before:?} um with the nominal plant, {after:?} with the effect");
    // The replay fits its start to the whole log and scores all of it; else it is the same plant on the same log.
    let gap = found["gap"].as_object().expect("a gap");
    let said = [number(gap, "augmented_rms_um"), 100.0 - number(gap, "augmented_fit_percent")];
    let is_same = after.iter().zip(said).all(|(after, said)| (after / said - 1.0).abs() < 0.1);
    assert!(is_same, "replayed {after:?} um, said {said:?}");
    let page = folder.read("out/report.html");
    assert!(page.contains(effect.id()) && page.contains("Rivals rejected") && page.contains("Where the gap lies"));
    let names = std::fs::read_dir(folder.path("out")).expect("the directory").count();
    assert_eq!(names, 3, "nothing but the three files");
}

/// What was found is in the plant, and is not found again: an offset is put on top of the file's own, a payload moves with its numbers.
#[test]
fn a_diagnosed_plant_has_no_gap_left() {
    for effect in [EffectId::SensorOffset, EffectId::PayloadMass] {
        let folder = Folder::new(&format!("diagnose-again-{}", effect.id()));
        let call = call(&folder, &of(effect), &["steps", "sines"]);
        succeeded(&run(&folder, &call));
        assert_eq!(diagnosis(&folder)["verdict"], "explained");
        folder.write("nominal.toml", folder.read("out/augmented.toml"));
        succeeded(&run(&folder, &call));
        let again = diagnosis(&folder);
        assert_eq!(again["verdict"], "no_gap", "{}: {}", effect.id(), again["ranking"]);
        let [nominal, noise] =
            ["nominal_rms_um", "noise_rms_um"].map(|key| again["gap"][key].as_f64().expect("an rms"));
        assert!(nominal < 1.2 * noise, "{}: {}", effect.id(), again["gap"]);
    }
}

/// Two effects are named from steps and sines, and nothing else is; `wanted` in alphabetical order.
fn are_named(name: &str, case: &Case, wanted: [&str; 2]) -> Value {
    let folder = Folder::new(&format!("diagnose-{name}"));
    succeeded(&run(&folder, &call(&folder, case, &["steps", "sines"])));
    let found = diagnosis(&folder);
    let mut effects = list(&found["effects"]);
    effects.sort_unstable();
    assert_eq!(effects, wanted, "{}", found["ranking"]);
    found
}

#[test]
fn creep_is_named() {
    is_named(EffectId::Creep, &["steps", "hold"]);
}

/// Elements between those of the fixed spectrum: with these alone 1.05 times the noise stayed, which on a longer bench a drift took.
#[test]
fn creep_of_few_elements_leaves_nothing_to_a_drift() {
    let found = diagnosis_of_calibrate("diagnose-few-elements", 307, Subject::Effects(vec![EffectId::Creep]));
    assert_eq!(list(&found["effects"]), ["creep"], "{}", found["ranking"]);
    let left = found["best_fit"]["rms_over_noise"].as_f64().expect("a ratio");
    assert!(left < 1.02, "{left}");
}

#[test]
fn a_slow_amplifier_is_named() {
    is_named(EffectId::AmplifierBandwidth, &["steps", "multisine"]);
}

/// Without the amplifier's monitor a gain may be the amplifier's, the sensor's or a payload's; with it there is nothing left to ask.
#[test]
fn a_drive_monitor_tells_the_amplifier_from_what_follows() {
    let folder = Folder::new("diagnose-monitor");
    let case = of(EffectId::AmplifierGain);
    succeeded(&run(&folder, &call(&folder, &case, &["steps", "sines"])));
    let without = diagnosis(&folder);
    assert!(without["classes"].as_array().is_some_and(|classes| !classes.is_empty()), "{}", without["ranking"]);
    for log in case.logs.iter().chain(&case.held_out).filter(|log| log.reference_um.is_none()) {
        let record = blind_truth::run_monitored(&case.bench, &log.command_v, log.rate_hz, 1);
        folder.write(&format!("{}.csv", log.name), record.to_csv());
    }
    let line = "diagnose --plant @/nominal.toml @/log1-steps.csv @/log2-sines.csv --held-out @/held-out-1-mixed.csv --out @/out";
    succeeded(&run(&folder, line));
    let found = diagnosis(&folder);
    check_contract(&found);
    assert_eq!(list(&found["effects"]), ["amplifier_gain"]);
    assert_eq!(found["classes"].as_array().map(Vec::len), Some(0), "{}", found["classes"]);
    let truth =
        case.truth.parameters.iter().find(|(name, _)| name.starts_with("amplifier_gain.gain")).expect("the truth");
    let value = found["parameters"][0]["value"].as_f64().expect("a value");
    assert!((value - truth.1).abs() < 2e-3, "{value} against {truth:?}");
}

#[test]
fn rows_that_were_lost_hide_no_effect_beside_them() {
    let mut case = of(EffectId::SensorNonlinearity);
    for log in &mut case.logs {
        // Every fortieth reading never came, and the one before was written again.
        for k in (40..log.displacement_um.len()).step_by(40) {
            log.displacement_um[k] = log.displacement_um[k - 1];
        }
    }
    let found = are_named("lost", &case, ["lost_samples", "sensor_nonlinearity"]);
    let share = found["parameters"].as_array().expect("parameters").iter().find(|p| p["effect"] == "lost_samples");
    let share = share.and_then(|p| p["value"].as_f64()).expect("a share");
    assert!((share - 1.0 / 40.0).abs() < 2e-3, "{share}");
}

#[test]
fn a_start_that_is_off_hides_no_effect_beside_it() {
    let case = case(Subject::Effects(vec![EffectId::InitialState, EffectId::SensorOffset]));
    are_named("start", &case, ["initial_state", "sensor_offset"]);
}

/// What a start leaves free does not do the work of a zero of a nanometre.
#[test]
fn a_start_that_is_off_is_no_zero() {
    let found = diagnosis_of_develop("start-alone", 11_745_173_191_606_416_024, [EffectId::InitialState]);
    assert_eq!(list(&found["effects"]), ["initial_state"], "{}", found["ranking"]);
    assert_eq!(list(&found["set90"]), ["initial_state"], "{}", found["ranking"]);
    let share = found["shares"].as_array().expect("shares").iter().find(|share| share["effect"] == "initial_state");
    assert!(
        share.and_then(|share| share["percent"].as_f64()).is_some_and(|percent| percent > 20.0),
        "{}",
        found["shares"]
    );
}

/// Late rows bend no number: one that is off is named beside them, though next to all of what stays is theirs.
#[test]
fn a_wrong_number_is_named_beside_jitter() {
    let case = case(Subject::Effects(vec![EffectId::ParameterError, EffectId::SamplingJitter]));
    are_named("jitter", &case, ["parameter_error", "sampling_jitter"]);
}

/// Lags fit alike here, and with all of them one dead zone is ten sigma off: with none of them it may go unnamed.
#[test]
fn a_wrong_number_is_named_beside_whichever_lag_fits() {
    let subject = Subject::Effects(vec![EffectId::ParameterError, EffectId::SensorBandwidth]);
    let found = diagnosis_of_calibrate("diagnose-number-lag", 7_759_091_638_248_208_189, subject);
    let names = list(&found["effects"]);
    assert!(names.len() == 2 && names.contains(&"parameter_error"), "{names:?} {}", found["ranking"]);
    let lag = names.iter().find(|name| **name != "parameter_error").expect("a lag");
    // A log that was never shown began inside both dead zones, and its first stretch opens one of them only: the other logs tell of the other.
    let of = |key: &str| found["gap"][key].as_f64().expect("a number");
    let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
    assert!(shrink > 97.0 && (shrink - predicted).abs() < 2.0, "{shrink} {predicted} {}", found["warnings"]);
    let is_of_both = |class: &Value| list(class).contains(lag) && list(class).contains(&"sensor_bandwidth");
    let classes = found["classes"].as_array().expect("classes");
    assert!(*lag == "sensor_bandwidth" || classes.iter().any(is_of_both), "{names:?} {classes:?}");
}

#[test]
fn a_bench_as_nominal_has_no_gap() {
    let folder = Folder::new("diagnose-null");
    let case = case(Subject::Null);
    let output = run(&folder, &format!("{} --json", call(&folder, &case, &["steps", "sines", "multisine"])));
    assert_eq!(succeeded(&output), "");
    let printed = json(&output);
    let found = diagnosis(&folder);
    assert_eq!(Value::Object(printed), found, "printed and written are one");
    check_contract(&found);
    assert_eq!(found["verdict"], "no_gap");
    assert_eq!((list(&found["effects"]).len(), found["stage"].is_null()), (0, true));
    assert_eq!(found["ranking"][0]["effect"], "no_gap");
    // That gains come next is said, as the table of what was fitted gives them less.
    assert!(
        std::fs::read_to_string(folder.path("out/report.html"))
            .unwrap()
            .contains("within what the plant states no fitted log shows it")
    );
    assert!(replayed(&folder, &case, "out/augmented.toml") < replayed(&folder, &case, "nominal.toml"));
}

/// What the plant's file leaves open is no gap: a zero of stated sigma, noise of which part is slow, a start that is not relaxed.
#[test]
fn what_the_plant_file_leaves_open_is_no_gap() {
    for seed in [5, 9] {
        let folder = Folder::new(&format!("diagnose-open-{seed}"));
        let split = Split::Calibrate;
        let case = make(&Request { seed, subject: Subject::Null, split, size: Size::Short, strength: None });
        let zero_um = case.truth.parameters.iter().find(|(name, _)| name == "nuisance_offset_um").expect("a zero").1;
        assert!(zero_um.abs() > 2.0 * case.truth.noise_um, "{zero_um} um would not be seen");
        let logs: Vec<&str> = case.logs.iter().map(|log| log.name.as_str()).collect();
        succeeded(&run(&folder, &call(&folder, &case, &logs)));
        let found = diagnosis(&folder);
        assert_eq!(
            (found["verdict"].as_str(), list(&found["effects"]).len()),
            (Some("no_gap"), 0),
            "{}",
            found["ranking"]
        );
        // Nothing is named, and the zero is found all the same.
        let augmented: f64 = folder
            .read("out/augmented.toml")
            .lines()
            .find_map(|line| line.strip_prefix("offset_um = { value = ")?.split(',').next()?.parse().ok())
            .expect("the zero");
        assert!((augmented - zero_um).abs() < 0.1, "{augmented} against {zero_um} um");
    }
}

/// What is said of a case in a form that need not be the registry's, from all of its logs and scored on both that were never shown.
fn diagnosis_of_calibrate(name: &str, seed: u64, subject: Subject) -> Value {
    diagnosis_of(name, &Request { seed, subject, split: Split::Calibrate, size: Size::Short, strength: None })
}

fn diagnosis_of_develop(name: &str, seed: u64, effects: impl Into<Vec<EffectId>>) -> Value {
    let subject = Subject::Effects(effects.into());
    diagnosis_of(name, &Request { seed, subject, split: Split::Develop, size: Size::Short, strength: None })
}

fn diagnosis_of(name: &str, request: &Request) -> Value {
    let folder = Folder::new(name);
    let case = make(request);
    let logs: Vec<&str> = case.logs.iter().map(|log| log.name.as_str()).collect();
    let call = format!("{} --held-out @/{}.csv", call(&folder, &case, &logs), case.held_out[1].name);
    succeeded(&run(&folder, &call));
    diagnosis(&folder)
}

/// Hysterons forget nothing: a start that went astray leaves a gap in its log alone, or in one that was held out, and is no gap of the bench.
#[test]
fn a_log_that_its_start_has_locked_is_no_gap() {
    for seed in asked([8_812_221, 8_820_581]) {
        let found = diagnosis_of_calibrate(&format!("diagnose-locked-{seed}"), seed, Subject::Null);
        assert_eq!(found["verdict"], "no_gap", "{}", found["ranking"]);
    }
}

/// An arm with the target still rings when the logs begin, after a ramp back.
#[test]
fn a_mode_that_rings_at_the_start_is_named_with_the_start() {
    if !is_long("a mode that rings at the start") {
        return;
    }
    let subject = Subject::Effects(vec![EffectId::VibrationMode, EffectId::InitialState]);
    let found = diagnosis_of_calibrate("diagnose-ringing", 3_939_110_526_974_818_321, subject);
    assert_eq!(list(&found["effects"]), ["vibration_mode", "initial_state"], "{}", found["ranking"]);
}

/// Two nulls of the opening of 0.16.0, which had a gain or a zero that each log has for itself, with one value in all of them: it had only led the refit out of
/// where its starts had bent the numbers.
#[test]
fn a_setting_that_all_logs_share_has_only_unlocked_the_refit() {
    for seed in asked([702_060_774_689_745_186, 10_107_909_399_233_505_302]) {
        let request = Request { seed, subject: Subject::Null, split: Split::Report, size: Size::Short, strength: None };
        let found = diagnosis_of(&format!("diagnose-shared-setting-{seed}"), &request);
        assert_eq!(found["verdict"], "no_gap", "{}", found["ranking"]);
    }
}

/// A start that its first stretch does not tell bends the numbers of all logs: what nothing explains is no gap once the others have led.
#[test]
fn a_gap_that_nothing_explains_may_be_a_locked_log() {
    if !is_long("nulls that a start locks") {
        return;
    }
    for seed in asked([2_202_393_683_420_244_045, 7_469_632_701_638_221_825]) {
        let found = diagnosis_of_calibrate(&format!("diagnose-led-null-{seed}"), seed, Subject::Null);
        assert_eq!(found["verdict"], "no_gap", "{}", found["ranking"]);
    }
}

/// Another hysteron about as slow as the plant's own hides in numbers that are off by a dozen sigma, at the noise.
#[test]
fn what_hides_in_numbers_that_no_plant_has_is_named() {
    if !is_long("a hysteron that hides in bent numbers") {
        return;
    }
    let seed = 7_616_468_346_907_578_404;
    let found = diagnosis_of_develop("diagnose-hides", seed, [EffectId::ExtraHysteron]);
    assert_eq!(found["effects"], serde_json::json!(["extra_hysteron"]), "{}", found["ranking"]);
    assert_eq!(found["changed"].as_array().map(Vec::len), Some(0), "{}", found["changed"]);
    let time_constant = &found["parameters"][1];
    let of = |key: &str| time_constant[key].as_f64().expect("a number");
    assert!(((of("value") - 6.4298e-3) / of("sigma")).abs() < 3.0, "{time_constant}");
}

/// What is small beside a large effect shows once that is fitted: a zero that is off beside a drift that imitates most of it, a hysteron beside a force. So
/// does what has bent numbers alone, and what a drift of each log's own imitates together with another effect.
#[test]
fn a_second_effect_that_the_first_hides_is_named_as_well() {
    if !is_long("a second effect that the first hides") {
        return;
    }
    let pairs = [
        (16_241_163_272_873_146_732, [EffectId::SensorOffset, EffectId::SensorDrift]),
        (16_204_848_179_824_658_076, [EffectId::PeriodicForce, EffectId::ExtraHysteron]),
        (388_415_697, [EffectId::RateDependentHysteresis, EffectId::VibrationMode]),
        (772_100_518, [EffectId::Backlash, EffectId::ThermalGain]),
        (939_153_512, [EffectId::Creep, EffectId::SensorOffset]),
    ];
    for (seed, effects) in asked(pairs) {
        let [first, second] = effects.map(EffectId::id);
        let found = diagnosis_of_develop(&format!("diagnose-{first}-{second}"), seed, effects);
        let named = list(&found["effects"]);
        assert!(named.len() == 2 && named.contains(&first) && named.contains(&second), "{}", found["ranking"]);
    }
}

/// Starts and numbers make up between them for a zero that is another one in each log: a refit comes to the noise with numbers that are off by many sigma.
#[test]
fn a_zero_that_wanders_bends_no_number() {
    let subject = Subject::Effects(vec![EffectId::SensorOffset]);
    let found = diagnosis_of_calibrate("diagnose-wandering-zero", 17_499_106_799_341_107_617, subject);
    assert_eq!(list(&found["effects"]), ["sensor_offset"], "{}", found["ranking"]);
    assert_eq!(list(&found["set90"]), ["sensor_offset"], "{}", found["ranking"]);
    assert_eq!(found["changed"].as_array().map(Vec::len), Some(0), "{}", found["changed"]);
    // A log never shown has a zero of its own as well, which its first stretch tells.
    let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
    let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
    assert!(shrink > 98.0 && (shrink - predicted).abs() < 1.0, "{shrink} against {predicted} % predicted");
}

/// Starts and a dead zone of twice its width make up for a zero that is another one in each log, at the noise. A log never shown has a zero of its own as
/// well, which its first stretch tells.
#[test]
fn a_zero_of_each_log_is_no_wrong_number() {
    if !is_long("zeros of each log beside starts") {
        return;
    }
    let folder = Folder::new("diagnose-zeros");
    let mut case = make(&Request {
        seed: 8_812_221,
        subject: Subject::Null,
        split: Split::Calibrate,
        size: Size::Short,
        strength: None,
    });
    let zeros_um = [8.0, -6.0, 5.0, -4.0, 9.0, -7.0, 6.0];
    for (log, zero_um) in case.logs.iter_mut().chain(&mut case.held_out).zip(zeros_um) {
        log.displacement_um.iter_mut().for_each(|y| *y += zero_um);
    }
    let logs: Vec<&str> = case.logs.iter().map(|log| log.name.as_str()).collect();
    succeeded(&run(&folder, &call(&folder, &case, &logs)));
    let found = diagnosis(&folder);
    assert_eq!(list(&found["effects"]), ["sensor_offset"], "{}", found["ranking"]);
    assert_eq!(list(&found["set90"]), ["sensor_offset"], "{}", found["ranking"]);
    let is_told = |warning: &str| warning.starts_with("sensor_offset: another one in each log");
    assert!(list(&found["warnings"]).into_iter().any(is_told), "{}", found["warnings"]);
    let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
    let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
    assert!(shrink > 98.0 && (shrink - predicted).abs() < 1.0, "{shrink} against {predicted} % predicted");
}

/// A zero that only the held-out log has: fitted logs tell nothing of it, so nobody names it, but the reader is told what is left without.
#[test]
fn a_held_out_log_with_a_zero_of_its_own_is_told() {
    let folder = Folder::new("diagnose-own-zero");
    let mut case = case(Subject::Null);
    case.held_out[0].displacement_um.iter_mut().for_each(|y| *y -= 8.0);
    succeeded(&run(&folder, &call(&folder, &case, &["steps", "sines", "hold"])));
    let found = diagnosis(&folder);
    let warnings = list(&found["warnings"]);
    let told = warnings.iter().find_map(|warning| warning.split_once("is a constant, ")?.1.split(' ').next());
    // What its hysterons hold at the start makes up for the rest.
    let constant_um: f64 = told.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{warnings:?}"));
    assert!((-8.0..-4.0).contains(&constant_um), "{constant_um}");
}

/// What scatters hides what is small beside it in all but the octaves and rows where it is quiet.
#[test]
fn what_is_small_beside_scatter_is_named_as_well() {
    let pairs = [
        (14_806_328_347_101_247_505, [EffectId::Creep, EffectId::SamplingJitter]),
        (3_442_760_743_714_820_265, [EffectId::Quantisation, EffectId::CoulombFriction]),
    ];
    for (seed, effects) in asked(pairs) {
        let [first, second] = effects.map(EffectId::id);
        let found =
            diagnosis_of_calibrate(&format!("diagnose-{first}-{second}"), seed, Subject::Effects(effects.into()));
        let named = list(&found["effects"]);
        assert!(named.len() == 2 && named.contains(&first) && named.contains(&second), "{}", found["ranking"]);
    }
}

/// Where some rows are late all are in the mean, which is no second effect.
#[test]
fn rows_that_are_late_now_and_then_are_jitter_alone() {
    let subject = Subject::Effects(vec![EffectId::SamplingJitter]);
    let found = diagnosis_of_calibrate("diagnose-late", 17_732_871_484_000_284_945, subject);
    assert_eq!(list(&found["effects"]), ["sampling_jitter"], "{}", found["ranking"]);
    let mut parameters = found["parameters"].as_array().expect("a list").iter();
    let mean = parameters.find(|parameter| parameter["name"] == "mean_s").expect("late in the mean");
    assert!(mean["value"].as_f64().expect("a number") > 0.0, "{mean}");
}

/// What is predicted of logs never shown happens there, though a hum hides where they start, and a payload has led the refit far off.
#[test]
fn the_predicted_shrink_is_realised() {
    for effect in asked([EffectId::MainsHum, EffectId::PayloadMass]) {
        let subject = Subject::Effects(vec![effect]);
        let found = diagnosis_of_calibrate(&format!("diagnose-shrink-{}", effect.id()), 8_824_001, subject);
        assert_eq!(found["effects"][0], effect.id(), "{}", found["ranking"]);
        let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
        let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
        assert!(shrink > 70.0 && (shrink - predicted).abs() < 5.0, "{shrink} against {predicted} % predicted");
        let [low, high] = [0, 1].map(|at| found["gap"]["predicted_shrink_percent_ci95"][at].as_f64().expect("a bound"));
        assert!(low <= predicted && predicted <= high, "{predicted} in [{low}, {high}]");
        // A hum meets the plant's difference in a phase of its own, which is worth a fraction of a point.
        assert!(low - 0.5 < shrink && shrink < high + 0.5, "{shrink} in [{low}, {high}]");
    }
}

/// A first stretch leaves open what a hysteron holds that moves later: all fitted logs began at rest, and so did this one.
#[test]
fn a_log_begins_as_those_that_were_fitted_do() {
    let subject = Subject::Effects(vec![EffectId::ClockError]);
    let found = diagnosis_of_calibrate("diagnose-begins-alike", 8_373_635_399_536_956_305, subject);
    assert_eq!(list(&found["effects"]), ["clock_error"], "{}", found["ranking"]);
    let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
    let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
    assert!(shrink > 97.0 && (shrink - predicted).abs() < 2.0, "{shrink} against {predicted} % predicted");
}

/// Hysterons that hold the same in all logs are as good as a zero, and a form that is not quite what is on the bench bent them to its needs: of 97 % that were
/// predicted 73 came, and of 86 % two.
#[test]
fn starts_at_rest_are_kept_where_they_leave_hardly_more() {
    let cases = [
        (EffectId::NonlinearStiffness, 10_755_974_996_307_768_233),
        (EffectId::SensorDrift, 9_709_501_373_515_782_445),
    ];
    for (effect, seed) in asked(cases) {
        let found =
            diagnosis_of_calibrate(&format!("diagnose-rest-{}", effect.id()), seed, Subject::Effects(vec![effect]));
        assert_eq!(list(&found["effects"]), [effect.id()], "{}", found["ranking"]);
        let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
        let (shrink, predicted) = (of("shrink_percent"), of("predicted_shrink_percent"));
        assert!(shrink > 90.0 && (shrink - predicted).abs() < 5.0, "{shrink} against {predicted} % predicted");
    }
}

/// Two logs are too few to tell how a third begins, and its first stretch leaves that open.
#[test]
fn a_start_that_nothing_tells_is_warned_of() {
    let folder = Folder::new("diagnose-open-start");
    let subject = Subject::Effects(vec![EffectId::ParameterError, EffectId::SensorBandwidth]);
    let seed = 7_759_091_638_248_208_189;
    let case = make(&Request { seed, subject, split: Split::Calibrate, size: Size::Short, strength: None });
    let logs: Vec<&str> = case.logs[..2].iter().map(|log| log.name.as_str()).collect();
    let call = format!("{} --held-out @/{}.csv", call(&folder, &case, &logs), case.held_out[1].name);
    succeeded(&run(&folder, &call));
    let warnings = diagnosis(&folder)["warnings"].to_string();
    assert!(warnings.contains("leave open what its hysterons hold"), "{warnings}");
}

/// Another element of the hysteresis lets the refit bend all numbers as a gain would; with the element in, they are ordinary, and no gain is left.
#[test]
fn an_effect_that_leaves_ordinary_numbers_needs_no_gain() {
    let found = diagnosis_of_calibrate(
        "diagnose-no-gain",
        8_367_768_457_000_907_389,
        Subject::Effects(vec![EffectId::ExtraHysteron]),
    );
    assert_eq!(found["effects"], serde_json::json!(["extra_hysteron"]), "{}", found["ranking"]);
    // One element is enough, and a second one would go astray where no log is fitted.
    assert_eq!(found["parameters"].as_array().expect("a table").len(), 3, "{}", found["parameters"]);
}

/// In a form of its own an effect may be told as two. Of these the one leads without which the other explains least: a zero that is off beside its
/// own breathing, and a mode beside the mass that it seems to bring along.
#[test]
fn of_an_effect_told_as_two_the_right_one_leads() {
    if !is_long("an effect that is told as two") {
        return;
    }
    let cases =
        [(EffectId::SensorOffset, 4_358_165_478_238_254_297), (EffectId::VibrationMode, 9_650_436_421_822_354_281)];
    for (effect, seed) in asked(cases) {
        let subject = Subject::Effects(vec![effect]);
        let found = diagnosis_of_calibrate(&format!("diagnose-leads-{}", effect.id()), seed, subject);
        assert_eq!(found["effects"].as_array().expect("a list").len(), 2, "{}", found["effects"]);
        assert_eq!(found["ranking"][0]["effect"], effect.id(), "{}", found["ranking"]);
    }
}

/// Edges and slopes of a hysteron that differ by side: the edges alone are a zero that is off. In the first case the search for both began where it
/// locked the logs; in the other nothing of the slopes shows before the zero is in.
#[test]
fn a_form_is_not_led_astray_where_a_part_of_it_leaves_less() {
    if !is_long("edges and slopes by side") {
        return;
    }
    for seed in asked([14_442_422_108_272_260_312, 281_687_491_707_763_784]) {
        let found = diagnosis_of_develop(&format!("diagnose-edges-{seed}"), seed, [EffectId::AsymmetricHysteresis]);
        assert_eq!(found["effects"], serde_json::json!(["asymmetric_hysteresis"]), "{}", found["ranking"]);
        let closure = found["gap"]["closure_percent"].as_f64().expect("a closure");
        assert!(closure > 90.0, "{}", found["gap"]);
    }
}

/// A log that a start has locked bends the numbers that it shares with the others, until that start finds no way back; they lead it out.
#[test]
fn a_locked_log_is_led_by_the_others() {
    // 1.8 times the noise's power stayed, with a gain 4.5 sigma off.
    let found = diagnosis_of_develop("diagnose-led-gain", 1_975_199_482_804_136_084, [EffectId::ThermalGain]);
    assert_eq!(found["effects"], serde_json::json!(["thermal_gain"]), "{}", found["ranking"]);
    for (number, truth) in [-0.15, 2.986].into_iter().enumerate() {
        let of = |key: &str| found["parameters"][number][key].as_f64().expect("a number");
        let deviation = (of("value") - truth) / of("sigma");
        assert!(deviation.abs() < 3.0, "{deviation}: {}", found["parameters"]);
    }
    if !is_long("a second log that its start locks") {
        return;
    }
    // A detent stood in the place of the cubic spring, and a log never shown was missed by five times what the refit leaves.
    let found = diagnosis_of_develop("diagnose-led-spring", 17_496_563_560_712_216_532, [EffectId::NonlinearStiffness]);
    let named = &found["parameters"][0];
    assert_eq!((&named["effect"], &named["name"]), (&"nonlinear_stiffness".into(), &"cubic_n_per_m3".into()));
    let of = |key: &str| found["gap"][key].as_f64().expect("a percentage");
    assert!(of("closure_percent") > 95.0, "{}", found["gap"]);
    assert!((of("shrink_percent") - of("predicted_shrink_percent")).abs() < 2.0, "{}", found["gap"]);
}

/// Beside numbers that the refit has bent the screening shows a sensor's lag of second order as one of first, or it leaves a hair less with them than at
/// home: a delay was named with 99 %.
#[test]
fn a_lag_of_another_order_is_no_delay() {
    for seed in asked([16_883_571_265_036_970_817, 4_156_571_029_139_274_309]) {
        let subject = Subject::Effects(vec![EffectId::SensorBandwidth]);
        let found = diagnosis_of_calibrate(&format!("diagnose-order-{seed}"), seed, subject);
        let set90 = found["set90"].as_array().expect("a set");
        let holds = |id: &str| set90.iter().any(|other| other == id);
        assert!(holds("sensor_bandwidth") && !holds("transport_delay"), "{}", found["ranking"]);
    }
}

/// A sensor's curve with a kink at zero and a gain by side are one curve: nothing measured tells them apart, and neither is preferred.
#[test]
fn one_curve_under_two_names_is_a_class() {
    let subject = Subject::Effects(vec![EffectId::SensorNonlinearity]);
    let found = diagnosis_of_calibrate("diagnose-kink", 3_874_779_277_426_417_133, subject);
    let both = ["sensor_gain", "sensor_nonlinearity"];
    assert_eq!(found["classes"], serde_json::json!([both]), "{}", found["ranking"]);
    let shares = [0, 1].map(|at| found["ranking"][at]["probability"].as_f64().expect("a probability"));
    assert!(shares[0] - shares[1] < 0.1 && shares[0] + shares[1] > 0.95, "{}", found["ranking"]);
}

/// A dead zone off its centre moves the readings as a zero does that is off: the commoner leads, and both are open.
#[test]
fn a_zero_leads_what_no_log_tells_from_it() {
    let found = diagnosis_of_develop("zero-leads", 16_277_849_238_608_469_004, [EffectId::SensorOffset]);
    assert_eq!(list(&found["effects"]), ["sensor_offset"], "{}", found["ranking"]);
    assert_eq!(list(&found["set90"]), ["sensor_offset", "asymmetric_hysteresis"], "{}", found["ranking"]);
    assert_eq!(found["stage"], "sensor");
}

#[test]
fn the_error_of_a_loop_is_predicted_with_both_plants() {
    let folder = Folder::new("diagnose-loop");
    let case = of(EffectId::Creep);
    let controller = root().join("controllers/pi2.toml");
    let line = call(&folder, &case, &["steps", "hold"]);
    succeeded(&run(
        &folder,
        &format!("{line} --controller {} --reference sine:40um@50Hz,for=0.1s", controller.display()),
    ));
    let found = diagnosis(&folder);
    let of = |key: &str| found["closed_loop"][key].as_f64().unwrap_or_else(|| panic!("closed_loop.{key}"));
    let (nominal, augmented) = (of("nominal_error_um"), of("augmented_error_um"));
    assert!(nominal > 0.0 && augmented > 0.0 && nominal != augmented, "{nominal} and {augmented}");
    // The diagnosed plant is a plant file: the same loop around it, run by itself, has the same error.
    let rate = of("rate_hz");
    let run_by_itself = format!(
        "simulate --plant @/out/augmented.toml --controller {} --reference sine:40um@50Hz,for=0.1s --rate {rate} --out @/loop.csv \
         --no-page",
        controller.display()
    );
    succeeded(&run(&folder, &run_by_itself));
    let log = folder.read("loop.csv");
    let (reference, displacement) = (column(&log, "reference_um"), column(&log, "displacement_um"));
    let squares: f64 = reference.iter().zip(&displacement).map(|(r, y)| (r - y).powi(2)).sum();
    let alone = (squares / reference.len() as f64).sqrt();
    // A simulated log carries the noise that the plant states.
    assert!((alone / augmented - 1.0).abs() < 0.02, "{alone} um by itself, {augmented} um said");
}

#[test]
fn a_noisy_sensor_is_told_from_its_data_sheet() {
    let folder = Folder::new("diagnose-noise");
    let case = of(EffectId::NoiseExcess);
    let line = call(&folder, &case, &["steps", "sines"]);
    assert!(succeeded(&run(&folder, &line)).contains("what scatters can't be predicted"));
    let found = diagnosis(&folder);
    check_contract(&found);
    assert_eq!(list(&found["effects"]), ["noise_excess"]);
    let truth = case.truth.parameters.iter().find(|(name, _)| name == "noise_excess.rms_m").expect("the truth").1;
    let value = found["parameters"][0]["value"].as_f64().expect("a value");
    // A few thousand rows know an rms to a per cent or two, and the data sheet's 10 % of a smaller noise add as much.
    assert!((value / truth - 1.0).abs() < 0.1, "{value} against {truth}");
    succeeded(&run(&folder, "replay --plant @/out/augmented.toml @/log1-steps.csv --out @/p.csv --no-page"));
}

/// A plant without hysterons on logs of its own making, and logs of different rates.
#[test]
fn a_linear_plant_is_diagnosed_too() {
    let folder = Folder::new("diagnose-linear");
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("the thesis' plant");
    let (before, after) = (plant.find("[[actuator.hysteron]]"), plant.find("[structure]"));
    let linear = format!("{}{}", &plant[..before.expect("hysterons")], &plant[after.expect("a structure")..]);
    folder.write("linear.toml", &linear);
    for (name, rate, spec) in
        [("fast.csv", 20000, "sine:20V@50Hz,for=0.2s"), ("slow.csv", 10000, "square:20V@10Hz,for=0.2s")]
    {
        let call = format!("simulate --plant @/linear.toml --command {spec} --rate {rate} --out @/{name} --no-page");
        succeeded(&run(&folder, &call));
    }
    let output = run(&folder, "diagnose --plant @/linear.toml @/fast.csv @/slow.csv --out @/out");
    let said = succeeded(&output);
    assert!(said.contains("fast.csv is sampled at 20000.000000 Hz and slow.csv at 10000.000000 Hz"), "{said}");
    let found = diagnosis(&folder);
    check_contract(&found);
    assert_eq!(found["verdict"], "no_gap", "{}", found["gap"]);
    assert_eq!(found["gap"]["headline"], "held-out stretches");
}

/// Each call is refused with one line and its code, and leaves no directory behind.
#[test]
fn what_cannot_be_diagnosed_is_refused_in_one_line() {
    let folder = Folder::new("diagnose-refused");
    let good = good_csv(400);
    folder.write("good.csv", &good);
    let scaled = |factor: f64| {
        let displacement = column(&good, "displacement_um");
        let mut lines = good.lines().take(2).map(str::to_owned).collect::<Vec<_>>();
        for (line, y) in good.lines().skip(2).zip(displacement) {
            let head = line.rsplit_once(',').expect("three columns").0;
            lines.push(format!("{head},{:.6}", factor * y));
        }
        lines.join("\n")
    };
    folder.write("nanometres.csv", scaled(1e3));
    folder.write("inverted.csv", scaled(-1.0));
    folder.write("short.csv", good_csv(40));
    folder.write("asks.csv", format!("# run_in_s: 0.3\n{good}"));
    let still: Vec<String> =
        (0..400).map(|row| format!("{:.3},0,{:.6}", f64::from(row) / 1e3, 0.01 * f64::from(row % 7))).collect();
    folder.write("still.csv", format!("time_s,command_V,displacement_um\n{}", still.join("\n")));
    folder.write("file", "");
    for (call, code, line) in [
        ("--plant @/none.toml @/good.csv --out @/out", 3, "none.toml: cannot be read"),
        ("--plant P @/good.csv @/nanometres.csv --out @/out", 3, "the logs disagree in units or sign"),
        ("--plant P @/good.csv @/inverted.csv --out @/out", 3, "the logs disagree in units or sign"),
        ("--plant P @/nanometres.csv --out @/out", 3, "nanometres.csv moves 1194 times as far as the plant"),
        ("--plant P @/inverted.csv --out @/out", 3, "turn their sign with --scale"),
        ("--plant P @/still.csv --out @/out", 3, "still.csv: the command never changes"),
        ("--plant P @/short.csv --out @/out", 3, "short.csv: 40 rows are left after a run-in of 0 s"),
        ("--plant P @/good.csv --run-in 0.3 --out @/out", 2, "good.csv: 100 rows are left after a run-in of 0.3 s"),
        ("--plant P @/asks.csv --out @/out", 3, "asks.csv: 100 rows are left after a run-in of 0.3 s that it states"),
        ("--plant P @/good.csv --without crep --out @/out", 2, "did you mean \"creep\""),
        ("--plant P @/good.csv --controller controllers/pi1.toml --reference hop:1um --out @/out", 2, "unknown kind"),
        ("--plant P @/good.csv --controller controllers/pi1.toml --reference file:@/no --out @/out", 3, "be read:"),
        ("--plant P @/good.csv --out @/file", 2, "is not a directory; name one with --out"),
        ("--plant P @/good.csv --out @/none/out", 2, "is not there; make it or name another with --out"),
        ("--plant P --out @/out", 2, "hysteron diagnose --help"),
    ] {
        let output = run(
            &folder,
            &format!(
                "diagnose {}",
                call.replace("P @", &format!("{PLANT} @")).replace("P --out", &format!("{PLANT} --out"))
            ),
        );
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {said}");
        assert!(said.starts_with("hysteron: ") && said.lines().count() == 1 && said.contains(line), "{call}: {said}");
        assert_eq!(stdout(&output), "", "{call}");
        assert!(!folder.path("out").exists(), "{call}: a directory is left");
    }
}
