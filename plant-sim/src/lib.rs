//! The plant: parameters, port-Hamiltonian hysteron model, exact stepping, the chain of parts, experiments and logs.
//!
//! Host only, f64, SI units inside. What it does not do: fitting, judging or drawing (`gap-diagnosis`), and opening ports.

pub mod bouc_wen;
pub mod chain;
pub mod controller;
pub mod design;
pub mod effects;
pub mod exact;
pub mod experiment;
pub mod linear;
pub mod log;
pub mod margins;
pub mod metrics;
pub mod model;
pub mod operators;
pub mod param;
pub mod phs;
pub mod reduce;
pub mod replay;
mod resample;
pub mod spec;
pub mod stability;
mod toml_file;
mod toml_layout;
pub mod whole_file;

pub use toml_file::FileError;
