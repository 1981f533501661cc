//! The control law of a hysteretic piezo actuator, written once.
#![no_std]

#[cfg(test)]
extern crate std;

mod arithmetic;
mod codes;
mod fault;
mod generator;
mod guard;
mod law;
mod limits;
mod mode;
mod pi;
mod ramp;
mod settings;
mod shaper;
mod sine;

pub use codes::{AdcCode, Calibration, CalibrationSettings, DacCode};
pub use fault::FaultCode;
pub use generator::{Generator, GeneratorState, Segment, SegmentError, samples_in};
pub use guard::{Guard, GuardState};
pub use law::{Law, LawState, Output};
pub use limits::Limits;
pub use mode::{Action, Command, Controller, Input, Mode, ModeName, Refused};
pub use pi::{Pi, PiState};
pub use ramp::Ramp;
pub use settings::{Settings, SettingsError};
pub use shaper::{Shaper, ShaperState};
pub use sine::{sine_of_phase, triangle_of_phase};
