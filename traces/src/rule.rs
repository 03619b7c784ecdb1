//! The rules that a decision can break, with a sentence for each.

use std::fmt;

use serde::{Serialize, Serializer};

/// A rule or promise of SPEC.md.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Rule {
    /// F0, time: due timers fire before the input, and the clock never goes back.
    F0,
    /// F1, open: accepts or refuses a message.
    F1,
    /// F2, offer: admits or refuses a request.
    F2,
    /// F2g, gate: admits requests by the length of a cloud's queue.
    F2g,
    /// F3, result: forwards, holds or drops a result.
    F3,
    /// F4, fail: closes the request of a source that has no result.
    F4,
    /// F5, expire: fires timers at their due instants.
    F5,
    /// F6, settle: forwards, misses or waits after a failure or a timer.
    F6,
    /// F7, forward: retires a timestamp, and cancels its pending clouds.
    F7,
    /// F9, progressive: forwards each better result at once.
    F9,
    /// P1, once: a timestamp is not forwarded twice, nor both forwarded and missed.
    P1,
    /// D2, its own value: a value was computed from its message, or from one within `max_age`.
    D2,
    /// D18, meant for its message: a value is meant for the timestamp that it is sent for.
    D18,
    /// P2, never late: a forwarded result arrived before its due instant.
    P2,
    /// P3, best available: a forwarded result outranks every other available one.
    P3,
    /// P4, prompt: a result is held only while a better source is pending.
    P4,
    /// P5, local floor: local's accepted result has its timestamp forwarded by the latest due
    /// instant.
    P5,
    /// P6, free without cloud: without a request, local's result is forwarded at once.
    P6,
    /// P7, no stall: an open timestamp waits for local or for a timer.
    P7,
    /// P9, bounded: no more timestamps are open than the window allows.
    P9,
    /// J1, no gap: opens follow each other within the period.
    J1,
    /// J2, in time: a message has its output by its own deadline.
    J2,
}

impl Rule {
    /// All rules that a violation of a strict trace can name. Violations of an observed trace can
    /// name the other rules too.
    pub const ALL: [Self; 13] = [
        Self::F0,
        Self::F1,
        Self::F2,
        Self::F2g,
        Self::F3,
        Self::F4,
        Self::F5,
        Self::F6,
        Self::F7,
        Self::F9,
        Self::P1,
        Self::D2,
        Self::D18,
    ];

    /// The rules that concern an input and its decisions, whatever values come with them.
    pub const OF_DECISIONS: [Self; 11] = match Self::ALL.first_chunk() {
        Some(rules) => *rules,
        None => unreachable!(),
    };

    /// Returns the identifier in SPEC.md.
    #[must_use]
    pub const fn id(self) -> &'static str {
        match self {
            Self::F0 => "F0",
            Self::F1 => "F1",
            Self::F2 => "F2",
            Self::F2g => "F2g",
            Self::F3 => "F3",
            Self::F4 => "F4",
            Self::F5 => "F5",
            Self::F6 => "F6",
            Self::F7 => "F7",
            Self::F9 => "F9",
            Self::P1 => "P1",
            Self::D2 => "D2",
            Self::D18 => "D18",
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

    /// Returns the rule in [`ALL`](Self::ALL) with this identifier, or `None`.
    #[must_use]
    pub fn named(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rule| rule.id() == id)
    }

    /// Returns the rule as a sentence.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        match self {
            Self::F0 => {
                "A decision has the now of its input; a now below the greatest seen counts as the \
                 greatest seen."
            }
            Self::F1 => {
                "An open is refused for the first of order, full and deadline that holds; else \
                 its timestamp is open."
            }
            Self::F2 => {
                "An offer is refused for the first of unknown, closed, duplicate, outranked, \
                 deadline and queue that holds; else it is admitted, due at now + deadline."
            }
            Self::F2g => {
                "An open gate shuts when backlog ≥ limit, a shut one opens when backlog ≤ \
                 resume; the state after that decides."
            }
            Self::F3 => {
                "A result is dropped for the first of unknown, superseded, unsolicited, \
                 duplicate and late that holds; else held while something pending outranks it; \
                 else forwarded."
            }
            Self::F4 => {
                "A failure is dropped for the same reasons as a result; else it closes its request \
                 and disarms its timer, and no result of it is held."
            }
            Self::F5 => {
                "Before an input everything due fires, by due instant, then timestamp; the due \
                 instant itself is past; a live timer fires once and not earlier, any other \
                 never."
            }
            Self::F6 => {
                "After a failure or a timer the best available result is forwarded if nothing \
                 pending outranks it, or, under eager, if a cloud's timer fired; with nothing \
                 available and nothing pending the timestamp is missed."
            }
            Self::F7 => {
                "What is forwarded retires its timestamp, and each cloud still pending is \
                 cancelled, by ascending priority."
            }
            Self::F9 => {
                "Under progressive a result that nothing sent before outranks is forwarded at \
                 once and cancels what it outranks; with nothing better pending its timestamp is \
                 final."
            }
            Self::P1 => {
                "No timestamp is forwarded twice, nor forwarded and missed; under progressive \
                 its outputs rise, and nothing follows the final one."
            }
            Self::D2 => {
                "An item carries the value that its source sent for this timestamp, or for one \
                 that is at most the cloud's max_age before it."
            }
            Self::D18 => {
                "An item carries a value that is meant for its timestamp, if the value says for \
                 which one it is meant."
            }
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

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.id())
    }
}

impl Serialize for Rule {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id())
    }
}
