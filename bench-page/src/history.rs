//! What the bench did, in bounded memory: the last samples whole, what is older as least and greatest of ever longer columns.
//!
//! | level | a column is | kept at 20 kHz |
//! | --- | --- | --- |
//! | 0 | 1 sample | 13 s |
//! | 1 | 32 samples | 105 s |
//! | 2 | 1024 samples | 56 min |
//! | 3 | 32768 samples | 30 h |
//!
//! Columns begin at multiples of their length, so that the same stretch looks the same whenever it is asked for. What this does not do:
//! know a socket, a clock or a unit.

use std::collections::VecDeque;

/// What a sample holds, in this order.
pub const CHANNELS: usize = 6;
/// Numbers of the channels.
#[allow(missing_docs, reason = "their words are in `engine::CHANNEL_TABLE`")]
pub mod channel {
    pub const REFERENCE: usize = 0;
    pub const DISPLACEMENT: usize = 1;
    pub const MODEL: usize = 2;
    pub const ERROR: usize = 3;
    pub const GAP: usize = 4;
    pub const DRIVE: usize = 5;
}

/// Columns (samples) kept at level 0, and at each other one.
const RAW: usize = 1 << 18;
const KEPT: usize = 1 << 16;
/// Columns of one level in a column of the next.
const FOLD: u64 = 32;
const LEVELS: usize = 4;

/// One sample, or a column of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Least of each channel; NaN where no sample had it.
    pub least: [f32; CHANNELS],
    /// Greatest of each channel.
    pub most: [f32; CHANNELS],
    /// Bits of the limits that acted in any sample.
    pub limits: u8,
}

impl Column {
    /// Of one sample; NaN for a channel that it lacks.
    pub fn of(values: [f32; CHANNELS], limits: u8) -> Column {
        Column { least: values, most: values, limits }
    }

    const EMPTY: Column = Column { least: [f32::NAN; CHANNELS], most: [f32::NAN; CHANNELS], limits: 0 };

    fn join(&mut self, other: &Column) {
        for channel in 0..CHANNELS {
            // `min` and `max` of a NaN and a number are the number.
            self.least[channel] = self.least[channel].min(other.least[channel]);
            self.most[channel] = self.most[channel].max(other.most[channel]);
        }
        self.limits |= other.limits;
    }
}

/// One level: its last columns, and the one that fills.
#[derive(Clone, Debug)]
struct Level {
    columns: VecDeque<Column>,
    kept: usize,
    /// Columns that were ever whole.
    whole: u64,
    filling: Column,
    filled: u64,
}

impl Level {
    fn new(kept: usize) -> Level {
        Level { columns: VecDeque::new(), kept, whole: 0, filling: Column::EMPTY, filled: 0 }
    }

    /// Adds a column of the level below; the column of this level that it completes.
    fn push(&mut self, column: &Column, fold: u64) -> Option<Column> {
        self.filling.join(column);
        self.filled += 1;
        if self.filled < fold {
            return None;
        }
        let whole = std::mem::replace(&mut self.filling, Column::EMPTY);
        self.filled = 0;
        if self.columns.len() == self.kept {
            self.columns.pop_front();
        }
        self.columns.push_back(whole);
        self.whole += 1;
        Some(whole)
    }

    /// Number of the oldest column.
    fn oldest(&self) -> u64 {
        self.whole - self.columns.len() as u64
    }

    /// Columns `from` to `to` joined, as far as they are kept.
    fn joined(&self, from: u64, to: u64) -> Column {
        let mut joined = Column::EMPTY;
        let (from, to) = (from.max(self.oldest()), to.min(self.whole));
        for number in from..to.max(from) {
            if let Some(column) = self.columns.get((number - self.oldest()) as usize) {
                joined.join(column);
            }
        }
        joined
    }
}

/// The history.
#[derive(Clone, Debug)]
pub struct History {
    levels: Vec<Level>,
}

