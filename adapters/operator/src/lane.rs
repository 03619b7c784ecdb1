//! The way to one source: what waits to be sent and what is under way.

use std::collections::{HashMap, VecDeque};

use crate::item::Source;

/// One source's outgoing queue and its calls, in the order of admission.
pub(crate) struct Lane<R> {
    pub(crate) source: Source,
    waiting: VecDeque<Waiting<R>>,
    /// When those under way were asked for, by timestamp.
    flying: HashMap<u64, u64>,
    at_once: usize,
}

/// A request that was admitted and not yet sent.
pub(crate) struct Waiting<R> {
    pub(crate) t: u64,
    pub(crate) asked: u64,
    pub(crate) due: Option<u64>,
    pub(crate) request: R,
}

impl<R> Lane<R> {
    /// An empty lane with at most `at_once` calls under way, at least one.
    pub(crate) fn new(source: Source, at_once: usize) -> Self {
        let at_once = at_once.max(1);
        Self { source, waiting: VecDeque::new(), flying: HashMap::new(), at_once }
    }

    pub(crate) fn push(&mut self, waiting: Waiting<R>) {
        self.waiting.push_back(waiting);
    }

    /// The next request to send, if one waits and there is room.
    pub(crate) fn next(&mut self) -> Option<Waiting<R>> {
        if self.flying.len() >= self.at_once {
            return None;
        }
        let next = self.waiting.pop_front()?;
        self.flying.insert(next.t, next.asked);
        Some(next)
    }

    /// The request has ended by itself, perhaps before it was sent; says when it was asked for.
    pub(crate) fn end(&mut self, t: u64) -> Option<u64> {
        self.flying.remove(&t).or_else(|| self.withdraw(t))
    }

    /// The result is no longer wanted. Says whether a call is under way that may be aborted.
    pub(crate) fn close(&mut self, t: u64) -> bool {
        let is_flying = self.flying.remove(&t).is_some();
        if !is_flying {
            self.withdraw(t);
        }
        is_flying
    }

    fn withdraw(&mut self, t: u64) -> Option<u64> {
        let place = self.waiting.iter().position(|waiting| waiting.t == t)?;
        self.waiting.remove(place).map(|waiting| waiting.asked)
    }

    /// F2: the length of the outgoing queue, calls under way not counted.
    pub(crate) fn backlog(&self) -> usize {
        self.waiting.len()
    }

    pub(crate) fn flying(&self) -> usize {
        self.flying.len()
    }
}
