//! `--topic`: which messages of a recording are read, and as which events.

use fuseline_traces::rows::{self as table, Columns};

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
    let (_, event) = table::event(&format!("{name}={word}"))?;
    if event.is_empty() {
        return Err("write TOPIC or EVENT=TOPIC, such as west.result=/west/objects".to_owned());
    }
    Ok(TopicChoice { name: name.to_owned(), event: Some(event), source })
}

impl TopicChoice {
    /// The columns of the topic's messages.
    pub(super) fn columns<'c>(&self, columns: &Columns<'c>) -> Columns<'c> {
        let event = self.event.map(|event| ("ev", event.to_owned()));
        let source = self.source.clone().map(|source| ("p", source));
        columns.clone().with_fixed(event.into_iter().chain(source))
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
