//! Times the forms on one log: for those who work on the diagnosis.

use gap_diagnosis::diagnose::bench::{Bench, Freedom, Hypothesis};
use gap_diagnosis::diagnose::records::record;
use plant_sim::effects::REGISTRY;
use plant_sim::log::{ReadOptions, read};
use plant_sim::model::Model;
use plant_sim::replay::predict;
use std::path::PathBuf;
use std::time::Instant;

fn main() {
    let folder = PathBuf::from(std::env::args().nth(1).expect("a folder"));
    let model = Model::read(&folder.join("nominal.toml")).expect("a model");
    let log = read(&folder.join("log1-steps.csv"), &ReadOptions::default()).expect("a log");
    let chain = model.chain();
    let bench = Bench::new(&model, vec![record(&log, &chain, None, false)]);
    let base = Hypothesis::nominal(Freedom::Rest);
    let time = |hypothesis: &Hypothesis, values: &[Vec<f64>]| {
        let z = bench.origin(hypothesis, values);
        let chain = bench.chain_at(hypothesis, &z, 0);
        let start = bench.start_at(hypothesis, &z, 0, &chain);
        let mut coarse = chain.clone();
        coarse.parts.is_coarse = true;
        let begun = Instant::now();
        let fast = predict(&coarse, &log, &start, log.len());
        let ns = begun.elapsed().as_secs_f64() / log.len() as f64 * 1e9;
        let slow = predict(&chain, &log, &start, log.len());
        let plain = predict(&bench.chain, &log, &start, log.len());
        let rms = |a: &[f64], b: &[f64]| {
            1e9 * (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
        };
        format!("{ns:.0} ns, coarse differs by {:.3} nm of {:.0} nm effect", rms(&fast, &slow), rms(&slow, &plain))
    };
    println!("nominal {}", time(&base, &[]));
    println!("nominal {}", time(&base, &[]));
    for effect in REGISTRY {
        for form in effect.forms() {
            let hypothesis = base.with(*effect, form, &bench.scales());
            let axes = &hypothesis.installed[0].axes;
            let values: Vec<f64> = axes.iter().map(|a| a.starts()[a.starts().len() / 2]).collect();
            println!("{} {} {}", effect.id(), form.name, time(&hypothesis, &[values]));
        }
    }
}
