//! The page in a real browser: every chart is drawn, no script error, hostile names run nothing, zoom is linked, nothing overflows.
//!
//! Needs chromium. Where there is none the test says "not run" and passes: the other page tests need no browser.

use crate::common::{HOSTILE, attribute, dom_after};
use gap_diagnosis::page::{Axis, Chart, Ink, Kept, Loop, Page, ReplayView, Series, Share, SpectrumView, replay_page};

#[test]
fn every_chart_is_drawn_and_nothing_goes_wrong() {
    let page = page_with_everything();
    let n_charts = page.to_html().matches("<figure class=\"chart").count();
    assert_eq!(n_charts, 12);
    let Some(dom) = dom_after("everything", &page, 1280, "") else {
        return;
    };
    assert_eq!(dom.matches("data-drawn=\"true\"").count(), n_charts);
    assert!(!dom.contains("data-hacked"), "a name was run as script");
    assert_eq!(dom.matches("class=\"empty\"").count(), 2, "the empty charts say so");
}

#[test]
fn zoom_is_linked_and_the_keyboard_works() {
    // What a user does: steps along the first chart, zooms in twice, hides a curve, changes the theme.
    let script = r#"
        const press = (box, key) => box.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        const plots = document.querySelectorAll(".plot"), keys = n => plots[n].parentElement.querySelectorAll(".legend output");
        plots[0].focus();
        for (const key of ["End", "ArrowLeft", "+", "+"]) press(plots[0], key);
        setTimeout(() => {
            document.documentElement.dataset.readings = [keys(0)[0], keys(0)[1], keys(1)[0]].map(key => key.textContent).join("|");
            document.documentElement.dataset.spoken = plots[0].parentElement.querySelector(".spoken").textContent;
            press(plots[2], "ArrowRight");
            document.documentElement.dataset.path = keys(2)[0].textContent;
            document.querySelector("button[data-series]").click();
            document.getElementById("theme").click();
            press(plots[0], "0");
        }, 100);
    "#;
    let Some(dom) = dom_after("keyboard", &page_with_everything(), 1280, script) else {
        return;
    };
    // The last but one of 600 samples at 100 Hz is at 5.98 s; the window is 1.5 s and the reading as fine as a five-thousandth of it.
    assert!(dom.contains("data-readings=\"5.9800 s|"), "{}", attribute(&dom, "data-readings"));
    assert!(attribute(&dom, "data-readings").ends_with("|5.9800 s"), "the cursor of the linked chart goes along");
    // Spoken when the cursor moved, before the zoom.
    assert!(attribute(&dom, "data-spoken").contains("5.980 s"));
    assert!(attribute(&dom, "data-path").ends_with(" V"), "{}", attribute(&dom, "data-path"));
    assert!(dom.contains("aria-pressed=\"false\""));
    assert!(dom.contains("data-theme=\""));
}

#[test]
fn dragging_zooms_and_a_double_click_shows_all_again() {
    // The reading at the right edge tells where the window ends; the second chart is linked, the first one is dragged in.
    let script = r#"
        const over = document.querySelectorAll(".u-over")[0], box = over.getBoundingClientRect();
        const mouse = (type, part, target = over) => target.dispatchEvent(new MouseEvent(type, {
            clientX: box.left + part * box.width, clientY: box.top + 90, movementX: 3, movementY: 1, bubbles: true, button: 0, view: window }));
        const readings = () => [...document.querySelectorAll(".legend")].slice(0, 2).map(legend => legend.querySelector("output").textContent).join("|");
        const steps = [
            () => { for (const type of ["mouseenter", "mousemove", "mousedown"]) mouse(type, 0.25); },
            () => { mouse("mousemove", 0.5); mouse("mousemove", 0.5, document); },
            () => { mouse("mouseup", 0.5); },
            () => { mouse("mousemove", 0.999); },
            () => { document.documentElement.dataset.zoomed = readings(); mouse("dblclick", 0.5); },
            () => { mouse("mousemove", 0.999); },
            () => { document.documentElement.dataset.reset = readings(); },
        ];
        steps.forEach((step, i) => setTimeout(step, 50 * (i + 1)));
    "#;
    let Some(dom) = dom_after("mouse", &page_with_everything(), 1280, script) else {
        return;
    };
    // Six seconds of which the second quarter is left; a sample is 0.01 s and a pixel 0.005 s.
    let seconds = |name: &str| -> Vec<f64> {
        attribute(&dom, name)
            .split('|')
            .map(|reading| reading.trim_end_matches(" s").parse().unwrap_or(f64::NAN))
            .collect()
    };
    for (name, expected) in [("data-zoomed", 3.0), ("data-reset", 5.99)] {
        let readings = seconds(name);
        assert!(readings.len() == 2 && readings.iter().all(|at| (at - expected).abs() < 0.03), "{name}: {readings:?}");
    }
}

