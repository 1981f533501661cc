//! A board without a chip: `control-core` behind the link's protocol, in this process.
//!
//! It answers what a lockstep run asks for as the firmware does (`firmware/src/link.rs`, `Control::bridge` in `firmware/src/control.rs`), with
//! the same law, mode machine, conversions and rules ([`wire::rules`]). Stream, capture, flash and everything analog are refused in words.

use crate::link::{Link, LinkError};
use control_core::{AdcCode, Command, Controller, DacCode, FaultCode, Generator, Input, Mode, ModeName, Segment};
use std::time::{Duration, Instant};
use wire::rules::{Change, NO_BRIDGE, NOT_IDLE, WAVE_FULL, fill_table};
use wire::{
    Checked, Converters, Frame, Identity, InputSource, MAX_ENCODED_BYTES, Parameters, Receiver, ResetCause,
    SegmentRecord, Sender, Status, ToBoard, ToHost, WireError,
};

/// Samples of the waveform's table and its segments, as on the boards.
const TABLE_SAMPLES: usize = 4096;
const SEGMENTS: usize = 16;

const NOT_HERE: &str = "a board in process has no converters, stream, capture or flash";

/// What the loop is to do.
enum Task {
    Reference(f32),
    Drive(f32),
    Wave { is_closed_loop: bool },
}

impl Task {
    /// As the law takes it; a waveform plays `segments`.
    fn command<'a>(&self, segments: &'a [Segment<'a>]) -> Command<'a> {
        match *self {
            Task::Reference(reference_m) => Command::Reference { reference_m },
            Task::Drive(drive_v) => Command::Drive { drive_v },
            Task::Wave { is_closed_loop: true } => Command::GeneratedReference(Generator::new(segments)),
            Task::Wave { is_closed_loop: false } => Command::GeneratedDrive(Generator::new(segments)),
        }
    }
}

/// The board, and the link to it.
pub struct InProcess {
    converters: Converters,
    parameters: Parameters,
    checked: Checked,
    controller: Controller,
    input: InputSource,
    task: Task,
    records: Vec<SegmentRecord>,
    /// The segments of the waveform in use; those that play the table are built when they are played.
    wave: Vec<Option<Segment<'static>>>,
    table: Vec<f32>,
    monitor_misses: u32,
    drive_v: f32,
    samples: u32,
    bad_frames: u32,
    told_fault: Option<FaultCode>,
    receiver: Receiver,
    sender: Sender,
    to_host: Vec<u8>,
    since: Instant,
}

impl InProcess {
    /// With the converters and defaults of a Nucleo-G474RE.
    pub fn nucleo() -> InProcess {
        let (converters, parameters) = (Converters::NUCLEO_G474RE, Parameters::NUCLEO_PI1);
        let checked = parameters.check(&converters).expect("a board's own defaults pass its own check");
        InProcess {
            converters,
            parameters,
            checked,
            controller: Controller::new(checked.law),
            input: InputSource::Analog,
            task: Task::Reference(0.0),
            records: Vec::new(),
            wave: Vec::new(),
            table: vec![0.0; TABLE_SAMPLES],
            monitor_misses: 0,
            drive_v: 0.0,
            samples: 0,
            bad_frames: 0,
            told_fault: None,
            receiver: Receiver::new(),
            sender: Sender::default(),
            to_host: Vec::new(),
            since: Instant::now(),
        }
    }

    /// Frames from the host that were damaged or unknown.
    pub fn bad_frames(&self) -> u32 {
        self.bad_frames
    }

    fn say(&mut self, message: &ToHost<'_>) {
        let mut bytes = [0; MAX_ENCODED_BYTES];
        // Every message here is far shorter than a frame.
        if let Ok(n) = self.sender.encode(message, &mut bytes) {
            self.to_host.extend_from_slice(&bytes[..n]);
        }
    }

    fn refuse(&mut self, sequence: u16, reason: &str) {
        self.say(&ToHost::Refused { sequence, reason });
    }

