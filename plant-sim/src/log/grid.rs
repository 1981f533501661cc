//! Is the time of a log uniform? Checked row by row, in constant memory.
//!
//! A grid starts at the first row and has one interval `dt`. Row k puts `dt` into
//! `[(t_k - t_0 - tol) / k, (t_k - t_0 + tol) / k]`; the log is uniform while the intersection over all rows is not
//! empty. That is the check of every row against the fitted grid, without keeping the rows. The grid may tilt within
//! the tolerance of the others, so a single outlier passes below one `tol` and is refused from two on.
//!
//! `tol` is 1 % of a sample plus the rounding of both printed times. Two intersections are kept: with the rounding,
//! whose end is an error, and without it. As long as the second one lives the print is fine enough to show a lost
//! row for what it is, even when one unit of the last digit is a whole sample (integer milliseconds at 1 kHz).

use std::path::Path;

use super::error::{LogError, Place};

/// Allowed distance from the grid, in samples.
const JITTER_SAMPLES: f64 = 0.01;

/// How exactly a time is known, from the way it is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TimePrint {
    /// As decimal text: digits after the point (after applying an exponent, in seconds) and significant digits.
    Text { decimals: i32, digits: i32 },
    /// As a binary number with this relative spacing.
    Binary { epsilon: f64 },
}

impl TimePrint {
    /// What the text of a number says about its resolution; `exponent` is the unit's power of ten.
    pub(crate) fn of_text(text: &str, exponent: i32) -> Self {
        let (mantissa, printed_exponent) = match text.split_once(['e', 'E']) {
            Some((mantissa, text)) => (mantissa, text.parse().unwrap_or(0)),
            None => (text, 0i32),
        };
        let (mut decimals, mut digits, mut after_point) = (0i32, 0i32, false);
        for byte in mantissa.bytes() {
            if byte == b'.' {
                after_point = true;
            } else if byte.is_ascii_digit() {
                decimals += i32::from(after_point);
                // Leading zeros are not significant, trailing ones are.
                digits += i32::from(digits > 0 || byte != b'0');
            }
        }
        Self::Text { decimals: decimals.saturating_sub(printed_exponent).saturating_sub(exponent), digits }
    }
}

/// The check, and the fit of the interval.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    nominal_s: f64,
    /// Several samples to one unit of the printed time.
    coarse: bool,
    n: u64,
    first_s: f64,
    last_s: f64,
    max_decimals: i32,
    max_digits: i32,
    epsilon: f64,
    /// Intervals that fit all rows so far, ignoring the rounding of the print. Empty once it matters.
    exact_s: (f64, f64),
    /// The same with the rounding.
    rounded_s: (f64, f64),
}

impl Grid {
    /// A grid whose interval is about the usual step of the first rows, or `None` if time stands still there.
    ///
    /// The median step is untouched by a few lost rows. Where the print is so coarse that most steps read zero,
    /// the mean is taken.
    pub(crate) fn new(times_s: &[f64], prints: &[TimePrint]) -> Option<Self> {
        let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps_s.sort_by(f64::total_cmp);
        let median_s = steps_s.get(steps_s.len() / 2).copied()?;
        let (first_s, last_s) = (*times_s.first()?, *times_s.last()?);
        let mean_s = (last_s - first_s) / steps_s.len() as f64;
        let coarse = median_s <= 0.0;
        let nominal_s = if coarse { mean_s } else { median_s };
        // An interval that is not a normal number, or that the time cannot resolve, is no interval.
        if !(nominal_s.is_normal() && nominal_s > 0.0 && super::column::is_rate(nominal_s.recip())) {
            return None;
        }
        let mut grid = Self {
            nominal_s,
            coarse,
            n: 0,
            first_s,
            last_s: first_s,
            max_decimals: i32::MIN,
            max_digits: 0,
            epsilon: f64::EPSILON,
            // A print in which most times repeat is no exact one.
            exact_s: (0.0, if coarse { -1.0 } else { f64::INFINITY }),
            rounded_s: (0.0, f64::INFINITY),
        };
        // One row alone does not show the print: "0.0" may come from a printer of 17 digits.
        for print in prints {
            grid.observe(*print);
        }
        Some(grid)
    }

