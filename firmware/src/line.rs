//! The receiving half of the line: DMA writes round a ring that a task reads behind it.
//!
//! embassy's ring stops the DMA at each error, a pulse on the line or a ring that ran over, and starts it again with the count it
//! stopped at. The chip does not support that (RM0440, DMA, "Suspend and resume a channel"), and from then on the ring is read where nothing
//! was written: old frames come again and new ones never. Here the DMA is set up once and never stopped, so that ring and DMA can't
//! part; an error costs the frame it falls into, whose CRC shows it.

use crate::registers::line;
use crate::shared::Lent;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

/// 3.4 ms of line, so that a request that is being carried out loses none behind it. A power of two, as positions wrap at 2^32.
const BYTES: u32 = 1024;

static RING: Lent<[u8; BYTES as usize]> = Lent::new([0; BYTES as usize]);
/// How often the DMA has come round, modulo 2^32.
static LAPS: AtomicU32 = AtomicU32::new(0);
/// The line had an error since this was last looked at.
static IS_DISTURBED: AtomicBool = AtomicBool::new(false);
/// Bytes may have come: half a ring of them, or some and then silence; or an error has.
static ARRIVED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The port's interrupt.
pub struct OnLine;

impl Handler<typelevel::USART2> for OnLine {
    unsafe fn on_interrupt() {
        if line::take_errors() {
            IS_DISTURBED.store(true, Ordering::Relaxed);
        }
        ARRIVED.signal(());
    }
}

/// The interrupt of the DMA channel that fills the ring.
pub struct OnRing;

impl Handler<typelevel::DMA1_CHANNEL2> for OnRing {
    unsafe fn on_interrupt() {
        if line::take_lap() {
            // The only writer.
            LAPS.store(LAPS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        }
        ARRIVED.signal(());
    }
}

/// Bytes were lost or changed on the way.
pub struct Disturbed;

/// Where the ring is read. One for the one ring there is.
pub struct Line {
    /// Bytes taken since the start, modulo 2^32.
    taken: u32,
}

impl Line {
    /// Starts the reception. To be called once, with the port set up.
    pub fn begin() -> Line {
        line::begin(RING.get().cast(), BYTES as u16);
        Line { taken: 0 }
    }

    /// Waits for bytes and takes as many as are there and `bytes` has room for.
    pub async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Disturbed> {
        loop {
            if IS_DISTURBED.swap(false, Ordering::Relaxed) {
                return Err(Disturbed);
            }
            let waiting = written().wrapping_sub(self.taken);
            let n = bytes.len().min(waiting as usize);
            for (k, byte) in bytes[..n].iter_mut().enumerate() {
                let place = (self.taken.wrapping_add(k as u32) % BYTES) as usize;
                // SAFETY: inside of the ring, by the remainder; the DMA may be writing there, so the read is volatile and the value
                // counts only if the next lines find that it did not.
                *byte = unsafe { RING.get().cast::<u8>().add(place).read_volatile() };
            }
            let now = written();
            if now.wrapping_sub(self.taken) > BYTES {
                // Overwritten before it was read: what is left belongs to no frame's start.
                self.taken = now;
                return Err(Disturbed);
            }
            if n > 0 {
                self.taken = self.taken.wrapping_add(n as u32);
                return Ok(n);
            }
            ARRIVED.wait().await;
        }
    }
}

/// Bytes that the DMA has written since the start, modulo 2^32. For a task only: it waits for the interrupt that counts the laps.
fn written() -> u32 {
    loop {
        let laps = LAPS.load(Ordering::Relaxed);
        let left = line::left();
        // Else the count may be of the next lap already.
        if !line::is_lap_due() && LAPS.load(Ordering::Relaxed) == laps {
            return laps.wrapping_mul(BYTES).wrapping_add(BYTES - u32::from(left));
        }
    }
}
