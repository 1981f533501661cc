//! Model files: the chain's parameters as TOML, each number with unit, uncertainty and source.
//!
//! Micrometres and microseconds appear in the keys here and nowhere else; [`Model::chain`] turns them into SI.

mod effect_section;
mod hysteresis;
mod kinds;

pub use effect_section::EffectSection;
pub use hysteresis::HysteresisSection;
pub use kinds::{Kind, Numbers, StateSpaceSection, TransferFunctionSection};

use crate::chain::{Chain, Drive, MAX_HYSTERONS, Sensor};
use crate::effects::{Effect, Form};
use crate::param::Param;
use crate::phs::{Hysteron, Phs, PhsState};
use crate::replay::Start;
use crate::toml_file::{self, FileError};
use control_core::Settings;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Schema of the files that this version reads and writes.
pub const SCHEMA: &str = "hysteron-model-1";

/// A model file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// [`SCHEMA`].
    pub schema: String,
    /// What it describes, in words.
    pub name: String,
    /// Which equations.
    pub kind: Kind,
    /// Converter and amplifier.
    #[serde(default, skip_serializing_if = "DriveSection::is_empty")]
    pub drive: DriveSection,
    /// Transducer and hysterons.
    #[serde(default, skip_serializing_if = "ActuatorSection::is_absent")]
    pub actuator: ActuatorSection,
    /// Mass, spring, damper.
    #[serde(default, skip_serializing_if = "StructureSection::is_absent")]
    pub structure: StructureSection,
    /// Of the kinds with a law of hysteresis.
    #[serde(default, skip_serializing_if = "HysteresisSection::is_empty")]
    pub hysteresis: HysteresisSection,
    /// Of the kind `state-space`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state_space: Option<StateSpaceSection>,
    /// Of the kind `transfer-function`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transfer_function: Option<TransferFunctionSection>,
    /// Displacement sensor.
    #[serde(default, skip_serializing_if = "SensorSection::is_empty")]
    pub sensor: SensorSection,
    /// Effects beyond the nominal plant, in the order in which they are put into the chain.
    #[serde(default, rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSection>,
    /// What experiments on the real plant must respect; simulated plants don't.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<RigSection>,
    /// State at the start of a run that is simulated; absent means relaxed. How a log begins, `--initial` says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_state: Option<InitialStateSection>,
    /// How a fitted model came about; for readers, not used by any computation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<toml::Table>,
}

/// `[drive]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSection {
    /// Lowest output.
    #[serde(rename = "min_V", default, skip_serializing_if = "Option::is_none")]
    pub min_v: Option<Param>,
    /// Highest output.
    #[serde(rename = "max_V", default, skip_serializing_if = "Option::is_none")]
    pub max_v: Option<Param>,
    /// Pure delay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_us: Option<Param>,
    /// Step of the digital-to-analog converter, at the actuator.
    #[serde(rename = "quantum_V", default, skip_serializing_if = "Option::is_none")]
    pub quantum_v: Option<Param>,
}

impl DriveSection {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// `[actuator]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSection {
    /// alpha; a coulomb per metre is also a newton per volt.
    #[serde(rename = "transduction_C_per_m")]
    pub transduction_c_per_m: Param,
    /// The hysterons.
    #[serde(default, rename = "hysteron", skip_serializing_if = "Vec::is_empty")]
    pub hysterons: Vec<HysteronSection>,
}

/// What stands in the file's place where a kind has no such section.
const ABSENT: &str = "absent";

fn absent() -> Param {
    Param { value: 1.0, sigma: None, sigma_abs: None, source: ABSENT.to_owned() }
}

impl Default for ActuatorSection {
    fn default() -> Self {
        Self { transduction_c_per_m: absent(), hysterons: Vec::new() }
    }
}

impl ActuatorSection {
    fn is_absent(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for StructureSection {
    fn default() -> Self {
        Self { mass_kg: absent(), damping_n_s_per_m: absent(), stiffness_n_per_m: absent() }
    }
}

impl StructureSection {
    fn is_absent(&self) -> bool {
        *self == Self::default()
    }
}

/// `[[actuator.hysteron]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HysteronSection {
    /// C.
    #[serde(rename = "capacitance_F")]
    pub capacitance_f: Param,
    /// beta, slope of the admittance beyond the dead zone.
    #[serde(rename = "slope_S")]
    pub slope_s: Param,
    /// d, full width of the dead zone.
    #[serde(rename = "dead_zone_V")]
    pub dead_zone_v: Param,
}

/// `[structure]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StructureSection {
    /// M.
    pub mass_kg: Param,
    /// b.
    #[serde(rename = "damping_N_s_per_m")]
    pub damping_n_s_per_m: Param,
    /// k.
    #[serde(rename = "stiffness_N_per_m")]
    pub stiffness_n_per_m: Param,
}

