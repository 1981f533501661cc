//! What a controller file says, in physical units, and what may be wrong with it.
//!
//! `Settings` are plain numbers that anyone may write; [`crate::Law::try_build`] is the only way from them to
//! something that runs, and the only place in the control path that can fail.
//! An infinite limit means "not limited".

use core::fmt;

/// A controller in physical units, as a controller file states it.
///
/// | field | meaning | unit |
/// | --- | --- | --- |
/// | `rate_hz` | samples per second; the law is only valid at this rate | Hz |
/// | `kp_v_per_m` | proportional gain Kp | V/m |
/// | `ki_v_per_m_s` | integral gain Ki | V/(m s) |
/// | `feedforward_v_per_m` | static feedforward, k/alpha of the plant; 0 turns it off | V/m |
/// | `drive_min_v`, `drive_max_v` | what the amplifier and the actuator stand; 0 V lies inside | V |
/// | `slew_v_per_s` | greatest change of the drive | V/s |
/// | `reference_max_m` | the reference is clamped to +- this | m |
/// | `reference_rate_m_per_s` | greatest rate of the shaped reference | m/s |
/// | `reference_acceleration_m_per_s2` | greatest acceleration of the shaped reference | m/s^2 |
/// | `trip_m` | the safe state is entered when abs(y) + abs(dy/dt) `stop_time_s` exceeds this | m |
/// | `stop_time_s` | how far ahead the trip looks: the time the plant needs to be stopped | s |
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the table above describes every field")]
pub struct Settings {
    pub rate_hz: f32,
    pub kp_v_per_m: f32,
    pub ki_v_per_m_s: f32,
    pub feedforward_v_per_m: f32,
    pub drive_min_v: f32,
    pub drive_max_v: f32,
    pub slew_v_per_s: f32,
    pub reference_max_m: f32,
    pub reference_rate_m_per_s: f32,
    pub reference_acceleration_m_per_s2: f32,
    pub trip_m: f32,
    pub stop_time_s: f32,
}

impl Settings {
    /// A reference clamp for examples and tests: 20 um below the displacement that may break the thesis' bender. Controller files state their own.
    pub const DEFAULT_REFERENCE_MAX_M: f32 = 100e-6;

    /// A trip for examples and tests: the displacement at which the thesis' bender may break (120 um). Controller files state their own.
    pub const DEFAULT_TRIP_M: f32 = 120e-6;

    /// Plain PI with feedforward and no guard at all, for reproducing published simulations; see [`Settings::is_unlimited`].
    pub const fn unlimited(rate_hz: f32, kp_v_per_m: f32, ki_v_per_m_s: f32, feedforward_v_per_m: f32) -> Settings {
        Settings {
            rate_hz,
            kp_v_per_m,
            ki_v_per_m_s,
            feedforward_v_per_m,
            drive_min_v: f32::NEG_INFINITY,
            drive_max_v: f32::INFINITY,
            slew_v_per_s: f32::INFINITY,
            reference_max_m: f32::INFINITY,
            reference_rate_m_per_s: f32::INFINITY,
            reference_acceleration_m_per_s2: f32::INFINITY,
            trip_m: f32::INFINITY,
            stop_time_s: 0.0,
        }
    }

    /// Whether any guard of the hardware is missing (volt, slew, reference clamp or trip infinite): boards refuse such settings.
    ///
    /// Missing shaping does not count, because an unshaped step is a legitimate bench experiment that the other guards
    /// make safe; see [`Settings::is_unshaped`].
    pub fn is_unlimited(&self) -> bool {
        [self.drive_min_v, self.drive_max_v, self.slew_v_per_s, self.reference_max_m, self.trip_m]
            .iter()
            .any(|guard| guard.is_infinite())
    }

    /// Whether the reference is only clamped, with neither its rate nor its acceleration bounded.
    pub fn is_unshaped(&self) -> bool {
        self.reference_rate_m_per_s.is_infinite() && self.reference_acceleration_m_per_s2.is_infinite()
    }

