//! Proposition 3.3.1 of the thesis for any number of hysterons: as printed, and with its units put right.
//!
//! States x = [Q1 .. Qn, q, p, z], z' = q - r, dead zones dropped (h_i = beta_i Q_i/C_i), the loop closed by k1 = Kp and k2 = Ki:
//!
//! ```text
//! Abar = [ A - B K1   -B K2 ]     A' as in (3.29),  B = [0 .. 0, alpha]',  K1 = [0 .. k1 0],  M = [0 .. 1 0]
//!        [    M         0   ]
//! Abar' P + P Abar = -Q,   claim: asymptotically stable if  max beta_i < lambda_min(Q) / (2 lambda_max(P G)),  G = diag(1 .. 1, 0, 0, 0).
//! ```
//!
//! Printed with `+ B K2` the loop is unstable; the printed eigenvalues of P G are those of `- B K2`.
//!
//! **What the claim is worth.** The dead zone adds `g_i theta_i Q_i`, 0 <= theta_i <= 1, to Q_i', and from |V'| follows the condition
//! on the *rates* g_i = beta_i/C_i in 1/s. The print compares the slopes beta_i in siemens, which are smaller by C, seven orders of
//! magnitude. With the units right no Q can do: deep inside its dead zone (theta = 1) a hysteron keeps its charge for ever, the loop
//! has an eigenvalue 0, and no quadratic function of all the states falls. [`Proposition::best_share`] is how far a search gets, as a share
//! of the dead zone's whole effect; below 1 nothing is proven. What can be proven is [`super::certify()`]'s business.

use super::compass::compass;
use super::lyapunov::{Solution, lyapunov};
use crate::phs::Phs;
use nalgebra::{Complex, DMatrix};

/// The proposition evaluated.
#[derive(Debug, Clone)]
pub struct Proposition {
    /// Poles of the loop without dead zones, 1/s, fastest first.
    pub poles_per_s: Vec<Complex<f64>>,
    /// Eigenvalues of P G that are not zero, largest first, for Q = I.
    pub eigenvalues_of_pg: Vec<f64>,
    /// The Lyapunov solution behind them.
    pub solution: Solution,
    /// lambda_min(Q) / (2 lambda_max(P G)) for Q = I: 22.072 in the thesis.
    pub bound: f64,
    /// The same for the best diagonal Q >= I that a search finds. Q = I it is: with Q >= I, P only grows.
    pub best_bound: f64,
    /// max beta_i in siemens, which the thesis compares with the bound.
    pub largest_slope_s: f64,
    /// max beta_i/C_i in 1/s, which belongs there.
    pub largest_rate_per_s: f64,
    /// Share of the dead zones' effect under which some diagonal weights still prove stability, units right: 1 would be all.
    pub best_share: f64,
    /// The same for Q = I.
    pub share: f64,
}

impl Proposition {
    /// Whether the printed inequality holds.
    pub fn printed_holds(&self) -> bool {
        self.solution.is_definite && self.largest_slope_s < self.bound
    }

    /// Whether it holds with its units put right and the best weights found.
    pub fn holds(&self) -> bool {
        self.solution.is_definite && self.best_share > 1.0
    }

    /// What it proves and what not, in plain words.
    pub fn statement(&self) -> String {
        if !self.solution.is_definite {
            return "the loop without dead zones is not proven stable, so the proposition says nothing".to_owned();
        }
        let printed = if self.printed_holds() { "holds" } else { "does not hold" };
        format!(
            "as printed {:.4} < {:.3} {printed}, but it compares siemens with 1/s; with max beta/C = {:.3e} 1/s it proves nothing, \
             and the best weights found bear {:.2e} of the dead zones' effect: the proposition can't certify this loop",
            self.largest_slope_s, self.bound, self.largest_rate_per_s, self.best_share
        )
    }
}

