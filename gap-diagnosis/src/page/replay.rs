//! The page of `replay`: the model driven with the logged command, beside what the bench did.

use super::{Axis, Chart, Ink, Kept, Loop, Page, Panel, Series};

/// What a replay page shows. The first three slices have one length.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReplayView<'a> {
    /// Heading.
    pub title: &'a str,
    /// Which plant and which log.
    pub subtitle: &'a str,
    /// The verdict in one sentence; empty for none.
    pub headline: &'a str,
    /// Times of the rows that the page was given.
    pub time_s: &'a [f64],
    /// Which these are.
    pub kept: Kept,
    /// Logged command.
    pub command_v: &'a [f64],
    /// Logged displacement; NaN where it is not to be scored.
    pub measured_um: &'a [f64],
    /// The model's displacement.
    pub predicted_um: &'a [f64],
    /// Autocorrelation of the residual of all rows from lag 0 on, one value per sample of the log; empty if not computed.
    pub autocorrelation: &'a [f64],
    /// Residuals that went into it.
    pub n_residuals: usize,
    /// Spectrum of the residual.
    pub spectrum: Option<SpectrumView<'a>>,
    /// Label and value with unit, in the order of importance.
    pub metrics: &'a [(String, String)],
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// Command line, seed, versions.
    pub provenance: &'a [String],
}

/// Amplitude spectral densities over frequency.
#[derive(Debug, Clone, Copy)]
pub struct SpectrumView<'a> {
    /// Frequencies, ascending.
    pub frequency_hz: &'a [f64],
    /// Of the residual.
    pub residual_um_per_sqrt_hz: &'a [f64],
    /// Of the measured displacement, for comparison.
    pub measured_um_per_sqrt_hz: Option<&'a [f64]>,
}

/// Lays out a [`ReplayView`].
pub fn replay_page(view: &ReplayView<'_>) -> Page {
    let mut page = Page::new(view.title);
    page.subtitle(view.subtitle).headline(view.headline).facts(view.metrics).provenance(view.provenance);
    for warning in view.warnings {
        page.warning(warning);
    }
    overlay_and_residual(&mut page, "log", view.time_s, view.kept, view.measured_um, view.predicted_um);
    let loops = Chart::loops(
        "Hysteresis, measured and predicted",
        "The loops should coincide: another width is a dissipation the model lacks, another slope a gain, a shift an offset.",
        Axis::new("command", "V"),
        Axis::new("displacement", "µm"),
        &[
            Loop { name: "measured", ink: Ink::Measured, x: view.command_v, y: view.measured_um },
            Loop { name: "predicted", ink: Ink::Model, x: view.command_v, y: view.predicted_um },
        ],
    );
    page.chart(loops.of(view.kept));
    autocorrelation(&mut page, period_ms(view.time_s, view.kept), view.autocorrelation, view.n_residuals);
    if let Some(spectrum) = &view.spectrum {
        let mut series = vec![];
        if let Some(values) = spectrum.measured_um_per_sqrt_hz {
            series.push(Series { name: "measured displacement", ink: Ink::Measured, values });
        }
        series.push(Series { name: "residual", ink: Ink::Error, values: spectrum.residual_um_per_sqrt_hz });
        page.chart(
            Chart::spectrum(
                "Spectrum of the residual",
                "A flat line is noise; a peak is a resonance or mains hum, a rise towards low frequencies is creep or drift.",
                spectrum.frequency_hz,
                Axis::log("amplitude density", "µm/√Hz"),
                &series,
            )
            .wide(),
        );
    }
    page
}

/// The two linked time charts that every comparison of a model with a log begins with.
pub(super) fn overlay_and_residual(
    page: &mut Page,
    link: &str,
    time_s: &[f64],
    kept: Kept,
    measured_um: &[f64],
    predicted_um: &[f64],
) {
    let residual_um: Vec<f64> =
        measured_um.iter().zip(predicted_um).map(|(measured, predicted)| measured - predicted).collect();
    let panels = [
        Panel {
            title: "Measured and predicted",
            caption: "The thin line is the model, the broad one the bench; zoom in where they part.",
            y: Axis::new("displacement", "µm"),
            series: vec![
                Series { name: "measured", ink: Ink::Measured, values: measured_um },
                Series { name: "predicted", ink: Ink::Model, values: predicted_um },
            ],
        },
        Panel {
            title: "Residual",
            caption: "Measured minus predicted: even noise is all a model can leave; steps, slopes or waves are something it lacks.",
            y: Axis::new("residual", "µm"),
            series: vec![Series { name: "residual", ink: Ink::Error, values: &residual_um }],
        },
    ];
    page.charts(Chart::linked_over_time(link, time_s, &panels).into_iter().map(|chart| chart.of(kept)).collect());
}

/// Time between two rows of the log, of which `time_s` has what was `kept`; NaN with less than two.
pub(super) fn period_ms(time_s: &[f64], kept: Kept) -> f64 {
    match time_s {
        [first, .., last] => 1e3 * (last - first) / ((time_s.len() - 1) * kept.stride) as f64,
        _ => f64::NAN,
    }
}

/// The whiteness test, of residuals `period_ms` apart. Lag 0 is one by definition and left out, so that the others can be seen.
pub(super) fn autocorrelation(page: &mut Page, period_ms: f64, correlation: &[f64], n_residuals: usize) {
    if correlation.len() < 2 || n_residuals == 0 {
        return;
    }
    let (axis, step) =
        if period_ms > 0.0 { (Axis::new("lag", "ms"), period_ms) } else { (Axis::new("lag", "samples"), 1.0) };
    let lags: Vec<f64> = (1..correlation.len()).map(|lag_idx| lag_idx as f64 * step).collect();
    page.chart(Chart::bars_with_band(
        "Autocorrelation of the residual",
        "White noise keeps 99 % of the bars inside the grey region; a slow decay or a wave outside it is structure the model lacks.",
        axis,
        Axis::new("autocorrelation", ""),
        &lags,
        Series { name: "residual", ink: Ink::Error, values: &correlation[1..] },
        // 99 % of a normal distribution lie within 2.58 sigma; sigma is 1/sqrt(N) for the N samples of a white residual.
        2.58 / (n_residuals as f64).sqrt(),
    ));
}
