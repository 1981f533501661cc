//! Replay: the logged command through the chain, open loop, from a start that fits the log.

use crate::chain::{Chain, Drive, Held, Simulator};
use crate::log::{Hold, Log};
use crate::phs::PhsState;
use crate::resample::{self, Resampler};
use std::collections::VecDeque;

/// What is assumed of the state at a log's first row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Initial {
    /// Everything zero, and zero volts before.
    Relaxed,
    /// In equilibrium, with every hysteron inside its dead zone; which equilibrium is fitted.
    #[default]
    Rest,
    /// Anything: displacement, velocity and hysteron voltages are fitted.
    Fit,
}

impl std::str::FromStr for Initial {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "relaxed" => Ok(Self::Relaxed),
            "rest" => Ok(Self::Rest),
            "fit" => Ok(Self::Fit),
            _ => Err(format!("{text:?} is none of relaxed, rest, fit")),
        }
    }
}

/// A state at the first row, and the drive that was held before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// State when the first row was sampled.
    pub state: PhsState,
    /// Volts that acted until the first command arrived.
    pub drive_v: f64,
    /// What parts with a memory of their own (play, presliding friction) hold, as a share of the most they can: -1 to 1.
    pub memory: f64,
}

impl Start {
    /// Everything zero.
    pub fn relaxed(chain: &Chain) -> Self {
        Self { state: chain.plant.relaxed(), drive_v: 0.0, memory: 0.0 }
    }

    /// The equilibrium under `drive_v` that holds the given hysteron voltages (equation (2.9)).
    pub fn at_rest(chain: &Chain, drive_v: f64, hysteron_v: Vec<f64>) -> Self {
        let acting_v = chain.drive.output_v(drive_v);
        let displacement_m = chain.equilibrium_m(acting_v, &hysteron_v);
        Self { state: PhsState { displacement_m, velocity_m_per_s: 0.0, hysteron_v }, drive_v, memory: 0.0 }
    }

    /// The same with parts that hold `memory`; the structure rests where the friction that is held leaves it.
    pub fn remembering(mut self, chain: &Chain, memory: f64) -> Self {
        self.state.displacement_m -= memory * chain.parts.holdable_n() / chain.plant.stiffness_n_per_m;
        Self { memory, ..self }
    }
}

/// Pieces of a sample's line where a law bends along it.
const LINE_PIECES: usize = 16;

/// Feeds commands one by one, as a log's `hold` says, and reads the displacement before each.
///
/// What a hold needs to know of the commands to come is [`Player::look_ahead`]. Where fewer are known the last one is held, as at the
/// end of a log.
pub struct Player {
    simulator: Simulator,
    sample_s: f64,
    pieces: usize,
    hold: Hold,
    resampler: Resampler,
}

impl Player {
    /// A chain ready to play rows that are `sample_s` apart.
    pub fn new(chain: &Chain, sample_s: f64, latency_s: f64, hold: Hold, start: &Start) -> Self {
        // A band-limited command is stepped through piece by piece, and so is a line that a transducer's hysteresis bends: by then
        // 10 V a sample leave 1e-10 of full scale.
        let pieces = match hold {
            Hold::Bandlimited => resample::PIECES,
            Hold::Foh if chain.parts.transducer.is_some() => LINE_PIECES,
            Hold::Foh | Hold::Zoh => 1,
        };
        let sample_s = sample_s / pieces as f64;
        let mut simulator = Simulator::new(chain, sample_s, latency_s);
        simulator.start_from(&start.state, start.drive_v);
        simulator.remember(start.memory);
        Self { simulator, sample_s, pieces, hold, resampler: Resampler::default() }
    }

    /// How many of the commands after a row's own this log's `hold` calls for.
    pub fn look_ahead(&self) -> usize {
        match self.hold {
            Hold::Zoh => 0,
            Hold::Foh => 1,
            Hold::Bandlimited => resample::AHEAD,
        }
    }

    /// Reading of an ideal sensor at this row in metres; then moves to the next row.
    ///
    /// `commands_v` are the row's own command and those after it, [`Player::look_ahead`] of them.
    pub fn step(&mut self, commands_v: &[f64], force_n: f64) -> f64 {
        let reading_m = self.simulator.reading_m();
        let command_v = commands_v.first().copied().unwrap_or(0.0);
        match self.hold {
            Hold::Zoh => self.simulator.advance(Held::zero_order(command_v), force_n),
            Hold::Foh => {
                let next_v = commands_v.get(1).copied().unwrap_or(command_v);
                let pieces = self.pieces;
                let at = |piece: usize| command_v + (next_v - command_v) * piece as f64 / pieces as f64;
                for piece in 0..pieces {
                    self.line(at(piece), at(piece + 1), force_n);
                }
            }
            Hold::Bandlimited => {
                for ends_v in self.resampler.points(commands_v).windows(2) {
                    self.line(ends_v[0], ends_v[1], force_n);
                }
            }
        }
        reading_m
    }

