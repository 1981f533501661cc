//! The page of `identify`: is the fit good on every log, what are the parameters, which of them did the data not see.

use super::number::{count, percent_of_sigma};
use super::replay::{autocorrelation, overlay_and_residual, period_ms};
use super::response::responses;
use super::{Axis, Chart, Ink, Kept, Loop, Page, ResponseView, Series, four_digits};

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
    /// Root mean square of the log's noise.
    pub noise_um: f64,
    /// 100 (1 - rms of the residual / standard deviation of the displacement).
    pub fit_percent: f64,
}

/// One row of the parameter table.
#[derive(Debug, Clone, Copy)]
pub struct FittedParameter<'a> {
    /// In words.
    pub name: &'a str,
    /// Unit, empty for a pure number.
    pub unit: &'a str,
    /// Fitted value.
    pub value: f64,
    /// Its relative standard deviation; `None` if the data leave it open.
    pub sigma: Option<f64>,
    /// Value before the fit; NaN if there was none.
    pub prior: f64,
    /// What became of it, in plain words.
    pub note: &'a str,
}

/// One start of the search.
#[derive(Debug, Clone, Copy)]
pub struct StartView {
    /// Residual at the start; NaN if not kept.
    pub initial_rms_um: f64,
    /// Residual where it ended.
    pub final_rms_um: f64,
}

/// An order of a transfer function.
#[derive(Debug, Clone, Copy)]
pub struct OrderView {
    /// Poles.
    pub poles: usize,
    /// Zeros.
    pub zeros: usize,
    /// Residual over all logs.
    pub rms_um: f64,
    /// Fit percent of the log that is fitted worst.
    pub fit_percent: f64,
}

/// What an identification page shows.
#[derive(Debug, Clone, Copy, Default)]
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
    /// Every order of a transfer function that was tried, the best first; empty for other kinds.
    pub orders: &'a [OrderView],
    /// Frequency responses of logs and of the fitted model.
    pub responses: &'a [ResponseView],
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
    let columns = ["parameter", "value", "sigma", "before", "change", "remark"];
    if view.parameters.iter().all(|parameter| parameter.prior.is_nan()) {
        let rows: Vec<Vec<String>> = rows.iter().map(|row| row[..3].to_vec()).collect();
        page.table("Values with one standard deviation; what these logs can't see has none.", &columns[..3], &rows);
    } else {
        page.table(
            "Values with one standard deviation; what these logs can't see stays where it was before the fit and has none.",
            &columns,
            &rows,
        );
    }

    page.section("Fit");
    let rows: Vec<Vec<String>> = view
        .logs
        .iter()
        .map(|log| {
            vec![
                log.name.to_owned(),
                count(log.n_residuals),
                four_digits(log.rms_um, "µm"),
                four_digits(log.noise_um, "µm"),
                four_digits(log.fit_percent, "%"),
            ]
        })
        .collect();
    page.table("How well each log is reproduced", &["log", "samples", "rms residual", "noise", "fit"], &rows);
    convergence(&mut page, view.starts);
    orders(&mut page, view.orders);
    responses(&mut page, view.responses);

    for (log_idx, log) in view.logs.iter().enumerate() {
        page.section(log.name);
        let link = format!("log {log_idx}");
        let kept = Kept::all(log.time_s.len());
        overlay_and_residual(&mut page, &link, log.time_s, kept, log.measured_um, log.predicted_um);
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
        autocorrelation(&mut page, period_ms(log.time_s, kept), log.autocorrelation, log.n_residuals);
    }
    page
}

fn parameter_row(parameter: &FittedParameter<'_>) -> Vec<String> {
    let change = 100.0 * (parameter.value / parameter.prior - 1.0);
    vec![
        parameter.name.to_owned(),
        four_digits(parameter.value, parameter.unit),
        parameter.sigma.map_or("–".to_owned(), |sigma| format!("± {}", percent_of_sigma(sigma))),
        four_digits(parameter.prior, parameter.unit),
        if change.is_finite() && change != 0.0 {
            format!("{change:+.1} %").replace('-', "−")
        } else {
            "–".to_owned()
        },
        parameter.note.to_owned(),
    ]
}

fn orders(page: &mut Page, orders: &[OrderView]) {
    if orders.is_empty() {
        return;
    }
    let row = |order: &OrderView| {
        vec![
            order.poles.to_string(),
            order.zeros.to_string(),
            four_digits(order.rms_um, "µm"),
            four_digits(order.fit_percent, "%"),
        ]
    };
    let rows: Vec<Vec<String>> = orders.iter().map(row).collect();
    page.table(
        "Orders that were tried. The first has the least Bayesian criterion: what another explains more does not pay for its coefficients.",
        &["poles", "zeros", "rms residual", "fit of the worst log"],
        &rows,
    );
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
    fn a_parameter_that_stayed_shows_no_change_and_one_without_sigma_claims_none() {
        let kept = FittedParameter { name: "slope 1", unit: "S", value: 1.0, sigma: None, prior: 1.0, note: "unseen" };
        assert_eq!(parameter_row(&kept)[2..], ["–", "1.000 S", "–", "unseen"]);
        let halved = FittedParameter { value: 0.5, sigma: Some(0.1), ..kept };
        assert_eq!(parameter_row(&halved)[4], "−50.0 %");
        let from_zero = FittedParameter { prior: 0.0, ..kept };
        assert_eq!(parameter_row(&from_zero)[4], "–");
    }
}
