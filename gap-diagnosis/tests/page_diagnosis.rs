//! The diagnosis page: it shows all it is given, escapes it, fetches nothing, stays below 3 MB, and draws in a real browser.

use crate::common::{HOSTILE, assert_fetches_nothing, attribute, dom_after, drawings};
use gap_diagnosis::locate::{Trace, Where, locate};
use gap_diagnosis::page::{
    Axis, BarItem, BarList, ChangedView, ClassView, DiagnosedLog, DiagnosisView, EffectView, EstimateView, GapView,
    HeatMap, HeatScale, Ink, Kept, ModelResponse, NextView, Page, RankView, ResponseView, RivalView, ShareView, Strip,
    UnexplainedView, diagnosis_page,
};

/// A log of `n` samples at 20 kHz, rough enough that thinning can't make it small.
fn log(name: &str, n: usize, is_held_out: bool) -> DiagnosedLog {
    let time_s: Vec<f64> = (0..n).map(|k| k as f64 * 5e-5).collect();
    let drive_v: Vec<f64> = time_s.iter().map(|t| 60.0 * (60.0 * t).sin()).collect();
    let rough = |k: usize| (k as f64 * 0.618_034).fract() - 0.5;
    let nominal_um: Vec<f64> = drive_v.iter().map(|v| 1.3 * v).collect();
    DiagnosedLog {
        name: name.to_owned(),
        is_held_out,
        kept: Kept::all(n),
        measured_um: drive_v.iter().enumerate().map(|(k, v)| 1.4 * v + 0.05 * rough(k)).collect(),
        refit_um: drive_v.iter().map(|v| 1.39 * v).collect(),
        augmented_um: drive_v.iter().map(|v| 1.4 * v).collect(),
        noise_um: 0.015,
        scored_from: 0,
        nominal_um,
        time_s,
        drive_v,
    }
}

fn located(logs: &[DiagnosedLog]) -> Where {
    let columns: Vec<[Vec<f64>; 2]> = logs
        .iter()
        .map(|log| {
            let residual_m = log.measured_um.iter().zip(&log.nominal_um).map(|(y, p)| 1e-6 * (y - p)).collect();
            [log.nominal_um.iter().map(|um| 1e-6 * um).collect(), residual_m]
        })
        .collect();
    let traces: Vec<Trace<'_>> = logs
        .iter()
        .zip(&columns)
        .map(|(log, [displacement_m, residual_m])| Trace {
            name: &log.name,
            dt_s: 5e-5,
            drive_v: &log.drive_v,
            displacement_m,
            residual_m,
            noise_m: 1e-6 * log.noise_um,
        })
        .collect();
    locate(&traces)
}

/// Every field filled; every text is `text`.
fn view(text: &str, logs: Vec<DiagnosedLog>) -> DiagnosisView {
    let owned = || text.to_owned();
    let frequency_hz: Vec<f64> = (1..200).map(f64::from).collect();
    let falling: Vec<f64> = frequency_hz.iter().map(|f| 1.0 / f).collect();
    DiagnosisView {
        title: owned(),
        subtitle: owned(),
        verdict: owned(),
        warnings: vec![owned()],
        gap: GapView {
            headline: owned(),
            nominal_rms_um: 4.2,
            refit_rms_um: 0.5,
            augmented_rms_um: 0.02,
            noise_rms_um: 0.015,
            shrink_percent: 99.5,
            shrink_percent_ci95: [99.1, 99.7],
            closure_percent: 99.7,
        },
        facts: vec![(owned(), owned())],
        ranking: vec![
            RankView { effect: owned(), note: owned(), probability: 0.03 },
            RankView { effect: "creep".to_owned(), note: String::new(), probability: 0.97 },
            RankView { effect: "mains_hum".to_owned(), note: String::new(), probability: 1e-9 },
        ],
        set90: vec![owned()],
        classes: vec![ClassView { effects: vec![owned(), owned()], reason: owned() }],
        effects: vec![EffectView {
            effect: owned(),
            summary: owned(),
            equation: owned(),
            signature: owned(),
            source: owned(),
            parameters: vec![EstimateView { name: owned(), value: 0.0123, sigma: 0.0004, unit: owned() }],
        }],
        shares: vec![ShareView { name: owned(), percent: 61.0 }],
        changed: vec![ChangedView { name: owned(), unit: owned(), nominal: 2.5e5, refit: 2.6e5, sigma: 1e3 }],
        next: NextView { spec: Some(owned()), rate_hz: 20_000.0, splits: vec![owned(), owned()], reason: owned() },
        location: Some(located(&logs)),
        location_after: Some(located(&logs)),
        logs,
        responses: vec![ResponseView {
            title: owned(),
            caption: owned(),
            measured_um_per_v: falling.clone(),
            measured_deg: falling.clone(),
            models: vec![ModelResponse {
                name: "nominal",
                ink: Ink::Error,
                gain_um_per_v: falling.clone(),
                phase_deg: falling.clone(),
            }],
            noise_um_per_v: falling.clone(),
            coherence: falling,
            frequency_hz,
            ..ResponseView::default()
        }],
        rivals: vec![RivalView {
            effect: owned(),
            rms_over_noise: 3.2,
            prior_cost: 81.0,
            probability: 0.03,
            reason: owned(),
        }],
        screened: vec![(owned(), 1.5)],
        unexplained: Some(UnexplainedView {
            rms_um: 0.01,
            structured_share_percent: 12.0,
            max_abs_autocorrelation: 0.3,
            lag_s: 1e-3,
            strongest: owned(),
        }),
        provenance: vec![owned()],
    }
}

