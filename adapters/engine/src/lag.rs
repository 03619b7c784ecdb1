//! Notices when the event loop is blocked: a timer is served late, or a handler runs for long
//! without a pause (D9).
//!
//! It counts and logs; no decision depends on it. It warns the first, second, fourth, … time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tracing::warn;

use fuseline_traces::nanos;

/// One operator's lag in ns.
pub(crate) struct Lag {
    operator: Arc<str>,
    /// The shortest lag that is counted.
    warning: u64,
    late_timers: AtomicU64,
    /// The number of times that the operator's own handlers blocked the loop.
    held_up: AtomicU64,
    greatest: AtomicU64,
}

impl Lag {
    pub(crate) fn new(operator: &str, warning: Duration) -> Self {
        Self {
            operator: operator.into(),
            warning: nanos(warning),
            late_timers: AtomicU64::new(0),
            held_up: AtomicU64::new(0),
            greatest: AtomicU64::new(0),
        }
    }

    pub(crate) const fn warning(&self) -> Duration {
        Duration::from_nanos(self.warning)
    }

    pub(crate) fn is_too_long(&self, lasted: Duration) -> bool {
        nanos(lasted) > self.warning
    }

    /// Notes the delay of a timer.
    pub(crate) fn timer(&self, lag: Duration) {
        if !self.is_too_long(lag) {
            return;
        }
        self.greatest.fetch_max(nanos(lag), Ordering::Relaxed);
        let times = self.late_timers.fetch_add(1, Ordering::Relaxed) + 1;
        if times.is_power_of_two() {
            warn!(
                operator = &*self.operator,
                ?lag,
                times,
                "the event loop was blocked, so a timer was served late"
            );
        }
    }

    /// Notes that a handler blocked its thread. `source` has the name of its source and the number
    /// of times that happened.
    pub(crate) fn held_up(&self, lasted: Duration, source: Option<(&str, u64)>) {
        self.greatest.fetch_max(nanos(lasted), Ordering::Relaxed);
        let (source, times) = source
            .unwrap_or_else(|| ("operator", self.held_up.fetch_add(1, Ordering::Relaxed) + 1));
        if times.is_power_of_two() {
            let operator = &*self.operator;
            warn!(
                operator,
                source,
                ?lasted,
                times,
                "a handler held up the event loop: encode and compute in threads"
            );
        }
    }

    pub(crate) fn late_timers(&self) -> u64 {
        self.late_timers.load(Ordering::Relaxed)
    }

    pub(crate) fn greatest(&self) -> Duration {
        Duration::from_nanos(self.greatest.load(Ordering::Relaxed))
    }
}
