//! Parts that act on a row after the noise of the sensor, and that noise: excess noise, converters, lost rows.

use crate::drive::Memory;
use crate::sensor::{Row, normal};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// A part that acts on one row after the noise.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Digitise {
    /// More white noise than the data sheet says, rms in metres.
    White { m: f64 },
    /// First-order low-pass noise of the given rms.
    Coloured { m: f64, corner_hz: f64 },
    /// PSD a + b/f: white plus a sum of low-pass noises spaced by a factor of four, rms in metres each way.
    Flicker { white_m: f64, flicker_m: f64 },
    /// Bursts: a share of the rows has noise of the given rms.
    Bursts { m: f64, mean_s: f64 },
    /// Noise about a frequency, as a pick-up or a sound has it: two poles, unit rms times `m`.
    Band { m: f64, hz: f64, width_hz: f64 },
    /// Differences of white noise: noise that a modulator has shaped away from low frequencies.
    Shaped { m: f64 },
    /// A share of the rows, each for itself, is hit by a pulse; rms over all rows is `m`.
    Spikes { m: f64, share: f64 },
    /// Jumps between +m and -m after random dwells: popcorn noise.
    Popcorn { m: f64, mean_s: f64 },
    /// Student's t with a few degrees of freedom: white, with heavy tails.
    HeavyTails { m: f64, degrees: u32 },
    /// White noise whose size swings about its mean with twice the mains' frequency: an optical head under a lamp.
    Lamp { m: f64, hz: f64, depth: f64 },
    /// Random hits that each ring down: sparks and switches nearby; rms over all rows is `m`.
    Crackle { m: f64, hits_per_s: f64, hz: f64, decay_s: f64 },
    /// Noise of a converter that is slower than the rows: each draw stays for some of them.
    Held { m: f64, rows: u32 },
    /// White noise that grows with time to the given rms: an amplifier that warms.
    Warming { m: f64, tau_s: f64 },
    /// Rounded to a lattice (anchors F19).
    Lattice { m: f64 },
    /// Cut downwards instead of rounded, with half a step added back on average.
    Truncation { m: f64 },
    /// Codes that are wide and narrow by turns: (1 + skew) and (1 - skew) steps, each shown by its middle.
    UnevenCodes { m: f64, skew: f64 },
    /// The code changes only where the reading is `hold` steps beyond its edge: a comparator's hysteresis.
    HeldCodes { m: f64, hold: f64 },
    /// A short floating-point number: the step halves with each octave below `full_m`, eight times.
    Floating { m: f64, full_m: f64 },
    /// One code in `every` is missing: its readings show the one below.
    MissingCodes { m: f64, every: u32 },
    /// Rounded after a triangular dither of two steps' width.
    Dithered { m: f64 },
    /// A lost row shows the running mean of those that came, over `rows`.
    Filled { probability: f64, rows: f64 },
    /// A lost row shows the one `rows` earlier, that its buffer still held; at most 12.
    Stale { probability: f64, rows: u32 },
    /// After a lost row the stream is one row late until it is put in step again, `rows` later.
    OutOfStep { probability: f64, rows: u32 },
    /// A row repeats the one before with this probability (anchors F17).
    Repeat { probability: f64 },
    /// Runs of `length` rows repeat the one before them.
    Burst { probability: f64, length: u32 },
    /// Runs of lost rows go on along the line through the last two.
    CarriedOn { probability: f64, length: u32 },
    /// Runs of `length` rows repeat the one before them, at equal distances: another task that comes round.
    Regular { share: f64, length: u32 },
    /// For a while of `rows` only one row in `every` is a new one: a link that is busy.
    Thinned { probability: f64, rows: u32, every: u32 },
    /// A lost packet of `rows` shows the packet before once more; at most 12.
    Replayed { probability: f64, rows: u32 },
}

/// Where a part that acts after the noise stands, in the order of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum DigitisePlace {
    /// Noise, which the converter sees.
    Noise,
    /// The converter.
    Converter,
    /// The link, which loses what was converted.
    Link,
}

impl Digitise {
    /// Where the part stands, whatever it was planted with.
    pub(crate) fn place(&self) -> DigitisePlace {
        match self {
            Digitise::White { .. }
            | Digitise::Coloured { .. }
            | Digitise::Flicker { .. }
            | Digitise::Bursts { .. }
            | Digitise::Band { .. }
            | Digitise::Shaped { .. }
            | Digitise::Spikes { .. }
            | Digitise::Popcorn { .. }
            | Digitise::HeavyTails { .. }
            | Digitise::Lamp { .. }
            | Digitise::Crackle { .. }
            | Digitise::Held { .. }
            | Digitise::Warming { .. } => DigitisePlace::Noise,
            Digitise::Lattice { .. }
            | Digitise::Truncation { .. }
            | Digitise::UnevenCodes { .. }
            | Digitise::HeldCodes { .. }
            | Digitise::Floating { .. }
            | Digitise::MissingCodes { .. }
            | Digitise::Dithered { .. } => DigitisePlace::Converter,
            Digitise::Filled { .. }
            | Digitise::Stale { .. }
            | Digitise::OutOfStep { .. }
            | Digitise::Repeat { .. }
            | Digitise::Burst { .. }
            | Digitise::CarriedOn { .. }
            | Digitise::Regular { .. }
            | Digitise::Thinned { .. }
            | Digitise::Replayed { .. } => DigitisePlace::Link,
        }
    }