    fn observe(&mut self, print: TimePrint) {
        match print {
            TimePrint::Text { decimals, digits } => {
                self.max_decimals = self.max_decimals.max(decimals);
                self.max_digits = self.max_digits.max(digits);
            }
            TimePrint::Binary { epsilon } => self.epsilon = epsilon,
        }
    }

    /// Half a unit of the last printed digit at this time, seconds.
    ///
    /// A printer keeps either the decimals or the significant digits (`%g`); the coarser of the two is taken.
    fn half_unit_s(&self, time_s: f64) -> f64 {
        if self.max_decimals == i32::MIN {
            return 0.0;
        }
        let of_decimals = -self.max_decimals;
        let of_digits =
            if time_s == 0.0 { i32::MIN } else { time_s.abs().log10().floor() as i32 + 1 - self.max_digits };
        0.5 * 10f64.powi(of_decimals.max(of_digits))
    }

    /// Takes the next row.
    ///
    /// # Errors
    /// [`LogError::TimeNotIncreasing`], [`LogError::LostRows`] or [`LogError::NotUniform`].
    pub(crate) fn push(&mut self, path: &Path, place: Place, time_s: f64, print: TimePrint) -> Result<(), LogError> {
        self.observe(print);
        let k = self.n;
        self.n += 1;
        if k == 0 {
            return Ok(());
        }
        let from_s = std::mem::replace(&mut self.last_s, time_s);
        let step_s = time_s - from_s;
        let rounding_s = self.half_unit_s(self.first_s) + self.half_unit_s(time_s);
        // The numbers themselves are binary: four units in the last place cover both and the subtraction.
        let ulps_s = 4.0 * self.epsilon * time_s.abs().max(self.first_s.abs());
        let exact = self.exact_s.0 <= self.exact_s.1;

        let coarse = self.coarse || (!exact && rounding_s >= self.nominal_s);
        if step_s < 0.0 || (step_s == 0.0 && !coarse) {
            return Err(LogError::TimeNotIncreasing { path: path.to_path_buf(), place, from_s, to_s: time_s });
        }
        let slack_s = if exact { 0.0 } else { 2.0 * self.half_unit_s(time_s) };
        if step_s > 1.5 * self.nominal_s + slack_s {
            // A jump of 10^19 samples is not a number of rows any more, but `as` saturates.
            let n_missing = ((step_s / self.nominal_s).round() as u64).saturating_sub(1).max(1);
            return Err(LogError::LostRows {
                path: path.to_path_buf(),
                place,
                row: k,
                n_missing,
                from_s,
                to_s: time_s,
            });
        }
        let samples = k as f64;
        let elapsed_s = time_s - self.first_s;
        let narrowed = |(low, high): (f64, f64), tolerance_s: f64| {
            (low.max((elapsed_s - tolerance_s) / samples), high.min((elapsed_s + tolerance_s) / samples))
        };
        let tolerance_s = JITTER_SAMPLES * self.nominal_s + ulps_s;
        if exact {
            self.exact_s = narrowed(self.exact_s, tolerance_s);
        }
        let before_s = self.rounded_s;
        self.rounded_s = narrowed(before_s, tolerance_s + rounding_s);
        if self.rounded_s.0 > self.rounded_s.1 {
            // At the first row there is no grid yet but the usual step.
            let interval_s = if before_s.1.is_finite() { 0.5 * (before_s.0 + before_s.1) } else { self.nominal_s };
            return Err(LogError::NotUniform {
                path: path.to_path_buf(),
                place,
                time_s,
                deviation_percent: 100.0 * (elapsed_s - samples * interval_s).abs() / interval_s,
            });
        }
        Ok(())
    }

