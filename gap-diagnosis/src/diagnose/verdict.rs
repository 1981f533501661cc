//! From a course to a verdict: which explanation is named, how probable every entry is, and which entries these logs can't tell apart.

use super::bench::Bench;
use super::directions::PAYS_FOR_ALL;
use super::evidence::{Judged, PRIOR_MOST, PRIOR_WEIGHT, SECOND, SHARPNESS, probabilities};
use super::explanation::Explanation;
use super::judge::Course;
use super::random::{CONFIDENCE, Random};
use super::refit::BENT_COST;
use super::search::Search;
use super::symmetry::{Freed, Shifts, symmetric};
use plant_sim::effects::REGISTRY;
use serde::Serialize;

/// Difference of prior cost below which an exact symmetry leaves two entries open: three sigma.
const SAME_COST: f64 = 9.0;
/// Ratio of probabilities within which two good fits are one answer, and what a good fit leaves at most.
const SAME_PROBABILITY: f64 = 5.0;
const GOOD: f64 = 0.10;
/// Ratio of probabilities beyond which two are told apart, by the numbers that they need or the shifts that they cost, though both leave as much.
const TOLD_APART: f64 = 100.0;
/// Fits that leave much, but as much as one another within this share, are one answer as well, up to this fraction.
const ALIKE: f64 = 0.05;
const HALF: f64 = 0.5;
/// Least that a member counts as needed.
const NOT_NEEDED: f64 = 0.1;
/// What of an explanation's probability each of its members gets at least.
const LEAST_SHARE: f64 = 0.2;
/// Gains that are off by no more than the plant states are no gap, and no log tells which of them it is, unless a monitor does; what of `no_gap` is each
/// one's. Of 150 such answers to cases of develop and calibrate five held the one and five the other; so few are worth hardly more than this.
const WITHIN_STATED: [&str; 2] = ["amplifier_gain", "sensor_gain"];
const OF_EACH_GAIN: f64 = 0.02;
/// What the numbers and starts of fitted logs may have taken for themselves, if another log is missed that a plant within the stated uncertainties suits.
const LEFT_OPEN: [&str; 2] = ["parameter_error", "sensor_offset"];
const OF_EACH_OPEN: f64 = 0.1;
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
/// probable by having a twin, nor by having company. That is asked of `no_gap`; `unknown` says that no entry explains the gap, which is wrong where
/// all entries together are the more probable, however many share that.
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
    let known: f64 = course.explanations.iter().map(|explanation| explanation.probability).sum();
    if known > course.unknown && together > course.no_gap {
        (Verdict::Explained, Some(top), classes)
    } else {
        (otherwise, None, Vec::new())
    }
}

/// What `no_gap` may hide, and how probably: gains that these logs can't tell from none within what the plant states, or, where a log that was not
/// fitted `surprises`, what the fitted ones leave to the numbers and starts.
pub(super) fn hidden(bench: &Bench<'_>, surprises: bool, without: &[&str]) -> Vec<(&'static str, f64)> {
    let imitated = symmetric(bench);
    let (ids, of_each) = if surprises { (LEFT_OPEN, OF_EACH_OPEN) } else { (WITHIN_STATED, OF_EACH_GAIN) };
    let may_hide = |id: &&str| (surprises || imitated.contains(id)) && !without.contains(id);
    ids.into_iter().filter(may_hide).map(|id| (id, of_each)).collect()
}

