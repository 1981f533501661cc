//! Compass search: the least value of a function of a few logarithms, without derivatives and without chance.

/// First step in natural logarithms: a factor of 7, because multipliers may lie decades away.
const FIRST_STEP: f64 = 2.0;
/// Steps below this (0.5 %) change no verdict.
const LAST_STEP: f64 = 5e-3;

/// Starts at `start` and walks along the axes while that lowers `value`, halving the step otherwise; what is not finite is no progress.
pub(super) fn compass(start: &[f64], value: impl Fn(&[f64]) -> f64) -> (Vec<f64>, f64) {
    let mut at = start.to_vec();
    let mut least = value(&at);
    let mut step = FIRST_STEP;
    while step > LAST_STEP {
        let mut moved = false;
        for axis in 0..at.len() {
            for sign in [1.0, -1.0] {
                let before = at[axis];
                at[axis] = before + sign * step;
                let here = value(&at);
                if here < least || (least.is_nan() && !here.is_nan()) {
                    least = here;
                    moved = true;
                    break;
                }
                at[axis] = before;
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    (at, least)
}
