//! The page of a diagnosis: what [`Diagnosis`] and its evidence say, put into a [`DiagnosisView`], and the verdict in one sentence.

use super::answer::{Diagnosis, LogEvidence, Rival};
use super::gap::Three;
use super::plants::Benches;
use super::verdict::{Verdict, leading, probability};
use crate::locate::strongest;
use crate::page::{
    ChangedView, ClassView, DiagnosedLog, DiagnosisView, EffectView, EstimateView, GapView, Ink, NextView, Page,
    RankView, ResponseView, RivalView, ShareView, UnexplainedView, diagnosis_page, four_digits,
};
use crate::responses::{MOST_ROWS, Played, responses};
use plant_sim::effects::find;

/// A fit whose numbers shift by more than this, in squares of sigma, bends the plant.
const BENT: f64 = 40.0;
/// .. and one that leaves more than this doesn't explain.
const LEAVES: f64 = 0.1;
/// So many times what another leaves is more.
const MORE: f64 = 1.01;

impl Diagnosis {
    /// The verdict in one sentence.
    pub fn sentence(&self) -> String {
        let gap = &self.gap;
        let taken = if gap.headline == "held-out log" { "a log never shown" } else { "stretches that no fit has seen" };
        let shrink = format!(
            "the model's rms error on {taken} goes from {:.4} to {:.4} um, {} (noise {:.4} um)",
            gap.nominal_rms_um,
            gap.augmented_rms_um,
            less(gap.shrink_percent, gap.shrink_percent_ci95),
            gap.noise_rms_um
        );
        match self.verdict {
            Verdict::NoGap => {
                format!("There is no gap beyond what the plant's stated uncertainties allow: {shrink}.")
            }
            // What a refit takes for itself lies nowhere in what it leaves.
            Verdict::Unknown if self.location.total.share_percent == 0.0 && !self.changed.is_empty() => {
                let numbers: Vec<&str> = self.changed.iter().map(|changed| changed.name.as_str()).collect();
                format!(
                    "There is a gap, and no entry of the registry explains it; numbers that no plant has take it for themselves ({}): {shrink}.",
                    numbers.join(", ")
                )
            }
            Verdict::Unknown => format!(
                "There is a gap, and no entry of the registry explains it; after the refit it lies here: {}.",
                strongest(&self.location)
            ),
            Verdict::Explained => {
                let first = leading(&self.effects, |id| probability(&self.ranking, id));
                let named = with_stage(&self.effects, first.zip(self.stage), |id| self.title(id));
                let of_named: f64 = self.effects.iter().map(|id| probability(&self.ranking, id)).sum();
                let open = if self.classes.is_empty() {
                    String::new()
                } else {
                    let classes: Vec<String> = self.classes.iter().map(|class| class.members.join(" / ")).collect();
                    format!(", which these logs cannot tell apart: {}", classes.join("; "))
                };
                let unknown = probability(&self.ranking, "unknown");
                let or_none = if unknown > of_named {
                    format!(", or none that the registry has, {:.0} %", 100.0 * unknown)
                } else {
                    String::new()
                };
                format!("The gap is {named}, {:.0} %{open}{or_none}: {shrink}.", 100.0 * of_named)
            }
        }
    }

    fn title(&self, id: &str) -> String {
        match find(id) {
            Some(effect) => effect.about().title.to_owned(),
            None if self.changed.len() == 1 => format!("a wrong {}", self.changed[0].name),
            None => "a wrong nominal number".to_owned(),
        }
    }

    fn facts(&self) -> Vec<(String, String)> {
        let [low, high] = self.gap.predicted_shrink_percent_ci95;
        let shrink = format!("{:.1} % [{low:.1}, {high:.1}]", self.gap.predicted_shrink_percent).replace('-', "−");
        let mut facts = vec![
            ("shrink predicted from the fitted rows, if the forms hold".to_owned(), shrink),
            ("fit, nominal plant → refit → with the named effects".to_owned(), self.gap.fits(" → ").replace('-', "−")),
        ];
        facts.extend(self.closed_loop.as_ref().map(|of| {
            let [nominal, augmented] =
                [of.nominal_error_um, of.augmented_error_um].map(|error_um| four_digits(error_um, "µm"));
            (
                format!("{} tracking {}, nominal → diagnosed plant", of.controller, of.reference),
                format!("{nominal} → {augmented}"),
            )
        }));
        facts
    }

