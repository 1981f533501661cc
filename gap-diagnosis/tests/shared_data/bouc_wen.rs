//! How the Bouc-Wen benchmark's records become logs, which rows are fitted, and where a search starts.

use plant_sim::log::{Hold, Log};
use plant_sim::model::{Kind, Model};
use plant_sim::param::Param;

pub const RATE_HZ: f64 = 750.0;
pub const PERIOD: usize = 8192;
/// Rows that settle, and rows that are fitted.
pub const RUN_IN: usize = 768;
pub const FITTED: usize = 1792;

/// A record as a log: force in, displacement out, band-limited between samples.
pub fn log(name: &str, force_n: &[f64], displacement_m: &[f64]) -> Log {
    let mut log = Log {
        name: name.into(),
        dt_s: 1.0 / RATE_HZ,
        command_v: force_n.to_vec(),
        displacement_m: displacement_m.to_vec(),
        ..Log::default()
    };
    log.meta.hold = Hold::Bandlimited;
    log
}

/// The linear baseline of the data, with a hysteresis of its size.
pub fn start(displacement_rms_m: f64) -> Model {
    let given = |value: f64| Param::new(value, 0.3, "baseline of the benchmark, or of its size");
    let mut model = Model::empty("Bouc-Wen oscillator");
    model.kind = Kind::BoucWenOscillator;
    model.actuator.transduction_c_per_m = Param::new(1.0, 0.0, "the drive is the force, in newton");
    model.structure.mass_kg = given(2.0);
    model.structure.damping_n_s_per_m = given(10.0);
    model.structure.stiffness_n_per_m = given(5e4);
    model.hysteresis.amplitude_n_per_m = Some(given(4e4));
    model.hysteresis.beta_per_m = Some(given(1.0 / displacement_rms_m));
    model.hysteresis.gamma_per_m = Some(given(-0.5 / displacement_rms_m));
    model
}
