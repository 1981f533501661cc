//! Sensor offset: the reading at zero displacement is not zero.

use super::{About, Form, Parameter, Scales};
use crate::chain::Chain;

effect!(SensorOffset, "sensor_offset", Sensor);

const ABOUT: About = About {
    title: "sensor offset",
    what: "The reading is shifted by a constant, the same in every log or, where the sensor is zeroed anew, another one in each. A \
           constant force on the structure, and dead zones that lie off centre (imprint of the ceramic), shift it in exactly the same way: no log tells these apart.",
    equation: "y = q + o; q: displacement, y: reading, o: offset",
    source: "table of position sensors in Fleming 2013 (capacitive 0.1 %, strain 1 % of full scale), as quoted by \
             tdehaeze's notes",
    typical: "0.1 to 1 % of the range",
    installs: "an offset of the sensor",
    signature: "a residual that is constant through every log, and the same in all of them unless the sensor is zeroed anew",
    rivals: &["sensor_drift", "initial_state", "asymmetric_hysteresis"],
    experiment: "several logs from different pasts: an offset is the same in all, a hysteretic rest position isn't",
    spec: "minor-loops:60V@2Hz+zero@2s+ladder:-60V/2,hold=1s+zero@2s",
};

fn offset(scales: &Scales<'_>) -> Parameter {
    Parameter::signed("offset_m", "m", scales.stroke_m, 0.01 * scales.stroke_m)
}

fn shift(chain: &mut Chain, p: &[f64]) {
    chain.sensor.offset_m += p[0];
}

const FORMS: &[Form] = &[
    Form::predictable("constant", |scales| vec![offset(scales)], shift),
    Form::predictable("constant-in-each-log", |scales| vec![offset(scales).told_at_once()], shift),
];
