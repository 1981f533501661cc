//! Reference and command waveforms that a board makes by itself: a sequence of segments, one `f32` per sample.
//!
//! Amplitudes have no unit here: metres for a reference, volts for an open-loop command, as the caller means it.
//! The output is bit-equal on every machine: integer phases, and only + - * / of f32.
//!
//! **Phase.** 64 bits, 2^64 being one turn; the upper 32 bits make the sine. A 32-bit accumulator would miss the frequency by up to
//! rate / 2^33: at 1 MHz that is 1.2e-4 Hz, which after 10 s of a 1 Hz sine is 0.4 degree. With 64 bits the
//! increment is the f64 quotient frequency / rate, wrong by 2^-53 of itself: 1e-16 of the frequency, 3e-10 turns after
//! 3e6 periods. The phase starts half a unit of the upper word above 0, so that dropping the lower word rounds, and edges of a square whose
//! period is a whole number of samples fall on the exact sample.
//!
//! **Segments of a SPEC.** Sample 0 of a segment is the first one after the one before it ended.
//!
//! | SPEC | constructor | value at its sample k, t = k / rate | after the end, as the last segment |
//! | --- | --- | --- | --- |
//! | `zero` | [`Segment::zero`] | 0 | 0 |
//! | `hold:A` | [`Segment::hold`] | A | A |
//! | `step:A` | [`Segment::step`] | A from k = 0 on | A |
//! | `square:A@F` | [`Segment::square`] | A in the first half period, -A in the second | goes on |
//! | `sine:A@F` | [`Segment::sine`] | A sin(2 pi F t) | goes on |
//! | `triangle:A@F` | [`Segment::triangle`] | in step with the sine: 0, A at a quarter period, 0, -A | goes on |
//! | `sweep:A@F0-F1Hz/S` | [`Segment::linear_sweep`] | A sin(2 pi (F0 t + (F1 - F0) t^2 / (2 S))) | 0 |
//! | `sweep:A@F0-F1Hz/S,log` | [`Segment::log_sweep`] | A sin(2 pi F0 S / ln q (q^(t/S) - 1)), q = F1 / F0 | 0 |
//! | `ladder:A/N,hold=S` | [`Segment::ladder`] | A/N, 2A/N, ... A, then (N-1)A/N, ... A/N, 0; each for S | 0 |
//! | `decaying-sine:A@F/S` | [`Segment::decaying_sine`] | A (1 - t / S) sin(2 pi F t), for demagnetising a loop | 0 |
//! | `multisine`, `file` | [`Segment::table`] | the table's sample, again from its start when used up | goes on |
//!
//! A `sweep` without `,log` is the linear one: its spectrum is flat per hertz, as the identification of a line of modes wants it, and it
//! is what `sweep:20V@1-2000Hz/4s` reads like. The logarithmic one costs the board only one more 64-bit product.

use crate::sine::{sine_of_phase, triangle_of_phase};
use core::fmt;
use core::num::NonZeroU32;

/// The phase at the start of a segment: half a unit of the upper word (see the module's text).
const START: u64 = 1 << 31;

/// One part of a sequence: a waveform and how many samples it lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment<'a> {
    wave: Wave<'a>,
    samples: u32,
}

/// What a segment plays. Phase increments are turns per sample times 2^64.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wave<'a> {
    Level {
        level: f32,
    },
    Square {
        amplitude: f32,
        increment: u64,
    },
    Sine {
        amplitude: f32,
        increment: u64,
    },
    Triangle {
        amplitude: f32,
        increment: u64,
    },
    DecayingSine {
        amplitude: f32,
        increment: u64,
        per_sample: f32,
    },
    LinearSweep {
        amplitude: f32,
        increment: u64,
        /// Added to the increment each sample, modulo 2^64, so that it may fall.
        slope: u64,
    },
    LogSweep {
        amplitude: f32,
        increment: u64,
        /// Magnitude of the increment's relative change per sample, times 2^64.
        growth: u64,
        falls: bool,
    },
    Ladder {
        amplitude: f32,
        levels: u32,
        hold: NonZeroU32,
    },
    Table {
        values: &'a [f32],
    },
}

