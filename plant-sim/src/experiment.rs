//! Experiments on the simulated bench: a SPEC as the board would play it, in open loop or through the control law.
//!
//! The control law and the waveforms are `control-core`'s own, in f32, as they run on a board.

use crate::chain::{Arrivals, Chain, Held, SensorState, Simulator};
use crate::log::{Log, Meta};
use crate::margins::Loop;
use crate::replay::{Reader, Start};
use crate::spec::{self, Part, Shape, Spec, SpecError, Unit};
use control_core::{
    Generator, GeneratorState, Inverse, InverseState, Law, LawState, Limits, Segment, Settings, Shaper, ShaperState,
};
use std::fmt;

/// Bounds that `,shaped` puts on a waveform: rate and acceleration, in metres (or volts) per second and per second squared.
///
/// A 100 um, 150 Hz sine needs 0.094 m/s and 89 m/s^2. The volts are those of the thesis' bender for the same motion.
const SHAPED_M: [f32; 2] = [0.2, 200.0];
const SHAPED_V: [f32; 2] = [1.0e5, 1.0e8];

/// A SPEC laid out in samples: the tables it needs, and how long each part lasts.
#[derive(Clone, Debug)]
pub struct Program {
    rate_hz: f64,
    unit: Option<Unit>,
    shaped: bool,
    parts: Vec<(Part, Vec<Vec<f32>>)>,
}

fn fail(part: &Part, reason: String) -> SpecError {
    SpecError { part: part.shape.kind().to_owned(), reason, in_file: matches!(part.shape, Shape::File { .. }) }
}

impl Program {
    /// Lays `spec` out at `rate_hz`.
    ///
    /// # Errors
    /// A part that can't be played at this rate.
    pub fn new(spec: &Spec, rate_hz: f64) -> Result<Self, SpecError> {
        let mut parts = Vec::new();
        for mut part in spec.parts.iter().flat_map(Part::generated) {
            let mut tables =
                spec::table(&part.shape, rate_hz).map_err(|reason| fail(&part, reason))?.unwrap_or_default();
            tables.iter_mut().flatten().for_each(|sample| *sample = (f64::from(*sample) * part.amplitude) as f32);
            // A file is as long as its samples.
            if let (None, Shape::File { .. }, [table]) = (part.seconds, &part.shape, tables.as_slice()) {
                part.seconds = Some(table.len() as f64 / rate_hz);
            }
            parts.push((part, tables));
        }
        let program = Self { rate_hz, unit: spec.unit, shaped: spec.shaped(), parts };
        program.segments()?;
        Ok(program)
    }

    /// Whether amplitudes are metres (a reference) or volts (a command); `None` for zeros.
    pub fn unit(&self) -> Option<Unit> {
        self.unit
    }

    /// Samples that the parts with a length take together, if all of them have one.
    pub fn samples(&self) -> Option<usize> {
        let have_lengths = self.parts.iter().all(|(part, _)| part.seconds.is_some());
        let segments = self.segments().ok().filter(|_| have_lengths)?;
        Some(segments.iter().map(|segment| segment.samples() as usize).sum())
    }

