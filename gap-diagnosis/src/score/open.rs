//! How well what is outside the registry is told from what is in it (anchors: AUROC alone ignores whether the known ones
//! are named rightly, so OpenAUC stands beside it).

use super::rate::Rate;
use serde::Serialize;

/// A case as the open-set figures see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Probability of `unknown`.
    pub unknown: f64,
    /// Whether the most probable entry of the registry is right; of no meaning for what is foreign.
    pub is_right: bool,
}

/// Figures of the rejection of unknowns.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rejection {
    /// Area under the curve of foreign against known cases, by the probability of `unknown`; ties count half.
    pub auroc: f64,
    /// Probability that a known case is named rightly and has less `unknown` than a foreign one: the area under OSCR.
    pub open_auc: f64,
    /// Foreign cases above the threshold that rejects at most 5 % of the known ones.
    pub rejected_at_5_percent: Rate,
    /// The known ones rejected at that threshold.
    pub falsely_rejected: Rate,
    /// That threshold: what is above it is rejected.
    pub threshold: f64,
    /// Open-set classification rate: share of foreign cases accepted, share of known ones accepted and right.
    pub oscr: Vec<[f64; 2]>,
}

/// Share of known cases that may be rejected.
const FALSE_REJECTION: f64 = 0.05;

/// All figures from the known and the foreign cases.
pub fn rejection(known: &[Seen], foreign: &[Seen]) -> Rejection {
    let pairs = (known.len() * foreign.len()) as f64;
    let (mut wins, mut right_wins) = (0.0, 0.0);
    for k in known {
        for f in foreign {
            let win = if f.unknown > k.unknown { 1.0 } else { 0.5 * f64::from(u8::from(f.unknown == k.unknown)) };
            wins += win;
            right_wins += if k.is_right { win } else { 0.0 };
        }
    }
    let mut scores: Vec<f64> = known.iter().map(|k| k.unknown).collect();
    scores.sort_by(|a, b| b.total_cmp(a));
    // The first known case that may no longer be rejected sets the threshold.
    let allowed = (FALSE_REJECTION * known.len() as f64).floor() as usize;
    let threshold = scores.get(allowed).copied().unwrap_or(f64::NAN);
    Rejection {
        auroc: wins / pairs,
        open_auc: right_wins / pairs,
        rejected_at_5_percent: Rate::count(foreign, |f| f.unknown > threshold),
        falsely_rejected: Rate::count(known, |k| k.unknown > threshold),
        threshold,
        oscr: oscr(known, foreign),
    }
}

/// One point for each threshold, from rejecting all to accepting all.
fn oscr(known: &[Seen], foreign: &[Seen]) -> Vec<[f64; 2]> {
    if known.is_empty() || foreign.is_empty() {
        return Vec::new();
    }
    let mut thresholds: Vec<f64> = known.iter().chain(foreign).map(|seen| seen.unknown).collect();
    thresholds.sort_by(f64::total_cmp);
    thresholds.dedup();
    let share = |hits: usize, of: usize| hits as f64 / of as f64;
    let point = |t: &f64| {
        let accepted = foreign.iter().filter(|f| f.unknown <= *t).count();
        let right = known.iter().filter(|k| k.unknown <= *t && k.is_right).count();
        [share(accepted, foreign.len()), share(right, known.len())]
    };
    std::iter::once([0.0, 0.0]).chain(thresholds.iter().map(point)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(values: &[(f64, bool)]) -> Vec<Seen> {
        values.iter().map(|&(unknown, is_right)| Seen { unknown, is_right }).collect()
    }

    #[test]
    fn areas_by_hand() {
        let known = seen(&[(0.1, true), (0.2, false), (0.6, true), (0.5, true)]);
        let foreign = seen(&[(0.9, false), (0.5, false)]);
        // Against 0.9: four wins; against 0.5: 0.1 and 0.2 win, 0.5 ties, 0.6 loses. 6.5 of 8; without the wrong one 4.5 of 8.
        let figures = rejection(&known, &foreign);
        assert_eq!((figures.auroc, figures.open_auc), (6.5 / 8.0, 4.5 / 8.0));
        // 5 % of four is none: the threshold is the highest known one.
        assert_eq!((figures.threshold, figures.falsely_rejected.hits, figures.rejected_at_5_percent.hits), (0.6, 0, 1));
        // Thresholds 0.1, 0.2, 0.5, 0.6, 0.9.
        assert_eq!(figures.oscr, [[0.0, 0.0], [0.0, 0.25], [0.0, 0.25], [0.5, 0.5], [0.5, 0.75], [1.0, 0.75]]);
    }

    #[test]
    fn one_in_twenty_may_be_rejected() {
        let known: Vec<Seen> = (0..40).map(|i| Seen { unknown: f64::from(i) / 100.0, is_right: true }).collect();
        let foreign = seen(&[(0.375, false), (0.38, false), (0.1, false)]);
        let figures = rejection(&known, &foreign);
        // Two of forty may go, 0.39 and 0.38; what lies above 0.37 goes.
        assert_eq!(
            (figures.threshold, figures.falsely_rejected.hits, figures.rejected_at_5_percent.hits),
            (0.37, 2, 2)
        );
        assert!(rejection(&[], &foreign).auroc.is_nan());
    }
}