    /// The page. `subtitle` says which plant and which logs; `provenance` how to repeat it.
    pub fn page(&self, title: &str, subtitle: &str, provenance: &[String]) -> Page {
        diagnosis_page(&self.view(title, subtitle, provenance))
    }

    fn view(&self, title: &str, subtitle: &str, provenance: &[String]) -> DiagnosisView {
        let gap = &self.gap;
        DiagnosisView {
            title: title.to_owned(),
            subtitle: subtitle.to_owned(),
            verdict: self.sentence(),
            warnings: self
                .warnings
                .iter()
                .cloned()
                .chain(self.evidence.logs.iter().filter_map(shown_in_part))
                .collect(),
            gap: GapView {
                headline: gap.headline.to_owned(),
                nominal_rms_um: gap.nominal_rms_um,
                refit_rms_um: gap.refit_rms_um,
                augmented_rms_um: gap.augmented_rms_um,
                noise_rms_um: gap.noise_rms_um,
                shrink_percent: gap.shrink_percent,
                shrink_percent_ci95: gap.shrink_percent_ci95,
                closure_percent: gap.closure_percent,
            },
            facts: self.facts(),
            ranking: self
                .ranking
                .iter()
                .map(|ranked| RankView {
                    effect: ranked.effect.clone(),
                    note: note(&ranked.effect, &self.evidence.hidden),
                    probability: ranked.probability,
                })
                .collect(),
            set90: self.set90.clone(),
            classes: self
                .classes
                .iter()
                .map(|class| ClassView { effects: class.members.clone(), reason: class.reason.clone() })
                .collect(),
            effects: self.effects.iter().map(|id| self.effect(id)).collect(),
            shares: self
                .shares
                .iter()
                .map(|share| ShareView { name: share.effect.clone(), percent: share.percent })
                .collect(),
            changed: self
                .changed
                .iter()
                .zip(&self.evidence.changed)
                .map(|(changed, quantity)| {
                    let (name, unit) = quantity.words();
                    ChangedView {
                        name,
                        unit: unit.to_owned(),
                        nominal: changed.nominal,
                        refit: changed.refit,
                        sigma: changed.sigma,
                    }
                })
                .collect(),
            next: match &self.next_experiment {
                Some(next) => NextView {
                    spec: Some(next.spec.clone()),
                    rate_hz: next.rate_hz,
                    splits: next.splits.clone(),
                    reason: next.reason.clone(),
                },
                None => {
                    NextView { reason: self.no_experiment_reason.clone().unwrap_or_default(), ..NextView::default() }
                }
            },
            location: Some(self.location.clone()),
            location_after: self.evidence.location_after.clone(),
            logs: self.evidence.logs.iter().map(diagnosed).collect(),
            responses: self.evidence.responses.clone(),
            rivals: self.evidence.rivals.iter().map(|rival| self.rival(rival)).collect(),
            screened: self.evidence.screened.clone(),
            unexplained: (self.unexplained.rms_um > 0.0).then(|| UnexplainedView {
                rms_um: self.unexplained.rms_um,
                structured_share_percent: self.unexplained.structured_share_percent,
                max_abs_autocorrelation: self.unexplained.max_abs_autocorrelation,
                lag_s: self.unexplained.lag_s,
                strongest: self.unexplained.strongest.clone(),
            }),
            provenance: provenance.to_vec(),
        }
    }

    fn effect(&self, id: &str) -> EffectView {
        let parameters = self.parameters.iter().filter(|estimate| estimate.effect == id);
        let parameters = parameters.map(|estimate| EstimateView {
            name: estimate.name.clone(),
            value: estimate.value,
            sigma: estimate.sigma,
            unit: estimate.unit.clone(),
        });
        let (summary, equation, signature, source) = match find(id).map(|effect| effect.about()) {
            Some(about) => (about.what, about.equation, about.signature, about.source),
            None => (
                "One of the plant's numbers is not what its file says, by more than its stated uncertainty.",
                "p = p_nominal (1 + e)",
                "once this number is free, the others come back to where the file has them",
                "",
            ),
        };
        EffectView {
            effect: id.to_owned(),
            summary: summary.to_owned(),
            equation: equation.to_owned(),
            signature: signature.to_owned(),
            source: source.to_owned(),
            parameters: parameters.collect(),
        }
    }

