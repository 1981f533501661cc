//! The answer: what `diagnosis.json` says (schema `hysteron-diagnosis-1`), and what the page needs beside it.

use super::augment::{Augmented, Changed, Estimate, augment};
use super::bench::{Bench, Record};
use super::closed_loop::ClosedLoop;
use super::events::Losses;
use super::explanation::Explanation;
use super::fits::distinct;
use super::gap::{Gap, Left, LeftWith, ShareOf, Three, expected, gap, shares};
use super::hypothesis::Installed;
use super::judge::Course;
use super::next::{NextExperiment, next_experiment};
use super::plants::{Begun, Benches, Played, Variant};
use super::random::{Random, beyond_stated, lost, more_than_stated, repeated, size_of_scatter};
use super::refit::{has_gap, led_without_one, refitted};
use super::report::responses_of;
use super::screen::Lead;
use super::search::Search;
use super::starts::scored_from;
use super::verdict::{Class, Ranked, Verdict, hidden, leading, named, probability, ranking, set90, shares_of_known};
use super::zeros::own_zeros;
use super::{Options, Say};
use crate::identify::START_SHARE;
use crate::identify::parameters::Quantity;
use crate::locate::{StagePart, Trace, Where, locate, strongest};
use crate::page::{Kept, ResponseView};
use crate::residual::{Autocorrelation, LAGS, noise_rms};
use plant_sim::effects::{Kind, Stage, find};
use plant_sim::model::Model;
use serde::Serialize;
use std::collections::BTreeMap;

/// Schema of `diagnosis.json`.
pub const SCHEMA: &str = "hysteron-diagnosis-1";
/// Noise that makes less than this share of the excess is no second effect, unless the first leaves less than this of the gap.
const SECOND_SHARE: f64 = 0.15;
const WELL: f64 = 0.1;
/// What of `no_gap` becomes `unknown` where held-out rows show what no fitted row does.
const SURPRISED: f64 = 0.97;
/// Rows of a log that are kept for the page; beyond, every second one is dropped, and so on.
const PAGE_ROWS: usize = 400_000;

/// A diagnosis.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Version of the program.
    pub version: &'static str,
    /// What is said of the gap.
    pub verdict: Verdict,
    /// The named set, largest share first.
    pub effects: Vec<String>,
    /// Stage of the chain that the most probable of them acts in.
    pub stage: Option<&'static str>,
    /// All entries, most probable first.
    pub ranking: Vec<Ranked>,
    /// Smallest set with 90 % of the probability.
    pub set90: Vec<String>,
    /// Entries that these logs can't tell apart.
    #[serde(serialize_with = "members")]
    pub classes: Vec<Class>,
    /// Why, one sentence for each class.
    pub class_reasons: Vec<String>,
    /// The gap in numbers.
    pub gap: Gap,
    /// What a loop makes of it, if one was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed_loop: Option<ClosedLoop>,
    /// Who explains how much of it.
    pub shares: Vec<ShareOf>,
    /// Numbers of the effects.
    pub parameters: Vec<Estimate>,
    /// Nominal numbers that moved.
    pub changed: Vec<Changed>,
    /// Where the gap lies after the refit.
    #[serde(rename = "where")]
    pub location: Where,
    /// The fit that leaves least, whether it is believed or not; none where nothing was fitted.
    pub best_fit: Option<BestFit>,
    /// What stays.
    pub unexplained: Unexplained,
    /// What to measure next.
    pub next_experiment: Option<NextExperiment>,
    /// Why nothing is to be measured next, if so.
    pub no_experiment_reason: Option<String>,
    /// What the reader must know.
    pub warnings: Vec<String>,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Entries that were struck out of the registry.
    pub without: Vec<String>,
    /// Logs simulated on the way.
    pub simulations: usize,
    /// The plant with refitted numbers and effects.
    #[serde(skip)]
    pub augmented: Model,
    /// What the page shows beside this.
    #[serde(skip)]
    pub evidence: Evidence,
}

