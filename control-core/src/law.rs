//! The whole control law of one sample: guard, reference shaping, PI with feedforward, limits, anti-windup.
//!
//! [`Law`] is what was configured (immutable, built once), [`LawState`] is what one plant remembers. The step can't fail:
//! whatever comes in, a finite drive within its limits goes out, and the [`Limits`] say why.
//!
//! **Deadline.** On the board `step` runs between the ADC's end of conversion and the DAC's latch, 10 us after the sample
//! was taken; if it is late the old drive is latched again and the loop has one more sample of delay, which may be unstable.
//! There is no loop, no division, no table and no call outside this crate in it.

use crate::guard::{Guard, GuardState};
use crate::inverse::{Inverse, InverseState};
use crate::limits::Limits;
use crate::pi::{Pi, PiState};
use crate::settings::{Settings, SettingsError};
use crate::shaper::{Shaper, ShaperState};

/// A control law, ready to run at the rate it was built for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    guard: Guard,
    shaper: Shaper,
    pi: Pi,
    rate_hz: f32,
}

/// What the law remembers from sample to sample. `LawState::default()` is at rest: 0 V, reference 0, no sample seen.
#[derive(Clone, Copy, Debug, Default)]
pub struct LawState {
    guard: GuardState,
    shaper: ShaperState,
    pi: PiState,
}

/// The answer of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Voltage at the actuator, always finite.
    pub drive_v: f32,
    /// The reference that was used, after clamp and shaping.
    pub reference_m: f32,
    /// What held drive or reference back; [`Limits::is_safe_state`] tells that the law has given up.
    pub limited_by: Limits,
}

impl LawState {
    /// At rest, with a guard that has watched before.
    pub(crate) fn watched(guard: GuardState) -> LawState {
        LawState { guard, ..LawState::default() }
    }

    /// The last drive.
    pub fn drive_v(&self) -> f32 {
        self.pi.drive_v()
    }

    /// The last shaped reference.
    pub fn reference_m(&self) -> f32 {
        self.shaper.reference()
    }

    /// The integral, in volts.
    pub fn integral_v(&self) -> f32 {
        self.pi.integral_v()
    }

    /// Why the law is in its safe state; empty while it is not.
    pub fn latched(&self) -> Limits {
        self.guard.latched()
    }

    /// The last drive did not get out, `drive_v` is still in force.
    pub(crate) fn hold(&mut self, drive_v: f32) {
        self.pi.hold(drive_v);
    }
}

impl Law {
    /// Checks the settings and turns them into per-sample numbers.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] names the first field that can't be used.
    pub fn try_build(settings: &Settings) -> Result<Law, SettingsError> {
        settings.check()?;
        Ok(Law {
            guard: Guard::build(settings),
            shaper: Shaper::try_build(
                settings.rate_hz,
                settings.reference_max_m,
                settings.reference_rate_m_per_s,
                settings.reference_acceleration_m_per_s2,
            )?,
            pi: Pi::build(settings),
            rate_hz: settings.rate_hz,
        })
    }

    /// One sample of the closed loop.
    ///
    /// A NaN or infinite measurement or reference, or the displacement trip, puts the law into its safe state within this
    /// same sample: the drive goes to 0 V within the slew limit, and stays there until the state is replaced.
    #[inline]
    pub fn step(&self, state: &mut LawState, reference_m: f32, measured_m: f32) -> Output {
        match self.try_step(state, reference_m, measured_m) {
            Ok(output) => output,
            Err(_) => self.safe(state),
        }
    }

    /// One sample of the closed loop, or why there is none: then the drive still stands where it stood.
    #[inline(always)]
    pub(crate) fn try_step(&self, state: &mut LawState, reference_m: f32, measured_m: f32) -> Result<Output, Limits> {
        self.try_forward(state, reference_m, measured_m, |reference_m| self.pi.forward_v(reference_m))
    }

    /// The same sample as [`Law::step`] with the inverse of the plant in place of the static feedforward.
    #[inline]
    pub fn step_inverse(
        &self,
        state: &mut LawState,
        inverse: &Inverse,
        inverse_state: &mut InverseState,
        reference_m: f32,
        measured_m: f32,
    ) -> Output {
        match self.try_forward(state, reference_m, measured_m, |r| inverse.step(inverse_state, r)) {
            Ok(output) => output,
            Err(_) => self.safe(state),
        }
    }