/// `[sensor]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSection {
    /// Reading at zero displacement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_um: Option<Param>,
    /// White noise, rms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_um: Option<Param>,
    /// Step of the analog-to-digital converter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quantum_um: Option<Param>,
}

impl SensorSection {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// `[rig]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigSection {
    /// Lowest drive that the amplifier or the actuator stands.
    #[serde(rename = "drive_min_V")]
    pub drive_min_v: Param,
    /// Highest drive.
    #[serde(rename = "drive_max_V")]
    pub drive_max_v: Param,
    /// Largest displacement on either side.
    pub displacement_max_um: Param,
}

/// Settings of a loop that let it go beyond what the rig stands.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BeyondRig {
    /// The guard would trip too late.
    #[error(
        "the displacement trip of {trip_um} um lies above [rig] displacement_max_um = {most_um}: set it to {most_um} um at the most"
    )]
    Trip {
        /// As set.
        trip_um: f64,
        /// What the rig stands.
        most_um: f64,
    },
    /// The law could drive too far.
    #[error("the drive limits of {} to {} V reach beyond [rig] drive_min_V = {} and drive_max_V = {}: set them within", limits_v[0], limits_v[1], rig_v[0], rig_v[1])]
    Drive {
        /// As set.
        limits_v: [f64; 2],
        /// What the rig stands.
        rig_v: [f64; 2],
    },
}

impl RigSection {
    /// Where a loop with these settings may go beyond the rig: by its guard's trip, and by the limits of its drive.
    pub fn beyond(&self, settings: &Settings) -> Vec<BeyondRig> {
        let most_um = self.displacement_max_um.value;
        let trip_um = seven_digits(f64::from(settings.trip_m) / MICRO);
        let is_guarded = trip_um <= most_um + slack(most_um);
        let limits_v = [settings.drive_min_v, settings.drive_max_v].map(|v| seven_digits(f64::from(v)));
        let trip = (!is_guarded).then_some(BeyondRig::Trip { trip_um, most_um });
        let drive = (!self.stands(limits_v)).then(|| BeyondRig::Drive { limits_v, rig_v: self.drive_v() });
        trip.into_iter().chain(drive).collect()
    }

    /// Whether a loop with these settings stays within the rig.
    ///
    /// # Errors
    /// All that lies beyond, in one line.
    pub fn check(&self, settings: &Settings) -> Result<(), String> {
        let beyond: Vec<String> = self.beyond(settings).iter().map(ToString::to_string).collect();
        if beyond.is_empty() { Ok(()) } else { Err(beyond.join("; ")) }
    }

    /// Lowest and highest drive that it stands.
    pub fn drive_v(&self) -> [f64; 2] {
        [self.drive_min_v.value, self.drive_max_v.value]
    }

    /// Whether it stands drives between these two.
    pub fn stands(&self, [low_v, high_v]: [f64; 2]) -> bool {
        let [lowest_v, highest_v] = self.drive_v();
        low_v >= lowest_v - slack(lowest_v) && high_v <= highest_v + slack(highest_v)
    }
}

/// Settings and programs are f32: the rig's own number, set, may come back greater by a rounding.
fn slack(value: f64) -> f64 {
    value.abs() * f64::from(f32::EPSILON)
}

/// An f32's digits without those that only look like some.
fn seven_digits(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// `[initial_state]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InitialStateSection {
    /// q.
    pub displacement_um: f64,
    /// q'.
    pub velocity_um_per_s: f64,
    /// Voltage of each hysteron: those of the actuator, then those of the effects, which may be left out if they are zero.
    #[serde(rename = "hysteron_V")]
    pub hysteron_v: Vec<f64>,
    /// Drive that was held before the start.
    #[serde(rename = "drive_V")]
    pub drive_v: f64,
}

const MICRO: f64 = 1e-6;

/// How far beyond the bounds of plausibility a number is refused.
const BEYOND: f64 = 1e9;

/// Fastest resonance that is stepped through. Each of its periods is at least one move: at a fifth of this, a sample at 10 kHz took
/// 18 ms (transduction mistaken by a million, which is warned of). Beyond, a run would look like a hang.
const MOST_RAD_PER_S: f64 = 1e10;

fn or(param: &Option<Param>, otherwise: f64) -> f64 {
    param.as_ref().map_or(otherwise, |p| p.value)
}

