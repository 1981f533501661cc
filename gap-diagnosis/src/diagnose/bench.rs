//! What the diagnosis fits: logs with their noise and a nominal plant with its uncertainty. With a hypothesis, a vector of coordinates
//! becomes one chain and one start for every log.

use super::hypothesis::{Axis, Freedom, Held, Hypothesis, Installed};
use crate::identify::parameters::{Free, Quantity, Scale};
use crate::identify::problem::Base;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use plant_sim::chain::{Chain, Parts, Sensor};
use plant_sim::effects::{Role, Scales, Scope};
use plant_sim::log::{Hold, Log, Meta};
use plant_sim::model::Model;
use plant_sim::param::{ASSUMED_MASS_SIGMA, ASSUMED_SIGMA, Param};
use plant_sim::replay::Start;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Farthest that a nominal number may move, as a natural logarithm.
const BOUND: f64 = 1.5;
/// What a hysteron may hold at rest in any case, as a share of its edge.
const LEAST_REACH: f64 = 0.1;
/// Width of what a hysteron holds that only motions near the rig's end fill, as atanh of a share of the most; one for the others.
const SELDOM: f64 = 0.5;
/// A unit of what a hysteron without a dead zone still holds, as a share of the drive.
const LEAKING: f64 = 0.05;
/// Thinnings that are tried, and the rows that the plant's own period keeps.
const FACTORS: [usize; 2] = [4, 2];
const ROWS_PER_PERIOD: f64 = 6.0;
/// Largest step of a logarithm in one iteration, and that of a frequency: a line's valley is narrow.
const LOG_STEP: f64 = 0.7;
const FREQUENCY_STEP: f64 = 0.04;
/// Least share of a noise's power that is there at rest: where a plant's file states errors of the instants and no noise it is not known.
const STILL_SHARE: f64 = 0.01;
/// Information that numbers get which rounding can't tell from one another, in shares of their own.
const ALIKE: f64 = 1e-8;
/// Steps of a converter up to so many times the noise, rounding included, are dithered by it: what is white of it is 0.4 of a step then.
const DITHERED: f64 = 2.0;

/// One log as the diagnosis sees it.
#[derive(Clone, Debug)]
pub struct Record<'a> {
    /// The log.
    pub log: &'a Log,
    /// Rows at the start that are simulated, neither fitted nor scored.
    pub run_in: usize,
    /// Rms of the noise in metres.
    pub noise_m: f64,
    /// Share of that which is none of the motion, as far as the nominal plant tells.
    pub not_motion: f64,
    /// Rms in metres of what the errors of the instants that the plant states do to this log.
    pub jitter_m: f64,
    /// The same of all that the plant states to scatter beside its sensor's white noise: slow noise and rounding as well.
    pub scatter_m: f64,
    /// Step of the lattice on which the readings lie if it is coarser than half the noise, else zero; metres.
    pub lattice_m: f64,
    /// Drive held before the first row, and how uncertain that is, in volts.
    pub before_v: [f64; 2],
    /// Every fifth stretch of this many rows is never fitted, only scored; none where other logs are there to score.
    pub held_stretch: Option<usize>,
    /// Rows that repeat the reading before, though readings have digits of their own: they were lost and are not fitted. Empty where none
    /// is.
    pub is_lost: Vec<bool>,
    /// What a reading of the drive monitor is uncertain by, in volts, if the log has one.
    pub monitor_v: Option<f64>,
}

