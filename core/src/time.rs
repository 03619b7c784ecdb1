//! Instants, deadlines, and the logical counter of messages.

/// A reading of one monotonic clock, in nanoseconds from any fixed start.
///
/// All of `u64` is allowed. At the end of the range nothing wraps: due instants saturate, and a clock that has
/// reached [`Instant::END`] stays there (A14).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Instant(u64);

impl Instant {
    /// The clock's first reading, 0 ns.
    pub const START: Self = Self(0);
    /// The clock's last reading, 2⁶⁴ − 1 ns.
    pub const END: Self = Self(u64::MAX);

    /// The instant `nanos` nanoseconds after [`Instant::START`].
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since [`Instant::START`].
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// The due instant of a deadline that starts now, saturating at [`Instant::END`].
    #[must_use]
    pub const fn saturating_add(self, deadline: Deadline) -> Self {
        Self(self.0.saturating_add(deadline.0))
    }

    /// The due instant of a deadline that starts now; none if it is not after now (A11).
    #[must_use]
    pub const fn due(self, deadline: Deadline) -> Option<Self> {
        let due = self.saturating_add(deadline);
        if due.0 > self.0 { Some(due) } else { None }
    }
}

/// The relative time that a request, or the local computation, may take, in nanoseconds.
///
/// All of `u64` is allowed; zero is refused wherever a deadline is given (A11).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deadline(u64);

impl Deadline {
    /// A deadline of `nanos` nanoseconds.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// A deadline of `millis` milliseconds, saturating at 2⁶⁴ − 1 ns (584 years).
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// The deadline in nanoseconds.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }
}

impl From<core::time::Duration> for Deadline {
    /// Saturates at 2⁶⁴ − 1 ns.
    fn from(duration: core::time::Duration) -> Self {
        Self(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX))
    }
}

/// An operator's logical counter of its input messages; not a time of day.
///
/// All of `u64` is allowed, gaps too; timestamps are opened in ascending order (F1).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timestamp(u64);

impl Timestamp {
    /// The timestamp with this count.
    #[must_use]
    pub const fn new(count: u64) -> Self {
        Self(count)
    }

    /// The count.
    #[must_use]
    pub const fn as_u64(self) -> u64 {
        self.0
    }
}
