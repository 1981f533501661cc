//! Laws that are not affine, sub-step by sub-step: the force that they put on the mass, as the parabola with the same moments, and what
//! they add to the rates of the hysterons.
//!
//! First the path of the mass over the sub-step is foreseen, to third order in time, from the force at its start and its middle; friction,
//! which may be stiff, is solved for on the way ([`relax`]). Then the laws are integrated along that path. The engine steps the rest of
//! the plant exactly. So what is left as error is the product of a law's share in the force and of the path's small error.
//!
//! A hysteron with a bend is a plain capacitor to the engine; its whole leak is a law ([`super::leak`]).

use super::lag::Moments;
use super::leak::Leak;
use super::parts::{against_stop_n, detent, in_pad, on_patch};
use super::path::{Path, Quadrature};
use super::relax::relax;
use super::{Bend, Force, Joint, Mode, Parts};
use crate::exact::{Push, Stepper};
use crate::phs::Phs;
use std::f64::consts::TAU;

/// Largest product of the fastest mechanical rate and a sub-step.
const SUBSTEP: f64 = 0.3;
/// The same of coarse laws, for the rates that they add: paths are off by a nanometre or two then.
const COARSE_SUBSTEP: f64 = 0.8;
/// .. and for the plant's own under forces of place, in rows that are one sub-step then: the engine follows the plant whatever the path, and such a force
/// is off by a percent or two.
const COARSE_ROW: f64 = 1.2;
/// Most sub-steps in a sample, but for slow ones.
const MOST: f64 = 64.0;
/// Rows slower than this, in seconds, may have as many times more for stiff laws, and at the most so many times: a search tries laws that
/// are a thousand times too stiff, and those may run away sooner than cost a second each.
const USUAL_ROW_S: f64 = 2e-4;
const MOST_SLOWER: f64 = 4.0;
/// What can press the mass against a spring that is added, in forces that hold the plant at the end of its stroke: a step overshoots.
const REACH: f64 = 4.0;
/// Most sub-steps in any sample: half a second of computing. Of a row that is longer still the path is not foreseen, and it shows: it runs away.
const MOST_EVER: f64 = 1_048_576.0;
/// A leak faster than this over a sub-step keeps its hysteron on its edge, as far as the path is concerned.
const STIFF: f64 = 0.5;
/// Error of a velocity in one inner step, m/s: what creeps with it for a second creeps by 10 nm at most, and by far less because errors alternate.
const VELOCITY_ERROR: f64 = 1e-8;
/// Foreseen ends this close count as one: the load that differs is worth 1e-8 m/s.
const SAME_M: f64 = 2e-11;
/// Shortest inner step against friction: at 1 km/s^2 a speed of 1e-9 m/s.
const SHORTEST_S: f64 = 1e-12;
/// The same two for coarse laws, and for singular ones of them.
const COARSE_INNER: [f64; 2] = [2e-5, 1e-7];
const COARSE_SINGULAR_INNER: [f64; 2] = [2e-7, 1e-9];
/// .. and the most sub-steps: rows far apart show the plant at rest, not how it got there.
const COARSE_MOST: f64 = 16.0;
/// Speeds, in errors of a velocity, up to which a mass may creep against singular friction; how many times it must settle in what is left of the
/// sub-step.
const CREEPS: f64 = 5.0;
const SETTLES: f64 = 10.0;
/// Newton steps at the most for the speed at which friction bears a load, and the relative change of the last.
const MOST_NEWTON: usize = 30;
const BALANCED: f64 = 1e-6;
/// Share of its reference speed below which a power law is straight: with an exponent of 0.3 at 0.2 % of the force, and at a speed that
/// makes 0.1 nm a second at 0.1 m/s.
const STRAIGHT: f64 = 1e-9;
/// Share of its force by which a presliding friction may fall short, or change over a step, and counts as constant; with coarse laws
/// that is 0.1 nm for a hundredth of the blocking force.
const SLIDING: f64 = 1e-6;
const COARSE_SLIDING: f64 = 1e-4;
/// Depth in a contact, in strokes, for which steps are short enough.
const DEEP: f64 = 0.2;
/// An acceleration over a long step is at most this many times the one at its start.
const AT_MOST: f64 = 1.3;

