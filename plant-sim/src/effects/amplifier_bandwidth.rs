//! Amplifier bandwidth: the drive follows the command with a lag.

use super::parts::{add_first, add_grown, add_second, come_late};
use super::sensor_bandwidth::tail;
use super::{About, Form, Parameter, Scales, spaced};

effect!(AmplifierBandwidth, "amplifier_bandwidth", Drive);

const ABOUT: About = About {
    title: "amplifier bandwidth",
    what: "The drive follows the command as a linear low-pass does, because the amplifier charges a capacitance.",
    equation: "T v' + v = u, T = R C, or T (1 + c v), T (1 + c |v|) (as a ceramic's capacitance grows) or T / (1 + e |u - v|) instead; or v'' + 2 z w v' + w^2 v = w^2 u, or v = (1 - s) u + s x with T x' + x = u; u: command, v: drive, R: output resistance, \
               C: capacitance of the load, c: how it grows, e: how much quicker it is for a large error, w: natural frequency, z: damping ratio, s: share that comes late",
    source: "PiezoDrive PD200X4 manual (5.6 kHz power bandwidth at 1 uF and 100 V)",
    typical: "corners between 30 Hz and 5 kHz",
    installs: "a lag of the drive",
    signature: "gain falls and phase lags with frequency, the same at every amplitude",
    rivals: &["transport_delay", "sensor_bandwidth", "amplifier_slew", "amplifier_gain"],
    experiment: "a multisine to 2 kHz at two amplitudes: a delay leaves the gain alone, a slew limit depends on the \
                 amplitude. From the sensor's lag only a tap of the amplifier's output tells it apart for certain; \
                 stops and dead zones help",
    spec: "multisine:15V@10-2000Hz,periods=4,for=1s+multisine:5V@10-2000Hz,periods=4,for=1s",
};

/// The parameter of a first-order lag.
pub(super) fn first(scales: &Scales<'_>) -> Vec<Parameter> {
    vec![Parameter::amplitude("time_constant_s", "s", [0.0, 100.0 * scales.sample_s], 0.5 * scales.sample_s)]
}

/// The parameters of a second-order lag.
pub(super) fn second(scales: &Scales<'_>) -> Vec<Parameter> {
    let fastest_hz = 1.0 / scales.sample_s;
    let slowest_hz = 50f64.min(0.005 * fastest_hz);
    vec![
        Parameter::shape(
            "natural_hz",
            "Hz",
            [slowest_hz, 4.0 * fastest_hz],
            spaced(0.01 * fastest_hz, 0.5 * fastest_hz, 5),
        ),
        Parameter::shape("damping_ratio", "", [0.3, 2.0], vec![0.7]),
    ]
}

/// The parameters of a first-order lag that grows by up to its own size over half a span of `half`.
pub(super) fn growing(scales: &Scales<'_>, name: &'static str, unit: &'static str, half: f64) -> Vec<Parameter> {
    let most = 0.9 / half;
    let mut parameters = first(scales);
    parameters.push(Parameter::place(name, unit, [-most, most], vec![-0.5 * most, 0.5 * most]));
    parameters
}

/// The parameters of a first-order lag that is quicker for a large error, by about its own rate for one of half a span of `half`.
pub(super) fn eager(scales: &Scales<'_>, name: &'static str, unit: &'static str, half: f64) -> Vec<Parameter> {
    let mut parameters = first(scales);
    parameters.push(Parameter::shape(name, unit, [0.05 / half, 50.0 / half], vec![1.0 / half, 5.0 / half]));
    parameters
}

const FORMS: &[Form] = &[
    Form::predictable("first-order", first, |chain, p| add_first(&mut chain.drive.lag, p[0])),
    Form::predictable("second-order", second, |chain, p| add_second(&mut chain.drive.lag, p[0], p[1])),
    Form::predictable("slow-tail", tail, |chain, p| come_late(chain, p[0], p[1])),
    Form::predictable(
        "growing",
        |scales| growing(scales, "growth_per_v", "1/V", scales.drive_v),
        |chain, p| {
            add_grown(&mut chain.drive.lag, p[0], &mut chain.drive.lag_growth.by_side, p[1]);
        },
    ),
    Form::predictable(
        "growing-outwards",
        |scales| growing(scales, "growth_per_v", "1/V", scales.drive_v),
        |chain, p| {
            add_grown(&mut chain.drive.lag, p[0], &mut chain.drive.lag_growth.outwards, p[1]);
        },
    ),
    Form::predictable(
        "eager",
        |scales| eager(scales, "eagerness_per_v", "1/V", scales.drive_v),
        |chain, p| {
            add_grown(&mut chain.drive.lag, p[0], &mut chain.drive.lag_growth.eager, p[1]);
        },
    ),
];
