//! How numbers are written on a page: four significant digits, a unit, and a dash where there is no number.

/// Writes `value` with four significant digits and its unit, e.g. `12.35 µm`; `–` when it is not finite.
///
/// Plain notation between 1e-4 and 1e5, `1.235×10⁻⁷` outside: an engineer reads both at a glance, a row of zeros he does not.
pub fn four_digits(value: f64, unit: &str) -> String {
    significant(value, 4, unit)
}

/// A standard deviation: two digits, because it is itself known to a tenth at best.
pub(super) fn two_digits(sigma: f64, unit: &str) -> String {
    significant(sigma, 2, unit)
}

/// A relative standard deviation in percent.
pub(super) fn percent_of_sigma(sigma: f64) -> String {
    two_digits(100.0 * sigma, "%")
}

fn significant(value: f64, n_digits: usize, unit: &str) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let number = plain_or_scientific(value, n_digits);
    match unit {
        "" => number,
        // "97.2 %" and "3 µm" take a space, degrees do not.
        "°" => format!("{number}°"),
        _ => format!("{number} {unit}"),
    }
}

/// A tick's or an edge's number: at most three significant digits, no zeros behind the point.
pub(super) fn three_digits(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let short = rounded(value, 3);
    let is_plain = short == 0.0 || (1e-3..1e5).contains(&short.abs());
    let text = if is_plain { short.to_string() } else { plain_or_scientific(short, 2) };
    text.replace('-', "−")
}

/// A share in percent: whole numbers above ten, two digits below, so that a small part is not called none.
pub(super) fn short_percent(percent: f64) -> String {
    match percent {
        _ if !percent.is_finite() => "–".to_owned(),
        _ if percent.abs() >= 9.95 || percent == 0.0 => format!("{percent:.0} %"),
        _ if percent.abs() >= 0.095 => format!("{percent:.1} %"),
        _ if percent.abs() >= 0.0095 => format!("{percent:.2} %"),
        _ => "<0.01 %".to_owned(),
    }
    .replace('-', "−")
}

/// Rounds to `n_digits` significant digits, so that JSON carries what a plot can show and no more.
pub(super) fn rounded(value: f64, n_digits: usize) -> f64 {
    if !value.is_finite() {
        return f64::NAN;
    }
    format!("{value:.*e}", n_digits - 1).parse().unwrap_or(f64::NAN)
}

/// A count with its thousands set apart by thin spaces that do not break.
pub(super) fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

fn plain_or_scientific(value: f64, n_digits: usize) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    // Rust's own formatter rounds; its exponent is the one after rounding (9.9999 becomes 1.000e1).
    let scientific = format!("{value:.*e}", n_digits - 1);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let text = if (-4..5).contains(&exponent) {
        let decimals = usize::try_from(n_digits as i32 - 1 - exponent).unwrap_or(0);
        format!("{value:.decimals$}")
    } else {
        format!("{mantissa}×10{}", superscript(exponent))
    };
    text.replace('-', "−")
}

fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    exponent.to_string().chars().map(|letter| letter.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_digits_and_the_unit() {
        for (value, unit, expected) in [
            (12.3456, "µm", "12.35 µm"),
            (-0.0, "V", "0 V"),
            (-3.0, "V", "−3.000 V"),
            (9999.96, "", "10000"),
            (0.000_123_45, "", "0.0001234"),
            (1.2346e-7, "m", "1.235×10⁻⁷ m"),
            (250_000.0, "N/m", "2.500×10⁵ N/m"),
            (2e12, "N/m", "2.000×10¹² N/m"),
            (45.0, "°", "45.00°"),
            (f64::NAN, "V", "–"),
            (f64::NEG_INFINITY, "V", "–"),
        ] {
            assert_eq!(four_digits(value, unit), expected);
        }
    }

    #[test]
    fn sigmas_have_two_digits() {
        assert_eq!(percent_of_sigma(0.0012), "0.12 %");
        assert_eq!(percent_of_sigma(0.413), "41 %");
        assert_eq!(percent_of_sigma(f64::NAN), "–");
    }

    #[test]
    fn ticks_and_shares_are_short() {
        assert_eq!(
            [0.0, -25.0, 376.99, 0.1254, 2.0, 38_000.0, 1.2e6, -4e-5].map(three_digits),
            ["0", "−25", "377", "0.125", "2", "38000", "1.2×10⁶", "−4.0×10⁻⁵"]
        );
        assert_eq!(
            [0.0, 99.6, 12.34, 3.21, 0.04, 1e-9].map(short_percent),
            ["0 %", "100 %", "12 %", "3.2 %", "0.04 %", "<0.01 %"]
        );
    }

    #[test]
    fn counts_are_grouped() {
        assert_eq!(count(7), "7");
        assert_eq!(count(123), "123");
        assert_eq!(count(3_000_000), "3\u{202f}000\u{202f}000");
    }

    #[test]
    fn rounding_keeps_the_significant_digits() {
        assert_eq!(rounded(std::f64::consts::PI, 7).to_string(), "3.141593");
        assert_eq!(rounded(-1.0e-9 / 3.0, 7), -3.333333e-10);
        assert!(rounded(f64::INFINITY, 7).is_nan());
    }
}
