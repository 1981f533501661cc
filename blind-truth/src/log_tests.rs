//! What a log must be whatever is planted: clocks start with its first row, its loop obeys its law, its rows and the
//! chain's parts stand in order. No test here asks what a part does to the motion.

use crate::bench::{Bench, History, Jitter, Loop, Motion, STEP_S, Session, Source, Timing, record, run_monitored};
use crate::case::{Case, Request, make};
use crate::digitise::Digitise;
use crate::drive::{Chain, Drive};
use crate::effects::{EffectId, Split, Subject};
use crate::forms::{self, Planted};
use crate::nominal::silent;
use crate::plan::Size;
use crate::record::Record;
use crate::sensor::{Follow, Measure};
use rand::SeedableRng;
use rand_pcg::Pcg64;

const RATE_HZ: f64 = 20_000.0;

fn with(timing: Timing) -> Bench {
    Bench { timing, ..silent() }
}

fn play(bench: &Bench, source: Source) -> Record {
    record(bench, &Session { source, rate_hz: RATE_HZ, rest_v: 0.0, seed: 1, monitor: false, step_s: STEP_S })
}

#[test]
fn what_is_a_function_of_time_starts_with_row_zero() {
    // Powers of two: the clocks meet row 0 without rounding.
    let (h_s, before_s) = (1.0 / 4096.0, 0.25);
    let (gain, tau_s, u) = (0.1, 0.2, 50.0);
    for drive in [
        Drive::SettlingGain { error: gain, share: 0.3, tau_s },
        Drive::FlickeringGain { error: gain, share: 0.3, mean_s: 0.05 },
        Drive::TimeWarming { gain, tau_s },
        Drive::RoomSwing { gain, period_s: 1.0, phase_rad: 0.4 },
        Drive::LateWarming { gain, tau_s },
        Drive::WarmingFrom { gain, tau_s, within_s: 0.3 },
        Drive::Ageing { per_decade: gain, t0_s: 0.1 },
    ] {
        let begin = |before_s: f64| drive.begin(h_s, before_s, &mut Pcg64::seed_from_u64(5));
        let (mut late, mut fresh) = (begin(before_s), begin(0.0));
        let history: Vec<f64> = (0..1024).map(|_| drive.step(&mut late, u, h_s)).collect();
        assert!(history.iter().all(|v| v == &history[0]), "{drive:?} moves before row 0");
        for k in 0..4096 {
            assert_eq!(drive.step(&mut late, u, h_s), drive.step(&mut fresh, u, h_s), "{drive:?}, step {k}");
        }
    }
    let mode = Follow::LooseMode { m_per_v: 1e-7, hz: 300.0, damping_ratio: 0.01, share: 0.1, tau_s };
    let (mut late, mut fresh) = (mode.begin(h_s, before_s), mode.begin(h_s, 0.0));
    (0..1024).for_each(|_| assert_eq!(mode.step(&mut late, 0.0, 0.0, h_s), 0.0));
    for k in 0..4096 {
        assert_eq!(mode.step(&mut late, 0.0, u, h_s), mode.step(&mut fresh, 0.0, u, h_s), "step {k}");
    }
}

