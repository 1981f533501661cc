//! The messages, and the handshake. Numbers of variants are part of the wire format: only add at the end, and raise the version.

use crate::frame::VERSION;
use crate::parameters::{Converters, Parameters};
use control_core::{Segment, SegmentError};
use core::fmt;
use serde::{Deserialize, Serialize};

/// What a host asks of a board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToBoard<'a> {
    /// Who are you? Answered by [`ToHost::Identity`].
    Hello,
    /// I am still here; anything else says so too. Answered by [`ToHost::Status`].
    KeepAlive,
    /// First action towards a running loop.
    Arm,
    /// Second action.
    Run,
    /// Ramp to 0 V, or disarm.
    Stop,
    /// Leave the fault mode once at 0 V.
    ClearFault,
    /// Put a whole set in force at one sample. Another rate, calibration or board-side guard only while idle.
    SetParameters(Parameters),
    /// Answered by [`ToHost::Parameters`].
    GetParameters,
    /// Write the set in force to flash. Only while idle.
    SaveParameters,
    /// Closed loop, to this reference from the next sample on, in metres. Where the loop ran open, it begins where the stage stands.
    Reference {
        /// Metres.
        reference_m: f32,
    },
    /// Open loop, this drive from the next sample on.
    Drive {
        /// Volts at the actuator.
        drive_v: f32,
    },
    /// Forget the waveform; samples of its table stay until they are written over. Only while idle, as the next three.
    WaveClear,
    /// One more segment at the waveform's end.
    WaveSegment(SegmentRecord),
    /// Samples for the waveform's table from `offset` on: f32, little-endian, metres or volts.
    WaveTable {
        /// Index of the first sample in the table.
        offset: u16,
        /// Four bytes a sample.
        values: &'a [u8],
    },
    /// Play the waveform when the loop runs.
    WaveUse {
        /// Its numbers are metres of a closed loop's reference; else volts of an open loop's drive.
        is_closed_loop: bool,
    },
    /// Where the displacement comes from. Only while idle.
    Input(InputSource),
    /// The displacement of one sample, for [`InputSource::Bridge`]. Answered by [`ToHost::BridgeDrive`].
    BridgeSample {
        /// The host's number for it.
        index: u32,
        /// Displacement, ADC code.
        displacement: u16,
        /// Amplifier monitor, ADC code.
        monitor: u16,
    },
    /// Every n-th sample in blocks from now on; 1 is all. Answered by [`ToHost::StreamStarted`].
    StreamStart {
        /// n; the board takes a larger one if the link is too slow for it, and says so.
        every: u16,
    },
    /// No more blocks.
    StreamStop,
    /// Fill the capture buffer around a trigger.
    CaptureArm {
        /// Samples to keep from before the trigger.
        before: u16,
        /// What to wait for.
        trigger: Trigger,
    },
    /// Read captured samples. Answered by [`ToHost::CaptureBlock`].
    CaptureRead {
        /// Index of the first one wanted.
        from: u16,
    },
}

/// What a board says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToHost<'a> {
    /// Answer to [`ToBoard::Hello`].
    Identity(#[serde(borrow)] Identity<'a>),
    /// The request with this number was carried out.
    Done {
        /// The request's sequence number.
        sequence: u16,
    },
    /// The request with this number was not carried out: the set in force, mode and outputs are as before. What is to be played may be gone, and a save
    /// that failed has erased the older copy.
    Refused {
        /// The request's sequence number.
        sequence: u16,
        /// Why, for a person.
        reason: &'a str,
    },
    /// The set in force.
    Parameters(Parameters),
    /// How the board is.
    Status(Status),
    /// Answer to [`ToBoard::BridgeSample`].
    BridgeDrive {
        /// The host's number for the sample.
        index: u32,
        /// Drive, DAC code: what the DAC would have got.
        drive: u16,
        /// Drive before the DAC, in volts.
        drive_v: f32,
        /// Reference in use, in metres.
        reference_m: f32,
        /// Bits of [`control_core::Limits`].
        limited_by: u8,
        /// Number of [`control_core::ModeName`].
        mode: u8,
    },
    /// Answer to [`ToBoard::StreamStart`].
    StreamStarted {
        /// Every so many samples one is sent.
        every: u16,
        /// Why not every one that was asked for.
        reason: StreamReason,
    },
    /// Samples, [`crate::SAMPLE_BYTES`] each.
    StreamBlock {
        /// Number of the first sample since the board started, modulo 2^32; the others follow at `every`.
        first: u32,
        /// Every so many samples one is sent.
        every: u16,
        /// Samples dropped since the stream began because the link was busy.
        lost: u32,
        /// [`crate::Sample::all`] reads them.
        samples: &'a [u8],
    },
    /// Captured samples.
    CaptureBlock {
        /// Index of the first.
        from: u16,
        /// Samples in the buffer; 0 while it waits or fills.
        total: u16,
        /// Number of the first sample of the buffer since the board started.
        first: u32,
        /// [`crate::Sample::all`] reads them.
        samples: &'a [u8],
    },
    /// The board has gone into its fault mode.
    Fault {
        /// Number of [`control_core::FaultCode`].
        code: u8,
        /// The sample it was seen in; for a link lost over the bridge that of an earlier fault, or 0.
        sample: u32,
    },
}

/// Where the displacement comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputSource {
    /// The ADC; the DAC drives.
    Analog,
    /// The host; the DAC stays at the safe level and ENABLE still.
    Bridge,
}

/// What a capture waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trigger {
    /// Nothing: from the next sample on.
    Now,
    /// The loop starting to run.
    Run,
    /// A fault.
    Fault,
}

