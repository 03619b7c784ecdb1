//! The items that go downstream. Each message has one item. Under progressive it has one or more,
//! and the last is marked (D1).

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use fuseline_traces::OpenRefusal;

use crate::lineage::Lineage;

/// The output of an operator for one message.
///
/// Every message leads to exactly one item (P1, P11). Under progressive it leads to one or more,
/// each better than the one before, and exactly one [is the last](Self::is_last) (D1, F9). Items
/// come in the order of decisions (A12). So under progressive a consumer should keep the item of
/// the greatest `(timestamp, source.priority)`; otherwise an old message's better result replaces a
/// newer message's result.
///
/// Instants are readings of the operator's clock: the time since the operator started.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Item<V> {
    /// The message's timestamp: its index in the input stream, from 0.
    pub timestamp: u64,
    /// The instant when the message arrived.
    pub opened: Duration,
    /// The instant of the decision.
    pub decided: Duration,
    /// The number of items of its message before this one. It is 0 unless the commit rule is
    /// progressive.
    pub revision: u32,
    /// The way in which the message ended.
    pub ending: Ending<V>,
    /// The sources whose failure was accepted by then, and the reasons (F4).
    pub failures: Vec<Failure>,
    /// The origin of the message, as it was given with the message.
    pub lineage: Option<Arc<Lineage>>,
    /// The time from the capture to the decision, if that is known. If the value is
    /// [of](Forwarded::of) an earlier message, it counts from that message's capture. A substitute
    /// has none (E7).
    pub age: Option<Duration>,
    /// The value that the operator's [handler](Self::needs_substitute) gave for a message without a
    /// result (E4). The ending stays as it is.
    pub substitute: Option<V>,
    /// The message itself, if the operator is configured to carry it. Read it with
    /// [`message`](Self::message).
    pub carried: Option<CarriedMessage>,
}

/// A message that an item carries, shared with its computations.
#[derive(Clone)]
pub struct CarriedMessage(pub Arc<dyn Any + Send + Sync>);

/// A source that sent no result for a message, and the reason.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Failure {
    /// The source.
    pub source: Source,
    /// The reason in words, at most 200 bytes.
    pub why: Arc<str>,
}

/// States how a message ended. Preliminary and final occur only under progressive.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Ending<V> {
    /// The best result so far; a better one may follow (F9).
    Preliminary(Forwarded<V>),
    /// The best available result (F7, P3). Nothing follows.
    Forwarded(Forwarded<V>),
    /// No better result came than this source's, which was sent before and is the last (F9).
    Final(Source),
    /// No result came and none will (F6).
    Missed,
    /// The message was refused, and nothing was computed for it (F1).
    Refused(OpenRefusal),
}

/// A result that goes downstream.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Forwarded<V> {
    /// The result.
    pub value: V,
    /// The source that computed it.
    pub source: Source,
    /// The instant when the result arrived. It is earlier than the decision if the result was held.
    pub arrived: Duration,
    /// The event that triggered the output.
    pub trigger: Trigger,
    /// The timestamp of the message that the value was computed from, if its source named it. It is
    /// at most the cloud's `max_age` before the item's own (D2).
    pub of: Option<u64>,
    /// The timestamp of the message that the value is meant for, if its source named it. It is
    /// always the item's own (D18).
    pub meant_for: Option<u64>,
}

/// Local or a cloud.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Source {
    /// The source's rank: 0 is local, clouds have 1 to 65535, and the greater number wins.
    pub priority: u16,
    /// `local`, or the cloud's name.
    pub name: Arc<str>,
}

/// The event that triggered an output.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Trigger {
    /// The result arrived and was sent at once (F3, F9).
    Arrival,
    /// The result was held, and the sources that it waited for failed (F4).
    Failure,
    /// The result was held, and a timer fired (F5).
    Timer,
}

impl Trigger {
    /// All triggers.
    pub const ALL: [Self; 3] = [Self::Arrival, Self::Failure, Self::Timer];

    /// Returns the word for metrics and logs.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Arrival => "arrival",
            Self::Failure => "failure",
            Self::Timer => "timer",
        }
    }

    /// Returns the identifier of the rule that triggered the output.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::Arrival => "F3",
            Self::Failure => "F4",
            Self::Timer => "F5",
        }
    }
}

impl fmt::Display for Trigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.name)
    }
}

/// Two carried messages are equal only if they are the same message.
impl PartialEq for CarriedMessage {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for CarriedMessage {}

impl fmt::Debug for CarriedMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("CarriedMessage(…)")
    }
}

impl<V> Item<V> {
    /// Returns the message. Returns `None` if the operator does not carry messages, or if `M` is
    /// not the type of its input.
    #[must_use]
    pub fn message<M: Send + Sync + 'static>(&self) -> Option<Arc<M>> {
        Arc::downcast(Arc::clone(&self.carried.as_ref()?.0)).ok()
    }

    /// Returns the forwarded result, preliminary or not, if there is one.
    #[must_use]
    pub const fn forwarded(&self) -> Option<&Forwarded<V>> {
        match &self.ending {
            Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => Some(forwarded),
            Ending::Final(_) | Ending::Missed | Ending::Refused(_) => None,
        }
    }

    /// Returns the value that a consumer should use: the forwarded result, or otherwise the
    /// substitute.
    #[must_use]
    pub const fn value(&self) -> Option<&V> {
        match self.forwarded() {
            Some(forwarded) => Some(&forwarded.value),
            None => self.substitute.as_ref(),
        }
    }

    /// Returns `true` if the message ended without a result: missed or refused.
    #[must_use]
    pub const fn needs_substitute(&self) -> bool {
        match &self.ending {
            Ending::Missed | Ending::Refused(_) => true,
            Ending::Preliminary(_) | Ending::Forwarded(_) | Ending::Final(_) => false,
        }
    }

    /// Returns `true` if no other item of the message follows.
    #[must_use]
    pub const fn is_last(&self) -> bool {
        match &self.ending {
            Ending::Preliminary(_) => false,
            Ending::Forwarded(_) | Ending::Final(_) | Ending::Missed | Ending::Refused(_) => true,
        }
    }

    /// Returns this item for a consumer that did not get the `earlier` item of the same message. A
    /// final item becomes a forwarded one with the earlier value, whose age grows by the time in
    /// between.
    #[must_use]
    pub fn instead_of(mut self, earlier: Self) -> Self {
        if let (Ending::Final(_), Ending::Preliminary(last)) = (&self.ending, earlier.ending) {
            // The value has aged since.
            let waited = self.decided.saturating_sub(earlier.decided);
            self.age = earlier.age.map(|age| age.saturating_add(waited));
            self.ending = Ending::Forwarded(last);
        }
        self
    }

    /// Returns the time from the message's arrival to the decision.
    #[must_use]
    pub const fn latency(&self) -> Duration {
        self.decided.saturating_sub(self.opened)
    }
}
