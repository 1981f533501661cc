//! Best linear approximation of a plant under a periodic multisine, and how far the plant is from linear.
//!
//! The robust method (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, sec. 4.3.1): what
//! differs from period to period is noise; what differs from realisation to realisation, beyond that noise, is nonlinear distortion
//! that looks like noise. One realisation with lines left out also tells (sec. 4.3.2, the fast method): what comes out at a line that
//! wasn't put in is distortion, of an odd kind at odd lines and of an even kind at even ones, if all lines put in are odd.
//!
//! Letters of the book: `U`, `Y` spectra per period, `P` periods, `M` realisations, `G` the approximation.

use super::{Transform, repeats};
use realfft::num_complex::Complex64;

/// A line belongs to the multisine if its amplitude is at least this part of the largest: a 12-bit converter's lattice stays below.
const LEAST_AMPLITUDE: f64 = 3e-3;
/// Silent lines are told up to this many times the highest line put in: that is where a cubic's products end.
const HIGHEST_PRODUCT: usize = 3;

/// Best linear approximation and distortions.
#[derive(Clone, Debug, PartialEq)]
pub struct BestLinear {
    /// Lines of the multisine, ascending.
    pub frequency_hz: Vec<f64>,
    /// Magnitude of displacement over command.
    pub gain_m_per_v: Vec<f64>,
    /// Phase, -pi to pi; negative is a lag.
    pub phase_rad: Vec<f64>,
    /// Standard deviation of the complex response by noise, all periods and realisations averaged.
    pub noise_m_per_v: Vec<f64>,
    /// Standard deviation of the complex response by distortion in ONE realisation, the noise taken off; empty with one realisation.
    pub distortion_m_per_v: Vec<f64>,
    /// Standard deviation of the complex response by both, over all realisations; empty with one realisation.
    pub total_m_per_v: Vec<f64>,
    /// Lines without drive, ascending, up to three times the highest line with drive.
    pub silent: Vec<SilentLine>,
    /// Rms of the linear part of the displacement, over the lines put in.
    pub linear_rms_m: f64,
    /// Rms over the silent odd lines, noise taken off; none without such lines.
    pub odd_rms_m: Option<f64>,
    /// Rms over the silent even lines, noise taken off; none without such lines.
    pub even_rms_m: Option<f64>,
    /// Whether all lines put in are odd. If not, even and odd products fall on all lines and can't be told by the line.
    pub is_odd: bool,
    /// Realisations M.
    pub n_realisations: usize,
    /// Periods P per realisation that were used; where there are three or more the first one, with the transient, isn't.
    pub n_periods: usize,
    /// Samples per period.
    pub period_samples: usize,
}

/// What comes out at a line that was not put in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentLine {
    /// Frequency.
    pub frequency_hz: f64,
    /// Whether the line is an odd multiple of one over the period.
    pub is_odd: bool,
    /// Amplitude of the displacement, noise taken off, not below 0.
    pub amplitude_m: f64,
    /// Amplitude that noise alone gives here (root mean square).
    pub noise_m: f64,
}

/// Spectra of command and displacement over one period.
struct Spectra {
    u: Vec<Complex64>,
    y: Vec<Complex64>,
}

/// One realisation: the mean over its periods, and each of them.
struct Realisation {
    mean: Spectra,
    periods: Vec<Spectra>,
}

