//! A proof that the displacement goes to any constant reference, dead zones, switching, sampling and delay included.
//!
//! Hysterons inside their dead zones are springs, so the loop is written about the plant with all of them shut. With r = 0,
//! f = alpha (sum v_i - Ki z), h_i the current through hysteron i and w = q':
//!
//! ```text
//! M w' = -f - (k + alpha Kp) q - b w + alpha Kp d1 + alpha Ki d3
//! q'   = w
//! f'   = (sum alpha^2/C_i) w + alpha Ki (q - d2) - sum (alpha/C_i) h_i
//! ```
//!
//! A continuous law has no d. A sampled one that reads q at t_k and acts with it from t_k + D to t_k + T + D differs from it by
//!
//! ```text
//! d1 = q(t) - q(t_k)        while u(t) acts          |d1| <= g1 |w|,  g1 = D + 2 T/pi
//! d2 = q(t) - q(t_k)        on [t_k, t_k + T)        |d2| <= g2 |w|,  g2 = 2 T/pi  (Wirtinger)
//! d3 = z(t_k + T) - z(t)    while u(t) acts          |d3| <= g3 |z'|, g3 = sqrt(max(T - D, 0)^2 + D^2),  z' = d2 - q
//! ```
//!
//! in the square-integral sense over any time: g1 is a pure delay's gain D and the sampling's 2 T/pi, one after the other.
//!
//! The storage is V = x'Px + 2 sum eta_i C_i int_0^(v_i) h_i. Along the motion (C_i v_i' = alpha w - h_i) it changes by
//! 2 x'P x' + 2 sum eta_i h_i (alpha w - h_i), whatever the slopes and dead zones, as long as h_i v_i >= 0. If for some eta, mu > 0
//!
//! ```text
//! dV/dt + mu1 (g1^2 w^2 - d1^2) + mu2 (g2^2 w^2 - d2^2) + mu3 (g3^2 (q - d2)^2 - d3^2) < 0   for every (x, h, d) other than 0,
//! ```
//!
//! then x and h are square-integrable: q -> r, and every hysteron comes to rest, from any state. That is one linear matrix inequality
//! in P. The multipliers are searched for by its frequency domain form, P comes from the Riccati equation (matrix sign function),
//! and the inequality is then checked as it stands, with a bound on all rounding. It is sufficient, not necessary: "not certified" is no
//! proof of instability. Limits of the drive, converters' steps and references that move are outside.

use super::compass::compass;
use crate::margins::Loop;
use crate::phs::Phs;
use nalgebra::{Complex, DMatrix, Matrix3, SMatrix, Vector3};
use std::f64::consts::{FRAC_2_PI, TAU};

/// Points of the frequency grid that the search looks at; the proof itself is the matrix inequality and needs no grid.
const N_FREQUENCIES: usize = 160;
/// The grid's ends relative to the loop's own frequency.
const FREQUENCIES: [f64; 2] = [1e-4, 1e3];
/// Rounding allowed for in each product and sum of the check, in units of the terms' sizes.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// How the law acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// Without sampling or delay.
    Continuous {
        /// Kp in V/m.
        kp_v_per_m: f64,
        /// Ki in V/(m s).
        ki_v_per_m_s: f64,
    },
    /// Sampled, as [`Loop`] says.
    Sampled(Loop),
}

/// A certificate, or how far it was missed.
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    /// Whether it is proven.
    pub is_certified: bool,
    /// Share of what the method allows that this loop uses, in the frequency domain: below 1 a proof exists.
    pub used: f64,
    /// Where it uses most, in Hz.
    pub worst_hz: f64,
    /// Largest eigenvalue of the matrix inequality, scaled to about one: negative if it holds.
    pub largest_eigenvalue: f64,
    /// Bound on what rounding may have changed that by.
    pub rounding: f64,
    /// Why not, or under which conditions, in words.
    pub statement: String,
}

