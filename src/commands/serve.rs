//! `hysteron serve`: the bench in a browser.

use crate::arguments::ServeCall;
use crate::commands::board;
use crate::commands::link::opener;
use crate::failure::Failure;
use crate::output;
use bench_page::engine::{Engine, Setting, Source};
use bench_page::server::Server;
use plant_sim::model::Model;
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::Path;

/// Runs it, until the process is ended.
pub fn serve(call: &ServeCall) -> Result<(), Failure> {
    let plant = source(&call.plant)?;
    let bench = call.bench.as_deref().map(source).transpose()?;
    let settings = board::settings(&call.controller, call.rate)?;
    let open = opener(&call.at, Some(&bench.as_ref().unwrap_or(&plant).model), call.rate, call.seed, None)?;
    let image = call.at.image.as_deref().map(output::named).transpose()?;
    let mut warnings = Vec::new();
    for source in [&plant].into_iter().chain(&bench) {
        warnings.extend(output::about(Path::new(&source.name), source.model.live_warnings()));
    }
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
    let is_new = !call.runs.exists();
    std::fs::create_dir_all(&call.runs).map_err(|error| Failure::unwritable(&call.runs, &error))?;
    let started = Engine::start(Setting {
        place: call.at.board.clone(),
        open,
        patience: call.at.patience(),
        clear_fault: call.clear_fault,
        rate_hz: call.rate,
        seed: call.seed,
        plant,
        bench,
        controller: (output::file_name(&call.controller), settings),
        image,
        runs: call.runs.clone(),
    });
    if started.is_err() && is_new {
        // Nothing is left of a call that is refused; what is not empty stays.
        let _ = std::fs::remove_dir(&call.runs);
    }
    let engine = started?;
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
    let bytes = output::content(path)?;
    Ok(Source { name: output::file_name(path), bytes, model })
}
