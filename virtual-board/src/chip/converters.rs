//! TIM8, ADC1 and ADC2, DAC1: the chain from the sampling trigger to the latch.
//!
//! Modelled to the cycle: update and compare events, the ADC's tracking (47.5 ADC clocks) and conversion (12.5) of four cycles
//! each, overwriting, the DAC's hardware trigger. Not modelled: the two or three cycles that a trigger takes through its
//! synchronisers, which are the same each time; the converters' noise and non-linearity, which belong to the bench.

use super::strict::{Access, Bank, Kept, unmodelled};

/// Cycles of the core's clock per ADC clock (CKMODE 3, RM0440: HCLK / 4).
const ADC_CLOCK: u64 = 4;

/// Advanced timer 8, as far as a time base with one compare goes.
#[derive(Debug)]
pub struct Tim8 {
    bank: Bank,
    /// The cycle at which the present period began.
    period_start: u64,
    /// Reload value in force; the register holds the one for the next period.
    reload: u32,
    sr: u32,
    /// Pulses of the present period that have come.
    done: usize,
}

const DIER: u32 = 0x0c;
const CCMR2: u32 = 0x1c;
const CCER: u32 = 0x20;
const CCR2: u32 = 0x38;
const CCR3: u32 = 0x3c;
const CCR4: u32 = 0x40;
const BDTR: u32 = 0x44;
const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const TIM_SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CNT: u32 = 0x24;
const ARR: u32 = 0x2c;
const CCR1: u32 = 0x34;

/// What the timer did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pulse {
    /// TRGO2, an update.
    Update,
    /// TRGO, compare 1.
    Compare,
    /// Compare 4, where its interrupt is used.
    Ready,
}

impl Tim8 {
    /// After reset.
    pub fn new() -> Tim8 {
        let registers = [
            // CEN, ARPE, UIFREMAP
            (CR1, Kept::new("TIM8_CR1", 0, 0x881)),
            // MMS, MMS2
            (CR2, Kept::new("TIM8_CR2", 0, 0x00f0_0070)),
            // CC4IE
            (DIER, Kept::new("TIM8_DIER", 0, 0x10)),
            // OC1M, OC2M
            (CCMR1, Kept::new("TIM8_CCMR1", 0, 0x0101_7070)),
            // OC3M
            (CCMR2, Kept::new("TIM8_CCMR2", 0, 0x70)),
            // CC1E, CC1P, CC3E
            (CCER, Kept::new("TIM8_CCER", 0, 0x103)),
            (CCR2, Kept::new("TIM8_CCR2", 0, 0xffff)),
            (CCR3, Kept::new("TIM8_CCR3", 0, 0xffff)),
            (CCR4, Kept::new("TIM8_CCR4", 0, 0xffff)),
            // MOE
            (BDTR, Kept::new("TIM8_BDTR", 0, 0x8000)),
            (0x28, Kept::new("TIM8_PSC", 0, 0)),
            (ARR, Kept::new("TIM8_ARR", 0xffff, 0xffff)),
            (CCR1, Kept::new("TIM8_CCR1", 0, 0xffff)),
        ];
        let bank = Bank::new("TIM8", &registers);
        Tim8 { bank, period_start: 0, reload: 0xffff, sr: 0, done: 0 }
    }

    fn is_running(&self) -> bool {
        self.bank.at(CR1) & 1 != 0
    }

    /// Reads.
    pub fn read(&self, now: u64, offset: u32) -> Access<u32> {
        match offset {
            TIM_SR => Ok(self.sr),
            CNT => {
                let count = if self.is_running() { now.saturating_sub(self.period_start) as u32 } else { 0 };
                let flag = if self.bank.at(CR1) >> 11 & 1 != 0 { self.sr & 1 } else { 0 };
                Ok(count | flag << 31)
            }
            _ => self.bank.read(offset),
        }
    }

