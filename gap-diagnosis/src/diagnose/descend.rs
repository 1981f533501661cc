//! The annealed descent: damped Gauss-Newton whose unit of residual falls from far above the noise to the noise itself.
//!
//! At the weight of white noise a log of 200,000 samples outweighs every prior, and the first steps would wander into valleys that
//! are almost flat (a capacitance against a dead zone, the slope of a fast hysteron). Counted in a unit much larger than the noise,
//! the priors hold the nominal numbers together until the fit is near.

use super::bench::{Bench, Rule, add_priors, factor, pin_idle};
use super::hypothesis::{Freedom, Hypothesis};
use super::normal::{Normal, Sensitivities, Sums, evaluate, evaluate_again};
use nalgebra::{DMatrix, DVector};
use std::sync::atomic::AtomicUsize;

/// How many times the mean squared residual one sample is uncertain by, stage after stage; the last stage is at the noise itself.
pub const STAGES: [f64; 5] = [3000.0, 300.0, 30.0, 3.0, 0.0];
/// For a start that is near already.
pub const LAST_STAGES: [f64; 2] = [10.0, 0.0];
/// Relative change of the cost at which a stage is over: all but the last, and the last.
const COARSE: f64 = 0.02;
const FINE: f64 = 2e-5;
/// The same of a last stage that stays above these mean squares, in units of the noise: it is not what it looks for.
const MIDDLING: f64 = 2e-4;
const NOT_NEAR: f64 = 1.15;
const ROUGH: f64 = 2e-3;
const FAR: f64 = 2.0;
/// Most that the last step at the noise gains, as chi-square: of a long log a small share of the cost is many sigma.
const LITTLE: f64 = 1.0;
/// Share of its prior's width that a start has before the last stage.
const HELD: f64 = 0.02;
/// Coordinates by which a shape may be off its start before the last stage.
const HELD_SHAPE: f64 = 0.01;
/// Steps at most in a stage and in the last.
const STEPS: usize = 2;
const LAST_STEPS: usize = 16;
/// Steps at most with sensitivities that are carried on, and how many times the cost that they promised the last step may have left.
const CARRIED: usize = 3;
const AS_PROMISED: f64 = 1.2;
/// Steps of the last stage after which it must be getting somewhere.
const FIRST_STEPS: usize = 3;
/// Damping to begin with, and that at which a step is given up, relative to the information's diagonal.
const DAMPING: f64 = 1e-4;
const MOST_DAMPING: f64 = 1e3;

/// Where a descent ended.
#[derive(Clone)]
pub struct Found {
    /// Coordinates.
    pub z: Vec<f64>,
    /// Sums there, with sensitivities.
    pub normal: Normal,
    /// Weighted squares of the fitted rows at the noise.
    pub data_cost: f64,
    /// Squares of the nominal numbers' shifts in sigma.
    pub prior_cost: f64,
}

impl Found {
    /// Rms of the fitted rows in metres.
    pub fn rms_m(&self) -> f64 {
        self.normal.rms_m()
    }
}

/// One over the variance of each log's noise.
pub fn noise_weights(bench: &Bench<'_>) -> Vec<f64> {
    bench.records.iter().map(|r| r.noise_m.powi(-2)).collect()
}

/// Squares of the shifts of all coordinates that have a prior; `only` the first so many.
fn prior_cost(rules: &[Rule], z: &[f64], only: usize) -> f64 {
    rules.iter().zip(z).take(only).map(|(rule, &z)| rule.cost(z)).sum()
}

