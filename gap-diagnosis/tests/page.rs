//! Whole pages: they fetch nothing, escape what they are given, carry their data and stay small.

use crate::common::{HOSTILE, assert_fetches_nothing, drawings};
use gap_diagnosis::page::{
    Axis, Chart, FittedLog, FittedParameter, IdentifyView, Ink, Kept, Loop, Page, ReplayView, Series, Share,
    SimulationView, StartView, identify_page, replay_page, simulation_page,
};

fn wave(n: usize) -> (Vec<f64>, Vec<f64>) {
    let time_s: Vec<f64> = (0..n).map(|k| k as f64 * 1e-4).collect();
    let wave = time_s.iter().map(|t| 40.0 * (9.0 * t).sin()).collect();
    (time_s, wave)
}

#[test]
fn hostile_names_stay_text_everywhere() {
    let (time_s, values) = wave(50);
    let series = Series { name: HOSTILE, ink: Ink::Model, values: &values };
    let run = Loop { name: HOSTILE, ink: Ink::Model, x: &values, y: &values };
    let axis = || Axis::new(HOSTILE, HOSTILE);
    let mut page = Page::new(HOSTILE);
    page.subtitle(HOSTILE)
        .headline(HOSTILE)
        .warning(HOSTILE)
        .section(HOSTILE)
        .paragraph(HOSTILE)
        .facts(&[(HOSTILE.to_owned(), HOSTILE.to_owned())])
        .table(HOSTILE, &[HOSTILE, HOSTILE], &[vec![HOSTILE.to_owned(), HOSTILE.to_owned()]])
        .bar(HOSTILE, HOSTILE, &[Share { label: HOSTILE, value: 1.0, ink: Ink::Error }])
        .chart(Chart::over_time(HOSTILE, HOSTILE, &time_s, axis(), &[series]).linked(HOSTILE))
        .chart(Chart::loops(HOSTILE, HOSTILE, axis(), axis(), &[run]))
        .chart(Chart::bars_with_band(HOSTILE, HOSTILE, axis(), axis(), &time_s, series, 0.1))
        .provenance(&[HOSTILE.to_owned()]);
    let html = page.to_html();

    assert_fetches_nothing(&html);
    assert!(!html.contains("<img"));
    assert!(!html.contains("<script>"), "every script is either data or bears the nonce");
    // Three data blocks, uPlot, page.js.
    assert_eq!(html.matches("<script").count(), 5);
    assert_eq!(html.matches("</script").count(), 5);
    for drawing in drawings(&html) {
        assert_eq!(drawing["series"][0]["name"], HOSTILE);
    }
}

#[test]
fn simulation_page_closed_and_open_loop() {
    let (time_s, values) = wave(3000);
    let mut view = SimulationView {
        title: "simulation",
        subtitle: "",
        headline: "It follows.",
        time_s: &time_s,
        reference_um: Some(&values),
        displacement_um: &values,
        command_v: &values,
        error_um: None,
        metrics: &[("rise".to_owned(), "43.94 ms".to_owned()), ("peak".to_owned(), "89.66 um".to_owned())],
        warnings: &["limited".to_owned()],
        provenance: &["hysteron simulate --seed 7".to_owned()],
    };
    let closed = simulation_page(&view).to_html();
    assert_fetches_nothing(&closed);
    for text in [
        "It follows.",
        "43.94 ms",
        "89.66 µm",
        "limited",
        "hysteron simulate --seed 7",
        "displacement, µm",
        "command, V",
        "time, s",
    ] {
        assert!(closed.contains(text), "{text}");
    }
    let closed = drawings(&closed);
    assert_eq!(closed.len(), 5);
    // Time charts, and only they, zoom together.
    assert_eq!(closed.iter().filter(|drawing| drawing["link"] == "time").count(), 3);
    assert_eq!(closed[0]["data"][0].as_array().map(Vec::len), Some(3000));
    assert_eq!(closed[0]["data"][1][1234].as_f64().map(|v| v as f32), Some(values[1234] as f32));
    // Reference minus itself.
    assert!(closed[1]["data"][1].as_array().expect("a column").iter().all(|v| v == 0.0));

    view.reference_um = None;
    assert_eq!(drawings(&simulation_page(&view).to_html()).len(), 3);
}

