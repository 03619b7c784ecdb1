//! [`Messages`]: reads the messages of one JSON channel of an MCAP file as lines of a trace.

mod raw;
mod records;

use std::borrow::Cow;
use std::io::{self, Read};

use mcap::McapError;
use serde::Deserialize;
use serde::de::IgnoredAny;
use thiserror::Error;

use self::raw::LentMessage;
pub use self::raw::{PayloadFormat, PayloadSchema, RECORD, RawMessage, RawMessages};
use self::records::RecordBlocks;
use crate::canonical::StampBefore;
use crate::packed::{PIECE, TOPIC};
use crate::parse::{Form, LineAnnotations, parse_as, parse_canonical};
use crate::{Annotations, HeaderAnnotations, Line, ParseError};

/// The reason why an MCAP file yields no more lines.
#[derive(Debug, Error)]
pub enum MessageError {
    /// The file cannot be read, or it is not an MCAP file.
    #[error("{}", plain(.0))]
    File(#[from] McapError),
    /// The bytes could not be read.
    #[error("{0}")]
    Io(#[source] io::Error),
    /// The topic's messages have another encoding.
    #[error("topic {topic} is encoded as {encoding:?}, but the lines of a trace are json")]
    Encoding {
        /// The topic.
        topic: String,
        /// Its encoding.
        encoding: String,
    },
    /// A message is not a line of a trace.
    #[error("message {number}: {source}")]
    Message {
        /// The number of the message in its topic, counted from 1.
        number: u64,
        /// The fault of the message.
        source: ParseError,
    },
    /// The file has no message of the topic.
    #[error("there is no message on topic {0}")]
    None(String),
}

impl MessageError {
    /// Returns `true` if the file ends in the middle.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        match self {
            Self::File(McapError::UnexpectedEof | McapError::UnexpectedEoc) => true,
            Self::File(McapError::Io(error)) | Self::Io(error) => {
                error.kind() == io::ErrorKind::UnexpectedEof
            }
            _ => false,
        }
    }
}

/// Reads the messages of one topic of an MCAP file as lines of a trace.
///
/// After an error it yields nothing more.
pub struct Messages<'a> {
    raw: RawMessages<'a>,
    topic: &'a str,
    number: u64,
    annotations: LineAnnotations,
    before: StampBefore,
}

impl<'a> Messages<'a> {
    /// Creates a reader for the messages of `topic`. It reads nothing yet.
    pub fn new(inner: impl Read + 'a, topic: &'a str) -> Self {
        Self::of(RawMessages::new(inner, vec![topic]), topic)
    }

    fn of(raw: RawMessages<'a>, topic: &'a str) -> Self {
        let (annotations, before) = (LineAnnotations::default(), StampBefore::default());
        Self { raw, topic, number: 0, annotations, before }
    }

    /// Returns the further keys of the message read last, if it is an event.
    #[must_use]
    pub const fn annotations(&self) -> &Annotations {
        &self.annotations.event
    }

    /// Returns the further keys of the header read last.
    #[must_use]
    pub const fn header_annotations(&self) -> &HeaderAnnotations {
        &self.annotations.header
    }

    /// Returns the number of messages of the topic that were read.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Returns the error for a file without a message of the topic.
    #[must_use]
    pub fn none(&self) -> MessageError {
        MessageError::None(self.topic.to_owned())
    }

    /// Returns the next message, or `None` at the end. A message without `at` gets its log time.
    ///
    /// # Errors
    /// Returns a [`MessageError`] if the file cannot be read, the topic is not JSON, or a message
    /// is not a line of a trace.
    pub fn line(&mut self) -> Result<Option<Line>, MessageError> {
        let Some(message) = self.raw.lend()? else { return Ok(None) };
        check_encoding(self.topic, &message)?;
        self.number += 1;
        // Nearly all messages are canonical lines.
        if let Some(read) = parse_canonical(message.data, Form::Observed, &mut self.before) {
            return Ok(Some(Line::Event(self.annotations.take(&read))));
        }
        parse_dated(&message, self.number, &mut self.annotations).map(Some)
    }

