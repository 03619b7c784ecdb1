//! A figure that may not be known exactly.

/// A figure that is not known exactly: no less than one number and no more than another.
///
/// Both are in the unit given where the span is used. A span whose ends are not in order is refused there.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Span {
    /// What the figure is at least.
    pub least: f64,
    /// What the figure is at most.
    pub greatest: f64,
}

impl Span {
    /// From `least` to `greatest`, both included.
    #[must_use]
    pub const fn new(least: f64, greatest: f64) -> Self {
        Self { least, greatest }
    }

    /// A figure that is known exactly.
    #[must_use]
    pub const fn exactly(figure: f64) -> Self {
        Self::new(figure, figure)
    }

    /// Whether both ends are numbers, finite and in order.
    pub(crate) const fn is_sound(self) -> bool {
        self.least.is_finite() && self.greatest.is_finite() && self.least <= self.greatest
    }
}

impl From<f64> for Span {
    fn from(figure: f64) -> Self {
        Self::exactly(figure)
    }
}
