//! Extra hysteron: one more element of hysteresis than the nominal plant has.

use super::parts::add_hysteron;
use super::{About, Form, Parameter, Scales};

effect!(ExtraHysteron, "extra_hysteron", Actuator);

const ABOUT: About = About {
    title: "additional hysteron",
    what: "The hysteresis has one more element, with a dead zone of its own, than the nominal plant.",
    equation: "C v' = alpha q' - h(v), h(v) = beta (v -+ d/2) beyond the dead zone and 0 inside; C: capacitance, v: \
               its voltage, alpha: transduction, q: displacement, beta: slope, d: width of the dead zone. Given by r = \
               alpha^2 / (C k), k: stiffness, tau = C / beta, and the fast travel d C / alpha from one end of the \
               dead zone to the other",
    source: "equations (2.4)-(2.6) of the thesis; hysteresis as a sum of play elements or relays: Prandtl-Ishlinskii \
             and Preisach models in Hassani's survey; size assumed",
    typical: "1 to 5 % of the stiffness",
    installs: "a hysteron",
    signature: "turning points and minor loops fit badly where major loops fit: a kink at a fixed distance from each \
                reversal",
    rivals: &["creep", "asymmetric_hysteresis", "rate_dependent_hysteresis", "coulomb_friction", "backlash"],
    experiment: "nested slow loops: a hysteron opens at a voltage of its own, friction and play at a displacement",
    spec: "minor-loops:60V@0.5Hz+minor-loops:60V@5Hz",
};

fn hysteron(scales: &Scales<'_>) -> Vec<Parameter> {
    // In displacement, so that strength and width are independent: a weak hysteron has a narrow dead zone in volts.
    let stroke_m = scales.stroke_m;
    let starts = [0.2, 0.5, 1.0].map(|share| share * stroke_m).to_vec();
    vec![
        Parameter::amplitude("stiffness_ratio", "", [0.0, 1.0], 0.02),
        Parameter::shape("time_constant_s", "s", [1e-6, 0.1], vec![1e-5, 1e-3, 2e-2]),
        Parameter::shape("dead_zone_m", "m", [0.02 * stroke_m, 4.0 * stroke_m], starts),
    ]
}

const FORMS: &[Form] = &[
    Form::predictable("dead-zone", hysteron, |chain, p| add_hysteron(chain, p[0], p[1], p[2])),
    Form::predictable("three-dead-zones", hysteron, |chain, p| {
        for third in 1..=3 {
            add_hysteron(chain, p[0] / 3.0, p[1], p[2] * f64::from(third) / 3.0);
        }
    }),
];
