//! All kinds of models on the same logs, ranked by what was never fitted.
//!
//! Held out are whole logs where the caller names some, of which the first part tells the start and the zero and the rest is scored; and otherwise the
//! last part of each log, which is simulated through from the fitted start, since hysteresis remembers. The ranking is by the rms on what is held
//! out; beside it stands the evidence of what was fitted: the Bayesian criterion, each log counted alike for all in the independent samples of its
//! least correlated residual.

use super::tfest::tfest;
use super::{From, Hysterons, IdentifyError, LEAST_ROWS, LogFit, Options, Progress, fit_start, identify, run_in_rows};
use crate::residual::aic_bic;
use plant_sim::log::Log;
use plant_sim::metrics::Score;
use plant_sim::model::{Kind, Model};
use plant_sim::replay::{Initial, Start, predict};

/// Share of each log that is held out where no whole logs are.
const HELD_OUT: f64 = 0.3;

/// Actuators with other operators than Bouc-Wen's.
const OPERATORS: [(Kind, &str); 6] = [
    (Kind::Dahl, "Dahl"),
    (Kind::Duhem, "Duhem"),
    (Kind::MaxwellSlip, "Maxwell slip, 8 springs"),
    (Kind::PrandtlIshlinskii, "Prandtl-Ishlinskii, 8 plays"),
    (Kind::Preisach, "Preisach, 21 cells"),
    (Kind::KrasnoselskiiPokrovskii, "Krasnosel'skii-Pokrovskii, 21 kernels"),
];

/// One log or stretch that was never fitted.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// The log, and which part of it.
    pub name: String,
    /// Rms of measured minus predicted, metres.
    pub rms_m: f64,
    /// Fit percent.
    pub fit_percent: f64,
}

/// One kind of model.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// What it is, in words.
    pub kind: String,
    /// The fitted model, ready to be written.
    pub model: Model,
    /// Coordinates fitted, offsets and starts included.
    pub coordinates: usize,
    /// Rms over what was fitted, metres.
    pub fitted_rms_m: f64,
    /// Worst fit percent of what was fitted.
    pub fitted_percent: f64,
    /// What was never fitted.
    pub held_out: Vec<HeldOut>,
    /// Rms over all that was never fitted, metres.
    pub held_out_rms_m: f64,
    /// Mean fit percent of what was never fitted.
    pub held_out_percent: f64,
    /// Bayesian criterion less that of the best; zero is best.
    pub evidence: f64,
    /// Independent samples of each fitted log, and its rms.
    counted: Vec<[f64; 2]>,
}

/// A ranking, the best first.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The models.
    pub candidates: Vec<Candidate>,
    /// Kinds that led to no fit, and why.
    pub failed: Vec<(String, IdentifyError)>,
    /// Whether whole logs were held out.
    pub whole_logs: bool,
    /// Rms of the logs' noise, metres: no model can do better.
    pub noise_m: f64,
}

