//! The link to a board at a serial port or a pseudo-terminal: raw, 8N1, without flow control, for nobody else while it is open.

#[cfg(unix)]
pub use unix::Serial;

#[cfg(unix)]
mod unix {
    use crate::link::{Link, LinkError};
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::OFlags;
    use rustix::termios::{
        ControlModes, OptionalActions, QueueSelector, ioctl_tiocexcl, ioctl_tiocnxcl, isatty, tcflush, tcgetattr,
        tcsetattr,
    };
    use std::fs::{File, OpenOptions};
    use std::io::{self, ErrorKind, Read, Write};
    use std::os::unix::fs::OpenOptionsExt;
    use std::path::Path;
    use std::time::{Duration, Instant};

    /// Chosen: 100 answers' time at 3 Mbaud and the worst scheduling of a desktop; less than the board's own 250 ms.
    const PATIENCE: Duration = Duration::from_millis(100);

    /// An open port.
    #[derive(Debug)]
    pub struct Serial {
        port: File,
        since: Instant,
        patience: Duration,
    }

    impl Serial {
        /// Opens `path` at `baud` bits per second.
        ///
        /// # Errors
        /// [`LinkError::Open`].
        pub fn open(path: &Path, baud: u32) -> Result<Serial, LinkError> {
            let place = || format!("serial:{}", path.display());
            let refused = |source: io::Error| {
                let advice = match source.kind() {
                    ErrorKind::NotFound => "plug the board in, or name another port",
                    ErrorKind::PermissionDenied => "join the group that owns the port (often dialout)",
                    ErrorKind::ResourceBusy => "another program has it open: end that one",
                    ErrorKind::InvalidInput => "the port does not know this rate: give another --baud",
                    _ => "name another port",
                };
                LinkError::Open { place: place(), source, advice }
            };
            // Without O_NONBLOCK, opening waits for a carrier that a three-wire cable never has.
            let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits() as i32;
            let port = OpenOptions::new().read(true).write(true).custom_flags(flags).open(path).map_err(refused)?;
            if !isatty(&port) {
                return Err(refused(io::Error::other("no serial port")));
            }
            ioctl_tiocexcl(&port).map_err(|error| refused(error.into()))?;
            let mut settings = tcgetattr(&port).map_err(|error| refused(error.into()))?;
            settings.make_raw();
            settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
            settings.control_modes &= !(ControlModes::CSTOPB | ControlModes::CRTSCTS);
            settings.set_speed(baud).map_err(|error| refused(error.into()))?;
            tcsetattr(&port, OptionalActions::Now, &settings).map_err(|error| refused(error.into()))?;
            // What an earlier host left behind is no answer to us.
            tcflush(&port, QueueSelector::IOFlush).map_err(|error| refused(error.into()))?;
            Ok(Serial { port, since: Instant::now(), patience: PATIENCE })
        }

        /// Another patience than 100 ms.
        #[must_use]
        pub fn with_patience(mut self, patience: Duration) -> Serial {
            self.patience = patience;
            self
        }

        /// Waits until the port can do what `flags` say; false when `patience` is over.
        fn wait(&self, flags: PollFlags, patience: Duration) -> Result<bool, LinkError> {
            let timeout = Timespec {
                tv_sec: patience.as_secs().try_into().unwrap_or(i64::MAX),
                tv_nsec: patience.subsec_nanos().into(),
            };
            match poll(&mut [PollFd::new(&self.port, flags)], Some(&timeout)) {
                Ok(n) => Ok(n > 0),
                // A signal: as if something had come, the caller looks and asks again.
                Err(rustix::io::Errno::INTR) => Ok(true),
                Err(error) => Err(LinkError::Broken(error.into())),
            }
        }
    }

    impl Drop for Serial {
        fn drop(&mut self) {
            // A pseudo-terminal outlives us, and would keep the next host out; nothing can be done where it is gone already.
            let _ = ioctl_tiocnxcl(&self.port);
        }
    }

    impl Link for Serial {
        fn send(&mut self, mut bytes: &[u8]) -> Result<(), LinkError> {
            while !bytes.is_empty() {
                match self.port.write(bytes) {
                    Ok(n) if n > 0 => bytes = &bytes[n..],
                    Ok(_) => return Err(LinkError::Closed),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) if error.kind() == ErrorKind::WouldBlock => {
                        if !self.wait(PollFlags::OUT, Duration::from_secs(5))? {
                            return Err(LinkError::Broken(ErrorKind::TimedOut.into()));
                        }
                    }
                    Err(error) => return Err(LinkError::Broken(error)),
                }
            }
            Ok(())
        }

        fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
            let until = self.since.elapsed() + patience;
            let mut bytes = [0; 4096];
            loop {
                match self.port.read(&mut bytes) {
                    // A port that was pulled out reads as its end.
                    Ok(0) => return Err(LinkError::Closed),
                    Ok(n) => {
                        into.extend_from_slice(&bytes[..n]);
                        return Ok(());
                    }
                    Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                    Err(error) => return Err(LinkError::Broken(error)),
                }
                let left = until.saturating_sub(self.since.elapsed());
                if left.is_zero() || !self.wait(PollFlags::IN, left)? {
                    return Ok(());
                }
            }
        }

        fn now(&mut self) -> Duration {
            self.since.elapsed()
        }

        fn patience(&self) -> Duration {
            self.patience
        }
    }
}
