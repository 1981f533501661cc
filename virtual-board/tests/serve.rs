//! The line in the open: a host on TCP or on a pseudo-terminal, and time that passes only while it is answered.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::ModeName;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use support::{bench, image};
use virtual_board::serve::{Line, Pace, TcpLine, serve};
use virtual_board::{Heard, VirtualBoard};
use wire::{Converters, InputSource, MAX_ENCODED_BYTES, Parameters, Receiver, Sender, ToBoard, ToHost};

/// A host that knows only the line: sends, and reads until it is answered. Keeps all bytes that came.
struct Host<S> {
    line: S,
    sender: Sender,
    receiver: Receiver,
    bytes: Vec<u8>,
}

impl<S: Read + Write> Host<S> {
    fn new(line: S) -> Host<S> {
        Host { line, sender: Sender::default(), receiver: Receiver::new(), bytes: Vec::new() }
    }

    fn ask(&mut self, request: &ToBoard<'_>) -> Heard {
        let mut frame = [0; MAX_ENCODED_BYTES];
        let n = self.sender.encode(request, &mut frame).unwrap();
        // In pieces, which must not matter.
        for piece in frame[..n].chunks(5) {
            self.line.write_all(piece).unwrap();
        }
        loop {
            let mut byte = [0];
            self.line.read_exact(&mut byte).unwrap();
            self.bytes.push(byte[0]);
            if let Some(Ok(frame)) = self.receiver.push(byte[0]) {
                return frame.message::<ToHost<'_>>().unwrap().into();
            }
        }
    }
}

/// Lets `host` talk to a board behind `line`; what it returns, and the cycle that the board stands at then.
fn with_board<T>(line: &mut dyn Line, pace: Pace, host: impl FnOnce() -> T + Send) -> Option<(T, u64)>
where
    T: Send,
{
    let mut board = VirtualBoard::new(&image("nucleo-g474re")?, &bench(), 1700);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let host = scope.spawn(|| {
            let result = host();
            is_over.store(true, Ordering::Relaxed);
            result
        });
        serve(&mut board.machine, line, pace, |_| is_over.load(Ordering::Relaxed) || host.is_finished()).unwrap();
        Some((host.join().unwrap(), board.machine.now()))
    })
}

fn handshake<S: Read + Write>(host: &mut Host<S>) {
    let Heard::Identity { board, converters, .. } = host.ask(&ToBoard::Hello) else { panic!("no identity") };
    assert_eq!((board.as_str(), converters), ("nucleo-g474re", Converters::NUCLEO_G474RE));
    assert_eq!(host.ask(&ToBoard::GetParameters), Heard::Parameters(Box::new(Parameters::NUCLEO_PI1)));
}

/// A loop over the bridge, 50 samples; the last drive.
fn bridge<S: Read + Write>(host: &mut Host<S>) -> u16 {
    handshake(host);
    // Garbage is not answered, and what follows is.
    host.line.write_all(&[7, 7, 7, 0, 0]).unwrap();
    let orders =
        [ToBoard::Input(InputSource::Bridge), ToBoard::Reference { reference_m: 40e-6 }, ToBoard::Arm, ToBoard::Run];
    for order in orders {
        assert!(matches!(host.ask(&order), Heard::Done { .. }));
    }
    let mut last = 2048;
    for index in 0..50 {
        let heard = host.ask(&ToBoard::BridgeSample { index, displacement: 2048, monitor: last });
        let Heard::BridgeDrive { drive, mode, .. } = heard else { panic!("{heard:?}") };
        assert_eq!(mode, ModeName::Running as u8);
        last = drive;
    }
    last
}

#[test]
fn over_tcp_in_lockstep_the_same_requests_give_the_same_bytes_at_the_same_cycle() {
    let run = || {
        let mut line = TcpLine::open("127.0.0.1:0").unwrap();
        let address = line.address().unwrap();
        with_board(&mut line, Pace::Lockstep, || {
            let mut host = Host::new(TcpStream::connect(address).unwrap());
            let drive = bridge(&mut host);
            // Held at 0 with 40 um wanted, the integral drives up.
            assert!(drive > 2048 + 400, "{drive}");
            host.bytes
        })
    };
    let Some((bytes, cycle)) = run() else { return };
    assert_eq!(run(), Some((bytes, cycle)));
}

#[test]
fn a_host_that_goes_leaves_the_board_to_the_next() {
    let mut line = TcpLine::open("127.0.0.1:0").unwrap();
    let address = line.address().unwrap();
    let talk = || {
        let mut first = Host::new(TcpStream::connect(address).unwrap());
        handshake(&mut first);
        assert!(matches!(first.ask(&ToBoard::Arm), Heard::Done { .. }));
        drop(first);
        let mut second = Host::new(TcpStream::connect(address).unwrap());
        let Heard::Status(status) = second.ask(&ToBoard::KeepAlive) else { panic!("no status") };
        assert_eq!(status.mode, ModeName::Armed as u8);
    };
    if with_board(&mut line, Pace::Real, talk).is_none() {
        println!("not run: no image");
    }
}

#[cfg(unix)]
#[test]
fn a_pseudo_terminal_is_a_serial_port() {
    let mut line = virtual_board::serve::PtyLine::open().unwrap();
    let path = line.path().to_owned();
    let talk = || {
        let port = std::fs::OpenOptions::new().read(true).write(true).open(&path).unwrap();
        bridge(&mut Host::new(port))
    };
    let Some((drive, _)) = with_board(&mut line, Pace::Lockstep, talk) else { return };
    assert!(drive > 2048 + 400, "{drive}");
}
