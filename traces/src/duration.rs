//! The unit of a trace.

use std::time::Duration;

/// Returns a duration in nanoseconds. One of 2⁶⁴ ns or more, which is 584 years, is 2⁶⁴ − 1 ns, as due instants are (A14).
#[must_use]
pub fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
