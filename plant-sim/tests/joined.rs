//! What effects make of a chain that has the same part already: each on top of what is there, and nothing of it where it is zero.

use crate::effects::readings_m;
use plant_sim::chain::{Chain, Drive, Growth, Lag, Parts, Sensor, SensorState};
use plant_sim::effects::{self, Form, Kind, Parameter, REGISTRY, Role, Scales, sane};
use plant_sim::log::{Hold, Log};
use plant_sim::model::Model;
use plant_sim::param::Param;
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;
use std::path::Path;

const SAMPLE_S: f64 = 1e-4;

fn model(name: &str) -> Model {
    Model::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(name)).expect("of the project")
}

fn form(id: &str, name: &str) -> &'static Form {
    let effect = effects::find(id).expect("in the registry");
    effect.forms().iter().find(|form| form.name == name).expect("a form")
}

fn with(chain: &Chain, form: &Form, values: &[f64]) -> Chain {
    let mut chain = chain.clone();
    (form.install)(&mut chain, values);
    chain
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |most, (a, b)| f64::max(most, (a - b).abs()))
}

#[test]
fn at_zero_a_form_leaves_what_is_stated_of_its_own_effect() {
    let nominal = model("thesis-phs.toml").chain();
    let scales = Scales { plant: &nominal.plant, ..sane::EXAMPLE };
    let is_amplitude = |p: &Parameter| matches!(p.role, Role::Amplitude(_));
    let mut failed = Vec::new();
    for (effect, form) in REGISTRY.iter().flat_map(|effect| effect.forms().iter().map(move |form| (effect, form))) {
        let parameters = (form.parameters)(&scales);
        if !parameters.iter().any(is_amplitude) {
            continue;
        }
        // Shapes at the last of their starts, so that they differ from what is stated.
        let at_zero: Vec<f64> = parameters
            .iter()
            .map(|p| match &p.role {
                Role::Amplitude(_) => 0.0,
                Role::Shape(starts) | Role::Place(starts) => starts[starts.len() - 1],
            })
            .collect();
        for stated_form in effect.forms() {
            let stated = with(&nominal, stated_form, &stated_form.typical(&scales));
            let both = with(&stated, form, &at_zero);
            let at = format!("{} {} on {}", effect.id(), form.name, stated_form.name);
            // Noise of no size may have any time constant.
            let mut noise = both.sensor.clone();
            if noise.slow_noise_m == 0.0 {
                noise.slow_noise_s = stated.sensor.slow_noise_s;
            }
            if form.kind == Kind::Spread && noise != stated.sensor {
                failed.push(at.clone());
            }
            // A nanometre: what the simulator promises where it must take sub-steps.
            let apart_m = distance(&readings_m(&both, 0.0), &readings_m(&stated, 0.0));
            if apart_m.is_nan() || apart_m > 1e-9 {
                failed.push(format!("{at}: {apart_m:e}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn two_of_a_kind_both_act() {
    let nominal = model("thesis-phs.toml").chain();
    let twice = |id: &str, name: &str, values: [&[f64]; 2]| {
        let form = form(id, name);
        with(&with(&nominal, form, values[0]), form, values[1])
    };
    let warm = twice("thermal_gain", "time", [&[0.05, 2.0], &[0.01, 7.0]]);
    let of_both: Vec<[f64; 2]> = warm.drive.warmings.iter().map(|w| [w.coefficient, w.time_constant_s]).collect();
    assert_eq!(of_both, [[0.05, 2.0], [0.01, 7.0]]);
    // Warm through, which takes 1 ms: the gains multiply.
    let gain = |chain: &Chain| {
        let mut chain = chain.clone();
        chain.plant.hysterons.clear();
        chain.drive.warmings.iter_mut().for_each(|warming| warming.time_constant_s = 1e-5);
        let log = Log { dt_s: SAMPLE_S, command_v: vec![20.0; 3000], ..Log::default() };
        predict(&chain, &log, &Start::relaxed(&chain), 3000)[2999]
    };
    let ratio = gain(&warm) / gain(&nominal);
    assert!((ratio - 1.05 * 1.01).abs() < 1e-9, "{ratio}");

    let settled = twice("sensor_gain", "settling", [&[0.05, 2.0], &[0.01, 7.0]]);
    // At 1e4 s both have settled to exp(-1e3).
    assert!((settled.sensor.predictable_m(1e-6, 1e4) - 1.05 * 1.01e-6).abs() < 1e-18);

    let gaps = twice("backlash", "gap", [&[1e-6, 2e-6], &[4e-6, 20e-6]]);
    // Behind both the reading misses half of each from its side: 0.5 above, 2 below.
    assert!((gaps.sensor.predictable_m(10e-6, 0.0) - (10e-6 - 0.5e-6 + 2e-6)).abs() < 1e-18);

    let one_sided = twice("asymmetric_hysteresis", "drive-one-sided", [&[0.1, 10.0], &[0.2, 30.0]]);
    assert!((one_sided.drive.output_v(40.0) - (40.0 + 0.1 * 30.0 + 0.2 * 10.0)).abs() < 1e-12);

    // Of equal widths: half the rate of each, and midway to where either goes.
    let taken_up = twice("backlash", "play-taken-up", [&[1e-6, 2e-3, 1.0], &[1e-6, 2e-3, -1.0]]);
    assert_eq!((taken_up.sensor.play_m, taken_up.sensor.drag_to), (2e-6, 0.0));
    assert!((taken_up.sensor.drag_s - 2e-3).abs() < 1e-15);

    let noisy = twice("noise_excess", "coloured", [&[3e-9, 1e-3], &[4e-9, 11e-3]]);
    // 9 and 16 nm^2 of 25.
    assert!((noisy.sensor.slow_noise_m - 5e-9).abs() < 1e-20);
    assert!((noisy.sensor.slow_noise_s - (9.0 * 1e-3 + 16.0 * 11e-3) / 25.0).abs() < 1e-15);

    let growing = twice("amplifier_bandwidth", "growing", [&[1e-4, 4e-3], &[3e-4, 8e-3]]);
    assert!((growing.drive.lag_growth.by_side - 7e-3).abs() < 1e-15);
}

/// v = (1 + a cos wt + b sin wt + ..) u.
#[test]
fn a_ripple_is_its_equation() {
    let mut plain = model("thesis-phs.toml").chain();
    plain.plant.hysterons.clear();
    let shares = [0.05, -0.03, 0.02, 0.04];
    let rippling = with(&plain, form("amplifier_gain", "50 Hz ripple"), &shares);
    let rows = 600;
    let run = |chain: &Chain, command_v: Vec<f64>| {
        let log = Log { dt_s: SAMPLE_S, command_v, ..Log::default() };
        predict(chain, &log, &Start::relaxed(chain), rows)
    };
    let command_v = |k: usize| 20.0 + 10.0 * (TAU * 30.0 * k as f64 * SAMPLE_S).sin();
    let ours = run(&rippling, (0..rows).map(command_v).collect());
    // The simulator takes the gain in the middle of each sample.
    let ripple = |k: usize| {
        let (sin, cos) = (TAU * 50.0 * (k as f64 + 0.5) * SAMPLE_S).sin_cos();
        let (sin2, cos2) = (TAU * 100.0 * (k as f64 + 0.5) * SAMPLE_S).sin_cos();
        1.0 + shares[0] * cos + shares[1] * sin + shares[2] * cos2 + shares[3] * sin2
    };
    let theirs = run(&plain, (0..rows).map(|k| command_v(k) * ripple(k)).collect());
    // Rounding: 600 rows of 1e-16 of 60 um.
    let apart_m = distance(&ours, &theirs);
    assert!(apart_m < 1e-17, "{apart_m:e}");
}

#[test]
fn a_second_order_lag_that_is_quicker_for_a_large_error_follows_its_equation() {
    // T1 x' = (u - x) (1 + e |u - y|), T2 y' = (x - y) (1 + e |u - y|), by Runge-Kutta, behind a step.
    let ([t1, t2], eager, step_v, rows) = ([4e-3, 6e-3], 0.05, 30.0, 300);
    let mut plain = model("thesis-phs.toml").chain();
    plain.plant.hysterons.clear();
    let natural_rad_per_s = f64::sqrt(t1 * t2).recip();
    let lag = Some(Lag::Second { natural_rad_per_s, damping_ratio: 0.5 * (t1 + t2) * natural_rad_per_s });
    let run = |drive: Drive, hold, command_v: Vec<f64>| {
        let mut log = Log { dt_s: SAMPLE_S, command_v, ..Log::default() };
        log.meta.hold = hold;
        let chain = Chain { drive, ..plain.clone() };
        predict(&chain, &log, &Start::relaxed(&chain), rows)
    };
    let stepped = |drive: Drive| run(drive, Hold::Zoh, vec![step_v; rows]);
    let ours = stepped(Drive { lag, lag_growth: Growth { eager, ..Growth::NONE }, ..Drive::IDEAL });
    let rate = |[x, y]: [f64; 2]| {
        let quicker = 1.0 + eager * (step_v - y).abs();
        [(step_v - x) * quicker / t1, (x - y) * quicker / t2]
    };
    let (mut state, mut volts) = ([0.0; 2], vec![0.0]);
    const FINE: usize = 20;
    let h = SAMPLE_S / FINE as f64;
    let along = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
    for step in 1..rows * FINE {
        let k1 = rate(state);
        let k2 = rate(along(state, k1, 0.5 * h));
        let k3 = rate(along(state, k2, 0.5 * h));
        let k4 = rate(along(state, k3, h));
        for i in 0..2 {
            state[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
        if step.is_multiple_of(FINE) {
            volts.push(state[1]);
        }
    }
    let theirs = run(Drive::IDEAL, Hold::Foh, volts);
    let full_m = step_v * plain.plant.static_gain_m_per_v();
    let apart = distance(&ours, &theirs) / full_m;
    // Pieces are as quick as where they begin: measured 2e-3, and without eagerness it is another lag by a third of the step.
    let plain_lag = distance(&stepped(Drive { lag, ..Drive::IDEAL }), &theirs) / full_m;
    println!("{apart:e} {plain_lag:e}");
    assert!((1e-5..4e-3).contains(&apart) && plain_lag > 0.1, "{apart:e} {plain_lag:e}");
}

/// Effects that a plant of some kind leaves nothing to act on are not taken in silence.
#[test]
fn an_effect_that_finds_nothing_to_act_on_is_refused_with_one_line() {
    let cases = [
        ("thesis-bouc-wen.toml", "extra_hysteron", "plays-of-the-voltage"),
        ("thesis-bouc-wen.toml", "asymmetric_hysteresis", "plays-up"),
        ("thesis-bouc-wen.toml", "asymmetric_hysteresis", "leaning-spectrum"),
        ("thesis-bouc-wen.toml", "asymmetric_hysteresis", "capacitance"),
        ("thesis-newid2.toml", "asymmetric_hysteresis", "capacitance-of-second"),
    ];
    for (file, id, name) in cases {
        let form = form(id, name);
        let effect = effects::find(id).expect("in the registry");
        let written = |values: Vec<f64>| {
            let params: Vec<Param> = values.into_iter().map(Param::assumed).collect();
            let text = toml::to_string(&model(file).with_effect(effect, form, &params)).expect("text");
            Model::parse(&text, Path::new("made.toml"))
        };
        let typical = form.typical(&sane::EXAMPLE);
        let line = written(typical.clone()).expect_err(name).to_string();
        let wanted = format!("made.toml: effect[1]: {id} in its form {name:?} finds nothing to act on in this plant");
        assert!(line.starts_with(&wanted) && !line.contains('\n'), "{line}");
        // What is zero needs nothing.
        let parameters = (form.parameters)(&sane::EXAMPLE);
        let zeros = parameters.iter().zip(typical).map(|(p, value)| match p.role {
            Role::Amplitude(_) => 0.0,
            _ => value,
        });
        assert!(written(zeros.collect()).is_ok(), "{name}");
    }
}

/// Slow noise has been there before the first row.
#[test]
fn slow_noise_begins_at_its_size() {
    let sensor = Sensor { slow_noise_m: 20e-9, slow_noise_s: 1.0, ..Sensor::IDEAL };
    let first = |seed| SensorState::new(&sensor, seed).read_m(0.0, 0.0, SAMPLE_S);
    let seeds = 2000;
    let rms = ((0..seeds).map(|seed| first(seed).powi(2)).sum::<f64>() / seeds as f64).sqrt();
    // Of 2000 draws the rms is known to 1/sqrt(4000) = 1.6 %; four of these.
    assert!((rms / 20e-9 - 1.0).abs() < 0.064, "{rms:e}");
}

/// A plant of no mass that something shakes is where the force is, at once.
#[test]
fn a_massless_plant_is_shaken() {
    let mut chain = model("thesis-bouc-wen-static.toml").chain();
    let mains = form("mains_hum", "50 Hz on the drive");
    let mut values = vec![0.0; 10];
    (values[0], values[3]) = (2e-6, 1e-6);
    (mains.install)(&mut chain, &values);
    let log = Log { dt_s: SAMPLE_S, command_v: vec![0.0; 300], ..Log::default() };
    let ours = predict(&chain, &log, &Start::relaxed(&chain), 300);
    for (k, reading_m) in ours.iter().enumerate().skip(1) {
        let angle = TAU * 50.0 * k as f64 * SAMPLE_S;
        let there_m = (2e-6 * angle.cos() + 1e-6 * (2.0 * angle).sin()) / chain.plant.stiffness_n_per_m;
        assert!((reading_m - there_m).abs() < 1e-18, "{k}: {reading_m:e} {there_m:e}");
    }
}

/// What is read behind a velocity: that of plants which are no mass on a spring.
#[test]
fn plants_of_every_kind_have_a_velocity() {
    let late_s = 0.3 * SAMPLE_S;
    let command_v = |k: usize| 30.0 * (TAU * 60.0 * k as f64 * SAMPLE_S).sin();
    let run = |chain: &Chain, sensor: Sensor, hold| {
        let chain = Chain { sensor, parts: Parts { ..chain.parts.clone() }, ..chain.clone() };
        let mut log = Log { dt_s: SAMPLE_S, command_v: (0..400).map(command_v).collect(), ..Log::default() };
        log.meta.hold = hold;
        predict(&chain, &log, &Start::relaxed(&chain), 400)
    };
    // A transfer function against the mass on a spring that it describes.
    let mut second = model("thesis-newid2.toml");
    second.effects.clear();
    let plant = second.chain().plant;
    let tf = plant_sim::linear::TransferFunction {
        numerator: vec![plant.transduction_c_per_m / plant.mass_kg],
        denominator: vec![1.0, plant.damping_n_s_per_m / plant.mass_kg, plant.stiffness_n_per_m / plant.mass_kg],
    };
    let linear = Model::of_transfer_function("the same", &tf, "computed").chain();
    let lag = Some(Lag::First { time_constant_s: 3e-4 });
    for sensor in [
        Sensor { late_s, ..Sensor::IDEAL },
        Sensor { play_m: 1e-6, lag, ..Sensor::IDEAL },
        Sensor { lag, lag_growth: Growth { outwards: 1e4, ..Growth::NONE }, ..Sensor::IDEAL },
    ] {
        let [ours, theirs] = [&linear, &second.chain()].map(|chain| run(chain, sensor.clone(), Hold::Foh));
        // Two exponentials of the same matrix in other coordinates, of 40 um.
        let apart_m = distance(&ours, &theirs);
        assert!(apart_m < 1e-14, "{sensor:?}: {apart_m:e}");
    }
    // A plant of no mass: the mean over the last sample.
    let massless = model("thesis-bouc-wen-static.toml").chain();
    let [ideal, late] =
        [Sensor::IDEAL, Sensor { late_s, ..Sensor::IDEAL }].map(|sensor| run(&massless, sensor, Hold::Zoh));
    for k in 1..400 {
        let ahead_m = late_s / SAMPLE_S * (ideal[k] - ideal[k - 1]);
        assert!((late[k] - ideal[k] - ahead_m).abs() < 1e-17, "{k}");
    }
    // And a lag behind it follows the line between the rows.
    let time_constant_s = 1e-3;
    let lagging = run(&massless, Sensor { lag: Some(Lag::First { time_constant_s }), ..Sensor::IDEAL }, Hold::Zoh);
    let mut behind_m = 0.0;
    for k in 1..400 {
        let slope = (ideal[k] - ideal[k - 1]) / SAMPLE_S;
        let left = (-SAMPLE_S / time_constant_s).exp();
        behind_m = ideal[k] - slope * time_constant_s + (behind_m - ideal[k - 1] + slope * time_constant_s) * left;
        assert!((lagging[k] - behind_m).abs() < 1e-15, "{k}: {:e} {behind_m:e}", lagging[k]);
    }
}
