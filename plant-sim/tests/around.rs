//! Linear regions of whole chains: what stands beside the plant moves as the simulator says it does, and counts in the margins.

use crate::margins::thesis_plant;
use nalgebra::{DMatrix, DVector};
use plant_sim::chain::{Arm, Chain, Drive, Joint, Lag, Late, Mode, Parts, Relaxation, Sensor};
use plant_sim::effects::find_form;
use plant_sim::linear::TransferFunction;
use plant_sim::log::{Hold, Log};
use plant_sim::margins::{LinearRegion, Loop, assess, margins};
use plant_sim::model::Model;
use plant_sim::phs::Hysteron;
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

const RATE_HZ: f64 = 20e3;
const PI_1: Loop = Loop { kp_v_per_m: 8.5811e5, ki_v_per_m_s: 9.6755e8, rate_hz: RATE_HZ, delay_s: 10e-6 };

/// The thesis' plant and nothing beside it.
fn thesis() -> Chain {
    Chain { drive: Drive::IDEAL, plant: thesis_plant(), parts: Parts::default(), sensor: Sensor::IDEAL }
}

fn mode(hz: f64, damping_ratio: f64, joint: Joint) -> Parts {
    Parts { modes: vec![Mode { hz, damping_ratio, joint }], ..Parts::default() }
}

fn parallel(share: f64) -> Joint {
    Joint::Parallel { compliance_m_per_n: share / 24579.0 }
}

const FIRST: Lag = Lag::First { time_constant_s: 3e-4 };
const SECOND: Lag = Lag::Second { natural_rad_per_s: TAU * 700.0, damping_ratio: 0.6 };

/// Chains with one thing or several beside a plant.
fn chains() -> Vec<(&'static str, Chain)> {
    let of = |parts: Parts| Chain { parts, ..thesis() };
    let seen = |sensor: Sensor| Chain { sensor, ..thesis() };
    let driven = |drive: Drive| Chain { drive, ..thesis() };
    let arm = Arm { share: 0.3, rate_share: 0.1, hz: 900.0, damping_ratio: 0.05 };
    let late = Some(Late { share: 0.3, time_constant_s: 4e-3 });
    let both = mode(2600.0, 0.02, parallel(-0.05))
        .modes
        .into_iter()
        .chain(mode(1500.0, 0.03, Joint::Attached { mass_kg: 2e-4 }).modes);
    vec![
        ("nothing", thesis()),
        ("parallel mode", of(mode(3000.0, 0.02, parallel(0.1)))),
        ("attached mode", of(mode(1200.0, 0.02, Joint::Attached { mass_kg: 3e-4 }))),
        ("arm", of(Parts { arms: vec![arm], ..Parts::default() })),
        ("creep", of(Parts { creep: vec![Relaxation::even(0.2, 0.05)], ..Parts::default() })),
        ("sensor of first order", seen(Sensor { lag: Some(FIRST), gain: 1.2, ..Sensor::IDEAL })),
        ("sensor of second order", seen(Sensor { lag: Some(SECOND), ..Sensor::IDEAL })),
        ("amplifier of first order", driven(Drive { lag: Some(FIRST), gain: 0.8, ..Drive::IDEAL })),
        ("amplifier of second order", driven(Drive { lag: Some(SECOND), late, ..Drive::IDEAL })),
        (
            "all at once",
            Chain {
                drive: Drive { lag: Some(SECOND), gain: 1.1, ..Drive::IDEAL },
                parts: Parts { modes: both.collect(), arms: vec![arm], ..Parts::default() },
                sensor: Sensor { lag: Some(FIRST), gain: 0.9, ..Sensor::IDEAL },
                ..thesis()
            },
        ),
    ]
}

/// `e^(A t)` and what a held volt adds, by one exponential.
fn sampled(region: &LinearRegion) -> (DMatrix<f64>, DVector<f64>) {
    let n = region.a.nrows();
    let mut matrix = DMatrix::zeros(n + 1, n + 1);
    matrix.view_mut((0, 0), (n, n)).copy_from(&region.a);
    matrix.view_mut((0, n), (n, 1)).copy_from(&region.b);
    let exponential = (matrix / RATE_HZ).exp();
    (exponential.view((0, 0), (n, n)).into_owned(), exponential.view((0, n), (n, 1)).column(0).into_owned())
}

/// Readings of `chain` under these volts, and of its region.
fn both(chain: &Chain, region: &LinearRegion, volts: &[f64]) -> [Vec<f64>; 2] {
    let mut log = Log { dt_s: RATE_HZ.recip(), command_v: volts.to_vec(), ..Log::default() };
    log.displacement_m = vec![0.0; volts.len()];
    log.meta.hold = Hold::Zoh;
    let simulated = predict(chain, &log, &Start::relaxed(chain), log.len());
    let (transition, input) = sampled(region);
    let mut x = DVector::zeros(region.a.nrows());
    let mut acting_v = 0.0;
    let read = |volts: &f64| {
        let seen = (&region.c * &x)[0] + region.d * acting_v;
        x = &transition * &x + &input * *volts;
        acting_v = *volts;
        seen
    };
    [simulated, volts.iter().map(read).collect()]
}

