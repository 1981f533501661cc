//! Faults, each injected, each ending in its safe state: fault code latched, drive at mid-code by the ramp, ENABLE still, and nothing
//! moves again before clear_fault.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{FaultCode, ModeName};
use support::{bench, board, external_board, image};
use virtual_board::{Heard, Reset, VirtualBoard, Wire};
use wire::{Converters, InputSource, Parameters, ResetCause, SegmentRecord, ToBoard, Wave};

const MID: u16 = 2048;
/// The ramp from 60 V at 20 V a sample takes 15/8 60 / 20 + 1 = 6 samples; 20 more for the amplifier's fall-back: 1 ms.
const SETTLED: u64 = 6 + 20;

/// A loop that holds 80 um, 0.1 s after its start.
fn running() -> Option<VirtualBoard> {
    let mut board = board()?;
    run(&mut board);
    Some(board)
}

fn run(board: &mut VirtualBoard) {
    board.order(&ToBoard::WaveClear).unwrap();
    let wave = SegmentRecord { wave: Wave::Hold { level: 80e-6 }, samples: u32::MAX };
    board.order(&ToBoard::WaveSegment(wave)).unwrap();
    board.order(&ToBoard::WaveUse { is_closed_loop: true }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    board.run_samples(2000).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Running as u8, 0));
    let mut chip = board.machine.chip();
    let last = *chip.rows.last().expect("samples");
    assert!(last.is_enabled && last.dac > MID + 400, "{last:?}");
    chip.rows.clear();
}

/// The fault is latched, came by itself, within `within` samples from now; then the safe state.
fn ends_safe(board: &mut VirtualBoard, code: FaultCode, within: u64) {
    board.unasked.clear();
    let before = board.machine.chip().rows.len();
    board.run_samples(within + SETTLED).unwrap();
    {
        let chip = board.machine.chip();
        let after = &chip.rows[before + within as usize..];
        let last = after.last().expect("samples");
        assert!(last.dac == MID && !last.is_enabled, "{code}: {last:?}");
        assert!(!chip.gpio[1].level(5), "{code}: ENABLE is high");
        // The ramp moves by no more than the slew limit: 20 V of 90 / 1.45 * 3.3 / 4096 V a code are 399.9 codes.
        for two in chip.rows[before..].windows(2) {
            assert!(two[0].dac.abs_diff(two[1].dac) <= 400, "{code}: {two:?}");
        }
    }
    // Ends a frame that was cut.
    board.send_bytes(&[0]);
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Fault as u8, code.number()), "{code}");
    board.run_cycles(2_000_000).unwrap();
    let told =
        board.unasked.iter().any(|heard| matches!(heard, Heard::Fault { code: told, .. } if *told == code.number()));
    assert!(told, "{code} was not reported: {:?}", board.unasked);
    stays_safe(board);
}

/// Neither arm nor run is taken, and nothing moves.
fn stays_safe(board: &mut VirtualBoard) {
    for action in [ToBoard::Arm, ToBoard::Run] {
        let refused = board.ask(&action).unwrap_err().to_string();
        assert!(refused.contains("refused in mode fault"), "{refused}");
    }
    let before = board.machine.chip().rows.len();
    board.run_samples(200).unwrap();
    assert!(board.machine.chip().rows[before..].iter().all(|row| row.dac == MID && !row.is_enabled));
}

#[test]
fn a_sensor_that_is_open_or_shorted_is_seen_in_the_next_sample() {
    for wire in [Wire::Open, Wire::Shorted] {
        let Some(mut board) = running() else { return };
        board.machine.chip().bench.wire = wire;
        ends_safe(&mut board, FaultCode::SensorRail, 1);
        // Cleared with the wire still broken it does not start again; with a whole one it does.
        board.order(&ToBoard::ClearFault).unwrap();
        board.order(&ToBoard::Arm).unwrap();
        board.run_samples(2).unwrap();
        assert_eq!(board.status().unwrap().fault, FaultCode::SensorRail.number());
        board.machine.chip().bench.wire = Wire::Whole;
        board.order(&ToBoard::ClearFault).unwrap();
        board.run_samples(4000).unwrap();
        run(&mut board);
    }
}

