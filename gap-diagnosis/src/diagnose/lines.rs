//! Lines in residuals: frequencies at which all logs together hold more power than their neighbourhood, drive or no drive.

use super::bench::{Bench, Record};
use super::search::{Remainder, after_run_in};
use crate::spectra::power_density;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use std::ops::Range;

/// Zero-padding, so that a line between two bins is not missed.
const PADDING: usize = 2;
/// A line stands this far above the median power of its neighbourhood.
const PROMINENCE: f64 = 12.0;
/// Neighbourhood in bins to each side.
const NEIGHBOURS: usize = 60;
/// Most lines that are reported.
const MOST: usize = 6;
/// Grids on which a line's place is sought, each eight times as fine as the one before; more where the last is coarser than this part of a
/// period over the longest log.
const LEVELS: usize = 3;
const FINE: f64 = 0.1;
/// Samples of a segment for resonances, the lowest of them, and how far apart they are reported, as a logarithm.
const RESONANCE_SEGMENT: usize = 4096;
const LOWEST_RESONANCE_HZ: f64 = 50.0;
const APART: f64 = 0.02;
/// A longer residual is taken in stretches: the transform of ten minutes would hold ten times what their log does.
const MOST_ROWS: usize = 1 << 20;
/// Frequencies of the common axis.
const BINS: usize = 1 << 15;

/// Frequencies in Hz, strongest first. `remainders` are what a plant leaves, one for each log.
pub fn lines(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let highest_hz = bench.records.iter().map(|r| 0.5 / r.log.dt_s).fold(0.0, f64::max);
    let mut total = vec![0.0; BINS];
    let mut planner = RealFftPlanner::<f64>::new();
    let stretches = after_run_in(bench, remainders).flat_map(|(record, residual_m)| {
        let rows = residual_m.len();
        let count = rows.div_ceil(MOST_ROWS).max(1);
        residual_m.chunks(rows.div_ceil(count).max(1)).map(move |residual_m| (record, residual_m))
    });
    for (record, residual_m) in stretches {
        let n = residual_m.len();
        let size = (PADDING * n).next_power_of_two();
        let mean = residual_m.iter().sum::<f64>() / n.max(1) as f64;
        let mut tapered: Vec<f64> = residual_m
            .iter()
            .enumerate()
            .map(|(k, r)| {
                let hann = 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / n as f64).cos();
                (r - mean) * hann / record.noise_m
            })
            .collect();
        tapered.resize(size, 0.0);
        let fft = planner.plan_fft_forward(size);
        let mut buffer = fft.make_output_vec();
        if fft.process(&mut tapered, &mut buffer).is_err() {
            continue;
        }
        let per_bin = 1.0 / (size as f64 * record.log.dt_s);
        for (bin, sum) in total.iter_mut().enumerate() {
            let hz = highest_hz * bin as f64 / BINS as f64;
            let at = (hz / per_bin) as usize;
            // A slower log says nothing of what is faster.
            if at >= size / 2 {
                break;
            }
            let upto = (highest_hz * (bin + 1) as f64 / BINS as f64 / per_bin) as usize;
            let powers = buffer[at..(upto + 1).max(at + 1).min(size / 2)].iter().map(|c| c.norm_sqr());
            *sum += powers.fold(0.0, f64::max) / n as f64;
        }
    }
    let width_hz = highest_hz / BINS as f64;
    let peaks = peaks(&total, 2..BINS - 2, NEIGHBOURS, PROMINENCE).into_iter().take(MOST);
    peaks.map(|bin| sharpened(bench, remainders, highest_hz * (bin as f64 + 0.5) / BINS as f64, width_hz)).collect()
}

