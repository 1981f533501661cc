//! Sensor drift: the zero of the reading wanders.

use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Drift, Line};

effect!(SensorDrift, "sensor_drift", Sensor);

const ABOUT: About = About {
    title: "sensor drift",
    what: "The zero of the reading wanders during a log, whether the plant moves or not.",
    equation: "y = q + r t, y = q + a (1 - exp(-t / tau)), or any slow course, y = q + sum c_j (1 - cos(pi j t / T)); q: \
               displacement, y: reading, t: time since the log's start, r: rate, a: final value, c_j: sizes (all of each \
               log), tau: thermal time constant of the mount, one for all logs, T: length of the longest log",
    source: "common form, size assumed (thermal expansion of the mount, 10 to 20 ppm/K for metals)",
    typical: "1 nm to 1 um a minute",
    installs: "a drift of the sensor's zero",
    signature: "a slow residual that doesn't turn with the drive and is there at zero input",
    rivals: &["creep", "thermal_gain", "sensor_offset", "initial_state"],
    experiment: "60 s at zero input: drift goes on, creep and warming have nothing to follow",
    spec: "zero@60s",
};

/// Largest and typical drift within the longest log, in shares of the stroke.
const LARGEST: f64 = 1.0;
const TYPICAL: f64 = 5e-3;

fn amplitude(name: &'static str, unit: &'static str, scales: &Scales<'_>, per_s: f64) -> Parameter {
    let whole = scales.stroke_m * per_s;
    Parameter::signed(name, unit, LARGEST * whole, TYPICAL * whole).of_each_log()
}

fn drift(chain: &mut Chain, amplitude_m: f64, time_constant_s: f64) {
    chain.sensor.drifts.push(Drift { amplitude_m, time_constant_s });
}

fn linear(scales: &Scales<'_>) -> Parameter {
    amplitude("rate_m_per_s", "m/s", scales, 1.0 / scales.longest_s)
}

fn exponential(scales: &Scales<'_>) -> Vec<Parameter> {
    let longest_s = scales.longest_s;
    let starts = spaced(0.1 * longest_s, 2.0 * longest_s, 3);
    vec![
        amplitude("amplitude_m", "m", scales, 1.0),
        Parameter::shape("time_constant_s", "s", [0.02 * longest_s, 10.0 * longest_s], starts),
    ]
}

const FORMS: &[Form] = &[
    Form::predictable("linear", |scales| vec![linear(scales)], |chain, p| drift(chain, p[0], f64::INFINITY)),
    Form::predictable("exponential", exponential, |chain, p| drift(chain, p[0], p[1])),
    Form::predictable(
        "both",
        |scales| {
            let mut parameters = exponential(scales);
            parameters.push(linear(scales));
            parameters
        },
        |chain, p| {
            drift(chain, p[0], p[1]);
            drift(chain, p[2], f64::INFINITY);
        },
    ),
    Form::predictable(
        "wander",
        |scales| {
            let longest_s = scales.longest_s;
            let bounds = [0.9 * longest_s, 1.2 * longest_s];
            let waves = WAVES.map(|name| amplitude(name, "m", scales, 1.0));
            [Parameter::shape("length_s", "s", bounds, vec![longest_s])].into_iter().chain(waves).collect()
        },
        |chain, p| {
            for (half_waves, &wave_m) in (1..).zip(&p[1..]) {
                chain.sensor.lines.push(Line { hz: 0.5 * f64::from(half_waves) / p[0], cos_m: -wave_m, sin_m: 0.0 });
                chain.sensor.offset_m += wave_m;
            }
        },
    ),
];

/// Half waves in the length of a log that a wandering zero is the sum of.
const WAVES: [&str; 6] = ["wave1_m", "wave2_m", "wave3_m", "wave4_m", "wave5_m", "wave6_m"];
