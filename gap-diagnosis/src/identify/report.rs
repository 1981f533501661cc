//! What a search found, in numbers and words: values with sigma, what is unseen and why, how well each log is replayed.

use super::parameters::{Free, Quantity, Scale};
use super::problem::{Problem, Record};
use super::search::{Basis, Found, Session, UNSEEN};
use super::{Fit, Fitted, LogFit, Verdict};
use crate::residual::{Autocorrelation, LAGS, aic_bic, samples_per_independent};
use nalgebra::DMatrix;
use plant_sim::chain::Chain;
use plant_sim::metrics::{Score, rms};
use plant_sim::model::Kind;
use plant_sim::param::{ASSUMED_MASS_SIGMA, Param};
use plant_sim::replay::play;
use std::sync::atomic::Ordering;

/// Puts into words and numbers what a search found.
pub(super) fn report(session: &Session<'_>, found: &Found<'_>) -> Fit {
    let Found { records, free, unseen, z, covariance, starts_rms_m } = found;
    let problem = &Problem::new(records, free, &session.base, session.simulations, z.clone());
    let fitted_chain = problem.chain(z);
    let logs: Vec<LogFit> = (0..records.len()).map(|index| log_fit(&records[index], problem, index)).collect();
    let reach_v = largest_hysteron_voltages(records, problem, &fitted_chain);
    let mut model = session.nominal.clone();
    let names: Vec<&str> = session.logs.iter().map(|l| l.name.as_str()).collect();
    let source = format!("identified from {}", names.join(", "));
    let mut parameters = Vec::new();
    if model.kind.has_structure() && model.kind != Kind::BoucWenOscillator {
        parameters.push(Fitted {
            name: "mass_kg".into(),
            words: ("mass".into(), "kg"),
            value: session.base.chain.plant.mass_kg,
            sigma: session.base.chain.plant.mass_kg * model.structure.mass_kg.relative_sigma_or(ASSUMED_MASS_SIGMA),
            prior: session.base.chain.plant.mass_kg,
            verdict: Verdict::Given,
            note: "given; displacement alone determines only ratios to the mass".into(),
        });
    }
    for (i, free) in free.iter().enumerate() {
        let coordinate_sigma = covariance.as_ref().map_or(f64::NAN, |c| c[(i, i)].sqrt());
        let (value, per_si) = (free.at(z[i]), free.quantity.per_si());
        let number_sigma = free.told_sigma(z[i], coordinate_sigma);
        *free.quantity.record(&mut model) = free.param(z[i], coordinate_sigma, &source);
        let sigma = match free.scale {
            Scale::Log { .. } => number_sigma * value * per_si,
            Scale::Shift { .. } | Scale::NotNegative { .. } => number_sigma * per_si,
        };
        let at_bound = free.at_bound(z[i]);
        let dim = coordinate_sigma > UNSEEN * free.prior_sigma;
        parameters.push(Fitted {
            name: free.quantity.name(),
            words: free.quantity.words(),
            value: value * per_si,
            sigma,
            prior: free.prior * per_si,
            verdict: if at_bound { Verdict::AtBound } else { Verdict::Fitted },
            note: match (at_bound, dim) {
                (true, _) => "at its bound: start nearer to it (--plant), or the model lacks an effect".into(),
                (false, true) => "fitted together with others; by itself these logs hardly see it".into(),
                (false, false) => "fitted".into(),
            },
        });
    }
    for free in unseen {
        let per_si = free.quantity.per_si();
        let record = free.quantity.record(&mut model);
        record.source = format!("not seen by {}; {}", names.join(", "), record.source);
        parameters.push(Fitted {
            name: free.quantity.name(),
            words: free.quantity.words(),
            value: free.prior * per_si,
            sigma: unseen_sigma(session.basis, free, record),
            prior: free.prior * per_si,
            verdict: Verdict::Unseen,
            note: why_unseen(free.quantity, &fitted_chain, &reach_v),
        });
    }
    let order: Vec<String> = std::iter::once("mass_kg".into())
        .chain(Quantity::of(&session.nominal).into_iter().map(Quantity::name))
        .collect();
    parameters.sort_by_key(|p| order.iter().position(|name| *name == p.name).unwrap_or(usize::MAX));

    let offset_m = logs.iter().map(|l| l.offset_m).sum::<f64>() / logs.len() as f64;
    let offset_sigma_m = zero_sigma_m(problem, covariance.as_ref(), &logs, offset_m);
    model.sensor.offset_um = Some(Param::absolute(offset_m * 1e6, offset_sigma_m * 1e6, &source));
    model.sensor.noise_um = Some(Param::new(logs[0].noise_m * 1e6, 0.1, &source));
    let residual_m: Vec<f64> = (0..records.len()).flat_map(|i| problem.residual_m(i)).collect();
    let rms_m = rms(residual_m);
    let rows_and_rms_m: Vec<[f64; 2]> =
        logs.iter().map(|log| [(log.predicted_m.len() - log.run_in_rows) as f64, log.rms_m]).collect();
    let [aic, bic] = aic_bic(&rows_and_rms_m, z.len());
    Fit {
        model,
        parameters,
        logs,
        starts_rms_m: starts_rms_m.clone(),
        aic,
        bic,
        coordinates: z.len(),
        rms_m,
        simulations: session.simulations.load(Ordering::Relaxed),
        seed: session.options.seed,
    }
}

