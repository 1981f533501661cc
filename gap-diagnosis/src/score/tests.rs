//! Whole scores of a handful of cases, by hand.

use super::case::*;
use super::*;

/// An answer from its verdict's name, probabilities and classes.
fn answer(effects: &[&str], ranking: &[(&str, f64)], set90: &[&str], classes: &[&[&str]]) -> Answer {
    let verdict = match effects {
        [NO_GAP] => "no_gap",
        [UNKNOWN] => "unknown",
        _ => "explained",
    };
    let ranking: Vec<_> =
        ranking.iter().map(|(effect, p)| serde_json::json!({ "effect": effect, "probability": p })).collect();
    let effects: &[&str] = if verdict == "explained" { effects } else { &[] };
    let text = serde_json::json!({
        "schema": "hysteron-diagnosis-1", "verdict": verdict, "effects": effects, "stage": null, "ranking": ranking,
        "set90": set90, "classes": classes,
        "gap": { "refit_rms_um": 0.1, "augmented_rms_um": 0.011, "closure_percent": 97.0, "shrink_percent": 80.0,
                 "predicted_shrink_percent": 81.0, "predicted_shrink_percent_ci95": [78.0, 82.0] },
        "next_experiment": null,
    });
    Answer::parse(&text.to_string()).unwrap()
}

fn truth(effects: &[&str]) -> Truth {
    let effects = effects.iter().map(|e| (*e).to_owned()).collect();
    Truth { effects, is_textbook_form: true, gap_over_noise: Some(12.0), noise_um: Some(0.01), ..Truth::default() }
}

fn foreign() -> Truth {
    Truth { foreign: Some("preload_gap".into()), ..truth(&[]) }
}

fn case(id: &str, truth: Truth, answer: Answer) -> Case {
    Case { id: id.into(), truth, answer: Ok(answer) }
}

fn sure(name: &str) -> Answer {
    answer(&[name], &[(name, 0.96), ("backlash", 0.04)], &[name], &[])
}

#[test]
fn the_class_rule_needs_class_and_set() {
    let ranking = [("sensor_gain", 0.5), ("amplifier_gain", 0.45), ("creep", 0.05)];
    let class: &[&[&str]] = &[&["sensor_gain", "amplifier_gain"]];
    let both = answer(&["sensor_gain"], &ranking, &["sensor_gain", "amplifier_gain"], class);
    let no_class = answer(&["sensor_gain"], &ranking, &["sensor_gain", "amplifier_gain"], &[]);
    let not_in_set = answer(&["sensor_gain"], &ranking, &["sensor_gain"], class);
    let is_right = |a: &Answer| case("", truth(&["amplifier_gain"]), a.clone()).is_right();
    assert_eq!([&both, &no_class, &not_in_set].map(is_right), [true, false, false]);
    // What is claimed is what would count.
    assert!((both.confidence() - 0.95).abs() < 1e-12);
    assert_eq!((no_class.confidence(), not_in_set.confidence()), (0.5, 0.5));
}

#[test]
fn the_most_probable_name_leads_and_equals_keep_their_order() {
    let lead = |p: f64, q: f64| {
        let both = answer(&["parameter_error", "creep"], &[("creep", p), ("parameter_error", q)], &["creep"], &[]);
        (both.name().to_owned(), both.confidence())
    };
    assert_eq!((lead(0.6, 0.4).0.as_str(), lead(0.4, 0.6).0.as_str()), ("creep", "parameter_error"));
    assert_eq!(lead(0.5, 0.5), ("parameter_error".to_owned(), 1.0));
}

#[test]
fn what_contradicts_itself_is_no_answer() {
    let base = |verdict: &str, effects: &[&str], p: f64| {
        serde_json::json!({ "verdict": verdict, "effects": effects, "set90": ["creep"],
                            "ranking": [{ "effect": "creep", "probability": p }] })
        .to_string()
    };
    assert!(Answer::parse(&base("explained", &["creep"], 1.0)).is_ok());
    for bad in [
        base("explained", &[], 1.0),
        base("unknown", &["creep"], 1.0),
        base("explained", &["creep"], 0.7),
        base("maybe", &["creep"], 1.0),
        "{".to_owned(),
    ] {
        assert!(Answer::parse(&bad).is_err(), "{bad}");
    }
}

