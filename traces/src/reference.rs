//! The machine as the rules state it, with plain sets.
//!
//! It is written to be obvious, not fast: one method for each rule, in the rule's words. It shares
//! no code with the machine that ships, so that the two can disagree.

use std::collections::{BTreeMap, BTreeSet};

use crate::event::{Commit, Decision, Header, Input};
use crate::reason::{DropReason, OfferRefusal, OpenRefusal};
use crate::rule::Rule;

/// Decides about inputs one by one, and gives each decision with the rule that demands it.
///
/// Its memory is bounded by the window and the number of clouds. Two machines are equal if they
/// give the same decisions for all further inputs.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Reference {
    window: usize,
    commit: Commit,
    gates: BTreeMap<u64, Gate>,
    /// The greatest `now` seen.
    now: u64,
    /// The greatest timestamp ever opened.
    newest: Option<u64>,
    open: BTreeMap<u64, OpenEntry>,
    /// Every live timer, in the order in which they fire (F5): due instant, timestamp, priority.
    timers: BTreeSet<(u64, u64, u64)>,
}

/// The decisions about one input, in order.
pub type ExpectedDecisions = Vec<(Decision, Rule)>;

/// One cloud's gate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Gate {
    limit: u64,
    resume: u64,
    open: bool,
}

/// The sets of one open timestamp.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct OpenEntry {
    requested: BTreeSet<u64>,
    pending: BTreeSet<u64>,
    /// The armed priorities with their due instants.
    armed: BTreeMap<u64, u64>,
    cached: BTreeSet<u64>,
}

/// The reason why a timestamp is settled.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SettleCause {
    CloudTimer,
    NoTimer,
}

