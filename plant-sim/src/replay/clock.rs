//! Readings at the instants of a clock that is not the drive's.

use crate::chain::{Chain, Drive, Sensor};
use crate::log::{Hold, Meta};
use crate::replay::{Commands, Start};
use std::collections::VecDeque;

/// Rows around an instant that an interpolation goes through.
const NODES: usize = 4;

/// Readings at another clock's instants: row k of a log is read at k (1 + ratio + half_drift k) samples of the drive's clock.
pub(super) struct Clock {
    ratio: f64,
    /// Half the change of the ratio from one sample to the next.
    half_drift: f64,
    /// The last rows at the drive's instants.
    known: VecDeque<Row>,
    /// Rows taken in all.
    taken: usize,
    /// Where the sensor reads the structure at once.
    structure: Option<Structure>,
}

/// What a row at the drive's instants has shown.
pub(super) struct Row {
    /// Reading, metres.
    pub reading_m: f64,
    /// Displacement and velocity of the structure.
    pub displacement_m: f64,
    /// See `displacement_m`.
    pub velocity_m_per_s: f64,
}

impl Clock {
    /// That of the sensor in `chain`, which reads rows `sample_s` apart from `start`; none where it is the drive's.
    pub fn of(chain: &Chain, sample_s: f64, meta: &Meta, start: &Start) -> Option<Self> {
        let ratio = chain.sensor.clock_ratio;
        let half_drift = 0.5 * chain.sensor.clock_drift_per_s * sample_s;
        chain.sensor.has_own_clock().then(|| Self {
            ratio,
            half_drift,
            known: VecDeque::new(),
            taken: 0,
            structure: Structure::of(chain, sample_s, meta, start),
        })
    }

    /// Rows taken so far.
    pub fn taken(&self) -> usize {
        self.taken
    }

    /// The instant of row `k` in samples of the drive's clock.
    fn instant(&self, k: usize) -> f64 {
        let k = k as f64;
        (k * (1.0 + self.ratio + self.half_drift * k)).max(0.0)
    }

    /// Rows whose commands row `k` is read with, from the first to before the second.
    pub fn needs(&self, k: usize) -> [usize; 2] {
        let before = self.instant(k).floor() as usize;
        let late = self.structure.as_ref().map_or(0, |structure| structure.late.0 + 1);
        [before.saturating_sub(late).min(self.taken), before + 3]
    }

    /// Whether the two rows after row `k`'s instant are still to come.
    pub fn lacks(&self, k: usize) -> bool {
        (self.taken as f64) < self.instant(k).floor() + 3.0
    }

    /// The next row at the drive's instants.
    pub fn take(&mut self, row: Row) {
        self.known.push_back(row);
        self.taken += 1;
        if self.known.len() > NODES {
            self.known.pop_front();
        }
    }

    /// Reading at row `k`'s instant: of where the structure is on its way between the rows around under the `commands`, or else on the cubic through
    /// four readings.
    pub fn read_m(&self, k: usize, commands: Commands<'_>) -> f64 {
        let (first, instant) = (self.taken - self.known.len(), self.instant(k));
        let (before, nodes) = (instant.floor() as usize, self.known.len());
        if let Some(structure) = &self.structure {
            // A clock that runs back asks for rows that are gone.
            let [from, to] = [before, before + 1].map(|row| &self.known[row.saturating_sub(first)]);
            let displacement_m = structure.between_m(from, to, instant.fract(), before, commands);
            return structure.sensor.predictable_m(displacement_m, instant * structure.sample_s);
        }
        let at = instant - first as f64;
        let weight = |i: usize| -> f64 {
            (0..nodes).filter(|&j| j != i).map(|j| (at - j as f64) / (i as f64 - j as f64)).product()
        };
        self.known.iter().enumerate().map(|(i, row)| weight(i) * row.reading_m).sum()
    }
}

/// The structure's way from one row to the next: that of a mass on damper and spring, hysterons closed, under a constant acceleration and the jump
/// of it where the command has an edge, such that it starts as the structure does and ends where that does; and on top the cubic that makes
/// up for the velocity at the end. What hysterons do in one sample, and other parts, is all that is left to the cubic.
struct Structure {
    sensor: Sensor,
    /// What steps the drive, if edges are sharp when they arrive, with the acceleration for a volt, m/s^2.
    edges: Option<(Drive, f64)>,
    /// Damping over mass, 1/s, and stiffness over mass, 1/s^2.
    rates: [f64; 2],
    sample_s: f64,
    /// From a row's instant to the edge of its command, in whole samples and seconds.
    late: (usize, f64),
    /// Response over a sample, and from an edge to the sample's end.
    whole: Response,
    after_edge: Response,
    /// Command before the first.
    before_v: f64,
}

