//! Extra hysteron: one more element of hysteresis than the nominal plant has.

use super::parts::add_hysteron;
use super::{About, Form, Parameter};

effect!(ExtraHysteron, "extra_hysteron", Actuator);

const ABOUT: About = About {
    title: "additional hysteron",
    what: "The hysteresis has one more element, with a dead zone of its own, than the nominal plant.",
    equation: "C v' = alpha q' - h(v), h(v) = beta (v -+ d/2) beyond the dead zone and 0 inside; C: capacitance, v: \
               its voltage, alpha: transduction, q: displacement, beta: slope, d: width of the dead zone. Given by r = \
               alpha^2 / (C k), k: stiffness, and tau = C / beta",
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

const FORMS: &[Form] = &[Form::predictable(
    "dead-zone",
    |scales| {
        let drive_v = scales.drive_v;
        let starts = [0.15, 0.4, 0.8, 1.4].map(|share| share * drive_v).to_vec();
        vec![
            Parameter::amplitude("stiffness_ratio", "", [0.0, 1.0], 0.02),
            Parameter::shape("time_constant_s", "s", [1e-6, 0.1], vec![1e-5, 5e-3]),
            Parameter::shape("dead_zone_v", "V", [0.05 * drive_v, 2.0 * drive_v], starts),
        ]
    },
    |chain, p| add_hysteron(chain, p[0], p[1], p[2]),
)];
