//! The registry of effects: complete, consistent, neutral at zero amplitude, and carried by model files without loss.

use plant_sim::chain::{Chain, Held, Simulator};
use plant_sim::effects::{self, Effect, Form, Kind, Parameter, REGISTRY, Role, Scales, sane};
use plant_sim::log::Log;
use plant_sim::model::{InitialStateSection, Model};
use plant_sim::param::Param;
use plant_sim::phs::Phs;
use plant_sim::replay::{Start, predict};
use plant_sim::spec::Spec;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The identifiers that files and scripts rely on.
const CONTRACT: &str = "creep vibration_mode transport_delay sampling_jitter lost_samples clock_error amplifier_gain \
    amplifier_bandwidth amplifier_slew amplifier_saturation nonlinear_stiffness asymmetric_stiffness coulomb_friction \
    extra_hysteron asymmetric_hysteresis rate_dependent_hysteresis sensor_bandwidth sensor_offset sensor_gain sensor_drift \
    sensor_nonlinearity noise_excess mains_hum quantisation payload_mass end_stop thermal_gain periodic_force backlash \
    initial_state";

fn of_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn thesis() -> Model {
    Model::read(&of_project("models/thesis-phs.toml")).expect("of the project")
}

/// Rigs from a micro-stage to a stack that is driven to one side, and logs from 16 samples to minutes.
fn rigs(plant: &Phs) -> Vec<Scales<'_>> {
    let bender = Scales { plant, ..sane::EXAMPLE };
    let micro_stage = Scales {
        stroke_m: 5e-6,
        drive_v: 10.0,
        rate_v_per_s: 10.0,
        command_v: [-10.0, 10.0],
        displacement_m: [-4e-6, 6e-6],
        ..bender
    };
    let stack = Scales {
        stroke_m: 8e-6,
        drive_v: 65.0,
        rate_v_per_s: 1e6,
        sample_s: 1e-6,
        longest_s: 1.6e-5,
        command_v: [20.0, 150.0],
        displacement_m: [2e-6, 18e-6],
        ..bender
    };
    let slow_steps = Scales { rate_v_per_s: 0.0, sample_s: 1.0, longest_s: 600.0, ..bender };
    vec![bender, micro_stage, stack, slow_steps]
}

fn forms() -> impl Iterator<Item = (&'static dyn Effect, &'static Form)> {
    REGISTRY.iter().flat_map(|effect| effect.forms().iter().map(move |form| (*effect, form)))
}

fn with(chain: &Chain, form: &Form, values: &[f64]) -> Chain {
    let mut chain = chain.clone();
    (form.install)(&mut chain, values);
    chain
}

#[test]
fn the_registry_holds_every_identifier_of_the_contract_once_and_in_the_order_of_the_signal() {
    let ids: Vec<&str> = REGISTRY.iter().map(|effect| effect.id()).collect();
    let distinct: BTreeSet<&str> = ids.iter().copied().collect();
    assert_eq!(distinct, CONTRACT.split_whitespace().collect());
    assert_eq!(ids.len(), distinct.len());
    assert!(REGISTRY.windows(2).all(|pair| pair[0].stage() <= pair[1].stage()), "{ids:?}");
    for id in ids {
        assert_eq!(effects::find(id).map(|effect| effect.id()), Some(id));
        assert_eq!(effects::nearest(id), id);
    }
    assert_eq!(effects::nearest("sensor_ofset"), "sensor_offset");
    assert!(effects::find("sensor_ofset").is_none());
}

#[test]
fn every_entry_says_everything_and_its_rivals_say_so_too() {
    for effect in REGISTRY {
        let (id, about) = (effect.id(), effect.about());
        for text in [
            about.title,
            about.what,
            about.equation,
            about.source,
            about.typical,
            about.installs,
            about.signature,
            about.experiment,
        ] {
            assert!(!text.trim().is_empty() && !text.contains("  ") && !text.contains('\n'), "{id}: {text:?}");
        }
        assert!(about.what.ends_with('.'), "{id}");
        assert!(!about.rivals.is_empty(), "{id}");
        for rival in about.rivals {
            let rival = effects::find(rival).unwrap_or_else(|| panic!("{id}: no entry {rival}"));
            assert!(rival.id() != id && rival.about().rivals.contains(&id), "{id} and {}", rival.id());
        }
        if about.spec.is_empty() {
            // Then no command separates it, and the words name what does.
            assert_eq!(id, "sensor_gain");
        } else {
            let spec = Spec::parse(about.spec).unwrap_or_else(|e| panic!("{id}: {e}"));
            assert!(spec.parts.iter().all(|part| part.seconds.is_some()), "{id}: the experiment needs a length");
        }
    }
}

