//! One file per command.

mod blind_check;
mod board;
mod board_parameters;
mod board_serve;
mod board_stop;
mod compare;
mod demo;
mod design;
mod diagnose;
mod effects;
mod export;
mod hil;
mod identify;
mod link;
mod logs;
mod loops;
mod record;
mod replay;
mod reproduce;
mod serve;
mod simulate;

use crate::arguments::{Arguments, BoardCommand, Command};
use crate::failure::Failure;

/// Does what was asked for; without a command, shows what could be.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.command {
        None => demo::demo(arguments.seed),
        Some(Command::Simulate(call)) => simulate::simulate(call),
        Some(Command::Replay(call)) => replay::replay(call),
        Some(Command::Identify(call)) => identify::identify(call),
        Some(Command::Diagnose(call)) => diagnose::diagnose(call),
        Some(Command::Effects(call)) => effects::effects(call),
        Some(Command::Board(BoardCommand::Run(call))) => board::board_run(call),
        Some(Command::Board(BoardCommand::Serve(call))) => board_serve::board_serve(call),
        Some(Command::Board(BoardCommand::Parameters(call))) => board_parameters::board_parameters(call),
        Some(Command::Board(BoardCommand::Stop(call))) => board_stop::board_stop(call),
        Some(Command::Design(call)) => design::design(call),
        Some(Command::Reproduce(call)) => reproduce::reproduce_thesis(call),
        Some(Command::Hil(call)) => hil::hil(call),
        Some(Command::Serve(call)) => serve::serve(call),
        Some(Command::Export(call)) => export::export(call),
        Some(Command::Record(call)) => record::record(call),
        Some(Command::BlindCheck(call)) => blind_check::blind_check(call),
    }
}
