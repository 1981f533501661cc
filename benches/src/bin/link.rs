//! Speed of the link: `cargo xtask bench link`.
//!
//! The loop of board and simulated plant with our protocol, beside the same loop (the same law, the same plant) whose two ends swap bare
//! numbers over a socket, one after the other in pairs, so that a load on the machine meets both. Ratios are round trips per second of ours over
//! those of the other; 0.5 is wanted. Then the virtual board: round trips of the flash image per second of this machine.

use control_core::{AdcCode, Calibration, Command, Controller, DacCode, Generator, Input, Settings};
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::link::Link;
use hil_bridge::lockstep::{prepare, probe, run};
use hil_bridge::session::Session;
use hil_bridge::tcp::Tcp;
use plant_sim::controller;
use plant_sim::experiment::{Bench, Program, Setup, closed_loop};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use plant_sim::spec::Spec;
use std::convert::Infallible;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use virtual_board::waveform::Waveform;
use virtual_board::{BenchSettings, Image};
use wire::{Converters, Parameters};

const RATE_HZ: f64 = 20e3;
const SAMPLES: usize = 20_000;
/// Pairs of runs per ratio.
const PAIRS: usize = 7;
/// Round trips of the virtual board.
const TRIPS: u32 = 5000;
const SPEC: &str = "sine:40um@100Hz";

