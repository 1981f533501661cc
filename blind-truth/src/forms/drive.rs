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
    Form { effect: AmplifierGain, name: "another one for each polarity", splits: C, draw: gain_by_sign },
    Form { effect: AmplifierGain, name: "growing with the voltage", splits: C, draw: gain_voltage_coefficient },
    Form {
        effect: AmplifierGain,
        name: "larger error about zero, where both halves conduct",
        splits: C,
        draw: gain_overlap,
    },
    Form { effect: AmplifierGain, name: "other error on the upper rails", splits: C, draw: gain_upper_rails },
    Form { effect: AmplifierGain, name: "rippled by its supply", splits: C, draw: gain_rippled },
    Form { effect: AmplifierGain, name: "most of the error there at once", splits: C, draw: gain_settling },
    Form { effect: AmplifierGain, name: "flickering between two values", splits: C, draw: gain_flickering },
    Form { effect: AmplifierBandwidth, name: "first-order lag", splits: DC, draw: lag },
    Form { effect: AmplifierBandwidth, name: "second-order lag", splits: C, draw: second_order },
    Form { effect: AmplifierBandwidth, name: "current-limited lag", splits: R, draw: limited_lag },
    Form { effect: AmplifierBandwidth, name: "second-order lag, under-damped", splits: R, draw: ringing },
    Form { effect: AmplifierBandwidth, name: "lag that grows with the voltage", splits: C, draw: growing_lag },
    Form { effect: AmplifierBandwidth, name: "lag that part of the command runs past", splits: C, draw: lead_lag },
    Form { effect: AmplifierBandwidth, name: "lag, slower one way", splits: C, draw: lag_by_direction },
    Form { effect: AmplifierBandwidth, name: "lag, quicker for a large error", splits: C, draw: hurried_lag },
    Form { effect: AmplifierBandwidth, name: "lag, slower about zero", splits: C, draw: crossover_lag },
    Form { effect: AmplifierSlew, name: "hard limit", splits: DC, draw: slew },
    Form { effect: AmplifierSlew, name: "hard limit, faster down than up", splits: C, draw: slew_uneven },
    Form { effect: AmplifierSlew, name: "soft limit (tanh)", splits: R, draw: slew_soft },
    Form { effect: AmplifierSlew, name: "tighter towards the rails", splits: C, draw: slew_by_level },
    Form { effect: AmplifierSlew, name: "looser until a reserve is used up", splits: C, draw: slew_reserve },
    Form { effect: AmplifierSlew, name: "slower charging than discharging", splits: C, draw: slew_by_charge },
    Form { effect: AmplifierSlew, name: "gives way to a large error", splits: C, draw: slew_by_error },
    Form { effect: AmplifierSaturation, name: "hard, two-sided", splits: DC, draw: clip },
    Form { effect: AmplifierSaturation, name: "hard, one-sided", splits: D, draw: clip_one_sided },
    Form { effect: AmplifierSaturation, name: "knee with exponential approach", splits: C, draw: clip_knee },
    Form { effect: AmplifierSaturation, name: "tanh", splits: R, draw: clip_tanh },
    Form { effect: AmplifierSaturation, name: "hard, two unequal levels", splits: R, draw: clip_uneven },
    Form { effect: AmplifierSaturation, name: "Rapp, sharp", splits: C, draw: clip_rapp },
    Form { effect: AmplifierSaturation, name: "gives way beyond a knee", splits: C, draw: clip_knee_slope },
    Form { effect: AmplifierSaturation, name: "one-sided, rounded", splits: C, draw: clip_round_one_sided },
    Form { effect: AmplifierSaturation, name: "rails that sag under load", splits: C, draw: clip_sagging },
    Form { effect: AmplifierSaturation, name: "rails with a ripple", splits: C, draw: clip_rippled },
    Form { effect: AmplifierSaturation, name: "recovers late", splits: C, draw: clip_late },
];

fn gain(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| bench.drives.push(Drive::Gain(1.0 + sign * a)))
        .with("sign", sign)
}

fn shelf(rng: &mut Pcg64) -> Planted {
    let (sign, loss, corner_hz) = (sign(rng), rng.random_range(0.2..0.6), log_uniform(rng, 20.0, 500.0));
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| {
        bench.drives.push(Drive::Shelf { gain: 1.0 + sign * a, loss, corner_s: 1.0 / (TAU * corner_hz) });
    })
    .with("sign", sign)
    .with("loss", loss)
    .with("corner_hz", corner_hz)
}

