//! The cells that hold the counts: written by the engine, read from anywhere (D11 one account).

use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use tracing::error;

use crate::event::CountedEvent;
use crate::item::{Source, Trigger};
use crate::meter::Meters;
use crate::reasons::Reasons;
use crate::tally::{CurrentDeadline, SourceTally, Tally};

/// The tally's cells and the meters of one operator, counted together.
///
/// Each count is a word of its own: a tally read during an input may show one of its counts and not
/// the next. What changes seldom and is not a number is behind a lock.
pub(crate) struct Counts {
    messages: AtomicU64,
    refused: [AtomicU64; OpenRefusal::ALL.len()],
    missed: AtomicU64,
    sources: Vec<SourceCounts>,
    unrecorded: Mutex<Option<Arc<str>>>,
    pub(crate) meters: Meters,
}

struct SourceCounts {
    source: Source,
    admitted: AtomicU64,
    refused: [AtomicU64; OfferRefusal::ALL.len()],
    outputs: [AtomicU64; Trigger::ALL.len()],
    finals: AtomicU64,
    preliminary: AtomicU64,
    held: AtomicU64,
    dropped: [AtomicU64; DropReason::ALL.len()],
    failed: AtomicU64,
    reasons: Mutex<Reasons>,
    lost: AtomicU64,
    failures_dropped: [AtomicU64; DropReason::ALL.len()],
    timers: AtomicU64,
    cancelled: AtomicU64,
    sent_bytes: AtomicU64,
    in_force: Mutex<Option<CurrentDeadline>>,
}

/// The counts of a running operator, to be read from anywhere.
#[derive(Clone)]
pub struct Counting(Arc<Counts>);

impl Counts {
    pub(crate) fn new(operator: &str, sources: &[Source]) -> Self {
        Self {
            messages: AtomicU64::new(0),
            refused: Default::default(),
            missed: AtomicU64::new(0),
            sources: sources.iter().cloned().map(SourceCounts::new).collect(),
            unrecorded: Mutex::new(None),
            meters: Meters::new(operator, sources),
        }
    }

    pub(crate) fn tally(&self) -> Tally {
        Tally {
            messages: read(&self.messages),
            refused: by_reason(OpenRefusal::ALL, &self.refused),
            missed: read(&self.missed),
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

    /// Counts the bytes that a call to cloud `p` sent.
    pub(crate) fn sent(&self, p: u16, bytes: u64) {
        if let Some(at) = self.sources.iter().position(|counts| counts.source.priority == p) {
            self.source(at, CountedEvent::Sent { bytes });
        }
    }

    /// Counts why the source at `index` sent no result.
    pub(crate) fn reason(&self, index: usize, why: &str) -> Arc<str> {
        match self.sources.get(index) {
            Some(counts) => lock(&counts.reasons).count(why),
            None => why.into(),
        }
    }

    /// Keeps the deadline of the source's latest offer; call it when that has changed.
    pub(crate) fn in_force(&self, index: usize, in_force: CurrentDeadline) {
        if let Some(counts) = self.sources.get(index) {
            *lock(&counts.in_force) = Some(in_force);
        }
        if let Some(meter) = self.meters.sources.get(index) {
            meter.deadline.set(in_force.deadline.as_secs_f64());
        }
    }

    /// Notes that a recording ends here.
    pub(crate) fn unrecorded(&self, why: &str) {
        error!(why, "the recording ends here; the operator goes on");
        lock(&self.unrecorded).get_or_insert_with(|| why.into());
    }

    /// Counts an event of the source at `index`; local has 0.
    pub(crate) fn source(&self, index: usize, event: CountedEvent) {
        if let Some(counts) = self.sources.get(index) {
            counts.count(event);
        }
        if let Some(meter) = self.meters.sources.get(index) {
            meter.count(event);
        }
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

    /// The counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.0.tally()
    }

    /// Counts bytes that a call to cloud `p` sends; does nothing if there is no such cloud.
    pub fn sent(&self, p: u16, bytes: u64) {
        self.0.sent(p, bytes);
    }
}

impl SourceCounts {
    fn new(source: Source) -> Self {
        Self {
            source,
            admitted: AtomicU64::new(0),
            refused: Default::default(),
            outputs: Default::default(),
            finals: AtomicU64::new(0),
            preliminary: AtomicU64::new(0),
            held: AtomicU64::new(0),
            dropped: Default::default(),
            failed: AtomicU64::new(0),
            reasons: Mutex::default(),
            lost: AtomicU64::new(0),
            failures_dropped: Default::default(),
            timers: AtomicU64::new(0),
            cancelled: AtomicU64::new(0),
            sent_bytes: AtomicU64::new(0),
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
            CountedEvent::FailureDropped(why) => add_at(&self.failures_dropped, why.index()),
            CountedEvent::Timer => add(&self.timers, 1),
            CountedEvent::Cancelled => add(&self.cancelled, 1),
            CountedEvent::Sent { bytes } => add(&self.sent_bytes, bytes),
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
            failures_dropped: by_reason(DropReason::ALL, &self.failures_dropped),
            timers: read(&self.timers),
            cancelled: read(&self.cancelled),
            sent_bytes: read(&self.sent_bytes),
            in_force: *lock(&self.in_force),
        }
    }
}

fn add(cell: &AtomicU64, count: u64) {
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

/// Only those that are not zero.
fn by_reason<K: Ord, const N: usize>(all: [K; N], cells: &[AtomicU64; N]) -> BTreeMap<K, u64> {
    all.into_iter().zip(cells.iter().map(read)).filter(|(_, count)| *count > 0).collect()
}

/// Nothing panics while it is held.
fn lock<T>(cell: &Mutex<T>) -> MutexGuard<'_, T> {
    cell.lock().unwrap_or_else(PoisonError::into_inner)
}