/// Probabilities of all entries, most probable first, with those of `no_gap` and `unknown`. An explanation of several members gives most to the one
/// without which it explains least: a second one may but mend what a first one's form lacks, however much it moves. `shares` are those of the explanations, `hidden` is what `no_gap` may hide.
pub(super) fn ranking(
    course: &Course,
    shares: &[f64],
    [no_gap, unknown]: [f64; 2],
    named: Option<&Explanation>,
    beyond_stated: Option<&Random>,
    hidden: &[(&str, f64)],
) -> Vec<Ranked> {
    let ids = REGISTRY.iter().map(|effect| effect.id()).chain(["parameter_error", "no_gap", "unknown"]);
    let mut ranking: Vec<Ranked> = ids.map(|id| Ranked { effect: id.to_owned(), probability: 0.0 }).collect();
    let mut add = |id: &str, probability: f64| {
        if let Some(ranked) = ranking.iter_mut().find(|ranked| ranked.effect == id) {
            ranked.probability += probability;
        }
    };
    for (explanation, share) in course.explanations.iter().zip(shares) {
        let mut members: Vec<(&str, f64)> = if named.is_some_and(|named| std::ptr::eq(named, explanation)) {
            explanation.judged.ids.iter().map(|id| (*id, needed(course, explanation, id))).collect()
        } else {
            explanation.judged.ids.iter().map(|id| (*id, 1.0)).collect()
        };
        let gap2_m2 = course.refit.found.rms_m().powi(2) * (1.0 - 1.0 / course.refit.chi.max(1.0));
        let is_new = |random: &&Random| members.iter().all(|(id, _)| *id != random.effect.id());
        let more = beyond_stated.filter(is_new).map(|random| {
            let left2_m2 = gap2_m2 * (explanation.judged.left.powi(2) + explanation.judged.floor.powi(2));
            (random.effect.id(), needed_beside(left2_m2, random.power_m2))
        });
        members.extend(more);
        let sum: f64 = members.iter().map(|(_, needed)| needed).sum();
        let count = members.len() as f64;
        let least = LEAST_SHARE.min(1.0 / count);
        for (id, needed) in &members {
            add(id, share * (least + (1.0 - count * least) * needed / sum));
        }
    }
    match beyond_stated {
        Some(random) => {
            add(random.effect.id(), CONFIDENCE * no_gap);
            add("no_gap", (1.0 - CONFIDENCE) * no_gap);
        }
        None => {
            hidden.iter().for_each(|(id, share)| add(id, share * no_gap));
            let rest = 1.0 - hidden.iter().map(|(_, share)| share).sum::<f64>();
            add("no_gap", rest * no_gap);
        }
    }
    add("unknown", unknown);
    let sum: f64 = ranking.iter().map(|ranked| ranked.probability).sum();
    ranking.iter_mut().for_each(|ranked| ranked.probability /= sum);
    ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    ranking
}

/// How probable each explanation is. Where `unknown` is the answer they share what is theirs by what they leave: the numbers that each of them shifts make
/// up for what its form lacks, and so do those that it has itself, so that the cost of neither says which is the nearest.
pub(super) fn shares_of_known(course: &Course, [no_gap, unknown]: [f64; 2], named: Option<&Explanation>) -> Vec<f64> {
    let believed: Vec<f64> = course.explanations.iter().map(|explanation| explanation.probability).collect();
    if named.is_some() || unknown <= no_gap {
        return believed;
    }
    let known: f64 = believed.iter().sum();
    let score = |e: &Explanation| Judged { prior_cost: 0.0, parameters: 1, ..e.judged.clone() }.score();
    let scores: Vec<f64> = course.explanations.iter().map(score).collect();
    probabilities(&scores).into_iter().map(|p| known * p).collect()
}

/// How much an explanation needs its member `id`: by how much the rest of its members is less likely alone, on the scale of [`Judged::score`].
fn needed(course: &Course, explanation: &Explanation, id: &str) -> f64 {
    if let Some(freed) = explanation.freed.iter().find(|freed| freed.effect == id) {
        return shifts_without(course, explanation, freed).max(NOT_NEEDED);
    }
    let own = &explanation.judged;
    let all = course.explanations.iter().map(|other| (other.judged.ids.as_slice(), other.judged.score()));
    // What nobody tried alone promised nothing.
    let nothing =
        Judged { ids: Vec::new(), left: 1.0, prior_cost: course.refit.found.prior_cost, parameters: 0, ..own.clone() };
    let without = score_without(all, &own.ids, id).unwrap_or(nothing.score());
    (own.score() + SECOND - without).max(NOT_NEEDED)
}