    fn line(&mut self, from_v: f64, to_v: f64, force_n: f64) {
        let held = Held { start_v: from_v, slope_v_per_s: (to_v - from_v) / self.sample_s };
        self.simulator.advance(held, force_n);
    }

    /// Voltage of each hysteron now.
    pub fn hysteron_v(&self) -> Vec<f64> {
        self.simulator.state().hysteron_v
    }
}

/// Readings in metres that an ideal sensor would have logged, one per row of `log` (or of its first `rows` rows).
pub fn predict(chain: &Chain, log: &Log, start: &Start, rows: usize) -> Vec<f64> {
    let mut readings_m = Vec::with_capacity(rows.min(log.command_v.len()));
    play(chain, log, start, rows, |reading_m, _| readings_m.push(reading_m));
    readings_m
}

/// Plays `log` (or its first `rows` rows); `after` gets each row's reading in metres, and the player once it has moved on.
pub fn play(chain: &Chain, log: &Log, start: &Start, rows: usize, mut after: impl FnMut(f64, &Player)) {
    let mut reader = Reader::new(chain, log, start);
    for _ in 0..rows.min(log.len()) {
        let reading_m = reader.next_m();
        after(reading_m, &reader.player);
    }
}

/// Plays a log row by row.
pub struct Reader<'a> {
    log: &'a Log,
    player: Player,
    ahead: usize,
    clock: Option<Clock>,
    row: usize,
    /// Volts at the actuator and motion of the structure (metres, m/s) when the last row was read.
    pub drive_v: f64,
    /// See `drive_v`.
    pub motion: (f64, f64),
    /// Displacement behind the sensor's play and lag, metres, and the time, seconds, that the last reading was made of, if the log has one clock.
    pub before_reading: (f64, f64),
}

impl<'a> Reader<'a> {
    /// Before the first row of `log`.
    pub fn new(chain: &Chain, log: &'a Log, start: &Start) -> Self {
        let player = Player::new(chain, log.dt_s, log.meta.latency_s, log.meta.hold, start);
        let ahead = 1 + player.look_ahead();
        let (ratio, drift_per_s) = (chain.sensor.clock_ratio, chain.sensor.clock_drift_per_s);
        let half_drift = 0.5 * drift_per_s * log.dt_s;
        let clock = (ratio != 0.0 || half_drift != 0.0).then(|| Clock {
            ratio,
            half_drift,
            known_m: VecDeque::new(),
            taken: 0,
            kinks: Kinks::of(chain, log, start),
        });
        Self { log, player, ahead, clock, row: 0, drive_v: 0.0, motion: (0.0, 0.0), before_reading: (0.0, 0.0) }
    }

    /// Reading of an ideal sensor at the next row, metres. Beyond the log's end the last command is held.
    pub fn next_m(&mut self) -> f64 {
        let row = self.row;
        self.row += 1;
        let simulator = &self.player.simulator;
        (self.drive_v, self.motion, self.before_reading) =
            (simulator.drive_v(), simulator.motion(), simulator.before_reading());
        let Some(mut clock) = self.clock.take() else { return self.step(row) };
        while clock.lacks(row) {
            let reading_m = self.step(clock.taken);
            clock.take(reading_m);
        }
        let reading_m = clock.read_m(row, &self.log.command_v);
        self.clock = Some(clock);
        reading_m
    }

    fn step(&mut self, row: usize) -> f64 {
        let n_rows = self.log.len();
        let k = row.min(n_rows - 1);
        let force_n = self.log.force_n.as_ref().map_or(0.0, |f| f[k]);
        self.player.step(&self.log.command_v[k..(k + self.ahead).min(n_rows)], force_n)
    }
}

/// Readings that an interpolation goes through.
const NODES: usize = 4;

/// Readings at another clock's instants: row k of a log is read at k (1 + ratio + half_drift k) samples of the drive's clock.
struct Clock {
    ratio: f64,
    /// Half the change of the ratio from one sample to the next.
    half_drift: f64,
    /// The last readings at the drive's instants.
    known_m: VecDeque<f64>,
    /// Readings taken in all.
    taken: usize,
    kinks: Option<Kinks>,
}

impl Clock {
    /// The instant of row `k` in samples of the drive's clock.
    fn instant(&self, k: usize) -> f64 {
        let k = k as f64;
        (k * (1.0 + self.ratio + self.half_drift * k)).max(0.0)
    }

    /// Whether the two readings after row `k`'s instant are still to come.
    fn lacks(&self, k: usize) -> bool {
        (self.taken as f64) < self.instant(k).floor() + 3.0
    }

    fn take(&mut self, reading_m: f64) {
        self.known_m.push_back(reading_m);
        self.taken += 1;
        if self.known_m.len() > NODES {
            self.known_m.pop_front();
        }
    }

