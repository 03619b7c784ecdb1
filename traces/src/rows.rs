//! [`Rows`]: events read from a CSV file, with the caller's names of columns and events and its unit of time.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read;

use csv::{ReaderBuilder, StringRecord, Trim};
use thiserror::Error;

pub use self::table::{TableError, TableReader};

use crate::parse::{Form, LineAnnotations, parse_as};
use crate::{Annotations, Event, Line};

mod table;

/// The keys that an event may have, with those that are instants and durations.
const KEYS: [(&str, bool); 14] = [
    ("ev", false),
    ("at", true),
    ("t", false),
    ("p", false),
    ("due", true),
    ("deadline", true),
    ("backlog", false),
    ("why", false),
    ("of", false),
    ("try", false),
    ("within", true),
    ("age", true),
    ("origin", false),
    ("seq", false),
];

/// Events, with the keys that each may have beside `ev` and `at`.
const EVENTS: [(&str, &[&str]); 13] = [
    ("open", &["t", "deadline", "within", "age", "origin", "seq"]),
    ("offer", &["t", "p", "deadline", "backlog"]),
    ("result", &["t", "p", "of", "try"]),
    ("fail", &["t", "p", "try"]),
    ("tick", &[]),
    ("timer", &["t", "p"]),
    ("refuse", &["t", "p", "why"]),
    ("request", &["t", "p", "due", "deadline", "try"]),
    ("hold", &["t", "p"]),
    ("drop", &["t", "p", "why"]),
    ("emit", &["t", "p", "of"]),
    ("miss", &["t"]),
    ("cancel", &["t", "p"]),
];

/// The unit of a file's instants and durations.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Unit {
    /// Nanoseconds.
    Ns,
    /// Microseconds.
    Us,
    /// Milliseconds.
    Ms,
    /// Seconds.
    S,
}

/// Where the keys stand and how they are written.
#[derive(Clone, Debug)]
pub struct Columns<'a> {
    named: BTreeMap<&'a str, &'a str>,
    events: BTreeMap<&'a str, &'a str>,
    unit: Unit,
}

/// A CSV file that is being read: a row an event, the columns named in the first row.
///
/// The columns `at`, `ev`, `t`, `p`, `due`, `deadline`, `backlog`, `why`, `of`, `try`, `within`, `age`, `origin` and `seq`
/// are read, those that a row's event has; an empty cell is none.
#[derive(Debug)]
pub struct Rows<'a, R> {
    inner: TableReader<R>,
    /// The keys that it has, with their columns.
    keys: Vec<KeyColumn>,
    columns: Columns<'a>,
    annotations: LineAnnotations,
}

/// A key, whether it is a time, and the place and name of its column.
type KeyColumn = (&'static str, bool, usize, String);

/// What is wrong with a row.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
#[error("{line}: {message}")]
pub struct RowError {
    /// The row's line, from 1.
    pub line: u64,
    /// What is wrong.
    pub message: String,
}

/// `KEY=NAME`: a key of the trace, and the column that it stands in.
///
/// # Errors
/// What to write instead.
pub fn column(text: &str) -> Result<(&'static str, String), String> {
    let (key, name) = text.split_once('=').ok_or("write KEY=NAME, such as at=stamp")?;
    let known = KEYS.iter().find(|(known, _)| *known == key);
    let (key, _) = known.ok_or_else(|| {
        let known: Vec<&str> = KEYS.iter().map(|(known, _)| *known).collect();
        format!("no key {key:?}; it is one of {}", known.join(", "))
    })?;
    Ok((key, name.to_owned()))
}

/// `NAME=EV`: what the file calls an event of a trace.
///
/// # Errors
/// What to write instead.
pub fn event(text: &str) -> Result<(String, &'static str), String> {
    let (name, event) = text.split_once('=').ok_or("write NAME=EV, such as response=result")?;
    let known = EVENTS.iter().find(|(known, _)| *known == event);
    let (event, _) = known.ok_or_else(|| format!("no event {event:?} in a trace"))?;
    Ok((name.to_owned(), event))
}

impl Unit {
    /// All of them, from the shortest.
    pub const ALL: [Self; 4] = [Self::Ns, Self::Us, Self::Ms, Self::S];

    /// Its name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Ns => "ns",
            Self::Us => "us",
            Self::Ms => "ms",
            Self::S => "s",
        }
    }
}

impl<'a> Columns<'a> {
    /// The columns of keys that have other names than theirs, what the file calls some events, and
    /// its unit.
    #[must_use]
    pub fn new(
        named: &'a [(&'static str, String)],
        events: &'a [(String, &'static str)],
        unit: Unit,
    ) -> Self {
        Self {
            named: named.iter().map(|(key, name)| (*key, &**name)).collect(),
            events: events.iter().map(|(name, event)| (&**name, *event)).collect(),
            unit,
        }
    }
}

