//! Residuals and noise: how large the noise is, and whether what is left is more than noise.

/// Lags up to which the residual's autocorrelation is reported.
pub const LAGS: usize = 50;
/// Samples that the noise is taken from at the most, and the stretches that they come in: a million give it to a part in a thousand.
const MOST_SAMPLES: usize = 1_000_000;
const STRETCH_SAMPLES: usize = 4096;
/// Two-sided 99 % point of the normal distribution.
const NORMAL_99: f64 = 2.5758;

/// Autocorrelation of a residual with the region in which 99 % of the lags of white noise lie.
#[derive(Clone, Debug, PartialEq)]
pub struct Autocorrelation {
    /// Correlation at lags 0, 1, 2, ..; the first is one.
    pub correlation: Vec<f64>,
    /// Half-width of the 99 % region for lags > 0, 2.58/sqrt(N).
    pub region99: f64,
}

impl Autocorrelation {
    /// Of `residual`, its mean taken out, up to `lags`.
    pub fn of(residual: &[f64], lags: usize) -> Self {
        let n = residual.len();
        let mean = residual.iter().sum::<f64>() / n.max(1) as f64;
        let at = |lag: usize| -> f64 {
            residual.iter().zip(&residual[lag.min(n)..]).map(|(a, b)| (a - mean) * (b - mean)).sum()
        };
        let power = at(0);
        let correlation =
            (0..=lags.min(n.saturating_sub(1))).map(|lag| if power > 0.0 { at(lag) / power } else { 0.0 }).collect();
        Self { correlation, region99: NORMAL_99 / (n.max(1) as f64).sqrt() }
    }

    /// Lags > 0 outside the 99 % region; about 1 % of them for white noise.
    pub fn outside(&self) -> usize {
        self.correlation.iter().skip(1).filter(|c| c.abs() > self.region99).count()
    }
}

