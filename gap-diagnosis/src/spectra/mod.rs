//! Spectra of logs: what repeats, frequency response, power density, best linear approximation with its distortions.
//!
//! Slices in, plain structs out, SI units. What it does not do: read logs, decide what a distortion means.

mod period;

pub use period::{Repeats, repeats};
