//! The link to the board that a call names, and what is said of it.

use crate::arguments::BoardArguments;
use crate::commands::board_serve;
use crate::failure::Failure;
use crate::output;
use bench_page::ending::watch;
use bench_page::engine::Open;
use control_core::{FaultCode, ModeName};
use hil_bridge::faulty::Faults;
use hil_bridge::in_process::InProcess;
use hil_bridge::in_virtual::InVirtual;
use hil_bridge::link::{Link, Place};
use hil_bridge::lockstep::{self, LockstepError};
use hil_bridge::run_directory::RunError;
use hil_bridge::session::Session;
use hil_bridge::tcp::Tcp;
use plant_sim::model::Model;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use virtual_board::Image;
use wire::Parameters;

/// Whether the call was asked to end, by Ctrl-C or by a signal.
static IS_ASKED_TO_END: AtomicBool = AtomicBool::new(false);

/// From here on a run that is asked to end does so between two of its rows, its board stopped and given back what it was set to; asked once more the
/// process ends at once.
pub fn heed_signals() -> Result<(), Failure> {
    let unheard =
        |error: std::io::Error| Failure::interrupted(format!("signals that end a run can't be listened to: {error}"));
    watch(&IS_ASKED_TO_END, end_at_once).map_err(unheard)
}

fn end_at_once() {
    let failure = Failure::interrupted(
        "interrupted once more: the board was not left in order; one that drives its own pins ramps to 0 V when it misses its host: look at the bench",
    );
    output::complain(&format!("hysteron: {}", failure.line()));
    std::process::exit(failure.code.into());
}

/// Whether the call was asked to end.
pub fn is_asked_to_end() -> bool {
    IS_ASKED_TO_END.load(Ordering::Relaxed)
}

/// What a row ends in: an error where the run is to end with it.
pub fn go_on() -> Result<(), RunError> {
    if is_asked_to_end() { Err(RunError::Interrupted) } else { Ok(()) }
}

/// Why a run into `out` ended.
pub fn ended<L: Link>(error: LockstepError<RunError>, session: &mut Session<L>, out: &Path) -> Failure {
    match error {
        LockstepError::Row(RunError::Interrupted) => interrupted(session, out),
        error => error.into(),
    }
}

/// A run into `out` that was asked to end, and whether its board is at rest behind it.
pub fn interrupted<L: Link>(session: &mut Session<L>, out: &Path) -> Failure {
    let is_idle = session.status().is_ok_and(|status| status.mode == ModeName::Idle as u8);
    let board = if is_idle {
        "the board is stopped, at 0 V"
    } else {
        "whether the board is at 0 V it does not say: press the wired stop, and look at the bench"
    };
    Failure::interrupted(format!("interrupted: {} ends with what was recorded before; {board}", out.display()))
}

/// A conversation over `link`, as patient as the call says.
pub fn session<L: Link>(at: &BoardArguments, link: L) -> Session<L> {
    Session::new(link).with_patience(at.patience())
}

/// A conversation with a board that was there before this call and stays behind it.
pub fn standing(at: &BoardArguments) -> Result<Session<Box<dyn Link>>, Failure> {
    if matches!(at.board, Place::InProcess | Place::Virtual) {
        let ends = "say which board is meant: --board serial:PATH or tcp:HOST:PORT; one in process ends with this call";
        return Err(Failure::call(ends));
    }
    // No bench is simulated here: a serial port and TCP need none.
    Ok(session(at, open(at, None, 0.0, 0, None)?))
}

/// What `--link-faults` asks for.
pub fn faults(text: Option<&str>) -> Result<Option<Faults>, Failure> {
    let faults = text.map(str::parse).transpose();
    faults.map_err(|error: String| Failure::call(format!("--link-faults: {error}")))
}

/// The link that the call names; `model` and what follows it are the bench of a virtual board.
pub fn open(
    at: &BoardArguments,
    model: Option<&Model>,
    rate_hz: f64,
    seed: u64,
    anti_alias_hz: Option<f64>,
) -> Result<Box<dyn Link>, Failure> {
    Ok(opener(at, model, rate_hz, seed, anti_alias_hz)?()?)
}

