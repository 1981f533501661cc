//! A link: bytes to a board and bytes from it, each wait with an end. It knows no frame.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;
use virtual_board::MachineError;

/// How late a sleep may end on a machine that is not busy: Linux adds 50 us by default; chosen with a margin.
const GRAIN: Duration = Duration::from_micros(200);

/// Why a link can't be had, or is no more.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum LinkError {
    #[error("{place}: {source}; {advice}")]
    Open { place: String, source: io::Error, advice: &'static str },
    #[error("the link broke: {0}; look after cable and board")]
    Broken(#[source] io::Error),
    #[error("the other end closed the link; look after cable and board")]
    Closed,
    #[error("virtual board: {0}")]
    Machine(#[from] MachineError),
}

/// Bytes to and from a board.
pub trait Link {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`LinkError`]: the link is no more.
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError>;

    /// Appends what has come, waiting for at most `patience` until something has. Nothing appended: nothing will come within `patience`.
    ///
    /// # Errors
    /// [`LinkError`]: the link is no more.
    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError>;

    /// The link's own time since it was opened: the clock's, or a simulated board's.
    fn now(&mut self) -> Duration;

    /// How long an answer may take until its frame counts as lost.
    fn patience(&self) -> Duration;

    /// Lets `time` pass, of the link's own.
    ///
    /// # Errors
    /// [`LinkError`]: the link is no more.
    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        let until = self.now() + time;
        // A sleep ends late by the scheduler's grain; the rest is waited through.
        std::thread::sleep(time.saturating_sub(GRAIN));
        while self.now() < until {
            std::hint::spin_loop();
        }
        Ok(())
    }
}

impl<L: Link + ?Sized> Link for Box<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        (**self).send(bytes)
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        (**self).receive(patience, into)
    }

    fn now(&mut self) -> Duration {
        (**self).now()
    }

    fn patience(&self) -> Duration {
        (**self).patience()
    }

    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        (**self).pause(time)
    }
}

/// Where a board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// In this process, without a chip.
    InProcess,
    /// The flash image on the virtual board, in this process.
    Virtual,
    /// At a TCP address, host and port.
    Tcp(String),
    /// At a serial port: a device's path.
    Serial(PathBuf),
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Place, String> {
        match text.split_once(':') {
            None if text == "in-process" => Ok(Place::InProcess),
            None if text == "virtual" => Ok(Place::Virtual),
            Some(("tcp", address)) if address.contains(':') => Ok(Place::Tcp(address.to_owned())),
            Some(("serial", path)) if !path.is_empty() => Ok(Place::Serial(path.into())),
            _ => Err("in-process, virtual, tcp:HOST:PORT or serial:PATH".into()),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::InProcess => f.write_str("in-process"),
            Place::Virtual => f.write_str("virtual"),
            Place::Tcp(address) => write!(f, "tcp:{address}"),
            Place::Serial(path) => write!(f, "serial:{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_as_they_are_printed_and_others_refused() {
        for text in ["in-process", "virtual", "tcp:127.0.0.1:4000", "tcp:[::1]:4000", "serial:/dev/ttyACM0"] {
            assert_eq!(text.parse::<Place>().unwrap().to_string(), text);
        }
        for text in ["", "tcp", "tcp:", "tcp:host", "serial:", "usb:1", "in-process:x"] {
            assert!(text.parse::<Place>().is_err(), "{text}");
        }
    }
}
