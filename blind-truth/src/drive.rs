//! Parts between the commanded voltage and the force: amplifier, wiring and the warming of the ceramic.
//!
//! Each part turns the mean voltage over one integration interval into the mean voltage over the same interval, so that
//! an edge inside an interval costs no half step of delay. A part is a setting; what it remembers lives in `Memory`.

use crate::structure::softplus;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// What one part remembers during a run. A fixed array: no part needs more, and a run allocates nothing per step.
pub(crate) type Memory = [f64; 32];

/// A part of the drive chain. Voltages in volts, times in seconds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Drive {
    /// v = g u (anchors F20).
    Gain(f64),
    /// Gain g at rest that loses `loss` of its error above the corner: a leaking feedback divider.
    Shelf { gain: f64, loss: f64, corner_s: f64 },
    /// tau v' = u - v (anchors F11).
    Lag { tau_s: f64 },
    /// v'' = w^2 (u - v) - 2 z w v': amplifier with a complex pole pair.
    SecondOrder { rad_per_s: f64, damping_ratio: f64 },
    /// v' = clip((u - v)/tau, +-limit): a lag whose current is bounded.
    LimitedLag { tau_s: f64, limit_v_per_s: f64 },
    /// v' bounded by `up` and `-down` (anchors F13).
    Slew { up_v_per_s: f64, down_v_per_s: f64 },
    /// v' = s tanh((u - v)/(s tau)): the bound is approached, never met.
    SoftSlew { limit_v_per_s: f64, tau_s: f64 },
    /// v = clip(u, min, max) (anchors F14).
    Clip { min_v: f64, max_v: f64 },
    /// v = u below the knee, then an exponential approach to the level; odd in u.
    SoftClip { knee_v: f64, level_v: f64 },
    /// v = L tanh(u / L).
    TanhClip { level_v: f64 },
    /// v = u / (1 + |u/L|^p)^(1/p): an output stage's compression (Rapp 1991).
    Rapp { level_v: f64, order: f64 },
    /// v = u up to the knee, less than u beyond it by the given share: the stage gives way, but does not stop.
    Knee { knee_v: f64, slope: f64 },
    /// One polarity is bounded, its corner rounded over `over_v`.
    RoundClip { side: f64, level_v: f64, over_v: f64 },
    /// v = clip(u, +-L (1 - s w)), tau w' = |v|/L - w: rails that sag while the supply is loaded.
    SaggingClip { level_v: f64, share: f64, tau_s: f64 },
    /// v = clip(u, +-L (1 - r (1 + sin(2 pi f t + phase))/2)): rails with the rectifier's ripple.
    RippledClip { level_v: f64, share: f64, hz: f64 },
    /// v = clip(u + z), its corner rounded: z is what was cut last and goes with tau once the command comes back
    /// (overload recovery).
    LateClip { level_v: f64, over_v: f64, tau_s: f64 },
    /// v = g u, g by polarity: a push-pull stage whose halves differ.
    GainBySign { up: f64, down: f64 },
    /// v = u (1 + e (1 + r |u|/60 V)): a divider whose resistors have a voltage coefficient.
    VoltageCoefficient { error: f64, ratio: f64 },
    /// v = u (1 + e) + e r s tanh(u/s): a class-AB stage, both halves of which conduct about zero.
    Overlap { error: f64, ratio: f64, over_v: f64 },
    /// v = u (1 + e) + e r max(0, |u| - U) sgn u: a stage that goes over to its upper rails (class G).
    UpperRails { error: f64, ratio: f64, from_v: f64 },
    /// v = u (1 + e (1 + r sin(2 pi f t + phase))): a gain set by a rippled supply.
    RippledGain { error: f64, share: f64, hz: f64 },
    /// v = u (1 + e (1 - r exp(-t/tau))): most of the error there at once, the rest as the feedback resistors warm.
    SettlingGain { error: f64, share: f64, tau_s: f64 },
    /// The gain error is by turns e and e (1 - r), for random dwells: a poor contact in the feedback.
    FlickeringGain { error: f64, share: f64, mean_s: f64 },
    /// v = u + a (sin(2 pi f t + p1) + harmonics 2 and 3): mains on the amplifier's output.
    Hum { v: f64, hz: f64, second: f64, third: f64 },
    /// v = r u + (1 - r) lag of u: a lag that part of the command runs past (pole and zero).
    LeadLag { tau_s: f64, past: f64 },
    /// A lag that charges and discharges through different resistances.
    LagByDirection { up_s: f64, down_s: f64 },
    /// A lag whose load grows with the voltage, as a ceramic's capacitance does: tau (1 + m |v| / 60 V).
    GrowingLag { tau_s: f64, more: f64 },
    /// tau v' = (u - v) (1 + |u - v|/U): a stage that is given more current for a large error.
    HurriedLag { tau_s: f64, swing_v: f64 },
    /// A lag with tau (1 + m / (1 + (v/s)^2)): a class-B stage, starved where its halves take over from each other.
    CrossoverLag { tau_s: f64, more: f64, over_v: f64 },
    /// v' bounded, away from zero the tighter the less head room is left: bound (1 - loss |v| / 66 V).
    SlewByLevel { limit_v_per_s: f64, loss: f64 },
    /// v' bounded away from zero by `charge` and towards it by `discharge`: a supply that cannot take back what it gave.
    SlewByCharge { charge_v_per_s: f64, discharge_v_per_s: f64 },
    /// v' bounded by s (1 + |u - v|/U): a bound that gives way to a large error.
    SlewByError { limit_v_per_s: f64, swing_v: f64 },
    /// v' bounded by s (1 + boost r), tau r' = 1 - r - (share of the bound in use): short edges are faster.
    SlewReserve { limit_v_per_s: f64, boost: f64, tau_s: f64 },
    /// All-pass of second order (Pade) with the given delay.
    AllPass { delay_s: f64 },
    /// v = u + a u^2/U: even part of the ceramic's response.
    Even { per_volt: f64 },
    /// v = L (tanh((u + s)/L) - tanh(s/L)) / (1 - tanh^2(s/L)): envelope with a shifted centre, unit slope at zero.
    TanhEnvelope { level_v: f64, shift_v: f64 },
    /// v = u + c stop(u) u, stop within +-1 after `edge_v`: the loop grows with the voltage.
    SkewedStop { share: f64, edge_v: f64 },
    /// v = u + a max(0, u - at) for one polarity: Kuhnen's one-sided dead zone.
    OneSided { side: f64, slope: f64, at_v: f64 },
    /// v = u + a p^2 / 60 V, p the play of u: strain that goes with the square of a polarisation with its own loop.
    Butterfly { share: f64, edge_v: f64 },
    /// v = u + a (w - w0), w0 a play and w the same whose way back is bent by u^2: Prandtl-Ishlinskii with an envelope
    /// for each branch.
    BentPlay { share: f64, edge_v: f64, bend: f64 },
    /// v = u - a stop(max(0, u)) for one polarity: domains that switch under one sign only.
    OneSidedLoop { side: f64, share: f64, edge_v: f64 },
    /// v = u - a (z - z0), z0' = u' - |u'| z0/s and z the same with another s for each way: Duhem.
    SkewedDuhem { share: f64, over_v: f64, skew: f64 },
    /// v = u - a z, z' = u' - ((1 - c) |u'| z + c u' |z|)/s: Bouc and Wen.
    BoucWen { share: f64, over_v: f64, shape: f64 },
    /// v = u + a (w - w0), w0 a play and w the same whose edge grows with |u'|, smoothed: rate-dependent
    /// Prandtl-Ishlinskii without its part at rest.
    RatePlay { share: f64, edge_v: f64, more_s_per_v: f64 },
    /// v = u - a sum w_i stop_i(u): Prandtl-Ishlinskii on the voltage; pairs of weight and edge in volts.
    Plays { share: f64, plays: Vec<(f64, f64)> },
    /// v = u + a mean of relays that follow the sign of u beyond +-h_i, h_i from `from_v` to `to_v`: Preisach.
    Relays { v: f64, from_v: f64, to_v: f64 },
    /// v = u (1 + a (1 - exp(-t/tau))): warming since the start.
    TimeWarming { gain: f64, tau_s: f64 },
    /// v = u (1 + a T), tau T' = P - T, P = |u u'| over its value for a sine of 60 V and 100 Hz (anchors F10).
    PowerWarming { gain: f64, tau_s: f64 },
    /// v = u (1 + a T), tau T' = (u/60 V)^2 - T: the leak of a held voltage warms.
    LeakWarming { gain: f64, tau_s: f64 },
    /// v = u (1 + a (sin(2 pi t/P + phase) - sin phase)): a room that warms and cools.
    RoomSwing { gain: f64, period_s: f64, phase_rad: f64 },
    /// v = u (1 + a (1 - (1 + t/tau) exp(-t/tau))): heat that comes through another body first.
    LateWarming { gain: f64, tau_s: f64 },
    /// v = u (1 + a (1 - exp(-(t - t1)/tau))) from a random moment t1 <= `within_s` on: a fan that is switched on.
    WarmingFrom { gain: f64, tau_s: f64, within_s: f64 },
    /// v = u (1 - p log10(1 + t/t0)): loss of polarisation (anchors F9).
    Ageing { per_decade: f64, t0_s: f64 },
    /// v = u + sum of lags of u with weights g_i: creep that pushes the structure.
    Creep(Chain),
}

