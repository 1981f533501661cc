//! Whether a residual is noise, told by the power of its octaves: noise of a sensor has the same in every log, whatever the plant does, and it
//! falls smoothly with frequency, as `a + b / f^n` (`a`: white, `b / f`: flicker), or is flat below some frequency and falls so beyond it, as behind a
//! sensor's own filter. What a wrong model leaves does neither. And which octave of a gap a fit misses most.

use super::bench::{Bench, Record};
use super::search::{Remainder, middle};
use std::collections::BTreeMap;

/// Least number of pairs of stretches from which an octave's power is read.
const LEAST_PAIRS: usize = 8;
/// Relative spread of an octave's power that is no sign of anything: the refit takes some of it.
const TOLERANCE: f64 = 0.15;
/// Sigmas that the power of an octave may be off by.
const SIGMAS: f64 = 2.0;
/// Steepest fall: beyond it is a drift, whose steps add up. It may be steeper where so many octaves are flat, as behind a filter of second order.
const STEEPEST: f64 = 1.6;
const FLAT: usize = 3;
const STEEPEST_TO_FLAT: f64 = 2.4;
/// Falls that are tried, and shares of the slowest octave's power that white noise makes, each smaller by this factor.
const FALLS: usize = 17;
const WHITE_SHARES: i32 = 40;
const SMALLER: f64 = 0.75;

/// The relative spread of an octave's power that is taken for noise's, where rows hit now and then make it large, is no more than this: a miss in one
/// place makes it large as well.
const WIDEST: f64 = 0.25;
/// An octave counts by itself if its part of the gap, and what is left of it, are more than these shares of one log's noise.
const GAP_OF_OCTAVE: f64 = 0.3;
const LEFT_OF_OCTAVE: f64 = 0.08;
/// .. and its part of the gap more than this share of the whole one, as a log's.
const PART_OF_GAP: f64 = 1e-3;

/// Power of a log in one octave.
#[derive(Clone, Copy, Debug)]
pub(super) struct Octave {
    log: usize,
    /// Stretches of 2^level rows are compared with the next ones.
    level: i32,
    /// Octaves by which the log's rows lie farther apart than a millisecond.
    spacing: f64,
    /// Number of such pairs side by side: what the octave is worth in a likelihood. Pairs at every row tell its power up to three times better.
    pairs: f64,
    /// Mean square, scaled so that white noise has its variance in each octave, metres squared.
    power_m2: f64,
    /// Relative sigma of that, if only pairs side by side are independent.
    sigma: f64,
}

impl Octave {
    /// Relative sigma of the power, if the residual is normal.
    fn spread(&self) -> f64 {
        (2.0 / self.pairs).sqrt().hypot(TOLERANCE)
    }

    /// Times that what scatters may have more power in one log or octave than in another: rows hit now and then much more.
    fn widening(&self) -> f64 {
        1.0 + SIGMAS * self.sigma.min(WIDEST)
    }
}

