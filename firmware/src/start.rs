//! The first steps of the image, in their order, and its supervisor.
//!
//! Watchdog before clock, so that a clock that hangs ends in a reset; DAC at the safe level before ENABLE can move; the control interrupt
//! last. After a watchdog or brown-out reset, with a clock that is not the crystal's, or with parameters that can't be read, the
//! board comes up disarmed with a latched fault.

use crate::control;
use crate::line::{Line, OnLine, OnRing};
use crate::link::{self, Desk, Facts};
use crate::shared;
use crate::store::{self, Found};
use crate::{Board, registers};
use control_core::FaultCode;
use core::mem::{self, MaybeUninit};
use core::sync::atomic::{Ordering, compiler_fence};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::interrupt::typelevel::{self, Binding};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, LsConfig, Pll, PllMul, PllPreDiv, PllRDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::{Peripherals, bind_interrupts, dma, interrupt, peripherals};
use wire::{Parameters, ResetCause};

bind_interrupts!(struct Interrupts {
    USART2 => OnLine;
    DMA1_CHANNEL1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_CHANNEL2 => OnRing;
});

// SAFETY: not called where this says it is, and not missed: embassy's handler serves its receivers and `flush`, and of its driver only
// `UartTx::write` is used, which waits for its DMA channel alone. Called, it would turn off what wakes `Line`.
unsafe impl Binding<typelevel::USART2, usart::InterruptHandler<peripherals::USART2>> for Interrupts {}
// SAFETY: as above; embassy never enables this channel, which is `Line`'s.
unsafe impl Binding<typelevel::DMA1_CHANNEL2, dma::InterruptHandler<peripherals::DMA1_CH2>> for Interrupts {}

/// Says that the program was running, through a reset: memory that no start-up code clears.
#[unsafe(link_section = ".uninit.mark")]
static MARK: shared::Lent<MaybeUninit<[u32; 2]>> = shared::Lent::new(MaybeUninit::uninit());
/// Running, and nothing to report.
const MARK_UP: [u32; 2] = [0x6879_7374, !0x6879_7374];
/// The crystal stopped; the program asked for a reset.
const MARK_CLOCK: [u32; 2] = [0x6379_7374, !0x6379_7374];

/// [`Board::make_safe`] of this board, for who has no time to ask; nothing before the converters are set up.
static MAKE_SAFE: shared::Lent<fn()> = shared::Lent::new(|| ());

fn make_safe() {
    // SAFETY: written once, before any interrupt is enabled; a function pointer is one word.
    let make_safe = unsafe { MAKE_SAFE.get().read_volatile() };
    make_safe();
    registers::write_enable(registers::ENABLE_LOW);
}

fn mark() -> [u32; 2] {
    // SAFETY: any bits are two words, and only the start and the NMI's last act touch them.
    unsafe { MARK.get().cast::<[u32; 2]>().read_volatile() }
}

fn set_mark(mark: [u32; 2]) {
    // SAFETY: as above.
    unsafe { MARK.get().cast::<[u32; 2]>().write_volatile(mark) };
}

/// Clock tree: crystal 24 MHz (or the inner 16 MHz, in fault) to 170 MHz.
fn clocks(is_crystal: bool) -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    let rcc = &mut config.rcc;
    // Only USB would need it.
    rcc.hsi48 = None;
    // No real-time clock; the watchdog's oscillator starts by itself.
    rcc.ls = LsConfig::off();
    if is_crystal {
        rcc.hse = Some(Hse { freq: Hertz(24_000_000), mode: HseMode::Oscillator });
        rcc.hsi = false;
    }
    let (source, prediv) =
        if is_crystal { (PllSource::HSE, PllPreDiv::DIV6) } else { (PllSource::HSI, PllPreDiv::DIV4) };
    // 4 MHz times 85 over 2.
    rcc.pll = Some(Pll { source, prediv, mul: PllMul::MUL85, divp: None, divq: None, divr: Some(PllRDiv::DIV2) });
    rcc.sys = Sysclk::PLL1_R;
    rcc.boost = true;
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV1;
    rcc.apb2_pre = APBPrescaler::DIV1;
    config.enable_debug_during_sleep = true;
    // Below the control interrupt's priority, where critical sections hold it back.
    config.bdma_interrupt_priority = interrupt::Priority::P6;
    config
}

