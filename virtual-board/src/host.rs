//! A host at the other end of the board's line, in process: sends requests, waits for their answers, keeps what comes by itself.

use crate::bench::{Bench, BenchSettings};
use crate::chip::Chip;
use crate::image::Image;
use crate::log::Log;
use crate::machine::{Machine, MachineError};
use control_core::SettingsError;
use wire::{
    Converters, MAX_ENCODED_BYTES, Mismatch, Parameters, Receiver, Sample, Sender, Status, StreamReason, ToBoard,
    ToHost, WireError,
};

/// Longest wait for an answer, in cycles: 50 ms, twice what saving parameters takes.
const PATIENCE_CYCLES: u64 = 8_500_000;

/// Why a conversation failed.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum BoardError {
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error("{0}")]
    Wire(#[from] WireError),
    #[error("{0}")]
    Mismatch(#[from] Mismatch),
    #[error("the board refuses: {0}")]
    Refused(String),
    #[error("the board did not answer {request} within 50 ms")]
    Silent { request: String },
    #[error("the board answered {request} with something else: {answer}")]
    Strange { request: String, answer: String },
    #[error("calibration: {0}")]
    Calibration(#[from] SettingsError),
}

/// What a board says, with what it borrowed copied.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "wire::ToHost describes them")]
pub enum Heard {
    Identity { board: String, firmware: String, converters: Converters, reference_step_m: f32 },
    Done { sequence: u16 },
    Refused { sequence: u16, reason: String },
    Parameters(Box<Parameters>),
    Status(Status),
    BridgeDrive { index: u32, drive: u16, drive_v: f32, reference_m: f32, limited_by: u8, mode: u8 },
    StreamStarted { every: u16, reason: StreamReason },
    StreamBlock { first: u32, every: u16, lost: u32, samples: Vec<Sample> },
    CaptureBlock { from: u16, total: u16, first: u32, samples: Vec<Sample> },
    Fault { code: u8, sample: u32 },
}

impl From<ToHost<'_>> for Heard {
    fn from(message: ToHost<'_>) -> Heard {
        match message {
            ToHost::Identity(identity) => Heard::Identity {
                board: identity.board.to_owned(),
                firmware: identity.firmware.to_owned(),
                converters: identity.converters,
                reference_step_m: identity.reference_step_m,
            },
            ToHost::Done { sequence } => Heard::Done { sequence },
            ToHost::Refused { sequence, reason } => Heard::Refused { sequence, reason: reason.to_owned() },
            ToHost::Parameters(parameters) => Heard::Parameters(Box::new(parameters)),
            ToHost::Status(status) => Heard::Status(status),
            ToHost::BridgeDrive { index, drive, drive_v, reference_m, limited_by, mode } => {
                Heard::BridgeDrive { index, drive, drive_v, reference_m, limited_by, mode }
            }
            ToHost::StreamStarted { every, reason } => Heard::StreamStarted { every, reason },
            ToHost::StreamBlock { first, every, lost, samples } => {
                Heard::StreamBlock { first, every, lost, samples: Sample::all(samples).collect() }
            }
            ToHost::CaptureBlock { from, total, first, samples } => {
                Heard::CaptureBlock { from, total, first, samples: Sample::all(samples).collect() }
            }
            ToHost::Fault { code, sample } => Heard::Fault { code, sample },
        }
    }
}

/// A board with its image, and a host on its line.
#[derive(Debug)]
pub struct VirtualBoard {
    /// Core and chip.
    pub machine: Machine,
    sender: Sender,
    receiver: Receiver,
    /// What came by itself: stream blocks and faults, in order.
    pub unasked: Vec<Heard>,
    /// Frames that were none.
    pub bad_frames: u32,
    log: Log,
}

impl VirtualBoard {
    /// An image on a board whose plant is stepped by `step_cycles` ([`Bench::new`]), at reset.
    pub fn new(image: &Image, settings: &BenchSettings, step_cycles: u64) -> VirtualBoard {
        VirtualBoard {
            machine: Machine::new(image, Chip::new(Bench::new(settings, step_cycles))),
            sender: Sender::default(),
            receiver: Receiver::new(),
            unasked: Vec::new(),
            bad_frames: 0,
            log: Log::new(image.symbols()),
        }
    }

    /// Runs `samples` more samples, taking in what the board says.
    ///
    /// # Errors
    /// [`BoardError::Machine`].
    pub fn run_samples(&mut self, samples: u64) -> Result<(), BoardError> {
        let until = self.machine.chip().samples + samples;
        // 65,536 cycles is the longest period there is.
        let limit = self.machine.now() + (samples + 2) * 65_536;
        while self.machine.chip().samples < until {
            // In parts, so that what is heard does not pile up.
            let part = until.min(self.machine.chip().samples + 1000);
            if !self.machine.run(limit, |chip| chip.samples >= part)? {
                return Err(MachineError::TooLong { cycles: limit }.into());
            }
            let heard = self.listen();
            self.unasked.extend(heard);
        }
        Ok(())
    }

    /// Runs for `cycles`.
    ///
    /// # Errors
    /// [`BoardError::Machine`].
    pub fn run_cycles(&mut self, cycles: u64) -> Result<(), BoardError> {
        let limit = self.machine.now() + cycles;
        self.machine.run(limit, |_| false)?;
        let heard = self.listen();
        self.unasked.extend(heard);
        Ok(())
    }

    /// What the image has logged since the last time, one line each.
    pub fn logged(&mut self) -> Vec<String> {
        self.log.take(&self.machine)
    }

    /// What has come over the line since the last time.
    fn listen(&mut self) -> Vec<Heard> {
        let bytes = std::mem::take(&mut self.machine.chip().usart.to_host);
        let mut heard = Vec::new();
        for byte in bytes {
            match self.receiver.push(byte).map(|frame| frame.and_then(|frame| frame.message::<ToHost<'_>>())) {
                Some(Ok(message)) => heard.push(message.into()),
                Some(Err(_)) => self.bad_frames += 1,
                None => {}
            }
        }
        heard
    }

    /// Puts raw bytes on the line.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.machine.chip().usart.from_host.extend(bytes);
    }

    /// Sends a request without waiting; returns its number.
    ///
    /// # Errors
    /// [`BoardError::Wire`].
    pub fn send(&mut self, request: &ToBoard<'_>) -> Result<u16, BoardError> {
        let mut bytes = [0; MAX_ENCODED_BYTES];
        let sequence = self.sender.next_sequence();
        let n = self.sender.encode(request, &mut bytes)?;
        self.send_bytes(&bytes[..n]);
        Ok(sequence)
    }

    /// Sends a request and runs the board until it answers.
    ///
    /// # Errors
    /// [`BoardError`]; a refusal is [`BoardError::Refused`].
    pub fn ask(&mut self, request: &ToBoard<'_>) -> Result<Heard, BoardError> {
        let asked = self.send(request)?;
        let limit = self.machine.now() + PATIENCE_CYCLES;
        loop {
            // A frame ends in 0, and only those are worth a look.
            let is_frame = self.machine.run(limit, |chip| chip.usart.to_host.contains(&0))?;
            if !is_frame {
                return Err(BoardError::Silent { request: format!("{request:?}") });
            }
            let mut answer = None;
            for heard in self.listen() {
                match heard {
                    Heard::StreamBlock { .. } | Heard::Fault { .. } => self.unasked.push(heard),
                    Heard::Refused { sequence, reason } if sequence == asked => {
                        return Err(BoardError::Refused(reason));
                    }
                    other => answer = Some(other),
                }
            }
            if let Some(answer) = answer {
                return Ok(answer);
            }
        }
    }

    /// As [`VirtualBoard::ask`], for a request that is answered by [`Heard::Done`].
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn order(&mut self, request: &ToBoard<'_>) -> Result<(), BoardError> {
        let expected = self.sender.next_sequence();
        match self.ask(request)? {
            Heard::Done { sequence } if sequence == expected => Ok(()),
            answer => Err(strange(request, &answer)),
        }
    }

    /// The handshake, at the board's start.
    ///
    /// # Errors
    /// [`BoardError`]; a mismatch is said in words.
    pub fn greet(&mut self) -> Result<Heard, BoardError> {
        // What is sent before the port is open is lost on a real line, so wait for the first samples.
        let samples = self.machine.chip().samples;
        let limit = self.machine.now() + 4 * PATIENCE_CYCLES;
        self.machine.run(limit, |chip| chip.samples >= samples + 2)?;
        let answer = self.ask(&ToBoard::Hello)?;
        match answer {
            Heard::Identity { .. } => Ok(answer),
            other => Err(strange(&ToBoard::Hello, &other)),
        }
    }

    /// The board's own account of itself.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn status(&mut self) -> Result<Status, BoardError> {
        match self.ask(&ToBoard::KeepAlive)? {
            Heard::Status(status) => Ok(status),
            other => Err(strange(&ToBoard::KeepAlive, &other)),
        }
    }
}

fn strange(request: &ToBoard<'_>, answer: &Heard) -> BoardError {
    BoardError::Strange { request: format!("{request:?}"), answer: format!("{answer:?}") }
}
