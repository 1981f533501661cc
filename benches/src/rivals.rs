//! The rivals: general solvers on the same plant, restarted at every sample because the input jumps there.
//!
//! States are [q in um, q' in mm/s, v1, v2 in V]: all of the order of 1 to 100, so one absolute tolerance suits them.

use diffsol::{NalgebraLU, NalgebraMat, NalgebraVec, OdeBuilder, OdeEquations, OdeSolverMethod, OdeSolverStopReason};
use ode_solvers::dop_shared::{OutputType, System};
use ode_solvers::{Dop853, SVector};
use plant_sim::phs::Phs;
use std::cell::Cell;
use std::marker::PhantomData;

/// A plant that is fed sample by sample.
pub trait Sampled {
    /// Displacement now, in metres.
    fn displacement_m(&self) -> f64;
    /// Holds the drive for one sample; `None` if the solver gave up.
    fn advance(&mut self, drive_v: f64) -> Option<()>;
}

/// Which equations a general solver is given.
#[derive(Clone, Copy, PartialEq)]
pub enum Equations {
    /// All of them: stiff.
    Full,
    /// Hysteron 1 quasi-static: its charge follows the velocity inside the dead zone and stays at the edge outside, where its
    /// admittance acts as a damper. Not stiff, but discontinuous.
    QuasiStatic,
}

type State = SVector<f64, 4>;

#[derive(Clone)]
struct Right {
    m: f64,
    k: f64,
    b: f64,
    alpha: f64,
    c: [f64; 2],
    slope: [f64; 2],
    edge: [f64; 2],
    drive_v: f64,
    equations: Equations,
}

impl Right {
    fn new(plant: &Phs, equations: Equations) -> Self {
        let each = |f: fn(&plant_sim::phs::Hysteron) -> f64| [f(&plant.hysterons[0]), f(&plant.hysterons[1])];
        Self {
            m: plant.mass_kg,
            k: plant.stiffness_n_per_m,
            b: plant.damping_n_s_per_m,
            alpha: plant.transduction_c_per_m,
            c: each(|h| h.capacitance_f),
            slope: each(|h| h.slope_s),
            edge: each(|h| h.edge_v()),
            drive_v: 0.0,
            equations,
        }
    }

    #[inline(always)]
    fn leak(&self, i: usize, v: f64) -> f64 {
        let (slope, edge) = (self.slope[i], self.edge[i]);
        if v > edge {
            slope * (v - edge)
        } else if v < -edge {
            slope * (v + edge)
        } else {
            0.0
        }
    }

    #[inline(always)]
    fn rates(&self, x: &[f64]) -> [f64; 4] {
        let current = 1e-3 * self.alpha * x[1];
        let (v1, v1_rate) = match self.equations {
            Equations::Full => (x[2], (current - self.leak(0, x[2])) / self.c[0]),
            Equations::QuasiStatic => {
                let open = (x[2] >= self.edge[0] && current > 0.0) || (x[2] <= -self.edge[0] && current < 0.0);
                if open {
                    (self.edge[0].copysign(x[2]) + current / self.slope[0], 0.0)
                } else {
                    (x[2], current / self.c[0])
                }
            }
        };
        let force = self.alpha * (self.drive_v - v1 - x[3]) - 1e-6 * self.k * x[0] - 1e-3 * self.b * x[1];
        [1e3 * x[1], 1e3 * force / self.m, v1_rate, (current - self.leak(1, x[3])) / self.c[1]]
    }
}

impl System<f64, State> for &Right {
    fn system(&self, _: f64, x: &State, dx: &mut State) {
        dx.as_mut_slice().copy_from_slice(&self.rates(x.as_slice()));
    }
}

/// ode_solvers' DOP853.
pub struct Explicit {
    right: Right,
    sample_s: f64,
    tolerance: f64,
    /// Begin with the longest step of the sample before instead of the solver's own guess, which costs two evaluations.
    keep_step: bool,
    step_s: f64,
    x: State,
}

impl Explicit {
    pub fn new(plant: &Phs, equations: Equations, sample_s: f64, tolerance: f64, keep_step: bool) -> Self {
        Self { right: Right::new(plant, equations), sample_s, tolerance, keep_step, step_s: 0.0, x: State::zeros() }
    }
}

