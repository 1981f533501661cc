//! Creep: the displacement goes on after a step.

use super::parts::add_hysteron;
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Chain, Relaxation};

effect!(Creep, "creep", Actuator);

const ABOUT: About = About {
    title: "creep",
    what: "After a step the displacement goes on for seconds, along the logarithm of time.",
    equation: "C_c v_c' = alpha q' - v_c / R_c, one or more hysterons without a dead zone; C_c, R_c: capacitance and \
               resistance of an element, v_c: its voltage, q: displacement, alpha: transduction, tau = R_c C_c. With a \
               constant ratio of the time constants they add up to y = y0 (1 + g log10(t / 0.1 s)), g per decade. Or \
               y = q + sum s_i (r_i + e |r_i| + c r_i |r_i|), T_i r_i' = q - r_i, T_i from 8 ms to 5 s and larger by a \
               factor on the way back, or three in a constant ratio; s_i: shares, e: more on one side, c: growing with \
               the stroke",
    source: "logarithmic law with g = 0.01 .. 0.02 a decade: PI catalogue (piezo fundamentals, creep); chain of \
             relaxing elements: common form, size assumed",
    typical: "1 to 5 % of the stroke over the first minutes",
    installs: "hysterons without a dead zone, time constants from 10 ms to minutes",
    signature: "the residual after each step grows with the logarithm of time and turns with the step; nothing at zero \
                input",
    rivals: &["extra_hysteron", "rate_dependent_hysteresis", "thermal_gain", "sensor_drift", "initial_state"],
    experiment: "a ladder with 10 s holds up and down: creep follows each step, drift does not",
    spec: "ladder:60V/4,hold=10s",
};

/// Time constants of the spectrum in seconds, and the names of the shares that relax with them.
const SPECTRUM_S: [f64; 5] = [0.008, 0.04, 0.2, 1.0, 5.0];
const SHARES: [&str; 5] = ["share_8ms", "share_40ms", "share_200ms", "share_1s", "share_5s"];
/// Shares of a few elements in a constant ratio.
const FEW_SHARES: [&str; 3] = ["fast_share", "middle_share", "slow_share"];
/// Elements of the logarithmic form, and the factor between their time constants.
const ELEMENTS: i32 = 4;

fn ratio(name: &'static str) -> Parameter {
    Parameter::amplitude(name, "", [0.0, 0.5], 0.02)
}

/// A duration within which slow elements show, at least 100 samples.
fn longest_s(scales: &Scales<'_>) -> f64 {
    scales.longest_s.max(100.0 * scales.sample_s)
}

/// A creep element.
fn add(chain: &mut Chain, ratio: f64, time_constant_s: f64) {
    add_hysteron(chain, ratio, time_constant_s, 0.0);
}

fn shares() -> [Parameter; 5] {
    SHARES.map(|name| Parameter::amplitude(name, "", [0.0, 0.5], 0.003))
}

/// How the whole spectrum deviates from one that follows alike everywhere, and its shares.
fn beside(deviates: Parameter) -> Vec<Parameter> {
    std::iter::once(deviates).chain(shares()).collect()
}

fn spectrum(shares: &[f64]) -> impl Iterator<Item = Relaxation> {
    shares.iter().zip(SPECTRUM_S).map(|(&share, time_constant_s)| Relaxation::even(share, time_constant_s))
}

const FORMS: &[Form] = &[
    Form::predictable(
        "kelvin-voigt",
        |scales| {
            let longest_s = longest_s(scales);
            let fastest_s = 0.02f64.min(0.02 * longest_s);
            let bounds = [0.2 * fastest_s, 100.0 * longest_s];
            let starts = spaced(fastest_s, 2.0 * longest_s, 5);
            vec![ratio("stiffness_ratio"), Parameter::shape("time_constant_s", "s", bounds, starts)]
        },
        |chain, p| add(chain, p[0], p[1]),
    ),
    Form::predictable(
        "chain-of-2",
        |scales| {
            let longest_s = longest_s(scales);
            let fastest_s = 0.02f64.min(0.02 * longest_s);
            let bounds = [0.2 * fastest_s, 10.0 * longest_s];
            vec![
                ratio("fast_stiffness_ratio"),
                ratio("slow_stiffness_ratio"),
                Parameter::shape("time_constant_s", "s", bounds, spaced(fastest_s, 0.2 * longest_s, 3)),
                Parameter::shape("time_constant_ratio", "", [2.0, 1e4], vec![5.0, 30.0]),
            ]
        },
        |chain, p| {
            add(chain, p[0], p[2]);
            add(chain, p[1], p[2] * p[3]);
        },
    ),
    Form::predictable(
        "logarithmic",
        // Equal elements in a constant ratio from `time_constant_s` on are the log law between the first and the last.
        |scales| {
            let slowest_s = longest_s(scales).max(0.1);
            vec![
                ratio("stiffness_ratio"),
                Parameter::shape("time_constant_s", "s", [2e-3, slowest_s], vec![0.01, 0.05]),
                Parameter::shape("time_constant_ratio", "", [1.5, 30.0], vec![4.0, 10.0]),
            ]
        },
        |chain, p| (0..ELEMENTS).for_each(|i| add(chain, p[0], p[1] * p[2].powi(i))),
    ),
    Form::predictable(
        "spectrum",
        // Creep beside the structure, q + sum share_i q / (1 + s tau_i), on fixed time constants: logarithm, power law and any chain of
        // Kelvin-Voigt elements are sums of these.
        |_| shares().to_vec(),
        |chain, p| {
            chain.parts.creep.extend(spectrum(p));
        },
    ),
    Form::predictable(
        "spectrum-of-3",
        // Few elements whose time constants lie between those of the fixed ones.
        |scales| {
            let slowest_s = longest_s(scales).max(0.1);
            FEW_SHARES
                .map(|name| Parameter::amplitude(name, "", [0.0, 0.5], 0.003))
                .into_iter()
                .chain([
                    Parameter::shape("time_constant_s", "s", [2e-3, slowest_s], vec![0.01, 0.05]),
                    Parameter::shape("time_constant_ratio", "", [1.5, 100.0], vec![10.0]),
                ])
                .collect()
        },
        |chain, p| {
            let elements = (0..FEW_SHARES.len()).map(|i| Relaxation::even(p[i], p[3] * p[4].powi(i as i32)));
            chain.parts.creep.extend(elements);
        },
    ),
    Form::predictable(
        "spectrum-by-side",
        |_| beside(Parameter::place("by_side", "", [-0.95, 0.95], vec![-0.5, 0.5])),
        |chain, p| chain.parts.creep.extend(spectrum(&p[1..]).map(|element| Relaxation { by_side: p[0], ..element })),
    ),
    Form::predictable(
        "spectrum-growing",
        |scales| {
            let per_m = 1.0 / scales.stroke_m;
            beside(Parameter::place("growth_per_m", "1/m", [-0.5 * per_m, 30.0 * per_m], vec![5.0 * per_m]))
        },
        |chain, p| {
            chain.parts.creep.extend(spectrum(&p[1..]).map(|element| Relaxation { growth_per_m: p[0], ..element }));
        },
    ),
    Form::predictable(
        "spectrum-slower-back",
        |_| beside(Parameter::shape("back_over_out", "", [0.1, 10.0], vec![2.5])),
        |chain, p| {
            chain.parts.creep.extend(spectrum(&p[1..]).map(|element| Relaxation { slower_back: p[0], ..element }));
        },
    ),
];
