//! Replay: the logged command through the chain, open loop, from a start that fits the log.

mod clock;

use crate::chain::{Chain, Held, Reading, Simulator};
use crate::log::{Hold, Log, Meta};
use crate::phs::PhsState;
use crate::resample::{self, Resampler};
use clock::{Clock, Row};

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
    /// How far each of the chain's oscillators, its modes and then its arms, is from where it rests in metres, and its velocity in m/s; those beyond the
    /// list are at rest.
    pub modes: Vec<[f64; 2]>,
    /// What parts with a memory of their own (play, presliding friction) hold, as a share of the most they can: -1 to 1.
    pub memory: f64,
}

impl Start {
    /// Everything zero.
    pub fn relaxed(chain: &Chain) -> Self {
        Self { state: chain.plant.relaxed(), drive_v: 0.0, modes: Vec::new(), memory: 0.0 }
    }

    /// The equilibrium under `drive_v` that holds the given hysteron voltages (equation (2.9)).
    pub fn at_rest(chain: &Chain, drive_v: f64, hysteron_v: Vec<f64>) -> Self {
        let acting_v = chain.drive.output_v(drive_v);
        let displacement_m = chain.equilibrium_m(acting_v, &hysteron_v);
        Self {
            state: PhsState { displacement_m, velocity_m_per_s: 0.0, hysteron_v },
            drive_v,
            modes: Vec::new(),
            memory: 0.0,
        }
    }

    /// The same with parts that hold `memory`; the structure rests where the friction that is held leaves it.
    pub fn remembering(mut self, chain: &Chain, memory: f64) -> Self {
        self.state.displacement_m -= memory * chain.parts.holdable_n() / chain.plant.stiffness_n_per_m;
        Self { memory, ..self }
    }
}

/// Pieces of a sample's line where a law bends along it.
const LINE_PIECES: usize = 16;

/// Pieces that a row is stepped through in. A band-limited command is more than one, and so is a line that a transducer's hysteresis bends: by then
/// 10 V a sample leave 1e-10 of full scale.
fn pieces(chain: &Chain, hold: Hold) -> usize {
    match hold {
        Hold::Bandlimited => resample::PIECES,
        Hold::Foh if chain.parts.transducer.is_some() => LINE_PIECES,
        Hold::Foh | Hold::Zoh => 1,
    }
}

/// The sensor of `chain`, read at the samples that a [`Stream`] of `log` numbers; see [`Stream::before_reading`].
pub fn reading_of(chain: &Chain, log: &Log) -> Reading {
    Reading::new(&chain.sensor, log.dt_s / pieces(chain, log.meta.hold) as f64)
}

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
        let pieces = pieces(chain, hold);
        let sample_s = sample_s / pieces as f64;
        let mut simulator = Simulator::new(chain, sample_s, latency_s);
        simulator.start_from(&start.state, start.drive_v);
        simulator.swing(&chain.parts, &start.modes);
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
        after(reading_m, &reader.stream.player);
    }
}

/// Commands and external forces of a log, of which one that is read as it comes shows some rows at a time.
#[derive(Clone, Copy, Debug)]
pub struct Commands<'a> {
    /// The log's row that the slices begin with.
    pub first: usize,
    /// Volts.
    pub command_v: &'a [f64],
    /// Newtons, if the log has any; as many rows.
    pub force_n: Option<&'a [f64]>,
}

impl<'a> From<&'a Log> for Commands<'a> {
    fn from(log: &'a Log) -> Self {
        Self { first: 0, command_v: &log.command_v, force_n: log.force_n.as_deref() }
    }
}

impl Commands<'_> {
    /// Volts of `row`, if it is among these.
    fn volts(&self, row: usize) -> Option<f64> {
        self.command_v.get(row.checked_sub(self.first)?).copied()
    }
}

/// Reads row by row what an ideal sensor would have logged, while the log's commands come in.
///
/// [`Stream::needs`] is what has to be known of them before each [`Stream::next_m`]. A clock that is not the drive's makes that more than the rows
/// that the log's `hold` calls for.
pub struct Stream {
    player: Player,
    ahead: usize,
    clock: Option<Clock>,
    row: usize,
    /// Volts at the actuator and motion of the structure (metres, m/s) when the last row was read.
    pub drive_v: f64,
    /// See `drive_v`.
    pub motion: (f64, f64),
    /// Displacement behind the sensor's play and lag, metres, that the last reading was made of, and its sample's number, if the log has one clock.
    pub before_reading: (f64, u64),
}

impl Stream {
    /// Before the first row of a log whose rows are `sample_s` apart.
    pub fn new(chain: &Chain, sample_s: f64, meta: &Meta, start: &Start) -> Self {
        let player = Player::new(chain, sample_s, meta.latency_s, meta.hold, start);
        let ahead = 1 + player.look_ahead();
        let clock = Clock::of(chain, sample_s, meta, start);
        Self { player, ahead, clock, row: 0, drive_v: 0.0, motion: (0.0, 0.0), before_reading: (0.0, 0) }
    }

    /// Rows that have to be known before the next one is read: from the first to before the second, or as many as the log has.
    pub fn needs(&self) -> [usize; 2] {
        match &self.clock {
            None => [self.row, self.row + self.ahead],
            Some(clock) => {
                let [from, to] = clock.needs(self.row);
                [from, to + self.ahead]
            }
        }
    }

    /// Reading of an ideal sensor at the next row, metres. Beyond the log's end the last command is held.
    pub fn next_m(&mut self, commands: Commands<'_>) -> f64 {
        let row = self.row;
        self.row += 1;
        let simulator = &self.player.simulator;
        (self.drive_v, self.motion, self.before_reading) =
            (simulator.drive_v(), simulator.motion(), simulator.before_reading());
        let Some(mut clock) = self.clock.take() else { return self.step(row, commands) };
        while clock.lacks(row) {
            let (displacement_m, velocity_m_per_s) = self.player.simulator.motion();
            let reading_m = self.step(clock.taken(), commands);
            clock.take(Row { reading_m, displacement_m, velocity_m_per_s });
        }
        let reading_m = clock.read_m(row, commands);
        self.clock = Some(clock);
        reading_m
    }

    fn step(&mut self, row: usize, commands: Commands<'_>) -> f64 {
        let n_rows = commands.command_v.len();
        let k = (row - commands.first).min(n_rows - 1);
        let force_n = commands.force_n.map_or(0.0, |f| f[k]);
        self.player.step(&commands.command_v[k..(k + self.ahead).min(n_rows)], force_n)
    }
}

/// Plays a log row by row.
pub struct Reader<'a> {
    commands: Commands<'a>,
    /// What plays it.
    pub stream: Stream,
}

impl<'a> Reader<'a> {
    /// Before the first row of `log`.
    pub fn new(chain: &Chain, log: &'a Log, start: &Start) -> Self {
        Self { commands: log.into(), stream: Stream::new(chain, log.dt_s, &log.meta, start) }
    }

    /// See [`Stream::next_m`].
    pub fn next_m(&mut self) -> f64 {
        self.stream.next_m(self.commands)
    }
}
