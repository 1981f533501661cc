//! The true bench and its integrator.
//!
//! The equations are those of thesis (2.4) to (2.9), plus whatever parts the case has:
//!
//!   q' = w,   M w' = alpha (V - sum v_i) - k q - b w + forces,   v_i' = (alpha w - h_i(v_i)) / C_i
//!
//! Scheme: staggered leapfrog. Positions, hysteron voltages and all other states that follow the motion live on whole
//! steps, the velocity on half steps. A hysteron's step at constant velocity is exact, so its stiffness (0.94 us) sets
//! no limit; damping is implicit. The scheme is symmetric and of second order, and an equilibrium is a fixed point of
//! it: all forces act in one kick, so nothing rattles at rest for the fast dead zone to rectify into a false creep.
//! Drive parts work with the mean voltage of each kick interval, so edges may fall anywhere.

use crate::digitise::{Digitise, Noise};
use crate::drive::{Drive, DrivePlace, Memory};
use crate::hysteron::{Hysteron, Prepared};
use crate::record::Record;
use crate::sensor::{Follow, Measure, Row, normal};
use crate::structure::Force;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Integration step of every record. Measured against half of it: 0.26 nm on a step train (`integrator_tests`).
pub(crate) const STEP_S: f64 = 1e-6;

/// From a row's sampling to its command's new edge, in every log.
pub(crate) const LATENCY_US: f64 = 10.0;
/// Rows by which a sampling time errs at random at the most: beyond half a row, two could change places.
pub(crate) const JITTER_ROWS: f64 = 0.45;
/// The same for an edge that is late and early by turns.
pub(crate) const TURN_ROWS: f64 = 0.4;
/// Steps of the integrator within which two instants are one.
const ROUNDING: f64 = 1e-3;

/// A bench with everything that is true of it.
#[derive(Clone, Debug)]
pub struct Bench {
    /// Transduction in C/m, which is N/V (alpha).
    pub(crate) transduction_c_per_m: f64,
    /// Moving mass.
    pub(crate) mass_kg: f64,
    /// Viscous damping (b).
    pub(crate) damping_n_s_per_m: f64,
    /// Mechanical stiffness (k).
    pub(crate) stiffness_n_per_m: f64,
    /// Fast one, slow one, then any others.
    pub(crate) hysterons: Vec<Hysteron>,
    /// Between command and force, in this order.
    pub(crate) drives: Vec<Drive>,
    /// On the mass.
    pub(crate) forces: Vec<Force>,
    /// Between mass and sample, in this order.
    pub(crate) follows: Vec<Follow>,
    /// On each row before the noise.
    pub(crate) measures: Vec<Measure>,
    /// On each row after it.
    pub(crate) digitises: Vec<Digitise>,
    /// When rows and edges really happen.
    pub(crate) timing: Timing,
    /// The sensor's own noise.
    pub(crate) noise: Noise,
    /// Offset of the sensor that any bench has.
    pub(crate) offset_m: f64,
    /// Dead zones that grow with drive power (foreign): share per reference power, time constant in seconds.
    pub(crate) heated: Option<(f64, f64)>,
    /// What came before row 0.
    pub(crate) history: History,
    /// What disturbs row 0.
    pub(crate) start: Start,
}

impl Bench {
    /// Puts the parts in the order of the signal, whatever they were planted in. Those of one place keep theirs.
    pub(crate) fn put_in_order(&mut self) {
        self.drives.sort_by_key(Drive::place);
        self.follows.sort_by_key(Follow::place);
        self.measures.sort_by_key(Measure::place);
        self.digitises.sort_by_key(Digitise::place);
    }
}

