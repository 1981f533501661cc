//! Amplifier slew: the drive rises no faster than a limit.

use super::parts::add_first;
use super::{About, Form, Parameter, Scales, spaced};

effect!(AmplifierSlew, "amplifier_slew", Drive);

const ABOUT: About = About {
    title: "amplifier slew limit",
    what: "The drive can't change faster than a limit: of the amplifier itself, or of its current into the actuator's \
           capacitance.",
    equation: "|v'| <= S; with a current limit S = I/C; v: drive, S: slew limit, I: largest current, C: capacitance of \
               the load",
    source: "PiezoDrive PD200 (about 150 V/us) and piezosystem nv200 (set by the user) manuals; current limit 0.5 A \
             into 20 uF = 25 V/ms: Thorlabs BPC notes",
    typical: "0.02 to 150 V/us",
    installs: "the drive's largest rate, in one form followed by a first-order lag",
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

const FORMS: &[Form] = &[
    Form::predictable(
        "slew",
        |scales| vec![slew(scales)],
        |chain, p| chain.drive.slew_v_per_s = chain.drive.slew_v_per_s.min(p[0]),
    ),
    Form::predictable(
        "current-limit",
        |scales| {
            let sample_s = scales.sample_s;
            vec![slew(scales), Parameter::amplitude("time_constant_s", "s", [0.0, 100.0 * sample_s], 0.5 * sample_s)]
        },
        |chain, p| {
            chain.drive.slew_v_per_s = chain.drive.slew_v_per_s.min(p[0]);
            add_first(&mut chain.drive.lag, p[1]);
        },
    ),
];
