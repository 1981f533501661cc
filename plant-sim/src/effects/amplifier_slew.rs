//! Amplifier slew: the drive rises no faster than a limit.

use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::Chain;

effect!(AmplifierSlew, "amplifier_slew", Drive);

const ABOUT: About = About {
    title: "amplifier slew limit",
    what: "The drive can't change faster than a limit: of the amplifier itself, or of its current into the actuator's \
           capacitance.",
    equation: "-S_down <= v' <= S, or |v'| <= S away from zero and r S back to it; with a current limit S = I/C; v: drive, S: slew limit, I: largest current, C: capacitance of \
               the load, r: ratio",
    source: "PiezoDrive PD200 (about 150 V/us) and piezosystem nv200 (set by the user) manuals; current limit 0.5 A \
             into 20 uF = 25 V/ms: Thorlabs BPC notes",
    typical: "0.02 to 150 V/us",
    installs: "the drive's largest rate, the same in both directions, one for each, or one outwards and one back",
    signature: "steps become ramps of one slope; sines turn into triangles beyond a product of frequency and amplitude",
    rivals: &["amplifier_bandwidth", "amplifier_saturation", "rate_dependent_hysteresis"],
    experiment: "steps of two heights: a slew limit takes a time in proportion to the height, a lag doesn't",
    spec: "square:15V@5Hz,for=2s+square:60V@5Hz,for=2s",
};

fn slew(scales: &Scales<'_>) -> Parameter {
    let usual = scales.usual_rate_v_per_s();
    // Beyond the largest step within a sample nothing is limited.
    let fastest = 3.0 * (2.0 * scales.drive_v / scales.sample_s).max(usual);
    let mut starts = vec![0.3 * usual, 0.6 * usual, 0.85 * usual];
    // Steps are limited where ramps and sines no longer are.
    starts.extend(spaced(1.5 * usual, 0.2 * fastest, 5));
    Parameter::shape("slew_v_per_s", "V/s", [0.02 * usual, fastest], starts)
}

fn limit(chain: &mut Chain, up_v_per_s: f64, down_v_per_s: f64) {
    let drive = &mut chain.drive;
    drive.slew_v_per_s = drive.slew_v_per_s.min(up_v_per_s);
    drive.slew_down_v_per_s = drive.slew_down_v_per_s.min(down_v_per_s);
}

const FORMS: &[Form] = &[
    Form::predictable("slew", |scales| vec![slew(scales)], |chain, p| limit(chain, p[0], p[0])),
    Form::predictable(
        "slew-up-and-down",
        |scales| {
            let starts = vec![0.6, 1.0, 1.6];
            vec![slew(scales), Parameter::shape("down_over_up", "", [0.1, 10.0], starts)]
        },
        |chain, p| limit(chain, p[0], p[0] * p[1]),
    ),
    Form::predictable(
        "slew-out-and-back",
        |scales| vec![slew(scales), Parameter::shape("back_over_out", "", [0.1, 10.0], vec![0.4, 2.5])],
        |chain, p| {
            limit(chain, p[0], p[0]);
            chain.drive.discharge_ratio = p[1];
        },
    ),
];
