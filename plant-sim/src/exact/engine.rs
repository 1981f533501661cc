//! The stepping itself: accept a whole move, halve it, or find the crossing.

mod joint;

use super::Stepper;
use super::dynamics::{DISPLACEMENT, DeadZone, Dynamics, VELOCITY};
use super::energy::{Audit, NoAudit};
use super::maps::{Columns, DEGREE, FINEST, Linear, apply, halved, ladder};
use super::push::{Push, Spans};
use joint::Joint;
use std::collections::HashMap;

/// A move is halved unless the velocity's cubic stays this far from zero, relative to the velocities and accelerations at its ends.
/// The cubic's own error is (turning rate * move)^4 / 384 <= 0.0026 of that scale for moves of at most one turning time.
const TURNING_MARGIN: f64 = 1e-2;
/// What does not fit the cubic counts as well: an open dead zone may discharge much faster than the velocity turns, and then the mean
/// acceleration is not the mean of those at the ends. Of A exp(-r t) the cubic misses at most 0.4 times that difference, whatever r.
const MISFIT: f64 = 0.5;
/// Largest product of turning rate and the longest move tried.
const LONGEST: f64 = 1.0;
/// Motion below this fraction of a dead zone's width can't matter: with 120 um of travel it is 1e-18 m.
const NEGLIGIBLE: f64 = 1e-14;
/// Crossings of one dead zone at one and the same instant before the engine moves on without one; rounding at an edge needs two.
const CROSSINGS_AT_ONCE: u32 = 4;
/// A state this close to an edge, relative to the edge, is on it: rounding, which the maps' doublings add up (about 2e-16 each, 50 at most).
const ON_EDGE: f64 = 2e-14;
/// Crossings closer together than this fraction of a finest step count as one instant: below 1e-13 s for the stiffest plant in use.
const INSTANT: f64 = 1e-6;
/// Halvings at the most: 2^50 finest steps are beyond what f64 time can resolve.
const MOST_HALVINGS: u32 = 50;

/// A, for one set of open dead zones, with its ladders of maps (one ladder per span).
struct OpenSet<const N: usize> {
    a: Columns<N>,
    halvings: [u32; 2],
    ladders: [Vec<Linear<N>>; 2],
}

/// One region: an open set with the signs of what is open. What every sample needs stands first and in one piece.
struct Region<const N: usize> {
    /// The longest map of each span, copied from the open set's ladder, and the response to `constant` over it.
    whole: [(Linear<N>, [f64; N]); 2],
    /// Between which values each state keeps the signs.
    low: [f64; N],
    high: [f64; N],
    signs: Signs,
    open_set: usize,
    /// c, constants in x' = A x + b f + c.
    constant: [f64; N],
    /// Both maps as one, where both spans are in use and no map is shorter than its span.
    joint: Option<Joint<N>>,
    /// Response to `constant` over each map of the open set's ladders.
    offsets: [Vec<[f64; N]>; 2],
}

/// Two bits per dead zone: 0 inside, 1 open upwards, 2 open downwards.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Signs(u64);

impl Signs {
    pub(crate) fn get(self, zone: usize) -> f64 {
        match (self.0 >> (2 * zone)) & 3 {
            0 => 0.0,
            1 => 1.0,
            _ => -1.0,
        }
    }

    fn with(self, zone: usize, sign: f64) -> Self {
        let bits = if sign > 0.0 {
            1
        } else if sign < 0.0 {
            2
        } else {
            0
        };
        Self(self.0 & !(3 << (2 * zone)) | bits << (2 * zone))
    }

    fn open(self) -> u64 {
        (self.0 | self.0 >> 1) & 0x5555_5555_5555_5555
    }
}

/// 1/k; the polynomial's rounding is the series' own, so a product serves as well as a quotient and costs a third.
const RECIPROCAL: [f64; DEGREE + 1] = {
    let mut reciprocal = [1.0; DEGREE + 1];
    let mut k = 1;
    while k <= DEGREE {
        reciprocal[k] = 1.0 / k as f64;
        k += 1;
    }
    reciprocal
};