impl Sampled for Explicit {
    fn displacement_m(&self) -> f64 {
        1e-6 * self.x[0]
    }

    fn advance(&mut self, drive_v: f64) -> Option<()> {
        self.right.drive_v = drive_v;
        let (t, tolerance, never) = (self.sample_s, self.tolerance, u32::MAX);
        // Library defaults but for the first step, and no complaint about stiffness.
        let mut solver = Dop853::from_param(
            &self.right,
            0.0,
            t,
            t,
            self.x,
            tolerance,
            tolerance,
            0.9,
            0.0,
            0.333,
            6.0,
            t,
            self.step_s,
            100_000,
            never,
            OutputType::Sparse,
        );
        solver.integrate().ok()?;
        self.x = *solver.y_out().last()?;
        if self.keep_step {
            self.step_s = solver.x_out().windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        }
        if self.right.equations == Equations::QuasiStatic {
            self.x[2] = self.x[2].clamp(-self.right.edge[0], self.right.edge[0]);
        }
        self.x[0].is_finite().then_some(())
    }
}

type Matrix = NalgebraMat<f64>;
type Lu = NalgebraLU<f64>;

/// diffsol's BDF on the full equations; `work` is given the solver, which borrows its problem.
pub fn with_bdf<R>(
    plant: &Phs,
    sample_s: f64,
    tolerance: f64,
    step_s: f64,
    work: impl FnOnce(&mut dyn Sampled) -> R,
) -> Option<R> {
    let right = Right::new(plant, Equations::Full);
    let drive_v = Cell::new(0.0);
    let rates = |x: &[f64]| Right { drive_v: drive_v.get(), ..right.clone() }.rates(x);
    let problem = OdeBuilder::<Matrix>::new()
        .rtol(tolerance)
        .atol([tolerance; 4])
        .h0(step_s)
        .rhs_implicit(
            |x, _, _, dx| dx.copy_from_slice(&rates(x)),
            |x, _, _, v, jv| {
                // The equations are affine between corners, so their Jacobian is that of the leaks that conduct.
                let conducts =
                    |i: usize| if x[2 + i].abs() > right.edge[i] { right.slope[i] / right.c[i] } else { 0.0 };
                let current = 1e-3 * right.alpha * v[1];
                let force = -right.alpha * (v[2] + v[3]) - 1e-6 * right.k * v[0] - 1e-3 * right.b * v[1];
                jv[0] = 1e3 * v[1];
                jv[1] = 1e3 * force / right.m;
                jv[2] = current / right.c[0] - conducts(0) * v[2];
                jv[3] = current / right.c[1] - conducts(1) * v[3];
            },
        )
        .init(|_, _, x| x.fill(0.0), 4)
        .build()
        .ok()?;
    let solver = problem.bdf::<Lu>().ok()?;
    let mut implicit =
        Implicit { equations: PhantomData, solver, rates: &rates, drive_v: &drive_v, sample_s, step_s, end_s: 0.0 };
    Some(work(&mut implicit))
}

struct Implicit<'a, Eqn, S, F> {
    equations: PhantomData<Eqn>,
    solver: S,
    rates: &'a F,
    drive_v: &'a Cell<f64>,
    sample_s: f64,
    step_s: f64,
    end_s: f64,
}

impl<'a, Eqn, S, F> Sampled for Implicit<'a, Eqn, S, F>
where
    Eqn: OdeEquations<T = f64, V = NalgebraVec<f64>, M = Matrix> + 'a,
    S: OdeSolverMethod<'a, Eqn>,
    F: Fn(&[f64]) -> [f64; 4],
{
    fn displacement_m(&self) -> f64 {
        1e-6 * self.solver.state().y.batch_as_slice(0)[0]
    }

    fn advance(&mut self, drive_v: f64) -> Option<()> {
        self.drive_v.set(drive_v);
        let state = self.solver.state_mut();
        let rates = (self.rates)(state.y.batch_as_slice(0));
        state.dy.batch_as_mut_slice(0).copy_from_slice(&rates);
        *state.h = self.step_s;
        self.end_s += self.sample_s;
        self.solver.set_stop_time(self.end_s).ok()?;
        loop {
            match self.solver.step().ok()? {
                OdeSolverStopReason::TstopReached => return Some(()),
                _ => continue,
            }
        }
    }
}
