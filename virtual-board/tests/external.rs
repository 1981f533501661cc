//! The image for external 16-bit converters: the same law behind another pair of converters, which is what the board file is for.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{AdcCode, Command, Controller, FaultCode, Generator, Input, Law, ModeName, Segment};
use support::external_board;
use virtual_board::chip::external::External;
use virtual_board::{Heard, VirtualBoard, Wire};
use wire::{Converters, Parameters, ResetCause, SegmentRecord, ToBoard, Wave};

const MID: u16 = 1 << 15;

fn start(board: &mut VirtualBoard) {
    board.order(&ToBoard::WaveClear).unwrap();
    let wave = Wave::Sine { amplitude: 80e-6, frequency_hz: 50.0 };
    board.order(&ToBoard::WaveSegment(SegmentRecord { wave, samples: u32::MAX })).unwrap();
    board.order(&ToBoard::WaveUse { is_closed_loop: true }).unwrap();
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
}

#[test]
fn the_seam_holds_sixteen_bits_the_same_law_and_the_same_latch() {
    let Some(mut board) = external_board() else { return };
    let Heard::Identity { board: name, converters, .. } = board.ask(&ToBoard::Hello).unwrap() else { panic!() };
    assert_eq!((name.as_str(), converters), ("external-16bit", Converters::EXTERNAL_16BIT));
    start(&mut board);
    for _ in 0..10 {
        board.run_samples(2000).unwrap();
        board.status().unwrap();
    }
    let status = board.status().unwrap();
    assert_eq!((status.fault, status.overruns, status.mode), (0, 0, ModeName::Running as u8));
    assert_eq!(board.machine.cost().from_flash, 0);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    assert!(rows.windows(2).all(|two| two[1].hold_cycle - two[0].hold_cycle == 8500));
    assert!(rows.iter().all(|row| row.latch_cycle - row.hold_cycle == 1700));
    // Bit for bit: the law on the host with the codes that this ADC delivered.
    let parameters = Parameters::EXTERNAL_PI1;
    let calibration = parameters.check(&Converters::EXTERNAL_16BIT).unwrap().calibration;
    let law = Law::try_build(&parameters.settings()).unwrap();
    let segments = [Segment::sine(20e3, 80e-6, 50.0, u32::MAX).unwrap()];
    let generator = Generator::new(&segments);
    let moved = rows.iter().position(|row| row.dac != MID).unwrap();
    let agrees = |begin: usize| {
        let mut controller = Controller::new(law);
        controller.arm().unwrap();
        controller.run().unwrap();
        rows[begin..].iter().all(|row| {
            let measured_m = calibration.displacement_m(AdcCode(row.adc));
            let input = Input { command: Command::GeneratedReference(generator), measured_m };
            calibration.dac_code(controller.tick(&input).drive_v).0 == row.dac
        })
    };
    assert!((moved - 4..=moved).any(agrees));
    assert!(rows.len() - moved > 19_990);
    // The loop's ripple at 12 bits is codes of 63 nm; here the error from sample to sample is below a tenth of that.
    let step_m = calibration.displacement_m_per_code();
    assert!((step_m - 3.97e-9).abs() < 0.01e-9, "{step_m}");
    assert!(rows.iter().any(|row| row.adc % 16 != 0) && rows.iter().any(|row| row.dac % 16 != 0));
}

/// The core stands still until a latch is over, in the middle of a large change of an open-loop drive: the code that came too late is taken
/// back, and the next one is a slew limit away from what the DAC has.
#[test]
fn late_drives_hold_this_dac_too() {
    for late in 1..=2 {
        let Some(mut board) = external_board() else { return };
        board.machine.chip().bench.fed = Some(Box::new(|_| MID));
        board.order(&ToBoard::Drive { drive_v: 80.0 }).unwrap();
        board.order(&ToBoard::Arm).unwrap();
        board.order(&ToBoard::Run).unwrap();
        board.run_samples(50).unwrap();
        board.machine.chip().rows.clear();
        let from = board.machine.chip().output();
        board.send(&ToBoard::Drive { drive_v: -80.0 }).unwrap();
        while board.machine.chip().output().abs_diff(from) < 1000 {
            board.run_samples(1).unwrap();
        }
        for _ in 0..late {
            // The sample before is through 2000 cycles after its latch, late or not; up to the next one.
            board.run_cycles(2000).unwrap();
            board.machine.stall(6500);
        }
        let parameters = Parameters::EXTERNAL_PI1;
        let calibration = parameters.check(&Converters::EXTERNAL_16BIT).unwrap().calibration;
        let chip = board.machine.chip();
        let held = &chip.rows[chip.rows.len() - 1 - late..];
        assert!(held.iter().all(|row| row.dac == held[0].dac), "{late}: {held:?}");
        drop(chip);
        board.run_samples(20).unwrap();
        assert_eq!(board.machine.chip().output(), calibration.dac_code(-80.0).0);
        let status = board.status().unwrap();
        assert_eq!((status.mode, status.overruns), (ModeName::Running as u8, late as u32));
        let slew_codes = parameters.slew_v_per_s / parameters.rate_hz / calibration.drive_v_per_code().abs();
        for two in board.machine.chip().rows.windows(2) {
            assert!(f32::from(two[0].dac.abs_diff(two[1].dac)) <= slew_codes.ceil(), "{two:?}");
        }
    }
}

#[test]
fn its_faults_end_in_the_safe_state_too() {
    for (wire, code) in [(Wire::Open, FaultCode::SensorRail), (Wire::Shorted, FaultCode::SensorRail)] {
        let Some(mut board) = external_board() else { return };
        start(&mut board);
        board.run_samples(1000).unwrap();
        board.machine.chip().bench.wire = wire;
        board.run_samples(40).unwrap();
        assert_eq!(board.status().unwrap().fault, code.number());
        let last = *board.machine.chip().rows.last().unwrap();
        assert!(last.dac == MID && !last.is_enabled, "{last:?}");
    }
    // A hung image: the watchdog, then disarmed.
    let Some(mut board) = external_board() else { return };
    start(&mut board);
    board.run_samples(1000).unwrap();
    board.machine.hang();
    let limit = board.machine.now() + 20_000_000;
    assert!(board.machine.run(limit, |chip| !chip.resets.is_empty()).unwrap());
    assert!(!board.machine.chip().bench.is_amplifier_on());
    board.greet().unwrap();
    assert_eq!(board.status().unwrap().fault, FaultCode::WatchdogReset.number());
}

/// The crystal stops while a word is on its way to the DAC: the board's own reset waits until that is through and mid-code is, too.
#[test]
fn a_reset_by_the_board_itself_tears_no_word() {
    let Some(mut board) = external_board() else { return };
    start(&mut board);
    board.run_samples(500).unwrap();
    let limit = board.machine.now() + 20_000;
    let is_under_way =
        board.machine.run(limit, |chip| chip.external().is_some_and(|external| external.spi3.event().is_some()));
    assert!(is_under_way.unwrap());
    board.machine.chip().stop_crystal();
    let limit = board.machine.now() + 20_000;
    assert!(board.machine.run(limit, |chip| !chip.resets.is_empty()).unwrap());
    assert_eq!(board.machine.chip().external().map(External::input), Some(MID));
    board.greet().unwrap();
    let status = board.status().unwrap();
    assert_eq!((status.reset, status.fault), (ResetCause::Software, FaultCode::Clock.number()));
    board.run_samples(200).unwrap();
    let last = *board.machine.chip().rows.last().unwrap();
    assert!(last.dac == MID && !last.is_enabled, "{last:?}");
}