impl<'a, R: Read> Rows<'a, R> {
    /// Reads the first row, which names the columns.
    ///
    /// # Errors
    /// If it cannot be read, or a column is missing.
    pub fn new(inner: R, columns: Columns<'a>) -> Result<Self, RowError> {
        let mut inner = TableReader::new(inner, ReaderBuilder::new().trim(Trim::All));
        let fault = |message: String| RowError { line: 1, message };
        let names = inner.names()?;
        let mut keys = Vec::new();
        for (key, is_time) in KEYS {
            let name = columns.named.get(key).copied();
            let place = names.iter().position(|column| column == name.unwrap_or(key));
            let Some(place) = place else {
                let message = match name {
                    Some(name) => format!("no column {name:?} for {key}"),
                    None if matches!(key, "ev" | "at") => {
                        format!("no column {key:?}; name one with --column {key}=NAME")
                    }
                    None => continue,
                };
                return Err(fault(message));
            };
            keys.push((key, is_time, place, name.unwrap_or(key).to_owned()));
        }
        Ok(Self { inner, keys, columns, annotations: LineAnnotations::default() })
    }

    /// What the row read last has beside what the machine's rules read.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// The next row's event; none at the end.
    ///
    /// # Errors
    /// If the row cannot be read, or is no event.
    pub fn next_event(&mut self) -> Result<Option<Event>, RowError> {
        let Some((number, row)) = self.inner.next_row()? else { return Ok(None) };
        let fault = |message| RowError { line: number, message };
        let line = line(row, &self.keys, &self.columns).map_err(fault)?;
        match parse_as(line.as_bytes(), Form::Observed, &mut self.annotations) {
            Ok(Line::Event(event)) => Ok(Some(event)),
            Ok(Line::Header(_)) => Err(fault("a header in a row".to_owned())),
            Err(error) => Err(fault(error.message)),
        }
    }
}

impl From<TableError> for RowError {
    fn from(error: TableError) -> Self {
        Self { line: error.line, message: error.to_string() }
    }
}

/// A row as a line of a trace, or what is wrong with it.
fn line(row: &StringRecord, keys: &[KeyColumn], columns: &Columns<'_>) -> Result<String, String> {
    let cell = |key: &str| {
        let found = keys.iter().find(|(known, ..)| *known == key);
        found.and_then(|(_, _, place, _)| row.get(*place)).unwrap_or_default()
    };
    let name = cell("ev");
    let event = columns.events.get(name).copied().unwrap_or(name);
    let Some((_, takes)) = EVENTS.iter().find(|(known, _)| *known == event) else {
        // In one line, whatever the cell holds.
        let shown = name.escape_debug();
        let message = format!("unknown event {name:?}; say what it is with --event {shown}=EV");
        return Err(message);
    };
    let mut line = format!("{{\"ev\":\"{event}\"");
    for (key, is_time, _, column) in keys {
        let text = cell(key);
        if text.is_empty() || !(*key == "at" || takes.contains(key)) {
            continue;
        }
        let value = match *key {
            "why" | "origin" => Some(serde_json::Value::from(text).to_string()),
            _ if *is_time => nanos(text, columns.unit).map(|nanos| nanos.to_string()),
            _ => text.parse().ok().map(|number: u64| number.to_string()),
        };
        let value = value
            .ok_or_else(|| format!("column {column:?}: {text:?} is not a number that fits"))?;
        // To a string: it cannot fail.
        let _ = write!(line, ",\"{key}\":{value}");
    }
    line.push('}');
    Ok(line)
}

/// A decimal number of units, exactly.
fn nanos(text: &str, unit: Unit) -> Option<u64> {
    let digits = match unit {
        Unit::Ns => 0,
        Unit::Us => 3,
        Unit::Ms => 6,
        Unit::S => 9,
    };
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let part = part.trim_end_matches('0');
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || part.len() > digits || !is_number(whole) || !is_number(part) {
        return None;
    }
    format!("{whole}{part:0<digits$}").parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_read_exactly_or_not_at_all() {
        for (text, unit, read) in [
            ("12", Unit::Ns, Some(12)),
            ("12.50", Unit::Us, Some(12_500)),
            ("0.000000001", Unit::S, Some(1)),
            ("18446744073709.551615", Unit::Ms, Some(u64::MAX)),
            ("18446744073709.551616", Unit::Ms, None),
            ("1.5", Unit::Ns, None),
            ("-1", Unit::Ns, None),
            ("+1", Unit::Ns, None),
            ("1e3", Unit::Ns, None),
            (".5", Unit::S, None),
        ] {
            assert_eq!(nanos(text, unit), read, "{text}");
        }
    }
}
