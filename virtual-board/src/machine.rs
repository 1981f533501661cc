//! Core and chip together: rsemu's Cortex-M4F, memory, the interrupt lines, and what is measured on the way.
//!
//! **The guards against rsemu 0.0.7.** That version drops ITSTATE from the stacked xPSR, so that an interrupt taken inside of an IT
//! block corrupts the interrupted code. Interrupt lines are therefore held low while the core is inside of one; [`Machine::run`] also checks
//! that no exception was entered from inside of one all the same, and fails if so. And it clears FPSCR on entry to a handler before the
//! lazy floating-point frame is written, where the architecture (DDI 0403E B1.5.7) saves what was there: an interrupt between a
//! floating-point comparison and its use would turn the comparison's outcome round. FPSCR is therefore put back while that frame is owed.

use crate::chip::strict::Unmodelled;
use crate::chip::{Chip, IRQS, Memory, Reset};
use crate::image::{FLASH, Image};
use rsemu::core::BusError;
use rsemu::core::space::{
    AccessConstraints, AddressSpace, MemAttrs, MemOps, MemResult, RamStore, Region, RomStore, RomWrite,
};
use rsemu::core::value::Width;
use rsemu::cpu::arm::v7m::sys::fpccr;
use rsemu::cpu::arm::v7m::{ArmV7m, Config};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// ITSTATE's bits in xPSR.
const IT: u32 = 0x0600_fc00;
const RAM: u32 = 0x2000_0000;
const RAM_BYTES: u64 = 96 * 1024;
const CCM: u32 = 0x1000_0000;
/// What memory holds before the program uses it.
const UNUSED: u32 = 0xa5a5_a5a5;
const CCM_BYTES: u64 = 32 * 1024;

/// Why a run ended before its time.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum MachineError {
    #[error("at cycle {cycle}, instruction {pc:#010x}: {what}")]
    Unmodelled { cycle: u64, pc: u32, what: Unmodelled },
    #[error("at cycle {cycle}, instruction {pc:#010x}: access to {address:#010x}, where nothing is")]
    Nowhere { cycle: u64, pc: u32, address: u32 },
    #[error("at cycle {cycle}, instruction {pc:#010x}: the core has locked up")]
    LockedUp { cycle: u64, pc: u32 },
    #[error(
        "at cycle {cycle}, instruction {pc:#010x}: an interrupt was taken inside of an IT block, which rsemu 0.0.7 gets wrong"
    )]
    ItBlock { cycle: u64, pc: u32 },
    #[error("nothing came of it within {cycles} cycles")]
    TooLong { cycles: u64 },
}

/// What the core and the models share.
#[derive(Debug)]
struct Shared {
    chip: Mutex<Chip>,
    now: AtomicU64,
    /// A register was touched, so lines and events may have changed.
    touched: AtomicBool,
}

impl Shared {
    /// A panic in a model leaves nothing half done that another access could make worse.
    fn chip(&self) -> MutexGuard<'_, Chip> {
        self.chip.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Peripherals at `base`, in words only.
#[derive(Debug)]
struct Window {
    shared: Arc<Shared>,
    base: u32,
    is_flash: bool,
}

impl Window {
    fn refuse(chip: &mut Chip, error: Unmodelled) -> BusError {
        chip.error.get_or_insert(error);
        BusError::BadAccess
    }
}

impl MemOps for Window {
    fn read(&self, offset: u64, bytes: &mut [u8], _: MemAttrs) -> MemResult {
        self.shared.touched.store(true, Relaxed);
        let mut chip = self.shared.chip();
        chip.now = self.shared.now.load(Relaxed);
        let (offset, within) = (offset as u32 & !3, offset as usize & 3);
        let value = if self.is_flash { chip.read_flash(offset) } else { chip.read(self.base + offset) };
        let value = value.map_err(|error| Window::refuse(&mut chip, error))?.to_le_bytes();
        let part = value.get(within..within + bytes.len()).ok_or(BusError::BadAccess)?;
        bytes.copy_from_slice(part);
        Ok(())
    }

