//! How the command fails: one line and an exit code.

use crate::arguments::Arguments;
use bench_page::engine::StartError;
use clap::CommandFactory;
use clap::error::ErrorKind;
use gap_diagnosis::diagnose::DiagnoseError;
use gap_diagnosis::identify::IdentifyError;
use hil_bridge::link::LinkError;
use hil_bridge::lockstep::LockstepError;
use hil_bridge::run_directory::RunError;
use hil_bridge::session::SessionError;
use plant_sim::FileError;
use plant_sim::design::DesignError;
use plant_sim::experiment::ExperimentError;
use plant_sim::log::LogError;
use plant_sim::margins::MarginError;
use plant_sim::spec::SpecError;
use std::ffi::OsString;
use std::path::Path;
use wire::ParameterError;

/// The call can't be meant: an unknown argument, a number out of range, an unstable loop.
pub const WRONG_CALL: u8 = 2;
/// A file can't be used as it is.
pub const BAD_FILE: u8 = 3;
/// The computation came to no result, or a board to a fault.
pub const NO_RESULT: u8 = 4;

/// An exit code and what to say.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    message: String,
}

impl Failure {
    /// A file that can't be used as it is.
    pub fn file(message: impl Into<String>) -> Self {
        Self { code: BAD_FILE, message: message.into() }
    }

    /// A failure of the call itself.
    pub fn call(message: impl Into<String>) -> Self {
        Self { code: WRONG_CALL, message: message.into() }
    }

    /// A board that failed, or went into its fault mode.
    pub fn hardware(message: impl Into<String>) -> Self {
        Self { code: NO_RESULT, message: message.into() }
    }

    /// Work that came to no end.
    pub fn interrupted(message: impl Into<String>) -> Self {
        Self { code: NO_RESULT, message: message.into() }
    }

    /// The same, of this file.
    #[must_use]
    pub fn about(self, path: &Path) -> Self {
        Self { message: format!("{}: {}", path.display(), self.message), ..self }
    }

    /// A failure to write `path`.
    pub fn unwritable(path: &Path, error: &std::io::Error) -> Self {
        Self::call(format!("{}: cannot be written: {error}; name another place", path.display()))
    }

    /// What is wrong with the arguments `given`.
    ///
    /// clap says it in paragraphs, the last of which are usage and a hint at the help. They become parts of one line.
    pub fn of_arguments(error: &clap::Error, given: &[OsString]) -> Self {
        let (mut command, mut words) = (Arguments::command(), String::new());
        for word in given {
            let Some(sub) = command.find_subcommand(word) else { break };
            words += &format!("{} ", sub.get_name());
            command = sub.clone();
        }
        let help = format!("see `hysteron {words}--help`");
        if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
            let names: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
            return Self::call(format!("{words}needs a command: {}; {help}", names.join(", ")));
        }
        let text = error.render().to_string();
        let said = text.strip_prefix("error: ").unwrap_or(&text);
        let paragraphs = said
            .split("\n\n")
            .map(|paragraph| paragraph.split_whitespace().collect::<Vec<_>>().join(" "))
            .filter(|p| !p.is_empty() && !p.starts_with("Usage:") && !p.starts_with("For more information"));
        let mut parts: Vec<String> = paragraphs.collect();
        // The paragraph after what is missing is the usage, which has it all.
        let is_without_log = error.kind() == ErrorKind::MissingRequiredArgument
            && parts.first().is_some_and(|missing| missing.contains("<LOG>"));
        if is_without_log && given.iter().any(|word| word == "--held-out") {
            parts.push("--held-out takes every log that follows it: put those to fit before it".to_owned());
        }
        parts.push(help);
        Self::call(parts.join("; "))
    }

    /// The message on one line without control characters, whatever it came from.
    pub fn line(&self) -> String {
        let printable: String = self.message.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        printable.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

impl From<LogError> for Failure {
    fn from(error: LogError) -> Self {
        let wrong_call = error.is_wrong_call() || matches!(error, LogError::Unwritable { .. } | LogError::Ended { .. });
        Self { code: if wrong_call { WRONG_CALL } else { BAD_FILE }, message: error.to_string() }
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        let code = if matches!(error, FileError::Unwritable { .. }) { WRONG_CALL } else { BAD_FILE };
        Self { code, message: error.to_string() }
    }
}

impl From<SpecError> for Failure {
    fn from(error: SpecError) -> Self {
        Self { code: if error.in_file { BAD_FILE } else { WRONG_CALL }, message: error.to_string() }
    }
}

impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        match error {
            ExperimentError::Spec(error) => error.into(),
            ExperimentError::Settings(_) => Self::call(error.to_string()),
        }
    }
}