    fn rival(&self, rival: &Rival) -> RivalView {
        let is_new = rival.effects.iter().any(|id| !self.effects.contains(id));
        let is_open = |id: &String, members: &[String]| members.contains(id) || self.effects.contains(id);
        let in_class =
            is_new && self.classes.iter().any(|class| rival.effects.iter().all(|id| is_open(id, &class.members)));
        let reason = if in_class {
            "Not rejected: these logs cannot tell it apart.".to_owned()
        } else if rival.left > LEAVES || self.evidence.named_left.is_none() && misses_a_part(rival) {
            leaves(rival)
        } else if rival.prior_cost > BENT {
            format!(
                "Needs the nominal numbers far from where they are known to be (chi-square {:.0}).",
                rival.prior_cost
            )
        } else {
            let left = format!("Leaves {:.1} % of the gap", 100.0 * rival.left);
            match self.evidence.named_left {
                None if self.verdict == Verdict::NoGap => {
                    "Nothing but noise is left for it to explain, and the numbers are ordinary without it.".to_owned()
                }
                None => format!("{left}, by numbers that are not believed."),
                Some(named) if rival.left > MORE * named => format!("{left}, more than the one named."),
                Some(_) if rival.effects.len() > self.effects.len() => {
                    "Explains no more, with one effect more.".to_owned()
                }
                Some(_) => format!(
                    "{left}, as the one named does, with more parameters or larger shifts of the nominal numbers (chi-square {:.0}).",
                    rival.prior_cost
                ),
            }
        };
        let effects = rival.effects.join(" + ");
        RivalView {
            effect: if rival.numbers.is_empty() {
                effects
            } else {
                format!("{effects} ({})", rival.numbers.join(", "))
            },
            rms_over_noise: rival.rms_over_noise,
            prior_cost: rival.prior_cost,
            probability: rival.probability,
            reason,
        }
    }
}

/// The titles of `effects`, and behind that of the most probable, which need not be the last, where it acts.
fn with_stage(effects: &[String], stage: Option<(&str, &str)>, title: impl Fn(&str) -> String) -> String {
    let of = |id: &String| match stage.filter(|(first, _)| *first == id.as_str()) {
        Some((_, stage)) => format!("{} ({stage})", title(id)),
        None => title(id),
    };
    effects.iter().map(of).collect::<Vec<String>>().join(" and ")
}

/// Whether a rival leaves much of what shows in one log or octave, though little of the whole gap.
fn misses_a_part(rival: &Rival) -> bool {
    rival.of_worst > rival.left.max(LEAVES)
}

/// What a rival leaves, in words.
fn leaves(rival: &Rival) -> String {
    let left = format!("Leaves {:.0} % of the gap", 100.0 * rival.left);
    if misses_a_part(rival) {
        format!("{left}, and {:.0} % of what shows in one log or octave.", 100.0 * rival.of_worst)
    } else {
        format!("{left}.")
    }
}

fn diagnosed(log: &LogEvidence) -> DiagnosedLog {
    let um = |values: &[f64]| values.iter().map(|m| 1e6 * m).collect::<Vec<f64>>();
    let mut measured_um = um(&log.measured_m);
    measured_um[..log.run_in].fill(f64::NAN);
    DiagnosedLog {
        name: log.name.clone(),
        is_held_out: log.is_held_out,
        kept: log.kept,
        time_s: (0..log.measured_m.len()).map(|k| log.from_s + k as f64 * log.dt_s).collect(),
        drive_v: log.drive_v.clone(),
        measured_um,
        nominal_um: um(&log.nominal_m),
        refit_um: um(&log.refit_m),
        augmented_um: um(&log.augmented_m),
        noise_um: 1e6 * log.noise_m,
        scored_from: log.scored_from,
    }
}

/// What the page says of a log that it doesn't show whole.
fn shown_in_part(log: &LogEvidence) -> Option<String> {
    let part = format!("{} is long: its plots and the rms beside them are of one row in {}", log.name, log.kept.stride);
    let without = if log.kept.rows > MOST_ROWS { ", and no frequency response is taken of it" } else { "" };
    (log.kept.stride > 1).then(|| format!("{part}{without}"))
}

