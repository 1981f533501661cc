//! The report of a blind check: the headline figures against their bars, then what lies behind each.

use super::bars::Bar;
use super::rate::Rate;
use super::{Active, Failure, LeftOut, Outside, Score};
use crate::page::{Axis, BarItem, BarList, Chart, Ink, Loop, Matrix, Page, four_digits};

/// Failures that are listed.
const LISTED: usize = 40;

/// What the report shows.
#[derive(Clone, Copy)]
pub struct PageView<'a> {
    /// Title.
    pub title: &'a str,
    /// Which cases.
    pub subtitle: &'a str,
    /// The figures.
    pub score: &'a Score,
    /// Where a case's own report lies, relative to this page; empty where it was not kept.
    pub report: &'a dyn Fn(&str) -> String,
    /// Other numbers worth a card: duration, cores.
    pub facts: &'a [(String, String)],
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// How it came about.
    pub provenance: &'a [String],
}

/// The report.
pub fn score_page(view: &PageView<'_>) -> Page {
    let score = view.score;
    let mut page = Page::new(view.title);
    page.subtitle(view.subtitle).headline(&headline(score));
    for warning in view.warnings {
        page.warning(warning);
    }
    page.facts(&facts(view));
    page.table(
        "Headline figures, each share with its 95 % interval by Wilson.",
        &["figure", "found", "95 % interval", "bar", "cases", "met"],
        &score.bars.iter().map(bar_row).collect::<Vec<_>>(),
    );
    if score.names.top1.of > 0 || score.cases.foreign > 0 {
        page.section("What was named");
        page.matrix(&matrix(score));
        let by_ratio = knows_gaps(score).then(|| by_ratio(score));
        page.bar_lists(&std::iter::once(recall(score)).chain(by_ratio).collect::<Vec<_>>());
        singles(&mut page, score);
        sizes(&mut page, score);
    }
    page.section("Whether the probabilities can be relied upon");
    page.charts(vec![calibration(score), risk(score)]);
    if !score.rejection.oscr.is_empty() {
        page.chart(oscr(score));
    }
    page.table("Unknowns, sets and pairs.", &["figure", "found", "95 % interval", "cases"], &rest(score));
    numbers(&mut page, view);
    if let Some(left_out) = &score.left_out {
        show_left_out(&mut page, left_out);
    }
    if let Some(active) = &score.active {
        show_active(&mut page, active);
    }
    failures(&mut page, view);
    page.provenance(view.provenance);
    page
}

fn headline(score: &Score) -> String {
    let asked: Vec<&Bar> = score.bars.iter().filter(|bar| bar.value.is_finite()).collect();
    let met = asked.iter().filter(|bar| bar.is_met).count();
    let top1 = &score.names.top1;
    let named = if top1.of > 0 {
        format!("The withheld effect is named in {} of {} cases ({}). ", top1.hits, top1.of, percent(top1.share))
    } else {
        String::new()
    };
    format!("{named}{met} of {} bars are met.", asked.len())
}

fn facts(view: &PageView<'_>) -> Vec<(String, String)> {
    let cases = &view.score.cases;
    let counts = [
        ("one effect", cases.singles),
        ("none", cases.nulls),
        ("two effects", cases.pairs),
        ("outside the registry", cases.foreign),
        ("without an answer", cases.defects),
    ];
    let counts = counts.into_iter().map(|(label, count)| (label.to_owned(), count.to_string()));
    counts.chain(view.facts.iter().cloned()).collect()
}

fn bar_row(bar: &Bar) -> Vec<String> {
    // Shares and areas in per cent; the size of a set is a count.
    let is_share = bar.name != "mean size of the 90 % sets";
    let write = |value: f64| if is_share { percent(value) } else { four_digits(value, "") };
    let sign = if bar.is_more_better { "≥" } else { "≤" };
    let is_asked = bar.value.is_finite();
    vec![
        bar.name.to_owned(),
        write(bar.value),
        bar.interval
            .filter(|_| is_asked)
            .map_or("–".to_owned(), |[low, high]| format!("{} to {}", write(low), write(high))),
        format!("{sign} {}", if is_share { format!("{} %", 100.0 * bar.bar) } else { bar.bar.to_string() }),
        bar.of.map_or("–".to_owned(), |of| of.to_string()),
        if !is_asked {
            "not asked"
        } else if bar.is_met {
            "yes"
        } else {
            "no"
        }
        .to_owned(),
    ]
}

