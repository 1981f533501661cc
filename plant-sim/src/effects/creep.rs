//! Creep: the displacement goes on after a step.

use super::{About, Effect, Form, Kind, Parameter, Scales, Stage, spaced};
use crate::chain::Chain;
use crate::phs::Hysteron;

/// See [`About`].
pub struct Creep;

const ABOUT: About = About {
    title: "creep",
    what: "After a step the displacement goes on for seconds, along the logarithm of time.",
    equation: "C_c v_c' = alpha q' - v_c / R_c, one or more hysterons without a dead zone; tau = R_c C_c. \
               With a constant ratio of the time constants they add up to y = y0 (1 + g log10(t / 0.1 s)).",
    source: "Kelvin-Voigt chain: Croft, Shed, Devasia 2001; log law with g = 0.01 .. 0.02 a decade: PI catalogue",
    typical: "1 to 5 % of the stroke over the first minutes",
    installs: "hysterons without a dead zone, time constants from 10 ms to minutes",
    signature: "the residual after each step grows with the logarithm of time and turns with the step; nothing at zero input",
    rivals: &["sensor_drift", "thermal_gain", "extra_hysteron", "rate_dependent_hysteresis"],
    experiment: "a ladder with 10 s holds up and down: creep follows each step, drift does not",
    spec: "ladder:60V/4,hold=10s",
};

/// A hysteron without a dead zone that stiffens fast motion by `ratio` of the plant's stiffness and relaxes in `time_constant_s`.
fn add(chain: &mut Chain, ratio: f64, time_constant_s: f64) {
    let plant = &mut chain.plant;
    let capacitance_f = plant.transduction_c_per_m.powi(2) / (plant.stiffness_n_per_m * ratio.max(1e-12));
    plant.hysterons.push(Hysteron { capacitance_f, slope_s: capacitance_f / time_constant_s, dead_zone_v: 0.0 });
}

fn ratio() -> Parameter {
    Parameter::amplitude("stiffness_ratio", "", [0.0, 0.5], 0.02)
}

fn time_constant(scales: &Scales<'_>) -> Parameter {
    let longest_s = scales.longest_s.max(100.0 * scales.sample_s);
    Parameter::shape("time_constant_s", "s", [5e-3, 100.0 * longest_s], spaced(0.02, 2.0 * longest_s, 5))
}

const FORMS: &[Form] = &[
    Form {
        name: "kelvin-voigt",
        kind: Kind::Predictable,
        parameters: |scales| vec![ratio(), time_constant(scales)],
        install: |chain, p| add(chain, p[0], p[1]),
    },
    Form {
        name: "logarithmic",
        kind: Kind::Predictable,
        // Equal elements a decade apart from `time_constant_s` on are the log law between the first and the last.
        parameters: |scales| {
            vec![ratio(), Parameter::shape("time_constant_s", "s", [2e-3, scales.longest_s.max(0.1)], vec![0.01, 0.05])]
        },
        install: |chain, p| (0..4).for_each(|i| add(chain, p[0], p[1] * 10f64.powi(i))),
    },
];

impl Effect for Creep {
    fn id(&self) -> &'static str {
        "creep"
    }
    fn stage(&self) -> Stage {
        Stage::Actuator
    }
    fn about(&self) -> &'static About {
        &ABOUT
    }
    fn forms(&self) -> &'static [Form] {
        FORMS
    }
}
