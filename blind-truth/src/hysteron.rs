//! A hysteron: a capacitor with a leak that conducts outside a dead zone only (thesis 2.4 to 2.6).
//!
//! v' = r - h(v)/C with v = Q/C and r = (alpha/C) q'. For constant r every branch is linear, so a step is exact,
//! however fast the leak is (C/beta is 0.94 us for the fast one). Leaks that are not linear take an explicit step and
//! are for slow hysterons only.

/// One polarity of a hysteron: the two differ where the hysteresis is asymmetric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Side {
    /// Capacitance in farads.
    pub capacitance_f: f64,
    /// Slope of the leak's admittance in siemens (beta).
    pub slope_s: f64,
    /// Half of the dead zone in volts (d/2).
    pub half_v: f64,
}

/// How the leak departs from thesis (2.6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Leak {
    /// beta (v - d/2): the thesis.
    Linear,
    /// beta e0 (e/e0)^m with e = v - d/2: rate dependence of the loop width.
    Power { exponent: f64, reference_v: f64 },
    /// beta e0 sinh(e/e0): a leak over thermally activated barriers.
    Sinh { reference_v: f64 },
    /// beta e, and `more` times that of what e is beyond `at_v`: a second leak that joins in.
    Kink { at_v: f64, more: f64 },
    /// d/2 grows by `v_s_per_m` |q'|: rate-dependent threshold (anchors F5).
    Threshold { v_s_per_m: f64 },
    /// beta grows by `s_per_m` |q'|: walls that conduct better while they move.
    Eased { s_per_m: f64 },
}

impl Leak {
    /// Rate in V/s at which a voltage `over_v` beyond the dead zone falls, for the laws that take an explicit step.
    #[inline]
    fn curved(self, over_v: f64, lambda: f64) -> f64 {
        match self {
            Leak::Power { exponent, reference_v } => lambda * reference_v * (over_v / reference_v).powf(exponent),
            Leak::Kink { at_v, more } => lambda * (over_v + more * (over_v - at_v).max(0.0)),
            Leak::Linear | Leak::Threshold { .. } | Leak::Eased { .. } | Leak::Sinh { .. } => lambda * over_v,
        }
    }
}

/// A hysteron with its two sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hysteron {
    /// For positive voltage.
    pub up: Side,
    /// For negative voltage.
    pub down: Side,
    /// The leak's law.
    pub leak: Leak,
}

impl Hysteron {
    /// Both sides alike, dead zone of width `dead_zone_v` in all.
    pub(crate) fn symmetric(capacitance_f: f64, slope_s: f64, dead_zone_v: f64) -> Self {
        let side = Side { capacitance_f, slope_s, half_v: 0.5 * dead_zone_v };
        Self { up: side, down: side, leak: Leak::Linear }
    }

    /// Energy stored at voltage `v`, in joules: C v^2 / 2.
    #[cfg(test)]
    pub(crate) fn energy_j(&self, v: f64) -> f64 {
        let side = if v >= 0.0 { &self.up } else { &self.down };
        0.5 * side.capacitance_f * v * v
    }

    /// Ready to run with transduction `alpha` (C/m).
    pub(crate) fn prepare(&self, alpha: f64) -> Prepared {
        let side = |side: &Side| {
            let lambda = side.slope_s / side.capacitance_f;
            let tau_s = side.capacitance_f / side.slope_s;
            PreparedSide { v_per_m: alpha / side.capacitance_f, half_v: side.half_v, lambda, tau_s }
        };
        Prepared { up: side(&self.up), down: side(&self.down), leak: self.leak }
    }
}

/// A hysteron with its quotients worked out: divisions would cost a third of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prepared {
    up: PreparedSide,
    down: PreparedSide,
    leak: Leak,
}

#[derive(Clone, Copy, Debug)]
struct PreparedSide {
    v_per_m: f64,
    half_v: f64,
    lambda: f64,
    tau_s: f64,
}