#[test]
fn a_displacement_beyond_the_trip_is_seen_in_its_sample() {
    let Some(mut board) = running() else { return };
    // 125 um as an ADC code: beyond 120 um, not at the rail.
    let code = support::calibration().adc_code(125e-6).0;
    board.machine.chip().bench.fed = Some(Box::new(move |_| code));
    ends_safe(&mut board, FaultCode::DisplacementTrip, 1);
}

#[test]
fn a_dac_that_is_stuck_is_seen_by_the_monitor() {
    let Some(mut board) = running() else { return };
    board.machine.chip().stuck_dac = Some(MID + 200);
    // 20 samples in a row; the pin itself can't be brought to mid-code, but ENABLE takes the amplifier off it.
    board.run_samples(20 + 60).unwrap();
    let status = board.status().unwrap();
    assert_eq!(status.fault, FaultCode::DriveMismatch.number());
    let chip = board.machine.chip();
    assert!(!chip.rows.last().expect("samples").is_enabled);
    assert_eq!(chip.bench.drive_v(), 0.0);
}

#[test]
fn a_host_that_goes_on_arming_does_not_hide_a_dac_that_is_stuck() {
    let Some(mut board) = running() else { return };
    board.machine.chip().stuck_dac = Some(MID + 200);
    // An answer takes some samples, fewer than the 20 misses in a row that are a fault.
    for _ in 0..20 {
        let before = board.machine.chip().samples;
        let refused = board.ask(&ToBoard::Arm).unwrap_err().to_string();
        assert!(refused.contains("arm is refused in mode"), "{refused}");
        assert!(board.machine.chip().samples - before < 20);
    }
    assert_eq!(board.status().unwrap().fault, FaultCode::DriveMismatch.number());
}

#[test]
fn silence_of_the_host_ramps_down_after_250_ms() {
    let Some(mut board) = running() else { return };
    // Cut in the middle of a frame.
    board.send_bytes(&[3, 1, 1]);
    board.run_samples(4990).unwrap();
    assert!(board.machine.chip().rows.last().expect("samples").dac > MID + 400);
    // The last request was heard some samples before the count began.
    ends_safe(&mut board, FaultCode::LinkLoss, 12);
}

#[test]
fn garbage_at_full_baud_neither_stops_nor_delays_the_loop() {
    let Some(mut board) = running() else { return };
    let mut noise = 1_u32;
    let garbage: Vec<u8> = (0..60_000)
        .map(|_| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (noise >> 24) as u8
        })
        .collect();
    board.send_bytes(&garbage);
    // 60,000 bytes take 0.2 s.
    board.run_samples(4000).unwrap();
    board.send_bytes(&[0]);
    board.run_samples(200).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault, status.overruns, status.lost_samples), (ModeName::Running as u8, 0, 0, 0));
    assert!(status.bad_frames > 100, "{}", status.bad_frames);
    let chip = board.machine.chip();
    assert!(chip.rows.windows(2).all(|two| two[1].latch_cycle - two[0].latch_cycle == 8500));
}

/// Says hello and returns after how many microseconds the identity was there.
fn greet_us(board: &mut VirtualBoard) -> u64 {
    let before = board.machine.now();
    let answer = board.ask(&ToBoard::Hello).unwrap();
    assert!(matches!(answer, Heard::Identity { .. }), "{answer:?}");
    (board.machine.now() - before) / 170
}

/// A pulse on the line while the receiver waits for the next byte, which stands elsewhere in its ring each time.
#[test]
fn a_disturbed_line_costs_a_frame_and_no_more() {
    let Some(mut board) = running() else { return };
    let before = board.status().unwrap().bad_frames;
    for k in 0..100 {
        board.machine.chip().usart.disturb(k);
        board.run_samples(2).unwrap();
        // Ends the frame that the disturbed byte began.
        board.send_bytes(&[0]);
        board.run_samples(2).unwrap();
        // Hello, 13 bytes, and its answer, under 100: 0.4 ms of line.
        let waited = greet_us(&mut board);
        assert!(waited < 1000, "disturbance {k}: {waited} us");
    }
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Running as u8, 0));
    assert!(status.bad_frames >= before + 100, "{} disturbances were noticed", status.bad_frames - before);
}

