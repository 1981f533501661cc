//! Whether the stated probabilities can be relied upon: risk against coverage, and calibration.

use super::rate::Rate;
use serde::Serialize;

/// Bins of the calibration curve.
const BINS: usize = 10;

/// An answer as these figures see it: its stated probability and whether it was right.
pub type Stated = (f64, bool);

/// Risk against coverage: the most confident answers are accepted first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Risk {
    /// Mean over all coverages of the share of wrong answers among the accepted ones.
    pub aurc: f64,
    /// Mean over all coverages of the share of all cases that are accepted and wrong: the risk of an undetected failure
    /// (Traub et al., arXiv 2407.01032).
    pub augrc: f64,
    /// Coverage and share of wrong answers among the accepted ones.
    pub curve: Vec<[f64; 2]>,
}

/// Risk against coverage of `stated`; answers of one confidence are accepted together, in no order among themselves.
pub fn risk(stated: &[Stated]) -> Risk {
    let mut sorted = stated.to_vec();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    let n = sorted.len() as f64;
    let (mut wrong, mut accepted) = (0.0, 0.0);
    let (mut aurc, mut augrc) = (0.0, 0.0);
    let mut curve = Vec::new();
    for tied in sorted.chunk_by(|a, b| a.0 == b.0) {
        let share_wrong = tied.iter().filter(|(_, is_right)| !is_right).count() as f64 / tied.len() as f64;
        for _ in tied {
            wrong += share_wrong;
            accepted += 1.0;
            aurc += wrong / accepted / n;
            augrc += wrong / n / n;
            curve.push([accepted / n, wrong / accepted]);
        }
    }
    if sorted.is_empty() { Risk { aurc: f64::NAN, augrc: f64::NAN, curve } } else { Risk { aurc, augrc, curve } }
}

/// A bin of the calibration curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Lower edge of the stated probability.
    pub from: f64,
    /// Upper edge.
    pub to: f64,
    /// Mean stated probability.
    pub stated: f64,
    /// How often such answers were right.
    pub right: Rate,
}

/// Stated probability against how often it was right.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Mean distance between both, weighed by the number of answers.
    pub expected_error: f64,
    /// The bins that hold answers.
    pub bins: Vec<Bin>,
}

/// Calibration of `stated` in ten equal bins.
pub fn calibration(stated: &[Stated]) -> Calibration {
    let bin_of = |p: f64| ((p * BINS as f64) as usize).min(BINS - 1);
    let bins: Vec<Bin> = (0..BINS)
        .filter_map(|at| {
            let inside: Vec<&Stated> = stated.iter().filter(|(p, _)| bin_of(*p) == at).collect();
            let edge = |at: usize| at as f64 / BINS as f64;
            (!inside.is_empty()).then(|| Bin {
                from: edge(at),
                to: edge(at + 1),
                stated: inside.iter().map(|(p, _)| p).sum::<f64>() / inside.len() as f64,
                right: Rate::count(inside, |(_, is_right)| *is_right),
            })
        })
        .collect();
    let distance = |bin: &Bin| (bin.stated - bin.right.share).abs() * bin.right.of as f64;
    Calibration { expected_error: bins.iter().map(distance).sum::<f64>() / stated.len() as f64, bins }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn risks_by_hand() {
        // Accepted one after the other: right, wrong, right, wrong. Wrong among the accepted: 0, 1/2, 1/3, 2/4.
        let found = risk(&[(0.9, true), (0.6, true), (0.8, false), (0.2, false)]);
        assert!((found.aurc - (0.5 + 1.0 / 3.0 + 0.5) / 4.0).abs() < 1e-12);
        assert!((found.augrc - (1.0 + 1.0 + 2.0) / 16.0).abs() < 1e-12);
        assert_eq!(found.curve[1], [0.5, 0.5]);
    }

    #[test]
    fn ties_have_no_order() {
        let (a, b) = (risk(&[(0.5, true), (0.5, false)]), risk(&[(0.5, false), (0.5, true)]));
        assert_eq!(a, b);
        assert_eq!((a.aurc, a.augrc), (0.5, 0.375));
    }

    #[test]
    fn calibration_by_hand() {
        // Four at 0.95, three right: 0.20 off; two at 0.35, one right: 0.15 off.
        let stated = [(0.95, true), (0.95, true), (0.95, true), (0.95, false), (0.35, true), (0.35, false)];
        let found = calibration(&stated);
        assert!((found.expected_error - (4.0 * 0.2 + 2.0 * 0.15) / 6.0).abs() < 1e-12);
        assert_eq!(found.bins.iter().map(|bin| bin.right.of).collect::<Vec<_>>(), [2, 4]);
        // A certainty falls into the last bin.
        assert_eq!(calibration(&[(1.0, true)]).bins[0].from, 0.9);
        assert!(calibration(&[]).expected_error.is_nan());
    }
}
