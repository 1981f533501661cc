//! An experiment on a bench that hangs on the board's own pins: the board samples, drives and streams, the host writes down.
//!
//! The bench does not wait for the host. What the link loses is a hole in the record, counted and named; a host that falls silent is a
//! fault of the board's own, which ends at 0 V.

use crate::link::Link;
use crate::lockstep::{LockstepError, Outcome, Ready, Row, is_safe, start};
use crate::session::{Block, Session, SessionError};
use control_core::{AdcCode, DacCode, FaultCode, ModeName};
use std::ops::ControlFlow;
use std::time::Duration;
use wire::{Flags, Parameters, Sample};

/// How long a look for samples waits: a block of 48 takes 2.4 ms at 20 kHz.
const LOOK: Duration = Duration::from_millis(5);
/// How often the board hears from its host at the least.
const ALIVE: Duration = Duration::from_millis(50);
/// And so many times within the silence that it takes for a lost link.
const TIMES: f32 = 5.0;
/// Without a sample for so long, the stream is gone.
const STARVED: Duration = Duration::from_secs(3);
/// What a board may take beyond its ramp, which takes milliseconds as a rule, until it is at 0 V.
const END: Duration = Duration::from_secs(5);
/// The longest that is waited for.
const LONGEST_RAMP: Duration = Duration::from_secs(600);

/// Runs a prepared board ([`crate::lockstep::prepare_task`], its input the ADC) for `samples` from the first one of the running loop on. Each
/// row is given to `on_row` as it comes; if that fails, the board is stopped and the failure returned. The board ends idle or in its
/// fault, at 0 V; after a fault the record ends where 0 V are reached.
///
/// # Errors
/// [`LockstepError`]. A fault of the board is none, the outcome says it.
pub fn run<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    samples: usize,
    on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    start_stream(session, ready)?;
    let followed = follow(session, ready, samples, on_row);
    // The first failure is the one to tell.
    let left = leave(session);
    let mut outcome = followed?;
    left?;
    outcome.fault = FaultCode::from_number(session.status()?.fault);
    Ok(outcome)
}

/// Whether the link carries every sample of a board that is prepared; asked before anything is written or moves.
///
/// # Errors
/// [`LockstepError::LinkTooSlow`], or what the link makes.
pub fn check_stream<L: Link, E>(session: &mut Session<L>, ready: &Ready) -> Result<(), LockstepError<E>> {
    start_stream(session, ready)?;
    Ok(session.stop_stream()?)
}

fn start_stream<L: Link, E>(session: &mut Session<L>, ready: &Ready) -> Result<(), LockstepError<E>> {
    let every = session.start_stream()?;
    if every == 1 {
        return Ok(());
    }
    session.stop_stream()?;
    let most_hz = f64::from(ready.parameters.rate_hz) / f64::from(every);
    Err(LockstepError::LinkTooSlow { every, most_hz })
}

fn follow<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    samples: usize,
    mut on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    // What is older was left over from a stream before this one.
    let idle_until = session.status()?.samples;
    start(session)?;
    let mut record = Record::new(ready, samples, idle_until);
    let alive = alive(&ready.parameters);
    let (mut heard_at, mut asked_at) = (session.link().now(), session.link().now());
    loop {
        let block = session.next_block(LOOK.min(alive))?;
        let now = session.link().now();
        if let Some(block) = block {
            if record.take(&block, |row| on_row(session, row)).map_err(LockstepError::Row)?.is_break() {
                return Ok(record.outcome);
            }
            // Idle samples do not count: a loop that never begins would be waited for without end.
            if record.first.is_some() {
                heard_at = now;
            }
        }
        if now.saturating_sub(heard_at) > STARVED {
            return Err(SessionError::Silent { request: "StreamStart".into() }.into());
        }
        if now.saturating_sub(asked_at) >= alive {
            asked_at = now;
            session.status()?;
        }
    }
}

/// What was recorded so far.
struct Record<'a> {
    ready: &'a Ready,
    samples: usize,
    reference_step_m: f64,
    /// Number of the last sample of which is known that the loop had not begun.
    idle_until: u32,
    /// Number of the first sample of the loop, and how many follow until the one that comes next. Where the block with its beginning was lost,
    /// that is the first one that may have been in it: a hole at the start is one like any other.
    first: Option<(u32, usize)>,
    last_v: f64,
    outcome: Outcome,
}