impl Model {
    /// Reads and validates a model file.
    ///
    /// # Errors
    /// One line naming file, key and what to do.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        toml_file::read(path, SCHEMA).and_then(|model: Self| model.valid(path))
    }

    /// The same from a text that `path` names in errors.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        toml_file::parse(text, path, SCHEMA).and_then(|model: Self| model.valid(path))
    }

    fn valid(self, path: &Path) -> Result<Self, FileError> {
        self.validate().map_err(|reason| FileError::Invalid { path: path.to_owned(), reason })?;
        Ok(self)
    }

    /// Writes the model, whole or not at all.
    ///
    /// # Errors
    /// The file that could not be written.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        toml_file::write(path, self)
    }

    /// The chain in SI units, with its effects. What the registry doesn't know is left out; reading a file refuses it.
    pub fn chain(&self) -> Chain {
        let mut chain = self.nominal_chain();
        self.effects.iter().for_each(|effect| effect.install(&mut chain));
        chain
    }

    /// The same model with one more effect; `parameters` are in the order of the form's.
    pub fn with_effect(mut self, effect: &dyn Effect, form: &Form, parameters: &[Param]) -> Self {
        self.effects.push(EffectSection::new(effect, form, parameters));
        self
    }

    /// A model without any section.
    pub fn empty(name: &str) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            name: name.to_owned(),
            kind: Kind::Phs,
            drive: DriveSection::default(),
            actuator: ActuatorSection::default(),
            structure: StructureSection::default(),
            hysteresis: HysteresisSection::default(),
            state_space: None,
            transfer_function: None,
            sensor: SensorSection::default(),
            effects: Vec::new(),
            rig: None,
            initial_state: None,
            fit: None,
        }
    }

    /// The chain in SI units without its effects.
    pub fn nominal_chain(&self) -> Chain {
        Chain {
            drive: Drive {
                range_v: [or(&self.drive.min_v, f64::NEG_INFINITY), or(&self.drive.max_v, f64::INFINITY)],
                delay_s: or(&self.drive.delay_us, 0.0) * MICRO,
                quantum_v: or(&self.drive.quantum_v, 0.0),
                ..Drive::IDEAL
            },
            plant: self.stand_in().unwrap_or_else(|| Phs {
                mass_kg: self.structure.mass_kg.value,
                damping_n_s_per_m: self.structure.damping_n_s_per_m.value,
                stiffness_n_per_m: self.structure.stiffness_n_per_m.value,
                transduction_c_per_m: self.actuator.transduction_c_per_m.value,
                hysterons: self
                    .actuator
                    .hysterons
                    .iter()
                    .map(|h| Hysteron {
                        capacitance_f: h.capacitance_f.value,
                        slope_s: h.slope_s.value,
                        dead_zone_v: h.dead_zone_v.value,
                    })
                    .collect(),
            }),
            parts: self.kind_parts(),
            sensor: Sensor {
                offset_m: or(&self.sensor.offset_um, 0.0) * MICRO,
                noise_m: or(&self.sensor.noise_um, 0.0) * MICRO,
                quantum_m: or(&self.sensor.quantum_um, 0.0) * MICRO,
                ..Sensor::IDEAL
            },
        }
    }

    /// What a run begins with: the state that the file states and the drive held before it; everything zero where it states none.
    pub fn start(&self) -> Start {
        let relaxed = Start::relaxed(&self.chain());
        let Some(stated) = &self.initial_state else { return relaxed };
        let mut hysteron_v = stated.hysteron_v.clone();
        hysteron_v.resize(relaxed.state.hysteron_v.len(), 0.0);
        let state = PhsState {
            displacement_m: stated.displacement_um * MICRO,
            velocity_m_per_s: stated.velocity_um_per_s * MICRO,
            hysteron_v,
        };
        Start { state, drive_v: stated.drive_v, ..relaxed }
    }

    /// Every record with its key, its bounds of sense (positive, or not negative, or any) and its bounds of plausibility in SI.
    fn records(&self) -> Vec<(String, &Param, Sense, [f64; 2])> {
        use Sense::{Any, NotNegative, Positive};
        let mut records = Vec::new();
        if self.kind.has_structure() {
            records.extend([
                ("structure.mass_kg".to_owned(), &self.structure.mass_kg, Positive, [1e-7, 50.0]),
                ("structure.damping_N_s_per_m".into(), &self.structure.damping_n_s_per_m, NotNegative, [1e-5, 1e5]),
                ("structure.stiffness_N_per_m".into(), &self.structure.stiffness_n_per_m, Positive, [1.0, 1e10]),
                ("actuator.transduction_C_per_m".into(), &self.actuator.transduction_c_per_m, Positive, [1e-6, 1e3]),
            ]);
        }
        records.extend(self.hysteresis.records().into_iter().map(|(key, p, bounds)| (key, p, Any, bounds)));
        for (i, h) in self.actuator.hysterons.iter().enumerate() {
            let key = |name: &str| format!("actuator.hysteron[{}].{name}", i + 1);
            records.push((key("capacitance_F"), &h.capacitance_f, Positive, [1e-12, 1e-2]));
            records.push((key("slope_S"), &h.slope_s, NotNegative, [1e-15, 1e5]));
            records.push((key("dead_zone_V"), &h.dead_zone_v, NotNegative, [1e-3, 2e3]));
        }
        let optional = [
            ("drive.min_V", &self.drive.min_v, Any, [-2e3, 2e3]),
            ("drive.max_V", &self.drive.max_v, Any, [-2e3, 2e3]),
            ("drive.delay_us", &self.drive.delay_us, NotNegative, [1e-3, 1e6]),
            ("drive.quantum_V", &self.drive.quantum_v, NotNegative, [1e-7, 10.0]),
            ("sensor.offset_um", &self.sensor.offset_um, Any, [-1e5, 1e5]),
            ("sensor.noise_um", &self.sensor.noise_um, NotNegative, [1e-7, 100.0]),
            ("sensor.quantum_um", &self.sensor.quantum_um, NotNegative, [1e-7, 100.0]),
        ];
        records.extend(optional.into_iter().filter_map(|(key, p, s, r)| p.as_ref().map(|p| (key.to_owned(), p, s, r))));
        if let Some(rig) = &self.rig {
            records.push(("rig.drive_min_V".into(), &rig.drive_min_v, Any, [-2e3, 2e3]));
            records.push(("rig.drive_max_V".into(), &rig.drive_max_v, Any, [-2e3, 2e3]));
            records.push(("rig.displacement_max_um".into(), &rig.displacement_max_um, Positive, [1e-3, 1e4]));
        }
        records
    }

    fn validate(&self) -> Result<(), String> {
        self.validate_kind()?;
        for (key, param, sense, [low, high]) in self.records() {
            let value = param.value;
            let wrong = match sense {
                _ if !value.is_finite() => Some("must be a finite number"),
                Sense::Positive => (value <= 0.0).then_some("must be positive"),
                Sense::NotNegative => (value < 0.0).then_some("must not be negative"),
                Sense::Any => None,
            };
            // A unit may be mistaken by a million and more, which is warned of; far beyond, nothing can be computed with it.
            let absurd = value != 0.0 && (value.abs() > high * BEYOND || low > 0.0 && value.abs() < low / BEYOND);
            if let Some(wrong) = wrong.or(absurd.then_some("can't be: check its unit")) {
                return Err(format!("{key} is {value:?}: it {wrong}"));
            }
            check_sigma(&key, param)?;
        }
        // Those of the effects that depend on the plant are held against a plant that has been checked.
        let mut chain = self.nominal_chain();
        let nominal = chain.plant.clone();
        for (i, effect) in self.effects.iter().enumerate() {
            let key = format!("effect[{}]", i + 1);
            effect.validate(&key, &nominal)?;
            effect.install_where_it_acts(&key, &mut chain)?;
        }
        if or(&self.drive.min_v, f64::NEG_INFINITY) >= or(&self.drive.max_v, f64::INFINITY) {
            return Err("drive.min_V must lie below drive.max_V".to_owned());
        }
        let hysterons = self.actuator.hysterons.len();
        let plant = chain.plant;
        let stepped = plant.hysterons.len();
        if stepped > MAX_HYSTERONS {
            let of_effects = if stepped > hysterons { " with those of the effects" } else { "" };
            return Err(format!("{stepped} hysterons{of_effects}; at most {MAX_HYSTERONS} can be stepped"));
        }
        let springs = plant.hysterons.iter().map(|h| plant.transduction_c_per_m.powi(2) / h.capacitance_f);
        let resonance_rad_per_s = ((plant.stiffness_n_per_m + springs.sum::<f64>()) / plant.mass_kg).sqrt();
        if resonance_rad_per_s > MOST_RAD_PER_S {
            return Err(format!(
                "mass, stiffness, transduction and capacitances make a resonance of {:.1e} Hz: check their units",
                resonance_rad_per_s / std::f64::consts::TAU
            ));
        }
        if let Some(rig) = &self.rig
            && rig.drive_min_v.value >= rig.drive_max_v.value
        {
            return Err("rig.drive_min_V must lie below rig.drive_max_V".to_owned());
        }
        if let Some(start) = &self.initial_state {
            if ![hysterons, stepped].contains(&start.hysteron_v.len()) {
                return Err(format!(
                    "initial_state.hysteron_V has length {} and there are {hysterons} hysterons: give one number for each",
                    start.hysteron_v.len()
                ));
            }
            let numbers = [start.displacement_um, start.velocity_um_per_s, start.drive_v];
            if !numbers.iter().chain(&start.hysteron_v).all(|n| n.is_finite()) {
                return Err("initial_state holds a number that is not finite".to_owned());
            }
            if !self.kind.has_structure() && [start.displacement_um, start.velocity_um_per_s] != [0.0; 2] {
                return Err(format!(
                    "initial_state.displacement_um and velocity_um_per_s have no meaning in a model of kind {}, which begins at rest under drive_V: \
                     set them to zero",
                    self.kind.name()
                ));
            }
        }
        Ok(())
    }

    /// Numbers that are possible but look like a wrong unit, one plain line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self
            .records()
            .into_iter()
            .filter(|(_, param, _, [low, high])| param.value != 0.0 && !(*low..=*high).contains(&param.value))
            .map(|(key, param, _, [low, high])| {
                format!("{key} = {:e} is outside {low:e} .. {high:e}: check its unit", param.value)
            })
            .collect();
        let nominal = self.nominal_chain().plant;
        for (i, effect) in self.effects.iter().enumerate() {
            warnings.extend(effect.warnings(&format!("effect[{}]", i + 1), &nominal));
        }
        let gain_um_per_v = nominal.static_gain_m_per_v() / MICRO;
        if !(1e-4..=1e3).contains(&gain_um_per_v) {
            warnings.push(format!(
                "alpha/k = {gain_um_per_v:.3e} um/V is outside 1e-4 .. 1e3: check the units of stiffness and transduction"
            ));
        }
        warnings
    }

    /// The same for a plant that a live loop runs with.
    pub fn live_warnings(&self) -> Vec<String> {
        let mut warnings = self.warnings();
        if self.chain().sensor.has_own_clock() {
            warnings.push(
                "clock_error moves rows of a recording, and nothing in a loop that runs: it is left out here"
                    .to_owned(),
            );
        }
        warnings
    }
}

