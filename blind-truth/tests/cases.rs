//! Whole cases through the public interface: every effect in every split, and what a case promises to be.

use blind_truth::{
    Case, EffectId, ForeignKind, Record, Request, Size, Split, Subject, forms, make, run, run_monitored,
};
use rayon::prelude::*;
use std::collections::BTreeSet;

const SPLITS: [Split; 3] = [Split::Develop, Split::Calibrate, Split::Report];

fn short(seed: u64, subject: Subject, split: Split) -> Case {
    make(&Request { seed, subject, split, size: Size::Short, strength: None })
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(n)).sqrt()
}

fn records(case: &Case) -> impl Iterator<Item = &Record> {
    case.logs.iter().chain(&case.held_out)
}

fn parameter(case: &Case, ending: &str) -> Option<f64> {
    case.truth.parameters.iter().find(|(name, _)| name.ends_with(ending)).map(|(_, value)| *value)
}

/// What must hold of any case: complete logs, finite numbers, a bender that survives.
fn assert_sane(case: &Case) {
    let form = &case.truth.form;
    assert_eq!((case.logs.len(), case.held_out.len()), (5, 2));
    for record in records(case) {
        assert_eq!(record.command_v.len(), record.displacement_um.len());
        assert!(record.command_v.len() > 2_500, "{form}: {}", record.name);
        let top =
            record.displacement_um.iter().fold(0.0, |top: f64, y| if y.is_finite() { top.max(y.abs()) } else { 1e9 });
        assert!(top < 200.0, "{form}: {} reaches {top} um", record.name);
        assert!(record.command_v.iter().all(|v| v.abs() <= 90.0), "{form}: {}", record.name);
    }
    let seconds: f64 = case.logs.iter().map(Record::seconds).sum();
    assert!((3.0..4.5).contains(&seconds), "{seconds} s");
}

#[test]
fn every_effect_in_every_split_is_sane_and_visible() {
    let wanted: Vec<(EffectId, Split)> =
        SPLITS.iter().flat_map(|split| EffectId::all().map(|id| (id, *split))).collect();
    let off_target: Vec<String> = wanted
        .into_par_iter()
        .filter_map(|(effect, split)| {
            let case = short(11, Subject::Effects(vec![effect]), split);
            assert_sane(&case);
            let (gap, form) = (case.truth.gap_over_noise, &case.truth.form);
            assert_eq!(case.truth.effects, [effect]);
            assert!(form.starts_with(effect.id()));
            // The narrowest band starts at 1.5 (noise excess); sizes that are drawn, not sought, may be larger than 60.
            assert!(gap > 1.2, "{form} in {split:?}: {gap}");
            let aimed = parameter(&case, "aimed_gap_over_noise")?;
            let miss = gap / aimed;
            (!(0.75..1.33).contains(&miss)).then(|| format!("{form} in {split:?}: {gap} for {aimed}"))
        })
        .collect();
    // A size stops at what is physically sane, and a few effects are random themselves; most must hit their aim.
    assert!(off_target.len() <= 9, "{off_target:#?}");
}

#[test]
fn every_foreign_kind_is_sane_and_visible() {
    ForeignKind::ALL.into_par_iter().for_each(|kind| {
        let case = short(12, Subject::Foreign(kind), Split::Calibrate);
        assert_sane(&case);
        assert_eq!((case.truth.foreign, case.truth.effects.len()), (Some(kind), 0));
        assert!(case.truth.gap_over_noise > 2.0, "{}: {}", kind.id(), case.truth.gap_over_noise);
    });
}

