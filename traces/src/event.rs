//! The lines of a trace as types: header, inputs and decisions. Nothing is parsed, checked or decided here.

use std::fmt;

use crate::reason::{DropReason, OfferRefusal, OpenRefusal};

/// The format's version, the value of `fuseline` in a header.
pub const VERSION: u64 = 1;

/// One line of a trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Line {
    /// The first one.
    Header(Header),
    /// Every other one.
    Event(Event),
}

/// A line of a trace after the header.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Event {
    /// What happened to the operator.
    Input(Input),
    /// What it did about it.
    Decision(Decision),
}

/// The first line of a trace: one operator's configuration.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Header {
    /// The operator's name, for people.
    pub operator: Option<String>,
    /// How many timestamps may be open at once, 1 to 1024.
    pub window: u16,
    /// When results are forwarded (F6, F9).
    pub commit: Commit,
    /// The registered clouds, up to 15, in the order written.
    pub clouds: Vec<Cloud>,
}

/// One cloud's entry in the header.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Cloud {
    /// The priority, 1 to 65535; the greater wins.
    pub p: u16,
    /// The cloud's name, for people.
    pub name: Option<String>,
    /// The gate shuts at this many queued requests (F2g).
    pub limit: u64,
    /// The shut gate opens at this many or fewer.
    pub resume: u64,
}

/// The commit rule (F6, F9).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub enum Commit {
    /// The first cloud's timer to fire commits the best available result.
    #[default]
    Eager,
    /// A timer closes its own request alone.
    Patient,
    /// Each better result is forwarded at once.
    Progressive,
}

/// What happened to the operator. Instants and durations are nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Input {
    /// A message came (F1).
    Open {
        /// The clock's reading, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// How long the local computation may take.
        deadline: Option<u64>,
    },
    /// A request was offered to a cloud (F2).
    Offer {
        /// The clock's reading, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The cloud's priority; any number.
        p: u64,
        /// How long the cloud may take.
        deadline: u64,
        /// The cloud's queue without this request.
        backlog: u64,
    },
    /// A result came (F3).
    Result {
        /// The clock's reading, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The source's priority; any number.
        p: u64,
    },
    /// No result will come (F4).
    Fail {
        /// The clock's reading, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The source's priority; any number.
        p: u64,
    },
    /// Time went by (F5).
    Tick {
        /// The clock's reading, in nanoseconds.
        at: u64,
    },
}

/// What the operator did. `at` is the `now` that F0 used.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Decision {
    /// The timer of `(t, p)` fired; `p` 0 is the local deadline's.
    Timer {
        /// `now`, in nanoseconds: when it was served, not when it was due.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The source's priority.
        p: u64,
    },
    /// An open was refused.
    RefuseOpen {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The first reason that holds.
        why: OpenRefusal,
    },
    /// An offer was refused.
    RefuseOffer {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The cloud's priority.
        p: u64,
        /// The first reason that holds.
        why: OfferRefusal,
    },
    /// An offer was admitted.
    Request {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The cloud's priority.
        p: u64,
        /// The due instant, in nanoseconds.
        due: u64,
    },
    /// A result was cached.
    Hold {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The source's priority; 0 is local's.
        p: u64,
    },
    /// A result or a failure was dropped.
    Drop {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The source's priority; 0 is local's.
        p: u64,
        /// The first reason that holds.
        why: DropReason,
    },
    /// A result was forwarded.
    Emit {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The priority of the source whose result it is; 0 is local's.
        p: u64,
    },
    /// The timestamp ended after its last output (F9).
    Final {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The priority of the source of the last output; 0 is local's.
        p: u64,
    },
    /// The timestamp was missed.
    Miss {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
    },
    /// A pending call was cancelled.
    Cancel {
        /// `now`, in nanoseconds.
        at: u64,
        /// The timestamp that it is about.
        t: u64,
        /// The cloud's priority.
        p: u64,
    },
}

impl Commit {
    /// All rules.
    pub const ALL: [Self; 3] = [Self::Eager, Self::Patient, Self::Progressive];

    /// The word in a trace.
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
    /// When the line was written, or its decision made.
    #[must_use]
    pub const fn at(&self) -> u64 {
        match self {
            Self::Input(input) => input.at(),
            Self::Decision(decision) => decision.at(),
        }
    }

    /// The timestamp, unless it is a tick.
    #[must_use]
    pub const fn t(&self) -> Option<u64> {
        match self {
            Self::Input(input) => input.t(),
            Self::Decision(decision) => Some(decision.t()),
        }
    }
}

impl Input {
    /// The clock's reading that came with the input.
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

    /// The timestamp, unless it is a tick.
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
    /// When it was decided.
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

    /// The same, decided at another instant.
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

    /// The timestamp it is about.
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