/// Best linear approximation of a log with a periodic command. `period_samples` is the log's own statement, if it has one.
///
/// None if the command doesn't repeat at least twice.
///
/// # Panics
/// If the columns differ in length.
pub fn best_linear(
    command_v: &[f64],
    displacement_m: &[f64],
    dt_s: f64,
    period_samples: Option<usize>,
) -> Option<BestLinear> {
    assert_eq!(command_v.len(), displacement_m.len(), "one value per sample in every column");
    let found = repeats(command_v, period_samples);
    // One number of periods for all realisations, so that their noise weighs alike.
    let n_all = found.iter().map(|stretch| stretch.n_periods).min()?;
    let n_skipped = usize::from(n_all >= 3);
    let n_periods = n_all - n_skipped;
    let period = found[0].period_samples;
    let mut transform = Transform::new(period);
    let realisations: Vec<Realisation> = found
        .iter()
        .map(|stretch| {
            let first = stretch.n_periods - n_periods;
            let periods: Vec<Spectra> = (first..stretch.n_periods)
                .map(|period_idx| {
                    let from = stretch.start + period_idx * period;
                    let mut lines = |column: &[f64]| transform.lines(column[from..from + period].iter().copied());
                    Spectra { u: lines(command_v), y: lines(displacement_m) }
                })
                .collect();
            let mean =
                |line: &dyn Fn(&Spectra) -> Complex64| periods.iter().map(line).sum::<Complex64>() / n_periods as f64;
            let mean = Spectra {
                u: (0..=period / 2).map(|k| mean(&|one| one.u[k])).collect(),
                y: (0..=period / 2).map(|k| mean(&|one| one.y[k])).collect(),
            };
            Realisation { mean, periods }
        })
        .collect();
    let lines = driven_lines(&realisations, period);
    let last = *lines.last()?;
    let line_hz = 1.0 / (period as f64 * dt_s);
    let mut bla = BestLinear {
        frequency_hz: lines.iter().map(|&k| k as f64 * line_hz).collect(),
        gain_m_per_v: Vec::new(),
        phase_rad: Vec::new(),
        noise_m_per_v: Vec::new(),
        distortion_m_per_v: Vec::new(),
        total_m_per_v: Vec::new(),
        silent: Vec::new(),
        linear_rms_m: 0.0,
        odd_rms_m: None,
        even_rms_m: None,
        is_odd: lines.iter().all(|k| k % 2 == 1),
        n_realisations: realisations.len(),
        n_periods,
        period_samples: period,
    };
    let responses: Vec<Complex64> = lines.iter().map(|&k| at_driven_line(&mut bla, &realisations, k)).collect();
    // A sine of amplitude A has |Y| = A N / 2; its mean square is A^2 / 2.
    let m = realisations.len() as f64;
    let linear: f64 =
        lines.iter().map(|&k| realisations.iter().map(|one| one.mean.y[k].norm_sqr()).sum::<f64>() / m).sum();
    bla.linear_rms_m = (2.0 * linear).sqrt() / period as f64;

    let mut squares = [None; 2];
    let highest = (HIGHEST_PRODUCT * last).min((period - 1) / 2);
    for k in (1..=highest).filter(|k| lines.binary_search(k).is_err()) {
        let (power, noise_power) = at_silent_line(&realisations, k, interpolated(&lines, &responses, k));
        let amplitude = |power: f64| 2.0 * power.max(0.0).sqrt() / period as f64;
        bla.silent.push(SilentLine {
            frequency_hz: k as f64 * line_hz,
            is_odd: k % 2 == 1,
            amplitude_m: amplitude(power - noise_power),
            noise_m: amplitude(noise_power),
        });
        // The sum may go below zero line by line, so that noise alone adds up to nothing.
        *squares[k % 2].get_or_insert(0.0) += 2.0 * (power - noise_power) / (period as f64).powi(2);
    }
    let rms = |square: Option<f64>| square.map(|square: f64| square.max(0.0).sqrt());
    (bla.even_rms_m, bla.odd_rms_m) = (rms(squares[0]), rms(squares[1]));
    Some(bla)
}

/// Lines at which the command has power.
fn driven_lines(realisations: &[Realisation], period: usize) -> Vec<usize> {
    let power = |k: usize| realisations.iter().map(|one| one.mean.u[k].norm_sqr()).sum::<f64>();
    let inner = 1..=(period - 1) / 2;
    let largest = inner.clone().map(power).fold(0.0, f64::max);
    inner.filter(|&k| power(k) > LEAST_AMPLITUDE * LEAST_AMPLITUDE * largest && largest > 0.0).collect()
}

/// Response at line `k`, its spread written down.
fn at_driven_line(bla: &mut BestLinear, realisations: &[Realisation], k: usize) -> Complex64 {
    let m = realisations.len() as f64;
    let each: Vec<Complex64> = realisations.iter().map(|one| one.mean.y[k] / one.mean.u[k]).collect();
    let mean = each.iter().sum::<Complex64>() / m;
    // Variance of G[m] by noise: that of the mean of Y - G U over the periods, over |U|^2. Noise of a measured drive is in it.
    let noise: f64 = realisations
        .iter()
        .zip(&each)
        .map(|(one, g)| {
            variance_of_mean(one.periods.iter().map(|period| period.y[k] - g * period.u[k])) / one.mean.u[k].norm_sqr()
        })
        .sum::<f64>()
        / (m * m);
    bla.gain_m_per_v.push(mean.norm());
    bla.phase_rad.push(mean.arg());
    bla.noise_m_per_v.push(noise.sqrt());
    if realisations.len() > 1 {
        let total = variance_of_mean(each.iter().copied());
        bla.total_m_per_v.push(total.sqrt());
        bla.distortion_m_per_v.push((m * (total - noise)).max(0.0).sqrt());
    }
    mean
}