impl Record<'_> {
    fn new(ready: &Ready, samples: usize, idle_until: u32) -> Record<'_> {
        let reference_step_m = f64::from(ready.parameters.reference_step_m(&ready.board.converters));
        Record { ready, samples, reference_step_m, idle_until, first: None, last_v: 0.0, outcome: Outcome::default() }
    }

    /// Makes rows of a block; breaks behind the last one that is wanted.
    fn take<E>(&mut self, block: &Block, mut on_row: impl FnMut(&Row) -> Result<(), E>) -> Result<ControlFlow<()>, E> {
        for (k, sample) in block.samples.iter().enumerate() {
            let number = block.first.wrapping_add(k as u32 * u32::from(block.every));
            let mode = sample.flags.mode();
            if self.first.is_none() {
                let is_old = number.wrapping_sub(self.idle_until) > u32::MAX / 2;
                if is_old {
                    continue;
                }
                // Whatever else it is, it was started; in its fault perhaps before a sample of it was heard.
                if mode == ModeName::Idle as u8 || mode == ModeName::Armed as u8 {
                    self.idle_until = number;
                    continue;
                }
                self.first = Some((self.idle_until.wrapping_add(1), 0));
            }
            let Some((first, expected)) = &mut self.first else { continue };
            let index = number.wrapping_sub(*first) as usize;
            // A block that comes behind its turn was counted as lost, and rows are in order.
            if index < *expected {
                continue;
            }
            let end = index.min(self.samples);
            self.outcome.lost.extend(*expected..end);
            *expected = index + 1;
            if index >= self.samples {
                return Ok(ControlFlow::Break(()));
            }
            let row = self.row(index, sample);
            self.outcome.peak_m = self.outcome.peak_m.max(row.displacement_m.abs());
            self.outcome.limited.count(row.limited_by);
            on_row(&row)?;
            if is_safe(mode, row.command_v) || index + 1 == self.samples {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    fn row(&mut self, index: usize, sample: &Sample) -> Row {
        let checked = &self.ready.checked;
        // A drive that came too late was not latched: the one before stays.
        if sample.flags.contains(Flags::OVERRUN) {
            self.outcome.overruns += 1;
        } else {
            self.last_v = f64::from(checked.calibration.drive_v(DacCode(sample.drive)));
        }
        Row {
            index,
            displacement_m: f64::from(checked.calibration.displacement_m(AdcCode(sample.displacement))),
            command_v: self.last_v,
            reference_m: f64::from(sample.reference) * self.reference_step_m,
            monitor_v: Some(f64::from(checked.monitor_v(sample.monitor))),
            limited_by: sample.limited_by,
            is_lost: false,
        }
    }
}

/// Stops the loop and waits for 0 V: the board is idle then, or in its fault.
///
/// # Errors
/// [`SessionError`]; one that is still on its way when its ramp should have ended.
pub fn stop<L: Link>(session: &mut Session<L>) -> Result<(), SessionError> {
    let has = |mode: u8, is: ModeName| mode == is as u8;
    let mode = session.status()?.mode;
    if has(mode, ModeName::Idle) {
        return Ok(());
    }
    if !has(mode, ModeName::Fault) {
        session.stop()?;
    }
    let (ramp, look) = session.parameters().map_or((END, LOOK), |set| (ramp(&set), LOOK.min(alive(&set))));
    let (down, until) = (session.link().now() + ramp, session.link().now() + ramp + END);
    loop {
        let (mode, now) = (session.status()?.mode, session.link().now());
        // A fault says nothing of its ramp.
        if has(mode, ModeName::Idle) || has(mode, ModeName::Fault) && now >= down {
            return Ok(());
        }
        if now >= until {
            return Err(SessionError::NotAtRest);
        }
        // The bench's time passes meanwhile, on a simulated board too.
        session.next_block(look)?;
    }
}

/// How often a board that is set so hears from its host.
fn alive(parameters: &Parameters) -> Duration {
    // Infinity, of a board that waits for nobody, is no duration.
    Duration::try_from_secs_f32(parameters.link_timeout_s / TIMES).map_or(ALIVE, |time| time.min(ALIVE))
}

/// How long the way to 0 V takes at the most. A set that a board has and this program would refuse may be of any slope.
fn ramp(parameters: &Parameters) -> Duration {
    Duration::try_from_secs_f32(parameters.way_to_zero_s()).map_or(LONGEST_RAMP, |ramp| ramp.min(LONGEST_RAMP))
}

/// Samples that the way to 0 V takes at the most where a host's samples move it on: twice its ramp and a second, because a bad line loses some.
pub fn samples_to_rest(parameters: &Parameters) -> u64 {
    let seconds = 2.0 * ramp(parameters).as_secs_f64() + 1.0;
    (seconds * f64::from(parameters.rate_hz)) as u64
}

/// Stops the loop, waits for 0 V and ends the stream.
fn leave<L: Link>(session: &mut Session<L>) -> Result<(), SessionError> {
    stop(session)?;
    session.stop_stream()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::Board;
    use control_core::Limits;
    use wire::Converters;

    /// What becomes of blocks that begin with these numbers, four running samples each.
    fn rows(firsts: &[u32]) -> (Vec<usize>, Vec<usize>) {
        let blocks: Vec<_> = firsts.iter().map(|first| (*first, ModeName::Running)).collect();
        rows_of(&blocks)
    }

    /// The same of blocks in any mode; the board was idle at sample 1000.
    fn rows_of(blocks: &[(u32, ModeName)]) -> (Vec<usize>, Vec<usize>) {
        let (parameters, converters) = (Parameters::NUCLEO_PI1, Converters::NUCLEO_G474RE);
        let checked = parameters.check(&converters).unwrap();
        let board = Board { board: String::new(), firmware: String::new(), converters };
        let ready = Ready { board, parameters, checked, latency_s: 10e-6 };
        let sample = |mode: ModeName| Sample {
            reference: 0,
            displacement: 2048,
            monitor: 2048,
            drive: 2048,
            limited_by: Limits::NONE,
            flags: Flags(mode as u8),
        };
        let mut record = Record::new(&ready, 100, 1000);
        let mut rows = Vec::new();
        for &(first, mode) in blocks {
            let block = Block { first, every: 1, dropped: 0, samples: vec![sample(mode); 4] };
            let taken = record.take(&block, |row| {
                rows.push(row.index);
                Ok::<(), ()>(())
            });
            if taken.unwrap().is_break() {
                break;
            }
        }
        (rows, record.outcome.lost)
    }

    #[test]
    fn a_block_twice_or_behind_its_turn_makes_no_row_and_one_of_before_none_either() {
        assert_eq!(rows(&[1001, 1005]), ((0..8).collect(), vec![]));
        // Of the stream before; the loop ran in it, too.
        assert_eq!(rows(&[900, 1001, 1005]), ((0..8).collect(), vec![]));
        assert_eq!(rows(&[1001, 1001, 1005]), ((0..8).collect(), vec![]));
        assert_eq!(rows(&[1001, 1009, 1005, 1013]), ([0..4, 8..16].into_iter().flatten().collect(), (4..8).collect()));
        // The board began anew.
        let (kept, lost) = rows(&[1001, 3, 7]);
        assert_eq!((kept, lost), ((0..4).collect(), (4..100).collect()));
    }

    #[test]
    fn a_beginning_that_was_not_heard_is_a_hole() {
        use ModeName::{Armed, Fault, Idle, Running};
        assert_eq!(
            rows_of(&[(1001, Idle), (1005, Armed), (1009, Running)]),
            ((0..4).collect(), vec![]),
            "none is missing"
        );
        assert_eq!(rows_of(&[(900, Armed), (1001, Armed), (1013, Running)]), ((8..12).collect(), (0..8).collect()));
        // Not even an idle sample was.
        assert_eq!(rows(&[1005]), ((4..8).collect(), (0..4).collect()));
        // It began and ended there: the record ends with the fault, at 0 V.
        assert_eq!(rows_of(&[(1001, Armed), (1013, Fault), (1017, Fault)]), (vec![8], (0..8).collect()));
        // A fault of before is none of this loop's.
        assert_eq!(rows_of(&[(900, Fault), (1001, Running)]), ((0..4).collect(), vec![]));
    }

    #[test]
    fn a_board_of_less_patience_hears_from_its_host_more_often() {
        let often = |link_timeout_s| alive(&Parameters { link_timeout_s, ..Parameters::NUCLEO_PI1 });
        assert_eq!([0.25, 10.0, f32::INFINITY].map(often), [ALIVE; 3]);
        assert!((often(0.02).as_secs_f64() - 0.004).abs() < 1e-9, "{:?}", often(0.02));
    }
}
