//! `hysteron serve`: the bench in a browser.

use crate::arguments::ServeCall;
use crate::commands::{board, board_serve};
use crate::failure::Failure;
use crate::output;
use bench_page::engine::{Engine, Open, Setting, Source};
use bench_page::server::Server;
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::link::Place;
use hil_bridge::tcp::Tcp;
use plant_sim::model::Model;
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::Path;
use virtual_board::Image;

/// Runs it, until the process is ended.
pub fn serve(call: &ServeCall) -> Result<(), Failure> {
    let plant = source(&call.plant)?;
    let bench = call.bench.as_deref().map(source).transpose()?;
    let settings = board::settings(&call.controller, call.rate)?;
    let open = open(call, &bench.as_ref().unwrap_or(&plant).model)?;
    std::fs::create_dir_all(&call.runs).map_err(|error| Failure::unwritable(&call.runs, &error))?;
    let warnings = plant.model.warnings();
    // The port first: nothing is said to a board for a page that nobody could open.
    let address = SocketAddr::new(call.listen, call.port);
    let server = Server::bind(address).map_err(|error| {
        let advice = match error.kind() {
            ErrorKind::AddrInUse => "another program has it: end that one, or name another with --port",
            ErrorKind::PermissionDenied => "ports below 1024 are the system's: name another with --port",
            _ => "name another address with --listen",
        };
        Failure::call(format!("{address}: {error}; {advice}"))
    })?;
    let engine = Engine::start(Setting {
        place: call.board.clone(),
        open,
        clear_fault: call.clear_fault,
        rate_hz: call.rate,
        seed: call.seed,
        plant,
        bench,
        controller: (output::file_name(&call.controller), settings),
        runs: call.runs.clone(),
    })?;
    output::line(&server.address());
    output::warn(&warnings);
    if !call.listen.is_loopback() {
        output::warn(&[format!(
            "listening at {address}, from elsewhere by this machine's own address: whoever can read this network can read the token, and move the bench"
        )]);
    }
    server.serve(engine).map_err(|error| Failure::interrupted(format!("the page's server ended: {error}")))
}

fn source(path: &Path) -> Result<Source, Failure> {
    let model = Model::read(path)?;
    let bytes = std::fs::read(path)
        .map_err(|error| Failure::file(format!("{}: cannot be read: {error}; check the name", path.display())))?;
    Ok(Source { name: output::file_name(path), bytes, model })
}

/// How the board is reached, again and again; what can be wrong in the call is said before.
fn open(call: &ServeCall, model: &Model) -> Result<Open, Failure> {
    if call.image.is_some() && call.board != Place::Virtual {
        return Err(Failure::call("--image is for --board virtual: leave it out"));
    }
    let rate_hz = call.rate;
    Ok(match call.board.clone() {
        Place::InProcess => Box::new(|| Ok(Box::new(InProcess::nucleo()))),
        Place::Virtual => {
            let Some(image) = &call.image else {
                return Err(Failure::call("--board virtual needs --image IMAGE.elf (cargo xtask firmware)"));
            };
            let image = Image::read(image).map_err(|error| Failure::file(error.to_string()))?;
            let bench = board_serve::bench(&image, model, rate_hz, call.seed, None)?;
            Box::new(move || Ok(Box::new(InVirtual::new(&image, &bench, rate_hz)?)))
        }
        Place::Tcp(address) => Box::new(move || Ok(Box::new(Tcp::connect(&address)?))),
        Place::Serial(path) => serial(path, call.baud)?,
    })
}

#[cfg(unix)]
fn serial(path: std::path::PathBuf, baud: u32) -> Result<Open, Failure> {
    Ok(Box::new(move || Ok(Box::new(hil_bridge::serial::Serial::open(&path, baud)?))))
}

#[cfg(not(unix))]
fn serial(_: std::path::PathBuf, _: u32) -> Result<Open, Failure> {
    Err(Failure::call("--board serial: not on this system; use tcp"))
}
