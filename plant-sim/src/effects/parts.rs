//! What several entries install: lags, bends, clips and pairs of amplitudes. Each adds to what a chain has.

use super::Parameter;
use crate::chain::{Bend, BendLaw, Chain, Lag};
use crate::phs::{Hysteron, Phs};
use std::f64::consts::TAU;

/// Smallest amplitude of a part whose equations divide by it; it changes the displacement by less than rounding does.
pub(super) const TINY: f64 = 1e-12;

/// Appends a first-order lag; none if it is instant.
pub(super) fn add_first(lag: &mut Option<Lag>, time_constant_s: f64) {
    if time_constant_s > 0.0 {
        add(lag, Lag::First { time_constant_s });
    }
}

/// Appends a second-order lag.
pub(super) fn add_second(lag: &mut Option<Lag>, hz: f64, damping_ratio: f64) {
    add(lag, Lag::Second { natural_rad_per_s: TAU * hz, damping_ratio });
}

/// Appends `next`. Two first-order lags in a row are one of second order; with more, the denominator 1 + a1 s + a2 s^2 keeps its first
/// two coefficients, which is what a log shows of it below its corner.
fn add(lag: &mut Option<Lag>, next: Lag) {
    let coefficients = |lag: Lag| match lag {
        Lag::First { time_constant_s } => [time_constant_s, 0.0],
        Lag::Second { natural_rad_per_s, damping_ratio } => {
            [2.0 * damping_ratio / natural_rad_per_s, natural_rad_per_s.powi(-2)]
        }
    };
    *lag = Some(match *lag {
        None => next,
        Some(before) => {
            let ([a1, a2], [b1, b2]) = (coefficients(before), coefficients(next));
            let natural_rad_per_s = (a2 + b2 + a1 * b1).sqrt().recip();
            Lag::Second { natural_rad_per_s, damping_ratio: 0.5 * (a1 + b1) * natural_rad_per_s }
        }
    });
}

/// Narrows an output range; the upper limit wins where both cross.
pub(super) fn narrow(range_v: &mut [f64; 2], [low_v, high_v]: [f64; 2]) {
    range_v[1] = range_v[1].min(high_v);
    range_v[0] = range_v[0].max(low_v).min(range_v[1]);
}

/// A hysteron that stiffens fast motion by `ratio` of the plant's stiffness, relaxes in `time_constant_s`, and has a dead zone as wide as
/// a fast travel of `dead_zone_m`.
pub(super) fn add_hysteron(chain: &mut Chain, ratio: f64, time_constant_s: f64, dead_zone_m: f64) {
    let plant = &mut chain.plant;
    let capacitance_f = plant.transduction_c_per_m.powi(2) / (plant.stiffness_n_per_m * ratio.max(TINY));
    let dead_zone_v = dead_zone_m * plant.transduction_c_per_m / capacitance_f;
    plant.hysterons.push(Hysteron { capacitance_f, slope_s: capacitance_f / time_constant_s, dead_zone_v });
}

/// Bends hysteron `hysteron`, if the plant has it.
pub(super) fn bend(chain: &mut Chain, hysteron: usize, law: BendLaw) {
    if hysteron < chain.plant.hysterons.len() {
        chain.parts.bends.push(Bend { hysteron: Some(hysteron), law });
    }
}

/// Bends every hysteron that has a dead zone: not the creep that another entry may have added.
pub(super) fn bend_all(chain: &mut Chain, law: BendLaw) {
    for i in with_dead_zone(&chain.plant) {
        bend(chain, i, law);
    }
}

/// Hysterons that have a dead zone.
pub(super) fn with_dead_zone(plant: &Phs) -> Vec<usize> {
    (0..plant.hysterons.len()).filter(|i| plant.hysterons[*i].dead_zone_v > 0.0).collect()
}

/// Bends the slowest hysteron that has a dead zone.
pub(super) fn bend_slowest(chain: &mut Chain, law: BendLaw) {
    if let Some(i) = slowest(&chain.plant) {
        bend(chain, i, law);
    }
}

/// The slowest of them.
pub(super) fn slowest(plant: &Phs) -> Option<usize> {
    let time_constant_s = |i: &usize| plant.hysterons[*i].capacitance_f / plant.hysterons[*i].slope_s;
    with_dead_zone(plant).into_iter().max_by(|a, b| time_constant_s(a).total_cmp(&time_constant_s(b)))
}

/// Probability that at least one of two independent events happens.
pub(super) fn either(a: f64, b: f64) -> f64 {
    1.0 - (1.0 - a) * (1.0 - b)
}

/// A cosine and a sine amplitude of every log, at most `largest` and typically `typical`.
pub(super) fn phasor(names: [&'static str; 2], unit: &'static str, largest: f64, typical: f64) -> [Parameter; 2] {
    names.map(|name| Parameter::signed(name, unit, largest, typical).of_each_log())
}
