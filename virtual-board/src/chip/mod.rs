//! The chip around the core: every register that the image may touch, and what happens at which cycle.
//!
//! Time is counted in cycles of the core's 170 MHz. [`Chip::advance`] does what is due, in order; [`Chip::event`] says what comes next.

pub mod converters;
pub mod external;
pub mod flash;
pub mod serial;
pub mod strict;
pub mod system;

use crate::bench::Bench;
use converters::{Adc, Dac, Pulse, Tim8};
use external::External;
use flash::Flash;
use serial::{Dma, Move, Usart};
use strict::{Access, Bank, unmodelled};
use system::{Clocked, Gpio, Iwdg, Rcc};

/// ENABLE is PB5, the stop chain's sense input PB4 (docs/wiring.md).
pub const ENABLE_PIN: u32 = 5;
/// See [`ENABLE_PIN`].
pub const STOP_PIN: u32 = 4;
const PORT_A: usize = 0;
const PORT_B: usize = 1;
const PORT_C: usize = 2;

/// Interrupt numbers (RM0440, vector table).
pub const IRQS: [u16; 5] = [11, 12, 18, 38, 46];
/// ADC1_2, the control interrupt with the chip's own converters.
const IRQ_ADC: u16 = 18;
/// TIM8_CC, the control interrupt with external ones.
const IRQ_TIM8_CC: u16 = 46;

/// RCC_CSR's flags.
const FLAG_IWDG: u32 = 1 << 29;
const FLAG_SOFTWARE: u32 = 1 << 28;
const FLAG_BOR: u32 = 1 << 27;
const FLAG_PIN: u32 = 1 << 26;

/// Why the chip is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// The supply sagged, memory stayed.
    BrownOut,
    /// The reset pin.
    Pin,
    /// SYSRESETREQ.
    Software,
    /// The independent watchdog.
    Watchdog,
}

/// One sample as the pins saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Cycle at which the ADC held its input.
    pub hold_cycle: u64,
    /// Displacement at that instant, in metres.
    pub displacement_m: f64,
    /// ADC code of the displacement.
    pub adc: u16,
    /// ADC code of the monitor.
    pub monitor: u16,
    /// Cycle at which the DAC was latched next.
    pub latch_cycle: u64,
    /// Code that was latched.
    pub dac: u16,
    /// The amplifier was on at the latch.
    pub is_enabled: bool,
}

/// All of it.
#[derive(Debug)]
pub struct Chip {
    /// Present cycle.
    pub now: u64,
    /// The first access that the models don't know.
    pub error: Option<strict::Unmodelled>,
    /// Clocks and reset flags.
    pub rcc: Rcc,
    /// Flash controller and second bank.
    pub flash: Flash,
    pwr: Bank,
    syscfg: Bank,
    dbgmcu: Bank,
    /// Ports A to G.
    pub gpio: [Gpio; 7],
    tim8: Tim8,
    /// Displacement and monitor.
    pub adc: [Adc; 2],
    adc_common: Bank,
    dac: Dac,
    /// Converters on SPI, on a board that has them.
    external: Option<External>,
    /// Where the DAC is stuck, if it is.
    pub stuck_dac: Option<u16>,
    /// The serial port and the line's other end.
    pub usart: Usart,
    dma: Dma,
    iwdg: Iwdg,
    nmi: bool,
    /// What the pins are joined to.
    pub bench: Bench,
    /// Samples so far, kept if [`Chip::keeps_rows`].
    pub rows: Vec<Row>,
    /// Whether rows are kept.
    pub keeps_rows: bool,
    present: Option<Row>,
    /// Samples and latches so far.
    pub samples: u64,
    /// Resets so far, with their cycle.
    pub resets: Vec<(u64, Reset)>,
    due_reset: Option<Reset>,
    enable_level: bool,
}

impl Chip {
    /// After power-on, joined to `bench`.
    pub fn new(bench: Bench) -> Chip {
        let mut chip = Chip {
            now: 0,
            error: None,
            rcc: Rcc::new(),
            flash: Flash::new(),
            pwr: system::pwr(),
            syscfg: system::syscfg(),
            dbgmcu: system::dbgmcu(),
            gpio: std::array::from_fn(Gpio::new),
            tim8: Tim8::new(),
            adc: [Adc::new("ADC1"), Adc::new("ADC2")],
            adc_common: converters::adc_common(),
            dac: Dac::new(),
            external: bench.has_external_converters().then(|| External::new(bench.mid_code())),
            stuck_dac: None,
            usart: Usart::new(),
            dma: Dma::new(),
            iwdg: Iwdg::new(),
            nmi: false,
            bench,
            rows: Vec::new(),
            keeps_rows: true,
            present: None,
            samples: 0,
            resets: Vec::new(),
            due_reset: None,
            enable_level: false,
        };
        chip.set_stop_chain(true);
        chip
    }

