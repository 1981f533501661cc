//! `[hysteresis]`: the numbers of a hysteresis operator, each kind with its own keys.

use super::{Kind, or};
use crate::bouc_wen::BoucWen;
use crate::operators::{Counts, Dahl, Duhem, KrasnoselskiiPokrovskii, Law, Play, Plays, Preisach};
use crate::param::Param;
use serde::{Deserialize, Serialize};

/// `[hysteresis]`: each kind takes the keys in its own units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HysteresisSection {
    /// A of a Bouc-Wen law driven by volts.
    #[serde(rename = "amplitude_per_V", default, skip_serializing_if = "Option::is_none")]
    pub amplitude_per_v: Option<Param>,
    /// beta of a Bouc-Wen law driven by volts.
    #[serde(rename = "beta_per_V", default, skip_serializing_if = "Option::is_none")]
    pub beta_per_v: Option<Param>,
    /// gamma of a Bouc-Wen law driven by volts.
    #[serde(rename = "gamma_per_V", default, skip_serializing_if = "Option::is_none")]
    pub gamma_per_v: Option<Param>,
    /// Kh: the force of h = 1.
    #[serde(rename = "force_N", default, skip_serializing_if = "Option::is_none")]
    pub force_n: Option<Param>,
    /// dp of (2.3).
    #[serde(rename = "gain_um_per_V", default, skip_serializing_if = "Option::is_none")]
    pub gain_um_per_v: Option<Param>,
    /// Displacement of h = 1 in (2.3).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_um: Option<Param>,
    /// A of a law driven by the displacement.
    #[serde(rename = "amplitude_N_per_m", default, skip_serializing_if = "Option::is_none")]
    pub amplitude_n_per_m: Option<Param>,
    /// beta of a law driven by the displacement, for n = 1; times N^(1-n) otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beta_per_m: Option<Param>,
    /// gamma of a law driven by the displacement, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gamma_per_m: Option<Param>,
    /// rho of Dahl's and Duhem's laws.
    #[serde(rename = "rate_per_V", default, skip_serializing_if = "Option::is_none")]
    pub rate_per_v: Option<Param>,
    /// b of Duhem's law.
    #[serde(rename = "slope_per_V", default, skip_serializing_if = "Option::is_none")]
    pub slope_per_v: Option<Param>,
    /// g of Duhem's law.
    #[serde(rename = "inner_slope_per_V", default, skip_serializing_if = "Option::is_none")]
    pub inner_slope_per_v: Option<Param>,
    /// Length of the ramps of Krasnosel'skii and Pokrovskii's kernels.
    #[serde(rename = "ramp_V", default, skip_serializing_if = "Option::is_none")]
    pub ramp_v: Option<Param>,
    /// n of Bouc-Wen, i of Dahl; 1 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<Param>,
    /// r of each play.
    #[serde(rename = "threshold_V", default, skip_serializing_if = "Vec::is_empty")]
    pub threshold_v: Vec<Param>,
    /// w of each play.
    #[serde(rename = "weight_per_V", default, skip_serializing_if = "Vec::is_empty")]
    pub weight_per_v: Vec<Param>,
    /// Edges of Preisach's cells, or levels of the kernels, rising.
    #[serde(rename = "level_V", default, skip_serializing_if = "Vec::is_empty")]
    pub level_v: Vec<Param>,
    /// Weight of each cell or kernel (up, down), down <= up, row by row: (1, 1), (2, 1), (2, 2), ...
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weight: Vec<Param>,
}

fn values(list: &[Param]) -> Vec<f64> {
    list.iter().map(|p| p.value).collect()
}

