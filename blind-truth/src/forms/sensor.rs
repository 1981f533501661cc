//! Forms of the sensor's effects and of what couples into it.

use super::{C, CR, D, DC, DCR, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::bench::Bench;
use crate::digitise::Digitise;
use crate::effects::EffectId::*;
use crate::sensor::{Follow, Measure};
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: SensorBandwidth, name: "first-order lag", splits: DC, draw: lag },
    Form { effect: SensorBandwidth, name: "second order", splits: C, draw: second_order },
    Form { effect: SensorBandwidth, name: "two lags", splits: R, draw: two_lags },
    Form { effect: SensorBandwidth, name: "second order, under-damped", splits: R, draw: ringing },
    Form { effect: SensorBandwidth, name: "lag that part of the signal runs past", splits: C, draw: lead_lag },
    Form { effect: SensorBandwidth, name: "small share in a slow tail", splits: C, draw: slow_tail },
    Form { effect: SensorBandwidth, name: "mixed with the mean of the last rows", splits: C, draw: smoothing },
    Form { effect: SensorBandwidth, name: "peak detector, slower back", splits: C, draw: peak_detector },
    Form { effect: SensorBandwidth, name: "lag that grows along the stroke", splits: C, draw: lag_by_stroke },
    Form { effect: SensorOffset, name: "constant", splits: D, draw: offset },
    Form { effect: SensorOffset, name: "constant, beyond zeroing", splits: C, draw: offset_large },
    Form { effect: SensorOffset, name: "another one in each log", splits: R, draw: offset_per_log },
    Form { effect: SensorOffset, name: "constant, settling by a little", splits: C, draw: offset_settling },
    Form { effect: SensorOffset, name: "constant, with a small slip in each log", splits: C, draw: offset_slipping },
    Form { effect: SensorOffset, name: "stand-off, with its change of gain", splits: C, draw: offset_stand_off },
    Form { effect: SensorOffset, name: "constant, breathing by a little", splits: C, draw: offset_breathing },
    Form { effect: SensorOffset, name: "constant, with a contact that chatters", splits: C, draw: offset_chattering },
    Form {
        effect: SensorOffset,
        name: "constant, of a tilted head with its curvature",
        splits: C,
        draw: offset_tilted,
    },
    Form {
        effect: SensorOffset,
        name: "constant, from a reference with slow noise",
        splits: C,
        draw: offset_slow_noise,
    },
    Form {
        effect: SensorOffset,
        name: "constant, of a ground loop with its faint hum",
        splits: C,
        draw: offset_ground_loop,
    },
    Form { effect: SensorGain, name: "constant", splits: DCR, draw: gain },
    Form { effect: SensorGain, name: "another one in each log", splits: R, draw: gain_per_log },
    Form { effect: SensorGain, name: "settling after switching on", splits: C, draw: gain_settling },
    Form { effect: SensorGain, name: "misaligned, with a little curvature", splits: C, draw: gain_misaligned },
    Form { effect: SensorGain, name: "about a point off zero", splits: C, draw: gain_off_zero },
    Form { effect: SensorGain, name: "larger error of one half bridge", splits: C, draw: gain_by_sign },
    Form { effect: SensorGain, name: "breathing with its reference", splits: C, draw: gain_breathing },
    Form { effect: SensorGain, name: "another one from a moment on", splits: C, draw: gain_stepping },
    Form { effect: SensorGain, name: "gives in while deflected", splits: C, draw: gain_controlled },
    Form { effect: SensorDrift, name: "linear", splits: D, draw: drift_linear },
    Form { effect: SensorDrift, name: "thermal, first order", splits: DC, draw: drift_thermal },
    Form { effect: SensorDrift, name: "random walk", splits: R, draw: drift_walk },
    Form { effect: SensorDrift, name: "linear and thermal", splits: CR, draw: drift_both },
    Form { effect: SensorDrift, name: "root of time", splits: C, draw: drift_root },
    Form { effect: SensorDrift, name: "slow sine", splits: C, draw: drift_swing },
    Form { effect: SensorDrift, name: "a slip that settles", splits: C, draw: drift_slip },
    Form { effect: SensorDrift, name: "two bodies against each other", splits: C, draw: drift_two_bodies },
    Form { effect: SensorDrift, name: "logarithm of time", splits: C, draw: drift_log },
    Form { effect: SensorDrift, name: "heat through another body", splits: C, draw: drift_late },
    Form { effect: SensorDrift, name: "linear from a moment on", splits: C, draw: drift_from },
    Form { effect: SensorDrift, name: "in jerks", splits: C, draw: drift_jerks },
    Form { effect: SensorDrift, name: "heater on and off", splits: C, draw: drift_thermostat },
    Form { effect: SensorNonlinearity, name: "polynomial of third degree", splits: DC, draw: polynomial },
    Form { effect: SensorNonlinearity, name: "compression towards the ends", splits: C, draw: compression },
    Form { effect: SensorNonlinearity, name: "periodic error of an encoder", splits: R, draw: ripple },
    Form { effect: SensorNonlinearity, name: "compression off centre", splits: R, draw: compression_off_centre },
    Form { effect: SensorNonlinearity, name: "fourth and fifth degree", splits: C, draw: high_polynomial },
    Form { effect: SensorNonlinearity, name: "calibration table, straight between nodes", splits: C, draw: table },
    Form { effect: SensorNonlinearity, name: "kink at zero", splits: C, draw: kink },
    Form { effect: SensorNonlinearity, name: "local flaw of the target", splits: C, draw: flaw },
    Form { effect: SensorNonlinearity, name: "steps where the converter carries", splits: C, draw: carries },
    Form { effect: SensorNonlinearity, name: "other slope about zero", splits: C, draw: hollow },
];