/// What one unit of acceleration has made of displacement, s^2, and velocity, s, from rest.
struct Response {
    displacement_s2: f64,
    velocity_s: f64,
}

impl Response {
    /// y'' + c y' + w y = 1 from rest, after `t` seconds.
    fn after(t: f64, [c, w]: [f64; 2]) -> Self {
        let half = 0.5 * c;
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
        Self { displacement_s2: (1.0 - (cos + half / turning * sin)) / w, velocity_s: sin / turning }
    }
}

impl Structure {
    /// That of `chain`; none where the sensor sees something else, or the structure later.
    fn of(chain: &Chain, sample_s: f64, meta: &Meta, start: &Start) -> Option<Self> {
        let Chain { drive, plant, parts, sensor } = chain;
        let is_seen_at_once = sensor.lag.is_none() && sensor.play_m == 0.0 && sensor.late_s == 0.0;
        let is_all =
            parts.modes.is_empty() && parts.arms.is_empty() && parts.creep.is_empty() && parts.linear.is_none();
        if !(is_seen_at_once && is_all) {
            return None;
        }
        let is_sharp = meta.hold == Hold::Zoh
            && !drive.has_memory()
            && drive.warmings.is_empty()
            && drive.swings.is_empty()
            && parts.transducer.is_none();
        let alpha = plant.transduction_c_per_m;
        let closed: f64 = plant.hysterons.iter().map(|hysteron| alpha * alpha / hysteron.capacitance_f).sum();
        let late = (meta.latency_s + drive.delay_s) / sample_s;
        let rates = [plant.damping_n_s_per_m / plant.mass_kg, (plant.stiffness_n_per_m + closed) / plant.mass_kg];
        let late_s = late.fract() * sample_s;
        Some(Self {
            sensor: sensor.clone(),
            edges: is_sharp.then(|| (drive.clone(), alpha / plant.mass_kg)),
            rates,
            sample_s,
            late: (late.floor() as usize, late_s),
            whole: Response::after(sample_s, rates),
            after_edge: Response::after(sample_s - late_s, rates),
            before_v: start.drive_v,
        })
    }

    /// By how much the acceleration jumps on the way from row `before` to the next, m/s^2.
    fn jump_m_per_s2(&self, before: usize, commands: Commands<'_>) -> f64 {
        let Some((drive, per_volt)) = &self.edges else { return 0.0 };
        let jump_m_per_s2 = before.checked_sub(self.late.0).and_then(|edge| {
            let last_v = if edge == 0 { self.before_v } else { commands.volts(edge - 1)? };
            Some(per_volt * (drive.output_v(commands.volts(edge)?) - drive.output_v(last_v)))
        });
        jump_m_per_s2.unwrap_or(0.0)
    }

    /// Displacement at a `share` of the sample between rows `from` and `to`, of which `before` is the first's number.
    fn between_m(&self, from: &Row, to: &Row, share: f64, before: usize, commands: Commands<'_>) -> f64 {
        let Row { displacement_m, velocity_m_per_s, .. } = from;
        let (t, jump) = (share * self.sample_s, self.jump_m_per_s2(before, commands));
        let end = &self.whole;
        let moved = velocity_m_per_s * end.velocity_s + jump * self.after_edge.displacement_s2;
        let constant = (to.displacement_m - displacement_m - moved) / end.displacement_s2;
        let slowed = 1.0 - self.rates[0] * end.velocity_s - self.rates[1] * end.displacement_s2;
        let ends_m_per_s = velocity_m_per_s * slowed + constant * end.velocity_s + jump * self.after_edge.velocity_s;
        let missed = to.velocity_m_per_s - ends_m_per_s;
        let now = Response::after(t, self.rates);
        let after_edge_s = t - self.late.1;
        let jumped = if jump != 0.0 && after_edge_s > 0.0 {
            jump * Response::after(after_edge_s, self.rates).displacement_s2
        } else {
            0.0
        };
        displacement_m
            + velocity_m_per_s * now.velocity_s
            + constant * now.displacement_s2
            + jumped
            + share * share * (share - 1.0) * self.sample_s * missed
    }
}
