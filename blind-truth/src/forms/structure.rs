//! Forms of the mechanical effects.

use super::{C, CR, D, DC, DCR, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::bench::Bench;
use crate::effects::EffectId::*;
use crate::nominal::static_gain_m_per_v;
use crate::sensor::Follow;
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

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
    Form { effect: VibrationMode, name: "light base on rubber feet", splits: C, draw: mode_base },
    Form { effect: VibrationMode, name: "target plate on a flexure", splits: C, draw: mode_plate },
    Form { effect: VibrationMode, name: "surge of the preload spring", splits: C, draw: mode_surge },
    Form { effect: VibrationMode, name: "in a joint that slips when it swings", splits: C, draw: mode_joint },
    Form { effect: VibrationMode, name: "on a mount that works loose", splits: C, draw: mode_loose },
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
    Form { effect: NonlinearStiffness, name: "balls on either side", splits: C, draw: hertz },
    Form { effect: NonlinearStiffness, name: "detent of a magnet's poles", splits: C, draw: detent },
    Form { effect: AsymmetricStiffness, name: "quadratic", splits: D, draw: quadratic },
    Form { effect: AsymmetricStiffness, name: "bilinear", splits: DC, draw: bilinear },
    Form { effect: AsymmetricStiffness, name: "second spring engages gradually", splits: CR, draw: engaging },
    Form { effect: AsymmetricStiffness, name: "bilinear and quadratic", splits: R, draw: bilinear_quadratic },
    Form { effect: AsymmetricStiffness, name: "fourth power", splits: C, draw: quartic },
    Form { effect: AsymmetricStiffness, name: "exponential", splits: C, draw: exponential },
    Form { effect: AsymmetricStiffness, name: "magnet on one side", splits: C, draw: magnet },
    Form { effect: AsymmetricStiffness, name: "rubber cone, pressed in", splits: C, draw: cone },
    Form { effect: PayloadMass, name: "rigid", splits: DCR, draw: payload },
    Form { effect: PayloadMass, name: "on a stiff mount", splits: C, draw: payload_mounted },
    Form { effect: PayloadMass, name: "rigid, with some damping", splits: R, draw: payload_damped },
    Form { effect: PayloadMass, name: "rigid, rocking a little", splits: C, draw: payload_rocking },
    Form { effect: PayloadMass, name: "partly dragged along by a liquid", splits: C, draw: payload_liquid },
    Form { effect: PeriodicForce, name: "sine", splits: DC, draw: force_sine },
    Form { effect: PeriodicForce, name: "sine with its second harmonic", splits: C, draw: force_harmonic },
    Form { effect: PeriodicForce, name: "sine with a slow beat", splits: R, draw: force_beat },
    Form { effect: PeriodicForce, name: "sine above the mode", splits: R, draw: force_fast },
    Form { effect: PeriodicForce, name: "almost square", splits: C, draw: force_square },
    Form { effect: PeriodicForce, name: "one push per turn", splits: C, draw: force_knock },
    Form { effect: PeriodicForce, name: "frequency wanders", splits: C, draw: force_wandering },
    Form { effect: PeriodicForce, name: "two unrelated lines", splits: C, draw: force_two },
    Form { effect: PeriodicForce, name: "sine with half its order", splits: C, draw: force_half_order },
    Form { effect: PeriodicForce, name: "saw tooth", splits: C, draw: force_saw },
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
        if is_off_mains(hz) {
            return hz;
        }
    }
}

