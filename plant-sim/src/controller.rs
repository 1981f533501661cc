//! Controller files: what [`control_core::Settings`] needs, as TOML, each number with unit and source.

use crate::chain::{Chain, Lag};
use crate::model::HysteronSection;
use crate::param::Param;
use crate::phs::Hysteron;
use crate::toml_file::{self, FileError};
use control_core::{Inverse, InverseHysteron, InverseSettings, Law, Settings};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Schema of the files that this version reads and writes.
pub const SCHEMA: &str = "hysteron-controller-1";

/// A controller file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// [`SCHEMA`].
    pub schema: String,
    /// What it is, in words.
    pub name: String,
    /// Kp.
    #[serde(rename = "kp_V_per_m")]
    pub kp_v_per_m: Param,
    /// Ki.
    #[serde(rename = "ki_V_per_m_s")]
    pub ki_v_per_m_s: Param,
    /// k/alpha; zero for none.
    #[serde(rename = "feedforward_V_per_m")]
    pub feedforward_v_per_m: Param,
    /// No limit, guard or shaping at all: for reproduction only. Said aloud, so that a forgotten section is an error.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unlimited: bool,
    /// Volt and slew limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<LimitsSection>,
    /// Clamp and shaping of the reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<ReferenceSection>,
    /// Displacement trip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardSection>,
    /// The plant whose inverse takes the place of the static feedforward; boards have no room for it yet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inverse: Option<InverseSection>,
    /// How a designed controller came about; for readers, not used by any computation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub design: Option<toml::Table>,
}

/// `[inverse]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InverseSection {
    /// M.
    pub mass_kg: Param,
    /// b.
    #[serde(rename = "damping_N_s_per_m")]
    pub damping_n_s_per_m: Param,
    /// k.
    #[serde(rename = "stiffness_N_per_m")]
    pub stiffness_n_per_m: Param,
    /// alpha.
    #[serde(rename = "transduction_C_per_m")]
    pub transduction_c_per_m: Param,
    /// Time constant of the amplifier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplifier_us: Option<Param>,
    /// The hysterons.
    #[serde(default, rename = "hysteron", skip_serializing_if = "Vec::is_empty")]
    pub hysterons: Vec<HysteronSection>,
}

impl InverseSection {
    /// The inverse of the plant in `chain`, as far as the law can invert: effects that are hysterons, mass or an amplifier's lag count.
    pub fn of(chain: &Chain, source: &str) -> Self {
        let of = |value: f64| Param { value, sigma: None, sigma_abs: None, source: source.to_owned() };
        let hysteron = |h: &Hysteron| HysteronSection {
            capacitance_f: of(h.capacitance_f),
            slope_s: of(h.slope_s),
            dead_zone_v: of(h.dead_zone_v),
        };
        let plant = &chain.plant;
        let amplifier_us = match chain.drive.lag {
            Some(Lag::First { time_constant_s }) => Some(of(time_constant_s * 1e6)),
            Some(Lag::Second { natural_rad_per_s, damping_ratio }) => {
                Some(of(2.0 * damping_ratio / natural_rad_per_s * 1e6))
            }
            None => None,
        };
        Self {
            mass_kg: of(plant.mass_kg),
            damping_n_s_per_m: of(plant.damping_n_s_per_m),
            stiffness_n_per_m: of(plant.stiffness_n_per_m),
            transduction_c_per_m: of(plant.transduction_c_per_m),
            amplifier_us,
            hysterons: plant.hysterons.iter().map(hysteron).collect(),
        }
    }

    fn build(&self, rate_hz: f64, delay_s: f64) -> Result<Inverse, control_core::SettingsError> {
        let hysterons: Vec<InverseHysteron> = self
            .hysterons
            .iter()
            .map(|h| InverseHysteron {
                capacitance_f: h.capacitance_f.value as f32,
                slope_s: h.slope_s.value as f32,
                dead_zone_v: h.dead_zone_v.value as f32,
            })
            .collect();
        Inverse::try_build(&InverseSettings {
            rate_hz: rate_hz as f32,
            delay_s: delay_s as f32,
            mass_kg: self.mass_kg.value as f32,
            damping_n_s_per_m: self.damping_n_s_per_m.value as f32,
            stiffness_n_per_m: self.stiffness_n_per_m.value as f32,
            transduction_c_per_m: self.transduction_c_per_m.value as f32,
            amplifier_s: self.amplifier_us.as_ref().map_or(0.0, |p| (p.value * 1e-6) as f32),
            hysterons: &hysterons,
        })
    }
}

/// `[limits]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitsSection {
    /// Lowest drive.
    #[serde(rename = "min_V")]
    pub min_v: Param,
    /// Highest drive.
    #[serde(rename = "max_V")]
    pub max_v: Param,
    /// Largest change of the drive.
    #[serde(rename = "slew_V_per_s")]
    pub slew_v_per_s: Param,
}

/// `[reference]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceSection {
    /// Clamp on either side of zero.
    pub max_um: Param,
    /// Largest rate; absent means unshaped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_um_per_s: Option<Param>,
    /// Largest acceleration; absent means unshaped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration_um_per_s2: Option<Param>,
}

/// `[guard]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardSection {
    /// Displacement that must never be reached.
    pub trip_um: Param,
    /// How long the plant moves on after the trip.
    pub stop_time_us: Param,
}

