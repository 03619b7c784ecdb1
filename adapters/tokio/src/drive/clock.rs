//! The operator's clock. An event's instant is read after it (F0), so a reading is handed on only where nothing but the loop's
//! own steps lies between: to read the clock costs as much as to answer an input.

use std::time::Duration;

use tokio::time::Instant;

/// Nanoseconds since the operator's start.
#[derive(Clone, Copy)]
pub(super) struct DriverClock {
    start: Instant,
}

impl DriverClock {
    /// Makes a clock that reads 0 now.
    pub(super) fn new() -> Self {
        Self { start: Instant::now() }
    }

    pub(super) fn start(self) -> std::time::Instant {
        self.start.into_std()
    }

    pub(super) fn now(self) -> u64 {
        let now = self.start.elapsed();
        // In 64 bits: `as_nanos` counts in 128.
        now.as_secs().saturating_mul(1_000_000_000).saturating_add(now.subsec_nanos().into())
    }

    /// Returns the instant at which the clock reads `nanos`, but at most a day from now, because the system's clock
    /// may end before.
    pub(super) fn instant(self, nanos: u64) -> Instant {
        let day = Duration::from_secs(24 * 60 * 60);
        let far = self.start.elapsed() + day;
        self.start + Duration::from_nanos(nanos).min(far)
    }
}
