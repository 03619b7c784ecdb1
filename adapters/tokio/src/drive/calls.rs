//! The calls under way, as tasks or within the driver, and local's async computations.
//!
//! This module starts and aborts calls. The engine decides when.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

use fuseline_engine::{Counting, StampedValue};
use futures_util::future::BoxFuture;
use rustc_hash::FxHashMap;
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tracing::Instrument;

use crate::Error;
use crate::drive::Completion;
use crate::drive::clock::DriverClock;
use crate::drive::measured_call::MeasuredCall;
use crate::drive::spans::TracedCall;
use crate::drive::wake_flag::DriverWaker;
use crate::panics::{guarded, panicked};

/// Priority and timestamp.
type CallKey = (u16, u64);
/// A source's call or computation.
type CallFuture<V> = BoxFuture<'static, Result<StampedValue<V>, Error>>;

/// The calls under way. Dropping this aborts them, except for local's computations (F7).
///
/// On a runtime of several threads each call runs in a task of its own, so that no computation
/// blocks another. On a runtime of one thread a task would block the others all the same. There
/// the calls run within the driver, which costs half as much.
pub(super) enum Calls<V: Send + 'static> {
    Tasks {
        completions: mpsc::UnboundedReceiver<Completion<V>>,
        sender: mpsc::UnboundedSender<Completion<V>>,
        under_way: FxHashMap<CallKey, AbortHandle>,
        counting: Counting,
    },
    InlineCalls(InlineCalls<V>),
}

/// Calls that run within the driver's task.
pub(super) struct InlineCalls<V> {
    slots: Vec<CallSlot<V>>,
    /// The first free slot, if there is one.
    free: Option<u32>,
    /// The bits of the slots whose turn it is. Slots with the same index modulo 64 share a bit and
    /// are polled together.
    turns: u64,
    driver: Arc<DriverWaker>,
    counting: Counting,
}

/// Room for one call, with one waker for all calls that use it in turn. Its alignment gives it a
/// cache line of its own.
#[repr(align(64))]
struct CallSlot<V> {
    call: Option<RunningCall<V>>,
    waker: Waker,
    /// The next free slot, if this is one.
    next_free: Option<u32>,
}

struct RunningCall<V> {
    key: CallKey,
    call: CallFuture<V>,
    span: TracedCall,
}

/// Wakes the driver for one slot's call.
struct SlotWaker {
    driver: Arc<DriverWaker>,
    index: u32,
}

impl<V: Send + 'static> Calls<V> {
    /// Creates an empty set of calls on the current runtime. `driver` wakes the driver, and
    /// `counting` counts calls that block.
    pub(super) fn new(driver: Arc<DriverWaker>, counting: Counting) -> Self {
        let flavor = Handle::try_current().map(|runtime| runtime.runtime_flavor());
        if matches!(flavor, Ok(RuntimeFlavor::CurrentThread)) {
            return Self::InlineCalls(InlineCalls {
                slots: Vec::new(),
                free: None,
                turns: 0,
                driver,
                counting,
            });
        }
        let (sender, completions) = mpsc::unbounded_channel();
        Self::Tasks { completions, sender, under_way: FxHashMap::default(), counting }
    }

    pub(super) fn begin(&mut self, key: CallKey, call: CallFuture<V>, mut span: TracedCall) {
        match self {
            Self::InlineCalls(inline) => inline.begin(RunningCall { key, call, span }),
            Self::Tasks { sender, under_way, counting, .. } => {
                let (priority, timestamp) = key;
                let call = MeasuredCall { priority, call, counting: counting.clone() };
                let sender = sender.clone();
                let entered = span.span();
                let task = async move {
                    let result = guarded(call).await;
                    span.end(&result);
                    // Sending fails once the driver has ended, and nobody needs the result then.
                    drop(sender.send(Completion { priority, timestamp, result }));
                };
                let task = tokio::spawn(task.instrument(entered));
                // F7: local is never aborted.
                if priority > 0 {
                    under_way.insert(key, task.abort_handle());
                }
            }
        }
    }

    /// Drops the call's future, if it is under way.
    pub(super) fn abort(&mut self, priority: u16, timestamp: u64) {
        match self {
            Self::Tasks { under_way, .. } => {
                if let Some(call) = under_way.remove(&(priority, timestamp)) {
                    call.abort();
                }
            }
            Self::InlineCalls(inline) => {
                let key = Some((priority, timestamp));
                let is_it =
                    |slot: &CallSlot<V>| slot.call.as_ref().map(|running| running.key) == key;
                // F7: local is never aborted.
                if priority > 0
                    && let Some(index) = inline.slots.iter().position(is_it)
                {
                    inline.clear(index);
                }
            }
        }
    }

    /// Returns the next end of a call, and the clock's reading after it.
    pub(super) fn poll_completion(
        &mut self,
        clock: DriverClock,
        context: &mut Context<'_>,
    ) -> Poll<(Completion<V>, u64)> {
        match self {
            Self::Tasks { completions, under_way, .. } => match completions.poll_recv(context) {
                Poll::Ready(Some(completion)) => {
                    under_way.remove(&(completion.priority, completion.timestamp));
                    Poll::Ready((completion, clock.now()))
                }
                // The channel does not end, because `self` holds a sender.
                Poll::Ready(None) | Poll::Pending => Poll::Pending,
            },
            Self::InlineCalls(inline) => inline.poll_completion(clock),
        }
    }
}

