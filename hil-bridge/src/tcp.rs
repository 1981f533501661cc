//! The link to a board behind a TCP port, such as `hysteron board serve`.

use crate::link::{Link, LinkError};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// How long a connection may take.
const CONNECT: Duration = Duration::from_secs(3);
/// TCP loses nothing, so what takes this long is a board that hangs; chosen for boards simulated on busy machines.
const PATIENCE: Duration = Duration::from_secs(5);
const ADVICE: &str = "start `hysteron board serve` there, or name another address";

/// A connection.
#[derive(Debug)]
pub struct Tcp {
    stream: TcpStream,
    since: Instant,
}

impl Tcp {
    /// Connects to `address`, host and port.
    ///
    /// # Errors
    /// [`LinkError::Open`].
    pub fn connect(address: &str) -> Result<Tcp, LinkError> {
        let refused = |source| LinkError::Open { place: format!("tcp:{address}"), source, advice: ADVICE };
        let mut last = io::Error::new(ErrorKind::NotFound, "no such address");
        for address in address.to_socket_addrs().map_err(refused)? {
            match TcpStream::connect_timeout(&address, CONNECT) {
                Ok(stream) => {
                    // A request is a small packet, and its answer is waited for.
                    stream.set_nodelay(true).map_err(refused)?;
                    stream.set_write_timeout(Some(PATIENCE)).map_err(refused)?;
                    return Ok(Tcp { stream, since: Instant::now() });
                }
                Err(error) => last = error,
            }
        }
        Err(refused(last))
    }
}

impl Link for Tcp {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.stream.write_all(bytes).map_err(LinkError::Broken)
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        // A timeout of zero would be none at all.
        let patience = patience.max(Duration::from_millis(1));
        self.stream.set_read_timeout(Some(patience)).map_err(LinkError::Broken)?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err(LinkError::Closed),
            Ok(n) => {
                into.extend_from_slice(&bytes[..n]);
                Ok(())
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(()),
            // The caller asks again while there is time.
            Err(error) if error.kind() == ErrorKind::Interrupted => self.receive(patience, into),
            Err(error) => Err(LinkError::Broken(error)),
        }
    }

    fn now(&mut self) -> Duration {
        self.since.elapsed()
    }

    fn patience(&self) -> Duration {
        PATIENCE
    }
}
