//! Stores the open timestamps in ascending order and finds the timestamp that fires first (P9).
//!
//! An entry keeps its place until its timestamp is retired. `timestamps` is sorted, and beside each
//! timestamp is the index of its entry. Retiring a timestamp moves the timestamps before it or
//! those behind it by one place, whichever are fewer, at ten bytes each. When the end of the arrays
//! is reached, everything moves to their start. That happens at most once for every `CAPACITY`
//! openings.
//!
//! Each entry has a key that orders the firings (F5). A tree with four children for each node
//! stores the least key of each group. When a key changes, it is compared with the three keys
//! beside it, and the least of the four moves up a level. This stops at the first level that stays
//! the same.
//!
//! Every access is checked: a read beyond an array yields nothing, and a write there changes
//! nothing, so this module cannot panic. `fusion.rs` has the machine that uses the window.

use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// The place of an open timestamp. It is valid until a timestamp is opened or retired.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct OpenIndex {
    /// The index into the arrays of open timestamps.
    pub(crate) place: u16,
    /// The index of its entry.
    pub(crate) entry: u16,
}

/// Orders the timestamps by when they fire (F5): by the earliest due instant of their timers, then
/// by timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct DueKey {
    /// One less than the due instant, which is never 0. The greatest value means never.
    pub(crate) due_minus_one: u64,
    pub(crate) timestamp: Timestamp,
}

impl DueKey {
    /// The key of a free entry, and of a timestamp without an armed timer.
    pub(crate) const NEVER: Self =
        Self { due_minus_one: u64::MAX, timestamp: Timestamp::new(u64::MAX) };

    pub(crate) const fn new(due: Option<Instant>, timestamp: Timestamp) -> Self {
        match due {
            Some(due) => Self { due_minus_one: due.as_nanos().wrapping_sub(1), timestamp },
            None => Self::NEVER,
        }
    }

    fn due(self) -> Option<Instant> {
        self.due_minus_one.checked_add(1).map(Instant::from_nanos)
    }

    /// Returns the earlier key. If the due instants are equal, the lesser timestamp is earlier.
    fn earlier(self, other: Self) -> Self {
        // One comparison of 128 bits is faster than two of 64.
        let number =
            |key: Self| u128::from(key.due_minus_one) << 64 | u128::from(key.timestamp.as_u64());
        if number(other) < number(self) { other } else { self }
    }
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    /// The open timestamps, ascending: `len` of them from `start` on. The other places are unused.
    pub(crate) timestamps: [[Timestamp; CAPACITY]; 2],
    /// The index of each timestamp's entry.
    pub(crate) entry_indices: [[u16; CAPACITY]; 2],
    pub(crate) start: usize,
    pub(crate) len: usize,
    /// The indices of the free entries, from the front. The other places are unused.
    pub(crate) free: [u16; CAPACITY],
    pub(crate) entries: [Entry<CLOUDS>; CAPACITY],
    /// The key of each entry.
    pub(crate) keys: [DueKey; CAPACITY],
    /// The least key of each group of four keys, level after level: each level groups the keys of
    /// the level below it.
    pub(crate) firsts: [DueKey; CAPACITY],
    /// The least key of all.
    pub(crate) first: DueKey,
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    /// The number of levels: how often four keys are reduced to one until one is left.
    pub(crate) const LEVELS: u32 = CAPACITY.next_power_of_two().trailing_zeros().div_ceil(2);

    pub(crate) fn new() -> Self {
        let mut free = [0; CAPACITY];
        for (index, number) in free.iter_mut().zip(0..) {
            *index = number;
        }
        Self {
            timestamps: [[Timestamp::new(0); CAPACITY]; 2],
            entry_indices: [[0; CAPACITY]; 2],
            start: 0,
            len: 0,
            free,
            entries: [Entry::EMPTY; CAPACITY],
            keys: [DueKey::NEVER; CAPACITY],
            firsts: [DueKey::NEVER; CAPACITY],
            first: DueKey::NEVER,
        }
    }

