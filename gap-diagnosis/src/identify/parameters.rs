//! Which numbers of a model are fitted, and how an unbounded vector of coordinates becomes those numbers.
//!
//! Positive parameters are fitted as logarithms inside bounds: p = prior * exp(B tanh(z / B)), which is prior * exp(z) near the
//! prior and never leaves prior * exp(+-B). Unbounded logarithms end in local minima in most runs.

use plant_sim::chain::{Chain, Force, Parts};
use plant_sim::model::{Kind, Model};
use plant_sim::operators::Law;
use plant_sim::param::Param;
use plant_sim::replay::{Initial, Start};

/// How a coordinate becomes a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// A positive number within a factor exp(+-bound) of its prior.
    Log {
        /// B, natural logarithm of the largest factor.
        bound: f64,
    },
    /// prior + unit * z.
    Shift {
        /// What one coordinate unit is worth, in the number's SI unit.
        unit: f64,
    },
    /// prior + unit * z, never below zero.
    NotNegative {
        /// What one coordinate unit is worth, in the number's SI unit.
        unit: f64,
    },
}

/// A number of the chain that can be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// k.
    Stiffness,
    /// b.
    Damping,
    /// alpha.
    Transduction,
    /// C of hysteron i.
    Capacitance(usize),
    /// beta of hysteron i.
    Slope(usize),
    /// d of hysteron i.
    DeadZone(usize),
    /// The drive's delay.
    Delay,
    /// The sensor's reading at zero displacement.
    Offset,
    /// M, where the drive is a known force.
    Mass,
    /// A number of a law of hysteresis.
    Law(LawNumber),
}

/// A number of a law of hysteresis or of what it drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LawNumber {
    /// A of an oscillator, N/m; with a transducer only its product with the force shows, and it stays.
    Amplitude,
    /// beta.
    Beta,
    /// gamma, of either sign.
    Gamma,
    /// Kh of (2.2), N; with an operator of free scale only its product with the weights shows, and it stays.
    Force,
    /// Displacement of h = 1 in (2.3).
    Depth,
    /// dp of (2.3).
    StaticGain,
    /// rho of Dahl's and Duhem's laws.
    Rate,
    /// b of Duhem's law.
    Slope,
    /// g of Duhem's law.
    InnerSlope,
    /// w of play, cell or kernel i.
    Weight(usize),
}

impl Quantity {
    /// The quantities of a model, mass left out unless the drive is a known force: from displacement alone only ratios to the mass can be
    /// identified.
    pub fn of(model: &Model) -> Vec<Quantity> {
        use LawNumber::{Amplitude, Beta, Depth, Force, Gamma, InnerSlope, Rate, Slope, StaticGain, Weight};
        let law = |numbers: &[LawNumber]| numbers.iter().map(|n| Quantity::Law(*n)).collect::<Vec<_>>();
        let structure = [Quantity::Stiffness, Quantity::Damping, Quantity::Transduction].into_iter();
        let weights = |count: usize| law(&(0..count).map(Weight).collect::<Vec<_>>());
        match model.kind {
            Kind::Phs => {}
            Kind::BoucWen => return structure.chain(law(&[Force, Beta, Gamma])).collect(),
            Kind::Dahl => return structure.chain(law(&[Force, Rate])).collect(),
            Kind::Duhem => return structure.chain(law(&[Rate, Slope, InnerSlope])).collect(),
            Kind::MaxwellSlip | Kind::PrandtlIshlinskii => {
                return structure.chain(weights(model.hysteresis.weight_per_v.len())).collect();
            }
            Kind::Preisach | Kind::KrasnoselskiiPokrovskii => {
                return structure.chain(weights(model.hysteresis.weight.len())).collect();
            }
            Kind::BoucWenStatic => return law(&[StaticGain, Depth, Beta, Gamma]),
            Kind::BoucWenOscillator => {
                let structure = [Quantity::Mass, Quantity::Stiffness, Quantity::Damping];
                return structure.into_iter().chain(law(&[Amplitude, Beta, Gamma])).collect();
            }
            // Their coefficients are estimated by `tfest`.
            Kind::StateSpace | Kind::TransferFunction => return Vec::new(),
        }
        let mut all: Vec<Quantity> = structure.collect();
        for i in 0..model.actuator.hysterons.len() {
            all.extend([Quantity::Capacitance(i), Quantity::Slope(i), Quantity::DeadZone(i)]);
        }
        all
    }

