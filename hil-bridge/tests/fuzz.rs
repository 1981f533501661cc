//! Nonsense on the link, in both directions, for a limited time: nobody panics, nobody hangs, nothing wrong drives the plant.
//!
//! `HYSTERON_FUZZ_SECONDS` is how long each test goes on (half a second where it is not set; `cargo xtask fuzz` sets it), `HYSTERON_FUZZ_SEED` the
//! first seed. A failure names its seed, and that seed alone repeats it.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{FaultCode, ModeName};
use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::lockstep::{Task, prepare_task, probe, run};
use hil_bridge::pins;
use hil_bridge::session::{Session, SessionError};
use plant_sim::experiment::Setup;
use plant_sim::replay::Start;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::ser::{Serialize, SerializeTuple, Serializer};
use std::cell::Cell;
use std::convert::Infallible;
use std::time::{Duration, Instant};
use support::{RATE_HZ, noisy, pi1, waveform};
use wire::{
    Converters, Identity, InputSource, MAX_ENCODED_BYTES, Parameters, Receiver, ResetCause, SegmentRecord, Sender,
    Status, StreamReason, ToBoard, ToHost, Trigger, Wave,
};

/// Runs `case` with one seed after the other until the time is over; how many.
fn storm(case: impl Fn(&mut Pcg64)) -> u64 {
    let number = |name: &str, otherwise: f64| {
        std::env::var(name).map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name}: not a number")))
    };
    let time = Duration::from_secs_f64(number("HYSTERON_FUZZ_SECONDS", 0.5));
    let first = number("HYSTERON_FUZZ_SEED", 1.0) as u64;
    let begun = Instant::now();
    let mut seed = first;
    while begun.elapsed() < time {
        let named = Named(seed);
        case(&mut Pcg64::seed_from_u64(seed));
        drop(named);
        seed += 1;
    }
    println!("seeds {first} to {seed}");
    seed - first
}

/// Names the seed if it is dropped by a panic.
struct Named(u64);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("HYSTERON_FUZZ_SEED={} repeats this", self.0);
        }
    }
}

/// A body that may be no message.
struct Body(Vec<u8>);

impl Serialize for Body {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        self.0.iter().try_for_each(|byte| tuple.serialize_element(byte))?;
        tuple.end()
    }
}

fn bytes(random: &mut Pcg64, most: usize) -> Vec<u8> {
    (0..random.random_range(0..=most)).map(|_| random.random()).collect()
}

/// A number that is usual, extreme or none.
fn real(random: &mut Pcg64) -> f32 {
    match random.random_range(0..6) {
        0 => f32::from_bits(random.random()),
        1 => [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MAX][random.random_range(0..6)],
        2 => random.random_range(-1e-3..1e-3),
        _ => random.random_range(-200.0..200.0),
    }
}

fn parameters(random: &mut Pcg64) -> Parameters {
    let mut parameters = Parameters::NUCLEO_PI1;
    let fields: [&mut f32; 8] = [
        &mut parameters.rate_hz,
        &mut parameters.kp_v_per_m,
        &mut parameters.ki_v_per_m_s,
        &mut parameters.feedforward_v_per_m,
        &mut parameters.drive_max_v,
        &mut parameters.slew_v_per_s,
        &mut parameters.sensor_m_per_v,
        &mut parameters.link_timeout_s,
    ];
    for field in fields {
        match random.random_range(0..8) {
            0 => *field = real(random),
            1 => *field *= random.random_range(0.5..2.0),
            _ => {}
        }
    }
    parameters
}

