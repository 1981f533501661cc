//! The nearest rate and delay at which a loop would do.

use std::fmt;

use super::{LinearRegion, Loop, MarginError, SAFE_GAIN_MARGIN_DB, check_loop, check_region, worst_gain_margin_db};

/// Rates offered are multiples of this that divide the timer clock. For 170 MHz that gives 1, 2, 2.5, 4, 5, 8, 8.5, 10, 12.5, 16, 17,
/// 20, 25, 34, 40, 42.5, 50, 62.5, 68, 80, 85, 100, 125, 136, 170 and 200 kHz.
const RATE_STEP_HZ: u32 = 500;
/// Lowest and highest rate offered: below, the thesis plant's own resonance is not sampled; above, no interrupt ends in time (chosen).
const RATES_HZ: std::ops::RangeInclusive<u32> = 1_000..=200_000;
/// The shortest delay offered to somebody who asked for a longer one: boards latch their DAC 10 us after the ADC's trigger, so a
/// shorter one could not be had (chosen: conversion, law and write, with margin).
const SHORTEST_DELAY_S: f64 = 10e-6;
/// Delays offered are rounded down to this.
const DELAY_STEP_S: f64 = 1e-7;

/// An answer to "what would do?", where doing means at least 6 dB of gain margin in every region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Suggestion {
    /// What was asked for does, and its rate divides the timer clock.
    AsAsked {
        /// Gain margin in the worst region.
        gain_margin_db: f64,
    },
    /// The nearest that does.
    Change {
        /// Divides the timer clock.
        rate_hz: f64,
        /// As asked where any rate allows that, otherwise the largest at this rate.
        delay_s: f64,
        /// Gain margin in the worst region.
        gain_margin_db: f64,
        /// Whether `delay_s` is the delay that was asked for.
        keeps_delay: bool,
    },
    /// No rate does, even with a short delay: the gains are too high.
    Nothing,
}

impl fmt::Display for Suggestion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::AsAsked { gain_margin_db } => {
                write!(f, "the rate and the delay will do: gain margin {gain_margin_db:.1} dB in the worst region")
            }
            Self::Change { rate_hz, delay_s, gain_margin_db, keeps_delay } => write!(
                f,
                "{} kHz with {} us {} would do: gain margin {gain_margin_db:.1} dB in the worst region",
                short(rate_hz / 1e3),
                short(delay_s * 1e6),
                if keeps_delay { "as asked" } else { "at most from sampling to drive" },
            ),
            Self::Nothing => write!(f, "no rate up to 200 kHz that divides the timer clock would do; lower the gains"),
        }
    }
}

/// Three decimals, without the zeros that say nothing.
fn short(number: f64) -> String {
    let text = format!("{number:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// The nearest rate that divides `timer_clock_hz`, by its ratio to the asked one, at which every region has 6 dB: with the asked delay if any
/// rate allows it, otherwise with the largest delay that the nearest possible rate allows.
pub fn nearest_stable(regions: &[LinearRegion], law: &Loop, timer_clock_hz: u32) -> Result<Suggestion, MarginError> {
    if regions.is_empty() {
        return Err(MarginError::NoRegion);
    }
    check_loop(law)?;
    for region in regions {
        check_region(region)?;
    }
    let margin_db = |rate_hz: f64, delay_s: f64| {
        // A region too stiff or a delay too long at a candidate rate only rules that rate out.
        let candidate = Loop { rate_hz, delay_s, ..*law };
        worst_gain_margin_db(regions, &candidate, SAFE_GAIN_MARGIN_DB).ok().flatten()
    };

    // Zero is a multiple of everything, but no clock.
    let divides = |rate_hz: &u32| timer_clock_hz > 0 && timer_clock_hz.is_multiple_of(*rate_hz);
    let mut rates_hz: Vec<f64> = RATES_HZ.step_by(RATE_STEP_HZ as usize).filter(divides).map(f64::from).collect();
    let asked_divides =
        law.rate_hz.fract() == 0.0 && law.rate_hz <= f64::from(u32::MAX) && divides(&(law.rate_hz as u32));
    if asked_divides && !rates_hz.contains(&law.rate_hz) {
        rates_hz.push(law.rate_hz);
    }
    let distance = |rate_hz: f64| (rate_hz / law.rate_hz).ln().abs();
    rates_hz.sort_by(|&left, &right| distance(left).total_cmp(&distance(right)));

    for &rate_hz in &rates_hz {
        if let Some(gain_margin_db) = margin_db(rate_hz, law.delay_s) {
            return Ok(if rate_hz == law.rate_hz {
                Suggestion::AsAsked { gain_margin_db }
            } else {
                Suggestion::Change { rate_hz, delay_s: law.delay_s, gain_margin_db, keeps_delay: true }
            });
        }
    }
    let shortest_s = SHORTEST_DELAY_S.min(law.delay_s);
    for &rate_hz in &rates_hz {
        if margin_db(rate_hz, shortest_s).is_none() {
            continue;
        }
        let delay_s = largest_delay(shortest_s, law.delay_s, |delay_s| margin_db(rate_hz, delay_s).is_some());
        if let Some(gain_margin_db) = margin_db(rate_hz, delay_s) {
            return Ok(Suggestion::Change { rate_hz, delay_s, gain_margin_db, keeps_delay: false });
        }
    }
    Ok(Suggestion::Nothing)
}

/// The largest delay that does between one that does and one that does not. It need not be the only edge, so the range is first stepped
/// through from above.
fn largest_delay(does_s: f64, does_not_s: f64, does: impl Fn(f64) -> bool) -> f64 {
    const N_STEPS: u32 = 32;
    let at = |step: u32| does_s + (does_not_s - does_s) * f64::from(step) / f64::from(N_STEPS);
    let highest = (0..N_STEPS).rev().find(|&step| step == 0 || does(at(step))).unwrap_or(0);
    let (mut low, mut high) = (at(highest), at(highest + 1));
    while high - low > 0.1 * DELAY_STEP_S {
        let middle = 0.5 * (low + high);
        if does(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    let rounded = (low / DELAY_STEP_S).floor() * DELAY_STEP_S;
    if rounded >= does_s && does(rounded) { rounded } else { low }
}
