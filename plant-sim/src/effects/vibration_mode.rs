//! Vibration mode: a resonance that the nominal plant lacks.

use super::parts::TINY;
use super::{About, Form, Parameter, Scales, spaced};
use crate::chain::{Arm, Chain, Joint, Mode};

effect!(VibrationMode, "vibration_mode", Structure);

const ABOUT: About = About {
    title: "vibration mode",
    what: "Another part of the structure swings at a frequency of its own.",
    equation: "attached: m (x'' + 2 z w (x' - q') + w^2 (x - q)) = 0 and its reaction on the mass; parallel: y = q + c \
               w^2 F / (s^2 + 2 z w s + w^2); a rod or a spring of mass m between mass and frame: three of these, k = 1 to 3, at k w with masses 2 m / (pi k)^2; arm: y = q + (a (w^2 / N - 1) + b w s / N) q with N that denominator. m, \
               x: mass and displacement of the part, q: displacement of the plant, y: of what the sensor sees, w: \
               natural frequency, z: damping ratio, c: static compliance, F: drive force, a: share of the reading on \
               the arm, b: the same of its speed, s: Laplace's variable",
    source: "residues that are no real numbers, where damping is local: Ewins 2000 (Modal Testing); that \
             nanopositioners have such modes: CubeSpec fine steering mirror, modes between 750 and 1000 Hz; form common, \
             size assumed",
    typical: "1 to 30 % of the main resonance's height, damping ratio 0.002 to 0.03",
    installs: "an oscillator, fixed to the moving mass or beside it",
    signature: "one narrow band of frequencies, at every amplitude; a ringing after each step at a frequency that \
                isn't the plant's",
    rivals: &["payload_mass", "periodic_force"],
    experiment: "a multisine with fine lines: the mode is a narrow peak and dip that scales with the drive; a periodic \
                 force is there without it",
    spec: "zero@2s+multisine:15V@5-2000Hz,periods=4",
};

/// Frequencies from which a search starts: from 100 Hz to 8 kHz they are 7.7 % apart, so that one lies within the half-power width of a
/// resonance with a damping ratio of 0.04, and a sharper one shows on its flank.
const N_STARTS: usize = 32;

/// Natural frequency and damping ratio.
pub(super) fn resonance(scales: &Scales<'_>) -> [Parameter; 2] {
    let bounds = [0.2 / scales.longest_s, 0.45 / scales.sample_s];
    let highest_hz = 0.4 / scales.sample_s;
    let lowest_hz = 100f64.min(0.05 * highest_hz).max(bounds[0]);
    [
        Parameter::shape("natural_hz", "Hz", bounds, spaced(lowest_hz, highest_hz, N_STARTS)),
        Parameter::shape("damping_ratio", "", [0.002, 0.3], vec![0.02]),
    ]
}

/// A mass on a spring: its share of the plant's mass, frequency and damping ratio.
pub(super) fn attach(chain: &mut Chain, p: &[f64]) {
    let mass_kg = chain.plant.mass_kg * p[0].max(TINY);
    chain.parts.modes.push(Mode { joint: Joint::Attached { mass_kg }, hz: p[1], damping_ratio: p[2] });
}

fn parallel(chain: &mut Chain, [compliance_ratio, hz, damping_ratio]: [f64; 3]) {
    let compliance_m_per_n = compliance_ratio / chain.plant.stiffness_n_per_m;
    chain.parts.modes.push(Mode { joint: Joint::Parallel { compliance_m_per_n }, hz, damping_ratio });
}

const FORMS: &[Form] = &[
    Form::predictable(
        "attached",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            vec![Parameter::amplitude("mass_ratio", "", [0.0, 0.5], 0.01), hz, damping_ratio]
        },
        attach,
    ),
    // The first three modes of a rod (or of a spring's surge) whose ends are the mass and the frame: 2 / (pi k)^2 of its mass go with the k-th.
    Form::predictable(
        "surge",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            let hz = Parameter { name: "first_natural_hz", ..hz };
            vec![Parameter::amplitude("mass_ratio", "", [0.0, 0.5], 0.05), hz, damping_ratio]
        },
        |chain, p| {
            for k in [1.0, 2.0, 3.0] {
                attach(chain, &[2.0 * p[0] / (std::f64::consts::PI * k).powi(2), k * p[1], p[2]]);
            }
        },
    ),
    Form::predictable(
        "parallel",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            vec![Parameter::signed("compliance_ratio", "", 0.3, 0.01), hz, damping_ratio]
        },
        |chain, p| parallel(chain, [p[0], p[1], p[2]]),
    ),
    Form::predictable(
        "two-parallel",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            let second_hz = Parameter { name: "second_natural_hz", ..hz.clone() };
            let second_ratio = Parameter { name: "second_damping_ratio", ..damping_ratio.clone() };
            let compliance = |name| Parameter::signed(name, "", 0.3, 0.01);
            let both = ["compliance_ratio", "second_compliance_ratio"].map(compliance);
            both.into_iter().chain([hz, damping_ratio, second_hz, second_ratio]).collect()
        },
        |chain, p| {
            parallel(chain, [p[0], p[2], p[3]]);
            parallel(chain, [p[1], p[4], p[5]]);
        },
    ),
    Form::predictable(
        "arm",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            vec![Parameter::signed("arm_share", "", 0.9, 0.01), hz, damping_ratio]
        },
        |chain, p| chain.parts.arms.push(Arm { share: p[0], rate_share: 0.0, hz: p[1], damping_ratio: p[2] }),
    ),
    Form::predictable(
        "attached-and-read",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            let mass = Parameter::amplitude("mass_ratio", "", [0.0, 0.5], 0.01);
            vec![mass, Parameter::signed("read_share", "", 0.9, 0.01), hz, damping_ratio]
        },
        |chain, p| {
            attach(chain, &[p[0], p[2], p[3]]);
            // The mass that reacts follows the structure as an arm does.
            chain.parts.arms.push(Arm { share: p[1], rate_share: 0.0, hz: p[2], damping_ratio: p[3] });
        },
    ),
    // Damping that belongs to a joint and not to all of the structure turns the phase of what a mode adds.
    Form::predictable(
        "arm-out-of-phase",
        |scales| {
            let [hz, damping_ratio] = resonance(scales);
            let share = |name| Parameter::signed(name, "", 0.9, 0.01);
            vec![share("arm_share"), share("rate_share"), hz, damping_ratio]
        },
        |chain, p| chain.parts.arms.push(Arm { share: p[0], rate_share: p[1], hz: p[2], damping_ratio: p[3] }),
    ),
];
