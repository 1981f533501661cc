//! USART2 with its FIFOs, DMA1 and the request multiplexer: bytes between the line and memory.
//!
//! Modelled: byte times from BRR, both FIFOs of eight, overrun, a missing stop bit, idle line, the DMA's counters, circular mode and
//! flags. Not modelled: parity, noise, half duplex, flow control: each is an error.

use super::strict::{Access, Bank, Kept, unmodelled};
use std::collections::VecDeque;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const CR3: u32 = 0x08;
const BRR: u32 = 0x0c;
const ISR: u32 = 0x1c;
const ICR: u32 = 0x20;
const RDR: u32 = 0x24;
const TDR: u32 = 0x28;
const FIFO: usize = 8;
const FE: u32 = 1 << 1;
const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

/// The serial port, with the line's other end.
#[derive(Debug)]
pub struct Usart {
    bank: Bank,
    flags: u32,
    rx: VecDeque<u8>,
    tx: VecDeque<u8>,
    /// When the byte that leaves is gone.
    leaves_at: Option<u64>,
    leaving: u8,
    /// When the next byte of the line has arrived; the line is busy until then.
    arrives_at: Option<u64>,
    idle_at: Option<u64>,
    /// From the host, not yet on the line.
    pub from_host: VecDeque<u8>,
    /// To the host, off the line.
    pub to_host: Vec<u8>,
    /// Bytes that found the receiving FIFO full.
    pub overruns: u64,
}

impl Usart {
    /// After reset.
    pub fn new() -> Usart {
        let registers = [
            // UE, RE, TE, IDLEIE, RXNEIE, TCIE, FIFOEN
            (CR1, Kept::new("USART_CR1", 0, 0x2000_007d)),
            (CR2, Kept::new("USART_CR2", 0, 0)),
            // EIE, DMAR, DMAT
            (CR3, Kept::new("USART_CR3", 0, 0xc1)),
            (BRR, Kept::new("USART_BRR", 0, 0xffff)),
            (0x2c, Kept::new("USART_PRESC", 0, 0)),
        ];
        Usart {
            bank: Bank::new("USART2", &registers),
            flags: TC,
            rx: VecDeque::new(),
            tx: VecDeque::new(),
            leaves_at: None,
            leaving: 0,
            arrives_at: None,
            idle_at: None,
            from_host: VecDeque::new(),
            to_host: Vec::new(),
            overruns: 0,
        }
    }

    /// As after reset; what the host has sent is lost on the line, what it has received stays.
    pub fn reset(&mut self) {
        let to_host = std::mem::take(&mut self.to_host);
        *self = Usart { to_host, overruns: self.overruns, ..Usart::new() };
    }

    /// Start bit, eight bits, stop bit.
    fn byte_cycles(&self) -> u64 {
        10 * u64::from(self.bank.at(BRR))
    }

    fn is_on(&self, bit: u32) -> bool {
        let cr1 = self.bank.at(CR1);
        cr1 & 1 != 0 && cr1 >> bit & 1 != 0 && self.bank.at(BRR) >= 16
    }

    fn isr(&self) -> u32 {
        let rx = if self.rx.is_empty() { 0 } else { RXNE };
        let tx = if self.tx.len() < FIFO { TXE } else { 0 };
        self.flags | rx | tx
    }

    /// Whether its interrupt is up.
    pub fn interrupt(&self) -> bool {
        let (isr, cr1) = (self.isr(), self.bank.at(CR1));
        // The enable bits of CR1 stand where the flags do; EIE is CR3's.
        isr & cr1 & (IDLE | RXNE | TC | TXE) != 0 || isr & (FE | ORE) != 0 && self.bank.at(CR3) & 1 != 0
    }

    /// Whether a byte waits for the DMA.
    pub fn wants_rx_dma(&self) -> bool {
        !self.rx.is_empty() && self.bank.at(CR3) >> 6 & 1 != 0
    }

    /// Whether the DMA may bring a byte.
    pub fn wants_tx_dma(&self) -> bool {
        self.tx.len() < FIFO && self.bank.at(CR3) >> 7 & 1 != 0 && self.is_on(3)
    }

    /// Reads.
    pub fn read(&mut self, now: u64, offset: u32) -> Access<u32> {
        match offset {
            ISR => Ok(self.isr()),
            RDR => Ok(u32::from(self.take(now))),
            _ => self.bank.read(offset),
        }
    }

    /// The oldest byte received.
    pub fn take(&mut self, _now: u64) -> u8 {
        self.rx.pop_front().unwrap_or(0)
    }