/// Parallel first-order lags: sum_i g_i / (1 + s tau_i).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chain {
    /// Pairs of weight g_i (ratio) and time constant tau_i in seconds; at most 15 of them.
    pub elements: Vec<(f64, f64)>,
}

impl Chain {
    /// Stores the decay of each element over `h_s`; the states start at zero.
    pub(crate) fn begin(&self, h_s: f64) -> Memory {
        let mut memory = [0.0; 32];
        for (i, (_, tau_s)) in self.elements.iter().enumerate() {
            memory[16 + i] = (-h_s / tau_s).exp();
        }
        memory[31] = h_s;
        memory
    }

    /// Advances all elements under a constant input and returns their weighted sum.
    pub(crate) fn step(&self, memory: &mut Memory, input: f64, h_s: f64) -> f64 {
        let mut sum = 0.0;
        for (i, (gain, tau_s)) in self.elements.iter().enumerate() {
            let decay = if h_s == memory[31] { memory[16 + i] } else { (-h_s / tau_s).exp() };
            memory[i] = input + (memory[i] - input) * decay;
            sum += gain * memory[i];
        }
        sum
    }
}

/// How many relays stand for the Preisach plane: their steps are a few millivolts to half a volt.
const RELAYS: usize = 16;

/// Power that warms: that of a sine of 60 V and 100 Hz, mean of |u u'| = 2 f U^2.
const WARMING_REFERENCE_V2_PER_S: f64 = 2.0 * 100.0 * 60.0 * 60.0;