impl HysteresisSection {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Every key but the exponent with what stands there: one number, several or none.
    fn entries(&self) -> [(&'static str, &[Param]); 17] {
        [
            ("amplitude_per_V", self.amplitude_per_v.as_slice()),
            ("beta_per_V", self.beta_per_v.as_slice()),
            ("gamma_per_V", self.gamma_per_v.as_slice()),
            ("force_N", self.force_n.as_slice()),
            ("gain_um_per_V", self.gain_um_per_v.as_slice()),
            ("depth_um", self.depth_um.as_slice()),
            ("amplitude_N_per_m", self.amplitude_n_per_m.as_slice()),
            ("beta_per_m", self.beta_per_m.as_slice()),
            ("gamma_per_m", self.gamma_per_m.as_slice()),
            ("rate_per_V", self.rate_per_v.as_slice()),
            ("slope_per_V", self.slope_per_v.as_slice()),
            ("inner_slope_per_V", self.inner_slope_per_v.as_slice()),
            ("ramp_V", self.ramp_v.as_slice()),
            ("threshold_V", &self.threshold_v),
            ("weight_per_V", &self.weight_per_v),
            ("level_V", &self.level_v),
            ("weight", &self.weight),
        ]
    }

    /// The keys that a kind needs; of the others only some take the exponent.
    pub(super) fn needed(kind: Kind) -> &'static [&'static str] {
        match kind {
            Kind::BoucWen => &["amplitude_per_V", "beta_per_V", "gamma_per_V", "force_N"],
            Kind::BoucWenStatic => &["amplitude_per_V", "beta_per_V", "gamma_per_V", "gain_um_per_V", "depth_um"],
            Kind::BoucWenOscillator => &["amplitude_N_per_m", "beta_per_m", "gamma_per_m"],
            Kind::Dahl => &["rate_per_V", "force_N"],
            Kind::Duhem => &["rate_per_V", "slope_per_V", "inner_slope_per_V", "force_N"],
            Kind::MaxwellSlip | Kind::PrandtlIshlinskii => &["threshold_V", "weight_per_V", "force_N"],
            Kind::Preisach => &["level_V", "weight", "force_N"],
            Kind::KrasnoselskiiPokrovskii => &["level_V", "weight", "ramp_V", "force_N"],
            Kind::Phs | Kind::StateSpace | Kind::TransferFunction => &[],
        }
    }

    fn takes_exponent(kind: Kind) -> bool {
        matches!(kind, Kind::BoucWen | Kind::BoucWenStatic | Kind::BoucWenOscillator | Kind::Dahl)
    }

    /// Whether h is what the drive's force misses, 1, or what is added to it, -1: operators of friction saturate, the others are the motion
    /// itself.
    pub(super) fn missing(kind: Kind) -> f64 {
        match kind {
            Kind::Duhem | Kind::PrandtlIshlinskii | Kind::Preisach | Kind::KrasnoselskiiPokrovskii => -1.0,
            _ => 1.0,
        }
    }

    /// The Bouc-Wen law of a model's kind.
    pub fn bouc_wen(&self, kind: Kind) -> BoucWen {
        let [a, beta, gamma] = match kind {
            Kind::BoucWenOscillator => [&self.amplitude_n_per_m, &self.beta_per_m, &self.gamma_per_m],
            _ => [&self.amplitude_per_v, &self.beta_per_v, &self.gamma_per_v],
        };
        BoucWen { amplitude: or(a, 0.0), beta: or(beta, 0.0), gamma: or(gamma, 0.0), exponent: or(&self.exponent, 1.0) }
    }

    /// The operator from volts to h of a model's kind, if it has one.
    pub fn law(&self, kind: Kind) -> Option<Law> {
        let plays = |counts| {
            let pairs = self.threshold_v.iter().zip(&self.weight_per_v);
            let plays = pairs.map(|(r, w)| Play::upright(r.value, w.value)).collect();
            Law::Plays(Plays { plays, counts })
        };
        let rate_per_v = or(&self.rate_per_v, 0.0);
        let (level_v, weight) = (values(&self.level_v), values(&self.weight));
        Some(match kind {
            Kind::BoucWen | Kind::BoucWenStatic => Law::BoucWen(self.bouc_wen(kind)),
            Kind::Dahl => Law::Dahl(Dahl { rate_per_v, exponent: or(&self.exponent, 1.0) }),
            Kind::Duhem => Law::Duhem(Duhem {
                rate_per_v,
                slope_per_v: or(&self.slope_per_v, 0.0),
                inner_slope_per_v: or(&self.inner_slope_per_v, 0.0),
            }),
            Kind::MaxwellSlip => plays(Counts::Lags),
            Kind::PrandtlIshlinskii => plays(Counts::Places),
            Kind::Preisach => Law::Preisach(Preisach { level_v, weight }),
            Kind::KrasnoselskiiPokrovskii => {
                Law::KrasnoselskiiPokrovskii(KrasnoselskiiPokrovskii { level_v, weight, ramp_v: or(&self.ramp_v, 1.0) })
            }
            Kind::Phs | Kind::BoucWenOscillator | Kind::StateSpace | Kind::TransferFunction => return None,
        })
    }

