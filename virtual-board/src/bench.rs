//! The bench around the board: amplifier, plant, sensor and the levels between them and the pins.
//!
//! The plant is `plant-sim`'s exact one. It is carried on in spans whose ends are the instants that the board fixes: the ADC's hold and the
//! DAC's latch, 1700 cycles later. Anti-alias stage: one pole between the sensor and the pin; within a span the sensor's
//! output is taken as a straight line, which at 10 us and a mode of 900 Hz is wrong by 4e-4 of its swing. Without a corner frequency there is none.

use control_core::{Calibration, CalibrationSettings, DacCode};
use plant_sim::chain::{Chain, Held, SensorState, Simulator};
use plant_sim::replay::Start;
use std::fmt;

/// Cycles per second of the core.
pub const CORE_HZ: f64 = 170e6;

/// How long the monostable holds the amplifier after an edge of ENABLE. Chosen: 1 ms (docs/wiring.md), 10 periods of the toggling at 20 kHz.
const MONOSTABLE_CYCLES: u64 = 170_000;

/// What is wrong with the sensor's wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// Nothing.
    Whole,
    /// Pulled to ground.
    Shorted,
    /// Pulled to the supply, by the resistor that is there for it.
    Open,
}

/// How the bench is set up.
#[derive(Clone, Debug)]
pub struct BenchSettings {
    /// The plant.
    pub chain: Chain,
    /// Its state at the start.
    pub start: Start,
    /// The levels between pins and bench, which the board's parameters state too.
    pub calibration: Calibration,
    /// Seed of the sensor's noise.
    pub seed: u64,
    /// Corner of the anti-alias stage in Hz; none for no stage.
    pub anti_alias_hz: Option<f64>,
    /// The board has converters of 16 bits on SPI.
    pub has_external_converters: bool,
}

/// All of it, in motion.
pub struct Bench {
    calibration: Calibration,
    /// The monitor's levels are those of the chip's own converters on every board.
    monitor: Calibration,
    has_external_converters: bool,
    simulator: Simulator,
    sensor: SensorState,
    offset_m: f64,
    /// Cycles of one step of the simulator; divides every span.
    step_cycles: u64,
    /// The cycle that the plant stands at.
    reached: u64,
    /// The first hold fixes the grid.
    has_begun: bool,
    /// What the amplifier puts out.
    drive_v: f64,
    code: u16,
    enabled_until: u64,
    is_on: bool,
    /// Pole of the anti-alias stage: its share per step, and the stage's output.
    filter: Option<Filter>,
    /// What is wrong with the sensor's wire.
    pub wire: Wire,
    /// Codes that are fed instead of the plant's, one a sample; the last one stays.
    pub fed: Option<Feed>,
    /// Largest magnitude of the true displacement at any sample, in metres.
    pub peak_m: f64,
}

/// Codes for the displacement's ADC from outside.
pub type Feed = Box<dyn FnMut(u64) -> u16 + Send>;

#[derive(Clone, Copy, Debug)]
struct Filter {
    /// exp(-step / tau).
    decay: f64,
    steps_per_tau: f64,
    input_m: f64,
    output_m: f64,
}

impl fmt::Debug for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bench").field("reached", &self.reached).field("drive_v", &self.drive_v).finish_non_exhaustive()
    }
}

