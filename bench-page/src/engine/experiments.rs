//! The experiment set that a diagnosis wants: steps, sines of several rates, a multisine, a hold; other ones are held out.
//!
//! All are open-loop commands, because a loop hides what it corrects, and small enough that an effect nobody knows of has room below the trip.
//! Before each, a sine that dies away takes out of the hysterons what the one before left in them.

use super::Source;
use plant_sim::model::Model;
use wire::{SegmentRecord, Wave};

/// Share of the displacement's limit that the set reaches at rest: a bender at zeta 0.37 overshoots a step by a third.
const REACH: f64 = 0.55;
/// Volts where no `[rig]` says what the bench stands; the thesis' bender moves 60 um.
const USUAL_V: f64 = 30.0;
/// The dying sine, hertz and seconds.
const DEMAGNETISE: (f32, f64) = (20.0, 0.4);

/// Least volts of the largest part: below, the smallest one, four tenths of it, is rounded to 0 V.
const LEAST_V: f64 = 0.125;

/// One experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// Folder that its run goes to.
    pub name: &'static str,
    /// Command.
    pub spec: String,
    /// Whether it is for scoring only.
    pub is_held_out: bool,
}

/// Whether there is a set for this plant: its commands have both signs.
///
/// # Errors
/// The line that says what to do instead.
pub fn check(plant: &Source) -> Result<(), String> {
    if amplitude_v(&plant.model) >= LEAST_V {
        return Ok(());
    }
    let stands =
        plant.model.rig.as_ref().map_or_else(String::new, |rig| {
            format!(" stands {} to {} V", rig.drive_min_v.value, rig.drive_max_v.value)
        });
    Err(format!(
        "the experiment set drives both ways and {}{stands}: play SPECs of your own, record each, and give the logs to `hysteron diagnose`",
        plant.name
    ))
}

/// The set for a bench, whose limits the nominal plant states.
pub fn set(model: &Model) -> Vec<Experiment> {
    let volts = amplitude_v(model);
    let v = |share: f64| (volts * share * 10.0).round() / 10.0;
    let experiment = |name, is_held_out, spec| Experiment { name, spec, is_held_out };
    vec![
        experiment(
            "steps",
            false,
            format!("zero@0.05s+hold:{}V@0.15s+hold:{}V@0.15s+hold:{}V@0.15s+zero@0.15s", v(0.8), v(-0.4), v(0.4)),
        ),
        experiment(
            "sines",
            false,
            format!(
                "zero@0.05s+sine:{0}V@5Hz,for=0.4s+sine:{0}V@50Hz,for=0.2s+sine:{1}V@200Hz,for=0.1s",
                v(1.0),
                v(0.5)
            ),
        ),
        experiment("multisine", false, format!("zero@0.05s+multisine:{}V@10-1500Hz,periods=6,seed=3", v(0.7))),
        experiment("hold", false, format!("zero@0.05s+hold:{}V@1.2s", v(0.9))),
        experiment(
            "held-out",
            true,
            format!(
                "zero@0.05s+hold:{}V@0.4s+triangle:{}V@20Hz,for=0.2s+sine:{}V@80Hz,for=0.1s+multisine:{}V@20-1000Hz,periods=4,seed=8",
                v(0.7),
                v(0.9),
                v(0.7),
                v(0.4)
            ),
        ),
    ]
}

/// The sine that dies away, at `rate_hz`.
pub fn demagnetise(model: &Model, rate_hz: f64) -> SegmentRecord {
    let (frequency_hz, seconds) = DEMAGNETISE;
    let wave = Wave::DecayingSine { amplitude: amplitude_v(model) as f32, frequency_hz };
    SegmentRecord { wave, samples: (seconds * rate_hz) as u32 }
}

/// Volts of the largest part: what the rig stands, and what keeps clear of the trip.
fn amplitude_v(model: &Model) -> f64 {
    let Some(rig) = &model.rig else { return USUAL_V };
    let drive_v = (-rig.drive_min_v.value).min(rig.drive_max_v.value).max(0.0);
    let gain = model.chain().plant.static_gain_m_per_v().abs();
    drive_v.min(REACH * rig.displacement_max_um.value * 1e-6 / gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant_sim::param::Param;
    use plant_sim::spec::Spec;
    use std::path::Path;
    use virtual_board::waveform::Waveform;

    #[test]
    fn every_experiment_is_played_by_a_board_at_either_rate_within_the_rig() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
        let model = Model::read(&path).unwrap();
        let volts = amplitude_v(&model);
        // 0.55 of 120 um at 1.884 um/V.
        assert!((34.0..36.0).contains(&volts), "{volts}");
        for experiment in set(&model) {
            for rate_hz in [20e3, 40e3] {
                let waveform = Waveform::new(&Spec::parse(&experiment.spec).unwrap(), rate_hz);
                assert!(waveform.is_ok(), "{}: {waveform:?}", experiment.name);
            }
        }
        assert_eq!(set(&model).iter().filter(|experiment| experiment.is_held_out).count(), 1);
    }

    #[test]
    fn a_stack_that_stands_no_negative_volts_is_told_what_to_do() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
        let mut plant = Source { name: "stack.toml".into(), bytes: Vec::new(), model: Model::read(&path).unwrap() };
        let mut with = |least_v: f64| {
            if let Some(rig) = &mut plant.model.rig {
                rig.drive_min_v = Param { value: least_v, ..rig.drive_min_v.clone() };
            }
            let values =
                set(&plant.model).iter().filter(|one| one.spec.contains(":0V") || one.spec.contains(":-0V")).count();
            (check(&plant), values)
        };
        let (refused, silent) = with(0.0);
        assert_eq!(silent, 5);
        assert!(
            refused
                .is_err_and(|line| line.contains("stack.toml stands 0 to 90 V") && line.contains("SPECs of your own"))
        );
        // The least that is played is played in every part.
        assert_eq!(with(-LEAST_V), (Ok(()), 0));
        assert!(with(-0.99 * LEAST_V).0.is_err());
    }
}
