//! Variants of the plant (nominal, refitted, with effects) played on all logs, the held-out ones included.
//!
//! A log that no fit has seen gives one thing away: how it begins, from its first stretch, which is then not scored. That is the plant's state, the
//! phase of what swings, and how the sensor was set.

use super::bench::{Bench, Record};
use super::hypothesis::{Freedom, Hypothesis, Installed};
use super::normal::{or_far_off_m, reader};
use super::records::{record, share_noise};
use super::starts::{Settled, play_log, scored_from, settle, sought};
use nalgebra::{DMatrix, DVector};
use plant_sim::log::Log;
use plant_sim::model::Model;
use rayon::prelude::*;

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

/// How the held-out logs begin with a plant.
pub(super) struct Begun {
    /// The plant, where it knows of other logs what is usual; coordinates on the fitted logs.
    variant: Variant,
    /// The start of each.
    starts: Vec<Settled>,
}

/// What a variant predicts for every row of one log: the reading of an ideal sensor, metres.
pub(super) type Played = Vec<f64>;

/// A held-out log's start is open where it may make so many times the noise of what follows, ..
const OPEN: f64 = 2.0;
/// .. and tells of what stays there, if that is so many times the noise.
const STAYS: f64 = 1.5;

/// Mean squares on the held-out rows that are scored, metres squared, one for each of independent numbers of unit sigma.
#[derive(Default)]
pub(super) struct Spread {
    /// What the start of each held-out log makes, as far as its first stretch leaves it open.
    pub starts_m2: Vec<f64>,
    /// The same of what the forms have set anew in each: a zero, a phase.
    pub settings_m2: Vec<f64>,
    /// What the numbers that all logs share make.
    pub numbers_m2: Vec<f64>,
    /// What they make besides where hysterons hold something when the fitted logs begin, though these agree with hysterons at rest.
    pub charged_m2: Vec<f64>,
    /// Probability that they do.
    pub charged: f64,
}

impl Spread {
    /// Held-out logs of which what `played` leaves may be that their first stretch does not tell where they start, and how much that makes, metres rms.
    pub fn open_starts<'r>(&self, benches: &'r Benches<'_>, played: &[Played]) -> Vec<(&'r str, f64)> {
        let Some(held) = &benches.held else { return Vec::new() };
        let (all, played) = (scored_rows(held), &played[benches.fitted.records.len()..]);
        let logs = held.records.iter().zip(played).zip(&self.starts_m2);
        let open = logs.filter_map(|((record, played), start_m2)| {
            let from = scored_from(record);
            let rows = (record.log.len() - from).max(1) as f64;
            let read = record.log.displacement_m.iter().zip(played).skip(from);
            let stays_m = (read.map(|(read_m, played_m)| (read_m - played_m).powi(2)).sum::<f64>() / rows).sqrt();
            let open_m = (start_m2 * all / rows).sqrt();
            let is_open = open_m > OPEN * record.noise_m && stays_m > STAYS * record.noise_m;
            is_open.then_some((record.log.name.as_str(), open_m))
        });
        open.collect()
    }
}

impl<'a> Benches<'a> {
    /// The benches of the fitted `records` and of the `held_out` logs.
    pub fn new(model: &'a Model, records: Vec<Record<'a>>, held_out: &'a [Log], run_in_s: Option<f64>) -> Self {
        let chain = model.chain();
        let held = held_out.iter().map(|log| record(log, &chain, run_in_s).whole());
        // The fitted logs tell their noise without the others, and the others' with them.
        let mut all: Vec<Record<'a>> = records.iter().cloned().chain(held).collect();
        share_noise(&mut all, model.sensor.noise_um.as_ref());
        let held = all.split_off(records.len());
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
        self.play_from(variant, self.begun(variant).as_ref())
    }

    /// The same where it is known how the held-out logs begin with it.
    pub fn play_from(&self, variant: &Variant, begun: Option<&Begun>) -> Vec<Played> {
        let mut played = self.play_fitted(variant);
        if let Some((held, begun)) = self.held.as_ref().zip(begun) {
            let one = |(index, start): (usize, &Settled)| play_log(held, &begun.variant.hypothesis, &start.z, index);
            played.par_extend(begun.starts.par_iter().enumerate().map(one));
        }
        played
    }

    /// What `variant` predicts for the fitted logs.
    pub fn play_fitted(&self, variant: &Variant) -> Vec<Played> {
        play_on(&self.fitted, &variant.hypothesis, &variant.z, !variant.starts_known)
    }