/// More than the receiver's ring holds comes in while answers wait for the line, again and again. What is lost is lost: nothing that stood
/// in the ring before is carried out a second time.
#[test]
fn a_ring_that_ran_over_costs_what_was_in_it_and_no_more() {
    let Some(mut board) = running() else { return };
    board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    let before = board.status().unwrap().bad_frames;
    let mut sent = 0;
    for flood in 0..10 {
        // Every third is answered with its number.
        for k in 0..300 + 7 * flood {
            let request = if k % 3 == 0 { ToBoard::Reference { reference_m: 80e-6 } } else { ToBoard::KeepAlive };
            board.send(&request).unwrap();
            sent += u32::from(k % 3 == 0);
        }
        // 370 of them take 18 ms, and what was taken in less than 50 ms more to answer.
        board.run_samples(1600).unwrap();
        board.send_bytes(&[0]);
        board.run_samples(2).unwrap();
        // Up to two blocks of the stream, 1.7 ms each, may be before the answer.
        let waited = greet_us(&mut board);
        assert!(waited < 5000, "flood {flood}: {waited} us");
    }
    let done: Vec<u16> = board
        .unasked
        .iter()
        .filter_map(|heard| match heard {
            Heard::Done { sequence } => Some(*sequence),
            _ => None,
        })
        .collect();
    assert!(done.len() > 200 && (done.len() as u32) < sent, "{} of {sent} were carried out", done.len());
    assert!(done.windows(2).all(|two| two[0] < two[1]), "{done:?}");
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Running as u8, 0));
    assert!(status.bad_frames >= before + 10, "{} frames were lost", status.bad_frames - before);
}

#[test]
fn an_adc_that_is_late_by_one_deadline_is_counted_and_a_storm_is_a_fault() {
    let Some(mut board) = running() else { return };
    // One: the conversion ends 1,500 cycles late, the drive comes after its latch, the old one is held.
    board.machine.chip().adc[0].late_cycles = 1500;
    board.run_samples(1).unwrap();
    board.machine.chip().adc[0].late_cycles = 0;
    board.run_samples(300).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.overruns), (ModeName::Running as u8, 1));
    // A storm: three within 256 samples.
    board.machine.chip().adc[0].late_cycles = 1500;
    board.run_samples(3).unwrap();
    board.machine.chip().adc[0].late_cycles = 0;
    ends_safe(&mut board, FaultCode::Overrun, 0);
    assert!(board.status().unwrap().overruns >= 4);
}

/// Drives that go on being late hold the DAC where it is, whatever the ramp: ENABLE takes the amplifier off, and stays low until the fault is left.
#[test]
fn a_storm_that_does_not_end_takes_the_amplifier_off() {
    let Some(mut board) = running() else { return };
    board.machine.chip().adc[0].late_cycles = 1500;
    board.run_samples(40).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Fault as u8, FaultCode::Overrun.number()));
    {
        let chip = board.machine.chip();
        let last = *chip.rows.last().expect("samples");
        assert!(last.dac > MID + 100 && !last.is_enabled && !chip.gpio[1].level(5), "{last:?}");
        assert_eq!(chip.bench.drive_v(), 0.0);
    }
    assert!(board.ask(&ToBoard::ClearFault).is_err(), "the ramp has not ended");
    // It goes on where it stood, with the amplifier off.
    board.machine.chip().adc[0].late_cycles = 0;
    board.machine.chip().rows.clear();
    board.run_samples(SETTLED).unwrap();
    assert!(board.machine.chip().rows.iter().all(|row| !row.is_enabled));
    assert_eq!(board.machine.chip().output(), MID);
    board.run_samples(4000).unwrap();
    board.order(&ToBoard::ClearFault).unwrap();
    run(&mut board);
}

