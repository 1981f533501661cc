//! Backlash: lost motion between the structure and what the sensor sees.

use super::{About, Form, Parameter};

effect!(Backlash, "backlash", Structure);

const ABOUT: About = About {
    title: "backlash",
    what: "A joint has play: after each reversal the sensor's side stays until the play is used up.",
    equation: "play operator: y follows q within +-g/2; q: displacement of the structure, y: displacement that the \
               sensor sees, g: full width of the play",
    source: "play operator: famura/blm (backlash model); port-Hamiltonian view: arXiv 2603.25211; size assumed",
    typical: "0.01 to 1 um",
    installs: "a play between structure and sensor",
    signature: "flat spots of constant width after each reversal, at every amplitude and rate; the structure's \
                dynamics are untouched",
    rivals: &["coulomb_friction", "extra_hysteron"],
    experiment: "nested loops down to the smallest: play swallows motion below its width entirely, a hysteron only in \
                 part",
    spec: "minor-loops:60V@1Hz+minor-loops:6V@1Hz",
};

const FORMS: &[Form] = &[Form::predictable(
    "play",
    |scales| vec![Parameter::amplitude("play_m", "m", [0.0, scales.stroke_m / 3.0], scales.stroke_m / 200.0)],
    |chain, p| chain.sensor.play_m += p[0],
)];
