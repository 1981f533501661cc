//! The plant beside the bench: it gets the same commands, and what it predicts is set beside what the sensor says.

use super::Source;
use control_core::Settings;
use plant_sim::chain::{Chain, Held, Simulator};
use plant_sim::experiment::sampled_loop;
use plant_sim::margins::{MarginError, Verdict, assess};
use plant_sim::model::Model;

/// The plant at work, without what is random.
pub struct Twin {
    simulator: Simulator,
    /// Its chain.
    pub chain: Chain,
}

impl Twin {
    /// At its start.
    pub fn new(model: &Model, rate_hz: f64, latency_s: f64) -> Twin {
        let chain = model.chain();
        let start = model.start();
        let mut simulator = Simulator::new(&chain, rate_hz.recip(), latency_s);
        simulator.start_from(&start.state, start.drive_v);
        Twin { simulator, chain }
    }

    /// What it predicts that the sensor reads now.
    pub fn read_m(&self) -> f64 {
        self.simulator.reading_m()
    }

    /// Holds a command for one sample.
    pub fn apply(&mut self, command_v: f64) {
        self.simulator.advance(Held::zero_order(command_v), 0.0);
    }
}

/// Whether `settings` stay within what the plant's file says that the rig stands; without a `[rig]` there is nothing to hold them to.
///
/// # Errors
/// The line that says what lies beyond.
pub fn within_rig(plant: &Source, settings: &Settings) -> Result<(), String> {
    let checked = plant.model.rig.as_ref().map_or(Ok(()), |rig| rig.check(settings));
    checked.map_err(|beyond| format!("{}: {beyond}", plant.name))
}

/// What is to be said of the loop that `settings` close around `chain`; unstable ones are refused.
///
/// # Errors
/// The margins can't be computed.
pub fn judge(
    chain: &Chain,
    settings: &Settings,
    latency_s: f64,
) -> Result<Result<Option<String>, String>, MarginError> {
    let law = sampled_loop(settings, f64::from(settings.rate_hz), latency_s, chain);
    let assessment = assess(&chain.linear_regions()?, &law)?;
    Ok(match assessment.verdict {
        Verdict::Unstable { .. } => Err(assessment.to_string()),
        Verdict::BelowSixDb { .. } => Ok(Some(assessment.to_string())),
        Verdict::Stable { .. } => Ok(None),
    })
}
