//! The control interrupt: one sample of the board.
//!
//! Deadline: 1700 cycles (10 us) from the instant at which the ADC holds its input to the timer latching the DAC. A drive
//! that comes later is an overrun: the DAC holds the old one, the law goes on from that one, the sample is counted and marked, and too many
//! of them are a fault. Code and data lie in CCM SRAM, which has no wait states. Nothing here waits, allocates, logs, divides 64-bit numbers or panics.
//!
//! What can wait for the drive to be out is done by [`crate::between`], an interrupt of the next lower priority that this one
//! pends: requests, stream, capture, the account of the state. It holds the loop's state meanwhile, and says so. A control interrupt that
//! finds it held touches nothing, keeps the old drive and counts an overrun: neither side ever waits.

use crate::capture::Capture;
use crate::shared::{self, Reply};
use crate::{Board, Reading, registers};
use control_core::{AdcCode, Command, Controller, DacCode, FaultCode, Input, Limits, ModeName, Output};
use core::mem::MaybeUninit;
use core::sync::atomic::Ordering::Relaxed;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering, compiler_fence};
use wire::{Checked, InputSource};

/// Overruns count 256 each and fade by one a sample: `overrun_limit` of them within about 256 samples are a fault.
const OVERRUN_WEIGHT: u32 = 256;
/// So many times as many in the fault mode take ENABLE off.
const GIVEN_UP: u32 = 2;

/// The loop's state is the control interrupt's.
pub(crate) const OPEN: u8 = 0;
/// [`crate::between`] works on it.
pub(crate) const HELD: u8 = 1;
/// The bridge is the input: the board's own samples move nothing.
pub(crate) const ASIDE: u8 = 2;

/// The loop's memory, in one place so that one address leads to all of it. Its name and its first byte are what a debugger, and the test of
/// a state that is held too long, go by.
#[repr(C)]
pub(crate) struct Loop {
    /// Whether the control interrupt may work on `control`: [`OPEN`], [`HELD`] or [`ASIDE`].
    pub(crate) gate: AtomicU8,
    /// Samples since the start.
    pub(crate) samples: AtomicU32,
    /// `samples` when the host was last heard; the link writes it.
    pub(crate) heard: AtomicU32,
    /// What only the control interrupt touches.
    beat: shared::Lent<Beat>,
    /// What belongs to the control interrupt, and to [`crate::between`] while the gate is [`HELD`].
    pub(crate) control: shared::Lent<MaybeUninit<Control>>,
}

/// The control interrupt's own, whoever holds the rest.
struct Beat {
    overrun_score: u32,
    /// What ENABLE's port was last told.
    enable: u32,
    ready_max_cycles: u32,
}

/// The loop's state.
pub(crate) struct Control {
    pub(crate) controller: Controller,
    pub(crate) set: &'static Checked,
    pub(crate) command: Command<'static>,
    pub(crate) input: InputSource,
    pub(crate) monitor_misses: u32,
    pub(crate) last: Last,
    /// Late drives go on and on in the fault mode, so that its ramp does not end: ENABLE is the way that is left.
    is_given_up: bool,
    pub(crate) capture: Capture,
    pub(crate) desk: crate::between::Desk,
}

/// The last sample, for who comes after it.
pub(crate) struct Last {
    pub(crate) number: u32,
    pub(crate) displacement: u16,
    pub(crate) monitor: u16,
    pub(crate) output: Output,
    pub(crate) drive: u16,
    /// Cycles from the ADC's trigger to the drive being ready, the last one and the most.
    pub(crate) ready_cycles: u32,
    pub(crate) ready_max_cycles: u32,
    pub(crate) is_late: bool,
    /// Nobody has looked at it yet.
    pub(crate) is_new: bool,
}

#[unsafe(link_section = ".ccmram.data.control")]
#[unsafe(export_name = "hysteron_loop")]
pub(crate) static LOOP: Loop = Loop {
    samples: AtomicU32::new(0),
    heard: AtomicU32::new(0),
    gate: AtomicU8::new(OPEN),
    beat: shared::Lent::new(Beat { overrun_score: 0, enable: registers::ENABLE_LOW, ready_max_cycles: 0 }),
    control: shared::Lent::new(MaybeUninit::uninit()),
};

/// Sets up what [`on_sample`] works on. To be called once, before the control interrupt is enabled.
pub fn begin(set: &'static Checked, fault: Option<FaultCode>) {
    let controller = match fault {
        Some(code) => Controller::in_fault(set.law, code),
        None => Controller::new(set.law),
    };
    let control = Control {
        controller,
        set,
        command: Command::Reference { reference_m: 0.0 },
        input: InputSource::Analog,
        monitor_misses: 0,
        last: Last {
            number: 0,
            displacement: 0,
            monitor: 0,
            output: Output { drive_v: 0.0, reference_m: 0.0, limited_by: Limits::NONE },
            drive: set.calibration.safe_code().0,
            ready_cycles: 0,
            ready_max_cycles: 0,
            is_late: false,
            is_new: false,
        },
        is_given_up: false,
        capture: Capture::new(),
        desk: crate::between::Desk::new(),
    };
    // SAFETY: the control interrupt is not enabled yet, so nobody else looks at it.
    unsafe { (*LOOP.control.get()).write(control) };
}

