//! Errors that repeat over the displacement or over the command, as an encoder's or a converter's do: the periods at which what a plant
//! leaves holds power over the place, not over time.

use super::bench::{Bench, extremes};
use super::events::pulse;
use super::lines::peaks;
use super::search::{Remainder, after_run_in};
use realfft::RealFftPlanner;

/// Places into which the range is cut.
const PLACES: usize = 1 << 15;
/// Zero-padding, so that a period between two bins is not missed.
const PADDING: usize = 4;
/// Places over which a running mean is taken off, as a share of all: what is slower is a curve and no cycle.
const CURVE: f64 = 0.05;
/// A period stands this far above the median power of its neighbourhood.
const PROMINENCE: f64 = 30.0;
/// Neighbourhood in bins to each side.
const NEIGHBOURS: usize = 120;
/// Most periods that are reported.
const MOST: usize = 2;
/// Fewest and most periods over the range.
const FEWEST: f64 = 6.0;
const MOST_PERIODS: f64 = 0.125 * PLACES as f64;

/// Periods over the predicted displacement in metres, strongest first.
pub fn over_displacement(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let points = || {
        after_run_in(bench, remainders).flat_map(|(record, residual_m)| {
            let read_m = record.log.displacement_m[record.run_in..].iter();
            read_m.zip(residual_m).map(|(y, r)| (y - r, r / record.noise_m))
        })
    };
    periods(extremes(points().map(|(at_m, _)| at_m)), points())
}

/// Periods over the command in volts, strongest first.
pub fn over_command(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let range_v = extremes(bench.records.iter().flat_map(|r| r.log.command_v[r.run_in..].iter().copied()));
    // What a command does comes late and rings on: what is left is gathered along the plant's answer to each.
    let chain = bench.model.chain();
    let gathered = after_run_in(bench, remainders).flat_map(|(record, residual_m)| {
        let answer_m = pulse(&chain, record.log.dt_s, record.log.meta.latency_s);
        answer_m.into_iter().flat_map(move |answer_m| {
            let unit_m2 = record.noise_m * answer_m.iter().map(|h| h * h).sum::<f64>().sqrt();
            let along =
                move |k: usize| residual_m[k..].iter().zip(&answer_m).map(|(r, h)| r * h).sum::<f64>() / unit_m2;
            record.log.command_v[record.run_in..].iter().enumerate().map(move |(k, u)| (*u, along(k)))
        })
    });
    let found = periods(range_v, gathered);
    if !found.is_empty() {
        return found;
    }
    // Where commands are slow, what acted last is what is seen.
    let last = after_run_in(bench, remainders).flat_map(|(record, residual_m)| {
        let acted = |k: usize| record.log.command_v[(record.run_in + k).saturating_sub(1)];
        residual_m.iter().enumerate().map(move |(k, r)| (acted(k), r / record.noise_m))
    });
    periods(range_v, last)
}

/// Periods of the second of each of the `points` over the first, its place within `low` and `high`; the second is in units of its noise.
fn periods([low, high]: [f64; 2], points: impl Iterator<Item = (f64, f64)>) -> Vec<f64> {
    let width = (high - low) / PLACES as f64;
    if !(width > 0.0 && width.is_finite()) {
        return Vec::new();
    }
    let mut sums = vec![(0.0, 0.0); PLACES];
    for (at, value) in points {
        let sum = &mut sums[(((at - low) / width) as usize).min(PLACES - 1)];
        *sum = (sum.0 + value, sum.1 + 1.0);
    }
    let power = power(&uncurved(&sums));
    let [fewest, most] = [FEWEST, MOST_PERIODS].map(|periods| (periods * PADDING as f64) as usize);
    let peaks = peaks(&power, fewest..most.min(power.len() - 2), NEIGHBOURS, PROMINENCE).into_iter().take(MOST);
    let period = |bin: usize| {
        // The vertex of the parabola through three bins.
        let [before, here, after] = [power[bin - 1], power[bin], power[bin + 1]];
        let shift = 0.5 * (before - after) / (before - 2.0 * here + after).min(-1e-300);
        PADDING as f64 * (high - low) / (bin as f64 + shift)
    };
    peaks.map(period).collect()
}

/// Sum over each place less its running mean; a place that dwells a thousand times counts no more than the usual one does.
fn uncurved(sums: &[(f64, f64)]) -> Vec<f64> {
    let visited = sums.iter().filter(|sum| sum.1 > 0.0).count().max(1) as f64;
    let usual = sums.iter().map(|sum| sum.1).sum::<f64>() / visited;
    let half = ((0.5 * CURVE * sums.len() as f64) as usize).max(1);
    let weighted: Vec<(f64, f64)> = sums
        .iter()
        .map(|&(sum, count)| {
            let weight = count.min(usual);
            (if count > 0.0 { weight * sum / count } else { 0.0 }, weight)
        })
        .collect();
    let mut total = vec![(0.0, 0.0)];
    for (at, &(sum, weight)) in weighted.iter().enumerate() {
        total.push((total[at].0 + sum, total[at].1 + weight));
    }
    let last = sums.len();
    weighted
        .iter()
        .enumerate()
        .map(|(at, &(sum, weight))| {
            let (from, to) = (at.saturating_sub(half), (at + half + 1).min(last));
            let (around, weights) = (total[to].0 - total[from].0, total[to].1 - total[from].1);
            let hann = 0.5 - 0.5 * (std::f64::consts::TAU * at as f64 / last as f64).cos();
            hann * (sum - weight * around / weights.max(1.0))
        })
        .collect()
}

