//! Seconds in options.

use std::ops::RangeInclusive;
use std::time::Duration;

/// Reads seconds with a fraction, if they are within `allowed`.
pub(crate) fn seconds(text: &str, allowed: RangeInclusive<f64>) -> Option<Duration> {
    let seconds = text.parse().ok().filter(|seconds| allowed.contains(seconds))?;
    Duration::try_from_secs_f64(seconds).ok()
}
