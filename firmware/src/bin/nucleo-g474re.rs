//! Nucleo-G474RE with the chip's own converters, 12 bits: PA0 displacement, PA1 amplifier monitor, PA4 drive. Pins, levels and what lies
//! between them and the actuator: `docs/wiring.md`.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use embassy_stm32::pac::Interrupt;
use firmware::{Board, Reading, control, registers, start};
use wire::{Converters, Parameters};

struct Nucleo;

impl Board for Nucleo {
    const NAME: &'static str = "nucleo-g474re";
    const CONVERTERS: Converters = Converters::NUCLEO_G474RE;
    const PARAMETERS: Parameters = Parameters::NUCLEO_PI1;

    // The DAC takes what stands in its register when the trigger comes.
    const PUT_CYCLES: u32 = 0;
    const INTERRUPT: Interrupt = Interrupt::ADC1_2;

    fn begin() {
        registers::begin_dac(1 << (Self::CONVERTERS.dac_bits - 1));
        registers::begin_adcs();
    }

    fn begin_timer(period_cycles: u32) {
        registers::begin_timer(period_cycles, Self::CONVERTERS.deadline_cycles());
    }

    fn make_safe() {
        registers::make_dac_safe(1 << (Self::CONVERTERS.dac_bits - 1));
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

    #[inline(always)]
    fn put_back(code: u16) {
        registers::put_dac(code);
    }

    #[inline(always)]
    fn output() -> Option<u16> {
        Some(registers::dac_output())
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