/// Fits every kind to `logs` and ranks them on `held_out`; `stated` is a plant with hysterons to start from, if there is one.
///
/// # Errors
/// Logs that no model can be fitted to.
pub fn compare(
    logs: &[Log],
    held_out: &[Log],
    stated: Option<&Model>,
    mass_kg: f64,
    options: &Options,
    progress: Progress<'_>,
) -> Result<Comparison, IdentifyError> {
    super::check(logs, options)?;
    for log in held_out {
        let rows = log.len().saturating_sub(run_in_rows(log, options));
        if rows < 2 * LEAST_ROWS {
            return Err(IdentifyError::HeldOutTooShort { log: log.name.clone(), rows });
        }
    }
    let whole_logs = !held_out.is_empty();
    let fitted: Vec<Log> =
        if whole_logs { logs.to_vec() } else { logs.iter().map(|log| log.first(rows_fitted(log))).collect() };
    let arena = Arena { logs, held_out, options };
    let mut candidates = Vec::new();
    let mut failed = Vec::new();
    let mut noise_m = f64::INFINITY;
    let mass_kg = stated.map_or(mass_kg, |model| model.structure.mass_kg.value);
    let phs = |n: usize| From::Logs { hysterons: Hysterons::Fixed(n), mass_kg };
    let mut kinds: Vec<(String, From)> = vec![
        ("Bouc-Wen, static mechanics".into(), From::BoucWen { mass_kg: None }),
        ("Bouc-Wen actuator".into(), From::BoucWen { mass_kg: Some(mass_kg) }),
        ("second order, linear".into(), phs(0)),
    ];
    for n in 1..=3 {
        kinds.push((
            format!("linear grey box, {}", hysterons(n)),
            From::Linear { hysterons: Hysterons::Fixed(n), mass_kg },
        ));
        kinds.push((format!("port-Hamiltonian, {}", hysterons(n)), phs(n)));
    }
    if let Some(model) = stated {
        let n = model.actuator.hysterons.len();
        kinds.push((
            format!("port-Hamiltonian, {}, from the stated plant", hysterons(n)),
            From::Plant(Box::new(model.clone())),
        ));
    }
    for (kind, words) in OPERATORS {
        kinds.push((words.into(), From::Operator { kind, mass_kg }));
    }
    progress("transfer functions", 0);
    match tfest(&fitted, options, None) {
        Ok(found) => {
            // The best is of whatever order the logs call for.
            if let Some(best) = found.into_iter().next() {
                let kind = format!("transfer function, {} poles, {} zeros", best.order, best.zeros);
                let model = best.model();
                candidates.push(arena.judge(kind, model, &best.logs, best.coordinates, best.rms_m)?);
            }
        }
        Err(error) => failed.push(("transfer function".to_owned(), error)),
    }
    for (kind, from) in kinds {
        let own = Options { from, ..options.clone() };
        let say = |phase: &str, simulations: usize| progress(&format!("{kind}: {phase}"), simulations);
        match identify(&fitted, &own, &say) {
            Ok(fit) => {
                noise_m = fit.logs.iter().map(|log| log.noise_m).fold(noise_m, f64::min);
                candidates.push(arena.judge(kind, fit.model, &fit.logs, fit.coordinates, fit.rms_m)?);
            }
            Err(error) => failed.push((kind, error)),
        }
    }
    let most = |index: usize| candidates.iter().map(|c| c.counted[index][0]).fold(0.0, f64::max);
    let samples: Vec<f64> = (0..fitted.len()).map(most).collect();
    for candidate in &mut candidates {
        candidate.counted.iter_mut().zip(&samples).for_each(|([counted, _], samples)| *counted = *samples);
        candidate.evidence = aic_bic(&candidate.counted, candidate.coordinates)[1];
    }
    let best = candidates.iter().map(|c| c.evidence).fold(f64::INFINITY, f64::min);
    candidates.iter_mut().for_each(|c| c.evidence -= best);
    candidates.sort_by(|a, b| a.held_out_rms_m.total_cmp(&b.held_out_rms_m));
    if candidates.is_empty() {
        return Err(IdentifyError::NoFit { starts: options.starts });
    }
    Ok(Comparison { candidates, failed, whole_logs, noise_m })
}

fn hysterons(n: usize) -> String {
    if n == 1 { "1 hysteron".to_owned() } else { format!("{n} hysterons") }
}

fn rows_fitted(log: &Log) -> usize {
    ((1.0 - HELD_OUT) * log.len() as f64) as usize
}

/// First row of a held-out log that is scored, short ones with enough before it to fit a start to.
fn scored_from(log: &Log, run_in: usize) -> usize {
    super::scored_from(log.len(), run_in).max(run_in + LEAST_ROWS)
}

/// What candidates are judged on.
struct Arena<'a> {
    logs: &'a [Log],
    held_out: &'a [Log],
    options: &'a Options,
}

