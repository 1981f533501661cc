//! The link: frames in, requests to the loop, answers and the stream out.
//!
//! Two tasks. [`receive`] takes frames one after the other and has at most one request under way in the loop; [`send`] owns
//! the transmitter and sends answers before samples.

use crate::line::{Disturbed, Line};
use crate::shared::{self, Lent, Reply, Request, State};
use crate::{capture, control, store};
use control_core::{Segment, SegmentError};
use core::fmt::{self, Write};
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::UartTx;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use heapless::{String, Vec};
use wire::rules::{Change, ChangeError, NO_BRIDGE, NOT_IDLE, WAVE_FULL, fill_table};
use wire::{
    Checked, Converters, Frame, Identity, Missed, Parameters, ResetCause, SegmentRecord, Sender, Status, StreamReason,
    ToBoard, ToHost,
};

/// Bits per second: the highest that the Nucleo's ST-LINK and common adapters share.
pub const BAUD: u32 = 3_000_000;
/// Samples in a block: 480 bytes, the most that fits a message with its numbers.
const BLOCK_SAMPLES: usize = 48;
/// Bytes on the line per second and sample that a stream may take: 10 bits a byte, nine tenths of the line, 511 bytes a block.
const STREAM_SAMPLES_PER_S: u32 = BAUD / 10 * 9 / 10 * BLOCK_SAMPLES as u32 / 511;
/// Samples of the waveform's table: 0.2 s at 20 kHz.
const TABLE_SAMPLES: usize = 4096;
/// Segments of the waveform.
const SEGMENTS: usize = 16;

static TABLE: Lent<[f32; TABLE_SAMPLES]> = Lent::new([0.0; TABLE_SAMPLES]);
static WAVEFORM: Lent<Vec<Segment<'static>, SEGMENTS>> = Lent::new(Vec::new());
static SETS: [Lent<Option<Checked>>; 2] = [Lent::new(None), Lent::new(None)];
static BAD_FRAMES: AtomicU32 = AtomicU32::new(0);
static ANSWERS: Channel<CriticalSectionRawMutex, Answer, 4> = Channel::new();

/// What a board is, for the identity.
#[derive(Clone, Copy)]
pub struct Facts {
    /// The board file.
    pub board: &'static str,
    /// Its converters.
    pub converters: Converters,
    /// Why it started.
    pub reset: ResetCause,
}

/// An answer on its way to the sender. Larger things are fetched by the sender itself.
#[allow(clippy::large_enum_variant, reason = "four of them, and no heap to put the large one on")]
enum Answer {
    Identity { reference_step_m: f32 },
    Done { sequence: u16 },
    Refused { sequence: u16, reason: Reason },
    Parameters(Parameters),
    Status,
    Bridge { index: u32, drive: u16, drive_v: f32, reference_m: f32, limited_by: u8 },
    StreamStarted { every: u16, reason: StreamReason },
    Capture { from: u16 },
}

/// Puts a set in force before anything runs.
pub fn first_set(checked: Checked) -> &'static Checked {
    // SAFETY: called once, before the tasks and the control interrupt exist.
    unsafe { (*SETS[0].get()).insert(checked) }
}

/// The receiving side.
pub struct Desk {
    facts: Facts,
    parameters: Parameters,
    /// Which of the two sets the loop uses.
    set_idx: usize,
    segments: Vec<SegmentRecord, SEGMENTS>,
}

impl Desk {
    /// A desk; `parameters` are the set in force.
    pub fn new(facts: Facts, parameters: Parameters) -> Desk {
        Desk { facts, parameters, set_idx: 0, segments: Vec::new() }
    }

    /// Gives the loop a request and waits for its reply, a sample or two.
    async fn ask(&mut self, request: Request) -> Reply {
        // There is room: the request before it was answered.
        // SAFETY: this task is the only one that requests.
        let _ = unsafe { shared::REQUESTS.push(request) };
        loop {
            // SAFETY: this task is the only one that takes replies.
            if let Some(reply) = unsafe { shared::REPLIES.pop() } {
                return reply;
            }
            shared::REPLIED.wait().await;
        }
    }

    async fn ask_and_answer(&mut self, sequence: u16, request: Request) {
        let answer = match self.ask(request).await {
            Reply::Refused(refused) => refuse(sequence, refused),
            Reply::NotIdle => refuse(sequence, NOT_IDLE),
            Reply::NotBridge => refuse(sequence, NO_BRIDGE),
            Reply::Done | Reply::Bridge { .. } => Answer::Done { sequence },
        };
        say(answer).await;
    }

