//! What the readers of recordings have in common: their interface and their errors.

use fuseline_traces::{Event, Header};
use thiserror::Error;

use crate::fault::Fault;

/// A recording being read: a header, if it has one, then events.
pub(super) trait Recorded {
    /// The recording's own header, if it has one.
    fn header(&mut self) -> Result<Option<Header>, Fault>;
    /// The next event; none at the end.
    fn next_event(&mut self) -> Result<Option<Event>, Fault>;
}

/// Why something recorded cannot be converted.
#[derive(Debug, Error)]
pub(super) enum ConvertError {
    #[error("{file}: neither .csv nor .mcap; say which it is with --from")]
    Format { file: String },
    #[error(
        "{file}: no header; give one with --header FILE, a file that begins with {{\"fuseline\":1,…}}"
    )]
    NoHeader { file: String },
    #[error("{file}:{line}: {message}")]
    Row { file: String, line: u64, message: String },
    #[error("{file}: message {number}: {message}")]
    Message { file: String, number: u64, message: String },
    #[error("{file}: {message}")]
    File { file: String, message: String },
}

impl From<ConvertError> for Fault {
    fn from(error: ConvertError) -> Self {
        Self::own(error)
    }
}
