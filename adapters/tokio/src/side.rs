//! Side requests: calls whose answers change shared state and never become an output.
//!
//! [`Setup::use_side_request`](crate::Setup::use_side_request) registers them. The machine does not
//! know of them, so no item waits for one.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Gate, Lineage};
use futures_util::future::BoxFuture;
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio::time::{Instant, timeout};
use tracing::{Instrument, debug, debug_span, error, warn};

use crate::Error;
use crate::call::{ByteCounter, Call};
use crate::error_chain::ErrorChain;
use crate::panics::{guarded, panicked, reason};
use crate::side_counts::{SideCounts, WaitingGuard};

/// Configures the queue and the bounds of a [side request](crate::Setup::use_side_request).
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SideRequest {
    /// The name for people and metrics; by default `side-` and its number, from 1.
    pub name: String,
    /// The number of waiting requests at which the gate shuts (F2g); at least 1, 8 by default.
    pub limit: u64,
    /// The number of waiting requests at or below which the shut gate opens; less than `limit`, 0
    /// by default.
    pub resume: u64,
    /// The greatest number of calls under way; at least 1, 8 by default. Further requests wait.
    pub calls: usize,
}

/// A request that knows its handle and its response handler.
pub(crate) type SideCall =
    Box<dyn FnOnce(Call) -> BoxFuture<'static, Result<SideResponse, Error>> + Send>;
/// Gives an answer to the response handler.
pub(crate) type SideResponse = Box<dyn FnOnce() -> Result<(), Error> + Send>;
/// The message handler.
pub(crate) type SideHandler<I> = Box<dyn FnMut(&I, u64) -> Option<(SideCall, Duration)> + Send>;

/// A side request as it was registered.
pub(crate) struct SideRegistration<I> {
    pub(crate) side: SideRequest,
    pub(crate) message_handler: SideHandler<I>,
}

/// A running side request. Dropping it aborts its calls.
pub(crate) struct SideRunner<I> {
    message_handler: SideHandler<I>,
    gate: Gate,
    permits: Arc<Semaphore>,
    counts: Arc<SideCounts>,
    calls: JoinSet<()>,
}

impl<I> SideRunner<I> {
    /// Creates the running side request. Returns `None` if `resume` is not less than `limit`.
    pub(crate) fn new(
        operator: &str,
        SideRegistration { side, message_handler }: SideRegistration<I>,
    ) -> Option<Self> {
        let gate = Gate::new(side.limit, side.resume)?;
        let permits = side.calls.clamp(1, Semaphore::MAX_PERMITS);
        Some(Self {
            message_handler,
            gate,
            permits: Arc::new(Semaphore::new(permits)),
            counts: Arc::new(SideCounts::new(operator, side.name)),
            calls: JoinSet::new(),
        })
    }

    pub(crate) fn counts(&self) -> Arc<SideCounts> {
        Arc::clone(&self.counts)
    }

    /// Sends a request about an accepted message, if the message handler returns one.
    pub(crate) fn on_message(
        &mut self,
        message: &I,
        timestamp: u64,
        lineage: Option<&Arc<Lineage>>,
    ) {
        while self.calls.try_join_next().is_some() {}
        let name = &self.counts.name;
        let handled = catch_unwind(AssertUnwindSafe(|| (self.message_handler)(message, timestamp)));
        let (request, deadline) = match handled {
            Ok(Some(request)) => request,
            Ok(None) => return,
            Err(panic) => {
                let why = reason(&*panic);
                error!(timestamp, side = name, why, "the message handler panicked");
                self.counts.handler_failed.add(1);
                return;
            }
        };
        if deadline.is_zero() || !self.gate.admits(self.counts.waiting()) {
            debug!(timestamp, side = name, "side request refused");
            self.counts.refused.add(1);
            return;
        }
        self.counts.requested.add(1);
        let lineage = lineage.cloned();
        let (requested, counts) = (Instant::now(), Arc::clone(&self.counts));
        // A request that gets a permit at once does not wait.
        let permit = Arc::clone(&self.permits).try_acquire_owned().ok();
        let permits = Arc::clone(&self.permits);
        let waits = permit.is_none().then(|| WaitingGuard::new(&counts));
        let work = async move {
            let permit = match permit {
                Some(permit) => Ok(permit),
                None => permits.acquire_owned().await,
            };
            drop(waits);
            let remaining = deadline.saturating_sub(requested.elapsed());
            let byte_counter = ByteCounter::SideRequest(Arc::clone(&counts));
            let call = Call { timestamp, deadline: remaining, lineage, byte_counter };
            let answer = guarded(request(call)).await;
            drop(permit);
            // An answer at the due instant is late, as in F3.
            if requested.elapsed() < deadline {
                settle(&counts, timestamp, answer);
            } else {
                expire(&counts, timestamp);
            }
        };
        let counts = Arc::clone(&self.counts);
        let call = async move {
            if timeout(deadline, work).await.is_err() {
                expire(&counts, timestamp);
            }
        };
        self.calls.spawn(call.instrument(debug_span!("side_request", name, timestamp)));
    }
}

/// Gives an answer that came in time to the response handler.
fn settle(counts: &SideCounts, timestamp: u64, answer: Result<SideResponse, Error>) {
    let handled = answer.and_then(|handle_response| {
        catch_unwind(AssertUnwindSafe(handle_response))
            .unwrap_or_else(|panic| Err(panicked(&*panic)))
    });
    match handled {
        Ok(()) => counts.answered.add(1),
        Err(error) => {
            let why = ErrorChain(&*error);
            warn!(timestamp, side = counts.name, %why, "no answer will come");
            counts.failed.add(1);
        }
    }
}

fn expire(counts: &SideCounts, timestamp: u64) {
    debug!(timestamp, side = counts.name, "side request expired");
    counts.expired.add(1);
}
