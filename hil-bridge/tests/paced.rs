//! The loop in real time, on a clock that the test owns: when samples are taken, what late answers do, and what loop that makes.
#![allow(clippy::unwrap_used, reason = "a test may unwrap, as clippy.toml says, and so may what tests share")]

mod support;

use control_core::{ModeName, Settings};
use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::lockstep::{Outcome, Row, prepare, probe};
use hil_bridge::paced::{TooFast, check, latency_s, run};
use hil_bridge::session::Session;
use plant_sim::controller::Controller;
use plant_sim::experiment::{Bench, Program, Setup, closed_loop};
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::convert::Infallible;
use std::time::Duration;
use support::{noisy, root};
use virtual_board::waveform::Waveform;

const RATE_HZ: f64 = 5e3;
const SAMPLES: usize = 500;
const TRIP: Duration = Duration::from_micros(30);

/// A board in process whose answers take time on a clock that only this moves: 30 us, and for every `slow`th `Slow` more.
struct Timed {
    board: InProcess,
    now: Duration,
    answers: u32,
    slow: Option<(u32, Duration)>,
    sent_at: Vec<Duration>,
}

impl Timed {
    fn new() -> Timed {
        Timed { board: InProcess::nucleo(), now: Duration::ZERO, answers: 0, slow: None, sent_at: Vec::new() }
    }
}

impl Link for Timed {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.sent_at.push(self.now);
        self.board.send(bytes)
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        let had = into.len();
        self.board.receive(patience, into)?;
        if into.len() > had {
            self.answers += 1;
            self.now += TRIP;
            if let Some((_, more)) = self.slow.filter(|(every, _)| self.answers.is_multiple_of(*every)) {
                self.now += more;
            }
        } else {
            self.now += patience;
        }
        Ok(())
    }

    fn now(&mut self) -> Duration {
        self.now
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(100)
    }

    fn pause(&mut self, time: Duration) -> Result<(), LinkError> {
        self.now += time;
        Ok(())
    }
}

fn pi2() -> Settings {
    Controller::read(&root().join("controllers/pi2.toml")).unwrap().settings(RATE_HZ)
}

/// A paced run: its rows, its outcome, and when its samples went out. The host is elsewhere after every `stalled`th row.
fn paced(slow: Option<(u32, Duration)>, stalled: Option<(usize, Duration)>) -> (Vec<Row>, Outcome, Vec<Duration>) {
    let mut chain = noisy();
    chain.sensor.noise_m = 0.0;
    let mut session = Session::new(Timed::new());
    let waveform = Waveform::new(&Spec::parse("step:40um@1s").unwrap(), RATE_HZ).unwrap();
    let ready = prepare::<_, Infallible>(&mut session, &pi2(), &waveform, false).unwrap();
    let start = Start::relaxed(&chain);
    let latency_s = latency_s(RATE_HZ);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s, seed: 1 };
    let mut rows = Vec::new();
    session.link().slow = slow;
    // Arm and run come first.
    let before = session.link().sent_at.len() + 2;
    let outcome = run(&mut session, &ready, &mut Bench::new(&setup), SAMPLES, |session, row| {
        rows.push(*row);
        if let Some((_, time)) = stalled.filter(|(every, _)| rows.len().is_multiple_of(*every)) {
            session.link().now += time;
        }
        Ok::<(), Infallible>(())
    })
    .unwrap();
    assert_eq!(session.status().unwrap().mode, ModeName::Idle as u8);
    let sent_at = session.link().sent_at[before..before + SAMPLES].to_vec();
    (rows, outcome, sent_at)
}

