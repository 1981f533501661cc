//! What must hold for every message and for any bytes: round trip, no damaged frame taken for another, back in step after garbage,
//! never a panic.

use proptest::collection::vec;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wire::*;

/// Any f32 that is equal to itself, so that messages can be compared.
fn number() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(f32::from_bits).prop_filter("NaN is not equal to itself", |x| !x.is_nan())
}

fn parameters() -> impl Strategy<Value = Parameters> {
    (proptest::array::uniform19(number()), any::<[u16; 3]>()).prop_map(|(f, n)| Parameters {
        rate_hz: f[0],
        kp_v_per_m: f[1],
        ki_v_per_m_s: f[2],
        feedforward_v_per_m: f[3],
        drive_min_v: f[4],
        drive_max_v: f[5],
        slew_v_per_s: f[6],
        reference_max_m: f[7],
        reference_rate_m_per_s: f[8],
        reference_acceleration_m_per_s2: f[9],
        trip_m: f[10],
        stop_time_s: f[11],
        adc_zero_v: f[12],
        sensor_m_per_v: f[13],
        amplifier_v_per_v: f[14],
        monitor_zero_v: f[15],
        monitor_v_per_v: f[16],
        monitor_tolerance_v: f[17],
        link_timeout_s: f[18],
        monitor_samples: n[0],
        rail_codes: n[1],
        overrun_limit: n[2],
    })
}

fn wave() -> impl Strategy<Value = Wave> {
    let three = || (number(), number(), number());
    prop_oneof![
        number().prop_map(|level| Wave::Hold { level }),
        three().prop_map(|(amplitude, frequency_hz, _)| Wave::Square { amplitude, frequency_hz }),
        three().prop_map(|(amplitude, frequency_hz, _)| Wave::Sine { amplitude, frequency_hz }),
        three().prop_map(|(amplitude, frequency_hz, _)| Wave::Triangle { amplitude, frequency_hz }),
        three().prop_map(|(amplitude, frequency_hz, _)| Wave::DecayingSine { amplitude, frequency_hz }),
        three().prop_map(|(amplitude, from_hz, to_hz)| Wave::LinearSweep { amplitude, from_hz, to_hz }),
        three().prop_map(|(amplitude, from_hz, to_hz)| Wave::LogSweep { amplitude, from_hz, to_hz }),
        (number(), any::<u32>(), any::<u32>()).prop_map(|(amplitude, levels, hold_samples)| Wave::Ladder {
            amplitude,
            levels,
            hold_samples
        }),
        any::<(u16, u16)>().prop_map(|(offset, length)| Wave::Table { offset, length }),
    ]
}

