//! Whether a residual is noise, told by the power of its octaves: noise of a sensor has the same in every log, whatever the plant does, and it
//! falls smoothly with frequency, as `a + b / f^n` (`a`: white, `b / f`: flicker). What a wrong model leaves does neither.

use super::bench::Bench;
use super::search::{Remainder, after_run_in};
use std::borrow::Cow;

/// Least number of pairs of stretches from which an octave's power is read.
const LEAST_PAIRS: usize = 8;
/// Relative spread of an octave's power that is no sign of anything: the refit takes some of it.
const TOLERANCE: f64 = 0.15;
/// Sigmas that the power of an octave may be off by.
const SIGMAS: f64 = 2.0;
/// Steepest fall: beyond it is a drift, whose steps add up.
const STEEPEST: f64 = 1.6;
/// Falls that are tried, and shares of the slowest octave's power that white noise makes, each smaller by this factor.
const FALLS: usize = 17;
const WHITE_SHARES: i32 = 40;
const SMALLER: f64 = 0.75;

/// Power of a log in one octave.
#[derive(Clone, Copy, Debug)]
struct Octave {
    log: usize,
    /// Stretches of 2^level rows are compared with the next ones.
    level: i32,
    /// Number of such pairs.
    pairs: f64,
    /// Mean square, scaled so that white noise has its variance in each octave, metres squared.
    power_m2: f64,
}

impl Octave {
    /// Relative sigma of the power, if the residual is normal.
    fn spread(&self) -> f64 {
        (2.0 / self.pairs).sqrt().hypot(TOLERANCE)
    }
}

/// Fraction of the power beyond the noise, in all logs and in the log where it is most, that no noise of the kind has which fits all logs' octaves
/// best. One where there is nothing beyond the noise.
pub(super) fn beyond_any_noise(bench: &Bench<'_>, remainders: &[Remainder]) -> [f64; 2] {
    let logs: Vec<&[f64]> = after_run_in(bench, remainders).map(|(_, residual_m)| residual_m).collect();
    let octaves: Vec<Octave> = logs.iter().enumerate().flat_map(|(log, residual_m)| octaves(log, residual_m)).collect();
    let Some(noise_m2) = smooth(&octaves) else { return [1.0; 2] };
    let mut excess = vec![0.0; logs.len()];
    let mut beyond = vec![0.0; logs.len()];
    for octave in &octaves {
        let noise2 = bench.records[octave.log].noise_m.powi(2);
        let expected = noise_m2(octave.level);
        let allowed = SIGMAS * octave.spread() * expected;
        excess[octave.log] += octave.pairs * (octave.power_m2 - noise2);
        beyond[octave.log] += octave.pairs * ((octave.power_m2 - expected).abs() - allowed).max(0.0);
    }
    let share = |beyond: f64, excess: f64| if excess > 0.0 { (beyond / excess).min(1.0) } else { 1.0 };
    let worst = beyond.iter().zip(&excess).filter(|(_, excess)| **excess > 0.0).map(|(b, e)| share(*b, *e));
    [share(beyond.iter().sum(), excess.iter().sum()), worst.fold(0.0, f64::max)]
}

/// Powers of a log's octaves, fastest first: mean squares of its Haar wavelets.
fn octaves(log: usize, residual_m: &[f64]) -> Vec<Octave> {
    let mut sums = Cow::Borrowed(residual_m);
    let mut octaves = Vec::new();
    for level in 0.. {
        let pairs = sums.len() / 2;
        if pairs < LEAST_PAIRS {
            break;
        }
        let scale = 0.5 / f64::from(1u32 << level);
        let power_m2 = sums.chunks_exact(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>() * scale / pairs as f64;
        octaves.push(Octave { log, level, pairs: pairs as f64, power_m2 });
        sums = sums.chunks_exact(2).map(|pair| pair[0] + pair[1]).collect();
    }
    octaves
}

/// Power over level of the noise that fits best: white, and a part that grows by 2^n with every octave towards slow ones. None without octaves.
fn smooth(octaves: &[Octave]) -> Option<impl Fn(i32) -> f64 + use<>> {
    let slowest = octaves.iter().map(|octave| octave.level).max()?;
    let shape =
        move |fall: f64, white: f64, level: i32| white + (1.0 - white) * (fall * f64::from(level - slowest)).exp2();
    let mut best = (f64::INFINITY, 0.0, 1.0, 1.0);
    for step in 0..FALLS {
        let fall = STEEPEST * step as f64 / (FALLS - 1) as f64;
        for share in 0..WHITE_SHARES {
            let white = SMALLER.powi(share);
            let logs = || {
                octaves.iter().filter(|octave| octave.power_m2 > 0.0).map(|octave| {
                    let ratio = octave.power_m2 / shape(fall, white, octave.level);
                    // The logarithm of a mean square of few squares comes out below that of its expectation.
                    (ratio.ln() + 1.0 / octave.pairs, octave.spread().powi(-2))
                })
            };
            let weights: f64 = logs().map(|(_, weight)| weight).sum();
            let mean = logs().map(|(log, weight)| weight * log).sum::<f64>() / weights;
            let misfit: f64 = logs().map(|(log, weight)| weight * (log - mean).powi(2)).sum();
            if misfit < best.0 {
                best = (misfit, fall, white, mean.exp());
            }
        }
    }
    let (misfit, fall, white, size) = best;
    misfit.is_finite().then_some(move |level: i32| size * shape(fall, white, level))
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
        let mut sum = vec![0.0; ROWS];
        for octave in 0..10 {
            let keep = (-1.0 / f64::from(1 << octave)).exp();
            let mut slow = 0.0;
            for (sum, white) in sum.iter_mut().zip(white(100 * seed + octave)) {
                slow = keep * slow + (1.0 - keep * keep).sqrt() * white;
                *sum += slow;
            }
        }
        sum
    }

    /// What is beyond any noise of three logs with white noise, and `more` in each.
    fn beyond(more: impl Fn(u64, usize) -> f64) -> [f64; 2] {
        let model = thesis();
        let log = |n| Log { dt_s: 5e-5, command_v: vec![0.0; ROWS], displacement_m: white(n), ..Log::default() };
        let logs = [log(1), log(2), log(3)];
        let bench = Bench::new(&model, logs.iter().map(|log| record(log, &model.chain(), None)).collect());
        let remainders: Vec<Remainder> = (0..3)
            .map(|n| {
                let residual_m = white(n + 1).iter().enumerate().map(|(k, white)| white + more(n, k)).collect();
                Remainder { velocity_m_per_s: vec![0.0; ROWS], residual_m }
            })
            .collect();
        beyond_any_noise(&bench, &remainders)
    }

    #[test]
    fn flicker_is_noise_and_what_one_log_or_one_octave_has_is_not() {
        let slow: Vec<Vec<f64>> = (1..4).map(flicker).collect();
        let [all, worst] = beyond(|n, k| slow[n as usize][k]);
        assert!(all < 0.02 && worst < 0.06, "{all} {worst}");
        let [all, worst] = beyond(|n, k| if n == 1 { slow[1][k] } else { 0.0 });
        assert!(all > 0.3 && worst > 0.3, "{all} {worst}");
        let [all, _] = beyond(|_, k| 5e-8 * (0.1 * k as f64).sin());
        assert!(all > 0.3, "{all}");
        let [all, _] = beyond(|n, k| 1e-7 * (k as f64 / ROWS as f64) * f64::from(n as u32));
        assert!(all > 0.3, "{all}");
    }
}
