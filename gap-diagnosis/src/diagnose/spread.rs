//! Effects that no simulation predicts, read from how the residual scatters: jitter, noise, repeated readings, a converter's lattice.

use super::bench::Bench;
use super::octaves::beyond_any_noise;
use super::search::{Remainder, after_run_in};
use crate::spectra::repeats;

/// Bins of equal population over the squared velocity, and over the squared displacement.
const BINS: usize = 24;
/// Stretches of a log whose power is compared.
const STRETCHES: usize = 10;
/// Neighbours that a line is put through at the most, evenly out of all: a million tell a slope to a thousandth, and ten minutes have twelve.
const MOST_NEIGHBOURS: usize = 1_000_000;

/// Rows over which an error of the instants may wander, and the share of its variance below which it has been forgotten.
const LAGS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
const FORGOTTEN: f64 = 0.1;

/// Power of neighbours' differences at standstill that may be noise, in units of the noise's: beyond it is what no error of the instants makes.
const NOISE_AT_REST: f64 = 2.0;

/// Least excess in stretches that repeat themselves, in shares of the noise's power, of which it is asked whether it comes back.
const TOLD: f64 = 0.1;

/// How much of the excess power each kind of scatter accounts for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scattered {
    /// Power beyond the noise, metres squared, over all rows after the run-ins.
    pub excess_m2: f64,
    /// Rms error of the sampling instants in seconds, its standard error, and the power it accounts for.
    pub jitter_s: f64,
    /// See `jitter_s`.
    pub jitter_sigma_s: f64,
    /// See `jitter_s`.
    pub jitter_m2: f64,
    /// Power beyond that of the noise at standstill, the line's foot where that may be noise: what jitter has to account for.
    pub moving_m2: f64,
    /// Rows that repeat the one before, as a share, and the power of the residual in them.
    pub repeated_share: f64,
    /// See `repeated_share`.
    pub repeated_m2: f64,
    /// Relative spread of the excess power over the stretches of all logs; noise has the same everywhere.
    pub unevenness: f64,
    /// Share of the excess power that no noise has whose octaves are alike in all logs, in all and in the worst.
    pub beyond_any_noise: [f64; 2],
    /// Share of the excess power that comes back with the command where that repeats itself, which nothing random does; zero where it doesn't.
    pub returning: f64,
    /// Relative noise per displacement and the power it accounts for: no entry of the registry, but a rival of jitter.
    pub multiplied_m2: f64,
}

/// Reads the scatter of all logs together. What an effect leaves because its form is wrong may look like instants whose error wanders: only where
/// nothing is installed `may_wander` be true.
pub fn scattered(bench: &Bench<'_>, remainders: &[Remainder], may_wander: bool) -> Scattered {
    let mut rows = 0usize;
    let (mut squares, mut noise) = (0.0, 0.0);
    let mut repeats = (0usize, 0.0);
    let mut stretches = Vec::new();
    let mut by_velocity = Vec::new();
    let mut by_displacement = Vec::new();
    let all_rows: usize = bench.records.iter().map(|record| record.log.len()).sum();
    let stride = all_rows.div_ceil(MOST_NEIGHBOURS).max(1);
    let lag = if may_wander { forgotten_after(bench, remainders) } else { 1 };
    for (record, log) in bench.records.iter().zip(remainders) {
        let y = &record.log.displacement_m;
        let noise2 = record.noise_m * record.noise_m;
        let fitted = record.run_in.max(1)..y.len();
        let count = fitted.len();
        rows += count;
        for k in fitted.clone() {
            let square = log.residual_m[k].powi(2);
            if record.has_lost(k) {
                repeats.0 += 1;
                repeats.1 += square - noise2;
            } else {
                squares += square;
                noise += noise2;
            }
        }
        let length = (count / STRETCHES).max(1);
        for stretch in 0..(y.len() - record.run_in) / length {
            let from = record.run_in + stretch * length;
            let kept = || (from..from + length).filter(|k| !record.has_lost(*k));
            let mean2 = kept().map(|k| log.residual_m[k].powi(2)).sum::<f64>() / kept().count().max(1) as f64;
            stretches.push((mean2 - noise2).max(0.0));
        }
        for k in fitted.step_by(stride) {
            if k < record.run_in + lag || record.has_lost(k) || record.has_lost(k - lag) {
                continue;
            }
            // Half the squared difference of neighbours, or of rows between which the instants' error is forgotten: what is slow drops out.
            let half = 0.5 * (log.residual_m[k] - log.residual_m[k - lag]).powi(2);
            let v2 = 0.5 * (log.velocity_m_per_s[k].powi(2) + log.velocity_m_per_s[k - lag].powi(2));
            by_velocity.push((v2, half));
            by_displacement.push((y[k] * y[k], half));
        }
    }
    let count = rows.max(1) as f64;
    let kept = (count - repeats.0 as f64).max(1.0);
    let (slope, slope_sigma, foot) = slope(&mut by_velocity);
    let mean_v2 = by_velocity.iter().map(|p| p.0).sum::<f64>() / by_velocity.len().max(1) as f64;
    // What the plant states of its instants is no news.
    let stated = bench.stated_jitter_s().powi(2);
    let (slope, foot) = (slope - stated, foot + stated * mean_v2);
    let (multiplied, _, _) = self::slope(&mut by_displacement);
    let mean_y2 = by_displacement.iter().map(|p| p.0).sum::<f64>() / by_displacement.len().max(1) as f64;
    let mean = stretches.iter().sum::<f64>() / stretches.len().max(1) as f64;
    let variance = stretches.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / stretches.len().max(1) as f64;
    Scattered {
        excess_m2: (squares - noise) / count,
        jitter_s: slope.max(0.0).sqrt(),
        jitter_sigma_s: 0.5 * slope_sigma / slope.max(slope_sigma).sqrt(),
        jitter_m2: slope.max(0.0) * mean_v2,
        moving_m2: squares / kept - foot.min(NOISE_AT_REST * noise / kept),
        repeated_share: repeats.0 as f64 / count,
        repeated_m2: f64::max(repeats.1, 0.0) / count,
        returning: returning(bench, remainders),
        beyond_any_noise: beyond_any_noise(bench, remainders),
        unevenness: if mean > 0.0 { variance.sqrt() / mean } else { 0.0 },
        multiplied_m2: multiplied.max(0.0) * mean_y2,
    }
}