/// Every kind of request. `blob` is what borrowed ones point to.
fn to_board(blob: &'static [u8]) -> impl Strategy<Value = ToBoard<'static>> {
    let trigger = prop_oneof![Just(Trigger::Now), Just(Trigger::Run), Just(Trigger::Fault)];
    prop_oneof![
        Just(ToBoard::Hello),
        Just(ToBoard::KeepAlive),
        Just(ToBoard::Arm),
        Just(ToBoard::Run),
        Just(ToBoard::Stop),
        Just(ToBoard::ClearFault),
        parameters().prop_map(ToBoard::SetParameters),
        Just(ToBoard::GetParameters),
        Just(ToBoard::SaveParameters),
        number().prop_map(|reference_m| ToBoard::Reference { reference_m }),
        number().prop_map(|drive_v| ToBoard::Drive { drive_v }),
        Just(ToBoard::WaveClear),
        (wave(), any::<u32>()).prop_map(|(wave, samples)| ToBoard::WaveSegment(SegmentRecord { wave, samples })),
        any::<u16>().prop_map(move |offset| ToBoard::WaveTable { offset, values: blob }),
        any::<bool>().prop_map(|is_closed_loop| ToBoard::WaveUse { is_closed_loop }),
        Just(ToBoard::Input(InputSource::Bridge)),
        any::<(u32, u16, u16)>().prop_map(|(index, displacement, monitor)| ToBoard::BridgeSample {
            index,
            displacement,
            monitor
        }),
        any::<u16>().prop_map(|every| ToBoard::StreamStart { every }),
        Just(ToBoard::StreamStop),
        (any::<u16>(), trigger).prop_map(|(before, trigger)| ToBoard::CaptureArm { before, trigger }),
        any::<u16>().prop_map(|from| ToBoard::CaptureRead { from }),
    ]
}

const REASON: &str = "arm is refused in mode fault: \u{b5}m";

fn to_host(blob: &'static [u8]) -> impl Strategy<Value = ToHost<'static>> {
    let status = any::<(u8, u8, [u32; 4], [u16; 2])>().prop_map(|(mode, fault, counts, cycles)| {
        ToHost::Status(Status {
            mode,
            fault,
            reset: ResetCause::Watchdog,
            input: InputSource::Analog,
            samples: counts[0],
            overruns: counts[1],
            lost_samples: counts[2],
            ready_cycles: cycles[0],
            ready_max_cycles: cycles[1],
            bad_frames: counts[3],
        })
    });
    prop_oneof![
        number().prop_map(|step| ToHost::Identity(identity(step))),
        any::<u16>().prop_map(|sequence| ToHost::Done { sequence }),
        any::<u16>().prop_map(|sequence| ToHost::Refused { sequence, reason: REASON }),
        parameters().prop_map(ToHost::Parameters),
        status,
        (any::<(u32, u16, u8, u8)>(), number(), number()).prop_map(
            |((index, drive, limited_by, mode), drive_v, reference_m)| ToHost::BridgeDrive {
                index,
                drive,
                drive_v,
                reference_m,
                limited_by,
                mode
            }
        ),
        any::<u16>().prop_map(|every| ToHost::StreamStarted { every, reason: StreamReason::LinkTooSlow }),
        any::<(u32, u16, u32)>().prop_map(move |(first, every, lost)| ToHost::StreamBlock {
            first,
            every,
            lost,
            samples: blob
        }),
        any::<(u16, u16, u32)>().prop_map(move |(from, total, first)| ToHost::CaptureBlock {
            from,
            total,
            first,
            samples: blob
        }),
        any::<(u8, u32)>().prop_map(|(code, sample)| ToHost::Fault { code, sample }),
    ]
}

fn identity(reference_step_m: f32) -> Identity<'static> {
    Identity {
        version: VERSION,
        board: "nucleo-g474re",
        firmware: "0.1.0",
        converters: NUCLEO,
        reference_step_m,
        table_samples: 4096,
        segments: 16,
        capture_samples: 2048,
    }
}

const NUCLEO: Converters = Converters::NUCLEO_G474RE;

fn encoded<M: serde::Serialize + ?Sized>(message: &M) -> Vec<u8> {
    let mut bytes = [0; MAX_ENCODED_BYTES];
    let n = Sender::default().encode(message, &mut bytes).expect("it fits a frame");
    bytes[..n].to_vec()
}

/// Feeds bytes; calls `found` for each whole frame and counts what was none.
fn feed(receiver: &mut Receiver, bytes: &[u8], mut found: impl FnMut(&Frame<'_>)) -> usize {
    let mut errors = 0;
    for byte in bytes {
        match receiver.push(*byte) {
            Some(Ok(frame)) => found(&frame),
            Some(Err(_)) => errors += 1,
            None => {}
        }
    }
    errors
}

static BLOB: [u8; 480] = {
    let mut blob = [0; 480];
    let mut i = 0;
    while i < blob.len() {
        // Zeros, and runs without one that are longer than COBS' 254.
        blob[i] = if i % 300 < 20 { 0 } else { (i % 255) as u8 + 1 };
        i += 1;
    }
    blob
};

proptest! {
    #[test]
    fn requests_come_back_as_they_went((message, _) in (0..=480_usize).prop_flat_map(|n| (to_board(&BLOB[..n]), Just(n)))) {
        let mut seen = 0;
        let errors = feed(&mut Receiver::new(), &encoded(&message), |frame| {
            seen += 1;
            assert_eq!(frame.message::<ToBoard>(), Ok(message));
        });
        prop_assert_eq!((seen, errors), (1, 0));
    }

    #[test]
    fn answers_come_back_as_they_went((message, _) in (0..=480_usize).prop_flat_map(|n| (to_host(&BLOB[..n]), Just(n)))) {
        let mut seen = 0;
        let errors = feed(&mut Receiver::new(), &encoded(&message), |frame| {
            seen += 1;
            assert_eq!(frame.message::<ToHost>(), Ok(message));
        });
        prop_assert_eq!((seen, errors), (1, 0));
    }

    /// Bits flipped before COBS: with up to three of them CRC-32 is certain (Hamming distance 4 up to 11 kB).
    #[test]
    fn up_to_three_flipped_bits_are_always_found(message in to_host(&BLOB), flips in vec(any::<u16>(), 1..=3)) {
        let good = encoded(&message);
        let mut plain = good[..good.len() - 1].to_vec();
        let n = cobs_decode(&mut plain);
        plain.truncate(n);
        let bits: std::collections::BTreeSet<usize> = flips.iter().map(|flip| usize::from(*flip) % (8 * n)).collect();
        for bit in &bits {
            plain[bit / 8] ^= 1 << (bit % 8);
        }
        let mut seen = 0;
        feed(&mut Receiver::new(), &cobs_encode(&plain), |_| seen += 1);
        prop_assert_eq!(seen, 0);
    }

    /// Any bytes, then a 0, then a frame: the frame is found.
    #[test]
    fn garbage_costs_no_more_than_itself(garbage in vec(any::<u8>(), 0..2000), message in to_board(&BLOB[..60])) {
        let mut receiver = Receiver::new();
        feed(&mut receiver, &garbage, |_| {});
        feed(&mut receiver, &[0], |_| {});
        let mut seen = 0;
        let errors = feed(&mut receiver, &encoded(&message), |frame| {
            seen += 1;
            assert_eq!(frame.message::<ToBoard>(), Ok(message));
        });
        prop_assert_eq!((seen, errors), (1, 0));
    }

    /// Whole frames with any content: read or refused, never a panic, and what is read is written the same again.
    #[test]
    fn any_content_is_read_or_refused(content in vec(any::<u8>(), 0..100)) {
        let mut plain = vec![VERSION, 0, 0];
        plain.extend(&content);
        plain.extend(crc32(&plain).to_le_bytes());
        let mut frames = 0;
        feed(&mut Receiver::new(), &cobs_encode(&plain), |frame| {
            frames += 1;
            let _ = frame.message::<ToHost>();
            if let Ok(message) = frame.message::<ToBoard>() {
                let again = encoded(&message);
                feed(&mut Receiver::new(), &again, |frame| {
                    assert_eq!(format!("{:?}", frame.message::<ToBoard>()), format!("{:?}", Ok::<_, WireError>(message)));
                });
            }
        });
        prop_assert_eq!(frames, 1);
    }

    /// A checked set never panics, whatever it is, and what passes has an exact period and a law that exists.
    #[test]
    fn any_parameters_are_checked_without_a_panic(parameters in parameters(), rate_hz in prop_oneof![Just(20e3_f32), number()]) {
        if let Ok(checked) = (Parameters { rate_hz, ..parameters }).check(&NUCLEO) {
            prop_assert_eq!(checked.period_cycles as f32 * rate_hz, 170e6);
        }
    }
}

/// Bytes as a broken line delivers them: whole frames, frames cut, bytes changed, inserted, dropped, and noise. Two million bytes; nothing
/// panics, no frame that comes out was not sent, and most undamaged ones are found.
#[test]
fn a_broken_line_delivers_nothing_that_was_not_sent() {
    let mut random = Pcg64::seed_from_u64(5);
    let mut receiver = Receiver::new();
    let mut sender = Sender::default();
    let (mut sent, mut found, mut errors) = (0_u32, 0_u32, 0);
    let mut bytes = [0; MAX_ENCODED_BYTES];
    let mut total = 0;
    while total < 2_000_000 {
        let length = random.random_range(0..=480);
        let message = ToHost::StreamBlock { first: sent, every: 1, lost: !sent, samples: &BLOB[..length] };
        let n = sender.encode(&message, &mut bytes).unwrap();
        let mut line = bytes[..n].to_vec();
        let damage = random.random_range(0..8);
        match damage {
            0 => {
                let at = random.random_range(0..n);
                line[at] ^= 1 << random.random_range(0..8);
            }
            1 => line.truncate(random.random_range(0..n)),
            2 => line.insert(random.random_range(0..n), random.random()),
            3 => {
                line.remove(random.random_range(0..n));
            }
            4 => line.extend((0..random.random_range(1..700)).map(|_| random.random::<u8>())),
            _ => {}
        }
        sent += 1;
        total += line.len();
        errors += feed(&mut receiver, &line, |frame| {
            // Its own numbers say whether it is one that was sent: `lost` is `first` inverted, the samples are the blob's.
            match frame.message::<ToHost>() {
                Ok(ToHost::StreamBlock { first, lost, samples, .. }) => {
                    assert!(first < sent && lost == !first && samples == &BLOB[..samples.len()]);
                    assert_eq!(frame.sequence, first as u16);
                    found += 1;
                }
                other => panic!("{other:?} was never sent"),
            }
        });
    }
    // 3 of 8 are undamaged, 1 of 8 has noise only behind it; each cut or noisy one may swallow its successor.
    assert!(found > sent * 3 / 8 && found < sent * 5 / 8, "{found} of {sent}");
    assert!(errors > sent as usize / 4, "{errors} of {sent}");
}

/// Every single byte of a short and of a long frame replaced by every other value: never taken for another message.
#[test]
fn no_single_wrong_byte_passes() {
    for message in [ToBoard::Arm, ToBoard::WaveTable { offset: 300, values: &BLOB[..300] }] {
        let good = encoded(&message);
        for at in 0..good.len() {
            for wrong in 0..=255_u8 {
                let mut line = good.clone();
                line[at] = wrong;
                feed(&mut Receiver::new(), &line, |frame| assert_eq!(frame.message::<ToBoard>(), Ok(message)));
            }
        }
    }
}

#[test]
fn a_mismatch_is_refused_in_words() {
    let board = identity(1e-9);
    assert_eq!(board.check(), Ok(()));
    let other = Identity { version: VERSION + 1, ..board };
    let words = other.check().unwrap_err().to_string();
    assert_eq!(
        words,
        "the board speaks version 2 of the link, this program version 1: flash the firmware of this release"
    );
    let broken = Identity { converters: Converters { latch_cycles: 3400, ..NUCLEO }, ..board };
    assert_eq!(broken.check(), Err(Mismatch::Timing));
}

/// Numbers of variants are what an older host or board goes by: a change here needs a new [`VERSION`].
#[test]
fn the_numbers_of_the_messages_stand() {
    let body = |message: &ToBoard<'_>| {
        let mut plain = encoded(message);
        plain.pop();
        let n = cobs_decode(&mut plain);
        plain[3..n - 4].to_vec()
    };
    assert_eq!(body(&ToBoard::Hello), [0]);
    assert_eq!(body(&ToBoard::Arm), [2]);
    assert_eq!(body(&ToBoard::Stop), [4]);
    assert_eq!(body(&ToBoard::Reference { reference_m: 1.0 }), [9, 0, 0, 128, 63]);
    assert_eq!(body(&ToBoard::Input(InputSource::Bridge)), [15, 1]);
    assert_eq!(body(&ToBoard::BridgeSample { index: 300, displacement: 5, monitor: 6 }), [16, 172, 2, 5, 6]);
    assert_eq!(body(&ToBoard::CaptureRead { from: 0 }), [20, 0]);
}

/// The CRC once more, bit by bit, so that the library's table has a witness.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes
        .iter()
        .fold(!0_u32, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1))))
}

fn cobs_encode(plain: &[u8]) -> Vec<u8> {
    let mut line = vec![0; plain.len() + plain.len() / 254 + 2];
    let n = cobs::encode(plain, &mut line);
    line.truncate(n);
    line.push(0);
    line
}

fn cobs_decode(line: &mut [u8]) -> usize {
    cobs::decode_in_place(line).expect("COBS")
}