impl Record<'_> {
    /// The same log with all of its rows fitted.
    pub fn whole(self) -> Self {
        Self { held_stretch: None, ..self }
    }

    /// Rms of the noise at rest in metres: without errors of the instants that the plant states.
    pub fn still_m(&self) -> f64 {
        let others_m2 = self.noise_m.powi(2) - self.jitter_m.powi(2);
        others_m2.max(STILL_SHARE * self.noise_m.powi(2)).sqrt()
    }

    /// Whether row `k` is kept from the fits.
    #[inline]
    pub fn holds_out(&self, k: usize) -> bool {
        self.held_stretch.is_some_and(|rows| k >= self.run_in && ((k - self.run_in) / rows) % 5 == 3)
    }

    /// Whether row `k` only repeats the one before.
    #[inline]
    pub fn has_lost(&self, k: usize) -> bool {
        self.is_lost.get(k).is_some_and(|lost| *lost)
    }

    /// Whether row `k` is fitted.
    #[inline]
    pub fn fits(&self, k: usize) -> bool {
        k >= self.run_in && !self.holds_out(k) && !self.has_lost(k)
    }

    /// What of a difference counts: what a reading on a lattice leaves open is no residual. Where noise takes readings from step to step, rounding is
    /// noise like any other (Schuchman 1964), and is in that of the log.
    #[inline]
    pub fn off_lattice_m(&self, difference_m: f64) -> f64 {
        if self.lattice_m > DITHERED * self.noise_m {
            // Not `max`, which would make a perfect fit of what is no number.
            let beyond_m = difference_m.abs() - 0.5 * self.lattice_m;
            if beyond_m < 0.0 { 0.0 } else { beyond_m.copysign(difference_m) }
        } else {
            difference_m
        }
    }

    /// What a volt at the drive monitor counts as in metres of displacement, so that both readings have one weight.
    pub fn monitor_m_per_v(&self) -> Option<f64> {
        self.monitor_v.map(|sigma_v| self.noise_m / sigma_v)
    }
}

/// A coordinate's place in the world: prior, bounds, largest step.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Centre of the prior.
    pub centre: f64,
    /// Standard deviation of the prior; infinite for none.
    pub sigma: f64,
    /// Smallest and largest coordinate.
    pub bounds: [f64; 2],
    /// Largest step in one iteration.
    pub most: f64,
    /// Step of finite differences.
    pub step: f64,
}

impl Rule {
    /// What coordinate `z` costs under the prior, chi-square.
    pub fn cost(&self, z: f64) -> f64 {
        ((z - self.centre) / self.sigma).powi(2)
    }

    /// The step of finite differences at `z`: towards the inside, so that a bound doesn't swallow it.
    pub fn inward_step(&self, z: f64) -> f64 {
        if z + self.step > self.bounds[1] { -self.step } else { self.step }
    }
}

/// Adds the priors of coordinates `z` to the information and the gradient of the data, both in the order of `rules`.
pub(super) fn add_priors(rules: &[Rule], z: &[f64], information: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
    for (i, rule) in rules.iter().enumerate() {
        // An infinite sigma adds nothing.
        information[(i, i)] += rule.sigma.powi(-2);
        gradient[i] -= (z[i] - rule.centre) * rule.sigma.powi(-2);
    }
}

/// Gives coordinates that change nothing and have no prior a unit of information, so that the rest can be solved.
pub(super) fn pin_idle(information: &mut DMatrix<f64>) {
    for i in 0..information.nrows() {
        if information[(i, i)] <= 0.0 {
            information[(i, i)] = 1.0;
        }
    }
}

/// The Cholesky factor of an information. Numbers that rounding can't tell from one another get so little more of it that each is known to
/// ten thousand times what it would be alone.
pub(super) fn factor(information: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    information.clone().cholesky().or_else(|| {
        let mut eased = information;
        for i in 0..eased.nrows() {
            eased[(i, i)] *= 1.0 + ALIKE;
        }
        eased.cholesky()
    })
}

/// The nominal plant and the logs.
pub struct Bench<'a> {
    /// The nominal model.
    pub model: &'a Model,
    /// Its chain with what of the sensor is predictable: noise and quantisation are what residuals are made of.
    pub chain: Chain,
    /// What it is made of.
    pub base: Base,
    /// Its uncertain numbers, the mass left out.
    pub free: Vec<Free>,
    /// Relative standard deviation of the mass.
    pub mass_sigma: f64,
    /// The logs.
    pub records: Vec<Record<'a>>,
    /// Every log with fewer rows, for sensitivities; none where every row is needed.
    pub thinned: Vec<Option<Thinned>>,
    /// Half of the largest spans, for the registry's bounds.
    pub stroke_m: f64,
    /// See `stroke_m`.
    pub drive_v: f64,
    /// Largest rate of the command, steps left out.
    pub rate_v_per_s: f64,
}

/// Relative standard deviation of a nominal number; none that is stated as zero is believed.
fn sigma_of(param: &Param, assumed: f64) -> f64 {
    Some(param.relative_sigma_or(assumed)).filter(|sigma| *sigma > 0.0).unwrap_or(assumed)
}

