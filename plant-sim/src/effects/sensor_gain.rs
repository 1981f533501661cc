//! Sensor gain: the reading is a fixed share too large or too small.

use super::{About, Form, Parameter, spaced};
use crate::chain::{Chain, Settling};

effect!(SensorGain, "sensor_gain", Sensor);

const ABOUT: About = About {
    title: "sensor gain",
    what: "The reading is a fixed share larger or smaller than the displacement.",
    equation: "y = (1 + g) q, or, while the instrument warms up, y = (1 + g (1 - exp(-t / tau))) q; q: displacement, \
               y: reading, g: relative gain error, t: time since the log's start, tau: time constant. The first is by \
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

const FORMS: &[Form] = &[
    Form::predictable("gain", |_| vec![relative_gain()], turn),
    Form::predictable("gain-of-each-log", |_| vec![relative_gain().of_each_log()], turn),
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
        |chain, p| chain.sensor.settling = Some(Settling { share: p[0], time_constant_s: p[1] }),
    ),
];
