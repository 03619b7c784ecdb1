//! What was sent, what came of it, and what should have.

use std::collections::BTreeMap;

use hiroz::attachment::Attachment;
use hiroz::msg::ZMessage;
use hiroz_msgs::diagnostic_msgs::DiagnosticStatus;
use zenoh::sample::Sample;

use crate::image;
use crate::graph_scene::{LOCAL, WEST};

/// By whom an image is to be answered.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Expected {
    Only(&'static str),
    /// By either: the cloud came or went meanwhile.
    Either,
    /// Perhaps by nobody: not all have met yet.
    Perhaps,
}

/// One image.
struct Entry {
    expected: Expected,
    part: &'static str,
    answers: Vec<&'static str>,
    reported: Vec<String>,
}

/// All images, and what is wrong.
#[derive(Default)]
pub(crate) struct ImageLog {
    images: Vec<Entry>,
    last: Option<Attachment>,
    wrong: Vec<String>,
}

impl ImageLog {
    /// A new image; returns its number.
    pub(crate) fn begins(&mut self, part: &'static str, expected: Expected) -> u32 {
        self.images.push(Entry { expected, part, answers: Vec::new(), reported: Vec::new() });
        u32::try_from(self.images.len() - 1).unwrap_or(u32::MAX)
    }

    /// An output came.
    pub(crate) fn output(&mut self, sample: &Sample) {
        self.in_order(sample);
        let payload = sample.payload().to_bytes();
        let number = match image::number(&payload) {
            Ok(number) => number,
            Err(error) => return self.wrong.push(format!("an output cannot be read: {error}")),
        };
        let Some(entry) = self.images.get_mut(number as usize) else {
            return self.wrong.push(format!("an output of an unknown image, {number}"));
        };
        let made_by = |source: &&&str| *image::of(source, number).serialize() == *payload;
        match [LOCAL, WEST].iter().find(made_by) {
            Some(source) => entry.answers.push(source),
            None => self.wrong.push(format!("output {number} is not what a source made")),
        }
    }

    /// A status came.
    pub(crate) fn status(&mut self, status: DiagnosticStatus) {
        let mut values: BTreeMap<_, _> =
            status.values.into_iter().map(|pair| (pair.key, pair.value)).collect();
        let key = values.remove("key").unwrap_or_default();
        let source = values.remove("source").unwrap_or(status.message);
        let numbers = 0..u32::try_from(self.images.len()).unwrap_or(u32::MAX);
        let number = numbers.into_iter().rfind(|number| image::key(*number) == key);
        match number.and_then(|number| self.images.get_mut(number as usize)) {
            Some(entry) => entry.reported.push(source),
            None => self.wrong.push(format!("a status of an unknown image, {key}")),
        }
    }

    /// The cloud comes or goes: what is open may be answered by either.
    pub(crate) fn unsure(&mut self) {
        for entry in self.images.iter_mut().filter(|entry| entry.is_open()) {
            entry.expected = Expected::Either;
        }
    }

    /// How many images have this answer.
    pub(crate) fn answered_by(&self, source: &str, part: &str) -> usize {
        let of_part = self.images.iter().filter(|entry| entry.part == part);
        of_part.filter(|entry| entry.answers.contains(&source)).count()
    }

    /// Whether nothing is expected any more.
    pub(crate) fn is_complete(&self) -> bool {
        !self.images.iter().any(|entry| entry.is_open() || entry.reported.len() < entry.answers.len())
    }

    /// A table of the parts of the scene.
    pub(crate) fn print(&self, parts: &[&str]) {
        println!("{:24} inputs   west  local   none  twice", "");
        for part in parts {
            let of_part = || self.images.iter().filter(|entry| entry.part == *part);
            let count = |wanted: &dyn Fn(&Entry) -> bool| of_part().filter(|e| wanted(e)).count();
            println!(
                "{part:24} {:6} {:6} {:6} {:6} {:6}",
                of_part().count(),
                self.answered_by(WEST, part),
                self.answered_by(LOCAL, part),
                count(&|entry| entry.answers.is_empty()),
                count(&|entry| entry.answers.len() > 1),
            );
        }
    }

    /// All that is not as it should be.
    pub(crate) fn wrong(self) -> Vec<String> {
        let Self { images, mut wrong, .. } = self;
        for (number, entry) in images.iter().enumerate() {
            let Entry { expected, answers, reported, part } = entry;
            let is_right = match (expected, &answers[..]) {
                (Expected::Only(wanted), [source]) => source == wanted,
                (Expected::Either, [_]) | (Expected::Perhaps, [] | [_]) => true,
                _ => false,
            };
            if !is_right {
                wrong.push(format!("image {number} ({part}) is answered by {answers:?}"));
            }
            if *expected != Expected::Perhaps && answers != reported {
                wrong.push(format!("image {number}: {answers:?} answer, the status says {reported:?}"));
            }
        }
        wrong
    }

    /// Each output bears the attachment of the node's one publisher, with the next number.
    fn in_order(&mut self, sample: &Sample) {
        let attachment = sample.attachment().map(Attachment::try_from);
        let Some(Ok(attachment)) = attachment else {
            return self.wrong.push("an output without its attachment".into());
        };
        if let Some(last) = &self.last {
            let (number, is_next) = (attachment.sequence_number, last.sequence_number + 1);
            if number != is_next || attachment.source_gid != last.source_gid {
                self.wrong.push(format!("output {number} came where {is_next} was next"));
            }
        }
        self.last = Some(attachment);
    }
}

impl Entry {
    fn is_open(&self) -> bool {
        self.answers.is_empty() && self.expected != Expected::Perhaps
    }
}
