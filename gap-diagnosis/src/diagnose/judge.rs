//! The course of a diagnosis: refit, screen, fit, pair, judge.

use super::bench::{Bench, Freedom, Record};
use super::evidence::{Judged, PRIOR_MOST, PRIOR_WEIGHT, SHARPNESS, probabilities};
use super::fits::{FOUND, Fits, HOPELESS, PAIR_BEYOND};
use super::normal::Sums;
use super::records::ROUGH;
use super::screen::{Lead, Starts};
use super::search::{Candidate, Remainder, Search, middle};
use super::spread::{Scattered, scattered};
use super::symmetry::{Freed, Shifts, along, freed};
use plant_sim::effects::{Effect, Form, find};

/// Gap beyond the noise, in shares of the noise, below which there is none to speak of.
pub(super) const LEAST_GAP: f64 = 0.4;
/// The same of a single log: an effect may show in one experiment only.
const LEAST_GAP_OF_LOG: f64 = 0.5;
/// Chi-square that a comparison of two fits resolves.
pub(super) const RESOLVED: f64 = 20.0;
/// Restarts of a refit that leaves a gap, and the mean square, in units of the noise, beyond which the gap is no local minimum's.
const RESTARTS: u64 = 4;
const LOCAL_MINIMUM: f64 = 400.0;
/// Squares of the numbers' shifts beyond which a refit may have bent them: a dozen numbers make a dozen, give or take five.
pub(super) const BENT_COST: f64 = 30.0;
/// A fit that leaves less than this may show the refit a better minimum, and one that leaves less than this is a better one.
const MUCH_BETTER: f64 = 0.7;
/// Least chi-square by which a freed symmetry must lower the shifts' cost beside an effect that was fitted.
pub(super) const FREED_BESIDES: f64 = 60.0;
/// The same beside one that is at the noise, if the other shifts are ordinary then: six sigma.
const FREED_AT_NOISE: f64 = 36.0;
/// .. and beside a gap that stays: ten sigma of several numbers, of which the freed direction leaves this share, where the refit leaves
/// less than this of the whole gap.
const FREED_FIRST: f64 = 300.0;
/// .. and where next to nothing stays: five sigma, if the other shifts are ordinary then.
const FREED_OF_ALL: f64 = 25.0;
/// A direction that moves readings by so many times what the refit leaves is no trace of what else is wrong.
const MUCH_LARGER: f64 = 8.0;
/// .. and by so many times where it pays for six sigma only.
const FAR_LARGER: f64 = 30.0;
pub(super) const PAYS_FOR_ALL: f64 = 0.05;
/// Entries that shift the displacement as a whole.
const OFFSETS: [&str; 2] = ["sensor_offset", "asymmetric_hysteresis"];
pub(super) const NEARLY_ALL: f64 = 0.1;
/// A fit that leaves more than this says nothing of a direction.
const MOSTLY: f64 = 0.35;
/// A log counts by itself if its gap, and what is left of it, are more than these shares of the noise's power.
const GAP_OF_LOG: f64 = 0.25;
const LEFT_OF_LOG: f64 = 0.08;
/// Least fraction of the gap that an effect beside a fit above the noise is taken to leave.
const BENT: f64 = 0.02;
/// Mean square, in units of the noise, up to which a fit counts as being at the noise: the noise is known to a few per cent.
pub(super) const AT_NOISE: f64 = 1.06;
/// .. but not where that takes less than the rest of the gap's power away.
const MOST_OF_NOISE: f64 = 0.3;
/// Share of jitter's power that may return with the command: where few rows are late, all are late in the mean.
const OF_LATENESS: f64 = 0.3;
/// Shares of the excess power that no noise would have, in all logs and in the worst, below which it is noise.
const NOT_NOISE: f64 = 0.12;
const NOT_NOISE_OF_LOG: f64 = 0.25;
/// What freeing one of a dozen directions must earn beyond its cost, and how likely an unknown effect is that leaves no gap.
const LOOK_ELSEWHERE: f64 = 6.0;
const NO_UNKNOWN: f64 = 0.007;

