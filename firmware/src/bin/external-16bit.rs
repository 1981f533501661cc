//! Nucleo-G474RE with external converters of 16 bits on SPI: 4 nm of 260 um where the chip's own 12 bits make 63 nm. Pins:
//! `src/external.rs`; the monitor stays on PA1, ENABLE and stop chain are those of `docs/wiring.md`.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use embassy_stm32::pac::Interrupt;
use firmware::{Board, Reading, control, external, registers, start};
use wire::{Converters, Parameters};

struct External;

/// 0 V at the actuator.
const MID: u16 = 1 << (External::CONVERTERS.dac_bits - 1);

impl Board for External {
    const NAME: &'static str = "external-16bit";
    const CONVERTERS: Converters = Converters::EXTERNAL_16BIT;
    const PARAMETERS: Parameters = Parameters::EXTERNAL_PI1;
    const PUT_CYCLES: u32 = external::TRANSFER_CYCLES;
    const INTERRUPT: Interrupt = Interrupt::TIM8_CC;

    fn begin() {
        external::begin(MID);
        registers::begin_monitor();
    }

    fn begin_timer(period_cycles: u32) {
        external::begin_timer(period_cycles, Self::CONVERTERS.deadline_cycles());
    }

    fn make_safe() {
        // Where the program only stops, the timer goes on and latches it. After a reset the DAC stands where it is, the amplifier off, until the
        // first latch; `begin` has put mid-code again by then.
        external::put_out(MID);
    }

    #[inline(always)]
    fn take() -> Reading {
        // One control interrupt that lasts beyond a whole period is seen by its late drive; nothing overwrites a sample on this bus.
        let displacement = external::take();
        Reading { displacement, monitor: registers::take_monitor(), is_one_lost: false }
    }

    #[inline(always)]
    fn put(code: u16) {
        external::put(code);
    }

    #[inline(always)]
    fn put_back(code: u16) {
        external::put_back(code);
    }

    // This DAC can't be read: a code that came within a transfer's time of its latch counts as late though it may be out.
    #[inline(always)]
    fn output() -> Option<u16> {
        None
    }
}

/// Compare 4 of the sampling timer: the conversion is over.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".ccmram.control.interrupt")]
extern "C" fn TIM8_CC() {
    // SAFETY: this is the control interrupt, and `start::run` enables it after `control::begin`.
    unsafe { control::on_sample::<External>() };
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    start::run::<External>(spawner);
}
