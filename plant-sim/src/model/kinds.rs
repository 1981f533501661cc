//! Plants of other kinds than hysterons: Bouc-Wen in its three settings, state space, transfer function.

use super::{Model, or};
use crate::bouc_wen::BoucWen;
use crate::chain::{DriveHysteresis, Force, Parts};
use crate::effects::Stage;
use crate::linear::{StateSpace, TransferFunction};
use crate::param::Param;
use crate::phs::Phs;
use nalgebra::{DMatrix, DVector, RowDVector};
use serde::{Deserialize, Serialize};

/// Kinds of equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Port-Hamiltonian plant with hysterons ([`crate::phs`]); none of them makes it linear and second order.
    Phs,
    /// Bouc-Wen actuator (2.2): mass, spring and damper under Kv V - Kh h, h driven by the voltage.
    BoucWen,
    /// Bouc-Wen with static mechanics (2.3): y = dp V - depth h.
    BoucWenStatic,
    /// Bouc-Wen oscillator: mass, spring, damper and a hysteretic force that the displacement drives.
    BoucWenOscillator,
    /// x' = A x + B V, y = C x + D V.
    StateSpace,
    /// A quotient of polynomials.
    TransferFunction,
}

impl Kind {
    /// Every kind, with the name that files and arguments use.
    pub const ALL: [(&'static str, Kind); 6] = [
        ("phs", Kind::Phs),
        ("bouc-wen", Kind::BoucWen),
        ("bouc-wen-static", Kind::BoucWenStatic),
        ("bouc-wen-oscillator", Kind::BoucWenOscillator),
        ("state-space", Kind::StateSpace),
        ("transfer-function", Kind::TransferFunction),
    ];

    /// Its name in files and arguments.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Whether mass, spring and damper of the model file act.
    pub fn has_structure(self) -> bool {
        matches!(self, Kind::Phs | Kind::BoucWen | Kind::BoucWenOscillator)
    }
}

/// `[hysteresis]` of the Bouc-Wen kinds: each takes the keys in its own units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HysteresisSection {
    /// A of a law driven by volts.
    #[serde(rename = "amplitude_per_V", default, skip_serializing_if = "Option::is_none")]
    pub amplitude_per_v: Option<Param>,
    /// beta of a law driven by volts.
    #[serde(rename = "beta_per_V", default, skip_serializing_if = "Option::is_none")]
    pub beta_per_v: Option<Param>,
    /// gamma of a law driven by volts.
    #[serde(rename = "gamma_per_V", default, skip_serializing_if = "Option::is_none")]
    pub gamma_per_v: Option<Param>,
    /// Kh of (2.2): the force of h = 1.
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
    /// n; 1 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<Param>,
}

impl HysteresisSection {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    fn entries(&self) -> [(&'static str, &Option<Param>); 9] {
        [
            ("amplitude_per_V", &self.amplitude_per_v),
            ("beta_per_V", &self.beta_per_v),
            ("gamma_per_V", &self.gamma_per_v),
            ("force_N", &self.force_n),
            ("gain_um_per_V", &self.gain_um_per_v),
            ("depth_um", &self.depth_um),
            ("amplitude_N_per_m", &self.amplitude_n_per_m),
            ("beta_per_m", &self.beta_per_m),
            ("gamma_per_m", &self.gamma_per_m),
        ]
    }

    /// The keys that a kind needs; it takes no others but the exponent.
    fn needed(kind: Kind) -> &'static [&'static str] {
        match kind {
            Kind::BoucWen => &["amplitude_per_V", "beta_per_V", "gamma_per_V", "force_N"],
            Kind::BoucWenStatic => &["amplitude_per_V", "beta_per_V", "gamma_per_V", "gain_um_per_V", "depth_um"],
            Kind::BoucWenOscillator => &["amplitude_N_per_m", "beta_per_m", "gamma_per_m"],
            Kind::Phs | Kind::StateSpace | Kind::TransferFunction => &[],
        }
    }

    /// The law of the model's kind.
    pub fn law(&self, kind: Kind) -> BoucWen {
        let [a, beta, gamma] = match kind {
            Kind::BoucWenOscillator => [&self.amplitude_n_per_m, &self.beta_per_m, &self.gamma_per_m],
            _ => [&self.amplitude_per_v, &self.beta_per_v, &self.gamma_per_v],
        };
        BoucWen { amplitude: or(a, 0.0), beta: or(beta, 0.0), gamma: or(gamma, 0.0), exponent: or(&self.exponent, 1.0) }
    }

