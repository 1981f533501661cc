//! The flash image: the very ELF that a user flashes, its loadable parts and its symbols.

use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSymbol};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the first flash bank begins, and how long it is.
pub const FLASH: u32 = 0x0800_0000;
/// See [`FLASH`].
pub const FLASH_BYTES: u32 = 0x4_0000;

/// Why a file is no image.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ImageError {
    #[error("{}: cannot be read: {error}; build it with `cargo xtask firmware`", path.display())]
    Unreadable { path: PathBuf, error: std::io::Error },
    #[error("{}: no 32-bit ELF file: {reason}; give the image that `cargo xtask firmware` built", path.display())]
    NotElf { path: PathBuf, reason: String },
    #[error("{}: {address:#010x} lies outside of the first flash bank: link it with the project's memory.x", path.display())]
    Outside { path: PathBuf, address: u32 },
}

/// An image, ready to run.
#[derive(Clone, Debug)]
pub struct Image {
    /// The first flash bank; erased bytes are 0xff.
    pub flash: Vec<u8>,
    /// Bytes that are loaded, vectors to the last initial value.
    pub loaded_bytes: u32,
    symbols: BTreeMap<String, u32>,
}

impl Image {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn read(path: &Path) -> Result<Image, ImageError> {
        let bytes = std::fs::read(path).map_err(|error| ImageError::Unreadable { path: path.to_owned(), error })?;
        Image::parse(path, &bytes)
    }

    /// Takes a file's bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Image, ImageError> {
        let not_elf = |reason: object::Error| ImageError::NotElf { path: path.to_owned(), reason: reason.to_string() };
        let elf = ElfFile32::<Endianness>::parse(bytes).map_err(not_elf)?;
        let endian = elf.endian();
        let mut flash = vec![0xff; FLASH_BYTES as usize];
        let mut loaded_bytes = 0;
        for header in elf.elf_program_headers() {
            let data = header.data(endian, bytes).map_err(|()| ImageError::NotElf {
                path: path.to_owned(),
                reason: "a segment lies outside of the file".into(),
            })?;
            if header.p_type(endian) != object::elf::PT_LOAD || data.is_empty() {
                continue;
            }
            let address = header.p_paddr(endian);
            let offset = address.wrapping_sub(FLASH);
            let place = (offset as usize).checked_add(data.len()).and_then(|end| flash.get_mut(offset as usize..end));
            let Some(place) = place else {
                return Err(ImageError::Outside { path: path.to_owned(), address });
            };
            place.copy_from_slice(data);
            loaded_bytes = loaded_bytes.max(offset + data.len() as u32);
        }
        if loaded_bytes == 0 {
            return Err(ImageError::NotElf { path: path.to_owned(), reason: "it has nothing to load".into() });
        }
        let symbols = elf
            .symbols()
            .filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address() as u32)))
            .collect();
        Ok(Image { flash, loaded_bytes, symbols })
    }

    /// Whether the image is for converters on SPI: its control interrupt, the handler that lies in CCM SRAM, is the timer's.
    pub fn has_external_converters(&self) -> bool {
        self.symbol("TIM8_CC").is_some_and(|address| address >> 16 == 0x1000)
    }

    /// All symbols with their addresses.
    pub fn symbols(&self) -> impl Iterator<Item = (&str, u32)> {
        self.symbols.iter().map(|(name, address)| (name.as_str(), *address))
    }

    /// The address of a symbol.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_image_is_refused_in_words() {
        let path = Path::new("x.elf");
        for bytes in [&b""[..], b"ELF", &[0x7f, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0]] {
            let error = Image::parse(path, bytes).unwrap_err().to_string();
            assert!(error.starts_with("x.elf: no 32-bit ELF file"), "{error}");
        }
        let error = Image::read(Path::new("nowhere.elf")).unwrap_err().to_string();
        assert!(error.ends_with("build it with `cargo xtask firmware`"), "{error}");
    }
}
