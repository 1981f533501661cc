//! The experiment that best splits what these logs leave open, within the rig's limits.
//!
//! Each rival plays each SPEC with the numbers of its own fit. What counts is how many pairs of rivals are then set apart by the noise or
//! more, offsets taken out, and next how far the nearest of those are. Fits that agree on these logs and disagree there are told apart there.

use super::bench::Bench;
use super::explanation::Explanation;
use super::judge::Course;
use super::verdict::differing;
use plant_sim::chain::Chain;
use plant_sim::effects::{Kind, find};
use plant_sim::experiment::{Program, Setup, open_loop};
use plant_sim::replay::Start;
use plant_sim::spec::{Shape, Spec};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;

/// SPECs that split most, for a rig of 60 V.
const STANDARD: [&str; 5] = [
    "zero@10s",
    "ladder:60V/4,hold=2s",
    "minor-loops:60V@1Hz+minor-loops:60V@10Hz+minor-loops:60V@50Hz",
    "sine:60V@50Hz,for=0.5s+sine:40V@50Hz,for=0.5s+sine:20V@50Hz,for=0.5s",
    "multisine:15V@5-1500Hz,periods=4,for=1s",
];
/// The volts that the registry's SPECs are written for.
const WRITTEN_FOR_V: f64 = 60.0;
/// Rivals that are compared.
const MOST_RIVALS: usize = 4;
/// Rows that a comparison needs; a long SPEC is compared at a lower rate, but not below this one.
const ROWS: f64 = 60_000.0;
const LEAST_RATE_HZ: f64 = 5_000.0;
/// Longest SPEC that is tried, and the length of one that states none, seconds.
const LONGEST_S: f64 = 60.0;
const USUAL_S: f64 = 2.0;
/// A SPEC that would drive the stage beyond its limit is tried once more at this share.
const GENTLER: f64 = 0.7;
/// Two rivals count as told apart at a difference of this many times the noise, rms.
const APART: f64 = 1.0;

/// An experiment.
#[derive(Clone, Debug, Serialize)]
pub struct NextExperiment {
    /// What to drive with.
    pub spec: String,
    /// Samples per second.
    pub rate_hz: f64,
    /// Entries that it tells apart.
    pub splits: Vec<String>,
    /// Why this one.
    pub reason: String,
}

/// The experiment for `members`, or why there is none.
pub(super) fn next_experiment(
    bench: &Bench<'_>,
    course: &Course,
    top: Option<&Explanation>,
    members: &[String],
) -> Result<NextExperiment, String> {
    let Some(top) = top.or(course.explanations.first()) else {
        return Err("there is no gap to explain".to_owned());
    };
    let mut rivals: Vec<(&str, &Explanation)> = Vec::new();
    for member in members.iter().map(String::as_str) {
        let stands_for = |e: &&Explanation| {
            e.judged.ids.contains(&member)
                && (std::ptr::eq(*e, top) || differing(&top.judged.ids, &e.judged.ids).is_some())
        };
        // Members of one explanation are no rivals.
        if let Some(explanation) = course.explanations.iter().find(stands_for)
            && rivals.iter().all(|(_, known)| !std::ptr::eq(*known, explanation))
        {
            rivals.push((member, explanation));
        }
    }
    rivals.truncate(MOST_RIVALS);
    if rivals.len() < 2 {
        return Err("no two entries are left that an experiment could split".to_owned());
    }
    // What only scatters is told by how it scatters: its own experiment says how.
    let scatters = |id: &str| find(id).is_some_and(|e| e.forms().iter().all(|f| f.kind != Kind::Predictable));
    // To a thousandth of a hertz: a board's rates are whole parts of its clock.
    let rate_hz = (1e3 * bench.records.iter().map(|r| r.log.dt_s.recip()).fold(0.0, f64::max)).round() / 1e3;
    let range_v = range_v(bench);
    let full = |text: &str| limit_v(text, range_v) / WRITTEN_FOR_V;
    let chains: Vec<Chain> =
        rivals.iter().map(|(_, e)| bench.chain_at(&e.candidate.hypothesis, &e.candidate.found.z, 0)).collect();
    // A SPEC as large as the stage stands, with how far it sets the rivals apart.
    let within = |text: &str| {
        let full = full(text);
        [full, GENTLER * full].into_iter().find_map(|factor| {
            let spec = scaled(text, factor)?;
            Some((apart(bench, &chains, &spec, rate_hz)?, spec))
        })
    };
    let splits = || rivals.iter().map(|(id, _)| (*id).to_owned()).collect::<Vec<_>>();
    if let Some(about) = rivals.iter().find(|(id, _)| scatters(id)).and_then(|(id, _)| find(id)).map(|e| e.about())
        && let Some((_, spec)) = within(about.spec)
    {
        return Ok(NextExperiment { spec, rate_hz, splits: splits(), reason: format!("{}.", about.experiment) });
    }
    let own = rivals.iter().filter_map(|(id, _)| find(id)).map(|effect| effect.about().spec);
    let texts: BTreeSet<&str> = own.chain(STANDARD).filter(|text| !text.is_empty()).collect();
    let best = texts
        .par_iter()
        .filter_map(|text| within(text).map(|((pairs, least), spec)| (pairs, least, spec)))
        .max_by(|a, b| a.0.len().cmp(&b.0.len()).then(a.1.total_cmp(&b.1)));
    match best {
        Some((pairs, least, spec)) if !pairs.is_empty() => {
            let is_split = |at: usize| pairs.iter().any(|pair| pair.contains(&at));
            let splits = (0..rivals.len()).filter(|at| is_split(*at)).map(|at| rivals[at].0.to_owned()).collect();
            Ok(NextExperiment {
                spec,
                rate_hz,
                splits,
                reason: format!(
                    "with the numbers that fit these logs, the nearest pair that it sets apart is {least:.1} times the noise apart there \
                     (rms, offsets taken out)."
                ),
            })
        }
        _ => Err(without_command(&rivals)),
    }
}