impl<'a> Bench<'a> {
    /// The same with some of its records: what coordinates and residuals count in stays, so that those of the one are those of the other.
    pub fn part(&self, records: Vec<Record<'a>>) -> Self {
        let Self { stroke_m, drive_v, rate_v_per_s, .. } = *self;
        Self { stroke_m, drive_v, rate_v_per_s, ..Self::of(self.model, records) }
    }

    /// The bench without log `index`.
    pub fn without(&self, index: usize) -> Self {
        let mut records = self.records.clone();
        records.remove(index);
        self.part(records)
    }

    /// The same bench with so many times its noise, the monitor's as well.
    pub fn noisier(&self, times: f64) -> Self {
        let mut bench = self.part(self.records.clone());
        for record in &mut bench.records {
            record.noise_m *= times;
            record.monitor_v = record.monitor_v.map(|sigma_v| times * sigma_v);
        }
        bench
    }

    /// A bench of `records`.
    pub fn new(model: &'a Model, mut records: Vec<Record<'a>>) -> Self {
        super::records::share_noise(&mut records, model.sensor.noise_um.as_ref());
        Self::of(model, records)
    }

    /// The same of records that know their noise.
    pub(super) fn of(model: &'a Model, records: Vec<Record<'a>>) -> Self {
        let mut base = Base { chain: model.nominal_chain(), effects: model.effects.clone() };
        // What the plant states it must replay; a bend that is followed coarsely leaves a gap of its own.
        base.chain.parts.is_coarse = model.chain().parts.bends.is_empty();
        let chain = predictable(base.at(&[], &[]));
        let mut writable = model.clone();
        let mut numbers = base.chain.clone();
        let free = Quantity::of(model)
            .into_iter()
            .map(|quantity| Free {
                quantity,
                prior: *quantity.number(&mut numbers),
                scale: Scale::Log { bound: BOUND },
                prior_sigma: sigma_of(quantity.record(&mut writable), ASSUMED_SIGMA),
            })
            .filter(|free| free.prior > 0.0)
            .chain(stated_offset(model))
            .collect();
        let span = |values: &[f64]| {
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            high - low
        };
        let half = |of: &dyn Fn(&Log) -> f64| 0.5 * records.iter().map(|r| of(r.log)).fold(0.0, f64::max);
        let stroke_m = half(&|log| span(&log.displacement_m)).max(1e-12);
        let drive_v = half(&|log| span(&log.command_v)).max(1e-9);
        let plant = &chain.plant;
        let natural_hz = (plant.stiffness_n_per_m / plant.mass_kg).sqrt() / TAU;
        let thinned = records.iter().map(|record| thinned(record.log, ROWS_PER_PERIOD * natural_hz)).collect();
        let rate_v_per_s = records.iter().map(|r| smooth_rate(r.log)).fold(0.0, f64::max);
        Self {
            model,
            chain,
            base,
            free,
            mass_sigma: sigma_of(&model.structure.mass_kg, ASSUMED_MASS_SIGMA),
            thinned,
            stroke_m,
            drive_v,
            rate_v_per_s: if rate_v_per_s > 0.0 { rate_v_per_s } else { drive_v * 100.0 },
            records,
        }
    }