/// The laws with their memory.
pub(super) struct Laws {
    plant: Phs,
    forces: Vec<Force>,
    /// z of each presliding friction, in the order of `forces`.
    slid: Vec<f64>,
    /// The same after the sub-step that was foreseen last, and where that ended.
    slid_then: Vec<f64>,
    end_m: f64,
    hysterons: Vec<Element>,
    leaks: Vec<Leak>,
    attached: Vec<Attached>,
    /// Mean friction over the last sub-step.
    rubbed_n: f64,
    /// Error and shortest length of inner steps against friction, and how often the path is foreseen anew.
    inner: [f64; 2],
    /// None without singular friction.
    creep: Option<Creep>,
    rounds: usize,
    sliding: f64,
    quadrature: Quadrature,
    elastic: bool,
    friction: bool,
    /// Additions to the rates of the states that were last handed out.
    rates: Vec<f64>,
}

/// What the path needs to know of a hysteron.
struct Element {
    per_metre: f64,
    edge_v: f64,
    rate_per_s: f64,
}

/// Up to which speed a mass may creep, what friction and damper bear there, and how steeply more, N s/m.
#[derive(Clone, Copy)]
struct Creep {
    most_m_per_s: f64,
    bears_n: f64,
    by_v: f64,
}

/// What it needs to know of an attached mode.
struct Attached {
    state: usize,
    mass_kg: f64,
    spring: f64,
    damper: f64,
}

/// The plant as a hysteron's engine sees it: hysterons that a bend takes over don't leak there.
pub(super) fn without_bent_leaks(plant: &Phs, bends: &[Bend]) -> Phs {
    let mut plain = plant.clone();
    for (i, hysteron) in plain.hysterons.iter_mut().enumerate() {
        if hysteron.dead_zone_v > 0.0 && bends.iter().any(|bend| bend.hysteron.is_none_or(|only| only == i)) {
            hysteron.slope_s = 0.0;
        }
    }
    plain
}

