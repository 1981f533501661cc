//! The lockstep loop over every link: the same seed, the same bits; the board's law and nothing else; how a run ends.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{FaultCode, ModeName, Settings};
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::lockstep::{LockstepError, Row, Task, prepare, prepare_task, probe, run, run_on};
use hil_bridge::session::Session;
use hil_bridge::tcp::Tcp;
use plant_sim::experiment::{Bench, Program, Setup, closed_loop};
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use support::{RATE_HZ, SPEC, bench, image, lockstep, noisy, pi1, served, waveform};
use virtual_board::serve::TcpLine;
use wire::{InputSource, ToBoard};

const SAMPLES: usize = 600;

/// The rows of the board in process, which the other links are held against.
fn in_process(seed: u64) -> Vec<Row> {
    let done = lockstep(&mut Session::new(InProcess::nucleo()), &noisy(), SPEC, SAMPLES, seed).unwrap();
    assert_eq!(done.outcome.fault, None);
    assert!(done.outcome.lost.is_empty());
    assert_eq!(done.rows.len(), SAMPLES);
    done.rows
}

#[test]
fn in_process_the_seed_decides_and_nothing_else() {
    assert_eq!(in_process(1), in_process(1));
    assert_ne!(in_process(1), in_process(2));
}

#[test]
fn over_tcp_the_bits_are_those_in_process() {
    let mut line = TcpLine::open("127.0.0.1:0").unwrap();
    let address = line.address().unwrap().to_string();
    let (rows, statistics) = served(&mut line, || {
        let mut session = Session::new(Tcp::connect(&address).unwrap());
        let rows = lockstep(&mut session, &noisy(), SPEC, SAMPLES, 1).unwrap().rows;
        (rows, session.statistics().clone())
    });
    assert_eq!(rows, in_process(1));
    assert_eq!((statistics.answered, statistics.lost, statistics.late), (statistics.requests, 0, 0));
    assert!(statistics.round_trip.total() >= SAMPLES as u64);
}

#[cfg(unix)]
#[test]
fn over_a_pseudo_terminal_the_bits_are_those_in_process() {
    use hil_bridge::serial::Serial;
    let mut line = virtual_board::serve::PtyLine::open().unwrap();
    let path = line.path().to_owned();
    let rows = served(&mut line, || {
        // A busy machine is no lossy link.
        let port = Serial::open(&path, 3_000_000).unwrap().with_patience(std::time::Duration::from_secs(60));
        lockstep(&mut Session::new(port), &noisy(), SPEC, SAMPLES, 1).unwrap().rows
    });
    assert_eq!(rows, in_process(1));
}

#[test]
fn on_the_virtual_board_the_bits_are_those_in_process() {
    let Some(image) = image() else { return };
    let board = InVirtual::new(&image, &bench(), RATE_HZ).unwrap();
    let mut session = Session::new(board);
    let done = lockstep(&mut session, &noisy(), SPEC, SAMPLES, 1).unwrap();
    assert_eq!(done.ready.board.board, "nucleo-g474re");
    assert_eq!(done.rows, in_process(1));
    // And it is left as it was found.
    assert_eq!(session.status().unwrap().mode, ModeName::Idle as u8);
}

#[test]
fn the_loop_is_that_of_simulate_up_to_the_converters() {
    let mut chain = noisy();
    chain.sensor.noise_m = 0.0;
    let rows = lockstep(&mut Session::new(InProcess::nucleo()), &chain, "step:40um@0.03s", SAMPLES, 1).unwrap().rows;
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s: 10e-6, seed: 1 };
    let program = Program::new(&Spec::parse("step:40um@0.03s").unwrap(), RATE_HZ).unwrap();
    let ideal = closed_loop(&setup, &pi1(), &program, &|_| ()).unwrap();
    let square = |(row, ideal_m): (&Row, &f64)| (row.displacement_m - ideal_m).powi(2);
    let sum: f64 = rows.iter().zip(&ideal.displacement_m).map(square).sum();
    let rms_m = (sum / SAMPLES as f64).sqrt();
    // The ADC's step is 63.5 nm, 18 nm rms; the DAC's 50 mV are 95 nm at 530 kV/m, 27 nm rms, which the loop shapes. Four times both
    // together is the most; less than half of the ADC's own would mean that no converter was in the loop.
    assert!((9e-9..130e-9).contains(&rms_m), "{rms_m}");
    // Every command is one that the DAC can make.
    let lsb_v = 3.3 / 4096.0 * 90.0 / 1.45;
    assert!(rows.iter().all(|row| (row.command_v / lsb_v - (row.command_v / lsb_v).round()).abs() < 1e-3));
}