/// The fit that leaves least.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BestFit {
    /// Its effects.
    pub effects: Vec<String>,
    /// Rms that it leaves of the fitted rows, over that of the noise. What scatters takes nothing of it, as no row is predicted by it.
    pub rms_over_noise: f64,
}

/// What no entry explains.
#[derive(Clone, Debug, Serialize)]
pub struct Unexplained {
    /// Rms beyond the noise.
    pub rms_um: f64,
    /// Part of it that neighbouring rows share, rather than scatter.
    pub structured_share_percent: f64,
    /// Largest autocorrelation at a lag > 0, in magnitude.
    pub max_abs_autocorrelation: f64,
    /// That lag.
    pub lag_s: f64,
    /// Where it lives.
    pub strongest: String,
}

/// What the page shows and `diagnosis.json` doesn't.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// Where the gap lies with the effects in.
    pub location_after: Option<Where>,
    /// Logs with predictions, fitted ones first.
    pub logs: Vec<LogEvidence>,
    /// Frequency responses, from every row of the logs that are not too long for it.
    pub responses: Vec<ResponseView>,
    /// Explanations that were fitted and not named, most probable first.
    pub rivals: Vec<Rival>,
    /// Entries that no explanation has, with the percentage of the gap's mean square that the screening lets them take, most first; none without a gap.
    pub screened: Vec<(String, f64)>,
    /// Fraction of the gap that the named one leaves, as amplitude.
    pub named_left: Option<f64>,
    /// The quantities of `changed`.
    pub changed: Vec<Quantity>,
    /// What may hide where there is no gap, by less than the plant states or where the fitted rows leave it open.
    pub hidden: Vec<&'static str>,
}

/// One log with what the three plants make of it.
#[derive(Clone, Debug, Default)]
pub struct LogEvidence {
    /// Name of the log.
    pub name: String,
    /// Whether no fit saw it.
    pub is_held_out: bool,
    /// Which of its rows are here.
    pub kept: Kept,
    /// Seconds between these.
    pub dt_s: f64,
    /// Time of the first row.
    pub from_s: f64,
    /// Rows at the start that are not looked at.
    pub run_in: usize,
    /// First row whose miss counts: the beginning of a held-out log tells its start.
    pub scored_from: usize,
    /// The drive's monitor where the log has one, else the command; volts.
    pub drive_v: Vec<f64>,
    /// Readings, metres; beside them what the plants predict.
    pub measured_m: Vec<f64>,
    /// Nominal plant.
    pub nominal_m: Vec<f64>,
    /// Refitted plant.
    pub refit_m: Vec<f64>,
    /// Plant with effects.
    pub augmented_m: Vec<f64>,
    /// Noise, metres rms.
    pub noise_m: f64,
}

/// An explanation that was fitted and not named.
#[derive(Clone, Debug)]
pub struct Rival {
    /// Its effects.
    pub effects: Vec<String>,
    /// The nominal numbers that `parameter_error` has wrong.
    pub numbers: Vec<String>,
    /// Rms after the fit over that of the noise.
    pub rms_over_noise: f64,
    /// Squares of the numbers' shifts in sigma.
    pub prior_cost: f64,
    /// Probability.
    pub probability: f64,
    /// Fraction of the gap that it leaves, as amplitude.
    pub left: f64,
    /// The same of the log or octave in which it leaves most; zero where that is not known.
    pub of_worst: f64,
}

fn members<S: serde::Serializer>(classes: &[Class], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(classes.iter().map(|class| &class.members))
}

