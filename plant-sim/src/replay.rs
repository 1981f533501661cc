//! Replay: the logged command through the chain, open loop, from a start that fits the log.

use crate::chain::{Chain, Held, Simulator};
use crate::log::{Hold, Log};
use crate::phs::PhsState;

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
}

impl Start {
    /// Everything zero.
    pub fn relaxed(chain: &Chain) -> Self {
        Self { state: chain.plant.relaxed(), drive_v: 0.0 }
    }

    /// The equilibrium under `drive_v` that holds the given hysteron voltages (equation (2.9)).
    pub fn at_rest(chain: &Chain, drive_v: f64, hysteron_v: Vec<f64>) -> Self {
        let acting_v = chain.drive.output_v(drive_v);
        let displacement_m = chain.plant.equilibrium_m(acting_v, 0.0, &hysteron_v);
        Self { state: PhsState { displacement_m, velocity_m_per_s: 0.0, hysteron_v }, drive_v }
    }
}

/// Feeds commands one by one, as a log's `hold` says, and reads the displacement before each.
///
/// A first-order hold needs the command after the present one; the last row repeats its own.
pub struct Player {
    simulator: Simulator,
    sample_s: f64,
    first_order: bool,
}

impl Player {
    /// A chain ready to play rows that are `sample_s` apart.
    pub fn new(chain: &Chain, sample_s: f64, latency_s: f64, hold: Hold, start: &Start) -> Self {
        let mut simulator = Simulator::new(chain, sample_s, latency_s);
        simulator.start_from(&start.state, start.drive_v);
        Self { simulator, sample_s, first_order: hold != Hold::Zoh }
    }

    /// Reading of an ideal sensor at this row in metres; then moves to the next row.
    pub fn row(&mut self, command_v: f64, next_command_v: f64, force_n: f64) -> f64 {
        let reading_m = self.simulator.reading_m();
        let held = if self.first_order {
            Held { start_v: command_v, slope_v_per_s: (next_command_v - command_v) / self.sample_s }
        } else {
            Held::zero_order(command_v)
        };
        self.simulator.advance(held, force_n);
        reading_m
    }

    /// Voltage of each hysteron now.
    pub fn hysteron_v(&self) -> Vec<f64> {
        self.simulator.state().hysteron_v
    }
}

/// Readings in metres that an ideal sensor would have logged, one per row of `log` (or of its first `rows` rows).
pub fn predict(chain: &Chain, log: &Log, start: &Start, rows: usize) -> Vec<f64> {
    let mut player = Player::new(chain, log.dt_s, log.meta.latency_s, log.meta.hold, start);
    let command_v = &log.command_v[..rows.min(log.command_v.len())];
    let force_n = log.force_n.as_deref();
    command_v
        .iter()
        .enumerate()
        .map(|(k, &u)| {
            let next = command_v.get(k + 1).copied().unwrap_or(u);
            player.row(u, next, force_n.map_or(0.0, |f| f[k]))
        })
        .collect()
}
