//! Tests that may run side by side, as one program: one for each file would take a minute more to build, and a slow test would hold up
//! all files after it.

mod bad_input;
mod closed_loop;
mod compare;
mod demo;
mod design;
mod diagnose;
mod effects;
mod export;
mod memory;
mod reference;
mod replay;
mod support;
