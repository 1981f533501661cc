//! The start of a log from its first stretch, everything else held.
//!
//! A hysteron that rests inside its dead zone shows what it holds when it moves, and not before: a first stretch leaves much open. Most logs begin
//! relaxed, and a stretch that agrees with that to the noise is hardly there by chance.

use super::bench::{Bench, Record, Rule, add_priors};
use super::hypothesis::Hypothesis;
use super::normal::{self, or_far_off_m, reader};
use super::plants::Played;
use crate::residual::samples_per_independent;
use nalgebra::{DMatrix, DVector};
use plant_sim::replay::Reader;
use std::borrow::Cow;
use std::ops::Range;

/// A start has settled below this many times the noise, and else is sought from here as well: a hysteron near its edge, as atanh.
const SETTLED: f64 = 1.3;
const NEAR_EDGE: f64 = 1.0;
/// What a hysteron has to earn in squares of which other logs tell what it holds.
const KNOWN: f64 = 2.0;
/// Hysterons of which every corner is tried.
const MOST_CORNERS: usize = 3;
/// Steps of that fit at most, and how often a step is shortened.
const STEPS: usize = 12;
const HALVINGS: i32 = 5;
/// Rows that tell of a start: of a stretch with more, some of them say it as well as all, and all times each coordinate would be a gigabyte of ten minutes.
const MOST_TOLD: usize = 400_000;
/// Sensitivities are carried on after a step that left less than this many times the squares foreseen.
const AS_FORESEEN: f64 = 1.2;
/// Share of its own width that the memory of a relaxed hysteron keeps.
const PINNED: f64 = 1e-6;

/// First row of a log of which only the start was fitted that counts.
pub(super) fn scored_from(record: &Record<'_>) -> usize {
    crate::identify::scored_from(record.log.len(), record.run_in)
}

