//! The sensor: what turns the structure's displacement into the logged number.

use super::{Growth, Lag};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// The sensor. In the order of the signal: play, lag, lead, gap, gain and curvature, offset, flaws, cycles, drift, lines, stairs; then jitter, noise, quantisation and
/// repeated samples, which no simulation can predict.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Full width of lost motion between structure and sensor, in metres.
    pub play_m: f64,
    /// Where several contacts share the joint, each with a play of its own, their widths go evenly from this share less than `play_m` up to it,
    /// and the sensor's side is in their mean: 0 for one contact, at most 1.
    pub play_spread: f64,
    /// Time constant with which the sensor's side creeps through the play, in seconds; infinite for a play without drag.
    pub drag_s: f64,
    /// Where it creeps to, in halves of the play from its middle: -1 or 1 where a spring takes the play up.
    pub drag_to: f64,
    /// Lost motion at single places: the reading stands still while the structure crosses one.
    pub gaps: Vec<Gap>,
    /// Bandwidth.
    pub lag: Option<Lag>,
    /// How the lag grows with the displacement.
    pub lag_growth: Growth,
    /// How much later than the log says its rows are read in the mean, in seconds, as far as the structure's velocity tells: what errors of the instants
    /// have in common.
    pub late_s: f64,
    /// Gain relative to the nominal sensor.
    pub gain: f64,
    /// Half of the difference between the gains on either side of zero: an instrument of two halves.
    pub gain_skew: f64,
    /// How the gain changes while the instrument warms up, from the log's start on; their product.
    pub settlings: Vec<Settling>,
    /// How the gain wanders besides; their sum.
    pub swings: Vec<Swing>,
    /// c2 in y + c2 y^2 + c3 y^3, 1/m.
    pub quadratic_per_m: f64,
    /// c3, 1/m^2.
    pub cubic_per_m2: f64,
    /// Reading at zero displacement, in metres.
    pub offset_m: f64,
    /// Errors at one place.
    pub flaws: Vec<Flaw>,
    /// Errors that repeat with the displacement.
    pub cycles: Vec<Cycle>,
    /// Drifts of the zero; their sum.
    pub drifts: Vec<Drift>,
    /// Lines that reach the reading and not the structure.
    pub lines: Vec<Line>,
    /// Stairs of a converter inside the instrument: noise comes after them, so that no lattice is left to see.
    pub stairs: Option<Stairs>,
    /// White noise, rms in metres.
    pub noise_m: f64,
    /// Noise that a first-order low-pass has made slow, rms in metres, and its time constant.
    pub slow_noise_m: f64,
    /// See `slow_noise_m`, in seconds.
    pub slow_noise_s: f64,
    /// Rms error of the sampling instants in seconds.
    pub jitter_s: f64,
    /// Share of samples that repeat the one before.
    pub repeated_share: f64,
    /// Step of the converter in metres; zero for none.
    pub quantum_m: f64,
    /// The sensor's clock runs fast by this ratio against the drive's at the log's start: row k is read at k (1 + ratio) samples. Acts
    /// where whole logs are replayed.
    pub clock_ratio: f64,
    /// Change of that ratio per second.
    pub clock_drift_per_s: f64,
}

/// amplitude (1 - exp(-t / time constant)); with an infinite time constant, amplitude is the change per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Amplitude in metres, or rate in m/s if the time constant is infinite.
    pub amplitude_m: f64,
    /// Time constant in seconds.
    pub time_constant_s: f64,
}

/// A gain times 1 + share (1 - exp(-t / time constant)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settling {
    /// Relative change of the gain in the end.
    pub share: f64,
    /// Time constant in seconds.
    pub time_constant_s: f64,
}

/// A gain of 1 + cos_share (1 - cos(w t)) + sin_share sin(w t), t from the log's start, w = 2 pi hz: what wanders slowly is the sum of a few.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Frequency in Hz.
    pub hz: f64,
    /// Relative, half of what the first part changes at the most.
    pub cos_share: f64,
    /// Relative, amplitude of the second.
    pub sin_share: f64,
}

impl Swing {
    /// The gain that `swings` make together, where `turned` tells sine and cosine of each by number and frequency.
    pub(super) fn gain(swings: &[Swing], turned: impl Fn(usize, f64) -> (f64, f64)) -> f64 {
        let one = |(number, swing): (usize, &Swing)| {
            let (sin, cos) = turned(number, swing.hz);
            swing.cos_share * (1.0 - cos) + swing.sin_share * sin
        };
        1.0 + swings.iter().enumerate().map(one).sum::<f64>()
    }
}

