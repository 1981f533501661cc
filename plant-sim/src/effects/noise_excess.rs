//! Noise excess: the reading is noisier than the nominal sensor.

use super::{About, Form, Kind, Parameter, Scales, spaced};

effect!(NoiseExcess, "noise_excess", Sensor);

const ABOUT: About = About {
    title: "excess noise",
    what: "The reading is noisier than the nominal sensor, white, slow or flickering, whatever the plant does.",
    equation: "y = q + e, e white with rms s, or white noise behind 1 / (1 + T d/dt) with rms s; q: displacement, y: \
               reading; taken for it is whatever has the power of a + b / f^n, n below 1.6, in all logs, f: frequency",
    source: "table of position sensors in Fleming 2013 (24 ppm capacitive to 230 ppm strain of 100 um at 1 kHz: 2.4 to \
             23 nm), as quoted by tdehaeze's notes",
    typical: "2 to 50 nm",
    installs: "noise of the sensor",
    signature: "a residual without structure, of one size at rest and in motion, whose octaves have one power in all logs",
    rivals: &["sampling_jitter", "lost_samples", "quantisation", "mains_hum"],
    experiment: "a record at zero input beside one in motion: noise is alike in both, jitter and lost samples need \
                 motion",
    spec: "zero@10s+sine:60V@50Hz,for=2s",
};

fn rms(scales: &Scales<'_>) -> Parameter {
    Parameter::amplitude("rms_m", "m", [0.0, scales.stroke_m], 2e-4 * scales.stroke_m)
}

const FORMS: &[Form] = &[
    Form {
        name: "white",
        kind: Kind::Spread,
        parameters: |scales| vec![rms(scales)],
        install: |chain, p| chain.sensor.noise_m = chain.sensor.noise_m.hypot(p[0]),
        mirrors: None,
    },
    Form {
        name: "coloured",
        kind: Kind::Spread,
        parameters: |scales| {
            let starts = spaced(3.0 * scales.sample_s, 0.1 * scales.longest_s, 3);
            let bounds = [0.3 * scales.sample_s, scales.longest_s];
            vec![rms(scales), Parameter::shape("time_constant_s", "s", bounds, starts)]
        },
        install: |chain, p| {
            let sensor = &mut chain.sensor;
            // The power of both, and at the lowest frequencies the density of both: rms^2 times the time constant.
            let (before_m2, new_m2) = (sensor.slow_noise_m.powi(2), p[0].powi(2));
            let share = if before_m2 > 0.0 { new_m2 / (before_m2 + new_m2) } else { 1.0 };
            sensor.slow_noise_s += share * (p[1] - sensor.slow_noise_s);
            sensor.slow_noise_m = sensor.slow_noise_m.hypot(p[0]);
        },
        mirrors: None,
    },
];
