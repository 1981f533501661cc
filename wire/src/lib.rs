//! What goes over the link between a host and a board: frames, messages, the handshake.
//!
//! No I/O, no clock, no allocation: bytes in, messages out, and back. Any bytes at all may come in; none makes it panic.
//!
//! # Byte table
//!
//! A frame, before COBS. Integers are little-endian.
//!
//! | offset | bytes | what |
//! | --- | --- | --- |
//! | 0 | 1 | [`VERSION`] of everything below; the table itself stays as it is in all versions |
//! | 1 | 2 | sequence number of the sender, one more each frame, modulo 65536; gaps are counted, not repaired |
//! | 3 | n | a message in postcard: [`ToBoard`] towards the board, [`ToHost`] from it; n <= [`MAX_MESSAGE_BYTES`] |
//! | 3 + n | 4 | CRC-32 (ISO-HDLC, the one of zlib) over bytes 0 .. 3 + n |
//!
//! The frame is COBS encoded (no byte in it is 0 any more) and ends in one 0. A receiver that meets garbage is back in step after
//! the next 0. CRC-32 finds every error of up to three bits in a frame of this length and lets one in 4.3e9 other errors pass.
//!
//! A sample of a stream or capture, 10 bytes ([`Sample`]):
//!
//! | offset | bytes | what | unit |
//! | --- | --- | --- | --- |
//! | 0 | 2 | reference in use, signed | [`Identity::reference_step_m`] |
//! | 2 | 2 | displacement | ADC code |
//! | 4 | 2 | amplifier monitor | ADC code |
//! | 6 | 2 | drive | DAC code |
//! | 8 | 1 | which limits acted | bits of [`control_core::Limits`] |
//! | 9 | 1 | bits 0-2 mode, 3 overrun, 4 bridge, 5 ENABLE toggling | [`Flags`] |
//!
//! # A conversation
//!
//! [`ToBoard::Hello`] is answered by [`ToHost::Identity`]; [`Identity::check`] says in words why a board can't be worked with.
//! Every other request is answered by [`ToHost::Done`], by [`ToHost::Refused`] with the reason in words, which name the
//! request's sequence number, or by what it asked for. [`ToHost::StreamBlock`] and [`ToHost::Fault`] come by themselves.
//! A frame of another version is answered by [`ToHost::Refused`] with sequence number 0; both sides then know each other's version,
//! because it is the first byte of every frame.
//!
//! ```
//! use wire::{Receiver, Sender, ToBoard};
//!
//! let mut bytes = [0; wire::MAX_ENCODED_BYTES];
//! let mut sender = Sender::default();
//! let n = sender.encode(&ToBoard::Reference { reference_m: 40e-6 }, &mut bytes)?;
//! let mut receiver = Receiver::default();
//! for byte in &bytes[..n] {
//!     if let Some(received) = receiver.push(*byte) {
//!         assert_eq!(received?.message::<ToBoard>()?, ToBoard::Reference { reference_m: 40e-6 });
//!     }
//! }
//! # Ok::<(), wire::WireError>(())
//! ```
#![no_std]

#[cfg(test)]
extern crate std;

mod frame;
mod message;
mod parameters;
pub mod rules;
mod sample;

pub use frame::{
    Frame, MAX_ENCODED_BYTES, MAX_MESSAGE_BYTES, Missed, Receiver, Sender, VERSION, WireError, crc32, from_bytes,
    to_bytes,
};
pub use message::{
    Identity, InputSource, Mismatch, ResetCause, SegmentRecord, Status, StreamReason, ToBoard, ToHost, Trigger, Wave,
};
pub use parameters::{Checked, Converters, ParameterError, Parameters};
pub use sample::{Flags, SAMPLE_BYTES, Sample};
