//! The virtual board: the very flash image on an emulated STM32G474, its pins joined to the simulated plant.
//!
//! [`image`] reads the ELF, [`machine`] runs rsemu's core with the strict register models of [`chip`], [`mod@bench`] is amplifier, plant
//! and sensor, [`host`] speaks to the image over its line, [`run`] is one
//! experiment from handshake to report, [`serve`] opens the line to hosts outside (TCP, pseudo-terminal). What the models don't know is an error that names it: the image never runs on guesses.
//!
//! What it does not do: no control law (the image has it), no flash wait states, no analog errors of the converters. Cycles are those of the
//! core's model; they are not measured on silicon.

pub mod bench;
pub mod chip;
pub mod host;
pub mod image;
pub mod log;
pub mod machine;
pub mod run;
pub mod serve;
pub mod waveform;

pub use bench::{Bench, BenchSettings, CORE_HZ, Wire};
pub use chip::{Chip, Reset, Row};
pub use host::{BoardError, Heard, VirtualBoard};
pub use image::{Image, ImageError};
pub use machine::{Cost, Machine, MachineError};
pub use run::step_cycles;