/// The same of a direction. One that pays for all shifts of a refit, or leaves ordinary ones, has met what it means, and squares are what they are;
/// shifts that a wrong form has bent are no more than a prior cost.
fn shifts_without(course: &Course, explanation: &Explanation, freed: &Freed) -> f64 {
    let is_alone =
        |other: &&Explanation| other.judged.ids == [freed.effect] && other.candidate.hypothesis.installed.is_empty();
    let of_refit = course.explanations.iter().filter(is_alone).flat_map(|alone| &alone.freed);
    let pays_for_all = |alone: &&Freed| alone.cost < BENT_COST.max(PAYS_FOR_ALL * alone.cost_without);
    let pays = of_refit.filter(pays_for_all).map(Freed::gain).fold(0.0, f64::max);
    let cost = |cost: f64| (PRIOR_WEIGHT * cost).min(PRIOR_MOST);
    let is_all = explanation.candidate.hypothesis.installed.is_empty();
    let gain = if is_all { freed.gain() } else { pays };
    f64::max(0.5 * gain, cost(freed.cost_without) - cost(freed.cost))
}

/// The best score among `all` of what has the members `ids` but for `id`, if anything has.
fn score_without<'e>(all: impl Iterator<Item = (&'e [&'e str], f64)>, ids: &[&str], id: &str) -> Option<f64> {
    let is_rest = |(other, _): &(&[&str], f64)| {
        other.len() + 1 == ids.len() && ids.iter().all(|own| (*own == id) != other.contains(own))
    };
    all.filter(is_rest).map(|(_, score)| score).max_by(f64::total_cmp)
}

/// The same of what makes `power_m2` beside an explanation that leaves `left2_m2` of the gap.
fn needed_beside(left2_m2: f64, power_m2: f64) -> f64 {
    (0.5 * SHARPNESS * ((left2_m2 + power_m2) / left2_m2.max(f64::MIN_POSITIVE)).ln()).max(NOT_NEEDED)
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
    classes.extend(rivalries(course, top, &classes).into_iter().map(|(own, rivals)| Class {
        members: std::iter::once(own).chain(rivals.iter().map(|(id, _)| *id)).map(str::to_owned).collect(),
        reason: format!("{}.", rivals.into_iter().map(|(_, reason)| reason).collect::<Vec<_>>().join("; ")),
    }));
    classes
}

/// For each member of `top` the entries that would do in its place, but those that `known` classes hold, and why. Two members of one explanation
/// have rivals of their own: what does for the first was not compared with the second.
fn rivalries<'c>(course: &'c Course, top: &'c Explanation, known: &[Class]) -> Vec<(&'c str, Vec<(&'c str, String)>)> {
    let mut found: Vec<(&str, Vec<(&str, String)>)> = Vec::new();
    for other in &course.explanations {
        let Some([own, theirs]) = differing(&top.judged.ids, &other.judged.ids) else { continue };
        let is_known = known.iter().any(|class| class.holds([own, theirs]));
        if is_known || BY_PRIORS.contains(&own) && BY_PRIORS.contains(&theirs) {
            continue;
        }
        let Some(reason) = undecided(course, top, other, [own, theirs]) else { continue };
        match found.iter_mut().find(|(id, _)| *id == own) {
            None => found.push((own, vec![(theirs, reason)])),
            Some((_, rivals)) if rivals.iter().all(|(id, _)| *id != theirs) => rivals.push((theirs, reason)),
            Some(_) => {}
        }
    }
    found
}

