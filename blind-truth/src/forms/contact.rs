//! Forms of what touches: dry friction, stops and play.

use super::{C, CR, D, DC, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::effects::EffectId::*;
use crate::sensor::Follow;
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

pub(super) const FORMS: &[Form] = &[
    Form { effect: CoulombFriction, name: "tanh", splits: D, draw: friction_tanh },
    Form { effect: CoulombFriction, name: "Dahl", splits: DC, draw: friction_dahl },
    Form { effect: CoulombFriction, name: "hard with stick", splits: CR, draw: friction_hard },
    Form { effect: CoulombFriction, name: "LuGre with Stribeck", splits: R, draw: friction_lugre },
    Form { effect: CoulombFriction, name: "hard with stick, another one each way", splits: C, draw: friction_by_way },
    Form { effect: CoulombFriction, name: "Maxwell slip, five sliders", splits: C, draw: friction_maxwell },
    Form { effect: CoulombFriction, name: "Dahl, pressed on by the stroke", splits: C, draw: friction_wedge },
    Form { effect: CoulombFriction, name: "rubs on a part of the stroke", splits: C, draw: friction_spot },
    Form { effect: CoulombFriction, name: "contacts that grow stronger at rest", splits: C, draw: friction_ageing },
    Form { effect: CoulombFriction, name: "a seal and a dry guide", splits: C, draw: friction_seal },
    Form { effect: CoulombFriction, name: "one slider on a spring", splits: C, draw: friction_jenkins },
    Form { effect: CoulombFriction, name: "hard with stick, with a grease's drag", splits: C, draw: friction_grease },
    Form { effect: EndStop, name: "linear contact", splits: DC, draw: stop_linear },
    Form { effect: EndStop, name: "Hunt-Crossley", splits: C, draw: stop_hunt_crossley },
    Form { effect: EndStop, name: "both sides, damped", splits: R, draw: stop_two },
    Form { effect: EndStop, name: "bumper before a hard wall", splits: C, draw: stop_bumper },
    Form { effect: EndStop, name: "contact that sticks", splits: C, draw: stop_sticky },
    Form { effect: EndStop, name: "pad that creeps", splits: C, draw: stop_pad },
    Form { effect: EndStop, name: "rough faces", splits: C, draw: stop_rough },
    Form { effect: EndStop, name: "face that rubs while pressed", splits: C, draw: stop_rubbing },
    Form { effect: EndStop, name: "pin on a preloaded spring", splits: C, draw: stop_preloaded },
    Form { effect: EndStop, name: "stop that dents", splits: C, draw: stop_denting },
    Form { effect: EndStop, name: "stop on a leaf that swings", splits: C, draw: stop_leaf },
    Form { effect: Backlash, name: "play", splits: DC, draw: play },
    Form { effect: Backlash, name: "play with drag", splits: CR, draw: play_soft },
    Form { effect: Backlash, name: "lost motion across a gap", splits: R, draw: lost_motion },
    Form { effect: Backlash, name: "play worn at one end", splits: C, draw: play_worn },
    Form { effect: Backlash, name: "plays that close one after the other", splits: C, draw: play_rough },
    Form { effect: Backlash, name: "play that a weak spring takes up", splits: C, draw: play_leaning },
    Form { effect: Backlash, name: "play with a loose part that rattles", splits: C, draw: play_rattling },
];

/// Anchors F30: 0.1 to 5 % of the blocking force, which is 2.8 N at 60 V; less still shows at 10 nm of noise.
const FRICTION_N: (f64, f64) = (5e-4, 0.2);

fn friction_tanh(rng: &mut Pcg64) -> Planted {
    let w_m_per_s = log_uniform(rng, 2e-4, 2e-3);
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::TanhFriction { n: a, w_m_per_s });
    })
    .with("transition_m_per_s", w_m_per_s)
}

fn friction_hard(_: &mut Pcg64) -> Planted {
    Planted::new("force_N", FRICTION_N, |a, bench| bench.forces.push(Force::Coulomb { n: a }))
}

