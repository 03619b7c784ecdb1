//! The four sets of one timestamp, and the pure step that decides about it (F2–F7, F9).
//!
//! All decisions about results are made here, by sets of at most 16 sources. Nothing here knows the clock, a due instant, a
//! priority's number or another timestamp: `fusion.rs` does, and calls the step.

use crate::answer::{Admission, DropReason, OfferRefusal};
use crate::gate::Gate;
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant};

/// When a result is forwarded although something better is still pending (F6, F9).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Commit {
    /// The first cloud's timer to fire commits the best available result, whoever's timer it is.
    #[default]
    Eager,
    /// A timer closes its own request alone; the best available result is forwarded when nothing pending outranks it.
    Patient,
    /// Each result that is better than those before it is forwarded at once, and better ones may follow it (F9).
    Progressive,
}

/// The four sets of one timestamp. Every value is valid for the commit rule that it was made and stepped with.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Slot {
    requested: Sources,
    pending: Sources,
    armed: Sources,
    cached: Sources,
}

/// What can close requests of one timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// A result came (F3).
    Result(Source),
    /// No result will come (F4).
    Failure(Source),
    /// These timers, all due at one instant, fired (F5). Those that are not armed are ignored.
    Timers(Sources),
}

/// What a step decided.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Decision {
    /// The input was dropped and changed nothing.
    Dropped(DropReason),
    /// The result is available, but something pending outranks it.
    Held,
    /// Requests were closed and something is still pending.
    Waiting,
    /// The result of `by` is sent downstream, and better ones are still pending (F9). Progressive alone.
    Preliminary {
        /// Whose result it is.
        by: Source,
        /// The clouds that were still pending and that it outranks.
        cancelled: Sources,
    },
    /// Nothing better will come than the result of `by`, which was sent before; the timestamp is retired (F9). Progressive alone.
    Final {
        /// Whose result it is.
        by: Source,
    },
    /// The result of `by` is sent downstream; the timestamp is retired.
    Forwarded {
        /// Whose result it is.
        by: Source,
        /// The clouds that were still pending.
        cancelled: Sources,
    },
    /// Nothing came and nothing will; the timestamp is retired.
    Missed,
}

/// Why four sets are not a state of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum InvalidSlot {
    /// Local is not requested (F1).
    LocalNotRequested,
    /// A pending or cached source is not requested.
    NotRequested,
    /// A source is both pending and cached.
    PendingAndCached,
    /// Nothing is pending, so the timestamp would have been retired (F6).
    NothingPending,
    /// Nothing pending outranks the best available result, so it would have been forwarded (P4).
    Unforwarded,
    /// Under progressive, the last output is not the only one cached, or outranks something pending (F9).
    Outranked,
    /// The armed timers are not those that the commit rule keeps (P8).
    Timers,
}

impl core::fmt::Display for InvalidSlot {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::LocalNotRequested => "local is not requested",
            Self::NotRequested => "a pending or cached source is not requested",
            Self::PendingAndCached => "a source is both pending and cached",
            Self::NothingPending => "nothing is pending",
            Self::Unforwarded => "nothing pending outranks the best available result",
            Self::Outranked => "the last output is not the only one, or outranks something pending",
            Self::Timers => "the armed timers are not those that the commit rule keeps",
        })
    }
}

impl core::error::Error for InvalidSlot {}

impl Slot {
    /// A timestamp that is no longer open: all sets empty. What comes for it is superseded or closed.
    pub const RETIRED: Self = Self {
        requested: Sources::EMPTY,
        pending: Sources::EMPTY,
        armed: Sources::EMPTY,
        cached: Sources::EMPTY,
    };

    /// F1: a timestamp just opened, waiting for local; `limited` if local has a deadline.
    #[must_use]
    pub const fn open(limited: bool) -> Self {
        let armed = if limited { Sources::LOCAL } else { Sources::EMPTY };
        Self { requested: Sources::LOCAL, pending: Sources::LOCAL, armed, cached: Sources::EMPTY }
    }

