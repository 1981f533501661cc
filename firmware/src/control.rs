//! The control interrupt: one sample of the board.
//!
//! Deadline: 1700 cycles (10 us) from the instant at which the ADC holds its input to the timer latching the DAC. A drive
//! that comes later is an overrun: the DAC holds the old one, the sample is counted and marked, and too many of them are a
//! fault. Code and data lie in CCM SRAM, which has no wait states. Nothing here waits, allocates, logs, divides 64-bit numbers or panics.

use crate::capture::Capture;
use crate::shared::{self, Record, Reply, Request, State};
use crate::{Board, Reading, registers};
use control_core::{
    Command, Controller, DacCode, FaultCode, Generator, Input, Limits, Mode, ModeName, Output, Segment,
};
use core::mem::MaybeUninit;
use core::sync::atomic::Ordering::Relaxed;
use wire::{Checked, Flags, InputSource, Sample};

/// What drives while the loop runs.
#[derive(Clone, Copy)]
enum Driving {
    Reference(f32),
    Drive(f32),
    Wave { is_closed_loop: bool, segments: &'static [Segment<'static>] },
}

/// Overruns count 256 each and fade by one a sample: `overrun_limit` of them within about 256 samples are a fault.
const OVERRUN_WEIGHT: u32 = 256;

/// Everything the control interrupt remembers.
pub struct Control {
    controller: Controller,
    set: &'static Checked,
    driving: Driving,
    input: InputSource,
    sample: u32,
    /// What the DAC was last told, in volts: what the monitor should show in the next sample.
    latched_v: f32,
    monitor_misses: u16,
    overrun_score: u32,
    is_enable_high: bool,
    last_mode: ModeName,
    stream_every: u16,
    stream_countdown: u16,
    ready_max_cycles: u32,
    capture: Capture,
}

#[unsafe(link_section = ".ccmram.data.control")]
static CONTROL: shared::Lent<MaybeUninit<Control>> = shared::Lent::new(MaybeUninit::uninit());

/// Sets up what [`on_sample`] works on. To be called once, before the control interrupt is enabled.
pub fn begin(set: &'static Checked, fault: Option<FaultCode>) {
    let controller = match fault {
        Some(code) => Controller::in_fault(set.law, code),
        None => Controller::new(set.law),
    };
    let control = Control {
        controller,
        set,
        driving: Driving::Reference(0.0),
        input: InputSource::Analog,
        sample: 0,
        latched_v: 0.0,
        monitor_misses: 0,
        overrun_score: 0,
        is_enable_high: false,
        last_mode: ModeName::Idle,
        stream_every: 0,
        stream_countdown: 0,
        ready_max_cycles: 0,
        capture: Capture::new(),
    };
    // SAFETY: the control interrupt is not enabled yet, so nobody else looks at it.
    unsafe { (*CONTROL.get()).write(control) };
}

/// One sample. The whole body of a board's control interrupt.
///
/// # Safety
///
/// Only from the control interrupt, after [`begin`].
#[inline(always)]
pub unsafe fn on_sample<B: Board>() {
    // SAFETY: `begin` has written it, and only this interrupt, which can't interrupt itself, touches it.
    let control = unsafe { (*CONTROL.get()).assume_init_mut() };
    control.sample::<B>();
}

impl Control {
    #[inline(always)]
    fn sample<B: Board>(&mut self) {
        let mut reading = B::take();
        self.sample = self.sample.wrapping_add(1);
        let mut wake = self.sample & 63 == 0;
        let mut is_bridged = false;
        // SAFETY: the only place that takes requests.
        if let Some(request) = unsafe { shared::REQUESTS.pop() } {
            is_bridged = self.obey(&request, &mut reading);
            wake = true;
        }
        let is_analog = matches!(self.input, InputSource::Analog);
        // Over the bridge the host's samples are the clock; without one the law stands still, and only the silence is watched.
        let is_due = is_analog || is_bridged;
        self.watch(&reading, is_due, is_analog);
        let output = if is_due { self.tick(&reading) } else { self.standing() };
        let code = self.set.calibration.dac_code(output.drive_v);
        B::put(if is_analog { code.0 } else { self.set.calibration.safe_code().0 });
        let ready_cycles = registers::count();
        let is_late = ready_cycles >= B::CONVERTERS.deadline_cycles() - B::PUT_CYCLES;
        if is_due {
            self.latched_v = output.drive_v;
        }
        self.score(is_late, ready_cycles);
        let mode = self.controller.mode_name();
        let is_enabled = self.enable(is_analog, mode, &output);
        // The input changes by a request only, and a fault is latched with its mode.
        if wake || mode != self.last_mode {
            let state = State { mode: mode as u8, fault: self.fault_number(), input: self.input };
            shared::STATE.store(state.word(), Relaxed);
            wake = true;
        }
        shared::SAMPLES.store(self.sample, Relaxed);
        if is_bridged {
            let (drive, drive_v, reference_m) = (code.0, output.drive_v, output.reference_m);
            self.reply(Reply::Bridge { drive, drive_v, reference_m, limited_by: output.limited_by.bits() });
        }
        self.record(&reading, &output, code, mode, is_late, is_enabled, is_due);
        if wake {
            registers::pend_wake();
        }
    }