/// Errors in time and of the link.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Timing {
    /// Delay between the logged edge and the real one.
    pub command_delay_s: f64,
    /// Delay between the motion and the row that shows it.
    pub measure_delay_s: f64,
    /// Row k is sampled at t_k (1 + clock_error).
    pub clock_error: f64,
    /// The clock error swings with this period if positive (a temperature-cycled oscillator).
    pub clock_swing_s: f64,
    /// The clock's slip is put right each time this has passed, if positive.
    pub clock_sync_s: f64,
    /// Share of the clock error that goes with this time constant in seconds after row 0 (an oven that warms).
    pub clock_settling: Option<(f64, f64)>,
    /// Edges of odd rows are later by this, those of even rows earlier (two buffers by turns).
    pub edge_turns_s: f64,
    /// Random error of the sampling time.
    pub jitter: Option<Jitter>,
    /// Lost commands: probability per row and how many rows the old value stays.
    pub command_loss: Option<(f64, u32)>,
    /// A link for the commands that has bad times.
    pub bad_link: Option<BadLink>,
    /// Lattice of the command converter; 0 is none.
    pub dac_lsb_v: f64,
    /// Commands that change by more than this reach it in steps of this size (foreign: a limiter nobody told of).
    pub change_limit_v: Option<f64>,
}

/// Two states, the bad one losing each command with the same probability (Gilbert and Elliott).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BadLink {
    /// Probability per row that bad times start.
    pub start: f64,
    /// Rows that they last on average.
    pub rows: f64,
    /// Share of the commands lost meanwhile.
    pub loss: f64,
}

/// Distribution of the sampling-time error, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Jitter {
    /// Within +-half.
    Uniform { half_s: f64 },
    /// Standard deviation.
    Gaussian { rms_s: f64 },
    /// One row in `one_in` is late by an exponentially distributed time.
    RareLate { one_in: f64, mean_s: f64 },
    /// First-order noise of this standard deviation that takes `rows` rows to forget.
    Wandering { rms_s: f64, rows: f64 },
    /// Early or late by this, at random: one of two ticks of a timer.
    TwoTimes { s: f64 },
}

/// Motion before row 0, after which the bench rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum History {
    /// None: relaxed.
    Relaxed,
    /// A decaying sine, then rest.
    Demagnetised { volts: f64, rest_s: f64 },
    /// Random levels, then rest.
    Moved { volts: f64, rest_s: f64 },
    /// One excursion of either sign per log, then a short rest: not at rest at row 0.
    JustMoved { volts: f64, rest_s: f64 },
    /// A sine that is cut off near a random peak, then a short rest.
    JustRang { volts: f64, hz: f64, rest_s: f64 },
    /// A stairway back from one excursion, each step as long as the rest.
    JustClimbed { volts: f64, steps: u32, rest_s: f64 },
    /// A straight way back from one excursion within `ramp_s`, then a short rest.
    JustRamped { volts: f64, ramp_s: f64, rest_s: f64 },
    /// Random levels a few milliseconds each, the last one a large one, then a short rest.
    JustShaken { volts: f64, rest_s: f64 },
}

/// Disturbance of row 0; signs are drawn per log.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Start {
    /// Added to the slow hysteron's voltage, with the mass in balance.
    pub precharge_v: f64,
    /// Added to the mass' velocity.
    pub velocity_m_per_s: f64,
}

/// What decides the command.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source<'a> {
    /// Given volts.
    Open(&'a [f64]),
    /// Own PI on a reference in metres.
    Closed(&'a [f64], Loop),
}

/// A discrete PI with feedforward: I += Ki T e, u = ff r + Kp e + I, frozen where the limit is hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Loop {
    /// Proportional gain.
    pub kp_v_per_m: f64,
    /// Integral gain.
    pub ki_v_per_m_s: f64,
    /// Feedforward gain.
    pub feedforward_v_per_m: f64,
    /// Limit of the command.
    pub limit_v: f64,
}

