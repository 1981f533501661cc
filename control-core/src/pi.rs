//! PI with feedforward, volt and slew limits, and anti-windup: the law proper.
//!
//! Backward rule, integral in volts:
//!
//! ```text
//! I_{k+1} = I_k + Ki T e_k
//! u_k     = ff r_k + Kp e_k + I_{k+1}          (thesis 3.28, with V* = ff r)
//! ```
//!
//! **Precision.** At 1 MHz an increment is about 1e-5 V on an integral of 60 V, where f32 steps by 3.8e-6 V. The integral
//! therefore carries what each sum rounds away (compensated summation, Fast2Sum), so increments are never lost.
//!
//! **Anti-windup.** While a limit acts, an increment that would push the drive further into the limit is dropped
//! (integral and remainder stay bit for bit); an increment that leads back is taken. Hence:
//! the state after a saturation does not depend on its length; with r standing still the drive leaves the voltage limit in the very
//! sample in which the error changes sign; and abs(I) never exceeds max(abs(drive limits)) + ff max(abs(r)), because I
//! can only grow where ff r + Kp e + I is inside the limit with e pushing outward.
//!
//! Not here: the trip and the non-numbers ([`crate::Guard`]), the shaping of r ([`crate::Shaper`]).

use crate::arithmetic::between;
use crate::limits::Limits;
use crate::settings::Settings;

/// Gains and limits, already per sample. Immutable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pi {
    feedforward_v_per_m: f32,
    kp_v_per_m: f32,
    /// Ki T.
    ki_v_per_m: f32,
    drive_min_v: f32,
    drive_max_v: f32,
    /// Greatest change per sample.
    slew_v: f32,
}

/// What the law remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PiState {
    drive_v: f32,
    integral_v: f32,
    remainder_v: f32,
}

impl PiState {
    /// The last drive; 0 V, the safe level, before the first sample.
    pub fn drive_v(&self) -> f32 {
        self.drive_v
    }

    /// The integral, in volts.
    pub fn integral_v(&self) -> f32 {
        self.integral_v
    }

    /// The last drive did not get out, `drive_v` is still in force: the slew limit counts from there. The integral keeps the sample's increment, whose
    /// error was real and which was taken only where the drive could follow; it goes on being held by the slew limit from `drive_v`, so that
    /// nothing winds up however often this happens.
    pub(crate) fn hold(&mut self, drive_v: f32) {
        self.drive_v = drive_v;
    }
}

impl Pi {
    /// Takes checked settings.
    pub(crate) fn build(settings: &Settings) -> Pi {
        Pi {
            feedforward_v_per_m: settings.feedforward_v_per_m,
            kp_v_per_m: settings.kp_v_per_m,
            ki_v_per_m: settings.ki_v_per_m_s / settings.rate_hz,
            // A missing limit is the greatest f32, so that an overflow to infinity is held there instead of getting out.
            drive_min_v: settings.drive_min_v.max(f32::MIN),
            drive_max_v: settings.drive_max_v.min(f32::MAX),
            slew_v: settings.slew_v_per_s / settings.rate_hz,
        }
    }

    /// One sample: the drive for reference and measurement, both finite, and what held it back.
    ///
    /// The drive is within the voltage limits, and within the slew limit of the last one up to its own rounding (half an ulp).
    /// [`Limits::NOT_A_NUMBER`] comes back, with the drive kept, only if numbers near 1e33 m overflow an unlimited law.
    #[inline]
    pub fn step(&self, state: &mut PiState, reference_m: f32, measured_m: f32) -> (f32, Limits) {
        self.step_forward(state, self.forward_v(reference_m), reference_m, measured_m)
    }

    /// The static feedforward.
    #[inline(always)]
    pub(crate) fn forward_v(&self, reference_m: f32) -> f32 {
        self.feedforward_v_per_m * reference_m
    }

    /// The same with `forward_v` in place of the static feedforward.
    #[inline(always)]
    pub(crate) fn step_forward(
        &self,
        state: &mut PiState,
        forward_v: f32,
        reference_m: f32,
        measured_m: f32,
    ) -> (f32, Limits) {
        let error_m = reference_m - measured_m;
        let increment_v = self.ki_v_per_m * error_m;
        // Fast2Sum. Where the integral is smaller than the increment the remainder itself is rounded, by no more than
        // the increment was.
        let carried_v = increment_v + state.remainder_v;
        let integral_v = state.integral_v + carried_v;
        let remainder_v = carried_v - (integral_v - state.integral_v);
        let wish_v = forward_v + self.kp_v_per_m * error_m + integral_v;

        // Written so that NaN fails it.
        if (wish_v - state.drive_v).abs() <= self.slew_v && wish_v <= self.drive_max_v && wish_v >= self.drive_min_v {
            state.drive_v = wish_v;
            state.integral_v = integral_v;
            state.remainder_v = remainder_v;
            return (wish_v, Limits::NONE);
        }
        if wish_v.is_nan() {
            return (state.drive_v, Limits::NOT_A_NUMBER);
        }
        let (drive_v, limits) = self.limit(state.drive_v, wish_v);
        // Positive if the increment pushes the drive further out. (Should the product underflow, the increment is far below
        // what the integral's remainder can hold.)
        let push = (wish_v - drive_v) * increment_v;
        let outward = push > 0.0;
        if !outward {
            state.integral_v = integral_v;
            state.remainder_v = remainder_v;
        }
        state.drive_v = drive_v;
        (drive_v, limits)
    }

    /// One sample without the law: `wish_v` within the same volt and slew limits; NaN keeps the drive. The integral stays as it is.
    #[inline]
    pub fn step_open(&self, state: &mut PiState, wish_v: f32) -> (f32, Limits) {
        if wish_v.is_nan() {
            return (state.drive_v, Limits::NOT_A_NUMBER);
        }
        let (drive_v, limits) = self.limit(state.drive_v, wish_v);
        state.drive_v = drive_v;
        (drive_v, limits)
    }

