//! How large the gap is, how far it shrinks and what shares the effects have in that (of all rows; the gap itself is told on rows never fitted).

use super::plants::{Benches, Played, Spread, Variant};
use super::random::Random;
use super::refit::{AT_NOISE, LEAST_GAP};
use super::starts::scored_from;
use crate::residual::samples_per_independent;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::Serialize;

/// Relative sigma of the noise's power: it is known to a few per cent.
const NOISE_KNOWN: f64 = 0.03;
/// Least length of the bootstrap's blocks in seconds, and the cells that a block is made of. Blocks outlast the plant's ringing and most of what
/// one step leaves; cells only save time.
const BLOCK_S: f64 = 0.05;
const CELLS: usize = 10;
/// Blocks outlast what stays of the gap as well: they are so many times as long as rows of it hang together, but no more than such a part of their log.
const OUTLASTED: f64 = 2.0;
const PART_OF_LOG: usize = 4;
/// Rows that tell how long rows hang together: so many say it as well as all.
const LOOKED_AT: usize = 50_000;
/// Resamples.
const RESAMPLES: usize = 1000;
/// The named plant surprises where it misses rows that no fit saw by this many times what was expected, as amplitude: the numbers'
/// spread is taken as if the plant were straight within a sigma, which dead zones that no fitted log opens are not.
const SURPRISE: f64 = 8.0;

/// The gap in numbers.
#[derive(Clone, Debug, Serialize)]
pub struct Gap {
    /// What it is taken on: `held-out log` or `held-out stretches`.
    pub headline: &'static str,
    /// Rms of measured minus predicted, nominal plant.
    pub nominal_rms_um: f64,
    /// .. nominal numbers refitted under their sigma.
    pub refit_rms_um: f64,
    /// .. with the named effects.
    pub augmented_rms_um: f64,
    /// Rms of the noise.
    pub noise_rms_um: f64,
    /// 100 (1 - ||measured - predicted|| / ||measured - its mean in each log||) of the same rows, nominal plant; null where nothing moved.
    pub nominal_fit_percent: f64,
    /// .. nominal numbers refitted under their sigma.
    pub refit_fit_percent: f64,
    /// .. with the named effects.
    pub augmented_fit_percent: f64,
    /// 100 (1 - augmented / nominal).
    pub shrink_percent: f64,
    /// Its 95 % interval, by moving blocks.
    pub shrink_percent_ci95: [f64; 2],
    /// The same above the noise.
    pub closure_percent: f64,
    /// What the fitted rows alone lead one to expect of `shrink_percent`.
    pub predicted_shrink_percent: f64,
    /// Its 95 % interval if the named forms hold, over the fitted logs and the uncertainty of all numbers. A form that goes wrong only where no
    /// fitted log has been is beyond it: how often that happens, the blind check counts.
    pub predicted_shrink_percent_ci95: [f64; 2],
}

/// A player's share of what is explained.
#[derive(Clone, Debug, Serialize)]
pub struct ShareOf {
    /// Effect, or `parameter_error` for the refit.
    pub effect: String,
    /// Of the squared excess.
    pub percent: f64,
}

/// Predictions of the three plants for all logs, fitted ones first.
pub(super) struct Three {
    pub nominal: Vec<Played>,
    pub refit: Vec<Played>,
    pub augmented: Vec<Played>,
    /// Rows of each fitted log and their squares, metres squared, of what belongs to it and the others do not let expect, if there is such a
    /// thing: the size of a drift.
    pub not_portable: Vec<[f64; 2]>,
}

/// Sums over a stretch: rows, squares of nominal, refit, augmented, and of the noise.
#[derive(Clone, Copy, Default)]
struct Sums([f64; 5]);

impl Sums {
    fn add(&mut self, other: &Sums) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, more)| *sum += more);
    }

    fn less(&self, other: &Sums) -> Sums {
        let mut left = *self;
        left.0.iter_mut().zip(other.0).for_each(|(sum, less)| *sum -= less);
        left
    }

    fn mean(&self, of: usize) -> f64 {
        self.0[of] / self.0[0].max(1.0)
    }

    fn shrink_percent(&self) -> f64 {
        if self.0[1] > 0.0 { 100.0 * (1.0 - (self.0[3] / self.0[1]).sqrt()) } else { 0.0 }
    }
}

