//! `hysteron board serve`: the flash image on the virtual board, its line open to a host on TCP or on a pseudo-terminal.

use crate::arguments::BoardServeCall;
use crate::failure::Failure;
use crate::output;
use plant_sim::model::Model;
use virtual_board::serve::{Line, Pace, TcpLine, serve};
use virtual_board::{BenchSettings, CORE_HZ, Image, VirtualBoard, step_cycles};
use wire::{Converters, Parameters};

/// Runs it.
pub fn board_serve(call: &BoardServeCall) -> Result<(), Failure> {
    let image = Image::read(&call.image).map_err(|error| Failure::file(error.to_string()))?;
    let model = Model::read(&call.plant)?;
    let bench = bench(&image, &model, call.rate, call.seed, call.anti_alias)?;
    output::warn(&output::about(&call.plant, model.live_warnings()));
    let (mut line, place) = open(call)?;
    let pace = if call.pace == "lockstep" { Pace::Lockstep } else { Pace::Real };
    let mut board = VirtualBoard::new(&image, &bench, step_cycles(call.rate));
    output::line(&format!("serving at {place}"));
    let end = call.seconds.map(|seconds| (seconds * CORE_HZ) as u64);
    serve(&mut board.machine, line.as_mut(), pace, |now| end.is_some_and(|end| now >= end))
        .map_err(|error| Failure::hardware(format!("virtual board: {error}")))
}

/// What the board's pins are joined to; the levels between are those of the board's own defaults.
pub fn bench(
    image: &Image,
    model: &Model,
    rate_hz: f64,
    seed: u64,
    anti_alias_hz: Option<f64>,
) -> Result<BenchSettings, Failure> {
    let has_external_converters = image.has_external_converters();
    let (converters, parameters) = if has_external_converters {
        (Converters::EXTERNAL_16BIT, Parameters::EXTERNAL_PI1)
    } else {
        (Converters::NUCLEO_G474RE, Parameters::NUCLEO_PI1)
    };
    let checked = Parameters { rate_hz: rate_hz as f32, ..parameters }.check(&converters)?;
    let chain = model.chain();
    let start = model.start();
    Ok(BenchSettings { chain, start, calibration: checked.calibration, seed, anti_alias_hz, has_external_converters })
}

/// The line, and where a host finds it.
fn open(call: &BoardServeCall) -> Result<(Box<dyn Line>, String), Failure> {
    if call.pty {
        return pty();
    }
    let refused =
        |error: std::io::Error| Failure::call(format!("--listen {}: {error}; name another address", call.listen));
    let line = TcpLine::open(call.listen).map_err(refused)?;
    let address = line.address().map_err(refused)?;
    Ok((Box::new(line), address.to_string()))
}

#[cfg(unix)]
fn pty() -> Result<(Box<dyn Line>, String), Failure> {
    let line = virtual_board::serve::PtyLine::open()
        .map_err(|error| Failure::call(format!("--pty: {error}; use --listen")))?;
    let path = line.path().display().to_string();
    Ok((Box::new(line), path))
}

#[cfg(not(unix))]
fn pty() -> Result<(Box<dyn Line>, String), Failure> {
    Err(Failure::call("--pty: this system has none; use --listen"))
}
