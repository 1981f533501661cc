//! The predictable half of the sensor in motion: play, the lag behind it, and the clock that drift and lines run on.
//!
//! A lag without play before it is linear and belongs to the engine, which steps it exactly.

use super::lag::{LagState, at, later};
use super::reading::Reading;
use super::{Arm, Lag, Parts, Relaxation, Sensor};

/// Contacts that share a joint whose plays are spread.
const CONTACTS: usize = 5;
/// How often the sample in which a play's edge is reached is halved to find when.
const HALVINGS: usize = 40;
/// Rounding of a displacement, with room.
const ROUNDING_M: f64 = 1e-17;

/// The sensor's state.
pub(super) struct Readout {
    reading: Reading,
    sample_s: f64,
    sample: u64,
    /// A structure without mass goes in straight lines from row to row, as far as anybody knows.
    goes_straight: bool,
    /// Nothing but play without drag stands before the lag.
    lags_behind_plain_play: bool,
    /// What is seen is what is read: no play, lag, creep or arm stands between.
    is_seen: bool,
    /// Displacement behind each play at this sample, of as many as there are; then the mean's, and its velocity.
    contacts_m: [f64; CONTACTS],
    contacts: usize,
    behind_m: f64,
    behind_m_per_s: f64,
    lag: LagState,
    creep: Vec<Creep>,
    /// Share of the way to the displacement that a joint with drag goes in a sample.
    drags: f64,
    arms: Vec<(Arm, LagState)>,
    /// Displacement and velocity of the structure at this sample.
    structure: [f64; 2],
}

/// An element of the creep.
struct Creep {
    element: Relaxation,
    /// Share of the way to the displacement that it goes in a sample, out and back.
    creeps: [f64; 2],
    /// Where it has relaxed to.
    relaxed_m: f64,
}

impl Readout {
    /// `lagged` says that what arrives here has passed the lag already.
    pub(super) fn new(sensor: &Sensor, parts: &Parts, sample_s: f64, lagged: bool) -> Self {
        let lag = if lagged { None } else { sensor.lag };
        let of_sample = |time_constant_s: f64| -(-sample_s / time_constant_s).exp_m1();
        let creep = |element: &Relaxation| Creep {
            element: *element,
            creeps: [1.0, element.slower_back].map(|slower| of_sample(slower * element.time_constant_s)),
            relaxed_m: 0.0,
        };
        let contacts = if sensor.play_m > 0.0 && sensor.play_spread > 0.0 { CONTACTS } else { 1 };
        let is_plain = contacts == 1 && sensor.drag_s == f64::INFINITY;
        let is_alone = parts.creep.is_empty() && parts.arms.is_empty();
        Self {
            lags_behind_plain_play: lag.is_some() && sensor.play_m > 0.0 && is_plain && is_alone,
            is_seen: lag.is_none() && sensor.play_m <= 0.0 && is_plain && is_alone,
            reading: Reading::new(&Sensor { lag, ..sensor.clone() }, sample_s),
            goes_straight: parts.is_massless,
            sample_s,
            sample: 0,
            contacts_m: [0.0; CONTACTS],
            contacts,
            behind_m: 0.0,
            behind_m_per_s: 0.0,
            lag: LagState::default(),
            creep: parts.creep.iter().map(creep).collect(),
            drags: of_sample(sensor.drag_s),
            arms: parts.arms.iter().map(|arm| (*arm, LagState::default())).collect(),
            structure: [0.0; 2],
        }
    }

    /// At rest at `displacement_m`, at the middle of the play.
    pub(super) fn rest_at(&mut self, displacement_m: f64) {
        self.creep.iter_mut().for_each(|element| element.relaxed_m = displacement_m);
        self.structure = [displacement_m, 0.0];
        self.arms.iter_mut().for_each(|(_, follower)| *follower = LagState::at(displacement_m));
        self.show_seen();
    }

    /// What follows what is seen has been there for long.
    fn show_seen(&mut self) {
        let seen_m = self.seen_m();
        self.contacts_m = [seen_m; CONTACTS];
        (self.behind_m, self.behind_m_per_s, self.lag) = (seen_m, 0.0, LagState::at(seen_m));
    }

    /// Moves each arm by so much from where it rests: metres and m/s.
    pub(super) fn swing(&mut self, from_rest: &[[f64; 2]]) {
        self.arms.iter_mut().zip(from_rest).for_each(|((_, follower), moved)| follower.shift(*moved));
        self.show_seen();
    }

    /// Each play has been left at this `share` of its half width from the middle.
    pub(super) fn hold(&mut self, share: f64) {
        if self.is_seen {
            return;
        }
        for contact in 0..self.contacts {
            self.contacts_m[contact] += share * self.half_m(contact);
        }
        self.behind_m = self.mean_m();
        self.lag = LagState::at(self.behind_m);
    }