    pub(super) fn records(&self) -> Vec<(String, &Param, [f64; 2])> {
        let exponent = [("exponent", self.exponent.as_slice())];
        // Plausible: a bender's and a structure's sizes, many powers of ten wide.
        let bounds = |key: &str| match key {
            "amplitude_N_per_m" => [1.0, 1e10],
            "beta_per_m" | "gamma_per_m" => [-1e9, 1e9],
            "exponent" => [0.1, 20.0],
            "amplitude_per_V" | "rate_per_V" => [1e-7, 1e3],
            _ => [-1e4, 1e4],
        };
        let mut all = Vec::new();
        for (key, list) in self.entries().into_iter().chain(exponent) {
            for (i, p) in list.iter().enumerate() {
                let number = if list.len() > 1 { format!("[{}]", i + 1) } else { String::new() };
                all.push((format!("hysteresis.{key}{number}"), p, bounds(key)));
            }
        }
        all
    }

    /// What is wrong with the section in a model of `kind`, if anything.
    pub(super) fn validate(&self, kind: Kind) -> Result<(), String> {
        let needed = Self::needed(kind);
        for (key, list) in self.entries() {
            if needed.contains(&key) == list.is_empty() {
                let advice = if list.is_empty() { "is missing: add it" } else { "has no meaning: remove it" };
                return Err(format!("in a model of kind {} hysteresis.{key} {advice}", kind.name()));
            }
        }
        if self.exponent.is_some() && !Self::takes_exponent(kind) {
            return Err(format!("in a model of kind {} hysteresis.exponent has no meaning: remove it", kind.name()));
        }
        match kind {
            Kind::BoucWen | Kind::BoucWenStatic | Kind::BoucWenOscillator => {
                let law = self.bouc_wen(kind);
                if law.amplitude <= 0.0 || law.exponent < 1.0 {
                    return Err(format!(
                        "hysteresis has amplitude {} and exponent {}: the first must be positive, the second at least 1",
                        law.amplitude, law.exponent
                    ));
                }
            }
            Kind::Dahl | Kind::Duhem => {
                let (rate, exponent) = (or(&self.rate_per_v, 0.0), or(&self.exponent, 1.0));
                if rate.is_nan() || rate <= 0.0 || exponent.is_nan() || exponent <= 0.0 {
                    return Err(format!(
                        "hysteresis has rate_per_V {rate} and exponent {exponent}: both must be positive"
                    ));
                }
            }
            Kind::MaxwellSlip | Kind::PrandtlIshlinskii => {
                same_count("threshold_V", self.threshold_v.len(), "weight_per_V", self.weight_per_v.len())?;
                if let Some(r) = self.threshold_v.iter().find(|r| r.value.is_nan() || r.value < 0.0) {
                    return Err(format!("hysteresis.threshold_V holds {}: no play is negative", r.value));
                }
            }
            Kind::Preisach | Kind::KrasnoselskiiPokrovskii => {
                let rows =
                    if kind == Kind::Preisach { self.level_v.len().saturating_sub(1) } else { self.level_v.len() };
                same_count("level_V", rows * (rows + 1) / 2, "weight", self.weight.len())?;
                if !self.level_v.windows(2).all(|pair| pair[0].value < pair[1].value) {
                    return Err("hysteresis.level_V must rise from one number to the next".to_owned());
                }
                if self.ramp_v.as_ref().is_some_and(|ramp| ramp.value.is_nan() || ramp.value <= 0.0) {
                    return Err("hysteresis.ramp_V must be positive".to_owned());
                }
            }
            Kind::Phs | Kind::StateSpace | Kind::TransferFunction => {}
        }
        if self.threshold_v.len().max(self.level_v.len()) > MOST_ELEMENTS {
            return Err(format!("hysteresis has more than {MOST_ELEMENTS} thresholds or levels"));
        }
        Ok(())
    }
}

/// Most thresholds or levels: 64 levels are 2080 relays.
const MOST_ELEMENTS: usize = 64;

fn same_count(of: &str, asked: usize, key: &str, given: usize) -> Result<(), String> {
    if asked == given && given > 0 {
        return Ok(());
    }
    Err(format!("hysteresis.{key} has {given} numbers, and hysteresis.{of} calls for {asked}: give as many"))
}