/// An open loop at 80 V whose sensor says 0, so that no drive trips anything.
fn open_loop() -> Option<VirtualBoard> {
    let mut board = board()?;
    board.machine.chip().bench.fed = Some(Box::new(|_| MID));
    board.order(&ToBoard::Drive { drive_v: 80.0 }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    board.run_samples(50).unwrap();
    let mut chip = board.machine.chip();
    assert_eq!(chip.rows.last().expect("samples").dac, support::calibration().dac_code(80.0).0);
    chip.rows.clear();
    drop(chip);
    Some(board)
}

/// Asks for another drive, at the far end, and runs until the DAC has begun to move: 160 V are eight slew limits.
fn begin_a_large_change(board: &mut VirtualBoard, drive_v: f32) {
    board.send(&ToBoard::Drive { drive_v }).unwrap();
    let from = board.machine.chip().output();
    for _ in 0..20 {
        board.run_samples(1).unwrap();
        if board.machine.chip().output().abs_diff(from) > 300 {
            return;
        }
    }
    panic!("the DAC does not move");
}

/// No two neighbours are more than the slew limit apart: 20 V are 399.9 codes.
fn assert_slew(board: &VirtualBoard) {
    for two in board.machine.chip().rows.windows(2) {
        assert!(two[0].dac.abs_diff(two[1].dac) <= 400, "{two:?}");
    }
}

/// The law had moved on when its drive came too late; the next one counts from what the DAC has.
#[test]
fn late_drives_hold_the_dac_and_the_next_is_one_slew_limit_away() {
    for late in 1..=3 {
        let Some(mut board) = open_loop() else { return };
        begin_a_large_change(&mut board, -80.0);
        board.machine.chip().adc[0].late_cycles = 1500;
        board.run_samples(late).unwrap();
        board.machine.chip().adc[0].late_cycles = 0;
        {
            let chip = board.machine.chip();
            let held = &chip.rows[chip.rows.len() - 1 - late as usize..];
            assert!(held.iter().all(|row| row.dac == held[0].dac), "{late}: {held:?}");
        }
        if late < 3 {
            board.run_samples(20).unwrap();
            assert_eq!(board.machine.chip().output(), support::calibration().dac_code(-80.0).0);
            let status = board.status().unwrap();
            assert_eq!((status.mode, status.overruns), (ModeName::Running as u8, late as u32));
        } else {
            // From 60 V the ramp takes no more than two samples longer than from 42 V; the third late drive is judged after its latch.
            ends_safe(&mut board, FaultCode::Overrun, 4);
        }
        assert_slew(&board);
    }
}

/// Around the deadline, cycle by cycle, the timer can't tell whether a drive was latched. Whichever it was, the next one counts from there.
#[test]
fn a_drive_at_the_very_latch_counts_if_it_got_out() {
    let Some(mut board) = open_loop() else { return };
    let mut drive_v = 80.0;
    let mut is_overrun = |late_cycles: u64| {
        let before = board.status().unwrap().overruns;
        drive_v = -drive_v;
        begin_a_large_change(&mut board, drive_v);
        board.machine.chip().adc[0].late_cycles = late_cycles;
        board.run_samples(1).unwrap();
        board.machine.chip().adc[0].late_cycles = 0;
        // An overrun fades within 256.
        board.run_samples(300).unwrap();
        assert_slew(&board);
        board.machine.chip().rows.clear();
        board.status().unwrap().overruns > before
    };
    let (mut early, mut late) = (0, 1500);
    assert!(!is_overrun(early) && is_overrun(late));
    while late - early > 1 {
        let middle = early.midpoint(late);
        *(if is_overrun(middle) { &mut late } else { &mut early }) = middle;
    }
    let overruns = (early - 20..late + 20).filter(|late_cycles| is_overrun(*late_cycles)).count();
    // An interrupt's entry takes some cycles more or less, depending on what it interrupts.
    assert!((10..=31).contains(&overruns), "{overruns} of 41");
}

#[test]
fn samples_that_were_overwritten_unread_are_a_fault() {
    let Some(mut board) = running() else { return };
    // Two and a half periods from a sample on, so that they end between two latches: the ADC goes on, nobody reads it.
    board.run_samples(1).unwrap();
    board.machine.stall(21_250);
    ends_safe(&mut board, FaultCode::AdcLate, 3);
    let status = board.status().unwrap();
    assert!(status.lost_samples >= 1 && status.overruns >= 1, "{status:?}");
}

#[test]
fn a_reference_that_is_no_number_is_a_fault_in_its_sample() {
    let Some(mut board) = running() else { return };
    // Nothing between the line and the law looks at it: the law does.
    board.order(&ToBoard::Reference { reference_m: f32::NAN }).unwrap();
    ends_safe(&mut board, FaultCode::NotANumber, 1);
}

#[test]
fn an_emergency_stop_is_seen_in_the_next_sample() {
    let Some(mut board) = running() else { return };
    board.machine.chip().set_stop_chain(false);
    ends_safe(&mut board, FaultCode::EmergencyStop, 1);
    board.order(&ToBoard::ClearFault).unwrap();
    // Armed with the chain open it trips at once.
    board.order(&ToBoard::Arm).unwrap();
    board.run_samples(2).unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::EmergencyStop.number());
}

