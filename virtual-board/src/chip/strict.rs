//! What makes the models strict: a register that nobody models, a bit whose effect nobody models, or an access in the wrong width is
//! an error that names it. A wrong write can't pass silently.

use std::fmt;

/// An access that the model does not know the effect of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unmodelled {
    /// Peripheral and register, as the reference manual names them.
    pub register: String,
    /// What was tried.
    pub what: String,
}

impl fmt::Display for Unmodelled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.register, self.what)
    }
}

/// Result of a register access.
pub type Access<T> = Result<T, Unmodelled>;

/// An error for `register`.
pub fn unmodelled<T>(register: impl Into<String>, what: impl Into<String>) -> Access<T> {
    Err(Unmodelled { register: register.into(), what: what.into() })
}

/// A register that keeps what is written. Bits outside of `known` have to stay as they are.
#[derive(Clone, Copy, Debug)]
pub struct Kept {
    name: &'static str,
    value: u32,
    reset: u32,
    known: u32,
}

impl Kept {
    /// A register with its reset value and the bits that may be written.
    pub const fn new(name: &'static str, reset: u32, known: u32) -> Kept {
        Kept { name, value: reset, reset, known }
    }

    /// Its value.
    pub const fn get(&self) -> u32 {
        self.value
    }

    /// One of its bits.
    pub const fn bit(&self, bit: u32) -> bool {
        self.value >> bit & 1 != 0
    }

    /// A write by the program.
    pub fn write(&mut self, value: u32) -> Access<()> {
        let unknown = (value ^ self.value) & !self.known;
        if unknown != 0 {
            return unmodelled(
                self.name,
                format!("bits {unknown:#010x} of the value {value:#010x} are not modelled (was {:#010x})", self.value),
            );
        }
        self.value = value;
        Ok(())
    }

    /// A change by the hardware.
    pub fn set_bits(&mut self, bits: u32, to: bool) {
        self.value = if to { self.value | bits } else { self.value & !bits };
    }

    /// As after reset.
    pub fn reset(&mut self) {
        self.value = self.reset;
    }
}

/// Registers that only keep what is written, by offset.
#[derive(Clone, Debug)]
pub struct Bank {
    peripheral: &'static str,
    registers: Vec<(u32, Kept)>,
}

impl Bank {
    /// A peripheral's registers.
    pub fn new(peripheral: &'static str, registers: &[(u32, Kept)]) -> Bank {
        Bank { peripheral, registers: registers.to_vec() }
    }

    /// Reads the register at `offset`.
    pub fn read(&self, offset: u32) -> Access<u32> {
        match self.registers.iter().find(|(at, _)| *at == offset) {
            Some((_, register)) => Ok(register.get()),
            None => self.unknown(offset, "read"),
        }
    }

    /// Writes it.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        match self.registers.iter_mut().find(|(at, _)| *at == offset) {
            Some((_, register)) => register.write(value),
            None => self.unknown(offset, "written"),
        }
    }

    /// The register at `offset`, which `new` was given.
    pub fn at(&self, offset: u32) -> u32 {
        self.registers.iter().find(|(at, _)| *at == offset).map_or(0, |(_, register)| register.get())
    }

    /// The same to change.
    pub fn change(&mut self, offset: u32, change: impl FnOnce(&mut Kept)) {
        if let Some((_, register)) = self.registers.iter_mut().find(|(at, _)| *at == offset) {
            change(register);
        }
    }

    /// All as after reset.
    pub fn reset(&mut self) {
        self.registers.iter_mut().for_each(|(_, register)| register.reset());
    }

    fn unknown<T>(&self, offset: u32, what: &str) -> Access<T> {
        unmodelled(format!("{} + {offset:#x}", self.peripheral), format!("{what}, and no such register is modelled"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_bit_or_register_is_named() {
        let mut bank = Bank::new("TIM8", &[(4, Kept::new("TIM8_CR2", 0x10, 0x70))]);
        assert_eq!(bank.write(4, 0x30), Ok(()));
        assert_eq!(bank.read(4), Ok(0x30));
        let error = bank.write(4, 0x31).unwrap_err().to_string();
        assert_eq!(error, "TIM8_CR2: bits 0x00000001 of the value 0x00000031 are not modelled (was 0x00000030)");
        let error = bank.read(8).unwrap_err().to_string();
        assert_eq!(error, "TIM8 + 0x8: read, and no such register is modelled");
        bank.reset();
        assert_eq!(bank.at(4), 0x10);
    }
}
