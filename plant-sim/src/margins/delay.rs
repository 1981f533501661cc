//! The delays at which the sampled loop is on the edge of stability.
//!
//! A delay is not only a turn of the phase here. The drive is held, so a fraction of a sample also changes the size of L a little, most near
//! the Nyquist frequency; `phase margin / crossover` is therefore only the first guess, and `L(omega, D) = -1` is solved for both.

use std::f64::consts::{PI, TAU};

use nalgebra::Complex;

use super::curve::Curve;
use super::sampled::SampledLoop;
use super::{LinearRegion, Loop, is_stable, spectral_radius};

/// The size of L depends on the fraction of a sample, so the search starts from this many fractions.
const N_FRACTIONS: u32 = 8;

/// The smallest delay above `law.delay_s` that puts an eigenvalue on the unit circle; infinite if none does.
pub(super) fn next_critical_delay(region: &LinearRegion, law: &Loop, eigenvalues: &[Complex<f64>]) -> f64 {
    let period_s = 1.0 / law.rate_hz;
    let mut guesses = Vec::new();
    for start in starts(law, law.delay_s, eigenvalues, region) {
        let turn_s = TAU / start.omega;
        // A guess may fall a little short of the present delay although the root does not.
        let earliest = law.delay_s - 0.25 * period_s;
        let first = earliest + (start.critical_delay_s - earliest).rem_euclid(turn_s);
        guesses.extend([(first, start.omega), (first + turn_s, start.omega)]);
    }
    guesses.sort_by(|left, right| left.0.total_cmp(&right.0));

    let mut best = nyquist_critical_delay(region, law).unwrap_or(f64::INFINITY);
    for (guess_s, omega) in guesses {
        if guess_s > best + 2.0 * period_s {
            break;
        }
        if let Some(delay_s) = solve(region, law, guess_s, omega)
            && delay_s > law.delay_s
        {
            best = best.min(delay_s);
        }
    }
    best
}

/// For a loop that is unstable at its delay: the largest smaller delay from which on downwards it is stable, if there is one within
/// the first turn of the phase.
pub(super) fn stabilising_delay(region: &LinearRegion, law: &Loop, eigenvalues: &[Complex<f64>]) -> Option<f64> {
    let mut edges: Vec<f64> = starts(law, 0.0, eigenvalues, region)
        .into_iter()
        .filter_map(|start| solve(region, law, start.critical_delay_s.rem_euclid(TAU / start.omega), start.omega))
        .chain(nyquist_critical_delay(region, &Loop { delay_s: 0.0, ..*law }))
        .filter(|&delay_s| delay_s > 0.0 && delay_s < law.delay_s)
        .collect();
    edges.sort_by(f64::total_cmp);
    for (i, &edge) in edges.iter().enumerate().rev() {
        let below = if i == 0 { 0.0 } else { edges[i - 1] };
        // The same edge is found from several starts; between two copies there is no interval to try.
        if edge - below < 1e-9 / law.rate_hz {
            continue;
        }
        let between = Loop { delay_s: 0.5 * (below + edge), ..*law };
        let found = SampledLoop::new(region, &between).and_then(|sampled| sampled.closed_loop_eigenvalues(1.0));
        if found.is_some_and(|eigenvalues| is_stable(spectral_radius(&eigenvalues))) {
            return Some(edge);
        }
    }
    None
}

struct Start {
    /// A delay that would be critical if a delay only turned the phase; one of many, a turn apart.
    critical_delay_s: f64,
    omega: f64,
}

fn starts(law: &Loop, from_delay_s: f64, eigenvalues: &[Complex<f64>], region: &LinearRegion) -> Vec<Start> {
    let mut starts = Vec::new();
    for i in 0..N_FRACTIONS {
        let delay_s = from_delay_s + f64::from(i) / f64::from(N_FRACTIONS) / law.rate_hz;
        let Some(sampled) = SampledLoop::new(region, &Loop { delay_s, ..*law }) else {
            continue;
        };
        let Some(curve) = Curve::trace(&sampled, eigenvalues) else {
            continue;
        };
        for (angle, value) in curve.unity_crossings() {
            let omega = angle * law.rate_hz;
            starts.push(Start { critical_delay_s: delay_s + (-value).arg() / omega, omega });
        }
    }
    starts
}

/// Newton's method for `ln(-L(omega, D)) = 0` in omega and D.
fn solve(region: &LinearRegion, law: &Loop, guess_s: f64, omega_guess: f64) -> Option<f64> {
    let period_s = 1.0 / law.rate_hz;
    let at = |delay_s: f64| SampledLoop::new(region, &Loop { delay_s, ..*law });
    let residual = |sampled: &SampledLoop, angle: f64| (-sampled.open_loop(angle)).ln();
    let mut delay_s = guess_s.max(0.0);
    let mut angle = omega_guess * period_s;
    // Quadratic from a guess that is good to a part of a sample: five or six steps in practice.
    for _ in 0..40 {
        let here = at(delay_s)?;
        let value = residual(&here, angle);
        // Steps of a millionth: the slopes are then good to a millionth, enough for Newton.
        let delay_step_s = 1e-6 * period_s;
        let angle_step = -1e-6 * angle;
        let by_delay = (residual(&at(delay_s + delay_step_s)?, angle) - value) / delay_step_s;
        let by_angle = (residual(&here, angle + angle_step) - value) / angle_step;
        let determinant = by_delay.re * by_angle.im - by_delay.im * by_angle.re;
        let delay_change_s = (value.im * by_angle.re - value.re * by_angle.im) / determinant;
        let angle_change = (value.re * by_delay.im - value.im * by_delay.re) / determinant;
        if !delay_change_s.is_finite() || !angle_change.is_finite() {
            return None;
        }
        // No step longer than half a sample or half the frequency: further away the slopes mean nothing.
        delay_s = (delay_s + delay_change_s.clamp(-0.5 * period_s, 0.5 * period_s)).max(0.0);
        angle = (angle + angle_change.clamp(-0.5 * angle, 0.5 * angle)).min(PI);
        if value.norm() < 1e-12 && delay_change_s.abs() < 1e-9 * period_s {
            return Some(delay_s);
        }
    }
    None
}

/// At the Nyquist frequency L is real for every delay, so an eigenvalue can also leave at -1, at a delay that no crossover announces.
/// L(-1) changes sign with every whole sample: two samples show every case.
fn nyquist_critical_delay(region: &LinearRegion, law: &Loop) -> Option<f64> {
    let period_s = 1.0 / law.rate_hz;
    let beyond = |delay_s: f64| {
        let sampled = SampledLoop::new(region, &Loop { delay_s, ..*law })?;
        Some(sampled.open_loop(PI).re + 1.0)
    };
    let mut left = (law.delay_s, beyond(law.delay_s)?);
    for i in 1..=2 * N_FRACTIONS {
        let delay_s = law.delay_s + f64::from(i) / f64::from(N_FRACTIONS) * period_s;
        let right = (delay_s, beyond(delay_s)?);
        if left.1 * right.1 < 0.0 {
            let (mut a, mut b) = (left.0, right.0);
            for _ in 0..50 {
                let middle = 0.5 * (a + b);
                if beyond(middle)? * left.1 > 0.0 {
                    a = middle;
                } else {
                    b = middle;
                }
            }
            return Some(0.5 * (a + b));
        }
        left = right;
    }
    None
}
