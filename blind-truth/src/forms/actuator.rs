//! Forms of the ceramic's effects: creep, hysteresis, warming, and what the plant file says of it.

use super::{C, CR, D, DC, DR, Form, Planted, R, log_uniform, sign};
use crate::bench::{Bench, History, Start};
use crate::drive::{Chain, Drive};
use crate::effects::EffectId::*;
use crate::hysteron::{Hysteron, Side};
use crate::sensor::Measure;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: Creep, name: "Kelvin-Voigt, one lag", splits: D, draw: creep_one },
    Form { effect: Creep, name: "Kelvin-Voigt chain", splits: DC, draw: creep_chain },
    Form { effect: Creep, name: "hysteron without dead zone", splits: DC, draw: creep_hysteron },
    Form { effect: Creep, name: "logarithm of time", splits: C, draw: creep_log },
    Form { effect: Creep, name: "fractional power law", splits: R, draw: creep_power },
    Form { effect: Creep, name: "logarithm of time, through the structure", splits: R, draw: creep_log_force },
    Form { effect: Creep, name: "stretched exponential", splits: C, draw: creep_stretched },
    Form { effect: Creep, name: "growing with the square of the stroke", splits: C, draw: creep_square },
    Form { effect: Creep, name: "more towards one side", splits: C, draw: creep_sided },
    Form { effect: Creep, name: "going back more slowly than it came", splits: C, draw: creep_slow_return },
    Form { effect: ThermalGain, name: "with time", splits: DC, draw: warm_time },
    Form { effect: ThermalGain, name: "with drive power", splits: CR, draw: warm_power },
    Form { effect: ThermalGain, name: "falling with the logarithm of time", splits: R, draw: warm_ageing },
    Form { effect: ThermalGain, name: "with the held voltage", splits: C, draw: warm_leak },
    Form { effect: ThermalGain, name: "swinging with the room", splits: C, draw: warm_room },
    Form { effect: ThermalGain, name: "up and back down with time", splits: C, draw: warm_two },
    Form { effect: ThermalGain, name: "late, through another body", splits: C, draw: warm_late },
    Form { effect: ThermalGain, name: "from a moment on", splits: C, draw: warm_from },
    Form { effect: InitialState, name: "slow hysteron charged beyond its edge", splits: DC, draw: start_charged },
    Form { effect: InitialState, name: "mass in motion", splits: D, draw: start_moving },
    Form { effect: InitialState, name: "a step shortly before", splits: C, draw: start_just_moved },
    Form { effect: InitialState, name: "charged and in motion", splits: R, draw: start_both },
    Form { effect: InitialState, name: "a step back shortly before", splits: R, draw: start_just_moved_late },
    Form { effect: InitialState, name: "a sine that stops shortly before", splits: C, draw: start_just_rang },
    Form { effect: InitialState, name: "a stairway back shortly before", splits: C, draw: start_just_climbed },
    Form { effect: InitialState, name: "a ramp back shortly before", splits: C, draw: start_just_ramped },
    Form { effect: InitialState, name: "random steps that stop shortly before", splits: C, draw: start_just_shaken },
    Form {
        effect: ParameterError,
        name: "stiffness",
        splits: D,
        draw: |rng| wrong(rng, |f, b| b.stiffness_n_per_m *= f),
    },
    Form {
        effect: ParameterError,
        name: "damping",
        splits: DR,
        draw: |rng| wrong(rng, |f, b| b.damping_n_s_per_m *= f),
    },
    Form {
        effect: ParameterError,
        name: "transduction",
        splits: C,
        draw: |rng| wrong(rng, |f, b| b.transduction_c_per_m *= f),
    },
    Form {
        effect: ParameterError,
        name: "slow dead zone",
        splits: DC,
        draw: |rng| wrong(rng, |f, b| slow(b, |s| s.half_v *= f)),
    },
    Form {
        effect: ParameterError,
        name: "slow capacitance",
        splits: R,
        draw: |rng| wrong(rng, |f, b| slow(b, |s| s.capacitance_f *= f)),
    },
    Form { effect: ParameterError, name: "fast capacitance", splits: R, draw: wrong_fast_capacitance },
    Form {
        effect: ParameterError,
        name: "slow leak",
        splits: C,
        draw: |rng| wrong(rng, |f, b| slow(b, |s| s.slope_s *= f)),
    },
    Form { effect: ParameterError, name: "fast dead zone", splits: C, draw: wrong_fast_dead_zone },
];

