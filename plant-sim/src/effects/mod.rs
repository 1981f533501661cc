//! The registry of effects that a nominal plant may lack: each is a part of the chain with its numbers.
//!
//! One effect, one file, one line in [`REGISTRY`]. An entry says what the effect is, where its equation comes from, what reveals it and
//! what is mistaken for it; its [`Form`]s, the shapes in which the literature writes it, install it into a chain. Documentation, the
//! `effects` command, the diagnosis and its report all read this table.
//!
//! Not here: statistics. Which effect a log shows is `gap-diagnosis`' business.

use crate::chain::Chain;

pub use scales::Scales;

/// Declares the unit struct of an effect from its file's `ABOUT` and `FORMS`.
macro_rules! effect {
    ($name:ident, $id:literal, $stage:ident) => {
        /// See its `About`.
        pub struct $name;

        impl $crate::effects::Effect for $name {
            fn id(&self) -> &'static str {
                $id
            }
            fn stage(&self) -> $crate::effects::Stage {
                $crate::effects::Stage::$stage
            }
            fn about(&self) -> &'static $crate::effects::About {
                &ABOUT
            }
            fn forms(&self) -> &'static [$crate::effects::Form] {
                FORMS
            }
        }
    };
}

mod amplifier_bandwidth;
mod amplifier_gain;
mod amplifier_saturation;
mod amplifier_slew;
mod asymmetric_hysteresis;
mod asymmetric_stiffness;
mod backlash;
mod clock_error;
mod coulomb_friction;
mod creep;
mod end_stop;
mod extra_hysteron;
mod initial_state;
mod lost_samples;
mod mains_hum;
mod noise_excess;
mod nonlinear_stiffness;
mod parts;
mod payload_mass;
mod periodic_force;
mod quantisation;
mod rate_dependent_hysteresis;
mod sampling_jitter;
pub mod sane;
mod scales;
mod sensor_bandwidth;
mod sensor_drift;
mod sensor_gain;
mod sensor_nonlinearity;
mod sensor_offset;
mod thermal_gain;
mod transport_delay;
mod vibration_mode;

/// Every effect, stage by stage along the signal.
pub const REGISTRY: &[&dyn Effect] = &[
    &amplifier_gain::AmplifierGain,
    &amplifier_saturation::AmplifierSaturation,
    &amplifier_slew::AmplifierSlew,
    &amplifier_bandwidth::AmplifierBandwidth,
    &thermal_gain::ThermalGain,
    &creep::Creep,
    &extra_hysteron::ExtraHysteron,
    &asymmetric_hysteresis::AsymmetricHysteresis,
    &rate_dependent_hysteresis::RateDependentHysteresis,
    &initial_state::InitialState,
    &payload_mass::PayloadMass,
    &vibration_mode::VibrationMode,
    &nonlinear_stiffness::NonlinearStiffness,
    &asymmetric_stiffness::AsymmetricStiffness,
    &coulomb_friction::CoulombFriction,
    &end_stop::EndStop,
    &backlash::Backlash,
    &sensor_bandwidth::SensorBandwidth,
    &sensor_gain::SensorGain,
    &sensor_nonlinearity::SensorNonlinearity,
    &sensor_offset::SensorOffset,
    &sensor_drift::SensorDrift,
    &noise_excess::NoiseExcess,
    &quantisation::Quantisation,
    &transport_delay::TransportDelay,
    &lost_samples::LostSamples,
    &sampling_jitter::SamplingJitter,
    &clock_error::ClockError,
    &periodic_force::PeriodicForce,
    &mains_hum::MainsHum,
];

/// The effect with this identifier.
pub fn find(id: &str) -> Option<&'static dyn Effect> {
    REGISTRY.iter().copied().find(|effect| effect.id() == id)
}

/// An entry and its form of that name.
pub fn find_form(id: &str, name: &str) -> Option<(&'static dyn Effect, &'static Form)> {
    let effect = find(id)?;
    Some((effect, effect.forms().iter().find(|form| form.name == name)?))
}

/// The identifier that `text` most resembles, by the fewest letters to change.
pub fn nearest(text: &str) -> &'static str {
    let distances = REGISTRY.iter().map(|effect| (distance(text, effect.id()), effect.id()));
    distances.min().map_or("", |(_, id)| id)
}

/// Letters to insert, delete or replace (Levenshtein's distance).
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// Something that a bench does and a nominal plant doesn't.
pub trait Effect: Sync {
    /// Identifier, fixed: files and scripts rely on it.
    fn id(&self) -> &'static str;
    /// Where in the chain it sits.
    fn stage(&self) -> Stage;
    /// What there is to say about it.
    fn about(&self) -> &'static About;
    /// Its forms, the most common first; at least one.
    fn forms(&self) -> &'static [Form];
}

/// Stages of the chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Converter and amplifier.
    Drive,
    /// Ceramic: transduction and hysterons.
    Actuator,
    /// Mass, springs, contact, friction.
    Structure,
    /// Displacement sensor and its converter.
    Sensor,
    /// When things are sampled and arrive.
    Timing,
    /// What comes from outside.
    Environment,
}

impl Stage {
    /// As in `diagnosis.json`.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Drive => "drive",
            Stage::Actuator => "actuator",
            Stage::Structure => "structure",
            Stage::Sensor => "sensor",
            Stage::Timing => "timing",
            Stage::Environment => "environment",
        }
    }
}

