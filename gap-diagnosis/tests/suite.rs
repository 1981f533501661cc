//! Tests that may run side by side, as one program: one for each file would take a minute more to build, and a slow test would hold up
//! all files after it.

mod bouc_wen_benchmark;
mod common;
mod compare;
mod identify;
mod mirror_benchmark;
mod page;
mod page_browser;
mod page_diagnosis;
mod shared_data;
mod stated_effects;
mod tfest;
mod tracking;
mod tracking_table;
