//! To be written.
pub mod margins;