#[test]
fn a_null_has_no_gap_and_the_noise_it_claims() {
    for split in SPLITS {
        let case = short(3, Subject::Null, split);
        assert_sane(&case);
        assert_eq!(case.truth.gap_over_noise, 0.0);
        assert_eq!(case.truth.form, "");
        // The first 30 ms of the hold are at rest: 300 or 600 rows, so white noise reads within 4 % (1 sigma),
        // coloured noise, with fewer independent rows, within some more.
        let hold = case.logs.iter().find(|log| log.name.contains("hold")).unwrap();
        let rest = &hold.displacement_um[..(0.029 * hold.rate_hz) as usize];
        let mean = rest.iter().sum::<f64>() / rest.len() as f64;
        let ratio = rms(rest.iter().map(|y| y - mean)) / case.truth.noise_um;
        assert!((0.8..1.2).contains(&ratio), "{split:?}: {ratio}");
    }
}

#[test]
fn pairs_hold_both() {
    let pair = vec![EffectId::Creep, EffectId::TransportDelay];
    let case = short(5, Subject::Effects(pair.clone()), Split::Report);
    assert_sane(&case);
    assert_eq!(case.truth.effects, pair);
    assert!(case.truth.form.contains(" + "));
    assert!(case.truth.gap_over_noise > 4.0, "{}", case.truth.gap_over_noise);
}

#[test]
fn strength_sets_the_gap() {
    for strength in [8.0, 40.0] {
        let subject = Subject::Effects(vec![EffectId::NonlinearStiffness]);
        let request = Request { seed: 2, subject, split: Split::Develop, size: Size::Short, strength: Some(strength) };
        let gap = make(&request).truth.gap_over_noise;
        // The search stops at 15 % and steps coarser than the record.
        assert!((gap / strength - 1.0).abs() < 0.2, "{gap} for {strength}");
    }
}

#[test]
fn a_request_makes_one_case_and_another_seed_another() {
    let subject = Subject::Effects(vec![EffectId::LostSamples]);
    let (a, b) = (short(1, subject.clone(), Split::Report), short(1, subject.clone(), Split::Report));
    assert_eq!((&a.logs, &a.held_out, &a.truth, &a.id), (&b.logs, &b.held_out, &b.truth, &b.id));
    let other = short(2, subject, Split::Report);
    assert_ne!(a.id, other.id);
    assert_ne!(a.truth.noise_um, other.truth.noise_um);
}

#[test]
fn an_identifier_says_nothing_of_the_truth() {
    let case = short(1, Subject::Effects(vec![EffectId::Backlash]), Split::Calibrate);
    assert!(EffectId::all().all(|effect| !case.id.contains(effect.id())));
    assert!(records(&case).all(|log| log.name.starts_with("log") || log.name.starts_with("held-out-")));
}

#[test]
fn forms_differ_between_splits() {
    let table: Vec<_> = forms().collect();
    let shown = |effect: EffectId, split: Split| -> BTreeSet<&str> {
        let fits = table.iter().filter(|form| form.effect == effect && form.splits.contains(&split));
        fits.map(|form| form.name).collect()
    };
    let (mut with_own, mut own_only, mut n_report, mut n_shared) = (0, 0, 0, 0);
    for effect in EffectId::all() {
        let names: Vec<_> = table.iter().filter(|form| form.effect == effect).map(|form| form.name).collect();
        assert_eq!(names.len(), names.iter().collect::<BTreeSet<_>>().len(), "{} has a name twice", effect.id());
        assert!(names.len() >= 2, "{}", effect.id());
        let [develop, calibrate, report] = SPLITS.map(|split| shown(effect, split));
        assert!(!develop.is_empty() && !calibrate.is_empty() && !report.is_empty(), "{}", effect.id());
        assert!(report.iter().any(|name| !develop.contains(name)), "{} reports nothing new", effect.id());
        assert_ne!(calibrate, report, "{}", effect.id());
        let shared = report.iter().filter(|name| develop.contains(*name) || calibrate.contains(*name)).count();
        with_own += usize::from(shared < report.len());
        own_only += usize::from(shared == 0);
        n_report += report.len();
        n_shared += shared;
    }
    // What the documentation of `Split` says.
    assert_eq!((EffectId::all().count(), with_own, own_only), (31, 30, 14));
    assert_eq!((n_report, n_shared), (60, 18));
}