/// Abar for x = [Q1 .. Qn, q, p, z], in SI units.
pub fn closed_loop_matrix(plant: &Phs, kp_v_per_m: f64, ki_v_per_m_s: f64) -> DMatrix<f64> {
    let n = plant.hysterons.len();
    let (alpha, mass) = (plant.transduction_c_per_m, plant.mass_kg);
    let (q, p, z) = (n, n + 1, n + 2);
    let mut a = DMatrix::zeros(n + 3, n + 3);
    for (i, hysteron) in plant.hysterons.iter().enumerate() {
        a[(i, i)] = -hysteron.slope_s / hysteron.capacitance_f;
        a[(i, p)] = alpha / mass;
        a[(p, i)] = -alpha / hysteron.capacitance_f;
    }
    a[(q, p)] = 1.0 / mass;
    a[(p, q)] = -plant.stiffness_n_per_m - alpha * kp_v_per_m;
    a[(p, p)] = -plant.damping_n_s_per_m / mass;
    a[(p, z)] = -alpha * ki_v_per_m_s;
    a[(z, q)] = 1.0;
    a
}

/// Evaluates the proposition; `None` where the equation has no solution, as for a loop without integral action.
pub fn proposition(plant: &Phs, kp_v_per_m: f64, ki_v_per_m_s: f64) -> Option<Proposition> {
    let n = plant.hysterons.len();
    let a = closed_loop_matrix(plant, kp_v_per_m, ki_v_per_m_s);
    let order = n + 3;
    let solution = lyapunov(&a, &DMatrix::identity(order, order))?;
    let block = |p: &DMatrix<f64>| p.view((0, 0), (n, n)).into_owned();
    // P G and the block of P at the charges have the same eigenvalues besides zero.
    let mut eigenvalues_of_pg: Vec<f64> = block(&solution.p).symmetric_eigenvalues().iter().copied().collect();
    eigenvalues_of_pg.sort_by(|a, b| b.total_cmp(a));
    let bound_of = |p: &DMatrix<f64>, least_q: f64| least_q / (2.0 * block(p).symmetric_eigenvalues().max());
    let rates: Vec<f64> = plant.hysterons.iter().map(|h| h.slope_s / h.capacitance_f).collect();
    // Q = diag(e^w) stands for coordinates weighted by e^(w/2); there the dead zones' term is bounded by |P diag(rates)|.
    let share_of = |weights: &[f64], p: &DMatrix<f64>| {
        let weighted = DMatrix::from_fn(order, n, |i, j| p[(i, j)] * (-0.5 * (weights[i] + weights[j])).exp());
        let of_rates = DMatrix::from_fn(order, n, |i, j| weighted[(i, j)] * rates[j]);
        1.0 / (2.0 * of_rates.singular_values().max())
    };
    let solved = |weights: &[f64]| {
        let q = DMatrix::from_fn(order, order, |i, j| if i == j { weights[i].exp() } else { 0.0 });
        lyapunov(&a, &q).filter(|s| s.is_definite)
    };
    let none = vec![0.0; order];
    let (_, best) = compass(&none, |weights| {
        let least = weights.iter().copied().fold(f64::INFINITY, f64::min).exp();
        solved(weights).map_or(f64::INFINITY, |s| -bound_of(&s.p, least))
    });
    // Energy: the weights in which charges, displacement and momentum are comparable; the search starts there.
    let stiffness = plant.stiffness_n_per_m + plant.transduction_c_per_m * kp_v_per_m;
    let mut energy: Vec<f64> = plant.hysterons.iter().map(|h| -h.capacitance_f.ln()).collect();
    let turning_per_s = (stiffness / plant.mass_kg).sqrt();
    energy.extend([stiffness.ln(), -plant.mass_kg.ln(), (stiffness * turning_per_s * turning_per_s).ln()]);
    let (_, best_share) =
        compass(&energy, |weights| solved(weights).map_or(f64::INFINITY, |s| -share_of(weights, &s.p)));
    let mut poles_per_s = {
        let mut balanced = a.clone();
        crate::margins::balance(&mut balanced);
        balanced.complex_eigenvalues().iter().copied().collect::<Vec<_>>()
    };
    poles_per_s.sort_by(|a, b| b.norm().total_cmp(&a.norm()).then(a.im.total_cmp(&b.im)));
    Some(Proposition {
        poles_per_s,
        bound: bound_of(&solution.p, 1.0),
        best_bound: -best,
        largest_slope_s: plant.hysterons.iter().map(|h| h.slope_s).fold(0.0, f64::max),
        largest_rate_per_s: rates.iter().copied().fold(0.0, f64::max),
        share: share_of(&none, &solution.p),
        best_share: -best_share,
        eigenvalues_of_pg,
        solution,
    })
}
