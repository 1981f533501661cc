//! Forms of the ceramic's loops: more memory, loops that differ by sign, loops that depend on the rate.

use super::actuator::capacitance;
use super::{C, CR, D, DC, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::bench::Bench;
use crate::drive::Drive;
use crate::effects::EffectId::*;
use crate::hysteron::{Hysteron, Leak};
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: ExtraHysteron, name: "one", splits: DC, draw: extra_one },
    Form { effect: ExtraHysteron, name: "three in a row of dead zones", splits: C, draw: extra_three },
    Form { effect: ExtraHysteron, name: "one with a power-law leak", splits: R, draw: extra_power },
    Form { effect: ExtraHysteron, name: "five with falling weights", splits: R, draw: extra_five },
    Form { effect: ExtraHysteron, name: "Prandtl-Ishlinskii on the voltage", splits: C, draw: extra_plays },
    Form { effect: ExtraHysteron, name: "Preisach relays on the voltage", splits: C, draw: extra_relays },
    Form { effect: ExtraHysteron, name: "one with unequal edges", splits: C, draw: extra_unequal },
    Form { effect: ExtraHysteron, name: "Bouc-Wen on the voltage", splits: C, draw: extra_bouc_wen },
    Form { effect: ExtraHysteron, name: "a quick one and a slow one", splits: C, draw: extra_quick_and_slow },
    Form { effect: AsymmetricHysteresis, name: "capacitance by sign", splits: D, draw: asymmetric_capacitance },
    Form { effect: AsymmetricHysteresis, name: "dead zone and slope by sign", splits: DC, draw: asymmetric_dead_zone },
    Form { effect: AsymmetricHysteresis, name: "even part of the drive", splits: C, draw: asymmetric_even },
    Form { effect: AsymmetricHysteresis, name: "tanh envelope off centre", splits: R, draw: asymmetric_tanh },
    Form { effect: AsymmetricHysteresis, name: "slow hysteron, all three by sign", splits: R, draw: asymmetric_all },
    Form { effect: AsymmetricHysteresis, name: "loop grows with the voltage", splits: C, draw: asymmetric_stop },
    Form {
        effect: AsymmetricHysteresis,
        name: "one-sided dead zone of the drive",
        splits: C,
        draw: asymmetric_one_sided,
    },
    Form {
        effect: AsymmetricHysteresis,
        name: "dead zone of the fast hysteron by sign",
        splits: C,
        draw: asymmetric_fast,
    },
    Form { effect: AsymmetricHysteresis, name: "butterfly", splits: C, draw: asymmetric_butterfly },
    Form { effect: AsymmetricHysteresis, name: "way back bent", splits: C, draw: asymmetric_bent },
    Form {
        effect: AsymmetricHysteresis,
        name: "further loop under one sign",
        splits: C,
        draw: asymmetric_one_sided_loop,
    },
    Form { effect: AsymmetricHysteresis, name: "Duhem, another curve each way", splits: C, draw: asymmetric_duhem },
    Form { effect: RateDependentHysteresis, name: "power-law leak", splits: DC, draw: rate_power },
    Form { effect: RateDependentHysteresis, name: "dead zone grows with speed", splits: CR, draw: rate_threshold },
    Form { effect: RateDependentHysteresis, name: "nonlinear damping", splits: R, draw: rate_damping },
    Form { effect: RateDependentHysteresis, name: "hyperbolic-sine leak", splits: C, draw: rate_sinh },
    Form { effect: RateDependentHysteresis, name: "second leak that joins in", splits: C, draw: rate_kink },
    Form { effect: RateDependentHysteresis, name: "leak eased by motion", splits: C, draw: rate_eased },
    Form {
        effect: RateDependentHysteresis,
        name: "play on the voltage that grows with the rate",
        splits: C,
        draw: rate_play,
    },
];

/// A hysteron of which a stroke reaches `reach` times the edge, leaking with time constant `tau_s`.
fn added(bench: &Bench, share: f64, edge: f64, tau_s: f64) -> Hysteron {
    let capacitance_f = capacitance(bench, share);
    let full_v = bench.transduction_c_per_m * STROKE_M / capacitance_f;
    Hysteron::symmetric(capacitance_f, capacitance_f / tau_s, 2.0 * edge * full_v)
}