    fn write(&self, offset: u64, bytes: &[u8], _: MemAttrs) -> MemResult {
        self.shared.touched.store(true, Relaxed);
        let mut chip = self.shared.chip();
        chip.now = self.shared.now.load(Relaxed);
        let now = chip.now;
        let address = self.base + offset as u32;
        let value = match bytes {
            [a, b, c, d] if address.is_multiple_of(4) => u32::from_le_bytes([*a, *b, *c, *d]),
            // The program sends a byte through TDR or takes a half word's register; registers are 32 bits wide on this bus.
            [byte] if address == 0x4000_4428 => u32::from(*byte),
            [a, b] if address.is_multiple_of(4) => u32::from(u16::from_le_bytes([*a, *b])),
            _ => {
                let what = format!("written as {} bytes, and only words are modelled", bytes.len());
                let error = Unmodelled { register: format!("{address:#010x}"), what };
                return Err(Window::refuse(&mut chip, error));
            }
        };
        let done =
            if self.is_flash { chip.flash.write_word(now, offset as u32, value) } else { chip.write(address, value) };
        done.map_err(|error| Window::refuse(&mut chip, error))
    }

    fn constraints(&self) -> AccessConstraints {
        AccessConstraints::IO
    }
}

/// How often the control interrupt ran and what it cost, in instructions and cycles of the core's model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Interrupts.
    pub count: u64,
    /// Fewest and most instructions.
    pub instructions: (u64, u64),
    /// All instructions.
    pub total_instructions: u64,
    /// Fewest and most cycles. The core's model: one a simple instruction; not measured on silicon.
    pub cycles: (u64, u64),
    /// Instructions fetched from flash, where wait states would make the time vary.
    pub from_flash: u64,
}

impl Cost {
    fn note(&mut self, instructions: u64, cycles: u64, from_flash: u64) {
        let wider = |(low, high): (u64, u64), x: u64| if self.count == 0 { (x, x) } else { (low.min(x), high.max(x)) };
        self.instructions = wider(self.instructions, instructions);
        self.cycles = wider(self.cycles, cycles);
        self.count += 1;
        self.total_instructions += instructions;
        self.from_flash += from_flash;
    }
}

/// Calls of one function, counted.
#[derive(Clone, Debug, Default)]
struct Calls {
    address: u32,
    /// Where the call under way returns to, and the instructions before it.
    under_way: Option<(u32, u64)>,
    instructions: Vec<u64>,
}

/// FMAC's exception: the interrupt behind the control interrupt, which works between two samples.
const BETWEEN: u16 = 16 + 101;

/// A core with its chip.
pub struct Machine {
    core: ArmV7m,
    space: Arc<AddressSpace>,
    shared: Arc<Shared>,
    instructions: u64,
    cost: Cost,
    between_cost: Cost,
    /// As `under_way`, of the interrupt behind it.
    between: Option<(u64, u64, u64)>,
    calls: Option<Calls>,
    /// Instructions and cycles at the entry of the control interrupt under way, and fetches from flash since.
    under_way: Option<(u64, u64, u64)>,
    exception: u16,
    is_guard_on: bool,
    keeps_flags: bool,
    /// A core that has locked up stands still while the chip goes on; else that is an error.
    goes_on_locked: bool,
    /// Exception number of the control interrupt.
    control: u16,
}

impl fmt::Debug for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Machine").field("now", &self.now()).field("pc", &self.core.pc()).finish_non_exhaustive()
    }
}

struct Ram<'a>(&'a AddressSpace);

impl Memory for Ram<'_> {
    fn load(&self, address: u32) -> u8 {
        self.0.read(u64::from(address), Width::U8, MemAttrs::DEBUG).unwrap_or(0) as u8
    }

    fn store(&self, address: u32, byte: u8) {
        // An address outside of memory is a transfer error on the chip; DMA is only ever aimed at buffers.
        let _ = self.0.write(u64::from(address), Width::U8, u64::from(byte), MemAttrs::DEBUG);
    }
}

