//! [`Mapping`]: what the user says of a log, and the events that a row is by it.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::convert::deadline::Deadlines;
use crate::convert::entry::{Entry, Sources};
use crate::convert::frame::Frame;
use crate::convert::key::EVENTS;
use crate::convert::row::{Names, Notes, Row};
use crate::convert::value::{self, Id, Time, Unit, listed};

/// The keys that are read by their own names if no others are given. Other keys mean something else in many logs.
const BY_DEFAULT: [&str; 7] = ["ev", "at", "t", "p", "due", "deadline", "backlog"];
const ROUNDED: &str = "times rounded to a nanosecond";
const COMMAS: &str = "times with a decimal comma";
const ZONELESS: &str = "times of day without a zone, read as UTC";
const UNTIMED: &str = "requests without a deadline, at which convert stops";
const UNREAD_OF: &str = "values of the key \"of\", which no --column names";
const UNREAD_TRY: &str = "values of the key \"try\", which no --column names";
const MINUS_ONE: &str = "instants of -1, read as before 0";
const UNREAD_WITHIN: &str = "values of the key \"within\", which no --column names";

/// What the user says of a log.
#[derive(Debug)]
pub(super) struct Mapping<'a> {
    pub(super) named: BTreeMap<&'static str, &'a str>,
    /// What the file calls an event; the empty event is left out.
    pub(super) events: BTreeMap<&'a str, &'static str>,
    pub(super) unit: Unit,
    pub(super) units: BTreeMap<&'static str, Unit>,
    /// The texts that stand for no value.
    pub(super) missing: &'a [String],
    pub(super) deadlines: &'a Deadlines,
    pub(super) frame: Option<Frame<'a>>,
    pub(super) sources: Sources,
    pub(super) names: Names,
    pub(super) event_names: Names,
    pub(super) notes: Notes,
    /// How many events were left out as the user said.
    pub(super) left_out: u64,
}

/// What a topic says of all its messages.
#[derive(Clone, Default, Debug)]
pub(super) struct Fixed<'f> {
    pub(super) event: Option<&'static str>,
    pub(super) source: Option<&'f str>,
}

/// Why a row is no event: the message, and the user's own name for what is missing, if that is why.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) message: String,
    pub(super) lacks: Option<String>,
}

impl From<String> for Refusal {
    fn from(message: String) -> Self {
        Self { message, lacks: None }
    }
}

