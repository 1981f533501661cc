//! Who can't be worked with, and in which words; what a session makes of a line that says strange things.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::session::{Session, SessionError};
use std::time::Duration;
use wire::{Converters, Identity, MAX_ENCODED_BYTES, Receiver, Sender, ToBoard, ToHost};

/// Answers every frame with the same bytes.
struct Canned(Vec<u8>, Vec<u8>);

impl Link for Canned {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        if bytes.len() > 1 {
            self.1.extend(&self.0);
        }
        Ok(())
    }

    fn receive(&mut self, _: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        into.append(&mut self.1);
        Ok(())
    }

    fn now(&mut self) -> Duration {
        Duration::ZERO
    }

    fn patience(&self) -> Duration {
        Duration::ZERO
    }
}

fn greet(bytes: Vec<u8>) -> Result<hil_bridge::session::Board, SessionError> {
    Session::new(Canned(bytes, Vec::new())).greet()
}

fn frame(message: &ToHost<'_>) -> Vec<u8> {
    let mut bytes = [0; MAX_ENCODED_BYTES];
    let n = Sender::default().encode(message, &mut bytes).unwrap();
    bytes[..n].to_vec()
}

fn identity(version: u8, firmware: &str, converters: Converters) -> Vec<u8> {
    let identity = Identity {
        version,
        board: "some-board",
        firmware,
        converters,
        reference_step_m: 1e-9,
        table_samples: 4096,
        segments: 16,
        capture_samples: 0,
    };
    frame(&ToHost::Identity(identity))
}

#[test]
fn this_release_is_taken() {
    let firmware = format!("{} 1234abc", env!("CARGO_PKG_VERSION"));
    let board = greet(identity(wire::VERSION, &firmware, Converters::NUCLEO_G474RE)).unwrap();
    assert_eq!((board.board.as_str(), board.firmware), ("some-board", firmware));
}

#[test]
fn another_firmware_is_refused_and_both_are_named() {
    let error = greet(identity(wire::VERSION, "0.0.9 1234abc", Converters::NUCLEO_G474RE)).unwrap_err().to_string();
    assert!(error.contains("0.0.9 1234abc") && error.contains(env!("CARGO_PKG_VERSION")), "{error}");
    assert!(error.contains("flash"), "{error}");
}

#[test]
fn another_version_of_the_messages_is_refused_whether_said_or_shown() {
    let said = greet(identity(wire::VERSION + 1, "0.1.0 x", Converters::NUCLEO_G474RE)).unwrap_err();
    assert!(matches!(said, SessionError::Mismatch(_)), "{said}");
    // A frame of that version: its first byte, and a CRC that fits.
    let mut plain = vec![wire::VERSION + 1, 0, 0, 99];
    plain.extend(wire::crc32(&plain).to_le_bytes());
    let mut bytes = vec![0];
    // COBS, by its definition: each run without a 0 is led by its length and one.
    for run in plain.split(|byte| *byte == 0) {
        bytes.push(run.len() as u8 + 1);
        bytes.extend(run);
    }
    bytes.push(0);
    let shown = greet(bytes).unwrap_err().to_string();
    let (theirs, ours) = (format!("version {}", wire::VERSION + 1), format!("version {}", wire::VERSION));
    assert!(shown.contains(&theirs) && shown.contains(&ours) && shown.contains("flash"), "{shown}");
}

#[test]
fn a_board_whose_timing_cannot_be_is_refused() {
    let converters = Converters { latch_cycles: 5000, ..Converters::NUCLEO_G474RE };
    let firmware = format!("{} x", env!("CARGO_PKG_VERSION"));
    assert!(matches!(greet(identity(wire::VERSION, &firmware, converters)), Err(SessionError::Mismatch(_))));
}

#[test]
fn silence_and_noise_are_silence() {
    for bytes in [vec![], vec![1, 2, 3], vec![7; 2000], frame(&ToHost::Done { sequence: 777 })] {
        let error = greet(bytes).unwrap_err();
        assert!(matches!(error, SessionError::Silent { .. }), "{error}");
        assert!(error.to_string().contains("baud"), "{error}");
    }
}

#[test]
fn a_half_frame_of_somebody_before_costs_nothing() {
    let mut board = InProcess::nucleo();
    board.send(&[9, 9, 9]).unwrap();
    let mut session = Session::new(board);
    session.greet().unwrap();
    assert_eq!((session.statistics().lost, session.link().bad_frames()), (0, 1));
}

#[test]
fn what_a_board_refuses_is_said_with_its_reason() {
    let mut session = Session::new(InProcess::nucleo());
    session.greet().unwrap();
    for (request, word) in [(ToBoard::Run, "idle"), (ToBoard::SaveParameters, "flash")] {
        let error = session.order(&request).unwrap_err().to_string();
        assert!(error.contains(word) && error.starts_with("the board refuses"), "{error}");
    }
    assert!(session.exchange(2048, 2048).unwrap_err().to_string().contains("BridgeSample"));
    assert_eq!(session.statistics().answered, session.statistics().requests);
}

#[test]
fn a_board_in_process_says_its_version_to_a_host_of_another() {
    let mut board = InProcess::nucleo();
    let mut plain = vec![wire::VERSION + 1, 9, 9, 99];
    plain.extend(wire::crc32(&plain).to_le_bytes());
    assert!(!plain.contains(&0));
    let mut bytes = vec![plain.len() as u8 + 1];
    bytes.extend(&plain);
    bytes.push(0);
    board.send(&bytes).unwrap();
    let mut answer = Vec::new();
    board.receive(Duration::ZERO, &mut answer).unwrap();
    let mut receiver = Receiver::new();
    let mut reasons = Vec::new();
    for byte in answer {
        if let Some(frame) = receiver.push(byte) {
            let ToHost::Refused { sequence: 0, reason } = frame.unwrap().message().unwrap() else { panic!("no") };
            reasons.push(reason.to_owned());
        }
    }
    assert_eq!(reasons.len(), 1);
    assert!(reasons[0].contains("version 2"), "{reasons:?}");
}