#[test]
fn what_the_board_adds_are_parts_of_the_chain() {
    let mut chain = noisy();
    chain.sensor.noise_m = 0.0;
    let done = lockstep(&mut Session::new(InProcess::nucleo()), &chain, "step:40um@0.03s", SAMPLES, 1).unwrap();
    // Its latch as a delay, its converters as steps: then nothing is left for it to add.
    let calibration = done.ready.checked.calibration;
    chain.drive.delay_s = done.ready.latency_s;
    chain.drive.quantum_v = f64::from(calibration.drive_v_per_code()).abs();
    chain.sensor.quantum_m = f64::from(calibration.displacement_m_per_code()).abs();
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s: 0.0, seed: 1 };
    let program = Program::new(&Spec::parse("step:40um@0.03s").unwrap(), RATE_HZ).unwrap();
    let simulated = closed_loop(&setup, &pi1(), &program, &|_| ()).unwrap();
    // f32 in the board's conversions: a part in 1e6 of 40 um.
    for (row, simulated_m) in done.rows.iter().zip(&simulated.displacement_m) {
        assert!((row.displacement_m - simulated_m).abs() < 1e-10, "{row:?} {simulated_m}");
    }
}

#[test]
fn a_plant_beyond_the_guard_ends_in_a_fault_at_0_v_and_is_cleared_only_when_told() {
    let mut chain = noisy();
    // A sensor wired the wrong way round: the loop drives the plant away.
    chain.sensor.gain = -1.0;
    let mut session = Session::new(InProcess::nucleo());
    let done = lockstep(&mut session, &chain, "step:40um@0.03s", SAMPLES, 1).unwrap();
    assert_eq!(done.outcome.fault, Some(FaultCode::DisplacementTrip));
    assert_eq!(done.rows.last().unwrap().command_v, 0.0);
    assert!(done.rows.last().unwrap().limited_by.is_safe_state());
    assert!(done.rows.len() < SAMPLES, "nothing is recorded behind it");
    let again = lockstep(&mut session, &noisy(), SPEC, 10, 1);
    assert!(matches!(again, Err(LockstepError::InFault { .. })));
    prepare::<_, std::convert::Infallible>(&mut session, &pi1(), &waveform(SPEC), true).unwrap();
    assert_eq!(lockstep(&mut session, &noisy(), SPEC, SAMPLES, 1).unwrap().rows, in_process(1));
}

/// What a step in open loop leads to: whether it trips, and how far the structure moves.
fn driven(volts: u32) -> (bool, f64) {
    let (chain, waveform) = (noisy(), waveform(&format!("hold:{volts}V")));
    let (mut session, input) = (Session::new(InProcess::nucleo()), InputSource::Bridge);
    let task =
        Task { own: None, settings: Some(&pi1()), rate_hz: RATE_HZ, waveform: &waveform, is_closed_loop: false, input };
    let ready = prepare_task::<_, std::convert::Infallible>(&mut session, &task, false).unwrap();
    let start = Start::relaxed(&chain);
    let latency_s = ready.latency_s;
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s, seed: 1 };
    let mut bench = Bench::new(&setup);
    let keep = |_: &mut Session<InProcess>, _: &Row| Ok::<(), std::convert::Infallible>(());
    let outcome = run_on(&mut session, &ready, &mut bench, SAMPLES, keep).unwrap();
    // The run ends with the drive; the stage is still under way then.
    let peak_m = (0..SAMPLES).fold(outcome.peak_m, |most_m, _| {
        bench.apply(0.0);
        most_m.max(bench.moved_m().abs())
    });
    (outcome.fault == Some(FaultCode::DisplacementTrip), peak_m)
}

