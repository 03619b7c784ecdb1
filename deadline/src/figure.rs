//! The figures of a policy and the plausible range of each.

use core::fmt::{self, Display, Formatter};

use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::Quantity;

/// A figure from which a policy is made. [`unit`](Self::unit) names its unit, and
/// [`plausible`](Self::plausible) its range.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Figure {
    /// The vehicle's deceleration.
    Deceleration,
    /// The delay of the brakes.
    BrakeDelay,
    /// The time between two frames that local processes.
    PeriodLocal,
    /// The time between two frames that the cloud processes.
    PeriodCloud,
    /// Local's response.
    LocalResponse,
    /// The lateness of an output.
    Lateness,
    /// The distance to keep from an obstacle where local alone stops anyway.
    Margin,
    /// The weight of a class of hazards.
    Weight,
    /// The distance from which local reports.
    RangeLocal,
    /// The distance from which the cloud reports.
    RangeCloud,
    /// The vehicle's speed.
    Speed,
    /// The distance to the nearest place that may hide something.
    Reveal,
    /// Local's accuracy.
    AccuracyLocal,
    /// The cloud's accuracy.
    AccuracyCloud,
    /// The cost of a millisecond of waiting.
    Price,
    /// The mean overlap of a detector's right boxes (`IoU`).
    Overlap,
}

impl Figure {
    /// Returns the least and the greatest plausible value, both included, in the unit that
    /// [`unit`](Self::unit) names.
    ///
    /// The range fits any vehicle on wheels or legs, and it excludes milliseconds given as seconds
    /// and millimetres given as metres.
    #[must_use]
    pub const fn plausible(self) -> (f64, f64) {
        match self {
            Self::Deceleration => (0.1, 20.0),
            Self::BrakeDelay => (0.0, 5.0),
            Self::PeriodLocal | Self::PeriodCloud => (1e-5, 60.0),
            Self::LocalResponse => (1e-6, 60.0),
            Self::Lateness => (0.0, 1.0),
            Self::Margin => (0.0, 100.0),
            Self::Weight => (1e-6, 1e6),
            Self::Price => (0.0, 1e6),
            Self::RangeLocal | Self::RangeCloud => (0.01, 10_000.0),
            Self::Speed => (0.0, 150.0),
            Self::Reveal => (0.0, f64::INFINITY),
            Self::AccuracyLocal | Self::AccuracyCloud => (-1e6, 1e6),
            Self::Overlap => (0.5, 1.0),
        }
    }

    /// Returns the unit, or an empty string if the figure has none.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Deceleration => "m/s²",
            Self::Speed => "m/s",
            Self::Margin | Self::RangeLocal | Self::RangeCloud | Self::Reveal => "m",
            Self::BrakeDelay
            | Self::PeriodLocal
            | Self::PeriodCloud
            | Self::LocalResponse
            | Self::Lateness => "s",
            Self::Weight
            | Self::AccuracyLocal
            | Self::AccuracyCloud
            | Self::Price
            | Self::Overlap => "",
        }
    }

    /// Refuses a span that is not plausible.
    pub(crate) fn check(self, span: Span<impl Quantity>) -> Result<(), Invalid> {
        let span = span.numbers();
        let (low, high) = self.plausible();
        for value in [span.least, span.greatest] {
            // NaN is in no range.
            if !(low..=high).contains(&value) {
                return Err(Invalid::Implausible { figure: self, value });
            }
        }
        if span.least <= span.greatest { Ok(()) } else { Err(Invalid::Order(self)) }
    }
}

impl Display for Figure {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Deceleration => "deceleration",
            Self::BrakeDelay => "delay of the brakes",
            Self::PeriodLocal => "time between local's frames",
            Self::PeriodCloud => "time between the cloud's frames",
            Self::LocalResponse => "local's response",
            Self::Lateness => "lateness",
            Self::Margin => "margin",
            Self::Weight => "weight of a class",
            Self::RangeLocal => "local's range",
            Self::RangeCloud => "the cloud's range",
            Self::Speed => "speed",
            Self::Reveal => "distance at which something may come into sight",
            Self::AccuracyLocal => "local's accuracy",
            Self::AccuracyCloud => "the cloud's accuracy",
            Self::Price => "price of a millisecond",
            Self::Overlap => "overlap of correct boxes",
        })
    }
}
