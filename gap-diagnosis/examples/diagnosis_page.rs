//! The diagnosis page from made data: `cargo run -p gap-diagnosis --example diagnosis_page -- OUT.html`.
//!
//! The "bench" is a gain with a play, a slow creep and noise; the "model" lacks the creep. Numbers in the tables are made up: nothing here
//! is a diagnosis, it is the shortest code that fills every part of the page.

use gap_diagnosis::locate::{Trace, locate};
use gap_diagnosis::page::{
    ChangedView, ClassView, DiagnosedLog, DiagnosisView, EffectView, EstimateView, GapView, Ink, ModelResponse,
    NextView, RankView, ResponseView, RivalView, ShareView, UnexplainedView, diagnosis_page,
};
use std::f64::consts::TAU;

const DT_S: f64 = 5e-5;
const NOISE_UM: f64 = 0.02;

fn main() -> std::io::Result<()> {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("usage: cargo run -p gap-diagnosis --example diagnosis_page -- OUT.html");
        std::process::exit(2);
    };
    let levels_v = [0.0, 20.0, 40.0, 60.0, 30.0, 0.0, -30.0, -60.0, -20.0, 0.0];
    let logs = vec![
        made("steps.csv", 1.0, |t| levels_v[((t / 0.1) as usize).min(9)]),
        made("sines.csv", 2.2, |t| match t {
            t if t < 1.0 => 60.0 * (TAU * 4.0 * t).sin(),
            t if t < 1.4 => 60.0 * (TAU * 50.0 * (t - 1.0)).sin(),
            t => 60.0 * (-(t - 1.4) * 4.0).exp() * (TAU * 8.0 * (t - 1.4)).sin(),
        }),
        made("multisine.csv", 1.0, |t| {
            (1..40).map(|h| 4.0 * (TAU * f64::from(h * 4) * t + f64::from(h * h)).cos()).sum()
        }),
        made("hold.csv", 5.5, |t| if t < 0.3 { 0.0 } else { 40.0 }),
        DiagnosedLog {
            is_held_out: true,
            ..made("closed-loop.csv", 1.3, |t| 30.0 * (TAU * 25.0 * t).sin() + if t > 0.6 { 20.0 } else { 0.0 })
        },
    ];
    let location = located(&logs, |log| &log.refit_um);
    let location_after = located(&logs, |log| &log.augmented_um);
    let name = |text: &str| text.to_owned();
    let rank = |effect: &str, probability, note: &str| RankView { effect: name(effect), probability, note: name(note) };
    let estimate =
        |text: &str, value, sigma, unit: &str| EstimateView { name: name(text), value, sigma, unit: name(unit) };
    let rival = |effect: &str, rms_over_noise, prior_cost, probability, reason: &str| RivalView {
        effect: name(effect),
        rms_over_noise,
        prior_cost,
        probability,
        reason: name(reason),
    };
    let share = |text: &str, percent| ShareView { name: name(text), percent };
    let frequency_hz: Vec<f64> = (1..320).map(|k| 4.0 * f64::from(k)).collect();
    let gain = |corner_hz: f64| -> Vec<f64> {
        frequency_hz.iter().map(|f| 1.4 / (1.0 + (f / corner_hz).powi(2)).sqrt()).collect()
    };
    let phase =
        |corner_hz: f64| -> Vec<f64> { frequency_hz.iter().map(|f| -(f / corner_hz).atan().to_degrees()).collect() };
    let view = DiagnosisView {
        title: name("Diagnosis: bender 3, bench of 2026-11-03"),
        subtitle: name("plant models/thesis-phs.toml, 5 logs, 11.0 s at 20 kHz"),
        verdict: name(
            "The gap is creep in the actuator (97 %): with it the model's error on a log never shown falls from 0.84 to 0.04 µm, \
                       95 % of the way to the noise.",
        ),
        warnings: vec![name("steps.csv: the state at the start is not determined by the log; its interval is wide.")],
        gap: GapView {
            headline: name("held-out log closed-loop.csv"),
            nominal_rms_um: 0.84,
            refit_rms_um: 0.51,
            augmented_rms_um: 0.041,
            noise_rms_um: NOISE_UM,
            shrink_percent: 95.1,
            shrink_percent_ci95: [93.8, 96.0],
            closure_percent: 95.7,
        },
        facts: vec![
            (name("closed-loop error, predicted before"), name("0.31 µm")),
            (name(".. and after"), name("0.42 µm")),
        ],
        ranking: vec![
            rank("unknown", 0.004, ""),
            rank("creep", 0.972, "actuator"),
            rank("sensor_drift", 0.015, "sensor"),
            rank("thermal_gain", 0.006, "environment"),
            rank("extra_hysteron", 0.002, "actuator"),
            rank("no_gap", 0.0, ""),
            rank("backlash", 0.0005, "structure"),
            rank("mains_hum", 0.0005, "environment"),
        ],
        set90: vec![name("creep")],
        classes: vec![ClassView {
            effects: vec![name("sensor_gain"), name("amplifier_gain")],
            reason: name(
                "both scale the displacement by one factor; only a log of the amplifier's output tells which.",
            ),
        }],
        effects: vec![EffectView {
            effect: name("creep"),
            summary: name(
                "The ceramic keeps moving after a step: a hysteron without dead zone and with a long time constant.",
            ),
            equation: name("q_c' = (alpha u - q_c / C_c) / R_c\ny = y_nominal + sum_i w_i q_ci"),
            signature: name("the residual grows with the logarithm of the time since a step and has the step's sign."),
            source: name("Jung and Gweon 2000, creep operator"),
            parameters: vec![
                estimate("strength", 0.0123, 0.0004, ""),
                estimate("time constant", 0.81, 0.06, "s"),
                estimate("second time constant", 12.0, f64::NAN, "s"),
            ],
        }],
        shares: vec![share("creep", 88.0), share("parameter_error", 12.0)],
        changed: vec![ChangedView {
            name: name("stiffness k"),
            unit: name("N/m"),
            nominal: 2.5e5,
            refit: 2.58e5,
            sigma: 1.1e3,
        }],
        next: NextView {
            spec: Some(name("zero@5s+ladder:60V/8,hold=10s")),
            rate_hz: 20_000.0,
            splits: vec![name("creep"), name("sensor_drift")],
            reason: name("Creep follows each step's sign and size, drift goes one way whatever the drive does."),
        },
        location: Some(location),
        location_after: Some(location_after),
        responses: vec![ResponseView {
            title: name("Best linear approximation, multisine.csv"),
            caption: name(
                "Four periods: what differs between them is noise; what differs from a linear system is distortion.",
            ),
            measured_um_per_v: gain(820.0),
            measured_deg: phase(820.0),
            models: [("nominal", Ink::Error, 900.0), ("with the effects", Ink::Model, 821.0)]
                .map(|(name, ink, hz)| ModelResponse { name, ink, gain_um_per_v: gain(hz), phase_deg: phase(hz) })
                .to_vec(),
            noise_um_per_v: frequency_hz.iter().map(|_| 1e-3).collect(),
            distortion_um_per_v: frequency_hz.iter().map(|f| 0.02 / f.sqrt()).collect(),
            coherence: frequency_hz.iter().map(|f| 1.0 - 1e-4 * f).collect(),
            frequency_hz,
        }],
        screened: vec![(name("end_stop"), 4.1), (name("quantisation"), 0.2)],
        rivals: vec![
            rival(
                "sensor_drift",
                4.1,
                18.0,
                0.015,
                "A drift has one sign; the residual follows the sign of each step.",
            ),
            rival(
                "extra_hysteron",
                6.8,
                73.0,
                0.002,
                "Needs the stiffness to move by 6 sigma and still leaves the hold.",
            ),
        ],
        unexplained: Some(UnexplainedView {
            rms_um: 0.036,
            structured_share_percent: 41.0,
            max_abs_autocorrelation: 0.62,
            lag_s: 2.5e-4,
            strongest: name("71 % between 220 and 1000 Hz, in log steps.csv"),
        }),
        logs,
        provenance: vec![
            name("cargo run -p gap-diagnosis --example diagnosis_page"),
            name("made data, seed 1; hysteron 0.1.0"),
        ],
    };
    diagnosis_page(&view).save(std::path::Path::new(&path))?;
    println!("{path}");
    Ok(())
}

