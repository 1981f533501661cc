//! The control law of a hysteretic piezo actuator, written once: the same f32 code runs on the board, over the bridge and in the
//! simulation, and gives the same bits everywhere.
//!
//! PI with feedforward in physical units ([`Law`]), feedforward that inverts a plant with hysterons ([`Inverse`]), volt and slew limits with anti-windup ([`Pi`]), reference clamp and
//! shaping ([`Shaper`]), displacement trip ([`Guard`]), waveforms ([`Generator`]), the mode machine of a board
//! ([`Controller`]), and the conversion between codes, volts and metres ([`Calibration`]).
//!
//! What it does not do: no I/O, no clock (the caller steps once per sample), no allocation, no estimation, no knowledge of
//! the plant. It promises its own outputs, for every input; it can't promise what the plant does with them.
//!
//! Conventions: SI units, the unit at the end of a name (`drive_v`, `reference_m`, `rate_hz`); what is configured and what is
//! remembered are two types; errors exist only where something is built. Only IEEE + - * / of f32 and integers are
//! used at run time, no libm, no fused operations; subnormals must not be flushed (the Cortex-M4F does not by default).
//!
//! # Example
//!
//! A closed loop around the crudest plant there is, a gain of 1.88 um/V with a lag of 0.2 ms.
//!
//! ```
//! use control_core::{Command, Controller, Generator, Input, Law, Segment, Settings};
//!
//! let rate_hz = 20e3;
//! let law = Law::try_build(&Settings {
//!     rate_hz,
//!     kp_v_per_m: 2e4,
//!     ki_v_per_m_s: 5e8,
//!     feedforward_v_per_m: 530_737.0,
//!     drive_min_v: -90.0,
//!     drive_max_v: 90.0,
//!     slew_v_per_s: 2e5,
//!     reference_max_m: Settings::DEFAULT_REFERENCE_MAX_M,
//!     reference_rate_m_per_s: 0.1,
//!     reference_acceleration_m_per_s2: 200.0,
//!     trip_m: Settings::DEFAULT_TRIP_M,
//!     stop_time_s: 100e-6,
//! })?;
//! let steps = [Segment::step(80e-6, 400)?, Segment::hold(20e-6, 400)?];
//! let generator = Generator::new(&steps);
//! let mut controller = Controller::new(law);
//! controller.arm()?;
//! controller.run()?;
//! let mut displacement_m = 0.0_f32;
//! for _ in 0..800 {
//!     let output = controller.tick(&Input {
//!         command: Command::GeneratedReference(generator),
//!         measured_m: displacement_m,
//!     });
//!     displacement_m += (1.88e-6 * output.drive_v - displacement_m) * 0.25;
//! }
//! // 20 ms after the second step the loop is there to the nanometre: its integral needs 1.1 ms (1 / (Ki 1.88 um/V)).
//! assert!((displacement_m - 20e-6).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]

#[cfg(test)]
extern crate std;

mod arithmetic;
mod codes;
mod fault;
mod generator;
mod guard;
mod inverse;
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
pub use inverse::{Inverse, InverseHysteron, InverseSettings, InverseState, MOST_HYSTERONS};
pub use law::{Law, LawState, Output};
pub use limits::Limits;
pub use mode::{Action, Command, Controller, Input, Mode, ModeName, Refused};
pub use pi::{Pi, PiState};
pub use ramp::Ramp;
pub use settings::{Settings, SettingsError};
pub use shaper::{Shaper, ShaperState};
pub use sine::{sine_of_phase, triangle_of_phase};
