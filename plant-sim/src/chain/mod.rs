//! The plant as a chain of parts: command -> drive -> actuator and structure -> sensor -> displacement.
//!
//! Every command reads this one chain. A nominal plant leaves most parts out; an unmodelled effect is a part that the nominal
//! chain lacks, so adding an effect to a plant means adding a part here and nothing else.
//!
//! Within the sample that starts at t_k: the sensor reads the displacement at t_k; the command of row k reaches the plant at t_k
//! plus the latency plus the drive's own delay, any real number of samples later, and is held until the next one arrives.

mod drive;
mod parts;
mod sensor;

pub use drive::{Drive, Heat, Warming};
pub use parts::{Bend, BendLaw, Force, Joint, Mode, Parts};
pub use sensor::{Drift, Line, Sensor, SensorState};

use crate::exact::{Dynamics, MAX_STATES, Spans, Stepper, pack, stepper, unpack};
use crate::phs::{Phs, PhsState};
use std::collections::VecDeque;

/// A fraction of a sample below which a delay counts as a whole number of samples: rounding of the numbers that state it.
const WHOLE: f64 = 1e-9;

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

/// A linear low-pass with unit gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lag {
    /// 1 / (1 + s T).
    First {
        /// T in seconds.
        time_constant_s: f64,
    },
    /// w^2 / (s^2 + 2 z w s + w^2).
    Second {
        /// w in rad/s.
        natural_rad_per_s: f64,
        /// z.
        damping_ratio: f64,
    },
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
    drive: Drive,
    offset_m: f64,
    stepper: Box<dyn Stepper>,
    /// Commands on their way, the oldest (acting) one first.
    pending: VecDeque<Held>,
    /// What is held until the first command arrives, and how many samples ahead of `pending` it stands in the queue. Counted and not
    /// queued, because a file may state any delay.
    before: Held,
    before_samples: f64,
    sample_s: f64,
    /// Time from a sample's start until the command that arrives within it does; zero if commands arrive at sample starts.
    fraction_s: f64,
}

impl Simulator {
    /// A chain at the relaxed state, zero volts before the first command.
    ///
    /// `latency_s` is the time from sampling to the new command leaving the controller; any real >= 0.
    pub fn new(chain: &Chain, sample_s: f64, latency_s: f64) -> Self {
        let delay = (latency_s + chain.drive.delay_s) / sample_s;
        let mut whole = delay.floor();
        let mut fraction = delay - whole;
        if fraction > 1.0 - WHOLE {
            whole += 1.0;
        }
        if !(WHOLE..=1.0 - WHOLE).contains(&fraction) {
            fraction = 0.0;
        }
        let fraction_s = fraction * sample_s;
        let spans = if fraction > 0.0 { Spans::split(sample_s, fraction_s) } else { Spans::whole(sample_s) };
        Self {
            plant: chain.plant.clone(),
            drive: chain.drive.clone(),
            offset_m: chain.sensor.offset_m,
            stepper: stepper(&Dynamics::of_plant(&chain.plant), spans),
            pending: VecDeque::new(),
            before: Held::zero_order(0.0),
            before_samples: whole + if fraction > 0.0 { 1.0 } else { 0.0 },
            sample_s,
            fraction_s,
        }
    }

    /// Starts from `state` with `drive_v` held ever before.
    pub fn start_from(&mut self, state: &PhsState, drive_v: f64) {
        self.stepper.set_state(&pack(state));
        self.before = Held::zero_order(drive_v);
    }

    /// The state at the present sample's start.
    pub fn state(&self) -> PhsState {
        unpack(self.stepper.as_ref(), self.plant.hysterons.len())
    }

    /// Displacement at the present sample's start as an ideal sensor reads it: with the sensor's offset, without noise.
    pub fn reading_m(&self) -> f64 {
        self.stepper.state(0) + self.offset_m
    }

    /// Velocity at the present sample's start.
    pub fn velocity_m_per_s(&self) -> f64 {
        self.stepper.state(1)
    }

    /// Takes the command of the present sample and moves to the next sample's start, under external force `force_n`.
    pub fn advance(&mut self, command: Held, force_n: f64) {
        self.pending.push_back(command);
        let acting = self.take_oldest();
        if self.fraction_s > 0.0 {
            // The old command has acted for the rest of a sample already.
            self.push(0, acting, self.sample_s - self.fraction_s, self.fraction_s, force_n);
            let arriving = if self.before_samples >= 1.0 { Some(self.before) } else { self.pending.front().copied() };
            self.push(1, arriving.unwrap_or(command), 0.0, self.sample_s - self.fraction_s, force_n);
        } else {
            self.push(0, acting, 0.0, self.sample_s, force_n);
        }
    }

    fn take_oldest(&mut self) -> Held {
        if self.before_samples >= 1.0 {
            self.before_samples -= 1.0;
            return self.before;
        }
        self.pending.pop_front().unwrap_or(self.before)
    }

    fn push(&mut self, span: usize, held: Held, age_s: f64, duration_s: f64, force_n: f64) {
        let alpha = self.plant.transduction_c_per_m;
        let start_v = self.drive.output_v(held.start_v + held.slope_v_per_s * age_s);
        if held.slope_v_per_s == 0.0 {
            self.stepper.advance(span, alpha * start_v - force_n, 0.0);
        } else {
            let end_v = self.drive.output_v(held.start_v + held.slope_v_per_s * (age_s + duration_s));
            self.stepper.advance(span, alpha * start_v - force_n, alpha * (end_v - start_v) / duration_s);
        }
    }
}