#[test]
fn pairs_match_one_to_one() {
    let pair = |named: &[&str], classes: &[&[&str]]| {
        let ranking: Vec<(&str, f64)> = named.iter().map(|n| (*n, 1.0 / named.len() as f64)).collect();
        let set = ["creep", "sensor_gain", "backlash"];
        case("", truth(&["creep", "sensor_gain"]), answer(named, &ranking, &set, classes)).matches()
    };
    assert_eq!(pair(&["creep", "sensor_gain"], &[]), (2, 2, 2));
    assert_eq!(pair(&["creep"], &[]), (1, 1, 2));
    assert_eq!(pair(&["backlash", "creep"], &[]), (1, 2, 2));
    assert_eq!(pair(&["backlash", "creep"], &[&["backlash", "sensor_gain"]]), (2, 2, 2));
    // The exact match comes first: backlash may stand for creep, but creep is there itself.
    assert_eq!(pair(&["backlash", "creep"], &[&["backlash", "creep"]]), (1, 2, 2));
    let silent = Case { answer: Err("killed".into()), ..case("", truth(&["creep", "backlash"]), sure("creep")) };
    assert_eq!(silent.matches(), (0, 0, 2));
}

#[test]
fn three_are_no_more_than_three() {
    // What is named need not be the most probable: then two more come before the rest.
    let ranking = [("backlash", 0.4), ("end_stop", 0.3), ("mains_hum", 0.2), ("creep", 0.1)];
    let of = |effect: &str| {
        names::names(&[case("", truth(&[effect]), answer(&["creep"], &ranking, &["creep"], &[]))]).top3.hits
    };
    assert_eq!(["creep", "backlash", "end_stop", "mains_hum"].map(of), [1, 1, 1, 0]);
}

#[test]
fn an_effect_shows_where_the_refit_leaves_three_times_the_noise() {
    // The answers' refit leaves 0.1 um: 10 times, 3 times and twice the noise, which is taken off first.
    let of = |noise_um: f64, name: &str| {
        let truth = Truth { noise_um: Some(noise_um), stage: Some("structure".into()), ..truth(&["creep"]) };
        case("", truth, sure(name))
    };
    let mut cases = vec![of(0.01, "creep"), of(0.0316, "backlash"), of(0.05, "backlash"), of(0.0317, "backlash")];
    let hits = |cases: &[Case]| {
        let names = names::names(cases);
        [names.shown_top1, names.shown_stage, names.strict_stage].map(|rate| (rate.hits, rate.of))
    };
    // No answer states a stage.
    assert_eq!(hits(&cases), [(1, 2), (1, 2), (0, 4)]);
    // No answer is no excuse.
    cases.push(Case { answer: Err("killed".into()), ..of(0.05, "creep") });
    assert_eq!(hits(&cases), [(1, 3), (1, 3), (0, 5)]);
}

