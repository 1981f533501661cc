//! The plant with what was found: numbers with their uncertainty, effects as sections of their own, and the model file.

use super::bench::{Bench, Record};
use super::descend::{covariance, descend, left_out_m2};
use super::directions::FREED_BESIDES;
use super::explanation::Explanation;
use super::fits::AS_WELL;
use super::hypothesis::Freedom;
use super::plants::{self, Begun, Benches, Played, Spread, Variant, carry};
use super::random::Random;
use super::refit::{come_home, has_gap, nominal};
use super::search::{Candidate, Search};
use super::starts::reach;
use super::symmetry::{Freed, directions};
use crate::identify::parameters::{Quantity, Scale};
use nalgebra::{DMatrix, DVector, DVectorView};
use plant_sim::effects::{Parameter, Scope, find};
use plant_sim::model::Model;
use plant_sim::param::Param;
use serde::Serialize;
use std::borrow::Borrow;

/// Sigma that a number gets whose stated one was found wrong, as a logarithm: the logs alone decide.
const NO_PRIOR: f64 = 10.0;
/// Stages of the last descent, which starts where the fit ended.
const AGAIN: [f64; 2] = [3.0, 0.0];
/// Mean square in units of the noise below which a fit is worth more accuracy than the search's.
const NEAR: f64 = 1.2;
/// Starts at rest may leave this share more of what a fit leaves above the noise: so much its form may be wrong by.
const PART_OF_MISFIT: f64 = 0.3;
/// Below this sigma, as a logarithm, a plant is linear in its numbers.
const LINEAR: f64 = 1e-3;
/// Share of the largest variance that is none.
const ROUNDING: f64 = 1e-9;
/// A nominal number has moved beyond this many of its sigma.
const MOVED: f64 = 3.0;
/// A start coordinate whose sigma is still this share of its prior's is not determined.
const UNDETERMINED: f64 = 0.8;

/// A parameter of a named effect.
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// The effect.
    pub effect: String,
    /// Name as in the model file.
    pub name: String,
    /// Value, SI.
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// Unit as a reader writes it.
    pub unit: String,
}

/// A nominal number that moved.
#[derive(Clone, Debug, Serialize)]
pub struct Changed {
    /// Name as in the model file.
    pub name: String,
    /// Value in the plant's file.
    pub nominal: f64,
    /// Value now.
    pub refit: f64,
    /// What the plant's file claims for its standard deviation, same unit.
    pub sigma: f64,
}

/// The plant that is answered with.
pub(super) struct Augmented {
    /// Forms and coordinates.
    pub variant: Variant,
    /// Covariance of the coordinates, residuals correlated as they are.
    covariance: Option<DMatrix<f64>>,
    /// The same if hysterons that agree with it hold nothing when the fitted logs begin, and the probability that they do not.
    at_rest: Option<(DMatrix<f64>, f64)>,
    /// Mean square that each fitted log would leave more if the others alone told the shared numbers, metres squared.
    pub left_out_m2: Option<Vec<f64>>,
    /// Weight of a fitted row of each log in it, per square metre.
    weights: Vec<f64>,
    /// What the nominal numbers imitate, if that is named.
    freed: Vec<Freed>,
    /// Effects that no prediction shows.
    pub random: Vec<Random>,
}

