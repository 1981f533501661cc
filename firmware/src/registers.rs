//! Every register that embassy has no driver for, or whose driver would wait, divide or mask interrupts: here and nowhere else.
//!
//! metapac's accessors are safe functions. What is `unsafe` here says why it is right. Bit meanings: ST manual RM0440.

use cortex_m::peripheral::NVIC;
use embassy_stm32::pac;
use embassy_stm32::pac::Interrupt;
use pac::adc::vals::{Exten, Ovrmod, SampleTime};
use pac::adccommon::vals::Ckmode;
use pac::timer::vals::{Mms, Mms2, Ocm};
use wire::ResetCause;

/// ENABLE is PB5 (Arduino D4), the stop chain's sense input PB4 (D5).
const ENABLE_PIN: usize = 5;
const STOP_PIN: usize = 4;
/// TIM8_TRGO2 starts both ADCs (RM0440, ADC1/2 external triggers, EXTSEL 8).
const ADC_TRIGGER: u8 = 8;
/// TIM8_TRGO latches DAC1 (RM0440, DAC trigger interconnection, TSEL 1).
const DAC_TRIGGER: u8 = 1;

unsafe extern "C" {
    static mut __sccmram: u32;
    static mut __eccmram: u32;
    static __siccmram: u32;
}

/// Copies the control path from flash to CCM SRAM. To be called first of all.
pub fn copy_control_path() {
    let mut from = &raw const __siccmram;
    let mut to = &raw mut __sccmram;
    let end = &raw mut __eccmram;
    while to < end {
        // SAFETY: the linker map (memory.x) lays both areas out with equal length, and nothing runs in CCM SRAM yet. Volatile, so
        // that the compiler makes no call of it to a function that may lie there.
        unsafe {
            to.write_volatile(from.read_volatile());
            from = from.add(1);
            to = to.add(1);
        }
    }
}

/// Why the board started. Reads and clears the chip's flags. `was_up`: memory still knows that the program was running.
pub fn reset_cause(was_up: bool) -> ResetCause {
    let csr = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if csr.iwdgrstf() {
        ResetCause::Watchdog
    } else if csr.borrstf() {
        // The chip sets this flag at every power-on, too. A supply that only sagged leaves the memory as it was.
        if was_up { ResetCause::BrownOut } else { ResetCause::PowerOn }
    } else if csr.sftrstf() {
        ResetCause::Software
    } else if csr.pinrstf() {
        ResetCause::Pin
    } else {
        ResetCause::Other
    }
}

/// Starts the independent watchdog: 100 ms of its 32 kHz oscillator (which may be 10 % off), and no way to stop it but a reset.
pub fn start_watchdog() {
    use pac::iwdg::vals::{Key, Pr};
    pac::IWDG.kr().write(|w| w.set_key(Key::START));
    pac::IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    // 32 kHz / 4 = 8 kHz; 800 of them.
    pac::IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY4));
    pac::IWDG.rlr().write(|w| w.set_rl(800 - 1));
    // A debugger that halts the core shall not be cut off.
    pac::DBGMCU.apb1lfzr().modify(|w| w.set_iwdg(true));
    feed_watchdog();
}

/// Another 100 ms.
pub fn feed_watchdog() {
    pac::IWDG.kr().write(|w| w.set_key(pac::iwdg::vals::Key::RESET));
}

/// Turns the crystal on and waits for it, 10 ms at most (DS12288: 2 ms typical): false if it does not start.
pub fn does_crystal_start() -> bool {
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    // At 16 MHz, about 8 cycles a turn.
    for _ in 0..20_000 {
        if pac::RCC.cr().read().hserdy() {
            return true;
        }
    }
    pac::RCC.cr().modify(|w| w.set_hseon(false));
    false
}

/// From now on a crystal that stops raises the NMI.
pub fn watch_crystal() {
    pac::RCC.cr().modify(|w| w.set_csson(true));
}

/// Whether the NMI came because the crystal stopped.
pub fn has_crystal_stopped() -> bool {
    pac::RCC.cifr().read().cssf()
}

