//! Between two samples: requests to the loop, the stream, the capture, the account of its state.
//!
//! The control interrupt pends this one at its end, so that it begins when the drive is out and ends long before the next sample (a
//! period has 3400 cycles at the very least). It has the next lower priority: only the control interrupt interrupts it, finds the
//! state held then, and counts an overrun. Nothing here waits, allocates, logs or panics.

use crate::control::{ASIDE, Control, HELD, LOOP, Last, OPEN};
use crate::registers;
use crate::shared::{self, Record, Reply, Request, State};
use control_core::{Command, Generator, Mode, ModeName, Refused};
use core::sync::atomic::Ordering::Relaxed;
use core::sync::atomic::{Ordering, compiler_fence};
use wire::{Flags, InputSource, Sample};

/// Samples between two calls of the rest of the program, where nothing else calls it.
const WAKE_SAMPLES: u32 = 64;

/// What is remembered from one time to the next.
pub(crate) struct Desk {
    /// [`shared::STATE`] as last written.
    state: u32,
    woken_at: u32,
    noted_mode: ModeName,
    noted_number: u32,
    stream_every: u16,
    stream_countdown: u16,
}

impl Desk {
    pub(crate) const fn new() -> Desk {
        // No state's word, so that the first one is written.
        let state = u32::MAX;
        let noted_mode = ModeName::Idle;
        Desk { state, woken_at: 0, noted_mode, noted_number: 0, stream_every: 0, stream_countdown: 0 }
    }
}

/// FMAC's interrupt, which nothing here uses, stands for "between two samples".
#[unsafe(no_mangle)]
#[unsafe(link_section = ".ccmram.between")]
extern "C" fn FMAC() {
    LOOP.gate.store(HELD, Relaxed);
    compiler_fence(Ordering::Acquire);
    // SAFETY: only the control interrupt pends this one, so `begin` has written it; that one keeps off while the gate says so, and nobody
    // else touches it.
    let control = unsafe { (*LOOP.control.get()).assume_init_mut() };
    control.between();
    let gate = if matches!(control.input, InputSource::Analog) { OPEN } else { ASIDE };
    compiler_fence(Ordering::Release);
    LOOP.gate.store(gate, Relaxed);
}

impl Control {
    #[inline(always)]
    fn between(&mut self) {
        self.note();
        let mut wake = false;
        // SAFETY: the only place that takes requests.
        if let Some(request) = unsafe { shared::REQUESTS.pop() } {
            let reply = self.obey(&request);
            // There is room: one request is under way at a time, and its reply was taken before.
            // SAFETY: the only side that replies.
            let _ = unsafe { shared::REPLIES.push(reply) };
            // A sample over the bridge.
            self.note();
            wake = true;
        }
        let samples = LOOP.samples.load(Relaxed);
        shared::SAMPLES.store(samples, Relaxed);
        shared::READY.store(half_word(self.last.ready_cycles) | half_word(self.last.ready_max_cycles) << 16, Relaxed);
        let fault = match self.controller.mode() {
            Mode::Fault { code, .. } => code.number(),
            _ => 0,
        };
        let state = State { mode: self.controller.mode_name() as u8, fault, input: self.input }.word();
        if state != self.desk.state {
            self.desk.state = state;
            shared::STATE.store(state, Relaxed);
            wake = true;
        }
        if wake || samples.wrapping_sub(self.desk.woken_at) >= WAKE_SAMPLES {
            self.desk.woken_at = samples;
            registers::pend_wake();
        }
        self.controller.prepare(&self.command);
    }