/// One recording to be made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Session<'a> {
    /// The command's source, one entry per row.
    pub source: Source<'a>,
    /// Rows per second.
    pub rate_hz: f64,
    /// Command during the rest before row 0.
    pub rest_v: f64,
    /// All chance of this recording.
    pub seed: u64,
    /// Whether the amplifier's output is logged too.
    pub monitor: bool,
    /// Integration step.
    pub step_s: f64,
}

/// Plays a command on the bench: row k is sampled, then `command_v[k]` applies after the latency.
pub fn run(bench: &Bench, command_v: &[f64], rate_hz: f64, seed: u64) -> Record {
    record(bench, &open(command_v, rate_hz, seed))
}

/// As `run`, with the amplifier's output monitor (`drive_V`).
pub fn run_monitored(bench: &Bench, command_v: &[f64], rate_hz: f64, seed: u64) -> Record {
    record(bench, &Session { monitor: true, ..open(command_v, rate_hz, seed) })
}

fn open(command_v: &[f64], rate_hz: f64, seed: u64) -> Session<'_> {
    let rest_v = command_v.first().copied().unwrap_or(0.0);
    Session { source: Source::Open(command_v), rate_hz, rest_v, seed, monitor: false, step_s: STEP_S }
}

/// Streams of chance kept apart, so that an added part never shifts the noise of the others.
struct Chance {
    noise: Pcg64,
    parts: Pcg64,
    timing: Pcg64,
    history: Pcg64,
}

impl Chance {
    fn new(seed: u64) -> Self {
        let stream = |salt: u64| Pcg64::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(salt));
        Self { noise: stream(1), parts: stream(2), timing: stream(3), history: stream(4) }
    }
}

/// Makes one recording.
pub(crate) fn record(bench: &Bench, session: &Session) -> Record {
    let mut chance = Chance::new(session.seed);
    let period_s = 1.0 / session.rate_hz;
    let before_v = history(bench.history, session.rest_v, period_s, &mut chance.history);
    let n_before = before_v.len();
    let n_rows = match session.source {
        Source::Open(command_v) => command_v.len(),
        Source::Closed(reference_m, _) => reference_m.len(),
    };
    let mut board = Board::new(bench, session, n_rows, &before_v, period_s);
    let h = session.step_s;
    let t_zero = n_before as f64 * period_s;
    let mut motion = Motion::new(bench, h, t_zero, &mut chance);
    let signs: [f64; 2] = std::array::from_fn(|_| if chance.history.random::<bool>() { 1.0 } else { -1.0 });
    let mut started = bench.start == Start::default();
    let mut reader = Reader::new(bench, period_s, &mut chance.parts);
    let mut sampler = Sampler { timing: &bench.timing, n_before, period_s, wander: 0.0, last_s: f64::NEG_INFINITY };
    let mut next_sample_s = sampler.time(0, &mut chance.timing);
    let mut next_edge_s = board.edge_time(0);
    let mut n_sampled = 0;
    let mut n_edges = 0;
    let mut held_v = 0.0;
    let mut step: u64 = 0;
    let mut y_before = 0.0;
    while n_sampled < n_before + n_rows {
        let t = step as f64 * h;
        let starts = !started && t >= t_zero - 0.5 * h;
        if starts {
            motion.disturb(bench, signs);
            started = true;
        }
        // Mean drive over the kick's interval; an edge inside splits it, for drive parts need not be linear.
        let end = t + 0.5 * h;
        let mut from = t - 0.5 * h;
        let mut mean_v = Volts::default();
        while next_edge_s < end && board.is_decided(n_edges) {
            let part_s = next_edge_s - from;
            if part_s > 1e-12 {
                mean_v = mean_v.plus(motion.drive(bench, held_v, part_s), part_s, h);
                from = next_edge_s;
            }
            held_v = board.command(n_edges, &mut chance.timing);
            n_edges += 1;
            next_edge_s = board.edge_time(n_edges);
        }
        mean_v = if from == t - 0.5 * h {
            motion.drive(bench, held_v, h)
        } else {
            mean_v.plus(motion.drive(bench, held_v, end - from), end - from, h)
        };
        let y = motion.step(bench, mean_v.force_v, t - t_zero, h);
        if starts {
            // Row 0 shows the state that the log starts from, not the one before.
            y_before = y;
        }
        step += 1;
        let t_after = step as f64 * h;
        // Where a row falls on the start to rounding, it is the row after it.
        let is_after = |sample_s: f64| started || sample_s < t_zero - ROUNDING * h;
        while next_sample_s <= t_after && is_after(next_sample_s) && n_sampled < n_before + n_rows {
            let share = ((t_after - next_sample_s) / h).clamp(0.0, 1.0);
            let at = y + (y_before - y) * share;
            let row = Row { t_s: (n_sampled as f64 - n_before as f64) * period_s, period_s };
            let reading_m = reader.read(bench, at, &row, &mut chance);
            board.sampled(n_sampled, reading_m, mean_v.monitor_v);
            n_sampled += 1;
            next_sample_s = sampler.time(n_sampled, &mut chance.timing);
        }
        y_before = y;
    }
    board.record
}

