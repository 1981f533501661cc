//! External converters on SPI: an ADC that holds at an edge and is read afterwards, a DAC with an input register and a latch pin.
//!
//! The two serial ports are modelled as far as words of 16 bits at a quarter of the clock go, SPI1 both ways, SPI3 sending only.

use super::strict::{Access, Bank, Kept, unmodelled};

/// Cycles of 16 bits at 42.5 MHz.
const WORD_CYCLES: u64 = 64;
/// From the edge to the code: 0.71 us.
const CONVERSION_CYCLES: u64 = 121;
const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SR: u32 = 0x08;
const DR: u32 = 0x0c;
/// CPHA, MSTR, BR = 4, SPE and software select; the same with one line that sends, and its first edge. At SPI1's first edge, the rising one, the
/// ADC's bit may not be there yet: it takes up to 13.4 ns from the falling one (TI SBAS569B, td-CK-DO), and half of a period is 11.8 ns.
const SPI1_CR1: u32 = 1 | 1 << 2 | 1 << 3 | 1 << 6 | 1 << 8 | 1 << 9;
const SPI3_CR1: u32 = 1 << 2 | 1 << 3 | 1 << 6 | 1 << 14 | 1 << 15;

/// One of the ports.
#[derive(Debug)]
pub struct Spi {
    name: &'static str,
    bank: Bank,
    is_sender: bool,
    /// The word on its way, and when it is there.
    under_way: Option<(u16, u64)>,
    received: Option<u16>,
}

impl Spi {
    /// After reset.
    pub fn new(name: &'static str, is_sender: bool) -> Spi {
        let registers = [(CR1, Kept::new("SPI_CR1", 0, 0xc37d)), (CR2, Kept::new("SPI_CR2", 0x700, 0x0f0c))];
        Spi { name, bank: Bank::new(name, &registers), is_sender, under_way: None, received: None }
    }

    /// Reads.
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        match offset {
            // RXNE, TXE, BSY.
            SR => Ok(u32::from(self.received.is_some()) | 2 | u32::from(self.under_way.is_some()) << 7),
            DR => Ok(u32::from(self.received.take().unwrap_or(0))),
            _ => self.bank.read(offset),
        }
    }

    /// Writes.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        if offset != DR {
            return self.bank.write(offset, value);
        }
        let (cr1, cr2) = if self.is_sender { (SPI3_CR1, 0xf0c) } else { (SPI1_CR1, 0xf00) };
        if (self.bank.at(CR1), self.bank.at(CR2)) != (cr1, cr2) {
            return unmodelled(
                format!("{}_CR1, _CR2", self.name),
                "a word sent in another mode than 16 bits at 42.5 MHz, SPI1's taken at the second edge",
            );
        }
        if self.under_way.is_some() {
            return unmodelled(format!("{}_DR", self.name), "a word sent before the last one was gone");
        }
        self.under_way = Some((value as u16, now + WORD_CYCLES));
        Ok(())
    }

    /// When the word on its way is there.
    pub fn event(&self) -> Option<u64> {
        self.under_way.map(|(_, done)| done)
    }

    /// The word that has arrived by `now`.
    fn arrived(&mut self, now: u64) -> Option<u16> {
        let (word, _) = self.under_way.filter(|(_, done)| *done <= now)?;
        self.under_way = None;
        Some(word)
    }
}

/// ADC and DAC with their ports.
#[derive(Debug)]
pub struct External {
    /// Reads the ADC.
    pub spi1: Spi,
    /// Writes the DAC.
    pub spi3: Spi,
    /// Code and the cycle from which it can be read.
    held: Option<(u16, u64)>,
    input: u16,
    output: u16,
    mid: u16,
}

impl External {
    /// At power-on: the DAC at mid-code.
    pub fn new(mid: u16) -> External {
        External {
            spi1: Spi::new("SPI1", false),
            spi3: Spi::new("SPI3", true),
            held: None,
            input: mid,
            output: mid,
            mid,
        }
    }

    /// The chip is reset at `now`: its ports are, the converters keep what they have. Pull-ups at select and LDAC (docs/wiring.md) take the
    /// one high, so that a word on its way ends as far as it has come in the input register, and hold the other one there: the DAC stays where
    /// it is until the next latch.
    pub fn reset(&mut self, now: u64) {
        let mut input = self.input;
        if let Some((word, done)) = self.spi3.under_way {
            let bits = WORD_CYCLES.saturating_sub(done.saturating_sub(now)) * 16 / WORD_CYCLES;
            input = (u32::from(input) << bits | u32::from(word) >> (16 - bits)) as u16;
        }
        *self = External { input, output: self.output, ..External::new(self.mid) };
    }

    /// The edge that starts a conversion.
    pub fn hold(&mut self, at: u64, code: u16) {
        self.held = Some((code, at + CONVERSION_CYCLES));
    }

    /// When something happens next.
    pub fn event(&self) -> Option<u64> {
        [self.spi1.event(), self.spi3.event()].into_iter().flatten().min()
    }

    /// Does what is due.
    pub fn advance(&mut self, now: u64) -> Access<()> {
        if let Some(done) = self.spi1.event().filter(|done| *done <= now) {
            self.spi1.arrived(now);
            match self.held {
                Some((code, ready)) if done - WORD_CYCLES >= ready => self.spi1.received = Some(code),
                _ => return unmodelled("external ADC", "read before its conversion was over"),
            }
        }
        if let Some(word) = self.spi3.arrived(now) {
            self.input = word;
        }
        Ok(())
    }

    /// The edge that latches the DAC.
    pub fn latch(&mut self) {
        self.output = self.input;
    }

    /// The DAC's code.
    pub fn output(&self) -> u16 {
        self.output
    }

    /// The code in the DAC's input register, which the next latch takes.
    pub fn input(&self) -> u16 {
        self.input
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bit_taken_at_the_edge_before_it_is_there_is_refused() {
        let mut spi = Spi::new("SPI1", false);
        spi.write(0, CR2, 0xf00).unwrap();
        spi.write(0, CR1, SPI1_CR1 & !1).unwrap();
        let refused = spi.write(0, DR, 0).unwrap_err().to_string();
        assert!(refused.contains("second edge"), "{refused}");
        spi.write(0, CR1, SPI1_CR1).unwrap();
        assert_eq!(spi.write(0, DR, 0), Ok(()));
    }

    #[test]
    fn a_word_that_a_reset_cuts_is_torn_in_the_input_register_and_goes_no_further() {
        let mut external = External::new(0x8000);
        external.spi3.write(0, CR2, 0xf0c).unwrap();
        external.spi3.write(0, CR1, SPI3_CR1).unwrap();
        external.spi3.write(0, DR, 0xffff).unwrap();
        // Half of it.
        external.reset(WORD_CYCLES / 2);
        assert_eq!((external.input(), external.output()), (0x00ff, 0x8000));
    }
}