/// Fits what is named once more: laws that the search followed coarsely now as `fine` follows them, effects that the nominal numbers
/// imitate now as effects.
pub(super) fn augment(
    search: &Search<'_>,
    fine: &Bench<'_>,
    refit: &Candidate,
    named: Option<&Explanation>,
    random: Vec<Random>,
) -> Augmented {
    let bench = search.bench;
    let base = named.map_or(refit, |explanation| &explanation.candidate);
    let freed = named.map(|explanation| explanation.freed.clone()).unwrap_or_default();
    if freed.is_empty() {
        let mut base = base.clone();
        // A search ends where it was led to, now and then in a local minimum beside the noise: with its effects known it starts from nominal once more.
        if named.is_some() && !has_gap(&base) {
            base = search.polish_from(base, &nominal(search));
        }
        let base = finely(search, || fine, base);
        let base = if named.is_some() { kept_at_rest(search, base) } else { base };
        return Augmented::by_fit(search, base, freed, random);
    }
    let mut model = bench.model.clone();
    let (mut hypothesis, mut z) = (base.hypothesis.clone(), base.found.z.clone());
    for one in &freed {
        if let Some(effect) = find(one.effect) {
            let with = hypothesis.with(effect, &effect.forms()[0], &bench.scales());
            z = carry(bench, &hypothesis, &z, bench, &with, true);
            hypothesis = with;
            if let Some((_, _, direction)) = directions(bench).iter().find(|(id, _, _)| *id == one.effect) {
                for (z, along) in z.iter_mut().zip(direction.iter()) {
                    *z -= one.along * along;
                }
            }
            bench.set_last(&hypothesis, &mut z, &[one.value]);
        } else if let Some(quantity) = one.quantity {
            // A wrong number: what the file claims for it doesn't hold it any more.
            quantity.record(&mut model).sigma = Some(NO_PRIOR);
        }
    }
    let bench = Bench::new(&model, bench.records.clone());
    let found = descend(&bench, &hypothesis, z, &AGAIN, f64::INFINITY, search.simulations);
    let search = Search { bench: &bench, ..*search };
    // What the numbers made up for has a name now: they need not go on from where that had bent them.
    let is_wrong = |quantity| freed.iter().any(|one| one.quantity == Some(quantity));
    let home: Vec<f64> =
        bench.free.iter().zip(&found.z).map(|(free, z)| if is_wrong(free.quantity) { *z } else { 0.0 }).collect();
    let candidate = come_home(&search, search.candidate(hypothesis, found), &home);
    let candidate = finely(&search, || plants::fine(&model, bench.records.clone()), candidate);
    Augmented::by_fit(&search, kept_at_rest(&search, candidate), freed, random)
}

/// `fit` from starts at rest, if it leaves hardly more and bends no number there: what hysterons hold alike in all logs is as good as a zero until one of them
/// reaches its edge, and then goes astray; a form that is not quite what is on the bench finds some for it to do.
fn kept_at_rest(search: &Search<'_>, fit: Candidate) -> Candidate {
    if fit.hypothesis.has_start() {
        return fit;
    }
    let Some((resting, z)) = fit.hypothesis.at_rest(search.bench, &fit.found.z) else { return fit };
    let found = descend(search.bench, &resting, z, &AGAIN, f64::INFINITY, search.simulations);
    let rest = search.candidate(fit.hypothesis.clone(), found);
    let hardly_more = (AS_WELL - 1.0).max(PART_OF_MISFIT * (fit.chi - 1.0));
    let is_as_well = rest.chi - fit.chi < hardly_more;
    if is_as_well && rest.found.prior_cost < fit.found.prior_cost + FREED_BESIDES { rest } else { fit }
}

/// A fit near the noise whose laws the search followed coarsely, as the bench of `fine` follows them, which is not made for others.
fn finely<'a, B: Borrow<Bench<'a>>>(search: &Search<'_>, fine: impl FnOnce() -> B, fit: Candidate) -> Candidate {
    let has_laws = search.bench.chain_at(&fit.hypothesis, &fit.found.z, 0).parts.need_substeps();
    if !has_laws || fit.chi >= NEAR {
        return fit;
    }
    let (fine, z) = (fine(), fit.found.z.clone());
    let found = descend(fine.borrow(), &fit.hypothesis, z, &AGAIN[1..], f64::INFINITY, search.simulations);
    Candidate { found, ..fit }
}

