//! Curves of the figures that are formulas: Figure 2.2 (shapes of Bouc-Wen) and Figure 2.3 (admittance with a dead zone).

use super::Thesis;
use plant_sim::bouc_wen::{BoucWen, Family};
use std::f64::consts::TAU;

/// Figure 2.2's parameters.
pub(super) const SHAPES: [(f64, f64); 3] = [(0.15, 0.85), (0.5, -0.5), (0.15, -0.5)];

/// A loop: its name, x, h.
pub(super) type Curve = (String, Vec<f64>, Vec<f64>);

/// Loops of h over x for A = 1 and exponent n, x a sine of amplitude one that has run for some periods.
pub(super) fn shapes(exponent: f64) -> Vec<Curve> {
    let loop_of = |(beta, gamma): (f64, f64)| {
        let law = BoucWen { amplitude: 1.0, beta, gamma, exponent };
        let name = match law.family() {
            Family::Softening => "softening",
            Family::Linear => "linear while loading",
            Family::Hardening => "hardening",
        };
        let (mut h, mut at) = (0.0, 0.0);
        let (mut xs, mut hs) = (Vec::new(), Vec::new());
        for k in 0..=2000 {
            let x = (TAU * f64::from(k) / 400.0).sin();
            h = law.after(h, x - at);
            at = x;
            if k >= 1600 {
                xs.push(x);
                hs.push(h);
            }
        }
        (format!("{name}: beta {beta}, gamma {gamma}"), xs, hs)
    };
    SHAPES.into_iter().map(loop_of).collect()
}

/// Current through each hysteron over its voltage: volts, then for each hysteron its current as a share of that at 25 V.
pub(super) fn admittance(thesis: &Thesis) -> (Vec<f64>, Vec<Vec<f64>>) {
    let volts: Vec<f64> = (-100..=100).map(|k| f64::from(k) * 0.25).collect();
    let plant = thesis.phs.chain().plant;
    let of = |h: &plant_sim::phs::Hysteron| volts.iter().map(|v| h.current_a(*v) / h.current_a(25.0)).collect();
    let currents = plant.hysterons.iter().map(of).collect();
    (volts, currents)
}
