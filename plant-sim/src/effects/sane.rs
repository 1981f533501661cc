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

/// The smallest and the largest of every size of a rig.
struct Sizes {
    stroke_m: [f64; 2],
    drive_v: [f64; 2],
    rate_v_per_s: [f64; 2],
    sample_s: [f64; 2],
    longest_s: [f64; 2],
}

/// Rigs that there are.
const USUAL: Sizes = Sizes {
    stroke_m: [1e-7, 1e-3],
    drive_v: [1.0, 1e3],
    rate_v_per_s: [0.1, 1e7],
    sample_s: [1e-6, 1e-2],
    longest_s: [1e-2, 1e4],
};
/// Rigs that can be imagined.
const EXTREME: Sizes = Sizes {
    stroke_m: [1e-8, 1e-2],
    drive_v: [0.1, 2e3],
    rate_v_per_s: [1e-3, 1e9],
    sample_s: [1e-7, 1.0],
    longest_s: [1e-6, 1e6],
};
/// Middle of the range in half spans: driven to one side, to both, to the other.
const MIDDLES: [f64; 3] = [-1.0, 0.0, 1.0];
/// The plant of a file is not quite that of the diagnosis that wrote it, on whose numbers some bounds depend.
const MARGIN: f64 = 10.0;

/// The parameters of `form`, with bounds outside of which a number looks like a wrong unit.
pub fn plausible(form: &Form, plant: &Phs) -> Vec<Parameter> {
    widest(form, plant, &USUAL)
}

/// The parameters of `form`, with bounds outside of which a number can't be meant, on any rig with this plant.
///
/// Pure numbers get no margin: beyond its bounds a mass turns negative.
pub fn anywhere(form: &Form, plant: &Phs) -> Vec<Parameter> {
    let mut parameters = widest(form, plant, &EXTREME);
    for parameter in parameters.iter_mut().filter(|p| !p.unit.is_empty()) {
        let [low, high] = parameter.bounds;
        parameter.bounds = [
            if low > 0.0 { low / MARGIN } else { low * MARGIN },
            if high > 0.0 { high * MARGIN } else { high / MARGIN },
        ];
    }
    parameters
}

/// The parameters of `form` with bounds that hold those of all rigs of these sizes.
fn widest(form: &Form, plant: &Phs, sizes: &Sizes) -> Vec<Parameter> {
    let mut widest: Vec<Parameter> = Vec::new();
    for scales in rigs(plant, sizes) {
        let parameters = (form.parameters)(&scales);
        if widest.is_empty() {
            widest = parameters;
            continue;
        }
        for (widest, here) in widest.iter_mut().zip(parameters) {
            widest.bounds = [widest.bounds[0].min(here.bounds[0]), widest.bounds[1].max(here.bounds[1])];
        }
    }
    widest
}

/// A number with three digits, as short as that can be.
pub fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let plain = rounded == 0.0 || (1e-3..1e5).contains(&rounded.abs());
    if plain { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// All corners of these sizes.
fn rigs<'a>(plant: &'a Phs, sizes: &'a Sizes) -> impl Iterator<Item = Scales<'a>> {
    (0..32).flat_map(move |corner: usize| {
        MIDDLES.map(|middle| {
            let pick = |bit: usize, sizes: [f64; 2]| sizes[corner >> bit & 1];
            let (stroke_m, drive_v, sample_s) =
                (pick(0, sizes.stroke_m), pick(1, sizes.drive_v), pick(3, sizes.sample_s));
            let range = |half: f64| [half * (middle - 1.0), half * (middle + 1.0)];
            Scales {
                plant,
                stroke_m,
                drive_v,
                rate_v_per_s: pick(2, sizes.rate_v_per_s),
                sample_s,
                // No log has fewer rows.
                longest_s: pick(4, sizes.longest_s).max(16.0 * sample_s),
                command_v: range(drive_v),
                displacement_m: range(stroke_m),
            }
        })
    })
}
