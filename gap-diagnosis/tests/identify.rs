//! Identification on made logs, whose truth is known, and on a measured one, whose second half is withheld.

use gap_diagnosis::identify::{Fit, From, Hysterons, IdentifyError, Options, Verdict, fit_start, identify};
use plant_sim::experiment::{Program, Recording, Setup, open_loop};
use plant_sim::log::{Log, ReadOptions, read};
use plant_sim::model::Model;
use plant_sim::replay::{Initial, Start, predict};
use plant_sim::spec::Spec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::{Path, PathBuf};

/// Opens both dead zones of the thesis' plant within one second.
const OPENING: &str = "hold:40V@0.05s+hold:80V@0.1s+hold:20V@0.05s+hold:-60V@0.1s+hold:-10V@0.1s+sine:80V@40Hz,for=0.2s\
                       +hold:30V@0.1s+sine:75V@100Hz,for=0.2s+hold:0V@0.1s";
const NOISE_M: f64 = 20e-9;

fn thesis() -> Model {
    Model::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/thesis-phs.toml")))
        .expect("the project's own model")
}

/// One second of the thesis' plant at 10 kHz from the relaxed state.
fn made_log(model: &Model, spec: &str, noise_m: f64, seed: u64) -> Log {
    let mut chain = model.chain();
    chain.sensor.noise_m = noise_m;
    let program = Program::new(&Spec::parse(spec).expect("valid"), 1e4).expect("playable");
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: 1e4, samples: 10_000, latency_s: 0.0, seed };
    let recording = open_loop(&setup, &program, &|_| ()).expect("runs");
    Log {
        name: "made".into(),
        dt_s: 1e-4,
        command_v: recording.command_v,
        displacement_m: recording.displacement_m,
        ..Log::default()
    }
}

/// The thesis' plant with every identifiable number off by up to `spread` in its logarithm.
fn off(model: &Model, spread: f64, seed: u64) -> Model {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut factor = || random.random_range(-spread..spread).exp();
    let mut model = model.clone();
    model.structure.damping_n_s_per_m.value *= factor();
    model.structure.stiffness_n_per_m.value *= factor();
    model.actuator.transduction_c_per_m.value *= factor();
    for hysteron in &mut model.actuator.hysterons {
        hysteron.capacitance_f.value *= factor();
        hysteron.slope_s.value *= factor();
        hysteron.dead_zone_v.value *= factor();
    }
    model
}

fn fit(log: &Log, from: From, seed: u64) -> Result<Fit, IdentifyError> {
    let options = Options { from, initial: Initial::Rest, run_in_s: None, starts: 8, seed };
    identify(std::slice::from_ref(log), &options, &|_, _| ())
}

#[test]
fn the_noise_floor_is_reached_from_twenty_of_twenty_starts() {
    let truth = thesis();
    let log = made_log(&truth, OPENING, NOISE_M, 3);
    for seed in 0..20 {
        let fit = fit(&log, From::Plant(Box::new(off(&truth, 0.3, seed))), seed).expect("fits");
        // 10000 samples give the noise's rms to 0.7 %, and 13 coordinates take 0.07 % of it: 3 % is four sigma either way.
        let ratio = fit.logs[0].rms_m / NOISE_M;
        assert!((0.97..1.03).contains(&ratio), "start {seed}: {ratio}");
    }
}

#[test]
fn sigmas_mean_what_they_say() {
    let truth = thesis();
    let mut within = 0;
    let mut all = 0;
    for seed in 0..8 {
        let log = made_log(&truth, OPENING, NOISE_M, 100 + seed);
        let fit = fit(&log, From::Plant(Box::new(off(&truth, 0.1, seed))), seed).expect("fits");
        let true_values = [
            ("stiffness_N_per_m", 24579.0),
            ("damping_N_s_per_m", 3.7356),
            ("transduction_C_per_m", 0.046311),
            ("capacitance1_F", 5.6425e-7),
            ("dead_zone1_V", 14.5126),
            ("capacitance2_F", 5.2125e-7),
            ("slope2_S", 1.1528e-4),
            ("dead_zone2_V", 8.6838),
        ];
        for (name, value) in true_values {
            let fitted = fit.parameters.iter().find(|p| p.name == name).expect("listed");
            assert_eq!(fitted.verdict, Verdict::Fitted, "{name}: {}", fitted.note);
            all += 1;
            within += usize::from((fitted.value - value).abs() < 2.0 * fitted.sigma);
        }
    }
    // 95.4 % of 64 lie within two sigma; correlated within a fit, so the band is wide: 80 % and not every one of very wide ones.
    assert!(within * 100 >= all * 80, "{within} of {all} within two sigma");
}

