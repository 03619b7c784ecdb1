//! The four sets of one timestamp, and the pure step that decides about it (F2–F7, F9).
//!
//! Every decision about a result is made here, from sets of at most 16 sources. This module knows
//! no clock, due instant, priority number or other timestamp. `fusion.rs` knows those and calls the
//! step.

use crate::answer::{Admission, DropReason, OfferRefusal};
use crate::gate::Gate;
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant};

/// Decides when a result is forwarded although a better one is still pending (F6, F9).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Commit {
    /// Forwards the best available result as soon as any cloud's timer fires, even the timer of
    /// another cloud.
    #[default]
    Eager,
    /// Forwards the best available result once nothing that outranks it is pending. A timer closes
    /// only its own request.
    Patient,
    /// Forwards each result that is better than those before it at once. Better ones may follow
    /// (F9).
    Progressive,
}

/// The four sets of one timestamp.
///
/// Inputs can lead to every value of this type, under the commit rule with which the value was made
/// and stepped.
///
/// ```
/// use fuseline_core::{Cause, Commit, Decision, Slot, Source};
/// let (slot, decision) = Slot::open(false).step(Commit::Eager, Cause::Result(Source::LOCAL));
/// assert!(!slot.is_open() && matches!(decision, Decision::Forwarded { by: Source::LOCAL, .. }));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Slot {
    requested: Sources,
    pending: Sources,
    armed: Sources,
    cached: Sources,
}

/// The event that closes requests of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// A result arrived (F3).
    Result(Source),
    /// No result will come from this source (F4).
    Failure(Source),
    /// These timers, all due at one instant, fired (F5). Timers that are not armed are ignored.
    Timers(Sources),
}

/// The decision of one step.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Decision {
    /// The input was dropped and changed nothing.
    Dropped(DropReason),
    /// The result is available, but a source that outranks it is pending.
    Held,
    /// Requests were closed, and others are still pending.
    Waiting,
    /// The result of `by` is sent downstream while better ones are pending (F9). Progressive only.
    Preliminary {
        /// The source of the result.
        by: Source,
        /// The clouds that were pending and that the result outranks.
        cancelled: Sources,
    },
    /// The result of `by`, sent before, is the last one, and the timestamp is retired (F9).
    /// Progressive only.
    Final {
        /// The source of the result.
        by: Source,
    },
    /// The result of `by` is sent downstream, and the timestamp is retired.
    Forwarded {
        /// The source of the result.
        by: Source,
        /// The clouds that were still pending.
        cancelled: Sources,
    },
    /// No result arrived in time and none is pending; the timestamp is retired.
    Missed,
}

