//! The course of a diagnosis: refit, screen, fit, pair, judge.

use super::directions::{Directions, FREED_AT_NOISE, FREED_BESIDES, MOSTLY, NEARLY_ALL, is_large, pays_alone};
use super::evidence::{Judged, PRIOR_MOST, PRIOR_WEIGHT, SHARPNESS, probabilities};
use super::explanation::{Explanation, Promised, bent, by_scatter, by_symmetry, left_of_worst_log, scatter_of_logs};
use super::fits::{AS_WELL, FOUND, Fits, PAIR_BEYOND};
use super::hidden::{Quiet, below_noise};
use super::hypothesis::{Freedom, Hypothesis};
use super::octaves::{Octave, left_of_worst_octave, octaves_of, widened};
use super::refit::{
    AT_NOISE, BENT_COST, come_home, gap_over_least, has_gap, is_bent, led_without_one, nominal, refitted,
};
use super::screen::{Lead, Starts};
use super::search::{Candidate, Remainder, Search, cheaper};
use super::spread::{Scattered, scattered};
use super::symmetry::{Freed, RARER, Shifts, freed, unexplained};
use plant_sim::effects::REGISTRY;

/// Chi-square that a comparison of two fits resolves.
pub(super) const RESOLVED: f64 = 20.0;
/// A fit that leaves less than this may show the refit a better minimum, and one that leaves less than this is a better one.
const MUCH_BETTER: f64 = 0.7;
/// A fit near the noise is at it, but not where that takes less than this of the gap's power away.
const MOST_OF_NOISE: f64 = 0.3;
/// What is a wave for more than this share of its power is no noise, however smooth its octaves: an octave tells no line.
const MOST_OF_GAP: f64 = 0.5;
const WAVES: [&str; 2] = ["mains_hum", "periodic_force"];
/// Power that a fit may leave beyond the best one's for its rest to scatter like that one's, as amplitude, in shares of what that leaves.
const HARDLY_MORE: f64 = 0.2;
/// Scatter that leaves less than this of a gap may hide what is small beside it.
const SCATTERS: f64 = 0.3;
/// Weight of what octaves show of an effect beside what scatters, and the most that it counts.
const SHOWN: f64 = 0.03;
const SHOWN_MOST: f64 = 8.0;
/// What freeing one of a dozen directions must earn beyond its cost: ordinary numbers of one plant in four hundred earn as much.
const LOOK_ELSEWHERE: f64 = 7.0;
/// The same of what shows below the noise, which lattices and lines do at times, and how likely it is none of the registry's: its form is told roughly.
const LOOK_BELOW: f64 = 12.0;
const DOUBT_BELOW: f64 = 0.2;
/// How likely an unknown effect is that leaves no gap.
const NO_UNKNOWN: f64 = 0.007;

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

    /// Whether no explanation is by itself as probable as that there is none: a refit is led anew more often than the verdict is `unknown`.
    fn is_unknown(&self) -> bool {
        self.has_gap() && self.explanations.iter().all(|explanation| explanation.probability < self.unknown)
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

    pub(super) fn new(refit: Candidate, explanations: Vec<Explanation>, scattered: Scattered) -> Self {
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
    // What a fit with states of its own at the start has found, starts in equilibrium may reach as well, if they are sought anew with its numbers.
    let again = best.filter(shows_better).map(|fit| match search.refit_again(&course.refit, fit) {
        again if fit.hypothesis.has_start() => {
            come_home(search, search.resettled(again, &fit.found.z, &[]), &nominal(search))
        }
        again => again,
    });
    let is_better = |again: &Candidate| again.left(&course.refit, 1.0) < MUCH_BETTER;
    // What nothing explains may be no more than a log that is locked.
    let is_unlocked = |led: &Candidate| !has_gap(led) || led.chi < course.refit.chi && is_better(led);
    let unlocked = || course.is_unknown().then(|| led_without_one(search, course.refit.clone())).filter(is_unlocked);
    match again.filter(is_better).or_else(unlocked) {
        Some(refit) => explain(search, refit, without, say),
        None => course,
    }
}

/// Least fraction of the gap that `refit` leaves above `noise` which a comparison of fits resolves.
fn least_fraction(refit: &Candidate, noise: f64) -> f64 {
    (RESOLVED / (refit.rows() as f64 * (refit.chi - noise).max(1e-9))).sqrt().min(1.0)
}

/// Explains what `refit` leaves.
fn explain(search: &Search<'_>, refit: Candidate, without: &[&str], say: Say<'_>) -> Course {
    let remainders = search.play(&refit);
    let scattered = scattered(search.bench, &remainders, true);
    let fitting = Fits { search, refit: &refit, without, say };
    if !has_gap(&refit) {
        let below = below_noise(&fitting);
        let (refit, below) = below.unwrap_or_else(|| (refit.clone(), Vec::new()));
        return without_gap(&fitting, refit, scattered, &below);
    }
    let starts = Starts::of(search.bench, &remainders);
    say("screening the registry", 0.15);
    let leads = search.screen(&refit, &starts, without);
    let mut fits = fitting.all(&leads, &remainders);
    let is_well = |fit: &Candidate| fit.chi < AT_NOISE && fit.found.prior_cost < BENT_COST;
    if refit.found.prior_cost > BENT_COST && !fits.iter().any(is_well) {
        // No score tells of a setting that starts and numbers have taken for themselves.
        fits.extend(set_in_each_log(search, &refit, without).into_iter().map(|(fit, _)| fit));
    }
    let judge = Judge::new(search, &refit, &remainders, without, &fits, &leads, &starts);
    let mut scatter = judge.by_scatter(&scattered, &refit);
    // A fit that leaves next to nothing has nothing hidden beside it.
    let is_open = judge.best.is_none_or(|best| judge.left(best) > PAIR_BEYOND);
    let scatters = scatter.iter().filter(|explanation| is_open && explanation.judged.left < SCATTERS);
    let quiet = scatters
        .min_by(|a, b| a.judged.left.total_cmp(&b.judged.left))
        .and_then(|explanation| Quiet::beside(search.bench, explanation, &remainders));
    // Of ten minutes they are two hundred megabytes.
    drop(remainders);
    let hidden = quiet.as_ref().map_or_else(Vec::new, |quiet| quiet.hidden(&fitting));
    let whole = hidden.iter().filter(|fit| judge.left(fit) <= PAIR_BEYOND);
    let mut explanations: Vec<Explanation> = fits.iter().chain(whole).map(|fit| judge.by_fit(fit)).collect();
    let beside = judge.by_scatter_beside_fits(&hidden, quiet.as_ref(), &mut scatter);
    explanations.extend(scatter.iter().cloned());
    explanations.extend(beside);
    judge.by_directions(&mut explanations, scatter);
    let score = |e: &Explanation| e.judged.score() - 0.5 * e.rarer() + (1.0 - e.doubted).ln();
    let mut scores: Vec<f64> = explanations.iter().map(score).collect();
    // That there is no gap leaves all of it, and becomes less likely with every time that it is larger than one to speak of.
    let nothing = Explanation::by_fit(&refit, 1.0, judge.floor);
    scores.push(nothing.judged.score() - SHARPNESS * gap_over_least(&refit).ln());
    let doubts: Vec<f64> = explanations.iter().chain([&nothing]).map(|e| e.judged.doubt()).collect();
    judged(Course { leads, line_hz: starts.line_hz, ..Course::new(refit, explanations, scattered) }, &scores, &doubts)
}

/// Explains the numbers of a refit that leaves no gap: only the cost of their shifts speaks, and it is a proper chi-square.
fn without_gap(fitting: &Fits<'_>, refit: Candidate, scattered: Scattered, below: &[(Candidate, f64)]) -> Course {
    let (search, without) = (fitting.search, fitting.without);
    let floor = least_fraction(&refit, 1.0);
    let shifts = Shifts::of(search, &refit);
    let freed = shifts.as_ref().map_or_else(Vec::new, |shifts| shifts.freed(&[]));
    let cost = cost_of_shifts(&freed, &refit);
    // One direction that leaves ordinary shifts is enough.
    let is_one = freed.first().is_none_or(|freed| freed.cost < BENT_COST);
    let pairs = shifts.filter(|_| !is_one).map_or_else(Vec::new, |shifts| shifts.in_pairs());
    let mut explanations = by_symmetry(freed, &refit, 0.0, floor, without, 0.0);
    explanations.extend(by_symmetry(pairs, &refit, 0.0, floor, without, FREED_AT_NOISE));
    let score = |e: &Explanation| -0.5 * (e.judged.prior_cost + e.rarer()) - LOOK_ELSEWHERE * e.freed.len() as f64;
    let mut scores: Vec<f64> = explanations.iter().map(score).collect();
    // A log whose rows go together counts less than its rows, whatever others do.
    let weights = search.independent_weights(&refit);
    let misfit = |fit: &Candidate| fit.found.normal.cost(&weights) + search.cost_of_starts(fit);
    // Each number more speaks against a fit (Akaike 1974).
    let score_of = |fit: &Candidate, cost: f64, more: usize| {
        -0.5 * (cost + misfit(fit) - misfit(&refit)) - more as f64 - LOOK_ELSEWHERE
    };
    if cost > BENT_COST {
        let more = search.bench.records.len().saturating_sub(1);
        let settings = set_in_each_log(search, &refit, without);
        // Where the refit is ordinary from there, the setting was none: it has only led the refit out of where its starts had locked it.
        let mut led = settings.iter().map(|(fit, _)| search.refit_again(&refit, fit));
        if let Some(led) = led.find(|led| !has_gap(led) && !is_bent(led) && cost_of_fit(search, led) < BENT_COST) {
            return from(fitting, led);
        }
        for (fit, cost) in settings {
            scores.push(score_of(&fit, cost, more));
            explanations.push(Explanation::by_fit(&fit, 0.0, floor));
        }
    }
    let least = explanations.iter().map(|explanation| explanation.judged.prior_cost).fold(cost, f64::min);
    if least > BENT_COST {
        if is_bent(&refit) {
            let led = led_without_one(search, refit.clone());
            if !has_gap(&led) && !is_bent(&led) {
                return from(fitting, led);
            }
        }
        for (fit, cost) in ordinary(search, fitting.hidden_in_numbers().into_iter()) {
            scores.push(score_of(&fit, cost, fit.found.z.len() - refit.found.z.len()));
            explanations.push(Explanation::by_fit(&fit, 0.0, floor));
        }
    }
    // What neither directions nor effects make ordinary is hardly known. No gap is resolved here, so that no floor counts.
    let doubt = |explanation: &Explanation| {
        let unexplained = explanation.freed.first().map_or(0.0, |freed| unexplained(freed.cost, cost));
        let judged = Judged { of_worst: unexplained, floor: 0.0, ..explanation.judged.clone() };
        if unexplained > 0.0 { judged.doubt().max(NO_UNKNOWN) } else { NO_UNKNOWN }
    };
    let mut doubts: Vec<f64> = explanations.iter().map(doubt).collect();
    for (fit, shows) in below {
        scores.push(SHOWN * shows - 0.5 * cost_of_fit(search, fit) - LOOK_BELOW);
        doubts.push(DOUBT_BELOW);
        explanations.push(Explanation::by_fit(fit, 0.0, floor));
    }
    scores.push(-0.5 * cost);
    doubts.push(NO_UNKNOWN);
    judged(Course::new(refit, explanations, scattered), &scores, &doubts)
}

/// Explains the numbers of a refit that was led out of where it was bent.
fn from(fitting: &Fits<'_>, led: Candidate) -> Course {
    let bench = fitting.search.bench;
    let fitting = Fits { refit: &led, ..*fitting };
    let scattered = scattered(bench, &fitting.search.play(&led), true);
    // Not one that is bent again, which would be led again.
    let below = below_noise(&fitting).filter(|(refit, _)| !is_bent(refit));
    let (refit, below) = below.unwrap_or_else(|| (led.clone(), Vec::new()));
    without_gap(&fitting, refit, scattered, &below)
}

/// What the shifts of a fit cost with none of its `directions` freed; what the mass is off by is a shift as well.
fn cost_of_shifts(directions: &[Freed], fit: &Candidate) -> f64 {
    directions.first().map_or(fit.found.prior_cost, |freed| freed.cost_without)
}

/// The same of a fit whose directions nobody has freed yet.
fn cost_of_fit(search: &Search<'_>, fit: &Candidate) -> f64 {
    cost_of_shifts(&freed(search, fit), fit)
}

/// Fits at the noise with ordinary numbers and a sensor that was set anew for each log, where a refit has numbers that are none: starts and numbers make up for
/// such a zero or gain between them. Fits come with what their shifts cost.
fn set_in_each_log(search: &Search<'_>, refit: &Candidate, without: &[&str]) -> Vec<(Candidate, f64)> {
    // Where a setting moves a log far, a start that began at rest takes it for itself.
    let seek = |hypothesis: &Hypothesis| {
        cheaper(search.led_by_others(search.from_rest(hypothesis)), search.from_first_stretches(hypothesis))
    };
    let effects = REGISTRY.iter().filter(|effect| !without.contains(&effect.id()));
    let forms = effects.flat_map(|effect| effect.forms().iter().map(move |form| (*effect, form)));
    let fits = forms.filter_map(|(effect, form)| {
        let hypothesis = refit.hypothesis.with(effect, form, &search.bench.scales());
        let is_setting = hypothesis.installed.last().is_some_and(|installed| installed.is_setting());
        is_setting.then(|| seek(&hypothesis))
    });
    ordinary(search, fits)
}

/// Those of `fits` that are at the noise with ordinary numbers, and what the shifts of each cost.
fn ordinary(search: &Search<'_>, fits: impl Iterator<Item = Candidate>) -> Vec<(Candidate, f64)> {
    let with_cost = fits.filter(|fit| fit.chi < AT_NOISE).map(|fit| {
        let cost = cost_of_fit(search, &fit);
        (fit, cost)
    });
    with_cost.filter(|(_, cost)| *cost < BENT_COST).collect()
}

/// What explanations of a gap are measured by.
struct Judge<'a> {
    search: &'a Search<'a>,
    refit: &'a Candidate,
    /// What the refit leaves, in octaves.
    octaves: Vec<Octave>,
    without: &'a [&'a str],
    fits: &'a [Candidate],
    /// The fit that leaves least.
    best: Option<&'a Candidate>,
    /// Least fraction that a comparison of fits resolves.
    floor: f64,
    /// Mean square of the noise, in units of what the logs say of it.
    noise: f64,
    /// What the screening of the refit's gap speaks for.
    promised: Promised,
}