    /// Writes.
    pub fn write(&mut self, now: u64, offset: u32, value: u32) -> Access<()> {
        match offset {
            ICR => {
                // PECF, FECF, NECF, ORECF, IDLECF, TXFECF, TCCF, TCBGTCF: the program hands back what it read in ISR.
                if value & !0xff != 0 {
                    return unmodelled("USART_ICR", format!("value {value:#x}"));
                }
                self.flags &= !(value & 0x5f);
                Ok(())
            }
            TDR => {
                self.give(now, value as u8);
                Ok(())
            }
            _ => self.bank.write(offset, value),
        }
    }

    /// A byte to send; one that finds the FIFO full is lost, as on the chip.
    pub fn give(&mut self, now: u64, byte: u8) {
        if self.tx.len() < FIFO {
            self.tx.push_back(byte);
        }
        self.flags &= !TC;
        self.begin_leaving(now);
    }

    fn begin_leaving(&mut self, now: u64) {
        if self.leaves_at.is_none()
            && self.is_on(3)
            && let Some(byte) = self.tx.pop_front()
        {
            self.leaving = byte;
            self.leaves_at = Some(now + self.byte_cycles());
        }
    }

    /// When something happens next.
    pub fn event(&self) -> Option<u64> {
        [self.leaves_at, self.arrives_at, self.idle_at].into_iter().flatten().min()
    }

    /// Does what is due, and starts what the host has queued.
    pub fn advance(&mut self, now: u64) {
        if let Some(at) = self.leaves_at.filter(|at| *at <= now) {
            self.to_host.push(self.leaving);
            self.leaves_at = None;
            self.begin_leaving(at);
            if self.leaves_at.is_none() {
                self.flags |= TC;
            }
        }
        if let Some(at) = self.arrives_at.filter(|at| *at <= now) {
            self.arrives_at = None;
            if let Some(byte) = self.from_host.pop_front() {
                if self.rx.len() < FIFO {
                    self.rx.push_back(byte);
                } else {
                    self.flags |= ORE;
                    self.overruns += 1;
                }
            }
            self.idle_at = Some(at + self.byte_cycles());
            self.begin_arriving(at);
        }
        if self.arrives_at.is_none() {
            self.begin_arriving(now);
        }
        if self.idle_at.is_some_and(|at| at <= now) {
            self.idle_at = None;
            self.flags |= IDLE;
        }
    }

    /// A pulse on the line that is taken for a start bit: a byte without a stop bit, now. It takes its place like any other, with FE set.
    pub fn disturb(&mut self, byte: u8) {
        if !self.is_on(2) {
            return;
        }
        if self.rx.len() < FIFO {
            self.rx.push_back(byte);
            self.flags |= FE;
        } else {
            self.flags |= ORE;
            self.overruns += 1;
        }
    }

    fn begin_arriving(&mut self, now: u64) {
        if !self.from_host.is_empty() && self.is_on(2) {
            self.arrives_at = Some(now + self.byte_cycles());
            self.idle_at = None;
        }
    }
}

impl Default for Usart {
    fn default() -> Usart {
        Usart::new()
    }
}

/// One channel of DMA1.
#[derive(Clone, Copy, Debug)]
struct Channel {
    ccr: Kept,
    cndtr: u32,
    cpar: u32,
    cmar: u32,
    /// Where the counters stood when the channel was enabled.
    reload: u32,
    address: u32,
    request: u32,
    /// Disabled with its count neither run out nor written since.
    is_aborted: bool,
}

/// DMA1's first two channels and DMAMUX1 in front of them.
#[derive(Debug)]
pub struct Dma {
    channels: [Channel; 2],
    isr: u32,
    mux: Bank,
}

/// What moves a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// From memory at this address to the transmitter.
    ToLine(u32),
    /// From the receiver to memory at this address.
    FromLine(u32),
}

/// DMAMUX requests (RM0440): USART2_RX and USART2_TX.
const REQUEST_RX: u32 = 26;
const REQUEST_TX: u32 = 27;
const USART2: u32 = 0x4000_4400;

impl Dma {
    /// After reset.
    pub fn new() -> Dma {
        // EN, TCIE, HTIE, TEIE, DIR, CIRC, MINC, PL
        let ccr = Kept::new("DMA_CCR", 0, 0x30bf);
        let channel = Channel { ccr, cndtr: 0, cpar: 0, cmar: 0, reload: 0, address: 0, request: 0, is_aborted: false };
        // DMAREQ_ID, EGE
        let mux = Kept::new("DMAMUX_CCR", 0, 0x27f);
        Dma { channels: [channel; 2], isr: 0, mux: Bank::new("DMAMUX1", &[(0, mux), (4, mux)]) }
    }

