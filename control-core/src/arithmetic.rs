//! The few numeric helpers that the run-time path needs and `core` does not have.
//!
//! Only IEEE + - * and integer operations, so every machine gives the same bits. Nothing here branches on NaN.

/// A lower bound of the square root of `x`, 0 <= x < 1e37, at most 0.18 % below it.
///
/// The reciprocal root from the exponent trick (error e up to 3.44 %), then one Newton step y (3/2 - x y^2 / 2), which leaves
/// -3/2 e^2: 0.1752 %, never above the root. So a braking distance computed from this value errs to the safe side;
/// rounding (2^-22) is covered by the shaper's 1/64 reserve. A second step would cost four instructions in the interrupt and
/// gain a tenth of a per cent of braking.
#[inline(always)]
pub(crate) fn sqrt_below(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut inverse = f32::from_bits(0x5f37_59df - (x.to_bits() >> 1));
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
                // Above: four roundings of at most 2^-24 each. Below: 0.1752 % plus the same.
                assert!(ratio < 1.0 + 2.4e-7 && ratio > 1.0 - 1.753e-3, "{x} {ratio}");
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
        assert_eq!(between(f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY), f32::INFINITY);
    }
}
