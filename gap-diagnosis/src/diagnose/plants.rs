//! Variants of the plant (nominal, refitted, with effects) played on all logs, the held-out ones included.
//!
//! A log that no fit has seen gives one thing away: its start, from its first stretch, which is then not scored.

use super::bench::{Bench, Freedom, Hypothesis, Installed, Record, add_priors};
use super::normal::{self, reader};
use super::records::record;
use crate::residual::samples_per_independent;
use nalgebra::{DMatrix, DVector};
use plant_sim::log::Log;
use plant_sim::model::Model;
use plant_sim::replay::Reader;
use rayon::prelude::*;
use std::ops::Range;

/// Share of a held-out log that its start is fitted to.
pub(super) const START_SHARE: f64 = 0.3;
/// A start has settled below this many times the noise, and else is sought from here as well: a hysteron near its edge, as atanh.
const SETTLED: f64 = 1.3;
const NEAR_EDGE: f64 = 1.0;
/// Hysterons of which every corner is tried.
const MOST_CORNERS: usize = 3;
/// Steps of that fit at most, and how often a step is shortened.
const STEPS: usize = 12;
const HALVINGS: i32 = 5;
/// Sensitivities are carried on after a step that left less than this many times the squares foreseen.
const AS_FORESEEN: f64 = 1.2;

/// All logs, laws followed finely: what is said of a fit is said at full accuracy.
pub(super) struct Benches<'a> {
    /// The logs that were fitted.
    pub fitted: Bench<'a>,
    /// Those that were not; none without such logs.
    pub held: Option<Bench<'a>>,
}

/// A plant: forms, and coordinates on the fitted logs.
#[derive(Clone)]
pub(super) struct Variant {
    /// What is installed.
    pub hypothesis: Hypothesis,
    /// Its coordinates.
    pub z: Vec<f64>,
    /// Whether the coordinates hold the starts of the fitted logs; if not they are fitted like those of held-out logs.
    pub starts_known: bool,
}

/// What a variant predicts for every row of one log: the reading of an ideal sensor, metres.
pub(super) type Played = Vec<f64>;

impl<'a> Benches<'a> {
    /// The benches of the fitted `records` and of the `held_out` logs.
    pub fn new(model: &'a Model, records: Vec<Record<'a>>, held_out: &'a [Log], run_in_s: Option<f64>) -> Self {
        let chain = model.chain();
        let held = held_out.iter().map(|log| record(log, &chain, run_in_s)).collect::<Vec<_>>();
        Self { fitted: fine(model, records), held: (!held.is_empty()).then(|| fine(model, held)) }
    }

    /// The same with other fitted `records`.
    pub fn with_fitted(self, model: &'a Model, records: Vec<Record<'a>>) -> Self {
        Self { fitted: fine(model, records), ..self }
    }

    /// Records of all logs, fitted ones first.
    pub fn records(&self) -> impl Iterator<Item = &Record<'a>> {
        self.fitted.records.iter().chain(self.held.iter().flat_map(|bench| &bench.records))
    }

    /// What `variant` predicts for all logs, fitted ones first.
    pub fn play(&self, variant: &Variant) -> Vec<Played> {
        let mut played = self.play_fitted(variant);
        played.extend(self.play_held(variant));
        played
    }

    /// What `variant` predicts for the fitted logs.
    pub fn play_fitted(&self, variant: &Variant) -> Vec<Played> {
        play_on(&self.fitted, &variant.hypothesis, &variant.z, !variant.starts_known)
    }

    /// What `variant` predicts for the held-out logs.
    pub fn play_held(&self, variant: &Variant) -> Vec<Played> {
        let Some(held) = &self.held else { return Vec::new() };
        let z = carry(&self.fitted, &variant.hypothesis, &variant.z, held, &variant.hypothesis, false);
        let one = |index: usize| {
            let mut z = z.clone();
            seek(held, &variant.hypothesis, &mut z, index, true);
            play_log(held, &variant.hypothesis, &z, index)
        };
        (0..held.records.len()).into_par_iter().map(one).collect()
    }

    /// What the predictions for the held-out logs change on the rows that are scored when the first coordinates of `variant` are moved by each of
    /// `moves`: mean products of the changes, one row and column for each move, metres squared. Starts follow, and stay in the valley where they
    /// settled.
    pub fn moved_m2(&self, variant: &Variant, moves: &[Vec<f64>]) -> DMatrix<f64> {
        let zero = || DMatrix::zeros(moves.len(), moves.len());
        let Some(held) = &self.held else { return zero() };
        let hypothesis = &variant.hypothesis;
        let on_held = |z: &[f64]| carry(&self.fitted, hypothesis, z, held, hypothesis, false);
        let z = on_held(&variant.z);
        let one = |index: usize| -> DMatrix<f64> {
            let record = &held.records[index];
            let mut z = z.clone();
            seek(held, hypothesis, &mut z, index, true);
            let at = held.own_start(hypothesis, index);
            let own = at..at + held.start_count(hypothesis);
            let settled = |by: &Vec<f64>| {
                let mut there = variant.z.clone();
                there.iter_mut().zip(by).for_each(|(z, by)| *z += by);
                let mut there = on_held(&there);
                there[own.clone()].copy_from_slice(&z[own.clone()]);
                settle_from(held, hypothesis, there, index).z
            };
            let moved: Vec<Vec<f64>> = moves.iter().map(settled).collect();
            // All plants row by row beside each other: what each predicts for a long log need not be kept.
            let mut here = reader(held, hypothesis, &z, index);
            let mut there: Vec<_> = moved.iter().map(|z| reader(held, hypothesis, z, index)).collect();
            let mut products = zero();
            for row in 0..record.log.len() {
                let here_m = here.next_m();
                let by = DVector::from_iterator(there.len(), there.iter_mut().map(|there| there.next_m() - here_m));
                if row >= scored_from(record) {
                    products.ger(1.0, &by, &by, 1.0);
                }
            }
            products
        };
        let rows: usize = held.records.iter().map(|record| record.log.len() - scored_from(record)).sum();
        let sum = (0..held.records.len()).into_par_iter().map(one).reduce(zero, |a, b| a + b);
        sum / rows.max(1) as f64
    }
}

