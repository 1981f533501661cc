//! The score of a diagnosis whose truth was withheld: pure functions of truths and answers.
//!
//! [`score`] takes cases and gives every figure; [`score_page`] lays it out. What it does not do: read files, make cases or
//! know where they came from. Accepted measures, not home-made ones: Wilson intervals, AUROC and OpenAUC for what is unknown,
//! AUGRC for the risk of trusting an answer, coverage and size of sets.

mod again;
mod bars;
mod case;
mod failure;
mod names;
mod numbers;
mod open;
mod page;
mod rate;
#[cfg(test)]
mod tests;
mod trust;

pub use again::{Active, LeftOut, Then, Tried, active, left_out};
pub use bars::Bar;
pub use case::{Answer, BestFit, Case, Estimate, Gap, Kind, NextExperiment, Truth};
pub use failure::{Cause, Failure};
pub use names::{Confusion, Names, RatioBin, Recall};
pub use numbers::{Numbers, Outside, known_forms};
pub use open::{Rejection, Seen};
pub use page::{PageView, score_page};
pub use rate::Rate;
pub use trust::{Bin, Calibration, Risk};

use again::{CONFIDENT, is_covered};
use case::{NO_GAP, UNKNOWN};
use rate::{mean, median};
use serde::Serialize;

/// Every figure of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// What there was.
    pub cases: Counts,
    /// The headline figures against what they must reach.
    pub bars: Vec<Bar>,
    /// Cases with one effect.
    pub names: Names,
    /// Nulls in which anything but `no_gap` was answered.
    pub false_alarms: Rate,
    /// Nulls in which an effect was named.
    pub falsely_named: Rate,
    /// Known cases against foreign ones, by the probability of `unknown`.
    pub rejection: Rejection,
    /// Foreign cases answered `unknown`.
    pub said_unknown: Rate,
    /// Cases with a gap to which a wrong effect was given with more than 90 %.
    pub confidently_wrong: Rate,
    /// Risk against coverage, all cases; no answer counts as one without confidence.
    pub risk: Risk,
    /// Calibration of all answers.
    pub calibration: Calibration,
    /// The 90 % sets.
    pub sets: Sets,
    /// Cases with two effects.
    pub pairs: Pairs,
    /// How far the gap closed.
    pub closure: Closure,
    /// How well the numbers of named effects are known.
    pub numbers: Numbers,
    /// Truth against answer.
    pub confusion: Confusion,
    /// Failures by cause.
    pub causes: Vec<(Cause, usize)>,
    /// Every failure, the most confident first.
    pub failures: Vec<Failure>,
    /// With the true entry struck out, where that was asked for.
    pub left_out: Option<LeftOut>,
    /// With the proposed experiment made, where that was asked for.
    pub active: Option<Active>,
}

/// How many cases of each kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// One effect.
    pub singles: usize,
    /// None.
    pub nulls: usize,
    /// Two.
    pub pairs: usize,
    /// Outside the registry.
    pub foreign: usize,
    /// Among all of them: those without a usable answer.
    pub defects: usize,
}

/// Coverage and size of the 90 % sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sets {
    /// The set of a single holds its effect.
    pub singles: Rate,
    /// The set of a null holds `no_gap`.
    pub nulls: Rate,
    /// The set of something foreign holds `unknown`.
    pub foreign: Rate,
    /// The set of a pair holds both effects.
    pub pairs: Rate,
    /// Mean size over singles.
    pub mean_size: f64,
}

/// Named effects of pairs against true ones, by the class rule.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pairs {
    /// Named ones that are true.
    pub precision: Rate,
    /// True ones that are named.
    pub recall: Rate,
    /// Harmonic mean of both.
    pub f1: f64,
    /// Both named, whatever else is.
    pub both: Rate,
    /// Both named and nothing else.
    pub exact: Rate,
}

/// How far the gap closed on data that were not fitted, over singles and pairs that were explained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Closure {
    /// Cases with a figure.
    pub cases: usize,
    /// Median closure.
    pub median_percent: f64,
    /// Cases with a prediction of the shrink.
    pub predicted: usize,
    /// Median distance between predicted and realised shrink, in points of per cent.
    pub median_miss_percent: f64,
    /// The prediction and what was realised are within 5 points.
    pub within_5_points: Rate,
    /// The realised shrink lies inside the prediction's 95 % interval.
    pub inside_ci95: Rate,
}

