//! Everything on a board that a user may set, as one set: checked together, put in force at one sample.

use control_core::{AdcCode, Calibration, CalibrationSettings, Law, Settings, SettingsError};
use core::fmt;
use serde::{Deserialize, Serialize};

/// A board's parameters. All of them travel together, so that no half of a set is ever in force.
///
/// | field | meaning | unit |
/// | --- | --- | --- |
/// | `rate_hz` ... `stop_time_s` | as in [`control_core::Settings`] | |
/// | `adc_zero_v`, `sensor_m_per_v`, `amplifier_v_per_v` | as in [`control_core::CalibrationSettings`] | |
/// | `monitor_zero_v` | volts at the monitor's ADC pin at 0 V of the amplifier | V |
/// | `monitor_v_per_v` | amplifier volts per volt at the monitor's pin | - |
/// | `monitor_tolerance_v` | how far the amplifier may be from the drive; infinite where no monitor is wired | V |
/// | `monitor_samples` | for how many samples in a row, before it is a fault | |
/// | `rail_codes` | within so many codes of either end the sensor counts as broken | ADC code |
/// | `overrun_limit` | overruns, closer than 256 samples to one another, that are a fault | |
/// | `link_timeout_s` | silence of the host that is a fault from arming on; infinite for a board that runs alone | s |
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the table above describes every field")]
pub struct Parameters {
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
    pub adc_zero_v: f32,
    pub sensor_m_per_v: f32,
    pub amplifier_v_per_v: f32,
    pub monitor_zero_v: f32,
    pub monitor_v_per_v: f32,
    pub monitor_tolerance_v: f32,
    pub monitor_samples: u16,
    pub rail_codes: u16,
    pub overrun_limit: u16,
    pub link_timeout_s: f32,
}

/// A board's converters and timer: what parameters can't change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Converters {
    /// Width of the displacement's ADC.
    pub adc_bits: u8,
    /// Volts of the displacement's ADC at code 2^bits.
    pub adc_full_scale_v: f32,
    /// Width of the monitor's ADC.
    pub monitor_bits: u8,
    /// Volts of the monitor's ADC at code 2^bits.
    pub monitor_full_scale_v: f32,
    /// Width of the DAC.
    pub dac_bits: u8,
    /// Volts of the DAC at code 2^bits.
    pub dac_full_scale_v: f32,
    /// Volts at either end of the DAC that its output can't reach.
    pub dac_margin_v: f32,
    /// Clock of the sampling timer.
    pub timer_hz: u32,
    /// Fewest cycles of that clock between two samples; the latch lies before them.
    pub period_min_cycles: u32,
    /// Most cycles of that clock between two samples.
    pub period_max_cycles: u32,
    /// Cycles from the ADC's trigger until it holds its input: the sampling instant.
    pub hold_cycles: u32,
    /// Cycles from the sampling instant to the DAC's latch.
    pub latch_cycles: u32,
}

