//! Reducing the hysteron plant to lower order, and what that costs.
//!
//! With the dead zones dropped, a hysteron is a dashpot below its corner beta/C and a spring above it. Setting Qi' = 0 makes it the
//! dashpot at every frequency: Qi/Ci = alpha/beta_i q', so that b grows by alpha^2/beta_i. The thesis does so with both of its
//! hysterons (equation (3.8)). That is right only for one that is much faster than what the mechanics do.

use crate::linear::{StateSpace, poles};
use crate::margins::MarginError;
use crate::phs::Phs;
use nalgebra::Complex;
use std::f64::consts::TAU;

/// Frequencies at which a reduction is compared with what it came from.
const N_FREQUENCIES: usize = 400;

/// A hysteron's time constant against the mechanics'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// C/beta in seconds.
    pub time_constant_s: f64,
    /// The same times the natural frequency sqrt(k/M) of the structure: much less than 1 for one that Qi' = 0 is right for.
    pub of_mechanics: f64,
}

/// A reduced plant and its error.
#[derive(Clone, Debug)]
pub struct Reduction {
    /// What is left.
    pub plant: Phs,
    /// Largest |G_reduced - G| / |G(0)| over frequency, G the plant without dead zones.
    pub worst_error: f64,
    /// Where, in Hz.
    pub worst_hz: f64,
    /// The same for phase, in degrees, up to the natural frequency.
    pub worst_phase_deg: f64,
    /// Poles of what it came from and of what is left, 1/s.
    pub poles_per_s: [Vec<Complex<f64>>; 2],
}

/// How fast each hysteron is.
pub fn speeds(plant: &Phs) -> Vec<Speed> {
    let natural_per_s = (plant.stiffness_n_per_m / plant.mass_kg).sqrt();
    let speed = |time_constant_s: f64| Speed { time_constant_s, of_mechanics: time_constant_s * natural_per_s };
    plant.hysterons.iter().map(|h| speed(h.capacitance_f / h.slope_s)).collect()
}

/// The plant with Qi' = 0 for the hysterons that `quasi_static` marks; the others stay.
///
/// # Errors
/// A coefficient that is not positive.
pub fn quasi_static(plant: &Phs, quasi_static: impl Fn(usize) -> bool) -> Result<Reduction, MarginError> {
    let mut reduced = plant.clone();
    reduced.hysterons.clear();
    for (i, hysteron) in plant.hysterons.iter().enumerate() {
        if quasi_static(i) {
            reduced.damping_n_s_per_m += plant.transduction_c_per_m.powi(2) / hysteron.slope_s;
        } else {
            reduced.hysterons.push(*hysteron);
        }
    }
    let open = |plant: &Phs| plant.linear_region(&vec![true; plant.hysterons.len()]);
    let (full, less) = (StateSpace::from(&open(plant)?), StateSpace::from(&open(&reduced)?));
    let natural_hz = (plant.stiffness_n_per_m / plant.mass_kg).sqrt() / TAU;
    let static_gain = plant.static_gain_m_per_v();
    let (mut worst_error, mut worst_hz, mut worst_phase_deg) = (0.0, 0.0, 0.0f64);
    for k in 0..N_FREQUENCIES {
        let hz = natural_hz * 10f64.powf(-3.0 + 4.5 * k as f64 / (N_FREQUENCIES - 1) as f64);
        if let (Some(g), Some(r)) = (full.response(hz), less.response(hz)) {
            let error = (r - g).norm() / static_gain;
            if error > worst_error {
                (worst_error, worst_hz) = (error, hz);
            }
            if hz <= natural_hz {
                worst_phase_deg = worst_phase_deg.max((r / g).arg().abs().to_degrees());
            }
        }
    }
    Ok(Reduction {
        poles_per_s: [poles(&full.a), poles(&less.a)],
        plant: reduced,
        worst_error,
        worst_hz,
        worst_phase_deg,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phs::Hysteron;

    fn plant(slope_s: f64) -> Phs {
        Phs {
            mass_kg: 1e-3,
            damping_n_s_per_m: 4.0,
            stiffness_n_per_m: 25e3,
            transduction_c_per_m: 0.05,
            hysterons: vec![Hysteron { capacitance_f: 5e-7, slope_s, dead_zone_v: 10.0 }],
        }
    }

    #[test]
    fn a_fast_hysteron_may_go_and_a_slow_one_may_not() {
        let (fast, slow) = (plant(0.5), plant(1e-4));
        let cost = |plant: &Phs| quasi_static(plant, |_| true).expect("positive").worst_error;
        assert!(speeds(&fast)[0].of_mechanics < 1e-2 && speeds(&slow)[0].of_mechanics > 10.0);
        assert!(cost(&fast) < 1e-3, "{}", cost(&fast));
        assert!(cost(&slow) > 0.5, "{}", cost(&slow));
        // Nothing reduced costs nothing.
        assert_eq!(quasi_static(&slow, |_| false).expect("positive").worst_error, 0.0);
    }
}
