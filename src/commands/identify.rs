//! `hysteron identify`: fits a plant to logs.

use crate::arguments::IdentifyCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::identify::{self, Fit, From, Hysterons, LogFit, Options, Verdict};
use gap_diagnosis::page::{FittedLog, FittedParameter, IdentifyView, Ink, Page, StartView, four_digits, identify_page};
use gap_diagnosis::responses::{Played, responses};
use plant_sim::log::{self, Log};
use plant_sim::model::{Kind, Model};

/// Rows of a log that are read into memory: 10 million are about 1 GB with what a fit makes of them.
pub const MOST_ROWS: usize = 10_000_000;

/// Moving mass of the thesis' bender.
const BENDER_KG: f64 = 1.0148e-3;

/// The mass that a fit without `--plant` starts from and keeps.
pub fn mass_kg(call: &IdentifyCall) -> f64 {
    call.mass_kg.unwrap_or(BENDER_KG)
}

/// A warning where neither a plant nor `--mass-kg` states the mass: no fit can tell that it is wrong.
pub fn assumed_mass(call: &IdentifyCall) -> Option<String> {
    let is_stated = call.plant.is_some() || call.mass_kg.is_some();
    (!is_stated).then(|| {
        format!(
            "the mass is assumed to be {} g: with another one displacements stay right, and N, N/m, C/m and F are all off by one factor (--mass-kg)",
            BENDER_KG * 1e3
        )
    })
}

