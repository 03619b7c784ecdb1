//! Messages of one JSON channel of an MCAP file.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Read;

use fuseline_traces::{Event, Header, Line, observed};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::convert::recorded::{ConvertError, Recorded};
use crate::fault::Fault;

/// The longest record of a channel of lines, in bytes.
const RECORD: usize = 256 << 20;

/// An MCAP file that is being read.
pub(crate) struct Messages<'a, R> {
    file: &'a str,
    inner: R,
    reader: LinearReader,
    topic: &'a str,
    channels: BTreeSet<u16>,
    /// How many messages of the topic were read.
    number: u64,
    /// The first event, if it came where a header was expected.
    first: Option<Event>,
}

impl<'a, R: Read> Messages<'a, R> {
    pub(crate) fn new(file: &'a str, inner: R, topic: &'a str) -> Self {
        let options = LinearReaderOptions::default()
            .with_record_length_limit(RECORD)
            .with_validate_chunk_crcs(true);
        let reader = LinearReader::new_with_options(options);
        Self { file, inner, reader, topic, channels: BTreeSet::new(), number: 0, first: None }
    }

    fn fault(&self, message: String) -> ConvertError {
        ConvertError::File { file: self.file.to_owned(), message }
    }

    /// The next message of the topic, as a line.
    fn line(&mut self) -> Result<Option<Line>, Fault> {
        loop {
            let event = match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(self.fault(error.to_string()).into()),
                Some(Ok(event)) => event,
            };
            let (data, opcode) = match event {
                LinearReadEvent::ReadRequest(wanted) => {
                    let read = self.inner.read(self.reader.insert(wanted));
                    let read = read.map_err(|error| self.fault(error.to_string()))?;
                    self.reader.notify_read(read);
                    continue;
                }
                LinearReadEvent::Record { data, opcode } => (data, opcode),
            };
            match mcap::parse_record(opcode, data) {
                Ok(Record::Channel(channel)) if channel.topic == self.topic => {
                    if channel.message_encoding != "json" {
                        let encoding = channel.message_encoding;
                        let message = format!(
                            "topic {} is encoded as {encoding:?}; a trace's is json",
                            self.topic
                        );
                        return Err(self.fault(message).into());
                    }
                    self.channels.insert(channel.id);
                }
                Ok(Record::Message { header, data })
                    if self.channels.contains(&header.channel_id) =>
                {
                    self.number += 1;
                    return match observed::parse(&dated(&data, header.log_time)) {
                        Ok(line) => Ok(Some(line)),
                        Err(error) => Err(ConvertError::Message {
                            file: self.file.to_owned(),
                            number: self.number,
                            message: error.to_string(),
                        }
                        .into()),
                    };
                }
                Ok(_) => {}
                Err(error) => {
                    let message = error.to_string();
                    return Err(ConvertError::File { file: self.file.to_owned(), message }.into());
                }
            }
        }
    }
}

impl<R: Read> Recorded for Messages<'_, R> {
    fn header(&mut self) -> Result<Option<Header>, Fault> {
        match self.line()? {
            Some(Line::Header(header)) => Ok(Some(header)),
            Some(Line::Event(event)) => {
                self.first = Some(event);
                Ok(None)
            }
            None => {
                let message =
                    format!("no message of topic {}; name another with --topic", self.topic);
                Err(self.fault(message).into())
            }
        }
    }

    fn next_event(&mut self) -> Result<Option<Event>, Fault> {
        if let Some(event) = self.first.take() {
            return Ok(Some(event));
        }
        match self.line()? {
            None => Ok(None),
            Some(Line::Event(event)) => Ok(Some(event)),
            Some(Line::Header(_)) => Err(ConvertError::Message {
                file: self.file.to_owned(),
                number: self.number,
                message: "a second header; put each trace in its own file".to_owned(),
            }
            .into()),
        }
    }
}

/// A message with its log time as `at`, if it has none.
fn dated(data: &[u8], log_time: u64) -> Cow<'_, [u8]> {
    #[derive(Deserialize)]
    struct Dated {
        at: Option<IgnoredAny>,
        fuseline: Option<IgnoredAny>,
        ev: Option<IgnoredAny>,
    }
    let told = serde_json::from_slice::<Dated>(data);
    let is_undated =
        told.is_ok_and(|told| told.at.is_none() && told.fuseline.is_none() && told.ev.is_some());
    let Some(rest) = data.trim_ascii_start().strip_prefix(b"{").filter(|_| is_undated) else {
        return Cow::Borrowed(data);
    };
    Cow::Owned([format!("{{\"at\":{log_time},").as_bytes(), rest].concat())
}
