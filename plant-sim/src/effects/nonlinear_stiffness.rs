//! Nonlinear stiffness: a spring that hardens or softens alike in both directions.

use super::{About, Form, Parameter, Scales};
use crate::chain::{Chain, Force};

effect!(NonlinearStiffness, "nonlinear_stiffness", Structure);

const ABOUT: About = About {
    title: "nonlinear stiffness",
    what: "The spring hardens or softens with displacement, alike in both directions.",
    equation: "F = k q + k3 q^3, energy k q^2/2 + k3 q^4/4; or k q + a sin x + b (1 - cos x), x = 2 pi q / p (a detent: magnets, a bistable \
               flexure); F: force of the spring, q: displacement, k: stiffness, k3: \
               cubic stiffness (Duffing), a and b: amplitudes, p: period",
    source: "common form, size assumed",
    typical: "k3 q^2 / k = 0.1 to 5 % at full stroke",
    installs: "an elastic force on the mass",
    signature: "third harmonic with the cube of the amplitude and without a loop; the resonance moves with the square \
                of the amplitude",
    rivals: &["asymmetric_stiffness", "amplifier_saturation", "end_stop", "sensor_nonlinearity", "payload_mass"],
    experiment: "slow sines at two amplitudes, then multisines at two across the resonance: only a spring moves the \
                 resonance with the amplitude",
    spec: "sine:20V@10Hz,for=1s+sine:60V@10Hz,for=1s+multisine:5V@10-2000Hz,periods=4+multisine:30V@10-2000Hz,periods=4",
};

fn cubic(scales: &Scales<'_>) -> Parameter {
    let unit = scales.plant.stiffness_n_per_m / scales.stroke_m.powi(2);
    Parameter::signed("cubic_n_per_m3", "N/m^3", 0.5 * unit, 0.02 * unit)
}

fn add_cubic(chain: &mut Chain, cubic_n_per_m3: f64) {
    chain.parts.forces.push(Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3 });
}

const FORMS: &[Form] = &[
    Form::predictable("cubic", |scales| vec![cubic(scales)], |chain, p| add_cubic(chain, p[0])),
    Form::predictable(
        "cubic-and-fifth",
        |scales| {
            let unit = scales.plant.stiffness_n_per_m / scales.stroke_m.powi(4);
            vec![cubic(scales), Parameter::signed("fifth_n_per_m5", "N/m^5", 0.5 * unit, 0.02 * unit)]
        },
        |chain, p| {
            add_cubic(chain, p[0]);
            chain.parts.forces.push(Force::Fifth { fifth_n_per_m5: p[1] });
        },
    ),
    Form::predictable(
        "detent",
        |scales| {
            let (stroke_m, force_n) = (scales.stroke_m, scales.force_n());
            let amplitude = |name| Parameter::signed(name, "N", 0.3 * force_n, 5e-3 * force_n);
            let starts = [0.3, 0.7, 1.5].map(|share| share * stroke_m).to_vec();
            let period = Parameter::shape("period_m", "m", [0.05 * stroke_m, 3.0 * stroke_m], starts);
            vec![period, amplitude("sin_n"), amplitude("cos_n")]
        },
        |chain, p| chain.parts.forces.push(Force::Detent { period_m: p[0], sin_n: p[1], cos_n: p[2] }),
    ),
];
