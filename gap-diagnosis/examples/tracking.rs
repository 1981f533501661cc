//! The tracking table as a page.
//!
//!     cargo run --release -p gap-diagnosis --example tracking -- tracking.html

#[path = "../tests/tracking_table/mod.rs"]
mod tracking_table;

use gap_diagnosis::page::{Axis, Chart, Ink, Page, Series, four_digits};
use plant_sim::design::SINES_HZ;
use std::path::PathBuf;
use tracking_table::{RATE_HZ, table};

fn main() {
    let out = std::env::args().nth(1).map_or_else(|| PathBuf::from("tracking.html"), PathBuf::from);
    let table = table();
    let mut page = Page::new("Tracking");
    page.subtitle(&format!(
        "80 um sines on the thesis' plant, {} kHz, shaped and limited: rms error in % of the amplitude",
        RATE_HZ / 1e3
    ));
    page.headline(&format!("The diagnosis named {}.", table.diagnosis.effects.join(", ")));
    let rows: Vec<Vec<String>> = table
        .rows
        .iter()
        .map(|(name, errors)| std::iter::once(name.clone()).chain(errors.iter().map(|e| four_digits(*e, ""))).collect())
        .collect();
    for row in &rows {
        println!("{}", row.join("  "));
    }
    page.table("Rms error, %", &["controller", "1 Hz", "10 Hz", "50 Hz", "100 Hz", "150 Hz"], &rows);
    let inks = [Ink::Measured, Ink::Extra, Ink::Drive, Ink::Model, Ink::Error, Ink::Other];
    let series: Vec<Series<'_>> =
        table.rows.iter().zip(inks).map(|((name, errors), ink)| Series { name, ink, values: errors }).collect();
    page.chart(
        Chart::spectrum(
            "Tracking error over frequency",
            "Lower is better.",
            &SINES_HZ,
            Axis::log("error", "%"),
            &series,
        )
        .wide(),
    );
    page.save(&out).expect("a place to write");
    println!("page: {}", out.display());
}
