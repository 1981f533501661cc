//! Energy balance along an exact run: stored, dissipated and supplied energy, each from its own integral.
//!
//! Between switches the dissipated and the supplied power are quadratic in z = [x, f, 1], which itself obeys z' = A_z z. Their
//! integrals over a move are z' S z with S(t) = integral of exp(A_z' s) W exp(A_z s) ds, and S doubles along the ladder of maps:
//! S(2t) = S(t) + exp(A_z t)' S(t) exp(A_z t). So the balance tests the maps instead of repeating them.

use super::dynamics::Dynamics;
use super::engine::{Engine, Series, Signs};
use super::maps::{DEGREE, FINEST, halved};
use super::pack;
use super::push::Spans;
use crate::phs::{Phs, PhsState};
use nalgebra::{DMatrix, DVector};
use std::collections::HashMap;

/// Sees every move of an engine before it is made.
pub(crate) trait Audit<const N: usize> {
    /// The engine is about to apply map `rung` of `span` under a held force.
    fn map(&mut self, engine: &Engine<N>, span: usize, rung: usize, force_n: f64);
    /// The engine is about to follow `series` for `moved_s` under a held force.
    fn series(&mut self, engine: &Engine<N>, series: &Series<N>, moved_s: f64, force_n: f64);
}

/// Looks at nothing and costs nothing.
pub(crate) struct NoAudit;

impl<const N: usize> Audit<N> for NoAudit {
    #[inline(always)]
    fn map(&mut self, _: &Engine<N>, _: usize, _: usize, _: f64) {}
    #[inline(always)]
    fn series(&mut self, _: &Engine<N>, _: &Series<N>, _: f64, _: f64) {}
}

/// What a run did with its energy, in joule.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ledger {
    /// H at the end minus H at the start.
    pub stored_j: f64,
    /// Integral of the power lost in the damper and in the hysterons' admittances.
    pub dissipated_j: f64,
    /// Integral of the power that drive and external force supplied.
    pub supplied_j: f64,
    /// Sum of the magnitudes of the energy supplied in each move.
    pub exchanged_j: f64,
    /// Largest H met at a sample.
    pub peak_j: f64,
}

impl Ledger {
    /// Stored + dissipated - supplied, which is zero for a plant that creates no energy.
    pub fn imbalance_j(&self) -> f64 {
        self.stored_j + self.dissipated_j - self.supplied_j
    }
}

/// Largest plant that an audited run takes; audits are for checks, which don't need the other sizes.
const AUDITED: usize = 8;

/// Runs `plant` from `start` with each drive voltage and external force held for `sample_s`, and books its energy.
///
/// At most 6 hysterons are audited; more return `None`.
pub fn audited_run(plant: &Phs, start: &PhsState, sample_s: f64, inputs: &[(f64, f64)]) -> Option<(PhsState, Ledger)> {
    let n = plant.hysterons.len();
    if n + 2 > AUDITED {
        return None;
    }
    let dynamics = Dynamics::of_plant(plant);
    let mut engine = Engine::<AUDITED>::new(&dynamics, Spans::whole(sample_s));
    super::Stepper::set_state(&mut engine, &pack(start));
    let mut book = Book { plant, dynamics: &dynamics, integrals: HashMap::new(), ledger: Ledger::default() };
    for &(drive_v, force_n) in inputs {
        engine.advance_with(0, plant.transduction_c_per_m * drive_v - force_n, &mut book);
        let energy_j = plant.energy_j(&super::unpack(&engine, n));
        book.ledger.peak_j = book.ledger.peak_j.max(energy_j);
    }
    let end = super::unpack(&engine, n);
    let mut ledger = book.ledger;
    ledger.stored_j = plant.energy_j(&end) - plant.energy_j(start);
    Some((end, ledger))
}

/// Integrals of dissipated and supplied power over one map, as quadratic forms in z.
type Forms = [DMatrix<f64>; 2];

struct Book<'a> {
    plant: &'a Phs,
    dynamics: &'a Dynamics,
    integrals: HashMap<(Signs, u64), Forms>,
    ledger: Ledger,
}

impl Book<'_> {
    /// A_z and the power forms of the engine's present region.
    fn region(&self, engine: &Engine<AUDITED>) -> (DMatrix<f64>, Forms) {
        let states = self.dynamics.states();
        let (a, force, constant) = engine.current_matrices();
        let mut a_z = DMatrix::zeros(states + 2, states + 2);
        for i in 0..states {
            for j in 0..states {
                a_z[(i, j)] = a[j][i];
            }
            a_z[(i, states)] = force[i];
            a_z[(i, states + 1)] = constant[i];
        }
        let mut lost = DMatrix::zeros(states + 2, states + 2);
        lost[(1, 1)] = self.plant.damping_n_s_per_m;
        let signs = engine.current_signs();
        let mut zone = 0;
        for (i, hysteron) in self.plant.hysterons.iter().enumerate() {
            let switched = self.dynamics.dead_zones().get(zone).is_some_and(|z| z.state == 2 + i);
            let sign = if switched { signs.get(zone) } else { 0.0 };
            zone += usize::from(switched);
            if sign != 0.0 || hysteron.dead_zone_v == 0.0 {
                // v h(v) = beta v (v - sign d/2) wherever the admittance conducts.
                lost[(2 + i, 2 + i)] = hysteron.slope_s;
                lost[(2 + i, states + 1)] = -hysteron.slope_s * sign * hysteron.edge_v();
            }
        }
        let mut given = DMatrix::zeros(states + 2, states + 2);
        given[(1, states)] = 1.0;
        (a_z, [lost, given])
    }

    fn book(&mut self, z: &DVector<f64>, forms: &Forms) {
        let [lost, given] = forms.each_ref().map(|form| (z.transpose() * form * z)[(0, 0)]);
        self.ledger.dissipated_j += lost;
        self.ledger.supplied_j += given;
        self.ledger.exchanged_j += given.abs();
    }
}

