//! A long run of the image: every sample is there, on time, and the law's. Ten million samples in `cargo xtask long board-1e7`.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{AdcCode, Command, Controller, Generator, Input, Law, ModeName, Segment};
use support::{PERIOD, board, calibration};
use virtual_board::{Heard, Row};
use wire::{Parameters, SegmentRecord, StreamReason, ToBoard, Wave};

/// A sine whose period is no whole number of samples, so that the codes do not repeat.
const FREQUENCY_HZ: f32 = 97.3;

#[test]
fn no_sample_is_lost_none_is_late_and_each_is_the_laws() {
    let Some(mut board) = board() else { return };
    let wanted = std::env::var("HYSTERON_BOARD_SAMPLES").ok().map_or(40_000, |text| text.parse().unwrap());
    board.order(&ToBoard::WaveClear).unwrap();
    let wave = Wave::Sine { amplitude: 80e-6, frequency_hz: FREQUENCY_HZ };
    board.order(&ToBoard::WaveSegment(SegmentRecord { wave, samples: u32::MAX })).unwrap();
    board.order(&ToBoard::WaveUse { is_closed_loop: true }).unwrap();
    let started = board.ask(&ToBoard::StreamStart { every: 1 }).unwrap();
    assert_eq!(started, Heard::StreamStarted { every: 1, reason: StreamReason::AsAsked });
    board.order(&ToBoard::Arm).unwrap();
    board.order(&ToBoard::Run).unwrap();
    board.run_samples(20).unwrap();

    // The host's law, from the sample on that explains the first moves.
    let segments = [Segment::sine(20e3, 80e-6, FREQUENCY_HZ, u32::MAX).unwrap()];
    let command = Command::GeneratedReference(Generator::new(&segments));
    let law = Law::try_build(&Parameters::NUCLEO_PI1.settings()).unwrap();
    let calibration = calibration();
    let agrees = |controller: &mut Controller, row: &Row| {
        let measured_m = calibration.displacement_m(AdcCode(row.adc));
        calibration.dac_code(controller.tick(&Input { command, measured_m }).drive_v).0 == row.dac
    };
    let rows = std::mem::take(&mut board.machine.chip().rows);
    let moved = rows.iter().position(|row| row.dac != 2048).expect("the loop moved");
    let follow = |begin: usize| {
        let mut controller = Controller::new(law);
        controller.arm().unwrap();
        controller.run().unwrap();
        rows[begin..].iter().all(|row| agrees(&mut controller, row)).then_some(controller)
    };
    let mut controller = (moved.saturating_sub(8)..=moved).find_map(follow).expect("the image's codes are the law's");

    let mut last_hold = rows.last().unwrap().hold_cycle;
    let mut compared = (rows.len() - moved) as u64;
    let mut next_streamed = None;
    while compared < wanted {
        board.run_samples(2000).unwrap();
        let rows = std::mem::take(&mut board.machine.chip().rows);
        for row in &rows {
            assert_eq!((row.hold_cycle - last_hold, row.latch_cycle - row.hold_cycle), (PERIOD, 1700), "{row:?}");
            assert!(row.is_enabled && agrees(&mut controller, row), "after {compared} samples: {row:?}");
            last_hold = row.hold_cycle;
            compared += 1;
        }
        for heard in board.unasked.drain(..) {
            let Heard::StreamBlock { first, every: 1, lost: 0, samples } = heard else { panic!("{heard:?}") };
            assert!(next_streamed.is_none_or(|next| next == first), "a gap before {first}");
            next_streamed = Some(first + samples.len() as u32);
        }
        let status = board.status().unwrap();
        assert_eq!((status.overruns, status.lost_samples, status.fault, status.bad_frames), (0, 0, 0, 0));
        assert_eq!(status.mode, ModeName::Running as u8);
    }
    assert_eq!(board.bad_frames, 0);
    println!("{compared} samples, {:?}", board.machine.cost());
}
