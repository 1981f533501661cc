//! What the bench is driven with: the set of logs of design.md, and variations of it.
//!
//! All sequences start from 0 V (or the rest level) for a while, so that row 0 is at rest and the noise can be
//! read off.

use crate::bench::Loop;
use crate::effects::Split;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// How much data a case has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Size {
    /// About 11 s in five logs.
    Full,
    /// The same kinds in 3 to 4 s, for many cases.
    Short,
}

/// One recording that is planned.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    /// File name without ending.
    pub name: String,
    /// Rows per second.
    pub rate_hz: f64,
    /// Command in volts, or reference in metres where there is a loop.
    pub rows: Vec<f64>,
    /// The loop that follows the reference.
    pub law: Option<Loop>,
}

impl Plan {
    /// Level of the rest before row 0, in volts.
    pub(crate) fn rest_v(&self) -> f64 {
        if self.law.is_some() { 0.0 } else { self.rows.first().copied().unwrap_or(0.0) }
    }
}

/// PI 2 of the thesis (section 3), without its feedforward: with it the loop overshoots by 37 %.
const PI: Loop = Loop { kp_v_per_m: 2.3164e4, ki_v_per_m_s: 1.8384e8, feedforward_v_per_m: 0.0, limit_v: 90.0 };

/// Rest at 0 V before the motion of a log.
const REST_S: f64 = 0.03;

/// A row sequence under construction.
struct Rows {
    rate_hz: f64,
    values: Vec<f64>,
}

impl Rows {
    fn new(rate_hz: f64) -> Self {
        let mut rows = Self { rate_hz, values: Vec::new() };
        rows.hold(0.0, REST_S);
        rows
    }

    fn count(&self, seconds: f64) -> usize {
        (seconds * self.rate_hz).round() as usize
    }

    fn hold(&mut self, level: f64, seconds: f64) {
        let n = self.count(seconds);
        self.values.extend(std::iter::repeat_n(level, n));
    }

    fn each(&mut self, seconds: f64, value: impl Fn(f64) -> f64) {
        let rate_hz = self.rate_hz;
        let n = self.count(seconds);
        self.values.extend((0..n).map(|k| value(k as f64 / rate_hz)));
    }

    fn sine(&mut self, volts: f64, hz: f64, periods: f64) {
        self.each(periods / hz, |t| volts * (TAU * hz * t).sin());
    }

    fn plan(self, name: &str, law: Option<Loop>) -> Plan {
        // Commands carry the file's digits, so that a replay of the file is a replay of the truth.
        let digits = if law.is_some() { 1e12 } else { 1e6 };
        let rows = self.values.iter().map(|v| (v * digits).round() / digits).collect();
        Plan { name: name.to_owned(), rate_hz: self.rate_hz, rows, law }
    }
}

/// Random-phase multisine of `from_hz` to `to_hz` on the lines of a quarter second, scaled to `rms_v`.
fn multisine(rows: &mut Rows, rms_v: f64, hz: (f64, f64), periods: usize, rng: &mut Pcg64) {
    let period_s = 0.25;
    let orders: Vec<f64> = (1..)
        .map(f64::from)
        .take_while(|order| order / period_s <= hz.1)
        .filter(|order| order / period_s >= hz.0)
        .collect();
    let n = rows.count(period_s);
    // Falling with frequency above 200 Hz, or the fast lines would eat the amplitude.
    let weight = |order: f64| 1.0 / (1.0 + order / period_s / 200.0);
    let wave: Vec<f64> = (0..n).map(|k| (TAU * k as f64 / n as f64).sin()).collect();
    let mut best = (f64::INFINITY, Vec::new());
    // The least peaked of a few draws: a large crest would cost displacement and show nothing.
    for _ in 0..12 {
        let mut period = vec![0.0; n];
        for order in &orders {
            let (size, shift, pace) = (weight(*order), rng.random_range(0..n), *order as usize);
            for (k, v) in period.iter_mut().enumerate() {
                *v += size * wave[(k * pace + shift) % n];
            }
        }
        let rms = (period.iter().map(|v| v * v).sum::<f64>() / n as f64).sqrt();
        let peak = period.iter().fold(0.0, |top: f64, v| top.max(v.abs()));
        if peak / rms < best.0 {
            best = (peak / rms, period.iter().map(|v| v * rms_v / rms).collect());
        }
    }
    for _ in 0..periods {
        rows.values.extend_from_slice(&best.1);
    }
}

