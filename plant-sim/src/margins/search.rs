//! Roots and minima of a function of frequency that is already known on a grid.

/// Where in its argument a bracketed root or minimum is no longer improved, relative.
const ARGUMENT_TOLERANCE: f64 = 1e-15;

/// Grid points can be a rounding unit apart, and their values then in any order; values this close count as equal.
const VALUE_NOISE: f64 = 1e-12;

/// All roots of `f` that the grid can show: every change of sign, and every dip towards zero between grid points that do not change
/// sign, because two crossings close together hide in one step. `values` are `f` at `grid`; a dip that starts above `deepest_dip`
/// is not followed, because the grid is known to be finer than that.
pub(super) fn roots(f: impl Fn(f64) -> f64, grid: &[f64], values: &[f64], deepest_dip: f64) -> Vec<f64> {
    let mut found = Vec::new();
    for i in 1..grid.len() {
        let (left, right) = (values[i - 1], values[i]);
        if !left.is_finite() || !right.is_finite() {
            continue;
        }
        if left == 0.0 {
            found.push(grid[i - 1]);
        } else if left * right < 0.0 {
            found.push(bisect(&f, grid[i - 1], grid[i], left));
        }
        let Some(&next) = values.get(i + 1) else {
            continue;
        };
        let is_dip = left * right > 0.0
            && right * next > 0.0
            && right.abs() <= left.abs() + VALUE_NOISE
            && right.abs() <= next.abs() + VALUE_NOISE
            && right.abs() < deepest_dip;
        if is_dip {
            let sign = right.signum();
            let (bottom, depth) = minimise(|x| sign * f(x), grid[i - 1], grid[i + 1]);
            if depth < 0.0 {
                found.push(bisect(&f, grid[i - 1], bottom, left));
                found.push(bisect(&f, bottom, grid[i + 1], -right));
            }
        }
    }
    found
}

/// The place and value of the least value of `f`, from its values on the grid.
pub(super) fn least(f: impl Fn(f64) -> f64, grid: &[f64], values: &[f64]) -> (f64, f64) {
    let mut best = (f64::NAN, f64::INFINITY);
    for i in 0..grid.len() {
        if values[i] < best.1 {
            best = (grid[i], values[i]);
        }
        let is_local_minimum = i > 0
            && i + 1 < grid.len()
            && values[i] <= values[i - 1] + VALUE_NOISE
            && values[i] <= values[i + 1] + VALUE_NOISE;
        if is_local_minimum {
            let (place, value) = minimise(&f, grid[i - 1], grid[i + 1]);
            if value < best.1 {
                best = (place, value);
            }
        }
    }
    best
}

fn bisect(f: impl Fn(f64) -> f64, mut left: f64, mut right: f64, value_left: f64) -> f64 {
    while right - left > ARGUMENT_TOLERANCE * right {
        let middle = 0.5 * (left + right);
        if middle <= left || middle >= right {
            break;
        }
        if f(middle) * value_left > 0.0 {
            left = middle;
        } else {
            right = middle;
        }
    }
    0.5 * (left + right)
}

/// Golden section. The place of a minimum is only known to the square root of the rounding unit; its value to the unit itself.
fn minimise(f: impl Fn(f64) -> f64, left: f64, right: f64) -> (f64, f64) {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (left, right);
    let mut x1 = b - RATIO * (b - a);
    let mut x2 = a + RATIO * (b - a);
    let (mut f1, mut f2) = (f(x1), f(x2));
    // 60 steps shrink the bracket by 3e-13, well below the square root of the rounding unit.
    for _ in 0..60 {
        if f1 < f2 {
            (b, x2, f2) = (x2, x1, f1);
            x1 = b - RATIO * (b - a);
            f1 = f(x1);
        } else {
            (a, x1, f1) = (x1, x2, f2);
            x2 = a + RATIO * (b - a);
            f2 = f(x2);
        }
    }
    if f1 < f2 { (x1, f1) } else { (x2, f2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minimum_beside_two_nearly_equal_points_is_found() {
        // The least value lies right of a pair of points of which rounding makes the right one the larger.
        let f = |x: f64| (x - 1.2) * (x - 1.2);
        let grid = [0.0, 1.0, 1.0 + f64::EPSILON, 2.0];
        let values = [f(0.0), f(1.0) - 2e-16, f(1.0), f(2.0)];
        let (place, value) = least(f, &grid, &values);
        assert!((place - 1.2).abs() < 1e-7 && value < 1e-14, "{place} {value}");
    }

    #[test]
    fn two_crossings_within_one_step_are_both_found() {
        let f = |x: f64| (x - 1.1) * (x - 1.3);
        let grid = [0.5, 1.0, 1.5, 2.0];
        let values = grid.map(f);
        let found = roots(f, &grid, &values, 0.5);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[0] - 1.1).abs() < 1e-14 && (found[1] - 1.3).abs() < 1e-14, "{found:?}");
    }
}