    pub(super) fn records(&self) -> Vec<(String, &Param, [f64; 2])> {
        let entries = self.entries().into_iter().chain([("exponent", &self.exponent)]);
        // Plausible: a bender's and a structure's sizes, many powers of ten wide.
        let bounds = |key: &str| match key {
            "amplitude_N_per_m" => [1.0, 1e10],
            "beta_per_m" | "gamma_per_m" => [-1e9, 1e9],
            "exponent" => [1.0, 20.0],
            "amplitude_per_V" => [1e-7, 1e3],
            _ => [-1e4, 1e4],
        };
        entries.filter_map(|(key, p)| p.as_ref().map(|p| (format!("hysteresis.{key}"), p, bounds(key)))).collect()
    }
}

/// Numbers in rows, with one uncertainty and one source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Numbers<T> {
    /// The numbers.
    pub value: T,
    /// Relative standard deviation of each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
    /// Where they come from.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
}

/// `[state_space]`: volts in, metres out, SI.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateSpaceSection {
    /// A, row by row.
    pub a_per_s: Numbers<Vec<Vec<f64>>>,
    /// B.
    #[serde(rename = "b_per_V_s")]
    pub b_per_v_s: Numbers<Vec<f64>>,
    /// C.
    pub c_m: Numbers<Vec<f64>>,
    /// D; zero where absent.
    #[serde(rename = "d_m_per_V", default, skip_serializing_if = "Option::is_none")]
    pub d_m_per_v: Option<Param>,
}

/// `[transfer_function]`: metres per volt, s in 1/s, highest power first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferFunctionSection {
    /// b0 .. bm.
    #[serde(rename = "numerator_m_per_V")]
    pub numerator_m_per_v: Numbers<Vec<f64>>,
    /// a0 .. an.
    pub denominator: Numbers<Vec<f64>>,
}

impl TransferFunctionSection {
    /// As what it describes.
    pub fn transfer_function(&self) -> TransferFunction {
        TransferFunction {
            numerator: self.numerator_m_per_v.value.clone(),
            denominator: self.denominator.value.clone(),
        }
    }
}

impl StateSpaceSection {
    fn state_space(&self) -> Option<StateSpace> {
        let n = self.a_per_s.value.len();
        let square = n > 0 && self.a_per_s.value.iter().all(|row| row.len() == n);
        let fits = square && self.b_per_v_s.value.len() == n && self.c_m.value.len() == n;
        fits.then(|| StateSpace {
            a: DMatrix::from_fn(n, n, |i, j| self.a_per_s.value[i][j]),
            b: DVector::from_column_slice(&self.b_per_v_s.value),
            c: RowDVector::from_row_slice(&self.c_m.value),
            d: or(&self.d_m_per_v, 0.0),
        })
    }
}

impl Model {
    /// The linear plant of a state space or a transfer function.
    pub fn linear(&self) -> Option<StateSpace> {
        match self.kind {
            Kind::StateSpace => self.state_space.as_ref()?.state_space(),
            Kind::TransferFunction => self.transfer_function.as_ref()?.transfer_function().state_space(),
            _ => None,
        }
    }

    /// A model file of a transfer function.
    pub fn of_transfer_function(name: &str, tf: &TransferFunction, source: &str) -> Self {
        let numbers = |value: &[f64]| Numbers { value: value.to_vec(), sigma: None, source: source.to_owned() };
        Self {
            kind: Kind::TransferFunction,
            transfer_function: Some(TransferFunctionSection {
                numerator_m_per_v: numbers(&tf.numerator),
                denominator: numbers(&tf.denominator),
            }),
            ..Self::empty(name)
        }
    }

    /// What the kind puts in place of hysterons or of the whole structure.
    pub(super) fn kind_parts(&self) -> Parts {
        let law = self.hysteresis.law(self.kind);
        let transducer = |force_n| Some(DriveHysteresis { law, force_n });
        match self.kind {
            Kind::Phs => Parts::default(),
            Kind::BoucWen => Parts { transducer: transducer(or(&self.hysteresis.force_n, 0.0)), ..Parts::default() },
            Kind::BoucWenStatic => Parts {
                transducer: transducer(or(&self.hysteresis.depth_um, 0.0) * super::MICRO),
                is_massless: true,
                ..Parts::default()
            },
            Kind::BoucWenOscillator => Parts { forces: vec![Force::BoucWen(law)], ..Parts::default() },
            Kind::StateSpace | Kind::TransferFunction => Parts { linear: self.linear(), ..Parts::default() },
        }
    }