#[test]
fn a_stop_ramps_down_and_the_amplifier_goes_off() {
    let Some(mut board) = running() else { return };
    board.order(&ToBoard::Stop).unwrap();
    board.run_samples(SETTLED + 2).unwrap();
    let chip = board.machine.chip();
    let last = chip.rows.last().expect("samples");
    assert!(last.dac == MID && !last.is_enabled, "{last:?}");
}

/// Every reset cause: what the board comes up with.
#[test]
fn after_each_reset_the_board_is_disarmed_and_says_why() {
    let causes = [
        (Reset::Watchdog, ResetCause::Watchdog, FaultCode::WatchdogReset.number()),
        (Reset::BrownOut, ResetCause::BrownOut, FaultCode::BrownOutReset.number()),
        (Reset::Pin, ResetCause::Pin, 0),
        (Reset::Software, ResetCause::Software, 0),
    ];
    for (reset, cause, fault) in causes {
        let Some(mut board) = running() else { return };
        board.machine.chip().request_reset(reset);
        // At once: the pin floats to mid-code by its divider, ENABLE is pulled low.
        board.run_cycles(1000).unwrap();
        {
            let chip = board.machine.chip();
            assert_eq!(chip.output(), MID);
            assert!(!chip.gpio[1].is_output(5) && !chip.gpio[1].level(5));
        }
        board.greet().unwrap();
        let status = board.status().unwrap();
        let mode = if fault == 0 { ModeName::Idle } else { ModeName::Fault };
        assert_eq!((status.reset, status.mode, status.fault), (cause, mode as u8, fault), "{reset:?}");
        board.run_samples(50).unwrap();
        assert!(!board.machine.chip().rows.last().expect("samples").is_enabled);
        if fault != 0 {
            stays_safe(&mut board);
            board.order(&ToBoard::ClearFault).unwrap();
        }
        run(&mut board);
    }
}

#[test]
fn power_on_is_no_brown_out() {
    let Some(mut board) = board() else { return };
    let status = board.status().unwrap();
    assert_eq!((status.reset, status.mode, status.fault), (ResetCause::PowerOn, ModeName::Idle as u8, 0));
}

#[test]
fn a_hung_image_is_reset_by_the_watchdog_and_comes_up_disarmed_in_fault() {
    let Some(mut board) = running() else { return };
    // The control interrupt never comes again, so the supervisor has nothing to feed the watchdog for.
    board.machine.hang();
    let before = board.machine.now();
    let limit = before + 40_000_000;
    let was_reset = board.machine.run(limit, |chip| !chip.resets.is_empty()).unwrap();
    assert!(was_reset);
    let waited = board.machine.now() - before;
    // 100 ms at the latest, and 3.2 ms less at most since it was last fed.
    assert!((16_000_000..=17_000_100).contains(&waited), "{waited}");
    // Meanwhile ENABLE stood still and the amplifier went off.
    assert!(!board.machine.chip().bench.is_amplifier_on());
    board.greet().unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.reset, status.fault), (ResetCause::Watchdog, FaultCode::WatchdogReset.number()));
    stays_safe(&mut board);
}

#[test]
fn a_board_that_samples_but_never_works_between_the_samples_is_reset_too() {
    let Some(mut board) = running() else { return };
    board.machine.hang_between();
    let limit = board.machine.now() + 40_000_000;
    assert!(board.machine.run(limit, |chip| !chip.resets.is_empty()).unwrap());
    // The loop itself went on until then: the last sample before the reset still drove.
    assert!(board.machine.chip().rows.iter().rev().take(10).any(|row| row.dac > MID + 400));
    board.greet().unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::WatchdogReset.number());
    stays_safe(&mut board);
}

