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
    /// Cases that were diagnosed so, and those with one effect, which are all that can be.
    pub made: usize,
    /// See `made`.
    pub of: usize,
    /// Of those where the best remaining entry leaves more than 1.5 times the noise: answered `unknown`, or by a set with it. A
    /// diagnosis that failed is a miss.
    pub said_unknown: Rate,
    /// Of those that were answered: named a wrong entry with more than 90 %.
    pub confidently_wrong: Rate,
    /// Where another entry takes the gap: truth, answer, how often.
    pub absorbed: Vec<(String, String, usize)>,
    /// No answer.
    pub defects: usize,
    /// Answers that state no best fit, so that what the plant they answer with leaves counts in its place.
    pub without_best_fit: usize,
}

/// Figures from cases with one effect, diagnosed without it; there are `of` such cases.
pub fn left_out(cases: &[Case], of: usize) -> LeftOut {
    let mut absorbed: BTreeMap<(String, String), usize> = BTreeMap::new();
    let mut open: Vec<&Answer> = Vec::new();
    let answered: Vec<(&Case, &Answer)> = cases.iter().filter_map(|case| Some((case, case.answered()?))).collect();
    for (case, answer) in &answered {
        if leaves(case, answer) > NOT_ABSORBED {
            open.push(answer);
        } else {
            *absorbed.entry((case.truth.words(), answer.name().to_owned())).or_default() += 1;
        }
    }
    let defects = cases.len() - answered.len();
    let says_unknown = |answer: &&&Answer| answer.name() == UNKNOWN || answer.in_set(UNKNOWN);
    LeftOut {
        made: cases.len(),
        of,
        said_unknown: Rate::new(open.iter().filter(says_unknown).count(), open.len() + defects),
        confidently_wrong: Rate::count(&open, |answer| answer.is_named() && answer.confidence() > CONFIDENT),
        absorbed: absorbed.into_iter().map(|((truth, answer), count)| (truth, answer, count)).collect(),
        defects,
        without_best_fit: answered.iter().filter(|(_, answer)| answer.best_fit.is_none()).count(),
    }
}

/// What the best fit leaves, over the noise, whatever was answered: an answer of `unknown` keeps no fit, so that what its plant leaves would
/// ask for that very answer. Where no fit is stated the plant's rest has to do; without figures nothing is known to be absorbed.
fn leaves(case: &Case, answer: &Answer) -> f64 {
    let noise_um = case.truth.noise_um.filter(|noise_um| *noise_um > 0.0);
    match (&answer.best_fit, noise_um) {
        // What passes for noise in the diagnosis, because the entry that tells it was struck out, is none.
        (Some(best), Some(noise_um)) => best.rms_over_noise * answer.gap.noise_rms_um.map_or(1.0, |um| um / noise_um),
        (Some(best), None) => best.rms_over_noise,
        (None, Some(noise_um)) => answer.gap.augmented_rms_um.map_or(f64::INFINITY, |rms_um| rms_um / noise_um),
        (None, None) => f64::INFINITY,
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
    /// Cases with a command that is still to be run.
    pub open: usize,
    /// Mean size of the set before and after.
    pub mean_size: [f64; 2],
    /// Rightly named before and after.
    pub right: [Rate; 2],
    /// The set still holds the truth afterwards.
    pub covered: Rate,
}

/// A case before the experiment, and what became of that.
pub struct Tried<'a> {
    /// Before.
    pub before: &'a Case,
    /// The rest.
    pub then: Then,
}

/// What became of an experiment.
pub enum Then {
    /// No command was proposed.
    NoCommand,
    /// It was not made yet.
    Open,
    /// It was made: the case with its log.
    Made(Box<Case>),
}

/// Figures from cases whose set had several members.
pub fn active(tried: &[Tried<'_>]) -> Active {
    let made = tried.iter().filter_map(|tried| match &tried.then {
        Then::Made(after) => Some((tried.before, &**after)),
        _ => None,
    });
    let made: Vec<(&Case, &Case)> = made.collect();
    let answered: Vec<(&Case, &Case)> = made.iter().copied().filter(|(_, after)| after.answer.is_ok()).collect();
    let size = |case: &Case| case.answered().map_or(f64::NAN, |answer| answer.set90.len() as f64);
    Active {
        made: answered.len(),
        no_command: tried.iter().filter(|tried| matches!(tried.then, Then::NoCommand)).count(),
        failed: made.len() - answered.len(),
        open: tried.iter().filter(|tried| matches!(tried.then, Then::Open)).count(),
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
