//! Frames: header, CRC, COBS, and the receiver that finds them in a stream of bytes. It knows no message.

use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};

/// Version of the messages and of all they contain. Raised by every change that an older receiver would misread.
pub const VERSION: u8 = 1;

/// Longest message. Chosen: a stream block of 48 samples with its numbers; a board has four such buffers.
pub const MAX_MESSAGE_BYTES: usize = 512;

const HEADER_BYTES: usize = 3;
const CRC_BYTES: usize = 4;
const MAX_FRAME_BYTES: usize = HEADER_BYTES + MAX_MESSAGE_BYTES + CRC_BYTES;

/// Longest frame on the line: COBS adds one byte per 254 and one more, then comes the 0.
pub const MAX_ENCODED_BYTES: usize = MAX_FRAME_BYTES + MAX_FRAME_BYTES / 254 + 2;

/// One table of 1 KB: a board spends about 8 cycles a byte on it, 1.5 % of its time at 3 Mbaud.
static CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Why bytes are no frame, or a frame no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WireError {
    /// More bytes without a 0 than the longest frame has; they were dropped up to the next 0.
    TooLong,
    /// Fewer bytes than header and CRC take, or no COBS.
    Malformed,
    /// The CRC does not fit: the frame was damaged on its way.
    Crc,
    /// A whole frame of another version of these messages.
    Version {
        /// The sender's version.
        theirs: u8,
    },
    /// The frame is whole, but its content is no message that this version knows.
    Unknown,
    /// The message does not fit a frame, or the frame not the buffer.
    NoRoom,
}

impl fmt::Display for WireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WireError::TooLong => {
                write!(f, "link: more than {MAX_ENCODED_BYTES} bytes without an end of frame: check the baud rate")
            }
            WireError::Malformed => f.write_str("link: bytes that are no frame: check baud rate and wiring"),
            WireError::Crc => f.write_str("link: a frame was damaged (CRC): check the cable"),
            WireError::Version { theirs } => write!(
                f,
                "link: the other end speaks version {theirs}, this one version {VERSION}: flash the firmware of this release"
            ),
            WireError::Unknown => {
                f.write_str("link: a whole frame with an unknown message: flash the firmware of this release")
            }
            WireError::NoRoom => {
                write!(f, "link: the message is longer than {MAX_MESSAGE_BYTES} bytes: send it in parts")
            }
        }
    }
}

impl core::error::Error for WireError {}

/// Makes frames and numbers them.
#[derive(Clone, Debug, Default)]
pub struct Sender {
    sequence: u16,
}

impl Sender {
    /// The sequence number that the next frame will have.
    pub fn next_sequence(&self) -> u16 {
        self.sequence
    }

    /// Writes `message` as a frame with its closing 0 into `bytes` and returns its length. On an error no number is used up.
    ///
    /// # Errors
    ///
    /// [`WireError::NoRoom`].
    pub fn encode<M: Serialize + ?Sized>(&mut self, message: &M, bytes: &mut [u8]) -> Result<usize, WireError> {
        let mut plain = [0_u8; MAX_FRAME_BYTES];
        plain[0] = VERSION;
        plain[1..HEADER_BYTES].copy_from_slice(&self.sequence.to_le_bytes());
        let body = &mut plain[HEADER_BYTES..HEADER_BYTES + MAX_MESSAGE_BYTES];
        let message_bytes = postcard::to_slice(message, body).map_err(|_| WireError::NoRoom)?.len();
        let end = HEADER_BYTES + message_bytes;
        let crc = CRC.checksum(&plain[..end]);
        plain[end..end + CRC_BYTES].copy_from_slice(&crc.to_le_bytes());
        let whole = end + CRC_BYTES;
        // `cobs` panics where a buffer is too small; its own bound is the one checked here.
        if bytes.len() < cobs::max_encoding_length(whole) + 1 {
            return Err(WireError::NoRoom);
        }
        let encoded = cobs::encode(&plain[..whole], bytes);
        bytes[encoded] = 0;
        self.sequence = self.sequence.wrapping_add(1);
        Ok(encoded + 1)
    }
}

/// A whole, undamaged frame of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The sender's number.
    pub sequence: u16,
    body: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Reads the message: [`crate::ToBoard`] on a board, [`crate::ToHost`] on a host.
    ///
    /// # Errors
    ///
    /// [`WireError::Unknown`]; also for bytes left over, because a message that is read only in part is misread.
    pub fn message<M: Deserialize<'a>>(&self) -> Result<M, WireError> {
        match postcard::take_from_bytes(self.body) {
            Ok((message, [])) => Ok(message),
            _ => Err(WireError::Unknown),
        }
    }
}

/// Finds frames in a stream of bytes.
#[derive(Clone, Debug)]
pub struct Receiver {
    bytes: [u8; MAX_ENCODED_BYTES],
    filled: usize,
    /// The present frame is too long; its rest is dropped.
    is_skipping: bool,
    /// The last call handed out a frame, which lies in `bytes` until now.
    is_handed_out: bool,
}

impl Default for Receiver {
    fn default() -> Receiver {
        Receiver::new()
    }
}

impl Receiver {
    /// Nothing received yet.
    pub const fn new() -> Receiver {
        Receiver { bytes: [0; MAX_ENCODED_BYTES], filled: 0, is_skipping: false, is_handed_out: false }
    }

