//! A link that damages frames: nothing wrong is accepted, every loss is counted, two frames later all is well again.
//!
//! 100,000 frames with 1 % of each kind, and of all together; a million with HYSTERON_LONG=1 (`cargo xtask long`).
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use hil_bridge::faulty::{Faults, Faulty, Tally};
use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::lockstep::prepare;
use hil_bridge::session::{Drive, Session};
use hil_bridge::statistics::Statistics;
use std::collections::HashMap;
use std::convert::Infallible;
use std::time::Duration;
use support::{lockstep, noisy, pi1, waveform};
use wire::{Receiver, ToBoard, ToHost};

/// A board in process that keeps a record of what it heard and said over the bridge, before anything could damage it.
struct Witness {
    board: InProcess,
    hears: Receiver,
    speaks: Receiver,
    heard: HashMap<u32, (u16, u16)>,
    said: HashMap<u32, (u16, f32, f32, u8, u8)>,
    frames: u64,
    /// Bytes between the board and the wrapper, so that the record is made when they are said.
    outgoing: Vec<u8>,
}

impl Witness {
    fn new() -> Witness {
        let (hears, speaks) = (Receiver::new(), Receiver::new());
        let board = InProcess::nucleo();
        Witness { board, hears, speaks, heard: HashMap::new(), said: HashMap::new(), frames: 0, outgoing: Vec::new() }
    }
}

impl Link for Witness {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        for byte in bytes {
            if let Some(Ok(frame)) = self.hears.push(*byte)
                && let Ok(ToBoard::BridgeSample { index, displacement, monitor }) = frame.message()
            {
                assert_eq!(self.heard.insert(index, (displacement, monitor)), None, "sample {index} came twice");
            }
        }
        self.board.send(bytes)?;
        let mut said = Vec::new();
        self.board.receive(Duration::ZERO, &mut said)?;
        for byte in &said {
            let Some(frame) = self.speaks.push(*byte) else { continue };
            self.frames += 1;
            if let ToHost::BridgeDrive { index, drive, drive_v, reference_m, limited_by, mode } =
                frame.unwrap().message().unwrap()
            {
                self.said.insert(index, (drive, drive_v, reference_m, limited_by, mode));
            }
        }
        self.outgoing.extend(said);
        Ok(())
    }

    fn receive(&mut self, _: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        into.append(&mut self.outgoing);
        Ok(())
    }

    fn now(&mut self) -> Duration {
        self.board.now()
    }

    fn patience(&self) -> Duration {
        Duration::ZERO
    }
}

/// Frames that the wrapper passes, both ways together.
fn frames() -> u32 {
    if std::env::var_os("HYSTERON_LONG").is_some() { 1_000_000 } else { 100_000 }
}

/// Samples over a link with `faults`, everything checked; what the wrapper did and what the session counted.
fn soak(faults: Faults, seed: u64) -> (Tally, Statistics) {
    let mut session = Session::new(Faulty::new(Witness::new(), faults, seed));
    prepare::<_, Infallible>(&mut session, &pi1(), &waveform("sine:60um@50Hz,for=1000s"), false).unwrap();
    session.order(&ToBoard::Arm).unwrap();
    session.order(&ToBoard::Run).unwrap();
    session.link().switch(true);
    let before = session.statistics().clone();
    let (mut accepted, mut last_code, mut calm) = (0_u64, 2048, 0_u32);
    // Faults until the last answer that was accepted.
    let mut accepted_events = 0;
    for index in 0..frames() / 2 {
        // Slow enough for the guard, and never the same as the sample before.
        let displacement = 2048 + (index % 400).abs_diff(200) as u16;
        let events = session.link().tally().total();
        let was_stalled = session.link().is_stalled();
        let answer: Option<Drive> = session.exchange(displacement, last_code).unwrap();
        let is_calm = !was_stalled && !session.link().is_stalled() && session.link().tally().total() == events;
        calm = if is_calm { calm + 1 } else { 0 };
        // In step again with the second frame after a fault. Of two, one in each direction, the second may hide that the first one's
        // direction has had no frame since: a frame each, then.
        let faults = session.link().tally().total() - accepted_events;
        assert!(
            u64::from(calm) <= faults || answer.is_some(),
            "sample {index} was lost {calm} frames after the last fault"
        );
        if answer.is_some() {
            // What was done in this exchange may be to a frame behind the answer.
            accepted_events = events;
        }
        let witness = session.link().inner();
        if let Some(drive) = answer {
            accepted += 1;
            assert_eq!(witness.heard[&index], (displacement, last_code), "the board heard sample {index} otherwise");
            let said = (drive.code, drive.drive_v, drive.reference_m, drive.limited_by.bits(), drive.mode);
            assert_eq!(witness.said[&index], said, "the host heard sample {index} otherwise");
            last_code = drive.code;
        } else if let Some((heard, _)) = witness.heard.get(&index) {
            assert_eq!(*heard, displacement);
        }
    }
    session.link().switch(false);
    // What is held back comes with these.
    for _ in 0..8 {
        session.status().unwrap();
    }
    let tally = session.link().tally();
    let statistics = session.statistics().clone();
    let samples = u64::from(frames() / 2);
    assert_eq!(statistics.round_trip.total() - before.round_trip.total(), accepted);
    assert_eq!(statistics.requests, statistics.answered + statistics.lost);
    // The status requests at the end may be lost, too, where the last frame before them was; no more than two.
    assert!((0..=2).contains(&(statistics.lost - (samples - accepted))), "{statistics:?}");
    // Every frame that the board sent came, or is counted as missing.
    assert_eq!(session.link().inner().frames, statistics.frames + statistics.missing, "{statistics:?}");
    (tally, statistics)
}

