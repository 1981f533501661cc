//! Coulomb friction: a force against the motion that doesn't depend on its speed.

use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::Force;

effect!(CoulombFriction, "coulomb_friction", Structure);

const ABOUT: About = About {
    title: "Coulomb friction",
    what: "A guide or a contact rubs: a force of constant size against the motion.",
    equation: "F = Fc z, z' = q' (1 - z sign(q')) / s (presliding, Dahl), or z' = q' / s as long as |z| < 1 (a \
               slider on a spring; everywhere, or within w around a place), or F = Fc tanh(q' / vs); F: force against \
               the motion, Fc: its size, z: state of the contact, q': velocity, s: presliding displacement, vs: speed \
               of transition",
    source: "Dahl 1968; slider on a spring: the element of Jenkin, of which Maxwell-slip models are made; size assumed",
    typical: "0.1 to 5 % of the blocking force; next to nothing in flexures",
    installs: "a force on the mass",
    signature: "the loop is wider by a constant, at every amplitude and rate; at small amplitudes the motion sticks",
    rivals: &["extra_hysteron", "backlash", "rate_dependent_hysteresis"],
    experiment: "nested slow loops at two speeds: the width that friction adds depends neither on the amplitude nor on \
                 the speed",
    spec: "minor-loops:60V@0.5Hz+minor-loops:60V@5Hz",
};

fn coulomb(scales: &Scales<'_>) -> Parameter {
    Parameter::amplitude("coulomb_n", "N", [0.0, 0.5 * scales.force_n()], 0.01 * scales.force_n())
}

const FORMS: &[Form] = &[
    Form::predictable(
        "presliding",
        |scales| {
            // Down to a nanometre on a bender: friction that sticks hard has none.
            let bounds = [1e-5 * scales.stroke_m, scales.stroke_m / 20.0];
            let starts = spaced(scales.stroke_m / 1000.0, scales.stroke_m / 40.0, 3);
            vec![coulomb(scales), Parameter::shape("presliding_m", "m", bounds, starts)]
        },
        |chain, p| chain.parts.forces.push(Force::Presliding { coulomb_n: p[0], presliding_m: p[1] }),
    ),
    Form::predictable(
        "slider",
        |scales| {
            let bounds = [1e-4 * scales.stroke_m, scales.stroke_m / 10.0];
            let starts = spaced(scales.stroke_m / 1000.0, scales.stroke_m / 20.0, 3);
            vec![coulomb(scales), Parameter::shape("slip_m", "m", bounds, starts)]
        },
        |chain, p| chain.parts.forces.push(Force::Slider { coulomb_n: p[0], slip_m: p[1] }),
    ),
    Form::predictable(
        "slider-on-a-part",
        |scales| {
            let stroke_m = scales.stroke_m;
            let bounds = [1e-3 * stroke_m, stroke_m / 10.0];
            let [low_m, high_m] = scales.displacement_m;
            let places = [0.2, 0.5, 0.8].map(|share| low_m + share * (high_m - low_m)).to_vec();
            let widths = [0.2, 0.5].map(|share| share * stroke_m).to_vec();
            vec![
                coulomb(scales),
                Parameter::shape("slip_m", "m", bounds, vec![0.015 * stroke_m]),
                Parameter::place("at_m", "m", [low_m, high_m], places),
                Parameter::shape("half_width_m", "m", [0.05 * stroke_m, 1.5 * stroke_m], widths),
            ]
        },
        |chain, p| {
            let [coulomb_n, slip_m, at_m, half_width_m] = [0, 1, 2, 3].map(|i| p[i]);
            chain.parts.forces.push(Force::Patch { coulomb_n, slip_m, at_m, half_width_m });
        },
    ),
    Form::predictable(
        "smooth",
        |scales| {
            let speed = scales.speed_m_per_s();
            let starts = spaced(1e-3 * speed, 0.3 * speed, 3);
            vec![coulomb(scales), Parameter::shape("speed_m_per_s", "m/s", [1e-4 * speed, 10.0 * speed], starts)]
        },
        |chain, p| chain.parts.forces.push(Force::Smooth { coulomb_n: p[0], speed_m_per_s: p[1] }),
    ),
];
