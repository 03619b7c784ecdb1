//! The lines of a trace from one JSON channel of an MCAP file.

use std::io::Read;

use fuseline_traces::packed::{MessageError, Messages};
use fuseline_traces::{Annotations, Event, Line};

use crate::convert::recorded::{AnnotatedHeader, ConvertError};
use crate::fault::Fault;

/// An event with its further keys.
type AnnotatedEvent = (Event, Annotations);

/// An MCAP file that is being read.
pub(super) struct McapInput<'a> {
    file: &'a str,
    messages: Messages<'a>,
    /// The first event, if it came where a header was expected.
    first: Option<AnnotatedEvent>,
}

impl<'a> McapInput<'a> {
    pub(super) fn new(file: &'a str, inner: impl Read + 'a, topic: &'a str) -> Self {
        Self { file, messages: Messages::new(inner, topic), first: None }
    }

    /// The next message of the topic.
    fn line(&mut self) -> Result<Option<Line>, Fault> {
        self.messages.line().map_err(|error| self.fault(&error).into())
    }

    fn fault(&self, error: &MessageError) -> ConvertError {
        let remedy = match error {
            MessageError::None(_) => "; name another with --topic",
            MessageError::Encoding { .. } => "; name the fields of others with --column",
            _ => "",
        };
        ConvertError::file(self.file, &format!("{error}{remedy}"))
    }

    /// The recording's own header, if it has one.
    pub(super) fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault> {
        match self.line()? {
            Some(Line::Header(header)) => {
                Ok(Some((header, self.messages.header_annotations().clone())))
            }
            Some(Line::Event(event)) => {
                self.first = Some((event, self.messages.annotations().clone()));
                Ok(None)
            }
            None => Err(self.fault(&self.messages.none()).into()),
        }
    }

    /// The next event; none at the end.
    pub(super) fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault> {
        if let Some(event) = self.first.take() {
            return Ok(Some(event));
        }
        match self.line()? {
            None => Ok(None),
            Some(Line::Event(event)) => Ok(Some((event, self.messages.annotations().clone()))),
            Some(Line::Header(_)) => {
                let number = self.messages.number();
                let message =
                    format!("message {number}: a second header; put each trace in its own file");
                Err(ConvertError::file(self.file, &message).into())
            }
        }
    }
}