    /// The state with these sets under `commit`.
    ///
    /// # Errors
    /// The first [`InvalidSlot`] that holds: no sequence of inputs leads to such sets.
    pub fn from_sets(
        commit: Commit,
        requested: Sources,
        pending: Sources,
        armed: Sources,
        cached: Sources,
    ) -> Result<Self, InvalidSlot> {
        let slot = Self { requested, pending, armed, cached };
        if slot == Self::RETIRED {
            return Ok(slot);
        }
        if !requested.contains(Source::LOCAL) {
            return Err(InvalidSlot::LocalNotRequested);
        }
        if !requested.contains_all(pending.union(cached)) {
            return Err(InvalidSlot::NotRequested);
        }
        if !pending.intersection(cached).is_empty() {
            return Err(InvalidSlot::PendingAndCached);
        }
        if pending.is_empty() {
            return Err(InvalidSlot::NothingPending);
        }
        if cached.greatest().is_some_and(|best| !pending.any_above(best)) {
            return Err(InvalidSlot::Unforwarded);
        }
        let is_last = |last| cached.without(last).is_empty() && pending == pending.above(last);
        if commit == Commit::Progressive && !cached.greatest().is_none_or(is_last) {
            return Err(InvalidSlot::Outranked);
        }
        let of_clouds = match commit {
            Commit::Eager => pending.union(cached).clouds(),
            Commit::Patient | Commit::Progressive => pending.clouds(),
        };
        let limit_outlives_local =
            armed.contains(Source::LOCAL) && !pending.contains(Source::LOCAL);
        if armed.clouds() != of_clouds || limit_outlives_local {
            return Err(InvalidSlot::Timers);
        }
        Ok(slot)
    }

    /// F2, as far as the sets decide it: the state with `source` requested, or this one and the first reason to refuse.
    ///
    /// [`admit`](Self::admit) checks the offer's deadline and the gate after these reasons.
    #[must_use]
    pub fn offer(self, source: Source) -> (Self, Option<OfferRefusal>) {
        if !self.is_open() {
            return (self, Some(OfferRefusal::Closed));
        }
        if self.requested.contains(source) {
            return (self, Some(OfferRefusal::Duplicate));
        }
        // F2 outranked: the commit rule can only forward the best available result or a better one.
        if self.cached.any_above(source) {
            return (self, Some(OfferRefusal::Outranked));
        }
        let admitted = Self {
            requested: self.requested.with(source),
            pending: self.pending.with(source),
            armed: self.armed.with(source),
            ..self
        };
        (admitted, None)
    }

    /// F2 for a registered cloud: the state with `source` requested, or this one and the first reason to refuse.
    ///
    /// `gate` is the cloud's own. It decides last, so that a request refused anyway does not move it (F2g).
    #[inline]
    pub fn admit(
        self,
        source: Source,
        gate: &mut Gate,
        now: Instant,
        deadline: Deadline,
        backlog: u64,
    ) -> (Self, Admission) {
        let (admitted, refusal) = self.offer(source);
        if let Some(reason) = refusal {
            return (self, Admission::Refused(reason));
        }
        let Some(due) = now.due(deadline) else {
            return (self, Admission::Refused(OfferRefusal::Deadline));
        };
        if !gate.admits(backlog) {
            return (self, Admission::Refused(OfferRefusal::Queue));
        }
        (admitted, Admission::Admitted { due })
    }

    /// The pure step: closes requests and decides (F3–F7).
    #[inline]
    #[must_use]
    pub fn step(self, commit: Commit, cause: Cause) -> (Self, Decision) {
        match cause {
            Cause::Result(source) => self.result(commit, source),
            Cause::Failure(source) => self.failure(commit, source),
            Cause::Timers(fired) => self.timers(commit, fired.intersection(self.armed)),
        }
    }

    /// Whether the timestamp is open.
    #[must_use]
    pub const fn is_open(self) -> bool {
        !self.requested.is_empty()
    }

    /// The sources that were requested; local is one as long as the timestamp is open.
    #[must_use]
    pub const fn requested(self) -> Sources {
        self.requested
    }

    /// The sources that were requested and of which no result, failure or firing has come.
    #[must_use]
    pub const fn pending(self) -> Sources {
        self.pending
    }

    /// The sources whose timer is live.
    #[must_use]
    pub const fn armed(self) -> Sources {
        self.armed
    }

    /// The sources whose result arrived in time and is held; under progressive, that of the last output.
    #[must_use]
    pub const fn cached(self) -> Sources {
        self.cached
    }