/// Sub-steps of a sample that the laws call for, and those that are enough while none of them is at work: powers of two, so that a search
/// that shifts a parameter by little hardly ever changes them.
pub(super) fn substeps(plant: &Phs, parts: &Parts, stroke_m: f64, sample_s: f64) -> [usize; 2] {
    let springs: f64 = plant.hysterons.iter().map(|h| plant.transduction_c_per_m.powi(2) / h.capacitance_f).sum();
    let stiffness = plant.stiffness_n_per_m + springs;
    // A law that is steep at the stroke's end keeps the mass from getting there.
    let steepest = |of_power: f64, power: i32| {
        let order = f64::from(power);
        let at_stroke = order * of_power.abs() * stroke_m.powi(power - 1);
        let reached = (REACH * stiffness * order / at_stroke).min(1.0).powf(1.0 / order);
        at_stroke * reached.powi(power - 1)
    };
    let stiffness_of = |force: &Force| match *force {
        Force::Fourth { fourth_n_per_m4 } => steepest(fourth_n_per_m4, 4),
        Force::Fifth { fifth_n_per_m5 } => steepest(fifth_n_per_m5, 5),
        Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => {
            steepest(quadratic_n_per_m2, 2) + steepest(cubic_n_per_m3, 3)
        }
        Force::OneSided { stiffness_n_per_m }
        | Force::Gradual { stiffness_n_per_m, .. }
        | Force::Stop { stiffness_n_per_m, .. } => stiffness_n_per_m.abs(),
        Force::Pad { at_m, stiffness_n_per_m, exponent } => {
            // As far beyond it as the way to it, at the most.
            let deepest = in_pad(at_m.abs(), stroke_m).1.clamp(1.0, 10.0);
            exponent * stiffness_n_per_m.abs() * deepest.powf(exponent - 1.0).max(1.0)
        }
        Force::Presliding { coulomb_n, presliding_m } => coulomb_n.abs() / presliding_m.max(1e-12),
        Force::Slider { coulomb_n, slip_m } | Force::Patch { coulomb_n, slip_m, .. } => {
            coulomb_n.abs() / slip_m.max(1e-12)
        }
        Force::Detent { period_m, sin_n, cos_n } => TAU / period_m.abs().max(1e-12) * sin_n.hypot(cos_n),
        Force::BoucWen(law) => law.slopes(law.amplitude * stroke_m)[1].abs(),
        Force::Smooth { .. } | Force::Power { .. } => 0.0,
    };
    let added: f64 = parts.forces.iter().map(stiffness_of).sum();
    // Friction that gives way can't push the mass far, whatever its stiffness.
    let lasting: f64 = parts.forces.iter().filter(|force| !gives_way(force)).map(stiffness_of).sum();
    let mut rate = (stiffness / plant.mass_kg).sqrt();
    for mode in &parts.modes {
        if let Joint::Attached { mass_kg } = mode.joint {
            rate = rate.max(0.5 * TAU * mode.hz * (1.0 + mass_kg / plant.mass_kg).sqrt());
        }
    }
    let (substep, most, shorter) =
        if parts.is_coarse { (COARSE_SUBSTEP, COARSE_MOST, 1.0) } else { (SUBSTEP, MOST, 2.0) };
    let are_of_place = parts.bends.is_empty() && !parts.forces.iter().any(is_friction);
    let is_one_step = parts.is_coarse && are_of_place && rate * sample_s <= COARSE_ROW;
    let own = rate / if is_one_step { COARSE_ROW } else { substep };
    // Where a rate times a sub-step is 3, the cubic that foresees the path lies metres off and the plant runs away: 1 is far enough from that.
    let whole = |steps: f64| steps.log2().ceil().exp2();
    let least = whole(rate * sample_s);
    let most = most.max(least);
    let most_of_laws = most * whole(sample_s / USUAL_ROW_S).clamp(1.0, MOST_SLOWER);
    let count = |added: f64, of_laws: f64| {
        let most = most.max(whole(of_laws * sample_s).min(most_of_laws)).min(MOST_EVER);
        whole(own.max(added / substep) * sample_s).max(1.0).min(most) as usize
    };
    let idle = count(0.0, 0.0);
    // What is added and stiff is foreseen by the path alone, so it gets shorter steps.
    let added = (added / plant.mass_kg).sqrt() * shorter;
    // A widening acts like a damper.
    let widening: f64 = Leak::of(plant, &parts.bends, parts.is_coarse).iter().map(Leak::damping_n_s_per_m).sum();
    // So does a contact that loses energy, as far in as such contacts go.
    let deep_m = DEEP * stroke_m;
    let lossy = |force: &Force| match *force {
        Force::Stop { stiffness_n_per_m, damping_s_per_m, .. } => stiffness_n_per_m.abs() * deep_m * damping_s_per_m,
        _ => 0.0,
    };
    let losses: f64 = parts.forces.iter().map(lossy).sum();
    let damped = 4.0 * (widening + losses) / plant.mass_kg;
    let count_of_laws = count(added.max(damped), damped.max((lasting / plant.mass_kg).sqrt()));
    [count_of_laws, if may_be_idle(parts) { idle } else { count_of_laws }]
}

/// Whether it is a force of velocity alone.
fn is_friction(force: &Force) -> bool {
    matches!(force, Force::Smooth { .. } | Force::Power { .. })
}

/// Whether a force of place has a largest value.
fn gives_way(force: &Force) -> bool {
    matches!(force, Force::Presliding { .. } | Force::Slider { .. } | Force::Patch { .. } | Force::Detent { .. })
}

/// Whether the laws are such that [`Laws::idle_n`] ever tells that none is at work.
fn may_be_idle(parts: &Parts) -> bool {
    let may = |force: &Force| {
        matches!(
            force,
            Force::Presliding { .. }
                | Force::Slider { .. }
                | Force::OneSided { .. }
                | Force::Stop { .. }
                | Force::Pad { .. }
        )
    };
    parts.bends.is_empty() && parts.forces.iter().all(may)
}

