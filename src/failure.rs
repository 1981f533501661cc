//! How the command fails: one line and an exit code.

use gap_diagnosis::identify::IdentifyError;
use plant_sim::FileError;
use plant_sim::experiment::ExperimentError;
use plant_sim::log::LogError;
use plant_sim::margins::MarginError;
use plant_sim::spec::SpecError;

/// The call can't be meant: an unknown argument, a number out of range, an unstable loop.
pub const WRONG_CALL: u8 = 2;
/// A file can't be used as it is.
pub const BAD_FILE: u8 = 3;
/// The computation came to no result.
pub const NO_RESULT: u8 = 4;

/// An exit code and what to say.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    message: String,
}

impl Failure {
    /// A failure of the call itself.
    pub fn call(message: impl Into<String>) -> Self {
        Self { code: WRONG_CALL, message: message.into() }
    }

    /// A failure to write `path`.
    pub fn unwritable(path: &std::path::Path, error: &std::io::Error) -> Self {
        Self { code: BAD_FILE, message: format!("{}: cannot be written: {error}", path.display()) }
    }

    /// The message on one line, whatever it came from.
    pub fn line(&self) -> String {
        self.message.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

impl From<LogError> for Failure {
    fn from(error: LogError) -> Self {
        Self { code: if error.is_wrong_call() { WRONG_CALL } else { BAD_FILE }, message: error.to_string() }
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        Self { code: BAD_FILE, message: error.to_string() }
    }
}

impl From<SpecError> for Failure {
    fn from(error: SpecError) -> Self {
        Self::call(error.to_string())
    }
}

impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        Self::call(error.to_string())
    }
}

impl From<MarginError> for Failure {
    fn from(error: MarginError) -> Self {
        Self::call(error.to_string())
    }
}

impl From<IdentifyError> for Failure {
    fn from(error: IdentifyError) -> Self {
        let code = match error {
            IdentifyError::NoLog => WRONG_CALL,
            IdentifyError::NoFit { .. } => NO_RESULT,
            _ => BAD_FILE,
        };
        Self { code, message: error.to_string() }
    }
}
