//! The `hysteron` command: reads arguments, calls the rooms, prints. It computes nothing itself.
//!
//! Exit codes: 0 done; 2 wrong call; 3 bad input file; 4 did not converge, or hardware fault. An output that can't be written is a wrong call (2): the
//! argument names a place that can't take it. Errors are one line on standard error: what, where, what to do.

mod arguments;
mod blind;
mod commands;
mod failure;
mod output;

use arguments::Arguments;
use clap::Parser;
use failure::Failure;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version are answers, not errors.
            if !error.use_stderr() {
                let _ = error.print();
                return ExitCode::SUCCESS;
            }
            return fail(&Failure::of_arguments(&error, &std::env::args_os().skip(1).collect::<Vec<_>>()));
        }
    };
    let done = output::check_places(arguments.command.as_ref()).and_then(|()| commands::run(&arguments));
    match done.and_then(|()| output::check_said()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => fail(&failure),
    }
}

fn fail(failure: &Failure) -> ExitCode {
    output::complain(&format!("hysteron: {}", failure.line()));
    ExitCode::from(failure.code)
}