impl Laws {
    pub(super) fn new(plant: &Phs, parts: &Parts, modes: &[Mode], states: usize) -> Self {
        let Parts { forces, bends, is_coarse, .. } = parts;
        let is_coarse = *is_coarse;
        let alpha = plant.transduction_c_per_m;
        let element = |h: &crate::phs::Hysteron| Element {
            per_metre: alpha / h.capacitance_f,
            edge_v: h.edge_v(),
            rate_per_s: h.slope_s / h.capacitance_f,
        };
        let attached = modes.iter().enumerate().filter_map(|(i, mode)| match mode.joint {
            Joint::Attached { mass_kg } => {
                let w = TAU * mode.hz;
                let state = 2 + plant.hysterons.len() + 2 * i;
                Some(Attached { state, mass_kg, spring: w * w, damper: 2.0 * mode.damping_ratio * w })
            }
            Joint::Parallel { .. } => None,
        });
        // A power below one is steep where it is straight: an error above that speed would jump to and fro across zero.
        let singular = forces.iter().any(|f| matches!(f, Force::Power { exponent, .. } if *exponent < 1.0));
        let inner = match (is_coarse, singular) {
            (true, true) => COARSE_SINGULAR_INNER,
            (true, false) => COARSE_INNER,
            (false, true) => [1e-2 * VELOCITY_ERROR, SHORTEST_S],
            (false, false) => [VELOCITY_ERROR, SHORTEST_S],
        };
        let mut laws = Self {
            plant: plant.clone(),
            forces: forces.to_vec(),
            slid: vec![0.0; forces.len()],
            slid_then: vec![0.0; forces.len()],
            end_m: 0.0,
            hysterons: plant.hysterons.iter().map(element).collect(),
            leaks: Leak::of(plant, bends, is_coarse),
            attached: attached.collect(),
            rubbed_n: 0.0,
            inner,
            creep: None,
            rounds: if is_coarse { 1 } else { 3 },
            sliding: if is_coarse { COARSE_SLIDING } else { SLIDING },
            quadrature: Quadrature::of(forces, is_coarse),
            elastic: forces.iter().any(|force| !is_friction(force)),
            friction: forces.iter().any(is_friction),
            rates: vec![0.0; states],
        };
        if singular {
            let most_m_per_s = CREEPS * inner[0];
            let [bears_n, by_v] = laws.resisting(most_m_per_s);
            laws.creep = Some(Creep { most_m_per_s, bears_n, by_v });
        }
        laws
    }

    /// Every friction that sticks has been pushed to this `share` of what it can hold.
    pub(super) fn hold(&mut self, share: f64) {
        let is_presliding =
            |force: &Force| matches!(force, Force::Presliding { .. } | Force::Slider { .. } | Force::Patch { .. });
        let slid = self.slid.iter_mut().zip(&self.forces);
        slid.filter(|(_, force)| is_presliding(force)).for_each(|(slid, _)| *slid = share);
    }

    /// z of each friction that sticks and h of each Bouc-Wen law, zero for other forces.
    pub(super) fn slid(&self) -> &[f64] {
        &self.slid
    }

    /// Foresees the sub-step of `step_s`, while drive and shakes pull with `pull` (newton, slope, second derivative):
    /// the laws' force against the motion, in the same form.
    fn foresee(&mut self, state: &[f64], pull: [f64; 3], step_s: f64) -> [f64; 3] {
        let mut sum = Moments::default();
        let path =
            if self.friction { self.rub(state, pull, step_s, &mut sum) } else { self.free_path(state, pull, step_s) };
        self.end_m = path.at(step_s);
        if self.elastic {
            self.slid_then.copy_from_slice(&self.slid);
            let (forces, slid) = (&self.forces, &mut self.slid_then);
            self.quadrature.along(&path, step_s, |piece| {
                let from_m = path.at(piece.from_s);
                for (t, weight) in piece.nodes() {
                    let motion = [path.at(t), path.motion(t)[0]];
                    let force_n = elastic_n(&self.plant, forces, slid, motion[0] - from_m, motion);
                    sum.add_node(t, weight, force_n);
                }
                drag(forces, slid, path.at(piece.to_s) - from_m);
            });
        }
        for leak in &mut self.leaks {
            let v = state[2 + leak.hysteron];
            self.rates[2 + leak.hysteron] = leak.follow(v, &path, step_s, &mut sum);
        }
        sum.parabola(step_s)
    }

