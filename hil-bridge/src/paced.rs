//! Hardware in the loop in real time: the plant keeps to the clock, and the board's answer acts half a sample after the measurement.
//!
//! The bridge can't promise more than its link: at a rate of 1 / (2 x the 99.9 % round trip) nearly every answer is there in half a sample.
//! One that is not comes too late: the drive is held, as a missed latch does on a bench, and it is counted. Half a sample of delay is
//! in the loop whatever the link does meanwhile, so that margins can be told before.

use crate::link::Link;
use crate::lockstep::{LockstepError, Outcome, Ready, Row, play, sample};
use crate::session::Session;
use crate::statistics::Statistics;
use plant_sim::experiment::Bench;
use std::fmt;
use std::time::Duration;

/// A rate that a link can't keep up with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooFast {
    /// Samples per second wanted.
    pub rate_hz: f64,
    /// Round trip that 99.9 % keep within, seconds.
    pub round_trip_s: f64,
    /// Most samples per second.
    pub most_hz: f64,
}

impl fmt::Display for TooFast {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} Hz is too fast in real time: 99.9 % of the round trips over this link take up to {:.1} us, and half a sample must hold \
             that, which is {:.0} Hz at the most",
            self.rate_hz,
            1e6 * self.round_trip_s,
            self.most_hz
        )
    }
}

/// From sample to drive at `rate_hz`, seconds.
pub fn latency_s(rate_hz: f64) -> f64 {
    0.5 / rate_hz
}

/// Whether a link with these round trips keeps up with `rate_hz`.
///
/// # Errors
/// [`TooFast`]. Without a round trip nothing is known, and any rate is too fast.
pub fn check(statistics: &Statistics, rate_hz: f64) -> Result<(), TooFast> {
    let most_hz = statistics.paced_hz().unwrap_or(0.0);
    if rate_hz <= most_hz {
        return Ok(());
    }
    Err(TooFast { rate_hz, round_trip_s: 0.5 / most_hz, most_hz })
}

/// As [`crate::lockstep::run_on`], by the link's clock. The bench's latency is [`latency_s`]. Samples whose answer came too late are the outcome's
/// overruns; those that began too late though no answer held them up, its slips.
///
/// # Errors
/// [`LockstepError`]. A fault of the board is none, the outcome says it.
pub fn run<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    bench: &mut Bench,
    samples: usize,
    on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    let rate_hz = f64::from(ready.parameters.rate_hz);
    let half = Duration::from_secs_f64(latency_s(rate_hz));
    // Due times count from the first sample; one that begins late moves all that follow: the plant's time stands still meanwhile, and no
    // two samples come closer.
    let mut begun = None;
    let mut due = 0;
    // The sample before was lost or answered late: what it takes of the next one's time is counted there.
    let mut is_held_up = false;
    let when_due = |session: &mut Session<L>, bench: &mut Bench, last: &Row, outcome: &mut Outcome| {
        let now = session.link().now();
        let at = *begun.get_or_insert(now) + Duration::from_secs_f64(f64::from(due) / rate_hz);
        let is_in_time = now < at;
        if is_in_time {
            session.link().pause(at - now)?;
        }
        let sampled = session.link().now();
        if sampled > at + half {
            (begun, due) = (Some(sampled), 0);
            outcome.slips += usize::from(is_in_time || !is_held_up);
        }
        due += 1;
        let (mut row, mode) = sample(session, ready, bench, last)?;
        let is_late = session.link().now().saturating_sub(sampled) > half;
        is_held_up = row.is_lost || is_late;
        if is_late && !row.is_lost {
            outcome.overruns += 1;
            row.command_v = last.command_v;
        }
        Ok((row, mode))
    };
    play(session, ready, bench, samples, when_due, on_row)
}
