//! Pole placement for a PI law on a second-order plant.

use super::DesignError;
use crate::chain::Chain;
use crate::reduce::speeds;
use nalgebra::Complex;

/// q'' + psi q' + c q = g u.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skeleton {
    /// g in m/(V s^2).
    pub gain: f64,
    /// psi in 1/s.
    pub damping_per_s: f64,
    /// c in 1/s^2.
    pub constant_per_s2: f64,
}

/// A hysteron this much slower than the mechanics is a spring in the loop's band, otherwise a dashpot.
const SLOW: f64 = 1.0;

impl Skeleton {
    /// The second-order plant behind the chain's.
    ///
    /// # Errors
    /// [`DesignError::NoSkeleton`] for a static plant, or a linear one that is not of second order.
    pub fn of(chain: &Chain) -> Result<Self, DesignError> {
        if let Some(space) = &chain.parts.linear {
            let poles = space.poles();
            let gain = space.static_gain().filter(|gain| gain.is_finite() && *gain > 0.0);
            let (Some(gain), [first, second]) = (gain, poles.as_slice()) else {
                return Err(DesignError::NoSkeleton { why: "it is not of second order with a positive static gain" });
            };
            let constant_per_s2 = (first * second).re;
            return Ok(Self { gain: gain * constant_per_s2, damping_per_s: -(first + second).re, constant_per_s2 });
        }
        if chain.parts.is_massless {
            return Err(DesignError::NoSkeleton { why: "it has no mass" });
        }
        let plant = &chain.plant;
        let (mut damping, mut stiffness) = (plant.damping_n_s_per_m, plant.stiffness_n_per_m);
        for (hysteron, speed) in plant.hysterons.iter().zip(speeds(plant)) {
            if speed.of_mechanics > SLOW {
                stiffness += plant.transduction_c_per_m.powi(2) / hysteron.capacitance_f;
            } else {
                damping += plant.transduction_c_per_m.powi(2) / hysteron.slope_s;
            }
        }
        let m = plant.mass_kg;
        Ok(Self { gain: plant.transduction_c_per_m / m, damping_per_s: damping / m, constant_per_s2: stiffness / m })
    }

    /// sqrt(c), rad/s.
    pub fn natural_per_s(&self) -> f64 {
        self.constant_per_s2.sqrt()
    }
}

/// Gains and the continuous poles that they stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Kp.
    pub kp_v_per_m: f64,
    /// Ki.
    pub ki_v_per_m_s: f64,
    /// The three poles on the skeleton, 1/s: the real one first.
    pub poles_per_s: [Complex<f64>; 3],
}

/// Gains that put a real pole at -`real_per_s` and a pair of natural frequency `pair_per_s`; `None` if the pair would not be damped
/// or a gain not positive.
///
/// (s + a)(s^2 + (psi - a) s + w^2) = s^3 + psi s^2 + (c + g Kp) s + g Ki.
pub fn place(skeleton: &Skeleton, real_per_s: f64, pair_per_s: f64) -> Option<Placement> {
    let sum = skeleton.damping_per_s - real_per_s;
    let square = pair_per_s * pair_per_s;
    let kp_v_per_m = (square + real_per_s * sum - skeleton.constant_per_s2) / skeleton.gain;
    let ki_v_per_m_s = real_per_s * square / skeleton.gain;
    let usable = sum > 0.0 && kp_v_per_m >= 0.0 && ki_v_per_m_s > 0.0;
    let root = Complex::new(0.25 * sum * sum - square, 0.0).sqrt();
    let poles_per_s =
        [Complex::new(-real_per_s, 0.0), Complex::from(-0.5 * sum) + root, Complex::from(-0.5 * sum) - root];
    usable.then_some(Placement { kp_v_per_m, ki_v_per_m_s, poles_per_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::polynomial;

    #[test]
    fn placed_poles_are_the_loops_poles() {
        let skeleton = Skeleton { gain: 45.6, damping_per_s: 3681.0, constant_per_s2: 3.2e7 };
        let placed = place(&skeleton, 600.0, 7000.0).expect("damped");
        let wished = polynomial(&placed.poles_per_s);
        let got = [
            1.0,
            skeleton.damping_per_s,
            skeleton.constant_per_s2 + skeleton.gain * placed.kp_v_per_m,
            skeleton.gain * placed.ki_v_per_m_s,
        ];
        for (wished, got) in wished.iter().zip(got) {
            assert!((wished / got - 1.0).abs() < 1e-12);
        }
        assert!(place(&skeleton, 4000.0, 7000.0).is_none(), "the sum of the poles is -psi");
    }
}