    /// Name with the unit of the model file, hysterons counted from 1.
    pub fn name(self) -> String {
        match self {
            Quantity::Stiffness => "stiffness_N_per_m".into(),
            Quantity::Damping => "damping_N_s_per_m".into(),
            Quantity::Transduction => "transduction_C_per_m".into(),
            Quantity::Capacitance(i) => format!("capacitance{}_F", i + 1),
            Quantity::Slope(i) => format!("slope{}_S", i + 1),
            Quantity::DeadZone(i) => format!("dead_zone{}_V", i + 1),
            Quantity::Delay => "delay_us".into(),
            Quantity::Offset => "offset_um".into(),
            Quantity::Mass => "mass_kg".into(),
            Quantity::Law(number) => number.words().0,
        }
    }

    /// The same in words, and its unit.
    pub fn words(self) -> (String, &'static str) {
        match self {
            Quantity::Stiffness => ("stiffness".into(), "N/m"),
            Quantity::Damping => ("damping".into(), "N s/m"),
            Quantity::Transduction => ("transduction".into(), "C/m"),
            Quantity::Capacitance(i) => (format!("capacitance, hysteron {}", i + 1), "F"),
            Quantity::Slope(i) => (format!("slope, hysteron {}", i + 1), "S"),
            Quantity::DeadZone(i) => (format!("dead zone, hysteron {}", i + 1), "V"),
            Quantity::Delay => ("delay".into(), "us"),
            Quantity::Offset => ("sensor offset".into(), "um"),
            Quantity::Mass => ("mass".into(), "kg"),
            Quantity::Law(number) => (number.words().1, number.words().2),
        }
    }

    /// Factor from SI to the unit of the model file.
    pub fn per_si(self) -> f64 {
        match self {
            Quantity::Delay | Quantity::Offset => 1e6,
            Quantity::Law(LawNumber::Depth | LawNumber::StaticGain) => 1e6,
            _ => 1.0,
        }
    }

    /// The number in a chain, SI.
    pub fn number(self, chain: &mut Chain) -> &mut f64 {
        let plant = &mut chain.plant;
        match self {
            Quantity::Stiffness => &mut plant.stiffness_n_per_m,
            Quantity::Damping => &mut plant.damping_n_s_per_m,
            Quantity::Transduction => &mut plant.transduction_c_per_m,
            Quantity::Capacitance(i) => &mut plant.hysterons[i].capacitance_f,
            Quantity::Slope(i) => &mut plant.hysterons[i].slope_s,
            Quantity::DeadZone(i) => &mut plant.hysterons[i].dead_zone_v,
            Quantity::Delay => &mut chain.drive.delay_s,
            Quantity::Offset => &mut chain.sensor.offset_m,
            Quantity::Mass => &mut plant.mass_kg,
            Quantity::Law(LawNumber::StaticGain) => &mut plant.transduction_c_per_m,
            Quantity::Law(number) => number.of(&mut chain.parts),
        }
    }

    /// The record in a model file.
    pub fn record(self, model: &mut Model) -> &mut Param {
        match self {
            Quantity::Stiffness => &mut model.structure.stiffness_n_per_m,
            Quantity::Damping => &mut model.structure.damping_n_s_per_m,
            Quantity::Transduction => &mut model.actuator.transduction_c_per_m,
            Quantity::Capacitance(i) => &mut model.actuator.hysterons[i].capacitance_f,
            Quantity::Slope(i) => &mut model.actuator.hysterons[i].slope_s,
            Quantity::DeadZone(i) => &mut model.actuator.hysterons[i].dead_zone_v,
            Quantity::Delay => model.drive.delay_us.get_or_insert_with(|| Param::absolute(0.0, 0.0, "")),
            Quantity::Offset => model.sensor.offset_um.get_or_insert_with(|| Param::absolute(0.0, 0.0, "")),
            Quantity::Mass => &mut model.structure.mass_kg,
            Quantity::Law(number) => {
                let hysteresis = &mut model.hysteresis;
                let record = match (number, model.kind) {
                    (LawNumber::Amplitude, Kind::BoucWenOscillator) => &mut hysteresis.amplitude_n_per_m,
                    (LawNumber::Amplitude, _) => &mut hysteresis.amplitude_per_v,
                    (LawNumber::Beta, Kind::BoucWenOscillator) => &mut hysteresis.beta_per_m,
                    (LawNumber::Beta, _) => &mut hysteresis.beta_per_v,
                    (LawNumber::Gamma, Kind::BoucWenOscillator) => &mut hysteresis.gamma_per_m,
                    (LawNumber::Gamma, _) => &mut hysteresis.gamma_per_v,
                    (LawNumber::Force, _) => &mut hysteresis.force_n,
                    (LawNumber::Depth, _) => &mut hysteresis.depth_um,
                    (LawNumber::StaticGain, _) => &mut hysteresis.gain_um_per_v,
                    (LawNumber::Rate, _) => &mut hysteresis.rate_per_v,
                    (LawNumber::Slope, _) => &mut hysteresis.slope_per_v,
                    (LawNumber::InnerSlope, _) => &mut hysteresis.inner_slope_per_v,
                    (LawNumber::Weight(i), Kind::MaxwellSlip | Kind::PrandtlIshlinskii) => {
                        return &mut hysteresis.weight_per_v[i];
                    }
                    (LawNumber::Weight(i), _) => return &mut hysteresis.weight[i],
                };
                record.get_or_insert_with(|| Param::absolute(0.0, 0.0, ""))
            }
        }
    }
}