    /// The board's segments.
    fn segments(&self) -> Result<Vec<Segment<'_>>, SpecError> {
        let mut segments = Vec::new();
        let rate = self.rate_hz as f32;
        for (part, tables) in &self.parts {
            let amplitude = part.amplitude as f32;
            let whole = |seconds: f64| (seconds * self.rate_hz).round().clamp(1.0, f64::from(u32::MAX)) as u32;
            let samples = part.seconds.map_or(u32::MAX, whole);
            let add = |e: control_core::SegmentError| fail(part, e.to_string());
            let segment = match &part.shape {
                Shape::Zero => Segment::zero(samples).map_err(add)?,
                Shape::Hold => Segment::hold(amplitude, samples).map_err(add)?,
                Shape::Step => Segment::step(amplitude, samples).map_err(add)?,
                Shape::Square { hz } => Segment::square(rate, amplitude, *hz as f32, samples).map_err(add)?,
                Shape::Sine { hz } => Segment::sine(rate, amplitude, *hz as f32, samples).map_err(add)?,
                Shape::DecayingSine { hz } => {
                    Segment::decaying_sine(rate, amplitude, *hz as f32, samples).map_err(add)?
                }
                Shape::Triangle { hz } => Segment::triangle(rate, amplitude, *hz as f32, samples).map_err(add)?,
                Shape::Sweep { hz, log: false } => {
                    Segment::linear_sweep(rate, amplitude, hz[0] as f32, hz[1] as f32, samples).map_err(add)?
                }
                Shape::Sweep { hz, log: true } => {
                    Segment::log_sweep(rate, amplitude, hz[0] as f32, hz[1] as f32, samples).map_err(add)?
                }
                Shape::Ladder { levels, hold_s } => Segment::ladder(amplitude, *levels, whole(*hold_s)).map_err(add)?,
                Shape::Multisine { periods, .. } => {
                    // As many realisations as the length has room for; the last one goes on until its end.
                    let mut left = samples;
                    for (index, table) in tables.iter().enumerate() {
                        let own = periods.saturating_mul(table.len() as u32);
                        let take = if index + 1 == tables.len() { left } else { own.min(left) };
                        if take > 0 {
                            segments.push(Segment::table(table, take).map_err(add)?);
                        }
                        left -= take;
                    }
                    continue;
                }
                // There are none: they are generated as sines.
                Shape::MinorLoops { .. } => continue,
                Shape::File { .. } => {
                    let table = tables.first().map_or(&[][..], Vec::as_slice);
                    Segment::table(table, samples).map_err(add)?
                }
            };
            segments.push(segment);
        }
        Ok(segments)
    }
}

/// What an experiment recorded, one entry per sample, SI units.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Time between samples in seconds.
    pub dt_s: f64,
    /// What was asked for, before clamp and shaping; empty in open loop.
    pub reference_m: Vec<f64>,
    /// What the sensor read.
    pub displacement_m: Vec<f64>,
    /// Command after each reading, as the controller wrote it, whether it arrived or not.
    pub command_v: Vec<f64>,
    /// Limits that acted in open or closed loop.
    pub limited_by: Vec<Limits>,
    /// Largest magnitude of the true displacement at any sample, metres.
    pub peak_m: f64,
}

/// How an experiment is run.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// The bench.
    pub chain: &'a Chain,
    /// Its state at the first sample.
    pub start: &'a Start,
    /// Samples per second.
    pub rate_hz: f64,
    /// Samples to record.
    pub samples: usize,
    /// From sampling to the new drive, seconds.
    pub latency_s: f64,
    /// Seed of the sensor's noise and of the commands that are lost.
    pub seed: u64,
}

/// The simulated bench, one sample after the other: [`Bench::read_m`], then [`Bench::apply`]. Whoever decides in between closes the loop.
pub struct Bench {
    simulator: Simulator,
    sensor: SensorState,
    arrivals: Arrivals,
    held_v: f64,
    dt_s: f64,
}

impl fmt::Debug for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bench").field("held_v", &self.held_v).finish_non_exhaustive()
    }
}

impl Bench {
    /// At the first sample of `setup`.
    pub fn new(setup: &Setup<'_>) -> Bench {
        let dt_s = 1.0 / setup.rate_hz;
        let mut simulator = Simulator::new(setup.chain, dt_s, setup.latency_s);
        simulator.start_from(&setup.start.state, setup.start.drive_v);
        Bench {
            simulator,
            sensor: SensorState::new(&setup.chain.sensor, setup.seed),
            arrivals: Arrivals::new(&setup.chain.drive, setup.seed),
            held_v: setup.start.drive_v,
            dt_s,
        }
    }