/// Why a set of parameters can't be used. Nothing of it was put in force.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ParameterError {
    /// The law or the calibration can't be built.
    Settings(SettingsError),
    /// The rate does not divide the timer's clock.
    RateDoesNotDivide {
        /// The rate asked for.
        rate_hz: f32,
        /// The clock.
        timer_hz: u32,
    },
    /// The rate is outside of what the board reaches.
    RateOutside {
        /// Least.
        least_hz: u32,
        /// Greatest.
        most_hz: u32,
    },
    /// A guard of the hardware is infinite.
    Unlimited,
    /// The drive's limits lie beyond what the DAC and the amplifier reach, so that saturation would go unseen by the law.
    BeyondSpan {
        /// Lowest reachable drive.
        low_v: f32,
        /// Highest reachable drive.
        high_v: f32,
    },
    /// The displacement at which the guard trips lies beyond what the sensor can show.
    TripBeyondSensor,
    /// From a limit of the drive to 0 V, which is what a stop or a fault does, would take too long.
    SlowToZero {
        /// Slowest that is quick enough.
        least_v_per_s: f32,
    },
    /// A number is NaN, zero or negative where none of these makes sense.
    NotPositive {
        /// The field at fault.
        field: &'static str,
    },
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParameterError::Settings(error) => write!(f, "{error}"),
            ParameterError::RateDoesNotDivide { rate_hz, timer_hz } => {
                write!(f, "rate_hz {rate_hz} does not divide the timer's clock of {timer_hz} Hz: take 20000 or 40000")
            }
            ParameterError::RateOutside { least_hz, most_hz } => {
                write!(f, "rate_hz must be {least_hz} to {most_hz} on this board")
            }
            ParameterError::Unlimited => f.write_str(
                "drive_min_v, drive_max_v, slew_v_per_s, reference_max_m and trip_m must be finite on a board",
            ),
            ParameterError::BeyondSpan { low_v, high_v } => {
                write!(
                    f,
                    "drive_min_v and drive_max_v must lie within {low_v} to {high_v} V, what DAC and amplifier reach"
                )
            }
            ParameterError::TripBeyondSensor => f.write_str(
                "trip_m lies beyond the sensor's range less rail_codes, so that a trip would look like a broken wire: lower it",
            ),
            ParameterError::SlowToZero { least_v_per_s } => write!(
                f,
                "slew_v_per_s must be {least_v_per_s} or more, so that a stop or a fault is at 0 V within {LONGEST_WAY_S} s"
            ),
            ParameterError::NotPositive { field } => write!(f, "{field} must be greater than zero"),
        }
    }
}

impl core::error::Error for ParameterError {}

impl From<SettingsError> for ParameterError {
    fn from(error: SettingsError) -> ParameterError {
        ParameterError::Settings(error)
    }
}

/// Longest way from a limit of the drive to 0 V, in seconds. Chosen: who presses a stop waits for it.
const LONGEST_WAY_S: f32 = 10.0;
/// The ramp to 0 V is steepest in its middle, and its slope is so many times its mean there ([`control_core::Ramp`]).
const STEEPEST: f32 = 15.0 / 8.0;

/// A set of parameters that passed [`Parameters::check`], in the form a control interrupt uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checked {
    /// The law.
    pub law: Law,
    /// Codes to volts and metres and back.
    pub calibration: Calibration,
    /// Cycles of the sampling timer between two samples.
    pub period_cycles: u32,
    /// Monitor volts per monitor code, at the amplifier.
    pub monitor_v_per_code: f32,
    /// Monitor code at 0 V of the amplifier.
    pub monitor_zero_code: f32,
    /// See [`Parameters`].
    pub monitor_tolerance_v: f32,
    /// See [`Parameters`].
    pub monitor_samples: u16,
    /// The lowest code that is away from both rails, and how many there are from it on.
    pub open_codes: (u16, u16),
    /// See [`Parameters`].
    pub overrun_limit: u16,
    /// Samples of silence that are a link loss; `u32::MAX` for never.
    pub link_timeout_samples: u32,
    /// 1 over [`crate::Identity::reference_step_m`].
    pub reference_steps_per_m: f32,
}

impl Checked {
    /// Whether a code of the displacement's ADC is within [`Parameters::rail_codes`] of either end; one comparison.
    #[inline(always)]
    pub fn is_at_rail(&self, code: AdcCode) -> bool {
        u32::from(code.0).wrapping_sub(u32::from(self.open_codes.0)) >= u32::from(self.open_codes.1)
    }

    /// What the amplifier puts out where its monitor's ADC delivers `code`.
    #[inline(always)]
    pub fn monitor_v(&self, code: u16) -> f32 {
        (f32::from(code) - self.monitor_zero_code) * self.monitor_v_per_code
    }