/// What an engineer wants to know about an effect.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Name in words.
    pub title: &'static str,
    /// What it is, one sentence.
    pub what: &'static str,
    /// Its equation, all letters explained.
    pub equation: &'static str,
    /// Where the equation comes from.
    pub source: &'static str,
    /// How large it usually is.
    pub typical: &'static str,
    /// The part of the chain that it installs.
    pub installs: &'static str,
    /// What reveals it in a log.
    pub signature: &'static str,
    /// Identifiers of entries that look alike.
    pub rivals: &'static [&'static str],
    /// The experiment that separates it from them, in words.
    pub experiment: &'static str,
    /// The same as a SPEC, for a 60 V rig; empty where no command separates it (a tap or a weight does).
    pub spec: &'static str,
}

/// One way to write an effect down.
#[derive(Clone, Copy)]
pub struct Form {
    /// Name within the effect.
    pub name: &'static str,
    /// How it shows.
    pub kind: Kind,
    /// Its parameters on a plant and logs of these scales; the order is that of the values of `install`.
    pub parameters: fn(&Scales<'_>) -> Vec<Parameter>,
    /// Puts it into a chain, on top of what is there. At zero amplitude the chain behaves as before, but steps through the same parts:
    /// so a difference between amplitudes shows the effect and not another way of stepping.
    pub install: fn(&mut Chain, &[f64]),
    /// Entry that moves the readings in exactly the same way, and is the likelier of the two.
    pub mirrors: Option<&'static str>,
}

impl Form {
    /// A form that a simulation with the right numbers predicts.
    const fn predictable(
        name: &'static str,
        parameters: fn(&Scales<'_>) -> Vec<Parameter>,
        install: fn(&mut Chain, &[f64]),
    ) -> Self {
        Self { name, kind: Kind::Predictable, parameters, install, mirrors: None }
    }

    /// The same where no log tells it from entry `id`, which is the likelier.
    const fn mirroring(self, id: &'static str) -> Self {
        Self { mirrors: Some(id), ..self }
    }

    /// Values of its parameters at typical size, shapes and places at the first of their starts.
    pub fn typical(&self, scales: &Scales<'_>) -> Vec<f64> {
        let value = |parameter: &Parameter| match &parameter.role {
            Role::Amplitude(typical) => *typical,
            Role::Shape(starts) | Role::Place(starts) => starts[0],
        };
        (self.parameters)(scales).iter().map(value).collect()
    }
}

/// How a form shows in a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A simulation with the right numbers predicts it.
    Predictable,
    /// It changes the size of what can't be predicted, by itself or with the motion.
    Spread,
    /// What can't be predicted does this in the mean: it is no effect without its spread.
    Mean,
    /// Readings lie on a lattice.
    Lattice,
    /// It acts at single instants that nobody foresees.
    Events,
    /// It is in the state at the start, and dies out.
    Start,
}

/// A number of a form.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, ending in its unit: `time_constant_s`; no ending for a pure number.
    pub name: &'static str,
    /// Unit as a reader writes it, empty for a pure number.
    pub unit: &'static str,
    /// Smallest and largest value that makes sense.
    pub bounds: [f64; 2],
    /// How the diagnosis walks through the bounds.
    pub role: Role,
    /// Which logs have the same.
    pub scope: Scope,
}

/// Which logs have the same value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All of them.
    AllLogs,
    /// Each has its own, which its first stretch tells, as it tells the start: the phase of a line.
    EachStart,
    /// Each has its own, which nothing tells beforehand: the size of a drift that is still to come.
    EachLog,
}

/// What a parameter does to a prediction.
#[derive(Clone, Debug, PartialEq)]
pub enum Role {
    /// The effect vanishes at zero and grows in proportion at first; a value of typical size.
    Amplitude(f64),
    /// It shapes the effect; values from which a search may start. Walked through by its logarithm.
    Shape(Vec<f64>),
    /// The same, walked through as it is.
    Place(Vec<f64>),
}

impl Parameter {
    /// An amplitude between `low` and `high` that is typically `typical`.
    pub fn amplitude(name: &'static str, unit: &'static str, [low, high]: [f64; 2], typical: f64) -> Self {
        Self { name, unit, bounds: [low, high], role: Role::Amplitude(typical), scope: Scope::AllLogs }
    }

    /// A positive shape with values to start from.
    pub fn shape(name: &'static str, unit: &'static str, bounds: [f64; 2], starts: Vec<f64>) -> Self {
        Self { name, unit, bounds, role: Role::Shape(starts), scope: Scope::AllLogs }
    }

    /// A shape that may have either sign, with values to start from.
    pub fn place(name: &'static str, unit: &'static str, bounds: [f64; 2], starts: Vec<f64>) -> Self {
        Self { name, unit, bounds, role: Role::Place(starts), scope: Scope::AllLogs }
    }

    /// An amplitude of either sign, at most `largest`.
    pub fn signed(name: &'static str, unit: &'static str, largest: f64, typical: f64) -> Self {
        Self::amplitude(name, unit, [-largest, largest], typical)
    }

    /// The same, one for every log.
    pub fn of_each_log(self) -> Self {
        Self { scope: Scope::EachLog, ..self }
    }

    /// The same, which the first stretch of a log tells.
    pub fn told_at_once(self) -> Self {
        Self { scope: Scope::EachStart, ..self }
    }

    /// Whether every log has its own.
    pub fn is_of_each_log(&self) -> bool {
        self.scope != Scope::AllLogs
    }
}

/// `count` values spaced evenly in logarithm from `low` to `high`, both included.
pub fn spaced(low: f64, high: f64, count: usize) -> Vec<f64> {
    let step = (high / low).ln() / (count.max(2) - 1) as f64;
    (0..count).map(|i| low * (step * i as f64).exp()).collect()
}
