//! Asymmetric hysteresis: rising and falling branches differ.

use super::parts::{add_plays, add_spectrum, bend, bend_all, bend_slowest, plays, spectrum};
use super::{About, Form, Parameter, Scales};
use crate::chain::{BendLaw, Chain, Steeper};

effect!(AsymmetricHysteresis, "asymmetric_hysteresis", Actuator);

const ABOUT: About = About {
    title: "asymmetric hysteresis",
    what: "The loop isn't a point reflection of itself: its ends, or its rising and falling branches, differ.",
    equation: "C v' = alpha q' - h(v) with 1/C larger by the share s at v = +d/2 and smaller at -d/2, or h larger by s \
               for v > 0 and smaller for v < 0; or a drive u (1 + c u), or u + g max(u - a, 0); or plays of the drive that miss h (1 + e u) of it, with e of 15 % or more over the range, beside the curvature; or h = sum (s_i + l_i u/R + b_i (u/R)^2) (u - p_i) beside it, plays p_i with thresholds from 0.02 to 0.7 of the reach R (wide ones without b and l); or a dead zone about \
               m instead of zero, which shifts the displacement by alpha m / k and nothing else, with or without that skew of h. C: capacitance, v: voltage \
               of the hysteron, alpha: transduction, q: displacement, h: admittance, d: width of its dead zone, u: \
               drive, c: curvature, g: change of the gain beyond a, k: stiffness",
    source: "that the hysteresis of ceramics is asymmetric: Wei 2014 (Precision Engineering 38), arXiv 2412.08332; \
             a drive with a one-sided dead zone: Kuhnen 2003 (Eur. J. Control 9); the other forms and their size assumed",
    typical: "even part 1 to 5 % of the stroke",
    installs: "a skew of capacitances or slopes, or an even term of the drive",
    signature: "even harmonics that show a loop; the two ends of the loop differ",
    rivals: &["extra_hysteron", "asymmetric_stiffness", "sensor_nonlinearity", "sensor_offset"],
    experiment: "slow loops about zero, then stairs to either end and back: the skew belongs to the direction of the \
                 drive, the curvature of a sensor or of a spring to the place",
    spec: "minor-loops:60V@1Hz+ladder:60V/30,hold=0.05s+ladder:-60V/30,hold=0.05s",
};

fn skew(_: &Scales<'_>) -> Vec<Parameter> {
    vec![Parameter::signed("skew", "", 0.9, 0.05)]
}

/// A dead zone from m - d/2 to m + d/2 is one about zero for v - m, and what is left is the constant force alpha m: exactly an offset of the
/// reading by alpha m / k, with k the stiffness. No log tells the two apart, and the number has the name of that offset.
fn off_centre(scales: &Scales<'_>) -> Vec<Parameter> {
    vec![Parameter::signed("offset_m", "m", 0.5 * scales.stroke_m, 0.01 * scales.stroke_m)]
}

/// Edges and slopes of their own on either side, of which the edges alone are [`off_centre`].
fn off_centre_and_slope(scales: &Scales<'_>) -> Vec<Parameter> {
    off_centre(scales).into_iter().chain(skew(scales)).collect()
}

fn curvature(scales: &Scales<'_>) -> Parameter {
    Parameter::signed("curvature_per_v", "1/V", 0.3 / scales.drive_v, 0.02 / scales.drive_v)
}

fn lean(chain: &mut Chain, p: &[f64], towards: f64) {
    if add_plays(chain, p, towards * p[2]) {
        chain.drive.curvature_per_v += p[3];
    }
}

/// A hysteresis of the voltage that is larger under one polarity than under the other; with a skew of nothing it would be an extra hysteron.
fn leaning(scales: &Scales<'_>) -> Vec<Parameter> {
    let per_v = 1.0 / scales.drive_v;
    let skew = Parameter::shape("skew_per_v", "1/V", [0.15 * per_v, 0.95 * per_v], vec![0.4 * per_v]);
    plays(scales).into_iter().chain([skew, curvature(scales)]).collect()
}

/// Loops of the voltage that are any on either side: without their leans they would be an extra hysteron's.
fn leaning_spectrum(scales: &Scales<'_>) -> Vec<Parameter> {
    std::iter::once(curvature(scales)).chain(spectrum::<true>(scales)).collect()
}

const FORMS: &[Form] = &[
    Form::predictable("off-centre", off_centre, |chain, p| chain.sensor.offset_m += p[0]).mirroring("sensor_offset"),
    Form::predictable("capacitance", skew, |chain, p| bend_all(chain, BendLaw::CapacitanceSkew(p[0]))),
    Form::predictable("capacitance-of-first", skew, |chain, p| bend(chain, 0, BendLaw::CapacitanceSkew(p[0]))),
    Form::predictable("capacitance-of-second", skew, |chain, p| bend(chain, 1, BendLaw::CapacitanceSkew(p[0]))),
    Form::predictable("slope", skew, |chain, p| bend_slowest(chain, BendLaw::SlopeSkew(p[0]))),
    Form::predictable("off-centre-and-slope", off_centre_and_slope, |chain, p| {
        chain.sensor.offset_m += p[0];
        bend_slowest(chain, BendLaw::SlopeSkew(p[1]));
    }),
    Form::predictable("drive", |scales| vec![curvature(scales)], |chain, p| chain.drive.curvature_per_v += p[0]),
    Form::predictable("plays-up", leaning, |chain, p| lean(chain, p, 1.0)),
    Form::predictable("plays-down", leaning, |chain, p| lean(chain, p, -1.0)),
    Form::predictable("leaning-spectrum", leaning_spectrum, |chain, p| {
        let (curvature_per_v, spectrum) = (p[0], &p[1..]);
        if add_spectrum(chain, spectrum) {
            chain.drive.curvature_per_v += curvature_per_v;
        }
    }),
    // The same on the other side of a place is this and a gain.
    Form::predictable(
        "drive-one-sided",
        |scales| {
            let [low_v, high_v] = scales.command_v;
            let at = |share: f64| low_v + share * (high_v - low_v);
            vec![
                Parameter::signed("gain_change", "", 0.5, 0.02),
                Parameter::place("from_v", "V", [0.03, 0.97].map(at), [0.2, 0.4, 0.6, 0.8].map(at).to_vec()),
            ]
        },
        |chain, p| chain.drive.steeper.push(Steeper { gain_change: p[0], at_v: p[1] }),
    ),
];
