//! Rate-dependent hysteresis: the loop widens with speed beyond what damping explains.

use super::parts::{bend, bend_all, bend_slowest, slowest, with_dead_zone};
use super::{About, Form, Parameter, Scales};
use crate::chain::{BendLaw, Chain, Force};

effect!(RateDependentHysteresis, "rate_dependent_hysteresis", Actuator);

const ABOUT: About = About {
    title: "rate-dependent hysteresis",
    what: "The hysteresis loop widens with the rate of the drive, not in proportion as it would with linear damping.",
    equation: "F = Fr |q' / vr|^m sign(q'); or a dead zone d (1 + w |q'| k / (alpha 1e4 V/s)); or a leak beta d/2 (x / \
               (d/2))^(1+e), or beta x (1 + s |q'| / vr). F: force against the motion, q': velocity, vr = 0.05 m/s, m: exponent, d: width of the \
               dead zone, q' k / alpha: rate of the drive that goes with that velocity, k: stiffness, alpha: transduction, w: widening, \
               beta: slope, x: voltage beyond the dead zone, e: excess of the exponent over one",
    source: "power of the rate, and thresholds r0 + r1 |u'|: rate-dependent Prandtl-Ishlinskii model, doi \
             10.5772/58984 (form and range); the leak and all sizes assumed",
    typical: "loop width plus tens of per cent from 1 Hz to hundreds of Hz",
    installs: "a force on the mass, or a bend of the hysterons",
    signature: "loop area over amplitude squared grows with frequency, but more slowly or faster than in proportion",
    rivals: &["amplifier_slew", "creep", "extra_hysteron", "coulomb_friction", "transport_delay"],
    experiment: "triangles of one amplitude at three speeds: the loop's width against the rate is a power law, \
                 constant for friction, a straight line for a delay",
    spec: "triangle:60V@1Hz,for=3s+triangle:60V@10Hz,for=1s+triangle:60V@50Hz,for=1s",
};

/// References. Fixed, so that an amplitude means the same on every rig: 0.05 m/s is 80 um at 100 Hz; 1e4 V/s is 16 V at 100 Hz.
const REFERENCE_M_PER_S: f64 = 0.05;
const REFERENCE_V_PER_S: f64 = 1e4;
/// Largest exponent of the power law; the largest force at the reference follows from it.
const LARGEST_EXPONENT: f64 = 2.5;

fn power(scales: &Scales<'_>) -> Vec<Parameter> {
    let slower = REFERENCE_M_PER_S / scales.speed_m_per_s();
    let largest_n = 0.5 * scales.force_n() * slower.powf(LARGEST_EXPONENT).max(slower.powf(0.2));
    vec![
        Parameter::amplitude("force_n", "N", [0.0, largest_n], 0.01 * scales.force_n() * slower),
        Parameter::place("exponent", "", [0.2, LARGEST_EXPONENT], vec![0.4, 0.7, 1.5, 2.0]),
    ]
}

/// The excess at which the leak is what the straight law makes it, in shares of half the dead zone: without it the nominal slope would
/// have to follow every exponent.
fn exponent(_: &Scales<'_>) -> Vec<Parameter> {
    vec![
        Parameter::amplitude("excess_exponent", "", [-0.8, 2.0], 0.1),
        Parameter::shape("reference_share", "", [1e-3, 1e2], vec![0.3, 1.0]),
    ]
}

fn leak(chain: &mut Chain, hysterons: &[usize], p: &[f64]) {
    for &i in hysterons {
        chain.plant.hysterons[i].slope_s *= p[1].powf(-p[0]);
        bend(chain, i, BendLaw::Exponent(1.0 + p[0]));
    }
}

fn share(scales: &Scales<'_>) -> Vec<Parameter> {
    let slower = REFERENCE_V_PER_S / scales.usual_rate_v_per_s();
    vec![Parameter::amplitude("share", "", [0.0, 3.0 * slower], 0.05 * slower)]
}

fn widening(share: f64) -> BendLaw {
    BendLaw::Widening { share, reference_v_per_s: REFERENCE_V_PER_S }
}

/// Motion that eases a leak: by as much again at the usual speed, and by a hundred times that at the most.
fn easing_share(scales: &Scales<'_>) -> Vec<Parameter> {
    let slower = REFERENCE_M_PER_S / scales.speed_m_per_s();
    vec![Parameter::amplitude("share", "", [0.0, 100.0 * slower], 0.3 * slower)]
}

fn easing(share: f64) -> BendLaw {
    BendLaw::Easing { share, reference_m_per_s: REFERENCE_M_PER_S }
}

const FORMS: &[Form] = &[
    Form::predictable("power", power, |chain, p| {
        let (force_n, reference_m_per_s, exponent) = (p[0], REFERENCE_M_PER_S, p[1]);
        chain.parts.forces.push(Force::Power { force_n, reference_m_per_s, exponent });
    }),
    Form::predictable("widening", share, |chain, p| bend_all(chain, widening(p[0]))),
    Form::predictable("widening-of-slowest", share, |chain, p| bend_slowest(chain, widening(p[0]))),
    Form::predictable("eased", easing_share, |chain, p| bend_all(chain, easing(p[0]))),
    Form::predictable("eased-of-slowest", easing_share, |chain, p| bend_slowest(chain, easing(p[0]))),
    Form::predictable("leak", exponent, |chain, p| {
        let all = with_dead_zone(&chain.plant);
        leak(chain, &all, p);
    }),
    Form::predictable("leak-of-slowest", exponent, |chain, p| {
        let slowest = slowest(&chain.plant);
        leak(chain, slowest.as_slice(), p);
    }),
];
