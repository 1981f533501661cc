//! Mains hum: the mains' frequency and its harmonics in the reading.

use super::parts::phasor;
use super::{About, Form, Parameter, Scales};
use crate::chain::{Chain, Line, Shake};

effect!(MainsHum, "mains_hum", Environment);

const ABOUT: About = About {
    title: "mains hum",
    what: "The mains reach the reading, at their frequency and its harmonics.",
    equation: "y = q + sum over h = 1 .. 5 of a_h cos(2 pi h f t) + b_h sin(2 pi h f t), or the same as a force, through the drive; q: displacement, y: reading, \
               f: 50 or 60 Hz, exactly or within 2 %, t: time since the log's start, a_h and b_h: of each log, since nothing ties \
               their phase to the log's start",
    source: "common form, size assumed",
    typical: "1 to 50 nm",
    installs: "lines of the sensor",
    signature: "lines at multiples of 50 or 60 Hz that are not tied to the drive",
    rivals: &["periodic_force", "noise_excess"],
    experiment: "10 s at zero input: lines at exact multiples of the mains' frequency; run the sensor from a battery \
                 to be sure",
    spec: "zero@10s",
};

const AMPLITUDES: [[&str; 2]; 5] = [
    ["cos_1_m", "sin_1_m"],
    ["cos_2_m", "sin_2_m"],
    ["cos_3_m", "sin_3_m"],
    ["cos_4_m", "sin_4_m"],
    ["cos_5_m", "sin_5_m"],
];

const FORCES: [[&str; 2]; 5] = [
    ["cos_1_n", "sin_1_n"],
    ["cos_2_n", "sin_2_n"],
    ["cos_3_n", "sin_3_n"],
    ["cos_4_n", "sin_4_n"],
    ["cos_5_n", "sin_5_n"],
];

fn parameters(scales: &Scales<'_>) -> Vec<Parameter> {
    AMPLITUDES.into_iter().flat_map(|names| phasor(names, "m", scales.stroke_m, 2e-4 * scales.stroke_m)).collect()
}

fn hum(chain: &mut Chain, mains_hz: f64, p: &[f64]) {
    for (i, amplitudes) in p.chunks_exact(2).enumerate() {
        let hz = mains_hz * (i + 1) as f64;
        chain.sensor.lines.push(Line { hz, cos_m: amplitudes[0], sin_m: amplitudes[1] });
    }
}

/// Force of mains that reach the drive, on the mass.
fn shaking(scales: &Scales<'_>) -> Vec<Parameter> {
    let force_n = scales.plant.stiffness_n_per_m * scales.stroke_m;
    FORCES.into_iter().flat_map(|names| phasor(names, "N", force_n, 2e-4 * force_n)).collect()
}

fn shake(chain: &mut Chain, mains_hz: f64, p: &[f64]) {
    for (i, amplitudes) in p.chunks_exact(2).enumerate() {
        chain.parts.shakes.push(Shake { hz: mains_hz * (i + 1) as f64, cos_n: amplitudes[0], sin_n: amplitudes[1] });
    }
}

/// Mains of a grid that is not held tightly, or read by a clock that is off.
fn near(mains_hz: f64, scales: &Scales<'_>) -> Vec<Parameter> {
    let hz = Parameter::shape("mains_hz", "Hz", [0.98 * mains_hz, 1.02 * mains_hz], vec![mains_hz]);
    std::iter::once(hz).chain(parameters(scales)).collect()
}

const FORMS: &[Form] = &[
    Form::predictable("50 Hz", parameters, |chain, p| hum(chain, 50.0, p)),
    Form::predictable("60 Hz", parameters, |chain, p| hum(chain, 60.0, p)),
    Form::predictable("about 50 Hz", |scales| near(50.0, scales), |chain, p| hum(chain, p[0], &p[1..])),
    Form::predictable("50 Hz on the drive", shaking, |chain, p| shake(chain, 50.0, p)),
    Form::predictable("60 Hz on the drive", shaking, |chain, p| shake(chain, 60.0, p)),
    Form::predictable("about 60 Hz", |scales| near(60.0, scales), |chain, p| hum(chain, p[0], &p[1..])),
];
