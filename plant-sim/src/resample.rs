//! The band-limited signal through samples, as short straight pieces that the plant is stepped through.
//!
//! A generator with a reconstruction filter doesn't hold its samples, it plays the band-limited signal u(t) = sum_k u_k sinc(t/T - k).
//! Here the sinc is cut to [`AHEAD`] samples on either side by a Kaiser window, and the signal is a straight line between
//! [`PIECES`] points per sample. Beyond the ends of a log the first and the last sample are held, and the window is all that
//! has to be known in advance, so that a log of any length streams.
//!
//! | source of error | size, in parts of a sine's amplitude |
//! | --- | --- |
//! | straight pieces | (omega T / PIECES)^2 / 8: 7.9e-5 at 0.4 of Nyquist, 3.2e-4 at 0.8 |
//! | cut sinc | 118 dB below (1.3e-6) up to 0.88 of Nyquist (Kaiser's formula for 64 samples and beta 12) |
//!
//! What it does not do: guess whether a command is band-limited; the log's `hold` says so.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Straight pieces per sample.
pub const PIECES: usize = 50;

/// Samples on either side of an instant that have a part in it.
pub const AHEAD: usize = 32;

/// Shape of the Kaiser window: the larger, the smaller the error and the narrower the band.
const BETA: f64 = 12.0;

/// Turns samples, one by one, into the points of the band-limited signal.
#[derive(Default)]
pub struct Resampler {
    /// The samples before the present one, the oldest first; empty before the first.
    past: Vec<f64>,
}

/// For each point within a sample, the weights of the samples around it, the oldest first. Made once: a fit resamples thousands of times.
static WEIGHTS: LazyLock<Vec<[f64; 2 * AHEAD]>> =
    LazyLock::new(|| (1..PIECES).map(|piece| weights(piece as f64 / PIECES as f64)).collect());

impl Resampler {
    /// The signal at the [`PIECES`] + 1 equidistant instants from the present sample, `window[0]`, to the next, both included.
    ///
    /// `window` goes on with the samples after the present one, [`AHEAD`] of them. Where it has fewer the last one is held.
    pub fn points(&mut self, window: &[f64]) -> [f64; PIECES + 1] {
        let present = window.first().copied().unwrap_or(0.0);
        let last = window.last().copied().unwrap_or(present);
        if self.past.is_empty() {
            self.past = vec![present; AHEAD - 1];
        }
        let mut around = [last; 2 * AHEAD];
        around[..AHEAD - 1].copy_from_slice(&self.past);
        let known = window.len().min(AHEAD + 1);
        around[AHEAD - 1..AHEAD - 1 + known].copy_from_slice(&window[..known]);

        let mut points = [present; PIECES + 1];
        for (point, weights) in points[1..PIECES].iter_mut().zip(WEIGHTS.iter()) {
            // About the present sample, so that a constant comes back as itself and not as a sum of roundings.
            *point =
                present + weights.iter().zip(&around).map(|(weight, sample)| weight * (sample - present)).sum::<f64>();
        }
        points[PIECES] = around[AHEAD];
        self.past.rotate_left(1);
        self.past[AHEAD - 2] = present;
        points
    }
}

/// Weights of the samples -AHEAD + 1 ..= AHEAD at `fraction` of the way from sample 0 to sample 1. They add up to one.
fn weights(fraction: f64) -> [f64; 2 * AHEAD] {
    let mut weights = [0.0; 2 * AHEAD];
    for (index, weight) in weights.iter_mut().enumerate() {
        let distance = index as f64 - (AHEAD as f64 - 1.0) - fraction;
        let reach = distance / AHEAD as f64;
        *weight = (PI * distance).sin() / (PI * distance) * bessel_i0(BETA * (1.0 - reach * reach).max(0.0).sqrt());
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// Modified Bessel function of the first kind, order zero: its power series, which converges for every argument.
fn bessel_i0(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let (mut sum, mut term, mut n) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum {
        term *= quarter / (n * n);
        sum += term;
        n += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest distance of the pieces from the sine through the samples, at points and half-way between them, away from the ends.
    fn error(of_nyquist: f64) -> (f64, f64) {
        let omega = PI * of_nyquist;
        let signal = |t: f64| (omega * t + 0.3).sin();
        let samples: Vec<f64> = (0..400).map(|k| signal(f64::from(k))).collect();
        let mut resampler = Resampler::default();
        let (mut at_points, mut between) = (0.0f64, 0.0f64);
        for k in 0..samples.len() {
            let points = resampler.points(&samples[k..(k + 1 + AHEAD).min(samples.len())]);
            if k < AHEAD || k + AHEAD >= samples.len() {
                continue;
            }
            for piece in 0..PIECES {
                let t = k as f64 + piece as f64 / PIECES as f64;
                at_points = at_points.max((points[piece] - signal(t)).abs());
                let middle = (points[piece] + points[piece + 1]) / 2.0;
                between = between.max((middle - signal(t + 0.5 / PIECES as f64)).abs());
            }
        }
        (at_points, between)
    }

    #[test]
    fn sines_come_back_within_the_errors_of_the_table() {
        for of_nyquist in [0.01, 0.1, 0.25, 0.4, 0.6, 0.8, 0.87] {
            let (at_points, between) = error(of_nyquist);
            // Kaiser's formula is accurate to about 1 dB; 3e-6 is 7 dB above the 118 dB of the table.
            assert!(at_points < 3e-6, "{of_nyquist}: {at_points:e}");
            let straight = (PI * of_nyquist / PIECES as f64).powi(2) / 8.0;
            assert!(between < straight + 3e-6, "{of_nyquist}: {between:e}, pieces alone {straight:e}");
            if of_nyquist <= 0.4 {
                assert!(between < 1e-4);
            } else {
                // Too good would mean that the distance isn't measured.
                assert!(between > 0.9 * straight);
            }
        }
    }

    #[test]
    fn beyond_the_band_the_sinc_is_cut() {
        // The promise ends somewhere: at 0.97 of Nyquist the error is three orders larger.
        assert!(error(0.97).0 > 1e-3);
    }

    #[test]
    fn constants_and_samples_come_back_to_the_bit_and_the_ends_are_held() {
        let mut resampler = Resampler::default();
        assert!(resampler.points(&[0.1; AHEAD + 1]).iter().all(|point| *point == 0.1));
        // A step: every row starts at its sample and ends at the next one, and with the window short the last sample is held.
        let samples: Vec<f64> = (0..80).map(|k| if k < 40 { 0.1 } else { 7.3 }).collect();
        let mut resampler = Resampler::default();
        for k in 0..samples.len() {
            let points = resampler.points(&samples[k..]);
            assert_eq!(points[0], samples[k]);
            assert_eq!(points[PIECES], samples[(k + 1).min(samples.len() - 1)]);
        }
        assert_eq!(Resampler::default().points(&[0.25]), [0.25; PIECES + 1]);
    }

    #[test]
    fn the_bessel_function_agrees_with_tables() {
        // Abramowitz and Stegun, table 9.8 and 9.11: I0(1) = 1.2660658777520084, I0(10) = 2815.716628466254.
        assert!((bessel_i0(1.0) - 1.266_065_877_752_008_4).abs() < 1e-15);
        assert!((bessel_i0(10.0) / 2_815.716_628_466_254 - 1.0).abs() < 1e-14);
    }
}