/// One explanation of the gap, fitted and judged.
#[derive(Clone)]
pub struct Explanation {
    /// What was judged.
    pub judged: Judged,
    /// Probability.
    pub probability: f64,
    /// The fit, or the refit where the effect is not in the simulation.
    pub candidate: Candidate,
    /// The directions that were freed, for effects that the nominal numbers imitate.
    pub freed: Vec<Freed>,
    /// Chi-square by which they cost more than others of the same fit, beyond what a prior cost counts.
    dearer: f64,
    /// Probability that the fit beside a direction that is sure by itself is none of the registry's.
    pub doubted: f64,
    /// For an effect that no simulation predicts: its form, and the scatter that tells its number.
    pub scatter: Option<(&'static dyn Effect, &'static Form, Scattered)>,
}

impl Explanation {
    /// By what `candidate` has installed, which leaves `left` of the gap.
    fn by_fit(candidate: &Candidate, left: f64, floor: f64) -> Self {
        let judged = Judged {
            ids: candidate.hypothesis.ids(),
            left,
            of_worst: 0.0,
            floor,
            prior_cost: candidate.found.prior_cost,
            parameters: candidate.hypothesis.parameters(),
        };
        Self {
            judged,
            probability: 0.0,
            candidate: candidate.clone(),
            freed: Vec::new(),
            dearer: 0.0,
            doubted: 0.0,
            scatter: None,
        }
    }

    /// Chi-square that speaks against it beforehand.
    fn rarer(&self) -> f64 {
        self.dearer + self.freed.iter().map(|freed| freed.rarer).sum::<f64>()
    }

    /// The same with `id` beside it, which no simulation shows.
    fn and(mut self, id: &'static str) -> Self {
        self.judged.ids.push(id);
        self.judged.parameters += 1;
        self
    }

    /// The same with what the nominal numbers imitate beside it, where the numbers leave `rest` of the whole gap.
    fn along(self, freed: &Freed, rest: f64) -> Self {
        let mut explanation = self.and(freed.effect);
        explanation.judged.left *= rest;
        explanation.judged.prior_cost = freed.cost;
        explanation.freed.push(freed.clone());
        explanation
    }
}

/// What a course of diagnosis found.
pub struct Course {
    /// The refitted nominal plant.
    pub refit: Candidate,
    /// Explanations, most probable first.
    pub explanations: Vec<Explanation>,
    /// Probability of `unknown`.
    pub unknown: f64,
    /// Probability of `no_gap`.
    pub no_gap: f64,
    /// Leads of the screening.
    pub leads: Vec<Lead>,
    /// How the residual of the refit scatters.
    pub scattered: Scattered,
    /// Lines of the refit's residual, Hz.
    pub line_hz: Vec<f64>,
}

impl Course {
    /// Whether the refit leaves a gap to speak of.
    pub fn has_gap(&self) -> bool {
        has_gap(&self.refit)
    }

    /// This is what stays of a gap whose mean square was `whole`, in units of the noise, once lost rows are known: what is unknown of it counts by
    /// the fraction of the gap that it leaves, as behind any other effect.
    pub fn stays_of(&mut self, whole: f64) {
        let left = ((self.refit.chi - 1.0).max(0.0) / whole.max(1e-12)).sqrt();
        let judged =
            Judged { ids: vec!["lost_samples"], left, of_worst: 0.0, floor: 0.0, prior_cost: 0.0, parameters: 1 };
        let doubt = judged.doubt();
        self.no_gap += (1.0 - doubt) * self.unknown;
        self.unknown *= doubt;
    }

    fn new(refit: Candidate, explanations: Vec<Explanation>, scattered: Scattered) -> Self {
        let (leads, line_hz) = (Vec::new(), Vec::new());
        Self { refit, explanations, unknown: 0.0, no_gap: 0.0, leads, scattered, line_hz }
    }
}

/// What a course tells while it runs.
pub type Say<'a> = &'a (dyn Fn(&str, f64) + Sync);