    /// The laws' constant force against the motion over a long step of `step_s` if none of them is at work there: contacts are open, and
    /// friction slides one way or holds the mass where it is. The pull on it lies between the two `pulls_n`.
    pub(super) fn idle_n(&mut self, state: &[f64], pulls_n: [f64; 2], step_s: f64) -> Option<f64> {
        let (from_m, from_m_per_s) = (state[0], state[1]);
        let mut against_n = 0.0;
        // How far the mass may go each way, and how far before friction that holds it gives way.
        let (mut least_m, mut most_m, mut sticks_m) = (f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY);
        let mut slides = false;
        for (force, z) in self.forces.iter().zip(&self.slid) {
            match *force {
                Force::Presliding { coulomb_n, presliding_m: slip_m } | Force::Slider { coulomb_n, slip_m } => {
                    against_n += coulomb_n * z;
                    if (z - from_m_per_s.signum()).abs() < self.sliding {
                        slides = true;
                    } else {
                        sticks_m = sticks_m.min(0.5 * self.sliding * slip_m);
                    }
                }
                Force::OneSided { .. } => most_m = most_m.min(-from_m),
                Force::Stop { at_m, .. } | Force::Pad { at_m, .. } if at_m > 0.0 => most_m = most_m.min(at_m - from_m),
                Force::Stop { at_m, .. } | Force::Pad { at_m, .. } => least_m = least_m.max(at_m - from_m),
                _ => return None,
            }
        }
        let others_n =
            self.linear_load_n(state, [0.0; 3], self.modes(state, from_m_per_s), [from_m, from_m_per_s], 0.0)
                - against_n
                - self.plant.damping_n_s_per_m * from_m_per_s;
        let gains = pulls_n.map(|pull_n| AT_MOST * (pull_n + others_n) / self.plant.mass_kg * step_s);
        // Twice the way that this acceleration makes.
        let reach_m = step_s * (from_m_per_s.abs() + gains[0].abs().max(gains[1].abs()));
        let keeps_on = |gain: f64| (from_m_per_s + gain) * from_m_per_s > 0.0;
        if reach_m >= most_m.min(-least_m).min(sticks_m) || slides && !gains.into_iter().all(keeps_on) {
            return None;
        }
        self.end_m = from_m;
        self.slid_then.copy_from_slice(&self.slid);
        Some(against_n)
    }

    /// Pushes the stepper by `push`, of which the laws were not yet taken, over its `span` of `step_s`; `idle_n` is their force where that is
    /// known to be constant.
    pub(super) fn step(
        &mut self,
        stepper: &mut dyn Stepper,
        span: usize,
        mut push: Push,
        step_s: f64,
        idle_n: Option<f64>,
    ) {
        let against = match idle_n {
            Some(against_n) => [against_n, 0.0, 0.0],
            None => self.foresee(stepper.states(), [push.force_n, push.slope, push.curve], step_s),
        };
        push.force_n -= against[0];
        push.slope -= against[1];
        push.curve -= against[2];
        // Additions to the rates over the sub-step foreseen last; there are none if no hysteron is bent.
        if !self.leaks.is_empty() {
            stepper.set_rates(Some(&self.rates));
        }
        stepper.push(span, push);
        self.moved(stepper.state(0));
    }

    /// The sub-step took the mass to `to_m`.
    fn moved(&mut self, to_m: f64) {
        for leak in &mut self.leaks {
            leak.moved_on(to_m - self.end_m);
        }
        if self.elastic {
            self.slid.copy_from_slice(&self.slid_then);
            drag(&self.forces, &mut self.slid, to_m - self.end_m);
        }
    }

    /// Path without friction: a cubic from the acceleration at the start and in the middle.
    fn free_path(&self, state: &[f64], pull: [f64; 3], step_s: f64) -> Path {
        let (q, v) = (state[0], state[1]);
        let modes = self.modes(state, v);
        let (m, b) = (self.plant.mass_kg, self.plant.damping_n_s_per_m);
        let acceleration = |at_m: f64, at_m_per_s: f64, t: f64| {
            (self.load_n(state, pull, modes, [at_m, at_m_per_s], t) - b * at_m_per_s) / m
        };
        let half = 0.5 * step_s;
        let first = acceleration(q, v, 0.0);
        let middle = acceleration(q + half * (v + 0.5 * half * first), v + half * first, half);
        Path([q, v, 0.5 * first, (middle - first) / (6.0 * half)])
    }

