//! SPECs as they are played: lengths, shaping, files, and that every kind starts where it says.

use plant_sim::chain::{Chain, Drive, Parts, Sensor};
use plant_sim::experiment::{Program, Recording, Setup, open_loop};
use plant_sim::phs::Phs;
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::f64::consts::TAU;

const RATE_HZ: f64 = 10e3;

/// What an open loop commands: the SPEC's own samples.
fn played(text: &str, samples: usize) -> Vec<f64> {
    record(text, samples).command_v
}

fn record(text: &str, samples: usize) -> Recording {
    let plant = Phs {
        mass_kg: 1e-3,
        damping_n_s_per_m: 5.0,
        stiffness_n_per_m: 2.5e4,
        transduction_c_per_m: 0.05,
        hysterons: Vec::new(),
    };
    let chain = Chain { drive: Drive::IDEAL, plant, parts: Parts::default(), sensor: Sensor::IDEAL };
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples, latency_s: 0.0, seed: 1 };
    open_loop(&setup, &program(text), &|_| {}).unwrap_or_else(|e| panic!("{text}: {e}"))
}

fn program(text: &str) -> Program {
    let spec = Spec::parse(text).unwrap_or_else(|e| panic!("{e}"));
    Program::new(&spec, RATE_HZ).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn every_kind_plays_what_it_says() {
    let turns = |k: usize, hz: f64| hz * k as f64 / RATE_HZ;
    type Wave = Box<dyn Fn(usize) -> f64>;
    let cases: [(&str, Wave); 10] = [
        ("zero@0.1s", Box::new(|_| 0.0)),
        ("hold:40V@0.1s", Box::new(|_| 40.0)),
        ("step:-40V", Box::new(|_| -40.0)),
        ("square:40V@50Hz", Box::new(move |k| if turns(k, 50.0).fract() < 0.5 { 40.0 } else { -40.0 })),
        ("sine:40V@50Hz", Box::new(move |k| 40.0 * (TAU * turns(k, 50.0)).sin())),
        (
            "triangle:40V@50Hz",
            Box::new(move |k| {
                let t = turns(k, 50.0).fract();
                40.0 * if t < 0.25 {
                    4.0 * t
                } else if t < 0.75 {
                    2.0 - 4.0 * t
                } else {
                    4.0 * t - 4.0
                }
            }),
        ),
        (
            "ladder:40V/4,hold=10ms",
            Box::new(|k| {
                let level = [1, 2, 3, 4, 3, 2, 1, 0][(k / 100).min(7)];
                10.0 * f64::from(level)
            }),
        ),
        (
            "minor-loops:40V@50Hz",
            Box::new(move |k| {
                let t = turns(k, 50.0);
                40.0 * [1.0, 0.75, 0.5, 0.25][(t / 2.0) as usize] * (TAU * t).sin()
            }),
        ),
        (
            "decaying-sine:40V@100Hz/0.08s",
            Box::new(move |k| 40.0 * (1.0 - k as f64 / 800.0) * (TAU * turns(k, 100.0)).sin()),
        ),
        (
            "sweep:40V@10-500Hz/0.1s",
            Box::new(|k| {
                let t = k as f64 / RATE_HZ;
                40.0 * (TAU * (10.0 * t + 490.0 * t * t / 0.2)).sin()
            }),
        ),
    ];
    for (text, wave) in cases {
        let samples = 800;
        let worst = played(text, samples).iter().enumerate().fold(0.0f64, |m, (k, v)| m.max((v - wave(k)).abs()));
        // The board's generator is f32 with a 32-bit phase: a frequency in f32 and the step of the phase are off by 6e-8 and by 2.3e-10 of
        // a turn per sample, 1.2e-6 of a turn after 800 samples at 250 Hz, which is 7e-6 of the amplitude.
        assert!(worst < 40.0 * 1e-5, "{text}: {worst}");
    }
}

#[test]
fn a_sequence_is_as_long_as_its_parts() {
    let program = program("zero@5ms+sine:20V@100Hz/20ms+hold:3V,for=1ms+minor-loops:5V@100Hz");
    // 50 + 200 + 10 samples, and four loops of two periods of 100 samples.
    assert_eq!(program.samples(), Some(50 + 200 + 10 + 800));
    let samples = played("zero@5ms+sine:20V@100Hz/20ms+hold:3V,for=1ms+hold:4V", 262);
    assert!(samples[..50].iter().all(|v| *v == 0.0) && samples[75] > 19.99);
    assert_eq!(samples[249..262], [samples[249], 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0, 4.0]);
}

#[test]
fn a_length_limits_a_multisine_in_a_sequence() {
    // Two realisations of two periods of 100 samples are 400; 25 ms have room for one and a quarter of the other.
    let all = played("multisine:20V@100-2000Hz,periods=2,realisations=2,seed=4", 400);
    let cut = played("multisine:20V@100-2000Hz,periods=2,realisations=2,seed=4,for=25ms+hold:7V", 300);
    assert_eq!(cut[..250], all[..250]);
    assert!(cut[250..].iter().all(|v| *v == 7.0));
    assert!(all[..100] == all[100..200] && all[..100] != all[200..300]);
    let peak = all[..100].iter().fold(0.0f64, |m, v| m.max(v.abs()));
    assert!((peak - 20.0).abs() < 20.0 * 1e-6);
}

#[test]
fn shaping_bounds_a_step_and_leaves_a_file_its_amplitude() {
    // 1e5 V/s and 1e8 V/s^2: 10 V per sample, and 1 V per sample more from one to the next; f32 rounds within 1e-5 V.
    let shaped = played("step:60V,shaped", 200);
    assert_eq!(shaped[199], 60.0);
    let steps: Vec<f64> = shaped.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(
        steps.iter().all(|s| s.abs() <= 10.0 + 1e-4) && steps.windows(2).all(|p| (p[1] - p[0]).abs() <= 1.0 + 1e-4)
    );
    assert!(shaped[0] < 60.0);

    // A file's amplitude is its unit, 1 V; its samples reach 60.
    let folder = std::env::temp_dir().join(format!("hysteron-spec-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let path = folder.join("wave.txt");
    let text = "# volts\nvolts\n".to_owned() + &"60\n".repeat(200);
    std::fs::write(&path, text).expect("a file there");
    let from_file = played(&format!("file:{},unit=V,shaped", path.display()), 200);
    std::fs::remove_dir_all(&folder).expect("it is ours");
    assert_eq!(from_file, shaped);
}

#[test]
fn the_same_seed_gives_the_same_phases() {
    let wave = |seed: u32| played(&format!("multisine:20V@100-2000Hz,odd,seed={seed}"), 100);
    assert_eq!(wave(7), wave(7));
    assert!(wave(7) != wave(8));
}

#[test]
fn a_length_is_that_of_the_samples_played() {
    // At 10 kHz a hold of 0.26 ms is 3 samples and not 2.6.
    let spec = "ladder:60V/100,hold=0.26ms";
    assert_eq!(program(spec).samples(), Some(600));
    // Half a sample of each part is no half sample of all.
    assert_eq!(program("hold:1V@0.25ms+hold:2V@0.25ms+hold:3V@0.25ms").samples(), Some(9));
    assert_eq!(program("hold:1V@1ms+hold:2V").samples(), None);
    let samples = played(spec, 601);
    assert_eq!((samples[299], samples[300], samples[596], samples[597]), (60.0, samples[294], samples[594], 0.0));
}

/// Two periods of each loop are 20 ms: the last one takes what is left, so that what follows comes when it should.
#[test]
fn the_last_of_minor_loops_goes_on_until_their_end() {
    let spec = "minor-loops:40V@100Hz,for=0.2s+hold:3V,for=1ms";
    assert_eq!(program(spec).samples(), Some(2010));
    let samples = played(spec, 2010);
    assert!(samples[2000..].iter().all(|v| *v == 3.0));
    // A crest of the last loop, and one long after its two periods; f32 rounds the phase within 1e-5 of the amplitude.
    assert!((samples[625] - 10.0).abs() < 1e-3 && (samples[1925] - 10.0).abs() < 1e-3);
}

#[test]
fn what_goes_with_its_length_has_one() {
    for (text, sign) in [
        ("sweep:20V@1-2000Hz/4s,for=2s", '/'),
        ("decaying-sine:60V@8Hz/2s,for=1s", '/'),
        ("sine:20V@10Hz/4s,for=2s", '/'),
        ("multisine:20V@10-2000Hz/4s,for=2s", '/'),
        ("minor-loops:20V@10Hz/4s,for=2s", '/'),
        ("zero@5s,for=2s", '@'),
        ("hold:20V@5s,for=2s", '@'),
    ] {
        let line = Spec::parse(text).expect_err(text).to_string();
        assert!(line.contains(&format!("takes the time behind `{sign}`")) && !line.contains('\n'), "{line}");
    }
    for text in
        ["sine:20V@10Hz,for=2s", "decaying-sine:60V@8Hz,for=1s", "multisine:20V@10-2000Hz,for=2s", "zero,for=2s"]
    {
        assert!(Spec::parse(text).is_ok(), "{text}");
    }
}