impl Prepared {
    /// Voltage after `h_s` at constant velocity `w_m_per_s`.
    ///
    /// `widen` multiplies the dead zone (1 but for a self-heating ceramic).
    #[inline]
    pub(crate) fn step(&self, v: f64, w_m_per_s: f64, h_s: f64, widen: f64) -> f64 {
        let side = if v >= 0.0 { &self.up } else { &self.down };
        let rate = side.v_per_m * w_m_per_s;
        let half = match self.leak {
            Leak::Linear | Leak::Eased { .. } => side.half_v,
            Leak::Threshold { v_s_per_m } => side.half_v + v_s_per_m * w_m_per_s.abs(),
            Leak::Sinh { reference_v } => {
                // Half of the motion, the leak's own fall (exact, however steep), the other half.
                let middle = v + 0.5 * h_s * rate;
                let over_v = middle.abs() - side.half_v * widen;
                if over_v <= 0.0 {
                    return v + h_s * rate;
                }
                let share = (0.5 * over_v / reference_v).tanh() * (-side.lambda * h_s).exp();
                let left_v = 2.0 * reference_v * share.atanh();
                return middle - (over_v - left_v) * middle.signum() + 0.5 * h_s * rate;
            }
            Leak::Power { .. } | Leak::Kink { .. } => {
                let leak = |v: f64| {
                    let over_v = (v.abs() - side.half_v * widen).max(0.0);
                    if over_v > 0.0 { self.leak.curved(over_v, side.lambda) * v.signum() } else { 0.0 }
                };
                // The leak turns over in milliseconds, so that its own share of the midpoint is beyond need.
                return v + h_s * (rate - leak(v + 0.5 * h_s * rate));
            }
        } * widen;
        // By symmetry only v >= 0 need be written out.
        let sign = if v >= 0.0 { 1.0 } else { -1.0 };
        if let Leak::Eased { s_per_m } = self.leak {
            let more = 1.0 + s_per_m * w_m_per_s.abs();
            let eased = PreparedSide { lambda: more * side.lambda, tau_s: side.tau_s / more, ..*side };
            return sign * relax(sign * v, sign * rate, half, &eased, h_s);
        }
        sign * relax(sign * v, sign * rate, half, side, h_s)
    }
}

/// Exact step of v' = r - lambda max(0, v - half) from v >= 0. Running through zero into the far zone within one step
/// is left to the next step: 1 us moves v by 0.1 V at most, and the near zone is volts wide.
#[inline]
fn relax(v: f64, r: f64, half: f64, side: &PreparedSide, h: f64) -> f64 {
    if v <= half {
        let end = v + r * h;
        if end <= half {
            return end;
        }
        return half + outside(0.0, r, side, h - (half - v) / r);
    }
    let over = v - half;
    // Only what could come back inside within the step needs the logarithm.
    if r < 0.0 && over + r * h < side.lambda * over * h {
        let inside_at = (over * side.lambda / -r).ln_1p() * side.tau_s;
        if inside_at < h {
            return half + r * (h - inside_at);
        }
    }
    half + outside(over, r, side, h)
}

/// e' = r - lambda e for a time t.
#[inline]
fn outside(e: f64, r: f64, side: &PreparedSide, t: f64) -> f64 {
    let x = -side.lambda * t;
    // Where the leak is slow, a series of the exponential is exact to rounding and much cheaper.
    let shrink = if x > -1e-3 { x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0))) } else { x.exp_m1() };
    e + (e - r * side.tau_s) * shrink
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_is_exact_for_any_length() {
        // One long step through inside, edge and outside equals many short ones at constant velocity.
        let hysteron = Hysteron::symmetric(5.2e-7, 1.15e-4, 8.7).prepare(0.0463);
        for (v0, w) in [(0.0, 0.05), (4.0, 0.05), (6.0, -0.05), (6.0, 0.0), (-5.0, 0.03)] {
            let mut fine: f64 = v0;
            for _ in 0..1000 {
                fine = hysteron.step(fine, w, 1e-7, 1.0);
            }
            let coarse = hysteron.step(v0, w, 1e-4, 1.0);
            assert!((fine - coarse).abs() < 1e-9, "{v0} {w}: {fine} {coarse}");
        }
    }

    #[test]
    fn sinh_leak_falls_as_its_solution_says() {
        // tanh(e / 2 e0) decays with exp(-lambda t); for small e the leak is the linear one.
        let linear = Hysteron::symmetric(5.2e-7, 1.15e-4, 8.7);
        let sinh = |reference_v: f64| Hysteron { leak: Leak::Sinh { reference_v }, ..linear }.prepare(0.0463);
        let fall = |part: Prepared| (0..1000).fold(7.0, |v, _| part.step(v, 0.0, 1e-6, 1.0)) - 4.35;
        let expected = 2.0 * 0.5 * ((2.65_f64 / 1.0).tanh() * (-1e-3_f64 * 1.15e-4 / 5.2e-7).exp()).atanh();
        assert!((fall(sinh(0.5)) - expected).abs() < 1e-9, "{} {expected}", fall(sinh(0.5)));
        assert!((fall(sinh(1e3)) - fall(linear.prepare(0.0463))).abs() < 1e-5);
    }

    #[test]
    fn fast_leak_settles_on_the_edge() {
        let hysteron = Hysteron::symmetric(5.6e-7, 0.6, 14.5).prepare(0.0463);
        let v = hysteron.step(9.0, 0.0, 5e-5, 1.0);
        assert!((v - 7.25).abs() < 1e-12, "{v}");
        // At rest inside the dead zone nothing moves at all: no creep.
        assert_eq!(hysteron.step(7.25, 0.0, 1e-6, 1.0), 7.25);
    }
}
