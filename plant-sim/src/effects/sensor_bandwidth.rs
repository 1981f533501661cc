//! Sensor bandwidth: the reading follows the displacement with a lag.

use super::amplifier_bandwidth::{eager, first, growing, second};
use super::parts::{add_first, add_grown, add_second};
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Relaxation};

effect!(SensorBandwidth, "sensor_bandwidth", Sensor);

const ABOUT: About = About {
    title: "sensor bandwidth",
    what: "The reading follows the displacement as a linear low-pass does.",
    equation: "T y' + y = q, or with T (1 + c q), T (1 + c |q|) or T / (1 + e |q - y|), y'' + 2 z w y' + w^2 y = w^2 q, or y = (1 - s) q + s x with T x' + x = q; q: displacement, y: \
               reading, T: time constant, c: how it grows, e: how much quicker it is for a large error, w: natural frequency, z: damping ratio, s: share that comes late",
    source: "table of position sensors in Fleming 2013 (strain gauges 1 to 10 kHz, capacitive to 100 kHz), as quoted \
             by tdehaeze's notes",
    typical: "corners between 1 and 100 kHz",
    installs: "a lag of the sensor",
    signature: "gain falls and phase lags with frequency, the same at every amplitude; also after contact and stick, \
                which a lag of the drive precedes",
    rivals: &["transport_delay", "amplifier_bandwidth", "amplifier_gain"],
    experiment: "tap the amplifier's output: what lags between command and tap is the amplifier, the rest the sensor. \
                 A multisine to 2 kHz separates a lag from a delay",
    spec: "multisine:15V@5-2000Hz,periods=4",
};

const FORMS: &[Form] = &[
    Form::predictable("first-order", first, |chain, p| add_first(&mut chain.sensor.lag, p[0])),
    Form::predictable("second-order", second, |chain, p| add_second(&mut chain.sensor.lag, p[0], p[1])),
    Form::predictable("slow-tail", tail, |chain, p| come_late(chain, p[0], p[1])),
    Form::predictable(
        "growing",
        |scales| growing(scales, "growth_per_m", "1/m", scales.stroke_m),
        |chain, p| {
            add_grown(&mut chain.sensor.lag, p[0], &mut chain.sensor.lag_growth.by_side, p[1]);
        },
    ),
    Form::predictable(
        "growing-outwards",
        |scales| growing(scales, "growth_per_m", "1/m", scales.stroke_m),
        |chain, p| {
            add_grown(&mut chain.sensor.lag, p[0], &mut chain.sensor.lag_growth.outwards, p[1]);
        },
    ),
    Form::predictable(
        "eager",
        |scales| eager(scales, "eagerness_per_m", "1/m", scales.stroke_m),
        |chain, p| {
            add_grown(&mut chain.sensor.lag, p[0], &mut chain.sensor.lag_growth.eager, p[1]);
        },
    ),
];

/// Lets a share of the reading come late.
pub(super) fn come_late(chain: &mut Chain, share: f64, time_constant_s: f64) {
    chain.parts.creep.push(Relaxation::even(share / (1.0 - share), time_constant_s));
    chain.sensor.gain *= 1.0 - share;
}

/// A share that comes late, or early if it is negative: what a filter leaves that is neither first nor second order.
pub(super) fn tail(_: &Scales<'_>) -> Vec<Parameter> {
    vec![
        Parameter::signed("late_share", "", 0.5, 0.05),
        Parameter::shape("time_constant_s", "s", [1e-4, 1e-2], spaced(2e-4, 5e-3, 3)),
    ]
}