    /// One tick of the law with its mode machine.
    #[inline(always)]
    fn tick(&mut self, reading: &Reading) -> Output {
        let generator;
        let command = match self.driving {
            Driving::Reference(reference_m) => Command::Reference { reference_m },
            Driving::Drive(drive_v) => Command::Drive { drive_v },
            Driving::Wave { is_closed_loop, segments } => {
                generator = Generator::new(segments);
                if is_closed_loop {
                    Command::GeneratedReference(&generator)
                } else {
                    Command::GeneratedDrive(&generator)
                }
            }
        };
        let measured_m = self.set.calibration.displacement_m(control_core::AdcCode(reading.displacement));
        self.controller.tick(&Input { command, measured_m })
    }

    /// What stands while no sample is due.
    #[inline(always)]
    fn standing(&self) -> Output {
        Output { drive_v: self.controller.drive_v(), reference_m: 0.0, limited_by: Limits::NONE }
    }

    /// Faults that only the board can see. A fault that is latched already stays the first.
    #[inline(always)]
    fn watch(&mut self, reading: &Reading, is_due: bool, is_analog: bool) {
        if reading.is_one_lost {
            shared::LOST.store(shared::LOST.load(Relaxed).wrapping_add(1), Relaxed);
        }
        let is_running = match self.controller.mode() {
            Mode::Idle | Mode::Fault { .. } => {
                self.monitor_misses = 0;
                return;
            }
            Mode::Armed { .. } => false,
            Mode::Running { .. } | Mode::Stopping { .. } => true,
        };
        let set = self.set;
        let mut fault = None;
        if is_due {
            // The monitor was sampled with the displacement, before this sample's latch: it shows the drive of the sample before.
            let monitor_v = (f32::from(reading.monitor) - set.monitor_zero_code) * set.monitor_v_per_code;
            // A NaN is a miss, too.
            if (monitor_v - self.latched_v).abs() <= set.monitor_tolerance_v {
                self.monitor_misses = 0;
            } else {
                self.monitor_misses += 1;
                if self.monitor_misses >= set.monitor_samples {
                    fault = Some(FaultCode::DriveMismatch);
                }
            }
            if set.calibration.is_at_rail(control_core::AdcCode(reading.displacement), set.rail_codes) {
                fault = Some(FaultCode::SensorRail);
            }
        }
        if is_analog && reading.is_one_lost {
            fault = Some(FaultCode::AdcLate);
        }
        if self.overrun_score >= u32::from(set.overrun_limit) * OVERRUN_WEIGHT {
            fault = Some(FaultCode::Overrun);
        }
        if is_running && self.sample.wrapping_sub(shared::HEARD.load(Relaxed)) > set.link_timeout_samples {
            fault = Some(FaultCode::LinkLoss);
        }
        if is_analog && !registers::is_stop_chain_closed() {
            fault = Some(FaultCode::EmergencyStop);
        }
        if let Some(code) = fault {
            self.trip(code);
        }
    }

    #[cold]
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.trip")]
    fn trip(&mut self, code: FaultCode) {
        self.controller.trip(code);
    }

    /// Counts what was late.
    #[inline(always)]
    fn score(&mut self, is_late: bool, ready_cycles: u32) {
        if is_late {
            self.overrun_score += OVERRUN_WEIGHT;
            shared::OVERRUNS.store(shared::OVERRUNS.load(Relaxed).wrapping_add(1), Relaxed);
        } else if self.overrun_score > 0 {
            self.overrun_score -= 1;
        }
        // Bit 31 says that a whole period went by; as a number of cycles that is "65535 or more".
        let cycles = if ready_cycles > 0xffff { 0xffff } else { ready_cycles };
        if cycles > self.ready_max_cycles {
            self.ready_max_cycles = cycles;
        }
        shared::READY.store(cycles | self.ready_max_cycles << 16, Relaxed);
    }

    /// Toggles ENABLE while the amplifier is to be on: from arming (the DAC has been at the safe level since the start)
    /// until 0 V is reached again. A loop that hangs toggles nothing, and the monostable behind the pin falls back.
    #[inline(always)]
    fn enable(&mut self, is_analog: bool, mode: ModeName, output: &Output) -> bool {
        let wanted = is_analog
            && match mode {
                ModeName::Idle => false,
                ModeName::Armed | ModeName::Running | ModeName::Stopping => true,
                ModeName::Fault => output.drive_v != 0.0,
            };
        self.is_enable_high = wanted && !self.is_enable_high;
        registers::set_enable(self.is_enable_high);
        wanted
    }

