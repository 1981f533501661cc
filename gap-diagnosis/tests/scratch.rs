//! scratch
use gap_diagnosis::identify::*;
use plant_sim::log::*;
use plant_sim::replay::Initial;
use std::time::Instant;
#[test]
fn dbo() {
    let mut o = ReadOptions::default();
    for (a, b) in [("time", "t_s"), ("command", "u_V"), ("displacement", "y_um")] {
        o.columns.insert(a.into(), b.into());
    }
    let log = read(std::path::Path::new("/work/shared/data/piezo-micromanipulator-dbo/clean_Model.csv"), &o).unwrap();
    let n: usize = std::env::var("N").unwrap_or("6".into()).parse().unwrap();
    let starts: usize = std::env::var("STARTS").unwrap_or("2".into()).parse().unwrap();
    let t = Instant::now();
    let fit = identify(
        &[log],
        &Options {
            from: From::Logs { hysterons: Hysterons::Fixed(n), mass_kg: 1.0148e-3 },
            initial: Initial::Rest,
            run_in_s: Some(2.0),
            starts,
            seed: 1,
        },
        &|p, s| println!("{:6.1} s {p} {s}", t.elapsed().as_secs_f64()),
    )
    .unwrap();
    for p in &fit.parameters {
        println!("{:22} {:12.4e} +- {:9.2e} prior {:12.4e} {}", p.name, p.value, p.sigma, p.prior, p.note);
    }
    for l in &fit.logs {
        println!(
            "{} rms {:.4} um fit {:.2} noise {:.4} um offset {:.3} um  sims {} starts {:?} bic {:.1} aic {:.1}",
            l.name,
            l.rms_m * 1e6,
            l.fit_percent,
            l.noise_m * 1e6,
            l.offset_m * 1e6,
            fit.simulations,
            fit.starts_rms_m,
            fit.bic,
            fit.aic
        );
    }
    println!("{:.1} s", t.elapsed().as_secs_f64());
    fit.model.write(std::path::Path::new("/tmp/fitted.toml")).unwrap();
}
#[test]
fn thesis() {
    use plant_sim::{experiment::*, model::Model, replay::Start, spec::Spec};
    use rand::{RngExt, SeedableRng};
    let model = Model::read(std::path::Path::new("../models/thesis-phs.toml")).unwrap();
    let mut chain = model.chain();
    chain.sensor.noise_m = 20e-9;
    let start = Start::relaxed(&chain);
    let spec = Spec::parse("hold:40V@0.05s+hold:80V@0.1s+hold:20V@0.05s+hold:-60V@0.1s+hold:-10V@0.1s+sine:80V@40Hz,for=0.2s+hold:30V@0.1s+sine:75V@100Hz,for=0.2s+hold:0V@0.1s").unwrap();
    let program = Program::new(&spec, 1e4).unwrap();
    let r = open_loop(
        &Setup { chain: &chain, start: &start, rate_hz: 1e4, samples: 10000, latency_s: 0.0, seed: 3 },
        &program,
        &|_| (),
    )
    .unwrap();
    let log = Log {
        name: "made".into(),
        dt_s: 1e-4,
        command_v: r.command_v.clone(),
        displacement_m: r.displacement_m.clone(),
        ..Log::default()
    };
    let n: u64 = std::env::var("RUNS").unwrap_or("5".into()).parse().unwrap();
    let starts: usize = std::env::var("STARTS").unwrap_or("4".into()).parse().unwrap();
    for run in 0..n {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(run);
        let mut m = model.clone();
        let mut f = || (rng.random_range(-0.3..0.3f64)).exp();
        m.structure.damping_n_s_per_m.value *= f();
        m.structure.stiffness_n_per_m.value *= f();
        m.actuator.transduction_c_per_m.value *= f();
        for h in &mut m.actuator.hysterons {
            h.capacitance_f.value *= f();
            h.slope_s.value *= f();
            h.dead_zone_v.value *= f();
        }
        let t = Instant::now();
        let fit = identify(
            std::slice::from_ref(&log),
            &Options { from: From::Plant(Box::new(m)), initial: Initial::Rest, run_in_s: None, starts, seed: run },
            &|_, _| (),
        )
        .unwrap();
        println!(
            "run {run}: rms {:.3} nm noise {:.3} starts {:?} sims {} {:.2} s",
            fit.logs[0].rms_m * 1e9,
            fit.logs[0].noise_m * 1e9,
            fit.starts_rms_m.iter().map(|r| (r * 1e9 * 10.0).round() / 10.0).collect::<Vec<_>>(),
            fit.simulations,
            t.elapsed().as_secs_f64()
        );
        println!("   {:?}", fit.logs[0].start);
        if fit.logs[0].rms_m > 1.0 {
            for p in &fit.parameters {
                println!("{:22} {:12.4e} +- {:9.2e} prior {:12.4e} {}", p.name, p.value, p.sigma, p.prior, p.note);
            }
        }
    }
}