/// When rows are sampled.
struct Sampler<'a> {
    timing: &'a Timing,
    n_before: usize,
    period_s: f64,
    /// Memory of a jitter that has one.
    wander: f64,
    /// The row before.
    last_s: f64,
}

impl Sampler<'_> {
    /// True time of a row's sampling since the start of the history; rows are asked for in order.
    fn time(&mut self, row: usize, rng: &mut Pcg64) -> f64 {
        let (timing, period_s) = (self.timing, self.period_s);
        let since_s = (row as f64 - self.n_before as f64) * period_s;
        let slip_s = if timing.clock_swing_s > 0.0 {
            let w = TAU / timing.clock_swing_s;
            timing.clock_error * (1.0 - (w * since_s).cos()) / w
        } else if timing.clock_sync_s > 0.0 {
            // In step up to row 0, so that no slip of the history is put right in the log.
            timing.clock_error * since_s.max(0.0).rem_euclid(timing.clock_sync_s)
        } else if let Some((share, tau_s)) = timing.clock_settling {
            let warm_s = since_s.max(0.0);
            timing.clock_error * (since_s - share * (warm_s + tau_s * (-warm_s / tau_s).exp_m1()))
        } else {
            timing.clock_error * since_s
        };
        let late_s = match timing.jitter {
            None => 0.0,
            Some(Jitter::Uniform { half_s }) => half_s * (2.0 * rng.random::<f64>() - 1.0),
            Some(Jitter::Gaussian { rms_s }) => rms_s * normal(rng),
            Some(Jitter::RareLate { one_in, mean_s }) => {
                let (chance, size) = (rng.random::<f64>(), rng.random::<f64>());
                if chance * one_in < 1.0 { -mean_s * (1.0 - size).ln() } else { 0.0 }
            }
            Some(Jitter::Wandering { rms_s, rows }) => {
                let keep = (-1.0 / rows).exp();
                self.wander = keep * self.wander + (1.0 - keep * keep).sqrt() * normal(rng);
                rms_s * self.wander
            }
            Some(Jitter::TwoTimes { s }) => {
                if rng.random::<bool>() {
                    s
                } else {
                    -s
                }
            }
        };
        // Rows stay in order, and nothing is sampled before the start.
        let most_s = JITTER_ROWS * period_s;
        let jitter_s = late_s.clamp(-most_s, most_s);
        let mut at_s = (row as f64 * period_s + slip_s + jitter_s - timing.measure_delay_s).max(0.0);
        if timing.clock_sync_s > 0.0 {
            // A clock that is late by rows cannot be put right at once: it catches up, a tenth of a row from row to row.
            at_s = at_s.max(self.last_s + 0.1 * period_s);
        }
        self.last_s = at_s;
        at_s
    }
}

