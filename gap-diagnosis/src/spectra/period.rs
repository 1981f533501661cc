//! Repeated periods of a drive: found from its autocorrelation where the log doesn't state them.

use realfft::RealFftPlanner;

/// Periods shorter than this are not looked for: nothing but the fundamental would fit in.
const MIN_PERIOD_SAMPLES: usize = 8;
/// Two periods are the same if they differ by less than this part of their rms. A converter's steps and a monitor's noise stay
/// below, a period that decays by 5 % does not.
const SAME_PERIOD: f64 = 0.05;
/// Longest stretch of which the autocorrelation is taken: 2^20 samples hold two periods of 13 s at 40 kHz.
const LONGEST_SEARCH: usize = 1 << 20;

/// A stretch in which the drive repeats itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repeats {
    /// First sample.
    pub start: usize,
    /// Samples per period.
    pub period_samples: usize,
    /// Whole periods, at least 2.
    pub n_periods: usize,
}

/// Stretches of `signal` (command or reference, any unit) in which it repeats itself, in order. Several realisations of a multisine
/// in one log give one stretch each.
///
/// `period_samples` is the log's own statement, if it has one; without it the lag is taken at which the autocorrelation says that
/// the signal comes back to itself. Rests before and after are cut off.
pub fn repeats(signal: &[f64], period_samples: Option<usize>) -> Vec<Repeats> {
    let (from, to) = moving_part(signal);
    let moving = &signal[from..to];
    let Some(period) = period_samples.filter(|&period| period > 0).or_else(|| period_of(moving)) else {
        return Vec::new();
    };
    // A log may state anything.
    if period > signal.len() {
        return Vec::new();
    }
    // The sample before the first change belongs to the first period if it comes back: a sine begins at its resting value.
    let is_first =
        |before: usize| signal.get(before + period).is_some_and(|&later| (later - signal[before]).abs() < 1e-9);
    let from = if from > 0 && is_first(from - 1) { from - 1 } else { from };
    let moving = &signal[from..to];
    let mut found: Vec<Repeats> = Vec::new();
    let mut at = 0;
    // A stated period counts from the first motion. The last sample of a signal may be missing from a whole period; then it is no period.
    while at + 2 * period <= moving.len() {
        let is_same = is_same_period(&moving[at..at + period], &moving[at + period..at + 2 * period]);
        match found.last_mut() {
            Some(last) if is_same && last.start + (last.n_periods - 1) * period == from + at => last.n_periods += 1,
            _ if is_same => found.push(Repeats { start: from + at, period_samples: period, n_periods: 2 }),
            _ => {}
        }
        at += period;
    }
    found
}

/// Range without the constant beginning and end.
fn moving_part(signal: &[f64]) -> (usize, usize) {
    let Some((&first, &last)) = signal.first().zip(signal.last()) else {
        return (0, 0);
    };
    let n_before = signal.iter().take_while(|&&value| value == first).count();
    let from = if n_before > 1 { n_before } else { 0 };
    // A signal that ends in motion has a last value that comes once; one at rest repeats it.
    let n_resting = signal.iter().rev().take_while(|&&value| value == last).count();
    let to = if n_resting > 1 { signal.len() - n_resting } else { signal.len() };
    if from < to { (from, to) } else { (0, 0) }
}

fn is_same_period(one: &[f64], other: &[f64]) -> bool {
    let mean = one.iter().sum::<f64>() / one.len() as f64;
    let power: f64 = one.iter().map(|value| (value - mean).powi(2)).sum();
    let change: f64 = one.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum();
    power > 0.0 && change < SAME_PERIOD * SAME_PERIOD * power
}