fn main() {
    let model = Model::read(&root().join("models/thesis-phs.toml")).expect("the thesis' plant");
    let settings = controller::Controller::read(&root().join("controllers/pi1.toml")).expect("PI 1").settings(RATE_HZ);
    let plant = Plant { chain: model.chain(), settings };
    println!("{SAMPLES} samples of the loop, {PAIRS} pairs, median; round trips per second");
    println!("{:>8}  {:<44} {:>10} {:>10}", "ratio", "ours / other", "ours", "other");
    type Loop<'a> = &'a dyn Fn() -> f64;
    let (bare, over_tcp, in_process, direct): (Loop<'_>, Loop<'_>, Loop<'_>, Loop<'_>) =
        (&|| plant.bare(), &|| plant.over_tcp(), &|| plant.in_process(), &|| plant.direct());
    for (name, ours, other) in [
        ("protocol over TCP / bare numbers over TCP", over_tcp, bare),
        ("protocol in process / bare numbers over TCP", in_process, bare),
        ("protocol in process / simulate, no link at all", in_process, direct),
    ] {
        let pairs: Vec<[f64; 2]> = (0..PAIRS).map(|_| [ours(), other()].map(|s| SAMPLES as f64 / s)).collect();
        let of = |pick: &dyn Fn(&[f64; 2]) -> f64| median(pairs.iter().map(pick).collect());
        println!(
            "{:>8.2}  {name:<44} {:>10.0} {:>10.0}",
            of(&|pair| pair[0] / pair[1]),
            of(&|pair| pair[0]),
            of(&|pair| pair[1])
        );
    }
    match image() {
        Some(image) => virtual_board(&image, &plant),
        None => println!("not run: no flash image here; `cargo xtask firmware` builds one"),
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Plant and law, the same in every loop.
struct Plant {
    chain: plant_sim::chain::Chain,
    settings: Settings,
}

impl Plant {
    fn setup<'a>(&'a self, start: &'a Start) -> Setup<'a> {
        Setup { chain: &self.chain, start, rate_hz: RATE_HZ, samples: SAMPLES, latency_s: 10e-6, seed: 1 }
    }

    fn waveform() -> Waveform {
        Waveform::new(&Spec::parse(SPEC).expect("ours"), RATE_HZ).expect("ours")
    }

    /// The lockstep loop over any link, seconds.
    fn lockstep(&self, link: impl Link) -> f64 {
        let mut session = Session::new(link);
        let ready = prepare::<_, Infallible>(&mut session, &self.settings, &Self::waveform(), false).expect("ready");
        let start = Start::relaxed(&self.chain);
        let begun = Instant::now();
        let outcome = run(&mut session, &ready, &self.setup(&start), |_, _| Ok::<(), Infallible>(())).expect("a run");
        let seconds = begun.elapsed().as_secs_f64();
        assert!(outcome.fault.is_none() && outcome.lost.is_empty());
        seconds
    }

    fn in_process(&self) -> f64 {
        self.lockstep(InProcess::nucleo())
    }

    fn over_tcp(&self) -> f64 {
        let address = serve(|mut host| {
            let mut board = InProcess::nucleo();
            let (mut bytes, mut answer) = ([0; 4096], Vec::new());
            while let Ok(n @ 1..) = host.read(&mut bytes) {
                answer.clear();
                board.send(&bytes[..n]).expect("in process");
                board.receive(Duration::ZERO, &mut answer).expect("in process");
                host.write_all(&answer).expect("a host");
            }
        });
        self.lockstep(Tcp::connect(&address).expect("served"))
    }

    /// No frame, no number, no check: four bytes there, four back.
    fn bare(&self) -> f64 {
        let calibration = Parameters::NUCLEO_PI1.check(&Converters::NUCLEO_G474RE).expect("its own").calibration;
        let settings = self.settings;
        let address = serve(move |mut host| law(&mut host, &settings, &calibration));
        let mut board = TcpStream::connect(address).expect("served");
        board.set_nodelay(true).expect("TCP");
        let start = Start::relaxed(&self.chain);
        let mut bench = Bench::new(&self.setup(&start));
        let begun = Instant::now();
        for _ in 0..SAMPLES {
            let AdcCode(displacement) = calibration.adc_code(bench.read_m() as f32);
            let mut bytes = u32::from(displacement).to_le_bytes();
            board.write_all(&bytes).expect("served");
            board.read_exact(&mut bytes).expect("served");
            bench.apply(f64::from(calibration.drive_v(DacCode(u32::from_le_bytes(bytes) as u16))));
        }
        begun.elapsed().as_secs_f64()
    }

    /// `simulate`: the law is called.
    fn direct(&self) -> f64 {
        let program = Program::new(&Spec::parse(SPEC).expect("ours"), RATE_HZ).expect("ours");
        let start = Start::relaxed(&self.chain);
        let begun = Instant::now();
        closed_loop(&self.setup(&start), &self.settings, &program, &|_| ()).expect("a run");
        begun.elapsed().as_secs_f64()
    }
}

/// The law at the other end of a socket, until it is closed.
fn law(host: &mut TcpStream, settings: &Settings, calibration: &Calibration) {
    let mut controller = Controller::new(control_core::Law::try_build(settings).expect("PI 1"));
    controller.arm().expect("idle");
    controller.run().expect("armed");
    let segments: Vec<_> =
        Plant::waveform().segments.iter().map(|record| record.build(RATE_HZ as f32, &[]).expect("ours")).collect();
    let command = Command::GeneratedReference(Generator::new(&segments));
    let mut bytes = [0; 4];
    while host.read_exact(&mut bytes).is_ok() {
        let measured_m = calibration.displacement_m(AdcCode(u32::from_le_bytes(bytes) as u16));
        let output = controller.tick(&Input { command, measured_m });
        let DacCode(code) = calibration.dac_code(output.drive_v);
        host.write_all(&u32::from(code).to_le_bytes()).expect("a host");
    }
}

/// One end of a socket for `board`, in a thread; the other end's address.
fn serve(board: impl FnOnce(TcpStream) + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound").to_string();
    std::thread::spawn(move || {
        let (stream, _) = listener.accept().expect("a host");
        stream.set_nodelay(true).expect("TCP");
        board(stream);
    });
    address
}

fn image() -> Option<Image> {
    let folders = ["target/firmware-rustup", "target/firmware-debian"];
    let path = |folder: &str| root().join(folder).join("thumbv7em-none-eabihf/release/nucleo-g474re");
    folders.into_iter().find_map(|folder| Image::read(&path(folder)).ok())
}

fn virtual_board(image: &Image, plant: &Plant) {
    let calibration = Parameters::NUCLEO_PI1.check(&Converters::NUCLEO_G474RE).expect("its own").calibration;
    let bench = BenchSettings {
        chain: plant.chain.clone(),
        start: Start::relaxed(&plant.chain),
        calibration,
        seed: 1,
        anti_alias_hz: None,
        has_external_converters: false,
    };
    let rates: Vec<[f64; 2]> = (0..3)
        .map(|_| {
            let mut session = Session::new(InVirtual::new(image, &bench, RATE_HZ).expect("a board"));
            let (begun, boards) = (Instant::now(), session.link().now());
            probe::<_, Infallible>(&mut session, TRIPS).expect("a probe");
            let boards = session.link().now() - boards;
            [begun.elapsed().as_secs_f64(), boards.as_secs_f64()].map(|seconds| f64::from(TRIPS) / seconds)
        })
        .collect();
    let mut session = Session::new(InVirtual::new(image, &bench, RATE_HZ).expect("a board"));
    probe::<_, Infallible>(&mut session, TRIPS).expect("a probe");
    let statistics = session.statistics();
    let each = |bytes: u64| bytes as f64 / statistics.requests as f64;
    println!(
        "virtual board: {:.0} round trips per second of this machine, {:.0} per second of the board at 3 Mbaud; {:.1} bytes there and {:.1} back",
        median(rates.iter().map(|rate| rate[0]).collect()),
        rates[0][1],
        each(statistics.bytes[0]),
        each(statistics.bytes[1])
    );
}
