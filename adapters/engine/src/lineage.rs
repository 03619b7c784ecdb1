//! The origin and the age of a message. Operators pass it on and write it in their traces; no
//! decision depends on it (A51).

use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_traces::{Annotations, Origin, ValueKeys, nanos};

/// The origin of a message. Operators pass it on unchanged, from the sensor to the last output.
///
/// ```
/// use fuseline_engine::Lineage;
/// use std::time::{Duration, Instant};
///
/// let exposed = Instant::now();
/// let lineage = Lineage::new("camera/front", 41, exposed).within(Duration::from_millis(500));
/// assert_eq!(lineage.age(exposed + Duration::from_millis(30)), Some(Duration::from_millis(30)));
/// ```
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Lineage {
    /// The sensor's stream and the message's timestamp in it.
    pub origin: Option<Origin>,
    /// The instant when the sensor captured the message.
    pub captured: Option<Instant>,
    /// The time after the capture by which the last operator's output is due. If the capture is
    /// unknown, each operator counts from when it accepts the message. Each operator's deadlines
    /// end with it (E3), and traces record it, so that it can be judged (J2).
    pub within: Option<Duration>,
    /// The inputs of joins on the way that contributed no message.
    pub missing: Vec<Arc<str>>,
}

/// A value with the messages that its source names: the message that it was computed from (D2), and
/// the message that it is meant for (D18).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct StampedValue<V> {
    /// The value.
    pub value: V,
    /// The timestamp of the message that the value was computed from, as the reply states it. Never
    /// copy it from the request.
    pub of: Option<u64>,
    /// The timestamp of the message that the value is meant for, as the reply states it. For an
    /// action of a chunk, it is the action's tick.
    pub meant_for: Option<u64>,
}

impl Lineage {
    /// Returns the lineage of message `seq` of the sensor `stream`, captured at this instant.
    #[must_use]
    pub fn new(stream: impl Into<Arc<str>>, seq: u64, captured: impl Into<Instant>) -> Self {
        let origin = Origin { stream: stream.into(), seq: Some(seq) };
        Self { origin: Some(origin), captured: Some(captured.into()), ..Self::default() }
    }

    /// Returns the same lineage with an end-to-end deadline, which counts from the capture.
    #[must_use]
    pub fn within(mut self, deadline: Duration) -> Self {
        self.within = Some(deadline);
        self
    }

    /// Returns the time since the capture, if that is known, or 0 if the capture is still to come.
    #[must_use]
    pub fn age(&self, now: impl Into<Instant>) -> Option<Duration> {
        Some(now.into().saturating_duration_since(self.captured?))
    }

    /// Returns the keys of the `open`, whose instant is `now`. A deadline that counts from that
    /// instant is written as if it counted from the capture.
    pub(crate) fn annotations(&self, now: Option<Instant>, counts_from_now: bool) -> Annotations {
        let age = now.and_then(|now| self.age(now));
        let before = age.filter(|_| counts_from_now).unwrap_or_default();
        let within = self.within.map(|within| within.saturating_add(before));
        Annotations {
            within: within.map(nanos),
            age: age.map(nanos),
            origin: self.origin.clone(),
            missing: self.missing.clone(),
            ..Annotations::NONE
        }
    }
}

impl From<Lineage> for Option<Arc<Lineage>> {
    fn from(lineage: Lineage) -> Self {
        Some(Arc::new(lineage))
    }
}

impl<V> StampedValue<V> {
    /// Returns the keys that the source states about the value.
    pub(crate) const fn keys(&self) -> ValueKeys {
        ValueKeys { of: self.of, meant_for: self.meant_for }
    }
}

impl<V> From<V> for StampedValue<V> {
    fn from(value: V) -> Self {
        Self { value, of: None, meant_for: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An operator that doubts ages counts the deadline from the open, and a judge counts it from
    /// the capture (J2).
    #[test]
    fn deadline_from_the_open_is_written_with_the_age() {
        let captured = Instant::now();
        let lineage = Lineage::new("camera", 1, captured).within(Duration::from_nanos(500));
        let now = Some(captured + Duration::from_nanos(30));
        let keys = |counts_from_now| {
            let Annotations { within, age, .. } = lineage.annotations(now, counts_from_now);
            (within, age)
        };
        assert_eq!(keys(false), (Some(500), Some(30)));
        assert_eq!(keys(true), (Some(530), Some(30)));
    }
}