impl Mapping<'_> {
    /// The events of a row; none if it is to be left out.
    ///
    /// # Errors
    /// If it is no event.
    pub(super) fn entries(
        &mut self,
        row: &Row,
        number: u64,
        fixed: &Fixed<'_>,
    ) -> Result<Vec<Entry>, Refusal> {
        if self.frame.is_some() {
            return self.frame_entries(row, number);
        }
        Ok(self.entry(row, number, fixed)?.into_iter().collect())
    }

    fn entry(
        &mut self,
        row: &Row,
        number: u64,
        fixed: &Fixed<'_>,
    ) -> Result<Option<Entry>, Refusal> {
        let Some(ev) = self.event_of(row, fixed)? else { return Ok(None) };
        let takes = EVENTS.iter().find(|(known, _)| *known == ev).map_or(&[][..], |(_, keys)| keys);
        let text = self.cell(row, "at").map(Cow::into_owned);
        let at = match (text, row.log_time) {
            (Some(text), _) => self.instant(row, "at", &text)?.nanos,
            // In nanoseconds, whatever the unit of the others is.
            (None, Some(at)) if !self.named.contains_key("at") => at.into(),
            (None, _) => return Err(self.lacking("at", ev, row)),
        };
        let place = row.place.clone();
        let mut entry = Entry {
            place,
            row: number,
            ev,
            at,
            t: None,
            p: None,
            due: None,
            of: None,
            more: Vec::new(),
        };
        for key in takes.iter().copied() {
            self.take(&mut entry, row, key, fixed)?;
        }
        self.complete(&mut entry, row)?;
        let unread = [
            ("of", UNREAD_OF, "if it says whose value a result is, give --column of=of"),
            ("try", UNREAD_TRY, "if it says which attempt a line is of, give --column try=try"),
            (
                "within",
                UNREAD_WITHIN,
                "if it is the message's own deadline, give --column within=within",
            ),
        ];
        for (key, kind, remedy) in unread {
            let text = row.cell(key).unwrap_or_default();
            if takes.contains(&key) && !self.named.contains_key(key) && !text.is_empty() {
                self.notes.add_with(kind, &row.place, || text.to_owned(), || remedy.to_owned());
            }
        }
        Ok(Some(entry))
    }

    /// Which event a row is; none if it is to be left out.
    fn event_of(&mut self, row: &Row, fixed: &Fixed<'_>) -> Result<Option<&'static str>, Refusal> {
        if let Some(event) = fixed.event {
            return Ok(Some(event));
        }
        let Some(name) = self.cell(row, "ev") else {
            return Err(self.lacking("ev", "row", row));
        };
        let name = name.trim().to_owned();
        self.event_names.add(&name.as_str().into());
        let event = self.events.get(&*name).copied();
        if event == Some("") {
            self.left_out += 1;
            return Ok(None);
        }
        let wanted = event.unwrap_or(&name);
        if let Some((known, _)) = EVENTS.iter().find(|(known, _)| *known == wanted) {
            return Ok(Some(known));
        }
        let shown = name.escape_debug();
        let message = format!(
            "unknown event {name:?}; say what it is with --event {shown}=EV, or leave it out with --event {shown}="
        );
        Err(message.into())
    }

    /// Reads a key's value, if the row has one.
    fn take(
        &mut self,
        entry: &mut Entry,
        row: &Row,
        key: &'static str,
        fixed: &Fixed<'_>,
    ) -> Result<(), Refusal> {
        let text = match (key, fixed.source) {
            ("p", Some(source)) => Some(source.to_owned()),
            // An open's deadline is local's, and no request's.
            ("deadline", _) if entry.ev == "open" && self.constant(row, key).is_some() => None,
            _ => self.cell(row, key).map(Cow::into_owned),
        };
        let Some(text) = text else { return Ok(()) };
        match key {
            "t" => entry.t = Some(self.id(key, &text)?),
            "of" => entry.of = Some(self.id(key, &text)?),
            "p" => {
                let p = self.sources.priority(&text);
                entry.p = Some(p.map_err(|why| self.wrong(key, &text, &why))?);
            }
            "due" => entry.due = Some(self.instant(row, key, &text)?.nanos),
            "deadline" | "within" | "age" => {
                let time = self.duration(row, key, &text)?.nanos;
                if key == "deadline" && entry.ev == "request" {
                    entry.due = entry.due.or(Some(entry.at.saturating_add(time)));
                } else {
                    entry.more.push((key, time.to_string()));
                }
            }
            "why" | "origin" => {
                entry.more.push((key, serde_json::Value::from(&*text).to_string()));
            }
            _ => {
                let number = value::number(&text);
                let number = number.map_err(|why| self.wrong(key, &text, &why))?;
                entry.more.push((key, number.to_string()));
            }
        }
        Ok(())
    }

    /// Adds what is the same for all, and refuses what is missing.
    fn complete(&mut self, entry: &mut Entry, row: &Row) -> Result<(), Refusal> {
        let ev = entry.ev;
        if entry.t.is_none() && ev != "tick" {
            return Err(self.lacking("t", ev, row));
        }
        // Whose an output is may follow from its results.
        if entry.p.is_none() && !matches!(ev, "open" | "tick" | "miss" | "emit" | "refuse") {
            return Err(self.lacking("p", ev, row));
        }
        if ev == "request" && entry.due.is_none() {
            let source = self.sources.name(entry.p.unwrap_or_default());
            let Some(deadline) = self.deadlines.of(&source) else {
                let refusal = self.without_deadline(row);
                if self.sources.are_gathered() {
                    let remedy = || "--deadline TIME states one for them".to_owned();
                    let detail =
                        || refusal.message.split(';').next().unwrap_or_default().to_owned();
                    self.notes.add_with(UNTIMED, &row.place, detail, remedy);
                    return Ok(());
                }
                return Err(refusal);
            };
            entry.due = Some(entry.at.saturating_add(deadline.into()));
        }
        Ok(())
    }

    fn without_deadline(&self, row: &Row) -> Refusal {
        let name = self.named.get("deadline").copied().unwrap_or("deadline");
        let found = match row.cell(name) {
            Some(text) if text.trim().is_empty() => format!("{name:?} is null or empty"),
            Some(text) => format!("{name:?} is {text}, which --missing says is no value"),
            None => format!("the row has no {name:?}"),
        };
        let lacks = self.named.get("deadline").map(|name| (*name).to_owned());
        let message = format!(
            "the request has no deadline: {found}; give the column a value, or state one deadline for requests \
             without: --deadline 100ms"
        );
        Refusal { message, lacks }
    }

    /// What stands for a key in a row, or for all rows.
    fn cell<'r>(&'r self, row: &'r Row, key: &str) -> Option<Cow<'r, str>> {
        let name = match self.named.get(key) {
            Some(name) => *name,
            None if BY_DEFAULT.contains(&key) => key,
            None => return None,
        };
        match row.cell(name) {
            Some(text) => Some(Cow::Borrowed(text)).filter(|text| !self.is_missing(text)),
            None => self.constant(row, key).map(Cow::Borrowed),
        }
    }

    /// Whether a text stands for no value.
    pub(super) fn is_missing(&self, text: &str) -> bool {
        let text = text.trim();
        text.is_empty() || self.missing.iter().any(|missing| missing.eq_ignore_ascii_case(text))
    }

    /// What the user named that is no name but a value: a duration with its unit, or a source.
    fn constant(&self, row: &Row, key: &str) -> Option<&str> {
        let name = self.named.get(key).copied().filter(|name| row.cell(name).is_none())?;
        self.is_constant(key, name).then_some(name)
    }

    pub(super) fn is_constant(&self, key: &str, name: &str) -> bool {
        match key {
            "deadline" | "within" | "age" => value::duration(name, self.unit_of(key)).is_ok(),
            "p" => !self.sources.are_gathered() && self.sources.has(name),
            _ => false,
        }
    }

    pub(super) fn unit_of(&self, key: &str) -> Unit {
        self.units.get(key).copied().unwrap_or(self.unit)
    }

    pub(super) fn instant(&mut self, row: &Row, key: &str, text: &str) -> Result<Time, Refusal> {
        let time = value::instant(text, self.unit_of(key));
        let time = time.map_err(|why| self.wrong(key, text, &why))?;
        if matches!(text.trim(), "-1" | "-1.0") {
            let remedy = || format!("if they stand for no value, say so with --missing={text}");
            self.notes.add_with(MINUS_ONE, &row.place, String::new, remedy);
        }
        self.note_time(row, text, time);
        Ok(time)
    }

    pub(super) fn duration(&mut self, row: &Row, key: &str, text: &str) -> Result<Time, Refusal> {
        let time = value::duration(text, self.unit_of(key));
        let time = time.map_err(|why| self.wrong(key, text, &why))?;
        self.note_time(row, text, time);
        Ok(time)
    }

    fn note_time(&mut self, row: &Row, text: &str, time: Time) {
        let of_unit = if self.unit == Unit::Ns && !text.contains(['e', 'E', ':']) {
            "read as nanoseconds; is --unit right?"
        } else {
            ""
        };
        let all = [
            (time.is_rounded, ROUNDED, of_unit),
            (time.has_comma, COMMAS, ""),
            (time.lacks_zone, ZONELESS, ""),
        ];
        for (_, kind, remedy) in all.into_iter().filter(|(is_so, ..)| *is_so) {
            self.notes.add_with(kind, &row.place, || text.to_owned(), || remedy.to_owned());
        }
    }

    /// A value that cannot be read, by the user's own name for it.
    pub(super) fn wrong(&self, key: &str, text: &str, why: &str) -> Refusal {
        let name = self.named.get(key).copied().unwrap_or(key);
        let is_none = value::is_no_value(text);
        let remedy = if is_none || text == "-1" && !why.contains("--missing") {
            format!("; if it stands for no value, say so with --missing={text}")
        } else {
            String::new()
        };
        format!("column {name:?}: {text:?} is {why}{remedy}").into()
    }

    /// A key that a row lacks, by the user's own name for it.
    fn lacking(&self, key: &str, ev: &str, row: &Row) -> Refusal {
        let of = if ev == "row" { String::new() } else { format!(" of this {ev}") };
        let Some(name) = self.named.get(key).copied() else {
            let all = listed(key, row.cells.iter().map(|(name, _)| &**name));
            let found = if row.cell(key).is_some() {
                format!("column {key:?}{of} is empty")
            } else {
                let separator = match row.cells.len() {
                    1 => "; --separator says what stands between cells",
                    _ => "",
                };
                format!(
                    "no key {key:?}{of}; name it with --column {key}=NAME; the row has {all}{separator}"
                )
            };
            return Refusal { message: found, lacks: Some(key.to_owned()) };
        };
        let message = match row.cell(name) {
            Some(text) if text.trim().is_empty() => {
                format!("column {name:?}{of}, which --column names for {key}, is empty")
            }
            Some(text) => {
                format!("column {name:?}{of} is {text}, which --missing says is no value")
            }
            None => format!("no {name:?}{of}, which --column names for {key}"),
        };
        Refusal { message, lacks: Some(name.to_owned()) }
    }

    /// The names that were given and occur nowhere, as an error with those that do.
    pub(super) fn mistyped(&self) -> Option<String> {
        let named = self.named.iter().map(|(key, name)| ("--column", *key, *name));
        let mut named: Vec<_> = named
            .filter(|(_, key, name)| !name.is_empty() && !self.is_constant(key, name))
            .map(|(option, key, name)| (option, key.to_owned(), name))
            .collect();
        if let Some(frame) = &self.frame {
            named = frame.named(self);
        }
        let (option, key, name) = named.into_iter().find(|(_, _, name)| !self.names.has(name))?;
        let all = listed(name, self.names.iter());
        let seed = format!(
            "no {name:?} in the file, which {option} {key}={name} names; the file has {all}"
        );
        Some(seed)
    }

    /// Whether a name of the file is read.
    pub(super) fn uses(&self, name: &str) -> bool {
        let is_default = |key: &&str| !self.named.contains_key(*key) && **key == *name;
        self.named.values().any(|named| *named == name) || BY_DEFAULT.iter().any(is_default)
    }

    /// The id of a text, for frames.
    pub(super) fn id(&self, key: &str, text: &str) -> Result<Id, Refusal> {
        value::id(text).map_err(|why| self.wrong(key, text, &why))
    }
}