/// One loss for each fault, but for an answer held up whose request was held up, too: 1 % of them; three times that is the most.
fn few_coincide(faults: u64, lost: u64) -> bool {
    (faults * 97 / 100..=faults).contains(&lost)
}

#[test]
fn dropped_frames_are_lost_one_by_one() {
    let (tally, statistics) = soak(Faults { drop: 0.01, ..Faults::default() }, 1);
    assert!(tally.drop > u64::from(frames()) / 200);
    assert_eq!((statistics.lost, statistics.late), (tally.drop, 0));
    assert_eq!((statistics.crc_errors, statistics.malformed, statistics.resyncs), (0, 0, 0));
}

#[test]
fn delayed_frames_are_not_taken_for_the_answer_to_another() {
    let (tally, statistics) = soak(Faults { delay: 0.01, ..Faults::default() }, 2);
    assert!(tally.delay > u64::from(frames()) / 200);
    // A request that comes late is answered late, too: whichever was held up, the answer comes when nobody waits for it any more.
    assert_eq!((statistics.late, statistics.missing), (statistics.lost, 0));
    assert!(few_coincide(tally.delay, statistics.lost), "{tally:?} {statistics:?}");
}

#[test]
fn flipped_bits_are_found_and_cost_two_frames_at_most_each() {
    let (tally, statistics) = soak(Faults { flip: 0.01, ..Faults::default() }, 3);
    assert!(tally.flip > u64::from(frames()) / 200);
    // A bit may be flipped there and back; an end that is flipped takes the next frame along.
    assert!((tally.flip * 9 / 10..=tally.flip * 2).contains(&statistics.lost), "{tally:?} {statistics:?}");
    assert!(statistics.crc_errors > 0 && statistics.malformed > 0 && statistics.resyncs > 0);
}

#[test]
fn frames_out_of_order_are_counted_and_dropped() {
    let (tally, statistics) = soak(Faults { reorder: 0.01, ..Faults::default() }, 4);
    assert!(tally.reorder > u64::from(frames()) / 200);
    assert_eq!((statistics.late, statistics.missing), (statistics.lost, 0));
    assert!(few_coincide(tally.reorder, statistics.lost), "{tally:?} {statistics:?}");
    assert!(statistics.out_of_order > 0, "{statistics:?}");
}

#[test]
fn a_stall_ends_with_everything_at_once_and_only_the_last_counts() {
    let (tally, statistics) = soak(Faults { stall: 0.01, ..Faults::default() }, 5);
    assert!(tally.stall > u64::from(frames()) / 200);
    assert_eq!(statistics.late, statistics.lost);
    assert!(statistics.lost >= tally.stall, "{tally:?} {statistics:?}");
}

#[test]
fn all_of_them_together_are_no_worse() {
    let faults = Faults { drop: 0.01, delay: 0.01, flip: 0.01, reorder: 0.01, stall: 0.01 };
    let (tally, _) = soak(faults, 6);
    assert!(tally.drop.min(tally.delay).min(tally.flip).min(tally.reorder).min(tally.stall) > 0);
}

#[test]
fn a_run_over_a_bad_link_holds_the_drive_and_repeats() {
    let run = |seed| {
        let mut link = Faulty::new(InProcess::nucleo(), "drop=0.002,flip=0.002".parse().unwrap(), seed);
        link.switch(true);
        let mut session = Session::new(link);
        let mut done = lockstep(&mut session, &noisy(), "step:40um@1s", 4000, 1).unwrap();
        assert_eq!(done.outcome.fault, None);
        let lost: Vec<usize> = done.rows.iter().filter(|row| row.is_lost).map(|row| row.index).collect();
        assert_eq!(done.outcome.lost, lost);
        for index in lost.iter().filter(|index| **index > 0) {
            assert_eq!(done.rows[*index].command_v, done.rows[*index - 1].command_v);
        }
        // And the loop holds 40 um all the same: two of the ADC's codes of 63.5 nm and the noise's five sigma.
        let last = done.rows.pop().unwrap();
        assert!((last.displacement_m - 40e-6).abs() < 0.25e-6, "{last:?}");
        (done.rows, lost)
    };
    // The seed is one that leaves the requests before the run alone.
    let (rows, lost) = run(1);
    assert!(lost.len() > 5, "{lost:?}");
    assert_eq!(run(1).0, rows);
}