impl Default for History {
    fn default() -> History {
        History::new(RAW, KEPT)
    }
}

impl History {
    fn new(raw: usize, kept: usize) -> History {
        let level = |index| Level::new(if index == 0 { raw } else { kept });
        History { levels: (0..LEVELS).map(level).collect() }
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Column) {
        let mut up = Some(*sample);
        for (index, level) in self.levels.iter_mut().enumerate() {
            let Some(column) = up else { break };
            up = level.push(&column, if index == 0 { 1 } else { FOLD });
        }
    }

    /// Samples that were ever added: the number of the next one.
    pub fn end(&self) -> u64 {
        self.levels[0].whole
    }

    /// Number of the oldest sample that is kept whole.
    pub fn oldest_raw(&self) -> u64 {
        self.levels[0].oldest()
    }

    /// Number of the oldest sample that is in any column.
    pub fn oldest(&self) -> u64 {
        let spans = self.levels.iter().zip(0_u32..);
        spans.filter(|(level, _)| level.whole > 0).map(|(level, k)| level.oldest() * FOLD.pow(k)).min().unwrap_or(0)
    }

    /// Samples in the shortest column that is kept of sample `number`.
    pub fn shortest(&self, number: u64) -> u64 {
        let spans = self.levels.iter().zip((0_u32..).map(|k| FOLD.pow(k)));
        let mut kept = spans.filter(|(level, span)| level.whole > 0 && level.oldest() * span <= number);
        kept.next().map_or(1, |(_, span)| span)
    }

    /// One sample, if it is still kept whole.
    pub fn sample(&self, number: u64) -> Option<&Column> {
        let raw = &self.levels[0];
        raw.columns.get(usize::try_from(number.checked_sub(raw.oldest())?).ok()?)
    }

    /// `count` columns of `length` samples from `first` on, `length` a power of two and `first` a multiple of it. Columns beyond what is
    /// kept, and the last one where it is not whole, hold what there is.
    pub fn columns(&self, first: u64, length: u64, count: usize) -> Vec<Column> {
        let length = length.max(1);
        // The longest columns that fit, so that hours are as cheap as seconds; shorter ones where those are not there yet.
        let coarse = (0..LEVELS as u32).rev().find(|&k| FOLD.pow(k) <= length).unwrap_or(0);
        let mut columns = Vec::with_capacity(count);
        for index in 0..count as u64 {
            let from = first.saturating_add(index.saturating_mul(length));
            let to = from.saturating_add(length);
            let mut column = Column::EMPTY;
            let mut done = from;
            for k in (0..=coarse).rev() {
                let (level, span) = (&self.levels[k as usize], FOLD.pow(k));
                let end = to.min(level.whole * span);
                if end > done {
                    column.join(&level.joined(done / span, end / span));
                    done = end / span * span;
                }
            }
            // Older than the fitting level reaches: the next coarser one, whose columns are longer than what was asked for.
            if column == Column::EMPTY || column.least.iter().all(|value| value.is_nan()) {
                for k in coarse + 1..LEVELS as u32 {
                    let (level, span) = (&self.levels[k as usize], FOLD.pow(k));
                    column = level.joined(from / span, (from / span) + 1);
                    if !column.least.iter().all(|value| value.is_nan()) {
                        break;
                    }
                }
            }
            columns.push(column);
        }
        columns
    }

    /// Values of `channel` in the last `count` samples, oldest first; fewer where there are fewer.
    pub fn last(&self, channel: usize, count: usize) -> Vec<f64> {
        let raw = &self.levels[0].columns;
        raw.range(raw.len().saturating_sub(count)..).map(|column| f64::from(column.least[channel])).collect()
    }

