//! Errors against Runge-Kutta. Each line of a table holds the bound in nm, twice what was measured and rounded up; the lower half of the
//! check (a hundredth of it, for what is not exact) says that the rival is a rival and the part is there.

use super::rival::{
    SAMPLE_S, bender, chain, distance, held, lively, log, ours, rival, slow_sine, with_drive, with_force,
};
use plant_sim::bouc_wen::BoucWen;
use plant_sim::chain::{
    Bend, BendLaw, Chain, Drift, Drive, Force, Heat, Joint, Lag, Line, Mode, Parts, Sensor, Shake, Warming,
};
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

/// Runge-Kutta steps of 0.1 us.
const STEPS: usize = 500;
/// What a bound of exact parts is, in nm: the rival's own error at corners.
const EXACT_NM: f64 = 1e-3;

fn check(table: Vec<(&str, Chain, f64)>, command_v: &[f64]) {
    let mut failed = Vec::new();
    for (name, chain, bound_nm) in table {
        let error_nm = 1e9 * distance(&ours(&chain, command_v), &rival(&chain, command_v, STEPS));
        println!("{name}: {error_nm:.4} nm");
        let least_nm = if bound_nm <= EXACT_NM { 0.0 } else { 1e-2 * bound_nm };
        if !(least_nm..=bound_nm).contains(&error_nm) {
            failed.push(format!("{name}: {error_nm:.4} nm against {bound_nm} nm"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

fn with_bend(hysteron: usize, law: BendLaw) -> Chain {
    Chain { parts: Parts { bends: vec![Bend { hysteron: Some(hysteron), law }], ..Parts::default() }, ..chain() }
}

fn with_mode(joint: Joint, hz: f64, forces: Vec<Force>) -> Chain {
    Chain {
        parts: Parts { modes: vec![Mode { joint, hz, damping_ratio: 0.02 }], forces, ..Parts::default() },
        ..chain()
    }
}

fn forces() -> Vec<(&'static str, Force, [f64; 2])> {
    let stop = |at_m, stiffness_n_per_m| Force::Stop { at_m, stiffness_n_per_m, damping_s_per_m: 0.0 };
    let power = |exponent| Force::Power { force_n: 0.1, reference_m_per_s: 0.1, exponent };
    vec![
        ("cubic spring", Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 3e11 }, [0.2, EXACT_NM]),
        ("quadratic spring", Force::Spring { quadratic_n_per_m2: 2e7, cubic_n_per_m3: 0.0 }, [0.6, 0.005]),
        ("fourth power", Force::Fourth { fourth_n_per_m4: 1e15 }, [0.8, 0.005]),
        ("fifth power", Force::Fifth { fifth_n_per_m5: 3e19 }, [0.2, EXACT_NM]),
        ("one-sided", Force::OneSided { stiffness_n_per_m: 3000.0 }, [0.9, 0.015]),
        ("one-sided, softer", Force::OneSided { stiffness_n_per_m: -3000.0 }, [0.9, 0.015]),
        ("gradual", Force::Gradual { stiffness_n_per_m: 3000.0, at_m: 10e-6, width_m: 15e-6 }, [0.9, 0.015]),
        ("pad, round", Force::Pad { at_m: 70e-6, stiffness_n_per_m: 1e5, exponent: 1.5 }, [0.25, EXACT_NM]),
        ("pad, harder", Force::Pad { at_m: -60e-6, stiffness_n_per_m: 2e3, exponent: 2.5 }, [0.25, EXACT_NM]),
        ("presliding 2 um", Force::Presliding { coulomb_n: 0.1, presliding_m: 2e-6 }, [0.1, 0.005]),
        ("presliding 0.3 um", Force::Presliding { coulomb_n: 0.1, presliding_m: 3e-7 }, [0.03, 0.003]),
        ("slider 2 um", Force::Slider { coulomb_n: 0.1, slip_m: 2e-6 }, [7.0, 0.1]),
        ("on a part", Force::Patch { coulomb_n: 0.1, slip_m: 2e-6, at_m: 5e-6, half_width_m: 3e-5 }, [7.0, 0.1]),
        ("detent", Force::Detent { period_m: 7e-5, sin_n: 0.05, cos_n: 0.02 }, [0.4, 0.015]),
        ("tanh 1 mm/s", Force::Smooth { coulomb_n: 0.1, speed_m_per_s: 1e-3 }, [0.8, 0.1]),
        ("tanh 10 mm/s", Force::Smooth { coulomb_n: 0.1, speed_m_per_s: 1e-2 }, [0.3, 0.02]),
        ("power 0.3", power(0.3), [0.2, 0.01]),
        ("power 1", power(1.0), [0.4, 0.01]),
        ("power 2", power(2.0), [1.0, EXACT_NM]),
        ("stop above, 20 k", stop(70e-6, 5e5), [0.15, EXACT_NM]),
        ("stop below, 20 k", stop(-70e-6, 5e5), [0.15, 0.002]),
        ("stop above, k", stop(70e-6, 25e3), [0.25, 0.005]),
        ("damped", Force::Stop { at_m: 70e-6, stiffness_n_per_m: 1e5, damping_s_per_m: 20.0 }, [0.25, EXACT_NM]),
    ]
}

#[test]
fn forces_in_steps_and_a_fast_sine() {
    check(forces().into_iter().map(|(name, force, bounds)| (name, with_force(force), bounds[0])).collect(), &lively());
}

#[test]
fn forces_in_a_slow_sine() {
    let table = forces().into_iter().map(|(name, force, bounds)| (name, with_force(force), bounds[1])).collect();
    check(table, &slow_sine(10.0));
}

/// What is left of an effect by laws followed coarsely, as a search does, in nm rms: three times what was measured.
const COARSE_NM: f64 = 1.0;

/// Laws as a search follows them, against the same laws followed finely.
#[test]
fn coarse_laws_stay_near_fine_ones() {
    let presliding = |presliding_m| Force::Presliding { coulomb_n: 0.1, presliding_m };
    let hard = [("presliding 30 nm", presliding(3e-8)), ("presliding 1 nm", presliding(1e-9))];
    let all = forces().into_iter().map(|(name, force, _)| (name, force)).chain(hard);
    let mut failed = Vec::new();
    for (name, force) in all {
        let fine = with_force(force);
        let coarse = Chain { parts: Parts { is_coarse: true, ..fine.parts.clone() }, ..fine.clone() };
        // Steps, a sine, and a rest on which friction sticks.
        let command_v: Vec<f64> = lively().into_iter().chain(slow_sine(10.0)).chain([20.0; 2000]).collect();
        let fine_m = ours(&fine, &command_v);
        let effect_m = distance(&fine_m, &ours(&chain(), &command_v));
        let rms =
            |a: &[f64], b: &[f64]| (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt();
        let error_m = rms(&ours(&coarse, &command_v), &fine_m);
        println!("{name}: {:.3} nm, effect {:.0} nm", 1e9 * error_m, 1e9 * effect_m);
        if 1e9 * error_m > COARSE_NM || effect_m < 1e-6 {
            failed.push(format!("{name}: {:.3} nm", 1e9 * error_m));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// Most that such a law may be off on rows that are far apart, as a search thins them, in nm; twice what was measured.
const THINNED_NM: f64 = 9.0;

/// A power law is steepest where the mass rests. However it sets off, by a step or ever faster from nothing, it doesn't hang there.
#[test]
fn coarse_friction_lets_go_on_rows_far_apart() {
    let rows = |k: u32| match k {
        0..20 => 0.0,
        20..150 => 14.0,
        150..1500 => 60.0 * (1.0 - (TAU * 45.0 * f64::from(k - 150) * 4.0 * SAMPLE_S).cos()),
        _ => 14.0,
    };
    let mut log = log((0..3000).map(rows).collect(), 0.0);
    log.dt_s = 4.0 * SAMPLE_S;
    let mut failed = Vec::new();
    for exponent in [0.2, 0.3, 0.5, 0.8, 1.5] {
        let fine = with_force(Force::Power { force_n: 0.05, reference_m_per_s: 0.05, exponent });
        let coarse = Chain { parts: Parts { is_coarse: true, ..fine.parts.clone() }, ..fine.clone() };
        let [fine_m, coarse_m] =
            [&fine, &coarse].map(|chain| predict(chain, &log, &Start::relaxed(chain), log.command_v.len()));
        let error_nm = 1e9 * distance(&coarse_m, &fine_m);
        println!("power {exponent}: {error_nm:.2} nm");
        if !(1e-3..THINNED_NM).contains(&error_nm) {
            failed.push(format!("power {exponent}: {error_nm:.2} nm"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn bends() {
    let widening = |share| BendLaw::Widening { share, reference_v_per_s: 1e4 };
    let table = vec![
        ("capacitance skew, fast", with_bend(0, BendLaw::CapacitanceSkew(0.2)), 0.9),
        ("capacitance skew, slow", with_bend(1, BendLaw::CapacitanceSkew(0.2)), 0.5),
        ("slope skew, fast", with_bend(0, BendLaw::SlopeSkew(0.3)), 0.9),
        ("slope skew, slow", with_bend(1, BendLaw::SlopeSkew(0.3)), 0.05),
        ("exponent 0.8, fast", with_bend(0, BendLaw::Exponent(0.8)), 6.0),
        ("exponent 1.3, fast", with_bend(0, BendLaw::Exponent(1.3)), 0.7),
        ("exponent 2, fast", with_bend(0, BendLaw::Exponent(2.0)), 0.6),
        ("exponent 0.5, slow", with_bend(1, BendLaw::Exponent(0.5)), 0.1),
        ("exponent 2, slow", with_bend(1, BendLaw::Exponent(2.0)), 0.1),
        // It damps as much as half the plant's own damper, and with 0.5 by 2.4 times as much.
        ("widening 0.1, fast", with_bend(0, widening(0.1)), 1.5),
        ("widening 0.5, fast", with_bend(0, widening(0.5)), 9.0),
        ("widening 0.5, slow", with_bend(1, widening(0.5)), 0.05),
    ];
    check(table, &lively());
}

/// Rows of a tenth of a second have room for ninety periods of the plant. What laws do meanwhile is as on rows close together, where
/// Runge-Kutta has been.
#[test]
fn rows_far_apart_are_followed_all_the_way() {
    const ROWS_WITHIN: usize = 2000;
    let hardening = Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 0.02 * 24579.0 / 1e-8 };
    let table = [
        ("hardening spring", with_force(hardening), [0.13, 0.13]),
        ("capacitance skew of the first", with_bend(0, BendLaw::CapacitanceSkew(0.05)), [2.0, 20.0]),
        ("stop, k", with_force(Force::Stop { at_m: 70e-6, stiffness_n_per_m: 25e3, damping_s_per_m: 0.0 }), [2.0, 2.0]),
        ("widening 0.5", with_bend(0, BendLaw::Widening { share: 0.5, reference_v_per_s: 1e4 }), [10.0, 10.0]),
    ];
    let command_v = [0.0, 60.0, 60.0, -30.0, -60.0, 45.0, 0.0];
    let close_v: Vec<f64> = command_v.iter().flat_map(|v| [*v; ROWS_WITHIN]).collect();
    let mut failed = Vec::new();
    for (name, fine, bounds_nm) in table {
        let close_m: Vec<f64> = ours(&fine, &close_v).into_iter().step_by(ROWS_WITHIN).collect();
        let coarse = Chain { parts: Parts { is_coarse: true, ..fine.parts.clone() }, ..fine.clone() };
        for (chain, bound_nm) in [&fine, &coarse].into_iter().zip(bounds_nm) {
            let mut slow = log(command_v.to_vec(), 0.0);
            slow.dt_s = ROWS_WITHIN as f64 * SAMPLE_S;
            let slow_m = predict(chain, &slow, &Start::relaxed(chain), slow.command_v.len());
            let error_nm = 1e9 * distance(&slow_m, &close_m);
            println!("{name}: {error_nm:.4} nm");
            if !(1e-2 * bound_nm..=bound_nm).contains(&error_nm) {
                failed.push(format!("{name}: {error_nm:.4} nm against {bound_nm} nm"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// A search may lead a plant to where it is no number any more; that costs the run and not the program.
#[test]
fn what_runs_away_ends_in_no_number() {
    let softening = Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: -0.5 * 24579.0 / 1e-8 };
    let oscillator = Force::BoucWen(BoucWen { amplitude: 5e3, beta: 20.0, gamma: 10.0, exponent: 1.0 });
    for laws in [vec![softening], vec![softening, oscillator]] {
        let bends = vec![Bend { hysteron: None, law: BendLaw::CapacitanceSkew(0.05) }];
        for is_coarse in [false, true] {
            let parts = Parts { forces: laws.clone(), bends: bends.clone(), is_coarse, ..Parts::default() };
            let chain = Chain { parts, ..chain() };
            let log = log([0.0; 10].into_iter().chain([60.0; 300]).collect(), 0.0);
            let away_m = predict(&chain, &log, &Start::relaxed(&chain), log.command_v.len());
            let last_m = away_m[away_m.len() - 1];
            assert!(last_m.is_nan() || last_m.abs() > 1.0, "{laws:?}: {last_m:e}");
        }
    }
}

#[test]
fn drives() {
    let ideal = Drive::IDEAL;
    let first = |time_constant_s| Some(Lag::First { time_constant_s });
    let second = |natural_rad_per_s, damping_ratio| Some(Lag::Second { natural_rad_per_s, damping_ratio });
    let warm = |heat| vec![Warming { coefficient: 0.05, time_constant_s: 0.02, heat }];
    let table = vec![
        ("lag 20 us", with_drive(Drive { lag: first(20e-6), ..ideal.clone() }), 0.06),
        ("lag 100 us", with_drive(Drive { lag: first(100e-6), ..ideal.clone() }), 0.003),
        ("lag 100 us, late", with_drive(Drive { delay_s: 18.5e-6, lag: first(100e-6), ..ideal.clone() }), 0.04),
        ("lag 5 us, late", with_drive(Drive { delay_s: 18.5e-6, lag: first(5e-6), ..ideal.clone() }), 0.5),
        ("lag 1 ms", with_drive(Drive { lag: first(1e-3), ..ideal.clone() }), EXACT_NM),
        ("second order 1 kHz", with_drive(Drive { lag: second(6283.0, 0.5), ..ideal.clone() }), 0.002),
        (
            "second order, damping 1, 2.5 samples late",
            with_drive(Drive { delay_s: 125e-6, lag: second(31416.0, 1.0), ..ideal.clone() }),
            0.05,
        ),
        ("second order, damping 0.2", with_drive(Drive { lag: second(31416.0, 0.2), ..ideal.clone() }), 0.04),
        ("slew 0.05 V/us", with_drive(Drive { slew_v_per_s: 5e4, slew_down_v_per_s: 5e4, ..ideal.clone() }), 0.02),
        ("slew 0.5 V/us", with_drive(Drive { slew_v_per_s: 5e5, slew_down_v_per_s: 5e5, ..ideal.clone() }), 0.08),
        (
            "slew 3 V/us, late",
            with_drive(Drive { delay_s: 25e-6, slew_v_per_s: 3e6, slew_down_v_per_s: 3e6, ..ideal.clone() }),
            0.3,
        ),
        (
            "slew 0.05 V/us up, 0.02 down",
            with_drive(Drive { slew_v_per_s: 5e4, slew_down_v_per_s: 2e4, ..ideal.clone() }),
            0.02,
        ),
        (
            "slew and lag",
            with_drive(Drive { slew_v_per_s: 1e5, slew_down_v_per_s: 1e5, lag: first(100e-6), ..ideal.clone() }),
            0.008,
        ),
        ("knee", with_drive(Drive { range_v: [-50.0, 45.0], knee_v: 3.0, ..ideal.clone() }), EXACT_NM),
        ("gain, curvature", with_drive(Drive { gain: 1.1, curvature_per_v: 1e-3, ..ideal.clone() }), EXACT_NM),
        ("warms by itself", with_drive(Drive { warmings: warm(Heat::Time), ..ideal.clone() }), 0.4),
        ("warms by drive", with_drive(Drive { warmings: warm(Heat::Drive { volts: 60.0 }), ..ideal }), 1.7),
    ];
    check(table, &lively());
}

#[test]
fn shakes() {
    let shaken = |hz, delay_s, modes: Vec<Mode>, forces| Chain {
        parts: Parts { shakes: vec![Shake { hz, cos_n: 0.02, sin_n: 0.01 }], modes, forces, ..Parts::default() },
        ..with_drive(Drive { delay_s, ..Drive::IDEAL })
    };
    let joint = Joint::Parallel { compliance_m_per_n: 1e-6 };
    let parallel = || vec![Mode { joint, hz: 2000.0, damping_ratio: 0.02 }];
    let cubic = || vec![Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 3e11 }];
    let table = vec![
        ("300 Hz", shaken(300.0, 0.0, vec![], vec![]), EXACT_NM),
        ("1500 Hz", shaken(1500.0, 0.0, vec![], vec![]), EXACT_NM),
        ("300 Hz, late by a fraction", shaken(300.0, 2e-5, vec![], vec![]), EXACT_NM),
        ("300 Hz, mode beside", shaken(300.0, 0.0, parallel(), vec![]), EXACT_NM),
        ("300 Hz, cubic spring", shaken(300.0, 0.0, vec![], cubic()), 0.2),
    ];
    check(table, &lively());
    let slow = [300.0, 1500.0].map(|hz| ("beside a slow sine", shaken(hz, 0.0, vec![], vec![]), EXACT_NM));
    check(slow.into(), &slow_sine(10.0));
}

#[test]
fn modes_and_sensors() {
    let (attached, parallel) = (Joint::Attached { mass_kg: 5e-5 }, Joint::Parallel { compliance_m_per_n: 1e-6 });
    let cubic = || vec![Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 3e11 }];
    let lag = |lag, delay_s| Chain {
        sensor: Sensor { lag: Some(lag), ..Sensor::IDEAL },
        ..with_drive(Drive { delay_s, ..Drive::IDEAL })
    };
    let bent = Sensor {
        gain: 0.97,
        quadratic_per_m: 100.0,
        cubic_per_m2: 1e6,
        offset_m: 2e-6,
        drifts: vec![Drift { amplitude_m: 1e-6, time_constant_s: 0.03 }],
        lines: vec![Line { hz: 50.0, cos_m: 1e-7, sin_m: 2e-7 }],
        ..Sensor::IDEAL
    };
    let table = vec![
        ("attached", with_mode(attached, 2000.0, Vec::new()), EXACT_NM),
        ("parallel", with_mode(parallel, 3000.0, Vec::new()), EXACT_NM),
        ("attached, cubic", with_mode(attached, 2000.0, cubic()), 0.2),
        ("parallel, cubic", with_mode(parallel, 3000.0, cubic()), 0.2),
        ("sensor 200 us", lag(Lag::First { time_constant_s: 2e-4 }, 0.0), EXACT_NM),
        ("sensor 200 us, late", lag(Lag::First { time_constant_s: 2e-4 }, 18.5e-6), EXACT_NM),
        ("sensor 5 kHz", lag(Lag::Second { natural_rad_per_s: 31416.0, damping_ratio: 0.4 }, 0.0), EXACT_NM),
        ("bent sensor", Chain { sensor: bent, ..chain() }, EXACT_NM),
    ];
    check(table, &lively());
}

#[test]
fn play_and_what_lags_behind_it() {
    let play = |lag| Chain { sensor: Sensor { play_m: 2e-6, lag, ..Sensor::IDEAL }, ..chain() };
    let first = |time_constant_s| play(Some(Lag::First { time_constant_s }));
    let second = Some(Lag::Second { natural_rad_per_s: 31416.0, damping_ratio: 0.4 });
    let table = |bounds_nm: [f64; 5]| {
        let all = [
            ("play", play(None)),
            ("play, lag 8 us", first(8e-6)),
            ("play, lag 50 us", first(50e-6)),
            ("play, lag 500 us", first(5e-4)),
            ("play, second order 5 kHz", play(second)),
        ];
        all.into_iter().zip(bounds_nm).map(|((name, chain), bound_nm)| (name, chain, bound_nm)).collect()
    };
    check(table([0.4, 1.5, 2.5, 0.7, 2.7]), &lively());
    check(table([EXACT_NM, 0.009, 0.016, 0.011, 0.017]), &slow_sine(10.0));
}

#[test]
fn nothing_creeps_at_rest() {
    // The slow hysteron's leak ends within 0.1 s (22 of its time constants); smooth friction is left out: by its law it creeps.
    let power = Force::Power { force_n: 0.05, reference_m_per_s: 0.1, exponent: 2.0 };
    for force in [
        Force::Presliding { coulomb_n: 0.05, presliding_m: 1e-6 },
        Force::Spring { quadratic_n_per_m2: 1e7, cubic_n_per_m3: 1e11 },
        Force::Stop { at_m: 50e-6, stiffness_n_per_m: 5e5, damping_s_per_m: 0.0 },
        power,
    ] {
        for fast in [false, true] {
            let chain = Chain { plant: bender(fast), ..with_force(force) };
            let path_m = ours(&chain, &held(5.0));
            let rest_m = path_m[10_000];
            let crept_m = path_m[10_000..].iter().fold(0.0f64, |most, q| most.max((q - rest_m).abs()));
            assert!(crept_m < 1e-10, "{force:?}, {fast}: {crept_m:e}");
        }
    }
}
