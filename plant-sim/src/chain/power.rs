//! Energy of the plant with its parts: what each part stores and what it turns into heat.
//!
//! Supplied is alpha V q' by the drive. External lines and forces are sources: they supply -F q'. A residual mode in parallel stands for
//! structure that the plant's equations don't have; it is driven without pulling back, so it is a source as well and in no balance. So is
//! the transducer's hysteresis, which follows the voltage. Drive and sensor carry signals, not energy.

use super::leak::{LEAST_EXPONENT, skewed_by};
use super::parts::{against_stop_n, detent, in_pad, on_patch};
use super::{Bend, BendLaw, Chain, Force, Joint};
use crate::phs::{Hysteron, PhsState};
use std::f64::consts::TAU;

/// A state of the plant and of the parts that have one.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Displacement, velocity and hysteron voltages.
    pub plant: PhsState,
    /// Displacement and velocity of each attached mode, in the order of the chain's.
    pub attached: Vec<[f64; 2]>,
    /// z of each force with presliding, h of each Bouc-Wen law in newton, zero for the others.
    pub slid: Vec<f64>,
}

/// Energy stored in plant and parts, in joule.
///
/// Presliding and friction on a part of the stroke store nothing here: Dahl's bristles give back less than they took, and only F q' as a whole is never negative over a cycle.
pub fn stored_j(chain: &Chain, held: &Snapshot) -> f64 {
    let state = &held.plant;
    let (q, w) = (state.displacement_m, state.velocity_m_per_s);
    let mechanic = 0.5 * (chain.plant.stiffness_n_per_m * q * q + chain.plant.mass_kg * w * w);
    let charge =
        |(i, hysteron): (usize, &Hysteron)| charged_j(hysteron, skew(&chain.parts.bends, i), state.hysteron_v[i]);
    let electric: f64 = chain.plant.hysterons.iter().enumerate().map(charge).sum();
    let elastic = |(force, &h): (&Force, &f64)| match *force {
        Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => {
            q.powi(3) * (quadratic_n_per_m2 / 3.0 + cubic_n_per_m3 / 4.0 * q)
        }
        Force::Fourth { fourth_n_per_m4 } => fourth_n_per_m4 / 5.0 * q.powi(5),
        Force::Fifth { fifth_n_per_m5 } => fifth_n_per_m5 / 6.0 * q.powi(6),
        Force::OneSided { stiffness_n_per_m } => 0.5 * stiffness_n_per_m * q.max(0.0).powi(2),
        Force::Gradual { stiffness_n_per_m, at_m, width_m: w } => {
            let rounded = |x: f64| 0.5 * (x * x.hypot(w) + w * w * (x / w).asinh());
            0.5 * stiffness_n_per_m * (0.5 * q * q + rounded(q - at_m) - rounded(-at_m) - at_m.hypot(w) * q)
        }
        Force::Stop { at_m, stiffness_n_per_m, .. } => {
            0.5 * stiffness_n_per_m * ((q - at_m) * at_m.signum()).max(0.0).powi(2)
        }
        Force::Pad { at_m, stiffness_n_per_m, exponent } => {
            let (unit_m, depth) = in_pad(at_m, q);
            stiffness_n_per_m * unit_m.powi(2) * depth.powf(exponent + 1.0) / (exponent + 1.0)
        }
        // z of a slider.
        Force::Slider { coulomb_n, slip_m } => 0.5 * coulomb_n * slip_m * h * h,
        Force::Detent { period_m, sin_n, cos_n } => detent(q, period_m, sin_n, cos_n)[1],
        Force::Patch { .. } | Force::Presliding { .. } | Force::Smooth { .. } | Force::Power { .. } => 0.0,
        // h h'/A = h q' less what is turned into heat.
        Force::BoucWen(law) => 0.5 * h * h / law.amplitude,
    };
    let forces: f64 = chain.parts.forces.iter().zip(&held.slid).map(elastic).sum();
    let modes: f64 = attached(chain, held)
        .map(|(mass_kg, rad_per_s, _, [y, u])| 0.5 * mass_kg * ((rad_per_s * (y - q)).powi(2) + u * u))
        .sum();
    mechanic + electric + forces + modes
}

/// State of a slider that slides, which rounding may have pushed back a little.
const GIVES_WAY: f64 = 0.999;