impl Certificate {
    pub(crate) fn refused(why: &str) -> Self {
        Self {
            is_certified: false,
            used: f64::INFINITY,
            worst_hz: 0.0,
            largest_eigenvalue: f64::INFINITY,
            rounding: 0.0,
            statement: format!("not certified: {why}"),
        }
    }
}

/// Tries to prove that the displacement goes to any constant reference.
pub fn certify(plant: &Phs, law: Law) -> Certificate {
    let (kp, ki) = match law {
        Law::Continuous { kp_v_per_m, ki_v_per_m_s } => (kp_v_per_m, ki_v_per_m_s),
        Law::Sampled(sampled) => (sampled.kp_v_per_m, sampled.ki_v_per_m_s),
    };
    if ki <= 0.0 {
        return Certificate::refused("without integral action the displacement keeps what the hysterons hold");
    }
    let problem = Problem::new(plant, kp, ki, law);
    let slow = problem.a.complex_eigenvalues().iter().map(|z| z.re).fold(f64::NEG_INFINITY, f64::max);
    if slow.is_nan() || slow >= 0.0 {
        return Certificate::refused("with every hysteron shut the loop is unstable, sampling and delay left out");
    }
    let free = problem.b.len();
    if free == 0 {
        return Certificate {
            is_certified: true,
            used: 0.0,
            statement: "certified: a linear loop without sampling, stable by its poles".to_owned(),
            ..Certificate::refused("")
        };
    }
    // One multiplier sets the scale of all.
    let (logs, used) = compass(&vec![0.0; free.saturating_sub(1)], |logs| problem.peak(logs).0);
    let worst_hz = problem.peak(&logs).1 * problem.rate_per_s / TAU;
    if used.is_nan() || used >= 1.0 {
        let why = format!(
            "the loop uses {:.0} % of what this proof allows, near {worst_hz:.0} Hz; that is no proof of instability",
            100.0 * used
        );
        return Certificate { used, worst_hz, ..Certificate::refused(&why) };
    }
    let (largest, rounding) = problem.matrix_inequality(&logs);
    let is_certified = largest + rounding < 0.0;
    let statement = if is_certified {
        "certified: from every state the displacement goes to any constant reference and every hysteron comes to rest, whatever the slopes \
         and dead zones; limits, converter steps and moving references are outside the proof"
            .to_owned()
    } else {
        "not certified: the inequality is too close to its edge for double precision".to_owned()
    };
    Certificate { is_certified, used, worst_hz, largest_eigenvalue: largest, rounding, statement }
}

/// The loop in coordinates where everything is about one: energies, and time in units of the locked resonance.
struct Problem {
    a: Matrix3<f64>,
    /// An input each: hysterons, then d1, d2, d3.
    b: Vec<Vector3<f64>>,
    n_hysterons: usize,
    /// alpha w as the hysterons see it.
    hysteron_row: Vector3<f64>,
    /// g times the output, for d1 and d2; q and g3 for d3.
    gains: [Vector3<f64>; 3],
    /// d2's own share in z', scaled by g3.
    d2_in_third: f64,
    rate_per_s: f64,
}

type Quadratic = (Matrix3<f64>, DMatrix<f64>, DMatrix<f64>);

