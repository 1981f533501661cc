//! Sine of a phase accumulator, the same bits on every machine.
//!
//! A phase is a `u32`: 2^32 is one turn, wrapping is the period. Only integer folding, + and * are used; Rust never
//! fuses them, so the FPU of the board, the virtual board and the host agree bit for bit.

/// A quarter turn.
const QUARTER: i32 = 1 << 30;

/// Minimax coefficients of sin(pi/2 x) / x in x^2 on [0, 1], degree 4.
///
/// Computed 2026-11-21 as a linear programme (scipy highs) on 2001 Chebyshev points; the odd polynomial of degree 9 has an error of
/// 5e-9 in exact arithmetic. The second coefficient is one ulp below the nearest, so that no f32 result exceeds 1 and the
/// quarter turn gives 1 exactly. Evaluated in f32 the measured maximum error is 1.9e-7.
const COEFFICIENTS: [f32; 5] = [1.570_796_4, -0.645_964_15, 0.079_690_38, -0.004_673_931_7, 0.000_151_293_8];

/// sin(2 pi phase / 2^32), with an absolute error of at most 2.5e-7 and never beyond +-1.
#[inline]
pub fn sine_of_phase(phase: u32) -> f32 {
    let x = triangle_of_phase(phase);
    let square = x * x;
    let [c0, c1, c2, c3, c4] = COEFFICIENTS;
    ((((c4 * square + c3) * square + c2) * square + c1) * square + c0) * x
}

/// The triangle in step with the sine: 0, 1 at a quarter turn, 0, -1, exact up to the conversion to f32 (2^-24).
#[inline]
pub fn triangle_of_phase(phase: u32) -> f32 {
    // As a signed number the phase runs over -1/2 to 1/2 turn; beyond a quarter it is reflected: sin(pi - a) = sin(a).
    let angle = phase as i32;
    let folded = if (-QUARTER..=QUARTER).contains(&angle) { angle } else { i32::MIN.wrapping_sub(angle) };
    folded as f32 * (1.0 / QUARTER as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_is_within_its_error_on_a_dense_grid() {
        let mut worst = 0.0_f64;
        // 2^22 points: 256 per distinct step of the cubic term near the peak, every octant and both folds included.
        for i in 0..1_u32 << 22 {
            let phase = (i << 10) | (i >> 12);
            let exact = (core::f64::consts::TAU * f64::from(phase) / 4_294_967_296.0).sin();
            let value = sine_of_phase(phase);
            assert!(value.abs() <= 1.0, "{phase:#x}");
            worst = worst.max((f64::from(value) - exact).abs());
        }
        // Roundings: x 2^-24 relative, five products and four sums of shrinking terms, the last two 2^-24 of 1 each:
        // below 2.5e-7 together. Far better than 1e-7 would mean that the test does not test f32.
        assert!(worst < 2.5e-7 && worst > 1e-7, "{worst}");
    }

    #[test]
    fn no_value_exceeds_one() {
        // Every f32 that the folding can make in [1/2, 1], where its step is 2^-24: 64 units of phase.
        for phase in (1_u32 << 29..=1 << 30).step_by(64) {
            assert!(sine_of_phase(phase) <= 1.0, "{phase:#x}");
        }
    }

    #[test]
    fn quarter_turns_are_exact() {
        assert_eq!(sine_of_phase(0), 0.0);
        assert_eq!(sine_of_phase(1 << 30), 1.0);
        assert_eq!(sine_of_phase(1 << 31), 0.0);
        assert_eq!(sine_of_phase(3 << 30), -1.0);
        assert_eq!(triangle_of_phase(1 << 29), 0.5);
        assert_eq!(triangle_of_phase(3 << 29), 0.5);
        assert_eq!(triangle_of_phase(1 << 30), 1.0);
        assert_eq!(triangle_of_phase(3 << 30), -1.0);
    }

    #[test]
    fn half_a_turn_later_the_sign_is_opposite_bit_for_bit() {
        for i in 0..100_000_u32 {
            let phase = i.wrapping_mul(0x9e37_79b9);
            // At phase 0 and half a turn both are zero, and equal as numbers.
            assert_eq!(sine_of_phase(phase), -sine_of_phase(phase.wrapping_add(1 << 31)));
        }
    }
}