/// Power turned into heat in plant and parts, in watt. Never negative, but for presliding and a patch's slider, which give back a part at reversals.
pub fn dissipated_w(chain: &Chain, held: &Snapshot) -> f64 {
    let state = &held.plant;
    let w = state.velocity_m_per_s;
    let leaks: f64 = chain
        .plant
        .hysterons
        .iter()
        .enumerate()
        .map(|(i, hysteron)| state.hysteron_v[i] * leak_a(chain, i, hysteron, state.hysteron_v[i], w))
        .sum();
    let friction = |(force, z): (&Force, &f64)| match *force {
        Force::Presliding { coulomb_n, .. } => coulomb_n * z * w,
        // What it pushes with beyond its spring.
        Force::Stop { at_m, stiffness_n_per_m, damping_s_per_m } => {
            let push_n = |damping| against_stop_n([at_m, stiffness_n_per_m, damping], state.displacement_m, w);
            (push_n(damping_s_per_m) - push_n(0.0)) * w
        }
        Force::Slider { coulomb_n, .. } => {
            if z * w.signum() > GIVES_WAY {
                coulomb_n * w.abs()
            } else {
                0.0
            }
        }
        Force::Patch { coulomb_n, slip_m, at_m, half_width_m } => {
            coulomb_n * on_patch(state.displacement_m, slip_m, at_m, half_width_m) * z * w
        }
        // Never negative if beta >= |gamma|.
        Force::BoucWen(law) => {
            (law.beta * w.abs() * z.abs() + law.gamma * w * z) * z.abs().powf(law.exponent) / law.amplitude
        }
        Force::Smooth { coulomb_n, speed_m_per_s } => coulomb_n * (w / speed_m_per_s).tanh() * w,
        Force::Power { force_n, reference_m_per_s, exponent } => {
            force_n * (w.abs() / reference_m_per_s).powf(exponent) * w.abs()
        }
        Force::Spring { .. }
        | Force::Fourth { .. }
        | Force::Fifth { .. }
        | Force::OneSided { .. }
        | Force::Gradual { .. }
        | Force::Detent { .. } => 0.0,
        Force::Pad { .. } => 0.0,
    };
    let forces: f64 = chain.parts.forces.iter().zip(&held.slid).map(friction).sum();
    let modes: f64 =
        attached(chain, held).map(|(mass_kg, _, damper, [_, u])| mass_kg * damper * (u - w) * (u - w)).sum();
    chain.plant.damping_n_s_per_m * w * w + leaks + forces + modes
}

/// Mass, natural frequency, damper per mass and state of the attached modes.
fn attached<'a>(chain: &'a Chain, held: &'a Snapshot) -> impl Iterator<Item = (f64, f64, f64, [f64; 2])> + 'a {
    let modes = chain.parts.modes.iter().filter_map(|mode| match mode.joint {
        Joint::Attached { mass_kg } => {
            let rad_per_s = TAU * mode.hz;
            Some((mass_kg, rad_per_s, 2.0 * mode.damping_ratio * rad_per_s))
        }
        Joint::Parallel { .. } => None,
    });
    modes.zip(&held.attached).map(|((mass_kg, rad_per_s, damper), &state)| (mass_kg, rad_per_s, damper, state))
}

fn own(bends: &[Bend], i: usize) -> impl Iterator<Item = BendLaw> + '_ {
    bends.iter().filter(move |bend| bend.hysteron.is_none_or(|only| only == i)).map(|bend| bend.law)
}

fn skew(bends: &[Bend], i: usize) -> f64 {
    skewed_by(own(bends, i).map(|law| if let BendLaw::CapacitanceSkew(skew) = law { skew } else { 0.0 }).sum())
}

/// Integral of v C(v) dv with C(v) = C / (1 + skew v / edge), the ratio held beyond the edges.
fn charged_j(hysteron: &Hysteron, skew: f64, v: f64) -> f64 {
    let (c, edge_v) = (hysteron.capacitance_f, hysteron.edge_v());
    if skew == 0.0 || edge_v <= 0.0 {
        return 0.5 * c * v * v;
    }
    let at = v.clamp(-edge_v, edge_v);
    let s = skew / edge_v;
    let x = s * at;
    // (x - ln(1 + x)) / s^2, by its series where the difference would lose its digits.
    let inside = if x.abs() < 1e-3 { at * at * (0.5 - x / 3.0 + x * x / 4.0) } else { (x - x.ln_1p()) / (s * s) };
    c * (inside + 0.5 * (v * v - at * at) / (1.0 + x))
}

fn leak_a(chain: &Chain, i: usize, hysteron: &Hysteron, v: f64, w: f64) -> f64 {
    let edge_v = hysteron.edge_v();
    if edge_v <= 0.0 {
        return hysteron.current_a(v);
    }
    let (mut skew, mut eased, mut exponent, mut opens_v) = (0.0f64, 1.0f64, 1.0f64, edge_v);
    for law in own(&chain.parts.bends, i) {
        match law {
            BendLaw::SlopeSkew(more) => skew += more,
            BendLaw::Exponent(power) => exponent = (exponent + power - 1.0).max(LEAST_EXPONENT),
            BendLaw::Easing { share, reference_m_per_s } => eased += share * w.abs() / reference_m_per_s,
            BendLaw::Widening { share, reference_v_per_s } => {
                let rate = w.abs() * chain.plant.stiffness_n_per_m / chain.plant.transduction_c_per_m;
                opens_v += share * edge_v * rate / reference_v_per_s;
            }
            BendLaw::CapacitanceSkew(_) => {}
        }
    }
    let excess_v = (v.abs() - opens_v).max(0.0);
    let slope_s = hysteron.slope_s * (1.0 + skewed_by(skew) * v.signum()) * eased;
    slope_s * edge_v * (excess_v / edge_v).powf(exponent) * v.signum()
}
