//! The three report pages from made data: `cargo run -p gap-diagnosis --example pages -- OUTDIR`.
//!
//! The "bench" is a gain with one friction element (a play of 8 V) behind it and noise; the "model" a play of 6 V with a little less gain.
//! Nothing here is physics to rely on: it is the shortest code that gives loops, a residual with structure and a parameter table.

use std::path::Path;

use gap_diagnosis::page::{
    FittedLog, FittedParameter, IdentifyView, Kept, ReplayView, SimulationView, SpectrumView, StartView, identify_page,
    replay_page, simulation_page,
};

const RATE_HZ: f64 = 10_000.0;

fn main() -> std::io::Result<()> {
    let Some(directory) = std::env::args().nth(1) else {
        eprintln!("usage: cargo run -p gap-diagnosis --example pages -- OUTDIR");
        std::process::exit(2);
    };
    let directory = Path::new(&directory);
    std::fs::create_dir_all(directory)?;

    let n_samples = 40_000;
    let time_s: Vec<f64> = (0..n_samples).map(|k| f64::from(k) / RATE_HZ).collect();
    let command_v: Vec<f64> =
        time_s.iter().map(|t| 60.0 * (1.0 - 0.2 * t) * (std::f64::consts::TAU * 2.0 * t).sin()).collect();
    let noise = made_noise(time_s.len(), 0.15);
    let measured_um: Vec<f64> = play(&command_v, 1.45, 8.0).iter().zip(&noise).map(|(y, e)| y + e).collect();
    let predicted_um = play(&command_v, 1.42, 6.5);
    let residual_um: Vec<f64> = measured_um.iter().zip(&predicted_um).map(|(y, p)| y - p).collect();
    let rms_um = (residual_um.iter().map(|e| e * e).sum::<f64>() / residual_um.len() as f64).sqrt();
    let correlation = autocorrelation(&residual_um, 200);
    let provenance = ["cargo run -p gap-diagnosis --example pages".to_owned(), "seed 1, made data".to_owned()];

    let reference_um: Vec<f64> = time_s.iter().map(|t| if t.fract() < 0.5 { 60.0 } else { -60.0 }).collect();
    let followed_um = first_order_lag(&reference_um, 0.02);
    let drive_v: Vec<f64> =
        reference_um.iter().zip(&followed_um).map(|(r, y)| (0.5 * r + 0.6 * (r - y)).clamp(-90.0, 90.0)).collect();
    simulation_page(&SimulationView {
        title: "Simulation: square wave, ±60 µm at 1 Hz",
        subtitle: "thesis plant, controller pi1, 10 kHz, delay 10 µs",
        headline: "The plant follows within 2 % of the step in 78 ms and overshoots by nothing.",
        time_s: &time_s,
        reference_um: Some(&reference_um),
        displacement_um: &followed_um,
        command_v: &drive_v,
        error_um: None,
        metrics: &[
            ("rise time".into(), "43.94 ms".into()),
            ("overshoot".into(), "0 %".into()),
            ("settling, 2 %".into(), "78.24 ms".into()),
            ("rms error".into(), "16.97 µm".into()),
            ("peak drive".into(), "90.00 V".into()),
            ("limited samples".into(), "312".into()),
        ],
        warnings: &["The drive reached its limit of 90 V in 312 samples; the response there is the amplifier's, not the controller's.".into()],
        provenance: &provenance,
    })
    .save(&directory.join("simulate.html"))?;

    let frequency_hz: Vec<f64> = (1..4000).map(|k| f64::from(k) * 1.25).collect();
    let density: Vec<f64> = frequency_hz
        .iter()
        .map(|f| 0.0021 + 0.4 / (1.0 + (f / 2.0).powi(2)) + 0.004 / (1.0 + ((f - 330.0) / 15.0).powi(2)))
        .collect();
    let measured_density: Vec<f64> = frequency_hz.iter().map(|f| 0.0021 + 40.0 / (1.0 + (f / 3.0).powi(2))).collect();
    replay_page(&ReplayView {
        title: "Replay: bench-2026-11-03.csv",
        subtitle: "models/fitted.toml driven with the logged command, open loop",
        headline: "The model reproduces 97 % of the log; what is left follows the command and is not noise.",
        time_s: &time_s,
        kept: Kept::all(time_s.len()),
        command_v: &command_v,
        measured_um: &measured_um,
        predicted_um: &predicted_um,
        autocorrelation: &correlation,
        n_residuals: residual_um.len(),
        spectrum: Some(SpectrumView {
            frequency_hz: &frequency_hz,
            residual_um_per_sqrt_hz: &density,
            measured_um_per_sqrt_hz: Some(&measured_density),
        }),
        metrics: &[
            ("rms residual".into(), gap_diagnosis::page::four_digits(rms_um, "µm")),
            ("fit".into(), "97.12 %".into()),
        ],
        warnings: &[],
        provenance: &provenance,
    })
    .save(&directory.join("replay.html"))?;

    let log = |name| FittedLog {
        name,
        time_s: &time_s,
        command_v: &command_v,
        measured_um: &measured_um,
        predicted_um: &predicted_um,
        autocorrelation: &correlation,
        n_residuals: residual_um.len(),
        rms_um,
        noise_um: 0.02,
        fit_percent: 97.12,
    };
    let parameter = |name, unit, value, sigma, prior, note| FittedParameter { name, unit, value, sigma, prior, note };
    let starts: Vec<StartView> = (0..20)
        .map(|k| StartView {
            initial_rms_um: 6.0 + f64::from((k * 7) % 20),
            final_rms_um: if k % 6 == 5 { 4.1 + 0.02 * f64::from(k) } else { rms_um },
        })
        .collect();
    identify_page(&IdentifyView {
        title: "Identification: two hysterons",
        subtitle: "port-Hamiltonian plant fitted to 2 logs",
        headline: "Noise floor not reached on either log; four of six parameters are well seen.",
        logs: &[log("model.csv"), log("ladder.csv")],
        parameters: &[
            parameter("k0", "N/m", 1.234e6, Some(0.0012), 1.2e6, "fitted"),
            parameter("k1", "N/m", 2.5e5, Some(0.013), 2.9e5, "fitted"),
            parameter("d1", "N s/m", 71.2, Some(0.41), 70.0, "fitted"),
            parameter(
                "beta1",
                "",
                1.0,
                None,
                1.0,
                "these logs can't see it; kept at its prior: its dead zone never opens",
            ),
            parameter("gamma2", "µm", 3.21e-7, Some(0.02), 3.2e-7, "fitted"),
            FittedParameter {
                name: "latency",
                unit: "µs",
                value: 88.13,
                sigma: Some(0.004),
                prior: 90.0,
                note: "fitted",
            },
        ],
        starts: &starts,
        orders: &[],
        responses: &[],
        metrics: &[
            ("AIC".into(), "−84210".into()),
            ("BIC".into(), "−84158".into()),
            ("starts at the minimum".into(), "17 of 20".into()),
        ],
        warnings: &[],
        provenance: &provenance,
    })
    .save(&directory.join("identify.html"))?;
    println!("{}", directory.display());
    Ok(())
}

/// A play of half-width `width_v`: the output moves only when the command pushes it.
fn play(command_v: &[f64], gain: f64, width_v: f64) -> Vec<f64> {
    let mut at_v = 0.0_f64;
    command_v
        .iter()
        .map(|&command_v| {
            at_v = at_v.clamp(command_v - width_v, command_v + width_v);
            gain * (0.6 * at_v + 0.4 * command_v)
        })
        .collect()
}

fn first_order_lag(input: &[f64], time_constant_s: f64) -> Vec<f64> {
    let mut state = 0.0;
    input
        .iter()
        .map(|value| {
            state += (value - state) / (time_constant_s * RATE_HZ);
            state
        })
        .collect()
}

/// Sum of twelve uniform numbers less six: normal enough for a picture.
fn made_noise(n: usize, sigma: f64) -> Vec<f64> {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n).map(|_| sigma * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)).collect()
}

fn autocorrelation(residual: &[f64], n_lags: usize) -> Vec<f64> {
    let power: f64 = residual.iter().map(|e| e * e).sum();
    (0..=n_lags).map(|lag| residual.iter().zip(&residual[lag..]).map(|(a, b)| a * b).sum::<f64>() / power).collect()
}
