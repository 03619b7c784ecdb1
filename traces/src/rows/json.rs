//! [`JsonRows`]: events read from JSON lines, with the caller's names of keys and events and its unit of time.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::BufRead;

use serde::Deserialize;
use serde_json::value::RawValue;

use super::columns::{Columns, Unit};
use super::{RowError, event_of};
use crate::parse::LineAnnotations;
use crate::{Annotations, Event};

/// A file that is being read: a JSON object a line. A key that the caller names may be within others: `header.stamp`.
#[derive(Debug)]
pub struct JsonRows<'a, R> {
    inner: R,
    columns: Columns<'a>,
    line: Vec<u8>,
    number: u64,
    annotations: LineAnnotations,
}

/// One object's values by their keys, as they are written.
type JsonFields<'j> = BTreeMap<Cow<'j, str>, &'j RawValue>;

impl<'a, R: BufRead> JsonRows<'a, R> {
    /// Reads as the columns say; nothing is read yet.
    pub fn new(inner: R, columns: Columns<'a>) -> Self {
        let (line, annotations) = (Vec::new(), LineAnnotations::default());
        Self { inner, columns, line, number: 0, annotations }
    }

    /// What the line read last has beside what the machine's rules read.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// The next event; none at the end. Blank lines, and events to be left out, are passed over.
    ///
    /// # Errors
    /// If a line cannot be read, or is no event.
    pub fn next_event(&mut self) -> Result<Option<Event>, RowError> {
        loop {
            self.line.clear();
            self.number += 1;
            let fault = |message| RowError { line: self.number, message };
            let read = self.inner.read_until(b'\n', &mut self.line);
            if read.map_err(|error| fault(error.to_string()))? == 0 {
                return Ok(None);
            }
            if self.line.trim_ascii().is_empty() {
                continue;
            }
            let line = line_of(&self.line, &self.columns).map_err(fault)?;
            if let Some(line) = line {
                return event_of(&line, self.number, &mut self.annotations).map(Some);
            }
        }
    }
}

/// One JSON object as an event, with its further keys; none if it is to be left out. It has `log_time` as `at`, if it has
/// none and none is named.
///
/// # Errors
/// If it is no event.
pub fn json_event(
    json: &[u8],
    log_time: u64,
    columns: &Columns<'_>,
) -> Result<Option<(Event, Annotations)>, String> {
    let fields = fields_of(json)?;
    field_event(&|name| found(&fields, name), log_time, columns)
}

/// The same of what is no JSON: `field` has the text that stands for a path of names, such as `header.stamp`.
///
/// # Errors
/// If it is no event.
pub fn field_event<'f>(
    field: &dyn Fn(&str) -> Option<Cow<'f, str>>,
    log_time: u64,
    columns: &Columns<'_>,
) -> Result<Option<(Event, Annotations)>, String> {
    let Some(line) = line_at(field, Some(log_time), columns)? else { return Ok(None) };
    let mut annotations = LineAnnotations::default();
    let event = event_of(&line, 0, &mut annotations).map_err(|error| error.message)?;
    Ok(Some((event, annotations.event)))
}

/// A line's object as a line of a trace; none if it is to be left out.
fn line_of(json: &[u8], columns: &Columns<'_>) -> Result<Option<String>, String> {
    let fields = fields_of(json)?;
    line_at(&|name| found(&fields, name), None, columns)
}

fn fields_of(json: &[u8]) -> Result<JsonFields<'_>, String> {
    let text = str::from_utf8(json).map_err(|_| "not UTF-8".to_owned())?;
    serde_json::from_str(text).map_err(|error| no_object(&error))
}

fn line_at<'f>(
    field: &dyn Fn(&str) -> Option<Cow<'f, str>>,
    at: Option<u64>,
    columns: &Columns<'_>,
) -> Result<Option<String>, String> {
    let names: BTreeMap<&str, &str> = columns.keys().map(|(key, _, name, _)| (key, name)).collect();
    for (key, _, name, is_named) in columns.keys() {
        // Some keys are of some events alone.
        let is_needed = key == "ev" || (key == "at" && (at.is_none() || is_named));
        if is_needed && !columns.is_fixed(key) && field(name).is_none() {
            let remedy = if is_named {
                String::new()
            } else {
                format!("; name it with --column {key}=NAME")
            };
            return Err(format!("no key {name:?}{remedy}"));
        }
    }
    let own = |key: &str| field(names.get(key)?);
    match at.filter(|_| own("at").is_none()) {
        None => columns.line(own),
        // In nanoseconds, whatever the unit of the others is.
        Some(at) => columns.clone().with_units([("at", Unit::Ns)]).line(|key| match key {
            "at" => Some(at.to_string().into()),
            key => own(key),
        }),
    }
}

/// What stands for a path of keys, as text.
fn found<'j>(fields: &JsonFields<'j>, path: &str) -> Option<Cow<'j, str>> {
    if let Some(value) = fields.get(path) {
        return text_of(value);
    }
    let (first, rest) = path.split_once('.')?;
    let within: JsonFields<'j> = serde_json::from_str(fields.get(first)?.get()).ok()?;
    found(&within, rest)
}

/// A text without its quotes, a number as it is written, ROS' times in seconds; nothing for null.
fn text_of(value: &RawValue) -> Option<Cow<'_, str>> {
    #[derive(Deserialize)]
    struct SecondsObject {
        sec: u64,
        #[serde(alias = "nsec")]
        nanosec: u32,
    }
    match value.get() {
        "null" => None,
        text if text.starts_with('"') => serde_json::from_str(text).ok().map(Cow::Owned),
        text => Some(match serde_json::from_str(text) {
            Ok(SecondsObject { sec, nanosec }) => seconds(sec, nanosec).into(),
            Err(_) => text.into(),
        }),
    }
}

/// A time as `--unit` need not say: its seconds, with that unit.
#[must_use]
pub fn seconds(seconds: u64, nanoseconds: u32) -> String {
    let carried = seconds.saturating_add(u64::from(nanoseconds / 1_000_000_000));
    format!("{carried}.{:09}s", nanoseconds % 1_000_000_000)
}

fn no_object(error: &serde_json::Error) -> String {
    format!("not a JSON object: {error}").replace(char::is_control, "\u{fffd}")
}
