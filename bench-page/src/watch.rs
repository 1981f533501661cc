//! What one page gets: frames of columns as they come, captures around a trigger, points of a loop, spectra. No queue.
//!
//! A frame holds what is new since the one before. A page that is slower than its frames gets fewer of them, each with more in it, and beyond a
//! bound the oldest are left out: so nothing grows, and what was lost is counted and shown. Time is an argument; bytes come out.
//!
//! A frame, little-endian: `u32` kind, id, columns, channels; `f64` first sample, samples a column, mark (the sample of a trigger, else NaN); then
//! of each channel `f32` least and `f32` greatest of all columns; then one byte of limits a column.

use crate::history::{CHANNELS, Column, History, channel};
use gap_diagnosis::spectra::power_density;
use serde::Deserialize;
use std::time::Duration;

/// Frames a second.
pub const FRAMES: u32 = 30;
/// Columns of one frame, and of one answer about the past.
pub const MOST_COLUMNS: usize = 4096;
/// Points of a loop, and the samples that they may stand for.
const POINTS: u64 = 3000;
const MOST_SPAN: u64 = 1 << 18;
/// Samples of a spectrum, and of one of its segments: at 20 kHz the last 1.6 s, lines of 4.9 Hz.
const SPECTRUM: usize = 1 << 15;
const SEGMENT: usize = 1 << 12;
/// Samples that a capture holds at most.
const MOST_CAPTURE: u64 = 1 << 17;

/// Kinds of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// New columns.
    Live = 1,
    /// Columns that were asked for.
    Past = 2,
    /// Columns around a trigger.
    Capture = 3,
    /// Samples for the loop plot: least and greatest are the same.
    Points = 4,
    /// Amplitude densities: first is 0, a column is so many hertz wide (times the samples a column).
    Spectrum = 5,
}

/// What a capture waits for.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Trigger {
    /// Channel.
    pub channel: usize,
    /// Level, in the channel's unit.
    pub level: f32,
    /// Upwards through it, else downwards.
    pub rising: bool,
    /// Samples from before.
    pub before: u64,
    /// Samples from after.
    pub after: u64,
    /// Again and again.
    pub repeat: bool,
}

/// One page's place in the stream.
#[derive(Clone, Debug)]
pub struct Watch {
    length: u64,
    next: u64,
    last_tick: Option<Duration>,
    trigger: Option<(Trigger, u64, Option<u64>)>,
    /// Frames that were due and not sent, because the page was still taking the one before.
    pub lost_frames: u64,
    /// Samples that no frame held.
    pub lost_samples: u64,
}

impl Watch {
    /// From now on, in columns of 16 samples.
    pub fn new(history: &History) -> Watch {
        let next = history.end() / 16 * 16;
        Watch { length: 16, next, last_tick: None, trigger: None, lost_frames: 0, lost_samples: 0 }
    }

    /// Columns of `length` samples from now on, rounded up to a power of two; the stream goes on without a gap where they have that length.
    pub fn set_length(&mut self, length: u64, history: &History) {
        let length = length.clamp(1, 1 << 20).next_power_of_two();
        if length == self.length {
            return;
        }
        self.length = length;
        self.next = history.end() / self.length * self.length;
    }

    /// Counts the frames that were due since the last tick and not sent.
    pub fn tick(&mut self, now: Duration) {
        if let Some(last) = self.last_tick {
            let due = now.saturating_sub(last).as_secs_f64() * f64::from(FRAMES);
            // Half a frame of slack: a timer is never on the spot.
            self.lost_frames += (due - 0.5).max(0.0) as u64;
        }
        self.last_tick = Some(now);
    }

    /// What is new, if a whole column is.
    pub fn live(&mut self, history: &History) -> Option<Vec<u8>> {
        let end = history.end() / self.length * self.length;
        let room = MOST_COLUMNS as u64 * self.length;
        if end.saturating_sub(self.next) > room {
            self.lost_samples += end - room - self.next;
            self.next = end - room;
        }
        let count = end.saturating_sub(self.next) / self.length;
        if count == 0 {
            return None;
        }
        let first = self.next;
        self.next = end;
        Some(frame(Kind::Live, 0, first, self.length, f64::NAN, &history.columns(first, self.length, count as usize)))
    }

    /// Waits for a trigger from now on; `None` no longer.
    ///
    /// # Errors
    /// The channel or the length can't be.
    pub fn set_trigger(&mut self, trigger: Option<Trigger>, history: &History) -> Result<(), String> {
        if let Some(trigger) = &trigger {
            if trigger.channel >= CHANNELS || !trigger.level.is_finite() {
                return Err("the trigger needs a channel and a level".to_owned());
            }
            let samples = trigger.before.checked_add(trigger.after);
            if !samples.is_some_and(|samples| (1..=MOST_CAPTURE).contains(&samples)) {
                return Err(format!("a capture holds 1 to {MOST_CAPTURE} samples: choose a shorter window"));
            }
        }
        self.trigger = trigger.map(|trigger| (trigger, history.end(), None));
        Ok(())
    }

