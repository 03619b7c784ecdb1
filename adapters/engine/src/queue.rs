//! The queue to one source: the requests that wait to be sent, those under way, and those that
//! linger.
//!
//! It knows order and bounds, but no rule: other modules decide which request is admitted or
//! closed. [`sources`](crate::sources) has all queues of an operator.

use std::collections::VecDeque;
use std::time::Duration;

use smallvec::SmallVec;

use crate::effect::Effect;
use crate::item::Source;
use crate::outage::OutageLog;

/// One source's outgoing queue and its calls, in the order of admission. Fields that every message
/// needs come first.
#[repr(C, align(64))]
pub(crate) struct SourceQueue<R> {
    waiting: VecDeque<Waiting<R>>,
    in_flight: SmallVec<[InFlightCall; 2]>,
    at_once: usize,
    /// The values of the gauges: how many requests wait, and how many are under way.
    pub(crate) shown: (u32, u32),
    /// The time that a call may run on past its due instant, in ns.
    pub(crate) linger: u64,
    /// The number of messages before its own that a value may be of (D2).
    pub(crate) max_age: u64,
    /// Decides when to log that no results come.
    pub(crate) outage: OutageLog,
    pub(crate) source: Source,
    /// Calls that nothing waits for and that run on, to learn how long they take; at most
    /// `at_once`.
    lingering: VecDeque<InFlightCall>,
    /// Computations that gave their place to another and have not ended, and the greatest number of
    /// them.
    replaced: Vec<InFlightCall>,
    pub(crate) replaceable: usize,
}

/// A request that was admitted and not yet sent.
pub(crate) struct Waiting<R> {
    pub(crate) t: u64,
    pub(crate) requested_at: u64,
    pub(crate) due: Option<u64>,
    /// The time after its start when it counts as lost, in ns; `None` if it is awaited.
    pub(crate) lost_after: Option<u64>,
    /// The time that policies count in addition to the time since the request, in ns; see
    /// [`Budget::spent`](crate::budget::Budget::spent).
    pub(crate) spent: u64,
    pub(crate) request: R,
}

/// A call or computation under way.
struct InFlightCall {
    t: u64,
    requested_at: u64,
    begun_at: u64,
    /// 2⁶⁴ − 1 if it has no timer.
    due: u64,
    /// The instant when it counts as lost; 2⁶⁴ − 1 if it is awaited, or the clock ends before.
    lost: u64,
    spent: u64,
}

/// A request that ended by itself.
pub(crate) struct EndedRequest {
    pub(crate) requested_at: u64,
    /// The instant when it was sent, if it was.
    pub(crate) begun_at: Option<u64>,
    pub(crate) spent: u64,
}

/// A request that ended without a result because nothing waits for it any more.
pub(crate) struct AbandonedRequest {
    pub(crate) t: u64,
    pub(crate) requested_at: u64,
    pub(crate) spent: u64,
    /// `true` if it is under way and may be aborted; otherwise it was never sent.
    pub(crate) was_sent: bool,
}

impl<R> SourceQueue<R> {
    /// Creates an empty queue for at most `at_once` calls at a time, and for at least one.
    pub(crate) fn new(source: Source, at_once: usize) -> Self {
        Self {
            waiting: VecDeque::new(),
            in_flight: SmallVec::new(),
            at_once: at_once.max(1),
            shown: (0, 0),
            linger: 0,
            max_age: 0,
            source,
            outage: OutageLog::default(),
            lingering: VecDeque::new(),
            replaced: Vec::new(),
            replaceable: 0,
        }
    }

    /// Puts an admitted request into the queue.
    pub(crate) fn push(&mut self, request: Waiting<R>) {
        self.waiting.push_back(request);
    }

    /// Takes an admitted request. Returns it if it is to be sent now; otherwise it waits.
    pub(crate) fn admit(&mut self, now: u64, request: Waiting<R>) -> Option<Waiting<R>> {
        if self.waiting.is_empty() && self.has_room() {
            self.begin(now, &request);
            return Some(request);
        }
        self.waiting.push_back(request);
        None
    }

    /// Returns the next request to send at `now`, if one waits and there is room.
    pub(crate) fn next(&mut self, now: u64) -> Option<Waiting<R>> {
        if !self.has_room() {
            return None;
        }
        let next = self.waiting.pop_front()?;
        self.begin(now, &next);
        Some(next)
    }

    /// Returns the effect that sends the request.
    pub(crate) fn start<V>(&self, request: Waiting<R>) -> Effect<V, R> {
        let Waiting { t, due, request, .. } = request;
        let until = due.map(|due| due.saturating_add(self.linger));
        Effect::Start { priority: self.source.priority, timestamp: t, until, request }
    }

    fn has_room(&self) -> bool {
        self.in_flight.len() < self.at_once
    }

    fn begin(&mut self, now: u64, request: &Waiting<R>) {
        let Waiting { t, requested_at, due, lost_after, spent, .. } = *request;
        let due = due.unwrap_or(u64::MAX);
        let lost = lost_after.map_or(u64::MAX, |after| now.saturating_add(after));
        self.in_flight.push(InFlightCall { t, requested_at, begun_at: now, due, lost, spent });
    }

    /// Removes a request that ended by itself, perhaps before it was sent.
    pub(crate) fn end(&mut self, t: u64) -> Option<EndedRequest> {
        self.remove_in_flight(t)
            .or_else(|| self.remove_lingering(t))
            .or_else(|| self.remove_replaced(t))
            .map(|call| EndedRequest {
                requested_at: call.requested_at,
                begun_at: Some(call.begun_at),
                spent: call.spent,
            })
            .or_else(|| self.withdraw(t))
    }