fn augmented(x: &[f64; AUDITED], states: usize, force_n: f64) -> DVector<f64> {
    let mut z = DVector::zeros(states + 2);
    z.as_mut_slice()[..states].copy_from_slice(&x[..states]);
    z[states] = force_n;
    z[states + 1] = 1.0;
    z
}

impl Audit<AUDITED> for Book<'_> {
    fn map(&mut self, engine: &Engine<AUDITED>, span: usize, rung: usize, force_n: f64) {
        let duration_s = engine.span_s(span, rung);
        let key = (engine.current_signs(), duration_s.to_bits());
        if !self.integrals.contains_key(&key) {
            let (a_z, power) = self.region(engine);
            let rate_per_s = self.dynamics.fastest_rate_per_s(|i, j| a_z[(i, j)]);
            self.integrals.insert(key, power.map(|w| integrated_form(&a_z, &w, duration_s, rate_per_s)));
        }
        let z = augmented(engine.x(), self.dynamics.states(), force_n);
        let forms = self.integrals[&key].clone();
        self.book(&z, &forms);
    }

    fn series(&mut self, engine: &Engine<AUDITED>, series: &Series<AUDITED>, moved_s: f64, force_n: f64) {
        let (_, power) = self.region(engine);
        let mut sum: Forms = power.clone().map(|w| w * 0.0);
        let states = self.dynamics.states();
        let [mut lost, mut given] = [0.0, 0.0];
        for (node, weight) in gauss_nodes() {
            let z = augmented(&series.at(node * moved_s), states, force_n);
            lost += weight * moved_s * (z.transpose() * &power[0] * &z)[(0, 0)];
            given += weight * moved_s * (z.transpose() * &power[1] * &z)[(0, 0)];
        }
        sum[0][(states + 1, states + 1)] = lost;
        sum[1][(states + 1, states + 1)] = given;
        self.book(&augmented(&[0.0; AUDITED], states, 0.0), &sum);
    }
}

/// Nodes and weights of the 5-point Gauss-Legendre rule on [0, 1]; exact to degree 9.
fn gauss_nodes() -> [(f64, f64); 5] {
    let (inner, outer) =
        ((5.0 - 2.0 * (10.0f64 / 7.0).sqrt()).sqrt() / 3.0, (5.0 + 2.0 * (10.0f64 / 7.0).sqrt()).sqrt() / 3.0);
    let (w_inner, w_outer) = ((322.0 + 13.0 * 70.0f64.sqrt()) / 1800.0, (322.0 - 13.0 * 70.0f64.sqrt()) / 1800.0);
    [
        (0.5, 128.0 / 450.0),
        (0.5 - 0.5 * inner, w_inner),
        (0.5 + 0.5 * inner, w_inner),
        (0.5 - 0.5 * outer, w_outer),
        (0.5 + 0.5 * outer, w_outer),
    ]
}

/// S(duration) for the power form `w`, by doubling from a step short enough for the quadrature.
///
/// exp(A_z t) - I is what is doubled: near the finest step the identity would swallow digits of A_z t.
fn integrated_form(a_z: &DMatrix<f64>, w: &DMatrix<f64>, duration_s: f64, rate_per_s: f64) -> DMatrix<f64> {
    let size = a_z.nrows();
    let halvings = (duration_s * rate_per_s / FINEST).log2().ceil().max(0.0) as u32;
    let step_s = duration_s * halved(halvings);
    let grown = |t: f64| {
        let mut sum = DMatrix::identity(size, size);
        for degree in (2..=DEGREE + 2).rev() {
            sum = DMatrix::identity(size, size) + a_z * sum * (t / degree as f64);
        }
        a_z * sum * t
    };
    let mut s = DMatrix::zeros(size, size);
    for (node, weight) in gauss_nodes() {
        let e = DMatrix::identity(size, size) + grown(node * step_s);
        s += e.transpose() * w * &e * (weight * step_s);
    }
    let mut d = grown(step_s);
    for _ in 0..halvings {
        let e = DMatrix::identity(size, size) + &d;
        s = &s + e.transpose() * &s * &e;
        d = &d * 2.0 + &d * &d;
    }
    s
}
