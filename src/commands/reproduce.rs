//! `hysteron reproduce`: the thesis' tables and figures, printed beside recomputed.

use crate::arguments::ReproduceCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::reproduce::{Entry, Reproduction, Thesis, Verdict, page, reproduce};

pub fn reproduce_thesis(call: &ReproduceCall) -> Result<(), Failure> {
    let thesis = Thesis::default();
    let spinner = output::spinner();
    let found = reproduce(&thesis, &|what| spinner.set_message(what.to_owned()));
    spinner.finish_and_clear();
    if call.json {
        output::line(&json(&found).to_string());
    } else {
        print(&found);
    }
    let report = page(&thesis, &found, &output::provenance(None));
    output::save_page(&report, &call.out, call.json)?;
    let differ = found.count(|v| *v == Verdict::Differs);
    if differ > 0 {
        return Err(Failure::interrupted(format!(
            "{differ} numbers differ without explanation: see {}",
            call.out.display()
        )));
    }
    Ok(())
}

fn word(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Agrees => "agrees",
        Verdict::Within => "within",
        Verdict::Erratum { .. } => "erratum",
        Verdict::Given => "given",
        Verdict::Differs => "differs",
    }
}

fn print(found: &Reproduction) {
    let count = |is: fn(&Verdict) -> bool| found.count(is).to_string();
    output::facts(&[
        ("to their printed digits".into(), count(|v| *v == Verdict::Agrees)),
        ("of an independent solver, within 1 % or half a last digit".into(), count(|v| *v == Verdict::Within)),
        ("errata".into(), count(|v| matches!(v, Verdict::Erratum { .. }))),
        ("measured or chosen, not computable".into(), count(|v| *v == Verdict::Given)),
        ("unexplained".into(), count(|v| *v == Verdict::Differs)),
    ]);
    for entry in found.entries() {
        if let Verdict::Erratum { corrected, cause } = &entry.verdict {
            output::line(&format!("{}, {}: {} -> {corrected}; {cause}", entry.place, entry.what, entry.printed));
        }
    }
}

fn json(found: &Reproduction) -> serde_json::Value {
    let entry = |entry: &Entry| {
        let (corrected, cause) = match &entry.verdict {
            Verdict::Erratum { corrected, cause } => (Some(corrected), Some(cause)),
            _ => (None, None),
        };
        serde_json::json!({
            "where": entry.place, "what": entry.what, "unit": entry.unit, "printed": entry.printed,
            "recomputed": entry.ours.is_finite().then_some(entry.ours), "verdict": word(&entry.verdict),
            "corrected": corrected, "cause": cause,
        })
    };
    serde_json::json!({
        "schema": "hysteron-reproduction-1",
        "entries": found.entries().map(entry).collect::<Vec<_>>(),
        "table_2_3_fit_percent": found.trend.fit_percent,
    })
}
