//! The keys and events of a trace, and what the user calls them.

use crate::convert::value::Unit;

/// The keys that an event may have.
const KEYS: [&str; 14] = [
    "ev", "at", "t", "p", "due", "deadline", "backlog", "why", "of", "try", "within", "age",
    "origin", "seq",
];
/// The keys that are times.
const TIMES: [&str; 5] = ["at", "due", "deadline", "within", "age"];

/// Events, with the keys that each may have beside `ev` and `at`.
pub(super) const EVENTS: [(&str, &[&str]); 14] = [
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
    ("final", &["t", "p"]),
    ("miss", &["t"]),
    ("cancel", &["t", "p"]),
];

/// `KEY=NAME`: a key of the trace, and what the file calls it.
///
/// # Errors
/// What to write instead.
pub(super) fn column(text: &str) -> Result<(&'static str, String), String> {
    let (key, name) = text.split_once('=').ok_or("write KEY=NAME, such as at=stamp")?;
    let known = KEYS.iter().find(|known| **known == key);
    let known = known.ok_or_else(|| format!("no key {key:?}; it is one of {}", KEYS.join(", ")));
    known.map(|known| (*known, name.to_owned()))
}

/// `NAME=EV`: what the file calls an event of a trace; `NAME=` leaves those events out.
///
/// # Errors
/// What to write instead.
pub(super) fn event(text: &str) -> Result<(String, &'static str), String> {
    let (name, event) = text.rsplit_once('=').ok_or("write NAME=EV, such as response=result")?;
    if event.is_empty() {
        return Ok((name.to_owned(), ""));
    }
    let known = EVENTS.iter().find(|(known, _)| *known == event);
    let (event, _) = known.ok_or_else(|| format!("no event {event:?} in a trace"))?;
    Ok((name.to_owned(), event))
}

/// `UNIT` or `KEY=UNIT`: the unit of all times, or of one key's.
///
/// # Errors
/// What to write instead.
pub(super) fn unit(text: &str) -> Result<(Option<&'static str>, Unit), String> {
    let (key, name) = match text.split_once('=') {
        Some((key, name)) => (Some(key), name),
        None => (None, text),
    };
    let unit = Unit::named(name)?;
    let Some(key) = key else { return Ok((None, unit)) };
    let found = TIMES.into_iter().find(|known| *known == key);
    let found =
        found.ok_or_else(|| format!("no time {key:?}; it is one of {}", TIMES.join(", ")))?;
    Ok((Some(found), unit))
}
