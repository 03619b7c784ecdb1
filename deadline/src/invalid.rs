//! Why a policy cannot be made.

use core::error::Error;
use core::fmt::{self, Display, Formatter};

use crate::parameters::Classes;

/// Why there is no policy with these figures. Nothing is refused later.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Invalid {
    /// An end is infinite or not a number, or the least is above the greatest.
    Span(Figure),
    /// The figure must be above 0, even at its least.
    NotAbove0(Figure),
    /// The figure must not be below 0.
    Below0(Figure),
    /// The planner must need at least one frame.
    NoFrames,
    /// The number of classes of hazards given; there must be at least one, and at most [`Classes::MOST`].
    Classes(usize),
    /// The cloud sees some class from less far than local: its result in time would hide what local reports, so no
    /// deadline is safe.
    CloudSeesLess,
    /// The calls remembered need not include a probe; see [`Expected::new`](crate::Expected::new).
    Probes {
        /// One message in this many was to be a probe.
        every: u32,
        /// The calls that are remembered.
        window: usize,
    },
}

/// A figure that a policy is made of.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Figure {
    /// Deceleration, in m/s².
    Deceleration,
    /// Delay of the brakes, in seconds.
    BrakeDelay,
    /// Time between frames that local takes, in seconds.
    PeriodLocal,
    /// Time between frames that the cloud takes, in seconds.
    PeriodCloud,
    /// Local's response, in seconds.
    LocalResponse,
    /// Lateness of an output, in seconds.
    Lateness,
    /// Margin, in metres.
    Margin,
    /// Weight of a class of hazards.
    Weight,
    /// Distance from which local reports, in metres.
    RangeLocal,
    /// Distance from which the cloud reports, in metres.
    RangeCloud,
}

impl Display for Invalid {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Span(figure) => {
                write!(f, "{figure}: it must be finite, and its least not above its greatest")
            }
            Self::NotAbove0(figure) => write!(f, "{figure}: it must be above 0"),
            Self::Below0(figure) => write!(f, "{figure}: it must not be below 0"),
            Self::NoFrames => f.write_str("0 frames to brake; the planner needs at least one"),
            Self::Classes(classes) => {
                write!(f, "{classes} classes of hazards; there must be 1 to {}", Classes::MOST)
            }
            Self::CloudSeesLess => f.write_str(
                "the cloud sees less far than local: in time it would hide what local reports, so no deadline is safe",
            ),
            Self::Probes { every, window } => {
                write!(f, "a probe every {every} messages; it must be every 1 to {window}")
            }
        }
    }
}

impl Error for Invalid {}

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
        })
    }
}