/// Makes the answer of a course.
pub(super) fn answer(
    search: &Search<'_>,
    course: &Course,
    benches: &Benches<'_>,
    options: &Options,
    losses: Option<&Losses>,
    mut warnings: Vec<String>,
    say: Say<'_>,
) -> Diagnosis {
    let bench = search.bench;
    let without: Vec<&str> = options.without.iter().map(String::as_str).collect();
    say("scoring", 0.9);
    let (mut verdict, explanation, classes) = named(search, course, &without);
    let mut random: Vec<Random> = explanation
        .and_then(|e| e.scatter.as_ref())
        .map(|(effect, form, scattered)| size_of_scatter(*effect, form, scattered))
        .into_iter()
        .collect();
    // What no fit was shown: rows that were lost, and noise beyond what is stated. A fit that leaves much hides noise, but no lattice.
    let well = explanation.is_some_and(|e| e.judged.left < WELL);
    let excess2 = course.scattered.excess_m2.max(0.0);
    let unseen = beyond_stated(bench.model, bench, &without).filter(|noise| {
        let is_seen = noise.form.kind == Kind::Lattice;
        verdict == Verdict::NoGap || well || is_seen || noise.power_m2 > SECOND_SHARE * (noise.power_m2 + excess2)
    });
    let is_new = |beyond: &Random| {
        verdict != Verdict::Unknown && random.iter().all(|known| known.effect.id() != beyond.effect.id())
    };
    let never_arrived = losses.and_then(lost).or_else(|| repeated(bench, &course.scattered)).filter(is_new);
    // Noise beyond what is stated is none that a fit leaves: the rows' own noise has it.
    let left_with = LeftWith::of(random.first().or(never_arrived.as_ref()));
    let is_all_there = never_arrived.is_none();
    let beyond = never_arrived.and_then(|lost| more_than_stated(lost, bench.model)).or(unseen.filter(is_new));
    if let Some(noise) = &beyond {
        verdict = Verdict::Explained;
        random.push(noise.clone());
    }
    let found = augment(search, &benches.fitted, &course.refit, explanation, random);
    let begun = benches.begun(&found.variant);
    let three = play(benches, course, &found, begun.as_ref(), explanation.is_some());
    let spread = found.spread(benches, begun.as_ref(), &three.augmented[..benches.fitted.records.len()]);
    let left = Left { with: left_with, spread: &spread, left_out_m2: found.left_out_m2.as_deref() };
    let expected = expected(benches, &three, &left, options.seed);
    let gap = gap(benches, &three, &expected, options.seed);
    let mut shares_of_nothing = [course.no_gap, course.unknown];
    let mut is_left_open = false;
    if is_all_there && gap.surprises(&expected) {
        let stays = format!(
            "{}: {:.4} um stay where {:.4} um were to be expected",
            gap.headline,
            gap.augmented_rms_um,
            1e6 * expected.left2_m2.sqrt().hypot(1e-6 * gap.noise_rms_um),
        );
        is_left_open = verdict == Verdict::NoGap && is_one_plant(search, course, benches);
        warnings.push(if is_left_open {
            format!("{stays}: the fitted rows leave open what decides there, and a plant within the stated uncertainties suits all of them")
        } else {
            format!("{stays}: these rows show what no fitted row does; fit some of their kind as well")
        });
        if verdict == Verdict::NoGap && !is_left_open {
            verdict = Verdict::Unknown;
            shares_of_nothing = [(1.0 - SURPRISED) * course.no_gap, course.unknown + SURPRISED * course.no_gap];
        }
    }
    warnings.extend(own_zeros(benches, &three));
    for (log, open_m) in spread.open_starts(benches, &three.augmented) {
        warnings.push(format!(
            "{log}: its first {:.0} %, which tell where it starts, leave open what its hysterons hold; of what stays there some {:.2} um may be that: \
             record some rest before the first motion, or state --initial relaxed if it was",
            100.0 * START_SHARE,
            1e6 * open_m
        ));
    }
    let powers: Vec<(&'static str, f64)> = found.random.iter().map(|r| (r.effect.id(), r.power_m2)).collect();
    let shares = shares(benches, &three, &found.variant, &powers);
    let hidden = hidden(bench, is_left_open, &without);
    let shares_of_known = shares_of_known(course, shares_of_nothing, explanation);
    let ranking = ranking(course, &shares_of_known, shares_of_nothing, explanation, beyond.as_ref(), &hidden);
    let set90 = set90(&ranking);
    let effects = effects(verdict, explanation, beyond.as_ref(), &shares);

    say("locating", 0.94);
    let logs = logs(benches, &three);
    let responses = responses_of(benches, &three);
    // Ten minutes are a hundred megabytes a column.
    let Three { refit, augmented, .. } = three;
    let mut location = located(benches, &refit);
    location.stages = stages(&course.leads);
    drop(refit);
    let location_after = located(benches, &augmented);
    let unexplained = unexplained(benches, &augmented, &location_after);
    say("choosing the next experiment", 0.96);
    let open = open(&effects, &set90, &classes);
    let (next_experiment, no_experiment_reason) = match next(bench, course, verdict, explanation, &open) {
        Ok(next) => (Some(next), None),
        Err(reason) => (None, Some(reason)),
    };
    let open_starts = found.undetermined_starts(bench);
    if !open_starts.is_empty() {
        warnings.push(format!(
            "{}: the state at the start is not determined by the log, so intervals hold what it might have been: record some rest before \
             the first motion, or state --initial relaxed if it was",
            open_starts.join(", ")
        ));
    }
    if verdict == Verdict::Explained && found.variant.has_own_parts() {
        let own: Vec<&str> = found.variant.with_own_parts().collect();
        warnings.push(format!(
            "{}: its size is each log's own; a log never shown is expected to have what the fitted ones have in common, and nothing tells the rest \
             beforehand",
            own.join(", ")
        ));
    }
    if verdict == Verdict::Explained {
        warnings.extend(told_at_once(&found.variant, bench));
    }
    if !found.random.is_empty() {
        warnings.push(
            "what scatters can't be predicted row by row: the plant carries it as noise, and the gap doesn't shrink by it".to_owned(),
        );
    }
    Diagnosis {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        verdict,
        stage: leading(&effects, |id| probability(&ranking, id)).and_then(|id| stage(id, found.wrong())),
        effects,
        ranking,
        set90,
        class_reasons: classes.iter().map(|class| class.reason.clone()).collect(),
        classes,
        gap,
        closed_loop: None,
        shares,
        parameters: found.estimates(bench),
        changed: found.changed(bench),
        location,
        best_fit: best_fit(course.explanations.iter().map(|e| (e.judged.ids.as_slice(), e.candidate.chi))),
        unexplained,
        next_experiment,
        no_experiment_reason,
        warnings,
        seed: options.seed,
        without: options.without.clone(),
        simulations: search.simulations.load(std::sync::atomic::Ordering::Relaxed),
        augmented: found.model(bench, "diagnosed"),
        evidence: Evidence {
            location_after: Some(location_after),
            logs,
            responses,
            rivals: rivals(course, &shares_of_known, explanation),
            screened: screened(course),
            named_left: explanation.map(|explanation| explanation.judged.left),
            changed: found.moved(bench),
            hidden: hidden.iter().filter(|_| verdict == Verdict::NoGap).map(|(id, _)| *id).collect(),
        },
    }
}

/// Whether one plant within the stated uncertainties suits all rows together, fitted and held out. It is asked of a verdict of no gap, and
/// nothing else is made of the fit.
fn is_one_plant(search: &Search<'_>, course: &Course, benches: &Benches<'_>) -> bool {
    let bench = Bench::new(search.bench.model, benches.records().cloned().map(Record::whole).collect());
    let search = Search { bench: &bench, simulations: search.simulations };
    let refit = refitted(&search, course.refit.hypothesis.freedom);
    !has_gap(&refit) || !has_gap(&led_without_one(&search, refit))
}

/// The three plants on all logs.
fn play(benches: &Benches<'_>, course: &Course, found: &Augmented, begun: Option<&Begun>, is_explained: bool) -> Three {
    let fitted = &benches.fitted;
    let refit =
        Variant { hypothesis: course.refit.hypothesis.clone(), z: course.refit.found.z.clone(), starts_known: true };
    let nominal = refit.part(fitted, false, |_| true);
    let augmented = benches.play_from(&found.variant, begun);
    // Without a name the refit is what was found.
    let played = if is_explained { benches.play(&refit) } else { augmented.clone() };
    let not_portable = if found.variant.has_own_parts() {
        let by_others = benches.play_fitted(&found.variant.as_others(fitted));
        let parts = augmented.iter().zip(&by_others).zip(&fitted.records);
        let lasts_s = |record: &Record<'_>| record.log.len() as f64 * record.log.dt_s;
        let held_s: Vec<f64> = benches.held.iter().flat_map(|held| &held.records).map(lasts_s).collect();
        let of_log = |((own, by_others), record): ((&Played, &Played), &Record<'_>)| {
            while_held(record.log.dt_s, &difference2(own, by_others), &held_s)
        };
        parts.map(of_log).collect()
    } else {
        Vec::new()
    };
    Three { nominal: benches.play(&nominal), refit: played, augmented, not_portable }
}

fn difference2(one: &[f64], other: &[f64]) -> Vec<f64> {
    one.iter().zip(other).map(|(a, b)| (a - b).powi(2)).collect()
}

/// Number and sum of a fitted log's rows, `dt_s` apart, over as long as each held-out log lasts, `held_s`: a drift grows, and what a long log shows of
/// it is not asked of a short one.
fn while_held(dt_s: f64, values: &[f64], held_s: &[f64]) -> [f64; 2] {
    let alike = held_s.iter().map(|held_s| &values[..values.len().min((held_s / dt_s).round() as usize)]);
    alike.fold([0.0; 2], |[rows, sum], alike| [rows + alike.len() as f64, sum + alike.iter().sum::<f64>()])
}

/// What belongs to each log and is told by its first stretch, with each log's setting.
fn told_at_once(variant: &Variant, bench: &Bench<'_>) -> Vec<String> {
    const TOLD: &str = "in a log never shown it is told by the first stretch, as the start is";
    let of = |(at, installed): (usize, &Installed)| {
        let id = installed.effect.id();
        if !installed.is_setting() {
            return format!("{id}: phase and size belong to each log; {TOLD}");
        }
        let (scale, unit) = if installed.axes[0].parameter.unit == "m" { (1e6, "um") } else { (100.0, "%") };
        let of_log = |(index, record): (usize, &Record<'_>)| {
            let value = bench.values(&variant.hypothesis, &variant.z, index)[at][0];
            format!("{} {:+.3} {unit}", record.log.name, scale * value)
        };
        let logs: Vec<String> = bench.records.iter().enumerate().map(of_log).collect();
        format!("{id}: another one in each log ({}); {TOLD}", logs.join(", "))
    };
    variant.told_at_once().map(of).collect()
}

/// Identifiers, largest share first.
fn effects(
    verdict: Verdict,
    explanation: Option<&Explanation>,
    beyond: Option<&Random>,
    shares: &[ShareOf],
) -> Vec<String> {
    if verdict != Verdict::Explained {
        return Vec::new();
    }
    let mut ids: Vec<&str> = explanation.map(|e| e.judged.ids.clone()).unwrap_or_default();
    ids.extend(beyond.map(|noise| noise.effect.id()));
    let share = |id: &&str| shares.iter().find(|s| s.effect == **id).map_or(0.0, |s| s.percent);
    ids.sort_by(|a, b| share(b).total_cmp(&share(a)));
    ids.dedup();
    ids.into_iter().map(str::to_owned).collect()
}

/// Where an entry acts; a wrong number acts where the number is.
fn stage(id: &str, wrong: Option<Quantity>) -> Option<&'static str> {
    match (find(id), wrong) {
        (Some(effect), _) => Some(effect.stage().name()),
        (None, Some(Quantity::Stiffness | Quantity::Damping)) => Some("structure"),
        (None, Some(Quantity::Delay)) => Some("drive"),
        (None, _) => Some("actuator"),
    }
}