    /// Hands the last sample, if it is a new one, to stream and capture.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.between.note")]
    fn note(&mut self) {
        if !self.last.is_new {
            return;
        }
        self.last.is_new = false;
        let Last { number, displacement, monitor, output, drive, is_late, .. } = self.last;
        let desk = &mut self.desk;
        let mode = self.controller.mode_name();
        let last_mode = core::mem::replace(&mut desk.noted_mode, mode);
        let last_number = core::mem::replace(&mut desk.noted_number, number);
        let has_faulted = mode == ModeName::Fault && last_mode != ModeName::Fault;
        if has_faulted {
            shared::FAULT_SAMPLE.store(number, Relaxed);
        }
        let is_bridged = matches!(self.input, InputSource::Bridge);
        let is_streamed = desk.stream_every != 0 && {
            // A sample that was counted and never came here: the next control interrupt was faster.
            if !is_bridged && number.wrapping_sub(last_number) > 1 {
                drop_one();
            }
            desk.stream_countdown = desk.stream_countdown.wrapping_sub(1);
            desk.stream_countdown == 0
        };
        let is_captured = self.capture.is_on();
        if !is_streamed && !is_captured {
            return;
        }
        let flag = |is_set: bool, flag: Flags| if is_set { flag.0 } else { 0 };
        let is_enabled = !is_bridged && self.is_amplifier_wanted(&output);
        let flags = mode as u8
            | flag(is_late, Flags::OVERRUN)
            | flag(is_bridged, Flags::BRIDGE)
            | flag(is_enabled, Flags::ENABLE);
        let sample = Sample {
            reference: nearest(output.reference_m * self.set.reference_steps_per_m),
            displacement,
            monitor,
            drive,
            limited_by: output.limited_by,
            flags: Flags(flags),
        };
        let record = Record { number, sample };
        if is_captured {
            self.capture.note(&record, mode == ModeName::Running && last_mode != ModeName::Running, has_faulted);
        }
        if !is_streamed {
            return;
        }
        // The sender is woken every 64 samples, which is often enough for a queue of 1023.
        self.desk.stream_countdown = self.desk.stream_every;
        // SAFETY: the only place that makes records.
        if !unsafe { shared::RECORDS.push(record) } {
            drop_one();
        }
    }

    /// Carries out a request, with effect from the next sample on.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.between.obey")]
    fn obey(&mut self, request: &Request) -> Reply {
        let is_idle = matches!(self.controller.mode(), Mode::Idle);
        let result = match *request {
            // One that is refused changes nothing.
            Request::Arm => self.controller.arm().inspect(|()| self.monitor_misses = 0),
            Request::Run => self.controller.run(),
            Request::Stop => self.controller.stop(),
            Request::ClearFault => self.clear_fault(),
            Request::Apply(set) => {
                if set.period_cycles != self.set.period_cycles {
                    registers::set_period(set.period_cycles);
                }
                self.controller.exchange_law(set.law);
                self.set = set;
                Ok(())
            }
            Request::Reference(reference_m) => self.take(Command::Reference { reference_m }),
            Request::Drive(drive_v) => self.take(Command::Drive { drive_v }),
            Request::Wave { is_closed_loop: true, segments } => {
                self.take(Command::GeneratedReference(Generator::new(segments)))
            }
            Request::Wave { is_closed_loop: false, segments } => {
                self.take(Command::GeneratedDrive(Generator::new(segments)))
            }
            Request::Input(_) if !is_idle => return Reply::NotIdle,
            Request::Input(input) => {
                self.input = input;
                Ok(())
            }
            Request::Bridge { displacement, monitor } => {
                return match self.input {
                    InputSource::Bridge => self.bridge(displacement, monitor),
                    InputSource::Analog => Reply::NotBridge,
                };
            }
            Request::Stream(every) => {
                self.desk.stream_every = every;
                self.desk.stream_countdown = 1;
                shared::DROPPED.store(0, Relaxed);
                Ok(())
            }
            Request::Capture { before, trigger } => {
                self.capture.arm(before, trigger);
                Ok(())
            }
        };
        result.map_or_else(Reply::Refused, |()| Reply::Done)
    }

    /// Another command, which can't be refused.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.between.take")]
    fn take(&mut self, command: Command<'static>) -> Result<(), Refused> {
        self.controller.change_command(&self.command, &command);
        self.command = command;
        Ok(())
    }
}

/// A float to integer conversion cuts off, saturates, and makes 0 of NaN.
#[inline(always)]
fn nearest(steps: f32) -> i16 {
    (steps + 0.5_f32.copysign(steps)) as i16
}

fn drop_one() {
    shared::DROPPED.store(shared::DROPPED.load(Relaxed).wrapping_add(1), Relaxed);
}

/// A count of cycles in 16 bits. Bit 31 says that a whole period went by: that is "65535 or more".
fn half_word(cycles: u32) -> u32 {
    cycles.min(0xffff)
}
