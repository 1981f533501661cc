//! Power balance of chains with physical parts: stored + dissipated = supplied.

use super::rival::{SAMPLE_S, chain, lively, with_force};
use plant_sim::chain::power::{Snapshot, dissipated_w, stored_j};
use plant_sim::chain::{Bend, BendLaw, Chain, Force, Held, Joint, Mode, Parts, Simulator};
use plant_sim::phs::PhsState;

/// Sub-samples of 0.5 us: trapezoids then miss what the fast hysteron's 0.94 us makes of a corner, which is little of the whole.
const PARTS: usize = 100;
/// In parts of all energy that the drive moved in or out: measured 1e-6 at most, and 1.1e-4 where the fast hysteron's edge moves with the
/// speed.
const BAR: f64 = 3e-6;
const BAR_WIDENING: f64 = 3e-4;

#[test]
fn stored_plus_dissipated_equals_supplied() {
    let bend =
        |i, law| Chain { parts: Parts { bends: vec![Bend { hysteron: Some(i), law }], ..Parts::default() }, ..chain() };
    let mode = Mode { joint: Joint::Attached { mass_kg: 5e-5 }, hz: 2000.0, damping_ratio: 0.02 };
    let widening = BendLaw::Widening { share: 0.1, reference_v_per_s: 1e4 };
    let power = |exponent| Force::Power { force_n: 0.1, reference_m_per_s: 0.1, exponent };
    let chains = [
        ("nominal", chain()),
        ("attached", Chain { parts: Parts { modes: vec![mode], ..Parts::default() }, ..chain() }),
        ("spring", with_force(Force::Spring { quadratic_n_per_m2: 2e7, cubic_n_per_m3: 3e11 })),
        ("fourth power", with_force(Force::Fourth { fourth_n_per_m4: 1e15 })),
        ("fifth power", with_force(Force::Fifth { fifth_n_per_m5: 3e19 })),
        ("one-sided", with_force(Force::OneSided { stiffness_n_per_m: 3000.0 })),
        ("stop", with_force(Force::Stop { at_m: -70e-6, stiffness_n_per_m: 5e5, damping_s_per_m: 0.0 })),
        ("damped", with_force(Force::Stop { at_m: 60e-6, stiffness_n_per_m: 1e5, damping_s_per_m: 20.0 })),
        ("pad, round", with_force(Force::Pad { at_m: 60e-6, stiffness_n_per_m: 1e5, exponent: 1.5 })),
        ("pad, harder", with_force(Force::Pad { at_m: -60e-6, stiffness_n_per_m: 2e3, exponent: 2.5 })),
        ("gradual", with_force(Force::Gradual { stiffness_n_per_m: 3000.0, at_m: 10e-6, width_m: 15e-6 })),
        ("presliding", with_force(Force::Presliding { coulomb_n: 0.1, presliding_m: 2e-6 })),
        ("slider", with_force(Force::Slider { coulomb_n: 0.1, slip_m: 2e-6 })),
        ("on a part", with_force(Force::Patch { coulomb_n: 0.1, slip_m: 2e-6, at_m: 5e-6, half_width_m: 3e-5 })),
        ("detent", with_force(Force::Detent { period_m: 7e-5, sin_n: 0.05, cos_n: 0.02 })),
        ("tanh", with_force(Force::Smooth { coulomb_n: 0.1, speed_m_per_s: 1e-3 })),
        ("power 0.3", with_force(power(0.3))),
        ("power 2", with_force(power(2.0))),
        ("capacitance skew, fast", bend(0, BendLaw::CapacitanceSkew(0.2))),
        ("capacitance skew, slow", bend(1, BendLaw::CapacitanceSkew(0.2))),
        ("slope skew", bend(1, BendLaw::SlopeSkew(0.3))),
        ("exponent 2, fast", bend(0, BendLaw::Exponent(2.0))),
        ("exponent 0.5, slow", bend(1, BendLaw::Exponent(0.5))),
        ("eased, slow", bend(1, BendLaw::Easing { share: 2.0, reference_m_per_s: 0.05 })),
        ("widening, fast", bend(0, widening)),
        ("widening, slow", bend(1, widening)),
    ];
    let command_v = lively();
    let mut failed = Vec::new();
    for (name, chain) in chains {
        let step_s = SAMPLE_S / PARTS as f64;
        let mut simulator = Simulator::new(&chain, step_s, 0.0);
        let alpha = chain.plant.transduction_c_per_m;
        let presliding =
            chain.parts.forces.iter().any(|force| matches!(force, Force::Presliding { .. } | Force::Patch { .. }));
        let (mut supplied_j, mut exchanged_j, mut dissipated_j) = (0.0, 0.0, 0.0);
        let mut before = simulator.snapshot();
        let mut before_w = 0.0;
        for &volts in &command_v {
            let sample_from_m = before.plant.displacement_m;
            for _ in 0..PARTS {
                simulator.advance(Held::zero_order(volts), 0.0);
                before = simulator.snapshot();
                let now_w = dissipated_w(&chain, &before);
                assert!(presliding || now_w >= 0.0, "{name}: {now_w:e} W");
                dissipated_j += 0.5 * step_s * (before_w + now_w);
                before_w = now_w;
            }
            let given_j = alpha * volts * (before.plant.displacement_m - sample_from_m);
            supplied_j += given_j;
            exchanged_j += given_j.abs();
        }
        let imbalance = (stored_j(&chain, &before) + dissipated_j - supplied_j) / exchanged_j;
        println!(
            "{name}: imbalance {imbalance:.2e}, dissipated {:.3} of what was exchanged",
            dissipated_j / exchanged_j
        );
        let bar = if name == "widening, fast" { BAR_WIDENING } else { BAR };
        if imbalance.abs() > bar || dissipated_j < 0.1 * exchanged_j {
            failed.push(format!("{name}: {imbalance:e}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// Each of these alone is allowed; 1.6 together would be a negative capacitance, and a leak that gives energy.
#[test]
fn skews_of_several_effects_stay_physical() {
    for (hysteron, law) in
        [(0, BendLaw::CapacitanceSkew(0.8)), (1, BendLaw::CapacitanceSkew(0.8)), (1, BendLaw::SlopeSkew(0.8))]
    {
        let bends = vec![Bend { hysteron: Some(hysteron), law }; 2];
        let chain = Chain { parts: Parts { bends, ..Parts::default() }, ..chain() };
        let at = |v: f64| {
            let plant = PhsState { hysteron_v: vec![v; 2], ..PhsState::default() };
            Snapshot { plant, attached: Vec::new(), slid: Vec::new() }
        };
        for v in [-20.0, -7.0, -2.0, 2.0, 7.0, 20.0] {
            let (stored, lost) = (stored_j(&chain, &at(v)), dissipated_w(&chain, &at(v)));
            assert!(stored > 0.0 && lost >= 0.0, "{law:?} at {v} V: {stored:e} J, {lost:e} W");
        }
        let mut simulator = Simulator::new(&chain, SAMPLE_S, 0.0);
        for volts in lively() {
            simulator.advance(Held::zero_order(volts), 0.0);
            let now = simulator.snapshot();
            let largest = now.plant.hysteron_v.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            assert!(largest < 1e3 && dissipated_w(&chain, &now) >= 0.0, "{law:?}: {now:?}");
        }
    }
}