/// A joint with a gap: within `width_m` around `at_m` the structure moves and the sensor's side does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Middle of the gap, in metres of the structure's displacement.
    pub at_m: f64,
    /// Full width in metres, >= 0.
    pub width_m: f64,
}

/// An error of the reading at one place: a scratch of the target, or a region of another slope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flaw {
    /// Its middle, in metres of the displacement.
    pub at_m: f64,
    /// Its half width w in metres, > 0.
    pub width_m: f64,
    /// height exp(-(y - at)^2 / 2 w^2), in metres.
    pub bump_m: f64,
    /// height times (y - at) / w within the width, and -1 and 1 beyond it, in metres.
    pub rise_m: f64,
}

/// cos_m cos(2 pi y / period) + sin_m sin(2 pi y / period): the error of an encoder or an interferometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cycle {
    /// Period in metres, > 0.
    pub period_m: f64,
    /// Cosine amplitude in metres.
    pub cos_m: f64,
    /// Sine amplitude in metres.
    pub sin_m: f64,
}

/// at + Q round((y - at) / Q).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stairs {
    /// Q in metres, > 0.
    pub step_m: f64,
    /// One of its codes, in metres of the reading.
    pub at_m: f64,
}

/// cos_m cos(w t) + sin_m sin(w t), t from the log's start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Frequency in Hz.
    pub hz: f64,
    /// Cosine amplitude in metres.
    pub cos_m: f64,
    /// Sine amplitude in metres.
    pub sin_m: f64,
}

impl Sensor {
    /// Whether it is read at the instants of a clock that is not the drive's. That moves what is recorded and nothing that happens.
    pub fn has_own_clock(&self) -> bool {
        self.clock_ratio != 0.0 || self.clock_drift_per_s != 0.0
    }

    /// A sensor that reads the displacement.
    pub const IDEAL: Sensor = Sensor {
        play_m: 0.0,
        play_spread: 0.0,
        drag_s: f64::INFINITY,
        drag_to: 0.0,
        gaps: Vec::new(),
        lag: None,
        lag_growth: Growth::NONE,
        late_s: 0.0,
        gain: 1.0,
        gain_skew: 0.0,
        settlings: Vec::new(),
        swings: Vec::new(),
        quadratic_per_m: 0.0,
        cubic_per_m2: 0.0,
        offset_m: 0.0,
        flaws: Vec::new(),
        cycles: Vec::new(),
        drifts: Vec::new(),
        lines: Vec::new(),
        stairs: None,
        noise_m: 0.0,
        slow_noise_m: 0.0,
        slow_noise_s: 0.0,
        jitter_s: 0.0,
        repeated_share: 0.0,
        quantum_m: 0.0,
        clock_ratio: 0.0,
        clock_drift_per_s: 0.0,
    };

    /// The sensor without what [`Sensor::predictable_m`] does and without noise: play, lag, lateness and clock are left.
    pub fn before_reading(&self) -> Sensor {
        Sensor {
            play_m: self.play_m,
            play_spread: self.play_spread,
            drag_s: self.drag_s,
            drag_to: self.drag_to,
            lag: self.lag,
            lag_growth: self.lag_growth,
            late_s: self.late_s,
            clock_ratio: self.clock_ratio,
            clock_drift_per_s: self.clock_drift_per_s,
            ..Self::IDEAL
        }
    }

    /// Whether [`Sensor::predictable_m`] is a gain and an offset.
    pub(super) fn is_affine(&self) -> bool {
        let is_straight =
            self.gaps.is_empty() && self.gain_skew == 0.0 && self.quadratic_per_m == 0.0 && self.cubic_per_m2 == 0.0;
        let is_steady =
            self.settlings.is_empty() && self.swings.is_empty() && self.drifts.is_empty() && self.lines.is_empty();
        is_straight && is_steady && self.flaws.is_empty() && self.cycles.is_empty() && self.stairs.is_none()
    }

    /// The reading of a displacement (behind play and lag) at time `time_s`, without what is random.
    pub fn predictable_m(&self, displacement_m: f64, time_s: f64) -> f64 {
        self.reading_m(displacement_m, time_s, |_, hz| (std::f64::consts::TAU * hz * time_s).sin_cos())
    }