/// Descends from `z` through `stages`; a last stage that comes to no lower data cost than `to_beat` in a few steps is given up.
pub fn descend(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    mut z: Vec<f64>,
    stages: &[f64],
    to_beat: f64,
    simulations: &AtomicUsize,
) -> Found {
    let rules = bench.rules(hypothesis);
    let start = z.clone();
    let noise = noise_weights(bench);
    let is_beyond = |normal: &Normal, times: f64| normal.misfit(&noise) > times * normal.rows() as f64;
    let mut phases: Vec<(f64, Sensitivities)> = stages.iter().map(|&stage| (stage, Sensitivities::Thinned)).collect();
    if bench.thinned.iter().any(Option::is_some) {
        phases.extend(stages.last().map(|&stage| (stage, Sensitivities::All)));
    }
    // Sums with sensitivities, and the steps since these were taken; of what a step was accepted for the squares are known.
    let taken = |z: &[f64], sensitivities, known: Option<&Normal>| {
        (evaluate_again(bench, hypothesis, z, sensitivities, known, simulations), 0)
    };
    let (mut normal, mut carried) = taken(&z, Sensitivities::Thinned, None);
    // Whether the sums are of squares alone, where all rows come next; and whether none do.
    let (mut is_bare, mut is_given_up) = (false, false);
    for (index, &(softness, sensitivities)) in phases.iter().enumerate() {
        let last = index + 1 >= stages.len();
        if sensitivities == Sensitivities::All {
            if is_given_up || is_beyond(&normal, FAR) {
                break;
            }
            (normal, carried) = taken(&z, sensitivities, None);
            is_bare = false;
        }
        let are_all_next = phases.get(index + 1).is_some_and(|(_, next)| *next != sensitivities);
        let steps = if last { LAST_STEPS } else { STEPS };
        // Where the start is what is to be found, nothing holds it.
        let is_free = last || hypothesis.freedom == Freedom::Any;
        let rules = if is_free { rules.clone() } else { held(bench, hypothesis, &rules, &start) };
        let problem = Problem { bench, hypothesis, rules: &rules, sensitivities, simulations };
        for number in 0..steps {
            if last && number >= FIRST_STEPS && normal.cost(&noise) > to_beat {
                is_given_up = true;
                break;
            }
            let weights = weights(&normal, &noise, softness);
            let before = normal.cost(&weights) + prior_cost(&rules, &z, z.len());
            let Some(step) = problem.step(&z, &normal, &weights, before, carried == 0) else {
                if carried == 0 {
                    break;
                }
                (normal, carried) = taken(&z, sensitivities, None);
                continue;
            };
            z = step.z;
            let gained = before - step.cost;
            let little = match last {
                true if is_beyond(&step.there, FAR) => before * ROUGH,
                true if is_beyond(&step.there, NOT_NEAR) => before * MIDDLING,
                true => (before * FINE).min(LITTLE),
                false => before * COARSE,
            };
            let gains_little = gained <= little;
            let is_over = gains_little && (carried == 0 || !last);
            let is_last_step = last && number + 1 == steps;
            let is_as_promised = step.cost < AS_PROMISED * step.promised;
            if are_all_next && (is_over || is_last_step) {
                (normal, is_bare) = (step.there, true);
                break;
            }
            // Nothing ends on sensitivities that were carried on, but over a last step that gained little from where they were taken.
            let may_carry = match last && (is_over || is_last_step) {
                true => gains_little && carried == 0,
                false => carried + 1 < CARRIED && !gains_little,
            };
            (normal, carried) = match step.carried.filter(|_| may_carry && is_as_promised) {
                Some(next) => (next, carried + 1),
                None => taken(&z, sensitivities, Some(&step.there)),
            };
            if is_over {
                break;
            }
        }
    }
    if is_bare {
        (normal, _) = taken(&z, Sensitivities::Thinned, None);
    }
    let (data_cost, prior_cost) = (normal.cost(&noise), prior_cost(&rules, &z, bench.free.len()));
    Found { data_cost, prior_cost, z, normal: normal.settled() }
}

/// The rules with every log's start held near rest: while residuals count little, a memory of hysterons that costs nothing would take
/// the place of what is to be found, and hysterons forget nothing. Shapes are held where they stand at the `start`: while the numbers are
/// far off, a limit would leave the range in which it acts, and nothing would pull it back.
fn held(bench: &Bench<'_>, hypothesis: &Hypothesis, rules: &[Rule], start: &[f64]) -> Vec<Rule> {
    let mut held = rules.to_vec();
    for index in 0..bench.records.len() {
        for (installed, places) in hypothesis.installed.iter().zip(bench.places(hypothesis, index)) {
            for (_, place) in installed.axes.iter().zip(places).filter(|(axis, _)| !axis.is_amplitude()) {
                held[place] = Rule { centre: start[place], sigma: HELD_SHAPE, ..rules[place] };
            }
        }
        for rule in &mut held[bench.start_places(hypothesis, index)] {
            rule.sigma *= HELD;
        }
    }
    held
}

/// One over what a sample is uncertain by, squared: its log's noise or a multiple of the mean squared residual, whichever is larger.
fn weights(normal: &Normal, noise: &[f64], softness: f64) -> Vec<f64> {
    let soft = softness * normal.rms_m().powi(2);
    noise.iter().map(|weight| 1.0 / (1.0 / weight).max(soft)).collect()
}

/// What a step is taken in.
struct Problem<'a> {
    bench: &'a Bench<'a>,
    hypothesis: &'a Hypothesis,
    rules: &'a [Rule],
    sensitivities: Sensitivities,
    simulations: &'a AtomicUsize,
}

/// A step that lowers the cost.
struct Step {
    /// Coordinates after it.
    z: Vec<f64>,
    /// The cost there, and what it was to be.
    cost: f64,
    promised: f64,
    /// Squares there.
    there: Normal,
    /// Sums there, with sensitivities that are carried on.
    carried: Option<Normal>,
}