/// Entries between which something is left to decide.
fn open(effects: &[String], set90: &[String], classes: &[Class]) -> Vec<String> {
    let mut open: Vec<String> = Vec::new();
    for id in classes.iter().flat_map(|class| &class.members) {
        if !open.contains(id) {
            open.push(id.clone());
        }
    }
    if open.is_empty() && set90.len() > effects.len().max(1) {
        open.extend(set90.iter().filter(|id| !["no_gap", "unknown"].contains(&id.as_str())).cloned());
    }
    open
}

fn next(
    bench: &Bench<'_>,
    course: &Course,
    verdict: Verdict,
    explanation: Option<&Explanation>,
    open: &[String],
) -> Result<NextExperiment, String> {
    let reason = match (verdict, explanation, open) {
        (Verdict::Explained, _, []) | (Verdict::Explained, None, [_]) => {
            "the named effects are certain on these logs: nothing is left to split"
        }
        (Verdict::NoGap, _, [] | [_]) => "there is no gap to explain",
        (Verdict::Unknown, _, [] | [_]) if course.no_gap > course.unknown => {
            "rows that were not fitted show what no fitted row does: fit a log of their kind"
        }
        (Verdict::Unknown, _, [] | [_]) => {
            "no entry of the registry explains the gap, so no experiment is known that would split them"
        }
        _ => return next_experiment(bench, course, explanation, open),
    };
    Err(reason.to_owned())
}