    /// What the sensor reads at this sample; to be called once a sample, because noise is drawn.
    pub fn read_m(&mut self) -> f64 {
        let ideal_m = self.simulator.reading_m();
        self.sensor.read_m(ideal_m, self.simulator.motion().1, self.dt_s)
    }

    /// Where the structure truly is.
    pub fn moved_m(&self) -> f64 {
        self.simulator.motion().0
    }

    /// The command that the drive holds: the last one that arrived.
    pub fn held_v(&self) -> f64 {
        self.held_v
    }

    /// Holds `command_v` from the setup's latency on, unless the drive loses it, and moves on to the next sample.
    pub fn apply(&mut self, command_v: f64) {
        if self.arrivals.next_arrives() {
            self.held_v = command_v;
        }
        self.simulator.advance(Held::zero_order(self.held_v), 0.0);
    }
}

/// Runs `program` as the reference of the control law with `settings`.
///
/// `progress` is told the samples done, a few hundred times.
///
/// # Errors
/// Settings or a program that the law can't run with.
pub fn closed_loop(
    setup: &Setup<'_>,
    settings: &Settings,
    program: &Program,
    progress: &dyn Fn(usize),
) -> Result<Recording, ExperimentError> {
    closed_loop_inverse(setup, settings, None, program, progress)
}

/// The same with the inverse of a plant, if any, in place of the static feedforward.
///
/// # Errors
/// As [`closed_loop`].
pub fn closed_loop_inverse(
    setup: &Setup<'_>,
    settings: &Settings,
    inverse: Option<&Inverse>,
    program: &Program,
    progress: &dyn Fn(usize),
) -> Result<Recording, ExperimentError> {
    let law = Law::try_build(settings)?;
    let mut state = LawState::default();
    let mut inverse_state = InverseState::default();
    run(setup, program, SHAPED_M, progress, |recording, reference_m, reading_m| {
        let output = match inverse {
            None => law.step(&mut state, reference_m, reading_m as f32),
            Some(inverse) => law.step_inverse(&mut state, inverse, &mut inverse_state, reference_m, reading_m as f32),
        };
        recording.reference_m.push(f64::from(reference_m));
        (f64::from(output.drive_v), output.limited_by)
    })
}

/// Runs `program` as the command, in volts; the drive of the chain limits it, nothing else does.
///
/// # Errors
/// A program that can't be played.
pub fn open_loop(setup: &Setup<'_>, program: &Program, progress: &dyn Fn(usize)) -> Result<Recording, ExperimentError> {
    let range_v = setup.chain.drive.range_v;
    run(setup, program, SHAPED_V, progress, |_, command_v, _| {
        let command_v = f64::from(command_v);
        let beyond = command_v < range_v[0] || command_v > range_v[1];
        (command_v, if beyond { Limits::VOLT } else { Limits::NONE })
    })
}

/// How far a command in volts goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Lowest and highest command.
    pub command_v: [f64; 2],
    /// Farthest that it moves the structure on either side, metres.
    pub peak_m: f64,
}

/// How far `program`, as a command in volts, goes. Nothing is kept, so that hours take no memory.
///
/// # Errors
/// A program that can't be played.
pub fn open_loop_reach(setup: &Setup<'_>, program: &Program) -> Result<Reach, SpecError> {
    let segments = program.segments()?;
    let (generator, mut state) = (Generator::new(&segments), GeneratorState::default());
    let mut bench = Bench::new(setup);
    let mut reach = Reach { command_v: [f64::INFINITY, f64::NEG_INFINITY], peak_m: 0.0 };
    for _ in 0..setup.samples {
        let command_v = f64::from(generator.next(&mut state));
        bench.apply(command_v);
        let [low, high] = reach.command_v;
        reach = Reach {
            command_v: [low.min(command_v), high.max(command_v)],
            peak_m: reach.peak_m.max(bench.moved_m().abs()),
        };
    }
    Ok(reach)
}