    /// Writes.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        match offset {
            TIM_SR => {
                self.sr &= value;
                Ok(())
            }
            EGR if value == 1 && !self.is_running() => {
                self.reload = self.bank.at(ARR);
                self.sr |= 1;
                Ok(())
            }
            CR1 => {
                let was_running = self.is_running();
                self.bank.write(CR1, value)?;
                if self.is_running() && !was_running {
                    self.check()?;
                    self.period_start = now;
                    self.done = 0;
                } else if was_running && !self.is_running() {
                    return unmodelled("TIM8_CR1", "stopping the timer");
                }
                Ok(())
            }
            CCR1 | CCR2 | CCR3 | CCR4 | CR2 | CCMR1 | CCMR2 | CCER | DIER | BDTR if self.is_running() => {
                unmodelled(format!("TIM8 + {offset:#x}"), "written while the timer runs")
            }
            _ => self.bank.write(offset, value),
        }
    }

    /// Only one way of using the timer is modelled.
    fn check(&self) -> Access<()> {
        if self.bank.at(CR1) & 0x80 == 0 {
            return unmodelled("TIM8_CR1", "running without ARPE");
        }
        // MMS: OC1REF; MMS2: update. Without outputs OC1M is PWM mode 2 and nothing else is set; with them channel 1 is a pulse
        // (combined PWM mode 2, PWM mode 1), active low, and channel 3 one from the update on, and both are let out.
        let plain = [(CCMR1, 0x70), (CCMR2, 0), (CCER, 0), (DIER, 0)];
        let pulsed = [(CCMR1, 0x0001_6050), (CCMR2, 0x60), (CCER, 0x103), (DIER, 0x10), (BDTR, 0x8000)];
        let is = |wanted: &[(u32, u32)]| wanted.iter().all(|(register, value)| self.bank.at(*register) == *value);
        if self.bank.at(CR2) != 0x0020_0040 || !(is(&plain) || is(&pulsed)) {
            return unmodelled("TIM8", "running in another way than the two that are modelled");
        }
        if is(&pulsed) && (self.bank.at(CCR2) <= self.bank.at(CCR1) || self.bank.at(CCR4) >= self.bank.at(CCR1)) {
            return unmodelled("TIM8_CCR1 to 4", "compares in another order than 4, 1, 2");
        }
        if self.bank.at(CCR1) > self.reload || self.bank.at(CCR1) == 0 {
            return unmodelled("TIM8_CCR1", "a compare outside of the period");
        }
        Ok(())
    }

    /// Whether the pins of channel 1 and 3 are let out.
    pub fn drives_pins(&self) -> bool {
        self.bank.at(BDTR) >> 15 & 1 != 0 && self.bank.at(CCER) & 0x101 == 0x101
    }

    /// Whether its compare interrupt is up.
    pub fn interrupt(&self) -> bool {
        self.sr & self.bank.at(DIER) & 0x10 != 0
    }

    /// The next pulse with its count.
    fn next(&self) -> (Pulse, u64) {
        let has_ready = self.bank.at(DIER) & 0x10 != 0;
        match (self.done, has_ready) {
            (0, true) => (Pulse::Ready, u64::from(self.bank.at(CCR4))),
            (0, false) | (1, true) => (Pulse::Compare, u64::from(self.bank.at(CCR1))),
            _ => (Pulse::Update, u64::from(self.reload) + 1),
        }
    }

    /// When the next pulse comes.
    pub fn event(&self) -> Option<u64> {
        self.is_running().then(|| self.period_start + self.next().1)
    }

    /// The pulse that is due by `now`, with its cycle.
    pub fn advance(&mut self, now: u64) -> Option<(Pulse, u64)> {
        let at = self.event().filter(|at| *at <= now)?;
        let (pulse, _) = self.next();
        self.done += 1;
        match pulse {
            Pulse::Update => {
                self.period_start = at;
                self.reload = self.bank.at(ARR);
                self.done = 0;
                self.sr |= 1;
            }
            Pulse::Compare => self.sr |= 2,
            Pulse::Ready => self.sr |= 0x10,
        }
        Some((pulse, at))
    }
}

impl Default for Tim8 {
    fn default() -> Tim8 {
        Tim8::new()
    }
}

