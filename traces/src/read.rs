//! [`Events`]: reads a trace line by line, in bounded memory. The first error ends it, with file, line and column.

use std::io::{self, BufRead};

use flate2::bufread::MultiGzDecoder;

use crate::annotations::{Annotations, HeaderAnnotations};
use crate::canonical::{self, StampBefore};
use crate::event::{Commit, Event, Header, Line};
use crate::parse::{Form, LineAnnotations, ParseError, parse_as, parse_canonical};

/// The longest line in bytes, without its `\n`.
pub const LINE: usize = 64 * 1024;

/// The first fault of a trace, shown as `file:line:column: message`.
#[derive(Debug, thiserror::Error)]
#[error("{file}:{line}:{column}: {defect}")]
pub struct ReadError {
    /// The name that the trace was given.
    pub file: String,
    /// The line, counted from 1.
    pub line: u64,
    /// The byte of the line, counted from 1.
    pub column: u64,
    /// The fault.
    pub defect: Defect,
}

/// A fault of a trace.
#[derive(Debug, thiserror::Error)]
pub enum Defect {
    /// The bytes could not be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// There is no line at all.
    #[error("the trace is empty; its first line must be a header")]
    Empty,
    /// The first line is an event.
    #[error("the first line is an event, but a trace begins with a header: {{\"fuseline\":1,…}}")]
    NoHeader,
    /// A header comes after the first line.
    #[error("the file has a second header; put each trace in its own file")]
    SecondHeader,
    /// The last line has no `\n`.
    #[error("the last line does not end in LF; it may be cut short")]
    Unterminated,
    /// A line has more than 64 KiB.
    #[error("the line is longer than 64 KiB, the most that a trace allows")]
    TooLong,
    /// A line is not one of a trace.
    #[error("{}", .0.message)]
    Line(ParseError),
}

/// Reads a trace: its header when the reader is created, then one event after the other.
///
/// It stores one line at a time. After an error it yields nothing more.
///
/// ```
/// let trace = b"{\"fuseline\":1,\"window\":16,\"clouds\":[]}\n{\"ev\":\"tick\",\"at\":7}\n";
/// let mut events = fuseline_traces::Events::new("drive.jsonl", &trace[..])?;
/// assert_eq!(events.header().window, 16);
/// while let Some(event) = events.next_event()? {
///     println!("line {}: {event}", events.line());
/// }
/// # Ok::<(), fuseline_traces::ReadError>(())
/// ```
#[derive(Debug)]
pub struct Events<R> {
    inner: R,
    file: String,
    form: Form,
    header: Header,
    annotations: LineAnnotations,
    before: StampBefore,
    raw: Vec<u8>,
    line: u64,
}

impl<R: BufRead> Events<R> {
    /// Reads the header. `file` names the trace in errors.
    ///
    /// # Errors
    /// Returns a [`ReadError`] if there is no first line or it is not a header.
    pub fn new(file: impl Into<String>, inner: R) -> Result<Self, ReadError> {
        Self::of_form(Form::Strict, file.into(), inner)
    }

    /// Reads the header of a trace that is to be judged as observed. `file` names the trace in
    /// errors.
    ///
    /// A request of an observed trace may have `deadline` instead of `due`; its event then has the
    /// due instant. Attempts may have numbers, and there may be no local.
    ///
    /// # Errors
    /// Returns a [`ReadError`] if there is no first line or it is not a header.
    pub fn observed(file: impl Into<String>, inner: R) -> Result<Self, ReadError> {
        Self::of_form(Form::Observed, file.into(), inner)
    }

    fn of_form(form: Form, file: String, inner: R) -> Result<Self, ReadError> {
        let header =
            Header { operator: None, window: 0, commit: Commit::default(), clouds: vec![] };
        let annotations = LineAnnotations::default();
        let (before, raw) = (StampBefore::default(), Vec::new());
        let mut reader = Self { inner, file, form, header, annotations, before, raw, line: 0 };
        let whole = reader.fill();
        match reader.filled_line(whole)? {
            Some(Line::Header(header)) => {
                reader.header = header;
                if reader.annotations.header.without_local {
                    reader.form = Form::WithoutLocal;
                }
            }
            Some(Line::Event(_)) => return Err(reader.error(1, Defect::NoHeader)),
            None => {
                reader.line = 1;
                return Err(reader.error(1, Defect::Empty));
            }
        }
        Ok(reader)
    }