/// Implicit midpoint step of x'' = w^2 (u - x) - 2 z w x' (A-stable, second order). Returns the midpoint of x.
pub(crate) fn second_order(x: &mut f64, rate: &mut f64, u: f64, w: f64, z: f64, h: f64) -> f64 {
    let half = 0.5 * h;
    let rate_mid = (*rate + half * w * w * (u - *x)) / (1.0 + h * z * w + half * half * w * w);
    let x_mid = *x + half * rate_mid;
    *x = 2.0 * x_mid - *x;
    *rate = 2.0 * rate_mid - *rate;
    x_mid
}

/// Where a part stands between command and force, in the order of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum DrivePlace {
    /// On the command's way to the amplifier.
    Command,
    /// The amplifier.
    Amplifier,
    /// On its output, which the monitor shows.
    Output,
    /// The ceramic.
    Ceramic,
}

impl Drive {
    /// Where the part stands, whatever it was planted with.
    pub(crate) fn place(&self) -> DrivePlace {
        match self {
            Drive::AllPass { .. } => DrivePlace::Command,
            Drive::Gain(_)
            | Drive::Shelf { .. }
            | Drive::Lag { .. }
            | Drive::SecondOrder { .. }
            | Drive::LimitedLag { .. }
            | Drive::Slew { .. }
            | Drive::SoftSlew { .. }
            | Drive::Clip { .. }
            | Drive::SoftClip { .. }
            | Drive::TanhClip { .. }
            | Drive::Rapp { .. }
            | Drive::Knee { .. }
            | Drive::RoundClip { .. }
            | Drive::SaggingClip { .. }
            | Drive::RippledClip { .. }
            | Drive::LateClip { .. }
            | Drive::GainBySign { .. }
            | Drive::VoltageCoefficient { .. }
            | Drive::Overlap { .. }
            | Drive::UpperRails { .. }
            | Drive::RippledGain { .. }
            | Drive::SettlingGain { .. }
            | Drive::FlickeringGain { .. }
            | Drive::LeadLag { .. }
            | Drive::LagByDirection { .. }
            | Drive::GrowingLag { .. }
            | Drive::HurriedLag { .. }
            | Drive::CrossoverLag { .. }
            | Drive::SlewByLevel { .. }
            | Drive::SlewByCharge { .. }
            | Drive::SlewByError { .. }
            | Drive::SlewReserve { .. } => DrivePlace::Amplifier,
            Drive::Hum { .. } => DrivePlace::Output,
            Drive::Even { .. }
            | Drive::TanhEnvelope { .. }
            | Drive::SkewedStop { .. }
            | Drive::OneSided { .. }
            | Drive::Butterfly { .. }
            | Drive::BentPlay { .. }
            | Drive::OneSidedLoop { .. }
            | Drive::SkewedDuhem { .. }
            | Drive::BoucWen { .. }
            | Drive::RatePlay { .. }
            | Drive::Plays { .. }
            | Drive::Relays { .. }
            | Drive::TimeWarming { .. }
            | Drive::PowerWarming { .. }
            | Drive::LeakWarming { .. }
            | Drive::RoomSwing { .. }
            | Drive::LateWarming { .. }
            | Drive::WarmingFrom { .. }
            | Drive::Ageing { .. }
            | Drive::Creep(_) => DrivePlace::Ceramic,
        }
    }

