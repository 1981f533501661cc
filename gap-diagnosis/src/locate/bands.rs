//! Residual power per frequency band.
//!
//! The spectrum is the squared discrete cosine transform (DCT-II, orthonormal): like the periodogram it keeps the energy exactly
//! (Parseval), but it continues a log at its ends as in a mirror, so that an offset or a drift does not leak into every band above
//! (its lines fall as 1/f^4, those of the periodogram as 1/f^2).

use super::power::{Part, powers};
use super::{Power, Trace};
use realfft::RealFftPlanner;
use serde::Serialize;
use std::f64::consts::PI;

/// Bands per decade.
const BANDS_PER_DECADE: f64 = 3.0;
/// Longest block transformed at once: 2^20 samples are 26 s of 40 kHz, and a log of any length takes 30 MB.
const BLOCK_SAMPLES: usize = 1 << 20;

/// One frequency band; its rms is that of the residual filtered to the band.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Band {
    /// Lower edge.
    pub from_hz: f64,
    /// Upper edge.
    pub to_hz: f64,
    /// Residual in the band.
    #[serde(flatten)]
    pub power: Power,
}

/// Bands of a third of a decade (edges 1, 2.15, 4.64, 10, .. Hz), the first one down to 0; all logs together.
pub(super) fn bands(traces: &[Trace<'_>]) -> Vec<Band> {
    let edges_hz = edges_hz(traces);
    let mut parts = vec![Part::default(); edges_hz.len().saturating_sub(1)];
    let mut planner = RealFftPlanner::<f64>::new();
    let mut total_s = 0.0;
    for trace in traces {
        // As few blocks as fit, of nearly equal length: a short remainder would have no low frequencies.
        let n = trace.residual_m.len();
        let n_blocks = n.div_ceil(BLOCK_SAMPLES);
        for block_idx in 0..n_blocks {
            let block = &trace.residual_m[n * block_idx / n_blocks..n * (block_idx + 1) / n_blocks];
            let n_scored = block.iter().filter(|residual_m| residual_m.is_finite()).count();
            let noise_m2_s = trace.noise_m.powi(2) * trace.dt_s * n_scored as f64 / block.len() as f64;
            total_s += n_scored as f64 * trace.dt_s;
            for (line_idx, energy) in cosine_spectrum(block, &mut planner).into_iter().enumerate() {
                let frequency_hz = 0.5 * line_idx as f64 / (block.len() as f64 * trace.dt_s);
                let band_idx = edges_hz.partition_point(|&edge_hz| edge_hz <= frequency_hz).saturating_sub(1);
                parts[band_idx.min(edges_hz.len() - 2)].add(energy * trace.dt_s, noise_m2_s, 0.0);
            }
        }
    }
    for part in &mut parts {
        part.time_s = total_s;
    }
    edges_hz
        .windows(2)
        .zip(powers(&parts))
        .map(|(edges_hz, power)| Band { from_hz: edges_hz[0], to_hz: edges_hz[1], power })
        .collect()
}

/// 0, then thirds of decades from the first above two periods per log, then the highest Nyquist frequency.
fn edges_hz(traces: &[Trace<'_>]) -> Vec<f64> {
    let longest_s = traces.iter().map(super::duration_s).fold(0.0, f64::max);
    let nyquist_hz = traces.iter().map(|trace| 0.5 / trace.dt_s).fold(0.0, f64::max);
    if longest_s == 0.0 {
        return Vec::new();
    }
    let first = (BANDS_PER_DECADE * (2.0 / longest_s).log10()).ceil();
    let mut edges_hz = vec![0.0];
    edges_hz.extend(
        (0..)
            .map(|step| 10f64.powf((first + f64::from(step)) / BANDS_PER_DECADE))
            .take_while(|&f| f < 0.99 * nyquist_hz),
    );
    edges_hz.push(nyquist_hz);
    edges_hz
}

/// Squares of the orthonormal DCT-II; values that are not finite count as zero. Line k lies at k / (2 N dt).
///
/// By one real FFT of the same length over the even samples forwards and the odd ones backwards (Makhoul 1980, IEEE Trans. ASSP 28).
fn cosine_spectrum(values: &[f64], planner: &mut RealFftPlanner<f64>) -> Vec<f64> {
    let n = values.len();
    let finite = |value: &f64| if value.is_finite() { *value } else { 0.0 };
    let mut shuffled: Vec<f64> = values.iter().step_by(2).map(finite).collect();
    let odd: Vec<f64> = values.iter().skip(1).step_by(2).map(finite).collect();
    shuffled.extend(odd.into_iter().rev());
    let transform = planner.plan_fft_forward(n);
    let mut lines = transform.make_output_vec();
    transform.process(&mut shuffled, &mut lines).expect("buffers come from the plan");
    let mut energies = vec![0.0; n];
    for (k, line) in lines.iter().enumerate() {
        let (sin, cos) = (-PI * k as f64 / (2.0 * n as f64)).sin_cos();
        let scale = if k == 0 { 1.0 } else { 2.0 } / n as f64;
        energies[k] = scale * (line.re * cos - line.im * sin).powi(2);
        if k > 0 && k < n - k {
            energies[n - k] = scale * (line.re * sin + line.im * cos).powi(2);
        }
    }
    energies
}

#[cfg(test)]
mod tests {
    use super::super::locate;
    use super::super::tests::{DT_S, Made, sine};
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn the_cosine_spectrum_keeps_the_energy_and_matches_its_definition() {
        for n in [1_usize, 2, 3, 8, 15, 16] {
            let values: Vec<f64> = (0..n).map(|k| ((7 * k * k + 3) % 11) as f64 - 4.0).collect();
            let energies = cosine_spectrum(&values, &mut RealFftPlanner::new());
            for (k, energy) in energies.iter().enumerate() {
                let sum: f64 = values
                    .iter()
                    .enumerate()
                    .map(|(j, x)| x * (PI * k as f64 * (2 * j + 1) as f64 / (2 * n) as f64).cos())
                    .sum();
                let expected = sum * sum * if k == 0 { 1.0 } else { 2.0 } / n as f64;
                assert!((energy - expected).abs() < 1e-10, "n {n} line {k}: {energy} {expected}");
            }
        }
    }

    #[test]
    fn two_tones_fall_into_their_bands_and_the_bands_sum_to_the_total() {
        let tones = |t: f64, _: f64, _: f64| 3e-7 * (TAU * 30.0 * t).cos() + 1e-7 * (TAU * 1500.0 * t).cos() + 1e-7;
        let made = Made::new("tones", 1.0, sine(10.0), tones);
        let found = locate(&[made.trace()]);
        let share = |hz: f64| {
            let band = found.bands.iter().find(|band| band.from_hz <= hz && hz < band.to_hz);
            band.expect("bands cover everything").power.share_percent
        };
        // Powers 4.5, 0.5 and 1 of 6 in units of 1e-14 m^2. Cosines are smooth in a
        // mirror and do not leak; a sine of 30 Hz would leave 2 % of its power in other bands.
        for (hz, expected) in [(30.0, 75.0), (1500.0, 100.0 / 12.0), (0.1, 100.0 / 6.0)] {
            assert!((share(hz) - expected).abs() < 0.5, "{hz} Hz: {} {expected}", share(hz));
        }
        let power_um2: f64 = found.bands.iter().map(|band| band.power.rms_um.powi(2)).sum();
        assert!((power_um2 / found.total.rms_um.powi(2) - 1.0).abs() < 1e-9, "Parseval");
        assert_eq!(found.bands.last().map(|band| band.to_hz), Some(0.5 / DT_S));
    }

    #[test]
    fn a_drift_stays_in_the_lowest_bands() {
        let made = Made::new("drift", 1.0, sine(10.0), |t, _, _| 5e-6 * t);
        let found = locate(&[made.trace()]);
        let above: f64 =
            found.bands.iter().filter(|band| band.from_hz >= 20.0).map(|band| band.power.share_percent).sum();
        // Lines of the mirrored ramp fall as 1/k^2: above line 40 they hold less than 1e-4 of the power. A periodogram leaves 1 %.
        assert!(above < 0.01, "{above} %");
    }
}
