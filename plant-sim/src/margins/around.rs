//! What else of a chain is linear and stands in the loop with a region of the plant: oscillators, creep and arms between structure and sensor, gain and
//! bandwidth of sensor and amplifier.
//!
//! What is not linear is left out: forces beside the springs, bends of hysterons, lost motion, curves of the sensor, limits. Of a gain that differs
//! from place to place the larger one counts, of an element of creep its share for small displacements.

use super::LinearRegion;
use crate::chain::{Chain, Drive, Joint, Lag, Mode, Parts, Sensor};
use std::f64::consts::TAU;

/// States of a plant with a structure: displacement and velocity first.
const DISPLACEMENT: usize = 0;
const VELOCITY: usize = 1;

impl Chain {
    /// `region` of the plant with all of the chain that is linear; the delay is none of it.
    pub(super) fn around(&self, mut region: LinearRegion) -> LinearRegion {
        let Chain { drive, plant, parts, sensor } = self;
        // A linear plant stands in place of actuator and structure.
        let modes = if parts.linear.is_some() { &[][..] } else { &parts.modes };
        modes.iter().for_each(|mode| region.join(mode, plant.mass_kg));
        let seen = region.clone();
        for element in &parts.creep {
            let relaxed = region.following(&seen, Lag::First { time_constant_s: element.time_constant_s });
            region.c[relaxed] += element.share;
        }
        for arm in &parts.arms {
            let natural_rad_per_s = TAU * arm.hz;
            let lag = Lag::Second { natural_rad_per_s, damping_ratio: arm.damping_ratio };
            let at = region.following(&seen, lag);
            region.c[at] += arm.share;
            region.c[at + 1] += arm.rate_share / natural_rad_per_s;
            region.c.columns_mut(0, seen.c.len()).zip_apply(&seen.c, |c, seen| *c -= arm.share * seen);
            region.d -= arm.share * seen.d;
        }
        if let Some(lag) = sensor.lag.filter(|lag| lag.acts()) {
            let seen = region.clone();
            let at = region.following(&seen, lag);
            region.c.fill(0.0);
            (region.c[at], region.d) = (1.0, 0.0);
        }
        let gain = sensor.gain + sensor.gain_skew.abs();
        region.c *= gain;
        region.d *= gain;
        // What comes late comes beside what is behind the bandwidth.
        let late = drive.late.map(|late| (late.share, Some(Lag::First { time_constant_s: late.time_constant_s })));
        let rest = 1.0 - late.map_or(0.0, |(share, _)| share);
        region.drive_by([(rest, drive.lag.filter(|lag| lag.acts()))].into_iter().chain(late));
        let gain = drive.largest_slope();
        region.b *= gain;
        region.d *= gain;
        region
    }

    /// Whether there is nothing but the plant, limits, converters, delay, and what comes from outside; every sample is read, and every command acts,
    /// when it should.
    pub fn is_bare(&self) -> bool {
        let Drive { range_v, delay_s, quantum_v, is_truncating, .. } = self.drive;
        let Drive { slew_v_per_s, slew_down_v_per_s, discharge_ratio, .. } = self.drive;
        let limits = Drive { range_v, slew_v_per_s, slew_down_v_per_s, discharge_ratio, ..Drive::IDEAL };
        let drive = Drive { delay_s, quantum_v, is_truncating, ..limits };
        let Sensor { offset_m, noise_m, slow_noise_m, slow_noise_s, quantum_m, .. } = self.sensor;
        let (drifts, lines, stairs) = (self.sensor.drifts.clone(), self.sensor.lines.clone(), self.sensor.stairs);
        let scatter = Sensor { noise_m, slow_noise_m, slow_noise_s, ..Sensor::IDEAL };
        let sensor = Sensor { offset_m, quantum_m, drifts, lines, stairs, ..scatter };
        let parts = Parts { shakes: self.parts.shakes.clone(), is_coarse: self.parts.is_coarse, ..Parts::default() };
        self.drive == drive && self.sensor == sensor && self.parts == parts
    }
}

impl LinearRegion {
    /// Makes room for so many states; the first of them.
    fn grow(&mut self, states: usize) -> usize {
        let first = self.a.nrows();
        let size = first + states;
        self.a = self.a.clone().resize(size, size, 0.0);
        self.b = self.b.clone().resize_vertically(size, 0.0);
        self.c = self.c.clone().resize_horizontally(size, 0.0);
        first
    }

    /// States of a low-pass, its value first, that nothing drives yet; which of them is driven, and by how much for one of what it follows.
    fn low_pass(&mut self, lag: Lag) -> (usize, usize, f64) {
        let (order, rate) = match lag {
            Lag::First { time_constant_s } => (1, 1.0 / time_constant_s),
            Lag::Second { natural_rad_per_s, .. } => (2, natural_rad_per_s * natural_rad_per_s),
        };
        let value = self.grow(order);
        let driven = value + order - 1;
        self.a[(driven, value)] = -rate;
        if let Lag::Second { natural_rad_per_s, damping_ratio } = lag {
            self.a[(value, driven)] = 1.0;
            self.a[(driven, driven)] = -2.0 * damping_ratio * natural_rad_per_s;
        }
        (value, driven, rate)
    }

    /// A state that follows what `seen`, this with fewer states, sees.
    fn following(&mut self, seen: &LinearRegion, lag: Lag) -> usize {
        let (value, driven, rate) = self.low_pass(lag);
        seen.c.iter().enumerate().for_each(|(state, c)| self.a[(driven, state)] += rate * c);
        self.b[driven] = rate * seen.d;
        value
    }

    /// Lets the input come in shares, each through a low-pass or at once.
    fn drive_by(&mut self, ways: impl Iterator<Item = (f64, Option<Lag>)>) {
        let (b, d) = (self.b.clone(), self.d);
        self.b.fill(0.0);
        self.d = 0.0;
        for (share, lag) in ways {
            let Some(lag) = lag else {
                self.b.rows_mut(0, b.len()).axpy(share, &b, 1.0);
                self.d += share * d;
                continue;
            };
            let (value, driven, rate) = self.low_pass(lag);
            self.a.column_mut(value).rows_mut(0, b.len()).axpy(share, &b, 1.0);
            self.c[value] += share * d;
            self.b[driven] = rate;
        }
    }

    /// Joins an oscillator to a structure of this mass.
    fn join(&mut self, mode: &Mode, mass_kg: f64) {
        let force_n_per_v = self.b[VELOCITY] * mass_kg;
        let natural_rad_per_s = TAU * mode.hz;
        let (at, driven, spring) = self.low_pass(Lag::Second { natural_rad_per_s, damping_ratio: mode.damping_ratio });
        match mode.joint {
            // On a spring and a damper, which pull at both.
            Joint::Attached { mass_kg: attached_kg } => {
                let damper = -self.a[(driven, driven)];
                let ratio = attached_kg / mass_kg;
                for (of, by) in [(DISPLACEMENT, spring), (VELOCITY, damper)] {
                    self.a[(driven, of)] += by;
                    self.a[(VELOCITY, of)] -= ratio * by;
                    self.a[(VELOCITY, at + of)] += ratio * by;
                }
            }
            Joint::Parallel { compliance_m_per_n } => {
                self.b[driven] = compliance_m_per_n * spring * force_n_per_v;
                self.c[at] = 1.0;
            }
        }
    }
}