#[test]
fn a_residual_reads_as_the_difference_of_the_curves_above_it() {
    let (time_s, measured) = wave(100_000);
    let predicted: Vec<f64> = measured.iter().enumerate().map(|(k, y)| y - (k as f64 * 0.618_034).fract()).collect();
    let html = replay_page(&ReplayView {
        title: "replay",
        subtitle: "",
        headline: "",
        time_s: &time_s,
        kept: Kept::all(time_s.len()),
        command_v: &predicted,
        measured_um: &measured,
        predicted_um: &predicted,
        autocorrelation: &[],
        n_residuals: 0,
        spectrum: None,
        metrics: &[],
        warnings: &[],
        provenance: &[],
    })
    .to_html();
    assert!(html.contains("100\u{202f}000 samples"));
    let drawings = drawings(&html);
    assert_eq!(drawings[0]["data"][0], drawings[1]["data"][0]);
    let column = |chart: usize, series: usize| drawings[chart]["data"][series].as_array().expect("a column");
    for ((measured, predicted), residual) in column(0, 1).iter().zip(column(0, 2)).zip(column(1, 1)) {
        let number = |value: &serde_json::Value| value.as_f64().expect("a number");
        // Seven digits of 40 µm: rounding by up to 5e-6 in each of the two, hardly any in the residual below 1.
        assert!((number(measured) - number(predicted) - number(residual)).abs() < 1.1e-5);
    }
}

#[test]
fn missing_samples_are_null_and_bounds_are_right() {
    let (time_s, mut values) = wave(10_000);
    let predicted = values.clone();
    values[200] = f64::NAN;
    values[300] = f64::INFINITY;
    let correlation = [1.0, 0.5, 0.01];
    let html = replay_page(&ReplayView {
        title: "replay",
        subtitle: "",
        headline: "",
        time_s: &time_s,
        kept: Kept::all(time_s.len()),
        command_v: &predicted,
        measured_um: &values,
        predicted_um: &predicted,
        autocorrelation: &correlation,
        n_residuals: 10_000,
        spectrum: None,
        metrics: &[],
        warnings: &[],
        provenance: &[],
    })
    .to_html();
    let drawings = drawings(&html);
    assert_eq!(drawings.len(), 4);
    assert!(drawings[0]["data"][1].as_array().expect("measured").iter().any(serde_json::Value::is_null));
    assert!(drawings[0]["data"][2].as_array().expect("predicted").iter().all(serde_json::Value::is_number));
    // 2.58/sqrt(10000); the unit lag is one sample of 0.1 ms.
    assert_eq!(drawings[3]["band"], 0.0258);
    assert_eq!(drawings[3]["data"][0], serde_json::json!([0.1, 0.2]));
    assert_eq!(drawings[3]["data"][1], serde_json::json!([0.5, 0.01]));
}

#[test]
fn lags_are_the_logs_samples_where_the_page_has_a_part_of_its_rows() {
    // Every fourth row of 40 000 at 0.1 ms; the residual is that of all.
    let time_s: Vec<f64> = (0..10_000).map(|k| f64::from(k) * 4e-4).collect();
    let values = vec![1.0; time_s.len()];
    let html = replay_page(&ReplayView {
        time_s: &time_s,
        kept: Kept { rows: 40_000, stride: 4 },
        command_v: &values,
        measured_um: &values,
        predicted_um: &values,
        autocorrelation: &[1.0, 0.5, 0.01],
        n_residuals: 10_000,
        ..ReplayView::default()
    })
    .to_html();
    let lags = drawings(&html)[3]["data"][0].clone();
    assert_eq!(lags, serde_json::json!([0.1, 0.2]));
    assert!(html.contains("40\u{202f}000 samples, of which one in 4") && !html.contains("every peak is kept"));
}

