//! Tests that may run side by side, as one program: one for each file would take a minute more to build, and a slow test would hold up
//! all files after it.

mod around;
mod chain;
mod design;
mod effects;
mod energy;
mod exact;
mod joined;
mod kinds;
mod log_bad_input;
mod log_round_trip;
mod margins;
mod metrics;
mod model;
mod operators;
mod parts;
mod phs;
mod short_way;
mod spec;
mod stability;
mod starts;