/// Rows of log `index` (fitted ones first) that the headline scores.
pub(super) fn is_scored(benches: &Benches<'_>, index: usize, row: usize) -> bool {
    let fitted = benches.fitted.records.len();
    match &benches.held {
        Some(held) => index >= fitted && row >= scored_from(&held.records[index - fitted]),
        None => {
            let record = &benches.fitted.records[index];
            row >= record.run_in && record.holds_out(row)
        }
    }
}

/// The gap on the headline's rows, where `expected` is what was to be expected there.
pub(super) fn gap(benches: &Benches<'_>, three: &Three, expected: &Expected, seed: u64) -> Gap {
    let mut logs: Vec<Vec<Sums>> = Vec::new();
    let mut motion_m2 = 0.0;
    for (index, record) in benches.records().enumerate() {
        let augmented = &three.augmented[index];
        let scored = || (0..record.log.len()).filter(|row| is_scored(benches, index, *row));
        let rows = scored().count();
        let measured_m = || scored().map(|row| record.log.displacement_m[row]);
        let mean_m = measured_m().sum::<f64>() / rows.max(1) as f64;
        motion_m2 += measured_m().map(|m| (m - mean_m).powi(2)).sum::<f64>();
        let every = rows.div_ceil(LOOKED_AT).max(1);
        let together = [&three.nominal[index], augmented].map(|played| {
            let missed_m = scored().step_by(every).map(|row| record.log.displacement_m[row] - played[row]);
            every as f64 * samples_per_independent(&missed_m.collect::<Vec<_>>())
        });
        let cell_rows = cell_rows(record.log.dt_s, together[0].max(together[1]), rows);
        let mut cells: Vec<Sums> = Vec::new();
        for (row, &measured) in record.log.displacement_m.iter().enumerate() {
            if !is_scored(benches, index, row) {
                continue;
            }
            let square = |played: &Played| (measured - played[row]).powi(2);
            let sums = Sums([
                1.0,
                square(&three.nominal[index]),
                square(&three.refit[index]),
                square(augmented),
                record.noise_m.powi(2),
            ]);
            match cells.last_mut() {
                Some(last) if last.0[0] < cell_rows as f64 => last.add(&sums),
                _ => cells.push(sums),
            }
        }
        if !cells.is_empty() {
            logs.push(cells);
        }
    }
    let mut all = Sums::default();
    logs.iter().flatten().for_each(|cell| all.add(cell));
    let rms_um = |of: usize| 1e6 * all.mean(of).sqrt();
    let fit_percent = |of: usize| 100.0 * (1.0 - (all.0[of] / motion_m2).sqrt());
    let excess = |of: usize| (all.mean(of) - all.mean(4)).max(0.0).sqrt();
    let closure_percent = match (excess(1), excess(3)) {
        (_, 0.0) => 100.0,
        (0.0, _) => 0.0,
        (before, after) => 100.0 * (1.0 - after / before),
    };
    let shrink_percent = all.shrink_percent();
    // The ends of a log are in fewer blocks than its middle.
    let [low, high] = interval(&logs, seed);
    Gap {
        headline: if benches.held.is_some() { "held-out log" } else { "held-out stretches" },
        nominal_rms_um: rms_um(1),
        refit_rms_um: rms_um(2),
        augmented_rms_um: rms_um(3),
        noise_rms_um: rms_um(4),
        nominal_fit_percent: fit_percent(1),
        refit_fit_percent: fit_percent(2),
        augmented_fit_percent: fit_percent(3),
        shrink_percent,
        shrink_percent_ci95: [low.min(shrink_percent), high.max(shrink_percent)],
        closure_percent,
        predicted_shrink_percent: expected.shrink_percent,
        predicted_shrink_percent_ci95: expected.shrink_percent_ci95,
    }
}

impl Gap {
    /// The three fits in words, nominal plant first.
    pub fn fits(&self, between: &str) -> String {
        let fits = [self.nominal_fit_percent, self.refit_fit_percent, self.augmented_fit_percent];
        fits.map(|percent| format!("{percent:.2} %")).join(between)
    }

    /// Whether the named plant misses the headline's rows by more than was to be expected of it: they show what no fitted row does.
    pub(super) fn surprises(&self, expected: &Expected) -> bool {
        let noise2_m2 = (1e-6 * self.noise_rms_um).powi(2);
        let excess2_m2 = (1e-6 * self.augmented_rms_um).powi(2) - noise2_m2;
        excess2_m2 > SURPRISE.powi(2) * (expected.left2_m2 + LEAST_GAP.powi(2) * noise2_m2)
    }
}