fn matrix(score: &Score) -> Matrix {
    let confusion = &score.confusion;
    let rename = |name: &String| match name.as_str() {
        // The diagonal goes on: no gap is the right answer to a null, unknown to what is foreign.
        "null" => "no_gap".to_owned(),
        "foreign" => "unknown".to_owned(),
        _ => name.clone(),
    };
    Matrix {
        title: "Truth (rows) against answer (columns)".to_owned(),
        caption: "Cases with one effect, none, or one outside the registry. Right answers are blue; the darker, the larger the \
                  share of the row. What one class holds counts as right elsewhere, but not here."
            .to_owned(),
        rows: confusion.truths.iter().map(rename).collect(),
        columns: confusion.answers.clone(),
        counts: confusion.counts.clone(),
    }
}

/// Whether it is known of any case how large its gap is, which it is not on a real bench.
fn knows_gaps(score: &Score) -> bool {
    !score.names.by_ratio.is_empty()
}

fn recall(score: &Score) -> BarList {
    let is_known = knows_gaps(score);
    let item = |recall: &super::Recall| {
        let from = match recall.detectable_from {
            Some(from) => format!(", from {from}×"),
            None if is_known => ", never".to_owned(),
            None => String::new(),
        };
        item(&recall.effect, &recall.recall, &from)
    };
    let mut items: Vec<BarItem> = score.names.recall.iter().map(item).collect();
    items.sort_by(|a, b| a.percent.total_cmp(&b.percent));
    BarList {
        title: "Recall of each effect".to_owned(),
        caption: format!(
            "How often it was named, by the class rule; the pale bar ends at the upper end of the 95 % interval. Remark: \
             cases, lower end of the interval{}.",
            if is_known { ", gap over noise from which on three of four are found" } else { "" }
        ),
        ink: Ink::Model,
        full_percent: Some(100.0),
        items,
    }
}

fn by_ratio(score: &Score) -> BarList {
    let items = score.names.by_ratio.iter().map(|bin| item(&ratio_label(bin), &bin.right, ""));
    BarList {
        title: "Right names by gap over noise".to_owned(),
        caption: "The gap is that of the bench with its effect against itself without, before any refit.".to_owned(),
        ink: Ink::Model,
        full_percent: Some(100.0),
        items: items.collect(),
    }
}

fn item(label: &str, rate: &Rate, more: &str) -> BarItem {
    BarItem {
        label: label.to_owned(),
        percent: 100.0 * rate.share,
        behind_percent: Some(100.0 * rate.high),
        note: format!("{}/{}, ≥ {:.0} %{more}", rate.hits, rate.of, 100.0 * rate.low),
    }
}

fn singles(page: &mut Page, score: &Score) {
    let names = &score.names;
    let mut rows = vec![
        ("right name by the class rule", names.top1),
        ("right name, the truth itself", names.strict_top1),
        ("right among three", names.top3),
        ("right stage", names.strict_stage),
        ("right stage, or right name", names.stage),
        ("right name, where the refit leaves 3 times the noise", names.shown_top1),
        ("right stage there, or right name", names.shown_stage),
        ("more effects named than there are", names.superfluous),
    ];
    if names.shown_top1.of == 0 {
        // None shows that much, or nobody knows the noise.
        rows.drain(5..7);
    }
    page.table(
        "Cases with one effect.",
        &["figure", "found", "95 % interval", "cases"],
        &rows.iter().map(|(name, rate)| rate_row(name, rate)).collect::<Vec<_>>(),
    );
}

/// Effect by effect and size by size, where sizes are known.
fn sizes(page: &mut Page, score: &Score) {
    if !knows_gaps(score) {
        return;
    }
    let edges: Vec<String> = score.names.by_ratio.iter().map(ratio_label).collect();
    let row = |recall: &super::Recall| {
        let of_bin = |bin: &super::RatioBin| {
            let mine = recall.by_ratio.iter().find(|mine| mine.from == bin.from);
            mine.map_or("–".to_owned(), |mine| format!("{}/{}", mine.right.hits, mine.right.of))
        };
        std::iter::once(recall.effect.clone()).chain(score.names.by_ratio.iter().map(of_bin)).collect::<Vec<_>>()
    };
    page.table(
        "Right names of each effect by gap over noise, of so many cases.",
        &std::iter::once("effect").chain(edges.iter().map(String::as_str)).collect::<Vec<_>>(),
        &score.names.recall.iter().map(row).collect::<Vec<_>>(),
    );
}

fn ratio_label(bin: &super::RatioBin) -> String {
    if bin.to.is_finite() { format!("{} to {}", bin.from, bin.to) } else { format!("{} and more", bin.from) }
}

