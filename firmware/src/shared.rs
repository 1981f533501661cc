//! What the loop (the control interrupt and the one behind it) and the rest of the program share: lock-free queues, atomics, and the way to wake the rest.
//!
//! Neither may wait, so nothing here may need a critical section on their side.

use crate::ring::Ring;
use control_core::{ModeName, Refused, Segment};
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use wire::{Checked, InputSource, Sample, Trigger};

/// What the loop is asked to do, between two samples, one request per sample at most.
#[derive(Clone, Copy)]
pub enum Request {
    /// See [`control_core::Controller::arm`].
    Arm,
    /// See [`control_core::Controller::run`].
    Run,
    /// See [`control_core::Controller::stop`].
    Stop,
    /// See [`control_core::Controller::clear_fault`].
    ClearFault,
    /// Put another set in force with this sample.
    Apply(&'static Checked),
    /// Closed loop to this reference, in metres.
    Reference(f32),
    /// Open loop, this drive in volts.
    Drive(f32),
    /// Play these segments when running.
    Wave {
        /// They are references in metres; else drives in volts.
        is_closed_loop: bool,
        /// The waveform.
        segments: &'static [Segment<'static>],
    },
    /// Where the displacement comes from.
    Input(InputSource),
    /// The displacement of one sample.
    Bridge {
        /// ADC code.
        displacement: u16,
        /// Monitor's ADC code.
        monitor: u16,
    },
    /// Every n-th sample to the stream; 0 for none.
    Stream(u16),
    /// Arms the capture buffer.
    Capture {
        /// Samples from before the trigger.
        before: u16,
        /// What to wait for.
        trigger: Trigger,
    },
}

/// What it answers, one reply per request.
#[derive(Clone, Copy)]
pub enum Reply {
    /// Done.
    Done,
    /// The mode machine says no.
    Refused(Refused),
    /// Only while idle.
    NotIdle,
    /// A sample over the bridge, but the input is the ADC.
    NotBridge,
    /// One sample over the bridge.
    Bridge {
        /// DAC code that the DAC would have got.
        drive: u16,
        /// Volts before it.
        drive_v: f32,
        /// Reference in use, in metres.
        reference_m: f32,
        /// Bits of the limits.
        limited_by: u8,
    },
}

/// A sample with its number.
#[derive(Clone, Copy)]
pub struct Record {
    /// Samples since the board started.
    pub number: u32,
    /// What was recorded.
    pub sample: Sample,
}

/// From the link to the loop. One request is under way at a time.
pub static REQUESTS: Ring<Request, 2> = Ring::new();
/// From the loop to the link, one per request.
pub static REPLIES: Ring<Reply, 2> = Ring::new();
/// From the loop to the sender: 51 ms of stream at 20 kHz, so that an answer of half a kilobyte in between loses nothing.
pub static RECORDS: Ring<Record, 1024> = Ring::new();

/// Samples since the start.
pub static SAMPLES: AtomicU32 = AtomicU32::new(0);
/// Mode, fault and input: see [`State`].
pub static STATE: AtomicU32 = AtomicU32::new(0);
/// Drives that were not ready for their latch.
pub static OVERRUNS: AtomicU32 = AtomicU32::new(0);
/// Samples overwritten unread.
pub static LOST: AtomicU32 = AtomicU32::new(0);
/// Cycles from the ADC's trigger to the drive being ready: the last in the lower half, the most in the upper.
pub static READY: AtomicU32 = AtomicU32::new(0);
/// Stream samples dropped since the stream began, because the link was busy.
pub static DROPPED: AtomicU32 = AtomicU32::new(0);
/// The sample in which the present fault was seen.
pub static FAULT_SAMPLE: AtomicU32 = AtomicU32::new(0);

/// Mode, fault and input in one word, so that they always belong together.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct State {
    /// Number of [`ModeName`].
    pub mode: u8,
    /// Number of [`control_core::FaultCode`]; 0 for none.
    pub fault: u8,
    /// Where the displacement comes from.
    pub input: InputSource,
}

impl State {
    /// The present state.
    pub fn now() -> State {
        let word = STATE.load(Ordering::Relaxed);
        let input = if word >> 16 & 1 == 0 { InputSource::Analog } else { InputSource::Bridge };
        State { mode: word as u8, fault: (word >> 8) as u8, input }
    }

    /// As [`STATE`] holds it.
    pub fn word(self) -> u32 {
        let input = matches!(self.input, InputSource::Bridge);
        u32::from(self.mode) | u32::from(self.fault) << 8 | u32::from(input) << 16
    }

    /// Nothing drives and nothing will until an arm.
    pub fn is_idle(self) -> bool {
        self.mode == ModeName::Idle as u8
    }
}

/// Wakes whoever waits for a reply.
pub static REPLIED: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Wakes the sender: stream samples are there, or the state has changed.
pub static SENDABLE: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Wakes the supervisor, every 64 samples.
pub static ALIVE: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The interrupt that the loop pends to wake the rest. It is the CORDIC's, which nothing here uses, and has the lowest
/// priority; wakers need a critical section, which the loop may not rely on.
#[unsafe(no_mangle)]
extern "C" fn CORDIC() {
    REPLIED.signal(());
    SENDABLE.signal(());
    ALIVE.signal(());
}

/// Something that one side writes while the other is known not to read it; each use says how that is known.
pub struct Lent<T>(UnsafeCell<T>);

// SAFETY: the users of `get` keep the two sides apart, as its contract asks.
unsafe impl<T> Sync for Lent<T> {}

impl<T> Lent<T> {
    /// Holds `value`.
    pub const fn new(value: T) -> Lent<T> {
        Lent(UnsafeCell::new(value))
    }

    /// A pointer to the value.
    pub const fn get(&self) -> *mut T {
        self.0.get()
    }
}
