//! What a log says before anything is fitted: its noise, the lattice of its converter, and the drive before its first row.

use super::bench::{Record, extremes};
use crate::residual::{noise_rms, noise_rms_on};
use plant_sim::chain::{Chain, Sensor};
use plant_sim::log::Log;
use plant_sim::param::Param;
use plant_sim::replay::{Reader, Start, predict};

/// Floor of the noise in metres: of less no sensor is capable, and two integrators of the same plant differ by as much.
const LEAST_NOISE_M: f64 = 1e-10;
/// Stretches into which a log is cut.
const STRETCHES: usize = 40;
/// A first displacement this close to what zero volts or the first command would hold says that it was held, in shares of the span.
const NEAR: f64 = 0.05;
/// Uncertainty of a drive before the log that was recognised, and of one that was not, in shares of the span.
const RECOGNISED: f64 = 0.005;
const UNKNOWN: f64 = 1.0;
/// Values of a lattice may lie this far off it, in steps.
const OFF_LATTICE: f64 = 0.02;
/// Times by which a log's noise may be overestimated where the other logs show less.
pub(super) const ROUGH: f64 = 1.2;
/// Rows that tell whether a log is rough by its motion: so many say it as well as all.
const LOOKED_AT: usize = 100_000;
/// A monitor's own error in shares of its span: no divider is better calibrated than that.
const MONITOR_ACCURACY: f64 = 2e-3;
/// Steps of a monitor's converter are finer than this share of its span.
const FINEST_LADDER: f64 = 1.0 / 64.0;
/// The stated noise is believed if it is above what differences show by no more than this many of its sigma.
const STATED_SIGMAS: f64 = 3.0;
/// Rows that a reading must not repeat by chance, beyond so many times what chance makes.
const LEAST_REPEATS: usize = 3;
const MORE_THAN_CHANCE: f64 = 4.0;
/// The plant stands where none of so many readings in a row differ by more than so many of their digits.
const AROUND: usize = 3;
const STILL: f64 = 2.5;
/// Distinct values that a lattice needs.
const LEAST_DISTINCT: usize = 4;

/// The record of `log`.
pub fn record<'a>(log: &'a Log, chain: &Chain, run_in_s: Option<f64>) -> Record<'a> {
    let run_in = log.meta.run_in_rows(run_in_s, log.dt_s).min(log.len());
    let lattice_m = lattice(&log.displacement_m[run_in..]).unwrap_or(0.0);
    let smooth_m = noise_rms_on(&log.displacement_m[run_in..], lattice_m);
    // A lattice coarser than the noise hides it from differences; its own rounding is noise enough.
    let noise_m = if lattice_m > smooth_m { smooth_m.max(lattice_m / 12f64.sqrt()) } else { smooth_m };
    let lattice_m = if lattice_m > 0.5 * noise_m { lattice_m } else { 0.0 };
    let before_v = before(log, chain);
    let jitter_m = jitter_m(log, chain, before_v[0]);
    let Sensor { slow_noise_m, quantum_m, .. } = chain.sensor;
    Record {
        log,
        run_in,
        noise_m: noise_m.max(LEAST_NOISE_M),
        not_motion: if lattice_m > 0.0 { 1.0 } else { not_motion(log, chain, before_v[0], run_in) },
        jitter_m,
        scatter_m: jitter_m.hypot(slow_noise_m.hypot(quantum_m / 12f64.sqrt())),
        lattice_m,
        is_lost: if lattice_m > 0.0 { Vec::new() } else { lost(&log.displacement_m, noise_m.max(LEAST_NOISE_M)) },
        before_v,
        held_stretch: Some(((log.len() - run_in) / STRETCHES).max(16)),
        monitor_v: log.drive_v.as_ref().map(|drive_v| {
            let [low, high] = extremes(drive_v.iter().copied());
            // Coarser is no converter: a ladder's own steps.
            let step_v = lattice(drive_v).filter(|step_v| *step_v < FINEST_LADDER * (high - low));
            let rounding_v = step_v.unwrap_or(0.0) / 12f64.sqrt();
            noise_rms(drive_v).max(rounding_v).max(MONITOR_ACCURACY * (high - low)).max(1e-9)
        }),
    }
}