impl Bench {
    /// A bench whose plant is stepped by `step_cycles`, which divides the sampling period and the time from hold to latch.
    pub fn new(settings: &BenchSettings, step_cycles: u64) -> Bench {
        let step_s = step_cycles as f64 / CORE_HZ;
        let mut simulator = Simulator::new(&settings.chain, step_s, 0.0);
        simulator.start_from(&settings.start.state, settings.start.drive_v);
        let input_m = simulator.reading_m();
        let filter = settings.anti_alias_hz.map(|corner_hz| {
            let steps_per_tau = 1.0 / (std::f64::consts::TAU * corner_hz * step_s);
            let decay = (-1.0 / steps_per_tau).exp();
            Filter { decay, steps_per_tau, input_m, output_m: input_m }
        });
        Bench {
            calibration: settings.calibration,
            monitor: Calibration::try_build(&CalibrationSettings::NUCLEO_G474RE).unwrap_or(settings.calibration),
            has_external_converters: settings.has_external_converters,
            simulator,
            sensor: SensorState::new(&settings.chain.sensor, settings.seed),
            offset_m: settings.chain.sensor.offset_m,
            step_cycles,
            reached: 0,
            has_begun: false,
            drive_v: 0.0,
            code: settings.calibration.safe_code().0,
            enabled_until: 0,
            is_on: false,
            filter,
            wire: Wire::Whole,
            fed: None,
            peak_m: 0.0,
        }
    }

    /// Carries the plant on to `cycle`, as far as whole steps go.
    fn carry_on(&mut self, cycle: u64) {
        if !self.has_begun {
            return;
        }
        while self.reached + self.step_cycles <= cycle {
            self.simulator.advance(Held::zero_order(self.drive_v), 0.0);
            self.reached += self.step_cycles;
            if let Some(filter) = &mut self.filter {
                // A first-order lag of a straight line, exactly.
                let next_m = self.simulator.reading_m();
                let lag_m = (next_m - filter.input_m) * filter.steps_per_tau;
                filter.output_m = next_m - lag_m + (filter.output_m - filter.input_m + lag_m) * filter.decay;
                filter.input_m = next_m;
            }
        }
    }

    /// The displacement at the ADC's hold instant: in metres, and as the ADC's code.
    pub fn displacement(&mut self, cycle: u64) -> (f64, u16) {
        if !self.has_begun {
            self.has_begun = true;
            self.reached = cycle;
        }
        self.carry_on(cycle);
        let true_m = self.simulator.reading_m();
        self.peak_m = self.peak_m.max((true_m - self.offset_m).abs());
        let seen_m = self.sensor.read_m(self.filter.map_or(true_m, |filter| filter.output_m), 0.0, 0.0);
        let code = match self.wire {
            Wire::Shorted => 0,
            Wire::Open => self.last_code(),
            Wire::Whole => self.calibration.adc_code(seen_m as f32).0,
        };
        let code = self.fed.as_mut().map_or(code, |feed| feed(cycle));
        (true_m, code)
    }

    fn last_code(&self) -> u16 {
        self.calibration.adc_code(f32::INFINITY).0.max(self.calibration.adc_code(f32::NEG_INFINITY).0)
    }

    /// Whether the board has converters on SPI.
    pub fn has_external_converters(&self) -> bool {
        self.has_external_converters
    }

    /// The DAC's code for 0 V.
    pub fn mid_code(&self) -> u16 {
        self.calibration.safe_code().0
    }

    /// The amplifier's monitor: scaled back to the span of the chip's DAC, so that with that one its code is the DAC's own.
    pub fn monitor(&self) -> u16 {
        self.monitor.dac_code(self.drive_v as f32).0
    }

    /// A rising edge of ENABLE.
    pub fn enable_edge(&mut self, cycle: u64) {
        self.enabled_until = cycle + MONOSTABLE_CYCLES;
    }

    /// Takes note of whether the monostable has fallen back by `cycle`.
    pub fn look_at_enable(&mut self, cycle: u64) {
        self.is_on = cycle < self.enabled_until;
    }

    /// Whether the amplifier is on.
    pub fn is_amplifier_on(&self) -> bool {
        self.is_on
    }

    /// The DAC's pin has `code` from `cycle` on. An amplifier that is off holds 0 V.
    pub fn drive(&mut self, cycle: u64, code: u16) {
        self.carry_on(cycle);
        self.code = code;
        self.drive_v = if self.is_on { f64::from(self.calibration.drive_v(DacCode(code))) } else { 0.0 };
    }

    /// What the amplifier puts out, in volts.
    pub fn drive_v(&self) -> f64 {
        self.drive_v
    }
}
