//! What the control interrupt costs: exact counts of instructions on this image, the dearest case found by search.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use support::board;
use virtual_board::{Cost, VirtualBoard};
use wire::{Parameters, SegmentRecord, ToBoard, Trigger, Wave};

/// Numbers that repeat.
struct Draw(u32);

impl Draw {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 16_777_216.0
    }

    fn one_of(&mut self, values: &[f32]) -> f32 {
        values[(self.next() * values.len() as f32) as usize]
    }
}

fn waves(amplitude: f32) -> [Wave; 8] {
    [
        Wave::Hold { level: amplitude },
        Wave::Square { amplitude, frequency_hz: 400.0 },
        Wave::Sine { amplitude, frequency_hz: 100.0 },
        Wave::Triangle { amplitude, frequency_hz: 100.0 },
        Wave::LinearSweep { amplitude, from_hz: 10.0, to_hz: 400.0 },
        Wave::LogSweep { amplitude, from_hz: 10.0, to_hz: 400.0 },
        Wave::Ladder { amplitude, levels: 5, hold_samples: 3 },
        Wave::Table { offset: 0, length: 100 },
    ]
}

/// Plays `wave` for a while with `parameters` and codes as the sensor might deliver them; stopped again at the end.
fn play(board: &mut VirtualBoard, parameters: Parameters, wave: Wave, is_closed_loop: bool, noise: f32) {
    board.order(&ToBoard::SetParameters(parameters)).unwrap();
    board.order(&ToBoard::WaveClear).unwrap();
    for samples in [150, 250] {
        board.order(&ToBoard::WaveSegment(SegmentRecord { wave, samples })).unwrap();
    }
    board.order(&ToBoard::WaveUse { is_closed_loop }).unwrap();
    let mut draw = Draw(noise.to_bits());
    let calibration = support::calibration();
    let feed = move |_| calibration.adc_code((draw.next() - 0.5) * noise).0;
    if noise > 0.0 {
        board.machine.chip().bench.fed = Some(Box::new(feed));
    }
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    board.run_samples(300).unwrap();
    board.order(&ToBoard::SetParameters(Parameters { kp_v_per_m: 3e5, ..parameters })).unwrap();
    board.run_samples(50).unwrap();
    board.machine.chip().bench.fed = None;
    let _ = board.ask(&ToBoard::Stop);
    board.run_samples(200).unwrap();
    let _ = board.ask(&ToBoard::ClearFault);
}

#[test]
fn the_dearest_control_interrupt_found() {
    let Some(mut board) = board() else { return };
    let values: Vec<u8> = (0..100).flat_map(|k| (1e-6 * k as f32).to_le_bytes()).collect();
    board.order(&ToBoard::WaveTable { offset: 0, values: &values }).unwrap();
    board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    let mut draw = Draw(1);
    let mut worst = (0, String::new());
    for _ in 0..60 {
        let limited = |draw: &mut Draw, bound: f32| if draw.next() < 0.3 { f32::INFINITY } else { bound };
        let parameters = Parameters {
            kp_v_per_m: draw.one_of(&[0.0, 1e5, 8.6e5]),
            slew_v_per_s: draw.one_of(&[2e4, 1e5, 4e5]),
            drive_max_v: draw.one_of(&[30.0, 90.0]),
            reference_max_m: draw.one_of(&[60e-6, 100e-6]),
            reference_rate_m_per_s: limited(&mut draw, 0.1),
            reference_acceleration_m_per_s2: limited(&mut draw, 200.0),
            monitor_tolerance_v: draw.one_of(&[0.5, 15.0]),
            monitor_samples: 10_000,
            ..Parameters::NUCLEO_PI1
        };
        let is_closed_loop = draw.next() < 0.8;
        let amplitude = if is_closed_loop { 80e-6 } else { 60.0 };
        let wave = waves(amplitude)[(8.0 * draw.next()) as usize];
        let noise = draw.one_of(&[0.0, 2e-6, 40e-6]);
        board.order(&ToBoard::CaptureArm { before: 100, trigger: Trigger::Now }).unwrap();
        board.machine.forget_cost();
        play(&mut board, parameters, wave, is_closed_loop, noise);
        let Cost { instructions: (_, most), .. } = board.machine.cost();
        if most > worst.0 {
            worst = (most, format!("{wave:?}, closed loop {is_closed_loop}, noise {noise}, {parameters:?}"));
        }
    }
    println!("{} instructions: {}", worst.0, worst.1);
    // What was asked for is 420. Less by much would mean that the search finds no dear cases any more.
    assert!((400..=420).contains(&worst.0), "{} instructions: {}", worst.0, worst.1);
}