/// Commands before row 0.
fn history(history: History, rest_v: f64, period_s: f64, rng: &mut Pcg64) -> Vec<f64> {
    let rows = |seconds: f64| (seconds / period_s).round() as usize;
    let mut command_v = Vec::new();
    let rest_s = match history {
        History::Relaxed => return command_v,
        History::Demagnetised { volts, rest_s } => {
            let (n, hz) = (rows(0.3), 20.0 + 20.0 * rng.random::<f64>());
            for k in 0..n {
                let share = 1.0 - k as f64 / n as f64;
                command_v.push(rest_v + volts * share * (TAU * hz * k as f64 * period_s).sin());
            }
            rest_s
        }
        History::Moved { volts, rest_s } => {
            for _ in 0..8 {
                let level_v = volts * (2.0 * rng.random::<f64>() - 1.0);
                command_v.extend(std::iter::repeat_n(level_v, rows(0.02 + 0.02 * rng.random::<f64>())));
            }
            rest_s
        }
        History::JustMoved { volts, rest_s } => {
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            command_v.extend(std::iter::repeat_n(rest_v + sign * volts, rows(0.05)));
            rest_s
        }
        History::JustRang { volts, hz, rest_s } => {
            // Not near zero, where a sine leaves little behind.
            let half = if rng.random::<bool>() { 0.5 } else { 0.0 };
            let turns = 4.0 + half + rng.random_range(0.12..0.38);
            let sine = |k: usize| (TAU * hz * k as f64 * period_s).sin();
            command_v.extend((0..rows(turns / hz)).map(|k| rest_v + volts * sine(k)));
            rest_s
        }
        History::JustRamped { volts, ramp_s, rest_s } => {
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            command_v.extend(std::iter::repeat_n(rest_v + sign * volts, rows(0.05)));
            let n = rows(ramp_s);
            command_v.extend((0..n).map(|k| rest_v + sign * volts * (1.0 - k as f64 / n as f64)));
            rest_s
        }
        History::JustShaken { volts, rest_s } => {
            for _ in 0..12 {
                let level_v = volts * (2.0 * rng.random::<f64>() - 1.0);
                command_v.extend(std::iter::repeat_n(rest_v + level_v, rows(rng.random_range(2e-3..6e-3))));
            }
            let last_v = volts * rng.random_range(0.6..1.0) * if rng.random::<bool>() { 1.0 } else { -1.0 };
            command_v.extend(std::iter::repeat_n(rest_v + last_v, rows(rng.random_range(4e-3..8e-3))));
            rest_s
        }
        History::JustClimbed { volts, steps, rest_s } => {
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            command_v.extend(std::iter::repeat_n(rest_v + sign * volts, rows(0.05)));
            for left in (1..steps).rev() {
                let level_v = sign * volts * f64::from(left) / f64::from(steps);
                command_v.extend(std::iter::repeat_n(rest_v + level_v, rows(rest_s)));
            }
            rest_s
        }
    };
    command_v.extend(std::iter::repeat_n(rest_v, rows(rest_s)));
    command_v
}

/// The computer beside the bench: it knows rows, commands and the loop, and keeps the record.
struct Board<'a> {
    session: &'a Session<'a>,
    before_v: &'a [f64],
    period_s: f64,
    offset_s: f64,
    timing: &'a Timing,
    integral_v: f64,
    applied_v: f64,
    lost_rows: u32,
    link_is_bad: bool,
    record: Record,
}

