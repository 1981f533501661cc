//! The linear regions of a hysteron plant: one per set of hysterons that are outside their dead zone.
//!
//! | letter | meaning | unit |
//! | --- | --- | --- |
//! | `q`, `w` | displacement and velocity | m, m/s |
//! | `v_i = Q_i / C_i` | voltage of hysteron i | V |
//! | `M`, `k`, `b` | mass, stiffness, damping | kg, N/m, N s/m |
//! | `alpha` | transduction factor | C/m = N/V |
//! | `C_i`, `beta_i` | capacitance and slope of the dead-zone admittance | F, S |
//!
//! ```text
//! q'   = w
//! w'   = (alpha u - alpha sum v_i - k q - b w) / M
//! v_i' = alpha/C_i w - beta_i/C_i (v_i -+ d_i/2)     active
//! v_i' = alpha/C_i w                                 inside the dead zone
//! ```
//!
//! The offset `-+ d_i/2` moves the equilibrium and not the dynamics, so the two signs of an active hysteron share one region.
//! An inactive hysteron integrates exactly, `v_i = alpha/C_i q + const`: it is a spring, and is eliminated as the stiffness
//! `alpha^2/C_i`. Kept as a state it would give the sampled loop an eigenvalue of exactly 1 that no input moves and that the
//! controller cannot touch. That is the memory of the hysteresis, not a verdict on the loop. One whose slope is zero is always a spring.

use nalgebra::{DMatrix, DVector, RowDVector};

use super::MarginError;
use crate::chain::{Chain, Force};
use crate::phs::{Hysteron, Phs};

/// More hysterons that open and shut than this would mean more than 65536 regions, which is a mistake in the caller rather than a plant.
const MAX_HYSTERONS: usize = 16;

/// One linear region in continuous time, from the drive u in volts to the displacement q in metres:
/// `x' = a x + b u`, `q = c x + d u`. Any state coordinates will do.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearRegion {
    /// What a reader calls this region, such as `hysterons 1, 2 active`.
    pub label: String,
    /// State matrix, 1/s.
    pub a: DMatrix<f64>,
    /// Input column, per volt and second.
    pub b: DVector<f64>,
    /// Output row, metres.
    pub c: RowDVector<f64>,
    /// What of the drive is seen at once, metres per volt.
    pub d: f64,
}

/// Linear regions of whatever plant the chain has.
impl Chain {
    /// Those of the hysterons ([`Phs::linear_regions`]); of a linear plant, itself; beside a law of hysteresis each of them at its least and its
    /// largest slope. Each with all that is linear in the chain beside it: modes, creep, arms, and gain and bandwidth of sensor and amplifier. The
    /// drive's delay is the loop's ([`crate::experiment::sampled_loop`]), and what is not linear is left out.
    ///
    /// # Errors
    /// See [`MarginError`].
    pub fn linear_regions(&self) -> Result<Vec<LinearRegion>, MarginError> {
        Ok(self.regions_of_plant()?.into_iter().map(|region| self.around(region)).collect())
    }

    fn regions_of_plant(&self) -> Result<Vec<LinearRegion>, MarginError> {
        if let Some(space) = &self.parts.linear {
            return Ok(vec![space.region("linear plant")]);
        }
        if self.parts.is_massless {
            return Err(MarginError::Massless);
        }
        let of_structure = self.regions_of_structure()?;
        let Some(transducer) = &self.parts.transducer else { return Ok(of_structure) };
        let alpha = self.plant.transduction_c_per_m;
        let slopes = transducer.law.operator().slopes_per_v().map(|slope| alpha - transducer.force_n * slope);
        let mut regions = Vec::with_capacity(2 * of_structure.len());
        for (alpha, law) in slopes.into_iter().zip(["hysteresis, least slope", "hysteresis, greatest slope"]) {
            let mut under = under_law(law, of_structure.clone());
            under.iter_mut().for_each(|region| region.b[1] = alpha / self.plant.mass_kg);
            regions.append(&mut under);
        }
        Ok(regions)
    }

    /// Regions under the voltage as it is.
    fn regions_of_structure(&self) -> Result<Vec<LinearRegion>, MarginError> {
        let law = |force: &Force| if let Force::BoucWen(law) = force { Some(*law) } else { None };
        let Some(law) = self.parts.forces.iter().find_map(law) else { return self.plant.linear_regions() };
        let mut regions = Vec::new();
        for (slope, law) in law.slopes(0.0).into_iter().zip(["Bouc-Wen, saturated", "Bouc-Wen, after a turn"]) {
            let stiffer = Phs { stiffness_n_per_m: self.plant.stiffness_n_per_m + slope, ..self.plant.clone() };
            regions.append(&mut under_law(law, stiffer.linear_regions()?));
        }
        Ok(regions)
    }
}

