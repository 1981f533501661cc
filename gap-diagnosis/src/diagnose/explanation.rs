//! One explanation of a gap: by what was fitted, by what scatters, or by directions that the nominal numbers imitate.

use super::bench::{Bench, Record};
use super::evidence::{Judged, PRIOR_MOST, PRIOR_WEIGHT};
use super::fits::HOPELESS;
use super::normal::Sums;
use super::octaves::left_of_worst;
use super::records::ROUGH;
use super::refit::AT_NOISE;
use super::search::{Candidate, Remainder, Search, middle};
use super::spread::Scattered;
use super::symmetry::Freed;
use plant_sim::effects::{Effect, Form, find_form};

/// A log counts by itself if its gap, and what is left of it, are more than these shares of the noise's power.
const GAP_OF_LOG: f64 = 0.25;
const LEFT_OF_LOG: f64 = 0.08;
/// Least fraction of the gap that an effect beside a fit above the noise is taken to leave.
pub(super) const BENT: f64 = 0.02;
/// Share of jitter's power that may return with the command: where few rows are late, all are late in the mean.
const OF_LATENESS: f64 = 0.3;
/// Shares of the excess power that no noise would have, in all logs and in the worst, below which it is noise.
const NOT_NOISE: f64 = 0.12;
const NOT_NOISE_OF_LOG: f64 = 0.25;

/// What shows where the plant moves.
const JITTER: &str = "sampling_jitter";

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
    pub(super) fn by_fit(candidate: &Candidate, left: f64, floor: f64) -> Self {
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
    pub(super) fn rarer(&self) -> f64 {
        self.dearer + self.freed.iter().map(|freed| freed.rarer).sum::<f64>()
    }

    /// Errors of the sampling instants that it has, seconds.
    pub(super) fn jitter_s(&self) -> f64 {
        let of_jitter = self.scatter.as_ref().filter(|(effect, ..)| effect.id() == JITTER);
        of_jitter.map_or(0.0, |(.., scattered)| scattered.jitter_s)
    }

    /// Lets another explanation of the same kind be so much more likely, as logarithm.
    pub(super) fn outdo(&mut self, by: f64) {
        self.dearer += 2.0 * by;
    }

    /// The same with `id` beside it, which no simulation shows.
    fn and(mut self, id: &'static str) -> Self {
        if !self.judged.ids.contains(&id) {
            self.judged.ids.push(id);
        }
        self.judged.parameters += 1;
        self
    }

    /// The same with what the nominal numbers imitate beside it, where the numbers leave `rest` of the whole gap.
    pub(super) fn along(self, freed: &Freed, rest: f64) -> Self {
        let mut explanation = self.and(freed.effect);
        explanation.judged.left *= rest;
        explanation.judged.floor *= rest;
        explanation.judged.prior_cost = freed.cost;
        explanation.freed.push(freed.clone());
        explanation
    }
}

/// Fraction of a log's gap that `fit` leaves, as amplitude, in the log where it leaves most. One sensor has one noise: what the fit leaves of
/// the log in the middle tells it better than a log's own differences, which a fast plant roughens. Of what it leaves of each log `scatter_m2` is
/// explained, if that is known.
pub(super) fn left_of_worst_log(search: &Search<'_>, fit: &Candidate, refit: &Candidate, scatter_m2: &[f64]) -> f64 {
    let mean2 = |candidate: &Candidate| -> Vec<f64> { candidate.found.normal.logs.iter().map(Sums::mean_m2).collect() };
    let (before2, after2) = (mean2(refit), mean2(fit));
    let middle2 = middle(&after2);
    let logs = search.bench.records.iter().zip(before2.iter().zip(&after2)).enumerate();
    // In shares of each log's noise.
    let shares = logs.map(|(index, (record, (before2, after2)))| {
        let own2 = record.noise_m.powi(2);
        let noise2 = if middle2 < ROUGH * ROUGH * own2 { own2.min(middle2) } else { own2 };
        let scatter2 = scatter_m2.get(index).copied().unwrap_or_default();
        [(before2 - noise2).max(0.0) / noise2, (after2 - noise2 - scatter2).max(0.0) / noise2]
    });
    left_of_worst(shares, [GAP_OF_LOG, LEFT_OF_LOG])
}