#[test]
fn a_loop_decides_each_row_from_that_row() {
    let law = Loop { kp_v_per_m: 2.3164e4, ki_v_per_m_s: 1.8384e8, feedforward_v_per_m: 2e4, limit_v: 90.0 };
    let reference_m: Vec<f64> = (0..1_200).map(|k| if k < 600 { 30e-6 } else { -20e-6 }).collect();
    // More than a row of either delay, rows that come after their edges, and clocks that go each their own way.
    let late_rows = Jitter::RareLate { one_in: 2.0, mean_s: 2e-5 };
    for (timing, edges_keep_time) in [
        (Timing { command_delay_s: 1.3e-4, ..Timing::default() }, true),
        (Timing { measure_delay_s: 1.3e-4, ..Timing::default() }, true),
        (Timing { clock_error: -1e-3, ..Timing::default() }, true),
        (Timing { clock_error: 1e-3, ..Timing::default() }, false),
        (Timing { jitter: Some(late_rows), ..Timing::default() }, false),
    ] {
        let bench = Bench { history: History::Demagnetised { volts: 20.0, rest_s: 0.1 }, ..with(timing) };
        let log = play(&bench, Source::Closed(&reference_m, law));
        assert_eq!((log.command_v.len(), log.displacement_um.len()), (1_200, 1_200));
        let mut integral_v = 0.0;
        for (k, (reference_m, y_um)) in reference_m.iter().zip(&log.displacement_um).enumerate() {
            let error_m = reference_m - y_um * 1e-6;
            integral_v += law.ki_v_per_m_s * error_m / RATE_HZ;
            let wish_v = law.feedforward_v_per_m * reference_m + law.kp_v_per_m * error_m + integral_v;
            // Half of the log's last digit, and rounding.
            assert!((wish_v - log.command_v[k]).abs() < 0.51e-6, "{:?}: row {k}", bench.timing);
        }
        // What was decided reaches the bench at its own edge: a replay shows the same.
        if edges_keep_time {
            assert_eq!(play(&bench, Source::Open(&log.command_v)).displacement_um, log.displacement_um);
        }
    }
}

#[test]
fn rows_stay_in_order_where_a_clock_is_put_right() {
    // Three rows late when it is put right: on a ramp of 8 nm per row each row still shows a later moment.
    let ramp: Vec<f64> = (0..8_000).map(|k| 5e-3 * f64::from(k)).collect();
    let timing = Timing { clock_error: 1e-3, clock_sync_s: 0.15, ..Timing::default() };
    let y_um = play(&with(timing.clone()), Source::Open(&ramp)).displacement_um;
    let plain_um = play(&silent(), Source::Open(&ramp)).displacement_um;
    let least_um = y_um[400..].windows(2).map(|pair| pair[1] - pair[0]).fold(f64::MAX, f64::min);
    // A tenth of a row, give or take what the edges of the command leave of their steps.
    assert!((0.5e-3..1.1e-3).contains(&least_um), "{least_um} um");
    assert!((y_um[2_999] - plain_um[2_999]) > 20e-3 && (y_um[3_010] - plain_um[3_010]).abs() < 2e-3);
    // Row 0 is in step, whatever the clock did before it.
    let moved = History::JustMoved { volts: 40.0, rest_s: 1e-3 };
    let first =
        |timing: Timing| play(&Bench { history: moved, ..with(timing) }, Source::Open(&[0.0; 4])).displacement_um;
    assert_eq!(first(timing)[0], first(Timing::default())[0]);
}

#[test]
fn no_heat_takes_a_dead_zone_away() {
    let mut hot = silent();
    hot.heated = Some((-0.9, 0.05));
    let mut motion = Motion::at_rest(&hot, STEP_S);
    // A square wave of 1 kHz: twelve times the power that is the reference.
    for i in 0..50_000 {
        motion.step(&hot, if i % 1_000 < 500 { 60.0 } else { -60.0 }, 0.0, STEP_S);
    }
    (motion.q_m, motion.w_m_per_s) = (0.0, 0.0);
    motion.v = vec![0.0, 0.1];
    motion.step(&hot, 0.0, 0.0, STEP_S);
    // A twentieth of the slow half zone is 0.22 V: nothing leaks from within.
    assert!((motion.v[1] - 0.1).abs() < 1e-6, "{} V", motion.v[1]);
}

/// A form of an effect by the start of its name, its shape drawn.
fn planted(effect: EffectId, name: &str) -> Planted {
    let form = forms::all().find(|form| form.effect == effect && form.name.starts_with(name)).unwrap();
    (form.draw)(&mut Pcg64::seed_from_u64(5))
}

/// What the truth states of a form under a name.
fn stated(form: &Planted, a: f64, key: &str) -> f64 {
    form.stated(a, 1.0 / RATE_HZ).into_iter().find(|(name, _)| *name == key).unwrap().1
}