/// What the plant at `z` predicts for log `index`.
pub(super) fn play_log(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Played {
    let mut reader = reader(bench, hypothesis, z, index);
    bench.records[index].log.displacement_m.iter().map(|_| or_far_off_m(reader.next_m())).collect()
}

/// Fits the start of log `index` to its first stretch, everything else held. Where its coordinates as they are do not lead to the noise,
/// each hysteron in turn starts near either edge as well, then several do: dead zones make valleys of their own. What reaches the noise first will do
/// where a later fit takes it from there.
pub(super) fn settle(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize) {
    let mut all = Vec::new();
    for settled in FirstStretch::new(bench, hypothesis, index).settlings(z.to_vec()) {
        if is_at_noise(settled.mean2, &bench.records[index]) {
            return z.copy_from_slice(&settled.z);
        }
        all.push(settled);
    }
    if let Some(best) = most_probable(all) {
        z.copy_from_slice(&best.z);
    }
}

/// The start of log `index` where no later fit will mend it: from all of these places, as others begin, and relaxed, that which is most probable.
pub(super) fn sought(bench: &Bench<'_>, hypothesis: &Hypothesis, z: Vec<f64>, index: usize) -> Settled {
    let stretch = FirstStretch::of_other(bench, hypothesis, index);
    let relaxed = stretch.relaxed().settled(z.clone());
    let alone = hypothesis.alone();
    let by_itself = FirstStretch::of_other(bench, &alone, index);
    let mut nowhere = z.clone();
    by_itself.places.iter().zip(&by_itself.rules).for_each(|(place, rule)| nowhere[*place] = rule.centre);
    let mut all: Vec<Settled> = by_itself.settlings(nowhere).collect();
    if stretch.known > 0 {
        let best = all.iter().min_by(|a, b| a.mean2.total_cmp(&b.mean2)).map(|best| best.z.clone());
        all.extend([Some(z.clone()), best].into_iter().flatten().map(|from| stretch.settled(from)));
    }
    all.push(relaxed);
    most_probable(all).unwrap_or_else(|| stretch.settled(z))
}

/// The start of log `index` anew, wherever it was: from rest and from all of these places, that which suits the whole log best, as the first stretch
/// need not tell what a hysteron holds that moves later.
pub(super) fn settle_anew(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize) {
    let start = bench.start_places(hypothesis, index);
    let record = &bench.records[index];
    let mut from = z.to_vec();
    from[start.clone()].copy_from_slice(&bench.origin(hypothesis)[start]);
    let mut least2 = f64::INFINITY;
    // How a sensor was set makes up for what hysterons hold in a first stretch, and not in the whole log.
    let stretch = FirstStretch::new(bench, hypothesis, index);
    let stretch = if stretch.places.len() > stretch.starts { stretch.whole() } else { stretch };
    for settled in stretch.settlings(from) {
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

/// Fits the start of log `index` to all of it, from where it is and from every corner: where numbers are known, what a hysteron holds that moves late shows.
pub(super) fn settle_in_all_of(bench: &Bench<'_>, hypothesis: &Hypothesis, z: &mut [f64], index: usize) {
    let log = FirstStretch::new(bench, hypothesis, index).whole();
    let settlings = log.settlings(z.to_vec());
    if let Some(best) = settlings.min_by(|a, b| a.mean2.total_cmp(&b.mean2)) {
        z.copy_from_slice(&best.z);
    }
}

/// A start that has settled in the first stretch of its log.
pub(super) struct Settled {
    /// Coordinates.
    pub z: Vec<f64>,
    /// What stays of the first stretch, and its mean square.
    left: Vec<f64>,
    mean2: f64,
    /// What the start costs under its priors.
    prior_cost: f64,
    /// Hysterons that were free to hold something; none of a relaxed start.
    memories: usize,
    /// Those of them of which other logs tell what they hold.
    known: usize,
    /// What other logs say against a relaxed start, in squares, if it is one.
    against: f64,
}

impl Settled {
    /// The start near this one where the other coordinates have become those of `z`: it stays in the valley where it settled, and hysterons that held
    /// nothing make up for what the others imitate, if they must.
    pub fn follow(&self, bench: &Bench<'_>, hypothesis: &Hypothesis, mut z: Vec<f64>, index: usize) -> Vec<f64> {
        let hypothesis = &self.by(hypothesis);
        let stretch = FirstStretch::of_other(bench, hypothesis, index);
        stretch.places.iter().for_each(|place| z[*place] = self.z[*place]);
        let relaxed = (self.memories < stretch.memories.len()).then(|| stretch.relaxed().settled(z.clone()));
        let all = std::iter::once(stretch.settled(z.clone())).chain(relaxed).collect();
        most_probable(all).map_or(z, |settled| settled.z)
    }

    /// `hypothesis` without what other logs tell, where this start has hysterons hold something else.
    fn by<'h>(&self, hypothesis: &'h Hypothesis) -> Cow<'h, Hypothesis> {
        let is_other = self.memories > 0 && self.known == 0;
        if is_other { Cow::Owned(hypothesis.alone()) } else { Cow::Borrowed(hypothesis) }
    }

    /// Coordinates on either side of these where one of the start's is a sigma of its prior away, or as far as the first stretch allows, and the others
    /// follow: one pair for each that is free, and apart from these one for each of what the forms have set anew. A prior draws a memory to the edge of what
    /// the stretch leaves open, so that no slope tells how far that is.
    pub fn left_open(&self, bench: &Bench<'_>, hypothesis: &Hypothesis, index: usize) -> [Vec<[Vec<f64>; 2]>; 2] {
        let hypothesis = &self.by(hypothesis);
        let stretch = FirstStretch::of_other(bench, hypothesis, index);
        let noise2 = bench.records[index].noise_m.powi(2);
        let weight = 1.0 / (noise2.max(self.mean2) * samples_per_independent(&self.left));
        let way = |place: usize, sign: f64| {
            let there = |share: f64| {
                let mut z = self.z.clone();
                let Rule { sigma, bounds: [low, high], .. } = stretch.rules[place];
                let at = &mut z[stretch.places[place]];
                *at = (*at + sign * share * sigma).clamp(low, high);
                let mut holding = stretch.clone();
                holding.hold(place, *at);
                holding.settled(z)
            };
            let cost = |share: f64| {
                let there = there(share);
                let more2 = (there.mean2 - self.mean2) * self.left.len() as f64;
                weight * more2 + stretch.prior(&there.z) - self.prior_cost
            };
            there(reach(cost)).z
        };
        // Of a start that is hardly relaxed by chance nothing is open.
        let open = if self.memories < stretch.memories.len() { 0 } else { stretch.starts };
        [0..open, stretch.starts..stretch.places.len()]
            .map(|places| places.map(|place| [1.0, -1.0].map(|sign| way(place, sign))).collect())
    }
}

/// Squares that a move by one sigma may cost on the rows that tell of it, in units of independent noise; 1 at most where the plant is linear.
const ALLOWED: f64 = 2.0;
/// How often a move that costs more is halved.
const SHORTER: i32 = 8;

/// The largest share of a move, halved as often as it takes, that costs no more than is allowed; nothing where none does.
pub(super) fn reach(cost: impl Fn(f64) -> f64) -> f64 {
    // A cost that is no number is not allowed either.
    let mut shares = (0..SHORTER).map(|halvings| 0.5_f64.powi(halvings));
    shares.find(|share| cost(*share) <= ALLOWED).unwrap_or(0.0)
}

/// The most probable of all: each hysteron that may hold something has to earn the logarithm of the rows (Schwarz 1978), or what a number that other
/// logs tell has to (Akaike 1974).
fn most_probable(mut all: Vec<Settled>) -> Option<Settled> {
    let least = all.iter().min_by(|a, b| a.mean2.total_cmp(&b.mean2))?;
    // What the plant misses lasts: its rows count as the independent ones that they are worth.
    let rows = least.left.len() as f64 / samples_per_independent(&least.left);
    let each = rows.max(1.0).ln();
    let to_earn = |s: &Settled| (s.memories - s.known) as f64 * each + KNOWN * s.known as f64;
    // Unlike others a start is relaxed sooner than anything else.
    let most = 0.5 * each * all.iter().map(|s| s.memories).max().unwrap_or(0) as f64;
    let cost = |s: &Settled| rows * s.mean2.ln() + s.prior_cost + s.against.min(most) + to_earn(s);
    let best = (0..all.len()).min_by(|a, b| cost(&all[*a]).total_cmp(&cost(&all[*b])))?;
    Some(all.swap_remove(best))
}

fn is_at_noise(mean2: f64, record: &Record<'_>) -> bool {
    mean2 < (SETTLED * record.noise_m).powi(2)
}

/// Nowhere, then near either edge of one memory after the other, then of several at once.
fn corners(memories: usize) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = vec![Vec::new()];
    for memory in 0..memories {
        let places: &[f64] = if memory < MOST_CORNERS { &[0.0, -NEAR_EDGE, NEAR_EDGE] } else { &[0.0] };
        let with = |edges: Vec<f64>| places.iter().map(move |edge| edges.iter().copied().chain([*edge]).collect());
        all = all.into_iter().flat_map(with).collect();
    }
    all.sort_by_key(|edges: &Vec<f64>| edges.iter().filter(|edge| **edge != 0.0).count());
    all
}