/// The regions under one slope of a law of hysteresis; where there is but one, the law is all there is to say of it.
fn under_law(law: &str, mut regions: Vec<LinearRegion>) -> Vec<LinearRegion> {
    let is_alone = regions.len() == 1;
    for region in &mut regions {
        region.label = if is_alone { law.to_owned() } else { format!("{law}, {}", region.label) };
    }
    regions
}

/// Linear regions of the plant.
impl Phs {
    /// All `2^n` regions of n hysterons that open and shut: the one with every such hysteron active first, the one with none active last. One
    /// without a dead zone is always active.
    pub fn linear_regions(&self) -> Result<Vec<LinearRegion>, MarginError> {
        let switches = |hysteron: &Hysteron| hysteron.dead_zone_v > 0.0 && hysteron.slope_s > 0.0;
        let switching: Vec<usize> = (0..self.hysterons.len()).filter(|&i| switches(&self.hysterons[i])).collect();
        let n_hysterons = switching.len();
        if n_hysterons > MAX_HYSTERONS {
            return Err(MarginError::TooManyHysterons { n_hysterons, limit: MAX_HYSTERONS });
        }
        (0..1_usize << n_hysterons)
            .rev()
            .map(|mask| {
                let mut active = vec![true; self.hysterons.len()];
                switching.iter().enumerate().for_each(|(bit, &i)| active[i] = mask >> bit & 1 == 1);
                self.linear_region(&active)
            })
            .collect()
    }

    /// The region with exactly the hysterons marked in `active` outside their dead zone; states `q, w, v` of the active ones.
    /// Hysterons beyond the end of `active` count as inactive, and so does one without a slope, which is a spring on either side.
    pub fn linear_region(&self, active: &[bool]) -> Result<LinearRegion, MarginError> {
        self.check_coefficients()?;
        let is_active = |&i: &usize| active.get(i).copied().unwrap_or(false) && self.hysterons[i].slope_s > 0.0;
        let (active_idxs, inactive_idxs): (Vec<usize>, Vec<usize>) = (0..self.hysterons.len()).partition(is_active);

        let alpha = self.transduction_c_per_m;
        let added_stiffness: f64 = inactive_idxs.iter().map(|&i| alpha * alpha / self.hysterons[i].capacitance_f).sum();
        let n_states = 2 + active_idxs.len();
        let mut a = DMatrix::zeros(n_states, n_states);
        a[(0, 1)] = 1.0;
        a[(1, 0)] = -(self.stiffness_n_per_m + added_stiffness) / self.mass_kg;
        a[(1, 1)] = -self.damping_n_s_per_m / self.mass_kg;
        for (state_idx, &i) in (2..).zip(&active_idxs) {
            let Hysteron { capacitance_f, slope_s, .. } = self.hysterons[i];
            a[(1, state_idx)] = -alpha / self.mass_kg;
            a[(state_idx, 1)] = alpha / capacitance_f;
            a[(state_idx, state_idx)] = -slope_s / capacitance_f;
        }
        let mut b = DVector::zeros(n_states);
        b[1] = alpha / self.mass_kg;
        let mut c = RowDVector::zeros(n_states);
        c[0] = 1.0;
        Ok(LinearRegion { label: label(&active_idxs), a, b, c, d: 0.0 })
    }

    fn check_coefficients(&self) -> Result<(), MarginError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        // A plant without damping of its own is legitimate: the hysterons damp it.
        let not_negative = |value: f64| value.is_finite() && value >= 0.0;
        let complain = |name, value| Err(MarginError::BadCoefficient { name, value });
        if !positive(self.mass_kg) {
            return complain("mass_kg", self.mass_kg);
        }
        if !positive(self.stiffness_n_per_m) {
            return complain("stiffness_n_per_m", self.stiffness_n_per_m);
        }
        if !not_negative(self.damping_n_s_per_m) {
            return complain("damping_n_s_per_m", self.damping_n_s_per_m);
        }
        if !positive(self.transduction_c_per_m) {
            return complain("transduction_c_per_m", self.transduction_c_per_m);
        }
        for hysteron in &self.hysterons {
            if !positive(hysteron.capacitance_f) {
                return complain("capacitance_f", hysteron.capacitance_f);
            }
            if !not_negative(hysteron.slope_s) {
                return complain("slope_s", hysteron.slope_s);
            }
        }
        Ok(())
    }
}

fn label(active_idxs: &[usize]) -> String {
    let numbers: Vec<String> = active_idxs.iter().map(|i| (i + 1).to_string()).collect();
    match numbers.len() {
        0 => "no hysteron active".to_string(),
        1 => format!("hysteron {} active", numbers[0]),
        _ => format!("hysterons {} active", numbers.join(", ")),
    }
}