#[test]
fn a_small_run_by_hand() {
    let cases = vec![
        case("1", truth(&["creep"]), sure("creep")),
        case("2", truth(&["creep"]), sure("end_stop")),
        case(
            "3",
            truth(&["backlash"]),
            answer(&["creep"], &[("creep", 0.6), ("backlash", 0.4)], &["creep", "backlash"], &[]),
        ),
        Case { answer: Err("exit code 101".into()), ..case("4", truth(&["backlash"]), sure("creep")) },
        case("5", truth(&[]), sure(NO_GAP)),
        case("6", truth(&[]), sure("creep")),
        case("7", foreign(), sure(UNKNOWN)),
        case("8", foreign(), sure("creep")),
        case("9", truth(&["creep", "end_stop"]), sure("creep")),
    ];
    let score = score(&cases, None, None);
    let hits = |rate: Rate| (rate.hits, rate.of);
    assert_eq!(score.cases, Counts { singles: 4, nulls: 2, pairs: 1, foreign: 2, defects: 1 });
    // Case 2 ranks backlash second, not creep; case 3 has the truth second.
    assert_eq!((hits(score.names.top1), hits(score.names.top3)), ((1, 4), (2, 4)));
    assert_eq!((hits(score.false_alarms), hits(score.falsely_named)), ((1, 2), (1, 2)));
    assert_eq!(hits(score.said_unknown), (1, 2));
    // Cases 2 and 8 of the seven that are no nulls.
    assert_eq!(hits(score.confidently_wrong), (2, 7));
    assert_eq!((hits(score.sets.singles), score.sets.mean_size), ((2, 4), 4.0 / 3.0));
    assert_eq!((hits(score.pairs.precision), hits(score.pairs.recall)), ((1, 1), (1, 2)));
    assert!((score.pairs.f1 - 2.0 / 3.0).abs() < 1e-12);
    // Known: 1, 2, 3 and 9 with no `unknown`, 4 rejected as it never answered. Foreign: 0.96 and 0.
    // Against 0.96: four wins, one loss; against 0: four ties, one loss. Right by name are 1 and 9.
    assert_eq!((score.rejection.auroc, score.rejection.open_auc), (6.0 / 10.0, 3.0 / 10.0));
    assert_eq!(score.closure.median_percent, 97.0);
    assert_eq!((score.closure.median_miss_percent, hits(score.closure.inside_ci95)), (1.0, (4, 4)));
    assert_eq!((hits(score.closure.within_5_points), hits(score.pairs.both)), ((4, 4), (0, 1)));
    // Eight answers: seven at 0.96, of which 1, 5, 7 and 9 are right; one at 0.6, wrong.
    let off = (7.0 * (0.96 - 4.0 / 7.0) + 0.6) / 8.0;
    assert!((score.calibration.expected_error - off).abs() < 1e-12);
    let row = |truth: &str| {
        let at = score.confusion.truths.iter().position(|t| t == truth).unwrap();
        let row = score.confusion.answers.iter().zip(&score.confusion.counts[at]);
        row.filter(|(_, n)| **n > 0).map(|(a, n)| format!("{a}:{n}")).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(row("creep"), "creep:1 end_stop:1");
    assert_eq!(row("backlash"), "creep:1 defect:1");
    assert_eq!((row("null"), row("foreign")), ("creep:1 no_gap:1".into(), "creep:1 unknown:1".into()));
    let cause = |id: &str| score.failures.iter().find(|f| f.id == id).map(|f| f.cause);
    assert_eq!(
        ["1", "2", "3", "4", "6"].map(cause).map(|c| c.map(Cause::words)),
        [None, Some("defect"), Some("indistinguishable on this excitation"), Some("defect"), Some("defect"),]
    );
    assert_eq!(cause("9"), Some(Cause::Defect));
    assert_eq!(
        score.bars.iter().filter(|bar| bar.is_met).map(|bar| bar.name).collect::<Vec<_>>(),
        ["mean size of the 90 % sets", "median closure"]
    );
    assert!(by_hand(&score).contains("<a href=\"cases/2/report.html\">2</a>"));
}

/// The page of a score, every case with a report of its own.
fn by_hand(score: &Score) -> String {
    let view = PageView {
        title: "Blind check",
        subtitle: "by hand",
        score,
        report: &|id| format!("cases/{id}/report.html"),
        facts: &[],
        warnings: &[],
        provenance: &[],
    };
    score_page(&view).to_html()
}

#[test]
fn what_nobody_knows_of_a_real_bench_is_not_stated() {
    let told = |is_known: bool| {
        let of = |name: &str| {
            let known = Truth { stage: Some("structure".into()), ..truth(&["creep"]) };
            let measured = Truth { gap_over_noise: None, noise_um: None, ..known.clone() };
            case("", if is_known { known } else { measured }, sure(name))
        };
        let score = score(&[of("end_stop"), of("backlash")], None, None);
        let html = by_hand(&score);
        let texts = [
            "%, never",
            "gap over noise from which",
            "leaves 3 times the noise",
            "right stage there",
            "by gap over noise",
        ];
        (score.names.shown_top1.of, texts.map(|text| html.contains(text)))
    };
    assert_eq!(told(true), (2, [true; 5]));
    assert_eq!(told(false), (0, [false; 5]));
}

#[test]
fn causes_in_their_order() {
    let wrong_of = |effect: &str, gap_um: f64, is_textbook_form: bool| {
        let mut said = answer(&["creep"], &[("creep", 1.0)], &["creep"], &[]);
        said.gap.refit_rms_um = Some(gap_um);
        failure::failures(&[case("", Truth { is_textbook_form, ..truth(&[effect]) }, said)])[0].cause
    };
    let wrong = |gap_um, is_textbook_form| wrong_of("end_stop", gap_um, is_textbook_form);
    // The noise is 0.01: 0.014 is 0.98 of it beyond the noise, 0.0142 is 1.008.
    assert_eq!(wrong(0.014, false), Cause::BelowNoise);
    assert_eq!(wrong(0.0142, false), Cause::WrongForm);
    assert_eq!(wrong(0.0142, true), Cause::Defect);
    // What the numbers take for themselves is no smaller for it, a zero that the file states among them.
    for effect in ["payload_mass", "sensor_gain", "sensor_offset", "asymmetric_hysteresis"] {
        assert_eq!(wrong_of(effect, 0.014, true), Cause::Defect, "{effect}");
    }
}

#[test]
fn the_frontier_is_where_three_of_four_are_found_from_there_on() {
    let at = |ratio: f64, is_right: bool| {
        let truth = Truth { gap_over_noise: Some(ratio), ..truth(&["creep"]) };
        case("", truth, sure(if is_right { "creep" } else { "end_stop" }))
    };
    let from = |cases: &[Case]| names::names(cases).recall[0].detectable_from;
    assert_eq!(from(&[at(4.0, false), at(6.0, true), at(7.0, true), at(30.0, true)]), Some(5.0));
    // A lucky small one does not count while larger ones are missed.
    assert_eq!(from(&[at(4.0, true), at(6.0, false), at(7.0, false), at(30.0, true)]), Some(20.0));
    assert_eq!(from(&[at(4.0, false)]), None);
    let cases = [at(4.0, true), at(4.5, false), at(30.0, true)];
    let bins: Vec<_> =
        names::names(&cases).recall[0].by_ratio.iter().map(|bin| (bin.from, bin.right.hits, bin.right.of)).collect();
    assert_eq!(bins, [(3.0, 1, 2), (20.0, 1, 1)]);
    assert!(by_hand(&score(&cases, None, None)).contains(">1/2</td>"));
}

#[test]
fn second_diagnoses_by_hand() {
    let leaving = |name: &str, left_um: f64| {
        let mut said = sure(name);
        said.gap.augmented_rms_um = Some(left_um);
        case("", truth(&["end_stop"]), said)
    };
    let fitted = |name: &str, left_um: f64, rms_over_noise: f64| {
        let mut case = leaving(name, left_um);
        case.answer.as_mut().unwrap().best_fit = Some(BestFit { rms_over_noise });
        case
    };
    let mut noisy = fitted("creep", 0.02, 1.0);
    noisy.answer.as_mut().unwrap().gap.noise_rms_um = Some(0.02);
    // The noise is 0.01 um, whatever passes for it: 0.02 is not absorbed, 0.011 is. Where a best fit is stated that counts, whatever the answer leaves.
    let found = left_out(
        &[
            leaving(UNKNOWN, 0.02),
            leaving("creep", 0.02),
            leaving("creep", 0.011),
            fitted(UNKNOWN, 0.02, 1.1),
            fitted("creep", 0.011, 1.6),
            noisy,
            Case { answer: Err("exit code 4".into()), ..leaving(UNKNOWN, 0.02) },
        ],
        9,
    );
    assert_eq!((found.said_unknown.hits, found.said_unknown.of), (1, 5));
    assert_eq!((found.confidently_wrong.hits, found.confidently_wrong.of), (3, 4));
    let absorbed =
        [("creep", 1), (UNKNOWN, 1)].map(|(answer, count)| ("end_stop".to_owned(), answer.to_owned(), count));
    assert_eq!(found.absorbed, absorbed);
    assert_eq!((found.made, found.of, found.defects, found.without_best_fit), (7, 9, 1, 3));
    let html = by_hand(&score(&[], Some(found), None));
    assert!(html.contains("7 of 9 cases with one effect") && html.contains("3 answers state no best fit"));

    let wide = answer(&["creep"], &[("creep", 0.5), ("end_stop", 0.5)], &["creep", "end_stop"], &[]);
    let before = case("", truth(&["end_stop"]), wide);
    let tried = |then: Then| Tried { before: &before, then };
    let failed = Case { answer: Err("exit code 4".into()), ..before.clone() };
    let made = Then::Made(Box::new(leaving("end_stop", 0.0)));
    let found = active(&[tried(made), tried(Then::NoCommand), tried(Then::Made(Box::new(failed))), tried(Then::Open)]);
    assert_eq!((found.made, found.no_command, found.failed, found.open), (1, 1, 1, 1));
    assert_eq!(found.mean_size, [2.0, 1.0]);
    assert_eq!((found.right[0].hits, found.right[1].hits, found.covered.hits), (0, 1, 1));
}

#[test]
fn numbers_are_compared_where_the_true_form_was_fitted() {
    let of = |form: &str, size: f64, found: &[(&str, f64)]| {
        let effect = form.split(':').next().unwrap();
        let parameters =
            [("backlash.half_width_m", size), ("sensor_gain.gain_error", size), ("sensor_gain.sign", -1.0)];
        let parameters = parameters.map(|(key, value)| (key.to_owned(), value)).to_vec();
        let mut said = sure(effect);
        let estimate = |(name, value): &(&str, f64)| Estimate {
            effect: effect.to_owned(),
            name: (*name).to_owned(),
            value: *value,
            sigma: Some(0.1),
        };
        said.parameters = found.iter().map(estimate).collect();
        case(form, Truth { form: form.to_owned(), parameters, ..truth(&[effect]) }, said)
    };
    let mut unsure = of("backlash: play", 2.0, &[("play_m", 9.0)]);
    unsure.answer.as_mut().unwrap().parameters[0].sigma = None;
    let all = [
        // How far off is not known.
        unsure,
        // Twice 2 is 4, 1.9 sigma off; then 2.1.
        of("backlash: play", 2.0, &[("play_m", 4.19)]),
        of("backlash: play", 2.0, &[("play_m", 3.79)]),
        // Another form was fitted, and another one is so.
        of("backlash: play", 2.0, &[("play_m", 9.0), ("spread", 0.5)]),
        of("backlash: play worn at one end", 2.0, &[("play_m", 9.0)]),
        of("sensor_gain: constant", 0.5, &[("relative_gain", -0.5)]),
        of("sensor_gain: constant", 0.5, &[("relative_gain", 0.5)]),
    ];
    let found = numbers::numbers(&all);
    assert_eq!((found.inside_ci95.hits, found.inside_ci95.of), (2, 4));
    let outside: Vec<(&str, f64)> = found.outside.iter().map(|o| (o.name.as_str(), o.deviation().round())).collect();
    assert_eq!(outside, [("relative_gain", 10.0), ("play_m", -2.0)]);
    let unknown: Estimate = serde_json::from_str(r#"{"effect":"creep","name":"a","value":1.0,"sigma":null}"#).unwrap();
    assert_eq!(unknown.sigma, None);
    let page = score_page(&PageView {
        title: "Blind check",
        subtitle: "by hand",
        score: &score(&all, None, None),
        report: &|id| format!("{}.html", id.split(':').next().unwrap()),
        facts: &[],
        warnings: &[],
        provenance: &[],
    });
    // None of the cases failed, so that nothing but the numbers leads there.
    assert!(page.to_html().contains("<a href=\"sensor_gain.html\">"));
}