    /// Path against friction, and friction's moments.
    fn rub(&mut self, state: &[f64], pull: [f64; 3], step_s: f64, sum: &mut Moments) -> Path {
        let (q, v) = (state[0], state[1]);
        let modes = self.modes(state, v);
        let (m, b) = (self.plant.mass_kg, self.plant.damping_n_s_per_m);
        let half = 0.5 * step_s;
        let start = self.load_n(state, pull, modes, [q, v], 0.0) / m;
        // A first guess with the friction of the sub-step before.
        let mut path = Path([q, v, 0.5 * (start - (self.rubbed_n + b * v) / m), 0.0]);
        let mut rubbed = Moments::default();
        for _ in 0..self.rounds {
            let load = |t: f64| self.load_n(state, pull, modes, [path.at(t), path.motion(t)[0]], t) / m;
            let (middle, end) = (load(half), load(step_s));
            // The parabola through the three.
            let (slope, curve) =
                ((4.0 * middle - 3.0 * start - end) / step_s, 4.0 * (start - 2.0 * middle + end) / (step_s * step_s));
            let follow = |v: f64, t: f64| {
                let [force, by_v] = friction(&self.forces, v);
                let load = start + t * (slope + 0.5 * t * curve);
                [load - (force + b * v) / m, -(by_v + b) / m, slope + t * curve]
            };
            let load = [start * m, slope * m, curve * m];
            let (end_m_per_s, moments) = relax(v, step_s, self.inner, follow, |v, t| self.creep(v, load, [t, step_s]));
            let foreseen_m = path.at(step_s);
            path = Path::between(q, v, q + moments.zeroth, end_m_per_s, step_s);
            // Friction is what load and damper don't explain of the change of velocity.
            let h = step_s;
            rubbed = Moments {
                zeroth: m * (h * (start + h * (slope / 2.0 + h * curve / 6.0)) - (end_m_per_s - v))
                    - b * moments.zeroth,
                first: m
                    * (h * h * (start / 2.0 + h * (slope / 3.0 + h * curve / 8.0))
                        - (h * end_m_per_s - moments.zeroth))
                    - b * moments.first,
                second: m
                    * (h * h * h * (start / 3.0 + h * (slope / 4.0 + h * curve / 10.0))
                        - (h * h * end_m_per_s - 2.0 * moments.first))
                    - b * moments.second,
            };
            if (path.at(step_s) - foreseen_m).abs() < SAME_M {
                break;
            }
        }
        self.rubbed_n = rubbed.zeroth / step_s;
        sum.add(rubbed, 0.0);
        path
    }