/// The same for whoever opens it again and again; what can be wrong in the call is said here.
pub fn opener(
    at: &BoardArguments,
    model: Option<&Model>,
    rate_hz: f64,
    seed: u64,
    anti_alias_hz: Option<f64>,
) -> Result<Open, Failure> {
    if anti_alias_hz.is_some() && at.board != Place::Virtual {
        return Err(Failure::call("--anti-alias-hz is the filter of a virtual board's bench: leave it out"));
    }
    if at.image.is_some() && at.board != Place::Virtual {
        return Err(Failure::call("--image is for --board virtual: leave it out"));
    }
    Ok(match at.board.clone() {
        Place::InProcess => Box::new(|| Ok(Box::new(InProcess::nucleo()))),
        Place::Virtual => {
            let (Some(image), Some(model)) = (&at.image, model) else {
                return Err(Failure::call(
                    "--board virtual needs --image IMAGE.elf (cargo xtask firmware) and --plant",
                ));
            };
            let image = Image::read(image).map_err(|error| Failure::file(error.to_string()))?;
            let bench = board_serve::bench(&image, model, rate_hz, seed, anti_alias_hz)?;
            Box::new(move || Ok(Box::new(InVirtual::new(&image, &bench, rate_hz)?)))
        }
        Place::Tcp(address) => Box::new(move || Ok(Box::new(Tcp::connect(&address)?))),
        Place::Serial(path) => serial(path, at.baud)?,
    })
}

#[cfg(unix)]
fn serial(path: PathBuf, baud: u32) -> Result<Open, Failure> {
    Ok(Box::new(move || Ok(Box::new(hil_bridge::serial::Serial::open(&path, baud)?))))
}

#[cfg(not(unix))]
fn serial(_: PathBuf, _: u32) -> Result<Open, Failure> {
    Err(Failure::call("--board serial: not on this system; use tcp"))
}

/// Gives a board back the set that it had before `others` were put over it, however the call has `ended`. With what came of that what there is to warn
/// of; where nothing came of it that is said here.
pub fn put_back<L: Link, T>(
    session: &mut Session<L>,
    own: Parameters,
    others: &[Parameters],
    ended: Result<T, Failure>,
) -> Result<(T, Option<String>), Failure> {
    let other = others.iter().find(|other| **other != own);
    let error = other.and_then(|other| lockstep::put_back(session, own, other.rate_hz).err());
    let stays = error.map(|error| {
        format!(
            "the board keeps the limits of this call until it is reset or set anew (`hysteron board parameters`): {error}"
        )
    });
    match ended {
        Ok(found) => Ok((found, stays)),
        Err(failure) => {
            output::warn(stays.as_slice());
            Err(failure)
        }
    }
}

/// A run that ended in a fault of the board, of which `log` keeps the last rows.
pub fn in_fault(fault: FaultCode, log: &Path, place: &Place) -> Failure {
    Failure::hardware(format!("the board is in {fault}: {} ends with it, at 0 V; {}", log.display(), leaving(place)))
}

/// What leads out of a fault: a board that ends with the call has none the next time.
pub fn leaving(place: &Place) -> &'static str {
    match place {
        Place::InProcess | Place::Virtual => "mend its cause",
        Place::Tcp(_) | Place::Serial(_) => "mend its cause, and --clear-fault leaves it",
    }
}

/// The statistics of a link as lines for the terminal.
pub fn link_facts(link: &Value) -> [(String, String); 3] {
    let us = |key: &str| link["round_trip_us"][key].as_f64().map_or("-".to_owned(), |us| format!("{us:.1}"));
    let trips = format!("{} / {} / {} / {} us", us("p50"), us("p99"), us("p99_9"), us("max"));
    let count = |key: &str| link.get(key).map_or_else(String::new, Value::to_string);
    let counts = |keys: [&str; 4]| keys.map(count).join(", ");
    [
        ("round trip, 50 / 99 / 99.9 % / most".to_owned(), trips),
        ("requests, answered, lost, late".to_owned(), counts(["requests", "answered", "lost", "late"])),
        (
            "CRC errors, malformed, missing, resyncs".to_owned(),
            counts(["crc_errors", "malformed", "missing", "resyncs"]),
        ),
    ]
}
