//! End stop: something touches at the end of the travel.

use super::{About, Form, Parameter, Role, Scales};
use crate::chain::{Chain, Force};

effect!(EndStop, "end_stop", Structure);

const ABOUT: About = About {
    title: "end stop",
    what: "Beyond some displacement the mover touches a stop that pushes back.",
    equation: "F = kc x against the depth x = q - g of a stop above (g > 0), x = g - q of one below (g < 0), where x > 0; energy \
               kc x^2 / 2; or F = kc x (1 + a x'), never pulling, a contact that loses energy; or F = kc d (x / d)^p, a round \
               or soft body; F: force of the contact, kc: its stiffness, q: displacement, g: where it begins, d: |g| / 10, \
               p: exponent, a: damping",
    source: "common form, size assumed; p = 3/2: Hertz 1882; a: Hunt and Crossley 1975",
    typical: "a tenth to several times the plant's stiffness, at the last tenth of the travel",
    installs: "a contact force on the mass",
    signature: "nothing below a displacement, above it less travel; fast motion rings when it touches",
    rivals: &["amplifier_saturation", "nonlinear_stiffness", "asymmetric_stiffness"],
    experiment: "a slow ladder to the end, then a fast sine as far: a stop acts at one displacement however it is \
                 reached, a clip at one command",
    spec: "ladder:60V/12,hold=0.5s+sine:60V@100Hz,for=0.5s",
};

/// Where contact may begin and where a search starts, in shares of the travel on that side.
const BOUNDS: [f64; 2] = [0.2, 1.02];
const STARTS: [f64; 4] = [0.5, 0.7, 0.85, 0.95];

/// Travel on the upper (`side` = 1) or lower (-1) side; a log that hardly goes there still gets bounds.
fn travel_m(scales: &Scales<'_>, side: f64) -> f64 {
    scales.displacement_m.map(|q| side * q).into_iter().fold(0.1 * scales.stroke_m, f64::max)
}

/// Place of the contact on one side and its stiffness.
fn one(scales: &Scales<'_>, side: f64) -> [Parameter; 2] {
    let at = |share: f64| side * share * travel_m(scales, side);
    let mut bounds = BOUNDS.map(at);
    bounds.sort_by(f64::total_cmp);
    [Parameter::place("at_m", "m", bounds, STARTS.map(at).to_vec()), stiffness(scales)]
}

fn stiffness(scales: &Scales<'_>) -> Parameter {
    let plant = scales.plant.stiffness_n_per_m;
    Parameter::amplitude("stiffness_n_per_m", "N/m", [0.0, 20.0 * plant], 0.3 * plant)
}

fn stop(chain: &mut Chain, at_m: f64, stiffness_n_per_m: f64) {
    damped_stop(chain, at_m, stiffness_n_per_m, 0.0);
}

fn damped_stop(chain: &mut Chain, at_m: f64, stiffness_n_per_m: f64, damping_s_per_m: f64) {
    chain.parts.forces.push(Force::Stop { at_m, stiffness_n_per_m, damping_s_per_m });
}

/// What of an impact is lost: the force doubles at a tenth to ten times the usual speed.
fn damping(scales: &Scales<'_>) -> Parameter {
    let speed = scales.speed_m_per_s();
    Parameter::shape("damping_s_per_m", "s/m", [0.05 / speed, 50.0 / speed], vec![0.5 / speed, 5.0 / speed])
}

/// A stop on either side.
fn two(scales: &Scales<'_>) -> Vec<Parameter> {
    let rename = |side, names: [&'static str; 2]| {
        let [place, stiffness] = few(scales, side);
        [Parameter { name: names[0], ..place }, Parameter { name: names[1], ..stiffness }]
    };
    let upper = rename(1.0, ["upper_at_m", "upper_stiffness_n_per_m"]);
    upper.into_iter().chain(rename(-1.0, ["lower_at_m", "lower_stiffness_n_per_m"])).collect()
}

/// A stop whose force grows as a power of the depth.
fn soft(scales: &Scales<'_>, side: f64) -> Vec<Parameter> {
    let [place, stiffness] = few(scales, side);
    vec![place, stiffness, Parameter::shape("exponent", "", [0.5, 4.0], vec![1.5])]
}

/// The same with few starts: the straight stop tells where.
fn few(scales: &Scales<'_>, side: f64) -> [Parameter; 2] {
    let [place, stiffness] = one(scales, side);
    let starts = [0.6, 0.85].map(|share| side * share * travel_m(scales, side)).to_vec();
    [Parameter { role: Role::Place(starts), ..place }, stiffness]
}

fn pad(chain: &mut Chain, p: &[f64]) {
    chain.parts.forces.push(Force::Pad { at_m: p[0], stiffness_n_per_m: p[1], exponent: p[2] });
}

const FORMS: &[Form] = &[
    Form::predictable("upper", |scales| one(scales, 1.0).to_vec(), |chain, p| stop(chain, p[0], p[1])),
    Form::predictable("lower", |scales| one(scales, -1.0).to_vec(), |chain, p| stop(chain, p[0], p[1])),
    Form::predictable("upper-pad", |scales| soft(scales, 1.0), pad),
    Form::predictable("lower-pad", |scales| soft(scales, -1.0), pad),
    Form::predictable("each-side", two, |chain, p| {
        stop(chain, p[0], p[1]);
        stop(chain, p[2], p[3]);
    }),
    Form::predictable(
        "upper-damped",
        |scales| few(scales, 1.0).into_iter().chain([damping(scales)]).collect(),
        |chain, p| damped_stop(chain, p[0], p[1], p[2]),
    ),
    Form::predictable(
        "lower-damped",
        |scales| few(scales, -1.0).into_iter().chain([damping(scales)]).collect(),
        |chain, p| damped_stop(chain, p[0], p[1], p[2]),
    ),
    Form::predictable(
        "each-side-damped",
        |scales| two(scales).into_iter().chain([damping(scales)]).collect(),
        |chain, p| {
            damped_stop(chain, p[0], p[1], p[4]);
            damped_stop(chain, p[2], p[3], p[4]);
        },
    ),
    Form::predictable(
        "both",
        |scales| {
            let travel_m = travel_m(scales, 1.0).max(travel_m(scales, -1.0));
            let starts = STARTS.map(|share| share * travel_m).to_vec();
            vec![Parameter::shape("at_m", "m", BOUNDS.map(|b| b * travel_m), starts), stiffness(scales)]
        },
        |chain, p| {
            stop(chain, p[0], p[1]);
            stop(chain, -p[0], p[1]);
        },
    ),
];