    /// Returns the next event, or `None` at the end.
    ///
    /// # Errors
    /// Returns a [`ReadError`] if the line cannot be read, or if a trace may not have it at this
    /// place.
    pub fn next_event(&mut self) -> Result<Option<Event>, ReadError> {
        let whole = match self.inner.fill_buf() {
            Ok(bytes) => {
                // Nearly all lines are canonical and completely in the buffer.
                if let Some(read) = canonical::event(bytes, self.form, &mut self.before)
                    && let Some((line, [b'\n', ..])) = bytes.split_at_checked(read.len)
                {
                    self.raw.clear();
                    self.raw.extend_from_slice(line);
                    self.inner.consume(read.len + 1);
                    self.line += 1;
                    return Ok(Some(self.annotations.take(&read)));
                }
                self.fill()
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => self.fill(),
            Err(error) => {
                self.raw.clear();
                Err(error)
            }
        };
        if let Ok(true) = whole
            && self.raw.len() <= LINE
            && let Some(read) = parse_canonical(&self.raw, self.form, &mut self.before)
        {
            self.line += 1;
            return Ok(Some(self.annotations.take(&read)));
        }
        match self.filled_line(whole)? {
            Some(Line::Event(event)) => Ok(Some(event)),
            Some(Line::Header(_)) => Err(self.error(1, Defect::SecondHeader)),
            None => Ok(None),
        }
    }

    /// Returns the header.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// Returns the further keys of the header.
    #[must_use]
    pub const fn header_annotations(&self) -> &HeaderAnnotations {
        &self.annotations.header
    }

    /// Returns the further keys of the event read last.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// Returns the bytes of the line read last, without its `\n`.
    #[must_use]
    pub fn raw(&self) -> &[u8] {
        &self.raw
    }

    /// Returns the number of the line read last. The header's number is 1.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.line
    }

    /// Returns the inner reader, for example to see whether it has buffered more.
    #[must_use]
    pub const fn inner(&self) -> &R {
        &self.inner
    }

    /// Returns the line in the buffer. `whole` is the result of filling the buffer.
    fn filled_line(&mut self, whole: io::Result<bool>) -> Result<Option<Line>, ReadError> {
        if let Ok(false) = whole
            && self.raw.is_empty()
        {
            return Ok(None);
        }
        self.line += 1;
        let column = self.raw.len() as u64 + 1;
        match whole {
            Ok(_) if self.raw.len() > LINE => Err(self.error(LINE as u64 + 1, Defect::TooLong)),
            Ok(true) => match parse_as(&self.raw, self.form, &mut self.annotations) {
                Ok(line) => Ok(Some(line)),
                Err(error) => Err(self.error(error.column, Defect::Line(error))),
            },
            Ok(false) => Err(self.error(column, Defect::Unterminated)),
            Err(error) => Err(self.error(column, Defect::Io(error))),
        }
    }

    /// Reads the next line into the buffer, at most one byte more than a line may have. Returns
    /// `false` if the line is too long or the input ends first.
    fn fill(&mut self) -> io::Result<bool> {
        self.raw.clear();
        while self.raw.len() <= LINE {
            let bytes = match self.inner.fill_buf() {
                Ok(bytes) => bytes,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            let room = bytes.len().min(LINE + 1 - self.raw.len());
            let bytes = bytes.get(..room).unwrap_or(bytes);
            let end = memchr::memchr(b'\n', bytes);
            let len = end.unwrap_or(bytes.len());
            self.raw.extend_from_slice(bytes.get(..len).unwrap_or(bytes));
            self.inner.consume(len + usize::from(end.is_some()));
            if end.is_some() || len == 0 {
                return Ok(end.is_some());
            }
        }
        Ok(false)
    }

    fn error(&self, column: u64, defect: Defect) -> ReadError {
        ReadError { file: self.file.clone(), line: self.line, column, defect }
    }
}

/// Reads a trace that is plain or gzipped.
///
/// # Errors
/// Returns an error if the first bytes cannot be read.
pub fn unpack<'a, R: BufRead + 'a>(mut inner: R) -> io::Result<Box<dyn BufRead + 'a>> {
    // Gzip always begins with this byte, and no trace does.
    if inner.fill_buf()?.first() == Some(&0x1f) {
        return Ok(Box::new(io::BufReader::new(MultiGzDecoder::new(inner))));
    }
    Ok(Box::new(inner))
}
