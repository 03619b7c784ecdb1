//! Side requests: calls whose answers change shared state and never become an output.
//!
//! [`Setup::use_side_request`](crate::Setup::use_side_request) registers them. The machine does not know of them, so no item
//! waits for one.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fuseline_engine::Gate;
use futures_util::future::BoxFuture;
use metrics::{Counter, counter};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio::time::{Instant, timeout};
use tracing::{Instrument, debug, debug_span, error, warn};

use crate::Error;
use crate::error_chain::ErrorChain;
use crate::panics::{guarded, panicked, reason};
use crate::setup::{ByteCounter, Call};

/// The queue and bounds of a [side request](crate::Setup::use_side_request), with defaults.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SideRequest {
    /// For people and metrics; `side-` and its place, from 1, by default.
    pub name: String,
    /// The gate shuts when this many requests wait to be sent (F2g); at least 1, 31 by default.
    pub limit: u64,
    /// The shut gate opens when this many or fewer wait; less than `limit`, 0 by default.
    pub resume: u64,
    /// How many calls may be under way; at least 1, 8 by default. Further requests wait.
    pub calls: usize,
}

/// One side request's counts since the operator's start.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SideTally {
    /// Its name.
    pub name: String,
    /// Requests that the gate let pass.
    pub requested: u64,
    /// Requests that the gate refused, or whose deadline was zero.
    pub refused: u64,
    /// Answers that came in time and that the response handler accepted.
    pub answered: u64,
    /// Calls and response handlers that failed.
    pub failed: u64,
    /// Requests that were due before an answer came.
    pub expired: u64,
    /// Bytes that its calls report as sent.
    pub sent_bytes: u64,
}

/// A request that knows its handle and its response handler.
pub(crate) type SideCall =
    Box<dyn FnOnce(Call) -> BoxFuture<'static, Result<SideResponse, Error>> + Send>;
/// The answer on its way to the response handler.
pub(crate) type SideResponse = Box<dyn FnOnce() -> Result<(), Error> + Send>;
/// The message handler.
pub(crate) type SideHandler<I> = Box<dyn FnMut(&I, u64) -> Option<(SideCall, Duration)> + Send>;

/// A side request as it was registered.
pub(crate) struct SideRegistration<I> {
    pub(crate) side: SideRequest,
    pub(crate) wonder: SideHandler<I>,
}

/// A running side request. Dropping it aborts its calls.
pub(crate) struct SideRunner<I> {
    wonder: SideHandler<I>,
    gate: Gate,
    places: Arc<Semaphore>,
    counts: Arc<SideCounts>,
    calls: JoinSet<()>,
}

/// A side request's counts, to be read from anywhere.
pub(crate) struct SideCounts {
    name: String,
    /// Requests that wait for a place.
    waiting: AtomicU64,
    requested: Count,
    refused: Count,
    answered: Count,
    failed: Count,
    expired: Count,
    sent_bytes: Count,
}

struct Count(AtomicU64, Counter);

/// Counts a request as waiting as long as it lives.
struct WaitingGuard(Arc<SideCounts>);

impl<I> SideRunner<I> {
    /// A side request ready to be made; none unless `resume < limit`.
    pub(crate) fn new(
        operator: &str,
        SideRegistration { side, wonder }: SideRegistration<I>,
    ) -> Option<Self> {
        let gate = Gate::new(side.limit, side.resume)?;
        let places = side.calls.clamp(1, Semaphore::MAX_PERMITS);
        Some(Self {
            wonder,
            gate,
            places: Arc::new(Semaphore::new(places)),
            counts: Arc::new(SideCounts::new(operator, side.name)),
            calls: JoinSet::new(),
        })
    }

    pub(crate) fn counts(&self) -> Arc<SideCounts> {
        Arc::clone(&self.counts)
    }