    /// The capture, once the trigger has come and what is to follow it, too.
    pub fn capture(&mut self, history: &History) -> Option<Vec<u8>> {
        let (trigger, scanned, found) = self.trigger.as_mut()?;
        let end = history.end();
        if found.is_none() {
            let value = |number: u64| history.sample(number).map(|sample| sample.least[trigger.channel]);
            let from = (*scanned).max(history.oldest_raw() + 1).max(1);
            *found = (from..end).find(|&number| {
                let (Some(before), Some(now)) = (value(number - 1), value(number)) else { return false };
                if trigger.rising {
                    before < trigger.level && now >= trigger.level
                } else {
                    before > trigger.level && now <= trigger.level
                }
            });
            *scanned = end;
        }
        let at = (*found)?;
        if end < at + trigger.after {
            return None;
        }
        let samples = trigger.before + trigger.after;
        let length = samples.div_ceil(MOST_COLUMNS as u64 / 2).next_power_of_two();
        let first = at.saturating_sub(trigger.before) / length * length;
        let columns = history.columns(first, length, (samples / length) as usize);
        let bytes = frame(Kind::Capture, 0, first, length, at as f64, &columns);
        if trigger.repeat {
            // From now on, not from where this one ended: one capture a frame would fall ever further behind a fast signal.
            (*scanned, *found) = (end, None);
        } else {
            self.trigger = None;
        }
        Some(bytes)
    }
}

/// Columns of the past.
pub fn past(history: &History, id: u32, first: u64, length: u64, count: usize) -> Vec<u8> {
    // Nothing is older than the oldest column, and nothing newer than now.
    let first = first.clamp(history.oldest(), history.end());
    // Columns are as long as they say: where shorter ones are gone, longer ones come, and none is shown as if it were a sample.
    let length = length.clamp(1, 1 << 20).next_power_of_two().max(history.shortest(first));
    let first = first / length * length;
    let left = history.end().saturating_sub(first).div_ceil(length) as usize;
    let columns = history.columns(first, length, count.min(MOST_COLUMNS).min(left));
    frame(Kind::Past, id, first, length, f64::NAN, &columns)
}

/// The last `span` samples, thinned to a few thousand.
pub fn points(history: &History, span: u64) -> Vec<u8> {
    let span = span.clamp(1, MOST_SPAN);
    let stride = span.div_ceil(POINTS);
    let end = history.end();
    let first = end.saturating_sub(span).max(history.oldest_raw());
    let samples = (first..end).step_by(stride as usize).filter_map(|number| history.sample(number));
    let columns: Vec<Column> = samples.copied().collect();
    frame(Kind::Points, 0, first, stride, f64::NAN, &columns)
}

/// Channels that have a spectrum.
const IN_SPECTRUM: [usize; 3] = [channel::DISPLACEMENT, channel::ERROR, channel::GAP];

/// The samples of a spectrum, copied, so that the engine does not wait for a transform.
pub fn spectrum_samples(history: &History) -> [Vec<f64>; 3] {
    IN_SPECTRUM.map(|channel| history.last(channel, SPECTRUM))
}

/// Amplitude densities of displacement, error and gap, in micrometres a square root of hertz; `None` until there are samples enough.
pub fn spectrum(samples: &[Vec<f64>; 3], rate_hz: f64) -> Option<Vec<u8>> {
    let mut columns = vec![Column::of([f32::NAN; CHANNELS], 0); SEGMENT / 2 + 1];
    for (channel, values) in IN_SPECTRUM.into_iter().zip(samples) {
        if values.len() < SEGMENT {
            return None;
        }
        // An error is there only while a reference is followed.
        if values.iter().any(|value| value.is_nan()) {
            continue;
        }
        let density = power_density(values, rate_hz.recip(), SEGMENT).density_m2_per_hz;
        for (column, power) in columns.iter_mut().zip(density) {
            let amplitude = power.sqrt() as f32;
            (column.least[channel], column.most[channel]) = (amplitude, amplitude);
        }
    }
    let line_hz = rate_hz / SEGMENT as f64;
    Some(frame(Kind::Spectrum, 0, 0, 1, line_hz, &columns))
}

