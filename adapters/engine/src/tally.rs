//! The counts: a plain tally, and the same through the `metrics` facade.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fuseline_deadline::{Chosen, Reason};
use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};

use crate::item::{Source, Trigger};
use crate::reasons::Reasons;

/// An operator's counts since its start.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Tally {
    /// Messages taken on.
    pub messages: u64,
    /// Messages refused, by reason (F1).
    pub refused: BTreeMap<OpenRefusal, u64>,
    /// Messages that nothing came for (F6).
    pub missed: u64,
    /// Local first, then the clouds as they were registered.
    pub sources: Vec<SourceTally>,
    /// Times that a handler of the operator's own failed: of situations, hints, states or substitutes.
    pub handler_failures: u64,
    /// Timers that were served later than the [warning](crate::EngineConfig::lag_warning) allows: something held up the event loop.
    pub late_timers: u64,
    /// The longest time that a timer was late, or that a handler held up its thread.
    pub greatest_lag: Duration,
    /// Why a recording ended before the operator, if one did; the first reason.
    pub unrecorded: Option<Arc<str>>,
}

/// One source's counts.
#[derive(Clone, PartialEq, Debug)]
pub struct SourceTally {
    /// The source.
    pub source: Source,
    /// Requests admitted (F2); local's are the messages taken on.
    pub admitted: u64,
    /// Requests refused, by reason (F2).
    pub refused: BTreeMap<OfferRefusal, u64>,
    /// Messages answered with its result, by what made the result go (F7).
    pub outputs: BTreeMap<Trigger, u64>,
    /// Messages answered with its preliminary result, since no better one came (F9).
    pub finals: u64,
    /// Results that were sent while better ones were pending (F9).
    pub preliminary: u64,
    /// Results that were held at first (F3).
    pub held: u64,
    /// Results dropped, by reason (F3).
    pub dropped: BTreeMap<DropReason, u64>,
    /// Failures accepted (F4).
    pub failed: u64,
    /// Why they failed.
    pub reasons: Reasons,
    /// Computations that counted as lost: no result or failure came within their message's deadline, counted from their start.
    pub lost: u64,
    /// Times that its message handler failed.
    pub handler_failures: u64,
    /// Times that its policy failed.
    pub policy_failures: u64,
    /// Times that its handlers held up the thread that they ran on for longer than the
    /// [warning](crate::EngineConfig::lag_warning) allows.
    pub held_up: u64,
    /// Failures dropped, by reason (F4).
    pub failures_dropped: BTreeMap<DropReason, u64>,
    /// Timers that fired (F5); for local, those of its deadline.
    pub timers: u64,
    /// Requests cancelled because something better or timelier was forwarded (F7, F9).
    pub cancelled: u64,
    /// Bytes that its calls report as sent.
    pub sent_bytes: u64,
    /// The deadline in force, of its latest offer. None before the first offer, and for local.
    pub in_force: Option<CurrentDeadline>,
}

/// A deadline, and what chose it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CurrentDeadline {
    /// The deadline.
    pub deadline: Duration,
    /// Why a policy chose it; none if it is as it was offered.
    pub reason: Option<Reason>,
}

impl Tally {
    /// Messages answered with a result, once the last one was sent.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.sources.iter().map(SourceTally::forwarded).sum()
    }
}

impl SourceTally {
    /// Messages answered with its result as the last one.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.outputs.values().sum::<u64>() + self.finals
    }
}

impl CurrentDeadline {
    /// All words that [`why`](Self::why) may return.
    pub const WHYS: [&str; 8] =
        ["offered", "constant", "local-stops", "cloud-alone", "unsure", "expected", "probe", "cap"];

    /// Why it is in force, in one word.
    #[must_use]
    pub const fn why(&self) -> &'static str {
        Self::WHYS[self.index()]
    }

    /// The word's index in [`WHYS`](Self::WHYS).
    pub(crate) const fn index(&self) -> usize {
        match self.reason {
            None => 0,
            Some(Reason::Constant) => 1,
            Some(Reason::Guard(case)) => 1 + case.number() as usize,
            Some(Reason::Expected { .. }) => 5,
            Some(Reason::Probe) => 6,
            Some(Reason::Cap) => 7,
        }
    }
}

impl From<Chosen> for CurrentDeadline {
    fn from(Chosen { deadline, reason }: Chosen) -> Self {
        Self { deadline, reason: Some(reason) }
    }
}
