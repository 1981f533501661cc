//! Parameters in the second flash bank, in two copies, so that a power cut at any moment leaves one of them whole.
//!
//! Each copy has a page of its own: a record of version, generation, length, the set in postcard and a CRC, written word by word
//! after the page was erased. The copy that is older (or broken) is the one that is written anew. On reading, the newer whole copy counts.
//! A torn double word raises the NMI when it is read; its handler marks that, and the copy counts as broken.

use crate::registers::flash;
use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering};
use wire::Parameters;

/// The second bank, and its last two pages: far from a program that might grow.
const BANK: u32 = 0x0804_0000;
const PAGE_BYTES: u32 = 2048;
const PAGES: [u8; 2] = [126, 127];
/// First word of a record: "HYS" and the version of the record.
const MAGIC: u32 = u32::from_le_bytes(*b"HYS\x01");
/// Magic, generation, length, content, CRC.
const RECORD_BYTES: usize = 128;
const CONTENT: usize = 12;
const CONTENT_BYTES: usize = RECORD_BYTES - CONTENT - 4;

/// Set by the NMI when a double word could not be corrected.
static IS_TORN: AtomicBool = AtomicBool::new(false);
/// A copy is being read: what can't be corrected is of it.
static IS_READ: AtomicBool = AtomicBool::new(false);

/// What was found in flash.
#[derive(Debug, PartialEq)]
pub enum Found {
    /// Never written.
    Nothing,
    /// The newest whole set.
    Set(Parameters),
    /// Something is there, but no whole set.
    Broken,
}

/// Why nothing was saved.
#[derive(Debug)]
pub enum SaveError {
    /// The flash refused to be erased or written.
    Flash,
    /// What was read back differs.
    ReadBack,
}

impl fmt::Display for SaveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SaveError::Flash => "the flash could not be written: parameters are in force, but not saved",
            SaveError::ReadBack => {
                "the flash holds something else than was written: parameters are in force, but not saved"
            }
        })
    }
}

enum Copy {
    Empty,
    Broken,
    Whole { generation: u32, parameters: Parameters },
}

/// Called by the NMI handler; whether the double word was one of a copy. One of the program is no matter of the store.
pub fn note_torn() -> bool {
    IS_TORN.store(true, Ordering::Relaxed);
    IS_READ.load(Ordering::Relaxed)
}

/// The newest whole set.
pub fn load() -> Found {
    match (read(0), read(1)) {
        (Copy::Whole { generation: a, parameters }, Copy::Whole { generation: b, parameters: other }) => {
            // Generations go round; the newer one is ahead by less than half the circle.
            Found::Set(if b.wrapping_sub(a) < u32::MAX / 2 { other } else { parameters })
        }
        (Copy::Whole { parameters, .. }, _) | (_, Copy::Whole { parameters, .. }) => Found::Set(parameters),
        (Copy::Empty, Copy::Empty) => Found::Nothing,
        _ => Found::Broken,
    }
}

/// Writes the set over the older copy. Waits some 25 ms for the flash; the control interrupt goes on meanwhile.
///
/// # Errors
///
/// [`SaveError`]; the other copy is as it was.
pub fn save(parameters: &Parameters) -> Result<(), SaveError> {
    let (page_idx, generation) =
        match (read(0), read(1)) {
            (Copy::Whole { generation: a, .. }, Copy::Whole { generation: b, .. }) => {
                if b.wrapping_sub(a) < u32::MAX / 2 { (0, b.wrapping_add(1)) } else { (1, a.wrapping_add(1)) }
            }
            (Copy::Whole { generation, .. }, _) => (1, generation.wrapping_add(1)),
            (_, Copy::Whole { generation, .. }) => (0, generation.wrapping_add(1)),
            _ => (0, 1),
        };
    let mut record = [0xff_u8; RECORD_BYTES];
    let content = postcard_bytes(parameters, &mut record[CONTENT..CONTENT + CONTENT_BYTES]).ok_or(SaveError::Flash)?;
    record[..4].copy_from_slice(&MAGIC.to_le_bytes());
    record[4..8].copy_from_slice(&generation.to_le_bytes());
    record[8..12].copy_from_slice(&(content as u32).to_le_bytes());
    let crc = wire::crc32(&record[..RECORD_BYTES - 4]);
    record[RECORD_BYTES - 4..].copy_from_slice(&crc.to_le_bytes());
    if !flash::erase_second_bank_page(PAGES[page_idx]) {
        return Err(SaveError::Flash);
    }
    let (words, _) = record.as_chunks::<8>();
    for (k, word) in words.iter().enumerate() {
        let [a, b, c, d, e, f, g, h] = *word;
        let (low, high) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
        // SAFETY: a multiple of 8 inside of a page of the second bank that holds nothing but this record.
        if !unsafe { flash::program(address(page_idx) + 8 * k as u32, low, high) } {
            return Err(SaveError::Flash);
        }
    }
    flash::drop_data_cache();
    match read(page_idx) {
        Copy::Whole { generation: found, .. } if found == generation => Ok(()),
        _ => Err(SaveError::ReadBack),
    }
}

fn address(page_idx: usize) -> u32 {
    BANK + u32::from(PAGES[page_idx]) * PAGE_BYTES
}

fn read(page_idx: usize) -> Copy {
    IS_TORN.store(false, Ordering::Relaxed);
    IS_READ.store(true, Ordering::Relaxed);
    let mut record = [0_u8; RECORD_BYTES];
    let (words, _) = record.as_chunks_mut::<4>();
    for (k, word) in words.iter_mut().enumerate() {
        // SAFETY: readable flash. Volatile, because the hardware writes it.
        *word = unsafe { (address(page_idx) as *const u32).add(k).read_volatile() }.to_le_bytes();
    }
    IS_READ.store(false, Ordering::Relaxed);
    if IS_TORN.load(Ordering::Relaxed) {
        return Copy::Broken;
    }
    if record.iter().all(|byte| *byte == 0xff) {
        return Copy::Empty;
    }
    parse(&record).unwrap_or(Copy::Broken)
}

fn parse(record: &[u8; RECORD_BYTES]) -> Option<Copy> {
    let word = |at: usize| record.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    if word(0)? != MAGIC || word(RECORD_BYTES - 4)? != wire::crc32(&record[..RECORD_BYTES - 4]) {
        return None;
    }
    let content = record.get(CONTENT..)?.get(..word(8)? as usize)?;
    let parameters = wire::from_bytes(content)?;
    Some(Copy::Whole { generation: word(4)?, parameters })
}

fn postcard_bytes(parameters: &Parameters, bytes: &mut [u8]) -> Option<usize> {
    wire::to_bytes(parameters, bytes)
}