/// Clocks of what this file drives, and the two pins of the amplifier's chain.
pub fn begin_pins() {
    pac::RCC.ahb2enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_adc12en(true);
        w.set_dac1en(true);
    });
    pac::RCC.apb2enr().modify(|w| w.set_tim8en(true));
    use pac::gpio::vals::{Moder, Pupdr};
    // PA0, PA1 and PA4 are analog after reset and stay so. The sense input is pulled down: an open wire is a pressed stop.
    write_enable(ENABLE_LOW);
    pac::GPIOB.pupdr().modify(|w| {
        w.set_pupdr(STOP_PIN, Pupdr::PULL_DOWN);
        w.set_pupdr(ENABLE_PIN, Pupdr::PULL_DOWN);
    });
    pac::GPIOB.moder().modify(|w| {
        w.set_moder(STOP_PIN, Moder::INPUT);
        w.set_moder(ENABLE_PIN, Moder::OUTPUT);
    });
}

/// What [`write_enable`] takes: ENABLE low (the lower half of BSRR sets, the upper one clears), and what turns low to high and back.
pub const ENABLE_LOW: u32 = 1 << (ENABLE_PIN + 16);
/// See [`ENABLE_LOW`].
pub const ENABLE_TOGGLE: u32 = 1 << ENABLE_PIN | ENABLE_LOW;

/// ENABLE high or low.
#[inline(always)]
pub fn write_enable(bits: u32) {
    pac::GPIOB.bsrr().write_value(pac::gpio::regs::Bsrr(bits));
}

/// Whether the stop chain's sense input is high.
#[inline(always)]
pub fn is_stop_chain_closed() -> bool {
    pac::GPIOB.idr().read().0 & 1 << STOP_PIN != 0
}

/// DAC1 channel 1 on PA4: at `safe` at once, from then on latched by the timer.
pub fn begin_dac(safe: u16) {
    // The clock is above 160 MHz (RM0440, DAC_MCR, HFSEL); mode 0: buffer on, pin connected.
    pac::DAC1.mcr().write(|w| w.set_hfsel(2));
    // Without a trigger the code passes through within a cycle, so the pin goes from floating straight to the safe level.
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(safe));
    pac::DAC1.cr().write(|w| w.set_en(0, true));
    // DS12288: 8 us until the output is there. 170 MHz.
    cortex_m::asm::delay(10 * 170);
    pac::DAC1.cr().write(|w| {
        w.set_en(0, true);
        w.set_tsel(0, DAC_TRIGGER);
        w.set_ten(0, true);
    });
}

/// The next drive, for the timer to latch.
#[inline(always)]
pub fn put_dac(code: u16) {
    pac::DAC1.dhr12r(0).write_value(pac::dac::regs::Dhr12r(u32::from(code)));
}

/// The code that was latched last, which is there some cycles after its trigger (RM0440, "DAC conversion with trigger": three).
#[inline(always)]
pub fn dac_output() -> u16 {
    pac::DAC1.dor(0).read().0 as u16
}

/// ADC1 on PA0 (displacement) and ADC2 on PA1 (monitor), both started by the timer.
pub fn begin_adcs() {
    begin_adc_clock();
    begin_adc(pac::ADC1, 1);
    begin_adc(pac::ADC2, 2);
    pac::ADC1.ier().write(|w| w.set_eocie(true));
    pac::ADC1.cr().modify(|w| w.set_adstart(true));
    pac::ADC2.cr().modify(|w| w.set_adstart(true));
}

/// ADC2 alone on PA1, started by the timer: the monitor of a board whose displacement comes from elsewhere.
pub fn begin_monitor() {
    begin_adc_clock();
    begin_adc(pac::ADC2, 2);
    pac::ADC2.cr().modify(|w| w.set_adstart(true));
}

/// The last code of ADC2.
#[inline(always)]
pub fn take_monitor() -> u16 {
    pac::ADC2.dr().read().0 as u16
}

fn begin_adc_clock() {
    // 170 MHz / 4 = 42.5 MHz, below the 60 MHz that DS12288 allows; synchronous, so that a start is a fixed number of cycles away.
    pac::ADC12_COMMON.ccr().write(|w| w.set_ckmode(Ckmode::SYNC_DIV4));
}

