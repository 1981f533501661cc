//! The plant's equations and the facts about the thesis plant that were computed independently.

use nalgebra::{DMatrix, DVector};
use plant_sim::exact::{Dynamics, Spans, Stepper, pack, stepper};
use plant_sim::model::Model;
use plant_sim::phs::{Hysteron, Phs, PhsState};
use proptest::prelude::*;
use std::f64::consts::TAU;
use std::path::Path;

fn thesis() -> Phs {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    Model::read(&file).expect("the thesis model").chain().plant
}

fn start(plant: &Phs, dt_s: f64) -> Box<dyn Stepper> {
    stepper(&Dynamics::of_plant(plant), Spans::whole(dt_s))
}

/// Displacements at the start of every sample.
fn displacement_m(plant: &Phs, dt_s: f64, drive_v: &[f64]) -> Vec<f64> {
    let mut record_m = Vec::new();
    start(plant, dt_s).record(&mut drive_v.iter().map(|v| plant.transduction_c_per_m * v), &mut record_m);
    record_m
}

/// Opens both dead zones and rings: 90 V sines of 20 and 330 Hz over a jump.
fn lively_drive_v(samples: usize, dt_s: f64) -> Vec<f64> {
    (0..samples)
        .map(|k| {
            let t = k as f64 * dt_s;
            50.0 * (TAU * 20.0 * t).sin() + 20.0 * (TAU * 330.0 * t).sin() + if k > samples / 2 { 20.0 } else { 0.0 }
        })
        .collect()
}