/// The most promising lead of each stage, stages in the order of the signal.
fn stages(leads: &[Lead]) -> Vec<StagePart> {
    let mut best: BTreeMap<Stage, &Lead> = BTreeMap::new();
    // Leads come most promising first.
    leads.iter().for_each(|lead| _ = best.entry(lead.effect.stage()).or_insert(lead));
    let part = |(stage, lead): (Stage, &Lead)| StagePart {
        stage: stage.name(),
        share_percent: lead.share_percent(),
        effect: lead.effect.id(),
    };
    best.into_iter().map(part).collect()
}

/// What was left at the screening, which is made of a gap only.
fn screened(course: &Course) -> Vec<(String, f64)> {
    let is_told = |id: &str| course.explanations.iter().any(|explanation| explanation.judged.ids.contains(&id));
    let left = distinct(&course.leads).into_iter().filter(|lead| !is_told(lead.effect.id()));
    left.map(|lead| (lead.effect.id().to_owned(), lead.share_percent())).collect()
}

/// Where the residual of `played` lies, run-ins left out.
fn located(benches: &Benches<'_>, played: &[Played]) -> Where {
    let residuals: Vec<Vec<f64>> = benches
        .records()
        .zip(played)
        .map(|(record, played)| {
            let residual = |(k, (y, p)): (usize, (&f64, &f64))| if k < record.run_in { f64::NAN } else { y - p };
            record.log.displacement_m.iter().zip(played).enumerate().map(residual).collect()
        })
        .collect();
    let traces: Vec<Trace<'_>> = benches
        .records()
        .zip(played)
        .zip(&residuals)
        .map(|((record, played), residual_m)| Trace {
            name: &record.log.name,
            dt_s: record.log.dt_s,
            drive_v: record.log.drive_v.as_ref().unwrap_or(&record.log.command_v),
            displacement_m: played,
            residual_m,
            noise_m: record.noise_m,
        })
        .collect();
    locate(&traces)
}