    /// Sizes for the registry.
    pub fn scales(&self) -> Scales<'_> {
        let range = |of: &dyn Fn(&Log) -> [f64; 2]| {
            self.records
                .iter()
                .map(|r| of(r.log))
                .fold([0.0f64, 0.0f64], |all, one| [all[0].min(one[0]), all[1].max(one[1])])
        };
        Scales {
            command_v: range(&|log| extremes(log.command_v.iter().copied())),
            displacement_m: range(&|log| extremes(log.displacement_m.iter().copied())),
            plant: &self.chain.plant,
            stroke_m: self.stroke_m,
            drive_v: self.drive_v,
            rate_v_per_s: self.rate_v_per_s,
            sample_s: self.records.iter().map(|r| r.log.dt_s).fold(f64::INFINITY, f64::min),
            longest_s: self.records.iter().map(|r| r.log.len() as f64 * r.log.dt_s).fold(0.0, f64::max),
        }
    }

    /// Rms error of the sampling instants that the plant states, in seconds.
    pub fn stated_jitter_s(&self) -> f64 {
        self.model.chain().sensor.jitter_s
    }

    /// Whether a log tells drive from actuator.
    pub fn is_monitored(&self) -> bool {
        self.records.iter().any(|record| record.monitor_v.is_some())
    }

    /// Hysterons of the nominal plant and of what `hypothesis` adds.
    pub(super) fn hysterons(&self, hypothesis: &Hypothesis) -> usize {
        self.chain.plant.hysterons.len() + hypothesis.installed.iter().map(|i| i.holds.len()).sum::<usize>()
    }

    /// Which of them may hold something when a log begins.
    pub(super) fn memories(&self, hypothesis: &Hypothesis) -> Vec<usize> {
        let own = self.chain.plant.hysterons.iter().map(|hysteron| hysteron.edge_v() > 0.0);
        let added = hypothesis.installed.iter().flat_map(|installed| installed.holds.iter().copied());
        let may = |holds_at_rest: bool| match hypothesis.freedom {
            Freedom::Relaxed => false,
            Freedom::Rest => holds_at_rest,
            Freedom::Any => true,
        };
        own.chain(added).enumerate().filter(|(_, holds)| may(*holds)).map(|(i, _)| i).collect()
    }

    /// Oscillators of the nominal plant and of what `hypothesis` adds.
    pub(super) fn modes(&self, hypothesis: &Hypothesis) -> usize {
        let Parts { modes, arms, .. } = &self.chain.parts;
        modes.len() + arms.len() + hypothesis.installed.iter().map(|i| i.modes).sum::<usize>()
    }

    /// Coordinates that all logs share.
    pub fn shared(&self, hypothesis: &Hypothesis) -> usize {
        let own = |axis: &&Axis| !axis.parameter.is_of_each_log();
        self.free.len() + hypothesis.installed.iter().map(|i| i.axes.iter().filter(own).count()).sum::<usize>()
    }

    /// Coordinates of a log's start: volts before, hysterons, displacement and velocity, those of each oscillator, what else remembers.
    pub(super) fn start_count(&self, hypothesis: &Hypothesis) -> usize {
        let held = self.hysterons(hypothesis) + usize::from(hypothesis.remembers());
        match hypothesis.freedom {
            Freedom::Relaxed => 0,
            Freedom::Rest => 1 + held,
            Freedom::Any => 3 + held + 2 * self.modes(hypothesis),
        }
    }

    /// Where the coordinates of log `index`'s start are.
    pub(super) fn start_places(&self, hypothesis: &Hypothesis, index: usize) -> Range<usize> {
        let at = self.own_start(hypothesis, index);
        at..at + self.start_count(hypothesis)
    }

    /// Which of them say what the hysterons hold, in their order: none where logs begin relaxed.
    pub(super) fn held_places(&self, hypothesis: &Hypothesis, index: usize) -> Range<usize> {
        let at = self.own_start(hypothesis, index);
        match hypothesis.freedom {
            Freedom::Relaxed => at..at,
            // Behind the volts before.
            Freedom::Rest | Freedom::Any => at + 1..at + 1 + self.hysterons(hypothesis),
        }
    }

    /// Coordinates of log `index` that its first stretch tells: those of the start, then the forms' own.
    pub(super) fn told_by_start(&self, hypothesis: &Hypothesis, index: usize) -> Vec<usize> {
        let axes = hypothesis.installed.iter().flat_map(|installed| &installed.axes);
        let places = self.places(hypothesis, index).into_iter().flatten();
        let own = axes.zip(places).filter(|(axis, _)| axis.parameter.scope == Scope::EachStart).map(|(_, place)| place);
        self.start_places(hypothesis, index).chain(own).collect()
    }

    /// Coordinates of each log.
    pub fn own(&self, hypothesis: &Hypothesis) -> usize {
        let own = |axis: &&Axis| axis.parameter.is_of_each_log();
        self.start_count(hypothesis)
            + hypothesis.installed.iter().map(|i| i.axes.iter().filter(own).count()).sum::<usize>()
    }

    /// All coordinates.
    pub fn coordinates(&self, hypothesis: &Hypothesis) -> usize {
        self.shared(hypothesis) + self.records.len() * self.own(hypothesis)
    }

    /// Where the coordinates of log `index` begin.
    pub fn own_start(&self, hypothesis: &Hypothesis, index: usize) -> usize {
        self.shared(hypothesis) + index * self.own(hypothesis)
    }

    /// The coordinates that log `index` depends on: the shared ones, then its own.
    pub fn coordinates_of(&self, hypothesis: &Hypothesis, index: usize) -> Vec<usize> {
        let own = self.own_start(hypothesis, index);
        (0..self.shared(hypothesis)).chain(own..own + self.own(hypothesis)).collect()
    }

    /// Where each axis of the hypothesis sits: for log `index`, the coordinates of its axes, form by form.
    pub fn places(&self, hypothesis: &Hypothesis, index: usize) -> Vec<Vec<usize>> {
        let mut shared = self.free.len();
        let mut own = self.start_places(hypothesis, index).end;
        let place = |axis: &Axis| {
            let next = if axis.parameter.is_of_each_log() { &mut own } else { &mut shared };
            *next += 1;
            *next - 1
        };
        let mut place = place;
        hypothesis.installed.iter().map(|installed| installed.axes.iter().map(&mut place).collect()).collect()
    }

    /// Rules of all coordinates.
    pub fn rules(&self, hypothesis: &Hypothesis) -> Vec<Rule> {
        let mut rules: Vec<Rule> = self
            .free
            .iter()
            .map(|free| {
                let (reach, most, step) = match free.scale {
                    Scale::Log { .. } => (2.0, 0.3, 1e-4),
                    Scale::Shift { .. } | Scale::NotNegative { .. } => (1e6, f64::INFINITY, 1e-2),
                };
                Rule { centre: 0.0, sigma: free.prior_sigma, bounds: [-reach, reach], most, step }
            })
            .collect();
        rules.resize(
            self.coordinates(hypothesis),
            Rule { centre: 0.0, sigma: 1.0, bounds: [-3.0, 3.0], most: 1.0, step: 1e-3 },
        );
        for (index, record) in self.records.iter().enumerate() {
            let (at, held) = (self.own_start(hypothesis, index), self.held_places(hypothesis, index));
            if hypothesis.freedom != Freedom::Relaxed {
                // In volts.
                let [before_v, sigma_v] = record.before_v;
                let bounds = [before_v - 3.0 * self.drive_v, before_v + 3.0 * self.drive_v];
                let step = 1e-4 * self.drive_v;
                rules[at] = Rule { centre: before_v, sigma: sigma_v, bounds, most: self.drive_v, step };
                for (i, rule) in rules[held.clone()].iter_mut().enumerate() {
                    if self.reach(i, before_v)[0] < 1.0 {
                        rule.sigma = SELDOM;
                    }
                }
            }
            if hypothesis.freedom == Freedom::Any {
                let moving = held.end..held.end + 2 + 2 * self.modes(hypothesis);
                for rule in &mut rules[held.start..moving.end] {
                    (rule.bounds, rule.sigma) = ([-30.0, 30.0], 3.0);
                }
                // What moves is linear in them, or nearly so.
                rules[moving].iter_mut().for_each(|rule| rule.most = 10.0);
            }
            for (rule, usual) in rules[held].iter_mut().zip(&hypothesis.usually_held) {
                if let Some(Held { mean, width, .. }) = *usual {
                    (rule.centre, rule.sigma) = (mean, width.min(rule.sigma));
                }
            }
        }
        for index in 0..self.records.len() {
            for (installed, places) in hypothesis.installed.iter().zip(self.places(hypothesis, index)) {
                for (axis, place) in installed.axes.iter().zip(places) {
                    let is_frequency = axis.parameter.name.ends_with("hz");
                    let most = match axis.parameter.role {
                        Role::Amplitude(_) => f64::INFINITY,
                        _ if is_frequency => FREQUENCY_STEP,
                        Role::Shape(_) => LOG_STEP,
                        Role::Place(_) => 1.0,
                    };
                    let step = if is_frequency { 1e-5 } else { 1e-3 };
                    let [centre, sigma] = axis.usual.unwrap_or([0.0, f64::INFINITY]);
                    rules[place] = Rule { centre, sigma, bounds: axis.bounds(), most, step };
                }
            }
        }
        rules
    }

    /// Coordinates where their priors are centred: the nominal plant, every form at nothing, and before each log rest or what is usual.
    pub fn origin(&self, hypothesis: &Hypothesis) -> Vec<f64> {
        self.rules(hypothesis).iter().map(|rule| rule.centre).collect()
    }

    /// Sets the parameters of the form that was installed last, in all logs.
    pub fn set_last(&self, hypothesis: &Hypothesis, z: &mut [f64], values: &[f64]) {
        let Some(installed) = hypothesis.installed.last() else { return };
        for index in 0..self.records.len() {
            for ((axis, place), value) in
                installed.axes.iter().zip(self.places(hypothesis, index).pop().unwrap_or_default()).zip(values)
            {
                z[place] = axis.coordinate(*value);
            }
        }
    }

    /// Values of the forms' parameters for log `index`.
    pub fn values(&self, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Vec<Vec<f64>> {
        let value = |(installed, places): (&Installed, Vec<usize>)| {
            installed.axes.iter().zip(places).map(|(axis, place)| axis.value(z[place])).collect()
        };
        hypothesis.installed.iter().zip(self.places(hypothesis, index)).map(value).collect()
    }

    /// The same as the mean over all logs where each has its own.
    pub fn means(&self, hypothesis: &Hypothesis, z: &[f64]) -> Vec<Vec<f64>> {
        let logs: Vec<Vec<Vec<f64>>> = (0..self.records.len()).map(|index| self.values(hypothesis, z, index)).collect();
        let mean = |effect: usize, number: usize| {
            logs.iter().map(|values| values[effect][number]).sum::<f64>() / logs.len() as f64
        };
        let mut means = logs.first().cloned().unwrap_or_default();
        for (effect, installed) in hypothesis.installed.iter().enumerate() {
            for (number, _) in installed.axes.iter().enumerate().filter(|(_, axis)| axis.parameter.is_of_each_log()) {
                means[effect][number] = mean(effect, number);
            }
        }
        means
    }

    /// The chain of log `index`.
    pub fn chain_at(&self, hypothesis: &Hypothesis, z: &[f64], index: usize) -> Chain {
        let mut chain = predictable(self.base.at(&self.free, z));
        for (installed, values) in hypothesis.installed.iter().zip(self.values(hypothesis, z, index)) {
            (installed.form.install)(&mut chain, &values);
        }
        chain
    }

    /// What hysteron `i` may hold at rest under `rest_v`, as a share of its edge: no more than is left when a motion as far as the rig
    /// goes has driven it over its edge and has come back. Usually as far as it rests, and at the most with a step's overshoot.
    fn reach(&self, i: usize, rest_v: f64) -> [f64; 2] {
        let plant = &self.chain.plant;
        let (Some(rig), Some(hysteron)) = (&self.model.rig, plant.hysterons.get(i)) else { return [1.0; 2] };
        let damping_ratio = 0.5 * plant.damping_n_s_per_m / (plant.stiffness_n_per_m * plant.mass_kg).sqrt();
        let overshoot = (-PI * damping_ratio / (1.0 - damping_ratio.powi(2)).max(1e-9).sqrt()).exp();
        [1.0, 1.0 + overshoot].map(|ways| {
            let way_m = ways * rig.displacement_max_um.value * 1e-6 + (plant.static_gain_m_per_v() * rest_v).abs();
            let closed_v = plant.transduction_c_per_m * way_m / hysteron.capacitance_f;
            (closed_v / hysteron.edge_v() - 1.0).clamp(LEAST_REACH, 1.0)
        })
    }

    /// The start of log `index`.
    pub fn start_at(&self, hypothesis: &Hypothesis, z: &[f64], index: usize, chain: &Chain) -> Start {
        let own = &z[self.own_start(hypothesis, index)..];
        let hysterons = &chain.plant.hysterons;
        let count = hysterons.len().min(self.hysterons(hypothesis));
        let mut held_v = vec![0.0; hysterons.len()];
        let before_v = match hypothesis.freedom {
            Freedom::Relaxed => return Start::at_rest(chain, self.records[index].before_v[0], held_v),
            Freedom::Rest => {
                for i in 0..count {
                    let [usual, most] = self.reach(i, own[0]);
                    held_v[i] = most * hysterons[i].edge_v() * (usual / most * own[1 + i]).tanh();
                }
                own[0]
            }
            Freedom::Any => {
                for i in 0..count {
                    let edge_v = hysterons[i].edge_v();
                    held_v[i] = own[1 + i] * if edge_v > 0.0 { edge_v } else { LEAKING * self.drive_v };
                }
                own[0]
            }
        };
        let mut start = Start::at_rest(chain, before_v, held_v);
        if hypothesis.remembers() {
            // Last of a log's start.
            start = start.remembering(chain, own[self.start_count(hypothesis) - 1].tanh());
        }
        if hypothesis.freedom == Freedom::Any {
            let turning_per_s = (chain.plant.stiffness_n_per_m / chain.plant.mass_kg).sqrt();
            let moved = |at: usize, turning_per_s: f64| {
                let way_m = 0.1 * self.stroke_m;
                [way_m * own[at], way_m * turning_per_s * own[at + 1]]
            };
            let [moved_m, moved_m_per_s] = moved(1 + count, turning_per_s);
            start.state.displacement_m += moved_m;
            start.state.velocity_m_per_s += moved_m_per_s;
            let Parts { modes, arms, .. } = &chain.parts;
            let hz = modes.iter().map(|mode| mode.hz).chain(arms.iter().map(|arm| arm.hz));
            let hz = hz.enumerate().take(self.modes(hypothesis));
            start.modes = hz.map(|(i, hz)| moved(3 + count + 2 * i, TAU * hz)).collect();
        }
        start
    }
}

