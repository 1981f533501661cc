//! Forms of the mechanical effects.

use super::{C, CR, D, DC, DCR, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::bench::Bench;
use crate::effects::EffectId::*;
use crate::nominal::static_gain_m_per_v;
use crate::sensor::Follow;
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: VibrationMode, name: "beside the main mode", splits: DC, draw: mode_drive },
    Form { effect: VibrationMode, name: "target on an arm", splits: DC, draw: mode_arm },
    Form { effect: VibrationMode, name: "second mass that reacts", splits: CR, draw: mode_absorber },
    Form { effect: VibrationMode, name: "two modes", splits: R, draw: mode_two },
    Form { effect: VibrationMode, name: "dragged along by a viscous layer", splits: C, draw: mode_dragged },
    Form { effect: VibrationMode, name: "on a spring that hardens", splits: C, draw: mode_hardening },
    Form {
        effect: VibrationMode,
        name: "second mass that reacts and is partly read",
        splits: C,
        draw: mode_read_absorber,
    },
    Form { effect: NonlinearStiffness, name: "cubic", splits: DC, draw: cubic },
    Form { effect: NonlinearStiffness, name: "fifth power", splits: C, draw: quintic },
    Form { effect: NonlinearStiffness, name: "softens and levels off", splits: R, draw: levelling },
    Form {
        effect: NonlinearStiffness,
        name: "cubic and fifth power against each other",
        splits: R,
        draw: cubic_quintic,
    },
    Form { effect: NonlinearStiffness, name: "odd square", splits: C, draw: odd_square },
    Form { effect: NonlinearStiffness, name: "hyperbolic sine", splits: C, draw: sinh },
    Form { effect: AsymmetricStiffness, name: "quadratic", splits: D, draw: quadratic },
    Form { effect: AsymmetricStiffness, name: "bilinear", splits: DC, draw: bilinear },
    Form { effect: AsymmetricStiffness, name: "second spring engages gradually", splits: CR, draw: engaging },
    Form { effect: AsymmetricStiffness, name: "bilinear and quadratic", splits: R, draw: bilinear_quadratic },
    Form { effect: AsymmetricStiffness, name: "fourth power", splits: C, draw: quartic },
    Form { effect: AsymmetricStiffness, name: "exponential", splits: C, draw: exponential },
    Form { effect: PayloadMass, name: "rigid", splits: DCR, draw: payload },
    Form { effect: PayloadMass, name: "on a stiff mount", splits: C, draw: payload_mounted },
    Form { effect: PayloadMass, name: "rigid, with some damping", splits: R, draw: payload_damped },
    Form { effect: PeriodicForce, name: "sine", splits: DC, draw: force_sine },
    Form { effect: PeriodicForce, name: "sine with its second harmonic", splits: C, draw: force_harmonic },
    Form { effect: PeriodicForce, name: "sine with a slow beat", splits: R, draw: force_beat },
    Form { effect: PeriodicForce, name: "sine above the mode", splits: R, draw: force_fast },
    Form { effect: PeriodicForce, name: "almost square", splits: C, draw: force_square },
    Form { effect: PeriodicForce, name: "one push per turn", splits: C, draw: force_knock },
    Form { effect: PeriodicForce, name: "frequency wanders", splits: C, draw: force_wandering },
    Form { effect: PeriodicForce, name: "two unrelated lines", splits: C, draw: force_two },
];

/// Share of the static gain: -60 to -6 dB (anchors F27: -40 to -10 dB).
const MODE: (f64, f64) = (0.001, 0.5);

fn mode_hz(rng: &mut Pcg64) -> (f64, f64) {
    (log_uniform(rng, 250.0, 1500.0), log_uniform(rng, 0.005, 0.03))
}

