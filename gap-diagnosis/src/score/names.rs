//! Whether the right thing was named: in the first place, among the first three, effect by effect and size by size.

use super::case::{Answer, Case, DEFECT, Kind, NO_GAP, UNKNOWN};
use super::rate::Rate;
use serde::Serialize;
use std::collections::BTreeSet;

/// Edges of the bins of the gap over noise.
const RATIO_EDGES: [f64; 8] = [0.0, 3.0, 5.0, 10.0, 20.0, 40.0, 80.0, f64::INFINITY];
/// Recall from which on an effect counts as detectable.
pub const DETECTABLE: f64 = 0.75;
/// Gap after the refit, over the noise, from which on an effect is said to show.
const SHOWN: f64 = 3.0;

/// Figures of the cases with one effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Names {
    /// The leading name is right by the class rule.
    pub top1: Rate,
    /// The leading name is the truth itself.
    pub strict_top1: Rate,
    /// The truth is right by the class rule among three: the leading name and the most probable other answers, `unknown` and `no_gap` among them.
    pub top3: Rate,
    /// The stage is right, or the name by the class rule.
    pub stage: Rate,
    /// The stage itself is right.
    pub strict_stage: Rate,
    /// The leading name is right by the class rule, where the refit leaves at least three times the noise; of no case where nobody knows that.
    pub shown_top1: Rate,
    /// The same of the stage, or the name by the class rule.
    pub shown_stage: Rate,
    /// More effects were named than there are.
    pub superfluous: Rate,
    /// Effect by effect.
    pub recall: Vec<Recall>,
    /// By size of the gap.
    pub by_ratio: Vec<RatioBin>,
}

/// How often one effect was named.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recall {
    /// The effect.
    pub effect: String,
    /// By the class rule.
    pub recall: Rate,
    /// As itself.
    pub strict: Rate,
    /// Gap over noise from which on it is named in three of four cases, in its bin and in all above together; none if never, or if the gaps are not known.
    pub detectable_from: Option<f64>,
    /// By size of the gap.
    pub by_ratio: Vec<RatioBin>,
}

/// Cases whose gap over noise lies in one bin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RatioBin {
    /// Lower edge.
    pub from: f64,
    /// Upper edge; null for the last one.
    pub to: f64,
    /// How many were named rightly.
    pub right: Rate,
}

/// Truth against answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Confusion {
    /// What is so: effects, then null and foreign.
    pub truths: Vec<String>,
    /// What was answered: effects, then no_gap, unknown and defect.
    pub answers: Vec<String>,
    /// Cases, by truth and then by answer.
    pub counts: Vec<Vec<usize>>,
}

/// All of it from the singles among `cases`.
pub fn names(cases: &[Case]) -> Names {
    let singles: Vec<&Case> = cases.iter().filter(|case| case.truth.kind() == Kind::Single).collect();
    let effects: BTreeSet<&str> = singles.iter().map(|case| case.truth.effects[0].as_str()).collect();
    let recall = |effect: &&str| {
        let mine: Vec<&Case> = singles.iter().copied().filter(|case| case.truth.effects[0] == **effect).collect();
        let by_ratio = bins(&mine);
        Recall {
            effect: (*effect).to_owned(),
            recall: Rate::count(&mine, |case| case.is_right()),
            strict: Rate::count(&mine, |case| is_strictly_right(case)),
            detectable_from: frontier(&by_ratio),
            by_ratio,
        }
    };
    // What was wrong with a nominal number has no stage of its own.
    let staged = |cases: &[&Case], is_right: fn(&Case) -> bool| {
        Rate::count(cases.iter().filter(|case| case.truth.stage.is_some()), |case| is_right(case))
    };
    // Of a real bench nobody knows the noise; no answer is no excuse.
    let shows =
        |case: &&Case| case.truth.noise_um.is_some() && case.refit_over_noise().is_none_or(|ratio| ratio >= SHOWN);
    let shown: Vec<&Case> = singles.iter().copied().filter(shows).collect();
    Names {
        top1: Rate::count(&singles, |case| case.is_right()),
        strict_top1: Rate::count(&singles, |case| is_strictly_right(case)),
        top3: Rate::count(&singles, |case| is_among_three(case)),
        stage: staged(&singles, has_stage_or_name),
        strict_stage: staged(&singles, has_its_stage),
        shown_top1: Rate::count(&shown, |case| case.is_right()),
        shown_stage: staged(&shown, has_stage_or_name),
        superfluous: Rate::count(&singles, |case| case.answered().is_some_and(|answer| answer.effects.len() > 1)),
        recall: effects.iter().map(recall).collect(),
        by_ratio: bins(&singles),
    }
}