/// Steps a system of at most `N` states exactly.
pub struct Engine<const N: usize> {
    dynamics: Dynamics,
    closed: Columns<N>,
    force: [f64; N],
    zones: Vec<DeadZone>,
    acceleration_row: [f64; N],
    negligible_m: f64,
    durations_s: [f64; 2],
    coarsest: [u32; 2],
    open_sets: Vec<OpenSet<N>>,
    open_set_of: HashMap<u64, usize>,
    regions: Vec<Region<N>>,
    region_of: HashMap<Signs, usize>,
    x: [f64; N],
    /// Constant additions to x', and whether there are any.
    rates: Option<[f64; N]>,
    /// Acceleration at `x` without the force's share, kept from the check of the move that led there.
    pull: f64,
    region: usize,
}

impl<const N: usize> Engine<N> {
    /// An engine at rest in the zero state.
    ///
    /// `dynamics` must have at most `N` states.
    pub fn new(dynamics: &Dynamics, spans: Spans) -> Self {
        let states = dynamics.states();
        let mut closed = [[0.0; N]; N];
        let mut force = [0.0; N];
        let mut acceleration_row = [0.0; N];
        for j in 0..states {
            for i in 0..states {
                closed[j][i] = dynamics.closed[(i, j)];
            }
            force[j] = dynamics.force[j];
            acceleration_row[j] = dynamics.closed[(VELOCITY, j)];
        }
        let coarsest = spans.durations_s.map(|s| halvings(s * dynamics.turning_rate_per_s / LONGEST));
        let narrowest_m = dynamics.dead_zones.iter().map(|z| z.edge / z.per_metre).fold(f64::INFINITY, f64::min);
        let mut engine = Self {
            dynamics: dynamics.clone(),
            closed,
            force,
            zones: dynamics.dead_zones.clone(),
            acceleration_row,
            negligible_m: NEGLIGIBLE * narrowest_m,
            durations_s: spans.durations_s,
            coarsest,
            open_sets: Vec::new(),
            open_set_of: HashMap::new(),
            regions: Vec::new(),
            region_of: HashMap::new(),
            x: [0.0; N],
            rates: None,
            pull: 0.0,
            region: 0,
        };
        engine.region = engine.region_index(Signs(0));
        engine
    }

    /// The state, padded with zeros.
    pub(crate) fn x(&self) -> &[f64; N] {
        &self.x
    }

    /// Index of the region with these signs; its maps are made when it is entered for the first time.
    fn region_index(&mut self, signs: Signs) -> usize {
        if let Some(&index) = self.region_of.get(&signs) {
            return index;
        }
        let open_set = self.open_set_index(signs.open());
        let mut constant = [0.0; N];
        for (i, zone) in self.zones.iter().enumerate() {
            constant[zone.state] += signs.get(i) * zone.edge * zone.rate_per_s;
        }
        let offsets: [Vec<[f64; N]>; 2] = [0, 1].map(|span: usize| {
            self.open_sets[open_set].ladders[span].iter().map(|map| apply(&map.constant, &constant)).collect()
        });
        let whole = [0, 1].map(|span: usize| {
            let ladder = &self.open_sets[open_set].ladders[span];
            (ladder.first().cloned().unwrap_or_default(), offsets[span].first().copied().unwrap_or([0.0; N]))
        });
        let (mut low, mut high) = ([f64::NEG_INFINITY; N], [f64::INFINITY; N]);
        for (i, zone) in self.zones.iter().enumerate() {
            // With room for rounding: a stiff hysteron follows its edge more closely than f64 resolves, and a move must not be
            // walked in finest steps because it ended one unit beside it.
            let (within, beyond) = (zone.edge * (1.0 - ON_EDGE), zone.edge * (1.0 + ON_EDGE));
            match signs.get(i) {
                0.0 => (low[zone.state], high[zone.state]) = (-beyond, beyond),
                1.0 => low[zone.state] = within,
                _ => high[zone.state] = -within,
            }
        }
        let has_joint = self.durations_s.iter().all(|s| *s > 0.0) && self.coarsest == [0; 2];
        let joint = has_joint.then(|| Joint::new([&whole[0], &whole[1]], &self.acceleration_row));
        self.regions.push(Region { whole, joint, low, high, signs, open_set, constant, offsets });
        self.region_of.insert(signs, self.regions.len() - 1);
        self.regions.len() - 1
    }