fn gain_by_sign(rng: &mut Pcg64) -> Planted {
    let (sign, lesser, down) = (sign(rng), rng.random_range(0.5..0.85), rng.random::<bool>());
    let shares = if down { (1.0, lesser) } else { (lesser, 1.0) };
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| {
        bench.drives.push(Drive::GainBySign { up: 1.0 + sign * shares.0 * a, down: 1.0 + sign * shares.1 * a });
    })
    .with("sign", sign)
    .with("positive_share", shares.0)
    .with("negative_share", shares.1)
}

fn gain_voltage_coefficient(rng: &mut Pcg64) -> Planted {
    let (sign, ratio) = (sign(rng), rng.random_range(0.1..0.5));
    Planted::new("gain_error", (0.001, 0.15), move |a, bench| {
        bench.drives.push(Drive::VoltageCoefficient { error: sign * a, ratio });
    })
    .with("sign", sign)
    .with("more_at_60V", ratio)
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

fn growing_lag(rng: &mut Pcg64) -> Planted {
    let more = rng.random_range(0.4..1.5);
    Planted::new("tau_s", (2e-6, 1.5e-3), move |a, bench| bench.drives.push(Drive::GrowingLag { tau_s: a, more }))
        .with("more_at_60V", more)
}

fn lead_lag(rng: &mut Pcg64) -> Planted {
    let past = rng.random_range(0.2..0.6);
    Planted::new("tau_s", (3e-6, 3e-3), move |a, bench| bench.drives.push(Drive::LeadLag { tau_s: a, past }))
        .with("share_past", past)
}

fn lag_by_direction(rng: &mut Pcg64) -> Planted {
    let (ratio, up) = (rng.random_range(1.4..3.0), rng.random::<bool>());
    Planted::new("tau_s", (2e-6, 1.5e-3), move |a, bench| {
        let (up_s, down_s) = if up { (a, a / ratio) } else { (a / ratio, a) };
        bench.drives.push(Drive::LagByDirection { up_s, down_s });
    })
    .with("slower_over_faster", ratio)
    .with("slower_up", f64::from(u8::from(up)))
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

fn slew_by_level(rng: &mut Pcg64) -> Planted {
    let loss = rng.random_range(0.4..0.85);
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::SlewByLevel { limit_v_per_s: 1.0 / a, loss });
    })
    .with("loss_at_66V", loss)
}

fn slew_reserve(rng: &mut Pcg64) -> Planted {
    let (boost, tau_s) = (rng.random_range(1.0..4.0), log_uniform(rng, 1e-4, 1e-3));
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::SlewReserve { limit_v_per_s: 1.0 / a, boost, tau_s });
    })
    .with("boost", boost)
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

fn clip_rapp(rng: &mut Pcg64) -> Planted {
    let order = rng.random_range(6.0..14.0);
    Planted::new("largest_over_level", (0.35, 1.6), move |a, bench| {
        bench.drives.push(Drive::Rapp { level_v: LARGEST_V / a, order });
    })
    .with("order", order)
}

fn clip_knee_slope(rng: &mut Pcg64) -> Planted {
    let slope = rng.random_range(0.15..0.6);
    Planted::new("share_beyond_knee", (0.002, 0.8), move |a, bench| {
        bench.drives.push(Drive::Knee { knee_v: LARGEST_V * (1.0 - a), slope });
    })
    .with("slope_beyond", slope)
}

fn clip_round_one_sided(rng: &mut Pcg64) -> Planted {
    let (side, over_v) = (sign(rng), rng.random_range(1.0..3.0));
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        // Rounding bites before the level does.
        let level_v = LARGEST_V * (1.0 - a) + 2.5 * over_v;
        bench.drives.push(Drive::RoundClip { side, level_v, over_v });
    })
    .with("side", side)
    .with("rounded_over_V", over_v)
}

fn clip_sagging(rng: &mut Pcg64) -> Planted {
    let (share, tau_s) = (rng.random_range(0.03..0.12), log_uniform(rng, 3e-3, 0.1));
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        bench.drives.push(Drive::SaggingClip { level_v: LARGEST_V * (1.05 - a), share, tau_s });
    })
    .with("sag", share)
    .with("tau_s", tau_s)
}

/// As `gain`: 0.1 to 15 %.
const GAIN: (f64, f64) = (0.001, 0.15);