fn log_fit(record: &Record<'_>, problem: &Problem<'_>, index: usize) -> LogFit {
    let predicted_m = problem.prediction_m(index, problem.coordinates_now());
    let mut score = Score::default();
    for (y, p) in record.log.displacement_m.iter().zip(&predicted_m).skip(record.run_in) {
        score.add(*y, *p);
    }
    let (offset_m, start) = problem.own_start(index);
    let residual_m = problem.residual_m(index);
    LogFit {
        name: record.log.name.clone(),
        predicted_m,
        run_in_rows: record.run_in,
        rms_m: score.rms_m(false),
        fit_percent: score.fit_percent(false),
        noise_m: record.noise_m,
        offset_m,
        start,
        autocorrelation: Autocorrelation::of(&residual_m, LAGS),
        independent_samples: residual_m.len() as f64 / samples_per_independent(&residual_m),
    }
}

/// Standard deviation of the sensor's mean zero `offset_m` as another log would have it: what the logs leave open of it, which may be all that a
/// hysteron holds, and how far they are apart. One log doesn't say how exactly a zero is set, so that it is told no finer than a reading.
fn zero_sigma_m(problem: &Problem<'_>, covariance: Option<&DMatrix<f64>>, logs: &[LogFit], offset_m: f64) -> f64 {
    let count = logs.len() as f64;
    let places: Vec<usize> = (0..logs.len()).map(|index| problem.offset_place(index)).collect();
    let unit_m = problem.offset_unit_m();
    let left_open = covariance.map_or(problem.prior_sigma()[places[0]].powi(2), |of| {
        places.iter().flat_map(|i| places.iter().map(|j| of[(*i, *j)])).sum::<f64>() / (count * count)
    });
    let apart_m2 = logs.iter().map(|log| (log.offset_m - offset_m).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let noise_m = logs.iter().map(|log| log.noise_m).fold(0.0, f64::max);
    (left_open.max(0.0) * unit_m * unit_m + apart_m2).sqrt().max(noise_m)
}

/// Standard deviation of a number that the logs can't see, in its record's unit: what a stated plant says of it stays, and what a guess may have assumed
/// becomes its prior's.
fn unseen_sigma(basis: Basis, free: &Free, record: &mut Param) -> f64 {
    let value = free.prior * free.quantity.per_si();
    let recorded = record.sigma.map(|sigma| sigma * value.abs()).or(record.sigma_abs);
    if let (Basis::Stated, Some(sigma)) = (basis, recorded) {
        return sigma;
    }
    record.sigma = record.sigma.map(|sigma| sigma.max(free.prior_sigma));
    free.prior_sigma_si() * free.quantity.per_si()
}

/// Largest voltage that each hysteron reaches in any log: whether its dead zone ever opens.
fn largest_hysteron_voltages(records: &[Record<'_>], problem: &Problem<'_>, chain: &Chain) -> Vec<f64> {
    let mut largest = vec![0.0f64; chain.plant.hysterons.len()];
    for (index, record) in records.iter().enumerate() {
        let (_, start) = problem.own_start(index);
        play(chain, record.log, &start, record.rows, |_, player| {
            for (largest, v) in largest.iter_mut().zip(player.hysteron_v()) {
                *largest = largest.max(v.abs());
            }
        });
    }
    largest
}

fn why_unseen(quantity: Quantity, chain: &Chain, reach_v: &[f64]) -> String {
    let kept = "these logs can't see it; kept at its prior";
    if matches!(quantity, Quantity::Stiffness | Quantity::Damping) {
        return format!("{kept}: they show no resonance, so only alpha/k is theirs to say");
    }
    let (Quantity::DeadZone(i) | Quantity::Slope(i)) = quantity else { return kept.into() };
    let (hysteron, reach_v) = (&chain.plant.hysterons[i], reach_v[i]);
    if reach_v < hysteron.edge_v() {
        return format!(
            "{kept}: hysteron {} reaches {reach_v:.2} V and never opens at {:.2} V; drive it further",
            i + 1,
            hysteron.edge_v()
        );
    }
    match quantity {
        Quantity::Slope(_) => format!(
            "{kept}: once open, hysteron {} follows within {:.1e} s, faster than the logs resolve",
            i + 1,
            hysteron.capacitance_f / hysteron.slope_s
        ),
        _ => kept.into(),
    }
}