/// Runs the course.
pub fn course(search: &Search<'_>, freedom: Freedom, without: &[&str], say: Say<'_>) -> Course {
    say("refitting the nominal plant", 0.02);
    let refit = refitted(search, freedom);
    let course = explain(search, refit, without, say);
    let best = course.explanations.iter().map(|e| &e.candidate).min_by(|a, b| a.chi.total_cmp(&b.chi));
    let shows_better = |fit: &&Candidate| {
        fit.left(&course.refit, 1.0) < MUCH_BETTER && !fit.hypothesis.installed.is_empty() && has_gap(&course.refit)
    };
    let again = best.filter(shows_better).map(|fit| search.refit_again(&course.refit, fit));
    match again.filter(|again| again.left(&course.refit, 1.0) < MUCH_BETTER) {
        Some(refit) => explain(search, refit, without, say),
        None => course,
    }
}

/// The refit, from as many starts as it needs.
pub(super) fn refitted(search: &Search<'_>, freedom: Freedom) -> Candidate {
    let mut refit = search.refit(freedom);
    // Where the numbers belong: at nominal, or where a payload or a gain has put them.
    let mut home = vec![0.0; search.bench.free.len()];
    if let Some(numbers) = along(search.bench, &refit.found).filter(|_| is_bent(&refit)) {
        refit = search.polish_from(refit, &numbers);
        // Starts that followed the wrong numbers for long lock their logs.
        if has_gap(&refit) {
            refit = search.resettled(refit, &numbers, &[]);
        }
        home = numbers;
    }
    // A first refit ends in a local minimum now and then, most often a little above the noise, or with numbers bent: hysterons forget
    // nothing, so that dead zones and capacitances lock one another.
    for attempt in 0..RESTARTS {
        let (has_gap, is_bent) = (has_gap(&refit), is_bent(&refit));
        if !(has_gap || is_bent) || refit.chi > LOCAL_MINIMUM {
            break;
        }
        // At the noise only the numbers are wrong, and first of all they are asked to come home.
        refit =
            if !has_gap && attempt == 0 { search.unbent(refit) } else { search.refit_elsewhere(refit, &home, attempt) };
    }
    if has_gap(&refit) { refitted_in_parts(search, refit) } else { refit }
}

/// A refit that leaves a gap in few logs again, from where the worst of them and each of the others in turn end together: logs lock one another
/// now and then, though each could be fitted. The best of all.
fn refitted_in_parts(search: &Search<'_>, mut refit: Candidate) -> Candidate {
    let bench = search.bench;
    let chis = search.chis(&refit.found);
    let Some(worst) = (0..chis.len()).max_by(|a, b| chis[*a].total_cmp(&chis[*b])) else { return refit };
    if middle(&chis) > AT_NOISE || chis.len() < 3 {
        return refit;
    }
    for other in (0..chis.len()).filter(|index| *index != worst) {
        let logs = [worst, other];
        let part = Bench::new(bench.model, logs.map(|index| bench.records[index].clone()).to_vec());
        let found = refitted(&Search { bench: &part, ..*search }, refit.hypothesis.freedom);
        if has_gap(&found) {
            continue;
        }
        refit = search.resettled(refit, &found.found.z, &logs);
        if !has_gap(&refit) {
            return if is_bent(&refit) { search.unbent(refit) } else { refit };
        }
    }
    refit
}

fn is_bent(refit: &Candidate) -> bool {
    refit.found.prior_cost > BENT_COST
}

pub(super) fn has_gap(refit: &Candidate) -> bool {
    gap_over_least(refit) > 1.0
}

/// Gap that `refit` leaves, as amplitude, over the least to speak of.
fn gap_over_least(refit: &Candidate) -> f64 {
    let gap = |chi: f64| (chi - 1.0).max(0.0).sqrt();
    (gap(refit.chi) / LEAST_GAP).max(gap(refit.worst_chi) / LEAST_GAP_OF_LOG)
}