/// Corner from 320 Hz to 160 kHz.
const LAG_S: (f64, f64) = (1e-6, 5e-4);

fn lag(_: &mut Pcg64) -> Planted {
    Planted::new("tau_s", LAG_S, |a, bench| bench.follows.push(Follow::Lag { tau_s: a }))
}

fn two_lags(_: &mut Pcg64) -> Planted {
    Planted::new("tau_s", LAG_S, |a, bench| bench.follows.push(Follow::TwoLags { tau_s: a }))
}

fn second_order_of(damping_ratio: f64) -> Planted {
    Planted::new("delay_s", LAG_S, move |a, bench| {
        bench.follows.push(Follow::SecondOrder { rad_per_s: 2.0 * damping_ratio / a, damping_ratio });
    })
    .with("damping_ratio", damping_ratio)
}

fn second_order(rng: &mut Pcg64) -> Planted {
    second_order_of(rng.random_range(0.55..0.75))
}

fn ringing(rng: &mut Pcg64) -> Planted {
    second_order_of(rng.random_range(0.3..0.6))
}

fn lead_lag(rng: &mut Pcg64) -> Planted {
    let past = rng.random_range(0.2..0.6);
    Planted::new("tau_s", (1.5e-6, 1e-3), move |a, bench| bench.follows.push(Follow::LeadLag { tau_s: a, past }))
        .with("share_past", past)
}

fn slow_tail(rng: &mut Pcg64) -> Planted {
    // Charge that a guard or a cable gives back late: most of the signal is fast.
    let tau_s = log_uniform(rng, 3e-4, 3e-3);
    Planted::new("late_share", (0.001, 0.7), move |a, bench| {
        bench.follows.push(Follow::LeadLag { tau_s, past: 1.0 - a });
    })
    .with("tau_s", tau_s)
}

fn smoothing(rng: &mut Pcg64) -> Planted {
    let rows = rng.random_range(2..=6);
    Planted::new("weight", (0.002, 1.0), move |a, bench| {
        bench.measures.push(Measure::Smoothing { weight: a, rows });
    })
    .with("rows", f64::from(rows))
}

fn offset(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("offset_m", (5e-8, 2e-5), move |a, bench| bench.measures.push(Measure::Offset(sign * a)))
        .with("sign", sign)
}

/// Where every bench has an offset of up to 1 um, only a larger one is an effect.
const LARGE_OFFSET_M: (f64, f64) = (2.5e-6, 10e-6);

fn offset_large(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| bench.measures.push(Measure::Offset(sign * a)))
        .with("sign", sign)
        .any_gap()
}

fn offset_per_log(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| {
        bench.measures.push(Measure::OffsetPerLog { m: sign * a, spread_m: 0.3 * a });
    })
    .with("sign", sign)
    .with("spread_over_mean", 0.3)
    .any_gap()
}