/// Of `bins`, those at which `power` stands above its two neighbours on each side and `prominence` times above the median of so many
/// `neighbours` to each side; strongest first.
pub(super) fn peaks(power: &[f64], bins: Range<usize>, neighbours: usize, prominence: f64) -> Vec<usize> {
    let is_peak = |&bin: &usize| {
        let here = power[bin];
        if power[bin - 2..=bin + 2].iter().any(|other| *other > here) {
            return false;
        }
        let mut around = power[bin.saturating_sub(neighbours)..(bin + neighbours).min(power.len())].to_vec();
        let middle = around.len() / 2;
        here > prominence * *around.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let mut found: Vec<usize> = bins.filter(is_peak).collect();
    found.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
    found
}

/// Frequencies in Hz at which the residuals of all logs together have most power, strongest first: where a resonance that nobody
/// modelled would be, under an excitation that reaches it.
pub fn resonances(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    for (record, residual_m) in after_run_in(bench, remainders) {
        let density = power_density(residual_m, record.log.dt_s, RESONANCE_SEGMENT.min(residual_m.len() / 2));
        let power = &density.density_m2_per_hz;
        for bin in 2..power.len().saturating_sub(2) {
            let is_peak = power[bin - 2..=bin + 2].iter().all(|other| *other <= power[bin]);
            if is_peak && density.frequency_hz[bin] > LOWEST_RESONANCE_HZ {
                found.push((power[bin], density.frequency_hz[bin]));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut apart: Vec<f64> = Vec::new();
    for (_, hz) in found {
        if apart.len() < MOST && apart.iter().all(|other| (hz / other).ln().abs() > APART) {
            apart.push(hz);
        }
    }
    apart
}

/// The frequency near `hz` at which all logs together have most power: a line of several seconds is much narrower than a bin. The finer the
/// grid becomes, the longer are the stretches that are looked at: the line of a long one would lie between two places of a coarse grid.
fn sharpened(bench: &Bench<'_>, remainders: &[Remainder], hz: f64, width_hz: f64) -> f64 {
    let power = |hz: f64, stretch_s: f64| -> f64 {
        let of_log = |(record, residual_m): (&Record<'_>, &[f64])| {
            let turn = Complex::from_polar(1.0, -std::f64::consts::TAU * hz * record.log.dt_s);
            let rows = ((stretch_s / record.log.dt_s) as usize).clamp(1, residual_m.len());
            let of_stretch = |stretch_m: &[f64]| {
                let mut phase = Complex::new(1.0, 0.0);
                let mut sum = Complex::new(0.0, 0.0);
                for r in stretch_m {
                    sum += phase * r;
                    phase *= turn;
                }
                sum.norm_sqr() / (rows as f64 * record.noise_m * record.noise_m)
            };
            residual_m.chunks(rows).map(of_stretch).sum::<f64>()
        };
        after_run_in(bench, remainders).filter(|(record, _)| hz < 0.5 / record.log.dt_s).map(of_log).sum()
    };
    let longest_s = bench.records.iter().map(|r| r.log.len() as f64 * r.log.dt_s).fold(0.0, f64::max);
    let mut best_hz = hz;
    let mut step_hz = width_hz / 8.0;
    for level in 0.. {
        let is_fine = step_hz < FINE / longest_s;
        let centre_hz = best_hz;
        let mut best = power(centre_hz, 0.5 / step_hz);
        for step in (-8..=8).filter(|step| *step != 0) {
            let there_hz = centre_hz + step_hz * f64::from(step);
            let there = power(there_hz, 0.5 / step_hz);
            if there > best {
                (best, best_hz) = (there, there_hz);
            }
        }
        if level + 1 >= LEVELS && is_fine {
            break;
        }
        step_hz /= 8.0;
    }
    best_hz
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use std::f64::consts::TAU;

    /// A log of fewer samples a second has no say in what is faster than it follows, and takes nothing from what the others show.
    #[test]
    fn a_slow_log_hides_no_fast_line() {
        let model = thesis();
        let sine = |rows: usize, dt_s: f64, hz: f64| -> Vec<f64> {
            (0..rows).map(|k| 1e-7 * (TAU * hz * dt_s * k as f64).sin()).collect()
        };
        let log = |dt_s: f64, residual_m: &[f64]| Log {
            dt_s,
            command_v: vec![0.0; residual_m.len()],
            displacement_m: residual_m.to_vec(),
            ..Log::default()
        };
        let residuals = [sine(20_000, 5e-5, 3007.0), sine(2000, 1e-2, 11.0)];
        let logs = [log(5e-5, &residuals[0]), log(1e-2, &residuals[1])];
        let records = logs.iter().map(|log| record(log, &model.chain(), None)).collect();
        let bench = Bench::new(&model, records);
        let remainders =
            residuals.map(|residual_m| Remainder { velocity_m_per_s: vec![0.0; residual_m.len()], residual_m });
        let found = lines(&bench, &remainders);
        let has = |hz: f64| found.iter().any(|found| (found - hz).abs() < 0.05);
        assert!(has(3007.0) && has(11.0), "{found:?}");
        assert_eq!(bench.scales().sample_s, 5e-5);
    }

    #[test]
    fn the_line_of_a_long_log_is_not_missed_between_two_places_of_a_grid() {
        let model = thesis();
        let rows = 60_000;
        // A minute at 1 kHz: the line is a sixtieth of a hertz wide.
        let residual_m: Vec<f64> = (0..rows).map(|k| 1e-7 * (TAU * 50.003 * 1e-3 * f64::from(k)).sin()).collect();
        let log = Log {
            dt_s: 1e-3,
            command_v: vec![0.0; residual_m.len()],
            displacement_m: residual_m.clone(),
            ..Log::default()
        };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let velocity_m_per_s = vec![0.0; residual_m.len()];
        let remainders = [Remainder { residual_m, velocity_m_per_s }];
        let found = lines(&bench, &remainders);
        assert!((found[0] - 50.003).abs() < 1e-3, "{found:?}");
        let found = sharpened(&bench, &remainders, 50.12, 0.3);
        assert!((found - 50.003).abs() < 1e-3, "{found}");
    }
}