    fn open_set_index(&mut self, open: u64) -> usize {
        if let Some(&index) = self.open_set_of.get(&open) {
            return index;
        }
        let mut a = self.closed;
        for (i, zone) in self.zones.iter().enumerate() {
            if open >> (2 * i) & 1 == 1 {
                a[zone.state][zone.state] -= zone.rate_per_s;
            }
        }
        let rate_per_s = self.dynamics.fastest_rate_per_s(|i, j| a[j][i]);
        let halvings =
            [0, 1].map(|span: usize| halvings(self.durations_s[span] * rate_per_s / FINEST).max(self.coarsest[span]));
        let ladders = [0, 1].map(|span: usize| {
            if self.durations_s[span] > 0.0 {
                ladder(&a, &self.force, self.durations_s[span], self.coarsest[span], halvings[span])
            } else {
                Vec::new()
            }
        });
        self.open_sets.push(OpenSet { a, halvings, ladders });
        self.open_set_of.insert(open, self.open_sets.len() - 1);
        self.open_sets.len() - 1
    }

    /// State after `map` with the response `offset` to the region's constants.
    #[inline(always)]
    fn moved<const ORDER: u8>(&self, map: &Linear<N>, offset: &[f64; N], push: Push) -> [f64; N] {
        // Two sums, so that neither waits for the other.
        let mut y = *offset;
        let mut driven = [0.0; N];
        for i in 0..N {
            driven[i] = map.force[i] * push.force_n;
            if ORDER > 0 {
                driven[i] += map.ramp[i] * push.slope;
            }
            if ORDER > 1 {
                driven[i] += map.curve[i] * push.curve;
            }
        }
        for j in (0..N).step_by(2) {
            for i in 0..N {
                y[i] += map.state[j][i] * self.x[j];
                driven[i] += map.state[j + 1][i] * self.x[j + 1];
            }
        }
        for i in 0..N {
            y[i] += driven[i];
        }
        y
    }

    /// `offset`, the response to a region's constants over `map`, with that to the constant additions.
    #[inline(always)]
    fn with_rates(&self, map: &Linear<N>, offset: &[f64; N]) -> [f64; N] {
        let mut sum = *offset;
        if let Some(rates) = &self.rates {
            let response = apply(&map.constant, rates);
            for i in 0..N {
                sum[i] += response[i];
            }
        }
        sum
    }

    /// Acceleration at `x` without the force's share.
    #[inline(always)]
    fn pull(&self, x: &[f64; N]) -> f64 {
        let mut sum = self.rates.as_ref().map_or(0.0, |rates| rates[VELOCITY]);
        for j in 0..N {
            sum += self.acceleration_row[j] * x[j];
        }
        sum
    }

    /// Whether the move from the present state to `y`, with acceleration `a1` there, within `duration_s` can't have left the region on
    /// its way. `a0` is the acceleration at its start.
    #[inline(always)]
    fn stayed(&self, region: &Region<N>, y: &[f64; N], duration_s: f64, [a0, a1]: [f64; 2]) -> bool {
        if !inside(region, y) {
            return false;
        }
        let (keeps_sign, size) = keeps_sign([self.x[VELOCITY], y[VELOCITY]], duration_s, [a0, a1]);
        keeps_sign || self.out_of_reach(region.signs, duration_s, 2.0 * duration_s * size)
    }

    /// Whether no edge lies within `reach_m` of displacement from the present state.
    #[cold]
    fn out_of_reach(&self, signs: Signs, duration_s: f64, reach_m: f64) -> bool {
        reach_m < self.negligible_m
            || self.zones.iter().enumerate().all(|(i, zone)| {
                let sign = signs.get(i);
                let to_edge = excess(zone, sign, self.x[zone.state]);
                // What is open closes by itself as well, at most to exp(-rate t) >= 1 - rate t of its excess.
                let kept = if sign == 0.0 { 1.0 } else { 1.0 - zone.rate_per_s * duration_s };
                to_edge * kept > zone.per_metre * reach_m
            })
    }