    /// Takes one byte. `Some` at the end of a frame, or of something that should have been one. Zeros between frames mean nothing.
    ///
    /// # Errors
    ///
    /// Inside of `Some`: [`WireError`]. The next frame is found all the same.
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<'_>, WireError>> {
        if core::mem::take(&mut self.is_handed_out) {
            self.filled = 0;
        }
        if byte != 0 {
            match self.bytes.get_mut(self.filled) {
                Some(place) => {
                    *place = byte;
                    self.filled += 1;
                }
                None => self.is_skipping = true,
            }
            return None;
        }
        self.is_handed_out = true;
        if core::mem::take(&mut self.is_skipping) {
            return Some(Err(WireError::TooLong));
        }
        if self.filled == 0 {
            return None;
        }
        Some(parse(&mut self.bytes[..self.filled]))
    }
}

/// Undoes COBS in place and checks length, CRC and version, in this order: a version is only believed of an undamaged frame.
fn parse(encoded: &mut [u8]) -> Result<Frame<'_>, WireError> {
    let length = cobs::decode_in_place(encoded).map_err(|_| WireError::Malformed)?;
    let plain = encoded.get(..length).ok_or(WireError::Malformed)?;
    let (content, crc) = plain.split_last_chunk::<CRC_BYTES>().ok_or(WireError::Malformed)?;
    let ([version, low, high], body) = content.split_first_chunk::<HEADER_BYTES>().ok_or(WireError::Malformed)?;
    if CRC.checksum(content) != u32::from_le_bytes(*crc) {
        return Err(WireError::Crc);
    }
    if *version != VERSION {
        return Err(WireError::Version { theirs: *version });
    }
    Ok(Frame { sequence: u16::from_le_bytes([*low, *high]), body })
}

/// The CRC of a frame, for records that are kept and not sent.
pub fn crc32(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// Writes a value as messages are written, without a frame; `None` where it does not fit.
pub fn to_bytes<T: Serialize>(value: &T, bytes: &mut [u8]) -> Option<usize> {
    postcard::to_slice(value, bytes).ok().map(|written| written.len())
}

/// Reads a value that [`to_bytes`] wrote; `None` if it is none, or if bytes are left over.
pub fn from_bytes<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Some(value),
        _ => None,
    }
}

/// Counts the frames that never came, from the gaps in their numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Missed {
    expected: Option<u16>,
    missed: u32,
}

impl Missed {
    /// Takes a frame's number; returns how many are missing before it (65535 for one that came twice or out of order).
    pub fn note(&mut self, sequence: u16) -> u16 {
        let gap = self.expected.map_or(0, |expected| sequence.wrapping_sub(expected));
        self.expected = Some(sequence.wrapping_add(1));
        self.missed = self.missed.saturating_add(u32::from(gap));
        gap
    }

    /// All gaps together.
    pub fn total(&self) -> u32 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crc_is_the_one_of_zlib() {
        // The check value of the CRC catalogue for "123456789".
        assert_eq!(CRC.checksum(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn a_frame_is_as_the_byte_table_says() {
        let mut bytes = [0; MAX_ENCODED_BYTES];
        let mut sender = Sender { sequence: 0x0102 };
        let n = sender.encode(&7_u8, &mut bytes).expect("room");
        let mut plain = bytes;
        let length = cobs::decode_in_place(&mut plain[..n - 1]).expect("COBS");
        assert_eq!(plain[..4], [VERSION, 2, 1, 7]);
        assert_eq!(plain[4..length], CRC.checksum(&plain[..4]).to_le_bytes());
        assert_eq!(bytes[n - 1], 0);
        assert!(bytes[..n - 1].iter().all(|byte| *byte != 0));
        assert_eq!(sender.next_sequence(), 0x0103);
    }

    #[test]
    fn a_message_too_long_is_an_error_and_uses_no_number() {
        let mut bytes = [0; MAX_ENCODED_BYTES];
        let mut sender = Sender::default();
        let long = [1_u8; MAX_MESSAGE_BYTES];
        assert_eq!(sender.encode(&long[..], &mut bytes), Err(WireError::NoRoom));
        assert_eq!(sender.encode(&long[..9], &mut bytes[..4]), Err(WireError::NoRoom));
        assert_eq!(sender.next_sequence(), 0);
        // The longest one just fits: its length takes two bytes.
        assert!(sender.encode(&long[..MAX_MESSAGE_BYTES - 2], &mut bytes).is_ok());
    }

    #[test]
    fn another_version_is_said_and_not_read() {
        let mut plain = [0_u8; 8];
        plain[0] = VERSION + 1;
        let crc = CRC.checksum(&plain[..4]);
        plain[4..].copy_from_slice(&crc.to_le_bytes());
        let mut bytes = [0; 16];
        let n = cobs::encode(&plain, &mut bytes);
        let mut receiver = Receiver::new();
        for byte in &bytes[..n] {
            assert!(receiver.push(*byte).is_none());
        }
        assert_eq!(receiver.push(0), Some(Err(WireError::Version { theirs: VERSION + 1 })));
    }

    #[test]
    fn gaps_are_counted_through_the_wrap() {
        let mut missed = Missed::default();
        assert_eq!([65534, 65535, 0, 3, 4].map(|sequence| missed.note(sequence)), [0, 0, 0, 2, 0]);
        assert_eq!(missed.total(), 2);
    }
}
