//! Converter codes, and every conversion between codes, volts and metres.
//!
//! | quantity | conversion |
//! | --- | --- |
//! | ADC code c to displacement | y = (c lsb - `adc_zero_v`) `sensor_m_per_v`, lsb = `adc_full_scale_v` / 2^bits |
//! | drive u to DAC code | c = mid + round(u / (`amplifier_v_per_v` lsb)), mid = 2^(bits - 1): mid-code is 0 V at the actuator |
//!
//! Both directions exist, because a simulated board converts the other way round. Rounding is to the nearest code, halves away from
//! zero (measured from mid-code for the DAC); everything saturates; NaN becomes mid-code.
//! Nothing outside this file may turn such a code into volts or metres, or back. The amplifier's monitor, a guard of the board's own, is no part of it:
//! `wire::Checked` has its two conversions.

use crate::settings::{SettingsError, finite, finite_above_zero, finite_from_zero};

/// What an ADC delivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AdcCode(pub u16);

/// What a DAC is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DacCode(pub u16);

/// A board's converters, sensor and amplifier in physical units.
///
/// | field | meaning | unit |
/// | --- | --- | --- |
/// | `adc_bits`, `dac_bits` | width, 12 to 16 | bit |
/// | `adc_full_scale_v`, `dac_full_scale_v` | volts of code 2^bits (one beyond the last) | V |
/// | `adc_zero_v` | volts at the ADC pin at zero displacement | V |
/// | `sensor_m_per_v` | displacement per volt at the ADC pin; negative if the sensor inverts | m/V |
/// | `amplifier_v_per_v` | actuator volts per DAC volt; negative if the amplifier inverts | - |
/// | `dac_margin_v` | not used at either end of the DAC, where its buffer can't reach | V |
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the table above describes every field")]
pub struct CalibrationSettings {
    pub adc_bits: u8,
    pub adc_full_scale_v: f32,
    pub adc_zero_v: f32,
    pub sensor_m_per_v: f32,
    pub dac_bits: u8,
    pub dac_full_scale_v: f32,
    pub amplifier_v_per_v: f32,
    pub dac_margin_v: f32,
}

impl CalibrationSettings {
    /// The STM32G474's own converters on a Nucleo board, with a sensor of +-130 um and an amplifier of +-90 V over the usable span.
    pub const NUCLEO_G474RE: CalibrationSettings = CalibrationSettings {
        adc_bits: 12,
        // STM32G474 datasheet DS12288, ADC accuracy: 1 LSB = VREF+ / 4096; VREF+ = VDDA = 3.3 V on the Nucleo-64 board.
        adc_full_scale_v: 3.3,
        // Chosen: the sensor's conditioning puts zero displacement at half scale.
        adc_zero_v: 1.65,
        // Chosen: +-130 um over the full 3.3 V, 8 % beyond the 120 um trip, so that a trip is not a rail.
        sensor_m_per_v: 260e-6 / 3.3,
        dac_bits: 12,
        // STM32G4 reference manual RM0440, "DAC output voltage": VREF+ times DOR / 4096.
        dac_full_scale_v: 3.3,
        // Chosen: +-90 V, the assumed range of the actuator, over the usable +-1.45 V.
        amplifier_v_per_v: 90.0 / 1.45,
        // DS12288, DAC characteristics: with the buffer on the output reaches 0.2 V to VREF+ - 0.2 V.
        dac_margin_v: 0.2,
    };
}

/// The conversions of one board, ready to run. Immutable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    adc_last_code: i32,
    adc_zero_code: f32,
    displacement_m_per_code: f32,
    code_per_displacement_m: f32,
    dac_mid_code: i32,
    /// Usable codes, relative to mid-code.
    dac_lowest: i32,
    dac_highest: i32,
    drive_v_per_code: f32,
    code_per_drive_v: f32,
}

