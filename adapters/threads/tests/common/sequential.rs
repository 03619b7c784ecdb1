//! The machine as callers see it when they call one after the other. Each call first fires the
//! timers of its own timestamp, then applies the pure step.

use std::collections::BTreeMap;

use fuseline_core::{
    Cause, Commit, Decision, DropReason, Gate, OfferRefusal, OpenRefusal, Slot, Source, Sources,
};

use crate::common::input::{CallAnswer, CallFirings, CallInput};

/// A state of the sequential machine. It has one cloud for each gate, numbered from 1.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Sequential {
    commit: Commit,
    window: usize,
    gates: Vec<Gate>,
    newest: Option<u64>,
    open: BTreeMap<u64, SequentialMessage>,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct SequentialMessage {
    slot: Slot,
    dues: BTreeMap<u8, u64>,
}

impl Sequential {
    /// Creates a machine without open timestamps, and with a gate for each cloud.
    #[must_use]
    pub(crate) const fn new(commit: Commit, window: usize, gates: Vec<Gate>) -> Self {
        Self { commit, window, gates, newest: None, open: BTreeMap::new() }
    }

    /// Applies an input and returns the machine's answer.
    pub(crate) fn apply(&mut self, now: u64, input: CallInput) -> CallAnswer {
        match input {
            CallInput::Open { t, deadline } => CallAnswer::Opened(self.accept(now, t, deadline)),
            CallInput::Offer { t, p, deadline, backlog } => {
                let fired = self.expire(now, t);
                CallAnswer::Offered(
                    fired,
                    self.admit(t, p, now.saturating_add(deadline), now, backlog),
                )
            }
            CallInput::Result { t, p } => {
                CallAnswer::Closed(self.expire(now, t), self.close(t, p, Cause::Result))
            }
            CallInput::Fail { t, p } => {
                CallAnswer::Closed(self.expire(now, t), self.close(t, p, Cause::Failure))
            }
            CallInput::Tick { t } => CallAnswer::Ticked(self.expire(now, t)),
            CallInput::NextDue { t } => {
                CallAnswer::Due(self.open.get(&t).and_then(SequentialMessage::earliest))
            }
        }
    }

    fn accept(&mut self, now: u64, t: u64, deadline: Option<u64>) -> Result<(), OpenRefusal> {
        if self.newest >= Some(t) {
            return Err(OpenRefusal::Order);
        }
        if self.open.len() >= self.window {
            return Err(OpenRefusal::Full);
        }
        let due = deadline.map(|deadline| now.saturating_add(deadline));
        if due.is_some_and(|due| due <= now) {
            return Err(OpenRefusal::Deadline);
        }
        let dues = due.map(|due| (0, due)).into_iter().collect();
        self.open.insert(t, SequentialMessage { slot: Slot::open(deadline.is_some()), dues });
        self.newest = Some(t);
        Ok(())
    }

    fn admit(
        &mut self,
        t: u64,
        p: u8,
        due: u64,
        now: u64,
        backlog: u64,
    ) -> Result<u64, OfferRefusal> {
        let gate = usize::from(p).checked_sub(1).and_then(|p| self.gates.get_mut(p));
        let (Some(gate), Some(source)) = (gate, Source::new(p)) else {
            return Err(OfferRefusal::Unknown);
        };
        let message = self.open.get_mut(&t).ok_or(OfferRefusal::Closed)?;
        let (admitted, refusal) = message.slot.offer(source);
        if let Some(why) = refusal {
            return Err(why);
        }
        if due <= now {
            return Err(OfferRefusal::Deadline);
        }
        if !gate.admits(backlog) {
            return Err(OfferRefusal::Queue);
        }
        message.slot = admitted;
        message.dues.insert(p, due);
        Ok(due)
    }

    fn close(&mut self, t: u64, p: u8, cause: impl FnOnce(Source) -> Cause) -> Decision {
        let Some(source) = Source::new(p).filter(|_| usize::from(p) <= self.gates.len()) else {
            return Decision::Dropped(DropReason::Unknown);
        };
        if self.open.contains_key(&t) {
            self.step(t, cause(source))
        } else {
            Decision::Dropped(DropReason::Superseded)
        }
    }

    /// Fires timers, one due instant after the other (F5).
    fn expire(&mut self, now: u64, t: u64) -> Option<CallFirings> {
        let mut all: Option<CallFirings> = None;
        while let Some(message) = self.open.get(&t)
            && let Some(due) = message.earliest().filter(|due| *due <= now)
        {
            let timers = message.armed().filter(|source| message.due(*source) == due).collect();
            let decision = self.step(t, Cause::Timers(timers));
            let timers = all.map_or(Sources::EMPTY, |all| all.timers).union(timers);
            all = Some(CallFirings { due, timers, decision });
        }
        all
    }

    fn step(&mut self, t: u64, cause: Cause) -> Decision {
        let message = self.open.get_mut(&t).expect("only open timestamps are stepped");
        let (slot, decision) = message.slot.step(self.commit, cause);
        message.slot = slot;
        if !slot.is_open() {
            self.open.remove(&t);
        }
        decision
    }
}

impl SequentialMessage {
    fn armed(&self) -> impl Iterator<Item = Source> {
        self.slot.armed().iter()
    }

    fn due(&self, source: Source) -> u64 {
        self.dues[&source.index()]
    }

    fn earliest(&self) -> Option<u64> {
        self.armed().map(|source| self.due(source)).min()
    }
}
