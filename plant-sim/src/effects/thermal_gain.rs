//! Thermal gain: the actuator's gain changes as it warms.

use super::sensor_gain::{swings, wandering};
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Heat, Warming};

effect!(ThermalGain, "thermal_gain", Actuator);

const ABOUT: About = About {
    title: "thermal gain",
    what: "The gain drifts as the ceramic warms, by itself after it was switched on or by the losses of the drive.",
    equation: "y = y0 (1 + a theta), tau theta' = P - theta, or, with a room that comes and goes, y = y0 (1 + sum a_k (1 \
               - cos(pi k t / T))), k = 1 to 6, T: length of the longest log; a: relative change at theta = 1, tau: thermal time \
               constant, P: heat, which is 1 (time), (v / 60 V)^2 (drive) or |v v'| / (7.2e5 V^2/s) (loss: f C V^2 tan \
               delta, 1 for 60 V at 100 Hz), v: drive",
    source: "common form, size assumed",
    typical: "1 to 10 % at high frequency, over seconds to minutes",
    installs: "a gain of the drive that follows the heat with a lag",
    signature: "the amplitude of the residual grows through the log, in proportion to the displacement; the zero stays",
    rivals: &["amplifier_gain", "creep", "sensor_drift", "sensor_gain"],
    experiment: "a slow sine before and after half a minute of a fast one: warming leaves the gain changed and then \
                 decays, an amplifier keeps it; at zero input nothing drifts",
    spec: "sine:30V@10Hz,for=5s+sine:30V@150Hz,for=30s+sine:30V@10Hz,for=20s",
};

/// References of the two heats that the drive makes. Fixed, so that a coefficient means the same on every rig.
const REFERENCE_V: f64 = 60.0;
const REFERENCE_V2_PER_S: f64 = 2.0 * 100.0 * REFERENCE_V * REFERENCE_V;

/// A coefficient for a heat whose largest value is `heat`, and the time constant.
fn parameters(scales: &Scales<'_>, heat: f64) -> Vec<Parameter> {
    let longest_s = scales.longest_s;
    // Logs shorter than the time constant see a small part of a large change.
    let coefficient = Parameter::signed("coefficient", "", 5.0 / heat, 0.02 / heat);
    let bounds = [0.02 * longest_s, 20.0 * longest_s];
    vec![coefficient, Parameter::shape("time_constant_s", "s", bounds, spaced(0.05 * longest_s, 5.0 * longest_s, 4))]
}

fn warm(chain: &mut Chain, p: &[f64], heat: Heat) {
    chain.drive.warmings.push(Warming { coefficient: p[0], time_constant_s: p[1], heat });
}

const FORMS: &[Form] = &[
    Form::predictable("time", |scales| parameters(scales, 1.0), |chain, p| warm(chain, p, Heat::Time)),
    Form::predictable(
        "drive",
        |scales| parameters(scales, (scales.drive_v / REFERENCE_V).powi(2)),
        |chain, p| warm(chain, p, Heat::Drive { volts: REFERENCE_V }),
    ),
    Form::predictable(
        "loss",
        |scales| parameters(scales, scales.drive_v * scales.usual_rate_v_per_s() / REFERENCE_V2_PER_S),
        |chain, p| warm(chain, p, Heat::Loss { volts2_per_s: REFERENCE_V2_PER_S }),
    ),
    Form::predictable("wander", wandering, |chain, p| chain.drive.swings.extend(swings(p))),
];
