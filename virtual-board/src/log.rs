//! The image's log: defmt frames out of the RTT buffer in its memory, as a debug probe takes them, made text by the ELF's table.
//!
//! Only the formats that our image uses: `{=u8}`, `{=u16}`, `{=usize}`, `{=str}`. defmt's own decoder knows all, but brings eighteen crates and a
//! copyleft licence along; what is unknown here is shown as `?` and never guessed.

use crate::machine::Machine;
use std::collections::BTreeMap;

/// Offset of the first up channel in the control block: the identifier and two counts come before it.
const CHANNEL: u32 = 24;

/// Reads the log of one image.
#[derive(Debug)]
pub struct Log {
    /// Format strings by index.
    formats: BTreeMap<u16, String>,
    /// Where the image keeps its control block.
    block: Option<u32>,
    pending: Vec<u8>,
}

impl Log {
    /// `symbols` are the image's: those that are JSON with a tag of defmt's are format strings, their addresses the indices.
    pub fn new<'a>(symbols: impl Iterator<Item = (&'a str, u32)>) -> Log {
        let mut log = Log { formats: BTreeMap::new(), block: None, pending: Vec::new() };
        for (name, address) in symbols {
            if name == "_SEGGER_RTT" {
                log.block = Some(address);
            }
            let value = serde_json::from_str::<serde_json::Value>(name).unwrap_or_default();
            if let (Some(tag), Some(data)) = (value["tag"].as_str(), value["data"].as_str())
                && tag.starts_with("defmt_")
            {
                log.formats.insert(address as u16, data.to_owned());
            }
        }
        log
    }

    /// What was logged since the last time, one line each. Takes it out of the buffer, so that there is room again.
    pub fn take(&mut self, machine: &Machine) -> Vec<String> {
        let Some(block) = self.block else {
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
        // A frame ends in 0; what is left is not whole yet.
        let whole = self.pending.iter().rposition(|byte| *byte == 0).map_or(0, |at| at + 1);
        let frames: Vec<u8> = self.pending.drain(..whole).collect();
        frames.split(|byte| *byte == 0).filter(|frame| !frame.is_empty()).map(|frame| self.line(frame)).collect()
    }

    fn line(&self, frame: &[u8]) -> String {
        let bytes = decode(frame).unwrap_or_default();
        let Some(([low, high], arguments)) = bytes.split_first_chunk() else {
            return "(a damaged frame)".to_owned();
        };
        let index = u16::from_le_bytes([*low, *high]);
        self.formats.get(&index).map_or_else(|| format!("(an unknown format {index})"), |text| fill_in(text, arguments))
    }
}

/// Undoes rzCOBS, which is read from its end: a byte below 0x80 says which of seven were 0, one above how many go before a 0.
fn decode(frame: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut rest = frame.iter().rev();
    while let Some(head) = rest.next() {
        match head {
            0 => return None,
            1..=0x7f => {
                for bit in (0..7).rev() {
                    bytes.push(if head >> bit & 1 == 0 { *rest.next()? } else { 0 });
                }
            }
            0x80..=0xfe => {
                bytes.push(0);
                for _ in 0..(head & 0x7f) + 7 {
                    bytes.push(*rest.next()?);
                }
            }
            0xff => {
                for _ in 0..134 {
                    bytes.push(*rest.next()?);
                }
            }
        }
    }
    bytes.reverse();
    Some(bytes)
}

/// Puts the arguments into a format string.
fn fill_in(format: &str, mut arguments: &[u8]) -> String {
    let mut take = |n: usize| -> Option<&[u8]> {
        let (taken, rest) = arguments.split_at_checked(n)?;
        arguments = rest;
        Some(taken)
    };
    let mut number = |n: usize| Some(take(n)?.iter().rev().fold(0_u32, |value, byte| value << 8 | u32::from(*byte)));
    let mut text = String::new();
    let mut rest = format;
    while let Some((before, after)) = rest.split_once('{') {
        text.push_str(before);
        let Some((kind, after)) = after.split_once('}') else { break };
        rest = after;
        let value = match kind {
            "=u8" => number(1).map(|value| value.to_string()),
            "=u16" => number(2).map(|value| value.to_string()),
            "=u32" | "=usize" => number(4).map(|value| value.to_string()),
            "=str" => number(4).and_then(|length| {
                let mut bytes = Vec::new();
                for _ in 0..length.min(1024) {
                    bytes.push(number(1)? as u8);
                }
                Some(String::from_utf8_lossy(&bytes).into_owned())
            }),
            _ => None,
        };
        text.push_str(value.as_deref().unwrap_or("?"));
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_read_from_their_end() {
        // A 0 is never inside of a frame.
        assert_eq!(decode(&[1, 2, 0]), None);
        // Six of seven are 0; read from the end, the first bit is the last byte.
        assert_eq!(decode(&[5, 0b0011_1111]), Some(vec![0, 0, 0, 0, 0, 0, 5]));
        assert_eq!(decode(&[9]), None);
    }

    #[test]
    fn formats_are_filled_in_and_unknown_ones_are_not_guessed() {
        assert_eq!(fill_in("request {=u16}, {=usize} waiting", &[2, 1, 3, 0, 0, 0]), "request 258, 3 waiting");
        assert_eq!(fill_in("{=str}: {=u8}", &[2, 0, 0, 0, b'o', b'k', 7]), "ok: 7");
        assert_eq!(fill_in("{=f32} {=u8}", &[1]), "? 1");
        assert_eq!(fill_in("{=u16}", &[1]), "?");
    }
}
