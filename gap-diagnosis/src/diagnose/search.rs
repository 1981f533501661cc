//! The search: refit of the nominal plant, screening, full fits of what survives, alone and in pairs.

use super::bench::{Bench, Record};
use super::descend::{Found, LAST_STAGES, STAGES, descend, noise_weights};
use super::hypothesis::{Freedom, Hypothesis};
use super::normal::{Sensitivities, evaluate, reader};
use super::plants::carry;
use super::screen::{Lead, Starts, screen};
use super::starts::{settle, settle_anew, settle_in_all_of};
use crate::residual::samples_per_independent;
use plant_sim::effects::{Effect, Form, Kind, Parameter, Role};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::sync::atomic::AtomicUsize;

/// A log is locked if its mean square, in units of the noise, is beyond this, and so many times that of the log in the middle.
const LOCKED_LEAST: f64 = 1.3;
const LOCKED: f64 = 2.0;
/// .. if the one in the middle is fitted this well: where the plant is wrong, no start helps.
const NEARLY: f64 = 4.0;
/// [`LOCKED`] of a refit, on which everything else hangs.
const LOCKED_REFIT: f64 = 1.4;
/// The same, and [`LOCKED_LEAST`], where the starts are what is to be found.
const LOCKED_START: f64 = 1.05;

/// A log is worse than the others if its mean square is beyond so many times that of the one in the middle, ..
const WORSE: f64 = 1.15;
/// .. and they lead so often, where that takes this much of the cost.
const LED_ROUNDS: usize = 2;
const LED_BY: f64 = 1.0;

/// An effect that leaves more than this of the squares soon is not followed farther.
const WORTH_MORE: f64 = 0.85;

/// A hypothesis, fitted.
#[derive(Clone)]
pub struct Candidate {
    /// What was fitted.
    pub hypothesis: Hypothesis,
    /// Where it ended.
    pub found: Found,
    /// Mean square of the fitted rows in units of the noise; one at the noise.
    pub chi: f64,
    /// The same of each log.
    pub chis: Vec<f64>,
}

impl Candidate {
    /// Fraction of the gap of `refit` that this leaves, as amplitude, where `noise` is the mean square of a fit at the noise.
    pub fn left(&self, refit: &Candidate, noise: f64) -> f64 {
        ((self.chi - noise).max(0.0) / (refit.chi - noise).max(1e-12)).sqrt()
    }

    /// Whether `whole` has all numbers of the effects here, by name, and others.
    pub fn is_part_of(&self, whole: &Candidate) -> bool {
        let [own, all] = [self, whole].map(|fit| {
            let axes = fit.hypothesis.installed.iter().flat_map(|installed| &installed.axes);
            axes.map(|axis| axis.parameter.name).collect::<Vec<&str>>()
        });
        own.len() < all.len() && own.iter().all(|name| all.contains(name))
    }

    /// Rows that were fitted.
    pub fn rows(&self) -> usize {
        self.found.normal.rows()
    }
}

/// What a candidate leaves of one log.
pub struct Remainder {
    /// Measured minus predicted, metres.
    pub residual_m: Vec<f64>,
    /// Velocity of the plant.
    pub velocity_m_per_s: Vec<f64>,
}

/// Each log's record with what a candidate leaves of it after the run-in.
pub(super) fn after_run_in<'r>(
    bench: &'r Bench<'_>,
    remainders: &'r [Remainder],
) -> impl Iterator<Item = (&'r Record<'r>, &'r [f64])> {
    bench.records.iter().zip(remainders).map(|(record, left)| (record, &left.residual_m[record.run_in..]))
}

/// A search on one bench.
pub struct Search<'a> {
    /// The bench.
    pub bench: &'a Bench<'a>,
    /// Logs simulated so far.
    pub simulations: &'a AtomicUsize,
}

