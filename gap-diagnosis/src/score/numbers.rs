//! Numbers of named effects against the true ones, where the true form is one that the registry has.

use super::Rate;
use super::case::{Case, Estimate, Truth};
use serde::Serialize;

/// Half a 95 % interval in standard deviations.
const NINETY_FIVE: f64 = 1.96;

/// Numbers that a page lists.
const LISTED: usize = 10;

/// What a number of the registry's form is in the truth.
enum Is {
    /// The same number.
    Same(&'static str),
    /// The same with the truth's `sign`.
    Signed(&'static str),
    /// So many times that.
    Times(f64, &'static str),
    /// One over that.
    Over(&'static str),
    /// A number that the truth counts otherwise, or from another reference.
    Other,
}

use Is::{Other, Over, Same, Signed, Times};

/// Forms of the truth that the registry has, with all numbers that it gives them.
const FORMS: &[(&str, &[(&str, Is)])] = &[
    ("amplifier_bandwidth: first-order lag", &[("time_constant_s", Same("tau_s"))]),
    ("amplifier_gain: constant", &[("relative_gain", Signed("gain_error"))]),
    ("amplifier_slew: hard limit", &[("slew_v_per_s", Over("slowness_s_per_V"))]),
    ("backlash: play", &[("play_m", Times(2.0, "half_width_m"))]),
    ("clock_error: constant", &[("clock_ratio", Signed("ratio_error"))]),
    ("coulomb_friction: tanh", &[("coulomb_n", Same("force_N")), ("speed_m_per_s", Same("transition_m_per_s"))]),
    (
        "extra_hysteron: one",
        &[("stiffness_ratio", Same("stiffness_share")), ("time_constant_s", Same("tau_s")), ("dead_zone_m", Other)],
    ),
    ("lost_samples: rows repeat the one before", &[("share", Same("probability"))]),
    ("noise_excess: white", &[("rms_m", Same("rms_m"))]),
    ("payload_mass: rigid", &[("mass_ratio", Same("mass_share"))]),
    ("periodic_force: sine", &[("line_hz", Same("hz")), ("cos_n", Other), ("sin_n", Other)]),
    ("quantisation: sensor's converter", &[("quantum_m", Same("step_m"))]),
    (
        "rate_dependent_hysteresis: power-law leak",
        &[("excess_exponent", Signed("exponent_off_one")), ("reference_share", Other)],
    ),
    ("sampling_jitter: Gaussian", &[("rms_s", Same("rms_s"))]),
    // Uniform from -h to h: the rms is h over the root of three.
    ("sampling_jitter: uniform", &[("rms_s", Times(0.577_350_269, "half_s"))]),
    ("sensor_bandwidth: first-order lag", &[("time_constant_s", Same("tau_s"))]),
    ("sensor_drift: thermal, first order", &[("amplitude_m", Other), ("time_constant_s", Same("tau_s"))]),
    ("sensor_gain: constant", &[("relative_gain", Signed("gain_error"))]),
    ("sensor_offset: constant", &[("offset_m", Signed("offset_m"))]),
    ("thermal_gain: with time", &[("coefficient", Signed("gain_share")), ("time_constant_s", Same("tau_s"))]),
    ("transport_delay: of the command", &[("delay_s", Same("delay_s"))]),
    (
        "vibration_mode: beside the main mode",
        &[
            // The truth counts it from the nominal bench's gain, the registry from the plant's own compliance.
            ("compliance_ratio", Other),
            ("natural_hz", Same("hz")),
            ("damping_ratio", Same("damping_ratio")),
        ],
    ),
    (
        "vibration_mode: target on an arm",
        &[("arm_share", Signed("share")), ("natural_hz", Same("hz")), ("damping_ratio", Same("damping_ratio"))],
    ),
];

/// How well the numbers of named effects are known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Numbers {
    /// True numbers inside their 95 % interval.
    pub inside_ci95: Rate,
    /// Those outside, farthest first.
    pub outside: Vec<Outside>,
}

impl Numbers {
    /// Those that a page lists.
    pub fn listed(&self) -> &[Outside] {
        &self.outside[..self.outside.len().min(LISTED)]
    }
}

/// A true number outside the interval of the one that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outside {
    /// The case.
    pub id: String,
    /// The effect.
    pub effect: String,
    /// Name of the number in the registry, unit in the name.
    pub name: String,
    /// What is so.
    pub truth: f64,
    /// What was found, with its standard deviation.
    pub found: f64,
    /// See `found`.
    pub sigma: f64,
}

impl Outside {
    /// How far off, in standard deviations.
    pub fn deviation(&self) -> f64 {
        (self.found - self.truth) / self.sigma
    }
}

/// Forms of the truth that the registry has, each with the names of all its numbers there.
pub fn known_forms() -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
    FORMS.iter().map(|(form, numbers)| (*form, numbers.iter().map(|(name, _)| *name).collect()))
}

/// Compares all numbers that can be: those of effects that are there, were named, and were fitted in the form that is so.
pub fn numbers(cases: &[Case]) -> Numbers {
    let compared: Vec<Outside> = cases.iter().flat_map(compared).collect();
    let is_inside = |number: &Outside| (number.found - number.truth).abs() <= NINETY_FIVE * number.sigma;
    let inside_ci95 = Rate::count(&compared, is_inside);
    let mut outside: Vec<Outside> = compared.into_iter().filter(|number| !is_inside(number)).collect();
    outside.sort_by(|a, b| b.deviation().abs().total_cmp(&a.deviation().abs()));
    Numbers { inside_ci95, outside }
}

fn compared(case: &Case) -> Vec<Outside> {
    let Some(answer) = case.answered() else { return Vec::new() };
    let mut all = Vec::new();
    for (form, known) in FORMS.iter().filter(|(form, _)| case.truth.form.split(" + ").any(|own| own == *form)) {
        let effect = form.split(':').next().unwrap_or(form);
        let found: Vec<&Estimate> = answer.parameters.iter().filter(|own| own.effect == effect).collect();
        let is_same_form = found.len() == known.len()
            && found.iter().all(|estimate| known.iter().any(|(name, _)| *name == estimate.name));
        if !is_same_form || !answer.effects.iter().any(|named| named == effect) {
            continue;
        }
        for estimate in found {
            let is = known.iter().find(|(name, _)| *name == estimate.name);
            let truth = is.and_then(|(_, is)| is.value(&case.truth, effect));
            let Some((truth, sigma)) = truth.zip(estimate.sigma) else { continue };
            all.push(Outside {
                id: case.id.clone(),
                effect: effect.to_owned(),
                name: estimate.name.clone(),
                truth,
                found: estimate.value,
                sigma,
            });
        }
    }
    all
}

impl Is {
    fn value(&self, truth: &Truth, effect: &str) -> Option<f64> {
        let of = |key: &str| {
            let is = |own: &&(String, f64)| own.0.split_once('.') == Some((effect, key));
            truth.parameters.iter().find(is).map(|(_, value)| *value)
        };
        match self {
            Same(key) => of(key),
            Signed(key) => Some(of(key)? * of("sign")?),
            Times(factor, key) => Some(factor * of(key)?),
            Over(key) => Some(1.0 / of(key)?),
            Other => None,
        }
    }
}
