//! The board's line in the open: a TCP port or a pseudo-terminal at whose other end any host may sit.
//!
//! [`Pace::Real`] lets the board's time pass as the clock's does, or slower where this machine can't keep up; what comes when depends on the
//! host then. [`Pace::Lockstep`] lets it pass only while a request is being answered: the same requests give the same bytes, cycle
//! for cycle, however long the host thinks.
//!
//! One host at a time; one that goes leaves the board as it is, as a pulled cable does.

use crate::machine::{Machine, MachineError};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};
use wire::{Receiver, ToHost, WireError};

/// Cycles between two looks at the line in real time: 1 ms.
const SLICE_CYCLES: u64 = 170_000;
/// Longest time that an answer takes: 50 ms, twice what saving parameters does.
const ANSWER_CYCLES: u64 = 8_500_000;
/// How long the thread sleeps where there is nothing to do.
const NAP: Duration = Duration::from_micros(200);
/// How long a host may refuse bytes before it counts as gone.
const PATIENCE: Duration = Duration::from_secs(5);

/// How the board's time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As the clock's, or slower.
    Real,
    /// Only while a request is being answered.
    Lockstep,
}

/// Why serving ended before its time.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ServeError {
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error("the line: {0}")]
    Line(#[from] io::Error),
}

/// The end of a line that is open to hosts.
pub trait Line {
    /// Bytes that have come; none where none have, or where nobody is there.
    ///
    /// # Errors
    /// A line that can't be used any more; a host that went is none.
    fn receive(&mut self) -> io::Result<Vec<u8>>;

    /// Sends all of `bytes`, or drops them where nobody is there.
    ///
    /// # Errors
    /// As [`Line::receive`].
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// Reads what is there without waiting: `None` once the other end is gone.
fn read_some(from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = vec![0; 4096];
    match from.read(&mut bytes) {
        Ok(0) => Ok(None),
        Ok(n) => Ok(Some(bytes[..n].to_vec())),
        Err(error) => match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(Some(Vec::new())),
            ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted => Ok(None),
            _ => Err(error),
        },
    }
}

/// Writes all: false once the other end is gone, or takes nothing for [`PATIENCE`].
fn write_all(to: &mut impl Write, mut bytes: &[u8]) -> bool {
    let begun = Instant::now();
    while !bytes.is_empty() {
        match to.write(bytes) {
            Ok(n) if n > 0 => bytes = &bytes[n..],
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
                    && begun.elapsed() < PATIENCE =>
            {
                std::thread::sleep(NAP);
            }
            _ => return false,
        }
    }
    true
}

/// A TCP port.
#[derive(Debug)]
pub struct TcpLine {
    listener: TcpListener,
    host: Option<TcpStream>,
}

impl TcpLine {
    /// Listens at `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// An address that can't be had.
    pub fn open(address: impl ToSocketAddrs) -> io::Result<TcpLine> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(TcpLine { listener, host: None })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// None that is known once it listens.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Line for TcpLine {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        if self.host.is_none() {
            match self.listener.accept() {
                Ok((host, _)) => {
                    host.set_nonblocking(true)?;
                    // An answer is a small packet, and the host waits for it.
                    host.set_nodelay(true)?;
                    self.host = Some(host);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(Vec::new()),
                Err(error) => return Err(error),
            }
        }
        let Some(host) = &mut self.host else { return Ok(Vec::new()) };
        let bytes = read_some(host)?;
        if bytes.is_none() {
            self.host = None;
        }
        Ok(bytes.unwrap_or_default())
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Some(host) = &mut self.host
            && !write_all(host, bytes)
        {
            self.host = None;
        }
        Ok(())
    }
}

/// A pseudo-terminal, which a host opens like a serial port.
#[cfg(unix)]
#[derive(Debug)]
pub struct PtyLine {
    ours: std::fs::File,
    /// Kept open, so that a host may close its end and open it again.
    _theirs: std::fs::File,
    path: std::path::PathBuf,
}