/// One sample. The whole body of a board's control interrupt.
///
/// # Safety
///
/// Only from the control interrupt, after [`begin`].
#[inline(always)]
pub unsafe fn on_sample<B: Board>() {
    let reading = B::take();
    let sample = LOOP.samples.load(Relaxed).wrapping_add(1);
    LOOP.samples.store(sample, Relaxed);
    // SAFETY: only this interrupt, which can't interrupt itself, touches it.
    let beat = unsafe { &mut *LOOP.beat.get() };
    let gate = LOOP.gate.load(Relaxed);
    if gate == HELD {
        beat.miss();
    } else {
        compiler_fence(Ordering::Acquire);
        // SAFETY: `begin` has written it. `between` does not hold it, and can't take it before this interrupt, which is of higher
        // priority, has ended.
        let control = unsafe { (*LOOP.control.get()).assume_init_mut() };
        if gate == OPEN {
            control.sample::<B>(beat, sample, reading)
        } else {
            control.aside::<B>(beat, sample)
        }
        compiler_fence(Ordering::Release);
    }
    registers::pend_between();
}

impl Beat {
    /// A sample that finds the state held, because whoever works between the samples took a whole period for it: the DAC keeps its drive,
    /// ENABLE stands still, and it counts as an overrun.
    #[cold]
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.miss")]
    fn miss(&mut self) {
        self.overrun_score += OVERRUN_WEIGHT;
        add_one(&shared::OVERRUNS);
    }
}

impl Control {
    #[inline(always)]
    fn sample<B: Board>(&mut self, beat: &mut Beat, sample: u32, reading: Reading) {
        if !matches!(self.controller.mode_name(), ModeName::Idle | ModeName::Fault) {
            self.watch(sample, reading);
        } else if reading.is_one_lost {
            add_one(&shared::LOST);
        }
        let output = self.tick(reading.displacement);
        let code = self.set.calibration.dac_code(output.drive_v);
        B::put(code.0);
        let ready_cycles = registers::count();
        let is_on = self.is_amplifier_wanted(&output);
        beat.enable = if is_on { beat.enable ^ registers::ENABLE_TOGGLE } else { registers::ENABLE_LOW };
        registers::write_enable(beat.enable);
        if ready_cycles > beat.ready_max_cycles {
            beat.ready_max_cycles = ready_cycles;
        }
        let (displacement, monitor) = (reading.displacement, reading.monitor);
        let held_v = self.last.output.drive_v;
        self.last = Last {
            number: sample,
            displacement,
            monitor,
            output,
            drive: code.0,
            ready_cycles,
            ready_max_cycles: beat.ready_max_cycles,
            is_late: false,
            is_new: true,
        };
        let is_late = ready_cycles >= B::CONVERTERS.deadline_cycles() - B::PUT_CYCLES;
        if is_late || beat.overrun_score != 0 {
            self.score::<B>(beat, is_late, held_v);
        }
    }

    /// One tick of the law with its mode machine.
    #[inline(always)]
    pub(crate) fn tick(&mut self, displacement: u16) -> Output {
        let measured_m = self.set.calibration.displacement_m(AdcCode(displacement));
        self.controller.tick(&Input { command: self.command, measured_m })
    }

    /// Over the bridge the host's samples are the clock: here the DAC is held at the safe level, and only the host's silence is watched.
    #[cold]
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.aside")]
    fn aside<B: Board>(&mut self, beat: &mut Beat, sample: u32) {
        beat.enable = registers::ENABLE_LOW;
        registers::write_enable(beat.enable);
        B::put(self.set.calibration.safe_code().0);
        if self.is_host_lost(sample) {
            self.controller.trip(FaultCode::LinkLoss);
        }
    }

    /// From arming (the DAC has been at the safe level since the start) until 0 V is reached again, or can't be. While it is so, ENABLE is toggled each
    /// sample: a loop that hangs toggles nothing, and the monostable behind the pin falls back.
    #[inline(always)]
    pub(crate) fn is_amplifier_wanted(&self, output: &Output) -> bool {
        match self.controller.mode_name() {
            ModeName::Idle => false,
            ModeName::Armed | ModeName::Running | ModeName::Stopping => true,
            ModeName::Fault => output.drive_v != 0.0 && !self.is_given_up,
        }
    }

    /// Faults that only the board can see: one look whether there may be any, in all modes in which there can be.
    #[inline(always)]
    fn watch(&mut self, sample: u32, reading: Reading) {
        self.monitor_misses = if self.is_monitor_fine(reading.monitor) { 0 } else { self.monitor_misses + 1 };
        let is_fine = self.monitor_misses < u32::from(self.set.monitor_samples)
            && !self.set.is_at_rail(AdcCode(reading.displacement))
            && !reading.is_one_lost
            && registers::is_stop_chain_closed()
            && sample.wrapping_sub(LOOP.heard.load(Relaxed)) <= self.set.link_timeout_samples;
        if !is_fine {
            self.examine(sample, reading.displacement, Some(reading.is_one_lost));
        }
    }