    /// How the held-out logs begin with `variant`; none without such logs.
    pub fn begun(&self, variant: &Variant) -> Option<Begun> {
        let held = self.held.as_ref()?;
        let (hypothesis, z) = self.on_others(held, variant, variant.z.clone());
        let one = |index: usize| sought(held, &hypothesis, z.clone(), index);
        let starts = (0..held.records.len()).into_par_iter().map(one).collect();
        Some(Begun { variant: Variant { hypothesis, ..variant.clone() }, starts })
    }

    /// What `variant` is at `z` where it knows of other logs what is usual, and its coordinates on those of `held`.
    fn on_others(&self, held: &Bench<'_>, variant: &Variant, z: Vec<f64>) -> (Hypothesis, Vec<f64>) {
        let hypothesis = variant.hypothesis.as_usual(&self.fitted, &z);
        let there = carry(&self.fitted, &hypothesis, &z, held, &hypothesis, false);
        (hypothesis, there)
    }

    /// What is open where the coordinates of the plant that has `begun` are moved by each of `moves`, with a probability of `charged` also by those of
    /// `if_charged`, and where the starts are what the first stretches leave open of them.
    pub fn spread(&self, begun: &Begun, moves: &[Vec<f64>], if_charged: &[Vec<f64>], charged: f64) -> Spread {
        let Some(held) = &self.held else { return Spread::default() };
        let Begun { variant, starts } = begun;
        let [starts_m2, settings_m2] = starts_m2(held, &variant.hypothesis, starts);
        // Changes add up row by row; along the axes of their products each has a power of its own.
        let powers_m2 = |moves: &[Vec<f64>]| -> Vec<f64> {
            if moves.is_empty() {
                return Vec::new();
            }
            let moved_m2 = self.moved_m2(held, begun, moves).symmetric_eigenvalues();
            moved_m2.iter().map(|m2| m2.max(0.0)).collect()
        };
        Spread { starts_m2, settings_m2, numbers_m2: powers_m2(moves), charged_m2: powers_m2(if_charged), charged }
    }

    /// What the predictions for the held-out logs change on the rows that are scored when the coordinates of `variant` are moved by each of `moves`: mean products of the changes, one row and column for each move, metres squared. Starts follow.
    fn moved_m2(&self, held: &Bench<'_>, begun: &Begun, moves: &[Vec<f64>]) -> DMatrix<f64> {
        let zero = || DMatrix::zeros(moves.len(), moves.len());
        let Begun { variant, starts } = begun;
        let hypothesis = &variant.hypothesis;
        let moved = |by: &Vec<f64>| {
            let there = variant.z.iter().zip(by).map(|(z, by)| z + by).collect();
            self.on_others(held, variant, there)
        };
        let moved: Vec<(Hypothesis, Vec<f64>)> = moves.iter().map(moved).collect();
        let one = |(index, start): (usize, &Settled)| -> DMatrix<f64> {
            let record = &held.records[index];
            let follow = |(hypothesis, z): &(Hypothesis, Vec<f64>)| start.follow(held, hypothesis, z.clone(), index);
            let moved: Vec<Vec<f64>> = moved.iter().map(follow).collect();
            // All plants row by row beside each other: what each predicts for a long log need not be kept.
            let mut here = reader(held, hypothesis, &start.z, index);
            let mut there: Vec<_> = moved.iter().map(|z| reader(held, hypothesis, z, index)).collect();
            let mut products = zero();
            for row in 0..record.log.len() {
                let here_m = or_far_off_m(here.next_m());
                let by = DVector::from_iterator(
                    there.len(),
                    there.iter_mut().map(|there| or_far_off_m(there.next_m()) - here_m),
                );
                if row >= scored_from(record) {
                    products.ger(1.0, &by, &by, 1.0);
                }
            }
            products
        };
        // In order, so that the last digit does not hang on the number of threads.
        let of_logs: Vec<DMatrix<f64>> = starts.par_iter().enumerate().map(one).collect();
        of_logs.into_iter().fold(zero(), |a, b| a + b) / scored_rows(held)
    }
}

/// Mean squares that the start of each held-out log makes on the rows that are scored, as far as its first stretch leaves it open, and what the forms have
/// set anew, metres squared. What is open is one valley as a rule, along which whatever moves makes the others follow: that which matters most counts.
fn starts_m2(held: &Bench<'_>, hypothesis: &Hypothesis, starts: &[Settled]) -> [Vec<f64>; 2] {
    let one = |(index, start): (usize, &Settled)| -> [f64; 2] {
        let from = scored_from(&held.records[index]);
        let here = play_log(held, hypothesis, &start.z, index);
        let squares = |there: &Vec<f64>| {
            let there = play_log(held, hypothesis, there, index);
            here.iter().zip(&there).skip(from).map(|(here, there)| (here - there).powi(2)).sum::<f64>()
        };
        let both = |ways: [Vec<f64>; 2]| 0.5 * ways.iter().map(squares).sum::<f64>() / scored_rows(held);
        start.left_open(held, hypothesis, index).map(|open| open.into_iter().map(both).fold(0.0, f64::max))
    };
    let of_logs: Vec<[f64; 2]> = starts.par_iter().enumerate().map(one).collect();
    [0, 1].map(|of| of_logs.iter().map(|of_log| of_log[of]).collect())
}