fn bristle(rng: &mut Pcg64, static_ratio: f64, stribeck_m_per_s: f64) -> Planted {
    let presliding_m = log_uniform(rng, 0.2e-6, 3e-6);
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::Bristle {
            coulomb_n: a,
            static_n: static_ratio * a,
            stribeck_m_per_s,
            n_per_m: a / presliding_m,
        });
    })
    .with("presliding_um", presliding_m * 1e6)
    .with("static_over_coulomb", static_ratio)
    .with("stribeck_m_per_s", stribeck_m_per_s)
}

fn friction_dahl(rng: &mut Pcg64) -> Planted {
    bristle(rng, 1.0, 1.0)
}

fn friction_lugre(rng: &mut Pcg64) -> Planted {
    let (static_ratio, stribeck_m_per_s) = (rng.random_range(1.2..1.7), log_uniform(rng, 5e-4, 5e-3));
    bristle(rng, static_ratio, stribeck_m_per_s)
}

fn friction_by_way(rng: &mut Pcg64) -> Planted {
    let (lesser, back) = (rng.random_range(0.3..0.75), rng.random::<bool>());
    let shares = if back { (lesser, 1.0) } else { (1.0, lesser) };
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::CoulombByWay { forth_n: shares.0 * a, back_n: shares.1 * a });
    })
    .with("forth_share", shares.0)
    .with("back_share", shares.1)
}

fn friction_maxwell(rng: &mut Pcg64) -> Planted {
    let slip_m = log_uniform(rng, 0.3e-6, 5e-6);
    Planted::new("force_N", FRICTION_N, move |a, bench| bench.forces.push(Force::MaxwellSlip { n: a, slip_m }))
        .with("slip_um", slip_m * 1e6)
}

fn friction_wedge(rng: &mut Pcg64) -> Planted {
    let (slip_m, more) = (log_uniform(rng, 0.2e-6, 3e-6), rng.random_range(0.5..3.0));
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::Wedge { n: a, slip_m, per_m: more / STROKE_M });
    })
    .with("slip_um", slip_m * 1e6)
    .with("more_at_stroke", more)
}

/// How far the stop reaches into the largest stroke, overshoot included.
const STOP: (f64, f64) = (0.01, 0.6);

fn stop_gap_m(reach: f64) -> f64 {
    1.25 * STROKE_M * (1.0 - reach)
}

fn stop_linear(rng: &mut Pcg64) -> Planted {
    let ratio = log_uniform(rng, 0.5, 5.0);
    Planted::new("reach_share", STOP, move |a, bench| {
        bench.forces.push(Force::Stop { n_per_m: ratio * bench.stiffness_n_per_m, gap_m: stop_gap_m(a) });
    })
    .with("contact_over_k", ratio)
}

fn stop_hunt_crossley(rng: &mut Pcg64) -> Planted {
    let (ratio, s_per_m) = (log_uniform(rng, 1.0, 8.0), log_uniform(rng, 0.5, 5.0));
    Planted::new("reach_share", STOP, move |a, bench| {
        // As stiff as a linear contact at a depth of 10 um.
        let n_per_m15 = ratio * bench.stiffness_n_per_m / 10e-6_f64.sqrt();
        bench.forces.push(Force::HuntCrossley { n_per_m15, gap_m: stop_gap_m(a), s_per_m });
    })
    .with("contact_over_k_at_10_um", ratio)
    .with("damping_s_per_m", s_per_m)
}

fn stop_two(rng: &mut Pcg64) -> Planted {
    let (ratio, drag) = (log_uniform(rng, 0.3, 3.0), rng.random_range(0.2..2.0));
    Planted::new("reach_share", STOP, move |a, bench| {
        bench.forces.push(Force::TwoStops {
            n_per_m: ratio * bench.stiffness_n_per_m,
            gap_m: stop_gap_m(a),
            n_s_per_m: drag * bench.damping_n_s_per_m,
        });
    })
    .with("contact_over_k", ratio)
    .with("drag_over_b", drag)
}

fn stop_bumper(rng: &mut Pcg64) -> Planted {
    let (side, ratio) = (sign(rng), log_uniform(rng, 1.0, 6.0));
    let (thick_m, soft_share) = (log_uniform(rng, 1e-6, 10e-6), rng.random_range(0.05..0.3));
    Planted::new("reach_share", STOP, move |a, bench| {
        bench.forces.push(Force::Bumper {
            side,
            n_per_m: ratio * bench.stiffness_n_per_m,
            gap_m: stop_gap_m(a),
            thick_m,
            soft_share,
        });
    })
    .with("side", side)
    .with("wall_over_k", ratio)
    .with("bumper_um", thick_m * 1e6)
    .with("bumper_over_wall", soft_share)
}

