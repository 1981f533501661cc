//! The page of `identify`: is the fit good on every log, what are the parameters, which of them did the data not see.

use super::number::{count, percent_of_sigma};
use super::replay::{autocorrelation, overlay_and_residual};
use super::{Axis, Chart, Ink, Loop, Page, Series, four_digits};

/// One log and how the fitted model reproduces it. The slices have one length.
#[derive(Debug, Clone, Copy)]
pub struct FittedLog<'a> {
    /// File name or the like.
    pub name: &'a str,
    /// Sample times.
    pub time_s: &'a [f64],
    /// Logged command.
    pub command_v: &'a [f64],
    /// Logged displacement; NaN where it was not fitted.
    pub measured_um: &'a [f64],
    /// The fitted model's displacement.
    pub predicted_um: &'a [f64],
    /// Autocorrelation of the residual from lag 0 on; empty if not computed.
    pub autocorrelation: &'a [f64],
    /// Residuals that went into it, and into the numbers below.
    pub n_residuals: usize,
    /// Root mean square of the residual.
    pub rms_um: f64,
    /// 100 (1 - rms of the residual / standard deviation of the displacement).
    pub fit_percent: f64,
}

/// One row of the parameter table.
#[derive(Debug, Clone, Copy)]
pub struct FittedParameter<'a> {
    /// As in the model file.
    pub name: &'a str,
    /// Unit, empty for a pure number.
    pub unit: &'a str,
    /// Fitted value.
    pub value: f64,
    /// Its relative standard deviation; `None` if the data leave it open.
    pub sigma: Option<f64>,
    /// Value before the fit and its relative standard deviation.
    pub prior: Option<(f64, f64)>,
    /// Why the data do not see it, in plain words; it then stands at its prior.
    pub unseen: Option<&'a str>,
}

/// One start of the search.
#[derive(Debug, Clone, Copy)]
pub struct StartView {
    /// Residual at the start; NaN if not kept.
    pub initial_rms_um: f64,
    /// Residual where it ended.
    pub final_rms_um: f64,
}

/// What an identification page shows.
#[derive(Debug, Clone, Copy)]
pub struct IdentifyView<'a> {
    /// Heading.
    pub title: &'a str,
    /// Model and number of logs.
    pub subtitle: &'a str,
    /// The verdict in one sentence; empty for none.
    pub headline: &'a str,
    /// Every log fitted.
    pub logs: &'a [FittedLog<'a>],
    /// Every parameter, fitted or not.
    pub parameters: &'a [FittedParameter<'a>],
    /// Every start, in any order.
    pub starts: &'a [StartView],
    /// AIC, BIC, time and the like: label and value with unit.
    pub metrics: &'a [(String, String)],
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// Command line, seed, versions.
    pub provenance: &'a [String],
}

/// Lays out an [`IdentifyView`].
pub fn identify_page(view: &IdentifyView<'_>) -> Page {
    let mut page = Page::new(view.title);
    page.subtitle(view.subtitle).headline(view.headline).facts(view.metrics).provenance(view.provenance);
    for warning in view.warnings {
        page.warning(warning);
    }

    page.section("Parameters");
    let rows: Vec<Vec<String>> = view.parameters.iter().map(parameter_row).collect();
    page.table(
        "Fitted values; sigma is one standard deviation, 'from prior' is how far the fit moved, in prior standard deviations",
        &["parameter", "value", "sigma", "prior", "from prior", "remark"],
        &rows,
    );

    page.section("Fit");
    let rows: Vec<Vec<String>> = view
        .logs
        .iter()
        .map(|log| {
            vec![
                log.name.to_owned(),
                count(log.n_residuals),
                four_digits(log.rms_um, "µm"),
                four_digits(log.fit_percent, "%"),
            ]
        })
        .collect();
    page.table("How well each log is reproduced", &["log", "samples", "rms residual", "fit"], &rows);
    convergence(&mut page, view.starts);

    for (log_idx, log) in view.logs.iter().enumerate() {
        page.section(log.name);
        let link = format!("log {log_idx}");
        overlay_and_residual(&mut page, &link, log.time_s, log.measured_um, log.predicted_um);
        page.chart(Chart::loops(
            "Hysteresis, measured and fitted",
            "The loops should coincide, the small ones inside too.",
            Axis::new("command", "V"),
            Axis::new("displacement", "µm"),
            &[
                Loop { name: "measured", ink: Ink::Measured, x: log.command_v, y: log.measured_um },
                Loop { name: "fitted", ink: Ink::Model, x: log.command_v, y: log.predicted_um },
            ],
        ));
        autocorrelation(&mut page, log.time_s, log.autocorrelation, log.n_residuals);
    }
    page
}