impl Augmented {
    fn by_fit(search: &Search<'_>, fit: Candidate, freed: Vec<Freed>, random: Vec<Random>) -> Self {
        let weights = search.independent_weights(&fit);
        let Candidate { hypothesis, found, .. } = fit;
        let covariance = covariance(search.bench, &hypothesis, &found, &weights);
        let left_out_m2 = left_out_m2(search.bench, &hypothesis, &found, &weights);
        let hypothesis =
            hypothesis.knowing(search.bench, &found.normal.logs.iter().map(|log| &log.products).collect::<Vec<_>>());
        let resting = covariance.as_ref().and_then(|open| hypothesis.resting(search.bench, &found.z, open));
        let at_rest = resting.and_then(|(resting, charged)| {
            self::covariance(search.bench, &resting, &found, &weights).map(|covariance| (covariance, charged))
        });
        let hypothesis = match at_rest.as_ref().map(|(covariance, _)| covariance).or(covariance.as_ref()) {
            Some(covariance) => hypothesis.telling_held(search.bench, covariance),
            None => hypothesis,
        };
        let variant = Variant { hypothesis, z: found.z, starts_known: true };
        Self { variant, covariance, at_rest, left_out_m2, weights, freed, random }
    }

    /// What the uncertainty of all shared numbers and of the starts makes on the held-out rows that are scored. A few undetermined ones make most of it.
    /// `begun` are these as the held-out logs begin, `fitted` what is predicted for the others.
    pub fn spread(&self, benches: &Benches<'_>, begun: Option<&Begun>, fitted: &[Played]) -> Spread {
        let Some((open, begun)) = self.covariance.as_ref().zip(begun) else { return Spread::default() };
        let moves = |covariance: &DMatrix<f64>| self.moves(benches, fitted, covariance);
        match &self.at_rest {
            None => benches.spread(begun, &moves(open), &[], 0.0),
            Some((at_rest, charged)) => benches.spread(begun, &moves(at_rest), &moves(&(open - at_rest)), *charged),
        }
    }

    /// Independent moves of the shared numbers by a sigma of `covariance` each, what each log has of its own along with them.
    fn moves(&self, benches: &Benches<'_>, fitted: &[Played], covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let shared = benches.fitted.shared(&self.variant.hypothesis);
        if shared == 0 {
            return Vec::new();
        }
        let axes = covariance.view((0, 0), (shared, shared)).clone_owned().symmetric_eigen();
        let least = ROUNDING * axes.eigenvalues.max();
        let one = |(variance, direction): (&f64, DVectorView<'_, f64>)| {
            let sigma = variance.sqrt();
            // What each log has of its own goes along.
            let along = covariance.columns(0, shared) * direction / sigma;
            let reach = if sigma > LINEAR {
                let [there, back] = [1.0, -1.0].map(|sign| self.reach(benches, fitted, &(sign * &along)));
                let farther = if back > there { -1.0 } else { 1.0 };
                farther * (0.5 * (there.powi(2) + back.powi(2))).sqrt()
            } else {
                1.0
            };
            (reach * along).as_slice().to_vec()
        };
        let axes = axes.eigenvalues.iter().zip(axes.eigenvectors.column_iter());
        axes.filter(|(variance, _)| **variance > least).map(one).collect()
    }

