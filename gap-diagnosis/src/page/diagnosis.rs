//! The page of `diagnose`: what the gap is, which effect makes it, where it lies, how far it shrinks, what to measure next.
//!
//! [`DiagnosisView`] is plain data that a diagnosis fills; nothing here judges.

use super::location::location;
use super::number::{count, short_percent, two_digits};
use super::response::responses;
use super::{Axis, BarItem, BarList, Chart, Ink, Kept, Page, Panel, ResponseView, Series, Share, escape, four_digits};
use crate::locate::{Where, strongest};

/// Ranked entries shown one by one; the others are summed.
const N_RANKED: usize = 10;
/// .. and none below this.
const LEAST_PROBABILITY: f64 = 0.001;
/// What the screening lets an entry take of the gap, in per cent, below which entries are counted and not listed.
const LEAST_SCREENED_PERCENT: f64 = 1.0;

/// Everything a diagnosis page shows.
#[derive(Debug, Clone, Default)]
pub struct DiagnosisView {
    /// Heading.
    pub title: String,
    /// Which plant, which logs.
    pub subtitle: String,
    /// The verdict in one sentence.
    pub verdict: String,
    /// What the reader must know first.
    pub warnings: Vec<String>,
    /// How large the gap is and how far it shrinks.
    pub gap: GapView,
    /// Further numbers that matter, label and value with unit: e.g. the predicted closed-loop error before and after.
    pub facts: Vec<(String, String)>,
    /// Every entry of the registry with `no_gap` and `unknown`, in any order.
    pub ranking: Vec<RankView>,
    /// Identifiers of the smallest set with 90 % of the probability.
    pub set90: Vec<String>,
    /// Entries that these logs can't tell apart.
    pub classes: Vec<ClassView>,
    /// The named effects, largest share first.
    pub effects: Vec<EffectView>,
    /// Shapley shares over the refit and each effect.
    pub shares: Vec<ShareView>,
    /// Nominal parameters that moved.
    pub changed: Vec<ChangedView>,
    /// The experiment to do next, or why none.
    pub next: NextView,
    /// Where the gap lies after the refit; none leaves the section out.
    pub location: Option<Where>,
    /// The same with the named effects in.
    pub location_after: Option<Where>,
    /// Logs with their predictions, held-out ones included.
    pub logs: Vec<DiagnosedLog>,
    /// Frequency responses.
    pub responses: Vec<ResponseView>,
    /// Entries that were fitted and rejected, the closest first.
    pub rivals: Vec<RivalView>,
    /// Entries that no explanation has, with the percentage of the gap after the refit that the screening lets them take, most first.
    pub screened: Vec<(String, f64)>,
    /// What no entry explains; none if nothing is left above the noise.
    pub unexplained: Option<UnexplainedView>,
    /// Command line, logs, plant, seed, version.
    pub provenance: Vec<String>,
}

/// The size of the gap, on the held-out log if there is one.
#[derive(Debug, Clone, Default)]
pub struct GapView {
    /// What these numbers are taken on: `held-out log` or `held-out stretches`.
    pub headline: String,
    /// Rms of measured minus predicted, nominal plant.
    pub nominal_rms_um: f64,
    /// .. nominal parameters refitted inside their sigma.
    pub refit_rms_um: f64,
    /// .. with the named effects.
    pub augmented_rms_um: f64,
    /// Rms of the noise.
    pub noise_rms_um: f64,
    /// 100 (1 - augmented / nominal).
    pub shrink_percent: f64,
    /// Its 95 % interval.
    pub shrink_percent_ci95: [f64; 2],
    /// The same above the noise, `100 (1 - excess after / excess before)`, excess = sqrt(rms^2 - noise^2).
    pub closure_percent: f64,
}

/// An entry of the registry and its probability.
#[derive(Debug, Clone)]
pub struct RankView {
    /// Identifier.
    pub effect: String,
    /// In words, e.g. where it acts; empty for none.
    pub note: String,
    /// 0 to 1.
    pub probability: f64,
}

/// Entries that these logs can't tell apart.
#[derive(Debug, Clone)]
pub struct ClassView {
    /// Identifiers.
    pub effects: Vec<String>,
    /// Why, in a sentence.
    pub reason: String,
}

