//! Reads CSV with the line number of each row, for any kind of line end.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Read};

use csv::{ErrorKind, Reader, ReaderBuilder, StringRecord};

/// Reads CSV whose first row names the columns.
///
/// Lines end with LF, CRLF or CR, and empty lines are skipped. Each row comes with its own line.
/// The `csv` crate reports the line at which its reader stopped, which is an earlier one in both
/// cases.
#[derive(Debug)]
pub struct TableReader<R> {
    inner: Reader<LineIndex<R>>,
    row: StringRecord,
}

/// The reason why CSV cannot be read, with its place.
#[derive(Debug)]
pub struct TableError {
    /// The row's line, counted from 1.
    pub line: u64,
    /// The error of the `csv` crate, which counts lines in another way.
    pub source: csv::Error,
}

impl<R: Read> TableReader<R> {
    /// Creates a reader with these options.
    pub fn new(inner: R, options: &ReaderBuilder) -> Self {
        let inner = options.from_reader(LineIndex::new(inner));
        Self { inner, row: StringRecord::new() }
    }

    /// Returns the names of the columns.
    ///
    /// # Errors
    /// Returns a [`TableError`] if the first row cannot be read.
    pub fn names(&mut self) -> Result<StringRecord, TableError> {
        let names = self.inner.headers().cloned();
        names.map_err(|source| TableError { line: self.line_of(0), source })
    }

    /// Returns the next row and its line, or `None` at the end.
    ///
    /// # Errors
    /// Returns a [`TableError`] if the row cannot be read or does not have as many cells as there
    /// are names.
    pub fn next_row(&mut self) -> Result<Option<(u64, &StringRecord)>, TableError> {
        let from = self.inner.position().byte();
        let read = self.inner.read_record(&mut self.row);
        let from = self.row.position().map_or(from, csv::Position::byte);
        let line = self.line_of(from);
        match read {
            Ok(true) => Ok(Some((line, &self.row))),
            Ok(false) => Ok(None),
            Err(source) => {
                let byte = source.position().map(csv::Position::byte);
                Err(TableError { line: byte.map_or(line, |byte| self.line_of(byte)), source })
            }
        }
    }

    /// Returns the line of the row that begins at this byte, or after the line ends that are there.
    fn line_of(&mut self, byte: u64) -> u64 {
        self.inner.get_mut().line_of(byte)
    }
}

impl fmt::Display for TableError {
    /// Writes the error without its place.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.source.kind() {
            ErrorKind::UnequalLengths { expected_len, len, .. } => {
                write!(f, "{len} cells, where the first row has {expected_len}")
            }
            ErrorKind::Utf8 { err, .. } => {
                write!(f, "cell {} is not UTF-8", err.field() + 1)
            }
            ErrorKind::Io(error) => error.fmt(f),
            _ => self.source.fmt(f),
        }
    }
}

impl std::error::Error for TableError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.source)
    }
}

/// Bytes that pass through, and the starts of the non-empty lines among them.
#[derive(Debug)]
struct LineIndex<R> {
    inner: R,
    /// The lines whose row was not read yet: the place at which each begins, and its number.
    starts: VecDeque<(u64, u64)>,
    byte: u64,
    line: u64,
    is_at_start: bool,
    /// `true` if the last byte was CR, so that an LF after it belongs to the same line end.
    is_after_cr: bool,
}

impl<R> LineIndex<R> {
    const fn new(inner: R) -> Self {
        let starts = VecDeque::new();
        Self { inner, starts, byte: 0, line: 1, is_at_start: true, is_after_cr: false }
    }

    fn take(&mut self, byte: u8) {
        match byte {
            b'\n' if self.is_after_cr => {}
            b'\n' | b'\r' => {
                self.line += 1;
                self.is_at_start = true;
            }
            _ if self.is_at_start => {
                self.starts.push_back((self.byte, self.line));
                self.is_at_start = false;
            }
            _ => {}
        }
        self.is_after_cr = byte == b'\r';
        self.byte += 1;
    }

    /// Returns the line that begins at this byte or next. Rows must be asked about in their order.
    fn line_of(&mut self, byte: u64) -> u64 {
        while self.starts.front().is_some_and(|(start, _)| *start < byte) {
            self.starts.pop_front();
        }
        self.starts.front().map_or(self.line, |(_, line)| *line)
    }
}

impl<R: Read> Read for LineIndex<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.inner.read(buffer)?;
        for byte in &buffer[..len] {
            self.take(*byte);
        }
        Ok(len)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the lines of the rows of a text that is read in pieces of this length.
    fn lines(text: &str, piece: usize) -> Vec<u64> {
        let mut options = ReaderBuilder::new();
        options.buffer_capacity(piece);
        let mut table = TableReader::new(text.as_bytes(), &options);
        assert_eq!(&table.names().unwrap(), &["a", "b"][..]);
        let mut lines = Vec::new();
        while let Some((line, _)) = table.next_row().unwrap() {
            lines.push(line);
        }
        lines
    }

    #[test]
    fn a_row_has_its_line_whatever_ends_lines() {
        for end in ["\n", "\r\n", "\r"] {
            for piece in [1, 2, 7, 8192] {
                let text = "a,b|1,2|3,4||5,6|\"7|8\",9|10,11".replace('|', end);
                assert_eq!(lines(&text, piece), [2, 3, 5, 6, 8], "{end:?} {piece}");
            }
            let marked = "\u{feff}a,b|1,2|3,4|".replace('|', end);
            assert_eq!(lines(&marked, 8192), [2, 3], "{end:?}");
        }
    }

    #[test]
    fn an_error_has_the_line_of_its_row() {
        for end in ["\n", "\r\n", "\r"] {
            let text = "a,b|1,2||3".replace('|', end);
            let mut table = TableReader::new(text.as_bytes(), &ReaderBuilder::new());
            table.names().unwrap();
            table.next_row().unwrap();
            let error = table.next_row().unwrap_err();
            let reported = (error.line, error.to_string());
            assert_eq!(reported, (4, "1 cells, where the first row has 2".to_owned()));
        }
    }
}
