//! A bent hysteron's leak over one sub-step: v' = c(v)/C (alpha q' - h(v, q')) along the foreseen path of the mass.

use super::lag::Moments;
use super::path::Path;
use super::relax::relax;
use super::{Bend, BendLaw};
use crate::phs::Phs;

/// Error of the voltage in one inner step: 0.6 pm of displacement.
const VOLTAGE_ERROR: f64 = 3e-7;
/// Shortest inner step: at 10 kV/s a corner costs 1 uV there.
const SHORTEST_S: f64 = 1e-10;
/// The same two for coarse laws: 0.4 nm.
const COARSE_INNER: [f64; 2] = [2e-4, 1e-7];
/// Two powers of the excess are one whose exponent is at least this.
pub(super) const LEAST_EXPONENT: f64 = 0.1;
/// Skews of several effects together are at most this either way: beyond one a capacitance is negative, or a leak gives energy.
const MOST_SKEW: f64 = 0.95;
/// Share of the edge below which a power of the excess is straight: 0.2 mV or 0.4 nm, well above the error of the inner steps.
const STRAIGHT: f64 = 3e-5;

/// What skews that add up to `sum` come to.
pub(super) fn skewed_by(sum: f64) -> f64 {
    sum.clamp(-MOST_SKEW, MOST_SKEW)
}

/// One hysteron with all its bends.
pub(super) struct Leak {
    /// Which hysteron.
    pub hysteron: usize,
    alpha: f64,
    per_metre: f64,
    edge_v: f64,
    rate_per_s: f64,
    capacitance_skew: f64,
    slope_skew: f64,
    exponent: f64,
    /// Volts by which the edge moves out per m/s.
    wider: f64,
    /// Share by which the leak grows per m/s.
    eased: f64,
    /// Volts that the last sub-step left out: the mass did not end quite where it was foreseen, and the engine charges without skew.
    owed_v: f64,
    skewed: f64,
    inner: [f64; 2],
}

impl Leak {
    /// The bent hysterons of a plant.
    pub(super) fn of(plant: &Phs, bends: &[Bend], is_coarse: bool) -> Vec<Self> {
        let alpha = plant.transduction_c_per_m;
        let mut leaks = Vec::new();
        for (i, hysteron) in plant.hysterons.iter().enumerate() {
            let own = |bend: &&Bend| bend.hysteron.is_none_or(|only| only == i);
            if hysteron.dead_zone_v <= 0.0 || !bends.iter().any(|bend| own(&bend)) {
                continue;
            }
            let mut leak = Self {
                hysteron: i,
                alpha,
                per_metre: alpha / hysteron.capacitance_f,
                edge_v: hysteron.edge_v(),
                rate_per_s: hysteron.slope_s / hysteron.capacitance_f,
                capacitance_skew: 0.0,
                slope_skew: 0.0,
                exponent: 1.0,
                wider: 0.0,
                eased: 0.0,
                owed_v: 0.0,
                skewed: 0.0,
                inner: if is_coarse { COARSE_INNER } else { [VOLTAGE_ERROR, SHORTEST_S] },
            };
            for bend in bends.iter().filter(own) {
                match bend.law {
                    BendLaw::CapacitanceSkew(skew) => leak.capacitance_skew += skew,
                    BendLaw::SlopeSkew(skew) => leak.slope_skew += skew,
                    BendLaw::Exponent(exponent) => leak.exponent = (leak.exponent + exponent - 1.0).max(LEAST_EXPONENT),
                    BendLaw::Easing { share, reference_m_per_s } => leak.eased += share / reference_m_per_s,
                    BendLaw::Widening { share, reference_v_per_s } => {
                        leak.wider += share * leak.edge_v * plant.stiffness_n_per_m / (alpha * reference_v_per_s);
                    }
                }
            }
            leak.capacitance_skew = skewed_by(leak.capacitance_skew);
            leak.slope_skew = skewed_by(leak.slope_skew);
            leaks.push(leak);
        }
        leaks
    }