/// Explains what `refit` leaves.
fn explain(search: &Search<'_>, refit: Candidate, without: &[&str], say: Say<'_>) -> Course {
    let bench = search.bench;
    let remainders = search.play(&refit);
    let scattered = scattered(bench, &remainders, true);
    let excess = refit.chi - 1.0;
    // Least fraction that a comparison of fits resolves.
    let floor = (RESOLVED / (refit.rows() as f64 * excess.max(1e-9))).sqrt().min(1.0);
    if !has_gap(&refit) {
        let shifts = Shifts::of(search, &refit);
        let freed = shifts.as_ref().map_or_else(Vec::new, |shifts| shifts.freed(&[]));
        // Only the cost of the shifts speaks, and it is a proper chi-square; what the mass is off by is a shift as well.
        let nothing = -0.5 * freed.first().map_or(refit.found.prior_cost, |freed| freed.cost_without);
        // One direction that leaves ordinary shifts is enough.
        let is_one = freed.first().is_none_or(|freed| freed.cost < BENT_COST);
        let pairs = shifts.filter(|_| !is_one).map_or_else(Vec::new, |shifts| shifts.in_pairs());
        let mut explanations = by_symmetry(freed, &refit, 0.0, floor, without, 0.0);
        explanations.extend(by_symmetry(pairs, &refit, 0.0, floor, without, FREED_AT_NOISE));
        let score = |e: &Explanation| -0.5 * (e.judged.prior_cost + e.rarer()) - LOOK_ELSEWHERE * e.freed.len() as f64;
        let mut scores: Vec<f64> = explanations.iter().map(score).collect();
        scores.push(nothing);
        let doubts = vec![NO_UNKNOWN; scores.len()];
        return judged(Course::new(refit, explanations, scattered), &scores, &doubts);
    }
    let starts = Starts::of(bench, &remainders);
    say("screening the registry", 0.15);
    let leads = search.screen(&refit, &starts, without);
    let fits = Fits { search, refit: &refit, without, say }.all(&leads, &remainders);
    let best = fits.iter().min_by(|a, b| a.chi.total_cmp(&b.chi));
    // The noise is known to a few per cent: a fit that comes that near is at it.
    let at_noise = AT_NOISE.min(1.0 + MOST_OF_NOISE * excess);
    let noise = best.map(|best| best.chi).filter(|chi| *chi < at_noise).unwrap_or(1.0);
    let explained = |fit: &Candidate| {
        let mut explanation = Explanation::by_fit(fit, fit.left(&refit, noise), floor);
        explanation.judged.of_worst = left_of_worst(search, fit, &refit, &[]);
        explanation
    };
    let mut explanations: Vec<Explanation> = fits.iter().map(explained).collect();
    let best_share = leads.first().map_or(0.0, |lead| lead.share);
    let scatter_of = |scattered: &Scattered, fit: &Candidate| {
        by_scatter(scattered, fit, floor, without, best_share, !starts.line_hz.is_empty())
    };
    let scatter = scatter_of(&scattered, &refit);
    explanations.extend(scatter.iter().cloned());
    // What a fit leaves may scatter as well.
    if let Some((best, left)) =
        best.map(|best| (best, best.left(&refit, noise))).filter(|(_, left)| *left > PAIR_BEYOND)
    {
        let remainders = search.play(best);
        let beside = self::scattered(bench, &remainders, false);
        let both = scatter_of(&beside, best).into_iter().map(|mut explanation| {
            explanation.judged.left *= left;
            // Scatter explains no log that the fit beside it misses by more.
            let scatter_m2 = scatter_of_logs(&explanation, bench, &remainders);
            explanation.judged.of_worst = left_of_worst(search, best, &refit, &scatter_m2);
            explanation
        });
        explanations.extend(both);
    }
    // Scatter bends no number: beside it a direction need not pay more than beside a fit.
    let well: Vec<Explanation> =
        scatter.into_iter().filter(|explanation| explanation.judged.left < NEARLY_ALL).collect();
    let beside_scatter = well.iter().map(|explanation| explanation.judged.left).fold(1.0, f64::min);
    let directions = Directions::of(search, &refit, without, beside_scatter);
    let rest = directions.rest;
    if !directions.sure.is_empty() {
        // A fit that leaves the numbers ordinary needs no direction: it explains the whole gap as well as one does.
        let is_ordinary =
            |e: &&mut Explanation| !e.candidate.hypothesis.installed.is_empty() && e.judged.prior_cost < BENT_COST;
        for explanation in explanations.iter_mut().filter(is_ordinary) {
            explanation.judged.left *= rest;
            explanation.judged.floor *= rest;
        }
    }
    if let Some(first) = directions.first.as_ref().filter(|_| !well.is_empty()) {
        // Without it, scatter has to pay for shifts that no plant has.
        let is_alone = |e: &&mut Explanation| e.scatter.is_some() && e.candidate.hypothesis.installed.is_empty();
        explanations.iter_mut().filter(is_alone).for_each(|e| e.judged.prior_cost = PRIOR_MOST / PRIOR_WEIGHT);
        explanations.extend(well.into_iter().map(|explanation| explanation.along(first, rest)));
    }
    // What the nominal numbers imitate leaves the fit as it is. A wrong form bends the nominal numbers as well; only a fit at the noise
    // can be believed about them, or one of which the refit knew the direction before. Beside it one effect may be enough where it takes two alone.
    let is_single = |fit: &&Candidate| fit.hypothesis.installed.len() == 1;
    let single = fits.iter().filter(is_single).min_by(|a, b| a.chi.total_cmp(&b.chi));
    let single = single.filter(|single| best.is_some_and(|best| best.hypothesis.ids() != single.hypothesis.ids()));
    for fit in best.into_iter().chain(single) {
        let left = fit.left(&refit, noise);
        if left >= MOSTLY {
            continue;
        }
        let (mut known, others): (Vec<Freed>, Vec<Freed>) =
            freed(search, fit).into_iter().partition(|freed| directions.are_sure_of(freed.effect));
        known.retain(|freed| freed.gain() > FREED_AT_NOISE);
        let is_ordinary = |freed: &Freed| fit.chi < AT_NOISE && freed.cost < BENT_COST;
        let is_believed = |freed: &Freed| freed.gain() > FREED_BESIDES || is_ordinary(freed);
        let is_known = |freed: &Freed| left < FOUND && is_believed(freed) || is_large(bench, freed, fit);
        let others: Vec<Freed> = others.into_iter().filter(is_known).collect();
        if !known.is_empty() || others.iter().any(|freed| is_ordinary(freed) && freed.gain() > FREED_AT_NOISE) {
            // Without it, the fit has to pay for shifts that no plant has.
            let is_alone = |e: &&mut Explanation| e.freed.is_empty() && e.judged.ids == fit.hypothesis.ids();
            explanations.iter_mut().filter(is_alone).for_each(|e| e.judged.prior_cost = PRIOR_MOST / PRIOR_WEIGHT);
        }
        // What is none of the registry's beside a sure direction leaves that direction alone.
        let doubted = explained(fit).judged.doubt();
        let beside = by_symmetry(known, fit, left * rest, floor * rest, without, 0.0);
        explanations.extend(beside.into_iter().map(|explanation| Explanation { doubted, ..explanation }));
        explanations.extend(by_symmetry(others, fit, left, bent(fit, floor), without, FREED_AT_NOISE));
    }
    let mut sure = by_symmetry(directions.sure, &refit, rest, bent(&refit, floor), without, 0.0);
    if !directions.pairs.is_empty() {
        // One alone has to pay for shifts that no plant has.
        sure.iter_mut().for_each(|explanation| explanation.judged.prior_cost = PRIOR_MOST / PRIOR_WEIGHT);
    }
    explanations.extend(sure);
    explanations.extend(by_symmetry(directions.pairs, &refit, rest, bent(&refit, floor), without, 0.0));
    let score = |e: &Explanation| e.judged.score() - 0.5 * e.rarer() + (1.0 - e.doubted).ln();
    let mut scores: Vec<f64> = explanations.iter().map(score).collect();
    // That there is no gap leaves all of it, and becomes less likely with every time that it is larger than one to speak of.
    let nothing = Explanation::by_fit(&refit, 1.0, floor);
    scores.push(nothing.judged.score() - SHARPNESS * gap_over_least(&refit).ln());
    let doubts: Vec<f64> = explanations.iter().chain([&nothing]).map(|e| e.judged.doubt()).collect();
    judged(Course { leads, line_hz: starts.line_hz, ..Course::new(refit, explanations, scattered) }, &scores, &doubts)
}

