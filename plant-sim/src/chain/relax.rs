//! One scalar equation y' = f(y, t), stiff or with a corner, over one sub-step: a mass against friction, a hysteron through its leak.
//!
//! Exponential Rosenbrock method of third order with an error estimate of second order (Hochbruck, Ostermann and Schweitzer 2009,
//! exprb32): exact where f is affine in y and t, so that a stiff leak or a mass that sticks takes one step, and short steps are spent on
//! corners only.

use super::lag::Moments;

/// f, its derivative by y and its derivative by t.
pub(super) type Slope = [f64; 3];

/// Most inner steps tried; beyond, what is left is taken in one.
const MOST: usize = 8000;
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
        let [slope, by_y, by_t] = now;
        let [phi1, phi2, phi3, phi4, phi5] = phis(by_y * tau);
        let linear = y + tau * (phi1 * slope + tau * phi2 * by_t);
        let then = f(linear, t + tau);
        // What f is beyond its tangent at the end of the step; grows like the square of time.
        let beyond = then[0] - slope - by_y * (linear - y) - by_t * tau;
        let correction = 2.0 * tau * phi3 * beyond;
        let estimate = correction.abs();
        if estimate > tolerance && tau > shortest_s && tried + 1 < MOST {
            step = (tau * (0.9 * (tolerance / estimate).cbrt()).max(0.1)).max(shortest_s);
            continue;
        }
        let end = linear + correction;
        let square = tau * tau;
        let zeroth = y * tau + square * (phi2 * slope + tau * (phi3 * by_t + 2.0 * phi4 * beyond / tau));
        // Integral of the integral, by which the first moment is tau * zeroth - this.
        let twice = square * (0.5 * y + tau * (phi3 * slope + tau * phi4 * by_t + 2.0 * phi5 * beyond));
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
        step = tau * (0.9 * (tolerance / estimate.max(1e-30)).cbrt()).clamp(0.2, 8.0);
        now = f(y, t);
    }
    (y, sum)
}

/// phi_1 .. phi_5 of z: phi_k(z) = sum of z^n / (n + k)!.
fn phis(z: f64) -> [f64; 5] {
    let mut phi = [0.0; 5];
    if z.abs() < 1.0 {
        // 1/20! is below rounding.
        let mut sum = 1.0;
        for n in (1..15).rev() {
            sum = 1.0 + sum * z / (n + 5) as f64;
        }
        phi[4] = sum / 120.0;
        for (k, reciprocal) in [(3, 1.0 / 24.0), (2, 1.0 / 6.0), (1, 0.5), (0, 1.0)] {
            phi[k] = z * phi[k + 1] + reciprocal;
        }
    } else {
        phi[0] = z.exp_m1() / z;
        for (k, reciprocal) in [(1, 1.0), (2, 0.5), (3, 1.0 / 6.0), (4, 1.0 / 24.0)] {
            phi[k] = (phi[k - 1] - reciprocal) / z;
        }
    }
    phi
}
