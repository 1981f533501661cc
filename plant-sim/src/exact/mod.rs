//! Exact stepping of a linear system with dead zones: no step-size error, whatever the stiffness.
//!
//! Between switches the system is affine, x' = A_r x + b f + c_r, with one region r per combination of dead-zone states (inside,
//! open upwards, open downwards), so that a matrix exponential carries the state over any interval in which no dead zone is
//! entered or left. What remains is to know that none was, and to find the instant when one was:
//!
//! * Each duration is halved down to a finest step on which a Taylor polynomial is exact to rounding. Scaling and squaring makes
//!   the maps of all those halves on its way to the full one, so the whole ladder of maps costs what the last map costs.
//! * A hysteron inside its dead zone moves monotonically while the velocity keeps its sign, and one outside can cross its edge at
//!   most once. So a move is accepted when the region is the same at its end and the velocity provably kept its sign (a cubic
//!   through values and slopes at both ends, with margin), or when no dead zone could have been reached at all. Otherwise it is
//!   shortened, to where straight lines would meet the edge or by half. This also catches an edge that is crossed and crossed back within one move.
//! * On the finest step the crossing is a root of the Taylor polynomial.
//!
//! Not here: what the states mean ([`crate::phs`]), and what happens to the input before it becomes a force ([`crate::chain`]).

mod dynamics;
pub mod energy;
mod engine;
mod maps;
mod push;

pub use dynamics::{DeadZone, Dynamics, MAX_STATES};
pub use engine::Engine;
pub use push::{Push, Spans};

use crate::phs::{Phs, PhsState};

/// An engine for as many states as the dynamics have, padded to the next compiled size.
///
/// The sizes are compiled one by one because the inner loop is a small dense product that the compiler unrolls.
pub fn stepper(dynamics: &Dynamics, spans: Spans) -> Box<dyn Stepper> {
    match dynamics.states() {
        0..=4 => Box::new(Engine::<4>::new(dynamics, spans)),
        5..=6 => Box::new(Engine::<6>::new(dynamics, spans)),
        7..=8 => Box::new(Engine::<8>::new(dynamics, spans)),
        9..=12 => Box::new(Engine::<12>::new(dynamics, spans)),
        13..=20 => Box::new(Engine::<20>::new(dynamics, spans)),
        _ => Box::new(Engine::<MAX_STATES>::new(dynamics, spans)),
    }
}

/// What the chain needs of an engine, whatever its size.
pub trait Stepper: Send {
    /// Moves the state over span `span` (an index into [`Spans`]) with the force held at `force_n` plus `slope_n_per_s` times time.
    fn advance(&mut self, span: usize, force_n: f64, slope_n_per_s: f64);
    /// Moves the state over span 0 with the first force held, then over span 1 with the second.
    fn advance_both(&mut self, forces_n: [f64; 2]);
    /// Moves the state over span `span` with the force `push`.
    fn push(&mut self, span: usize, push: Push);
    /// Holds the force of each sample over the whole of span 0 and writes the displacement at the sample's start.
    ///
    /// One call for a whole record: the open-loop case without a call per sample.
    fn record(&mut self, forces_n: &mut dyn Iterator<Item = f64>, displacement_m: &mut Vec<f64>);
    /// State `index`: 0 displacement in metres, 1 velocity in m/s, then hysteron voltages.
    fn state(&self, index: usize) -> f64;
    /// All states, padded with zeros.
    fn states(&self) -> &[f64];
    /// Replaces the state.
    fn set_state(&mut self, state: &[f64]);
    /// Constant additions to the rates of the states for the moves to come: what a sub-step makes of a law that is not affine. A dead
    /// zone's own state may then turn without the velocity, which the search for crossings doesn't expect; it stays right to the size
    /// of that addition over a sub-step.
    fn set_rates(&mut self, rates: Option<&[f64]>);
    /// Region maps made so far: what set-up cost, and a check that a long run does not keep building.
    fn regions_built(&self) -> usize;
}

/// The state vector of the plant in the order that the engine uses: [q, q', v1 .. vn].
pub fn pack(state: &PhsState) -> Vec<f64> {
    let mut packed = vec![state.displacement_m, state.velocity_m_per_s];
    packed.extend_from_slice(&state.hysteron_v);
    packed
}

/// The inverse of [`pack`] for a plant with `hysterons` hysterons.
pub fn unpack(stepper: &dyn Stepper, hysterons: usize) -> PhsState {
    PhsState {
        displacement_m: stepper.state(0),
        velocity_m_per_s: stepper.state(1),
        hysteron_v: (0..hysterons).map(|i| stepper.state(2 + i)).collect(),
    }
}

impl From<&Phs> for Dynamics {
    fn from(plant: &Phs) -> Self {
        Dynamics::of_plant(plant)
    }
}
