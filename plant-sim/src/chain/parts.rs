//! Parts of actuator and structure that the nominal plant leaves out: forces on the moving mass, attached modes, and hysterons that
//! deviate from the straight admittance with a dead zone.
//!
//! Creep and further hysterons need no part of their own: they are hysterons of the plant, without a dead zone or with one. A payload
//! is mass. Plants of other kinds ([`crate::model::Kind`]) are parts in place of hysterons or of the whole structure.

use super::DriveHysteresis;
use crate::bouc_wen::BoucWen;
use crate::linear::StateSpace;

/// Everything beyond the nominal plant, or in place of parts of it; empty for a nominal chain of hysterons.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// Forces against the motion of the mass.
    pub forces: Vec<Force>,
    /// What shakes the mass from outside.
    pub shakes: Vec<Shake>,
    /// Oscillators.
    pub modes: Vec<Mode>,
    /// Deviations of hysterons.
    pub bends: Vec<Bend>,
    /// Creep seen beside the structure: the reading is q + sum of share times q through a low-pass of this time constant.
    pub creep: Vec<Relaxation>,
    /// Arms between structure and target: the reading is q + share (s - q), s a resonant follower of q.
    pub arms: Vec<Arm>,
    /// Hysteresis of the transducer, driven by the voltage.
    pub transducer: Option<DriveHysteresis>,
    /// The structure follows its force at once, q = F/k: neither mass nor damper act.
    pub is_massless: bool,
    /// A linear plant in place of actuator and structure, from volts at the actuator to metres at the sensor.
    pub linear: Option<StateSpace>,
    /// Whether laws that are not affine may be followed to tens of nanometres at corners instead of to one: several times faster, for
    /// searches that simulate a thousand times.
    pub is_coarse: bool,
}

impl Parts {
    /// Friction that the structure can hold at rest, in newton.
    pub fn holdable_n(&self) -> f64 {
        let held = |force: &Force| match force {
            Force::Presliding { coulomb_n, .. } | Force::Slider { coulomb_n, .. } | Force::Patch { coulomb_n, .. } => {
                *coulomb_n
            }
            _ => 0.0,
        };
        self.forces.iter().map(held).sum()
    }

    /// Whether a force or a bend is present, which only sub-steps can follow.
    pub fn need_substeps(&self) -> bool {
        !self.forces.is_empty() || !self.bends.is_empty()
    }
}

/// An external force cos_n cos(w t) + sin_n sin(w t) on the mass, t from the log's start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shake {
    /// Frequency in Hz.
    pub hz: f64,
    /// Cosine amplitude in N.
    pub cos_n: f64,
    /// Sine amplitude in N.
    pub sin_n: f64,
}

/// A flexible arm that carries the sensor's target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Share of the reading that the arm carries.
    pub share: f64,
    /// Share of the arm's speed over its natural frequency that is read besides.
    pub rate_share: f64,
    /// Natural frequency in Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// One element of a relaxation spectrum: it adds share (r + by_side |r| + growth r |r|), r its relaxed displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Share of the displacement that it adds in the end.
    pub share: f64,
    /// Time constant in seconds.
    pub time_constant_s: f64,
    /// How much more it adds on the positive side than on the negative, -1 to 1.
    pub by_side: f64,
    /// By how much the share grows with the stroke, 1/m.
    pub growth_per_m: f64,
    /// Time constant on the way back to zero over that on the way out.
    pub slower_back: f64,
}

impl Relaxation {
    /// An element that follows its displacement alike everywhere.
    pub fn even(share: f64, time_constant_s: f64) -> Self {
        Self { share, time_constant_s, by_side: 0.0, growth_per_m: 0.0, slower_back: 1.0 }
    }
}