    #[inline(always)]
    fn advance_audited<const ORDER: u8, A: Audit<N>>(&mut self, span: usize, push: Push, audit: &mut A) {
        let duration_s = self.durations_s[span];
        if duration_s == 0.0 {
            return;
        }
        let coarsest = self.coarsest[span];
        let left_s = if coarsest > 0 {
            self.longest_moves::<ORDER, A>(span, push, coarsest, audit)
        } else if self.moves::<ORDER, A>(span, push, duration_s, audit) {
            return;
        } else {
            duration_s
        };
        if left_s > 0.0 {
            self.walk::<ORDER, A>(span, push, left_s, audit);
            self.pull = self.pull(&self.x);
        }
    }

    /// Makes the longest move of a span, `move_s`, if it is certain.
    #[inline(always)]
    fn moves<const ORDER: u8, A: Audit<N>>(&mut self, span: usize, push: Push, move_s: f64, audit: &mut A) -> bool {
        let region = &self.regions[self.region];
        let (map, offset) = &region.whole[span];
        let y = self.moved::<ORDER>(map, &self.with_rates(map, offset), push);
        let (pull, drive) = (self.pull(&y), self.force[VELOCITY]);
        let ends = [self.pull + drive * push.force_n, pull + drive * push.after(move_s).force_n];
        if !self.stayed(region, &y, move_s, ends) {
            return false;
        }
        audit.map(self, span, 0, push.force_n);
        (self.x, self.pull) = (y, pull);
        true
    }

    /// Makes such moves, of which a span has more than one, as long as each is certain; returns what is left of the span, in seconds.
    #[inline(never)]
    fn longest_moves<const ORDER: u8, A: Audit<N>>(
        &mut self,
        span: usize,
        push: Push,
        coarsest: u32,
        audit: &mut A,
    ) -> f64 {
        let (moves, move_s) = (1_u64 << coarsest, self.durations_s[span] * halved(coarsest));
        for number in 0..moves {
            if !self.moves::<ORDER, A>(span, push.after(number as f64 * move_s), move_s, audit) {
                return (moves - number) as f64 * move_s;
            }
        }
        0.0
    }

