//! Lyapunov's equation `A' P + P A = -Q` with a bound on the error of its solution.
//!
//! Solved as a linear system in balanced coordinates, then refined with residuals in twice the working precision; the solution is kept
//! as an unevaluated sum of two matrices, because in SI units a single f64 matrix leaves a residual of 5e-5 of Q on the thesis' loop.
//!
//! The bound needs no condition number. P~ solves the equation for `Q - R` exactly, R being its residual. From `-r Q <= R <= r Q` follows
//! `(1 - r) P <= P~ <= (1 + r) P` in the order of symmetric matrices, so every eigenvalue of every principal block is right to r.

use crate::margins::balance;
use nalgebra::{DMatrix, DVector};

/// Largest order that is solved: the linear system has the square of it as unknowns.
pub const MAX_ORDER: usize = 24;

/// Rounds of refinement; each gains about ten digits and three are enough for a condition of 1e12.
const REFINEMENTS: usize = 4;

/// Unit of rounding of products and sums in twice the working precision, with room for the length of the sums.
const DOUBLE_ROUNDING: f64 = 1e-30;

/// A solution and what is known of its error.
#[derive(Debug, Clone)]
pub struct Solution {
    /// P, rounded to one f64 matrix.
    pub p: DMatrix<f64>,
    /// r: every eigenvalue of P, and of every principal block of it, is right to this relative error before P is rounded.
    pub relative_error: f64,
    /// Largest entry of the residual `A' P + P A + Q`, in the unit of Q.
    pub residual: f64,
    /// Least eigenvalue of P in coordinates in which its diagonal is one.
    pub least_scaled_eigenvalue: f64,
    /// Whether P is positive definite beyond rounding: then the system is proven stable.
    pub is_definite: bool,
}

/// Solves `A' P + P A = -Q` for symmetric Q > 0; `None` if the order is too large or no finite solution exists.
pub fn lyapunov(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Option<Solution> {
    let n = a.nrows();
    if n == 0 || n > MAX_ORDER || a.iter().chain(q.iter()).any(|x| !x.is_finite()) {
        return None;
    }
    // x_old = s x_new: A_new = S^-1 A S, P_new = S P S, all by powers of two and so exact.
    let mut a = a.clone();
    let s = DVector::from_vec(balance(&mut a));
    let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| m[(i, j)] * s[i] * s[j]);
    let q_balanced = scaled(q);
    let kronecker = DMatrix::from_fn(n * n, n * n, |row, col| {
        let ((i, j), (k, l)) = ((row % n, row / n), (col % n, col / n));
        let mut entry = 0.0;
        if l == j {
            entry += a[(k, i)];
        }
        if k == i {
            entry += a[(l, j)];
        }
        entry
    });
    let lu = kronecker.lu();
    let mut high = DMatrix::zeros(n, n);
    let mut low = DMatrix::zeros(n, n);
    let mut left = q_balanced.clone();
    for _ in 0..REFINEMENTS {
        let step = lu.solve(&DVector::from_column_slice((-&left).as_slice()))?;
        let step = DMatrix::from_column_slice(n, n, step.as_slice());
        for i in 0..n {
            for j in 0..n {
                // Symmetric, as the equation's solution is.
                let (sum, lost) = two_sum(high[(i, j)], 0.5 * (step[(i, j)] + step[(j, i)]));
                (high[(i, j)], low[(i, j)]) = two_sum(sum, low[(i, j)] + lost);
            }
        }
        left = residual(&a, &high, &low, &q_balanced);
    }
    if high.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // What the residual's own evaluation may have lost, entry by entry.
    let sizes = a.map(f64::abs).transpose() * high.map(f64::abs);
    let doubt = (&sizes + sizes.transpose() + q_balanced.map(f64::abs)) * DOUBLE_ROUNDING;
    let worst = left.map(f64::abs) + doubt;
    // r in coordinates in which Q is about one, by the sum of rows.
    let size: Vec<f64> = (0..n).map(|i| q_balanced[(i, i)].sqrt()).collect();
    let unit = |m: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| m[(i, j)] / (size[i] * size[j]));
    let row_sum = unit(&worst).row_iter().map(|row| row.sum()).fold(0.0, f64::max);
    let q_unit = unit(&q_balanced);
    let rounding = 1e-15 * (n * n) as f64;
    let least_q = q_unit.symmetric_eigenvalues().min() - rounding;
    if least_q.is_nan() || least_q <= 0.0 {
        return None;
    }
    let relative_error = row_sum / least_q;
    let diagonal: Vec<f64> = (0..n).map(|i| high[(i, i)].max(0.0).sqrt()).collect();
    let least = if diagonal.iter().all(|d| *d > 0.0) {
        DMatrix::from_fn(n, n, |i, j| high[(i, j)] / (diagonal[i] * diagonal[j])).symmetric_eigenvalues().min()
    } else {
        f64::NEG_INFINITY
    };
    Some(Solution {
        residual: DMatrix::from_fn(n, n, |i, j| left[(i, j)] / (s[i] * s[j])).amax(),
        p: DMatrix::from_fn(n, n, |i, j| high[(i, j)] / (s[i] * s[j])),
        relative_error,
        least_scaled_eigenvalue: least,
        is_definite: relative_error < 1.0 && least > rounding,
    })
}

/// `A' P + P A + Q` with P the sum of two matrices, rounded only at the end.
fn residual(a: &DMatrix<f64>, high: &DMatrix<f64>, low: &DMatrix<f64>, q: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    DMatrix::from_fn(n, n, |i, j| {
        let (mut sum, mut rest) = (q[(i, j)], 0.0);
        let mut add = |x: f64, p_high: f64, p_low: f64| {
            let product = x * p_high;
            let lost = x.mul_add(p_high, -product);
            let (next, error) = two_sum(sum, product);
            (sum, rest) = two_sum(next, rest + error + lost + x * p_low);
        };
        for k in 0..n {
            add(a[(k, i)], high[(k, j)], low[(k, j)]);
            add(a[(k, j)], high[(i, k)], low[(i, k)]);
        }
        sum + rest
    })
}

/// Sum and what its rounding lost (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagonal_system_has_the_closed_form() {
        // -2 a_i p_i = -q_i.
        let a = DMatrix::from_diagonal(&DVector::from_vec(vec![-1.0, -4e6]));
        let q = DMatrix::from_diagonal(&DVector::from_vec(vec![3.0, 5.0]));
        let solution = lyapunov(&a, &q).expect("stable");
        assert_eq!(solution.p[(0, 0)], 1.5);
        assert!((solution.p[(1, 1)] / (5.0 / 8e6) - 1.0).abs() < 1e-15);
        assert!(solution.is_definite && solution.relative_error < 1e-20, "{solution:?}");
    }

    #[test]
    fn an_unstable_system_is_not_certified() {
        let a = DMatrix::from_row_slice(2, 2, &[0.5, 1.0, 0.0, -2.0]);
        let solution = lyapunov(&a, &DMatrix::identity(2, 2)).expect("no eigenvalues mirror each other");
        assert!(!solution.is_definite);
        // Eigenvalues that mirror each other leave the equation without a solution.
        let undamped = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, 0.0]);
        assert!(lyapunov(&undamped, &DMatrix::identity(2, 2)).is_none_or(|s| !s.is_definite));
    }
}