impl Calibration {
    /// Checks the settings and computes the factors.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] names the first field that can't be used.
    pub fn try_build(settings: &CalibrationSettings) -> Result<Calibration, SettingsError> {
        let adc_codes = codes("adc_bits", settings.adc_bits)?;
        let dac_codes = codes("dac_bits", settings.dac_bits)?;
        finite_above_zero("adc_full_scale_v", settings.adc_full_scale_v)?;
        finite_above_zero("dac_full_scale_v", settings.dac_full_scale_v)?;
        finite("adc_zero_v", settings.adc_zero_v)?;
        finite_from_zero("dac_margin_v", settings.dac_margin_v)?;
        finite("sensor_m_per_v", settings.sensor_m_per_v)?;
        finite("amplifier_v_per_v", settings.amplifier_v_per_v)?;
        let adc_lsb_v = settings.adc_full_scale_v / adc_codes as f32;
        let dac_lsb_v = settings.dac_full_scale_v / dac_codes as f32;
        let displacement_m_per_code = settings.sensor_m_per_v * adc_lsb_v;
        let drive_v_per_code = settings.amplifier_v_per_v * dac_lsb_v;
        let code_per_displacement_m = 1.0 / displacement_m_per_code;
        let code_per_drive_v = 1.0 / drive_v_per_code;
        // A gain of zero, or one too small or too large for f32, would make a factor infinite or zero.
        finite_above_zero("sensor_m_per_v", code_per_displacement_m.abs())?;
        finite_above_zero("amplifier_v_per_v", code_per_drive_v.abs())?;
        let adc_zero_code = settings.adc_zero_v / adc_lsb_v;
        // Every code that a wire can carry must stand for a number, those beyond the converters' bits as well.
        for code in [0.0, f32::from(u16::MAX)] {
            finite("adc_zero_v", (code - adc_zero_code) * displacement_m_per_code)?;
            finite("amplifier_v_per_v", code * drive_v_per_code)?;
        }
        let margin = settings.dac_margin_v / dac_lsb_v;
        let dac_mid_code = dac_codes / 2;
        // Before the conversion, which saturates: one more would overflow then.
        if margin > (dac_mid_code - 1) as f32 {
            return Err(SettingsError::TooLarge {
                field: "dac_margin_v",
                at_most: (settings.dac_full_scale_v / 2.0) as u32,
            });
        }
        // Codes at or inside the margin: rounded up at the bottom, down at the top.
        let unused = margin as i32 + i32::from(margin as i32 as f32 != margin);
        let last = (dac_codes as f32 - margin) as i32;
        Ok(Calibration {
            adc_last_code: adc_codes - 1,
            adc_zero_code,
            displacement_m_per_code,
            code_per_displacement_m,
            dac_mid_code,
            dac_lowest: unused - dac_mid_code,
            dac_highest: last.min(dac_codes - 1) - dac_mid_code,
            drive_v_per_code,
            code_per_drive_v,
        })
    }

    /// The displacement that a code stands for, in metres.
    #[inline]
    pub fn displacement_m(&self, code: AdcCode) -> f32 {
        (f32::from(code.0) - self.adc_zero_code) * self.displacement_m_per_code
    }

    /// The code that the ADC of this board would deliver for a displacement: what a simulated sensor needs.
    pub fn adc_code(&self, displacement_m: f32) -> AdcCode {
        if displacement_m.is_nan() {
            return AdcCode(((self.adc_last_code + 1) / 2) as u16);
        }
        let code = nearest(displacement_m * self.code_per_displacement_m + self.adc_zero_code);
        AdcCode(code.clamp(0, self.adc_last_code) as u16)
    }

    /// Whether a code is within `margin` codes of either end: a broken or shorted sensor wire.
    #[inline]
    pub fn is_at_rail(&self, code: AdcCode, margin: u16) -> bool {
        let (code, margin) = (i32::from(code.0), i32::from(margin));
        code <= margin || code >= self.adc_last_code - margin
    }

    /// The lowest code that [`Calibration::is_at_rail`] denies, and how many there are from it on.
    pub fn open_codes(&self, margin: u16) -> (u16, u16) {
        let count = self.adc_last_code - 1 - 2 * i32::from(margin);
        (margin.saturating_add(1), count.max(0) as u16)
    }