impl From<MarginError> for Failure {
    fn from(error: MarginError) -> Self {
        let advice = match error {
            MarginError::DelayTooLong { .. } => "; lower --delay-us or --rate",
            MarginError::TooStiff { .. } => "; raise --rate, or check the plant's units",
            _ => "",
        };
        Self::call(format!("{error}{advice}"))
    }
}

impl From<DesignError> for Failure {
    fn from(error: DesignError) -> Self {
        match error {
            DesignError::Margin(error) => error.into(),
            DesignError::Experiment(error) => error.into(),
            DesignError::NoSkeleton { .. } => Self::call(format!("{error}; give a plant with a mass, of second order")),
            DesignError::TooFast { .. } | DesignError::NoMargin { .. } | DesignError::NoStep { .. } => {
                Self::interrupted(error.to_string())
            }
        }
    }
}

impl From<IdentifyError> for Failure {
    fn from(error: IdentifyError) -> Self {
        let code = match error {
            IdentifyError::NoLog => WRONG_CALL,
            IdentifyError::RunInTooLong { run_in, .. } if run_in.is_asked => WRONG_CALL,
            IdentifyError::NoFit { .. } => NO_RESULT,
            _ => BAD_FILE,
        };
        Self { code, message: error.to_string() }
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Log(error) => error.into(),
            error => Self::call(error.to_string()),
        }
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Self {
        // The call names a place where there is no board; all else is the board's or the cable's doing.
        let code = if matches!(error, LinkError::Open { .. }) { WRONG_CALL } else { NO_RESULT };
        Self { code, message: error.to_string() }
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Link(error) => error.into(),
            error => Self::hardware(error.to_string()),
        }
    }
}

impl From<ParameterError> for Failure {
    fn from(error: ParameterError) -> Self {
        Self::call(format!("the board refuses: {error}"))
    }
}

impl From<LockstepError<RunError>> for Failure {
    fn from(error: LockstepError<RunError>) -> Self {
        match error {
            LockstepError::Row(error) => error.into(),
            LockstepError::Session(error) => error.into(),
            LockstepError::Parameters(error) => error.into(),
            LockstepError::LinkTooSlow { .. } => Self::call(error.to_string()),
            error => Self::hardware(error.to_string()),
        }
    }
}

impl From<StartError> for Failure {
    fn from(error: StartError) -> Self {
        match error {
            StartError::Board(error) => error.into(),
            StartError::Margins(error) => error.into(),
            StartError::Unstable(_) => Self::call(error.to_string()),
            StartError::Thread(_) | StartError::Ended => Self::interrupted(error.to_string()),
        }
    }
}

impl From<DiagnoseError> for Failure {
    fn from(error: DiagnoseError) -> Self {
        let code = match error {
            DiagnoseError::NoLog | DiagnoseError::NoSuchEntry { .. } => WRONG_CALL,
            DiagnoseError::ClosedLoop { in_file: false, .. } => WRONG_CALL,
            DiagnoseError::TooFewRows { run_in, .. } if run_in.is_asked => WRONG_CALL,
            _ => BAD_FILE,
        };
        Self { code, message: error.to_string() }
    }
}
