//! A bench on a board's own pins: what is written down is what the pins saw, in order; holes are named; every end is a safe one.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{AdcCode, DacCode, FaultCode, ModeName};
use hil_bridge::faulty::Faulty;
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::lockstep::{LockstepError, Outcome, Ready, Row, Task, idle, prepare_task};
use hil_bridge::pins;
use hil_bridge::session::Session;
use plant_sim::replay::Start;
use std::convert::Infallible;
use std::time::Duration;
use support::{RATE_HZ, SPEC, bench, image, pi1, waveform};
use virtual_board::run::{Experiment, run};
use virtual_board::{BenchSettings, Heard, Wire};
use wire::{InputSource, Parameters, Receiver, Sample, ToBoard, ToHost};

const SAMPLES: usize = 600;
/// Samples in a block of the stream.
const BLOCK: usize = 48;

fn prepared<L: Link>(session: &mut Session<L>, spec: &str, is_closed_loop: bool) -> Ready {
    let (settings, waveform) = (pi1(), waveform(spec));
    let settings = is_closed_loop.then_some(&settings);
    let task =
        Task { own: None, settings, rate_hz: RATE_HZ, waveform: &waveform, is_closed_loop, input: InputSource::Analog };
    prepare_task::<_, Infallible>(session, &task, false).unwrap()
}

fn record<L: Link>(session: &mut Session<L>, spec: &str, is_closed_loop: bool) -> (Vec<Row>, Outcome) {
    let ready = prepared(session, spec, is_closed_loop);
    let mut rows = Vec::new();
    let keep = |_: &mut Session<L>, row: &Row| {
        rows.push(*row);
        Ok::<(), Infallible>(())
    };
    let outcome = pins::run(session, &ready, SAMPLES, keep).unwrap();
    (rows, outcome)
}

/// A bench without noise: how long the conversation before the loop took doesn't show.
fn still() -> BenchSettings {
    let mut bench = bench();
    bench.chain.sensor.noise_m = 0.0;
    bench
}

#[test]
fn rows_are_what_the_pins_saw_bit_for_bit() {
    let Some(image) = image() else { return };
    let parameters = Parameters { rate_hz: RATE_HZ as f32, ..Parameters::NUCLEO_PI1 }.with_settings(&pi1());
    let experiment = Experiment {
        bench: still(),
        parameters,
        waveform: waveform(SPEC),
        is_closed_loop: true,
        samples: SAMPLES as u64,
    };
    let seen = run(&image, &experiment, &|_| ()).unwrap();
    let mut session = Session::new(InVirtual::new(&image, &still(), RATE_HZ).unwrap());
    let (rows, outcome) = record(&mut session, SPEC, true);
    assert_eq!((outcome.lost.len(), outcome.overruns, outcome.fault), (0, 0, None));
    let calibration = still().calibration;
    assert_eq!(rows.len(), seen.rows.len());
    for (row, pins) in rows.iter().zip(&seen.rows) {
        assert_eq!(row.displacement_m, f64::from(calibration.displacement_m(AdcCode(pins.adc))));
        assert_eq!(row.command_v, f64::from(calibration.drive_v(DacCode(pins.dac))));
    }
    // The monitor shows the command before, to its own half a code of 100 mV and the DAC's.
    for two in rows.windows(2) {
        assert!((two[1].monitor_v.unwrap() - two[0].command_v).abs() < 0.11, "{two:?}");
        assert_eq!(two[1].index, two[0].index + 1);
    }
    let status = session.status().unwrap();
    assert_eq!((status.mode, status.input), (ModeName::Idle as u8, InputSource::Analog));
}

#[test]
fn the_same_conversation_gives_the_same_bits_and_an_open_loop_its_own_command() {
    let Some(image) = image() else { return };
    let once = || {
        let mut session = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
        let open = record(&mut session, "decaying-sine:30V@100Hz/0.03s", false);
        (open.0, record(&mut session, SPEC, true).0)
    };
    let (open, closed) = once();
    assert_eq!(closed.len(), SAMPLES);
    assert_eq!(once(), (open.clone(), closed.clone()));
    // What the first one left in the board's queue is no row of the second: both begin at their waveform's first sample.
    assert!(closed[0].command_v.abs() < 10.0 && closed[0].index == 0);
    let lsb_v = f64::from(bench().calibration.drive_v_per_code()).abs();
    for row in &open {
        let t_s = row.index as f64 / RATE_HZ;
        let asked_v = 30.0 * (1.0 - t_s / 0.03) * (std::f64::consts::TAU * 100.0 * t_s).sin();
        // Half a code, and the generator's f32.
        assert!((row.command_v - asked_v).abs() < 0.5001 * lsb_v + 1e-3, "{row:?} {asked_v}");
    }
}