fn begin_adc(adc: pac::adc::Adc, channel: usize) {
    adc.cr().write(|w| w.set_deeppwd(false));
    adc.cr().write(|w| w.set_advregen(true));
    // DS12288: the regulator is up after 20 us.
    cortex_m::asm::delay(20 * 170);
    adc.cr().modify(|w| w.set_adcal(true));
    while adc.cr().read().adcal() {}
    // RM0440: four ADC clocks between the end of calibration and ADEN; 16 cycles here.
    cortex_m::asm::delay(32);
    adc.isr().write(|w| w.set_adrdy(true));
    adc.cr().modify(|w| w.set_aden(true));
    while !adc.isr().read().adrdy() {}
    // 47.5 + 12.5 ADC clocks are 240 cycles, 1.41 us; sources up to 5 kOhm settle (DS12288, maximum R_AIN at 12 bits).
    adc.smpr().write(|w| w.set_smp(channel, SampleTime::CYCLES47_5));
    adc.sqr1().write(|w| w.set_sq(0, channel as u8));
    adc.cfgr().write(|w| {
        w.set_extsel(ADC_TRIGGER);
        w.set_exten(Exten::RISING_EDGE);
        w.set_ovrmod(Ovrmod::OVERWRITE);
        // Injected conversions are not used; their queue is off after reset, too.
        w.set_jqdis(true);
    });
}

/// Both codes, and whether ones before them were overwritten. Opens the timer's next period for [`count`].
#[inline(always)]
pub fn take_adcs() -> (u16, u16, bool) {
    let is_one_lost = pac::ADC1.isr().read().ovr();
    let displacement = pac::ADC1.dr().read().0 as u16;
    let monitor = pac::ADC2.dr().read().0 as u16;
    if is_one_lost {
        pac::ADC1.isr().write(|w| w.set_ovr(true));
    }
    // Written as 0 the update flag goes, as 1 the others stay.
    pac::TIM8.sr().write_value(pac::timer::regs::SrAdv(!1));
    (displacement, monitor, is_one_lost)
}

/// TIM8: an update each `period_cycles` starts the ADCs, a compare `latch_cycles` later latches the DAC. Does not run yet.
pub fn begin_timer(period_cycles: u32, latch_cycles: u32) {
    let timer = pac::TIM8;
    timer.psc().write_value(0);
    timer.arr().write(|w| w.set_arr((period_cycles - 1) as u16));
    timer.ccr(0).write(|w| w.set_ccr(latch_cycles as u16));
    // PWM mode 2: the reference rises when the count reaches the compare value, and only the DAC looks at it.
    timer.ccmr_output(0).write(|w| w.set_ocm(0, Ocm::PWM_MODE2));
    timer.cr2().write(|w| {
        w.set_mms(Mms::COMPARE_OC1);
        w.set_mms2(Mms2::UPDATE);
    });
    timer.cr1().write(|w| {
        // Another period holds from the next update on; the update flag can be read with the count.
        w.set_arpe(true);
        w.set_uifremap(true);
    });
    // Takes the values over; the flag it sets means nothing yet.
    timer.egr().write(|w| w.set_ug(true));
    timer.sr().write_value(pac::timer::regs::SrAdv(!1));
}

/// Lets TIM8 run.
pub fn start_timer() {
    pac::TIM8.cr1().modify(|w| w.set_cen(true));
}

/// Another sampling period, from the next update on.
#[inline(always)]
pub fn set_period(period_cycles: u32) {
    pac::TIM8.arr().write(|w| w.set_arr((period_cycles - 1) as u16));
}

/// Cycles since the ADC's trigger, with bit 31 set once the next period has begun: then it is greater than any deadline.
#[inline(always)]
pub fn count() -> u32 {
    pac::TIM8.cnt().read().0
}