/// Scores `cases`.
pub fn score(cases: &[Case], left_out: Option<LeftOut>, active: Option<Active>) -> Score {
    let of = |kind: Kind| cases.iter().filter(move |case| case.truth.kind() == kind);
    let failures = failure::failures(cases);
    let stated: Vec<(f64, bool)> = cases.iter().map(|case| (case.confidence(), case.is_right())).collect();
    let answered = cases.iter().filter(|case| case.answer.is_ok());
    let answered: Vec<(f64, bool)> = answered.map(|case| (case.confidence(), case.is_right())).collect();
    let mut score = Score {
        cases: Counts {
            singles: of(Kind::Single).count(),
            nulls: of(Kind::Null).count(),
            pairs: of(Kind::Pair).count(),
            foreign: of(Kind::Foreign).count(),
            defects: cases.iter().filter(|case| case.answer.is_err()).count(),
        },
        bars: Vec::new(),
        names: names::names(cases),
        false_alarms: Rate::count(of(Kind::Null), |case| case.name() != NO_GAP),
        falsely_named: Rate::count(of(Kind::Null), |case| case.answered().is_some_and(Answer::is_named)),
        rejection: rejection(cases),
        said_unknown: Rate::count(of(Kind::Foreign), |case| case.name() == UNKNOWN),
        confidently_wrong: Rate::count(cases.iter().filter(|case| case.truth.kind() != Kind::Null), |case| {
            case.answered().is_some_and(Answer::is_named) && !case.is_right() && case.confidence() > CONFIDENT
        }),
        risk: trust::risk(&stated),
        calibration: trust::calibration(&answered),
        sets: Sets {
            singles: Rate::count(of(Kind::Single), is_covered),
            nulls: Rate::count(of(Kind::Null), is_covered),
            foreign: Rate::count(of(Kind::Foreign), is_covered),
            pairs: Rate::count(of(Kind::Pair), is_covered),
            mean_size: mean(of(Kind::Single).filter_map(Case::answered).map(|answer| answer.set90.len() as f64)),
        },
        pairs: pairs(of(Kind::Pair)),
        closure: closure(cases),
        numbers: numbers::numbers(cases),
        confusion: names::confusion(cases),
        causes: Cause::ALL.map(|cause| (cause, failures.iter().filter(|f| f.cause == cause).count())).to_vec(),
        failures,
        left_out,
        active,
    };
    score.bars = bars::bars(&score);
    score
}

/// A diagnosis that fails has rejected what is known and accepted what is foreign: the worst in both.
fn rejection(cases: &[Case]) -> Rejection {
    let seen = |case: &Case, without_answer: f64| Seen {
        unknown: case.answered().map_or(without_answer, |answer| answer.probability(UNKNOWN)),
        is_right: case.answered().is_some_and(|answer| {
            let best = answer.best_entry();
            best.is_some_and(|best| case.truth.effects.iter().any(|truth| answer.counts_as(best, truth)))
        }),
    };
    let known = cases.iter().filter(|case| matches!(case.truth.kind(), Kind::Single | Kind::Pair));
    let foreign = cases.iter().filter(|case| case.truth.kind() == Kind::Foreign);
    let known: Vec<Seen> = known.map(|case| seen(case, 1.0)).collect();
    let foreign: Vec<Seen> = foreign.map(|case| seen(case, 0.0)).collect();
    open::rejection(&known, &foreign)
}

fn pairs<'a>(cases: impl Iterator<Item = &'a Case>) -> Pairs {
    let matches: Vec<(usize, usize, usize)> = cases.map(Case::matches).collect();
    let sum = |part: fn(&(usize, usize, usize)) -> usize| matches.iter().map(part).sum::<usize>();
    let (hits, named, wanted) = (sum(|m| m.0), sum(|m| m.1), sum(|m| m.2));
    Pairs {
        precision: Rate::new(hits, named),
        recall: Rate::new(hits, wanted),
        f1: 2.0 * hits as f64 / (named + wanted) as f64,
        both: Rate::count(&matches, |(hits, _, wanted)| hits == wanted),
        exact: Rate::count(&matches, |(hits, named, wanted)| hits == named && hits == wanted),
    }
}

fn closure(cases: &[Case]) -> Closure {
    let gaps: Vec<&Gap> = cases
        .iter()
        .filter(|case| !case.truth.effects.is_empty())
        .filter_map(Case::answered)
        .filter(|answer| answer.is_named())
        .map(|answer| &answer.gap)
        .collect();
    let closed: Vec<f64> = gaps.iter().filter_map(|gap| gap.closure_percent).collect();
    let predicted: Vec<(f64, &Gap)> =
        gaps.iter().filter_map(|gap| Some((gap.predicted_shrink_percent?, *gap))).collect();
    let miss = |(predicted, gap): &(f64, &Gap)| Some((predicted - gap.shrink_percent?).abs());
    let misses: Vec<f64> = predicted.iter().filter_map(miss).collect();
    let realised = gaps.iter().filter_map(|gap| Some((gap.shrink_percent?, gap.predicted_shrink_percent_ci95?)));
    Closure {
        cases: closed.len(),
        median_percent: median(closed),
        predicted: predicted.len(),
        within_5_points: Rate::count(&misses, |miss| *miss <= 5.0),
        median_miss_percent: median(misses),
        inside_ci95: Rate::count(realised, |(shrink, (low, high))| (low..=high).contains(&shrink)),
    }
}