    /// Memory at rest, with step-dependent constants filled in; phases and dwells that differ per log are drawn here.
    ///
    /// `before_s` is the length of the history: what is a function of time starts with row 0, which is when the log's
    /// reader starts to count. A line of random phase has no start, and its clock runs from where the run does.
    pub(crate) fn begin(&self, h_s: f64, before_s: f64, rng: &mut Pcg64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Drive::SettlingGain { .. }
            | Drive::FlickeringGain { .. }
            | Drive::RoomSwing { .. }
            | Drive::LateWarming { .. }
            | Drive::WarmingFrom { .. }
            | Drive::Ageing { .. } => memory[0] = -before_s,
            Drive::TimeWarming { .. } => memory[1] = -before_s,
            _ => {}
        }
        match self {
            Drive::RippledGain { .. } | Drive::RippledClip { .. } => memory[1] = rng.random::<f64>() * TAU,
            Drive::WarmingFrom { within_s, .. } => memory[1] = rng.random::<f64>() * within_s,
            Drive::Hum { .. } => memory[1..4].fill_with(|| rng.random::<f64>() * TAU),
            Drive::FlickeringGain { mean_s, .. } => {
                // The moments at which it changes over; after the last it stays.
                let mut at_s = 0.0;
                memory[2..].fill_with(|| {
                    at_s -= mean_s * (1.0 - rng.random::<f64>()).ln();
                    at_s
                });
            }
            Drive::Lag { tau_s }
            | Drive::TimeWarming { tau_s, .. }
            | Drive::PowerWarming { tau_s, .. }
            | Drive::LeakWarming { tau_s, .. }
            | Drive::LeadLag { tau_s, .. } => (memory[3], memory[4]) = ((-h_s / tau_s).exp(), h_s),
            Drive::SlewReserve { .. } => memory[1] = 1.0,
            Drive::Shelf { corner_s, .. } => (memory[3], memory[4]) = ((-h_s / corner_s).exp(), h_s),
            Drive::Creep(chain) => return chain.begin(h_s),
            _ => {}
        }
        memory
    }

    /// Mean output over a step of length `h_s` for the mean input `u`.
    pub(crate) fn step(&self, m: &mut Memory, u: f64, h_s: f64) -> f64 {
        match self {
            Drive::Gain(gain) => gain * u,
            Drive::Shelf { gain, loss, corner_s } => {
                let slow = lag(m, u, *corner_s, h_s);
                u + (gain - 1.0) * (u + loss * (slow - u))
            }
            Drive::Lag { tau_s } => lag(m, u, *tau_s, h_s),
            Drive::SecondOrder { rad_per_s, damping_ratio } => {
                let (mut x, mut rate) = (m[0], m[1]);
                let mid = second_order(&mut x, &mut rate, u, *rad_per_s, *damping_ratio, h_s);
                (m[0], m[1]) = (x, rate);
                mid
            }
            Drive::LimitedLag { tau_s, limit_v_per_s } => {
                // Implicit midpoint of the lag, then the bound: exact on both branches to second order.
                let rate = ((u - m[0]) / (tau_s + 0.5 * h_s)).clamp(-limit_v_per_s, *limit_v_per_s);
                advance(m, rate * h_s)
            }
            Drive::Slew { up_v_per_s, down_v_per_s } => {
                let change = (u - m[0]).clamp(-down_v_per_s * h_s, up_v_per_s * h_s);
                advance(m, change)
            }
            Drive::SoftSlew { limit_v_per_s, tau_s } => {
                let rate = limit_v_per_s * ((u - m[0]) / (limit_v_per_s * (tau_s + 0.5 * h_s))).tanh();
                advance(m, rate * h_s)
            }
            Drive::Clip { min_v, max_v } => u.clamp(*min_v, *max_v),
            Drive::SoftClip { knee_v, level_v } => {
                let room = level_v - knee_v;
                let over = u.abs() - knee_v;
                if over <= 0.0 { u } else { u.signum() * (knee_v + room * (1.0 - (-over / room).exp())) }
            }
            Drive::TanhClip { level_v } => level_v * (u / level_v).tanh(),
            Drive::Rapp { level_v, order } => u / (1.0 + (u / level_v).abs().powf(*order)).powf(1.0 / order),
            Drive::Knee { knee_v, slope } => {
                let within = u.clamp(-knee_v, *knee_v);
                within + slope * (u - within)
            }
            Drive::RoundClip { side, level_v, over_v } => {
                let cut = |v: f64| softplus(side * v - level_v, *over_v);
                u - side * (cut(u) - cut(0.0))
            }
            Drive::SaggingClip { level_v, share, tau_s } => {
                let now_v = level_v * (1.0 - share * m[0]);
                let v = u.clamp(-now_v, now_v);
                m[0] += (v.abs() / level_v - m[0]) * (h_s / tau_s);
                v
            }
            Drive::RippledClip { level_v, share, hz } => {
                let ripple = 0.5 * (1.0 + (TAU * hz * middle_of(m, h_s) + m[1]).sin());
                let now_v = level_v * (1.0 - share * ripple);
                u.clamp(-now_v, now_v)
            }
            Drive::LateClip { level_v, over_v, tau_s } => {
                let cut = |v: f64| v.signum() * (softplus(v.abs() - level_v, *over_v) - softplus(-level_v, *over_v));
                let excess_v = cut(u);
                if excess_v.abs() >= m[0].abs() {
                    m[0] = excess_v;
                } else {
                    m[0] += (excess_v - m[0]) * -(-h_s / tau_s).exp_m1();
                }
                u + m[0] - cut(u + m[0])
            }
            Drive::GainBySign { up, down } => u * if u >= 0.0 { up } else { down },
            Drive::VoltageCoefficient { error, ratio } => u * (1.0 + error * (1.0 + ratio * u.abs() / 60.0)),
            Drive::Overlap { error, ratio, over_v } => u * (1.0 + error) + error * ratio * over_v * (u / over_v).tanh(),
            Drive::UpperRails { error, ratio, from_v } => {
                u * (1.0 + error) + error * ratio * (u - u.clamp(-from_v, *from_v))
            }
            Drive::RippledGain { error, share, hz } => {
                u * (1.0 + error * (1.0 + share * (TAU * hz * middle_of(m, h_s) + m[1]).sin()))
            }
            Drive::SettlingGain { error, share, tau_s } => {
                u * (1.0 + error * (1.0 - share * (-middle_of(m, h_s) / tau_s).exp()))
            }
            Drive::FlickeringGain { error, share, .. } => {
                let t_s = middle_of(m, h_s);
                let changes = m[2..].iter().filter(|at_s| **at_s < t_s).count();
                u * (1.0 + error * if changes % 2 == 0 { 1.0 } else { 1.0 - share })
            }
            Drive::Hum { v, hz, second, third } => {
                let angle = TAU * hz * middle_of(m, h_s);
                let harmonics = second * (2.0 * angle + m[2]).sin() + third * (3.0 * angle + m[3]).sin();
                u + v * ((angle + m[1]).sin() + harmonics)
            }
            Drive::CrossoverLag { tau_s, more, over_v } => {
                let rate_at = |v: f64| {
                    let share = v / over_v;
                    (u - m[0]) / (tau_s * (1.0 + more / (1.0 + share * share)) + 0.5 * h_s)
                };
                // The place halfway through the step.
                let middle_v = m[0] + 0.5 * h_s * rate_at(m[0]);
                advance(m, rate_at(middle_v) * h_s)
            }
            Drive::HurriedLag { tau_s, swing_v } => {
                let rate_at = |v: f64| (u - m[0]) / (tau_s / (1.0 + (u - v).abs() / swing_v) + 0.5 * h_s);
                // The error halfway through the step.
                let middle_v = m[0] + 0.5 * h_s * rate_at(m[0]);
                advance(m, rate_at(middle_v) * h_s)
            }
            Drive::LeadLag { tau_s, past } => past * u + (1.0 - past) * lag(m, u, *tau_s, h_s),
            Drive::LagByDirection { up_s, down_s } => {
                let tau_s = if u >= m[0] { up_s } else { down_s };
                advance(m, (u - m[0]) / (tau_s + 0.5 * h_s) * h_s)
            }
            Drive::GrowingLag { tau_s, more } => {
                // The load halfway through the step.
                let rate_at = |v: f64| (u - m[0]) / (tau_s * (1.0 + more * v.abs() / 60.0) + 0.5 * h_s);
                let middle_v = m[0] + 0.5 * h_s * rate_at(m[0]);
                advance(m, rate_at(middle_v) * h_s)
            }
            Drive::SlewByLevel { limit_v_per_s, loss } => {
                let wish = u - m[0];
                let change = |v: f64| {
                    let room = if wish * v > 0.0 { (1.0 - loss * v.abs() / 66.0).max(0.05) } else { 1.0 };
                    let most = limit_v_per_s * room * h_s;
                    wish.clamp(-most, most)
                };
                // The room halfway through the step.
                let middle_v = m[0] + 0.5 * change(m[0]);
                advance(m, change(middle_v))
            }
            Drive::SlewByCharge { charge_v_per_s, discharge_v_per_s } => {
                let wish_v = u - m[0];
                let zero_s = m[0].abs() / discharge_v_per_s;
                let most_v = if wish_v * m[0] >= 0.0 {
                    charge_v_per_s * h_s
                } else if zero_s >= h_s || u * m[0] >= 0.0 {
                    discharge_v_per_s * h_s
                } else {
                    // Through zero within the step: the rest of it charges.
                    m[0].abs() + charge_v_per_s * (h_s - zero_s)
                };
                advance(m, wish_v.clamp(-most_v, most_v))
            }
            Drive::SlewByError { limit_v_per_s, swing_v } => {
                let change = |v: f64| {
                    let most = limit_v_per_s * (1.0 + (u - v).abs() / swing_v) * h_s;
                    (u - m[0]).clamp(-most, most)
                };
                // The error halfway through the step.
                let middle_v = m[0] + 0.5 * change(m[0]);
                advance(m, change(middle_v))
            }
            Drive::SlewReserve { limit_v_per_s, boost, tau_s } => {
                let most = |reserve: f64| limit_v_per_s * (1.0 + boost * reserve) * h_s;
                let change = |reserve: f64| (u - m[0]).clamp(-most(reserve), most(reserve));
                let refill = |reserve: f64| 1.0 - change(reserve).abs() / most(reserve) - reserve;
                // The reserve halfway through the step.
                let middle = m[1] + 0.5 * h_s / tau_s * refill(m[1]);
                let change_v = change(middle);
                m[1] += h_s / tau_s * refill(middle);
                advance(m, change_v)
            }
            Drive::AllPass { delay_s } => {
                // Pade (2,2): 1 - 2 z w s / (s^2/1 + 2 z w s + w^2) * 2 with w^2 = 12/D^2, 2 z w = 6/D.
                let w = 12.0_f64.sqrt() / delay_s;
                let z = 3.0 / (delay_s * w);
                let (mut x, mut rate) = (m[0], m[1]);
                let before = rate;
                second_order(&mut x, &mut rate, u, w, z, h_s);
                let band = z * w * (before + rate) / (w * w);
                (m[0], m[1]) = (x, rate);
                u - 2.0 * band
            }
            Drive::Even { per_volt } => u + per_volt * u * u,
            Drive::TanhEnvelope { level_v, shift_v } => {
                let centre = (shift_v / level_v).tanh();
                level_v * (((u + shift_v) / level_v).tanh() - centre) / (1.0 - centre * centre)
            }
            Drive::SkewedStop { share, edge_v } => {
                m[0] = m[0].clamp(u - edge_v, u + edge_v);
                u + share * u * (u - m[0]) / edge_v
            }
            Drive::OneSided { side, slope, at_v } => u + side * slope * (side * u - at_v).max(0.0),
            Drive::Butterfly { share, edge_v } => {
                m[0] = m[0].clamp(u - edge_v, u + edge_v);
                u + share * m[0] * m[0] / 60.0
            }
            Drive::BentPlay { share, edge_v, bend } => {
                m[0] = m[0].clamp(u - edge_v, u + edge_v);
                // The bend stays within the width, or the branches would cross.
                let back_v = (u + edge_v + bend * u * u / 60.0).max(u - edge_v);
                m[1] = m[1].clamp(u - edge_v, back_v);
                u + share * (m[1] - m[0])
            }
            Drive::OneSidedLoop { side, share, edge_v } => {
                let one = (side * u).max(0.0);
                m[0] = m[0].clamp(one - edge_v, one + edge_v);
                u - side * share * (one - m[0])
            }
            Drive::SkewedDuhem { share, over_v, skew } => {
                let change_v = u - m[2];
                m[2] = u;
                m[0] = duhem(m[0], change_v, *over_v, *over_v);
                m[1] = duhem(m[1], change_v, over_v * (1.0 + skew), over_v * (1.0 - skew));
                u - share * (m[1] - m[0])
            }
            Drive::BoucWen { share, over_v, shape } => {
                m[0] = bouc_wen(m[0], u - m[2], *over_v, *shape);
                m[2] = u;
                u - share * m[0]
            }
            Drive::RatePlay { share, edge_v, more_s_per_v } => {
                const SMOOTH_S: f64 = 3e-4;
                m[3] += ((u - m[2]) / h_s - m[3]) * -(-h_s / SMOOTH_S).exp_m1();
                m[2] = u;
                // A step's rate has no bound; a ceramic's threshold has.
                let now_v = edge_v * (1.0 + more_s_per_v * m[3].abs()).min(3.0);
                m[0] = m[0].clamp(u - edge_v, u + edge_v);
                m[1] = m[1].clamp(u - now_v, u + now_v);
                u + share * (m[1] - m[0])
            }
            Drive::Plays { share, plays } => {
                let mut held_back = 0.0;
                for (at, (weight, edge_v)) in m.iter_mut().zip(plays) {
                    *at = at.clamp(u - edge_v, u + edge_v);
                    held_back += weight * (u - *at);
                }
                u - share * held_back
            }
            Drive::Relays { v, from_v, to_v } => {
                let last = (RELAYS - 1) as f64;
                for (i, relay) in m[0..RELAYS].iter_mut().enumerate() {
                    if u.abs() > from_v + (to_v - from_v) * i as f64 / last {
                        *relay = u.signum();
                    }
                }
                u + v * m[0..RELAYS].iter().sum::<f64>() / RELAYS as f64
            }
            Drive::TimeWarming { gain, tau_s } => {
                let is_before_row_zero = m[1] < 0.0;
                m[1] += h_s;
                if is_before_row_zero { u } else { u * (1.0 + gain * lag(m, 1.0, *tau_s, h_s)) }
            }
            Drive::PowerWarming { gain, tau_s } => {
                let power = (u * (u - m[1])).abs() / (h_s * WARMING_REFERENCE_V2_PER_S);
                m[1] = u;
                u * (1.0 + gain * lag(m, power, *tau_s, h_s))
            }
            Drive::LeakWarming { gain, tau_s } => {
                let power = (u / 60.0) * (u / 60.0);
                u * (1.0 + gain * lag(m, power, *tau_s, h_s))
            }
            Drive::RoomSwing { gain, period_s, phase_rad } => {
                m[0] += h_s;
                u * (1.0 + gain * ((TAU * m[0].max(0.0) / period_s + phase_rad).sin() - phase_rad.sin()))
            }
            Drive::LateWarming { gain, tau_s } => {
                let t = middle_of(m, h_s) / tau_s;
                u * (1.0 + gain * (1.0 - (1.0 + t) * (-t).exp()))
            }
            Drive::WarmingFrom { gain, tau_s, .. } => {
                let t = (middle_of(m, h_s) - m[1]).max(0.0) / tau_s;
                u * (1.0 - gain * (-t).exp_m1())
            }
            Drive::Ageing { per_decade, t0_s } => {
                m[0] += h_s;
                u * (1.0 - per_decade * (m[0].max(0.0) / t0_s).ln_1p() / std::f64::consts::LN_10)
            }
            Drive::Creep(chain) => u + chain.step(m, u, h_s),
        }
    }
}

