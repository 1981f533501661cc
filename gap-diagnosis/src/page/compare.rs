//! The page of `identify --compare`: one table, one picture.

use super::{BarItem, BarList, Ink, Page, four_digits};

/// One model of the ranking.
#[derive(Debug, Clone)]
pub struct ComparedModel {
    /// What it is.
    pub kind: String,
    /// Rms on what was never fitted, micrometres.
    pub held_out_rms_um: f64,
    /// Mean fit percent there.
    pub held_out_percent: f64,
    /// Worst fit percent of what was fitted.
    pub fitted_percent: f64,
    /// Coordinates fitted.
    pub coordinates: usize,
    /// Bayesian criterion less the best.
    pub evidence: f64,
}

/// What the page shows.
#[derive(Debug, Clone)]
pub struct CompareView<'a> {
    /// Which logs.
    pub subtitle: &'a str,
    /// What was held out, in words.
    pub held_out: &'a str,
    /// The ranking, the best first.
    pub models: &'a [ComparedModel],
    /// Rms of the noise, micrometres.
    pub noise_um: f64,
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// Command line, seed, versions.
    pub provenance: &'a [String],
}

/// Lays a [`CompareView`] out.
pub fn compare_page(view: &CompareView<'_>) -> Page {
    let mut page = Page::new("Models compared");
    page.subtitle(view.subtitle).provenance(view.provenance);
    for warning in view.warnings {
        page.warning(warning);
    }
    if let Some(best) = view.models.first() {
        page.headline(&format!(
            "{}: {} rms on {}; the noise is {}.",
            best.kind,
            four_digits(best.held_out_rms_um, "µm"),
            view.held_out,
            four_digits(view.noise_um, "µm")
        ));
    }
    let rows: Vec<Vec<String>> = view
        .models
        .iter()
        .map(|model| {
            vec![
                model.kind.clone(),
                four_digits(model.held_out_rms_um, "µm"),
                four_digits(model.held_out_percent, "%"),
                four_digits(model.fitted_percent, "%"),
                model.coordinates.to_string(),
                format!("{:.0}", model.evidence),
            ]
        })
        .collect();
    page.section("Ranking");
    page.paragraph(
        "Ranked by the rms on what was never fitted. Evidence is the Bayesian criterion of what was fitted, less the best model's: each ten is a \
         hundred to one against a model, were its residual white.",
    );
    page.table(
        "All kinds on the same logs",
        &["model", "held out, rms", "held out, fit", "fitted, worst fit", "coordinates", "evidence against"],
        &rows,
    );
    // Misfit, because fits of 97 and 99.9 % look alike as bars.
    let misfit = |percent: f64| 100.0 - percent;
    let item = |model: &ComparedModel| BarItem {
        label: model.kind.clone(),
        percent: misfit(model.held_out_percent).max(0.0),
        behind_percent: Some(misfit(model.fitted_percent).max(0.0)),
        note: String::new(),
    };
    page.bar_lists(&[BarList {
        title: "Misfit, 100 % less the fit".into(),
        caption: "Blue: on what was never fitted. Pale: on what was fitted. Shorter is better; a blue bar much longer than its pale one is a model that \
                  learnt its logs by heart."
            .into(),
        ink: Ink::Model,
        full_percent: None,
        items: view.models.iter().map(item).collect(),
    }]);
    page
}
