//! Identification and diagnosis of the gap between a simulation and a bench, and the reports about them.
//!
//! What it does not do: simulate (`plant-sim`), open ports, read command lines.

pub mod diagnose;
pub mod identify;
pub mod locate;
pub mod page;
pub mod reproduce;
pub mod residual;
pub mod responses;
pub mod score;
pub mod spectra;
