//! Clock error: sensor and drive don't agree on the length of a second.

use super::{About, Form, Parameter};

effect!(ClockError, "clock_error", Timing);

const ABOUT: About = About {
    title: "clock error",
    what: "The sensor's clock runs faster or slower than the drive's, so readings move along the log.",
    equation: "row k is read at t (1 + e + d t/2), t = k T; T: sample time of the drive, e: relative error of the clock at \
               the log's start, d: its change per second, of a crystal that warms",
    source: "common form, size assumed (crystals)",
    typical: "1 to 100 ppm",
    installs: "a ratio of the sensor's clock, and its drift",
    signature: "a lag that grows in proportion to the time since the log's start, at every frequency",
    rivals: &["transport_delay", "sampling_jitter"],
    experiment: "one sine for a minute: the phase of the residual grows through the log, that of a delay stays",
    spec: "sine:60V@50Hz,for=60s",
};

fn ratio() -> Parameter {
    Parameter::signed("clock_ratio", "", 1e-2, 1e-5)
}

const FORMS: &[Form] = &[
    Form::predictable("ratio", |_| vec![ratio()], |chain, p| chain.sensor.clock_ratio += p[0]),
    Form::predictable(
        "ratio-and-drift",
        |scales| {
            let per_s = 1.0 / scales.longest_s;
            vec![ratio(), Parameter::signed("clock_drift_per_s", "1/s", 1e-2 * per_s, 1e-5 * per_s)]
        },
        |chain, p| {
            chain.sensor.clock_ratio += p[0];
            chain.sensor.clock_drift_per_s += p[1];
        },
    ),
];