/// Rows of a cell, where so many rows of what is missed hang together, in a log of `rows`.
fn cell_rows(dt_s: f64, together: f64, rows: usize) -> usize {
    let block = (BLOCK_S / dt_s).max((OUTLASTED * together).min((rows / PART_OF_LOG) as f64));
    ((block / CELLS as f64) as usize).max(1)
}

/// 95 % interval of the shrink, over resampled blocks.
fn interval(logs: &[Vec<Sums>], seed: u64) -> [f64; 2] {
    let mut random = Pcg64::seed_from_u64(seed);
    // Sums from the start, so that a block is a difference.
    let sums: Vec<Vec<Sums>> = logs
        .iter()
        .map(|cells| {
            let mut sum = Sums::default();
            let after = cells.iter().map(|cell| {
                sum.add(cell);
                sum
            });
            std::iter::once(Sums::default()).chain(after).collect()
        })
        .collect();
    let starts: Vec<(usize, usize)> = logs
        .iter()
        .enumerate()
        .flat_map(|(log, cells)| (0..=cells.len().saturating_sub(CELLS)).map(move |cell| (log, cell)))
        .collect();
    if starts.is_empty() {
        return [0.0, 0.0];
    }
    let blocks = logs.iter().map(Vec::len).sum::<usize>().div_ceil(CELLS);
    let shrinks = (0..RESAMPLES)
        .map(|_| {
            let mut all = Sums::default();
            for _ in 0..blocks {
                let (log, cell) = starts[random.random_range(0..starts.len())];
                let upto = (cell + CELLS).min(sums[log].len() - 1);
                all.add(&sums[log][upto].less(&sums[log][cell]));
            }
            all.shrink_percent()
        })
        .collect();
    middle_95(shrinks)
}

/// What the fitted rows and the headline's commands lead one to expect on the headline's rows.
pub(super) struct Expected {
    /// Mean square beyond the noise that the named plant leaves, metres squared; as likely more as less if hysterons held something when logs began.
    pub left2_m2: f64,
    /// 100 (1 - named / nominal) for that.
    pub shrink_percent: f64,
    /// Its 95 % interval.
    pub shrink_percent_ci95: [f64; 2],
}

/// What the power that the named plant leaves goes with, from row to row.
#[derive(Clone, Copy)]
pub(super) enum LeftWith {
    /// The plants' difference: a form that is not quite right.
    Difference,
    /// The speed: readings at wrong times.
    Speed,
    /// Nothing: noise.
    Nothing,
}

impl LeftWith {
    /// That of what was named beyond what a fit explains.
    pub fn of(random: Option<&Random>) -> Self {
        match random.map(|random| random.effect.id()) {
            None => Self::Difference,
            Some("sampling_jitter" | "lost_samples") => Self::Speed,
            Some(_) => Self::Nothing,
        }
    }
}

/// What the fitted logs say of what stays on others.
pub(super) struct Left<'l> {
    /// What it goes with.
    pub with: LeftWith,
    /// What numbers, starts and settings that are not well known make on the headline's rows.
    pub spread: &'l Spread,
    /// Mean square that each fitted log would leave more if the others alone told what is shared, metres squared.
    pub left_out_m2: Option<&'l [f64]>,
}

/// Sums over the fitted rows of one log, squares in metres squared.
#[derive(Clone, Copy, Default)]
struct OfLog {
    rows: f64,
    /// What goes with what stays.
    goes_with: f64,
    /// What stays beyond the noise.
    left2: f64,
    noise2: f64,
    /// Rows and squares of what belongs to it and the others do not let expect.
    own_rows: f64,
    own2: f64,
}