/// A log with one row in place of several, each with the mean of their commands.
pub struct Thinned {
    /// How many.
    pub factor: usize,
    /// The log.
    pub log: Log,
}

/// `log` at a rate of `least_hz` or more, if that saves rows.
fn thinned(log: &Log, least_hz: f64) -> Option<Thinned> {
    let factor = FACTORS.into_iter().find(|factor| log.dt_s * *factor as f64 * least_hz < 1.0)?;
    if log.meta.hold != Hold::Zoh || log.force_n.is_some() {
        return None;
    }
    let mean = |rows: &[f64]| rows.iter().sum::<f64>() / rows.len() as f64;
    let dt_s = log.dt_s * factor as f64;
    // A row stands for all that it replaces, which lie later in the mean; a command that comes within a row would cost every simulation as much again.
    let later_s = 0.5 * (dt_s - log.dt_s);
    let latency_s = dt_s * ((log.meta.latency_s - later_s) / dt_s).round().max(0.0);
    let log = Log {
        name: log.name.clone(),
        time_start_s: log.time_start_s,
        dt_s,
        command_v: log.command_v.chunks(factor).map(mean).collect(),
        displacement_m: log.displacement_m.iter().step_by(factor).copied().collect(),
        meta: Meta { latency_s, ..log.meta.clone() },
        ..Log::default()
    };
    Some(Thinned { factor, log })
}