#[test]
fn bounds_and_starts_make_sense_on_every_rig() {
    let plant = thesis().chain().plant;
    for (effect, form) in forms() {
        for scales in rigs(&plant) {
            let parameters = (form.parameters)(&scales);
            let names: BTreeSet<&str> = parameters.iter().map(|p| p.name).collect();
            assert_eq!(names.len(), parameters.len(), "{} {}", effect.id(), form.name);
            let anywhere = sane::anywhere(form, &plant);
            assert_eq!(anywhere.len(), parameters.len());
            for (p, anywhere) in parameters.iter().zip(anywhere) {
                let at = format!("{} {} {} {scales:?}: {p:?}", effect.id(), form.name, p.name);
                let [low, high] = p.bounds;
                assert!(low < high && low.is_finite() && high.is_finite(), "{at}");
                let inside = |x: f64| (low..=high).contains(&x);
                match &p.role {
                    Role::Amplitude(typical) => assert!(inside(0.0) && inside(*typical) && *typical > 0.0, "{at}"),
                    Role::Shape(starts) => {
                        assert!(!starts.is_empty() && low > 0.0 && starts.iter().all(|s| inside(*s)), "{at}")
                    }
                    Role::Place(starts) => assert!(!starts.is_empty() && starts.iter().all(|s| inside(*s)), "{at}"),
                }
                assert!(
                    !p.is_of_each_log() || matches!(p.role, Role::Amplitude(_)),
                    "a file leaves it out as zero: {at}"
                );
                let suffix = suffix(p.unit).unwrap_or_else(|| panic!("unknown unit: {at}"));
                assert!(p.name.ends_with(suffix), "the name ends in its unit: {at}");
                // Whatever a diagnosis finds may stand in a file.
                assert_eq!((anywhere.name, anywhere.unit), (p.name, p.unit));
                assert!(anywhere.bounds[0] <= low && high <= anywhere.bounds[1], "{at} against {anywhere:?}");
            }
        }
    }
}

#[test]
fn sizes_come_from_the_logs() {
    use plant_sim::log::Log;
    let plant = thesis().chain().plant;
    let log = |dt_s: f64, command_v: Vec<f64>| {
        let displacement_m = command_v.iter().map(|u| 1e-6 + 2e-6 * u).collect();
        Log { dt_s, command_v, displacement_m, ..Log::default() }
    };
    let sine =
        log(1e-4, (0..1000).map(|k| 20.0 + 10.0 * (std::f64::consts::TAU * 0.01 * f64::from(k)).sin()).collect());
    let steps = log(1e-3, (0..500).map(|k| if k / 100 % 2 == 0 { 0.0 } else { 50.0 }).collect());
    let scales = Scales::of_logs(&plant, &[sine.clone(), steps.clone()]);
    assert_eq!((scales.drive_v, scales.command_v), (25.0, [0.0, 50.0]));
    assert!((scales.stroke_m - 50e-6).abs() < 1e-15 && (scales.displacement_m[1] - 101e-6).abs() < 1e-15);
    assert_eq!((scales.sample_s, scales.longest_s), (1e-4, 0.5));
    // 10 V at 100 Hz; the chord over a sample of 3.6 degrees is shorter than the arc by 2e-4. The steps don't count.
    let rate = 10.0 * std::f64::consts::TAU * 100.0;
    assert!((scales.rate_v_per_s / rate - 1.0).abs() < 1e-3, "{}", scales.rate_v_per_s);
    assert_eq!(Scales::of_logs(&plant, &[steps]).rate_v_per_s, 0.0);
    // Nothing moves: sizes stay positive, bounds stay finite.
    let still = Scales::of_logs(&plant, &[log(1e-3, vec![3.0; 20])]);
    for (effect, form) in forms() {
        let parameters = (form.parameters)(&still);
        assert!(parameters.iter().flat_map(|p| p.bounds).all(f64::is_finite), "{} {}", effect.id(), form.name);
    }
}