fn fine<'a>(model: &'a Model, records: Vec<Record<'a>>) -> Bench<'a> {
    let mut bench = Bench::new(model, records);
    bench.chain.parts.is_coarse = false;
    bench
}

impl Variant {
    /// Effects of which parts belong to each log: the phase of a line, the size of a drift.
    pub fn with_own_parts(&self) -> impl Iterator<Item = &'static str> {
        let is_own = |i: &&Installed| i.axes.iter().any(|axis| axis.parameter.per_log);
        self.hypothesis.installed.iter().filter(is_own).map(|i| i.effect.id())
    }

    /// Whether there is such an effect.
    pub fn has_own_parts(&self) -> bool {
        self.with_own_parts().next().is_some()
    }

    /// This with only those of its forms that `keep` says, and with the nominal numbers if not `refitted`.
    pub fn part(&self, bench: &Bench<'_>, refitted: bool, keep: impl Fn(&Installed) -> bool) -> Variant {
        let mut hypothesis = self.hypothesis.clone();
        hypothesis.installed.retain(|installed| keep(installed));
        let mut z = carry(bench, &self.hypothesis, &self.z, bench, &hypothesis, true);
        if !refitted {
            z[..bench.free.len()].fill(0.0);
        }
        Variant { hypothesis, z, starts_known: false }
    }
}

fn play_on(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &[f64], settle_starts: bool) -> Vec<Played> {
    let one = |index: usize| {
        let mut z = z.to_vec();
        if settle_starts {
            settle(bench, hypothesis, &mut z, index);
        }
        play_log(bench, hypothesis, &z, index)
    };
    (0..bench.records.len()).into_par_iter().map(one).collect()
}

