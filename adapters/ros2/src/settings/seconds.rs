//! Times as parameters: seconds.

use std::time::Duration;

use crate::parameters::Value;
use crate::settings::parameter::Range;

/// The words for a time that is expected.
pub(super) const SECONDS: &str = "seconds, more than 0 and at most 1e9";
/// The parameter that bounds deadlines.
pub(super) const GREATEST_DEADLINE: &str = "greatest_deadline";

/// Their bounds.
pub(super) const MOST_SECONDS: Range = Range::Double(0.0, 1e9);

/// Returns a number of seconds as a deadline, or `None` if it is not valid: a deadline is more than 0
/// when rounded to nanoseconds, and at most 10⁹ seconds.
#[must_use]
pub fn seconds(seconds: f64) -> Option<Duration> {
    let time = Duration::try_from_secs_f64(seconds).ok()?;
    (time > Duration::ZERO && time <= Duration::from_secs(1_000_000_000)).then_some(time)
}

/// Returns a number of seconds as a time.
pub(super) fn seconds_of(value: &Value) -> Option<Duration> {
    value.number().and_then(seconds)
}

/// Returns a number of seconds as a time; zero is allowed.
pub(super) fn own_seconds(value: &Value) -> Option<Duration> {
    match value.number()? {
        0.0 => Some(Duration::ZERO),
        number => seconds(number),
    }
}

/// The greatest that a deadline may be. A longer one is a mistake, such as milliseconds, and would hold a result as long (A14).
#[derive(Clone, Copy)]
pub(super) struct DeadlineBound(pub(super) Duration);

impl DeadlineBound {
    /// Returns a value as a deadline.
    pub(super) fn deadline(self, value: &Value) -> Option<Duration> {
        seconds_of(value).filter(|deadline| *deadline <= self.0)
    }

    /// Returns a value as a deadline, or zero, which stands for another parameter's.
    pub(super) fn own_deadline(self, value: &Value) -> Option<Duration> {
        own_seconds(value).filter(|deadline| *deadline <= self.0)
    }

    /// Returns the words for a deadline that is expected.
    pub(super) fn expected(self) -> String {
        format!("seconds, more than 0 and at most {GREATEST_DEADLINE} ({})", self.0.as_secs_f64())
    }

    /// Returns the words for a cloud's own deadline that is expected.
    pub(super) fn own_expected(self) -> String {
        format!("{}, or 0 for deadline", self.expected())
    }

    /// Returns the bounds of a parameter that is a deadline.
    pub(super) fn range(self) -> Range {
        Range::Double(0.0, self.0.as_secs_f64())
    }
}

/// Returns a cloud's own deadline; zero means `deadline`.
pub(super) fn none_if_zero(time: Duration) -> Option<Duration> {
    Some(time).filter(|time| !time.is_zero())
}