fn mode_drive(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    Planted::new("share", MODE, move |a, bench| {
        let m_per_v = sign * a * static_gain_m_per_v();
        bench.follows.push(Follow::DriveMode { m_per_v, hz, damping_ratio });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_two(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), ratio) = (mode_hz(rng), rng.random_range(1.2..2.5));
    Planted::new("share", MODE, move |a, bench| {
        let m_per_v = a * static_gain_m_per_v();
        bench.follows.push(Follow::DriveMode { m_per_v, hz, damping_ratio });
        bench.follows.push(Follow::DriveMode { m_per_v: -0.6 * m_per_v, hz: hz * ratio, damping_ratio });
    })
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
    .with("second_over_first_hz", ratio)
}

fn mode_arm(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    Planted::new("share", MODE, move |a, bench| {
        bench.follows.push(Follow::ArmMode { share: sign * a, hz, damping_ratio });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_absorber(rng: &mut Pcg64) -> Planted {
    let (hz, damping_ratio) = mode_hz(rng);
    Planted::new("mass_share", (0.001, 0.3), move |a, bench| {
        let kg = a * bench.mass_kg;
        // The mass was weighed with its appendage on.
        bench.mass_kg -= kg;
        bench.forces.push(Force::Absorber { kg, hz, damping_ratio });
    })
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_dragged(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    Planted::new("share", MODE, move |a, bench| {
        bench.follows.push(Follow::DraggedMode { share: sign * a, hz, damping_ratio });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_hardening(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    // Its frequency rises by 3 to 15 % at 60 V.
    let at_v = rng.random_range(100.0..240.0);
    Planted::new("share", MODE, move |a, bench| {
        let m_per_v = sign * a * static_gain_m_per_v();
        bench.follows.push(Follow::HardeningMode { m_per_v, hz, damping_ratio, at_v });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
    .with("twice_as_stiff_at_V", at_v)
}

fn mode_read_absorber(rng: &mut Pcg64) -> Planted {
    let (hz, damping_ratio) = mode_hz(rng);
    let read = sign(rng) * log_uniform(rng, 0.3, 2.0);
    Planted::new("mass_share", (0.001, 0.3), move |a, bench| {
        let kg = a * bench.mass_kg;
        bench.mass_kg -= kg;
        bench.forces.push(Force::Absorber { kg, hz, damping_ratio });
        // The spot of the sensor covers some of it: the same resonator, as it follows the same motion.
        bench.follows.push(Follow::ArmMode { share: read * a, hz, damping_ratio });
    })
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
    .with("read_over_mass_share", read)
}

/// Restoring share of k at full stroke (anchors F29: 0.001 to 0.05, room on both sides).
const NONLINEAR: (f64, f64) = (0.0005, 0.3);

fn cubic_of(sign: f64) -> impl Fn(f64, &mut Bench) + Send + Sync {
    move |a, bench| {
        let n_per_m3 = sign * a * bench.stiffness_n_per_m / (STROKE_M * STROKE_M);
        bench.forces.push(Force::Cubic { n_per_m3 });
    }
}

fn cubic(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k3_over_k_at_stroke", NONLINEAR, cubic_of(sign)).with("sign", sign)
}

fn quintic(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k5_over_k_at_stroke", NONLINEAR, move |a, bench| {
        let n_per_m5 = sign * a * bench.stiffness_n_per_m / STROKE_M.powi(4);
        bench.forces.push(Force::Quintic { n_per_m5 });
    })
    .with("sign", sign)
}

fn cubic_quintic(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k3_over_k_at_stroke", NONLINEAR, move |a, bench| {
        cubic_of(sign)(a, bench);
        let n_per_m5 = -0.5 * sign * a * bench.stiffness_n_per_m / STROKE_M.powi(4);
        bench.forces.push(Force::Quintic { n_per_m5 });
    })
    .with("sign", sign)
}

fn levelling(rng: &mut Pcg64) -> Planted {
    let at_m = rng.random_range(30e-6..80e-6);
    Planted::new("softening_share", NONLINEAR, move |a, bench| {
        bench.forces.push(Force::Levelling { n_per_m: a * bench.stiffness_n_per_m, at_m });
    })
    .with("at_um", at_m * 1e6)
}

/// As `NONLINEAR`, where a negative sign of more would leave no spring at full stroke.
const STEEP: (f64, f64) = (0.0005, 0.15);

fn odd_square(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k2_over_k_at_stroke", NONLINEAR, move |a, bench| {
        bench.forces.push(Force::OddSquare { n_per_m2: sign * a * bench.stiffness_n_per_m / STROKE_M });
    })
    .with("sign", sign)
}

fn sinh(rng: &mut Pcg64) -> Planted {
    let (sign, over_m) = (sign(rng), rng.random_range(30e-6..55e-6));
    Planted::new("share_at_stroke", STEEP, move |a, bench| {
        let reach = STROKE_M / over_m;
        let n_per_m = sign * a * bench.stiffness_n_per_m * reach / (reach.sinh() - reach);
        bench.forces.push(Force::Sinh { n_per_m, over_m });
    })
    .with("sign", sign)
    .with("over_um", over_m * 1e6)
}

fn quadratic_of(sign: f64, share: f64) -> impl Fn(f64, &mut Bench) + Send + Sync {
    move |a, bench| {
        bench.forces.push(Force::Quadratic { n_per_m2: sign * share * a * bench.stiffness_n_per_m / STROKE_M });
    }
}

fn bilinear_of(sign: f64) -> impl Fn(f64, &mut Bench) + Send + Sync {
    move |a, bench| bench.forces.push(Force::Bilinear { n_per_m: sign * a * bench.stiffness_n_per_m })
}

fn quadratic(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k2_over_k_at_stroke", NONLINEAR, quadratic_of(sign, 1.0)).with("sign", sign)
}

fn bilinear(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("difference_over_k", NONLINEAR, bilinear_of(sign)).with("sign", sign)
}

fn bilinear_quadratic(rng: &mut Pcg64) -> Planted {
    let (sign, share) = (sign(rng), rng.random_range(0.2..0.8));
    Planted::new("difference_over_k", NONLINEAR, move |a, bench| {
        bilinear_of(sign)(a, bench);
        quadratic_of(sign, share)(a, bench);
    })
    .with("sign", sign)
    .with("quadratic_over_bilinear", share)
}

fn engaging(rng: &mut Pcg64) -> Planted {
    let (at_m, over_m) = (rng.random_range(-20e-6..40e-6), rng.random_range(5e-6..25e-6));
    Planted::new("difference_over_k", NONLINEAR, move |a, bench| {
        bench.forces.push(Force::Engaging { n_per_m: a * bench.stiffness_n_per_m, at_m, over_m });
    })
    .with("at_um", at_m * 1e6)
    .with("over_um", over_m * 1e6)
}

fn quartic(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("k4_over_k_at_stroke", STEEP, move |a, bench| {
        bench.forces.push(Force::Quartic { n_per_m4: sign * a * bench.stiffness_n_per_m / STROKE_M.powi(3) });
    })
    .with("sign", sign)
}

fn exponential(rng: &mut Pcg64) -> Planted {
    let (sign, over_m) = (sign(rng), rng.random_range(35e-6..80e-6));
    Planted::new("share_at_stroke", STEEP, move |a, bench| {
        let reach = STROKE_M / over_m;
        let n_per_m = a * bench.stiffness_n_per_m * reach / (reach.exp_m1() - reach);
        bench.forces.push(Force::Exponential { n_per_m, over_m: sign * over_m });
    })
    .with("sign", sign)
    .with("over_um", over_m * 1e6)
}

/// Anchors F28 has 0.05 to 1; less is within what a weighing error could be.
const PAYLOAD: (f64, f64) = (0.15, 0.6);

fn payload(_: &mut Pcg64) -> Planted {
    Planted::new("mass_share", PAYLOAD, |a, bench| bench.mass_kg *= 1.0 + a).any_gap()
}

fn payload_mounted(rng: &mut Pcg64) -> Planted {
    let hz = log_uniform(rng, 2.5e3, 5e3);
    Planted::new("mass_share", PAYLOAD, move |a, bench| {
        bench.forces.push(Force::Absorber { kg: a * bench.mass_kg, hz, damping_ratio: 0.05 });
    })
    .with("mount_hz", hz)
    .any_gap()
}

fn payload_damped(rng: &mut Pcg64) -> Planted {
    let damping = rng.random_range(0.02..0.06);
    Planted::new("mass_share", PAYLOAD, move |a, bench| {
        bench.mass_kg *= 1.0 + a;
        bench.damping_n_s_per_m *= 1.0 + damping;
    })
    .with("damping_share", damping)
    .any_gap()
}

/// A frequency that is no line of the mains: at least 3 Hz from every multiple of 50 and 60 Hz.
fn off_mains_hz(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    loop {
        let hz = log_uniform(rng, low, high);
        let far = |mains: f64| (hz - mains * (hz / mains).round()).abs() > 3.0 || hz < mains / 2.0;
        if far(50.0) && far(60.0) {
            return hz;
        }
    }
}

fn force_of(hz: f64, second: f64, beat_hz: f64) -> Planted {
    Planted::new("force_N", (2e-4, 0.3), move |a, bench| {
        bench.forces.push(Force::Periodic { n: a, hz, second, beat_hz });
    })
    .with("hz", hz)
    .with("second_harmonic", second)
    .with("beat_hz", beat_hz)
}

fn force_sine(rng: &mut Pcg64) -> Planted {
    force_of(off_mains_hz(rng, 8.0, 300.0), 0.0, 0.0)
}

fn force_harmonic(rng: &mut Pcg64) -> Planted {
    let hz = off_mains_hz(rng, 8.0, 150.0);
    force_of(hz, rng.random_range(0.2..0.6), 0.0)
}

fn force_beat(rng: &mut Pcg64) -> Planted {
    let hz = off_mains_hz(rng, 15.0, 300.0);
    force_of(hz, 0.0, rng.random_range(0.4..2.0))
}

fn force_fast(rng: &mut Pcg64) -> Planted {
    force_of(off_mains_hz(rng, 900.0, 1500.0), 0.0, 0.0)
}

/// As in `force_of`.
const FORCE_N: (f64, f64) = (2e-4, 0.3);

fn force_square(rng: &mut Pcg64) -> Planted {
    let (hz, sharpness) = (off_mains_hz(rng, 8.0, 150.0), rng.random_range(1.5..6.0));
    Planted::new("force_N", FORCE_N, move |a, bench| bench.forces.push(Force::Square { n: a, hz, sharpness }))
        .with("hz", hz)
        .with("sharpness", sharpness)
}

fn force_knock(rng: &mut Pcg64) -> Planted {
    let (hz, duty) = (off_mains_hz(rng, 8.0, 80.0), rng.random_range(0.08..0.3));
    Planted::new("force_N", FORCE_N, move |a, bench| bench.forces.push(Force::Knock { n: a, hz, duty }))
        .with("hz", hz)
        .with("duty", duty)
}

fn force_wandering(rng: &mut Pcg64) -> Planted {
    // Never nearer to a line of the mains than 1 Hz.
    let (hz, off) = (off_mains_hz(rng, 10.0, 300.0), rng.random_range(0.005..0.03));
    let (off_hz, swing_s) = (f64::min(off * hz, 2.0), log_uniform(rng, 0.5, 5.0));
    Planted::new("force_N", FORCE_N, move |a, bench| {
        bench.forces.push(Force::Wandering { n: a, hz, swing_rad: off_hz * swing_s, swing_s });
    })
    .with("hz", hz)
    .with("off_hz", off_hz)
    .with("swing_s", swing_s)
}

fn force_two(rng: &mut Pcg64) -> Planted {
    let (hz, second) = (off_mains_hz(rng, 8.0, 60.0), rng.random_range(0.3..1.0));
    // Too far apart for a beat, and no harmonic of each other.
    let other_hz = loop {
        let other_hz = off_mains_hz(rng, 1.4 * hz, 300.0);
        let ratio = other_hz / hz;
        if (ratio - ratio.round()).abs() > 0.1 {
            break other_hz;
        }
    };
    Planted::new("force_N", FORCE_N, move |a, bench| {
        bench.forces.push(Force::Periodic { n: a, hz, second: 0.0, beat_hz: 0.0 });
        bench.forces.push(Force::Periodic { n: second * a, hz: other_hz, second: 0.0, beat_hz: 0.0 });
    })
    .with("hz", hz)
    .with("other_hz", other_hz)
    .with("other_over_first", second)
}
