//! How a log may begin: a drive held before it, oscillators that swing, and what friction and play remember.

use crate::chain::{ROWS, SAMPLE_S, chain, distance, log};
use plant_sim::chain::{Arm, Chain, Force, Held, Joint, Mode, Parts, Sensor, Simulator};
use plant_sim::log::Hold;
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

#[test]
fn a_start_holds_its_drive_until_the_first_command_arrives() {
    let chain = chain();
    let start = Start::at_rest(&chain, 25.0, vec![3.0]);
    let mut simulator = Simulator::new(&chain, SAMPLE_S, 2.5 * SAMPLE_S);
    simulator.start_from(&start.state, start.drive_v);
    let rest_m = simulator.reading_m();
    for row in 0..10 {
        let moved_m = (simulator.reading_m() - rest_m).abs();
        // Rows 0, 1 and 2 are sampled before 2.5 samples have passed. 20 samples of rounding at 1e-16 of 50 um each.
        assert_eq!(row >= 3, moved_m > 1e-18 * 50.0, "row {row}: {moved_m:e}");
        simulator.advance(Held::zero_order(-25.0), 0.0);
    }
}

#[test]
fn oscillators_that_swing_at_the_start_go_on_swinging() {
    let (hz, damping_ratio) = (300.0, 0.01);
    let with = |joint: Joint, forces: Vec<Force>| Chain {
        parts: Parts { modes: vec![Mode { joint, hz, damping_ratio }], forces, ..Parts::default() },
        ..chain()
    };
    // A log cut out of a longer one begins where that one was, its oscillator as well.
    let swinging = with(Joint::Attached { mass_kg: 1e-4 }, Vec::new());
    let command_v: Vec<f64> = (0..2 * ROWS).map(|k| if k < ROWS { 40.0 } else { -10.0 }).collect();
    let whole = predict(&swinging, &log(command_v.clone(), Hold::Zoh, 0.0), &Start::relaxed(&swinging), 2 * ROWS);
    let mut simulator = Simulator::new(&swinging, SAMPLE_S, 0.0);
    command_v[..ROWS].iter().for_each(|v| simulator.advance(Held::zero_order(*v), 0.0));
    let there = simulator.snapshot();
    let [x_m, v_m_per_s] = there.attached[0];
    let at_rest = Start { state: there.plant.clone(), drive_v: 40.0, ..Start::relaxed(&swinging) };
    let moving = Start { modes: vec![[x_m - there.plant.displacement_m, v_m_per_s]], ..at_rest.clone() };
    let cut = |start: &Start| predict(&swinging, &log(command_v[ROWS..].to_vec(), Hold::Zoh, 0.0), start, ROWS);
    assert!(distance(&cut(&moving), &whole[ROWS..]) < 1e-15 && distance(&cut(&at_rest), &whole[ROWS..]) > 1e-8);

    // So does an arm that carries the target, which pulls at nothing: it swings as it would at rest.
    let carried = Chain {
        parts: Parts { arms: vec![Arm { share: 0.5, rate_share: 0.0, hz, damping_ratio }], ..Parts::default() },
        ..chain()
    };
    let start = Start { modes: vec![[2e-6, 0.0]], ..Start::relaxed(&carried) };
    let arm = predict(&carried, &log(vec![0.0; ROWS], Hold::Zoh, 0.0), &start, ROWS);

    // Beside the plant: the sensor sees it turn, in the engine and where laws keep it out of the engine.
    let compliance_m_per_n = 1e-6;
    for forces in [Vec::new(), vec![Force::Presliding { coulomb_n: 0.1, presliding_m: 2e-6 }]] {
        let beside = with(Joint::Parallel { compliance_m_per_n }, forces);
        let start = Start { modes: vec![[1e-6, 0.0]], ..Start::relaxed(&beside) };
        let seen = predict(&beside, &log(vec![0.0; ROWS], Hold::Zoh, 0.0), &start, ROWS);
        let turning_per_s = TAU * hz;
        let damped_per_s = turning_per_s * (1.0 - damping_ratio * damping_ratio).sqrt();
        let expected = |row: usize| {
            let t = row as f64 * SAMPLE_S;
            let wave =
                (damped_per_s * t).cos() + damping_ratio * turning_per_s / damped_per_s * (damped_per_s * t).sin();
            1e-6 * (-damping_ratio * turning_per_s * t).exp() * wave
        };
        let expected: Vec<f64> = (0..ROWS).map(expected).collect();
        assert!(distance(&arm, &expected) < 1e-15, "{:e}", distance(&arm, &expected));
        assert!(distance(&seen, &expected) < 1e-15, "{:e}", distance(&seen, &expected));
    }
}

