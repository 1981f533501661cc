//! A plant that states an effect, as `augmented.toml` does, diagnosed with logs of itself: there is no gap.

use gap_diagnosis::diagnose::{Diagnosis, Options, Verdict, diagnose};
use plant_sim::effects::{Kind, REGISTRY, Scales, find, sane};
use plant_sim::experiment::{Program, Setup, open_loop};
use plant_sim::log::Log;
use plant_sim::model::Model;
use plant_sim::param::Param;
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::path::Path;

/// Forms that are always asked, all but a start with HYSTERON_LONG=1: one whose number adds up with the plant's own, one of the laws that searches follow
/// coarsely, and what no simulation predicts.
const ALWAYS: [(&str, &str); 6] = [
    ("sensor_offset", "constant"),
    ("rate_dependent_hysteresis", "widening"),
    ("noise_excess", "coloured"),
    ("quantisation", "converter-in"),
    ("lost_samples", "repeated"),
    ("sampling_jitter", "white"),
];

const SPECS: [&str; 3] = [
    "hold:0V@0.02s+hold:40V@0.06s+hold:75V@0.06s+hold:-20V@0.06s+hold:-70V@0.06s+hold:10V@0.06s+hold:60V@0.06s+hold:-50V@0.06s",
    "sine:70V@20Hz,for=0.15s+sine:40V@100Hz,for=0.1s+sine:80V@7Hz,for=0.3s",
    "multisine:60V@10-500Hz,seed=3,periods=1",
];
const RATE_HZ: f64 = 1e4;
const NOISE_UM: f64 = 0.02;

/// What the plant's own sensor reads of a SPEC.
fn log(model: &Model, name: &str, spec: &str, seed: u64) -> Log {
    let chain = model.chain();
    begun(model, name, spec, seed, &Start::relaxed(&chain))
}

/// The same of a plant that begins at `start`.
fn begun(model: &Model, name: &str, spec: &str, seed: u64, start: &Start) -> Log {
    let chain = model.chain();
    let program = Program::new(&Spec::parse(spec).expect("valid"), RATE_HZ).expect("playable");
    let samples = program.samples().unwrap_or(5000);
    let setup = Setup { chain: &chain, start, rate_hz: RATE_HZ, samples, latency_s: 0.0, seed };
    let made = open_loop(&setup, &program, &|_| ()).expect("runs");
    let (command_v, displacement_m) = (made.command_v, made.displacement_m);
    Log { name: name.into(), dt_s: made.dt_s, command_v, displacement_m, ..Log::default() }
}

/// The thesis' plant with a sensor that states its noise.
fn nominal() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    let mut nominal = Model::read(&path).expect("of the project");
    nominal.sensor.noise_um = Some(Param { sigma: Some(0.1), ..Param::absolute(NOISE_UM, 0.0, "made") });
    nominal
}

/// What `nominal` says of logs of `bench`.
fn diagnosed(nominal: &Model, bench: &Model) -> Diagnosis {
    let [steps, sines, held_out] = [0, 1, 2].map(|at| log(bench, &format!("log{at}"), SPECS[at], at as u64));
    diagnose(nominal, &[steps, sines], &[held_out], &Options::default(), &|_, _| ()).expect("good logs")
}

#[test]
fn what_a_plant_states_is_no_gap() {
    let nominal = nominal();
    let plant = nominal.chain().plant;
    let scales = Scales { plant: &plant, ..sane::EXAMPLE };
    let is_long = std::env::var_os("HYSTERON_LONG").is_some();
    let forms = REGISTRY.iter().flat_map(|effect| effect.forms().iter().map(move |form| (*effect, form)));
    let is_asked = |id: &str, form: &str| is_long || ALWAYS.contains(&(id, form));
    let mut asked = 0;
    for (effect, form) in forms.filter(|(effect, form)| is_asked(effect.id(), form.name)) {
        if form.kind == Kind::Start {
            continue;
        }
        asked += 1;
        let values: Vec<Param> =
            form.typical(&scales).iter().map(|value| Param::absolute(*value, 0.0, "typical")).collect();
        let model = nominal.clone().with_effect(effect, form, &values);
        let found = diagnosed(&model, &model);
        let at = format!("{}, {}: {:?}, {:?}", effect.id(), form.name, found.effects, found.gap);
        assert_eq!(found.verdict, Verdict::NoGap, "{at}");
        let stays = form.kind != Kind::Predictable;
        assert!(stays || found.gap.augmented_rms_um < 1.1 * NOISE_UM, "{at}");
    }
    assert!(asked >= ALWAYS.len());
}

#[test]
fn of_what_a_plant_states_the_rest_is_told() {
    let jitter = find("sampling_jitter").expect("registered");
    let with = |rms_s| nominal().with_effect(jitter, &jitter.forms()[0], &[Param::absolute(rms_s, 0.0, "made")]);
    // Fast rows are as loud as that: a clock that runs wrong may not be read into them.
    let found = diagnosed(&with(3e-6), &with(3e-6));
    assert_eq!(found.verdict, Verdict::NoGap, "{:?}", found.effects);
    let found = diagnosed(&with(1e-6), &with(2e-6));
    assert_eq!(found.effects, ["sampling_jitter"]);
    let rest_s = found.parameters[0].value;
    assert!((rest_s / 3e-12_f64.sqrt() - 1.0).abs() < 0.15, "{rest_s}");
}

/// All logs begin charged alike, and the first stretch of one that was never fitted moves no hysteron: what the others tell counts without a name as well.
#[test]
fn a_plant_without_a_gap_begins_as_the_fitted_logs_do() {
    let nominal = nominal();
    let chain = nominal.chain();
    let held_v: Vec<f64> =
        chain.plant.hysterons.iter().zip([0.5, -0.3]).map(|(one, share)| share * one.edge_v()).collect();
    let start = Start::at_rest(&chain, 0.0, held_v);
    let slight = "zero@0.02s+sine:5V@20Hz,for=0.25s+sine:75V@20Hz,for=0.5s";
    let [steps, sines, multisine, held_out] =
        [SPECS[0], SPECS[1], SPECS[2], slight].map(|spec| begun(&nominal, spec, spec, 4, &start));
    let found = diagnose(&nominal, &[steps, sines, multisine], &[held_out], &Options::default(), &|_, _| ())
        .expect("good logs");
    assert_eq!(found.verdict, Verdict::NoGap, "{:?}", found.effects);
    assert!(found.gap.augmented_rms_um < 1.1 * NOISE_UM, "{:?}", found.gap);
}

/// A joint's gap narrower than a bend of the sensor can be, on a plant that is a little stronger and softer than stated: its own search ends elsewhere, and
/// readings that stay across it look like a sensor without slope.
#[test]
fn a_gap_is_no_bend_of_the_sensor() {
    let nominal = nominal();
    let backlash = find("backlash").expect("an entry");
    let gap = backlash.forms().iter().find(|form| form.name == "gap").expect("a form");
    let values = [2e-7, -6.3e-6].map(|value| Param::absolute(value, 0.0, "made"));
    let mut bench = nominal.clone().with_effect(backlash, gap, &values);
    bench.actuator.transduction_c_per_m.value *= 1.02;
    bench.structure.stiffness_n_per_m.value *= 0.98;
    let found = diagnosed(&nominal, &bench);
    let first = &found.ranking[0];
    assert!(first.effect == "backlash" && first.probability > 0.5, "{:?}", found.ranking);
    assert!(found.gap.augmented_rms_um < 1.1 * NOISE_UM, "{:?}", found.gap);
}
