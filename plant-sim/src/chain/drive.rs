//! The drive: what stands between the controller's number and the volts on the actuator.

use super::{Growth, Held, Lag, Swing, TYPICAL_V};
use crate::exact::Stepper;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Keeps the drive's draws apart from the sensor's, which has the same seed.
const STREAM: u64 = 0x6472_6976_6500_0000;

/// Places at which a drive's slope is looked at, evenly over its range.
const PLACES: usize = 400;
/// How far from a kink either side of it is, in volts.
const BESIDE_V: f64 = 1e-6;

/// Converter and amplifier. In the order of the signal: quantisation, delay, gain, curvature, a gain that changes,
/// saturation, slew, lag and what comes late, warming.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Lowest and highest output in volts; infinite for none.
    pub range_v: [f64; 2],
    /// Width over which the output bends into its range, in volts; zero for a hard clip.
    pub knee_v: f64,
    /// Gain that is left beyond the range; zero for an output that stops there.
    pub slope_beyond: f64,
    /// k in u / sqrt(1 + k u^2), in 1/V^2: an output that falls behind long before its limit of 1/sqrt(k).
    pub compression_per_v2: f64,
    /// Pure delay in seconds, >= 0.
    pub delay_s: f64,
    /// Step of the converter in volts; zero for none.
    pub quantum_v: f64,
    /// The converter drops what is below its last bit instead of rounding.
    pub is_truncating: bool,
    /// Gain relative to the nominal amplifier.
    pub gain: f64,
    /// Voltages at which the gain changes: two of them bound a stretch with a gain of its own, several are any curve.
    pub hinges: Vec<Hinge>,
    /// c in u (1 + c |u|): a gain that grows with the voltage, in 1/V.
    pub gain_growth_per_v: f64,
    /// c in u (1 + c u), an even nonlinearity in 1/V.
    pub curvature_per_v: f64,
    /// Voltages above which the gain is another one; their sum.
    pub steeper: Vec<Steeper>,
    /// Fastest rise of the output in V/s; infinite for none.
    pub slew_v_per_s: f64,
    /// Fastest fall of the output in V/s; infinite for none.
    pub slew_down_v_per_s: f64,
    /// Both limits times this while the output goes back to zero: a load discharges through another path than it is charged.
    pub discharge_ratio: f64,
    /// Bandwidth of the output.
    pub lag: Option<Lag>,
    /// How the lag grows with the output.
    pub lag_growth: Growth,
    /// A share of the output that comes later than the rest.
    pub late: Option<Late>,
    /// Gains that change as the actuator warms; their product.
    pub warmings: Vec<Warming>,
    /// How that gain wanders besides; their sum.
    pub swings: Vec<Swing>,
    /// Probability that a command never arrives and the one before stays. Acts where a controller writes its commands
    /// ([`Arrivals`]), not where a log is replayed: no simulation can predict which ones were lost.
    pub lost_share: f64,
}

/// share x beside (1 - share) of the rest, x behind a low-pass of its own: what a divider that is not compensated, or a dielectric that absorbs,
/// makes of a gain. A negative share is a gain that fades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Late {
    /// Share of the output.
    pub share: f64,
    /// Time constant of the low-pass in seconds, > 0.
    pub time_constant_s: f64,
}

/// change (|u - at| - |at|): the gain is smaller by `change` below `at_v` and larger by it above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Where, in volts of the command.
    pub at_v: f64,
    /// Half of the difference between the gains above and below.
    pub change: f64,
}

/// g max(u - at, 0), of what the curvature has left of the command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steeper {
    /// From where on, in volts.
    pub at_v: f64,
    /// g.
    pub gain_change: f64,
}

/// Gain 1 + coefficient * theta, with time_constant theta' = heating - theta.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warming {
    /// Relative change of the gain once theta is one.
    pub coefficient: f64,
    /// Thermal time constant in seconds.
    pub time_constant_s: f64,
    /// What heats.
    pub heat: Heat,
}

/// Source of the heat that [`Warming`] counts, made dimensionless by a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heat {
    /// Time since the log's start: 1.
    Time,
    /// Square of the drive over the square of this many volts.
    Drive {
        /// Reference in volts.
        volts: f64,
    },
    /// |v v'| over this many volts squared per second: dielectric loss, a fixed share of what flows in and out of the ceramic.
    Loss {
        /// Reference in V^2/s.
        volts2_per_s: f64,
    },
}

