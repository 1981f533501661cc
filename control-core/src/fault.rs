//! Fault codes: why a board has left its loop, as stable numbers with words.
//!
//! The numbers go over the wire and into run records. Never renumber them, only add.

use crate::limits::Limits;
use core::fmt;

/// Why the machine is in its fault mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum FaultCode {
    /// A measurement, a reference or a result was NaN or infinite.
    NotANumber = 1,
    /// abs(y) + abs(dy/dt) t_stop exceeded the trip.
    DisplacementTrip = 2,
    /// The ADC stood at its rail: broken or shorted sensor wire.
    SensorRail = 3,
    /// Too many samples in which the drive was not ready for its latch.
    Overrun = 4,
    /// The other end of the link was silent for too long.
    LinkLoss = 5,
    /// The board came back from a watchdog reset.
    WatchdogReset = 6,
    /// The board came back from a brown-out reset.
    BrownOutReset = 7,
    /// Stored parameters could not be read or do not make a valid law.
    ParameterStore = 8,
    /// The amplifier monitor disagrees with the drive.
    DriveMismatch = 9,
    /// The clock failed or the crystal did not start.
    Clock = 10,
    /// The stop in the ENABLE chain was pressed.
    EmergencyStop = 11,
    /// The ADC had no new value when the law was due.
    AdcLate = 12,
}

/// Every code with its word. The conversions read this table.
const CODES: [(FaultCode, &str); 12] = [
    (FaultCode::NotANumber, "not_a_number"),
    (FaultCode::DisplacementTrip, "displacement_trip"),
    (FaultCode::SensorRail, "sensor_rail"),
    (FaultCode::Overrun, "overrun"),
    (FaultCode::LinkLoss, "link_loss"),
    (FaultCode::WatchdogReset, "watchdog_reset"),
    (FaultCode::BrownOutReset, "brown_out_reset"),
    (FaultCode::ParameterStore, "parameter_store"),
    (FaultCode::DriveMismatch, "drive_mismatch"),
    (FaultCode::Clock, "clock"),
    (FaultCode::EmergencyStop, "emergency_stop"),
    (FaultCode::AdcLate, "adc_late"),
];

impl FaultCode {
    /// The number on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// The code with this number, if there is one. 0 is no fault.
    pub fn from_number(number: u8) -> Option<FaultCode> {
        CODES.into_iter().map(|(code, _)| code).find(|code| code.number() == number)
    }

    /// The word in records and messages.
    pub fn word(self) -> &'static str {
        CODES.into_iter().find(|(code, _)| *code == self).map_or("unknown", |(_, word)| word)
    }

    /// The code for a law that has gone into its safe state; a number that is none is the graver reason.
    pub(crate) fn of_safe_state(limits: Limits) -> FaultCode {
        if limits.contains(Limits::NOT_A_NUMBER) { FaultCode::NotANumber } else { FaultCode::DisplacementTrip }
    }

    /// The bits that an output shows while this fault lasts.
    pub(crate) fn limits(self) -> Limits {
        match self {
            FaultCode::NotANumber => Limits::NOT_A_NUMBER,
            FaultCode::DisplacementTrip => Limits::TRIP,
            _ => Limits::NONE,
        }
    }
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "fault {} ({})", self.number(), self.word())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn numbers_and_words_are_unique_and_lead_back() {
        for (i, (code, word)) in CODES.into_iter().enumerate() {
            // The table is in order without gaps, so a new code can't take an old number.
            assert_eq!(usize::from(code.number()), i + 1);
            assert_eq!(FaultCode::from_number(code.number()), Some(code));
            assert_eq!(code.word(), word);
            assert_eq!(CODES.iter().filter(|(_, other)| *other == word).count(), 1);
        }
        assert_eq!(FaultCode::from_number(0), None);
        assert_eq!(FaultCode::from_number(13), None);
        assert_eq!(FaultCode::LinkLoss.to_string(), "fault 5 (link_loss)");
    }
}