/// The logs of a case.
pub(crate) fn logs(split: Split, size: Size, rng: &mut Pcg64) -> Vec<Plan> {
    match split {
        Split::Develop => design_set(20_000.0, 1.0, size, &[1.0, 10.0, 50.0, 100.0, 150.0], &STEPS_V, PI, rng),
        Split::Calibrate | Split::Report => {
            let rate_hz = if rng.random::<bool>() { 20_000.0 } else { 10_000.0 };
            let scale = rng.random_range(0.85..1.05);
            let mut hz: Vec<f64> = [1.0, 10.0, 50.0, 100.0, 150.0].map(|f| f * rng.random_range(0.75..1.3)).to_vec();
            hz.shuffle(rng);
            let mut levels: Vec<f64> =
                STEPS_V[1..9].iter().map(|v| v + rng.random_range(-6.0..3.0) * v.signum()).collect();
            levels.insert(0, 0.0);
            levels.push(0.0);
            // The thesis' order is safe; a shuffled one need not be.
            for _ in 0..200 {
                let mut other = levels.clone();
                other[1..9].shuffle(rng);
                if other.windows(2).all(|pair| is_safe(pair[0], pair[1])) {
                    levels = other;
                    break;
                }
            }
            let gain = rng.random_range(0.6..1.1);
            let law = Loop { kp_v_per_m: gain * PI.kp_v_per_m, ki_v_per_m_s: gain * PI.ki_v_per_m_s, ..PI };
            let mut plans = design_set(rate_hz, scale, size, &hz, &levels, law, rng);
            // Names stay; a diagnosis may not lean on the order of the files.
            plans.shuffle(rng);
            plans
        }
    }
}

/// Whether a step stays below about 125 um: it overshoots by a third of itself.
fn is_safe(from_v: f64, to_v: f64) -> bool {
    (to_v + 0.33 * (to_v - from_v)).abs() < 68.0
}

/// Levels of design.md's step train.
const STEPS_V: [f64; 10] = [0.0, 20.0, 40.0, 60.0, 30.0, 0.0, -30.0, -60.0, -20.0, 0.0];

fn design_set(
    rate_hz: f64,
    scale: f64,
    size: Size,
    hz: &[f64],
    levels_v: &[f64],
    law: Loop,
    rng: &mut Pcg64,
) -> Vec<Plan> {
    let full = size == Size::Full;
    let mut steps = Rows::new(rate_hz);
    for level_v in levels_v {
        steps.hold(level_v * scale, if full { 0.1 } else { 0.05 });
    }
    let mut sines = Rows::new(rate_hz);
    for f in hz {
        let seconds = if full { 0.2 } else { 0.06 };
        let periods = (seconds * f).round().clamp(1.0, 20.0);
        // The slowest sine is half of a short case: it goes at three times the pace.
        let f = if full { *f } else { f.max(3.0) };
        sines.sine(60.0 * scale, f, periods);
        sines.hold(0.0, 0.01);
    }
    let seconds = if full { 0.75 } else { 0.375 };
    sines.each(seconds, |t| 60.0 * scale * (1.0 - t / seconds) * (TAU * 8.0 * t).sin());
    sines.hold(0.0, 0.02);
    let mut many = Rows::new(rate_hz);
    multisine(&mut many, 15.0 * scale, (4.0, 1280.0), if full { 4 } else { 2 }, rng);
    let mut hold = Rows::new(rate_hz);
    let long_s = if full { 5.0 } else { 1.2 };
    hold.hold(40.0 * scale, long_s);
    hold.hold(0.0, if full { 0.47 } else { 0.27 });
    let mut closed = Rows::new(rate_hz);
    for (level_um, seconds) in [(30.0, 0.07), (70.0, 0.07), (20.0, 0.07), (-40.0, 0.07), (0.0, 0.05)] {
        closed.hold(level_um * 1e-6 * scale, if full { seconds } else { 0.6 * seconds });
    }
    closed.sine(50e-6 * scale, 25.0, if full { 6.0 } else { 3.0 });
    vec![
        steps.plan("log1-steps", None),
        sines.plan("log2-sines", None),
        many.plan("log3-multisine", None),
        hold.plan("log4-hold", None),
        closed.plan("log5-closed-loop", Some(law)),
    ]
}

/// Logs that a diagnosis does not see before it is scored: other excitation of the same size.
pub(crate) fn held_out(split: Split, size: Size, rate_hz: f64, rng: &mut Pcg64) -> Vec<Plan> {
    let full = size == Size::Full;
    let (slow_hz, fast_hz) =
        if split == Split::Develop { (5.0, 37.0) } else { (rng.random_range(3.0..9.0), rng.random_range(20.0..90.0)) };
    let mut mixed = Rows::new(rate_hz);
    mixed.each(if full { 0.8 } else { 0.4 }, |t| 30.0 * (TAU * slow_hz * t).sin() + 20.0 * (TAU * fast_hz * t).sin());
    let mut levels = Rows::new(rate_hz);
    let mut left_s = if full { 0.5 } else { 0.3 };
    while left_s > 0.0 {
        let seconds = rng.random_range(0.015..0.06);
        let from_v = levels.values.last().copied().unwrap_or(0.0);
        let to_v: f64 = rng.random_range(-60.0..60.0);
        levels.hold(if is_safe(from_v, to_v) { to_v } else { 0.5 * (from_v + to_v) }, seconds);
        left_s -= seconds;
    }
    levels.hold(0.0, 0.02);
    // Nested triangles: minor loops inside one large one.
    let mut at_v = 0.0;
    for to_v in [55.0, 15.0, 45.0, 25.0, 35.0, -50.0, -10.0, -35.0, 0.0] {
        let seconds: f64 = f64::abs(to_v - at_v) / 1500.0;
        levels.each(seconds, |t| at_v + (to_v - at_v) * t / seconds);
        at_v = to_v;
    }
    levels.hold(0.0, 0.02);
    vec![mixed.plan("held-out-1-mixed", None), levels.plan("held-out-2-levels", None)]
}
