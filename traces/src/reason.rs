//! The reasons for refusals and drops. Each kind has a table with the word of a trace and a
//! sentence.

use std::fmt;

/// The reason why an open was refused (F1).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum OpenRefusal {
    /// This timestamp or a later one was opened before.
    Order,
    /// The window is full.
    Full,
    /// Local's due instant would not be later than now.
    Deadline,
}

/// The reason why an offer was refused (F2).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum OfferRefusal {
    /// No cloud has this priority, or the timestamp is beyond all that were opened.
    Unknown,
    /// The timestamp is not open.
    Closed,
    /// This cloud was already requested for this timestamp.
    Duplicate,
    /// A better result is held or, under progressive, was sent last.
    Outranked,
    /// The due instant would not be later than now.
    Deadline,
    /// The gate is shut.
    Queue,
}

/// The reason why a result or a failure was dropped (F3, F4).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum DropReason {
    /// No source has this priority, or the timestamp is beyond all that were opened.
    Unknown,
    /// The timestamp is not open or, under progressive, a better result was sent.
    Superseded,
    /// The source was never requested for this timestamp.
    Unsolicited,
    /// The source's result is already held or, under progressive, was sent last.
    Duplicate,
    /// The request was closed by its timer or a failure.
    Late,
}

/// The word in a trace, and a sentence for readers who do not know the rules yet.
type ReasonText = (&'static str, &'static str);

impl OpenRefusal {
    /// All reasons, in the order in which they are checked (F1).
    pub const ALL: [Self; 3] = [Self::Order, Self::Full, Self::Deadline];

    const fn text(self) -> ReasonText {
        match self {
            Self::Order => ("order", "it or a later one was opened before"),
            Self::Full => ("full", "as many are open as the window holds"),
            Self::Deadline => ("deadline", "local would be due at once"),
        }
    }
}

impl OfferRefusal {
    /// All reasons, in the order in which they are checked (F2).
    pub const ALL: [Self; 6] = [
        Self::Unknown,
        Self::Closed,
        Self::Duplicate,
        Self::Outranked,
        Self::Deadline,
        Self::Queue,
    ];

    const fn text(self) -> ReasonText {
        match self {
            Self::Unknown => ("unknown", "no such cloud, or no such message so far"),
            Self::Closed => ("closed", "that message is over"),
            Self::Duplicate => ("duplicate", "this cloud was asked before"),
            Self::Outranked => ("outranked", "something better is available"),
            Self::Deadline => ("deadline", "it would be due at once"),
            Self::Queue => ("queue", "too many requests are queued"),
        }
    }
}

impl DropReason {
    /// All reasons, in the order in which they are checked (F3).
    pub const ALL: [Self; 5] =
        [Self::Unknown, Self::Superseded, Self::Unsolicited, Self::Duplicate, Self::Late];

    const fn text(self) -> ReasonText {
        match self {
            Self::Unknown => ("unknown", "no such source, or no such message so far"),
            Self::Superseded => ("superseded", "that message is over"),
            Self::Unsolicited => ("unsolicited", "this cloud was never asked"),
            Self::Duplicate => ("duplicate", "its result is available already"),
            Self::Late => ("late", "its timer fired, or it failed before"),
        }
    }
}

/// Implements what the three kinds have in common.
macro_rules! reason {
    ($kind:ident) => {
        impl $kind {
            /// Returns the word that a trace uses.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                self.text().0
            }

            /// Returns the meaning of the word, to be put after a colon.
            #[must_use]
            pub const fn sentence(self) -> &'static str {
                self.text().1
            }

            /// Returns the reason's index in [`ALL`](Self::ALL).
            #[must_use]
            pub const fn index(self) -> usize {
                self as usize
            }
        }

        impl fmt::Display for $kind {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.as_str())
            }
        }
    };
}

reason!(OpenRefusal);
reason!(OfferRefusal);
reason!(DropReason);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_stands_at_its_place() {
        for (place, why) in OpenRefusal::ALL.into_iter().enumerate() {
            assert_eq!(why.index(), place);
        }
        for (place, why) in OfferRefusal::ALL.into_iter().enumerate() {
            assert_eq!(why.index(), place);
        }
        for (place, why) in DropReason::ALL.into_iter().enumerate() {
            assert_eq!(why.index(), place);
        }
    }
}