    /// Nearest allowed drive to the wish: volts first, then slew, which wins should the last drive lie outside the volts
    /// (after an exchange of the law: the drive then returns at the slew rate).
    #[inline(always)]
    fn limit(&self, last_v: f32, wish_v: f32) -> (f32, Limits) {
        let volt_v = between(wish_v, self.drive_min_v, self.drive_max_v);
        let drive_v = between(volt_v, last_v - self.slew_v, last_v + self.slew_v);
        let mut limits = Limits::NONE;
        if volt_v != wish_v {
            limits |= Limits::VOLT;
        }
        if drive_v != volt_v {
            limits |= Limits::SLEW;
        }
        (drive_v, limits)
    }

    /// Greatest change of the drive per sample, in volts; infinite when there is no slew limit.
    pub fn slew_v(&self) -> f32 {
        self.slew_v
    }

    /// Moves the integral so that this law continues where `old` was, for the last reference and measurement.
    ///
    /// I' = I + (ff_old - ff) r + (Kp_old - Kp) e. A change of Ki alone changes nothing, since the integral is in volts.
    pub(crate) fn take_over(&self, old: &Pi, state: &mut PiState, reference_m: f32, measured_m: f32) {
        let error_m = reference_m - measured_m;
        let shift_v = (old.feedforward_v_per_m - self.feedforward_v_per_m) * reference_m
            + (old.kp_v_per_m - self.kp_v_per_m) * error_m;
        let integral_v = state.integral_v + shift_v;
        if integral_v.is_finite() {
            state.integral_v = integral_v;
        }
    }

    /// Sets the integral so that the law goes on from the present drive: I = u - ff r - Kp e. False, and nothing done, where numbers near 1e33 m
    /// overflow.
    pub(crate) fn close(&self, state: &mut PiState, reference_m: f32, measured_m: f32) -> bool {
        let error_m = reference_m - measured_m;
        let integral_v = state.drive_v - self.forward_v(reference_m) - self.kp_v_per_m * error_m;
        if !integral_v.is_finite() {
            return false;
        }
        *state = PiState { integral_v, remainder_v: 0.0, ..*state };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An integrator alone, without limits.
    fn integrator(ki_v_per_m_s: f32, rate_hz: f32) -> Pi {
        Pi::build(&Settings::unlimited(rate_hz, 0.0, ki_v_per_m_s, 0.0))
    }

    #[test]
    fn a_million_tiny_increments_are_not_lost() {
        // PI 1 at 1 MHz with 20 nm of error: 1.9e-5 V a sample, five ulp of the 60 V that are reached after 3.1e6 samples.
        let pi = integrator(9.6755e8, 1e6);
        let mut state = PiState::default();
        let (mut exact_v, mut plain_v) = (0.0_f64, 0.0_f32);
        for _ in 0..3_100_000 {
            pi.step(&mut state, 20e-9, 0.0);
            exact_v += f64::from(9.6755e8_f32) / 1e6 * f64::from(20e-9_f32);
            plain_v += 9.6755e8_f32 / 1e6 * 20e-9;
        }
        // Gain per sample, product and carry are rounded once each: 3 * 2^-24 of the sum, and the result itself once.
        let tolerance_v = 4.0 * exact_v / 16_777_216.0;
        assert!((f64::from(state.integral_v()) - exact_v).abs() <= tolerance_v);
        // The plain sum is off by more than a hundred times that, or this test would test nothing.
        assert!((f64::from(plain_v) - exact_v).abs() > 100.0 * tolerance_v);
    }

    #[test]
    fn an_increment_counts_in_its_own_sample() {
        // Backward rule: the first drive already holds Ki T e = 0.5 V.
        let pi = integrator(1e6, 1.0);
        let mut state = PiState::default();
        assert_eq!(pi.step(&mut state, 0.5e-6, 0.0), (0.5, Limits::NONE));
        assert_eq!(pi.step(&mut state, 0.5e-6, 0.0), (1.0, Limits::NONE));
    }

    #[test]
    fn an_overflow_that_has_no_value_keeps_the_drive_and_says_so() {
        let pi = Pi::build(&Settings::unlimited(1.0, 1e6, 0.0, 1e6));
        let mut state = PiState::default();
        pi.step(&mut state, 1e-6, 0.0);
        let drive_v = state.drive_v();
        // ff r = +inf and Kp e = -inf have no sum.
        assert_eq!(pi.step(&mut state, 1e34, 2e34), (drive_v, Limits::NOT_A_NUMBER));
        // A plain overflow is held at the greatest number.
        assert_eq!(pi.step(&mut state, 1e34, 0.0), (f32::MAX, Limits::VOLT));
    }

    #[test]
    fn an_open_loop_command_is_limited_and_leaves_the_integral_alone() {
        let mut settings = Settings::unlimited(20e3, 1.0, 1.0, 1.0);
        settings.drive_min_v = -90.0;
        settings.drive_max_v = 90.0;
        settings.slew_v_per_s = 1e6;
        let pi = Pi::build(&settings);
        let mut state = PiState::default();
        assert_eq!(pi.step_open(&mut state, 40.0), (40.0, Limits::NONE));
        assert_eq!(pi.step_open(&mut state, 200.0), (90.0, Limits::VOLT));
        assert_eq!(pi.step_open(&mut state, -200.0), (40.0, Limits::VOLT | Limits::SLEW));
        assert_eq!(pi.step_open(&mut state, f32::NAN), (40.0, Limits::NOT_A_NUMBER));
        assert_eq!(state.integral_v(), 0.0);
    }
}
