//! Diagnosis.
pub mod bench;
pub mod descend;
pub mod normal;
