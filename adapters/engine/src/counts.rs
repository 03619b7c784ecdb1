//! The cells that hold the counts. The engine writes them, and anyone may read them (D11).

use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use tracing::error;

use crate::event::CountedEvent;
use crate::item::{Source, Trigger};
use crate::lag::Lag;
use crate::lock::lock;
use crate::meter::{Meters, SourceMeters};
use crate::reasons::Reasons;
use crate::tally::{CurrentDeadline, SourceTally, Tally};

/// The cells of the tally and the meters of one operator, counted together.
///
/// Each count is a word of its own, so a tally that is read during an input may show one of its counts and
/// not the next. Data that seldom changes and is not a number is behind a lock.
// The fields that most messages count come first.
#[repr(C)]
pub(crate) struct Counts {
    sources: Vec<SourceCounts>,
    pub(crate) lag: Lag,
    messages: AtomicU64,
    pub(crate) meters: Meters,
    refused: [AtomicU64; OpenRefusal::ALL.len()],
    missed: AtomicU64,
    handler_failures: AtomicU64,
    unrecorded: Mutex<Option<Arc<str>>>,
}

/// One source's cells. Those that most messages count come first, in few cache lines: with thousands of
/// operators, none of them is in the cache.
#[repr(C, align(64))]
struct SourceCounts {
    admitted: AtomicU64,
    held: AtomicU64,
    outputs: [AtomicU64; Trigger::ALL.len()],
    preliminary: AtomicU64,
    cancelled: AtomicU64,
    sent_bytes: AtomicU64,
    meters: SourceMeters,
    source: Source,
    refused: [AtomicU64; OfferRefusal::ALL.len()],
    finals: AtomicU64,
    dropped: [AtomicU64; DropReason::ALL.len()],
    failed: AtomicU64,
    reasons: Mutex<Reasons>,
    lost: AtomicU64,
    handler_failures: AtomicU64,
    policy_failures: AtomicU64,
    held_up: AtomicU64,
    failures_dropped: [AtomicU64; DropReason::ALL.len()],
    timers: AtomicU64,
    in_force: Mutex<Option<CurrentDeadline>>,
}

/// The counts of a running operator, which may be read from anywhere.
#[derive(Clone)]
pub struct Counting(Arc<Counts>);

impl Counts {
    pub(crate) fn new(operator: &str, sources: &[Source], lag_warning: Duration) -> Self {
        Self {
            messages: AtomicU64::new(0),
            refused: Default::default(),
            missed: AtomicU64::new(0),
            handler_failures: AtomicU64::new(0),
            lag: Lag::new(operator, lag_warning),
            sources: sources.iter().map(|source| SourceCounts::new(operator, source)).collect(),
            unrecorded: Mutex::new(None),
            meters: Meters::new(operator),
        }
    }

    pub(crate) fn tally(&self) -> Tally {
        Tally {
            messages: read(&self.messages),
            refused: by_reason(OpenRefusal::ALL, &self.refused),
            missed: read(&self.missed),
            handler_failures: read(&self.handler_failures),
            late_timers: self.lag.late_timers(),
            greatest_lag: self.lag.greatest(),
            sources: self.sources.iter().map(SourceCounts::tally).collect(),
            unrecorded: lock(&self.unrecorded).clone(),
        }
    }

    pub(crate) fn message(&self) {
        add(&self.messages, 1);
        self.meters.messages.increment(1);
    }

    pub(crate) fn refused(&self, why: OpenRefusal) {
        add_at(&self.refused, why.index());
        self.meters.refused(why);
    }

    pub(crate) fn missed(&self) {
        add(&self.missed, 1);
        self.meters.missed.increment(1);
    }

    /// Counts a failure of one of the operator's own handlers.
    fn handler_failed(&self) {
        add_shared(&self.handler_failures, 1);
        self.meters.handler_failures.increment(1);
    }