    /// Appends the next message as a line with its end. Returns `false` at the end of the file.
    fn append_line(&mut self, text: &mut Vec<u8>) -> Result<bool, MessageError> {
        let Some(message) = self.raw.lend()? else { return Ok(false) };
        check_encoding(self.topic, &message)?;
        self.number += 1;
        if parse_canonical(message.data, Form::Observed, &mut self.before).is_some() {
            text.extend_from_slice(message.data);
        } else {
            match parse_dated(&message, self.number, &mut self.annotations)? {
                Line::Header(header) => header.write_annotated(&self.annotations.header, text),
                Line::Event(event) => event.write_annotated(&self.annotations.event, text),
            }
        }
        text.push(b'\n');
        Ok(true)
    }
}

fn check_encoding(topic: &str, message: &LentMessage<'_>) -> Result<(), MessageError> {
    if message.format.encoding == "json" {
        return Ok(());
    }
    let (topic, encoding) = (topic.to_owned(), message.format.encoding.clone());
    Err(MessageError::Encoding { topic, encoding })
}

fn parse_dated(
    message: &LentMessage<'_>,
    number: u64,
    annotations: &mut LineAnnotations,
) -> Result<Line, MessageError> {
    let line = dated(message.data, message.log_time);
    let line = parse_as(&line, Form::Observed, annotations);
    line.map_err(|source| MessageError::Message { number, source })
}

/// Reads the messages as the bytes of a trace.
pub(super) struct MessageLines<'a> {
    messages: Messages<'a>,
    /// The error to report once all lines before it were handed over.
    error: Option<MessageError>,
}

impl<'a> MessageLines<'a> {
    pub(super) fn new(inner: impl Read + 'a) -> Self {
        Self { messages: Messages::new(inner, TOPIC), error: None }
    }

    /// Reads the messages from blocks of whole records.
    pub(super) fn of_blocks(records: impl FnMut(&mut Vec<u8>) -> io::Result<bool> + 'a) -> Self {
        let raw = RawMessages::of_blocks(records, vec![TOPIC]);
        Self { messages: Messages::of(raw, TOPIC), error: None }
    }

    /// Puts whole lines into a piece. Returns `false` at the end.
    pub(super) fn fill(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        piece.clear();
        while self.error.is_none() && piece.len() < PIECE {
            match self.messages.append_line(piece) {
                Ok(true) => {}
                Ok(false) if self.messages.number() == 0 => self.error = Some(self.messages.none()),
                Ok(false) => break,
                Err(error) => self.error = Some(error),
            }
        }
        match self.error.take_if(|_| piece.is_empty()) {
            Some(error) => Err(message_error(error)),
            None => Ok(!piece.is_empty()),
        }
    }
}

/// Returns the records of an MCAP file in blocks.
pub(super) fn blocks(inner: impl Read) -> impl FnMut(&mut Vec<u8>) -> io::Result<bool> {
    let mut records = RecordBlocks::new(inner);
    move |block| records.fill(block).map_err(io_error)
}

fn message_error(error: MessageError) -> io::Error {
    match error {
        MessageError::Io(error) | MessageError::File(McapError::Io(error)) => error,
        MessageError::File(McapError::UnexpectedEof) => {
            io::Error::new(io::ErrorKind::UnexpectedEof, error)
        }
        error => io::Error::new(io::ErrorKind::InvalidData, error),
    }
}

/// Wraps the library's error so that it can be found again in [`MessageError`].
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        error => io::Error::other(error),
    }
}

impl From<io::Error> for MessageError {
    fn from(error: io::Error) -> Self {
        error.downcast().map_or_else(Self::Io, Self::File)
    }
}

/// Returns the library's message, which may quote the file, as one line that no terminal takes for
/// a command.
fn plain(error: &McapError) -> String {
    error.to_string().replace(char::is_control, "\u{fffd}")
}

/// Returns a message with its log time as `at`, if it has no `at`.
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
