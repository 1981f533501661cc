//! Energy: the port-Hamiltonian structure, the balance of audited runs, and what it implies (loops dissipate, rest is reached).

use plant_sim::exact::energy::{Ledger, audited_run};
use plant_sim::exact::{Dynamics, Spans, pack, stepper, unpack};
use plant_sim::model::Model;
use plant_sim::phs::{Hysteron, Phs, PhsState};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;
use std::path::Path;

/// The bar on |stored + dissipated - supplied|, in parts of the largest stored plus the exchanged energy.
const BAR: f64 = 1e-12;

fn thesis() -> Phs {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    Model::read(&file).expect("the thesis model").chain().plant
}

fn log_uniform(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    random.random_range(low.ln()..high.ln()).exp()
}

fn random_plant(random: &mut Pcg64) -> Phs {
    let (mass_kg, stiffness_n_per_m) = (log_uniform(random, 3e-4, 3e-3), log_uniform(random, 8e3, 8e4));
    Phs {
        mass_kg,
        stiffness_n_per_m,
        damping_n_s_per_m: 2.0 * log_uniform(random, 0.01, 1.0) * (mass_kg * stiffness_n_per_m).sqrt(),
        transduction_c_per_m: log_uniform(random, 0.02, 0.1),
        hysterons: (0..random.random_range(1..=5))
            .map(|_| {
                let capacitance_f = log_uniform(random, 1.5e-7, 1.5e-6);
                let open = random.random_range(0.0..1.0) < 0.15;
                Hysteron {
                    capacitance_f,
                    slope_s: capacitance_f / log_uniform(random, 0.5e-6, 50e-3),
                    dead_zone_v: if open { 0.0 } else { log_uniform(random, 0.3, 25.0) },
                }
            })
            .collect(),
    }
}

/// Up to 60 um, the speed that goes with it, up to 30 V on each hysteron.
fn random_state(random: &mut Pcg64, plant: &Phs) -> PhsState {
    let speed = 60e-6 * (plant.stiffness_n_per_m / plant.mass_kg).sqrt();
    PhsState {
        displacement_m: random.random_range(-60e-6..60e-6),
        velocity_m_per_s: random.random_range(-speed..speed),
        hysteron_v: plant.hysterons.iter().map(|_| random.random_range(-30.0..30.0)).collect(),
    }
}

fn relative_imbalance(ledger: &Ledger) -> f64 {
    ledger.imbalance_j().abs() / (ledger.peak_j + ledger.exchanged_j)
}

#[test]
fn the_structure_is_port_hamiltonian_in_every_state() {
    for seed in 0..50 {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = random_plant(&mut random);
        let n = plant.hysterons.len();
        let j = plant.interconnection();
        assert_eq!(j.transpose(), -&j);
        // Drive acts on the momentum by alpha, external force against it: nothing else is fed.
        let g = plant.input_map();
        for row in 0..n + 2 {
            let expected = if row == n + 1 { [plant.transduction_c_per_m, -1.0] } else { [0.0, 0.0] };
            assert_eq!([g[(row, 0)], g[(row, 1)]], expected);
        }
        for _ in 0..20 {
            let state = random_state(&mut random, &plant);
            let d = plant.dissipation(&state);
            assert_eq!(d, d.transpose());
            assert!(d.symmetric_eigenvalues().iter().all(|&lambda| lambda >= 0.0), "D is positive semi-definite: {d}");
            // H is the quadratic form of its own gradient: dH/dx . x = 2 H with x = [C v, q, M w].
            let mut x: Vec<f64> =
                plant.hysterons.iter().zip(&state.hysteron_v).map(|(h, v)| h.capacitance_f * v).collect();
            x.extend([state.displacement_m, plant.mass_kg * state.velocity_m_per_s]);
            let double: f64 = plant.energy_gradient(&state).iter().zip(&x).map(|(a, b)| a * b).sum();
            let energy_j = plant.energy_j(&state);
            assert!(energy_j > 0.0);
            assert!((double - 2.0 * energy_j).abs() <= 1e-14 * energy_j);
        }
        assert_eq!(plant.energy_j(&plant.relaxed()), 0.0);
    }
}

#[test]
fn stored_plus_dissipated_equals_supplied() {
    let mut dissipating = 0;
    for seed in 0..40 {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = random_plant(&mut random);
        let start = random_state(&mut random, &plant);
        let dt_s = log_uniform(&mut random, 1e-5, 2e-3);
        let turns = random.random_range(0.5..20.0);
        let inputs: Vec<(f64, f64)> = (0..300)
            .map(|k| {
                let step_v = if k > 150 { random.random_range(-30.0..30.0) } else { 0.0 };
                (60.0 * (TAU * turns * f64::from(k) / 300.0).sin() + step_v, random.random_range(-1.0..1.0))
            })
            .collect();
        let (_, ledger) = audited_run(&plant, &start, dt_s, &inputs).expect("at most 6 hysterons");
        assert!(ledger.dissipated_j > 0.0 && ledger.exchanged_j > 0.0);
        let imbalance = relative_imbalance(&ledger);
        assert!(imbalance <= BAR, "seed {seed}: {imbalance:e}, {ledger:?}, {plant:?}");
        dissipating += usize::from(ledger.dissipated_j > 0.1 * ledger.peak_j);
    }
    // The balance would say little if dissipation were lost in the sum.
    assert!(dissipating >= 35, "{dissipating} runs dissipate");
}