#[cfg(unix)]
impl PtyLine {
    /// A new one, without echo and line discipline.
    ///
    /// # Errors
    /// A system that has none to give.
    pub fn open() -> io::Result<PtyLine> {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let name = ptsname(&ours, Vec::new())?;
        let path = std::path::PathBuf::from(name.to_string_lossy().into_owned());
        let theirs = std::fs::OpenOptions::new().read(true).write(true).open(&path)?;
        let mut settings = tcgetattr(&theirs)?;
        settings.make_raw();
        tcsetattr(&theirs, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&ours, true)?;
        Ok(PtyLine { ours: ours.into(), _theirs: theirs, path })
    }

    /// What a host opens.
    pub fn path(&self) -> &std::path::Path {
        &self.path
    }
}

#[cfg(unix)]
impl Line for PtyLine {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        Ok(read_some(&mut self.ours)?.unwrap_or_default())
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        // A host that reads nothing loses what its buffer can't hold, as on a serial port.
        write_all(&mut self.ours, bytes);
        Ok(())
    }
}

/// Serves the board's line until `is_over` says so; it is told the board's present cycle.
///
/// # Errors
/// [`ServeError`].
pub fn serve(
    machine: &mut Machine,
    line: &mut dyn Line,
    pace: Pace,
    mut is_over: impl FnMut(u64) -> bool,
) -> Result<(), ServeError> {
    // What is sent before the image has opened its port is lost, on a real line, too.
    let samples = machine.chip().samples;
    machine.run(machine.now() + 4 * ANSWER_CYCLES, |chip| chip.samples >= samples + 2)?;
    match pace {
        Pace::Real => real(machine, line, &mut is_over),
        Pace::Lockstep => lockstep(machine, line, &mut is_over),
    }
}

fn real(machine: &mut Machine, line: &mut dyn Line, is_over: &mut dyn FnMut(u64) -> bool) -> Result<(), ServeError> {
    let (begun, first) = (Instant::now(), machine.now());
    while !is_over(machine.now()) {
        let bytes = line.receive()?;
        machine.chip().usart.from_host.extend(bytes);
        machine.run(machine.now() + SLICE_CYCLES, |_| false)?;
        let bytes = std::mem::take(&mut machine.chip().usart.to_host);
        line.send(&bytes)?;
        let passed = Duration::from_secs_f64((machine.now() - first) as f64 / crate::bench::CORE_HZ);
        std::thread::sleep(passed.saturating_sub(begun.elapsed()));
    }
    Ok(())
}

fn lockstep(
    machine: &mut Machine,
    line: &mut dyn Line,
    is_over: &mut dyn FnMut(u64) -> bool,
) -> Result<(), ServeError> {
    let (mut requests, mut answers) = (Receiver::new(), Receiver::new());
    let mut waiting = Vec::new();
    while !is_over(machine.now()) {
        waiting.extend(line.receive()?);
        // Frame by frame, so that it does not matter in which pieces the bytes came.
        let Some(end) = waiting.iter().position(|byte| *byte == 0) else {
            std::thread::sleep(NAP);
            continue;
        };
        let frame: Vec<u8> = waiting.drain(..=end).collect();
        // What is no frame is not answered; another version is, in words.
        let is_answered =
            frame.iter().any(|byte| matches!(requests.push(*byte), Some(Ok(_) | Err(WireError::Version { .. }))));
        machine.chip().usart.from_host.extend(frame);
        let limit = machine.now() + ANSWER_CYCLES;
        let mut is_done = false;
        while !is_done {
            let has_frame = machine.run(limit, |chip| {
                // Without an answer to come, until the line is empty.
                chip.usart.to_host.contains(&0) || (!is_answered && chip.usart.from_host.is_empty())
            })?;
            let bytes = std::mem::take(&mut machine.chip().usart.to_host);
            is_done = !has_frame || !is_answered;
            for byte in &bytes {
                if let Some(Ok(frame)) = answers.push(*byte)
                    && let Ok(message) = frame.message::<ToHost<'_>>()
                {
                    is_done |= !matches!(message, ToHost::StreamBlock { .. } | ToHost::Fault { .. });
                }
            }
            line.send(&bytes)?;
        }
    }
    Ok(())
}
