//! The keys and events of a trace, and the options that say what the user calls them.

use crate::convert::time::{self, Unit};

/// The keys that an event may have.
const KEYS: [&str; 15] = [
    "ev", "at", "t", "p", "due", "deadline", "backlog", "why", "of", "for", "try", "within", "age",
    "origin", "seq",
];
/// The keys that are times.
const TIMES: [&str; 5] = ["at", "due", "deadline", "within", "age"];

/// Events, with the keys that each may have beside `ev` and `at`.
pub(super) const EVENTS: [(&str, &[&str]); 14] = [
    ("open", &["t", "deadline", "within", "age", "origin", "seq"]),
    ("offer", &["t", "p", "deadline", "backlog"]),
    ("result", &["t", "p", "of", "for", "try"]),
    ("fail", &["t", "p", "try"]),
    ("tick", &[]),
    ("timer", &["t", "p"]),
    ("refuse", &["t", "p", "why"]),
    ("request", &["t", "p", "due", "deadline", "try"]),
    ("hold", &["t", "p"]),
    ("drop", &["t", "p", "why"]),
    ("emit", &["t", "p", "of", "for"]),
    ("final", &["t", "p"]),
    ("miss", &["t"]),
    ("cancel", &["t", "p"]),
];

/// Returns the word among these that a user wrote.
pub(super) fn word(noun: &str, given: &str, all: &[&'static str]) -> Result<&'static str, String> {
    let known = all.iter().find(|known| **known == given).copied();
    known.ok_or_else(|| format!("there is no {noun}{given:?}; give one of {}", all.join(", ")))
}

/// Reads `KEY=NAME`: a key of the trace, and the file's name for it.
pub(super) fn column(text: &str) -> Result<(&'static str, String), String> {
    let (key, name) = text.split_once('=').ok_or("write KEY=NAME, such as at=stamp")?;
    Ok((word("key ", key, &KEYS)?, name.to_owned()))
}

/// Reads `NAME=EV`: the file's name for an event of a trace; `NAME=` leaves those events out.
pub(super) fn event(text: &str) -> Result<(String, &'static str), String> {
    let (name, event) = text.rsplit_once('=').ok_or("write NAME=EV, such as response=result")?;
    let known = EVENTS.iter().map(|(known, _)| *known).chain([""]).find(|known| *known == event);
    let event = known.ok_or_else(|| {
        let all: Vec<&str> = EVENTS.iter().map(|(known, _)| *known).collect();
        format!("a trace has no event {event:?}; give one of {}", all.join(", "))
    })?;
    Ok((name.to_owned(), event))
}

/// Reads `UNIT` or `KEY=UNIT`: the unit of all times, or of one key's.
pub(super) fn unit(text: &str) -> Result<(Option<&'static str>, Unit), String> {
    let Some((key, name)) = text.split_once('=') else { return Ok((None, Unit::named(text)?)) };
    let unit = Unit::named(name)?;
    Ok((Some(word("time ", key, &TIMES)?), unit))
}

/// Reads `TIME`, or `SOURCE=TIME`: the deadline of requests that state none.
pub(super) fn deadline(text: &str) -> Result<(Option<String>, u64), &'static str> {
    let (source, time) = match text.rsplit_once('=') {
        Some((source, time)) => (Some(source.to_owned()), time),
        None => (None, text),
    };
    let nanos = time::stated(time);
    Ok((source, nanos.ok_or("it must be a time with a unit, such as 40ms, or SOURCE=TIME")?))
}
