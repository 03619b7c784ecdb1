//! What the readers of recordings have in common: their interface and their errors.

use fuseline_traces::{Annotations, Event, Header, HeaderAnnotations};
use thiserror::Error;

use crate::fault::Fault;

/// A header with its further keys.
pub(super) type AnnotatedHeader = (Header, HeaderAnnotations);
/// An event with its further keys.
pub(super) type AnnotatedEvent = (Event, Annotations);

/// A recording being read: a header, if it has one, then events.
pub(super) trait Recorded {
    /// The recording's own header, if it has one.
    fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault>;
    /// The next event; none at the end.
    fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault>;
}

/// Why something recorded cannot be converted.
#[derive(Debug, Error)]
pub(super) enum ConvertError {
    #[error("{file}: neither .csv, .jsonl, .mcap nor .db3; say which it is with --from")]
    Format { file: String },
    #[error(
        "{file}: no header; give one with --header FILE, a file that begins with {{\"fuseline\":1,…}}; --write-header makes \
         one"
    )]
    NoHeader { file: String },
    #[error("--frame is for CSV files; give --column for others")]
    Frames,
    #[error(
        "--topic was given several times; say what the messages of each are, such as open=/camera, or which keys say so, with \
         --column"
    )]
    Topics,
    #[error("{file}: a folder; name one of its .mcap or .db3 files")]
    Folder { file: String },
    #[error(
        "{file}: a database of rosbag2 is read from a file of its own, and not from standard input"
    )]
    #[cfg(feature = "bags")]
    Database { file: String },
    #[error(
        "{file}: this fuseline reads no databases of rosbag2; build it with --features bags, or make an .mcap of it with \
         ros2 bag convert"
    )]
    #[cfg(not(feature = "bags"))]
    NoBags { file: String },
    #[error("--write-header asks on standard input; name a file to convert")]
    Asking,
    #[error("{file}: it has a header, which --write-header would replace; leave that out")]
    HasHeader { file: String },
    #[error("{file}:{line}: {message}")]
    Row { file: String, line: u64, message: String },
    #[error("{file}: {message}")]
    File { file: String, message: String },
}

impl ConvertError {
    /// A file that cannot be read.
    pub(super) fn read(file: &str, error: &std::io::Error) -> Self {
        Self::File { file: file.to_owned(), message: format!("it cannot be read: {error}") }
    }
}

impl From<ConvertError> for Fault {
    fn from(error: ConvertError) -> Self {
        Self::own(error)
    }
}