#[test]
fn the_balance_detects_a_wrong_dissipation() {
    // The same trajectory booked for a plant with one parameter off by 0.1 %: what the ledger would show if the engine stepped another
    // plant than it was given. Stored energy and supply are those of the trajectory.
    let plant = thesis();
    let dt_s = 1e-4;
    let inputs: Vec<(f64, f64)> = (0..1000).map(|k| (80.0 * (TAU * 50.0 * f64::from(k) * dt_s).sin(), 0.2)).collect();
    let (_, honest) = audited_run(&plant, &plant.relaxed(), dt_s, &inputs).expect("2 hysterons");
    assert!(relative_imbalance(&honest) <= BAR);

    let mut damped = plant.clone();
    damped.damping_n_s_per_m *= 1.001;
    let mut leaking = plant.clone();
    leaking.hysterons[1].slope_s *= 1.001;
    let mut wider = plant.clone();
    wider.hysterons[0].dead_zone_v *= 1.001;
    for (name, wrong) in [("b", damped), ("beta2", leaking), ("d1", wider)] {
        let (_, other) = audited_run(&wrong, &wrong.relaxed(), dt_s, &inputs).expect("2 hysterons");
        let mixed = Ledger { dissipated_j: other.dissipated_j, ..honest };
        let imbalance = relative_imbalance(&mixed);
        assert!(imbalance > 1e4 * BAR, "{name} off by 0.1 % shows only {imbalance:e}");
    }
}

#[test]
fn stored_energy_never_rises_without_supply() {
    for seed in 0..40 {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = random_plant(&mut random);
        let start = random_state(&mut random, &plant);
        let mut stepper = stepper(&Dynamics::of_plant(&plant), Spans::whole(log_uniform(&mut random, 1e-6, 1e-3)));
        stepper.set_state(&pack(&start));
        let first_j = plant.energy_j(&start);
        let mut before_j = first_j;
        for k in 0..500 {
            stepper.advance(0, 0.0, 0.0);
            let energy_j = plant.energy_j(&unpack(stepper.as_ref(), plant.hysterons.len()));
            // Rounding of the state and of H itself: a few units of 1e-16 of what was stored at first.
            assert!(energy_j <= before_j + 1e-15 * first_j, "seed {seed}, sample {k}: {before_j:e} -> {energy_j:e}");
            before_j = energy_j;
        }
        assert!(before_j < first_j);
    }
}

#[test]
fn the_area_of_a_closed_loop_is_what_it_dissipates() {
    // Over a period of a periodic motion nothing is stored on balance, so the loop in the plane of force and displacement encloses
    // what was dissipated. With a held force f_k the area is the sum of f_k (q_(k+1) - q_k): no quadrature error.
    let plant = thesis();
    let alpha = plant.transduction_c_per_m;
    let (dt_s, period) = (1e-4, 200);
    let inputs: Vec<(f64, f64)> =
        (0..period).map(|k| (80.0 * (TAU * f64::from(k) / f64::from(period)).sin(), 0.0)).collect();
    let mut state = plant.relaxed();
    for _ in 0..15 {
        // The slowest memory is C2/beta2 = 4.52 ms; 15 periods of 20 ms leave exp(-66) of the start.
        state = audited_run(&plant, &state, dt_s, &inputs).expect("2 hysterons").0;
    }
    let (end, ledger) = audited_run(&plant, &state, dt_s, &inputs).expect("2 hysterons");
    assert!((end.displacement_m - state.displacement_m).abs() < 1e-16);
    let mut area_j = 0.0;
    let mut stepper = stepper(&Dynamics::of_plant(&plant), Spans::whole(dt_s));
    stepper.set_state(&pack(&state));
    for (drive_v, _) in &inputs {
        let before_m = stepper.state(0);
        stepper.advance(0, alpha * drive_v, 0.0);
        area_j += alpha * drive_v * (stepper.state(0) - before_m);
    }
    assert!(ledger.dissipated_j > 1e-5, "{ledger:?}");
    assert!((area_j - ledger.dissipated_j).abs() < 1e-12 * ledger.exchanged_j, "{area_j:e} against {ledger:?}");
}

#[test]
fn equilibrium_is_reached_from_any_state_inside_every_dead_zone() {
    for seed in 0..30 {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = random_plant(&mut random);
        let start = random_state(&mut random, &plant);
        let (drive_v, force_n) = (random.random_range(-90.0..90.0), random.random_range(-1.0..1.0));
        let alpha = plant.transduction_c_per_m;
        // No motion outlives the slowest hysteron (leaking into the softest plant, C alpha^2/C k more slowly than C/beta) or the
        // damper's 2 M/b; 40 of their sum leave exp(-40) = 4e-18.
        let leak_s = plant
            .hysterons
            .iter()
            .map(|h| h.capacitance_f / h.slope_s * (1.0 + alpha * alpha / h.capacitance_f / plant.stiffness_n_per_m))
            .sum::<f64>();
        let wait_s = 40.0 * (leak_s + 2.0 * plant.mass_kg / plant.damping_n_s_per_m);
        let dt_s = 1e-3f64.min(wait_s / 100.0);
        let mut stepper = stepper(&Dynamics::of_plant(&plant), Spans::whole(dt_s));
        stepper.set_state(&pack(&start));
        for _ in 0..(wait_s / dt_s).ceil() as usize {
            stepper.advance(0, alpha * drive_v - force_n, 0.0);
        }
        let end = unpack(stepper.as_ref(), plant.hysterons.len());
        for (hysteron, &v) in plant.hysterons.iter().zip(&end.hysteron_v) {
            assert!(
                v.abs() <= hysteron.edge_v() + 1e-9,
                "seed {seed}: {v} V against an edge of {} V",
                hysteron.edge_v()
            );
        }
        let expected_m = plant.equilibrium_m(drive_v, force_n, &end.hysteron_v);
        assert!((end.displacement_m - expected_m).abs() < 1e-15, "seed {seed}: {end:?} against {expected_m:e}");
        assert!(end.velocity_m_per_s.abs() < 1e-10, "seed {seed}: {end:?}");
    }
}