impl Machine {
    /// An image on a chip, at reset.
    pub fn new(image: &Image, chip: Chip) -> Machine {
        let control = 16 + chip.control_irq();
        let shared =
            Arc::new(Shared { chip: Mutex::new(chip), now: AtomicU64::new(0), touched: AtomicBool::new(true) });
        let rom = Arc::new(RomStore::from_slice(&image.flash));
        let window = |base: u32, is_flash: bool| Arc::new(Window { shared: shared.clone(), base, is_flash });
        let space = AddressSpace::new("core", 32);
        {
            let mut map = space.topology();
            let regions = [
                (Region::rom("flash bank 1", rom.clone(), RomWrite::Fault), FLASH),
                (Region::rom("flash bank 1 at 0", rom, RomWrite::Fault), 0),
                (Region::io("flash bank 2", 0x4_0000, window(0x0804_0000, true)), 0x0804_0000),
                (Region::ram("SRAM", Arc::new(RamStore::new(RAM_BYTES))), RAM),
                (Region::ram("CCM SRAM", Arc::new(RamStore::new(CCM_BYTES))), CCM),
                (Region::io("APB and AHB1", 0x0010_0000, window(0x4000_0000, false)), 0x4000_0000),
                (Region::io("AHB2", 0x1000_0000, window(0x4800_0000, false)), 0x4800_0000),
                (Region::io("DBGMCU", 0x1000, window(0xe004_2000, false)), 0xe004_2000),
            ];
            for (region, base) in regions {
                // The map is fixed and free of overlaps, so this can't fail for one image and not for another.
                map.map(region, u64::from(base)).expect("the memory map above has no overlaps");
            }
        }
        let space = Arc::new(space);
        // Memory at power-on holds anything but zeros, and what is still this was never used.
        for address in (RAM..RAM + RAM_BYTES as u32).step_by(4) {
            let _ = space.write(u64::from(address), Width::U32, u64::from(UNUSED), MemAttrs::DEBUG);
        }
        Machine {
            core: new_core(&space),
            space,
            shared,
            instructions: 0,
            cost: Cost::default(),
            between_cost: Cost::default(),
            between: None,
            calls: None,
            under_way: None,
            exception: 0,
            is_guard_on: true,
            keeps_flags: true,
            goes_on_locked: false,
            control,
        }
    }

