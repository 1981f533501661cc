//! Prints what a diagnosis finds in folders with nominal.toml and logs, one line each: for those who work on the diagnosis.

use gap_diagnosis::diagnose::bench::Bench;
use gap_diagnosis::diagnose::hypothesis::Freedom;
use gap_diagnosis::diagnose::judge::course;
use gap_diagnosis::diagnose::records::record;
use gap_diagnosis::diagnose::search::Search;
use gap_diagnosis::residual::noise_rms;
use plant_sim::log::{ReadOptions, read};
use plant_sim::model::Model;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

fn main() {
    let verbose = std::env::var("VERBOSE").is_ok();
    for folder in std::env::args().skip(1).map(PathBuf::from) {
        let model = Model::read(&folder.join("nominal.toml")).expect("a model");
        let entries = std::fs::read_dir(&folder).expect("a folder");
        let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("entry").path()).collect();
        paths.sort();
        let is_log =
            |p: &&PathBuf| p.extension().is_some_and(|e| e == "csv") && !p.display().to_string().contains("held-out");
        let logs: Vec<_> =
            paths.iter().filter(is_log).map(|p| read(p, &ReadOptions::default()).expect("a log")).collect();
        let chain = model.chain();
        let records = logs.iter().map(|log| record(log, &chain, None)).collect();
        let bench = Bench::new(&model, records);
        let simulations = AtomicUsize::new(0);
        let search = Search { bench: &bench, simulations: &simulations };
        let begun = Instant::now();
        let found = course(&search, Freedom::Rest, &[], &|what, _| {
            if verbose {
                println!("[{:6.2} s] {what}", begun.elapsed().as_secs_f64());
            }
        });
        if verbose {
            for freed in gap_diagnosis::diagnose::symmetry::freed(&search, &found.refit).iter().take(6) {
                println!(
                    "    freed {} {:?} along {:.3} cost {:.1} of {:.1}",
                    freed.effect, freed.quantity, freed.along, freed.cost, freed.cost_without
                );
            }
        }
        println!(
            "{} | rms/noise {:.2} prior {:.0} | {:.1} s {} sims | none {:.3} unknown {:.3}",
            folder.file_name().unwrap_or_default().to_string_lossy(),
            found.refit.chi.sqrt(),
            found.refit.found.prior_cost,
            begun.elapsed().as_secs_f64(),
            simulations.load(Ordering::Relaxed),
            found.no_gap,
            found.unknown
        );
        for e in found.explanations.iter().take(if verbose { 30 } else { 4 }) {
            let values: Vec<f64> = bench.values(&e.candidate.hypothesis, &e.candidate.found.z, 0).concat();
            println!(
                "    {:.3} {:?} left {:.2} % worst {:.2} % floor {:.3} % prior {:.0} of {} rms/noise {:.4} {} {}",
                e.probability,
                e.judged.ids,
                100.0 * e.judged.left,
                100.0 * e.judged.of_worst,
                100.0 * e.judged.floor,
                e.judged.prior_cost,
                e.judged.parameters,
                e.candidate.chi.sqrt(),
                e.candidate.hypothesis.installed.iter().map(|i| i.form.name).collect::<Vec<_>>().join("+"),
                values.iter().map(|v| format!("{v:.3e}")).collect::<Vec<_>>().join(" ")
            );
        }
        if verbose {
            println!(
                "    refit {}",
                found.refit.found.z.iter().map(|z| format!("{z:.3}")).collect::<Vec<_>>().join(" ")
            );
            for (record, sums) in bench.records.iter().zip(&found.refit.found.normal.logs) {
                println!(
                    "    {} refit rms {:.1} nm",
                    record.log.name,
                    1e9 * (sums.squares_m2 / sums.rows as f64).sqrt()
                );
            }
            for e in found.explanations.iter().take(4) {
                println!(
                    "    z {:?} {}",
                    e.judged.ids,
                    e.candidate.found.z.iter().map(|z| format!("{z:.3}")).collect::<Vec<_>>().join(" ")
                );
            }
            if let Some(best) = found.explanations.first() {
                let remainders = search.play(&best.candidate);
                let logs = bench.records.iter().zip(&best.candidate.found.normal.logs).zip(&remainders);
                for ((record, sums), remainder) in logs {
                    println!(
                        "    {} rms {:.1} nm noise {:.1} nm, from what stays {:.1} nm",
                        record.log.name,
                        1e9 * (sums.squares_m2 / sums.rows as f64).sqrt(),
                        1e9 * record.noise_m,
                        1e9 * noise_rms(&remainder.residual_m[record.run_in..])
                    );
                }
            }
            println!("    lines {:?}", found.line_hz);
            println!("    {:?}", found.scattered);
            for lead in found.leads.iter().take(12) {
                println!("      lead {} {} {:.1} %", lead.effect.id(), lead.form.name, 100.0 * lead.share);
            }
        }
    }
}
