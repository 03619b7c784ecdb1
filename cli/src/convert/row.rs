//! [`Row`]: what every source of a log gives, whatever its format: named values, and the place they stand at.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use crate::complain::complain;

/// A line, a row, or a message of a recording: values by the log's own names.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) place: Place,
    pub(super) cells: Vec<(Arc<str>, String)>,
    /// When it was recorded, if the recording says so beside the values.
    pub(super) log_time: Option<u64>,
    /// Which topic of a recording it is of.
    pub(super) topic: Option<usize>,
}

/// Where something stands in a log.
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

/// Something wrong at a place.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    pub(super) place: Place,
    pub(super) message: String,
    pub(super) kind: ProblemKind,
}

/// What can be done about a problem.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum ProblemKind {
    /// The row can be left out.
    Row,
    /// The input ends within a row; what stands before can be read.
    Cut,
    /// Nothing more can be read.
    File,
}

/// What reads a log row by row.
pub(super) trait Source {
    /// The next row; none at the end. After a problem with a row the next one can be read.
    fn next_row(&mut self) -> Result<Option<Row>, Problem>;
}

/// What was guessed, changed or left out, each kind once with its count and its first place.
#[derive(Default, Debug)]
pub(super) struct Notes {
    kinds: Vec<(&'static str, Note)>,
}

#[derive(Debug)]
struct Note {
    count: u64,
    first: Place,
    detail: String,
    remedy: String,
}

/// The names of values, or of events, that a log has, with how often each stands there.
#[derive(Default, Debug)]
pub(super) struct Names(BTreeMap<Arc<str>, NameUse>);

#[derive(Default, Debug)]
struct NameUse {
    count: u64,
    /// Some of its values.
    values: Vec<String>,
}

/// How many values of a name are remembered.
const VALUES: usize = 6;

impl Row {
    /// The value of a name; none if the row lacks it.
    pub(super) fn cell(&self, name: &str) -> Option<&str> {
        self.cells.iter().find(|(known, _)| **known == *name).map(|(_, text)| &**text)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = &self.file;
        match &self.spot {
            Spot::Line(line) => write!(f, "{file}:{line}"),
            Spot::Element(number) => write!(f, "{file}: element {number}"),
            Spot::Message(topic, number) => write!(f, "{file}: {topic}, message {number}"),
            Spot::Span(span) => write!(f, "{file}: {span}"),
            Spot::File => write!(f, "{file}"),
        }
    }
}

impl Place {
    /// The place without its file, for a second one in a sentence.
    pub(super) fn within(&self) -> String {
        match &self.spot {
            Spot::Line(line) => format!("line {line}"),
            Spot::Element(number) => format!("element {number}"),
            Spot::Message(topic, number) => format!("message {number} of {topic}"),
            Spot::Span(span) => format!("{span}"),
            Spot::File => "the file".to_owned(),
        }
    }
}

impl Notes {
    /// Counts something of this kind, named as several of it; `detail` is of the first one.
    pub(super) fn add(
        &mut self,
        kind: &'static str,
        place: &Place,
        detail: impl FnOnce() -> String,
    ) {
        self.add_with(kind, place, detail, String::new);
    }

    /// The same, with what the user can do about it.
    pub(super) fn add_with(
        &mut self,
        kind: &'static str,
        place: &Place,
        detail: impl FnOnce() -> String,
        remedy: impl FnOnce() -> String,
    ) {
        if let Some((_, note)) = self.kinds.iter_mut().find(|(known, _)| *known == kind) {
            note.count += 1;
            return;
        }
        let first = place.clone();
        self.kinds.push((kind, Note { count: 1, first, detail: detail(), remedy: remedy() }));
    }

    /// Adds what is true of the file as a whole.
    pub(super) fn add_of_file(&mut self, kind: &'static str, file: &Arc<str>, detail: String) {
        let first = Place { file: Arc::clone(file), spot: Spot::File };
        self.kinds.push((kind, Note { count: 0, first, detail, remedy: String::new() }));
    }

    /// A line for each kind.
    pub(super) fn lines(&self) -> Vec<String> {
        let line = |(kind, note): &(&'static str, Note)| {
            let Note { count, first, detail, remedy } = note;
            let colon = if detail.is_empty() { "" } else { ": " };
            let remedy = if remedy.is_empty() { String::new() } else { format!("; {remedy}") };
            let found = match first.spot {
                Spot::File => detail.clone(),
                _ if *count == 1 => format!("1 ({}{colon}{detail})", first.within()),
                _ => format!("{count} (first {}{colon}{detail})", first.within()),
            };
            format!("{}: {kind}: {found}{remedy}", first.file)
        };
        self.kinds.iter().map(line).collect()
    }

    /// Prints them on standard error, each in one line whatever the log holds.
    pub(super) fn complain(&self) {
        for line in self.lines() {
            complain(format_args!("note: {}", line.replace(char::is_control, "\u{fffd}")));
        }
    }
}

impl Names {
    pub(super) fn add(&mut self, name: &Arc<str>) {
        match self.0.get_mut(name) {
            Some(found) => found.count += 1,
            None => {
                self.0.insert(Arc::clone(name), NameUse { count: 1, values: Vec::new() });
            }
        }
    }

    /// Remembers a value, as an example.
    pub(super) fn add_value(&mut self, name: &Arc<str>, value: &str) {
        let Some(found) = self.0.get_mut(name) else { return };
        let is_new = || !found.values.iter().any(|known| known == value);
        if found.values.len() < VALUES && !value.is_empty() && is_new() {
            found.values.push(value.to_owned());
        }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(|name| &**name)
    }

    /// Each name with its count and some of its values.
    pub(super) fn described(&self) -> Vec<String> {
        let one = |(name, NameUse { count, values }): (&Arc<str>, &NameUse)| {
            let more = if values.len() == VALUES { ", …" } else { "" };
            format!("{name} ({count}): {}{more}", values.join(", "))
        };
        self.0.iter().map(one).collect()
    }
}
