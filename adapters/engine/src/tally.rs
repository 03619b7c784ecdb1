//! The counts as plain numbers. The `metrics` facade has the same counts.

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
    /// The messages that were accepted.
    pub messages: u64,
    /// The messages that were refused, by reason (F1).
    pub refused: BTreeMap<OpenRefusal, u64>,
    /// The messages that were missed (F6).
    pub missed: u64,
    /// The counts of each source: local first, then the clouds as they were registered.
    pub sources: Vec<SourceTally>,
    /// The failures of the operator's own handlers: for situations, hints, states or substitutes.
    pub handler_failures: u64,
    /// The timers that were served later than the [warning](crate::EngineConfig::lag_warning)
    /// allows, because something blocked the event loop.
    pub late_timers: u64,
    /// The greatest delay of a timer, or time that a handler blocked its thread.
    pub greatest_lag: Duration,
    /// The reason why a recording ended before the operator did, if one did. It is the first such
    /// reason.
    pub recording_error: Option<Arc<str>>,
}

/// One source's counts.
#[derive(Clone, PartialEq, Debug)]
pub struct SourceTally {
    /// The source.
    pub source: Source,
    /// The requests that were admitted (F2). For local, these are the accepted messages.
    pub admitted: u64,
    /// The requests that were refused, by reason (F2).
    pub refused: BTreeMap<OfferRefusal, u64>,
    /// The messages whose output was its result, by what triggered the output (F7).
    pub outputs: BTreeMap<Trigger, u64>,
    /// The messages that ended with its preliminary result, because no better one came (F9).
    pub finals: u64,
    /// The results that were sent while better ones were pending (F9).
    pub preliminary: u64,
    /// The results that were held at first (F3).
    pub held: u64,
    /// The results that were dropped, by reason (F3).
    pub dropped: BTreeMap<DropReason, u64>,
    /// The failures that were accepted (F4).
    pub failed: u64,
    /// The reasons of those failures.
    pub reasons: Reasons,
    /// The computations that counted as lost: no result or failure came within their message's
    /// deadline, counted from their start.
    pub lost: u64,
    /// The failures of its message handler.
    pub handler_failures: u64,
    /// The failures of its policy.
    pub policy_failures: u64,
    /// The times that its handlers blocked their thread for longer than the
    /// [warning](crate::EngineConfig::lag_warning) allows.
    pub held_up: u64,
    /// The failures that were dropped, by reason (F4).
    pub failures_dropped: BTreeMap<DropReason, u64>,
    /// The timers that fired (F5). For local, these are the ends of its deadline.
    pub timers: u64,
    /// The requests that were cancelled because a better or timelier result was forwarded (F7, F9).
    pub cancelled: u64,
    /// The bytes that its calls report as sent.
    pub sent_bytes: u64,
    /// The deadline of its latest offer; `None` before the first offer, and for local.
    pub in_force: Option<CurrentDeadline>,
}

/// A deadline, and what chose it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CurrentDeadline {
    /// The deadline, counted from the request.
    pub deadline: Duration,
    /// The reason why a policy chose it; `None` if it is as it was offered.
    pub reason: Option<Reason>,
}

impl Tally {
    /// Returns the number of messages that ended with a result.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.sources.iter().map(SourceTally::forwarded).sum()
    }
}

impl SourceTally {
    /// Returns the number of messages that ended with this source's result.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.outputs.values().sum::<u64>() + self.finals
    }
}

impl CurrentDeadline {
    /// All words that [`why`](Self::why) may return.
    pub const WHYS: [&str; 8] =
        ["offered", "constant", "local-stops", "cloud-alone", "unsure", "expected", "probe", "cap"];

    /// Returns the reason for the deadline in one word.
    #[must_use]
    pub const fn why(&self) -> &'static str {
        Self::WHYS[self.index()]
    }

    /// Returns the word's index in [`WHYS`](Self::WHYS).
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
