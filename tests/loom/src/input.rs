//! The calls on the machine and their answers, in plain values. Cloud `p` is source `p`.

use fuseline_core::{
    Admission, Decision, Firing, Instant, OfferRefusal, OpenRefusal, Outcome, Priorities, Priority,
    Source, Sources,
};

/// What a call gives. Times are in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CallInput {
    /// F1.
    Open {
        /// The timestamp.
        t: u64,
        /// The deadline.
        deadline: Option<u64>,
    },
    /// F2.
    Offer {
        /// The timestamp.
        t: u64,
        /// The cloud.
        p: u8,
        /// The deadline.
        deadline: u64,
        /// The queue's length.
        backlog: u64,
    },
    /// F3.
    Result {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u8,
    },
    /// F4.
    Fail {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u8,
    },
    /// F5.
    Tick {
        /// The timestamp.
        t: u64,
    },
    /// A question.
    NextDue {
        /// The timestamp.
        t: u64,
    },
}

/// An input with its caller's `now`.
pub type Timed = (u64, CallInput);

/// Timers that fired in a call.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct CallFirings {
    /// The last due instant.
    pub due: u64,
    /// Whose timers.
    pub timers: Sources,
    /// What follows.
    pub decision: Decision,
}

/// What a call was answered.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum CallAnswer {
    /// To an open.
    Opened(Result<(), OpenRefusal>),
    /// To an offer: the due instant, or why not.
    Offered(Option<CallFirings>, Result<u64, OfferRefusal>),
    /// To a result or a failure.
    Closed(Option<CallFirings>, Decision),
    /// To a tick.
    Ticked(Option<CallFirings>),
    /// To the question.
    Due(Option<u64>),
}

impl CallInput {
    /// The timestamp that it is about.
    #[must_use]
    pub const fn timestamp(self) -> u64 {
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

/// An open without a deadline.
#[must_use]
pub const fn open(now: u64, t: u64) -> Timed {
    (now, CallInput::Open { t, deadline: None })
}

/// An open with a deadline.
#[must_use]
pub const fn limited(now: u64, t: u64, deadline: u64) -> Timed {
    (now, CallInput::Open { t, deadline: Some(deadline) })
}

/// An offer with an empty queue.
#[must_use]
pub const fn offer(now: u64, t: u64, p: u8, deadline: u64) -> Timed {
    (now, CallInput::Offer { t, p, deadline, backlog: 0 })
}

/// An offer with a queue.
#[must_use]
pub const fn queued(now: u64, t: u64, p: u8, deadline: u64, backlog: u64) -> Timed {
    (now, CallInput::Offer { t, p, deadline, backlog })
}

/// A result.
#[must_use]
pub const fn result(now: u64, t: u64, p: u8) -> Timed {
    (now, CallInput::Result { t, p })
}

/// A failure.
#[must_use]
pub const fn fail(now: u64, t: u64, p: u8) -> Timed {
    (now, CallInput::Fail { t, p })
}

/// A tick.
#[must_use]
pub const fn tick(now: u64, t: u64) -> Timed {
    (now, CallInput::Tick { t })
}

/// The question when to tick.
#[must_use]
pub const fn next_due(t: u64) -> Timed {
    (0, CallInput::NextDue { t })
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
