//! Why something was refused or dropped: one table for each kind, with the word of a trace and a sentence.

use std::fmt;

/// Why an open was refused (F1).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum OpenRefusal {
    /// This timestamp or a later one was opened before.
    Order,
    /// The window is full.
    Full,
    /// Local would be due at once.
    Deadline,
}

/// Why an offer was refused (F2).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum OfferRefusal {
    /// No such cloud, or a timestamp beyond all opened.
    Unknown,
    /// The timestamp is not open.
    Closed,
    /// Requested before.
    Duplicate,
    /// Something better is available.
    Outranked,
    /// Due at once.
    Deadline,
    /// The gate is shut.
    Queue,
}

/// Why a result or a failure was dropped (F3, F4).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum DropReason {
    /// No such source, or a timestamp beyond all opened.
    Unknown,
    /// The timestamp is not open.
    Superseded,
    /// Never requested.
    Unsolicited,
    /// Available already.
    Duplicate,
    /// Closed by its timer or a failure.
    Late,
}

/// The word in a trace, and a sentence for readers who do not know the rules yet.
type WordAndSentence = (&'static str, &'static str);

impl OpenRefusal {
    /// All reasons, in the order in which F1 checks them.
    pub const ALL: [Self; 3] = [Self::Order, Self::Full, Self::Deadline];

    const fn word_and_sentence(self) -> WordAndSentence {
        match self {
            Self::Order => ("order", "it or a later one was opened before"),
            Self::Full => ("full", "as many are open as the window holds"),
            Self::Deadline => ("deadline", "local would be due at once"),
        }
    }
}

impl OfferRefusal {
    /// All reasons, in the order in which F2 checks them.
    pub const ALL: [Self; 6] = [
        Self::Unknown,
        Self::Closed,
        Self::Duplicate,
        Self::Outranked,
        Self::Deadline,
        Self::Queue,
    ];

    const fn word_and_sentence(self) -> WordAndSentence {
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
    /// All reasons, in the order in which F3 checks them.
    pub const ALL: [Self; 5] =
        [Self::Unknown, Self::Superseded, Self::Unsolicited, Self::Duplicate, Self::Late];

    const fn word_and_sentence(self) -> WordAndSentence {
        match self {
            Self::Unknown => ("unknown", "no such source, or no such message so far"),
            Self::Superseded => ("superseded", "that message is over"),
            Self::Unsolicited => ("unsolicited", "this cloud was never asked"),
            Self::Duplicate => ("duplicate", "its result is available already"),
            Self::Late => ("late", "its timer fired, or it failed before"),
        }
    }
}

/// What the three kinds have in common.
macro_rules! reason {
    ($kind:ident) => {
        impl $kind {
            /// The word in a trace.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                self.word_and_sentence().0
            }

            /// What the word means, to be put after a colon.
            #[must_use]
            pub const fn sentence(self) -> &'static str {
                self.word_and_sentence().1
            }

            /// Its place in [`ALL`](Self::ALL).
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
