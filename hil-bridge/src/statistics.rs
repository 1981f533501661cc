//! What a link does to frames: counts, and a histogram of round trips in bounded memory. It reads no clock.

use serde_json::{Value, json};
use std::time::Duration;
use wire::WireError;

/// Buckets per factor of two; a quantile is at most 1/64 = 1.6 % too high.
const FINE_BITS: u32 = 6;
/// Numbers of frames that come so far behind their turn are out of order; farther back, the board has begun anew.
const LATE: i16 = -64;

/// Durations, counted in buckets whose width grows with the duration.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u64>,
    total: u64,
    most: Duration,
}

impl Histogram {
    /// Counts one.
    pub fn note(&mut self, time: Duration) {
        let bucket = bucket(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
        if self.counts.len() <= bucket {
            self.counts.resize(bucket + 1, 0);
        }
        self.counts[bucket] += 1;
        self.total += 1;
        self.most = self.most.max(time);
    }

    /// How many were counted.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The longest one.
    pub fn most(&self) -> Duration {
        self.most
    }

    /// Every bucket that holds any: its longest duration, and how many.
    pub fn buckets(&self) -> impl Iterator<Item = (Duration, u64)> {
        let counted = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        counted.map(|(bucket, count)| (Duration::from_nanos(last_of(bucket)), *count))
    }

    /// The duration that `share` of all do not exceed, rounded up to its bucket's end; `None` where nothing was counted.
    pub fn quantile(&self, share: f64) -> Option<Duration> {
        let rank = ((share * self.total as f64).ceil() as u64).clamp(1, self.total.max(1));
        let mut seen = 0;
        let bucket = self.counts.iter().position(|count| {
            seen += count;
            seen >= rank
        })?;
        Some(Duration::from_nanos(last_of(bucket)).min(self.most))
    }
}

fn bucket(nanoseconds: u64) -> usize {
    let octave = nanoseconds.checked_ilog2().unwrap_or(0).saturating_sub(FINE_BITS);
    ((nanoseconds >> octave) + (u64::from(octave) << FINE_BITS)) as usize
}

/// The last number of nanoseconds in a bucket.
fn last_of(bucket: usize) -> u64 {
    let octave = (bucket >> FINE_BITS).saturating_sub(1) as u32;
    let first = (bucket as u64) - (u64::from(octave) << FINE_BITS);
    (first << octave).saturating_add((1 << octave) - 1)
}

/// What happened on a link. Every request is answered or lost, and nothing is both.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Frames sent; each asks for an answer.
    pub requests: u64,
    /// Of those, answered in time.
    pub answered: u64,
    /// Of those, not answered in time.
    pub lost: u64,
    /// Most requests lost one after the other.
    pub lost_in_a_row: u64,
    /// Whole frames that came.
    pub frames: u64,
    /// Of those, answers to what had been given up, or second answers. They were dropped.
    pub late: u64,
    /// Frames of the board that never came, by the gaps in its numbers.
    pub missing: u64,
    /// Frames that came behind their turn.
    pub out_of_order: u64,
    /// Frames with a wrong CRC.
    pub crc_errors: u64,
    /// Bytes that were no frame, too long a one, or one with an unknown message.
    pub malformed: u64,
    /// Times that a whole frame was found again after bytes that were none.
    pub resyncs: u64,
    /// Bytes sent and received.
    pub bytes: [u64; 2],
    /// From the request's first byte to the answer's last, of the samples over the bridge, in the link's own time.
    pub round_trip: Histogram,
    in_a_row: u64,
    expected: Option<u16>,
    is_out_of_step: bool,
}

impl Statistics {
    /// A request was answered.
    pub(crate) fn note_answer(&mut self) {
        self.answered += 1;
        self.in_a_row = 0;
    }

    /// A request was given up; returns how many in a row.
    pub(crate) fn note_loss(&mut self) -> u64 {
        self.lost += 1;
        self.in_a_row += 1;
        self.lost_in_a_row = self.lost_in_a_row.max(self.in_a_row);
        self.in_a_row
    }

    /// A whole frame came.
    pub(crate) fn note_frame(&mut self, sequence: u16) {
        self.frames += 1;
        self.resyncs += u64::from(std::mem::take(&mut self.is_out_of_step));
        let gap = self.expected.map_or(0, |expected| sequence.wrapping_sub(expected) as i16);
        if (LATE..0).contains(&gap) {
            self.out_of_order += 1;
            // Counted as missing when its turn came.
            self.missing = self.missing.saturating_sub(1);
            return;
        }
        self.missing += u64::from(gap.max(0) as u16);
        self.expected = Some(sequence.wrapping_add(1));
    }