#[test]
fn what_friction_and_play_remember_is_there_at_the_start() {
    let (coulomb_n, presliding_m) = (0.1, 2e-6);
    let rubbed = Chain {
        parts: Parts { forces: vec![Force::Presliding { coulomb_n, presliding_m }], ..Parts::default() },
        ..chain()
    };
    let rest = Start::at_rest(&rubbed, 25.0, vec![3.0]);
    let held = rest.clone().remembering(&rubbed, 0.5);
    // Friction keeps half of its force from the spring, and nothing moves.
    let shift_m = held.state.displacement_m - rest.state.displacement_m;
    assert!((shift_m / (-0.5 * coulomb_n / 24579.0) - 1.0).abs() < 1e-9, "{shift_m:e}");
    let still = predict(&rubbed, &log(vec![25.0; ROWS], Hold::Zoh, 0.0), &held, ROWS);
    let moved_m = still.iter().map(|y| (y - still[0]).abs()).fold(0.0, f64::max);
    assert!(moved_m < 1e-14, "{moved_m:e}");
    // Without what it holds it would move.
    let forgetful = Start { memory: 0.0, ..held };
    assert!(distance(&predict(&rubbed, &log(vec![25.0; ROWS], Hold::Zoh, 0.0), &forgetful, ROWS), &still) > 1e-8);

    // A play that was left at its upper end lets the structure come down by its whole width before it follows, and up by nothing.
    let loose = Chain { sensor: Sensor { play_m: 2e-6, ..Sensor::IDEAL }, ..chain() };
    let start = Start::relaxed(&loose).remembering(&loose, 1.0);
    let read = |volts: f64| predict(&loose, &log(vec![volts; ROWS], Hold::Zoh, 0.0), &start, ROWS);
    assert!(read(0.0).iter().all(|y| (y - 1e-6).abs() < 1e-18));
    let small_v = 0.3;
    assert!(read(small_v).iter().all(|y| (y - 1e-6).abs() < 1e-18), "0.5 um up stay within the play");
    let last_m = |volts: f64| read(volts)[ROWS - 1];
    let plain_m = |volts: f64| {
        let start = Start::relaxed(&chain());
        predict(&chain(), &log(vec![volts; ROWS], Hold::Zoh, 0.0), &start, ROWS)[ROWS - 1]
    };
    // Down by 20 V and rung out: the play hangs above, or was dragged below by the overshoot, by half its width at the most.
    assert!((last_m(-20.0) - plain_m(-20.0)).abs() <= 1e-6 * (1.0 + 1e-9));
}

/// A mode beside the plant begins where the force is that the plant feels, which hysteresis of the voltage takes its part of.
#[test]
fn nothing_rings_at_rest_under_a_held_drive() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-bouc-wen.toml");
    let mut bender = plant_sim::model::Model::read(&file).expect("of the project").chain();
    let joint = Joint::Parallel { compliance_m_per_n: 1e-6 };
    bender.parts.modes.push(Mode { joint, hz: 700.0, damping_ratio: 0.01 });
    // In the engine, and apart from it where laws are part of its force.
    let mut apart = bender.clone();
    apart.parts.forces.push(Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 0.0 });
    for chain in [bender, apart] {
        let start = Start::at_rest(&chain, 60.0, Vec::new());
        let still = predict(&chain, &log(vec![60.0; ROWS], Hold::Zoh, 0.0), &start, ROWS);
        let rings_m = still.iter().map(|y| (y - still[0]).abs()).fold(0.0, f64::max);
        // 200 rows of rounding of 100 um; the missing newton of 1e-6 m/N would be hundreds of nanometres.
        assert!(rings_m < 1e-16, "{rings_m:e}");
    }
}
