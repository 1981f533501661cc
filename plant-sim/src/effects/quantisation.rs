//! Quantisation: readings or commands lie on a lattice.

use super::{About, Form, Kind, Parameter, Scales};
use crate::chain::Stairs;

effect!(Quantisation, "quantisation", Sensor);

const ABOUT: About = About {
    title: "quantisation",
    what: "A converter rounds readings or commands to a lattice.",
    equation: "y = Q round(q / Q), rms error Q / sqrt(12), or Q floor(q / Q); q: exact value, y: converted value, Q: step",
    source: "common form, size assumed (arithmetic: a step of 12 bits is 244 ppm of the range, of 16 bits 15 ppm)",
    typical: "1 to 100 nm; 0.1 to 50 mV",
    installs: "a step of the sensor's or of the drive's converter",
    signature: "readings repeat a few values at equal distances; of the command: small stairs that the plant follows",
    rivals: &["noise_excess"],
    experiment: "a slow ramp over a small range: the histogram of the readings shows the lattice",
    spec: "triangle:2V@0.1Hz,for=20s",
};

/// Where the residual has no period over the command, a search starts from these shares of the range: 12 bits and coarser.
const STARTS: [f64; 3] = [1.0 / 2048.0, 1.0 / 512.0, 1.0 / 128.0];

fn quantum_v(scales: &Scales<'_>) -> Vec<Parameter> {
    let drive_v = scales.drive_v;
    let starts = STARTS.map(|share| share * drive_v).to_vec();
    vec![Parameter::shape("quantum_v", "V", [1e-4 * drive_v, 0.1 * drive_v], starts)]
}

const FORMS: &[Form] = &[
    Form {
        name: "converter-in",
        kind: Kind::Lattice,
        parameters: |scales| {
            vec![Parameter::amplitude("quantum_m", "m", [0.0, 0.2 * scales.stroke_m], scales.stroke_m / 2048.0)]
        },
        install: |chain, p| chain.sensor.quantum_m = chain.sensor.quantum_m.max(p[0]),
        mirrors: None,
    },
    Form::predictable("converter-out", quantum_v, |chain, p| {
        chain.drive.quantum_v = chain.drive.quantum_v.max(p[0]);
    }),
    Form::predictable("converter-out-truncating", quantum_v, |chain, p| {
        chain.drive.quantum_v = chain.drive.quantum_v.max(p[0]);
        chain.drive.is_truncating = true;
    }),
    Form::predictable(
        "converter-inside",
        |scales| {
            let stroke_m = scales.stroke_m;
            let starts = STARTS.map(|share| share * stroke_m).to_vec();
            let half = 0.05 * stroke_m;
            vec![
                Parameter::shape("quantum_m", "m", [1e-4 * stroke_m, 0.1 * stroke_m], starts),
                Parameter::place("code_at_m", "m", [-half, half], vec![0.0]),
            ]
        },
        |chain, p| chain.sensor.stairs = Some(Stairs { step_m: p[0], at_m: p[1] }),
    ),
];
