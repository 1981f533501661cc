//! One file per command.

mod blind_check;
mod demo;
mod effects;
mod identify;
mod replay;
mod simulate;

use crate::arguments::{Arguments, Command};
use crate::failure::Failure;

/// Does what was asked for; without a command, shows what could be.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.command {
        None => demo::demo(),
        Some(Command::Simulate(call)) => simulate::simulate(call),
        Some(Command::Replay(call)) => replay::replay(call),
        Some(Command::Identify(call)) => identify::identify(call),
        Some(Command::Effects(call)) => effects::effects(call),
        Some(Command::BlindCheck(call)) => blind_check::blind_check(call),
    }
}