    /// Whether a channel's interrupt is up.
    pub fn interrupt(&self, channel: usize) -> bool {
        let flags = self.isr >> (4 * channel) & 0xe;
        flags & self.channels[channel].ccr.get() & 0xe != 0
    }

    /// Reads.
    pub fn read(&self, offset: u32) -> Access<u32> {
        if offset == 0 {
            return Ok(self.isr);
        }
        let (channel, register) = place(offset)?;
        let channel = &self.channels[channel];
        Ok(match register {
            0 => channel.ccr.get(),
            4 => channel.cndtr,
            8 => channel.cpar,
            _ => channel.cmar,
        })
    }

    /// Writes.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        if offset == 4 {
            for channel in 0..2 {
                // CGIF clears all of a channel's flags.
                let clear = value >> (4 * channel) & 15;
                let clear = if clear & 1 != 0 { 15 } else { clear };
                self.isr &= !(clear << (4 * channel));
            }
            return Ok(());
        }
        let (number, register) = place(offset)?;
        let request = self.mux.at(4 * number as u32) & 0x7f;
        let channel = &mut self.channels[number];
        let is_enabled = channel.ccr.bit(0);
        if is_enabled && register != 0 {
            return unmodelled(format!("DMA1 channel {}", number + 1), "counters written while it is enabled");
        }
        match register {
            0 => {
                channel.ccr.write(value)?;
                if !channel.ccr.bit(0) && is_enabled {
                    channel.is_aborted = channel.cndtr != 0;
                }
                if channel.ccr.bit(0) && !is_enabled {
                    // RM0440, DMA, "Suspend and resume a channel": "not supported by the DMA hardware". Only "Abort and restart" is.
                    if channel.is_aborted {
                        return unmodelled(
                            format!("DMA1 channel {}", number + 1),
                            "enabled again with what was left of its count",
                        );
                    }
                    channel.reload = channel.cndtr;
                    channel.address = channel.cmar;
                    channel.request = request;
                    let is_tx = channel.ccr.bit(4);
                    // MINC, bytes on both sides, and the port's own data register.
                    let wanted = if is_tx { (REQUEST_TX, USART2 + TDR) } else { (REQUEST_RX, USART2 + RDR) };
                    if !channel.ccr.bit(7) || (request, channel.cpar) != wanted {
                        return unmodelled(
                            format!("DMA1 channel {}", number + 1),
                            format!("enabled with request {request} and peripheral {:#010x}", channel.cpar),
                        );
                    }
                }
            }
            4 => {
                channel.cndtr = value & 0xffff;
                channel.is_aborted = false;
            }
            8 => channel.cpar = value,
            _ => channel.cmar = value,
        }
        Ok(())
    }

    /// The multiplexer's registers.
    pub fn mux(&mut self) -> &mut Bank {
        &mut self.mux
    }

    /// The next byte that can be moved, given what the port wants.
    pub fn next_move(&self, wants_rx: bool, wants_tx: bool) -> Option<(usize, Move)> {
        self.channels.iter().enumerate().find_map(|(number, channel)| {
            if !channel.ccr.bit(0) || channel.cndtr == 0 {
                return None;
            }
            match channel.request {
                REQUEST_TX if wants_tx => Some((number, Move::ToLine(channel.address))),
                REQUEST_RX if wants_rx => Some((number, Move::FromLine(channel.address))),
                _ => None,
            }
        })
    }

    /// One byte of `channel` was moved.
    pub fn moved(&mut self, number: usize) {
        let channel = &mut self.channels[number];
        channel.cndtr -= 1;
        channel.address += 1;
        let mut flags = 0;
        if channel.cndtr == channel.reload / 2 {
            flags |= 1 << 2;
        }
        if channel.cndtr == 0 {
            flags |= 1 << 1;
            if channel.ccr.bit(5) {
                channel.cndtr = channel.reload;
                channel.address = channel.cmar;
            }
        }
        if flags != 0 {
            self.isr |= (flags | 1) << (4 * number);
        }
    }
}

impl Default for Dma {
    fn default() -> Dma {
        Dma::new()
    }
}

/// Channel and register of an offset.
fn place(offset: u32) -> Access<(usize, u32)> {
    let from_first = offset.wrapping_sub(8);
    let (channel, register) = (from_first / 0x14, from_first % 0x14);
    if channel < 2 && register <= 12 {
        return Ok((channel as usize, register));
    }
    unmodelled(format!("DMA1 + {offset:#x}"), "only channels 1 and 2 are modelled")
}
