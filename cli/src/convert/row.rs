//! [`Row`]: what every source of a log gives, whatever its format: named values, and the place they stand at.

use std::fmt;
use std::sync::Arc;

use thiserror::Error;

use crate::fault::Fault;

/// Values by the log's own names.
pub(super) type Cells = Vec<(Arc<str>, String)>;

/// A row, or a problem with it. After a problem the next row can be read.
pub(super) type ReadRow = Result<Row, Problem>;

/// A line, a row, or a message of a recording.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) place: Place,
    pub(super) cells: Cells,
    /// The instant at which it was recorded, if the recording has it beside the values.
    pub(super) log_time: Option<u64>,
    /// The topic of the recording from which it comes.
    pub(super) topic: Option<usize>,
}

/// A place in a log.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Place {
    pub(super) file: Arc<str>,
    pub(super) spot: Spot,
}

/// A place within a file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Spot {
    Line(u64),
    /// An element of a JSON array.
    Element(u64),
    /// A message of a topic.
    Message(Arc<str>, u64),
    /// A span, by its name and id.
    Span(Arc<str>),
    /// The file as a whole.
    File,
}

/// A problem of a log, with its place, in one line whatever the log contains.
#[derive(Clone, Debug, Error)]
#[error("{place}: {message}")]
pub(super) struct Problem {
    pub(super) place: Place,
    pub(super) message: String,
    pub(super) kind: ProblemKind,
}

/// The remedy for a problem.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum ProblemKind {
    /// The row can be left out.
    Row,
    /// The row can be left out; it lacks this name of the user's, which may occur nowhere.
    Lacks(String),
    /// The input ends within a row; what stands before can be read.
    Cut,
    /// Nothing more can be read.
    File,
}

impl Row {
    /// Returns a row that has no other time and topic than its values say.
    pub(super) const fn new(place: Place, cells: Cells) -> Self {
        Self { place, cells, log_time: None, topic: None }
    }

    /// Returns the value of a name; none if the row lacks it.
    pub(super) fn cell(&self, name: &str) -> Option<&str> {
        self.cells.iter().find(|(known, _)| **known == *name).map(|(_, text)| &**text)
    }
}

impl Place {
    pub(super) fn new(file: &Arc<str>, spot: Spot) -> Self {
        Self { file: Arc::clone(file), spot }
    }

    /// Returns the place without its file, for a second one in a sentence.
    pub(super) fn within(&self) -> String {
        match &self.spot {
            Spot::Line(line) => format!("line {line}"),
            Spot::Element(number) => format!("element {number}"),
            Spot::Message(topic, number) => format!("{topic}, message {number}"),
            Spot::Span(span) => format!("{span}"),
            Spot::File => "the file".to_owned(),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.spot {
            Spot::Line(line) => write!(f, "{}:{line}", self.file),
            Spot::File => write!(f, "{}", self.file),
            _ => write!(f, "{}: {}", self.file, self.within()),
        }
    }
}

impl Problem {
    /// Returns a problem with the row at this place.
    pub(super) fn at(place: &Place, message: impl Into<String>) -> Self {
        Self::of_kind(ProblemKind::Row, place, message)
    }

    /// Returns a problem with a file as a whole.
    pub(super) fn of_file(file: &Arc<str>, message: impl Into<String>) -> Self {
        Self::of_kind(ProblemKind::File, &Place::new(file, Spot::File), message)
    }

    pub(super) fn of_kind(kind: ProblemKind, place: &Place, message: impl Into<String>) -> Self {
        let message = message.into().replace(char::is_control, "\u{fffd}");
        let remedy = match kind {
            ProblemKind::Cut => "; read everything before that with --truncated",
            _ => "",
        };
        Self { place: place.clone(), message: message + remedy, kind }
    }

    /// Returns the problem of a file of which no more can be read, maybe because it was cut off.
    pub(super) fn of_read(place: &Place, error: &std::io::Error) -> Self {
        let is_cut = error.kind() == std::io::ErrorKind::UnexpectedEof;
        let kind = if is_cut { ProblemKind::Cut } else { ProblemKind::File };
        Self::of_kind(kind, place, format!("it cannot be read: {error}"))
    }

    /// Returns the problem, without the remedy.
    pub(super) fn without_remedy(&self) -> String {
        self.message.split("; ").next().unwrap_or_default().to_owned()
    }

    /// Returns the remedy, or an empty text if the message has none.
    pub(super) fn remedy(&self) -> &str {
        self.message.split_once("; ").map_or("", |(_, remedy)| remedy)
    }
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        Self::own(problem)
    }
}
