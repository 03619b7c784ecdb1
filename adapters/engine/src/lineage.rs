//! What a message comes from and how old it is. Operators carry it along and write it in their traces; it decides nothing (A51).

use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_traces::{Annotations, Origin, nanos};

/// What a message comes from: operators pass it on as it is, from the sensor to the last output.
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
    /// The sensor's stream and the message's timestamp there.
    pub origin: Option<Origin>,
    /// When the sensor captured it.
    pub captured: Option<Instant>,
    /// By when after the capture the last operator's output is due; if the capture is unknown, each operator counts from when
    /// it takes the message in. Each operator's deadlines end with it (E3); traces have it, where it is judged (J2).
    pub within: Option<Duration>,
    /// The inputs of joins on the way that nothing came from.
    pub missing: Vec<Arc<str>>,
}

/// A value and, if its source says so, of which message it is (D2).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct StampedValue<V> {
    /// The value.
    pub value: V,
    /// The timestamp of the message that it is of, as the reply says; never copied from the request.
    pub of: Option<u64>,
}

impl Lineage {
    /// Of message `seq` of the sensor `stream`, captured at this instant.
    #[must_use]
    pub fn new(stream: impl Into<Arc<str>>, seq: u64, captured: impl Into<Instant>) -> Self {
        let origin = Origin { stream: stream.into(), seq: Some(seq) };
        Self { origin: Some(origin), captured: Some(captured.into()), ..Self::default() }
    }

    /// The same with an end-to-end deadline, counted from the capture.
    #[must_use]
    pub fn within(mut self, deadline: Duration) -> Self {
        self.within = Some(deadline);
        self
    }

    /// The time since the capture, if that is known; 0 if it is still to come.
    #[must_use]
    pub fn age(&self, now: impl Into<Instant>) -> Option<Duration> {
        Some(now.into().saturating_duration_since(self.captured?))
    }

    /// The keys of the `open`, whose instant is `now`. What counts from that instant is written as if it counted from the capture.
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

impl<V> From<V> for StampedValue<V> {
    fn from(value: V) -> Self {
        Self { value, of: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// J2 counts from the capture what an operator that doubts ages counts from the intake.
    #[test]
    fn a_deadline_that_counts_from_the_intake_is_written_with_the_age() {
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