impl Controller {
    /// Reads a controller file and checks that a law can be built from it at 20 kHz.
    ///
    /// # Errors
    /// One line naming file, key and what to do.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        toml_file::read(path, SCHEMA).and_then(|controller: Self| controller.valid(path))
    }

    /// The same from a text that `path` names in errors.
    ///
    /// # Errors
    /// As [`Controller::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        toml_file::parse(text, path, SCHEMA).and_then(|controller: Self| controller.valid(path))
    }

    /// Writes the controller, whole or not at all.
    ///
    /// # Errors
    /// The file that could not be written.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        toml_file::write(path, self)
    }

    fn valid(self, path: &Path) -> Result<Self, FileError> {
        let controller = self;
        let invalid = |reason: String| FileError::Invalid { path: path.to_owned(), reason };
        let guarded = [controller.limits.is_some(), controller.reference.is_some(), controller.guard.is_some()];
        if controller.unlimited && guarded.contains(&true) {
            return Err(invalid(
                "unlimited = true contradicts [limits], [reference] or [guard]: drop one of them".into(),
            ));
        }
        if !controller.unlimited {
            for (section, present) in ["limits", "reference", "guard"].iter().zip(guarded) {
                if !present {
                    return Err(invalid(format!("[{section}] is missing; without limits it needs `unlimited = true`")));
                }
            }
        }
        for (key, param) in controller.records() {
            // The law runs in f32, where a number beyond 3.4e38 would be an infinity and switch a guard off in silence.
            if !(param.value as f32).is_finite() {
                return Err(invalid(format!(
                    "{key} is {:?}: it must be a finite number; a controller without limits says `unlimited = true`",
                    param.value
                )));
            }
            for sigma in [param.sigma, param.sigma_abs].into_iter().flatten() {
                if !(sigma >= 0.0 && sigma.is_finite()) {
                    return Err(invalid(format!("{key} has sigma {sigma}: it must not be negative")));
                }
            }
        }
        Law::try_build(&controller.settings(20e3)).map_err(|e| invalid(in_keys(&e.to_string())))?;
        if let Some(section) = &controller.inverse {
            section.build(20e3, 0.0).map_err(|e| invalid(format!("[inverse]: {e}")))?;
        }
        Ok(controller)
    }

    /// The plant's inverse for a loop at `rate_hz` whose drive acts `delay_s` after the sample; `None` if the file has none.
    ///
    /// # Errors
    /// What can't be inverted at that rate.
    pub fn inverse(&self, rate_hz: f64, delay_s: f64) -> Result<Option<Inverse>, control_core::SettingsError> {
        self.inverse.as_ref().map(|section| section.build(rate_hz, delay_s)).transpose()
    }

    /// Every record with its key.
    fn records(&self) -> Vec<(&'static str, &Param)> {
        let mut records = vec![
            ("kp_V_per_m", &self.kp_v_per_m),
            ("ki_V_per_m_s", &self.ki_v_per_m_s),
            ("feedforward_V_per_m", &self.feedforward_v_per_m),
        ];
        if let Some(limits) = &self.limits {
            records.push(("limits.min_V", &limits.min_v));
            records.push(("limits.max_V", &limits.max_v));
            records.push(("limits.slew_V_per_s", &limits.slew_v_per_s));
        }
        if let Some(reference) = &self.reference {
            records.push(("reference.max_um", &reference.max_um));
            let shaping = [
                ("reference.rate_um_per_s", &reference.rate_um_per_s),
                ("reference.acceleration_um_per_s2", &reference.acceleration_um_per_s2),
            ];
            records.extend(shaping.into_iter().filter_map(|(key, param)| Some((key, param.as_ref()?))));
        }
        if let Some(guard) = &self.guard {
            records.push(("guard.trip_um", &guard.trip_um));
            records.push(("guard.stop_time_us", &guard.stop_time_us));
        }
        records
    }

    /// Settings in SI units for a loop at `rate_hz`.
    pub fn settings(&self, rate_hz: f64) -> Settings {
        let micro = |p: &Param| (p.value * 1e-6) as f32;
        let gains = [&self.kp_v_per_m, &self.ki_v_per_m_s, &self.feedforward_v_per_m].map(|p| p.value as f32);
        let mut settings = Settings::unlimited(rate_hz as f32, gains[0], gains[1], gains[2]);
        if let Some(limits) = &self.limits {
            settings.drive_min_v = limits.min_v.value as f32;
            settings.drive_max_v = limits.max_v.value as f32;
            settings.slew_v_per_s = limits.slew_v_per_s.value as f32;
        }
        if let Some(reference) = &self.reference {
            settings.reference_max_m = micro(&reference.max_um);
            settings.reference_rate_m_per_s = reference.rate_um_per_s.as_ref().map_or(f32::INFINITY, micro);
            settings.reference_acceleration_m_per_s2 =
                reference.acceleration_um_per_s2.as_ref().map_or(f32::INFINITY, micro);
        }
        if let Some(guard) = &self.guard {
            settings.trip_m = micro(&guard.trip_um);
            settings.stop_time_s = micro(&guard.stop_time_us);
        }
        settings
    }
}

/// Fields of [`Settings`], which the law's messages name, and the keys of a controller file that set them.
const KEYS: [(&str, &str); 10] = [
    ("kp_v_per_m", "kp_V_per_m"),
    ("ki_v_per_m_s", "ki_V_per_m_s"),
    ("feedforward_v_per_m", "feedforward_V_per_m"),
    ("drive_min_v", "limits.min_V"),
    ("drive_max_v", "limits.max_V"),
    ("slew_v_per_s", "limits.slew_V_per_s"),
    ("reference_max_m", "reference.max_um"),
    ("reference_acceleration_m_per_s2", "reference.acceleration_um_per_s2"),
    ("reference_rate_m_per_s", "reference.rate_um_per_s"),
    ("trip_m", "guard.trip_um"),
];

/// The law's message with the file's keys in place of its own fields.
fn in_keys(message: &str) -> String {
    let message = KEYS.iter().fold(message.to_owned(), |message, (field, key)| message.replace(field, key));
    message.replace("stop_time_s", "guard.stop_time_us")
}
