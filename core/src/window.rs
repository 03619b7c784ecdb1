//! The open timestamps in ascending order, and whose turn to fire is first (P9).
//!
//! What is kept of a timestamp stays in its seat; those behind a retired one move up, ten bytes each. The seats stand
//! in rows, at most 32 of 32. Each row knows the first turn of its seats, and the window the first of the rows': an
//! earlier turn is compared with the two, and where a turn becomes later its row is looked through, and the rows are.
//! Reading beside the arrays yields nothing and writing there does nothing: no place can panic.

use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// Where an open timestamp is, until one is retired.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Place {
    /// How many of the open timestamps are less.
    pub(crate) rank: u16,
    pub(crate) seat: u16,
}

/// When a timestamp's earliest timers fire: the order of F5.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Turn {
    /// One less than the due instant: what is armed is due after the clock's start. The greatest is never.
    pub(crate) key: u64,
    pub(crate) timestamp: Timestamp,
}

impl Turn {
    /// That of an empty seat, and of a timestamp without an armed timer.
    pub(crate) const NEVER: Self = Self { key: u64::MAX, timestamp: Timestamp::new(u64::MAX) };

    pub(crate) const fn new(due: Option<Instant>, timestamp: Timestamp) -> Self {
        match due {
            Some(due) => Self { key: due.as_nanos().wrapping_sub(1), timestamp },
            None => Self::NEVER,
        }
    }

    fn due(self) -> Option<Instant> {
        self.key.checked_add(1).map(Instant::from_nanos)
    }

    /// The earlier one, of equal dues the lesser timestamp's.
    fn earlier(self, other: Self) -> Self {
        // One comparison of 128 bits.
        let number = |turn: Self| u128::from(turn.key) << 64 | u128::from(turn.timestamp.as_u64());
        if number(other) < number(self) { other } else { self }
    }

    fn first(turns: &[Self]) -> Self {
        turns.iter().copied().fold(Self::NEVER, Self::earlier)
    }
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    /// Ascending; from `len` on they mean nothing.
    pub(crate) timestamps: [Timestamp; CAPACITY],
    /// Where each of them is kept; from `len` on, the empty seats.
    pub(crate) seats: [u16; CAPACITY],
    pub(crate) len: usize,
    /// By seat.
    pub(crate) entries: [Entry<CLOUDS>; CAPACITY],
    /// By seat.
    pub(crate) turns: [Turn; CAPACITY],
    /// The first turn of each row; those beyond the last row mean nothing.
    pub(crate) firsts: [Turn; CAPACITY],
    /// The first turn of all.
    pub(crate) first: Turn,
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    /// A row has the least power of two of seats whose square is no less than the capacity.
    const ROW_BITS: u32 = CAPACITY.next_power_of_two().trailing_zeros().div_ceil(2);
    pub(crate) const ROW: usize = 1 << Self::ROW_BITS;
    pub(crate) const ROWS: usize = CAPACITY.div_ceil(Self::ROW);

    pub(crate) fn new() -> Self {
        let mut seats = [0; CAPACITY];
        for (seat, number) in seats.iter_mut().zip(0..) {
            *seat = number;
        }
        Self {
            timestamps: [Timestamp::new(0); CAPACITY],
            seats,
            len: 0,
            entries: [Entry::EMPTY; CAPACITY],
            turns: [Turn::NEVER; CAPACITY],
            firsts: [Turn::NEVER; CAPACITY],
            first: Turn::NEVER,
        }
    }