    /// The slow path over the last `left_s` of a span: descends the ladder where a whole move is not certain, and crosses edges.
    #[inline(never)]
    fn walk<const ORDER: u8, A: Audit<N>>(&mut self, span: usize, push: Push, mut left_s: f64, audit: &mut A) {
        let duration_s = self.durations_s[span];
        let coarsest = self.coarsest[span];
        let drive = self.force[VELOCITY];
        let most_crossings = CROSSINGS_AT_ONCE * (1 + self.zones.len() as u32);
        let mut crossings_at_once = 0;
        if !(push.after(duration_s).force_n + self.x.iter().sum::<f64>()).is_finite() {
            // Nothing to find in a state that is no number, and no move would ever be certain.
            self.x = [f64::NAN; N];
            return;
        }
        'region: while left_s > 1e-15 * duration_s {
            let halvings = self.open_sets[self.regions[self.region].open_set].halvings[span];
            let tick_s = duration_s * halved(halvings);
            // Whole ticks left, and the fraction of a tick that a crossing left behind; rounding must not make a tick of nothing.
            let ticks = (left_s / tick_s * (1.0 + 1e-12)).floor();
            let fraction_s = left_s - ticks * tick_s;
            let mut ticks = ticks as u64;
            if fraction_s > 1e-12 * tick_s {
                let now = push.after(duration_s - left_s);
                let (moved_s, crossed) = self.finest_step(fraction_s, now, crossings_at_once < most_crossings, audit);
                crossings_at_once = if moved_s > INSTANT * tick_s { 0 } else { crossings_at_once + 1 };
                left_s -= moved_s;
                if crossed {
                    continue 'region;
                }
            }
            // Ticks left at the end of the shortest move that ended outside: no use in trying that end again.
            let mut outside_at = None;
            let mut level = coarsest;
            let mut pull = self.pull(&self.x);
            while ticks > 0 {
                level = level.max(halvings - ticks.ilog2());
                left_s = ticks as f64 * tick_s;
                let now = push.after(duration_s - left_s);
                if level < halvings && outside_at == Some(ticks - (1 << (halvings - level))) {
                    level += 1;
                }
                let region = &self.regions[self.region];
                let rung = (level - coarsest) as usize;
                let move_s = duration_s * halved(level);
                let map = &self.open_sets[region.open_set].ladders[span][rung];
                let offset = self.with_rates(map, &region.offsets[span][rung]);
                let y = self.moved::<ORDER>(map, &offset, now);
                let pull_y = self.pull(&y);
                let ends = [pull + drive * now.force_n, pull_y + drive * now.after(move_s).force_n];
                if self.stayed(region, &y, move_s, ends) {
                    audit.map(self, span, rung, now.force_n);
                    (self.x, pull) = (y, pull_y);
                    ticks -= 1 << (halvings - level);
                    level = level.saturating_sub(1).max(coarsest);
                } else if level < halvings {
                    let mut shorter = 1;
                    if !inside(region, &y) {
                        outside_at = Some(ticks - (1 << (halvings - level)));
                        shorter = halvings_to(region, &self.x, &y);
                    }
                    level = (level + shorter).min(halvings);
                } else {
                    let (moved_s, crossed) = self.finest_step(tick_s, now, crossings_at_once < most_crossings, audit);
                    crossings_at_once = if moved_s > INSTANT * tick_s { 0 } else { crossings_at_once + 1 };
                    if crossed {
                        left_s -= moved_s;
                        continue 'region;
                    }
                    pull = self.pull(&self.x);
                    ticks -= 1;
                }
            }
            return;
        }
    }

    /// Moves by at most `step_s`, no longer than a finest step, up to the first crossing; returns the time moved and whether a
    /// crossing ended it.
    fn finest_step<A: Audit<N>>(&mut self, step_s: f64, push: Push, may_cross: bool, audit: &mut A) -> (f64, bool) {
        if let Some((zone, sign)) = self.leaving_an_edge().filter(|_| may_cross) {
            let DeadZone { state, edge, .. } = self.zones[zone];
            self.x[state] = edge.copysign(self.x[state]);
            self.region = self.region_index(self.regions[self.region].signs.with(zone, sign));
            return (0.0, true);
        }
        let region = &self.regions[self.region];
        let signs = region.signs;
        let a = &self.open_sets[region.open_set].a;
        let mut series = Series { terms: [[0.0; N]; DEGREE + 1] };
        series.terms[0] = self.x;
        for degree in 1..=DEGREE {
            let mut next = apply(a, &series.terms[degree - 1]);
            for i in 0..N {
                match degree {
                    1 => {
                        let rate = self.rates.as_ref().map_or(0.0, |rates| rates[i]);
                        next[i] += self.force[i] * push.force_n + region.constant[i] + rate;
                    }
                    2 => next[i] += self.force[i] * push.slope,
                    3 => next[i] += 0.5 * self.force[i] * push.curve,
                    _ => {}
                }
                next[i] *= RECIPROCAL[degree];
            }
            series.terms[degree] = next;
        }
        let end = series.at(step_s);
        let ends = [series.terms[1][VELOCITY], self.pull(&end) + self.force[VELOCITY] * push.after(step_s).force_n];
        let crossing = if may_cross && !self.stayed(region, &end, step_s, ends) {
            self.first_crossing(signs, &series, step_s, &end, ends)
        } else {
            None
        };
        let moved_s = crossing.map_or(step_s, |c| c.time_s);
        audit.series(self, &series, moved_s, push.force_n);
        self.x = if crossing.is_some() { series.at(moved_s) } else { end };
        if let Some(Crossing { zone, sign, level, .. }) = crossing {
            self.x[self.zones[zone].state] = level;
            self.region = self.region_index(signs.with(zone, sign));
        }
        (moved_s, crossing.is_some())
    }

    /// A dead zone whose state sits on its edge to rounding and moves out of the region; with its new sign.
    ///
    /// On a finest step of a stiff plant such a motion can be less than rounding. Then no step would ever end outside, and a sample
    /// would be walked in finest steps to its end.
    fn leaving_an_edge(&self) -> Option<(usize, f64)> {
        let signs = self.regions[self.region].signs;
        let w = self.x[VELOCITY];
        self.zones.iter().enumerate().find_map(|(i, zone)| {
            let (v, sign) = (self.x[zone.state], signs.get(i));
            let outward = v.signum() * w > 0.0;
            let on_edge = (v.abs() - zone.edge).abs() <= ON_EDGE * zone.edge;
            match sign {
                0.0 if on_edge && outward => Some((i, v.signum())),
                s if s != 0.0 && on_edge && w * s < 0.0 => Some((i, 0.0)),
                _ => None,
            }
        })
    }

    /// The earliest edge that the series meets within `step_s`, at whose end the state is `end`; accelerations `a` at both ends.
    fn first_crossing(
        &self,
        signs: Signs,
        series: &Series<N>,
        step_s: f64,
        end: &[f64; N],
        a: [f64; 2],
    ) -> Option<Crossing> {
        let (w0, w1) = (series.terms[0][VELOCITY], end[VELOCITY]);
        let (p1, p2) = (w0 + a[0] * step_s / 3.0, w1 - a[1] * step_s / 3.0);
        let least = w0.min(w1).min(p1).min(p2);
        let most = w0.max(w1).max(p1).max(p2);
        // A velocity that keeps well clear of zero, which is the rule, turns nowhere.
        let clear = TURNING_MARGIN * (most - least);
        let turning = if least > clear || most < -clear { [None; 2] } else { series.turning_points(step_s) };
        let mut from_s = 0.0;
        for to_s in turning.into_iter().flatten().chain(std::iter::once(step_s)) {
            let there = if to_s == step_s { *end } else { series.at(to_s) };
            let mut first: Option<Crossing> = None;
            for (index, zone) in self.zones.iter().enumerate() {
                let sign = signs.get(index);
                if excess(zone, sign, there[zone.state]) >= 0.0 {
                    continue;
                }
                let level = if sign == 0.0 { zone.edge.copysign(there[zone.state]) } else { sign * zone.edge };
                let time_s = series.root(zone.state, level, from_s, to_s, there[zone.state]);
                if first.as_ref().is_none_or(|f| time_s < f.time_s) {
                    let entered = if sign == 0.0 { level.signum() } else { 0.0 };
                    first = Some(Crossing { time_s, zone: index, sign: entered, level });
                }
            }
            if first.is_some() {
                return first;
            }
            from_s = to_s;
        }
        None
    }

    fn signs_of(&self, x: &[f64; N]) -> Signs {
        let mut signs = Signs(0);
        for (i, zone) in self.zones.iter().enumerate() {
            let v = x[zone.state];
            if v.abs() > zone.edge {
                signs = signs.with(i, v.signum());
            }
        }
        signs
    }

    pub(crate) fn advance_with<A: Audit<N>>(&mut self, span: usize, force_n: f64, audit: &mut A) {
        self.advance_audited::<0, A>(span, Push::held(force_n), audit);
    }

    pub(crate) fn span_s(&self, span: usize, rung: usize) -> f64 {
        self.durations_s[span] * halved(self.coarsest[span] + rung as u32)
    }

    pub(crate) fn current_signs(&self) -> Signs {
        self.regions[self.region].signs
    }

    pub(crate) fn current_matrices(&self) -> (&Columns<N>, &[f64; N], &[f64; N]) {
        let region = &self.regions[self.region];
        (&self.open_sets[region.open_set].a, &self.force, &region.constant)
    }
}

