//! The plant as a chain of parts: command -> drive -> actuator and structure -> sensor -> displacement.
//!
//! Every command reads this one chain. A nominal plant leaves most parts out; an unmodelled effect is a part that the nominal
//! chain lacks, so adding an effect to a plant means adding a part here and nothing else.
//!
//! Within the sample that starts at t_k: the sensor reads the displacement at t_k; the command of row k reaches the plant at t_k
//! plus the latency plus the drive's own delay, any real number of samples later, and is held until the next one arrives.

mod drive;
mod lag;
mod leak;
mod parts;
mod path;
pub mod power;
mod reading;
mod readout;
mod relax;
mod sensor;
mod shaking;
mod substep;
mod transducer;
mod waveform;

pub use drive::{Arrivals, Drive, Heat, Hinge, Late, Steeper, Warming};
pub use lag::{Growth, Lag};
pub use parts::{Arm, Bend, BendLaw, Force, Joint, Mode, Parts, Relaxation, Shake};
pub use reading::Reading;
pub use sensor::{Cycle, Drift, Flaw, Gap, Line, Sensor, SensorState, Settling, Stairs, Swing};
pub use transducer::DriveHysteresis;

use crate::exact::{Dynamics, MAX_STATES, Push, Spans, Stepper, pack, stepper, unpack};
use crate::linear::StateSpace;
use crate::phs::{Phs, PhsState};
use drive::Output;
use reading::Phasor;
use readout::Readout;
use shaking::Shaking;
use std::collections::VecDeque;
use substep::Laws;
use transducer::Transducer;
use waveform::{Stretch, Waveform};

/// A fraction of a sample below which a delay counts as a whole number of samples: rounding of the numbers that state it.
const WHOLE: f64 = 1e-9;

/// How far a drive goes where nothing says it, in volts: a bender's range. It decides the number of sub-steps against nonlinear springs, and how far
/// an amplifier's gain is looked at for margins.
const TYPICAL_V: f64 = 60.0;

/// Largest number of hysterons that a chain can step.
pub const MAX_HYSTERONS: usize = MAX_STATES - 2;

/// All parts with their parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Amplifier and converter in front of the actuator.
    pub drive: Drive,
    /// Actuator and structure.
    pub plant: Phs,
    /// What actuator and structure do beyond the nominal plant.
    pub parts: Parts,
    /// What turns displacement into the logged number.
    pub sensor: Sensor,
}

impl Chain {
    /// Whether the displacement behind play and lag, and the clock, are those of `other`: only what the reading makes of it differs.
    pub fn differs_in_reading_only(&self, other: &Chain) -> bool {
        self.drive == other.drive
            && self.plant == other.plant
            && self.parts == other.parts
            && self.sensor.before_reading() == other.sensor.before_reading()
    }

    /// Where the structure rests under a drive of `drive_v` at the actuator while hysterons hold their voltages, in metres.
    pub fn equilibrium_m(&self, drive_v: f64, hysteron_v: &[f64]) -> f64 {
        let missing_n = self.parts.transducer.as_ref().map_or(0.0, |part| part.rest_n(drive_v));
        let straight_m = self.plant.equilibrium_m(drive_v, missing_n, hysteron_v);
        substep::rests_at(&self.plant, &self.parts.forces, straight_m)
    }
}

/// A command as it is held: its value when it takes effect and its slope until the next one does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Volts at the instant it takes effect.
    pub start_v: f64,
    /// Volts per second; zero for a zero-order hold.
    pub slope_v_per_s: f64,
}

impl Held {
    /// A zero-order hold.
    pub fn zero_order(value_v: f64) -> Self {
        Self { start_v: value_v, slope_v_per_s: 0.0 }
    }
}

