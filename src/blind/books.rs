//! Opens the seal when every answer is written, scores, and writes what was found: `score.json`, `report.html`, the book of
//! openings.

use super::again::{score_active, score_left_out};
use super::plan::{Label, Order};
use super::runner::{REPORT, answer, program_of, ran};
use super::store::{self, Store, read, read_if_there, read_json, sha256, write};
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::page::four_digits;
use gap_diagnosis::score::{Case, PageView, Rate, Score, Truth, score, score_page};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Failures whose own reports are kept.
const REPORTS_KEPT: usize = 40;
/// Where openings of the report split are written down.
const OPENINGS: &str = "blind/openings.csv";
const OPENINGS_HEADER: &str = "commit,version,seed,split,size,scale,cases,top1,top3,false_alarms,auroc,\
                               rejected_at_5_percent,confidently_wrong,labels_sha256,answers_sha256\n";

/// Says what the labels are sealed by, before any answer, and holds a directory to what it was sealed for.
///
/// # Errors
/// If something else is there already.
pub fn seal(store: &Store, labels: &str, count: usize) -> Result<String, Failure> {
    let hash = sha256(labels.as_bytes());
    store.settle("sealed/labels.json", labels)?;
    store.settle("seal.txt", &format!("{hash}  sealed/labels.json\n"))?;
    output::line(&format!("sealed {count} labels, sha256 {hash}"));
    Ok(hash)
}

/// The sealed text, if it is what was sealed.
///
/// # Errors
/// If it was changed.
pub fn unseal(store: &Store) -> Result<String, Failure> {
    let (text, seal) = (read(&store.path("sealed/labels.json"))?, read(&store.path("seal.txt"))?);
    if seal.split_whitespace().next() != Some(&sha256(text.as_bytes())) {
        let path = store.path("sealed/labels.json");
        return Err(Failure::file(format!(
            "{}: is not what was sealed (seal.txt): run again from the seed",
            path.display()
        )));
    }
    Ok(text)
}

/// The cases of a run with what is so and what was answered.
///
/// # Errors
/// If a truth can't be read.
pub fn cases(store: &Store, ids: &[&str]) -> Result<Vec<Case>, Failure> {
    let case = |id: &&str| -> Result<Case, Failure> {
        let truth: Truth = read_json(&store.truth(id))?;
        Ok(Case { id: (*id).to_owned(), truth, answer: answer(&store.case(id)) })
    };
    ids.iter().map(case).collect()
}

/// The score of a made run.
///
/// # Errors
/// As [`cases`].
pub fn score_made(store: &Store, labels: &[Label]) -> Result<Score, Failure> {
    let ids: Vec<&str> = labels.iter().map(|label| label.id.as_str()).collect();
    let cases = cases(store, &ids)?;
    let truths: Vec<Truth> = cases.iter().map(|case| case.truth.clone()).collect();
    let left_out = score_left_out(store, labels, &truths);
    let active = score_active(store, &cases);
    Ok(score(&cases, left_out, active))
}

/// Sha256 over the answers' own, in the order of the list.
pub fn answers_sha256(store: &Store, ids: &[&str]) -> String {
    let each = ids.iter().map(|id| ran(&store.case(id)).and_then(|ran| ran.diagnosis_sha256).unwrap_or_default());
    sha256(each.collect::<Vec<_>>().join("\n").as_bytes())
}

/// The text of `score.json`.
///
/// # Errors
/// If there is none.
pub fn score_text(score: &Score, provenance: &Value) -> Result<String, Failure> {
    let mut all = json!({ "schema": "hysteron-blind-score-1", "provenance": provenance });
    let figures = serde_json::to_value(score).map_err(|e| Failure::call(format!("no JSON: {e}")))?;
    if let (Value::Object(all), Value::Object(figures)) = (&mut all, figures) {
        all.extend(figures);
    }
    store::json(&all)
}

/// Where a score comes from.
///
/// # Errors
/// If it can't be read which program gave the answers.
pub fn provenance(
    store: &Store,
    order: &Order,
    labels_sha256: &str,
    ids: &[&str],
    commit: &str,
) -> Result<Value, Failure> {
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"), "commit": commit, "order": order,
        "labels_sha256": labels_sha256, "answers_sha256": answers_sha256(store, ids), "program_sha256": program_of(store)?,
    }))
}

/// Where the book of openings lies: as asked, or in the repository's folder if that is here.
pub fn openings(asked: Option<&Path>) -> Option<PathBuf> {
    let own = Path::new(OPENINGS);
    asked.map(Path::to_owned).or_else(|| own.parent().filter(|folder| folder.is_dir()).map(|_| own.to_owned()))
}

/// Refuses a second draw of the report split with one version: it is opened at most once per release, and the same opening may be repeated.
///
/// # Errors
/// If the book at `path` has this version with another order.
pub fn refuse_second_opening(path: &Path, order: &Order) -> Result<(), Failure> {
    let version = env!("CARGO_PKG_VERSION");
    let book = read_if_there(path)?.unwrap_or_default();
    let own = drawn(order);
    let is_other = |line: &&str| {
        let cells: Vec<&str> = line.split(',').collect();
        cells.get(1) == Some(&version) && cells.get(2..6).is_some_and(|cells| cells != own.as_slice())
    };
    let Some(line) = book.lines().find(is_other) else { return Ok(()) };
    let seed = line.split(',').nth(2).unwrap_or_default();
    Err(Failure::call(format!(
        "--split report: version {version} was opened with seed {seed} ({}), and the split is opened once per release: raise the version, or take --split calibrate",
        path.display()
    )))
}

