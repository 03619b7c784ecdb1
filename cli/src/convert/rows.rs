//! Rows of a CSV file or JSON lines, mapped by the user's names.

use std::io::{BufReader, Read};

use fuseline_traces::rows::{Columns, FrameColumn, FrameRows, JsonRows, RowError, Rows};
use fuseline_traces::{Annotations, Event};

use crate::convert::recorded::{AnnotatedEvent, AnnotatedHeader, ConvertError, Recorded};
use crate::fault::Fault;

/// A file of rows that is being read; it has no header of its own.
pub(crate) struct MappedRows<'a, R> {
    file: &'a str,
    rows: AnyRows<'a, R>,
}

enum AnyRows<'a, R> {
    Events(Rows<'a, R>),
    Frames(FrameRows<'a, R>),
    Json(JsonRows<'a, BufReader<R>>),
}

impl<'a, R: Read> MappedRows<'a, R> {
    /// CSV with a row an event.
    pub(crate) fn events(
        file: &'a str,
        inner: R,
        separator: u8,
        columns: Columns<'a>,
    ) -> Result<Self, Fault> {
        let rows = Rows::separated(inner, separator, columns).map_err(|error| row(file, error))?;
        Ok(Self { file, rows: AnyRows::Events(rows) })
    }

    /// CSV with a row a frame.
    pub(crate) fn frames(
        file: &'a str,
        inner: R,
        separator: u8,
        frame: &[FrameColumn],
        columns: Columns<'a>,
    ) -> Result<Self, Fault> {
        let rows = FrameRows::new(inner, separator, frame, columns);
        Ok(Self { file, rows: AnyRows::Frames(rows.map_err(|error| row(file, error))?) })
    }

    /// JSON with an object a line and event.
    pub(crate) fn json(file: &'a str, inner: R, columns: Columns<'a>) -> Self {
        Self { file, rows: AnyRows::Json(JsonRows::new(BufReader::new(inner), columns)) }
    }
}

impl<R: Read> Recorded for MappedRows<'_, R> {
    fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault> {
        Ok(None)
    }

    fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault> {
        let fault = |error| Fault::from(row(self.file, error));
        let with = |event: Option<Event>, annotations: &Annotations| {
            event.map(|event| (event, annotations.clone()))
        };
        Ok(match &mut self.rows {
            AnyRows::Events(rows) => {
                let event = rows.next_event().map_err(fault)?;
                with(event, rows.annotations())
            }
            AnyRows::Json(rows) => {
                let event = rows.next_event().map_err(fault)?;
                with(event, rows.annotations())
            }
            AnyRows::Frames(rows) => with(rows.next_event().map_err(fault)?, &Annotations::NONE),
        })
    }
}

pub(super) fn row(file: &str, error: RowError) -> ConvertError {
    let RowError { line, message } = error;
    ConvertError::Row { file: file.to_owned(), line, message }
}
