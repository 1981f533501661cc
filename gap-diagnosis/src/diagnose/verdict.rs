//! From a course to a verdict: which explanation is named, how probable every entry is, and which entries these logs can't tell apart.

use super::evidence::SHARPNESS;
use super::judge::{Course, Explanation};
use super::random::{CONFIDENCE, Random};
use super::search::Search;
use super::symmetry::{Freed, Shifts};
use plant_sim::effects::REGISTRY;
use serde::Serialize;

/// Difference of prior cost below which an exact symmetry leaves two entries open: three sigma.
const SAME_COST: f64 = 9.0;
/// Ratio of probabilities within which two good fits are one answer, and what a good fit leaves at most.
const SAME_PROBABILITY: f64 = 5.0;
const GOOD: f64 = 0.10;
/// Fits that leave much, but as much as one another within this share, are one answer as well, up to this fraction.
const ALIKE: f64 = 0.05;
const HALF: f64 = 0.5;
/// Logarithm of a ratio of probabilities beyond which it makes no difference any more, and below which there is none.
const CERTAIN: f64 = 12.0;
const NOT_NEEDED: f64 = 0.1;
/// What of an explanation's probability each of its members gets at least.
const LEAST_SHARE: f64 = 0.3;
/// Entries that are decided by priors alone.
const BY_PRIORS: [&str; 4] = ["payload_mass", "amplifier_gain", "sensor_gain", "parameter_error"];

/// What is said of the gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// There is none, or the refit within the stated uncertainties closes it.
    NoGap,
    /// Entries of the registry (or a wrong number) explain it.
    Explained,
    /// There is one and no entry explains it.
    Unknown,
}

/// An entry and its probability.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranked {
    /// Entry, `parameter_error`, `no_gap` or `unknown`.
    pub effect: String,
    /// 0 to 1.
    pub probability: f64,
}

/// Entries that these logs can't tell apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Class {
    /// Identifiers.
    pub members: Vec<String>,
    /// Why.
    pub reason: String,
}

impl Class {
    fn holds(&self, ids: [&str; 2]) -> bool {
        ids.into_iter().all(|id| self.members.iter().any(|member| member == id))
    }
}

/// The explanation that is named, and the entries that these logs can't tell from it; none for `no_gap` and `unknown`.
///
/// Explanations that these logs can't tell apart count together, and so do those that share an effect: the truth doesn't become less
/// probable by having a twin, nor by having company.
pub(super) fn named<'c>(
    search: &Search<'_>,
    course: &'c Course,
    without: &[&str],
) -> (Verdict, Option<&'c Explanation>, Vec<Class>) {
    let otherwise = if course.no_gap > course.unknown { Verdict::NoGap } else { Verdict::Unknown };
    let Some(top) = course.explanations.first() else { return (otherwise, None, Vec::new()) };
    let classes = classes(search, course, top, without);
    let with = course.explanations.iter().skip(1).filter(|other| {
        let shares = other.judged.ids.iter().any(|id| top.judged.ids.contains(id));
        shares
            || differing(&top.judged.ids, &other.judged.ids)
                .is_some_and(|both| classes.iter().any(|class| class.holds(both)))
    });
    let together = top.probability + with.map(|other| other.probability).sum::<f64>();
    if together > course.unknown && together > course.no_gap {
        (Verdict::Explained, Some(top), classes)
    } else {
        (otherwise, None, Vec::new())
    }
}