impl LawNumber {
    /// Name in files, name in words, unit.
    fn words(self) -> (String, String, &'static str) {
        let (name, words, unit) = match self {
            LawNumber::Amplitude => ("hysteresis_amplitude", "hysteresis slope A", ""),
            LawNumber::Beta => ("hysteresis_beta", "hysteresis beta", ""),
            LawNumber::Gamma => ("hysteresis_gamma", "hysteresis gamma", ""),
            LawNumber::Force => ("hysteresis_force_N", "hysteresis force Kh", "N"),
            LawNumber::Depth => ("hysteresis_depth_um", "hysteresis depth", "um"),
            LawNumber::StaticGain => ("gain_um_per_V", "static gain dp", "um/V"),
            LawNumber::Rate => ("hysteresis_rate_per_V", "hysteresis rate", "1/V"),
            LawNumber::Slope => ("hysteresis_slope_per_V", "hysteresis slope b", "1/V"),
            LawNumber::InnerSlope => ("hysteresis_inner_slope_per_V", "hysteresis slope g", "1/V"),
            LawNumber::Weight(i) => {
                return (format!("hysteresis_weight{}", i + 1), format!("hysteresis weight {}", i + 1), "");
            }
        };
        (name.into(), words.into(), unit)
    }

    /// The number in the part that carries the law. A chain of another kind has none, which is a mistake of the caller's.
    fn of(self, parts: &mut Parts) -> &mut f64 {
        if let Some(transducer) = &mut parts.transducer {
            if self == LawNumber::Force || self == LawNumber::Depth {
                return &mut transducer.force_n;
            }
            let number = match (self, &mut transducer.law) {
                (LawNumber::Amplitude, Law::BoucWen(law)) => Some(&mut law.amplitude),
                (LawNumber::Beta, Law::BoucWen(law)) => Some(&mut law.beta),
                (LawNumber::Gamma, Law::BoucWen(law)) => Some(&mut law.gamma),
                (LawNumber::Rate, Law::Dahl(law)) => Some(&mut law.rate_per_v),
                (LawNumber::Rate, Law::Duhem(law)) => Some(&mut law.rate_per_v),
                (LawNumber::Slope, Law::Duhem(law)) => Some(&mut law.slope_per_v),
                (LawNumber::InnerSlope, Law::Duhem(law)) => Some(&mut law.inner_slope_per_v),
                (LawNumber::Weight(i), Law::Plays(law)) => law.plays.get_mut(i).map(|play| &mut play.weight_per_v),
                (LawNumber::Weight(i), Law::Preisach(law)) => law.weight.get_mut(i),
                (LawNumber::Weight(i), Law::KrasnoselskiiPokrovskii(law)) => law.weight.get_mut(i),
                _ => None,
            };
            return number.expect("a quantity of the operator that the chain has");
        }
        let law = parts.forces.iter_mut().find_map(|f| if let Force::BoucWen(law) = f { Some(law) } else { None });
        let law = law.expect("a quantity of a chain that has the law");
        match self {
            LawNumber::Beta => &mut law.beta,
            LawNumber::Gamma => &mut law.gamma,
            _ => &mut law.amplitude,
        }
    }
}

/// One fitted quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free {
    /// Which number.
    pub quantity: Quantity,
    /// Its value at coordinate zero, SI.
    pub prior: f64,
    /// How the coordinate is read.
    pub scale: Scale,
    /// Standard deviation of the coordinate under the prior.
    pub prior_sigma: f64,
}

impl Free {
    /// The number at coordinate `z`, SI.
    pub fn at(&self, z: f64) -> f64 {
        match self.scale {
            Scale::Log { bound } => self.prior * (bound * (z / bound).tanh()).exp(),
            Scale::Shift { unit } => self.prior + unit * z,
            Scale::NotNegative { unit } => (self.prior + unit * z).max(0.0),
        }
    }

