//! Nanoseconds per sample of 50 us for chains with one part more than the thesis' plant: a 60 V sine of 50 Hz with a step in it.
//!
//! `cargo run --release -p plant-sim --example speed`

use plant_sim::chain::{
    Bend, BendLaw, Chain, Drive, Force, Held, Joint, Lag, Mode, Parts, Sensor, Shake, Simulator, Warming,
};
use plant_sim::model::Model;
use std::f64::consts::TAU;
use std::path::Path;
use std::time::Instant;

const SAMPLE_S: f64 = 5e-5;
const SAMPLES: u32 = 200_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let nominal = Model::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml"))?.chain();
    let drive = |drive: Drive| Chain { drive, ..nominal.clone() };
    let parts = |parts: Parts| Chain { parts, ..nominal.clone() };
    let force = |force: Force| parts(Parts { forces: vec![force], ..Parts::default() });
    let bend = |i: usize, law| parts(Parts { bends: vec![Bend { hysteron: Some(i), law }], ..Parts::default() });
    let mode =
        |joint| parts(Parts { modes: vec![Mode { joint, hz: 2000.0, damping_ratio: 0.02 }], ..Parts::default() });
    let first = Some(Lag::First { time_constant_s: 1e-4 });
    let second = Some(Lag::Second { natural_rad_per_s: 1e4, damping_ratio: 0.7 });
    let warming = Warming { coefficient: 0.02, time_constant_s: 10.0, heat: plant_sim::chain::Heat::Time };
    let chains = [
        ("nominal", nominal.clone()),
        ("fractional delay", drive(Drive { delay_s: 2e-5, ..Drive::IDEAL })),
        ("lag, first order", drive(Drive { lag: first, ..Drive::IDEAL })),
        ("lag, first order, fractional delay", drive(Drive { lag: first, delay_s: 2e-5, ..Drive::IDEAL })),
        ("lag, second order", drive(Drive { lag: second, ..Drive::IDEAL })),
        ("slew", drive(Drive { slew_v_per_s: 1e5, slew_down_v_per_s: 1e5, ..Drive::IDEAL })),
        ("warming", drive(Drive { warmings: vec![warming], ..Drive::IDEAL })),
        ("sensor lag", Chain { sensor: Sensor { lag: first, ..Sensor::IDEAL }, ..nominal.clone() }),
        ("attached mode", mode(Joint::Attached { mass_kg: 5e-5 })),
        ("parallel mode", mode(Joint::Parallel { compliance_m_per_n: 1e-6 })),
        ("cubic spring", force(Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 1e11 })),
        ("one-sided spring", force(Force::OneSided { stiffness_n_per_m: 1000.0 })),
        (
            "stop, 20 times the stiffness",
            force(Force::Stop { at_m: 90e-6, stiffness_n_per_m: 5e5, damping_s_per_m: 0.0 }),
        ),
        ("presliding, 50 mN over 1 um", force(Force::Presliding { coulomb_n: 0.05, presliding_m: 1e-6 })),
        ("smooth friction, 1 mm/s", force(Force::Smooth { coulomb_n: 0.05, speed_m_per_s: 1e-3 })),
        ("power 0.5", force(Force::Power { force_n: 0.05, reference_m_per_s: 0.1, exponent: 0.5 })),
        ("power 2", force(Force::Power { force_n: 0.05, reference_m_per_s: 0.1, exponent: 2.0 })),
        ("shake", parts(Parts { shakes: vec![Shake { hz: 150.0, cos_n: 0.01, sin_n: 0.0 }], ..Parts::default() })),
        ("capacitance skew, fast", bend(0, BendLaw::CapacitanceSkew(0.1))),
        ("slope skew, slow", bend(1, BendLaw::SlopeSkew(0.1))),
        ("exponent 1.2, slow", bend(1, BendLaw::Exponent(1.2))),
        ("exponent 1.2, fast", bend(0, BendLaw::Exponent(1.2))),
        ("widening, fast", bend(0, BendLaw::Widening { share: 0.1, reference_v_per_s: 1e5 })),
    ];
    for (name, chain) in chains {
        let best = (0..3).map(|_| nanoseconds(&chain)).fold(f64::INFINITY, f64::min);
        println!("{name:36} {best:7.1} ns");
    }
    Ok(())
}

fn nanoseconds(chain: &Chain) -> f64 {
    let volts: Vec<f64> = (0..400)
        .map(|k| {
            let step_v = if (100..200).contains(&k) { 20.0 } else { 0.0 };
            60.0 * (TAU * f64::from(k) / 400.0).sin() + step_v
        })
        .collect();
    let mut simulator = Simulator::new(chain, SAMPLE_S, 0.0);
    let mut sum_m = 0.0;
    let start = Instant::now();
    for k in 0..SAMPLES {
        sum_m += simulator.reading_m();
        simulator.advance(Held::zero_order(volts[k as usize % 400]), 0.0);
    }
    assert!(sum_m.is_finite());
    start.elapsed().as_secs_f64() * 1e9 / f64::from(SAMPLES)
}