/// A named effect.
#[derive(Debug, Clone)]
pub struct EffectView {
    /// Identifier.
    pub effect: String,
    /// In words.
    pub summary: String,
    /// Its equation, as text.
    pub equation: String,
    /// What in the logs revealed it.
    pub signature: String,
    /// Where its equation is from.
    pub source: String,
    /// Its parameters.
    pub parameters: Vec<EstimateView>,
}

/// An estimated number.
#[derive(Debug, Clone)]
pub struct EstimateView {
    /// In words.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Its standard deviation, in the same unit; NaN if the logs leave it open.
    pub sigma: f64,
    /// Unit, empty for a pure number.
    pub unit: String,
}

/// What explains how much of the gap.
#[derive(Debug, Clone)]
pub struct ShareView {
    /// Effect, or `parameter_error` for the refit.
    pub name: String,
    /// Of the squared excess explained.
    pub percent: f64,
}

/// A nominal parameter that moved by more than three sigma, or is named as wrong.
#[derive(Debug, Clone)]
pub struct ChangedView {
    /// In words.
    pub name: String,
    /// Unit, empty for a pure number.
    pub unit: String,
    /// Value in the nominal plant.
    pub nominal: f64,
    /// Value after the refit.
    pub refit: f64,
    /// Standard deviation in the same unit.
    pub sigma: f64,
}

/// The experiment to do next.
#[derive(Debug, Clone, Default)]
pub struct NextView {
    /// Its SPEC; none if no experiment within the rig's limits would help.
    pub spec: Option<String>,
    /// Sample rate.
    pub rate_hz: f64,
    /// Entries that it tells apart.
    pub splits: Vec<String>,
    /// Why this one, or why none.
    pub reason: String,
}

/// One log with its predictions. All columns have one length.
#[derive(Debug, Clone, Default)]
pub struct DiagnosedLog {
    /// File name or the like.
    pub name: String,
    /// Whether the fit never saw it.
    pub is_held_out: bool,
    /// Which of its rows are here.
    pub kept: Kept,
    /// Their times.
    pub time_s: Vec<f64>,
    /// Drive, or the command where the drive wasn't logged.
    pub drive_v: Vec<f64>,
    /// Logged displacement; NaN where it is not scored.
    pub measured_um: Vec<f64>,
    /// The nominal plant's displacement.
    pub nominal_um: Vec<f64>,
    /// .. of the refitted plant; empty to leave it out.
    pub refit_um: Vec<f64>,
    /// .. with the named effects.
    pub augmented_um: Vec<f64>,
    /// Rms of the log's noise.
    pub noise_um: f64,
    /// First of its rows here whose miss counts: the beginning of a log that no fit saw tells its start.
    pub scored_from: usize,
}

/// An entry that was fitted and rejected.
#[derive(Debug, Clone)]
pub struct RivalView {
    /// Identifier.
    pub effect: String,
    /// Rms after its best fit over that of the noise.
    pub rms_over_noise: f64,
    /// Sum of the squared shifts of the nominal parameters in sigma that the fit needed.
    pub prior_cost: f64,
    /// 0 to 1.
    pub probability: f64,
    /// Why it was rejected, in a sentence.
    pub reason: String,
}

/// What no entry explains.
#[derive(Debug, Clone, Default)]
pub struct UnexplainedView {
    /// Rms above the noise.
    pub rms_um: f64,
    /// Part of it that is structured rather than noise-like.
    pub structured_share_percent: f64,
    /// Largest autocorrelation at a lag > 0, in magnitude.
    pub max_abs_autocorrelation: f64,
    /// That lag.
    pub lag_s: f64,
    /// Where it lives, in a sentence.
    pub strongest: String,
}

/// Lays out a [`DiagnosisView`].
///
/// # Panics
/// If columns of a log or of a response differ in length.
pub fn diagnosis_page(view: &DiagnosisView) -> Page {
    let mut page = Page::new(&view.title);
    page.subtitle(&view.subtitle).headline(&view.verdict).provenance(&view.provenance);
    for warning in &view.warnings {
        page.warning(warning);
    }
    gap(&mut page, view);
    ranking(&mut page, view);
    effects(&mut page, view);
    rivals(&mut page, &view.rivals, &view.screened);
    next(&mut page, &view.next);
    if let Some(found) = &view.location {
        page.section("Where the gap lies");
        page.paragraph(&format!("The gap after the refit: {}.", strongest(found)));
        location(&mut page, found, view.location_after.as_ref());
    }
    logs(&mut page, &view.logs);
    responses(&mut page, &view.responses);
    if let Some(left) = &view.unexplained {
        unexplained(&mut page, left);
    }
    page
}