    /// Checks every field by itself and the fields against one another.
    pub(crate) fn check(&self) -> Result<(), SettingsError> {
        finite_above_zero("rate_hz", self.rate_hz)?;
        finite_from_zero("kp_v_per_m", self.kp_v_per_m)?;
        finite_from_zero("ki_v_per_m_s", self.ki_v_per_m_s)?;
        finite_from_zero("feedforward_v_per_m", self.feedforward_v_per_m)?;
        above_zero("slew_v_per_s", self.slew_v_per_s)?;
        above_zero("trip_m", self.trip_m)?;
        finite_from_zero("stop_time_s", self.stop_time_s)?;
        // 0 V at the actuator is the safe level, so it has to be reachable.
        if self.drive_min_v.is_nan() || self.drive_min_v > 0.0 {
            return Err(SettingsError::ZeroOutside { field: "drive_min_v" });
        }
        if self.drive_max_v.is_nan() || self.drive_max_v < 0.0 {
            return Err(SettingsError::ZeroOutside { field: "drive_max_v" });
        }
        // The products below are what the law really uses; they must not overflow or vanish.
        finite_from_zero("ki_v_per_m_s", self.ki_v_per_m_s / self.rate_hz)?;
        above_zero("slew_v_per_s", self.slew_v_per_s / self.rate_hz)?;
        finite_from_zero("stop_time_s", self.stop_time_s * self.rate_hz)?;
        // A clamp at or above the trip would let an allowed reference trip the machine.
        if self.reference_max_m >= self.trip_m && self.trip_m.is_finite() {
            return Err(SettingsError::ClampBeyondTrip);
        }
        Ok(())
    }
}

/// Why settings can't be built into something that runs. The `field` is the name of the field of [`Settings`] (or of
/// the constructor's argument) that is at fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SettingsError {
    /// The number has to be finite and is NaN or infinite.
    NotFinite {
        /// The field at fault.
        field: &'static str,
    },
    /// The number has to be greater than zero (infinity may be allowed, NaN is not).
    NotPositive {
        /// The field at fault.
        field: &'static str,
    },
    /// The number has to be zero or greater.
    Negative {
        /// The field at fault.
        field: &'static str,
    },
    /// 0 V, the safe level, lies outside the drive range.
    ZeroOutside {
        /// The field at fault.
        field: &'static str,
    },
    /// `reference_max_m` is not below `trip_m`, so that an allowed reference would trip.
    ClampBeyondTrip,
    /// The reference's rate or acceleration is bounded but its clamp is infinite: braking needs a place to stop.
    ShapingWithoutClamp,
    /// The acceleration is so small beside the rate (per sample, below rate / 65536) that f32 could not brake.
    AccelerationTooSmall,
    /// The number is below what is supported; `at_least` says what is.
    TooSmall {
        /// The field at fault.
        field: &'static str,
        /// The least supported value.
        at_least: u32,
    },
    /// The number is beyond what is supported; `at_most` says what is.
    TooLarge {
        /// The field at fault.
        field: &'static str,
        /// The greatest supported value.
        at_most: u32,
    },
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SettingsError::NotFinite { field } => write!(f, "{field} must be a finite number"),
            SettingsError::NotPositive { field } => write!(f, "{field} must be greater than zero"),
            SettingsError::Negative { field } => write!(f, "{field} must not be negative"),
            SettingsError::ZeroOutside { field } => {
                write!(f, "{field} leaves 0 V, the safe level, outside the drive range")
            }
            SettingsError::ClampBeyondTrip => {
                f.write_str("reference_max_m must be below trip_m, else an allowed reference trips")
            }
            SettingsError::ShapingWithoutClamp => f.write_str(
                "reference_max_m must be finite when reference_rate_m_per_s or reference_acceleration_m_per_s2 is",
            ),
            SettingsError::AccelerationTooSmall => {
                f.write_str("reference_acceleration_m_per_s2 / rate_hz must be at least reference_rate_m_per_s / 65536")
            }
            SettingsError::TooSmall { field, at_least } => {
                write!(f, "{field} must be at least {at_least}")
            }
            SettingsError::TooLarge { field, at_most } => {
                write!(f, "{field} must be at most {at_most}")
            }
        }
    }
}

impl core::error::Error for SettingsError {}

/// Refuses NaN, zero and negative numbers; infinity passes.
pub(crate) fn above_zero(field: &'static str, value: f32) -> Result<(), SettingsError> {
    if value > 0.0 { Ok(()) } else { Err(SettingsError::NotPositive { field }) }
}

