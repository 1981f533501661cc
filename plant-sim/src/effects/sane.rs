//! Sizes where no log gives any: an example rig for documentation, and bounds of sense for numbers in files.
//!
//! A diagnosis knows its rig and searches within bounds that follow from it. A model file may describe any rig, so its numbers are held
//! against the bounds of all rigs there are.

use super::{Form, Parameter, Scales};
use crate::phs::Phs;

/// A bender much like the thesis', in round numbers: 1 g, 25 N/mm, 50 mN/V.
static EXAMPLE_PLANT: Phs = Phs {
    mass_kg: 1e-3,
    damping_n_s_per_m: 4.0,
    stiffness_n_per_m: 25e3,
    transduction_c_per_m: 0.05,
    hysterons: Vec::new(),
};

/// The rig of the documentation: 100 um and 60 V to both sides, sines to 100 Hz, 10 s at 20 kHz.
pub const EXAMPLE: Scales<'static> = Scales {
    plant: &EXAMPLE_PLANT,
    stroke_m: 100e-6,
    drive_v: 60.0,
    rate_v_per_s: 60.0 * std::f64::consts::TAU * 100.0,
    sample_s: 5e-5,
    longest_s: 10.0,
    command_v: [-60.0, 60.0],
    displacement_m: [-100e-6, 100e-6],
};

/// The same in words.
pub const EXAMPLE_WORDS: &str =
    "a bender of 1 g and 25 N/mm, driven with 60 V to 100 um on both sides and up to 100 Hz, 10 s at 20 kHz";

/// The smallest and the largest of every size that a rig may have: metres, volts, V/s, s, s.
const STROKE_M: [f64; 2] = [1e-8, 1e-2];
const DRIVE_V: [f64; 2] = [0.1, 2e3];
const RATE_V_PER_S: [f64; 2] = [1e-3, 1e9];
const SAMPLE_S: [f64; 2] = [1e-7, 1.0];
const LONGEST_S: [f64; 2] = [1e-6, 1e6];
/// Middle of the range in half spans: driven to one side, to both, to the other.
const MIDDLES: [f64; 3] = [-1.0, 0.0, 1.0];
/// The plant of a file is not quite that of the diagnosis that wrote it, on whose numbers some bounds depend.
const MARGIN: f64 = 10.0;

/// The parameters of `form`, with bounds outside of which a number can't be meant, on any rig with this plant.
///
/// Pure numbers get no margin: beyond its bounds a mass turns negative.
pub fn anywhere(form: &Form, plant: &Phs) -> Vec<Parameter> {
    let mut widest: Vec<Parameter> = Vec::new();
    for scales in rigs(plant) {
        let parameters = (form.parameters)(&scales);
        if widest.is_empty() {
            widest = parameters;
            continue;
        }
        for (widest, here) in widest.iter_mut().zip(parameters) {
            widest.bounds = [widest.bounds[0].min(here.bounds[0]), widest.bounds[1].max(here.bounds[1])];
        }
    }
    for parameter in widest.iter_mut().filter(|p| !p.unit.is_empty()) {
        let [low, high] = parameter.bounds;
        parameter.bounds = [
            if low > 0.0 { low / MARGIN } else { low * MARGIN },
            if high > 0.0 { high * MARGIN } else { high / MARGIN },
        ];
    }
    widest
}

/// A number with three digits, as short as that can be.
pub fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let plain = rounded == 0.0 || (1e-3..1e5).contains(&rounded.abs());
    if plain { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// All corners of the sizes that rigs have.
fn rigs(plant: &Phs) -> impl Iterator<Item = Scales<'_>> {
    (0..32).flat_map(move |corner: usize| {
        MIDDLES.map(|middle| {
            let pick = |bit: usize, sizes: [f64; 2]| sizes[corner >> bit & 1];
            let (stroke_m, drive_v) = (pick(0, STROKE_M), pick(1, DRIVE_V));
            let range = |half: f64| [half * (middle - 1.0), half * (middle + 1.0)];
            Scales {
                plant,
                stroke_m,
                drive_v,
                rate_v_per_s: pick(2, RATE_V_PER_S),
                sample_s: pick(3, SAMPLE_S),
                longest_s: pick(4, LONGEST_S).max(16.0 * pick(3, SAMPLE_S)),
                command_v: range(drive_v),
                displacement_m: range(stroke_m),
            }
        })
    })
}
