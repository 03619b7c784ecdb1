//! [`Mapping`]: what the user says of a log, and the event that a row is in one view of it.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::convert::entry::{Entry, Sources};
use crate::convert::key::EVENTS;
use crate::convert::notes::{Names, Notes, listed, unknown};
use crate::convert::row::{Problem, ProblemKind, Row};
use crate::convert::time::{self, Id, Time, Unit, none_of};

/// The keys that are read by their own names if no others are given. Other keys mean something else
/// in many logs.
const BY_DEFAULT: [&str; 7] = ["ev", "at", "t", "p", "due", "deadline", "backlog"];
/// Keys that are read only where they are named, though they say much if they mean the same as in a
/// trace.
const UNREAD: [(&str, &str, &str); 4] = [
    (
        "of",
        "values of the key \"of\", which no --column names",
        "the message that a value was computed from",
    ),
    (
        "for",
        "values of the key \"for\", which no --column names",
        "the message that a value is meant for",
    ),
    ("try", "values of the key \"try\", which no --column names", "the number of an attempt"),
    (
        "within",
        "values of the key \"within\", which no --column names",
        "the message's own deadline",
    ),
];
const ROUNDED: &str = "times rounded to a nanosecond";
const COMMAS: &str = "times with a decimal comma";
const ZONELESS: &str = "times of day without a zone, read as UTC";
const UNTIMED: &str = "requests without a deadline, at which convert stops";
const MINUS_ONE: &str = "instants of -1, read as before 0";
const UNOPENED: &str = "frames without the instant of their message";

/// The user's description of a log.
#[derive(Debug)]
pub(super) struct Mapping<'a> {
    /// The file's name for an event; events with an empty meaning are skipped.
    pub(super) events: BTreeMap<&'a str, &'static str>,
    pub(super) unit: Unit,
    pub(super) units: BTreeMap<&'static str, Unit>,
    /// The texts that stand for no value.
    pub(super) missing: &'a [String],
    /// The deadlines of requests that state none.
    pub(super) deadlines: &'a [(Option<String>, u64)],
    pub(super) sources: Sources,
    pub(super) names: Names,
    pub(super) notes: Notes,
    /// The number of events that were left out at the user's request.
    pub(super) left_out: u64,
}

/// One way to read a row as an event: its kind, and the places of its values.
#[derive(Debug)]
pub(super) struct View<'a> {
    pub(super) kind: ViewKind,
    /// The topic whose rows it reads, or `None` for all.
    pub(super) topic: Option<usize>,
    /// The event, if rows do not say so.
    pub(super) event: Option<&'static str>,
    /// The source, if rows do not name it.
    pub(super) source: Option<&'a str>,
    pub(super) named: Vec<Named<'a>>,
}

/// The option that names the values of a view.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum ViewKind {
    /// `--column`, and keys of the trace have their own names otherwise.
    Column,
    /// `--frame`: a row has the event if it has its instant.
    Frame,
    /// `--attribute`: the row is a span.
    Span,
}

/// A key of the trace, and what the log calls it.
#[derive(Clone, Debug)]
pub(super) struct Named<'a> {
    pub(super) key: &'static str,
    /// The part of the option before `=`.
    pub(super) what: Cow<'a, str>,
    pub(super) name: Cow<'a, str>,
}

impl ViewKind {
    /// Returns the option that names values, and what they are called.
    pub(super) const fn option_and_noun(self) -> (&'static str, &'static str) {
        match self {
            Self::Column => ("--column", "column"),
            Self::Frame => ("--frame", "column"),
            Self::Span => ("--attribute", "attribute"),
        }
    }
}

impl View<'_> {
    /// Returns the user's name for a key.
    fn given(&self, key: &str) -> Option<&Named<'_>> {
        self.named.iter().find(|named| named.key == key)
    }

    /// Returns the name under which a key is read, or would be.
    fn name<'v>(&'v self, key: &'v str) -> &'v str {
        self.given(key).map_or(key, |named| &named.name)
    }

    /// Returns `true` if a key is read.
    fn reads(&self, key: &str) -> bool {
        self.given(key).is_some() || self.kind == ViewKind::Column && BY_DEFAULT.contains(&key)
    }

    /// Returns `true` if a name of the file is read.
    pub(super) fn uses(&self, name: &str) -> bool {
        self.named.iter().any(|named| named.name == name)
            || self.reads(name) && self.given(name).is_none()
    }
}

