//! Whether a loop that a call asks for may run: stable, and within what the rig stands; what is refused, what is warned of, and what would do.

use crate::failure::Failure;
use control_core::Settings;
use plant_sim::chain::Chain;
use plant_sim::experiment::sampled_loop;
use plant_sim::margins::{Assessment, LinearRegion, Loop, MarginError, Suggestion, Verdict, assess, nearest_stable};
use plant_sim::model::RigSection;
use std::path::Path;

/// Clock of the board's timer, for rates that a board can run: 170 MHz (STM32G474 at its highest clock).
const TIMER_CLOCK_HZ: u32 = 170_000_000;

/// What of a loop's timing a call can change: advice that asks for more is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Free {
    /// Rate and delay: nothing but numbers.
    Both,
    /// The rate; a board's delay is what it is.
    Rate,
    /// Neither by itself: the delay of a paced loop is half a sample.
    Neither,
}

/// Margins of the loop that the `settings` of a controller file close around `chain`, and a warning where they are thin; an unstable one is refused.
/// The nearest rate and delay that would do are told as far as they are `free`.
pub fn judge(
    path: &Path,
    settings: &Settings,
    rate_hz: f64,
    delay_s: f64,
    chain: &Chain,
    free: Free,
) -> Result<(Assessment, Option<String>), Failure> {
    let regions = chain.linear_regions()?;
    let law = sampled_loop(settings, rate_hz, delay_s, chain);
    let assessment = assess(&regions, &law)?;
    if matches!(assessment.verdict, Verdict::Stable { .. }) {
        return Ok((assessment, None));
    }
    let told = advised(&assessment, &regions, &law, free)?;
    match assessment.verdict {
        Verdict::Unstable { .. } => Err(Failure::call(told).about(path)),
        _ => Ok((assessment, Some(format!("{}: {told}", path.display())))),
    }
}

/// What was found of a loop, with the nearest rate and delay that would do better as far as they are `free`.
pub fn advised(
    assessment: &Assessment,
    regions: &[LinearRegion],
    law: &Loop,
    free: Free,
) -> Result<String, MarginError> {
    if free == Free::Neither {
        return Ok(assessment.to_string());
    }
    Ok(match nearest_stable(regions, law, TIMER_CLOCK_HZ)? {
        Suggestion::AsAsked { .. } => assessment.to_string(),
        Suggestion::Change { keeps_delay: false, .. } if free == Free::Rate => assessment.to_string(),
        suggestion => format!("{assessment}; {suggestion}"),
    })
}

/// Refuses the settings of a controller file that may go beyond what the rig stands.
pub fn within_rig(path: &Path, rig: &RigSection, settings: &Settings) -> Result<(), Failure> {
    rig.check(settings).map_err(|beyond| Failure::call(beyond).about(path))
}
