//! Figures that may not be known exactly.

use core::time::Duration;

use crate::units::Quantity;

/// A range that contains a figure.
///
/// A span whose ends are out of order is refused where it is used.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Span<T> {
    /// The least value that the figure may have.
    pub least: T,
    /// The greatest value that the figure may have.
    pub greatest: T,
}

impl<T> Span<T> {
    /// Creates the span from `least` to `greatest`, both included.
    #[must_use]
    pub const fn new(least: T, greatest: T) -> Self {
        Self { least, greatest }
    }

    /// Creates the span of a figure that is known exactly.
    #[must_use]
    pub const fn exactly(figure: T) -> Self
    where
        T: Copy,
    {
        Self::new(figure, figure)
    }

    /// Changes both ends in the same way.
    #[must_use]
    pub fn map<U>(self, mut change: impl FnMut(T) -> U) -> Span<U> {
        Span::new(change(self.least), change(self.greatest))
    }

    /// Returns the span of the numbers without their unit.
    pub(crate) fn numbers(self) -> Span<f64>
    where
        T: Quantity,
    {
        self.map(T::number)
    }
}

impl Span<Duration> {
    /// Returns the time between two frames at `rate`, in Hz. The result is a span of at most one
    /// nanosecond, because 1/`rate` need not be a whole number of nanoseconds.
    ///
    /// A `rate` that makes no sense gives a time that is refused where it is used.
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
