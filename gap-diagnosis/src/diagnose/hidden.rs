//! What is small beside what scatters, or below the noise: in the octaves and rows where a log is quiet it shows, however little of the whole power it is.

use super::bench::Bench;
use super::explanation::Explanation;
use super::fits::Fits;
use super::judge::RESOLVED;
use super::octaves::{Octave, octaves_beside, shown};
use super::search::{Candidate, Remainder, cheaper};
use plant_sim::effects::Effect;

/// Logarithm of a likelihood ratio, beyond one for each number, that no plant without an effect reaches: lines and wanders come to 80 of it in one of
/// sixty.
const SHOWS: f64 = 120.0;
/// The curve of a sensor whose readings lie on a lattice is the lattice's own.
const OF_LATTICE: &str = "sensor_nonlinearity";

/// What a refit leaves beside scatter that explains most of it.
pub(super) struct Quiet {
    effect: &'static dyn Effect,
    jitter_s: f64,
    octaves: Vec<Octave>,
}

impl Quiet {
    /// Beside `scatter`, whose `remainders` these are.
    pub fn beside(bench: &Bench<'_>, scatter: &Explanation, remainders: &[Remainder]) -> Option<Self> {
        let (effect, ..) = scatter.scatter?;
        let jitter_s = scatter.jitter_s().hypot(bench.stated_jitter_s());
        Some(Self { effect, jitter_s, octaves: octaves_beside(bench, remainders, jitter_s) })
    }

    /// What shows there of a fit that leaves `remainders`, as the logarithm of a likelihood ratio.
    pub fn shows(&self, bench: &Bench<'_>, remainders: &[Remainder]) -> f64 {
        shown(&self.octaves, &octaves_beside(bench, remainders, self.jitter_s))
    }

    /// Fits of what the scatter may hide: of what it does in the mean, if that shows, and of the first leads beside.
    pub fn hidden(&self, fits: &Fits<'_>) -> Vec<Candidate> {
        let shows = |fit: &Candidate| self.shows(fits.search.bench, &fits.search.play(fit));
        let mean = fits.mean_of(self.effect).filter(|mean| shows(mean) > RESOLVED);
        let mut hidden = fits.of_little(mean.as_ref().unwrap_or(fits.refit));
        hidden.extend(mean);
        hidden
    }

    /// Whether an explanation has this scatter.
    pub fn is_of(&self, explanation: &Explanation) -> bool {
        explanation.scatter.as_ref().is_some_and(|(effect, ..)| effect.id() == self.effect.id())
    }
}

/// What shows below the noise of what a refit leaves, beyond its numbers, if anything does: a better refit, which what led this one out of a local minimum
/// has shown, and fits of what that has not.
pub(super) fn below_noise(fits: &Fits<'_>) -> Option<(Candidate, Vec<(Candidate, f64)>)> {
    let search = fits.search;
    let jitter_s = search.bench.stated_jitter_s();
    let octaves = |fit: &Candidate| octaves_beside(search.bench, &search.play(fit), jitter_s);
    let has_lattice = search.bench.records.iter().any(|record| record.lattice_m > 0.0);
    let is_told = |fit: &Candidate| !(has_lattice && fit.hypothesis.ids().contains(&OF_LATTICE));
    let with_octaves = |fit: Candidate| {
        let octaves = octaves(&fit);
        (fit, octaves)
    };
    let little: Vec<(Candidate, Vec<Octave>)> =
        fits.of_little(fits.refit).into_iter().filter(is_told).map(with_octaves).collect();
    let beyond = |refit: &Candidate| -> Vec<f64> {
        let before = octaves(refit);
        let numbers = |fit: &Candidate| fit.found.z.len() as f64 - refit.found.z.len() as f64;
        little.iter().map(|(fit, after)| shown(&before, after) - numbers(fit)).collect()
    };
    let most = little.iter().zip(beyond(fits.refit)).max_by(|a, b| a.1.total_cmp(&b.1));
    let ((first, _), _) = most.filter(|(_, shows)| *shows > SHOWS)?;
    let refit = cheaper(fits.refit.clone(), search.refit_again(fits.refit, first));
    let shows = beyond(&refit);
    let with_shows = little.into_iter().zip(shows).map(|((fit, _), shows)| (fit, shows));
    Some((refit, with_shows.filter(|(_, shows)| *shows > SHOWS).collect()))
}
