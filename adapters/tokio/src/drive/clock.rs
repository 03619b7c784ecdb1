//! The operator's clock. An event's instant is read after the event (F0). Reading the clock costs
//! as much as answering an input. So a reading is reused while only the loop's own steps have run
//! since.

use std::time::Duration;

use tokio::time::Instant;

/// Nanoseconds since the operator's start.
#[derive(Clone, Copy)]
pub(super) struct DriverClock {
    start: Instant,
}

impl DriverClock {
    /// Creates a clock that reads 0 now.
    pub(super) fn new() -> Self {
        Self { start: Instant::now() }
    }

    pub(super) fn start(self) -> std::time::Instant {
        self.start.into_std()
    }

    pub(super) fn now(self) -> u64 {
        let now = self.start.elapsed();
        // `as_nanos` would count in 128 bits.
        now.as_secs().saturating_mul(1_000_000_000).saturating_add(now.subsec_nanos().into())
    }

    /// Returns the instant at which the clock reads `nanos`, but at most a day from now, because
    /// the system's clock may end before.
    pub(super) fn instant(self, nanos: u64) -> Instant {
        let day = Duration::from_secs(24 * 60 * 60);
        let far = self.start.elapsed() + day;
        self.start + Duration::from_nanos(nanos).min(far)
    }
}