#[test]
fn a_lossy_line_leaves_holes_that_are_counted_and_nothing_wrong() {
    let Some(image) = image() else { return };
    let mut clean = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
    let (whole, _) = record(&mut clean, "sine:30V@50Hz,for=1s", false);
    let link = InVirtual::new(&image, &bench(), RATE_HZ).unwrap();
    let mut session = Session::new(Faulty::new(link, "flip=0.3".parse().unwrap(), 3));
    let ready = prepared(&mut session, "sine:30V@50Hz,for=1s", false);
    let mut rows = Vec::new();
    let outcome = pins::run(&mut session, &ready, SAMPLES, |session, row| {
        // Once it runs, and not to its end: a stop may be lost five times over on such a line, and is no matter of the record.
        session.link().switch(row.index < SAMPLES - 4 * BLOCK);
        rows.push(*row);
        Ok::<(), Infallible>(())
    });
    let mut missing: Vec<usize> = (0..SAMPLES).collect();
    missing.retain(|index| rows.iter().all(|row| row.index != *index));
    assert!(!missing.is_empty() && missing.len() < SAMPLES / 2, "{} were lost", missing.len());
    assert_eq!(outcome.unwrap().lost, missing);
    for row in &rows {
        assert!((row.command_v - whole[row.index].command_v).abs() < 1e-9, "{row:?}");
    }
}

/// A line that loses the blocks that it is told to.
struct Losing<F> {
    link: InVirtual,
    begun: Vec<u8>,
    loses: F,
}

impl<F: FnMut(&[Sample]) -> bool> Losing<F> {
    fn is_lost(&mut self, frame: &[u8]) -> bool {
        let mut receiver = Receiver::new();
        for byte in frame {
            let Some(Ok(found)) = receiver.push(*byte) else { continue };
            if let Ok(Heard::StreamBlock { samples, .. }) = found.message::<ToHost<'_>>().map(Heard::from) {
                return (self.loses)(&samples);
            }
        }
        false
    }
}

impl<F: FnMut(&[Sample]) -> bool> Link for Losing<F> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.link.send(bytes)
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        let (until, before) = (self.now() + patience, into.len());
        loop {
            let (mut bytes, left) = (Vec::new(), until.saturating_sub(self.now()));
            self.link.receive(left, &mut bytes)?;
            for byte in &bytes {
                self.begun.push(*byte);
                if *byte == 0 {
                    let frame = std::mem::take(&mut self.begun);
                    if !self.is_lost(&frame) {
                        into.extend(frame);
                    }
                }
            }
            // Nothing means that the patience is over, not that a block was lost.
            if into.len() > before || bytes.is_empty() || self.now() >= until {
                return Ok(());
            }
        }
    }

    fn now(&mut self) -> Duration {
        self.link.now()
    }

    fn patience(&self) -> Duration {
        self.link.patience()
    }
}

/// A session over such a line.
fn losing<F: FnMut(&[Sample]) -> bool>(bench: &BenchSettings, loses: F) -> Option<Session<Losing<F>>> {
    let link = InVirtual::new(&image()?, bench, RATE_HZ).unwrap();
    Some(Session::new(Losing { link, begun: Vec::new(), loses }))
}

fn has_run(samples: &[Sample]) -> bool {
    samples.iter().any(|sample| sample.flags.mode() == ModeName::Running as u8)
}

#[test]
fn a_beginning_that_is_lost_is_a_hole_at_the_start() {
    let spec = "sine:30V@50Hz,for=1s";
    let Some(mut clean) = losing(&bench(), |_| false) else { return };
    let (whole, _) = record(&mut clean, spec, false);
    let mut is_first = true;
    let mut session = losing(&bench(), |samples| has_run(samples) && std::mem::take(&mut is_first)).unwrap();
    let (rows, outcome) = record(&mut session, spec, false);
    let first = rows[0].index;
    assert!((1..=2 * BLOCK).contains(&first), "{first}");
    assert_eq!((outcome.lost, rows.len(), outcome.fault), ((0..first).collect(), SAMPLES - first, None));
    // Where in the block the loop began nobody has heard: the samples before it count as lost as well, so that no row comes early.
    let is_late_by = |late: usize| {
        let fits = |row: &Row| (whole[row.index - late].command_v - row.command_v).abs() < 1e-9;
        first >= late && rows.iter().all(fits)
    };
    assert!((0..BLOCK).any(is_late_by), "{:?}", &rows[..3]);
}

