//! Figures that are exact or between bounds.

use serde::{Serialize, Serializer};

/// A figure, as far as it is known. It is exact if both bounds are the same.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct BoundedFigure<T> {
    /// The figure is at least this.
    pub at_least: T,
    /// The figure is at most this.
    pub at_most: T,
}

impl<T: Copy + PartialOrd> BoundedFigure<T> {
    /// Returns a figure that is known.
    #[must_use]
    pub const fn exactly(value: T) -> Self {
        Self { at_least: value, at_most: value }
    }

    /// Returns the figure that covers all these values.
    ///
    /// # Panics
    /// Panics if there are no values.
    #[must_use]
    pub fn spanning(values: impl IntoIterator<Item = T>) -> Self {
        let wider = |one: Self, other: Self| Self {
            at_least: if other.at_least < one.at_least { other.at_least } else { one.at_least },
            at_most: if other.at_most > one.at_most { other.at_most } else { one.at_most },
        };
        let figures = values.into_iter().map(Self::exactly);
        figures.reduce(wider).expect("a message has an outcome")
    }

    /// Returns the value, if it is known.
    #[must_use]
    pub fn exact(self) -> Option<T> {
        (self.at_least == self.at_most).then_some(self.at_least)
    }

    /// Maps both bounds by a function that keeps their order.
    #[must_use]
    pub fn map<U>(self, map: impl Fn(T) -> U) -> BoundedFigure<U> {
        BoundedFigure { at_least: map(self.at_least), at_most: map(self.at_most) }
    }
}

impl<T: std::ops::Add<Output = T>> BoundedFigure<T> {
    /// Returns the sum of two figures.
    #[must_use]
    #[expect(
        clippy::should_implement_trait,
        reason = "bounds add up as numbers do, and nothing else is wanted of them"
    )]
    pub fn add(self, other: Self) -> Self {
        Self { at_least: self.at_least + other.at_least, at_most: self.at_most + other.at_most }
    }
}

impl<T: Copy + PartialOrd + Serialize> Serialize for BoundedFigure<T> {
    /// Writes the number, or `{"at_least":…,"at_most":…}` if it is not known.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { at_least, at_most } = *self;
        let bounds = WrittenFigure::Bounds { at_least, at_most };
        self.exact().map_or(bounds, WrittenFigure::Exact).serialize(serializer)
    }
}

/// The form in which a figure is written.
#[derive(Serialize)]
#[serde(untagged)]
enum WrittenFigure<T> {
    Exact(T),
    Bounds { at_least: T, at_most: T },
}