/// `chain`, and of its sensor only what is predictable.
fn predictable(chain: Chain) -> Chain {
    let sensor =
        Sensor { noise_m: 0.0, quantum_m: 0.0, slow_noise_m: 0.0, jitter_s: 0.0, repeated_share: 0.0, ..chain.sensor };
    Chain { sensor, ..chain }
}

/// The sensor's zero, if the plant's file says how well it is known: what lies within that is no gap.
fn stated_offset(model: &Model) -> Option<Free> {
    let offset_um = model.sensor.offset_um.as_ref()?;
    let unit = offset_um.sigma_abs.filter(|sigma| *sigma > 0.0)? / Quantity::Offset.per_si();
    let prior = offset_um.value / Quantity::Offset.per_si();
    Some(Free { quantity: Quantity::Offset, prior, scale: Scale::Shift { unit }, prior_sigma: 1.0 })
}

/// Largest rate of a log's command that is not a step: the 99th percentile of its changes, in V/s.
fn smooth_rate(log: &Log) -> f64 {
    let mut changes: Vec<f64> = log.command_v.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    if changes.is_empty() {
        return 0.0;
    }
    let at = (changes.len() * 99 / 100).min(changes.len() - 1);
    *changes.select_nth_unstable_by(at, f64::total_cmp).1 / log.dt_s
}