/// A chain in motion at a fixed sample rate.
pub struct Simulator {
    plant: Phs,
    stepper: Box<dyn Stepper>,
    readout: Readout,
    modes: Vec<Mode>,
    /// States whose sum the sensor sees: the displacement and those of parallel modes, or the sensor's lag.
    seen: Vec<usize>,
    /// Where the sensor's lag stands in the engine's states.
    lag: Option<usize>,
    /// Parallel modes that must not feel the engine's force, because laws are part of it.
    outside: Vec<(f64, Box<dyn Stepper>)>,
    shaking: Shaking,
    transducer: Option<Transducer>,
    is_massless: bool,
    /// Nothing warms, wanders or shakes, nothing but the drive's line pulls, and the mass takes its time.
    is_bare: bool,
    linear: Option<Box<Instead>>,
    sample_s: f64,
    pace: Pace,
    /// Volts at the actuator at the present sample's start.
    acting_v: f64,
    heats: Vec<HeatState>,
    swings: Vec<Swing>,
    /// Of each of them, in the middle of samples.
    swung: Vec<Phasor>,
}

/// A linear plant that the engine steps in place of actuator and structure; its first state is what is seen.
struct Instead {
    space: StateSpace,
    /// C A and C B: the rate of what is seen.
    rate: (Vec<f64>, f64),
}

/// How a sample is stepped through.
enum Pace {
    /// Whole, or in the two parts that a fractional delay makes: what the drive holds is constant, or a line.
    Exact(Box<Queue>),
    /// In equal sub-steps: the drive's output changes meanwhile, or laws act that are not affine.
    Fine(Box<Fine>),
}

/// Sub-steps of a sample.
struct Fine {
    waveform: Waveform,
    laws: Option<Laws>,
    count: usize,
    /// So many make a step that is short enough where no law is at work; one if that is never told.
    long: usize,
}

/// Commands on their way to a drive without memory.
struct Queue {
    output: Output,
    /// The oldest (acting) one first.
    pending: VecDeque<Held>,
    /// What is held until the first command arrives, and how many samples ahead of `pending` it stands in the queue. Counted and not
    /// queued, because a file may state any delay.
    before: Held,
    before_samples: f64,
    /// Time from a sample's start until the command that arrives within it does; zero if commands arrive at sample starts.
    fraction_s: f64,
}

/// Warmth and what it makes of the gain.
struct HeatState {
    warming: Warming,
    sample_s: f64,
    /// Shares of the way to equilibrium that half a sample and a whole one make.
    half: f64,
    whole: f64,
    theta: f64,
    heating: f64,
    last_v: f64,
}

