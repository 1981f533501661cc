//! Plants of other kinds than hysterons: hysteresis operators in an actuator, a Bouc-Wen oscillator, state space, transfer function.

use super::hysteresis::HysteresisSection;
use super::{Model, or};
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
    /// Mass, spring and damper under Kv V - Kh h, h by Dahl's law of friction.
    Dahl,
    /// The same, h the slip of springs in parallel.
    MaxwellSlip,
    /// The same under Kv V + Kh h, h by the backlash-like Duhem operator.
    Duhem,
    /// The same, h a sum of plays.
    PrandtlIshlinskii,
    /// The same, h by relays that are weighed cell by cell.
    Preisach,
    /// The same, h by relays whose jumps are ramps.
    KrasnoselskiiPokrovskii,
    /// x' = A x + B V, y = C x + D V.
    StateSpace,
    /// A quotient of polynomials.
    TransferFunction,
}

impl Kind {
    /// Every kind, with the name that files and arguments use.
    pub const ALL: [(&'static str, Kind); 12] = [
        ("phs", Kind::Phs),
        ("bouc-wen", Kind::BoucWen),
        ("bouc-wen-static", Kind::BoucWenStatic),
        ("bouc-wen-oscillator", Kind::BoucWenOscillator),
        ("dahl", Kind::Dahl),
        ("maxwell-slip", Kind::MaxwellSlip),
        ("duhem", Kind::Duhem),
        ("prandtl-ishlinskii", Kind::PrandtlIshlinskii),
        ("preisach", Kind::Preisach),
        ("krasnoselskii-pokrovskii", Kind::KrasnoselskiiPokrovskii),
        ("state-space", Kind::StateSpace),
        ("transfer-function", Kind::TransferFunction),
    ];

    /// Its name in files and arguments.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Whether mass, spring and damper of the model file act.
    pub fn has_structure(self) -> bool {
        !matches!(self, Kind::BoucWenStatic | Kind::StateSpace | Kind::TransferFunction)
    }

    /// Whether hysteresis lies between the voltage and the force on mass, spring and damper.
    pub fn is_actuator_with_operator(self) -> bool {
        self.has_structure() && !matches!(self, Kind::Phs | Kind::BoucWenOscillator)
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
        let transducer = |force_n| self.hysteresis.law(self.kind).map(|law| DriveHysteresis { law, force_n });
        match self.kind {
            Kind::Phs => Parts::default(),
            kind if kind.is_actuator_with_operator() => {
                let missing_n = HysteresisSection::missing(kind) * or(&self.hysteresis.force_n, 0.0);
                Parts { transducer: transducer(missing_n), ..Parts::default() }
            }
            Kind::BoucWenStatic => Parts {
                transducer: transducer(or(&self.hysteresis.depth_um, 0.0) * super::MICRO),
                is_massless: true,
                ..Parts::default()
            },
            Kind::BoucWenOscillator => {
                Parts { forces: vec![Force::BoucWen(self.hysteresis.bouc_wen(self.kind))], ..Parts::default() }
            }
            _ => Parts { linear: self.linear(), ..Parts::default() },
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
        self.hysteresis.validate(self.kind)?;
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