/// The plants' difference on the headline's rows is what will be gained; what the fitted rows leave unexplained stays, in the same
/// proportion to what it goes with, and so does what the numbers' uncertainty makes there. A form that leaves more than noise has bent the
/// numbers to suit these logs: of others it leaves more, as leaving out each of these tells. A log that no fit saw is another one: for
/// the interval what stays of it is drawn log by log.
pub(super) fn expected(benches: &Benches<'_>, three: &Three, left: &Left<'_>, seed: u64) -> Expected {
    let mut fitted = vec![OfLog::default(); benches.fitted.records.len()];
    fitted.iter_mut().zip(&three.not_portable).for_each(|(log, own)| [log.own_rows, log.own2] = *own);
    // Of the headline's rows: number, difference, noise, what goes with what stays.
    let mut headline = [0.0; 4];
    for (index, record) in benches.records().enumerate() {
        let augmented = &three.augmented[index];
        let noise2 = record.noise_m.powi(2);
        let speed2 = |row: usize| {
            let next_m = augmented.get(row + 1).unwrap_or(&augmented[row]);
            ((next_m - augmented[row]) / record.log.dt_s).powi(2)
        };
        for (row, &measured) in record.log.displacement_m.iter().enumerate() {
            let difference2 = (three.nominal[index][row] - augmented[row]).powi(2);
            let goes_with = match left.with {
                LeftWith::Difference => difference2,
                LeftWith::Speed => speed2(row),
                LeftWith::Nothing => 1.0,
            };
            if is_scored(benches, index, row) {
                let sums = headline.iter_mut().zip([1.0, difference2, noise2, goes_with]);
                sums.for_each(|(sum, more)| *sum += more);
            } else if row >= record.run_in
                && let Some(fitted) = fitted.get_mut(index)
            {
                fitted.rows += 1.0;
                fitted.goes_with += goes_with;
                fitted.left2 += (measured - augmented[row]).powi(2) - noise2;
                fitted.noise2 += noise2;
            }
        }
    }
    let [rows, difference2, noise2, goes_with] = headline;
    let sum = |logs: &[OfLog], of: fn(&OfLog) -> f64| logs.iter().map(of).sum::<f64>();
    // What scatters bends no number, and stretches of the fitted logs are no others.
    let is_form = matches!(left.with, LeftWith::Difference) && benches.held.is_some();
    if is_form && sum(&fitted, |log| log.left2) > (AT_NOISE - 1.0) * sum(&fitted, |log| log.noise2) {
        let more_m2 = left.left_out_m2.into_iter().flatten();
        fitted.iter_mut().zip(more_m2).for_each(|(log, more_m2)| log.left2 = of_another(log.left2, log.rows * more_m2));
    }
    let per = |sum: f64, of: f64| if of > 0.0 { sum / of } else { 0.0 };
    let stays2 = |logs: &[OfLog]| {
        let unexplained2 = per(sum(logs, |log| log.left2).max(0.0), sum(logs, |log| log.goes_with)) * goes_with;
        let own2 = per(sum(logs, |log| log.own2), sum(logs, |log| log.own_rows)) * rows;
        unexplained2 + if benches.held.is_some() { own2 } else { 0.0 }
    };
    let shrink_percent = |left2: f64, noise2: f64| {
        let (before2, after2) = (difference2 + left2 + noise2, left2 + noise2);
        if difference2 > 0.0 { 100.0 * (1.0 - (after2 / before2).sqrt()) } else { 0.0 }
    };
    let mut random = Pcg64::seed_from_u64(seed);
    let others = benches.held.as_ref().map_or(fitted.len(), |held| held.records.len());
    let draws = (0..RESAMPLES).map(|_| {
        let logs: Vec<OfLog> = (0..others).map(|_| fitted[random.random_range(0..fitted.len())]).collect();
        let is_charged = random.random::<f64>() < left.spread.charged;
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        let mut made2 = |by_m2: &[f64]| rows * by_m2.iter().map(|m2| m2 * normal().powi(2)).sum::<f64>();
        let Spread { starts_m2, settings_m2, numbers_m2, charged_m2, .. } = left.spread;
        let at_rest2 = [starts_m2, settings_m2, numbers_m2].into_iter().map(|by_m2| made2(by_m2)).sum::<f64>();
        let charged2 = at_rest2 + made2(charged_m2);
        let noise2 = noise2 * (1.0 + NOISE_KNOWN * normal());
        let drawn2 = if is_charged { charged2 } else { at_rest2 };
        ([drawn2, charged2], shrink_percent(stays2(&logs) + drawn2, noise2))
    });
    let (spread, shrinks): (Vec<[f64; 2]>, Vec<f64>) = draws.unzip();
    let [drawn2, charged2] = [0, 1].map(|of| {
        let mut made2: Vec<f64> = spread.iter().map(|made2| made2[of]).collect();
        made2.sort_by(f64::total_cmp);
        made2[RESAMPLES / 2]
    });
    let point = shrink_percent(stays2(&fitted) + drawn2, noise2);
    let [low, high] = middle_95(shrinks);
    Expected {
        left2_m2: (stays2(&fitted) + charged2) / rows.max(1.0),
        shrink_percent: point,
        shrink_percent_ci95: [low.min(point), high.max(point)],
    }
}

