//! Sampling jitter: samples are taken at uneven instants.

use super::{About, Form, Kind, Parameter};

effect!(SamplingJitter, "sampling_jitter", Timing);

const ABOUT: About = About {
    title: "sampling jitter",
    what: "Readings are taken a little before or after their nominal instants.",
    equation: "y_k = q(k T + e_k), error about q' e_k; y_k: reading of sample k, q: displacement, T: sample time, e_k: \
               random, rms s; where few rows are late, all are in the mean (late)",
    source: "over serial links 0.1 to 30 ms: ArduPilot issues 11217 and 14561; form common, size on a microcontroller \
             assumed",
    typical: "0.1 to 5 us",
    installs: "an rms error of the sampling instants",
    signature: "noise that grows with the velocity and is not there at rest",
    rivals: &["noise_excess", "lost_samples", "clock_error"],
    experiment: "sines at three frequencies of one amplitude: the noise grows in proportion to the frequency",
    spec: "sine:60V@10Hz,for=2s+sine:60V@50Hz,for=2s+sine:60V@100Hz,for=2s",
};

const FORMS: &[Form] = &[
    Form {
        name: "white",
        kind: Kind::Spread,
        parameters: |scales| vec![Parameter::amplitude("rms_s", "s", [0.0, scales.sample_s], 0.02 * scales.sample_s)],
        install: |chain, p| chain.sensor.jitter_s = chain.sensor.jitter_s.hypot(p[0]),
        mirrors: None,
    },
    Form {
        name: "late",
        kind: Kind::Mean,
        parameters: |scales| {
            let most_s = 0.5 * scales.sample_s;
            vec![Parameter::amplitude("mean_s", "s", [-most_s, most_s], 0.02 * scales.sample_s)]
        },
        install: |chain, p| chain.sensor.late_s += p[0],
        mirrors: None,
    },
];