    /// Reading in metres, given the noisy one.
    pub(crate) fn read(&self, m: &mut Memory, x: f64, row: &Row, rng: &mut Pcg64) -> f64 {
        match self {
            Digitise::White { m: rms } => x + rms * normal(rng),
            Digitise::Coloured { m: rms, corner_hz } => x + rms * low_pass(&mut m[0], *corner_hz, row, rng),
            Digitise::Flicker { white_m, flicker_m } => {
                // Eight octave pairs from 0.5 Hz up; equal power each gives 1/f.
                let mut sum = 0.0;
                let mut corner_hz = 0.5;
                for state in &mut m[0..7] {
                    sum += low_pass(state, corner_hz, row, rng);
                    corner_hz *= 4.0;
                }
                x + white_m * normal(rng) + flicker_m * sum / 7.0_f64.sqrt()
            }
            Digitise::Bursts { m: rms, mean_s } => {
                if rng.random::<f64>() < row.period_s / mean_s {
                    m[0] = 1.0 - m[0];
                }
                x + rms * m[0] * normal(rng)
            }
            Digitise::Band { m: rms, hz, width_hz } => {
                let radius = (-0.5 * TAU * width_hz * row.period_s).exp();
                let (a, b) = (2.0 * radius * (TAU * hz * row.period_s).cos(), radius * radius);
                let next = a * m[0] - b * m[1] + normal(rng) / two_pole_variance(a, b).sqrt();
                (m[0], m[1]) = (next, m[0]);
                x + rms * next
            }
            Digitise::Shaped { m: rms } => {
                let before = m[0];
                m[0] = normal(rng);
                x + rms * (m[0] - before) / std::f64::consts::SQRT_2
            }
            Digitise::Spikes { m: rms, share } => {
                let size = rms / share.sqrt() * normal(rng);
                if rng.random::<f64>() < *share { x + size } else { x }
            }
            Digitise::Popcorn { m: size, mean_s } => {
                if m[0] == 0.0 {
                    m[0] = if rng.random::<bool>() { 1.0 } else { -1.0 };
                }
                if rng.random::<f64>() < row.period_s / mean_s {
                    m[0] = -m[0];
                }
                x + size * m[0]
            }
            Digitise::HeavyTails { m: rms, degrees } => {
                let square = (0..*degrees).map(|_| normal(rng).powi(2)).sum::<f64>();
                // Unit variance: the ratio's own is n / (n - 2), with the n of the mean square gone already.
                x + rms * normal(rng) * ((f64::from(*degrees) - 2.0) / square).sqrt()
            }
            Digitise::Lamp { m: rms, hz, depth } => {
                if m[1] == 0.0 {
                    (m[0], m[1]) = (rng.random::<f64>() * TAU, 1.0);
                }
                let light = 1.0 + depth * (TAU * 2.0 * hz * row.t_s + m[0]).sin();
                x + rms * light / (1.0 + 0.5 * depth * depth).sqrt() * normal(rng)
            }
            Digitise::Crackle { m: rms, hits_per_s, hz, decay_s } => {
                let radius = (-row.period_s / decay_s).exp();
                let (a, b) = (2.0 * radius * (TAU * hz * row.period_s).cos(), radius * radius);
                let share = (hits_per_s * row.period_s).min(1.0);
                let hit = if rng.random::<f64>() < share { normal(rng) / share.sqrt() } else { 0.0 };
                let next = a * m[0] - b * m[1] + hit / two_pole_variance(a, b).sqrt();
                (m[0], m[1]) = (next, m[0]);
                x + rms * next
            }
            Digitise::Held { m: rms, rows } => {
                if m[1] < 0.5 {
                    (m[0], m[1]) = (normal(rng), f64::from(*rows));
                }
                m[1] -= 1.0;
                x + rms * m[0]
            }
            Digitise::Warming { m: rms, tau_s } => {
                let share = -(-row.t_s.max(0.0) / tau_s).exp_m1();
                x + rms * share.sqrt() * normal(rng)
            }
            Digitise::Lattice { m: step } => (x / step).round() * step,
            Digitise::Truncation { m: step } => ((x / step).floor() + 0.5) * step,
            Digitise::UnevenCodes { m: step, skew } => {
                // Zero is the middle of a wide code.
                let half = 0.5 * (1.0 + skew);
                let at = x / step + half;
                let pair = 2.0 * (0.5 * at).floor();
                (if at - pair < 2.0 * half { pair } else { pair + 1.0 }) * step
            }
            Digitise::HeldCodes { m: step, hold } => {
                if (x - m[0]).abs() > (0.5 + hold) * step {
                    m[0] = (x / step).round() * step;
                }
                m[0]
            }
            Digitise::Floating { m: step, full_m } => {
                let octave = (x.abs() / full_m).log2().ceil().clamp(-8.0, 1.0);
                let step = step * octave.exp2();
                (x / step).round() * step
            }
            Digitise::MissingCodes { m: step, every } => {
                let code = (x / step).round();
                let is_missing = code.rem_euclid(f64::from(*every)) == f64::from(*every - 1);
                (if is_missing { code - 1.0 } else { code }) * step
            }
            Digitise::Dithered { m: step } => {
                let dither = rng.random::<f64>() + rng.random::<f64>() - 1.0;
                (x / step + dither).round() * step
            }
            Digitise::Filled { probability, rows } => {
                if m[1] == 0.0 {
                    (m[0], m[1]) = (x, 1.0);
                }
                if rng.random::<f64>() < *probability {
                    return m[0];
                }
                m[0] += (x - m[0]) / rows;
                x
            }
            Digitise::Stale { probability, rows } => {
                let (came, ring) = (m[31] as usize, *rows as usize + 1);
                m[came % ring] = x;
                m[31] += 1.0;
                let lost = rng.random::<f64>() < *probability;
                if lost && came + 1 >= ring { m[(came + 1) % ring] } else { x }
            }
            Digitise::OutOfStep { probability, rows } => {
                let before = m[0];
                m[0] = x;
                if m[1] > 0.0 {
                    m[1] -= 1.0;
                    return before;
                }
                if m[2] == 1.0 && rng.random::<f64>() < *probability {
                    m[1] = f64::from(*rows) - 1.0;
                    return before;
                }
                m[2] = 1.0;
                x
            }
            Digitise::Repeat { probability } => {
                if m[1] == 0.0 || rng.random::<f64>() >= *probability {
                    m[0] = x;
                    m[1] = 1.0;
                }
                m[0]
            }
            Digitise::Burst { probability, length } => {
                if m[2] > 0.0 {
                    m[2] -= 1.0;
                } else if m[1] == 1.0 && rng.random::<f64>() < *probability {
                    m[2] = f64::from(*length) - 1.0;
                } else {
                    m[0] = x;
                    m[1] = 1.0;
                }
                m[0]
            }
            Digitise::CarriedOn { probability, length } => {
                if m[2] == 0.0 && m[3] >= 2.0 && rng.random::<f64>() < *probability {
                    m[2] = f64::from(*length);
                }
                let shown = if m[2] > 0.0 { 2.0 * m[0] - m[1] } else { x };
                m[2] = (m[2] - 1.0).max(0.0);
                m[3] += 1.0;
                (m[0], m[1]) = (shown, m[0]);
                shown
            }
            Digitise::Regular { share, length } => {
                let apart = f64::from(*length) / share;
                if m[1] == 0.0 {
                    (m[0], m[1], m[2]) = (x, 1.0, apart * rng.random::<f64>());
                }
                m[2] = (m[2] + 1.0).rem_euclid(apart);
                if m[2] >= f64::from(*length) {
                    m[0] = x;
                }
                m[0]
            }
            Digitise::Thinned { probability, rows, every } => {
                if m[2] > 0.0 {
                    m[2] -= 1.0;
                } else if rng.random::<f64>() < *probability {
                    m[2] = f64::from(*rows) - 1.0;
                }
                if m[1] == 0.0 || m[2] == 0.0 || m[2] % f64::from(*every) == 0.0 {
                    (m[0], m[1]) = (x, 1.0);
                }
                m[0]
            }
            Digitise::Replayed { probability, rows } => {
                let (came, size) = (m[31] as usize, *rows as usize);
                m[31] += 1.0;
                if came % size == 0 {
                    m[30] = f64::from(u8::from(came >= size && rng.random::<f64>() < *probability));
                }
                // What did not come leaves the buffer as it was.
                if m[30] == 0.0 {
                    m[came % size] = x;
                }
                m[came % size]
            }
        }
    }
}

