//! The nominal plant: what the diagnosis is told, and the honest scatter of the true one about it.

use crate::bench::{Bench, History, Start, Timing};
use crate::digitise::Noise;
use crate::hysteron::Hysteron;
use crate::sensor::normal;
use rand_pcg::Pcg64;

/// Thesis Table 2.1. The same numbers as every other room reads from models/thesis-phs.toml; repeated here because this
/// room may lean on none.
const TABLE: Numbers = Numbers {
    transduction_c_per_m: 0.046311,
    capacitance_f: [5.6425e-7, 5.2125e-7],
    slope_s: [0.6002, 1.1528e-4],
    dead_zone_v: [14.5126, 8.6838],
    mass_kg: 1.0148e-3,
    damping_n_s_per_m: 3.7356,
    stiffness_n_per_m: 24579.0,
};

/// Relative standard deviation of every parameter but the mass, as the plant file claims and the truth obeys.
const SIGMA: f64 = 0.01;

/// The same for the mass, which was weighed.
const SIGMA_MASS: f64 = 0.005;

/// Parameters of the two-hysteron plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Numbers {
    /// alpha.
    pub transduction_c_per_m: f64,
    /// C1, C2.
    pub capacitance_f: [f64; 2],
    /// beta1, beta2.
    pub slope_s: [f64; 2],
    /// d1, d2 (full widths).
    pub dead_zone_v: [f64; 2],
    /// M.
    pub mass_kg: f64,
    /// b.
    pub damping_n_s_per_m: f64,
    /// k.
    pub stiffness_n_per_m: f64,
}

/// Static gain alpha/k of the nominal plant in m/V, for sizes.
pub(crate) fn static_gain_m_per_v() -> f64 {
    TABLE.transduction_c_per_m / TABLE.stiffness_n_per_m
}

/// Nominal numbers.
#[cfg(test)]
pub(crate) fn nominal() -> Numbers {
    TABLE
}

/// True numbers: each off by its own normal draw.
pub(crate) fn scattered(rng: &mut Pcg64) -> Numbers {
    let mut off = |value: f64, sigma: f64| value * (1.0 + sigma * normal(rng));
    Numbers {
        transduction_c_per_m: off(TABLE.transduction_c_per_m, SIGMA),
        capacitance_f: TABLE.capacitance_f.map(|c| off(c, SIGMA)),
        slope_s: TABLE.slope_s.map(|s| off(s, SIGMA)),
        dead_zone_v: TABLE.dead_zone_v.map(|d| off(d, SIGMA)),
        mass_kg: off(TABLE.mass_kg, SIGMA_MASS),
        damping_n_s_per_m: off(TABLE.damping_n_s_per_m, SIGMA),
        stiffness_n_per_m: off(TABLE.stiffness_n_per_m, SIGMA),
    }
}

/// A bench of these numbers and nothing else.
pub(crate) fn bench(numbers: &Numbers, noise: Noise) -> Bench {
    let hysteron = |i: usize| Hysteron::symmetric(numbers.capacitance_f[i], numbers.slope_s[i], numbers.dead_zone_v[i]);
    Bench {
        transduction_c_per_m: numbers.transduction_c_per_m,
        mass_kg: numbers.mass_kg,
        damping_n_s_per_m: numbers.damping_n_s_per_m,
        stiffness_n_per_m: numbers.stiffness_n_per_m,
        hysterons: vec![hysteron(0), hysteron(1)],
        drives: Vec::new(),
        forces: Vec::new(),
        follows: Vec::new(),
        measures: Vec::new(),
        digitises: Vec::new(),
        timing: Timing::default(),
        noise,
        offset_m: 0.0,
        heated: None,
        history: History::Relaxed,
        start: Start::default(),
    }
}

/// The nominal bench without noise.
#[cfg(test)]
pub(crate) fn silent() -> Bench {
    bench(&nominal(), Noise { rms_m: 0.0, coloured_share: 0.0, corner_hz: 1.0 })
}

/// The plant file that a diagnosis is given; `zeroed_um` is how well the sensor's zero is known, where it is not exact.
pub(crate) fn plant_toml(noise_um: f64, zeroed_um: Option<f64>) -> String {
    let source = "thesis, Table 2.1; sigma stated by the case";
    let record = |key: &str, value: f64, sigma: f64| {
        format!("{key} = {{ value = {value:?}, sigma = {sigma:?}, source = \"{source}\" }}\n")
    };
    let actuator = record("transduction_C_per_m", TABLE.transduction_c_per_m, SIGMA);
    let mut hysterons = String::new();
    for i in 0..2 {
        hysterons += "\n[[actuator.hysteron]]\n";
        hysterons += &record("capacitance_F", TABLE.capacitance_f[i], SIGMA);
        hysterons += &record("slope_S", TABLE.slope_s[i], SIGMA);
        hysterons += &record("dead_zone_V", TABLE.dead_zone_v[i], SIGMA);
    }
    let mut structure = record("mass_kg", TABLE.mass_kg, SIGMA_MASS);
    structure += &record("damping_N_s_per_m", TABLE.damping_n_s_per_m, SIGMA);
    structure += &record("stiffness_N_per_m", TABLE.stiffness_n_per_m, SIGMA);
    let zero = zeroed_um.map_or_else(String::new, |sigma_um| {
        format!("offset_um = {{ value = 0.0, sigma_abs = {sigma_um:?}, source = \"zeroed by hand\" }}\n")
    });
    format!(
        "# Nominal plant of a made case: thesis Table 2.1.\nschema = \"hysteron-model-1\"\nname = \"nominal plant\"\n\
         kind = \"phs\"\n\n[actuator]\n{actuator}{hysterons}\n[structure]\n{structure}\n[sensor]\n\
         noise_um = {{ value = {noise_um:.6}, sigma = 0.1, source = \"data sheet\" }}\n{zero}\n[rig]\n\
         drive_min_V = {{ value = -90.0, source = \"assumed\" }}\n\
         drive_max_V = {{ value = 90.0, source = \"assumed\" }}\n\
         displacement_max_um = {{ value = 120.0, source = \"thesis, section 3\" }}\n"
    )
}