/// What the nominal numbers imitate, as far as a refit that leaves a gap tells it.
struct Directions {
    /// The first that pays for all shifts, or leaves ordinary ones: beside scatter, which bends no number, that is enough.
    first: Option<Freed>,
    /// Those that are sure whatever stays.
    sure: Vec<Freed>,
    /// Those of which it takes two.
    pairs: Vec<[Freed; 2]>,
    /// Fraction of the whole gap that the refit leaves, as amplitude.
    rest: f64,
}

impl Directions {
    /// A refit that pays for its shifts as no plant would, while one direction pays for them all, has met what that direction means; what
    /// the refit leaves of the whole gap is left then, and less of it with what else was found: `beside_scatter` of it with what scatters.
    fn of(search: &Search<'_>, refit: &Candidate, without: &[&str], beside_scatter: f64) -> Self {
        let excess = refit.chi - 1.0;
        let whole = search.unfitted(&refit.hypothesis) - 1.0;
        let rest = (excess / whole.max(excess)).sqrt();
        let none = Self { first: None, sure: Vec::new(), pairs: Vec::new(), rest };
        let shifts = if rest * beside_scatter < MOSTLY { Shifts::of(search, refit) } else { None };
        let Some(shifts) = shifts else { return none };
        // Where next to nothing is left, what a direction pays for need not be as much.
        let (is_nothing, is_little) = (rest < BENT, rest < NEARLY_ALL);
        let pays_for_all =
            |freed: &Freed| is_little && freed.gain() > FREED_BESIDES && freed.cost < PAYS_FOR_ALL * freed.cost_without;
        let is_sure = |freed: &Freed| {
            let is_ordinary = is_nothing && freed.cost < BENT_COST && freed.gain() > FREED_OF_ALL;
            // What bends a gain may be most of the gap, a zero that is off is not bent like that.
            let is_large = (is_little || OFFSETS.contains(&freed.effect)) && is_large(search.bench, freed, refit);
            is_ordinary || is_large || pays_for_all(freed) && (is_nothing || freed.gain() > FREED_FIRST)
        };
        let mut known = shifts.freed(&[]);
        let is_one = known.first().is_none_or(|freed| freed.cost < BENT_COST);
        let mut pairs = if is_nothing && !is_one { shifts.in_pairs() } else { Vec::new() };
        pairs.retain(|pair| {
            pair.iter().all(|freed| {
                freed.cost < BENT_COST && freed.gain() > FREED_AT_NOISE && !without.contains(&freed.effect)
            })
        });
        known.retain(|freed| !without.contains(&freed.effect));
        let is_enough = |freed: &&Freed| {
            let is_ordinary = freed.cost < BENT_COST && freed.gain() > FREED_AT_NOISE;
            pays_for_all(freed) || is_sure(freed) || beside_scatter < NEARLY_ALL && is_ordinary
        };
        let first = known.iter().find(is_enough).cloned();
        let sure = if rest < MOSTLY { known.into_iter().filter(is_sure).collect() } else { Vec::new() };
        Self { first, sure, pairs, rest }
    }