    /// The code that the monitor's ADC would deliver for what the amplifier puts out: what a simulated amplifier needs.
    pub fn monitor_code(&self, amplifier_v: f32, board: &Converters) -> u16 {
        let last = ((1_u32 << board.monitor_bits.min(16)) - 1) as u16;
        // A float to integer conversion saturates, and makes 0 of NaN.
        ((amplifier_v / self.monitor_v_per_code + self.monitor_zero_code + 0.5) as u16).min(last)
    }
}

impl Converters {
    /// The Nucleo-G474RE with the chip's own converters.
    pub const NUCLEO_G474RE: Converters = Converters {
        adc_bits: CalibrationSettings::NUCLEO_G474RE.adc_bits,
        adc_full_scale_v: CalibrationSettings::NUCLEO_G474RE.adc_full_scale_v,
        monitor_bits: CalibrationSettings::NUCLEO_G474RE.adc_bits,
        monitor_full_scale_v: CalibrationSettings::NUCLEO_G474RE.adc_full_scale_v,
        dac_bits: CalibrationSettings::NUCLEO_G474RE.dac_bits,
        dac_full_scale_v: CalibrationSettings::NUCLEO_G474RE.dac_full_scale_v,
        dac_margin_v: CalibrationSettings::NUCLEO_G474RE.dac_margin_v,
        timer_hz: 170_000_000,
        // 50 kHz leaves the rest of the program half of the time; 2594 Hz is where the 16-bit timer ends.
        period_min_cycles: 3400,
        period_max_cycles: 65_536,
        // The ADC tracks its pin for 47.5 of its clocks, four cycles each, and holds it then.
        hold_cycles: 190,
        // 10 us.
        latch_cycles: 1700,
    };

    /// The same with external converters of 16 bits: an ADC of the ADS8860's kind, a DAC of the DAC8832's. The monitor stays on the chip.
    pub const EXTERNAL_16BIT: Converters = Converters {
        adc_bits: 16,
        // Chosen: both on one 5 V reference.
        adc_full_scale_v: 5.0,
        dac_bits: 16,
        dac_full_scale_v: 5.0,
        // Chosen: 1 % at either end for the output amplifier.
        dac_margin_v: 0.05,
        // Such an ADC holds at the very edge that starts it.
        hold_cycles: 0,
        ..Converters::NUCLEO_G474RE
    };

    /// Cycles from the ADC's trigger to the DAC's latch: the deadline of a sample.
    pub const fn deadline_cycles(&self) -> u32 {
        self.hold_cycles + self.latch_cycles
    }
}

impl Parameters {
    /// PI 1 (`controllers/pi1.toml`) at 20 kHz on a Nucleo-G474RE, until a host says otherwise.
    pub const NUCLEO_PI1: Parameters = Parameters {
        rate_hz: 20e3,
        kp_v_per_m: 8.5811e5,
        ki_v_per_m_s: 9.6755e8,
        feedforward_v_per_m: 530_737.8,
        drive_min_v: -90.0,
        drive_max_v: 90.0,
        slew_v_per_s: 4e5,
        reference_max_m: 100e-6,
        reference_rate_m_per_s: 0.2,
        reference_acceleration_m_per_s2: 200.0,
        trip_m: 120e-6,
        stop_time_s: 20e-6,
        adc_zero_v: CalibrationSettings::NUCLEO_G474RE.adc_zero_v,
        sensor_m_per_v: CalibrationSettings::NUCLEO_G474RE.sensor_m_per_v,
        amplifier_v_per_v: CalibrationSettings::NUCLEO_G474RE.amplifier_v_per_v,
        // Chosen: the amplifier's monitor output is scaled back to the DAC's own 0 to 3.3 V (docs/wiring.md).
        monitor_zero_v: 1.65,
        monitor_v_per_v: CalibrationSettings::NUCLEO_G474RE.amplifier_v_per_v,
        // Chosen: three quarters of what the slew limit allows in one sample, so that a slow amplifier is none but a stuck DAC
        // is one after 20 samples (1 ms) at the latest that it is needed.
        monitor_tolerance_v: 15.0,
        monitor_samples: 20,
        // Chosen: 8 codes of 4096 are 6.4 mV, where a broken or shorted wire ends; a stage is there from +-129.4 um on, beyond the trip.
        rail_codes: 8,
        overrun_limit: 3,
        link_timeout_s: 0.25,
    };