/// A slew limit that a board takes may need ten seconds to 0 V. Neither a run's end nor the next host's beginning is too early for it.
#[test]
fn a_slow_ramp_is_waited_for() {
    let settings = Settings { drive_min_v: -10.0, drive_max_v: 10.0, slew_v_per_s: 4.0, ..pi1() };
    let (chain, waveform, input) = (noisy(), waveform("hold:4V"), InputSource::Bridge);
    let mut session = Session::new(InProcess::nucleo());
    let task = Task {
        own: None,
        settings: Some(&settings),
        rate_hz: RATE_HZ,
        waveform: &waveform,
        is_closed_loop: false,
        input,
    };
    let ready = prepare_task::<_, std::convert::Infallible>(&mut session, &task, false).unwrap();
    let start = Start::relaxed(&chain);
    // A second up, and 15/8 of one down again.
    let samples = RATE_HZ as usize;
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples, latency_s: 10e-6, seed: 1 };
    let mut last_v = 0.0;
    let outcome = run(&mut session, &ready, &setup, |_, row| {
        last_v = row.command_v;
        Ok::<(), std::convert::Infallible>(())
    });
    // A code of the DAC is 50 mV.
    assert!((last_v - 4.0).abs() < 0.06 && outcome.unwrap().fault.is_none(), "{last_v}");
    assert_eq!(session.status().unwrap().mode, ModeName::Idle as u8);

    prepare_task::<_, std::convert::Infallible>(&mut session, &task, false).unwrap();
    session.order(&ToBoard::Arm).unwrap();
    session.order(&ToBoard::Run).unwrap();
    for _ in 0..samples {
        session.exchange(2048, 2048).unwrap();
    }
    prepare_task::<_, std::convert::Infallible>(&mut session, &task, false).unwrap();
}

/// The trip watches where the stage is, and stops the drive: what has been set in motion goes on. That is why `record` asks the plant first.
#[test]
fn the_trip_acts_at_its_level_and_a_stage_in_motion_goes_on() {
    let [(below, below_m), (above, above_m), (far, far_m)] = [62, 66, 90].map(driven);
    assert!(!below && below_m < 120e-6, "{below_m:e}");
    assert!(above && (120e-6..128e-6).contains(&above_m), "{above_m:e}");
    assert!(far && (140e-6..175e-6).contains(&far_m), "{far_m:e}");
}

#[test]
fn a_run_that_its_host_left_is_ended_by_the_next_unless_it_drives_pins() {
    let mut session = Session::new(InProcess::nucleo());
    prepare::<_, std::convert::Infallible>(&mut session, &pi1(), &waveform(SPEC), false).unwrap();
    session.order(&ToBoard::Arm).unwrap();
    session.order(&ToBoard::Run).unwrap();
    for _ in 0..20 {
        session.exchange(2048, 2048).unwrap();
    }
    assert_eq!(lockstep(&mut session, &noisy(), SPEC, SAMPLES, 1).unwrap().rows, in_process(1));
    session.order(&ToBoard::Input(InputSource::Analog)).unwrap();
    session.order(&ToBoard::Arm).unwrap();
    let Err(LockstepError::Busy { mode }) = lockstep(&mut session, &noisy(), SPEC, 10, 1) else { panic!("not busy") };
    assert_eq!(mode, "armed");
}

#[test]
fn a_row_that_cannot_be_kept_stops_the_board() {
    let mut session = Session::new(InProcess::nucleo());
    let ready = prepare::<_, &str>(&mut session, &pi1(), &waveform(SPEC), false).unwrap();
    let (chain, mut rows) = (noisy(), 0);
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s: 10e-6, seed: 1 };
    let ended = run(&mut session, &ready, &setup, |_, row| {
        rows += 1;
        if row.index == 300 { Err("the disk is full") } else { Ok(()) }
    });
    assert!(matches!(ended, Err(LockstepError::Row("the disk is full"))));
    assert_eq!(rows, 301);
    let status = session.status().unwrap();
    assert_eq!((status.mode, status.input), (ModeName::Idle as u8, InputSource::Analog));
}

#[test]
fn a_probe_measures_the_link_and_leaves_the_board_as_it_was() {
    let mut session = Session::new(InProcess::nucleo());
    let board = probe::<_, std::convert::Infallible>(&mut session, 500).unwrap();
    assert_eq!(board.board, "in-process");
    let statistics = session.statistics();
    assert_eq!((statistics.round_trip.total(), statistics.lost, statistics.late), (500, 0, 0));
    // The board numbers its frames from 0, so that none is missing before the first.
    assert_eq!((statistics.frames, statistics.missing), (statistics.requests, 0));
    let link = statistics.json();
    assert_eq!((&link["schema"], &link["round_trips"]), (&"hysteron-link-1".into(), &500.into()));
    let us = ["p50", "p99", "p99_9", "max"].map(|key| link["round_trip_us"][key].as_f64().unwrap());
    assert!(us[0] > 0.0 && us.is_sorted(), "{us:?}");
    // Twice the 99.9 % round trip for each sample.
    let paced = link["paced_at_most_hz"].as_f64().unwrap();
    assert!((paced * 2e-6 * us[2] - 1.0).abs() < 1e-9, "{paced} {us:?}");
    let status = session.status().unwrap();
    assert_eq!((status.mode, status.input), (ModeName::Idle as u8, InputSource::Analog));
}
