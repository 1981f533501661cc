//! Laws that are not affine, sub-step by sub-step: what forces and bends add to the rates of the states, constant over a sub-step and
//! taken at its middle.
//!
//! Springs and contacts are taken where the mass will be in the middle. Friction is taken at the velocity at the end, solved for, so
//! that a mass that sticks stays where it is, however steep the law.

use super::{Bend, BendLaw, Force};
use crate::phs::Phs;
use std::f64::consts::TAU;

/// Largest product of the fastest mechanical rate and a sub-step.
const SUBSTEP: f64 = 0.15;
/// Most sub-steps in a sample.
const MOST: f64 = 64.0;
/// A leak faster than this over a sub-step keeps its hysteron on its edge: how exactly it leaks can't be seen.
const STIFF: f64 = 0.5;
/// Iterations for the velocity at a sub-step's end; the bracket halves at least every second one.
const ITERATIONS: usize = 24;

/// The laws with their memory.
pub(super) struct Laws {
    forces: Vec<Force>,
    bends: Vec<Bend>,
    /// z of each presliding friction, in the order of `forces`.
    slid: Vec<f64>,
    /// Rates that were last handed out.
    rates: Vec<f64>,
}

/// Sub-steps of a sample that the forces call for.
pub(super) fn substeps(plant: &Phs, forces: &[Force], stroke_m: f64, sample_s: f64) -> usize {
    let springs: f64 = plant.hysterons.iter().map(|h| plant.transduction_c_per_m.powi(2) / h.capacitance_f).sum();
    let added: f64 = forces
        .iter()
        .map(|force| match *force {
            Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => {
                2.0 * quadratic_n_per_m2.abs() * stroke_m + 3.0 * cubic_n_per_m3.abs() * stroke_m * stroke_m
            }
            Force::OneSided { stiffness_n_per_m } | Force::Stop { stiffness_n_per_m, .. } => stiffness_n_per_m.abs(),
            Force::Presliding { coulomb_n, presliding_m } => coulomb_n.abs() / presliding_m.max(1e-12),
            Force::Smooth { .. } | Force::Power { .. } | Force::Line { .. } => 0.0,
        })
        .sum();
    let rate = ((plant.stiffness_n_per_m + springs + added) / plant.mass_kg).sqrt();
    (rate * sample_s / SUBSTEP).ceil().clamp(1.0, MOST) as usize
}

impl Laws {
    pub(super) fn new(forces: &[Force], bends: &[Bend], states: usize) -> Self {
        let slid = vec![0.0; forces.len()];
        Self { forces: forces.to_vec(), bends: bends.to_vec(), slid, rates: vec![0.0; states] }
    }

    /// Additions to the rates of the states [q, q', v1 ..] over the sub-step of `step_s` that begins at `time_s`, while the drive pulls
    /// with `pull_n` on average.
    pub(super) fn rates(
        &mut self,
        plant: &Phs,
        state: &dyn Fn(usize) -> f64,
        pull_n: f64,
        time_s: f64,
        step_s: f64,
    ) -> &[f64] {
        let (q, v) = (state(0), state(1));
        let held_v: f64 = (0..plant.hysterons.len()).map(|i| state(2 + i)).sum();
        let spring_n = plant.transduction_c_per_m * held_v + plant.stiffness_n_per_m * q + plant.damping_n_s_per_m * v;
        let free = (pull_n - spring_n) / plant.mass_kg;
        let middle_m = q + 0.5 * step_s * (v + 0.25 * step_s * free);
        self.rates.fill(0.0);
        let mut against_n = self.elastic_n(plant, q, middle_m, time_s + 0.5 * step_s);
        let middle_m_per_s = v + 0.5 * step_s * free;
        against_n += self.bend(plant, state, middle_m_per_s, step_s);
        let end_m_per_s = v + step_s * (free - against_n / plant.mass_kg);
        against_n += self.friction_n(end_m_per_s, step_s / plant.mass_kg);
        self.rates[1] -= against_n / plant.mass_kg;
        &self.rates
    }

    /// The sub-step took the mass from `from_m` to `to_m`.
    pub(super) fn moved(&mut self, from_m: f64, to_m: f64) {
        for (force, slid) in self.forces.iter().zip(&mut self.slid) {
            if let Force::Presliding { presliding_m, .. } = *force {
                *slid = dragged(*slid, to_m - from_m, presliding_m);
            }
        }
    }

    fn elastic_n(&self, plant: &Phs, from_m: f64, q: f64, time_s: f64) -> f64 {
        let force_n = |(force, &slid): (&Force, &f64)| match *force {
            Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => q * q * (quadratic_n_per_m2 + cubic_n_per_m3 * q),
            // A spring that would pull the mass away must not outdo the plant's own.
            Force::OneSided { stiffness_n_per_m } => stiffness_n_per_m.max(-0.9 * plant.stiffness_n_per_m) * q.max(0.0),
            Force::Presliding { coulomb_n, presliding_m } => coulomb_n * dragged(slid, q - from_m, presliding_m),
            Force::Stop { at_m, stiffness_n_per_m } => {
                let depth_m = (q - at_m) * at_m.signum();
                stiffness_n_per_m * depth_m.max(0.0) * at_m.signum()
            }
            Force::Line { hz, cos_n, sin_n } => {
                let (sin, cos) = (TAU * hz * time_s).sin_cos();
                -(cos_n * cos + sin_n * sin)
            }
            Force::Smooth { .. } | Force::Power { .. } => 0.0,
        };
        self.forces.iter().zip(&self.slid).map(force_n).sum()
    }