/// Probabilities of all entries, most probable first, with those of `no_gap` and `unknown`. An explanation of several members gives most to the one
/// without which it explains least: a second one may but mend what a first one's form lacks, however much it moves.
pub(super) fn ranking(
    course: &Course,
    [no_gap, unknown]: [f64; 2],
    named: Option<&Explanation>,
    beyond_stated: Option<&Random>,
) -> Vec<Ranked> {
    let ids = REGISTRY.iter().map(|effect| effect.id()).chain(["parameter_error", "no_gap", "unknown"]);
    let mut ranking: Vec<Ranked> = ids.map(|id| Ranked { effect: id.to_owned(), probability: 0.0 }).collect();
    let mut add = |id: &str, probability: f64| {
        if let Some(ranked) = ranking.iter_mut().find(|ranked| ranked.effect == id) {
            ranked.probability += probability;
        }
    };
    for explanation in &course.explanations {
        let mut members: Vec<(&str, f64)> = if named.is_some_and(|named| std::ptr::eq(named, explanation)) {
            let own = (explanation.judged.ids.as_slice(), explanation.probability);
            let all = || course.explanations.iter().map(|other| (other.judged.ids.as_slice(), other.probability));
            own.0.iter().map(|id| (*id, needed(all(), own, id))).collect()
        } else {
            explanation.judged.ids.iter().map(|id| (*id, CERTAIN)).collect()
        };
        let gap2_m2 = course.refit.found.rms_m().powi(2) * (1.0 - 1.0 / course.refit.chi.max(1.0));
        members.extend(beyond_stated.map(|random| {
            let left2_m2 = gap2_m2 * (explanation.judged.left.powi(2) + explanation.judged.floor.powi(2));
            (random.effect.id(), needed_beside(left2_m2, random.power_m2))
        }));
        members.dedup_by_key(|(id, _)| *id);
        let sum: f64 = members.iter().map(|(_, needed)| needed).sum();
        let count = members.len() as f64;
        let least = LEAST_SHARE.min(1.0 / count);
        for (id, needed) in &members {
            add(id, explanation.probability * (least + (1.0 - count * least) * needed / sum));
        }
    }
    match beyond_stated {
        Some(random) => {
            add(random.effect.id(), CONFIDENCE * no_gap);
            add("no_gap", (1.0 - CONFIDENCE) * no_gap);
        }
        None => add("no_gap", no_gap),
    }
    add("unknown", unknown);
    let sum: f64 = ranking.iter().map(|ranked| ranked.probability).sum();
    ranking.iter_mut().for_each(|ranked| ranked.probability /= sum);
    ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    ranking
}

/// How much an explanation needs its member `id`: logarithm of how much less probable the rest of its members is alone, among `all`.
fn needed<'e>(all: impl Iterator<Item = (&'e [&'e str], f64)>, (ids, probability): (&[&str], f64), id: &str) -> f64 {
    let is_rest = |(other, _): &(&[&str], f64)| {
        other.len() + 1 == ids.len() && ids.iter().all(|own| (*own == id) != other.contains(own))
    };
    let without = all.filter(is_rest).map(|(_, probability)| probability).fold(0.0, f64::max);
    (probability / without.max(f64::MIN_POSITIVE)).ln().clamp(NOT_NEEDED, CERTAIN)
}

/// The same of what makes `power_m2` beside an explanation that leaves `left2_m2` of the gap.
fn needed_beside(left2_m2: f64, power_m2: f64) -> f64 {
    (0.5 * SHARPNESS * ((left2_m2 + power_m2) / left2_m2.max(f64::MIN_POSITIVE)).ln()).clamp(NOT_NEEDED, CERTAIN)
}

/// The most probable of the named effects, of equals the first. Not the one with the largest share: a wrong number may move more than the effect
/// that is surely there.
pub(crate) fn leading(effects: &[String], probability: impl Fn(&str) -> f64) -> Option<&str> {
    effects.iter().map(String::as_str).rev().max_by(|a, b| probability(a).total_cmp(&probability(b)))
}

/// Probability of one entry.
pub(super) fn probability(ranking: &[Ranked], id: &str) -> f64 {
    ranking.iter().find(|ranked| ranked.effect == id).map_or(0.0, |ranked| ranked.probability)
}

/// The smallest set that holds 90 % of the probability.
pub(super) fn set90(ranking: &[Ranked]) -> Vec<String> {
    let mut sum = 0.0;
    let mut set = Vec::new();
    for ranked in ranking {
        if sum > 0.9 - 1e-9 {
            break;
        }
        sum += ranked.probability;
        set.push(ranked.effect.clone());
    }
    set
}

/// Entries that these logs can't tell from a member of `top`; those that were struck out are none.
fn classes(search: &Search<'_>, course: &Course, top: &Explanation, without: &[&str]) -> Vec<Class> {
    let mut classes = Vec::new();
    for (place, best) in top.freed.iter().enumerate() {
        let mut others = top.freed.clone();
        others.remove(place);
        let rivals = Shifts::of(search, &top.candidate).map_or_else(Vec::new, |shifts| shifts.freed(&others));
        let is_rival = |rival: &&Freed| rival.cost - best.cost < SAME_COST && !without.contains(&rival.effect);
        let mut members = vec![best.effect];
        let mut most = 0f64;
        for rival in rivals.iter().filter(is_rival) {
            if !members.contains(&rival.effect) {
                members.push(rival.effect);
                most = most.max(rival.cost - best.cost);
            }
        }
        if members.len() > 1 {
            classes.push(Class {
                members: members.into_iter().map(str::to_owned).collect(),
                reason: format!(
                    "each of them leaves the displacement as it is once the other numbers follow (an exact symmetry of the plant), \
                     so that only the stated uncertainties decide, and these differ by a chi-square of {most:.1} at most."
                ),
            });
        }
    }
    let mut members: Vec<&str> = Vec::new();
    let mut reasons = Vec::new();
    for other in &course.explanations {
        let Some([own, theirs]) = differing(&top.judged.ids, &other.judged.ids) else { continue };
        let is_known = classes.iter().any(|class: &Class| class.holds([own, theirs]));
        if is_known || BY_PRIORS.contains(&own) && BY_PRIORS.contains(&theirs) {
            continue;
        }
        let (left, their_left) = (top.judged.left, other.judged.left);
        let floor = top.judged.floor.max(other.judged.floor);
        // What leaves as much is as good, be the form wrong in the same way.
        let alike = (left - their_left).abs() < ALIKE * left && left.max(their_left) < HALF;
        let close = alike || (left - their_left).abs() < floor && left.max(their_left) < GOOD;
        let even = top.probability < SAME_PROBABILITY * other.probability && left.max(their_left) < GOOD;
        if close || even {
            for id in [own, theirs] {
                if !members.contains(&id) {
                    members.push(id);
                }
            }
            reasons.push(format!(
                "{own} leaves {:.1} % of the gap and {theirs} {:.1} %, while these logs resolve {:.1} %",
                100.0 * left,
                100.0 * their_left,
                100.0 * floor
            ));
        }
    }
    if members.len() > 1 {
        let members = members.into_iter().map(str::to_owned).collect();
        classes.push(Class { members, reason: format!("{}.", reasons.join("; ")) });
    }
    classes
}