    /// [`reach`] of the move `along`, judged by the fitted logs, `fitted` without it. The covariance is that of a linear plant: a hysteron's start
    /// moves nothing near its dead zone's middle, and far from there everything.
    fn reach(&self, benches: &Benches<'_>, fitted: &[Played], along: &DVector<f64>) -> f64 {
        reach(|share| {
            let mut moved = self.variant.clone();
            moved.z.iter_mut().zip(along.iter()).for_each(|(z, by)| *z += share * by);
            let one = |((here, there), (record, weight)): ((&Played, &Played), (&Record<'_>, &f64))| {
                let rows = here.iter().zip(there).skip(record.run_in);
                weight * rows.map(|(here, there)| (here - there).powi(2)).sum::<f64>()
            };
            let logs = benches.fitted.records.iter().zip(&self.weights);
            fitted.iter().zip(&benches.play_fitted(&moved)).zip(logs).map(one).sum()
        })
    }

    /// The number that is wrong, for `parameter_error`.
    pub fn wrong(&self) -> Option<Quantity> {
        self.freed.iter().find_map(|freed| freed.quantity)
    }

    fn sigma(&self, place: usize) -> f64 {
        self.covariance.as_ref().map_or(f64::NAN, |covariance| covariance[(place, place)].max(0.0).sqrt())
    }

    /// Parameters of the effects with their sigma. Of those that every log has of its own, the root mean square over the logs; of a setting,
    /// the mean.
    pub fn estimates(&self, bench: &Bench<'_>) -> Vec<Estimate> {
        let mut estimates = Vec::new();
        let logs = bench.records.len();
        let places: Vec<_> = (0..logs).map(|index| bench.places(&self.variant.hypothesis, index)).collect();
        for (at, installed) in self.variant.hypothesis.installed.iter().enumerate() {
            for (number, axis) in installed.axes.iter().enumerate() {
                let parameter = &axis.parameter;
                let one = |index: usize| {
                    let place = places[index][at][number];
                    let z = self.variant.z[place];
                    (axis.value(z), axis.slope(z).abs() * self.sigma(place))
                };
                let (value, sigma) = if installed.is_setting() {
                    // What the next log may have.
                    let all: Vec<(f64, f64)> = (0..logs).map(one).collect();
                    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| all.iter().map(of).sum::<f64>() / logs as f64;
                    let middle = mean(&|(value, _)| *value);
                    (middle, mean(&|(value, sigma)| (value - middle).powi(2) + sigma.powi(2)).sqrt())
                } else if parameter.is_of_each_log() {
                    let mean2 = |of: &dyn Fn((f64, f64)) -> f64| {
                        ((0..logs).map(|index| of(one(index)).powi(2)).sum::<f64>() / logs as f64).sqrt()
                    };
                    (mean2(&|(value, _)| value), mean2(&|(_, sigma)| sigma))
                } else {
                    one(0)
                };
                // Along a direction in which the prediction doesn't change only the priors know anything, and finite differences less.
                let imitated = self.freed.iter().find(|freed| freed.effect == installed.effect.id());
                let sigma = imitated.map_or(sigma, |freed| sigma.max(freed.value_sigma));
                let sigma = with_mass(within(sigma, parameter.bounds), value, parameter.unit, bench.mass_sigma);
                estimates.push(estimate(installed.effect.id(), parameter, value, sigma));
            }
        }
        for random in &self.random {
            for (parameter, value, sigma) in random.complete(bench) {
                estimates.push(estimate(random.effect.id(), &parameter, value, sigma));
            }
        }
        estimates
    }

    /// Nominal numbers that moved by more than three of their sigma, the wrong one in any case.
    pub fn changed(&self, bench: &Bench<'_>) -> Vec<Changed> {
        let moved = bench.free.iter().zip(&self.variant.z).filter(|(free, z)| {
            log_factor(free.scale, **z).abs() > MOVED * free.prior_sigma || self.wrong() == Some(free.quantity)
        });
        let changed = moved.map(|(free, z)| {
            let unit = free.quantity.per_si();
            Changed {
                name: free.quantity.name(),
                nominal: free.prior * unit,
                refit: free.at(*z) * unit,
                sigma: free.prior_sigma_si() * unit,
            }
        });
        changed.collect()
    }

    /// Quantities of `changed`, in its order.
    pub fn moved(&self, bench: &Bench<'_>) -> Vec<Quantity> {
        let names: Vec<String> = self.changed(bench).into_iter().map(|changed| changed.name).collect();
        bench.free.iter().map(|free| free.quantity).filter(|quantity| names.contains(&quantity.name())).collect()
    }

    /// The model file. What every log has of its own belongs to no plant and is left out, but for what they have in common: a setting is that in the
    /// mean, a drift that comes back is what to expect of another one.
    pub fn model(&self, bench: &Bench<'_>, source: &str) -> Model {
        let mut model = bench.model.clone();
        model.name = format!("{}, diagnosed", model.name);
        for (i, free) in bench.free.iter().enumerate() {
            *free.quantity.record(&mut model) = free.param(self.variant.z[i], self.sigma(i), source);
        }
        let estimates = self.estimates(bench);
        let mut next = estimates.iter();
        for installed in &self.variant.hypothesis.as_usual(bench, &self.variant.z).installed {
            let own: Vec<&Estimate> = next.by_ref().take(installed.axes.len()).collect();
            model = model.with_effect(installed.effect, installed.form, &params(&own, source));
            let Some(section) = model.effects.last_mut().filter(|_| !installed.is_setting()) else { continue };
            for axis in &installed.axes {
                let Parameter { name, scope, .. } = axis.parameter;
                match (scope, axis.usual()) {
                    (Scope::AllLogs, _) => {}
                    (Scope::EachLog, Some([expected, spread])) if expected != 0.0 => {
                        section.parameters.insert(name.to_owned(), Param::absolute(expected, spread, source));
                    }
                    _ => {
                        section.parameters.remove(name);
                    }
                }
            }
        }
        for random in &self.random {
            let own: Vec<&Estimate> = next.by_ref().take(random.complete(bench).len()).collect();
            model = model.with_effect(random.effect, random.form, &params(&own, source));
        }
        model
    }

    /// Logs whose start these logs leave open.
    pub fn undetermined_starts(&self, bench: &Bench<'_>) -> Vec<String> {
        let hypothesis = &self.variant.hypothesis;
        if hypothesis.freedom == Freedom::Relaxed {
            return Vec::new();
        }
        let rules = bench.rules(hypothesis);
        // Hysterons without a dead zone hold nothing at rest: the volts come first, then what each holds, then what swings.
        let (hysterons, memories) = (bench.hysterons(hypothesis), bench.memories(hypothesis));
        let acts = |at: usize| at == 0 || at > hysterons || memories.contains(&(at - 1));
        let is_open = |(at, place): (usize, usize)| acts(at) && self.sigma(place) > UNDETERMINED * rules[place].sigma;
        let open = |index: &usize| bench.start_places(hypothesis, *index).enumerate().any(is_open);
        (0..bench.records.len()).filter(open).map(|index| bench.records[index].log.name.clone()).collect()
    }
}

/// A `sigma` that is no larger than that of anything within the `bounds`, which a linear plant knows nothing of.
fn within(sigma: f64, [low, high]: [f64; 2]) -> f64 {
    let anything = (high - low) / 12f64.sqrt();
    if sigma > anything { anything } else { sigma }
}

fn estimate(effect: &str, parameter: &Parameter, value: f64, sigma: f64) -> Estimate {
    Estimate {
        effect: effect.to_owned(),
        name: parameter.name.to_owned(),
        value,
        sigma,
        unit: parameter.unit.to_owned(),
    }
}

fn params(estimates: &[&Estimate], source: &str) -> Vec<Param> {
    let param =
        |e: &&Estimate| Param::absolute(e.value, if e.sigma.is_finite() { e.sigma } else { e.value.abs() }, source);
    estimates.iter().map(param).collect()
}

/// The `sigma` of a `value` where the mass is known to a share `mass_sigma` of itself, as its file says: with mass, stiffness, damping, transduction,
/// capacitances and slopes all scaled alike every displacement stays what it is, so that no log knows a force better than the mass.
fn with_mass(sigma: f64, value: f64, unit: &str, mass_sigma: f64) -> f64 {
    if unit.starts_with('N') { sigma.hypot(value * mass_sigma) } else { sigma }
}

/// Natural logarithm of the number over its prior.
fn log_factor(scale: Scale, z: f64) -> f64 {
    match scale {
        Scale::Log { bound } => bound * (z / bound).tanh(),
        Scale::Shift { .. } | Scale::NotNegative { .. } => z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_force_is_known_better_than_the_mass() {
        assert_eq!(with_mass(0.03, -4.0, "N/m", 0.01), 0.05);
        assert_eq!(with_mass(0.03, -4.0, "m", 0.01), 0.03);
    }

    #[test]
    fn a_number_that_no_log_tells_is_somewhere_within_its_bounds() {
        assert_eq!(within(9517.0, [-0.5, 0.5]), 1.0 / 12f64.sqrt());
        assert_eq!(within(0.1, [-0.5, 0.5]), 0.1);
        assert!(within(f64::NAN, [0.0, 1.0]).is_nan());
    }
}
