//! Design from a wish, its check, and what the inverse feedforward gains in tracking.

use control_core::Settings;
use plant_sim::chain::{Chain, Lag};
use plant_sim::controller::{Controller, InverseSection};
use plant_sim::design::{Design, DesignError, Frame, LowestRate, Peak, Wish, check, design, tracking};
use plant_sim::margins::Verdict;
use plant_sim::model::Model;
use std::path::Path;

const RATE_HZ: f64 = 40e3;
const DELAY_S: f64 = 10e-6;

fn model() -> Model {
    Model::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml")).expect("the thesis' plant")
}

fn controller(name: &str) -> Controller {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../controllers").join(name);
    Controller::read(&path).expect("a controller of the project")
}

const WISH: Wish =
    Wish { settling_s: 5e-3, overshoot_percent: 2.0, step_m: 80e-6, gain_margin_db: 6.0, phase_margin_deg: 40.0 };

fn frame<'a>(chain: &'a Chain, controller: &Controller, rate_hz: f64) -> Frame<'a> {
    Frame { chain, settings: controller.settings(rate_hz), delay_s: DELAY_S, inverse: None }
}

fn own(chain: &Chain) -> (Controller, Design) {
    let mut own = controller("pi1.toml");
    let found = design(&frame(chain, &own, RATE_HZ), &WISH).expect("a modest wish");
    own.kp_v_per_m.value = found.placement.kp_v_per_m;
    own.ki_v_per_m_s.value = found.placement.ki_v_per_m_s;
    (own, found)
}

#[test]
fn a_wish_is_met_and_an_impossible_one_says_what_is_possible() {
    let chain = model().chain();
    let (_, found) = own(&chain);
    assert!(found.step.settle_2_percent_ms.expect("settles") <= 5.0 && found.step.overshoot_percent.unwrap() <= 2.0);
    assert!(found.assessment.gain_margin_db.value >= 6.0 && found.assessment.phase_margin_deg.value >= 40.0);
    let settings = controller("pi1.toml");
    let hasty = Wish { settling_s: 2e-4, ..WISH };
    let error = design(&frame(&chain, &settings, RATE_HZ), &hasty).expect_err("faster than the shaping");
    assert!(matches!(error, DesignError::TooFast { .. }), "{error}");
    let timid = Wish { gain_margin_db: 40.0, ..WISH };
    assert!(matches!(design(&frame(&chain, &settings, RATE_HZ), &timid), Err(DesignError::NoMargin { .. })));
}

#[test]
fn the_check_finds_the_edges() {
    let (model, controller) = (model(), controller("pi1.toml"));
    let chain = model.chain();
    let at = |rate_hz: f64, delay_s: f64| {
        let frame = Frame { delay_s, ..frame(&chain, &controller, rate_hz) };
        check(&frame, &model).expect("checked")
    };
    let found = at(20e3, DELAY_S);
    let (delay_s, lowest) = (found.largest_delay_s.expect("stable"), found.lowest_rate.expect("stable"));
    let LowestRate::Edge(rate_hz) = lowest else { panic!("{lowest:?}") };
    // One per mille either side of what it says: stable and not.
    let is_stable =
        |rate_hz: f64, delay_s: f64| !matches!(at(rate_hz, delay_s).assessment.verdict, Verdict::Unstable { .. });
    assert!(is_stable(20e3, 0.999 * delay_s) && !is_stable(20e3, 1.001 * delay_s), "{delay_s}");
    assert!(is_stable(1.001 * rate_hz, DELAY_S) && !is_stable(0.999 * rate_hz, DELAY_S), "{rate_hz}");
    // A search that ends at its own end says so: this one is stable down to 180 Hz.
    let slow = frame(&chain, &self::controller("pi2.toml"), 100e3);
    let lowest = check(&slow, &model).expect("checked").lowest_rate;
    assert!(matches!(lowest, Some(LowestRate::AtMost(hz)) if hz < 1021.0), "{lowest:?}");
    // Twice the guard's own promise would be a bender in pieces.
    let worst = &found.peaks[0];
    assert!(worst.peak_m > 100e-6 && worst.peak_m < 130e-6, "{worst:?}");
    assert!(found.peaks.windows(2).all(|pair| pair[0].peak_m >= pair[1].peak_m));
}