/// The control interrupt at priority 0, where nothing masks it, everything else below.
pub fn begin_interrupts(control: Interrupt) {
    // SAFETY: the peripherals are only borrowed for NVIC's priority bytes, before any of these interrupts is enabled.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    for interrupt in [Interrupt::USART2, Interrupt::DMA1_CHANNEL1, Interrupt::DMA1_CHANNEL2] {
        // SAFETY: not masked by a critical section would be wrong for these; 6 is.
        unsafe { core.NVIC.set_priority(interrupt, 6 << 4) };
    }
    // SAFETY: as above.
    unsafe { core.NVIC.set_priority(Interrupt::CORDIC, 15 << 4) };
    // SAFETY: as above; 1 is the highest that a critical section holds back.
    unsafe { core.NVIC.set_priority(Interrupt::FMAC, 1 << 4) };
    // SAFETY: the handler of this one uses nothing that a critical section guards.
    unsafe { core.NVIC.set_priority(control, 0) };
    NVIC::unpend(control);
    // SAFETY: what the three handlers work on has been set up.
    unsafe {
        NVIC::unmask(Interrupt::CORDIC);
        NVIC::unmask(Interrupt::FMAC);
        NVIC::unmask(control);
    }
}

/// Lets the interrupt run that works between two samples.
#[inline(always)]
pub fn pend_between() {
    NVIC::pend(Interrupt::FMAC);
}

/// Lets the interrupt run that wakes the rest.
#[inline(always)]
pub fn pend_wake() {
    NVIC::pend(Interrupt::CORDIC);
}

/// The last act of a program that has lost its way: without its trigger the DAC takes mid-code at once.
pub fn make_dac_safe(mid: u16) {
    pac::DAC1.cr().write(|w| w.set_en(0, true));
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(mid));
}

/// Reception on the link's port. embassy sets the port up and owns what it sends.
pub mod line {
    use super::pac;

    /// The second channel: embassy's transmitter has the first.
    const CHANNEL: usize = 1;
    /// DMAMUX: USART2_RX.
    const REQUEST: u8 = 26;

    /// Lets the DMA write what comes to `bytes` bytes from `to` on, round and round, and the interrupts tell of it.
    pub fn begin(to: *mut u8, bytes: u16) {
        pac::DMAMUX1.ccr(CHANNEL).write(|w| w.set_dmareq_id(REQUEST));
        let channel = pac::DMA1.ch(CHANNEL);
        channel.par().write_value(pac::USART2.rdr().as_ptr() as u32);
        channel.mar().write_value(to as u32);
        channel.ndtr().write(|w| w.set_ndt(bytes));
        channel.cr().write(|w| {
            w.set_minc(true);
            w.set_circ(true);
            w.set_htie(true);
            w.set_tcie(true);
            w.set_teie(true);
            w.set_en(true);
        });
        pac::USART2.cr1().modify(|w| w.set_idleie(true));
        pac::USART2.cr3().modify(|w| {
            w.set_eie(true);
            w.set_dmar(true);
        });
    }

    /// Bytes that the DMA will write until it comes round.
    pub fn left() -> u16 {
        pac::DMA1.ch(CHANNEL).ndtr().read().ndt()
    }

    /// The DMA has come round and its interrupt has not been here.
    pub fn is_lap_due() -> bool {
        pac::DMA1.isr().read().tcif(CHANNEL)
    }

    /// Clears the channel's flags; whether the DMA has come round.
    pub fn take_lap() -> bool {
        let flags = pac::DMA1.isr().read();
        // A bus error stops the channel; its addresses never change, so the program has lost its way.
        assert!(!flags.teif(CHANNEL), "the receiver's DMA met an error");
        let is_lap = flags.tcif(CHANNEL);
        // Only what was seen, so that none is lost between the two lines.
        pac::DMA1.ifcr().write(|w| {
            w.set_htif(CHANNEL, flags.htif(CHANNEL));
            w.set_tcif(CHANNEL, is_lap);
        });
        is_lap
    }

