//! Welch's method: frequency response with coherence and random error, and power spectral density.
//!
//! Segments of one length overlap by half and bear a Hann window (Welch 1967, IEEE Trans. Audio Electroacoust. 15). The response is
//! H1 = Syu / Suu; in closed loop the noise reaches the command and biases it, so there the reference serves as the instrument,
//! H = Syr / Sur (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 2).

use super::Transform;
use realfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Fewer segments give no coherence worth the name.
const MIN_SEGMENTS: usize = 4;
/// Squared correlation of two Hann windows that overlap by half, (1/6)^2.
const OVERLAP_CORRELATION: f64 = 1.0 / 36.0;

/// A frequency response. All columns have one length.
#[derive(Clone, Debug, PartialEq)]
pub struct Frf {
    /// Lines, ascending, without 0.
    pub frequency_hz: Vec<f64>,
    /// Magnitude of displacement over command.
    pub gain_m_per_v: Vec<f64>,
    /// Phase, -pi to pi; negative is a lag.
    pub phase_rad: Vec<f64>,
    /// Coherence of the displacement with the command (in closed loop: with the reference), 0 to 1.
    pub coherence: Vec<f64>,
    /// Standard deviation of the gain by noise. In open loop this is gain sqrt((1 - coherence) / (2 n coherence)) (Bendat and Piersol,
    /// Random Data, 4th ed. 2010, sec. 9.3). It doesn't hold what a line has of its neighbours (leakage).
    pub gain_sigma_m_per_v: Vec<f64>,
    /// Number n of independent averages, less than the number of segments because they overlap.
    pub n_averages: f64,
}

/// A one-sided power spectral density. Both columns have one length.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerDensity {
    /// Lines, ascending, from 0.
    pub frequency_hz: Vec<f64>,
    /// Density; its sum times the spacing of the lines is the variance.
    pub density_m2_per_hz: Vec<f64>,
}

/// A segment length for a log of `n_samples`: the largest power of two that gives at least 15 segments.
pub fn segment_samples(n_samples: usize) -> usize {
    match n_samples / 8 {
        0 => 1,
        eighth => 1 << eighth.ilog2(),
    }
}

/// Response of the displacement to the command of an open-loop log, by H1. None with less than four segments or no command.
///
/// # Panics
/// If the columns differ in length.
pub fn frf(command_v: &[f64], displacement_m: &[f64], dt_s: f64, segment_samples: usize) -> Option<Frf> {
    response(command_v, command_v, displacement_m, dt_s, segment_samples)
}

/// Response of the displacement to the command of a closed-loop log, with the reference as the instrument. None as for [`frf`].
///
/// # Panics
/// If the columns differ in length.
pub fn frf_closed_loop(
    reference_m: &[f64],
    command_v: &[f64],
    displacement_m: &[f64],
    dt_s: f64,
    segment_samples: usize,
) -> Option<Frf> {
    response(reference_m, command_v, displacement_m, dt_s, segment_samples)
}

/// One-sided power spectral density of `signal_m` (a residual, say), its mean taken out.
pub fn power_density(signal_m: &[f64], dt_s: f64, segment_samples: usize) -> PowerDensity {
    let mut welch = Welch::new(segment_samples);
    let mean_m = mean(signal_m);
    let mut sums = vec![0.0; segment_samples / 2 + 1];
    let starts = starts(signal_m.len(), segment_samples);
    for &start in &starts {
        for (sum, line) in sums.iter_mut().zip(welch.lines(&signal_m[start..start + segment_samples], mean_m)) {
            *sum += line.norm_sqr();
        }
    }
    // One-sided: a line stands for its negative too, save 0 and the Nyquist line.
    let power = welch.window.iter().map(|w| w * w).sum::<f64>();
    let is_single = |k: usize| k == 0 || 2 * k == segment_samples;
    let density_m2_per_hz = sums
        .iter()
        .enumerate()
        .map(|(k, sum)| if is_single(k) { 1.0 } else { 2.0 } * sum * dt_s / (power * starts.len().max(1) as f64))
        .collect();
    let line_hz = 1.0 / (segment_samples as f64 * dt_s);
    PowerDensity { frequency_hz: (0..sums.len()).map(|k| k as f64 * line_hz).collect(), density_m2_per_hz }
}

