//! The nominal plant refitted, from as many starts as it takes, and whether that leaves a gap.

use super::hypothesis::Freedom;
use super::search::{Candidate, Search, middle};
use super::symmetry::along;

/// Gap beyond the noise, in shares of the noise, below which there is none to speak of.
pub(super) const LEAST_GAP: f64 = 0.4;
/// The same of a single log: an effect may show in one experiment only.
const LEAST_GAP_OF_LOG: f64 = 0.5;
/// Shares of the noise's power, times the root of the rows, by which what is noise may seem more: the rows that a fit leaves vary, and so do the
/// differences that tell the noise.
const UNSURE_NOISE: f64 = 12.0;
/// Restarts of a refit that leaves a gap, and the mean square, in units of the noise, beyond which the gap is no local minimum's.
const RESTARTS: u64 = 4;
const LOCAL_MINIMUM: f64 = 400.0;
/// Squares of the numbers' shifts beyond which a refit may have bent them: a dozen numbers make a dozen, give or take five.
pub(super) const BENT_COST: f64 = 30.0;
/// Mean square, in units of the noise, up to which a fit counts as being at the noise: the noise is known to a few per cent.
pub(super) const AT_NOISE: f64 = 1.06;

/// The refit, from as many starts as it needs.
pub(super) fn refitted(search: &Search<'_>, freedom: Freedom) -> Candidate {
    let mut refit = search.refit(freedom);
    // Where the numbers belong: at nominal, or where a payload or a gain has put them.
    let mut home = nominal(search);
    if let Some(numbers) = along(search.bench, &refit.found).filter(|_| is_bent(&refit)) {
        refit = search.polish_from(refit, &numbers);
        // Starts that followed the wrong numbers for long lock their logs.
        if has_gap(&refit) {
            refit = search.resettled(refit, &numbers, &[]);
        }
        home = numbers;
    }
    // A first refit ends in a local minimum now and then, most often a little above the noise, or with numbers bent: hysterons forget
    // nothing, so that dead zones and capacitances lock one another.
    for attempt in 0..RESTARTS {
        let has_gap = has_gap(&refit);
        if !(has_gap || is_bent(&refit)) || refit.chi > LOCAL_MINIMUM {
            break;
        }
        // At the noise only the numbers are wrong.
        refit = match attempt {
            0 if !has_gap => come_home(search, refit, &home),
            0 => search.settled_at(refit, &home),
            _ => search.refit_elsewhere(refit, &home, attempt),
        };
    }
    if has_gap(&refit) { refitted_in_parts(search, refit) } else { refit }
}

/// A refit that leaves a gap, or numbers that no plant has, again from where all logs but one lead, if these show none: a start that was led astray
/// bends the numbers of all logs until no start of its own log finds a way back. The log that is fitted worst is the first to be left out. The best of all.
pub(super) fn led_without_one(search: &Search<'_>, mut refit: Candidate) -> Candidate {
    let bench = search.bench;
    let mut order: Vec<usize> = (0..refit.chis.len()).collect();
    order.sort_by(|a, b| refit.chis[*b].total_cmp(&refit.chis[*a]));
    let are_enough = order.len() > 2;
    for one in order.into_iter().filter(|_| are_enough) {
        let others = bench.without(one);
        let found = Search { bench: &others, ..*search }.refit(refit.hypothesis.freedom);
        if has_gap(&found) {
            continue;
        }
        refit = come_home(search, search.joined(refit, &found, one), &nominal(search));
        if !has_gap(&refit) && !is_bent(&refit) {
            break;
        }
    }
    refit
}

/// A refit that leaves a gap in few logs again, from where the worst of them and each of the others in turn end together: logs lock one another
/// now and then, though each could be fitted. The best of all.
fn refitted_in_parts(search: &Search<'_>, mut refit: Candidate) -> Candidate {
    let bench = search.bench;
    let chis = &refit.chis;
    let Some(worst) = (0..chis.len()).max_by(|a, b| chis[*a].total_cmp(&chis[*b])) else { return refit };
    if middle(chis) > AT_NOISE || chis.len() < 3 {
        return refit;
    }
    for other in (0..chis.len()).filter(|index| *index != worst) {
        let logs = [worst, other];
        let part = bench.part(logs.map(|index| bench.records[index].clone()).to_vec());
        let found = refitted(&Search { bench: &part, ..*search }, refit.hypothesis.freedom);
        if has_gap(&found) {
            continue;
        }
        refit = search.resettled(refit, &found.found.z, &logs);
        if !has_gap(&refit) {
            return come_home(search, refit, &nominal(search));
        }
    }
    refit
}