    /// Friction at the velocity v that solves v + `mobility` F(v) = `free_m_per_s`; F grows with v, so v lies between zero and free.
    fn friction_n(&self, free_m_per_s: f64, mobility: f64) -> f64 {
        if !self.forces.iter().any(|f| matches!(f, Force::Smooth { .. } | Force::Power { .. })) {
            return 0.0;
        }
        let law_n = |v: f64| -> f64 {
            let force_n = |force: &Force| match *force {
                Force::Smooth { coulomb_n, speed_m_per_s } => coulomb_n * (v / speed_m_per_s).tanh(),
                Force::Power { force_n, reference_m_per_s, exponent } => {
                    force_n * (v.abs() / reference_m_per_s).powf(exponent).copysign(v)
                }
                _ => 0.0,
            };
            self.forces.iter().map(force_n).sum()
        };
        let (mut low, mut high) = (0.0f64.min(free_m_per_s), 0.0f64.max(free_m_per_s));
        let misfit = |v: f64| v + mobility * law_n(v) - free_m_per_s;
        let (mut at_low, mut at_high) = (misfit(low), misfit(high));
        // A force that drives instead of braking (a negative amplitude on the way of a search) has no such bracket.
        if at_low > 0.0 || at_high < 0.0 {
            return law_n(free_m_per_s);
        }
        let mut v = free_m_per_s;
        for iteration in 0..ITERATIONS {
            if high - low <= 1e-12 * (high.abs() + low.abs()) || at_high - at_low <= 0.0 {
                break;
            }
            let chord = low + (high - low) * (-at_low / (at_high - at_low));
            v = if iteration % 2 == 0 { chord } else { 0.5 * (low + high) };
            let at_v = misfit(v);
            if at_v.abs() <= 1e-10 * free_m_per_s.abs() {
                break;
            }
            if at_v < 0.0 { (low, at_low) = (v, at_v) } else { (high, at_high) = (v, at_v) }
        }
        (free_m_per_s - v) / mobility
    }

    /// Adds what the bends do to the hysterons' rates; returns what they do to the mass, in N against its motion.
    fn bend(&mut self, plant: &Phs, state: &dyn Fn(usize) -> f64, middle_m_per_s: f64, step_s: f64) -> f64 {
        let alpha = plant.transduction_c_per_m;
        let mut against_n = 0.0;
        for bend in &self.bends {
            for (i, hysteron) in plant.hysterons.iter().enumerate() {
                if bend.hysteron.is_some_and(|only| only != i) || hysteron.dead_zone_v <= 0.0 {
                    continue;
                }
                let edge_v = hysteron.edge_v();
                let rate_per_s = hysteron.slope_s / hysteron.capacitance_f;
                let charging = alpha / hysteron.capacitance_f * middle_m_per_s;
                let stiff = rate_per_s * step_s > STIFF;
                // Open and stiff, it sits on its edge; otherwise it is on its way to the middle of the sub-step.
                let now_v = state(2 + i);
                let v = if now_v.abs() >= edge_v && stiff { now_v } else { now_v + 0.5 * step_s * charging };
                let excess_v = (v.abs() - edge_v).max(0.0);
                self.rates[2 + i] += match bend.law {
                    BendLaw::CapacitanceSkew(skew) => skew * (v / edge_v).clamp(-1.0, 1.0) * charging,
                    BendLaw::SlopeSkew(skew) if !stiff => -skew * rate_per_s * excess_v,
                    BendLaw::Exponent(exponent) if !stiff && excess_v > 0.0 => {
                        rate_per_s * (excess_v - edge_v * (excess_v / edge_v).powf(exponent)).copysign(v)
                    }
                    BendLaw::Widening { share, reference_v_per_s } => {
                        let drive_rate = middle_m_per_s.abs() * plant.stiffness_n_per_m / alpha;
                        let wider_v = share * edge_v * drive_rate / reference_v_per_s;
                        if stiff {
                            if now_v.abs() >= edge_v * (1.0 - 1e-9) {
                                against_n += alpha * wider_v.copysign(now_v);
                            }
                            0.0
                        } else {
                            (rate_per_s * wider_v.clamp(-edge_v, excess_v)).copysign(v)
                        }
                    }
                    _ => 0.0,
                };
            }
        }
        against_n
    }
}

/// Dahl's z after `by_m` of motion: z' = (1 - z sign(q')) q' / presliding.
fn dragged(z: f64, by_m: f64, presliding_m: f64) -> f64 {
    let towards = by_m.signum();
    towards + (z - towards) * (-by_m.abs() / presliding_m.max(1e-15)).exp()
}
