//! The pages of `design` and `design --check`: reductions, placed and sampled poles, margins, root locus, Bode, step, peaks.

use super::{Axis, Chart, Ink, Loop, Page, Series, four_digits};

/// A curve in a plane; NaN pairs lift the pen.
#[derive(Debug, Clone)]
pub struct PlaneView {
    /// For the legend.
    pub name: String,
    /// Its meaning.
    pub ink: Ink,
    /// Horizontal.
    pub x: Vec<f64>,
    /// Vertical.
    pub y: Vec<f64>,
}

/// An open loop over frequency.
#[derive(Debug, Clone)]
pub struct BodeView {
    /// Region of the plant.
    pub name: String,
    /// |L|.
    pub magnitude: Vec<f64>,
    /// Phase in degrees.
    pub phase_deg: Vec<f64>,
}

/// A table.
#[derive(Debug, Clone)]
pub struct TableView {
    /// What it shows.
    pub caption: String,
    /// Column names.
    pub header: Vec<&'static str>,
    /// Rows.
    pub rows: Vec<Vec<String>>,
}

/// What a design page shows.
#[derive(Debug, Clone)]
pub struct DesignView<'a> {
    /// Heading.
    pub title: &'a str,
    /// Which plant, rate and delay.
    pub subtitle: &'a str,
    /// The verdict in one sentence.
    pub headline: &'a str,
    /// Label and value with unit.
    pub facts: &'a [(String, String)],
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// Section headings, each with a paragraph and tables.
    pub sections: &'a [(String, String, Vec<TableView>)],
    /// Root locus, 1/s.
    pub locus: &'a [PlaneView],
    /// Frequencies of the open loops.
    pub frequency_hz: &'a [f64],
    /// Open loops.
    pub bode: &'a [BodeView],
    /// Time, reference and displacement of a step; empty for none.
    pub step: [&'a [f64]; 3],
    /// The continuous design's own step on the reduced plant.
    pub step_reduced_um: &'a [f64],
    /// Command line, versions.
    pub provenance: &'a [String],
}

const INKS: [Ink; 6] = [Ink::Model, Ink::Error, Ink::Drive, Ink::Extra, Ink::Other, Ink::Measured];

/// Lays a [`DesignView`] out.
pub fn design_page(view: &DesignView<'_>) -> Page {
    let mut page = Page::new(view.title);
    page.subtitle(view.subtitle).headline(view.headline).facts(view.facts).provenance(view.provenance);
    for warning in view.warnings {
        page.warning(warning);
    }
    for (heading, text, tables) in view.sections {
        page.section(heading).paragraph(text);
        for table in tables {
            page.table(&table.caption, &table.header, &table.rows);
        }
    }
    page.section("Pictures");
    if !view.locus.is_empty() {
        let loops: Vec<Loop<'_>> =
            view.locus.iter().map(|c| Loop { name: &c.name, ink: c.ink, x: &c.x, y: &c.y }).collect();
        page.chart(Chart::loops(
            "Root locus",
            "Closed-loop poles while both gains rise together from a hundredth of the design to four times; the design \
             stands at the crosses. Sampled poles are shown as ln z / T. To the right of zero the loop is unstable.",
            Axis::new("real part", "1/s"),
            Axis::new("imaginary part", "rad/s"),
            &loops,
        ));
    }
    let [time_s, reference_um, displacement_um] = view.step;
    if !time_s.is_empty() {
        let mut series =
            vec![Series { name: "whole plant, sampled and delayed", ink: Ink::Model, values: displacement_um }];
        if !view.step_reduced_um.is_empty() {
            series.push(Series { name: "skeleton, continuous", ink: Ink::Drive, values: view.step_reduced_um });
        }
        series.push(Series { name: "reference", ink: Ink::Reference, values: reference_um });
        page.chart(Chart::over_time(
            "Step",
            "The shaped step through the control law and the whole plant; the skeleton is what the poles were placed on.",
            time_s,
            Axis::new("displacement", "µm"),
            &series,
        ));
    }
    if !view.bode.is_empty() {
        let of = |values: fn(&BodeView) -> &[f64]| -> Vec<Series<'_>> {
            let inks = view.bode.iter().zip(INKS);
            inks.map(|(b, ink)| Series { name: &b.name, ink, values: values(b) }).collect()
        };
        page.chart(
            Chart::spectrum(
                "Open loop, magnitude",
                "Where it crosses one the phase margin is read; at -180 degrees the gain margin.",
                view.frequency_hz,
                Axis::log("|L|", ""),
                &of(|b| &b.magnitude),
            )
            .linked("bode"),
        );
        page.chart(
            Chart::spectrum(
                "Open loop, phase",
                "One curve for each set of hysterons outside their dead zones.",
                view.frequency_hz,
                Axis::new("phase", "°"),
                &of(|b| &b.phase_deg),
            )
            .linked("bode"),
        );
    }
    page
}

/// A complex pole as a reader writes it.
pub fn pole(re: f64, im: f64) -> String {
    if im == 0.0 { four_digits(re, "") } else { format!("{} ± {}j", four_digits(re, ""), four_digits(im.abs(), "")) }
}