/// Noise that every sensor has: white, or with a first-order part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Noise {
    /// Total rms in metres.
    pub rms_m: f64,
    /// Share of the power that is low-pass noise; 0 is white.
    pub coloured_share: f64,
    /// Corner of that part.
    pub corner_hz: f64,
}

impl Noise {
    /// One draw; `state` belongs to the low-pass part.
    pub(crate) fn draw(&self, state: &mut f64, row: &Row, rng: &mut Pcg64) -> f64 {
        let white = (1.0 - self.coloured_share).sqrt() * normal(rng);
        if self.coloured_share == 0.0 {
            return self.rms_m * white;
        }
        self.rms_m * (white + self.coloured_share.sqrt() * low_pass(state, self.corner_hz, row, rng))
    }
}

/// Variance of x = a x1 - b x2 + n under unit white noise n.
fn two_pole_variance(a: f64, b: f64) -> f64 {
    (1.0 + b) / ((1.0 - b) * ((1.0 + b) * (1.0 + b) - a * a))
}

/// Unit-variance first-order noise, exact for any period.
fn low_pass(state: &mut f64, corner_hz: f64, row: &Row, rng: &mut Pcg64) -> f64 {
    let decay = (-TAU * corner_hz * row.period_s).exp();
    *state = decay * *state + (1.0 - decay * decay).sqrt() * normal(rng);
    *state
}
