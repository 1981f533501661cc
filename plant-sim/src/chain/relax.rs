//! One scalar equation y' = f(y, t), stiff or with a corner, over one sub-step: a mass against friction, a hysteron through its leak.
//!
//! Exponential Rosenbrock method (after Hochbruck, Ostermann and Schweitzer 2009): exact where f is affine in y and t, so that a stiff
//! leak or a mass that sticks takes one step. What f is beyond its tangent is fitted by c2 t^2 + c3 t^3 through the middle and the end.
//! The estimate of the error is the share of c3, or, if that is more, what f at the end misses of the rate with which the fit gets there:
//! where the tangent is much too steep, as at a mass that rests under a power law and is pushed, the fit believes that nothing moves.

use super::lag::Moments;

/// f, its derivative by y and its derivative by t.
pub(super) type Slope = [f64; 3];

/// Most inner steps tried; beyond, what is left is taken in one.
const MOST: usize = 8000;
/// After so many, steps are no longer shortened below a thousandth of the whole.
const PATIENCE: usize = 400;

/// Moves `y` over `duration_s` under `f`; the estimate of each inner step's error stays below `tolerance`, unless the step would be shorter than
/// `shortest_s`. Returns the end and the moments of y on the way. Where `rest` knows both for all that is left, it is followed no farther.
pub(super) fn relax(
    mut y: f64,
    duration_s: f64,
    [tolerance, shortest_s]: [f64; 2],
    f: impl Fn(f64, f64) -> Slope,
    rest: impl Fn(f64, f64) -> Option<(f64, Moments)>,
) -> (f64, Moments) {
    let mut sum = Moments::default();
    let (mut t, mut step) = (0.0, duration_s);
    let mut now = f(y, t);
    for tried in 0..MOST {
        if let Some((end, moments)) = rest(y, t) {
            sum.add(moments, t);
            return (end, sum);
        }
        let left = duration_s - t;
        // What is no number any more stays none in one step.
        let last = step >= left * (1.0 - 1e-9) || step.is_nan() || y.is_nan() || tried + 1 == MOST;
        let tau = if last { left } else { step };
        // What has no end gets steps that have: a corner met again and again.
        let shortest_s = if tried < PATIENCE { shortest_s } else { shortest_s.max(1e-3 * duration_s) };
        let [slope, by_y, by_t] = now;
        let ([phi1, phi2, phi3, phi4, phi5, phi6], [half1, half2]) = phis(by_y * tau);
        let half = 0.5 * tau;
        let middle = half * (half1 * slope + half * half2 * by_t);
        let beyond_middle = f(y + middle, t + half)[0] - slope - by_y * middle - by_t * half;
        let linear = tau * (phi1 * slope + tau * phi2 * by_t);
        let guess = linear + 8.0 * tau * phi3 * beyond_middle;
        let beyond_end = f(y + guess, t + tau)[0] - slope - by_y * guess - by_t * tau;
        let c3 = 2.0 * beyond_end - 8.0 * beyond_middle;
        let c2 = beyond_end - c3;
        let end = y + linear + tau * (2.0 * phi3 * c2 + 6.0 * phi4 * c3);
        let next = f(end, t + tau);
        let missed = next[0] - (slope + by_y * (end - y) + by_t * tau + beyond_end);
        // Of a rate that is missed, what the less stiff of both ends lets stand.
        let stiffness_per_s = -by_y.max(next[1]).min(0.0);
        let of_missed = (tau * missed).abs() / (1.0 + tau * stiffness_per_s);
        // All of c3's share: its difference to that of a parabola vanishes for a stiff tangent.
        let estimate = (6.0 * tau * phi4 * c3).abs().max(of_missed);
        if estimate > tolerance && tau > shortest_s && tried + 1 < MOST {
            step = (tau * (0.9 * (tolerance / estimate).sqrt().sqrt()).max(0.1)).max(shortest_s);
            continue;
        }
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
        now = next;
    }
    (y, sum)
}

/// phi_1 .. phi_6 of z and phi_1, phi_2 of half of it: phi_k(z) = sum of z^n / (n + k)!.
fn phis(z: f64) -> ([f64; 6], [f64; 2]) {
    let [h1, h2, h3, h4, h5, h6] = first_six(0.5 * z);
    // What grows from half the way to the whole: all terms are positive, so that nothing cancels.
    let grown = 1.0 + 0.5 * z * h1;
    let whole = [
        0.5 * (grown + 1.0) * h1,
        0.25 * (grown * h2 + h2 + h1),
        0.125 * (grown * h3 + h3 + h2 + 0.5 * h1),
        0.0625 * (grown * h4 + h4 + h3 + 0.5 * h2 + SIXTH * h1),
        0.03125 * (grown * h5 + h5 + h4 + 0.5 * h3 + SIXTH * h2 + 0.25 * SIXTH * h1),
        0.015625 * (grown * h6 + h6 + h5 + 0.5 * h4 + SIXTH * h3 + 0.25 * SIXTH * h2 + 0.05 * SIXTH * h1),
    ];
    (whole, [h1, h2])
}

/// phi_1 .. phi_6 of z.
fn first_six(z: f64) -> [f64; 6] {
    let mut phi = [0.0; 6];
    if z.abs() < 1.0 {
        phi[5] = sixth(z);
        for (k, reciprocal) in [(4, 1.0 / 120.0), (3, 1.0 / 24.0), (2, SIXTH), (1, 0.5), (0, 1.0)] {
            phi[k] = z * phi[k + 1] + reciprocal;
        }
    } else {
        let per = 1.0 / z;
        phi[0] = z.exp_m1() * per;
        for (k, reciprocal) in [(1, 1.0), (2, 0.5), (3, SIXTH), (4, 1.0 / 24.0), (5, 1.0 / 120.0)] {
            phi[k] = (phi[k - 1] - reciprocal) * per;
        }
    }
    phi
}

/// phi_6 of |z| < 1, to rounding; four short sums, so that none waits for the others.
fn sixth(z: f64) -> f64 {
    let c = |n: usize| SERIES[n];
    let (two, four) = (z * z, z * z * z * z);
    let part = |n: usize| (c(n) + z * c(n + 1)) + two * (c(n + 2) + z * c(n + 3));
    if z.abs() < 0.03 {
        return part(0) + four * part(4);
    }
    (part(0) + four * part(4)) + four * four * (part(8) + four * part(12))
}

const SIXTH: f64 = 1.0 / 6.0;

/// 1 / (n + 6)!.
const SERIES: [f64; 16] = {
    let mut series = [1.0 / 720.0; 16];
    let mut n = 1;
    while n < 16 {
        series[n] = series[n - 1] / (n + 6) as f64;
        n += 1;
    }
    series
};
