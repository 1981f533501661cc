//! What every board makes of a request, whatever it is made of itself: the rules and their words, in one place.
//!
//! Who carries a request out, and when, is the board's own: on the chip between two samples of an interrupt, in process at once.

use crate::message::ToBoard;
use crate::parameters::{Checked, Converters, ParameterError, Parameters};
use core::fmt;

/// Why a request that needs an idle board was refused.
pub const NOT_IDLE: &str = "only while idle: stop first";
/// Why a sample over the bridge was.
pub const NO_BRIDGE: &str = "the input is the ADC: choose the bridge first";
/// Why one segment more was.
pub const WAVE_FULL: &str = "the waveform is full: 16 segments";
/// Why samples of the table were.
pub const TABLE_FULL: &str = "the table holds 4096 samples of four bytes";

impl ToBoard<'_> {
    /// Whether only an idle board does it: what a running loop plays, listens to or keeps in flash is not changed under it. Parameters are
    /// another matter, see [`Parameters::change`].
    pub const fn needs_idle(&self) -> bool {
        matches!(
            self,
            ToBoard::WaveClear
                | ToBoard::WaveSegment(_)
                | ToBoard::WaveTable { .. }
                | ToBoard::WaveUse { .. }
                | ToBoard::Input(_)
                | ToBoard::SaveParameters
        )
    }
}

/// A set of parameters that may be put in force.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    /// The set, checked.
    pub checked: Checked,
    /// The rate is another: a waveform that was made for the old one is let go.
    pub is_other_rate: bool,
}

/// Why a set was not put in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChangeError {
    /// It can't be used.
    Parameters(ParameterError),
    /// More than the law would change under a loop that is not idle.
    NotIdle,
}

impl fmt::Display for ChangeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ChangeError::Parameters(error) => write!(f, "{error}"),
            ChangeError::NotIdle => f.write_str("rate, calibration and the board's own guards (rail, monitor, overruns, link) change only while idle: stop first"),
        }
    }
}

impl core::error::Error for ChangeError {}

impl Parameters {
    /// Whether `next` may take the place of these on a board: checked as a whole, and while a loop runs nothing but its law.
    ///
    /// # Errors
    ///
    /// [`ChangeError`]; the old set stays in force.
    pub fn change(&self, next: &Parameters, board: &Converters, is_idle: bool) -> Result<Change, ChangeError> {
        let checked = next.check(board).map_err(ChangeError::Parameters)?;
        let is_only_law = next.with_settings(&self.settings()) == *self;
        let is_other_rate = next.rate_hz != self.rate_hz;
        if !is_idle && (is_other_rate || !is_only_law) {
            return Err(ChangeError::NotIdle);
        }
        Ok(Change { checked, is_other_rate })
    }
}

/// Puts the samples of a [`ToBoard::WaveTable`] into `table`.
///
/// # Errors
///
/// [`TABLE_FULL`]; nothing has changed then.
pub fn fill_table(table: &mut [f32], offset: u16, values: &[u8]) -> Result<(), &'static str> {
    let (values, rest) = values.as_chunks::<4>();
    let places = table.get_mut(usize::from(offset)..).unwrap_or_default();
    if !rest.is_empty() || values.len() > places.len() {
        return Err(TABLE_FULL);
    }
    for (place, value) in places.iter_mut().zip(values) {
        *place = f32::from_le_bytes(*value);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn while_a_loop_runs_only_its_law_changes() {
        let board = Converters::NUCLEO_G474RE;
        let set = Parameters::NUCLEO_PI1;
        let law = Parameters { kp_v_per_m: 2e4, ..set };
        let rate = Parameters { rate_hz: 40e3, ..set };
        let guard = Parameters { monitor_samples: 5, ..set };
        let wrong = Parameters { rate_hz: 19_999.0, ..set };
        assert!(!set.change(&law, &board, false).unwrap().is_other_rate);
        assert!(set.change(&rate, &board, true).unwrap().is_other_rate);
        assert!(set.change(&guard, &board, true).is_ok());
        for other in [rate, guard] {
            assert_eq!(set.change(&other, &board, false).unwrap_err(), ChangeError::NotIdle);
        }
        // What can't be at all is said first.
        assert!(matches!(set.change(&wrong, &board, false), Err(ChangeError::Parameters(_))));
    }

    #[test]
    fn a_table_is_filled_whole_or_not_at_all() {
        let mut table = [0.0; 4];
        assert_eq!(fill_table(&mut table, 2, &[0, 0, 128, 63, 0, 0, 0, 64]), Ok(()));
        assert_eq!(table, [0.0, 0.0, 1.0, 2.0]);
        for (offset, bytes) in [(3, 8), (0, 3), (5, 4), (u16::MAX, 4)] {
            assert_eq!(fill_table(&mut table, offset, &[9; 8][..bytes]), Err(TABLE_FULL), "{offset} {bytes}");
        }
        assert_eq!(table, [0.0, 0.0, 1.0, 2.0]);
    }
}
