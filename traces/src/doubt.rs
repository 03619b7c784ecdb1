//! The kinds of doubt in a verdict, about facts that a judge could not see (SPEC.md, *Doubts*).

use std::fmt;

use serde::{Serialize, Serializer};

/// The number of messages in doubt whose timestamps a verdict stores.
const MESSAGES: usize = 1 << 20;

/// A kind of doubt.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum DoubtKind {
    /// No timestamp was judged.
    Unjudged,
    /// An open message has no output and waits for no deadline, although a later message has an
    /// output.
    Unanswered,
    /// A message was still open when the run ended.
    Unfinished,
    /// A request, a result or an output has a timestamp that was never opened.
    Unopened,
    /// A cloud returned nothing for any request, although some ran to their deadlines.
    Silent,
    /// A deadline is no longer than the delay by which a late result may pass unnoticed.
    Coarse,
    /// All instants are so close together that their order is unknown.
    Blurred,
    /// No deadline of a source ended within the trace.
    Endless,
    /// The trace was cut off.
    Cut,
}

/// A doubt of one kind about one trace.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Doubt {
    /// The kind of doubt.
    pub kind: DoubtKind,
    /// The number of messages, requests or lines in doubt.
    pub count: u64,
    /// A sentence that says what was found.
    pub found: String,
    /// The first message in doubt, if the doubt is about messages.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t: Option<u64>,
    /// `true` if the caller accepts this kind of doubt.
    pub accepted: bool,
    /// The first million messages in doubt; empty if the doubt is about the whole trace.
    #[serde(skip)]
    pub messages: Vec<u64>,
}

/// The messages with one kind of doubt, while a trace is judged.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct DoubtfulMessages {
    count: u64,
    messages: Vec<u64>,
}

impl DoubtKind {
    /// All kinds, in the order of section 7 of SPEC.md.
    pub const ALL: [Self; 9] = [
        Self::Unjudged,
        Self::Unanswered,
        Self::Unfinished,
        Self::Unopened,
        Self::Silent,
        Self::Coarse,
        Self::Blurred,
        Self::Endless,
        Self::Cut,
    ];

    /// Returns the kind's name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        self.name_and_sentence().0
    }

    /// Returns a sentence that explains the kind.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        self.name_and_sentence().1
    }

    /// Returns the kind with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == name)
    }

    const fn name_and_sentence(self) -> (&'static str, &'static str) {
        match self {
            Self::Unjudged => ("unjudged", "No timestamp was judged."),
            Self::Unanswered => (
                "unanswered",
                "A message has no output and no deadline that still runs, though a later message \
                 was answered.",
            ),
            Self::Unfinished => ("unfinished", "A message was open when the run ended."),
            Self::Unopened => {
                ("unopened", "A request, result or output is of a timestamp that no open has.")
            }
            Self::Silent => (
                "silent",
                "A cloud answered none of its requests, though some ran to their deadlines.",
            ),
            Self::Coarse => (
                "coarse",
                "A deadline is no longer than the lateness and twice the tolerance, by which a \
                 late result may pass.",
            ),
            Self::Blurred => (
                "blurred",
                "All that happened lies within the tolerance, so that its order is unknown.",
            ),
            Self::Endless => ("endless", "No deadline of a source ended within the trace."),
            Self::Cut => ("cut", "The trace was cut off, and its end is not judged."),
        }
    }
}

impl fmt::Display for DoubtKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl Serialize for DoubtKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl Doubt {
    /// Creates a doubt about the whole trace.
    #[must_use]
    pub const fn new(kind: DoubtKind, count: u64, found: String) -> Self {
        Self { kind, count, found, t: None, accepted: false, messages: Vec::new() }
    }

    /// Returns the doubt that nothing was judged, if `judged` is 0.
    #[must_use]
    pub fn unjudged(judged: u64) -> Option<Self> {
        let found = || "no timestamp was judged".to_owned();
        (judged == 0).then(|| Self::new(DoubtKind::Unjudged, 1, found()))
    }

    /// Returns this doubt about the wanted messages only, or `None` if none of its messages is
    /// wanted. A doubt about the whole trace stays as it is.
    #[must_use]
    pub fn of_messages(&self, is_wanted: impl Fn(u64) -> bool) -> Option<Self> {
        if self.messages.is_empty() {
            return Some(self.clone());
        }
        let wanted = self.messages.iter().copied().filter(|t| is_wanted(*t));
        let of = DoubtfulMessages { count: 0, messages: wanted.collect() };
        let count = of.messages.len() as u64;
        DoubtfulMessages { count, ..of }.doubt(self.kind)
    }
}

impl fmt::Display for Doubt {
    /// Writes the kind and the finding.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.kind, self.found)
    }
}

impl DoubtfulMessages {
    /// Adds a message.
    pub(crate) fn push(&mut self, t: u64) {
        self.count += 1;
        if self.messages.len() < MESSAGES {
            self.messages.push(t);
        }
    }

    /// Removes a message if it is among the first million.
    pub(crate) fn remove(&mut self, t: u64) {
        if let Some(place) = self.messages.iter().rposition(|message| *message == t) {
            self.messages.swap_remove(place);
            self.count -= 1;
        }
    }

    /// Returns the doubt about these messages, if there are any.
    pub(crate) fn doubt(mut self, kind: DoubtKind) -> Option<Doubt> {
        self.messages.sort_unstable();
        let first = *self.messages.first()?;
        let (count, is_one) = (self.count, self.count == 1);
        let some = |one: &str, many: &str| {
            if is_one {
                format!("message {first} {one}")
            } else {
                format!("{count} messages {many}; the first is {first}")
            }
        };
        let found = match kind {
            DoubtKind::Unanswered => some(
                "has no output, though a later message was answered",
                "have no output, though later messages were answered",
            ),
            DoubtKind::Unfinished => {
                some("was open when the run ended", "were open when the run ended")
            }
            DoubtKind::Unopened => some(
                "has requests, results or outputs, but no open",
                "have requests, results or outputs, but no open",
            ),
            _ => some("is in doubt", "are in doubt"),
        };
        let messages = self.messages;
        Some(Doubt { kind, count, found, t: Some(first), accepted: false, messages })
    }
}

/// Accepts some kinds of doubt. Returns `true` if no other doubt is left.
pub(crate) fn accept(doubts: &mut [Doubt], kinds: &[DoubtKind]) -> bool {
    for doubt in &mut *doubts {
        doubt.accepted |= kinds.contains(&doubt.kind);
    }
    doubts.iter().all(|doubt| doubt.accepted)
}

/// Describes a verdict in a few words.
pub(crate) fn in_short(violations: u64, doubts: &[Doubt]) -> String {
    let accepted: Vec<&str> =
        doubts.iter().filter(|doubt| doubt.accepted).map(|doubt| doubt.kind.as_str()).collect();
    if violations > 0 {
        return "does not conform".to_owned();
    }
    if accepted.len() < doubts.len() {
        return "no violation found".to_owned();
    }
    if accepted.is_empty() {
        return "conforms".to_owned();
    }
    format!("conforms, accepting {}", accepted.join(", "))
}
