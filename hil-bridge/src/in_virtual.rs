//! The link to the flash image on the virtual board, in this process. Its time is the board's.

use crate::link::{Link, LinkError};
use std::time::Duration;
use virtual_board::{BenchSettings, CORE_HZ, Image, Machine, VirtualBoard, step_cycles};

/// Longest time that an answer takes: 50 ms, twice what saving parameters does.
const PATIENCE: Duration = Duration::from_millis(50);

/// The board, and the link to it.
#[derive(Debug)]
pub struct InVirtual {
    machine: Machine,
}

impl InVirtual {
    /// A board at reset with `image`. `bench` is what its own pins see while the bridge is the input: its plant stands still.
    ///
    /// # Errors
    /// [`LinkError::Machine`].
    pub fn new(image: &Image, bench: &BenchSettings, rate_hz: f64) -> Result<InVirtual, LinkError> {
        let mut machine = VirtualBoard::new(image, bench, step_cycles(rate_hz)).machine;
        // What is sent before the image has opened its port is lost, as on a real line.
        let limit = machine.now() + 4 * cycles(PATIENCE);
        machine.run(limit, |chip| chip.samples >= 2)?;
        Ok(InVirtual { machine })
    }

    /// The board itself, for who breaks something on its bench.
    pub fn machine(&mut self) -> &mut Machine {
        &mut self.machine
    }
}

fn cycles(time: Duration) -> u64 {
    (time.as_secs_f64() * CORE_HZ) as u64
}

impl Link for InVirtual {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.machine.chip().usart.from_host.extend(bytes);
        Ok(())
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        let limit = self.machine.now() + cycles(patience);
        // A frame ends in 0, and only those are worth a look.
        self.machine.run(limit, |chip| chip.usart.to_host.contains(&0))?;
        into.append(&mut self.machine.chip().usart.to_host);
        Ok(())
    }

    fn now(&mut self) -> Duration {
        Duration::from_secs_f64(self.machine.now() as f64 / CORE_HZ)
    }

    fn patience(&self) -> Duration {
        PATIENCE
    }

    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        let limit = self.machine.now() + cycles(time);
        self.machine.run(limit, |_| false)?;
        Ok(())
    }
}
