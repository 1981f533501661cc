//! Parts between the moving mass and the logged number: what the sensor sees, filters, adds and rounds.
//!
//! `Follow` parts run with the integrator, because their memory follows the motion between samples. `Measure` parts act
//! once per row: before the noise (`Measure`) or after it (`Digitise`).

use crate::drive::{Chain, Memory, second_order};
use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// A part that follows the motion at every integration step. Input and output in metres.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Follow {
    /// tau y' = x - y (anchors F22).
    Lag { tau_s: f64 },
    /// Complex pole pair: an analogue filter of second order.
    SecondOrder { rad_per_s: f64, damping_ratio: f64 },
    /// Two equal lags in a row.
    TwoLags { tau_s: f64 },
    /// Play: y follows x once x is `half_m` away (anchors F31).
    Play { half_m: f64 },
    /// Play whose contact is a spring against a viscous drag: inside the gap y relaxes slowly to x.
    SoftPlay { half_m: f64, tau_s: f64 },
    /// Lost motion: y stands still while x crosses the gap around `at_m`.
    LostMotion { half_m: f64, at_m: f64 },
    /// y = x + g s, s'' + 2 z w s' + w^2 s = w^2 V (1 V is worth `m_per_v` at rest): a mode beside the main one.
    DriveMode { m_per_v: f64, hz: f64, damping_ratio: f64 },
    /// y = x + g (s - x), s a second-order follower of x: the target sits on a flexible arm.
    ArmMode { share: f64, hz: f64, damping_ratio: f64 },
    /// The reading sticks until the target has moved by `break_m`, then jumps to it (foreign).
    Stiction { break_m: f64 },
}

impl Follow {
    /// Memory at rest at zero.
    pub(crate) fn begin(&self, h_s: f64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Follow::Lag { tau_s } | Follow::TwoLags { tau_s } | Follow::SoftPlay { tau_s, .. } => {
                memory[3] = (-h_s / tau_s).exp()
            }
            _ => {}
        }
        memory
    }

    /// Output at the end of a step from the input `x` there; `drive_v` is the voltage during it.
    #[inline]
    pub(crate) fn step(&self, m: &mut Memory, x: f64, drive_v: f64, h_s: f64) -> f64 {
        match self {
            Follow::Lag { .. } => {
                let y = ramp_lag(m[0], m[1], x, m[3]);
                (m[0], m[1]) = (y, x);
                y
            }
            Follow::TwoLags { .. } => {
                let middle = ramp_lag(m[0], m[1], x, m[3]);
                let y = ramp_lag(m[2], m[0], middle, m[3]);
                (m[0], m[1], m[2]) = (middle, x, y);
                y
            }
            Follow::SecondOrder { rad_per_s, damping_ratio } => {
                let mean = 0.5 * (m[2] + x);
                m[2] = x;
                follow(m, mean, *rad_per_s, *damping_ratio, h_s)
            }
            Follow::Play { half_m } => {
                m[0] = m[0].clamp(x - half_m, x + half_m);
                m[0]
            }
            Follow::SoftPlay { half_m, .. } => {
                m[0] = x + (m[0] - x) * m[3];
                m[0] = m[0].clamp(x - half_m, x + half_m);
                m[0]
            }
            Follow::LostMotion { half_m, at_m } => {
                let away = x - at_m;
                let lost = away.clamp(-half_m, *half_m);
                // The reading at rest (x = 0) stays zero whichever side of the gap it lies on.
                x - lost + (-at_m).clamp(-half_m, *half_m)
            }
            Follow::DriveMode { m_per_v, hz, damping_ratio } => {
                // The voltage's mean belongs to a kick, which ends half a step before this position.
                let shape = follow(m, drive_v, TAU * hz, *damping_ratio, h_s) + 0.5 * h_s * m[1];
                x + m_per_v * shape
            }
            Follow::ArmMode { share, hz, damping_ratio } => {
                let mean = 0.5 * (m[2] + x);
                m[2] = x;
                x + share * (follow(m, mean, TAU * hz, *damping_ratio, h_s) - x)
            }
            Follow::Stiction { break_m } => {
                if (x - m[0]).abs() > *break_m {
                    m[0] = x;
                }
                m[0]
            }
        }
    }
}

/// Exact lag for an input that runs straight from `x0` to `x1` would need tau; the mean input is exact to second order.
fn ramp_lag(y: f64, x0: f64, x1: f64, decay: f64) -> f64 {
    let mean = 0.5 * (x0 + x1);
    mean + (y - mean) * decay
}