    /// Cubic through the four readings around row `k`'s instant, less what the edges of `command_v` bend between them.
    fn read_m(&self, k: usize, command_v: &[f64]) -> f64 {
        let first = self.taken - self.known_m.len();
        let at = self.instant(k) - first as f64;
        let nodes = self.known_m.len();
        let weight = |i: usize| -> f64 {
            (0..nodes).filter(|&j| j != i).map(|j| (at - j as f64) / (i as f64 - j as f64)).product()
        };
        let kinks_m = |rows: f64| self.kinks.as_ref().map_or(0.0, |kinks| kinks.displacement_m(command_v, first, rows));
        let smooth = |(i, reading_m): (usize, &f64)| weight(i) * (reading_m - kinks_m(i as f64));
        self.known_m.iter().enumerate().map(smooth).sum::<f64>() + kinks_m(at)
    }
}

/// The edges of a held command in the displacement: each is a jump of the acceleration by alpha / m times its volts, which no polynomial
/// through readings around it follows. What the structure makes of it, hysterons closed, is taken out before and put back after; what hysterons
/// do besides is slower.
struct Kinks {
    drive: Drive,
    /// Reading's acceleration for a volt, m/s^2.
    per_volt_m_per_s2: f64,
    /// Damping over mass, 1/s, and stiffness over mass, 1/s^2.
    damping_per_s: f64,
    stiffness_per_s2: f64,
    sample_s: f64,
    /// From a row's instant to the edge of its command, in samples.
    late: f64,
    /// Response to a unit jump, s^2, at the first row's instant after it and those that follow.
    at_rows_s2: [f64; NODES],
    /// Command before the first.
    before_v: f64,
}

impl Kinks {
    /// Those of `log`; none where the edges are lines or are rounded before they reach the reading.
    fn of(chain: &Chain, log: &Log, start: &Start) -> Option<Self> {
        let Chain { drive, plant, parts, sensor } = chain;
        let is_sharp = log.meta.hold == Hold::Zoh
            && !drive.has_memory()
            && drive.warming.is_none()
            && drive.swings.is_empty()
            && parts.transducer.is_none()
            && sensor.lag.is_none();
        if !is_sharp {
            return None;
        }
        let alpha = plant.transduction_c_per_m;
        let closed: f64 = plant.hysterons.iter().map(|hysteron| alpha * alpha / hysteron.capacitance_f).sum();
        let mut kinks = Self {
            drive: drive.clone(),
            per_volt_m_per_s2: sensor.gain * alpha / plant.mass_kg,
            damping_per_s: plant.damping_n_s_per_m / plant.mass_kg,
            stiffness_per_s2: (plant.stiffness_n_per_m + closed) / plant.mass_kg,
            sample_s: log.dt_s,
            late: (log.meta.latency_s + drive.delay_s) / log.dt_s,
            at_rows_s2: [0.0; NODES],
            before_v: start.drive_v,
        };
        for row in 0..NODES {
            kinks.at_rows_s2[row] = kinks.response_s2(row as f64 + 1.0 - kinks.late.fract());
        }
        Some(kinks)
    }

    /// What a unit jump of the acceleration has moved `rows` after it: y'' + c y' + w y = 1 from rest, s^2.
    fn response_s2(&self, rows: f64) -> f64 {
        let (t, half, w) = (rows * self.sample_s, 0.5 * self.damping_per_s, self.stiffness_per_s2);
        let turning2 = w - half * half;
        let turning = turning2.abs().sqrt().max(1e-3 * half);
        let (cos, sin) = if turning2 > 0.0 {
            let left = (-half * t).exp();
            (left * (turning * t).cos(), left * (turning * t).sin())
        } else {
            // Not as cosh and sinh, which overflow where the samples are long.
            let [slow, fast] = [half - turning, half + turning].map(|rate_per_s| (-rate_per_s * t).exp());
            (0.5 * (slow + fast), 0.5 * (slow - fast))
        };
        (1.0 - (cos + half / turning * sin)) / w
    }

    /// What the edges after row `first` have moved the reading by, `rows` later.
    fn displacement_m(&self, command_v: &[f64], first: usize, rows: f64) -> f64 {
        let since = first as f64 - self.late;
        let from = since.floor().max(-1.0) as isize + 1;
        let edges = (from..)
            .map(|j| (j as usize, rows - (j as f64 - since)))
            .take_while(|(j, after)| *after > 0.0 && *j < command_v.len());
        let moved = |(j, after): (usize, f64)| {
            let before_v = if j == 0 { self.before_v } else { command_v[j - 1] };
            let jump_v = self.drive.output_v(command_v[j]) - self.drive.output_v(before_v);
            let response_s2 = if rows.fract() == 0.0 {
                self.at_rows_s2[(after + self.late.fract()).round() as usize - 1]
            } else {
                self.response_s2(after)
            };
            self.per_volt_m_per_s2 * jump_v * response_s2
        };
        edges.map(moved).sum()
    }
}
