//! [`FrameRows`]: events read from a CSV file that has a row a frame, with columns for each source.

use std::io::Read;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::columns::Columns;
use super::{RowError, TableReader, event_of};
use crate::Event;
use crate::parse::LineAnnotations;

/// Where the events of a frame stand.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FrameColumn {
    /// Whose event it is; none of the frame itself.
    pub source: Option<String>,
    /// Which event, or what of it.
    pub part: FramePart,
    /// The column's name; of a deadline it may be a number in the file's unit, the same for all rows.
    pub column: String,
}

/// What a column of frames has; of one instant, events come in this order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum FramePart {
    /// The timestamp; without such a column rows are counted from 0.
    T,
    /// The instant at which the message came.
    Open,
    /// The instant of the source's request.
    Request,
    /// How long the request had.
    Deadline,
    /// The instant of the source's result.
    Result,
    /// The instant of the source's failure.
    Fail,
    /// The instant at which its output was sent.
    Emit,
    /// The source of the output: its name or priority.
    By,
    /// The instant at which it was given up.
    Miss,
}

/// A file of frames that is being read.
#[derive(Debug)]
pub struct FrameRows<'a, R> {
    inner: TableReader<R>,
    columns: Columns<'a>,
    places: Vec<PlacedColumn>,
    /// Those of the row read last that are not taken yet, the next one last.
    events: Vec<Event>,
    rows: u64,
}

/// A column that was found in the first row.
#[derive(Debug)]
struct PlacedColumn {
    /// The source's priority.
    p: Option<u64>,
    part: FramePart,
    /// Where it stands; none if the value is the same for all rows.
    place: Option<usize>,
    name: String,
}

impl FramePart {
    const OF_FRAME: [(&'static str, Self); 5] = [
        ("t", Self::T),
        ("open", Self::Open),
        ("emit", Self::Emit),
        ("by", Self::By),
        ("miss", Self::Miss),
    ];
    const OF_SOURCE: [(&'static str, Self); 4] = [
        ("request", Self::Request),
        ("deadline", Self::Deadline),
        ("result", Self::Result),
        ("fail", Self::Fail),
    ];
}

/// `open=COLUMN` of the frame, or `SOURCE.result=COLUMN` of a source.
///
/// # Errors
/// What to write instead.
pub fn frame_column(text: &str) -> Result<FrameColumn, String> {
    let (what, column) = text.split_once('=').ok_or("write open=COLUMN or SOURCE.result=COLUMN")?;
    let column = column.to_owned();
    let named = |all: &[(&str, FramePart)], word: &str| {
        let found = all.iter().find(|(known, _)| *known == word).map(|(_, part)| *part);
        let words: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        found.ok_or_else(|| format!("no {word:?}; it is one of {}", words.join(", ")))
    };
    Ok(match what.rsplit_once('.') {
        None => FrameColumn { source: None, part: named(&FramePart::OF_FRAME, what)?, column },
        Some((source, word)) => {
            let part = named(&FramePart::OF_SOURCE, word)?;
            FrameColumn { source: Some(source.to_owned()), part, column }
        }
    })
}

impl<'a, R: Read> FrameRows<'a, R> {
    /// Reads the first row, which names the columns.
    ///
    /// # Errors
    /// If it cannot be read, or a column or a source is missing.
    pub fn new(
        inner: R,
        separator: u8,
        frame: &[FrameColumn],
        columns: Columns<'a>,
    ) -> Result<Self, RowError> {
        let mut options = ReaderBuilder::new();
        options.trim(Trim::All).delimiter(separator);
        let mut inner = TableReader::new(inner, &options);
        let fault = |message: String| RowError { line: 1, message };
        let names = inner.names()?;
        let mut places = Vec::new();
        for FrameColumn { source, part, column } in frame {
            let place = names.iter().position(|name| name == column);
            let is_fixed =
                *part == FramePart::Deadline && columns.time("deadline", column).is_some();
            if place.is_none() && !is_fixed {
                return Err(fault(format!("no column {column:?}")));
            }
            let p = source.as_deref().map(|source| {
                columns.source(source).map_err(|why| fault(format!("{source:?} is {why}")))
            });
            let p = p.transpose()?;
            places.push(PlacedColumn { p, part: *part, place, name: column.clone() });
        }
        if !places.iter().any(|column| column.part == FramePart::Open) {
            return Err(fault("no column for open; name it with --frame open=COLUMN".to_owned()));
        }
        // Of one instant the message comes first, then requests, then what came of them.
        places.sort_by_key(|column| column.part);
        Ok(Self { inner, columns, places, events: Vec::new(), rows: 0 })
    }

    /// The next event; none at the end. Events stand by their rows.
    ///
    /// # Errors
    /// If a row cannot be read, or a cell is not what it stands for.
    pub fn next_event(&mut self) -> Result<Option<Event>, RowError> {
        loop {
            if let Some(event) = self.events.pop() {
                return Ok(Some(event));
            }
            let Some((number, row)) = self.inner.next_row()? else { return Ok(None) };
            let frame = FrameRow { row, places: &self.places, columns: &self.columns };
            let lines = frame.lines(self.rows);
            let lines = lines.map_err(|message| RowError { line: number, message })?;
            self.rows += 1;
            let mut annotations = LineAnnotations::default();
            for line in lines.iter().rev() {
                self.events.push(event_of(line, number, &mut annotations)?);
            }
        }
    }
}

/// One row.
struct FrameRow<'r> {
    row: &'r StringRecord,
    places: &'r [PlacedColumn],
    columns: &'r Columns<'r>,
}

impl<'r> FrameRow<'r> {
    /// Its events as lines of a trace.
    fn lines(&self, number: u64) -> Result<Vec<String>, String> {
        let t = match self.of(None, FramePart::T) {
            Some(column) => self.number(column)?.ok_or_else(|| empty(column))?,
            None => number,
        };
        let mut lines = Vec::new();
        for column in self.places {
            let p = column.p.unwrap_or_default();
            let event = match column.part {
                FramePart::Open => "open",
                FramePart::Emit => "emit",
                FramePart::Miss => "miss",
                FramePart::Request => "request",
                FramePart::Result => "result",
                FramePart::Fail => "fail",
                FramePart::T | FramePart::By | FramePart::Deadline => continue,
            };
            let Some(at) = self.time("at", column)? else { continue };
            let rest = match column.part {
                FramePart::Emit => format!(",\"p\":{}", self.by()?),
                FramePart::Request => {
                    let due = at.saturating_add(self.deadline(column)?);
                    format!(",\"p\":{p},\"due\":{due}")
                }
                FramePart::Result | FramePart::Fail => format!(",\"p\":{p}"),
                _ => String::new(),
            };
            lines.push(format!("{{\"ev\":\"{event}\",\"at\":{at},\"t\":{t}{rest}}}"));
        }
        Ok(lines)
    }

