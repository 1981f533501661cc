//! `hysteron identify`: fits a plant to logs.

use crate::arguments::IdentifyCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::identify::{self, Fit, From, Options, Verdict};
use gap_diagnosis::page::{FittedLog, FittedParameter, IdentifyView, StartView, four_digits, identify_page};
use plant_sim::log::{self, Log};
use plant_sim::model::Model;

pub fn identify(call: &IdentifyCall) -> Result<(), Failure> {
    let from = match &call.plant {
        Some(path) => From::Plant(Box::new(Model::read(path)?)),
        None => From::Logs { hysterons: call.hysterons, mass_kg: call.mass_kg },
    };
    let mut warnings = Vec::new();
    if let From::Plant(model) = &from {
        warnings.extend(model.warnings());
    }
    let mut logs = Vec::new();
    for path in &call.logs {
        let mut log = log::read(path, &call.read.options())?;
        log.name = output::file_name(path);
        warnings.extend(log::warnings(&log));
        logs.push(log);
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

/// What the fit is judged by.
fn facts(fit: &Fit) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    for log in &fit.logs {
        let outside = log.autocorrelation.outside();
        facts.push((
            log.name.clone(),
            format!(
                "fit {}, rms {}, noise {}; residual correlated at {outside} of {} lags (99 % region)",
                four_digits(log.fit_percent, "%"),
                four_digits(log.rms_m * 1e6, "um"),
                four_digits(log.noise_m * 1e6, "um"),
                log.autocorrelation.correlation.len() - 1,
            ),
        ));
    }
    let ends: Vec<String> = fit.starts_rms_m.iter().map(|r| four_digits(r * 1e6, "um")).collect();
    facts.extend([
        ("AIC, BIC".to_owned(), format!("{:.1}, {:.1}", fit.aic, fit.bic)),
        ("starts ended at".to_owned(), ends.join(", ")),
        ("simulations, seed".to_owned(), format!("{}, {}", fit.simulations, fit.seed)),
    ]);
    facts
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
    let logs: Vec<_> = fit
        .logs
        .iter()
        .map(|l| {
            serde_json::json!({
                "log": l.name,
                "fit_percent": l.fit_percent,
                "rms_um": l.rms_m * 1e6,
                "noise_um": l.noise_m * 1e6,
                "offset_um": l.offset_m * 1e6,
            })
        })
        .collect();
    serde_json::json!({
        "parameters": parameters,
        "logs": logs,
        "fit_percent": fit.logs.iter().map(|l| l.fit_percent).fold(f64::INFINITY, f64::min),
        "aic": fit.aic,
        "bic": fit.bic,
        "hysterons": fit.model.actuator.hysterons.len(),
        "simulations": fit.simulations,
        "seed": fit.seed,
    })
}

/// A log's columns as the page wants them.
struct Columns {
    time_s: Vec<f64>,
    measured_um: Vec<f64>,
    predicted_um: Vec<f64>,
}

fn page(
    call: &IdentifyCall,
    logs: &[Log],
    fit: &Fit,
    facts: &[(String, String)],
    warnings: &[String],
) -> gap_diagnosis::page::Page {
    let columns: Vec<Columns> = logs
        .iter()
        .zip(&fit.logs)
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
        .zip(&fit.logs)
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
            fit_percent: fitted.fit_percent,
        })
        .collect();
    let parameters: Vec<FittedParameter<'_>> = fit
        .parameters
        .iter()
        .map(|p| {
            // The unit is the last word of the name.
            let (name, unit) = p.name.split_once('_').unwrap_or((&p.name, ""));
            FittedParameter {
                name,
                unit,
                value: p.value,
                sigma: (p.verdict != Verdict::Unseen).then(|| p.sigma / p.value.abs()),
                prior: (p.verdict != Verdict::Given).then_some((p.prior, f64::NAN)),
                unseen: (p.verdict == Verdict::Unseen).then_some(p.note.as_str()),
            }
        })
        .collect();
    let starts: Vec<StartView> = fit
        .starts_rms_m
        .iter()
        .map(|rms_m| StartView { initial_rms_um: f64::NAN, final_rms_um: rms_m * 1e6 })
        .collect();
    let worst = fit.logs.iter().map(|l| l.fit_percent).fold(f64::INFINITY, f64::min);
    identify_page(&IdentifyView {
        title: "Identification",
        subtitle: &fit.model.name,
        headline: &format!(
            "{} hysterons explain {worst:.2} % of {}.",
            fit.model.actuator.hysterons.len(),
            if logs.len() == 1 { "the log".to_owned() } else { format!("the worst of {} logs", logs.len()) }
        ),
        logs: &shown,
        parameters: &parameters,
        starts: &starts,
        metrics: facts,
        warnings,
        provenance: &output::provenance(Some(call.seed)),
    })
}
