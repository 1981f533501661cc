//! Forces on the moving mass beyond its linear spring and damper, friction with true stick included.
//!
//! Signs: a force here is what the part does to the mass, in newtons; q in metres, w = q' in metres per second.

use crate::drive::Memory;
use std::f64::consts::TAU;

/// A part that pushes on the mass.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Force {
    /// F = -k3 q^3 (Duffing, anchors F29). N/m^3.
    Cubic { n_per_m3: f64 },
    /// F = -k5 q^5. N/m^5.
    Quintic { n_per_m5: f64 },
    /// F = +s k q (q^2/(q0^2 + q^2)): a spring that softens and then levels off at k (1 - s).
    Levelling { n_per_m: f64, at_m: f64 },
    /// F = -k2 q |q|: a membrane's odd square. N/m^2.
    OddSquare { n_per_m2: f64 },
    /// F = -k (s sinh(q/s) - q): hardening in all odd powers.
    Sinh { n_per_m: f64, over_m: f64 },
    /// F = -k4 q^4 (asymmetric). N/m^4.
    Quartic { n_per_m4: f64 },
    /// F = -k (s (exp(q/s) - 1) - q): an enclosed cushion, stiffer towards the sign of s.
    Exponential { n_per_m: f64, over_m: f64 },
    /// F = -k q sqrt(|q|/q0): balls on either side, pressed by the stroke (Hertz, odd).
    Hertz { n_per_m: f64, at_m: f64 },
    /// F = -k (p/2 pi) sin(2 pi q/p): the detent of a magnet's poles.
    Detent { n_per_m: f64, period_m: f64 },
    /// F = +k g/2 ((1 - q/g)^-2 - 1 - 2 q/g): a magnet at the distance g, without its linear part.
    Magnet { n_per_m: f64, away_m: f64 },
    /// F = -k (2 d/3) ((1 + q/d)^1.5 - 1 - 1.5 q/d): a rubber cone pressed in by d, without its linear part.
    Cone { n_per_m: f64, pressed_m: f64 },
    /// F = -k2 q^2 (asymmetric). N/m^2.
    Quadratic { n_per_m2: f64 },
    /// F = -dk q for q > 0 only: bilinear spring.
    Bilinear { n_per_m: f64 },
    /// F = -dk s ln(1 + exp((q - at)/s)) + its value at 0: a second spring that engages gradually.
    Engaging { n_per_m: f64, at_m: f64, over_m: f64 },
    /// F = -kc max(0, q - gap) (anchors F31).
    Stop { n_per_m: f64, gap_m: f64 },
    /// F = -kn d^1.5 (1 + c d') with d = max(0, q - gap), never pulling: Hunt and Crossley 1975.
    HuntCrossley { n_per_m15: f64, gap_m: f64, s_per_m: f64 },
    /// Stops on both sides, each with its damper while in contact.
    TwoStops { n_per_m: f64, gap_m: f64, n_s_per_m: f64 },
    /// A soft bumper of the given thickness before a hard wall, on either side.
    Bumper { side: f64, n_per_m: f64, gap_m: f64, thick_m: f64, soft_share: f64 },
    /// A linear contact that sticks: once made it holds in tension up to a neck of this length.
    StickyStop { n_per_m: f64, gap_m: f64, neck_m: f64 },
    /// A pad that creeps (standard linear solid): F = -k max(0, d - s z), tau z' = max(d, s z) - z, d = q - gap.
    PadStop { n_per_m: f64, gap_m: f64, share: f64, tau_s: f64 },
    /// F = -kc s ln(1 + exp((q - gap)/s)), on either side: rough faces whose peaks meet one after the other.
    RoughStop { side: f64, n_per_m: f64, gap_m: f64, over_m: f64 },
    /// F = -kc d (1 + mu tanh(w/w0)): a stop whose face rubs along while pressed.
    RubbingStop { n_per_m: f64, gap_m: f64, friction: f64 },
    /// F = -(F0 (1 - exp(-d/s)) + kc d): a pin held against its seat by a preloaded spring.
    PreloadedStop { n: f64, n_per_m: f64, gap_m: f64, over_m: f64 },
    /// F = -kc max(0, d - z), z grows so that F never exceeds the yield force: a stop that dents.
    DentingStop { n_per_m: f64, gap_m: f64, yield_n: f64 },
    /// A stop with a mass, on a spring that gives under it and lets it swing on.
    LeafStop { n_per_m: f64, gap_m: f64, kg: f64, hz: f64, damping_ratio: f64 },
    /// F = -Fc sgn(w) with true stick at w = 0 (Coulomb).
    Coulomb { n: f64 },
    /// The same with another Fc on the way back: a guide that leans.
    CoulombByWay { forth_n: f64, back_n: f64 },
    /// F = -Fc tanh(w/ws) (anchors F30, smooth).
    TanhFriction { n: f64, w_m_per_s: f64 },
    /// F = -s0 z, z' = w - s0 |w| z / g(w), g = Fc + (Fs - Fc) exp(-(w/ws)^2): LuGre without its viscous terms; Dahl
    /// where Fs = Fc.
    Bristle { coulomb_n: f64, static_n: f64, stribeck_m_per_s: f64, n_per_m: f64 },
    /// Five sliders on springs that let go one after the other, from a quarter to four times `slip_m`: Maxwell slip.
    MaxwellSlip { n: f64, slip_m: f64 },
    /// Dahl's bristle, pressed on by the stroke: F = -Fc (1 + c |q|) z, z' = (w - |w| z)/slip.
    Wedge { n: f64, slip_m: f64, per_m: f64 },
    /// Dahl's bristle on a part of the stroke only: F = -Fc z / (1 + ((q - at)/width)^4), z' = (w - |w| z)/slip.
    RubbedSpot { n: f64, slip_m: f64, at_m: f64, width_m: f64 },
    /// One slider on a spring (Jenkins): sticks as a spring, then slips at Fc.
    Jenkins { n: f64, slip_m: f64 },
    /// Rate and state (Dieterich): F = -Fc z (1 + c ln(1 + T/t0)), T' = 1 - |w| T/slip, z as in Dahl's: contacts that
    /// grow stronger at rest.
    Ageing { n: f64, slip_m: f64, per_e: f64, from_s: f64 },
    /// F = -c |w|^m sgn w (anchors F5, as a force).
    PowerDamping { n: f64, exponent: f64, w_m_per_s: f64 },
    /// F = a sin(2 pi f t + phase), with a second harmonic and a beat (anchors F26).
    Periodic { n: f64, hz: f64, second: f64, beat_hz: f64 },
    /// F = a tanh(s sin(2 pi f t + phase)) / tanh s: an almost square wave, as of a piston.
    Square { n: f64, hz: f64, sharpness: f64 },
    /// One push per turn, half a sine of the given share of it; no mean.
    Knock { n: f64, hz: f64, duty: f64 },
    /// A saw tooth without mean: a slow stroke and a quick one back.
    Saw { n: f64, hz: f64, quick: f64 },
    /// F = a (sin(2 pi f t + phase) + r sin(pi f t + phase 2)): a loose belt or bearing, with half the order beside it.
    HalfOrder { n: f64, hz: f64, half: f64 },
    /// F = a sin(2 pi f t + b sin(2 pi t/P + phase 2) + phase): a motor whose speed is not held.
    Wandering { n: f64, hz: f64, swing_rad: f64, swing_s: f64 },
    /// A mass m2 on a spring and damper: the mode that reacts on the structure.
    Absorber { kg: f64, hz: f64, damping_ratio: f64 },
    /// F = -a k cos(2 pi f t) q: parametric resonance.
    Pumped { n_per_m: f64, hz: f64 },
    /// The actuator and its share (1 - s) of the spring push through a contact that carries tension up to the preload
    /// only: F = max(0, -P - A), A = F_actuator - (1 - s) k q (foreign).
    PreloadGap { preload_n: f64, n_per_m: f64 },
    /// F = -dk (t/tau / (1 + t/tau)) q: stiffness that moves with a warming bench.
    WarmingSpring { n_per_m: f64, tau_s: f64 },
}

