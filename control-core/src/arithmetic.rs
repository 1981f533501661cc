//! The few numeric helpers that the run-time path needs and `core` does not have.
//!
//! Only IEEE + - * and integer operations, so every machine gives the same bits. Nothing here branches on NaN.

/// A lower bound of the square root of `x`, 0 <= x < 1e37, at most 5e-6 (relative) below it.
///
/// The reciprocal root from the exponent trick (error 3.5 %), then two Newton steps y (3/2 - x y^2 / 2), each of which
/// leaves 3/2 of the error's square: 0.175 %, 4.7e-6. A Newton step never lands above the root (the error is
/// -3/2 e^2), so a braking distance computed from this value errs to the safe side; rounding (2^-22) is
/// covered by the shaper's 1/64 reserve.
#[inline(always)]
pub(crate) fn sqrt_below(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut inverse = f32::from_bits(0x5f37_59df - (x.to_bits() >> 1));
    inverse *= 1.5 - half * inverse * inverse;
    inverse *= 1.5 - half * inverse * inverse;
    x * inverse
}

/// `x` moved into `[low, high]`; a NaN `x` stays NaN, and `low > high` gives `high`.
///
/// `f32::clamp` is not used because it panics when `low > high`.
#[inline(always)]
pub(crate) fn between(x: f32, low: f32, high: f32) -> f32 {
    let raised = if x < low { low } else { x };
    if raised > high { high } else { raised }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_is_a_tight_lower_bound() {
        // 1e5 points per pair of binades cover the trick's period of two binades; scales from subnormal products to 1e36.
        for scale in [1e-30_f32, 1e-12, 1e-4, 1.0, 1e10, 1e36] {
            for i in 0..100_000 {
                let x = scale * (1.0 + 3.0 * i as f32 / 100_000.0);
                let ratio = f64::from(sqrt_below(x)) / f64::from(x).sqrt();
                // Above: four roundings of at most 2^-24 each. Below: 4.7e-6 plus the same.
                assert!(ratio < 1.0 + 2.4e-7 && ratio > 1.0 - 5e-6, "{x} {ratio}");
            }
        }
        assert_eq!(sqrt_below(0.0), 0.0);
    }

    #[test]
    fn between_keeps_nan_and_never_panics() {
        assert_eq!(between(5.0, -1.0, 1.0), 1.0);
        assert_eq!(between(-5.0, -1.0, 1.0), -1.0);
        assert_eq!(between(0.5, 1.0, -1.0), -1.0);
        assert!(between(f32::NAN, -1.0, 1.0).is_nan());
        assert_eq!(
            between(f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY),
            f32::INFINITY
        );
    }
}
