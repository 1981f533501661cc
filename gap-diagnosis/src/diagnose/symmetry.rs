//! Effects that the nominal numbers imitate exactly: a payload, the gains of sensor and amplifier, and a nominal number that is wrong.
//!
//! Each of them moves the refitted numbers along a known direction and leaves the fit as it is, so that nothing but the priors tells
//! them apart (the exact symmetries of the input-output map, `thesis.md` section 1). That is decided here in parameter space, at the
//! weight of the noise, without a simulation: how much cheaper do the shifts become if one direction is free?

use super::bench::{Bench, Hypothesis};
use super::descend::{Found, noise_weights};
use crate::identify::parameters::Quantity;
use nalgebra::{DMatrix, DVector};

/// A direction in the nominal numbers, freed.
#[derive(Clone, Debug)]
pub struct Freed {
    /// The entry.
    pub effect: &'static str,
    /// Which nominal number, for `parameter_error`.
    pub quantity: Option<Quantity>,
    /// Logarithm of the factor: 1 + payload, the gain, or the number over its nominal value.
    pub log_factor: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// What the shifts cost once it is free, chi-square.
    pub cost: f64,
    /// What they cost without it.
    pub cost_without: f64,
}

impl Freed {
    /// Chi-square that freeing the direction saves.
    pub fn gain(&self) -> f64 {
        self.cost_without - self.cost
    }
}

/// The identifiers decided here rather than by simulation.
pub const SYMMETRIC: [&str; 3] = ["payload_mass", "amplifier_gain", "sensor_gain"];

/// All directions, cheapest first.
pub fn freed(bench: &Bench<'_>, hypothesis: &Hypothesis, found: &Found) -> Vec<Freed> {
    let nominal = bench.free.len();
    let Some((information, gradient)) = reduced(bench, hypothesis, found, nominal) else { return Vec::new() };
    let z = DVector::from_column_slice(&found.z[..nominal]);
    let prior = DVector::from_iterator(nominal, bench.free.iter().map(|free| free.prior_sigma.powi(-2)));
    let mut all: Vec<Freed> = directions(bench)
        .into_iter()
        .filter_map(|(effect, quantity, direction)| {
            free_one(&information, &gradient, &z, &prior, &direction).map(|(log_factor, sigma, cost, cost_without)| {
                Freed { effect, quantity, log_factor, sigma, cost, cost_without }
            })
        })
        .collect();
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    all
}

/// Data information and gradient of the nominal numbers once everything else is free to follow.
fn reduced(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    found: &Found,
    nominal: usize,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let (mut information, mut gradient) = found.normal.assemble(&noise_weights(bench));
    let size = information.nrows();
    for (i, rule) in bench.rules(hypothesis).iter().enumerate().skip(nominal) {
        if rule.sigma.is_finite() {
            information[(i, i)] += rule.sigma.powi(-2);
            gradient[i] -= (found.z[i] - rule.centre) / rule.sigma.powi(2);
        } else if information[(i, i)] <= 0.0 {
            information[(i, i)] = 1.0;
        }
    }
    let rest = size - nominal;
    if rest == 0 {
        return Some((information, gradient));
    }
    let own = information.view((nominal, nominal), (rest, rest)).into_owned().cholesky()?;
    let cross = information.view((0, nominal), (nominal, rest)).into_owned();
    let reduced = information.view((0, 0), (nominal, nominal)).into_owned() - &cross * own.solve(&cross.transpose());
    let gradient =
        gradient.rows(0, nominal).into_owned() - &cross * own.solve(&gradient.rows(nominal, rest).into_owned());
    Some((reduced, gradient))
}

pub(super) fn directions(bench: &Bench<'_>) -> Vec<(&'static str, Option<Quantity>, DVector<f64>)> {
    let along = |of: &dyn Fn(Quantity) -> f64| {
        DVector::from_iterator(bench.free.len(), bench.free.iter().map(|f| of(f.quantity)))
    };
    let payload = along(&|q| match q {
        Quantity::DeadZone(_) | Quantity::Delay => 0.0,
        _ => -1.0,
    });
    let gain = |dead_zone: f64| {
        along(&|q| match q {
            Quantity::Transduction => 1.0,
            Quantity::Capacitance(_) | Quantity::Slope(_) => 2.0,
            Quantity::DeadZone(_) => dead_zone,
            _ => 0.0,
        })
    };
    let mut all =
        vec![("payload_mass", None, payload), ("amplifier_gain", None, gain(-1.0)), ("sensor_gain", None, gain(0.0))];
    for free in &bench.free {
        all.push(("parameter_error", Some(free.quantity), along(&|q| f64::from(u8::from(q == free.quantity)))));
    }
    all
}

/// Minimises misfit and shifts over the numbers x = z + d and the free factor m: -2 g.d + d.I.d + (x - m s).P.(x - m s).
fn free_one(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    z: &DVector<f64>,
    prior: &DVector<f64>,
    direction: &DVector<f64>,
) -> Option<(f64, f64, f64, f64)> {
    let n = z.len();
    let cost = |d: &DVector<f64>, m: f64| {
        let away = z + d - direction * m;
        -2.0 * gradient.dot(d) + d.dot(&(information * d)) + away.component_mul(&away).dot(prior)
    };
    let weighed = direction.component_mul(prior);
    let mut a = DMatrix::zeros(n + 1, n + 1);
    let mut b = DVector::zeros(n + 1);
    for i in 0..n {
        for j in 0..n {
            a[(i, j)] = information[(i, j)];
        }
        a[(i, i)] += prior[i];
        a[(i, n)] = -weighed[i];
        a[(n, i)] = -weighed[i];
        b[i] = gradient[i] - prior[i] * z[i];
    }
    a[(n, n)] = weighed.dot(direction) * (1.0 + 1e-12);
    b[n] = weighed.dot(z);
    let factor = a.clone().cholesky()?;
    let solved = factor.solve(&b);
    let without = a.view((0, 0), (n, n)).into_owned().cholesky()?.solve(&b.rows(0, n).into_owned());
    let (d, m) = (solved.rows(0, n).into_owned(), solved[n]);
    let sigma = factor.inverse()[(n, n)].sqrt();
    Some((m, sigma, cost(&d, m), cost(&without, 0.0)))
}
