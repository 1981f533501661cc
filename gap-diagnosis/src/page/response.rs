//! Frequency responses on a page: what was measured, and what models make of the same command.

use super::{Axis, Chart, Ink, Page, Series};

/// A frequency response, by Welch's method or at the lines of a multisine. Columns not empty have the length of `frequency_hz`.
#[derive(Debug, Clone, Default)]
pub struct ResponseView {
    /// Heading, e.g. which log.
    pub title: String,
    /// What was estimated how.
    pub caption: String,
    /// Frequencies, ascending.
    pub frequency_hz: Vec<f64>,
    /// Measured gain.
    pub measured_um_per_v: Vec<f64>,
    /// Measured phase.
    pub measured_deg: Vec<f64>,
    /// What models make of the same command.
    pub models: Vec<ModelResponse>,
    /// Standard deviation of the measured gain by noise; empty for none.
    pub noise_um_per_v: Vec<f64>,
    /// .. by nonlinear distortion; empty for none.
    pub distortion_um_per_v: Vec<f64>,
    /// Coherence, 0 to 1; empty for none.
    pub coherence: Vec<f64>,
}

/// The response of one model.
#[derive(Debug, Clone)]
pub struct ModelResponse {
    /// What the legend calls it.
    pub name: &'static str,
    /// Its colour.
    pub ink: Ink,
    /// Gain.
    pub gain_um_per_v: Vec<f64>,
    /// Phase.
    pub phase_deg: Vec<f64>,
}

/// Adds a section with them, if there are any.
pub(super) fn responses(page: &mut Page, responses: &[ResponseView]) {
    for (idx, response) in responses.iter().enumerate() {
        if idx == 0 {
            page.section("Frequency response");
        }
        let key = format!("response {idx}");
        let measured = |values| Series { name: "measured", ink: Ink::Measured, values };
        let of_models = |values: fn(&ModelResponse) -> &[f64]| {
            response.models.iter().map(move |model| Series { name: model.name, ink: model.ink, values: values(model) })
        };
        let mut gains = vec![measured(&response.measured_um_per_v)];
        gains.extend(of_models(|model| &model.gain_um_per_v));
        gains.push(Series { name: "distortion", ink: Ink::Extra, values: &response.distortion_um_per_v });
        gains.push(Series { name: "noise", ink: Ink::Reference, values: &response.noise_um_per_v });
        let mut phases = vec![measured(&response.measured_deg)];
        phases.extend(of_models(|model| &model.phase_deg));
        for curves in [&mut gains, &mut phases] {
            curves.retain(|curve| !curve.values.is_empty());
        }
        let gain = Axis::log("gain", "µm/V");
        page.chart(
            Chart::spectrum(&response.title, &response.caption, &response.frequency_hz, gain, &gains)
                .wide()
                .linked(&key),
        );
        page.chart(
            Chart::spectrum(
                "Phase",
                "A delay bends it down in proportion to the frequency, a lag only up to 90 degrees.",
                &response.frequency_hz,
                Axis::new("phase", "°"),
                &phases,
            )
            .linked(&key),
        );
        if !response.coherence.is_empty() {
            page.chart(
                Chart::spectrum(
                    "Coherence",
                    "What of the output goes with the input in a linear way: less than one is noise, distortion or too little drive.",
                    &response.frequency_hz,
                    Axis::new("coherence", ""),
                    &[Series { name: "measured", ink: Ink::Model, values: &response.coherence }],
                )
                .linked(&key),
            );
        }
    }
}