/// Share of the noise in a log's differences that is none of its motion: a plant that is sampled not much faster than it moves is rough by itself,
/// and what the nominal one tells of that is no noise. One where that is hardly anything.
fn not_motion(log: &Log, chain: &Chain, before_v: f64, run_in: usize) -> f64 {
    let rows = run_in..log.len().min(run_in + LOOKED_AT);
    let start = Start::at_rest(chain, before_v, vec![0.0; chain.plant.hysterons.len()]);
    let predicted_m = predict(chain, log, &start, rows.end);
    let measured_m = &log.displacement_m[rows.clone()];
    let missed_m: Vec<f64> = measured_m.iter().zip(&predicted_m[rows]).map(|(y, predicted)| y - predicted).collect();
    let share = noise_rms(&missed_m) / noise_rms(measured_m);
    if share.is_finite() && ROUGH * share < 1.0 { share } else { 1.0 }
}

/// Rms in metres of what errors of the instants that `chain` states do to `log`, which a motion has and no rest.
fn jitter_m(log: &Log, chain: &Chain, before_v: f64) -> f64 {
    if chain.sensor.jitter_s == 0.0 {
        return 0.0;
    }
    let start = Start::at_rest(chain, before_v, vec![0.0; chain.plant.hysterons.len()]);
    let mut reader = Reader::new(chain, log, &start);
    let mut squares = 0.0;
    for _ in 0..log.len() {
        reader.next_m();
        squares += reader.stream.motion.1.powi(2);
    }
    let jitter_m = chain.sensor.jitter_s * (squares / log.len() as f64).sqrt();
    if jitter_m.is_finite() { jitter_m } else { 0.0 }
}

/// Rows that repeat the one before, if there are too many for chance: noise takes a reading back to where it was once in a while, the
/// more often the fewer digits are written.
fn lost(readings_m: &[f64], noise_m: f64) -> Vec<bool> {
    let repeats = |pair: &[f64]| pair[0] == pair[1];
    let mut sorted = readings_m.to_vec();
    sorted.sort_by(f64::total_cmp);
    let distances = sorted.windows(2).map(|pair| pair[1] - pair[0]);
    let digit_m = distances.filter(|distance| *distance > 0.0).fold(noise_m, f64::min);
    // The density of the difference of two normal readings at zero.
    let by_chance = readings_m.len() as f64 * digit_m / (2.0 * std::f64::consts::PI.sqrt() * noise_m);
    let mut is_lost: Vec<bool> = std::iter::once(false).chain(readings_m.windows(2).map(repeats)).collect();
    let stands = |rows: &[f64]| rows.windows(2).all(|pair| (pair[1] - pair[0]).abs() < STILL * digit_m);
    let mut row = 0;
    for run in is_lost.chunk_by_mut(|one, next| one == next) {
        let rows = row..row + run.len();
        row = rows.end;
        // A plant at rest under next to no noise repeats itself, and comes there and leaves digit by digit.
        let before = &readings_m[rows.start.saturating_sub(AROUND)..rows.start];
        let after = &readings_m[rows.end - 1..readings_m.len().min(rows.end + AROUND - 1)];
        if stands(before) || stands(after) {
            run.fill(false);
        }
    }
    let count = is_lost.iter().filter(|is_lost| **is_lost).count();
    let is_chance = (count as f64) < LEAST_REPEATS as f64 + MORE_THAN_CHANCE * by_chance;
    if is_chance { Vec::new() } else { is_lost }
}