    fn are_sure_of(&self, effect: &str) -> bool {
        self.sure.iter().any(|freed| freed.effect == effect)
    }
}

/// Whether a direction moves readings by so much more than what `fit` leaves that nothing left could have bent it.
fn is_large(bench: &Bench<'_>, freed: &Freed, fit: &Candidate) -> bool {
    let larger = moved_m(bench, freed) / fit.found.rms_m().max(f64::MIN_POSITIVE);
    freed.gain() > FREED_BESIDES && larger > MUCH_LARGER || freed.gain() > FREED_AT_NOISE && larger > FAR_LARGER
}

/// Rms of what a freed offset or gain moves the readings by, metres; zero for other directions, of which that is not known without a simulation.
fn moved_m(bench: &Bench<'_>, freed: &Freed) -> f64 {
    let reading_m = || {
        let squares = |record: &Record<'_>| record.log.displacement_m.iter().map(|y| y * y).sum::<f64>();
        let rows: usize = bench.records.iter().map(|record| record.log.len()).sum();
        (bench.records.iter().map(squares).sum::<f64>() / rows.max(1) as f64).sqrt()
    };
    match freed.effect {
        effect if OFFSETS.contains(&effect) => freed.value.abs(),
        "sensor_gain" | "amplifier_gain" => freed.value.abs() * reading_m(),
        _ => 0.0,
    }
}