impl Simulator {
    /// A chain at the relaxed state, zero volts before the first command.
    ///
    /// `latency_s` is the time from sampling to the new command leaving the controller; any real >= 0.
    pub fn new(chain: &Chain, sample_s: f64, latency_s: f64) -> Self {
        let delay_s = latency_s + chain.drive.delay_s;
        let parts = &chain.parts;
        let plain = substep::without_bent_leaks(&chain.plant, &parts.bends);
        let parallel = |mode: &Mode| matches!(mode.joint, Joint::Parallel { .. });
        let is_apart = parts.need_substeps() || !parts.shakes.is_empty();
        let (outside, modes): (Vec<Mode>, Vec<Mode>) = parts.modes.iter().partition(|mode| is_apart && parallel(mode));
        let linear = parts.linear.as_ref().and_then(StateSpace::output_first);
        let mut dynamics = match &linear {
            Some(space) => Dynamics::of_linear(space),
            None => Dynamics::with_modes(&plain, &modes),
        };
        let first_mode = chain.plant.hysterons.len() + 2;
        let mut seen = vec![0];
        seen.extend((0..modes.len()).filter(|&i| parallel(&modes[i])).map(|i| first_mode + 2 * i));
        let feedthrough = linear.as_ref().is_some_and(|space| space.d != 0.0);
        let is_plain = chain.sensor.play_m == 0.0 && chain.sensor.lag_growth == Growth::NONE;
        let in_engine = is_plain && outside.is_empty() && !feedthrough && !parts.is_massless;
        let lag =
            chain.sensor.lag.filter(|lag| in_engine && lag.acts() && dynamics.states() + 2 <= MAX_STATES).map(|lag| {
                let at = dynamics.states();
                dynamics = dynamics.clone().with_lag(lag, &seen);
                at
            });
        let (pace, spans) = if chain.drive.has_memory() || parts.need_substeps() || !outside.is_empty() {
            let stroke_m = TYPICAL_V * chain.plant.static_gain_m_per_v();
            let [count, idle] =
                if parts.need_substeps() { substep::substeps(&chain.plant, parts, stroke_m, sample_s) } else { [1; 2] };
            // Where something else pulls beside the drive it is not known how much before the step.
            let long = if parts.shakes.is_empty() && parts.transducer.is_none() { count / idle } else { 1 };
            let laws = parts.need_substeps().then(|| Laws::new(&chain.plant, parts, &modes, dynamics.states()));
            let waveform = Waveform::new(&chain.drive, sample_s, delay_s, parts.transducer.is_some());
            let durations_s = [count, idle].map(|count| sample_s / count as f64);
            let spans = if long > 1 { Spans::two(durations_s) } else { Spans::whole(durations_s[0]) };
            (Pace::Fine(Box::new(Fine { waveform, laws, count, long })), spans)
        } else {
            let queue = Box::new(Queue::new(&chain.drive, delay_s / sample_s, sample_s));
            let fraction_s = queue.fraction_s;
            let spans = if fraction_s > 0.0 { Spans::split(sample_s, fraction_s) } else { Spans::whole(sample_s) };
            (Pace::Exact(queue), spans)
        };
        let spans_outside = spans;
        let outside = outside.iter().filter_map(|mode| match mode.joint {
            Joint::Parallel { compliance_m_per_n } => {
                let alone = Dynamics::of_parallel(mode, compliance_m_per_n);
                Some((compliance_m_per_n, stepper(&alone, spans_outside)))
            }
            Joint::Attached { .. } => None,
        });
        Self {
            plant: chain.plant.clone(),
            stepper: stepper(&dynamics, spans),
            readout: Readout::new(&chain.sensor, parts, sample_s, lag.is_some()),
            outside: outside.collect(),
            modes,
            seen: lag.map_or(seen, |lag| vec![lag]),
            lag,
            shaking: Shaking::new(&parts.shakes, spans),
            transducer: parts.transducer.clone().map(Transducer::new),
            is_massless: parts.is_massless,
            is_bare: chain.drive.warmings.is_empty()
                && chain.drive.swings.is_empty()
                && parts.shakes.is_empty()
                && parts.transducer.is_none()
                && !parts.is_massless,
            linear: linear.map(|space| {
                let rate = (space.a.row(0).iter().copied().collect(), space.b[0]);
                Box::new(Instead { space, rate })
            }),
            sample_s,
            pace,
            acting_v: 0.0,
            heats: chain.drive.warmings.iter().map(|warming| HeatState::new(*warming, sample_s)).collect(),
            swung: chain.drive.swings.iter().map(|swing| Phasor::new(swing.hz, sample_s, 0.5 * sample_s)).collect(),
            swings: chain.drive.swings.clone(),
        }
    }

    /// Play and presliding friction begin with this `share` of the most that they can hold, -1 to 1.
    pub fn remember(&mut self, share: f64) {
        if share == 0.0 {
            return;
        }
        self.readout.hold(share);
        if let Pace::Fine(fine) = &mut self.pace {
            fine.laws.iter_mut().for_each(|laws| laws.hold(share));
        }
    }