    /// F3: a result is dropped, forwarded, or held while something pending outranks it; under progressive it is not held.
    #[inline]
    fn result(mut self, commit: Commit, source: Source) -> (Self, Decision) {
        if let Some(reason) = self.drop_reason(commit, source) {
            return (self, Decision::Dropped(reason));
        }
        self.pending = self.pending.without(source);
        // F3 forward: nothing pending outranks it, as where nothing else was requested (P6).
        if !self.pending.any_above(source) {
            return self.forward(source);
        }
        match commit {
            // F3 held: an eager cloud's timer runs on, to commit the best available; local's never commits (A3).
            Commit::Eager if source != Source::LOCAL => {}
            Commit::Eager | Commit::Patient => self.armed = self.armed.without(source),
            Commit::Progressive => return self.send(source),
        }
        self.cached = self.cached.with(source);
        (self, Decision::Held)
    }

    /// F9: a result is sent although something better is pending. What it outranks is no longer awaited.
    #[inline]
    fn send(mut self, by: Source) -> (Self, Decision) {
        let better = self.pending.above(by);
        let cancelled = self.pending.difference(better).clouds();
        self.pending = better;
        self.armed = self.armed.intersection(better);
        self.cached = Sources::EMPTY.with(by);
        (self, Decision::Preliminary { by, cancelled })
    }

    /// F4: a failure is dropped as a result is, or closes its request and settles as by no timer.
    #[inline]
    fn failure(mut self, commit: Commit, source: Source) -> (Self, Decision) {
        if let Some(reason) = self.drop_reason(commit, source) {
            return (self, Decision::Dropped(reason));
        }
        self.pending = self.pending.without(source);
        self.armed = self.armed.without(source);
        self.settle(commit, false)
    }

    /// F5, for the armed timers of one instant.
    #[inline]
    fn timers(mut self, commit: Commit, fired: Sources) -> (Self, Decision) {
        if fired.is_empty() {
            return (self, Decision::Waiting);
        }
        self.armed = self.armed.difference(fired);
        self.pending = self.pending.difference(fired);
        // F5 cause: the firing of local's deadline alone commits nothing (A9).
        self.settle(commit, !fired.clouds().is_empty())
    }

    /// The first reason of F3 and F4 that the sets decide, if one holds.
    fn drop_reason(self, commit: Commit, source: Source) -> Option<DropReason> {
        if !self.is_open() {
            Some(DropReason::Superseded)
        } else if self.pending.contains(source) {
            None
        } else if commit == Commit::Progressive && self.cached.any_above(source) {
            // F9: outranked by the last output, requested or not.
            Some(DropReason::Superseded)
        } else if !self.requested.contains(source) {
            Some(DropReason::Unsolicited)
        } else if self.cached.contains(source) {
            Some(DropReason::Duplicate)
        } else {
            // F3 late: its timer or a failure closed it, and what is closed is never forwarded (P2).
            Some(DropReason::Late)
        }
    }

    /// F6: some requests were closed; forward, miss or wait.
    ///
    /// Once the last timer has fired, nothing pending outranks what is available: so local's result is forwarded by then
    /// (P5), and a timestamp opened with a deadline is retired by then (P7). Once local has arrived, only clouds are awaited
    /// (P12).
    #[inline]
    fn settle(self, commit: Commit, timer: bool) -> (Self, Decision) {
        // F6: whatever the cause, the greatest available or none (P3).
        match self.cached.greatest() {
            Some(best) if !self.pending.any_above(best) => match commit {
                Commit::Eager | Commit::Patient => self.forward(best),
                // F9: it was sent before, and nothing better will come.
                Commit::Progressive => (Self::RETIRED, Decision::Final { by: best }),
            },
            // F6 eager: a cloud's timer commits although something better is pending (A4).
            Some(best) if timer && commit == Commit::Eager => self.forward(best),
            // F6 miss: nothing available, nothing to come (A5, A8).
            None if self.pending.is_empty() => (Self::RETIRED, Decision::Missed),
            Some(_) | None => (self, Decision::Waiting),
        }
    }

    /// F7: the result is sent, what is pending is cancelled. The timestamp is retired with it, so that this happens once (P1).
    #[inline]
    fn forward(self, by: Source) -> (Self, Decision) {
        (Self::RETIRED, Decision::Forwarded { by, cancelled: self.pending.clouds() })
    }
}

#[cfg(test)]
mod tests;
