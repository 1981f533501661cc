//! The way from any drive to 0 V when the loop ends: an S-curve in time, open loop.
//!
//! u(k) = u0 (1 - s^3 (10 - 15 s + 6 s^2)), s = k / N: velocity and acceleration are zero at both ends, the jerk is at most
//! 60 u0 / (N T)^3. Its steepest slope is 15/8 u0 / N per sample, so N = ceil(15/8 u0 / slew) keeps the slew limit.
//! The sensor plays no part, because a fault may mean that it lies.

/// A ramp to 0 V on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    from_v: f32,
    /// Samples done.
    sample_idx: u32,
    samples: u32,
    per_sample: f32,
}

impl Ramp {
    /// A ramp from `from_v` that changes by no more than `slew_v` per sample; an infinite slew gives 0 V at once.
    pub fn to_zero(from_v: f32, slew_v: f32) -> Ramp {
        // The conversion saturates. One sample more covers the rounding of the quotient.
        let samples = (1.875 * from_v.abs() / slew_v) as u32;
        let samples = samples.saturating_add(1);
        Ramp { from_v, sample_idx: 0, samples, per_sample: 1.0 / samples as f32 }
    }

    /// A ramp that has already arrived.
    pub const fn done() -> Ramp {
        Ramp { from_v: 0.0, sample_idx: 1, samples: 1, per_sample: 1.0 }
    }

    /// Whether 0 V has been reached.
    pub fn is_done(&self) -> bool {
        self.sample_idx >= self.samples
    }

    /// The next sample's drive; exactly 0 once arrived.
    #[inline]
    pub fn step(&mut self) -> f32 {
        self.sample_idx = self.sample_idx.saturating_add(1);
        self.drive_v()
    }

    /// The present drive.
    pub fn drive_v(&self) -> f32 {
        if self.is_done() {
            return 0.0;
        }
        let s = self.sample_idx as f32 * self.per_sample;
        let left = 1.0 - s * s * s * (10.0 - s * (15.0 - 6.0 * s));
        // Near the end rounding takes it below 0 by some 1e-7, and a drive below 0 V may be outside of the volt limits.
        if left > 0.0 { self.from_v * left } else { 0.0 }
    }

    /// The last step has not been taken after all: the next one repeats it. One that has arrived stays.
    pub fn step_back(&mut self) {
        if !self.is_done() {
            self.sample_idx = self.sample_idx.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_where_the_drive_was_and_ends_at_exactly_zero() {
        for (from_v, slew_v) in [(90.0_f32, 10.0_f32), (-60.0, 0.013), (1e-3, 5.0), (0.0, 1.0), (75.0, f32::INFINITY)] {
            let mut ramp = Ramp::to_zero(from_v, slew_v);
            assert_eq!(ramp.drive_v(), from_v);
            let mut last_v = from_v;
            let mut samples = 0_u32;
            while !ramp.is_done() {
                let drive_v = ramp.step();
                // The polynomial is computed to about 2e-6 of u0: ten roundings of terms up to 10, 2^-24 each.
                assert!((drive_v - last_v).abs() <= slew_v + 2e-6 * from_v.abs());
                assert!(drive_v.abs() <= last_v.abs() + 2e-6 * from_v.abs());
                last_v = drive_v;
                samples += 1;
            }
            assert_eq!(last_v, 0.0);
            // Not slower than it has to be either.
            assert!(samples as f32 <= 1.875 * from_v.abs() / slew_v + 1.0);
            assert_eq!(ramp.step(), 0.0);
        }
        assert!(Ramp::done().is_done());
    }

    #[test]
    fn a_long_ramp_stays_between_its_start_and_zero() {
        for (from_v, slew_v) in [(90.0_f32, 0.1_f32), (-90.0, 0.1), (90.0, 1e-3), (57.3, 1e-4)] {
            let mut ramp = Ramp::to_zero(from_v, slew_v);
            while !ramp.is_done() {
                let drive_v = ramp.step();
                let share = drive_v / from_v;
                assert!((0.0..=1.0).contains(&share), "{share} of {from_v} V");
            }
        }
    }

    #[test]
    fn a_step_taken_back_is_repeated_and_the_end_stays() {
        let mut ramp = Ramp::to_zero(60.0, 20.0);
        let mut last_v = ramp.drive_v();
        while !ramp.is_done() {
            let next_v = ramp.step();
            if !ramp.is_done() {
                ramp.step_back();
                assert_eq!(ramp.drive_v(), last_v);
                assert_eq!(ramp.step(), next_v);
            }
            last_v = next_v;
        }
        for mut arrived in [ramp, Ramp::done()] {
            arrived.step_back();
            assert_eq!((arrived.is_done(), arrived.drive_v()), (true, 0.0));
        }
    }

    #[test]
    fn jerk_stays_within_its_bound() {
        let mut ramp = Ramp::to_zero(90.0, 0.09);
        let samples = f64::from(ramp.samples);
        let drives_v: std::vec::Vec<f64> = (0..ramp.samples).map(|_| f64::from(ramp.step())).collect();
        // 60 u0 / N^3 = 8.2e-7 V per sample^3 here is below f32 resolution, so jerk is taken over strides of 100 samples.
        let jerk_bound = 60.0 * 90.0 / samples.powi(3) * 1e6;
        let coarse: std::vec::Vec<f64> = drives_v.iter().copied().step_by(100).collect();
        for four in coarse.windows(4) {
            let jerk = four[3] - 3.0 * four[2] + 3.0 * four[1] - four[0];
            // Rounding: 2e-6 u0 in each value, weights 1 + 3 + 3 + 1.
            assert!(jerk.abs() <= jerk_bound + 8.0 * 2e-6 * 90.0);
        }
    }
}
