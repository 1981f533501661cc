//! Parts between the moving mass and the logged number: what the sensor sees, filters, adds and rounds.
//!
//! `Follow` parts run with the integrator, because their memory follows the motion between samples. `Measure` parts act
//! once per row before the noise; what acts after it is in `digitise`.

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
    /// y = r x + (1 - r) lag of x: a lag that part of the signal runs past (pole and zero).
    LeadLag { tau_s: f64, past: f64 },
    /// Complex pole pair: an analogue filter of second order.
    SecondOrder { rad_per_s: f64, damping_ratio: f64 },
    /// Two equal lags in a row.
    TwoLags { tau_s: f64 },
    /// Play: y follows x once x is `half_m` away (anchors F31).
    Play { half_m: f64 },
    /// Play whose contact is a spring against a viscous drag: inside the gap y relaxes slowly to x.
    SoftPlay { half_m: f64, tau_s: f64 },
    /// Play whose width grows along the stroke: half (1 + c x). A guide worn at one end.
    WornPlay { half_m: f64, per_m: f64 },
    /// Mean of four plays about this width: contacts that do not close at once.
    RoughPlay { half_m: f64 },
    /// Lost motion: y stands still while x crosses the gap around `at_m`.
    LostMotion { half_m: f64, at_m: f64 },
    /// y = x + g s, s'' + 2 z w s' + w^2 s = w^2 V (1 V is worth `m_per_v` at rest): a mode beside the main one.
    DriveMode { m_per_v: f64, hz: f64, damping_ratio: f64 },
    /// y = x + g (s - x), s a second-order follower of x: the target sits on a flexible arm.
    ArmMode { share: f64, hz: f64, damping_ratio: f64 },
    /// y = x + g s'/w, s'' + 2 z w s' + w^2 s = w^2 x: a mode that a viscous layer takes along; nothing at rest.
    DraggedMode { share: f64, hz: f64, damping_ratio: f64 },
    /// As `DriveMode`, on a spring that hardens: w^2 grows by (s/at)^2.
    HardeningMode { m_per_v: f64, hz: f64, damping_ratio: f64, at_v: f64 },
    /// A lag whose time constant grows along the stroke, tau (1 + c x): a head that gets less light the farther it is.
    LagByStroke { tau_s: f64, per_m: f64 },
    /// A lag that falls more slowly than it rises: a carrier's rectifier.
    PeakDetector { tau_s: f64, slower: f64 },
    /// As `DriveMode`, in a joint that slips: the damping ratio grows by the given share per `at_v` of swing's rate.
    JointMode { m_per_v: f64, hz: f64, damping_ratio: f64, more: f64, at_v: f64 },
    /// As `DriveMode`, on a mount that works loose: the frequency falls by `share` with tau.
    LooseMode { m_per_v: f64, hz: f64, damping_ratio: f64, share: f64, tau_s: f64 },
    /// Play taken up by a weak spring: inside the gap y goes back to one flank with tau.
    LeaningPlay { half_m: f64, tau_s: f64 },
    /// Play with a loose part in it that flies on with tau between the flanks, and comes off them with a share of its
    /// speed.
    Rattle { half_m: f64, tau_s: f64, back: f64 },
    /// The reading sticks until the target has moved by `break_m`, then jumps to it (foreign).
    Stiction { break_m: f64 },
}

/// Where a part that follows the motion stands, in the order of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum FollowPlace {
    /// Between the mass and what the sensor looks at.
    Structure,
    /// The sensor's head and its filter.
    Sensor,
}

impl Follow {
    /// Where the part stands, whatever it was planted with.
    pub(crate) fn place(&self) -> FollowPlace {
        match self {
            Follow::Play { .. }
            | Follow::SoftPlay { .. }
            | Follow::WornPlay { .. }
            | Follow::RoughPlay { .. }
            | Follow::LostMotion { .. }
            | Follow::DriveMode { .. }
            | Follow::ArmMode { .. }
            | Follow::DraggedMode { .. }
            | Follow::HardeningMode { .. }
            | Follow::JointMode { .. }
            | Follow::LooseMode { .. }
            | Follow::LeaningPlay { .. }
            | Follow::Rattle { .. } => FollowPlace::Structure,
            Follow::Lag { .. }
            | Follow::LeadLag { .. }
            | Follow::SecondOrder { .. }
            | Follow::TwoLags { .. }
            | Follow::LagByStroke { .. }
            | Follow::PeakDetector { .. }
            | Follow::Stiction { .. } => FollowPlace::Sensor,
        }
    }