impl Problem<'_> {
    /// A step from `z` that lowers the cost from `before`; `None` if no damping finds one, or, unless sensitivities are `fresh`, not the first.
    fn step(&self, z: &[f64], normal: &Normal, weights: &[f64], before: f64, fresh: bool) -> Option<Step> {
        let (mut information, mut gradient) = normal.assemble(weights);
        add_priors(self.rules, z, &mut information, &mut gradient);
        let carried = Sensitivities::Carried { thinned: self.sensitivities == Sensitivities::Thinned };
        let mut damping = DAMPING;
        while damping <= MOST_DAMPING {
            let change = bounded_step(&information, &gradient, self.rules, z, damping)?;
            let to: Vec<f64> = z.iter().zip(change.iter()).map(|(z, c)| z + c).collect();
            let there = evaluate(self.bench, self.hypothesis, &to, carried, self.simulations);
            let cost = there.cost(weights) + prior_cost(self.rules, &to, to.len());
            if cost < before {
                let promised = before - 2.0 * gradient.dot(&change) + change.dot(&(&information * &change));
                let units = information.diagonal().map(|known| known.max(f64::MIN_POSITIVE).sqrt().recip());
                let carried = normal.carried(&there, &change, &units);
                return Some(Step { z: to, cost, promised, there, carried });
            }
            if !fresh {
                return None;
            }
            damping *= 30.0;
        }
        None
    }
}

/// The damped step inside bounds and step limits: what would go farther goes as far as it may, and the rest is solved again.
fn bounded_step(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    rules: &[Rule],
    z: &[f64],
    damping: f64,
) -> Option<DVector<f64>> {
    let size = z.len();
    // A coordinate that changes nothing keeps its place.
    let mut fixed: Vec<Option<f64>> = (0..size).map(|i| (information[(i, i)] <= 0.0).then_some(0.0)).collect();
    for _ in 0..size + 1 {
        let free: Vec<usize> = (0..size).filter(|&i| fixed[i].is_none()).collect();
        let mut a = DMatrix::from_fn(free.len(), free.len(), |i, j| information[(free[i], free[j])]);
        let b = DVector::from_fn(free.len(), |i, _| {
            let carried: f64 =
                (0..size).filter_map(|j| fixed[j].map(|change| information[(free[i], j)] * change)).sum();
            gradient[free[i]] - carried
        });
        for i in 0..free.len() {
            a[(i, i)] *= 1.0 + damping;
        }
        let solved = a.cholesky()?.solve(&b);
        let mut change = DVector::from_fn(size, |i, _| fixed[i].unwrap_or(0.0));
        for (&i, &step) in free.iter().zip(solved.iter()) {
            change[i] = step;
        }
        let mut clean = true;
        for &i in &free {
            let Rule { bounds: [low, high], most, .. } = rules[i];
            let allowed = (low - z[i]).max(-most)..=(high - z[i]).min(most);
            if !allowed.contains(&change[i]) {
                fixed[i] = Some(change[i].max(*allowed.start()).min(*allowed.end()));
                clean = false;
            }
        }
        if clean {
            return Some(change);
        }
    }
    None
}

/// By how much the mean square of each log would be larger, metres squared, if the others alone told the shared numbers, while its own follow:
/// leaving out by groups in a linear plant, under `weights` and priors.
pub(super) fn left_out_m2(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    found: &Found,
    weights: &[f64],
) -> Option<Vec<f64>> {
    let (rules, shared) = (bench.rules(hypothesis), bench.shared(hypothesis));
    let told_by = |weights: &[f64]| {
        let (information, gradient) = with_priors(bench, hypothesis, found, weights);
        Some(factor(information)?.solve(&gradient).rows(0, shared).into_owned())
    };
    let by_all = told_by(weights)?;
    let one = |(index, sums): (usize, &Sums)| {
        let mut others = weights.to_vec();
        others[index] = 0.0;
        let (at, own) = (bench.own_start(hypothesis, index), bench.own(hypothesis));
        // What stays of the log where the shared numbers move by `change` and its own follow.
        let squares_m2 = |change: &DVector<f64>| {
            let weight = weights[index];
            let rest = sums.gradient.rows(shared, own) - sums.products.view((shared, 0), (own, shared)) * change;
            let mut information = weight * sums.products.view((shared, shared), (own, own));
            let mut gradient = weight * rest;
            add_priors(&rules[at..at + own], &found.z[at..at + own], &mut information, &mut gradient);
            pin_idle(&mut information);
            let follows = factor(information)?.solve(&gradient);
            let all = DVector::from_iterator(shared + own, change.iter().chain(&follows).copied());
            Some(sums.squares_m2 - 2.0 * sums.gradient.dot(&all) + all.dot(&(&sums.products * &all)))
        };
        let more = squares_m2(&told_by(&others)?)? - squares_m2(&by_all)?;
        Some(more.max(0.0) / sums.rows.max(1) as f64)
    };
    found.normal.logs.iter().enumerate().map(one).collect()
}

/// Covariance of all coordinates under `weights`, one over the variance of a row of each log; priors included.
pub fn covariance(bench: &Bench<'_>, hypothesis: &Hypothesis, found: &Found, weights: &[f64]) -> Option<DMatrix<f64>> {
    factor(with_priors(bench, hypothesis, found, weights).0).map(|c| c.inverse())
}

/// Information and gradient of all coordinates under `weights`, priors included.
fn with_priors(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    found: &Found,
    weights: &[f64],
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut information, mut gradient) = found.normal.assemble(weights);
    add_priors(&bench.rules(hypothesis), &found.z, &mut information, &mut gradient);
    pin_idle(&mut information);
    (information, gradient)
}
