//! The bridge between a board and the simulated plant: links, the conversation over them, the lockstep loop, run directories.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`link`] | bytes to and from a board, and where boards are found |
//! | [`in_process`], [`in_virtual`], [`tcp`], [`serial`] | the links |
//! | [`session`] | handshake, requests and answers over any link; knows no port and reads no clock |
//! | [`statistics`] | what a link does to frames: round trips, losses, damage |
//! | [`faulty`] | a wrapper that damages what passes any link, by a seed |
//! | [`lockstep`] | the loop: the plant's measurement to the board, the board's drive to the plant |
//! | [`paced`] | the same loop in real time, where the link is quick enough |
//! | [`pins`] | a bench on the board's own pins: what the board streams, written down |
//! | [`run_directory`] | a run on disk, readable whatever ended it |
//! | [`experiments`], [`recording`] | sets of experiments for a bench, and several of them on disk |
//!
//! **Lockstep** is hardware in the loop without real time: the plant stands still while the board thinks. The same seed gives the same
//! bits over every link that loses nothing, as fast as the link allows.
//!
//! What it does not do: no control law and no plant of its own, no fitting, no drawing.
//!
//! ```
//! use hil_bridge::{in_process::InProcess, session::Session};
//!
//! let mut session = Session::new(InProcess::nucleo());
//! let identity = session.greet()?;
//! assert_eq!(identity.board, "in-process");
//! # Ok::<(), hil_bridge::session::SessionError>(())
//! ```

pub mod experiments;
pub mod faulty;
pub mod in_process;
pub mod in_virtual;
pub mod link;
pub mod lockstep;
pub mod paced;
pub mod pins;
pub mod recording;
pub mod run_directory;
pub mod serial;
pub mod session;
pub mod statistics;
pub mod tcp;