fn apart(of: &[Vec<f64>; 2]) -> f64 {
    let largest = of[0].iter().fold(0.0f64, |most, y| most.max(y.abs()));
    of[0].iter().zip(&of[1]).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max) / largest
}

#[test]
fn regions_move_as_the_simulator_does() {
    // 1 V opens no dead zone of 5 V either way: the region with none active.
    let volts: Vec<f64> = (0..2000).map(|k| if k < 300 { 1.0 } else { (0.03 * f64::from(k)).sin() }).collect();
    for (name, chain) in chains() {
        let region = chain.linear_regions().expect("regions").pop().expect("the last");
        let apart = apart(&both(&chain, &region, &volts));
        // Creep follows the mean of a sample's ends, an arm the cubic through them; what an amplifier makes within a sample acts as a parabola of
        // the same moments. The rest is rounding.
        let most = match name {
            "creep" | "arm" | "all at once" => 2e-3,
            "amplifier of first order" | "amplifier of second order" => 1e-8,
            _ => 1e-10,
        };
        assert!(apart < most, "{name}: {apart:e}");
    }
    let lead = TransferFunction { numerator: vec![1.5e-6, 1.9e-3], denominator: vec![1.0, 1e3] };
    let chain = Model::of_transfer_function("lead", &lead, "made").chain();
    let region = chain.linear_regions().expect("regions").pop().expect("itself");
    assert!(region.d > 0.0 && apart(&both(&chain, &region, &volts)) < 1e-9);
}

/// Spectral radii that another program has found of the same loops, to four digits: the largest over all regions.
#[test]
fn what_stands_beside_the_plant_counts_in_the_margins() {
    let radius = |chain: &Chain| {
        let regions = chain.linear_regions().expect("regions");
        regions.iter().map(|region| margins(region, &PI_1).expect("a loop").spectral_radius).fold(0.0, f64::max)
    };
    let lag = |hz: f64| Some(Lag::First { time_constant_s: 1.0 / (TAU * hz) });
    let driven = |hz: f64| Chain { drive: Drive { lag: lag(hz), ..Drive::IDEAL }, ..thesis() };
    let with = |hz: f64, share: f64| Chain { parts: mode(hz, 0.02, parallel(share)), ..thesis() };
    let louder =
        Chain { drive: Drive { gain: 1.5, ..Drive::IDEAL }, sensor: Sensor { gain: 1.5, ..Sensor::IDEAL }, ..thesis() };
    let cases = [
        ("nothing", thesis(), 0.9887),
        ("an amplifier of 800 Hz", driven(800.0), 1.0075),
        ("an amplifier of 1 kHz", driven(1000.0), 1.0096),
        ("an amplifier of 300 Hz", driven(300.0), 0.9887),
        ("a mode of 3 kHz", with(3000.0, 0.1), 1.036),
        ("a mode of 2 kHz", with(2000.0, 0.05), 1.006),
        ("gains of 1.5", louder, 1.0047),
    ];
    for (name, chain, other) in cases {
        let ours = radius(&chain);
        assert!((ours - other).abs() < 6e-4, "{name}: {ours} {other}");
    }
}

/// Kp D is 1.29: each sample turns over what the one before has read.
#[test]
fn feedthrough_closes_a_loop_of_its_own() {
    let lead = TransferFunction { numerator: vec![1.5e-6, 1.9e-3], denominator: vec![1.0, 1e3] };
    let chain = Model::of_transfer_function("lead", &lead, "made").chain();
    let regions = chain.linear_regions().expect("itself");
    let found = margins(&regions[0], &PI_1).expect("a loop");
    assert!(!found.stable && found.spectral_radius > 1.2, "{found}");
    // With less gain it holds, and the margin says how much less: an eigenvalue on the circle.
    let gain = 10f64.powf(found.gain_margin_db / 20.0);
    let at = |factor: f64| {
        let law = Loop { kp_v_per_m: PI_1.kp_v_per_m * factor, ki_v_per_m_s: PI_1.ki_v_per_m_s * factor, ..PI_1 };
        assess(&regions, &law).expect("a loop").regions[0].spectral_radius
    };
    assert!(at(0.999 * gain) < 1.0 && at(1.001 * gain) > 1.0, "{gain}");
}

/// The thesis' plant with an effect of the registry.
fn with_effect(id: &str, form: &str, values: &[f64]) -> Chain {
    let (_, form) = find_form(id, form).expect("of the registry");
    let mut chain = thesis();
    (form.install)(&mut chain, values);
    chain
}

