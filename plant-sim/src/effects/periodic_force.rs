//! Periodic force: something shakes the structure at a frequency of its own.

use super::parts::phasor;
use super::{About, Form, Parameter, spaced};
use crate::chain::Force;

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

const FORMS: &[Form] = &[Form::predictable(
    "line",
    |scales| {
        let bounds = [3.0 / scales.longest_s, 0.45 / scales.sample_s];
        let mut parameters =
            vec![Parameter::shape("line_hz", "Hz", bounds, spaced(2.0 * bounds[0], 0.9 * bounds[1], N_STARTS))];
        let force_n = scales.plant.stiffness_n_per_m * scales.stroke_m;
        parameters.extend(phasor(["cos_n", "sin_n"], "N", force_n, 5e-4 * force_n));
        parameters
    },
    |chain, p| chain.parts.forces.push(Force::Line { hz: p[0], cos_n: p[1], sin_n: p[2] }),
)];