    fn fault_number(&self) -> u8 {
        match self.controller.mode() {
            Mode::Fault { code, .. } => code.number(),
            _ => 0,
        }
    }

    /// Hands the sample to stream and capture.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "inlined into its only caller; a struct would be packed and unpacked")]
    fn record(
        &mut self,
        reading: &Reading,
        output: &Output,
        code: DacCode,
        mode: ModeName,
        is_late: bool,
        is_enabled: bool,
        is_due: bool,
    ) {
        let last_mode = core::mem::replace(&mut self.last_mode, mode);
        let has_faulted = mode == ModeName::Fault && last_mode != ModeName::Fault;
        if has_faulted {
            shared::FAULT_SAMPLE.store(self.sample, Relaxed);
        }
        if !is_due {
            return;
        }
        let is_streamed = self.stream_every != 0 && {
            self.stream_countdown = self.stream_countdown.wrapping_sub(1);
            self.stream_countdown == 0
        };
        let is_captured = self.capture.is_on();
        if !is_streamed && !is_captured {
            return;
        }
        let flag = |is_set: bool, flag: Flags| if is_set { flag.0 } else { 0 };
        let flags = mode as u8
            | flag(is_late, Flags::OVERRUN)
            | flag(matches!(self.input, InputSource::Bridge), Flags::BRIDGE)
            | flag(is_enabled, Flags::ENABLE);
        let sample = Sample {
            // A float to integer conversion saturates, and makes 0 of NaN.
            reference: (output.reference_m * self.set.reference_steps_per_m) as i16,
            displacement: reading.displacement,
            monitor: reading.monitor,
            drive: code.0,
            limited_by: output.limited_by,
            flags: Flags(flags),
        };
        let record = Record { number: self.sample, sample };
        if is_captured {
            self.capture.note(&record, mode == ModeName::Running && last_mode != ModeName::Running, has_faulted);
        }
        if !is_streamed {
            return;
        }
        // The sender is woken every 64 samples, which is often enough for a queue of 1023.
        self.stream_countdown = self.stream_every;
        // SAFETY: the only place that makes records.
        if !unsafe { shared::RECORDS.push(record) } {
            shared::DROPPED.store(shared::DROPPED.load(Relaxed).wrapping_add(1), Relaxed);
        }
    }

    /// Carries out a request; true if it brought a sample over the bridge, which is answered once the law has had it.
    #[inline(never)]
    #[unsafe(link_section = ".ccmram.control.obey")]
    fn obey(&mut self, request: &Request, reading: &mut Reading) -> bool {
        let is_idle = matches!(self.controller.mode(), Mode::Idle);
        let mut answer = Reply::Done;
        let mut attempt = |result: Result<(), control_core::Refused>| {
            if let Err(refused) = result {
                answer = Reply::Refused(refused);
            }
        };
        match *request {
            Request::Arm => attempt(self.controller.arm()),
            Request::Run => attempt(self.controller.run()),
            Request::Stop => attempt(self.controller.stop()),
            Request::ClearFault => attempt(self.controller.clear_fault()),
            Request::Apply(set) => {
                if set.period_cycles != self.set.period_cycles {
                    registers::set_period(set.period_cycles);
                }
                self.controller.exchange_law(set.law);
                self.set = set;
            }
            Request::Reference(reference_m) => self.driving = Driving::Reference(reference_m),
            Request::Drive(drive_v) => self.driving = Driving::Drive(drive_v),
            Request::Wave { is_closed_loop, segments } => {
                self.driving = Driving::Wave { is_closed_loop, segments };
            }
            Request::Input(_) if !is_idle => answer = Reply::NotIdle,
            Request::Input(input) => self.input = input,
            Request::Bridge { displacement, monitor } => {
                if matches!(self.input, InputSource::Bridge) {
                    // What the ADC lost or found is of no interest here.
                    *reading = Reading { displacement, monitor, is_one_lost: false };
                    return true;
                }
                answer = Reply::NotBridge;
            }
            Request::Stream(every) => {
                self.stream_every = every;
                self.stream_countdown = 1;
                shared::DROPPED.store(0, Relaxed);
            }
            Request::Capture { before, trigger } => self.capture.arm(before, trigger),
        }
        self.reply(answer);
        false
    }

    /// There is room: one request is under way at a time, and its reply was taken before.
    #[inline(always)]
    fn reply(&mut self, reply: Reply) {
        // SAFETY: the only side that replies.
        let _ = unsafe { shared::REPLIES.push(reply) };
    }
}