fn made(name: &str, seconds: f64, drive: impl Fn(f64) -> f64) -> DiagnosedLog {
    let n = (seconds / DT_S).round() as usize;
    let time_s: Vec<f64> = (0..n).map(|k| k as f64 * DT_S).collect();
    let drive_v: Vec<f64> = time_s.iter().map(|&t| drive(t)).collect();
    let (mut play_v, mut creep_v) = (0.0_f64, 0.0);
    let mut log = DiagnosedLog { name: name.to_owned(), noise_um: NOISE_UM, time_s, ..Default::default() };
    let mut state = n as u64;
    for &drive_v in &drive_v {
        play_v = play_v.clamp(drive_v - 6.0, drive_v + 6.0);
        creep_v += (drive_v - creep_v) * DT_S / 0.8;
        // A sum of twelve uniform numbers less six is normal enough for a picture.
        let noise = (0..12)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0;
        let known_um = 0.6 * drive_v + 0.8 * play_v;
        log.measured_um.push(known_um + 0.04 * creep_v + NOISE_UM * noise);
        log.nominal_um.push(0.985 * known_um);
        log.refit_um.push(1.004 * known_um);
        log.augmented_um.push(0.9998 * known_um + 0.0403 * creep_v);
    }
    log.drive_v = drive_v;
    log
}

fn located(logs: &[DiagnosedLog], predicted: fn(&DiagnosedLog) -> &Vec<f64>) -> gap_diagnosis::locate::Where {
    let metres = |values_um: &[f64]| -> Vec<f64> { values_um.iter().map(|um| 1e-6 * um).collect() };
    let columns: Vec<[Vec<f64>; 2]> = logs
        .iter()
        .map(|log| {
            let predicted_m = metres(predicted(log));
            let residual_m = metres(&log.measured_um).iter().zip(&predicted_m).map(|(y, p)| y - p).collect();
            [predicted_m, residual_m]
        })
        .collect();
    let traces: Vec<Trace<'_>> = logs
        .iter()
        .zip(&columns)
        .map(|(log, [displacement_m, residual_m])| Trace {
            name: &log.name,
            dt_s: DT_S,
            drive_v: &log.drive_v,
            displacement_m,
            residual_m,
            noise_m: 1e-6 * NOISE_UM,
        })
        .collect();
    locate(&traces)
}