fn calibration(score: &Score) -> Chart {
    let bins = &score.calibration.bins;
    let stated: Vec<f64> = bins.iter().map(|bin| 100.0 * bin.stated).collect();
    let ends = |end: fn(&Rate) -> f64| bins.iter().map(|bin| 100.0 * end(&bin.right)).collect::<Vec<f64>>();
    let (right, low, high) = (ends(|r| r.share), ends(|r| r.low), ends(|r| r.high));
    let run = |name, ink, y| Loop { name, ink, x: &stated, y };
    Chart::loops(
        "Calibration",
        &format!(
            "Answers in ten bins of their probability. On the straight line they are as often right as they say; mean distance {}.",
            percent(score.calibration.expected_error)
        ),
        Axis::new("stated probability", "%"),
        Axis::new("right", "%"),
        &[
            Loop { name: "as stated", ink: Ink::Reference, x: &[0.0, 100.0], y: &[0.0, 100.0] },
            run("95 % from", Ink::Measured, &low),
            run("95 % to", Ink::Measured, &high),
            run("right", Ink::Model, &right),
        ],
    )
}

fn risk(score: &Score) -> Chart {
    let column = |at: usize| score.risk.curve.iter().map(|point| 100.0 * point[at]).collect::<Vec<f64>>();
    let (x, y) = (column(0), column(1));
    Chart::loops(
        "Risk against coverage",
        &format!(
            "Answers accepted from the surest on: the share of wrong ones among them. AURC {}, AUGRC {}.",
            four_digits(score.risk.aurc, ""),
            four_digits(score.risk.augrc, "")
        ),
        Axis::new("accepted", "%"),
        Axis::new("wrong among the accepted", "%"),
        &[Loop { name: "wrong", ink: Ink::Error, x: &x, y: &y }],
    )
}

fn oscr(score: &Score) -> Chart {
    let column = |at: usize| score.rejection.oscr.iter().map(|point| 100.0 * point[at]).collect::<Vec<f64>>();
    let (x, y) = (column(0), column(1));
    Chart::loops(
        "Known against unknown",
        &format!(
            "For each threshold on the probability of unknown: foreign cases let through, known ones let through and rightly named. \
             Area (OpenAUC) {}; AUROC without the names {}.",
            percent(score.rejection.open_auc),
            percent(score.rejection.auroc)
        ),
        Axis::new("foreign let through", "%"),
        Axis::new("known and right", "%"),
        &[Loop { name: "known and right", ink: Ink::Model, x: &x, y: &y }],
    )
}

fn rest(score: &Score) -> Vec<Vec<String>> {
    let (rejection, sets, pairs) = (&score.rejection, &score.sets, &score.pairs);
    let mut rows: Vec<Vec<String>> = [
        ("known rejected at the threshold of 5 %", rejection.falsely_rejected),
        ("foreign rejected there", rejection.rejected_at_5_percent),
        ("foreign answered unknown", score.said_unknown),
        ("nulls given a name", score.falsely_named),
        ("set holds the effect", sets.singles),
        ("set holds no_gap (nulls)", sets.nulls),
        ("set holds unknown (foreign)", sets.foreign),
        ("set holds both (pairs)", sets.pairs),
        ("pairs: named ones that are true", pairs.precision),
        ("pairs: true ones that are named", pairs.recall),
        ("pairs: both, whatever else", pairs.both),
        ("pairs: both and nothing else", pairs.exact),
        ("predicted shrink within 5 points of the realised one", score.closure.within_5_points),
        ("realised shrink inside the predicted one's 95 %", score.closure.inside_ci95),
        ("true number inside its 95 %, in forms of the registry", score.numbers.inside_ci95),
    ]
    .iter()
    .map(|(name, rate)| rate_row(name, rate))
    .collect();
    let miss = four_digits(score.closure.median_miss_percent, "points");
    rows.push(vec![
        "predicted against realised shrink, median".into(),
        miss,
        "–".into(),
        score.closure.predicted.to_string(),
    ]);
    rows
}

fn rate_row(name: &str, rate: &Rate) -> Vec<String> {
    let interval = format!("{} to {}", percent(rate.low), percent(rate.high));
    let interval = if rate.of > 0 { interval } else { "–".to_owned() };
    vec![name.to_owned(), percent(rate.share), interval, rate.of.to_string()]
}