/// Fraction of a log's gap that `fit` leaves, as amplitude, in the log where it leaves most. One sensor has one noise: what the fit leaves of
/// the log in the middle tells it better than a log's own differences, which a fast plant roughens. Of what it leaves of each log `scatter_m2` is
/// explained, if that is known.
fn left_of_worst(search: &Search<'_>, fit: &Candidate, refit: &Candidate, scatter_m2: &[f64]) -> f64 {
    let mean2 = |candidate: &Candidate| -> Vec<f64> { candidate.found.normal.logs.iter().map(Sums::mean_m2).collect() };
    let (before2, after2) = (mean2(refit), mean2(fit));
    let middle2 = middle(&after2);
    let logs = search.bench.records.iter().zip(before2.iter().zip(&after2)).enumerate();
    let left2 = logs.map(|(index, (record, (before2, after2)))| {
        let own2 = record.noise_m.powi(2);
        let noise2 = if middle2 < ROUGH * ROUGH * own2 { own2.min(middle2) } else { own2 };
        let scatter2 = scatter_m2.get(index).copied().unwrap_or_default();
        let (gap2, left2) = (before2 - noise2, (after2 - noise2 - scatter2).max(0.0));
        if gap2 > GAP_OF_LOG * noise2 && left2 > LEFT_OF_LOG * noise2 { left2 / gap2 } else { 0.0 }
    });
    left2.fold(0.0, f64::max).sqrt()
}

/// Power of what scatters in each log, metres squared: noise has the same everywhere, errors of the instants show where the plant moves.
fn scatter_of_logs(explanation: &Explanation, bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let Some((effect, _, scattered)) = &explanation.scatter else { return Vec::new() };
    let of_log = |(record, left): (&Record<'_>, &Remainder)| {
        if effect.id() != "sampling_jitter" {
            return scattered.excess_m2.max(0.0);
        }
        let velocity = &left.velocity_m_per_s[record.run_in..];
        scattered.jitter_s.powi(2) * velocity.iter().map(|v| v * v).sum::<f64>() / velocity.len().max(1) as f64
    };
    bench.records.iter().zip(remainders).map(of_log).collect()
}

/// The course with probabilities from scores, one for each explanation and then for `no_gap`, and from what of each belongs to `unknown`.
fn judged(mut course: Course, scores: &[f64], doubts: &[f64]) -> Course {
    let among = probabilities(scores);
    let mut probabilities: Vec<f64> = among.iter().zip(doubts).map(|(p, doubt)| p * (1.0 - doubt)).collect();
    course.unknown = among.iter().zip(doubts).map(|(p, doubt)| p * doubt).sum();
    course.no_gap = probabilities.pop().unwrap_or_default();
    for (explanation, probability) in course.explanations.iter_mut().zip(probabilities) {
        explanation.probability = probability;
    }
    course.explanations.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    course
}

/// Effects that only scatter tells.
fn by_scatter(
    scattered: &Scattered,
    refit: &Candidate,
    floor: f64,
    without: &[&str],
    best_share: f64,
    has_lines: bool,
) -> Vec<Explanation> {
    let mut found = Vec::new();
    let mut add = |id: &'static str, form: &str, value: f64, left: f64| {
        if without.contains(&id) || value <= 0.0 {
            return;
        }
        let Some(effect) = find(id) else { return };
        let Some(form) = effect.forms().iter().find(|f| f.name == form) else { return };
        let explanation = Explanation::by_fit(refit, left.clamp(0.0, 1.0), floor).and(effect.id());
        found.push(Explanation { scatter: Some((effect, form, *scattered)), ..explanation });
    };
    if scattered.jitter_s > 8.0 * scattered.jitter_sigma_s {
        // A line through bins misses a tenth of the power now and then.
        let left = ((1.0 - scattered.jitter_m2 / scattered.moving_m2).abs() - 0.1).max(0.0) + 0.02;
        let rival = if scattered.multiplied_m2 > scattered.jitter_m2 { 0.3 } else { 0.0 };
        let returning = (scattered.returning - OF_LATENESS).max(0.0) / (1.0 - OF_LATENESS);
        add("sampling_jitter", "white", scattered.jitter_s, (left + rival).hypot(returning.sqrt()));
    }
    // Noise neither has lines nor follows anything that the registry's directions follow, or its octaves tell that it is noise.
    let [beyond, beyond_of_log] = scattered.beyond_any_noise;
    let uneven = scattered.unevenness.hypot(beyond);
    let is_even = uneven < 1.0 && best_share < HOPELESS && !has_lines;
    let is_told = beyond < NOT_NOISE && beyond_of_log < NOT_NOISE_OF_LOG;
    let left = [(is_even, 0.4 * uneven), (is_told, beyond.sqrt())];
    if let Some(left) = left.into_iter().filter(|(is, _)| *is).map(|(_, left)| left).reduce(f64::min) {
        add("noise_excess", "coloured", scattered.excess_m2.max(0.0).sqrt(), left);
    }
    found
}

