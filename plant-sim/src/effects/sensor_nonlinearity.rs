//! Sensor nonlinearity: the reading is a curve of the displacement.

use super::sensor_gain::{half_difference, skew};
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Cycle, Flaw};

effect!(SensorNonlinearity, "sensor_nonlinearity", Sensor);

const ABOUT: About = About {
    title: "sensor nonlinearity",
    what: "The reading is a slightly bent function of the displacement, the same at every rate.",
    equation: "y = q + c2 q^2 + c3 q^3, or y = q + a cos(2 pi q / p) + b sin(2 pi q / p) (cyclic), \
               or any smooth curve: both, p a little more than the range and its first fractions; or y = q + h exp(-x^2/2) (a \
               flaw of the target), y = q + h clamp(x, -1, 1) (another slope there), x = (q - m)/w; or y = q + d |q| (a kink \
               at zero); q: displacement, y: reading, c2, c3 and d: coefficients, a, b and p: amplitudes and period, \
               h, m and w: height, middle and half width",
    source: "PI E-727 manual (the controller corrects a sensor polynomial up to the fourth order); size assumed",
    typical: "0.01 to 1 % of the stroke",
    installs: "a polynomial of the sensor",
    signature: "harmonics without a loop: the residual is one curve over the displacement, at every rate",
    rivals: &[
        "sensor_gain",
        "nonlinear_stiffness",
        "asymmetric_stiffness",
        "asymmetric_hysteresis",
        "amplifier_saturation",
        "backlash",
    ],
    experiment: "slow and fast sines of the same displacement: the curve stays, a spring's changes near the resonance \
                 and a clip goes with the command",
    spec: "sine:60V@1Hz,for=3s+sine:30V@1Hz,for=3s+sine:30V@100Hz,for=1s",
};

fn quadratic(scales: &Scales<'_>) -> Parameter {
    Parameter::signed("quadratic_per_m", "1/m", 0.3 / scales.stroke_m, 2e-3 / scales.stroke_m)
}

fn cubic(scales: &Scales<'_>) -> Parameter {
    let stroke_m2 = scales.stroke_m.powi(2);
    Parameter::signed("cubic_per_m2", "1/m^2", 0.3 / stroke_m2, 2e-3 / stroke_m2)
}

fn curve(chain: &mut Chain, quadratic_per_m: f64, cubic_per_m2: f64) {
    chain.sensor.quadratic_per_m += quadratic_per_m;
    chain.sensor.cubic_per_m2 += cubic_per_m2;
}

/// Periods from which a search starts: a score test resolves about an octave.
const N_PERIODS: usize = 7;

/// Waves over a little more than the whole range, a fraction of it, and so on.
const WAVES: [&str; 6] = ["cos_1_m", "sin_1_m", "cos_2_m", "sin_2_m", "cos_3_m", "sin_3_m"];

/// Height, place and half width of an error at one place.
fn flaw(scales: &Scales<'_>) -> Vec<Parameter> {
    let stroke_m = scales.stroke_m;
    let [low_m, high_m] = scales.displacement_m;
    let starts = [0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85].map(|share| low_m + share * (high_m - low_m)).to_vec();
    vec![
        Parameter::signed("height_m", "m", 0.1 * stroke_m, 1e-3 * stroke_m),
        Parameter::place("at_m", "m", [low_m, high_m], starts),
        Parameter::shape("width_m", "m", [5e-3 * stroke_m, 0.5 * stroke_m], vec![0.05 * stroke_m, 0.2 * stroke_m]),
    ]
}

const FORMS: &[Form] = &[
    Form::predictable("quadratic", |scales| vec![quadratic(scales)], |chain, p| curve(chain, p[0], 0.0)),
    Form::predictable("cubic", |scales| vec![cubic(scales)], |chain, p| curve(chain, 0.0, p[0])),
    Form::predictable("both", |scales| vec![quadratic(scales), cubic(scales)], |chain, p| curve(chain, p[0], p[1])),
    Form::predictable(
        "curve",
        |scales| {
            let wave = |name| Parameter::signed(name, "m", 0.1 * scales.stroke_m, 1e-3 * scales.stroke_m);
            let period_m = 2.2 * scales.stroke_m;
            let period = Parameter::shape("period_m", "m", [0.9 * period_m, 1.3 * period_m], vec![period_m]);
            [period, quadratic(scales), cubic(scales)].into_iter().chain(WAVES.map(wave)).collect()
        },
        |chain, p| {
            curve(chain, p[1], p[2]);
            for (waves, wave) in (1..).zip(p[3..].chunks_exact(2)) {
                // The reading at zero is the offset's business.
                chain.sensor.offset_m -= wave[0];
                let period_m = p[0] / f64::from(waves);
                chain.sensor.cycles.push(Cycle { period_m, cos_m: wave[0], sin_m: wave[1] });
            }
        },
    ),
    // No measurement tells it from a gain by side, sensor_gain's: the two are a class.
    Form::predictable("kink-at-zero", half_difference, skew),
    Form::predictable("flaw", flaw, |chain, p| {
        chain.sensor.flaws.push(Flaw { bump_m: p[0], at_m: p[1], width_m: p[2], rise_m: 0.0 });
    }),
    Form::predictable("another-slope", flaw, |chain, p| {
        chain.sensor.flaws.push(Flaw { rise_m: p[0], at_m: p[1], width_m: p[2], bump_m: 0.0 });
    }),
    Form::predictable(
        "cyclic",
        |scales| {
            let stroke_m = scales.stroke_m;
            let amplitude = |name| Parameter::signed(name, "m", 0.05 * stroke_m, 1e-3 * stroke_m);
            let bounds = [2e-3 * stroke_m, stroke_m];
            let starts = spaced(0.01 * stroke_m, 0.5 * stroke_m, N_PERIODS);
            vec![Parameter::shape("period_m", "m", bounds, starts), amplitude("cos_m"), amplitude("sin_m")]
        },
        |chain, p| chain.sensor.cycles.push(Cycle { period_m: p[0], cos_m: p[1], sin_m: p[2] }),
    ),
];
