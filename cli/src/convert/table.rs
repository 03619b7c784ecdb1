//! Rows of CSV.

use std::io::Read;
use std::sync::Arc;

use csv::{ErrorKind, ReaderBuilder, Trim};
use fuseline_traces::rows::{TableError, TableReader};

use crate::convert::row::{Place, Problem, ProblemKind, ReadRow, Row, Spot};

/// A CSV file that is being read; its first row names the columns.
pub(super) struct TableRows<R> {
    file: Arc<str>,
    inner: TableReader<R>,
    names: Vec<Arc<str>>,
}

impl<R: Read> TableRows<R> {
    /// Reads the first row.
    pub(super) fn new(file: &Arc<str>, inner: R, separator: u8) -> Result<Self, Problem> {
        let mut options = ReaderBuilder::new();
        options.trim(Trim::All).delimiter(separator);
        let mut inner = TableReader::new(inner, &options);
        let names = inner.names().map_err(|error| problem(file, &error))?;
        let names = names.iter().map(Arc::from).collect();
        Ok(Self { file: Arc::clone(file), inner, names })
    }

    /// Returns a name that two columns have.
    pub(super) fn doubled(&self) -> Option<&str> {
        let is_doubled = |(place, name): &(usize, &Arc<str>)| {
            !name.is_empty() && self.names[..*place].contains(name)
        };
        self.names.iter().enumerate().find(is_doubled).map(|(_, name)| &**name)
    }
}

impl<R: Read> Iterator for TableRows<R> {
    type Item = ReadRow;

    fn next(&mut self) -> Option<ReadRow> {
        let (line, record) = match self.inner.next_row() {
            Ok(row) => row?,
            Err(error) => return Some(Err(problem(&self.file, &error))),
        };
        let place = Place::new(&self.file, Spot::Line(line));
        if record.iter().eq(self.names.iter().map(|name| &**name)) {
            let message = "the row repeats the names of the columns, as after a restart; split the \
                           file here, or skip such rows with --skip-bad";
            return Some(Err(Problem::at(&place, message)));
        }
        let cells = self.names.iter().cloned().zip(record.iter().map(str::to_owned)).collect();
        Some(Ok(Row::new(place, cells)))
    }
}

fn problem(file: &Arc<str>, error: &TableError) -> Problem {
    let place = Place::new(file, Spot::Line(error.line));
    match error.source.kind() {
        ErrorKind::UnequalLengths { .. } => {
            let remedy = "give the character between cells with --separator, or skip such rows \
                          with --skip-bad";
            Problem::at(&place, format!("{error}; {remedy}"))
        }
        ErrorKind::Utf8 { .. } => Problem::at(&place, error.to_string()),
        ErrorKind::Io(error) => Problem::of_read(&place, error),
        _ => Problem::of_kind(ProblemKind::File, &place, error.to_string()),
    }
}