impl<'a> Board<'a> {
    fn new(bench: &'a Bench, session: &'a Session<'a>, n_rows: usize, before_v: &'a [f64], period_s: f64) -> Self {
        // A loop decides row by row, see `sampled`.
        let (command_v, reference_um) = match session.source {
            Source::Open(command_v) => (command_v.iter().copied().map(as_logged).collect(), None),
            Source::Closed(reference_m, _) => {
                (Vec::with_capacity(n_rows), Some(reference_m.iter().map(|r| r * 1e6).collect()))
            }
        };
        let record = Record {
            name: String::new(),
            rate_hz: session.rate_hz,
            latency_us: LATENCY_US,
            command_v,
            displacement_um: Vec::with_capacity(n_rows),
            reference_um,
            drive_v: session.monitor.then(|| Vec::with_capacity(n_rows)),
        };
        let offset_s = LATENCY_US * 1e-6 + bench.timing.command_delay_s;
        let timing = &bench.timing;
        Self {
            session,
            before_v,
            period_s,
            offset_s,
            timing,
            integral_v: 0.0,
            applied_v: 0.0,
            lost_rows: 0,
            link_is_bad: false,
            record,
        }
    }

    fn edge_time(&self, row: usize) -> f64 {
        // Edges stay in order.
        let turn_s = self.timing.edge_turns_s.min(TURN_ROWS * self.period_s);
        let way = if row % 2 == 1 { 1.0 } else { -1.0 };
        row as f64 * self.period_s + self.offset_s + way * turn_s
    }

    /// Whether a row's edge may come: a loop whose rows are later than their edges has nothing to send yet.
    fn is_decided(&self, row: usize) -> bool {
        matches!(self.session.source, Source::Open(_)) || row < self.before_v.len() + self.record.command_v.len()
    }

    /// Sends a row's command, and returns what reaches the amplifier.
    fn command(&mut self, row: usize, rng: &mut Pcg64) -> f64 {
        let wanted_v = match row.checked_sub(self.before_v.len()) {
            None => self.before_v[row],
            Some(k) => match self.record.command_v.get(k) {
                Some(command_v) => *command_v,
                None => return self.applied_v,
            },
        };
        if self.lost_rows > 0 {
            self.lost_rows -= 1;
            return self.applied_v;
        }
        if let Some((probability, length)) = self.timing.command_loss
            && rng.random::<f64>() < probability
        {
            self.lost_rows = length - 1;
            return self.applied_v;
        }
        if let Some(link) = self.timing.bad_link {
            let turns = if self.link_is_bad { 1.0 / link.rows } else { link.start };
            self.link_is_bad ^= rng.random::<f64>() < turns;
            if self.link_is_bad && rng.random::<f64>() < link.loss {
                return self.applied_v;
            }
        }
        let lsb = self.timing.dac_lsb_v;
        let mut applied_v = if lsb > 0.0 { (wanted_v / lsb).round() * lsb } else { wanted_v };
        if let Some(limit_v) = self.timing.change_limit_v {
            applied_v = applied_v.clamp(self.applied_v - limit_v, self.applied_v + limit_v);
        }
        self.applied_v = applied_v;
        applied_v
    }

    fn close(&mut self, reference_m: f64, reading_m: f64, law: &Loop) -> f64 {
        let error_m = reference_m - reading_m;
        let integral_v = self.integral_v + law.ki_v_per_m_s * self.period_s * error_m;
        let wish_v = law.feedforward_v_per_m * reference_m + law.kp_v_per_m * error_m + integral_v;
        let command_v = wish_v.clamp(-law.limit_v, law.limit_v);
        if command_v == wish_v || (wish_v - command_v) * error_m < 0.0 {
            self.integral_v = integral_v;
        }
        command_v
    }

    /// Logs a row. A loop decides the row's command from this very reading; it waits in the record for its edge.
    fn sampled(&mut self, row: usize, reading_m: f64, drive_v: f64) {
        let Some(k) = row.checked_sub(self.before_v.len()) else { return };
        self.record.displacement_um.push(reading_m * 1e6);
        if let Some(column) = &mut self.record.drive_v {
            column.push(drive_v);
        }
        if let Source::Closed(reference_m, law) = self.session.source {
            let command_v = self.close(reference_m[k], reading_m, &law);
            self.record.command_v.push(as_logged(command_v));
        }
    }
}