impl Problem {
    fn new(plant: &Phs, kp: f64, ki: f64, law: Law) -> Self {
        let (alpha, mass) = (plant.transduction_c_per_m, plant.mass_kg);
        let stiffness = plant.stiffness_n_per_m + alpha * kp;
        let rate_per_s = (stiffness / mass).sqrt();
        // x = S y with S = diag(sqrt K, 1/sqrt K, 1/sqrt M) for (f, q, w).
        let s = Vector3::new(stiffness.sqrt(), 1.0 / stiffness.sqrt(), 1.0 / mass.sqrt());
        let springs: f64 = plant.hysterons.iter().map(|h| alpha * alpha / h.capacitance_f).sum();
        let a = Matrix3::new(
            0.0,
            alpha * ki,
            springs,
            0.0,
            0.0,
            1.0,
            -1.0 / mass,
            -stiffness / mass,
            -plant.damping_n_s_per_m / mass,
        );
        let a = Matrix3::from_fn(|i, j| a[(i, j)] * s[j] / s[i] / rate_per_s);
        let input = |column: Vector3<f64>| column.component_div(&s) / rate_per_s;
        // Inputs are measured in units that make their columns about one; the multipliers are searched for anyway.
        let mut b: Vec<Vector3<f64>> =
            plant.hysterons.iter().map(|h| input(Vector3::new(-alpha / h.capacitance_f, 0.0, 0.0))).collect();
        let n_hysterons = b.len();
        let mut gains = [Vector3::zeros(); 3];
        let mut d2_in_third = 0.0;
        if let Law::Sampled(Loop { rate_hz, delay_s, .. }) = law {
            let [g1, g2, g3] = sampling_gains(1.0 / rate_hz, delay_s);
            b.push(input(Vector3::new(0.0, 0.0, alpha * kp / mass)));
            b.push(input(Vector3::new(-alpha * ki, 0.0, 0.0)));
            b.push(input(Vector3::new(0.0, 0.0, alpha * ki / mass)));
            gains = [
                Vector3::new(0.0, 0.0, g1 * s[2]),
                Vector3::new(0.0, 0.0, g2 * s[2]),
                Vector3::new(0.0, g3 * s[1], 0.0),
            ];
            d2_in_third = g3;
        }
        let hysteron_row = Vector3::new(0.0, 0.0, alpha * s[2]);
        Self { a, b, n_hysterons, hysteron_row, gains, d2_in_third, rate_per_s }
    }

    /// Unit of input `i`: chosen so that its loop gain is about one.
    fn unit(&self, i: usize) -> f64 {
        let size = self.b[i].norm();
        if size > 0.0 { 1.0 / size } else { 1.0 }
    }

    /// W, S and R of the quadratic form `x'Wx + 2 x'S u - u'R u` for the logarithms of all multipliers but the first.
    fn quadratic(&self, logs: &[f64]) -> Quadratic {
        let m = self.b.len();
        let multiplier = |i: usize| if i == 0 { 1.0 } else { logs[i - 1].exp() };
        let mut w = Matrix3::zeros();
        let mut s = DMatrix::zeros(3, m);
        let mut r = DMatrix::zeros(m, m);
        for i in 0..self.n_hysterons {
            // In units of the input and so that R is the multiplier: eta = multiplier / (2 unit^2).
            let eta = 0.5 * multiplier(i) / self.unit(i).powi(2);
            for state in 0..3 {
                s[(state, i)] += eta * self.hysteron_row[state] * self.unit(i);
            }
            r[(i, i)] += 2.0 * eta * self.unit(i).powi(2);
        }
        for (of, output) in self.gains.iter().enumerate().take(m - self.n_hysterons) {
            let i = self.n_hysterons + of;
            let mu = multiplier(i) / self.unit(i).powi(2);
            w += output * output.transpose() * mu;
            r[(i, i)] += mu * self.unit(i).powi(2);
            if of == 2 {
                // (q - d2)^2 g3^2.
                let d2 = i - 1;
                let scaled = self.d2_in_third * self.unit(d2);
                for state in 0..3 {
                    s[(state, d2)] -= mu * output[state] * scaled;
                }
                r[(d2, d2)] -= mu * scaled * scaled;
            }
        }
        (w, s, r)
    }

    fn inputs(&self) -> DMatrix<f64> {
        DMatrix::from_fn(3, self.b.len(), |i, j| self.b[j][i] * self.unit(j))
    }