    /// The code for a drive in volts at the actuator, saturating at the usable span; NaN gives mid-code, the safe level.
    #[inline]
    pub fn dac_code(&self, drive_v: f32) -> DacCode {
        // A float to integer conversion saturates, and makes 0 of NaN.
        let from_mid = nearest(drive_v * self.code_per_drive_v);
        let usable = if from_mid < self.dac_lowest {
            self.dac_lowest
        } else if from_mid > self.dac_highest {
            self.dac_highest
        } else {
            from_mid
        };
        DacCode((usable + self.dac_mid_code) as u16)
    }

    /// The volts at the actuator that a code makes.
    #[inline]
    pub fn drive_v(&self, code: DacCode) -> f32 {
        (i32::from(code.0) - self.dac_mid_code) as f32 * self.drive_v_per_code
    }

    /// The code of the safe level, 0 V at the actuator.
    pub fn safe_code(&self) -> DacCode {
        DacCode(self.dac_mid_code as u16)
    }

    /// Displacement per ADC code; negative if the sensor inverts.
    pub fn displacement_m_per_code(&self) -> f32 {
        self.displacement_m_per_code
    }

    /// Drive per DAC code; negative if the amplifier inverts.
    pub fn drive_v_per_code(&self) -> f32 {
        self.drive_v_per_code
    }

    /// The lowest and the highest drive that the usable codes make, in volts.
    pub fn drive_span_v(&self) -> (f32, f32) {
        let a = self.dac_lowest as f32 * self.drive_v_per_code;
        let b = self.dac_highest as f32 * self.drive_v_per_code;
        if a < b { (a, b) } else { (b, a) }
    }
}

/// 2^bits, for the widths that fit a code.
fn codes(field: &'static str, bits: u8) -> Result<i32, SettingsError> {
    match bits {
        12..=16 => Ok(1 << bits),
        17.. => Err(SettingsError::TooLarge { field, at_most: 16 }),
        _ => Err(SettingsError::TooSmall { field, at_least: 12 }),
    }
}

