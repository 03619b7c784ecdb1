//! A reference machine for the judge's fast path. Each of its sets is a word of bits.
//!
//! It decides as [`Reference`](crate::Reference) does, by the same rules in the same order. Tests
//! compare the two on every file of the corpus and on random runs. It shares no code with the
//! machine that ships.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use crate::event::{Commit, Decision, Header, Input};
use crate::reason::{DropReason, OfferRefusal, OpenRefusal};
use crate::reference::ExpectedDecisions;
use crate::rule::Rule;

/// The number of disarmed timers that may wait beside as many live ones before they are removed.
const STALE: usize = 64;
/// The set of local alone.
const LOCAL: u16 = 1;

/// Decides about inputs one by one, and gives each decision with the rule that demands it.
///
/// Its memory is bounded by the window and the number of clouds.
#[derive(Clone, Debug)]
pub(crate) struct CompactReference {
    window: usize,
    commit: Commit,
    /// The priorities of local and of the clouds, ascending. A source's index is its bit.
    priorities: Vec<u64>,
    /// Each cloud's gate, in the same order.
    gates: Vec<CompactGate>,
    /// The greatest `now` seen.
    now: u64,
    /// The greatest timestamp ever opened.
    newest: Option<u64>,
    /// The open timestamps, ascending.
    open: VecDeque<OpenBits>,
    /// The due instant, timestamp and source of each timer. Some of them were disarmed: a request
    /// is armed at most once.
    timers: BinaryHeap<Reverse<(u64, u64, usize)>>,
    /// The number of live timers.
    live: usize,
}

#[derive(Clone, Copy, Debug)]
struct CompactGate {
    limit: u64,
    resume: u64,
    open: bool,
}

/// The sets of one open timestamp.
#[derive(Clone, Copy, Debug)]
struct OpenBits {
    t: u64,
    requested: u16,
    pending: u16,
    armed: u16,
    cached: u16,
    /// `true` if a result or a failure came for it.
    is_touched: bool,
}

impl CompactReference {
    /// Creates a machine with this configuration and no open timestamp.
    pub(crate) fn new(header: &Header) -> Self {
        let mut clouds: Vec<_> = header.clouds.iter().collect();
        clouds.sort_by_key(|cloud| cloud.p);
        let gate = |limit, resume| CompactGate { limit, resume, open: true };
        let priorities = clouds.iter().map(|cloud| u64::from(cloud.p));
        Self {
            window: header.window.into(),
            commit: header.commit,
            priorities: [0].into_iter().chain(priorities).collect(),
            gates: clouds.iter().map(|cloud| gate(cloud.limit, cloud.resume)).collect(),
            now: 0,
            newest: None,
            open: VecDeque::new(),
            timers: BinaryHeap::new(),
            live: 0,
        }
    }

