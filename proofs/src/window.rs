//! A window with the functions of the shipped one, for any number of open timestamps.
//!
//! The façade's harnesses run the shipped `fusion.rs` over this window instead of the shipped one. One
//! timestamp, *own*, may be any timestamp and is represented exactly. Of all *others* the window knows their
//! number, a bound above them, and their first key. A query about the others has any answer that some open
//! timestamps could give, so a proof holds beside any number of them.
//!
//! This is the whole contract between façade and window. Assertions check that the façade meets a function's
//! needs. The harnesses of the group `window` prove that the shipped window does what this one does.
//!
//! | function | needs | does |
//! |---|---|---|
//! | `new` | | nothing is open |
//! | `find` | | returns the index of an open timestamp, and none for another |
//! | `timestamp`, `entry` | an index that was found since the last change | returns what is there |
//! | `push` | a timestamp greater than all that are open | opens it with its entry if there is room; otherwise nothing changes |
//! | `arm` | such an index; one timer is armed that was not | stores the sets and the due instant; no other timestamp changes |
//! | `set` | such an index; no timer is armed that was not | stores the sets; due instants and other timestamps stay the same |
//! | `remove` | such an index | closes it; no other timestamp changes |
//! | `len` | | returns the number of open timestamps |
//! | `next_due` | | returns the least due instant of all armed timers |
//! | `first_due` | | returns the least of the timestamps with a timer due then |
//!
//! `iter` shows only own: the façade uses it to compare and print, and decides nothing by it.

use crate::arbitrary::{any_others_after, earliest, least};
use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// The timestamp that an index belongs to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum OpenIndex {
    Own,
    Other(Timestamp),
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    pub(crate) own: Timestamp,
    pub(crate) is_open: bool,
    /// Own's entry, if it is open.
    pub(crate) entry: Entry<CLOUDS>,
    /// The least due instant of own's armed timers.
    pub(crate) due: Option<Instant>,
    pub(crate) others: Others<CLOUDS>,
}

/// All open timestamps except own.
#[derive(Clone, Copy)]
pub(crate) struct Others<const CLOUDS: usize> {
    pub(crate) len: usize,
    /// None of them is greater than this.
    pub(crate) greatest: Timestamp,
    /// The least due instant of their armed timers, and the least of the timestamps that have it.
    pub(crate) first: Option<(Instant, Timestamp)>,
    /// The entry of the timestamp that is looked at.
    pub(crate) entry: Entry<CLOUDS>,
}

impl<const CLOUDS: usize> Others<CLOUDS> {
    pub(crate) const EMPTY: Self =
        Self { len: 0, greatest: Timestamp::new(0), first: None, entry: Entry::EMPTY };

    /// Records that a timer of this timestamp is due at this instant.
    fn arm(&mut self, due: Instant, timestamp: Timestamp) {
        if self.first.is_none_or(|first| (due, timestamp) < first) {
            self.first = Some((due, timestamp));
        }
    }

    /// Records that the key of a timestamp is later than before, or gone.
    fn disarm(&mut self, own: Timestamp, timestamp: Timestamp) {
        if let Some(first) = self.first.filter(|first| first.1 == timestamp) {
            self.first = any_others_after(self, own, first);
        }
    }
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    pub(crate) fn new() -> Self {
        let own = Timestamp::new(kani::any());
        Self { own, is_open: false, entry: Entry::EMPTY, due: None, others: Others::EMPTY }
    }

    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let above_own = !self.is_open || timestamp > self.own;
        let above_rest = self.others.len == 0 || timestamp > self.others.greatest;
        kani::assert(above_own && above_rest, "P9: what is opened is greater than all open");
        if self.len() >= CAPACITY {
            return false;
        }
        if timestamp == self.own {
            self.is_open = true;
            self.entry = entry;
            self.due = earliest(&entry);
        } else {
            self.others.len += 1;
            self.others.greatest = timestamp;
            if let Some(due) = earliest(&entry) {
                self.others.arm(due, timestamp);
            }
        }
        true
    }

    pub(crate) fn arm(&mut self, index: OpenIndex, slot: Slot, source: Source, due: Instant) {
        kani::assert(self.is_open(index), "P9: what is armed is open");
        let armed = self.entry(index).slot.armed();
        let one_more = !armed.contains(source) && slot.armed() == armed.with(source);
        kani::assert(one_more, "P9: one timer is armed that was not");
        match index {
            OpenIndex::Own => {
                self.entry.slot = slot;
                self.entry.set_due(source, due);
                self.due = least(self.due, Some(due));
            }
            OpenIndex::Other(timestamp) => self.others.arm(due, timestamp),
        }
    }

    pub(crate) fn set(&mut self, index: OpenIndex, slot: Slot) {
        kani::assert(self.is_open(index), "P9: what is stepped is open");
        let no_more = self.entry(index).slot.armed().contains_all(slot.armed());
        kani::assert(no_more, "P9: no timer is armed that was not");
        match index {
            OpenIndex::Own => {
                self.entry.slot = slot;
                self.due = earliest(&self.entry);
            }
            OpenIndex::Other(timestamp) => self.others.disarm(self.own, timestamp),
        }
    }

    pub(crate) fn remove(&mut self, index: OpenIndex) {
        kani::assert(self.is_open(index), "P9: what is retired is open");
        match index {
            OpenIndex::Own => {
                self.is_open = false;
                self.due = None;
            }
            OpenIndex::Other(timestamp) => {
                self.others.len -= 1;
                self.others.disarm(self.own, timestamp);
            }
        }
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<OpenIndex> {
        if timestamp == self.own {
            return self.is_open.then_some(OpenIndex::Own);
        }
        let is_first = self.others.first.is_some_and(|first| first.1 == timestamp);
        let may_be = self.others.len > 0 && timestamp <= self.others.greatest;
        let is_open = is_first || may_be && kani::any();
        is_open.then_some(OpenIndex::Other(timestamp))
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        self.is_open.then_some((self.own, &self.entry)).into_iter()
    }

    pub(crate) fn next_due(&self) -> Option<Instant> {
        least(self.due, self.others.first.map(|first| first.0))
    }

    pub(crate) fn first_due(&self) -> Option<OpenIndex> {
        let own = self.due.map(|due| (due, self.own));
        match self.others.first.filter(|first| own.is_none_or(|own| *first < own)) {
            None => own.map(|_| OpenIndex::Own),
            Some((_, timestamp)) => {
                // A due timer is armed.
                kani::assume(!self.others.entry.slot.armed().is_empty());
                Some(OpenIndex::Other(timestamp))
            }
        }
    }

    pub(crate) fn entry(&self, index: OpenIndex) -> &Entry<CLOUDS> {
        match index {
            OpenIndex::Own => &self.entry,
            OpenIndex::Other(_) => &self.others.entry,
        }
    }

    pub(crate) fn timestamp(&self, index: OpenIndex) -> Timestamp {
        match index {
            OpenIndex::Own => self.own,
            OpenIndex::Other(timestamp) => timestamp,
        }
    }

    pub(crate) const fn len(&self) -> usize {
        self.others.len + self.is_open as usize
    }

    const fn is_open(&self, index: OpenIndex) -> bool {
        match index {
            OpenIndex::Own => self.is_open,
            OpenIndex::Other(_) => self.others.len > 0,
        }
    }
}
