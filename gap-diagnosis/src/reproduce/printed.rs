//! Printed numbers: their value, and how far another may be from them.

/// The value of a printed number such as `-1.0637e6`.
///
/// # Panics
/// If it is no number: printed numbers are constants of this module.
pub fn value(printed: &str) -> f64 {
    printed.parse().unwrap_or_else(|_| panic!("{printed:?} is no number"))
}

/// Half a unit of the last printed digit.
pub fn half_digit(printed: &str) -> f64 {
    let (digits, power) = printed.split_once(['e', 'E']).unwrap_or((printed, "0"));
    let decimals = digits.split_once('.').map_or(0, |(_, decimals)| decimals.len() as i32);
    0.5 * 10f64.powi(power.parse::<i32>().unwrap_or(0) - decimals)
}

/// Whether `ours` rounds to the printed number; a hair more, as a number may lie on the edge that its printing was rounded at.
pub fn agrees(printed: &str, ours: f64) -> bool {
    (ours - value(printed)).abs() <= half_digit(printed) * (1.0 + 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_counted_as_printed() {
        assert_eq!(half_digit("22017"), 0.5);
        assert_eq!(half_digit("2.422e7"), 0.5e4);
        assert!((half_digit("0.024") - 5e-4).abs() < 1e-18);
        assert!(agrees("45.64", 45.6356) && !agrees("45.64", 45.6349) && agrees("-0.20", -0.195));
        assert!(!agrees("22.072", f64::NAN));
    }
}