    /// The interval: `1 / rate_hz` where every row agrees with that rate, else from the first and the last time.
    pub(crate) fn interval_s(&self, rate_hz: Option<f64>) -> f64 {
        let (low_s, high_s) = if self.exact_s.0 <= self.exact_s.1 { self.exact_s } else { self.rounded_s };
        match rate_hz.map(f64::recip) {
            Some(interval_s) if low_s <= interval_s && interval_s <= high_s => interval_s,
            _ if self.n > 1 => (self.last_s - self.first_s) / (self.n - 1) as f64,
            _ => self.nominal_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pushes times printed by `print`, as the reader would.
    fn check(texts: &[String]) -> Result<Grid, LogError> {
        let rows: Vec<(f64, TimePrint)> =
            texts.iter().map(|text| (text.parse().expect("a number"), TimePrint::of_text(text, 0))).collect();
        let n = rows.len().min(super::super::LOOK_AHEAD);
        let times_s: Vec<f64> = rows[..n].iter().map(|row| row.0).collect();
        let prints: Vec<TimePrint> = rows[..n].iter().map(|row| row.1).collect();
        let mut grid = Grid::new(&times_s, &prints).expect("time moves");
        for (k, (time_s, print)) in rows.into_iter().enumerate() {
            grid.push(Path::new("x.csv"), Place::Line(k as u64 + 2), time_s, print)?;
        }
        Ok(grid)
    }

    fn print(rate_hz: f64, n: usize, text: impl Fn(f64) -> String) -> Vec<String> {
        (0..n).map(|k| text(k as f64 / rate_hz)).collect()
    }

    #[test]
    fn rounding_of_the_print_is_allowed_for() {
        // 20 kHz fits six decimals, 30 kHz does not (33.33 us), at 3 MHz most steps read zero,
        // and 10001 Hz looks exact for thousands of rows before it does not.
        for rate_hz in [20e3, 30e3, 44_100.0, 3e6, 10_001.0, 99_999.7] {
            let grid = check(&print(rate_hz, 50_000, |t| format!("{t:.6}"))).expect("uniform");
            let error = grid.interval_s(None) * rate_hz - 1.0;
            // One unit of 1 us over 50 000 samples.
            assert!(error.abs() <= 1e-6 * rate_hz / 49_999.0, "{rate_hz}: {error}");
        }
    }

    #[test]
    fn significant_digits_that_run_out_are_allowed_for() {
        // %.5g, as MATLAB's csvwrite: 12.346 s has a unit of 1 ms, at 1 kHz a whole sample.
        let text = |t: f64| {
            let digits = 4 - if t == 0.0 { 0 } else { t.log10().floor() as i32 };
            format!("{t:.*}", digits.max(0) as usize)
        };
        check(&print(1e3, 20_000, text)).expect("uniform");
    }

    #[test]
    fn a_lost_row_shows_even_in_whole_milliseconds() {
        let mut texts: Vec<String> = (0..3000).map(|k| format!("{:.3}", f64::from(k) / 1e3)).collect();
        texts.drain(1000..1003);
        match check(&texts) {
            Err(LogError::LostRows { row, n_missing, .. }) => {
                assert_eq!((row, n_missing), (1000, 3))
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_drift_that_no_single_step_shows_is_found() {
        // Each step is 1e-5 longer than the one before: 1 % of a sample after about 50 rows.
        let texts: Vec<String> =
            (0..2000u32).map(f64::from).map(|k| format!("{:.12}", 1e-4 * (k + 0.5e-5 * k * k))).collect();
        assert!(matches!(check(&texts), Err(LogError::NotUniform { .. })));
        // And half a percent of jitter is not refused.
        let jitter = |k: u32| if k.is_multiple_of(2) { 0.004 } else { -0.004 };
        let texts: Vec<String> = (0..2000u32).map(|k| format!("{:.12}", 1e-4 * (f64::from(k) + jitter(k)))).collect();
        check(&texts).expect("within tolerance");
    }
}