impl Reference {
    /// Creates a machine with this configuration and no open timestamp.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let gate = |limit, resume| Gate { limit, resume, open: true };
        let clouds = header.clouds.iter();
        Self {
            window: header.window.into(),
            commit: header.commit,
            gates: clouds.map(|cloud| (cloud.p.into(), gate(cloud.limit, cloud.resume))).collect(),
            now: 0,
            newest: None,
            open: BTreeMap::new(),
            timers: BTreeSet::new(),
        }
    }

    /// Appends the decisions that the rules demand for `input`.
    pub fn apply(&mut self, input: &Input, out: &mut ExpectedDecisions) {
        // Time does not go back, and due timers come first (F0).
        self.now = self.now.max(input.at());
        self.expire(out);
        match *input {
            Input::Open { t, deadline, .. } => self.open(t, deadline, out),
            Input::Offer { t, p, deadline, backlog, .. } => {
                self.offer(t, p, deadline, backlog, out);
            }
            Input::Result { t, p, .. } => self.result(t, p, out),
            Input::Fail { t, p, .. } => self.fail(t, p, out),
            Input::Tick { .. } => {}
        }
    }

    /// Opens a timestamp that waits for local, or refuses for the first reason that holds (F1).
    fn open(&mut self, t: u64, deadline: Option<u64>, out: &mut ExpectedDecisions) {
        let due = deadline.map(|deadline| self.now.saturating_add(deadline));
        let why = if self.was_reached(t) {
            Some(OpenRefusal::Order)
        } else if self.open.len() >= self.window {
            Some(OpenRefusal::Full)
        } else if due.is_some_and(|due| due <= self.now) {
            Some(OpenRefusal::Deadline)
        } else {
            None
        };
        if let Some(why) = why {
            out.push((Decision::RefuseOpen { at: self.now, t, why }, Rule::F1));
            return;
        }
        self.newest = Some(t);
        let mut open = OpenEntry::default();
        open.requested.insert(0);
        open.pending.insert(0);
        self.open.insert(t, open);
        if let Some(due) = due {
            self.arm(t, 0, due);
        }
    }

    /// Requests a cloud with a due instant `deadline` after now, or refuses, which changes at most
    /// the gate (F2).
    fn offer(&mut self, t: u64, p: u64, deadline: u64, backlog: u64, out: &mut ExpectedDecisions) {
        let at = self.now;
        let due = at.saturating_add(deadline);
        match self.admit(t, p, due, backlog) {
            Ok(()) => {
                self.arm(t, p, due);
                out.push((Decision::Request { at, t, p, due }, Rule::F2));
            }
            Err(why) => {
                let rule = if why == OfferRefusal::Queue { Rule::F2g } else { Rule::F2 };
                out.push((Decision::RefuseOffer { at, t, p, why }, rule));
            }
        }
    }

    /// Requests `(t, p)`, or returns the first reason to refuse (F2).
    fn admit(&mut self, t: u64, p: u64, due: u64, backlog: u64) -> Result<(), OfferRefusal> {
        let reached = self.was_reached(t);
        // The cloud is unknown, or the timestamp is beyond all that were opened (F2).
        let gate = self.gates.get_mut(&p).filter(|_| reached).ok_or(OfferRefusal::Unknown)?;
        let open = self.open.get_mut(&t).ok_or(OfferRefusal::Closed)?;
        // It was requested before, whatever became of the request (F2, A26).
        if open.requested.contains(&p) {
            return Err(OfferRefusal::Duplicate);
        }
        // This result could never be forwarded (F2, A17).
        if open.cached.iter().any(|q| *q > p) {
            return Err(OfferRefusal::Outranked);
        }
        // The request would be over at once (F2, A11).
        if due <= self.now {
            return Err(OfferRefusal::Deadline);
        }
        // The gate comes last, after all other reasons (F2g).
        if !gate.admits(backlog) {
            return Err(OfferRefusal::Queue);
        }
        open.requested.insert(p);
        open.pending.insert(p);
        Ok(())
    }

    /// Drops a result, holds it while a source that outranks it is pending, or forwards it (F3).
    fn result(&mut self, t: u64, p: u64, out: &mut ExpectedDecisions) {
        let (at, commit) = (self.now, self.commit);
        let open = match self.accept(t, p) {
            Ok(open) => open,
            Err(why) => return out.push((Decision::Drop { at, t, p, why }, Rule::F3)),
        };
        open.pending.remove(&p);
        if commit == Commit::Progressive {
            return self.send(t, p, out);
        }
        if open.pending.iter().any(|q| *q > p) {
            open.cached.insert(p);
            // Under eager a cloud's timer runs on, to commit (F3, A3).
            if commit == Commit::Patient || p == 0 {
                self.disarm(t, p);
            }
            out.push((Decision::Hold { at, t, p }, Rule::F3));
        } else {
            self.forward(t, p, Rule::F3, out);
        }
    }

    /// Forwards a result, stops waiting for sources that it outranks, and ends the timestamp if
    /// nothing better is pending (F9).
    fn send(&mut self, t: u64, p: u64, out: &mut ExpectedDecisions) {
        let at = self.now;
        let Some(open) = self.open.get_mut(&t) else { return };
        out.push((Decision::Emit { at, t, p }, Rule::F9));
        open.cached = BTreeSet::from([p]);
        let better = open.pending.split_off(&p);
        let outranked = std::mem::replace(&mut open.pending, better);
        let is_over = open.pending.is_empty();
        self.disarm(t, p);
        for q in outranked {
            self.disarm(t, q);
            // Local is never cancelled (A24).
            if q > 0 {
                out.push((Decision::Cancel { at, t, p: q }, Rule::F9));
            }
        }
        if is_over {
            self.retire(t);
            out.push((Decision::Final { at, t, p }, Rule::F9));
        }
    }

    /// Drops a failure for the reasons that drop a result, or closes the request and settles as by
    /// no timer (F4, A36).
    fn fail(&mut self, t: u64, p: u64, out: &mut ExpectedDecisions) {
        match self.accept(t, p) {
            Ok(open) => {
                open.pending.remove(&p);
                self.disarm(t, p);
                self.settle(t, SettleCause::NoTimer, out);
            }
            Err(why) => out.push((Decision::Drop { at: self.now, t, p, why }, Rule::F4)),
        }
    }

    /// Returns the open timestamp, or the reason to drop an input for `(t, p)` (F3, F4).
    fn accept(&mut self, t: u64, p: u64) -> Result<&mut OpenEntry, DropReason> {
        let known = p == 0 || self.gates.contains_key(&p);
        let is_progressive = self.commit == Commit::Progressive;
        if !known || !self.was_reached(t) {
            return Err(DropReason::Unknown);
        }
        // The timestamp was retired or skipped; this comes before *late* (F3, A16).
        let open = self.open.get_mut(&t).ok_or(DropReason::Superseded)?;
        // The last output outranks this source (F9).
        if is_progressive && open.cached.iter().any(|q| *q > p) {
            Err(DropReason::Superseded)
        } else if !open.requested.contains(&p) {
            Err(DropReason::Unsolicited)
        } else if open.cached.contains(&p) {
            Err(DropReason::Duplicate)
        } else if !open.pending.contains(&p) {
            // A timer or a failure closed the request (F3).
            Err(DropReason::Late)
        } else {
            Ok(open)
        }
    }

    /// Fires due timers by due instant and timestamp. Those of one timestamp and instant fire
    /// together (F5).
    fn expire(&mut self, out: &mut ExpectedDecisions) {
        // A timer fires at its due instant, not after it (F5, A1).
        while let Some(&(due, t, _)) = self.timers.first().filter(|timer| timer.0 <= self.now) {
            let mut cause = SettleCause::NoTimer;
            while let Some(&(_, _, p)) =
                self.timers.first().filter(|timer| (timer.0, timer.1) == (due, t))
            {
                self.disarm(t, p);
                if let Some(open) = self.open.get_mut(&t) {
                    open.pending.remove(&p);
                }
                // Local's timer alone commits nothing (F5, A9).
                if p > 0 {
                    cause = SettleCause::CloudTimer;
                }
                out.push((Decision::Timer { at: self.now, t, p }, Rule::F5));
            }
            self.settle(t, cause, out);
        }
    }

    /// Forwards the best available result, misses, or waits, after requests were closed (F6).
    fn settle(&mut self, t: u64, cause: SettleCause, out: &mut ExpectedDecisions) {
        let Some(open) = self.open.get(&t) else { return };
        match open.cached.last().copied() {
            // The result was sent before. If nothing better is pending it is final, where patient
            // would forward it (F9, P13).
            Some(_) if self.commit == Commit::Progressive && !open.pending.is_empty() => {}
            Some(last) if self.commit == Commit::Progressive => {
                self.retire(t);
                out.push((Decision::Final { at: self.now, t, p: last }, Rule::F9));
            }
            Some(best) => {
                let outranked = open.pending.iter().any(|q| *q > best);
                let fired = self.commit == Commit::Eager && cause == SettleCause::CloudTimer;
                // Nothing pending outranks it, or under eager a cloud's timer fired (F6, A4).
                if !outranked || fired {
                    self.forward(t, best, Rule::F6, out);
                }
            }
            // Nothing is available and nothing is pending (F6).
            None if open.pending.is_empty() => {
                self.retire(t);
                out.push((Decision::Miss { at: self.now, t }, Rule::F6));
            }
            None => {}
        }
    }

    /// Forwards a result, retires the timestamp and cancels its pending clouds (F7), as `rule`
    /// demands.
    fn forward(&mut self, t: u64, p: u64, rule: Rule, out: &mut ExpectedDecisions) {
        let at = self.now;
        out.push((Decision::Emit { at, t, p }, rule));
        if let Some(open) = self.retire(t) {
            // Local is never cancelled (F7, A24).
            for p in open.pending.into_iter().filter(|p| *p > 0) {
                out.push((Decision::Cancel { at, t, p }, Rule::F7));
            }
        }
    }

    /// Removes `t` and its timers.
    fn retire(&mut self, t: u64) -> Option<OpenEntry> {
        let open = self.open.remove(&t)?;
        for (p, due) in &open.armed {
            self.timers.remove(&(*due, t, *p));
        }
        Some(open)
    }

    fn arm(&mut self, t: u64, p: u64, due: u64) {
        if let Some(open) = self.open.get_mut(&t) {
            open.armed.insert(p, due);
            self.timers.insert((due, t, p));
        }
    }

    fn disarm(&mut self, t: u64, p: u64) {
        if let Some(due) = self.open.get_mut(&t).and_then(|open| open.armed.remove(&p)) {
            self.timers.remove(&(due, t, p));
        }
    }

    /// Returns the commit rule.
    #[must_use]
    pub const fn commit(&self) -> Commit {
        self.commit
    }

    /// Returns the earliest due instant of all live timers, in ns.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.timers.first().map(|timer| timer.0)
    }

    /// Returns the greatest `now` seen, in ns, which is the instant of the last decisions.
    #[must_use]
    pub const fn now(&self) -> u64 {
        self.now
    }

    /// Returns the number of open timestamps.
    #[must_use]
    pub fn open_len(&self) -> usize {
        self.open.len()
    }

    /// Returns `true` if `t` is open.
    #[must_use]
    pub fn is_open(&self, t: u64) -> bool {
        self.open.contains_key(&t)
    }

    /// Returns the open timestamps, each with `true` if it has a live timer.
    pub(crate) fn waiting(&self) -> impl Iterator<Item = (u64, bool)> {
        self.open.iter().map(|(t, open)| (*t, !open.armed.is_empty()))
    }

    /// Returns `true` if `t` or a later timestamp was ever opened.
    #[must_use]
    fn was_reached(&self, t: u64) -> bool {
        self.newest.is_some_and(|newest| newest >= t)
    }
}

impl Gate {
    /// Shuts an open gate at the limit, and opens a shut one at the resume or below (F2g).
    fn admits(&mut self, backlog: u64) -> bool {
        self.open = if self.open { backlog < self.limit } else { backlog <= self.resume };
        self.open
    }
}