/// A force on the moving mass, positive against positive displacement or velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Force {
    /// k2 q^2 + k3 q^3: an elastic force, energy k2 q^3/3 + k3 q^4/4.
    Spring {
        /// k2 in N/m^2.
        quadratic_n_per_m2: f64,
        /// k3 in N/m^3.
        cubic_n_per_m3: f64,
    },
    /// k4 q^4: an elastic force, energy k4 q^5/5.
    Fourth {
        /// k4 in N/m^4.
        fourth_n_per_m4: f64,
    },
    /// k5 q^5: an elastic force, energy k5 q^6/6.
    Fifth {
        /// k5 in N/m^5.
        fifth_n_per_m5: f64,
    },
    /// A spring of its own for positive displacement, energy k q^2/2 there.
    OneSided {
        /// Additional stiffness in N/m.
        stiffness_n_per_m: f64,
    },
    /// A further spring that engages around `at_m` over a width w: k (x + (x^2 + w^2)^(1/2)) / 2 of x = q - `at_m`, less its value at q = 0.
    Gradual {
        /// Additional stiffness in N/m.
        stiffness_n_per_m: f64,
        /// Where half of it acts, in metres.
        at_m: f64,
        /// w in metres, > 0.
        width_m: f64,
    },
    /// Coulomb friction with presliding (Dahl 1968): z' = v (1 - z sign(v)), F = Fc z(q / presliding).
    Presliding {
        /// Fc in N.
        coulomb_n: f64,
        /// Displacement over which the force builds up, in metres.
        presliding_m: f64,
    },
    /// Coulomb friction of a slider on a spring (an element of Jenkin or Prandtl): z' = v / slip as long as |z| < 1, F = Fc z.
    Slider {
        /// Fc in N.
        coulomb_n: f64,
        /// Stretch of the spring at which the slider gives way, in metres.
        slip_m: f64,
    },
    /// The same slider where only a part of the stroke rubs: within `half_width_m` around `at_m`, its edges a tenth of that and the slip
    /// wide. Off the part
    /// it keeps its stretch.
    Patch {
        /// Fc in N.
        coulomb_n: f64,
        /// Stretch of the spring at which the slider gives way, in metres.
        slip_m: f64,
        /// Middle of the part, in metres.
        at_m: f64,
        /// Half of its width, in metres.
        half_width_m: f64,
    },
    /// Force that repeats with the displacement, as a magnet's poles make it: a sin x + b (1 - cos x), x = 2 pi q / period; energy
    /// period / (2 pi) (a (1 - cos x) + b (x - sin x)).
    Detent {
        /// Period in metres.
        period_m: f64,
        /// a in N.
        sin_n: f64,
        /// b in N.
        cos_n: f64,
    },
    /// Hysteresis of the structure: a Bouc-Wen law in newton, driven by the displacement in metres.
    BoucWen(BoucWen),
    /// Coulomb friction Fc tanh(v / speed).
    Smooth {
        /// Fc in N.
        coulomb_n: f64,
        /// Speed of transition in m/s.
        speed_m_per_s: f64,
    },
    /// Damping F = Fr |v / vr|^m sign(v); straight below 1e-9 of vr.
    Power {
        /// Fr, force at the reference speed, in N.
        force_n: f64,
        /// vr in m/s.
        reference_m_per_s: f64,
        /// m.
        exponent: f64,
    },
    /// Contact with a soft or a round body (Hertz 1882 for p = 3/2): k d (x/d)^p of the depth x beyond `at_m`, an elastic force, energy
    /// k d^2 (x/d)^(p+1) / (p+1), with d a tenth of the way to it.
    Pad {
        /// Where contact begins, in metres; its sign says on which side.
        at_m: f64,
        /// k in N/m, of a straight spring with the same force at the depth d.
        stiffness_n_per_m: f64,
        /// p, > 0.
        exponent: f64,
    },
    /// Contact beyond `at_m` (towards positive displacement if it is positive): k x (1 + a x') of the depth x, never pulling (Hunt and Crossley
    /// 1975); energy k x^2/2.
    Stop {
        /// Where contact begins, in metres; its sign says on which side.
        at_m: f64,
        /// Contact stiffness in N/m.
        stiffness_n_per_m: f64,
        /// a in s/m, >= 0: what of an impact is lost.
        damping_s_per_m: f64,
    },
}