/// z after a change of the voltage by which z' = u' - |u'| z/s, with another s for each way: exact for any change.
fn duhem(z: f64, change_v: f64, up_v: f64, down_v: f64) -> f64 {
    let goal = if change_v > 0.0 { up_v } else { -down_v };
    goal + (z - goal) * (-change_v.abs() / goal.abs()).exp()
}

/// z after a change of the voltage by which z' = u' - ((1 - c) |u'| z + c u' |z|)/s: exact for any change.
fn bouc_wen(z: f64, change_v: f64, over_v: f64, shape: f64) -> f64 {
    if change_v == 0.0 {
        return z;
    }
    let mut left_v = change_v.abs();
    let mut size = z;
    if z * change_v < 0.0 {
        // Back to zero first, at the slope 1 + k |z|/s.
        let k = 1.0 - 2.0 * shape;
        let far = over_v / k;
        let zero_v = far * (z.abs() / far).ln_1p();
        if left_v < zero_v {
            return z.signum() * ((z.abs() + far) * (-left_v / far).exp() - far);
        }
        left_v -= zero_v;
        size = 0.0;
    }
    change_v.signum() * (over_v + (size.abs() - over_v) * (-left_v / over_v).exp())
}

/// Exact first-order lag, its decay over the usual step kept in `m[3]`; returns the mean over the step.
fn lag(m: &mut Memory, u: f64, tau_s: f64, h_s: f64) -> f64 {
    let decay = if h_s == m[4] { m[3] } else { (-h_s / tau_s).exp() };
    let change = (m[0] - u) * (decay - 1.0);
    m[0] += change;
    // The integral of the lag's own equation: mean = u - tau (end - start) / h.
    u - tau_s * change / h_s
}

/// Advances the clock in `m[0]` and returns the time in the middle of the step; before row 0 that stands at 0.
fn middle_of(m: &mut Memory, h_s: f64) -> f64 {
    m[0] += h_s;
    (m[0] - 0.5 * h_s).max(0.0)
}

fn advance(m: &mut Memory, change: f64) -> f64 {
    m[0] += change;
    m[0] - 0.5 * change
}
