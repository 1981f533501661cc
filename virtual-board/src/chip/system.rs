//! RCC, PWR, SYSCFG, DBGMCU, GPIO and IWDG: clocks, resets, pins, the watchdog.
//!
//! Not modelled: that the core runs slower before the PLL is chosen (time is counted in cycles of 170 MHz throughout), and how long
//! the oscillators take beyond their first ready bit.

use super::strict::{Access, Bank, Kept, unmodelled};

/// Cycles of the core's clock in one period of the watchdog's 32 kHz oscillator.
const LSI_CYCLES: f64 = 170e6 / 32e3;

/// Reset and clock control.
#[derive(Debug)]
pub struct Rcc {
    bank: Bank,
    /// The crystal answers.
    pub has_crystal: bool,
    /// CSR's reset flags, bits 23 to 31.
    flags: u32,
    is_css_pending: bool,
}

const CR: u32 = 0x00;
const CFGR: u32 = 0x08;
const CIFR: u32 = 0x1c;
const CICR: u32 = 0x20;
const CSR: u32 = 0x94;
const AHB1ENR: u32 = 0x48;
const AHB2ENR: u32 = 0x4c;
const APB1ENR1: u32 = 0x58;
const APB2ENR: u32 = 0x60;

impl Rcc {
    /// After power-on: BORRSTF and PINRSTF are set then, too.
    pub fn new() -> Rcc {
        let registers = [
            // HSION HSIRDY HSEON HSERDY HSEBYP CSSON PLLON PLLRDY
            (CR, Kept::new("RCC_CR", 0x0000_0500, 0x010d_0100)),
            (CFGR, Kept::new("RCC_CFGR", 0x0000_0005, 0x0000_3ff3)),
            (0x0c, Kept::new("RCC_PLLCFGR", 0x0000_1000, 0xf973_7ff3)),
            (0x28, Kept::new("RCC_AHB1RSTR", 0, 0x0000_0107)),
            (0x2c, Kept::new("RCC_AHB2RSTR", 0, 0x0001_607f)),
            (0x38, Kept::new("RCC_APB1RSTR1", 0, 0x1002_0000)),
            (0x40, Kept::new("RCC_APB2RSTR", 0, 0x0000_3001)),
            (AHB1ENR, Kept::new("RCC_AHB1ENR", 0x0000_0100, 0x0000_0107)),
            (AHB2ENR, Kept::new("RCC_AHB2ENR", 0, 0x0001_607f)),
            (APB1ENR1, Kept::new("RCC_APB1ENR1", 0x0000_0400, 0x1002_8400)),
            (APB2ENR, Kept::new("RCC_APB2ENR", 0, 0x0000_3001)),
            // Peripherals' clock sources: all at their reset value, which is the bus clock.
            (0x88, Kept::new("RCC_CCIPR", 0, 0)),
            (0x9c, Kept::new("RCC_CCIPR2", 0, 0)),
            // HSI48 stays off.
            (0x98, Kept::new("RCC_CRRCR", 0, 0)),
            (0x90, Kept::new("RCC_BDCR", 0, 0)),
        ];
        // BORRSTF and PINRSTF.
        Rcc { bank: Bank::new("RCC", &registers), has_crystal: true, flags: 0x0c00_0000, is_css_pending: false }
    }

    /// All but the reset flags go back; `flag` is added to them.
    pub fn reset(&mut self, flag: u32) {
        self.bank.reset();
        self.flags |= flag;
        self.is_css_pending = false;
    }

    /// Whether `bit` of the clock enable register at `offset` is set.
    fn is_on(&self, offset: u32, bit: u32) -> bool {
        self.bank.at(offset) >> bit & 1 != 0
    }

    /// Fails for a peripheral whose clock is off: on the chip its registers read as 0 and take nothing.
    pub fn check_clock(&self, peripheral: Clocked) -> Access<()> {
        let (name, offset, bit) = match peripheral {
            Clocked::Gpio(port) => ("GPIO", AHB2ENR, port),
            Clocked::Adc => ("ADC12", AHB2ENR, 13),
            Clocked::Dac => ("DAC1", AHB2ENR, 16),
            Clocked::Tim8 => ("TIM8", APB2ENR, 13),
            Clocked::Spi1 => ("SPI1", APB2ENR, 12),
            Clocked::Spi3 => ("SPI3", APB1ENR1, 15),
            Clocked::Syscfg => ("SYSCFG", APB2ENR, 0),
            Clocked::Usart2 => ("USART2", APB1ENR1, 17),
            Clocked::Pwr => ("PWR", APB1ENR1, 28),
            Clocked::Dma1 => ("DMA1", AHB1ENR, 0),
            Clocked::Dmamux => ("DMAMUX1", AHB1ENR, 2),
            Clocked::Flash => ("FLASH", AHB1ENR, 8),
        };
        if self.is_on(offset, bit) { Ok(()) } else { unmodelled(name, "touched while its clock is off") }
    }

