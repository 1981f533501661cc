//! Frequency responses of logs and of what models make of them, as pages show them.

use crate::page::{Ink, ModelResponse, ResponseView, four_digits};
use crate::spectra::{BestLinear, best_linear, frf, frf_closed_loop, segment_samples};

/// Lines that a multisine has at least; fewer are a sine.
const LEAST_LINES: usize = 20;
/// Logs whose responses are shown.
const MOST: usize = 2;
/// Longest log of whose response a diagnosis takes the spectra, 200 s at 20 kHz: they take as much memory as its columns, twice.
pub const MOST_ROWS: usize = 4_000_000;

/// A log and what models make of its command. The columns have one length.
#[derive(Debug, Clone)]
pub struct Played<'a> {
    /// Name of the log.
    pub name: &'a str,
    /// Sample time.
    pub dt_s: f64,
    /// Period of the command in samples as the log states it, if it does.
    pub period_samples: Option<usize>,
    /// What a loop was to follow, if one was closed: the plain estimate would be wrong there.
    pub reference_m: Option<&'a [f64]>,
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
        let mut all: Vec<_> = logs.iter().collect();
        all.sort_by(|a, b| seconds(b).total_cmp(&seconds(a)));
        found.extend(all.into_iter().find_map(by_welch));
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
        caption: in_words(&measured),
        measured_um_per_v: um_per_v(&measured.gain_m_per_v),
        measured_deg: degrees(&measured.phase_rad),
        models: log.models.iter().map(model).collect::<Option<_>>()?,
        noise_um_per_v: um_per_v(&measured.noise_m_per_v),
        distortion_um_per_v: um_per_v(&measured.distortion_m_per_v),
        frequency_hz: measured.frequency_hz,
        ..ResponseView::default()
    })
}

/// What the spread of periods and realisations says, and what comes out at lines that were not driven.
fn in_words(found: &BestLinear) -> String {
    let um = |rms_m: f64| four_digits(1e6 * rms_m, "µm");
    let mut text = if found.n_realisations > 1 {
        let mut shares: Vec<f64> =
            found.total_m_per_v.iter().zip(&found.gain_m_per_v).map(|(t, gain)| t / gain).collect();
        shares.sort_by(f64::total_cmp);
        format!(
            "{} periods each of {} realisations. Noise is what differs between periods, in the mean over all of them; distortion is what differs \
             between realisations beyond that, in one of them: {:.1} times what of it is in the curve. Both leave the curve uncertain by {} of \
             its gain (median of the lines).",
            found.n_periods,
            found.n_realisations,
            (found.n_realisations as f64).sqrt(),
            four_digits(100.0 * shares.get(shares.len() / 2).copied().unwrap_or(f64::NAN), "%"),
        )
    } else {
        format!(
            "{} periods of one realisation: noise is what differs between them, in their mean; distortion would take several realisations.",
            found.n_periods
        )
    };
    let strongest = found.silent.iter().max_by(|a, b| a.amplitude_m.total_cmp(&b.amplitude_m));
    let Some(strongest) = strongest.filter(|line| line.amplitude_m > 0.0) else { return text };
    let silent = match (found.is_odd, found.odd_rms_m, found.even_rms_m) {
        (true, Some(odd_m), Some(even_m)) => {
            format!("{} at odd lines (odd distortion) and {} at even ones (even distortion)", um(odd_m), um(even_m))
        }
        (true, None, Some(even_m)) => format!("{} at even lines (even distortion)", um(even_m)),
        (_, odd_m, even_m) => {
            let both_m = odd_m.unwrap_or_default().hypot(even_m.unwrap_or_default());
            format!("{}, odd and even distortion in one, as even lines were driven too", um(both_m))
        }
    };
    text += &format!(
        " At lines that were not driven come out, in rms beside {} at those driven and without the noise: {silent}. The strongest is at {}, {} in \
         amplitude, where noise alone gives {}.",
        um(found.linear_rms_m),
        four_digits(strongest.frequency_hz, "Hz"),
        um(strongest.amplitude_m),
        um(strongest.noise_m)
    );
    text
}