fn is_strictly_right(case: &Case) -> bool {
    case.truth.names().contains(&case.name())
}

fn has_its_stage(case: &Case) -> bool {
    case.answered().and_then(|answer| answer.stage.as_ref()) == case.truth.stage.as_ref()
}

fn has_stage_or_name(case: &Case) -> bool {
    case.is_right() || has_its_stage(case)
}

fn is_among_three(case: &Case) -> bool {
    let truth = &case.truth.effects[0];
    let holds = |answer: &Answer| {
        let leading = answer.name();
        let others = answer.first(3).filter(|name| *name != leading);
        std::iter::once(leading).chain(others).take(3).any(|name| answer.counts_as(name, truth))
    };
    case.answered().is_some_and(holds)
}

fn bins(cases: &[&Case]) -> Vec<RatioBin> {
    let windows = RATIO_EDGES.windows(2).map(|edges| (edges[0], edges[1]));
    let bin = |(from, to): (f64, f64)| {
        let inside =
            cases.iter().filter(|case| case.truth.gap_over_noise.is_some_and(|ratio| (from..to).contains(&ratio)));
        RatioBin { from, to, right: Rate::count(inside, |case| case.is_right()) }
    };
    windows.map(bin).filter(|bin| bin.right.of > 0).collect()
}

/// Lower edge of the smallest bin from which on an effect is detectable.
fn frontier(bins: &[RatioBin]) -> Option<f64> {
    let is_detectable = |bins: &[RatioBin]| {
        let (hits, of) = bins.iter().fold((0, 0), |(hits, of), bin| (hits + bin.right.hits, of + bin.right.of));
        hits as f64 >= DETECTABLE * of as f64
    };
    (0..bins.len()).find(|at| is_detectable(&bins[*at..=*at]) && is_detectable(&bins[*at..])).map(|at| bins[at].from)
}

/// Truth against answer of all cases but pairs, whose answer is a set.
pub fn confusion(cases: &[Case]) -> Confusion {
    let label = |case: &Case| match case.truth.kind() {
        Kind::Null => "null".to_owned(),
        Kind::Foreign => "foreign".to_owned(),
        _ => case.truth.effects[0].clone(),
    };
    let shown: Vec<&Case> = cases.iter().filter(|case| case.truth.kind() != Kind::Pair).collect();
    let apart = ["null", "foreign", NO_GAP, UNKNOWN, DEFECT];
    let effects: BTreeSet<String> = shown
        .iter()
        .flat_map(|case| [label(case), case.name().to_owned()])
        .filter(|name| !apart.contains(&name.as_str()))
        .collect();
    let with = |last: &[&str]| -> Vec<String> {
        effects.iter().cloned().chain(last.iter().map(|s| (*s).to_owned())).collect()
    };
    let (truths, answers) = (with(&apart[..2]), with(&apart[2..]));
    let count = |truth: &String, answer: &String| {
        shown.iter().filter(|case| label(case) == *truth && case.name() == answer).count()
    };
    let counts = truths.iter().map(|truth| answers.iter().map(|answer| count(truth, answer)).collect()).collect();
    Confusion { truths, answers, counts }
}
