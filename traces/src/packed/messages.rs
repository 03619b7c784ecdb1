//! [`Messages`]: the messages of one JSON channel of an MCAP file, as lines of a trace.

mod chunks;
mod raw;

use std::borrow::Cow;
use std::io::{self, BufRead, Read};

use mcap::McapError;
use serde::Deserialize;
use serde::de::IgnoredAny;
use thiserror::Error;

pub use self::raw::{PayloadFormat, PayloadSchema, RECORD, RawMessage, RawMessages};
use crate::packed::TOPIC;
use crate::parse::{Form, LineAnnotations, parse_as, parse_canonical};
use crate::{Annotations, HeaderAnnotations, Line, ParseError};

/// Why an MCAP file gives no more lines.
#[derive(Debug, Error)]
pub enum MessageError {
    /// The file cannot be read, or is none.
    #[error("{}", plain(.0))]
    File(#[from] McapError),
    /// The bytes could not be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The topic's messages are of another encoding.
    #[error("topic {topic} is encoded as {encoding:?}; a trace's is json")]
    Encoding {
        /// The topic.
        topic: String,
        /// Its encoding.
        encoding: String,
    },
    /// A message is no line of a trace.
    #[error("message {number}: {source}")]
    Message {
        /// Which message of the topic, counted from 1.
        number: u64,
        /// What is wrong with it.
        source: ParseError,
    },
    /// There is none.
    #[error("no message of topic {0}")]
    None(String),
}

/// The messages of one topic of an MCAP file, as lines of a trace.
///
/// After an error it yields nothing more.
pub struct Messages<'a, R> {
    raw: RawMessages<'a, R>,
    topic: &'a str,
    number: u64,
    annotations: LineAnnotations,
}

impl<'a, R: Read> Messages<'a, R> {
    /// Reads the messages of `topic`; nothing is read yet.
    pub fn new(inner: R, topic: &'a str) -> Self {
        let raw = RawMessages::new(inner, vec![topic]);
        Self { raw, topic, number: 0, annotations: LineAnnotations::default() }
    }

    /// What the message read last has beside what the machine's rules read, if it is an event.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// What the header read last has beside the machine's configuration.
    #[must_use]
    pub const fn header_annotations(&self) -> &HeaderAnnotations {
        &self.annotations.header
    }

    /// How many messages of the topic were read.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// What to say of a file without a message of the topic.
    #[must_use]
    pub fn none(&self) -> MessageError {
        MessageError::None(self.topic.to_owned())
    }

    /// The next message; none at the end. One without `at` has its log time.
    ///
    /// # Errors
    /// If the file cannot be read, the topic is not JSON, or a message is no line of a trace.
    pub fn line(&mut self) -> Result<Option<Line>, MessageError> {
        let Some(message) = self.raw.message()? else { return Ok(None) };
        if message.format.encoding != "json" {
            let (topic, encoding) = (self.topic.to_owned(), message.format.encoding.clone());
            return Err(MessageError::Encoding { topic, encoding });
        }
        self.number += 1;
        // Nearly all are as they are written.
        if let Some(event) = parse_canonical(&message.data, Form::Observed, &mut self.annotations) {
            return Ok(Some(Line::Event(event)));
        }
        let line = dated(&message.data, message.log_time);
        let line = parse_as(&line, Form::Observed, &mut self.annotations);
        let number = self.number;
        line.map(Some).map_err(|source| MessageError::Message { number, source })
    }
}

/// The messages as the bytes of a trace.
pub(crate) struct Lines<R> {
    messages: Messages<'static, R>,
    line: Vec<u8>,
    taken: usize,
}

impl<R: Read> Lines<R> {
    pub(crate) fn new(inner: R) -> Self {
        Self { messages: Messages::new(inner, TOPIC), line: Vec::new(), taken: 0 }
    }

    fn next_line(&mut self) -> Result<(), MessageError> {
        match self.messages.line()? {
            Some(Line::Header(header)) => {
                header.write_annotated(self.messages.header_annotations(), &mut self.line);
            }
            Some(Line::Event(event)) => {
                event.write_annotated(self.messages.annotations(), &mut self.line);
            }
            None if self.messages.number() == 0 => {
                return Err(self.messages.none());
            }
            None => return Ok(()),
        }
        self.line.push(b'\n');
        Ok(())
    }
}

impl<R: Read> BufRead for Lines<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.taken == self.line.len() {
            self.line.clear();
            self.taken = 0;
            self.next_line().map_err(io_error)?;
        }
        Ok(self.line.get(self.taken..).unwrap_or_default())
    }

    fn consume(&mut self, amount: usize) {
        self.taken = self.line.len().min(self.taken + amount);
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}

fn io_error(error: MessageError) -> io::Error {
    match error {
        MessageError::Io(error) | MessageError::File(McapError::Io(error)) => error,
        MessageError::File(McapError::UnexpectedEof) => {
            io::Error::new(io::ErrorKind::UnexpectedEof, error)
        }
        error => io::Error::new(io::ErrorKind::InvalidData, error),
    }
}

/// The library's words, which may quote the file, as one line that no terminal takes for a command.
fn plain(error: &McapError) -> String {
    error.to_string().replace(char::is_control, "\u{fffd}")
}

/// A message with its log time as `at`, if it has none.
fn dated(data: &[u8], log_time: u64) -> Cow<'_, [u8]> {
    #[derive(Deserialize)]
    struct TimedMessage {
        at: Option<IgnoredAny>,
        fuseline: Option<IgnoredAny>,
        ev: Option<IgnoredAny>,
    }
    let reported = serde_json::from_slice::<TimedMessage>(data);
    let is_undated = reported.is_ok_and(|reported| {
        reported.at.is_none() && reported.fuseline.is_none() && reported.ev.is_some()
    });
    let Some(rest) = data.trim_ascii_start().strip_prefix(b"{").filter(|_| is_undated) else {
        return Cow::Borrowed(data);
    };
    Cow::Owned([format!("{{\"at\":{log_time},").as_bytes(), rest].concat())
}