impl Force {
    /// Memory at the start; `phase_rad` is random per log.
    pub(crate) fn begin(&self, phase_rad: f64) -> Memory {
        let mut memory = [0.0; 32];
        match self {
            Force::Periodic { .. }
            | Force::Pumped { .. }
            | Force::Square { .. }
            | Force::Knock { .. }
            | Force::Saw { .. }
            | Force::HalfOrder { .. }
            | Force::Wandering { .. } => memory[0] = phase_rad,
            Force::Engaging { at_m, over_m, .. } => memory[0] = softplus(-at_m, *over_m),
            _ => {}
        }
        memory
    }

    /// Whether the force depends on the velocity, so that a step needs its corrector.
    pub(crate) fn feels_velocity(&self) -> bool {
        matches!(
            self,
            Force::HuntCrossley { .. }
                | Force::TwoStops { .. }
                | Force::RubbingStop { .. }
                | Force::PowerDamping { .. }
                | Force::Absorber { .. }
        )
    }

    /// Dry friction is solved with the step, not before it; see `Bench`.
    pub(crate) fn is_dry(&self) -> bool {
        matches!(self, Force::Coulomb { .. } | Force::CoulombByWay { .. } | Force::TanhFriction { .. })
    }

    /// Force at position `q`, velocity `w`, time `t_s` since the first row; `actuator_n` is alpha (V - sum v_i).
    #[inline]
    pub(crate) fn newtons(&self, m: &Memory, q: f64, w: f64, t_s: f64, actuator_n: f64) -> f64 {
        match self {
            Force::Cubic { n_per_m3 } => -n_per_m3 * q * q * q,
            Force::Quintic { n_per_m5 } => -n_per_m5 * q * q * q * q * q,
            Force::Levelling { n_per_m, at_m } => n_per_m * q * (q * q / (at_m * at_m + q * q)),
            Force::OddSquare { n_per_m2 } => -n_per_m2 * q * q.abs(),
            Force::Sinh { n_per_m, over_m } => -n_per_m * (over_m * (q / over_m).sinh() - q),
            Force::Quartic { n_per_m4 } => -n_per_m4 * q * q * q * q,
            Force::Exponential { n_per_m, over_m } => -n_per_m * (over_m * (q / over_m).exp_m1() - q),
            Force::Hertz { n_per_m, at_m } => -n_per_m * q * (q.abs() / at_m).sqrt(),
            Force::Detent { n_per_m, period_m } => -n_per_m * period_m / TAU * (TAU * q / period_m).sin(),
            Force::Magnet { n_per_m, away_m } => {
                // Nearer than a tenth of its distance no form comes.
                let near = (q / away_m).min(0.9);
                n_per_m * 0.5 * away_m * ((1.0 - near).powi(-2) - 1.0 - 2.0 * near)
            }
            Force::Cone { n_per_m, pressed_m } => {
                let share = q / pressed_m;
                -n_per_m * pressed_m / 1.5 * ((1.0 + share).max(0.0).powf(1.5) - 1.0 - 1.5 * share)
            }
            Force::Quadratic { n_per_m2 } => -n_per_m2 * q * q,
            Force::Bilinear { n_per_m } => -n_per_m * q.max(0.0),
            Force::Engaging { n_per_m, at_m, over_m } => -n_per_m * (softplus(q - at_m, *over_m) - m[0]),
            Force::Stop { n_per_m, gap_m } => -n_per_m * (q - gap_m).max(0.0),
            Force::HuntCrossley { n_per_m15, gap_m, s_per_m } => {
                let depth = (q - gap_m).max(0.0);
                -n_per_m15 * depth * depth.sqrt() * (1.0 + s_per_m * w).max(0.0)
            }
            Force::TwoStops { n_per_m, gap_m, n_s_per_m } => {
                let depth = q.abs() - gap_m;
                if depth <= 0.0 {
                    return 0.0;
                }
                let outward = w * q.signum();
                -q.signum() * (n_per_m * depth + n_s_per_m * outward).max(0.0)
            }
            Force::Bumper { side, n_per_m, gap_m, thick_m, soft_share } => {
                let depth = (side * q - gap_m).max(0.0);
                let beyond = (depth - thick_m).max(0.0);
                -side * n_per_m * (soft_share * depth + (1.0 - soft_share) * beyond)
            }
            Force::StickyStop { n_per_m, gap_m, .. } => {
                if m[0] > 0.0 || q > *gap_m {
                    -n_per_m * (q - gap_m)
                } else {
                    0.0
                }
            }
            Force::PadStop { n_per_m, gap_m, share, .. } => -n_per_m * (q - gap_m - share * m[0]).max(0.0),
            Force::RoughStop { side, n_per_m, gap_m, over_m } => -side * n_per_m * softplus(side * q - gap_m, *over_m),
            Force::RubbingStop { n_per_m, gap_m, friction } => {
                -n_per_m * (q - gap_m).max(0.0) * (1.0 + friction * (w / RUBBING_M_PER_S).tanh())
            }
            Force::PreloadedStop { n, n_per_m, gap_m, over_m } => {
                let depth = (q - gap_m).max(0.0);
                n * (-depth / over_m).exp_m1() - n_per_m * depth
            }
            Force::DentingStop { n_per_m, gap_m, yield_n } => -(n_per_m * (q - gap_m - m[0]).max(0.0)).min(*yield_n),
            Force::LeafStop { n_per_m, gap_m, .. } => -n_per_m * (q - gap_m - m[0]).max(0.0),
            Force::Bristle { n_per_m, .. } => -n_per_m * m[0],
            Force::MaxwellSlip { n, slip_m } => {
                let share = |(i, at): (usize, &f64)| at / (slip_m * SLIPS[i]);
                -n * m[0..SLIPS.len()].iter().enumerate().map(share).sum::<f64>() / SLIPS.len() as f64
            }
            Force::Wedge { n, per_m, .. } => -n * (1.0 + per_m * q.abs()) * m[0],
            Force::RubbedSpot { n, at_m, width_m, .. } => {
                let away = (q - at_m) / width_m;
                -n * m[0] / (1.0 + away.powi(4))
            }
            Force::Jenkins { n, slip_m } => -n * m[0] / slip_m,
            Force::Ageing { n, per_e, from_s, .. } => -n * m[0] * (1.0 + per_e * (m[1] / from_s).ln_1p()),
            Force::PowerDamping { n, exponent, w_m_per_s } => -n * w.signum() * (w.abs() / w_m_per_s).powf(*exponent),
            Force::Periodic { n, hz, second, beat_hz, .. } => {
                let angle = TAU * hz * t_s + m[0];
                let envelope = if *beat_hz > 0.0 { 1.0 + 0.4 * (TAU * beat_hz * t_s + 2.0 * m[0]).sin() } else { 1.0 };
                n * envelope * (angle.sin() + second * (2.0 * angle).sin())
            }
            Force::Square { n, hz, sharpness } => {
                n * (sharpness * (TAU * hz * t_s + m[0]).sin()).tanh() / sharpness.tanh()
            }
            Force::Knock { n, hz, duty } => {
                let turn = (hz * t_s + m[0] / TAU).rem_euclid(1.0);
                let push = if turn < *duty { (0.5 * TAU * turn / duty).sin() } else { 0.0 };
                n * (push - 4.0 * duty / TAU)
            }
            Force::Saw { n, hz, quick } => {
                let turn = (hz * t_s + m[0] / TAU).rem_euclid(1.0);
                let slow = 1.0 - quick;
                n * if turn < slow { 2.0 * turn / slow - 1.0 } else { 1.0 - 2.0 * (turn - slow) / quick }
            }
            Force::HalfOrder { n, hz, half } => {
                let angle = TAU * hz * t_s + m[0];
                n * (angle.sin() + half * (0.5 * angle + 2.0 * m[0]).sin())
            }
            Force::Wandering { n, hz, swing_rad, swing_s } => {
                let swing = swing_rad * (TAU * t_s / swing_s + 3.0 * m[0]).sin();
                n * (TAU * hz * t_s + swing + m[0]).sin()
            }
            Force::Absorber { kg, hz, damping_ratio } => {
                let w2 = TAU * hz;
                kg * w2 * (w2 * (m[0] - q) + 2.0 * damping_ratio * (m[1] - w))
            }
            Force::Pumped { n_per_m, hz, .. } => -n_per_m * (TAU * hz * t_s + m[0]).cos() * q,
            Force::PreloadGap { preload_n, n_per_m } => (n_per_m * q - actuator_n - preload_n).max(0.0),
            Force::WarmingSpring { n_per_m, tau_s } => {
                let warm = t_s.max(0.0) / tau_s;
                -n_per_m * q * warm / (1.0 + warm)
            }
            Force::Coulomb { .. } | Force::CoulombByWay { .. } | Force::TanhFriction { .. } => 0.0,
        }
    }

