//! The blind check's plan, seal, runner and books; `commands/blind_check.rs` puts them together.
//!
//! Not here: how a case is made (`blind-truth`) and what an answer is worth (`gap_diagnosis::score`).

pub mod again;
pub mod books;
pub mod made;
pub mod measured;
pub mod plan;
pub mod runner;
pub mod store;
pub mod verify;