fn play_log(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Played {
    let mut reader = reader(bench, hypothesis, z, index);
    bench.records[index].log.displacement_m.iter().map(|_| reader.next_m()).collect()
}

/// Coordinates of `to` on bench `there` that keep what was found for `from` on bench `here`: numbers and shared parameters, and on
/// the `same` logs what each has of its own. What a log has of its own stays at rest, and at nothing, elsewhere.
pub(super) fn carry(
    here: &Bench<'_>,
    from: &Hypothesis,
    z: &[f64],
    there: &Bench<'_>,
    to: &Hypothesis,
    same: bool,
) -> Vec<f64> {
    let mut carried = there.origin(to);
    let numbers = here.free.len();
    carried[..numbers].copy_from_slice(&z[..numbers]);
    let logs = if same { here.records.len() } else { there.records.len().min(1) };
    for index in 0..logs {
        let (old, new) = (here.places(from, if same { index } else { 0 }), there.places(to, index));
        for (installed, places) in to.installed.iter().zip(&new) {
            let matching = |i: &Installed| i.effect.id() == installed.effect.id() && i.form.name == installed.form.name;
            let Some(at) = from.installed.iter().position(matching) else { continue };
            for ((axis, &to), &from) in installed.axes.iter().zip(places).zip(&old[at]) {
                if same || !axis.parameter.per_log {
                    carried[to] = z[from];
                }
            }
        }
        if same {
            let (at, into) = (here.own_start(from, index), there.own_start(to, index));
            let (old, new) = (here.start_count(from), there.start_count(to));
            let mut copy = |place: usize, origin: usize, count: usize| {
                carried[into + place..into + place + count].copy_from_slice(&z[at + origin..at + origin + count]);
            };
            // The volts before and the hysterons, then displacement and velocity, then what else remembers.
            let hysterons = [there.hysterons(to), here.hysterons(from)];
            if old.min(new) > 0 {
                copy(0, 0, 1 + hysterons[0].min(hysterons[1]));
            }
            if [from.freedom, to.freedom] == [Freedom::Any; 2] {
                copy(1 + hysterons[0], 1 + hysterons[1], 2);
            }
            if old.min(new) > 0 && from.remembers() && to.remembers() {
                copy(new - 1, old - 1, 1);
            }
        }
    }
    carried
}

/// Fits the start of log `index` to its first stretch, everything else held. Where its coordinates as they are do not lead to the noise,
/// each hysteron in turn starts near either edge as well, then several do: dead zones make valleys of their own.
pub(super) fn settle(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize) {
    seek(bench, hypothesis, z, index, false);
}

/// The same, from all of these places if `from_all`: where no later fit will mend it, a start that reaches the noise need not be the right one.
fn seek(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize, from_all: bool) {
    let mut all: Vec<Settled> = Vec::new();
    for settled in settlings(bench, hypothesis, z.to_vec(), index) {
        if is_at_noise(settled.mean2, &bench.records[index]) && !from_all {
            return z.copy_from_slice(&settled.z);
        }
        all.push(settled);
    }
    let least = all.iter().min_by(|a, b| a.mean2.total_cmp(&b.mean2));
    // What the plant misses lasts: its rows count as the independent ones that they are worth.
    let rows = least.map_or(0.0, |least| least.left.len() as f64 / samples_per_independent(&least.left));
    let cost = |settled: &Settled| rows * settled.mean2.ln() + settled.prior_cost;
    if let Some(best) = all.iter().min_by(|a, b| cost(a).total_cmp(&cost(b))) {
        z.copy_from_slice(&best.z);
    }
}

/// The start of log `index` anew, wherever it was: from rest and from all of these places, that which suits the whole log best, as the first stretch
/// need not tell what a hysteron holds that moves later.
pub(super) fn settle_anew(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize) {
    let (at, count) = (bench.own_start(hypothesis, index), bench.start_count(hypothesis));
    let record = &bench.records[index];
    let mut from = z.to_vec();
    from[at..at + count].copy_from_slice(&bench.origin(hypothesis)[at..at + count]);
    let mut least2 = f64::INFINITY;
    for settled in settlings(bench, hypothesis, from, index) {
        let played = play_log(bench, hypothesis, &settled.z, index);
        let rows = played.iter().zip(&record.log.displacement_m).enumerate().filter(|(row, _)| record.fits(*row));
        let left: Vec<f64> = rows.map(|(_, (played, y))| y - played).collect();
        let mean2 = left.iter().map(|r| r * r).sum::<f64>() / left.len().max(1) as f64;
        if mean2 < least2 {
            least2 = mean2;
            z.copy_from_slice(&settled.z);
        }
        if is_at_noise(least2, record) {
            return;
        }
    }
}

/// Where the start of log `index` settles from `z` as it is and from every corner beside it; nowhere without a start to settle.
fn settlings(bench: &Bench<'_>, hypothesis: &Hypothesis, z: Vec<f64>, index: usize) -> impl Iterator<Item = Settled> {
    let first = bench.own_start(hypothesis, index) + 1;
    let has_start = bench.start_count(hypothesis) > 0;
    let corners = if has_start { corners(bench.hysterons(hypothesis)) } else { Vec::new() };
    corners.into_iter().map(move |edges| {
        let mut there = z.clone();
        there[first..].iter_mut().zip(edges).for_each(|(z, edge)| *z += edge);
        settle_from(bench, hypothesis, there, index)
    })
}

/// A start that has settled in the first stretch of its log.
struct Settled {
    /// Coordinates.
    z: Vec<f64>,
    /// What stays of the first stretch, and its mean square.
    left: Vec<f64>,
    mean2: f64,
    /// What the start costs under its priors.
    prior_cost: f64,
}

fn is_at_noise(mean2: f64, record: &Record<'_>) -> bool {
    mean2 < (SETTLED * record.noise_m).powi(2)
}

/// Nowhere, then near either edge of one hysteron after the other, then of several at once.
fn corners(hysterons: usize) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = vec![Vec::new()];
    for hysteron in 0..hysterons {
        let places: &[f64] = if hysteron < MOST_CORNERS { &[0.0, -NEAR_EDGE, NEAR_EDGE] } else { &[0.0] };
        let with = |edges: Vec<f64>| places.iter().map(move |edge| edges.iter().copied().chain([*edge]).collect());
        all = all.into_iter().flat_map(with).collect();
    }
    all.sort_by_key(|edges: &Vec<f64>| edges.iter().filter(|edge| **edge != 0.0).count());
    all
}