    /// Columns in memory, for the test that it is bounded.
    #[cfg(test)]
    fn held(&self) -> usize {
        self.levels.iter().map(|level| level.columns.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(value: f32) -> Column {
        Column::of([value, -value, 0.5 * value, f32::NAN, 1.0, 2.0], u8::from(value == 7.0))
    }

    fn filled(history: &mut History, n: u64) {
        (0..n).for_each(|k| history.push(&sample(k as f32)));
    }

    #[test]
    fn columns_hold_least_and_greatest_of_exactly_their_samples() {
        let mut history = History::default();
        filled(&mut history, 10_000);
        for length in [1_u64, 2, 16, 32, 64, 1024, 2048] {
            for (index, column) in history.columns(0, length, (10_000 / length) as usize).iter().enumerate() {
                let from = index as f32 * length as f32;
                let last = from + length as f32 - 1.0;
                assert_eq!((column.least[0], column.most[0]), (from, last), "length {length}, column {index}");
                assert_eq!((column.least[1], column.most[1]), (-last, -from));
                assert_eq!(column.limits == 1, (from..=last).contains(&7.0));
                assert!(column.least[3].is_nan(), "what no sample has, no column has");
            }
        }
    }

    proptest! {
        #[test]
        fn any_columns_are_those_of_the_samples_themselves(
            values in proptest::collection::vec(-1e3_f32..1e3, 1..5000),
            power in 0_u32..13,
            skipped in 0_u64..6000,
        ) {
            let mut history = History::default();
            values.iter().for_each(|value| history.push(&Column::of([*value; CHANNELS], 0)));
            let length = 1_u64 << power;
            let first = skipped / length * length;
            for (index, column) in history.columns(first, length, 8).iter().enumerate() {
                let from = (first as usize + index * length as usize).min(values.len());
                let part = &values[from..values.len().min(from + length as usize)];
                let least = part.iter().copied().fold(f32::NAN, f32::min);
                let most = part.iter().copied().fold(f32::NAN, f32::max);
                prop_assert!(column.least[0].to_bits() == least.to_bits() || column.least[0] == least);
                prop_assert!(column.most[0].to_bits() == most.to_bits() || column.most[0] == most);
            }
        }
    }

    #[test]
    fn the_last_column_holds_what_there_is_and_beyond_it_is_nothing() {
        let mut history = History::default();
        filled(&mut history, 1000);
        let columns = history.columns(0, 1024, 2);
        assert_eq!((columns[0].least[0], columns[0].most[0]), (0.0, 999.0));
        assert!(columns[1].least[0].is_nan() && columns[1].limits == 0);
        assert!(history.columns(u64::MAX - 5, 1 << 40, 3).iter().all(|column| column.least[0].is_nan()));
    }

    #[test]
    fn memory_is_bounded_and_what_is_old_is_still_there_as_columns() {
        // A small one has the same code and is filled sooner: 256 + 3 x 64 columns are all it may hold.
        let mut history = History::new(256, 64);
        filled(&mut history, 3_000_000);
        assert_eq!(history.held(), 256 + 3 * 64);
        assert_eq!(history.end(), 3_000_000);
        // Level 3 holds the last 64 columns of 32768 samples.
        let oldest = history.oldest();
        assert_eq!(oldest, (3_000_000 / 32_768 - 64) * 32_768);
        let columns = history.columns(oldest, 32_768, 64);
        assert!(columns.iter().enumerate().all(|(k, column)| column.least[0] == (oldest + k as u64 * 32_768) as f32));
        // Finer than what is kept: the column that holds it.
        let fine = history.columns(oldest, 1, 1);
        assert_eq!((fine[0].least[0], fine[0].most[0]), (oldest as f32, (oldest + 32_767) as f32));
        assert!(history.sample(oldest).is_none());
        assert_eq!(history.sample(2_999_999).map(|column| column.most[0]), Some(2_999_999.0));
        assert_eq!(history.last(0, 3), [2_999_997.0, 2_999_998.0, 2_999_999.0]);
    }

    #[test]
    fn the_size_that_is_served_stays_within_25_mb() {
        let bytes = (RAW + (LEVELS - 1) * KEPT) * size_of::<Column>();
        assert!(bytes < 25_000_000, "{bytes}");
    }
}