/// Why a segment can't be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SegmentError {
    /// An amplitude or a table's value is NaN or infinite.
    NotFinite,
    /// The rate, a frequency or a duration is not a finite number above zero.
    NotPositive,
    /// A frequency is above half the sampling rate.
    AboveHalfTheRate,
    /// The segment would have no sample, or more than 2^32 - 1.
    Length,
    /// A ladder needs 1 to 65535 levels.
    Levels,
    /// The logarithmic sweep changes its frequency by more than a factor 1.6 from one sample to the next.
    SweepTooFast,
}

impl fmt::Display for SegmentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SegmentError::NotFinite => "amplitudes and table values must be finite",
            SegmentError::NotPositive => "rate, frequencies and durations must be finite and above zero",
            SegmentError::AboveHalfTheRate => "a frequency must be at most half the sampling rate",
            SegmentError::Length => "a segment must have 1 to 2^32 - 1 samples",
            SegmentError::Levels => "a ladder must have 1 to 65535 levels",
            SegmentError::SweepTooFast => {
                "a logarithmic sweep must not change its frequency by more than a factor 1.6 per sample"
            }
        })
    }
}

impl core::error::Error for SegmentError {}

/// The number of samples in `seconds` at `rate_hz`, rounded to the nearest.
///
/// # Errors
///
/// [`SegmentError::NotPositive`] for a rate that is none, [`SegmentError::Length`] for less than half a sample or beyond `u32`.
pub fn samples_in(rate_hz: f32, seconds: f32) -> Result<u32, SegmentError> {
    positive(rate_hz)?;
    let samples = f64::from(seconds) * f64::from(rate_hz) + 0.5;
    if samples >= 1.0 && samples < f64::from(u32::MAX) { Ok(samples as u32) } else { Err(SegmentError::Length) }
}