/// A crossing: when, which dead zone, its new sign, and the value of its state there.
#[derive(Clone, Copy)]
struct Crossing {
    time_s: f64,
    zone: usize,
    sign: f64,
    level: f64,
}

/// Whether a velocity that is `w0` and `w1` at both ends of a move of `duration_s`, with accelerations `a0` and `a1`, can't have changed its sign
/// between them; and the most that it is about.
#[inline(always)]
fn keeps_sign([w0, w1]: [f64; 2], duration_s: f64, [a0, a1]: [f64; 2]) -> (bool, f64) {
    // Bezier points of the cubic through both ends; the cubic lies in their hull.
    let third_s = duration_s * (1.0 / 3.0);
    let (p1, p2) = (w0 + a0 * third_s, w1 - a1 * third_s);
    let misfit = (w1 - w0 - 0.5 * duration_s * (a0 + a1)).abs();
    let size = w0.abs() + w1.abs() + duration_s * (a0.abs() + a1.abs());
    let margin = TURNING_MARGIN * size + MISFIT * misfit;
    // Both ends and both Bezier points on one side of zero; the sign of the start is free where it is zero.
    let sign = if w0 + w1 < 0.0 { -1.0 } else { 1.0 };
    (sign * w0 >= 0.0 && sign * w1 >= 0.0 && sign * p1 > margin && sign * p2 > margin, size)
}