    /// One sample has passed, and the structure is at `displacement_m` and moves at `velocity_m_per_s`.
    #[inline]
    pub(super) fn advance(&mut self, displacement_m: f64, velocity_m_per_s: f64) {
        self.sample += 1;
        if self.is_seen {
            self.structure = [displacement_m, velocity_m_per_s];
            self.behind_m = displacement_m;
            return;
        }
        self.pass(displacement_m, velocity_m_per_s);
    }

    /// The same of what stands between.
    #[inline(never)]
    fn pass(&mut self, displacement_m: f64, velocity_m_per_s: f64) {
        if self.goes_straight {
            (self.structure[1], self.behind_m_per_s) = (velocity_m_per_s, velocity_m_per_s);
        }
        let (from, sample_s) = (self.structure, self.sample_s);
        self.structure = [displacement_m, velocity_m_per_s];
        let path = || hermite(from, [displacement_m, velocity_m_per_s], sample_s);
        let turns = self.sensor().play_m > 0.0 && from[1] * velocity_m_per_s < 0.0;
        let turn_s = turns.then(|| turn_s(path(), velocity_m_per_s, sample_s));
        if self.lags_behind_plain_play {
            self.lag_behind_play(path(), turn_s);
            return;
        }
        // How far beyond this sample's displacement the structure has turned on its way here.
        let beyond_m = turn_s.map(|turn_s| at(path(), turn_s) - displacement_m);
        let displacement_m =
            if self.creep.is_empty() && self.arms.is_empty() { displacement_m } else { self.follow(path()) };
        let mut rate_m_per_s = 0.0;
        for contact in 0..self.contacts {
            let (half_m, was_m) = (self.half_m(contact), self.contacts_m[contact]);
            let from_m = beyond_m.map_or(was_m, |beyond_m| {
                let turn_m = displacement_m + beyond_m;
                was_m.max(turn_m - half_m).min(turn_m + half_m)
            });
            // A joint with drag creeps towards the middle of its play; mean displacement over the sample is close enough for that.
            let crept_m = self.dragged_m(from_m, displacement_m + self.sensor().drag_to * half_m);
            // Where a search has led the plant to where it is no number any more, the reading is none either.
            let now_m = if displacement_m.is_nan() {
                displacement_m
            } else {
                crept_m.clamp(displacement_m - half_m, displacement_m + half_m)
            };
            let is_within = now_m == crept_m && half_m > 0.0;
            rate_m_per_s += if is_within { (crept_m - from_m) / self.sample_s } else { velocity_m_per_s };
            self.contacts_m[contact] = now_m;
        }
        let (now_m, now_m_per_s) = (self.mean_m(), rate_m_per_s / self.contacts as f64);
        if self.sensor().lag.is_some() {
            let cubic = hermite([self.behind_m, self.behind_m_per_s], [now_m, now_m_per_s], self.sample_s);
            self.lag.pass_grown(self.sensor().lag, self.sensor().lag_growth, cubic, self.sample_s);
        }
        (self.behind_m, self.behind_m_per_s) = (now_m, now_m_per_s);
    }

    /// Play without drag, and the lag behind it, while the structure goes along `path` and turns once or not at all: the play stands until its edge is
    /// reached, and goes along until the structure turns.
    fn lag_behind_play(&mut self, path: [f64; 4], turn_s: Option<f64>) {
        let half_m = self.half_m(0);
        let mut from_s = 0.0;
        for to_s in turn_s.into_iter().chain([self.sample_s]) {
            let stands_m = self.contacts_m[0];
            let there_m = at(path, to_s);
            let now_m = if there_m.is_nan() { there_m } else { stands_m.clamp(there_m - half_m, there_m + half_m) };
            let edge_m = now_m - there_m;
            let reached_s = if now_m == stands_m { to_s } else { reached_s(path, stands_m - edge_m, [from_s, to_s]) };
            let Self { lag, reading: Reading { sensor, .. }, .. } = self;
            let mut pass = |path, duration_s| {
                if duration_s > 0.0 {
                    lag.pass_grown(sensor.lag, sensor.lag_growth, path, duration_s);
                }
            };
            pass([stands_m, 0.0, 0.0, 0.0], reached_s - from_s);
            let [value, slope, bend, twist] = later(path, reached_s);
            pass([value + edge_m, slope, bend, twist], to_s - reached_s);
            self.contacts_m[0] = now_m;
            from_s = to_s;
        }
        self.behind_m = self.contacts_m[0];
    }

    /// The sensor, of whose lag the engine may have taken care.
    fn sensor(&self) -> &Sensor {
        &self.reading.sensor
    }

    /// Lets creep and arms follow the structure on its `path` over the sample; returns the displacement with all of them.
    fn follow(&mut self, path: [f64; 4]) -> f64 {
        let mean_m = 0.5 * (path[0] + self.structure[0]);
        for Creep { creeps: [out, back], relaxed_m, .. } in &mut self.creep {
            let apart_m = mean_m - *relaxed_m;
            *relaxed_m += apart_m * if apart_m * *relaxed_m < 0.0 { *back } else { *out };
        }
        for (arm, follower) in &mut self.arms {
            let natural_rad_per_s = std::f64::consts::TAU * arm.hz;
            follower.pass(
                Some(Lag::Second { natural_rad_per_s, damping_ratio: arm.damping_ratio }),
                path,
                self.sample_s,
            );
        }
        self.seen_m()
    }