    /// Notes the delay of a timer.
    pub(crate) fn timer_lag(&self, lag: Duration) {
        self.meters.timer_lag.record(lag);
        self.lag.timer(lag);
    }

    /// Counts the bytes that a call to cloud `p` sent.
    pub(crate) fn sent(&self, p: u16, bytes: u64) {
        if let Some(at) = self.index(p) {
            self.source(at, CountedEvent::Sent { bytes });
        }
    }

    fn index(&self, p: u16) -> Option<usize> {
        self.sources.iter().position(|counts| counts.source.priority == p)
    }

    /// Counts the reason why the source at `index` sent no result.
    pub(crate) fn reason(&self, index: usize, why: &str) -> Arc<str> {
        match self.sources.get(index) {
            Some(counts) => lock(&counts.reasons).count(why),
            None => why.into(),
        }
    }

    /// Stores the deadline of the source's latest offer. Call this when it has changed.
    pub(crate) fn in_force(&self, index: usize, in_force: CurrentDeadline) {
        if let Some(counts) = self.sources.get(index) {
            *lock(&counts.in_force) = Some(in_force);
            counts.meters.deadline.set(in_force.deadline.as_secs_f64());
        }
    }

    /// Notes that a recording ends here.
    pub(crate) fn unrecorded(&self, why: &str) {
        error!(why, "the recording ends here; the operator goes on");
        lock(&self.unrecorded).get_or_insert_with(|| why.into());
    }

    /// Counts an event of the source at `index`; local's index is 0.
    pub(crate) fn source(&self, index: usize, event: CountedEvent) {
        if let Some(counts) = self.sources.get(index) {
            counts.count(event);
            counts.meters.count(event);
        }
    }

    /// Returns the meters of the source at `index`.
    pub(crate) fn meters(&self, index: usize) -> Option<&SourceMeters> {
        self.sources.get(index).map(|counts| &counts.meters)
    }
}

impl fmt::Debug for Counting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tally().fmt(f)
    }
}

impl Counting {
    pub(crate) fn new(counts: &Arc<Counts>) -> Self {
        Self(Arc::clone(counts))
    }

    /// Returns the counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.0.tally()
    }

    /// Counts a failure of a message handler of cloud `p`, or of one of the operator's own handlers if `p` is
    /// `None`.
    pub fn handler_failed(&self, p: Option<u16>) {
        match p.and_then(|p| self.0.index(p)) {
            Some(index) => self.0.source(index, CountedEvent::HandlerFailed),
            None => self.0.handler_failed(),
        }
    }

    /// Counts a handler that ran longer than the [lag warning](crate::EngineConfig::lag_warning) allows, and
    /// logs it now and then. `p` is the source that the handler belongs to, or `None` for a handler of the
    /// operator.
    pub fn ran(&self, p: Option<u16>, lasted: Duration) {
        if !self.0.lag.is_too_long(lasted) {
            return;
        }
        let source = p.and_then(|p| self.0.index(p));
        if let Some(index) = source {
            self.0.source(index, CountedEvent::HeldUp);
        }
        let counts = source.and_then(|index| self.0.sources.get(index));
        self.0
            .lag
            .held_up(lasted, counts.map(|counts| (&*counts.source.name, read(&counts.held_up))));
    }

    /// Returns how long a handler may run without a pause before it is counted and logged.
    #[must_use]
    pub fn lag_warning(&self) -> Duration {
        self.0.lag.warning()
    }

    /// Counts bytes that a call to cloud `p` sends. Does nothing if there is no such cloud.
    pub fn sent(&self, p: u16, bytes: u64) {
        self.0.sent(p, bytes);
    }
}