#[test]
fn everything_is_on_the_page() {
    let html = diagnosis_page(&view("some text", vec![log("a.csv", 8000, false), log("b.csv", 8000, true)])).to_html();
    assert_fetches_nothing(&html);
    for text in [
        "99.5 % [99.1, 99.7]",
        "4.200 µm",
        "b.csv, never fitted",
        "<th scope=\"row\">creep</th>",
        "1 others",
        "90 % of the probability is held by some text.",
        "± 0.00040 some text",
        "At 20\u{202f}000 Hz. It tells some text and some text apart.",
        "+10.0",
        "or named as wrong; the others moved less",
        "over drive and drive rate",
        "Harmonics of the residual",
        "81.00",
        "It lives here: some text.",
    ] {
        assert!(html.contains(text), "{text}");
    }
    // Three charts per log and three of the response; of the gap's square 4.2^2, 0.5^2 is left after the refit: 1.4 %.
    assert_eq!(drawings(&html).len(), 9);
    assert!(html.contains("(99 %)") && html.contains("(1.4 %)"), "the gap as a bar");
}

#[test]
fn hostile_names_stay_text() {
    let html = diagnosis_page(&view(HOSTILE, vec![log(HOSTILE, 3000, true)])).to_html();
    assert_fetches_nothing(&html);
    assert!(!html.contains("<img") && !html.contains("<script>"));
    let axis = || Axis::new(HOSTILE, HOSTILE);
    let mut page = Page::new("");
    page.heat_maps(&[HeatMap {
        title: HOSTILE.to_owned(),
        caption: HOSTILE.to_owned(),
        x: axis(),
        y: axis(),
        x_edges: vec![0.0, 1.0],
        y_edges: vec![0.0, 1.0],
        values: vec![-0.3],
        quantity: HOSTILE.to_owned(),
        unit: HOSTILE.to_owned(),
        scale: HeatScale::Diverging,
        limit: None,
    }])
    .strips(
        HOSTILE,
        HOSTILE,
        &[Strip {
            label: HOSTILE.to_owned(),
            note: HOSTILE.to_owned(),
            values: vec![1.0],
            readings: vec![HOSTILE.to_owned()],
        }],
    )
    .bar_lists(&[BarList {
        title: HOSTILE.to_owned(),
        caption: HOSTILE.to_owned(),
        ink: Ink::Error,
        full_percent: None,
        items: vec![BarItem {
            label: HOSTILE.to_owned(),
            percent: 5.0,
            behind_percent: Some(7.0),
            note: HOSTILE.to_owned(),
        }],
    }]);
    let html = page.to_html();
    assert_fetches_nothing(&html);
    assert!(!html.contains("<img") && !html.contains("<script>"));
}

#[test]
fn five_logs_of_eleven_seconds_stay_below_three_megabytes() {
    let logs = [20_000, 44_000, 20_000, 110_000, 26_000].map(|n| log("log.csv", n, false));
    let html = diagnosis_page(&view("text", logs.into())).to_html();
    assert!((500_000..3_000_000).contains(&html.len()), "{}", html.len());
}

#[test]
fn a_log_of_which_the_page_has_a_part_is_said_to_be() {
    let long = |stride: usize| DiagnosedLog { kept: Kept { rows: 1_200_000, stride }, ..log("long.csv", 8000, false) };
    let told = |html: &str| {
        ["8\u{202f}000 samples", "every peak is kept", "one in 3", "1\u{202f}200\u{202f}000 samples"]
            .map(|t| html.contains(t))
    };
    let of = |log: DiagnosedLog| DiagnosisView { logs: vec![log], ..DiagnosisView::default() };
    let html = diagnosis_page(&of(long(3))).to_html();
    assert_eq!(told(&html), [false, false, true, true]);
    // Under three charts and in the table of logs.
    assert_eq!(html.matches("1\u{202f}200\u{202f}000").count(), 4);
    let whole = diagnosis_page(&of(log("short.csv", 8000, false))).to_html();
    assert_eq!(told(&whole), [true, true, false, false]);
}

#[test]
fn an_empty_view_still_gives_a_page() {
    let html = diagnosis_page(&DiagnosisView { title: "nothing".to_owned(), ..DiagnosisView::default() }).to_html();
    assert_fetches_nothing(&html);
    assert!(drawings(&html).is_empty());
    let nothing_left = DiagnosisView {
        location: Some(locate(&[])),
        logs: vec![DiagnosedLog::default()],
        responses: vec![ResponseView::default()],
        next: NextView { reason: "nothing to split".to_owned(), ..NextView::default() },
        ..DiagnosisView::default()
    };
    let html = diagnosis_page(&nothing_left).to_html();
    assert!(html.contains("No further experiment: nothing to split"));
    assert_fetches_nothing(&html);
}

#[test]
fn the_browser_draws_it_without_a_word_and_without_sideways_scrolling() {
    let page = diagnosis_page(&view(HOSTILE, vec![log(HOSTILE, 3000, true), log("b.csv", 3000, false)]));
    let n_charts = page.to_html().matches("<figure class=\"chart").count();
    let Some(dom) = dom_after("diagnosis", &page, 1280, "") else {
        return;
    };
    assert_eq!(dom.matches("data-drawn=\"true\"").count(), n_charts);
    assert!(!dom.contains("data-hacked"), "a name was run as script");
    let script = "const page = document.documentElement;
                  parent.postMessage(`${innerWidth} wide, ${page.scrollWidth - page.clientWidth} over`, '*');";
    for width in [420, 1280] {
        let Some(dom) = dom_after("diagnosis-narrow", &page, width, script) else {
            return;
        };
        assert_eq!(attribute(&dom, "data-heard"), format!("{width} wide, 0 over"));
    }
}
