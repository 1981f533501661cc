//! One sample of a stream or a capture in 10 bytes.

use control_core::Limits;

/// Bytes of a [`Sample`] on the wire.
pub const SAMPLE_BYTES: usize = 10;

/// What the board was, besides its numbers, when it took a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u8);

impl Flags {
    /// The drive was not ready for its latch; the one before was held.
    pub const OVERRUN: Flags = Flags(1 << 3);
    /// The displacement came over the bridge and not from the pin.
    pub const BRIDGE: Flags = Flags(1 << 4);
    /// ENABLE was toggling, so the amplifier was on.
    pub const ENABLE: Flags = Flags(1 << 5);

    /// The number of [`control_core::ModeName`].
    pub const fn mode(self) -> u8 {
        self.0 & 7
    }

    /// Whether all of `other` is set.
    pub const fn contains(self, other: Flags) -> bool {
        self.0 & other.0 == other.0
    }
}

/// What one sample recorded. Codes are the converters'; [`crate::Identity`] and [`crate::Parameters`] say what they stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// Reference in use, in [`crate::Identity::reference_step_m`].
    pub reference: i16,
    /// Displacement, ADC code.
    pub displacement: u16,
    /// Amplifier monitor, ADC code.
    pub monitor: u16,
    /// Drive, DAC code: that which the DAC has, the one before where this one came too late.
    pub drive: u16,
    /// Which limits acted.
    pub limited_by: Limits,
    /// Mode and circumstances.
    pub flags: Flags,
}

impl Sample {
    /// As on the wire.
    pub const fn to_bytes(self) -> [u8; SAMPLE_BYTES] {
        let [r0, r1] = self.reference.to_le_bytes();
        let [y0, y1] = self.displacement.to_le_bytes();
        let [v0, v1] = self.monitor.to_le_bytes();
        let [u0, u1] = self.drive.to_le_bytes();
        [r0, r1, y0, y1, v0, v1, u0, u1, self.limited_by.bits(), self.flags.0]
    }

    /// From the wire; every ten bytes are a sample.
    pub const fn from_bytes(bytes: &[u8; SAMPLE_BYTES]) -> Sample {
        let [r0, r1, y0, y1, v0, v1, u0, u1, limits, flags] = *bytes;
        Sample {
            reference: i16::from_le_bytes([r0, r1]),
            displacement: u16::from_le_bytes([y0, y1]),
            monitor: u16::from_le_bytes([v0, v1]),
            drive: u16::from_le_bytes([u0, u1]),
            limited_by: Limits::from_bits(limits),
            flags: Flags(flags),
        }
    }

    /// The samples of a block; bytes that make no whole sample at its end are left out.
    pub fn all(bytes: &[u8]) -> impl ExactSizeIterator<Item = Sample> {
        bytes.as_chunks::<SAMPLE_BYTES>().0.iter().map(Sample::from_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_survives_and_lies_where_the_table_says() {
        let sample = Sample {
            reference: -2,
            displacement: 0x0304,
            monitor: 0x0506,
            drive: 0x0708,
            limited_by: Limits::SLEW,
            flags: Flags(0x2a),
        };
        let bytes = sample.to_bytes();
        assert_eq!(bytes, [0xfe, 0xff, 4, 3, 6, 5, 8, 7, 2, 0x2a]);
        assert_eq!(Sample::from_bytes(&bytes), sample);
        assert_eq!(sample.flags.mode(), 2);
        assert!(sample.flags.contains(Flags::OVERRUN) && !sample.flags.contains(Flags::BRIDGE));
        assert_eq!(Sample::all(&[0; 25]).len(), 2);
    }
}