fn gap(page: &mut Page, view: &DiagnosisView) {
    let gap = &view.gap;
    let [low, high] = gap.shrink_percent_ci95.map(|percent| format!("{percent:.1}"));
    let mut facts = vec![
        ("rms gap, nominal plant".to_owned(), four_digits(gap.nominal_rms_um, "µm")),
        ("after the refit".to_owned(), four_digits(gap.refit_rms_um, "µm")),
        ("with the named effects".to_owned(), four_digits(gap.augmented_rms_um, "µm")),
        ("noise".to_owned(), four_digits(gap.noise_rms_um, "µm")),
        ("the gap shrinks by".to_owned(), format!("{:.1} % [{low}, {high}]", gap.shrink_percent).replace('-', "−")),
        ("closed above the noise".to_owned(), format!("{:.1} %", gap.closure_percent).replace('-', "−")),
    ];
    facts.extend_from_slice(&view.facts);
    page.facts(&facts);

    let square = |rms_um: f64| rms_um * rms_um;
    let [nominal, refit, left, noise] =
        [gap.nominal_rms_um, gap.refit_rms_um, gap.augmented_rms_um, gap.noise_rms_um].map(square);
    let taken = if gap.headline.is_empty() { String::new() } else { format!(" ({})", gap.headline) };
    let part = |label, value: f64, ink| Share { label, value: value.max(0.0), ink };
    page.bar(
        &format!("The gap as a bar: mean square of measured minus predicted{taken}. The intervals above are of 95 %."),
        "µm²",
        &[
            part("noise", noise.min(nominal), Ink::Measured),
            part("explained by a refit alone", nominal - refit, Ink::Extra),
            part("explained only with the named effects", refit - left, Ink::Model),
            part("unexplained", left - noise, Ink::Error),
        ],
    );
}

fn ranking(page: &mut Page, view: &DiagnosisView) {
    if view.ranking.is_empty() {
        return;
    }
    page.section("Which effect");
    let mut ranked = view.ranking.clone();
    ranked.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let is_shown = |place: usize, rank: &RankView| place < N_RANKED && rank.probability >= LEAST_PROBABILITY;
    let n_shown = ranked.iter().enumerate().take_while(|(place, rank)| is_shown(*place, rank)).count();
    let mut items: Vec<BarItem> = ranked[..n_shown]
        .iter()
        .map(|rank| BarItem {
            label: rank.effect.clone(),
            percent: 100.0 * rank.probability,
            behind_percent: None,
            note: rank.note.clone(),
        })
        .collect();
    if n_shown < ranked.len() {
        items.push(BarItem {
            label: format!("{} others", count(ranked.len() - n_shown)),
            percent: 100.0 * ranked[n_shown..].iter().map(|rank| rank.probability).sum::<f64>(),
            behind_percent: None,
            note: "together".to_owned(),
        });
    }
    let mut lists = vec![BarList {
        title: "Probability".to_owned(),
        caption: "Over the whole registry, with no gap and unknown among the answers.".to_owned(),
        ink: Ink::Model,
        full_percent: Some(100.0),
        items,
    }];
    if !view.shares.is_empty() {
        lists.push(BarList {
            title: "Shares".to_owned(),
            caption: "How much of what is explained goes to the refit and to each effect (Shapley values; they sum to 100 %).".to_owned(),
            ink: Ink::Model,
            full_percent: Some(100.0),
            items: view
                .shares
                .iter()
                .map(|share| BarItem {
                    label: share.name.clone(),
                    percent: share.percent,
                    behind_percent: None,
                    note: String::new(),
                })
                .collect(),
        });
    }
    page.bar_lists(&lists);
    if !view.set90.is_empty() {
        page.paragraph(&format!("90 % of the probability is held by {}.", and(&view.set90)));
    }
    for class in &view.classes {
        page.paragraph(&format!("These logs cannot tell {} apart: {}", and(&class.effects), class.reason));
    }
}

