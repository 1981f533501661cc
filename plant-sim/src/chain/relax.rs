//! One scalar equation y' = f(y, t), stiff or with a corner, over one sub-step: a mass against friction, a hysteron through its leak.
//!
//! Exponential Rosenbrock method (after Hochbruck, Ostermann and Schweitzer 2009): exact where f is affine in y and t, so that a stiff
//! leak or a mass that sticks takes one step. What f is beyond its tangent is fitted by c2 t^2 + c3 t^3 through the middle and the end;
//! the share of c3 is the estimate of the error.

use super::lag::Moments;

/// f, its derivative by y and its derivative by t.
pub(super) type Slope = [f64; 3];

/// Most inner steps tried; beyond, what is left is taken in one.
const MOST: usize = 8000;
/// After so many, steps are no longer shortened below a thousandth of the whole.
const PATIENCE: usize = 400;
/// Moves `y` over `duration_s` under `f`; the estimate of each inner step's error stays below `tolerance`,
/// unless the step would be shorter than `shortest_s`. Returns the end and the
/// moments of y on the way.
pub(super) fn relax(
    mut y: f64,
    duration_s: f64,
    [tolerance, shortest_s]: [f64; 2],
    f: impl Fn(f64, f64) -> Slope,
) -> (f64, Moments) {
    let mut sum = Moments::default();
    let (mut t, mut step) = (0.0, duration_s);
    let mut now = f(y, t);
    for tried in 0..MOST {
        let left = duration_s - t;
        let last = step >= left * (1.0 - 1e-9) || tried + 1 == MOST;
        let tau = if last { left } else { step };
        // What has no end gets steps that have: a corner met again and again.
        let shortest_s = if tried < PATIENCE { shortest_s } else { shortest_s.max(1e-3 * duration_s) };
        let [slope, by_y, by_t] = now;
        let [phi1, phi2, phi3, phi4, phi5, phi6] = phis(by_y * tau);
        let [half1, half2] = first_phis(0.5 * by_y * tau);
        let half = 0.5 * tau;
        let middle = half * (half1 * slope + half * half2 * by_t);
        let beyond_middle = f(y + middle, t + half)[0] - slope - by_y * middle - by_t * half;
        let linear = tau * (phi1 * slope + tau * phi2 * by_t);
        let guess = linear + 8.0 * tau * phi3 * beyond_middle;
        let beyond_end = f(y + guess, t + tau)[0] - slope - by_y * guess - by_t * tau;
        let c3 = 2.0 * beyond_end - 8.0 * beyond_middle;
        let c2 = beyond_end - c3;
        // All of c3's share: its difference to that of a parabola vanishes for a stiff tangent, however wrong the tangent is.
        let estimate = (6.0 * tau * phi4 * c3).abs();
        if estimate > tolerance && tau > shortest_s && tried + 1 < MOST {
            step = (tau * (0.9 * (tolerance / estimate).sqrt().sqrt()).max(0.1)).max(shortest_s);
            continue;
        }
        let end = y + linear + tau * (2.0 * phi3 * c2 + 6.0 * phi4 * c3);
        let square = tau * tau;
        let zeroth = y * tau + square * (phi2 * slope + tau * phi3 * by_t + 2.0 * phi4 * c2 + 6.0 * phi5 * c3);
        // Integral of the integral, by which the first moment is tau * zeroth - this.
        let twice = square * (0.5 * y + tau * (phi3 * slope + tau * phi4 * by_t + 2.0 * phi5 * c2 + 6.0 * phi6 * c3));
        let first = tau * zeroth - twice;
        // The second moment as that of the cubic with these two moments and these ends.
        let (mean, tilt) = (zeroth / tau, first / square);
        let (c1, c2) = (3.0 * (2.0 * tilt - mean), 0.5 * (y + end) - mean);
        let second = square * tau * (mean / 3.0 + c1 / 6.0 + c2 / 30.0);
        sum.add(Moments { zeroth, first, second }, t);
        y = end;
        if last {
            break;
        }
        t += tau;
        step = tau * (0.9 * (tolerance / estimate.max(1e-30)).sqrt().sqrt()).clamp(0.2, 8.0);
        now = f(y, t);
    }
    (y, sum)
}

/// phi_1 .. phi_6 of z: phi_k(z) = sum of z^n / (n + k)!.
fn phis(z: f64) -> [f64; 6] {
    let mut phi = [0.0; 6];
    if z.abs() < 1.0 {
        let terms = terms(z);
        let sum = (1..=terms).rev().fold(1.0, |sum, n| 1.0 + sum * z * RECIPROCAL[n + 6]);
        phi[5] = sum / 720.0;
        for (k, reciprocal) in [(4, 1.0 / 120.0), (3, 1.0 / 24.0), (2, 1.0 / 6.0), (1, 0.5), (0, 1.0)] {
            phi[k] = z * phi[k + 1] + reciprocal;
        }
    } else {
        let per = 1.0 / z;
        phi[0] = z.exp_m1() * per;
        for (k, reciprocal) in [(1, 1.0), (2, 0.5), (3, 1.0 / 6.0), (4, 1.0 / 24.0), (5, 1.0 / 120.0)] {
            phi[k] = (phi[k - 1] - reciprocal) * per;
        }
    }
    phi
}

/// phi_1 and phi_2.
fn first_phis(z: f64) -> [f64; 2] {
    if z.abs() < 1.0 {
        let second = 0.5 * (1..=terms(z)).rev().fold(1.0, |sum, n| 1.0 + sum * z * RECIPROCAL[n + 2]);
        return [z * second + 1.0, second];
    }
    let first = z.exp_m1() / z;
    [first, (first - 1.0) / z]
}

/// Terms after the first that reach rounding: z^n 6! / (n + 6)! < 1e-16, and the same for the lower ones.
fn terms(z: f64) -> usize {
    if z.abs() < 0.03 { 7 } else { 16 }
}

const RECIPROCAL: [f64; 24] = {
    let mut reciprocal = [1.0; 24];
    let mut k = 1;
    while k < 24 {
        reciprocal[k] = 1.0 / k as f64;
        k += 1;
    }
    reciprocal
};
