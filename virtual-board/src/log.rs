//! The image's log: defmt frames out of the RTT buffer in its memory, as a debug probe takes them, turned into text by the tables in the ELF.

use crate::machine::Machine;
use defmt_decoder::{DecodeError, Table};

/// Offset of the first up channel in the control block: the identifier and two counts come before it.
const CHANNEL: u32 = 24;

/// Reads the log of one image.
pub struct Log {
    table: Option<Table>,
    /// Where the image keeps its control block.
    block: Option<u32>,
    pending: Vec<u8>,
}

impl std::fmt::Debug for Log {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Log").field("block", &self.block).finish_non_exhaustive()
    }
}

impl Log {
    /// `elf` is the image's file, `block` its symbol `_SEGGER_RTT`. An image without a log has none.
    pub fn new(elf: &[u8], block: Option<u32>) -> Log {
        Log { table: Table::parse(elf).ok().flatten(), block, pending: Vec::new() }
    }

    /// What was logged since the last time, one line each. Takes it out of the buffer, so that there is room again.
    pub fn take(&mut self, machine: &Machine) -> Vec<String> {
        let (Some(table), Some(block)) = (&self.table, self.block) else {
            return Vec::new();
        };
        let word = |at: u32| machine.word(block + CHANNEL + at).unwrap_or(0);
        // Name, buffer, size, write, read.
        let (buffer, size, write, mut read) = (word(4), word(8), word(12), word(16));
        if size == 0 || size > 65_536 || write >= size || read >= size {
            return Vec::new();
        }
        while read != write {
            let at = buffer + read;
            let byte = machine.word(at & !3).unwrap_or(0) >> (8 * (at & 3));
            self.pending.push(byte as u8);
            read = (read + 1) % size;
        }
        machine.set_word(block + CHANNEL + 16, read);
        let mut lines = Vec::new();
        let mut decoder = table.new_stream_decoder();
        decoder.received(&self.pending);
        loop {
            match decoder.decode() {
                Ok(frame) => lines.push(frame.display_message().to_string()),
                // Frames are encoded so that the next one is found behind a damaged one.
                Err(DecodeError::Malformed) if table.encoding().can_recover() => {}
                Err(_) => break,
            }
        }
        // Whatever is left belongs to a frame that is not whole yet; rzCOBS frames end in 0.
        let whole = self.pending.iter().rposition(|byte| *byte == 0).map_or(0, |at| at + 1);
        self.pending.drain(..whole);
        lines
    }
}