/// Rows that are scored, in all logs of `held`.
fn scored_rows(held: &Bench<'_>) -> f64 {
    held.records.iter().map(|record| record.log.len() - scored_from(record)).sum::<usize>().max(1) as f64
}

/// The bench of `records` that know their noise, laws followed finely.
pub(super) fn fine<'a>(model: &'a Model, records: Vec<Record<'a>>) -> Bench<'a> {
    let mut bench = Bench::of(model, records);
    [&mut bench.chain, &mut bench.base.chain].into_iter().for_each(|chain| chain.parts.is_coarse = false);
    bench
}

impl Variant {
    /// Effects of which parts belong to each log and to no other: the phase of a line, the size of a drift.
    pub fn with_own_parts(&self) -> impl Iterator<Item = &'static str> {
        self.hypothesis.installed.iter().filter(|installed| installed.has_own_parts()).map(|i| i.effect.id())
    }

    /// Effects of which each log's first stretch tells its own parts.
    pub fn told_at_once(&self) -> impl Iterator<Item = (usize, &Installed)> {
        self.hypothesis.installed.iter().enumerate().filter(|(_, installed)| installed.is_told_at_once())
    }

    /// Whether there is such an effect.
    pub fn has_own_parts(&self) -> bool {
        self.with_own_parts().next().is_some()
    }

    /// This on the logs of `bench`, where each has of what belongs to it and no first stretch tells what the others let expect.
    pub fn as_others(&self, bench: &Bench<'_>) -> Variant {
        let z = self.hypothesis.as_others(bench, &self.z);
        Variant { hypothesis: self.hypothesis.clone(), z, starts_known: true }
    }

    /// This with only those of its forms that `keep` says, and with the nominal numbers if not `refitted`.
    pub fn part(&self, bench: &Bench<'_>, refitted: bool, keep: impl Fn(&Installed) -> bool) -> Variant {
        let hypothesis = self.hypothesis.keeping(|_, installed| keep(installed));
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

/// Coordinates of `to` on bench `there` that keep what was found for `from` on bench `here`: numbers and shared parameters, and on
/// the `same` logs what each has of its own. What a log has of its own is where its prior is centred, elsewhere.
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
                if same || !axis.parameter.is_of_each_log() {
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
            // The volts before and the hysterons, then what moves, then what else remembers.
            let hysterons = [there.hysterons(to), here.hysterons(from)];
            if old.min(new) > 0 {
                copy(0, 0, 1 + hysterons[0].min(hysterons[1]));
            }
            if [from.freedom, to.freedom] == [Freedom::Any; 2] {
                let modes = there.modes(to).min(here.modes(from));
                copy(1 + hysterons[0], 1 + hysterons[1], 2 + 2 * modes);
            }
            if old.min(new) > 0 && from.remembers() && to.remembers() {
                copy(new - 1, old - 1, 1);
            }
        }
    }
    carried
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::thesis;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// The fitted logs say what is noise; a held-out one is not measured by the quieter of its own kind.
    #[test]
    fn held_out_logs_have_their_noise_from_all_logs() {
        let model = thesis();
        let mut random = Pcg64::seed_from_u64(8);
        let mut of = |noise_m: f64| {
            let mut log = Log { dt_s: 5e-5, command_v: vec![0.0; 4000], ..Log::default() };
            log.displacement_m = (0..4000).map(|_| noise_m * 1.7 * random.random_range(-1.0..1.0)).collect();
            log
        };
        let (fitted, held_out) = ([of(2e-8), of(2e-8), of(2e-8)], [of(1e-8), of(2e-8)]);
        let chain = model.chain();
        let mut records: Vec<Record<'_>> = fitted.iter().map(|log| record(log, &chain, None)).collect();
        share_noise(&mut records, None);
        let benches = Benches::new(&model, records, &held_out, None);
        let noise_m: Vec<f64> = benches.held.iter().flat_map(|held| &held.records).map(|one| one.noise_m).collect();
        assert!((1.8..2.2).contains(&(noise_m[1] / noise_m[0])), "{noise_m:?}");
    }
}