    /// The same where `turned` tells sine and cosine of each wave by number, swings first, and frequency.
    #[inline]
    pub(super) fn reading_m(&self, displacement_m: f64, time_s: f64, turned: impl Fn(usize, f64) -> (f64, f64)) -> f64 {
        let lost = |gap: &Gap| (displacement_m - gap.at_m).clamp(-0.5 * gap.width_m, 0.5 * gap.width_m);
        let displacement_m = displacement_m - self.gaps.iter().map(lost).sum::<f64>();
        let bent =
            displacement_m * (1.0 + displacement_m * (self.quadratic_per_m + displacement_m * self.cubic_per_m2));
        let settled = |settling: &Settling| 1.0 - settling.share * (-time_s / settling.time_constant_s).exp_m1();
        let settled = self.settlings.iter().map(settled).product::<f64>();
        let bent = bent + self.gain_skew * displacement_m.abs();
        let mut reading_m = self.gain * settled * Swing::gain(&self.swings, &turned) * bent + self.offset_m;
        for flaw in &self.flaws {
            let apart = (displacement_m - flaw.at_m) / flaw.width_m;
            reading_m += flaw.bump_m * (-0.5 * apart * apart).exp() + flaw.rise_m * apart.clamp(-1.0, 1.0);
        }
        for cycle in &self.cycles {
            let (sin, cos) = (std::f64::consts::TAU * displacement_m / cycle.period_m).sin_cos();
            reading_m += cycle.cos_m * cos + cycle.sin_m * sin;
        }
        for &Drift { amplitude_m, time_constant_s } in &self.drifts {
            reading_m +=
                amplitude_m * if time_constant_s.is_finite() { -(-time_s / time_constant_s).exp_m1() } else { time_s };
        }
        for (number, line) in self.lines.iter().enumerate() {
            let (sin, cos) = turned(self.swings.len() + number, line.hz);
            reading_m += line.cos_m * cos + line.sin_m * sin;
        }
        match self.stairs {
            Some(Stairs { step_m, at_m }) => at_m + step_m * ((reading_m - at_m) / step_m).round(),
            None => reading_m,
        }
    }
}

/// What is random in a sensor, at work: its parameters and its generator.
pub struct SensorState {
    sensor: Sensor,
    noise: Pcg64,
    slow_m: f64,
    last_m: Option<f64>,
}

impl SensorState {
    /// A sensor whose noise is determined by `seed`.
    pub fn new(sensor: &Sensor, seed: u64) -> Self {
        let mut noise = Pcg64::seed_from_u64(seed);
        let slow_m = if sensor.slow_noise_m > 0.0 {
            // It has been there for long.
            let normal: f64 = StandardNormal.sample(&mut noise);
            sensor.slow_noise_m * normal
        } else {
            0.0
        };
        Self { sensor: sensor.clone(), noise, slow_m, last_m: None }
    }

    /// The logged number for a predictable reading of a structure that moves at `velocity_m_per_s`, one sample of `sample_s` after the
    /// last, in metres.
    pub fn read_m(&mut self, predictable_m: f64, velocity_m_per_s: f64, sample_s: f64) -> f64 {
        let mut normal = || -> f64 { StandardNormal.sample(&mut self.noise) };
        let mut reading_m = predictable_m;
        if self.sensor.jitter_s > 0.0 {
            reading_m += self.sensor.gain * velocity_m_per_s * self.sensor.jitter_s * normal();
        }
        if self.sensor.noise_m > 0.0 {
            reading_m += self.sensor.noise_m * normal();
        }
        if self.sensor.slow_noise_m > 0.0 {
            let kept = (-sample_s / self.sensor.slow_noise_s.max(1e-9)).exp();
            self.slow_m = kept * self.slow_m + (1.0 - kept * kept).sqrt() * self.sensor.slow_noise_m * normal();
            reading_m += self.slow_m;
        }
        if self.sensor.quantum_m > 0.0 {
            reading_m = (reading_m / self.sensor.quantum_m).round() * self.sensor.quantum_m;
        }
        if self.sensor.repeated_share > 0.0
            && self.noise.random_bool(self.sensor.repeated_share.min(1.0))
            && let Some(last_m) = self.last_m
        {
            reading_m = last_m;
        }
        self.last_m = Some(reading_m);
        reading_m
    }
}