fn check_sigma(key: &str, param: &Param) -> Result<(), String> {
    for sigma in [param.sigma, param.sigma_abs].into_iter().flatten() {
        if !(sigma >= 0.0 && sigma.is_finite()) {
            return Err(format!("{key} has sigma {sigma}: it must not be negative"));
        }
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Sense {
    Positive,
    NotNegative,
    Any,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_holds_its_own_numbers_and_nothing_beyond() {
        let of = |value: f64| Param { value, sigma: None, sigma_abs: None, source: "test".to_owned() };
        // Those of the thesis' bender, and some that f32 rounds upwards.
        for [low_v, high_v, most_um] in [[-90.0, 90.0, 120.0], [-0.1, 0.7, 0.3], [-33.3, 66.6, 1e-3]] {
            let rig = RigSection { drive_min_v: of(low_v), drive_max_v: of(high_v), displacement_max_um: of(most_um) };
            let mut settings = Settings::unlimited(20e3, 0.0, 0.0, 0.0);
            assert!(matches!(
                rig.beyond(&settings)[..],
                [BeyondRig::Trip { trip_um: f64::INFINITY, .. }, BeyondRig::Drive { .. }]
            ));
            settings.trip_m = (most_um * 1e-6) as f32;
            assert!(matches!(rig.beyond(&settings)[..], [BeyondRig::Drive { .. }]));
            (settings.drive_min_v, settings.drive_max_v) = (low_v as f32, high_v as f32);
            assert_eq!(rig.beyond(&settings), []);
            // A part in 1e5 more is no rounding.
            let beyond = [
                Settings { trip_m: settings.trip_m * 1.00001, ..settings },
                Settings { drive_min_v: settings.drive_min_v * 1.00001, ..settings },
                Settings { drive_max_v: settings.drive_max_v * 1.00001, ..settings },
                Settings { trip_m: f32::NAN, ..settings },
            ];
            for settings in beyond {
                let line = rig.beyond(&settings).first().expect("something").to_string();
                assert!(line.contains("[rig]") && line.contains("set ") && !line.contains('\n'), "{line}");
            }
        }
    }
}
