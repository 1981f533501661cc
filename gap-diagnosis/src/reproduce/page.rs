//! The report: numbers chapter by chapter, errata first, figures after.

use super::figures::{admittance, shapes};
use super::loops::{Run, SINES_HZ, TABLE};
use super::{Entry, Reproduction, Thesis, Verdict, trend};
use crate::page::{Axis, Chart, Ink, Loop, Page, Series, four_digits};

/// Inks of the three loops, as everywhere on this page.
const LOOPS: [(&str, usize, usize, Ink); 3] =
    [("PHSNL + PI 1", 2, 2, Ink::Model), ("PHS2 + PI 1", 0, 0, Ink::Drive), ("NewId2 + PI 2", 4, 5, Ink::Error)];

/// Lays the report out.
pub fn page(thesis: &Thesis, found: &Reproduction, provenance: &[String]) -> Page {
    let mut page = Page::new("The thesis reproduced and corrected");
    page.subtitle("Every number of its tables and equations, printed and recomputed, and its figures drawn again");
    let agree = found.count(|v| matches!(v, Verdict::Agrees));
    let within = found.count(|v| matches!(v, Verdict::Within));
    let errata = found.count(|v| matches!(v, Verdict::Erratum { .. }));
    let given = found.count(|v| matches!(v, Verdict::Given));
    let differ = found.count(|v| matches!(v, Verdict::Differs));
    page.headline(&format!(
        "{agree} numbers come out to their printed digits, {within} of an independent solver within 1 % or half a unit of their last digit; {errata} are errata, and {}.",
        if differ == 0 { "none is left unexplained".to_owned() } else { format!("{differ} DIFFER WITHOUT EXPLANATION") }
    ));
    page.facts(&[
        ("to their printed digits".to_owned(), agree.to_string()),
        ("within 1 % of the independent solver, or half a last digit".to_owned(), within.to_string()),
        ("errata".to_owned(), errata.to_string()),
        ("measured or chosen, not computable".to_owned(), given.to_string()),
        ("unexplained".to_owned(), differ.to_string()),
    ]);
    page.section("Errata");
    page.paragraph(
        "What can't come out as printed, what is right, and why. The project's tests hold the corrected values.",
    );
    let errata: Vec<Vec<String>> = found
        .entries()
        .filter_map(|entry| match &entry.verdict {
            Verdict::Erratum { corrected, cause } => Some(vec![
                entry.place.clone(),
                entry.what.clone(),
                with_unit(&entry.printed, entry.unit),
                with_unit(corrected, entry.unit),
                cause.clone(),
            ]),
            _ => None,
        })
        .collect();
    page.table("Errata", &["where", "what", "printed", "corrected", "cause"], &errata);
    for chapter in &found.chapters {
        page.section(chapter.heading).paragraph(chapter.text);
        if chapter.heading.starts_with("Closed") {
            loop_tables(&mut page, &chapter.entries);
        } else {
            let rows: Vec<Vec<String>> = chapter.entries.iter().map(row).collect();
            page.table(chapter.heading, &["where", "what", "printed", "recomputed", "verdict"], &rows);
        }
        if chapter.heading.starts_with("Plant") {
            plant_figures(&mut page, thesis, found);
        }
        if chapter.heading.starts_with("Closed") {
            loop_figures(&mut page, found);
        }
    }
    page.provenance(provenance);
    page
}

fn with_unit(number: &str, unit: &str) -> String {
    let is_number = number.parse::<f64>().is_ok();
    if unit.is_empty() || !is_number { number.to_owned() } else { format!("{number} {unit}") }
}

fn row(entry: &Entry) -> Vec<String> {
    let verdict = match &entry.verdict {
        Verdict::Agrees => "agrees",
        Verdict::Within => "within 1 % or half a last digit",
        Verdict::Erratum { .. } => "erratum",
        Verdict::Given => "given",
        Verdict::Differs => "DIFFERS",
    };
    let ours = if entry.ours.is_finite() { digits_beyond(&entry.printed, entry.ours) } else { "–".to_owned() };
    let ours = if entry.unit.is_empty() || ours == "–" { ours } else { format!("{ours} {}", entry.unit) };
    vec![entry.place.clone(), entry.what.clone(), with_unit(&entry.printed, entry.unit), ours, verdict.to_owned()]
}

/// Ours with two digits more than were printed, in the print's own notation.
fn digits_beyond(printed: &str, ours: f64) -> String {
    if printed.parse::<f64>().is_err() {
        return four_digits(ours, "");
    }
    let (digits, power) = printed.split_once('e').map_or((printed, None), |(digits, power)| (digits, Some(power)));
    let decimals = digits.split_once('.').map_or(0, |(_, d)| d.len());
    match power {
        Some(_) => format!("{ours:.*e}", decimals + 2),
        // An erratum may be of another size altogether.
        None if ours != 0.0 && ours.abs() < 0.1 * 10f64.powi(-(decimals as i32)) => format!("{ours:.1e}"),
        None => format!("{ours:.*}", decimals + 2),
    }
}

