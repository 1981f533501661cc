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
}

/// What of the elements counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// Where each is: Prandtl and Ishlinskii.
    Places,
    /// How far behind each is, as a spring that slips where it is stretched by r: Maxwell.
    Lags,
}

/// h = sum of w p or of w (V - p), p = max(V - r, min(V + r, p)).
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
        self.plays.iter().zip(memory).map(|(play, place_v)| play.weight_per_v * counts(*place_v)).sum()
    }

    fn smooth_v(&self, memory: &[f64], at_v: f64, towards: f64) -> f64 {
        // Where an element begins to be taken along.
        let taken_v =
            self.plays.iter().zip(memory).map(|(play, place_v)| place_v + towards.signum() * play.threshold_v);
        next_kink(taken_v, at_v, towards)
    }

    fn slopes_per_v(&self) -> [f64; 2] {
        signed_sums(self.plays.iter().map(|play| play.weight_per_v))
    }
}