#[test]
fn a_dead_zone_that_never_opens_is_said_to_be_unseen() {
    let truth = thesis();
    // 60 V, 100 Hz: hysteron 1 reaches 7.15 V and its dead zone opens at 7.26 V.
    let log = made_log(&truth, "sine:60V@100Hz,for=1s", NOISE_M, 5);
    let start = off(&truth, 0.02, 1);
    let fit = fit(&log, From::Plant(Box::new(start.clone())), 1).expect("fits");
    let slope = fit.parameters.iter().find(|p| p.name == "slope1_S").expect("listed");
    assert_eq!(slope.verdict, Verdict::Unseen, "{}", slope.note);
    assert!(slope.note.contains("can't see"), "{}", slope.note);
    let stated = &start.actuator.hysterons[0].slope_s;
    assert_eq!(slope.value, stated.value, "kept at its prior, not invented");
    // And as well known as its file says, not worse for a log that doesn't see it.
    let record = &fit.model.actuator.hysterons[0].slope_s;
    assert_eq!((record.sigma, slope.sigma), (Some(0.02), 0.02 * stated.value));
    assert_eq!(record.source, format!("not seen by made; {}", stated.source));
}

#[test]
fn a_delay_is_found_and_one_that_is_not_there_is_not() {
    let truth = thesis();
    let mut delayed = truth.clone();
    delayed.drive.delay_us = Some(plant_sim::param::Param::absolute(37.0, 0.0, "made"));
    let log = made_log(&delayed, OPENING, NOISE_M, 8);
    let found = fit(&log, From::Plant(Box::new(off(&truth, 0.1, 2))), 2).expect("fits");
    let delay = found.parameters.iter().find(|p| p.name == "delay_us").expect("found");
    // The sigma is a few nanoseconds; a tenth of a microsecond is a thousandth of a sample.
    assert!((delay.value - 37.0).abs() < 0.1, "{} +- {}", delay.value, delay.sigma);
    let none =
        fit(&made_log(&truth, OPENING, NOISE_M, 8), From::Plant(Box::new(off(&truth, 0.1, 2))), 2).expect("fits");
    assert!(none.parameters.iter().all(|p| p.name != "delay_us"));
}