/// One descent of [`settle`] from `z`.
fn settle_from(bench: &Bench<'_>, hypothesis: &Hypothesis, mut z: Vec<f64>, index: usize) -> Settled {
    let (at, count) = (bench.own_start(hypothesis, index), bench.start_count(hypothesis));
    let record = &bench.records[index];
    let stretch = first_stretch(record);
    let rules = &bench.rules(hypothesis)[at..at + count];
    let residuals = |z: &[f64]| -> Vec<f64> {
        // Coarse laws err by a nanometre or two, which moves a start by no more.
        let (mut chain, start) = normal::at(bench, hypothesis, z, index);
        chain.parts.is_coarse = true;
        let mut reader = Reader::new(&chain, record.log, &start);
        record.log.displacement_m[..stretch.end].iter().map(|y| y - reader.next_m()).skip(stretch.start).collect()
    };
    let prior = |z: &[f64]| -> f64 { rules.iter().zip(&z[at..]).map(|(rule, &z)| rule.cost(z)).sum() };
    let sensitivities = |z: &[f64], here: &[f64]| -> Vec<Vec<f64>> {
        let column = |i: usize| {
            let mut there = z.to_vec();
            let step = rules[i].inward_step(z[at + i]);
            there[at + i] += step;
            residuals(&there).iter().zip(here).map(|(moved, unmoved)| (unmoved - moved) / step).collect()
        };
        (0..count).map(column).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut here = residuals(&z);
    let mut columns = sensitivities(&z, &here);
    let mut is_fresh = true;
    for _ in 0..STEPS {
        let squares = dot(&here, &here);
        // A plant that doesn't fit must not bend its start for it: the unit of the residual is the residual itself.
        let weight = 1.0 / (record.noise_m * record.noise_m).max(squares / here.len() as f64);
        let mut information = DMatrix::from_fn(count, count, |i, j| weight * dot(&columns[i], &columns[j]));
        let mut gradient = DVector::from_fn(count, |i, _| weight * dot(&columns[i], &here));
        add_priors(rules, &z[at..], &mut information, &mut gradient);
        let Some(change) = information.cholesky().map(|c| c.solve(&gradient)) else { break };
        let before = weight * squares + prior(&z);
        let to = |share: f64| {
            let mut there = z.clone();
            for (i, rule) in rules.iter().enumerate() {
                let step = (share * change[i]).clamp(-rule.most, rule.most);
                there[at + i] = (z[at + i] + step).clamp(rule.bounds[0], rule.bounds[1]);
            }
            let next = residuals(&there);
            let gained = before - weight * dot(&next, &next) - prior(&there);
            (gained > 0.0).then_some((there, next, gained))
        };
        let Some((there, next, gained)) = (0..HALVINGS).find_map(|n| to(0.3f64.powi(n))) else {
            if is_fresh {
                break;
            }
            (columns, is_fresh) = (sensitivities(&z, &here), true);
            continue;
        };
        let moved: Vec<f64> = (0..count).map(|i| there[at + i] - z[at + i]).collect();
        let foreseen: Vec<f64> = (0..here.len())
            .map(|row| here[row] - columns.iter().zip(&moved).map(|(c, by)| c[row] * by).sum::<f64>())
            .collect();
        let is_over = gained < 1e-4 * before;
        let is_as_foreseen = dot(&next, &next) < AS_FORESEEN * dot(&foreseen, &foreseen);
        let was_fresh = is_fresh;
        z = there;
        here = next;
        if is_over && was_fresh {
            break;
        }
        if is_over || !is_as_foreseen {
            (columns, is_fresh) = (sensitivities(&z, &here), true);
            continue;
        }
        // Broyden (1965): the sensitivities that would have foreseen this step, in units of the largest ones.
        let units = |i: usize| moved[i] / rules[i].most.powi(2);
        let length2: f64 = (0..count).map(|i| moved[i] * units(i)).sum();
        for (i, column) in columns.iter_mut().enumerate() {
            let part = units(i) / length2;
            for ((c, next), foreseen) in column.iter_mut().zip(&here).zip(&foreseen) {
                *c -= (next - foreseen) * part;
            }
        }
        is_fresh = false;
    }
    Settled { mean2: dot(&here, &here) / here.len().max(1) as f64, left: here, prior_cost: prior(&z), z }
}

/// Rows to which a start is fitted.
fn first_stretch(record: &Record<'_>) -> Range<usize> {
    record.run_in..scored_from(record).max(record.run_in + 16).min(record.log.len())
}

/// First row of a log of which only the start was fitted that counts.
pub(super) fn scored_from(record: &Record<'_>) -> usize {
    record.run_in + ((record.log.len() - record.run_in) as f64 * START_SHARE) as usize
}
