//! Names of what a case may contain: contracts.md's effect identifiers, and what no registry entry explains.

/// One effect that a diagnosis should name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EffectId {
    /// Slow motion after the fast one.
    Creep,
    /// A resonance that the nominal plant lacks.
    VibrationMode,
    /// A pure delay.
    TransportDelay,
    /// Rows sampled at times other than logged.
    SamplingJitter,
    /// Rows or commands that never arrived.
    LostSamples,
    /// Two clocks.
    ClockError,
    /// Volts out per volt in.
    AmplifierGain,
    /// A linear lag of the amplifier.
    AmplifierBandwidth,
    /// A bound on the rate of the drive.
    AmplifierSlew,
    /// A bound on the drive.
    AmplifierSaturation,
    /// A spring that is odd and not linear.
    NonlinearStiffness,
    /// A spring that differs by direction.
    AsymmetricStiffness,
    /// Dry friction.
    CoulombFriction,
    /// More memory than two hysterons have.
    ExtraHysteron,
    /// Loops that differ by sign.
    AsymmetricHysteresis,
    /// Loop width that depends on speed beyond the linear leak.
    RateDependentHysteresis,
    /// A linear lag of the sensor.
    SensorBandwidth,
    /// A constant error of the sensor.
    SensorOffset,
    /// Reading per displacement.
    SensorGain,
    /// A reading that wanders.
    SensorDrift,
    /// A curved sensor.
    SensorNonlinearity,
    /// More noise than the data sheet says.
    NoiseExcess,
    /// Lines of the mains.
    MainsHum,
    /// A lattice of converter codes.
    Quantisation,
    /// More moving mass.
    PayloadMass,
    /// Contact.
    EndStop,
    /// A gain that warms.
    ThermalGain,
    /// A force of constant frequency that nobody commanded.
    PeriodicForce,
    /// Play between mass and sensor.
    Backlash,
    /// Row 0 out of equilibrium.
    InitialState,
    /// A nominal number that is wrong beyond its sigma.
    ParameterError,
}

/// Every effect with its identifier and the stage of the chain it lives in, in contracts.md's order.
const NAMES: [(EffectId, &str, &str); 31] = [
    (EffectId::Creep, "creep", "actuator"),
    (EffectId::VibrationMode, "vibration_mode", "structure"),
    (EffectId::TransportDelay, "transport_delay", "timing"),
    (EffectId::SamplingJitter, "sampling_jitter", "timing"),
    (EffectId::LostSamples, "lost_samples", "timing"),
    (EffectId::ClockError, "clock_error", "timing"),
    (EffectId::AmplifierGain, "amplifier_gain", "drive"),
    (EffectId::AmplifierBandwidth, "amplifier_bandwidth", "drive"),
    (EffectId::AmplifierSlew, "amplifier_slew", "drive"),
    (EffectId::AmplifierSaturation, "amplifier_saturation", "drive"),
    (EffectId::NonlinearStiffness, "nonlinear_stiffness", "structure"),
    (EffectId::AsymmetricStiffness, "asymmetric_stiffness", "structure"),
    (EffectId::CoulombFriction, "coulomb_friction", "structure"),
    (EffectId::ExtraHysteron, "extra_hysteron", "actuator"),
    (EffectId::AsymmetricHysteresis, "asymmetric_hysteresis", "actuator"),
    (EffectId::RateDependentHysteresis, "rate_dependent_hysteresis", "actuator"),
    (EffectId::SensorBandwidth, "sensor_bandwidth", "sensor"),
    (EffectId::SensorOffset, "sensor_offset", "sensor"),
    (EffectId::SensorGain, "sensor_gain", "sensor"),
    (EffectId::SensorDrift, "sensor_drift", "sensor"),
    (EffectId::SensorNonlinearity, "sensor_nonlinearity", "sensor"),
    (EffectId::NoiseExcess, "noise_excess", "sensor"),
    (EffectId::MainsHum, "mains_hum", "environment"),
    (EffectId::Quantisation, "quantisation", "sensor"),
    (EffectId::PayloadMass, "payload_mass", "structure"),
    (EffectId::EndStop, "end_stop", "structure"),
    (EffectId::ThermalGain, "thermal_gain", "actuator"),
    (EffectId::PeriodicForce, "periodic_force", "environment"),
    (EffectId::Backlash, "backlash", "structure"),
    (EffectId::InitialState, "initial_state", "actuator"),
    (EffectId::ParameterError, "parameter_error", "actuator"),
];

