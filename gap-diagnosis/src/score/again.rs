//! Cases that were diagnosed a second time: with the true entry struck out, and with the experiment that was asked for.

use super::case::{Answer, Case, UNKNOWN};
use super::rate::{Rate, mean};
use serde::Serialize;
use std::collections::BTreeMap;

/// A remaining misfit above this many times the noise is not absorbed by any other entry.
const NOT_ABSORBED: f64 = 1.5;
/// Probability from which on a name is confident.
pub const CONFIDENT: f64 = 0.9;

/// Figures of cases whose true entry was struck out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// Of those where the best remaining entry leaves more than 1.5 times the noise: answered `unknown`, or by a set with it.
    pub said_unknown: Rate,
    /// Of the same: named a wrong entry with more than 90 %.
    pub confidently_wrong: Rate,
    /// Where another entry takes the gap: truth, answer, how often.
    pub absorbed: Vec<(String, String, usize)>,
    /// No answer.
    pub defects: usize,
}

/// Figures from cases with one effect, diagnosed without it.
pub fn left_out(cases: &[Case]) -> LeftOut {
    let mut absorbed: BTreeMap<(String, String), usize> = BTreeMap::new();
    let mut open: Vec<&Answer> = Vec::new();
    for case in cases {
        let Ok(answer) = &case.answer else { continue };
        if leaves(case, answer) > NOT_ABSORBED {
            open.push(answer);
        } else {
            *absorbed.entry((case.truth.words(), answer.name().to_owned())).or_default() += 1;
        }
    }
    LeftOut {
        said_unknown: Rate::count(&open, |answer| answer.name() == UNKNOWN || answer.in_set(UNKNOWN)),
        confidently_wrong: Rate::count(&open, |answer| answer.is_named() && answer.confidence() > CONFIDENT),
        absorbed: absorbed.into_iter().map(|((truth, answer), count)| (truth, answer, count)).collect(),
        defects: cases.iter().filter(|case| case.answer.is_err()).count(),
    }
}

/// What the best explanation leaves, over the noise; without figures nothing is known to be absorbed.
fn leaves(case: &Case, answer: &Answer) -> f64 {
    match (answer.gap.augmented_rms_um, case.truth.noise_um) {
        (Some(rms_um), Some(noise_um)) => rms_um / noise_um,
        _ => f64::INFINITY,
    }
}

/// What the experiment that was asked for has brought.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Active {
    /// Cases in which it was made.
    pub made: usize,
    /// Cases with several members in the set for which no command was proposed.
    pub no_command: usize,
    /// Cases whose command could not be run, or after which no answer came.
    pub failed: usize,
    /// Mean size of the set before and after.
    pub mean_size: [f64; 2],
    /// Rightly named before and after.
    pub right: [Rate; 2],
    /// The set still holds the truth afterwards.
    pub covered: Rate,
}

/// A case before the experiment, and after it if it was made.
pub struct Tried<'a> {
    /// Before.
    pub before: &'a Case,
    /// After; none if no command was proposed.
    pub after: Option<Case>,
}

/// Figures from cases whose set had several members.
pub fn active(tried: &[Tried<'_>]) -> Active {
    let made: Vec<(&Case, &Case)> = tried.iter().filter_map(|t| Some((t.before, t.after.as_ref()?))).collect();
    let answered: Vec<(&Case, &Case)> = made.iter().copied().filter(|(_, after)| after.answer.is_ok()).collect();
    let size = |case: &Case| case.answered().map_or(f64::NAN, |answer| answer.set90.len() as f64);
    Active {
        made: answered.len(),
        no_command: tried.len() - made.len(),
        failed: made.len() - answered.len(),
        mean_size: [
            mean(answered.iter().map(|(before, _)| size(before))),
            mean(answered.iter().map(|(_, after)| size(after))),
        ],
        right: [
            Rate::count(&answered, |(before, _)| before.is_right()),
            Rate::count(&answered, |(_, after)| after.is_right()),
        ],
        covered: Rate::count(&answered, |(_, after)| is_covered(after)),
    }
}

/// Whether the set of an answer holds all that is so.
pub fn is_covered(case: &Case) -> bool {
    case.answered().is_some_and(|answer| case.truth.names().iter().all(|truth| answer.in_set(truth)))
}