    /// PI 1 on a board with [`Converters::EXTERNAL_16BIT`]: +-130 um over the ADC's 5 V, +-90 V within the DAC's usable +-2.45 V.
    pub const EXTERNAL_PI1: Parameters = Parameters {
        adc_zero_v: 2.5,
        sensor_m_per_v: 260e-6 / 5.0,
        amplifier_v_per_v: 90.0 / 2.45,
        // 8 of 4096 codes are 128 of 65536.
        rail_codes: 128,
        ..Parameters::NUCLEO_PI1
    };

    /// The law's part of them.
    pub fn settings(&self) -> Settings {
        Settings {
            rate_hz: self.rate_hz,
            kp_v_per_m: self.kp_v_per_m,
            ki_v_per_m_s: self.ki_v_per_m_s,
            feedforward_v_per_m: self.feedforward_v_per_m,
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
            slew_v_per_s: self.slew_v_per_s,
            reference_max_m: self.reference_max_m,
            reference_rate_m_per_s: self.reference_rate_m_per_s,
            reference_acceleration_m_per_s2: self.reference_acceleration_m_per_s2,
            trip_m: self.trip_m,
            stop_time_s: self.stop_time_s,
        }
    }

    /// How long the way from a limit of the drive to 0 V takes at the most, seconds.
    pub fn way_to_zero_s(&self) -> f32 {
        let most_v = self.drive_min_v.abs().max(self.drive_max_v.abs());
        // The ramp is rounded up to whole samples, and a stop counts from the next one on.
        STEEPEST * most_v / self.slew_v_per_s + 2.0 / self.rate_hz
    }

    /// The same with another law.
    #[must_use]
    pub fn with_settings(self, settings: &Settings) -> Parameters {
        Parameters {
            rate_hz: settings.rate_hz,
            kp_v_per_m: settings.kp_v_per_m,
            ki_v_per_m_s: settings.ki_v_per_m_s,
            feedforward_v_per_m: settings.feedforward_v_per_m,
            drive_min_v: settings.drive_min_v,
            drive_max_v: settings.drive_max_v,
            slew_v_per_s: settings.slew_v_per_s,
            reference_max_m: settings.reference_max_m,
            reference_rate_m_per_s: settings.reference_rate_m_per_s,
            reference_acceleration_m_per_s2: settings.reference_acceleration_m_per_s2,
            trip_m: settings.trip_m,
            stop_time_s: settings.stop_time_s,
            ..self
        }
    }

    /// The calibration's part of them, with the board's own part.
    pub fn calibration(&self, board: &Converters) -> CalibrationSettings {
        CalibrationSettings {
            adc_bits: board.adc_bits,
            adc_full_scale_v: board.adc_full_scale_v,
            adc_zero_v: self.adc_zero_v,
            sensor_m_per_v: self.sensor_m_per_v,
            dac_bits: board.dac_bits,
            dac_full_scale_v: board.dac_full_scale_v,
            amplifier_v_per_v: self.amplifier_v_per_v,
            dac_margin_v: board.dac_margin_v,
        }
    }

