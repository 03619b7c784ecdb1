//! Messages of topics of a recording, mapped by the user's names: MCAP, or rosbag2's database.

use std::rc::Rc;

use fuseline_traces::packed::{PayloadFormat, RawMessage, RawMessages};
use fuseline_traces::rows::Columns;

use crate::complain::complain;
#[cfg(feature = "bags")]
use crate::convert::db3::Db3Messages;
use crate::convert::payload::PayloadDecoder;
use crate::convert::recorded::{AnnotatedEvent, AnnotatedHeader, ConvertError, Recorded};
use crate::convert::topic::TopicChoice;
use crate::fault::Fault;

/// A recording that is being read; it has no header of its own.
pub(crate) struct TopicInput<'a> {
    file: &'a str,
    messages: MessageFile<'a>,
    topics: Vec<MappedTopic<'a>>,
    /// How messages of the channels so far are decoded.
    payloads: Vec<(Rc<PayloadFormat>, PayloadDecoder)>,
}

/// A recording by its format.
pub(crate) enum MessageFile<'a> {
    Mcap(Box<RawMessages<'a>>),
    #[cfg(feature = "bags")]
    Db3(Db3Messages),
}

/// A topic, how its messages are read, and how many were.
struct MappedTopic<'a> {
    name: &'a str,
    columns: Columns<'a>,
    number: u64,
}

impl<'a> TopicInput<'a> {
    pub(crate) fn new(
        file: &'a str,
        messages: MessageFile<'a>,
        topics: &'a [TopicChoice],
        columns: &Columns<'a>,
    ) -> Self {
        let mapped = |topic: &'a TopicChoice| MappedTopic {
            name: &topic.name,
            columns: topic.columns(columns),
            number: 0,
        };
        let topics = topics.iter().map(mapped).collect();
        Self { file, messages, topics, payloads: Vec::new() }
    }

    fn raw(&mut self) -> Result<Option<RawMessage>, String> {
        match &mut self.messages {
            MessageFile::Mcap(messages) => messages.message().map_err(|error| error.to_string()),
            #[cfg(feature = "bags")]
            MessageFile::Db3(messages) => messages.message().map_err(|error| error.to_string()),
        }
    }

    /// The message's event; none if it is to be left out.
    fn event(&mut self, message: &RawMessage) -> Result<Option<AnnotatedEvent>, String> {
        let known = |(format, _): &(Rc<PayloadFormat>, _)| Rc::ptr_eq(format, &message.format);
        let index = if let Some(index) = self.payloads.iter().position(known) {
            index
        } else {
            let payload = PayloadDecoder::of(&message.format)?;
            self.payloads.push((Rc::clone(&message.format), payload));
            self.payloads.len() - 1
        };
        let columns = &self.topics[message.topic].columns;
        self.payloads[index].1.event(&message.data, message.log_time, columns)
    }

    /// At the end: a file without any message of the topics is an error, a topic without one may be a slip.
    fn finish(&self) -> Result<(), ConvertError> {
        let silent = self.topics.iter().filter(|topic| topic.number == 0);
        let silent: Vec<&str> = silent.map(|topic| topic.name).collect();
        let names = silent.join(", ");
        if silent.len() == self.topics.len() {
            return Err(
                self.fault(&format!("no message of topic {names}; name another with --topic"))
            );
        }
        if !silent.is_empty() {
            complain(format_args!("warning: {}: no message of topic {names}", self.file));
        }
        Ok(())
    }

    /// In one line, whatever the file holds.
    fn fault(&self, why: &str) -> ConvertError {
        let message = why.replace(char::is_control, "\u{fffd}");
        ConvertError::File { file: self.file.to_owned(), message }
    }
}

impl Recorded for TopicInput<'_> {
    fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault> {
        Ok(None)
    }

    fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault> {
        loop {
            let Some(message) = self.raw().map_err(|why| self.fault(&why))? else {
                self.finish()?;
                return Ok(None);
            };
            self.topics[message.topic].number += 1;
            match self.event(&message) {
                Ok(None) => {}
                Ok(event) => return Ok(event),
                Err(why) => {
                    let MappedTopic { name, number, .. } = &self.topics[message.topic];
                    return Err(self.fault(&format!("{name}, message {number}: {why}")).into());
                }
            }
        }
    }
}
