//! What the nominal numbers imitate, as far as a refit that leaves a gap tells it.

use super::bench::{Bench, Record};
use super::explanation::BENT;
use super::judge::RESOLVED;
use super::refit::BENT_COST;
use super::search::{Candidate, Search};
use super::symmetry::{Freed, Shifts};

/// Least chi-square by which a freed symmetry must lower the shifts' cost beside an effect that was fitted.
pub(super) const FREED_BESIDES: f64 = 60.0;
/// The same beside one that is at the noise, if the other shifts are ordinary then: six sigma.
pub(super) const FREED_AT_NOISE: f64 = 36.0;
/// .. and beside a gap that stays: ten sigma of several numbers, of which the freed direction leaves this share, where the refit leaves
/// less than this of the whole gap.
const FREED_FIRST: f64 = 300.0;
pub(super) const PAYS_FOR_ALL: f64 = 0.05;
pub(super) const NEARLY_ALL: f64 = 0.1;
/// .. and where next to nothing stays: five sigma, if the other shifts are ordinary then.
const FREED_OF_ALL: f64 = 25.0;
/// A direction that moves readings by so many times what the refit leaves is no trace of what else is wrong.
const MUCH_LARGER: f64 = 8.0;
/// .. and by so many times where it pays for six sigma only.
const FAR_LARGER: f64 = 30.0;
/// Beside a fit that leaves more than the noise a direction is believed that leaves less than this of what the shifts cost.
const PAYS_ALONE: f64 = 0.2;
/// Entries that shift the displacement as a whole.
const OFFSETS: [&str; 2] = ["sensor_offset", "asymmetric_hysteresis"];
/// A fit that leaves more than this says nothing of a direction.
pub(super) const MOSTLY: f64 = 0.35;

/// What the nominal numbers imitate, as far as a refit that leaves a gap tells it.
pub(super) struct Directions {
    /// The first that pays for all shifts, or leaves ordinary ones: beside scatter, which bends no number, that is enough.
    pub first: Option<Freed>,
    /// Those that are sure whatever stays.
    pub sure: Vec<Freed>,
    /// Those of which it takes two.
    pub pairs: Vec<[Freed; 2]>,
    /// Fraction of the whole gap that the refit leaves, as amplitude.
    pub rest: f64,
}

impl Directions {
    /// A refit that pays for its shifts as no plant would, while one direction pays for them all, has met what that direction means; what
    /// the refit leaves of the whole gap is left then, and less of it with what else was found: `beside_scatter` of it with what scatters.
    pub fn of(search: &Search<'_>, refit: &Candidate, without: &[&str], beside_scatter: f64) -> Self {
        // Where one log of many shows a gap the others may leave less than their noise; no less than these logs resolve is left of it.
        let excess = (refit.chi - 1.0).max(RESOLVED / refit.rows().max(1) as f64);
        let whole = search.unfitted(&refit.hypothesis) - 1.0;
        let rest = (excess / whole.max(excess).max(f64::MIN_POSITIVE)).sqrt();
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

    pub fn are_sure_of(&self, effect: &str) -> bool {
        self.sure.iter().any(|freed| freed.effect == effect)
    }
}

/// Whether a direction makes numbers ordinary that were far from it, and pays for nearly all that they were off by: a wrong form bends several.
pub(super) fn pays_alone(freed: &Freed) -> bool {
    freed.gain() > FREED_BESIDES && freed.cost < BENT_COST.min(PAYS_ALONE * freed.cost_without)
}

/// Whether a direction moves readings by so much more than what `fit` leaves that nothing left could have bent it.
pub(super) fn is_large(bench: &Bench<'_>, freed: &Freed, fit: &Candidate) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_number_that_has_gone_far_alone_is_believed() {
        let freed = |cost: f64, cost_without: f64| Freed {
            effect: "parameter_error",
            quantity: None,
            along: 0.1,
            sigma: 1e-3,
            value: 0.1,
            value_sigma: 1e-3,
            cost,
            cost_without,
            rarer: 0.0,
        };
        assert!(pays_alone(&freed(10.0, 93.0)));
        // Not one that costs little, one beside others that have gone as far, nor one that leaves numbers which are none.
        assert!(
            [(5.0, 64.0), (25.0, 110.0), (35.0, 400.0)]
                .iter()
                .all(|(cost, without)| !pays_alone(&freed(*cost, *without)))
        );
    }
}