/// Weights that grow with tau^a on log-spaced time constants: J(t) ~ t^a; a = 0 is the logarithm of time.
fn kernel(total: f64, a: f64, from_s: f64, to_s: f64, n: usize) -> Chain {
    let tau = |i: usize| from_s * (to_s / from_s).powf(i as f64 / (n - 1) as f64);
    let weights: Vec<f64> = (0..n).map(|i| tau(i).powf(a)).collect();
    let sum: f64 = weights.iter().sum();
    Chain { elements: weights.iter().enumerate().map(|(i, weight)| (total * weight / sum, tau(i))).collect() }
}

/// Share of the stroke that creeps in the end (anchors F2: 1 to 5 %, room for more and less).
const CREEP: (f64, f64) = (0.0005, 0.3);

fn creep_one(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 0.05, 2.0);
    Planted::new("share", CREEP, move |a, bench| {
        bench.measures.push(Measure::Creep(Chain { elements: vec![(a, tau_s)] }));
    })
    .with("tau_s", tau_s)
}

fn creep_chain(rng: &mut Pcg64) -> Planted {
    let from_s = log_uniform(rng, 0.01, 0.1);
    let n = rng.random_range(2..=4);
    let weights: Vec<f64> = (0..n).map(|_| rng.random_range(0.5..1.5)).collect();
    let sum: f64 = weights.iter().sum();
    let elements: Vec<(f64, f64)> =
        weights.iter().enumerate().map(|(i, weight)| (weight / sum, from_s * 10.0_f64.powi(i as i32))).collect();
    Planted::new("share", CREEP, move |a, bench| {
        let elements = elements.iter().map(|(weight, tau_s)| (a * weight, *tau_s)).collect();
        bench.measures.push(Measure::Creep(Chain { elements }));
    })
    .with("fastest_tau_s", from_s)
    .with("elements", f64::from(n))
}

fn creep_hysteron(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 0.05, 2.0);
    Planted::new("stiffness_share", CREEP, move |a, bench| {
        let capacitance_f = capacitance(bench, a);
        bench.hysterons.push(Hysteron::symmetric(capacitance_f, capacitance_f / tau_s, 0.0));
    })
    .with("tau_s", tau_s)
}

/// Capacitance whose stiffness alpha^2/C is the given share of k.
pub(super) fn capacitance(bench: &Bench, share: f64) -> f64 {
    bench.transduction_c_per_m * bench.transduction_c_per_m / (share * bench.stiffness_n_per_m)
}

fn creep_log(rng: &mut Pcg64) -> Planted {
    let from_s = log_uniform(rng, 0.005, 0.05);
    // The share is per decade of time (anchors F1: 1 to 2 %): six decades.
    Planted::new("share_per_decade", (0.0002, 0.08), move |a, bench| {
        bench.measures.push(Measure::Creep(kernel(6.0 * a, 0.0, from_s, from_s * 1e6, 13)));
    })
    .with("from_s", from_s)
}

fn creep_log_force(rng: &mut Pcg64) -> Planted {
    let from_s = log_uniform(rng, 0.002, 0.02);
    Planted::new("share_per_decade", (0.0002, 0.08), move |a, bench| {
        bench.drives.push(Drive::Creep(kernel(6.0 * a, 0.0, from_s, from_s * 1e6, 7)));
    })
    .with("from_s", from_s)
}

fn creep_power(rng: &mut Pcg64) -> Planted {
    let power = rng.random_range(0.1..0.35);
    Planted::new("share_in_the_end", (0.002, 1.0), move |a, bench| {
        bench.measures.push(Measure::Creep(kernel(a, power, 0.002, 500.0, 13)));
    })
    .with("power", power)
}

fn creep_stretched(rng: &mut Pcg64) -> Planted {
    // 1 - exp(-sqrt(t/tau)) has the weights sqrt(T) exp(-T/4) over the logarithm of T = tau_i/tau.
    let tau_s = log_uniform(rng, 0.02, 0.3);
    let scales: Vec<f64> = (0..13).map(|i| 0.01 * 3000.0_f64.powf(f64::from(i) / 12.0)).collect();
    let sum: f64 = scales.iter().map(|scale| scale.sqrt() * (-0.25 * scale).exp()).sum();
    let elements: Vec<(f64, f64)> =
        scales.iter().map(|scale| (scale.sqrt() * (-0.25 * scale).exp() / sum, scale * tau_s)).collect();
    Planted::new("share", CREEP, move |a, bench| {
        let elements = elements.iter().map(|(weight, tau_s)| (a * weight, *tau_s)).collect();
        bench.measures.push(Measure::Creep(Chain { elements }));
    })
    .with("tau_s", tau_s)
}