    /// Bytes came that are no frame of ours.
    pub(crate) fn note_damage(&mut self, error: WireError) {
        self.is_out_of_step = true;
        if error == WireError::Crc {
            self.crc_errors += 1;
        } else {
            self.malformed += 1;
        }
    }

    /// For `link.json` and `--json`.
    pub fn json(&self) -> Value {
        let us = |time: Option<Duration>| time.map(|time| time.as_secs_f64() * 1e6);
        let quantile = |share| us(self.round_trip.quantile(share));
        json!({
            "schema": "hysteron-link-1",
            "requests": self.requests,
            "answered": self.answered,
            "lost": self.lost,
            "lost_in_a_row": self.lost_in_a_row,
            "frames": self.frames,
            "late": self.late,
            "missing": self.missing,
            "out_of_order": self.out_of_order,
            "crc_errors": self.crc_errors,
            "malformed": self.malformed,
            "resyncs": self.resyncs,
            "bytes_sent": self.bytes[0],
            "bytes_received": self.bytes[1],
            "round_trips": self.round_trip.total(),
            "round_trip_us": {
                "p50": quantile(0.5),
                "p99": quantile(0.99),
                "p99_9": quantile(0.999),
                "max": us((self.round_trip.total() > 0).then_some(self.round_trip.most())),
            },
            "paced_at_most_hz": self.paced_hz(),
        })
    }

    /// The highest rate at which a loop in real time over this link would keep up: half of the inverse of the 99.9 % round trip.
    pub fn paced_hz(&self) -> Option<f64> {
        let slow = self.round_trip.quantile(0.999)?;
        (!slow.is_zero()).then(|| 0.5 / slow.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_follow_one_another_without_gap_and_are_narrow() {
        let mut next = 0_u64;
        for index in 0..=bucket(u64::MAX) {
            let last = last_of(index);
            assert_eq!((bucket(next), bucket(last)), (index, index));
            // The first buckets are one nanosecond wide; all others 1/64 of their beginning.
            assert!(last - next <= next / 64, "{next} to {last}");
            next = last.wrapping_add(1);
        }
        assert_eq!(next, 0, "the last bucket ends where u64 does");
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_list() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.quantile(0.5), None);
        let times: Vec<u64> = (0..10_000_u64).map(|k| 100 + k * k % 7919 * 997).collect();
        times.iter().for_each(|time| histogram.note(Duration::from_nanos(*time)));
        let mut sorted = times.clone();
        sorted.sort_unstable();
        for share in [0.0001, 0.5, 0.99, 0.999, 1.0] {
            let exact = sorted[(share * 10_000.0_f64).ceil() as usize - 1];
            let found = histogram.quantile(share).unwrap().as_nanos() as u64;
            // Never below the exact one, and above it by a bucket's width at most.
            assert!((exact..=exact + exact / 64).contains(&found), "{share}: {found} for {exact}");
        }
        assert_eq!(histogram.most().as_nanos() as u64, sorted[9999]);
        assert_eq!(histogram.quantile(1.0), Some(histogram.most()));
    }

    #[test]
    fn a_gap_is_missing_until_its_frame_comes_after_all() {
        let mut statistics = Statistics::default();
        for sequence in [65534, 65535, 2, 0, 3] {
            statistics.note_frame(sequence);
        }
        // 0 and 1 were skipped, 0 came late.
        assert_eq!((statistics.missing, statistics.out_of_order, statistics.frames), (1, 1, 5));
        // A board that begins anew has lost nothing.
        statistics.note_frame(4);
        statistics.expected = Some(40_000);
        statistics.note_frame(0);
        assert_eq!((statistics.missing, statistics.out_of_order), (1 + 25_536, 1));
    }

    #[test]
    fn a_resync_is_counted_once_for_all_bytes_before_it() {
        let mut statistics = Statistics::default();
        statistics.note_damage(WireError::Crc);
        statistics.note_damage(WireError::Malformed);
        statistics.note_frame(0);
        statistics.note_frame(1);
        assert_eq!((statistics.crc_errors, statistics.malformed, statistics.resyncs), (1, 1, 1));
    }
}