/// The first stretch of a log, and how its start may move there.
#[derive(Clone)]
struct FirstStretch<'b> {
    bench: &'b Bench<'b>,
    hypothesis: &'b Hypothesis,
    index: usize,
    /// Its rows, of which one in so many is looked at.
    rows: Range<usize>,
    every: usize,
    /// Where its coordinates are, and what holds for each: those of the start, then the forms' own.
    places: Vec<usize>,
    rules: Vec<Rule>,
    /// How many are the start's.
    starts: usize,
    /// Which of them are what hysterons hold that may hold something.
    memories: Vec<usize>,
    /// How many of those other logs tell.
    known: usize,
    /// What these say against a relaxed start, in squares, where that is what is sought.
    against: f64,
    /// Whether rows that the plant misses together count as the independent ones that they are worth.
    counts_independent: bool,
}

impl<'b> FirstStretch<'b> {
    fn new(bench: &'b Bench<'b>, hypothesis: &'b Hypothesis, index: usize) -> Self {
        let record = &bench.records[index];
        let rows = record.run_in..scored_from(record).max(record.run_in + 16).min(record.log.len());
        let (places, starts) = (bench.told_by_start(hypothesis, index), bench.start_count(hypothesis));
        let all = bench.rules(hypothesis);
        // A step of any size is none to scale by.
        let within = |rule: Rule| Rule { most: rule.most.min(rule.bounds[1] - rule.bounds[0]), ..rule };
        let rules = places.iter().map(|place| within(all[*place])).collect();
        let hysterons = bench.memories(hypothesis);
        let is_known = |i: &&usize| hypothesis.usually_held.get(**i).is_some_and(Option::is_some);
        let known = hysterons.iter().filter(is_known).count();
        let memories = hysterons.into_iter().map(|i| 1 + i).collect();
        Self {
            bench,
            hypothesis,
            index,
            every: rows.end.div_ceil(MOST_TOLD),
            rows,
            places,
            rules,
            starts,
            memories,
            known,
            against: 0.0,
            counts_independent: false,
        }
    }