fn numbers(page: &mut Page, view: &PageView<'_>) {
    let listed = view.score.numbers.listed();
    if listed.is_empty() {
        return;
    }
    page.linked_table(
        "Numbers of named effects farthest outside their 95 % interval, where the true form is one of the registry's; a case leads to its own report.",
        &["case", "effect", "number", "true", "found", "sigma", "off by"],
        &listed.iter().map(number_row).collect::<Vec<_>>(),
        &listed.iter().map(|number| (view.report)(&number.id)).collect::<Vec<_>>(),
    );
}

fn number_row(number: &Outside) -> Vec<String> {
    let [truth, found, sigma] = [number.truth, number.found, number.sigma].map(|value| format!("{value:.5e}"));
    let off = format!("{:.1} sigma", number.deviation());
    vec![number.id.clone(), number.effect.clone(), number.name.clone(), truth, found, sigma, off]
}

fn show_left_out(page: &mut Page, left_out: &LeftOut) {
    page.section("With the true entry struck out");
    let made = format!("{} of {} cases with one effect were diagnosed so.", left_out.made, left_out.of);
    let old = match left_out.without_best_fit {
        0 => String::new(),
        count => format!(
            " {count} answers state no best fit (nothing was fitted, or an older version answered): there what the plant that is answered \
             with leaves counts, which after unknown is what the refit leaves."
        ),
    };
    page.paragraph(&format!("{made}{old}"));
    let rows = [
        ("said unknown; no answer is a miss", left_out.said_unknown),
        ("confidently wrong, of those answered", left_out.confidently_wrong),
    ];
    let mut rows = rows.map(|(name, rate)| rate_row(name, &rate)).to_vec();
    rows.push(vec!["no answer".into(), left_out.defects.to_string(), "–".into(), left_out.made.to_string()]);
    page.table(
        "Cases in which the fit of the remaining entries that leaves least leaves more than 1.5 times the noise.",
        &["figure", "found", "95 % interval", "cases"],
        &rows,
    );
    let absorbed: Vec<Vec<String>> =
        left_out.absorbed.iter().map(|(truth, by, count)| vec![truth.clone(), by.clone(), count.to_string()]).collect();
    if !absorbed.is_empty() {
        page.table("Absorbed: another entry takes the gap.", &["effect", "absorbed by", "cases"], &absorbed);
    }
}

fn show_active(page: &mut Page, active: &Active) {
    page.section("With the proposed experiment made");
    page.paragraph(&format!(
        "In {} cases whose set had several members the proposed experiment was made on the true bench and its log given to a second \
         diagnosis. The set shrank from {} to {} members on average; {} of {} were rightly named before and {} after. For {} more no \
         command was proposed, {} failed, and {} are still to be made.",
        active.made,
        four_digits(active.mean_size[0], ""),
        four_digits(active.mean_size[1], ""),
        active.right[0].hits,
        active.made,
        active.right[1].hits,
        active.no_command,
        active.failed,
        active.open,
    ));
}

fn failures(page: &mut Page, view: &PageView<'_>) {
    let score = view.score;
    page.section("What went wrong, and why");
    if score.failures.is_empty() {
        page.paragraph("Nothing.");
        return;
    }
    let total = score.failures.len() as f64;
    let cause = |(cause, count): &(super::Cause, usize)| BarItem {
        label: cause.words().to_owned(),
        percent: 100.0 * *count as f64 / total,
        behind_percent: None,
        note: format!("{count} of {total}"),
    };
    page.bar_lists(&[BarList {
        title: "Causes".to_owned(),
        caption: "Of all failures; the first cause that applies.".to_owned(),
        ink: Ink::Error,
        full_percent: Some(100.0),
        items: score.causes.iter().map(cause).collect(),
    }]);
    let listed = &score.failures[..score.failures.len().min(LISTED)];
    let links: Vec<String> = listed.iter().map(|failure| (view.report)(&failure.id)).collect();
    page.linked_table(
        &format!(
            "The {} most confident of {} failures; a case leads to its own report.",
            listed.len(),
            score.failures.len()
        ),
        &["case", "truth", "answer", "sure", "gap/noise", "after refit", "cause", "form"],
        &listed.iter().map(failure_row).collect::<Vec<_>>(),
        &links,
    );
}

fn failure_row(failure: &Failure) -> Vec<String> {
    let ratio = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.1}"));
    vec![
        failure.id.clone(),
        failure.truth.clone(),
        failure.answer.clone(),
        percent(failure.confidence),
        ratio(failure.gap_over_noise),
        ratio(failure.refit_over_noise),
        failure.cause.words().to_owned(),
        failure.said.clone().unwrap_or_else(|| failure.form.clone()),
    ]
}

fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.1} %", 100.0 * share) } else { "–".to_owned() }
}
