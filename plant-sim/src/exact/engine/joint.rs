//! Both spans of a sample in one move: what a command that arrives within each sample makes of every sample of a record.
//!
//! The two maps are one, y = E2 (E1 x + F1 f1 + o1) + F2 f2 + o2, and of the state between them the check needs two numbers, velocity and
//! acceleration. While the velocity keeps its sign a hysteron inside its dead zone moves one way, and one outside meets its edge once at the most: if the
//! region is the same at both ends, it is the same between the spans.

use super::super::dynamics::VELOCITY;
use super::super::maps::{Columns, Linear, apply};
use super::{Engine, Region, inside, keeps_sign};

/// A region's two longest maps as one.
pub(super) struct Joint<const N: usize> {
    state: Columns<N>,
    /// Responses to one newton over the first span and over the second, and to the region's constants.
    forces: [[f64; N]; 2],
    offset: [f64; N],
    /// Velocity between the spans: of the state, of one newton over the first, of the constants.
    velocity: ([f64; N], f64, f64),
    /// The same of the acceleration without the force's share.
    pull: ([f64; N], f64, f64),
}

impl<const N: usize> Joint<N> {
    /// Of the maps over both spans and their responses to constants; `acceleration_row` makes a pull of a state.
    pub(super) fn new([first, second]: [&(Linear<N>, [f64; N]); 2], acceleration_row: &[f64; N]) -> Self {
        let (map, offset) = first;
        let after = |x: &[f64; N]| apply(&second.0.state, x);
        let with = |one: [f64; N], other: &[f64; N]| std::array::from_fn(|i| one[i] + other[i]);
        let pull = |x: &[f64; N]| (0..N).map(|i| acceleration_row[i] * x[i]).sum::<f64>();
        Self {
            state: std::array::from_fn(|j| after(&map.state[j])),
            forces: [after(&map.force), second.0.force],
            offset: with(after(offset), &second.1),
            velocity: (std::array::from_fn(|j| map.state[j][VELOCITY]), map.force[VELOCITY], offset[VELOCITY]),
            pull: (std::array::from_fn(|j| pull(&map.state[j])), pull(&map.force), pull(offset)),
        }
    }

    /// A number between the spans.
    #[inline(always)]
    fn between((of_state, of_force, of_constants): &([f64; N], f64, f64), x: &[f64; N], force_n: f64) -> f64 {
        let mut sum = of_constants + of_force * force_n;
        for i in 0..N {
            sum += of_state[i] * x[i];
        }
        sum
    }
}

impl<const N: usize> Engine<N> {
    /// Moves over both spans with the force of each held, if that can't have left the region on its way.
    #[inline(always)]
    pub(super) fn moves_over_both(&mut self, forces_n: [f64; 2]) -> bool {
        let region: &Region<N> = &self.regions[self.region];
        let Some(joint) = region.joint.as_ref().filter(|_| self.rates.is_none()) else { return false };
        let mut y = joint.offset;
        for i in 0..N {
            y[i] += joint.forces[0][i] * forces_n[0] + joint.forces[1][i] * forces_n[1];
        }
        for j in 0..N {
            for i in 0..N {
                y[i] += joint.state[j][i] * self.x[j];
            }
        }
        if !inside(region, &y) {
            return false;
        }
        let (pull, drive) = (self.pull(&y), self.force[VELOCITY]);
        let [pushed, then] = forces_n.map(|force_n| drive * force_n);
        let between = Joint::between(&joint.velocity, &self.x, forces_n[0]);
        let pull_between = Joint::between(&joint.pull, &self.x, forces_n[0]);
        let [first_s, second_s] = self.durations_s;
        let (w0, w1) = (self.x[VELOCITY], y[VELOCITY]);
        let (keeps_first, first) = keeps_sign([w0, between], first_s, [self.pull + pushed, pull_between + pushed]);
        let (keeps_second, second) = keeps_sign([between, w1], second_s, [pull_between + then, pull + then]);
        let goes_one_way = keeps_first && keeps_second && (w0 + between) * (between + w1) > 0.0;
        let reach_m = 2.0 * (first_s * first + second_s * second);
        if !goes_one_way && !self.out_of_reach(region.signs, first_s + second_s, reach_m) {
            return false;
        }
        (self.x, self.pull) = (y, pull);
        true
    }
}
