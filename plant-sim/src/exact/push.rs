//! What the engine is asked for: how long a move lasts, and what force acts meanwhile.

/// The durations that the engine is asked for, in seconds: one sample, the two parts of a sample with a fractional delay, or a short step
/// and a long one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spans {
    pub(super) durations_s: [f64; 2],
}

impl Spans {
    /// One duration for every step.
    pub fn whole(sample_s: f64) -> Self {
        Self { durations_s: [sample_s, 0.0] }
    }

    /// Steps of two lengths.
    pub fn two(durations_s: [f64; 2]) -> Self {
        Self { durations_s }
    }

    /// A sample in two parts: span 0 lasts `first_s`, span 1 the rest.
    pub fn split(sample_s: f64, first_s: f64) -> Self {
        Self::two([first_s, sample_s - first_s])
    }

    /// How long span 0 or 1 lasts, in seconds; zero for one that is not in use.
    pub fn duration_s(&self, span: usize) -> f64 {
        self.durations_s[span]
    }
}

/// The force over a move: `force_n + slope t + curve t^2 / 2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// Newton at the start.
    pub force_n: f64,
    /// Slope at the start in N/s.
    pub slope: f64,
    /// Second derivative in N/s^2.
    pub curve: f64,
}

impl Push {
    /// A constant force.
    pub fn held(force_n: f64) -> Self {
        Self { force_n, slope: 0.0, curve: 0.0 }
    }

    /// A force that changes steadily.
    pub fn ramp(force_n: f64, slope: f64) -> Self {
        Self { force_n, slope, curve: 0.0 }
    }

    /// This force so many times.
    pub fn times(self, factor: f64) -> Self {
        Self { force_n: factor * self.force_n, slope: factor * self.slope, curve: factor * self.curve }
    }

    /// This force and another.
    pub fn with(self, other: Self) -> Self {
        Self { force_n: self.force_n + other.force_n, slope: self.slope + other.slope, curve: self.curve + other.curve }
    }

    /// This force less another.
    pub fn without(self, other: Self) -> Self {
        Self { force_n: self.force_n - other.force_n, slope: self.slope - other.slope, curve: self.curve - other.curve }
    }

    /// The same force, seen `time_s` later.
    #[inline(always)]
    pub fn after(self, time_s: f64) -> Self {
        Self {
            force_n: self.force_n + time_s * (self.slope + 0.5 * time_s * self.curve),
            slope: self.slope + time_s * self.curve,
            curve: self.curve,
        }
    }
}