impl EffectId {
    /// All of them, in contracts.md's order.
    pub fn all() -> impl Iterator<Item = EffectId> {
        NAMES.iter().map(|(effect, _, _)| *effect)
    }

    /// Identifier as contracts.md has it.
    pub fn id(self) -> &'static str {
        NAMES[self as usize].1
    }

    /// Stage as contracts.md has it: drive, actuator, structure, sensor, timing or environment.
    pub fn stage(self) -> &'static str {
        NAMES[self as usize].2
    }

    /// The effect of an identifier.
    pub fn from_id(id: &str) -> Option<Self> {
        NAMES.iter().find(|(_, name, _)| *name == id).map(|(effect, _, _)| *effect)
    }
}

/// Something real that is none of the effects above: the right answer is `unknown`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ForeignKind {
    /// Hidden motion of a second axis.
    CrossAxisCoupling,
    /// The actuator can only push: in tension its contact opens.
    PreloadGap,
    /// Dead zones that grow with drive power.
    SelfHeatingHysteresis,
    /// A limiter between log and amplifier that nobody told of: large changes reach it in steps.
    ControlClipping,
    /// Noise that grows with the reading.
    MultiplicativeNoise,
    /// Stiffness that moves as the bench warms.
    ThermalStiffness,
    /// Stiffness that swings at a fixed frequency.
    ParametricResonance,
    /// A reading that sticks, then jumps.
    SensorStiction,
}

impl ForeignKind {
    /// All of them.
    pub const ALL: [ForeignKind; 8] = [
        ForeignKind::CrossAxisCoupling,
        ForeignKind::PreloadGap,
        ForeignKind::SelfHeatingHysteresis,
        ForeignKind::ControlClipping,
        ForeignKind::MultiplicativeNoise,
        ForeignKind::ThermalStiffness,
        ForeignKind::ParametricResonance,
        ForeignKind::SensorStiction,
    ];

    /// A name for files and tables.
    pub fn id(self) -> &'static str {
        match self {
            ForeignKind::CrossAxisCoupling => "cross_axis_coupling",
            ForeignKind::PreloadGap => "preload_gap",
            ForeignKind::SelfHeatingHysteresis => "self_heating_hysteresis",
            ForeignKind::ControlClipping => "control_clipping",
            ForeignKind::MultiplicativeNoise => "multiplicative_noise",
            ForeignKind::ThermalStiffness => "thermal_stiffness",
            ForeignKind::ParametricResonance => "parametric_resonance",
            ForeignKind::SensorStiction => "sensor_stiction",
        }
    }

    /// The kind of a name.
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.id() == id)
    }
}

/// What a case is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Nothing: the plant file is right within its sigma.
    Null,
    /// One or two effects. An empty list is `Null`.
    Effects(Vec<EffectId>),
    /// Something outside the registry.
    Foreign(ForeignKind),
}

/// Which cases may be looked at when: the diagnosis is written on `Develop`, its thresholds are set on `Calibrate`, and
/// what is claimed is measured on `Report`.
///
/// For 30 of the 31 effects `Report` has a form that no other split shows, for 14 of them nothing but such; 18 of its 60
/// forms another split shows too. The foreign kinds have one form each, the same in every split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Split {
    /// Textbook forms, relaxed starts, the log set of design.md.
    Develop,
    /// Partly other forms, nuisances, random excitation.
    Calibrate,
    /// Again partly other forms.
    Report,
}

impl Split {
    /// Lower-case name.
    pub fn id(self) -> &'static str {
        match self {
            Split::Develop => "develop",
            Split::Calibrate => "calibrate",
            Split::Report => "report",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_follows_the_enum() {
        for (at, (effect, id, _)) in NAMES.iter().enumerate() {
            assert_eq!(*effect as usize, at);
            assert_eq!(EffectId::from_id(id), Some(*effect));
        }
        for kind in ForeignKind::ALL {
            assert_eq!(ForeignKind::from_id(kind.id()), Some(kind));
        }
    }
}
