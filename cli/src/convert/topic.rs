//! `--topic`: which messages of a recording are read, and as which events.

use crate::convert::key;
use crate::convert::mapping::Fixed;
use crate::convert::row::Row;
use crate::convert::service::Side;

/// A topic, and what its messages are where they do not say so.
#[derive(Clone, Debug)]
pub(crate) struct TopicChoice {
    pub(super) name: String,
    /// The event that each message is.
    pub(super) event: Option<&'static str>,
    /// Whose it is.
    source: Option<String>,
}

/// `TOPIC`, or `[SOURCE.]EVENT=TOPIC`.
///
/// # Errors
/// What to write instead.
pub(super) fn topic(text: &str) -> Result<TopicChoice, String> {
    let Some((what, name)) = text.split_once('=') else {
        return Ok(TopicChoice { name: text.to_owned(), event: None, source: None });
    };
    let (source, word) = match what.rsplit_once('.') {
        Some((source, word)) => (Some(source.to_owned()), word),
        None => (None, what),
    };
    let (_, event) = key::event(&format!("{name}={word}"))?;
    if event.is_empty() {
        return Err("write TOPIC or EVENT=TOPIC, such as west.result=/west/objects".to_owned());
    }
    Ok(TopicChoice { name: name.to_owned(), event: Some(event), source })
}

impl TopicChoice {
    /// What it says of its messages.
    pub(super) fn fixed(&self) -> Fixed<'_> {
        Fixed { event: self.event, source: self.source.as_deref() }
    }

    /// Where a message was recorded that it means; none if it means others of a service's events.
    pub(super) fn means(&self, row: &Row) -> Option<Side> {
        let kind = row.cell("info.event_type").filter(|_| self.name.ends_with("/_service_event"));
        match (self.event, kind) {
            (Some("request"), Some("1")) | (Some("result"), Some("2")) => Some(Side::Server),
            (Some("request"), Some(kind)) => (kind == "0").then_some(Side::Client),
            (Some("result"), Some(kind)) => (kind == "3").then_some(Side::Client),
            // An operator that is a service itself receives messages, and sends outputs.
            (Some("open"), Some(kind)) => (kind == "1").then_some(Side::Client),
            (Some("emit"), Some(kind)) => (kind == "2").then_some(Side::Client),
            _ => Some(Side::Client),
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
            ("west.result=/west/objects", "/west/objects", Some("result"), Some("west")),
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