/// Whether every state is within the region's bounds.
#[inline(always)]
fn inside<const N: usize>(region: &Region<N>, x: &[f64; N]) -> bool {
    let mut all = true;
    for i in 0..N {
        all &= (x[i] >= region.low[i]) & (x[i] <= region.high[i]);
    }
    all
}

/// Halvings, one at least, of a move from `x` to `y` outside the region after which it ends inside, if all states went there in straight lines.
#[inline(always)]
fn halvings_to<const N: usize>(region: &Region<N>, x: &[f64; N], y: &[f64; N]) -> u32 {
    let mut share = 1.0;
    for i in 0..N {
        // Not `clamp`, which panics where an edge is no number.
        let bound = y[i].max(region.low[i]).min(region.high[i]);
        if bound != y[i] {
            share = f64::min(share, (bound - x[i]) / (y[i] - x[i]));
        }
    }
    // The exponent of a share below one: no logarithm is needed.
    let exponent = (share.max(f64::MIN_POSITIVE).to_bits() >> 52) as u32;
    (1023 - exponent.min(1022)).min(MOST_HALVINGS)
}

/// Distance of value `v` from leaving the state that `sign` names; negative once it has left.
#[inline(always)]
fn excess(zone: &DeadZone, sign: f64, v: f64) -> f64 {
    if sign == 0.0 { zone.edge - v.abs() } else { sign * v - zone.edge }
}

/// Smallest h with `product / 2^h <= 1`.
fn halvings(product: f64) -> u32 {
    if product > 1.0 { (product.log2().ceil() as u32).min(MOST_HALVINGS) } else { 0 }
}

/// Taylor polynomial of the whole state on a finest step.
pub(crate) struct Series<const N: usize> {
    terms: [[f64; N]; DEGREE + 1],
}

impl<const N: usize> Series<N> {
    pub(crate) fn at(&self, t: f64) -> [f64; N] {
        let mut x = self.terms[DEGREE];
        for degree in (0..DEGREE).rev() {
            for i in 0..N {
                x[i] = x[i] * t + self.terms[degree][i];
            }
        }
        x
    }

    /// Value and derivatives one and two of one state.
    fn value_and_slopes(&self, state: usize, t: f64) -> [f64; 3] {
        let [mut value, mut first, mut second] = [self.terms[DEGREE][state], 0.0, 0.0];
        for degree in (0..DEGREE).rev() {
            second = second * t + 2.0 * first;
            first = first * t + value;
            value = value * t + self.terms[degree][state];
        }
        [value, first, second]
    }

    /// Instants inside (0, step) at which the velocity changes its sign, in order: between them every dead zone moves one way.
    ///
    /// On a finest step the acceleration has at most one zero that matters (a second one would need velocity, acceleration and
    /// jerk to vanish together), so the velocity has at most two.
    fn turning_points(&self, step_s: f64) -> [Option<f64>; 2] {
        let [w0, a0, _] = self.value_and_slopes(VELOCITY, 0.0);
        let [w1, a1, _] = self.value_and_slopes(VELOCITY, step_s);
        let between = |from_s: f64, w_from: f64, to_s: f64, w_to: f64| {
            (w_from * w_to < 0.0).then(|| self.root(VELOCITY, 0.0, from_s, to_s, w_to))
        };
        if a0 * a1 >= 0.0 {
            return [between(0.0, w0, step_s, w1), None];
        }
        // The extremum only separates the two zeros, so the rounding of its own place is of no consequence.
        let extremum = refine(0.0, step_s, a0, a1, |t| {
            let [_, slope, curvature] = self.value_and_slopes(VELOCITY, t);
            [slope, curvature, 0.0]
        });
        let w = self.value_and_slopes(VELOCITY, extremum)[0];
        [between(0.0, w0, extremum, w), between(extremum, w, step_s, w1)]
    }