fn unexplained(benches: &Benches<'_>, augmented: &[Played], location: &Where) -> Unexplained {
    let (mut rows, mut all2, mut noise2, mut white2) = (0.0, 0.0, 0.0, 0.0);
    let (mut most, mut lag_s) = (0f64, 0.0);
    for (record, played) in benches.records().zip(augmented) {
        let residual_m: Vec<f64> =
            record.log.displacement_m.iter().zip(played).map(|(y, p)| y - p).skip(record.run_in).collect();
        let n = residual_m.len() as f64;
        rows += n;
        all2 += residual_m.iter().map(|r| r * r).sum::<f64>();
        noise2 += n * record.noise_m.powi(2);
        white2 += n * noise_rms(&residual_m).powi(2);
        for (lag, correlation) in Autocorrelation::of(&residual_m, LAGS).correlation.iter().enumerate().skip(1) {
            if correlation.abs() > most.abs() {
                (most, lag_s) = (*correlation, lag as f64 * record.log.dt_s);
            }
        }
    }
    let excess2 = (all2 - noise2).max(0.0) / rows;
    let structured2 = (all2 - white2).max(0.0) / rows;
    Unexplained {
        rms_um: 1e6 * excess2.sqrt(),
        structured_share_percent: if excess2 > 0.0 { (100.0 * structured2 / excess2).min(100.0) } else { 0.0 },
        max_abs_autocorrelation: most.abs(),
        lag_s,
        strongest: strongest(location),
    }
}

