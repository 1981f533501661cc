//! The flash's controller and its second bank: program, erase, error correction.
//!
//! The first bank holds the program and is plain memory that nobody may write. A double word that a power cut tore can't be corrected:
//! reading it raises the NMI, as on the chip.

use super::strict::{Access, Bank, Kept, unmodelled};

/// Bytes of one bank.
pub const BANK_BYTES: u32 = 0x4_0000;
const PAGE_BYTES: u32 = 2048;
const ACR: u32 = 0x00;
const KEYR: u32 = 0x08;
const SR: u32 = 0x10;
const CR: u32 = 0x14;
const ECCR: u32 = 0x18;
const OPTR: u32 = 0x20;
const LOCK: u32 = 1 << 31;
const DCEN: u32 = 1 << 10;
const DBANK: u32 = 1 << 22;
const STRT: u32 = 1 << 16;
/// DS12288, flash characteristics: a double word 81.7 us, a page 22.1 ms, typical.
const PROGRAM_CYCLES: u64 = 13_889;
const ERASE_CYCLES: u64 = 3_757_000;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Work {
    Program { at: usize, word: [u32; 2] },
    Erase { page: u32 },
}

/// Controller and second bank.
#[derive(Debug)]
pub struct Flash {
    bank: Bank,
    /// Double words of the second bank.
    words: Vec<[u32; 2]>,
    torn: Vec<bool>,
    keys: u32,
    half: Option<(u32, u32)>,
    work: Option<(Work, u64)>,
    sr: u32,
    eccr: u32,
    /// What ECCR says of a torn double word is wrong, as it may be after a reset or a power cut in the middle of a write (ES0430): the first bank's
    /// first one, and a corrected one besides.
    pub is_eccr_spoilt: bool,
    /// Works begun so far.
    pub works: u32,
}

impl Flash {
    /// Both banks erased.
    pub fn new() -> Flash {
        let registers = [
            // LATENCY, PRFTEN, ICEN, DCEN, DCRST
            (ACR, Kept::new("FLASH_ACR", 0x0004_0600, 0x0000_170f)),
            // PG, PER, PNB, BKER, STRT, LOCK
            (CR, Kept::new("FLASH_CR", 0xc000_0000, 0x8001_0bfb)),
            // As delivered: DBANK, two banks.
            (OPTR, Kept::new("FLASH_OPTR", 0xffef_f8aa, 0)),
        ];
        let words = (BANK_BYTES / 8) as usize;
        Flash {
            bank: Bank::new("FLASH", &registers),
            words: vec![[!0; 2]; words],
            torn: vec![false; words],
            keys: 0,
            half: None,
            work: None,
            sr: 0,
            eccr: 0,
            is_eccr_spoilt: false,
            works: 0,
        }
    }

    /// A reset: what was being written is torn, the registers start anew.
    pub fn reset(&mut self) {
        self.cut();
        self.bank.reset();
        self.keys = 0;
        self.half = None;
        self.sr = 0;
        self.eccr = 0;
    }

    /// Power goes or the chip is reset while something is being written: that is neither old nor new.
    fn cut(&mut self) {
        match self.work.take() {
            Some((Work::Program { at, word }, _)) => {
                self.words[at] = [self.words[at][0] & word[0], self.words[at][1] & (word[1] | 0x5555_5555)];
                self.torn[at] = true;
            }
            Some((Work::Erase { page }, _)) => {
                let first = (page * PAGE_BYTES / 8) as usize;
                for at in (first..first + (PAGE_BYTES / 8) as usize).step_by(3) {
                    self.words[at] = [self.words[at][0] | 0xff00_ff00, self.words[at][1] | 0x00ff_00ff];
                    self.torn[at] = true;
                }
            }
            None => {}
        }
    }

    /// When the present work is done.
    pub fn event(&self) -> Option<u64> {
        self.work.map(|(_, done)| done)
    }