/// Auto and cross powers of one line, summed over segments: z the instrument, u the command, y the displacement.
#[derive(Clone, Copy, Default)]
struct Powers {
    zz: f64,
    uu: f64,
    yy: f64,
    uz: Complex64,
    yz: Complex64,
    yu: Complex64,
}

fn response(z: &[f64], u: &[f64], y: &[f64], dt_s: f64, segment_samples: usize) -> Option<Frf> {
    assert!(z.len() == u.len() && u.len() == y.len(), "one value per sample in every column");
    let starts = starts(u.len(), segment_samples);
    if starts.len() < MIN_SEGMENTS || segment_samples < 4 {
        return None;
    }
    let mut welch = Welch::new(segment_samples);
    let means = [z, u, y].map(mean);
    let mut powers = vec![Powers::default(); segment_samples / 2 + 1];
    for &start in &starts {
        let mut lines = |column: &[f64], mean| welch.lines(&column[start..start + segment_samples], mean);
        let (z, u, y) = (lines(z, means[0]), lines(u, means[1]), lines(y, means[2]));
        for (k, sum) in powers.iter_mut().enumerate() {
            sum.zz += z[k].norm_sqr();
            sum.uu += u[k].norm_sqr();
            sum.yy += y[k].norm_sqr();
            sum.uz += u[k] * z[k].conj();
            sum.yz += y[k] * z[k].conj();
            sum.yu += y[k] * u[k].conj();
        }
    }
    // Variance of a mean over K half-overlapped segments against K independent ones (Welch 1967, eq. for 50 % overlap).
    let n_segments = starts.len() as f64;
    let n_averages = n_segments / (1.0 + 2.0 * OVERLAP_CORRELATION * (1.0 - 1.0 / n_segments));
    let line_hz = 1.0 / (segment_samples as f64 * dt_s);
    let mut frf = Frf {
        frequency_hz: Vec::new(),
        gain_m_per_v: Vec::new(),
        phase_rad: Vec::new(),
        coherence: Vec::new(),
        gain_sigma_m_per_v: Vec::new(),
        n_averages,
    };
    // A line without drive has no response; 1e-20 of the strongest is rounding.
    let least = 1e-20 * powers.iter().map(|sum| sum.uz.norm()).fold(0.0, f64::max);
    for (k, sum) in powers.iter().enumerate().skip(1).filter(|(_, sum)| sum.uz.norm() > least) {
        let h = sum.yz / sum.uz;
        // v = y - H u is what the command doesn't explain; H - H0 = Svz / Suz, and E|Svz|^2 = Svv Szz / n. Half of that is in the gain.
        let vv = (sum.yy + h.norm_sqr() * sum.uu - 2.0 * (h.conj() * sum.yu).re).max(0.0);
        frf.frequency_hz.push(k as f64 * line_hz);
        frf.gain_m_per_v.push(h.norm());
        frf.phase_rad.push(h.arg());
        frf.coherence.push(if sum.yy > 0.0 { (sum.yz.norm_sqr() / (sum.yy * sum.zz)).min(1.0) } else { 0.0 });
        frf.gain_sigma_m_per_v.push((vv * sum.zz / (2.0 * n_averages)).sqrt() / sum.uz.norm());
    }
    (!frf.frequency_hz.is_empty()).then_some(frf)
}

