//! Diagnosis.
pub mod bench;
pub mod descend;
pub mod lines;
pub mod normal;
pub mod records;
pub mod screen;
pub mod search;