fn effects(page: &mut Page, view: &DiagnosisView) {
    for effect in &view.effects {
        page.section(&effect.effect);
        page.paragraph(&effect.summary);
        page.html(format!("<pre class=\"equation\">{}</pre>\n", escape(&effect.equation)));
        let rows: Vec<Vec<String>> = effect
            .parameters
            .iter()
            .map(|estimate| {
                vec![
                    estimate.name.clone(),
                    four_digits(estimate.value, &estimate.unit),
                    deviation(estimate.sigma, &estimate.unit),
                ]
            })
            .collect();
        if !rows.is_empty() {
            page.table("Its parameters, with one standard deviation", &["parameter", "value", "sigma"], &rows);
        }
        for (label, text) in [("What revealed it", &effect.signature), ("Source", &effect.source)] {
            if !text.is_empty() {
                page.paragraph(&format!("{label}: {text}"));
            }
        }
    }
    if !view.changed.is_empty() {
        page.section("Nominal parameters that moved");
        let rows: Vec<Vec<String>> = view.changed.iter().map(changed_row).collect();
        page.table(
            "By more than three sigma, or named as wrong; the others moved less (augmented.toml has them).",
            &["parameter", "nominal", "refit", "sigma", "change", "in sigma"],
            &rows,
        );
    }
}

fn changed_row(changed: &ChangedView) -> Vec<String> {
    let sigmas = (changed.refit - changed.nominal) / changed.sigma;
    let percent = 100.0 * (changed.refit / changed.nominal - 1.0);
    let signed = |value: f64, text: String| if value.is_finite() { text.replace('-', "−") } else { "–".to_owned() };
    vec![
        changed.name.clone(),
        four_digits(changed.nominal, &changed.unit),
        four_digits(changed.refit, &changed.unit),
        deviation(changed.sigma, &changed.unit),
        signed(percent, format!("{percent:+.2} %")),
        signed(sigmas, format!("{sigmas:+.1}")),
    ]
}

fn deviation(sigma: f64, unit: &str) -> String {
    if sigma.is_finite() { format!("± {}", two_digits(sigma, unit)) } else { "–".to_owned() }
}

fn next(page: &mut Page, next: &NextView) {
    if next.spec.is_none() && next.reason.is_empty() {
        return;
    }
    page.section("What to measure next");
    match &next.spec {
        Some(spec) => {
            page.html(format!("<pre class=\"equation\">{}</pre>\n", escape(spec)));
            let rate = if next.rate_hz > 0.0 {
                format!("At {} Hz. ", count(next.rate_hz.round() as usize))
            } else {
                String::new()
            };
            let splits = match next.splits.len() {
                0 | 1 => String::new(),
                _ => format!("It tells {} apart. ", and(&next.splits)),
            };
            page.paragraph(&format!("{rate}{splits}{}", next.reason));
        }
        None => {
            page.paragraph(&format!("No further experiment: {}", next.reason));
        }
    }
}