/// A command with the digits of the file: a replay plays the same.
fn as_logged(command_v: f64) -> f64 {
    (command_v * 1e6).round() * 1e-6
}

/// The chain from the sampled motion to the logged number.
struct Reader {
    measures: Vec<Memory>,
    digitises: Vec<Memory>,
    noise_state: f64,
}

impl Reader {
    fn new(bench: &Bench, period_s: f64, rng: &mut Pcg64) -> Self {
        Self {
            measures: bench.measures.iter().map(|part| part.begin(period_s, rng)).collect(),
            digitises: vec![[0.0; 32]; bench.digitises.len()],
            noise_state: 0.0,
        }
    }

    fn read(&mut self, bench: &Bench, at_m: f64, row: &Row, chance: &mut Chance) -> f64 {
        let mut x = at_m;
        for (part, memory) in bench.measures.iter().zip(&mut self.measures) {
            x = part.read(memory, x, row, &mut chance.parts);
        }
        x += bench.offset_m + bench.noise.draw(&mut self.noise_state, row, &mut chance.noise);
        for (part, memory) in bench.digitises.iter().zip(&mut self.digitises) {
            x = part.read(memory, x, row, &mut chance.parts);
        }
        x
    }
}

/// Mean voltages over an interval.
#[derive(Clone, Copy, Default)]
struct Volts {
    /// On the amplifier's output.
    monitor_v: f64,
    /// Behind the whole drive chain: what pushes.
    force_v: f64,
}

impl Volts {
    /// With those of another part of a step, which is `h_s` long.
    fn plus(self, other: Self, part_s: f64, h_s: f64) -> Self {
        Self {
            monitor_v: self.monitor_v + other.monitor_v * part_s / h_s,
            force_v: self.force_v + other.force_v * part_s / h_s,
        }
    }
}

/// State of everything that moves.
#[derive(Clone)]
pub(crate) struct Motion {
    /// Displacement on whole steps.
    pub(crate) q_m: f64,
    /// Velocity on half steps.
    pub(crate) w_m_per_s: f64,
    /// Hysteron voltages on whole steps.
    pub(crate) v: Vec<f64>,
    prepared: Vec<Prepared>,
    /// 1 / (M + h b / 2) and (M - h b / 2) times that.
    kick: (f64, f64),
    drives: Vec<Memory>,
    /// How many of them stand before the amplifier's monitor.
    n_monitored: usize,
    pub(crate) forces: Vec<Memory>,
    follows: Vec<Memory>,
    needs_corrector: bool,
    is_dry: bool,
    warmth: f64,
    warmed_v: f64,
}

impl Motion {
    fn new(bench: &Bench, h_s: f64, before_s: f64, chance: &mut Chance) -> Self {
        let drives = bench.drives.iter().map(|part| part.begin(h_s, before_s, &mut chance.parts)).collect();
        let phases = bench.forces.iter().map(|part| part.begin(TAU * chance.parts.random::<f64>()));
        let drag = 0.5 * h_s * bench.damping_n_s_per_m;
        let inverse = 1.0 / (bench.mass_kg + drag);
        Self {
            prepared: bench.hysterons.iter().map(|part| part.prepare(bench.transduction_c_per_m)).collect(),
            kick: (inverse, (bench.mass_kg - drag) * inverse),
            q_m: 0.0,
            w_m_per_s: 0.0,
            v: vec![0.0; bench.hysterons.len()],
            drives,
            n_monitored: bench.drives.partition_point(|part| part.place() <= DrivePlace::Output),
            forces: phases.collect(),
            follows: bench.follows.iter().map(|part| part.begin(h_s, before_s)).collect(),
            needs_corrector: bench.forces.iter().any(Force::feels_velocity),
            is_dry: bench.forces.iter().any(Force::is_dry),
            warmth: 0.0,
            warmed_v: 0.0,
        }
    }