/// Why an experiment can't be run.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The controller's settings.
    #[error("controller: {0}")]
    Settings(#[from] control_core::SettingsError),
    /// The SPEC.
    #[error(transparent)]
    Spec(#[from] SpecError),
}

/// The loop that both kinds share: read, decide (`decide` gets the waveform's sample and the reading), move on.
fn run(
    setup: &Setup<'_>,
    program: &Program,
    shaped: [f32; 2],
    progress: &dyn Fn(usize),
    mut decide: impl FnMut(&mut Recording, f32, f64) -> (f64, Limits),
) -> Result<Recording, ExperimentError> {
    let segments = program.segments()?;
    let generator = Generator::new(&segments);
    let mut generator_state = GeneratorState::default();
    let rate = setup.rate_hz as f32;
    // A file's amplitude is its unit; how far it reaches is in its samples.
    let reach = |(part, tables): &(Part, Vec<Vec<f32>>)| {
        let amplitude = if tables.is_empty() { part.amplitude.abs() as f32 } else { 0.0 };
        tables.iter().flatten().fold(amplitude, |reach, sample| reach.max(sample.abs()))
    };
    let largest = program.parts.iter().map(reach).fold(0.0, f32::max);
    let mut shaper = if program.shaped {
        Some((Shaper::try_build(rate, 2.0 * largest.max(1e-9), shaped[0], shaped[1])?, ShaperState::default()))
    } else {
        None
    };
    let mut bench = Bench::new(setup);
    let mut recording = Recording { dt_s: bench.dt_s, ..Recording::default() };
    let (has_own_clock, mut held_v) = (setup.chain.sensor.has_own_clock(), Vec::new());
    let report_every = (setup.samples / 200).max(1);
    for sample in 0..setup.samples {
        let reading_m = bench.read_m();
        let mut wanted = generator.next(&mut generator_state);
        if let Some((shaper, state)) = &mut shaper {
            wanted = shaper.step(state, wanted).0;
        }
        let (command_v, limited_by) = decide(&mut recording, wanted, reading_m);
        recording.displacement_m.push(reading_m);
        recording.command_v.push(command_v);
        recording.limited_by.push(limited_by);
        recording.peak_m = recording.peak_m.max(bench.moved_m().abs());
        bench.apply(command_v);
        if has_own_clock {
            held_v.push(bench.held_v());
        }
        if sample % report_every == 0 {
            progress(sample);
        }
    }
    if has_own_clock {
        recording.displacement_m = recorded_m(setup, held_v);
    }
    Ok(recording)
}

/// What a sensor with a clock of its own records of a run whose drive held these volts. The loop has read it in time: rows of a recording move,
/// what happens does not.
fn recorded_m(setup: &Setup<'_>, held_v: Vec<f64>) -> Vec<f64> {
    let meta = Meta { latency_s: setup.latency_s, ..Meta::default() };
    let log = Log { dt_s: 1.0 / setup.rate_hz, command_v: held_v, meta, ..Log::default() };
    let mut reader = Reader::new(setup.chain, &log, setup.start);
    let mut sensor = SensorState::new(&setup.chain.sensor, setup.seed);
    let row = |_| {
        let ideal_m = reader.next_m();
        sensor.read_m(ideal_m, reader.stream.motion.1, log.dt_s)
    };
    (0..log.command_v.len()).map(row).collect()
}

/// The loop that `settings` close around `chain`, `latency_s` from sampling to the new command, for the margins of the chain's linear regions.
pub fn sampled_loop(settings: &Settings, rate_hz: f64, latency_s: f64, chain: &Chain) -> Loop {
    Loop {
        kp_v_per_m: f64::from(settings.kp_v_per_m),
        ki_v_per_m_s: f64::from(settings.ki_v_per_m_s),
        rate_hz,
        delay_s: latency_s + chain.drive.delay_s,
    }
}