fn plant_figures(page: &mut Page, thesis: &Thesis, found: &Reproduction) {
    let rows: Vec<Vec<String>> = trend::TABLE
        .iter()
        .zip(&found.trend.fit_percent)
        .map(|((hz, phs, bouc_wen), ours)| {
            let printed = super::value(bouc_wen) - super::value(phs);
            vec![
                hz.to_string(),
                (*phs).into(),
                (*bouc_wen).into(),
                format!("{printed:.2}"),
                format!("{:.2}", ours - 100.0),
            ]
        })
        .collect();
    page.paragraph(
        "Table 2.3: the fits are to measured sines, which are not at hand. Model against model, the hysterons taken for the bench, Bouc-Wen \
         falls behind in the same way: steadily with frequency, because its hysteresis knows no rate.",
    );
    page.table(
        "Table 2.3, fits in percent",
        &["Hz", "hysterons, printed", "Bouc-Wen, printed", "Bouc-Wen less hysterons, printed", "model against model"],
        &rows,
    );
    let inks = [Ink::Model, Ink::Error, Ink::Drive];
    for (exponent, title) in [(1.0, "Figure 2.2: shapes of Bouc-Wen, n = 1"), (2.0, "The same with n = 2")] {
        let curves = shapes(exponent);
        let loops: Vec<Loop<'_>> =
            curves.iter().zip(inks).map(|((name, x, y), ink)| Loop { name, ink, x, y }).collect();
        page.chart(Chart::loops(
            title,
            "h over x for A = 1: beta + gamma above zero softens while loading, zero is straight, below zero hardens.",
            Axis::new("x", ""),
            Axis::new("h", ""),
            &loops,
        ));
    }
    let (volts, currents) = admittance(thesis);
    let loops: Vec<Loop<'_>> = currents
        .iter()
        .zip(["hysteron 1", "hysteron 2"])
        .zip(inks)
        .map(|((y, name), ink)| Loop { name, ink, x: &volts, y })
        .collect();
    page.chart(Chart::loops(
        "Figure 2.3: the admittance with a dead zone",
        "Current of each hysteron as a share of its current at 25 V; inside the dead zone none flows.",
        Axis::new("voltage", "V"),
        Axis::new("share of current", ""),
        &loops,
    ));
    let fits = &found.trend.fit_percent;
    let hz: Vec<f64> = trend::TABLE.iter().map(|(hz, ..)| *hz).collect();
    let printed: Vec<f64> =
        trend::TABLE.iter().map(|(_, phs, bouc_wen)| 100.0 + super::value(bouc_wen) - super::value(phs)).collect();
    page.chart(Chart::points(
        "Table 2.3 drawn",
        "Bouc-Wen's fit with the hysterons' at 100 %: falling from left to right in print and model against model.",
        Axis::new("frequency", "Hz"),
        Axis::new("fit", "%"),
        &hz,
        &[
            Series { name: "printed, measured sines", ink: Ink::Reference, values: &printed },
            Series { name: "model against model", ink: Ink::Error, values: fits },
        ],
    ));
    for (index, label) in [(0, "1 Hz"), (3, "50 Hz"), (6, "150 Hz")] {
        let [volts, phs, bouc_wen] = &found.trend.periods[index];
        page.chart(Chart::loops(
            &format!("Figure 2.5: hysteresis at {label}"),
            "Displacement over voltage, 60 V: with frequency the hysterons' loop opens and turns, Bouc-Wen's does so by the mass and damper only.",
            Axis::new("command", "V"),
            Axis::new("displacement", "µm"),
            &[
                Loop { name: "hysterons (Table 2.1)", ink: Ink::Model, x: volts, y: phs },
                Loop { name: "Bouc-Wen (Table 2.2)", ink: Ink::Error, x: volts, y: bouc_wen },
            ],
        ));
    }
    let [_, phs, bouc_wen] = &found.trend.periods[3];
    let time_s: Vec<f64> = (0..phs.len()).map(|k| k as f64 / (50.0 * phs.len() as f64)).collect();
    let both = |phs, bouc_wen| {
        [
            Series { name: "hysterons (Table 2.1)", ink: Ink::Model, values: phs },
            Series { name: "Bouc-Wen (Table 2.2)", ink: Ink::Error, values: bouc_wen },
        ]
    };
    page.chart(Chart::over_time(
        "Figure 2.4: time response at 50 Hz",
        "One period of the steady answer to a 60 V sine.",
        &time_s,
        Axis::new("displacement", "µm"),
        &both(phs, bouc_wen),
    ));
    let [time_s, phs, bouc_wen] = &found.trend.step;
    page.chart(Chart::over_time(
        "Figure 2.6: step response",
        "A 60 V step: the hysterons ring at their locked resonance and creep by hysteron 2; the thesis' bench does more of both.",
        time_s,
        Axis::new("displacement", "µm"),
        &both(phs, bouc_wen),
    ));
}

