//! The counts of one registration of side requests, with their metrics (D11).

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use metrics::{Counter, counter};

/// Counts of side requests since the operator's start.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SideTally {
    /// The name of the side request.
    pub name: String,
    /// The requests that the gate admitted.
    pub requested: u64,
    /// The requests that the gate refused, or whose deadline was zero.
    pub refused: u64,
    /// The answers that came in time and that the response handler accepted.
    pub answered: u64,
    /// The calls and response handlers that failed.
    pub failed: u64,
    /// The requests that were due before an answer came.
    pub expired: u64,
    /// The failures of its message handler.
    pub handler_failed: u64,
    /// The bytes that its calls report as sent.
    pub sent_bytes: u64,
}

/// The counts of side requests, which may be read from anywhere.
pub(crate) struct SideCounts {
    pub(crate) name: String,
    /// The requests that wait for a permit.
    waiting: AtomicU64,
    pub(crate) requested: Count,
    pub(crate) refused: Count,
    pub(crate) answered: Count,
    pub(crate) failed: Count,
    pub(crate) expired: Count,
    pub(crate) handler_failed: Count,
    sent_bytes: Count,
}

pub(crate) struct Count(AtomicU64, Counter);

/// Counts a request as waiting until it is dropped.
pub(crate) struct WaitingGuard(Arc<SideCounts>);

impl SideCounts {
    pub(crate) fn new(operator: &str, name: String) -> Self {
        let labels = [("operator", operator.to_owned()), ("side", name.clone())];
        let by = |outcome: &str| {
            let [operator, side] = labels.clone();
            let labels = [operator, side, ("outcome", outcome.to_owned())];
            Count(AtomicU64::new(0), counter!("fuseline_side_requests_total", &labels))
        };
        let of_handler = [
            ("operator", operator.to_owned()),
            ("source", name.clone()),
            ("handler", "message".to_owned()),
        ];
        Self {
            waiting: AtomicU64::new(0),
            requested: by("requested"),
            refused: by("refused"),
            answered: by("answered"),
            failed: by("failed"),
            expired: by("expired"),
            handler_failed: Count(
                AtomicU64::new(0),
                counter!("fuseline_handler_failures_total", &of_handler),
            ),
            sent_bytes: Count(
                AtomicU64::new(0),
                counter!("fuseline_side_sent_bytes_total", &labels),
            ),
            name,
        }
    }

    /// Returns the number of requests that wait for a permit.
    pub(crate) fn waiting(&self) -> u64 {
        self.waiting.load(Ordering::Relaxed)
    }

    pub(crate) fn sent(&self, bytes: u64) {
        self.sent_bytes.add(bytes);
    }

    pub(crate) fn tally(&self) -> SideTally {
        SideTally {
            name: self.name.clone(),
            requested: self.requested.read(),
            refused: self.refused.read(),
            answered: self.answered.read(),
            failed: self.failed.read(),
            expired: self.expired.read(),
            handler_failed: self.handler_failed.read(),
            sent_bytes: self.sent_bytes.read(),
        }
    }
}

impl fmt::Debug for SideCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tally().fmt(f)
    }
}

impl Count {
    pub(crate) fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
        self.1.increment(count);
    }

    fn read(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl WaitingGuard {
    pub(crate) fn new(counts: &Arc<SideCounts>) -> Self {
        counts.waiting.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(counts))
    }
}

impl Drop for WaitingGuard {
    fn drop(&mut self) {
        self.0.waiting.fetch_sub(1, Ordering::Relaxed);
    }
}