/// What is random in a drive, at work: which commands arrive.
pub struct Arrivals {
    lost_share: f64,
    noise: Pcg64,
}

impl Arrivals {
    /// Arrivals determined by `seed`.
    pub fn new(drive: &Drive, seed: u64) -> Self {
        Self { lost_share: drive.lost_share.clamp(0.0, 1.0), noise: Pcg64::seed_from_u64(seed ^ STREAM) }
    }

    /// Whether the next command arrives; one draw a command.
    pub fn next_arrives(&mut self) -> bool {
        !(self.lost_share > 0.0 && self.noise.random_bool(self.lost_share))
    }
}

impl Drive {
    /// A drive that does nothing.
    pub const IDEAL: Drive = Drive {
        range_v: [f64::NEG_INFINITY, f64::INFINITY],
        knee_v: 0.0,
        slope_beyond: 0.0,
        compression_per_v2: 0.0,
        delay_s: 0.0,
        quantum_v: 0.0,
        is_truncating: false,
        gain: 1.0,
        hinges: Vec::new(),
        gain_growth_per_v: 0.0,
        curvature_per_v: 0.0,
        steeper: Vec::new(),
        slew_v_per_s: f64::INFINITY,
        slew_down_v_per_s: f64::INFINITY,
        discharge_ratio: 1.0,
        lag: None,
        lag_growth: Growth::NONE,
        late: None,
        warmings: Vec::new(),
        swings: Vec::new(),
        lost_share: 0.0,
    };

    /// Volts that the amplifier strives for on a command that has passed the delay: everything of the drive that has no memory.
    #[inline]
    pub fn output_v(&self, command_v: f64) -> f64 {
        let converted_v = if self.quantum_v > 0.0 {
            let codes = command_v / self.quantum_v;
            self.quantum_v * if self.is_truncating { codes.floor() } else { codes.round() }
        } else {
            command_v
        };
        let turned = |hinge: &Hinge| hinge.change * ((converted_v - hinge.at_v).abs() - hinge.at_v.abs());
        let amplified_v = converted_v * (1.0 + self.gain_growth_per_v * converted_v.abs())
            + self.hinges.iter().map(turned).sum::<f64>();
        let bent_v = amplified_v * (1.0 + self.curvature_per_v * amplified_v);
        let more = |steeper: &Steeper| steeper.gain_change * (bent_v - steeper.at_v).max(0.0);
        let changed_v = self.gain * (bent_v + self.steeper.iter().map(more).sum::<f64>());
        let wanted_v = if self.compression_per_v2 > 0.0 {
            changed_v / (1.0 + self.compression_per_v2 * changed_v * changed_v).sqrt()
        } else {
            changed_v
        };
        let within_v =
            if self.knee_v > 0.0 { self.bent_v(wanted_v) } else { wanted_v.clamp(self.range_v[0], self.range_v[1]) };
        within_v + self.slope_beyond * (wanted_v - within_v)
    }

    /// Largest slope of the output within its range, the converter's steps and the limits' corners left out: what a loop meets somewhere.
    /// Without limits, as far as a bender's drive goes and a little beyond the last kink.
    pub(crate) fn largest_slope(&self) -> f64 {
        let kinks_v = self.hinges.iter().map(|hinge| hinge.at_v).chain(self.steeper.iter().map(|steeper| steeper.at_v));
        let reach_v = kinks_v.clone().fold(TYPICAL_V, |reach_v, at_v| reach_v.max(at_v.abs() + 1.0));
        let within = |limit_v: f64, reach_v: f64| if limit_v.is_finite() { limit_v } else { reach_v };
        let (low_v, high_v) = (within(self.range_v[0], -reach_v), within(self.range_v[1], reach_v));
        let even = (0..=PLACES).map(|place| low_v + (high_v - low_v) * place as f64 / PLACES as f64);
        let beside = kinks_v.chain([0.0]).flat_map(|at_v| [at_v - BESIDE_V, at_v + BESIDE_V]);
        let slopes = even.chain(beside.filter(|at_v| (low_v..=high_v).contains(at_v))).map(|at_v| self.slope(at_v));
        slopes.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(self.gain)
    }