/// How a name ends whose number has this unit.
fn suffix(unit: &str) -> Option<&'static str> {
    Some(match unit {
        "" => "",
        "s" => "_s",
        "m" => "_m",
        "V" => "_v",
        "Hz" => "_hz",
        "N" => "_n",
        "m/s" => "_m_per_s",
        "V/s" => "_v_per_s",
        "N/m" => "_n_per_m",
        "N/m^2" => "_n_per_m2",
        "N/m^3" => "_n_per_m3",
        "s/m" => "_s_per_m",
        "N/m^4" => "_n_per_m4",
        "N/m^5" => "_n_per_m5",
        "1/s" => "_per_s",
        "1/m" => "_per_m",
        "1/m^2" => "_per_m2",
        "1/V" => "_per_v",
        "1/V^2" => "_per_v2",
        _ => return None,
    })
}

/// Readings of a run that moves every hysteron, after the predictable part of the sensor.
pub fn readings_m(chain: &Chain, latency_s: f64) -> Vec<f64> {
    let sample_s = 1e-4;
    let mut simulator = Simulator::new(chain, sample_s, latency_s);
    let command_v = |k: usize| 50.0 * (0.05 * k as f64).sin() + if k > 200 { 10.0 } else { 0.0 };
    (0..400)
        .map(|k| {
            let reading_m = simulator.reading_m();
            simulator.advance(Held::zero_order(command_v(k)), 0.0);
            reading_m
        })
        .collect()
}

#[test]
fn at_zero_amplitude_the_chain_behaves_as_before() {
    let plant = thesis().chain().plant;
    let nominal = thesis().chain();
    let before = readings_m(&nominal, 1e-5);
    for (effect, form) in forms() {
        let scales = Scales { plant: &plant, ..sane::EXAMPLE };
        let parameters = (form.parameters)(&scales);
        let is_amplitude = |p: &Parameter| matches!(p.role, Role::Amplitude(_));
        // A limit has no amplitude: it acts or it doesn't.
        if !parameters.iter().any(is_amplitude) || effect.id() == "amplifier_slew" {
            continue;
        }
        let at_zero = parameters.iter().zip(form.typical(&scales)).map(|(p, v)| if is_amplitude(p) { 0.0 } else { v });
        let chain = with(&nominal, form, &at_zero.collect::<Vec<_>>());
        let at = format!("{} {}", effect.id(), form.name);
        assert_eq!((chain.drive.lag, chain.sensor.lag), (None, None), "{at}");
        for k in -20..=20 {
            let share = f64::from(k) / 20.0;
            assert_eq!(chain.drive.output_v(60.0 * share), nominal.drive.output_v(60.0 * share), "{at}");
            let reading_m = |chain: &Chain| chain.sensor.predictable_m(1e-4 * share, 0.3);
            assert_eq!(reading_m(&chain), reading_m(&nominal), "{at}");
        }
        // A nanometre: what the simulator promises where it must take sub-steps. Parts that are divided by are 1e-12 of the plant.
        for (k, (a, b)) in before.iter().zip(readings_m(&chain, 1e-5)).enumerate() {
            assert!((a - b).abs() < 1e-9, "{at}, row {k}: {a} became {b}");
        }
    }
}

#[test]
fn at_typical_size_every_form_changes_the_chain_and_none_undoes_another() {
    let plant = thesis().chain().plant;
    let nominal = thesis().chain();
    let scales = Scales { plant: &plant, ..sane::EXAMPLE };
    for (effect, form) in forms() {
        let alone = with(&nominal, form, &form.typical(&scales));
        assert_eq!(alone == nominal, form.kind == Kind::Start, "{} {}", effect.id(), form.name);
        for (other, other_form) in forms().filter(|(other, _)| other.id() != effect.id()) {
            let before = with(&nominal, other_form, &other_form.typical(&scales));
            let both = with(&before, form, &form.typical(&scales));
            assert_eq!(both == before, form.kind == Kind::Start, "{} on {}", effect.id(), other.id());
            let readings = (0..30).map(|k| both.drive.output_v(f64::from(k) * 4.0 - 60.0));
            assert!(readings.into_iter().all(f64::is_finite), "{} on {}", effect.id(), other.id());
        }
    }
}

