//! Amplifier gain: the drive delivers more or less than the nominal volts.

use super::{About, Form, Parameter};
use crate::chain::Swing;

effect!(AmplifierGain, "amplifier_gain", Drive);

const ABOUT: About = About {
    title: "amplifier gain",
    what: "The amplifier delivers a fixed share more or less than it should.",
    equation: "v = (1 + g) u, v = (1 + s sign(u)) u, v = (1 + c |u|) u, or v = (1 + a \
               (1 - cos wt) + b sin wt) u with the ripple of a supply; u: command, v: drive, g: relative gain error, \
               s: half of the difference between the gains of either polarity (two output stages), c: how the gain \
               grows with the voltage",
    source: "common form, size assumed",
    typical: "0.5 to 5 %",
    installs: "a factor on the drive",
    signature: "a residual in proportion to the displacement, without lag; dead zones seem narrower or wider by the \
                same factor",
    rivals: &["sensor_gain", "thermal_gain"],
    experiment: "tap the amplifier's output: command against drive shows its gain and leaves the sensor's. Without a \
                 tap, small and large amplitudes tell a little: a drive gain moves the dead zones, a sensor gain \
                 doesn't",
    spec: "minor-loops:60V@1Hz+minor-loops:20V@1Hz",
};

/// Mains and twice the mains.
const RIPPLES_HZ: [f64; 4] = [50.0, 60.0, 100.0, 120.0];

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
        |chain, p| chain.drive.gain_skew += p[0],
    ),
    Form::predictable(
        "growing",
        |scales| {
            let drive_v = scales.drive_v;
            vec![Parameter::signed("growth_per_v", "1/V", 0.3 / drive_v, 0.01 / drive_v)]
        },
        |chain, p| chain.drive.gain_growth_per_v += p[0],
    ),
    Form::predictable(
        "ripple",
        |_| {
            let part = |name| Parameter::signed(name, "", 0.3, 0.005).of_each_log();
            let hz = Parameter::shape("ripple_hz", "Hz", [20.0, 500.0], RIPPLES_HZ.to_vec());
            vec![part("cos_share"), part("sin_share"), hz]
        },
        |chain, p| chain.drive.swings.push(Swing { hz: p[2], cos_share: p[0], sin_share: p[1] }),
    ),
];