/// One of the two converters.
#[derive(Debug)]
pub struct Adc {
    name: &'static str,
    bank: Bank,
    cr: u32,
    isr: u32,
    dr: u32,
    ready_at: Option<u64>,
    calibrated_at: Option<u64>,
    /// Hold instant and end of the conversion under way.
    conversion: Option<(u64, u64)>,
    held: Option<u32>,
    /// Added to the next conversions: an ADC that is late.
    pub late_cycles: u64,
}

const ISR: u32 = 0x00;
const IER: u32 = 0x04;
const ADC_CR: u32 = 0x08;
const CFGR: u32 = 0x0c;
const SMPR1: u32 = 0x14;
const SQR1: u32 = 0x30;
const DR: u32 = 0x40;
const ADRDY: u32 = 1;
const EOC: u32 = 4;
const EOS: u32 = 8;
const OVR: u32 = 16;

impl Adc {
    /// After reset.
    pub fn new(name: &'static str) -> Adc {
        let registers = [
            // EOCIE
            (IER, Kept::new("ADC_IER", 0, EOC)),
            // EXTSEL, EXTEN, OVRMOD, JQDIS
            (CFGR, Kept::new("ADC_CFGR", 0x8000_0000, 0x8000_1fe0)),
            (0x10, Kept::new("ADC_CFGR2", 0, 0)),
            (SMPR1, Kept::new("ADC_SMPR1", 0, 0x01ff_ffff)),
            (SQR1, Kept::new("ADC_SQR1", 0, 0x7c0)),
        ];
        Adc {
            name,
            bank: Bank::new(name, &registers),
            // DEEPPWD
            cr: 1 << 29,
            isr: 0,
            dr: 0,
            ready_at: None,
            calibrated_at: None,
            conversion: None,
            held: None,
            late_cycles: 0,
        }
    }

    /// Whether its interrupt is up.
    pub fn interrupt(&self) -> bool {
        self.isr & self.bank.at(IER) != 0
    }

    /// Reads; reading the result clears its flag.
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        match offset {
            ISR => Ok(self.isr),
            ADC_CR => Ok(self.cr),
            DR => {
                self.isr &= !EOC;
                Ok(self.dr)
            }
            _ => self.bank.read(offset),
        }
    }

    /// Writes.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        match offset {
            ISR => {
                self.isr &= !value;
                Ok(())
            }
            ADC_CR => self.control(now, value),
            // RM0440: CFGR, SMPR and SQR only while no conversion can start.
            CFGR | SMPR1 | SQR1 if self.cr & 4 != 0 => {
                unmodelled(format!("{} + {offset:#x}", self.name), "written while ADSTART is set")
            }
            _ => self.bank.write(offset, value),
        }
    }

    fn control(&mut self, now: u64, value: u32) -> Access<()> {
        // DEEPPWD, ADVREGEN, ADCAL, ADSTART, ADEN
        let unknown = value & !0xb000_0005;
        if unknown != 0 {
            return unmodelled(format!("{}_CR", self.name), format!("bits {unknown:#010x}"));
        }
        let rises = value & !self.cr;
        if rises & 1 << 31 != 0 {
            if self.cr & 1 << 28 == 0 || self.cr & 1 != 0 {
                return unmodelled(format!("{}_CR", self.name), "calibration without regulator, or enabled");
            }
            // DS12288: 116 ADC clocks.
            self.calibrated_at = Some(now + 116 * ADC_CLOCK);
        }
        if rises & 1 != 0 {
            if self.cr & 1 << 28 == 0 || self.cr & 1 << 31 != 0 {
                return unmodelled(format!("{}_CR", self.name), "enabled without regulator, or during calibration");
            }
            self.ready_at = Some(now + 8 * ADC_CLOCK);
        }
        if rises & 4 != 0 {
            if self.isr & ADRDY == 0 {
                return unmodelled(format!("{}_CR", self.name), "ADSTART before ADRDY");
            }
            // EXTEN rising edge, EXTSEL 8 (TIM8_TRGO2), OVRMOD overwrite.
            if self.bank.at(CFGR) & 0x1fe0 != 8 << 5 | 1 << 10 | 1 << 12 {
                return unmodelled(format!("{}_CFGR", self.name), "started with another trigger than TIM8_TRGO2");
            }
        }
        // ADEN and ADSTART are only set by a write.
        self.cr = value | self.cr & 5;
        Ok(())
    }

    /// Channel of the one conversion there is.
    pub fn channel(&self) -> u32 {
        self.bank.at(SQR1) >> 6 & 0x1f
    }

    /// Its trigger. A conversion under way goes on and this one is lost, as on the chip.
    pub fn trigger(&mut self, at: u64) -> Access<()> {
        if self.cr & 4 == 0 || self.conversion.is_some() {
            return Ok(());
        }
        // SMP 4: 47.5 clocks.
        if self.bank.at(SMPR1) >> (3 * self.channel()) & 7 != 4 {
            return unmodelled(format!("{}_SMPR1", self.name), "another sampling time than 47.5 clocks");
        }
        self.conversion = Some((at + 190, at + 240 + self.late_cycles));
        self.held = None;
        Ok(())
    }

    /// When something happens next.
    pub fn event(&self) -> Option<u64> {
        let conversion = self.conversion.map(|(hold, end)| if self.held.is_none() { hold } else { end });
        [self.ready_at, self.calibrated_at, conversion].into_iter().flatten().min()
    }

    /// The instant at which the input has to be read, if that is due.
    pub fn hold_due(&self, now: u64) -> Option<u64> {
        self.conversion.map(|(hold, _)| hold).filter(|hold| *hold <= now && self.held.is_none())
    }

    /// What the input was at the hold instant.
    pub fn hold(&mut self, code: u32) {
        self.held = Some(code);
    }

    /// Finishes what is due.
    pub fn advance(&mut self, now: u64) {
        if self.calibrated_at.is_some_and(|at| at <= now) {
            self.calibrated_at = None;
            self.cr &= !(1 << 31);
        }
        if self.ready_at.is_some_and(|at| at <= now) {
            self.ready_at = None;
            self.isr |= ADRDY;
        }
        if let (Some((_, end)), Some(code)) = (self.conversion, self.held)
            && end <= now
        {
            self.conversion = None;
            self.held = None;
            if self.isr & EOC != 0 {
                self.isr |= OVR;
            }
            self.dr = code;
            self.isr |= EOC | EOS;
        }
    }
}

