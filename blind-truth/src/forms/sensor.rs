//! Forms of the sensor's effects and of what couples into it.

use super::{C, CR, D, DC, DCR, DR, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::effects::EffectId::*;
use crate::sensor::{Digitise, Follow, Measure};
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: SensorBandwidth, name: "first-order lag", splits: DC, draw: lag },
    Form { effect: SensorBandwidth, name: "second order", splits: C, draw: second_order },
    Form { effect: SensorBandwidth, name: "two lags", splits: R, draw: two_lags },
    Form { effect: SensorBandwidth, name: "second order, under-damped", splits: R, draw: ringing },
    Form { effect: SensorOffset, name: "constant", splits: D, draw: offset },
    Form { effect: SensorOffset, name: "constant, beyond zeroing", splits: C, draw: offset_large },
    Form { effect: SensorOffset, name: "another one in each log", splits: R, draw: offset_per_log },
    Form { effect: SensorGain, name: "constant", splits: DCR, draw: gain },
    Form { effect: SensorGain, name: "another one in each log", splits: R, draw: gain_per_log },
    Form { effect: SensorDrift, name: "linear", splits: D, draw: drift_linear },
    Form { effect: SensorDrift, name: "thermal, first order", splits: DC, draw: drift_thermal },
    Form { effect: SensorDrift, name: "random walk", splits: R, draw: drift_walk },
    Form { effect: SensorDrift, name: "linear and thermal", splits: CR, draw: drift_both },
    Form { effect: SensorNonlinearity, name: "polynomial of third degree", splits: DC, draw: polynomial },
    Form { effect: SensorNonlinearity, name: "compression towards the ends", splits: C, draw: compression },
    Form { effect: SensorNonlinearity, name: "periodic error of an encoder", splits: R, draw: ripple },
    Form { effect: SensorNonlinearity, name: "compression off centre", splits: R, draw: compression_off_centre },
    Form { effect: NoiseExcess, name: "white", splits: DC, draw: white },
    Form { effect: NoiseExcess, name: "low-pass", splits: C, draw: coloured },
    Form { effect: NoiseExcess, name: "a + b/f", splits: R, draw: flicker },
    Form { effect: NoiseExcess, name: "comes and goes", splits: R, draw: bursts },
    Form { effect: MainsHum, name: "50 Hz with harmonics", splits: DC, draw: |rng| hum(rng, 50.0) },
    Form { effect: MainsHum, name: "60 Hz with harmonics", splits: DR, draw: |rng| hum(rng, 60.0) },
    Form { effect: MainsHum, name: "50 Hz behind a rectifier", splits: C, draw: hum_rectified },
    Form { effect: MainsHum, name: "50 Hz, third harmonic strongest", splits: R, draw: hum_third },
    Form { effect: Quantisation, name: "sensor's converter", splits: DCR, draw: lattice },
    Form { effect: Quantisation, name: "command's converter", splits: CR, draw: dac },
    Form { effect: Quantisation, name: "sensor's converter, truncating", splits: R, draw: truncation },
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

/// Excess over the data sheet's rms: less cannot be told from its 10 % sigma, more is no noise any more.
const EXCESS: (f64, f64) = (1.5, 5.0);

/// 5 nm to 300 nm; the band decides.
const EXCESS_M: (f64, f64) = (5e-9, 3e-7);

fn white(_: &mut Pcg64) -> Planted {
    Planted::new("rms_m", EXCESS_M, |a, bench| bench.digitises.push(Digitise::White { m: a })).band(EXCESS.0, EXCESS.1)
}

fn coloured(rng: &mut Pcg64) -> Planted {
    let corner_hz = log_uniform(rng, 20.0, 2000.0);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Coloured { m: a, corner_hz }))
        .with("corner_hz", corner_hz)
        .band(EXCESS.0, EXCESS.1)
}

fn flicker(rng: &mut Pcg64) -> Planted {
    let ratio = rng.random_range(0.3..1.0);
    Planted::new("white_rms_m", EXCESS_M, move |a, bench| {
        bench.digitises.push(Digitise::Flicker { white_m: a, flicker_m: ratio * a });
    })
    .with("flicker_over_white", ratio)
    .band(EXCESS.0, EXCESS.1)
}

fn bursts(rng: &mut Pcg64) -> Planted {
    let mean_s = log_uniform(rng, 0.005, 0.05);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Bursts { m: a, mean_s }))
        .with("mean_s", mean_s)
        .band(EXCESS.0, EXCESS.1)
}

/// Anchors F25 has 1 to 50 nm; what 50 nm of noise hides in one log still shows over all of them.
const HUM: (f64, f64) = (2.0, 20.0);

fn hum_of(hz: f64, second: f64, third: f64, fifth: f64) -> Planted {
    Planted::new("amplitude_m", (5e-9, 2e-6), move |a, bench| {
        bench.measures.push(Measure::Hum { m: a, hz, second, third, fifth });
    })
    .with("hz", hz)
    .with("second", second)
    .with("third", third)
    .with("fifth", fifth)
    .band(HUM.0, HUM.1)
}

fn hum(rng: &mut Pcg64, hz: f64) -> Planted {
    hum_of(hz, rng.random_range(0.0..0.3), rng.random_range(0.1..0.5), rng.random_range(0.0..0.2))
}

fn hum_rectified(rng: &mut Pcg64) -> Planted {
    hum_of(50.0, rng.random_range(1.0..3.0), 0.0, 0.0)
}

fn hum_third(rng: &mut Pcg64) -> Planted {
    hum_of(50.0, 0.1, rng.random_range(1.0..2.0), rng.random_range(0.2..0.6))
}

/// A lattice that shows: its own rms is 2 to 10 times the noise.
const LATTICE: (f64, f64) = (2.0, 10.0);

fn lattice(_: &mut Pcg64) -> Planted {
    Planted::new("step_m", (2e-8, 2e-6), |a, bench| bench.digitises.push(Digitise::Lattice { m: a }))
        .band(LATTICE.0, LATTICE.1)
}

fn truncation(_: &mut Pcg64) -> Planted {
    Planted::new("step_m", (2e-8, 2e-6), |a, bench| bench.digitises.push(Digitise::Truncation { m: a }))
        .band(LATTICE.0, LATTICE.1)
}

fn dac(_: &mut Pcg64) -> Planted {
    Planted::new("step_V", (0.01, 3.0), |a, bench| bench.timing.dac_lsb_v = a).band(LATTICE.0, LATTICE.1)
}
