//! [`Rows`]: events read from a CSV file, with the caller's names of columns and events and its unit of time;
//! [`JsonRows`]: the same from JSON lines.

use std::borrow::Cow;
use std::io::Read;

use csv::{ReaderBuilder, Trim};
use thiserror::Error;

pub use self::columns::{Columns, Unit, column, event, unit};
pub use self::frames::{FrameColumn, FramePart, FrameRows, frame_column};
pub use self::json::{JsonRows, field_event, json_event, seconds};
pub use self::table::{TableError, TableReader};

use crate::parse::{Form, LineAnnotations, parse_as};
use crate::{Annotations, Event, Line};

mod columns;
mod frames;
mod instant;
mod json;
mod table;

/// A CSV file that is being read: a row an event, the columns named in the first row.
///
/// The columns `at`, `ev`, `t`, `p`, `due`, `deadline`, `backlog`, `why`, `of`, `try`, `within`, `age`, `origin` and `seq`
/// are read, those that a row's event has; an empty cell is none.
#[derive(Debug)]
pub struct Rows<'a, R> {
    inner: TableReader<R>,
    /// The keys that it has, with the places of their columns.
    keys: Vec<(&'static str, usize)>,
    columns: Columns<'a>,
    annotations: LineAnnotations,
}

/// What is wrong with a row.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
#[error("{line}: {message}")]
pub struct RowError {
    /// The row's line, from 1.
    pub line: u64,
    /// What is wrong.
    pub message: String,
}

impl<'a, R: Read> Rows<'a, R> {
    /// Reads the first row, which names the columns; cells are separated by commas.
    ///
    /// # Errors
    /// If it cannot be read, or a column is missing.
    pub fn new(inner: R, columns: Columns<'a>) -> Result<Self, RowError> {
        Self::separated(inner, b',', columns)
    }

    /// The same with another separator.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn separated(inner: R, separator: u8, columns: Columns<'a>) -> Result<Self, RowError> {
        let mut options = ReaderBuilder::new();
        options.trim(Trim::All).delimiter(separator);
        let mut inner = TableReader::new(inner, &options);
        let fault = |message: String| RowError { line: 1, message };
        let names = inner.names()?;
        let mut keys = Vec::new();
        for (key, _, name, is_named) in columns.keys() {
            let Some(place) = names.iter().position(|column| column == name) else {
                let message = match key {
                    _ if columns.is_fixed(key) => continue,
                    _ if is_named => format!("no column {name:?} for {key}"),
                    "ev" | "at" => format!("no column {key:?}; name one with --column {key}=NAME"),
                    _ => continue,
                };
                return Err(fault(message));
            };
            keys.push((key, place));
        }
        Ok(Self { inner, keys, columns, annotations: LineAnnotations::default() })
    }

    /// What the row read last has beside what the machine's rules read.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// The next row's event; none at the end. Events to be left out are passed over.
    ///
    /// # Errors
    /// If the row cannot be read, or is no event.
    pub fn next_event(&mut self) -> Result<Option<Event>, RowError> {
        loop {
            let Some((number, row)) = self.inner.next_row()? else { return Ok(None) };
            let cell = |key: &str| {
                let (_, place) = self.keys.iter().find(|(known, _)| *known == key)?;
                row.get(*place).map(Cow::Borrowed)
            };
            let line = self.columns.line(cell);
            let line = line.map_err(|message| RowError { line: number, message })?;
            if let Some(line) = line {
                return event_of(&line, number, &mut self.annotations).map(Some);
            }
        }
    }
}

/// A line of a trace as its event.
fn event_of(line: &str, number: u64, annotations: &mut LineAnnotations) -> Result<Event, RowError> {
    let fault = |message| RowError { line: number, message };
    match parse_as(line.as_bytes(), Form::Observed, annotations) {
        Ok(Line::Event(event)) => Ok(event),
        Ok(Line::Header(_)) => Err(fault("a header in a row".to_owned())),
        Err(error) => Err(fault(error.message)),
    }
}

impl From<TableError> for RowError {
    fn from(error: TableError) -> Self {
        Self { line: error.line, message: error.to_string() }
    }
}