    /// Reads.
    pub fn read(&self, offset: u32) -> Access<u32> {
        match offset {
            CR => {
                let cr = self.bank.at(CR);
                let hse_ready = self.has_crystal && cr >> 16 & 1 != 0;
                Ok(cr | (cr >> 8 & 1) << 10 | u32::from(hse_ready) << 17 | (cr >> 24 & 1) << 25)
            }
            // SWS follows SW.
            CFGR => Ok(self.bank.at(CFGR) & !0xc | (self.bank.at(CFGR) & 3) << 2),
            CIFR => Ok(u32::from(self.is_css_pending) << 8),
            CSR => Ok(self.flags),
            _ => self.bank.read(offset),
        }
    }

    /// Writes.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        match offset {
            CR => {
                // Ready bits are read-only, so a read-modify-write hands them back.
                let kept = value & !0x0202_0400 | self.bank.at(CR) & 0x400;
                self.bank.write(CR, kept)
            }
            CFGR => self.bank.write(CFGR, value & !0xc | self.bank.at(CFGR) & 0xc),
            CICR if value == 1 << 8 => {
                self.is_css_pending = false;
                Ok(())
            }
            CSR if value & !0xff80_0000 == 0 => {
                // RMVF.
                if value >> 23 & 1 != 0 {
                    self.flags = 0;
                }
                Ok(())
            }
            CSR => unmodelled("RCC_CSR", format!("value {value:#010x}")),
            _ => self.bank.write(offset, value),
        }
    }

    /// The crystal stops. True if the NMI is to be raised.
    pub fn stop_crystal(&mut self) -> bool {
        self.has_crystal = false;
        self.is_css_pending = self.bank.at(CR) >> 19 & 1 != 0;
        self.is_css_pending
    }
}

impl Default for Rcc {
    fn default() -> Rcc {
        Rcc::new()
    }
}

/// What has a clock of its own to be turned on.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the names are the manual's")]
pub enum Clocked {
    Gpio(u32),
    Adc,
    Dac,
    Tim8,
    Spi1,
    Spi3,
    Syscfg,
    Usart2,
    Pwr,
    Dma1,
    Dmamux,
    Flash,
}

/// Power control: range 1 with boost is all that is asked of it.
pub fn pwr() -> Bank {
    let registers = [
        (0x00, Kept::new("PWR_CR1", 0x200, 0x100)),
        (0x08, Kept::new("PWR_CR3", 0x8000, 0x4000)),
        (0x80, Kept::new("PWR_CR5", 0x100, 0x100)),
    ];
    Bank::new("PWR", &registers)
}

/// Nothing in it is used.
pub fn syscfg() -> Bank {
    Bank::new("SYSCFG", &[])
}

/// Debug in sleep modes, and the watchdog's stop while the core is halted.
pub fn dbgmcu() -> Bank {
    let registers = [(0x04, Kept::new("DBGMCU_CR", 0, 0x7)), (0x08, Kept::new("DBGMCU_APB1FZR1", 0, 1 << 12))];
    Bank::new("DBGMCU", &registers)
}

/// A port of 16 pins.
#[derive(Debug)]
pub struct Gpio {
    bank: Bank,
    /// What the outside drives the pins with; pins that nobody drives follow their pull.
    pub outside: u32,
    /// Pins that the outside drives.
    pub driven: u32,
}

const MODER: u32 = 0x00;
const PUPDR: u32 = 0x0c;
const ODR: u32 = 0x14;