    async fn handle(&mut self, frame: &Frame<'_>) {
        let sequence = frame.sequence;
        let message = match frame.message::<ToBoard<'_>>() {
            Ok(message) => message,
            Err(error) => {
                count_bad();
                return say(refuse(sequence, error)).await;
            }
        };
        defmt::info!("request {=u16}, {=usize} waiting", sequence, shared::RECORDS.len());
        control::LOOP.heard.store(control::LOOP.samples.load(Ordering::Relaxed), Ordering::Relaxed);
        let is_idle = State::now().is_idle();
        match message {
            order if order.needs_idle() && !is_idle => say(refuse(sequence, NOT_IDLE)).await,
            ToBoard::Hello => {
                let reference_step_m = self.parameters.reference_step_m(&self.facts.converters);
                say(Answer::Identity { reference_step_m }).await;
            }
            ToBoard::KeepAlive => say(Answer::Status).await,
            ToBoard::Arm => self.ask_and_answer(sequence, Request::Arm).await,
            ToBoard::Run => self.ask_and_answer(sequence, Request::Run).await,
            ToBoard::Stop => self.ask_and_answer(sequence, Request::Stop).await,
            ToBoard::ClearFault => self.ask_and_answer(sequence, Request::ClearFault).await,
            ToBoard::SetParameters(parameters) => {
                let answer = match self.set(parameters, is_idle).await {
                    Ok(()) => Answer::Done { sequence },
                    Err(answer) => refuse(sequence, answer),
                };
                say(answer).await;
            }
            ToBoard::GetParameters => say(Answer::Parameters(self.parameters)).await,
            ToBoard::SaveParameters => match store::save(self.facts.board, &self.parameters) {
                Ok(()) => say(Answer::Done { sequence }).await,
                Err(error) => say(refuse(sequence, error)).await,
            },
            ToBoard::Reference { reference_m } => {
                self.ask_and_answer(sequence, Request::Reference(reference_m)).await;
            }
            ToBoard::Drive { drive_v } => self.ask_and_answer(sequence, Request::Drive(drive_v)).await,
            ToBoard::WaveClear => {
                self.segments.clear();
                self.ask_and_answer(sequence, Request::Reference(0.0)).await;
            }
            ToBoard::WaveSegment(record) => {
                let answer = match self.segments.push(record) {
                    Ok(()) => Answer::Done { sequence },
                    Err(_) => refuse(sequence, WAVE_FULL),
                };
                say(answer).await;
            }
            ToBoard::WaveTable { offset, values } => {
                let answer = match self.table(offset, values).await {
                    Ok(()) => Answer::Done { sequence },
                    Err(reason) => refuse(sequence, reason),
                };
                say(answer).await;
            }
            ToBoard::WaveUse { is_closed_loop } => match self.waveform().await {
                Ok(segments) => {
                    self.ask_and_answer(sequence, Request::Wave { is_closed_loop, segments }).await;
                }
                Err(error) => say(refuse(sequence, error)).await,
            },
            ToBoard::Input(input) => self.ask_and_answer(sequence, Request::Input(input)).await,
            ToBoard::BridgeSample { index, displacement, monitor } => {
                let answer = match self.ask(Request::Bridge { displacement, monitor }).await {
                    Reply::Bridge { drive, drive_v, reference_m, limited_by } => {
                        Answer::Bridge { index, drive, drive_v, reference_m, limited_by }
                    }
                    _ => refuse(sequence, NO_BRIDGE),
                };
                say(answer).await;
            }
            ToBoard::StreamStart { every } => {
                let (every, reason) = stream_pace(self.parameters.rate_hz as u32, every);
                let _ = self.ask(Request::Stream(every)).await;
                say(Answer::StreamStarted { every, reason }).await;
            }
            ToBoard::StreamStop => self.ask_and_answer(sequence, Request::Stream(0)).await,
            ToBoard::CaptureArm { before, trigger } => {
                // What was asked for before goes out first: the loop will write over it, between any two instructions of a read.
                capture::all_read().await;
                self.ask_and_answer(sequence, Request::Capture { before, trigger }).await;
            }
            ToBoard::CaptureRead { from } => {
                capture::want();
                say(Answer::Capture { from }).await;
            }
        }
    }

    /// Checks a set as a whole and puts it in force at one sample.
    async fn set(&mut self, parameters: Parameters, is_idle: bool) -> Result<(), ChangeError> {
        let Change { checked, is_other_rate } = self.parameters.change(&parameters, &self.facts.converters, is_idle)?;
        let next_idx = 1 - self.set_idx;
        // SAFETY: the loop uses the other one; it has answered the last `Apply`, so it has let go of this.
        let checked = unsafe { (*SETS[next_idx].get()).insert(checked) };
        let _ = self.ask(Request::Apply(checked)).await;
        self.set_idx = next_idx;
        self.parameters = parameters;
        if is_other_rate {
            // A waveform is made for one rate.
            let _ = self.ask(Request::Reference(0.0)).await;
        }
        Ok(())
    }

    async fn table(&mut self, offset: u16, values: &[u8]) -> Result<(), &'static str> {
        // The loop lets go of a waveform that may point into the table.
        let _ = self.ask(Request::Reference(0.0)).await;
        // SAFETY: it has let go, and no other task touches the table.
        let table = unsafe { &mut *TABLE.get() };
        fill_table(table, offset, values)
    }

    async fn waveform(&mut self) -> Result<&'static [Segment<'static>], SegmentError> {
        let _ = self.ask(Request::Reference(0.0)).await;
        // SAFETY: the loop has let go of the old waveform, and is given the new one only once it is whole.
        let (waveform, table) = unsafe { (&mut *WAVEFORM.get(), &*TABLE.get()) };
        waveform.clear();
        for record in &self.segments {
            // There is room: both hold the same number.
            let _ = waveform.push(record.build(self.parameters.rate_hz, table)?);
        }
        Ok(waveform)
    }
}

