//! From fits to probabilities.
//!
//! With 200,000 samples a likelihood under white noise is always certain, and certain of the wrong thing as soon as the true effect has
//! another form than the registry's. So a fit is judged by what it leaves, and two questions are kept apart. Which of the fits it is, is told
//! by the unexplained fraction of the whole gap, on a logarithmic scale with a floor where the noise of the comparison begins, and by
//! what the numbers' shifts cost. Whether it is any of them, is told by the log and by the octave of frequency that the fit misses most: a cause of
//! another kind may be imitated in most experiments and at most frequencies, but hardly in all of them. The constants were set on made cases
//! (`blind-truth`'s calibrate split): those of the score on 49 with the right effect in a wrong form and 63 with a foreign one or with the entry
//! struck out; those of the doubt by a logistic regression of "the leading entry is right" on 240 answers to one effect, two and foreign ones, in
//! the proportions of the blind check, when it was told by logs alone. How far the probabilities can be relied upon, `docs/blind-check.md` says.

/// Weight of the logarithm of the unexplained fraction.
pub const SHARPNESS: f64 = 3.0;
/// Weight of one unit of prior cost, and the cost that a true explanation has anyway.
pub const PRIOR_WEIGHT: f64 = 0.03;
/// Largest penalty for prior cost: mimics are told by it, but a large error of a nominal number may be true as well.
pub const PRIOR_MOST: f64 = 8.0;
/// Penalty for each parameter beyond the first, and for a second effect.
pub const PARAMETER: f64 = 0.15;
/// See [`PARAMETER`].
pub const SECOND: f64 = 3.0;

/// Unexplained fraction of what is missed most at which an explanation is as likely to be none as to be right, ..
const EVEN: f64 = 0.82;
/// .. the weight of that fraction's logarithm, ..
const DOUBT: f64 = 1.8;
/// .. and of one unit of prior cost, of so many at most.
const PRIOR_DOUBT: f64 = 0.003;
const PRIOR_DOUBTED: f64 = 300.0;

/// What is judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Identifiers of the effects; empty for none.
    pub ids: Vec<&'static str>,
    /// Fraction of the gap that stays unexplained, as amplitude.
    pub left: f64,
    /// The same of the log or octave in which most of its own gap stays; zero where that is not known.
    pub of_worst: f64,
    /// Least fraction that these logs resolve.
    pub floor: f64,
    /// Squares of the nominal numbers' shifts in sigma.
    pub prior_cost: f64,
    /// Parameters of the effects.
    pub parameters: usize,
}

impl Judged {
    /// Logarithm of the unnormalised probability among explanations.
    pub fn score(&self) -> f64 {
        let left = self.left.hypot(self.floor).min(1.5);
        let second = SECOND * self.ids.len().saturating_sub(1) as f64;
        -SHARPNESS * left.ln()
            - (PRIOR_WEIGHT * self.prior_cost).min(PRIOR_MOST)
            - PARAMETER * self.parameters.saturating_sub(1) as f64
            - second
    }

    /// Probability that it is none of the registry's, if no explanation is better than this one.
    pub fn doubt(&self) -> f64 {
        let missed = self.of_worst.max(self.left).hypot(self.floor);
        let known = DOUBT * (EVEN / missed).ln() - PRIOR_DOUBT * self.prior_cost.min(PRIOR_DOUBTED);
        1.0 / (1.0 + known.exp())
    }
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

    fn judged(left: f64, of_worst: f64, prior_cost: f64) -> Judged {
        Judged { ids: vec!["creep"], left, of_worst, floor: 0.01, prior_cost, parameters: 1 }
    }

    #[test]
    fn what_misses_one_log_is_doubted_and_no_less_likely_among_its_rivals() {
        let (even, missing) = (judged(0.2, 0.2, 10.0), judged(0.2, 0.8, 10.0));
        assert_eq!(even.score(), missing.score());
        assert!(even.doubt() < 0.1 && missing.doubt() > 5.0 * even.doubt(), "{} {}", even.doubt(), missing.doubt());
        // It grows with what is missed and with what the numbers pay, and never to certainty.
        let doubts = [0.05, 0.1, 0.3, 0.6, 1.0, 3.0].map(|of_worst| judged(0.05, of_worst, 10.0).doubt());
        assert!(doubts.windows(2).all(|pair| pair[0] < pair[1]) && doubts[0] > 1e-4 && doubts[5] < 0.99, "{doubts:?}");
        assert!(judged(0.2, 0.2, 200.0).doubt() > even.doubt());
        // What nothing is known of by logs is missed as much as all together.
        assert_eq!(judged(0.5, 0.0, 0.0).doubt(), judged(0.5, 0.5, 0.0).doubt());
    }
}