    /// Slope of the output at a command, without steps and limits.
    fn slope(&self, command_v: f64) -> f64 {
        let turned = |hinge: &Hinge| hinge.change * ((command_v - hinge.at_v).abs() - hinge.at_v.abs());
        let amplified_v =
            command_v * (1.0 + self.gain_growth_per_v * command_v.abs()) + self.hinges.iter().map(turned).sum::<f64>();
        let turns = |hinge: &Hinge| hinge.change * (command_v - hinge.at_v).signum();
        let amplified =
            1.0 + 2.0 * self.gain_growth_per_v * command_v.abs() + self.hinges.iter().map(turns).sum::<f64>();
        let bent_v = amplified_v * (1.0 + self.curvature_per_v * amplified_v);
        let bent = amplified * (1.0 + 2.0 * self.curvature_per_v * amplified_v);
        let beyond = self.steeper.iter().filter(|steeper| bent_v > steeper.at_v);
        let [more_v, more] = beyond.fold([0.0f64; 2], |[v, slope], steeper| {
            [v + steeper.gain_change * (bent_v - steeper.at_v), slope + steeper.gain_change]
        });
        let changed_v = self.gain * (bent_v + more_v);
        self.gain * bent * (1.0 + more) / (1.0 + self.compression_per_v2 * changed_v * changed_v).powf(1.5)
    }

    /// A clip whose corner is rounded over the knee: the primitive of a logistic step.
    fn bent_v(&self, wanted_v: f64) -> f64 {
        let beyond =
            |v: f64| if v.is_finite() { self.knee_v * (v / self.knee_v).exp().ln_1p().min(1e300) } else { 0.0 };
        let over = |v: f64| if v > 40.0 * self.knee_v { v } else { beyond(v) };
        wanted_v - over(wanted_v - self.range_v[1]) + over(self.range_v[0] - wanted_v)
    }

    /// Whether the output changes between two commands, other than by a delay.
    pub(crate) fn has_memory(&self) -> bool {
        self.lag.is_some() || self.late.is_some() || self.slew_v_per_s.min(self.slew_down_v_per_s).is_finite()
    }
}

/// What a drive makes of commands, at every sample: most drives are a gain within a range, which needs none of the rest.
pub(super) struct Output {
    pub drive: Drive,
    is_gain: bool,
}

impl Output {
    pub(super) fn new(drive: &Drive) -> Self {
        let bends = [drive.gain_growth_per_v, drive.curvature_per_v, drive.compression_per_v2];
        let has_kinks = !drive.hinges.is_empty() || !drive.steeper.is_empty();
        let is_straight = !has_kinks && bends.into_iter().all(|bend| bend == 0.0);
        let is_clipped = drive.knee_v <= 0.0 && drive.slope_beyond == 0.0;
        Self { drive: drive.clone(), is_gain: is_straight && is_clipped && drive.quantum_v <= 0.0 }
    }

    /// [`Drive::output_v`].
    #[inline]
    pub(super) fn at_v(&self, command_v: f64) -> f64 {
        if !self.is_gain {
            return self.drive.output_v(command_v);
        }
        (self.drive.gain * command_v).clamp(self.drive.range_v[0], self.drive.range_v[1])
    }

    /// Moves over `span`, which lasts `duration_s`, on a command that has been held for `age_s` by then, under force `alpha` times drive minus
    /// `force_n`; returns the volts at its end.
    #[inline]
    pub(super) fn hold(
        &self,
        stepper: &mut dyn Stepper,
        span: usize,
        held: Held,
        [age_s, duration_s]: [f64; 2],
        [alpha, force_n]: [f64; 2],
    ) -> f64 {
        let start_v = self.at_v(held.start_v + held.slope_v_per_s * age_s);
        if held.slope_v_per_s == 0.0 {
            stepper.advance(span, alpha * start_v - force_n, 0.0);
            return start_v;
        }
        let end_v = self.at_v(held.start_v + held.slope_v_per_s * (age_s + duration_s));
        stepper.advance(span, alpha * start_v - force_n, alpha * (end_v - start_v) / duration_s);
        end_v
    }
}
