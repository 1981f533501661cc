//! Forms of the amplifier's effects.

use super::{C, D, DC, DCR, Form, Planted, R, log_uniform, sign};
use crate::drive::Drive;
use crate::effects::EffectId::*;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

pub(super) const FORMS: &[Form] = &[
    Form { effect: AmplifierGain, name: "constant", splits: DCR, draw: gain },
    Form { effect: AmplifierGain, name: "shelf: part of the error is lost above a corner", splits: R, draw: shelf },
    Form { effect: AmplifierBandwidth, name: "first-order lag", splits: DC, draw: lag },
    Form { effect: AmplifierBandwidth, name: "second-order lag", splits: C, draw: second_order },
    Form { effect: AmplifierBandwidth, name: "current-limited lag", splits: R, draw: limited_lag },
    Form { effect: AmplifierBandwidth, name: "second-order lag, under-damped", splits: R, draw: ringing },
    Form { effect: AmplifierSlew, name: "hard limit", splits: DC, draw: slew },
    Form { effect: AmplifierSlew, name: "hard limit, faster down than up", splits: C, draw: slew_uneven },
    Form { effect: AmplifierSlew, name: "soft limit (tanh)", splits: R, draw: slew_soft },
    Form { effect: AmplifierSaturation, name: "hard, two-sided", splits: DC, draw: clip },
    Form { effect: AmplifierSaturation, name: "hard, one-sided", splits: D, draw: clip_one_sided },
    Form { effect: AmplifierSaturation, name: "knee with exponential approach", splits: C, draw: clip_knee },
    Form { effect: AmplifierSaturation, name: "tanh", splits: R, draw: clip_tanh },
    Form { effect: AmplifierSaturation, name: "hard, two unequal levels", splits: R, draw: clip_uneven },
];

fn gain(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| bench.drives.push(Drive::Gain(1.0 + sign * a)))
        .with("sign", sign)
}

fn shelf(rng: &mut Pcg64) -> Planted {
    let (sign, loss, corner_hz) = (sign(rng), rng.random_range(0.2..0.6), log_uniform(rng, 20.0, 500.0));
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| {
        bench.drives.push(Drive::Shelf { gain: 1.0 + sign * a, loss: -loss, corner_s: 1.0 / (TAU * corner_hz) });
    })
    .with("sign", sign)
    .with("loss", loss)
    .with("corner_hz", corner_hz)
}

fn lag(_: &mut Pcg64) -> Planted {
    // 100 Hz to 80 kHz.
    Planted::new("tau_s", (2e-6, 1.5e-3), |a, bench| bench.drives.push(Drive::Lag { tau_s: a }))
}

fn second_order_of(damping_ratio: f64) -> Planted {
    // The delay at low frequency is 2 z / w: that is the amplitude.
    Planted::new("delay_s", (2e-6, 1.5e-3), move |a, bench| {
        bench.drives.push(Drive::SecondOrder { rad_per_s: 2.0 * damping_ratio / a, damping_ratio });
    })
    .with("damping_ratio", damping_ratio)
}

fn second_order(rng: &mut Pcg64) -> Planted {
    second_order_of(rng.random_range(0.6..1.2))
}

fn ringing(rng: &mut Pcg64) -> Planted {
    second_order_of(rng.random_range(0.25..0.55))
}

fn limited_lag(rng: &mut Pcg64) -> Planted {
    // Linear while command and output are less than this apart.
    let swing_v = rng.random_range(8.0..30.0);
    Planted::new("tau_s", (2e-6, 1.5e-3), move |a, bench| {
        bench.drives.push(Drive::LimitedLag { tau_s: a, limit_v_per_s: swing_v / a });
    })
    .with("linear_below_V", swing_v)
}

/// 25 kV/s to 50 MV/s: the slowest still follows 60 V at 60 Hz.
const SLEW_S_PER_V: (f64, f64) = (2e-8, 4e-5);

fn slew(_: &mut Pcg64) -> Planted {
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, |a, bench| {
        bench.drives.push(Drive::Slew { up_v_per_s: 1.0 / a, down_v_per_s: 1.0 / a });
    })
}

fn slew_uneven(rng: &mut Pcg64) -> Planted {
    let ratio = rng.random_range(1.3..3.0);
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::Slew { up_v_per_s: 1.0 / a, down_v_per_s: ratio / a });
    })
    .with("down_over_up", ratio)
}

fn slew_soft(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 1e-6, 5e-6);
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::SoftSlew { limit_v_per_s: 1.0 / a, tau_s });
    })
    .with("tau_s", tau_s)
}

/// The largest command of any log; a clip is given as what it takes from that.
const LARGEST_V: f64 = 66.0;

fn clip(_: &mut Pcg64) -> Planted {
    Planted::new("share_cut", (0.002, 0.5), |a, bench| {
        let level_v = LARGEST_V * (1.0 - a);
        bench.drives.push(Drive::Clip { min_v: -level_v, max_v: level_v });
    })
}

fn clip_one_sided(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        let level_v = LARGEST_V * (1.0 - a);
        let (min_v, max_v) = if sign > 0.0 { (-150.0, level_v) } else { (-level_v, 150.0) };
        bench.drives.push(Drive::Clip { min_v, max_v });
    })
    .with("side", sign)
}

fn clip_uneven(rng: &mut Pcg64) -> Planted {
    // Both sides must bite: 60 V lie a tenth below the largest command.
    let share = rng.random_range(0.82..0.96);
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        bench.drives.push(Drive::Clip { min_v: -LARGEST_V * (1.0 - share * a), max_v: LARGEST_V * (1.0 - a) });
    })
    .with("negative_over_positive", share)
}

fn clip_knee(rng: &mut Pcg64) -> Planted {
    let knee = rng.random_range(0.7..0.92);
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        let level_v = LARGEST_V * (1.15 - a);
        bench.drives.push(Drive::SoftClip { knee_v: knee * level_v, level_v });
    })
    .with("knee_over_level", knee)
}

fn clip_tanh(_: &mut Pcg64) -> Planted {
    Planted::new("largest_over_level", (0.05, 0.9), |a, bench| {
        bench.drives.push(Drive::TanhClip { level_v: LARGEST_V / a });
    })
}