    fn handle(&mut self, frame: &Frame<'_>) {
        let sequence = frame.sequence;
        let message = match frame.message::<ToBoard<'_>>() {
            Ok(message) => message,
            Err(error) => {
                self.bad_frames += 1;
                return self.refuse(sequence, &error.to_string());
            }
        };
        match message {
            ToBoard::Hello => self.say_identity(),
            ToBoard::KeepAlive => self.say_status(),
            ToBoard::GetParameters => {
                let parameters = self.parameters;
                self.say(&ToHost::Parameters(parameters));
            }
            ToBoard::BridgeSample { index, displacement, monitor } => match self.input {
                InputSource::Analog => self.refuse(sequence, NO_BRIDGE),
                InputSource::Bridge => self.bridge(index, displacement, monitor),
            },
            order => match self.obey(&order) {
                Ok(()) => self.say(&ToHost::Done { sequence }),
                Err(reason) => self.refuse(sequence, &reason),
            },
        }
    }

    fn obey(&mut self, order: &ToBoard<'_>) -> Result<(), String> {
        let is_idle = matches!(self.controller.mode(), Mode::Idle);
        let words = |refused: control_core::Refused| refused.to_string();
        match order {
            // One that is refused changes nothing.
            ToBoard::Arm => self.controller.arm().inspect(|()| self.monitor_misses = 0).map_err(words),
            ToBoard::Run => self.controller.run().map_err(words),
            ToBoard::Stop => self.controller.stop().map_err(words),
            ToBoard::ClearFault => self.controller.clear_fault().map_err(words),
            ToBoard::SetParameters(parameters) => self.set(*parameters, is_idle),
            ToBoard::Reference { reference_m } => {
                self.take(Task::Reference(*reference_m));
                Ok(())
            }
            ToBoard::Drive { drive_v } => {
                self.take(Task::Drive(*drive_v));
                Ok(())
            }
            ToBoard::SaveParameters => Err(NOT_HERE.into()),
            order if order.needs_idle() && !is_idle => Err(NOT_IDLE.into()),
            ToBoard::WaveClear => {
                self.records.clear();
                self.take(Task::Reference(0.0));
                Ok(())
            }
            ToBoard::WaveSegment(_) if self.records.len() == SEGMENTS => Err(WAVE_FULL.into()),
            ToBoard::WaveSegment(record) => {
                self.records.push(*record);
                Ok(())
            }
            ToBoard::WaveTable { offset, values } => {
                self.take(Task::Reference(0.0));
                Ok(fill_table(&mut self.table, *offset, values)?)
            }
            ToBoard::WaveUse { is_closed_loop } => self.use_wave(*is_closed_loop),
            ToBoard::Input(input) => {
                self.input = *input;
                Ok(())
            }
            _ => Err(NOT_HERE.into()),
        }
    }

    fn set(&mut self, parameters: Parameters, is_idle: bool) -> Result<(), String> {
        let changed = self.parameters.change(&parameters, &self.converters, is_idle);
        let Change { checked, is_other_rate } = changed.map_err(|error| error.to_string())?;
        self.controller.exchange_law(checked.law);
        self.checked = checked;
        self.parameters = parameters;
        if is_other_rate {
            self.take(Task::Reference(0.0));
        }
        Ok(())
    }

    /// Another task, from the next sample on.
    fn take(&mut self, task: Task) {
        self.controller.change_command(&self.task.command(&[]), &task.command(&[]));
        self.task = task;
    }

    fn use_wave(&mut self, is_closed_loop: bool) -> Result<(), String> {
        self.take(Task::Reference(0.0));
        let rate_hz = self.parameters.rate_hz;
        let mut wave = Vec::new();
        for record in &self.records {
            record.build(rate_hz, &self.table).map_err(|error| error.to_string())?;
            // Without a table nothing is borrowed, so that it can be kept.
            wave.push(record.build(rate_hz, &[]).ok());
        }
        self.wave = wave;
        self.take(Task::Wave { is_closed_loop });
        Ok(())
    }

