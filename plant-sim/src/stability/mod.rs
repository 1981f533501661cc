//! Global stability of the PI loop around the hysteron plant.
//!
//! * [`proposition()`]: the thesis' proposition 3.3.1 for any number of hysterons, as printed and with its units put right.
//! * [`lyapunov()`]: the equation behind it, its solution's error bounded.
//! * [`certify()`]: what can be proven, for the continuous law and for the sampled one with its delay.
//!
//! Not here: margins and eigenvalues region by region ([`crate::margins`]), which say nothing on switching between regions.

mod certify;
mod compass;
mod lyapunov;
mod proposition;

pub use certify::{Certificate, Law, certify};
pub use lyapunov::{MAX_ORDER, Solution, lyapunov};
pub use proposition::{Proposition, closed_loop_matrix, proposition};
