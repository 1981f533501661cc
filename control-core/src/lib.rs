//! The control law of a hysteretic piezo actuator, written once.
#![no_std]

#[cfg(test)]
extern crate std;

mod arithmetic;
mod generator;
mod guard;
mod law;
mod limits;
mod pi;
mod settings;
mod shaper;
mod sine;

pub use generator::{Generator, GeneratorState, Segment, SegmentError, samples_in};
pub use guard::{Guard, GuardState};
pub use law::{Law, LawState, Output};
pub use limits::Limits;
pub use pi::{Pi, PiState};
pub use settings::{Settings, SettingsError};
pub use shaper::{Shaper, ShaperState};
pub use sine::{sine_of_phase, triangle_of_phase};