fn stop_sticky(rng: &mut Pcg64) -> Planted {
    let (ratio, neck_m) = (log_uniform(rng, 0.5, 4.0), log_uniform(rng, 0.3e-6, 3e-6));
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::StickyStop { n_per_m, gap_m: stop_gap_m(a), neck_m });
    })
    .with("contact_over_k", ratio)
    .with("neck_um", neck_m * 1e6)
}

fn stop_pad(rng: &mut Pcg64) -> Planted {
    let ratio = log_uniform(rng, 0.5, 4.0);
    let (share, tau_s) = (rng.random_range(0.2..0.7), log_uniform(rng, 1e-3, 0.1));
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::PadStop { n_per_m, gap_m: stop_gap_m(a), share, tau_s });
    })
    .with("contact_over_k", ratio)
    .with("creeping_share", share)
    .with("tau_s", tau_s)
}

/// Anchors F31: 0.01 to 1 um.
const PLAY_M: (f64, f64) = (0.01e-6, 4e-6);

fn play(_: &mut Pcg64) -> Planted {
    Planted::new("half_width_m", PLAY_M, |a, bench| bench.follows.push(Follow::Play { half_m: a }))
}

fn play_soft(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 0.05, 1.0);
    Planted::new("half_width_m", PLAY_M, move |a, bench| {
        bench.follows.push(Follow::SoftPlay { half_m: a, tau_s });
    })
    .with("tau_s", tau_s)
}

fn lost_motion(rng: &mut Pcg64) -> Planted {
    let at_m = rng.random_range(-30e-6..30e-6);
    Planted::new("half_width_m", PLAY_M, move |a, bench| {
        bench.follows.push(Follow::LostMotion { half_m: a, at_m });
    })
    .with("at_um", at_m * 1e6)
}

fn play_worn(rng: &mut Pcg64) -> Planted {
    let worn = sign(rng) * rng.random_range(0.3..0.75);
    Planted::new("half_width_m", PLAY_M, move |a, bench| {
        bench.follows.push(Follow::WornPlay { half_m: a, per_m: worn / STROKE_M });
    })
    .with("wider_at_stroke", worn)
}

fn play_rough(_: &mut Pcg64) -> Planted {
    Planted::new("half_width_m", PLAY_M, |a, bench| bench.follows.push(Follow::RoughPlay { half_m: a }))
}

fn friction_spot(rng: &mut Pcg64) -> Planted {
    let (slip_m, at_m) = (log_uniform(rng, 0.2e-6, 2e-6), rng.random_range(-50e-6..50e-6));
    let width_m = rng.random_range(20e-6..45e-6);
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::RubbedSpot { n: a, slip_m, at_m, width_m });
    })
    .with("slip_um", slip_m * 1e6)
    .with("at_um", at_m * 1e6)
    .with("half_width_um", width_m * 1e6)
}

fn friction_ageing(rng: &mut Pcg64) -> Planted {
    let (slip_m, per_e) = (log_uniform(rng, 0.3e-6, 2e-6), rng.random_range(0.03..0.12));
    let from_s = log_uniform(rng, 3e-4, 3e-3);
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::Ageing { n: a, slip_m, per_e, from_s });
    })
    .with("slip_um", slip_m * 1e6)
    .with("stronger_per_e", per_e)
    .with("from_s", from_s)
}

fn friction_seal(rng: &mut Pcg64) -> Planted {
    let (dry, presliding_m) = (rng.random_range(0.25..0.6), log_uniform(rng, 2e-6, 8e-6));
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        let seal_n = (1.0 - dry) * a;
        bench.forces.push(Force::Coulomb { n: dry * a });
        bench.forces.push(Force::Bristle {
            coulomb_n: seal_n,
            static_n: seal_n,
            stribeck_m_per_s: 1.0,
            n_per_m: seal_n / presliding_m,
        });
    })
    .with("dry_share", dry)
    .with("seal_presliding_um", presliding_m * 1e6)
}

