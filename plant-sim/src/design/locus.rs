//! Root loci: where the closed loop's poles go as both gains rise together.

use super::Skeleton;
use crate::chain::Chain;
use crate::linear::roots;
use crate::margins::{LinearRegion, Loop, MarginError, closed_loop_poles};
use nalgebra::Complex;

/// Factors on both gains: from a hundredth to four times, the design's own among them.
const FACTORS: [f64; 2] = [1e-2, 4.0];
/// Points of a locus.
const N_POINTS: usize = 240;
/// A sampled pole smaller than this is a held-back drive or a mode gone within two samples; its logarithm says nothing.
const LEAST: f64 = 0.02;

/// One pole's way, 1/s.
pub type Branch = Vec<Complex<f64>>;

impl Skeleton {
    /// The skeleton as a chain of its own: a mass of one kilogram.
    pub fn chain(&self, like: &Chain) -> Chain {
        let mut chain = like.clone();
        chain.parts = Default::default();
        chain.plant.mass_kg = 1.0;
        chain.plant.damping_n_s_per_m = self.damping_per_s;
        chain.plant.stiffness_n_per_m = self.constant_per_s2;
        chain.plant.transduction_c_per_m = self.gain;
        chain.plant.hysterons.clear();
        chain
    }

    /// Branches of the continuous loop on the skeleton.
    pub fn locus(&self, kp_v_per_m: f64, ki_v_per_m_s: f64) -> Vec<Branch> {
        let g = self.gain;
        branches(|factor| {
            Some(roots(&[
                1.0,
                self.damping_per_s,
                self.constant_per_s2 + factor * g * kp_v_per_m,
                factor * g * ki_v_per_m_s,
            ]))
        })
    }
}

/// Branches of the sampled loop in a region, as ln z / T.
///
/// # Errors
/// As [`closed_loop_poles`].
pub fn sampled_locus(region: &LinearRegion, law: &Loop) -> Result<Vec<Branch>, MarginError> {
    closed_loop_poles(region, law, 1.0)?;
    Ok(branches(|factor| closed_loop_poles(region, law, factor).ok().map(|found| continuous(&found, law.rate_hz))))
}

/// Sampled poles as ln z / T, those that last longer than two samples, slowest first.
pub fn continuous(z: &[Complex<f64>], rate_hz: f64) -> Vec<Complex<f64>> {
    let mut s: Vec<Complex<f64>> = z.iter().filter(|z| z.norm() > LEAST).map(|z| z.ln() * rate_hz).collect();
    s.sort_by(|a, b| a.norm().total_cmp(&b.norm()).then(a.im.total_cmp(&b.im)));
    s
}

/// Follows each pole from one factor to the next by nearness; a pole that comes or goes begins or ends a branch.
fn branches(poles: impl Fn(f64) -> Option<Vec<Complex<f64>>>) -> Vec<Branch> {
    let mut done: Vec<Branch> = Vec::new();
    let mut open: Vec<Branch> = Vec::new();
    for k in 0..N_POINTS {
        let factor = FACTORS[0] * (FACTORS[1] / FACTORS[0]).powf(k as f64 / (N_POINTS - 1) as f64);
        let mut found = poles(factor).unwrap_or_default();
        let mut next: Vec<Branch> = Vec::new();
        for mut branch in open.drain(..) {
            let last = branch.last().copied().unwrap_or_default();
            let nearest =
                (0..found.len()).min_by(|&i, &j| (found[i] - last).norm().total_cmp(&(found[j] - last).norm()));
            match nearest {
                Some(i) => {
                    branch.push(found.swap_remove(i));
                    next.push(branch);
                }
                None => done.push(branch),
            }
        }
        next.extend(found.into_iter().map(|pole| vec![pole]));
        open = next;
    }
    done.extend(open);
    done.retain(|branch| branch.len() > 1);
    done
}