    /// Carries internal states through a step of length `h_s` at constant velocity `w`, ending at `q`.
    #[inline]
    pub(crate) fn advance(&self, m: &mut Memory, q: f64, w: f64, h_s: f64) {
        match self {
            Force::Bristle { coulomb_n, static_n, stribeck_m_per_s, n_per_m } => {
                let ratio = w / stribeck_m_per_s;
                let extra_n = static_n - coulomb_n;
                let limit = coulomb_n + if extra_n > 0.0 { extra_n * (-ratio * ratio).exp() } else { 0.0 };
                // z' = w - s0 |w| z / g is linear in z at constant w: exact.
                let goal = w.signum() * limit / n_per_m;
                m[0] = goal + (m[0] - goal) * (-n_per_m * w.abs() * h_s / limit).exp();
            }
            Force::StickyStop { gap_m, neck_m, .. } => {
                if q > *gap_m {
                    m[0] = 1.0;
                } else if q < gap_m - neck_m {
                    m[0] = 0.0;
                }
            }
            Force::PadStop { gap_m, share, tau_s, .. } => {
                // Left alone, the pad's face recovers by itself.
                let face_m = (q - gap_m).max(share * m[0]);
                m[0] += (face_m - m[0]) * (h_s / tau_s);
            }
            Force::MaxwellSlip { slip_m, .. } => {
                for (at, reach) in m.iter_mut().zip(SLIPS) {
                    *at = (*at + w * h_s).clamp(-slip_m * reach, slip_m * reach);
                }
            }
            Force::Wedge { slip_m, .. } => {
                let goal = w.signum();
                m[0] = goal + (m[0] - goal) * (-w.abs() * h_s / slip_m).exp();
            }
            Force::DentingStop { n_per_m, gap_m, yield_n } => m[0] = m[0].max(q - gap_m - yield_n / n_per_m),
            Force::LeafStop { n_per_m, gap_m, kg, hz, damping_ratio } => {
                // Leapfrog as the mass itself: both were kicked where they were at the start of the step.
                let w2 = TAU * hz;
                let push = n_per_m * (q - w * h_s - gap_m - m[0]).max(0.0) / kg - w2 * w2 * m[0];
                let drag = damping_ratio * w2 * h_s;
                m[1] = ((1.0 - drag) * m[1] + h_s * push) / (1.0 + drag);
                m[0] += h_s * m[1];
            }
            Force::RubbedSpot { slip_m, .. } => {
                let goal = w.signum();
                m[0] = goal + (m[0] - goal) * (-w.abs() * h_s / slip_m).exp();
            }
            Force::Jenkins { slip_m, .. } => m[0] = (m[0] + w * h_s).clamp(-slip_m, *slip_m),
            Force::Ageing { slip_m, .. } => {
                let goal = w.signum();
                let share = w.abs() * h_s / slip_m;
                m[0] = goal + (m[0] - goal) * (-share).exp();
                // T' = 1 - |w| T/slip, with T halfway through the step.
                m[1] = (m[1] * (1.0 - 0.5 * share) + h_s) / (1.0 + 0.5 * share);
            }
            Force::Absorber { hz, damping_ratio, .. } => {
                let w2 = TAU * hz;
                // Implicit midpoint; the base moves by w h within the step.
                let base_mid = q - 0.5 * w * h_s;
                let half = 0.5 * h_s;
                let mid = (m[1] + half * (w2 * w2 * (base_mid - m[0]) + 2.0 * damping_ratio * w2 * w))
                    / (1.0 + h_s * damping_ratio * w2 + half * half * w2 * w2);
                (m[0], m[1]) = (m[0] + h_s * mid, 2.0 * mid - m[1]);
            }
            _ => {}
        }
    }