fn creep_square(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 0.02, 0.3);
    Planted::new("share_at_stroke", CREEP, move |a, bench| {
        let elements = vec![(0.5 * a, tau_s), (0.5 * a, 10.0 * tau_s)];
        bench.measures.push(Measure::SquareCreep(Chain { elements }));
    })
    .with("tau_s", tau_s)
}

fn warm_time(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.3, 3.0));
    Planted::new("gain_share", (0.0005, 0.15), move |a, bench| {
        bench.drives.push(Drive::TimeWarming { gain: sign * a, tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn warm_power(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.1, 2.0));
    Planted::new("gain_share_at_60V_100Hz", (0.001, 1.0), move |a, bench| {
        bench.drives.push(Drive::PowerWarming { gain: sign * a, tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn warm_ageing(rng: &mut Pcg64) -> Planted {
    let t0_s = log_uniform(rng, 0.05, 0.5);
    Planted::new("loss_per_decade", (0.0005, 0.1), move |a, bench| {
        bench.drives.push(Drive::Ageing { per_decade: a, t0_s });
    })
    .with("t0_s", t0_s)
}

fn warm_leak(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.05, 1.0));
    Planted::new("gain_share_at_60V", (0.0005, 0.3), move |a, bench| {
        bench.drives.push(Drive::LeakWarming { gain: sign * a, tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn warm_room(rng: &mut Pcg64) -> Planted {
    let (period_s, phase_rad) = (log_uniform(rng, 0.8, 6.0), rng.random_range(0.0..std::f64::consts::TAU));
    Planted::new("gain_share", (0.0005, 0.15), move |a, bench| {
        bench.drives.push(Drive::RoomSwing { gain: a, period_s, phase_rad });
    })
    .with("period_s", period_s)
    .with("phase_rad", phase_rad)
}

fn warm_two(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.05, 0.4));
    let (slower, back) = (rng.random_range(4.0..12.0), rng.random_range(0.6..1.2));
    Planted::new("gain_share", (0.001, 0.3), move |a, bench| {
        bench.drives.push(Drive::TimeWarming { gain: sign * a, tau_s });
        bench.drives.push(Drive::TimeWarming { gain: -sign * back * a, tau_s: slower * tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
    .with("slower_over_faster", slower)
    .with("back_share", back)
}

/// Half the dead zone is 4.3 V: what is beyond relaxes with 4.5 ms; what is below stays as an offset that any rest may
/// have. The raw gap is mostly that offset, so the size is drawn and not sought.
const CHARGE_V: (f64, f64) = (6.0, 16.0);

fn start_charged(_: &mut Pcg64) -> Planted {
    Planted::new("charge_V", CHARGE_V, |a, bench| {
        bench.start = Start { precharge_v: a, ..Start::default() };
    })
    .any_gap()
}

fn start_moving(_: &mut Pcg64) -> Planted {
    Planted::new("velocity_m_per_s", (0.01, 0.8), |a, bench| {
        bench.start = Start { velocity_m_per_s: a, ..Start::default() };
    })
}

fn start_both(rng: &mut Pcg64) -> Planted {
    let per_volt = rng.random_range(0.005..0.03);
    Planted::new("charge_V", CHARGE_V, move |a, bench| {
        bench.start = Start { precharge_v: a, velocity_m_per_s: per_volt * a };
    })
    .with("velocity_per_volt", per_volt)
    .any_gap()
}

fn just_moved(rest_s: f64) -> Planted {
    Planted::new("step_V", (35.0, 60.0), move |a, bench| bench.history = History::JustMoved { volts: a, rest_s })
        .with("rest_s", rest_s)
        .any_gap()
}

fn start_just_moved(rng: &mut Pcg64) -> Planted {
    just_moved(log_uniform(rng, 1e-3, 4e-3))
}

fn start_just_moved_late(rng: &mut Pcg64) -> Planted {
    just_moved(log_uniform(rng, 4e-4, 2e-3))
}

fn start_just_rang(rng: &mut Pcg64) -> Planted {
    let (hz, rest_s) = (log_uniform(rng, 40.0, 160.0), log_uniform(rng, 5e-4, 2.5e-3));
    Planted::new("amplitude_V", (40.0, 58.0), move |a, bench| {
        bench.history = History::JustRang { volts: a, hz, rest_s };
    })
    .with("hz", hz)
    .with("rest_s", rest_s)
    .any_gap()
}

fn start_just_climbed(rng: &mut Pcg64) -> Planted {
    let (steps, rest_s) = (rng.random_range(3..=6), log_uniform(rng, 6e-4, 3e-3));
    Planted::new("stairway_V", (40.0, 60.0), move |a, bench| {
        bench.history = History::JustClimbed { volts: a, steps, rest_s };
    })
    .with("steps", f64::from(steps))
    .with("rest_s", rest_s)
    .any_gap()
}

/// Changes both sides of the slow hysteron alike.
fn slow(bench: &mut Bench, change: impl Fn(&mut Side)) {
    let hysteron = &mut bench.hysterons[1];
    change(&mut hysteron.up);
    change(&mut hysteron.down);
}

/// 10 % off, give or take a little, while the plant file goes on claiming 1 %.
fn wrong(rng: &mut Pcg64, change: impl Fn(f64, &mut Bench) + Send + Sync + 'static) -> Planted {
    let sign = sign(rng);
    Planted::new("error", (0.09, 0.11), move |a, bench| change(1.0 + sign * a, bench)).with("sign", sign).any_gap()
}

fn wrong_fast_capacitance(rng: &mut Pcg64) -> Planted {
    wrong(rng, |factor, bench| {
        bench.hysterons[0].up.capacitance_f *= factor;
        bench.hysterons[0].down.capacitance_f *= factor;
    })
}

fn creep_sided(rng: &mut Pcg64) -> Planted {
    let (tau_s, lesser, up) = (log_uniform(rng, 0.02, 0.3), rng.random_range(0.3..0.75), rng.random::<bool>());
    Planted::new("share", CREEP, move |a, bench| {
        // The chain's weights are the positive side's.
        let (weight, negative) = if up { (a, lesser) } else { (lesser * a, 1.0 / lesser) };
        let chain = Chain { elements: vec![(0.5 * weight, tau_s), (0.5 * weight, 10.0 * tau_s)] };
        bench.measures.push(Measure::SidedCreep { chain, negative });
    })
    .with("tau_s", tau_s)
    .with("lesser_over_larger", lesser)
    .with("larger_up", f64::from(u8::from(up)))
}

fn creep_slow_return(rng: &mut Pcg64) -> Planted {
    let (tau_s, slower) = (log_uniform(rng, 0.02, 0.2), rng.random_range(1.5..5.0));
    Planted::new("share", CREEP, move |a, bench| {
        bench.measures.push(Measure::SlowReturn { share: a, tau_s, slower });
    })
    .with("tau_s", tau_s)
    .with("slower_back", slower)
}

fn warm_late(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.15, 1.5));
    Planted::new("gain_share", (0.0005, 0.3), move |a, bench| {
        bench.drives.push(Drive::LateWarming { gain: sign * a, tau_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn warm_from(rng: &mut Pcg64) -> Planted {
    let (sign, tau_s, within_s) = (sign(rng), log_uniform(rng, 0.1, 1.0), rng.random_range(0.3..0.8));
    Planted::new("gain_share", (0.0005, 0.3), move |a, bench| {
        bench.drives.push(Drive::WarmingFrom { gain: sign * a, tau_s, within_s });
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
    .with("starts_within_s", within_s)
}

fn start_just_ramped(rng: &mut Pcg64) -> Planted {
    let (ramp_s, rest_s) = (log_uniform(rng, 2e-3, 1.5e-2), log_uniform(rng, 4e-4, 2e-3));
    Planted::new("ramp_V", (40.0, 60.0), move |a, bench| {
        bench.history = History::JustRamped { volts: a, ramp_s, rest_s };
    })
    .with("ramp_s", ramp_s)
    .with("rest_s", rest_s)
    .any_gap()
}

fn start_just_shaken(rng: &mut Pcg64) -> Planted {
    let rest_s = log_uniform(rng, 4e-4, 2e-3);
    Planted::new("level_V", (35.0, 50.0), move |a, bench| {
        bench.history = History::JustShaken { volts: a, rest_s };
    })
    .with("rest_s", rest_s)
    .any_gap()
}

fn wrong_fast_dead_zone(rng: &mut Pcg64) -> Planted {
    wrong(rng, |factor, bench| {
        bench.hysterons[0].up.half_v *= factor;
        bench.hysterons[0].down.half_v *= factor;
    })
}
