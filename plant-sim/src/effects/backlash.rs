//! Backlash: lost motion between the structure and what the sensor sees.

use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Gap, Sensor};

effect!(Backlash, "backlash", Structure);

const ABOUT: About = About {
    title: "backlash",
    what: "A joint has play: after each reversal the sensor's side stays until the play is used up.",
    equation: "play operator: y follows q within +-g/2; with drag: within the play tau y' = q - y besides; taken up by a spring: tau y' = q + s \
               g/2 - y, s = -1 or 1; several \
               plays: the mean of five, g (1 - s) to g wide; gap: y = q - clamp(q - q0, -g/2, g/2); q: displacement \
               of the structure, y: displacement that the sensor sees, g: full width of the play, s: spread, q0: \
               where the gap lies",
    source: "play, gap and joint with drag: Nordin and Gutman (2002), Automatica 38, 1633; several plays that \
             close one after the other: the Prandtl-Ishlinskii operator of the displacement; port-Hamiltonian view: arXiv \
             2603.25211; size assumed",
    typical: "0.01 to 1 um",
    installs: "a play between structure and sensor",
    signature: "flat spots of constant width after each reversal, at every amplitude and rate; the structure's \
                dynamics are untouched",
    rivals: &["coulomb_friction", "extra_hysteron", "sensor_nonlinearity"],
    experiment: "nested loops down to the smallest: play swallows motion below its width entirely, a hysteron only in \
                 part",
    spec: "minor-loops:60V@1Hz+minor-loops:6V@1Hz",
};

fn width(name: &'static str, scales: &Scales<'_>) -> Parameter {
    Parameter::amplitude(name, "m", [0.0, scales.stroke_m / 3.0], scales.stroke_m / 200.0)
}

/// Widens the play, and says what share of it is new: all where there was none.
fn widen(sensor: &mut Sensor, play_m: f64) -> f64 {
    let before_m = sensor.play_m;
    sensor.play_m += play_m;
    if before_m > 0.0 { play_m / sensor.play_m } else { 1.0 }
}

/// A play with drag. One that is there already has its part in how fast the whole creeps, and to where.
fn add_dragged(chain: &mut Chain, play_m: f64, drag_s: f64, towards: f64) {
    let sensor = &mut chain.sensor;
    let new = widen(sensor, play_m);
    let [before_per_s, new_per_s] = [(1.0 - new) / sensor.drag_s, new / drag_s];
    if new_per_s > 0.0 {
        let both_per_s = before_per_s + new_per_s;
        sensor.drag_to = (before_per_s * sensor.drag_to + new_per_s * towards) / both_per_s;
        sensor.drag_s = both_per_s.recip();
    }
}

const FORMS: &[Form] = &[
    Form::predictable("play", |scales| vec![width("play_m", scales)], |chain, p| chain.sensor.play_m += p[0]),
    Form::predictable(
        "play-with-drag",
        |scales| {
            let sample_s = scales.sample_s;
            let starts = spaced(3.0 * sample_s, 300.0 * sample_s, 3);
            vec![width("play_m", scales), Parameter::shape("drag_s", "s", [sample_s, 1e4 * sample_s], starts)]
        },
        |chain, p| add_dragged(chain, p[0], p[1], 0.0),
    ),
    Form::predictable(
        "play-taken-up",
        |scales| {
            let sample_s = scales.sample_s;
            let starts = spaced(10.0 * sample_s, 1000.0 * sample_s, 2);
            vec![
                width("play_m", scales),
                Parameter::shape("drag_s", "s", [sample_s, 1e4 * sample_s], starts),
                Parameter::place("towards", "", [-1.0, 1.0], vec![-1.0, 1.0]),
            ]
        },
        |chain, p| add_dragged(chain, p[0], p[1], p[2]),
    ),
    Form::predictable(
        "several-plays",
        |scales| vec![width("play_m", scales), Parameter::shape("spread", "", [0.05, 1.0], vec![0.6, 0.95])],
        |chain, p| {
            let new = widen(&mut chain.sensor, p[0]);
            chain.sensor.play_spread += new * (p[1] - chain.sensor.play_spread);
        },
    ),
    Form::predictable(
        "gap",
        |scales| {
            let [low_m, high_m] = scales.displacement_m;
            let at = |share: f64| low_m + share * (high_m - low_m);
            let starts = [0.2, 0.4, 0.5, 0.6, 0.8].map(at).to_vec();
            vec![width("gap_m", scales), Parameter::place("at_m", "m", [low_m, high_m], starts)]
        },
        |chain, p| chain.sensor.gaps.push(Gap { width_m: p[0], at_m: p[1] }),
    ),
];