impl<'a> Judge<'a> {
    fn new(
        search: &'a Search<'a>,
        refit: &'a Candidate,
        remainders: &[Remainder],
        without: &'a [&'a str],
        fits: &'a [Candidate],
        leads: &[Lead],
        starts: &Starts,
    ) -> Self {
        let best = fits.iter().min_by(|a, b| a.chi.total_cmp(&b.chi));
        // The noise is known to a few per cent: a fit that comes that near is at it.
        let at_noise = AT_NOISE.min(1.0 + MOST_OF_NOISE * (refit.chi - 1.0));
        let noise = best.map(|best| best.chi).filter(|chi| *chi < at_noise).unwrap_or(1.0);
        let lead = leads.first();
        let promised = Promised {
            best_share: lead.map_or(0.0, |lead| lead.share),
            has_lines: !starts.line_hz.is_empty(),
            is_wave: lead.is_some_and(|lead| WAVES.contains(&lead.effect.id()) && lead.share > MOST_OF_GAP),
        };
        let octaves = octaves_of(search.bench, remainders);
        let floor = least_fraction(refit, noise.min(1.0));
        Self { search, refit, octaves, without, fits, best, floor, noise, promised }
    }

    /// Fraction of the gap that `fit` leaves, as amplitude.
    fn left(&self, fit: &Candidate) -> f64 {
        fit.left(self.refit, self.noise)
    }

    fn by_fit(&self, fit: &Candidate) -> Explanation {
        // Where a fit has a part that fits as well, what it leaves less is no merit.
        let as_good = |part: &&Candidate| {
            part.hypothesis.installed.len() == fit.hypothesis.installed.len()
                && part.is_part_of(fit)
                && part.chi < AS_WELL * fit.chi
        };
        let left = self.fits.iter().filter(as_good).map(|part| self.left(part)).fold(self.left(fit), f64::max);
        let mut explanation = Explanation::by_fit(fit, left, self.floor);
        let mut mirrored = fit.hypothesis.installed.iter().filter_map(|installed| installed.form.mirrors);
        if mirrored.any(|id| !self.without.contains(&id)) {
            explanation.outdo(0.5 * RARER);
        }
        let octaves = octaves_of(self.search.bench, &self.search.play(fit));
        explanation.judged.of_worst = self.left_of_worst(fit, &octaves, &[]);
        explanation
    }

    /// Fraction of the gap that `fit` leaves in the log or octave where it leaves most, `scatter_m2` of each log being explained.
    fn left_of_worst(&self, fit: &Candidate, octaves: &[Octave], scatter_m2: &[f64]) -> f64 {
        let of_octave = left_of_worst_octave(self.search.bench, &self.octaves, octaves, scatter_m2);
        let of_logs_m2 = widened(scatter_m2, octaves);
        left_of_worst_log(self.search, fit, self.refit, &of_logs_m2).max(of_octave)
    }

    fn by_scatter(&self, scattered: &Scattered, fit: &Candidate) -> Vec<Explanation> {
        // A fit has taken the wave, if there is one.
        let is_wave = self.promised.is_wave && fit.hypothesis.installed.is_empty();
        by_scatter(scattered, fit, self.floor, self.without, Promised { is_wave, ..self.promised })
    }

    /// What fits leave may scatter as well: the best one, and those that leave hardly more, and those that scatter has `hidden`. Scatter explains none of
    /// what they leave beyond it. What shows of a fit where it is `quiet` speaks against what has it not, against the `scatter` of the refit as well.
    fn by_scatter_beside_fits(
        &self,
        hidden: &[Candidate],
        quiet: Option<&Quiet>,
        scatter: &mut [Explanation],
    ) -> Vec<Explanation> {
        let all = || self.fits.iter().chain(hidden);
        let best = all().min_by(|a, b| a.chi.total_cmp(&b.chi));
        let Some(best) = best.filter(|best| self.left(best) > PAIR_BEYOND) else { return Vec::new() };
        let bench = self.search.bench;
        let gap = (self.refit.chi - self.noise).max(1e-12);
        let beyond = |fit: &Candidate| ((fit.chi - best.chi) / gap).max(0.0).sqrt();
        let of_fit = |fit: &Candidate| {
            let remainders = self.search.play(fit);
            let octaves = octaves_of(bench, &remainders);
            let mut explanations = self.by_scatter(&scattered(bench, &remainders, false), fit);
            for explanation in &mut explanations {
                explanation.judged.left = (explanation.judged.left * self.left(fit)).hypot(beyond(fit));
                // Scatter explains no log that the fit beside it misses by more, and no octave; what it does in the mean is no other cause.
                let scatter_m2 = scatter_of_logs(explanation, bench, &remainders);
                if explanation.judged.ids.len() > 1 {
                    explanation.judged.of_worst = self.left_of_worst(fit, &octaves, &scatter_m2);
                }
            }
            let shows = quiet.map_or(0.0, |quiet| quiet.shows(bench, &remainders));
            explanations.into_iter().map(move |explanation| (explanation, shows))
        };
        let near = all().filter(|fit| beyond(fit) < HARDLY_MORE * self.left(best));
        let mut beside: Vec<(Explanation, f64)> = near.flat_map(of_fit).collect();
        if let Some(quiet) = quiet {
            let own = beside.iter().filter(|(explanation, _)| quiet.is_of(explanation));
            let most = own.map(|(_, shows)| *shows).fold(0.0, f64::max);
            let outdone = |shows: f64| (SHOWN * (most - shows)).min(SHOWN_MOST);
            let own = beside.iter_mut().filter(|(explanation, _)| quiet.is_of(explanation));
            own.for_each(|(explanation, shows)| explanation.outdo(outdone(*shows)));
            let own = scatter.iter_mut().filter(|explanation| quiet.is_of(explanation));
            own.for_each(|explanation| explanation.outdo(outdone(0.0)));
        }
        beside.into_iter().map(|(explanation, _)| explanation).collect()
    }

    /// Adds what the nominal numbers imitate: beside `scatter` of the refit, beside fits, and alone. Where they are sure, those without them pay.
    fn by_directions(&self, explanations: &mut Vec<Explanation>, scatter: Vec<Explanation>) {
        // Scatter bends no number: beside it a direction need not pay more than beside a fit.
        let well: Vec<Explanation> =
            scatter.into_iter().filter(|explanation| explanation.judged.left < NEARLY_ALL).collect();
        let beside_scatter = well.iter().map(|explanation| explanation.judged.left).fold(1.0, f64::min);
        let directions = Directions::of(self.search, self.refit, self.without, beside_scatter);
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
            let is_alone = |e: &Explanation| e.scatter.is_some() && e.candidate.hypothesis.installed.is_empty();
            pay_for_shifts(explanations, is_alone);
            explanations.extend(well.into_iter().map(|explanation| explanation.along(first, rest)));
        }
        for fit in self.with_directions() {
            self.by_directions_beside(fit, &directions, explanations);
        }
        let alone = bent(self.refit, self.floor);
        let mut sure = by_symmetry(directions.sure, self.refit, rest, alone, self.without, 0.0);
        // Shifts that it does not pay for are as little explained as a log or an octave that a fit misses.
        for explanation in &mut sure {
            explanation.judged.of_worst = explanation.freed.iter().map(Freed::unexplained).fold(0.0, f64::max);
        }
        if !directions.pairs.is_empty() {
            pay_for_shifts(&mut sure, |_| true);
        }
        explanations.extend(sure);
        explanations.extend(by_symmetry(directions.pairs, self.refit, rest, alone, self.without, 0.0));
    }

    /// Fits beside which a direction may be what is wrong besides: the best one, the best single one, as one direction may be enough where the best of all
    /// takes two effects, and all whose numbers are far off: where one of them pays for that, the others do.
    fn with_directions(&self) -> Vec<&'a Candidate> {
        let singles = self.fits.iter().filter(|fit| fit.hypothesis.installed.len() == 1);
        let single = singles.min_by(|a, b| a.chi.total_cmp(&b.chi));
        let bent = self.fits.iter().filter(|fit| fit.found.prior_cost > FREED_AT_NOISE);
        let mut all: Vec<&Candidate> = Vec::new();
        for fit in self.best.into_iter().chain(single).chain(bent).filter(|fit| self.left(fit) < MOSTLY) {
            if all.iter().all(|known| !known.hypothesis.has_effects_of(&fit.hypothesis)) {
                all.push(fit);
            }
        }
        all
    }

    /// What the nominal numbers imitate leaves a fit as it is. A wrong form bends the nominal numbers as well; only a fit at the noise can be
    /// believed about them, or one of which the refit knew the direction before, or where one number has gone far and all others have not.
    fn by_directions_beside(&self, fit: &Candidate, directions: &Directions, explanations: &mut Vec<Explanation>) {
        let left = self.left(fit);
        let mut freed = freed(self.search, fit);
        freed.retain(|freed| !self.without.contains(&freed.effect));
        let (mut known, others): (Vec<Freed>, Vec<Freed>) =
            freed.into_iter().partition(|freed| directions.are_sure_of(freed.effect));
        known.retain(|freed| freed.gain() > FREED_AT_NOISE);
        let is_ordinary = |freed: &Freed| fit.chi < AT_NOISE && freed.cost < BENT_COST;
        let is_believed = |freed: &Freed| freed.gain() > FREED_BESIDES || is_ordinary(freed);
        let is_known = |freed: &Freed| left < FOUND && is_believed(freed) || is_large(self.search.bench, freed, fit);
        let (others, doubtful): (Vec<Freed>, Vec<Freed>) = others.into_iter().partition(is_known);
        let alone: Vec<Freed> = doubtful.into_iter().filter(pays_alone).collect();
        let pays = !known.is_empty()
            || !alone.is_empty()
            || others.iter().any(|freed| is_ordinary(freed) && freed.gain() > FREED_AT_NOISE);
        if pays {
            let is_bent = |e: &Explanation| e.freed.is_empty() && e.judged.prior_cost > BENT_COST;
            let is_of = |e: &Explanation| e.candidate.hypothesis.has_effects_of(&fit.hypothesis) && e.scatter.is_none();
            pay_for_shifts(explanations, |e| is_bent(e) && is_of(e));
        }
        let (rest, floor) = (directions.rest, self.floor);
        let mut beside = by_symmetry(known, fit, left * rest, floor * rest, self.without, 0.0);
        let mut alone = by_symmetry(alone, fit, left, bent(fit, floor), self.without, FREED_BESIDES);
        if !beside.is_empty() || !alone.is_empty() {
            let judged = self.by_fit(fit).judged;
            // What is none of the registry's beside a sure direction leaves that direction alone.
            beside.iter_mut().for_each(|explanation| explanation.doubted = judged.doubt());
            // One number that has gone far makes up for no log or octave that the fit misses.
            alone.iter_mut().for_each(|explanation| explanation.judged.of_worst = judged.of_worst);
        }
        explanations.extend(beside);
        explanations.extend(by_symmetry(others, fit, left, bent(fit, floor), self.without, FREED_AT_NOISE));
        explanations.extend(alone);
    }
}

/// Without the direction that makes the numbers ordinary, those that are `alone` have to pay for shifts that no plant has.
fn pay_for_shifts(explanations: &mut [Explanation], alone: impl Fn(&Explanation) -> bool) {
    for explanation in explanations.iter_mut().filter(|explanation| alone(explanation)) {
        explanation.judged.prior_cost = PRIOR_MOST / PRIOR_WEIGHT;
    }
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
