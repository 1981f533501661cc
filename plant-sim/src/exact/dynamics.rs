//! What the engine steps: a linear system, its dead zones, and the scales that make its matrix comparable across units.

use crate::phs::Phs;
use nalgebra::{DMatrix, DVector};

/// Largest number of states that an engine is compiled for: 30 hysterons and the two mechanical states.
pub const MAX_STATES: usize = 32;

/// Index of the displacement in the state vector.
pub(crate) const DISPLACEMENT: usize = 0;
/// Index of the velocity in the state vector.
pub(crate) const VELOCITY: usize = 1;

/// One dead zone: state `state` leaks at `rate_per_s` by what it exceeds `edge` in magnitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadZone {
    /// Index of the state that carries the dead zone.
    pub state: usize,
    /// Magnitude at which it opens, in the state's unit (volts).
    pub edge: f64,
    /// beta/C, rate of the leak beyond the edge, 1/s.
    pub rate_per_s: f64,
    /// alpha/C, change of the state per metre of displacement inside the dead zone, V/m.
    pub per_metre: f64,
}

/// x' = A x + b f + leaks, with the velocity as state 1 and every dead zone driven by it.
#[derive(Clone, Debug)]
pub struct Dynamics {
    /// A with every dead zone closed.
    pub(crate) closed: DMatrix<f64>,
    /// b, response of x' to one newton.
    pub(crate) force: DVector<f64>,
    /// The dead zones that can open and close.
    pub(crate) dead_zones: Vec<DeadZone>,
    /// Typical magnitude of each state relative to the others (energy coordinates), for norms.
    pub(crate) scale: DVector<f64>,
    /// Bound on the rates with which the velocity can turn, 1/s.
    pub(crate) turning_rate_per_s: f64,
}

impl Dynamics {
    /// States of the system.
    pub fn states(&self) -> usize {
        self.closed.nrows()
    }

    /// The dead zones, in the order of the region's signs.
    pub fn dead_zones(&self) -> &[DeadZone] {
        &self.dead_zones
    }

    /// Bound on every rate of a matrix over these states: its infinity norm in energy coordinates, where all entries are rates.
    pub(crate) fn fastest_rate_per_s(&self, entry: impl Fn(usize, usize) -> f64) -> f64 {
        let states = self.states();
        (0..states)
            .map(|i| (0..states).map(|j| (entry(i, j) * self.scale[j] / self.scale[i]).abs()).sum())
            .fold(0.0, f64::max)
    }

    /// The port-Hamiltonian plant in the states [q, q', v1 .. vn].
    pub fn of_plant(plant: &Phs) -> Self {
        let n = plant.hysterons.len();
        let (m, k, b, alpha) =
            (plant.mass_kg, plant.stiffness_n_per_m, plant.damping_n_s_per_m, plant.transduction_c_per_m);
        let mut closed = DMatrix::zeros(n + 2, n + 2);
        closed[(DISPLACEMENT, VELOCITY)] = 1.0;
        closed[(VELOCITY, DISPLACEMENT)] = -k / m;
        closed[(VELOCITY, VELOCITY)] = -b / m;
        let mut scale = DVector::from_element(n + 2, 1.0);
        scale[DISPLACEMENT] = 1.0 / k.sqrt();
        scale[VELOCITY] = 1.0 / m.sqrt();
        let mut dead_zones = Vec::new();
        let mut stiffness = k;
        for (i, hysteron) in plant.hysterons.iter().enumerate() {
            let state = 2 + i;
            closed[(VELOCITY, state)] = -alpha / m;
            closed[(state, VELOCITY)] = alpha / hysteron.capacitance_f;
            scale[state] = 1.0 / hysteron.capacitance_f.sqrt();
            stiffness += alpha * alpha / hysteron.capacitance_f;
            let rate_per_s = hysteron.slope_s / hysteron.capacitance_f;
            if hysteron.dead_zone_v == 0.0 {
                // Without a dead zone the leak is always open, whatever the sign: a linear creep element, no switch.
                closed[(state, state)] = -rate_per_s;
            } else if rate_per_s > 0.0 {
                dead_zones.push(DeadZone {
                    state,
                    edge: hysteron.edge_v(),
                    rate_per_s,
                    per_metre: alpha / hysteron.capacitance_f,
                });
            }
        }
        let mut force = DVector::zeros(n + 2);
        force[VELOCITY] = 1.0 / m;
        Self { closed, force, dead_zones, scale, turning_rate_per_s: (stiffness / m).sqrt() + b / m }
    }
}
