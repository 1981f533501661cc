//! The course of a diagnosis: refit, screen, fit, pair, judge.

use super::bench::{Bench, Freedom, HeldOut};
use super::evidence::{Judged, probabilities, unknown_score};
use super::lines::{lines, resonances};
use super::normal::reader;
use super::screen::{Lead, screen};
use super::search::{Candidate, Search};
use super::spread::{Scatter, Scattered, scattered};
use super::symmetry::{Freed, SYMMETRIC, freed};
use plant_sim::effects::{Effect, Form, Kind, find};

/// Gap beyond the noise, in shares of the noise, below which there is none to speak of.
const LEAST_GAP: f64 = 0.35;
/// A lead is followed if it explains this share of what the best one does, or is among the first few.
const LEAST_SHARE: f64 = 0.25;
const FIRST: usize = 3;
/// Share below which not even the best lead says anything.
const HOPELESS: f64 = 0.1;
/// Once a fit leaves less than this, only leads are followed that explain as much as its own.
const FOUND: f64 = 0.03;
const AS_MUCH: f64 = 0.85;
const MOST_FITS: usize = 8;
/// Lags look alike to a score test: if one scores, all are fitted.
const LAGS: [&str; 4] = ["transport_delay", "amplifier_bandwidth", "sensor_bandwidth", "amplifier_slew"];
/// An entry whose fit leaves more than this is tried in its other forms as well.
const WELL: f64 = 0.01;
/// A single explanation that leaves more than this invites a second effect.
const PAIR_BEYOND: f64 = 0.06;
/// .. which must take at least this much of what was left.
const PAIR_TAKES: f64 = 0.5;
/// Least chi-square by which a freed symmetry must lower the shifts' cost: four sigma, and the look-elsewhere of nine numbers.
const FREED_LEAST: f64 = 12.0;
/// The same beside an effect that was fitted.
const FREED_BESIDES: f64 = 60.0;
/// Mean square, in units of the noise, up to which a fit counts as being at the noise.
const AT_NOISE: f64 = 1.06;
/// What freeing one of a dozen directions must earn beyond its cost, and how much less likely an unknown effect is that leaves no gap.
const LOOK_ELSEWHERE: f64 = 6.0;
const NO_UNKNOWN: f64 = 5.0;
/// Share of the residual's power in the first tenth of the logs that suggests their start.
const START_SHARE: f64 = 0.4;