    #[inline(always)]
    fn try_forward(
        &self,
        state: &mut LawState,
        reference_m: f32,
        measured_m: f32,
        forward_v: impl FnOnce(f32) -> f32,
    ) -> Result<Output, Limits> {
        let latched = self.guard.watch(&mut state.guard, measured_m);
        if !latched.is_empty() {
            return Err(latched);
        }
        // Inside the clamp it is a number, so the common path needs no comparison of its own for that.
        let (target_m, clamped) = if self.shaper.holds(reference_m) {
            (reference_m, Limits::NONE)
        } else if is_number(reference_m) {
            (self.shaper.clamped(reference_m), Limits::REFERENCE_CLAMP)
        } else {
            return Err(state.guard.latch(Limits::NOT_A_NUMBER));
        };
        let (reference_m, shaped) = self.shaper.follow(&mut state.shaper, target_m, clamped);
        let forward_v = forward_v(reference_m);
        let (drive_v, limited) = self.pi.step_forward(&mut state.pi, forward_v, reference_m, measured_m);
        if limited.is_safe_state() {
            return Err(state.guard.latch(limited));
        }
        Ok(Output { drive_v, reference_m, limited_by: shaped | limited })
    }

    /// One sample of an open-loop experiment: the commanded drive within the same volt and slew limits, watched by the
    /// same trip. The output's reference is that of the last closed-loop sample.
    #[inline]
    pub fn step_open(&self, state: &mut LawState, command_v: f32, measured_m: f32) -> Output {
        match self.try_step_open(state, command_v, measured_m) {
            Ok(output) => output,
            Err(_) => self.safe(state),
        }
    }

    /// As [`Law::try_step`], for an open-loop experiment.
    #[inline(always)]
    pub(crate) fn try_step_open(
        &self,
        state: &mut LawState,
        command_v: f32,
        measured_m: f32,
    ) -> Result<Output, Limits> {
        let latched = self.guard.watch(&mut state.guard, measured_m);
        if !latched.is_empty() {
            return Err(latched);
        }
        if !is_number(command_v) {
            return Err(state.guard.latch(Limits::NOT_A_NUMBER));
        }
        let (drive_v, limited_by) = self.pi.step_open(&mut state.pi, command_v);
        Ok(Output { drive_v, reference_m: state.shaper.reference(), limited_by })
    }

    /// Prepares `state`, left behind by `old`, for this law: the drive continues without a bump at the last reference
    /// and measurement, and the shaped reference keeps its speed although the rate may differ.
    ///
    /// Running this law on the state without it is safe too (every limit holds), only not bumpless. Where the new clamp is
    /// below the old reference, the reference steps to the clamp; where the new rate or acceleration is lower than the present
    /// motion, the reference is brought down within the new acceleration. A reference that was not shaped until now is shaped from rest, wherever
    /// it was going: its last move may have been a jump of any size, which is no speed to go on with.
    pub fn take_over(&self, old: &Law, state: &mut LawState) {
        let measured_m = state.guard.measured_m();
        // NaN: no sample was seen yet, so there is nothing to continue.
        if measured_m.is_finite() {
            let reference_m = state.shaper.reference();
            self.pi.take_over(&old.pi, &mut state.pi, reference_m, measured_m);
        }
        if old.shaper.shapes() {
            state.shaper.rescale(old.rate_hz / self.rate_hz);
        } else {
            state.shaper.halt();
        }
    }

    /// Prepares `state`, left behind by open-loop samples, for the closed loop: the reference begins at rest where the plant was last seen (or at
    /// the clamp), the drive continues where it is. So closing the loop moves nothing; what the reference then does is the wish's and the shaping's.
    ///
    /// Without it every limit holds as well, but the reference begins where the last closed-loop sample left it, far from the plant.
    pub fn close(&self, state: &mut LawState) {
        let measured_m = state.guard.measured_m();
        // NaN: no sample was seen yet, so there is nothing to begin from.
        if measured_m.is_nan() {
            return;
        }
        let reference_m = if self.shaper.holds(measured_m) { measured_m } else { self.shaper.clamped(measured_m) };
        if self.pi.close(&mut state.pi, reference_m, measured_m) {
            state.shaper = ShaperState::at(reference_m);
        }
    }