    /// At rest at zero, for tests that look at the states.
    #[cfg(test)]
    pub(crate) fn at_rest(bench: &Bench, h_s: f64) -> Self {
        Self::new(bench, h_s, 0.0, &mut Chance::new(0))
    }

    /// Carries the drive chain through `part_s` at a constant command and returns its mean output.
    #[inline]
    fn drive(&mut self, bench: &Bench, command_v: f64, part_s: f64) -> Volts {
        let mut volts = Volts { monitor_v: command_v, force_v: command_v };
        for (at, (part, memory)) in bench.drives.iter().zip(&mut self.drives).enumerate() {
            volts.force_v = part.step(memory, volts.force_v, part_s);
            if at < self.n_monitored {
                volts.monitor_v = volts.force_v;
            }
        }
        volts
    }

    /// One kick with the mean voltage `v` and one drift; returns what the sensor's head sees at the end of it.
    #[inline]
    pub(crate) fn step(&mut self, bench: &Bench, v: f64, t_s: f64, h: f64) -> f64 {
        let alpha = bench.transduction_c_per_m;
        let actuator_n = alpha * (v - self.v.iter().sum::<f64>());
        let steady = actuator_n - bench.stiffness_n_per_m * self.q_m;
        let (inverse, keep) = self.kick;
        let kick = |force: f64, w: f64| keep * w + h * inverse * force;
        let before = self.w_m_per_s;
        let mut w = kick(steady + self.pushes(bench, before, t_s, actuator_n), before);
        if self.needs_corrector {
            w = kick(steady + self.pushes(bench, 0.5 * (before + w), t_s, actuator_n), before);
        }
        if self.is_dry {
            for part in &bench.forces {
                w = part.rub(before, w, h * inverse);
            }
        }
        self.w_m_per_s = w;
        self.q_m += h * w;
        let widen = match bench.heated {
            None => 1.0,
            Some((share, tau_s)) => {
                let power = (v * (v - self.warmed_v)).abs() / (h * 2.0 * 100.0 * 60.0 * 60.0);
                self.warmed_v = v;
                self.warmth += (power - self.warmth) * (h / tau_s);
                // However warm, a dead zone stays one: none is negative.
                (1.0 + share * self.warmth).max(0.05)
            }
        };
        for (hysteron, v) in self.prepared.iter().zip(&mut self.v) {
            *v = hysteron.step(*v, w, h, widen);
        }
        for (part, memory) in bench.forces.iter().zip(&mut self.forces) {
            part.advance(memory, self.q_m, w, h);
        }
        let mut y = self.q_m;
        for (part, memory) in bench.follows.iter().zip(&mut self.follows) {
            y = part.step(memory, y, v, h);
        }
        y
    }

    fn pushes(&self, bench: &Bench, w: f64, t_s: f64, actuator_n: f64) -> f64 {
        bench.forces.iter().zip(&self.forces).map(|(part, m)| part.newtons(m, self.q_m, w, t_s, actuator_n)).sum()
    }

    /// Puts row 0 out of equilibrium.
    fn disturb(&mut self, bench: &Bench, signs: [f64; 2]) {
        let alpha = bench.transduction_c_per_m;
        let charge_v = signs[0] * bench.start.precharge_v;
        if let Some(slow) = self.v.get_mut(1) {
            *slow += charge_v;
        }
        // The mass gives way until the forces balance again, and takes all hysterons along (dead zones closed).
        let give = |hysteron: &Hysteron| alpha / hysteron.up.capacitance_f;
        let stiffness = bench.stiffness_n_per_m + alpha * bench.hysterons.iter().map(give).sum::<f64>();
        let move_m = -alpha * charge_v / stiffness;
        self.q_m += move_m;
        for (hysteron, v) in bench.hysterons.iter().zip(&mut self.v) {
            *v += give(hysteron) * move_m;
        }
        self.w_m_per_s += signs[1] * bench.start.velocity_m_per_s;
    }
}