/// The members in which two explanations of equal length differ, if that is one each.
pub(super) fn differing<'i>(a: &[&'i str], b: &[&'i str]) -> Option<[&'i str; 2]> {
    let only = |a: &[&'i str], b: &[&'i str]| a.iter().copied().filter(|id| !b.contains(id)).collect::<Vec<_>>();
    let (own, theirs) = (only(a, b), only(b, a));
    (a.len() == b.len() && own.len() == 1 && theirs.len() == 1).then(|| [own[0], theirs[0]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_set_is_the_smallest() {
        let ranked = |effect: &str, probability| Ranked { effect: effect.to_owned(), probability };
        assert_eq!(set90(&[ranked("a", 0.95), ranked("b", 0.05)]), ["a"]);
        assert_eq!(set90(&[ranked("a", 0.6), ranked("b", 0.3), ranked("c", 0.1)]), ["a", "b"]);
    }

    #[test]
    fn of_equally_probable_names_the_first_leads() {
        let names = ["creep", "backlash", "end_stop"].map(str::to_owned);
        let of = |probabilities: [f64; 3]| {
            leading(&names, |id| probabilities[names.iter().position(|name| name == id).unwrap()]).unwrap()
        };
        assert_eq!([of([0.4, 0.4, 0.2]), of([0.2, 0.4, 0.4]), of([0.2, 0.3, 0.5])], ["creep", "backlash", "end_stop"]);
        assert_eq!(leading(&[], |_| 1.0), None);
    }

    #[test]
    fn a_member_is_needed_as_much_as_the_rest_is_worse_alone() {
        let all: [(&[&str], f64); 4] =
            [(&["creep", "backlash"], 0.6), (&["creep"], 0.2), (&["backlash"], 1e-3), (&["creep", "end_stop"], 0.1)];
        let of = |id| needed(all.into_iter(), all[0], id);
        assert!((of("backlash") - 3f64.ln()).abs() < 1e-12, "{}", of("backlash"));
        assert!((of("creep") - 600f64.ln()).abs() < 1e-12, "{}", of("creep"));
        // Alone, it is needed for sure, and so it is where nobody tried the rest.
        assert_eq!(needed(all.into_iter(), all[1], "creep"), CERTAIN);
        assert_eq!(needed(all.into_iter(), all[3], "creep"), CERTAIN);
        assert_eq!(needed([(&["creep"][..], 0.9)].into_iter(), all[0], "backlash"), NOT_NEEDED);
    }

    #[test]
    fn what_makes_little_beside_an_effect_is_needed_little() {
        assert_eq!(needed_beside(1e-16, 0.0), NOT_NEEDED);
        assert!((needed_beside(1e-16, 3e-16) - 3.0 * 2f64.ln()).abs() < 1e-12);
        assert_eq!([needed_beside(0.0, 1e-16), needed_beside(1e-16, 1.0)], [CERTAIN; 2]);
    }

    #[test]
    fn explanations_are_rivals_where_they_differ_in_one_member() {
        assert_eq!(differing(&["creep"], &["sensor_drift"]), Some(["creep", "sensor_drift"]));
        assert_eq!(differing(&["creep", "backlash"], &["end_stop", "creep"]), Some(["backlash", "end_stop"]));
        assert_eq!(differing(&["creep"], &["creep"]), None);
        assert_eq!(differing(&["creep"], &["creep", "backlash"]), None);
    }
}
