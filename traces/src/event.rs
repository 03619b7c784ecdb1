//! The lines of a trace as types: header, inputs and decisions. This module parses, checks and
//! decides nothing.

use std::fmt;

use crate::reason::{DropReason, OfferRefusal, OpenRefusal};

/// The version of the format, which is the value of `fuseline` in a header.
pub const VERSION: u64 = 1;

/// One line of a trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Line {
    /// The first line.
    Header(Header),
    /// Any other line.
    Event(Event),
}

/// A line of a trace after the header.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Event {
    /// Something happened to the operator.
    Input(Input),
    /// The operator decided something.
    Decision(Decision),
}

/// The first line of a trace, which is one operator's configuration.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Header {
    /// The operator's name, for people.
    pub operator: Option<String>,
    /// The greatest number of timestamps that may be open at once, 1 to 1024.
    pub window: u16,
    /// The commit rule (F6, F9).
    pub commit: Commit,
    /// Up to 15 registered clouds, in the order in which they are written.
    pub clouds: Vec<Cloud>,
}

/// One cloud's entry in the header.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Cloud {
    /// The priority, 1 to 65535; the greater number wins.
    pub p: u16,
    /// The cloud's name, for people.
    pub name: Option<String>,
    /// The number of queued requests at which the gate shuts (F2g).
    pub limit: u64,
    /// The number of queued requests at or below which a shut gate opens.
    pub resume: u64,
}

/// The commit rule (F6, F9).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub enum Commit {
    /// Forwards the best available result as soon as any cloud's timer fires.
    #[default]
    Eager,
    /// Lets a timer close only its own request.
    Patient,
    /// Forwards each better result at once.
    Progressive,
}

/// An event that happened to the operator. Instants and durations are in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Input {
    /// A message arrived (F1).
    Open {
        /// The clock's reading in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The time that local may take, in ns, or `None` if it is not bounded.
        deadline: Option<u64>,
    },
    /// A request was offered to a cloud (F2).
    Offer {
        /// The clock's reading in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The cloud's priority; any number.
        p: u64,
        /// The time that the cloud may take, in ns.
        deadline: u64,
        /// The length of the cloud's queue without this request.
        backlog: u64,
    },
    /// A result arrived (F3).
    Result {
        /// The clock's reading in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The source's priority; any number.
        p: u64,
    },
    /// No result will come (F4).
    Fail {
        /// The clock's reading in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The source's priority; any number.
        p: u64,
    },
    /// Time passed (F5).
    Tick {
        /// The clock's reading in ns.
        at: u64,
    },
}

/// A decision of the operator. `at` is the clock of the machine when it decided (F0).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Decision {
    /// The timer of `(t, p)` fired. `p` is 0 for local's deadline.
    Timer {
        /// The machine's clock in ns, when the timer was served. It may be later than the due
        /// instant.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The source's priority.
        p: u64,
    },
    /// An open was refused.
    RefuseOpen {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The first reason that holds.
        why: OpenRefusal,
    },
    /// An offer was refused.
    RefuseOffer {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The cloud's priority.
        p: u64,
        /// The first reason that holds.
        why: OfferRefusal,
    },
    /// An offer was admitted.
    Request {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The cloud's priority.
        p: u64,
        /// The due instant in ns.
        due: u64,
    },
    /// A result was held.
    Hold {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The source's priority; 0 is local.
        p: u64,
    },
    /// A result or a failure was dropped.
    Drop {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The source's priority; 0 is local.
        p: u64,
        /// The first reason that holds.
        why: DropReason,
    },
    /// A result was forwarded.
    Emit {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The priority of the result's source; 0 is local.
        p: u64,
    },
    /// The timestamp ended after its last output (F9).
    Final {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The priority of the source of the last output; 0 is local.
        p: u64,
    },
    /// The timestamp was missed.
    Miss {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
    },
    /// A pending call was cancelled.
    Cancel {
        /// The machine's clock in ns.
        at: u64,
        /// The timestamp.
        t: u64,
        /// The cloud's priority.
        p: u64,
    },
}

impl Commit {
    /// All commit rules.
    pub const ALL: [Self; 3] = [Self::Eager, Self::Patient, Self::Progressive];

    /// Returns the word that a trace uses.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Eager => "eager",
            Self::Patient => "patient",
            Self::Progressive => "progressive",
        }
    }
}

impl fmt::Display for Commit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl Event {
    /// Returns the instant in ns of the input or of the decision.
    #[must_use]
    pub const fn at(&self) -> u64 {
        match self {
            Self::Input(input) => input.at(),
            Self::Decision(decision) => decision.at(),
        }
    }

    /// Returns the timestamp, or `None` for a tick.
    #[must_use]
    pub const fn t(&self) -> Option<u64> {
        match self {
            Self::Input(input) => input.t(),
            Self::Decision(decision) => Some(decision.t()),
        }
    }
}

impl Input {
    /// Returns the clock's reading in ns that came with the input.
    #[must_use]
    pub const fn at(&self) -> u64 {
        match self {
            Self::Open { at, .. }
            | Self::Offer { at, .. }
            | Self::Result { at, .. }
            | Self::Fail { at, .. }
            | Self::Tick { at } => *at,
        }
    }

    /// Returns the timestamp, or `None` for a tick.
    #[must_use]
    pub const fn t(&self) -> Option<u64> {
        match self {
            Self::Open { t, .. }
            | Self::Offer { t, .. }
            | Self::Result { t, .. }
            | Self::Fail { t, .. } => Some(*t),
            Self::Tick { .. } => None,
        }
    }
}

impl Decision {
    /// Returns the instant in ns of the decision.
    #[must_use]
    pub const fn at(&self) -> u64 {
        match self {
            Self::Timer { at, .. }
            | Self::RefuseOpen { at, .. }
            | Self::RefuseOffer { at, .. }
            | Self::Request { at, .. }
            | Self::Hold { at, .. }
            | Self::Drop { at, .. }
            | Self::Emit { at, .. }
            | Self::Final { at, .. }
            | Self::Miss { at, .. }
            | Self::Cancel { at, .. } => *at,
        }
    }

    /// Returns the same decision at another instant, in ns.
    #[must_use]
    pub const fn redated(mut self, now: u64) -> Self {
        match &mut self {
            Self::Timer { at, .. }
            | Self::RefuseOpen { at, .. }
            | Self::RefuseOffer { at, .. }
            | Self::Request { at, .. }
            | Self::Hold { at, .. }
            | Self::Drop { at, .. }
            | Self::Emit { at, .. }
            | Self::Final { at, .. }
            | Self::Miss { at, .. }
            | Self::Cancel { at, .. } => *at = now,
        }
        self
    }

    /// Returns the timestamp.
    #[must_use]
    pub const fn t(&self) -> u64 {
        match self {
            Self::Timer { t, .. }
            | Self::RefuseOpen { t, .. }
            | Self::RefuseOffer { t, .. }
            | Self::Request { t, .. }
            | Self::Hold { t, .. }
            | Self::Drop { t, .. }
            | Self::Emit { t, .. }
            | Self::Final { t, .. }
            | Self::Miss { t, .. }
            | Self::Cancel { t, .. } => *t,
        }
    }
}