    /// Standard deviation of the number (relative for logarithms, SI otherwise) for one of the coordinate at `z`.
    pub fn number_sigma(&self, z: f64, coordinate_sigma: f64) -> f64 {
        match self.scale {
            Scale::Log { bound } => coordinate_sigma / (z / bound).cosh().powi(2),
            Scale::Shift { unit } | Scale::NotNegative { unit } => coordinate_sigma * unit,
        }
    }

    /// The same as it is told of a fit. At a bound the number hardly moves with its coordinate, which says nothing of what is beyond: there at least
    /// the prior's.
    pub fn told_sigma(&self, z: f64, coordinate_sigma: f64) -> f64 {
        let sigma = self.number_sigma(z, coordinate_sigma);
        if self.at_bound(z) { sigma.max(self.prior_sigma) } else { sigma }
    }

    /// Standard deviation of the number under the prior, SI.
    pub fn prior_sigma_si(&self) -> f64 {
        match self.scale {
            Scale::Log { .. } => self.prior * self.prior_sigma,
            Scale::Shift { unit } | Scale::NotNegative { unit } => self.prior_sigma * unit,
        }
    }

    /// The record of the number at coordinate `z`; the prior's sigma where the coordinate's is unknown.
    pub fn param(&self, z: f64, coordinate_sigma: f64, source: &str) -> Param {
        let known = if coordinate_sigma.is_finite() { coordinate_sigma } else { self.prior_sigma };
        let (unit, sigma) = (self.quantity.per_si(), self.told_sigma(z, known));
        match self.scale {
            Scale::Log { .. } => Param::new(self.at(z) * unit, sigma, source),
            Scale::Shift { .. } | Scale::NotNegative { .. } => Param::absolute(self.at(z) * unit, sigma * unit, source),
        }
    }

    /// Whether the number sits at its bound.
    pub fn at_bound(&self, z: f64) -> bool {
        match self.scale {
            Scale::Log { bound } => (z / bound).tanh().abs() > 0.99,
            Scale::Shift { .. } | Scale::NotNegative { .. } => false,
        }
    }
}

/// Coordinates that describe the state at the start of one log.
///
/// At rest: the drive held before the log, in units of `span_v`, and the voltage of each hysteron as a fraction tanh(z) of its edge.
/// Fitted: displacement and velocity as well, and the hysteron voltages without bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartCoordinates {
    /// What is assumed.
    pub initial: Initial,
    /// Drive before the log at coordinate zero, in volts.
    pub drive_v: f64,
    /// Volts of one coordinate unit of the drive.
    pub span_v: f64,
}

impl StartCoordinates {
    /// How many coordinates a log has for its start.
    pub fn count(&self, hysterons: usize) -> usize {
        match self.initial {
            Initial::Relaxed => 0,
            Initial::Rest => 1 + hysterons,
            Initial::Fit => 3 + hysterons,
        }
    }

    /// Metres of one coordinate unit of the displacement.
    pub fn travel_m(&self, chain: &Chain) -> f64 {
        chain.plant.static_gain_m_per_v() * self.span_v
    }

    /// The start at coordinates `z`.
    pub fn at(&self, chain: &Chain, z: &[f64]) -> Start {
        if self.initial == Initial::Relaxed {
            return Start::relaxed(chain);
        }
        let hysterons = &chain.plant.hysterons;
        let drive_v = self.drive_v + self.span_v * z[0];
        let own = &z[1..=hysterons.len()];
        if self.initial == Initial::Rest {
            let held_v = hysterons.iter().zip(own).map(|(h, z)| h.edge_v() * z.tanh()).collect();
            return Start::at_rest(chain, drive_v, held_v);
        }
        let voltages = hysterons.iter().zip(own).map(|(h, z)| (h.edge_v() + 1e-3 * self.span_v) * z).collect();
        let mut start = Start::at_rest(chain, drive_v, voltages);
        let travel_m = self.travel_m(chain);
        start.state.displacement_m += travel_m * z[hysterons.len() + 1];
        let turning_per_s = (chain.plant.stiffness_n_per_m / chain.plant.mass_kg).sqrt();
        start.state.velocity_m_per_s += travel_m * turning_per_s * z[hysterons.len() + 2];
        start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_at_its_bound_is_told_as_no_surer_than_before() {
        let scale = Scale::Log { bound: 0.75 };
        let free = Free { quantity: Quantity::Stiffness, prior: 1e4, scale, prior_sigma: 0.75 };
        // The slope of the tanh there is 1.3e-3: a coordinate known to 0.5 would be a number known to 0.07 %.
        assert!(free.at_bound(3.0) && free.number_sigma(3.0, 0.5) < 1e-3);
        assert_eq!(free.param(3.0, 0.5, "").sigma, Some(0.75));
        assert_eq!(free.param(0.0, 0.01, "").sigma, Some(0.01));
    }
}
