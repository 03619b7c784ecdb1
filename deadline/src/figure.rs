//! The figures that a policy is made of, and what each may plausibly be.

use core::fmt::{self, Display, Formatter};

use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::Quantity;

/// A figure that a policy is made of.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Figure {
    /// Deceleration.
    Deceleration,
    /// Delay of the brakes.
    BrakeDelay,
    /// Time between frames that local takes.
    PeriodLocal,
    /// Time between frames that the cloud takes.
    PeriodCloud,
    /// Local's response.
    LocalResponse,
    /// Lateness of an output.
    Lateness,
    /// Margin.
    Margin,
    /// Weight of a class of hazards.
    Weight,
    /// Distance from which local reports.
    RangeLocal,
    /// Distance from which the cloud reports.
    RangeCloud,
    /// Speed of the vehicle.
    Speed,
    /// Distance to the nearest place behind which something may be.
    Reveal,
    /// Local's accuracy.
    AccuracyLocal,
    /// The cloud's accuracy.
    AccuracyCloud,
    /// What a millisecond of waiting costs.
    Price,
    /// By how much a detector's right boxes overlap (`IoU`).
    Overlap,
}

impl Figure {
    /// What it may be, both ends included: wide enough for any vehicle on wheels or legs, and narrow enough to find
    /// milliseconds that were given as seconds, or millimetres as metres. In the unit that [`unit`](Self::unit) names.
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

    /// Its unit; empty if it has none.
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

    /// Refuses what is not plausible.
    pub(crate) fn check(self, span: Span<impl Quantity>) -> Result<(), Invalid> {
        let span = span.numbers();
        let (low, high) = self.plausible();
        for value in [span.least, span.greatest] {
            // What is not a number is in no range.
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
            Self::Reveal => "distance of what may come into sight",
            Self::AccuracyLocal => "local's accuracy",
            Self::AccuracyCloud => "the cloud's accuracy",
            Self::Price => "price of a millisecond",
            Self::Overlap => "overlap of right boxes",
        })
    }
}
