//! Files that are whole or as they were: written beside their place, and put there when all is written.
//!
//! Whatever ends a program, a reader of such a file never meets half of it. A power cut is another matter: nothing here waits for the disk.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

const BUFFER_BYTES: usize = 1 << 16;

/// Writes `content` to `path`, which is whole or as it was. Its folder must be there.
///
/// # Errors
/// As [`WholeFile::create`] and [`WholeFile::finish`].
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = WholeFile::create(path)?;
    file.write_all(content)?;
    file.finish()
}

/// Whether a file could be begun at `path`; nothing of it stays.
///
/// # Errors
/// As [`WholeFile::create`].
pub fn try_beside(path: &Path) -> io::Result<()> {
    WholeFile::create(path).map(drop)
}

/// A file that takes its name when it is complete, and vanishes otherwise.
#[derive(Debug)]
pub struct WholeFile {
    /// Where the bytes go until then; `None` for what cannot be replaced, a device or a pipe, and for a live file.
    temporary: Option<PathBuf>,
    target: PathBuf,
    file: BufWriter<File>,
}

impl WholeFile {
    /// Begins a file. Through a link, its target is replaced and not the link; a device or a pipe is written to.
    ///
    /// # Errors
    /// What the file system says; [`io::ErrorKind::IsADirectory`] for a directory and [`io::ErrorKind::PermissionDenied`] for a file
    /// that may not be written, although its directory would allow it to be replaced.
    pub fn create(path: &Path) -> io::Result<Self> {
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        match fs::metadata(&target) {
            Ok(found) if found.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
            Ok(found) if !found.is_file() => {
                let file = OpenOptions::new().write(true).open(&target)?;
                return Ok(Self { temporary: None, target, file: BufWriter::with_capacity(BUFFER_BYTES, file) });
            }
            Ok(found) if found.permissions().readonly() => return Err(io::ErrorKind::PermissionDenied.into()),
            _ => {}
        }
        // Unique among the writers of this process and, by its number, among processes.
        static N_BEGUN: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let n = N_BEGUN.fetch_add(1, Ordering::Relaxed);
        let temporary = target.with_file_name(format!(".{name}.{}-{n}.partial", std::process::id()));
        let file = OpenOptions::new().write(true).create_new(true).open(&temporary)?;
        Ok(Self { temporary: Some(temporary), target, file: BufWriter::with_capacity(BUFFER_BYTES, file) })
    }

    /// A new file under its own name from the start, never taken back: for what shall be read while it grows.
    ///
    /// # Errors
    /// What the file system says, also for a file that is there already.
    pub fn live(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        Ok(Self { temporary: None, target: path.to_path_buf(), file: BufWriter::with_capacity(BUFFER_BYTES, file) })
    }

    /// Hands over what is buffered; how many bytes the file then has.
    ///
    /// # Errors
    /// What the file system says.
    pub fn hand_over(&mut self) -> io::Result<u64> {
        self.file.flush()?;
        Ok(self.file.get_ref().metadata()?.len())
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// What the file system says; nothing is left behind then.
    pub fn finish(mut self) -> io::Result<()> {
        self.file.flush()?;
        if let Some(temporary) = &self.temporary {
            fs::rename(temporary, &self.target)?;
            self.temporary = None;
        }
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // Nobody is left to be told if this fails too.
            let _ = fs::remove_file(temporary);
        }
    }
}
