//! Rows of a CSV file.

use std::io::Read;

use fuseline_traces::rows::{Columns, RowError, Rows};

use crate::convert::recorded::{AnnotatedEvent, AnnotatedHeader, ConvertError, Recorded};
use crate::fault::Fault;

/// A CSV file that is being read; it has no header of its own.
pub(crate) struct CsvTable<'a, R> {
    file: &'a str,
    rows: Rows<'a, R>,
}

impl<'a, R: Read> CsvTable<'a, R> {
    pub(crate) fn new(file: &'a str, inner: R, columns: Columns<'a>) -> Result<Self, Fault> {
        let rows = Rows::new(inner, columns).map_err(|error| row(file, error))?;
        Ok(Self { file, rows })
    }
}

impl<R: Read> Recorded for CsvTable<'_, R> {
    fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault> {
        Ok(None)
    }

    fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault> {
        let event = self.rows.next_event().map_err(|error| row(self.file, error))?;
        Ok(event.map(|event| (event, self.rows.annotations().clone())))
    }
}

fn row(file: &str, error: RowError) -> ConvertError {
    let RowError { line, message } = error;
    ConvertError::Row { file: file.to_owned(), line, message }
}