/// Smallest and largest of `values`.
pub(super) fn extremes(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::thesis;
    use plant_sim::replay::predict;

    /// Two numbers of which only the sum is seen: rounding decides whether they have a factor, and each is known to so many times what it would be.
    #[test]
    fn numbers_that_rounding_cannot_tell_apart_are_known_to_little() {
        let alike = DMatrix::from_row_slice(2, 2, &[4.0, 4.0, 4.0, 4.0]);
        assert!(alike.clone().cholesky().is_none());
        let sigma = factor(alike).expect("a factor").inverse()[(0, 0)].sqrt();
        let times = sigma / 0.5;
        assert!((5e3..1e4).contains(&times), "{times}");
        let apart = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 4.0]);
        assert_eq!(factor(apart.clone()).map(|f| f.l()), apart.cholesky().map(|f| f.l()));
        assert!(factor(DMatrix::from_element(1, 1, -1.0)).is_none());
    }

    /// Sensitivities on a thinned log against the means of those on all rows, whatever the latency: what is left is that a row's commands count as one.
    #[test]
    fn a_row_of_a_thinned_log_stands_for_those_that_it_replaces() {
        let model = thesis();
        let wave = |hz: f64, t: f64| (TAU * hz * t).sin();
        for rows_late in [0.0, 0.2, 1.0, 1.5, 2.0, 3.0, 4.6, 6.0] {
            let command_v =
                (0..20_000).map(|k| 5e-5 * f64::from(k)).map(|t| 30.0 * wave(7.0, t) + 8.0 * wave(130.0, t));
            let mut log = Log { dt_s: 5e-5, command_v: command_v.collect(), ..Log::default() };
            log.displacement_m = vec![0.0; log.command_v.len()];
            log.meta.latency_s = rows_late * log.dt_s;
            let thinned = thinned(&log, ROWS_PER_PERIOD * 500.0).expect("a log that is worth thinning");
            let played = |log: &Log, more: f64| {
                let mut chain = model.chain();
                chain.plant.stiffness_n_per_m *= 1.0 + more;
                predict(&chain, log, &Start::relaxed(&chain), log.command_v.len())
            };
            let slopes = |log: &Log| -> Vec<f64> {
                played(log, 1e-4).iter().zip(played(log, 0.0)).map(|(moved, here)| moved - here).collect()
            };
            let of_rows = slopes(&log);
            let means = of_rows.chunks(thinned.factor).map(|rows| rows.iter().sum::<f64>() / rows.len() as f64);
            let (mut missed2, mut all2) = (0.0, 0.0);
            for (mean, one) in means.zip(slopes(&thinned.log)) {
                missed2 += (mean - one).powi(2);
                all2 += mean * mean;
            }
            let missed = f64::sqrt(missed2 / all2);
            println!("{rows_late} rows late, {} in one: {missed}", thinned.factor);
            // Half of a thinned row is what its latency may be off by, and nothing where it is a whole one less what a mean lies later.
            let most = if rows_late == 1.5 { 1e-3 } else { 0.02 };
            assert!(missed < most, "{rows_late} rows: {missed}");
        }
    }

    #[test]
    fn what_a_file_says_of_its_numbers_counts_however_it_says_it() {
        let mut model = thesis();
        model.structure.mass_kg.sigma = None;
        model.structure.stiffness_n_per_m = Param::absolute(25_000.0, 250.0, "");
        model.structure.damping_n_s_per_m = Param::new(3.7, 0.0, "");
        let bench = Bench::new(&model, Vec::new());
        let sigma = |quantity| bench.free.iter().find(|free| free.quantity == quantity).map(|free| free.prior_sigma);
        assert_eq!(bench.mass_sigma, 0.005);
        assert_eq!((sigma(Quantity::Stiffness), sigma(Quantity::Damping)), (Some(0.01), Some(0.02)));
    }

    #[test]
    fn a_hysteron_that_seldom_opens_holds_little_at_rest() {
        let mut model = thesis();
        let bench = Bench::new(&model, Vec::new());
        // 120 um close the fast one's 7.26 V by 9.85 V: 2.6 V stay when it has come back; the slow one opens at half of that.
        let closed_v = 0.046311 * 120e-6 / 5.6425e-7;
        let [usual, most] = bench.reach(0, 0.0);
        assert!((usual - (closed_v / 7.2563 - 1.0)).abs() < 1e-9, "{usual}");
        // A damping ratio of 0.374 overshoots by 28 %.
        assert!((most - (1.2816 * closed_v / 7.2563 - 1.0)).abs() < 1e-3, "{most}");
        assert_eq!(bench.reach(1, 0.0), [1.0; 2]);
        assert!(bench.reach(0, 30.0)[0] > usual);
        let rules = bench.rules(&Hypothesis::nominal(Freedom::Rest));
        assert_eq!(rules.len(), bench.free.len());
        model.rig = None;
        assert_eq!(Bench::new(&model, Vec::new()).reach(0, 0.0), [1.0; 2]);
    }
}
