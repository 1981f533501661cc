//! What the bridge's tests share: a plant, an experiment, boards behind real ports, the flash image.
#![allow(dead_code, clippy::unwrap_used, reason = "each test program uses a part of it; a test may unwrap")]

#[path = "../../../tests/support/flash_image.rs"]
mod flash_image;

use control_core::Settings;
use hil_bridge::in_process::InProcess;
use hil_bridge::link::Link;
use hil_bridge::lockstep::{LockstepError, Outcome, Ready, Row, prepare, run};
use hil_bridge::session::Session;
use plant_sim::chain::Chain;
use plant_sim::controller::Controller;
use plant_sim::experiment::Setup;
use plant_sim::model::Model;
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use virtual_board::serve::Line;
use virtual_board::waveform::Waveform;
use virtual_board::{BenchSettings, Image};

pub const RATE_HZ: f64 = 20e3;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// The thesis' plant with 20 nm of noise, so that the seed matters.
pub fn noisy() -> Chain {
    let mut chain = Model::read(&root().join("models/thesis-phs.toml")).unwrap().chain();
    chain.sensor.noise_m = 20e-9;
    chain
}

pub fn pi1() -> Settings {
    Controller::read(&root().join("controllers/pi1.toml")).unwrap().settings(RATE_HZ)
}

pub fn waveform(spec: &str) -> Waveform {
    Waveform::new(&Spec::parse(spec).unwrap(), RATE_HZ).unwrap()
}

/// Steps, a sine and a multisine: segments with and without a table.
pub const SPEC: &str = "step:40um@0.005s+sine:60um@200Hz,for=0.01s+multisine:5um@100-2000Hz,periods=1,seed=3";

pub struct Done {
    pub ready: Ready,
    pub rows: Vec<Row>,
    pub outcome: Outcome,
}

/// A run of `samples` over a session; what it made.
pub fn lockstep<L: Link>(
    session: &mut Session<L>,
    chain: &Chain,
    spec: &str,
    samples: usize,
    seed: u64,
) -> Result<Done, LockstepError<Infallible>> {
    let ready = prepare(session, &pi1(), &waveform(spec), false)?;
    let start = Start::relaxed(chain);
    let setup = Setup { chain, start: &start, rate_hz: RATE_HZ, samples, latency_s: ready.latency_s, seed };
    let mut rows = Vec::new();
    let outcome = run(session, &ready, &setup, |_, row| {
        rows.push(*row);
        Ok(())
    })?;
    Ok(Done { ready, rows, outcome })
}

/// Lets `host` talk to a board in process behind `line`, as if it were elsewhere.
pub fn served<T: Send>(line: &mut dyn Line, host: impl FnOnce() -> T + Send) -> T {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let host = scope.spawn(|| {
            let result = host();
            is_over.store(true, Ordering::Relaxed);
            result
        });
        let mut board = InProcess::nucleo();
        while !is_over.load(Ordering::Relaxed) && !host.is_finished() {
            let bytes = line.receive().unwrap();
            if bytes.is_empty() {
                std::thread::sleep(Duration::from_micros(20));
                continue;
            }
            let mut answer = Vec::new();
            board.send(&bytes).unwrap();
            board.receive(Duration::ZERO, &mut answer).unwrap();
            line.send(&answer).unwrap();
        }
        host.join().unwrap()
    })
}

/// The image, built by `cargo xtask firmware`; `None`, and said so, where there is no compiler for the chip.
pub fn image() -> Option<Image> {
    Some(Image::read(&flash_image::folder()?.join("nucleo-g474re")).unwrap())
}

/// What the virtual board's own pins see.
pub fn bench() -> BenchSettings {
    let chain = noisy();
    let start = Start::relaxed(&chain);
    let calibration = wire::Parameters::NUCLEO_PI1.check(&wire::Converters::NUCLEO_G474RE).unwrap().calibration;
    BenchSettings { chain, start, calibration, seed: 1, anti_alias_hz: None, has_external_converters: false }
}