    /// Checks the set as a whole for one board and builds what its control interrupt needs.
    ///
    /// # Errors
    ///
    /// [`ParameterError`], the first one found.
    pub fn check(&self, board: &Converters) -> Result<Checked, ParameterError> {
        let settings = self.settings();
        let law = Law::try_build(&settings)?;
        if settings.is_unlimited() {
            return Err(ParameterError::Unlimited);
        }
        let calibration = Calibration::try_build(&self.calibration(board))?;
        let period_cycles = self.period_cycles(board)?;
        let (low_v, high_v) = calibration.drive_span_v();
        // One code: a limit of 90 V may lie between the last usable code and the next.
        let slack_v = calibration.drive_v_per_code().abs();
        if self.drive_min_v < low_v - slack_v || self.drive_max_v > high_v + slack_v {
            return Err(ParameterError::BeyondSpan { low_v, high_v });
        }
        let least_v_per_s = STEEPEST * self.drive_max_v.max(-self.drive_min_v) / LONGEST_WAY_S;
        if self.slew_v_per_s < least_v_per_s {
            return Err(ParameterError::SlowToZero { least_v_per_s });
        }
        if calibration.is_at_rail(calibration.adc_code(self.trip_m), self.rail_codes)
            || calibration.is_at_rail(calibration.adc_code(-self.trip_m), self.rail_codes)
        {
            return Err(ParameterError::TripBeyondSensor);
        }
        let monitor_lsb_v = board.monitor_full_scale_v / (1_u32 << board.monitor_bits.min(16)) as f32;
        let monitor_v_per_code = self.monitor_v_per_v * monitor_lsb_v;
        let monitor_zero_code = self.monitor_zero_v / monitor_lsb_v;
        for (field, value) in [("monitor_v_per_v", monitor_v_per_code), ("monitor_zero_v", monitor_zero_code)] {
            if !value.is_finite() {
                return Err(SettingsError::NotFinite { field }.into());
            }
        }
        let positive = [
            ("monitor_v_per_v", monitor_v_per_code.abs()),
            ("monitor_tolerance_v", self.monitor_tolerance_v),
            ("monitor_samples", f32::from(self.monitor_samples)),
            ("overrun_limit", f32::from(self.overrun_limit)),
            ("link_timeout_s", self.link_timeout_s),
        ];
        for (field, value) in positive {
            // Infinity is never, of a tolerance and a timeout.
            if value.is_nan() || value <= 0.0 {
                return Err(ParameterError::NotPositive { field });
            }
        }
        Ok(Checked {
            law,
            calibration,
            period_cycles,
            monitor_v_per_code,
            monitor_zero_code,
            monitor_tolerance_v: self.monitor_tolerance_v,
            monitor_samples: self.monitor_samples,
            open_codes: calibration.open_codes(self.rail_codes),
            overrun_limit: self.overrun_limit,
            // The conversion saturates, so that infinity is never.
            link_timeout_samples: ((self.link_timeout_s * self.rate_hz) as u32).max(1),
            reference_steps_per_m: 1.0 / self.reference_step_m(board),
        })
    }

    /// One step of [`crate::Sample::reference`]: the sensor's range over 2^16.
    pub fn reference_step_m(&self, board: &Converters) -> f32 {
        (self.sensor_m_per_v * board.adc_full_scale_v).abs() / 65_536.0
    }

    /// Cycles between two samples; exact, or refused: a rounded rate would make the law's time step a lie.
    fn period_cycles(&self, board: &Converters) -> Result<u32, ParameterError> {
        let outside = || ParameterError::RateOutside {
            least_hz: board.timer_hz.div_ceil(board.period_max_cycles.max(1)),
            most_hz: board.timer_hz / board.period_min_cycles.max(1),
        };
        let whole_hz = self.rate_hz as u32;
        let cycles = board.timer_hz.checked_div(whole_hz).ok_or_else(outside)?;
        if !(board.period_min_cycles..=board.period_max_cycles).contains(&cycles) {
            return Err(outside());
        }
        if whole_hz as f32 != self.rate_hz || cycles * whole_hz != board.timer_hz {
            return Err(ParameterError::RateDoesNotDivide { rate_hz: self.rate_hz, timer_hz: board.timer_hz });
        }
        Ok(cycles)
    }
}