/// Nearest integer, halves away from zero; saturates; NaN gives 0.
///
/// Adding 1/2 can round up a fraction of 0.5 - 2^-25: 3e-8 of a code, of no account.
#[inline(always)]
fn nearest(x: f32) -> i32 {
    let half = if x < 0.0 { -0.5 } else { 0.5 };
    (x + half) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boards() -> [CalibrationSettings; 3] {
        let nucleo = CalibrationSettings::NUCLEO_G474RE;
        let external = CalibrationSettings {
            adc_bits: 16,
            adc_full_scale_v: 20.0,
            adc_zero_v: 10.0,
            sensor_m_per_v: 13e-6,
            dac_bits: 16,
            dac_full_scale_v: 20.0,
            amplifier_v_per_v: 9.0,
            dac_margin_v: 0.0,
        };
        let inverting = CalibrationSettings { sensor_m_per_v: -13e-6, amplifier_v_per_v: -9.0, ..external };
        [nucleo, external, inverting]
    }

    fn build(settings: &CalibrationSettings) -> Calibration {
        Calibration::try_build(settings).expect("sound settings")
    }

    #[test]
    fn every_code_survives_the_round_trip() {
        for settings in boards() {
            let calibration = build(&settings);
            for code in 0..1_u32 << settings.adc_bits {
                let code = AdcCode(code as u16);
                assert_eq!(calibration.adc_code(calibration.displacement_m(code)), code);
            }
            for relative in calibration.dac_lowest..=calibration.dac_highest {
                let code = DacCode((relative + calibration.dac_mid_code) as u16);
                assert_eq!(calibration.dac_code(calibration.drive_v(code)), code);
            }
        }
    }

    #[test]
    fn nothing_leaves_the_usable_span_and_nan_is_the_safe_level() {
        for settings in boards() {
            let calibration = build(&settings);
            let safe = calibration.safe_code();
            assert_eq!(calibration.dac_code(0.0), safe);
            assert_eq!(calibration.dac_code(f32::NAN), safe);
            assert_eq!(calibration.drive_v(safe), 0.0);
            let mid = 1 << (settings.adc_bits - 1);
            assert_eq!(calibration.adc_code(f32::NAN), AdcCode(mid));
            let (low_v, high_v) = calibration.drive_span_v();
            for drive_v in [f32::INFINITY, f32::MAX, 1e3, high_v] {
                assert_eq!(calibration.drive_v(calibration.dac_code(drive_v)), high_v);
            }
            for drive_v in [f32::NEG_INFINITY, f32::MIN, -1e3, low_v] {
                assert_eq!(calibration.drive_v(calibration.dac_code(drive_v)), low_v);
            }
        }
        // 0.2 V are 248.24 codes: 249 is the first inside, 4096 - 248.24 = 3847.76 makes 3847 the last.
        let nucleo = build(&CalibrationSettings::NUCLEO_G474RE);
        assert_eq!(nucleo.dac_code(-1e3), DacCode(249));
        assert_eq!(nucleo.dac_code(1e3), DacCode(3847));
    }

    #[test]
    fn the_nucleo_resolves_63_nanometres() {
        let nucleo = build(&CalibrationSettings::NUCLEO_G474RE);
        // 260 um / 4096 = 63.48 nm.
        assert!((nucleo.displacement_m_per_code() - 63.48e-9).abs() < 0.01e-9);
        assert!(nucleo.displacement_m(AdcCode(2048)).abs() < 1e-12);
    }

    #[test]
    fn rounding_is_to_the_nearest_code_and_halves_go_away_from_zero() {
        for (x, code) in [(0.49, 0), (0.5, 1), (-0.5, -1), (-0.49, 0), (1.5, 2), (2.5, 3), (-2.5, -3), (1e30, i32::MAX)]
        {
            assert_eq!(nearest(x), code, "{x}");
        }
    }

    #[test]
    fn rails_are_seen_at_both_ends() {
        let nucleo = build(&CalibrationSettings::NUCLEO_G474RE);
        for (code, at_rail) in
            [(0, true), (8, true), (9, false), (2048, false), (4086, false), (4087, true), (4095, true)]
        {
            assert_eq!(nucleo.is_at_rail(AdcCode(code), 8), at_rail, "{code}");
        }
        for margin in [0, 1, 8, 2046, 2047, 2048, u16::MAX] {
            let (first, count) = nucleo.open_codes(margin);
            for code in 0..4096 {
                let is_open = code >= first && code - first < count;
                assert_eq!(is_open, !nucleo.is_at_rail(AdcCode(code), margin), "{code}, {margin}");
            }
        }
    }

    #[test]
    fn wrong_settings_are_named() {
        let good = CalibrationSettings::NUCLEO_G474RE;
        let cases = [
            (CalibrationSettings { adc_bits: 17, ..good }, SettingsError::TooLarge { field: "adc_bits", at_most: 16 }),
            (CalibrationSettings { dac_bits: 0, ..good }, SettingsError::TooSmall { field: "dac_bits", at_least: 12 }),
            (CalibrationSettings { sensor_m_per_v: 0.0, ..good }, SettingsError::NotFinite { field: "sensor_m_per_v" }),
            (
                CalibrationSettings { amplifier_v_per_v: f32::NAN, ..good },
                SettingsError::NotFinite { field: "amplifier_v_per_v" },
            ),
            // The factors of these are finite; what the codes at the ends stand for is not.
            (
                CalibrationSettings { dac_full_scale_v: f32::MAX, ..good },
                SettingsError::NotFinite { field: "amplifier_v_per_v" },
            ),
            (CalibrationSettings { adc_zero_v: f32::MAX, ..good }, SettingsError::NotFinite { field: "adc_zero_v" }),
        ];
        let margin = SettingsError::TooLarge { field: "dac_margin_v", at_most: 1 };
        // 1.65 V are mid-code; the others are more codes than an integer holds, and than a number does.
        let margins_v = [1.65, 1.7, 1e9, f32::MAX];
        let cases = cases
            .into_iter()
            .chain(margins_v.map(|dac_margin_v| (CalibrationSettings { dac_margin_v, ..good }, margin)));
        for (settings, error) in cases {
            assert_eq!(Calibration::try_build(&settings), Err(error));
        }
    }
}