#[test]
fn scenarios_last_as_long_as_the_loop_takes() {
    let (model, controller) = (model(), controller("pi2.toml"));
    let chain = model.chain();
    let peaks = |rate_hz: f64, reference_rate_m_per_s: f32| {
        let plain = frame(&chain, &controller, rate_hz);
        let settings = Settings { reference_rate_m_per_s, ..plain.settings };
        check(&Frame { settings, ..plain }, &model).expect("checked").peaks
    };
    let step = |peaks: &[Peak]| {
        let of = |peak: &&Peak| peak.plant == "nominal" && peak.scenario.starts_with("step to 100 um");
        peaks.iter().find(of).cloned().expect("a step")
    };
    // 100 um take 0.2 s; in the first 0.06 s it would have come to 30 um.
    let slow = step(&peaks(5e3, 5e-4));
    assert!(slow.peak_m > 99e-6 && slow.scenario == "step to 100 um", "{slow:?}");
    // 20 s and more, of which 10 s are run.
    let slower = step(&peaks(1e3, 5e-6));
    assert!(slower.peak_m > 45e-6 && slower.peak_m < 55e-6, "{slower:?}");
    assert_eq!(slower.scenario, "step to 100 um, the first 10 s of 20 s");
}

#[test]
fn a_slow_loop_is_asked_what_it_can_sample() {
    let (model, controller) = (model(), controller("pi2.toml"));
    let chain = model.chain();
    let slow = frame(&chain, &controller, 250.0);
    let found = check(&slow, &model).expect("checked");
    assert!(!found.peaks.is_empty() && found.peaks.iter().all(|peak| !peak.scenario.contains("150 Hz")), "{found:?}");
    let errors = tracking(&slow).expect("run");
    assert!(errors[..4].iter().all(|error| error.is_finite()) && errors[4].is_nan(), "{errors:?}");
}

#[test]
fn inverting_the_hysterons_pays_in_tracking() {
    let chain = model().chain();
    let (own, _) = own(&chain);
    let errors = |controller: &Controller| tracking(&frame(&chain, controller, RATE_HZ)).expect("run");
    let with_inverse = |of: &Chain, on: &Chain| {
        let mut inverted = own.clone();
        inverted.inverse = Some(InverseSection::of(of, "test"));
        let inverse = inverted.inverse(RATE_HZ, DELAY_S).expect("few hysterons");
        tracking(&Frame { inverse: inverse.as_ref(), ..frame(on, &inverted, RATE_HZ) }).expect("run")
    };
    let plain = errors(&own);
    let inverted = with_inverse(&chain, &chain);
    for (error, aim) in inverted.iter().zip([0.1, 0.3, 1.0, 2.0, 3.0]) {
        assert!(*error <= aim, "{inverted:?}");
    }
    // Twice better from 10 Hz on, or the inverse isn't worth its code.
    assert!(
        plain.iter().zip(&inverted).skip(1).all(|(plain, inverted)| *inverted < 0.5 * plain),
        "{plain:?} {inverted:?}"
    );
    // An amplifier's lag that nobody knows of, and the same once it is in the plant.
    let mut lagged = chain.clone();
    lagged.drive.lag = Some(Lag::First { time_constant_s: 1.0 / (std::f64::consts::TAU * 800.0) });
    let [before, after] = [with_inverse(&chain, &lagged), with_inverse(&lagged, &lagged)];
    assert!(after[4] < 0.5 * before[4], "{before:?} {after:?}");
}