fn friction_jenkins(rng: &mut Pcg64) -> Planted {
    let slip_m = log_uniform(rng, 0.3e-6, 4e-6);
    Planted::new("force_N", FRICTION_N, move |a, bench| bench.forces.push(Force::Jenkins { n: a, slip_m }))
        .with("slip_um", slip_m * 1e6)
}

fn friction_grease(rng: &mut Pcg64) -> Planted {
    let (share, exponent) = (rng.random_range(0.1..0.5), rng.random_range(0.4..0.8));
    Planted::new("force_N", FRICTION_N, move |a, bench| {
        bench.forces.push(Force::Coulomb { n: a });
        bench.forces.push(Force::PowerDamping { n: share * a, exponent, w_m_per_s: 0.1 });
    })
    .with("grease_at_0.1_m_per_s_over_dry", share)
    .with("exponent", exponent)
}

fn stop_rough(rng: &mut Pcg64) -> Planted {
    let (side, ratio, over_m) = (sign(rng), log_uniform(rng, 0.8, 6.0), log_uniform(rng, 0.5e-6, 3e-6));
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::RoughStop { side, n_per_m, gap_m: stop_gap_m(a), over_m });
    })
    .with("side", side)
    .with("contact_over_k", ratio)
    .with("roughness_um", over_m * 1e6)
}

fn stop_rubbing(rng: &mut Pcg64) -> Planted {
    let (ratio, friction) = (log_uniform(rng, 0.5, 5.0), rng.random_range(0.1..0.4));
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::RubbingStop { n_per_m, gap_m: stop_gap_m(a), friction });
    })
    .with("contact_over_k", ratio)
    .with("friction", friction)
}

fn stop_preloaded(rng: &mut Pcg64) -> Planted {
    let (n, ratio) = (log_uniform(rng, 0.02, 0.2), log_uniform(rng, 0.15, 1.0));
    let over_m = log_uniform(rng, 0.3e-6, 1e-6);
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::PreloadedStop { n, n_per_m, gap_m: stop_gap_m(a), over_m });
    })
    .with("preload_N", n)
    .with("spring_over_k", ratio)
    .with("seat_um", over_m * 1e6)
}

fn stop_denting(rng: &mut Pcg64) -> Planted {
    let (ratio, yield_n) = (log_uniform(rng, 1.0, 6.0), log_uniform(rng, 0.1, 0.6));
    Planted::new("reach_share", STOP, move |a, bench| {
        let n_per_m = ratio * bench.stiffness_n_per_m;
        bench.forces.push(Force::DentingStop { n_per_m, gap_m: stop_gap_m(a), yield_n });
    })
    .with("contact_over_k", ratio)
    .with("yield_N", yield_n)
}

fn stop_leaf(rng: &mut Pcg64) -> Planted {
    let (mass_share, leaf_ratio) = (log_uniform(rng, 0.05, 0.3), log_uniform(rng, 0.3, 3.0));
    let damping_ratio = log_uniform(rng, 0.02, 0.1);
    Planted::new("reach_share", STOP, move |a, bench| {
        let (kg, k) = (mass_share * bench.mass_kg, bench.stiffness_n_per_m);
        let hz = (leaf_ratio * k / kg).sqrt() / TAU;
        bench.forces.push(Force::LeafStop { n_per_m: 8.0 * k, gap_m: stop_gap_m(a), kg, hz, damping_ratio });
    })
    .with("leaf_over_k", leaf_ratio)
    .with("mass_share", mass_share)
    .with("damping_ratio", damping_ratio)
}

fn play_leaning(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 2e-3, 3e-2);
    Planted::new("half_width_m", PLAY_M, move |a, bench| {
        bench.follows.push(Follow::LeaningPlay { half_m: a, tau_s });
    })
    .with("tau_s", tau_s)
}

fn play_rattling(rng: &mut Pcg64) -> Planted {
    let (tau_s, back) = (log_uniform(rng, 3e-4, 5e-3), rng.random_range(0.1..0.5));
    Planted::new("half_width_m", PLAY_M, move |a, bench| {
        bench.follows.push(Follow::Rattle { half_m: a, tau_s, back });
    })
    .with("tau_s", tau_s)
    .with("comes_off_with", back)
}