    /// Clears the port's flags of silence and error; whether there was an error.
    pub fn take_errors() -> bool {
        let flags = pac::USART2.isr().read();
        pac::USART2.icr().write(|w| {
            w.set_pe(flags.pe());
            w.set_fe(flags.fe());
            w.set_ne(flags.ne());
            w.set_ore(flags.ore());
            w.set_idle(flags.idle());
        });
        flags.pe() || flags.fe() || flags.ne() || flags.ore()
    }
}

/// Writing and erasing the second flash bank.
pub mod flash {
    use super::pac;

    /// Whether a double word could not be corrected; cleared. The NMI calls it. Where it lies is not asked: of one that a reset or a power cut
    /// tore FLASH_ECCR may say something else (ES0430, FLASH_ECCR corrupted upon reset or power-down during program or erase).
    pub fn take_double_error() -> bool {
        let eccr = pac::FLASH.eccr().read();
        // Flags are cleared by writing 1. Those of corrected words, too: while one is up no other is set (RM0440, FLASH_ECCR).
        pac::FLASH.eccr().write(|w| {
            w.set_eccc(eccr.eccc());
            w.set_eccc2(eccr.eccc2());
            w.set_eccd(eccr.eccd());
            w.set_eccd2(eccr.eccd2());
        });
        eccr.eccd() || eccr.eccd2()
    }

    /// Waits until the reads before it are done and an NMI that one of them raised has been taken.
    pub fn settle() {
        // Behind them on the way to the flash's controller.
        let _ = pac::FLASH.eccr().read();
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
    }

    fn unlock() {
        if pac::FLASH.cr().read().lock() {
            pac::FLASH.keyr().write_value(0x4567_0123);
            pac::FLASH.keyr().write_value(0xcdef_89ab);
        }
    }

    fn wait() -> bool {
        while pac::FLASH.sr().read().bsy() {}
        let sr = pac::FLASH.sr().read();
        // All of them are cleared by writing 1.
        pac::FLASH.sr().write_value(sr);
        !(sr.progerr() || sr.wrperr() || sr.pgaerr() || sr.sizerr() || sr.pgserr() || sr.operr() || sr.miserr())
    }

    /// Erases a page of the second bank; the first one, where the program lies, can be read meanwhile.
    pub fn erase_second_bank_page(page: u8) -> bool {
        unlock();
        let _ = wait();
        // Modified and not written: OPTLOCK, which guards the option bytes, stays as it is.
        pac::FLASH.cr().modify(|w| {
            w.set_pg(false);
            w.set_per(true);
            w.set_bker(true);
            w.set_pnb(page);
        });
        pac::FLASH.cr().modify(|w| w.set_strt(true));
        let is_done = wait();
        close();
        is_done
    }

    /// Neither erase nor program until the next keys.
    fn close() {
        pac::FLASH.cr().modify(|w| {
            w.set_per(false);
            w.set_bker(false);
            w.set_pnb(0);
            w.set_pg(false);
            w.set_lock(true);
        });
    }

    /// Writes one double word.
    ///
    /// # Safety
    ///
    /// `address` is a multiple of 8 in the second bank, where no code lies.
    pub unsafe fn program(address: u32, low: u32, high: u32) -> bool {
        unlock();
        let _ = wait();
        pac::FLASH.cr().modify(|w| w.set_pg(true));
        // SAFETY: the caller's promise; the flash takes the two words as one.
        unsafe {
            (address as *mut u32).write_volatile(low);
            cortex_m::asm::isb();
            ((address + 4) as *mut u32).write_volatile(high);
        }
        let is_done = wait();
        close();
        is_done
    }

    /// Whether the flash is two banks, of which one can be read while the other is written.
    pub fn has_two_banks() -> bool {
        pac::FLASH.optr().read().dbank()
    }

    /// Nothing is read from the data cache any more.
    pub fn stop_data_cache() {
        pac::FLASH.acr().modify(|w| w.set_dcen(false));
    }

    /// The data cache again, without what it remembers of the flash, which a write does not tell it.
    pub fn start_data_cache() {
        pac::FLASH.acr().modify(|w| w.set_dcrst(true));
        pac::FLASH.acr().modify(|w| w.set_dcrst(false));
        pac::FLASH.acr().modify(|w| w.set_dcen(true));
    }
}
