//! Registers of external 16-bit converters on SPI: an ADC that starts at an edge (ADS8860's kind) and a DAC with a latch pin (DAC8832's).
//!
//! TIM8 makes both edges in hardware: CH3 (PC8) is the ADC's CONVST, high for 0.8 us from the update on, low it selects the ADC; CH1 (PC6) is the
//! DAC's LDAC, a low pulse of 0.2 us at the latch. A longer one would let a late code through. SPI1 reads (PA5, PA6), SPI3 writes (PC10, PC12, PA15
//! selects). Compare 4 is the control interrupt, once the conversion is over.

use embassy_stm32::pac;
use pac::spi::vals::{Bidimode, Bidioe, Br, Cpha, Ds, Frxth, Mstr};
use pac::timer::vals::{Mms, Mms2, Ocm};

/// Cycles of CONVST's pulse: 0.8 us, longer than the 0.71 us that such an ADC converts for.
const CONVERT_CYCLES: u16 = 136;
/// Cycles of LDAC's pulse: 0.2 us.
const LATCH_PULSE_CYCLES: u32 = 34;
/// Cycles of 16 bits at 42.5 MHz, and some for chip select.
pub const TRANSFER_CYCLES: u32 = 80;
/// Turns of the wait for 16 bits, several times what they take; a bus that hangs reads as a sensor at its rail.
const WAIT_TURNS: u32 = 100;
/// SPI_SR: FTLVL, a word that has not begun, and BSY, one on its way.
const UNDER_WAY: u32 = 0x1880;

/// Pins, both ports, and the DAC's input register at `mid`.
pub fn begin(mid: u16) {
    pac::RCC.ahb2enr().modify(|w| w.set_gpiocen(true));
    pac::RCC.apb2enr().modify(|w| w.set_spi1en(true));
    pac::RCC.apb1enr1().modify(|w| w.set_spi3en(true));
    use pac::gpio::vals::{Moder, Ospeedr};
    let pins = [
        (pac::GPIOA, 5, 5),
        (pac::GPIOA, 6, 5),
        (pac::GPIOA, 15, 6),
        (pac::GPIOC, 10, 6),
        (pac::GPIOC, 12, 6),
        (pac::GPIOC, 6, 4),
        (pac::GPIOC, 8, 4),
    ];
    for (port, pin, function) in pins {
        port.ospeedr().modify(|w| w.set_ospeedr(pin, Ospeedr::VERY_HIGH_SPEED));
        port.afr(pin / 8).modify(|w| w.set_afr(pin % 8, function));
        port.moder().modify(|w| w.set_moder(pin, Moder::ALTERNATE));
    }
    // 170 MHz / 4, 23.5 ns. The ADC is selected by CONVST, which puts the MSB out, so SPI1 needs no select of its own. A falling edge puts the next
    // bit out 3 to 13.4 ns later (TI SBAS569B, th-CK-DO and td-CK-DO): the rising one, after 11.8 ns, is too early for it. The second edge is
    // the falling one, a whole period later, which takes a bit and puts the next one out: those 3 ns and the way there and back are the hold time.
    pac::SPI1.cr2().write(|w| {
        w.set_ds(Ds::BITS16);
        w.set_frxth(Frxth::HALF);
    });
    pac::SPI1.cr1().write(|w| {
        w.set_cpha(Cpha::SECOND_EDGE);
        w.set_mstr(Mstr::MASTER);
        w.set_br(Br::DIV4);
        w.set_ssm(true);
        w.set_ssi(true);
    });
    pac::SPI1.cr1().modify(|w| w.set_spe(true));
    // Only sends; the select pulses between words.
    pac::SPI3.cr2().write(|w| {
        w.set_ds(Ds::BITS16);
        w.set_ssoe(true);
        w.set_nssp(true);
    });
    pac::SPI3.cr1().write(|w| {
        w.set_mstr(Mstr::MASTER);
        w.set_br(Br::DIV4);
        w.set_bidimode(Bidimode::BIDIRECTIONAL);
        w.set_bidioe(Bidioe::TRANSMIT);
    });
    pac::SPI3.cr1().modify(|w| w.set_spe(true));
    put(mid);
}

/// TIM8's four compares; it does not run yet.
pub fn begin_timer(period_cycles: u32, latch_cycles: u32) {
    let timer = pac::TIM8;
    timer.psc().write_value(0);
    timer.arr().write(|w| w.set_arr((period_cycles - 1) as u16));
    timer.ccr(0).write(|w| w.set_ccr(latch_cycles as u16));
    timer.ccr(1).write(|w| w.set_ccr((latch_cycles + LATCH_PULSE_CYCLES) as u16));
    timer.ccr(2).write(|w| w.set_ccr(CONVERT_CYCLES));
    timer.ccr(3).write(|w| w.set_ccr(CONVERT_CYCLES));
    // Channel 1: from compare 1 on and up to compare 2. Channel 3: up to compare 3.
    timer.ccmr_output(0).write(|w| {
        w.set_ocm(0, Ocm::COMBINED_PWM_MODE_2);
        w.set_ocm(1, Ocm::PWM_MODE1);
    });
    timer.ccmr_output(1).write(|w| w.set_ocm(0, Ocm::PWM_MODE1));
    // LDAC is active low.
    timer.ccer().write(|w| {
        w.set_cce(0, true);
        w.set_ccp(0, true);
        w.set_cce(2, true);
    });
    timer.cr2().write(|w| {
        w.set_mms(Mms::COMPARE_OC1);
        w.set_mms2(Mms2::UPDATE);
    });
    timer.dier().write(|w| w.set_ccie(3, true));
    timer.cr1().write(|w| {
        w.set_arpe(true);
        w.set_uifremap(true);
    });
    timer.egr().write(|w| w.set_ug(true));
    timer.sr().write_value(pac::timer::regs::SrAdv(0));
    timer.bdtr().write(|w| w.set_moe(true));
}

/// The sample that has just been converted. Waits for 16 bits, 64 cycles: shorter than an interrupt of their own would take.
#[inline(always)]
pub fn take() -> u16 {
    // Update and compare 4; the others have no use.
    pac::TIM8.sr().write_value(pac::timer::regs::SrAdv(0));
    pac::SPI1.dr16().write_value(0);
    for _ in 0..WAIT_TURNS {
        if pac::SPI1.sr().read().rxne() {
            return pac::SPI1.dr16().read();
        }
    }
    u16::MAX
}

/// The next drive, on its way.
#[inline(always)]
pub fn put(code: u16) {
    pac::SPI3.dr16().write_value(code);
}

/// Another code in place of the one on its way, once that is through. Only a late sample waits for it, when its latch is over.
#[inline(always)]
pub fn put_back(code: u16) {
    for _ in 0..WAIT_TURNS {
        if !pac::SPI3.sr().read().bsy() {
            break;
        }
    }
    put(code);
}

/// `code`, after what is on its way, and back when it is out: a reset in the middle of a word would leave a torn one in the DAC's input register.
pub fn put_out(code: u16) {
    wait_until_out();
    put(code);
    wait_until_out();
}

fn wait_until_out() {
    for _ in 0..WAIT_TURNS {
        if pac::SPI3.sr().read().0 & UNDER_WAY == 0 {
            break;
        }
    }
}
