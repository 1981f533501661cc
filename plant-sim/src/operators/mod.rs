//! Hysteresis operators: laws from a voltage to a number h that depend on the order of voltages and never on their pace.
//!
//! | operator | equation | memory | what defines it |
//! | --- | --- | --- | --- |
//! | Bouc-Wen ([`crate::bouc_wen`]) | h' = A V' - beta abs(V') h abs(h)^(n-1) - gamma V' abs(h)^n | h | one exponential either way for n = 1 |
//! | [`Dahl`] | dh/dV = rho (1 - s h)^i, s the sign of V' | h | saturates at 1, whatever the loop |
//! | [`Duhem`] | dh/dV = s rho (b V - h) + g | h | loops of one range end in the same limit |
//! | Prandtl-Ishlinskii ([`Plays`]) | h = sum w p, p = max(V - r, min(V + r, p)) | all p | congruent loops, symmetric about a point |
//! | Maxwell slip ([`Plays`]) | h = sum w (V - p), p as above | all p | Masing: branches are the virgin curve, twice as large |
//! | [`Preisach`] | h = integral of w(a, b) times a relay that goes up at a and down at b | reversals | wiping out and congruency |
//! | [`KrasnoselskiiPokrovskii`] | h = sum w k, k = max(r(V - up), min(r(V - down), k)), r a ramp from -1 to 1 | all k | the same, and no faster than its ramps |
//!
//! Sources: Visintin, Differential Models of Hysteresis (1994); Brokate and Sprekels, Hysteresis and Phase Transitions (1996); Dahl (1968);
//! Su, Stepanenko, Svoboda and Leung (2000) for the Duhem operator's form, which is Coleman and Hodgdon's; Al-Bender, Lampaert and
//! Swevers (2005) for Maxwell slip. What a law is driven by and what it drives is [`crate::chain`]'s business.

mod dahl;
mod duhem;
mod kernels;
mod plays;
mod preisach;

pub use dahl::Dahl;
pub use duhem::Duhem;
pub use kernels::KrasnoselskiiPokrovskii;
pub use plays::{Counts, Play, Plays};
pub use preisach::Preisach;

use crate::bouc_wen::BoucWen;

/// What every operator can do. Memory is a list of numbers that only the operator itself reads.
pub trait Operator {
    /// The memory of the relaxed state, under zero volts; h is zero there.
    fn relaxed(&self) -> Vec<f64>;

    /// The voltage goes from `from_v` to `to_v`, one way.
    fn pass(&self, memory: &mut Vec<f64>, from_v: f64, to_v: f64);

    /// h under `at_v`, where the memory is.
    fn h(&self, memory: &[f64], at_v: f64) -> f64;

    /// Volts that a move in the direction of `towards` may have until h has a kink, or bends more than four nodes of a quadrature follow to
    /// 1e-12.
    fn smooth_v(&self, memory: &[f64], at_v: f64, towards: f64) -> f64;

    /// Least and greatest dh/dV of steady loops, per volt.
    fn slopes_per_v(&self) -> [f64; 2];
}

/// Any of the operators.
#[derive(Clone, Debug, PartialEq)]
pub enum Law {
    /// [`BoucWen`].
    BoucWen(BoucWen),
    /// [`Dahl`].
    Dahl(Dahl),
    /// [`Duhem`].
    Duhem(Duhem),
    /// [`Plays`].
    Plays(Plays),
    /// [`Preisach`].
    Preisach(Preisach),
    /// [`KrasnoselskiiPokrovskii`].
    KrasnoselskiiPokrovskii(KrasnoselskiiPokrovskii),
}

impl Law {
    /// What it can do.
    pub fn operator(&self) -> &dyn Operator {
        match self {
            Law::BoucWen(law) => law,
            Law::Dahl(law) => law,
            Law::Duhem(law) => law,
            Law::Plays(law) => law,
            Law::Preisach(law) => law,
            Law::KrasnoselskiiPokrovskii(law) => law,
        }
    }

    /// h after the relaxed state was left for `at_v` one way.
    pub fn rest(&self, at_v: f64) -> f64 {
        let mut memory = self.operator().relaxed();
        self.operator().pass(&mut memory, 0.0, at_v);
        self.operator().h(&memory, at_v)
    }
}

/// Lengths of an exponential law that four nodes follow.
const LENGTHS: f64 = 0.5;
/// Halvings that find where such a law passes zero: to 1e-15 of a length.
const HALVINGS: usize = 50;

impl Operator for BoucWen {
    fn relaxed(&self) -> Vec<f64> {
        vec![0.0]
    }

    fn pass(&self, memory: &mut Vec<f64>, from_v: f64, to_v: f64) {
        memory[0] = self.after(memory[0], to_v - from_v);
    }

    fn h(&self, memory: &[f64], _: f64) -> f64 {
        memory[0]
    }

    fn smooth_v(&self, memory: &[f64], _: f64, towards: f64) -> f64 {
        let length_v = LENGTHS * self.length();
        let h = memory[0] * towards.signum();
        let is_passed = h > -1e-12 * self.amplitude.abs() * length_v.min(1.0);
        if is_passed || !length_v.is_finite() || self.after(h, length_v) <= 0.0 {
            return length_v;
        }
        // It bends another way beyond h = 0.
        let (mut low_v, mut high_v) = (0.0, length_v);
        for _ in 0..HALVINGS {
            let middle_v = 0.5 * (low_v + high_v);
            if self.after(h, middle_v) < 0.0 { low_v = middle_v } else { high_v = middle_v }
        }
        high_v
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        self.slopes(1.0)
    }
}

/// Distance from `at_v` to the nearest of `kinks_v` in the direction of `towards`; infinite where none is left. One on which the voltage
/// stands, but for rounding, is passed.
fn next_kink(kinks_v: impl Iterator<Item = f64>, at_v: f64, towards: f64) -> f64 {
    let rounding_v = 1e-13 * (1.0 + at_v.abs());
    kinks_v.map(|kink_v| (kink_v - at_v) * towards.signum()).filter(|v| *v > rounding_v).fold(f64::INFINITY, f64::min)
}

/// Sums of the negative and of the positive.
fn signed_sums(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([0.0; 2], |[low, high], v| [low + v.min(0.0), high + v.max(0.0)])
}