    /// The same of a log that no number was fitted to: what the plant misses there must not be made up for by its start, beyond what priors allow.
    fn of_other(bench: &'b Bench<'b>, hypothesis: &'b Hypothesis, index: usize) -> Self {
        Self { counts_independent: true, ..Self::new(bench, hypothesis, index) }
    }

    /// The same with hysterons that hold nothing.
    fn relaxed(&self) -> Self {
        let against = self.hypothesis.usually_held.iter().flatten().map(|held| held.against_nothing).sum();
        let mut relaxed = Self { memories: Vec::new(), known: 0, against, ..self.clone() };
        self.memories.iter().for_each(|place| relaxed.hold(*place, 0.0));
        relaxed
    }

    /// Holds what is at `place` at `z`.
    fn hold(&mut self, place: usize, z: f64) {
        let rule = &mut self.rules[place];
        (rule.centre, rule.sigma) = (z, PINNED * rule.sigma);
    }

    /// The same with all rows of the log.
    fn whole(self) -> Self {
        let end = self.bench.records[self.index].log.len();
        Self { rows: self.rows.start..end, every: end.div_ceil(MOST_TOLD), ..self }
    }

    /// Where the start settles from `z` as it is and from every corner beside it.
    fn settlings(&self, z: Vec<f64>) -> impl Iterator<Item = Settled> {
        corners(self.memories.len()).into_iter().map(move |edges| {
            let mut there = z.clone();
            self.memories.iter().zip(edges).for_each(|(memory, edge)| there[self.places[*memory]] += edge);
            self.settled(there)
        })
    }

    /// What stays of the rows that are fitted. Coarse laws err by a nanometre or two, which moves a start by no more.
    fn residuals(&self, z: &[f64]) -> Vec<f64> {
        let log = self.bench.records[self.index].log;
        let (mut chain, start) = normal::at(self.bench, self.hypothesis, z, self.index);
        chain.parts.is_coarse = true;
        let mut reader = Reader::new(&chain, log, &start);
        let left = log.displacement_m[..self.rows.end].iter().map(|y| y - or_far_off_m(reader.next_m())).enumerate();
        let record = &self.bench.records[self.index];
        left.filter(|(row, _)| row % self.every == 0 && record.fits(*row)).map(|(_, left)| left).collect()
    }

    /// How the predictions change with each coordinate, where `here` are the residuals at `z`.
    fn sensitivities(&self, z: &[f64], here: &[f64]) -> Vec<Vec<f64>> {
        let column = |(&place, rule): (&usize, &Rule)| {
            let mut there = z.to_vec();
            let step = rule.inward_step(z[place]);
            there[place] += step;
            self.residuals(&there).iter().zip(here).map(|(moved, unmoved)| (unmoved - moved) / step).collect()
        };
        self.places.iter().zip(&self.rules).map(column).collect()
    }

