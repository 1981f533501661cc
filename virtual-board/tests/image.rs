//! The flash image on the virtual board: its instants, its law bit for bit, its cost, its closed loop, its link.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{AdcCode, Command, Controller, FaultCode, Generator, Input, ModeName, Segment};
use plant_sim::chain::{Held, Simulator};
use plant_sim::experiment::{Program, Setup, closed_loop};
use support::{PERIOD, bench, board, calibration};
use virtual_board::{BoardError, Heard, MachineError, Row, VirtualBoard};
use wire::{Flags, InputSource, Parameters, SegmentRecord, StreamReason, ToBoard, Trigger, Wave};

/// Sends a waveform, arms and runs; returns the index of the first row of the running loop.
fn start(board: &mut VirtualBoard, segments: &[SegmentRecord], is_closed_loop: bool) -> usize {
    board.order(&ToBoard::WaveClear).unwrap();
    for segment in segments {
        board.order(&ToBoard::WaveSegment(*segment)).unwrap();
    }
    board.order(&ToBoard::WaveUse { is_closed_loop }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    first_running(board)
}

/// The row in which the present run began: the image says how many samples it has taken, and which mode it is in.
fn first_running(board: &mut VirtualBoard) -> usize {
    board.machine.chip().rows.len()
}

fn hash(rows: &[Row]) -> u64 {
    rows.iter().fold(0xcbf2_9ce4_8422_2325, |hash, row| {
        [row.hold_cycle, u64::from(row.adc), row.latch_cycle, u64::from(row.dac), u64::from(row.monitor)]
            .iter()
            .fold(hash, |hash: u64, part| (hash ^ part).wrapping_mul(0x0100_0000_01b3))
    })
}

/// Host silence would end the run after 250 ms.
fn run_with_keep_alive(board: &mut VirtualBoard, samples: u64) {
    let mut left = samples;
    while left > 0 {
        let part = left.min(2000);
        board.run_samples(part).unwrap();
        board.status().unwrap();
        left -= part;
    }
}

const SINE: SegmentRecord =
    SegmentRecord { wave: Wave::Sine { amplitude: 80e-6, frequency_hz: 100.0 }, samples: u32::MAX };

/// The law on the host, fed the codes that the image's ADC delivered, gives the codes that its DAC was given. `rows` begin anywhere before
/// the run; where it began is found by the first difference from mid-code being explained.
fn assert_same_law(rows: &[Row], parameters: &Parameters, segments: &[Segment<'_>], is_closed_loop: bool) -> usize {
    let law = control_core::Law::try_build(&parameters.settings()).unwrap();
    let calibration = calibration();
    let generator = Generator::new(segments);
    // The run begins with the sample that carries it out: try the few rows around the first move.
    let moved = rows.iter().position(|row| row.dac != 2048).expect("the loop moved");
    for begin in moved.saturating_sub(8)..=moved {
        let mut controller = Controller::new(law);
        controller.arm().unwrap();
        controller.run().unwrap();
        let agrees = rows[begin..].iter().all(|row| {
            let command = if is_closed_loop {
                Command::GeneratedReference(generator)
            } else {
                Command::GeneratedDrive(generator)
            };
            let measured_m = calibration.displacement_m(AdcCode(row.adc));
            calibration.dac_code(controller.tick(&Input { command, measured_m }).drive_v).0 == row.dac
        });
        if agrees {
            assert_eq!(controller.mode_name(), ModeName::Running);
            return rows.len() - begin;
        }
    }
    panic!("the image's codes are not the law's");
}

#[test]
fn the_closed_loop_repeats_and_is_the_law_bit_for_bit_and_keeps_its_instants() {
    let Some(mut board) = board() else { return };
    // Ten million, in one run, in tests/soak.rs.
    let samples = 100_000;
    let run = |board: &mut VirtualBoard| {
        start(board, &[SINE], true);
        board.machine.forget_cost();
        run_with_keep_alive(board, samples);
    };
    run(&mut board);
    let status = board.status().unwrap();
    assert_eq!((status.overruns, status.lost_samples, status.fault), (0, 0, 0));
    assert_eq!(status.mode, ModeName::Running as u8);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    for two in rows.windows(2) {
        assert_eq!(two[1].hold_cycle - two[0].hold_cycle, PERIOD);
    }
    assert!(rows.iter().all(|row| row.latch_cycle - row.hold_cycle == 1700));
    let segments = [Segment::sine(20e3, 80e-6, 100.0, u32::MAX).unwrap()];
    let compared = assert_same_law(&rows, &Parameters::NUCLEO_PI1, &segments, true);
    assert!(compared as u64 >= samples, "{compared}");
    assert!(board.machine.chip().bench.peak_m < 110e-6);
    // The same again from the start, for a tenth of the time: the same bits.
    let Some(mut again) = self::board() else { return };
    start(&mut again, &[SINE], true);
    run_with_keep_alive(&mut again, 10_000);
    let second = std::mem::take(&mut again.machine.chip().rows);
    assert_eq!(hash(&rows[..second.len()]), hash(&second));
    println!("{compared} samples bit for bit, {:?}", board.machine.cost());
}

/// Runs `record` on the image with `parameters` and the same, as `spec`, in process: the same codes.
fn agrees_with_simulate(parameters: &Parameters, record: SegmentRecord, spec: &str) {
    let Some(mut board) = board_at(parameters.rate_hz) else { return };
    let rate_hz = f64::from(parameters.rate_hz);
    board.order(&ToBoard::SetParameters(*parameters)).unwrap();
    board.run_samples(4).unwrap();
    board.machine.chip().rows.clear();
    start(&mut board, &[record], true);
    run_with_keep_alive(&mut board, 4000);
    assert_eq!(board.status().unwrap().fault, 0, "{spec}");
    assert!(board.machine.chip().bench.peak_m < 110e-6, "{spec}: {}", board.machine.chip().bench.peak_m);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    // The same loop in process, with the converters' steps as the chain's: the sensor reads in codes, the drive acts in codes.
    let settings = bench();
    let calibration = calibration();
    let mut chain = settings.chain.clone();
    chain.sensor.quantum_m = f64::from(calibration.displacement_m_per_code());
    chain.drive.quantum_v = f64::from(calibration.drive_v_per_code());
    let (low_v, high_v) = calibration.drive_span_v();
    chain.drive.range_v = [f64::from(low_v), f64::from(high_v)];
    let program = Program::new(&spec.parse().unwrap(), rate_hz).unwrap();
    let setup = Setup { chain: &chain, start: &settings.start, rate_hz, samples: 3900, latency_s: 10e-6, seed: 1 };
    let simulated = closed_loop(&setup, &parameters.settings(), &program, &|_| {}).unwrap();
    let codes: Vec<i32> =
        simulated.displacement_m.iter().map(|reading_m| i32::from(calibration.adc_code(*reading_m as f32).0)).collect();
    // Where the run began among the rows: the first move of the DAC is the first of the commands that is half a code.
    let quiet = simulated.command_v.iter().position(|v| v.abs() >= chain.drive.quantum_v / 2.0).unwrap();
    let begin = rows.iter().position(|row| row.dac != 2048).unwrap() - quiet;
    let worst = codes.iter().zip(&rows[begin..]).map(|(code, row)| (code - i32::from(row.adc)).abs()).max().unwrap();
    // `simulate` rounds in f64 and the board in f32, so that now and then a command falls on the other side of a half: one DAC step,
    // 50 mV, is 94 nm of displacement, one and a half ADC codes.
    assert!(worst <= 2, "{spec}: {worst} codes");
    // With the board's own conversion on both sides there is nothing left to differ: the codes are the same.
    let coded = in_process(parameters, record, codes.len());
    let differs = coded.iter().zip(&rows[begin..]).position(|((adc, dac), row)| (*adc, *dac) != (row.adc, row.dac));
    assert_eq!(differs, None, "{spec} at {rate_hz} Hz");
}

/// The loop in process: plant, the board's calibration, the law. ADC and DAC codes, sample by sample.
fn in_process(parameters: &Parameters, record: SegmentRecord, samples: usize) -> Vec<(u16, u16)> {
    let settings = bench();
    let calibration = calibration();
    let mut simulator = Simulator::new(&settings.chain, 1.0 / f64::from(parameters.rate_hz), 10e-6);
    simulator.start_from(&settings.start.state, settings.start.drive_v);
    let segments = [record.build(parameters.rate_hz, &[]).unwrap()];
    let generator = Generator::new(&segments);
    let mut controller = Controller::new(control_core::Law::try_build(&parameters.settings()).unwrap());
    controller.arm().unwrap();
    controller.run().unwrap();
    (0..samples)
        .map(|_| {
            let adc = calibration.adc_code(simulator.reading_m() as f32);
            let input =
                Input { command: Command::GeneratedReference(generator), measured_m: calibration.displacement_m(adc) };
            let dac = calibration.dac_code(controller.tick(&input).drive_v);
            simulator.advance(Held::zero_order(f64::from(calibration.drive_v(dac))), 0.0);
            (adc.0, dac.0)
        })
        .collect()
}

/// A board whose plant is stepped as a rate asks for.
fn board_at(rate_hz: f32) -> Option<VirtualBoard> {
    let image = support::image("nucleo-g474re")?;
    let mut board = VirtualBoard::new(&image, &bench(), if rate_hz > 20e3 { 850 } else { 1700 });
    board.greet().unwrap();
    Some(board)
}

/// PI 2 as `controllers/pi2.toml` states it, on the same limits.
fn pi2() -> Parameters {
    let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../controllers/pi2.toml"));
    let settings = plant_sim::controller::Controller::read(path).unwrap().settings(20e3);
    Parameters::NUCLEO_PI1.with_settings(&settings)
}

#[test]
fn closed_loops_are_those_in_process_code_for_code() {
    let hold = |level: f32| SegmentRecord { wave: Wave::Hold { level }, samples: u32::MAX };
    for rate_hz in [20e3, 40e3] {
        for controller in [Parameters::NUCLEO_PI1, pi2()] {
            let parameters = Parameters { rate_hz, ..controller };
            agrees_with_simulate(&parameters, hold(80e-6), "step:80um");
            for frequency_hz in [1.0_f32, 50.0, 100.0, 150.0] {
                let wave = Wave::Sine { amplitude: 80e-6, frequency_hz };
                let record = SegmentRecord { wave, samples: u32::MAX };
                agrees_with_simulate(&parameters, record, &format!("sine:80um@{frequency_hz}Hz"));
            }
        }
        // 40 um at once: the shaping off, the slew limit and the trip in force.
        let unshaped = Parameters {
            rate_hz,
            reference_rate_m_per_s: f32::INFINITY,
            reference_acceleration_m_per_s2: f32::INFINITY,
            ..Parameters::NUCLEO_PI1
        };
        agrees_with_simulate(&unshaped, hold(40e-6), "step:40um");
    }
}

#[test]
fn at_40_khz_the_period_halves_and_the_latch_stays() {
    let Some(mut board) = board() else { return };
    let parameters = Parameters { rate_hz: 40e3, ..Parameters::NUCLEO_PI1 };
    board.order(&ToBoard::SetParameters(parameters)).unwrap();
    board.machine.chip().rows.clear();
    start(&mut board, &[SINE], true);
    run_with_keep_alive(&mut board, 4000);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    let settled = &rows[2..];
    assert!(settled.windows(2).all(|two| two[1].hold_cycle - two[0].hold_cycle == PERIOD / 2));
    assert!(rows.iter().all(|row| row.latch_cycle - row.hold_cycle == 1700));
    let segments = [Segment::sine(40e3, 80e-6, 100.0, u32::MAX).unwrap()];
    assert_same_law(&rows, &parameters, &segments, true);
    assert_eq!(board.status().unwrap().overruns, 0);
    // 40,000 samples of 10 bytes a second are more than 3 Mbaud carry: every second one, and said so.
    let started = board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    assert_eq!(started, Heard::StreamStarted { every: 2, reason: StreamReason::LinkTooSlow });
}

#[test]
fn open_loop_plays_volts_from_the_table() {
    let Some(mut board) = board() else { return };
    let values: Vec<u8> = (0..100).flat_map(|k| (20.0 * (k as f32 / 50.0 - 1.0)).to_le_bytes()).collect();
    board.order(&ToBoard::WaveTable { offset: 0, values: &values }).unwrap();
    let table = SegmentRecord { wave: Wave::Table { offset: 0, length: 100 }, samples: u32::MAX };
    start(&mut board, &[table], false);
    run_with_keep_alive(&mut board, 2000);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    let values: Vec<f32> = (0..100).map(|k| 20.0 * (k as f32 / 50.0 - 1.0)).collect();
    let segments = [Segment::table(&values, u32::MAX).unwrap()];
    assert_same_law(&rows, &Parameters::NUCLEO_PI1, &segments, false);
}

#[test]
fn the_stream_is_whole_at_full_rate_and_says_what_the_pins_saw() {
    let Some(mut board) = board() else { return };
    start(&mut board, &[SINE], true);
    let started = board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    assert_eq!(started, Heard::StreamStarted { every: 1, reason: StreamReason::AsAsked });
    run_with_keep_alive(&mut board, 20_000);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    let mut next = None;
    let mut samples = Vec::new();
    for heard in &board.unasked {
        if let Heard::StreamBlock { first, every: 1, lost: 0, samples: block } = heard {
            assert!(next.is_none_or(|next| next == *first), "a gap before {first}");
            next = Some(first + block.len() as u32);
            samples.extend(block.iter().copied());
        } else {
            panic!("{heard:?}");
        }
    }
    assert!(samples.len() > 19_000, "{}", samples.len());
    assert_eq!(board.bad_frames, 0);
    let Some(Heard::StreamBlock { first, .. }) = board.unasked.first() else { panic!("no block") };
    // The image counts samples from 1, the rows from 0.
    let rows = &rows[*first as usize - 1..];
    for (sample, row) in samples.iter().zip(rows) {
        assert_eq!((sample.displacement, sample.monitor, sample.drive), (row.adc, row.monitor, row.dac));
        assert_eq!(sample.flags.mode(), ModeName::Running as u8);
        assert!(sample.flags.contains(Flags::ENABLE) && !sample.flags.contains(Flags::OVERRUN));
    }
}

#[test]
fn a_capture_holds_what_came_before_its_trigger() {
    let Some(mut board) = board() else { return };
    board.order(&ToBoard::CaptureArm { before: 500, trigger: Trigger::Run }).unwrap();
    board.run_samples(1000).unwrap();
    let Heard::CaptureBlock { total: 0, .. } = board.ask(&ToBoard::CaptureRead { from: 0 }).unwrap() else {
        panic!("a capture that waits has nothing to show");
    };
    start(&mut board, &[SINE], true);
    board.run_samples(2000).unwrap();
    let mut samples = Vec::new();
    let mut begin = 0;
    while samples.len() < 2048 {
        let answer = board.ask(&ToBoard::CaptureRead { from: samples.len() as u16 }).unwrap();
        let Heard::CaptureBlock { total: 2048, first, samples: block, .. } = answer else { panic!("{answer:?}") };
        begin = first;
        samples.extend(block);
    }
    assert_eq!(samples.len(), 2048);
    let running = |sample: &wire::Sample| sample.flags.mode() == ModeName::Running as u8;
    assert!(samples[..500].iter().all(|sample| !running(sample)));
    assert!(samples[500..].iter().all(running));
    let rows = std::mem::take(&mut board.machine.chip().rows);
    for (sample, row) in samples.iter().zip(&rows[begin as usize - 1..]) {
        assert_eq!((sample.displacement, sample.drive), (row.adc, row.dac));
    }
}

/// The stream keeps the sender busy, so that the loop could arm the capture before the block is read, or while it is.
#[test]
fn a_capture_armed_in_the_same_bytes_leaves_the_block_before_whole() {
    let Some(mut board) = board() else { return };
    start(&mut board, &[SINE], true);
    board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    let arm = ToBoard::CaptureArm { before: 100, trigger: Trigger::Now };
    board.order(&arm).unwrap();
    for k in 0..20 {
        run_with_keep_alive(&mut board, 2100);
        board.run_cycles(10_000 + 437 * k).unwrap();
        board.unasked.clear();
        board.send(&ToBoard::CaptureRead { from: 1000 }).unwrap();
        let asked = board.send(&arm).unwrap();
        board.run_samples(200).unwrap();
        let mut answers = board.unasked.iter().filter(|heard| !matches!(heard, Heard::StreamBlock { .. }));
        let Some(Heard::CaptureBlock { from: 1000, total: 2048, first, samples }) = answers.next() else {
            panic!("no block in {:?}", board.unasked);
        };
        assert_eq!(answers.next(), Some(&Heard::Done { sequence: asked }));
        assert_eq!(samples.len(), 48);
        let chip = board.machine.chip();
        for (sample, row) in samples.iter().zip(&chip.rows[*first as usize - 1 + 1000..]) {
            assert_eq!((sample.displacement, sample.drive), (row.adc, row.dac));
        }
    }
}

#[test]
fn a_reference_under_an_open_loop_goes_there_from_where_the_stage_stands() {
    let Some(mut board) = board() else { return };
    board.order(&ToBoard::Drive { drive_v: 40.0 }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    board.run_samples(4000).unwrap();
    let stood_m = board.machine.chip().rows.last().expect("samples").displacement_m;
    assert!((58e-6..59e-6).contains(&stood_m), "{stood_m}");
    // The second move in a loop that was closed before: how far beyond its target, and beyond its start.
    let [moved, usual] = [(53e-6, 58.2e-6), (47.8e-6, 53e-6)].map(|(to_m, from_m)| {
        board.machine.chip().rows.clear();
        board.order(&ToBoard::Reference { reference_m: to_m as f32 }).unwrap();
        board.run_samples(2000).unwrap();
        let chip = board.machine.chip();
        let most = |beyond_m: &dyn Fn(f64) -> f64| {
            chip.rows.iter().map(|row| beyond_m(row.displacement_m)).fold(0.0, f64::max)
        };
        (most(&|at_m| to_m - at_m), most(&|at_m| at_m - from_m))
    });
    // A code of the ADC is 0.063 um, and where in one a move begins is chance.
    assert!(usual.0 < 3e-6 && (moved.0 - usual.0).abs() < 0.2e-6 && moved.1 < 0.07e-6, "{moved:?} {usual:?}");
}

#[test]
fn over_the_bridge_the_law_is_the_same_and_the_dac_stays_safe() {
    let Some(mut board) = board() else { return };
    let refused = board.ask(&ToBoard::BridgeSample { index: 0, displacement: 2048, monitor: 2048 }).unwrap_err();
    assert!(refused.to_string().contains("choose the bridge first"), "{refused}");
    board.order(&ToBoard::Input(InputSource::Bridge)).unwrap();
    board.order(&ToBoard::Reference { reference_m: 40e-6 }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    let law = control_core::Law::try_build(&Parameters::NUCLEO_PI1.settings()).unwrap();
    let calibration = calibration();
    let mut controller = Controller::new(law);
    controller.arm().unwrap();
    controller.run().unwrap();
    let mut displacement_m = 0.0_f32;
    let mut monitor = 2048;
    for index in 0..500 {
        let displacement = calibration.adc_code(displacement_m);
        let answer = board.ask(&ToBoard::BridgeSample { index, displacement: displacement.0, monitor }).unwrap();
        let Heard::BridgeDrive { index: of, drive, drive_v, .. } = answer else { panic!("{answer:?}") };
        let input = Input {
            command: Command::Reference { reference_m: 40e-6 },
            measured_m: calibration.displacement_m(displacement),
        };
        let output = controller.tick(&input);
        assert_eq!(
            (of, drive, drive_v.to_bits()),
            (index, calibration.dac_code(output.drive_v).0, output.drive_v.to_bits())
        );
        displacement_m += (1.88e-6 * drive_v - displacement_m) * 0.25;
        monitor = drive;
    }
    assert!((displacement_m - 40e-6).abs() < 0.2e-6, "{displacement_m}");
    let rows = std::mem::take(&mut board.machine.chip().rows);
    assert!(rows.iter().all(|row| row.dac == 2048 && !row.is_enabled));
    let refused = board.ask(&ToBoard::Input(InputSource::Analog)).unwrap_err();
    assert!(refused.to_string().contains("only while idle"), "{refused}");
}

#[test]
fn parameters_are_taken_as_a_set_or_refused_in_words() {
    let Some(mut board) = board() else { return };
    let good = Parameters::NUCLEO_PI1;
    let bad = Parameters { kp_v_per_m: f32::NAN, rail_codes: 100, ..good };
    let refused = board.ask(&ToBoard::SetParameters(bad)).unwrap_err();
    assert!(
        matches!(&refused, BoardError::Refused(reason) if reason == "kp_v_per_m must be a finite number"),
        "{refused}"
    );
    assert_eq!(board.ask(&ToBoard::GetParameters).unwrap(), Heard::Parameters(Box::new(good)));
    start(&mut board, &[SINE], true);
    // Gains may change while the loop runs, the rate and the calibration may not.
    board.order(&ToBoard::SetParameters(Parameters { kp_v_per_m: 4e5, ..good })).unwrap();
    for other in [Parameters { rate_hz: 40e3, ..good }, Parameters { sensor_m_per_v: 8e-5, ..good }] {
        let refused = board.ask(&ToBoard::SetParameters(other)).unwrap_err().to_string();
        assert!(refused.contains("only while idle"), "{refused}");
    }
    board.run_samples(400).unwrap();
    assert_eq!(board.status().unwrap().fault, 0);
    assert_eq!(FaultCode::from_number(0), None);
}

/// Without the guard the image is interrupted inside of an IT block sooner or later, and the run says so; with it, never.
/// A version of rsemu that stacks ITSTATE has to be shown not to corrupt the code then, before the guard may go.
#[test]
fn without_the_guard_an_interrupt_hits_an_it_block_and_is_found_out() {
    let Some(mut board) = board() else { return };
    start(&mut board, &[SINE], true);
    board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    board.run_samples(3000).unwrap();
    board.machine.drop_guard();
    let mut found = None;
    // Requests at every phase of the sampling: most of the time the core sleeps, and what it does after a request is what can be hit.
    for k in 0..1000 {
        if let Err(error) = board.run_cycles(10_000 + 37 * k % PERIOD).and_then(|()| board.status()) {
            found = Some(error);
            break;
        }
    }
    let found = found.expect("the guard is not needed any more?");
    assert!(matches!(found, BoardError::Machine(MachineError::ItBlock { .. })), "{found}");
}

/// A set of parameters is compared with the one in force while the control interrupt comes at any instruction of it. Where the flags of a
/// comparison are lost then, two equal numbers differ sooner or later and a change of the law is refused; where they are kept, at none of
/// the phases up to that one.
#[test]
fn the_law_changes_at_any_phase_of_the_interrupt() {
    let (Some(mut losing), Some(mut keeping)) = (board(), board()) else { return };
    losing.machine.lose_flags();
    let first_refused = |board: &mut VirtualBoard, orders: u64| {
        start(board, &[SINE], true);
        (0..orders).find(|k| {
            board.run_cycles(10_000 + 37 * k % PERIOD).unwrap();
            let law = Parameters { kp_v_per_m: 4e5 + *k as f32, ..Parameters::NUCLEO_PI1 };
            board.order(&ToBoard::SetParameters(law)).is_err()
        })
    };
    let found = first_refused(&mut losing, 4000).expect("FPSCR need not be put back any more?");
    println!("refused at order {found} where flags are lost");
    assert_eq!(first_refused(&mut keeping, found + 1), None);
}

/// No call to a panic, to software floating point or to 64-bit division is left in what the control interrupt runs from.
#[test]
fn the_control_path_calls_nothing_outside_of_itself() {
    let Some(image) = support::image("nucleo-g474re") else { return };
    let (from, to) = (image.symbol("__sccmram").unwrap(), image.symbol("__eccmram").unwrap());
    let source = image.symbol("__siccmram").unwrap();
    assert!(from == 0x1000_0000 && to - from > 3000 && to - from < 12_000, "{from:#x} to {to:#x}");
    // Anything called from CCM SRAM in flash goes over a veneer: MOVW, MOVT with an address in flash, BX.
    let code = &image.flash[(source - 0x0800_0000) as usize..][..(to - from) as usize];
    let halves: Vec<u32> = code.chunks_exact(2).map(|two| u32::from(u16::from_le_bytes([two[0], two[1]]))).collect();
    let mut outside = Vec::new();
    for five in halves.windows(5) {
        let is_move = |first: u32, second: u32, top: u32| first & 0xfbf0 == top && second & 0x8f00 == 0x0c00;
        if is_move(five[0], five[1], 0xf240) && is_move(five[2], five[3], 0xf2c0) && five[4] == 0x4760 {
            let half = |first: u32, second: u32| {
                (first & 15) << 12 | (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xff
            };
            outside.push(half(five[2], five[3]) << 16 | half(five[0], five[1]));
        }
    }
    // The one there is belongs to `Calibration::adc_code`, which simulated sensors call and the interrupt does not.
    assert!(outside.len() <= 1, "{outside:x?}");
}

/// Signs of life as fast as the line takes them, each logged and answered, beside the full stream: the latch does not move by a cycle.
#[test]
fn the_latch_is_exact_under_a_flood_of_log_and_full_traffic() {
    let Some(mut board) = board() else { return };
    start(&mut board, &[SINE], true);
    board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    let mut lines = board.logged();
    assert!(lines[0].starts_with("nucleo-g474re: reset 0, fault 0"), "{lines:?}");
    board.machine.chip().rows.clear();
    // What the line carries beside the stream: 9 answers of 45 bytes in 5 ms. Then ten times as many, which it can't.
    for requests in [9; 100].into_iter().chain([90; 20]) {
        for _ in 0..requests {
            board.send(&ToBoard::KeepAlive).unwrap();
        }
        board.run_samples(100).unwrap();
        lines.extend(board.logged());
    }
    assert!(lines.len() > 900, "{} lines", lines.len());
    assert!(lines[10].starts_with("request "), "{}", lines[10]);
    let answers = board.unasked.iter().filter(|heard| matches!(heard, Heard::Status(_))).count();
    assert!(answers > 900, "{answers}");
    // The deepest the stack ever was, under all of this: a tenth of what there is (20 KB), below which is no memory.
    let image = support::image("nucleo-g474re").unwrap();
    let (used, there) = board.machine.stack_bytes(&image).unwrap();
    println!("stack: {used} of {there} bytes");
    assert!((1600..3000).contains(&used) && there == 20_480, "{used} of {there} bytes");
    // Once the flood is over the board answers as ever; requests that found no room were lost, and are counted.
    board.run_samples(1000).unwrap();
    board.send_bytes(&[0]);
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.overruns, status.lost_samples), (ModeName::Running as u8, 0, 0));
    assert!(status.bad_frames > 0);
    let chip = board.machine.chip();
    assert!(chip.rows.len() >= 10_000);
    assert!(chip.rows.windows(2).all(|two| two[1].latch_cycle - two[0].latch_cycle == PERIOD));
    assert!(chip.rows.iter().all(|row| row.latch_cycle - row.hold_cycle == 1700));
}