#[test]
fn a_hysteresis_of_the_voltage_leaves_the_hysterons_their_regions() {
    let bare = assess(&thesis().linear_regions().expect("regions"), &PI_1).expect("a loop");
    for share in [0.05, -0.05] {
        let both =
            with_effect("extra_hysteron", "plays-of-the-voltage", &[share, 60.0]).linear_regions().expect("regions");
        let labels: Vec<&str> = both.iter().map(|region| region.label.as_str()).collect();
        assert_eq!(labels.len(), 8, "{labels:?}");
        assert_eq!(labels[0], "hysteresis, least slope, hysterons 1, 2 active");
        assert_eq!(labels[7], "hysteresis, greatest slope, no hysteron active");
        // Before any play moves, and where all of them are taken along, the drive acts as it does alone, or more weakly, or more strongly.
        let found = assess(&both, &PI_1).expect("a loop");
        assert!(found.gain_margin_db.value <= bare.gain_margin_db.value + 1e-9, "{share}: {found}");
    }
}

#[test]
fn the_largest_gain_of_a_drive_counts() {
    let of = |chain: &Chain| chain.linear_regions().expect("regions")[0].b[1];
    let plain = of(&thesis());
    let mut growing = with_effect("amplifier_gain", "growing", &[1e-3]);
    growing.drive.range_v = [-80.0, 90.0];
    let cases = [
        ("about zero", with_effect("amplifier_gain", "about-zero", &[0.3, 10.0]), 1.3),
        ("but about zero", with_effect("amplifier_gain", "about-zero", &[-0.3, 10.0]), 1.0),
        ("by polarity", with_effect("amplifier_gain", "by-polarity", &[-0.1]), 1.1),
        ("growing to 90 V", growing, 1.18),
        ("curved, to 60 V where nothing limits it", with_effect("asymmetric_hysteresis", "drive", &[-1e-3]), 1.12),
        ("one-sided", with_effect("asymmetric_hysteresis", "drive-one-sided", &[0.2, 59.9]), 1.2),
    ];
    for (name, chain, gain) in cases {
        let found = of(&chain) / plain;
        assert!((found - gain).abs() < 1e-6, "{name}: {found}");
    }
    let margin_db =
        |chain: &Chain| assess(&chain.linear_regions().expect("regions"), &PI_1).expect("a loop").gain_margin_db;
    let steeper = with_effect("amplifier_gain", "about-zero", &[0.3, 10.0]);
    let lost_db = margin_db(&thesis()).value - margin_db(&steeper).value;
    assert!((lost_db - 20.0 * 1.3f64.log10()).abs() < 1e-6, "{lost_db}");
}

#[test]
fn a_plant_that_loses_samples_is_not_bare() {
    assert!(thesis().is_bare());
    let with = |id: &str, form: &str, value: f64| with_effect(id, form, &[value]);
    for (id, form) in [("lost_samples", "repeated"), ("lost_samples", "held-command"), ("sampling_jitter", "white")] {
        assert!(!with(id, form, 1e-6).is_bare(), "{id}, {form}");
        assert!(with(id, form, 0.0).is_bare(), "{id}, {form}");
    }
}

#[test]
fn only_what_opens_and_shuts_doubles_the_regions() {
    let mut plant = thesis_plant();
    let element = |slope_s: f64, dead_zone_v: f64| Hysteron { capacitance_f: 6e-6, slope_s, dead_zone_v };
    plant.hysterons.push(element(1e-6, 0.0));
    let labels = |regions: &[LinearRegion]| regions.iter().map(|region| region.label.clone()).collect::<Vec<_>>();
    let creeping = plant.linear_regions().expect("regions");
    // Creep is always active.
    let expected = ["hysterons 1, 2, 3 active", "hysterons 2, 3 active", "hysterons 1, 3 active", "hysteron 3 active"];
    assert_eq!(labels(&creeping), expected);
    // What never leaks is a spring, and no error.
    plant.hysterons.push(element(0.0, 10.0));
    let sprung = plant.linear_regions().expect("regions");
    assert_eq!(labels(&sprung), expected);
    let stiffness = |region: &LinearRegion| -region.a[(1, 0)] * plant.mass_kg;
    let spring = plant.transduction_c_per_m.powi(2) / 6e-6;
    for (with, without) in sprung.iter().zip(&creeping) {
        assert_eq!(with.a.nrows(), without.a.nrows());
        // A difference of tens of kN/m: a few roundings of these.
        assert!((stiffness(with) - stiffness(without) - spring).abs() < 1e-9 * spring, "{}", with.label);
    }
    // A spectrum of creep is no reason to refuse a plant.
    plant.hysterons.extend([element(1e-6, 0.0); 14]);
    assert_eq!(plant.linear_regions().expect("regions").len(), 4);
}
