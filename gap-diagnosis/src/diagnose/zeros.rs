//! Held-out logs of which most that stays is one constant, as where the sensor's zero is another one in each log. Nothing is fitted by it; who reads the
//! gap should know.

use super::bench::Record;
use super::gap::Three;
use super::plants::{Benches, Played};
use super::starts::scored_from;

/// One warning for each log whose constant is larger than the noise and than all else that stays beyond it.
pub(super) fn own_zeros(benches: &Benches<'_>, three: &Three) -> Vec<String> {
    let held = benches.held.iter().flat_map(|held| &held.records);
    let of_log = held.enumerate().filter_map(|(at, record)| {
        let index = benches.fitted.records.len() + at;
        let [constant_m, rest_m] = apart(record, &three.augmented[index])?;
        let noise_m2 = record.noise_m.powi(2);
        if constant_m.powi(2) < noise_m2.max(rest_m.powi(2) - noise_m2) {
            return None;
        }
        let [_, nominal_m] = apart(record, &three.nominal[index])?;
        Some(format!(
            "{}: most of what stays there is a constant, {:+.4} um, as if its sensor's zero were another one, of which the fitted logs tell nothing; without what is \
             constant, {:.4} um become {:.4} um. If each log has its own zero, give several to be fitted",
            record.log.name,
            1e6 * constant_m,
            1e6 * nominal_m,
            1e6 * rest_m
        ))
    });
    of_log.collect()
}

/// Mean of measured minus played on the rows that are scored, and rms without it, metres; `None` of no rows.
fn apart(record: &Record<'_>, played: &Played) -> Option<[f64; 2]> {
    let from = scored_from(record);
    let count = record.log.len().checked_sub(from).filter(|&count| count > 0)? as f64;
    let residuals =
        || record.log.displacement_m.iter().zip(played).skip(from).map(|(measured, played)| measured - played);
    let mean_m = residuals().sum::<f64>() / count;
    Some([mean_m, (residuals().map(|residual_m| (residual_m - mean_m).powi(2)).sum::<f64>() / count).sqrt()])
}