    /// Largest share over the frequency grid of what is allowed, and its place in units of the loop's rate.
    fn peak(&self, logs: &[f64]) -> (f64, f64) {
        let (w, s, r) = self.quadratic(logs);
        let m = self.b.len();
        if (0..m).any(|i| r[(i, i)].is_nan() || r[(i, i)] <= 0.0) {
            return (f64::INFINITY, 0.0);
        }
        let complex = |x: f64| Complex::new(x, 0.0);
        let (a, b) = (self.a.map(complex), self.inputs().map(complex));
        let (w, s) = (w.map(complex), s.map(complex));
        let mut worst = (f64::NEG_INFINITY, 0.0);
        for k in 0..N_FREQUENCIES {
            let along = k as f64 / (N_FREQUENCIES - 1) as f64;
            let at = FREQUENCIES[0] * (FREQUENCIES[1] / FREQUENCIES[0]).powf(along);
            let Some(inverse) = (Matrix3::identity() * Complex::new(0.0, at) - a).try_inverse() else {
                return (f64::INFINITY, at);
            };
            let g = inverse * &b;
            let cross = g.adjoint() * &s;
            let form = g.adjoint() * (w * &g) + &cross + cross.adjoint();
            let unit = DMatrix::from_fn(m, m, |i, j| form[(i, j)] / (r[(i, i)] * r[(j, j)]).sqrt());
            let largest = unit.symmetric_eigenvalues().max();
            if largest.is_nan() || largest > worst.0 {
                worst = (largest, at);
            }
        }
        worst
    }

    /// Largest eigenvalue of the inequality's matrix with the best P found, and a bound on rounding.
    fn matrix_inequality(&self, logs: &[f64]) -> (f64, f64) {
        let mut best = (f64::INFINITY, 0.0);
        // Some room in x: as much as leaves a solution.
        for power in 1..14 {
            let room = 0.5f64.powi(2 * power);
            if let Some(p) = self.riccati(logs, room) {
                let found = self.check(logs, &p);
                if found.0 + found.1 < best.0 + best.1 {
                    best = found;
                }
            }
        }
        best
    }

    /// P of `A'P + PA + W + room + (PB + S) R^-1 (PB + S)' = 0` by the sign of the Hamiltonian matrix.
    fn riccati(&self, logs: &[f64], room: f64) -> Option<Matrix3<f64>> {
        let (w, s, r) = self.quadratic(logs);
        let b = self.inputs();
        let r_inverse = r.try_inverse()?;
        let fixed = |m: DMatrix<f64>| Matrix3::from_fn(|i, j| m[(i, j)]);
        let a = self.a + fixed(&b * &r_inverse * s.transpose());
        let w = w + Matrix3::identity() * room + fixed(&s * &r_inverse * s.transpose());
        let bb = fixed(&b * &r_inverse * b.transpose());
        let mut sign = SMatrix::<f64, 6, 6>::zeros();
        sign.fixed_view_mut::<3, 3>(0, 0).copy_from(&a);
        sign.fixed_view_mut::<3, 3>(0, 3).copy_from(&bb);
        sign.fixed_view_mut::<3, 3>(3, 0).copy_from(&-w);
        sign.fixed_view_mut::<3, 3>(3, 3).copy_from(&-a.transpose());
        for _ in 0..60 {
            let inverse = sign.try_inverse()?;
            let factor = sign.determinant().abs().powf(-1.0 / 6.0);
            let factor = if factor.is_finite() && factor > 0.0 { factor } else { 1.0 };
            let next = (sign * factor + inverse / factor) * 0.5;
            let change = (next - sign).amax() / next.amax();
            sign = next;
            if change < 1e-14 {
                break;
            }
        }
        // (sign + 1) [1; P] = 0.
        let mut left = SMatrix::<f64, 6, 3>::zeros();
        left.copy_from(&sign.fixed_view::<6, 3>(0, 3));
        left[(3, 0)] += 1.0;
        left[(4, 1)] += 1.0;
        left[(5, 2)] += 1.0;
        let mut right = SMatrix::<f64, 6, 3>::zeros();
        right.copy_from(&-sign.fixed_view::<6, 3>(0, 0));
        right[(0, 0)] -= 1.0;
        right[(1, 1)] -= 1.0;
        right[(2, 2)] -= 1.0;
        let p = left.svd(true, true).solve(&right, 1e-14).ok()?;
        let p = (p + p.transpose()) * 0.5;
        p.iter().all(|x| x.is_finite()).then_some(p)
    }