/// Every how many samples one can be sent, and why not every `wanted`.
fn stream_pace(rate_hz: u32, wanted: u16) -> (u16, StreamReason) {
    let least = rate_hz.div_ceil(STREAM_SAMPLES_PER_S) as u16;
    if wanted >= least && wanted > 0 {
        (wanted, StreamReason::AsAsked)
    } else if wanted == 0 && least == 1 {
        (1, StreamReason::AsAsked)
    } else {
        (least, StreamReason::LinkTooSlow)
    }
}

fn refuse(sequence: u16, reason: impl fmt::Display) -> Answer {
    let mut text = Reason(String::new());
    let _ = write!(text, "{reason}");
    Answer::Refused { sequence, reason: text }
}

/// Why something is refused; what is too long ends where the room does.
struct Reason(String<120>);

impl Write for Reason {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().try_for_each(|letter| self.0.push(letter)).or(Ok(()))
    }
}

async fn say(answer: Answer) {
    ANSWERS.send(answer).await;
    shared::SENDABLE.signal(());
}

fn count_bad() {
    BAD_FRAMES.store(BAD_FRAMES.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Takes frames for ever.
#[embassy_executor::task]
pub async fn receive(mut line: Line, mut desk: Desk) {
    let mut receiver = wire::Receiver::new();
    let mut missed = Missed::default();
    let mut bytes = [0; 64];
    loop {
        let n = match line.read(&mut bytes).await {
            Ok(n) => n,
            Err(Disturbed) => {
                // Noise or too much at once: the frame is lost, which its CRC will show; the next one starts anew.
                count_bad();
                continue;
            }
        };
        for byte in &bytes[..n.min(bytes.len())] {
            match receiver.push(*byte) {
                Some(Ok(frame)) => {
                    missed.note(frame.sequence);
                    desk.handle(&frame).await;
                }
                Some(Err(error)) => {
                    count_bad();
                    if let wire::WireError::Version { .. } = error {
                        say(refuse(0, error)).await;
                    }
                }
                None => {}
            }
        }
    }
}

/// Sends for ever.
#[embassy_executor::task]
pub async fn send(mut line: UartTx<'static, Async>, facts: Facts) {
    let mut sender = Sender::default();
    let mut frame = [0; wire::MAX_ENCODED_BYTES];
    let mut block = [0; BLOCK_SAMPLES * wire::SAMPLE_BYTES];
    let mut told_fault = 0;
    loop {
        let state = State::now();
        let n = if let Ok(answer) = ANSWERS.try_receive() {
            encode_answer(&mut sender, &mut frame, &mut block, &answer, &facts)
        } else if state.fault != told_fault {
            told_fault = state.fault;
            if state.fault == 0 {
                continue;
            }
            defmt::warn!("fault {=u8}", state.fault);
            let sample = shared::FAULT_SAMPLE.load(Ordering::Relaxed);
            sender.encode(&ToHost::Fault { code: state.fault, sample }, &mut frame)
        } else if let Some((first, every, n_bytes)) = next_block(&mut block) {
            let lost = shared::DROPPED.load(Ordering::Relaxed);
            sender.encode(&ToHost::StreamBlock { first, every, lost, samples: &block[..n_bytes] }, &mut frame)
        } else {
            shared::SENDABLE.wait().await;
            continue;
        };
        if let Ok(n) = n {
            // The transmitter has no error to report: it sends, or the line is not there.
            let _ = line.write(&frame[..n]).await;
        }
    }
}

/// Fills `block` with samples at an even distance: a whole block, or what has waited for 0.1 s.
fn next_block(block: &mut [u8]) -> Option<(u32, u16, usize)> {
    let records = &shared::RECORDS;
    // SAFETY: here and below: the sender is the only one that takes records.
    let first = unsafe { records.peek() }?.number;
    let age = shared::SAMPLES.load(Ordering::Relaxed).wrapping_sub(first);
    if records.len() < BLOCK_SAMPLES && age < 2048 {
        return None;
    }
    let mut n_bytes = 0;
    let mut last = None::<u32>;
    let mut every = None::<u32>;
    let (places, _) = block.as_chunks_mut::<{ wire::SAMPLE_BYTES }>();
    for place in places {
        let Some(record) = (unsafe { records.peek() }) else { break };
        if let Some(last) = last {
            let distance = record.number.wrapping_sub(last);
            // A sample that was dropped ends the block, so that numbers inside of one are certain.
            if *every.get_or_insert(distance) != distance {
                break;
            }
        }
        last = Some(record.number);
        *place = record.sample.to_bytes();
        n_bytes += place.len();
        let _ = unsafe { records.pop() };
    }
    Some((first, every.unwrap_or(1) as u16, n_bytes))
}

fn encode_answer(
    sender: &mut Sender,
    frame: &mut [u8],
    block: &mut [u8],
    answer: &Answer,
    facts: &Facts,
) -> Result<usize, wire::WireError> {
    let message = match answer {
        Answer::Identity { reference_step_m } => ToHost::Identity(Identity {
            version: wire::VERSION,
            board: facts.board,
            firmware: concat!(env!("CARGO_PKG_VERSION"), " ", env!("HYSTERON_COMMIT")),
            converters: facts.converters,
            reference_step_m: *reference_step_m,
            table_samples: TABLE_SAMPLES as u16,
            segments: SEGMENTS as u16,
            capture_samples: capture::SAMPLES as u16,
        }),
        Answer::Done { sequence } => ToHost::Done { sequence: *sequence },
        Answer::Refused { sequence, reason } => ToHost::Refused { sequence: *sequence, reason: &reason.0 },
        Answer::Parameters(parameters) => ToHost::Parameters(*parameters),
        Answer::Status => ToHost::Status(status(facts.reset)),
        Answer::Bridge { index, drive, drive_v, reference_m, limited_by } => ToHost::BridgeDrive {
            index: *index,
            drive: *drive,
            drive_v: *drive_v,
            reference_m: *reference_m,
            limited_by: *limited_by,
            mode: State::now().mode,
        },
        Answer::StreamStarted { every, reason } => ToHost::StreamStarted { every: *every, reason: *reason },
        Answer::Capture { from } => {
            let (n_bytes, total, first) = capture::read(*from, block);
            ToHost::CaptureBlock { from: *from, total, first, samples: &block[..n_bytes] }
        }
    };
    sender.encode(&message, frame)
}

fn status(reset: ResetCause) -> Status {
    let state = State::now();
    let ready = shared::READY.load(Ordering::Relaxed);
    Status {
        mode: state.mode,
        fault: state.fault,
        reset,
        input: state.input,
        samples: shared::SAMPLES.load(Ordering::Relaxed),
        overruns: shared::OVERRUNS.load(Ordering::Relaxed),
        lost_samples: shared::LOST.load(Ordering::Relaxed),
        ready_cycles: ready as u16,
        ready_max_cycles: (ready >> 16) as u16,
        bad_frames: BAD_FRAMES.load(Ordering::Relaxed),
    }
}
