//! The calls of the machine and their answers, in plain values. Cloud `p` is source `p`.

use fuseline_core::{
    Admission, Decision, Firing, Instant, OfferRefusal, OpenRefusal, Outcome, Priorities, Priority,
    Source, Sources,
};

/// The input of a call. Times are in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum CallInput {
    /// An open (F1).
    Open {
        /// The timestamp.
        t: u64,
        /// The deadline for local.
        deadline: Option<u64>,
    },
    /// An offer (F2).
    Offer {
        /// The timestamp.
        t: u64,
        /// The cloud.
        p: u8,
        /// The deadline.
        deadline: u64,
        /// The length of the queue.
        backlog: u64,
    },
    /// A result (F3).
    Result {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u8,
    },
    /// A failure (F4).
    Fail {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u8,
    },
    /// A tick (F5).
    Tick {
        /// The timestamp.
        t: u64,
    },
    /// The query for the next due instant.
    NextDue {
        /// The timestamp.
        t: u64,
    },
}

/// An input with its caller's `now`.
pub(crate) type Timed = (u64, CallInput);

/// The timers that fired in a call.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct CallFirings {
    /// The last due instant.
    pub(crate) due: u64,
    /// The sources of the timers.
    pub(crate) timers: Sources,
    pub(crate) decision: Decision,
}

/// The answer to a call.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) enum CallAnswer {
    /// The answer to an open.
    Opened(Result<(), OpenRefusal>),
    /// The answer to an offer: the due instant, or the reason to refuse.
    Offered(Option<CallFirings>, Result<u64, OfferRefusal>),
    /// The answer to a result or a failure.
    Closed(Option<CallFirings>, Decision),
    /// The answer to a tick.
    Ticked(Option<CallFirings>),
    /// The answer to the query.
    Due(Option<u64>),
}

impl CallInput {
    /// Returns the timestamp of the call.
    #[must_use]
    pub(crate) const fn timestamp(self) -> u64 {
        match self {
            Self::Open { t, .. }
            | Self::Offer { t, .. }
            | Self::Result { t, .. }
            | Self::Fail { t, .. }
            | Self::Tick { t }
            | Self::NextDue { t } => t,
        }
    }
}

impl CallAnswer {
    pub(crate) fn offered<const C: usize>(
        (fired, admission): (Option<Firing<C>>, Admission),
    ) -> Self {
        let admission = match admission {
            Admission::Admitted { due } => Ok(due.as_nanos()),
            Admission::Refused(why) => Err(why),
        };
        Self::Offered(fired.map(CallFirings::from), admission)
    }

    pub(crate) fn closed<const C: usize>(
        (fired, outcome): (Option<Firing<C>>, Outcome<C>),
    ) -> Self {
        Self::Closed(fired.map(CallFirings::from), decision(outcome))
    }

    pub(crate) fn ticked<const C: usize>(fired: Option<Firing<C>>) -> Self {
        Self::Ticked(fired.map(CallFirings::from))
    }

    pub(crate) fn due(due: Option<Instant>) -> Self {
        Self::Due(due.map(Instant::as_nanos))
    }
}

impl<const C: usize> From<Firing<C>> for CallFirings {
    fn from(firing: Firing<C>) -> Self {
        Self {
            due: firing.due.as_nanos(),
            timers: sources(&firing.timers),
            decision: decision(firing.outcome),
        }
    }
}

/// Returns an open without a deadline.
#[must_use]
pub(crate) const fn open(now: u64, t: u64) -> Timed {
    (now, CallInput::Open { t, deadline: None })
}

#[must_use]
pub(crate) const fn result(now: u64, t: u64, p: u8) -> Timed {
    (now, CallInput::Result { t, p })
}

#[must_use]
pub(crate) const fn tick(now: u64, t: u64) -> Timed {
    (now, CallInput::Tick { t })
}

fn decision<const C: usize>(outcome: Outcome<C>) -> Decision {
    match outcome {
        Outcome::Dropped(why) => Decision::Dropped(why),
        Outcome::Held => Decision::Held,
        Outcome::Waiting => Decision::Waiting,
        Outcome::Missed => Decision::Missed,
        Outcome::Forwarded { by, cancelled } => {
            Decision::Forwarded { by: source(by), cancelled: sources(&cancelled) }
        }
        Outcome::Preliminary { by, cancelled } => {
            Decision::Preliminary { by: source(by), cancelled: sources(&cancelled) }
        }
        Outcome::Final { by } => Decision::Final { by: source(by) },
    }
}

fn source(by: Priority) -> Source {
    u8::try_from(by.as_u16()).ok().and_then(Source::new).expect("cloud p is source p")
}

fn sources<const C: usize>(priorities: &Priorities<C>) -> Sources {
    priorities.sources()
}
