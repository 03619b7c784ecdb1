//! The reasons why a policy cannot be made.

use core::error::Error;
use core::fmt::{self, Display, Formatter};

use crate::figure::Figure;
use crate::parameters::Classes;

/// The reason why a policy with these figures is refused. Every figure is checked when the policy
/// is made; nothing is refused later.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Invalid {
    /// The least value is above the greatest.
    Order(Figure),
    /// The figure, or an end of its span, is NaN or outside its
    /// [plausible range](Figure::plausible).
    Implausible {
        /// The figure.
        figure: Figure,
        /// The value that was given, in the figure's [unit](Figure::unit).
        value: f64,
    },
    /// The planner needs no frame; it must need at least one.
    NoFrames,
    /// This number of classes of hazards was given; there must be at least one and at most
    /// [`Classes::MOST`].
    Classes(usize),
    /// The cloud sees some class from less far away than local does. Its result in time would hide
    /// a hazard that local reports, so no deadline is safe.
    CloudSeesLess,
    /// The calls that are remembered need not include a probe; see
    /// [`Expected::new`](crate::Expected::new).
    Probes {
        /// One message in this many was to be a probe.
        every: u32,
        /// The number of calls that are remembered.
        window: usize,
    },
}

impl Display for Invalid {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Order(figure) => write!(f, "{figure}: the least value is above the greatest"),
            Self::Implausible { figure, value } => {
                let ((low, high), unit) = (figure.plausible(), figure.unit());
                let space = if unit.is_empty() { "" } else { " " };
                write!(
                    f,
                    "{figure}: {value}{space}{unit}; it must be from {low} to {high}{space}{unit}"
                )
            }
            Self::NoFrames => f.write_str("0 frames to brake; the planner needs at least 1"),
            Self::Classes(classes) => {
                write!(f, "{classes} classes of hazards; there must be 1 to {}", Classes::MOST)
            }
            Self::CloudSeesLess => f.write_str(
                "the cloud's range is shorter than local's: a result in time would hide what local \
                 reports, so no deadline is safe",
            ),
            Self::Probes { every, window } => {
                write!(
                    f,
                    "a probe every {every} messages; one must come every 1 to {window} messages"
                )
            }
        }
    }
}

impl Error for Invalid {}