/// Seed, split, size and scale of an order, as a book has them.
fn drawn(order: &Order) -> [String; 4] {
    let scale = if order.quick { "quick".to_owned() } else { order.scale.to_string() };
    [order.seed.to_string(), order.split.clone(), order.size.clone(), scale]
}

/// Writes an opening of the report split into its book, good or bad; the same opening only once.
///
/// # Errors
/// If the book can't be written: then nothing is shown either.
pub fn book(path: &Path, order: &Order, score: &Score, provenance: &Value) -> Result<(), Failure> {
    let share = |rate: &Rate| format!("{:.4}", rate.share);
    let text = |key: &str| provenance[key].as_str().unwrap_or("unknown").replace([',', '\n'], " ");
    let cases = &score.cases;
    let [seed, split, size, scale] = drawn(order);
    let line = [
        text("commit"),
        text("version"),
        seed,
        split,
        size,
        scale,
        (cases.singles + cases.nulls + cases.pairs + cases.foreign).to_string(),
        share(&score.names.top1),
        share(&score.names.top3),
        share(&score.false_alarms),
        format!("{:.4}", score.rejection.auroc),
        share(&score.rejection.rejected_at_5_percent),
        share(&score.confidently_wrong),
        text("labels_sha256"),
        text("answers_sha256"),
    ];
    let line = line.join(",") + "\n";
    let before = read_if_there(path)?.unwrap_or_default();
    if before.contains(&line) {
        return Ok(());
    }
    let before = if before.is_empty() { OPENINGS_HEADER.to_owned() } else { before };
    write(path, (before + &line).as_bytes())
}

/// What is written beside a score.
pub struct Shown<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// Line under it.
    pub subtitle: String,
    /// The figures.
    pub score: &'a Score,
    /// Where they come from.
    pub provenance: &'a Value,
    /// Identifiers of all cases.
    pub ids: &'a [&'a str],
    /// Seed, for the foot of the page.
    pub seed: Option<u64>,
}

/// Writes score and page, keeps the reports of the worst cases, and says the headline.
///
/// # Errors
/// If files can't be written.
pub fn publish(store: &Store, shown: &Shown<'_>) -> Result<(), Failure> {
    let score = shown.score;
    write(&store.path("score.json"), score_text(score, shown.provenance)?.as_bytes())?;
    let timing = timing(store, shown.ids);
    write(&store.path("timing.json"), store::json(&timing)?.as_bytes())?;
    let failures = score.failures.iter().take(REPORTS_KEPT).map(|failure| failure.id.as_str());
    let linked: Vec<&str> = failures.chain(score.numbers.listed().iter().map(|number| number.id.as_str())).collect();
    for id in shown.ids.iter().filter(|id| !linked.contains(id)) {
        // One that was never written, or went before, is as good as gone.
        let _ = fs::remove_file(store.case(id).join(REPORT));
    }
    let report = |id: &str| {
        let has_report = store.case(id).join(REPORT).is_file();
        if has_report { format!("cases/{id}/{REPORT}") } else { String::new() }
    };
    let seconds = |key: &str| four_digits(timing[key].as_f64().unwrap_or(f64::NAN), "s");
    let times = format!("{} / {}", seconds("median_s"), seconds("longest_s"));
    let facts = [("median / longest diagnosis".to_owned(), times)];
    let mut provenance = output::provenance(shown.seed);
    for key in ["commit", "labels_sha256", "answers_sha256", "program_sha256"] {
        provenance.push(format!("{key} {}", shown.provenance[key].as_str().unwrap_or("unknown")));
    }
    let page = score_page(&PageView {
        title: shown.title,
        subtitle: &shown.subtitle,
        score,
        report: &report,
        facts: &facts,
        warnings: &[],
        provenance: &provenance,
    });
    say(score);
    output::save_page(&page, &store.path(REPORT), false)
}

/// Times and exit codes of all cases. Not part of the score, which is the same for every machine.
fn timing(store: &Store, ids: &[&str]) -> Value {
    let ran: Vec<_> = ids.iter().filter_map(|id| Some((*id, ran(&store.case(id))?))).collect();
    let mut seconds: Vec<f64> = ran.iter().map(|(_, ran)| ran.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let each: serde_json::Map<String, Value> = ran
        .iter()
        .map(|(id, ran)| ((*id).to_owned(), json!({ "seconds": ran.seconds, "exit_code": ran.exit_code })))
        .collect();
    json!({
        "total_s": seconds.iter().sum::<f64>(), "median_s": seconds.get(seconds.len() / 2), "longest_s": seconds.last(),
        "cases": each,
    })
}

fn say(score: &Score) {
    let facts: Vec<(String, String)> = score
        .bars
        .iter()
        .filter(|bar| bar.value.is_finite())
        .map(|bar| {
            let interval = bar.interval.map_or(String::new(), |[low, high]| format!(" ({low:.3} to {high:.3})"));
            let sign = if bar.is_more_better { ">=" } else { "<=" };
            let met = if bar.is_met { "met" } else { "NOT met" };
            (bar.name.to_owned(), format!("{:.3}{interval}, {sign} {}: {met}", bar.value, bar.bar))
        })
        .collect();
    output::facts(&facts);
}
