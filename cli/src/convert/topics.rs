//! Messages of topics of a recording: MCAP, or rosbag2's database.

use std::rc::Rc;
use std::sync::Arc;

use fuseline_traces::packed::{PayloadFormat, RawMessage, RawMessages, unpack_message};

#[cfg(feature = "bags")]
use crate::convert::db3::Db3Messages;
use crate::convert::payload::PayloadDecoder;
use crate::convert::recorded::ConvertError;
use crate::convert::row::{Notes, Place, Problem, ProblemKind, Row, Source, Spot};
use crate::convert::topic::TopicChoice;
use crate::convert::value::listed;

/// A recording that is being read.
pub(super) struct TopicSource<'a> {
    file: Arc<str>,
    messages: MessageFile<'a>,
    topics: Vec<(Arc<str>, u64)>,
    /// How messages of the channels so far are decoded.
    payloads: Vec<(Rc<PayloadFormat>, PayloadDecoder)>,
}

/// A recording by its format.
pub(super) enum MessageFile<'a> {
    Mcap(Box<RawMessages<'a>>),
    #[cfg(feature = "bags")]
    Db3(Db3Messages),
}

/// The topics that are read, each once.
pub(super) fn names(topics: &[TopicChoice]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for topic in topics {
        if !names.contains(&&*topic.name) {
            names.push(&topic.name);
        }
    }
    names
}

impl<'a> TopicSource<'a> {
    pub(super) fn new(file: &Arc<str>, messages: MessageFile<'a>, topics: &[TopicChoice]) -> Self {
        let topics = names(topics).into_iter().map(|name| (name.into(), 0)).collect();
        Self { file: Arc::clone(file), messages, topics, payloads: Vec::new() }
    }

    fn raw(&mut self) -> Result<Option<RawMessage>, Problem> {
        let (message, is_cut) = match &mut self.messages {
            MessageFile::Mcap(messages) => match messages.message() {
                Ok(message) => return Ok(message),
                Err(error) => (error.to_string(), error.is_cut()),
            },
            #[cfg(feature = "bags")]
            MessageFile::Db3(messages) => match messages.message() {
                Ok(message) => return Ok(message),
                Err(error) => (error.to_string(), false),
            },
        };
        let kind = if is_cut { ProblemKind::Cut } else { ProblemKind::File };
        Err(Problem { kind, ..Problem::of_file(&self.file, message) })
    }

    /// The message's values.
    fn cells(&mut self, message: &RawMessage) -> Result<Vec<(Arc<str>, String)>, String> {
        let known = |(format, _): &(Rc<PayloadFormat>, _)| Rc::ptr_eq(format, &message.format);
        let index = if let Some(index) = self.payloads.iter().position(known) {
            index
        } else {
            let payload = PayloadDecoder::of(&message.format)?;
            self.payloads.push((Rc::clone(&message.format), payload));
            self.payloads.len() - 1
        };
        let unpacked = unpack_message(&message.data);
        self.payloads[index].1.cells(unpacked.as_deref().unwrap_or(&message.data))
    }

    /// At the end: a file without any message of the topics is an error, a topic without one may be a slip.
    pub(super) fn finish(&self, notes: &mut Notes) -> Result<(), ConvertError> {
        let silent = self.topics.iter().filter(|(_, number)| *number == 0);
        let silent: Vec<&str> = silent.map(|(name, _)| &**name).collect();
        let others: Vec<&str> = match &self.messages {
            MessageFile::Mcap(messages) => messages.others().collect(),
            #[cfg(feature = "bags")]
            MessageFile::Db3(messages) => messages.others().collect(),
        };
        let Some(first) = silent.first() else { return Ok(()) };
        let has = if others.is_empty() {
            String::new()
        } else {
            format!("; the file has {}", listed(first, others.into_iter()))
        };
        let names = silent.join(", ");
        if silent.len() == self.topics.len() {
            let message = format!("no message of topic {names}; name another with --topic{has}");
            return Err(ConvertError::file(&self.file, &message));
        }
        notes.add_of_file("no message of topic", &self.file, format!("{names}{has}"));
        Ok(())
    }
}

impl Source for TopicSource<'_> {
    fn next_row(&mut self) -> Result<Option<Row>, Problem> {
        let Some(message) = self.raw()? else { return Ok(None) };
        let topic = message.topic;
        self.topics[topic].1 += 1;
        let spot = Spot::Message(Arc::clone(&self.topics[topic].0), self.topics[topic].1);
        let place = Place { file: Arc::clone(&self.file), spot };
        match self.cells(&message) {
            Ok(cells) => {
                Ok(Some(Row { place, cells, log_time: Some(message.log_time), topic: Some(topic) }))
            }
            Err(message) => Err(Problem { place, message, kind: ProblemKind::Row }),
        }
    }
}
