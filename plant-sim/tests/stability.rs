//! Proposition 3.3.1 against the thesis' printed eigenvalues, and the certificate against loops whose fate is known.

use plant_sim::margins::{Loop, Verdict, assess};
use plant_sim::model::Model;
use plant_sim::phs::{Hysteron, Phs};
use plant_sim::stability::{Law, certify, proposition};
use std::path::Path;

const KP: f64 = 8.5811e5;
const KI: f64 = 9.6755e8;

fn thesis() -> Phs {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    Model::read(&path).expect("a plant of the project").chain().plant
}

fn sampled(kp: f64, ki: f64, rate_hz: f64, delay_s: f64) -> Loop {
    Loop { kp_v_per_m: kp, ki_v_per_m_s: ki, rate_hz, delay_s }
}

#[test]
fn the_thesis_eigenvalues_come_out() {
    let found = proposition(&thesis(), KP, KI).expect("solvable");
    // As the thesis prints them, to 1e-9.
    for (ours, printed) in found.eigenvalues_of_pg.iter().zip([0.022653084227172435, 1.45846473621464e-6]) {
        assert!((ours / printed - 1.0).abs() < 1e-9, "{ours:?} for {printed:?}");
    }
    assert!(found.solution.is_definite);
    // Proven right, not only equal to a print: the bound is far below the 1e-9 asked for, but not zero.
    assert!(found.solution.relative_error > 0.0 && found.solution.relative_error < 1e-12, "{:?}", found.solution);
    assert!((found.bound - 22.072).abs() < 5e-4, "{}", found.bound);
    assert!(found.printed_holds());
    let poles = &found.poles_per_s;
    let printed = [(-1.0637e6, 0.0), (-1511.8, 7946.6), (-1511.8, 7946.6), (-653.9, 0.0), (-228.2, 0.0)];
    for (ours, (re, im)) in poles.iter().zip(printed) {
        assert!((ours.re - re).abs() < 5e-5 * ours.norm().max(1e3) && (ours.im.abs() - im).abs() < 0.06, "{poles:?}");
    }
}

#[test]
fn no_search_beats_the_identity_and_the_units_are_said() {
    let found = proposition(&thesis(), KP, KI).expect("solvable");
    // With Q >= 1 the solution only grows, so Q = 1 is best; a search must find nothing better, and nothing worse than its start.
    assert!((found.best_bound / found.bound - 1.0).abs() < 1e-9, "{} {}", found.best_bound, found.bound);
    // Weights help by orders of magnitude once units are right, and never enough.
    assert!(found.best_share > 1e3 * found.share && found.best_share < 1.0, "{} {}", found.share, found.best_share);
    assert!(!found.holds());
    assert!(found.statement().contains("can't certify"), "{}", found.statement());
}

#[test]
fn any_number_of_hysterons() {
    let mut plant = thesis();
    for n in 0..=5 {
        plant.hysterons = (0..n)
            .map(|i| Hysteron { capacitance_f: 5e-7, slope_s: 1e-4 * f64::from(i + 1), dead_zone_v: 5.0 })
            .collect();
        let certificate = certify(&plant, Law::Continuous { kp_v_per_m: KP, ki_v_per_m_s: KI });
        assert!(certificate.is_certified, "{n}: {certificate:?}");
        if n > 0 {
            let found = proposition(&plant, KP, KI).expect("solvable");
            assert_eq!(found.eigenvalues_of_pg.len(), n as usize);
            assert!(found.solution.is_definite && found.solution.relative_error < 1e-12);
        }
    }
}

#[test]
fn pi_1_is_certified_where_its_margins_are_sound() {
    let plant = thesis();
    let continuous = certify(&plant, Law::Continuous { kp_v_per_m: KP, ki_v_per_m_s: KI });
    assert!(continuous.is_certified && continuous.largest_eigenvalue < -1e-6, "{continuous:?}");
    // 40 kHz and 10 us have 10 dB, 20 kHz 6.5 dB; 10 kHz has 2.4 dB, too few for the proof; 20 kHz with 50 us 0.7 dB.
    for (rate_hz, delay_s, expected) in
        [(40e3, 10e-6, true), (20e3, 10e-6, true), (10e3, 10e-6, false), (20e3, 50e-6, false)]
    {
        let found = certify(&plant, Law::Sampled(sampled(KP, KI, rate_hz, delay_s)));
        assert_eq!(found.is_certified, expected, "{rate_hz} Hz, {delay_s} s: {found:?}");
        assert_eq!(found.statement.starts_with("certified"), expected);
    }
}

#[test]
fn nothing_unstable_is_ever_certified() {
    let plant = thesis();
    let regions = plant.linear_regions().expect("regions");
    let (mut certified, mut unstable) = (0, 0);
    for rate_hz in [5e3, 10e3, 20e3, 50e3] {
        for (kp, ki) in [(KP, KI), (3.0 * KP, KI), (2.3164e4, 1.8384e8), (1e5, 2e9), (KP, 2e10)] {
            for delay_s in [0.0, 10e-6, 60e-6] {
                let law = sampled(kp, ki, rate_hz, delay_s);
                let stable = !matches!(assess(&regions, &law).expect("assessed").verdict, Verdict::Unstable { .. });
                let proof = certify(&plant, Law::Sampled(law));
                assert!(stable || !proof.is_certified, "{law:?} {proof:?}");
                certified += usize::from(proof.is_certified);
                unstable += usize::from(!stable);
            }
        }
    }
    // The grid must hold both kinds, or it tests nothing.
    assert!(certified >= 5 && unstable >= 5, "{certified} certified, {unstable} unstable");
}