/// Power of what scatters in each log, metres squared: noise has the same everywhere, errors of the instants show where the plant moves.
pub(super) fn scatter_of_logs(explanation: &Explanation, bench: &Bench<'_>, remainders: &[Remainder]) -> Vec<f64> {
    let Some((effect, _, scattered)) = &explanation.scatter else { return Vec::new() };
    let of_log = |(record, left): (&Record<'_>, &Remainder)| {
        if effect.id() != JITTER {
            return scattered.excess_m2.max(0.0);
        }
        let velocity = &left.velocity_m_per_s[record.run_in..];
        scattered.jitter_s.powi(2) * velocity.iter().map(|v| v * v).sum::<f64>() / velocity.len().max(1) as f64
    };
    bench.records.iter().zip(remainders).map(of_log).collect()
}

/// What the screening of a gap speaks for but scatter.
#[derive(Clone, Copy, Default)]
pub(super) struct Promised {
    /// Share of the gap that the best lead promised.
    pub best_share: f64,
    /// Whether lines stand out of the gap, ..
    pub has_lines: bool,
    /// .. and a wave promises most of it.
    pub is_wave: bool,
}

/// Effects that only scatter tells.
pub(super) fn by_scatter(
    scattered: &Scattered,
    refit: &Candidate,
    floor: f64,
    without: &[&str],
    promised: Promised,
) -> Vec<Explanation> {
    let mut found = Vec::new();
    let mut add = |id: &'static str, form: &str, value: f64, left: f64| {
        if without.contains(&id) || value <= 0.0 {
            return;
        }
        let Some((effect, form)) = find_form(id, form) else { return };
        let explanation = Explanation::by_fit(refit, left.clamp(0.0, 1.0), floor).and(effect.id());
        found.push(Explanation { scatter: Some((effect, form, *scattered)), ..explanation });
    };
    if scattered.jitter_s > 8.0 * scattered.jitter_sigma_s {
        // A line through bins misses a tenth of the power now and then.
        let left = ((1.0 - scattered.jitter_m2 / scattered.moving_m2).abs() - 0.1).max(0.0) + 0.02;
        let rival = if scattered.multiplied_m2 > scattered.jitter_m2 { 0.3 } else { 0.0 };
        let returning = (scattered.returning - OF_LATENESS).max(0.0) / (1.0 - OF_LATENESS);
        add(JITTER, "white", scattered.jitter_s, (left + rival).hypot(returning.sqrt()));
    }
    // Noise neither has lines nor follows anything that the registry's directions follow, or its octaves tell that it is noise.
    let [beyond, beyond_of_log] = scattered.beyond_any_noise;
    let uneven = scattered.unevenness.hypot(beyond);
    let is_even = uneven < 1.0 && promised.best_share < HOPELESS && !promised.has_lines;
    let is_told = beyond < NOT_NOISE && beyond_of_log < NOT_NOISE_OF_LOG && !promised.is_wave;
    let left = [(is_even, 0.4 * uneven), (is_told, beyond.sqrt())];
    if let Some(left) = left.into_iter().filter(|(is, _)| *is).map(|(_, left)| left).reduce(f64::min) {
        add("noise_excess", "coloured", scattered.excess_m2.max(0.0).sqrt(), left);
    }
    found
}

/// Least fraction that an effect leaves which the numbers of `fit` tell: numbers that a wrong form has bent say little, at the noise they are what
/// they are.
pub(super) fn bent(fit: &Candidate, floor: f64) -> f64 {
    if fit.chi < AT_NOISE { floor } else { floor.max(BENT) }
}

/// Effects that the nominal numbers imitate, one or two at once, on top of `fit`; each must save more than `least`.
pub(super) fn by_symmetry<F: Into<Vec<Freed>>>(
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
    use crate::diagnose::hypothesis::Freedom;
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
        let found = by_scatter(&scattered, &refit, 0.01, &[], Promised::default());
        let of = |id: &str| {
            let explanation = found.iter().find(|e| e.judged.ids == [id]).expect("told by its scatter");
            scatter_of_logs(explanation, &bench, &[moving(0.0), moving(0.01)])
        };
        let jitter = of("sampling_jitter");
        assert!(jitter[0] == 0.0 && (jitter[1] - 4e-16).abs() < 1e-24, "{jitter:?}");
        assert_eq!(of("noise_excess"), [1e-16; 2]);
        // Octaves that noise could have say nothing where a wave promises most of it.
        let told = Scattered { unevenness: 2.0, beyond_any_noise: [0.02, 0.03], ..scattered };
        let is_noise = |is_wave: bool| {
            let promised = Promised { best_share: 0.97, has_lines: true, is_wave };
            let found = by_scatter(&told, &refit, 0.01, &[], promised);
            found.iter().any(|explanation| explanation.judged.ids == ["noise_excess"])
        };
        assert!(is_noise(false) && !is_noise(true));
        assert!(scatter_of_logs(&Explanation::by_fit(&refit, 1.0, 0.01), &bench, &[]).is_empty());
    }
}