    /// Starts from `state` with `drive_v` held ever before.
    pub fn start_from(&mut self, state: &PhsState, drive_v: f64) {
        let mut packed = pack(state);
        let held_v = self.pace.rest_on(drive_v);
        let missing_n = self.transducer.as_mut().map_or(0.0, |transducer| {
            transducer.rest_on(held_v);
            transducer.now_n()
        });
        let held_n = self.plant.transduction_c_per_m * held_v - missing_n;
        // Oscillators begin at rest: attached ones where the mass is, parallel ones where the held force has brought them.
        for mode in &self.modes {
            packed.extend(match mode.joint {
                Joint::Attached { .. } => [state.displacement_m, 0.0],
                Joint::Parallel { compliance_m_per_n } => [compliance_m_per_n * held_n, 0.0],
            });
        }
        if let Some(lag) = self.lag {
            // What the lag follows has been where it is for long.
            let parallel = self.modes.iter().enumerate().filter(|(_, m)| matches!(m.joint, Joint::Parallel { .. }));
            let first_mode = state.hysteron_v.len() + 2;
            let seen_m = packed[0] + parallel.map(|(i, _)| packed[first_mode + 2 * i]).sum::<f64>();
            packed.resize(lag, 0.0);
            packed.push(seen_m);
        }
        if let Some(linear) = &self.linear {
            // What was held ever before has settled; a plant that integrates begins at zero.
            let settled = linear.space.steady_state(held_v);
            let settled = settled.filter(|x| x.iter().all(|x| x.is_finite()));
            let mut x: Vec<f64> = settled.map_or(vec![0.0; linear.space.a.nrows()], |x| x.iter().copied().collect());
            if self.lag.is_some() {
                x.push(x[0]);
            }
            packed = x;
        }
        self.stepper.set_state(&packed);
        for (compliance_m_per_n, mode) in &mut self.outside {
            mode.set_state(&[*compliance_m_per_n * held_n, 0.0]);
        }
        self.acting_v = held_v;
        self.heats.iter_mut().for_each(|heat| heat.last_v = held_v);
        self.readout.rest_at(self.seen_m());
    }

    /// Moves the oscillators of the chain, its modes and then its arms, by so much from where they rest: metres and m/s.
    pub fn swing(&mut self, parts: &Parts, from_rest: &[[f64; 2]]) {
        if from_rest.is_empty() || self.linear.is_some() {
            return;
        }
        let first_mode = self.plant.hysterons.len() + 2;
        let mut states = self.stepper.states().to_vec();
        let mut inside = states[first_mode..][..2 * self.modes.len()].chunks_exact_mut(2);
        let are_apart = !self.outside.is_empty();
        let mut outside = self.outside.iter_mut();
        for (mode, moved) in parts.modes.iter().zip(from_rest) {
            if are_apart && matches!(mode.joint, Joint::Parallel { .. }) {
                if let Some((_, mode)) = outside.next() {
                    mode.set_state(&[mode.state(0) + moved[0], mode.state(1) + moved[1]]);
                }
            } else if let Some(state) = inside.next() {
                state.iter_mut().zip(moved).for_each(|(state, moved)| *state += moved);
            }
        }
        self.stepper.set_state(&states);
        self.readout.rest_at(self.seen_m());
        self.readout.swing(from_rest.get(parts.modes.len()..).unwrap_or_default());
    }

    /// The state at the present sample's start.
    pub fn state(&self) -> PhsState {
        unpack(self.stepper.as_ref(), self.plant.hysterons.len())
    }

    /// The state of the plant and of the parts that store energy or turn it into heat, at the present sample's start.
    pub fn snapshot(&self) -> power::Snapshot {
        let first_mode = self.plant.hysterons.len() + 2;
        let modes = self.modes.iter().enumerate().filter(|(_, mode)| matches!(mode.joint, Joint::Attached { .. }));
        let slid = match &self.pace {
            Pace::Fine(fine) => fine.laws.as_ref().map_or(Vec::new(), |laws| laws.slid().to_vec()),
            Pace::Exact(_) => Vec::new(),
        };
        power::Snapshot {
            plant: self.state(),
            attached: modes.map(|(i, _)| [0, 1].map(|part| self.stepper.state(first_mode + 2 * i + part))).collect(),
            slid,
        }
    }