/// A spring that bends, a stop or a magnet moves the place of rest; a start in equilibrium is there, and friction that holds nothing changes nothing.
#[test]
fn a_start_at_rest_rests_whatever_pushes_on_the_structure() {
    let nominal = thesis().chain();
    let scales = Scales { plant: &nominal.plant, ..sane::EXAMPLE };
    let mut moved = BTreeSet::new();
    for (effect, form) in forms() {
        let chain = with(&nominal, form, &form.typical(&scales));
        if chain.parts.forces.is_empty() {
            continue;
        }
        for drive_v in [-55.0, 20.0, 55.0] {
            let log =
                Log { dt_s: 5e-5, command_v: vec![drive_v; 400], displacement_m: vec![0.0; 400], ..Log::default() };
            let start = Start::at_rest(&chain, drive_v, vec![0.0; chain.plant.hysterons.len()]);
            let [low, high] = predict(&chain, &log, &start, 400)
                .into_iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], y| [low.min(y), high.max(y)]);
            // The place is found to a part in 1e10; a contact is followed in steps.
            assert!(high - low < 0.1e-9, "{} {} at {drive_v} V: {:e} m", effect.id(), form.name, high - low);
            let straight_m = chain.plant.equilibrium_m(chain.drive.output_v(drive_v), 0.0, &[]);
            if (start.state.displacement_m - straight_m).abs() > 1e-9 {
                moved.insert(effect.id());
            }
        }
    }
    let bent = ["nonlinear_stiffness", "asymmetric_stiffness", "end_stop"];
    assert!(bent.iter().all(|id| moved.contains(id)), "{moved:?}");
    assert!(!moved.contains("coulomb_friction"));
}

#[test]
fn lags_in_a_row_are_one_lag_with_the_same_delay() {
    use plant_sim::chain::Lag;
    let form = |id: &str, name: &str| {
        let effect = effects::find(id).expect("in the registry");
        effect.forms().iter().find(|form| form.name == name).expect("a form")
    };
    let mut chain = thesis().chain();
    (form("amplifier_bandwidth", "first-order").install)(&mut chain, &[2e-4]);
    (form("amplifier_bandwidth", "first-order").install)(&mut chain, &[3e-4]);
    let Some(Lag::Second { natural_rad_per_s: w, damping_ratio: z }) = chain.drive.lag else {
        panic!("{:?}", chain.drive.lag)
    };
    // (1 + 2e-4 s)(1 + 3e-4 s) = 1 + 5e-4 s + 6e-8 s^2.
    assert!((2.0 * z / w - 5e-4).abs() < 1e-15 && (1.0 / (w * w) - 6e-8).abs() < 1e-19);
}