impl<V> InlineCalls<V> {
    fn begin(&mut self, running: RunningCall<V>) {
        let index = self.free.take().unwrap_or_else(|| {
            let (index, driver) = (slot_index(self.slots.len()), Arc::clone(&self.driver));
            let waker = Waker::from(Arc::new(SlotWaker { driver, index }));
            self.slots.push(CallSlot { call: None, waker, next_free: None });
            index
        });
        let slot = &mut self.slots[index as usize];
        self.free = slot.next_free.take();
        slot.call = Some(running);
        // The driver polls the call before it sleeps.
        self.turns |= slot_bit(index);
    }

    fn poll_completion(&mut self, clock: DriverClock) -> Poll<(Completion<V>, u64)> {
        // A call that keeps waking itself is polled once each time, so the other calls get their
        // turns.
        self.turns |= self.driver.take_woken();
        // The next poll begins at the instant at which the one before it ended.
        let mut ended = None;
        while self.turns != 0 {
            let first = self.turns.trailing_zeros() as usize;
            for index in (first..self.slots.len()).step_by(64) {
                if let Some(completion) = self.poll_slot(index, clock, &mut ended) {
                    return Poll::Ready(completion);
                }
            }
            self.turns &= self.turns - 1;
        }
        Poll::Pending
    }

    /// Polls the call in this slot. There may be none, because a waker may outlive its call.
    /// `ended` is the instant at which the poll before this one ended, if there was one, and
    /// afterwards the instant at which this one ended.
    fn poll_slot(
        &mut self,
        index: usize,
        clock: DriverClock,
        ended: &mut Option<u64>,
    ) -> Option<(Completion<V>, u64)> {
        let CallSlot { call, waker, .. } = &mut self.slots[index];
        let RunningCall { key, call, span } = call.as_mut()?;
        let begin = ended.unwrap_or_else(|| clock.now());
        let entered = span.enter();
        let mut context = Context::from_waker(waker);
        let polled = catch_unwind(AssertUnwindSafe(|| call.as_mut().poll(&mut context)));
        drop(entered);
        // This reading is also the result's instant (F0). So it comes after the response handler,
        // which is part of the call, and before anything else.
        let end = *ended.insert(clock.now());
        let (priority, timestamp) = *key;
        if polled.is_ok() {
            self.counting.check_handler_time(
                Some(priority),
                Duration::from_nanos(end.saturating_sub(begin)),
            );
        }
        let result = match polled {
            Ok(Poll::Pending) => return None,
            Ok(Poll::Ready(result)) => result,
            Err(panic) => Err(panicked(&*panic)),
        };
        span.end(&result);
        self.clear(index);
        Some((Completion { priority, timestamp, result }, end))
    }

    /// Lets local's computations go on in tasks of their own, as long as the runtime does (F7).
    /// Drops all other calls.
    fn release(&mut self)
    where
        V: Send + 'static,
    {
        let runtime = Handle::try_current();
        let counting = &self.counting;
        for running in self.slots.iter_mut().filter_map(|slot| slot.call.take()) {
            match (&runtime, running) {
                (Ok(runtime), RunningCall { key: (0, _), call, mut span }) => {
                    let entered = span.span();
                    let call = MeasuredCall { priority: 0, call, counting: counting.clone() };
                    let task = async move { span.end(&guarded(call).await) };
                    drop(runtime.spawn(task.instrument(entered)));
                }
                (_, running) => end(running),
            }
        }
    }

    fn clear(&mut self, index: usize) {
        let slot = &mut self.slots[index];
        let call = slot.call.take();
        slot.next_free = self.free.replace(slot_index(index));
        end(call);
    }
}

// No memory holds 2³² calls.
fn slot_index(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

const fn slot_bit(index: u32) -> u64 {
    1 << (index % 64)
}

/// Drops a call, and catches a panic of its destructor (D7).
fn end<T>(call: T) {
    drop(catch_unwind(AssertUnwindSafe(|| drop(call))));
}

impl<V: Send + 'static> Drop for Calls<V> {
    fn drop(&mut self) {
        match self {
            Self::Tasks { under_way, .. } => under_way.values().for_each(AbortHandle::abort),
            Self::InlineCalls(inline) => inline.release(),
        }
    }
}

impl Wake for SlotWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.driver.wake_slot(slot_bit(self.index));
    }
}
