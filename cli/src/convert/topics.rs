//! Messages of topics of a recording, MCAP or rosbag2's database, and `--topic`: which are read,
//! and as which events.

use std::collections::HashSet;
use std::rc::Rc;
use std::sync::Arc;

use fuseline_traces::packed::{PayloadFormat, RawMessage, RawMessages, unpack_message};

use crate::convert::key;
use crate::convert::log::Log;
use crate::convert::notes::Notes;
use crate::convert::payload::PayloadDecoder;
use crate::convert::row::{Place, Problem, ProblemKind, ReadRow, Row, Spot};

/// A topic, and what its messages are where they do not say so.
#[derive(Clone, Debug)]
pub(crate) struct TopicChoice {
    pub(super) name: String,
    /// The user's text.
    pub(super) option: String,
    /// The event that each message is.
    pub(super) event: Option<&'static str>,
    /// The source.
    pub(super) source: Option<String>,
}

/// A recording that is being read.
pub(super) trait Recording {
    /// Returns the next message of the topics, with which of them it is of; none at the end.
    fn message(&mut self) -> Result<Option<RawMessage>, (String, bool)>;

    /// Returns all topics so far.
    fn topics(&self) -> Vec<String>;
}

/// The messages of a recording as rows.
pub(super) struct TopicRows<'a> {
    file: Arc<str>,
    pub(super) recording: Box<dyn Recording + 'a>,
    /// The topics, and how many messages each had.
    counts: Vec<(Arc<str>, u64)>,
    /// The decoders of the channels so far.
    payloads: Vec<(Rc<PayloadFormat>, PayloadDecoder)>,
}

/// The place of a service's event, as the event's kind: 0, a request was sent; 1, it was received;
/// 2, a response was sent; 3, it was received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Side {
    Client,
    Server,
}

/// The rows of a recording that a service's server had; they are read if its client's were not
/// recorded.
#[derive(Default)]
pub(super) struct ServiceRows {
    has_client: bool,
    rows: HashSet<u64>,
    first: Option<Place>,
}

/// Reads `TOPIC`, or `[SOURCE.]EVENT=TOPIC`.
pub(super) fn topic(text: &str) -> Result<TopicChoice, String> {
    let (option, (what, name)) = (text.to_owned(), text.split_once('=').unwrap_or(("", text)));
    if !text.contains('=') {
        return Ok(TopicChoice { name: name.to_owned(), option, event: None, source: None });
    }
    let (source, word) = match what.rsplit_once('.') {
        Some((source, word)) => (Some(source.to_owned()), word),
        None => (None, what),
    };
    let (_, event) = key::event(&format!("{name}={word}"))?;
    if event.is_empty() {
        return Err("write TOPIC or EVENT=TOPIC, such as west.result=/west/objects".to_owned());
    }
    Ok(TopicChoice { name: name.to_owned(), option, event: Some(event), source })
}

/// Returns the topics that are read, each once.
pub(super) fn names(topics: &[TopicChoice]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for topic in topics {
        if !names.contains(&&*topic.name) {
            names.push(&topic.name);
        }
    }
    names
}

impl Recording for RawMessages<'_> {
    fn message(&mut self) -> Result<Option<RawMessage>, (String, bool)> {
        Self::message(self).map_err(|error| (error.to_string(), error.is_cut()))
    }

    fn topics(&self) -> Vec<String> {
        self.seen().map(str::to_owned).collect()
    }
}

impl<'a> TopicRows<'a> {
    pub(super) fn new(file: &Arc<str>, recording: Box<dyn Recording + 'a>, names: &[&str]) -> Self {
        let counts = names.iter().map(|name| ((*name).into(), 0)).collect();
        Self { file: Arc::clone(file), recording, counts, payloads: Vec::new() }
    }

    fn row(&mut self, message: &RawMessage) -> ReadRow {
        let (name, count) = &mut self.counts[message.topic];
        *count += 1;
        let place = Place::new(&self.file, Spot::Message(Arc::clone(name), *count));
        let problem = |why: String| Problem::at(&place, why);
        let known = |(format, _): &(Rc<PayloadFormat>, _)| Rc::ptr_eq(format, &message.format);
        let index = if let Some(index) = self.payloads.iter().position(known) {
            index
        } else {
            let payload = PayloadDecoder::of(&message.format).map_err(problem)?;
            self.payloads.push((Rc::clone(&message.format), payload));
            self.payloads.len() - 1
        };
        let unpacked = unpack_message(&message.data);
        let data = unpacked.as_deref().unwrap_or(&message.data);
        let cells = self.payloads[index].1.cells(data).map_err(problem)?;
        let (log_time, topic) = (Some(message.log_time), Some(message.topic));
        Ok(Row { place, cells, log_time, topic })
    }
}

impl Iterator for TopicRows<'_> {
    type Item = ReadRow;

    fn next(&mut self) -> Option<ReadRow> {
        match self.recording.message() {
            Ok(message) => message.map(|message| self.row(&message)),
            Err((message, is_cut)) => {
                let kind = if is_cut { ProblemKind::Cut } else { ProblemKind::File };
                let place = Place::new(&self.file, Spot::File);
                Some(Err(Problem::of_kind(kind, &place, message)))
            }
        }
    }
}

/// Returns where the message was recorded, if the topic means it as this event, or `None` if the
/// topic means others of a service's events.
pub(super) fn side(topic: &str, event: Option<&str>, row: &Row) -> Option<Side> {
    let kind = row.cell("info.event_type").filter(|_| topic.ends_with("/_service_event"));
    let (client, server) = match event {
        Some("request") => ("0", "1"),
        Some("result") => ("3", "2"),
        // An operator that is a service itself receives messages, and sends outputs.
        Some("open") => ("1", ""),
        Some("emit") => ("2", ""),
        _ => return Some(Side::Client),
    };
    match kind {
        Some(kind) if kind == server => Some(Side::Server),
        Some(kind) if kind != client => None,
        _ => Some(Side::Client),
    }
}

impl ServiceRows {
    pub(super) fn take(&mut self, side: Side, row: &Row, number: u64) {
        if side == Side::Server {
            self.rows.insert(number);
            self.first.get_or_insert_with(|| row.place.clone());
        } else if matches!(row.cell("info.event_type"), Some("0" | "3")) {
            self.has_client = true;
        }
    }

    pub(super) fn finish(self, notes: &mut Notes, log: &mut Log) {
        let Some(first) = self.first else { return };
        let kind = if self.has_client {
            log.entries.retain(|entry| !self.rows.contains(&entry.row));
            "events of a service's server, skipped because the log has its client's"
        } else {
            "events of a service's server, read in place of its client's, which were not recorded"
        };
        for _ in &self.rows {
            notes.add(kind, &first, String::new);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_may_say_what_its_messages_are() {
        for (text, name, event, source) in [
            ("/log", "/log", None, None),
            ("open=/camera", "/camera", Some("open"), None),
            ("a.b.fail=/f", "/f", Some("fail"), Some("a.b")),
        ] {
            let choice = topic(text).unwrap();
            let read = (&*choice.name, choice.event, choice.source.as_deref());
            assert_eq!(read, (name, event, source), "{text}");
        }
        for text in ["came=/camera", "=/camera", "west.=/camera"] {
            assert!(topic(text).is_err(), "{text}");
        }
    }
}