pub fn identify(call: &IdentifyCall) -> Result<(), Failure> {
    if call.compare {
        return super::compare::compare(call);
    }
    let kind = call.model.as_deref().unwrap_or_default();
    refuse_unused(call, kind)?;
    if kind == "transfer-function" {
        return super::compare::transfer_function(call);
    }
    let mass_kg = mass_kg(call);
    let from = match (&call.plant, kind) {
        (Some(path), _) => {
            let model = Model::read(path)?;
            if model.kind.name() != kind {
                return Err(Failure::call(format!(
                    "{}: is a plant of kind {} and --model asks for {kind}: name the plant's kind, or another plant",
                    path.display(),
                    model.kind.name()
                )));
            }
            From::Plant(Box::new(model))
        }
        (None, "bouc-wen") => From::BoucWen { mass_kg: Some(mass_kg) },
        (None, "bouc-wen-static") => From::BoucWen { mass_kg: None },
        (None, "linear") => From::Linear { hysterons: call.hysterons, mass_kg },
        (None, "phs") => From::Logs { hysterons: call.hysterons, mass_kg },
        (None, name) => match Kind::ALL.into_iter().find(|(of, _)| *of == name) {
            Some((_, kind)) if kind.is_actuator_with_operator() => From::Operator { kind, mass_kg },
            _ => {
                return Err(Failure::call(format!(
                    "--model {name} can't be guessed from logs alone: state a plant of that kind with --plant"
                )));
            }
        },
    };
    let mut warnings = Vec::new();
    if let (From::Plant(model), Some(path)) = (&from, &call.plant) {
        warnings.extend(output::about(path, model.warnings()));
    }
    let mut logs = super::logs::read(&call.logs, &[], &call.read, MOST_ROWS)?;
    warnings.extend(logs.iter().flat_map(log::warnings));
    if kind == "bouc-wen-static" {
        warnings.extend(super::logs::leave_out_forces(&mut logs, kind));
    } else {
        warnings.extend(assumed_mass(call));
    }
    let options = Options {
        from,
        initial: call.start.initial,
        run_in_s: call.start.run_in,
        starts: call.starts as usize,
        seed: call.seed,
    };
    let spinner = output::spinner();
    let fit = identify::identify(&logs, &options, &|phase, simulations| {
        spinner.set_message(format!("{phase} ({simulations} simulations)"));
    })?;
    spinner.finish_and_clear();
    fit.model.write(&call.out)?;
    output::warn(&warnings);
    let facts = facts(&fit);
    if call.show.json {
        output::line(&json(&fit).to_string());
    } else {
        print(&fit, &facts);
        output::line(&format!("model: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        output::save_page(&page(call, &logs, &fit, &facts, &warnings), &path, call.show.json)?;
    }
    Ok(())
}

/// Refuses what would be given in vain: the kind of model has no use for it.
fn refuse_unused(call: &IdentifyCall, kind: &str) -> Result<(), Failure> {
    let unused = [
        ("--order", call.order.is_some() && kind != "transfer-function"),
        ("--hysterons", matches!(call.hysterons, Hysterons::Fixed(_)) && !matches!(kind, "phs" | "linear")),
        ("--mass-kg", call.mass_kg.is_some() && matches!(kind, "transfer-function" | "bouc-wen-static")),
    ];
    match unused.into_iter().find(|(_, is_unused)| *is_unused) {
        Some((option, _)) => Err(Failure::call(format!("{option} means nothing to --model {kind}: leave it out"))),
        None => Ok(()),
    }
}

/// What the fit is judged by.
fn facts(fit: &Fit) -> Vec<(String, String)> {
    let largest = |value: fn(&LogFit) -> f64| fit.logs.iter().map(value).fold(0.0, f64::max);
    let lags: usize = fit.logs.iter().map(|l| l.autocorrelation.correlation.len() - 1).sum();
    let outside: usize = fit.logs.iter().map(|l| l.autocorrelation.outside()).sum();
    let reached = fit.starts_rms_m.iter().filter(|rms| **rms < 1.01 * fit.starts_rms_m[0]).count();
    vec![
        ("fit".to_owned(), four_digits(worst_percent(&fit.logs), "%")),
        ("rms residual".to_owned(), four_digits(largest(|l| l.rms_m) * 1e6, "um")),
        ("noise".to_owned(), four_digits(largest(|l| l.noise_m) * 1e6, "um")),
        ("correlated lags".to_owned(), format!("{outside} of {lags}")),
        ("AIC".to_owned(), format!("{:.0}", fit.aic)),
        ("BIC".to_owned(), format!("{:.0}", fit.bic)),
        ("searches that ended there".to_owned(), format!("{reached} of {}", fit.starts_rms_m.len())),
        ("simulations".to_owned(), fit.simulations.to_string()),
        ("seed".to_owned(), fit.seed.to_string()),
    ]
}

fn print(fit: &Fit, facts: &[(String, String)]) {
    for parameter in &fit.parameters {
        let sigma = match parameter.verdict {
            Verdict::Unseen => "      -".to_owned(),
            _ => format!("{:7.2} %", 100.0 * parameter.sigma / parameter.value.abs()),
        };
        output::line(&format!("  {:22} {:>12.5e}  +- {sigma:>9}  {}", parameter.name, parameter.value, parameter.note));
    }
    output::facts(facts);
}

fn json(fit: &Fit) -> serde_json::Value {
    let parameters: Vec<_> = fit
        .parameters
        .iter()
        .map(|p| {
            serde_json::json!({
                "name": p.name,
                "value": p.value,
                "sigma": p.sigma,
                "prior": p.prior,
                "seen": p.verdict != Verdict::Unseen,
                "note": p.note,
            })
        })
        .collect();
    serde_json::json!({
        "parameters": parameters,
        "logs": fit.logs.iter().map(log_json).collect::<Vec<_>>(),
        "fit_percent": worst_percent(&fit.logs),
        "aic": fit.aic,
        "bic": fit.bic,
        "hysterons": fit.model.actuator.hysterons.len(),
        "simulations": fit.simulations,
        "seed": fit.seed,
    })
}

/// How well a log is fitted, in `--json` of every kind of model.
pub(super) fn log_json(log: &LogFit) -> serde_json::Value {
    serde_json::json!({
        "log": log.name,
        "fit_percent": log.fit_percent,
        "rms_um": log.rms_m * 1e6,
        "noise_um": log.noise_m * 1e6,
        "offset_um": log.offset_m * 1e6,
    })
}

/// A log's columns as the page wants them.
struct Columns {
    time_s: Vec<f64>,
    measured_um: Vec<f64>,
    predicted_um: Vec<f64>,
}

fn page(call: &IdentifyCall, logs: &[Log], fit: &Fit, facts: &[(String, String)], warnings: &[String]) -> Page {
    let parameters: Vec<FittedParameter<'_>> = fit
        .parameters
        .iter()
        .map(|p| FittedParameter {
            name: &p.words.0,
            unit: p.words.1,
            value: p.value,
            sigma: (p.verdict != Verdict::Unseen).then(|| p.sigma / p.value.abs()),
            prior: p.prior,
            note: &p.note,
        })
        .collect();
    let starts: Vec<StartView> = fit
        .starts_rms_m
        .iter()
        .map(|rms_m| StartView { initial_rms_um: f64::NAN, final_rms_um: rms_m * 1e6 })
        .collect();
    let explains = match fit.model.kind {
        Kind::Phs => format!("{} hysterons explain", fit.model.actuator.hysterons.len()),
        kind => format!("A plant of kind {} explains", kind.name()),
    };
    let fitted = Fitted { model: &fit.model, explains: &explains, logs: &fit.logs, facts, warnings };
    let view = IdentifyView { parameters: &parameters, starts: &starts, ..IdentifyView::default() };
    fitted.page(call, logs, view)
}

/// What the page of any kind of model shows.
pub(super) struct Fitted<'a> {
    pub model: &'a Model,
    /// Subject and verb of the headline.
    pub explains: &'a str,
    pub logs: &'a [LogFit],
    pub facts: &'a [(String, String)],
    pub warnings: &'a [String],
}

impl Fitted<'_> {
    /// The page, where `view` has what is this kind's own.
    pub fn page(&self, call: &IdentifyCall, logs: &[Log], view: IdentifyView<'_>) -> Page {
        let columns: Vec<Columns> = logs
            .iter()
            .zip(self.logs)
            .map(|(log, fitted)| Columns {
                time_s: (0..log.len()).map(|k| log.time_s(k)).collect(),
                measured_um: log
                    .displacement_m
                    .iter()
                    .enumerate()
                    .map(|(k, y)| if k < fitted.run_in_rows { f64::NAN } else { y * 1e6 })
                    .collect(),
                predicted_um: fitted.predicted_m.iter().map(|y| y * 1e6).collect(),
            })
            .collect();
        let shown: Vec<FittedLog<'_>> = logs
            .iter()
            .zip(self.logs)
            .zip(&columns)
            .map(|((log, fitted), columns)| FittedLog {
                name: &fitted.name,
                time_s: &columns.time_s,
                command_v: &log.command_v,
                measured_um: &columns.measured_um,
                predicted_um: &columns.predicted_um,
                autocorrelation: &fitted.autocorrelation.correlation,
                n_residuals: log.len() - fitted.run_in_rows,
                rms_um: fitted.rms_m * 1e6,
                noise_um: fitted.noise_m * 1e6,
                fit_percent: fitted.fit_percent,
            })
            .collect();
        let played: Vec<Played<'_>> = logs
            .iter()
            .zip(self.logs)
            .map(|(log, fitted)| Played {
                name: &fitted.name,
                dt_s: log.dt_s,
                period_samples: log.meta.period_samples,
                reference_m: log.reference_m.as_deref(),
                drive_v: &log.command_v,
                measured_m: &log.displacement_m,
                models: vec![("fitted", Ink::Model, &fitted.predicted_m)],
            })
            .collect();
        let headline = format!(
            "{} {:.2} % of {}.",
            self.explains,
            worst_percent(self.logs),
            if logs.len() == 1 { "the log".to_owned() } else { format!("the worst of {} logs", logs.len()) }
        );
        identify_page(&IdentifyView {
            title: "Identification",
            subtitle: &self.model.name,
            headline: &headline,
            logs: &shown,
            responses: &responses(&played),
            metrics: self.facts,
            warnings: self.warnings,
            provenance: &output::provenance(Some(call.seed)),
            ..view
        })
    }
}

/// Fit percent of the log that is fitted worst.
pub(super) fn worst_percent(logs: &[LogFit]) -> f64 {
    logs.iter().map(|log| log.fit_percent).fold(f64::INFINITY, f64::min)
}
