//! Amplifier saturation: the drive can't leave its range.

use super::parts::narrow;
use super::{About, Form, Parameter, Scales};
use crate::chain::Chain;

effect!(AmplifierSaturation, "amplifier_saturation", Drive);

const ABOUT: About = About {
    title: "amplifier saturation",
    what: "The amplifier's output stays within a range that is narrower than the command's.",
    equation: "v = min(max(u, L), U), or with rounded corners v = u - w ln(1 + exp((u - U)/w)) + w ln(1 + exp((L - \
               u)/w)); where it only compresses, v + s (u - v), or gradually u / sqrt(1 + k u^2); u: command, v: drive, L \
               and U: limits, w: knee, s: gain that is left, k: compression, 1/sqrt(k) the limit",
    source: "common forms, size assumed; the gradual one is the model of solid-state amplifiers of Rapp 1991 with p = 1",
    typical: "supplies end at -20 and 150 V; the knee takes a few volts",
    installs: "the drive's range and its knee",
    signature: "nothing below a level of the command; above it flat tops, whatever the rate",
    rivals: &["amplifier_slew", "nonlinear_stiffness", "end_stop", "sensor_nonlinearity"],
    experiment: "a slow ladder to the largest command: the top levels fall together. A slew limit leaves slow levels \
                 alone, and a stop also acts when the drive is in range",
    spec: "ladder:60V/12,hold=0.5s",
};

/// Where limits may lie and where a search starts, in shares of the half span from its middle. One with a wide corner compresses what stays
/// below it, and may lie farther out.
const BOUNDS: [f64; 2] = [0.3, 1.05];
const SOFT_BOUNDS: [f64; 2] = [0.3, 1.6];
const STARTS: [f64; 4] = [0.6, 0.75, 0.9, 0.97];

/// A limit on the upper (`side` = 1) or lower (-1) side of the command.
fn limit(name: &'static str, scales: &Scales<'_>, side: f64, within: [f64; 2]) -> Parameter {
    let middle_v = 0.5 * (scales.command_v[0] + scales.command_v[1]);
    let at = |share: f64| middle_v + side * share * scales.drive_v;
    let mut bounds = within.map(at);
    bounds.sort_by(f64::total_cmp);
    Parameter::place(name, "V", bounds, STARTS.map(at).to_vec())
}

/// A limit of the magnitude.
fn level(scales: &Scales<'_>, within: [f64; 2]) -> Parameter {
    let largest_v = scales.command_v[0].abs().max(scales.command_v[1].abs());
    Parameter::shape("level_v", "V", within.map(|b| b * largest_v), STARTS.map(|s| s * largest_v).to_vec())
}

/// Width of a rounded corner.
fn knee(scales: &Scales<'_>) -> Parameter {
    let at = |share: f64| share * scales.drive_v;
    Parameter::shape("knee_v", "V", [2e-3, 0.3].map(at), [0.02, 0.1].map(at).to_vec())
}

fn soften(chain: &mut Chain, range_v: [f64; 2], knee_v: f64) {
    narrow(&mut chain.drive.range_v, range_v);
    chain.drive.knee_v = chain.drive.knee_v.max(knee_v);
}

const FORMS: &[Form] = &[
    Form::predictable(
        "upper",
        |scales| vec![limit("upper_v", scales, 1.0, BOUNDS)],
        |chain, p| narrow(&mut chain.drive.range_v, [f64::NEG_INFINITY, p[0]]),
    ),
    Form::predictable(
        "lower",
        |scales| vec![limit("lower_v", scales, -1.0, BOUNDS)],
        |chain, p| narrow(&mut chain.drive.range_v, [p[0], f64::INFINITY]),
    ),
    Form::predictable(
        "both",
        |scales| vec![level(scales, BOUNDS)],
        |chain, p| narrow(&mut chain.drive.range_v, [-p[0], p[0]]),
    ),
    Form::predictable(
        "each-side",
        |scales| vec![limit("upper_v", scales, 1.0, BOUNDS), limit("lower_v", scales, -1.0, BOUNDS)],
        |chain, p| narrow(&mut chain.drive.range_v, [p[1], p[0]]),
    ),
    Form::predictable(
        "soft",
        |scales| vec![level(scales, SOFT_BOUNDS), knee(scales)],
        |chain, p| soften(chain, [-p[0], p[0]], p[1]),
    ),
    Form::predictable(
        "soft-upper",
        |scales| vec![limit("upper_v", scales, 1.0, SOFT_BOUNDS), knee(scales)],
        |chain, p| soften(chain, [f64::NEG_INFINITY, p[0]], p[1]),
    ),
    Form::predictable(
        "soft-lower",
        |scales| vec![limit("lower_v", scales, -1.0, SOFT_BOUNDS), knee(scales)],
        |chain, p| soften(chain, [p[0], f64::INFINITY], p[1]),
    ),
    Form::predictable(
        "compressing",
        |scales| {
            let drive_v = scales.drive_v;
            let level = level(scales, BOUNDS);
            let bounds = [level.bounds[0], 3.0 * level.bounds[1]];
            let starts = [0.7, 0.9, 1.5].map(|share| share * drive_v).to_vec();
            vec![
                Parameter::shape("level_v", "V", bounds, starts),
                Parameter::shape("knee_v", "V", [2e-3 * drive_v, drive_v], vec![0.05 * drive_v, 0.3 * drive_v]),
                Parameter::place("slope_beyond", "", [0.0, 0.95], vec![0.3]),
            ]
        },
        |chain, p| {
            soften(chain, [-p[0], p[0]], p[1]);
            chain.drive.slope_beyond = p[2];
        },
    ),
    Form::predictable(
        "gradual",
        |scales| {
            let per_v2 = scales.drive_v.powi(-2);
            vec![Parameter::amplitude("compression_per_v2", "1/V^2", [0.0, 3.0 * per_v2], 0.03 * per_v2)]
        },
        |chain, p| chain.drive.compression_per_v2 += p[0],
    ),
];
