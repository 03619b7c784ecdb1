//! A figure that may not be known exactly.

use core::time::Duration;

use crate::units::Quantity;

/// A figure that is not known exactly: no less than one and no more than another.
///
/// A span whose ends are not in order is refused where it is used.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Span<T> {
    /// What the figure is at least.
    pub least: T,
    /// What the figure is at most.
    pub greatest: T,
}

impl<T> Span<T> {
    /// From `least` to `greatest`, both included.
    #[must_use]
    pub const fn new(least: T, greatest: T) -> Self {
        Self { least, greatest }
    }

    /// A figure that is known exactly.
    #[must_use]
    pub const fn exactly(figure: T) -> Self
    where
        T: Copy,
    {
        Self::new(figure, figure)
    }

    /// Both ends changed alike.
    #[must_use]
    pub fn map<U>(self, mut change: impl FnMut(T) -> U) -> Span<U> {
        Span::new(change(self.least), change(self.greatest))
    }

    /// The numbers alone.
    pub(crate) fn numbers(self) -> Span<f64>
    where
        T: Quantity,
    {
        self.map(T::number)
    }
}

impl Span<Duration> {
    /// The time between two frames at `rate`, in Hz: 1/`rate` s, which need not be a whole number of nanoseconds, so it may
    /// be a span of one. What is no rate gives a time that is refused where it is used.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "the cast rounds down and stays within the range, which is what is wanted"
    )]
    pub const fn of_rate(rate: f64) -> Self {
        let exact = 1e9 / rate;
        let least = exact as u64;
        let greatest = if (least as f64) < exact { least.saturating_add(1) } else { least };
        Self::new(Duration::from_nanos(least), Duration::from_nanos(greatest))
    }
}

impl<T: Copy> From<T> for Span<T> {
    fn from(figure: T) -> Self {
        Self::exactly(figure)
    }
}