    /// Information and gradient of the start with its priors, where a row weighs `weight`.
    fn normal(&self, columns: &[Vec<f64>], here: &[f64], z: &[f64], weight: f64) -> (DMatrix<f64>, DVector<f64>) {
        let count = self.rules.len();
        let mut information = DMatrix::from_fn(count, count, |i, j| weight * dot(&columns[i], &columns[j]));
        let mut gradient = DVector::from_fn(count, |i, _| weight * dot(&columns[i], here));
        add_priors(&self.rules, &self.own(z), &mut information, &mut gradient);
        (information, gradient)
    }

    /// `z` with the start moved by a `share` of `change`, as far as its rules allow.
    fn moved(&self, z: &[f64], change: &[f64], share: f64) -> Vec<f64> {
        let mut there = z.to_vec();
        for ((&place, rule), by) in self.places.iter().zip(&self.rules).zip(change) {
            let step = (share * by).clamp(-rule.most, rule.most);
            there[place] = (there[place] + step).clamp(rule.bounds[0], rule.bounds[1]);
        }
        there
    }

    /// The coordinates of `z` that are its own.
    fn own(&self, z: &[f64]) -> Vec<f64> {
        self.places.iter().map(|place| z[*place]).collect()
    }

    fn prior(&self, z: &[f64]) -> f64 {
        self.rules.iter().zip(self.own(z)).map(|(rule, z)| rule.cost(z)).sum()
    }

    /// One descent from `z`.
    fn settled(&self, mut z: Vec<f64>) -> Settled {
        let noise_m = self.bench.records[self.index].noise_m;
        let mut here = self.residuals(&z);
        let mut columns = self.sensitivities(&z, &here);
        let mut is_fresh = true;
        for _ in 0..STEPS {
            let squares = dot(&here, &here);
            // A plant that doesn't fit must not bend its start for it: the unit of the residual is the residual itself.
            let mean2 = squares / here.len() as f64;
            let is_missed = self.counts_independent && !is_at_noise(mean2, &self.bench.records[self.index]);
            let each = if is_missed { samples_per_independent(&here) } else { 1.0 };
            let weight = 1.0 / ((noise_m * noise_m).max(mean2) * each);
            let (information, gradient) = self.normal(&columns, &here, &z, weight);
            let Some(change) = information.cholesky().map(|c| c.solve(&gradient)) else { break };
            let before = weight * squares + self.prior(&z);
            let to = |share: f64| {
                let there = self.moved(&z, change.as_slice(), share);
                let next = self.residuals(&there);
                let gained = before - weight * dot(&next, &next) - self.prior(&there);
                (gained > 0.0).then_some((there, next, gained))
            };
            let Some((there, next, gained)) = (0..HALVINGS).find_map(|n| to(0.3f64.powi(n))) else {
                if is_fresh {
                    break;
                }
                (columns, is_fresh) = (self.sensitivities(&z, &here), true);
                continue;
            };
            let moved: Vec<f64> = self.places.iter().map(|place| there[*place] - z[*place]).collect();
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
                (columns, is_fresh) = (self.sensitivities(&z, &here), true);
                continue;
            }
            // Broyden (1965): the sensitivities that would have foreseen this step, in units of the largest ones.
            let units = |i: usize| moved[i] / self.rules[i].most.powi(2);
            let length2: f64 = (0..moved.len()).map(|i| moved[i] * units(i)).sum();
            for (i, column) in columns.iter_mut().enumerate() {
                let part = units(i) / length2;
                for ((c, next), foreseen) in column.iter_mut().zip(&here).zip(&foreseen) {
                    *c -= (next - foreseen) * part;
                }
            }
            is_fresh = false;
        }
        let (mean2, prior_cost) = (dot(&here, &here) / here.len().max(1) as f64, self.prior(&z));
        Settled {
            mean2,
            left: here,
            prior_cost,
            memories: self.memories.len(),
            known: self.known,
            against: self.against,
            z,
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::hypothesis::{Freedom, Held};
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::effects::find_form;
    use plant_sim::log::{Hold, Log};
    use plant_sim::model::Model;
    use plant_sim::replay::{Start, predict};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A log of the thesis' plant with 20 nm of noise that began at rest at 0 V with each hysteron at this share of its edge: a motion too small for some of
    /// them, then one that moves all.
    fn log(shares: &[f64]) -> (Model, Log) {
        let model = thesis();
        let mut random = Pcg64::seed_from_u64(5);
        let rows = 8000;
        let volts = |k: usize| match k {
            0..600 => 0.0,
            600..4000 => 6.0 * (0.02 * (k - 600) as f64).sin(),
            _ => 70.0 * (0.01 * (k - 4000) as f64).sin(),
        };
        let mut log = Log { dt_s: 5e-5, displacement_m: vec![0.0; rows], ..Log::default() };
        log.meta.hold = Hold::Zoh;
        log.command_v = (0..rows).map(volts).collect();
        let chain = model.chain();
        let held_v =
            chain.plant.hysterons.iter().zip(shares).map(|(hysteron, share)| share * hysteron.edge_v()).collect();
        log.displacement_m = predict(&chain, &log, &Start::at_rest(&chain, 0.0, held_v), rows);
        log.displacement_m.iter_mut().for_each(|y| *y += 20e-9 * random.random_range(-1.7..1.7));
        (model, log)
    }

    /// One row in seven tells a start to a few of its sigma: 20 nm over the root of some hundred rows.
    #[test]
    fn some_rows_of_a_long_stretch_tell_its_start() {
        let (model, log) = log(&[0.5, -0.5]);
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let nominal = Hypothesis::nominal(Freedom::Rest);
        let whole = || FirstStretch::new(&bench, &nominal, 0).whole();
        assert_eq!(whole().every, 1);
        let found = |every: usize| {
            let stretch = FirstStretch { every, ..whole() };
            let settled = stretch.settlings(bench.origin(&nominal));
            let best = settled.min_by(|a, b| a.mean2.total_cmp(&b.mean2)).expect("a start");
            (best.left.len(), best.mean2.sqrt(), best.z[bench.start_places(&nominal, 0)].to_vec())
        };
        let ((all, all_m, from_all), (some, some_m, from_some)) = (found(1), found(7));
        assert!(all.abs_diff(7 * some) < 7 && (some_m / all_m - 1.0).abs() < 0.1, "{all} {some}, {all_m:e} {some_m:e}");
        let apart = from_all.iter().zip(&from_some).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart > 0.0 && apart < 0.05, "{from_all:?} {from_some:?}");
    }