    /// The rate the law was built for.
    pub fn rate_hz(&self) -> f32 {
        self.rate_hz
    }

    /// Greatest change of the drive per sample, in volts; infinite when there is no slew limit.
    pub fn slew_v(&self) -> f32 {
        self.pi.slew_v()
    }

    /// The trip by itself, for watching the sensor before the loop runs.
    pub fn guard(&self) -> &Guard {
        &self.guard
    }

    /// The law proper, without guard and shaping.
    pub fn pi(&self) -> &Pi {
        &self.pi
    }

    /// The reference shaping by itself.
    pub fn shaper(&self) -> &Shaper {
        &self.shaper
    }

    /// Safe state: towards 0 V within the slew limit.
    #[cold]
    fn safe(&self, state: &mut LawState) -> Output {
        let (drive_v, limits) = self.pi.step_open(&mut state.pi, 0.0);
        Output { drive_v, reference_m: state.shaper.reference(), limited_by: limits | state.guard.latched() }
    }
}

/// Neither NaN nor infinite; one comparison on the target.
#[inline(always)]
fn is_number(x: f32) -> bool {
    x.abs() <= f32::MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(rate_hz: f32) -> Settings {
        Settings {
            rate_hz,
            kp_v_per_m: 2.3164e4,
            ki_v_per_m_s: 1.8384e8,
            feedforward_v_per_m: 530_737.0,
            drive_min_v: -90.0,
            drive_max_v: 90.0,
            slew_v_per_s: 2e5,
            reference_max_m: 100e-6,
            reference_rate_m_per_s: 0.1,
            reference_acceleration_m_per_s2: 200.0,
            trip_m: 120e-6,
            stop_time_s: 0.0,
        }
    }

    fn build(settings: &Settings) -> Law {
        Law::try_build(settings).expect("sound settings")
    }

    #[test]
    fn the_limits_say_what_acted() {
        let law = build(&settings(20e3));
        let mut state = LawState::default();
        // 0.5 um of reference in the first sample (a T^2): 0.27 V of feedforward and 0.016 V more.
        let output = law.step(&mut state, 80e-6, 0.0);
        assert_eq!(output.limited_by, Limits::REFERENCE_ACCELERATION);
        let output = law.step(&mut state, 1.0, 0.0);
        assert!(output.limited_by.contains(Limits::REFERENCE_CLAMP));
        for _ in 0..8 {
            law.step(&mut state, 1.0, 0.0);
        }
        // 10 samples at 0.5 um per sample^2: the rate of 5 um per sample is reached.
        let output = law.step(&mut state, 1.0, 0.0);
        assert_eq!(output.limited_by, Limits::REFERENCE_CLAMP | Limits::REFERENCE_RATE);
        // 1e5 samples of a sensor stuck at 0: 53 V of feedforward, the integral fills the rest.
        for _ in 0..100_000 {
            law.step(&mut state, 1.0, 0.0);
        }
        let output = law.step(&mut state, 100e-6, 0.0);
        assert_eq!(output.limited_by, Limits::VOLT);
        assert_eq!(output.drive_v, 90.0);
    }

    #[test]
    fn a_moving_reference_keeps_its_speed_when_the_rate_changes() {
        let (slow, fast) = (build(&settings(20e3)), build(&settings(40e3)));
        let mut state = LawState::default();
        for _ in 0..12 {
            slow.step(&mut state, 80e-6, 0.0);
        }
        let before_m = state.reference_m();
        fast.take_over(&slow, &mut state);
        fast.step(&mut state, 80e-6, 0.0);
        // 0.1 m/s are 2.5 um at 40 kHz. The reference is near 35 um, where f32 steps by 3.6e-12.
        let moved_m = state.reference_m() - before_m;
        assert!((moved_m - 2.5e-6).abs() < 8e-12, "{moved_m}");
    }

    #[test]
    fn what_went_unshaped_for_a_while_is_shaped_from_rest() {
        let shaped = build(&Settings { reference_rate_m_per_s: 0.2, ..settings(20e3) });
        let unshaped = build(&Settings {
            reference_rate_m_per_s: f32::INFINITY,
            reference_acceleration_m_per_s2: f32::INFINITY,
            ..settings(20e3)
        });
        // Met exactly, at 3.77 um a sample where the third period ends, and still pursued, at 6 um a sample.
        let sine = |k: u16| 80e-6 * (core::f32::consts::TAU * 150.0 / 20e3 * f32::from(k)).sin();
        let jump = |_| 80e-6;
        for (wish, samples) in [(&sine as &dyn Fn(u16) -> f32, 400), (&jump, 12)] {
            let mut state = LawState::default();
            let mut last_m = 0.0;
            for k in 1..=samples {
                last_m = state.reference_m();
                shaped.step(&mut state, wish(k), 0.0);
            }
            assert!(state.reference_m() - last_m > 3.7e-6, "{last_m}");
            unshaped.take_over(&shaped, &mut state);
            for _ in 0..5 {
                unshaped.step(&mut state, 20e-6, 0.0);
            }
            shaped.take_over(&unshaped, &mut state);
            for _ in 0..300 {
                assert_eq!(shaped.step(&mut state, 20e-6, 0.0).reference_m, 20e-6);
            }
        }
    }

    /// A law that has held 40 V in open loop until a plant, with `gain_m_per_v` and a lag, stands still; and where that is.
    fn opened(law: &Law, gain_m_per_v: f32) -> (LawState, f32) {
        let (mut state, mut displacement_m) = (LawState::default(), 0.0);
        for _ in 0..200 {
            let drive_v = law.step_open(&mut state, 40.0, displacement_m).drive_v;
            displacement_m += (gain_m_per_v * drive_v - displacement_m) * 0.25;
        }
        (state, displacement_m)
    }

    #[test]
    fn a_loop_that_is_closed_under_way_begins_where_the_plant_stands() {
        let pi1 = Settings { kp_v_per_m: 8.5811e5, ki_v_per_m_s: 9.6755e8, ..settings(20e3) };
        let law = build(&pi1);
        // Told to stay, it stays: f32 rounds terms of 40 V, to 4e-6 V each.
        let (mut state, stands_m) = opened(&law, 1.88e-6);
        law.close(&mut state);
        for _ in 0..100 {
            let drive_v = law.step(&mut state, stands_m, stands_m).drive_v;
            assert!((drive_v - 40.0).abs() < 1e-4, "{drive_v}");
        }
        // Told to go 5.2 um back it goes there, and nowhere else.
        let (mut state, mut displacement_m) = opened(&law, 1.88e-6);
        law.close(&mut state);
        for sample in 0..400 {
            let output = law.step(&mut state, 70e-6, displacement_m);
            // a T^2 = 0.5 um, of which ff, Kp and Ki T make 0.72 V.
            assert!(sample > 0 || (39.2..39.4).contains(&output.drive_v), "{output:?}");
            displacement_m += (1.88e-6 * output.drive_v - displacement_m) * 0.25;
            // 1 um for the loop's own overshoot.
            assert!((69e-6..stands_m + 1e-9).contains(&displacement_m), "{sample} {displacement_m}");
        }
        assert!((displacement_m - 70e-6).abs() < 1e-9, "{displacement_m}");
        // At 112 um it begins at the clamp, with 12 um of error: Ki T e is 0.58 V in the first sample.
        let (mut state, stands_m) = opened(&law, 2.8e-6);
        law.close(&mut state);
        let output = law.step(&mut state, 100e-6, stands_m);
        assert_eq!(output.reference_m, 100e-6);
        assert!((output.drive_v - 39.42).abs() < 0.01, "{output:?}");
    }

    #[test]
    fn a_fresh_state_forgets_a_trip() {
        let law = build(&settings(20e3));
        let mut state = LawState::default();
        assert!(law.step(&mut state, 0.0, 200e-6).limited_by.contains(Limits::TRIP));
        assert_eq!(state.latched(), Limits::TRIP);
        assert!(law.step(&mut state, 0.0, 0.0).limited_by.contains(Limits::TRIP));
        state = LawState::default();
        assert!(law.step(&mut state, 0.0, 0.0).limited_by.is_empty());
    }

    #[test]
    fn an_error_names_the_shaping_too() {
        let spoiled = Settings { reference_acceleration_m_per_s2: -1.0, ..settings(20e3) };
        let field = "reference_acceleration_m_per_s2";
        assert_eq!(Law::try_build(&spoiled), Err(SettingsError::NotPositive { field }));
    }
}
