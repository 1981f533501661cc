//! Payload mass: the moving mass is not the nominal one.

use super::vibration_mode::{attach, resonance};
use super::{About, Form, Parameter};

effect!(PayloadMass, "payload_mass", Structure);

const ABOUT: About = About {
    title: "payload mass",
    what: "More or less mass moves than the nominal plant has.",
    equation: "M (1 + m) q'' = ..., f = f0 / sqrt(1 + m), or the mass m M on a spring and a damper of its own (on-mount); M: \
               nominal mass, m: added share, q: displacement, f0 and f: resonance without and with the load",
    source: "common form, size assumed",
    typical: "5 % to the plant's own mass: resonance lower by 2 to 29 %",
    installs: "a factor on the mass, or an attached mass",
    signature: "the resonance moves and its height changes, the static gain stays, at every amplitude",
    rivals: &["vibration_mode", "nonlinear_stiffness"],
    experiment: "a multisine across the resonance at two amplitudes: a mass moves it alike in both. A known weight on \
                 top settles it",
    spec: "multisine:15V@10-2000Hz,periods=4,for=1s+multisine:5V@10-2000Hz,periods=4,for=1s",
};

const FORMS: &[Form] = &[
    Form::predictable(
        "rigid",
        |_| vec![Parameter::amplitude("mass_ratio", "", [-0.2, 5.0], 0.05)],
        |chain, p| chain.plant.mass_kg *= 1.0 + p[0],
    ),
    Form::predictable(
        "on-mount",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            vec![Parameter::amplitude("mass_ratio", "", [0.0, 5.0], 0.05), hz, damping_ratio]
        },
        attach,
    ),
];