    /// Adds a timestamp greater than all present. Returns `false` if there is no room.
    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let Some(last_free) = CAPACITY.wrapping_sub(self.len).checked_sub(1) else { return false };
        let Some(entry_index) = self.free.get(last_free).copied() else { return false };
        let Some(stored) = self.entries.get_mut(usize::from(entry_index)) else { return false };
        *stored = entry;
        if self.end() >= CAPACITY.wrapping_mul(2) {
            self.move_to_start();
        }
        let end = self.end();
        let Some(place) = self.timestamps.as_flattened_mut().get_mut(end) else { return false };
        *place = timestamp;
        let Some(place) = self.entry_indices.as_flattened_mut().get_mut(end) else { return false };
        *place = entry_index;
        self.len = self.len.saturating_add(1);
        if let Some(due) = entry.next_due() {
            self.set_earlier_key(entry_index, DueKey::new(Some(due), timestamp));
        }
        true
    }

    /// Stores the sets and the due instant after `source` was armed.
    pub(crate) fn arm(&mut self, index: OpenIndex, slot: Slot, source: Source, due: Instant) {
        let key = DueKey::new(Some(due), self.timestamp(index));
        let at = usize::from(index.entry);
        let Some((entry, own)) = self.entries.get_mut(at).zip(self.keys.get(at)) else {
            return;
        };
        entry.slot = slot;
        entry.set_due(source, due);
        if key.due_minus_one < own.due_minus_one {
            self.set_earlier_key(index.entry, key);
        }
    }

    /// Stores sets whose armed timers were all armed before.
    pub(crate) fn set(&mut self, index: OpenIndex, slot: Slot) {
        let timestamp = self.timestamp(index);
        let Some(entry) = self.entries.get_mut(usize::from(index.entry)) else { return };
        let armed = core::mem::replace(&mut entry.slot, slot).armed();
        if armed != slot.armed() {
            let due = entry.next_due();
            self.set_key(index.entry, DueKey::new(due, timestamp));
        }
    }

    /// Removes a timestamp, moves the timestamps on its shorter side by one place, and frees its
    /// entry.
    pub(crate) fn remove(&mut self, index: OpenIndex) {
        let (place, end) = (usize::from(index.place), self.end());
        let before = place.wrapping_sub(self.start);
        let timestamps = self.timestamps.as_flattened_mut();
        let indices = self.entry_indices.as_flattened_mut();
        if before < self.len >> 1 {
            if before > 0 {
                let part = self.start..place.wrapping_add(1);
                let Some(timestamps) = timestamps.get_mut(part.clone()) else { return };
                let Some(indices) = indices.get_mut(part) else { return };
                if let Some(last) = timestamps.len().checked_sub(1) {
                    timestamps.copy_within(..last, 1);
                }
                if let Some(last) = indices.len().checked_sub(1) {
                    indices.copy_within(..last, 1);
                }
            }
            self.start = self.start.wrapping_add(1);
        } else if place.wrapping_add(1) < end {
            let Some(timestamps) = timestamps.get_mut(place..end) else { return };
            let Some(indices) = indices.get_mut(place..end) else { return };
            timestamps.copy_within(1.., 0);
            indices.copy_within(1.., 0);
        }
        if let Some(free) = self.free.get_mut(CAPACITY.wrapping_sub(self.len)) {
            *free = index.entry;
        }
        self.len = self.len.saturating_sub(1);
        self.set_key(index.entry, DueKey::NEVER);
    }

    /// Makes room behind the last timestamp. All open timestamps are in the second half of the
    /// arrays.
    #[cold]
    fn move_to_start(&mut self) {
        let Some((to, from)) = self.timestamps.as_flattened_mut().split_at_mut_checked(self.start)
        else {
            return;
        };
        let Some((to, from)) = to.get_mut(..self.len).zip(from.get(..self.len)) else { return };
        to.copy_from_slice(from);
        let Some((to, from)) =
            self.entry_indices.as_flattened_mut().split_at_mut_checked(self.start)
        else {
            return;
        };
        let Some((to, from)) = to.get_mut(..self.len).zip(from.get(..self.len)) else { return };
        to.copy_from_slice(from);
        self.start = 0;
    }

    /// Returns the place behind the last open timestamp.
    const fn end(&self) -> usize {
        self.start.wrapping_add(self.len)
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<OpenIndex> {
        let open = self.timestamps.as_flattened().get(self.start..self.end())?;
        // Most late inputs are for timestamps older than all open ones or for the oldest, and
        // offers follow their message's open.
        let first = *open.first()?;
        if timestamp < first {
            return None;
        }
        let before = if timestamp == first {
            0
        } else if timestamp == *open.last()? {
            self.len.wrapping_sub(1)
        } else {
            open.binary_search(&timestamp).ok()?
        };
        let place = self.start.wrapping_add(before);
        let entry = self.entry_indices.as_flattened().get(place).copied()?;
        Some(OpenIndex { place: u16::try_from(place).ok()?, entry })
    }

    /// Returns the open timestamps in ascending order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        let open = self.timestamps.as_flattened().iter().zip(self.entry_indices.as_flattened());
        let open = open.skip(self.start).take(self.len);
        open.map(|(timestamp, entry_index)| (*timestamp, self.entry_at(*entry_index)))
    }

    /// Returns the earliest due instant.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.first.due()
    }

    /// Returns the least timestamp with a timer at the next due instant (F5).
    pub(crate) fn first_due(&self) -> Option<OpenIndex> {
        self.find(self.first.timestamp)
    }

    pub(crate) fn entry(&self, index: OpenIndex) -> &Entry<CLOUDS> {
        self.entry_at(index.entry)
    }

    pub(crate) fn timestamp(&self, index: OpenIndex) -> Timestamp {
        let place = usize::from(index.place);
        self.timestamps.as_flattened().get(place).copied().unwrap_or(Timestamp::new(0))
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    fn entry_at(&self, entry_index: u16) -> &Entry<CLOUDS> {
        self.entries.get(usize::from(entry_index)).unwrap_or(&Entry::EMPTY)
    }

    /// Stores a key that is earlier than the entry's. It replaces the least key of each level above
    /// until one is earlier still.
    fn set_earlier_key(&mut self, entry_index: u16, key: DueKey) {
        let mut at = usize::from(entry_index);
        let Some(own) = self.keys.get_mut(at) else { return };
        *own = key;
        let (mut len, mut above) = (CAPACITY, self.firsts.as_mut_slice());
        for _ in 0..Self::LEVELS {
            at >>= 2;
            len = len.wrapping_add(3) >> 2;
            let Some((level, rest)) = above.split_at_mut_checked(len) else { return };
            let Some(first) = level.get_mut(at) else { return };
            if first.earlier(key) == *first {
                return;
            }
            *first = key;
            above = rest;
        }
        self.first = key;
    }

    /// Stores an entry's key, and finds the least key of each level above again until one stays the
    /// same.
    fn set_key(&mut self, entry_index: u16, key: DueKey) {
        let mut at = usize::from(entry_index);
        let Some(own) = self.keys.get_mut(at) else { return };
        if *own == key {
            return;
        }
        *own = key;
        let mut first = key;
        let (mut below, mut above) = (self.keys.as_slice(), self.firsts.as_mut_slice());
        for _ in 0..Self::LEVELS {
            let beside = |n: usize| below.get(at ^ n).copied().unwrap_or(DueKey::NEVER);
            first = first.earlier(beside(1).earlier(beside(2)).earlier(beside(3)));
            at >>= 2;
            let len = below.len().wrapping_add(3) >> 2;
            let Some((level, rest)) = above.split_at_mut_checked(len) else { return };
            let Some(own) = level.get_mut(at) else { return };
            if *own == first {
                return;
            }
            *own = first;
            (below, above) = (level, rest);
        }
        self.first = first;
    }
}

#[cfg(test)]
#[expect(clippy::arithmetic_side_effects, clippy::integer_division, reason = "a test may panic")]
mod tests;