    /// Displacement and velocity of the structure, in metres and m/s, at the present sample's start.
    pub fn motion(&self) -> (f64, f64) {
        let at_once_m = self.linear.as_ref().map_or(0.0, |linear| linear.space.d * self.acting_v);
        (self.stepper.states()[0] + at_once_m, self.velocity_m_per_s())
    }

    #[inline]
    fn velocity_m_per_s(&self) -> f64 {
        let state = self.stepper.states();
        let Some(linear) = &self.linear else { return state[1] };
        let rate = linear.rate.0.iter().zip(state).map(|(weight, x)| weight * x).sum::<f64>();
        rate + linear.rate.1 * self.acting_v
    }

    /// Volts at the actuator at the present sample's start.
    pub fn drive_v(&self) -> f64 {
        self.acting_v
    }

    /// What the sensor predictably reads at the present sample's start, in metres.
    pub fn reading_m(&self) -> f64 {
        self.readout.reading_m()
    }

    /// What the sensor turns into that reading, in metres, behind play and lag, and the number of that sample, for [`Reading::at_m`].
    pub fn before_reading(&self) -> (f64, u64) {
        (self.readout.before_reading_m(), self.readout.sample())
    }

    #[inline]
    fn seen_m(&self) -> f64 {
        let state = self.stepper.states();
        self.seen.iter().map(|&seen| state[seen]).sum::<f64>()
            + self.outside.iter().map(|(_, mode)| mode.state(0)).sum::<f64>()
            + self.linear.as_ref().map_or(0.0, |linear| linear.space.d * self.acting_v)
    }

    /// Takes the command of the present sample and moves to the next sample's start, under external force `force_n`,
    /// which acts against positive displacement.
    #[inline]
    pub fn advance(&mut self, command: Held, force_n: f64) {
        match &mut self.pace {
            // Most samples of most plants: nothing of what follows acts.
            Pace::Exact(queue) if self.is_bare => {
                let pull = [self.plant.transduction_c_per_m, force_n];
                self.acting_v = queue.hold(self.stepper.as_mut(), self.sample_s, command, pull);
                self.readout.advance(self.seen_m(), self.velocity_m_per_s());
            }
            _ => self.advance_any(command, force_n),
        }
    }

    /// The same for every plant.
    #[inline(never)]
    fn advance_any(&mut self, command: Held, force_n: f64) {
        let sample_start_s = self.readout.time_s();
        let sample = self.readout.sample();
        let swung = Swing::gain(&self.swings, |number, _| self.swung[number].at(sample));
        let from_m = self.is_massless.then(|| self.stepper.state(0));
        let gain = self.heats.iter().map(HeatState::gain).product::<f64>() * swung;
        let alpha = self.plant.transduction_c_per_m * gain;
        let stepper = self.stepper.as_mut();
        let transducer = &mut self.transducer;
        let shaking = &self.shaking;
        self.acting_v = match &mut self.pace {
            Pace::Exact(queue) if transducer.is_none() && shaking.is_empty() => {
                queue.hold(stepper, self.sample_s, command, [alpha, force_n])
            }
            Pace::Exact(queue) => queue.advance(
                stepper,
                transducer,
                shaking,
                [sample_start_s, self.sample_s],
                command,
                [alpha, gain],
                force_n,
            ),
            Pace::Fine(fine) => {
                fine.waveform.push(command);
                let short_s = self.sample_s / fine.count as f64;
                let mut index = 0;
                while index < fine.count {
                    let from_s = index as f64 * short_s;
                    let idle_n = fine.idle_n(index, short_s, stepper.states(), alpha, force_n);
                    let (span, steps) = if idle_n.is_some() { (1, fine.long) } else { (0, 1) };
                    index += steps;
                    let step_s = steps as f64 * short_s;
                    let [start_v, slope, curve] = fine.waveform.parabola(from_s, step_s);
                    let mut push =
                        Push { force_n: alpha * start_v - force_n, slope: alpha * slope, curve: alpha * curve };
                    if let Some(transducer) = transducer {
                        push = push.without(transducer.missing(fine.waveform.course(), step_s).times(gain));
                    }
                    // Parallel modes feel what drive and outer force do to the mass, without shakes and laws.
                    for (_, mode) in &mut self.outside {
                        mode.push(span, push);
                    }
                    if !shaking.is_empty() {
                        push = push.with(shaking.push(span, sample_start_s + from_s));
                    }
                    match &mut fine.laws {
                        Some(laws) => laws.step(stepper, span, push, step_s, idle_n),
                        None => stepper.push(span, push),
                    }
                }
                fine.waveform.end_sample();
                fine.waveform.now_v()
            }
        };
        self.heats.iter_mut().for_each(|heat| heat.pass(self.acting_v));
        if let Some(from_m) = from_m {
            let missing_n = self.transducer.as_ref().map_or(0.0, Transducer::now_n);
            let shaken_n = self.shaking.now_n(sample_start_s + self.sample_s);
            let pull_n = alpha * self.acting_v - gain * missing_n - force_n + shaken_n;
            let place_m = pull_n / self.plant.stiffness_n_per_m;
            // It goes in no time at all, so that the mean over the sample is all there is to say of its velocity.
            self.stepper.set_state(&[place_m, (place_m - from_m) / self.sample_s]);
        }
        self.readout.advance(self.seen_m(), self.velocity_m_per_s());
    }
}