fn offset_settling(rng: &mut Pcg64) -> Planted {
    let (sign, share, tau_s) = (sign(rng), log_uniform(rng, 0.01, 0.05), log_uniform(rng, 0.1, 1.0));
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| {
        bench.measures.push(Measure::Offset(sign * a));
        bench.measures.push(Measure::ThermalDrift { m: -sign * share * a, tau_s });
    })
    .with("sign", sign)
    .with("settling_share", share)
    .with("tau_s", tau_s)
    .any_gap()
}

fn offset_slipping(rng: &mut Pcg64) -> Planted {
    let (signs, share) = ([sign(rng), sign(rng)], log_uniform(rng, 0.01, 0.05));
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| {
        bench.measures.push(Measure::Offset(signs[0] * a));
        bench.measures.push(Measure::Slip { m: signs[1] * share * a, tau_s: 2e-3, within_s: 0.5 });
    })
    .with("sign", signs[0])
    .with("slip_share", signs[1] * share)
    .any_gap()
}

fn offset_stand_off(rng: &mut Pcg64) -> Planted {
    let (signs, per_m) = ([sign(rng), sign(rng)], log_uniform(rng, 200.0, 1000.0));
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| {
        // The probe sits nearer or farther by the offset; its gain follows by up to a percent.
        bench.measures.push(Measure::Gain(1.0 + signs[1] * per_m * a));
        bench.measures.push(Measure::Offset(signs[0] * a));
    })
    .with("sign", signs[0])
    .with("gain_per_offset_1_per_m", signs[1] * per_m)
    .any_gap()
}

fn gain(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("gain_error", (0.001, 0.2), move |a, bench| bench.measures.push(Measure::Gain(1.0 + sign * a)))
        .with("sign", sign)
}

fn gain_per_log(rng: &mut Pcg64) -> Planted {
    let (sign, spread) = (sign(rng), rng.random_range(0.05..0.2));
    Planted::new("gain_error", (0.001, 0.2), move |a, bench| {
        bench.measures.push(Measure::GainPerLog { gain: 1.0 + sign * a, spread: spread * a });
    })
    .with("sign", sign)
    .with("spread_over_mean", spread)
}

fn gain_settling(rng: &mut Pcg64) -> Planted {
    let (sign, share, tau_s) = (sign(rng), rng.random_range(0.15..0.4), log_uniform(rng, 0.1, 1.0));
    Planted::new("gain_error", (0.001, 0.2), move |a, bench| {
        bench.measures.push(Measure::SettlingGain { error: sign * a, share, tau_s });
    })
    .with("sign", sign)
    .with("settling_share", share)
    .with("tau_s", tau_s)
}

fn gain_misaligned(rng: &mut Pcg64) -> Planted {
    let (sign, second) = (sign(rng), rng.random_range(-0.1..0.1));
    Planted::new("gain_error", (0.001, 0.2), move |a, bench| {
        bench.measures.push(Measure::Polynomial { c2: second * a / STROKE_M, c3: 0.0 });
        bench.measures.push(Measure::Gain(1.0 + sign * a));
    })
    .with("sign", sign)
    .with("second_over_first_at_stroke", second)
}

fn drift_linear(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("rate_m_per_s", (1e-9, 1e-5), move |a, bench| {
        bench.measures.push(Measure::LinearDrift { m_per_s: sign * a });
    })
    .with("sign", sign)
}

fn drift_thermal(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.3, 5.0));
    Planted::new("amplitude_m", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::ThermalDrift { m: sign * a, tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn drift_both(rng: &mut Pcg64) -> Planted {
    let (tau_s, rate) = (log_uniform(rng, 0.2, 2.0), rng.random_range(-0.5..0.5));
    Planted::new("amplitude_m", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::ThermalDrift { m: a, tau_s });
        bench.measures.push(Measure::LinearDrift { m_per_s: rate * a });
    })
    .with("tau_s", tau_s)
    .with("rate_over_amplitude_per_s", rate)
}

fn drift_walk(_: &mut Pcg64) -> Planted {
    Planted::new("walk_m_per_root_s", (1e-8, 2e-5), |a, bench| {
        bench.measures.push(Measure::RandomWalk { m_per_root_s: a });
    })
}