    /// Root of `state - level` between two instants on whose sides its signs differ (or where the first already is past it); the
    /// state is `end` at the second.
    fn root(&self, state: usize, level: f64, from_s: f64, to_s: f64, end: f64) -> f64 {
        let start = if from_s == 0.0 { self.terms[0][state] } else { self.value_and_slopes(state, from_s)[0] } - level;
        let end = end - level;
        if start == 0.0 || (start < 0.0) == (end < 0.0) {
            return from_s;
        }
        refine(from_s, to_s, start, end, |t| {
            let [value, slope, curvature] = self.value_and_slopes(state, t);
            [value - level, slope, curvature]
        })
    }
}

/// Root of `f` (value and two derivatives) between `low` and `high`, where f is `start` and `end`, of opposite signs: Halley's
/// iteration from the chord's root, kept inside by bisection.
fn refine(mut low: f64, mut high: f64, start: f64, end: f64, f: impl Fn(f64) -> [f64; 3]) -> f64 {
    let mut t = low + (high - low) * start / (start - end);
    for _ in 0..60 {
        let [value, slope, curvature] = f(t);
        if value == 0.0 {
            return t;
        }
        if (value < 0.0) == (start < 0.0) {
            low = t;
        } else {
            high = t;
        }
        let newton = value / slope;
        let step = newton / (1.0 - 0.5 * newton * curvature / slope);
        let next = if t - step > low && t - step < high { t - step } else { 0.5 * (low + high) };
        // The error of the next iterate is of third order in this step: below 1e-6 of the interval, nothing is left to gain.
        if (next - t).abs() <= 1e-6 * high {
            return next;
        }
        t = next;
    }
    t
}

impl<const N: usize> Stepper for Engine<N> {
    fn advance(&mut self, span: usize, force_n: f64, slope_n_per_s: f64) {
        if slope_n_per_s == 0.0 {
            self.advance_audited::<0, NoAudit>(span, Push::held(force_n), &mut NoAudit);
        } else {
            self.advance_audited::<1, NoAudit>(span, Push::ramp(force_n, slope_n_per_s), &mut NoAudit);
        }
    }

    fn advance_both(&mut self, forces_n: [f64; 2]) {
        if !self.moves_over_both(forces_n) {
            self.advance(0, forces_n[0], 0.0);
            self.advance(1, forces_n[1], 0.0);
        }
    }

    fn push(&mut self, span: usize, push: Push) {
        if push.curve != 0.0 {
            self.advance_audited::<2, NoAudit>(span, push, &mut NoAudit);
        } else if push.slope != 0.0 {
            self.advance_audited::<1, NoAudit>(span, push, &mut NoAudit);
        } else {
            self.advance_audited::<0, NoAudit>(span, push, &mut NoAudit);
        }
    }

    fn record(&mut self, forces_n: &mut dyn Iterator<Item = f64>, displacement_m: &mut Vec<f64>) {
        for force_n in forces_n {
            displacement_m.push(self.x[DISPLACEMENT]);
            self.advance_audited::<0, NoAudit>(0, Push::held(force_n), &mut NoAudit);
        }
    }

    fn state(&self, index: usize) -> f64 {
        self.x[index]
    }

    fn states(&self) -> &[f64] {
        &self.x
    }

    fn set_state(&mut self, state: &[f64]) {
        self.x = [0.0; N];
        self.x[..state.len().min(N)].copy_from_slice(&state[..state.len().min(N)]);
        self.pull = self.pull(&self.x);
        self.region = self.region_index(self.signs_of(&self.x));
    }

    fn set_rates(&mut self, rates: Option<&[f64]>) {
        self.rates = rates.map(|rates| {
            let mut padded = [0.0; N];
            let count = rates.len().min(N);
            padded[..count].copy_from_slice(&rates[..count]);
            padded
        });
        self.pull = self.pull(&self.x);
    }

    fn regions_built(&self) -> usize {
        self.regions.len()
    }
}