impl Gpio {
    /// Reset values differ where the debug port has pins (RM0440, GPIO registers).
    pub fn new(port: usize) -> Gpio {
        let (moder, ospeedr, pupdr) = match port {
            0 => (0xabff_ffff, 0x0c00_0000, 0x6400_0000),
            1 => (0xffff_febf, 0, 0x0000_0100),
            _ => (0xffff_ffff, 0, 0),
        };
        let registers = [
            (MODER, Kept::new("GPIO_MODER", moder, !0)),
            (0x04, Kept::new("GPIO_OTYPER", 0, 0xffff)),
            (0x08, Kept::new("GPIO_OSPEEDR", ospeedr, !0)),
            (PUPDR, Kept::new("GPIO_PUPDR", pupdr, !0)),
            (ODR, Kept::new("GPIO_ODR", 0, 0xffff)),
            (0x20, Kept::new("GPIO_AFRL", 0, !0)),
            (0x24, Kept::new("GPIO_AFRH", 0, !0)),
        ];
        Gpio { bank: Bank::new("GPIO", &registers), outside: 0, driven: 0 }
    }

    /// As after reset; the outside stays.
    pub fn reset(&mut self) {
        self.bank.reset();
    }

    /// Reads.
    pub fn read(&self, offset: u32) -> Access<u32> {
        match offset {
            0x10 => Ok((0..16).map(|pin| u32::from(self.level(pin)) << pin).sum()),
            _ => self.bank.read(offset),
        }
    }

    /// Writes.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        match offset {
            0x18 => {
                let odr = self.bank.at(ODR);
                // Setting wins over clearing.
                self.bank.write(ODR, odr & !(value >> 16) | value & 0xffff)
            }
            _ => self.bank.write(offset, value),
        }
    }

    fn mode(&self, pin: u32) -> u32 {
        self.bank.at(MODER) >> (2 * pin) & 3
    }

    /// Whether the pin is an output of the program.
    pub fn is_output(&self, pin: u32) -> bool {
        self.mode(pin) == 1
    }

    /// Whether the pin is in analog mode.
    pub fn is_analog(&self, pin: u32) -> bool {
        self.mode(pin) == 3
    }

    /// The pin's alternate function, if it has one.
    pub fn alternate(&self, pin: u32) -> Option<u32> {
        let register = if pin < 8 { 0x20 } else { 0x24 };
        (self.mode(pin) == 2).then(|| self.bank.at(register) >> (4 * (pin % 8)) & 15)
    }

    /// The pin's level: driven by the program, by the outside, or by its pull; floating pins read 0.
    pub fn level(&self, pin: u32) -> bool {
        if self.is_output(pin) {
            return self.bank.at(ODR) >> pin & 1 != 0;
        }
        if self.driven >> pin & 1 != 0 {
            return self.outside >> pin & 1 != 0;
        }
        self.bank.at(PUPDR) >> (2 * pin) & 3 == 1
    }
}

/// The independent watchdog.
#[derive(Debug)]
pub struct Iwdg {
    prescaler: u32,
    reload: u32,
    is_open: bool,
    /// The cycle at which it resets the chip, once started.
    pub expires: Option<u64>,
}

impl Iwdg {
    /// Not started.
    pub const fn new() -> Iwdg {
        Iwdg { prescaler: 0, reload: 0xfff, is_open: false, expires: None }
    }

    fn timeout_cycles(&self) -> u64 {
        let ticks = f64::from(self.reload + 1) * f64::from(4_u32 << self.prescaler);
        (ticks * LSI_CYCLES) as u64
    }

    /// Reads. Updates of prescaler and reload are over at once here; the status says so.
    pub fn read(&self, offset: u32) -> Access<u32> {
        match offset {
            0x04 => Ok(self.prescaler),
            0x08 => Ok(self.reload),
            0x0c => Ok(0),
            _ => unmodelled(format!("IWDG + {offset:#x}"), "read, and no such register is modelled"),
        }
    }

    /// Writes.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        match (offset, value) {
            (0x00, 0xcccc) => self.expires = Some(now + self.timeout_cycles()),
            (0x00, 0x5555) => self.is_open = true,
            (0x00, 0xaaaa) => {
                self.is_open = false;
                if self.expires.is_some() {
                    self.expires = Some(now + self.timeout_cycles());
                }
            }
            (0x04, 0..=6) if self.is_open => self.prescaler = value,
            (0x08, 0..=0xfff) if self.is_open => self.reload = value,
            _ => return unmodelled(format!("IWDG + {offset:#x}"), format!("value {value:#x} in this state")),
        }
        Ok(())
    }
}

impl Default for Iwdg {
    fn default() -> Iwdg {
        Iwdg::new()
    }
}