    /// Hysterons that hold something in what is sought for that log, by how many times the noise it misses the rows that are scored, and by how many it
    /// says that it may.
    fn sought_for(shares: &[f64]) -> (usize, f64, f64) {
        sought_with(shares, |_| Vec::new())
    }

    /// The same where other logs tell what is `usually_held`, given the coordinates of the hysterons that the whole log tells.
    fn sought_with(shares: &[f64], usually_held: impl Fn(&[f64]) -> Vec<Option<Held>>) -> (usize, f64, f64) {
        let (model, log) = log(shares);
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let nominal = Hypothesis::nominal(Freedom::Rest);
        let mut whole = bench.origin(&nominal);
        settle_in_all_of(&bench, &nominal, &mut whole, 0);
        let places = bench.start_places(&nominal, 0);
        let nominal = Hypothesis { usually_held: usually_held(&whole[places][1..]), ..nominal };
        let found = sought(&bench, &nominal, bench.origin(&nominal), 0);
        let played = |z: &[f64]| play_log(&bench, &nominal, z, 0);
        let from = scored_from(&bench.records[0]);
        let apart = |one: &[f64], other: &[f64]| {
            let squares = one.iter().zip(other).skip(from).map(|(one, other)| (one - other).powi(2)).sum::<f64>();
            (squares / (log.len() - from) as f64).sqrt() / bench.records[0].noise_m
        };
        let here = played(&found.z);
        let [open, _] = found.left_open(&bench, &nominal, 0);
        let farthest = open.iter().flatten().map(|z| apart(&here, &played(z))).fold(0.0, f64::max);
        (found.memories, apart(&log.displacement_m, &here), farthest)
    }