/// Why a stream is not as fast as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StreamReason {
    /// It is.
    AsAsked,
    /// The link carries no more.
    LinkTooSlow,
}

/// Why the board started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power came.
    PowerOn,
    /// The reset pin or a debugger.
    Pin,
    /// The program asked for it.
    Software,
    /// The watchdog: a latched fault.
    Watchdog,
    /// The supply sagged: a latched fault.
    BrownOut,
    /// None of these is marked, or a low-power or option-byte reset, which this program never asks for.
    Other,
}

/// How a board is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// Number of [`control_core::ModeName`].
    pub mode: u8,
    /// Number of [`control_core::FaultCode`]; 0 for none.
    pub fault: u8,
    /// Why it started.
    pub reset: ResetCause,
    /// Where the displacement comes from.
    pub input: InputSource,
    /// Samples since the start, modulo 2^32.
    pub samples: u32,
    /// Samples whose drive was not ready for its latch.
    pub overruns: u32,
    /// Samples the ADC overwrote before they were read.
    pub lost_samples: u32,
    /// Cycles from the ADC's trigger until the last drive was ready.
    pub ready_cycles: u16,
    /// The most cycles it ever took.
    pub ready_max_cycles: u16,
    /// Frames from the host that were damaged or unknown.
    pub bad_frames: u32,
}

/// Who a board is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity<'a> {
    /// [`VERSION`] of the board.
    pub version: u8,
    /// The board file.
    pub board: &'a str,
    /// Version and commit of the firmware.
    pub firmware: &'a str,
    /// Its converters and timer.
    pub converters: Converters,
    /// Step of [`crate::Sample::reference`] in metres, for the parameters in force.
    pub reference_step_m: f32,
    /// Samples that the waveform's table holds.
    pub table_samples: u16,
    /// Segments that the waveform holds.
    pub segments: u16,
    /// Samples that the capture buffer holds.
    pub capture_samples: u16,
}

/// Why a board can't be worked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// It speaks another version.
    Version {
        /// The board's.
        theirs: u8,
    },
    /// Its timing can't be: no DAC latch within the shortest period.
    Timing,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Mismatch::Version { theirs } => write!(
                f,
                "the board speaks version {theirs} of the link, this program version {VERSION}: flash the firmware of this release"
            ),
            Mismatch::Timing => {
                f.write_str("the board states a latch later than its sampling period: its firmware is broken")
            }
        }
    }
}

impl core::error::Error for Mismatch {}

impl Identity<'_> {
    /// The handshake's verdict.
    ///
    /// # Errors
    ///
    /// [`Mismatch`], in words.
    pub fn check(&self) -> Result<(), Mismatch> {
        if self.version != VERSION {
            return Err(Mismatch::Version { theirs: self.version });
        }
        let deadline = self.converters.hold_cycles.saturating_add(self.converters.latch_cycles);
        if deadline >= self.converters.period_min_cycles {
            return Err(Mismatch::Timing);
        }
        Ok(())
    }
}

/// The waveform of a segment; numbers as in [`control_core::Segment`]'s constructors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "control_core::Segment describes them")]
pub enum Wave {
    Hold {
        level: f32,
    },
    Square {
        amplitude: f32,
        frequency_hz: f32,
    },
    Sine {
        amplitude: f32,
        frequency_hz: f32,
    },
    Triangle {
        amplitude: f32,
        frequency_hz: f32,
    },
    DecayingSine {
        amplitude: f32,
        frequency_hz: f32,
    },
    LinearSweep {
        amplitude: f32,
        from_hz: f32,
        to_hz: f32,
    },
    LogSweep {
        amplitude: f32,
        from_hz: f32,
        to_hz: f32,
    },
    Ladder {
        amplitude: f32,
        levels: u32,
        hold_samples: u32,
    },
    /// Part of the board's table.
    Table {
        offset: u16,
        length: u16,
    },
}

/// A segment as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentRecord {
    /// What it plays.
    pub wave: Wave,
    /// How long; a ladder has a length of its own.
    pub samples: u32,
}

impl SegmentRecord {
    /// The segment itself, at the board's rate and with the board's table.
    ///
    /// # Errors
    ///
    /// [`SegmentError`]; a part beyond the table's end is [`SegmentError::Length`].
    pub fn build<'t>(&self, rate_hz: f32, table: &'t [f32]) -> Result<Segment<'t>, SegmentError> {
        let samples = self.samples;
        match self.wave {
            Wave::Hold { level } => Segment::hold(level, samples),
            Wave::Square { amplitude, frequency_hz } => Segment::square(rate_hz, amplitude, frequency_hz, samples),
            Wave::Sine { amplitude, frequency_hz } => Segment::sine(rate_hz, amplitude, frequency_hz, samples),
            Wave::Triangle { amplitude, frequency_hz } => Segment::triangle(rate_hz, amplitude, frequency_hz, samples),
            Wave::DecayingSine { amplitude, frequency_hz } => {
                Segment::decaying_sine(rate_hz, amplitude, frequency_hz, samples)
            }
            Wave::LinearSweep { amplitude, from_hz, to_hz } => {
                Segment::linear_sweep(rate_hz, amplitude, from_hz, to_hz, samples)
            }
            Wave::LogSweep { amplitude, from_hz, to_hz } => {
                Segment::log_sweep(rate_hz, amplitude, from_hz, to_hz, samples)
            }
            Wave::Ladder { amplitude, levels, hold_samples } => Segment::ladder(amplitude, levels, hold_samples),
            Wave::Table { offset, length } => {
                let (from, length) = (usize::from(offset), usize::from(length));
                Segment::table(table.get(from..from + length).ok_or(SegmentError::Length)?, samples)
            }
        }
    }
}