impl Pace {
    /// `drive_v` has been commanded ever before; returns the volts that it holds the actuator at.
    fn rest_on(&mut self, drive_v: f64) -> f64 {
        match self {
            Pace::Exact(queue) => {
                queue.before = Held::zero_order(drive_v);
                queue.output.at_v(drive_v)
            }
            Pace::Fine(fine) => {
                fine.waveform.rest_on(drive_v);
                fine.waveform.now_v()
            }
        }
    }
}

impl Fine {
    /// The laws' constant force against the motion over the long step that begins with sub-step `index`, if none is at work there.
    fn idle_n(&mut self, index: usize, short_s: f64, state: &[f64], alpha: f64, force_n: f64) -> Option<f64> {
        let laws = self.laws.as_mut().filter(|_| self.long > 1 && index.is_multiple_of(self.long))?;
        let long_s = self.long as f64 * short_s;
        let between_v = self.waveform.between_v(index as f64 * short_s, long_s)?;
        laws.idle_n(state, between_v.map(|drive_v| alpha * drive_v - force_n), long_s)
    }
}

impl Queue {
    /// A queue `delay` samples long.
    fn new(drive: &Drive, delay: f64, sample_s: f64) -> Self {
        let mut whole = delay.floor();
        let mut fraction = delay - whole;
        if fraction > 1.0 - WHOLE {
            whole += 1.0;
        }
        if !(WHOLE..=1.0 - WHOLE).contains(&fraction) {
            fraction = 0.0;
        }
        Self {
            output: Output::new(drive),
            pending: VecDeque::new(),
            before: Held::zero_order(0.0),
            before_samples: whole + if fraction > 0.0 { 1.0 } else { 0.0 },
            fraction_s: fraction * sample_s,
        }
    }

    /// Steps through one sample under force `alpha` times drive minus `force_n`, where nothing else pulls; returns the volts at its end.
    #[inline(always)]
    fn hold(&mut self, stepper: &mut dyn Stepper, sample_s: f64, command: Held, pull: [f64; 2]) -> f64 {
        let [acting, arriving] = self.take(command);
        let first_s = self.fraction_s;
        if first_s == 0.0 {
            return self.output.hold(stepper, 0, acting, [0.0, sample_s], pull);
        }
        if acting.slope_v_per_s == 0.0 && arriving.slope_v_per_s == 0.0 {
            let drive_v = [acting, arriving].map(|held| self.output.at_v(held.start_v));
            stepper.advance_both(drive_v.map(|drive_v| pull[0] * drive_v - pull[1]));
            return drive_v[1];
        }
        // The old command has acted for the rest of a sample already.
        self.output.hold(stepper, 0, acting, [sample_s - first_s, first_s], pull);
        self.output.hold(stepper, 1, arriving, [0.0, sample_s - first_s], pull)
    }

