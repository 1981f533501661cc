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

/// An effect that leaves more than the second of the gap of any one log is judged by that log, less than the first not at all: a cause of
/// another kind may have little to say in most experiments.
const MISSES_A_LOG: [f64; 2] = [0.45, 0.55];

/// What is judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Identifiers of the effects; empty for none.
    pub ids: Vec<&'static str>,
    /// Fraction of the gap that stays unexplained, as amplitude.
    pub left: f64,
    /// The same of the log in which most of its own gap stays; zero where that is not known.
    pub of_worst: f64,
    /// Least fraction that these logs resolve.
    pub floor: f64,
    /// Squares of the nominal numbers' shifts in sigma.
    pub prior_cost: f64,
    /// Parameters of the effects.
    pub parameters: usize,
}

impl Judged {
    /// Fraction that it is judged by: that of all logs, or that of the worst where it misses most of that one's gap; on the way from one to
    /// the other their mean on the logarithmic scale.
    pub fn left_judged(&self) -> f64 {
        let [from, to] = MISSES_A_LOG;
        let share = ((self.of_worst - from) / (to - from)).clamp(0.0, 1.0);
        let left = self.left.max(self.floor);
        if share == 0.0 || self.of_worst <= left {
            return self.left;
        }
        left.powf(1.0 - share) * self.of_worst.powf(share)
    }

    /// Logarithm of the unnormalised probability.
    pub fn score(&self) -> f64 {
        let left = self.left_judged().hypot(self.floor).min(1.5);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_that_is_missed_counts_by_itself_and_there_is_no_cliff() {
        let judged = |left, of_worst| {
            Judged { ids: vec!["creep"], left, of_worst, floor: 0.01, prior_cost: 0.0, parameters: 1 }.left_judged()
        };
        assert_eq!((judged(0.1, 0.4), judged(0.1, 0.6), judged(0.7, 0.6)), (0.1, 0.6, 0.7));
        let half_way = judged(0.1, 0.5);
        assert!((half_way - (0.1f64 * 0.5).sqrt()).abs() < 1e-12, "{half_way}");
        // What is at the noise is judged by no less than these logs resolve.
        assert!(judged(0.0, 0.5) > 0.05);
    }
}