impl SourceCounts {
    fn new(operator: &str, source: &Source) -> Self {
        Self {
            admitted: AtomicU64::new(0),
            held: AtomicU64::new(0),
            outputs: Default::default(),
            preliminary: AtomicU64::new(0),
            cancelled: AtomicU64::new(0),
            sent_bytes: AtomicU64::new(0),
            meters: SourceMeters::new(operator, source),
            source: source.clone(),
            refused: Default::default(),
            finals: AtomicU64::new(0),
            dropped: Default::default(),
            failed: AtomicU64::new(0),
            reasons: Mutex::default(),
            lost: AtomicU64::new(0),
            handler_failures: AtomicU64::new(0),
            policy_failures: AtomicU64::new(0),
            held_up: AtomicU64::new(0),
            failures_dropped: Default::default(),
            timers: AtomicU64::new(0),
            in_force: Mutex::new(None),
        }
    }

    fn count(&self, event: CountedEvent) {
        match event {
            CountedEvent::Admitted => add(&self.admitted, 1),
            CountedEvent::Refused(why) => add_at(&self.refused, why.index()),
            CountedEvent::Output(trigger) => add_at(&self.outputs, trigger as usize),
            CountedEvent::Final => add(&self.finals, 1),
            CountedEvent::Forwarded => {}
            CountedEvent::Preliminary => add(&self.preliminary, 1),
            CountedEvent::Held => add(&self.held, 1),
            CountedEvent::Dropped(why) => add_at(&self.dropped, why.index()),
            CountedEvent::Failed => add(&self.failed, 1),
            CountedEvent::Lost => add(&self.lost, 1),
            CountedEvent::HandlerFailed => add_shared(&self.handler_failures, 1),
            CountedEvent::PolicyFailed => add(&self.policy_failures, 1),
            CountedEvent::HeldUp => add_shared(&self.held_up, 1),
            CountedEvent::FailureDropped(why) => add_at(&self.failures_dropped, why.index()),
            CountedEvent::Timer => add(&self.timers, 1),
            CountedEvent::Cancelled => add(&self.cancelled, 1),
            CountedEvent::Sent { bytes } => add_shared(&self.sent_bytes, bytes),
        }
    }

    fn tally(&self) -> SourceTally {
        SourceTally {
            source: self.source.clone(),
            admitted: read(&self.admitted),
            refused: by_reason(OfferRefusal::ALL, &self.refused),
            outputs: by_reason(Trigger::ALL, &self.outputs),
            finals: read(&self.finals),
            preliminary: read(&self.preliminary),
            held: read(&self.held),
            dropped: by_reason(DropReason::ALL, &self.dropped),
            failed: read(&self.failed),
            reasons: lock(&self.reasons).clone(),
            lost: read(&self.lost),
            handler_failures: read(&self.handler_failures),
            policy_failures: read(&self.policy_failures),
            held_up: read(&self.held_up),
            failures_dropped: by_reason(DropReason::ALL, &self.failures_dropped),
            timers: read(&self.timers),
            cancelled: read(&self.cancelled),
            sent_bytes: read(&self.sent_bytes),
            in_force: *lock(&self.in_force),
        }
    }
}

/// Adds to a count that only the engine changes, one input after the other, so no other addition can
/// interfere.
fn add(cell: &AtomicU64, count: u64) {
    cell.store(read(cell).wrapping_add(count), Ordering::Relaxed);
}

/// Adds to a count that calls and handlers change in any thread.
fn add_shared(cell: &AtomicU64, count: u64) {
    cell.fetch_add(count, Ordering::Relaxed);
}

fn add_at(cells: &[AtomicU64], index: usize) {
    if let Some(cell) = cells.get(index) {
        add(cell, 1);
    }
}

fn read(cell: &AtomicU64) -> u64 {
    cell.load(Ordering::Relaxed)
}

/// Returns the counts that are not zero.
fn by_reason<K: Ord, const N: usize>(all: [K; N], cells: &[AtomicU64; N]) -> BTreeMap<K, u64> {
    all.into_iter().zip(cells.iter().map(read)).filter(|(_, count)| *count > 0).collect()
}
