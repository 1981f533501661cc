//! Diagnosis.
pub mod bench;
pub mod descend;
pub mod evidence;
pub mod judge;
pub mod lines;
pub mod normal;
pub mod records;
pub mod screen;
pub mod search;
pub mod spread;
pub mod symmetry;