    /// Closes or opens the stop chain.
    pub fn set_stop_chain(&mut self, is_closed: bool) {
        self.gpio[PORT_B].driven |= 1 << STOP_PIN;
        self.gpio[PORT_B].outside = u32::from(is_closed) << STOP_PIN;
    }

    /// Resets everything but memory, flash and the outside.
    pub fn reset(&mut self, why: Reset) {
        let flag = match why {
            Reset::BrownOut => FLAG_BOR,
            Reset::Pin => 0,
            Reset::Software => FLAG_SOFTWARE,
            Reset::Watchdog => FLAG_IWDG,
        };
        self.resets.push((self.now, why));
        // Every reset pulls the pin low, too.
        self.rcc.reset(flag | FLAG_PIN);
        self.flash.reset();
        self.pwr.reset();
        self.syscfg.reset();
        self.dbgmcu.reset();
        self.gpio.iter_mut().for_each(Gpio::reset);
        self.tim8 = Tim8::new();
        let late = [self.adc[0].late_cycles, self.adc[1].late_cycles];
        self.adc = [Adc::new("ADC1"), Adc::new("ADC2")];
        self.adc[0].late_cycles = late[0];
        self.adc[1].late_cycles = late[1];
        self.adc_common.reset();
        self.dac = Dac::new();
        let now = self.now;
        self.external.iter_mut().for_each(|external| external.reset(now));
        self.usart.reset();
        self.dma = Dma::new();
        self.iwdg = Iwdg::new();
        self.nmi = false;
        self.present = None;
        self.enable_level = false;
        self.drive();
    }

    /// A reset that has become due and must reach the core, too.
    pub fn take_reset(&mut self) -> Option<Reset> {
        self.due_reset.take()
    }

    /// Asks for a reset.
    pub fn request_reset(&mut self, why: Reset) {
        self.due_reset = Some(why);
    }

    /// Raises the NMI if the crystal is watched.
    pub fn stop_crystal(&mut self) {
        if self.rcc.stop_crystal() {
            self.nmi = true;
        }
    }

    /// Whether the NMI was raised since the last call.
    pub fn take_nmi(&mut self) -> bool {
        std::mem::take(&mut self.nmi)
    }

    /// The interrupt lines, as [`IRQS`].
    pub fn lines(&self) -> [bool; 5] {
        [
            self.dma.interrupt(0),
            self.dma.interrupt(1),
            self.adc[0].interrupt() || self.adc[1].interrupt(),
            self.usart.interrupt(),
            self.tim8.interrupt(),
        ]
    }

    /// The number of the control interrupt.
    pub fn control_irq(&self) -> u16 {
        if self.external.is_some() { IRQ_TIM8_CC } else { IRQ_ADC }
    }

    /// The next cycle at which something happens by itself.
    pub fn event(&self) -> u64 {
        [
            self.tim8.event(),
            self.adc[0].event(),
            self.adc[1].event(),
            self.usart.event(),
            self.flash.event(),
            self.iwdg.expires,
            self.external.as_ref().and_then(External::event),
        ]
        .into_iter()
        .flatten()
        .min()
        .unwrap_or(u64::MAX)
    }

    /// Does everything that is due by [`Chip::now`], in its order. `memory` moves the DMA's bytes.
    pub fn advance(&mut self, memory: &dyn Memory) {
        loop {
            let at = self.event();
            if at > self.now {
                break;
            }
            self.step(at);
        }
        // A request of a byte takes a handful of cycles, which the byte's own hundreds hide.
        self.usart.advance(self.now);
        while let Some((channel, what)) = self.dma.next_move(self.usart.wants_rx_dma(), self.usart.wants_tx_dma()) {
            match what {
                Move::ToLine(address) => self.usart.give(self.now, memory.load(address)),
                Move::FromLine(address) => memory.store(address, self.usart.take(self.now)),
            }
            self.dma.moved(channel);
        }
    }

