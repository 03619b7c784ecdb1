//! What was counted: a plain tally to look at, and the same through the `metrics` facade.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use tracing::error;

use crate::item::{Source, Trigger};
use crate::meter::Meters;
use crate::reasons::Reasons;

/// An operator's counts since its start.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Tally {
    /// Messages taken on.
    pub messages: u64,
    /// Messages refused, by reason (F1).
    pub refused: BTreeMap<OpenRefusal, u64>,
    /// Messages that nothing came for (F6).
    pub missed: u64,
    /// Local first, then the clouds as they were registered.
    pub sources: Vec<SourceTally>,
    /// Why a recording ended before the operator did, if one did: the first reason.
    pub unrecorded: Option<Arc<str>>,
}

/// One source's counts.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceTally {
    /// Whose they are.
    pub source: Source,
    /// Requests admitted (F2); local's are the messages taken on.
    pub admitted: u64,
    /// Requests refused, by reason (F2).
    pub refused: BTreeMap<OfferRefusal, u64>,
    /// Messages answered with its result, by what made the result go (F7).
    pub outputs: BTreeMap<Trigger, u64>,
    /// Results that were held at first (F3).
    pub held: u64,
    /// Results dropped, by reason (F3).
    pub dropped: BTreeMap<DropReason, u64>,
    /// Failures accepted (F4).
    pub failed: u64,
    /// Why they were.
    pub reasons: Reasons,
    /// Computations of which no word came: they gave their places back.
    pub lost: u64,
    /// Failures that no longer mattered, by reason (F4).
    pub failures_dropped: BTreeMap<DropReason, u64>,
    /// Timers that fired (F5); local's is its deadline's.
    pub timers: u64,
    /// Requests cancelled because something better or timelier was forwarded (F7).
    pub cancelled: u64,
    /// Bytes that its calls say they sent.
    pub sent_bytes: u64,
}

impl Tally {
    /// Messages answered with a result.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.sources.iter().map(SourceTally::forwarded).sum()
    }
}

impl SourceTally {
    /// Messages answered with its result.
    #[must_use]
    pub fn forwarded(&self) -> u64 {
        self.outputs.values().sum()
    }

    fn new(source: Source) -> Self {
        Self {
            source,
            admitted: 0,
            refused: BTreeMap::new(),
            outputs: BTreeMap::new(),
            held: 0,
            dropped: BTreeMap::new(),
            failed: 0,
            reasons: Reasons::default(),
            lost: 0,
            failures_dropped: BTreeMap::new(),
            timers: 0,
            cancelled: 0,
            sent_bytes: 0,
        }
    }
}

/// One cell for all counts, to be read from anywhere while the operator runs.
#[derive(Clone)]
pub struct Counting(Arc<Counts>);

/// The tally and the meters of one operator, counted together.
pub(crate) struct Counts {
    tally: Mutex<Tally>,
    pub(crate) meters: Meters,
}

/// What there is to count about one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Event {
    Admitted,
    Refused(OfferRefusal),
    Output(Trigger),
    /// The result that just came goes at once; its message is counted by `Output`.
    Forwarded,
    Held,
    Dropped(DropReason),
    Failed,
    Lost,
    FailureDropped(DropReason),
    Timer,
    Cancelled,
    Sent {
        bytes: u64,
    },
}

impl Counts {
    pub(crate) fn new(operator: &str, sources: &[Source]) -> Self {
        let tally = Tally {
            sources: sources.iter().cloned().map(SourceTally::new).collect(),
            ..Tally::default()
        };
        Self { tally: Mutex::new(tally), meters: Meters::new(operator, sources) }
    }

    pub(crate) fn snapshot(&self) -> Tally {
        self.lock().clone()
    }

    pub(crate) fn message(&self) {
        self.lock().messages += 1;
        self.meters.messages.increment(1);
    }

    pub(crate) fn refused(&self, why: OpenRefusal) {
        *self.lock().refused.entry(why).or_default() += 1;
        self.meters.refused(why);
    }

    pub(crate) fn missed(&self) {
        self.lock().missed += 1;
        self.meters.missed.increment(1);
    }

    /// Counts what a call to cloud `p` sent.
    pub(crate) fn sent(&self, p: u16, bytes: u64) {
        let place = self.lock().sources.iter().position(|tally| tally.source.priority == p);
        if let Some(index) = place {
            self.source(index, Event::Sent { bytes });
        }
    }

    /// Keeps why the source at `index` sent no result.
    pub(crate) fn reason(&self, index: usize, why: &str) -> Arc<str> {
        match self.lock().sources.get_mut(index) {
            Some(tally) => tally.reasons.count(why),
            None => why.into(),
        }
    }

    /// Tells that a recording ends here.
    pub(crate) fn unrecorded(&self, why: &str) {
        error!(why, "the recording ends here; the operator goes on");
        self.lock().unrecorded.get_or_insert_with(|| why.into());
    }

    /// Counts an event of the source at `index`; local has 0.
    pub(crate) fn source(&self, index: usize, event: Event) {
        if let Some(tally) = self.lock().sources.get_mut(index) {
            match event {
                Event::Admitted => tally.admitted += 1,
                Event::Refused(why) => *tally.refused.entry(why).or_default() += 1,
                Event::Output(trigger) => *tally.outputs.entry(trigger).or_default() += 1,
                Event::Forwarded => {}
                Event::Held => tally.held += 1,
                Event::Dropped(why) => *tally.dropped.entry(why).or_default() += 1,
                Event::Failed => tally.failed += 1,
                Event::Lost => tally.lost += 1,
                Event::FailureDropped(why) => {
                    *tally.failures_dropped.entry(why).or_default() += 1;
                }
                Event::Timer => tally.timers += 1,
                Event::Cancelled => tally.cancelled += 1,
                Event::Sent { bytes } => tally.sent_bytes += bytes,
            }
        }
        if let Some(meter) = self.meters.sources.get(index) {
            meter.count(event);
        }
    }

    /// Counting never panics midway, so what a poisoned lock holds is whole.
    fn lock(&self) -> MutexGuard<'_, Tally> {
        self.tally.lock().unwrap_or_else(PoisonError::into_inner)
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
        self.0.snapshot()
    }

    /// Counts bytes that a call to cloud `p` sends; nothing if there is no such cloud.
    pub fn sent(&self, p: u16, bytes: u64) {
        self.0.sent(p, bytes);
    }
}