impl<'a> Segment<'a> {
    /// 0 for `samples`.
    ///
    /// # Errors
    ///
    /// [`SegmentError::Length`] for no sample, here and in every other constructor.
    pub fn zero(samples: u32) -> Result<Segment<'a>, SegmentError> {
        Segment::hold(0.0, samples)
    }

    /// `level` for `samples`, and for ever if it is the last segment.
    ///
    /// # Errors
    ///
    /// [`SegmentError::NotFinite`].
    pub fn hold(level: f32, samples: u32) -> Result<Segment<'a>, SegmentError> {
        finite(level)?;
        Segment::of(Wave::Level { level }, samples)
    }

    /// A step: high from its first sample on. The same as [`Segment::hold`]; the low level before it is the segment before it,
    /// or the plant at rest.
    ///
    /// # Errors
    ///
    /// [`SegmentError::NotFinite`].
    pub fn step(amplitude: f32, samples: u32) -> Result<Segment<'a>, SegmentError> {
        Segment::hold(amplitude, samples)
    }

    /// Square wave between +-`amplitude`, high first.
    ///
    /// # Errors
    ///
    /// [`SegmentError`] of a number that can't be used; the frequency is at most half the rate.
    pub fn square(rate_hz: f32, amplitude: f32, frequency_hz: f32, samples: u32) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let increment = to_phase(turns_per_sample(rate_hz, frequency_hz)?);
        Segment::of(Wave::Square { amplitude, increment }, samples)
    }

    /// Sine of `amplitude`, rising from 0.
    ///
    /// # Errors
    ///
    /// As [`Segment::square`].
    pub fn sine(rate_hz: f32, amplitude: f32, frequency_hz: f32, samples: u32) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let increment = to_phase(turns_per_sample(rate_hz, frequency_hz)?);
        Segment::of(Wave::Sine { amplitude, increment }, samples)
    }

    /// Triangle of `amplitude`, rising from 0.
    ///
    /// # Errors
    ///
    /// As [`Segment::square`].
    pub fn triangle(
        rate_hz: f32,
        amplitude: f32,
        frequency_hz: f32,
        samples: u32,
    ) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let increment = to_phase(turns_per_sample(rate_hz, frequency_hz)?);
        Segment::of(Wave::Triangle { amplitude, increment }, samples)
    }

    /// Sine whose amplitude falls in a straight line from `amplitude` to 0 at the segment's end.
    ///
    /// # Errors
    ///
    /// As [`Segment::square`].
    pub fn decaying_sine(
        rate_hz: f32,
        amplitude: f32,
        frequency_hz: f32,
        samples: u32,
    ) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let increment = to_phase(turns_per_sample(rate_hz, frequency_hz)?);
        let per_sample = 1.0 / samples.max(1) as f32;
        Segment::of(Wave::DecayingSine { amplitude, increment, per_sample }, samples)
    }

    /// Sine whose frequency goes in a straight line from `from_hz` to `to_hz`, which is reached at the segment's end.
    ///
    /// # Errors
    ///
    /// As [`Segment::square`], for both frequencies.
    pub fn linear_sweep(
        rate_hz: f32,
        amplitude: f32,
        from_hz: f32,
        to_hz: f32,
        samples: u32,
    ) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let from = turns_per_sample(rate_hz, from_hz)?;
        let to = turns_per_sample(rate_hz, to_hz)?;
        let slope = (to - from) / f64::from(samples.max(1));
        // The k-th increment is from + (k + 1/2) slope: their sum is F0 t + (F1 - F0) t^2 / (2 S) exactly.
        Segment::of(
            Wave::LinearSweep { amplitude, increment: to_phase(from + 0.5 * slope), slope: to_phase(slope) },
            samples,
        )
    }

    /// Sine whose frequency goes exponentially from `from_hz` to `to_hz`, which is reached at the segment's end.
    ///
    /// # Errors
    ///
    /// As [`Segment::square`], for both frequencies; [`SegmentError::SweepTooFast`].
    pub fn log_sweep(
        rate_hz: f32,
        amplitude: f32,
        from_hz: f32,
        to_hz: f32,
        samples: u32,
    ) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        let from = turns_per_sample(rate_hz, from_hz)?;
        let to = turns_per_sample(rate_hz, to_hz)?;
        let exponent = natural_logarithm(to / from) / f64::from(samples.max(1));
        if !(-0.5..=0.5).contains(&exponent) {
            return Err(SegmentError::SweepTooFast);
        }
        // The increments from (e^x - 1)/x q^k, q = e^x, sum to the integral of the frequency exactly.
        let relative = exponential_less_one_over(exponent);
        let growth = relative * exponent;
        let falls = growth < 0.0;
        Segment::of(
            Wave::LogSweep {
                amplitude,
                increment: to_phase(from * relative),
                growth: to_phase(if falls { -growth } else { growth }),
                falls,
            },
            samples,
        )
    }

    /// Staircase: `amplitude` times 1/N, 2/N, ... 1, then (N-1)/N, ... 1/N, 0, each for `hold_samples`; 2 N holds in all.
    ///
    /// # Errors
    ///
    /// [`SegmentError::Levels`], [`SegmentError::Length`], [`SegmentError::NotFinite`].
    pub fn ladder(amplitude: f32, levels: u32, hold_samples: u32) -> Result<Segment<'a>, SegmentError> {
        finite(amplitude)?;
        if !(1..=65_535).contains(&levels) {
            return Err(SegmentError::Levels);
        }
        let hold = NonZeroU32::new(hold_samples).ok_or(SegmentError::Length)?;
        let samples = hold_samples.checked_mul(2 * levels).ok_or(SegmentError::Length)?;
        Segment::of(Wave::Ladder { amplitude, levels, hold }, samples)
    }

    /// Any waveform as a table of samples, played from its start and again when used up, for `samples` in all.
    ///
    /// # Errors
    ///
    /// [`SegmentError::Length`] for an empty table, [`SegmentError::NotFinite`] for a value that is none.
    pub fn table(values: &'a [f32], samples: u32) -> Result<Segment<'a>, SegmentError> {
        if values.is_empty() {
            return Err(SegmentError::Length);
        }
        for value in values {
            finite(*value)?;
        }
        Segment::of(Wave::Table { values }, samples)
    }

    /// How many samples the segment lasts.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    fn of(wave: Wave<'a>, samples: u32) -> Result<Segment<'a>, SegmentError> {
        if samples == 0 {
            return Err(SegmentError::Length);
        }
        Ok(Segment { wave, samples })
    }
}

