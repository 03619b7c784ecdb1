//! Times as parameters: seconds.

use std::time::Duration;

use crate::parameters::Value;
use crate::settings::parameter::Range;

/// The words for a time that is expected.
pub(super) const SECONDS: &str = "seconds, more than 0 and at most 1e9";
/// The words for a time that is expected and may be left to another parameter.
pub(super) const OWN_SECONDS: &str = "seconds, at most 1e9, or 0 for deadline";

/// Their bounds.
pub(super) const MOST_SECONDS: Range = Range::Double(0.0, 1e9);

/// A valid deadline: more than 0 when rounded to nanoseconds, at most 10⁹ seconds.
#[must_use]
pub fn seconds(seconds: f64) -> Option<Duration> {
    let time = Duration::try_from_secs_f64(seconds).ok()?;
    (time > Duration::ZERO && time <= Duration::from_secs(1_000_000_000)).then_some(time)
}

/// A number of seconds as a time.
pub(super) fn seconds_of(value: &Value) -> Option<Duration> {
    value.number().and_then(seconds)
}

/// A number of seconds as a time; zero is allowed.
pub(super) fn own_seconds(value: &Value) -> Option<Duration> {
    match value.number()? {
        0.0 => Some(Duration::ZERO),
        number => seconds(number),
    }
}

/// A cloud's own deadline; zero means `deadline`.
pub(super) fn none_if_zero(time: Duration) -> Option<Duration> {
    Some(time).filter(|time| !time.is_zero())
}
