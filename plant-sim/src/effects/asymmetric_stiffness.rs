//! Asymmetric stiffness: a spring that is stiffer in one direction.

use super::{About, Form, Parameter, Scales};
use crate::chain::{Chain, Force};

effect!(AsymmetricStiffness, "asymmetric_stiffness", Structure);

const ABOUT: About = About {
    title: "asymmetric stiffness",
    what: "The structure is stiffer in one direction than in the other: a preloaded stack, a bent flexure.",
    equation: "F = k q + k2 q^2, energy k q^2/2 + k2 q^3/3, or with the next even power; or F = (k + ks) q for q > 0, at once or over a width. F: force of \
               the spring, q: displacement, k: stiffness, k2: quadratic stiffness, ks: additional stiffness on the \
               positive side",
    source: "common form, size assumed",
    typical: "stiffness 1 to 10 % different at both ends",
    installs: "an elastic force on the mass",
    signature: "even harmonics without a loop; the resonance depends on the mean displacement",
    rivals: &["nonlinear_stiffness", "asymmetric_hysteresis", "sensor_nonlinearity", "end_stop"],
    experiment: "stairs to either end: a spring's ringing after each step changes its frequency with the level, a \
                 sensor's curvature changes only its height",
    spec: "ladder:60V/6,hold=0.2s+ladder:-60V/6,hold=0.2s",
};

fn quadratic(scales: &Scales<'_>) -> Parameter {
    let unit = scales.plant.stiffness_n_per_m / scales.stroke_m;
    Parameter::signed("quadratic_n_per_m2", "N/m^2", 0.4 * unit, 0.02 * unit)
}

fn one_sided(scales: &Scales<'_>) -> Parameter {
    let stiffness_n_per_m = scales.plant.stiffness_n_per_m;
    Parameter::signed("stiffness_n_per_m", "N/m", 0.5 * stiffness_n_per_m, 0.02 * stiffness_n_per_m)
}

fn add_quadratic(chain: &mut Chain, quadratic_n_per_m2: f64) {
    chain.parts.forces.push(Force::Spring { quadratic_n_per_m2, cubic_n_per_m3: 0.0 });
}

fn add_one_sided(chain: &mut Chain, stiffness_n_per_m: f64) {
    chain.parts.forces.push(Force::OneSided { stiffness_n_per_m });
}

const FORMS: &[Form] = &[
    Form::predictable("quadratic", |scales| vec![quadratic(scales)], |chain, p| add_quadratic(chain, p[0])),
    Form::predictable("one-sided", |scales| vec![one_sided(scales)], |chain, p| add_one_sided(chain, p[0])),
    Form::predictable(
        "quadratic-and-fourth",
        |scales| {
            let unit = scales.plant.stiffness_n_per_m / scales.stroke_m.powi(3);
            vec![quadratic(scales), Parameter::signed("fourth_n_per_m4", "N/m^4", 0.4 * unit, 0.02 * unit)]
        },
        |chain, p| {
            add_quadratic(chain, p[0]);
            chain.parts.forces.push(Force::Fourth { fourth_n_per_m4: p[1] });
        },
    ),
    Form::predictable(
        "gradual",
        |scales| {
            let stroke_m = scales.stroke_m;
            let shares = |all: [f64; 3]| all.map(|share| share * stroke_m).to_vec();
            let at = Parameter::place("at_m", "m", [-0.6 * stroke_m, 0.6 * stroke_m], shares([-0.3, 0.0, 0.3]));
            let width = Parameter::shape("width_m", "m", [0.01 * stroke_m, 2.0 * stroke_m], vec![0.2 * stroke_m]);
            vec![one_sided(scales), at, width]
        },
        |chain, p| {
            let [stiffness_n_per_m, at_m, width_m] = [p[0], p[1], p[2]];
            chain.parts.forces.push(Force::Gradual { stiffness_n_per_m, at_m, width_m });
        },
    ),
    Form::predictable(
        "both",
        |scales| vec![quadratic(scales), one_sided(scales)],
        |chain, p| {
            add_quadratic(chain, p[0]);
            add_one_sided(chain, p[1]);
        },
    ),
];
