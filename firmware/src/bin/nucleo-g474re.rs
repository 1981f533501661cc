//! Nucleo-G474RE with the chip's own converters, 12 bits: PA0 displacement, PA1 amplifier monitor, PA4 drive. Pins, levels and what lies
//! between them and the actuator: `docs/wiring.md`.
#![no_std]
#![no_main]

use control_core::CalibrationSettings;
use embassy_executor::Spawner;
use firmware::{Board, Reading, control, registers, start};
use wire::{Converters, Parameters};

struct Nucleo;

const CALIBRATION: CalibrationSettings = CalibrationSettings::NUCLEO_G474RE;

impl Board for Nucleo {
    const NAME: &'static str = "nucleo-g474re";
    const CONVERTERS: Converters = Converters {
        adc_bits: CALIBRATION.adc_bits,
        adc_full_scale_v: CALIBRATION.adc_full_scale_v,
        monitor_bits: CALIBRATION.adc_bits,
        monitor_full_scale_v: CALIBRATION.adc_full_scale_v,
        dac_bits: CALIBRATION.dac_bits,
        dac_full_scale_v: CALIBRATION.dac_full_scale_v,
        dac_margin_v: CALIBRATION.dac_margin_v,
        timer_hz: 170_000_000,
        // 50 kHz leaves the rest of the program half of the time; 2594 Hz is where the 16-bit timer ends.
        period_min_cycles: 3400,
        period_max_cycles: 65_536,
        // The ADC tracks its pin for 47.5 of its clocks, four cycles each, and holds it then.
        hold_cycles: 190,
        // 10 us.
        latch_cycles: 1700,
    };
    const PARAMETERS: Parameters = Parameters::NUCLEO_PI1;

    fn begin() {
        registers::begin_dac(1 << (CALIBRATION.dac_bits - 1));
        registers::begin_adcs();
    }

    #[inline(always)]
    fn take() -> Reading {
        let (displacement, monitor, is_one_lost) = registers::take_adcs();
        Reading { displacement, monitor, is_one_lost }
    }

    #[inline(always)]
    fn put(code: u16) {
        registers::put_dac(code);
    }
}

/// End of conversion.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".ccmram.control.interrupt")]
extern "C" fn ADC1_2() {
    // SAFETY: this is the control interrupt, and `start::run` enables it after `control::begin`.
    unsafe { control::on_sample::<Nucleo>() };
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    start::run::<Nucleo>(spawner);
}
