//! A wrapper around any link that damages frames by chance: dropped, delayed, flipped bits, out of order, stalled.
//!
//! The seed decides everything; time is counted in frames of the same direction, so that no clock has a say. For tests, and to see what a run
//! makes of a bad cable.

use crate::link::{Link, LinkError};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;
use std::str::FromStr;
use std::time::Duration;

/// How likely a frame meets what; each from 0 to 1, together at most 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// It is gone.
    pub drop: f64,
    /// It comes before the first, second or third frame after it.
    pub delay: f64,
    /// One to three of its bits are flipped, its end included.
    pub flip: f64,
    /// It comes after the next one.
    pub reorder: f64,
    /// It and all behind it come at once, with the first, second or third frame after it.
    pub stall: f64,
}

impl Faults {
    fn shares(&mut self) -> [(&'static str, &mut f64); 5] {
        [
            ("drop", &mut self.drop),
            ("delay", &mut self.delay),
            ("flip", &mut self.flip),
            ("reorder", &mut self.reorder),
            ("stall", &mut self.stall),
        ]
    }
}

impl FromStr for Faults {
    type Err = String;

    fn from_str(text: &str) -> Result<Faults, String> {
        let mut faults = Faults::default();
        for part in text.split(',') {
            let (kind, share) = part.split_once('=').ok_or("KIND=SHARE,.. of drop, delay, flip, reorder, stall")?;
            let share: f64 = share.parse().map_err(|_| format!("{kind}: not a number"))?;
            let mut shares = faults.shares();
            let Some((_, place)) = shares.iter_mut().find(|(name, _)| *name == kind) else {
                return Err(format!("{kind}: one of drop, delay, flip, reorder, stall"));
            };
            **place = share;
        }
        let shares = faults.shares().map(|(_, share)| *share);
        if shares.iter().all(|share| *share >= 0.0) && shares.iter().sum::<f64>() <= 1.0 {
            Ok(faults)
        } else {
            Err("shares of frames: from 0 to 1, together at most 1".into())
        }
    }
}

/// How often it happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "Faults describes them")]
pub struct Tally {
    pub drop: u64,
    pub delay: u64,
    pub flip: u64,
    pub reorder: u64,
    pub stall: u64,
}

impl Tally {
    /// All together.
    pub fn total(&self) -> u64 {
        self.drop + self.delay + self.flip + self.reorder + self.stall
    }
}

/// One direction.
#[derive(Debug, Default)]
struct Lane {
    /// The beginning of a frame.
    begun: Vec<u8>,
    /// Frames that come later: after so many frames more, before that one or behind it.
    held: VecDeque<(u32, bool, Vec<u8>)>,
    /// With so many frames more the lane moves on, and what waits in it.
    stalled: u32,
    queue: Vec<u8>,
}

/// A link that is not to be trusted.
#[derive(Debug)]
pub struct Faulty<L> {
    inner: L,
    faults: Faults,
    rng: Pcg64Mcg,
    is_on: bool,
    tally: Tally,
    lanes: [Lane; 2],
}

impl<L: Link> Faulty<L> {
    /// `inner`, as good as it is until [`Faulty::switch`] says otherwise.
    pub fn new(inner: L, faults: Faults, seed: u64) -> Faulty<L> {
        Faulty {
            inner,
            faults,
            rng: Pcg64Mcg::seed_from_u64(seed),
            is_on: false,
            tally: Tally::default(),
            lanes: Default::default(),
        }
    }

    /// The link inside.
    pub fn inner(&mut self) -> &mut L {
        &mut self.inner
    }

    /// Begins or ends to damage frames; what is held back then comes all the same.
    pub fn switch(&mut self, is_on: bool) {
        self.is_on = is_on;
    }

    /// What was done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Whether one of the directions stands still.
    pub fn is_stalled(&self) -> bool {
        self.lanes.iter().any(|lane| lane.stalled > 0)
    }

    /// What arrives of `bytes` in one direction.
    fn pass(&mut self, lane: usize, bytes: &[u8]) -> Vec<u8> {
        let mut arrived = Vec::new();
        for byte in bytes {
            self.lanes[lane].begun.push(*byte);
            if *byte == 0 {
                let frame = std::mem::take(&mut self.lanes[lane].begun);
                self.pass_frame(lane, frame, &mut arrived);
            }
        }
        arrived
    }

    fn pass_frame(&mut self, lane: usize, mut frame: Vec<u8>, arrived: &mut Vec<u8>) {
        let mut chance = if self.is_on { self.rng.random_range(0.0..1.0) } else { 1.0 };
        let mut is_it = |share: f64| {
            let is_it = (0.0..share).contains(&chance);
            chance -= share;
            is_it
        };
        let Faults { drop, delay, flip, reorder, stall } = self.faults;
        let [drop, delay, flip, reorder, stall] = [drop, delay, flip, reorder, stall].map(&mut is_it);
        let rng = &mut self.rng;
        let lane = &mut self.lanes[lane];
        // What was held and is due now; before this frame, or behind it.
        let mut behind = Vec::new();
        let mut before = Vec::new();
        lane.held.retain_mut(|(left, is_before, held)| {
            *left -= 1;
            if *left == 0 {
                if *is_before { before.append(held) } else { behind.append(held) }
            }
            *left > 0
        });
        let mut own = Vec::new();
        if drop {
            self.tally.drop += 1;
        } else if delay {
            self.tally.delay += 1;
            lane.held.push_back((rng.random_range(1..=3), true, frame));
        } else if reorder {
            self.tally.reorder += 1;
            lane.held.push_back((1, false, frame));
        } else {
            if flip {
                self.tally.flip += 1;
                for _ in 0..rng.random_range(1..=3) {
                    let bit = rng.random_range(0..8 * frame.len());
                    frame[bit / 8] ^= 1 << (bit % 8);
                }
            }
            own = frame;
        }
        if stall {
            self.tally.stall += 1;
            lane.stalled = lane.stalled.max(rng.random_range(1..=3));
        } else {
            lane.stalled = lane.stalled.saturating_sub(1);
        }
        for frames in [before, own, behind] {
            lane.queue.extend(frames);
        }
        if lane.stalled == 0 {
            arrived.append(&mut lane.queue);
        }
    }
}

impl<L: Link> Link for Faulty<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let arrived = self.pass(0, bytes);
        self.inner.send(&arrived)
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        let begun = self.now();
        let mut left = patience;
        loop {
            let mut bytes = Vec::new();
            self.inner.receive(left, &mut bytes)?;
            let arrived = self.pass(1, &bytes);
            let passed = self.now().saturating_sub(begun);
            left = patience.saturating_sub(passed);
            // Nothing for the caller means that its patience is over, not that a frame was held back.
            if bytes.is_empty() || !arrived.is_empty() || left.is_zero() {
                into.extend(arrived);
                return Ok(());
            }
        }
    }

    fn now(&mut self) -> Duration {
        self.inner.now()
    }

    fn patience(&self) -> Duration {
        self.inner.patience()
    }

    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        self.inner.pause(time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_read_and_nonsense_is_refused() {
        let faults = Faults { drop: 0.01, stall: 0.5, ..Faults::default() };
        assert_eq!("drop=0.01,stall=0.5".parse(), Ok(faults));
        for text in ["", "drop", "drop=x", "soup=0.1", "drop=-0.1", "drop=0.6,flip=0.6", "drop=nan"] {
            assert!(text.parse::<Faults>().is_err(), "{text}");
        }
    }
}
