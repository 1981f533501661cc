//! Effects that change what can't be predicted: they close no gap row by row, but the plant is told of them.
//!
//! Some the course reads from how the residual scatters. Noise beyond what the plant's file states is judged here: the fits count in
//! units of the noise that the logs show, so no fit ever misses it.

use super::bench::Bench;
use super::events::{Losses, Lost};
use super::spread::Scattered;
use plant_sim::effects::{Effect, Form, find_form};
use plant_sim::model::{EffectSection, Model};
use plant_sim::param::Param;

/// What is measured counts as more than stated beyond this many of the statement's sigma, ..
const SIGMAS: f64 = 4.0;
/// .. and noise beyond this share of it, whatever sigma is claimed.
const LEAST_SHARE: f64 = 0.25;
/// A lattice that makes more than this share of the excess is what there is: dither of triangular density, the largest in use, leaves three times what the
/// steps alone do (Wannamaker, Lipshitz, Vanderkooy and Wright, IEEE Trans. Signal Process. 48, 499, 2000).
const LATTICE_SHARE: f64 = 0.3;
/// Probability that noise judged so is what it is taken for: there are other reasons for a wrong data sheet.
pub(super) const CONFIDENCE: f64 = 0.97;
/// Relative sigma of a size that only scatter tells, where the scatter doesn't say itself.
const SCATTER_SIGMA: f64 = 0.1;

/// An effect that no simulation predicts, with its size.
#[derive(Clone)]
pub(super) struct Random {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Its form.
    pub form: &'static Form,
    /// Values of its parameters.
    pub values: Vec<f64>,
    /// Their standard deviations.
    pub sigmas: Vec<f64>,
    /// Mean square that it adds to each row, metres squared.
    pub power_m2: f64,
}

/// Noise beyond what the model's file states, if it states any.
pub(super) fn beyond_stated(model: &Model, bench: &Bench<'_>, without: &[&str]) -> Option<Random> {
    let stated = model.sensor.noise_um.as_ref().filter(|noise| noise.value > 0.0)?;
    let stated_m = stated.value * 1e-6;
    let mean = |of: &dyn Fn(&super::bench::Record<'_>) -> f64| {
        let rows: usize = bench.records.iter().map(|r| r.log.len()).sum();
        bench.records.iter().map(|r| of(r) * r.log.len() as f64).sum::<f64>() / rows.max(1) as f64
    };
    // What a plant that has the effect already says of it is stated too.
    let white_m = stated_m.max(bench.model.chain().sensor.noise_m);
    let stated2 = white_m.powi(2) + mean(&|r| r.scatter_m * r.scatter_m);
    let measured2 = mean(&|r| r.noise_m * r.noise_m);
    let allowed = 1.0 + (SIGMAS * stated.relative_sigma()).max(LEAST_SHARE);
    let excess2 = measured2 - stated2;
    if measured2.sqrt() <= allowed * stated2.sqrt() {
        return None;
    }
    let lattice2 = mean(&|r| r.lattice_m * r.lattice_m / 12.0);
    let is_lattice = lattice2 > LATTICE_SHARE * excess2;
    let (id, form, value) = if is_lattice {
        let step_m = bench.records.iter().map(|r| r.lattice_m).fold(0.0, f64::max);
        ("quantisation", "converter-in", step_m)
    } else {
        ("noise_excess", "white", excess2.sqrt())
    };
    if without.contains(&id) {
        return None;
    }
    // d(excess) = (stated / excess) d(stated), and what a few thousand rows leave open.
    let sigma = if is_lattice {
        1e-3 * value
    } else {
        (stated2 / excess2.sqrt() * stated.relative_sigma()).hypot(0.01 * value)
    };
    random(id, form, vec![value], vec![sigma], if is_lattice { excess2.max(lattice2) } else { excess2 })
}

/// Rows that repeat the reading before; `scattered` is what they leave.
pub(super) fn repeated(bench: &Bench<'_>, scattered: &Scattered) -> Option<Random> {
    let share = scattered.repeated_share;
    let rows: usize = bench.records.iter().map(|r| r.log.len() - r.run_in).sum();
    let sigma = (share / rows.max(1) as f64).sqrt();
    if share > 0.0 { random("lost_samples", "repeated", vec![share], vec![sigma], scattered.repeated_m2) } else { None }
}

/// Commands that never arrived, or readings that stayed.
pub(super) fn lost(losses: &Losses) -> Option<Random> {
    let form = match losses.lost {
        Lost::Commands => "held-command",
        Lost::Readings => "repeated",
    };
    random("lost_samples", form, vec![losses.share], vec![losses.sigma], losses.power_m2)
}

