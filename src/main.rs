//! The `hysteron` command: reads arguments, calls the rooms, prints. It computes nothing itself.
//!
//! Exit codes: 0 done; 2 wrong call; 3 bad input file; 4 did not converge. Errors are one line on standard error.

mod arguments;
mod commands;
mod failure;
mod output;

use arguments::Arguments;
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version are answers, not errors; clap prints both kinds to where they belong.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { failure::WRONG_CALL } else { 0 });
        }
    };
    match commands::run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("hysteron: {}", failure.line());
            ExitCode::from(failure.code)
        }
    }
}
