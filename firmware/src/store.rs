//! Parameters in the second flash bank, in two copies, so that a power cut at any moment leaves one of them whole.
//!
//! Each copy has a page of its own: a record of version, generation, length, the set in postcard, the board and a CRC, written word by word
//! after the page was erased. The copy that is older (or broken) is the one that is written anew. On reading, the newer whole copy counts. Another
//! board's set counts as broken: its numbers may be right for neither converters nor wires of this one.
//! A torn double word raises the NMI when it is read; its handler marks that, and the copy counts as broken. Whatever can't be corrected while a
//! copy is read is taken for the copy's, since the flash may name another place for it; the program's own would come again.

use crate::registers::flash;
use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering, compiler_fence};
use wire::Parameters;

/// The second bank, and its last two pages: far from a program that might grow.
const BANK: u32 = 0x0804_0000;
const PAGE_BYTES: u32 = 2048;
const PAGES: [u8; 2] = [126, 127];
/// First word of a record: "HYS" and the version of the record.
const MAGIC: u32 = u32::from_le_bytes(*b"HYS\x02");
/// Magic, generation, length, content, board, CRC.
const RECORD_BYTES: usize = 128;
const CONTENT: usize = 12;
const BOARD: usize = RECORD_BYTES - 8;
const CRC: usize = RECORD_BYTES - 4;

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
    /// Something is there, but no whole set of this board.
    Broken,
}

/// Why nothing was saved.
#[derive(Debug)]
pub enum SaveError {
    /// The flash is one bank: while it is written no instruction is read, and the loop would stand still.
    OneBank,
    /// The flash refused to be erased or written.
    Flash,
    /// What was read back differs.
    ReadBack,
}

impl fmt::Display for SaveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SaveError::OneBank => {
                "the flash is one bank (option bit DBANK), and the loop would stand still: parameters are in force, but not saved"
            }
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

/// Called by the NMI handler where a double word could not be corrected; whether it was one of a copy.
pub fn note_torn() -> bool {
    IS_TORN.store(true, Ordering::Relaxed);
    IS_READ.load(Ordering::Relaxed)
}

/// The newest whole set of the board of this name.
pub fn load(board: &str) -> Found {
    match (read(0, board), read(1, board)) {
        (Copy::Whole { generation: a, parameters }, Copy::Whole { generation: b, parameters: other }) => {
            // Generations go round; the newer one is ahead by less than half the circle.
            Found::Set(if b.wrapping_sub(a) < u32::MAX / 2 { other } else { parameters })
        }
        (Copy::Whole { parameters, .. }, _) | (_, Copy::Whole { parameters, .. }) => Found::Set(parameters),
        (Copy::Empty, Copy::Empty) => Found::Nothing,
        _ => Found::Broken,
    }
}

/// Writes the set of the board of this name over the older copy. Waits some 25 ms for the flash; the control interrupt goes on meanwhile.
///
/// # Errors
///
/// [`SaveError`]; the other copy is as it was.
pub fn save(board: &str, parameters: &Parameters) -> Result<(), SaveError> {
    if !flash::has_two_banks() {
        return Err(SaveError::OneBank);
    }
    let (page_idx, generation) =
        match (read(0, board), read(1, board)) {
            (Copy::Whole { generation: a, .. }, Copy::Whole { generation: b, .. }) => {
                if b.wrapping_sub(a) < u32::MAX / 2 { (0, b.wrapping_add(1)) } else { (1, a.wrapping_add(1)) }
            }
            (Copy::Whole { generation, .. }, _) => (1, generation.wrapping_add(1)),
            (_, Copy::Whole { generation, .. }) => (0, generation.wrapping_add(1)),
            _ => (0, 1),
        };
    let mut record = [0xff_u8; RECORD_BYTES];
    let content = wire::to_bytes(parameters, &mut record[CONTENT..BOARD]).ok_or(SaveError::Flash)?;
    record[..4].copy_from_slice(&MAGIC.to_le_bytes());
    record[4..8].copy_from_slice(&generation.to_le_bytes());
    record[8..12].copy_from_slice(&(content as u32).to_le_bytes());
    record[BOARD..CRC].copy_from_slice(&wire::crc32(board.as_bytes()).to_le_bytes());
    let crc = wire::crc32(&record[..CRC]);
    record[CRC..].copy_from_slice(&crc.to_le_bytes());
    // Reading one bank while the other is written may spoil the data cache (ES0430, data cache and read-while-write).
    flash::stop_data_cache();
    let is_written = write(page_idx, &record);
    flash::start_data_cache();
    if !is_written {
        return Err(SaveError::Flash);
    }
    match read(page_idx, board) {
        Copy::Whole { generation: found, .. } if found == generation => Ok(()),
        _ => Err(SaveError::ReadBack),
    }
}

fn write(page_idx: usize, record: &[u8; RECORD_BYTES]) -> bool {
    let (words, _) = record.as_chunks::<8>();
    flash::erase_second_bank_page(PAGES[page_idx])
        && words.iter().enumerate().all(|(k, word)| {
            let [a, b, c, d, e, f, g, h] = *word;
            let (low, high) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
            // SAFETY: a multiple of 8 inside of a page of the second bank that holds nothing but this record.
            unsafe { flash::program(address(page_idx) + 8 * k as u32, low, high) }
        })
}

fn address(page_idx: usize) -> u32 {
    BANK + u32::from(PAGES[page_idx]) * PAGE_BYTES
}

fn read(page_idx: usize, board: &str) -> Copy {
    IS_TORN.store(false, Ordering::Relaxed);
    IS_READ.store(true, Ordering::Relaxed);
    // Before the first read, as the NMI sees it.
    compiler_fence(Ordering::SeqCst);
    let mut record = [0_u8; RECORD_BYTES];
    let (words, _) = record.as_chunks_mut::<4>();
    for (k, word) in words.iter_mut().enumerate() {
        // SAFETY: readable flash. Volatile, because the hardware writes it.
        *word = unsafe { (address(page_idx) as *const u32).add(k).read_volatile() }.to_le_bytes();
    }
    flash::settle();
    IS_READ.store(false, Ordering::Relaxed);
    if IS_TORN.load(Ordering::Relaxed) {
        return Copy::Broken;
    }
    if record.iter().all(|byte| *byte == 0xff) {
        return Copy::Empty;
    }
    parse(&record, board).unwrap_or(Copy::Broken)
}

fn parse(record: &[u8; RECORD_BYTES], board: &str) -> Option<Copy> {
    let word = |at: usize| record.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    let is_whole = word(0)? == MAGIC && word(CRC)? == wire::crc32(&record[..CRC]);
    if !is_whole || word(BOARD)? != wire::crc32(board.as_bytes()) {
        return None;
    }
    let content = record.get(CONTENT..BOARD)?.get(..word(8)? as usize)?;
    let parameters = wire::from_bytes(content)?;
    Some(Copy::Whole { generation: word(4)?, parameters })
}
