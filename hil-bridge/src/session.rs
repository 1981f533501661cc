//! A conversation with a board: requests, their answers, and what is made of the rest. It opens no port and reads no clock.
//!
//! A request has one answer, which names it. What comes after its request was given up is dropped and counted; a sample is never sent twice,
//! because a board that heard it the first time would step its law twice.

use crate::link::{Link, LinkError};
use crate::statistics::Statistics;
use control_core::{Limits, ModeName};
use std::collections::VecDeque;
use std::time::Duration;
use virtual_board::Heard;
use wire::{
    Converters, Identity, MAX_ENCODED_BYTES, Mismatch, Parameters, Receiver, Sample, Sender, Status, ToBoard, ToHost,
    WireError,
};

/// Version of this program, which the firmware's must be.
const OURS: &str = env!("CARGO_PKG_VERSION");
/// How often a request that changes nothing is sent before the board counts as silent.
const ATTEMPTS: u32 = 5;
/// Requests lost in a row until the board counts as gone: at a serial port's patience of 100 ms, two seconds.
const GONE: u64 = 20;

/// Why a conversation can't go on.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum SessionError {
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("{0}")]
    Wire(#[from] WireError),
    #[error("{0}")]
    Mismatch(#[from] Mismatch),
    #[error("the board runs firmware {theirs}, this program is {OURS}: flash the firmware of this release")]
    Firmware { theirs: String },
    #[error("the board refuses {request}: {reason}")]
    Refused { request: String, reason: String },
    #[error("the board does not answer {request}; look after power, cable, port and baud rate")]
    Silent { request: String },
    #[error(
        "the board is still on its way to 0 V, longer than its ramp takes: press the wired stop, and look at the bench"
    )]
    NotAtRest,
    #[error("the board is gone: {lost} requests in a row without an answer; look after power and cable")]
    Gone { lost: u64 },
}

/// Who is at the other end.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// The board file's name.
    pub board: String,
    /// Version and commit of its firmware.
    pub firmware: String,
    /// Its converters and timer.
    pub converters: Converters,
}

impl Board {
    /// From sample to drive on its own pins, seconds.
    pub fn latency_s(&self) -> f64 {
        f64::from(self.converters.latch_cycles) / f64::from(self.converters.timer_hz)
    }
}

/// A board's answer to one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Drive, DAC code.
    pub code: u16,
    /// Drive before the DAC, volts.
    pub drive_v: f32,
    /// Reference in use, metres.
    pub reference_m: f32,
    /// Which limits acted.
    pub limited_by: Limits,
    /// Number of [`control_core::ModeName`].
    pub mode: u8,
}

/// Samples that a board streamed.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Number of the first one since the board started, modulo 2^32.
    pub first: u32,
    /// From one to the next.
    pub every: u16,
    /// Dropped by the board since the stream began, because the link was busy.
    pub dropped: u32,
    /// The samples.
    pub samples: Vec<Sample>,
}

/// The host's end of a conversation.
#[derive(Debug)]
pub struct Session<L> {
    link: L,
    sender: Sender,
    receiver: Receiver,
    waiting: VecDeque<u8>,
    patience: Duration,
    next_index: u32,
    /// What was streamed and nobody has taken yet; `None` where no stream was asked for.
    streamed: Option<VecDeque<Block>>,
    statistics: Statistics,
}

impl<L: Link> Session<L> {
    /// Nothing said yet.
    pub fn new(link: L) -> Session<L> {
        let patience = link.patience();
        Session {
            link,
            sender: Sender::default(),
            receiver: Receiver::new(),
            waiting: VecDeque::new(),
            patience,
            next_index: 0,
            streamed: None,
            statistics: Statistics::default(),
        }
    }

    /// The same with another patience than the link's own, if there is one.
    #[must_use]
    pub fn with_patience(self, patience: Option<Duration>) -> Session<L> {
        Session { patience: patience.unwrap_or(self.patience), ..self }
    }

    /// The link.
    pub fn link(&mut self) -> &mut L {
        &mut self.link
    }