impl Search<'_> {
    /// What was found for `hypothesis`.
    pub fn candidate(&self, hypothesis: Hypothesis, found: Found) -> Candidate {
        let weights = noise_weights(self.bench);
        let chis = found.normal.logs.iter().zip(&weights).map(|(log, w)| w * log.mean_m2()).collect();
        let chi = found.normal.misfit(&weights) / found.normal.rows().max(1) as f64;
        Candidate { hypothesis, found, chi, chis }
    }

    fn descend(&self, hypothesis: &Hypothesis, z: Vec<f64>, stages: &[f64]) -> Candidate {
        self.descend_below(hypothesis, z, stages, f64::INFINITY)
    }

    fn descend_below(&self, hypothesis: &Hypothesis, z: Vec<f64>, stages: &[f64], to_beat: f64) -> Candidate {
        let found = descend(self.bench, hypothesis, z, stages, to_beat, self.simulations);
        self.unlocked(self.candidate(hypothesis.clone(), found))
    }

    /// The candidate, or the better one that begins where the logs that it fits worst by far start anew: hysterons forget nothing, and a
    /// start that went astray locks its log, whatever the plant.
    fn unlocked(&self, candidate: Candidate) -> Candidate {
        let chis = &candidate.chis;
        let middle = middle(chis);
        if middle > NEARLY {
            return candidate;
        }
        let hypothesis = &candidate.hypothesis;
        let [least, times] = if hypothesis.installed.is_empty() {
            [LOCKED_LEAST, LOCKED_REFIT]
        } else if hypothesis.has_start() {
            [LOCKED_START; 2]
        } else {
            [LOCKED_LEAST, LOCKED]
        };
        let limit = least.max(times * middle);
        let mut z = candidate.found.z.clone();
        for index in (0..chis.len()).filter(|index| chis[*index] > limit) {
            settle_anew(self.bench, &candidate.hypothesis, &mut z, index);
        }
        if z == candidate.found.z {
            return candidate;
        }
        let Candidate { hypothesis, found, .. } = &candidate;
        let found = descend(self.bench, hypothesis, z, &LAST_STAGES, found.data_cost, self.simulations);
        let again = self.candidate(hypothesis.clone(), found);
        cheaper(candidate, again)
    }

    /// A candidate near the noise that fits one log worse than others, or the better one from where the others alone lead: a locked log bends the
    /// numbers that they share until its start finds no way back.
    pub fn led_by_others(&self, mut candidate: Candidate) -> Candidate {
        for _ in 0..LED_ROUNDS {
            let chis = &candidate.chis;
            let middle = middle(chis);
            let worst = (0..chis.len()).max_by(|a, b| chis[*a].total_cmp(&chis[*b]));
            let worse = worst.filter(|index| middle < LOCKED_LEAST && chis[*index] > WORSE * middle);
            let led = worse.map(|index| self.led_without(&candidate, index));
            let Some(led) = led.filter(|led| total(led) < total(&candidate) - LED_BY) else { break };
            candidate = led;
        }
        candidate
    }

    /// A candidate from where all logs but number `index` lead, with the start of that one anew.
    fn led_without(&self, candidate: &Candidate, index: usize) -> Candidate {
        let (bench, hypothesis) = (self.bench, &candidate.hypothesis);
        let at = bench.own_start(hypothesis, index);
        let own = at..at + bench.own(hypothesis);
        let (others, mut of_others) = (bench.without(index), candidate.found.z.clone());
        of_others.drain(own.clone());
        let mut z = descend(&others, hypothesis, of_others, &LAST_STAGES, f64::INFINITY, self.simulations).z;
        z.splice(at..at, candidate.found.z[own].iter().copied());
        settle_anew(bench, hypothesis, &mut z, index);
        let found = descend(bench, hypothesis, z, &LAST_STAGES, candidate.found.data_cost, self.simulations);
        self.candidate(hypothesis.clone(), found)
    }

    /// The nominal plant, refitted under its priors.
    pub fn refit(&self, freedom: Freedom) -> Candidate {
        self.from_rest(&Hypothesis::nominal(freedom))
    }

    /// A hypothesis fitted from the nominal numbers, all logs starting at rest and its forms at nothing.
    pub fn from_rest(&self, hypothesis: &Hypothesis) -> Candidate {
        self.descend(hypothesis, self.bench.origin(hypothesis), &STAGES)
    }

    /// The same from where the nominal numbers let each log's first stretch tell what it does.
    pub fn from_first_stretches(&self, hypothesis: &Hypothesis) -> Candidate {
        self.descend(hypothesis, self.settled(hypothesis), &LAST_STAGES)
    }

    /// A fit on another bench of the same logs, from where it ended there.
    pub fn taken_on(&self, fit: &Candidate) -> Candidate {
        self.led_by_others(self.descend(&fit.hypothesis, fit.found.z.clone(), &LAST_STAGES))
    }

    /// Mean square that the nominal numbers leave, starts settled, in units of the noise.
    pub fn unfitted(&self, nominal: &Hypothesis) -> f64 {
        let z = self.settled(nominal);
        let normal = evaluate(self.bench, nominal, &z, Sensitivities::None, self.simulations);
        normal.misfit(&noise_weights(self.bench)) / normal.rows().max(1) as f64
    }

    /// The nominal numbers, where every log's first stretch has told what it does.
    fn settled(&self, hypothesis: &Hypothesis) -> Vec<f64> {
        let mut z = self.bench.origin(hypothesis);
        self.settle(hypothesis, &mut z);
        z
    }

    /// Fits the start of every log, everything else held.
    fn settle(&self, hypothesis: &Hypothesis, z: &mut [f64]) {
        (0..self.bench.records.len()).for_each(|index| settle(self.bench, hypothesis, z, index));
    }

    /// The refit from another start: with the numbers on the other side of those of `home`, then where the priors allow about them. The better of both.
    pub fn refit_elsewhere(&self, refit: Candidate, home: &[f64], attempt: u64) -> Candidate {
        let mut z = self.bench.origin(&refit.hypothesis);
        let mut random = Pcg64::seed_from_u64(attempt);
        for (i, free) in self.bench.free.iter().enumerate() {
            let draw: f64 = random.random_range(-1.5..1.5);
            z[i] = if attempt == 1 { 2.0 * home[i] - refit.found.z[i] } else { home[i] + free.prior_sigma * draw };
        }
        let other = self.descend(&refit.hypothesis, z, &STAGES[2..]);
        cheaper(refit, other)
    }

    /// The candidate again, its nominal numbers put at `home` and its starts where these let them settle; the better of both.
    pub fn settled_at(&self, candidate: Candidate, home: &[f64]) -> Candidate {
        let (bench, hypothesis) = (self.bench, &candidate.hypothesis);
        let (mut z, origin) = (candidate.found.z.clone(), bench.origin(hypothesis));
        z[..home.len()].copy_from_slice(home);
        for index in 0..bench.records.len() {
            let places = bench.start_places(hypothesis, index);
            z[places.clone()].copy_from_slice(&origin[places]);
        }
        self.settle(hypothesis, &mut z);
        let other = self.descend(hypothesis, z, &STAGES[STAGES.len() - 1..]);
        cheaper(candidate, other)
    }

    /// The refit from the numbers that `found` begins with, where starts settle anew but those of `logs`, which follow in `found` one after the other;
    /// the better of both.
    pub fn resettled(&self, refit: Candidate, found: &[f64], logs: &[usize]) -> Candidate {
        let (bench, nominal) = (self.bench, &refit.hypothesis);
        let mut z = bench.origin(nominal);
        let (numbers, starts) = found.split_at(bench.free.len());
        z[..numbers.len()].copy_from_slice(numbers);
        let own = bench.own(nominal);
        for index in 0..bench.records.len() {
            match logs.iter().position(|log| *log == index) {
                Some(place) => {
                    let at = bench.own_start(nominal, index);
                    z[at..at + own].copy_from_slice(&starts[place * own..(place + 1) * own]);
                }
                None => settle(bench, nominal, &mut z, index),
            }
        }
        let other = self.descend(nominal, z, &LAST_STAGES);
        cheaper(refit, other)
    }

    /// The refit from where `others` lead, all logs but number `one`, whose start suits all of it; the better of both.
    pub fn joined(&self, refit: Candidate, others: &Candidate, one: usize) -> Candidate {
        let (bench, hypothesis) = (self.bench, &refit.hypothesis);
        let at = bench.own_start(hypothesis, one);
        let mut z = others.found.z.clone();
        z.splice(at..at, bench.origin(hypothesis)[at..at + bench.own(hypothesis)].iter().copied());
        settle_in_all_of(bench, hypothesis, &mut z, one);
        let other = self.descend(hypothesis, z, &LAST_STAGES);
        cheaper(refit, other)
    }

    /// `base` with the form of `lead`, fitted from there.
    pub fn extend(&self, base: &Candidate, lead: &Lead, from_nominal: bool) -> Candidate {
        self.extend_below(base, lead, from_nominal, self.worth_more(base))
    }

    /// Data cost that a fit beside `base` must come below to be worth more steps: it takes some of what is beyond the noise, which no fit takes.
    pub fn worth_more(&self, base: &Candidate) -> f64 {
        let normal = &base.found.normal;
        let rows: usize = normal.logs.iter().map(|sums| sums.rows).sum();
        let excess = normal.misfit(&noise_weights(self.bench)) - rows as f64;
        base.found.data_cost - (1.0 - WORTH_MORE) * excess.max(0.0)
    }

    /// The same, given up where it soon comes to no lower data cost than `to_beat`.
    pub fn extend_below(&self, base: &Candidate, lead: &Lead, from_nominal: bool, to_beat: f64) -> Candidate {
        let hypothesis = base.hypothesis.with(lead.effect, lead.form, &self.bench.scales());
        if lead.form.kind == Kind::Start {
            // What the refit made of the starts is what the effect is about: they are found anew, log by log.
            let settled = self.descend(&hypothesis, self.settled(&hypothesis), &STAGES);
            let found = carry(self.bench, &base.hypothesis, &base.found.z, self.bench, &hypothesis, true);
            return cheaper(settled, self.descend(&hypothesis, found, &LAST_STAGES));
        }
        let mut z = carry(self.bench, &base.hypothesis, &base.found.z, self.bench, &hypothesis, true);
        self.bench.set_last(&hypothesis, &mut z, &lead.values);
        if from_nominal {
            z[..self.bench.free.len()].fill(0.0);
            if hypothesis.has_start() {
                // What the wrong numbers made of the starts says little.
                self.settle(&hypothesis, &mut z);
            }
            self.descend_below(&hypothesis, z, &STAGES[1..], to_beat)
        } else {
            self.descend_below(&hypothesis, z, &LAST_STAGES, to_beat)
        }
    }

    /// The nominal plant again, from the numbers and starts of a fit with effects: an unmodelled effect may have led the first refit into
    /// a local minimum.
    pub fn refit_again(&self, refit: &Candidate, fit: &Candidate) -> Candidate {
        let z = carry(self.bench, &fit.hypothesis, &fit.found.z, self.bench, &refit.hypothesis, true);
        self.descend(&refit.hypothesis, z, &LAST_STAGES)
    }

    /// A fit with its `effect` in another `form`, from where the fit ended; the effect is installed last then.
    pub fn in_form(
        &self,
        fit: &Candidate,
        effect: &'static dyn Effect,
        form: &'static Form,
        values: &[f64],
    ) -> Option<Candidate> {
        self.instead(fit, effect.id(), (effect, form), values)
    }

    /// A fit with a form of another effect in the place of `id`, from where the fit ended; it is installed last then.
    pub fn instead(
        &self,
        fit: &Candidate,
        id: &str,
        (effect, form): (&'static dyn Effect, &'static Form),
        values: &[f64],
    ) -> Option<Candidate> {
        let place = fit.hypothesis.installed.iter().position(|installed| installed.effect.id() == id)?;
        Some(self.replaced(fit, place, effect, form, values))
    }

    /// Another effect in the place of the last one of a fit, from where the fit ended: `form` takes the values of the same names.
    pub fn in_kin(&self, fit: &Candidate, effect: &'static dyn Effect, form: &'static Form) -> Option<Candidate> {
        let place = fit.hypothesis.installed.len().checked_sub(1)?;
        let parameters = (form.parameters)(&self.bench.scales());
        let values: Vec<f64> = self.known(fit, place, &parameters)?.into_iter().collect::<Option<_>>()?;
        (!values.is_empty()).then(|| self.replaced(fit, place, effect, form, &values))
    }

    /// A fit in the form of `lead`, which has all numbers of its last effect and more, from where the fit ended: sizes that are new begin at nothing.
    /// None where the form has not.
    pub fn in_richer(&self, fit: &Candidate, lead: &Lead) -> Option<Candidate> {
        let last = fit.hypothesis.installed.len().checked_sub(1)?;
        self.richer(fit, last, (lead.effect, lead.form), |number| Some(lead.values[number]))
    }

    /// The same in a `form` of another effect in the `place` of one of the fit's, of which nothing is known: it may have so many sizes besides at the
    /// most, and no shapes.
    pub fn in_richer_kin(
        &self,
        fit: &Candidate,
        place: usize,
        (effect, form): (&'static dyn Effect, &'static Form),
        most: usize,
    ) -> Option<Candidate> {
        let own = fit.hypothesis.installed[place].axes.len();
        let more = (form.parameters)(&self.bench.scales()).len().checked_sub(own)?;
        if more > most { None } else { self.richer(fit, place, (effect, form), |_| None) }
    }

    /// The same; what is new and no size begins where `begins` says.
    fn richer(
        &self,
        fit: &Candidate,
        place: usize,
        (effect, form): (&'static dyn Effect, &'static Form),
        begins: impl Fn(usize) -> Option<f64>,
    ) -> Option<Candidate> {
        let parameters = (form.parameters)(&self.bench.scales());
        let known = self.known(fit, place, &parameters)?;
        let own = fit.hypothesis.installed[place].axes.len();
        let is_richer = known.iter().flatten().count() == own && known.len() > own;
        let value = |(number, (parameter, known)): (usize, (&Parameter, Option<f64>))| match parameter.role {
            Role::Amplitude(_) => Some(known.unwrap_or(0.0)),
            _ => known.or_else(|| begins(number)),
        };
        let values: Vec<f64> = parameters.iter().zip(known).enumerate().map(value).collect::<Option<_>>()?;
        let is_shared = !parameters.iter().any(|parameter| parameter.is_of_each_log());
        (is_richer && is_shared).then(|| self.replaced(fit, place, effect, form, &values))
    }

    /// What effect number `place` of `fit` has found for each of `parameters`, by name, as the mean where each log has its own; nothing for what it has
    /// not.
    fn known(&self, fit: &Candidate, place: usize, parameters: &[Parameter]) -> Option<Vec<Option<f64>>> {
        let installed = fit.hypothesis.installed.get(place)?;
        let found = self.bench.means(&fit.hypothesis, &fit.found.z).into_iter().nth(place)?;
        let value = |parameter: &Parameter| {
            Some(found[installed.axes.iter().position(|own| own.parameter.name == parameter.name)?])
        };
        Some(parameters.iter().map(value).collect())
    }

    /// The effect of `other` in the place of `id` in `fit`, from where `fit` ended and with the values of `other`; none where they belong to
    /// each log.
    pub fn in_valley_of(&self, fit: &Candidate, id: &str, other: &Candidate) -> Option<Candidate> {
        let installed = other.hypothesis.installed.last()?;
        let is_shared = installed.form.kind == Kind::Predictable
            && installed.axes.iter().all(|axis| !axis.parameter.is_of_each_log());
        let values = self.bench.values(&other.hypothesis, &other.found.z, 0).pop().filter(|_| is_shared)?;
        self.instead(fit, id, (installed.effect, installed.form), &values)
    }

    /// A fit with a form of `effect` instead of what is installed at `place`; it is installed last then.
    fn replaced(
        &self,
        fit: &Candidate,
        place: usize,
        effect: &'static dyn Effect,
        form: &'static Form,
        values: &[f64],
    ) -> Candidate {
        let base = fit.hypothesis.keeping(|other, _| other != place);
        let hypothesis = base.with(effect, form, &self.bench.scales());
        let mut z = carry(self.bench, &fit.hypothesis, &fit.found.z, self.bench, &hypothesis, true);
        self.bench.set_last(&hypothesis, &mut z, values);
        self.descend(&hypothesis, z, &LAST_STAGES)
    }

    /// A fit without its last effect, numbers and starts as they are.
    pub fn stripped(&self, fit: &Candidate) -> Candidate {
        let last = fit.hypothesis.installed.len().saturating_sub(1);
        let hypothesis = fit.hypothesis.keeping(|place, _| place < last);
        let z = carry(self.bench, &fit.hypothesis, &fit.found.z, self.bench, &hypothesis, true);
        let normal = evaluate(self.bench, &hypothesis, &z, Sensitivities::Thinned, self.simulations);
        let data_cost = normal.cost(&noise_weights(self.bench));
        self.candidate(hypothesis, Found { z, normal, data_cost, prior_cost: fit.found.prior_cost })
    }

    /// Effect number `kept` of a fit alone, from where the fit ended.
    pub fn only(&self, fit: &Candidate, kept: usize) -> Candidate {
        let hypothesis = fit.hypothesis.keeping(|place, _| place == kept);
        let z = carry(self.bench, &fit.hypothesis, &fit.found.z, self.bench, &hypothesis, true);
        self.descend(&hypothesis, z, &LAST_STAGES)
    }

    /// The candidate again, its nominal numbers put back at nominal; the better of both.
    pub fn polish(&self, candidate: Candidate) -> Candidate {
        self.again(candidate, &vec![0.0; self.bench.free.len()], &STAGES)
    }

    /// The candidate again, its nominal numbers put at `numbers`, which are not far off; the better of both.
    pub fn polish_from(&self, candidate: Candidate, numbers: &[f64]) -> Candidate {
        // Earlier stages would pull them back to nominal.
        self.again(candidate, numbers, &LAST_STAGES)
    }

    fn again(&self, candidate: Candidate, numbers: &[f64], stages: &[f64]) -> Candidate {
        let mut z = candidate.found.z.clone();
        z[..self.bench.free.len()].copy_from_slice(numbers);
        let again = self.descend(&candidate.hypothesis, z, stages);
        cheaper(candidate, again)
    }

    /// A candidate at the noise again, its nominal numbers put back at `home` and its readings counted as the independent ones that they
    /// are worth; the better of both under that count. Numbers that a kink holds far from there, or noise that lasts, come home.
    pub fn unbent(&self, candidate: Candidate, home: &[f64]) -> Candidate {
        let repeats = self.repeats(&candidate);
        let mut z = candidate.found.z.clone();
        z[..home.len()].copy_from_slice(home);
        let mut stages = STAGES;
        stages[STAGES.len() - 1] = repeats;
        let other = self.descend(&candidate.hypothesis, z, &stages);
        // By each log's own count another hysteron stayed hidden in numbers that no plant has.
        let total = |c: &Candidate| c.found.data_cost / repeats + c.found.prior_cost;
        if total(&other) < total(&candidate) { other } else { candidate }
    }

    /// Squares of what all starts hold, in units of their priors.
    pub fn cost_of_starts(&self, candidate: &Candidate) -> f64 {
        let (bench, Candidate { hypothesis, found, .. }) = (self.bench, candidate);
        let rules = bench.rules(hypothesis);
        let places = (0..bench.records.len()).flat_map(|index| bench.start_places(hypothesis, index));
        places.map(|place| rules[place].cost(found.z[place])).sum()
    }

    /// Readings that make one independent one, by what `candidate` leaves.
    fn repeats(&self, candidate: &Candidate) -> f64 {
        let count = |weights: Vec<f64>| weights.iter().sum::<f64>();
        count(noise_weights(self.bench)) / count(self.independent_weights(candidate))
    }

    /// What stays of every row of each log, and how fast the plant moved there.
    pub fn play(&self, candidate: &Candidate) -> Vec<Remainder> {
        let one = |index: usize| {
            let log = self.bench.records[index].log;
            let mut reader = reader(self.bench, &candidate.hypothesis, &candidate.found.z, index);
            let row = |y: &f64| (y - reader.next_m(), reader.stream.motion.1);
            let (residual_m, velocity_m_per_s) = log.displacement_m.iter().map(row).unzip();
            Remainder { residual_m, velocity_m_per_s }
        };
        (0..self.bench.records.len()).into_par_iter().map(one).collect()
    }

    /// One over the variance that a row of each log counts with: that of the residual of fitted rows times the rows that make one independent.
    pub fn independent_weights(&self, candidate: &Candidate) -> Vec<f64> {
        let weight = |(record, remainder): (&Record<'_>, Remainder)| {
            let fitted = (0..remainder.residual_m.len()).filter(|row| record.fits(*row));
            let residual_m: Vec<f64> = fitted.map(|row| remainder.residual_m[row]).collect();
            let mean2 = residual_m.iter().map(|r| r * r).sum::<f64>() / residual_m.len().max(1) as f64;
            1.0 / (mean2.max(record.noise_m.powi(2)) * samples_per_independent(&residual_m))
        };
        self.bench.records.iter().zip(self.play(candidate)).map(weight).collect()
    }

    /// Screens the registry for what `candidate` leaves.
    pub fn screen(&self, candidate: &Candidate, starts: &Starts, without: &[&str]) -> Vec<Lead> {
        screen(self.bench, &candidate.hypothesis, &candidate.found, starts, without, self.simulations)
    }
}