fn parameter_row(parameter: &FittedParameter<'_>) -> Vec<String> {
    let from_prior =
        match (parameter.unseen, parameter.prior.and_then(|prior| distance_in_sigma(parameter.value, prior))) {
            (None, Some(distance)) => format!("{distance:+.1} σ").replace('-', "−"),
            _ => "–".to_owned(),
        };
    let remark = match parameter.unseen {
        Some(reason) => format!("not seen, kept at its prior: {reason}"),
        // Beyond three prior standard deviations the prior, the model or the log is wrong: a reader should ask which.
        None if parameter
            .prior
            .and_then(|prior| distance_in_sigma(parameter.value, prior))
            .is_some_and(|distance| distance.abs() > 3.0) =>
        {
            "far from its prior".to_owned()
        }
        None if parameter.sigma.is_some_and(|sigma| sigma > 0.3) => "poorly seen".to_owned(),
        None => String::new(),
    };
    let percent = |sigma: Option<f64>| sigma.map_or("–".to_owned(), |sigma| format!("± {}", percent_of_sigma(sigma)));
    vec![
        parameter.name.to_owned(),
        four_digits(parameter.value, parameter.unit),
        percent(parameter.sigma.filter(|_| parameter.unseen.is_none())),
        parameter.prior.map_or("–".to_owned(), |(value, sigma)| {
            format!("{} ± {}", four_digits(value, ""), percent_of_sigma(sigma))
        }),
        from_prior,
        remark,
    ]
}

/// How many prior standard deviations the fit moved. Positive parameters are fitted as logarithms, so a factor of two up and one
/// down are the same distance.
fn distance_in_sigma(value: f64, (prior, sigma): (f64, f64)) -> Option<f64> {
    let distance =
        if value > 0.0 && prior > 0.0 { (value / prior).ln() / sigma } else { (value - prior) / (prior.abs() * sigma) };
    distance.is_finite().then_some(distance)
}

fn convergence(page: &mut Page, starts: &[StartView]) {
    if starts.is_empty() {
        return;
    }
    let mut sorted = starts.to_vec();
    sorted.sort_by(|a, b| a.final_rms_um.total_cmp(&b.final_rms_um));
    let rank: Vec<f64> = (1..=sorted.len()).map(|rank| rank as f64).collect();
    let initial_um: Vec<f64> = sorted.iter().map(|start| start.initial_rms_um).collect();
    let final_um: Vec<f64> = sorted.iter().map(|start| start.final_rms_um).collect();
    let mut series = vec![Series { name: "end of the search", ink: Ink::Model, values: &final_um }];
    if initial_um.iter().any(|value| value.is_finite()) {
        series.push(Series { name: "start", ink: Ink::Other, values: &initial_um });
    }
    page.chart(Chart::points(
        "Convergence of the starts",
        "Each start of the search, best first: a level row at the left is one minimum found again and again; a staircase is several.",
        Axis::new("start, by rank", ""),
        Axis::log("rms residual", "µm"),
        &rank,
        &series,
    )
    .wide()
    .low());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_from_the_prior() {
        let doubled = distance_in_sigma(2.0, (1.0, 0.1)).expect("finite");
        let halved = distance_in_sigma(0.5, (1.0, 0.1)).expect("finite");
        assert!((doubled + halved).abs() < 1e-12 && doubled > 6.9);
        assert_eq!(distance_in_sigma(-1.5, (-1.0, 0.25)), Some(-2.0));
        assert_eq!(distance_in_sigma(1.0, (0.0, 0.1)), None);
    }

    #[test]
    fn an_unseen_parameter_says_so_and_claims_no_sigma() {
        let row = parameter_row(&FittedParameter {
            name: "beta1",
            unit: "",
            value: 1.0,
            sigma: Some(0.5),
            prior: Some((1.0, 0.02)),
            unseen: Some("its dead zone never opens"),
        });
        assert_eq!(row[2], "–");
        assert_eq!(row[4], "–");
        assert_eq!(row[5], "not seen, kept at its prior: its dead zone never opens");
    }
}