/// Least fraction that an effect leaves which the numbers of `fit` tell: numbers that a wrong form has bent say little, at the noise they are what
/// they are.
fn bent(fit: &Candidate, floor: f64) -> f64 {
    if fit.chi < AT_NOISE { floor } else { floor.max(BENT) }
}

/// Effects that the nominal numbers imitate, one or two at once, on top of `fit`; each must save more than `least`.
fn by_symmetry<F: Into<Vec<Freed>>>(
    freed: Vec<F>,
    fit: &Candidate,
    left: f64,
    floor: f64,
    without: &[&str],
    least: f64,
) -> Vec<Explanation> {
    let is_worth = |freed: &Vec<Freed>| freed.iter().all(|f| !without.contains(&f.effect) && f.gain() > least);
    let freed: Vec<Vec<Freed>> = freed.into_iter().map(Into::into).filter(is_worth).collect();
    let doubtful = |freed: &Freed| freed.cost.max(PRIOR_MOST / PRIOR_WEIGHT);
    let least = freed.iter().map(|freed| doubtful(&freed[0])).fold(f64::INFINITY, f64::min);
    let explanation = |freed: Vec<Freed>| {
        let alone = Explanation::by_fit(fit, left, floor);
        let mut explanation = freed.iter().fold(alone, |explanation, freed| explanation.and(freed.effect));
        explanation.judged.prior_cost = freed[0].cost;
        // However doubtful all of them are, one fit's directions are told by what they cost.
        explanation.dearer = 2.0 * PRIOR_WEIGHT * (doubtful(&freed[0]) - least);
        Explanation { freed, ..explanation }
    };
    freed.into_iter().map(explanation).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use std::sync::atomic::AtomicUsize;

    /// Errors of the instants show where the plant moves, noise shows everywhere.
    #[test]
    fn each_log_has_its_own_share_of_what_scatters() {
        let model = thesis();
        let rows = 400;
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; rows], displacement_m: vec![0.0; rows], ..Log::default() };
        let records = vec![record(&log, &model.chain(), None), record(&log, &model.chain(), None)];
        let bench = Bench::new(&model, records);
        let search = Search { bench: &bench, simulations: &AtomicUsize::new(0) };
        let refit = search.refit(Freedom::Rest);
        let moving = |velocity: f64| Remainder { residual_m: vec![0.0; rows], velocity_m_per_s: vec![velocity; rows] };
        let scattered = Scattered {
            excess_m2: 1e-16,
            jitter_s: 2e-6,
            jitter_sigma_s: 1e-8,
            jitter_m2: 2e-16,
            moving_m2: 2e-16,
            ..Scattered::default()
        };
        let found = by_scatter(&scattered, &refit, 0.01, &[], 0.0, false);
        let of = |id: &str| {
            let explanation = found.iter().find(|e| e.judged.ids == [id]).expect("told by its scatter");
            scatter_of_logs(explanation, &bench, &[moving(0.0), moving(0.01)])
        };
        let jitter = of("sampling_jitter");
        assert!(jitter[0] == 0.0 && (jitter[1] - 4e-16).abs() < 1e-24, "{jitter:?}");
        assert_eq!(of("noise_excess"), [1e-16; 2]);
        assert!(scatter_of_logs(&Explanation::by_fit(&refit, 1.0, 0.01), &bench, &[]).is_empty());
    }
}
