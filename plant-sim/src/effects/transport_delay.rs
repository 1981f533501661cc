//! Transport delay: everything arrives late.

use super::{About, Form, Parameter};

effect!(TransportDelay, "transport_delay", Timing);

const ABOUT: About = About {
    title: "transport delay",
    what: "The reading follows the command later than the log says, by the same time at every frequency.",
    equation: "y(t) = y0(t - T); y0 and y: reading without and with the delay, T: delay",
    source: "sensor and link latencies: PI E-727 manual, p. 28 (100 us + 0.216 / f_g, f_g: corner of the sensor's \
             filter)",
    typical: "20 to 500 us",
    installs: "a delay of the drive",
    signature: "a residual in proportion to the velocity at every frequency and amplitude; phase linear in frequency, \
                gain untouched",
    rivals: &["amplifier_bandwidth", "sensor_bandwidth", "rate_dependent_hysteresis", "clock_error"],
    experiment: "a multisine to 2 kHz: a delay leaves the gain alone, a lag lowers it",
    spec: "multisine:15V@5-2000Hz,periods=4",
};

const FORMS: &[Form] = &[Form::predictable(
    "pure",
    |scales| vec![Parameter::amplitude("delay_s", "s", [0.0, 100.0 * scales.sample_s], scales.sample_s)],
    |chain, p| chain.drive.delay_s += p[0],
)];
