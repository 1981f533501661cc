//! Lines in residuals: frequencies at which all logs together hold more power than their neighbourhood, drive or no drive.

use super::bench::{Bench, Record};
use super::search::Remainder;
use crate::spectra::power_density;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

/// Zero-padding, so that a line between two bins is not missed.
const PADDING: usize = 2;
/// A line stands this far above the median power of its neighbourhood.
const PROMINENCE: f64 = 12.0;
/// Neighbourhood in bins to each side.
const NEIGHBOURS: usize = 60;
/// Most lines that are reported.
const MOST: usize = 6;
/// Samples of a segment for resonances, the lowest of them, and how far apart they are reported, as a logarithm.
const RESONANCE_SEGMENT: usize = 4096;
const LOWEST_RESONANCE_HZ: f64 = 50.0;
const APART: f64 = 0.02;
/// Frequencies of the common axis.
const BINS: usize = 1 << 15;

/// Frequencies in Hz, strongest first. `remainders` are what a plant leaves, one for each log.
pub fn lines(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let highest_hz = bench.records.iter().map(|r| 0.5 / r.log.dt_s).fold(f64::INFINITY, f64::min);
    let mut total = vec![0.0; BINS];
    let mut planner = RealFftPlanner::<f64>::new();
    for (record, Remainder { residual_m, .. }) in bench.records.iter().zip(remainders) {
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
            let upto = (highest_hz * (bin + 1) as f64 / BINS as f64 / per_bin) as usize;
            let powers = buffer[at..(upto + 1).max(at + 1).min(size / 2)].iter().map(|c| c.norm_sqr());
            *sum += powers.fold(0.0, f64::max) / n as f64;
        }
    }
    let mut peaks: Vec<(f64, f64)> = Vec::new();
    for bin in 2..BINS - 2 {
        let around = &total[bin.saturating_sub(NEIGHBOURS)..(bin + NEIGHBOURS).min(BINS)];
        let here = total[bin];
        if total[bin - 2..=bin + 2].iter().any(|other| *other > here) {
            continue;
        }
        let mut sorted = around.to_vec();
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
        if here > PROMINENCE * median {
            peaks.push((here, highest_hz * (bin as f64 + 0.5) / BINS as f64));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let width_hz = highest_hz / BINS as f64;
    peaks.into_iter().take(MOST).map(|(_, hz)| sharpened(bench, remainders, hz, width_hz)).collect()
}

/// Frequencies in Hz at which the residuals of all logs together have most power, strongest first: where a resonance that nobody
/// modelled would be, under an excitation that reaches it.
pub fn resonances(bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    for (record, Remainder { residual_m, .. }) in bench.records.iter().zip(remainders) {
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

/// The frequency near `hz` at which all logs together have most power: a line of several seconds is much narrower than a bin.
fn sharpened(bench: &Bench<'_>, remainders: &[Remainder], hz: f64, width_hz: f64) -> f64 {
    let power = |hz: f64| -> f64 {
        let of_log = |(record, Remainder { residual_m, .. }): (&Record<'_>, &Remainder)| {
            let turn = Complex::from_polar(1.0, -std::f64::consts::TAU * hz * record.log.dt_s);
            let mut phase = Complex::new(1.0, 0.0);
            let mut sum = Complex::new(0.0, 0.0);
            for r in residual_m {
                sum += phase * r;
                phase *= turn;
            }
            sum.norm_sqr() / (residual_m.len() as f64 * record.noise_m * record.noise_m)
        };
        bench.records.iter().zip(remainders).map(of_log).sum()
    };
    let mut best = (power(hz), hz);
    let mut reach_hz = width_hz;
    for _ in 0..3 {
        let centre_hz = best.1;
        for step in -8..=8 {
            let there_hz = centre_hz + reach_hz * f64::from(step) / 8.0;
            let there = (power(there_hz), there_hz);
            if there.0 > best.0 {
                best = there;
            }
        }
        reach_hz /= 8.0;
    }
    best.1
}
