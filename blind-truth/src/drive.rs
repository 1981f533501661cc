//! Parts between the commanded voltage and the force: amplifier, wiring and the warming of the ceramic.
//!
//! Each part turns the mean voltage over one integration interval into the mean voltage over the same interval, so that
//! an edge inside an interval costs no half step of delay. A part is a setting; what it remembers lives in `Memory`.

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
    /// All-pass of second order (Pade) with the given delay.
    AllPass { delay_s: f64 },
    /// v = u + a u^2/U: even part of the ceramic's response.
    Even { per_volt: f64 },
    /// v = L (tanh((u + s)/L) - tanh(s/L)) / (1 - tanh^2(s/L)): envelope with a shifted centre, unit slope at zero.
    TanhEnvelope { level_v: f64, shift_v: f64 },
    /// v = u (1 + a (1 - exp(-t/tau))): warming since the start.
    TimeWarming { gain: f64, tau_s: f64 },
    /// v = u (1 + a T), tau T' = P - T, P = |u u'| over its value for a sine of 60 V and 100 Hz (anchors F10).
    PowerWarming { gain: f64, tau_s: f64 },
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

impl Drive {
    /// Memory at rest at `u0_v`, with step-dependent constants filled in.
    pub(crate) fn begin(&self, h_s: f64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Drive::Lag { tau_s } | Drive::TimeWarming { tau_s, .. } | Drive::PowerWarming { tau_s, .. } => {
                (memory[3], memory[4]) = ((-h_s / tau_s).exp(), h_s)
            }
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
            Drive::TimeWarming { gain, tau_s } => u * (1.0 + gain * lag(m, 1.0, *tau_s, h_s)),
            Drive::PowerWarming { gain, tau_s } => {
                let power = (u * (u - m[1])).abs() / (h_s * WARMING_REFERENCE_V2_PER_S);
                m[1] = u;
                u * (1.0 + gain * lag(m, power, *tau_s, h_s))
            }
            Drive::Ageing { per_decade, t0_s } => {
                m[0] += h_s;
                u * (1.0 - per_decade * (m[0] / t0_s).ln_1p() / std::f64::consts::LN_10)
            }
            Drive::Creep(chain) => u + chain.step(m, u, h_s),
        }
    }
}

/// Exact first-order lag, its decay over the usual step kept in `m[3]`; returns the mean over the step.
fn lag(m: &mut Memory, u: f64, tau_s: f64, h_s: f64) -> f64 {
    let decay = if h_s == m[4] { m[3] } else { (-h_s / tau_s).exp() };
    let change = (m[0] - u) * (decay - 1.0);
    m[0] += change;
    // The integral of the lag's own equation: mean = u - tau (end - start) / h.
    u - tau_s * change / h_s
}

fn advance(m: &mut Memory, change: f64) -> f64 {
    m[0] += change;
    m[0] - 0.5 * change
}