/// Mean |Y|^2 at line `k` over the realisations, less what `g` makes of the drive's own power there, and the part of it that is noise.
fn at_silent_line(realisations: &[Realisation], k: usize, g: Complex64) -> (f64, f64) {
    let m = realisations.len() as f64;
    let power: f64 = realisations.iter().map(|one| (one.mean.y[k] - g * one.mean.u[k]).norm_sqr()).sum();
    let noise: f64 = realisations
        .iter()
        .map(|one| variance_of_mean(one.periods.iter().map(|period| period.y[k] - g * period.u[k])))
        .sum();
    (power / m, noise / m)
}

/// Response at a silent line from its driven neighbours, for the little that a real drive puts in there.
fn interpolated(lines: &[usize], responses: &[Complex64], k: usize) -> Complex64 {
    let above = lines.partition_point(|&line| line < k);
    if above == 0 || above == lines.len() {
        return responses[above.min(lines.len() - 1)];
    }
    let (low, high) = (lines[above - 1], lines[above]);
    let part = (k - low) as f64 / (high - low) as f64;
    responses[above - 1] * (1.0 - part) + responses[above] * part
}

/// Sample variance over n, `sum |x - mean|^2 / (n (n - 1))`.
fn variance_of_mean(values: impl Iterator<Item = Complex64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<Complex64>() / n;
    values.map(|value| (value - mean).norm_sqr()).sum::<f64>() / (n * (n - 1.0))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{lag, lag_response, white};
    use super::*;
    use std::f64::consts::TAU;

    const DT_S: f64 = 5e-5;
    const PERIOD: usize = 2000;

    /// `n_periods` periods each of several multisines of unit rms with the given lines and seeded random phases.
    fn multisines(lines: &[usize], n_periods: usize, n_realisations: usize) -> Vec<f64> {
        (0..n_realisations)
            .flat_map(|realisation_idx| {
                let phases = white(lines.len(), 100 + realisation_idx as u64);
                let amplitude = (2.0 / lines.len() as f64).sqrt();
                let one: Vec<f64> = (0..PERIOD)
                    .map(|n| {
                        lines
                            .iter()
                            .zip(&phases)
                            // Normal numbers times ten are uniform enough modulo one turn.
                            .map(|(&k, phase)| amplitude * (TAU * (k * n) as f64 / PERIOD as f64 + 10.0 * phase).cos())
                            .sum()
                    })
                    .collect();
                one.repeat(n_periods)
            })
            .collect()
    }

    /// Odd lines to 99, every fourth left out.
    fn odd_lines() -> Vec<usize> {
        (0..50).filter(|idx| idx % 4 != 2).map(|idx| 2 * idx + 1).collect()
    }

    #[test]
    fn a_linear_lag_has_its_response_its_noise_and_no_distortion() {
        let a = 0.9;
        let command = multisines(&odd_lines(), 5, 6);
        let sigma = 0.01;
        let output: Vec<f64> =
            lag(&command, a).iter().zip(white(command.len(), 7)).map(|(y, e)| y + sigma * e).collect();
        let found = best_linear(&command, &output, DT_S, None).expect("periodic");
        assert_eq!((found.n_realisations, found.n_periods, found.period_samples), (6, 4, PERIOD));
        assert!(found.is_odd && found.frequency_hz.len() == odd_lines().len());
        let n_lines = found.frequency_hz.len() as f64;
        let (mut squares, mut noise, mut total) = (0.0, 0.0, 0.0);
        for k in 0..found.frequency_hz.len() {
            let (gain, phase_rad) = lag_response(a, found.frequency_hz[k] * DT_S);
            let error = Complex64::from_polar(found.gain_m_per_v[k], found.phase_rad[k])
                - Complex64::from_polar(gain, phase_rad);
            squares += error.norm_sqr();
            noise += found.noise_m_per_v[k].powi(2);
            total += found.total_m_per_v[k].powi(2);
        }
        // |E|^2 = N sigma^2 per period and line, |U| = N/2 sqrt(2/L); means over 4 periods and 6 realisations.
        let expected = n_lines * (2.0 * n_lines / PERIOD as f64 * sigma * sigma / 24.0);
        // L M (P - 1) complex degrees of freedom for the noise, L (M - 1) for the total, L for the error; five sigma each.
        let within = |ratio: f64, freedoms: f64| (ratio - 1.0).abs() < 5.0 / freedoms.sqrt();
        assert!(within(noise / expected, n_lines * 18.0), "noise {}", noise / expected);
        assert!(within(total / expected, n_lines * 5.0), "total {}", total / expected);
        assert!(within(squares / expected, n_lines), "error {}", squares / expected);
        // Silent lines: 2 sigma^2 / N per line is the noise's mean square there, over 24 means and some 225 lines of fluctuation.
        let bound = 3.0 * sigma * (2.0 / PERIOD as f64 / 24.0 * 225f64.sqrt()).sqrt();
        assert!(found.odd_rms_m.is_some_and(|rms| rms < bound) && found.even_rms_m.is_some_and(|rms| rms < bound));
    }

    /// Odd and even rms over the linear rms of a static `y = f(u)` with a little noise.
    fn distortion(f: fn(f64) -> f64) -> BestLinear {
        let command = multisines(&odd_lines(), 4, 3);
        let output: Vec<f64> = command.iter().zip(white(command.len(), 8)).map(|(&u, e)| f(u) + 1e-4 * e).collect();
        best_linear(&command, &output, DT_S, Some(PERIOD)).expect("periodic")
    }

    #[test]
    fn a_cubic_distorts_odd_lines_only_and_raises_the_gain_by_three() {
        let found = distortion(|u| u + 0.01 * u * u * u);
        let (odd, even) = (found.odd_rms_m.expect("odd silent lines"), found.even_rms_m.expect("even silent lines"));
        // Of a Gaussian signal of unit rms, u^3 = 3 u + H3 with <H3^2> = 6: the gain rises by 3 a, and a sqrt(6) is distortion, of which
        // some falls on driven lines. A multisine of 37 lines is nearly Gaussian.
        assert!((0.5..1.0).contains(&(odd / (0.01 * 6f64.sqrt()))), "{odd}");
        // 1e-4 of noise on 12 means of 2000 samples, some hundreds of lines.
        assert!(even < 1e-5, "{even}");
        let gain = found.gain_m_per_v.iter().sum::<f64>() / found.gain_m_per_v.len() as f64;
        assert!((gain - 1.03).abs() < 0.005, "{gain}");
        // Distortion of one realisation dwarfs the noise.
        let distortion = found.distortion_m_per_v.iter().sum::<f64>() / found.distortion_m_per_v.len() as f64;
        assert!(distortion > 100.0 * found.noise_m_per_v[0], "{distortion}");
    }

    #[test]
    fn a_square_distorts_even_lines_only() {
        let found = distortion(|u| u + 0.01 * u * u);
        let (odd, even) = (found.odd_rms_m.expect("odd silent lines"), found.even_rms_m.expect("even silent lines"));
        // Of a Gaussian, u^2 = 1 + H2 with <H2^2> = 2; lines beyond 0 hold it all.
        assert!((0.9..1.05).contains(&(even / (0.01 * 2f64.sqrt()))), "{even}");
        assert!(odd < 1e-5, "{odd}");
        assert!(found.silent.iter().filter(|line| line.is_odd).all(|line| line.amplitude_m < 2e-5));
    }

    #[test]
    fn one_realisation_gives_noise_and_silent_lines_but_no_spread() {
        let command = multisines(&odd_lines(), 2, 1);
        let found = best_linear(&command, &command, DT_S, None).expect("two periods");
        assert_eq!((found.n_realisations, found.n_periods), (1, 2));
        assert!(found.distortion_m_per_v.is_empty() && found.gain_m_per_v.iter().all(|gain| (gain - 1.0).abs() < 1e-9));
        assert_eq!(best_linear(&command[..PERIOD], &command[..PERIOD], DT_S, None), None);
    }
}