    /// Energy stored in the part, in joules, for the power balance of the parts that dissipate.
    #[cfg(test)]
    pub(crate) fn energy_j(&self, m: &Memory, q: f64) -> f64 {
        match self {
            Force::Bristle { n_per_m, .. } => 0.5 * n_per_m * m[0] * m[0],
            Force::HuntCrossley { n_per_m15, gap_m, .. } => 0.4 * n_per_m15 * (q - gap_m).max(0.0).powf(2.5),
            Force::TwoStops { n_per_m, gap_m, .. } => 0.5 * n_per_m * (q.abs() - gap_m).max(0.0).powi(2),
            Force::Bumper { side, n_per_m, gap_m, thick_m, soft_share } => {
                let depth = (side * q - gap_m).max(0.0);
                let beyond = (depth - thick_m).max(0.0);
                0.5 * n_per_m * (soft_share * depth * depth + (1.0 - soft_share) * beyond * beyond)
            }
            Force::StickyStop { n_per_m, gap_m, .. } if m[0] > 0.0 || q > *gap_m => 0.5 * n_per_m * (q - gap_m).powi(2),
            Force::PadStop { n_per_m, gap_m, share, .. } => {
                let face = (q - gap_m).max(share * m[0]);
                0.5 * n_per_m * ((1.0 - share) * face * face + share * (face - m[0]).powi(2))
            }
            Force::MaxwellSlip { n, slip_m } => {
                let each = |(at, reach): (&f64, f64)| at * at / (slip_m * reach);
                0.5 * n * m.iter().zip(SLIPS).map(each).sum::<f64>() / SLIPS.len() as f64
            }
            Force::PreloadedStop { n, n_per_m, gap_m, over_m } => {
                let depth = (q - gap_m).max(0.0);
                n * (depth + over_m * (-depth / over_m).exp_m1()) + 0.5 * n_per_m * depth * depth
            }
            Force::RubbingStop { n_per_m, gap_m, .. } => 0.5 * n_per_m * (q - gap_m).max(0.0).powi(2),
            Force::DentingStop { n_per_m, gap_m, .. } => 0.5 * n_per_m * (q - gap_m - m[0]).max(0.0).powi(2),
            Force::LeafStop { n_per_m, gap_m, kg, hz, .. } => {
                let pressed = (q - gap_m - m[0]).max(0.0);
                0.5 * (n_per_m * pressed * pressed + kg * (m[1] * m[1] + (TAU * hz * m[0]).powi(2)))
            }
            Force::Jenkins { n, slip_m } => 0.5 * n * m[0] * m[0] / slip_m,
            Force::Absorber { kg, hz, .. } => {
                let stretch = TAU * hz * (m[0] - q);
                0.5 * kg * (m[1] * m[1] + stretch * stretch)
            }
            _ => 0.0,
        }
    }