/// Each field may be anything, few of them or many.
fn converters(random: &mut Pcg64) -> Converters {
    let mut converters = Converters::NUCLEO_G474RE;
    let share = if random.random() { 0.1 } else { 0.5 };
    for bits in [&mut converters.adc_bits, &mut converters.monitor_bits, &mut converters.dac_bits] {
        if random.random_bool(share) {
            *bits = if random.random() { random.random() } else { random.random_range(12..=16) };
        }
    }
    let volts = [
        &mut converters.adc_full_scale_v,
        &mut converters.monitor_full_scale_v,
        &mut converters.dac_full_scale_v,
        &mut converters.dac_margin_v,
    ];
    for field in volts {
        if random.random_bool(share) {
            *field = real(random);
        }
    }
    let counts = [
        &mut converters.timer_hz,
        &mut converters.period_min_cycles,
        &mut converters.period_max_cycles,
        &mut converters.hold_cycles,
        &mut converters.latch_cycles,
    ];
    for field in counts {
        if random.random_bool(share) {
            *field = match random.random_range(0..3) {
                0 => random.random(),
                1 => [0, 1, u32::MAX][random.random_range(0..3)],
                _ => random.random_range(0..10_000),
            };
        }
    }
    converters
}

fn wave(random: &mut Pcg64) -> Wave {
    let (amplitude, frequency_hz) = (real(random), real(random));
    match random.random_range(0..6) {
        0 => Wave::Hold { level: amplitude },
        1 => Wave::Sine { amplitude, frequency_hz },
        2 => Wave::DecayingSine { amplitude, frequency_hz },
        3 => Wave::LogSweep { amplitude, from_hz: frequency_hz, to_hz: real(random) },
        4 => Wave::Ladder { amplitude, levels: random.random(), hold_samples: random.random() },
        _ => Wave::Table { offset: random.random_range(0..6000), length: random.random_range(0..6000) },
    }
}

/// What a host may say, sensible or not.
fn request<'b>(random: &mut Pcg64, values: &'b [u8]) -> ToBoard<'b> {
    match random.random_range(0..20) {
        0 => ToBoard::Hello,
        1 => ToBoard::KeepAlive,
        2 => ToBoard::Arm,
        3 => ToBoard::Run,
        4 => ToBoard::Stop,
        5 => ToBoard::ClearFault,
        6 => ToBoard::SetParameters(parameters(random)),
        7 => ToBoard::GetParameters,
        8 => ToBoard::Reference { reference_m: real(random) },
        9 => ToBoard::Drive { drive_v: real(random) },
        10 => ToBoard::WaveClear,
        11 => ToBoard::WaveSegment(SegmentRecord { wave: wave(random), samples: random.random() }),
        12 => ToBoard::WaveTable { offset: random.random_range(0..5000), values },
        13 => ToBoard::WaveUse { is_closed_loop: random.random() },
        14 => ToBoard::Input(InputSource::Bridge),
        15 => ToBoard::Input(InputSource::Analog),
        16 => ToBoard::CaptureArm { before: random.random(), trigger: Trigger::Now },
        _ => ToBoard::BridgeSample {
            index: random.random(),
            displacement: random.random_range(0..5000),
            monitor: random.random_range(0..5000),
        },
    }
}

/// A frame of `message`, or of a body that is none; then perhaps damaged.
fn framed<M: Serialize>(random: &mut Pcg64, sender: &mut Sender, message: &M) -> Vec<u8> {
    let mut frame = [0; MAX_ENCODED_BYTES];
    let body = Body(bytes(random, 300));
    let is_message = random.random_bool(0.9);
    let encoded = if is_message { sender.encode(message, &mut frame) } else { sender.encode(&body, &mut frame) };
    let mut line = frame[..encoded.unwrap_or(0)].to_vec();
    match random.random_range(0..10) {
        0 if !line.is_empty() => {
            let at = random.random_range(0..line.len());
            line[at] ^= 1 << random.random_range(0..8);
        }
        1 => line.truncate(random.random_range(0..=line.len())),
        2 => line.splice(0..0, bytes(random, 30)).for_each(drop),
        3 => line = bytes(random, 700),
        _ => {}
    }
    line
}