#[test]
fn a_foreign_kind_has_one_form_in_every_split() {
    let kind = ForeignKind::MultiplicativeNoise;
    let told = SPLITS.map(|split| {
        let truth = short(12, Subject::Foreign(kind), split).truth;
        let names: Vec<String> = truth.parameters.into_iter().map(|(name, _)| name).collect();
        (truth.form, names)
    });
    assert!(told.iter().all(|one| one == &told[0] && one.0 == format!("foreign: {}", kind.id())), "{told:?}");
}

#[test]
fn a_split_draws_all_of_its_forms() {
    let subject = || Subject::Effects(vec![EffectId::CoulombFriction]);
    let mut seen = BTreeSet::new();
    let complete = (0..8).find(|seed| {
        seen.insert(short(*seed, subject(), Split::Report).truth.form);
        seen.len() == 2
    });
    assert!(complete.is_some(), "{seen:?}");
}

#[test]
fn csv_is_what_the_contract_says() {
    let case = short(4, Subject::Effects(vec![EffectId::MainsHum]), Split::Calibrate);
    for record in records(&case) {
        let text = record.to_csv();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some(format!("# rate_hz: {}", record.rate_hz).as_str()));
        assert_eq!(lines.next(), Some("# latency_us: 10"));
        let mut header = String::from("time_s,command_V,displacement_um");
        if record.reference_um.is_some() {
            header += ",reference_um";
        }
        assert_eq!(lines.next(), Some(header.as_str()));
        let mut n_rows = 0;
        for (k, line) in lines.enumerate() {
            let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            // Six decimals of a second; volts are exact in the file, displacement to half a picometre.
            assert!((row[0] - k as f64 / record.rate_hz).abs() < 1e-9);
            assert!((row[1] - record.command_v[k]).abs() < 1e-9, "{}", record.name);
            assert!((row[2] - record.displacement_um[k]).abs() < 0.6e-6);
            n_rows += 1;
        }
        assert_eq!(n_rows, record.command_v.len());
    }
    assert_eq!(case.logs.iter().filter(|log| log.reference_um.is_some()).count(), 1);
}

#[test]
fn plant_file_has_the_keys_of_the_thesis_model() {
    let case = short(4, Subject::Null, Split::Develop);
    // Both files name their numbers alike; the made one adds the sensor.
    let keys = |text: &str| -> Vec<String> {
        let lines = text.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
        lines.map(|line| line.split('=').next().unwrap_or(line).trim().to_owned()).collect()
    };
    let mut made = keys(&case.plant_toml);
    made.retain(|key| key != "[sensor]" && key != "noise_um");
    assert_eq!(made, keys(include_str!("../../models/thesis-phs.toml")));
    assert!(case.plant_toml.contains(&format!("noise_um = {{ value = {:.6}", case.truth.noise_um)));
}

#[test]
fn the_bench_plays_further_experiments() {
    let case = short(9, Subject::Effects(vec![EffectId::AmplifierGain]), Split::Develop);
    let mut command_v = vec![0.0; 400];
    command_v.extend([30.0; 1_600]);
    let again = run(&case.bench, &command_v, 40_000.0, 1);
    assert_eq!(again, run(&case.bench, &command_v, 40_000.0, 1));
    assert_eq!(again.rate_hz, 40_000.0);
    // The monitor shows the amplifier's error itself.
    let monitored = run_monitored(&case.bench, &command_v, 40_000.0, 1);
    assert_eq!(monitored.displacement_um, again.displacement_um);
    let gain = 1.0 + parameter(&case, ".sign").unwrap() * parameter(&case, "gain_error").unwrap();
    assert!((monitored.drive_v.unwrap()[1_900] / 30.0 - gain).abs() < 1e-12);
}
