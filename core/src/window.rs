//! The open timestamps: their seats in ascending order, and a knockout of their turns to fire (P9).
//!
//! What is kept of a timestamp stays in its seat; of the others a retired one moves two bytes each. The knockout is a
//! complete binary tree in an array: its leaves are the seats' turns, and each node above has the earlier turn of the
//! two below it. So a timestamp is found, and a turn changed, in as many steps as the window has binary digits, and
//! the next due instant is at the top. Reading beside the arrays yields nothing and writing there does nothing: no
//! place can panic.

use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// How many of the open timestamps are less; until one is retired.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Place(pub(crate) u16);

/// When a timestamp's earliest timers fire: the order of F5.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Turn {
    /// One less than the due instant: what is armed is due after the clock's start. The greatest is never.
    pub(crate) key: u64,
    pub(crate) timestamp: Timestamp,
}

impl Turn {
    /// That of an empty seat.
    pub(crate) const NONE: Self = Self::new(None, Timestamp::new(u64::MAX));

    pub(crate) const fn new(due: Option<Instant>, timestamp: Timestamp) -> Self {
        let key = match due {
            Some(due) => due.as_nanos().wrapping_sub(1),
            None => u64::MAX,
        };
        Self { key, timestamp }
    }

    fn due(self) -> Option<Instant> {
        self.key.checked_add(1).map(Instant::from_nanos)
    }

    /// The earlier one, of equal dues the lesser timestamp's.
    fn min(self, other: Self) -> Self {
        // One comparison of 128 bits, without a branch.
        let number = |turn: Self| u128::from(turn.key) << 64 | u128::from(turn.timestamp.as_u64());
        if number(other) < number(self) { other } else { self }
    }
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    /// Where the open timestamps are kept, in ascending order; from `len` on, the empty seats.
    pub(crate) seats: [u16; CAPACITY],
    pub(crate) len: usize,
    /// By seat.
    pub(crate) entries: [Entry<CLOUDS>; CAPACITY],
    /// The knockout: from `CAPACITY` on by seat, before it the nodes above from 1 on; those below `i` are `2 * i` and
    /// the one after it.
    pub(crate) turns: [[Turn; 2]; CAPACITY],
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    pub(crate) fn new() -> Self {
        let mut seats = [0; CAPACITY];
        for (seat, number) in seats.iter_mut().zip(0..) {
            *seat = number;
        }
        Self {
            seats,
            len: 0,
            entries: [Entry::EMPTY; CAPACITY],
            turns: [[Turn::NONE; 2]; CAPACITY],
        }
    }

    /// Adds a timestamp greater than all present; false if there is no room.
    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let Some(seat) = self.seats.get(self.len).copied() else { return false };
        let Some(kept) = self.entries.get_mut(usize::from(seat)) else { return false };
        *kept = entry;
        self.len = self.len.saturating_add(1);
        self.put(seat, Turn::new(entry.next_due(), timestamp));
        true
    }

    /// Puts the state at a place in which `source` is armed anew, and its due instant.
    pub(crate) fn arm(&mut self, place: Place, slot: Slot, source: Source, due: Instant) {
        let seat = self.seat(place);
        let Some(entry) = self.entries.get_mut(usize::from(seat)) else { return };
        entry.slot = slot;
        entry.set_due(source, due);
        let turn = self.turn(seat);
        let armed = turn.min(Turn::new(Some(due), turn.timestamp));
        if armed != turn {
            self.put(seat, armed);
        }
    }

    /// Puts a state at a place in which no more is armed than before.
    pub(crate) fn set(&mut self, place: Place, slot: Slot) {
        let seat = self.seat(place);
        let Some(entry) = self.entries.get_mut(usize::from(seat)) else { return };
        let armed = core::mem::replace(&mut entry.slot, slot).armed();
        if armed == slot.armed() {
            return;
        }
        let due = entry.next_due();
        let turn = self.turn(seat);
        let left = Turn::new(due, turn.timestamp);
        if left != turn {
            self.put(seat, left);
        }
    }

    /// Takes a place out.
    pub(crate) fn remove(&mut self, place: Place) {
        let Some(open) = self.seats.get_mut(usize::from(place.0)..self.len) else { return };
        let Some(seat) = open.first().copied() else { return };
        open.copy_within(1.., 0);
        if let Some(last) = open.last_mut() {
            *last = seat;
        }
        self.len = self.len.saturating_sub(1);
        self.put(seat, Turn::NONE);
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<Place> {
        let open = self.seats.get(..self.len)?;
        // Offers follow their message's open.
        let last = *open.last()?;
        let rank = if self.turn(last).timestamp == timestamp {
            self.len.wrapping_sub(1)
        } else {
            open.binary_search_by_key(&timestamp, |seat| self.turn(*seat).timestamp).ok()?
        };
        u16::try_from(rank).ok().map(Place)
    }

    /// The open timestamps in ascending order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        self.seats.iter().take(self.len).map(|seat| (self.turn(*seat).timestamp, self.kept(*seat)))
    }

    /// The earliest due instant.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.turns.as_flattened().get(1)?.due()
    }

    /// F5: of the timestamps with a timer at the next due instant the least.
    pub(crate) fn first_due(&self) -> Place {
        let first = self.turns.as_flattened().get(1).map(|turn| turn.timestamp);
        first.and_then(|timestamp| self.find(timestamp)).unwrap_or(Place(u16::MAX))
    }

    pub(crate) fn entry(&self, place: Place) -> &Entry<CLOUDS> {
        self.kept(self.seat(place))
    }

    pub(crate) fn timestamp(&self, place: Place) -> Timestamp {
        self.turn(self.seat(place)).timestamp
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    fn seat(&self, place: Place) -> u16 {
        self.seats.get(usize::from(place.0)).copied().unwrap_or(u16::MAX)
    }

    fn kept(&self, seat: u16) -> &Entry<CLOUDS> {
        self.entries.get(usize::from(seat)).unwrap_or(&Entry::EMPTY)
    }

    fn turn(&self, seat: u16) -> Turn {
        let leaf = CAPACITY.wrapping_add(usize::from(seat));
        self.turns.as_flattened().get(leaf).copied().unwrap_or(Turn::NONE)
    }

    /// Puts a seat's turn, and into each node above it the earlier of the two below that.
    fn put(&mut self, seat: u16, turn: Turn) {
        let turns = self.turns.as_flattened_mut();
        let mut node = CAPACITY.wrapping_add(usize::from(seat));
        let Some(leaf) = turns.get_mut(node) else { return };
        *leaf = turn;
        let mut earlier = turn;
        while node > 1 {
            earlier = earlier.min(turns.get(node ^ 1).copied().unwrap_or(Turn::NONE));
            node >>= 1;
            if let Some(above) = turns.get_mut(node) {
                *above = earlier;
            }
        }
    }
}

#[cfg(test)]
#[expect(clippy::arithmetic_side_effects, clippy::integer_division, reason = "a test may panic")]
mod tests;