fn gain_overlap(rng: &mut Pcg64) -> Planted {
    let (sign, ratio, over_v) = (sign(rng), rng.random_range(0.5..1.5), log_uniform(rng, 5.0, 20.0));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.drives.push(Drive::Overlap { error: sign * a, ratio, over_v });
    })
    .with("sign", sign)
    .with("more_about_zero", ratio)
    .with("over_V", over_v)
}

fn gain_upper_rails(rng: &mut Pcg64) -> Planted {
    let (sign, from_v) = (sign(rng), rng.random_range(20.0..40.0));
    let ratio = super::sign(rng) * rng.random_range(0.3..0.8);
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.drives.push(Drive::UpperRails { error: sign * a, ratio, from_v });
    })
    .with("sign", sign)
    .with("more_on_upper_rails", ratio)
    .with("from_V", from_v)
}

fn gain_rippled(rng: &mut Pcg64) -> Planted {
    let (sign, share) = (sign(rng), rng.random_range(0.03..0.15));
    let hz = if rng.random::<bool>() { 100.0 } else { 120.0 };
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.drives.push(Drive::RippledGain { error: sign * a, share, hz });
    })
    .with("sign", sign)
    .with("rippled_share", share)
    .with("hz", hz)
}

fn gain_settling(rng: &mut Pcg64) -> Planted {
    let (sign, share, tau_s) = (sign(rng), rng.random_range(0.1..0.3), log_uniform(rng, 0.1, 1.0));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.drives.push(Drive::SettlingGain { error: sign * a, share, tau_s });
    })
    .with("sign", sign)
    .with("settling_share", share)
    .with("tau_s", tau_s)
}

fn gain_flickering(rng: &mut Pcg64) -> Planted {
    let (sign, share, mean_s) = (sign(rng), rng.random_range(0.08..0.3), log_uniform(rng, 0.05, 0.3));
    Planted::new("gain_error", GAIN, move |a, bench| {
        bench.drives.push(Drive::FlickeringGain { error: sign * a, share, mean_s });
    })
    .with("sign", sign)
    .with("flickering_share", share)
    .with("mean_dwell_s", mean_s)
}

fn hurried_lag(rng: &mut Pcg64) -> Planted {
    let swing_v = rng.random_range(10.0..40.0);
    Planted::new("tau_s", (2e-6, 1.5e-3), move |a, bench| bench.drives.push(Drive::HurriedLag { tau_s: a, swing_v }))
        .with("twice_as_quick_at_V", swing_v)
}

fn crossover_lag(rng: &mut Pcg64) -> Planted {
    let (more, over_v) = (rng.random_range(0.6..2.5), log_uniform(rng, 5.0, 20.0));
    Planted::new("tau_s", (2e-6, 1.5e-3), move |a, bench| {
        bench.drives.push(Drive::CrossoverLag { tau_s: a, more, over_v });
    })
    .with("more_at_zero", more)
    .with("over_V", over_v)
}

fn slew_by_charge(rng: &mut Pcg64) -> Planted {
    let ratio = rng.random_range(1.5..4.0);
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::SlewByCharge { charge_v_per_s: 1.0 / a, discharge_v_per_s: ratio / a });
    })
    .with("discharge_over_charge", ratio)
}

fn slew_by_error(rng: &mut Pcg64) -> Planted {
    let swing_v = rng.random_range(20.0..60.0);
    Planted::new("slowness_s_per_V", SLEW_S_PER_V, move |a, bench| {
        bench.drives.push(Drive::SlewByError { limit_v_per_s: 1.0 / a, swing_v });
    })
    .with("twice_as_fast_at_V", swing_v)
}

fn clip_rippled(rng: &mut Pcg64) -> Planted {
    let share = rng.random_range(0.02..0.08);
    let hz = if rng.random::<bool>() { 100.0 } else { 120.0 };
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        // The trough of the ripple bites first.
        bench.drives.push(Drive::RippledClip { level_v: LARGEST_V * (1.0 - a) / (1.0 - share), share, hz });
    })
    .with("ripple", share)
    .with("hz", hz)
}

fn clip_late(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 1e-4, 2e-3);
    Planted::new("share_cut", (0.002, 0.5), move |a, bench| {
        // Rounding bites before the level does.
        let over_v = 1.5;
        bench.drives.push(Drive::LateClip { level_v: LARGEST_V * (1.0 - a) + 2.5 * over_v, over_v, tau_s });
    })
    .with("tau_s", tau_s)
}
