//! `hysteron board stop`: takes a board that drives its own pins to 0 V.

use crate::arguments::BoardStopCall;
use crate::commands::link::standing;
use crate::failure::Failure;
use crate::output;
use hil_bridge::lockstep::idle;
use hil_bridge::pins;
use hil_bridge::run_directory::RunError;
use wire::InputSource;

/// Stops it; one that is in its fault then is told as such.
pub fn board_stop(call: &BoardStopCall) -> Result<(), Failure> {
    let mut session = standing(&call.at)?;
    session.greet()?;
    // Over the bridge only a host's samples move a ramp on, which is what `idle` is for.
    if session.status()?.input != InputSource::Bridge {
        pins::stop(&mut session)?;
    }
    let board = idle::<_, RunError>(&mut session, call.clear_fault)?;
    output::line(&format!("{}: idle, at 0 V", board.board));
    Ok(())
}