fn drift_root(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("m_per_root_s", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::RootDrift { m_per_root_s: sign * a });
    })
    .with("sign", sign)
}

fn drift_swing(rng: &mut Pcg64) -> Planted {
    let period_s = log_uniform(rng, 1.0, 8.0);
    Planted::new("amplitude_m", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::SwingDrift { m: a, period_s });
    })
    .with("period_s", period_s)
}

fn drift_slip(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.01, 0.3));
    Planted::new("amplitude_m", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::Slip { m: sign * a, tau_s, within_s: 0.4 });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn drift_two_bodies(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.05, 0.4));
    let (slower, back) = (rng.random_range(4.0..12.0), rng.random_range(0.6..1.3));
    Planted::new("amplitude_m", (1e-8, 3e-5), move |a, bench| {
        bench.measures.push(Measure::ThermalDrift { m: sign * a, tau_s });
        bench.measures.push(Measure::ThermalDrift { m: -sign * back * a, tau_s: slower * tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
    .with("slower_over_faster", slower)
    .with("back_share", back)
}

fn polynomial(rng: &mut Pcg64) -> Planted {
    let (sign, third) = (sign(rng), rng.random_range(-1.0..1.0));
    // Anchors F21: 0.01 to 1 % of the range, room for more.
    Planted::new("share_at_stroke", (2e-4, 0.1), move |a, bench| {
        bench.measures.push(Measure::Polynomial { c2: sign * a / STROKE_M, c3: third * a / (STROKE_M * STROKE_M) });
    })
    .with("sign", sign)
    .with("third_over_second", third)
}

fn compression_about(centre_m: f64) -> Planted {
    Planted::new("stroke_over_level", (0.02, 0.6), move |a, bench| {
        bench.measures.push(Measure::Compression { level_m: STROKE_M / a, centre_m });
    })
    .with("centre_um", centre_m * 1e6)
}

fn compression(_: &mut Pcg64) -> Planted {
    compression_about(0.0)
}

fn compression_off_centre(rng: &mut Pcg64) -> Planted {
    compression_about(sign(rng) * rng.random_range(30e-6..80e-6))
}

fn ripple(rng: &mut Pcg64) -> Planted {
    let period_m = log_uniform(rng, 10e-6, 60e-6);
    Planted::new("amplitude_m", (1e-8, 5e-6), move |a, bench| {
        bench.measures.push(Measure::Ripple { m: a, period_m });
    })
    .with("period_um", period_m * 1e6)
}

fn high_polynomial(rng: &mut Pcg64) -> Planted {
    let (sign, fifth) = (sign(rng), rng.random_range(-1.0..1.0));
    Planted::new("share_at_stroke", (2e-4, 0.1), move |a, bench| {
        let c4 = sign * a / STROKE_M.powi(3);
        bench.measures.push(Measure::HighPolynomial { c4, c5: fifth * a / STROKE_M.powi(4) });
    })
    .with("sign", sign)
    .with("fifth_over_fourth", fifth)
}

fn table(rng: &mut Pcg64) -> Planted {
    let pitch_m = rng.random_range(20e-6..30e-6);
    let mut nodes: [f64; 9] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    // Zero was set by hand.
    nodes[4] = 0.0;
    Planted::new("node_error_m", (1e-8, 1e-5), move |a, bench| {
        bench.measures.push(Measure::Table { error_m: nodes.map(|node| a * node), pitch_m });
    })
    .with("pitch_um", pitch_m * 1e6)
}

fn kink(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("gain_difference", (2e-4, 0.1), move |a, bench| {
        bench.measures.push(Measure::Kink { share: 0.5 * sign * a });
    })
    .with("sign", sign)
}

fn flaw(rng: &mut Pcg64) -> Planted {
    let (at_m, width_m) = (sign(rng) * rng.random_range(10e-6..80e-6), log_uniform(rng, 5e-6, 25e-6));
    Planted::new("height_m", (2e-8, 1e-5), move |a, bench| {
        bench.measures.push(Measure::Flaw { m: a, at_m, width_m });
    })
    .with("at_um", at_m * 1e6)
    .with("width_um", width_m * 1e6)
}

fn peak_detector(rng: &mut Pcg64) -> Planted {
    let slower = rng.random_range(1.4..3.0);
    Planted::new("tau_s", LAG_S, move |a, bench| bench.follows.push(Follow::PeakDetector { tau_s: a, slower }))
        .with("slower_back", slower)
}

fn lag_by_stroke(rng: &mut Pcg64) -> Planted {
    let more = sign(rng) * rng.random_range(0.3..0.7);
    Planted::new("tau_s", LAG_S, move |a, bench| {
        bench.follows.push(Follow::LagByStroke { tau_s: a, per_m: more / STROKE_M });
    })
    .with("more_at_stroke", more)
}

/// A large offset, and beside it what is given by its sign and size.
fn offset_and(rng: &mut Pcg64, beside: impl Fn(f64, &mut Bench) + Send + Sync + 'static) -> Planted {
    let sign = sign(rng);
    Planted::new("offset_m", LARGE_OFFSET_M, move |a, bench| {
        bench.measures.push(Measure::Offset(sign * a));
        beside(sign * a, bench);
    })
    .with("sign", sign)
    .any_gap()
}

fn offset_breathing(rng: &mut Pcg64) -> Planted {
    let (share, period_s) = (log_uniform(rng, 0.003, 0.015), log_uniform(rng, 1.0, 6.0));
    offset_and(rng, move |offset_m, bench| {
        bench.measures.push(Measure::SwingDrift { m: share * offset_m, period_s });
    })
    .with("breathing_share", share)
    .with("period_s", period_s)
}

fn offset_chattering(rng: &mut Pcg64) -> Planted {
    let (share, mean_s) = (log_uniform(rng, 0.005, 0.03), log_uniform(rng, 0.1, 0.5));
    offset_and(rng, move |offset_m, bench| bench.measures.push(Measure::Chatter { m: share * offset_m, mean_s }))
        .with("chattering_share", share)
        .with("mean_dwell_s", mean_s)
}

fn offset_tilted(rng: &mut Pcg64) -> Planted {
    // A few nanometres to a few tens of them at full stroke: the tilt that lifts the zero also bends the curve.
    let curved = sign(rng) * log_uniform(rng, 0.001, 0.006);
    offset_and(rng, move |offset_m, bench| {
        let c2 = curved * offset_m.abs() / (STROKE_M * STROKE_M);
        bench.measures.push(Measure::Polynomial { c2, c3: 0.0 });
    })
    .with("curvature_at_stroke_over_offset", curved)
}

fn offset_slow_noise(rng: &mut Pcg64) -> Planted {
    let (share, corner_hz) = (log_uniform(rng, 0.001, 0.004), log_uniform(rng, 0.5, 5.0));
    offset_and(rng, move |offset_m, bench| {
        bench.digitises.push(Digitise::Coloured { m: share * offset_m.abs(), corner_hz });
    })
    .with("noise_share", share)
    .with("corner_hz", corner_hz)
}

fn offset_ground_loop(rng: &mut Pcg64) -> Planted {
    let share = log_uniform(rng, 0.0005, 0.002);
    offset_and(rng, move |offset_m, bench| {
        let m = share * offset_m.abs();
        bench.measures.push(Measure::Hum { m, hz: 50.0, second: 0.0, third: 0.3, fifth: 0.0 });
    })
    .with("hum_share", share)
}

/// As `gain`: 0.1 to 20 %.
const GAIN: (f64, f64) = (0.001, 0.2);

fn gain_off_zero(rng: &mut Pcg64) -> Planted {
    let (sign, at_m) = (sign(rng), sign(rng) * rng.random_range(10e-6..60e-6));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.measures.push(Measure::Gain(1.0 + sign * a));
        bench.measures.push(Measure::Offset(-sign * a * at_m));
    })
    .with("sign", sign)
    .with("right_at_um", at_m * 1e6)
}

fn gain_by_sign(rng: &mut Pcg64) -> Planted {
    let (sign, lesser, down) = (sign(rng), rng.random_range(0.6..0.9), rng.random::<bool>());
    let shares = if down { (lesser, 1.0) } else { (1.0, lesser) };
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.measures.push(Measure::GainBySign { up: 1.0 + sign * shares.0 * a, down: 1.0 + sign * shares.1 * a });
    })
    .with("sign", sign)
    .with("positive_share", shares.0)
    .with("negative_share", shares.1)
}