    /// The speed at the sub-step's end and the way from `from_s` on, where singular friction is so steep that it bears the `load` (newton, slope,
    /// second derivative) at every instant, as a mass does that hardly creeps.
    fn creep(&self, v: f64, [start_n, slope, curve]: [f64; 3], [from_s, to_s]: [f64; 2]) -> Option<(f64, Moments)> {
        let creep = self.creep.filter(|creep| v.abs() < creep.most_m_per_s)?;
        let Creep { bears_n, by_v, .. } = creep;
        let left_s = to_s - from_s;
        let changes = (slope + from_s * curve).abs().max((slope + to_s * curve).abs());
        // It settles within m/by_v, in which the speed that balances the load moves by this.
        let lags_by = changes * self.plant.mass_kg / (by_v * by_v);
        if by_v * left_s < SETTLES * self.plant.mass_kg || lags_by > self.inner[0] {
            return None;
        }
        let load_n = |t: f64| start_n + t * (slope + 0.5 * t * curve);
        let nodes = [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)];
        if nodes.iter().any(|(share, _)| load_n(from_s + share * left_s).abs() > bears_n) {
            return None;
        }
        let (mut sum, mut end_m_per_s) = (Moments::default(), 0.0);
        for (share, weight) in nodes {
            end_m_per_s = self.balance(creep, load_n(from_s + share * left_s));
            sum.add_node(share * left_s, weight * left_s, end_m_per_s);
        }
        Some((end_m_per_s, sum))
    }

    /// The speed at which friction and damper bear `load_n`: Newton's method between the logarithms, which friction keeps nearly straight.
    fn balance(&self, from: Creep, load_n: f64) -> f64 {
        if load_n == 0.0 {
            return 0.0;
        }
        let wanted_n = load_n.abs();
        let mut v = from.most_m_per_s * wanted_n / from.bears_n;
        for _ in 0..MOST_NEWTON {
            let [force_n, by_v] = self.resisting(v);
            let step = (wanted_n / force_n).ln() * force_n / (v * by_v);
            v *= step.clamp(-20.0, 20.0).exp();
            if step.abs() < BALANCED {
                break;
            }
        }
        v.copysign(load_n)
    }

    /// Friction and damper at a speed, and the derivative.
    fn resisting(&self, v: f64) -> [f64; 2] {
        let ([force_n, by_v], b) = (friction(&self.forces, v), self.plant.damping_n_s_per_m);
        [force_n + b * v, by_v + b]
    }

    /// Force on the mass without damper and friction, with the mass at `q` and moving at `w` after `t` of the sub-step.
    fn load_n(&self, state: &[f64], pull: [f64; 3], modes: [f64; 2], motion: [f64; 2], t: f64) -> f64 {
        let mut load_n = self.linear_load_n(state, pull, modes, motion, t);
        if self.elastic {
            load_n -= elastic_n(&self.plant, &self.forces, &self.slid, motion[0] - state[0], motion);
        }
        load_n
    }

    /// The same without the laws.
    fn linear_load_n(&self, state: &[f64], pull: [f64; 3], modes: [f64; 2], [q, w]: [f64; 2], t: f64) -> f64 {
        let by_m = q - state[0];
        let mut held_v = 0.0;
        for (i, hysteron) in self.hysterons.iter().enumerate() {
            let v = state[2 + i];
            let closed_v = v + hysteron.per_metre * by_m;
            held_v += if hysteron.edge_v > 0.0 && hysteron.rate_per_s * t > STIFF {
                let leak = self.leaks.iter().find(|leak| leak.hysteron == i);
                let edge_v = leak.map_or(hysteron.edge_v, |leak| leak.reach_v(v, w));
                {
                    // What is beyond a widened edge follows the edge back; beyond a plain one it is the leak's own lag.
                    let (low, high) = if leak.is_some() { (-edge_v, edge_v) } else { (v.min(-edge_v), v.max(edge_v)) };
                    // Where a search has led the plant to where it is no number any more, neither are these, on which `clamp` panics.
                    closed_v.max(low).min(high)
                }
            } else {
                let excess_v = v - v.clamp(-hysteron.edge_v, hysteron.edge_v);
                let leaked = hysteron.rate_per_s * t;
                let charged = if excess_v == 0.0 { 0.0 } else { 0.5 * (closed_v - v) };
                closed_v - leaked * ((1.0 - 0.5 * leaked) * excess_v + charged)
            };
        }
        pull[0] + t * (pull[1] + 0.5 * t * pull[2]) + modes[0] + t * modes[1]
            - self.plant.stiffness_n_per_m * q
            - self.plant.transduction_c_per_m * held_v
    }

    /// Force of the attached modes on the mass, and its slope.
    fn modes(&self, state: &[f64], v: f64) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for mode in &self.attached {
            let (apart_m, apart_m_per_s) = (state[mode.state] - state[0], state[mode.state + 1] - v);
            let pull = mode.spring * apart_m + mode.damper * apart_m_per_s;
            sum[0] += mode.mass_kg * pull;
            sum[1] += mode.mass_kg * (mode.spring * apart_m_per_s - mode.damper * pull);
        }
        sum
    }
}

/// Friction at a velocity and its derivative.
fn friction(forces: &[Force], v: f64) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for force in forces {
        match *force {
            Force::Smooth { coulomb_n, speed_m_per_s } => {
                let share = (v / speed_m_per_s).tanh();
                sum[0] += coulomb_n * share;
                sum[1] += coulomb_n / speed_m_per_s * (1.0 - share * share);
            }
            Force::Power { force_n, reference_m_per_s, exponent } => {
                let r = v / reference_m_per_s;
                let square = r * r + STRAIGHT * STRAIGHT;
                let power = square.powf(0.5 * (exponent - 1.0));
                sum[0] += force_n * r * power;
                sum[1] += force_n / reference_m_per_s * power * (1.0 + (exponent - 1.0) * r * r / square);
            }
            _ => {}
        }
    }
    sum
}