/// Refuses NaN, infinities, zero and negative numbers.
pub(crate) fn finite_above_zero(field: &'static str, value: f32) -> Result<(), SettingsError> {
    finite(field, value)?;
    above_zero(field, value)
}

/// Refuses NaN, infinities and negative numbers.
pub(crate) fn finite_from_zero(field: &'static str, value: f32) -> Result<(), SettingsError> {
    finite(field, value)?;
    if value >= 0.0 { Ok(()) } else { Err(SettingsError::Negative { field }) }
}

/// Refuses NaN and infinities.
pub(crate) fn finite(field: &'static str, value: f32) -> Result<(), SettingsError> {
    if value.is_finite() { Ok(()) } else { Err(SettingsError::NotFinite { field }) }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    /// PI 1 with the guards of the thesis rig.
    fn guarded() -> Settings {
        Settings {
            rate_hz: 20e3,
            kp_v_per_m: 8.5811e5,
            ki_v_per_m_s: 9.6755e8,
            feedforward_v_per_m: 530_737.0,
            drive_min_v: -90.0,
            drive_max_v: 90.0,
            slew_v_per_s: 2e5,
            reference_max_m: 100e-6,
            reference_rate_m_per_s: 0.1,
            reference_acceleration_m_per_s2: 200.0,
            trip_m: 120e-6,
            stop_time_s: 100e-6,
        }
    }

    type Spoil = fn(&mut Settings);

    #[test]
    fn each_wrong_field_is_named() {
        let cases: [(Spoil, SettingsError); 12] = [
            (|s| s.rate_hz = 0.0, SettingsError::NotPositive { field: "rate_hz" }),
            (|s| s.rate_hz = f32::INFINITY, SettingsError::NotFinite { field: "rate_hz" }),
            (|s| s.kp_v_per_m = f32::NAN, SettingsError::NotFinite { field: "kp_v_per_m" }),
            (|s| s.kp_v_per_m = -1.0, SettingsError::Negative { field: "kp_v_per_m" }),
            (|s| s.ki_v_per_m_s = -1.0, SettingsError::Negative { field: "ki_v_per_m_s" }),
            (|s| s.feedforward_v_per_m = f32::INFINITY, SettingsError::NotFinite { field: "feedforward_v_per_m" }),
            (|s| s.drive_min_v = 1.0, SettingsError::ZeroOutside { field: "drive_min_v" }),
            (|s| s.drive_max_v = f32::NAN, SettingsError::ZeroOutside { field: "drive_max_v" }),
            (|s| s.slew_v_per_s = 0.0, SettingsError::NotPositive { field: "slew_v_per_s" }),
            (|s| s.trip_m = f32::NAN, SettingsError::NotPositive { field: "trip_m" }),
            (|s| s.stop_time_s = -1e-9, SettingsError::Negative { field: "stop_time_s" }),
            (|s| s.reference_max_m = 120e-6, SettingsError::ClampBeyondTrip),
        ];
        assert_eq!(guarded().check(), Ok(()));
        for (spoil, error) in cases {
            let mut settings = guarded();
            spoil(&mut settings);
            assert_eq!(settings.check(), Err(error));
            // The message names the field, so that a reader of a controller file finds the line.
            let text = error.to_string();
            assert!(text.contains('_'), "{text}");
        }
    }

    #[test]
    fn a_missing_guard_is_unlimited_and_missing_shaping_is_not() {
        assert!(!guarded().is_unlimited());
        let spoils: [Spoil; 5] = [
            |s| s.drive_min_v = f32::NEG_INFINITY,
            |s| s.drive_max_v = f32::INFINITY,
            |s| s.slew_v_per_s = f32::INFINITY,
            |s| s.reference_max_m = f32::INFINITY,
            |s| s.trip_m = f32::INFINITY,
        ];
        for spoil in spoils {
            let mut settings = guarded();
            spoil(&mut settings);
            assert!(settings.is_unlimited());
        }
        let mut unshaped = guarded();
        unshaped.reference_rate_m_per_s = f32::INFINITY;
        assert!(!unshaped.is_unshaped());
        unshaped.reference_acceleration_m_per_s2 = f32::INFINITY;
        assert!(unshaped.is_unshaped() && !unshaped.is_unlimited());
        assert!(Settings::unlimited(1e6, 1.0, 1.0, 0.0).is_unlimited());
    }
}