fn extra_one(rng: &mut Pcg64) -> Planted {
    let (edge, tau_s) = (rng.random_range(0.1..0.6), log_uniform(rng, 1e-4, 2e-2));
    Planted::new("stiffness_share", (0.002, 0.3), move |a, bench| bench.hysterons.push(added(bench, a, edge, tau_s)))
        .with("edge_over_stroke", edge)
        .with("tau_s", tau_s)
}

fn extra_several(n: usize, falling: f64, tau_s: f64) -> Planted {
    Planted::new("stiffness_share", (0.002, 0.4), move |a, bench| {
        let sum: f64 = (0..n).map(|i| falling.powi(i as i32)).sum();
        for i in 0..n {
            let edge = 0.8 * (i + 1) as f64 / n as f64;
            bench.hysterons.push(added(bench, a * falling.powi(i as i32) / sum, edge, tau_s));
        }
    })
    .with("number", n as f64)
    .with("weight_ratio", falling)
    .with("tau_s", tau_s)
}

fn extra_three(rng: &mut Pcg64) -> Planted {
    extra_several(3, 1.0, log_uniform(rng, 1e-4, 1e-2))
}

fn extra_five(rng: &mut Pcg64) -> Planted {
    extra_several(5, rng.random_range(0.5..0.8), log_uniform(rng, 1e-4, 5e-3))
}

fn extra_power(rng: &mut Pcg64) -> Planted {
    let (edge, tau_s) = (rng.random_range(0.1..0.6), log_uniform(rng, 1e-3, 2e-2));
    let exponent = rng.random_range(1.2..1.8);
    Planted::new("stiffness_share", (0.002, 0.3), move |a, bench| {
        let hysteron = added(bench, a, edge, tau_s);
        let reference_v = 0.5 * hysteron.up.half_v;
        bench.hysterons.push(Hysteron { leak: Leak::Power { exponent, reference_v }, ..hysteron });
    })
    .with("edge_over_stroke", edge)
    .with("tau_s", tau_s)
    .with("exponent", exponent)
}

fn extra_plays(rng: &mut Pcg64) -> Planted {
    let first_v = rng.random_range(3.0..8.0);
    let weights: [f64; 4] = std::array::from_fn(|_| rng.random_range(0.3..1.0));
    let sum: f64 = weights.iter().sum();
    let plays: Vec<(f64, f64)> =
        weights.iter().enumerate().map(|(i, weight)| (weight / sum, first_v * (1 + i) as f64)).collect();
    Planted::new("share", (0.002, 0.4), move |a, bench| {
        bench.drives.push(Drive::Plays { share: a, plays: plays.clone() });
    })
    .with("first_edge_V", first_v)
}

fn extra_relays(rng: &mut Pcg64) -> Planted {
    let (from_v, to_v) = (rng.random_range(2.0..10.0), rng.random_range(25.0..50.0));
    Planted::new("size_V", (0.05, 8.0), move |a, bench| bench.drives.push(Drive::Relays { v: a, from_v, to_v }))
        .with("first_V", from_v)
        .with("last_V", to_v)
}

fn extra_unequal(rng: &mut Pcg64) -> Planted {
    let (edge, tau_s) = (rng.random_range(0.15..0.5), log_uniform(rng, 1e-4, 1e-2));
    let skew = sign(rng) * rng.random_range(0.2..0.5);
    Planted::new("stiffness_share", (0.002, 0.3), move |a, bench| {
        let mut hysteron = added(bench, a, edge, tau_s);
        hysteron.up.half_v *= 1.0 + skew;
        hysteron.down.half_v *= 1.0 - skew;
        bench.hysterons.push(hysteron);
    })
    .with("edge_over_stroke", edge)
    .with("tau_s", tau_s)
    .with("skew", skew)
}

fn asymmetric_capacitance(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("difference", (0.005, 0.6), move |a, bench| {
        let hysteron = &mut bench.hysterons[1];
        hysteron.up.capacitance_f *= 1.0 + 0.5 * sign * a;
        hysteron.down.capacitance_f *= 1.0 - 0.5 * sign * a;
    })
    .with("sign", sign)
}

fn asymmetric_dead_zone(rng: &mut Pcg64) -> Planted {
    let (sign, slope) = (sign(rng), rng.random_range(-1.0..1.0));
    Planted::new("difference", (0.005, 0.8), move |a, bench| {
        let hysteron = &mut bench.hysterons[1];
        hysteron.up.half_v *= 1.0 + 0.5 * sign * a;
        hysteron.down.half_v *= 1.0 - 0.5 * sign * a;
        hysteron.up.slope_s *= 1.0 + 0.5 * slope * a;
        hysteron.down.slope_s *= 1.0 - 0.5 * slope * a;
    })
    .with("sign", sign)
    .with("slope_over_dead_zone", slope)
}

