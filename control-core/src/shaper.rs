//! Reference shaping: clamp, bounded rate, bounded acceleration.
//!
//! For every input, with T = 1 / rate_hz, r the output and "ulp" the f32 spacing at the clamp (7.3e-12 at 100e-6):
//!
//! - abs(r_k) <= clamp, exactly;
//! - abs(r_k - r_{k-1}) <= rate T + ulp;
//! - abs(r_k - 2 r_{k-1} + r_{k-2}) <= acceleration T^2 + 2 ulp.
//!
//! The position keeps its rounding remainder, so the ulps are those of printing r, they never add up.
//!
//! **How.** Velocities are per sample: v_k = r_k - r_{k-1}, vmax = rate T, a = acceleration T^2. Braking from v by a
//! each sample travels B(v) = sum of max(0, v - j a), j = 1, 2, ...; B(v) <= (v - a/2)^2 / (2 a), and B(v) = 0 up to v = a.
//! A move v' over a free distance d is safe when v' + B(v') <= d, which holds when
//!
//! ```text
//! v' <= f(d) = d                        for d <= a
//!              sqrt(2 a d) - a/2        beyond
//! ```
//!
//! From a safe v, braking (v' = v - a) is safe again. So the interval [v - a, v + a] always meets
//! [-vmax, vmax] and [-f(clamp + r), f(clamp - r)], and the move is the point of that intersection nearest to the wish.
//!
//! **The wish.** A target within reach is taken exactly, bit for bit and without lag. Otherwise the shaper catches up:
//! it moves with the target's own velocity plus f(distance), so that it arrives with the target's velocity. A jump of the target
//! (more than vmax in a sample) is not a velocity. A standing target is reached from rest without overshoot beyond one
//! ulp, within 2 % and four samples of the bang-bang time (the planning uses 63/64 of a, a reserve against rounding, and a
//! square root that is up to 0.18 % low).
//!
//! **Passing unchanged.** Once caught up, a reference passes unchanged as long as it stays within the rate, within
//! 63/64 of the acceleration, and turns back at least a/8 before the clamp (or moves there no faster than a).
//!
//! The numbers are metres when [`crate::Law`] uses this; the shaper itself is unit-free and serves a drive in volts as well.

use crate::arithmetic::{between, sqrt_below};
use crate::limits::Limits;
use crate::settings::{SettingsError, above_zero, finite_above_zero};

/// Share of the acceleration that braking is planned with.
///
/// The missing 1/64 absorbs the rounding of position and velocity.
const PLANNED_SHARE: f32 = 63.0 / 64.0;

/// The bounds, per sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaper {
    /// Greatest magnitude; the greatest f32 when there is no clamp.
    clamp: f32,
    /// vmax.
    rate_per_sample: f32,
    /// a.
    acceleration_per_sample2: f32,
    /// 2 times the planned a, ready for braking distances.
    twice_planned: f32,
    /// Half the planned a.
    half_planned: f32,
    /// False when only the clamp acts.
    shapes: bool,
}

/// Where the shaped reference is.
#[derive(Clone, Copy, Debug)]
pub struct ShaperState {
    /// r, the last output.
    reference: f32,
    /// v, if the last output was exactly the target; NaN otherwise, and then `pursuit` holds. NaN fails the first
    /// comparison of the common path, which so has to read and write no more than these two numbers.
    followed_velocity: f32,
    /// How the pursuit of the target stands; meaningless while the target is being followed exactly.
    pursuit: Pursuit,
}

/// What is known beyond r while the reference is not the target.
#[derive(Clone, Copy, Debug)]
struct Pursuit {
    /// v, the last move.
    velocity: f32,
    /// What rounding took from r.
    remainder: f32,
    /// Target minus reference after the last step.
    lag: f32,
}

impl Default for ShaperState {
    fn default() -> Self {
        ShaperState::at(0.0)
    }
}

impl ShaperState {
    /// At rest at `reference`.
    pub fn at(reference: f32) -> ShaperState {
        ShaperState { reference, followed_velocity: 0.0, pursuit: Pursuit { velocity: 0.0, remainder: 0.0, lag: 0.0 } }
    }

    /// The last output.
    pub fn reference(&self) -> f32 {
        self.reference
    }

    /// At rest where it is.
    pub(crate) fn halt(&mut self) {
        *self = ShaperState::at(self.reference);
    }

