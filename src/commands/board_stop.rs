//! `hysteron board stop`: takes a board that drives its own pins to 0 V.

use crate::arguments::BoardStopCall;
use crate::commands::link::standing;
use crate::failure::Failure;
use crate::output;
use hil_bridge::lockstep::idle;
use hil_bridge::pins;
use hil_bridge::run_directory::RunError;
use hil_bridge::session::SessionError;
use wire::InputSource;

/// Stops it; one that is in its fault then is told as such.
pub fn board_stop(call: &BoardStopCall) -> Result<(), Failure> {
    let mut session = standing(&call.at)?;
    // A board of another release is stopped as well: what it says of itself is this version of the link.
    let other = match session.greet() {
        Err(error @ SessionError::Firmware { .. }) => Some(error),
        greeted => greeted.map(|_| None)?,
    };
    // Over the bridge only a host's samples move a ramp on, which is what `idle` is for.
    let drives = session.status()?.input != InputSource::Bridge;
    if drives {
        pins::stop(&mut session)?;
    }
    if let Some(error) = other {
        if drives {
            output::line("stopped, at 0 V");
        }
        return Err(error.into());
    }
    let board = idle::<_, RunError>(&mut session, call.clear_fault)?;
    output::line(&format!("{}: idle, at 0 V", board.board));
    Ok(())
}