    fn seen_m(&self) -> f64 {
        let q = self.structure[0];
        let crept = |Creep { element, relaxed_m: r, .. }: &Creep| {
            element.share * (r + r.abs() * (element.by_side + element.growth_per_m * r))
        };
        let crept: f64 = self.creep.iter().map(crept).sum();
        let swing = |(arm, follower): &(Arm, LagState)| {
            let rate_m = follower.slope() / (std::f64::consts::TAU * arm.hz);
            arm.share * (follower.value() - q) + arm.rate_share * rate_m
        };
        let swung: f64 = self.arms.iter().map(swing).sum();
        q + crept + swung
    }

    fn dragged_m(&self, from_m: f64, displacement_m: f64) -> f64 {
        if self.sensor().drag_s == f64::INFINITY {
            return from_m;
        }
        from_m + self.drags * (displacement_m - from_m)
    }

    /// Half the width of the play of one contact.
    fn half_m(&self, contact: usize) -> f64 {
        let narrower = self.sensor().play_spread * contact as f64 / (CONTACTS - 1) as f64;
        0.5 * self.sensor().play_m * (1.0 - narrower)
    }

    fn mean_m(&self) -> f64 {
        self.contacts_m[..self.contacts].iter().sum::<f64>() / self.contacts as f64
    }

    /// The reading at this sample.
    #[inline]
    pub(super) fn reading_m(&self) -> f64 {
        self.reading.at_m(self.before_reading_m(), self.sample)
    }

    /// What that reading is made of.
    #[inline]
    pub(super) fn before_reading_m(&self) -> f64 {
        let seen_m = if self.sensor().lag.is_some() { self.lag.value() } else { self.behind_m };
        seen_m + self.sensor().late_s * self.structure[1]
    }

    /// Number of this sample, from the start on.
    pub(super) fn sample(&self) -> u64 {
        self.sample
    }

    /// When that is.
    pub(super) fn time_s(&self) -> f64 {
        self.sample as f64 * self.sample_s
    }
}

/// Hermite's cubic through values and slopes at both ends.
fn hermite([from, from_slope]: [f64; 2], [to, to_slope]: [f64; 2], t: f64) -> [f64; 4] {
    let mean = (to - from) / t;
    [from, from_slope, (3.0 * mean - 2.0 * from_slope - to_slope) / t, (from_slope + to_slope - 2.0 * mean) / (t * t)]
}

/// When a cubic turns whose slope has the other sign after `t_end`, `to_slope`, than at its start.
fn turn_s([_, slope, bend, twist]: [f64; 4], to_slope: f64, t_end: f64) -> f64 {
    // Of the slope's two roots the one through which it goes to the sign that it has at the end; next to nothing of either slope is lost in the bend's
    // rounding, and the root with it.
    let root = (bend * bend - 3.0 * twist * slope).max(0.0).sqrt();
    (-slope / (bend + root.copysign(to_slope))).clamp(0.0, t_end)
}

/// When a cubic that goes one way from the first of two times to the second reaches `value`, which lies before where it ends.
fn reached_s(path: [f64; 4], value: f64, [mut before_s, mut after_s]: [f64; 2]) -> f64 {
    let is_up = at(path, after_s) > value;
    let is_beyond = |t: f64| (at(path, t) >= value) == is_up;
    // What went along before is at the edge but for rounding.
    if is_beyond(before_s) || (at(path, before_s) - value).abs() < ROUNDING_M {
        return before_s;
    }
    for _ in 0..HALVINGS {
        let middle_s = 0.5 * (before_s + after_s);
        if is_beyond(middle_s) {
            after_s = middle_s;
        } else {
            before_s = middle_s;
        }
    }
    after_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_lies_on_the_way() {
        // The parabola t - t^2 turns in the middle.
        assert_eq!(turn_s(hermite([0.0, 1.0], [0.0, -1.0], 1.0), -1.0, 1.0), 0.5);
        // Slopes that are nothing beside what rounding leaves of the rest: no turn lies farther than either end.
        for small in [1e-9, 1e-17, 1e-30, 1e-300] {
            for k in 0..1000 {
                let large = 1.0 + 1e-3 * f64::from(k);
                for [slope, to_slope] in [[large, -small], [-small, large], [small, -large], [-large, small]] {
                    for to in [slope / 3.0, to_slope / 3.0, large, -large] {
                        let path = hermite([0.0, slope], [to, to_slope], 1.0);
                        let turn = at(path, turn_s(path, to_slope, 1.0));
                        assert!(turn.abs() < 2.0 * large, "{slope} to {to_slope} over {to}: {turn}");
                    }
                }
            }
        }
    }
}