    /// Mass, spring and damper of a kind that has none: they only carry the static gain.
    pub(super) fn stand_in(&self) -> Option<Phs> {
        let gain_m_per_v = match self.kind {
            Kind::BoucWenStatic => or(&self.hysteresis.gain_um_per_v, 0.0) * super::MICRO,
            Kind::StateSpace | Kind::TransferFunction => {
                let gain = self.linear().and_then(|space| space.static_gain());
                // The engine takes volts as its force, so that here the spring carries the gain.
                return Some(Phs {
                    stiffness_n_per_m: gain.filter(|g| g.is_finite() && *g > 0.0).map_or(1.0, |g| 1.0 / g),
                    ..unit_structure(1.0)
                });
            }
            _ => return None,
        };
        Some(unit_structure(gain_m_per_v))
    }

    /// What is wrong with the sections of the kind, if anything.
    pub(super) fn validate_kind(&self) -> Result<(), String> {
        let kind = self.kind.name();
        let sections = [
            ("structure", self.structure.is_absent(), self.kind.has_structure()),
            ("actuator", self.actuator.is_absent(), self.kind.has_structure()),
            ("hysteresis", self.hysteresis.is_empty(), !HysteresisSection::needed(self.kind).is_empty()),
            ("state_space", self.state_space.is_none(), self.kind == Kind::StateSpace),
            ("transfer_function", self.transfer_function.is_none(), self.kind == Kind::TransferFunction),
        ];
        for (section, absent, wanted) in sections {
            if absent == wanted {
                let (what, advice) = if wanted { ("is missing", "add it") } else { ("has no meaning", "remove it") };
                return Err(format!("[{section}] {what} in a model of kind {kind}: {advice} or change the kind"));
            }
        }
        if self.kind != Kind::Phs && !self.actuator.hysterons.is_empty() {
            return Err(format!("actuator.hysteron has no meaning in a model of kind {kind}: use kind = \"phs\""));
        }
        let needed = HysteresisSection::needed(self.kind);
        for (key, param) in self.hysteresis.entries() {
            if needed.contains(&key) != param.is_some() {
                let advice = if param.is_some() { "has no meaning: remove it" } else { "is missing: add it" };
                return Err(format!("in a model of kind {kind} hysteresis.{key} {advice}"));
            }
        }
        if !needed.is_empty() {
            let law = self.hysteresis.law(self.kind);
            if law.amplitude <= 0.0 || law.exponent < 1.0 {
                return Err(format!(
                    "hysteresis has amplitude {} and exponent {}: the first must be positive, the second at least 1",
                    law.amplitude, law.exponent
                ));
            }
        }
        let given = self.state_space.is_some() || self.transfer_function.is_some();
        if given {
            let Some(space) = self.linear() else {
                return Err(match self.kind {
                    Kind::StateSpace => "state_space: A must be square, with as many entries in B and in C".to_owned(),
                    _ => "transfer_function: the denominator needs a first coefficient that isn't zero, an order of at least one, \
                          and no lower order than the numerator"
                        .to_owned(),
                });
            };
            let finite = space.a.iter().chain(space.b.iter()).chain(space.c.iter()).all(|x| x.is_finite());
            if !finite || !space.d.is_finite() {
                return Err(format!("[{kind}] holds a number that is not finite"));
            }
            if space.a.nrows() > MOST_STATES {
                return Err(format!("{} states; at most {MOST_STATES} can be stepped", space.a.nrows()));
            }
            if space.output_first().is_none() {
                return Err("no state reaches the output: a plant needs one".to_owned());
            }
            let fastest = crate::linear::poles(&space.a).last().map_or(0.0, |pole| pole.norm());
            if fastest > super::MOST_RAD_PER_S {
                return Err(format!("a pole at {fastest:.1e} 1/s is faster than can be stepped: check the units"));
            }
        }
        if !self.kind.has_structure() {
            let inside = |effect: &&super::EffectSection| {
                let stage = effect.entry().map(|(effect, _)| effect.stage());
                matches!(stage, Some(Stage::Actuator | Stage::Structure))
            };
            if let Some(effect) = self.effects.iter().find(inside) {
                return Err(format!("the effect {} needs a structure, which a model of kind {kind} lacks", effect.id));
            }
        }
        Ok(())
    }
}

/// Most states of a linear plant: the engine's, less two for a sensor's lag.
const MOST_STATES: usize = crate::exact::MAX_STATES - 2;

fn unit_structure(transduction_c_per_m: f64) -> Phs {
    Phs { mass_kg: 1.0, damping_n_s_per_m: 0.0, stiffness_n_per_m: 1.0, transduction_c_per_m, hysterons: Vec::new() }
}