/// Octaves of all logs. Lost rows say nothing.
pub(super) fn octaves_of(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<Octave> {
    octaves_beside(bench, remainders, 0.0)
}

/// The same of what stays beside errors of the sampling instants of `jitter_s`: rows in which the plant moves fast count for less.
pub(super) fn octaves_beside(bench: &Bench<'_>, remainders: &[Remainder], jitter_s: f64) -> Vec<Octave> {
    let of_log = |(log, (record, left)): (usize, (&Record<'_>, &Remainder))| {
        let still_m = record.still_m();
        let residual_m = |row: usize| {
            let k = record.run_in + row;
            let residual_m = if record.has_lost(k) { 0.0 } else { left.residual_m[k] };
            residual_m / (jitter_s * left.velocity_m_per_s[k] / still_m).hypot(1.0)
        };
        octaves(log, left.residual_m.len() - record.run_in, residual_m, record.log.dt_s)
    };
    bench.records.iter().zip(remainders).enumerate().flat_map(of_log).collect()
}

/// Logarithm of the likelihood ratio of two residuals whose noise is as loud in each octave of each log as the residual says (Whittle 1953): what a fit
/// takes of an octave that is quiet counts, however loud another is.
pub(super) fn shown(before: &[Octave], after: &[Octave]) -> f64 {
    let is_told = |octave: &Octave| octave.power_m2 > 0.0;
    let both = before.iter().zip(after).filter(|(before, after)| is_told(before) && is_told(after));
    both.map(|(before, after)| 0.5 * before.pairs * (before.power_m2 / after.power_m2).ln()).sum()
}

/// What scatters in each log, and what it may have more of it in one log than in another, as its fastest octave tells.
pub(super) fn widened(scatter_m2: &[f64], octaves: &[Octave]) -> Vec<f64> {
    let fastest = |log: usize| octaves.iter().find(|octave| octave.log == log);
    scatter_m2.iter().enumerate().map(|(log, m2)| m2 * fastest(log).map_or(1.0, Octave::widening)).collect()
}

/// Fraction of the gap in one octave of all logs that stays, as amplitude, in the octave where most of it stays. What imitates a gap at its slow end,
/// where most of its power is, may explain nothing at the structure's resonance: a stiffness that warms up is no gain that does. One sensor has one
/// noise: what stays of the log in the middle tells how loud it is in an octave. Of what stays of each log `scatter_m2` is explained, if that is
/// known.
pub(super) fn left_of_worst_octave(bench: &Bench<'_>, before: &[Octave], after: &[Octave], scatter_m2: &[f64]) -> f64 {
    let octave_of = |of: &Octave| of.level + bench.records[of.log].log.dt_s.log2().round() as i32;
    let mut of_logs_m2: BTreeMap<i32, Vec<f64>> = BTreeMap::new();
    for octave in after {
        of_logs_m2.entry(octave_of(octave)).or_default().push(octave.power_m2);
    }
    let middle_m2: BTreeMap<i32, f64> = of_logs_m2.iter().map(|(octave, of_logs)| (*octave, middle(of_logs))).collect();
    let mut sums: BTreeMap<i32, [f64; 2]> = BTreeMap::new();
    for (before, after) in before.iter().zip(after) {
        let record = &bench.records[before.log];
        let own_m2 = record.noise_m.powi(2);
        let noise_m2 = own_m2.max(middle_m2[&octave_of(after)]);
        let scatter_m2 = scatter_m2.get(after.log).copied().unwrap_or_default();
        let explained_m2 = noise_m2.max(own_m2 + scatter_m2 * after.widening());
        // In shares of the noise's power in all octaves.
        let share = |power_m2: f64| before.pairs * power_m2 / ((record.log.len() - record.run_in) as f64 * own_m2);
        let [gap, left] = sums.entry(octave_of(before)).or_default();
        *gap += share(before.power_m2 - noise_m2);
        *left += share((after.power_m2 - explained_m2).max(0.0));
    }
    left_of_worst(sums.into_values(), [GAP_OF_OCTAVE, LEFT_OF_OCTAVE])
}

/// Fraction that is left of a part of the gap, as amplitude, where that is most. `parts` are power of the gap and what is left of it; those count that have
/// more than `least` of either, and whose gap is no hair of the whole one: what stays where little was amiss is no sign of another cause.
pub(super) fn left_of_worst(parts: impl Iterator<Item = [f64; 2]>, least: [f64; 2]) -> f64 {
    let parts: Vec<[f64; 2]> = parts.collect();
    let whole: f64 = parts.iter().map(|[gap, _]| gap).sum();
    let is_told = |[gap, left]: &&[f64; 2]| *gap > least[0].max(PART_OF_GAP * whole) && *left > least[1];
    parts.iter().filter(is_told).map(|[gap, left]| left / gap).fold(0.0, f64::max).sqrt()
}

/// Fraction of the power beyond the noise, in all logs and in the log where it is most, that no noise of the kind has which fits all logs' octaves
/// best. One where there is nothing beyond the noise.
pub(super) fn beyond_any_noise(bench: &Bench<'_>, remainders: &[Remainder]) -> [f64; 2] {
    let octaves = octaves_of(bench, remainders);
    let Some(noise_m2) = smooth(&octaves) else { return [1.0; 2] };
    let mut excess = vec![0.0; remainders.len()];
    let mut beyond = vec![0.0; remainders.len()];
    for octave in &octaves {
        let noise2 = bench.records[octave.log].noise_m.powi(2);
        let expected = noise_m2(octave);
        let allowed = SIGMAS * octave.spread() * expected;
        excess[octave.log] += octave.pairs * (octave.power_m2 - noise2);
        beyond[octave.log] += octave.pairs * ((octave.power_m2 - expected).abs() - allowed).max(0.0);
    }
    let share = |beyond: f64, excess: f64| if excess > 0.0 { (beyond / excess).min(1.0) } else { 1.0 };
    let worst = beyond.iter().zip(&excess).filter(|(_, excess)| **excess > 0.0).map(|(b, e)| share(*b, *e));
    [share(beyond.iter().sum(), excess.iter().sum()), worst.fold(0.0, f64::max)]
}

/// Powers of a log's octaves, fastest first, from its residual at each of so many rows: mean squares of its Haar wavelets at every row, as steps need
/// not begin where a stretch does, with the log mirrored at its ends, as starts die out there (Percival & Walden 2000, chapter 5).
fn octaves(log: usize, rows: usize, residual_m: impl Fn(usize) -> f64, dt_s: f64) -> Vec<Octave> {
    let spacing = (1e3 * dt_s).log2();
    // Wavelets see no constant; without it nothing is left of one but zeros.
    let mirrored = rows / (2 * LEAST_PAIRS);
    let mut sums = Vec::with_capacity(rows + 2 * mirrored + 1);
    let (mut sum, first_m) = (0.0, if rows > 0 { residual_m(0) } else { 0.0 });
    sums.push(sum);
    for row in (0..mirrored).rev().chain(0..rows).chain((rows - mirrored..rows).rev()) {
        sum += residual_m(row) - first_m;
        sums.push(sum);
    }
    let mut octaves = Vec::new();
    for level in 0.. {
        let width = 1usize << level;
        let pairs = rows / (2 * width);
        if pairs < LEAST_PAIRS {
            break;
        }
        let pairs = pairs as f64;
        let square = |k: usize| (sums[k + width] - 2.0 * sums[k] + sums[k - width]).powi(2);
        let sums_of = |[sum, sum2]: [f64; 2], square: f64| [sum + square, sum2 + square * square];
        let [mean, mean2] =
            (mirrored..=mirrored + rows).map(square).fold([0.0; 2], sums_of).map(|sum| sum / (rows + 1) as f64);
        let sigma = if mean > 0.0 { ((mean2 - mean * mean).max(0.0) / pairs).sqrt() / mean } else { 0.0 };
        octaves.push(Octave { log, level, spacing, pairs, power_m2: mean * 0.5 / width as f64, sigma });
    }
    octaves
}

/// Power in an octave of the noise that fits best: white, which has the same in every row, and a part that grows by 2^n with every octave towards slow
/// ones, or up to one of them, and has a density of its own, of which rows farther apart hold as much less. None without octaves.
fn smooth(octaves: &[Octave]) -> Option<impl Fn(&Octave) -> f64 + use<>> {
    let place = |octave: &Octave| f64::from(octave.level) + octave.spacing;
    let slowest = octaves.iter().map(place).reduce(f64::max)?;
    let closest = octaves.iter().map(|octave| octave.spacing).fold(f64::INFINITY, f64::min);
    // Slower ones than the octave `flat` have no more power than that.
    let shape = move |flat: f64, fall: f64, white: f64, octave: &Octave| {
        white + (1.0 - white) * (fall * (place(octave) - flat).min(0.0) - (octave.spacing - closest)).exp2()
    };
    let mut best = (f64::INFINITY, 0.0, 0.0, 1.0, 1.0);
    let octaves_up = (slowest - closest).max(0.0) as usize;
    let falls = |up: usize| {
        let steepest = if up < FLAT { STEEPEST } else { STEEPEST_TO_FLAT };
        (0..FALLS).map(move |step| steepest * step as f64 / (FALLS - 1) as f64)
    };
    let bends = (0..=octaves_up).flat_map(|up| falls(up).map(move |fall| (slowest - up as f64, fall)));
    let told: Vec<(&Octave, f64)> = octaves
        .iter()
        .filter(|octave| octave.power_m2 > 0.0)
        .map(|octave| (octave, octave.spread().powi(-2)))
        .collect();
    let weights: f64 = told.iter().map(|(_, weight)| weight).sum();
    for (flat, fall) in bends {
        for share in 0..WHITE_SHARES {
            let white = SMALLER.powi(share);
            let logs = || {
                told.iter().map(|(octave, weight)| {
                    let ratio = octave.power_m2 / shape(flat, fall, white, octave);
                    // The logarithm of a mean square of few squares comes out below that of its expectation.
                    (ratio.ln() + 1.0 / octave.pairs, weight)
                })
            };
            let mean = logs().map(|(log, weight)| weight * log).sum::<f64>() / weights;
            let misfit: f64 = logs().map(|(log, weight)| weight * (log - mean).powi(2)).sum();
            if misfit < best.0 {
                best = (misfit, flat, fall, white, mean.exp());
            }
        }
    }
    let (misfit, flat, fall, white, size) = best;
    misfit.is_finite().then_some(move |octave: &Octave| size * shape(flat, fall, white, octave))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    const ROWS: usize = 8192;
    const NOISE_M: f64 = 2e-8;

    fn white(seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        (0..ROWS).map(|_| NOISE_M * 3f64.sqrt() * random.random_range(-1.0..1.0)).collect()
    }

    /// A lag in each octave, of one power each, makes power that falls with frequency.
    fn flicker(seed: u64) -> Vec<f64> {
        steeper(seed, 0.0)
    }

    /// The same, where each octave has so many octaves more power than the next faster one.
    fn steeper(seed: u64, by: f64) -> Vec<f64> {
        let mut sum = vec![0.0; ROWS];
        for octave in 0..10 {
            let keep = (-1.0 / f64::from(1 << octave)).exp();
            let mut slow = 0.0;
            for (sum, white) in sum.iter_mut().zip(white(100 * seed + octave)) {
                slow = keep * slow + (1.0 - keep * keep).sqrt() * white;
                *sum += (0.5 * by * octave as f64).exp2() * slow;
            }
        }
        sum
    }

    /// Three logs with white noise, and `more` in each: `of` says something of what is left of them.
    fn of_three<T>(more: &dyn Fn(u64, usize) -> f64, of: impl Fn(&Bench<'_>, &[Remainder]) -> T) -> T {
        of_three_every(&[1; 3], more, of)
    }

    /// The same with every so many-th row of each.
    fn of_three_every<T>(
        every: &[usize; 3],
        more: &dyn Fn(u64, usize) -> f64,
        of: impl Fn(&Bench<'_>, &[Remainder]) -> T,
    ) -> T {
        let model = thesis();
        let log = |n: usize| {
            let displacement_m: Vec<f64> = white(n as u64 + 1).into_iter().step_by(every[n]).collect();
            let (dt_s, command_v) = (5e-5 * every[n] as f64, vec![0.0; displacement_m.len()]);
            Log { dt_s, command_v, displacement_m, ..Log::default() }
        };
        let logs = [0, 1, 2].map(log);
        let mut bench = Bench::new(&model, logs.iter().map(|log| record(log, &model.chain(), None)).collect());
        bench.records.iter_mut().for_each(|record| record.noise_m = NOISE_M);
        let remainders: Vec<Remainder> = (0..3)
            .map(|n| {
                let rows = white(n + 1).into_iter().enumerate().step_by(every[n as usize]);
                let residual_m: Vec<f64> = rows.map(|(k, white)| white + more(n, k)).collect();
                Remainder { velocity_m_per_s: vec![0.0; residual_m.len()], residual_m }
            })
            .collect();
        of(&bench, &remainders)
    }

    /// What is beyond any noise of three logs with white noise, and `more` in each.
    fn beyond(more: impl Fn(u64, usize) -> f64) -> [f64; 2] {
        of_three(&more, beyond_any_noise)
    }

    /// Most of a gap may be explained, and nothing of what it is at another end.
    #[test]
    fn the_octave_that_a_fit_misses_most_is_found() {
        // Only the first log moves the plant.
        let loud = |n: u64| f64::from(u8::from(n == 0));
        let fast = |n: u64, k: usize| 6e-8 * loud(n) * (0.5 * k as f64).sin();
        let before = |n: u64, k: usize| 1e-6 * loud(n) * (2e-3 * k as f64).sin() + fast(n, k);
        let left = |after: &dyn Fn(u64, usize) -> f64, scatter_m2: f64| {
            let before = of_three(&before, octaves_of);
            of_three(after, |bench, remainders| {
                let after = octaves_of(bench, remainders);
                left_of_worst_octave(bench, &before, &after, &[scatter_m2; 3])
            })
        };
        let half = left(&|n, k| 0.5 * before(n, k), 0.0);
        let missed = left(&fast, 0.0);
        let found = left(&|_, _| 0.0, 0.0);
        assert!((half - 0.5).abs() < 0.05 && missed > 0.9 && found == 0.0, "{half} {missed} {found}");
        // What the log in the middle has is noise; what others have beyond it must be told.
        let twelve = |n: u64| -> Vec<Vec<f64>> { (0..12).map(|more| white(100 * n + more)).collect() };
        let noises = [0, 1, 2].map(twelve);
        let noisy = |n: u64, k: usize| noises[n as usize].iter().map(|white| white[k]).sum::<f64>();
        let everywhere = left(&noisy, 0.0);
        let in_one = |n: u64, k: usize| loud(n) * noisy(n, k);
        let (told, untold) = (left(&in_one, 12.0 * NOISE_M * NOISE_M), left(&in_one, 0.0));
        assert!(untold > 1.0 && told < 0.5 * untold && everywhere == 0.0, "{told} {untold} {everywhere}");
    }

    /// A log or octave in which a thousandth of the gap showed says nothing against what closes the rest.
    #[test]
    fn what_is_left_where_next_to_nothing_was_amiss_does_not_count() {
        let of = |small: f64| left_of_worst([[400.0, 0.1], [1000.0, 2.0], [small, 5.0]].into_iter(), [0.25, 0.08]);
        let (little, enough) = (of(1.3), of(1.5));
        assert!((little - 0.002_f64.sqrt()).abs() < 1e-12, "{little}");
        assert!((enough - (5.0 / 1.5_f64).sqrt()).abs() < 1e-12, "{enough}");
        // Nor does what is less than the noise tells.
        assert_eq!(left_of_worst([[0.2, 0.2], [1.0, 0.05]].into_iter(), [0.25, 0.08]), 0.0);
    }

    /// A slow sine far below errors of the instants, which are there in one half only.
    #[test]
    fn what_is_small_shows_where_a_log_is_quiet() {
        let (model, jitter_s) = (thesis(), 1e-5);
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; ROWS], displacement_m: white(1), ..Log::default() };
        let mut bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        bench.records[0].noise_m = NOISE_M;
        let velocity_m_per_s: Vec<f64> = (0..ROWS).map(|k| if k < ROWS / 2 { 0.1 } else { 0.0 }).collect();
        let late = white(2);
        let left = |sine_m: f64| {
            let of_row = |k: usize| {
                let error_m = jitter_s * velocity_m_per_s[k] * late[k] / NOISE_M;
                log.displacement_m[k] + error_m + sine_m * (5e-3 * k as f64).sin()
            };
            [Remainder { residual_m: (0..ROWS).map(of_row).collect(), velocity_m_per_s: velocity_m_per_s.clone() }]
        };
        let shows = |sine_m: f64, jitter_s: f64| {
            let [before, after] = [sine_m, 0.0].map(|sine_m| octaves_beside(&bench, &left(sine_m), jitter_s));
            shown(&before, &after)
        };
        let (beside, blind, nothing) = (shows(2e-8, jitter_s), shows(2e-8, 0.0), shows(0.0, jitter_s));
        assert!(beside > 50.0 && blind < 0.1 * beside && nothing == 0.0, "{beside} {blind} {nothing}");
    }

    /// Rows hit now and then scatter as they do: hits of one log are larger than another's.
    #[test]
    fn rows_hit_now_and_then_leave_nothing_of_what_scatters() {
        let draws: Vec<Vec<f64>> = (7..10).map(white).collect();
        let hit = |n: u64, k: usize| {
            if (k as u64 * 7919 + n * 31).is_multiple_of(400) { 40.0 * draws[n as usize][k] } else { 0.0 }
        };
        let hits: Vec<Vec<f64>> = (0..3).map(|n| (0..ROWS).map(|k| hit(n, k)).collect()).collect();
        let of = |n: u64, k: usize| hits[n as usize][k];
        let mean2 = hits.iter().flatten().map(|hit| hit * hit).sum::<f64>() / (3 * ROWS) as f64;
        let before = of_three(&|n, k| of(n, k) + 2e-8 * k as f64 * (1.6 * k as f64).sin() / 4e3, octaves_of);
        let left = of_three(&of, |bench, remainders| {
            left_of_worst_octave(bench, &before, &octaves_of(bench, remainders), &[mean2; 3])
        });
        assert!(left < 0.1, "{left}");
    }

    /// A converter that rests on one step leaves a constant, which has no power in any octave; a start that dies out has its own.
    #[test]
    fn a_constant_has_no_octaves_and_a_start_has() {
        assert!(octaves(0, 1000, |_| 1.3e-7, 5e-5).iter().all(|octave| octave.power_m2 == 0.0));
        assert!([0, 1, 15].map(|rows| octaves(0, rows, |_| 1e-7, 5e-5).len()) == [0; 3]);
        let energy = |first: usize| {
            let dies_out = |k: usize| if k < first { 0.0 } else { (-0.0125 * (k - first) as f64).exp() };
            octaves(0, ROWS, dies_out, 5e-5).iter().map(|octave| octave.pairs * octave.power_m2).sum::<f64>() / 40.0
        };
        let (at_once, later) = (energy(0), energy(ROWS / 2));
        assert!((0.6..1.0).contains(&at_once) && (0.8..1.0).contains(&later), "{at_once} {later}");
    }

    #[test]
    fn flicker_is_noise_and_what_one_log_or_one_octave_has_is_not() {
        let slow: Vec<Vec<f64>> = (1..4).map(flicker).collect();
        let [all, worst] = beyond(|n, k| slow[n as usize][k]);
        assert!(all < 0.02 && worst < 0.06, "{all} {worst}");
        // A slower log has the same noise, and less of its slow part in each row's share.
        let steep: Vec<Vec<f64>> = (1..4).map(|n| steeper(n, 0.5)).collect();
        let [all, worst] = of_three_every(&[1, 1, 4], &|n, k| steep[n as usize][k], beyond_any_noise);
        assert!(all < 0.02 && worst < 0.06, "{all} {worst}");
        // A draw that stays for eight rows: flat in slow octaves, and ever less in fast ones.
        let held: Vec<Vec<f64>> = (1..4).map(white).collect();
        let [all, worst] = beyond(|n, k| 3.0 * held[n as usize][k / 8]);
        assert!(all < 0.02 && worst < 0.06, "{all} {worst}");
        // Behind a filter of second order.
        let filtered: Vec<Vec<f64>> = (0..3)
            .map(|n| {
                let (mut once, mut twice) = (0.0, 0.0);
                let step = |white: f64| {
                    once += (white - once) / 8.0;
                    twice += (once - twice) / 8.0;
                    9.0 * twice
                };
                white(50 + n).into_iter().map(step).collect()
            })
            .collect();
        let [all, worst] = beyond(|n, k| filtered[n as usize][k]);
        assert!(all < 0.05 && worst < 0.1, "{all} {worst}");
        let [all, worst] = beyond(|n, k| if n == 1 { slow[1][k] } else { 0.0 });
        assert!(all > 0.3 && worst > 0.3, "{all} {worst}");
        let [all, _] = beyond(|_, k| 5e-8 * (0.1 * k as f64).sin());
        assert!(all > 0.3, "{all}");
        let [all, _] = beyond(|n, k| 1e-7 * (k as f64 / ROWS as f64) * f64::from(n as u32));
        assert!(all > 0.3, "{all}");
    }
}
