//! A SPEC as a board plays it: segments and the samples of its table, as they go over the line.
//!
//! The same segments as `simulate` plays, from the same numbers, so that both play the same bits.

use plant_sim::spec::{self, Part, Shape, Spec};
use wire::{SegmentRecord, ToBoard, Wave};

/// Samples of the board's table, and its segments; the identity states them, too.
const TABLE_SAMPLES: usize = 4096;
const SEGMENTS: usize = 16;

/// A waveform, ready to be sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Waveform {
    /// Its segments.
    pub segments: Vec<SegmentRecord>,
    /// Samples that its tables refer to.
    pub table: Vec<f32>,
}

/// Why a board can't play a SPEC.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum WaveformError {
    #[error("{kind}: {reason}")]
    Part { kind: &'static str, reason: String },
    #[error("`,shaped` is not played by a board: the controller file's [reference] shapes every reference")]
    Shaped,
    #[error("{segments} segments; a board holds {SEGMENTS}: use a shorter SPEC")]
    TooManySegments { segments: usize },
    #[error(
        "{samples} samples of table; a board holds {TABLE_SAMPLES}: use a shorter file, a higher lowest line or frequency, fewer realisations or a lower rate"
    )]
    TooLong { samples: usize },
}

impl Waveform {
    /// Lays `spec` out at `rate_hz`.
    ///
    /// # Errors
    /// [`WaveformError`].
    pub fn new(spec: &Spec, rate_hz: f64) -> Result<Waveform, WaveformError> {
        if spec.shaped() {
            return Err(WaveformError::Shaped);
        }
        let mut waveform = Waveform::default();
        for part in spec.parts.iter().flat_map(Part::generated) {
            waveform.add(&part, rate_hz)?;
        }
        if waveform.segments.len() > SEGMENTS {
            return Err(WaveformError::TooManySegments { segments: waveform.segments.len() });
        }
        if waveform.table.len() > TABLE_SAMPLES {
            return Err(WaveformError::TooLong { samples: waveform.table.len() });
        }
        Ok(waveform)
    }