/// Share of the excess power that is the same whenever a command repeats itself, over all periods but each stretch's first.
fn returning(bench: &Bench<'_>, remainders: &[Remainder]) -> f64 {
    let (mut products, mut excess, mut noise) = (0.0, 0.0, 0.0);
    for (record, residual_m) in after_run_in(bench, remainders) {
        let noise2 = record.noise_m.powi(2);
        let command_v = &record.log.command_v[record.run_in..];
        for stretch in repeats(command_v, record.log.meta.period_samples) {
            let period = stretch.period_samples;
            let end = stretch.start + stretch.n_periods * period;
            for k in stretch.start + period..end {
                let (now, before) = (residual_m[k], residual_m[k - period]);
                products += now * before;
                excess += 0.5 * (now * now + before * before) - noise2;
                noise += noise2;
            }
        }
    }
    if excess > TOLD * noise { (products / excess).clamp(0.0, 1.0) } else { 0.0 }
}

/// Rows after which an error of the sampling instants is forgotten: one, where it is another one in every row, or where it never is.
fn forgotten_after(bench: &Bench<'_>, remainders: &[Remainder]) -> usize {
    // The residual is velocity times error, so that products of both tell the error's covariance, in seconds squared.
    let covariance_s2 = |lag: usize| {
        let (mut products, mut weights) = (0.0, 0.0);
        for (record, log) in bench.records.iter().zip(remainders) {
            let noise2 = if lag == 0 { record.noise_m.powi(2) } else { 0.0 };
            let (r, v) = (&log.residual_m, &log.velocity_m_per_s);
            for k in record.run_in + lag..r.len() {
                if record.has_lost(k) || record.has_lost(k - lag) {
                    continue;
                }
                let both = v[k] * v[k - lag];
                products += (r[k] * r[k - lag] - noise2) * both;
                weights += both * both;
            }
        }
        products / weights.max(f64::MIN_POSITIVE)
    };
    let whole_s2 = covariance_s2(0);
    let is_kept = LAGS.map(|lag| covariance_s2(lag).abs() > FORGOTTEN * whole_s2);
    match is_kept.iter().rposition(|kept| *kept) {
        Some(last) if last + 1 < LAGS.len() && whole_s2 > 0.0 => LAGS[last + 1],
        _ => 1,
    }
}

