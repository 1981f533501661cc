//! Forms of the sensor's effects and of what couples into it.

use super::{C, CR, D, DC, DCR, Form, Planted, R, STROKE_M, log_uniform, sign};
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
    Form { effect: SensorOffset, name: "constant", splits: D, draw: offset },
    Form { effect: SensorOffset, name: "constant, beyond zeroing", splits: C, draw: offset_large },
    Form { effect: SensorOffset, name: "another one in each log", splits: R, draw: offset_per_log },
    Form { effect: SensorOffset, name: "constant, settling by a little", splits: C, draw: offset_settling },
    Form { effect: SensorOffset, name: "constant, with a small slip in each log", splits: C, draw: offset_slipping },
    Form { effect: SensorOffset, name: "stand-off, with its change of gain", splits: C, draw: offset_stand_off },
    Form { effect: SensorGain, name: "constant", splits: DCR, draw: gain },
    Form { effect: SensorGain, name: "another one in each log", splits: R, draw: gain_per_log },
    Form { effect: SensorGain, name: "settling after switching on", splits: C, draw: gain_settling },
    Form { effect: SensorGain, name: "misaligned, with a little curvature", splits: C, draw: gain_misaligned },
    Form { effect: SensorDrift, name: "linear", splits: D, draw: drift_linear },
    Form { effect: SensorDrift, name: "thermal, first order", splits: DC, draw: drift_thermal },
    Form { effect: SensorDrift, name: "random walk", splits: R, draw: drift_walk },
    Form { effect: SensorDrift, name: "linear and thermal", splits: CR, draw: drift_both },
    Form { effect: SensorDrift, name: "root of time", splits: C, draw: drift_root },
    Form { effect: SensorDrift, name: "slow sine", splits: C, draw: drift_swing },
    Form { effect: SensorDrift, name: "a slip that settles", splits: C, draw: drift_slip },
    Form { effect: SensorDrift, name: "two bodies against each other", splits: C, draw: drift_two_bodies },
    Form { effect: SensorNonlinearity, name: "polynomial of third degree", splits: DC, draw: polynomial },
    Form { effect: SensorNonlinearity, name: "compression towards the ends", splits: C, draw: compression },
    Form { effect: SensorNonlinearity, name: "periodic error of an encoder", splits: R, draw: ripple },
    Form { effect: SensorNonlinearity, name: "compression off centre", splits: R, draw: compression_off_centre },
    Form { effect: SensorNonlinearity, name: "fourth and fifth degree", splits: C, draw: high_polynomial },
    Form { effect: SensorNonlinearity, name: "calibration table, straight between nodes", splits: C, draw: table },
    Form { effect: SensorNonlinearity, name: "kink at zero", splits: C, draw: kink },
    Form { effect: SensorNonlinearity, name: "local flaw of the target", splits: C, draw: flaw },
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