    /// Makes a call for a message that was taken on, if the message handler gives one.
    pub(crate) fn ask(&mut self, message: &I, timestamp: u64) {
        while self.calls.try_join_next().is_some() {}
        let name = &self.counts.name;
        let wondered = catch_unwind(AssertUnwindSafe(|| (self.wonder)(message, timestamp)));
        let (question, deadline) = match wondered {
            Ok(Some(wondered)) => wondered,
            Ok(None) => return,
            Err(panic) => {
                let why = reason(&*panic);
                error!(timestamp, side = name, why, "the message handler panicked");
                return;
            }
        };
        if deadline.is_zero() || !self.gate.admits(self.counts.waiting.load(Ordering::Relaxed)) {
            debug!(timestamp, side = name, "aside refused");
            self.counts.refused.add(1);
            return;
        }
        self.counts.requested.add(1);
        let (requested, counts) = (Instant::now(), Arc::clone(&self.counts));
        // A request that finds a place at once does not wait.
        let place = Arc::clone(&self.places).try_acquire_owned().ok();
        let places = Arc::clone(&self.places);
        let waits = place.is_none().then(|| WaitingGuard::new(&counts));
        let work = async move {
            let place = match place {
                Some(place) => Ok(place),
                None => places.acquire_owned().await,
            };
            drop(waits);
            let left = deadline.saturating_sub(requested.elapsed());
            let byte_counter = ByteCounter::SideRequest(Arc::clone(&counts));
            let answer = guarded(question(Call { timestamp, deadline: left, byte_counter })).await;
            drop(place);
            // As everywhere, an answer at the due instant is late.
            if requested.elapsed() < deadline {
                counts.settle(timestamp, answer);
            } else {
                counts.expire(timestamp);
            }
        };
        let counts = Arc::clone(&self.counts);
        let call = async move {
            if timeout(deadline, work).await.is_err() {
                counts.expire(timestamp);
            }
        };
        self.calls.spawn(call.instrument(debug_span!("aside", name, timestamp)));
    }
}

impl SideCounts {
    fn new(operator: &str, name: String) -> Self {
        let labels = [("operator", operator.to_owned()), ("aside", name.clone())];
        let by = |outcome: &str| {
            let [operator, side] = labels.clone();
            let labels = [operator, side, ("outcome", outcome.to_owned())];
            Count(AtomicU64::new(0), counter!("fuseline_asides_total", &labels))
        };
        Self {
            waiting: AtomicU64::new(0),
            requested: by("asked"),
            refused: by("refused"),
            answered: by("answered"),
            failed: by("failed"),
            expired: by("expired"),
            sent_bytes: Count(
                AtomicU64::new(0),
                counter!("fuseline_aside_sent_bytes_total", &labels),
            ),
            name,
        }
    }

    pub(crate) fn sent(&self, bytes: u64) {
        self.sent_bytes.add(bytes);
    }

    pub(crate) fn tally(&self) -> SideTally {
        SideTally {
            name: self.name.clone(),
            requested: self.requested.read(),
            refused: self.refused.read(),
            answered: self.answered.read(),
            failed: self.failed.read(),
            expired: self.expired.read(),
            sent_bytes: self.sent_bytes.read(),
        }
    }

    /// Gives an answer that came in time to the response handler.
    fn settle(&self, timestamp: u64, answer: Result<SideResponse, Error>) {
        let taken = answer.and_then(|take| {
            catch_unwind(AssertUnwindSafe(take)).unwrap_or_else(|panic| Err(panicked(&*panic)))
        });
        match taken {
            Ok(()) => self.answered.add(1),
            Err(error) => {
                let why = ErrorChain(&*error);
                warn!(timestamp, side = self.name, %why, "no answer will come");
                self.failed.add(1);
            }
        }
    }

    fn expire(&self, timestamp: u64) {
        debug!(timestamp, side = self.name, "aside given up: it is due");
        self.expired.add(1);
    }
}

impl fmt::Debug for SideCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tally().fmt(f)
    }
}

impl Count {
    fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
        self.1.increment(count);
    }

    fn read(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl WaitingGuard {
    fn new(counts: &Arc<SideCounts>) -> Self {
        counts.waiting.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(counts))
    }
}

impl Drop for WaitingGuard {
    fn drop(&mut self) {
        self.0.waiting.fetch_sub(1, Ordering::Relaxed);
    }
}