    /// One sample over the bridge.
    fn bridge(&mut self, index: u32, displacement: u16, monitor: u16) {
        self.samples = self.samples.wrapping_add(1);
        let checked = self.checked;
        if !matches!(self.controller.mode_name(), ModeName::Idle | ModeName::Fault) {
            let is_fine = (checked.monitor_v(monitor) - self.drive_v).abs() <= checked.monitor_tolerance_v;
            self.monitor_misses = if is_fine { 0 } else { self.monitor_misses + 1 };
            // Of several faults the last one here counts, as on the boards.
            if checked.is_at_rail(AdcCode(displacement)) {
                self.controller.trip(FaultCode::SensorRail);
            } else if self.monitor_misses >= u32::from(checked.monitor_samples) {
                self.controller.trip(FaultCode::DriveMismatch);
            }
        }
        let measured_m = checked.calibration.displacement_m(AdcCode(displacement));
        let InProcess { records, wave, table, parameters, controller, task, .. } = self;
        let build = |(record, kept): (&SegmentRecord, &Option<Segment<'static>>)| {
            kept.or_else(|| record.build(parameters.rate_hz, table).ok())
        };
        let built: Vec<Segment<'_>> = match task {
            Task::Wave { .. } => records.iter().zip(wave.iter()).filter_map(build).collect(),
            Task::Reference(_) | Task::Drive(_) => Vec::new(),
        };
        let output = controller.tick(&Input { command: task.command(&built), measured_m });
        self.drive_v = output.drive_v;
        let DacCode(drive) = checked.calibration.dac_code(output.drive_v);
        let mode = self.controller.mode_name() as u8;
        self.say(&ToHost::BridgeDrive {
            index,
            drive,
            drive_v: output.drive_v,
            reference_m: output.reference_m,
            limited_by: output.limited_by.bits(),
            mode,
        });
        let fault = self.controller.fault();
        if fault != self.told_fault {
            self.told_fault = fault;
            if let Some(code) = fault {
                let sample = self.samples;
                self.say(&ToHost::Fault { code: code.number(), sample });
            }
        }
    }

    fn say_identity(&mut self) {
        let (converters, reference_step_m) = (self.converters, self.parameters.reference_step_m(&self.converters));
        self.say(&ToHost::Identity(Identity {
            version: wire::VERSION,
            board: "in-process",
            firmware: concat!(env!("CARGO_PKG_VERSION"), " in-process"),
            converters,
            reference_step_m,
            table_samples: TABLE_SAMPLES as u16,
            segments: SEGMENTS as u16,
            capture_samples: 0,
        }));
    }

    fn say_status(&mut self) {
        let status = Status {
            mode: self.controller.mode_name() as u8,
            fault: self.controller.fault().map_or(0, FaultCode::number),
            reset: ResetCause::PowerOn,
            input: self.input,
            samples: self.samples,
            overruns: 0,
            lost_samples: 0,
            ready_cycles: 0,
            ready_max_cycles: 0,
            bad_frames: self.bad_frames,
        };
        self.say(&ToHost::Status(status));
    }
}

