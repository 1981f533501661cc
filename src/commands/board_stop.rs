//! `hysteron board stop`: takes a board that drives its own pins to 0 V.

use crate::arguments::BoardStopCall;
use crate::commands::link::standing;
use crate::failure::Failure;
use crate::output;
use hil_bridge::lockstep::{LockstepError, idle};
use hil_bridge::pins;
use hil_bridge::run_directory::RunError;
use wire::InputSource;

/// Stops it; one that is in its fault then is told as such.
pub fn board_stop(call: &BoardStopCall) -> Result<(), Failure> {
    let mut session = standing(&call.at)?;
    let failed = |error| Failure::from(LockstepError::<RunError>::Session(error));
    session.greet().map_err(failed)?;
    // Over the bridge only a host's samples move a ramp on, which is what `idle` is for.
    if session.status().map_err(failed)?.input != InputSource::Bridge {
        pins::stop(&mut session).map_err(failed)?;
    }
    let board = idle::<_, RunError>(&mut session, call.clear_fault)?;
    output::line(&format!("{}: idle, at 0 V", board.board));
    Ok(())
}