    /// Closes a request whose result is no longer wanted. A call that may linger runs on. Returns
    /// the request that ends, if one does.
    pub(crate) fn close(&mut self, t: u64) -> Option<AbandonedRequest> {
        let Some(call) = self.remove_in_flight(t) else {
            return self.withdraw(t).map(|EndedRequest { requested_at, spent, .. }| {
                AbandonedRequest { t, requested_at, spent, was_sent: false }
            });
        };
        if self.linger == 0 {
            return Some(call.abandoned());
        }
        // Without this bound, a dead cloud would gather more and more lingering calls.
        let oldest = if self.lingering.len() >= self.at_once {
            self.lingering.pop_front().map(InFlightCall::abandoned)
        } else {
            None
        };
        self.lingering.push_back(call);
        oldest
    }

    /// Ends a call that has lingered long enough by `now`, if there is one.
    pub(crate) fn end_lingering(&mut self, now: u64) -> Option<AbandonedRequest> {
        let index = self.lingering.iter().position(|call| self.until(call) <= now)?;
        self.lingering.remove(index).map(InFlightCall::abandoned)
    }

    /// Returns the instant when the next call has lingered long enough.
    pub(crate) fn next_lingering_end(&self) -> Option<u64> {
        self.lingering.iter().map(|call| self.until(call)).min()
    }

    /// Removes a computation that counts as lost by `now`, if there is one. Returns its timestamp.
    pub(crate) fn remove_lost(&mut self, now: u64) -> Option<u64> {
        let index = self.in_flight.iter().position(|call| call.is_lost(now))?;
        Some(self.in_flight.remove(index).t)
    }

    /// Notes a computation that ran past its deadline by `now`. Returns its timestamp, and `true`
    /// if another computation may take its place.
    pub(crate) fn mark_overrun(&mut self, now: u64) -> Option<(u64, bool)> {
        let call = self.in_flight.iter_mut().find(|call| call.is_lost(now))?;
        call.lost = u64::MAX;
        let t = call.t;
        if self.replaced.len() >= self.replaceable {
            return Some((t, false));
        }
        let replaced = self.remove_in_flight(t);
        self.replaced.extend(replaced);
        Some((t, true))
    }

    /// Returns the instant when the next computation counts as lost.
    pub(crate) fn next_lost(&self) -> Option<u64> {
        self.in_flight.iter().map(|call| call.lost).min().filter(|lost| *lost < u64::MAX)
    }

    /// Removes the request from the queue if it waits.
    pub(crate) fn withdraw(&mut self, t: u64) -> Option<EndedRequest> {
        let index = self.waiting.iter().position(|waiting| waiting.t == t)?;
        let Waiting { requested_at, spent, .. } = self.waiting.remove(index)?;
        Some(EndedRequest { requested_at, begun_at: None, spent })
    }

    /// Returns the message that has waited longest.
    pub(crate) fn oldest_waiting(&self) -> Option<u64> {
        self.waiting.front().map(|waiting| waiting.t)
    }

    /// Writes the age of each unanswered request at `now`, as policies count it, the oldest first,
    /// with those that linger.
    pub(crate) fn ages(&self, now: u64, ages: &mut Vec<Duration>) {
        let in_flight = self.in_flight.iter().chain(&self.lingering);
        let in_flight = in_flight.map(|call| (call.requested_at, call.spent));
        let waiting = self.waiting.iter().map(|waiting| (waiting.requested_at, waiting.spent));
        ages.clear();
        ages.extend(in_flight.chain(waiting).map(|(requested_at, spent)| {
            Duration::from_nanos(now.saturating_sub(requested_at).saturating_add(spent))
        }));
        ages.sort_unstable_by(|one, other| other.cmp(one));
    }

    /// Returns the values for the gauges, which are far below 2³².
    pub(crate) fn to_show(&self) -> (u32, u32) {
        let count = |len| u32::try_from(len).unwrap_or(u32::MAX);
        (count(self.waiting.len()), count(self.in_flight.len()))
    }

    /// Returns the length of the outgoing queue, without calls under way (D4, F2).
    pub(crate) fn backlog(&self) -> usize {
        self.waiting.len()
    }

    fn remove_in_flight(&mut self, t: u64) -> Option<InFlightCall> {
        let index = self.in_flight.iter().position(|call| call.t == t)?;
        Some(self.in_flight.remove(index))
    }

    fn remove_replaced(&mut self, t: u64) -> Option<InFlightCall> {
        let index = self.replaced.iter().position(|call| call.t == t)?;
        Some(self.replaced.remove(index))
    }

    /// Returns `true` if any request waits.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    fn remove_lingering(&mut self, t: u64) -> Option<InFlightCall> {
        let index = self.lingering.iter().position(|call| call.t == t)?;
        self.lingering.remove(index)
    }

    fn until(&self, call: &InFlightCall) -> u64 {
        call.due.saturating_add(self.linger)
    }
}

impl InFlightCall {
    const fn is_lost(&self, now: u64) -> bool {
        self.lost <= now && self.lost < u64::MAX
    }

    const fn abandoned(self) -> AbandonedRequest {
        let Self { t, requested_at, spent, .. } = self;
        AbandonedRequest { t, requested_at, spent, was_sent: true }
    }
}