#[test]
fn the_truth_states_what_the_bench_installs() {
    let turns = planted(EffectId::TransportDelay, "of the command, by turns");
    let share = |a: f64| stated(&turns, a, "longer_and_shorter_by");
    // 0.4 of a row is 20 us.
    assert!((share(4e-4) * 4e-4 - 2e-5).abs() < 1e-12 && share(1e-5) > share(4e-4));
    // With the share that was drawn the bench does what it does with the stated one.
    let play_with = |edge_turns_s: f64| {
        let timing = Timing { command_delay_s: 4e-4, edge_turns_s, ..Timing::default() };
        let ramp: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
        play(&with(timing), Source::Open(&ramp)).displacement_um
    };
    assert_eq!(play_with(share(1e-5) * 4e-4), play_with(share(4e-4) * 4e-4));
    for name in ["Gaussian", "some rows late", "wandering"] {
        assert_eq!(stated(&planted(EffectId::SamplingJitter, name), 1e-5, "cut_at_s"), 0.45 / RATE_HZ, "{name}");
    }
}

#[test]
fn a_shelf_has_its_error_at_rest_and_less_of_it_above_the_corner() {
    let shelf = planted(EffectId::AmplifierGain, "shelf");
    let number = |key: &str| stated(&shelf, 0.1, key);
    let mut bench = silent();
    (shelf.apply)(0.1, &mut bench);
    let part = &bench.drives[0];
    let mut memory = part.begin(STEP_S, 0.0, &mut Pcg64::seed_from_u64(5));
    let at_once = part.step(&mut memory, 1.0, STEP_S) - 1.0;
    let settled = (0..200_000).map(|_| part.step(&mut memory, 1.0, STEP_S)).last().unwrap() - 1.0;
    assert!((settled - number("sign") * 0.1).abs() < 1e-9, "{settled}");
    // The corner is at 500 Hz at the most: half a step of it is 0.2 %.
    assert!((at_once / settled - (1.0 - number("loss"))).abs() < 2e-3, "{at_once} of {settled}");
}

#[test]
fn parts_stand_in_the_order_of_the_signal() {
    // No form alone is moved: what it is made of stands as it was written.
    for form in forms::all() {
        let (mut bench, planted) = (silent(), (form.draw)(&mut Pcg64::seed_from_u64(5)));
        (planted.apply)(planted.bounds.0, &mut bench);
        let written = format!("{bench:?}");
        bench.put_in_order();
        assert_eq!(format!("{bench:?}"), written, "{}", form.name);
    }
    // A label's order is not the bench's.
    let pair = |effects: [EffectId; 2]| -> Case {
        let subject = Subject::Effects(effects.to_vec());
        make(&Request { seed: 1, subject, split: Split::Develop, size: Size::Short, strength: Some(8.0) })
    };
    let drives = pair([EffectId::ThermalGain, EffectId::AmplifierSaturation]).bench.drives;
    assert!(drives.len() == 2 && drives.is_sorted_by_key(Drive::place), "{drives:?}");
    let digitises = pair([EffectId::Quantisation, EffectId::NoiseExcess]).bench.digitises;
    assert!(digitises.len() == 2 && digitises.is_sorted_by_key(Digitise::place), "{digitises:?}");
    // By hand, as a seed may draw a creep that is none of the rows.
    let mut bench = silent();
    let creep = Measure::Creep(Chain { elements: vec![(0.1, 0.2)] });
    bench.measures = vec![Measure::Smoothing { weight: 0.5, rows: 3 }, Measure::Offset(1e-6), creep.clone()];
    bench.follows = vec![Follow::Lag { tau_s: 1e-5 }, Follow::Play { half_m: 1e-7 }];
    bench.put_in_order();
    assert_eq!(bench.measures[0], creep);
    assert_eq!(bench.follows[0], Follow::Play { half_m: 1e-7 });
}

#[test]
fn the_monitor_shows_the_amplifier_and_not_the_ceramic() {
    let mut bench = silent();
    bench.drives = vec![Drive::Gain(1.1), Drive::TanhEnvelope { level_v: 120.0, shift_v: 40.0 }];
    let drive_v = run_monitored(&bench, &[30.0; 200], RATE_HZ, 1).drive_v.unwrap();
    assert!((drive_v[199] - 33.0).abs() < 1e-9, "{} V", drive_v[199]);
}
