//! A bench on a board's own pins: what is written down is what the pins saw, in order; holes are named; every end is a safe one.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{AdcCode, DacCode, FaultCode, ModeName};
use hil_bridge::faulty::Faulty;
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::link::Link;
use hil_bridge::lockstep::{LockstepError, Outcome, Ready, Row, Task, prepare_task};
use hil_bridge::pins;
use hil_bridge::session::Session;
use plant_sim::replay::Start;
use std::convert::Infallible;
use support::{RATE_HZ, SPEC, bench, image, pi1, waveform};
use virtual_board::BenchSettings;
use virtual_board::run::{Experiment, run};
use wire::{InputSource, Parameters};

const SAMPLES: usize = 600;

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
        // Once it runs.
        session.link().switch(true);
        rows.push(*row);
        Ok::<(), Infallible>(())
    });
    session.link().switch(false);
    // A stop may be lost five times over on such a line; what was recorded is right all the same.
    let lost = match outcome {
        Ok(outcome) => outcome.lost,
        Err(error) => {
            println!("the run's end: {error}");
            Vec::new()
        }
    };
    assert!(rows.len() < SAMPLES, "no block was lost");
    let hole = rows.windows(2).find(|two| two[1].index != two[0].index + 1).expect("a hole");
    assert!(lost.is_empty() || lost.contains(&(hole[0].index + 1)));
    for row in &rows {
        assert!((row.command_v - whole[row.index].command_v).abs() < 1e-9, "{row:?}");
    }
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
fn a_board_without_pins_refuses_in_words() {
    let mut session = Session::new(InProcess::nucleo());
    let ready = prepared(&mut session, SPEC, true);
    let ended = pins::run(&mut session, &ready, SAMPLES, |_, _| Ok::<(), Infallible>(()));
    let Err(LockstepError::Session(error)) = ended else { panic!("it ran") };
    assert!(error.to_string().contains("a board in process has no converters"), "{error}");
}
