//! Instants, deadlines, and timestamps.

/// A reading of one monotonic clock, in nanoseconds from any fixed start.
///
/// Every `u64` is a legal value. Nothing wraps at the end of the range: due instants saturate, and
/// a clock that has reached [`Instant::END`] stays there (A14).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Instant(u64);

impl Instant {
    /// The clock's first reading, 0 ns.
    pub const START: Self = Self(0);
    /// The clock's last reading, 2⁶⁴ − 1 ns.
    pub const END: Self = Self(u64::MAX);

    /// Returns the instant `nanos` nanoseconds after [`Instant::START`].
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Returns the nanoseconds since [`Instant::START`].
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Returns the due instant of a deadline that starts at this instant. It saturates at
    /// [`Instant::END`].
    #[must_use]
    pub const fn saturating_add(self, deadline: Deadline) -> Self {
        Self(self.0.saturating_add(deadline.0))
    }

    /// Returns the due instant of a deadline that starts at this instant, or `None` if the due
    /// instant is not later than this instant (A11).
    #[must_use]
    pub const fn due(self, deadline: Deadline) -> Option<Self> {
        let due = self.saturating_add(deadline);
        if due.0 > self.0 { Some(due) } else { None }
    }
}

/// The time that a request, or local, may take, in nanoseconds.
///
/// Every `u64` is a legal value, but zero is refused wherever a deadline is given (A11).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deadline(u64);

impl Deadline {
    /// Creates a deadline of `nanos` nanoseconds.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Creates a deadline of `millis` milliseconds. It saturates at 2⁶⁴ − 1 ns (584 years).
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// Returns the deadline in nanoseconds.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }
}

impl From<core::time::Duration> for Deadline {
    /// Converts a duration, saturating at 2⁶⁴ − 1 ns.
    fn from(duration: core::time::Duration) -> Self {
        Self(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX))
    }
}

/// Counts the messages of an operator. It is not a time of day.
///
/// Every `u64` is a legal value. Timestamps must be opened in ascending order and may have gaps
/// (F1).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timestamp(u64);

impl Timestamp {
    /// Creates the timestamp with this count.
    #[must_use]
    pub const fn new(count: u64) -> Self {
        Self(count)
    }

    /// Returns the count.
    #[must_use]
    pub const fn as_u64(self) -> u64 {
        self.0
    }
}