fn follow(m: &mut Memory, u: f64, w: f64, z: f64, h: f64) -> f64 {
    let (mut x, mut rate) = (m[0], m[1]);
    second_order(&mut x, &mut rate, u, w, z, h);
    (m[0], m[1]) = (x, rate);
    x
}

/// A part that acts on one row, before the noise. Metres and seconds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Measure {
    /// y = g x (anchors F20).
    Gain(f64),
    /// The gain is another one in each log, about `gain`: the range was calibrated anew.
    GainPerLog { gain: f64, spread: f64 },
    /// y = x + o (anchors F20).
    Offset(f64),
    /// The offset is another one in each log, about `m`: the sensor was zeroed anew.
    OffsetPerLog { m: f64, spread_m: f64 },
    /// y = x + c2 x^2 + c3 x^3 (anchors F21); c2 in 1/m, c3 in 1/m^2.
    Polynomial { c2: f64, c3: f64 },
    /// y = L tanh(x/L) about a centre: compression towards the ends of the range.
    Compression { level_m: f64, centre_m: f64 },
    /// y = x + a sin(2 pi x/p): an interpolating encoder's periodic error.
    Ripple { m: f64, period_m: f64 },
    /// y = x + r t.
    LinearDrift { m_per_s: f64 },
    /// y = x + a (1 - exp(-t/tau)): a warming body (anchors F24).
    ThermalDrift { m: f64, tau_s: f64 },
    /// y = x + a random walk of the given size after one second.
    RandomWalk { m_per_root_s: f64 },
    /// Mains lines: amplitude at the mains' frequency, ratios of the harmonics 2, 3 and 5 (anchors F25).
    Hum { m: f64, hz: f64, second: f64, third: f64, fifth: f64 },
    /// y = x + sum of lags of x (anchors F1 to F3).
    Creep(Chain),
    /// Motion of a hidden second axis: steps at random times through a lag (foreign).
    CrossAxis { m: f64, mean_dwell_s: f64, tau_s: f64 },
    /// Noise that grows with the reading: share of |x| (foreign).
    Multiplicative { share: f64 },
}

/// What `Measure` and `Digitise` parts need to know about the row.
pub(crate) struct Row {
    /// Seconds since the first row; negative in the history before it.
    pub t_s: f64,
    /// Sampling period.
    pub period_s: f64,
}

impl Measure {
    /// Memory at the start; phases and offsets that differ per log are drawn here.
    pub(crate) fn begin(&self, period_s: f64, rng: &mut Pcg64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Measure::Creep(chain) => return chain.begin(period_s),
            Measure::Hum { .. } => {
                memory[0] = rng.random::<f64>() * TAU;
                memory[1] = rng.random::<f64>() * TAU;
                memory[2] = rng.random::<f64>() * TAU;
                memory[3] = rng.random::<f64>() * TAU;
            }
            Measure::GainPerLog { gain, spread } => memory[0] = gain + spread * normal(rng),
            Measure::OffsetPerLog { m, spread_m } => memory[0] = m + spread_m * normal(rng),
            _ => {}
        }
        memory
    }

    /// Reading in metres for the input `x`.
    pub(crate) fn read(&self, m: &mut Memory, x: f64, row: &Row, rng: &mut Pcg64) -> f64 {
        let t_s = row.t_s.max(0.0);
        match self {
            Measure::Gain(gain) => gain * x,
            Measure::GainPerLog { .. } => m[0] * x,
            Measure::Offset(offset) => x + offset,
            Measure::OffsetPerLog { .. } => x + m[0],
            Measure::Polynomial { c2, c3 } => x + c2 * x * x + c3 * x * x * x,
            Measure::Compression { level_m, centre_m } => {
                let at = (centre_m / level_m).tanh();
                level_m * (((x - centre_m) / level_m).tanh() + at) / (1.0 - at * at)
            }
            Measure::Ripple { m: size, period_m } => x + size * (TAU * x / period_m).sin(),
            Measure::LinearDrift { m_per_s } => x + m_per_s * t_s,
            Measure::ThermalDrift { m: size, tau_s } => x - size * (-t_s / tau_s).exp_m1(),
            Measure::RandomWalk { m_per_root_s } => {
                if row.t_s >= 0.0 {
                    m[0] += m_per_root_s * row.period_s.sqrt() * normal(rng);
                }
                x + m[0]
            }
            Measure::Hum { m: size, hz, second, third, fifth } => {
                let line = |order: f64, phase: f64| (TAU * order * hz * row.t_s + phase).sin();
                x + size
                    * (line(1.0, m[0]) + second * line(2.0, m[1]) + third * line(3.0, m[2]) + fifth * line(5.0, m[3]))
            }
            Measure::Creep(chain) => {
                // The mean of two rows is the input between them, to second order.
                let mean = 0.5 * (m[15] + x);
                m[15] = x;
                x + chain.step(m, mean, row.period_s)
            }
            Measure::CrossAxis { m: size, mean_dwell_s, tau_s } => {
                if rng.random::<f64>() < row.period_s / mean_dwell_s {
                    m[0] = size * normal(rng);
                }
                m[1] += (m[0] - m[1]) * (row.period_s / tau_s).min(1.0);
                m[2] += (m[1] - m[2]) * (row.period_s / tau_s).min(1.0);
                x + m[2]
            }
            Measure::Multiplicative { share } => x + share * x.abs() * normal(rng),
        }
    }
}