/// Squares that a log like one of which `left2` stay would leave if it had not been fitted, where leaving it out leaves `more2`: of a log with leverage
/// h stays 1 - h of them, and left out 1 / (1 - h), so that the mean is geometric (MacKinnon and White 1985). A log that alone shows an effect
/// says nothing of itself where it is left out.
fn of_another(left2: f64, more2: f64) -> f64 {
    if left2 > 0.0 { (left2 * (left2 + more2)).sqrt() } else { left2 }
}

/// 2.5th and 97.5th percentile of the resamples.
fn middle_95(mut resampled: Vec<f64>) -> [f64; 2] {
    resampled.sort_by(f64::total_cmp);
    [resampled[RESAMPLES * 25 / 1000], resampled[RESAMPLES * 975 / 1000 - 1]]
}

/// Mean square beyond the noise on all rows, metres squared: a held-out log may not show what the hold or the multisine does.
fn excess2(benches: &Benches<'_>, played: &[Played]) -> f64 {
    let fitted = benches.fitted.records.len();
    let (mut rows, mut sum) = (0.0, 0.0);
    for (index, record) in benches.records().enumerate() {
        let from = if index < fitted { record.run_in } else { scored_from(record) };
        let residuals = record.log.displacement_m.iter().zip(&played[index]).skip(from).map(|(y, p)| y - p);
        rows += (record.log.len() - from) as f64;
        sum += residuals.map(|r| r * r - record.noise_m.powi(2)).sum::<f64>();
    }
    f64::max(sum / f64::max(rows, 1.0), 0.0)
}

