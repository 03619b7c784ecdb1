//! What goes downstream: one item for each message; under progressive one or more, the last one marked (D1).

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use fuseline_traces::OpenRefusal;

use crate::lineage::Lineage;

/// What became of one message. Every message taken in leads to exactly one item (P1, P11); under progressive to one or more,
/// each better than the one before, of which exactly one [is the last](Self::is_last) (D1, F9).
///
/// Items come in the order of decisions (A12): under progressive a consumer keeps the item of the greatest
/// `(timestamp, source.priority)`, or else an old message's better result replaces a newer message's.
///
/// Instants are readings of the operator's clock: time since the operator started.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Item<V> {
    /// The message's timestamp: its index in the input stream, from 0.
    pub timestamp: u64,
    /// When the message was taken in.
    pub opened: Duration,
    /// When it was decided.
    pub decided: Duration,
    /// How many items of its message came before it: 0, unless the rule is progressive.
    pub revision: u32,
    /// How the message left.
    pub ending: Ending<V>,
    /// The sources whose failure was accepted by then, and why they failed (F4).
    pub failures: Vec<Failure>,
    /// What the message comes from, as it was written with it.
    pub lineage: Option<Arc<Lineage>>,
    /// The time from the capture to the decision, if it is known: of the message that the value is [of](Forwarded::of), if that
    /// is an earlier one. Of a substitute it is unknown (E7).
    pub age: Option<Duration>,
    /// E4: what the operator's [handler](Self::needs_substitute) gave for a message without a result. The ending stays as it is.
    pub substitute: Option<V>,
    /// The message itself, if the operator was to keep it; read it by [`message`](Self::message).
    pub carried: Option<CarriedMessage>,
}

/// A message that an item carries, shared with whoever computes it.
#[derive(Clone)]
pub struct CarriedMessage(pub Arc<dyn Any + Send + Sync>);

/// A source that sent no result for a message, and why.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Failure {
    /// The source.
    pub source: Source,
    /// The reason in words, at most 200 bytes.
    pub why: Arc<str>,
}

/// How a message was answered; preliminary and final under progressive alone.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Ending<V> {
    /// The best result so far; a better one may follow (F9).
    Preliminary(Forwarded<V>),
    /// The best available result (F7, P3); nothing follows.
    Forwarded(Forwarded<V>),
    /// No better result came than this source's, which was sent before and is the last (F9).
    Final(Source),
    /// No result came and none will (F6).
    Missed,
    /// The message was not taken on, and nothing was computed for it (F1).
    Refused(OpenRefusal),
}

/// A result on its way downstream.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Forwarded<V> {
    /// The result.
    pub value: V,
    /// Who computed it.
    pub source: Source,
    /// When the result arrived; earlier than the decision if it was held.
    pub arrived: Duration,
    /// What made the result go.
    pub trigger: Trigger,
    /// Of which message the value is, if its source said so: of this one, or of one before it that is no older than the
    /// cloud's `max_age` allows (D2).
    pub of: Option<u64>,
}

/// Local or a cloud.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Source {
    /// 0 is local; clouds have 1 to 65535, the greater wins.
    pub priority: u16,
    /// `local`, or the cloud's name.
    pub name: Arc<str>,
}

/// What made a result go.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Trigger {
    /// F3: it arrived, and nothing better was still to come.
    Arrival,
    /// F4: it was held, and what it waited for failed.
    Failure,
    /// F5: it was held, and a timer fired.
    Timer,
}

impl Trigger {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Arrival, Self::Failure, Self::Timer];

    /// Its word in metrics and logs.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Arrival => "arrival",
            Self::Failure => "failure",
            Self::Timer => "timer",
        }
    }

    /// The identifier of the rule that made the result go.
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

/// The same message, not an equal one.
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
    /// The message that it is of, if the operator was to keep it and it is of type `M`, the operator's input.
    #[must_use]
    pub fn message<M: Send + Sync + 'static>(&self) -> Option<Arc<M>> {
        Arc::downcast(Arc::clone(&self.carried.as_ref()?.0)).ok()
    }

    /// The forwarded result, preliminary or not, if there is one.
    #[must_use]
    pub const fn forwarded(&self) -> Option<&Forwarded<V>> {
        match &self.ending {
            Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => Some(forwarded),
            Ending::Final(_) | Ending::Missed | Ending::Refused(_) => None,
        }
    }

    /// What a consumer goes by: the forwarded result, or else the substitute.
    #[must_use]
    pub const fn value(&self) -> Option<&V> {
        match self.forwarded() {
            Some(forwarded) => Some(&forwarded.value),
            None => self.substitute.as_ref(),
        }
    }

    /// Whether its message ended without a result: missed or refused.
    #[must_use]
    pub const fn needs_substitute(&self) -> bool {
        match &self.ending {
            Ending::Missed | Ending::Refused(_) => true,
            Ending::Preliminary(_) | Ending::Forwarded(_) | Ending::Final(_) => false,
        }
    }

    /// Whether no other item of its message follows.
    #[must_use]
    pub const fn is_last(&self) -> bool {
        match &self.ending {
            Ending::Preliminary(_) => false,
            Ending::Forwarded(_) | Ending::Final(_) | Ending::Missed | Ending::Refused(_) => true,
        }
    }

    /// This item for whoever was not given the `earlier` one of its message: where it is final, it has the value that was
    /// sent before.
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

    /// The time from taking the message in to the decision.
    #[must_use]
    pub const fn took(&self) -> Duration {
        self.decided.saturating_sub(self.opened)
    }
}