/// A part that acts on one row after the noise.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Digitise {
    /// More white noise than the data sheet says, rms in metres.
    White { m: f64 },
    /// First-order low-pass noise of the given rms.
    Coloured { m: f64, corner_hz: f64 },
    /// PSD a + b/f: white plus a sum of low-pass noises spaced by a factor of four, rms in metres each way.
    Flicker { white_m: f64, flicker_m: f64 },
    /// Bursts: a share of the rows has noise of the given rms.
    Bursts { m: f64, mean_s: f64 },
    /// Rounded to a lattice (anchors F19).
    Lattice { m: f64 },
    /// Cut downwards instead of rounded, with half a step added back on average.
    Truncation { m: f64 },
    /// A row repeats the one before with this probability (anchors F17).
    Repeat { probability: f64 },
    /// Runs of `length` rows repeat the one before them.
    Burst { probability: f64, length: u32 },
}

impl Digitise {
    /// Reading in metres, given the noisy one.
    pub(crate) fn read(&self, m: &mut Memory, x: f64, row: &Row, rng: &mut Pcg64) -> f64 {
        match self {
            Digitise::White { m: rms } => x + rms * normal(rng),
            Digitise::Coloured { m: rms, corner_hz } => x + rms * low_pass(&mut m[0], *corner_hz, row, rng),
            Digitise::Flicker { white_m, flicker_m } => {
                // Eight octave pairs from 0.5 Hz up; equal power each gives 1/f.
                let mut sum = 0.0;
                let mut corner_hz = 0.5;
                for state in &mut m[0..7] {
                    sum += low_pass(state, corner_hz, row, rng);
                    corner_hz *= 4.0;
                }
                x + white_m * normal(rng) + flicker_m * sum / 7.0_f64.sqrt()
            }
            Digitise::Bursts { m: rms, mean_s } => {
                if rng.random::<f64>() < row.period_s / mean_s {
                    m[0] = 1.0 - m[0];
                }
                x + rms * m[0] * normal(rng)
            }
            Digitise::Lattice { m: step } => (x / step).round() * step,
            Digitise::Truncation { m: step } => ((x / step).floor() + 0.5) * step,
            Digitise::Repeat { probability } => {
                if m[1] == 0.0 || rng.random::<f64>() >= *probability {
                    m[0] = x;
                    m[1] = 1.0;
                }
                m[0]
            }
            Digitise::Burst { probability, length } => {
                if m[2] > 0.0 {
                    m[2] -= 1.0;
                } else if m[1] == 1.0 && rng.random::<f64>() < *probability {
                    m[2] = f64::from(*length) - 1.0;
                } else {
                    m[0] = x;
                    m[1] = 1.0;
                }
                m[0]
            }
        }
    }
}

/// Unit-variance first-order noise, exact for any period.
fn low_pass(state: &mut f64, corner_hz: f64, row: &Row, rng: &mut Pcg64) -> f64 {
    let decay = (-TAU * corner_hz * row.period_s).exp();
    *state = decay * *state + (1.0 - decay * decay).sqrt() * normal(rng);
    *state
}

/// A standard normal draw.
pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    rng.sample(StandardNormal)
}

/// Noise that every sensor has: white, or with a first-order part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Noise {
    /// Total rms in metres.
    pub rms_m: f64,
    /// Share of the power that is low-pass noise; 0 is white.
    pub coloured_share: f64,
    /// Corner of that part.
    pub corner_hz: f64,
}

impl Noise {
    /// One draw; `state` belongs to the low-pass part.
    pub(crate) fn draw(&self, state: &mut f64, row: &Row, rng: &mut Pcg64) -> f64 {
        let white = (1.0 - self.coloured_share).sqrt() * normal(rng);
        if self.coloured_share == 0.0 {
            return self.rms_m * white;
        }
        self.rms_m * (white + self.coloured_share.sqrt() * low_pass(state, self.corner_hz, row, rng))
    }
}
