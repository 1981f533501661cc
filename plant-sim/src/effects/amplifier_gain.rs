//! Amplifier gain: the drive delivers more or less than the nominal volts.

use super::parts::come_late;
use super::sensor_bandwidth::tail;
use super::{About, Form, Parameter, Scales};
use crate::chain::{Chain, Hinge, Swing};

effect!(AmplifierGain, "amplifier_gain", Drive);

const ABOUT: About = About {
    title: "amplifier gain",
    what: "The amplifier delivers a fixed share more or less than it should.",
    equation: "v = (1 + g) u, v = (1 + s sign(u)) u, v = (1 + c |u|) u, v = u + h w clamp(u/w, -1, 1) (another gain about zero), or v = \
               u + s x with T x' + x = u (what is slow has another gain), or v = (1 + a \
               cos wt + b sin wt) u with the ripple of a supply, at the mains' frequency and twice that; u: command, v: drive, g: relative gain error, \
               s: half of the difference between the gains of either polarity (two output stages), c: how the gain \
               grows with the voltage, h: excess of the gain within w, s: excess of the gain of what is slow",
    source: "common form, size assumed",
    typical: "0.5 to 5 %",
    installs: "a factor on the drive",
    signature: "a residual in proportion to the displacement, without lag; dead zones seem narrower or wider by the \
                same factor",
    rivals: &["sensor_gain", "thermal_gain", "amplifier_bandwidth", "sensor_bandwidth"],
    experiment: "tap the amplifier's output: command against drive shows its gain and leaves the sensor's. Without a \
                 tap, small and large amplitudes tell a little: a drive gain moves the dead zones, a sensor gain \
                 doesn't",
    spec: "minor-loops:60V@1Hz+minor-loops:20V@1Hz",
};

/// What a supply ripples with: the mains and twice the mains, as a rectifier makes it.
fn ripple(_: &Scales<'_>) -> Vec<Parameter> {
    ["cos_1_share", "sin_1_share", "cos_2_share", "sin_2_share"]
        .map(|name| Parameter::signed(name, "", 0.3, 0.005).told_at_once())
        .to_vec()
}

fn add_ripple(chain: &mut Chain, mains_hz: f64, p: &[f64]) {
    // A swing is one at the log's start; a ripple is one in the mean and this at the start.
    let start = 1.0 + p.iter().step_by(2).sum::<f64>();
    let swing = |(harmonic, shares): (usize, &[f64])| Swing {
        hz: mains_hz * (harmonic + 1) as f64,
        cos_share: -shares[0] / start,
        sin_share: shares[1] / start,
    };
    chain.drive.swings.extend(p.chunks_exact(2).enumerate().map(swing));
    chain.drive.gain *= start;
}

const FORMS: &[Form] = &[
    Form::predictable(
        "gain",
        |_| vec![Parameter::signed("relative_gain", "", 0.5, 0.02)],
        |chain, p| chain.drive.gain *= 1.0 + p[0],
    ),
    // The gain that both have in common is a number of the plant's; its other half is left.
    Form::predictable(
        "by-polarity",
        |_| vec![Parameter::signed("half_difference", "", 0.3, 0.01)],
        |chain, p| chain.drive.hinges.push(Hinge { at_v: 0.0, change: p[0] }),
    ),
    Form::predictable(
        "growing",
        |scales| {
            let drive_v = scales.drive_v;
            vec![Parameter::signed("growth_per_v", "1/V", 0.3 / drive_v, 0.01 / drive_v)]
        },
        |chain, p| chain.drive.gain_growth_per_v += p[0],
    ),
    // Both halves of an output stage conduct about zero.
    Form::predictable(
        "about-zero",
        |scales| {
            let drive_v = scales.drive_v;
            let starts = [0.05, 0.15, 0.4].map(|share| share * drive_v).to_vec();
            let half_width = Parameter::shape("half_width_v", "V", [0.01 * drive_v, 0.8 * drive_v], starts);
            vec![Parameter::signed("excess_gain", "", 0.5, 0.02), half_width]
        },
        |chain, p| {
            let hinge = |at_v: f64| Hinge { at_v, change: 0.5 * p[0] * -at_v.signum() };
            chain.drive.hinges.extend([-p[1], p[1]].map(hinge));
        },
    ),
    // Resistors divide what is slow and capacitors what is fast; where they don't agree, one of both gains is wrong.
    Form::predictable("of-slow", tail, |chain, p| {
        chain.drive.gain *= 1.0 + p[0];
        come_late(chain, p[0] / (1.0 + p[0]), p[1]);
    }),
    Form::predictable("50 Hz ripple", ripple, |chain, p| add_ripple(chain, 50.0, p)),
    Form::predictable("60 Hz ripple", ripple, |chain, p| add_ripple(chain, 60.0, p)),
];
