//! The short way that most samples of most plants take, beside the one that every plant may take: the same numbers.

use crate::chain::{SAMPLE_S, chain, log};
use plant_sim::chain::{Chain, Drive, Heat, Held, Relaxation, Sensor, Simulator, Warming};
use plant_sim::log::Hold;
use plant_sim::replay::{Start, predict};

const ROWS: usize = 2000;

/// Steps of all sizes, rests and turns.
fn command_v(row: usize) -> f64 {
    let wave = 30.0 * (0.11 * row as f64).sin();
    if row / 200 % 3 == 1 { 25.0 * (row / 40 % 3) as f64 - 25.0 } else { wave }
}

/// A gain that never warms is exactly one.
#[test]
fn a_plant_without_parts_moves_as_one_whose_gain_does_not_warm() {
    let bare = chain();
    let warming = Warming { coefficient: 0.0, time_constant_s: 1.0, heat: Heat::Time };
    let warm = Chain { drive: Drive { warmings: vec![warming], ..Drive::IDEAL }, ..bare.clone() };
    for samples in [0.0, 0.25, 1.0, 2.5] {
        for slope in [0.0, 1.0] {
            let [mut one, mut other] = [&bare, &warm].map(|chain| {
                let mut simulator = Simulator::new(chain, SAMPLE_S, samples * SAMPLE_S);
                simulator.start_from(&chain.plant.relaxed(), 7.0);
                simulator
            });
            for row in 0..ROWS {
                let slope_v_per_s = slope * (command_v(row + 1) - command_v(row)) / SAMPLE_S;
                let held = Held { start_v: command_v(row), slope_v_per_s };
                let force_n = 0.2 * (0.03 * row as f64).cos();
                one.advance(held, force_n);
                other.advance(held, force_n);
                let seen = |simulator: &Simulator| (simulator.state(), simulator.drive_v(), simulator.reading_m());
                assert_eq!(seen(&one), seen(&other), "latency of {samples} samples, row {row}");
            }
        }
    }
}

/// An element that takes no part still sends what is seen through everything that stands between structure and sensor.
#[test]
fn what_is_seen_at_once_is_what_passes_through_parts_that_do_nothing() {
    let bare = chain();
    let mut long = bare.clone();
    long.parts.creep.push(Relaxation::even(0.0, 0.1));
    let sensor = Sensor { gain: 1.1, offset_m: 2e-7, ..Sensor::IDEAL };
    let read = |chain: &Chain| {
        let chain = Chain { sensor: sensor.clone(), ..chain.clone() };
        let log = log((0..ROWS).map(command_v).collect(), Hold::Zoh, 0.3 * SAMPLE_S);
        predict(&chain, &log, &Start::relaxed(&chain), ROWS)
    };
    for (row, (at_once_m, through_m)) in read(&bare).into_iter().zip(read(&long)).enumerate() {
        assert!((at_once_m - through_m).abs() < 1e-18, "row {row}: {at_once_m:e} {through_m:e}");
    }
}