fn is_off_mains(hz: f64) -> bool {
    let far = |mains: f64| (hz - mains * (hz / mains).round()).abs() > 3.0 || hz < mains / 2.0;
    far(50.0) && far(60.0)
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

fn mode_base(rng: &mut Pcg64) -> Planted {
    // The moving mass shakes what it stands on; the sensor stands on it too.
    let (hz, damping_ratio) = (log_uniform(rng, 25.0, 90.0), log_uniform(rng, 0.03, 0.15));
    Planted::new("share", MODE, move |a, bench| {
        bench.follows.push(Follow::ArmMode { share: a, hz, damping_ratio });
    })
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_plate(rng: &mut Pcg64) -> Planted {
    let (mass_share, damping_ratio) = (log_uniform(rng, 0.02, 0.15), log_uniform(rng, 0.005, 0.03));
    // Softness is what the plate lags by at the main mode's 900 Hz: 1.3 to 9 kHz.
    Planted::new("softness", (0.01, 0.5), move |a, bench| {
        let (kg, hz) = (mass_share * bench.mass_kg, 900.0 / a.sqrt());
        bench.mass_kg -= kg;
        bench.forces.push(Force::Absorber { kg, hz, damping_ratio });
        bench.follows.push(Follow::ArmMode { share: 1.0, hz, damping_ratio });
    })
    .with("mass_share", mass_share)
    .with("damping_ratio", damping_ratio)
}

fn mode_surge(rng: &mut Pcg64) -> Planted {
    let (hz, damping_ratio) = (log_uniform(rng, 250.0, 700.0), log_uniform(rng, 0.005, 0.03));
    Planted::new("mass_share", (0.001, 0.3), move |a, bench| {
        let first_kg = a * bench.mass_kg;
        for order in [1.0, 2.0, 3.0] {
            let kg = first_kg / (order * order);
            bench.mass_kg -= kg;
            bench.forces.push(Force::Absorber { kg, hz: order * hz, damping_ratio });
        }
    })
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
}

fn mode_joint(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    let (more, at_v) = (rng.random_range(0.5..3.0), 20.0);
    Planted::new("share", MODE, move |a, bench| {
        let m_per_v = sign * a * static_gain_m_per_v();
        bench.follows.push(Follow::JointMode { m_per_v, hz, damping_ratio, more, at_v });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
    .with("more_damping_at_20V", more)
}

fn mode_loose(rng: &mut Pcg64) -> Planted {
    let ((hz, damping_ratio), sign) = (mode_hz(rng), sign(rng));
    let (share, tau_s) = (rng.random_range(0.02..0.1), log_uniform(rng, 0.2, 2.0));
    Planted::new("share", MODE, move |a, bench| {
        let m_per_v = sign * a * static_gain_m_per_v();
        bench.follows.push(Follow::LooseMode { m_per_v, hz, damping_ratio, share, tau_s });
    })
    .with("sign", sign)
    .with("hz", hz)
    .with("damping_ratio", damping_ratio)
    .with("loosened_by", share)
    .with("tau_s", tau_s)
}

fn hertz(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("share_at_stroke", NONLINEAR, move |a, bench| {
        bench.forces.push(Force::Hertz { n_per_m: sign * a * bench.stiffness_n_per_m, at_m: STROKE_M });
    })
    .with("sign", sign)
}

fn detent(rng: &mut Pcg64) -> Planted {
    let (sign, period_m) = (sign(rng), log_uniform(rng, 90e-6, 220e-6));
    Planted::new("detent_over_k", NONLINEAR, move |a, bench| {
        bench.forces.push(Force::Detent { n_per_m: sign * a * bench.stiffness_n_per_m, period_m });
    })
    .with("sign", sign)
    .with("period_um", period_m * 1e6)
}

fn magnet(rng: &mut Pcg64) -> Planted {
    let (side, away_m) = (sign(rng), log_uniform(rng, 250e-6, 600e-6));
    Planted::new("share_at_stroke", STEEP, move |a, bench| {
        let near = STROKE_M / away_m;
        let pull = 0.5 / near * ((1.0 - near).powi(-2) - 1.0 - 2.0 * near);
        bench.forces.push(Force::Magnet { n_per_m: a * bench.stiffness_n_per_m / pull, away_m: side * away_m });
    })
    .with("side", side)
    .with("away_um", away_m * 1e6)
}

fn cone(rng: &mut Pcg64) -> Planted {
    let (side, pressed_m) = (sign(rng), log_uniform(rng, 140e-6, 300e-6));
    Planted::new("share_at_stroke", STEEP, move |a, bench| {
        let share = STROKE_M / pressed_m;
        let push = ((1.0 + share).powf(1.5) - 1.0 - 1.5 * share) / (1.5 * share);
        bench.forces.push(Force::Cone { n_per_m: a * bench.stiffness_n_per_m / push, pressed_m: side * pressed_m });
    })
    .with("side", side)
    .with("pressed_um", pressed_m * 1e6)
}

fn payload_rocking(rng: &mut Pcg64) -> Planted {
    let (read, hz) = (sign(rng) * rng.random_range(0.08..0.2), log_uniform(rng, 1.5e3, 2.5e3));
    Planted::new("mass_share", PAYLOAD, move |a, bench| {
        bench.mass_kg *= 1.0 + a;
        bench.follows.push(Follow::ArmMode { share: read * a, hz, damping_ratio: 0.02 });
    })
    .with("rocking_over_mass_share", read)
    .with("rocking_hz", hz)
    .any_gap()
}

fn payload_liquid(rng: &mut Pcg64) -> Planted {
    let (share, tau_s) = (rng.random_range(0.15..0.5), log_uniform(rng, 3e-5, 3e-4));
    Planted::new("mass_share", PAYLOAD, move |a, bench| {
        let kg = a * bench.mass_kg;
        bench.mass_kg += (1.0 - share) * kg;
        // A spring of 10 Hz only keeps the liquid in its vessel; its drag alone takes it along.
        let hz = 10.0;
        bench.forces.push(Force::Absorber { kg: share * kg, hz, damping_ratio: 0.5 / (TAU * hz * tau_s) });
    })
    .with("liquid_share", share)
    .with("tau_s", tau_s)
    .any_gap()
}

fn force_half_order(rng: &mut Pcg64) -> Planted {
    let hz = loop {
        let hz = off_mains_hz(rng, 16.0, 160.0);
        if is_off_mains(0.5 * hz) {
            break hz;
        }
    };
    let half = rng.random_range(0.2..0.8);
    Planted::new("force_N", FORCE_N, move |a, bench| bench.forces.push(Force::HalfOrder { n: a, hz, half }))
        .with("hz", hz)
        .with("half_order", half)
}

fn force_saw(rng: &mut Pcg64) -> Planted {
    let (hz, quick) = (off_mains_hz(rng, 8.0, 120.0), rng.random_range(0.05..0.3));
    Planted::new("force_N", FORCE_N, move |a, bench| bench.forces.push(Force::Saw { n: a, hz, quick }))
        .with("hz", hz)
        .with("quick_share", quick)
}