    /// Expresses the velocity in another sampling period: `ratio` is the old rate over the new rate.
    pub(crate) fn rescale(&mut self, ratio: f32) {
        self.followed_velocity *= ratio;
        self.pursuit.velocity *= ratio;
    }
}

impl Shaper {
    /// Bounds in physical units: clamp (unit), rate (unit/s), acceleration (unit/s^2); infinity means unbounded.
    ///
    /// # Errors
    ///
    /// NaN, zero or negative numbers; a bounded rate or acceleration without a clamp ([`SettingsError::ShapingWithoutClamp`]);
    /// an acceleration below rate / (65536 T), with which f32 could not brake ([`SettingsError::AccelerationTooSmall`]).
    /// The errors name the fields of [`crate::Settings`].
    pub fn try_build(
        rate_hz: f32,
        clamp: f32,
        rate_per_s: f32,
        acceleration_per_s2: f32,
    ) -> Result<Shaper, SettingsError> {
        finite_above_zero("rate_hz", rate_hz)?;
        above_zero("reference_max_m", clamp)?;
        let rate = rate_per_s / rate_hz;
        let acceleration = acceleration_per_s2 / rate_hz / rate_hz;
        above_zero("reference_rate_m_per_s", rate)?;
        above_zero("reference_acceleration_m_per_s2", acceleration)?;
        let shapes = rate.is_finite() || acceleration.is_finite();
        if shapes {
            if clamp.is_infinite() {
                return Err(SettingsError::ShapingWithoutClamp);
            }
            // Squares of the clamp must stay far inside f32.
            if clamp > 1e9 {
                return Err(SettingsError::TooLarge { field: "reference_max_m", at_most: 1_000_000_000 });
            }
        }
        // Inside the clamp no move is longer than 2 clamp and no change of move greater than 4 clamp, so these finite
        // numbers mean "unbounded" and keep infinity out of the arithmetic.
        let rate = rate.min(2.0 * clamp);
        let acceleration = acceleration.min(4.0 * clamp);
        if shapes && acceleration < rate * (1.0 / 65536.0) {
            return Err(SettingsError::AccelerationTooSmall);
        }
        let planned = acceleration * PLANNED_SHARE;
        Ok(Shaper {
            clamp: clamp.min(f32::MAX),
            rate_per_sample: rate,
            acceleration_per_sample2: acceleration,
            twice_planned: 2.0 * planned,
            half_planned: 0.5 * planned,
            shapes,
        })
    }

    /// One sample: the reference to use for the wish, and what held it back. A NaN wish is no wish: the target is then
    /// the reference already reached.
    #[inline]
    pub fn step(&self, state: &mut ShaperState, wish: f32) -> (f32, Limits) {
        if self.holds(wish) { self.follow(state, wish, Limits::NONE) } else { self.follow_clamped(state, wish) }
    }

    /// Whether more than the clamp acts. What an unshaped state says of velocity is out of date: it has to be halted before it is shaped.
    pub(crate) fn shapes(&self) -> bool {
        self.shapes
    }

    /// Whether the wish is a number inside the clamp.
    #[inline(always)]
    pub(crate) fn holds(&self, wish: f32) -> bool {
        wish.abs() <= self.clamp
    }

    /// A wish beyond the clamp, brought back to it.
    #[inline(always)]
    pub(crate) fn clamped(&self, wish: f32) -> f32 {
        with_sign(self.clamp, wish)
    }

    /// The wish lies beyond the clamp, or is no number.
    #[cold]
    fn follow_clamped(&self, state: &mut ShaperState, wish: f32) -> (f32, Limits) {
        let target = if wish.is_nan() { state.reference } else { self.clamped(wish) };
        self.follow(state, target, Limits::REFERENCE_CLAMP)
    }

    /// One sample towards a target inside the clamp. Unshaped it keeps no velocity, see [`Shaper::shapes`].
    #[inline(always)]
    pub(crate) fn follow(&self, state: &mut ShaperState, target: f32, limits: Limits) -> (f32, Limits) {
        if !self.shapes {
            state.reference = target;
            return (target, limits);
        }
        // The common case, decided by three comparisons: the last target was met exactly, this one is an allowed move
        // away, and it leaves room to brake whichever way it goes. Anything else, and every doubt, goes to `catch_up`,
        // which gives the same result when the target turns out to be allowed.
        let step = target - state.reference;
        let room = self.clamp - target.abs();
        let excess = step.abs() - self.half_planned;
        if (step - state.followed_velocity).abs() <= self.acceleration_per_sample2
            && step.abs() <= self.rate_per_sample
            && excess * excess <= self.twice_planned * room
        {
            state.reference = target;
            state.followed_velocity = step;
            return (target, limits);
        }
        self.catch_up(state, target, limits)
    }

