//! Extra hysteron: one more element of hysteresis than the nominal plant has.

use super::parts::{add_hysteron, add_plays, add_spectrum, plays, spectrum};
use super::{About, Form, Parameter, Scales};

effect!(ExtraHysteron, "extra_hysteron", Actuator);

const ABOUT: About = About {
    title: "additional hysteron",
    what: "The hysteresis has one more element, with a dead zone of its own, than the nominal plant.",
    equation: "C v' = alpha q' - h(v), h(v) = beta (v -+ d/2) beyond the dead zone and 0 inside; C: capacitance, v: \
               its voltage, alpha: transduction, q: displacement, beta: slope, d: width of the dead zone. Or h = s sum (V - p_i) / 5 \
               with plays p_i of the drive V, thresholds evenly up to the reach, that the drive's force alpha V misses; s: share; or h = sum (s_i + b_i (V/R)^2) (V - p_i) with \
             thresholds from 0.02 to 0.7 of the reach R (wide ones without b), which is near any relays of the voltage; b: how shares bow. \
               Hysterons are given by r = alpha^2 / (C k), k: stiffness, tau = C / beta, and the fast travel d C / alpha from one end of the \
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
    Form::predictable(
        "quick-and-slow",
        |scales| {
            let stroke_m = scales.stroke_m;
            let ratio = |name| Parameter::amplitude(name, "", [0.0, 1.0], 0.02);
            let time = |name, start| Parameter::shape(name, "s", [1e-6, 0.1], vec![start]);
            let starts = [0.15, 0.4].map(|share| share * stroke_m).to_vec();
            let width = |name| Parameter::shape(name, "m", [0.02 * stroke_m, 4.0 * stroke_m], starts.clone());
            vec![
                ratio("quick_stiffness_ratio"),
                time("quick_time_constant_s", 1e-4),
                width("quick_dead_zone_m"),
                ratio("slow_stiffness_ratio"),
                time("slow_time_constant_s", 1e-2),
                width("slow_dead_zone_m"),
            ]
        },
        |chain, p| p.chunks_exact(3).for_each(|p| add_hysteron(chain, p[0], p[1], p[2])),
    ),
    Form::predictable("plays-of-the-voltage", plays, |chain, p| {
        add_plays(chain, p, 0.0);
    }),
    Form::predictable("spectrum-of-plays", spectrum::<false>, |chain, p| {
        add_spectrum(chain, p);
    }),
];
