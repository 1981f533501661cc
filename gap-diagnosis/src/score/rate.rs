//! Shares with their Wilson intervals, and medians.

use serde::Serialize;

/// Quantile of the normal distribution for a two-sided interval of 95 %.
const Z_95: f64 = 1.959_964;

/// A share of cases with its 95 % interval by Wilson, which keeps its meaning near 0 and 1 and for few cases.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rate {
    /// Cases in which it was so.
    pub hits: usize,
    /// Cases that were asked.
    pub of: usize,
    /// `hits / of`; NaN (null in JSON) where nothing was asked.
    pub share: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Rate {
    /// `hits` of `of`.
    pub fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Self { hits, of, share: f64::NAN, low: 0.0, high: 1.0 };
        }
        let (n, z2) = (of as f64, Z_95 * Z_95);
        let share = hits as f64 / n;
        let centre = (share + z2 / (2.0 * n)) / (1.0 + z2 / n);
        let half = Z_95 / (1.0 + z2 / n) * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt();
        // At the ends the formula gives 0 and 1 but for rounding.
        let low = if hits == 0 { 0.0 } else { centre - half };
        let high = if hits == of { 1.0 } else { centre + half };
        Self { hits, of, share, low, high }
    }

    /// Share of `items` for which `is_so` holds.
    pub fn count<T>(items: impl IntoIterator<Item = T>, is_so: impl Fn(T) -> bool) -> Self {
        let (hits, of) = items.into_iter().fold((0, 0), |(hits, of), item| (hits + usize::from(is_so(item)), of + 1));
        Self::new(hits, of)
    }
}

/// Middle value of the finite ones; NaN without any.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut finite: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    finite.sort_by(f64::total_cmp);
    match finite.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => finite[n / 2],
        n => 0.5 * (finite[n / 2 - 1] + finite[n / 2]),
    }
}

/// Mean; NaN without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, n) = values.into_iter().fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    if n == 0 { f64::NAN } else { sum / f64::from(n) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_is_what_the_books_say() {
        // 81 of 263: (0.2553, 0.3662), Newcombe (1998), table I, method 3.
        let rate = Rate::new(81, 263);
        assert!((rate.low - 0.2553).abs() < 5e-5 && (rate.high - 0.3662).abs() < 5e-5, "{rate:?}");
        // 0 of 20: (0, 0.1611), the same table; and by mirror 20 of 20.
        let (none, all) = (Rate::new(0, 20), Rate::new(20, 20));
        assert!(none.low == 0.0 && (none.high - 0.1611).abs() < 5e-5, "{none:?}");
        assert!((all.low - 0.8389).abs() < 5e-5 && all.high == 1.0, "{all:?}");
        assert_eq!((Rate::new(0, 5).low, Rate::new(7, 7).high), (0.0, 1.0));
        assert!(Rate::new(0, 0).share.is_nan());
    }

    #[test]
    fn middles() {
        assert_eq!(median([3.0, f64::NAN, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0]), 2.5);
        assert!(median([]).is_nan() && mean([]).is_nan());
        assert_eq!(mean([1.0, 2.0, 6.0]), 3.0);
    }
}