    /// The general move: see the module's text.
    #[inline(never)]
    fn catch_up(&self, state: &mut ShaperState, target: f32, limits: Limits) -> (f32, Limits) {
        // Two roads and not one with selected numbers, which costs more.
        let Pursuit { velocity: last_velocity, remainder, lag } = if state.followed_velocity.is_nan() {
            core::hint::cold_path();
            state.pursuit
        } else {
            Pursuit { velocity: state.followed_velocity, remainder: 0.0, lag: 0.0 }
        };
        let step = target - state.reference;
        let target_move = step - lag;
        let target_velocity = if target_move.abs() > self.rate_per_sample { 0.0 } else { target_move };
        let distance = step - target_velocity;
        let wish = if distance.abs() <= self.acceleration_per_sample2 {
            step
        } else {
            target_velocity + with_sign(self.approach_from_afar(distance.abs()), distance)
        };

        // Rate and clamp bound the speed in the direction of the wish; the acceleration bounds the velocity, and goes last,
        // because braking fully is always allowed.
        let sign = if wish < 0.0 { -1.0 } else { 1.0 };
        let room = self.clamp - sign * state.reference;
        let speed = lesser(lesser(wish.abs(), self.rate_per_sample), self.approach(room));
        let velocity = between(
            sign * speed,
            last_velocity - self.acceleration_per_sample2,
            last_velocity + self.acceleration_per_sample2,
        );

        if velocity == step {
            state.reference = target;
            state.followed_velocity = step;
            return (target, limits);
        }
        // Fast2Sum: what the sum rounds away is kept for the next sample.
        let advance = velocity + remainder;
        let moved = state.reference + advance;
        let remainder = advance - (moved - state.reference);
        // Only rounding can bring this beyond the clamp.
        let reference = if self.holds(moved) { moved } else { with_sign(self.clamp, moved) };
        *state = ShaperState {
            reference,
            followed_velocity: f32::NAN,
            pursuit: Pursuit { velocity, remainder, lag: target - reference },
        };
        let reason = if reference == target {
            Limits::NONE
        } else if velocity.abs() >= self.rate_per_sample {
            Limits::REFERENCE_RATE
        } else {
            Limits::REFERENCE_ACCELERATION
        };
        (reference, limits | reason)
    }

    /// f(d): the greatest move from which braking ends within `distance`.
    #[inline(always)]
    fn approach(&self, distance: f32) -> f32 {
        if distance <= 2.0 * self.half_planned { distance } else { self.approach_from_afar(distance) }
    }

    /// f(d) where the distance is known to be beyond a.
    #[inline(always)]
    fn approach_from_afar(&self, distance: f32) -> f32 {
        sqrt_below(self.twice_planned * distance) - self.half_planned
    }
}

/// `value`, reversed if `direction` is negative.
#[inline(always)]
fn with_sign(value: f32, direction: f32) -> f32 {
    if direction < 0.0 { -value } else { value }
}