/// Depth at which a pad's force is that of a straight spring, as a share of the way to it.
const PAD_DEPTH: f64 = 0.1;

/// That depth of a pad at `at_m` in metres, and how many times as deep a mass at `q` is in it.
pub(super) fn in_pad(at_m: f64, q: f64) -> (f64, f64) {
    let unit_m = (PAD_DEPTH * at_m.abs()).max(1e-12);
    (unit_m, ((q - at_m) * at_m.signum()).max(0.0) / unit_m)
}

/// Force of a stop on a mass at `q` that moves at `w`.
pub(super) fn against_stop_n([at_m, stiffness_n_per_m, damping_s_per_m]: [f64; 3], q: f64, w: f64) -> f64 {
    let side = at_m.signum();
    let depth_m = ((q - at_m) * side).max(0.0);
    side * stiffness_n_per_m * depth_m * (1.0 + damping_s_per_m * w * side).max(0.0)
}

/// An oscillator besides the plant's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// How it is joined to the plant.
    pub joint: Joint,
    /// Natural frequency in Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// How an oscillator is joined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Joint {
    /// A mass on a spring and a damper, fixed to the moving mass: passive.
    Attached {
        /// Its mass in kg.
        mass_kg: f64,
    },
    /// A residual mode that the drive excites and the sensor sees, of this static displacement per newton of drive force.
    Parallel {
        /// Static compliance in m/N; negative in counterphase.
        compliance_m_per_n: f64,
    },
}

/// A deviation of one hysteron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// Which hysteron, from 0; `None` for every one.
    pub hysteron: Option<usize>,
    /// How it deviates.
    pub law: BendLaw,
}

/// How a hysteron deviates from C v' = alpha q' - h(v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BendLaw {
    /// 1/C grows by this share s while v is at its upper edge or beyond, shrinks at the lower, in proportion between:
    /// v' = (1 + s v/(d/2)) / C (alpha q' - h(v)).
    CapacitanceSkew(f64),
    /// The leak is larger by this share for positive v and smaller for negative.
    SlopeSkew(f64),
    /// Leak beta d/2 (x / (d/2))^p of the excess x; straight below 3e-5 of d/2. Of several p, each is a factor (x / (d/2))^(p - 1).
    Exponent(f64),
    /// The dead zone is wider by this share where the mass moves as fast as a drive of `reference_v_per_s` takes it along, |q'| k / alpha, in
    /// proportion to the speed.
    Widening {
        /// Share.
        share: f64,
        /// Reference in V/s.
        reference_v_per_s: f64,
    },
    /// The leak is larger by this share at a speed of `reference_m_per_s`, in proportion to the speed: motion eases it.
    Easing {
        /// Share.
        share: f64,
        /// Reference in m/s.
        reference_m_per_s: f64,
    },
}

/// Width of the edges of a part that rubs, beyond the slip, in half widths.
const EDGE: f64 = 0.1;

/// How much of a patch of friction is felt at `q`: all within, none beyond its edges.
pub(super) fn on_patch(q: f64, slip_m: f64, at_m: f64, half_width_m: f64) -> f64 {
    let edge_m = slip_m + EDGE * half_width_m;
    (0.5 + (half_width_m - (q - at_m).abs()) / edge_m.max(1e-9)).clamp(0.0, 1.0)
}

/// A detent's force and energy at `q`.
pub(super) fn detent(q: f64, period_m: f64, sin_n: f64, cos_n: f64) -> [f64; 2] {
    let x = std::f64::consts::TAU * q / period_m;
    let (sin, cos) = x.sin_cos();
    let per_m = period_m / std::f64::consts::TAU;
    [sin_n * sin + cos_n * (1.0 - cos), per_m * (sin_n * (1.0 - cos) + cos_n * (x - sin))]
}
