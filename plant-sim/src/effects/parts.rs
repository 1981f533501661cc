//! What several entries install: lags, bends, clips and pairs of amplitudes. Each adds to what a chain has.

use super::{Parameter, Scales};
use crate::chain::{Bend, BendLaw, Chain, DriveHysteresis, Lag, Late};
use crate::operators::{Counts, Law, Play, Plays};
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

/// Appends a first-order lag that grows by `new`. What both lags have in common grows by the mean, as much of each as it is slow.
pub(super) fn add_grown(lag: &mut Option<Lag>, time_constant_s: f64, growth: &mut f64, new: f64) {
    let before_s = lag.map_or(0.0, |lag| coefficients(lag)[0]);
    let share = if before_s > 0.0 { time_constant_s / (before_s + time_constant_s) } else { 1.0 };
    *growth += share * (new - *growth);
    add_first(lag, time_constant_s);
}

/// a1 and a2 of the denominator 1 + a1 s + a2 s^2.
fn coefficients(lag: Lag) -> [f64; 2] {
    match lag {
        Lag::First { time_constant_s } => [time_constant_s, 0.0],
        Lag::Second { natural_rad_per_s, damping_ratio } => {
            [2.0 * damping_ratio / natural_rad_per_s, natural_rad_per_s.powi(-2)]
        }
    }
}

/// Appends a second-order lag.
pub(super) fn add_second(lag: &mut Option<Lag>, hz: f64, damping_ratio: f64) {
    add(lag, Lag::Second { natural_rad_per_s: TAU * hz, damping_ratio });
}

/// Appends `next`. Two first-order lags in a row are one of second order; with more, the denominator 1 + a1 s + a2 s^2 keeps its first
/// two coefficients, which is what a log shows of it below its corner.
fn add(lag: &mut Option<Lag>, next: Lag) {
    *lag = Some(match *lag {
        None => next,
        Some(before) => {
            let ([a1, a2], [b1, b2]) = (coefficients(before), coefficients(next));
            let natural_rad_per_s = (a2 + b2 + a1 * b1).sqrt().recip();
            Lag::Second { natural_rad_per_s, damping_ratio: 0.5 * (a1 + b1) * natural_rad_per_s }
        }
    });
}

/// Lets a share of the drive come late; where one does already, both come with the mean of their times.
pub(super) fn come_late(chain: &mut Chain, share: f64, time_constant_s: f64) {
    chain.drive.late = Some(match chain.drive.late {
        Some(Late { share: before, time_constant_s: other_s }) if before + share != 0.0 => {
            let both = before + share;
            Late { share: both, time_constant_s: (before * other_s + share * time_constant_s).abs() / both.abs() }
        }
        // Two that cancel leave none.
        Some(_) => Late { share: 0.0, time_constant_s },
        None => Late { share, time_constant_s },
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

/// Elements of a hysteresis of the voltage; they share its reach evenly.
const PLAYS: usize = 5;

/// Share and reach of a hysteresis of the voltage.
pub(super) fn plays(scales: &Scales<'_>) -> Vec<Parameter> {
    let starts = [0.1, 0.3, 0.8].map(|share| share * scales.drive_v).to_vec();
    let bounds = [0.02 * scales.drive_v, 2.0 * scales.drive_v];
    vec![Parameter::signed("drive_share", "", 0.5, 0.02), Parameter::shape("reach_v", "V", bounds, starts)]
}

/// A hysteresis of the voltage with these parameters, by `skew_per_v` more under positive voltages; whether the plant takes it.
pub(super) fn add_plays(chain: &mut Chain, p: &[f64], skew_per_v: f64) -> bool {
    let weight_per_v = p[0] / PLAYS as f64;
    let play = |i: usize| {
        let upright = Play::upright(p[1] * i as f64 / PLAYS as f64, weight_per_v);
        Play { lean_per_v2: skew_per_v * weight_per_v, ..upright }
    };
    push_plays(chain, (1..=PLAYS).map(play))
}

/// Thresholds of a spectrum of plays, in shares of the range: closer where small reversals open them. Two neighbours of the first four bow and lean
/// alike; wide plays hardly lag, and if they bent they would be any curve of the drive.
const THRESHOLDS: [f64; 6] = [0.02, 0.05, 0.11, 0.22, 0.4, 0.7];

/// Plays at fixed thresholds, each with a weight of its own, of which the narrow ones bow with the voltage; with `LEANS`, lean as well.
pub(super) fn spectrum<const LEANS: bool>(scales: &Scales<'_>) -> Vec<Parameter> {
    let drive_v = scales.drive_v;
    let reach = Parameter::shape("reach_v", "V", [0.9 * drive_v, 1.1 * drive_v], vec![drive_v]);
    let share = |name| Parameter::signed(name, "", 0.5, 0.01);
    let weights = ["share_1", "share_2", "share_3", "share_4", "share_5", "share_6"].map(share);
    let bows = ["bow_1", "bow_2"].map(share);
    let leans = ["lean_1", "lean_2"].map(share).into_iter().filter(|_| LEANS);
    std::iter::once(reach).chain(weights).chain(bows).chain(leans).collect()
}

/// Plays with these parameters; whether the plant takes them.
pub(super) fn add_spectrum(chain: &mut Chain, p: &[f64]) -> bool {
    let (reach_v, weights, bows, leans) = (p[0], &p[1..7], &p[7..9], &p[9..]);
    let of_pair = |shares: &[f64], i: usize| shares.get(i / 2).copied().unwrap_or(0.0);
    let play = |(i, threshold): (usize, f64)| Play {
        threshold_v: threshold * reach_v,
        weight_per_v: weights[i],
        lean_per_v2: of_pair(leans, i) / reach_v,
        bow_per_v3: of_pair(bows, i) / (reach_v * reach_v),
    };
    push_plays(chain, THRESHOLDS.into_iter().enumerate().map(play))
}

/// A plant has one hysteresis of the voltage; more of the same kind joins it, and beside another law none can be.
fn push_plays(chain: &mut Chain, more: impl Iterator<Item = Play>) -> bool {
    let force_n = chain.plant.transduction_c_per_m;
    match &mut chain.parts.transducer {
        Some(DriveHysteresis { law: Law::Plays(Plays { plays, counts: Counts::Lags }), force_n: own_n }) => {
            let times = force_n / *own_n;
            plays.extend(more.map(|Play { threshold_v, weight_per_v, lean_per_v2, bow_per_v3 }| Play {
                threshold_v,
                weight_per_v: times * weight_per_v,
                lean_per_v2: times * lean_per_v2,
                bow_per_v3: times * bow_per_v3,
            }));
        }
        Some(_) => return false,
        none => {
            let law = Law::Plays(Plays { plays: more.collect(), counts: Counts::Lags });
            *none = Some(DriveHysteresis { law, force_n });
        }
    }
    true
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
    names.map(|name| Parameter::signed(name, unit, largest, typical).told_at_once())
}