/// Samples per independent sample, >= 1: 1 + 2 sum of the autocorrelations up to the first that is not positive (Geyer).
///
/// Beyond lag 32 lags are spaced by a tenth, and the sum becomes an integral: a slow residual would need millions of them.
pub fn samples_per_independent(residual: &[f64]) -> f64 {
    let n = residual.len();
    let mean = residual.iter().sum::<f64>() / n.max(1) as f64;
    let at = |lag: usize| -> f64 { residual.iter().zip(&residual[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum() };
    let power = at(0);
    if power == 0.0 {
        return 1.0;
    }
    let (mut sum, mut lag, mut last) = (0.0, 0, 1.0);
    loop {
        let next = lag + 1 + if lag < 32 { 0 } else { lag / 10 };
        if next >= n / 2 {
            break;
        }
        let correlation = at(next) / power;
        if correlation <= 0.0 {
            break;
        }
        // Unit spacing adds the correlation itself; wider spacing the trapezoid.
        let width = (next - lag) as f64;
        sum += if width == 1.0 { correlation } else { 0.5 * width * (last + correlation) };
        (lag, last) = (next, correlation);
    }
    1.0 + 2.0 * sum
}

/// Akaike's and the Bayesian criterion of a fit with so many `coordinates` that leaves of each log the second in the first independent samples;
/// less is better. Each log counts in units of what it leaves itself: pooled, the worst would drown the others.
pub(crate) fn aic_bic(samples_and_rms_m: &[[f64; 2]], coordinates: usize) -> [f64; 2] {
    let count = coordinates as f64;
    let samples: f64 = samples_and_rms_m.iter().map(|[samples, _]| samples).sum();
    let left: f64 = samples_and_rms_m.iter().map(|[samples, rms_m]| samples * 2.0 * rms_m.ln()).sum();
    // Correlation may leave less than one sample, and more coordinates are not rewarded.
    [2.0 * count, count * samples.max(2.0).ln()].map(|penalty| left + penalty)
}

/// Rms of the white noise in `signal`, from its differences.
///
/// The d-th difference of white noise of variance s^2 has variance s^2 C(2d, d), while that of a smooth signal falls with every
/// order; the smallest estimate over orders 2 to 6 is taken. A median makes it blind to the few samples around steps.
/// It is an upper bound where the signal itself is rough from sample to sample. Of a long signal, stretches all over it are enough.
pub fn noise_rms(signal: &[f64]) -> f64 {
    noise_rms_on(signal, 0.0)
}

/// The same where the readings lie on a lattice of this `step`, rounding included; none if it is zero.
pub(crate) fn noise_rms_on(signal: &[f64], step: f64) -> f64 {
    let every = signal.len().div_ceil(MOST_SAMPLES);
    let length = if every > 1 { STRETCH_SAMPLES } else { signal.len().max(1) };
    let mut stretches: Vec<Vec<f64>> = signal.chunks(length).step_by(every.max(1)).map(<[f64]>::to_vec).collect();
    let mut binomial = 1.0; // C(2d, d)
    let mut smallest = f64::INFINITY;
    for order in 1..=6u32 {
        for differences in &mut stretches {
            for k in 1..differences.len() {
                differences[k - 1] = differences[k] - differences[k - 1];
            }
            differences.pop();
        }
        if stretches.iter().map(Vec::len).sum::<usize>() < 15 {
            break;
        }
        let d = f64::from(order);
        binomial *= 2.0 * (2.0 * d - 1.0) / d;
        if order >= 2 {
            let differences = stretches.iter().flatten().copied().collect();
            smallest = smallest.min(median_magnitude_on(differences, step) / 0.6745 / f64::sqrt(binomial));
        }
    }
    if smallest.is_finite() { smallest } else { 0.0 }
}

/// Median of the magnitudes of `values`, of which there must be one.
pub(crate) fn median_magnitude(values: Vec<f64>) -> f64 {
    median_magnitude_on(values, 0.0)
}

/// The same of values on a lattice of this `step`, each of which stands for all within half a step of it (the median of grouped data).
fn median_magnitude_on(mut values: Vec<f64>, step: f64) -> f64 {
    values.iter_mut().for_each(|value| *value = value.abs());
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
    if step <= 0.0 {
        return median;
    }
    let from = ((median / step).round() - 0.5).max(0.0) * step;
    let to = ((median / step).round() + 0.5) * step;
    let below = values.iter().filter(|value| **value < from).count() as f64;
    let within = values.iter().filter(|value| (from..to).contains(*value)).count().max(1) as f64;
    from + (to - from) * (0.5 * values.len() as f64 - below) / within
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White noise of unit variance from a seeded generator that needs no dependency: sums of uniform numbers.
    fn white(n: usize) -> Vec<f64> {
        let mut state = 7u64;
        let mut uniform = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    #[test]
    fn noise_under_a_smooth_signal_is_found() {
        let noise = white(20_000);
        let signal: Vec<f64> =
            noise.iter().enumerate().map(|(k, n)| 0.02 * n + 50.0 * (k as f64 * 0.01).sin()).collect();
        // 20000 samples give the median to about 1.2 %; the smallest of five estimates lies a little low.
        let found = noise_rms(&signal) / 0.02;
        assert!((0.95..1.03).contains(&found), "{found}");
        // A hundred times as long: a few stretches of it are as good.
        let found = noise_rms(&signal.repeat(100)) / 0.02;
        assert!((0.95..1.03).contains(&found), "{found}");
    }

    #[test]
    fn white_noise_stays_inside_the_region_and_a_sine_does_not() {
        let white = Autocorrelation::of(&white(20_000), LAGS);
        assert!(white.outside() <= 4, "{}", white.outside());
        assert!(samples_per_independent(&self::white(20_000)) < 1.2);
        let sine: Vec<f64> = (0..20_000).map(|k| (f64::from(k) * 0.05).sin()).collect();
        assert!(Autocorrelation::of(&sine, LAGS).outside() > 40);
    }

    #[test]
    fn a_first_order_residual_has_its_textbook_correlation_time() {
        let mut level = 0.0;
        let a = 0.98;
        let slow: Vec<f64> = white(400_000)
            .iter()
            .map(|w| {
                level = a * level + w;
                level
            })
            .collect();
        // (1 + a) / (1 - a) = 99; 4000 independent samples leave several per cent, and stopping at zero a little more.
        let found = samples_per_independent(&slow);
        assert!((80.0..130.0).contains(&found), "{found}");
    }
}