/// Shapley shares of the refit and of the variant's effects in the squared excess that they take away. `beyond` are effects that no
/// prediction shows, with their power. Where each coalition stands is simulated once; it is fitted again only where a fit is there
/// already: the refit alone and all together.
pub(super) fn shares(
    benches: &Benches<'_>,
    three: &Three,
    augmented: &Variant,
    beyond: &[(&'static str, f64)],
) -> Vec<ShareOf> {
    let installed: Vec<&'static str> = augmented.hypothesis.ids();
    let players = 1 + installed.len();
    let nominal2 = excess2(benches, &three.nominal);
    let explained: Vec<f64> = (0..1usize << players)
        .map(|coalition| {
            let left2 = match coalition {
                0 => nominal2,
                1 => excess2(benches, &three.refit),
                _ if coalition + 1 == 1 << players => excess2(benches, &three.augmented),
                _ => {
                    let part = augmented.part(&benches.fitted, coalition & 1 == 1, |i| {
                        let at = installed.iter().position(|id| *id == i.effect.id()).unwrap_or(0);
                        coalition >> (1 + at) & 1 == 1
                    });
                    excess2(benches, &benches.play(&part))
                }
            };
            nominal2 - left2
        })
        .collect();
    let mut values = shapley(&at_best(explained), players);
    let names = std::iter::once("parameter_error").chain(installed).chain(beyond.iter().map(|(id, _)| *id));
    values.extend(beyond.iter().map(|(_, power_m2)| power_m2.max(0.0)));
    let sum: f64 = values.iter().sum();
    let mut shares: Vec<ShareOf> = Vec::new();
    for (name, value) in names.zip(values) {
        let percent = if sum > 0.0 { 100.0 * value / sum } else { 0.0 };
        match shares.iter_mut().find(|share| share.effect == name) {
            Some(share) => share.percent += percent,
            None => shares.push(ShareOf { effect: name.to_owned(), percent }),
        }
    }
    if sum <= 0.0 {
        shares[0].percent = 100.0;
    }
    shares.sort_by(|a, b| b.percent.total_cmp(&a.percent));
    shares
}

/// What each coalition explains at best, by itself or in part: an effect without the numbers that were fitted beside it may do worse than none, and
/// whoever does worse together leaves one out. So none explains less than a part of it, and no share is below nothing.
fn at_best(mut values: Vec<f64>) -> Vec<f64> {
    for coalition in 1..values.len() {
        let players = (0..usize::BITS).map(|player| 1 << player).filter(|player| coalition & player != 0);
        values[coalition] = players.map(|player| values[coalition & !player]).fold(values[coalition], f64::max);
    }
    values
}

/// Each player's mean marginal value over all orders; `values` by coalition, bit i for player i.
fn shapley(values: &[f64], players: usize) -> Vec<f64> {
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    (0..players)
        .map(|player| {
            (0..values.len())
                .filter(|coalition| coalition >> player & 1 == 0)
                .map(|coalition| {
                    let size = coalition.count_ones() as usize;
                    let weight = factorial(size) * factorial(players - size - 1) / factorial(players);
                    weight * (values[coalition | 1 << player] - values[coalition])
                })
                .sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{Expected, Gap, Sums, at_best, cell_rows, interval, of_another, shapley};

    #[test]
    fn rows_surprise_where_more_stays_than_numbers_and_noise_explain() {
        let gap = |augmented_rms_um| Gap {
            headline: "held-out log",
            nominal_rms_um: 1.0,
            refit_rms_um: augmented_rms_um,
            augmented_rms_um,
            noise_rms_um: 0.02,
            nominal_fit_percent: 0.0,
            refit_fit_percent: 0.0,
            augmented_fit_percent: 0.0,
            shrink_percent: 0.0,
            shrink_percent_ci95: [0.0; 2],
            closure_percent: 0.0,
            predicted_shrink_percent: 0.0,
            predicted_shrink_percent_ci95: [0.0; 2],
        };
        let expected = |left_um: f64| Expected {
            left2_m2: (1e-6 * left_um).powi(2),
            shrink_percent: 0.0,
            shrink_percent_ci95: [0.0; 2],
        };
        assert!(!gap(0.03).surprises(&expected(0.0)) && gap(0.08).surprises(&expected(0.0)));
        assert!(!gap(0.3).surprises(&expected(0.05)) && gap(0.5).surprises(&expected(0.05)));
    }

    #[test]
    fn a_log_not_fitted_leaves_between_what_a_fitted_and_what_a_left_out_one_does() {
        // The mean of n numbers of variance 1: leverage 1 / n.
        for n in [2.0, 5.0, 100.0] {
            let (fitted, left_out) = (1.0 - 1.0 / n, 1.0 / (1.0 - 1.0 / n));
            assert!((of_another(fitted, left_out - fitted) - 1.0).abs() < 1e-12, "{n}");
        }
        assert_eq!((of_another(0.0, 1e3), of_another(-0.1, 1e3), of_another(2.0, 0.0)), (0.0, -0.1, 2.0));
    }

    #[test]
    fn shares_of_a_known_game() {
        // A left glove against two right ones: 2/3, 1/6, 1/6.
        let game: Vec<f64> = (0..8).map(|c: usize| f64::from(u8::from(c & 1 == 1 && c > 1))).collect();
        let values = shapley(&game, 3);
        for (found, right) in values.iter().zip([2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0]) {
            assert!((found - right).abs() < 1e-12, "{values:?}");
        }
    }

    #[test]
    fn an_effect_that_needs_its_numbers_shares_with_them() {
        // The refit alone explains 1, the effect with nominal numbers makes it worse by 6, both explain 9.
        let values = shapley(&at_best(vec![0.0, 1.0, -6.0, 9.0]), 2);
        assert_eq!(values, [5.0, 4.0]);
        assert_eq!(at_best(vec![0.0, -1.0, -2.0, -3.0]), [0.0; 4]);
    }

    #[test]
    fn blocks_outlast_what_hangs_together() {
        // 50 ms at 20 kHz; twice what hangs together; a quarter of the log.
        assert_eq!([1.0, 5e3, 1e6].map(|together| cell_rows(5e-5, together, 80_000)), [100, 1000, 2000]);
        assert_eq!(cell_rows(0.1, 1.0, 80_000), 1);
    }

    #[test]
    fn the_interval_holds_the_shrink_and_follows_the_seed() {
        let cells = |from: usize| (from..from + 200).map(|k| Sums([100.0, 900.0 + k as f64, 0.0, 9.0, 0.0])).collect();
        let logs: Vec<Vec<Sums>> = vec![cells(0), cells(50)];
        let [low, high] = interval(&logs, 1);
        // sqrt(9 / 1025) of the amplitude stays on average.
        assert!(low < 90.63 && 90.63 < high && high - low < 0.5, "{low} {high}");
        assert_eq!(interval(&logs, 1), [low, high]);
        assert_ne!(interval(&logs, 2), [low, high]);
    }
}
