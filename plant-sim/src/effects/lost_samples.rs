//! Lost samples: some readings or commands never arrive.

use super::parts::either;
use super::{About, Form, Kind, Parameter, Scales};

effect!(LostSamples, "lost_samples", Timing);

const ABOUT: About = About {
    title: "lost samples",
    what: "Now and then a reading repeats the one before, or a command doesn't arrive and the old one stays.",
    equation: "y_k = y_(k-1) with probability p, or u_k = u_(k-1) with probability p; y: readings, u: commands that \
               act, k: sample",
    source: "common form, size assumed; that links lose and delay samples: ArduPilot issues 11217 and 14561",
    typical: "1e-4 to 1e-2 of the samples",
    installs: "a share of repeated readings or of commands not received",
    signature: "readings that repeat exactly while the plant moves; or after single commands the echo of a pulse that is as high as the \
                command's step",
    rivals: &["sampling_jitter", "noise_excess"],
    experiment: "a fast sine with sequence numbers logged: repeated readings are equal to the last digit while the \
                 plant moves",
    spec: "sine:60V@50Hz,for=4s",
};

fn share(_: &Scales<'_>) -> Vec<Parameter> {
    vec![Parameter::amplitude("share", "", [0.0, 0.5], 1e-3)]
}

const FORMS: &[Form] = &[
    Form {
        name: "repeated",
        kind: Kind::Events,
        parameters: share,
        install: |chain, p| chain.sensor.repeated_share = either(chain.sensor.repeated_share, p[0]),
        mirrors: None,
    },
    Form {
        name: "held-command",
        kind: Kind::Events,
        parameters: share,
        install: |chain, p| chain.drive.lost_share = either(chain.drive.lost_share, p[0]),
        mirrors: None,
    },
];