/// In a loop the sensor's noise reaches the command, which makes the plain estimate wrong; the reference has none of it. A board that
/// follows nothing logs a reference of zero.
fn by_welch(log: &Played<'_>) -> Option<ResponseView> {
    let segment = segment_samples(log.measured_m.len());
    let reference_m = log.reference_m.filter(|reference_m| reference_m.iter().any(|asked_m| *asked_m != 0.0));
    let of = |y: &[f64]| match reference_m {
        Some(reference_m) => frf_closed_loop(reference_m, log.drive_v, y, log.dt_s, segment),
        None => frf(log.drive_v, y, log.dt_s, segment),
    };
    let measured = of(log.measured_m)?;
    let model = |&(name, ink, y): &(_, _, &[f64])| of(y).map(|r| of_model(name, ink, &r.gain_m_per_v, &r.phase_rad));
    let caption = match reference_m {
        Some(_) => {
            "By Welch's method with the reference as the instrument, as the loop brings the sensor's noise into the drive; where the \
             coherence with the reference is low, that holds too little power."
        }
        None => "By Welch's method; where the coherence is low, the drive holds too little power.",
    };
    Some(ResponseView {
        title: format!("Frequency response, {}", log.name),
        caption: caption.to_owned(),
        measured_um_per_v: um_per_v(&measured.gain_m_per_v),
        measured_deg: degrees(&measured.phase_rad),
        models: log.models.iter().map(model).collect::<Option<_>>()?,
        noise_um_per_v: um_per_v(&measured.gain_sigma_m_per_v),
        coherence: measured.coherence,
        frequency_hz: measured.frequency_hz,
        ..ResponseView::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectra::tests::{lag, lag_response, loop_around_lag, white};

    const DT_S: f64 = 1e-4;

    fn played<'a>(drive_v: &'a [f64], measured_m: &'a [f64], models: &'a [f64]) -> Played<'a> {
        let models = vec![("model", Ink::Model, models)];
        Played { name: "log", dt_s: DT_S, period_samples: None, reference_m: None, drive_v, measured_m, models }
    }

    /// Worst error of the measured gain, relative.
    fn worst(view: &ResponseView, a: f64) -> f64 {
        let errors = view.frequency_hz.iter().zip(&view.measured_um_per_v);
        errors.map(|(hz, gain)| (1e-6 * gain / lag_response(a, hz * DT_S).0 - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_loops_response_is_that_of_the_plant() {
        let (a, n) = (0.8, 100_000);
        let [reference, command, measured] = loop_around_lag(a, n, 0.5);
        let model = lag(&command, a);
        let following =
            |reference_m: Option<&[f64]>| responses(&[Played { reference_m, ..played(&command, &measured, &model) }]);
        let (plain, looped) = (following(None), following(Some(&reference)));
        // 4096 lines of 23 averages are told to some 15 % each, four times that at worst; the plain estimate is off by a bias.
        let rms = |view: &ResponseView| {
            let of = view.frequency_hz.iter().zip(&view.measured_um_per_v).zip(&view.noise_um_per_v);
            let normal = of.map(|((hz, gain), sigma)| ((gain - 1e6 * lag_response(a, hz * DT_S).0) / sigma).powi(2));
            (normal.sum::<f64>() / view.frequency_hz.len() as f64).sqrt()
        };
        assert!(rms(&looped[0]) < 1.2, "{}", rms(&looped[0]));
        assert!(rms(&plain[0]) > 1.5, "{}", rms(&plain[0]));
        assert!(looped[0].caption.contains("instrument") && !plain[0].caption.contains("instrument"));
        // The model has no noise: it is right by both.
        let of_model =
            ResponseView { measured_um_per_v: looped[0].models[0].gain_um_per_v.clone(), ..looped[0].clone() };
        assert!(worst(&of_model, a) < 0.1, "{}", worst(&of_model, a));
        // A board in open loop logs a reference of zero; one that is held tells nothing.
        let still = vec![0.0; n];
        assert_eq!(following(Some(&still))[0].measured_um_per_v, plain[0].measured_um_per_v);
        assert!(following(Some(&vec![2.0; n])).is_empty());
    }

    #[test]
    fn distortion_is_told_in_words() {
        // Odd lines with every fourth left out, three periods each of two realisations; a square makes even distortion only.
        const PERIOD: usize = 1000;
        let lines: Vec<usize> = (0..40).filter(|idx| idx % 4 != 2).map(|idx| 2 * idx + 1).collect();
        let realisation = |seed: u64| {
            let phases = white(lines.len(), seed);
            let angle =
                |k: usize, n: usize, phase: f64| std::f64::consts::TAU * (k * n) as f64 / PERIOD as f64 + 10.0 * phase;
            let one = (0..PERIOD)
                .map(|n| lines.iter().zip(&phases).map(|(&k, phase)| angle(k, n, *phase).cos()).sum::<f64>());
            one.collect::<Vec<f64>>().repeat(3)
        };
        let command = [realisation(1), realisation(2)].concat();
        let squared: Vec<f64> = command.iter().map(|u| 1e-6 * (u + 0.01 * u * u)).collect();
        let view = &responses(&[played(&command, &squared, &squared)])[0];
        let caption = &view.caption;
        assert!(caption.contains("2 periods each of 2 realisations"), "{caption}");
        assert!(caption.contains("in one of them: 1.4 times"), "{caption}");
        let found = best_linear(&command, &squared, DT_S, None).expect("periodic");
        let (odd_m, even_m) = (found.odd_rms_m.expect("odd lines"), found.even_rms_m.expect("even lines"));
        let um = |rms_m: f64| four_digits(1e6 * rms_m, "µm");
        let told = format!("{} at odd lines (odd distortion) and {} at even ones", um(odd_m), um(even_m));
        assert!(caption.contains(&told) && odd_m < 1e-3 * even_m, "{caption}");
        let even = caption.split(" and ").find_map(|part| part.split_once(" µm at even ones"));
        let even_um: f64 = even.expect(caption).0.parse().expect(caption);
        // Of 30 cosines of amplitude 1, u^2 has a rms of about sqrt(2) 15 about its mean.
        assert!((0.15..0.25).contains(&even_um), "{caption}");
        // One realisation has no distortion of its own.
        let first = responses(&[played(&command[..3 * PERIOD], &squared[..3 * PERIOD], &squared[..3 * PERIOD])]);
        assert!(first[0].caption.starts_with("2 periods of one realisation"), "{}", first[0].caption);
    }
}