/// Frequency responses of logs and of what the plants make of them. Every row counts: of some of them what is fast would fold onto what is slow.
pub(super) fn responses_of(benches: &Benches<'_>, three: &Three) -> Vec<ResponseView> {
    let logs = benches.records().zip(three.nominal.iter().zip(&three.augmented));
    let short = logs.filter(|(record, _)| record.log.len() <= MOST_ROWS);
    let played: Vec<Played<'_>> = short
        .map(|(record, (nominal, augmented))| {
            let log = record.log;
            Played {
                name: &log.name,
                dt_s: log.dt_s,
                period_samples: log.meta.period_samples,
                reference_m: log.reference_m.as_deref(),
                drive_v: log.drive_v.as_ref().unwrap_or(&log.command_v),
                measured_m: &log.displacement_m,
                models: vec![("nominal", Ink::Error, nominal), ("with the effects", Ink::Model, augmented)],
            }
        })
        .collect();
    responses(&played)
}

/// By how much an error shrank, with its interval, or by how much it grew.
fn less(shrink_percent: f64, [low, high]: [f64; 2]) -> String {
    if shrink_percent < 0.0 {
        format!("{:.1} % more [{:.1}, {:.1}]", -shrink_percent, -high, -low)
    } else {
        format!("{shrink_percent:.1} % less [{low:.1}, {high:.1}]")
    }
}

/// What stands beside an entry's probability: its stage, and whether it is `hidden` by what the plant states.
fn note(id: &str, hidden: &[&str]) -> String {
    let stage = find(id).map(|effect| effect.stage().name());
    let hides = hidden.contains(&id).then_some("within what the plant states no fitted log shows it");
    [stage, hides].into_iter().flatten().collect::<Vec<&str>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::Kept;

    #[test]
    fn an_error_that_grows_is_no_shrink() {
        assert_eq!(less(97.64, [97.0, 97.8]), "97.6 % less [97.0, 97.8]");
        assert_eq!(less(-4.4, [-7.2, 0.8]), "4.4 % more [-0.8, 7.2]");
    }

    #[test]
    fn the_stage_stands_behind_the_effect_that_it_is_of() {
        let effects = ["periodic_force", "creep"].map(str::to_owned);
        let of = |stage| with_stage(&effects, stage, str::to_owned);
        assert_eq!(of(Some(("periodic_force", "environment"))), "periodic_force (environment) and creep");
        assert_eq!(of(Some(("creep", "structure"))), "periodic_force and creep (structure)");
        assert_eq!(of(None), "periodic_force and creep");
    }

    #[test]
    fn what_hides_is_told_with_a_stage_where_it_has_one() {
        let of = |id| note(id, &["sensor_offset", "parameter_error"]);
        assert_eq!(of("sensor_offset"), "sensor; within what the plant states no fitted log shows it");
        assert_eq!(of("parameter_error"), "within what the plant states no fitted log shows it");
        assert_eq!([of("creep"), of("unknown")], ["actuator", ""]);
    }

    #[test]
    fn a_long_log_is_said_to_be_shown_in_part() {
        let of = |rows, stride| shown_in_part(&LogEvidence { kept: Kept { rows, stride }, ..LogEvidence::default() });
        assert_eq!(of(400_000, 1), None);
        assert!(of(1_200_000, 3).is_some_and(|said| said.ends_with("one row in 3")));
        assert!(of(MOST_ROWS + 1, 11).is_some_and(|said| said.ends_with("no frequency response is taken of it")));
    }

    #[test]
    fn a_rival_that_misses_a_part_of_the_gap_is_said_to() {
        let rival = |left, of_worst| Rival {
            numbers: Vec::new(),
            effects: vec!["thermal_gain".to_owned()],
            rms_over_noise: 1.4,
            prior_cost: 9.0,
            probability: 0.3,
            left,
            of_worst,
        };
        assert_eq!(leaves(&rival(0.13, 0.92)), "Leaves 13 % of the gap, and 92 % of what shows in one log or octave.");
        assert_eq!(leaves(&rival(0.65, 0.6)), "Leaves 65 % of the gap.");
        assert!(misses_a_part(&rival(0.03, 0.5)) && !misses_a_part(&rival(0.03, 0.05)));
    }
}