fn power(values: &[f64]) -> Vec<f64> {
    let mut padded = values.to_vec();
    padded.resize(PADDING * values.len(), 0.0);
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(padded.len());
    let mut out = fft.make_output_vec();
    match fft.process(&mut padded, &mut out) {
        Ok(()) => out.iter().map(|c| c.norm_sqr()).collect(),
        Err(_) => vec![0.0; out.len()],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::chain::{Chain, Drive};
    use plant_sim::log::{Hold, Log};
    use plant_sim::replay::{Start, predict};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// Periods over displacement and over command of what is left where `error` is made of them, with 30 nm of noise.
    fn found(error: impl Fn(f64, f64) -> f64) -> [Vec<f64>; 2] {
        let model = thesis();
        let mut random = Pcg64::seed_from_u64(3);
        let rows = 40_000;
        // A loop: the displacement isn't a function of the command.
        let command_v: Vec<f64> = (0..rows).map(|k| 55.0 * (1.7e-3 * f64::from(k)).sin()).collect();
        let true_m = (0..rows).map(|k| 1.05e-4 * (1.7e-3 * f64::from(k) - 0.15).sin());
        let residual_m: Vec<f64> = true_m
            .clone()
            .zip(&command_v)
            .map(|(q, u)| error(q, *u) + 30e-9 * random.random_range(-1.7..1.7))
            .collect();
        let displacement_m = true_m.zip(&residual_m).map(|(q, r)| q + r).collect();
        let log = Log { dt_s: 5e-5, displacement_m, command_v, ..Log::default() };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let remainders = [Remainder { velocity_m_per_s: vec![0.0; residual_m.len()], residual_m }];
        [over_displacement(&bench, &remainders), over_command(&bench, &remainders)]
    }

    #[test]
    fn a_cycle_is_found_where_it_repeats_and_nowhere_else() {
        let turns = std::f64::consts::TAU / 0.633e-6;
        let [metres, volts] = found(|q, _| 8e-9 * (turns * q).sin());
        assert!((metres[0] / 0.633e-6 - 1.0).abs() < 2e-4, "{metres:?}");
        assert!(volts.is_empty(), "{volts:?}");
    }

    #[test]
    fn the_stairs_of_a_converter_are_found_over_what_it_converts() {
        let step_v = 0.0293;
        let stairs = |u: f64| 1.9e-6 * ((u / step_v).round() * step_v - u);
        let [_, volts] = found(|_, u| stairs(u));
        assert!((volts[0] / step_v - 1.0).abs() < 2e-4, "{volts:?}");
        let step_m = 0.11e-6;
        let [metres, _] = found(|q, _| (q / step_m).round() * step_m - q);
        assert!((metres[0] / step_m - 1.0).abs() < 2e-4, "{metres:?}");
    }

    #[test]
    fn the_stairs_are_found_through_the_plant_where_every_command_crosses_many() {
        let model = thesis();
        let chain = model.chain();
        let mut random = Pcg64::seed_from_u64(4);
        let step_v = 0.25;
        let command_v: Vec<f64> = (0..40_000).map(|k| 55.0 * (0.11 * f64::from(k)).sin()).collect();
        let mut log = Log { dt_s: 5e-5, displacement_m: vec![0.0; command_v.len()], command_v, ..Log::default() };
        log.meta.hold = Hold::Zoh;
        let coarse = Chain { drive: Drive { quantum_v: step_v, ..Drive::IDEAL }, ..chain.clone() };
        let [fine_m, coarse_m] = [&chain, &coarse].map(|chain| predict(chain, &log, &Start::relaxed(chain), log.len()));
        let residual_m: Vec<f64> =
            coarse_m.iter().zip(&fine_m).map(|(y, p)| y - p + 10e-9 * random.random_range(-1.7..1.7)).collect();
        log.displacement_m = fine_m.iter().zip(&residual_m).map(|(p, r)| p + r).collect();
        let bench = Bench::new(&model, vec![record(&log, &chain, None)]);
        let remainders = [Remainder { velocity_m_per_s: vec![0.0; residual_m.len()], residual_m }];
        let volts = over_command(&bench, &remainders);
        // A fifth of a period over the whole range: near enough for a fit to follow.
        assert!((volts[0] / step_v - 1.0).abs() < 0.2 * step_v / 110.0, "{volts:?}");
    }

    #[test]
    fn a_bend_and_noise_have_no_period() {
        assert_eq!(found(|q, _| 20.0 * q * q - 1e3 * q.abs().powi(3)), [Vec::<f64>::new(), Vec::new()]);
        assert_eq!(found(|_, _| 0.0), [Vec::<f64>::new(), Vec::new()]);
    }
}