/// What to do where no command separates the rivals.
fn without_command(rivals: &[(&str, &Explanation)]) -> String {
    let names: Vec<&str> = rivals.iter().map(|(id, _)| *id).collect();
    let mut advice: Vec<String> =
        rivals.iter().filter_map(|(id, _)| find(id)).map(|e| format!("{}: {}", e.id(), e.about().experiment)).collect();
    if names.contains(&"parameter_error") {
        advice.push(
            "parameter_error: measure the number by itself (weigh the mass, load the stage statically)".to_owned(),
        );
    }
    format!(
        "no command within the rig's limits sets {} apart by as much as the noise. What does: {}",
        names.join(", "),
        advice.join(". ")
    )
}

/// Volts to drive with, from and to: the rig's as far as it may move, or those of the logs.
fn range_v(bench: &Bench<'_>) -> [f64; 2] {
    match &bench.model.rig {
        Some(rig) => {
            let most_v = displacement_limit_m(bench) / bench.chain.plant.static_gain_m_per_v();
            [rig.drive_min_v.value.max(-most_v), rig.drive_max_v.value.min(most_v)]
        }
        None => bench.scales().command_v,
    }
}

/// Largest amplitude that `spec` may have within the range: where it swings both ways the smaller side's, else that of its own side. Many stages are
/// driven with one sign only, or hardly with the other.
fn limit_v(spec: &str, [low_v, high_v]: [f64; 2]) -> f64 {
    let parts = Spec::parse(spec).map(|spec| spec.parts).unwrap_or_default();
    let sides = parts.iter().map(|part| match part.shape {
        Shape::Zero => [false; 2],
        Shape::Hold | Shape::Step | Shape::Ladder { .. } => [part.amplitude < 0.0, part.amplitude > 0.0],
        _ => [true; 2],
    });
    let [is_low, is_high] = sides.fold([false; 2], |all, one| [all[0] || one[0], all[1] || one[1]]);
    let low_v = if is_low { -low_v } else { f64::INFINITY };
    let high_v = if is_high { high_v } else { f64::INFINITY };
    // What drives nothing has no volts to scale.
    let limit_v = low_v.min(high_v).max(0.0);
    if limit_v.is_finite() { limit_v } else { WRITTEN_FOR_V }
}

fn displacement_limit_m(bench: &Bench<'_>) -> f64 {
    bench.model.rig.as_ref().map_or(f64::INFINITY, |rig| rig.displacement_max_um.value * 1e-6)
}