/// The lag at which the signal is most like itself, `sum (u[k+p] - u[k])^2` per sample over twice the variance; the smallest such lag.
fn period_of(signal: &[f64]) -> Option<usize> {
    let signal = &signal[..signal.len().min(LONGEST_SEARCH)];
    let n = signal.len();
    if n < 2 * MIN_PERIOD_SAMPLES {
        return None;
    }
    let mean = signal.iter().sum::<f64>() / n as f64;
    let centred: Vec<f64> = signal.iter().map(|value| value - mean).collect();
    let correlation = autocovariance(&centred);
    let mut energy_before = vec![0.0; n + 1];
    for (k, value) in centred.iter().enumerate() {
        energy_before[k + 1] = energy_before[k] + value * value;
    }
    let variance = energy_before[n] / n as f64;
    if variance == 0.0 {
        return None;
    }
    let change: Vec<f64> = (0..=n / 2)
        .map(|lag| {
            let both = energy_before[n - lag] + energy_before[n] - energy_before[lag];
            (both - 2.0 * correlation[lag]) / ((n - lag) as f64 * 2.0 * variance)
        })
        .collect();
    // A smooth signal is like itself at small lags too: begin beyond the first lag at which it is not.
    let beyond = change.iter().position(|&change| change > 0.5)?.max(MIN_PERIOD_SAMPLES);
    let least = change[beyond..].iter().copied().fold(f64::INFINITY, f64::min);
    // Half of the lags across the borders of realisations of two periods each differ: a change of 0.5 there.
    if least > 0.6 {
        return None;
    }
    // 0.002: a period that is no whole number of samples comes back only nearly, 133.33 samples with a change of 1e-4.
    let is_dip = |lag: usize| {
        change[lag] <= least + 2e-3
            && change[lag] <= change[lag - 1]
            && (lag == n / 2 || change[lag] <= change[lag + 1])
    };
    (beyond.max(1)..=n / 2).find(|&lag| is_dip(lag))
}

/// `sum_k x[k] x[k+lag]` for every lag, by FFT of twice the length.
fn autocovariance(values: &[f64]) -> Vec<f64> {
    let length = (2 * values.len()).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let mut padded = values.to_vec();
    padded.resize(length, 0.0);
    let mut lines = forward.make_output_vec();
    forward.process(&mut padded, &mut lines).expect("buffers come from the plan");
    for line in &mut lines {
        *line = (line.norm_sqr() / length as f64).into();
    }
    inverse.process(&mut lines, &mut padded).expect("buffers come from the plan, lines 0 and N/2 are real");
    padded.truncate(values.len());
    padded
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A multisine of `n_lines` lines in `period` samples with phases from `seed`.
    fn multisine(period: usize, seed: usize) -> Vec<f64> {
        (0..period)
            .map(|k| {
                (1..=20)
                    .map(|line| {
                        (TAU * ((line * k) as f64 / period as f64 + ((line * line * seed) as f64 * 0.618).fract()))
                            .cos()
                    })
                    .sum()
            })
            .collect()
    }

    #[test]
    fn what_a_log_states_may_be_longer_than_it() {
        let signal = multisine(500, 1).repeat(3);
        for stated in [signal.len() + 1, usize::MAX / 2 + 1, usize::MAX] {
            assert_eq!(repeats(&signal, Some(stated)), []);
        }
    }

    #[test]
    fn realisations_with_a_rest_before_and_after_are_told_apart() {
        let mut signal = vec![0.0; 700];
        for seed in [1, 2, 3] {
            signal.extend(multisine(500, seed).repeat(4));
        }
        signal.extend([0.0; 333]);
        let expected = [0, 1, 2].map(|r| Repeats { start: 700 + 2000 * r, period_samples: 500, n_periods: 4 });
        for stated in [None, Some(500)] {
            assert_eq!(repeats(&signal, stated), expected);
        }
    }

    #[test]
    fn a_sine_of_no_whole_period_is_found_to_the_nearest_sample() {
        let sine: Vec<f64> = (0..4000).map(|k| 50.0 + 20.0 * (TAU * f64::from(k) * 150.0 / 20_000.0).sin()).collect();
        let found = repeats(&sine, None);
        // 133.33 samples: a third of a sample is 1.6 % of a period.
        assert_eq!((found.len(), found[0].period_samples), (1, 133), "{found:?}");
    }

    #[test]
    fn what_does_not_repeat_has_no_period() {
        let steps: Vec<f64> =
            (0..9000).map(|k| [0.0, 20.0, 40.0, 60.0, 30.0, 0.0, -30.0, -60.0, -20.0][k / 1000]).collect();
        let decaying: Vec<f64> =
            (0..9000).map(|k| 60.0 * (-f64::from(k) / 3000.0).exp() * (f64::from(k) * 0.01).sin()).collect();
        for signal in [vec![], vec![1.0], vec![2.0; 1000], multisine(1000, 1), steps, decaying] {
            assert_eq!(repeats(&signal, None), []);
        }
    }
}