    /// Finishes what is due.
    pub fn advance(&mut self, now: u64) {
        let Some((work, done)) = self.work else { return };
        if now < done {
            return;
        }
        self.work = None;
        match work {
            Work::Program { at, word } => self.words[at] = word,
            Work::Erase { page } => {
                let first = (page * PAGE_BYTES / 8) as usize;
                self.words[first..first + (PAGE_BYTES / 8) as usize].fill([!0; 2]);
                self.torn[first..first + (PAGE_BYTES / 8) as usize].fill(false);
            }
        }
        self.bank.change(CR, |cr| cr.set_bits(STRT, false));
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> Access<u32> {
        match offset {
            SR => Ok(self.sr | u32::from(self.work.is_some()) << 16),
            ECCR => Ok(self.eccr),
            _ => self.bank.read(offset),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        match offset {
            KEYR => {
                self.keys = match (self.keys, value) {
                    (0, 0x4567_0123) => 1,
                    (1, 0xcdef_89ab) => 2,
                    _ => {
                        return unmodelled("FLASH_KEYR", format!("key {value:#010x} out of order locks until a reset"));
                    }
                };
                if self.keys == 2 {
                    self.bank.change(CR, |cr| cr.set_bits(LOCK, false));
                }
                Ok(())
            }
            SR => {
                self.sr &= !(value & 0xc3fb);
                Ok(())
            }
            ECCR => {
                // ECCC, ECCD and their second halves are cleared by writing 1.
                self.eccr &= !(value & 0xf000_0000);
                Ok(())
            }
            CR => {
                let old = self.bank.at(CR);
                if old & LOCK != 0 && value & LOCK == 0 {
                    return unmodelled("FLASH_CR", "written while locked");
                }
                if self.work.is_some() {
                    return unmodelled("FLASH_CR", "written while the flash is busy");
                }
                self.bank.write(CR, value)?;
                if value & LOCK != 0 {
                    self.keys = 0;
                }
                if value & STRT != 0 {
                    // PER and BKER.
                    if value & 0x802 != 0x802 {
                        return unmodelled("FLASH_CR", "start of anything but an erase of a page of the second bank");
                    }
                    self.begin(Work::Erase { page: value >> 3 & 0x7f }, now + ERASE_CYCLES)?;
                }
                Ok(())
            }
            _ => self.bank.write(offset, value),
        }
    }

    fn begin(&mut self, work: Work, done: u64) -> Access<()> {
        if self.bank.at(ACR) & DCEN != 0 {
            return unmodelled(
                "FLASH_ACR",
                "DCEN while the flash is written: the chip may spoil what the data cache holds (ES0430)",
            );
        }
        self.works += 1;
        self.work = Some((work, done));
        Ok(())
    }

    /// Option bytes that make one bank of it, until the next reset.
    pub fn make_one_bank(&mut self) {
        self.bank.change(OPTR, |optr| optr.set_bits(DBANK, false));
    }

    /// Reads a word of the second bank; true in the second place if the NMI is to be raised.
    pub fn read_word(&mut self, offset: u32) -> Access<(u32, bool)> {
        if self.work.is_some() {
            return unmodelled("second flash bank", "read while it is busy: the core would be stopped");
        }
        let at = (offset / 8) as usize;
        if self.torn[at] {
            // ECCD, and bank and address of the double word, or ECCC.
            self.eccr = 1 << 31 | if self.is_eccr_spoilt { 1 << 30 } else { 1 << 21 | (offset / 8) };
        }
        Ok((self.words[at][(offset / 4 % 2) as usize], self.torn[at]))
    }

    /// Writes a word of the second bank: the second of a pair starts the programming.
    pub fn write_word(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        if self.bank.at(CR) & 1 == 0 || self.work.is_some() {
            return unmodelled("second flash bank", "written without FLASH_CR_PG or while it is busy");
        }
        match self.half.take() {
            None if offset.is_multiple_of(8) => self.half = Some((offset, value)),
            Some((first, low)) if first + 4 == offset => {
                let at = (first / 8) as usize;
                if self.words[at] != [!0; 2] || self.torn[at] {
                    // PROGERR.
                    self.sr |= 1 << 3;
                    return Ok(());
                }
                self.begin(Work::Program { at, word: [low, value] }, now + PROGRAM_CYCLES)?;
            }
            _ => return unmodelled("second flash bank", "written other than as aligned double words, low word first"),
        }
        Ok(())
    }

    /// Whether it erases or programs.
    pub fn is_busy(&self) -> bool {
        self.work.is_some()
    }

    /// Puts two words into the second bank, as a programmer would.
    pub fn plant(&mut self, offset: u32, word: [u32; 2]) {
        self.words[(offset / 8) as usize] = word;
        self.torn[(offset / 8) as usize] = false;
    }

    /// What the second bank holds at `offset`, as a programmer would read it.
    pub fn peek(&self, offset: u32) -> [u32; 2] {
        self.words[(offset / 8) as usize]
    }
}

impl Default for Flash {
    fn default() -> Flash {
        Flash::new()
    }
}