fn logs(benches: &Benches<'_>, three: &Three) -> Vec<LogEvidence> {
    let fitted = benches.fitted.records.len();
    let one = |(index, record): (usize, &Record<'_>)| {
        let log = record.log;
        let stride = log.len().div_ceil(PAGE_ROWS).max(1);
        let thin = |values: &[f64]| values.iter().step_by(stride).copied().collect::<Vec<f64>>();
        LogEvidence {
            name: log.name.clone(),
            is_held_out: index >= fitted,
            kept: Kept { rows: log.len(), stride },
            dt_s: stride as f64 * log.dt_s,
            from_s: log.time_start_s,
            run_in: record.run_in.div_ceil(stride),
            scored_from: if index < fitted { record.run_in } else { scored_from(record) }.div_ceil(stride),
            drive_v: thin(log.drive_v.as_ref().unwrap_or(&log.command_v)),
            measured_m: thin(&log.displacement_m),
            nominal_m: thin(&three.nominal[index]),
            refit_m: thin(&three.refit[index]),
            augmented_m: thin(&three.augmented[index]),
            noise_m: record.noise_m,
        }
    };
    benches.records().enumerate().map(one).collect()
}

/// Of fits with these effects and these mean squares over that of the noise; equals are told by the first.
fn best_fit<'a>(fits: impl Iterator<Item = (&'a [&'static str], f64)>) -> Option<BestFit> {
    let (ids, chi) = fits.filter(|(_, chi)| chi.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1))?;
    let effects = ids.iter().map(|id| (*id).to_owned()).collect();
    Some(BestFit { effects, rms_over_noise: chi.max(0.0).sqrt() })
}

fn rivals(course: &Course, shares: &[f64], named: Option<&Explanation>) -> Vec<Rival> {
    let all = course.explanations.iter().zip(shares);
    let others = all.filter(|(e, _)| named.is_none_or(|named| !std::ptr::eq(*e, named)));
    let rival = |(e, share): (&Explanation, &f64)| Rival {
        effects: e.judged.ids.iter().map(|id| (*id).to_owned()).collect(),
        numbers: e.freed.iter().filter_map(|freed| freed.quantity).map(|quantity| quantity.name()).collect(),
        rms_over_noise: e.candidate.chi.max(0.0).sqrt(),
        prior_cost: e.judged.prior_cost,
        probability: *share,
        left: e.judged.left,
        of_worst: e.judged.of_worst,
    };
    let mut rivals: Vec<Rival> = others.map(rival).collect();
    rivals.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    rivals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_fit_is_the_one_that_leaves_least() {
        let of = |fits: &[(&'static [&'static str], f64)]| best_fit(fits.iter().copied());
        let pair: &[&str] = &["creep", "backlash"];
        let best = of(&[(&["end_stop"], 9.0), (pair, 4.0), (&["creep"], 4.0), (&["mains_hum"], f64::NAN)]);
        assert_eq!(
            best.map(|best| (best.effects.join(" "), best.rms_over_noise)),
            Some(("creep backlash".into(), 2.0))
        );
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn a_long_log_counts_for_no_longer_than_a_held_out_one_lasts() {
        let drift2 = |rows: usize| (0..rows).map(|row| (row as f64).powi(2)).collect::<Vec<f64>>();
        // Of a hundred rows a held-out log of ten seconds sees ten, and one of five seconds five; of ten rows no more than there are.
        assert_eq!(while_held(1.0, &drift2(100), &[10.0]), [10.0, 285.0]);
        assert_eq!(while_held(1.0, &drift2(100), &[10.0, 5.0]), [15.0, 315.0]);
        assert_eq!(while_held(1.0, &drift2(10), &[50.0]), [10.0, 285.0]);
        // Half as many seconds between rows: twice as many rows.
        assert_eq!(while_held(0.5, &drift2(100), &[5.0]), [10.0, 285.0]);
        assert_eq!(while_held(1.0, &drift2(10), &[]), [0.0; 2]);
    }
}