#[test]
fn a_sample_that_finds_the_loops_state_held_keeps_the_drive_and_is_an_overrun() {
    let Some(mut board) = running() else { return };
    let gate = image("nucleo-g474re").unwrap().symbol("hysteron_loop").expect("the loop's memory");
    // As the work between the samples would leave it if it took a whole period: 1 is "held".
    let hold = |board: &mut VirtualBoard| {
        assert!(board.machine.set_word(gate, 1));
        board.run_samples(1).unwrap();
    };
    board.run_samples(10).unwrap();
    let before = *board.machine.chip().rows.last().expect("samples");
    hold(&mut board);
    let held = *board.machine.chip().rows.last().expect("samples");
    assert_eq!((held.dac, held.hold_cycle - before.hold_cycle), (before.dac, 8500));
    board.run_samples(300).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.overruns, status.lost_samples), (ModeName::Running as u8, 1, 0));
    // Three in a row are a fault, like three that are late.
    for _ in 0..3 {
        hold(&mut board);
    }
    ends_safe(&mut board, FaultCode::Overrun, 1);
}

#[test]
fn a_stack_that_overflows_meets_nothing_and_ends_in_the_watchdog() {
    let Some(mut board) = running() else { return };
    let image = image("nucleo-g474re").unwrap();
    // The stack lies below all data, at the start of memory: under it is no memory at all.
    let (end, start) = (image.symbol("_stack_end").unwrap(), image.symbol("_stack_start").unwrap());
    assert_eq!((end, board.machine.word(end - 4)), (0x2000_0000, None));
    assert!(image.symbol("__sdata").unwrap() >= start && image.symbol("__sbss").unwrap() >= start);
    // Room for half of what an interrupt stacks.
    board.machine.use_up_stack(end + 16).unwrap();
    let limit = board.machine.now() + 40_000_000;
    let before = board.machine.now();
    board.machine.run(before + 340_000, |_| false).unwrap();
    // After 2 ms: ENABLE stands still, the amplifier is off.
    assert!(!board.machine.chip().bench.is_amplifier_on());
    assert!(board.machine.run(limit, |chip| !chip.resets.is_empty()).unwrap());
    assert!(board.machine.now() - before < 17_100_000);
    board.greet().unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::WatchdogReset.number());
    stays_safe(&mut board);
}

#[test]
fn a_crystal_that_stops_is_a_clock_fault() {
    let Some(mut board) = running() else { return };
    board.machine.chip().stop_crystal();
    board.run_cycles(400_000).unwrap();
    board.greet().unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.reset, status.fault), (ResetCause::Software, FaultCode::Clock.number()));
    stays_safe(&mut board);
}

#[test]
fn a_crystal_that_never_starts_leaves_the_board_in_fault_on_its_inner_clock() {
    let Some(image) = image("nucleo-g474re") else { return };
    let mut board = VirtualBoard::new(&image, &bench(), 1700);
    // Before the first instruction: HSERDY is never set, and the ready flag has no time limit of its own.
    board.machine.chip().stop_crystal();
    board.greet().unwrap();
    let status = board.status().unwrap();
    let expected = (ResetCause::PowerOn, ModeName::Fault as u8, FaultCode::Clock.number());
    assert_eq!((status.reset, status.mode, status.fault), expected);
    stays_safe(&mut board);
    // 1 s, ten times the watchdog: it is fed, the board answers, the fault stands and ENABLE never moved.
    for _ in 0..10 {
        board.run_samples(2000).unwrap();
        assert_eq!(board.status().unwrap().fault, FaultCode::Clock.number());
    }
    let chip = board.machine.chip();
    assert!(chip.resets.is_empty() && !chip.gpio[1].level(5));
    assert!(chip.rows.iter().all(|row| row.dac == MID && !row.is_enabled));
}

#[test]
fn parameters_survive_a_reset_and_a_power_cut_at_any_word_leaves_a_whole_set() {
    let Some(mut board) = board() else { return };
    let saved = Parameters { kp_v_per_m: 4e5, ..Parameters::NUCLEO_PI1 };
    board.order(&ToBoard::SetParameters(saved)).unwrap();
    board.order(&ToBoard::SaveParameters).unwrap();
    // One page erased, sixteen double words written.
    assert_eq!(board.machine.chip().flash.works, 17);
    let other = Parameters { kp_v_per_m: 3e5, ..saved };
    let mut kept = saved;
    // Before the first of them, then in the middle of each and between each and the next; the last cut comes after all.
    let moments = std::iter::once(None).chain((0..17).flat_map(|work| [Some((work, true)), Some((work, false))]));
    for moment in moments {
        // With the last word in place the new set is whole.
        if moment == Some((16, false)) {
            kept = other;
        }
        save_and_cut(&mut board, other, moment, kept);
    }
}

