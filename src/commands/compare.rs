//! `hysteron identify --compare`: every kind of model on the same logs; and transfer functions alone.

use super::identify::{Fitted, MOST_ROWS, assumed_mass, log_json, mass_kg, worst_percent};
use crate::arguments::IdentifyCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::identify::compare::{Candidate, compare as rank};
use gap_diagnosis::identify::tfest::{Estimate, tfest};
use gap_diagnosis::identify::{From, Options};
use gap_diagnosis::page::{
    CompareView, ComparedModel, FittedParameter, IdentifyView, OrderView, compare_page, four_digits,
};
use plant_sim::log;
use plant_sim::model::{Kind, Model};

fn options(call: &IdentifyCall) -> Options {
    Options {
        from: From::Logs { hysterons: call.hysterons, mass_kg: mass_kg(call) },
        initial: call.start.initial,
        run_in_s: call.start.run_in,
        starts: call.starts as usize,
        seed: call.seed,
    }
}

pub fn compare(call: &IdentifyCall) -> Result<(), Failure> {
    let stated = call.plant.as_ref().map(|path| Model::read(path)).transpose()?;
    if let Some(model) = stated.as_ref().filter(|model| model.kind != Kind::Phs) {
        let kind = model.kind.name();
        return Err(Failure::call(format!(
            "--plant is of kind {kind}: --compare starts from a plant of kind phs or from none"
        )));
    }
    let logs = super::logs::read(&call.logs, &call.held_out, &call.read, MOST_ROWS)?;
    let held_out = super::logs::read(&call.held_out, &call.logs, &call.read, MOST_ROWS)?;
    let mut warnings: Vec<String> = logs.iter().chain(&held_out).flat_map(log::warnings).collect();
    warnings.extend(assumed_mass(call));
    let spinner = output::spinner();
    let found = rank(&logs, &held_out, stated.as_ref(), mass_kg(call), &options(call), &|phase, simulations| {
        spinner.set_message(format!("{phase} ({simulations} simulations)"));
    })?;
    spinner.finish_and_clear();
    warnings.extend(found.failed.iter().map(|(kind, error)| format!("{kind}: {error}")));
    let Some(best) = found.candidates.first() else {
        return Err(Failure::interrupted("no kind of model could be fitted"));
    };
    best.model.write(&call.out)?;
    output::warn(&warnings);
    if call.show.json {
        let json = serde_json::json!({
            "schema": "hysteron-comparison-1",
            "held_out": if found.whole_logs { "whole logs" } else { "last part of each log" },
            "noise_um": found.noise_m * 1e6,
            "ranking": found.candidates.iter().map(candidate_json).collect::<Vec<_>>(),
        });
        output::line(&json.to_string());
    } else {
        output::line("  held out rms   fit        fitted     coordinates  evidence against  model");
        for c in &found.candidates {
            output::line(&format!(
                "  {:>9.4} um {:>8.3} % {:>8.3} % {:>11} {:>14.0}    {}",
                c.held_out_rms_m * 1e6,
                c.held_out_percent,
                c.fitted_percent,
                c.coordinates,
                c.evidence,
                c.kind
            ));
        }
        output::line(&format!("model: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let models: Vec<ComparedModel> = found.candidates.iter().map(compared).collect();
        let names: Vec<&str> = logs.iter().map(|log| log.name.as_str()).collect();
        let page = compare_page(&CompareView {
            subtitle: &format!("fitted to {}", names.join(", ")),
            held_out: if found.whole_logs {
                "held-out logs after their first 30 %"
            } else {
                "the last 30 % of each log"
            },
            models: &models,
            noise_um: found.noise_m * 1e6,
            warnings: &warnings,
            provenance: &output::provenance(Some(call.seed)),
        });
        output::save_page(&page, &path, call.show.json)?;
    }
    Ok(())
}

fn compared(candidate: &Candidate) -> ComparedModel {
    ComparedModel {
        kind: candidate.kind.clone(),
        held_out_rms_um: candidate.held_out_rms_m * 1e6,
        held_out_percent: candidate.held_out_percent,
        fitted_percent: candidate.fitted_percent,
        coordinates: candidate.coordinates,
        evidence: candidate.evidence,
    }
}

fn candidate_json(candidate: &Candidate) -> serde_json::Value {
    let held_out = candidate
        .held_out
        .iter()
        .map(|h| serde_json::json!({ "log": h.name, "rms_um": h.rms_m * 1e6, "fit_percent": h.fit_percent }));
    serde_json::json!({
        "model": candidate.kind,
        "kind": candidate.model.kind.name(),
        "held_out_rms_um": candidate.held_out_rms_m * 1e6,
        "held_out_fit_percent": candidate.held_out_percent,
        "fitted_percent": candidate.fitted_percent,
        "coordinates": candidate.coordinates,
        "evidence_against": candidate.evidence,
        "held_out": held_out.collect::<Vec<_>>(),
    })
}

/// `identify --model transfer-function`.
pub fn transfer_function(call: &IdentifyCall) -> Result<(), Failure> {
    if call.plant.is_some() {
        return Err(Failure::call(
            "--plant has no meaning for a transfer function, which is estimated from the logs alone: drop it",
        ));
    }
    let mut logs = super::logs::read(&call.logs, &[], &call.read, MOST_ROWS)?;
    let mut warnings: Vec<String> = logs.iter().flat_map(log::warnings).collect();
    warnings.extend(super::logs::leave_out_forces(&mut logs, Kind::TransferFunction.name()));
    let found = tfest(&logs, &options(call), call.order)?;
    let Some(best) = found.first() else {
        return Err(Failure::interrupted("no transfer function could be estimated"));
    };
    let model = best.model();
    model.write(&call.out)?;
    output::warn(&warnings);
    let percent = |e: &Estimate| worst_percent(&e.logs);
    let [aic, bic] = best.aic_bic();
    let coefficients = best.coefficients();
    if call.show.json {
        let json = serde_json::json!({
            "parameters": coefficients.iter().map(|c| serde_json::json!({
                "name": c.name, "value": c.value, "sigma": c.sigma,
            })).collect::<Vec<_>>(),
            "logs": best.logs.iter().map(log_json).collect::<Vec<_>>(),
            "aic": aic,
            "bic": bic,
            "numerator_m_per_V": best.tf.numerator,
            "denominator": best.tf.denominator,
            "fit_percent": percent(best),
            "orders": found.iter().map(|e| serde_json::json!({
                "poles": e.order, "zeros": e.zeros, "rms_um": e.rms_m * 1e6, "fit_percent": percent(e),
            })).collect::<Vec<_>>(),
        });
        output::line(&json.to_string());
    } else {
        for e in &found {
            let rms = four_digits(e.rms_m * 1e6, "um");
            let told = format!("  {} poles, {} zeros: rms {rms}, fit {:.3} %", e.order, e.zeros, percent(e));
            output::line(&output::ascii(&told));
        }
        output::line(&format!("model: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let facts = [
            ("fit".to_owned(), four_digits(percent(best), "%")),
            ("rms residual".to_owned(), four_digits(best.rms_m * 1e6, "µm")),
            ("AIC".to_owned(), format!("{aic:.0}")),
            ("BIC".to_owned(), format!("{bic:.0}")),
        ];
        let parameters: Vec<FittedParameter<'_>> = coefficients
            .iter()
            .map(|c| FittedParameter {
                name: &c.name,
                unit: "",
                value: c.value,
                sigma: Some(c.sigma / c.value.abs()).filter(|sigma| sigma.is_finite()),
                prior: f64::NAN,
                note: "",
            })
            .collect();
        let orders: Vec<OrderView> = found
            .iter()
            .map(|e| OrderView { poles: e.order, zeros: e.zeros, rms_um: e.rms_m * 1e6, fit_percent: percent(e) })
            .collect();
        let explains = format!("{} poles and {} zeros explain", best.order, best.zeros);
        let fitted =
            Fitted { model: &model, explains: &explains, logs: &best.logs, facts: &facts, warnings: &warnings };
        let view = IdentifyView { parameters: &parameters, orders: &orders, ..IdentifyView::default() };
        output::save_page(&fitted.page(call, &logs, view), &path, call.show.json)?;
    }
    Ok(())
}