    /// Velocity after dry friction, given that before the step and the one that the step would reach without friction.
    ///
    /// Coulomb is exact for a force that is constant over the step: the mass slows down, stops within the step if it
    /// must, and then stays or slides back. tanh is trapezoidal, which cannot ring as long as n h/M < 2 ws; the forms
    /// stay below that. `h_over_m` is step over mass.
    #[inline]
    pub(crate) fn rub(&self, before: f64, free: f64, h_over_m: f64) -> f64 {
        match self {
            Force::Coulomb { n } => rub_dry(before, free, n * h_over_m, n * h_over_m),
            Force::CoulombByWay { forth_n, back_n } => rub_dry(before, free, forth_n * h_over_m, back_n * h_over_m),
            Force::TanhFriction { n, w_m_per_s } => {
                let half = 0.5 * n * h_over_m;
                let goal = free - half * (before / w_m_per_s).tanh();
                // x + c tanh(x/ws) = goal has one root, within c of it; Newton with bisection as its guard.
                let (mut low, mut high) = (goal - half, goal + half);
                let mut x = goal / (1.0 + half / w_m_per_s);
                for _ in 0..30 {
                    let t = (x / w_m_per_s).tanh();
                    let miss = x + half * t - goal;
                    if miss.abs() < 1e-15 {
                        break;
                    }
                    if miss > 0.0 {
                        high = x;
                    } else {
                        low = x;
                    }
                    let next = x - miss / (1.0 + half * (1.0 - t * t) / w_m_per_s);
                    x = if next > low && next < high { next } else { 0.5 * (low + high) };
                }
                x
            }
            _ => free,
        }
    }
}

/// Speed beyond which `RubbingStop` rubs in full.
const RUBBING_M_PER_S: f64 = 1e-2;

/// Break-away distances of the Maxwell slip elements, relative to the middle one.
const SLIPS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// Velocity after Coulomb friction that takes these impulses per step from a motion forth or back.
#[inline]
fn rub_dry(before: f64, free: f64, forth: f64, back: f64) -> f64 {
    let against = |way: f64| if way > 0.0 { forth } else { back };
    let push = free - before;
    let way = if before == 0.0 { push.signum() } else { before.signum() };
    let sliding = free - against(way) * way;
    if before != 0.0 && sliding * way > 0.0 {
        return sliding;
    }
    let impulse = against(push.signum());
    if push.abs() <= impulse {
        return 0.0;
    }
    // It stops after this share of the step, and the rest of the push takes it along.
    let stopped_at = if before == 0.0 { 0.0 } else { before / (before - sliding) };
    (push - impulse * push.signum()) * (1.0 - stopped_at)
}

/// max(0, x) with its corner rounded over `over`.
pub(crate) fn softplus(x: f64, over: f64) -> f64 {
    over * (x / over).exp().ln_1p()
}