/// One sensor has one noise: a log whose own differences say more is rough for another reason, which must not pass for noise; where most are, what is none
/// of their motion tells. Where the
/// plant's file states a little more than the differences show, the noise is coloured and the file is right. What the plant states to scatter is noise.
/// A log that stands on a converter's step shows none of it, nor the steps: it has those of the others. So has one monitor one error, which a log
/// that hardly drives does not show.
pub fn share_noise(records: &mut [Record<'_>], stated: Option<&Param>) {
    let shows = |record: &&Record<'_>| record.noise_m > LEAST_NOISE_M;
    let mut all: Vec<f64> = records.iter().filter(shows).map(|record| record.not_motion * record.noise_m).collect();
    all.sort_by(f64::total_cmp);
    let median_m = all.get(all.len().saturating_sub(1) / 2).copied().unwrap_or(LEAST_NOISE_M);
    let lattice_m = records.iter().map(|record| record.lattice_m).fold(0.0, f64::max);
    let monitor_v = records.iter().filter_map(|record| record.monitor_v).reduce(f64::max);
    let stated_m = stated.map_or(0.0, |noise| {
        let stated_m = noise.value * 1e-6;
        let most = 1.0 + STATED_SIGMAS * noise.relative_sigma();
        if stated_m < most * median_m { stated_m } else { 0.0 }
    });
    for record in records {
        if !shows(&&*record) {
            (record.noise_m, record.lattice_m) = (median_m, lattice_m);
        }
        record.monitor_v = record.monitor_v.and(monitor_v);
        record.noise_m = record.noise_m.min(ROUGH * median_m).max(stated_m.hypot(record.scatter_m));
    }
}

/// Drive held before the first row and its uncertainty, from the first displacement.
fn before(log: &Log, chain: &Chain) -> [f64; 2] {
    let [low, high] = extremes(log.command_v.iter().copied());
    let span_v = (high.max(0.0) - low.min(0.0)).max(1e-9);
    let rows = log.len().min(3);
    let first_m = log.displacement_m[..rows].iter().sum::<f64>() / rows as f64;
    let looks_v = (first_m - chain.sensor.offset_m) / chain.plant.static_gain_m_per_v();
    for known_v in [0.0, log.command_v[0]] {
        if (looks_v - known_v).abs() < NEAR * span_v {
            return [known_v, RECOGNISED * span_v];
        }
    }
    [looks_v.clamp(low.min(0.0) - span_v, high.max(0.0) + span_v), UNKNOWN * span_v]
}

/// Step of the lattice on which all values lie, if they do.
pub fn lattice(values: &[f64]) -> Option<f64> {
    let mut sorted: Vec<f64> = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let scale = sorted.first()?.abs().max(sorted.last()?.abs());
    // Printed digits are a lattice of their own; what differs by less than a part in 1e9 is one value.
    let mut distinct = vec![sorted[0]];
    for &value in &sorted {
        if value - distinct[distinct.len() - 1] > 1e-9 * scale {
            distinct.push(value);
        }
    }
    if distinct.len() < LEAST_DISTINCT {
        return None;
    }
    let step = distinct.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    // The least distance is the step to the last printed digit; all distances together sharpen it.
    let count = |step: f64| distinct.windows(2).map(|pair| ((pair[1] - pair[0]) / step).round()).sum::<f64>();
    let step = (distinct[distinct.len() - 1] - distinct[0]) / count(step);
    let on = |value: &&f64| {
        let steps = (**value - distinct[0]) / step;
        (steps - steps.round()).abs() < OFF_LATTICE.max(1e-9 * scale / step)
    };
    (distinct.iter().filter(on).count() as f64 > 0.98 * distinct.len() as f64).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::{ROUGH, lattice, lost, record};
    use crate::diagnose::bench::Bench;
    use crate::diagnose::thesis;
    use crate::residual::noise_rms;
    use plant_sim::log::Log;
    use plant_sim::model::Model;
    use plant_sim::replay::{Start, predict};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A log at rest on one step of a converter shows neither its noise nor its steps, and a monitor's reading of nothing no error.
    #[test]
    fn what_a_log_at_rest_does_not_show_the_others_tell() {
        let model = thesis();
        let moves = |size: f64| {
            let wave = |k: u32| size * (0.01 * f64::from(k)).sin();
            Log {
                dt_s: 5e-5,
                command_v: (0..4000).map(wave).collect(),
                displacement_m: (0..4000).map(|k| (1.5e-6 * wave(k) / 40e-9).round() * 40e-9).collect(),
                drive_v: Some((0..4000).map(|k| (wave(k) / 0.05).round() * 0.05).collect()),
                ..Log::default()
            }
        };
        let logs = [moves(30.0), moves(0.0), moves(20.0)];
        let records = || logs.iter().map(|log| record(log, &model.chain(), None)).collect::<Vec<_>>();
        assert!(records()[1].noise_m < 1e-9 && records()[1].lattice_m == 0.0);
        let bench = Bench::new(&model, records());
        let [first, still, last] = [0, 1, 2].map(|index| &bench.records[index]);
        assert!((still.noise_m / (40e-9 / 12f64.sqrt()) - 1.0).abs() < 0.3, "{:e}", still.noise_m);
        assert!((still.lattice_m / 40e-9 - 1.0).abs() < 1e-3, "{:e}", still.lattice_m);
        assert!(first.monitor_v.is_some_and(|sigma_v| sigma_v >= 2e-3 * 60.0));
        assert!(still.monitor_v == first.monitor_v && last.monitor_v == first.monitor_v);
    }

    /// Logs that are looked at without the others count as they do among them.
    #[test]
    fn a_part_of_the_logs_keeps_its_noise() {
        let model = thesis();
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; 400], displacement_m: vec![0.0; 400], ..Log::default() };
        let of = |noise_m: f64| crate::diagnose::bench::Record { noise_m, ..record(&log, &model.chain(), None) };
        let bench = Bench::new(&model, vec![of(10e-9), of(11e-9), of(11.5e-9)]);
        let noise = |bench: &Bench<'_>| bench.records.iter().map(|record| record.noise_m).collect::<Vec<_>>();
        let all = noise(&bench);
        assert_eq!(noise(&bench.without(2)), all[..2]);
        let rough = Bench::new(&model, vec![of(10e-9), of(20e-9), of(20e-9)]);
        assert_eq!(noise(&rough.without(1)), [10e-9, 20e-9]);
    }

    #[test]
    fn rows_that_repeat_are_lost_unless_chance_made_them() {
        let readings = |repeats: &[usize]| -> Vec<f64> {
            let mut all: Vec<f64> = (0..100).map(|k| f64::from(k * k % 97) + 0.001 * f64::from(k)).collect();
            repeats.iter().for_each(|k| all[*k] = all[k - 1]);
            all
        };
        let rows =
            |all: &[f64]| lost(all, 30.0).iter().enumerate().filter(|(_, l)| **l).map(|(k, _)| k).collect::<Vec<_>>();
        assert_eq!(rows(&readings(&[5, 40])), [0; 0]);
        // A run repeats its first row.
        assert_eq!(rows(&readings(&[5, 40, 41, 42])), [5, 40, 41, 42]);
    }

    /// 2 kHz are little for a bender that rings at 783 Hz: its differences are those of its motion, and a stiffness that is off by 2 % leaves some.
    #[test]
    fn what_a_fast_plant_roughens_is_no_noise() {
        let (model, mut other) = (thesis(), thesis());
        other.structure.stiffness_n_per_m.value *= 1.02;
        let (chain, noise_m) = (other.chain(), 20e-9);
        let mut random = Pcg64::seed_from_u64(5);
        let mut log = Log { dt_s: 5e-4, displacement_m: vec![0.0; 8000], ..Log::default() };
        log.command_v = (0..8000).map(|_| random.random_range(-5.0..5.0)).collect();
        log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
        log.displacement_m.iter_mut().for_each(|y| *y += noise_m * random.random_range(-1.7..1.7));
        let rough_m = noise_rms(&log.displacement_m);
        assert!(rough_m > 20.0 * noise_m, "{rough_m:e}: the motion is to be rough");
        let of = |model: &Model| Bench::new(model, vec![record(&log, &model.chain(), None)]).records[0].noise_m;
        // A log may be by so much rougher than all.
        assert!((of(&other) / (ROUGH * noise_m) - 1.0).abs() < 0.1, "{:e}", of(&other));
        assert!(of(&model) < 0.5 * rough_m);
        // Where the motion is smooth the differences stay what they are.
        let slow = Log { dt_s: 5e-5, command_v: vec![10.0; 8000], displacement_m: vec![19e-6; 8000], ..Log::default() };
        let noisy = |y: f64, random: &mut Pcg64| y + noise_m * random.random_range(-1.7..1.7);
        let slow = Log { displacement_m: slow.displacement_m.iter().map(|y| noisy(*y, &mut random)).collect(), ..slow };
        assert_eq!(record(&slow, &model.chain(), None).not_motion, 1.0);
    }

    #[test]
    fn a_short_rough_log_shows_its_digits_as_well() {
        // Neighbours never lie near one another, values of the whole log do.
        let mut all: Vec<f64> = (0..2000).map(|k| 50e-6 * (f64::from(k) * 1.3).sin()).collect();
        (1..10).for_each(|k| all[100 * k] = all[100 * k - 1]);
        assert_eq!(lost(&all, 40e-9).iter().filter(|lost| **lost).count(), 9);
    }

    #[test]
    fn few_digits_repeat_by_themselves() {
        // Uniform noise of a thousand digits, the same every time.
        let noise = |k: u64| (k.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407) >> 33) % 1000;
        let all: Vec<f64> = (0..20_000).map(|k| 1e-12 * noise(k * k) as f64).collect();
        let repeats = all.windows(2).filter(|pair| pair[0] == pair[1]).count();
        assert!(repeats > 5, "{repeats}: the readings are to repeat");
        assert_eq!(lost(&all, 289e-12), Vec::<bool>::new());
    }

    #[test]
    fn a_plant_at_rest_loses_no_row() {
        // Three steps that settle, written with a picometre's digits and no noise: at rest every reading is the one before.
        let settling = |k: usize| (k / 1000) as f64 * 5e-6 + 5e-6 * (1.0 - (-((k % 1000) as f64) / 20.0).exp());
        let mut all: Vec<f64> = (0..3000).map(|k| (settling(k) * 1e12).round() * 1e-12).collect();
        assert!(all.windows(2).filter(|pair| pair[0] == pair[1]).count() > 1500);
        assert_eq!(lost(&all, 1e-9), Vec::<bool>::new());
        // What is lost on the way is.
        let on_the_way = [20, 21, 22, 1010, 1040, 2005, 2030, 2031];
        on_the_way.iter().for_each(|k| all[*k] = all[k - 1]);
        let found: Vec<usize> = lost(&all, 1e-9).iter().enumerate().filter(|(_, l)| **l).map(|(k, _)| k).collect();
        assert_eq!(found, on_the_way);
    }

    #[test]
    fn a_lattice_is_found_and_nothing_else_is() {
        let smooth: Vec<f64> = (0..5000).map(|k| 40e-6 * (f64::from(k) * 0.01).sin()).collect();
        assert_eq!(lattice(&smooth), None);
        let step = 63e-9;
        // As it is read from a file that prints six decimals of a micrometre.
        let rounded: Vec<f64> = smooth.iter().map(|y| ((y / step).round() * step * 1e12).round() / 1e12).collect();
        let found = lattice(&rounded).expect("found");
        assert!((found / step - 1.0).abs() < 1e-3, "{found:e}");
    }
}