/// The lesser of two numbers that are none of them NaN; `f32::min` costs more, because it has to know about NaN.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLAMP_M: f32 = 100e-6;

    fn shaper(rate_hz: f32, rate: f32, acceleration: f32) -> Shaper {
        Shaper::try_build(rate_hz, CLAMP_M, rate, acceleration).expect("sound numbers")
    }

    #[test]
    fn unshaped_passes_bit_for_bit_and_clamps() {
        let shaper = shaper(20e3, f32::INFINITY, f32::INFINITY);
        let mut state = ShaperState::default();
        for wish in [0.0, 1e-6, -99.99e-6, 1e-45, -0.0, 100e-6] {
            let (reference, limits) = shaper.step(&mut state, wish);
            assert_eq!(reference.to_bits(), wish.to_bits());
            assert!(limits.is_empty());
        }
        assert_eq!(shaper.step(&mut state, f32::INFINITY), (CLAMP_M, Limits::REFERENCE_CLAMP));
        assert_eq!(shaper.step(&mut state, -1.0), (-CLAMP_M, Limits::REFERENCE_CLAMP));
        assert_eq!(shaper.step(&mut state, f32::NAN), (-CLAMP_M, Limits::REFERENCE_CLAMP));
        let free = Shaper::try_build(1e6, f32::INFINITY, f32::INFINITY, f32::INFINITY);
        let free = free.expect("no bounds at all");
        for wish in [f32::MAX, f32::MIN, 3.3e38, -3.3e38] {
            assert_eq!(free.step(&mut state, wish), (wish, Limits::NONE));
        }
    }

    #[test]
    fn a_rate_alone_makes_a_straight_ramp() {
        // 0.1 m/s at 20 kHz: 5 um per sample.
        let shaper = shaper(20e3, 0.1, f32::INFINITY);
        let mut state = ShaperState::default();
        for sample in 1..=16 {
            let (reference, limits) = shaper.step(&mut state, 80e-6);
            // One rounding of at most half an ulp (3.7e-12) per sample, kept small by the remainder.
            assert!((reference - sample as f32 * 5e-6).abs() < 8e-12, "{sample} {reference}");
            assert_eq!(limits.is_empty(), sample == 16, "{sample}");
        }
        assert_eq!(shaper.step(&mut state, 80e-6), (80e-6, Limits::NONE));
    }

    #[test]
    fn a_step_is_nearly_time_optimal_and_does_not_overshoot() {
        for (rate_hz, rate, acceleration, distance) in [
            (20e3_f32, 1.0_f32, 200.0_f32, 80e-6_f32),
            (20e3, 0.05, 200.0, 80e-6),
            (40e3, 0.05, 1000.0, 100e-6),
            (1e6, 1.0, 200.0, 80e-6),
            (20e3, 1.0, 2.0, 1e-6),
        ] {
            let shaper = shaper(rate_hz, rate, acceleration);
            let mut state = ShaperState::default();
            let mut samples = 0;
            loop {
                let (reference, _) = shaper.step(&mut state, distance);
                assert!(reference <= distance * (1.0 + f32::EPSILON));
                samples += 1;
                if reference == distance {
                    break;
                }
                assert!(samples < 1_000_000);
            }
            // Bang-bang: accelerate to the peak (or to the rate), coast, brake.
            let (d, v, a) = (f64::from(distance), f64::from(rate), f64::from(acceleration));
            let peak = (d * a).sqrt().min(v);
            let optimal_s = d / peak + peak / a;
            let optimal = optimal_s * f64::from(rate_hz);
            // Braking at 63/64 of a with a root up to 0.18 % low: 98.1 % of a, so braking, half of the time, grows by 2 %; rounding up to whole samples and the
            // conservative f cost a few samples at the start, the peak and the end.
            assert!(f64::from(samples) <= optimal * 1.02 + 4.0, "{samples} samples, bang-bang {optimal}");
            assert!(f64::from(samples) >= optimal - 1.0, "faster than possible: {samples} {optimal}");
            assert_eq!(shaper.step(&mut state, distance), (distance, Limits::NONE));
        }
    }

    #[test]
    fn a_sine_inside_the_bounds_passes_unchanged_once_caught_up() {
        // 99 um at 100 Hz: 0.0622 m/s and 39.1 m/s^2, inside the bounds; the start at full speed is not.
        let shaper = shaper(20e3, 0.1, 60.0);
        let mut state = ShaperState::default();
        for sample in 0..20_000_u32 {
            let phase = core::f64::consts::TAU * 100.0 * f64::from(sample) / 20e3;
            let wish = (99e-6 * phase.sin()) as f32;
            let (reference, limits) = shaper.step(&mut state, wish);
            // Half a second is fifty periods; catching up takes less than one.
            if sample > 400 {
                assert_eq!(reference.to_bits(), wish.to_bits(), "{sample}");
                assert!(limits.is_empty(), "{sample} {limits}");
            }
        }
    }

    #[test]
    fn wrong_bounds_are_refused() {
        let build = Shaper::try_build;
        assert_eq!(build(20e3, f32::INFINITY, 1.0, f32::INFINITY), Err(SettingsError::ShapingWithoutClamp));
        assert_eq!(build(20e3, 1e-4, 1.0, 0.1), Err(SettingsError::AccelerationTooSmall));
        assert_eq!(
            build(20e3, 1e-4, f32::NAN, 0.1),
            Err(SettingsError::NotPositive { field: "reference_rate_m_per_s" })
        );
        assert_eq!(
            build(20e3, 1e10, 1.0, f32::INFINITY),
            Err(SettingsError::TooLarge { field: "reference_max_m", at_most: 1_000_000_000 })
        );
    }
}
