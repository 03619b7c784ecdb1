//! Rows of CSV.

use std::io::Read;
use std::sync::Arc;

use csv::{ErrorKind, ReaderBuilder, Trim};
use fuseline_traces::rows::{TableError, TableReader};

use crate::convert::row::{Place, Problem, ProblemKind, Row, Source, Spot};

/// A CSV file that is being read; its first row names the columns.
pub(super) struct TableSource<R> {
    file: Arc<str>,
    inner: TableReader<R>,
    names: Vec<Arc<str>>,
}

impl<R: Read> TableSource<R> {
    /// Reads the first row.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(super) fn new(file: &Arc<str>, inner: R, separator: u8) -> Result<Self, Problem> {
        let mut options = ReaderBuilder::new();
        options.trim(Trim::All).delimiter(separator);
        let mut inner = TableReader::new(inner, &options);
        let names = inner.names().map_err(|error| problem(file, &error))?;
        let names: Vec<Arc<str>> = names.iter().map(Arc::from).collect();
        Ok(Self { file: Arc::clone(file), inner, names })
    }

    /// A name that two columns have.
    pub(super) fn doubled(&self) -> Option<&str> {
        let mut names = self.names.iter().enumerate();
        let found =
            names.find(|(place, name)| !name.is_empty() && self.names[..*place].contains(name));
        found.map(|(_, name)| &**name)
    }
}

impl<R: Read> Source for TableSource<R> {
    fn next_row(&mut self) -> Result<Option<Row>, Problem> {
        let read = self.inner.next_row().map_err(|error| problem(&self.file, &error))?;
        let Some((line, record)) = read else { return Ok(None) };
        let place = Place { file: Arc::clone(&self.file), spot: Spot::Line(line) };
        if record.iter().eq(self.names.iter().map(|name| &**name)) {
            let message = "the names of the columns stand here again, as after a restart; split the file here, or \
                           leave such rows out with --skip-bad";
            return Err(Problem { place, message: message.to_owned(), kind: ProblemKind::Row });
        }
        let cells = self.names.iter().cloned().zip(record.iter().map(str::to_owned)).collect();
        Ok(Some(Row { place, cells, log_time: None, topic: None }))
    }
}

fn problem(file: &Arc<str>, error: &TableError) -> Problem {
    let kind = match error.source.kind() {
        ErrorKind::UnequalLengths { .. } | ErrorKind::Utf8 { .. } => ProblemKind::Row,
        ErrorKind::Io(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            ProblemKind::Cut
        }
        _ => ProblemKind::File,
    };
    let place = Place { file: Arc::clone(file), spot: Spot::Line(error.line) };
    let remedy = match error.source.kind() {
        ErrorKind::UnequalLengths { .. } => {
            "; --separator says what stands between cells, --skip-bad leaves such rows out"
        }
        _ => "",
    };
    Problem { place, message: format!("{error}{remedy}"), kind }
}