/// A sequence of segments. What happens past its end is in the module's table; without any segment the output is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Generator<'a> {
    segments: &'a [Segment<'a>],
}

/// Where a generator stands. The default is before its first sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GeneratorState {
    segment_idx: u32,
    /// Samples still to be played of that segment; 0 says that the next one is to be entered first.
    left: u32,
    table_idx: u32,
    phase: u64,
    increment: u64,
    has_begun: bool,
    /// Past the end of the last segment.
    is_over: bool,
}

impl<'a> Generator<'a> {
    /// Plays `segments` one after the other.
    pub const fn new(segments: &'a [Segment<'a>]) -> Generator<'a> {
        Generator { segments }
    }

    /// The next sample.
    #[inline]
    pub fn next(&self, state: &mut GeneratorState) -> f32 {
        if state.left == 0 {
            self.enter_next(state);
        }
        match self.segments.get(state.segment_idx as usize) {
            Some(segment) if state.left > 0 => {
                let value = segment.wave.sample(state, segment.samples);
                state.left -= 1;
                value
            }
            _ => 0.0,
        }
    }

    /// Enters the next segment, or goes on with the last one where that goes on.
    fn enter_next(&self, state: &mut GeneratorState) {
        let next_idx = if state.has_begun { state.segment_idx + 1 } else { 0 };
        if let Some(segment) = self.segments.get(next_idx as usize) {
            state.has_begun = true;
            state.segment_idx = next_idx;
            state.left = segment.samples;
            segment.wave.enter(state);
        } else {
            state.is_over = true;
            if self.segments.last().is_some_and(|last| last.wave.goes_on()) {
                state.left = u32::MAX;
            }
        }
    }

    /// Whether all segments have been played to their end.
    pub fn is_finished(&self, state: &GeneratorState) -> bool {
        let is_last = state.segment_idx as usize + 1 >= self.segments.len();
        self.segments.is_empty() || state.is_over || (state.has_begun && state.left == 0 && is_last)
    }

    /// Samples of all segments together.
    pub fn samples(&self) -> u64 {
        self.segments.iter().map(|s| u64::from(s.samples)).sum()
    }
}

impl Wave<'_> {
    /// Whether the wave goes on past the end of a sequence.
    fn goes_on(&self) -> bool {
        match self {
            Wave::Level { .. }
            | Wave::Square { .. }
            | Wave::Sine { .. }
            | Wave::Triangle { .. }
            | Wave::Table { .. } => true,
            Wave::DecayingSine { .. } | Wave::LinearSweep { .. } | Wave::LogSweep { .. } | Wave::Ladder { .. } => false,
        }
    }

    /// Sets the state to the wave's beginning.
    #[inline]
    fn enter(&self, state: &mut GeneratorState) {
        state.phase = START;
        state.table_idx = 0;
        state.increment = match *self {
            Wave::Square { increment, .. }
            | Wave::Sine { increment, .. }
            | Wave::Triangle { increment, .. }
            | Wave::DecayingSine { increment, .. }
            | Wave::LinearSweep { increment, .. }
            | Wave::LogSweep { increment, .. } => increment,
            Wave::Level { .. } | Wave::Ladder { .. } | Wave::Table { .. } => 0,
        };
    }

    /// The value at the state, which then moves on to the next sample of `samples`.
    #[inline]
    fn sample(&self, state: &mut GeneratorState, samples: u32) -> f32 {
        // Not for what goes on past its end, where `left` means nothing.
        let sample_idx = |state: &GeneratorState| samples.wrapping_sub(state.left);
        let phase = (state.phase >> 32) as u32;
        state.phase = state.phase.wrapping_add(state.increment);
        match *self {
            Wave::Level { level } => level,
            Wave::Square { amplitude, .. } => {
                if phase < 1 << 31 {
                    amplitude
                } else {
                    -amplitude
                }
            }
            Wave::Sine { amplitude, .. } => amplitude * sine_of_phase(phase),
            Wave::Triangle { amplitude, .. } => amplitude * triangle_of_phase(phase),
            Wave::DecayingSine { amplitude, per_sample, .. } => {
                let envelope = 1.0 - sample_idx(state) as f32 * per_sample;
                amplitude * envelope * sine_of_phase(phase)
            }
            Wave::LinearSweep { amplitude, slope, .. } => {
                state.increment = state.increment.wrapping_add(slope);
                amplitude * sine_of_phase(phase)
            }
            Wave::LogSweep { amplitude, growth, falls, .. } => {
                let change = upper_product(state.increment, growth);
                state.increment =
                    if falls { state.increment.wrapping_sub(change) } else { state.increment.wrapping_add(change) };
                amplitude * sine_of_phase(phase)
            }
            Wave::Ladder { amplitude, levels, hold } => {
                let stair = sample_idx(state) / hold;
                let level = if stair < levels { stair + 1 } else { (2 * levels - 1).saturating_sub(stair) };
                amplitude * (level as f32 / levels as f32)
            }
            Wave::Table { values } => {
                let value = values.get(state.table_idx as usize);
                let next = state.table_idx as usize + 1;
                state.table_idx = if next < values.len() { next as u32 } else { 0 };
                value.copied().unwrap_or(0.0)
            }
        }
    }
}

