//! Metrics against closed forms: a second-order step, sines whose period isn't a whole number of samples, and a fit by hand.

use plant_sim::metrics::{Score, Task, loop_metrics};
use std::f64::consts::{PI, TAU};

#[test]
fn a_second_order_step_has_the_figures_of_the_textbook() {
    // Damping 0.5: overshoot exp(-pi zeta / sqrt(1 - zeta^2)) = 16.303 %.
    let (zeta, omega, dt_s, height_m) = (0.5, 1000.0, 1e-6, 40e-6);
    let damped = omega * f64::sqrt(1.0 - zeta * zeta);
    let y =
        |t: f64| 1.0 - (-zeta * omega * t).exp() * ((damped * t).cos() + zeta * omega / damped * (damped * t).sin());
    for sign in [1.0, -1.0] {
        let displacement_m: Vec<f64> = (0..30_000).map(|k| sign * height_m * y(f64::from(k) * dt_s)).collect();
        let reference_m = vec![sign * height_m; 30_000];
        let m = loop_metrics(Task::Step { height_m: sign * height_m }, dt_s, Some(&reference_m), &displacement_m);
        let overshoot = 100.0 * (-PI * zeta / f64::sqrt(1.0 - zeta * zeta)).exp();
        // The peak lies up to half a sample beside a sample: (omega dt)^2 / 8 = 1e-7.
        assert!((m.overshoot_percent.expect("a step") - overshoot).abs() < 1e-4);
        // Roots of y(t) = 0.1, 0.9 and the last of |y - 1| = 0.02 by bisection, in the brackets that a plot shows.
        let root = |level: f64, mut low: f64, mut high: f64| {
            let below = y(low) < level;
            for _ in 0..60 {
                let middle = (low + high) / 2.0;
                if (y(middle) < level) == below { low = middle } else { high = middle }
            }
            low
        };
        let rise_ms = 1e3 * (root(0.9, 0.0, 3.0e-3) - root(0.1, 0.0, 3.0e-3));
        // Interpolation within a sample errs by the square of its length: 1e-6 of a sample's 1e-3 ms.
        assert!((m.rise_ms.expect("a step") - rise_ms).abs() < 1e-6, "{:?} {rise_ms}", m.rise_ms);
        let settled_ms = 1e3 * root(0.98, 7.3e-3, 9.0e-3);
        assert!(
            (m.settle_2_percent_ms.expect("a step") - settled_ms).abs() < 1e-6,
            "{:?} {settled_ms}",
            m.settle_2_percent_ms
        );
        assert_eq!((m.gain, m.phase_deg), (None, None));
    }
}

#[test]
fn a_step_that_does_not_arrive_has_no_figures() {
    let reference_m = vec![1e-6; 100];
    let half: Vec<f64> = (0..100).map(|k| 0.5e-6 * (1.0 - (-0.1 * f64::from(k)).exp())).collect();
    let m = loop_metrics(Task::Step { height_m: 1e-6 }, 1e-3, Some(&reference_m), &half);
    assert_eq!((m.rise_ms, m.settle_2_percent_ms, m.overshoot_percent), (None, None, Some(0.0)));
}

#[test]
fn a_sine_s_figures_don_t_depend_on_how_its_period_falls_on_samples() {
    let (gain, lag_deg) = (0.8, 30.0f64);
    for (hz, rate_hz) in [(100.0, 20e3), (150.0, 20e3), (150.0, 40e3), (70.0, 1e3), (333.3, 10e3)] {
        let rows = (3.0 * rate_hz / hz) as usize;
        let sine = |k: usize, lag: f64| (TAU * hz * k as f64 / rate_hz - lag).sin();
        let reference_m: Vec<f64> = (0..rows).map(|k| 1e-4 * sine(k, 0.0)).collect();
        // A third harmonic of 10 %, as hysteresis makes one, must not leak into the fundamental.
        let displacement_m: Vec<f64> = (0..rows)
            .map(|k| 1e-4 * (gain * sine(k, lag_deg.to_radians()) + 0.1 * (3.0 * TAU * hz * k as f64 / rate_hz).sin()))
            .collect();
        let task = Task::Sine { amplitude_m: 1e-4, hz };
        let m = loop_metrics(task, 1.0 / rate_hz, Some(&reference_m), &displacement_m);
        // rms of 1 - 0.8 exp(-i 30 deg) over sqrt(2), and the harmonic's.
        let square = 1.0 + gain * gain - 2.0 * gain * lag_deg.to_radians().cos() + 0.01;
        let error_percent = 100.0 * (square / 2.0).sqrt();
        // Whole periods are exact to rounding; others err by the square of a sample's phase (TAU hz / rate, here up to 0.44).
        let fraction = (rate_hz / hz).fract();
        let allowed = if fraction == 0.0 { 1e-12 } else { 0.05 * (TAU * hz / rate_hz).powi(2) };
        let (g, p, e) = (m.gain.expect("a sine"), m.phase_deg.expect("a sine"), m.rms_error_percent.expect("a sine"));
        assert!((g / gain - 1.0).abs() < allowed, "{hz} at {rate_hz}: gain {g}");
        assert!((p + lag_deg).to_radians().abs() < allowed, "{hz} at {rate_hz}: phase {p}");
        assert!((e / error_percent - 1.0).abs() < allowed, "{hz} at {rate_hz}: error {e}, {error_percent}");
    }
    // Less than a period says nothing, exactly one does.
    let short: Vec<f64> = (0..199).map(|k| (TAU * 100.0 * f64::from(k) / 20e3).sin()).collect();
    let task = Task::Sine { amplitude_m: 1.0, hz: 100.0 };
    assert_eq!(loop_metrics(task, 5e-5, Some(&short), &short).gain, None);
    let whole: Vec<f64> = (0..200).map(|k| (TAU * 100.0 * f64::from(k) / 20e3).sin()).collect();
    assert!((loop_metrics(task, 5e-5, Some(&whole), &whole).gain.expect("one period") - 1.0).abs() < 1e-15);
}

#[test]
fn the_fit_is_that_of_the_definition() {
    let measured = [1.0, 4.0, -2.0, 5.0, 0.5, 3.0];
    let predicted = [1.5, 3.0, -1.0, 5.5, 0.0, 2.0];
    let mut score = Score::default();
    for (y, p) in measured.iter().zip(predicted) {
        // A mean of a thousand times the spread, to find cancellation.
        score.add(1e-6 * (y + 1e3), 1e-6 * (p + 1e3));
    }
    let n = measured.len() as f64;
    let mean = measured.iter().sum::<f64>() / n;
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let residuals: Vec<f64> = measured.iter().zip(predicted).map(|(y, p)| y - p).collect();
    let shift = residuals.iter().sum::<f64>() / n;
    let spread = norm(&mut measured.iter().map(|y| y - mean));
    // 1e3 of offset in a number of 1 costs three of sixteen digits.
    let close = |a: f64, b: f64| (a - b).abs() < 1e-11 * b.abs();
    assert!(close(score.fit_percent(false), 100.0 * (1.0 - norm(&mut residuals.iter().copied()) / spread)));
    assert!(close(score.fit_percent(true), 100.0 * (1.0 - norm(&mut residuals.iter().map(|r| r - shift)) / spread)));
    assert!(close(score.rms_m(false), 1e-6 * norm(&mut residuals.iter().copied()) / n.sqrt()));
    assert!(close(score.offset_m(), 1e-6 * shift));
    assert_eq!(score.rows(), 6);
}
