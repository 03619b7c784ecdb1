//! The open timestamps in ascending order, and which of them fires first (P9).
//!
//! An entry stays where it is until its timestamp is retired. Each open timestamp has the index of its entry, and those
//! behind a retired timestamp move up, ten bytes each. Each entry has a key for the order of firing (F5). The keys are
//! divided into rows, at most 32 rows of at most 32 keys; the first key of each row is stored, and the first of all. An
//! earlier key is compared with these two. Where a key becomes later, the keys of its row are read, and those of the rows.
//!
//! Every access is checked: a read beyond an array yields nothing and a write changes nothing, so this cannot panic. The
//! machine that uses the window is in `fusion.rs`.

use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// Where an open timestamp is. Valid until a timestamp is retired.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct OpenIndex {
    /// How many of the open timestamps are less.
    pub(crate) rank: u16,
    /// Which entry is its own.
    pub(crate) entry: u16,
}

/// The key by which timestamps fire in the order of F5: the earliest due instant of its timers, then the timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct DueKey {
    /// One less than the due instant: what is armed is due after the clock's start. The greatest value means never.
    pub(crate) due_minus_one: u64,
    pub(crate) timestamp: Timestamp,
}

impl DueKey {
    /// That of a free entry, and of a timestamp without an armed timer.
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

    /// The earlier key; of equal due instants that of the lesser timestamp.
    fn earlier(self, other: Self) -> Self {
        // One comparison of 128 bits.
        let number =
            |key: Self| u128::from(key.due_minus_one) << 64 | u128::from(key.timestamp.as_u64());
        if number(other) < number(self) { other } else { self }
    }

    fn first(keys: &[Self]) -> Self {
        keys.iter().copied().fold(Self::NEVER, Self::earlier)
    }
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    /// Ascending; from `len` on they mean nothing.
    pub(crate) timestamps: [Timestamp; CAPACITY],
    /// The index of the entry of each; from `len` on, those of the free entries.
    pub(crate) entry_indices: [u16; CAPACITY],
    pub(crate) len: usize,
    /// By index.
    pub(crate) entries: [Entry<CLOUDS>; CAPACITY],
    /// By index of the entry.
    pub(crate) keys: [DueKey; CAPACITY],
    /// The first key of each row; those beyond the last row mean nothing.
    pub(crate) row_firsts: [DueKey; CAPACITY],
    /// The first key of all.
    pub(crate) first: DueKey,
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    /// A row has the least power of two of keys whose square is no less than the capacity.
    const ROW_BITS: u32 = CAPACITY.next_power_of_two().trailing_zeros().div_ceil(2);
    pub(crate) const ROW: usize = 1 << Self::ROW_BITS;
    pub(crate) const ROWS: usize = CAPACITY.div_ceil(Self::ROW);

    pub(crate) fn new() -> Self {
        let mut entry_indices = [0; CAPACITY];
        for (index, number) in entry_indices.iter_mut().zip(0..) {
            *index = number;
        }
        Self {
            timestamps: [Timestamp::new(0); CAPACITY],
            entry_indices,
            len: 0,
            entries: [Entry::EMPTY; CAPACITY],
            keys: [DueKey::NEVER; CAPACITY],
            row_firsts: [DueKey::NEVER; CAPACITY],
            first: DueKey::NEVER,
        }
    }

