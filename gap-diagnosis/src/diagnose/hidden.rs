//! What is small beside what scatters, or below the noise: in the octaves and rows where a log is quiet it shows, however little of the whole power it is.

use super::bench::Bench;
use super::explanation::Explanation;
use super::fits::Fits;
use super::judge::RESOLVED;
use super::octaves::{Octave, octaves_beside, octaves_of, shown};
use super::search::{Candidate, Remainder, Search, total};
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
        let jitter_s = scatter.jitter_s();
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

/// The fits that `of_little` makes of what a `refit` at the noise leaves, with what shows of them beyond their numbers, if anything does that a better
/// refit has not; and the better refit.
pub(super) fn below_noise(
    mut refit: Candidate,
    of_little: impl Fn(&Candidate) -> Vec<Candidate>,
    search: &Search<'_>,
) -> (Candidate, Vec<(Candidate, f64)>) {
    let octaves = |fit: &Candidate| octaves_of(search.bench, &search.play(fit));
    let has_lattice = search.bench.records.iter().any(|record| record.lattice_m > 0.0);
    let is_told = |fit: &Candidate| !(has_lattice && fit.hypothesis.ids().contains(&OF_LATTICE));
    let fits: Vec<Candidate> = of_little(&refit).into_iter().filter(is_told).collect();
    let beyond = |refit: &Candidate| -> Vec<f64> {
        let before = octaves(refit);
        let numbers = |fit: &Candidate| fit.found.z.len() as f64 - refit.found.z.len() as f64;
        fits.iter().map(|fit| shown(&before, &octaves(fit)) - numbers(fit)).collect()
    };
    let mut shows = beyond(&refit);
    let most = (0..fits.len()).max_by(|a, b| shows[*a].total_cmp(&shows[*b])).filter(|most| shows[*most] > SHOWS);
    let Some(most) = most else { return (refit, Vec::new()) };
    // What led the refit out of a local minimum is no effect.
    let again = search.refit_again(&refit, &fits[most]);
    if total(&again) < total(&refit) {
        refit = again;
        shows = beyond(&refit);
    }
    let shown = fits.into_iter().zip(shows).filter(|(_, shows)| *shows > SHOWS).collect();
    (refit, shown)
}