    /// The inequality's matrix for P: its largest eigenvalue in coordinates with a diagonal of minus one, and what rounding may change.
    fn check(&self, logs: &[f64], p: &Matrix3<f64>) -> (f64, f64) {
        let failed = (f64::INFINITY, 0.0);
        let least = p.symmetric_eigenvalues().min();
        if least.is_nan() || least <= 1e-12 * p.amax() {
            return failed;
        }
        let (w, s, r) = self.quadratic(logs);
        let (b, m) = (self.inputs(), self.b.len());
        let top = self.a.transpose() * p + p * self.a + w;
        let side = p * &b + &s;
        let magnitude = self.a.map(f64::abs).transpose() * p.map(f64::abs);
        let top_size = magnitude + magnitude.transpose() + w.map(f64::abs);
        let side_size = p.map(f64::abs) * b.map(f64::abs) + s.map(f64::abs);
        let n = 3 + m;
        let mut whole = DMatrix::zeros(n, n);
        let mut sizes = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..n {
                (whole[(i, j)], sizes[(i, j)]) = match (i < 3, j < 3) {
                    (true, true) => (top[(i, j)], top_size[(i, j)]),
                    (true, false) => (side[(i, j - 3)], side_size[(i, j - 3)]),
                    (false, true) => (side[(j, i - 3)], side_size[(j, i - 3)]),
                    (false, false) => (-r[(i - 3, j - 3)], 2.0 * r[(i - 3, j - 3)].abs()),
                };
            }
        }
        if (0..n).any(|i| whole[(i, i)].is_nan() || whole[(i, i)] >= 0.0) {
            return failed;
        }
        let unit: Vec<f64> = (0..n).map(|i| (-whole[(i, i)]).sqrt()).collect();
        let scaled = |of: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| of[(i, j)] / (unit[i] * unit[j]));
        let row_sum = |of: &DMatrix<f64>| of.row_iter().map(|row| row.map(f64::abs).sum()).fold(0.0, f64::max);
        let (whole, sizes) = (scaled(&whole), scaled(&sizes));
        let rounding = ROUNDING * (row_sum(&sizes) + n as f64 * row_sum(&whole));
        (whole.symmetric_eigenvalues().max(), rounding)
    }
}

/// g1, g2, g3 of the module's page, in seconds, for a period and a delay in seconds.
fn sampling_gains(period_s: f64, delay_s: f64) -> [f64; 3] {
    [delay_s + FRAC_2_PI * period_s, FRAC_2_PI * period_s, (period_s - delay_s).max(0.0).hypot(delay_s)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bound on d1 against the worst sine: q = sin(a t), sampled and held with a delay.
    #[test]
    fn sampling_gains_bound_what_sampling_does() {
        for (period, delay) in [(1.0, 0.0), (1.0, 0.3), (1.0, 1.0), (0.5, 1.7)] {
            let [g1, g2, _] = sampling_gains(period, delay);
            for angle in [0.3, 1.0, 2.0, 3.0, 4.4] {
                let ratio = |late: f64| {
                    let (mut square, mut rate) = (0.0, 0.0);
                    for i in 0..400_000 {
                        let t = 1000.0 + f64::from(i) * 1e-3;
                        let read = ((t - late) / period).floor() * period;
                        square += ((angle * t).sin() - (angle * read).sin()).powi(2);
                        rate += (angle * (angle * t).cos()).powi(2);
                    }
                    (square / rate).sqrt()
                };
                assert!(ratio(delay) <= g1 * 1.001, "d1: {} of {g1} at {angle}", ratio(delay));
                assert!(ratio(0.0) <= g2 * 1.001, "d2: {} of {g2} at {angle}", ratio(0.0));
            }
        }
    }
}
