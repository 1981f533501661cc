//! Elements that follow the voltage with play: their places added up are Prandtl and Ishlinskii's operator, what each is behind by is
//! Maxwell's slip.

use super::{Operator, next_kink, signed_sums};

/// One element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Play {
    /// r: half the width of the play, volts.
    pub threshold_v: f64,
    /// w: what one volt adds to h.
    pub weight_per_v: f64,
    /// l and c in w + l V + c V^2, which it adds under V volts: loops that lean to one polarity, and loops that grow to either side.
    pub lean_per_v2: f64,
    /// See `lean_per_v2`.
    pub bow_per_v3: f64,
}

impl Play {
    /// One that adds the same under any voltage.
    pub fn upright(threshold_v: f64, weight_per_v: f64) -> Self {
        Self { threshold_v, weight_per_v, lean_per_v2: 0.0, bow_per_v3: 0.0 }
    }

    fn weight_at(&self, at_v: f64) -> f64 {
        self.weight_per_v + at_v * (self.lean_per_v2 + at_v * self.bow_per_v3)
    }
}

/// What of the elements counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// Where each is: Prandtl and Ishlinskii.
    Places,
    /// How far behind each is, as a spring that slips where it is stretched by r: Maxwell.
    Lags,
}

/// h = sum of w p or of w (V - p), p = max(V - r, min(V + r, p)); with w + l V + c V^2 for w, the generalised model of asymmetric and saturated
/// loops.
#[derive(Clone, Debug, PartialEq)]
pub struct Plays {
    /// The elements.
    pub plays: Vec<Play>,
    /// What of them counts.
    pub counts: Counts,
}

impl Operator for Plays {
    fn relaxed(&self) -> Vec<f64> {
        vec![0.0; self.plays.len()]
    }

    fn pass(&self, memory: &mut Vec<f64>, _: f64, to_v: f64) {
        for (play, place_v) in self.plays.iter().zip(memory) {
            *place_v = place_v.max(to_v - play.threshold_v).min(to_v + play.threshold_v);
        }
    }

    fn h(&self, memory: &[f64], at_v: f64) -> f64 {
        let counts = |place_v: f64| if self.counts == Counts::Places { place_v } else { at_v - place_v };
        self.plays.iter().zip(memory).map(|(play, place_v)| play.weight_at(at_v) * counts(*place_v)).sum()
    }

    fn smooth_v(&self, memory: &[f64], at_v: f64, towards: f64) -> f64 {
        // Where an element begins to be taken along.
        let taken_v =
            self.plays.iter().zip(memory).map(|(play, place_v)| place_v + towards.signum() * play.threshold_v);
        next_kink(taken_v, at_v, towards)
    }

    /// Of plays that lean, about zero volts.
    fn slopes_per_v(&self) -> [f64; 2] {
        signed_sums(self.plays.iter().map(|play| play.weight_per_v))
    }
}
