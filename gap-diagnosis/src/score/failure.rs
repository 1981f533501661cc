//! Why a case went wrong.

use super::case::{Case, Kind};
use serde::Serialize;

/// The cause of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The truth is in `set90` or in one class with the answer: these logs can't tell.
    Indistinguishable,
    /// After the refit less than the noise is left of the effect.
    BelowNoise,
    /// The effect occurs in a form that the develop split does not show.
    WrongForm,
    /// None of these: the diagnosis is at fault.
    Defect,
}

impl Cause {
    /// All of them.
    pub const ALL: [Cause; 4] = [Cause::Indistinguishable, Cause::BelowNoise, Cause::WrongForm, Cause::Defect];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Cause::Indistinguishable => "indistinguishable on this excitation",
            Cause::BelowNoise => "below the noise",
            Cause::WrongForm => "wrong model form",
            Cause::Defect => "defect",
        }
    }
}

/// A case that went wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failure {
    /// Its identifier.
    pub id: String,
    /// What is so.
    pub truth: String,
    /// In which form.
    pub form: String,
    /// What was answered.
    pub answer: String,
    /// How sure the answer was.
    pub confidence: f64,
    /// Gap over noise before any refit.
    pub gap_over_noise: Option<f64>,
    /// Gap over noise after the refit.
    pub refit_over_noise: Option<f64>,
    /// Why.
    pub cause: Cause,
    /// What the diagnosis said when it failed to answer.
    pub said: Option<String>,
}

/// Effects that a refit of the nominal numbers imitates: they show as shifts, not as a remaining gap, so that little
/// remaining says nothing about their size. A zero is such a number wherever the file states one, and the last two are imitated by it.
const ABSORBED: [&str; 6] =
    ["payload_mass", "amplifier_gain", "sensor_gain", "parameter_error", "sensor_offset", "asymmetric_hysteresis"];

/// All failures, the most confident first.
pub fn failures(cases: &[Case]) -> Vec<Failure> {
    let mut failures: Vec<Failure> = cases.iter().filter(|case| has_failed(case)).map(failure).collect();
    failures.sort_by(|a, b| b.confidence.total_cmp(&a.confidence).then_with(|| a.id.cmp(&b.id)));
    failures
}

/// A wrong leading name; for a pair also one that is missing or superfluous.
fn has_failed(case: &Case) -> bool {
    let is_incomplete = || {
        let (matches, named, wanted) = case.matches();
        matches < named.max(wanted)
    };
    !case.is_right() || (case.truth.kind() == Kind::Pair && is_incomplete())
}

fn failure(case: &Case) -> Failure {
    let answer = match case.answered() {
        Some(answer) if answer.is_named() => answer.effects.join(" + "),
        _ => case.name().to_owned(),
    };
    Failure {
        id: case.id.clone(),
        truth: case.truth.words(),
        form: case.truth.form.clone(),
        answer,
        confidence: case.confidence(),
        gap_over_noise: case.truth.gap_over_noise,
        refit_over_noise: case.refit_over_noise(),
        cause: cause(case),
        said: case.answer.as_ref().err().cloned(),
    }
}

fn cause(case: &Case) -> Cause {
    let Some(answer) = case.answered() else { return Cause::Defect };
    let missing = |truth: &&str| !answer.effects.iter().any(|named| answer.counts_as(named, truth));
    let is_open = |truth: &str| answer.in_set(truth) || answer.effects.iter().any(|n| answer.in_one_class(n, truth));
    let missing: Vec<&str> = case.truth.names().into_iter().filter(missing).collect();
    if !missing.is_empty() && missing.iter().all(|truth| is_open(truth)) {
        return Cause::Indistinguishable;
    }
    let is_effect = !case.truth.effects.is_empty();
    let shows_as_gap = !case.truth.effects.iter().any(|effect| ABSORBED.contains(&effect.as_str()));
    if (case.truth.foreign.is_some() || (is_effect && shows_as_gap))
        && case.refit_over_noise().is_some_and(|ratio| ratio < 1.0)
    {
        return Cause::BelowNoise;
    }
    if is_effect && !case.truth.is_textbook_form { Cause::WrongForm } else { Cause::Defect }
}
