//! The way to one source: what waits to be sent and what is under way.

use std::collections::VecDeque;
use std::time::Duration;

use fuseline_deadline::Policy;

use crate::item::Source;
use crate::tally::InForce;

/// One source's outgoing queue and its calls, in the order of admission.
pub(crate) struct Lane<R> {
    pub(crate) source: Source,
    waiting: VecDeque<Waiting<R>>,
    flying: Vec<Flight>,
    /// Calls that were given up and run on, to see how long they really take; at most `at_once`.
    lingering: VecDeque<Flight>,
    at_once: usize,
    /// How long a call may run on past its due instant, in ns.
    pub(crate) linger: u64,
    pub(crate) policy: Option<Box<dyn Policy + Send>>,
    /// The deadline of the latest offer.
    pub(crate) in_force: Option<InForce>,
    /// What the gauges show: how many wait, and how many are under way.
    pub(crate) shown: (usize, usize),
}

/// A request that was admitted and not yet sent.
pub(crate) struct Waiting<R> {
    pub(crate) t: u64,
    pub(crate) asked: u64,
    pub(crate) due: Option<u64>,
    /// How long after its start it counts as lost, in ns; none if it always ends.
    pub(crate) lost_after: Option<u64>,
    pub(crate) request: R,
}

/// A call or computation under way.
struct Flight {
    t: u64,
    asked: u64,
    due: Option<u64>,
    /// When it counts as lost.
    lost: Option<u64>,
}

/// A request that is no longer waited for and has no answer.
pub(crate) struct GivenUp {
    pub(crate) t: u64,
    pub(crate) asked: u64,
    /// Whether it is under way and may be aborted; otherwise it was never sent.
    pub(crate) was_sent: bool,
}

impl<R> Lane<R> {
    /// An empty lane for up to `at_once` calls at a time, at least one.
    pub(crate) fn new(source: Source, at_once: usize) -> Self {
        Self {
            source,
            waiting: VecDeque::new(),
            flying: Vec::new(),
            lingering: VecDeque::new(),
            at_once: at_once.max(1),
            linger: 0,
            policy: None,
            in_force: None,
            shown: (0, 0),
        }
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
        self.flying.push(Flight { t: next.t, asked: next.asked, due: next.due, lost });
        Some(next)
    }

    /// The request has ended by itself, perhaps before it was sent; returns when it was asked for.
    pub(crate) fn end(&mut self, t: u64) -> Option<u64> {
        self.land(t)
            .map(|flight| flight.asked)
            .or_else(|| self.unlinger(t))
            .or_else(|| self.withdraw(t))
    }

    /// The result is no longer wanted. A call that may linger goes on; returns what ends instead, if
    /// anything does.
    pub(crate) fn close(&mut self, t: u64) -> Option<GivenUp> {
        let Some(flight) = self.land(t) else {
            return self.withdraw(t).map(|asked| GivenUp { t, asked, was_sent: false });
        };
        if self.linger == 0 {
            return Some(flight.given_up());
        }
        // Else a dead cloud would gather more and more of them.
        let oldest = if self.lingering.len() >= self.at_once {
            self.lingering.pop_front().map(Flight::given_up)
        } else {
            None
        };
        self.lingering.push_back(flight);
        oldest
    }

    /// Ends a call that has lingered long enough by `now`, if there is one.
    pub(crate) fn lapse(&mut self, now: u64) -> Option<GivenUp> {
        let place = self.lingering.iter().position(|flight| self.until(flight) <= now)?;
        self.lingering.remove(place).map(Flight::given_up)
    }

    /// When the next call has lingered long enough.
    pub(crate) fn next_lapse(&self) -> Option<u64> {
        self.lingering.iter().map(|flight| self.until(flight)).min()
    }

    /// Frees the place of a call that is lost by `now`, if there is one; returns its timestamp.
    pub(crate) fn give_up(&mut self, now: u64) -> Option<u64> {
        let is_lost = |flight: &Flight| flight.lost.is_some_and(|lost| lost <= now);
        let place = self.flying.iter().position(is_lost)?;
        Some(self.flying.remove(place).t)
    }

    /// When the next lost call frees its place for one that waits; none if nothing waits.
    pub(crate) fn next_lost(&self) -> Option<u64> {
        if self.waiting.is_empty() {
            return None;
        }
        self.flying.iter().filter_map(|flight| flight.lost).min()
    }

    /// Takes the request out of the queue if it waits; returns when it was asked for.
    pub(crate) fn withdraw(&mut self, t: u64) -> Option<u64> {
        let place = self.waiting.iter().position(|waiting| waiting.t == t)?;
        self.waiting.remove(place).map(|waiting| waiting.asked)
    }

    /// The age of each unanswered request at `now`, the oldest first, with those that linger.
    pub(crate) fn ages(&self, now: u64, ages: &mut Vec<Duration>) {
        let flying = self.flying.iter().chain(&self.lingering).map(|flight| flight.asked);
        let asked = flying.chain(self.waiting.iter().map(|waiting| waiting.asked));
        ages.clear();
        ages.extend(asked.map(|asked| Duration::from_nanos(now.saturating_sub(asked))));
        ages.sort_unstable_by(|one, other| other.cmp(one));
    }

    /// D4, F2: the length of the outgoing queue, calls under way not counted.
    pub(crate) fn backlog(&self) -> usize {
        self.waiting.len()
    }

    /// Calls under way, those that linger not counted.
    pub(crate) fn flying(&self) -> usize {
        self.flying.len()
    }

    fn land(&mut self, t: u64) -> Option<Flight> {
        let place = self.flying.iter().position(|flight| flight.t == t)?;
        Some(self.flying.remove(place))
    }

    fn unlinger(&mut self, t: u64) -> Option<u64> {
        let place = self.lingering.iter().position(|flight| flight.t == t)?;
        self.lingering.remove(place).map(|flight| flight.asked)
    }

    fn until(&self, flight: &Flight) -> u64 {
        flight.due.unwrap_or(u64::MAX).saturating_add(self.linger)
    }
}

impl Flight {
    const fn given_up(self) -> GivenUp {
        GivenUp { t: self.t, asked: self.asked, was_sent: true }
    }
}
