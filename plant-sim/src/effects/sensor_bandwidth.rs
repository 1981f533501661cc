//! Sensor bandwidth: the reading follows the displacement with a lag.

use super::amplifier_bandwidth::{first, second};
use super::parts::{add_first, add_second};
use super::{About, Form};

effect!(SensorBandwidth, "sensor_bandwidth", Sensor);

const ABOUT: About = About {
    title: "sensor bandwidth",
    what: "The reading follows the displacement as a linear low-pass does.",
    equation: "T y' + y = q, or y'' + 2 z w y' + w^2 y = w^2 q; q: displacement, y: reading, T: time constant, w: \
               natural frequency, z: damping ratio",
    source: "table of position sensors in Fleming 2013 (strain gauges 1 to 10 kHz, capacitive to 100 kHz), as quoted \
             by tdehaeze's notes",
    typical: "corners between 1 and 100 kHz",
    installs: "a lag of the sensor",
    signature: "gain falls and phase lags with frequency, the same at every amplitude; also after contact and stick, \
                which a lag of the drive precedes",
    rivals: &["transport_delay", "amplifier_bandwidth"],
    experiment: "tap the amplifier's output: what lags between command and tap is the amplifier, the rest the sensor. \
                 A multisine to 2 kHz separates a lag from a delay",
    spec: "multisine:15V@4-2000Hz,periods=4",
};

const FORMS: &[Form] = &[
    Form::predictable("first-order", first, |chain, p| add_first(&mut chain.sensor.lag, p[0])),
    Form::predictable("second-order", second, |chain, p| add_second(&mut chain.sensor.lag, p[0], p[1])),
];