/// Saves `set` and cuts the power before the first piece of work on the flash, in the middle of one (true) or after it: `kept` is in force then.
fn save_and_cut(board: &mut VirtualBoard, set: Parameters, moment: Option<(u32, bool)>, kept: Parameters) {
    board.order(&ToBoard::SetParameters(set)).unwrap();
    let before = board.machine.chip().flash.works;
    board.send(&ToBoard::SaveParameters).unwrap();
    let limit = board.machine.now() + 20_000_000;
    let is_reached = board.machine.run(limit, |chip| match moment {
        None => chip.usart.from_host.is_empty(),
        Some((work, is_during)) => chip.flash.works > before + work && (is_during || !chip.flash.is_busy()),
    });
    assert!(is_reached.unwrap(), "cut {moment:?}");
    assert_eq!(board.machine.chip().flash.works, before + moment.map_or(0, |(work, _)| work + 1), "cut {moment:?}");
    board.machine.chip().request_reset(Reset::Pin);
    board.run_cycles(1000).unwrap();
    board.greet().unwrap();
    assert_eq!(board.status().unwrap().fault, 0, "cut {moment:?}");
    let Heard::Parameters(found) = board.ask(&ToBoard::GetParameters).unwrap() else { panic!("no parameters") };
    assert_eq!(*found, kept, "cut {moment:?}");
}

/// ES0430: where a double word that the cut tore lies, the flash may tell wrongly. The board came back from the watchdog without end.
#[test]
fn a_torn_word_that_the_flash_takes_for_the_programs_is_one_of_the_store_too() {
    let Some(mut board) = board() else { return };
    let saved = Parameters { kp_v_per_m: 4e5, ..Parameters::NUCLEO_PI1 };
    board.order(&ToBoard::SetParameters(saved)).unwrap();
    board.order(&ToBoard::SaveParameters).unwrap();
    board.machine.chip().flash.is_eccr_spoilt = true;
    // In the erase, in the first double word and in the last one.
    for work in [0, 1, 16] {
        save_and_cut(&mut board, Parameters { kp_v_per_m: 3e5, ..saved }, Some((work, true)), saved);
    }
    assert!(board.machine.chip().resets.iter().all(|(_, why)| *why == Reset::Pin));
}

#[test]
fn a_broken_store_is_said_and_the_defaults_are_in_force() {
    let Some(image) = image("nucleo-g474re") else { return };
    let mut board = VirtualBoard::new(&image, &bench(), 1700);
    // Page 126 of the second bank: something that is no record.
    board.machine.chip().flash.plant(126 * 2048, [0x1234_5678, 0x9abc_def0]);
    board.greet().unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Fault as u8, FaultCode::ParameterStore.number()));
    assert_eq!(board.ask(&ToBoard::GetParameters).unwrap(), Heard::Parameters(Box::new(Parameters::NUCLEO_PI1)));
    board.order(&ToBoard::ClearFault).unwrap();
    run(&mut board);
    // However the board was reset: the numbers in force are not those of its bench, and only the fault tells.
    let causes = [(Reset::Watchdog, ResetCause::Watchdog), (Reset::BrownOut, ResetCause::BrownOut)];
    for (reset, cause) in causes {
        board.machine.chip().request_reset(reset);
        board.run_cycles(1000).unwrap();
        board.greet().unwrap();
        let status = board.status().unwrap();
        assert_eq!((status.reset, status.fault), (cause, FaultCode::ParameterStore.number()));
    }
}

/// A reset, after which the fault tells of the store and the defaults are in force.
fn refuses_what_is_stored(board: &mut VirtualBoard) {
    board.machine.chip().request_reset(Reset::Pin);
    board.run_cycles(1000).unwrap();
    board.greet().unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::ParameterStore.number());
    assert_eq!(board.ask(&ToBoard::GetParameters).unwrap(), Heard::Parameters(Box::new(Parameters::NUCLEO_PI1)));
}