fn asymmetric_all(rng: &mut Pcg64) -> Planted {
    let shares = [sign(rng), rng.random_range(-1.0..1.0), rng.random_range(-0.7..0.7)];
    Planted::new("difference", (0.005, 0.8), move |a, bench| {
        let hysteron = &mut bench.hysterons[1];
        for (side, to) in [(&mut hysteron.up, 0.5 * a), (&mut hysteron.down, -0.5 * a)] {
            side.half_v *= 1.0 + shares[0] * to;
            side.slope_s *= 1.0 + shares[1] * to;
            side.capacitance_f *= 1.0 + shares[2] * to;
        }
    })
    .with("dead_zone", shares[0])
    .with("slope", shares[1])
    .with("capacitance", shares[2])
}

fn asymmetric_even(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    // Anchors F6: 1 to 5 % of the stroke.
    Planted::new("even_share", (0.0005, 0.1), move |a, bench| {
        bench.drives.push(Drive::Even { per_volt: sign * a / 60.0 });
    })
    .with("sign", sign)
}

fn asymmetric_tanh(rng: &mut Pcg64) -> Planted {
    let (sign, shift) = (sign(rng), rng.random_range(0.5..1.0));
    Planted::new("largest_over_level", (0.03, 0.5), move |a, bench| {
        let level_v = 60.0 / a;
        bench.drives.push(Drive::TanhEnvelope { level_v, shift_v: sign * shift * 60.0 });
    })
    .with("sign", sign)
    .with("shift_over_largest", shift)
}

fn asymmetric_stop(rng: &mut Pcg64) -> Planted {
    let (sign, edge_v) = (sign(rng), rng.random_range(8.0..25.0));
    Planted::new("share", (0.0005, 0.1), move |a, bench| {
        bench.drives.push(Drive::SkewedStop { share: sign * a, edge_v });
    })
    .with("sign", sign)
    .with("edge_V", edge_v)
}

fn asymmetric_one_sided(rng: &mut Pcg64) -> Planted {
    let (signs, at_v) = ([sign(rng), sign(rng)], rng.random_range(5.0..30.0));
    Planted::new("slope_change", (0.001, 0.2), move |a, bench| {
        bench.drives.push(Drive::OneSided { side: signs[0], slope: signs[1] * a, at_v });
    })
    .with("side", signs[0])
    .with("sign", signs[1])
    .with("from_V", at_v)
}

fn asymmetric_fast(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("difference", (0.005, 0.8), move |a, bench| {
        let hysteron = &mut bench.hysterons[0];
        hysteron.up.half_v *= 1.0 + 0.5 * sign * a;
        hysteron.down.half_v *= 1.0 - 0.5 * sign * a;
    })
    .with("sign", sign)
}

fn rate_power(rng: &mut Pcg64) -> Planted {
    let (sign, reference_v) = (sign(rng), rng.random_range(1.5..4.0));
    Planted::new("exponent_off_one", (0.01, 0.6), move |a, bench| {
        bench.hysterons[1].leak = Leak::Power { exponent: 1.0 + sign * a, reference_v };
    })
    .with("sign", sign)
    .with("reference_V", reference_v)
}

fn rate_threshold(_: &mut Pcg64) -> Planted {
    // Share of the dead zone gained at 0.1 m/s, which is 100 um at 160 Hz.
    Planted::new("share_at_0.1_m_per_s", (0.003, 1.5), |a, bench| {
        let half_v = bench.hysterons[1].up.half_v;
        bench.hysterons[1].leak = Leak::Threshold { v_s_per_m: a * half_v / 0.1 };
    })
}

fn rate_damping(rng: &mut Pcg64) -> Planted {
    let exponent = if rng.random::<bool>() { rng.random_range(1.5..2.2) } else { rng.random_range(0.4..0.7) };
    Planted::new("force_at_0.1_m_per_s_N", (5e-4, 0.5), move |a, bench| {
        bench.forces.push(Force::PowerDamping { n: a, exponent, w_m_per_s: 0.1 });
    })
    .with("exponent", exponent)
}