    /// The monitor was sampled with the displacement, before this sample's latch: it shows the drive of the sample before. A NaN is a miss.
    #[inline(always)]
    fn is_monitor_fine(&self, monitor: u16) -> bool {
        let set = self.set;
        (set.monitor_v(monitor) - self.last.output.drive_v).abs() <= set.monitor_tolerance_v
    }

    #[inline(always)]
    fn is_host_lost(&self, sample: u32) -> bool {
        !matches!(self.controller.mode_name(), ModeName::Idle | ModeName::Fault)
            && sample.wrapping_sub(LOOP.heard.load(Relaxed)) > self.set.link_timeout_samples
    }

    /// Which fault it is, if it is one. `is_one_lost` is the ADC's; over the bridge there is none. Of several the last named here counts. A fault that is latched already stays the first.
    #[cold]
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.examine")]
    pub(crate) fn examine(&mut self, sample: u32, displacement: u16, is_one_lost: Option<bool>) {
        let mut fault = None;
        if self.monitor_misses >= u32::from(self.set.monitor_samples) {
            fault = Some(FaultCode::DriveMismatch);
        }
        if self.set.is_at_rail(AdcCode(displacement)) {
            fault = Some(FaultCode::SensorRail);
        }
        if is_one_lost == Some(true) {
            add_one(&shared::LOST);
            fault = Some(FaultCode::AdcLate);
        }
        if self.is_host_lost(sample) {
            fault = Some(FaultCode::LinkLoss);
        }
        if is_one_lost.is_some() && !registers::is_stop_chain_closed() {
            fault = Some(FaultCode::EmergencyStop);
        }
        if let Some(code) = fault {
            self.controller.trip(code);
        }
    }

    /// Counts what was late, and lets what was late before fade. `held_v` is the drive before this one.
    #[cold]
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.score")]
    fn score<B: Board>(&mut self, beat: &mut Beat, is_late: bool, held_v: f32) {
        let is_late = is_late && self.hold::<B>(held_v);
        if is_late {
            beat.overrun_score += OVERRUN_WEIGHT;
            add_one(&shared::OVERRUNS);
        }
        let most = u32::from(self.set.overrun_limit) * OVERRUN_WEIGHT;
        // More would keep a loop that could run again from running, for as long as it lasted.
        beat.overrun_score = beat.overrun_score.min(GIVEN_UP * most);
        match self.controller.mode_name() {
            ModeName::Idle => {}
            ModeName::Fault if beat.overrun_score >= GIVEN_UP * most => {
                self.is_given_up = true;
                beat.enable = registers::ENABLE_LOW;
                registers::write_enable(beat.enable);
            }
            ModeName::Fault => {}
            _ if beat.overrun_score >= most => self.controller.trip(FaultCode::Overrun),
            _ => {}
        }
        if !is_late {
            beat.overrun_score = beat.overrun_score.saturating_sub(1);
        }
    }

    /// The last code came after its latch, as far as the timer tells: law and DAC stay with the drive before. Left where it was put, the code would
    /// come out at the next latch if that sample is late, too, and the law would not know. False, and nothing done, if it is out all the same.
    #[inline(always)]
    fn hold<B: Board>(&mut self, held_v: f32) -> bool {
        let DacCode(held) = self.set.calibration.dac_code(held_v);
        // Equal codes tell nothing, and make no difference.
        if held != self.last.drive && B::output() == Some(self.last.drive) {
            return false;
        }
        B::put_back(held);
        self.controller.not_latched(held_v);
        self.last.drive = held;
        self.last.output.drive_v = held_v;
        self.last.is_late = true;
        true
    }

    /// Leaves the fault mode, and what it had to give up with it.
    pub(crate) fn clear_fault(&mut self) -> Result<(), control_core::Refused> {
        self.controller.clear_fault().inspect(|()| self.is_given_up = false)
    }

    /// One sample over the bridge, between the samples of the board. The law is the same; the DAC does not hear of it.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.bridge")]
    pub(crate) fn bridge(&mut self, displacement: u16, monitor: u16) -> Reply {
        let number = LOOP.samples.load(Relaxed);
        if !matches!(self.controller.mode_name(), ModeName::Idle | ModeName::Fault) {
            self.monitor_misses = if self.is_monitor_fine(monitor) { 0 } else { self.monitor_misses + 1 };
            self.examine(number, displacement, None);
        }
        let output = self.tick(displacement);
        let DacCode(drive) = self.set.calibration.dac_code(output.drive_v);
        self.last = Last { number, displacement, monitor, output, drive, is_late: false, is_new: true, ..self.last };
        let Output { drive_v, reference_m, limited_by } = output;
        Reply::Bridge { drive, drive_v, reference_m, limited_by: limited_by.bits() }
    }
}

#[inline(always)]
fn add_one(counter: &AtomicU32) {
    counter.store(counter.load(Relaxed).wrapping_add(1), Relaxed);
}
