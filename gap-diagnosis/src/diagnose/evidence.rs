//! From fits to probabilities.
//!
//! With 200,000 samples a likelihood under white noise is always certain, and certain of the wrong thing as soon as the true effect has
//! another form than the registry's. So a fit is judged by what it leaves: the unexplained fraction of the gap, on a logarithmic scale
//! with a floor where the noise of the comparison begins, and by the prior cost that it needs. The constants were
//! set on made cases with forms of their own (`blind-truth`); how far the probabilities can be relied upon, `docs/blind-check.md` says.

/// Weight of the logarithm of the unexplained fraction.
pub const SHARPNESS: f64 = 3.0;
/// Unexplained fraction at which an explanation is as good as `unknown`.
pub const UNKNOWN_LEFT: f64 = 0.4;
/// Weight of one unit of prior cost, and the cost that a true explanation has anyway.
pub const PRIOR_WEIGHT: f64 = 0.03;
/// Largest penalty for prior cost: mimics are told by it, but a large error of a nominal number may be true as well.
pub const PRIOR_MOST: f64 = 8.0;
/// Penalty for each parameter beyond the first, and for a second effect.
pub const PARAMETER: f64 = 0.15;
/// See [`PARAMETER`].
pub const SECOND: f64 = 3.0;

/// What is judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Identifiers of the effects; empty for none.
    pub ids: Vec<&'static str>,
    /// Fraction of the gap that stays unexplained, as amplitude.
    pub left: f64,
    /// Least fraction that these logs resolve.
    pub floor: f64,
    /// Squares of the nominal numbers' shifts in sigma.
    pub prior_cost: f64,
    /// Parameters of the effects.
    pub parameters: usize,
}

impl Judged {
    /// Logarithm of the unnormalised probability.
    pub fn score(&self) -> f64 {
        let left = self.left.hypot(self.floor).min(1.5);
        let second = SECOND * self.ids.len().saturating_sub(1) as f64;
        -SHARPNESS * left.ln()
            - (PRIOR_WEIGHT * self.prior_cost).min(PRIOR_MOST)
            - PARAMETER * self.parameters.saturating_sub(1) as f64
            - second
    }
}

/// Score of `unknown`.
pub fn unknown_score() -> f64 {
    -SHARPNESS * UNKNOWN_LEFT.ln()
}

/// Probabilities in proportion to exp(score).
pub fn probabilities(scores: &[f64]) -> Vec<f64> {
    let most = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = scores.iter().map(|s| (s - most).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}