    /// The same where something does.
    #[expect(clippy::too_many_arguments, reason = "one sample needs them all, and a struct would be made anew in each")]
    fn advance(
        &mut self,
        stepper: &mut dyn Stepper,
        transducer: &mut Option<Transducer>,
        shaking: &Shaking,
        [sample_start_s, sample_s]: [f64; 2],
        command: Held,
        [alpha, gain]: [f64; 2],
        force_n: f64,
    ) -> f64 {
        let [acting, arriving] = self.take(command);
        let output = &self.output;
        let mut push = |span: usize, held: Held, age_s: f64, [from_s, duration_s]: [f64; 2]| {
            let start_v = output.at_v(held.start_v + held.slope_v_per_s * age_s);
            let end_v = output.at_v(held.start_v + held.slope_v_per_s * (age_s + duration_s));
            let slope = (end_v - start_v) / duration_s;
            let mut push = Push::ramp(alpha * start_v - force_n, alpha * slope);
            if let Some(transducer) = transducer {
                let course = [Stretch::line(start_v, slope, end_v, duration_s)];
                push = push.without(transducer.missing(&course, duration_s).times(gain));
            }
            if !shaking.is_empty() {
                push = push.with(shaking.push(span, sample_start_s + from_s));
            }
            stepper.push(span, push);
            end_v
        };
        if self.fraction_s > 0.0 {
            push(0, acting, sample_s - self.fraction_s, [0.0, self.fraction_s]);
            push(1, arriving, 0.0, [self.fraction_s, sample_s - self.fraction_s])
        } else {
            push(0, acting, 0.0, [0.0, sample_s])
        }
    }

    /// Takes the command of the sample that begins; returns what acts at its start and what comes within it.
    #[inline]
    fn take(&mut self, command: Held) -> [Held; 2] {
        // Nothing is on its way where commands act when they are given.
        if self.pending.is_empty() && self.before_samples < 1.0 {
            return [command; 2];
        }
        self.pending.push_back(command);
        let acting = if self.before_samples >= 1.0 {
            self.before_samples -= 1.0;
            self.before
        } else {
            self.pending.pop_front().unwrap_or(self.before)
        };
        let arriving = if self.before_samples >= 1.0 { Some(self.before) } else { self.pending.front().copied() };
        [acting, arriving.unwrap_or(command)]
    }
}

impl HeatState {
    /// Cold, after long at zero volts.
    fn new(warming: Warming, sample_s: f64) -> Self {
        let heating = if warming.heat == Heat::Time { 1.0 } else { 0.0 };
        let [half, whole] = [0.5, 1.0].map(|share| -(-share * sample_s / warming.time_constant_s).exp_m1());
        Self { warming, sample_s, half, whole, theta: 0.0, heating, last_v: 0.0 }
    }

    /// Gain in the middle of the present sample, if what heats stays as it is.
    fn gain(&self) -> f64 {
        1.0 + self.warming.coefficient * (self.theta + self.half * (self.heating - self.theta))
    }

    /// A sample passed that ended with `drive_v` on the actuator.
    fn pass(&mut self, drive_v: f64) {
        let heating = match self.warming.heat {
            Heat::Time => 1.0,
            Heat::Drive { volts } => (drive_v / volts).powi(2),
            Heat::Loss { volts2_per_s } => {
                // The integral of |v| |dv| over the sample, whatever its course: a step leaves as much heat as a ramp.
                let half_square = |v: f64| 0.5 * v * v.abs();
                (half_square(drive_v) - half_square(self.last_v)).abs() / (self.sample_s * volts2_per_s)
            }
        };
        self.last_v = drive_v;
        self.theta += self.whole * (heating - self.theta);
        // A step's loss is over with its sample.
        self.heating = if matches!(self.warming.heat, Heat::Loss { .. }) { self.theta } else { heating };
    }
}