    fn of(&self, p: Option<u64>, part: FramePart) -> Option<&'r PlacedColumn> {
        self.places.iter().find(|column| column.p == p && column.part == part)
    }

    fn cell(&self, column: &'r PlacedColumn) -> Option<&'r str> {
        match column.place {
            Some(place) => self.row.get(place).filter(|text| !text.is_empty()),
            None => Some(&column.name),
        }
    }

    fn number(&self, column: &'r PlacedColumn) -> Result<Option<u64>, String> {
        let parsed = self.cell(column).map(|text| text.parse().map_err(|_| wrong(column, text)));
        parsed.transpose()
    }

    fn time(&self, key: &str, column: &'r PlacedColumn) -> Result<Option<u64>, String> {
        let read = |text| self.columns.time(key, text).ok_or_else(|| wrong(column, text));
        self.cell(column).map(read).transpose()
    }

    /// Who the output was of.
    fn by(&self) -> Result<u64, String> {
        let column = self.of(None, FramePart::By).ok_or("an emit needs --frame by=COLUMN")?;
        let text = self.cell(column).ok_or_else(|| empty(column))?;
        let source = self.columns.source(text);
        source.map_err(|why| format!("column {:?}: {text:?} is {why}", column.name))
    }

    /// How long a request had.
    fn deadline(&self, request: &'r PlacedColumn) -> Result<u64, String> {
        let column = self.of(request.p, FramePart::Deadline);
        let column = column.ok_or("a request needs --frame SOURCE.deadline=COLUMN")?;
        self.time("deadline", column)?.ok_or_else(|| empty(column))
    }
}

fn empty(column: &PlacedColumn) -> String {
    format!("column {:?} is empty", column.name)
}

fn wrong(column: &PlacedColumn, text: &str) -> String {
    format!("column {:?}: {text:?} is not a number that fits", column.name)
}