impl Arena<'_> {
    fn judge(
        &self,
        kind: String,
        model: Model,
        fits: &[LogFit],
        coordinates: usize,
        fitted_rms_m: f64,
    ) -> Result<Candidate, IdentifyError> {
        // Offsets are each log's own, and what is random or rounded is what the residual is made of.
        let mut chain = model.chain();
        (chain.sensor.offset_m, chain.sensor.noise_m, chain.sensor.quantum_m) = (0.0, 0.0, 0.0);
        let mut held_out = Vec::new();
        let mut all = (0.0, 0.0);
        let mut score = |name: String, log: &Log, start: &Start, offset_m: f64, from: usize| {
            let mut own = Score::default();
            let predicted = predict(&chain, log, start, log.len());
            log.displacement_m.iter().zip(&predicted).skip(from).for_each(|(y, p)| own.add(*y, *p + offset_m));
            all.0 += own.rms_m(false).powi(2) * own.rows() as f64;
            all.1 += own.rows() as f64;
            held_out.push(HeldOut { name, rms_m: own.rms_m(false), fit_percent: own.fit_percent(false) });
        };
        if self.held_out.is_empty() {
            for (log, fit) in self.logs.iter().zip(fits) {
                let name = format!("{}, last {:.0} %", log.name, 100.0 * HELD_OUT);
                score(name, log, &fit.start, fit.offset_m, rows_fitted(log));
            }
        } else {
            for log in self.held_out {
                let run_in = run_in_rows(log, self.options);
                let initial = if model.kind.has_structure() || self.options.initial == Initial::Relaxed {
                    self.options.initial
                } else {
                    Initial::Rest
                };
                let from = scored_from(log, run_in);
                let (start, offset_m) = fit_start(&chain, &log.first(from), initial, run_in, true)?;
                score(log.name.clone(), log, &start, offset_m, from);
            }
        }
        let fits_of = held_out.iter().map(|h| h.fit_percent).filter(|f| f.is_finite());
        let (sum, count) = fits_of.fold((0.0, 0.0), |(sum, count), fit| (sum + fit, count + 1.0));
        Ok(Candidate {
            kind,
            model,
            coordinates,
            fitted_rms_m,
            fitted_percent: fits.iter().map(|f| f.fit_percent).fold(f64::INFINITY, f64::min),
            held_out_rms_m: (all.0 / all.1).sqrt(),
            held_out_percent: if count > 0.0 { sum / count } else { f64::NAN },
            held_out,
            evidence: 0.0,
            counted: fits.iter().map(|log| [log.independent_samples, log.rms_m]).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor that moves by 1 um once the start is told: the rest is missed by that, and a zero fitted to all of it would hide a half.
    #[test]
    fn the_zero_of_a_held_out_log_is_not_fitted_to_what_is_scored() {
        let model = crate::reproduce::Thesis::default().phs;
        let chain = model.chain();
        let command_v: Vec<f64> = (0..1000).map(|k| 10.0 * (f64::from(k) * 0.05).sin()).collect();
        let zeros = vec![0.0; command_v.len()];
        let mut log = Log { dt_s: 1e-4, displacement_m: zeros, command_v, ..Log::default() };
        log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
        log.displacement_m[300..].iter_mut().for_each(|y| *y += 1e-6);
        let options = Options {
            from: From::Plant(Box::new(model.clone())),
            initial: Initial::Relaxed,
            run_in_s: None,
            starts: 1,
            seed: 1,
        };
        let judged = |log: Log| {
            Arena { logs: &[], held_out: &[log], options: &options }.judge(String::new(), model.clone(), &[], 0, 0.0)
        };
        let left_m = judged(log.clone()).expect("judged").held_out_rms_m;
        assert!((left_m - 1e-6).abs() < 1e-10, "{left_m:e}");
        // The run-in is neither: 30 % of the 500 rows after it are.
        let options = Options { run_in_s: Some(0.05), ..options.clone() };
        assert_eq!(scored_from(&log, run_in_rows(&log, &options)), 650);
        let short = compare(
            &[log.clone()],
            &[log.first(30)],
            Some(&model),
            1e-3,
            &Options { run_in_s: None, ..options },
            &|_, _| (),
        );
        assert!(matches!(short, Err(IdentifyError::HeldOutTooShort { rows: 30, .. })), "{short:?}");
    }
}
