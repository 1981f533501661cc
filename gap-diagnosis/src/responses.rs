//! Frequency responses of logs and of what models make of them, as pages show them.

use crate::page::{Ink, ModelResponse, ResponseView};
use crate::spectra::{best_linear, frf, segment_samples};

/// Lines that a multisine has at least; fewer are a sine.
const LEAST_LINES: usize = 20;
/// Logs whose responses are shown.
const MOST: usize = 2;

/// A log and what models make of its command. The columns have one length.
#[derive(Debug, Clone)]
pub struct Played<'a> {
    /// Name of the log.
    pub name: &'a str,
    /// Sample time.
    pub dt_s: f64,
    /// Period of the command in samples as the log states it, if it does.
    pub period_samples: Option<usize>,
    /// Command.
    pub drive_v: &'a [f64],
    /// Reading.
    pub measured_m: &'a [f64],
    /// Name, colour and displacement of each model.
    pub models: Vec<(&'static str, Ink, &'a [f64])>,
}

/// Responses of the logs with a multisine; without one, Welch's of the longest log.
///
/// # Panics
/// If a log's columns differ in length.
pub fn responses(logs: &[Played<'_>]) -> Vec<ResponseView> {
    let mut found: Vec<ResponseView> = logs.iter().filter_map(by_multisine).take(MOST).collect();
    if found.is_empty() {
        let seconds = |log: &Played<'_>| log.dt_s * log.measured_m.len() as f64;
        let longest = logs.iter().max_by(|a, b| seconds(a).total_cmp(&seconds(b)));
        found.extend(longest.and_then(by_welch));
    }
    found
}

/// The response of a model, gain in m/V and phase in rad.
fn of_model(name: &'static str, ink: Ink, gain_m_per_v: &[f64], phase_rad: &[f64]) -> ModelResponse {
    ModelResponse { name, ink, gain_um_per_v: um_per_v(gain_m_per_v), phase_deg: degrees(phase_rad) }
}

fn um_per_v(gain_m_per_v: &[f64]) -> Vec<f64> {
    gain_m_per_v.iter().map(|gain| 1e6 * gain).collect()
}

fn degrees(phase_rad: &[f64]) -> Vec<f64> {
    phase_rad.iter().map(|phase| phase.to_degrees()).collect()
}

fn by_multisine(log: &Played<'_>) -> Option<ResponseView> {
    let of = |y: &[f64]| {
        best_linear(log.drive_v, y, log.dt_s, log.period_samples).filter(|r| r.frequency_hz.len() >= LEAST_LINES)
    };
    let measured = of(log.measured_m)?;
    let model = |&(name, ink, y): &(_, _, &[f64])| of(y).map(|r| of_model(name, ink, &r.gain_m_per_v, &r.phase_rad));
    Some(ResponseView {
        title: format!("Best linear approximation, {}", log.name),
        caption: format!(
            "{} periods: what differs between them is noise; what differs between realisations is distortion.",
            measured.n_periods
        ),
        measured_um_per_v: um_per_v(&measured.gain_m_per_v),
        measured_deg: degrees(&measured.phase_rad),
        models: log.models.iter().map(model).collect::<Option<_>>()?,
        noise_um_per_v: um_per_v(&measured.noise_m_per_v),
        distortion_um_per_v: um_per_v(&measured.distortion_m_per_v),
        frequency_hz: measured.frequency_hz,
        ..ResponseView::default()
    })
}

fn by_welch(log: &Played<'_>) -> Option<ResponseView> {
    let segment = segment_samples(log.measured_m.len());
    let of = |y: &[f64]| frf(log.drive_v, y, log.dt_s, segment);
    let measured = of(log.measured_m)?;
    let model = |&(name, ink, y): &(_, _, &[f64])| of(y).map(|r| of_model(name, ink, &r.gain_m_per_v, &r.phase_rad));
    Some(ResponseView {
        title: format!("Frequency response, {}", log.name),
        caption: "By Welch's method; where the coherence is low, the drive holds too little power.".to_owned(),
        measured_um_per_v: um_per_v(&measured.gain_m_per_v),
        measured_deg: degrees(&measured.phase_rad),
        models: log.models.iter().map(model).collect::<Option<_>>()?,
        noise_um_per_v: um_per_v(&measured.gain_sigma_m_per_v),
        coherence: measured.coherence,
        frequency_hz: measured.frequency_hz,
        ..ResponseView::default()
    })
}