impl Mapping<'_> {
    /// Returns the event of a row in this view; none if there is none, or it is to be left out.
    pub(super) fn entry(
        &mut self,
        row: &Row,
        number: u64,
        view: &View<'_>,
    ) -> Result<Option<Entry>, Problem> {
        let Some(ev) = self.event_of(row, view)? else { return Ok(None) };
        let keys = EVENTS.iter().find(|(known, _)| *known == ev).map_or(&[][..], |(_, keys)| keys);
        let at = match (self.cell(row, view, "at"), row.log_time) {
            (Some(text), _) => self.time(row, view, "at", text, time::instant)?,
            // In nanoseconds, whatever the unit of the others is.
            (None, Some(at)) if view.given("at").is_none() => at.into(),
            (None, _) if view.kind == ViewKind::Frame => {
                if ev == "open" {
                    let detail = || format!("column {:?}", view.name("at"));
                    self.notes.add(UNOPENED, &row.place, detail);
                }
                return Ok(None);
            }
            (None, _) => return Err(Self::lacking(row, view, "at", ev)),
        };
        let mut entry = Entry::new(&row.place, number, ev, at);
        for key in keys {
            self.take(&mut entry, row, view, key)?;
        }
        self.complete(&mut entry, row, view)?;
        for (key, kind, what) in UNREAD {
            let text = row.cell(key).unwrap_or_default();
            let is_read = view.kind != ViewKind::Column || view.given(key).is_some();
            if keys.contains(&key) && !is_read && !text.is_empty() {
                let remedy = || format!("if it is {what}, give --column {key}={key}");
                self.notes.add_with(kind, &row.place, || text.to_owned(), remedy);
            }
        }
        Ok(Some(entry))
    }

    /// Returns the event of a row, or `None` if the row is to be left out.
    fn event_of(&mut self, row: &Row, view: &View<'_>) -> Result<Option<&'static str>, Problem> {
        if view.event.is_some() {
            return Ok(view.event);
        }
        let name = self.cell(row, view, "ev").map(str::trim);
        let name = name.ok_or_else(|| Self::lacking(row, view, "ev", "row"))?;
        let event = self.events.get(name).copied();
        if event == Some("") {
            self.left_out += 1;
            return Ok(None);
        }
        let wanted = event.unwrap_or(name);
        let known = EVENTS.iter().map(|(known, _)| *known).find(|known| *known == wanted);
        let shown = name.escape_debug();
        let message = || {
            format!(
                "unknown event {name:?}; say which event it is with --event {shown}=EV, or skip it \
                 with --event {shown}="
            )
        };
        known.map(Some).ok_or_else(|| Problem::at(&row.place, message()))
    }

    /// Reads a key's value, if the row has one.
    fn take(
        &mut self,
        entry: &mut Entry,
        row: &Row,
        view: &View<'_>,
        key: &'static str,
    ) -> Result<(), Problem> {
        let text = match (key, view.source) {
            ("p", Some(source)) => Some(source),
            // An open's deadline is local's: one for all is the requests'.
            ("deadline", _)
                if entry.ev == "open"
                    && view.kind != ViewKind::Frame
                    && row.cell(view.name(key)).is_none() =>
            {
                None
            }
            _ => self.cell(row, view, key),
        };
        let Some(text) = text else { return Ok(()) };
        let wrong = |why: String| Self::wrong(row, view, key, text, &why);
        match key {
            "t" => entry.t = Some(time::id(text).map_err(wrong)?),
            "of" | "for" => entry.ids.push((key, time::id(text).map_err(wrong)?)),
            "p" => entry.p = Some(self.sources.priority(text).map_err(wrong)?),
            "due" => entry.due = Some(self.time(row, view, key, text, time::instant)?),
            "deadline" | "within" | "age" => {
                let time = self.time(row, view, key, text, time::duration)?;
                if key == "deadline" && entry.ev == "request" {
                    entry.due = entry.due.or(Some(entry.at.saturating_add(time)));
                } else {
                    entry.more.push((key, time.to_string()));
                }
            }
            "why" | "origin" => entry.more.push((key, serde_json::Value::from(text).to_string())),
            _ => {
                let number = time::number(text).map_err(wrong)?;
                entry.more.push((key, number.to_string()));
            }
        }
        Ok(())
    }

    /// Adds what is the same for all, and refuses what is missing.
    fn complete(&mut self, entry: &mut Entry, row: &Row, view: &View<'_>) -> Result<(), Problem> {
        let ev = entry.ev;
        if entry.t.is_none() && ev != "tick" {
            if view.kind != ViewKind::Frame || view.given("t").is_some() {
                return Err(Self::lacking(row, view, "t", ev));
            }
            entry.t = Some(Id::Number(entry.row));
        }
        // The source of an output may follow from its results, unless a column of frames names it.
        let is_guessed = ev == "emit" && (view.kind != ViewKind::Frame || !view.reads("p"));
        if entry.p.is_none() && !is_guessed && !matches!(ev, "open" | "tick" | "miss" | "refuse") {
            return Err(Self::lacking(row, view, "p", ev));
        }
        if ev != "request" || entry.due.is_some() {
            return Ok(());
        }
        let source = self.sources.name(entry.p.unwrap_or_default());
        let given = |name: Option<&str>| {
            let found = self.deadlines.iter().rev().find(|(known, _)| known.as_deref() == name);
            found.map(|(_, nanos)| i128::from(*nanos))
        };
        if let Some(deadline) = given(Some(&source)).or_else(|| given(None)) {
            entry.due = Some(entry.at.saturating_add(deadline));
            return Ok(());
        }
        let problem = Self::without_deadline(row, view, &source);
        if self.sources.are_gathered() {
            let remedy = || "state one for all of them with --deadline TIME";
            self.notes.add_with(UNTIMED, &row.place, || problem.without_remedy(), remedy);
            return Ok(());
        }
        Err(problem)
    }

    fn without_deadline(row: &Row, view: &View<'_>, source: &str) -> Problem {
        let name = view.name("deadline");
        let found = match row.cell(name).filter(|_| view.reads("deadline")) {
            Some(text) if text.trim().is_empty() => format!("{name:?} is null or empty"),
            Some(text) => format!("{name:?} is {text}, which --missing says is no value"),
            None if view.reads("deadline") => {
                format!("there is no {} {name:?}", view.kind.option_and_noun().1)
            }
            None => "no column is given for it".to_owned(),
        };
        let remedy = "give the request one, or state one for all requests that have none, such as \
                      --deadline 100ms";
        let message = format!("the request to {source} has no deadline: {found}; {remedy}");
        let lacks = view.given("deadline").map(|named| ProblemKind::Lacks(named.name.to_string()));
        Problem::of_kind(lacks.unwrap_or(ProblemKind::Row), &row.place, message)
    }

    /// Returns the value of a key in a row, or for all rows.
    fn cell<'r>(&self, row: &'r Row, view: &'r View<'_>, key: &'r str) -> Option<&'r str> {
        if !view.reads(key) {
            return None;
        }
        match row.cell(view.name(key)) {
            Some(text) => Some(text).filter(|text| !self.is_missing(text)),
            None => {
                view.given(key).filter(|named| self.is_constant(named)).map(|named| &*named.name)
            }
        }
    }

    /// Returns `true` if a text stands for no value.
    fn is_missing(&self, text: &str) -> bool {
        let text = text.trim();
        text.is_empty() || self.missing.iter().any(|missing| missing.eq_ignore_ascii_case(text))
    }

    /// Returns `true` if what the user named is no name but a value: a duration with its unit, or a
    /// source.
    fn is_constant(&self, named: &Named<'_>) -> bool {
        let Named { key, name, .. } = named;
        let is_value = match *key {
            "deadline" | "within" | "age" => time::duration(name, self.unit_of(key)).is_ok(),
            "p" => self.sources.has(name),
            _ => false,
        };
        is_value && !self.names.has(name)
    }

    fn unit_of(&self, key: &str) -> Unit {
        self.units.get(key).copied().unwrap_or(self.unit)
    }

    /// Returns a time in nanoseconds: an instant or a duration, as `read` reads it.
    pub(super) fn time(
        &mut self,
        row: &Row,
        view: &View<'_>,
        key: &str,
        text: &str,
        read: fn(&str, Unit) -> Result<Time, String>,
    ) -> Result<i128, Problem> {
        let time = read(text, self.unit_of(key));
        let time = time.map_err(|why| Self::wrong(row, view, key, text, &why))?;
        if matches!(text.trim(), "-1" | "-1.0") {
            let remedy = || none_of(text).replacen("it stands", "they stand", 1);
            self.notes.add_with(MINUS_ONE, &row.place, String::new, remedy);
        }
        let is_ns = self.unit == Unit::Ns && !text.contains(['e', 'E', ':']);
        let of_unit = if is_ns { "read as nanoseconds; is --unit right?" } else { "" };
        let all = [
            (time.is_rounded, ROUNDED, of_unit),
            (time.has_comma, COMMAS, ""),
            (time.lacks_zone, ZONELESS, ""),
        ];
        for (_, kind, remedy) in all.into_iter().filter(|(is_so, ..)| *is_so) {
            self.notes.add_with(kind, &row.place, || text.to_owned(), || remedy);
        }
        Ok(time.nanos)
    }

    /// Returns the problem of a value that cannot be read, which has the user's own name for it.
    fn wrong(row: &Row, view: &View<'_>, key: &str, text: &str, why: &str) -> Problem {
        let (_, noun) = view.kind.option_and_noun();
        let is_none = time::is_no_value(text) || text == "-1" && !why.contains("--missing");
        let remedy = if is_none { format!("; {}", none_of(text)) } else { String::new() };
        let name = view.name(key);
        Problem::at(&row.place, format!("{noun} {name:?}: {text:?} is {why}{remedy}"))
    }

    /// Returns the problem of a key that a row lacks, which has the user's own name for it.
    fn lacking(row: &Row, view: &View<'_>, key: &str, ev: &str) -> Problem {
        let this = format!("this {ev}");
        let ((option, noun), name) = (view.kind.option_and_noun(), view.name(key));
        let given = view.given(key).map(|it| format!(", which {option} names for {}", it.what));
        let message = match (row.cell(name), &given) {
            (Some(text), _) if !text.trim().is_empty() => {
                format!("{noun} {name:?} of {this} is {text}, which --missing says is no value")
            }
            (Some(_), None) => format!("{noun} {name:?} of {this} is empty"),
            (Some(_), Some(given)) => format!("{noun} {name:?} of {this}{given}, is empty"),
            (None, Some(given)) if view.kind == ViewKind::Span => {
                format!("{this} has no {noun} {name:?}{given}; --skip-bad skips such messages")
            }
            (None, Some(given)) => format!("{this} has no {noun} {name:?}{given}"),
            (None, None) => {
                let all = listed(key, row.cells.iter().map(|(name, _)| &**name));
                let separator = match row.cells.len() {
                    1 => "; give the character between cells with --separator",
                    _ => "",
                };
                format!(
                    "{this} has no key {key:?}; name it with {option} {key}=NAME; the row has \
                     {all}{separator}"
                )
            }
        };
        Problem::of_kind(ProblemKind::Lacks(name.to_owned()), &row.place, message)
    }

    /// Returns the first of these names that occurs nowhere, as an error with those that do.
    pub(super) fn mistyped(&self, option: &str, given: &[Named<'_>]) -> Option<String> {
        let occurs = |named: &Named<'_>| {
            named.name.is_empty() || self.names.has(&named.name) || self.is_constant(named)
        };
        let Named { what, name, .. } = given.iter().find(|named| !occurs(named))?;
        Some(unknown("", name, &format!("{option} {what}={name}"), self.names.iter()))
    }
}