    /// What to add to the rate of the voltage, constant over the sub-step, so that a plain capacitor ends where this hysteron does; and to
    /// `sum` the moments of the force by which the two differ on the way.
    pub(super) fn follow(&mut self, from_v: f64, path: &Path, step_s: f64, sum: &mut Moments) -> f64 {
        let now_v = from_v + self.owed_v;
        let (end_v, moments) = relax(now_v, step_s, self.inner, |v, t| self.slope(v, path.motion(t)), |_, _| None);
        self.skewed = self.capacitance_skew * (end_v / self.edge_v).clamp(-1.0, 1.0);
        let by_m = path.at(step_s) - path.0[0];
        let rate = (end_v - from_v - self.per_metre * by_m) / step_s;
        let plain = path.moments(step_s);
        let h = step_s;
        let differ = |moment: f64, plain: f64, flat: f64, ramp: f64| {
            self.alpha * (moment - from_v * flat - self.per_metre * plain - rate * ramp)
        };
        sum.zeroth += differ(moments.zeroth, plain.zeroth, h, h * h / 2.0);
        sum.first += differ(moments.first, plain.first, h * h / 2.0, h * h * h / 3.0);
        sum.second += differ(moments.second, plain.second, h * h * h / 3.0, h.powi(4) / 4.0);
        rate
    }

    /// The sub-step ended `by_m` further than foreseen.
    pub(super) fn moved_on(&mut self, by_m: f64) {
        self.owed_v = self.skewed * self.per_metre * by_m;
    }

    /// Largest voltage that motion at `w` sustains, from `v`, if the leak is fast.
    pub(super) fn reach_v(&self, v: f64, w: f64) -> f64 {
        let eased = 1.0 + self.eased * w.abs();
        let rate = self.rate_per_s * (1.0 + self.slope_skew * v.signum()) * eased;
        let slip = self.per_metre * w.abs() / rate.max(1e-9);
        let slip_v =
            if self.exponent == 1.0 { slip } else { self.edge_v * (slip / self.edge_v).powf(1.0 / self.exponent) };
        self.edge_v + self.wider * w.abs() + slip_v
    }

    /// What the widening does to the mass while the hysteron is open.
    pub(super) fn damping_n_s_per_m(&self) -> f64 {
        self.alpha * self.wider.abs()
    }

    /// v', and its derivatives by v and by time.
    fn slope(&self, v: f64, [w, acceleration]: [f64; 2]) -> [f64; 3] {
        let edge_v = self.edge_v + self.wider * w.abs();
        let excess_v = v.abs() - edge_v;
        let [mut leak, mut by_excess] = [0.0; 2];
        let eased = 1.0 + self.eased * w.abs();
        if excess_v > 0.0 {
            let rate = self.rate_per_s * (1.0 + self.slope_skew * v.signum()) * eased;
            if self.exponent == 1.0 {
                (leak, by_excess) = (rate * excess_v, rate);
            } else {
                let r = excess_v / self.edge_v;
                let square = r * r + STRAIGHT * STRAIGHT;
                let power = square.powf(0.5 * (self.exponent - 1.0));
                leak = rate * self.edge_v * r * power;
                by_excess = rate * power * (1.0 + (self.exponent - 1.0) * r * r / square);
            }
        }
        let sign = v.signum();
        let current = self.per_metre * w - leak * sign;
        let place = v / self.edge_v;
        let softer = 1.0 + self.capacitance_skew * place.clamp(-1.0, 1.0);
        let bend = if place.abs() < 1.0 { self.capacitance_skew / self.edge_v } else { 0.0 };
        let by_speed = sign * w.signum() * (by_excess * self.wider - leak / eased * self.eased);
        [softer * current, bend * current - softer * by_excess, softer * acceleration * (self.per_metre + by_speed)]
    }
}
