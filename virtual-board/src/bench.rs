//! The bench around the board: amplifier, plant, sensor and the levels between them and the pins.
//!
//! The plant is `plant-sim`'s exact one. It is carried on in spans whose ends are the instants that the board fixes: the ADC's hold and the
//! DAC's latch, 1700 cycles later. Anti-alias stage: one pole between the sensor and the pin; within a span the sensor's
//! output is taken as a straight line, which at 10 us and a mode of 900 Hz is wrong by 4e-4 of its swing. Without a corner frequency there is none.

use control_core::{Calibration, CalibrationSettings, DacCode};
use plant_sim::chain::{Arrivals, Chain, Held, SensorState, Simulator};
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
    /// Pulled to the supply, by the resistor that is there for it, between stage and pin. The last code at once: the stage has filter and clamp at its own
    /// end (docs/wiring.md), so that 47 kOhm charge some 50 pF, 2.4 us, and a wire breaks here right after a sample. Not there: a break within
    /// 15 us of the next one, and what the ADC's own capacitor carries over from the last.
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
    /// Seed of the sensor's noise and of the commands that are lost.
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
    arrivals: Arrivals,
    /// The command of the present sample arrives at the amplifier.
    arrives: bool,
    /// The last hold.
    held_at: u64,
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
            arrivals: Arrivals::new(&settings.chain.drive, settings.seed),
            arrives: true,
            held_at: 0,
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
            self.held_at = cycle;
        }
        self.carry_on(cycle);
        self.arrives = self.arrivals.next_arrives();
        let true_m = self.simulator.reading_m();
        let (moved_m, velocity_m_per_s) = self.simulator.motion();
        self.peak_m = self.peak_m.max(moved_m.abs());
        let sample_s = (cycle - self.held_at) as f64 / CORE_HZ;
        self.held_at = cycle;
        let ideal_m = self.filter.map_or(true_m, |filter| filter.output_m);
        let seen_m = self.sensor.read_m(ideal_m, velocity_m_per_s, sample_s);
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

    /// The DAC's pin has `code` from `cycle` on. An amplifier that is off holds 0 V; a command that is lost leaves it where it is.
    pub fn drive(&mut self, cycle: u64, code: u16) {
        self.carry_on(cycle);
        if self.arrives {
            self.code = code;
        }
        self.drive_v = if self.is_on { f64::from(self.calibration.drive_v(DacCode(self.code))) } else { 0.0 };
    }

    /// What the amplifier puts out, in volts.
    pub fn drive_v(&self) -> f64 {
        self.drive_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant_sim::model::Model;
    use std::path::Path;

    const PERIOD: u64 = 8500;

    fn settings(change: impl FnOnce(&mut Chain)) -> BenchSettings {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
        let mut chain = Model::read(&path).unwrap().chain();
        change(&mut chain);
        let calibration = Calibration::try_build(&CalibrationSettings::NUCLEO_G474RE).unwrap();
        let start = Start::relaxed(&chain);
        BenchSettings { chain, start, calibration, seed: 7, anti_alias_hz: None, has_external_converters: false }
    }

    /// Plays +-20 V at 100 Hz as a board does, code by code: what the ADC delivered, the monitor, and the bench as it stands then.
    fn play(settings: &BenchSettings, samples: u64) -> (Vec<u16>, Vec<u16>, Bench) {
        let mut bench = Bench::new(settings, 1700);
        let mut adc = Vec::new();
        let mut monitor = Vec::new();
        for k in 0..samples {
            let hold = 1000 + k * PERIOD;
            adc.push(bench.displacement(hold).1);
            monitor.push(bench.monitor());
            bench.enable_edge(hold);
            bench.look_at_enable(hold + 1700);
            let wanted_v = 20.0 * (std::f64::consts::TAU * k as f64 / 200.0).sin();
            bench.drive(hold + 1700, settings.calibration.dac_code(wanted_v as f32).0);
        }
        (adc, monitor, bench)
    }

    fn differing(a: &[u16], b: &[u16]) -> usize {
        a.iter().zip(b).filter(|(a, b)| a != b).count()
    }

    #[test]
    fn jitter_and_slow_noise_of_a_model_reach_the_adc() {
        let (clean, _, _) = play(&settings(|_| ()), 4000);
        let (jittery, _, _) = play(&settings(|chain| chain.sensor.jitter_s = 20e-6), 4000);
        let slow = |chain: &mut Chain| (chain.sensor.slow_noise_m, chain.sensor.slow_noise_s) = (1e-6, 5e-3);
        let (slow, _, _) = play(&settings(slow), 4000);
        // +-35 um at 100 Hz move by up to 0.022 m/s: 20 us are up to 0.44 um or 7 codes, and nothing where the motion turns.
        let off = |adc: &[u16], at: &dyn Fn(usize) -> bool| {
            let squares =
                (400..4000).filter(|k| at(*k)).map(|k| f64::from(i32::from(adc[k]) - i32::from(clean[k])).powi(2));
            let (sum, n) = squares.fold((0.0, 0), |(sum, n), square| (sum + square, n + 1));
            (sum / f64::from(n)).sqrt()
        };
        let speed = |k: usize| (i32::from(clean[k]) - i32::from(clean[k - 1])).abs();
        let fastest = (400..4000).map(speed).max().unwrap_or(0);
        let (fast, slowly) = (off(&jittery, &|k| 5 * speed(k) > 4 * fastest), off(&jittery, &|k| speed(k) <= 1));
        // Codes move by `fastest` in 50 us: 20 us rms of it, within 10 % for some 1000 samples, and the rounding of both logs.
        let expected = 0.4 * 0.93 * f64::from(fastest);
        assert!((0.8..1.2).contains(&(fast / expected)) && slowly < 0.3 * fast, "{fast} {expected} {slowly}");
        // 1 um is 15.75 codes; 180 ms have 36 time constants, so the rms is known to 1 / sqrt(36): 17 %, three of them.
        let rms = off(&slow, &|_| true);
        assert!((0.5 * 15.75..1.5 * 15.75).contains(&rms), "{rms}");
        // And slow it is: from one sample to the next sqrt(2 (1 - exp(-0.01))) = 14 % of it, and the rounding.
        let moves = (400..4000).map(|k| {
            let off = |k: usize| i32::from(slow[k]) - i32::from(clean[k]);
            f64::from(off(k) - off(k - 1)).powi(2)
        });
        let step = (moves.sum::<f64>() / 3600.0).sqrt();
        assert!((0.10 * 15.75..0.20 * 15.75).contains(&step), "{step}");
    }

    #[test]
    fn the_peak_is_the_structures_and_not_the_sensors() {
        let (_, _, plain) = play(&settings(|_| ()), 1000);
        assert!((20e-6..60e-6).contains(&plain.peak_m), "{}", plain.peak_m);
        let odd = |chain: &mut Chain| (chain.sensor.gain, chain.sensor.offset_m) = (1.5, 10e-6);
        let (_, _, odd) = play(&settings(odd), 1000);
        assert_eq!(odd.peak_m, plain.peak_m);
    }

    #[test]
    fn a_lost_command_leaves_the_amplifier_where_it_is() {
        let (clean, clean_monitor, _) = play(&settings(|_| ()), 4000);
        let lossy = settings(|chain| chain.drive.lost_share = 0.05);
        let (adc, monitor, _) = play(&lossy, 4000);
        assert!(differing(&adc, &clean) > 100);
        // The monitor shows the command of the sample before, or, where that was lost, what it showed then. Binomial: 200 and 13.8, four
        // of them; a few lost ones don't show, because the sine's codes are the same twice at its crests.
        let repeats = |monitor: &[u16]| monitor.windows(2).filter(|two| two[0] == two[1]).count();
        let held = repeats(&monitor) - repeats(&clean_monitor);
        assert!((130..=256).contains(&held), "{held}");
        for (k, shown) in monitor.iter().enumerate().skip(1) {
            assert!(*shown == clean_monitor[k] || *shown == monitor[k - 1], "row {k}");
        }
        assert_eq!(play(&lossy, 4000).0, adc);
    }
}