    /// The requests that put it on a board, in order, each given to `order`.
    ///
    /// # Errors
    /// The first one of `order`.
    pub fn send<E>(&self, is_closed_loop: bool, mut order: impl FnMut(&ToBoard<'_>) -> Result<(), E>) -> Result<(), E> {
        order(&ToBoard::WaveClear)?;
        for segment in &self.segments {
            order(&ToBoard::WaveSegment(*segment))?;
        }
        // 100 samples are 400 bytes of a message.
        for (index, part) in self.table.chunks(100).enumerate() {
            let values: Vec<u8> = part.iter().flat_map(|value| value.to_le_bytes()).collect();
            order(&ToBoard::WaveTable { offset: (100 * index) as u16, values: &values })?;
        }
        order(&ToBoard::WaveUse { is_closed_loop })
    }

    fn add(&mut self, part: &Part, rate_hz: f64) -> Result<(), WaveformError> {
        let fail = |reason: String| WaveformError::Part { kind: part.shape.kind(), reason };
        // A table that would be refused is not made first: whoever waits for the answer may be a running loop.
        let whole_table = self.table.len().saturating_add(spec::table_samples(&part.shape, rate_hz).unwrap_or(0));
        if whole_table > TABLE_SAMPLES {
            return Err(WaveformError::TooLong { samples: whole_table });
        }
        let tables = spec::table(&part.shape, rate_hz).map_err(fail)?.unwrap_or_default();
        let amplitude = part.amplitude as f32;
        let whole = |seconds: f64| (seconds * rate_hz).round().clamp(1.0, f64::from(u32::MAX)) as u32;
        let samples = part.seconds.map_or(u32::MAX, whole);
        let wave = match &part.shape {
            Shape::Zero => Wave::Hold { level: 0.0 },
            Shape::Hold | Shape::Step => Wave::Hold { level: amplitude },
            Shape::Square { hz } => Wave::Square { amplitude, frequency_hz: *hz as f32 },
            Shape::Sine { hz } => Wave::Sine { amplitude, frequency_hz: *hz as f32 },
            Shape::DecayingSine { hz } => Wave::DecayingSine { amplitude, frequency_hz: *hz as f32 },
            Shape::Triangle { hz } => Wave::Triangle { amplitude, frequency_hz: *hz as f32 },
            Shape::Sweep { hz, log: false } => {
                Wave::LinearSweep { amplitude, from_hz: hz[0] as f32, to_hz: hz[1] as f32 }
            }
            Shape::Sweep { hz, log: true } => Wave::LogSweep { amplitude, from_hz: hz[0] as f32, to_hz: hz[1] as f32 },
            Shape::Ladder { levels, hold_s } => {
                Wave::Ladder { amplitude, levels: *levels, hold_samples: whole(*hold_s) }
            }
            Shape::Multisine { periods, .. } => return self.add_tables(part, &tables, *periods, samples),
            // There are none: they are generated as sines.
            Shape::MinorLoops { .. } => return Ok(()),
            Shape::File { .. } => return self.add_tables(part, &tables, 1, samples),
        };
        self.segments.push(SegmentRecord { wave, samples });
        Ok(())
    }

    /// Each table `periods` times, the last one until the part's end.
    fn add_tables(
        &mut self,
        part: &Part,
        tables: &[Vec<f32>],
        periods: u32,
        samples: u32,
    ) -> Result<(), WaveformError> {
        // A file is as long as its samples where nothing else is said.
        let alone = matches!(part.shape, Shape::File { .. }) && part.seconds.is_none();
        let mut left = if alone { tables.iter().map(|table| table.len() as u32).sum() } else { samples };
        for (index, table) in tables.iter().enumerate() {
            let own = periods.saturating_mul(table.len() as u32);
            let take = if index + 1 == tables.len() { left } else { own.min(left) };
            if take > 0 {
                let (offset, length) = (self.table.len(), table.len());
                self.table.extend(table.iter().map(|sample| (f64::from(*sample) * part.amplitude) as f32));
                if self.table.len() > TABLE_SAMPLES {
                    return Err(WaveformError::TooLong { samples: self.table.len() });
                }
                let wave = Wave::Table { offset: offset as u16, length: length as u16 };
                self.segments.push(SegmentRecord { wave, samples: take });
            }
            left -= take;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waveform(text: &str) -> Result<Waveform, WaveformError> {
        Waveform::new(&Spec::parse(text).unwrap(), 20e3)
    }

    #[test]
    fn parts_become_segments_with_their_lengths() {
        let waveform = waveform("zero@0.1s+step:80um@0.2s+sine:50um@100Hz").unwrap();
        let expected = [
            SegmentRecord { wave: Wave::Hold { level: 0.0 }, samples: 2000 },
            SegmentRecord { wave: Wave::Hold { level: 80e-6 }, samples: 4000 },
            SegmentRecord { wave: Wave::Sine { amplitude: 50e-6, frequency_hz: 100.0 }, samples: u32::MAX },
        ];
        assert_eq!(waveform.segments, expected);
        assert!(waveform.table.is_empty());
    }

    /// What the registry proposes to tell its entries apart is played at a bench's usual rate.
    #[test]
    fn a_board_plays_every_experiment_of_the_registry() {
        for effect in plant_sim::effects::REGISTRY {
            let text = effect.about().spec;
            if !text.is_empty() {
                waveform(text).unwrap_or_else(|error| panic!("{}: {text}: {error}", effect.id()));
            }
        }
        let sines = waveform("minor-loops:60V@1Hz").unwrap();
        let of = |amplitude| SegmentRecord { wave: Wave::Sine { amplitude, frequency_hz: 1.0 }, samples: 40_000 };
        assert_eq!(sines.segments, [60.0, 45.0, 30.0, 15.0].map(of));
        assert!(sines.table.is_empty());
        assert_eq!(waveform("minor-loops:60V@1Hz,for=3s").unwrap().segments[1].samples, 20_000);
    }

    #[test]
    fn a_multisine_is_a_table_and_one_too_long_is_refused() {
        let short = waveform("multisine:20V@10-2000Hz,periods=4,realisations=2,seed=7").unwrap();
        assert_eq!((short.segments.len(), short.table.len()), (2, 4000));
        assert_eq!(short.segments[1].wave, Wave::Table { offset: 2000, length: 2000 });
        let long = waveform("multisine:20V@1-2000Hz,periods=4,realisations=2,seed=7").unwrap_err();
        assert_eq!(long, WaveformError::TooLong { samples: 40_000 });
        // 2e9 products of samples and lines, were they made; the second one with what the first has taken.
        for (text, samples) in [
            ("multisine:1um@1-9999Hz,realisations=10", 200_000),
            ("multisine:1um@10-100Hz,periods=1+multisine:1um@8-100Hz", 4500),
        ] {
            assert_eq!(waveform(text).unwrap_err(), WaveformError::TooLong { samples }, "{text}");
        }
        assert_eq!(waveform("step:80um,shaped").unwrap_err(), WaveformError::Shaped);
    }
}
