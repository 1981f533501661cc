//! scratch
use gap_diagnosis::identify::*; use plant_sim::log::*; use std::time::Instant; use plant_sim::replay::Initial;
#[test] fn dbo() {
 let mut o = ReadOptions::default(); for (a, b) in [("time", "t_s"), ("command", "u_V"), ("displacement", "y_um")] { o.columns.insert(a.into(), b.into()); }
 let log = read(std::path::Path::new("/work/shared/data/piezo-micromanipulator-dbo/clean_Model.csv"), &o).unwrap();
 let n: usize = std::env::var("N").unwrap_or("6".into()).parse().unwrap(); let starts: usize = std::env::var("STARTS").unwrap_or("2".into()).parse().unwrap();
 let t = Instant::now();
 let fit = identify(&[log], &Options { from: From::Logs { hysterons: Hysterons::Fixed(n), mass_kg: 1.0148e-3 }, initial: Initial::Rest, run_in_s: Some(2.0), starts, seed: 1 }, &|p, s| println!("{:6.1} s {p} {s}", t.elapsed().as_secs_f64())).unwrap();
 for p in &fit.parameters { println!("{:22} {:12.4e} +- {:9.2e} prior {:12.4e} {}", p.name, p.value, p.sigma, p.prior, p.note); }
 for l in &fit.logs { println!("{} rms {:.4} um fit {:.2} noise {:.4} um offset {:.3} um  sims {} starts {:?} bic {:.1} aic {:.1}", l.name, l.rms_m * 1e6, l.fit_percent, l.noise_m * 1e6, l.offset_m * 1e6, fit.simulations, fit.starts_rms_m, fit.bic, fit.aic); }
 println!("{:.1} s", t.elapsed().as_secs_f64()); fit.model.write(std::path::Path::new("/tmp/fitted.toml")).unwrap();
}
