//! The errors of `convert`.

use std::sync::Arc;

use fuseline_traces::{Header, HeaderAnnotations};
use thiserror::Error;

use crate::convert::row::{Place, Problem, ProblemKind, Spot};
use crate::fault::Fault;

/// A header with its further keys.
pub(super) type AnnotatedHeader = (Header, HeaderAnnotations);

/// Why something recorded cannot be converted.
#[derive(Debug, Error)]
pub(super) enum ConvertError {
    #[error(
        "{file}: neither .csv, .jsonl, .mcap nor .db3, packed or not; say which it is with --from"
    )]
    Format { file: String },
    #[error(
        "{file}: no header; give one with --header FILE, a file that begins with {{\"fuseline\":1,…}}; --write-header makes \
         one"
    )]
    NoHeader { file: String },
    #[error("--frame is for rows of CSV and JSON; give --column for others")]
    Frames,
    #[error(
        "--topic was given several times; say what the messages of each are, such as open=/camera, or which keys say so, with \
         --column"
    )]
    Topics,
    #[error("{file}: a folder without metadata.yaml, .mcap or .db3; name one of its files")]
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
    #[error("{file}: it is a trace already; `fuseline check` judges it")]
    IsTrace { file: String },
    #[error("--split writes a file for each run; name one with -o, such as -o trace.jsonl")]
    Split,
    #[error("{0}")]
    Options(String),
    #[error("{place}: {message}")]
    At { place: Place, message: String },
}

impl ConvertError {
    /// In one line, whatever the file holds.
    pub(super) fn at(place: &Place, message: &str) -> Self {
        let message = message.replace(char::is_control, "\u{fffd}");
        Self::At { place: place.clone(), message }
    }

    /// Something wrong with a file as a whole.
    pub(super) fn file(file: &str, message: &str) -> Self {
        Self::at(&Place { file: file.into(), spot: Spot::File }, message)
    }

    /// A file that cannot be read.
    pub(super) fn read(file: &str, error: &std::io::Error) -> Self {
        Self::file(file, &format!("it cannot be read: {error}"))
    }
}

impl Problem {
    /// A problem with a file as a whole.
    pub(super) fn of_file(file: &Arc<str>, message: impl Into<String>) -> Self {
        let place = Place { file: Arc::clone(file), spot: Spot::File };
        Self { place, message: message.into(), kind: ProblemKind::File }
    }
}

impl From<Problem> for ConvertError {
    fn from(problem: Problem) -> Self {
        let remedy = match problem.kind {
            ProblemKind::Cut => "; --truncated reads what stands before",
            ProblemKind::Row | ProblemKind::File => "",
        };
        Self::at(&problem.place, &format!("{}{remedy}", problem.message))
    }
}

impl From<ConvertError> for Fault {
    fn from(error: ConvertError) -> Self {
        Self::own(error)
    }
}