    /// The chip. Not to be held over [`Machine::run`].
    pub fn chip(&self) -> MutexGuard<'_, Chip> {
        self.shared.chip()
    }

    /// The present cycle.
    pub fn now(&self) -> u64 {
        self.shared.now.load(Relaxed)
    }

    /// Instructions so far.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// What the control interrupt has cost so far.
    pub fn cost(&self) -> Cost {
        self.cost
    }

    /// What the interrupt behind it has cost, which works between two samples.
    pub fn between_cost(&self) -> Cost {
        self.between_cost
    }

    /// Starts the measurement of the costs anew.
    pub fn forget_cost(&mut self) {
        self.cost = Cost::default();
        self.between_cost = Cost::default();
    }

    /// Starts to count the instructions of each call of the function at `address`.
    pub fn count_calls(&mut self, address: u32) {
        self.calls = Some(Calls { address: address & !1, ..Calls::default() });
    }

    /// Instructions of each call so far, the return included.
    pub fn calls(&self) -> &[u64] {
        self.calls.as_ref().map_or(&[], |calls| &calls.instructions)
    }

    /// A word of memory, as a debugger sees it.
    pub fn word(&self, address: u32) -> Option<u32> {
        self.space.read(u64::from(address), Width::U32, MemAttrs::DEBUG).ok().map(|word| word as u32)
    }

    /// Puts a word into memory, as a debugger would.
    pub fn set_word(&self, address: u32, word: u32) -> bool {
        self.space.write(u64::from(address), Width::U32, u64::from(word), MemAttrs::DEBUG).is_ok()
    }

    /// Bytes of stack ever used, and bytes there are.
    pub fn stack_bytes(&self, image: &Image) -> Option<(u32, u32)> {
        let (low, high) = (image.symbol("_stack_end")?, image.symbol("_stack_start")?);
        let lowest = (low..high).step_by(4).find(|address| self.word(*address) != Some(UNUSED)).unwrap_or(high);
        Some((high - lowest, high - low))
    }

    /// Takes the guard away, for the test that shows what it is for.
    pub fn drop_guard(&mut self) {
        self.is_guard_on = false;
    }

    /// Lets interrupts clear the flags of floating-point comparisons, for the test that shows what is kept and why.
    pub fn lose_flags(&mut self) {
        self.keeps_flags = false;
    }

    /// Stops the core for `cycles` while the chip goes on, as a debugger does that halts it.
    pub fn stall(&self, cycles: u64) {
        let until = self.now() + cycles;
        let mut chip = self.shared.chip();
        while chip.event() <= until {
            chip.now = chip.event();
            chip.advance(&Ram(&self.space));
        }
        self.shared.now.store(until, Relaxed);
    }

    /// Moves the stack pointer to `address` as soon as the core sleeps, as if all above were in use. A core that locks up because of it
    /// stands still from then on, and the chip goes on.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn use_up_stack(&mut self, address: u32) -> Result<(), MachineError> {
        while !self.core.is_asleep() {
            self.run(self.now() + 20, |_| false)?;
        }
        self.core.set_reg(13, address);
        self.goes_on_locked = true;
        Ok(())
    }

    /// Disables the control interrupt, as a program gone astray might.
    pub fn hang(&self) {
        self.disable(self.control);
    }

    /// Disables the interrupt behind it, which works between two samples.
    pub fn hang_between(&self) {
        self.disable(BETWEEN);
    }

    /// NVIC_ICER.
    fn disable(&self, exception: u16) {
        let irq = u32::from(exception - 16);
        self.core.with_sys(|system| system.write_word(0xe000_e180 + irq / 32 * 4, 1 << (irq % 32)));
    }

    /// Runs until `done` says so (it is asked whenever something happened on the chip) or `limit` is reached: false then.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn run(&mut self, limit: u64, mut done: impl FnMut(&mut Chip) -> bool) -> Result<bool, MachineError> {
        let shared = self.shared.clone();
        let mut now = self.now();
        let mut event = 0;
        // Guarded lines are up but held low, so they have to be looked at again after each instruction.
        let mut is_guarded = true;
        loop {
            if is_guarded || now >= event || shared.touched.swap(false, Relaxed) || self.core.is_asleep() {
                let mut chip = shared.chip();
                chip.now = now;
                chip.advance(&Ram(&self.space));
                if let Some(what) = chip.error.take() {
                    return Err(MachineError::Unmodelled { cycle: now, pc: self.core.pc(), what });
                }
                if self.core.reset_requested() {
                    self.core.clear_reset_request();
                    chip.request_reset(Reset::Software);
                }
                if let Some(why) = chip.take_reset() {
                    chip.reset(why);
                    // A new core: rsemu's own reset leaves NVIC's enables and a lazy floating-point frame as they were, which a
                    // reset of the chip does not.
                    self.core = new_core(&self.space);
                    self.exception = 0;
                    self.under_way = None;
                    self.between = None;
                    self.goes_on_locked = false;
                }
                let is_inside = self.is_guard_on && self.core.xpsr() & IT != 0;
                let lines = chip.lines();
                is_guarded = is_inside && lines.contains(&true);
                for (irq, is_up) in IRQS.into_iter().zip(lines) {
                    self.core.set_irq(irq, is_up && !is_inside);
                }
                if !is_inside {
                    let is_nmi = chip.take_nmi();
                    self.core.set_nmi(is_nmi);
                    // An edge: the next look takes it back.
                    is_guarded |= is_nmi;
                } else if self.core.nmi_asserted() {
                    self.core.set_nmi(false);
                }
                event = chip.event().min(limit);
                if done(&mut chip) {
                    return Ok(true);
                }
                if now >= limit {
                    return Ok(false);
                }
                if self.core.is_asleep() && !lines.contains(&true) && event > now {
                    // One cycle before, so that the step that wakes the core ends at the event.
                    now = event.min(limit);
                    self.shared.now.store(now, Relaxed);
                    continue_after_sleep(&mut chip, now, &self.space);
                }
            }
            now += self.step(now)?;
            shared.now.store(now, Relaxed);
        }
    }

    /// One instruction, exception entry or sleeping cycle.
    fn step(&mut self, now: u64) -> Result<u64, MachineError> {
        if self.goes_on_locked && self.core.is_locked_up() {
            return Ok(1);
        }
        let (before, flags, stack) = (self.core.xpsr(), self.core.fpscr(), self.core.msp());
        let cycles = self.core.step();
        self.instructions += 1;
        let exception = self.core.current_exception().0;
        if exception != self.exception {
            if self.keeps_flags && self.core.with_sys(|system| system.fpccr & fpccr::LSPACT != 0) {
                self.core.set_fpscr(flags);
            }
            // A handler that returns inside of an IT block, and the next one begins at once, stacks nothing.
            let is_stacked = self.core.msp() < stack;
            self.change_exception(now, exception, is_stacked && before & IT != 0)?;
        }
        if let Some(calls) = &mut self.calls {
            let (pc, link) = (self.core.pc(), self.core.reg(14));
            match calls.under_way {
                None if pc == calls.address => calls.under_way = Some((link & !1, self.instructions)),
                Some((back, began)) if pc == back => {
                    calls.instructions.push(self.instructions - began);
                    calls.under_way = None;
                }
                _ => {}
            }
        }
        if let Some((_, _, from_flash)) = &mut self.between {
            *from_flash += u64::from((FLASH..CCM).contains(&self.core.pc()));
        }
        if let Some((_, _, from_flash)) = &mut self.under_way {
            *from_flash += u64::from((FLASH..CCM).contains(&self.core.pc()));
        }
        Ok(cycles)
    }

    fn change_exception(&mut self, now: u64, exception: u16, was_inside: bool) -> Result<(), MachineError> {
        let pc = self.core.pc();
        if exception > self.exception && was_inside {
            return Err(MachineError::ItBlock { cycle: now, pc });
        }
        if self.core.is_locked_up() {
            if self.goes_on_locked {
                return Ok(());
            }
            return Err(MachineError::LockedUp { cycle: now, pc });
        }
        // 3 is HardFault: the image has a handler, but on the virtual board it always means an access to nowhere or a fault of ours.
        if exception == 3 && !self.goes_on_locked {
            // The instruction that was interrupted: the seventh word that was stacked.
            let pc = self.word(self.core.msp() + 24).unwrap_or(pc);
            let (count, address) = self.core.bus_faults();
            if let Some(what) = self.chip().error.take() {
                return Err(MachineError::Unmodelled { cycle: now, pc, what });
            }
            if count > 0 {
                return Err(MachineError::Nowhere { cycle: now, pc, address });
            }
        }
        if exception == self.control {
            if self.under_way.is_none() {
                self.under_way = Some((self.instructions, self.core.cycles(), 0));
            }
        } else if self.exception == self.control
            && let Some((instructions, cycles, from_flash)) = self.under_way.take()
        {
            self.cost.note(self.instructions - instructions, self.core.cycles() - cycles, from_flash);
        }
        // Interrupted by the control interrupt it goes on afterwards.
        if exception == BETWEEN {
            if self.between.is_none() {
                self.between = Some((self.instructions, self.core.cycles(), 0));
            }
        } else if self.exception == BETWEEN
            && exception != self.control
            && let Some((instructions, cycles, from_flash)) = self.between.take()
        {
            let (instructions, cycles) = (self.instructions - instructions, self.core.cycles() - cycles);
            self.between_cost.note(instructions, cycles, from_flash);
        }
        self.exception = exception;
        Ok(())
    }
}

/// A core at reset, in front of `space`.
fn new_core(space: &Arc<AddressSpace>) -> ArmV7m {
    let mut config = Config::CORTEX_M4F;
    config.priority_bits = 4;
    let core = ArmV7m::new(config);
    core.attach_space(space.clone());
    core
}

/// The chip is carried on to the cycle that the sleep ended at.
fn continue_after_sleep(chip: &mut Chip, now: u64, space: &AddressSpace) {
    chip.now = now;
    chip.advance(&Ram(space));
}