fn gain_breathing(rng: &mut Pcg64) -> Planted {
    let (sign, share, period_s) = (sign(rng), rng.random_range(0.05..0.2), log_uniform(rng, 0.5, 4.0));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.measures.push(Measure::BreathingGain { error: sign * a, share, period_s });
    })
    .with("sign", sign)
    .with("breathing_share", share)
    .with("period_s", period_s)
}

fn gain_stepping(rng: &mut Pcg64) -> Planted {
    let (sign, later) = (sign(rng), 1.0 + sign(rng) * rng.random_range(0.1..0.35));
    Planted::new("gain_error", GAIN, move |a, bench| {
        let (error, later) = (sign * a, sign * later * a);
        bench.measures.push(Measure::SteppedGain { error, later, within_s: 0.6 });
    })
    .with("sign", sign)
    .with("later_over_first", later)
}

fn gain_controlled(rng: &mut Pcg64) -> Planted {
    let (sign, share, tau_s) = (sign(rng), rng.random_range(0.1..0.4), log_uniform(rng, 0.02, 0.3));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.measures.push(Measure::ControlledGain { error: sign * a, share, tau_s });
    })
    .with("sign", sign)
    .with("lost_at_stroke", share)
    .with("tau_s", tau_s)
}

/// 10 nm to 30 um; the band decides.
const DRIFT_M: (f64, f64) = (1e-8, 3e-5);

