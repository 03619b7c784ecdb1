//! `fuseline scenario`: plays the experiments of `fuseline-evaluation`, with this command's errors.

use fuseline_deadline::Invalid;
pub(crate) use fuseline_evaluation::Args;
use fuseline_evaluation::ScenarioError;
use fuseline_evaluation::plot::FolderError;
use thiserror::Error;

use crate::diagnostics::options_at_fault;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::sink::OutputSink;

/// The options describe an impossible vehicle.
#[derive(Debug, Error)]
#[error("{invalid}; change {}", options_at_fault(*.invalid))]
struct InvalidOptions {
    invalid: Invalid,
}

/// Plays a scenario.
///
/// # Errors
/// Returns an error if the options make no sense, or if something cannot be read or written.
pub(crate) fn play(args: &Args) -> Result<Exit, Fault> {
    fuseline_evaluation::play(args, &mut OutputSink::new(anstream::stdout()))?;
    Ok(Exit::Conforms)
}

impl From<ScenarioError> for Fault {
    fn from(error: ScenarioError) -> Self {
        match error {
            ScenarioError::Invalid(invalid) => Self::own(InvalidOptions { invalid }),
            ScenarioError::Folder(error) => error.into(),
            ScenarioError::Output(source) => Self::Output(source),
            error @ (ScenarioError::Full { .. }
            | ScenarioError::Traces { .. }
            | ScenarioError::Drive(_)) => Self::own(error),
        }
    }
}

impl From<FolderError> for Fault {
    fn from(error: FolderError) -> Self {
        match error {
            FolderError::Folder { name, source } => Self::Folder { name, source },
            FolderError::Create { name, source } => Self::Create { name, source },
            FolderError::NotEmpty(_) => Self::own(error),
        }
    }
}