/// Pairs of chains that `spec` sets apart, and the least of their distances in units of the noise; `None` for a SPEC that can't be
/// played here.
fn apart(bench: &Bench<'_>, chains: &[Chain], spec: &str, rate_hz: f64) -> Option<(Vec<[usize; 2]>, f64)> {
    let spec = Spec::parse(spec).ok()?;
    let seconds: Option<f64> = spec.parts.iter().map(|part| part.seconds).sum();
    let seconds = seconds.unwrap_or(USUAL_S);
    if seconds > LONGEST_S {
        return None;
    }
    let rate_hz = (ROWS / seconds).max(LEAST_RATE_HZ).min(rate_hz);
    let program = Program::new(&spec, rate_hz).ok()?;
    let samples = program.samples().unwrap_or((USUAL_S * rate_hz) as usize);
    let played: Vec<Vec<f64>> = chains
        .iter()
        .map(|chain| {
            let start = Start::relaxed(chain);
            let latency_s = bench.records[0].log.meta.latency_s;
            let setup = Setup { chain, start: &start, rate_hz, samples, latency_s, seed: 1 };
            let recording = open_loop(&setup, &program, &|_| {}).ok()?;
            (recording.peak_m <= displacement_limit_m(bench)).then_some(recording.displacement_m)
        })
        .collect::<Option<_>>()?;
    let noise2 = bench.records.iter().map(|r| r.noise_m.powi(2)).sum::<f64>() / bench.records.len() as f64;
    let (mut pairs, mut least) = (Vec::new(), f64::INFINITY);
    for i in 0..played.len() {
        for j in i + 1..played.len() {
            let difference: Vec<f64> = played[i].iter().zip(&played[j]).map(|(a, b)| a - b).collect();
            let mean = difference.iter().sum::<f64>() / difference.len() as f64;
            let mean2 = difference.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / difference.len() as f64;
            let distance = (mean2 / noise2).sqrt();
            if distance >= APART {
                pairs.push([i, j]);
                least = least.min(distance);
            }
        }
    }
    Some((pairs, least))
}

/// A SPEC with its volts times `factor`, rounded down to two digits; `None` if nothing is left of them.
fn scaled(spec: &str, factor: f64) -> Option<String> {
    if spec.is_empty() {
        return None;
    }
    let parts: Option<Vec<String>> = spec
        .split('+')
        .map(|part| {
            let Some((kind, rest)) = part.split_once(':') else { return Some(part.to_owned()) };
            let Some((amplitude, after)) = rest.split_once('V') else { return Some(part.to_owned()) };
            let volts = amplitude.parse::<f64>().ok()? * factor;
            let unit = 10f64.powf(volts.abs().log10().floor() - 1.0);
            let volts = ((volts.abs() / unit + 1e-9).floor() * unit).copysign(volts);
            (volts.is_finite() && volts != 0.0).then(|| format!("{kind}:{}V{after}", (volts * 1e6).round() / 1e6))
        })
        .collect();
    parts.map(|parts| parts.join("+"))
}

#[cfg(test)]
mod tests {
    use super::{STANDARD, limit_v, scaled};
    use plant_sim::effects::REGISTRY;
    use plant_sim::spec::Spec;

    #[test]
    fn volts_are_scaled_and_nothing_else() {
        assert_eq!(scaled("ladder:60V/8,hold=2s", 0.5).as_deref(), Some("ladder:30V/8,hold=2s"));
        assert_eq!(scaled("zero@10s+sine:60V@50Hz,for=2s", 1.061).as_deref(), Some("zero@10s+sine:63V@50Hz,for=2s"));
        assert_eq!(
            scaled("multisine:15V@4-1500Hz,periods=4", 0.011).as_deref(),
            Some("multisine:0.16V@4-1500Hz,periods=4")
        );
        assert_eq!(scaled("ladder:-60V/2,hold=1s", 0.51).as_deref(), Some("ladder:-30V/2,hold=1s"));
        assert_eq!(scaled("sine:60V@50Hz", 0.0), None);
    }

    #[test]
    fn a_stage_that_is_driven_one_way_is_not_driven_the_other() {
        let both = "sine:60V@50Hz,for=2s+ladder:60V/4,hold=2s";
        let of =
            |range_v| [both, "ladder:60V/4,hold=2s", "ladder:-60V/4,hold=2s", "zero@2s"].map(|s| limit_v(s, range_v));
        assert_eq!(of([-60.0, 60.0]), [60.0; 4]);
        assert_eq!(of([-20.0, 120.0]), [20.0, 120.0, 20.0, 60.0]);
        assert_eq!(of([0.0, 100.0]), [0.0, 100.0, 0.0, 60.0]);
        // A stage that never comes back to zero.
        assert_eq!(of([10.0, 100.0])[0], 0.0);
    }

    #[test]
    fn every_scaled_spec_can_be_played() {
        let specs = REGISTRY.iter().map(|effect| effect.about().spec).chain(STANDARD).filter(|spec| !spec.is_empty());
        for spec in specs {
            let scaled = scaled(spec, 0.83).unwrap_or_default();
            assert!(Spec::parse(&scaled).is_ok(), "{spec} became {scaled}");
        }
    }
}