/// Everything up to the running board.
pub fn run<B: Board>(spawner: Spawner) {
    registers::copy_control_path();
    let found_mark = mark();
    let reset = registers::reset_cause(found_mark == MARK_UP);
    registers::start_watchdog();
    let is_crystal = registers::does_crystal_start();
    let peripherals = embassy_stm32::init(clocks(is_crystal));
    if is_crystal {
        registers::watch_crystal();
    }
    registers::begin_pins();
    B::begin();
    // SAFETY: no interrupt that reads it is enabled yet; the NMI finds one of two functions.
    unsafe { MAKE_SAFE.get().write_volatile(B::make_safe) };

    let stored = store::load(B::NAME);
    let (parameters, checked, is_stored) = first_parameters::<B>(&stored);
    let fault = first_fault(reset, is_crystal && found_mark != MARK_CLOCK, is_stored);
    set_mark(MARK_UP);
    defmt::info!("{=str}: reset {=u8}, fault {=u8}", B::NAME, reset as u8, fault.map_or(0, FaultCode::number));

    let period_cycles = checked.period_cycles;
    control::begin(link::first_set(checked), fault);
    let facts = Facts { board: B::NAME, converters: B::CONVERTERS, reset };
    start_link(spawner, peripherals, facts, parameters);
    B::begin_timer(period_cycles);
    // What the interrupt works on is in memory before it can come.
    compiler_fence(Ordering::SeqCst);
    registers::begin_interrupts(B::INTERRUPT);
    registers::start_timer();
}

/// The stored set if it is one for this board, else the default; whether what was stored could be used (nothing stored can).
fn first_parameters<B: Board>(stored: &Found) -> (Parameters, wire::Checked, bool) {
    if let Found::Set(parameters) = stored
        && let Ok(checked) = parameters.check(&B::CONVERTERS)
    {
        return (*parameters, checked, true);
    }
    let is_fine = *stored == Found::Nothing;
    match B::PARAMETERS.check(&B::CONVERTERS) {
        Ok(checked) => (B::PARAMETERS, checked, is_fine),
        // A board file whose own defaults are wrong can't run; its tests on the host hold that there is none.
        Err(_) => panic!("the board's own parameters are refused"),
    }
}

fn first_fault(reset: ResetCause, is_clock_good: bool, is_stored: bool) -> Option<FaultCode> {
    match reset {
        _ if !is_clock_good => Some(FaultCode::Clock),
        // Before the reset, which `Status::reset` tells as well: that the numbers in force may be another sensor's, only the fault tells.
        _ if !is_stored => Some(FaultCode::ParameterStore),
        ResetCause::Watchdog => Some(FaultCode::WatchdogReset),
        ResetCause::BrownOut => Some(FaultCode::BrownOutReset),
        _ => None,
    }
}

fn start_link(spawner: Spawner, peripherals: Peripherals, facts: Facts, parameters: Parameters) {
    let mut config = usart::Config::default();
    config.baudrate = link::BAUD;
    let uart = Uart::new(
        peripherals.USART2,
        peripherals.PA3,
        peripherals.PA2,
        peripherals.DMA1_CH1,
        peripherals.DMA1_CH2,
        Interrupts,
        config,
    );
    let desk = Desk::new(facts, parameters);
    match uart {
        Ok(uart) => {
            let (sender, receiver) = uart.split();
            // Not dropped, so that the port stays on; nothing else uses it.
            mem::forget(receiver);
            match (link::receive(Line::begin(), desk), link::send(sender, facts), supervise()) {
                (Ok(receive), Ok(send), Ok(supervise)) => {
                    spawner.spawn(receive);
                    spawner.spawn(send);
                    spawner.spawn(supervise);
                }
                _ => panic!("a task was started twice"),
            }
        }
        Err(_) => panic!("the baud rate can't be made from the clock"),
    }
}

/// Feeds the watchdog as long as samples come and tasks run: it is woken by the loop and scheduled by the executor.
#[embassy_executor::task]
async fn supervise() {
    let mut last = shared::SAMPLES.load(Ordering::Relaxed);
    loop {
        shared::ALIVE.wait().await;
        let samples = shared::SAMPLES.load(Ordering::Relaxed);
        if samples != last {
            last = samples;
            registers::feed_watchdog();
        }
    }
}

/// Safe level at once, ENABLE low, then wait for the watchdog: the board comes back with its fault latched.
fn stop_for_good() -> ! {
    make_safe();
    loop {
        compiler_fence(Ordering::SeqCst);
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    stop_for_good()
}

/// A crystal that stopped, or a flash word that can't be corrected.
#[unsafe(no_mangle)]
extern "C" fn NonMaskableInt() {
    if registers::has_crystal_stopped() {
        make_safe();
        set_mark(MARK_CLOCK);
        cortex_m::peripheral::SCB::sys_reset();
    }
    if registers::flash::take_double_error() && !store::note_torn() {
        // An instruction or a vector that may be another one.
        stop_for_good();
    }
}

/// Anything that no handler takes: as a panic.
#[unsafe(no_mangle)]
extern "C" fn HardFault() -> ! {
    cortex_m::interrupt::disable();
    stop_for_good()
}
