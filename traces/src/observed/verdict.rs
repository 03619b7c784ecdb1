//! The observed judge's verdict on one trace.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::doubt::{self, Doubt, DoubtKind};
use crate::judge::ViolationPlace;
use crate::rule::Rule;

/// The verdict on one trace.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Verdict {
    /// The name that the trace was given.
    pub file: String,
    /// `true` if each timestamp has an explanation and every doubt is accepted.
    pub conforms: bool,
    /// The number of judged timestamps: those that were opened and have a result, a failure, an emit or a
    /// miss.
    pub judged: u64,
    /// The number of lines in the trace, with the header.
    pub lines: u64,
    /// The doubts that are left.
    pub doubts: Vec<Doubt>,
    /// The cause that explains most violations, if one cause does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// The violations, up to 100.
    pub violations: Vec<Violation>,
    /// The number of further violations.
    #[serde(skip_serializing_if = "is_zero")]
    pub more: u64,
    /// The places of the further violations, if they were wanted; see
    /// [`Judge::with_places`](super::Judge::with_places).
    #[serde(skip)]
    pub places: Vec<ViolationPlace<BrokenRule>>,
}

/// A timestamp that has no explanation, or a gap between opens.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Violation {
    /// The line of the output. If there is none, it is the timestamp's last line.
    pub line: u64,
    /// The timestamp. For a gap it is the timestamp opened after it, or the one before the end; `None` if
    /// none was opened.
    pub t: Option<u64>,
    /// The rule or promise that is broken.
    pub rule: BrokenRule,
    /// A description of the outputs that were found.
    pub found: String,
    /// A description of the outputs that the rules allow, and of when they may be recorded.
    pub expected: String,
    /// The time by which the output is too late, in ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late: Option<u64>,
    /// The last lines about the timestamp, with their numbers.
    #[serde(skip)]
    pub story: Vec<String>,
}

/// A rule or promise of SPEC.md that an observed trace can break.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum BrokenRule {
    /// A rule that the strict judge also reports.
    Rule(Rule),
    /// Never late.
    P2,
    /// Best available.
    P3,
    /// Prompt.
    P4,
    /// Local floor.
    P5,
    /// Free without cloud.
    P6,
    /// No stall.
    P7,
    /// Bounded.
    P9,
    /// No gap between opens.
    J1,
    /// In time for the message.
    J2,
}

impl Verdict {
    /// Accepts these kinds of doubt.
    #[must_use]
    pub fn accepting(mut self, kinds: &[DoubtKind]) -> Self {
        self.conforms =
            doubt::accept(&mut self.doubts, kinds) && self.violations.is_empty() && self.more == 0;
        self
    }

    /// Describes the verdict in a few words, such as *conforms*.
    #[must_use]
    pub fn in_short(&self) -> String {
        doubt::in_short(self.violations.len() as u64 + self.more, &self.doubts)
    }
}

impl BrokenRule {
    /// Returns the identifier in SPEC.md.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::Rule(rule) => rule.id(),
            Self::P2 => "P2",
            Self::P3 => "P3",
            Self::P4 => "P4",
            Self::P5 => "P5",
            Self::P6 => "P6",
            Self::P7 => "P7",
            Self::P9 => "P9",
            Self::J1 => "J1",
            Self::J2 => "J2",
        }
    }

    /// Returns the rule or promise as a sentence.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        match self {
            Self::Rule(rule) => rule.sentence(),
            Self::P2 => "A forwarded result arrived before its due instant, if it had one.",
            Self::P3 => {
                "A forwarded result outranks every other available result for its timestamp; under \
                 progressive the last one outranks every other that came in time."
            }
            Self::P4 => {
                "While anything is held, something pending outranks all of it; under progressive \
                 each better result is forwarded the moment it arrives."
            }
            Self::P5 => {
                "Once local's result was accepted, its timestamp is forwarded, at once or by the \
                 latest due instant ever armed for it; under progressive at once."
            }
            Self::P6 => {
                "With no request admitted for its timestamp, local's accepted result is forwarded \
                 the moment it arrives."
            }
            Self::P7 => {
                "An open timestamp waits for local or has an armed timer. One opened with a deadline \
                 is retired by the latest due instant ever armed for it."
            }
            Self::P9 => "At most `window` timestamps are open.",
            Self::J1 => {
                "Two opens, one after the other in time, are at most a period, the lateness and twice \
                 the tolerance apart, and so are the last one and the end of the trace."
            }
            Self::J2 => {
                "A message opened with a deadline of its own has its output by then, the lateness \
                 and twice the tolerance aside."
            }
        }
    }
}

impl fmt::Display for BrokenRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.id())
    }
}

impl Serialize for BrokenRule {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id())
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
const fn is_zero(number: &u64) -> bool {
    *number == 0
}
