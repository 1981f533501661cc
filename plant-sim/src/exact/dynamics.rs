//! What the engine steps: a linear system, its dead zones, and the scales that make its matrix comparable across units.

use crate::chain::{Joint, Lag, Mode};
use crate::linear::StateSpace;
use crate::margins::balance;
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

    /// A linear plant whose input in volts takes the place of the force.
    pub fn of_linear(space: &StateSpace) -> Self {
        let mut balanced = space.a.clone();
        let scale = DVector::from_vec(balance(&mut balanced));
        Self { closed: space.a.clone(), force: space.b.clone(), dead_zones: Vec::new(), scale, turning_rate_per_s: 0.0 }
    }

    /// The plant with oscillators, two states [displacement, velocity] each behind those of the plant.
    ///
    /// An attached one feels the moving mass and pulls at it; a parallel one feels the force alone and is seen by the sensor.
    pub fn with_modes(plant: &Phs, modes: &[Mode]) -> Self {
        let mut dynamics = Self::of_plant(plant);
        let m = plant.mass_kg;
        for mode in modes {
            let states = dynamics.states();
            let (position, velocity) = (states, states + 1);
            let mut a = dynamics.closed.resize(states + 2, states + 2, 0.0);
            let mut force = dynamics.force.clone().resize_vertically(states + 2, 0.0);
            let mut scale = dynamics.scale.clone().resize_vertically(states + 2, 1.0);
            let w = std::f64::consts::TAU * mode.hz;
            let (spring, damper) = (w * w, 2.0 * mode.damping_ratio * w);
            a[(position, velocity)] = 1.0;
            a[(velocity, position)] = -spring;
            a[(velocity, velocity)] = -damper;
            let share = match mode.joint {
                Joint::Attached { mass_kg } => {
                    a[(velocity, DISPLACEMENT)] = spring;
                    a[(velocity, VELOCITY)] = damper;
                    let ratio = mass_kg / m;
                    a[(VELOCITY, DISPLACEMENT)] -= ratio * spring;
                    a[(VELOCITY, VELOCITY)] -= ratio * damper;
                    a[(VELOCITY, position)] += ratio * spring;
                    a[(VELOCITY, velocity)] += ratio * damper;
                    ratio
                }
                Joint::Parallel { compliance_m_per_n } => {
                    force[velocity] = compliance_m_per_n * spring;
                    1.0
                }
            };
            scale[velocity] = 1.0 / (m * share.max(1e-6)).sqrt();
            scale[position] = scale[velocity] / w;
            // Only what is attached turns the plant's velocity.
            if let Joint::Attached { .. } = mode.joint {
                dynamics.turning_rate_per_s += w * (1.0 + share).sqrt() + damper;
            }
            (dynamics.closed, dynamics.force, dynamics.scale) = (a, force, scale);
        }
        dynamics
    }

    /// A parallel mode by itself: [displacement, velocity] under the force that drives it.
    pub fn of_parallel(mode: &Mode, compliance_m_per_n: f64) -> Self {
        let w = std::f64::consts::TAU * mode.hz;
        let damper = 2.0 * mode.damping_ratio * w;
        Self {
            closed: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -w * w, -damper]),
            force: DVector::from_vec(vec![0.0, compliance_m_per_n * w * w]),
            dead_zones: Vec::new(),
            scale: DVector::from_vec(vec![1.0 / w, 1.0]),
            turning_rate_per_s: w + damper,
        }
    }

    /// These dynamics with a sensor's lag behind: a state (of second order two, its value first) that follows the sum of the states `seen`
    /// and acts on nothing.
    pub fn with_lag(mut self, lag: Lag, seen: &[usize]) -> Self {
        let states = self.states();
        let (order, input, scale) = match lag {
            Lag::First { time_constant_s } => (1, 1.0 / time_constant_s, self.scale[DISPLACEMENT]),
            Lag::Second { natural_rad_per_s: w, .. } => (2, w * w, self.scale[DISPLACEMENT]),
        };
        let mut a = self.closed.resize(states + order, states + order, 0.0);
        self.force = self.force.resize_vertically(states + order, 0.0);
        self.scale = self.scale.resize_vertically(states + order, scale);
        let driven = states + order - 1;
        a[(driven, states)] = -input;
        for &state in seen {
            a[(driven, state)] = input;
        }
        if let Lag::Second { natural_rad_per_s: w, damping_ratio } = lag {
            a[(states, driven)] = 1.0;
            a[(driven, driven)] = -2.0 * damping_ratio * w;
            self.scale[driven] *= w;
        }
        self.closed = a;
        self
    }
}
