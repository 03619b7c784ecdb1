//! The calls that threads made at the machine and when, and the search for one order that explains
//! them.

use std::collections::{BTreeMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use fuseline_core::{Deadline, Instant, Priority, Timestamp};
use fuseline_threads::{MessageId, Owner, SharedHandle};

use crate::common::input::{CallAnswer, CallInput, Timed};
use crate::common::sequential::Sequential;

/// One call. It took effect somewhere between `began` and `ended`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimedCall {
    /// The caller's clock and input.
    pub(crate) input: Timed,
    pub(crate) answer: CallAnswer,
    /// The reading of the history's own clock before the call.
    pub(crate) began: u64,
    /// The reading of the history's own clock after the call.
    pub(crate) ended: u64,
}

/// The calls of all threads. Loom does not simulate the clock and the lock of the history.
#[derive(Debug, Default)]
pub(crate) struct CallHistory {
    clock: AtomicU64,
    calls: Mutex<Vec<TimedCall>>,
}

/// The data that one thread needs to make calls.
#[derive(Debug)]
pub(crate) struct ThreadHandle<'a, const CLOUDS: usize, const WINDOW: usize> {
    history: &'a CallHistory,
    handle: &'a SharedHandle<CLOUDS, WINDOW>,
    owner: Option<Owner<'a, CLOUDS, WINDOW>>,
    tickets: BTreeMap<u64, MessageId>,
}

impl CallHistory {
    /// Creates a history of these calls.
    #[must_use]
    #[cfg(not(loom))]
    pub(crate) const fn of(calls: Vec<TimedCall>) -> Self {
        Self { clock: AtomicU64::new(0), calls: Mutex::new(calls) }
    }

    /// Returns the calls in the order in which they began.
    #[must_use]
    pub(crate) fn calls(&self) -> Vec<TimedCall> {
        let mut calls = self.calls.lock().unwrap_or_else(PoisonError::into_inner).clone();
        calls.sort_by_key(|call| call.began);
        calls
    }

    /// Returns `true` if some order of the calls makes `machine` give the same answers. In this
    /// order, a call that began after another had ended must come after it.
    ///
    /// # Panics
    /// Panics if there is no call, or if there are more than 64.
    #[must_use]
    pub(crate) fn is_explained_by(&self, machine: &Sequential) -> bool {
        let calls = self.calls();
        assert!(!calls.is_empty() && calls.len() <= 64, "{} calls", calls.len());
        let all = u64::MAX >> (64 - calls.len());
        let mut seen = HashSet::new();
        let mut next = vec![(0_u64, machine.clone())];
        while let Some((done, machine)) = next.pop() {
            if done == all {
                return true;
            }
            let remaining = || calls.iter().enumerate().filter(|(i, _)| done & 1 << i == 0);
            let first_end = remaining().map(|(_, call)| call.ended).min().unwrap_or(u64::MAX);
            for (i, call) in remaining().filter(|(_, call)| call.began <= first_end) {
                let mut machine = machine.clone();
                if machine.apply(call.input.0, call.input.1) == call.answer {
                    let state = (done | 1 << i, machine);
                    if seen.insert(state.clone()) {
                        next.push(state);
                    }
                }
            }
        }
        false
    }

    fn now(&self) -> u64 {
        self.clock.fetch_add(1, Ordering::SeqCst)
    }
}

impl<'a, const CLOUDS: usize, const WINDOW: usize> ThreadHandle<'a, CLOUDS, WINDOW> {
    /// Returns the owner's handle.
    #[must_use]
    pub(crate) const fn owner(
        history: &'a CallHistory,
        handle: &'a SharedHandle<CLOUDS, WINDOW>,
        owner: Owner<'a, CLOUDS, WINDOW>,
    ) -> Self {
        Self { history, handle, owner: Some(owner), tickets: BTreeMap::new() }
    }

    /// Returns the handle of another thread, with the same message ids.
    #[must_use]
    pub(crate) fn other(&self) -> Self {
        let (history, handle, tickets) = (self.history, self.handle, self.tickets.clone());
        Self { history, handle, owner: None, tickets }
    }

    /// Makes these calls one after the other, each after a `pause`. Leaves out calls about messages
    /// that this thread has no id for.
    pub(crate) fn make(&mut self, calls: &[Timed], mut pause: impl FnMut()) {
        for input in calls {
            pause();
            let began = self.history.now();
            let Some(answer) = self.call(*input) else { continue };
            let ended = self.history.now();
            let call = TimedCall { input: *input, answer, began, ended };
            self.history.calls.lock().unwrap_or_else(PoisonError::into_inner).push(call);
        }
    }

    fn call(&mut self, (now, input): Timed) -> Option<CallAnswer> {
        let now = Instant::from_nanos(now);
        let message_id = self.tickets.get(&input.timestamp()).copied();
        Some(match input {
            CallInput::Open { t, deadline } => {
                let deadline = deadline.map(Deadline::from_nanos);
                let opened = self.owner.as_mut()?.open(now, Timestamp::new(t), deadline);
                self.tickets.extend(opened.map(|message_id| (t, message_id)));
                CallAnswer::Opened(opened.map(drop))
            }
            CallInput::Offer { p, deadline, backlog, .. } => {
                let deadline = Deadline::from_nanos(deadline);
                let owner = self.owner.as_mut()?;
                CallAnswer::offered(owner.offer(now, message_id?, priority(p), deadline, backlog))
            }
            CallInput::Result { p, .. } => {
                CallAnswer::closed(self.handle.result(now, message_id?, priority(p)))
            }
            CallInput::Fail { p, .. } => {
                CallAnswer::closed(self.handle.fail(now, message_id?, priority(p)))
            }
            CallInput::Tick { .. } => CallAnswer::ticked(self.handle.expire(now, message_id?)),
            CallInput::NextDue { .. } => CallAnswer::due(self.handle.next_due(message_id?)),
        })
    }
}

fn priority(p: u8) -> Priority {
    Priority::new(p.into())
}
