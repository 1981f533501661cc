//! What the headline figures must reach.

use super::Score;
use super::names::DETECTABLE;
use super::rate::Rate;
use serde::Serialize;

/// A figure against what it must reach.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bar {
    /// What it is.
    pub name: &'static str,
    /// What was found; NaN (null) where nothing was asked.
    pub value: f64,
    /// Its 95 % interval, where it is a share.
    pub interval: Option<[f64; 2]>,
    /// What it must reach, or not exceed.
    pub bar: f64,
    /// Whether more is better.
    pub is_more_better: bool,
    /// Whether it does.
    pub is_met: bool,
    /// Of how many cases.
    pub of: Option<usize>,
}

impl Bar {
    fn new(name: &'static str, value: f64, bar: f64, is_more_better: bool) -> Self {
        let is_met = if is_more_better { value >= bar } else { value <= bar };
        Self { name, value, interval: None, bar, is_more_better, is_met, of: None }
    }

    fn rate(name: &'static str, rate: &Rate, bar: f64, is_more_better: bool) -> Self {
        let interval = Some([rate.low, rate.high]);
        Self { interval, of: Some(rate.of), ..Self::new(name, rate.share, bar, is_more_better) }
    }
}

/// The bars that the project has set itself.
pub(super) fn bars(score: &Score) -> Vec<Bar> {
    let least_recall = score.names.recall.iter().map(|r| r.recall).min_by(|a, b| a.share.total_cmp(&b.share));
    let coverage = &score.sets.singles;
    vec![
        Bar::rate("right name (class rule)", &score.names.top1, 0.90, true),
        Bar::rate("right name among three", &score.names.top3, 0.98, true),
        Bar::rate("recall of the worst effect", &least_recall.unwrap_or(Rate::new(0, 0)), DETECTABLE, true),
        Bar::rate("false alarms", &score.false_alarms, 0.005, false),
        Bar::new("AUROC of unknowns", score.rejection.auroc, 0.95, true),
        Bar::rate("unknowns rejected at 5 % false rejection", &score.rejection.rejected_at_5_percent, 0.90, true),
        Bar::rate("confident wrong names", &score.confidently_wrong, 0.02, false),
        // This bar is on the lower bound itself.
        Bar {
            is_met: coverage.of > 0 && coverage.low >= 0.88,
            ..Bar::rate("coverage of the 90 % sets (by its lower bound)", coverage, 0.88, true)
        },
        Bar::new("mean size of the 90 % sets", score.sets.mean_size, 1.5, false),
        Bar::new("expected calibration error", score.calibration.expected_error, 0.05, false),
        Bar { of: Some(score.cases.pairs), ..Bar::new("F1 of pairs", score.pairs.f1, 0.85, true) },
        Bar {
            of: Some(score.closure.cases),
            ..Bar::new("median closure", score.closure.median_percent / 100.0, 0.90, true)
        },
    ]
}