/// Both images run on one chip, and what one saves may pass the other's check: its volts and metres would be wrong.
#[test]
fn a_set_that_another_board_saved_is_not_put_in_force() {
    let (Some(mut board), Some(mut other)) = (board(), external_board()) else { return };
    let theirs = Parameters { kp_v_per_m: 3e5, ..Parameters::NUCLEO_PI1 };
    assert!(theirs.check(&Converters::NUCLEO_G474RE).is_ok());
    other.order(&ToBoard::SetParameters(theirs)).unwrap();
    other.order(&ToBoard::SaveParameters).unwrap();
    let base = 126 * 2048;
    for at in (base..base + 128_u32).step_by(8) {
        let word = other.machine.chip().flash.peek(at);
        board.machine.chip().flash.plant(at, word);
    }
    refuses_what_is_stored(&mut board);
}

/// Of one bank nothing is read while it is written: the loop would stand still for 25 ms.
#[test]
fn a_flash_of_one_bank_is_not_written() {
    let Some(mut board) = board() else { return };
    board.machine.chip().flash.make_one_bank();
    let refused = board.order(&ToBoard::SaveParameters).unwrap_err().to_string();
    assert!(refused.contains("DBANK") && refused.contains("not saved"), "{refused}");
    assert_eq!(board.machine.chip().flash.works, 0);
}

#[test]
fn an_armed_board_whose_host_is_silent_disarms() {
    let Some(mut board) = board() else { return };
    board.order(&ToBoard::Arm).unwrap();
    // 0.25 s at 20 kHz, less the time of the order itself.
    board.run_samples(4900).unwrap();
    assert!(board.machine.chip().rows.last().expect("samples").is_enabled);
    board.run_samples(200).unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.mode, status.fault), (ModeName::Fault as u8, FaultCode::LinkLoss.number()));
    assert!(board.machine.chip().rows.iter().rev().take(50).all(|row| row.dac == MID && !row.is_enabled));
}

#[test]
fn a_nan_in_flash_is_not_put_in_force() {
    let Some(mut board) = board() else { return };
    board.order(&ToBoard::SaveParameters).unwrap();
    // The same record with a NaN as Kp and a CRC that fits: as an older firmware might have left it.
    let base = 126 * 2048;
    let mut record: Vec<u8> = Vec::new();
    for k in 0..16 {
        let word = board.machine.chip().flash.peek(base + 8 * k);
        record.extend(word.iter().flat_map(|half| half.to_le_bytes()));
    }
    record[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    let crc = wire::crc32(&record[..124]);
    record[124..].copy_from_slice(&crc.to_le_bytes());
    for (k, word) in record.chunks(8).enumerate() {
        let half = |at: usize| u32::from_le_bytes(word[at..at + 4].try_into().expect("four bytes"));
        board.machine.chip().flash.plant(base + 8 * k as u32, [half(0), half(4)]);
    }
    refuses_what_is_stored(&mut board);
}

#[test]
fn faults_over_the_bridge_latch_too() {
    let Some(mut board) = board() else { return };
    board.order(&ToBoard::Input(InputSource::Bridge)).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    let _ = board.ask(&ToBoard::BridgeSample { index: 0, displacement: 4095, monitor: MID }).unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::SensorRail.number());
}

/// A host of another version is told so, in words, and nothing of what it asks is done.
#[test]
fn another_version_is_refused_in_words() {
    let Some(mut board) = board() else { return };
    // Arm (message 2), as version 2 might write it, with a CRC that fits.
    let mut plain = vec![wire::VERSION + 1, 1, 1, 2];
    plain.extend(wire::crc32(&plain).to_le_bytes());
    // COBS by hand: each run of bytes up to a 0 with its length before it.
    let mut line = Vec::new();
    for run in plain.split(|byte| *byte == 0) {
        line.push(run.len() as u8 + 1);
        line.extend(run);
    }
    line.push(0);
    board.send_bytes(&line);
    board.run_samples(100).unwrap();
    let told = board.unasked.iter().find_map(|heard| match heard {
        Heard::Refused { sequence: 0, reason } => Some(reason.clone()),
        _ => None,
    });
    let told = told.expect("an answer");
    assert!(told.contains("speaks version 2, this one version 1: flash the firmware"), "{told}");
    assert_eq!(board.status().unwrap().mode, ModeName::Idle as u8);
}