    /// Adds a timestamp greater than all present; false if there is no room.
    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let Some(last) = self.timestamps.get_mut(self.len) else { return false };
        let Some(entry_index) = self.entry_indices.get(self.len).copied() else { return false };
        let Some(stored) = self.entries.get_mut(usize::from(entry_index)) else { return false };
        *last = timestamp;
        *stored = entry;
        self.len = self.len.saturating_add(1);
        if let Some(due) = entry.next_due() {
            self.set_earlier_key(entry_index, DueKey::new(Some(due), timestamp));
        }
        true
    }

    /// Stores the sets in which `source` is armed anew, and its due instant.
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

    /// Stores sets in which no more is armed than before.
    pub(crate) fn set(&mut self, index: OpenIndex, slot: Slot) {
        let timestamp = self.timestamp(index);
        let Some(entry) = self.entries.get_mut(usize::from(index.entry)) else { return };
        let armed = core::mem::replace(&mut entry.slot, slot).armed();
        if armed != slot.armed() {
            let due = entry.next_due();
            self.set_key(index.entry, DueKey::new(due, timestamp));
        }
    }

    /// Removes a timestamp: those behind it move up, and its entry is the first of the free ones.
    pub(crate) fn remove(&mut self, index: OpenIndex) {
        let behind = usize::from(index.rank)..self.len;
        let Some(timestamps) = self.timestamps.get_mut(behind.clone()) else { return };
        let Some(indices) = self.entry_indices.get_mut(behind).filter(|own| !own.is_empty()) else {
            return;
        };
        timestamps.copy_within(1.., 0);
        indices.copy_within(1.., 0);
        if let Some(last) = indices.last_mut() {
            *last = index.entry;
        }
        self.len = self.len.saturating_sub(1);
        self.set_key(index.entry, DueKey::NEVER);
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<OpenIndex> {
        let open = self.timestamps.get(..self.len)?;
        // What comes late is mostly older than all that are open, and offers follow their message's open.
        if timestamp < *open.first()? {
            return None;
        }
        let rank = if timestamp == *open.last()? {
            self.len.wrapping_sub(1)
        } else {
            open.binary_search(&timestamp).ok()?
        };
        Some(OpenIndex {
            rank: u16::try_from(rank).ok()?,
            entry: self.entry_indices.get(rank).copied()?,
        })
    }

    /// The open timestamps in ascending order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        let open = self.timestamps.iter().zip(&self.entry_indices).take(self.len);
        open.map(|(timestamp, entry_index)| (*timestamp, self.entry_at(*entry_index)))
    }

    /// The earliest due instant.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.first.due()
    }

    /// F5: of the timestamps with a timer at the next due instant the least.
    pub(crate) fn first_due(&self) -> Option<OpenIndex> {
        self.find(self.first.timestamp)
    }

    pub(crate) fn entry(&self, index: OpenIndex) -> &Entry<CLOUDS> {
        self.entry_at(index.entry)
    }

    pub(crate) fn timestamp(&self, index: OpenIndex) -> Timestamp {
        self.timestamps.get(usize::from(index.rank)).copied().unwrap_or(Timestamp::new(0))
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    fn entry_at(&self, entry_index: u16) -> &Entry<CLOUDS> {
        self.entries.get(usize::from(entry_index)).unwrap_or(&Entry::EMPTY)
    }

    /// Stores a key earlier than the entry's: the first of its row and of all become earlier with it, or stay.
    fn set_earlier_key(&mut self, entry_index: u16, key: DueKey) {
        let entry_index = usize::from(entry_index);
        let Some(own) = self.keys.get_mut(entry_index) else { return };
        let Some(first) = self.row_firsts.get_mut(entry_index >> Self::ROW_BITS) else { return };
        *own = key;
        *first = first.earlier(key);
        self.first = self.first.earlier(key);
    }

    /// Stores an entry's key, and finds the first of its row and of all rows again.
    fn set_key(&mut self, entry_index: u16, key: DueKey) {
        let entry_index = usize::from(entry_index);
        let Some(own) = self.keys.get_mut(entry_index) else { return };
        if *own == key {
            return;
        }
        *own = key;
        let row = entry_index >> Self::ROW_BITS;
        let Some(first) = self.row_firsts.get_mut(row) else { return };
        *first = DueKey::first(self.keys.chunks(Self::ROW).nth(row).unwrap_or_default());
        self.first = DueKey::first(self.row_firsts.get(..Self::ROWS).unwrap_or_default());
    }
}

#[cfg(test)]
#[expect(clippy::arithmetic_side_effects, clippy::integer_division, reason = "a test may panic")]
mod tests;