#[test]
fn empty_input_still_gives_a_page() {
    let html = replay_page(&ReplayView {
        title: "nothing",
        subtitle: "",
        headline: "",
        time_s: &[],
        kept: Kept::default(),
        command_v: &[],
        measured_um: &[],
        predicted_um: &[],
        autocorrelation: &[],
        n_residuals: 0,
        spectrum: None,
        metrics: &[],
        warnings: &[],
        provenance: &[],
    })
    .to_html();
    assert_eq!(drawings(&html).len(), 3);
}

#[test]
fn long_runs_and_many_logs_stay_below_a_megabyte_and_a_half() {
    let n = 3_000_000;
    let (time_s, mut values) = wave(n);
    // Noise, so that neither the envelope nor the loop is cheap.
    for (k, value) in values.iter_mut().enumerate() {
        *value += (k as f64 * 0.618_034).fract();
    }
    values[1_999_999] = 777.0;
    let command: Vec<f64> = values.iter().map(|value| 0.7 * value + 1.0).collect();
    let log = |name| FittedLog {
        name,
        time_s: &time_s,
        command_v: &command,
        measured_um: &values,
        predicted_um: &command,
        autocorrelation: &[1.0, 0.1, 0.0],
        n_residuals: n,
        rms_um: 0.1,
        noise_um: 0.02,
        fit_percent: 99.0,
    };
    let html = identify_page(&IdentifyView {
        title: "many logs",
        subtitle: "",
        headline: "",
        logs: &["a", "b", "c", "d", "e"].map(log),
        parameters: &[FittedParameter {
            name: "k0",
            unit: "N/m",
            value: 1.0,
            sigma: None,
            prior: 1.0,
            note: "no excitation",
        }],
        starts: &[StartView { initial_rms_um: 2.0, final_rms_um: 0.1 }],
        orders: &[],
        responses: &[],
        metrics: &[],
        warnings: &[],
        provenance: &[],
    })
    .to_html();
    assert!(html.len() < 1_500_000, "{}", html.len());
    assert!(html.contains("no excitation"));
    let drawings = drawings(&html);
    assert_eq!(drawings.len(), 1 + 5 * 4);
    for overlay in drawings.iter().filter(|drawing| {
        drawing["series"].as_array().is_some_and(|series| series.len() == 2) && drawing["mark"] == "lines"
    }) {
        let measured = overlay["data"][1].as_array().expect("measured");
        assert!(measured.len() >= 400, "{}", measured.len());
        assert!(measured.iter().any(|value| value == 777.0), "the single peak is drawn on every page");
    }
}

#[test]
fn a_page_replaces_its_file_whole_or_not_at_all() {
    let directory = std::env::temp_dir().join(format!("hysteron-page-{}", std::process::id()));
    std::fs::create_dir_all(&directory).expect("temporary directory");
    let path = directory.join("page.html");
    Page::new("first").save(&path).expect("written");
    Page::new("second").save(&path).expect("written again");
    assert!(std::fs::read_to_string(&path).expect("read").contains("<h1>second</h1>"));
    assert_eq!(std::fs::read_dir(&directory).expect("listed").count(), 1, "no partial file is left");

    let missing = directory.join("no such directory").join("page.html");
    assert_eq!(Page::new("x").save(&missing).expect_err("no directory").kind(), std::io::ErrorKind::NotFound);
    // A directory in the way: the rename fails, and what was written beside it goes away again.
    std::fs::create_dir_all(directory.join("taken").join("inside")).expect("created");
    assert!(Page::new("x").save(&directory.join("taken")).is_err());
    assert_eq!(std::fs::read_dir(&directory).expect("listed").count(), 2);
    std::fs::remove_dir_all(&directory).expect("removed");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let (time_s, values) = wave(20_000);
    let page = || {
        let series = [Series { name: "y", ink: Ink::Model, values: &values }];
        let mut page = Page::new("same");
        page.chart(Chart::over_time("y", "", &time_s, Axis::new("y", "µm"), &series));
        page.to_html()
    };
    assert_eq!(page(), page());
}