#[test]
fn a_board_takes_anything_and_drives_within_its_limits() {
    storm(|random| {
        let mut board = InProcess::nucleo();
        let (mut sender, mut receiver) = (Sender::default(), Receiver::new());
        // The widest that any set may allow: what the converter reaches.
        let span_v = 1.651 * 90.0 / 1.45;
        let mut answer = Vec::new();
        for _ in 0..300 {
            let values = bytes(random, 400);
            let request = request(random, &values);
            let line = framed(random, &mut sender, &request);
            board.send(&line).unwrap();
            answer.clear();
            board.receive(Duration::ZERO, &mut answer).unwrap();
            for byte in &answer {
                let Some(frame) = receiver.push(*byte) else { continue };
                // What a board says is always whole, and a message.
                match frame.unwrap().message::<ToHost<'_>>().unwrap() {
                    ToHost::BridgeDrive { drive, drive_v, mode, .. } => {
                        assert!(drive < 4096 && drive_v.abs() <= span_v, "{drive} {drive_v}");
                        assert!(mode <= ModeName::Fault as u8);
                    }
                    ToHost::Fault { code, .. } => assert!(FaultCode::from_number(code).is_some()),
                    ToHost::Parameters(parameters) => {
                        assert!(parameters.check(&Converters::NUCLEO_G474RE).is_ok(), "{parameters:?}");
                    }
                    ToHost::Refused { reason, .. } => assert!(!reason.is_empty()),
                    _ => {}
                }
            }
        }
        // And it can be spoken to as before.
        let mut session = Session::new(board);
        assert_eq!(session.greet().unwrap().board, "in-process");
    });
}

/// A board that says anything, often what was asked for, on a clock of its own.
struct Babble {
    random: Pcg64,
    sender: Sender,
    heard: Receiver,
    /// Numbers and indices of what was asked.
    asked: Vec<(u16, Option<u32>, u8)>,
    now: Duration,
}

impl Babble {
    fn says(&mut self, asked: (u16, Option<u32>, u8)) -> Vec<u8> {
        let random = &mut self.random;
        let (sequence, index, kind) = asked;
        let status = Status {
            mode: if random.random_bool(0.7) { 0 } else { random.random_range(0..7) },
            fault: if random.random_bool(0.8) { 0 } else { random.random() },
            reset: ResetCause::PowerOn,
            input: if random.random() { InputSource::Bridge } else { InputSource::Analog },
            samples: random.random_range(0..10),
            overruns: 0,
            lost_samples: 0,
            ready_cycles: 0,
            ready_max_cycles: 0,
            bad_frames: 0,
        };
        let converters = if random.random_bool(0.05) { converters(random) } else { Converters::NUCLEO_G474RE };
        let identity = Identity {
            version: if random.random_bool(0.99) { wire::VERSION } else { random.random() },
            board: "babble",
            firmware: if random.random_bool(0.97) { env!("CARGO_PKG_VERSION") } else { "0.0.0 x" },
            converters,
            reference_step_m: real(random),
            table_samples: 4096,
            segments: 16,
            capture_samples: 0,
        };
        let mut samples = bytes(random, 480);
        // Mostly of a loop that runs, one after the other, so that some become rows.
        for flags in samples.iter_mut().skip(9).step_by(10).filter(|flags| **flags > 50) {
            *flags = ModeName::Running as u8;
        }
        // Mostly the answer that fits, so that a conversation gets somewhere.
        let kind = if random.random_bool(0.9) { kind } else { random.random_range(0..9) };
        let index = if random.random_bool(0.9) { index.unwrap_or(0) } else { random.random() };
        let [first, every] = if random.random_bool(0.9) { [random.random_range(0..100), 1] } else { random.random() };
        let every = every as u16;
        let message = match kind {
            0 => ToHost::Identity(identity),
            1 => ToHost::Status(status),
            2 => ToHost::Parameters(parameters(random)),
            3 => ToHost::BridgeDrive {
                index,
                drive: random.random(),
                drive_v: real(random),
                reference_m: real(random),
                limited_by: random.random(),
                mode: random.random_range(0..7),
            },
            4 => ToHost::StreamStarted { every: random.random_range(0..3), reason: StreamReason::AsAsked },
            5 => ToHost::StreamBlock { first, every, lost: 0, samples: &samples },
            6 => ToHost::Fault { code: random.random(), sample: random.random() },
            7 => ToHost::Refused { sequence, reason: "no" },
            _ => ToHost::Done { sequence },
        };
        framed(random, &mut self.sender, &message)
    }
}