/// First samples of the half-overlapping segments that fit.
fn starts(n_samples: usize, segment_samples: usize) -> Vec<usize> {
    let step = (segment_samples / 2).max(1);
    (0..).map(|idx| idx * step).take_while(|start| start + segment_samples <= n_samples).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

struct Welch {
    window: Vec<f64>,
    transform: Transform,
}

impl Welch {
    fn new(segment_samples: usize) -> Self {
        let n = segment_samples as f64;
        let window = (0..segment_samples).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n).cos()).collect();
        Self { window, transform: Transform::new(segment_samples) }
    }

    /// Lines of a windowed segment. The mean is that of the whole column: each segment's own would take a part of line 1 along.
    fn lines(&mut self, segment: &[f64], mean: f64) -> Vec<Complex64> {
        self.transform.lines(segment.iter().zip(&self.window).map(|(value, weight)| (value - mean) * weight))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{lag, lag_response, loop_around_lag, white};
    use super::*;

    const DT_S: f64 = 1e-4;

    #[test]
    fn a_lag_under_noise_is_found_within_its_stated_error() {
        let a = 0.8;
        let n = 400_000;
        let command = white(n, 1);
        let noise = white(n, 2);
        let output: Vec<f64> = lag(&command, a).iter().zip(&noise).map(|(y, e)| y + 0.1 * e).collect();
        let found = frf(&command, &output, DT_S, 512).expect("long enough");
        let (mut squares, mut worst_rad) = (0.0, 0.0_f64);
        for (k, &frequency_hz) in found.frequency_hz.iter().enumerate() {
            let (gain, phase_rad) = lag_response(a, frequency_hz * DT_S);
            squares += ((found.gain_m_per_v[k] - gain) / found.gain_sigma_m_per_v[k]).powi(2);
            // Only the Nyquist line is real; its phase is 0 or pi exactly.
            let turn = (found.phase_rad[k] - phase_rad + std::f64::consts::PI).rem_euclid(TAU) - std::f64::consts::PI;
            worst_rad = worst_rad.max(turn.abs() * gain / found.gain_sigma_m_per_v[k]);
            // Signal and noise are both white: |H|^2 / (|H|^2 + 0.01). Standard deviation (1 - c) sqrt(2 c / n) (Bendat and Piersol), of
            // which 256 lines stay within 4.5. Output that answers input before the segment adds a little: the lag is 1 % of it.
            let coherence = gain * gain / (gain * gain + 0.01);
            let bound = 4.5 * (1.0 - coherence) * (2.0 * coherence / found.n_averages).sqrt() + 1e-3;
            assert!((found.coherence[k] - coherence).abs() < bound, "{frequency_hz} Hz: {}", found.coherence[k]);
        }
        let rms = (squares / found.frequency_hz.len() as f64).sqrt();
        // 256 lines, neighbours correlated by the window: the rms of their normalised errors is known to about 6 %.
        assert!((0.85..1.15).contains(&rms), "{rms}");
        assert!(worst_rad < 4.5, "{worst_rad}");
        assert_eq!(found.frequency_hz.len(), 256);
    }

    #[test]
    fn in_closed_loop_the_instrument_is_right_where_h1_is_not() {
        let (a, n) = (0.8, 400_000);
        let [reference, command, output] = loop_around_lag(a, n, 1.0);
        let plain = frf(&command, &output, DT_S, 256).expect("long enough");
        let found = frf_closed_loop(&reference, &command, &output, DT_S, 256).expect("long enough");
        let mut squares = 0.0;
        let mut bias: f64 = 0.0;
        for (k, &frequency_hz) in found.frequency_hz.iter().enumerate() {
            let (gain, _) = lag_response(a, frequency_hz * DT_S);
            squares += ((found.gain_m_per_v[k] - gain) / found.gain_sigma_m_per_v[k]).powi(2);
            bias = bias.max((plain.gain_m_per_v[k] / gain - 1.0).abs());
        }
        let rms = (squares / found.frequency_hz.len() as f64).sqrt();
        // 128 lines: to about 9 %.
        assert!((0.8..1.25).contains(&rms), "{rms}");
        assert!(bias > 0.3, "H1 is {bias} off at worst");
    }

    #[test]
    fn a_power_density_sums_to_the_variance() {
        let signal: Vec<f64> = white(200_000, 5).iter().map(|e| 3.0 + 2e-8 * e).collect();
        let found = power_density(&signal, DT_S, 1000);
        let line_hz = found.frequency_hz[1];
        let variance: f64 = found.density_m2_per_hz.iter().sum::<f64>() * line_hz;
        // 200000 samples know their variance to 0.3 %; the two ends weigh less than the middle.
        assert!((variance / 4e-16 - 1.0).abs() < 0.012, "{variance}");
        // Flat at 2 sigma^2 dt: 399 segments leave 5 % per line, five of which no line of 500 exceeds.
        for density in &found.density_m2_per_hz[2..500] {
            assert!((density / (2.0 * 4e-16 * DT_S) - 1.0).abs() < 0.27, "{density}");
        }
    }

    #[test]
    fn too_short_or_at_rest_is_no_response() {
        assert_eq!(frf(&[1.0; 100], &[1.0; 100], DT_S, 64), None);
        assert_eq!(frf(&[0.0; 1000], &[1.0; 1000], DT_S, 64), None);
        assert_eq!(frf(&[], &[], DT_S, segment_samples(0)), None);
        assert_eq!([16, 1000, 110_000].map(segment_samples), [2, 64, 8192]);
    }
}