    /// What happens at cycle `at`.
    fn step(&mut self, at: u64) {
        if self.iwdg.expires.is_some_and(|expires| expires <= at) {
            self.iwdg.expires = None;
            self.due_reset = Some(Reset::Watchdog);
        }
        self.flash.advance(at);
        self.usart.advance(at);
        for number in 0..2 {
            if let Some(hold) = self.adc[number].hold_due(at) {
                let code = self.sample(number, hold);
                self.adc[number].hold(code);
            }
            self.adc[number].advance(at);
        }
        if let Some(external) = &mut self.external
            && let Err(error) = external.advance(at)
        {
            self.error.get_or_insert(error);
        }
        match self.tim8.advance(at) {
            Some((Pulse::Update, at)) => {
                self.start_external(at);
                for adc in &mut self.adc {
                    if let Err(error) = adc.trigger(at) {
                        self.error.get_or_insert(error);
                    }
                }
            }
            Some((Pulse::Compare, at)) => self.latch(at),
            Some((Pulse::Ready, _)) | None => {}
        }
    }

    /// What an ADC's pin holds at `hold`.
    fn sample(&mut self, number: usize, hold: u64) -> u32 {
        let channel = self.adc[number].channel();
        // PA0 is channel 1, PA1 channel 2 of both ADCs; a pin that is not in analog mode reads the digital level's volts.
        let expected = number as u32 + 1;
        if channel != expected || !self.gpio[PORT_A].is_analog(number as u32) {
            let what = format!("channel {channel} sampled, and channel {expected} on an analog pin is modelled");
            self.error.get_or_insert(strict::Unmodelled { register: format!("ADC{}_SQR1", number + 1), what });
            return 0;
        }
        if number == 0 {
            return u32::from(self.note_sample(hold));
        }
        u32::from(self.bench.monitor())
    }

    /// The edge that starts an external ADC.
    fn start_external(&mut self, at: u64) {
        if self.external.is_some() && self.has_timer_pins() {
            let code = self.note_sample(at);
            self.external.iter_mut().for_each(|external| external.hold(at, code));
        }
    }

    /// A sample is taken of the bench: its code.
    fn note_sample(&mut self, hold: u64) -> u16 {
        let (displacement_m, adc) = self.bench.displacement(hold);
        let monitor = self.bench.monitor();
        self.present =
            Some(Row { hold_cycle: hold, displacement_m, adc, monitor, latch_cycle: 0, dac: 0, is_enabled: false });
        adc
    }

    /// PC6 and PC8 are the timer's, and it drives them.
    fn has_timer_pins(&self) -> bool {
        let port = &self.gpio[PORT_C];
        self.tim8.drives_pins() && port.alternate(6) == Some(4) && port.alternate(8) == Some(4)
    }

    fn latch(&mut self, at: u64) {
        self.dac.trigger();
        if self.has_timer_pins() {
            self.external.iter_mut().for_each(External::latch);
        }
        self.bench.look_at_enable(at);
        self.drive();
        if let Some(mut row) = self.present.take() {
            row.latch_cycle = at;
            row.dac = self.output();
            row.is_enabled = self.bench.is_amplifier_on();
            self.samples += 1;
            if self.keeps_rows {
                self.rows.push(row);
            }
        }
    }

    /// The code at the DAC's pin; a pin that nobody drives is held at mid-code by its divider.
    pub fn output(&self) -> u16 {
        if let Some(external) = &self.external {
            return self.stuck_dac.unwrap_or(external.output());
        }
        let is_driven = self.gpio[PORT_A].is_analog(4);
        let code = self.dac.output().filter(|_| is_driven).map_or(1 << 11, |code| code as u16);
        self.stuck_dac.unwrap_or(code)
    }

    /// Converters on SPI, on a board that has them.
    pub fn external(&self) -> Option<&External> {
        self.external.as_ref()
    }

    fn drive(&mut self) {
        self.bench.drive(self.now, self.output());
    }

    /// Reads a word of a peripheral.
    pub fn read(&mut self, address: u32) -> Access<u32> {
        let (base, offset) = (address & !0x3ff, address & 0x3ff);
        if let Some(clock) = clock_of(address) {
            self.rcc.check_clock(clock)?;
        }
        match base {
            0x4000_3000 => self.iwdg.read(offset),
            0x4000_4400 => self.usart.read(self.now, offset),
            0x4000_7000 => self.pwr.read(offset),
            0x4000_3c00 => self.ports()?.spi3.read(offset),
            0x4001_3000 => self.ports()?.spi1.read(offset),
            0x4001_0000 => self.syscfg.read(offset),
            0x4001_3400 => self.tim8.read(self.now, offset),
            0x4002_0000 => self.dma.read(offset),
            0x4002_0800 => self.dma.mux().read(offset),
            0x4002_1000 => self.rcc.read(offset),
            0x4002_2000 => self.flash.read(offset),
            0x4800_0000..=0x4800_1800 => self.gpio[((base - 0x4800_0000) / 0x400) as usize].read(offset),
            0x5000_0000 => match offset {
                0x000..=0x0ff => self.adc[0].read(offset),
                0x100..=0x1ff => self.adc[1].read(offset - 0x100),
                _ => self.adc_common.read(offset - 0x300),
            },
            0x5000_0800 => self.dac.read(offset),
            0xe004_2000 => self.dbgmcu.read(offset),
            _ => unmodelled(format!("{address:#010x}"), "read, and no peripheral is modelled there"),
        }
    }