/// The reason why four sets are not a state of an open timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum InvalidSlot {
    /// Local is not in requested (F1).
    LocalNotRequested,
    /// A pending or cached source is not in requested.
    NotRequested,
    /// A source is both pending and cached.
    PendingAndCached,
    /// Nothing is pending, so the timestamp would have been retired (F6).
    NothingPending,
    /// Nothing pending outranks the best available result, so it would have been forwarded (P4).
    Unforwarded,
    /// Under the progressive rule, cached has another member than the last output, or the last
    /// output outranks a pending source (F9).
    Outranked,
    /// The armed timers differ from those that the commit rule keeps (P8).
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
    /// A timestamp that is no longer open. All sets are empty, so inputs for it are superseded or
    /// closed.
    pub const RETIRED: Self = Self {
        requested: Sources::EMPTY,
        pending: Sources::EMPTY,
        armed: Sources::EMPTY,
        cached: Sources::EMPTY,
    };

    /// Returns the state of a timestamp that was just opened and waits for local (F1). `limited` is
    /// `true` if local has a deadline.
    #[must_use]
    pub const fn open(limited: bool) -> Self {
        let armed = if limited { Sources::LOCAL } else { Sources::EMPTY };
        Self { requested: Sources::LOCAL, pending: Sources::LOCAL, armed, cached: Sources::EMPTY }
    }

    /// Returns the state with these sets under `commit`.
    ///
    /// # Errors
    /// Returns the first [`InvalidSlot`] that holds. No sequence of inputs leads to such a state.
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

    /// Checks an offer by the sets alone (F2). Returns the state with `source` requested. A refused
    /// offer returns this state and the first reason to refuse.
    ///
    /// [`admit`](Self::admit) also checks the offer's deadline and the gate.
    #[must_use]
    pub fn offer(self, source: Source) -> (Self, Option<OfferRefusal>) {
        if !self.is_open() {
            return (self, Some(OfferRefusal::Closed));
        }
        if self.requested.contains(source) {
            return (self, Some(OfferRefusal::Duplicate));
        }
        // The commit rule only ever forwards the best available result or a better one (F2).
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

    /// Checks an offer to a registered cloud (F2). Returns the state with `source` requested. A
    /// refused offer returns this state and the first reason to refuse.
    ///
    /// `gate` is the cloud's own gate. The gate is consulted last, so an offer that is refused for
    /// another reason does not change it (F2g).
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

    /// Closes requests and decides (F3–F7). This function is pure.
    #[inline]
    #[must_use]
    pub fn step(self, commit: Commit, cause: Cause) -> (Self, Decision) {
        match cause {
            Cause::Result(source) => self.result(commit, source),
            Cause::Failure(source) => self.failure(commit, source),
            Cause::Timers(fired) => self.timers(commit, fired.intersection(self.armed)),
        }
    }

    /// Returns `true` if the timestamp is open.
    #[must_use]
    pub const fn is_open(self) -> bool {
        !self.requested.is_empty()
    }

    /// Returns the sources that were requested. Local is a member as long as the timestamp is open.
    #[must_use]
    pub const fn requested(self) -> Sources {
        self.requested
    }

    /// Returns the requested sources that no result, failure or firing has closed.
    #[must_use]
    pub const fn pending(self) -> Sources {
        self.pending
    }

    /// Returns the sources whose timer is live.
    #[must_use]
    pub const fn armed(self) -> Sources {
        self.armed
    }

    /// Returns the sources whose result arrived in time and is held. Under the progressive rule,
    /// returns the source of the last output.
    #[must_use]
    pub const fn cached(self) -> Sources {
        self.cached
    }

    /// Drops a result, forwards it, or holds it while a source that outranks it is pending (F3).
    /// The progressive rule sends it instead of holding it.
    #[inline]
    fn result(mut self, commit: Commit, source: Source) -> (Self, Decision) {
        if let Some(reason) = self.drop_reason(commit, source) {
            return (self, Decision::Dropped(reason));
        }
        self.pending = self.pending.without(source);
        // Nothing pending outranks the result, or nothing else was requested (F3, P6).
        if !self.pending.any_above(source) {
            return self.forward(source);
        }
        match commit {
            // Under eager a cloud's timer runs on, to commit the best available result. Local's
            // timer never commits (F3, A3).
            Commit::Eager if source != Source::LOCAL => {}
            Commit::Eager | Commit::Patient => self.armed = self.armed.without(source),
            Commit::Progressive => return self.send(source),
        }
        self.cached = self.cached.with(source);
        (self, Decision::Held)
    }

    /// Sends a result while a better one is pending, and cancels the requests that it outranks
    /// (F9).
    #[inline]
    fn send(mut self, by: Source) -> (Self, Decision) {
        let better = self.pending.above(by);
        let cancelled = self.pending.difference(better).clouds();
        self.pending = better;
        self.armed = self.armed.intersection(better);
        self.cached = Sources::EMPTY.with(by);
        (self, Decision::Preliminary { by, cancelled })
    }

    /// Drops a failure for the reasons that drop a result, or closes its request and settles the
    /// timestamp (F4).
    #[inline]
    fn failure(mut self, commit: Commit, source: Source) -> (Self, Decision) {
        if let Some(reason) = self.drop_reason(commit, source) {
            return (self, Decision::Dropped(reason));
        }
        self.pending = self.pending.without(source);
        self.armed = self.armed.without(source);
        self.settle(commit, false)
    }

    /// Fires the armed timers of one instant (F5).
    #[inline]
    fn timers(mut self, commit: Commit, fired: Sources) -> (Self, Decision) {
        if fired.is_empty() {
            return (self, Decision::Waiting);
        }
        self.armed = self.armed.difference(fired);
        self.pending = self.pending.difference(fired);
        // Local's timer alone commits nothing (F5, A9).
        self.settle(commit, !fired.clouds().is_empty())
    }

    /// Returns the first reason of F3 and F4 that holds, as far as the sets decide it.
    fn drop_reason(self, commit: Commit, source: Source) -> Option<DropReason> {
        if !self.is_open() {
            Some(DropReason::Superseded)
        } else if self.pending.contains(source) {
            None
        } else if commit == Commit::Progressive && self.cached.any_above(source) {
            // The last output outranks this source, requested or not (F9).
            Some(DropReason::Superseded)
        } else if !self.requested.contains(source) {
            Some(DropReason::Unsolicited)
        } else if self.cached.contains(source) {
            Some(DropReason::Duplicate)
        } else {
            // A timer or a failure closed this request, and a closed request is never forwarded
            // (F3, P2).
            Some(DropReason::Late)
        }
    }

    /// Forwards, misses or waits after requests were closed (F6).
    ///
    /// After the last timer has fired, nothing pending outranks the available result. So local's
    /// result is forwarded by then (P5), and a timestamp opened with a deadline is retired by then
    /// (P7). Once local has arrived, only clouds are pending (P12).
    #[inline]
    fn settle(self, commit: Commit, timer: bool) -> (Self, Decision) {
        // Only the greatest available result can be forwarded, whatever the cause (F6, P3).
        match self.cached.greatest() {
            Some(best) if !self.pending.any_above(best) => match commit {
                Commit::Eager | Commit::Patient => self.forward(best),
                // The result was sent before, and no better one is pending (F9).
                Commit::Progressive => (Self::RETIRED, Decision::Final { by: best }),
            },
            // Under eager a cloud's timer commits although a better result is pending (F6, A4).
            Some(best) if timer && commit == Commit::Eager => self.forward(best),
            // Nothing is available and nothing is pending (F6, A5, A8).
            None if self.pending.is_empty() => (Self::RETIRED, Decision::Missed),
            Some(_) | None => (self, Decision::Waiting),
        }
    }

    /// Sends a result and cancels the pending clouds (F7). It also retires the timestamp, so this
    /// happens once (P1).
    #[inline]
    fn forward(self, by: Source) -> (Self, Decision) {
        (Self::RETIRED, Decision::Forwarded { by, cancelled: self.pending.clouds() })
    }
}

#[cfg(test)]
mod tests;