#[test]
fn a_fault_before_the_first_block_that_is_heard_ends_the_record() {
    let mut broken = bench();
    broken.chain.sensor.gain = -1.0;
    broken.start = Start::relaxed(&broken.chain);
    let Some(mut session) = losing(&broken, has_run) else { return };
    let (rows, outcome) = record(&mut session, "step:40um@1s", true);
    assert_eq!(outcome.fault, Some(FaultCode::DisplacementTrip));
    let last = rows.last().unwrap();
    assert_eq!((outcome.lost, last.command_v), ((0..rows[0].index).collect(), 0.0));
    assert!(rows[0].index > 0);
}

#[test]
fn an_open_stop_chain_and_a_broken_wire_are_told_by_name() {
    let Some(image) = image() else { return };
    for is_chain in [true, false] {
        let mut session = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
        let ready = prepared(&mut session, SPEC, true);
        {
            let mut chip = session.link().machine().chip();
            if is_chain { chip.set_stop_chain(false) } else { chip.bench.wire = Wire::Open }
        }
        let ended = pins::run(&mut session, &ready, SAMPLES, |_, _| Ok::<(), Infallible>(()));
        let said = ended.unwrap_err().to_string();
        let fault = if is_chain { "emergency stop" } else { "sensor rail" };
        let words =
            format!("the board is in a fault, {fault}: see to its cause, then repeat the call with --clear-fault");
        assert_eq!(said, words);
    }
}

#[test]
fn a_board_of_little_patience_is_not_starved() {
    let Some(image) = image() else { return };
    let mut session = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
    // 400 of the 600 samples.
    let impatient = Parameters { link_timeout_s: 0.02, ..session.parameters().unwrap() };
    session.order(&ToBoard::SetParameters(impatient)).unwrap();
    let (rows, outcome) = record(&mut session, SPEC, true);
    assert_eq!((rows.len(), outcome.fault), (SAMPLES, None));
    assert_eq!(session.status().unwrap().fault, 0);
}

#[test]
fn a_fault_ends_the_record_at_0_v_and_a_full_disk_the_run() {
    let Some(image) = image() else { return };
    let mut broken = bench();
    // A sensor wired the wrong way round: the loop drives the plant away.
    broken.chain.sensor.gain = -1.0;
    broken.start = Start::relaxed(&broken.chain);
    let mut session = Session::new(InVirtual::new(&image, &broken, RATE_HZ).unwrap());
    let (rows, outcome) = record(&mut session, "step:40um@1s", true);
    assert_eq!(outcome.fault, Some(FaultCode::DisplacementTrip));
    assert_eq!(rows.last().unwrap().command_v, 0.0);
    assert!(rows.len() < SAMPLES && outcome.lost.is_empty());

    let mut session = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
    let ready = prepared(&mut session, SPEC, true);
    let full = |_: &mut Session<InVirtual>, row: &Row| if row.index == 100 { Err("the disk is full") } else { Ok(()) };
    assert!(matches!(pins::run(&mut session, &ready, SAMPLES, full), Err(LockstepError::Row("the disk is full"))));
    assert_eq!(session.status().unwrap().mode, ModeName::Idle as u8);
}

#[test]
fn a_stream_that_a_killed_host_left_on_ends_with_the_next_call() {
    let Some(image) = image() else { return };
    let mut session = Session::new(InVirtual::new(&image, &bench(), RATE_HZ).unwrap());
    assert_eq!(session.start_stream().unwrap(), 1);
    idle::<_, Infallible>(&mut session, false).unwrap();
    // A block takes 2.4 ms; what was on its way comes first.
    let mut last = Vec::new();
    for _ in 0..20 {
        last.clear();
        session.link().receive(Duration::from_millis(10), &mut last).unwrap();
    }
    assert!(last.is_empty(), "{} bytes", last.len());
}

#[test]
fn a_board_without_pins_refuses_in_words() {
    let mut session = Session::new(InProcess::nucleo());
    let ready = prepared(&mut session, SPEC, true);
    let ended = pins::run(&mut session, &ready, SAMPLES, |_, _| Ok::<(), Infallible>(()));
    let Err(LockstepError::Session(error)) = ended else { panic!("it ran") };
    assert!(error.to_string().contains("a board in process has no converters"), "{error}");
}