/// The upper 64 bits of a product, from 32-bit products: a 128-bit one would be a library call on the board.
/// The lowest partial product is left out; it could change the result by one unit, 2^-64 turn per sample.
fn upper_product(a: u64, b: u64) -> u64 {
    let (a_high, a_low) = (a >> 32, a & 0xffff_ffff);
    let (b_high, b_low) = (b >> 32, b & 0xffff_ffff);
    a_high * b_high + ((a_high * b_low) >> 32) + ((a_low * b_high) >> 32)
}

/// Frequency over rate, checked.
fn turns_per_sample(rate_hz: f32, frequency_hz: f32) -> Result<f64, SegmentError> {
    positive(rate_hz)?;
    positive(frequency_hz)?;
    let turns = f64::from(frequency_hz) / f64::from(rate_hz);
    if turns <= 0.5 { Ok(turns) } else { Err(SegmentError::AboveHalfTheRate) }
}

/// Turns to phase units, rounded to the nearest; negative turns wrap.
fn to_phase(turns: f64) -> u64 {
    let units = turns * 18_446_744_073_709_551_616.0;
    let half = if units < 0.0 { -0.5 } else { 0.5 };
    // Through i128, because a linear sweep's slope may be negative and an increment may exceed i64.
    (units + half) as i128 as u64
}

fn finite(value: f32) -> Result<(), SegmentError> {
    if value.is_finite() { Ok(()) } else { Err(SegmentError::NotFinite) }
}

fn positive(value: f32) -> Result<(), SegmentError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(SegmentError::NotPositive) }
}

/// ln(x) for a normal positive x: exponent times ln 2 plus 2 atanh((m - 1)/(m + 1)), m in [1/sqrt 2, sqrt 2).
///
/// The series ends at z^23 with abs(z) <= 0.1716: the rest is below 2 z^25/25 = 6e-21. Used at build time only.
fn natural_logarithm(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) as i32 & 0x7ff) - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    if mantissa > core::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    let z = (mantissa - 1.0) / (mantissa + 1.0);
    let square = z * z;
    let mut sum = 0.0;
    let mut odd = 23.0;
    while odd > 0.0 {
        sum = sum * square + 1.0 / odd;
        odd -= 2.0;
    }
    f64::from(exponent) * core::f64::consts::LN_2 + 2.0 * z * sum
}