    #[test]
    fn a_stretch_that_agrees_with_a_relaxed_start_is_one() {
        let (memories, missed, open) = sought_for(&[0.0, 0.0]);
        assert_eq!((memories, open), (0, 0.0));
        assert!(missed < 1.05, "{missed}");
    }

    #[test]
    fn what_has_not_moved_yet_is_left_open() {
        // The first stretch tells of the sum of what the two hold.
        let (memories, missed, open) = sought_for(&[0.3, -0.2]);
        assert_eq!(memories, 2);
        assert!(missed > 3.0 && missed < 3.0 * open, "{missed} {open}");
    }

    #[test]
    fn what_a_first_stretch_leaves_open_other_logs_tell() {
        let usual = |against_nothing: f64| {
            move |held: &[f64]| held.iter().map(|z| Some(Held { mean: *z, width: 0.02, against_nothing })).collect()
        };
        let (memories, missed, open) = sought_with(&[0.3, -0.2], usual(100.0));
        assert_eq!(memories, 2);
        assert!(missed < 1.1 && open < 3.0, "{missed} {open}");
        // A start that is relaxed is one, whatever others are like.
        let charged = |_: &[f64]| vec![Some(Held { mean: 0.5, width: 0.02, against_nothing: 100.0 }); 2];
        let (memories, missed, _) = sought_with(&[0.0, 0.0], charged);
        assert!(memories == 0 && missed < 1.05, "{memories} {missed}");
    }

    /// Coordinates of what moves are far from nothing: a tenth of the stroke, and that at the pace of the resonance.
    #[test]
    fn a_mass_in_motion_is_found_however_fast() {
        let (model, mut log) = log(&[0.0, 0.0]);
        let any = Hypothesis::nominal(Freedom::Any);
        let chain = model.chain();
        let start = {
            let bench = Bench::new(&model, vec![record(&log, &chain, None)]);
            let mut z = bench.origin(&any);
            z[bench.start_places(&any, 0)][3..].copy_from_slice(&[4.0, -18.0]);
            bench.start_at(&any, &z, 0, &chain)
        };
        log.displacement_m = predict(&chain, &log, &start, log.len());
        let mut random = Pcg64::seed_from_u64(6);
        log.displacement_m.iter_mut().for_each(|y| *y += 20e-9 * random.random_range(-1.7..1.7));
        let mut record = record(&log, &chain, None);
        record.noise_m = 20e-9;
        let bench = Bench::new(&model, vec![record]);
        let found = sought(&bench, &any, bench.origin(&any), 0);
        assert!(found.mean2.sqrt() < 1.1 * 20e-9, "{:e}", found.mean2.sqrt());
    }