#[test]
fn model_files_carry_every_form_without_loss() {
    let folder = std::env::temp_dir().join(format!("hysteron-effects-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let path = folder.join("augmented.toml");
    let plant = thesis().chain().plant;
    let hum = effects::find("mains_hum").expect("in the registry");
    for (effect, form) in forms() {
        for scales in rigs(&plant) {
            let values = form.typical(&scales);
            let params: Vec<Param> = values.iter().map(|v| Param::absolute(*v, 0.1 * v.abs(), "a \"test\"")).collect();
            // Behind another one, so that order counts.
            let model = thesis().with_effect(hum, &hum.forms()[0], &[]).with_effect(effect, form, &params);
            model.write(&path).expect("room on the disk");
            let read = Model::read(&path).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(read, model);
            // Logs of 16 microseconds or at 1 Hz may be warned of.
            if (1e-6..0.1).contains(&scales.sample_s) && scales.longest_s > 0.1 {
                assert_eq!(read.warnings(), Vec::<String>::new());
            }
            assert_eq!(read.chain(), with(&model_without_last(&model).chain(), form, &values));
            assert_eq!(read.nominal_chain(), thesis().chain());
        }
    }
    std::fs::remove_dir_all(&folder).expect("ours");
}

fn model_without_last(model: &Model) -> Model {
    let mut model = model.clone();
    model.effects.pop();
    model
}

#[test]
fn a_stated_start_may_leave_the_hysterons_of_effects_out() {
    let creep = effects::find("creep").expect("in the registry");
    let mut model = thesis().with_effect(creep, &creep.forms()[0], &[Param::assumed(0.02), Param::assumed(1.0)]);
    let mut start =
        InitialStateSection { displacement_um: 0.0, velocity_um_per_s: 0.0, hysteron_v: vec![7.0, -4.0], drive_v: 0.0 };
    model.initial_state = Some(start.clone());
    assert_eq!(model.start().state.hysteron_v, [7.0, -4.0, 0.0]);
    start.hysteron_v.push(0.5);
    model.initial_state = Some(start);
    assert_eq!(model.start().state.hysteron_v, [7.0, -4.0, 0.5]);
}

#[test]
fn files_with_an_effect_that_cant_be_are_refused_with_one_line() {
    let folder = std::env::temp_dir().join(format!("hysteron-bad-effects-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let path = folder.join("bad.toml");
    let nominal = std::fs::read_to_string(of_project("models/thesis-phs.toml")).expect("of the project");
    let kelvin_voigt = "id = \"creep\"\nform = \"kelvin-voigt\"\n[effect.parameters]\n";
    let time = "time_constant_s = { value = 1.0 }\n";
    let cases = [
        (
            "id = \"crep\"\nform = \"x\"\n".to_owned(),
            "effect[1].id is \"crep\", which is no known effect: did you mean \"creep\"? `hysteron effects` lists all",
        ),
        (
            "id = \"creep\"\nform = \"log\"\n".to_owned(),
            "effect[1].form is \"log\": creep has \"kelvin-voigt\", \"chain-of-2\", \"logarithmic\"",
        ),
        ("id = \"creep\"\n".to_owned(), "missing field `form`"),
        (
            format!("{kelvin_voigt}{time}"),
            "effect[1].parameters.stiffness_ratio is missing: creep in its form \"kelvin-voigt\" needs it",
        ),
        (
            format!("{kelvin_voigt}{time}ratio = {{ value = 0.1 }}\n"),
            "effect[1].parameters.ratio: creep in its form \"kelvin-voigt\" has no such parameter; it has: \
             stiffness_ratio, time_constant_s",
        ),
        (
            format!("{kelvin_voigt}{time}stiffness_ratio = {{ value = -0.1 }}\n"),
            "effect[1].parameters.stiffness_ratio is -0.1: it must lie between 0 and 0.5; correct it",
        ),
        (
            format!("{kelvin_voigt}{time}stiffness_ratio = {{ value = nan }}\n"),
            "effect[1].parameters.stiffness_ratio is NaN: it must lie between 0 and 0.5; correct it",
        ),
        (
            format!("{kelvin_voigt}stiffness_ratio = {{ value = 0.1 }}\ntime_constant_s = {{ value = 0.0 }}\n"),
            "effect[1].parameters.time_constant_s is 0.0: it must lie between ",
        ),
        (
            format!("{kelvin_voigt}{time}stiffness_ratio = {{ value = 0.1, sigma = -1.0 }}\n"),
            "effect[1].parameters.stiffness_ratio has sigma -1: it must not be negative",
        ),
        (
            "id = \"payload_mass\"\nform = \"rigid\"\n[effect.parameters]\nmass_ratio = { value = -1.5 }\n".to_owned(),
            "effect[1].parameters.mass_ratio is -1.5: it must lie between -0.2 and 5",
        ),
        (
            "id = \"initial_state\"\nform = \"start\"\n[effect.parameters]\nx = { value = 1.0 }\n".to_owned(),
            "effect[1].parameters.x: initial_state in its form \"start\" has no such parameter; it has: none",
        ),
    ];
    for (section, expected) in cases {
        std::fs::write(&path, format!("{nominal}\n[[effect]]\n{section}")).expect("room on the disk");
        let error = Model::read(&path).expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}\nand not {expected}");
        assert!(error.contains("bad.toml") && !error.contains('\n'), "{error}");
    }
    // Too many hysterons in all.
    let element = "[[effect]]\nid = \"creep\"\nform = \"logarithmic\"\n[effect.parameters]\nstiffness_ratio = { value = 0.1 }\n\
                   time_constant_s = { value = 0.1 }\ntime_constant_ratio = { value = 10.0 }\n";
    std::fs::write(&path, format!("{nominal}\n{}", element.repeat(9))).expect("room on the disk");
    let error = Model::read(&path).expect_err("too many").to_string();
    assert!(error.contains("38 hysterons with those of the effects; at most "), "{error}");
    // A delay in microseconds where seconds are meant is possible, and looks wrong.
    let delay =
        "[[effect]]\nid = \"transport_delay\"\nform = \"pure\"\n[effect.parameters]\ndelay_s = { value = 250.0 }\n";
    std::fs::write(&path, format!("{nominal}\n{delay}")).expect("room on the disk");
    assert_eq!(
        Model::read(&path).expect("possible").warnings(),
        ["effect[1].parameters.delay_s = 2.5e2 is outside 0 .. 1 s: check its unit"]
    );
    // What belongs to single logs needn't be stated.
    std::fs::write(&path, format!("{nominal}\n[[effect]]\nid = \"mains_hum\"\nform = \"50 Hz\"\n"))
        .expect("room on the disk");
    assert_eq!(Model::read(&path).expect("complete").chain().sensor.lines.len(), 5);
    std::fs::remove_dir_all(&folder).expect("ours");
}