impl Link for InProcess {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        // Out of `self` while it is used, because a frame borrows it.
        let mut receiver = std::mem::take(&mut self.receiver);
        for byte in bytes {
            match receiver.push(*byte) {
                Some(Ok(frame)) => self.handle(&frame),
                Some(Err(error)) => {
                    self.bad_frames += 1;
                    if let WireError::Version { .. } = error {
                        self.refuse(0, &error.to_string());
                    }
                }
                None => {}
            }
        }
        self.receiver = receiver;
        Ok(())
    }

    /// Everything that will come is there already, so that nothing is ever waited for.
    fn receive(&mut self, _patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        into.append(&mut self.to_host);
        Ok(())
    }

    fn now(&mut self) -> Duration {
        self.since.elapsed()
    }

    fn patience(&self) -> Duration {
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::{Ready, Row, Task as Run, prepare_task, sample};
    use crate::session::Session;
    use plant_sim::experiment::{Bench, Setup};
    use plant_sim::model::Model;
    use plant_sim::replay::Start;
    use plant_sim::spec::Spec;
    use std::convert::Infallible;
    use std::path::Path;
    use virtual_board::waveform::Waveform;

    const RATE_HZ: f64 = 20e3;

    /// A board that runs `spec` in open loop over the bridge, with the thesis' plant at rest on it.
    fn opened(spec: &str) -> (Session<InProcess>, Ready, Bench) {
        let mut session = Session::new(InProcess::nucleo());
        let waveform = Waveform::new(&Spec::parse(spec).unwrap(), RATE_HZ).unwrap();
        let input = InputSource::Bridge;
        let run =
            Run { own: None, settings: None, rate_hz: RATE_HZ, waveform: &waveform, is_closed_loop: false, input };
        let ready = prepare_task::<_, Infallible>(&mut session, &run, false).unwrap();
        session.order(&ToBoard::Arm).unwrap();
        session.order(&ToBoard::Run).unwrap();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
        let chain = Model::read(&path).unwrap().chain();
        let start = Start::relaxed(&chain);
        let latency_s = ready.latency_s;
        let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: 0, latency_s, seed: 1 };
        let bench = Bench::new(&setup);
        (session, ready, bench)
    }

    fn rows(session: &mut Session<InProcess>, ready: &Ready, bench: &mut Bench, last: Row, samples: usize) -> Vec<Row> {
        let mut last = last;
        let mut one = || {
            let (row, mode) = sample(session, ready, bench, &last).unwrap();
            assert_eq!(mode, Some(ModeName::Running as u8), "{row:?}");
            bench.apply(row.command_v);
            last = row;
            row
        };
        (0..samples).map(|_| one()).collect()
    }

    #[test]
    fn a_reference_under_an_open_loop_goes_there_from_where_the_stage_stands() {
        let (mut session, ready, mut bench) = opened("hold:40V");
        let before = *rows(&mut session, &ready, &mut bench, Row::BEFORE, 4000).last().unwrap();
        assert!((58e-6..59e-6).contains(&before.displacement_m), "{before:?}");
        // Two moves of 5.2 um, the second in a loop that was closed before: the drive of the first sample, and how far beyond target and start.
        let moves = [(53e-6, 58.2e-6), (47.8e-6, 53e-6)].map(|(to_m, from_m)| {
            session.order(&ToBoard::Reference { reference_m: to_m as f32 }).unwrap();
            let after = rows(&mut session, &ready, &mut bench, before, 2000);
            let beyond = |most_m: f64, row: &Row| most_m.max(to_m - row.displacement_m);
            let back = |most_m: f64, row: &Row| most_m.max(row.displacement_m - from_m);
            (after[0].command_v, after.iter().fold(0.0, beyond), after.iter().fold(0.0, back))
        });
        let [(first_v, beyond_m, back_m), (_, usual_m, _)] = moves;
        // a T^2 = 0.5 um of reference, of which ff, Kp and Ki T make 0.72 V, and a code of the DAC, 0.05 V.
        assert!((before.command_v - first_v - 0.72).abs() < 0.06, "{first_v} after {before:?}");
        // The loop's own overshoot, up to two codes of the ADC; and one where it stood.
        assert!(usual_m < 3e-6 && (beyond_m - usual_m).abs() < 0.13e-6 && back_m < 0.07e-6, "{moves:?}");
    }

    #[test]
    fn a_host_that_goes_on_arming_does_not_hide_a_stuck_drive() {
        let (mut session, ready, mut bench) = opened("hold:40V");
        let last = *rows(&mut session, &ready, &mut bench, Row::BEFORE, 200).last().unwrap();
        let AdcCode(displacement) = ready.checked.calibration.adc_code(last.displacement_m as f32);
        let stuck = ready.checked.monitor_code(0.0, &ready.board.converters);
        for _ in 0..ready.checked.monitor_samples {
            let refused = session.order(&ToBoard::Arm).unwrap_err().to_string();
            assert!(refused.contains("arm is refused in mode running"), "{refused}");
            session.exchange(displacement, stuck).unwrap();
        }
        assert_eq!(session.status().unwrap().fault, FaultCode::DriveMismatch.number());
    }
}