#[test]
fn samples_go_out_on_the_clock_and_the_loop_is_the_one_with_half_a_sample_of_delay() {
    let (rows, outcome, sent_at) = paced(None, None);
    assert_eq!((outcome.overruns, outcome.slips, outcome.lost.len(), outcome.fault), (0, 0, 0, None));
    for (k, at) in sent_at.iter().enumerate() {
        // Durations are whole nanoseconds.
        assert_eq!((*at - sent_at[0]).as_nanos(), 200_000 * k as u128);
    }
    let mut chain = noisy();
    chain.sensor.noise_m = 0.0;
    let start = Start::relaxed(&chain);
    let setup = Setup { chain: &chain, start: &start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s: 100e-6, seed: 1 };
    let program = Program::new(&Spec::parse("step:40um@1s").unwrap(), RATE_HZ).unwrap();
    let ideal = closed_loop(&setup, &pi2(), &program, &|_| ()).unwrap();
    for (row, ideal_m) in rows.iter().zip(&ideal.displacement_m) {
        // A few steps of the converters, 63.5 nm and 95 nm, which the loop carries on.
        assert!((row.displacement_m - ideal_m).abs() < 0.4e-6, "{row:?} {ideal_m}");
    }
}

#[test]
fn an_answer_that_comes_too_late_is_not_applied_and_moves_the_clock_only_if_it_must() {
    // Beyond half a sample of 200 us, and within the sample: held, and the next one is on time.
    let (rows, outcome, sent_at) = paced(Some((50, Duration::from_micros(120))), None);
    assert!((9..=11).contains(&outcome.overruns), "{}", outcome.overruns);
    let held = rows.windows(2).filter(|two| two[0].command_v == two[1].command_v).count();
    assert!(held >= outcome.overruns, "{held}");
    assert_eq!((sent_at[SAMPLES - 1] - sent_at[0]).as_nanos(), 200_000 * (SAMPLES as u128 - 1));
    // Two samples late: the clock begins anew, and no two samples come closer than they may.
    let (_, outcome, sent_at) = paced(Some((50, Duration::from_micros(400))), None);
    assert!((9..=11).contains(&outcome.overruns) && outcome.fault.is_none(), "{outcome:?}");
    assert!(sent_at.windows(2).all(|two| two[1] - two[0] >= Duration::from_micros(99)), "too close");
    let slip = sent_at[SAMPLES - 1] - sent_at[0] - Duration::from_micros(200 * (SAMPLES as u64 - 1));
    // Each time 430 us from the request to the next one, in place of 200.
    assert_eq!(slip.as_micros() / 230, outcome.overruns as u128, "{slip:?}");
    assert_eq!(outcome.slips, 0, "the link's doing is counted once");
}

#[test]
fn a_host_that_is_elsewhere_is_counted_and_moves_the_clock() {
    // 330 us from the request to the next one, in place of 200; behind the last row nothing is late.
    let (rows, outcome, sent_at) = paced(None, Some((50, Duration::from_micros(300))));
    assert_eq!((outcome.slips, outcome.overruns, outcome.lost.len()), (9, 0, 0));
    let slip = sent_at[SAMPLES - 1] - sent_at[0] - Duration::from_micros(200 * (SAMPLES as u64 - 1));
    assert_eq!((slip.as_micros(), rows.len()), (9 * 130, SAMPLES));
}

#[test]
fn a_rate_that_the_link_cannot_keep_is_refused_with_the_numbers() {
    let mut session = Session::new(Timed::new());
    assert!(check(session.statistics(), 1.0).is_err(), "nothing is known yet");
    probe::<_, Infallible>(&mut session, 1000).unwrap();
    // 30 us, and a bucket's width of 1.6 % at the most; half of its inverse is 16.7 kHz.
    assert_eq!(check(session.statistics(), 16_000.0), Ok(()));
    let Err(refused @ TooFast { round_trip_s, most_hz, .. }) = check(session.statistics(), 20_000.0) else {
        panic!("20 kHz is not in 30 us")
    };
    assert!((29.99e-6..30.5e-6).contains(&round_trip_s) && (most_hz * 2.0 * round_trip_s - 1.0).abs() < 1e-9);
    let said = refused.to_string();
    assert!(
        said.starts_with("20000 Hz is too fast in real time: 99.9 % of the round trips over this link take up to 30."),
        "{said}"
    );
}