    /// Appends the decisions that the rules demand for `input`.
    pub(crate) fn apply(&mut self, input: &Input, out: &mut ExpectedDecisions) {
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

    /// Notes that an input came for a timestamp, if it is open.
    pub(crate) fn touch(&mut self, t: u64) {
        if let Some(open) = self.find(t).and_then(|place| self.open.get_mut(place)) {
            open.is_touched = true;
        }
    }

    /// Returns the number of open timestamps for which a result or a failure came.
    pub(crate) fn touched_len(&self) -> usize {
        self.open.iter().filter(|open| open.is_touched).count()
    }

    /// Returns the open timestamps, each with `true` if it has a live timer.
    pub(crate) fn waiting(&self) -> impl Iterator<Item = (u64, bool)> {
        self.open.iter().map(|open| (open.t, open.armed != 0))
    }

    /// Returns the commit rule.
    pub(crate) const fn commit(&self) -> Commit {
        self.commit
    }

    /// Returns the earliest due instant of all live timers.
    pub(crate) fn next_due(&mut self) -> Option<u64> {
        while let Some(&Reverse((due, t, source))) = self.timers.peek() {
            if self.is_live(t, source) {
                return Some(due);
            }
            self.timers.pop();
        }
        None
    }

    /// Opens a timestamp that waits for local, or refuses for the first reason that holds (F1).
    fn open(&mut self, t: u64, deadline: Option<u64>, out: &mut ExpectedDecisions) {
        let at = self.now;
        let due = deadline.map(|deadline| at.saturating_add(deadline));
        let why = if self.was_reached(t) {
            OpenRefusal::Order
        } else if self.open.len() >= self.window {
            OpenRefusal::Full
        } else if due.is_some_and(|due| due <= at) {
            OpenRefusal::Deadline
        } else {
            self.newest = Some(t);
            let armed = if due.is_some() { LOCAL } else { 0 };
            let (requested, pending, cached, is_touched) = (LOCAL, LOCAL, 0, false);
            self.open.push_back(OpenBits { t, requested, pending, armed, cached, is_touched });
            if let Some(due) = due {
                self.arm(due, t, 0);
            }
            return;
        };
        out.push((Decision::RefuseOpen { at, t, why }, Rule::F1));
    }

    /// Requests a cloud with a due instant `deadline` after now, or refuses, which changes at most
    /// the gate (F2).
    fn offer(&mut self, t: u64, p: u64, deadline: u64, backlog: u64, out: &mut ExpectedDecisions) {
        let at = self.now;
        let due = at.saturating_add(deadline);
        match self.admit(t, p, due, backlog) {
            Ok(source) => {
                self.arm(due, t, source);
                out.push((Decision::Request { at, t, p, due }, Rule::F2));
            }
            Err(why) => {
                let rule = if why == OfferRefusal::Queue { Rule::F2g } else { Rule::F2 };
                out.push((Decision::RefuseOffer { at, t, p, why }, rule));
            }
        }
    }

    /// Requests `(t, p)` and returns the source, or the first reason to refuse (F2).
    fn admit(&mut self, t: u64, p: u64, due: u64, backlog: u64) -> Result<usize, OfferRefusal> {
        // The cloud is unknown, or the timestamp is beyond all that were opened (F2).
        let source = self.source(p).filter(|source| *source > 0 && self.was_reached(t));
        let source = source.ok_or(OfferRefusal::Unknown)?;
        let place = self.find(t).ok_or(OfferRefusal::Closed)?;
        let open = self.open.get_mut(place).ok_or(OfferRefusal::Closed)?;
        let gate = self.gates.get_mut(source - 1).ok_or(OfferRefusal::Unknown)?;
        let bit = 1 << source;
        // It was requested before, whatever became of the request (F2, A26).
        if open.requested & bit != 0 {
            return Err(OfferRefusal::Duplicate);
        }
        // This result could never be forwarded (F2, A17).
        if above(open.cached, source) {
            return Err(OfferRefusal::Outranked);
        }
        // The request would be over at once (F2, A11).
        if due <= self.now {
            return Err(OfferRefusal::Deadline);
        }
        // The gate comes last, after all other reasons (F2g).
        gate.open = if gate.open { backlog < gate.limit } else { backlog <= gate.resume };
        if !gate.open {
            return Err(OfferRefusal::Queue);
        }
        open.requested |= bit;
        open.pending |= bit;
        open.armed |= bit;
        Ok(source)
    }

    /// Drops a result, holds it while a source that outranks it is pending, or forwards it (F3).
    fn result(&mut self, t: u64, p: u64, out: &mut ExpectedDecisions) {
        let (at, commit) = (self.now, self.commit);
        let (place, source) = match self.accept(t, p) {
            Ok(accepted) => accepted,
            Err(why) => return out.push((Decision::Drop { at, t, p, why }, Rule::F3)),
        };
        let Some(open) = self.open.get_mut(place) else { return };
        let bit = 1 << source;
        open.pending &= !bit;
        if commit == Commit::Progressive {
            return self.send(place, source, out);
        }
        if above(open.pending, source) {
            open.cached |= bit;
            // Under eager a cloud's timer runs on, to commit (F3, A3).
            if commit == Commit::Patient || source == 0 {
                self.close(place, bit);
            }
            out.push((Decision::Hold { at, t, p }, Rule::F3));
        } else {
            self.forward(place, source, Rule::F3, out);
        }
    }

    /// Forwards a result, stops waiting for sources that it outranks, and ends the timestamp if
    /// nothing better is pending (F9).
    fn send(&mut self, place: usize, source: usize, out: &mut ExpectedDecisions) {
        let (at, p) = (self.now, self.priority(source));
        let Some(open) = self.open.get_mut(place) else { return };
        let (t, bit) = (open.t, 1 << source);
        out.push((Decision::Emit { at, t, p }, Rule::F9));
        open.cached = bit;
        let outranked = open.pending & (bit - 1);
        open.pending &= !outranked;
        let disarmed = open.armed & (outranked | bit);
        open.armed &= !disarmed;
        let is_over = open.pending == 0;
        self.live -= disarmed.count_ones() as usize;
        self.cancel(t, outranked, Rule::F9, out);
        if is_over {
            self.retire(place);
            out.push((Decision::Final { at, t, p }, Rule::F9));
        }
    }

    /// Drops a failure for the reasons that drop a result, or closes the request and settles as by
    /// no timer (F4, A36).
    fn fail(&mut self, t: u64, p: u64, out: &mut ExpectedDecisions) {
        match self.accept(t, p) {
            Ok((place, source)) => {
                self.close(place, 1 << source);
                self.settle(place, false, out);
            }
            Err(why) => out.push((Decision::Drop { at: self.now, t, p, why }, Rule::F4)),
        }
    }

    /// Returns the indices of the open timestamp and of the source, or the reason to drop an input
    /// for `(t, p)` (F3, F4).
    fn accept(&self, t: u64, p: u64) -> Result<(usize, usize), DropReason> {
        let source = self.source(p).filter(|_| self.was_reached(t)).ok_or(DropReason::Unknown)?;
        // The timestamp was retired or skipped; this comes before *late* (F3, A16).
        let place = self.find(t).ok_or(DropReason::Superseded)?;
        let open = self.open.get(place).ok_or(DropReason::Superseded)?;
        let bit = 1 << source;
        // The last output outranks this source (F9).
        if self.commit == Commit::Progressive && above(open.cached, source) {
            Err(DropReason::Superseded)
        } else if open.requested & bit == 0 {
            Err(DropReason::Unsolicited)
        } else if open.cached & bit != 0 {
            Err(DropReason::Duplicate)
        } else if open.pending & bit == 0 {
            // A timer or a failure closed the request (F3).
            Err(DropReason::Late)
        } else {
            Ok((place, source))
        }
    }

    /// Fires due timers by due instant and timestamp. Those of one timestamp and instant fire
    /// together (F5).
    fn expire(&mut self, out: &mut ExpectedDecisions) {
        // A timer fires at its due instant, not after it (F5, A1).
        while let Some(&Reverse((due, t, _))) = self.timers.peek()
            && due <= self.now
        {
            let mut ripe = 0_u16;
            while let Some(&Reverse((next_due, next_t, source))) = self.timers.peek()
                && (next_due, next_t) == (due, t)
            {
                self.timers.pop();
                ripe |= 1 << source;
            }
            let Some(place) = self.find(t) else { continue };
            let fired = self.close(place, ripe);
            for source in bits(fired) {
                let p = self.priority(source);
                out.push((Decision::Timer { at: self.now, t, p }, Rule::F5));
            }
            if fired != 0 {
                // Local's timer alone commits nothing (F5, A9).
                self.settle(place, fired > LOCAL, out);
            }
        }
    }

    /// Forwards the best available result, misses, or waits, after requests were closed, perhaps by
    /// a cloud's timer (F6).
    fn settle(&mut self, place: usize, by_cloud: bool, out: &mut ExpectedDecisions) {
        let Some(&OpenBits { t, pending, cached, .. }) = self.open.get(place) else { return };
        let at = self.now;
        if cached == 0 {
            // Nothing is available and nothing is pending (F6).
            if pending == 0 {
                self.retire(place);
                out.push((Decision::Miss { at, t }, Rule::F6));
            }
            return;
        }
        let best = cached.ilog2() as usize;
        if self.commit == Commit::Progressive {
            // The result was sent before. If nothing better is pending it is final, where patient
            // would forward it (F9, P13).
            if pending == 0 {
                self.retire(place);
                out.push((Decision::Final { at, t, p: self.priority(best) }, Rule::F9));
            }
        } else if !above(pending, best) || (self.commit == Commit::Eager && by_cloud) {
            // Nothing pending outranks it, or under eager a cloud's timer fired (F6, A4).
            self.forward(place, best, Rule::F6, out);
        }
    }

    /// Forwards a result, retires the timestamp and cancels its pending clouds (F7), as `rule`
    /// demands.
    fn forward(&mut self, place: usize, source: usize, rule: Rule, out: &mut ExpectedDecisions) {
        if let Some(OpenBits { t, pending, .. }) = self.retire(place) {
            out.push((Decision::Emit { at: self.now, t, p: self.priority(source) }, rule));
            self.cancel(t, pending, Rule::F7, out);
        }
    }

    /// Cancels the clouds among these sources. Local is never cancelled (A24).
    fn cancel(&self, t: u64, sources: u16, rule: Rule, out: &mut ExpectedDecisions) {
        for source in bits(sources & !LOCAL) {
            out.push((Decision::Cancel { at: self.now, t, p: self.priority(source) }, rule));
        }
    }

    /// Removes a timestamp and its timers.
    fn retire(&mut self, place: usize) -> Option<OpenBits> {
        let open = self.open.remove(place)?;
        self.live -= open.armed.count_ones() as usize;
        Some(open)
    }

    /// Closes the requests of these sources. Returns those whose timers were live.
    fn close(&mut self, place: usize, sources: u16) -> u16 {
        let Some(open) = self.open.get_mut(place) else { return 0 };
        let armed = open.armed & sources;
        open.armed &= !armed;
        // A held result's source is no longer pending, but its timer may run on (A3).
        open.pending &= !sources;
        self.live -= armed.count_ones() as usize;
        armed
    }

    /// Adds the timer of a source that is armed.
    fn arm(&mut self, due: u64, t: u64, source: usize) {
        self.live += 1;
        self.timers.push(Reverse((due, t, source)));
        if self.timers.len() > 2 * self.live + STALE {
            let Self { timers, open, .. } = self;
            timers.retain(|Reverse((_, t, source))| is_armed(open, *t, *source));
        }
    }

    fn is_live(&self, t: u64, source: usize) -> bool {
        is_armed(&self.open, t, source)
    }

    /// Returns the index of an open timestamp.
    fn find(&self, t: u64) -> Option<usize> {
        find(&self.open, t)
    }

    /// Returns the index of a source, if it is local or registered.
    fn source(&self, p: u64) -> Option<usize> {
        self.priorities.iter().position(|known| *known == p)
    }

    fn priority(&self, source: usize) -> u64 {
        self.priorities.get(source).copied().unwrap_or_default()
    }

    /// Returns `true` if `t` or a later timestamp was ever opened.
    fn was_reached(&self, t: u64) -> bool {
        self.newest.is_some_and(|newest| newest >= t)
    }
}

/// Returns the indices of a set's bits, ascending.
fn bits(mut set: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let next = (set != 0).then(|| set.trailing_zeros() as usize);
        set &= set.wrapping_sub(1);
        next
    })
}

/// Returns `true` if the set contains a source above this one.
const fn above(set: u16, source: usize) -> bool {
    set as u32 >> (source + 1) != 0
}

fn is_armed(open: &VecDeque<OpenBits>, t: u64, source: usize) -> bool {
    let open = find(open, t).and_then(|place| open.get(place));
    open.is_some_and(|open| open.armed & (1 << source) != 0)
}

fn find(open: &VecDeque<OpenBits>, t: u64) -> Option<usize> {
    open.binary_search_by_key(&t, |open| open.t).ok()
}

#[cfg(test)]
mod tests;
