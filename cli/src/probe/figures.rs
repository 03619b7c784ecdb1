//! The figures of a probe.

use std::time::Duration;

use serde::Serialize;

use crate::percentile::Spread;

/// The counts of requests by what became of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize)]
pub(crate) struct RequestCounts {
    /// Slots that came: sent, skipped or missed.
    pub(crate) slots: u64,
    pub(crate) sent: u64,
    pub(crate) answered: u64,
    /// Calls that failed, or were given up.
    pub(crate) failed: u64,
    /// Calls under way as the probe ended.
    pub(crate) unanswered: u64,
    /// Answers that came early enough for the given runtime and deadline.
    pub(crate) in_time: u64,
    pub(crate) pauses: u64,
    /// Slots at which nothing was sent for a pause.
    pub(crate) skipped: u64,
    /// Slots that this host overslept; they count nowhere else.
    pub(crate) missed: u64,
}

/// Everything that was measured.
#[derive(Clone)]
pub(crate) struct Figures {
    pub(crate) counts: RequestCounts,
    pub(crate) paused: Duration,
    /// Round trips of answers.
    pub(crate) answers: Spread,
    /// The response times over slots: a skipped slot took until the pause's end, and a failed one
    /// never ended.
    pub(crate) slots: Spread,
}

impl Figures {
    pub(crate) fn new() -> Self {
        let (answers, slots) = (Spread::new(), Spread::new());
        Self { counts: RequestCounts::default(), paused: Duration::ZERO, answers, slots }
    }
}