/// Fewest, mean and most instructions of the control interrupt over 1000 samples, of the interrupt behind it, and fetches from flash.
fn measure(board: &mut VirtualBoard) -> ([u64; 3], [u64; 3]) {
    board.machine.forget_cost();
    board.run_samples(1000).unwrap();
    let figures = |cost: Cost| {
        assert!(cost.count >= 1000 && cost.from_flash == 0, "{cost:?}");
        [cost.instructions.0, cost.total_instructions / cost.count, cost.instructions.1]
    };
    let figures = (figures(board.machine.cost()), figures(board.machine.between_cost()));
    board.status().unwrap();
    println!("{figures:?}");
    figures
}

#[test]
fn both_interrupts_run_from_ccm_and_cost_what_is_stated() {
    let Some(mut board) = board() else { return };
    let idle = measure(&mut board);
    board.order(&ToBoard::Reference { reference_m: 40e-6 }).unwrap();
    let run = |board: &mut VirtualBoard| {
        board.order(&ToBoard::Arm).unwrap();
        board.order(&ToBoard::Run).unwrap();
        board.run_samples(400).unwrap();
    };
    run(&mut board);
    let constant = measure(&mut board);
    board.order(&ToBoard::Stop).unwrap();
    board.run_samples(100).unwrap();
    let mut play = |wave: Wave| {
        board.order(&ToBoard::WaveClear).unwrap();
        board.order(&ToBoard::WaveSegment(SegmentRecord { wave, samples: u32::MAX })).unwrap();
        board.order(&ToBoard::WaveUse { is_closed_loop: true }).unwrap();
        run(&mut board);
        let plain = measure(&mut board);
        board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
        board.order(&ToBoard::CaptureArm { before: 100, trigger: Trigger::Now }).unwrap();
        let streaming = measure(&mut board);
        board.order(&ToBoard::StreamStop).unwrap();
        board.order(&ToBoard::Stop).unwrap();
        board.run_samples(100).unwrap();
        (plain, streaming)
    };
    let (sine, streamed) = play(Wave::Sine { amplitude: 80e-6, frequency_hz: 100.0 });
    let (square, _) = play(Wave::Square { amplitude: 80e-6, frequency_hz: 100.0 });
    // Exact counts of this image are in firmware/README.md; the bands leave 6 % either way for another compiler. Asked for: 320 typically.
    let within = |mean: u64, stated: u64| assert!(mean.abs_diff(stated) * 100 <= 6 * stated, "{mean} for {stated}");
    within(idle.0[1], 114);
    within(constant.0[1], 243);
    within(sine.0[1], 251);
    within(square.0[1], 294);
    assert!(square.0[1] <= 320 && square.0[2] <= 420, "{square:?}");
    // Whatever is streamed or captured does not touch the control interrupt.
    assert_eq!(streamed.0, sine.0);
    within(sine.1[1], 160);
    within(streamed.1[1], 303);
    let status = board.status().unwrap();
    // Nothing is anywhere near its deadline of 1890 cycles.
    assert!((400..900).contains(&status.ready_max_cycles), "{}", status.ready_max_cycles);
}

#[test]
fn the_law_alone_costs_what_is_stated() {
    let Some(image) = support::image("law-cost") else { return };
    // Fewest instructions, where every limit is looked at and none acts, and most, where volts limit and the integral stands. Asked for: 60 for
    // PI and feedforward, 110 with all limits. Exact counts, 6 % either way for another compiler.
    for (name, stated) in [("cost_of_pi", [39, 71]), ("cost_of_law", [96, 135]), ("cost_of_codes", [116, 155])] {
        let mut board = VirtualBoard::new(&image, &support::bench(), 1700);
        board.machine.count_calls(image.symbol(name).expect("the function"));
        let limit = board.machine.now() + 2_000_000;
        board.machine.run(limit, |_| false).unwrap();
        let calls = board.machine.calls();
        let counted = [*calls.iter().min().unwrap(), *calls.iter().max().unwrap()];
        println!("{name}: {counted:?} in {} calls", calls.len());
        assert!(calls.len() > 2000, "{} calls", calls.len());
        for (counted, stated) in counted.into_iter().zip(stated) {
            assert!(counted.abs_diff(stated) * 100 <= 6 * stated, "{name}: {counted} for {stated}");
        }
    }
}