fn drift_log(rng: &mut Pcg64) -> Planted {
    let (sign, from_s) = (sign(rng), log_uniform(rng, 0.02, 0.5));
    Planted::new("m_per_decade", DRIFT_M, move |a, bench| {
        bench.measures.push(Measure::LogDrift { m_per_decade: sign * a, from_s });
    })
    .with("sign", sign)
    .with("from_s", from_s)
}

fn drift_late(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.15, 1.5));
    Planted::new("amplitude_m", DRIFT_M, move |a, bench| bench.measures.push(Measure::LateDrift { m: sign * a, tau_s }))
        .with("sign", sign)
        .with("tau_s", tau_s)
}

fn drift_from(rng: &mut Pcg64) -> Planted {
    let (sign, within_s) = (sign(rng), rng.random_range(0.2..0.5));
    Planted::new("rate_m_per_s", DRIFT_M, move |a, bench| {
        bench.measures.push(Measure::DriftFrom { m_per_s: sign * a, within_s });
    })
    .with("sign", sign)
    .with("starts_within_s", within_s)
}

fn drift_jerks(rng: &mut Pcg64) -> Planted {
    let (sign, mean_s) = (sign(rng), log_uniform(rng, 0.03, 0.2));
    Planted::new("mean_jerk_m", (2e-9, 5e-6), move |a, bench| {
        bench.measures.push(Measure::Jerks { m: sign * a, mean_s });
    })
    .with("sign", sign)
    .with("mean_dwell_s", mean_s)
}

fn drift_thermostat(rng: &mut Pcg64) -> Planted {
    let (period_s, on_share) = (log_uniform(rng, 0.6, 3.0), rng.random_range(0.2..0.6));
    Planted::new("amplitude_m", DRIFT_M, move |a, bench| {
        bench.measures.push(Measure::Thermostat { m: a, period_s, on_share });
    })
    .with("period_s", period_s)
    .with("on_share", on_share)
}

fn carries(rng: &mut Pcg64) -> Planted {
    let (at_m, pitch_m) = (rng.random_range(-15e-6..15e-6), rng.random_range(30e-6..50e-6));
    let sign = sign(rng);
    Planted::new("step_m", (2e-8, 5e-6), move |a, bench| {
        bench.measures.push(Measure::Carries { m: sign * a, at_m, pitch_m });
    })
    .with("sign", sign)
    .with("at_um", at_m * 1e6)
    .with("pitch_um", pitch_m * 1e6)
}

fn hollow(rng: &mut Pcg64) -> Planted {
    let (sign, width_m) = (sign(rng), log_uniform(rng, 5e-6, 30e-6));
    Planted::new("slope_difference", (5e-4, 0.2), move |a, bench| {
        bench.measures.push(Measure::Hollow { share: sign * a, width_m });
    })
    .with("sign", sign)
    .with("width_um", width_m * 1e6)
}