fn rate_sinh(_: &mut Pcg64) -> Planted {
    Planted::new("curvature_per_V", (0.03, 5.0), |a, bench| {
        bench.hysterons[1].leak = Leak::Sinh { reference_v: 1.0 / a };
    })
}

fn rate_kink(rng: &mut Pcg64) -> Planted {
    let at_v = rng.random_range(0.2..1.0);
    Planted::new("second_over_first", (0.02, 40.0), move |a, bench| {
        bench.hysterons[1].leak = Leak::Kink { at_v, more: a };
    })
    .with("from_V", at_v)
}

fn extra_bouc_wen(rng: &mut Pcg64) -> Planted {
    let (over_v, shape) = (rng.random_range(8.0..25.0), rng.random_range(-0.3..0.3));
    Planted::new("share", (0.002, 0.4), move |a, bench| {
        bench.drives.push(Drive::BoucWen { share: a, over_v, shape });
    })
    .with("over_V", over_v)
    .with("gamma_over_sum", shape)
}

fn extra_quick_and_slow(rng: &mut Pcg64) -> Planted {
    let (quick_s, slow_s) = (log_uniform(rng, 5e-5, 4e-4), log_uniform(rng, 4e-3, 3e-2));
    let (edge, further) = (rng.random_range(0.08..0.25), rng.random_range(0.35..0.65));
    let share = rng.random_range(0.3..0.7);
    Planted::new("stiffness_share", (0.002, 0.3), move |a, bench| {
        bench.hysterons.push(added(bench, share * a, edge, quick_s));
        bench.hysterons.push(added(bench, (1.0 - share) * a, further, slow_s));
    })
    .with("quick_share", share)
    .with("quick_edge_over_stroke", edge)
    .with("slow_edge_over_stroke", further)
    .with("quick_tau_s", quick_s)
    .with("slow_tau_s", slow_s)
}

fn asymmetric_butterfly(rng: &mut Pcg64) -> Planted {
    let (sign, edge_v) = (sign(rng), rng.random_range(6.0..20.0));
    Planted::new("share", (0.0005, 0.1), move |a, bench| {
        bench.drives.push(Drive::Butterfly { share: sign * a, edge_v });
    })
    .with("sign", sign)
    .with("edge_V", edge_v)
}

fn asymmetric_bent(rng: &mut Pcg64) -> Planted {
    let (edge_v, bend) = (rng.random_range(10.0..20.0), sign(rng) * rng.random_range(0.1..0.25));
    Planted::new("share", (0.002, 0.5), move |a, bench| {
        bench.drives.push(Drive::BentPlay { share: a, edge_v, bend });
    })
    .with("edge_V", edge_v)
    .with("bend_at_60V", bend)
}

fn asymmetric_one_sided_loop(rng: &mut Pcg64) -> Planted {
    let (side, edge_v) = (sign(rng), rng.random_range(6.0..20.0));
    Planted::new("share", (0.002, 0.3), move |a, bench| {
        bench.drives.push(Drive::OneSidedLoop { side, share: a, edge_v });
    })
    .with("side", side)
    .with("edge_V", edge_v)
}

fn asymmetric_duhem(rng: &mut Pcg64) -> Planted {
    let (over_v, skew) = (rng.random_range(10.0..30.0), sign(rng) * rng.random_range(0.2..0.5));
    Planted::new("share", (0.002, 0.5), move |a, bench| {
        bench.drives.push(Drive::SkewedDuhem { share: a, over_v, skew });
    })
    .with("over_V", over_v)
    .with("skew", skew)
}

fn rate_eased(_: &mut Pcg64) -> Planted {
    Planted::new("share_at_0.1_m_per_s", (0.01, 20.0), |a, bench| {
        bench.hysterons[1].leak = Leak::Eased { s_per_m: a / 0.1 };
    })
}

fn rate_play(rng: &mut Pcg64) -> Planted {
    let (edge_v, more) = (rng.random_range(3.0..8.0), rng.random_range(0.4..1.5));
    // The largest rate of a sine of 60 V and 100 Hz.
    let reference_v_per_s = std::f64::consts::TAU * 100.0 * 60.0;
    Planted::new("share", (0.002, 0.8), move |a, bench| {
        bench.drives.push(Drive::RatePlay { share: a, edge_v, more_s_per_v: more / reference_v_per_s });
    })
    .with("edge_V", edge_v)
    .with("wider_at_60V_100Hz", more)
}