/// One explanation of the gap, fitted and judged.
#[derive(Clone)]
pub struct Explanation {
    /// What was judged.
    pub judged: Judged,
    /// Probability.
    pub probability: f64,
    /// The fit, or the refit where the effect is not in the simulation.
    pub candidate: Candidate,
    /// The direction that was freed, for an effect that the nominal numbers imitate.
    pub freed: Option<Freed>,
    /// The number that scatter tells, for an effect that no simulation predicts: form and parameter values.
    pub scatter: Option<(&'static dyn Effect, &'static Form, Vec<f64>)>,
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

/// What a course tells while it runs.
pub type Say<'a> = &'a (dyn Fn(&str, f64) + Sync);

/// Runs the course.
pub fn course(search: &Search<'_>, freedom: Freedom, without: &[&str], say: Say<'_>) -> Course {
    let bench = search.bench;
    say("refitting the nominal plant", 0.02);
    let refit = search.refit(freedom);
    let residuals_m = search.residuals_m(&refit);
    let scattered = scatter(search, &refit, &residuals_m);
    let rows: usize = refit.found.normal.logs.iter().map(|log| log.rows).sum();
    let excess = refit.chi - 1.0;
    // Least fraction that a comparison of fits resolves: a chi-square of 20.
    let floor = (20.0 / (rows as f64 * excess.max(1e-9))).sqrt().min(1.0);
    let gap = excess > LEAST_GAP * LEAST_GAP;
    let line_hz = if gap { lines(bench, &residuals_m) } else { Vec::new() };
    let mut leads = Vec::new();
    let mut fits: Vec<Candidate> = Vec::new();
    if gap {
        say("screening the registry", 0.15);
        let skipped: Vec<&str> = SYMMETRIC.iter().chain(without).copied().collect();
        let starts = [&line_hz[..], &resonances(bench, &residuals_m)];
        leads = screen(bench, &refit.hypothesis, &refit.found, starts, &skipped, search.simulations);
        fits = fit_leads(search, &refit, &leads, &residuals_m, without, say);
    }
    let mut explanations = Vec::new();
    // The noise is known to a few per cent: a fit that comes that near is at it.
    let best_chi = fits.iter().map(|f| f.chi).fold(f64::INFINITY, f64::min);
    let best_chi = if best_chi < AT_NOISE { best_chi } else { 1.0 };
    let left = |chi: f64| ((chi - best_chi).max(0.0) / (refit.chi - best_chi).max(1e-12)).sqrt();
    let explain = |candidate: &Candidate| Explanation {
        judged: Judged {
            ids: candidate.hypothesis.ids(),
            left: left(candidate.chi),
            floor,
            prior_cost: candidate.found.prior_cost,
            parameters: candidate.hypothesis.installed.iter().map(|i| i.axes.len()).sum(),
        },
        probability: 0.0,
        candidate: candidate.clone(),
        freed: None,
        scatter: None,
    };
    if gap {
        explanations.extend(fits.iter().map(explain));
        let best_share = leads.first().map_or(0.0, |lead| lead.share);
        explanations.extend(by_scatter(&scattered, &refit, floor, without, best_share, !line_hz.is_empty()));
    }
    // What the nominal numbers imitate leaves the fit as it is: on the refit, and on the best explanation.
    if !gap {
        explanations.extend(by_symmetry(bench, &refit, 0.0, floor, without, FREED_LEAST));
    } else if let Some(best) = fits.iter().min_by(|a, b| a.chi.total_cmp(&b.chi)) {
        // A wrong form bends the nominal numbers as well; only a fit at the noise can be believed about them.
        if left(best.chi) < FOUND {
            explanations.extend(by_symmetry(bench, best, left(best.chi), floor, without, FREED_BESIDES));
        }
    }
    let mut scores: Vec<f64> = explanations.iter().map(|e| e.judged.score()).collect();
    // Last two: nothing at all, and unknown. Without a gap only the cost of the shifts speaks, and it is a proper chi-square.
    if gap {
        let left = 1.0;
        let nothing = Judged { ids: Vec::new(), left, floor, prior_cost: refit.found.prior_cost, parameters: 0 };
        scores.extend([nothing.score(), unknown_score()]);
    } else {
        for (score, explanation) in scores.iter_mut().zip(&explanations) {
            *score = -0.5 * explanation.judged.prior_cost - LOOK_ELSEWHERE;
        }
        let nothing = -0.5 * refit.found.prior_cost;
        let best = scores.iter().copied().fold(nothing, f64::max);
        scores.extend([nothing, best - NO_UNKNOWN]);
    }
    let probabilities = probabilities(&scores);
    for (explanation, &probability) in explanations.iter_mut().zip(&probabilities) {
        explanation.probability = probability;
    }
    let [.., no_gap, unknown] = probabilities[..] else { unreachable_course() };
    explanations.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Course { refit, explanations, unknown, no_gap, leads, scattered, line_hz }
}

fn unreachable_course() -> ! {
    unreachable!("two scores are always pushed")
}

fn scatter(search: &Search<'_>, candidate: &Candidate, residuals_m: &[Vec<f64>]) -> Scattered {
    let bench = search.bench;
    let velocities: Vec<Vec<f64>> = (0..bench.records.len())
        .map(|index| {
            let mut reader = reader(bench, &candidate.hypothesis, &candidate.found.z, index);
            (0..bench.records[index].log.len())
                .map(|_| {
                    reader.next_m();
                    reader.motion.1
                })
                .collect()
        })
        .collect();
    let logs: Vec<Scatter<'_>> = bench
        .records
        .iter()
        .zip(residuals_m)
        .zip(&velocities)
        .filter(|((record, _), _)| record.held_out != HeldOut::Everything)
        .map(|((record, residual_m), velocity_m_per_s)| Scatter { record, residual_m, velocity_m_per_s })
        .collect();
    scattered(&logs)
}

/// Full fits of what the screening left, alone and in pairs.
fn fit_leads(
    search: &Search<'_>,
    refit: &Candidate,
    leads: &[Lead],
    residuals_m: &[Vec<f64>],
    without: &[&str],
    say: Say<'_>,
) -> Vec<Candidate> {
    let mut fits = singles(search, refit, leads, residuals_m, without, 0.2, say);
    // What no direction of the registry imitates at all is not the sum of two of them either.
    if leads.first().is_none_or(|lead| lead.share < HOPELESS) {
        return fits;
    }
    let left = |chi: f64| ((chi - 1.0).max(0.0) / (refit.chi - 1.0)).sqrt();
    let Some(best) = fits.iter().map(|f| f.chi).min_by(f64::total_cmp) else { return fits };
    if left(best) > PAIR_BEYOND && best - 1.0 > 0.02 {
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
        let firsts: Vec<Candidate> = fits.iter().take(2).cloned().collect();
        for (number, first) in firsts.iter().enumerate() {
            say("looking for a second effect", 0.6 + 0.15 * number as f64);
            let residuals_m = search.residuals_m(first);
            let line_hz = lines(search.bench, &residuals_m);
            let skipped: Vec<&str> = SYMMETRIC.iter().chain(without).copied().collect();
            let starts = [&line_hz[..], &resonances(search.bench, &residuals_m)];
            let seconds = screen(search.bench, &first.hypothesis, &first.found, starts, &skipped, search.simulations);
            for lead in distinct(&seconds).into_iter().take(3).filter(|lead| lead.share > PAIR_TAKES * PAIR_TAKES) {
                let pair = search.extend(first, lead, false);
                let takes = 1.0 - ((pair.chi - 1.0).max(0.0) / (first.chi - 1.0).max(1e-12)).sqrt();
                if takes > PAIR_TAKES {
                    fits.push(pair);
                }
            }
        }
    }
    fits
}

/// The best lead of each effect, in order.
fn distinct(leads: &[Lead]) -> Vec<&Lead> {
    let mut seen: Vec<&str> = Vec::new();
    leads
        .iter()
        .filter(|lead| {
            let new = !seen.contains(&lead.effect.id());
            seen.push(lead.effect.id());
            new
        })
        .collect()
}

fn singles(
    search: &Search<'_>,
    base: &Candidate,
    leads: &[Lead],
    residuals_m: &[Vec<f64>],
    without: &[&str],
    from: f64,
    say: Say<'_>,
) -> Vec<Candidate> {
    let mut entries = distinct(leads);
    if entries.first().is_none_or(|lead| lead.share < HOPELESS) {
        entries.truncate(1);
    }
    let best = entries.first().map_or(0.0, |lead| lead.gain);
    let lag = entries.iter().take(3).any(|lead| LAGS.contains(&lead.effect.id()));
    let mut chosen: Vec<&Lead> = entries
        .iter()
        .enumerate()
        .filter(|(rank, lead)| {
            *rank < FIRST || lead.gain > LEAST_SHARE * best || lag && LAGS.contains(&lead.effect.id())
        })
        .map(|(_, lead)| *lead)
        .collect();
    chosen.truncate(MOST_FITS);
    let left = |chi: f64| ((chi - 1.0).max(0.0) / (base.chi - 1.0).max(1e-12)).sqrt();
    let mut fits = Vec::new();
    let count = chosen.len();
    for (number, lead) in chosen.into_iter().enumerate() {
        let found = fits.iter().any(|fit: &Candidate| left(fit.chi) < FOUND);
        if found && number > 0 && lead.gain < AS_MUCH * best {
            continue;
        }
        say(&format!("fitting {}", lead.effect.id()), from + 0.4 * number as f64 / count as f64);
        let mut fit = search.extend(base, lead, true);
        // A wrong form leaves something; the entry's other forms are tried where they promised as much.
        let others = leads
            .iter()
            .filter(|l| l.effect.id() == lead.effect.id() && l.form.name != lead.form.name && l.gain > 0.6 * lead.gain);
        for other in others.take(3) {
            if left(fit.chi) < WELL {
                break;
            }
            let next = search.extend(base, other, true);
            if next.chi < fit.chi {
                fit = next;
            }
        }
        fits.push(fit);
    }
    if !without.contains(&"initial_state") && early_share(search.bench, residuals_m) > START_SHARE {
        say("fitting the state at the start", from + 0.4);
        if let Some(effect) = find("initial_state")
            && let Some(form) = effect.forms().iter().find(|form| form.kind == Kind::Start)
        {
            let lead = Lead { effect, form, values: Vec::new(), gain: 0.0, share: 0.0 };
            fits.push(search.extend(base, &lead, true));
        }
    }
    // The finalists once more from the nominal numbers: a fit a little above the noise is usually a local minimum.
    fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
    let polished = if fits.first().is_some_and(|fit| left(fit.chi) < FOUND) { 1 } else { fits.len().min(2) };
    for fit in fits.iter_mut().take(polished) {
        if left(fit.chi) > WELL && left(fit.chi) < 0.5 {
            say("polishing", from + 0.4);
            *fit = search.polish(fit.clone());
        }
    }
    fits
}

/// Share of the excess power in the first tenth of the logs.
fn early_share(bench: &Bench<'_>, residuals_m: &[Vec<f64>]) -> f64 {
    let (mut early, mut all) = (0.0, 0.0);
    for (record, residual_m) in bench.records.iter().zip(residuals_m) {
        let noise2 = record.noise_m * record.noise_m;
        let tenth = residual_m.len() / 10;
        early += residual_m[..tenth].iter().map(|r| r * r - noise2).sum::<f64>() / noise2;
        all += residual_m.iter().map(|r| r * r - noise2).sum::<f64>() / noise2;
    }
    if all > 0.0 { early / all } else { 0.0 }
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
        found.push(Explanation {
            judged: Judged {
                ids: vec![effect.id()],
                left: left.clamp(0.0, 1.0),
                floor,
                prior_cost: refit.found.prior_cost,
                parameters: 1,
            },
            probability: 0.0,
            candidate: refit.clone(),
            freed: None,
            scatter: Some((effect, form, vec![value])),
        });
    };
    let unexplained = |power: f64| (1.0 - power / scattered.excess_m2).abs().sqrt();
    if scattered.jitter_s > 8.0 * scattered.jitter_sigma_s {
        // A line through bins leaves a few per cent of its own.
        let left = (0.5 * (1.0 - scattered.jitter_m2 / scattered.moving_m2).abs() - 0.05).max(0.0) + 0.02;
        let rival = if scattered.multiplied_m2 > scattered.jitter_m2 { 0.3 } else { 0.0 };
        add("sampling_jitter", "white", scattered.jitter_s, left + rival);
    }
    add(
        "lost_samples",
        "repeated",
        scattered.repeated_share,
        (unexplained(scattered.repeated_m2) - 0.1).max(0.0) + 0.01,
    );
    // Noise neither has lines nor follows anything that the registry's directions follow.
    let even = scattered.unevenness;
    if even < 1.0 && best_share < HOPELESS && !has_lines {
        add("noise_excess", "coloured", scattered.excess_m2.max(0.0).sqrt(), 0.4 * even);
    }
    found
}

/// Effects that the nominal numbers imitate, on top of `fit`.
fn by_symmetry(
    bench: &Bench<'_>,
    fit: &Candidate,
    left: f64,
    floor: f64,
    without: &[&str],
    least: f64,
) -> Vec<Explanation> {
    freed(bench, &fit.hypothesis, &fit.found)
        .into_iter()
        .filter(|f| !without.contains(&f.effect) && f.gain() > least)
        .map(|freed| {
            let mut ids = fit.hypothesis.ids();
            ids.push(freed.effect);
            let parameters = 1 + fit.hypothesis.installed.iter().map(|i| i.axes.len()).sum::<usize>();
            Explanation {
                judged: Judged { ids, left, floor: floor.max(0.02), prior_cost: freed.cost.max(0.0), parameters },
                probability: 0.0,
                candidate: fit.clone(),
                freed: Some(freed),
                scatter: None,
            }
        })
        .collect()
}