fn frame(kind: Kind, id: u32, first: u64, length: u64, mark: f64, columns: &[Column]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(40 + columns.len() * (8 * CHANNELS + 1));
    for word in [kind as u32, id, columns.len() as u32, CHANNELS as u32] {
        bytes.extend(word.to_le_bytes());
    }
    for number in [first as f64, length as f64, mark] {
        bytes.extend(number.to_le_bytes());
    }
    for channel in 0..CHANNELS {
        columns.iter().for_each(|column| bytes.extend(column.least[channel].to_le_bytes()));
        columns.iter().for_each(|column| bytes.extend(column.most[channel].to_le_bytes()));
    }
    bytes.extend(columns.iter().map(|column| column.limits));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fill(history: &mut History, n: u64) {
        let from = history.end();
        (from..from + n).for_each(|k| history.push(&Column::of([k as f32; CHANNELS], 0)));
    }

    fn header(bytes: &[u8]) -> (u32, usize, f64, f64, f64) {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        assert_eq!(bytes.len(), 40 + word(8) as usize * (8 * CHANNELS + 1));
        (word(0), word(8) as usize, number(16), number(24), number(32))
    }

    #[test]
    fn the_length_that_it_has_leaves_no_gap() {
        let mut history = History::default();
        let mut watch = Watch::new(&history);
        fill(&mut history, 912);
        watch.live(&history).unwrap();
        fill(&mut history, 32);
        watch.set_length(16, &history);
        let (_, columns, first, ..) = header(&watch.live(&history).unwrap());
        assert_eq!((columns, first), (2, 912.0));
    }

    #[test]
    fn frames_follow_one_another_without_gap_or_overlap() {
        let mut history = History::default();
        let mut watch = Watch::new(&history);
        watch.set_length(30, &history);
        let mut next = 0.0;
        for n in [1, 31, 32, 700, 5, 1000] {
            fill(&mut history, n);
            let Some(bytes) = watch.live(&history) else { continue };
            let (kind, count, first, length, _) = header(&bytes);
            assert_eq!((kind, first, length), (1, next, 32.0));
            next += count as f64 * length;
        }
        assert_eq!(next, f64::from(1769 / 32 * 32));
        assert_eq!((watch.lost_samples, watch.live(&history)), (0, None));
    }

    #[test]
    fn a_page_that_was_away_gets_one_bounded_frame_and_is_told_what_it_lost() {
        let mut history = History::default();
        let mut watch = Watch::new(&history);
        watch.set_length(1, &history);
        fill(&mut history, 100_000);
        let (_, count, first, ..) = header(&watch.live(&history).unwrap());
        assert_eq!((count, first, watch.lost_samples), (MOST_COLUMNS, 100_000.0 - 4096.0, 100_000 - 4096));
    }

    #[test]
    fn frames_that_were_due_and_not_sent_are_counted() {
        let mut watch = Watch::new(&History::default());
        let at = |frames: f64| Duration::from_secs_f64(frames / f64::from(FRAMES));
        for tick in [0.0, 1.0, 2.1, 2.9, 4.2] {
            watch.tick(at(tick));
        }
        assert_eq!(watch.lost_frames, 0, "a timer's scatter is no loss");
        watch.tick(at(14.2));
        assert_eq!(watch.lost_frames, 9);
    }

    #[test]
    fn a_capture_has_its_past_and_waits_for_its_future() {
        let mut history = History::default();
        let mut watch = Watch::new(&history);
        fill(&mut history, 1000);
        let trigger = Trigger { channel: 1, level: 1499.5, rising: true, before: 200, after: 300, repeat: false };
        watch.set_trigger(Some(trigger), &history).unwrap();
        fill(&mut history, 499);
        assert_eq!(watch.capture(&history), None);
        fill(&mut history, 100);
        assert_eq!(watch.capture(&history), None, "its future is not there yet");
        fill(&mut history, 300);
        let (kind, count, first, length, mark) = header(&watch.capture(&history).unwrap());
        assert_eq!((kind, count, first, length, mark), (3, 500, 1300.0, 1.0, 1500.0));
        assert_eq!(watch.capture(&history), None, "once");
        let falling = Trigger { rising: false, ..trigger };
        watch.set_trigger(Some(falling), &history).unwrap();
        fill(&mut history, 1000);
        assert_eq!(watch.capture(&history), None, "nothing falls here");
        for wrong in [
            Trigger { channel: CHANNELS, ..trigger },
            Trigger { level: f32::NAN, ..trigger },
            Trigger { before: u64::MAX, ..trigger },
            Trigger { before: 0, after: 0, ..trigger },
        ] {
            assert!(watch.set_trigger(Some(wrong), &history).is_err());
        }
    }

    /// A capture a frame is all that a page gets: a signal that comes through the level more often must not be a queue.
    #[test]
    fn a_repeated_capture_is_no_older_than_a_frame_and_its_window() {
        let mut history = History::default();
        let mut watch = Watch::new(&history);
        let trigger = Trigger { channel: 1, level: 49.5, rising: true, before: 30, after: 40, repeat: true };
        watch.set_trigger(Some(trigger), &history).unwrap();
        // A saw of 100 samples, six of them in a frame at 20 kHz.
        let frame = 20_000 / u64::from(FRAMES);
        let mut captures = 0;
        for _ in 0..90 {
            let from = history.end();
            (from..from + frame).for_each(|k| history.push(&Column::of([(k % 100) as f32; CHANNELS], 0)));
            let Some(bytes) = watch.capture(&history) else { continue };
            let (_, _, first, _, mark) = header(&bytes);
            captures += 1;
            assert_eq!(mark % 100.0, 50.0);
            let age = history.end() as f64 - first;
            assert!(age <= (frame + trigger.before + trigger.after) as f64, "capture {captures}: {age}");
        }
        assert_eq!(captures, 90, "each frame has one");
    }

    #[test]
    fn questions_about_the_past_are_answered_within_bounds() {
        let mut history = History::default();
        fill(&mut history, 10_000);
        let (_, count, first, length, _) = header(&past(&history, 7, 1000, 3, usize::MAX));
        assert_eq!((count, first, length), (2250, 1000.0, 4.0));
        for (first, length) in [(u64::MAX, 1), (0, u64::MAX), (u64::MAX, u64::MAX)] {
            header(&past(&history, 7, first, length, usize::MAX));
        }
        // What is no longer kept whole comes in columns as long as they say.
        fill(&mut history, 300_000);
        let of = |first| {
            let (_, _, first, length, _) = header(&past(&history, 7, first, 1, 64));
            (first, length)
        };
        assert_eq!((of(1000), of(309_000)), ((992.0, 32.0), (309_000.0, 1.0)));
        let (kind, count, _, stride, _) = header(&points(&history, 9000));
        assert_eq!((kind, count, stride), (4, 3000, 3.0));
    }

    proptest! {
        #[test]
        fn whatever_numbers_a_page_sends_are_answered_within_bounds(
            numbers in proptest::array::uniform3(prop_oneof![any::<u64>(), 0_u64..100_000]),
            count in any::<usize>(),
            (channel, level) in (0_usize..8, any::<f32>()),
        ) {
            let mut history = History::default();
            fill(&mut history, 5000);
            let [first, length, span] = numbers;
            prop_assert!(header(&past(&history, 1, first, length, count)).1 <= MOST_COLUMNS);
            prop_assert!(header(&points(&history, span)).1 as u64 <= POINTS);
            let mut watch = Watch::new(&history);
            watch.set_length(length, &history);
            let trigger = Trigger { channel, level, rising: true, before: first, after: span, repeat: true };
            let is_taken = watch.set_trigger(Some(trigger), &history).is_ok();
            fill(&mut history, 5000);
            for bytes in [watch.live(&history), watch.capture(&history)].into_iter().flatten() {
                prop_assert!(header(&bytes).1 <= MOST_COLUMNS);
            }
            prop_assert_eq!(is_taken, channel < CHANNELS && level.is_finite() && first.checked_add(span).is_some_and(|n| (1..=MOST_CAPTURE).contains(&n)));
        }
    }

    #[test]
    fn a_sine_is_a_line_where_it_belongs() {
        let mut history = History::default();
        let value = |k: u32| (std::f64::consts::TAU * 1000.0 * f64::from(k) / 20e3).sin() as f32;
        assert_eq!(spectrum(&spectrum_samples(&history), 20e3), None);
        (0..40_000).for_each(|k| history.push(&Column::of([value(k); CHANNELS], 0)));
        let bytes = spectrum(&spectrum_samples(&history), 20e3).unwrap();
        let (kind, count, _, _, line_hz) = header(&bytes);
        assert_eq!((kind, count), (5, SEGMENT / 2 + 1));
        let from = 40 + channel::DISPLACEMENT * 8 * count;
        let line = |k: usize| f32::from_le_bytes(bytes[from + 4 * k..from + 4 * k + 4].try_into().unwrap());
        let peak = (0..count).max_by(|a, b| line(*a).total_cmp(&line(*b))).unwrap();
        assert!((peak as f64 * line_hz - 1000.0).abs() <= line_hz, "{peak}");
        // Spread over the window's lines, its power is that of a sine of amplitude 1.
        let power: f64 = (0..count).map(|k| f64::from(line(k)).powi(2) * line_hz).sum();
        assert!((power - 0.5).abs() < 1e-3, "{power}");
    }
}