    /// At rest what has no dead zone holds nothing; a log that was cut while it crept may.
    #[test]
    fn a_start_anywhere_may_still_be_creeping() {
        let (model, mut log) = log(&[0.0, 0.0]);
        fn known<'l>(log: &'l Log, model: &Model) -> Vec<Record<'l>> {
            vec![Record { noise_m: 20e-9, ..record(log, &model.chain(), None) }]
        }
        let (effect, form) = find_form("creep", "kelvin-voigt").expect("a form");
        let (creeping, mut z, chain) = {
            let bench = Bench::new(&model, known(&log, &model));
            let creeping = Hypothesis::nominal(Freedom::Any).with(effect, form, &bench.scales());
            let mut z = bench.origin(&creeping);
            bench.set_last(&creeping, &mut z, &[0.05, 0.1]);
            let chain = bench.chain_at(&creeping, &z, 0);
            (creeping, z, chain)
        };
        log.displacement_m = predict(&chain, &log, &Start::at_rest(&chain, 0.0, vec![0.0, 0.0, 2.0]), log.len());
        let relaxed = predict(&chain, &log, &Start::at_rest(&chain, 0.0, vec![0.0; 3]), log.len());
        assert!((log.displacement_m[0] - relaxed[0]).abs() > 1e-7, "{:e}", log.displacement_m[0]);
        let mut random = Pcg64::seed_from_u64(7);
        log.displacement_m.iter_mut().for_each(|y| *y += 20e-9 * random.random_range(-1.7..1.7));
        let bench = Bench::new(&model, known(&log, &model));
        let numbers: Vec<f64> = bench.places(&creeping, 0)[0].iter().map(|place| z[*place]).collect();
        z = bench.origin(&creeping);
        bench.places(&creeping, 0)[0].iter().zip(numbers).for_each(|(place, number)| z[*place] = number);
        let found = sought(&bench, &creeping, z, 0);
        assert!(found.mean2.sqrt() < 1.1 * 20e-9, "{:e}", found.mean2.sqrt());
    }

    #[test]
    fn rows_that_are_held_out_or_lost_tell_nothing_of_a_start() {
        let (model, log) = log(&[0.3, -0.2]);
        let found = |is_lost: &dyn Fn(usize) -> bool, off_m: f64| {
            let mut record = record(&log, &model.chain(), None);
            record.is_lost = (0..log.len()).map(is_lost).collect();
            let mut spoilt = log.clone();
            let rows = spoilt.displacement_m.iter_mut().enumerate().filter(|(row, _)| !record.fits(*row));
            rows.for_each(|(_, y)| *y += off_m);
            let bench = Bench::new(&model, vec![Record { log: &spoilt, ..record }]);
            let nominal = Hypothesis::nominal(Freedom::Rest);
            sought(&bench, &nominal, bench.origin(&nominal), 0).z
        };
        let lost = |row: usize| row % 50 == 7;
        assert!([600, 707].iter().all(|row| row / (log.len() / 40) % 5 == 3 || lost(*row)));
        assert_eq!(found(&lost, 0.0), found(&lost, 1e-6));
        // Others do.
        assert_ne!(found(&lost, 0.0), found(&|row| row % 50 == 8, 1e-6));
    }

    #[test]
    fn the_first_stretch_tells_how_the_sensor_was_set() {
        let (model, log) = log(&[0.0, 0.0]);
        let (effect, form) = find_form("sensor_offset", "constant-in-each-log").expect("a form");
        // What is found of a zero of 2 um beside so much more noise, and what else it may be, where others have something like it.
        let found = |freedom: Freedom, noise_m: f64| {
            let (mut log, mut random) = (log.clone(), Pcg64::seed_from_u64(8));
            log.displacement_m.iter_mut().for_each(|y| *y += 2e-6 + noise_m * random.random_range(-1.7..1.7));
            let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
            let mut set = Hypothesis::nominal(freedom).with(effect, form, &bench.scales());
            set.installed[0].axes[0].usual = Some([0.0, 1.4]);
            let found = sought(&bench, &set, bench.origin(&set), 0);
            let [starts, set_anew] = found.left_open(&bench, &set, 0);
            // Nothing of the start is open.
            assert!(found.memories == 0 && starts.is_empty());
            let [ways] = set_anew.try_into().expect("the zero alone");
            let zero_m = |z: &[f64]| bench.values(&set, z, 0)[0][0];
            (zero_m(&found.z) - 2e-6, ways.map(|z| zero_m(&z) - 2e-6))
        };
        let (missed_m, _) = found(Freedom::Rest, 0.0);
        assert!(missed_m.abs() < 2e-9, "{missed_m:e}");
        // Of 2000 rows with 1 um each: 22 nm, of which 1.4 times as much is allowed; a move of 1.4 um is halved until it is.
        let (missed_m, [high_m, low_m]) = found(Freedom::Relaxed, 1e-6);
        let ways_m = [high_m - missed_m, missed_m - low_m];
        assert!(ways_m.iter().all(|way_m| (1.4e-8..3.5e-8).contains(way_m)), "{ways_m:?}");
        assert!(missed_m.abs() < 7e-8, "{missed_m:e}");
    }

    #[test]
    fn a_move_reaches_as_far_as_the_logs_allow() {
        assert_eq!(reach(|share| share * share), 1.0);
        assert_eq!(reach(|share| 40.0 * share * share), 0.125);
        // A dead zone that ends after a third of the way.
        assert_eq!(reach(|share| 1e6 * (share - 1.0 / 3.0).max(0.0)), 0.25);
        assert_eq!(reach(|_| f64::NAN), 0.0);
    }
}