fn any_plant() -> impl Strategy<Value = Phs> {
    let hysteron = (1e-7..1e-6f64, 1e-5..1.0f64, 0.0..20.0f64)
        .prop_map(|(capacitance_f, slope_s, dead_zone_v)| Hysteron { capacitance_f, slope_s, dead_zone_v });
    (1e-4..1e-2f64, 0.0..10.0f64, 1e4..1e5f64, 0.01..0.1f64, prop::collection::vec(hysteron, 0..5)).prop_map(
        |(mass_kg, damping_n_s_per_m, stiffness_n_per_m, transduction_c_per_m, hysterons)| Phs {
            mass_kg,
            damping_n_s_per_m,
            stiffness_n_per_m,
            transduction_c_per_m,
            hysterons,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn derivative_is_the_port_hamiltonian_form_entry_by_entry(
        plant in any_plant(),
        displacement_m in -1e-4..1e-4f64,
        velocity_m_per_s in -0.5..0.5f64,
        voltages in prop::collection::vec(-20.0..20.0f64, 5),
        drive_v in -90.0..90.0f64,
        force_n in -2.0..2.0f64,
    ) {
        let n = plant.hysterons.len();
        let state = PhsState { displacement_m, velocity_m_per_s, hysteron_v: voltages[..n].to_vec() };
        let structure = plant.interconnection() - plant.dissipation(&state);
        let gradient = plant.energy_gradient(&state);
        let input = DVector::from_vec(vec![drive_v, force_n]);
        let x_dot = &structure * &gradient + plant.input_map() * &input;
        // Rounding of a sum is bounded by the sum of the magnitudes.
        let size = structure.abs() * gradient.abs() + plant.input_map().abs() * input.abs();
        let derivative = plant.derivative(&state, drive_v, force_n);
        let ours = derivative.hysteron_v.iter().zip(&plant.hysterons).map(|(v, h)| h.capacitance_f * v)
            .chain([derivative.displacement_m, plant.mass_kg * derivative.velocity_m_per_s]);
        for (i, entry) in ours.enumerate() {
            prop_assert!((entry - x_dot[i]).abs() <= 1e-14 * size[i], "entry {i}: {entry} against {}", x_dot[i]);
        }
    }
}

#[test]
fn static_gain_and_the_volts_for_120_um() {
    let plant = thesis();
    // The last printed digit.
    assert!((plant.static_gain_m_per_v() * 1e6 - 1.88417).abs() < 0.5e-5);
    assert!((120e-6 / plant.static_gain_m_per_v() - 63.69).abs() < 0.005);
    // From rest, quasi-statically, every hysteron holds its edge against the drive.
    let edges_v: Vec<f64> = plant.hysterons.iter().map(Hysteron::edge_v).collect();
    let needed_v = 120e-6 / plant.static_gain_m_per_v() + edges_v.iter().sum::<f64>();
    assert!((needed_v - 75.3).abs() < 0.05, "{needed_v}");
    assert!((plant.equilibrium_m(needed_v, 0.0, &edges_v) - 120e-6).abs() < 1e-18);
}

#[test]
fn a_slow_64_v_reaches_98_7_um_and_leaves_7_5_um() {
    // 10 s up and 10 s down at 1 kHz: slow against 4.52 ms. The hysterons lag by rate * C/beta = 6.4 V/s * 5 ms = 0.03 V, 0.06 um,
    // so a second of rest follows each ramp.
    let plant = thesis();
    let dt_s = 1e-3;
    let samples = 10_000;
    let mut drive_v: Vec<f64> = (0..samples).map(|k| 64.0 * f64::from(k) / f64::from(samples)).collect();
    drive_v.extend(vec![64.0; 1000]);
    let top = drive_v.len() - 1;
    drive_v.extend((0..samples).map(|k| 64.0 * (1.0 - f64::from(k) / f64::from(samples))));
    drive_v.extend(vec![0.0; 1000]);
    let record_m = displacement_m(&plant, dt_s, &drive_v);
    let (up_um, left_um) = (record_m[top] * 1e6, record_m[drive_v.len() - 1] * 1e6);
    assert!((up_um - 98.7).abs() < 0.05, "{up_um}");
    assert!((left_um - 7.5).abs() < 0.05, "{left_um}");
}

#[test]
fn time_constants_and_stiffness_inside_the_dead_zones() {
    let plant = thesis();
    let time_constants_s: Vec<f64> = plant.hysterons.iter().map(|h| h.capacitance_f / h.slope_s).collect();
    assert!((time_constants_s[0] - 0.940e-6).abs() < 0.5e-9);
    assert!((time_constants_s[1] - 4.52e-3).abs() < 0.5e-5);
    let alpha = plant.transduction_c_per_m;
    let added: Vec<f64> = plant.hysterons.iter().map(|h| alpha * alpha / h.capacitance_f).collect();
    assert!((added[0] - 3801.0).abs() < 0.5 && (added[1] - 4115.0).abs() < 0.5, "{added:?}");
    let hz = |stiffness: f64| (stiffness / plant.mass_kg).sqrt() / TAU;
    assert!((hz(plant.stiffness_n_per_m + added.iter().sum::<f64>()) - 900.6).abs() < 0.05);
    assert!((hz(plant.stiffness_n_per_m) - 783.3).abs() < 0.05);
}

#[test]
fn the_engine_rings_at_900_hz_inside_and_783_hz_without_hysterons() {
    // The engine's own motion: undamped and small, it turns every half period.
    for (hysterons, hz) in [(thesis().hysterons, 900.6), (Vec::new(), 783.3)] {
        let plant = Phs { damping_n_s_per_m: 0.0, hysterons, ..thesis() };
        let dt_s = 1e-6;
        let record_m = displacement_m(&plant, dt_s, &vec![1.0; 200_000]);
        let turns: Vec<usize> = (1..record_m.len() - 1)
            .filter(|&k| record_m[k] >= record_m[k - 1] && record_m[k] > record_m[k + 1])
            .collect();
        let periods = (turns.len() - 1) as f64;
        let measured_hz = periods / ((turns[turns.len() - 1] - turns[0]) as f64 * dt_s);
        // The printed digit, and a sample of doubt about each of two turns.
        assert!((measured_hz - hz).abs() < 0.05 + hz * 2.0 * dt_s * hz / periods, "{measured_hz} against {hz}");
    }
}

#[test]
fn symmetries_of_the_displacement_are_exact() {
    let plant = thesis();
    let dt_s = 1e-4;
    let drive_v = lively_drive_v(3000, dt_s);
    let reference_m = displacement_m(&plant, dt_s, &drive_v);
    let full_scale_m = reference_m.iter().fold(0.0f64, |a, q| a.max(q.abs()));
    let scaled = |f: f64, c: f64, beta: f64, d: f64| -> Vec<Hysteron> {
        plant
            .hysterons
            .iter()
            .map(|h| Hysteron {
                capacitance_f: h.capacitance_f * c,
                slope_s: h.slope_s * beta,
                dead_zone_v: h.dead_zone_v * d,
            })
            .map(|h| Hysteron { dead_zone_v: h.dead_zone_v * f, ..h })
            .collect()
    };
    let g = 1.1;
    // A sensor that reads g times too much looks like another transduction, if the charges' scale follows; a drive with gain g the
    // same with narrower dead zones; a payload scales everything but the mass.
    let sensor = Phs {
        transduction_c_per_m: plant.transduction_c_per_m * g,
        hysterons: scaled(1.0, g * g, g * g, 1.0),
        ..plant.clone()
    };
    let drive = Phs { hysterons: scaled(1.0, g * g, g * g, 1.0 / g), ..sensor.clone() };
    let payload = Phs { mass_kg: plant.mass_kg * g, ..plant.clone() };
    let absorbed = Phs {
        damping_n_s_per_m: plant.damping_n_s_per_m / g,
        stiffness_n_per_m: plant.stiffness_n_per_m / g,
        transduction_c_per_m: plant.transduction_c_per_m / g,
        hysterons: scaled(1.0, 1.0 / g, 1.0 / g, 1.0),
        ..plant.clone()
    };
    let louder: Vec<f64> = drive_v.iter().map(|v| v * g).collect();
    for (name, one_m, other_m) in [
        ("sensor", reference_m.iter().map(|q| q * g).collect(), displacement_m(&sensor, dt_s, &drive_v)),
        ("drive", displacement_m(&plant, dt_s, &louder), displacement_m(&drive, dt_s, &drive_v)),
        ("payload", displacement_m(&payload, dt_s, &drive_v), displacement_m(&absorbed, dt_s, &drive_v)),
    ] {
        let one_m: Vec<f64> = one_m;
        let apart_m = one_m.iter().zip(&other_m).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Rounding: 3000 samples of 1e-16 each would be 3e-13 at the worst.
        assert!(apart_m < 3e-13 * full_scale_m, "{name}: {apart_m:e} m");
    }
    let unmoved_m = displacement_m(&payload, dt_s, &drive_v);
    assert!((unmoved_m[2000] - reference_m[2000]).abs() > 1e-8, "a payload alone is seen");
}

#[test]
fn linearised_poles() {
    // x' of the plant with the dead zones dropped (d = 0), in units that make the entries comparable: um, mm/s, V.
    let mut plant = thesis();
    for hysteron in &mut plant.hysterons {
        hysteron.dead_zone_v = 0.0;
    }
    let units = [1e-6, 1e-3, 1.0, 1.0];
    let mut a = DMatrix::zeros(4, 4);
    for j in 0..4 {
        let mut x = [0.0; 4];
        x[j] = units[j];
        let state = PhsState { displacement_m: x[0], velocity_m_per_s: x[1], hysteron_v: vec![x[2], x[3]] };
        for (i, rate) in pack(&plant.derivative(&state, 0.0, 0.0)).into_iter().enumerate() {
            a[(i, j)] = rate / units[i];
        }
    }
    let mut poles: Vec<(f64, f64)> = a.complex_eigenvalues().iter().map(|p| (p.re, p.im.abs())).collect();
    poles.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Half a unit of the last printed digit.
    let expected = [(-1.0637e6, 0.0, 50.0), (-1858.6, 4993.4, 0.05), (-1858.6, 4993.4, 0.05), (-188.7, 0.0, 0.05)];
    for ((re, im), (re_printed, im_printed, tolerance)) in poles.into_iter().zip(expected) {
        assert!((re - re_printed).abs() <= tolerance && (im - im_printed).abs() <= tolerance, "{re} {im}");
    }
}

#[test]
fn doubling_beta1_moves_the_displacement_by_less_than_noise() {
    // From rest, three periods of a sine at 10 kHz, largest difference of the displacements. Slow and large to fast and just opening:
    // 0.067 nm at 80 V and 1 Hz, 1.8 nm at 64 V and 150 Hz. (A step of 64 V, which no smooth drive is, shows 7 nm for a moment.)
    let plant = thesis();
    let mut doubled = plant.clone();
    doubled.hysterons[0].slope_s *= 2.0;
    let dt_s = 1e-4;
    for (amplitude_v, hz) in [(80.0, 1.0), (90.0, 1.0), (80.0, 10.0), (64.0, 50.0), (64.0, 100.0), (64.0, 150.0)] {
        let samples = (3.0 / hz / dt_s) as usize;
        let drive_v: Vec<f64> = (0..samples).map(|k| amplitude_v * (TAU * hz * k as f64 * dt_s).sin()).collect();
        let (one_m, other_m) = (displacement_m(&plant, dt_s, &drive_v), displacement_m(&doubled, dt_s, &drive_v));
        let moved_nm = one_m.iter().zip(&other_m).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) * 1e9;
        assert!((0.06..2.4).contains(&moved_nm), "{amplitude_v} V, {hz} Hz: {moved_nm} nm");
    }
    // And 60 V at 100 Hz never opens it: then beta1 has no effect at all.
    let drive_v: Vec<f64> = (0..3000).map(|k| 60.0 * (TAU * 100.0 * f64::from(k) * dt_s).sin()).collect();
    assert_eq!(displacement_m(&plant, dt_s, &drive_v), displacement_m(&doubled, dt_s, &drive_v));
}
