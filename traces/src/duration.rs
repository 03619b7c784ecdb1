//! Conversion to nanoseconds, the unit of a trace.

use std::time::Duration;

/// Returns a duration in nanoseconds. It saturates at 2⁶⁴ − 1 ns, which is 584 years, as due
/// instants do (A14).
#[must_use]
pub fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