/// The one in the middle, the lower of two.
pub(super) fn middle(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(sorted.len() - 1) / 2]
}

/// The one of two that costs less.
pub(super) fn cheaper(one: Candidate, other: Candidate) -> Candidate {
    if total(&other) < total(&one) { other } else { one }
}

fn total(candidate: &Candidate) -> f64 {
    candidate.found.data_cost + candidate.found.prior_cost
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::effects::find;
    use plant_sim::log::Log;
    use plant_sim::replay::{Start, predict};

    /// Logs cut out of longer ones, while a mode that the plant's file lacks still rings.
    #[test]
    fn a_mode_that_swings_when_the_log_begins_is_fitted_as_it_is() {
        let (model, dt_s) = (thesis(), 5e-5);
        let mode = find("vibration_mode").expect("an entry");
        let attached = &mode.forms()[0];
        let mut chain = model.chain();
        (attached.install)(&mut chain, &[0.05, 900.0, 0.005]);
        let log = |step_v: f64| {
            let volts = |k: usize| if k < 900 { step_v } else { step_v + 2.0 * (0.03 * (k - 900) as f64).sin() };
            let mut log = Log { dt_s, command_v: (0..3000).map(volts).collect(), ..Log::default() };
            log.displacement_m = vec![0.0; log.command_v.len()];
            log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
            log.command_v.drain(..200);
            log.displacement_m.drain(..200);
            log
        };
        let logs = [log(4.0), log(-3.0)];
        let records = logs.iter().map(|log| Record { noise_m: 5e-9, run_in: 0, ..record(log, &model.chain(), None) });
        let bench = Bench::new(&model, records.collect());
        let hypothesis = Hypothesis::nominal(Freedom::Any).with(mode, attached, &bench.scales());
        let simulations = AtomicUsize::new(0);
        let mut z = bench.origin(&hypothesis);
        bench.set_last(&hypothesis, &mut z, &[0.03, 905.0, 0.01]);
        let found = descend(&bench, &hypothesis, z, &STAGES, 0.0, &simulations);
        let search = Search { bench: &bench, simulations: &simulations };
        let candidate = search.candidate(hypothesis, found);
        let [ratio, hz, damping_ratio] = bench.values(&candidate.hypothesis, &candidate.found.z, 0)[0][..] else {
            panic!("three numbers")
        };
        assert!(candidate.chi < 0.01, "{}", candidate.chi);
        assert!((ratio - 0.05).abs() < 2e-3 && (hz - 900.0).abs() < 1.0 && (damping_ratio - 0.005).abs() < 5e-4);
    }

    #[test]
    fn rows_that_were_lost_say_nothing_of_how_well_a_fit_is_known() {
        let (model, mut log) = (thesis(), Log { dt_s: 5e-5, ..Log::default() });
        log.command_v = (0..2000).map(|k| 30.0 * (0.02 * f64::from(k)).sin()).collect();
        log.displacement_m = vec![0.0; log.command_v.len()];
        let chain = model.chain();
        log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
        let mut spoilt = log.clone();
        spoilt.displacement_m.iter_mut().step_by(50).for_each(|y| *y += 2e-6);
        let weights = |log: &Log| {
            let is_lost = (0..log.len()).map(|row| row % 50 == 0).collect();
            let bench = Bench::new(&model, vec![Record { is_lost, noise_m: 20e-9, ..record(log, &chain, None) }]);
            let simulations = AtomicUsize::new(0);
            let search = Search { bench: &bench, simulations: &simulations };
            let nominal = Hypothesis::nominal(Freedom::Relaxed);
            let found = descend(&bench, &nominal, bench.origin(&nominal), &[], 0.0, &simulations);
            search.independent_weights(&search.candidate(nominal, found))
        };
        assert_eq!(weights(&log), weights(&spoilt));
        // Nor do those that no fit has seen.
        let record = record(&log, &chain, None);
        let mut spoilt = log.clone();
        (0..log.len()).filter(|row| record.holds_out(*row)).for_each(|row| spoilt.displacement_m[row] += 2e-6);
        assert!(spoilt != log);
        assert_eq!(weights(&log), weights(&spoilt));
    }
}