/// Section 5 in its own layout, printed before recomputed; what differs says so.
fn loop_tables(page: &mut Page, entries: &[Entry]) {
    let cell = |entry: &Entry| {
        let remark = if entry.verdict == Verdict::Differs { " DIFFERS" } else { "" };
        format!("{} · {}{remark}", entry.printed, digits_beyond(&entry.printed, entry.ours))
    };
    let [step, sine] = [3, 3 * SINES_HZ.len()];
    let rows_of = |from: usize, count: usize| -> Vec<Vec<String>> {
        let rows = TABLE.iter().zip(entries.chunks(step + sine));
        rows.map(|(row, own)| {
            std::iter::once(row.name.to_owned()).chain(own[from..from + count].iter().map(cell)).collect()
        })
        .collect()
    };
    let header = ["loop", "rise 10-90 %, ms", "overshoot, %", "settling to 2 %, ms"];
    page.table("Steps to 120 um: printed · recomputed", &header, &rows_of(0, step));
    for (index, hz) in SINES_HZ.iter().enumerate() {
        let header = ["loop", "rms error, %", "gain", "phase, degrees"];
        page.table(&format!("{hz} Hz: printed · recomputed"), &header, &rows_of(step + 3 * index, 3));
    }
}

fn loop_figures(page: &mut Page, found: &Reproduction) {
    let series = |runs: &[(&'static str, &Run, Ink)]| -> Vec<(&'static str, Vec<f64>, Ink)> {
        runs.iter().map(|(name, run, ink)| (*name, run.displacement_um.clone(), *ink)).collect()
    };
    let over_time = |page: &mut Page, title: &str, caption: &str, runs: &[(&'static str, &Run, Ink)]| {
        let first = runs[0].1;
        let columns = series(runs);
        let mut all: Vec<Series<'_>> =
            columns.iter().map(|(name, values, ink)| Series { name, ink: *ink, values }).collect();
        all.push(Series { name: "reference", ink: Ink::Reference, values: &first.reference_um });
        page.chart(Chart::over_time(title, caption, &first.time_s, Axis::new("displacement", "µm"), &all));
    };
    let of = |runs: &dyn Fn(usize) -> usize| -> Vec<(&'static str, usize, Ink)> {
        LOOPS.iter().enumerate().map(|(i, (name, _, _, ink))| (*name, runs(i), *ink)).collect()
    };
    let steps: Vec<_> =
        of(&|i| LOOPS[i].1).into_iter().map(|(name, at, ink)| (name, &found.loops.steps[at], ink)).collect();
    over_time(
        page,
        "Figure 3.9: step response without feedforward",
        "PHS2 creeps in as designed; the nonlinear plant jumps by what Kp gives, rings and waits for the integral; NewId2 is slowest.",
        &steps,
    );
    let forward: Vec<_> =
        [(3, "PHSNL + PI 1", Ink::Model), (1, "PHS2 + PI 1", Ink::Drive), (5, "NewId2 + PI 2", Ink::Error)]
            .into_iter()
            .map(|(at, name, ink)| (name, &found.loops.steps[at], ink))
            .collect();
    over_time(
        page,
        "The same with feedforward",
        "An unshaped step of feedforward volts throws the nonlinear plant to 175 µm, beyond the 120 µm at which the bender may break.",
        &forward,
    );
    let squares: Vec<_> =
        of(&|i| LOOPS[i].1).into_iter().map(|(name, at, ink)| (name, &found.loops.squares[at], ink)).collect();
    over_time(page, "Figure 3.9: square wave", "20 Hz, 120 µm, without feedforward.", &squares);
    for (index, hz) in SINES_HZ.iter().enumerate() {
        let runs: Vec<_> =
            of(&|i| LOOPS[i].2).into_iter().map(|(name, at, ink)| (name, &found.loops.sines[at][index], ink)).collect();
        over_time(
            page,
            &format!("Figure 3.10: {hz} Hz"),
            "The third period. NewId2 with feedforward, the others without, as in the thesis.",
            &runs,
        );
        let loops: Vec<Loop<'_>> = runs
            .iter()
            .map(|(name, run, ink)| Loop { name, ink: *ink, x: &run.reference_um, y: &run.displacement_um })
            .collect();
        page.chart(Chart::loops(
            &format!("Figure 3.10: displacement over reference, {hz} Hz"),
            "A straight line of slope one would be perfect.",
            Axis::new("reference", "µm"),
            Axis::new("displacement", "µm"),
            &loops,
        ));
    }
    debug_assert!(TABLE.len() == found.loops.steps.len());
}
