//! Table 2.3, model against model: how far Bouc-Wen (Table 2.2) falls behind the hysterons (Table 2.1) as the sine gets faster.
//!
//! The thesis fitted both to measured sines that are not at hand. If the hysterons are taken for the bench, whose fit is then 100 % by
//! definition, Bouc-Wen's fit must fall steadily, as it does in the table relative to them.

use super::Thesis;
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::metrics::Score;
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

/// Frequencies of the table with the printed fits of the hysterons and of Bouc-Wen, in percent.
pub const TABLE: [(f64, &str, &str); 7] = [
    (1.0, "97.11", "96.35"),
    (10.0, "97.23", "94.97"),
    (25.0, "97.41", "94.02"),
    (50.0, "96.59", "93.06"),
    (75.0, "96.69", "91.75"),
    (100.0, "96.99", "90.80"),
    (150.0, "96.98", "90.14"),
];
/// Amplitude: the bender's range relaxed.
pub const AMPLITUDE_V: f64 = 60.0;
/// Samples a period; the sine is a line between them.
const PERIOD: usize = 2000;

/// The table and the curves of Figures 2.4 to 2.6.
#[derive(Clone, Debug)]
pub struct Trend {
    /// Fit of Bouc-Wen to the hysterons at each frequency, percent, mean left out as the thesis' formula does.
    pub fit_percent: Vec<f64>,
    /// The third period of each sine: volts, then micrometres of the hysterons and of Bouc-Wen.
    pub periods: Vec<[Vec<f64>; 3]>,
    /// A step of 60 V: seconds, then micrometres of both.
    pub step: [Vec<f64>; 3],
}

impl Trend {
    /// Whether the fit falls from each frequency to the next.
    pub fn falls_steadily(&self) -> bool {
        self.fit_percent.windows(2).all(|pair| pair[1] < pair[0])
    }
}

/// Runs both models.
pub fn trend(thesis: &Thesis) -> Trend {
    let chains = [thesis.phs.chain(), thesis.bouc_wen.chain()];
    let run = |chain: &Chain, log: &Log| predict(chain, log, &Start::relaxed(chain), log.len());
    let mut fit_percent = Vec::new();
    let mut periods = Vec::new();
    for (hz, ..) in TABLE {
        let sine = |k: usize| AMPLITUDE_V * (TAU * k as f64 / PERIOD as f64).sin();
        let log = made(1.0 / (hz * PERIOD as f64), (0..3 * PERIOD).map(sine).collect());
        let [phs, bouc_wen] = [0, 1].map(|i| run(&chains[i], &log).split_off(2 * PERIOD));
        let mut score = Score::default();
        phs.iter().zip(&bouc_wen).for_each(|(measured, predicted)| score.add(*measured, *predicted));
        fit_percent.push(score.fit_percent(false));
        periods.push([log.command_v[2 * PERIOD..].to_vec(), micro(&phs), micro(&bouc_wen)]);
    }
    let mut step = made(2e-5, vec![AMPLITUDE_V; 1000]);
    step.meta.hold = plant_sim::log::Hold::Zoh;
    let [phs, bouc_wen] = [0, 1].map(|i| micro(&run(&chains[i], &step)));
    let time_s = (0..phs.len()).map(|k| k as f64 * step.dt_s).collect();
    Trend { fit_percent, periods, step: [time_s, phs, bouc_wen] }
}

fn made(dt_s: f64, command_v: Vec<f64>) -> Log {
    let mut log = Log { dt_s, displacement_m: vec![0.0; command_v.len()], command_v, ..Log::default() };
    log.meta.hold = plant_sim::log::Hold::Foh;
    log
}

fn micro(values_m: &[f64]) -> Vec<f64> {
    values_m.iter().map(|v| v * 1e6).collect()
}
