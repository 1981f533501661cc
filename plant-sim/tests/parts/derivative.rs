//! Central differences by each part's parameter with relative steps of 1e-4 and 1e-3: a search uses them.

use super::rival::{chain, lively, ours, with_drive, with_force};
use plant_sim::chain::{Bend, BendLaw, Chain, Drive, Force, Lag, Parts};

/// Measured: at most 0.6 % apart (the exponent of a power law); smooth laws agree to 1e-4.
const APART: f64 = 0.02;

fn chains(x: f64) -> Vec<(&'static str, Chain)> {
    let b = |hysteron, law| Chain {
        parts: Parts { bends: vec![Bend { hysteron: Some(hysteron), law }], ..Parts::default() },
        ..chain()
    };
    vec![
        ("cubic", with_force(Force::Spring { quadratic_n_per_m2: 0.0, cubic_n_per_m3: 1e11 * x })),
        ("one-sided", with_force(Force::OneSided { stiffness_n_per_m: 1000.0 * x })),
        ("dahl fc", with_force(Force::Presliding { coulomb_n: 0.05 * x, presliding_m: 1e-6 })),
        ("dahl delta", with_force(Force::Presliding { coulomb_n: 0.05, presliding_m: 1e-6 * x })),
        ("slider fc", with_force(Force::Slider { coulomb_n: 0.05 * x, slip_m: 1e-6 })),
        ("slider s", with_force(Force::Slider { coulomb_n: 0.05, slip_m: 1e-6 * x })),
        ("part at", with_force(Force::Patch { coulomb_n: 0.05, slip_m: 1e-6, at_m: 5e-6 * x, half_width_m: 3e-5 })),
        ("part w", with_force(Force::Patch { coulomb_n: 0.05, slip_m: 1e-6, at_m: 5e-6, half_width_m: 3e-5 * x })),
        ("detent p", with_force(Force::Detent { period_m: 7e-5 * x, sin_n: 0.05, cos_n: 0.02 })),
        ("tanh fc", with_force(Force::Smooth { coulomb_n: 0.05 * x, speed_m_per_s: 1e-3 })),
        ("tanh vs", with_force(Force::Smooth { coulomb_n: 0.05, speed_m_per_s: 1e-3 * x })),
        ("power f", with_force(Force::Power { force_n: 0.05 * x, reference_m_per_s: 0.1, exponent: 0.5 })),
        ("power m", with_force(Force::Power { force_n: 0.05, reference_m_per_s: 0.1, exponent: 0.5 * x })),
        ("stop at", with_force(Force::Stop { at_m: 70e-6 * x, stiffness_n_per_m: 5e5, damping_s_per_m: 0.0 })),
        ("stop k", with_force(Force::Stop { at_m: 70e-6, stiffness_n_per_m: 5e5 * x, damping_s_per_m: 0.0 })),
        ("stop a", with_force(Force::Stop { at_m: 70e-6, stiffness_n_per_m: 1e5, damping_s_per_m: 20.0 * x })),
        ("pad at", with_force(Force::Pad { at_m: 60e-6 * x, stiffness_n_per_m: 1e5, exponent: 1.5 })),
        ("pad p", with_force(Force::Pad { at_m: 60e-6, stiffness_n_per_m: 1e5, exponent: 1.5 * x })),
        ("gradual at", with_force(Force::Gradual { stiffness_n_per_m: 3e3, at_m: 1e-5 * x, width_m: 2e-5 })),
        ("gradual w", with_force(Force::Gradual { stiffness_n_per_m: 3e3, at_m: 1e-5, width_m: 2e-5 * x })),
        ("capskew 0", b(0, BendLaw::CapacitanceSkew(0.05 * x))),
        ("capskew 1", b(1, BendLaw::CapacitanceSkew(0.05 * x))),
        ("slopeskew 0", b(0, BendLaw::SlopeSkew(0.1 * x))),
        ("slopeskew 1", b(1, BendLaw::SlopeSkew(0.1 * x))),
        ("exponent 0", b(0, BendLaw::Exponent(1.2 * x))),
        ("exponent 1", b(1, BendLaw::Exponent(0.8 * x))),
        ("easing", b(1, BendLaw::Easing { share: 2.0 * x, reference_m_per_s: 0.05 })),
        ("widening 0", b(0, BendLaw::Widening { share: 0.1 * x, reference_v_per_s: 1e5 })),
        ("widening 1", b(1, BendLaw::Widening { share: 0.1 * x, reference_v_per_s: 1e5 })),
        ("lag", with_drive(Drive { lag: Some(Lag::First { time_constant_s: 5e-5 * x }), ..Drive::IDEAL })),
        ("slew", with_drive(Drive { slew_v_per_s: 1e5 * x, slew_down_v_per_s: 1e5 * x, ..Drive::IDEAL })),
        ("delay", with_drive(Drive { delay_s: 3e-5 * x, ..Drive::IDEAL })),
        (
            "lag2",
            with_drive(Drive {
                lag: Some(Lag::Second { natural_rad_per_s: 12000.0 * x, damping_ratio: 0.7 }),
                ..Drive::IDEAL
            }),
        ),
    ]
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count): (f64, f64), v| (sum + v * v, count + 1.0));
    (sum / count).sqrt()
}

#[test]
fn differences_of_two_steps_agree() {
    let command_v = lively();
    let slopes = |step: f64| -> Vec<Vec<f64>> {
        let pairs = chains(1.0 + step).into_iter().zip(chains(1.0 - step));
        pairs
            .map(|((_, more), (_, less))| {
                let (more, less) = (ours(&more, &command_v), ours(&less, &command_v));
                more.iter().zip(&less).map(|(more, less)| (more - less) / (2.0 * step)).collect()
            })
            .collect()
    };
    let (fine, coarse) = (slopes(1e-4), slopes(1e-3));
    for (i, (name, _)) in chains(1.0).iter().enumerate() {
        let size_m = rms(fine[i].iter().copied());
        let apart = rms(fine[i].iter().zip(&coarse[i]).map(|(a, b)| a - b)) / size_m;
        println!("{name}: {:.2} nm, {apart:.4} apart", 1e9 * size_m);
        assert!(size_m > 1e-10 && apart < APART, "{name}: {size_m:e} m, {apart} apart");
    }
}
