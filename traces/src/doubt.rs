//! What a judge could not see: the kinds of doubt of a verdict (SPEC.md, *Doubts*).

use std::fmt;

use serde::{Serialize, Serializer};

/// Of how many messages in doubt a verdict remembers the timestamps.
const MESSAGES: usize = 1 << 20;

/// A kind of doubt.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum DoubtKind {
    /// No timestamp was judged.
    Unjudged,
    /// An open message has no output and waits for no deadline, though a later one was answered.
    Unanswered,
    /// A message was still open when the run ended.
    Unfinished,
    /// A request, result or output is of a timestamp that no open has.
    Unopened,
    /// A cloud answered none of its requests, though some ran to their deadlines.
    Silent,
    /// A deadline is no longer than what a late result may pass by.
    Coarse,
    /// All instants lie so near to each other that their order is unknown.
    Blurred,
    /// No deadline of a source ended within the trace.
    Endless,
    /// The trace was cut off.
    Cut,
}

/// What one kind of doubt is about in one trace.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Doubt {
    /// Its kind.
    pub kind: DoubtKind,
    /// How many messages, requests or lines it is about.
    pub count: u64,
    /// What was found, in a sentence.
    pub found: String,
    /// The first message that it is about, if it is about messages.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t: Option<u64>,
    /// Whether whoever asked for the verdict accepts this kind.
    pub accepted: bool,
    /// The messages that it is about, the first million of them; empty if it is about the whole trace.
    #[serde(skip)]
    pub messages: Vec<u64>,
}

/// The messages that one kind of doubt is about, while a trace is judged.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct DoubtfulMessages {
    count: u64,
    messages: Vec<u64>,
}

impl DoubtKind {
    /// All kinds, as section 7 of SPEC.md lists them.
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

    /// Its name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        self.name_and_sentence().0
    }

    /// What it means, in a sentence.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        self.name_and_sentence().1
    }

    /// The kind with this name.
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
    /// A doubt about the whole trace.
    #[must_use]
    pub const fn new(kind: DoubtKind, count: u64, found: String) -> Self {
        Self { kind, count, found, t: None, accepted: false, messages: Vec::new() }
    }

    /// The doubt that nothing was judged, if nothing was.
    #[must_use]
    pub fn unjudged(judged: u64) -> Option<Self> {
        let found = || "no timestamp was judged".to_owned();
        (judged == 0).then(|| Self::new(DoubtKind::Unjudged, 1, found()))
    }

    /// The same about those of its messages that are wanted; none if none of them is.
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
    /// The kind and what was found.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.kind, self.found)
    }
}

impl DoubtfulMessages {
    /// Notes one more.
    pub(crate) fn push(&mut self, t: u64) {
        self.count += 1;
        if self.messages.len() < MESSAGES {
            self.messages.push(t);
        }
    }

    /// Takes one back that is among the first million.
    pub(crate) fn remove(&mut self, t: u64) {
        if let Some(place) = self.messages.iter().rposition(|message| *message == t) {
            self.messages.swap_remove(place);
            self.count -= 1;
        }
    }

    /// The doubt about them, if there are any.
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

/// Accepts some kinds of doubt; whether nothing else is in doubt.
pub(crate) fn accept(doubts: &mut [Doubt], kinds: &[DoubtKind]) -> bool {
    for doubt in &mut *doubts {
        doubt.accepted |= kinds.contains(&doubt.kind);
    }
    doubts.iter().all(|doubt| doubt.accepted)
}

/// What a verdict is in a few words.
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
