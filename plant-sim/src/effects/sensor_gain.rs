//! Sensor gain: the reading is a fixed share too large or too small.

use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Settling, Swing};

effect!(SensorGain, "sensor_gain", Sensor);

const ABOUT: About = About {
    title: "sensor gain",
    what: "The reading is a fixed share larger or smaller than the displacement, another one in each log where the range is set \
           anew.",
    equation: "y = (1 + g) q, or, while the instrument warms up, y = (1 + g (1 - exp(-t / tau))) q, or y = q + s |q|, \
               where either side has a gain of its own, or, where it wanders, y = (1 + sum g_k (1 - cos(pi k t / T))) q, k = 1 to 6; q: displacement, y: reading, g: relative \
               gain error, s: half of the difference between the sides, t: time since the log's start, tau: time constant, T: length of the longest log. The first is by \
               itself indistinguishable from alpha (1 + g) with all C and slopes (1 + g)^2, alpha: transduction, C: \
               capacitances",
    source: "table of position sensors in Fleming 2013 (capacitive 0.1 %, strain 1 % of full scale), as quoted by \
             tdehaeze's notes",
    typical: "0.1 to 1 %",
    installs: "a factor on the reading",
    signature: "a residual in proportion to the displacement, dynamics and dead zones untouched",
    rivals: &["amplifier_gain", "sensor_nonlinearity", "thermal_gain"],
    experiment: "calibrate the sensor against a known displacement (gauge block, interferometer); no command separates \
                 it from a stronger transduction",
    spec: "",
};

fn relative_gain() -> Parameter {
    Parameter::signed("relative_gain", "", 0.5, 0.02)
}

fn turn(chain: &mut Chain, p: &[f64]) {
    chain.sensor.gain *= 1.0 + p[0];
}

/// Parameter of a gain that differs by side, which is a curve with a kink at zero.
pub(super) fn half_difference(_: &Scales<'_>) -> Vec<Parameter> {
    vec![Parameter::signed("half_difference", "", 0.3, 0.01)]
}

/// Installs it.
pub(super) fn skew(chain: &mut Chain, p: &[f64]) {
    chain.sensor.gain_skew += p[0];
}

/// Half waves in the longest log that a wandering gain is the sum of.
const WAVES: [&str; 6] = ["wave1_share", "wave2_share", "wave3_share", "wave4_share", "wave5_share", "wave6_share"];

/// Parameters of a gain that wanders, the waves of each log its own.
pub(super) fn wandering(scales: &Scales<'_>) -> Vec<Parameter> {
    let longest_s = scales.longest_s;
    let length = Parameter::shape("length_s", "s", [0.9 * longest_s, 1.2 * longest_s], vec![longest_s]);
    let waves = WAVES.map(|name| Parameter::signed(name, "", 0.3, 0.005).of_each_log());
    std::iter::once(length).chain(waves).collect()
}

/// The gain with these parameters.
pub(super) fn swings(p: &[f64]) -> impl Iterator<Item = Swing> {
    let length_s = p[0];
    (1..).zip(&p[1..]).map(move |(half_waves, &share)| Swing {
        hz: 0.5 * f64::from(half_waves) / length_s,
        cos_share: share,
        sin_share: 0.0,
    })
}

const FORMS: &[Form] = &[
    Form::predictable("gain", |_| vec![relative_gain()], turn),
    Form::predictable("gain-of-each-log", |_| vec![relative_gain().told_at_once()], turn),
    Form::predictable("by-side", half_difference, skew),
    Form::predictable(
        "settling",
        |scales| {
            let longest_s = scales.longest_s;
            let bounds = [0.02 * longest_s, 5.0 * longest_s];
            let starts = spaced(0.1 * longest_s, 2.0 * longest_s, 3);
            vec![
                Parameter::signed("relative_change", "", 0.5, 0.01),
                Parameter::shape("time_constant_s", "s", bounds, starts),
            ]
        },
        |chain, p| chain.sensor.settlings.push(Settling { share: p[0], time_constant_s: p[1] }),
    ),
    Form::predictable("wander", wandering, |chain, p| chain.sensor.swings.extend(swings(p))),
];