    /// Writes a word of a peripheral.
    pub fn write(&mut self, address: u32, value: u32) -> Access<()> {
        let (base, offset) = (address & !0x3ff, address & 0x3ff);
        if let Some(clock) = clock_of(address) {
            self.rcc.check_clock(clock)?;
        }
        let now = self.now;
        match base {
            0x4000_3000 => self.iwdg.write(now, offset, value),
            0x4000_4400 => self.usart.write(now, offset, value),
            0x4000_7000 => self.pwr.write(offset, value),
            0x4000_3c00 => self.ports()?.spi3.write(now, offset, value),
            0x4001_3000 => self.ports()?.spi1.write(now, offset, value),
            0x4001_0000 => self.syscfg.write(offset, value),
            0x4001_3400 => {
                let was_running = self.tim8.event().is_some();
                self.tim8.write(now, offset, value)?;
                // The pulse on channel 3 begins with the count, in the first period as in all others.
                if !was_running && self.tim8.event().is_some() {
                    self.start_external(now);
                }
                Ok(())
            }
            0x4002_0000 => self.dma.write(offset, value),
            0x4002_0800 => self.dma.mux().write(offset, value),
            0x4002_1000 => self.rcc.write(offset, value),
            0x4002_2000 => self.flash.write(now, offset, value),
            0x4800_0000..=0x4800_1800 => {
                let port = ((base - 0x4800_0000) / 0x400) as usize;
                self.gpio[port].write(offset, value)?;
                if port == PORT_B {
                    self.note_enable();
                }
                Ok(())
            }
            0x5000_0000 => match offset {
                0x000..=0x0ff => self.adc[0].write(now, offset, value),
                0x100..=0x1ff => self.adc[1].write(now, offset - 0x100, value),
                _ => self.adc_common.write(offset - 0x300, value),
            },
            0x5000_0800 => {
                self.dac.write(offset, value)?;
                self.drive();
                Ok(())
            }
            0xe004_2000 => self.dbgmcu.write(offset, value),
            _ => unmodelled(format!("{address:#010x}"), "written, and no peripheral is modelled there"),
        }
    }

    fn ports(&mut self) -> Access<&mut External> {
        match &mut self.external {
            Some(external) => Ok(external),
            None => unmodelled("SPI1, SPI3", "touched on a board without external converters"),
        }
    }

    /// Edges of ENABLE keep the monostable up.
    fn note_enable(&mut self) {
        let level = self.gpio[PORT_B].level(ENABLE_PIN);
        if level && !self.enable_level {
            self.bench.enable_edge(self.now);
        }
        self.enable_level = level;
    }

    /// Reads a word of the second flash bank.
    pub fn read_flash(&mut self, offset: u32) -> Access<u32> {
        let (word, is_torn) = self.flash.read_word(offset)?;
        self.nmi |= is_torn;
        Ok(word)
    }
}

/// What moves the DMA's bytes.
pub trait Memory {
    /// The byte at `address`.
    fn load(&self, address: u32) -> u8;
    /// Puts a byte at `address`.
    fn store(&self, address: u32, byte: u8);
}

/// The clock that an address needs; none for what is always on.
fn clock_of(address: u32) -> Option<Clocked> {
    Some(match address & !0x3ff {
        0x4000_4400 => Clocked::Usart2,
        0x4000_7000 => Clocked::Pwr,
        0x4001_0000 => Clocked::Syscfg,
        0x4001_3400 => Clocked::Tim8,
        0x4000_3c00 => Clocked::Spi3,
        0x4001_3000 => Clocked::Spi1,
        0x4002_0000 => Clocked::Dma1,
        0x4002_0800 => Clocked::Dmamux,
        0x4002_2000 => Clocked::Flash,
        base @ 0x4800_0000..=0x4800_1800 => Clocked::Gpio((base - 0x4800_0000) / 0x400),
        0x5000_0000 => Clocked::Adc,
        0x5000_0800 => Clocked::Dac,
        _ => return None,
    })
}