/// Both ADCs' common register.
pub fn adc_common() -> Bank {
    Bank::new("ADC12_COMMON", &[(0x08, Kept::new("ADC12_CCR", 0, 0x0003_0000))])
}

/// DAC1, channel 1.
#[derive(Debug)]
pub struct Dac {
    bank: Bank,
    dor: u32,
}

const DAC_CR: u32 = 0x00;
const DHR12R1: u32 = 0x08;

impl Dac {
    /// After reset.
    pub fn new() -> Dac {
        let registers = [
            // EN1, TEN1, TSEL1
            (DAC_CR, Kept::new("DAC_CR", 0, 0x3f)),
            (DHR12R1, Kept::new("DAC_DHR12R1", 0, 0xfff)),
            // HFSEL
            (0x3c, Kept::new("DAC_MCR", 0, 0xc000)),
        ];
        Dac { bank: Bank::new("DAC1", &registers), dor: 0 }
    }

    /// Reads.
    pub fn read(&self, offset: u32) -> Access<u32> {
        if offset == 0x2c { Ok(self.dor) } else { self.bank.read(offset) }
    }

    /// Writes; without a trigger the code passes through at once.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        self.bank.write(offset, value)?;
        let cr = self.bank.at(DAC_CR);
        if cr & 2 == 0 {
            self.dor = self.bank.at(DHR12R1);
        } else if cr >> 2 & 15 != 1 {
            return unmodelled("DAC_CR", "another trigger than TIM8_TRGO (TSEL1 1)");
        }
        Ok(())
    }

    /// Its trigger.
    pub fn trigger(&mut self) {
        if self.bank.at(DAC_CR) & 2 != 0 {
            self.dor = self.bank.at(DHR12R1);
        }
    }

    /// The code at the pin, if the DAC drives it.
    pub fn output(&self) -> Option<u32> {
        (self.bank.at(DAC_CR) & 1 != 0).then_some(self.dor)
    }
}

impl Default for Dac {
    fn default() -> Dac {
        Dac::new()
    }
}