/// Why these logs don't tell two explanations apart, if they don't.
fn undecided(course: &Course, top: &Explanation, other: &Explanation, [own, theirs]: [&str; 2]) -> Option<String> {
    let (left, their_left) = (top.judged.left, other.judged.left);
    let floor = top.judged.floor.max(other.judged.floor);
    let within = |times: f64| top.probability < times * other.probability;
    let is_good = left.max(their_left) < GOOD;
    let has_gap = course.has_gap();
    // Where nothing was left to begin with, all of them leave nothing: what tells them apart is how far the numbers have to go.
    let is_told_apart = !has_gap || !within(TOLD_APART);
    let both = || format!("{own} leaves {:.1} % of the gap and {theirs} {:.1} %", 100.0 * left, 100.0 * their_left);
    // What leaves as much is as good, be the form wrong in the same way.
    if !is_told_apart && (left - their_left).abs() < floor && is_good {
        Some(format!("{}, while these logs resolve {:.1} %", both(), 100.0 * floor))
    } else if !is_told_apart && (left - their_left).abs() < ALIKE * left && left.max(their_left) < HALF {
        Some(format!("{}: what one form lacks, the other lacks as well", both()))
    } else if within(SAME_PROBABILITY) && is_good {
        Some(if has_gap {
            format!("{}, and neither is {SAME_PROBABILITY:.0} times as probable as the other", both())
        } else {
            format!(
                "with {own} and with {theirs} alike nothing stays but noise, so that only what the numbers' shifts cost and what shows \
                 below the noise tell"
            )
        })
    } else {
        None
    }
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
    use crate::diagnose::hypothesis::Freedom;
    use crate::diagnose::records::record;
    use crate::diagnose::search::Candidate;
    use crate::diagnose::spread::Scattered;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use std::sync::atomic::AtomicUsize;

    /// What `of` makes of the refit of a bench that stands still.
    fn of_a_still_bench(of: impl FnOnce(&Search<'_>, &Candidate)) {
        let model = thesis();
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; 400], displacement_m: vec![1e-8; 400], ..Log::default() };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let search = Search { bench: &bench, simulations: &AtomicUsize::new(0) };
        of(&search, &search.refit(Freedom::Rest));
    }

    /// An explanation by one effect that leaves some of the gap, with what its numbers' shifts cost.
    fn explanation(refit: &Candidate, id: &'static str, probability: f64, [left, prior_cost]: [f64; 2]) -> Explanation {
        let mut explanation = Explanation::by_fit(refit, left, 0.01);
        explanation.judged.ids = vec![id];
        explanation.judged.prior_cost = prior_cost;
        explanation.probability = probability;
        explanation
    }

    /// That none of the registry's explains a gap is not said where all of them together are more probable, though each is less.
    #[test]
    fn unknown_is_weighed_against_all_that_explain() {
        of_a_still_bench(|search, refit| {
            let said = |of: &[(&'static str, f64)], unknown: f64, no_gap: f64| {
                let explanations = of.iter().map(|(id, p)| explanation(refit, id, *p, [0.6, 0.0])).collect();
                let course =
                    Course { unknown, no_gap, ..Course::new(refit.clone(), explanations, Scattered::default()) };
                let (verdict, top, _) = named(search, &course, &[]);
                (verdict, top.map(|top| top.judged.ids[0]))
            };
            let lags = [("amplifier_bandwidth", 0.3), ("transport_delay", 0.25)];
            assert_eq!(said(&lags, 0.45, 0.0), (Verdict::Explained, Some("amplifier_bandwidth")));
            assert_eq!(said(&lags[..1], 0.7, 0.0), (Verdict::Unknown, None));
            // None that is less probable than that there is no gap.
            assert_eq!(said(&lags, 0.01, 0.44), (Verdict::NoGap, None));
        });
    }

    /// What would do in the place of the first of two effects was not compared with the second.
    #[test]
    fn each_of_two_effects_has_rivals_of_its_own() {
        of_a_still_bench(|_search, refit| {
            let pair = |ids: [&'static str; 2], probability: f64| {
                let mut explanation = explanation(refit, ids[0], probability, [0.01, 0.0]);
                explanation.judged.ids = ids.to_vec();
                explanation
            };
            let pairs =
                [(["creep", "backlash"], 0.4), (["creep", "end_stop"], 0.2), (["sensor_drift", "backlash"], 0.2)];
            let far = [(["creep", "quantisation"], 0.01), (["mains_hum", "end_stop"], 0.19)];
            let explanations = pairs.into_iter().chain(far).map(|(ids, probability)| pair(ids, probability)).collect();
            let course = Course::new(refit.clone(), explanations, Scattered::default());
            let found: Vec<(&str, Vec<&str>)> = rivalries(&course, &course.explanations[0], &[])
                .into_iter()
                .map(|(own, rivals)| (own, rivals.into_iter().map(|(id, _)| id).collect()))
                .collect();
            assert_eq!(found, [("backlash", vec!["end_stop"]), ("creep", vec!["sensor_drift"])]);
        });
    }

    /// A form that lacks something shifts numbers for it, the nearer one no less than others.
    #[test]
    fn where_nothing_is_believed_what_leaves_least_is_the_nearest() {
        of_a_still_bench(|_search, refit| {
            let lags = vec![
                explanation(refit, "amplifier_bandwidth", 0.27, [0.99, 53.0]),
                explanation(refit, "vibration_mode", 0.03, [0.41, 220.0]),
            ];
            let course = Course::new(refit.clone(), lags, Scattered::default());
            let first = |unknown: f64, named: Option<&Explanation>| -> Vec<String> {
                let shares = shares_of_known(&course, [0.0, unknown], named);
                let ranking = ranking(&course, &shares, [0.0, unknown], named, None, &[]);
                assert!((ranking.iter().map(|r| r.probability).sum::<f64>() - 1.0).abs() < 1e-12);
                assert!((probability(&ranking, "unknown") - unknown / (0.3 + unknown)).abs() < 1e-12);
                ranking[..3].iter().map(|r| r.effect.clone()).collect()
            };
            assert_eq!(first(0.7, None), ["unknown", "vibration_mode", "amplifier_bandwidth"]);
            assert_eq!(first(0.2, Some(&course.explanations[0])), ["amplifier_bandwidth", "unknown", "vibration_mode"]);
        });
    }

    #[test]
    fn no_gap_hides_gains_before_anything_else() {
        of_a_still_bench(|search, refit| {
            let course = Course::new(refit.clone(), Vec::new(), Scattered::default());
            let told = |surprises, without: &[&str]| {
                ranking(&course, &[], [0.99, 0.01], None, None, &hidden(search.bench, surprises, without))
            };
            let of = |without: &[&str]| told(false, without);
            let first = |ranking: &[Ranked]| -> Vec<String> { ranking[..3].iter().map(|r| r.effect.clone()).collect() };
            assert_eq!(first(&of(&[])), ["no_gap", "amplifier_gain", "sensor_gain"]);
            assert_eq!(set90(&of(&[])), ["no_gap"]);
            assert_eq!(first(&of(&["amplifier_gain"])), ["no_gap", "sensor_gain", "unknown"]);
            for ranking in [of(&[]), of(&WITHIN_STATED)] {
                assert!((ranking.iter().map(|r| r.probability).sum::<f64>() - 1.0).abs() < 1e-12);
            }
            assert_eq!(probability(&of(&WITHIN_STATED), "sensor_gain"), 0.0);
            // A gain makes no log be missed that was not fitted; a number or a zero that the fitted rows leave open does.
            assert_eq!(set90(&told(true, &[])), ["no_gap", "sensor_offset", "parameter_error"]);
            assert_eq!(set90(&told(true, &LEFT_OPEN)), ["no_gap"]);
        });
    }

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
        let all: [(&[&str], f64); 5] = [
            (&["creep", "backlash"], 6.0),
            (&["creep"], 2.0),
            (&["creep"], 3.0),
            (&["backlash"], -1.0),
            (&["creep", "end_stop"], 5.0),
        ];
        let of = |ids: &[&str], id| score_without(all.into_iter(), ids, id);
        assert_eq!([of(all[0].0, "backlash"), of(all[0].0, "creep")], [Some(3.0), Some(-1.0)]);
        // Nobody tried the rest, or there is none.
        assert_eq!([of(all[4].0, "creep"), of(all[1].0, "creep")], [None, None]);
    }

    #[test]
    fn what_makes_little_beside_an_effect_is_needed_little() {
        assert_eq!(needed_beside(1e-16, 0.0), NOT_NEEDED);
        assert!((needed_beside(1e-16, 3e-16) - 3.0 * 2f64.ln()).abs() < 1e-12);
        assert!((needed_beside(1e-16, 1.0) - 1.5 * 1e16f64.ln()).abs() < 1e-9);
        assert!(needed_beside(0.0, 1e-16).is_finite());
    }

    #[test]
    fn explanations_are_rivals_where_they_differ_in_one_member() {
        assert_eq!(differing(&["creep"], &["sensor_drift"]), Some(["creep", "sensor_drift"]));
        assert_eq!(differing(&["creep", "backlash"], &["end_stop", "creep"]), Some(["backlash", "end_stop"]));
        assert_eq!(differing(&["creep"], &["creep"]), None);
        assert_eq!(differing(&["creep"], &["creep", "backlash"]), None);
    }
}
