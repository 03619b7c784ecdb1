//! Finds gaps between the opens of a trace (J1).

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use super::slack::Slack;

/// Goes through the instants at which timestamps were opened, in the order of time.
///
/// Lines may be out of order, and a later refusal may remove an open (A42). So each open waits
/// until neither can happen any more.
#[derive(Clone, Debug)]
pub(super) struct Gaps {
    /// The longest time without an open that is not a gap.
    most: u64,
    waiting: BinaryHeap<Reverse<Opened>>,
    /// The opens that are known to have been refused.
    refused: BTreeSet<Opened>,
    last: Option<Opened>,
    /// The least instant of the trace.
    begin: Option<u64>,
}

/// An open as it was recorded.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) struct Opened {
    pub(super) at: u64,
    pub(super) line: u64,
    pub(super) t: u64,
}

/// A time without an open that is too long.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Gap {
    /// The timestamp opened before it, or `None` if there was none.
    pub(super) after: Option<u64>,
    pub(super) from: u64,
    pub(super) to: u64,
    /// The longest time that is not a gap.
    pub(super) most: u64,
}

impl Gaps {
    pub(super) const fn new(period: u64, slack: Slack) -> Self {
        let Slack { tolerance, lateness } = slack;
        let most = period.saturating_add(lateness).saturating_add(tolerance.saturating_mul(2));
        Self { most, waiting: BinaryHeap::new(), refused: BTreeSet::new(), last: None, begin: None }
    }

    /// Notes the instant of any line.
    pub(super) fn sees(&mut self, at: u64) {
        self.begin = Some(self.begin.map_or(at, |begin| begin.min(at)));
    }

    pub(super) fn opens(&mut self, opened: Opened) {
        self.waiting.push(Reverse(opened));
    }

    /// Notes that the open was refused.
    pub(super) fn refuses(&mut self, opened: Opened) {
        // The opens before the next one were settled.
        if self.next().is_some_and(|next| next <= opened) {
            self.refused.insert(opened);
        }
    }

    /// Returns the earliest open that waits.
    pub(super) fn next(&self) -> Option<Opened> {
        self.waiting.peek().map(|Reverse(next)| *next)
    }

    /// Removes the earliest open that waits and returns the gap before it, if there is one.
    pub(super) fn settle(&mut self, is_accepted: bool) -> Option<Gap> {
        let Reverse(opened) = self.waiting.pop()?;
        if self.refused.remove(&opened) || !is_accepted {
            return None;
        }
        let before = self.last.replace(opened)?;
        self.between(Some(before.t), before.at, opened.at)
    }

    /// Returns the gap at the end, if there is one.
    pub(super) fn ends(&self, end: u64) -> Option<Gap> {
        let after = self.last.map(|last| last.t);
        let from = self.last.map(|last| last.at).or(self.begin)?;
        self.between(after, from, end)
    }

    fn between(&self, after: Option<u64>, from: u64, to: u64) -> Option<Gap> {
        let is_gap = to.saturating_sub(from) > self.most;
        is_gap.then_some(Gap { after, from, to, most: self.most })
    }
}

impl Gap {
    pub(super) fn found(&self) -> String {
        let Self { after, from, to, .. } = *self;
        let length = to - from;
        match after {
            Some(t) => format!("no open for {length} ns after the open of timestamp {t} at {from}"),
            None => format!("no open in {length} ns, from {from} to {to}"),
        }
    }

    pub(super) fn expected(&self) -> String {
        let by = self.from.saturating_add(self.most);
        format!(
            "an open at {by} at the latest: a period, the lateness and twice the tolerance later"
        )
    }

    /// Returns the time by which the gap exceeds what is allowed.
    pub(super) const fn excess(&self) -> u64 {
        self.to.saturating_sub(self.from).saturating_sub(self.most)
    }
}