fn logs(page: &mut Page, logs: &[DiagnosedLog]) {
    if logs.is_empty() {
        return;
    }
    page.section("Before and after");
    let rms = |log: &DiagnosedLog, predicted_um: &[f64]| {
        let squares: Vec<f64> = log
            .measured_um
            .iter()
            .zip(predicted_um)
            .skip(log.scored_from)
            .map(|(measured, predicted)| (measured - predicted).powi(2))
            .filter(|square| square.is_finite())
            .collect();
        four_digits((squares.iter().sum::<f64>() / squares.len() as f64).sqrt(), "µm")
    };
    let rows: Vec<Vec<String>> = logs
        .iter()
        .map(|log| {
            vec![
                log.name.clone(),
                if log.is_held_out { "never fitted" } else { "fitted" }.to_owned(),
                count(log.kept.rows),
                rms(log, &log.nominal_um),
                rms(log, &log.refit_um),
                rms(log, &log.augmented_um),
                four_digits(log.noise_um, "µm"),
            ]
        })
        .collect();
    page.table(
        "Rms of measured minus predicted per log; of one never fitted behind the rows that tell its start",
        &["log", "use", "samples", "nominal", "refit", "with the effects", "noise"],
        &rows,
    );
    for (log_idx, log) in logs.iter().enumerate() {
        let held_out = if log.is_held_out { ", never fitted" } else { "" };
        page.html(format!("<h3 class=\"log\">{}{held_out}</h3>\n", escape(&log.name)));
        let difference = |predicted_um: &[f64]| -> Vec<f64> {
            log.measured_um.iter().zip(predicted_um).map(|(measured, predicted)| measured - predicted).collect()
        };
        let (before_um, refit_um, after_um) =
            (difference(&log.nominal_um), difference(&log.refit_um), difference(&log.augmented_um));
        let mut residuals = vec![Series { name: "nominal", ink: Ink::Error, values: &before_um }];
        if !refit_um.is_empty() {
            residuals.push(Series { name: "refit", ink: Ink::Extra, values: &refit_um });
        }
        residuals.push(Series { name: "with the effects", ink: Ink::Model, values: &after_um });
        let panels = [
            Panel {
                title: "Residual before and after",
                caption: "Measured minus predicted. What is left should be an even band of noise.",
                y: Axis::new("residual", "µm"),
                series: residuals,
            },
            Panel {
                title: "Measured and predicted",
                caption: "The broad line is the bench; zoom in where the others part from it.",
                y: Axis::new("displacement", "µm"),
                series: vec![
                    Series { name: "measured", ink: Ink::Measured, values: &log.measured_um },
                    Series { name: "nominal", ink: Ink::Error, values: &log.nominal_um },
                    Series { name: "with the effects", ink: Ink::Model, values: &log.augmented_um },
                ],
            },
            Panel {
                title: "Drive",
                caption: "",
                y: Axis::new("drive", "V"),
                series: vec![Series { name: "drive", ink: Ink::Drive, values: &log.drive_v }],
            },
        ];
        let charts = Chart::linked_over_time(&format!("log {log_idx}"), &log.time_s, &panels);
        page.charts(charts.into_iter().map(|chart| chart.of(log.kept)).collect());
    }
}

fn rivals(page: &mut Page, rivals: &[RivalView], screened: &[(String, f64)]) {
    if !rivals.is_empty() || !screened.is_empty() {
        page.section("Rivals rejected, and why");
    }
    if !rivals.is_empty() {
        let row = |rival: &RivalView| {
            vec![
                rival.effect.clone(),
                four_digits(rival.rms_over_noise, ""),
                four_digits(rival.prior_cost, ""),
                short_percent(100.0 * rival.probability),
                rival.reason.clone(),
            ]
        };
        page.table(
            "Each was fitted together with the nominal parameters. A true explanation reaches the noise (1) without bending the nominal parameters \
             far from where they are known to be (a cost of 5 to 20).",
            &["entry", "left over noise", "prior cost", "probability", "reason"],
            &rivals.iter().map(row).collect::<Vec<_>>(),
        );
    }
    if !screened.is_empty() {
        let shown = screened.iter().filter(|(_, percent)| *percent >= LEAST_SCREENED_PERCENT);
        let mut rows: Vec<Vec<String>> =
            shown.map(|(effect, percent)| vec![effect.clone(), short_percent(*percent)]).collect();
        if rows.len() < screened.len() {
            rows.push(vec![
                format!("{} others", screened.len() - rows.len()),
                format!("less than {LEAST_SCREENED_PERCENT} % each"),
            ]);
        }
        page.table(
            "Entries that no explanation has: the most that the screening lets each take of the mean square that the refit leaves, to first order. The \
             most promising are fitted, and fewer once a fit leaves nothing but noise.",
            &["entry", "at most"],
            &rows,
        );
    }
}

fn unexplained(page: &mut Page, left: &UnexplainedView) {
    page.section("What stays unexplained");
    page.facts(&[
        ("rms above the noise".to_owned(), four_digits(left.rms_um, "µm")),
        ("of it structured".to_owned(), short_percent(left.structured_share_percent)),
        ("largest autocorrelation".to_owned(), four_digits(left.max_abs_autocorrelation, "")),
        ("at a lag of".to_owned(), four_digits(1e3 * left.lag_s, "ms")),
    ]);
    if !left.strongest.is_empty() {
        page.paragraph(&format!("It lives here: {}.", left.strongest));
    }
}

/// `a`, `a and b`, `a, b and c`.
fn and(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}