/// A fit at the noise, its numbers asked to come `home` if they have wandered: alone, then with starts that settle there.
pub(super) fn come_home(search: &Search<'_>, fit: Candidate, home: &[f64]) -> Candidate {
    if has_gap(&fit) || !is_bent(&fit) {
        return fit;
    }
    let fit = search.unbent(fit, home);
    if is_bent(&fit) { search.settled_at(fit, home) } else { fit }
}

/// The numbers as the plant's file has them.
pub(super) fn nominal(search: &Search<'_>) -> Vec<f64> {
    vec![0.0; search.bench.free.len()]
}

/// Whether the numbers have shifted as those of no plant do.
pub(super) fn is_bent(refit: &Candidate) -> bool {
    refit.found.prior_cost > BENT_COST
}

pub(super) fn has_gap(refit: &Candidate) -> bool {
    gap_over_least(refit) > 1.0
}

/// Gap that `refit` leaves, as amplitude, over the least to speak of, in all logs together or in that which shows most.
pub(super) fn gap_over_least(refit: &Candidate) -> f64 {
    let over = |chi: f64, rows: usize, least: f64| {
        let least2 = (least * least).max(UNSURE_NOISE / (rows.max(1) as f64).sqrt());
        ((chi - 1.0).max(0.0) / least2).sqrt()
    };
    let of_logs =
        refit.chis.iter().zip(&refit.found.normal.logs).map(|(chi, log)| over(*chi, log.rows, LEAST_GAP_OF_LOG));
    of_logs.fold(over(refit.chi, refit.rows(), LEAST_GAP), f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::bench::Bench;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::{Hold, Log};
    use plant_sim::replay::{Start, predict};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;
    use std::f64::consts::TAU;
    use std::sync::atomic::AtomicUsize;

    const NOISE_M: f64 = 20e-9;

    /// Logs of the thesis' plant with noise, on a lattice of `step_m` if it is not zero, with a wave of `wave_m` in them.
    fn has_gap_with(logs: usize, rows: usize, step_m: f64, wave_m: f64, seed: u64) -> bool {
        let model = thesis();
        let chain = model.chain();
        let mut random = Pcg64::seed_from_u64(seed);
        let mut log = |index: usize| {
            let hz = 20.0 + 15.0 * index as f64;
            let command_v = (0..rows).map(|k| 50.0 * (TAU * hz * (k.saturating_sub(60)) as f64 * 5e-5).sin()).collect();
            let mut log = Log { dt_s: 5e-5, command_v, displacement_m: vec![0.0; rows], ..Log::default() };
            log.meta.hold = Hold::Zoh;
            log.displacement_m = predict(&chain, &log, &Start::at_rest(&chain, 0.0, vec![0.0; 2]), rows);
            for (k, y) in log.displacement_m.iter_mut().enumerate() {
                // Four uniform numbers are as good as normal.
                let normal = (0..4).map(|_| random.random_range(-1.0..1.0)).sum::<f64>() * 0.75f64.sqrt();
                *y += NOISE_M * normal + wave_m * (TAU * 333.0 * k as f64 * 5e-5).sin();
                if step_m > 0.0 {
                    *y = (*y / step_m).round() * step_m;
                }
            }
            log
        };
        let logs: Vec<Log> = (0..logs).map(&mut log).collect();
        let bench = Bench::new(&model, logs.iter().map(|log| record(log, &chain, None)).collect());
        has_gap(&Search { bench: &bench, simulations: &AtomicUsize::new(0) }.refit(Freedom::Rest))
    }

    #[test]
    fn short_logs_are_told_no_gap_by_their_noise() {
        let gaps = |wave_m: f64| (0..20).filter(|seed| has_gap_with(5, 400, 0.0, wave_m, *seed)).count();
        assert!(gaps(0.0) <= 1 && gaps(2.0 * NOISE_M) == 20, "{} {}", gaps(0.0), gaps(2.0 * NOISE_M));
    }

    /// Noise that is as large as half a converter's step makes its rounding noise: a gap of the noise's size shows as without one.
    #[test]
    fn rounding_that_noise_dithers_hides_no_gap() {
        for step_m in [0.0, 24e-9, 30e-9, 40e-9] {
            let gaps = |wave_m: f64| (0..6).filter(|seed| has_gap_with(2, 4000, step_m, wave_m, *seed)).count();
            assert_eq!((gaps(0.0), gaps(1.4 * NOISE_M)), (0, 6), "step of {step_m:e} m");
        }
    }
}