#[test]
fn a_narrow_window_needs_no_sideways_scrolling() {
    let script = "const page = document.documentElement;
                  parent.postMessage(`${innerWidth} wide, ${page.scrollWidth - page.clientWidth} over`, '*');";
    for width in [420, 1280] {
        let Some(dom) = dom_after("narrow", &page_with_everything(), width, script) else {
            return;
        };
        assert_eq!(attribute(&dom, "data-heard"), format!("{width} wide, 0 over"));
    }
}

/// Every kind of chart, on good data and on the kinds of data that break axes.
fn page_with_everything() -> Page {
    let n = 600;
    let time_s: Vec<f64> = (0..n).map(|k| f64::from(k) * 0.01).collect();
    let command: Vec<f64> = time_s.iter().map(|t| 50.0 * (3.0 * t).sin()).collect();
    let mut measured: Vec<f64> = time_s.iter().map(|t| 70.0 * (3.0 * t - 0.2).sin()).collect();
    measured[100..140].fill(f64::NAN);
    let predicted: Vec<f64> = time_s.iter().map(|t| 69.0 * (3.0 * t - 0.25).sin()).collect();
    let frequency_hz: Vec<f64> = (0..300).map(f64::from).collect();
    let density: Vec<f64> = frequency_hz.iter().map(|f| 1e-9 + 1.0 / (1.0 + f * f)).collect();
    let correlation: Vec<f64> = (0..40).map(|lag| 0.8_f64.powi(lag)).collect();
    let mut page = replay_page(&ReplayView {
        title: HOSTILE,
        subtitle: HOSTILE,
        headline: HOSTILE,
        time_s: &time_s,
        kept: Kept::all(time_s.len()),
        command_v: &command,
        measured_um: &measured,
        predicted_um: &predicted,
        autocorrelation: &correlation,
        n_residuals: 600,
        spectrum: Some(SpectrumView {
            frequency_hz: &frequency_hz,
            residual_um_per_sqrt_hz: &density,
            measured_um_per_sqrt_hz: None,
        }),
        metrics: &[("a label that is long enough to need two lines".to_owned(), HOSTILE.to_owned())],
        warnings: &[HOSTILE.to_owned()],
        provenance: &[HOSTILE.to_owned()],
    });

    page.section("Data that break axes");
    page.table("wide", &["a", "b", "c"], &[vec!["w".repeat(60), "1".to_owned(), "x".repeat(60)]]);
    page.bar(
        "The gap",
        "µm",
        &[
            Share { label: "noise", value: 0.02, ink: Ink::Measured },
            Share { label: "explained", value: 0.5, ink: Ink::Model },
            Share { label: "unexplained", value: 0.1, ink: Ink::Error },
        ],
    );
    let missing = vec![f64::NAN; time_s.len()];
    let constant = vec![37.2; time_s.len()];
    let zero = vec![0.0; time_s.len()];
    let tiny: Vec<f64> = command.iter().map(|v| 1e-9 * v).collect();
    let axis = || Axis::new("displacement", "µm");
    let series = |values| [Series { name: HOSTILE, ink: Ink::Extra, values }];
    page.chart(Chart::over_time("constant", "", &time_s, axis(), &series(&constant)).low())
        .chart(Chart::over_time("zero", "", &time_s, axis(), &series(&zero)).low())
        .chart(Chart::over_time("missing", "", &time_s, axis(), &series(&missing)).low())
        .chart(Chart::over_time("tiny", "", &time_s, Axis::new("travel", "m"), &series(&tiny)).low())
        .chart(Chart::over_time("one", "", &[1.0], axis(), &series(&[2.0])).low())
        .chart(Chart::points(
            "starts",
            "",
            Axis::new("rank", ""),
            Axis::log("rms", "µm"),
            &[1.0, 2.0],
            &series(&[2e-4, 3e5]),
        ))
        .chart(Chart::loops("nothing", "", axis(), axis(), &[Loop { name: "none", ink: Ink::Model, x: &[], y: &[] }]));
    page
}