impl Link for Babble {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        for byte in bytes {
            let Some(Ok(frame)) = self.heard.push(*byte) else { continue };
            let sequence = frame.sequence;
            let (index, kind) = match frame.message::<ToBoard<'_>>() {
                Ok(ToBoard::Hello) => (None, 0),
                Ok(ToBoard::KeepAlive) => (None, 1),
                Ok(ToBoard::GetParameters) => (None, 2),
                Ok(ToBoard::BridgeSample { index, .. }) => (Some(index), 3),
                Ok(ToBoard::StreamStart { .. }) => (None, 4),
                _ => (None, 8),
            };
            self.asked.push((sequence, index, kind));
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        self.now += Duration::from_micros(50);
        if self.random.random_bool(0.001) {
            return Err(LinkError::Closed);
        }
        let answered = std::mem::take(&mut self.asked);
        for asked in &answered {
            let says = self.says(*asked);
            into.extend(says);
        }
        if answered.is_empty() {
            self.now += patience;
            if self.random.random_bool(0.5) {
                // What comes by itself.
                let says = self.says((0, None, 5));
                into.extend(says);
            }
        }
        Ok(())
    }

    fn now(&mut self) -> Duration {
        self.now
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }

    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        self.now += time;
        Ok(())
    }
}

#[test]
fn a_host_survives_any_board_and_ends() {
    let (chain, settings, waveform) = (noisy(), pi1(), waveform("step:40um@1s"));
    let start = Start::relaxed(&chain);
    let recorded = Cell::new([0_u64; 2]);
    let cases = storm(|random| {
        let babble = |seed: u64| Babble {
            random: Pcg64::seed_from_u64(seed),
            sender: Sender::default(),
            heard: Receiver::new(),
            asked: Vec::new(),
            now: Duration::ZERO,
        };
        let said = |error: &SessionError| assert!(!error.to_string().contains('\n'), "{error}");
        let mut session = Session::new(babble(random.random()));
        if let Err(error) = session.greet() {
            said(&error);
        }
        let _ = probe::<_, Infallible>(&mut session, 50);
        for input in [InputSource::Bridge, InputSource::Analog] {
            let mut session = Session::new(babble(random.random()));
            let task = Task {
                own: None,
                settings: Some(&settings),
                rate_hz: RATE_HZ,
                waveform: &waveform,
                is_closed_loop: true,
                input,
            };
            let Ok(ready) = prepare_task::<_, Infallible>(&mut session, &task, random.random()) else { continue };
            let setup =
                Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: 100, latency_s: 10e-6, seed: 1 };
            let mut rows = 0;
            let _ = match input {
                InputSource::Bridge => run(&mut session, &ready, &setup, |_, row| {
                    rows += 1;
                    assert!(row.command_v.is_finite() && row.displacement_m.is_finite());
                    Ok::<(), Infallible>(())
                }),
                InputSource::Analog => pins::run(&mut session, &ready, 100, |_, row| {
                    rows += 1;
                    assert!(row.command_v.is_finite() && row.index < 100);
                    Ok::<(), Infallible>(())
                }),
            };
            assert!(rows <= 100, "{rows}");
            let mut sum = recorded.get();
            sum[usize::from(input == InputSource::Analog)] += rows;
            recorded.set(sum);
            let statistics = session.statistics();
            assert!(statistics.answered + statistics.lost <= statistics.requests, "{statistics:?}");
        }
    });
    // It got as far as loops that ran, both ways.
    println!("rows over the bridge and of pins: {:?}", recorded.get());
    // One case in a hundred comes that far.
    assert!(cases < 2000 || recorded.get().iter().all(|rows| *rows > 0), "{:?}", recorded.get());
}
