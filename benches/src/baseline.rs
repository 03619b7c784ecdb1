//! The machine that one would write without a thought for worst cases: a hash map of timestamps and
//! a binary heap of timers.
//!
//! It uses the core's own step to decide, so that only the bookkeeping is compared. Disarmed timers
//! stay in the heap and are skipped when they come up.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::hash::BuildHasher;

use fuseline_core::{Cause, Commit, Decision, Gate, Slot, Source};
use fuseline_traces::Input;

use crate::machine::{DecisionTally, Machine};

/// The machine of a hash map and a binary heap.
pub struct Baseline<S> {
    commit: Commit,
    window: usize,
    /// In ascending priority.
    clouds: Vec<(u64, Gate)>,
    now: u64,
    newest: Option<u64>,
    open: HashMap<u64, Slot, S>,
    timers: BinaryHeap<Reverse<(u64, u64, u8)>>,
}

impl<S: BuildHasher + Default> Baseline<S> {
    /// A machine with clouds of these priorities, limits and resumes.
    #[must_use]
    pub fn new(window: usize, commit: Commit, clouds: &[(u64, u64, u64)]) -> Self {
        let gate = |(p, limit, resume): &(u64, u64, u64)| Some((*p, Gate::new(*limit, *resume)?));
        let mut clouds: Vec<_> = clouds.iter().filter_map(gate).collect();
        clouds.sort_by_key(|cloud| cloud.0);
        Self {
            commit,
            window,
            clouds,
            now: 0,
            newest: None,
            open: HashMap::with_capacity_and_hasher(window, S::default()),
            timers: BinaryHeap::new(),
        }
    }

    fn source(&self, p: u64) -> Option<Source> {
        if p == 0 {
            return Some(Source::LOCAL);
        }
        let cloud = self.clouds.iter().position(|cloud| cloud.0 == p)?;
        Source::new(u8::try_from(cloud + 1).ok()?)
    }

    fn expire(&mut self, tally: &mut DecisionTally) {
        while let Some(Reverse((due, t, _))) = self.timers.peek().copied() {
            if due > self.now {
                break;
            }
            let mut fired = fuseline_core::Sources::EMPTY;
            while let Some(Reverse((next_due, next_t, source))) = self.timers.peek().copied() {
                if (next_due, next_t) != (due, t) {
                    break;
                }
                self.timers.pop();
                if let Some(source) = Source::new(source) {
                    fired = fired.with(source);
                }
            }
            if let Some(slot) = self.open.get(&t) {
                let fired = fired.intersection(slot.armed());
                if !fired.is_empty() {
                    tally.timers += fired.iter().count() as u64;
                    self.close(t, Cause::Timers(fired), tally);
                }
            }
        }
    }

    fn close(&mut self, t: u64, cause: Cause, tally: &mut DecisionTally) {
        let Some(slot) = self.open.get_mut(&t) else {
            tally.dropped += 1;
            return;
        };
        let (next, decision) = slot.step(self.commit, cause);
        *slot = next;
        if !next.is_open() {
            self.open.remove(&t);
        }
        match decision {
            Decision::Dropped(_) => tally.dropped += 1,
            Decision::Held => tally.held += 1,
            Decision::Waiting | Decision::Final { .. } => {}
            Decision::Forwarded { by, .. } | Decision::Preliminary { by, .. } => {
                let cloud = usize::from(by.index()).checked_sub(1);
                tally.forwarded += cloud.map_or(0, |cloud| self.clouds[cloud].0) + 1;
            }
            Decision::Missed => tally.missed += 1,
        }
    }

    fn arrival(
        &mut self,
        t: u64,
        p: u64,
        cause: impl FnOnce(Source) -> Cause,
        tally: &mut DecisionTally,
    ) {
        match self.source(p) {
            Some(source) if self.newest.is_some_and(|newest| t <= newest) => {
                self.close(t, cause(source), tally);
            }
            _ => tally.dropped += 1,
        }
    }

    fn offer(&mut self, t: u64, p: u64, deadline: u64, backlog: u64) -> Option<()> {
        let source = self.source(p).filter(|source| *source != Source::LOCAL)?;
        let slot = self.open.get_mut(&t)?;
        let (next, refusal) = slot.offer(source);
        let due = self.now.saturating_add(deadline);
        if refusal.is_some() || due <= self.now {
            return None;
        }
        let (_, gate) = self.clouds.get_mut(usize::from(source.index()) - 1)?;
        if !gate.admits(backlog) {
            return None;
        }
        *slot = next;
        self.timers.push(Reverse((due, t, source.index())));
        Some(())
    }

    fn open(&mut self, t: u64, deadline: Option<u64>) -> Option<()> {
        if self.newest.is_some_and(|newest| t <= newest) || self.open.len() >= self.window {
            return None;
        }
        if let Some(deadline) = deadline {
            let due = self.now.saturating_add(deadline);
            if due <= self.now {
                return None;
            }
            self.timers.push(Reverse((due, t, 0)));
        }
        self.open.insert(t, Slot::open(deadline.is_some()));
        self.newest = Some(t);
        Some(())
    }
}

impl<S: BuildHasher + Default> Machine for Baseline<S> {
    #[inline]
    fn apply(&mut self, input: &Input, tally: &mut DecisionTally) {
        self.now = self.now.max(input.at());
        self.expire(tally);
        let admitted = match *input {
            Input::Open { t, deadline, .. } => self.open(t, deadline),
            Input::Offer { t, p, deadline, backlog, .. } => self.offer(t, p, deadline, backlog),
            Input::Result { t, p, .. } => return self.arrival(t, p, Cause::Result, tally),
            Input::Fail { t, p, .. } => return self.arrival(t, p, Cause::Failure, tally),
            Input::Tick { .. } => return,
        };
        match admitted {
            Some(()) => tally.admitted += 1,
            None => tally.refused += 1,
        }
    }
}