/// What of `lost` the plant does not state already, if that is more than its sigma, and the statement's, leave open.
pub(super) fn more_than_stated(lost: Random, model: &Model) -> Option<Random> {
    let is_same = |stated: &&EffectSection| stated.id == lost.effect.id() && stated.form == lost.form.name;
    let stated: Vec<&Param> =
        model.effects.iter().filter(is_same).filter_map(|stated| stated.parameters.get("share")).collect();
    let (&[share], &[sigma], false) = (&lost.values[..], &lost.sigmas[..], stated.is_empty()) else {
        return Some(lost);
    };
    let more = share - stated.iter().map(|stated| stated.value).sum::<f64>();
    let sigma = stated.iter().map(|stated| stated.value * stated.relative_sigma()).fold(sigma, f64::hypot);
    let power_m2 = lost.power_m2 * more / share;
    (more > SIGMAS * sigma).then(|| Random { values: vec![more], sigmas: vec![sigma], power_m2, ..lost })
}

/// What was read from scatter, with the power that it accounts for.
pub(super) fn size_of_scatter(effect: &'static dyn Effect, form: &'static Form, scattered: &Scattered) -> Random {
    let excess_m = scattered.excess_m2.max(0.0).sqrt();
    let (value, sigma, power_m2) = match effect.id() {
        "sampling_jitter" => (scattered.jitter_s, scattered.jitter_sigma_s, scattered.jitter_m2),
        _ => (excess_m, SCATTER_SIGMA * excess_m, excess_m * excess_m),
    };
    Random { effect, form, values: vec![value], sigmas: vec![sigma], power_m2 }
}

fn random(id: &str, form: &str, values: Vec<f64>, sigmas: Vec<f64>, power_m2: f64) -> Option<Random> {
    let (effect, form) = find_form(id, form)?;
    Some(Random { effect, form, values, sigmas, power_m2 })
}

impl Random {
    /// Values and sigmas of all of the form's parameters: those that scatter doesn't tell are the first that a search would try.
    pub fn complete(&self, bench: &Bench<'_>) -> Vec<(plant_sim::effects::Parameter, f64, f64)> {
        let scales = bench.scales();
        let parameters = (self.form.parameters)(&scales);
        parameters
            .into_iter()
            .zip(self.form.typical(&scales))
            .enumerate()
            .map(|(i, (parameter, usual))| {
                let value = self.values.get(i).copied().unwrap_or(usual);
                let sigma = self.sigmas.get(i).copied().unwrap_or(value.abs());
                (parameter, value, sigma)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::log::Log;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// Readings in coarse steps are told as such, dithered or not; noise that is larger than any dither is noise.
    #[test]
    fn a_converter_is_known_by_its_steps_though_it_is_dithered() {
        const STEP_M: f64 = 170e-9;
        const STATED_M: f64 = 38e-9;
        let mut model = thesis();
        model.sensor.noise_um = Some(Param::new(1e6 * STATED_M, 0.1, "data sheet"));
        let told = |dithers: usize, noise_m: f64| {
            let mut random = Pcg64::seed_from_u64(7);
            let mut uniform = || random.random_range(-0.5..0.5);
            let displacement_m = (0..4000).map(|k| {
                let smooth_m = 30e-6 * (0.01 * f64::from(k)).sin() + 12f64.sqrt() * noise_m * uniform();
                let dither_m: f64 = (0..dithers).map(|_| STEP_M * uniform()).sum();
                ((smooth_m + dither_m) / STEP_M).round() * STEP_M
            });
            let displacement_m: Vec<f64> = displacement_m.collect();
            let log = Log { dt_s: 5e-5, command_v: vec![0.0; 4000], displacement_m, ..Log::default() };
            let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
            let found = beyond_stated(&model, &bench, &[]).unwrap();
            (found.effect.id(), found.values[0], found.power_m2.sqrt())
        };
        for dithers in 0..3 {
            let (id, step_m, rms_m) = told(dithers, STATED_M);
            assert_eq!(id, "quantisation");
            assert!((step_m / STEP_M - 1.0).abs() < 1e-3, "{step_m:e}");
            let expected_m = STEP_M * ((1.0 + dithers as f64) / 12.0).sqrt();
            assert!((rms_m / expected_m - 1.0).abs() < 0.1, "{rms_m:e} where {expected_m:e} were put in");
        }
        assert_eq!(told(2, 2.0 * STEP_M).0, "noise_excess");
    }
}
