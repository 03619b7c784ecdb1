//! What is known of a figure.

/// A figure that is not known exactly: no less than one number and no more than another.
///
/// Both are in the unit that the figure's owner tells. Whoever takes one refuses those that are not in order.
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