    /// What happened so far.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// The handshake: who is there, and can it be worked with?
    ///
    /// # Errors
    /// [`SessionError`], in words.
    pub fn greet(&mut self) -> Result<Board, SessionError> {
        // Ends whatever half frame the line holds.
        self.link.send(&[0])?;
        match self.look(&ToBoard::Hello)? {
            Heard::Identity { board, firmware, converters, .. } => Ok(Board { board, firmware, converters }),
            _ => Err(silent(&ToBoard::Hello)),
        }
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// [`SessionError`]; no answer is one.
    pub fn ask(&mut self, request: &ToBoard<'_>) -> Result<Heard, SessionError> {
        self.attempt(request)?.ok_or_else(|| silent(request))
    }

    /// As [`Session::ask`], for a request that is answered by `Done`.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn order(&mut self, request: &ToBoard<'_>) -> Result<(), SessionError> {
        self.ask(request).map(|_| ())
    }

    /// The parameters in force.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn parameters(&mut self) -> Result<Parameters, SessionError> {
        match self.look(&ToBoard::GetParameters)? {
            Heard::Parameters(parameters) => Ok(*parameters),
            _ => Err(silent(&ToBoard::GetParameters)),
        }
    }

    /// The board's account of itself.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn status(&mut self) -> Result<Status, SessionError> {
        match self.look(&ToBoard::KeepAlive)? {
            Heard::Status(status) => Ok(status),
            _ => Err(silent(&ToBoard::KeepAlive)),
        }
    }

    /// Stops the loop or disarms; on a bad line as often as it takes.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn stop(&mut self) -> Result<(), SessionError> {
        loop {
            let refused = match self.attempt(&ToBoard::Stop) {
                Ok(Some(_)) => return Ok(()),
                Ok(None) => None,
                Err(refused @ SessionError::Refused { .. }) => Some(refused),
                Err(error) => return Err(error),
            };
            // It may have been heard, and its answer lost; or a fault came first.
            if ![ModeName::Armed as u8, ModeName::Running as u8].contains(&self.status()?.mode) {
                return Ok(());
            }
            refused.map_or(Ok(()), Err)?;
        }
    }

    /// One sample over the bridge; `None` where it or its answer was lost.
    ///
    /// # Errors
    /// [`SessionError`]; [`SessionError::Gone`] after twenty losses in a row.
    pub fn exchange(&mut self, displacement: u16, monitor: u16) -> Result<Option<Drive>, SessionError> {
        let index = self.next_index;
        self.next_index = index.wrapping_add(1);
        let begun = self.link.now();
        let heard = self.attempt(&ToBoard::BridgeSample { index, displacement, monitor })?;
        let Some(Heard::BridgeDrive { drive, drive_v, reference_m, limited_by, mode, .. }) = heard else {
            return Ok(None);
        };
        let ended = self.link.now();
        self.statistics.round_trip.note(ended.saturating_sub(begun));
        Ok(Some(Drive { code: drive, drive_v, reference_m, limited_by: Limits::from_bits(limited_by), mode }))
    }

    /// Asks for every sample from now on; every how many it will be. Blocks wait in [`Session::next_block`] until they are taken.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn start_stream(&mut self) -> Result<u16, SessionError> {
        self.streamed = Some(VecDeque::new());
        match self.look(&ToBoard::StreamStart { every: 1 })? {
            Heard::StreamStarted { every, .. } => Ok(every),
            _ => Err(silent(&ToBoard::StreamStart { every: 1 })),
        }
    }

    /// No more blocks; those that nobody took are dropped.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn stop_stream(&mut self) -> Result<(), SessionError> {
        self.streamed = None;
        self.look(&ToBoard::StreamStop).map(|_| ())
    }

    /// The oldest block that was not taken yet, waiting for one for at most `patience`.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn next_block(&mut self, patience: Duration) -> Result<Option<Block>, SessionError> {
        if let Some(block) = self.streamed.as_mut().and_then(VecDeque::pop_front) {
            return Ok(Some(block));
        }
        let until = self.link.now() + patience;
        while let Some(heard) = self.next(until)? {
            match heard {
                Heard::StreamBlock { .. } => self.keep(heard),
                Heard::Fault { .. } => {}
                _ => self.statistics.late += 1,
            }
            if let Some(block) = self.streamed.as_mut().and_then(VecDeque::pop_front) {
                return Ok(Some(block));
            }
        }
        Ok(None)
    }

    fn keep(&mut self, heard: Heard) {
        if let (Some(streamed), Heard::StreamBlock { first, every, lost, samples }) = (&mut self.streamed, heard) {
            streamed.push_back(Block { first, every, dropped: lost, samples });
        }
    }

    /// As [`Session::ask`], for a request that changes nothing: sent again where it or its answer was lost.
    fn look(&mut self, request: &ToBoard<'_>) -> Result<Heard, SessionError> {
        for _ in 0..ATTEMPTS {
            if let Some(heard) = self.attempt(request)? {
                return Ok(heard);
            }
        }
        Err(silent(request))
    }

    /// Sends a request; its answer, or `None` where that did not come in time.
    fn attempt(&mut self, request: &ToBoard<'_>) -> Result<Option<Heard>, SessionError> {
        let mut frame = [0; MAX_ENCODED_BYTES];
        let asked = self.sender.next_sequence();
        let n = self.sender.encode(request, &mut frame)?;
        let until = self.link.now() + self.patience;
        self.link.send(&frame[..n])?;
        self.statistics.requests += 1;
        self.statistics.bytes[0] += n as u64;
        while let Some(heard) = self.next(until)? {
            match heard {
                // They come by themselves; what a fault is, status and mode say.
                Heard::Fault { .. } => {}
                Heard::StreamBlock { .. } => self.keep(heard),
                Heard::Refused { sequence, reason } if sequence == asked => {
                    self.statistics.note_answer();
                    return Err(SessionError::Refused { request: name(request), reason });
                }
                heard if is_answer(request, asked, &heard) => {
                    self.statistics.note_answer();
                    return Ok(Some(heard));
                }
                _ => self.statistics.late += 1,
            }
        }
        let lost = self.statistics.note_loss();
        if lost >= GONE { Err(SessionError::Gone { lost }) } else { Ok(None) }
    }

    /// The next whole message; `None` when there is none until then.
    fn next(&mut self, until: Duration) -> Result<Option<Heard>, SessionError> {
        let mut has_waited = false;
        loop {
            while let Some(byte) = self.waiting.pop_front() {
                let Some(found) = self.receiver.push(byte) else { continue };
                match found.and_then(|frame| Ok((frame.sequence, frame.message::<ToHost<'_>>()?))) {
                    Ok((sequence, message)) => {
                        self.statistics.note_frame(sequence);
                        if let ToHost::Identity(identity) = &message {
                            check(identity)?;
                        }
                        return Ok(Some(message.into()));
                    }
                    // Only believed of an undamaged frame.
                    Err(error @ WireError::Version { .. }) => return Err(error.into()),
                    Err(error) => self.statistics.note_damage(error),
                }
            }
            let now = self.link.now();
            if has_waited && now >= until {
                return Ok(None);
            }
            let mut bytes = Vec::new();
            self.link.receive(until.saturating_sub(now), &mut bytes)?;
            if bytes.is_empty() {
                return Ok(None);
            }
            has_waited = true;
            self.statistics.bytes[1] += bytes.len() as u64;
            self.waiting.extend(bytes);
        }
    }
}

/// Whether firmware that says so of its version and commit is of this release.
pub fn is_ours(firmware: &str) -> bool {
    firmware.split(' ').next() == Some(OURS)
}

/// Whether a board that says so can be worked with.
fn check(identity: &Identity<'_>) -> Result<(), SessionError> {
    identity.check()?;
    if !is_ours(identity.firmware) {
        return Err(SessionError::Firmware { theirs: identity.firmware.to_owned() });
    }
    Ok(())
}

fn is_answer(request: &ToBoard<'_>, asked: u16, heard: &Heard) -> bool {
    match (request, heard) {
        (ToBoard::Hello, Heard::Identity { .. })
        | (ToBoard::KeepAlive, Heard::Status(_))
        | (ToBoard::GetParameters, Heard::Parameters(_))
        | (ToBoard::StreamStart { .. }, Heard::StreamStarted { .. }) => true,
        (ToBoard::BridgeSample { index: sent, .. }, Heard::BridgeDrive { index, .. }) => sent == index,
        (_, Heard::Done { sequence }) => *sequence == asked,
        _ => false,
    }
}

/// A request in one word.
fn name(request: &ToBoard<'_>) -> String {
    let text = format!("{request:?}");
    text.split([' ', '(', '{']).next().unwrap_or_default().to_owned()
}

fn silent(request: &ToBoard<'_>) -> SessionError {
    SessionError::Silent { request: name(request) }
}
