//! Sizes of a rig and its logs, from which the bounds of every effect follow: a micro-stage and a bender have other typical numbers.

use crate::log::Log;
use crate::phs::Phs;

/// Sizes from which bounds and typical values follow.
#[derive(Clone, Copy, Debug)]
pub struct Scales<'a> {
    /// The nominal plant.
    pub plant: &'a Phs,
    /// Half of the largest span of the displacement, metres.
    pub stroke_m: f64,
    /// Half of the largest span of the command, volts.
    pub drive_v: f64,
    /// Largest rate of the command in V/s, steps left out.
    pub rate_v_per_s: f64,
    /// Sample time in seconds.
    pub sample_s: f64,
    /// Duration of the longest log in seconds.
    pub longest_s: f64,
    /// Lowest and highest command of all logs, volts.
    pub command_v: [f64; 2],
    /// Lowest and highest displacement of all logs, metres.
    pub displacement_m: [f64; 2],
}

impl<'a> Scales<'a> {
    /// Sizes of a plant's logs; what doesn't move counts as a millivolt and a nanometre.
    pub fn of_logs(plant: &'a Phs, logs: &[Log]) -> Self {
        let commands: Vec<[f64; 2]> = logs.iter().map(|log| range(&log.command_v)).collect();
        let displacements: Vec<[f64; 2]> = logs.iter().map(|log| range(&log.displacement_m)).collect();
        let half_span = |ranges: &[[f64; 2]]| ranges.iter().map(|[low, high]| 0.5 * (high - low)).fold(0.0, f64::max);
        Self {
            plant,
            stroke_m: half_span(&displacements).max(1e-9),
            drive_v: half_span(&commands).max(1e-3),
            rate_v_per_s: logs.iter().map(|log| largest_change(&log.command_v) / log.dt_s).fold(0.0, f64::max),
            sample_s: logs.iter().map(|log| log.dt_s).fold(f64::INFINITY, f64::min),
            longest_s: logs.iter().map(|log| log.dt_s * log.command_v.len() as f64).fold(0.0, f64::max),
            command_v: range(commands.as_flattened()),
            displacement_m: range(displacements.as_flattened()),
        }
    }

    /// Force of the drive's half span, newtons.
    pub fn force_n(&self) -> f64 {
        self.plant.transduction_c_per_m * self.drive_v
    }

    /// The drive's rate, V/s; where it only steps, that of one slow ramp through the log.
    pub fn usual_rate_v_per_s(&self) -> f64 {
        self.rate_v_per_s.max(self.drive_v / self.longest_s)
    }

    /// The velocity that goes with [`Scales::usual_rate_v_per_s`], m/s.
    pub fn speed_m_per_s(&self) -> f64 {
        self.stroke_m * self.usual_rate_v_per_s() / self.drive_v
    }
}

fn range(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)])
}

/// A change from one sample to the next that is this many times those before and after is a step and no ramp or sine.
const STEP: f64 = 4.0;

/// Largest change between two samples, steps left out.
fn largest_change(command_v: &[f64]) -> f64 {
    let changes: Vec<f64> = command_v.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let smooth = |around: &&[f64]| around[1] <= STEP * around[0].max(around[2]);
    changes.windows(3).filter(smooth).map(|around| around[1]).fold(0.0, f64::max)
}
