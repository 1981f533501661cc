//! Periodic force: something shakes the structure at a frequency of its own.

use super::parts::phasor;
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Shake};

effect!(PeriodicForce, "periodic_force", Environment);

const ABOUT: About = About {
    title: "periodic force",
    what: "A fan, a pump or the floor shakes the structure at one frequency.",
    equation: "F = a cos(2 pi f t) + b sin(2 pi f t) on the mass; f: frequency, t: time since the log's start, a and \
               b: of each log, since nothing ties its phase to the log's start",
    source: "common form, size assumed",
    typical: "1 to 100 nm between 10 and 200 Hz",
    installs: "an external force",
    signature: "one line in the residual's spectrum that is not tied to the drive and passes through the plant's \
                dynamics",
    rivals: &["mains_hum", "vibration_mode"],
    experiment: "10 s at zero input: the line stays and a mode is silent. A line at the mains' frequency is told from \
                 hum by touching nothing but the sensor: hum stays when the mover is clamped",
    spec: "zero@10s",
};

/// Frequencies from which a search starts, where no spectrum says where the line is.
const N_STARTS: usize = 80;

fn hz(scales: &Scales<'_>) -> Parameter {
    let bounds = [3.0 / scales.longest_s, 0.45 / scales.sample_s];
    Parameter::shape("line_hz", "Hz", bounds, spaced(2.0 * bounds[0], 0.9 * bounds[1], N_STARTS))
}

fn amplitudes(scales: &Scales<'_>, names: [&'static str; 2]) -> [Parameter; 2] {
    let force_n = scales.plant.stiffness_n_per_m * scales.stroke_m;
    phasor(names, "N", force_n, 5e-4 * force_n)
}

fn add(chain: &mut Chain, hz: f64, cos_n: f64, sin_n: f64) {
    chain.parts.shakes.push(Shake { hz, cos_n, sin_n });
}

/// Fundamental and what goes with it: a push that is short has many.
const HARMONICS: [[&str; 2]; 6] = [
    ["cos_1_n", "sin_1_n"],
    ["cos_2_n", "sin_2_n"],
    ["cos_3_n", "sin_3_n"],
    ["cos_4_n", "sin_4_n"],
    ["cos_5_n", "sin_5_n"],
    ["cos_6_n", "sin_6_n"],
];

/// A line whose size and phase change within a log, as five lines around it.
const BAND: [[&str; 2]; 5] = [
    ["cos_lowest_n", "sin_lowest_n"],
    ["cos_lower_n", "sin_lower_n"],
    ["cos_n", "sin_n"],
    ["cos_upper_n", "sin_upper_n"],
    ["cos_uppermost_n", "sin_uppermost_n"],
];

const FORMS: &[Form] = &[
    Form::predictable(
        "line",
        |scales| std::iter::once(hz(scales)).chain(amplitudes(scales, ["cos_n", "sin_n"])).collect(),
        |chain, p| add(chain, p[0], p[1], p[2]),
    ),
    Form::predictable(
        "line-with-second-harmonic",
        |scales| {
            let first = amplitudes(scales, ["cos_n", "sin_n"]);
            let second = amplitudes(scales, ["second_cos_n", "second_sin_n"]);
            std::iter::once(hz(scales)).chain(first).chain(second).collect()
        },
        |chain, p| {
            add(chain, p[0], p[1], p[2]);
            add(chain, 2.0 * p[0], p[3], p[4]);
        },
    ),
    Form::predictable(
        "line-with-harmonics",
        |scales| {
            let phasors = HARMONICS.into_iter().flat_map(|names| amplitudes(scales, names));
            std::iter::once(hz(scales)).chain(phasors).collect()
        },
        |chain, p| {
            for (i, phasor) in p[1..].chunks_exact(2).enumerate() {
                add(chain, p[0] * (i + 1) as f64, phasor[0], phasor[1]);
            }
        },
    ),
    Form::predictable(
        "broadened-line",
        |scales| {
            let longest_s = scales.longest_s;
            let bounds = [0.45 * longest_s, 2.0 * longest_s];
            let length = Parameter::shape("length_s", "s", bounds, vec![longest_s]);
            let phasors = BAND.into_iter().flat_map(|names| amplitudes(scales, names));
            [hz(scales), length].into_iter().chain(phasors).collect()
        },
        |chain, p| {
            for (side, phasor) in (-2..=2).zip(p[2..].chunks_exact(2)) {
                // Lines closer to zero than the line itself would stand for another one.
                add(chain, (p[0] + f64::from(side) / p[1]).max(0.1 * p[0]), phasor[0], phasor[1]);
            }
        },
    ),
    Form::predictable(
        "two-lines",
        |scales| {
            let second = Parameter { name: "second_line_hz", ..hz(scales) };
            let first = amplitudes(scales, ["cos_n", "sin_n"]);
            let phasors = first.into_iter().chain(amplitudes(scales, ["second_cos_n", "second_sin_n"]));
            [hz(scales), second].into_iter().chain(phasors).collect()
        },
        |chain, p| {
            add(chain, p[0], p[2], p[3]);
            add(chain, p[1], p[4], p[5]);
        },
    ),
];