#[test]
fn effects_of_a_stated_plant_stay_as_they_are_and_the_rest_is_found_around_them() {
    let creep = plant_sim::effects::find("creep").expect("in the registry");
    let numbers = [0.05, 0.03].map(|value| plant_sim::param::Param::new(value, 0.1, "made"));
    let truth = thesis().with_effect(creep, &creep.forms()[0], &numbers);
    let log = made_log(&truth, OPENING, NOISE_M, 11);
    let found = fit(&log, From::Plant(Box::new(off(&truth, 0.1, 3))), 3).expect("fits");
    // As for the noise floor above.
    let ratio = found.logs[0].rms_m / NOISE_M;
    assert!((0.97..1.03).contains(&ratio), "{ratio}");
    assert_eq!(found.model.effects, truth.effects);
    assert_eq!(found.model.actuator.hysterons.len(), 2);
    for (name, value) in [("stiffness_N_per_m", 24579.0), ("dead_zone2_V", 8.6838)] {
        let fitted = found.parameters.iter().find(|p| p.name == name).expect("listed");
        assert!((fitted.value - value).abs() < 4.0 * fitted.sigma, "{name}: {} +- {}", fitted.value, fitted.sigma);
    }
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let truth = thesis();
    let log = made_log(&truth, OPENING, NOISE_M, 3);
    let run = || {
        let fit = fit(&log, From::Plant(Box::new(off(&truth, 0.3, 4))), 4).expect("fits");
        fit.parameters.iter().map(|p| p.value.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn bad_logs_are_refused_in_words() {
    let truth = thesis();
    let good = made_log(&truth, OPENING, NOISE_M, 3);
    let plant = || From::Plant(Box::new(truth.clone()));
    let refusal = |log: &Log| fit(log, plant(), 1).expect_err("refused").to_string();
    let still = Log { command_v: vec![1.0; 10_000], ..good.clone() };
    assert!(refusal(&still).contains("never changes"));
    let silent = Log { displacement_m: vec![1.0; 10_000], ..good.clone() };
    assert!(refusal(&silent).contains("check the sensor"));
    let inverted = Log { displacement_m: good.displacement_m.iter().map(|y| -y).collect(), ..good.clone() };
    let from = || From::Logs { hysterons: Hysterons::Fixed(1), mass_kg: 1e-3 };
    assert!(fit(&inverted, from(), 1).expect_err("refused").to_string().contains("--scale"));
    assert!(refusal(&inverted).contains("made: the displacement falls"), "with a plant as well");
    let inverted = Log { name: "second".into(), ..inverted };
    for from in [from(), plant()] {
        let options = Options { from, initial: Initial::Rest, run_in_s: None, starts: 1, seed: 1 };
        let said = identify(&[good.clone(), inverted.clone()], &options, &|_, _| ()).expect_err("refused").to_string();
        // --scale would turn the first one too.
        assert!(said.starts_with("second: the displacement falls") && !said.contains("--scale"), "{said}");
    }
}

/// What acts before a run-in's end moves what comes after it.
#[test]
fn a_step_at_the_end_of_the_run_in_is_a_step() {
    let truth = thesis();
    let log = made_log(&truth, "zero@0.5s+hold:20V,for=0.5s", NOISE_M, 3);
    let from = From::Plant(Box::new(truth));
    let options = Options { from, initial: Initial::Relaxed, run_in_s: Some(0.5), starts: 1, seed: 1 };
    let fit = identify(&[log], &options, &|_, _| ()).expect("fits");
    assert!((0.97..1.03).contains(&(fit.logs[0].rms_m / NOISE_M)), "{:e}", fit.logs[0].rms_m);
}

#[test]
fn a_zero_is_told_as_far_as_the_logs_tell_it() {
    let truth = thesis();
    let zero_um = |logs: &[Log]| {
        let from = From::Plant(Box::new(truth.clone()));
        let options = Options { from, initial: Initial::Rest, run_in_s: None, starts: 1, seed: 1 };
        let zero = identify(logs, &options, &|_, _| ()).expect("fits").model.sensor.offset_um.expect("told");
        (zero.value, zero.sigma_abs.expect("told"))
    };
    let open = made_log(&truth, OPENING, NOISE_M, 3);
    // Every hysteron opens and tells what it held: no finer than a reading, of which 10000 give the noise to a per cent or two.
    let (value, sigma) = zero_um(std::slice::from_ref(&open));
    assert!((0.019..0.2).contains(&sigma) && value.abs() < 4.0 * sigma, "{value} +- {sigma}");
    // None opens at 15 V: the edges of 7.26 and 4.34 V at 1.884 um/V hide 13.7 and 8.2 um.
    let (value, sigma) = zero_um(&[made_log(&truth, "sine:15V@100Hz,for=1s", NOISE_M, 3)]);
    assert!((5.0..30.0).contains(&sigma), "{value} +- {sigma}");
    // Set anew between two logs by 3 um.
    let moved = Log { displacement_m: open.displacement_m.iter().map(|y| y + 3e-6).collect(), ..open.clone() };
    let (value, sigma) = zero_um(&[open, moved]);
    assert!((value - 1.5).abs() < 0.1 && (1.5..3.0).contains(&sigma), "{value} +- {sigma}");
}

fn measured(name: &str) -> Option<Log> {
    let path =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/piezo-micromanipulator-dbo")).join(name);
    if !path.exists() {
        println!("not run: ../shared/data/piezo-micromanipulator-dbo/{name} is not here");
        return None;
    }
    let columns = [("time", "t_s"), ("command", "u_V"), ("displacement", "y_um")];
    let columns = columns.map(|(name, column)| (name.to_owned(), column.to_owned())).into_iter().collect();
    Some(read(&path, &ReadOptions { columns, ..ReadOptions::default() }).expect("a good log"))
}

#[test]
fn a_measured_micromanipulator_is_identified_and_its_unseen_log_predicted() {
    let (Some(model_log), Some(test_log)) = (measured("clean_Model.csv"), measured("clean_Test.csv")) else {
        return;
    };
    let options = Options {
        from: From::Logs { hysterons: Hysterons::Fixed(2), mass_kg: 1e-3 },
        initial: Initial::Rest,
        run_in_s: Some(2.0),
        starts: 2,
        seed: 1,
    };
    let fit = identify(&[model_log], &options, &|_, _| ()).expect("fits");
    // A static line gets 79 % and about 88 %; noise of 0.07 um would allow 99.6 % and 99.4 %, which no plant of this kind reaches.
    assert!((97.0..99.0).contains(&fit.logs[0].fit_percent), "{}", fit.logs[0].fit_percent);
    let chain = fit.model.chain();
    let (start, offset_m) = fit_start(&chain, &test_log, Initial::Rest, 400, true).expect("the log moves");
    let mut score = plant_sim::metrics::Score::default();
    let predicted = predict(&chain, &test_log, &start, test_log.len());
    for (y, p) in test_log.displacement_m.iter().zip(predicted).skip(400) {
        score.add(*y, p + offset_m);
    }
    assert!((95.5..98.5).contains(&score.fit_percent(true)), "{}", score.fit_percent(true));
}

#[test]
fn a_start_beyond_a_dead_zone_is_found() {
    let chain = thesis().chain();
    let edges_v: Vec<f64> = chain.plant.hysterons.iter().map(|hysteron| hysteron.edge_v()).collect();
    for charge in [-1.6, -1.3, 1.3, 1.6, 2.0] {
        let state = Start::at_rest(&chain, 0.0, vec![0.4 * edges_v[0], charge * edges_v[1]]);
        let program = Program::new(&Spec::parse(OPENING).expect("valid"), 1e4).expect("playable");
        let setup = Setup { chain: &chain, start: &state, rate_hz: 1e4, samples: 10_000, latency_s: 0.0, seed: 1 };
        let Recording { dt_s, command_v, displacement_m, .. } = open_loop(&setup, &program, &|_| ()).expect("runs");
        let log = Log { dt_s, command_v, displacement_m, ..Log::default() };
        let (start, _) = fit_start(&chain, &log, Initial::Fit, 0, false).expect("the log moves");
        let predicted_m = predict(&chain, &log, &start, log.len());
        let left_m = log.displacement_m.iter().zip(predicted_m).map(|(y, p)| (y - p).abs()).fold(0.0, f64::max);
        // The fit stops at relative changes of 1e-7.
        assert!(left_m < 1e-7, "{charge} edges: {left_m:e} m");
    }
}