/// Slope of the variance over `x` with its standard error, and the line's foot. Pairs of `x` and half a squared difference of neighbours.
fn slope(pairs: &mut [(f64, f64)]) -> (f64, f64, f64) {
    if pairs.len() < 10 * BINS {
        return (0.0, f64::INFINITY, 0.0);
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    // What is an outlier is told against the line, or the fast rows of a bin would be.
    let (slope, _, foot) = line(pairs, |_| 1.0);
    line(pairs, |x| (foot + slope * x).max(f64::MIN_POSITIVE))
}

/// The line of [`slope`] through bins of equal population, weighted, whose means leave out the hundredth that is largest against what is `expected`.
fn line(pairs: &[(f64, f64)], expected: impl Fn(f64) -> f64) -> (f64, f64, f64) {
    // A one-sided trim of squared normals at 1 % leaves 92.5 % of their mean.
    let kept_mean = 0.925;
    let bins: Vec<(f64, f64, f64)> = pairs
        .chunks(pairs.len().div_ceil(BINS))
        .map(|bin| {
            let mut bin = bin.to_vec();
            bin.sort_by(|a, b| (a.1 / expected(a.0)).total_cmp(&(b.1 / expected(b.0))));
            bin.truncate((bin.len() * 99 / 100).max(1));
            let mean = |of: fn(&(f64, f64)) -> f64| bin.iter().map(of).sum::<f64>() / bin.len() as f64;
            let y = mean(|pair| pair.1) / kept_mean;
            // Each row is in two differences, which are a half alike and their squares a quarter: three halves of the variance of as many apart.
            (mean(|pair| pair.0), y, y * (3.0 / bin.len() as f64).sqrt())
        })
        // Readings of a converter that stands differ by nothing: no noise is that small, and they know no line.
        .filter(|(_, y, _)| *y > 0.0)
        .collect();
    let weight = |sigma: f64| 1.0 / (sigma * sigma).max(f64::MIN_POSITIVE);
    let (mut s, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for &(x, y, sigma) in &bins {
        let w = weight(sigma);
        s += w;
        sx += w * x;
        sy += w * y;
        sxx += w * x * x;
        sxy += w * x * y;
    }
    let determinant = s * sxx - sx * sx;
    if !(determinant > 0.0 && determinant.is_finite()) {
        return (0.0, f64::INFINITY, 0.0);
    }
    ((s * sxy - sx * sy) / determinant, (s / determinant).sqrt(), (sxx * sy - sx * sxy) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    #[test]
    fn only_what_is_the_same_in_every_period_returns() {
        let model = thesis();
        let (period, periods) = (400, 4);
        let wave = |k: usize| (std::f64::consts::TAU * k as f64 / period as f64).sin();
        let rows = 100 + period * periods;
        let moves = |k: usize| if k < 100 { 0.0 } else { 20.0 * wave(k - 100) };
        let mut log = Log { dt_s: 5e-5, command_v: (0..rows).map(moves).collect(), ..Log::default() };
        let mut random = Pcg64::seed_from_u64(5);
        let noise_m: Vec<f64> = (0..rows).map(|_| 2e-8 * random.random_range(-1.0..1.0)).collect();
        log.displacement_m = noise_m.clone();
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let share = |of_period: f64, of_row: f64| {
            let mut random = Pcg64::seed_from_u64(6);
            let mut left = |k: usize| {
                noise_m[k]
                    + of_period * wave(3 * k)
                    + of_row * random.random_range(-1.0..1.0) * f64::from(u8::from(k > 99))
            };
            let residual_m: Vec<f64> = (0..rows).map(&mut left).collect();
            returning(&bench, &[Remainder { velocity_m_per_s: vec![0.0; rows], residual_m }])
        };
        let (same, other, none) = (share(2e-7, 0.0), share(0.0, 3e-7), share(0.0, 0.0));
        assert!(same > 0.95 && other < 0.1 && none == 0.0, "{same} {other} {none}");
        // As much of either: 2e-7^2 / 2 against 3e-7^2 / 3.
        let both = share(2e-7, 3e-7);
        assert!((both - 0.4).abs() < 0.1, "{both}");
    }

    /// A reading that stayed where it was is off by the whole way of a row: neither it nor what follows tells of the instants.
    #[test]
    fn jitter_is_told_beside_rows_that_were_lost() {
        const JITTER_S: f64 = 5e-6;
        let (model, rows, dt_s) = (thesis(), 40_000, 5e-5);
        let mut random = Pcg64::seed_from_u64(8);
        let mut draw = || random.sample::<f64, _>(StandardNormal);
        let speed = |k: usize| 2e-2 * (3e-3 * k as f64).sin();
        let is_lost: Vec<bool> = (0..rows).map(|k| k % 33 == 5).collect();
        let residual_m = (0..rows).map(|k| {
            let late_s = if is_lost[k] { dt_s } else { JITTER_S * draw() };
            2e-8 * draw() + late_s * speed(k)
        });
        let left = [Remainder { residual_m: residual_m.collect(), velocity_m_per_s: (0..rows).map(speed).collect() }];
        let log = Log { dt_s, command_v: vec![0.0; rows], displacement_m: vec![0.0; rows], ..Log::default() };
        let mut bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        bench.records[0] = crate::diagnose::bench::Record { noise_m: 2e-8, is_lost, ..bench.records[0].clone() };
        let found = scattered(&bench, &left, false);
        assert!((found.jitter_s / JITTER_S - 1.0).abs() < 0.05, "{:e}", found.jitter_s);
        // It accounts for all that moves.
        assert!((found.jitter_m2 / found.moving_m2 - 1.0).abs() < 0.1, "{found:?}");
    }

    /// What is as large at standstill as while the plant moves is none of the instants' errors, though a line may rise with the velocity as well.
    #[test]
    fn what_stays_at_rest_is_nothing_that_jitter_accounts_for() {
        const JITTER_S: f64 = 5e-6;
        let (model, rows, dt_s) = (thesis(), 40_000, 5e-5);
        let speed = |k: usize| 2e-2 * (3e-3 * k as f64).sin();
        let log = Log { dt_s, command_v: vec![0.0; rows], displacement_m: vec![0.0; rows], ..Log::default() };
        let mut bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        bench.records[0].noise_m = 2e-8;
        let accounted = |at_rest_m: f64| {
            let mut random = Pcg64::seed_from_u64(8);
            let mut draw = || random.sample::<f64, _>(StandardNormal);
            let residual_m = (0..rows).map(|k| at_rest_m * draw() + JITTER_S * draw() * speed(k)).collect();
            let left = [Remainder { residual_m, velocity_m_per_s: (0..rows).map(speed).collect() }];
            let found = scattered(&bench, &left, false);
            assert!((found.jitter_s / JITTER_S - 1.0).abs() < 0.1, "{:e}", found.jitter_s);
            found.jitter_m2 / found.moving_m2
        };
        // Noise is known to some per cent; as much again is none.
        let expected = |at_rest_m: f64| 5e-15 / (5e-15 + at_rest_m.powi(2) - 8e-16);
        assert!((accounted(2e-8) - 1.0).abs() < 0.1 && (accounted(2.5e-8) - 1.0).abs() < 0.1);
        for at_rest_m in [1e-7, 2e-7] {
            assert!((accounted(at_rest_m) / expected(at_rest_m) - 1.0).abs() < 0.2, "{at_rest_m:e}");
        }
    }

    /// Where the plant stands, a coarse converter's readings differ by nothing at all.
    #[test]
    fn rows_that_differ_by_nothing_are_no_perfect_knowledge() {
        let mut random = Pcg64::seed_from_u64(9);
        let pair = |k: usize| {
            let speed2 = (1e-6 * k as f64).powi(2);
            let normal = random.sample::<f64, _>(StandardNormal);
            (speed2, if k < 3000 { 0.0 } else { 25e-12 * speed2 * normal * normal })
        };
        let mut pairs: Vec<(f64, f64)> = (0..20_000).map(pair).collect();
        let (jitter2, sigma, foot) = slope(&mut pairs);
        assert!((jitter2 / 25e-12 - 1.0).abs() < 0.05 && sigma > 0.0 && foot.is_finite(), "{jitter2:e} {sigma:e}");
        let (nothing, ..) = slope(&mut (0..1000).map(|k| (f64::from(k), 0.0)).collect::<Vec<_>>());
        assert_eq!(nothing, 0.0);
    }

    #[test]
    fn the_slope_over_speed_is_that_of_the_jitter_and_its_sigma_tells_how_well() {
        const JITTER_S: f64 = 5e-6;
        let deviation = |seed: u64| {
            let mut random = Pcg64::seed_from_u64(seed);
            // Slow for the most part, and so fast at times that a bin holds all speeds from a tenth of the highest on.
            let speed = |k: usize| 2e-2 * (1e-3 * k as f64).sin().powi(301);
            let mut draw = || random.sample::<f64, _>(StandardNormal);
            let residual_m: Vec<f64> = (0..100_000).map(|k| 2e-8 * draw() + JITTER_S * speed(k) * draw()).collect();
            let pair = |k: usize| {
                (0.5 * (speed(k).powi(2) + speed(k - 1).powi(2)), 0.5 * (residual_m[k] - residual_m[k - 1]).powi(2))
            };
            let (slope, sigma, _) = slope(&mut (1..residual_m.len()).map(pair).collect::<Vec<_>>());
            (slope - JITTER_S * JITTER_S) / sigma
        };
        let deviations: Vec<f64> = (1..=40).map(deviation).collect();
        let mean = deviations.iter().sum::<f64>() / 40.0;
        let rms = (deviations.iter().map(|d| d * d).sum::<f64>() / 40.0).sqrt();
        // The mean of 40 normals is within half, their rms within a third of one, but for one time in several hundred.
        assert!(mean.abs() < 0.5 && (0.67..1.33).contains(&rms), "{mean} {rms}");
    }
}
