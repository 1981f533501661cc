//! The capture buffer: samples around a trigger at the full rate, read out at leisure.
//!
//! A ring of [`SAMPLES`] samples that turns until `before` of them precede the trigger and the rest follow it.

use crate::shared::{Lent, Record};
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use wire::Trigger;

/// Samples it holds: 0.1 s at 20 kHz, 20 KB.
pub const SAMPLES: usize = 2048;

static RING: Lent<[[u8; wire::SAMPLE_BYTES]; SAMPLES]> = Lent::new([[0; wire::SAMPLE_BYTES]; SAMPLES]);
/// Bit 31: complete. Lower bits: index of the oldest sample in the ring.
static COMPLETE: AtomicU32 = AtomicU32::new(0);
/// Number of the oldest sample.
static FIRST: AtomicU32 = AtomicU32::new(0);
/// Blocks that the link has been asked for and has not read yet; only its two tasks touch it.
static WANTED: AtomicU32 = AtomicU32::new(0);
/// A block was read.
static READ: Signal<CriticalSectionRawMutex, ()> = Signal::new();
const DONE: u32 = 1 << 31;

/// The loop's side.
#[derive(Clone, Copy)]
pub struct Capture {
    phase: Phase,
    write_idx: usize,
    /// Samples in the ring, up to its size.
    filled: usize,
    before: usize,
    trigger: Trigger,
}

#[derive(Clone, Copy, PartialEq)]
enum Phase {
    Off,
    Waiting,
    Filling { left: usize },
}

impl Capture {
    /// Off.
    pub const fn new() -> Capture {
        Capture { phase: Phase::Off, write_idx: 0, filled: 0, before: 0, trigger: Trigger::Now }
    }

    /// Whether [`Capture::note`] has anything to do.
    #[inline(always)]
    pub fn is_on(&self) -> bool {
        self.phase != Phase::Off
    }

    /// Begins anew; what was captured before is gone. The link asks for it only when no block is still to be read ([`all_read`]).
    pub fn arm(&mut self, before: u16, trigger: Trigger) {
        COMPLETE.store(0, Ordering::Relaxed);
        *self = Capture {
            phase: Phase::Waiting,
            write_idx: 0,
            filled: 0,
            before: usize::from(before).min(SAMPLES - 1),
            trigger,
        };
    }

    /// Takes one sample. `has_begun` and `has_faulted`: in this sample.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.capture")]
    pub fn note(&mut self, record: &Record, has_begun: bool, has_faulted: bool) {
        // SAFETY: the link reads the ring only while `COMPLETE` says done; then the phase is off and this is not called, until `arm`, which
        // no read is under way at.
        let ring = unsafe { &mut *RING.get() };
        if let Some(place) = ring.get_mut(self.write_idx) {
            *place = record.sample.to_bytes();
        }
        self.write_idx = if self.write_idx + 1 >= SAMPLES { 0 } else { self.write_idx + 1 };
        self.filled = if self.filled < SAMPLES { self.filled + 1 } else { SAMPLES };
        let is_triggered = match self.trigger {
            Trigger::Now => true,
            Trigger::Run => has_begun,
            Trigger::Fault => has_faulted,
        };
        match self.phase {
            // With fewer samples before the trigger than asked for, there are more after it.
            Phase::Waiting if is_triggered => {
                let before = if self.filled - 1 < self.before { self.filled - 1 } else { self.before };
                self.proceed(SAMPLES - 1 - before, record.number);
            }
            Phase::Filling { left } => self.proceed(left - 1, record.number),
            _ => {}
        }
    }

    #[inline(always)]
    fn proceed(&mut self, left: usize, number: u32) {
        if left > 0 {
            self.phase = Phase::Filling { left };
            return;
        }
        self.phase = Phase::Off;
        // The ring is full: the oldest sample lies where the next would go.
        FIRST.store(number.wrapping_sub(SAMPLES as u32 - 1), Ordering::Relaxed);
        COMPLETE.store(DONE | self.write_idx as u32, Ordering::Release);
    }
}

impl Default for Capture {
    fn default() -> Capture {
        Capture::new()
    }
}

/// A block is asked for: one [`read`] will follow.
pub fn want() {
    WANTED.fetch_add(1, Ordering::Relaxed);
}

/// Waits until every block that was asked for has been read.
pub async fn all_read() {
    while WANTED.load(Ordering::Acquire) != 0 {
        READ.wait().await;
    }
}

/// Copies samples from `from` on into `bytes`; returns how many bytes, how many samples there are in all, and the first one's number. Once for
/// each [`want`].
pub fn read(from: u16, bytes: &mut [u8]) -> (usize, u16, u32) {
    let block = copy(from, bytes);
    WANTED.fetch_sub(1, Ordering::Release);
    READ.signal(());
    block
}

fn copy(from: u16, bytes: &mut [u8]) -> (usize, u16, u32) {
    let complete = COMPLETE.load(Ordering::Acquire);
    if complete & DONE == 0 {
        return (0, 0, 0);
    }
    let oldest = (complete & !DONE) as usize;
    // SAFETY: complete, so the loop writes no more until it is armed anew, and the link asks for that only after this read (`all_read`).
    let ring = unsafe { &*RING.get() };
    let mut n_bytes = 0;
    let (places, _) = bytes.as_chunks_mut::<{ wire::SAMPLE_BYTES }>();
    for (place, k) in places.iter_mut().zip(usize::from(from)..SAMPLES) {
        if let Some(sample) = ring.get((oldest + k) % SAMPLES) {
            *place = *sample;
            n_bytes += place.len();
        }
    }
    (n_bytes, SAMPLES as u16, FIRST.load(Ordering::Relaxed))
}
