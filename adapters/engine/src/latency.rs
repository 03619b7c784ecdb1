//! How long operators take, for the reserve of those upstream (E3).

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How long an operator takes for a message: stated, or measured while it runs. Clones share the measurements.
///
/// The operator records its messages in it; the operators upstream keep so much of an end-to-end deadline in reserve.
#[derive(Clone, Debug)]
pub struct Latency(LatencyKind);

#[derive(Clone, Debug)]
enum LatencyKind {
    Stated(Duration),
    Measured { percent: u8, at_first: Duration, last: Arc<Mutex<LastLatencies>> },
}

/// The last [`REMEMBERED`] times, in order and sorted.
#[derive(Debug, Default)]
struct LastLatencies {
    in_order: VecDeque<Duration>,
    sorted: Vec<Duration>,
}

/// How many times are remembered.
const REMEMBERED: usize = 256;
/// From how many on they are used.
const ENOUGH: usize = 16;

impl Latency {
    /// Always so much.
    #[must_use]
    pub const fn stated(latency: Duration) -> Self {
        Self(LatencyKind::Stated(latency))
    }

    /// This percentile, of 1 to 100, of the last 256 messages; `at_first` until 16 were recorded.
    #[must_use]
    pub fn measured(percent: u8, at_first: Duration) -> Self {
        Self(LatencyKind::Measured { percent, at_first, last: Arc::default() })
    }

    /// A message took so long. Does nothing if the latency is stated.
    pub fn record(&self, took: Duration) {
        if let LatencyKind::Measured { last, .. } = &self.0 {
            last.lock().unwrap_or_else(PoisonError::into_inner).push(took);
        }
    }

    /// The latency now.
    #[must_use]
    pub fn estimate(&self) -> Duration {
        match &self.0 {
            LatencyKind::Stated(latency) => *latency,
            LatencyKind::Measured { percent, at_first, last } => {
                let last = last.lock().unwrap_or_else(PoisonError::into_inner);
                last.percentile((*percent).into()).unwrap_or(*at_first)
            }
        }
    }
}

/// Measurements are equal if they are shared.
impl PartialEq for Latency {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (LatencyKind::Stated(one), LatencyKind::Stated(other)) => one == other,
            (
                LatencyKind::Measured { last: one, .. },
                LatencyKind::Measured { last: other, .. },
            ) => Arc::ptr_eq(one, other),
            (LatencyKind::Stated(_), LatencyKind::Measured { .. })
            | (LatencyKind::Measured { .. }, LatencyKind::Stated(_)) => false,
        }
    }
}

impl LastLatencies {
    fn push(&mut self, took: Duration) {
        if self.in_order.len() == REMEMBERED
            && let Some(oldest) = self.in_order.pop_front()
            && let Ok(index) = self.sorted.binary_search(&oldest)
        {
            self.sorted.remove(index);
        }
        self.in_order.push_back(took);
        let index = self.sorted.partition_point(|other| *other < took);
        self.sorted.insert(index, took);
    }

    fn percentile(&self, percent: usize) -> Option<Duration> {
        if self.sorted.len() < ENOUGH {
            return None;
        }
        let count = (self.sorted.len() * percent).div_ceil(100);
        self.sorted.get(count.clamp(1, self.sorted.len()) - 1).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_percentile_of_the_last_messages_is_used_once_there_are_enough() {
        let latency = Latency::measured(90, 70 * MS);
        let operator = latency.clone();
        (1..16).for_each(|ms| operator.record(ms * MS));
        assert_eq!(latency.estimate(), 70 * MS);
        (16..=20).for_each(|ms| operator.record(ms * MS));
        assert_eq!(latency.estimate(), 18 * MS);
        // E8: what is older is forgotten.
        (0..256).for_each(|_| operator.record(5 * MS));
        assert_eq!(latency.estimate(), 5 * MS);
    }

    #[test]
    fn any_number_is_a_percentile() {
        for percent in [0, 100, 255] {
            let latency = Latency::measured(percent, MS);
            (0..16).for_each(|_| latency.record(3 * MS));
            assert_eq!(latency.estimate(), 3 * MS);
        }
    }

    #[test]
    fn a_stated_latency_stays_as_it_is() {
        let latency = Latency::stated(MS);
        latency.record(9 * MS);
        assert_eq!(latency.estimate(), MS);
    }
}
