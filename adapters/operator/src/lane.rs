//! The way to one source: what waits to be sent and what is under way.

use std::collections::VecDeque;

use crate::item::Source;

/// One source's outgoing queue and its calls, in the order of admission.
pub(crate) struct Lane<R> {
    pub(crate) source: Source,
    waiting: VecDeque<Waiting<R>>,
    flying: Vec<Flight>,
    at_once: usize,
}

/// A request that was admitted and not yet sent.
pub(crate) struct Waiting<R> {
    pub(crate) t: u64,
    pub(crate) asked: u64,
    pub(crate) due: Option<u64>,
    /// How long after its start it counts as lost; none if it is sure to end.
    pub(crate) lost_after: Option<u64>,
    pub(crate) request: R,
}

/// A call or computation under way.
struct Flight {
    t: u64,
    asked: u64,
    /// When it counts as lost.
    lost: Option<u64>,
}

impl<R> Lane<R> {
    /// An empty lane with at most `at_once` calls under way, at least one.
    pub(crate) fn new(source: Source, at_once: usize) -> Self {
        let at_once = at_once.max(1);
        Self { source, waiting: VecDeque::new(), flying: Vec::new(), at_once }
    }

    pub(crate) fn push(&mut self, waiting: Waiting<R>) {
        self.waiting.push_back(waiting);
    }

    /// The next request to send at `now`, if one waits and there is room.
    pub(crate) fn next(&mut self, now: u64) -> Option<Waiting<R>> {
        if self.flying.len() >= self.at_once {
            return None;
        }
        let next = self.waiting.pop_front()?;
        let lost = next.lost_after.map(|after| now.saturating_add(after));
        self.flying.push(Flight { t: next.t, asked: next.asked, lost });
        Some(next)
    }

    /// The request has ended by itself, perhaps before it was sent; says when it was asked for.
    pub(crate) fn end(&mut self, t: u64) -> Option<u64> {
        self.land(t).or_else(|| self.withdraw(t))
    }

    /// The result is no longer wanted. Says whether a call is under way that may be aborted.
    pub(crate) fn close(&mut self, t: u64) -> bool {
        let is_flying = self.land(t).is_some();
        if !is_flying {
            self.withdraw(t);
        }
        is_flying
    }

    /// Takes back the place of one that is lost by `now`, if there is one; says whose it was.
    pub(crate) fn give_up(&mut self, now: u64) -> Option<u64> {
        let is_lost = |flight: &Flight| flight.lost.is_some_and(|lost| lost <= now);
        let place = self.flying.iter().position(is_lost)?;
        Some(self.flying.remove(place).t)
    }

    /// When one that waits would find the place of one that is lost; none if nothing waits.
    pub(crate) fn next_lost(&self) -> Option<u64> {
        if self.waiting.is_empty() {
            return None;
        }
        self.flying.iter().filter_map(|flight| flight.lost).min()
    }

    /// Takes it out of the queue if it waits; says when it was asked for.
    pub(crate) fn withdraw(&mut self, t: u64) -> Option<u64> {
        let place = self.waiting.iter().position(|waiting| waiting.t == t)?;
        self.waiting.remove(place).map(|waiting| waiting.asked)
    }

    fn land(&mut self, t: u64) -> Option<u64> {
        let place = self.flying.iter().position(|flight| flight.t == t)?;
        Some(self.flying.remove(place).asked)
    }

    /// F2: the length of the outgoing queue, calls under way not counted.
    pub(crate) fn backlog(&self) -> usize {
        self.waiting.len()
    }

    pub(crate) fn flying(&self) -> usize {
        self.flying.len()
    }
}