    /// Memory at rest at zero; `before_s` is the length of the history, for what is a function of time from row 0 on.
    pub(crate) fn begin(&self, h_s: f64, before_s: f64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Follow::Lag { tau_s }
            | Follow::LeadLag { tau_s, .. }
            | Follow::TwoLags { tau_s }
            | Follow::SoftPlay { tau_s, .. }
            | Follow::LeaningPlay { tau_s, .. } => memory[3] = (-h_s / tau_s).exp(),
            Follow::LooseMode { .. } => memory[2] = -before_s,
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
            Follow::LeadLag { past, .. } => {
                let y = ramp_lag(m[0], m[1], x, m[3]);
                (m[0], m[1]) = (y, x);
                past * x + (1.0 - past) * y
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
            Follow::WornPlay { half_m, per_m } => {
                let here_m = half_m * (1.0 + per_m * x).max(0.0);
                m[0] = m[0].clamp(x - here_m, x + here_m);
                m[0]
            }
            Follow::RoughPlay { half_m } => {
                const WIDTHS: [f64; 4] = [0.4, 0.8, 1.2, 1.6];
                for (at, width) in m.iter_mut().zip(WIDTHS) {
                    *at = at.clamp(x - half_m * width, x + half_m * width);
                }
                m[0..4].iter().sum::<f64>() / 4.0
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
            Follow::DraggedMode { share, hz, damping_ratio } => {
                let mean = 0.5 * (m[2] + x);
                m[2] = x;
                follow(m, mean, TAU * hz, *damping_ratio, h_s);
                x + share * m[1] / (TAU * hz)
            }
            Follow::HardeningMode { m_per_v, hz, damping_ratio, at_v } => {
                // The spring halfway through the step.
                let stretch = (m[0] + 0.5 * h_s * m[1]) / at_v;
                let stiffer = (1.0 + stretch * stretch).sqrt();
                let force_v = drive_v / (stiffer * stiffer);
                let shape = follow(m, force_v, TAU * hz * stiffer, damping_ratio / stiffer, h_s) + 0.5 * h_s * m[1];
                x + m_per_v * shape
            }
            Follow::LagByStroke { tau_s, per_m } => {
                let mean = 0.5 * (m[1] + x);
                m[1] = x;
                let here_s = tau_s * (1.0 + per_m * mean).max(0.1);
                m[0] += (mean - m[0]) * h_s / (here_s + 0.5 * h_s);
                m[0]
            }
            Follow::PeakDetector { tau_s, slower } => {
                let mean = 0.5 * (m[1] + x);
                m[1] = x;
                let way_s = if mean >= m[0] { *tau_s } else { slower * tau_s };
                m[0] += (mean - m[0]) * h_s / (way_s + 0.5 * h_s);
                m[0]
            }
            Follow::JointMode { m_per_v, hz, damping_ratio, more, at_v } => {
                // The rate halfway through the step.
                let w = TAU * hz;
                let swing = ((m[1] / w + 0.5 * h_s * w * (drive_v - m[0])) / at_v).abs();
                let ratio = damping_ratio * (1.0 + more * swing);
                let shape = follow(m, drive_v, TAU * hz, ratio, h_s) + 0.5 * h_s * m[1];
                x + m_per_v * shape
            }
            Follow::LooseMode { m_per_v, hz, damping_ratio, share, tau_s } => {
                m[2] += h_s;
                let now_hz = hz * (1.0 + share * (-m[2].max(0.0) / tau_s).exp_m1());
                let shape = follow(m, drive_v, TAU * now_hz, *damping_ratio, h_s) + 0.5 * h_s * m[1];
                x + m_per_v * shape
            }
            Follow::LeaningPlay { half_m, .. } => {
                // At rest the part leans on its flank, and the sensor was zeroed so.
                m[0] = x + (m[0] - x) * m[3];
                m[0] = m[0].clamp(x - 2.0 * half_m, x);
                m[0]
            }
            Follow::Rattle { half_m, tau_s, back } => {
                let base = (x - m[2]) / h_s;
                m[2] = x;
                m[1] *= (-h_s / tau_s).exp();
                m[0] += h_s * m[1];
                let flank = m[0].clamp(x - half_m, x + half_m);
                if flank != m[0] {
                    // Only what runs into the flank comes off it.
                    let against = (m[1] - base) * (m[0] - flank);
                    if against > 0.0 {
                        m[1] = base - back * (m[1] - base);
                    }
                    m[0] = flank;
                }
                m[0]
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
    /// y = (1 + e (1 - r exp(-t/tau))) x: a gain error that settles after switching on.
    SettlingGain { error: f64, share: f64, tau_s: f64 },
    /// y = g x, g by polarity: one half bridge of two is off by more.
    GainBySign { up: f64, down: f64 },
    /// y = (1 + e (1 + r sin(2 pi t/P + phase))) x: a reference voltage that breathes.
    BreathingGain { error: f64, share: f64, period_s: f64 },
    /// A gain error that becomes another one at a random moment t1 <= `within_s`: a range switch that makes poor contact.
    SteppedGain { error: f64, later: f64, within_s: f64 },
    /// y = (1 + e (1 - r A)) x, tau A' = |x|/S - A: an automatic control of the carrier that gives in while deflected.
    ControlledGain { error: f64, share: f64, tau_s: f64 },
    /// The offset is another one in each log, about `m`: the sensor was zeroed anew.
    OffsetPerLog { m: f64, spread_m: f64 },
    /// y = x + o, with o either 0 or this, after random dwells: a contact that chatters.
    Chatter { m: f64, mean_s: f64 },
    /// y = x + c2 x^2 + c3 x^3 (anchors F21); c2 in 1/m, c3 in 1/m^2.
    Polynomial { c2: f64, c3: f64 },
    /// y = x + c4 x^4 + c5 x^5: what a correction of third degree leaves; c4 in 1/m^3, c5 in 1/m^4.
    HighPolynomial { c4: f64, c5: f64 },
    /// Errors at nodes spaced by `pitch_m` about zero, straight in between: a calibration table.
    Table { error_m: [f64; 9], pitch_m: f64 },
    /// y = x + g |x|: two half bridges that differ.
    Kink { share: f64 },
    /// y = x + a exp(-((x - at)/w)^2), zero at rest: a flaw of the target.
    Flaw { m: f64, at_m: f64, width_m: f64 },
    /// y = L tanh(x/L) about a centre: compression towards the ends of the range.
    Compression { level_m: f64, centre_m: f64 },
    /// y = x + a sin(2 pi x/p): an interpolating encoder's periodic error.
    Ripple { m: f64, period_m: f64 },
    /// Steps where a converter's upper bits carry: at `at_m`, and half as high a pitch away on either side.
    Carries { m: f64, at_m: f64, pitch_m: f64 },
    /// y = x + r w tanh(x/w): the slope about zero is another one, as where a differential coil is balanced.
    Hollow { share: f64, width_m: f64 },
    /// y = x + r t.
    LinearDrift { m_per_s: f64 },
    /// y = x + a (1 - exp(-t/tau)): a warming body (anchors F24).
    ThermalDrift { m: f64, tau_s: f64 },
    /// y = x + a sqrt(t): moisture that diffuses into a glue.
    RootDrift { m_per_root_s: f64 },
    /// y = x + a (sin(2 pi t/P + phase) - sin phase): an air conditioner's cycle.
    SwingDrift { m: f64, period_s: f64 },
    /// y = x + a (1 - exp(-(t - t1)/tau)) from a random moment t1 <= `within_s` on: a clamp that slips once.
    Slip { m: f64, tau_s: f64, within_s: f64 },
    /// y = x + a log10(1 + t/t0): a joint that goes on settling after it was tightened.
    LogDrift { m_per_decade: f64, from_s: f64 },
    /// y = x + a (1 - (1 + t/tau) exp(-t/tau)): heat that comes through another body first.
    LateDrift { m: f64, tau_s: f64 },
    /// y = x + r (t - t1) from a random moment t1 <= `within_s` on: a door was opened.
    DriftFrom { m_per_s: f64, within_s: f64 },
    /// Small steps the same way after random dwells: a joint that gives way in jerks.
    Jerks { m: f64, mean_s: f64 },
    /// A heater that is switched on for a share of each period: rise and fall are exponentials.
    Thermostat { m: f64, period_s: f64, on_share: f64 },
    /// y = x + a random walk of the given size after one second.
    RandomWalk { m_per_root_s: f64 },
    /// Mains lines: amplitude at the mains' frequency, ratios of the harmonics 2, 3 and 5 (anchors F25).
    Hum { m: f64, hz: f64, second: f64, third: f64, fifth: f64 },
    /// A mains line with third harmonic whose phase swings: a grid that is not quite at its frequency.
    LooseHum { m: f64, hz: f64, third: f64, swing_rad: f64, swing_s: f64 },
    /// A mains line with third harmonic that waxes and wanes: a machine nearby whose load changes.
    SwellingHum { m: f64, hz: f64, third: f64, depth: f64, swell_hz: f64 },
    /// A jump in each half wave that dies out with exp(-k) before the next: a phase-cut dimmer or a rectifier's diodes.
    CutHum { m: f64, hz: f64, decay: f64 },
    /// y = (1 - w) x + w mean of the last n rows: digital smoothing; at most 30 rows.
    Smoothing { weight: f64, rows: u32 },
    /// As `Creep`, of x |x| / S: creep that grows with the square of the stroke.
    SquareCreep(Chain),
    /// As `Creep`, less by a ratio for negative x: a ceramic poled one way.
    SidedCreep { chain: Chain, negative: f64 },
    /// y = x + a z, z a pair of lags of x (the other eight times slower) that go back more slowly than they came.
    SlowReturn { share: f64, tau_s: f64, slower: f64 },
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

/// Where a part that acts on a row stands, in the order of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MeasurePlace {
    /// Motion: the sensor's errors are no part of what it is made from.
    Motion,
    /// The sensor.
    Sensor,
    /// What its cable picks up.
    Cable,
    /// The rows' own filter.
    Rows,
}

impl Measure {
    /// Where the part stands, whatever it was planted with.
    pub(crate) fn place(&self) -> MeasurePlace {
        match self {
            Measure::Creep(_)
            | Measure::SquareCreep(_)
            | Measure::SidedCreep { .. }
            | Measure::SlowReturn { .. }
            | Measure::CrossAxis { .. } => MeasurePlace::Motion,
            Measure::Gain(_)
            | Measure::GainPerLog { .. }
            | Measure::Offset(_)
            | Measure::SettlingGain { .. }
            | Measure::GainBySign { .. }
            | Measure::BreathingGain { .. }
            | Measure::SteppedGain { .. }
            | Measure::ControlledGain { .. }
            | Measure::OffsetPerLog { .. }
            | Measure::Chatter { .. }
            | Measure::Polynomial { .. }
            | Measure::HighPolynomial { .. }
            | Measure::Table { .. }
            | Measure::Kink { .. }
            | Measure::Flaw { .. }
            | Measure::Compression { .. }
            | Measure::Ripple { .. }
            | Measure::Carries { .. }
            | Measure::Hollow { .. }
            | Measure::LinearDrift { .. }
            | Measure::ThermalDrift { .. }
            | Measure::RootDrift { .. }
            | Measure::SwingDrift { .. }
            | Measure::Slip { .. }
            | Measure::LogDrift { .. }
            | Measure::LateDrift { .. }
            | Measure::DriftFrom { .. }
            | Measure::Jerks { .. }
            | Measure::Thermostat { .. }
            | Measure::RandomWalk { .. }
            | Measure::Multiplicative { .. } => MeasurePlace::Sensor,
            Measure::Hum { .. } | Measure::LooseHum { .. } | Measure::SwellingHum { .. } | Measure::CutHum { .. } => {
                MeasurePlace::Cable
            }
            Measure::Smoothing { .. } => MeasurePlace::Rows,
        }
    }

    /// Memory at the start; phases and offsets that differ per log are drawn here.
    pub(crate) fn begin(&self, period_s: f64, rng: &mut Pcg64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Measure::Creep(chain) | Measure::SquareCreep(chain) | Measure::SidedCreep { chain, .. } => {
                return chain.begin(period_s);
            }
            Measure::SwingDrift { .. } | Measure::CutHum { .. } | Measure::BreathingGain { .. } => {
                memory[0] = rng.random::<f64>() * TAU;
            }
            Measure::Thermostat { .. } => memory[0] = rng.random::<f64>(),
            Measure::LooseHum { .. } | Measure::SwellingHum { .. } => {
                memory[0..3].fill_with(|| rng.random::<f64>() * TAU)
            }
            Measure::Slip { within_s, .. }
            | Measure::DriftFrom { within_s, .. }
            | Measure::SteppedGain { within_s, .. } => memory[0] = rng.random::<f64>() * within_s,
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
            Measure::SettlingGain { error, share, tau_s } => x * (1.0 + error * (1.0 - share * (-t_s / tau_s).exp())),
            Measure::GainBySign { up, down } => x * if x >= 0.0 { up } else { down },
            Measure::BreathingGain { error, share, period_s } => {
                x * (1.0 + error * (1.0 + share * (TAU * t_s / period_s + m[0]).sin()))
            }
            Measure::SteppedGain { error, later, .. } => x * (1.0 + if t_s < m[0] { error } else { later }),
            Measure::ControlledGain { error, share, tau_s } => {
                m[0] += (x.abs() / CREEP_STROKE_M - m[0]) * (row.period_s / tau_s);
                x * (1.0 + error * (1.0 - share * m[0]))
            }
            Measure::Offset(offset) => x + offset,
            Measure::OffsetPerLog { .. } => x + m[0],
            Measure::Chatter { m: size, mean_s } => {
                if row.t_s > 0.0 && rng.random::<f64>() < row.period_s / mean_s {
                    m[0] = 1.0 - m[0];
                }
                x + size * m[0]
            }
            Measure::Polynomial { c2, c3 } => x + c2 * x * x + c3 * x * x * x,
            Measure::HighPolynomial { c4, c5 } => x + x * x * x * x * (c4 + c5 * x),
            Measure::Table { error_m, pitch_m } => {
                let last = error_m.len() - 1;
                let at = (x / pitch_m + 0.5 * last as f64).clamp(0.0, last as f64);
                let node = (at as usize).min(last - 1);
                x + error_m[node] + (error_m[node + 1] - error_m[node]) * (at - node as f64)
            }
            Measure::Kink { share } => x + share * x.abs(),
            Measure::Flaw { m: size, at_m, width_m } => {
                let flaw = |x: f64| (-((x - at_m) / width_m).powi(2)).exp();
                x + size * (flaw(x) - flaw(0.0))
            }
            Measure::Compression { level_m, centre_m } => {
                let at = (centre_m / level_m).tanh();
                level_m * (((x - centre_m) / level_m).tanh() + at) / (1.0 - at * at)
            }
            Measure::Ripple { m: size, period_m } => x + size * (TAU * x / period_m).sin(),
            Measure::Carries { m: size, at_m, pitch_m } => {
                let carry = |x: f64, at: f64| if x >= at { 1.0 } else { 0.0 };
                let sum = |x: f64| carry(x, *at_m) + 0.5 * (carry(x, at_m - pitch_m) + carry(x, at_m + pitch_m));
                x + size * (sum(x) - sum(0.0))
            }
            Measure::Hollow { share, width_m } => x + share * width_m * (x / width_m).tanh(),
            Measure::LinearDrift { m_per_s } => x + m_per_s * t_s,
            Measure::ThermalDrift { m: size, tau_s } => x - size * (-t_s / tau_s).exp_m1(),
            Measure::RootDrift { m_per_root_s } => x + m_per_root_s * t_s.sqrt(),
            Measure::SwingDrift { m: size, period_s } => x + size * ((TAU * t_s / period_s + m[0]).sin() - m[0].sin()),
            Measure::Slip { m: size, tau_s, .. } => x - size * (-(t_s - m[0]).max(0.0) / tau_s).exp_m1(),
            Measure::LogDrift { m_per_decade, from_s } => {
                x + m_per_decade * (t_s / from_s).ln_1p() / std::f64::consts::LN_10
            }
            Measure::LateDrift { m: size, tau_s } => x + size * (1.0 - (1.0 + t_s / tau_s) * (-t_s / tau_s).exp()),
            Measure::DriftFrom { m_per_s, .. } => x + m_per_s * (t_s - m[0]).max(0.0),
            Measure::Jerks { m: size, mean_s } => {
                if row.t_s > 0.0 && rng.random::<f64>() < row.period_s / mean_s {
                    m[0] += size * (0.5 + rng.random::<f64>());
                }
                x + m[0]
            }
            Measure::Thermostat { m: size, period_s, on_share } => {
                x + size * (heated(t_s / period_s + m[0], *on_share) - heated(m[0], *on_share))
            }
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
            Measure::LooseHum { m: size, hz, third, swing_rad, swing_s } => {
                let angle = TAU * hz * row.t_s + swing_rad * (TAU * row.t_s / swing_s + m[1]).sin() + m[0];
                x + size * (angle.sin() + third * (3.0 * angle + m[2]).sin())
            }
            Measure::SwellingHum { m: size, hz, third, depth, swell_hz } => {
                let angle = TAU * hz * row.t_s + m[0];
                let swell = 1.0 + depth * (TAU * swell_hz * row.t_s + m[1]).sin();
                x + size * swell * (angle.sin() + third * (3.0 * angle + m[2]).sin())
            }
            Measure::CutHum { m: size, hz, decay } => {
                let half_waves = 2.0 * hz * row.t_s + m[0];
                let way = if half_waves.floor().rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 };
                x + size * way * (-decay * half_waves.rem_euclid(1.0)).exp()
            }
            Measure::Smoothing { weight, rows } => {
                let n = *rows as usize;
                let mean = m[0..n].iter().sum::<f64>() / n as f64;
                m[m[31] as usize % n] = x;
                m[31] += 1.0;
                x + weight * (mean - x)
            }
            Measure::SquareCreep(chain) => {
                let mean = 0.5 * (m[15] + x);
                m[15] = x;
                x + chain.step(m, mean * mean.abs() / CREEP_STROKE_M, row.period_s)
            }
            Measure::SidedCreep { chain, negative } => {
                let mean = 0.5 * (m[15] + x);
                m[15] = x;
                x + chain.step(m, if mean > 0.0 { mean } else { negative * mean }, row.period_s)
            }
            Measure::SlowReturn { share, tau_s, slower } => {
                let mean = 0.5 * (m[15] + x);
                m[15] = x;
                for (at, scale) in m[0..2].iter_mut().zip([1.0, 8.0]) {
                    // It comes while it grows, and goes back while it shrinks.
                    let pace = if (mean - *at) * *at >= 0.0 { 1.0 } else { *slower };
                    *at += (mean - *at) * -(-row.period_s / (scale * pace * tau_s)).exp_m1();
                }
                x + 0.5 * share * (m[0] + m[1])
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

/// Temperature between 0 and 1 under a heater that is on for the first `on_share` of each turn.
fn heated(turns: f64, on_share: f64) -> f64 {
    const STEEP: f64 = 1.5;
    let turn = turns.rem_euclid(1.0);
    let risen = |share: f64| (-STEEP * share).exp_m1() / (-STEEP).exp_m1();
    if turn < on_share { risen(turn / on_share) } else { 1.0 - risen((turn - on_share) / (1.0 - on_share)) }
}

/// Stroke at which `SquareCreep` is as large as `Creep`, and that `ControlledGain` is relative to.
const CREEP_STROKE_M: f64 = 100e-6;

/// A standard normal draw.
pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    rng.sample(StandardNormal)
}
