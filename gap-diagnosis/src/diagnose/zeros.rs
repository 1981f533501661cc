//! Held-out logs of which most that stays is one constant, as where the sensor's zero is another one in each log. Nothing is fitted by it; who reads the
//! gap should know.

use super::bench::Record;
use super::gap::Three;
use super::plants::{Benches, Played};
use super::starts::scored_from;
use plant_sim::metrics::Score;

/// One warning for each log whose constant is larger than the noise and than all else that stays beyond it.
pub(super) fn own_zeros(benches: &Benches<'_>, three: &Three) -> Vec<String> {
    let held_out = benches.records().enumerate().skip(benches.fitted.records.len());
    let of_log = held_out.filter_map(|(index, record)| {
        let augmented = scored(record, &three.augmented[index]);
        let (constant_m, rest_m) = (augmented.offset_m(), augmented.rms_m(true));
        let noise_m2 = record.noise_m.powi(2);
        if constant_m.powi(2) < noise_m2.max(rest_m.powi(2) - noise_m2) {
            return None;
        }
        Some(format!(
            "{}: most of what stays there is a constant, {:+.4} um, as if its sensor's zero were another one, of which the fitted logs tell nothing; without what is \
             constant, {:.4} um become {:.4} um. If each log has its own zero, give several to be fitted",
            record.log.name,
            1e6 * constant_m,
            1e6 * scored(record, &three.nominal[index]).rms_m(true),
            1e6 * rest_m
        ))
    });
    of_log.collect()
}

/// How far `played` is from the rows of a held-out log that are scored.
fn scored(record: &Record<'_>, played: &Played) -> Score {
    let mut score = Score::default();
    let rows = record.log.displacement_m.iter().zip(played).skip(scored_from(record));
    rows.for_each(|(measured_m, predicted_m)| score.add(*measured_m, *predicted_m));
    score
}