/// (e^x - 1) / x for abs(x) <= 1/2, 1 at 0: the series to x^15/16!, whose rest is below 1e-19. Used at build time only.
fn exponential_less_one_over(x: f64) -> f64 {
    let mut sum = 0.0;
    let mut order = 16.0;
    while order > 1.0 {
        sum = (sum + 1.0) * x / order;
        order -= 1.0;
    }
    1.0 + sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use std::vec::Vec;

    fn play(segments: &[Segment<'_>], samples: usize) -> Vec<f32> {
        let generator = Generator::new(segments);
        let mut state = GeneratorState::default();
        (0..samples).map(|_| generator.next(&mut state)).collect()
    }

    fn made<'a>(segment: Result<Segment<'a>, SegmentError>) -> Segment<'a> {
        segment.expect("sound numbers")
    }

    #[test]
    fn levels_follow_one_another_and_the_last_one_stays() {
        let segments = [made(Segment::zero(2)), made(Segment::step(3.0, 1)), made(Segment::hold(-1.0, 2))];
        assert_eq!(play(&segments, 7), [0.0, 0.0, 3.0, -1.0, -1.0, -1.0, -1.0]);
        assert_eq!(Generator::new(&segments).samples(), 5);
        assert_eq!(play(&[], 2), [0.0, 0.0]);
    }

    #[test]
    fn a_generator_is_finished_after_its_last_sample() {
        let segments = [made(Segment::zero(2)), made(Segment::hold(1.0, 1))];
        let generator = Generator::new(&segments);
        let mut state = GeneratorState::default();
        for _ in 0..3 {
            assert!(!generator.is_finished(&state));
            generator.next(&mut state);
        }
        assert!(generator.is_finished(&state));
        assert!(Generator::new(&[]).is_finished(&GeneratorState::default()));
    }

    #[test]
    fn square_edges_fall_on_the_exact_sample_for_a_thousand_periods() {
        for (rate_hz, frequency_hz, half) in [
            (20e3, 1.0, 10_000),
            (20e3, 100.0, 100),
            (1e6, 50.0, 10_000),
            (40e3, 20e3, 1),
            // 1/6 is rounded down in f64: without the half unit at the start every edge would be a sample late.
            (30e3, 5e3, 3),
        ] {
            let segments = [made(Segment::square(rate_hz, 2.0, frequency_hz, 1))];
            let samples = half * 2 * 1000;
            for (k, value) in play(&segments, samples).into_iter().enumerate() {
                let expected = if (k / half) % 2 == 0 { 2.0 } else { -2.0 };
                assert_eq!(value, expected, "sample {k} of {frequency_hz} Hz at {rate_hz} Hz");
            }
        }
    }

    #[test]
    fn sines_keep_frequency_and_phase() {
        // 10 s of 1 Hz at 1 MHz: the case a 32-bit phase would fail by 7e-3 rad.
        let segments = [made(Segment::sine(1e6, 1.0, 1.0, 1))];
        for (k, value) in play(&segments, 10_000_000).into_iter().enumerate() {
            let exact = (TAU * k as f64 / 1e6).sin();
            // Sine 2.5e-7, phase truncated to 32 bits: 2 pi 2^-32 = 1.5e-9.
            assert!((f64::from(value) - exact).abs() < 2.6e-7, "{k}");
        }
    }

    #[test]
    fn triangle_and_decay_have_their_shapes() {
        let triangle = play(&[made(Segment::triangle(8.0, 4.0, 1.0, 8))], 10);
        assert_eq!(triangle, [0.0, 2.0, 4.0, 2.0, 0.0, -2.0, -4.0, -2.0, 0.0, 2.0]);
        let decay = play(&[made(Segment::decaying_sine(4.0, 1.0, 1.0, 8))], 10);
        let envelope = [0.0, 0.875, 0.0, -0.625, 0.0, 0.375, 0.0, -0.125, 0.0, 0.0];
        assert_eq!(decay, envelope);
    }

    #[test]
    fn sweeps_follow_the_integral_of_their_frequency() {
        for (from_hz, to_hz) in [(1.0_f32, 2000.0_f32), (2000.0, 1.0), (100.0, 100.0)] {
            let (rate_hz, samples) = (20e3_f32, 80_000_u32);
            let linear = [made(Segment::linear_sweep(rate_hz, 1.0, from_hz, to_hz, samples))];
            let log = [made(Segment::log_sweep(rate_hz, 1.0, from_hz, to_hz, samples))];
            let (f0, f1) = (f64::from(from_hz), f64::from(to_hz));
            let duration = 4.0;
            let both = play(&linear, 80_001).into_iter().zip(play(&log, 80_001));
            for (k, (linear, log)) in both.enumerate().take(80_000) {
                let t = k as f64 / 20e3;
                let linear_turns = f0 * t + (f1 - f0) * t * t / (2.0 * duration);
                let log_turns = if f0 == f1 {
                    f0 * t
                } else {
                    let exponent = (f1 / f0).ln();
                    f0 * duration / exponent * (exponent * t / duration).exp_m1()
                };
                // Sine and phase as above, 2.6e-7. Linear: the increment's error 2^-65 and the slope's 2^-65 k sum to
                // k^2 2^-66 = 1e-10 turns at the end. Log: an error of one unit in each of 8e4 steps, growing with the
                // frequency, sums to less than 8e4^2 2^-64 2000 = 7e-7 turns = 4e-6 rad at worst; f64's own 1e-16 of 8e3 turns is nothing.
                assert!((f64::from(linear) - (TAU * linear_turns).sin()).abs() < 3e-7, "{k}");
                assert!((f64::from(log) - (TAU * log_turns).sin()).abs() < 5e-6, "{k}");
            }
            assert_eq!(play(&linear, 80_001)[80_000], 0.0);
        }
    }

    #[test]
    fn a_ladder_goes_up_and_down_and_ends_at_zero() {
        let segments = [made(Segment::ladder(60.0, 4, 2))];
        let expected =
            [15.0, 15.0, 30.0, 30.0, 45.0, 45.0, 60.0, 60.0, 45.0, 45.0, 30.0, 30.0, 15.0, 15.0, 0.0, 0.0, 0.0];
        assert_eq!(play(&segments, 17), expected);
        assert_eq!(segments[0].samples(), 16);
    }

    #[test]
    fn a_table_repeats_and_starts_afresh_in_each_segment() {
        let values = [1.0, 2.0, 3.0];
        let segments = [made(Segment::table(&values, 4)), made(Segment::table(&values, 3))];
        assert_eq!(play(&segments, 9), [1.0, 2.0, 3.0, 1.0, 1.0, 2.0, 3.0, 1.0, 2.0]);
    }

    #[test]
    fn what_cannot_be_played_is_refused() {
        use SegmentError::*;
        assert_eq!(Segment::hold(f32::NAN, 1), Err(NotFinite));
        assert_eq!(Segment::zero(0), Err(Length));
        assert_eq!(Segment::sine(20e3, 1.0, 10_001.0, 1), Err(AboveHalfTheRate));
        assert_eq!(Segment::sine(0.0, 1.0, 1.0, 1), Err(NotPositive));
        assert_eq!(Segment::square(20e3, 1.0, f32::NAN, 1), Err(NotPositive));
        assert_eq!(Segment::ladder(1.0, 0, 1), Err(Levels));
        assert_eq!(Segment::ladder(1.0, 1, 0), Err(Length));
        assert_eq!(Segment::ladder(1.0, 65_535, u32::MAX), Err(Length));
        assert_eq!(Segment::table(&[], 1), Err(Length));
        assert_eq!(Segment::table(&[f32::INFINITY], 1), Err(NotFinite));
        assert_eq!(Segment::log_sweep(20e3, 1.0, 1.0, 2000.0, 10), Err(SweepTooFast));
        assert_eq!(samples_in(20e3, 0.5), Ok(10_000));
        assert_eq!(samples_in(20e3, 0.0), Err(Length));
        assert_eq!(samples_in(20e3, f32::NAN), Err(Length));
        assert_eq!(samples_in(20e3, 1e9), Err(Length));
    }

    #[test]
    fn build_time_functions_agree_with_std() {
        for i in 1..2000 {
            let x = f64::from(i) * 1.37;
            // Both within an ulp or two of the true value, on results up to 8.
            assert!((natural_logarithm(x) - x.ln()).abs() < 4e-15, "{x}");
            let small = f64::from(i) / 4000.0;
            for x in [small, -small] {
                assert!((exponential_less_one_over(x) - x.exp_m1() / x).abs() < 1e-15, "{x}");
            }
        }
    }
}
