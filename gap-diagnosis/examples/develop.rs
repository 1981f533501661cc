//! Prints the steps of a search on a folder with nominal.toml and logs: for those who work on the diagnosis.

use gap_diagnosis::diagnose::bench::{Bench, Freedom};
use gap_diagnosis::diagnose::lines::lines;
use gap_diagnosis::diagnose::records::record;
use gap_diagnosis::diagnose::screen::screen;
use gap_diagnosis::diagnose::search::Search;
use plant_sim::log::{ReadOptions, read};
use plant_sim::model::Model;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

fn main() {
    let folder = PathBuf::from(std::env::args().nth(1).expect("a folder"));
    let fits: usize = std::env::args().nth(2).map_or(8, |n| n.parse().expect("a number"));
    let model = Model::read(&folder.join("nominal.toml")).expect("a model");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(&folder).expect("a folder").map(|e| e.expect("entry").path()).collect();
    paths.sort();
    let logs: Vec<_> = paths
        .iter()
        .filter(|p| p.extension().is_some_and(|e| e == "csv") && !p.to_string_lossy().contains("held-out"))
        .map(|p| read(p, &ReadOptions::default()).expect("a log"))
        .collect();
    let chain = model.chain();
    let records = logs.iter().map(|log| record(log, &chain, None, false)).collect();
    let bench = Bench::new(&model, records);
    for r in &bench.records {
        println!(
            "{}: {} rows, noise {:.1} nm, lattice {:.1} nm, before {:?}",
            r.log.name,
            r.log.len(),
            r.noise_m * 1e9,
            r.lattice_m * 1e9,
            r.before_v
        );
    }
    let simulations = AtomicUsize::new(0);
    let search = Search { bench: &bench, simulations: &simulations };
    let begun = Instant::now();
    let say = |what: &str| {
        println!("[{:6.2} s, {} sims] {what}", begun.elapsed().as_secs_f64(), simulations.load(Ordering::Relaxed))
    };
    let refit = search.refit(Freedom::Rest);
    say(&format!("refit: rms/noise {:.3}, prior {:.1}", refit.chi.sqrt(), refit.found.prior_cost));
    let residuals = search.residuals_m(&refit);
    let line_hz = lines(&bench, &residuals);
    say(&format!("lines {line_hz:.2?}"));
    let leads = screen(&bench, &refit.hypothesis, &refit.found, &line_hz, &[], &simulations);
    say("screened");
    let mut entries: Vec<&str> = Vec::new();
    for lead in &leads {
        if entries.len() < 12 && !entries.contains(&lead.effect.id()) {
            entries.push(lead.effect.id());
            println!(
                "   {:5.1} %  {} {} {}",
                100.0 * lead.share,
                lead.effect.id(),
                lead.form.name,
                short(&lead.values)
            );
        }
    }
    for id in entries.into_iter().take(fits) {
        let lead = leads.iter().find(|l| l.effect.id() == id).expect("there");
        let fit = search.extend(&refit, lead, true);
        let left = ((fit.chi - 1.0).max(0.0) / (refit.chi - 1.0)).sqrt();
        say(&format!(
            "{id} {}: rms/noise {:.4}, left {:.1} %, prior {:.1}, {}",
            lead.form.name,
            fit.chi.sqrt(),
            100.0 * left,
            fit.found.prior_cost,
            short(&bench.values(&fit.hypothesis, &fit.found.z, 0).concat())
        ));
    }
}

fn short(values: &[f64]) -> String {
    values.iter().map(|v| format!("{v:.3e}")).collect::<Vec<_>>().join(" ")
}