/// Forces of place, `by_m` from where `slid` is up to date; some of them change with the speed `w`.
fn elastic_n(plant: &Phs, forces: &[Force], slid: &[f64], by_m: f64, [q, w]: [f64; 2]) -> f64 {
    let mut sum_n = 0.0;
    for (force, &z) in forces.iter().zip(slid) {
        sum_n += match *force {
            Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => q * q * (quadratic_n_per_m2 + cubic_n_per_m3 * q),
            Force::Fourth { fourth_n_per_m4 } => fourth_n_per_m4 * q.powi(4),
            Force::Fifth { fifth_n_per_m5 } => fifth_n_per_m5 * q.powi(5),
            // A spring that would pull the mass away must not outdo the plant's own.
            Force::OneSided { stiffness_n_per_m } => stiffness_n_per_m.max(-0.9 * plant.stiffness_n_per_m) * q.max(0.0),
            Force::Gradual { stiffness_n_per_m, at_m, width_m } => {
                let half_n_per_m = 0.5 * stiffness_n_per_m.max(-0.9 * plant.stiffness_n_per_m);
                // Not `hypot`, which is slow for numbers that need no such care.
                let bent_m = |from_m: f64| (from_m * from_m + width_m * width_m).sqrt();
                half_n_per_m * (q + bent_m(q - at_m) - bent_m(at_m))
            }
            Force::Presliding { coulomb_n, presliding_m } => coulomb_n * dragged(z, by_m, presliding_m),
            Force::Slider { coulomb_n, slip_m } => coulomb_n * stretched(z, by_m, slip_m),
            Force::Patch { coulomb_n, slip_m, at_m, half_width_m } => {
                coulomb_n * on_patch(q, slip_m, at_m, half_width_m) * stretched(z, by_m, slip_m)
            }
            Force::Detent { period_m, sin_n, cos_n } => detent(q, period_m, sin_n, cos_n)[0],
            Force::BoucWen(law) => law.after(z, by_m),
            Force::Stop { at_m, stiffness_n_per_m, damping_s_per_m } => {
                against_stop_n([at_m, stiffness_n_per_m, damping_s_per_m], q, w)
            }
            Force::Pad { at_m, stiffness_n_per_m, exponent } => {
                let (unit_m, depth) = in_pad(at_m, q);
                stiffness_n_per_m * unit_m * depth.powf(exponent) * at_m.signum()
            }
            Force::Smooth { .. } | Force::Power { .. } => 0.0,
        };
    }
    sum_n
}

/// Most steps of Newton's method towards a rest, over how far a slope is taken, and the share of a force that may be left.
const MOST_STEPS: usize = 100;
const SLOPE_M: f64 = 1e-10;
const LEFT: f64 = 1e-10;

/// Where the structure rests that the plant's own spring alone would let rest at `straight_m`, friction holding nothing: there if nothing else pushes, or
/// where the forces have no rest nearby.
pub(super) fn rests_at(plant: &Phs, forces: &[Force], straight_m: f64) -> f64 {
    let slid = vec![0.0; forces.len()];
    let off_n = |q: f64| plant.stiffness_n_per_m * (q - straight_m) + elastic_n(plant, forces, &slid, 0.0, [q, 0.0]);
    if forces.is_empty() || off_n(straight_m) == 0.0 {
        return straight_m;
    }
    let mut q = straight_m;
    for _ in 0..MOST_STEPS {
        let slope = (off_n(q + SLOPE_M) - off_n(q - SLOPE_M)) / (2.0 * SLOPE_M);
        // What pushes on where it pushes more goes on until its slope is the plant's again.
        let step_m = -off_n(q) / if slope > 0.0 { slope } else { plant.stiffness_n_per_m };
        // On either side of an edge of a contact each step would lead to the other one for ever.
        let taken = [1.0, 0.5, 0.25, 0.125].into_iter().find(|part| off_n(q + part * step_m).abs() < off_n(q).abs());
        let Some(taken) = taken else { break };
        q += taken * step_m;
    }
    let is_rest = off_n(q).abs() <= LEFT * plant.stiffness_n_per_m * straight_m.abs().max(1e-6);
    if is_rest { q } else { straight_m }
}

fn drag(forces: &[Force], slid: &mut [f64], by_m: f64) {
    for (force, z) in forces.iter().zip(slid) {
        match *force {
            Force::Presliding { presliding_m, .. } => *z = dragged(*z, by_m, presliding_m),
            Force::Slider { slip_m, .. } | Force::Patch { slip_m, .. } => *z = stretched(*z, by_m, slip_m),
            Force::BoucWen(law) => *z = law.after(*z, by_m),
            _ => {}
        }
    }
}

/// A slider's z after `by_m` of motion one way.
fn stretched(z: f64, by_m: f64, slip_m: f64) -> f64 {
    (z + by_m / slip_m.max(1e-15)).clamp(-1.0, 1.0)
}

/// Dahl's z after `by_m` of motion one way: z' = (1 - z sign(q')) q' / presliding.
fn dragged(z: f64, by_m: f64, presliding_m: f64) -> f64 {
    let towards = by_m.signum();
    towards + (z - towards) * (-by_m.abs() / presliding_m.max(1e-15)).exp()
}
