//! Sets of experiments for a bench: what the thesis measured, and what a diagnosis wants.

use std::str::FromStr;

/// One experiment: what it is called and what it plays.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Experiment {
    /// Its name, for a file.
    pub name: String,
    /// What it plays, a SPEC of finite length.
    pub spec: String,
    /// Which of the controllers runs the loop; `None` for an open loop.
    pub controller: Option<usize>,
}

/// A set of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// Chapter 4 of the thesis: a step, a square wave and sines of 1, 50, 100 and 150 Hz with every controller. 80 um and not its 120 um,
    /// beyond which the bender breaks: a sine of 120 um overshoots a little.
    Thesis,
    /// Logs of several kinds that tell effects apart: levels, sines from slow to fast, a multisine, a long hold, and a run of the loop
    /// with every controller.
    Diagnosis,
}

impl FromStr for Set {
    type Err = String;

    fn from_str(text: &str) -> Result<Set, String> {
        match text {
            "thesis" => Ok(Set::Thesis),
            "diagnosis" => Ok(Set::Diagnosis),
            _ => Err("thesis or diagnosis".into()),
        }
    }
}

impl Set {
    /// The name it is called by.
    pub fn name(self) -> &'static str {
        match self {
            Set::Thesis => "thesis",
            Set::Diagnosis => "diagnosis",
        }
    }

    /// Its experiments at `rate_hz` with controllers of these names; every amplitude times `size`.
    pub fn experiments(self, rate_hz: f64, controllers: &[String], size: f64) -> Vec<Experiment> {
        let closed = |name: &str, spec: &str| {
            let one = |(index, controller): (usize, &String)| Experiment {
                name: format!("{controller}-{name}"),
                spec: sized(spec, size),
                controller: Some(index),
            };
            controllers.iter().enumerate().map(one).collect::<Vec<_>>()
        };
        let open = |name: &str, spec: &str| {
            vec![Experiment { name: name.to_owned(), spec: sized(spec, size), controller: None }]
        };
        match self {
            Set::Thesis => [
                closed("step", "zero@0.02s+step:80um@0.2s"),
                closed("square", "square:80um@1Hz/2s"),
                closed("sine-1", "sine:80um@1Hz/3s"),
                closed("sine-50", "sine:80um@50Hz/0.2s"),
                closed("sine-100", "sine:80um@100Hz/0.2s"),
                closed("sine-150", "sine:80um@150Hz/0.2s"),
            ]
            .concat(),
            Set::Diagnosis => {
                // Rest before the first motion: from it the state at the start is fitted.
                let rested = |spec: &str| format!("zero@0.1s+{spec}");
                let levels = [0, 20, 40, 60, 30, 0, -30, -60, -20, 0].map(|volts| format!("hold:{volts}V@0.1s"));
                // A period must fit the table of a board, 4096 samples.
                let lowest_hz = rate_hz / 4000.0;
                let highest_hz = (0.4 * rate_hz).min(1280.0);
                [
                    open("demagnetising", &rested("decaying-sine:60V@8Hz/2s")),
                    open("steps", &levels.join("+")),
                    open(
                        "sines",
                        &rested("sine:60V@1Hz/1s+sine:60V@10Hz/0.5s+sine:60V@50Hz/0.2s+sine:60V@100Hz/0.2s+sine:60V@150Hz/0.2s"),
                    ),
                    open("multisine", &rested(&format!("multisine:60V@{lowest_hz}-{highest_hz}Hz,periods=4,seed=1"))),
                    open("hold", &rested("hold:40V@5.5s+zero@0.5s")),
                    closed("loop", &rested("step:20um@0.1s+step:60um@0.1s+step:-20um@0.1s+sine:40um@25Hz/0.3s")),
                ]
                .concat()
            }
        }
    }
}

/// What is played in open loop before every experiment of a set, so that none inherits the hysterons of the one before.
pub fn demagnetising(size: f64) -> String {
    sized("decaying-sine:60V@8Hz/1s", size)
}

/// `spec` with every amplitude times `size`.
fn sized(spec: &str, size: f64) -> String {
    let part = |part: &str| {
        let Some((kind, rest)) = part.split_once(':') else { return part.to_owned() };
        let end = rest.find(['V', 'u']).unwrap_or(rest.len());
        match rest[..end].parse::<f64>() {
            Ok(amplitude) => format!("{kind}:{}{}", amplitude * size, &rest[end..]),
            Err(_) => part.to_owned(),
        }
    };
    spec.split('+').map(part).collect::<Vec<_>>().join("+")
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant_sim::experiment::Program;
    use plant_sim::spec::{Spec, Unit};
    use virtual_board::waveform::Waveform;

    #[test]
    fn every_experiment_of_every_set_can_be_played_by_a_board_at_its_rates_and_ends() {
        let names = ["pi1".to_owned(), "pi2".to_owned()];
        for set in [Set::Thesis, Set::Diagnosis] {
            assert_eq!(set.name().parse::<Set>(), Ok(set));
            for rate_hz in [10e3, 20e3, 40e3] {
                let experiments = set.experiments(rate_hz, &names, 1.0);
                for experiment in &experiments {
                    let spec = Spec::parse(&experiment.spec).unwrap();
                    Waveform::new(&spec, rate_hz).unwrap_or_else(|e| panic!("{}: {e}", experiment.spec));
                    assert!(Program::new(&spec, rate_hz).unwrap().samples().is_some(), "{}", experiment.spec);
                    let unit = if experiment.controller.is_some() { Unit::Micrometre } else { Unit::Volt };
                    assert_eq!(spec.unit, Some(unit));
                }
                let mut own: Vec<&str> = experiments.iter().map(|experiment| experiment.name.as_str()).collect();
                own.sort_unstable();
                own.dedup();
                assert_eq!(own.len(), experiments.len());
            }
        }
        // A diagnosis needs no controller, the thesis' protocol is nothing but them.
        assert_eq!(Set::Diagnosis.experiments(20e3, &[], 1.0).len(), 5);
        assert!(Set::Thesis.experiments(20e3, &[], 1.0).is_empty());
    }

    #[test]
    fn a_size_reaches_every_amplitude_and_nothing_else() {
        assert_eq!(
            sized("hold:-60V@0.1s+zero@1s+sine:40um@25Hz/0.3s", 0.5),
            "hold:-30V@0.1s+zero@1s+sine:20um@25Hz/0.3s"
        );
        assert_eq!(sized("multisine:60V@5-1280Hz,seed=1", 0.25), "multisine:15V@5-1280Hz,seed=1");
        assert_eq!(demagnetising(1.0), "decaying-sine:60V@8Hz/1s");
    }
}
