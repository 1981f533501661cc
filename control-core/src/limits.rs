//! What held the output back in one sample, as a set of named bits.
//!
//! The set is one byte, so that it fits into the board's stream frame and into the `limited_by` column of a log.
//! The bit numbers are part of the wire format: never renumber them, only add.

use core::fmt;

/// A set of reasons why an output is not simply what the control law asked for.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Limits(u8);

/// Every single reason with its word, in bit order. [`Limits::words`] and [`fmt::Display`] read this table.
const WORDS: [(Limits, &str); 8] = [
    (Limits::VOLT, "volt"),
    (Limits::SLEW, "slew"),
    (Limits::REFERENCE_CLAMP, "reference_clamp"),
    (Limits::REFERENCE_RATE, "reference_rate"),
    (Limits::REFERENCE_ACCELERATION, "reference_acceleration"),
    (Limits::TRIP, "trip"),
    (Limits::NOT_A_NUMBER, "not_a_number"),
    (Limits::RAMP, "ramp"),
];

impl Limits {
    /// Nothing was limited.
    pub const NONE: Limits = Limits(0);
    /// The drive reached its lowest or highest voltage.
    pub const VOLT: Limits = Limits(1 << 0);
    /// The drive could not change fast enough.
    pub const SLEW: Limits = Limits(1 << 1);
    /// The wished reference lay beyond the clamp.
    pub const REFERENCE_CLAMP: Limits = Limits(1 << 2);
    /// The reference in use moves at its greatest rate and lags behind the wish.
    pub const REFERENCE_RATE: Limits = Limits(1 << 3);
    /// The reference in use is accelerating or braking and lags behind the wish.
    pub const REFERENCE_ACCELERATION: Limits = Limits(1 << 4);
    /// The displacement trip has acted: the output is in the safe state.
    pub const TRIP: Limits = Limits(1 << 5);
    /// A NaN or an infinity came in (or an unlimited law overflowed): the output is in the safe state.
    pub const NOT_A_NUMBER: Limits = Limits(1 << 6);
    /// The drive follows the open-loop ramp to 0 V of a stop or of a fault.
    pub const RAMP: Limits = Limits(1 << 7);

    /// The bits that mean "the law has given up and heads for 0 V".
    const SAFE_STATE: Limits = Limits(Self::TRIP.0 | Self::NOT_A_NUMBER.0);

    /// The byte that goes onto the wire.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The set whose byte is `bits`; every byte is valid.
    pub const fn from_bits(bits: u8) -> Limits {
        Limits(bits)
    }

    /// Both sets together.
    #[must_use]
    pub const fn union(self, other: Limits) -> Limits {
        Limits(self.0 | other.0)
    }

    /// Whether every reason in `other` is also in `self`.
    pub const fn contains(self, other: Limits) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether at least one reason is in both sets.
    pub const fn intersects(self, other: Limits) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether nothing was limited.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the law is in its safe state (trip, or a number that is none).
    pub const fn is_safe_state(self) -> bool {
        self.intersects(Self::SAFE_STATE)
    }

    /// The words of the set, lowest bit first: `"volt"`, `"slew"`, ...
    pub fn words(self) -> impl Iterator<Item = &'static str> {
        WORDS.into_iter().filter(move |(reason, _)| self.contains(*reason)).map(|(_, word)| word)
    }

    /// The single reason that `word` names, or `None`. The inverse of [`Limits::words`].
    pub fn from_word(word: &str) -> Option<Limits> {
        WORDS.into_iter().find(|(_, known)| *known == word).map(|(reason, _)| reason)
    }
}

impl core::ops::BitOr for Limits {
    type Output = Limits;

    fn bitor(self, other: Limits) -> Limits {
        self.union(other)
    }
}

impl core::ops::BitOrAssign for Limits {
    fn bitor_assign(&mut self, other: Limits) {
        *self = self.union(other);
    }
}

/// Words joined by `+`, for people (a log has the byte); empty for [`Limits::NONE`].
impl fmt::Display for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, word) in self.words().enumerate() {
            if i > 0 {
                f.write_str("+")?;
            }
            f.write_str(word)?;
        }
        Ok(())
    }
}

impl fmt::Debug for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Limits({self})")
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn every_bit_has_one_word_that_leads_back_to_it() {
        for bit in 0..8 {
            let single = Limits::from_bits(1 << bit);
            let mut words = single.words();
            let word = words.next().expect("each of the eight bits is named");
            assert_eq!(words.next(), None);
            assert_eq!(Limits::from_word(word), Some(single));
        }
        assert_eq!(Limits::from_word("voltage"), None);
    }

    #[test]
    fn sets_print_as_words_joined_by_plus() {
        assert_eq!((Limits::SLEW | Limits::VOLT).to_string(), "volt+slew");
        assert_eq!(Limits::NONE.to_string(), "");
        assert_eq!(Limits::from_bits(0xff).words().count(), 8);
    }

    #[test]
    fn only_trip_and_not_a_number_are_the_safe_state() {
        for bits in 0..=u8::MAX {
            let set = Limits::from_bits(bits);
            assert_eq!(set.is_safe_state(), bits & 0b0110_0000 != 0);
        }
    }
}