    /// Adds a timestamp greater than all present; false if there is no room.
    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let Some(last) = self.timestamps.get_mut(self.len) else { return false };
        let Some(seat) = self.seats.get(self.len).copied() else { return false };
        let Some(kept) = self.entries.get_mut(usize::from(seat)) else { return false };
        *last = timestamp;
        *kept = entry;
        self.len = self.len.saturating_add(1);
        if let Some(due) = entry.next_due() {
            self.put_earlier(seat, Turn::new(Some(due), timestamp));
        }
        true
    }

    /// Puts the state at a place in which `source` is armed anew, and its due instant.
    pub(crate) fn arm(&mut self, place: Place, slot: Slot, source: Source, due: Instant) {
        let turn = Turn::new(Some(due), self.timestamp(place));
        let seat = usize::from(place.seat);
        let Some((entry, own)) = self.entries.get_mut(seat).zip(self.turns.get(seat)) else {
            return;
        };
        entry.slot = slot;
        entry.set_due(source, due);
        if turn.key < own.key {
            self.put_earlier(place.seat, turn);
        }
    }

    /// Puts a state at a place in which no more is armed than before.
    pub(crate) fn set(&mut self, place: Place, slot: Slot) {
        let timestamp = self.timestamp(place);
        let Some(entry) = self.entries.get_mut(usize::from(place.seat)) else { return };
        let armed = core::mem::replace(&mut entry.slot, slot).armed();
        if armed != slot.armed() {
            let due = entry.next_due();
            self.put(place.seat, Turn::new(due, timestamp));
        }
    }

    /// Takes a place out: those behind it move up, and its seat is the first of the empty ones.
    pub(crate) fn remove(&mut self, place: Place) {
        let behind = usize::from(place.rank)..self.len;
        let Some(timestamps) = self.timestamps.get_mut(behind.clone()) else { return };
        let Some(seats) = self.seats.get_mut(behind).filter(|seats| !seats.is_empty()) else {
            return;
        };
        timestamps.copy_within(1.., 0);
        seats.copy_within(1.., 0);
        if let Some(last) = seats.last_mut() {
            *last = place.seat;
        }
        self.len = self.len.saturating_sub(1);
        self.put(place.seat, Turn::NEVER);
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<Place> {
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
        Some(Place { rank: u16::try_from(rank).ok()?, seat: self.seats.get(rank).copied()? })
    }

    /// The open timestamps in ascending order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        let open = self.timestamps.iter().zip(&self.seats).take(self.len);
        open.map(|(timestamp, seat)| (*timestamp, self.kept(*seat)))
    }

    /// The earliest due instant.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.first.due()
    }

    /// F5: of the timestamps with a timer at the next due instant the least.
    pub(crate) fn first_due(&self) -> Option<Place> {
        self.find(self.first.timestamp)
    }

    pub(crate) fn entry(&self, place: Place) -> &Entry<CLOUDS> {
        self.kept(place.seat)
    }

    pub(crate) fn timestamp(&self, place: Place) -> Timestamp {
        self.timestamps.get(usize::from(place.rank)).copied().unwrap_or(Timestamp::new(0))
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    fn kept(&self, seat: u16) -> &Entry<CLOUDS> {
        self.entries.get(usize::from(seat)).unwrap_or(&Entry::EMPTY)
    }

    /// Puts a turn earlier than the seat's: if it is not the first of its row or of all, those are as they were.
    fn put_earlier(&mut self, seat: u16, turn: Turn) {
        let seat = usize::from(seat);
        let Some(own) = self.turns.get_mut(seat) else { return };
        let Some(first) = self.firsts.get_mut(seat >> Self::ROW_BITS) else { return };
        *own = turn;
        *first = first.earlier(turn);
        self.first = self.first.earlier(turn);
    }

    /// Puts a seat's turn, and finds the first of its row and of all rows again.
    fn put(&mut self, seat: u16, turn: Turn) {
        let seat = usize::from(seat);
        let Some(own) = self.turns.get_mut(seat) else { return };
        if *own == turn {
            return;
        }
        *own = turn;
        let row = seat >> Self::ROW_BITS;
        let Some(first) = self.firsts.get_mut(row) else { return };
        *first = Turn::first(self.turns.chunks(Self::ROW).nth(row).unwrap_or_default());
        self.first = Turn::first(self.firsts.get(..Self::ROWS).unwrap_or_default());
    }
}

#[cfg(test)]
#[expect(clippy::arithmetic_side_effects, clippy::integer_division, reason = "a test may panic")]
mod tests;
