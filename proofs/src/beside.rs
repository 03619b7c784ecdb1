//! The window over cells beside the shipped one over arrays, on random windows: the cells do what arrays do, and what holds of every
//! window of a harness holds of those that the machine makes.

use crate::Entry;
use crate::any::{any_below, any_commit, any_due, any_entry, any_source, any_timestamp, rows};
use crate::any_size;
use crate::cells::Cells;
use crate::shipped::window::{self as shipped, Turn};
use crate::slot::{Cause, Slot};
use crate::source::Source;
use crate::time::{Instant, Timestamp};
use crate::valid::is_window;

const CLOUDS: usize = 2;

/// One call of a window.
#[derive(Clone, Copy)]
enum Call {
    Push(Timestamp, Entry<CLOUDS>),
    Arm(Slot, Source, Instant),
    Set(Slot),
    Remove,
}

macro_rules! call {
    ($window:expr, $call:expr, $place:expr) => {
        match $call {
            Call::Push(timestamp, entry) => drop($window.push(timestamp, entry)),
            Call::Arm(slot, source, due) => $window.arm($place, slot, source, due),
            Call::Set(slot) => $window.set($place, slot),
            Call::Remove => $window.remove($place),
        }
    };
}

fn turn(of: Turn) -> any_size::Turn {
    any_size::Turn { key: of.key, timestamp: of.timestamp }
}

/// The first of these turns but for the `own`th.
fn first_beside(own: usize, turns: &[Turn]) -> any_size::Turn {
    let others = turns.iter().enumerate().filter(|(at, _)| *at != own).map(|(_, turn)| turn);
    turn(*others.min_by_key(|turn| (turn.key, turn.timestamp)).unwrap_or(&Turn::NEVER))
}

/// What two ranks and a seat of a window show.
fn seen<const CAPACITY: usize>(
    window: &shipped::Window<CLOUDS, CAPACITY>,
    ranks: [usize; 2],
    seat: usize,
) -> any_size::Window<CLOUDS, CAPACITY> {
    let timestamps = ranks.map(|rank| *window.timestamps.get(rank).unwrap_or(&Timestamp::new(0)));
    let seats = ranks.map(|rank| *window.seats.get(rank).unwrap_or(&u16::MAX));
    let (of_row, rows) = rows(CAPACITY);
    let row = seat / of_row;
    let from = row * of_row;
    let in_row = &window.turns[from..CAPACITY.min(from + of_row)];
    let turns = [turn(window.turns[seat]), first_beside(seat - from, in_row)];
    let firsts = [turn(window.firsts[row]), first_beside(row, &window.firsts[..rows])];
    any_size::Window {
        timestamps: Cells::new(ranks, timestamps),
        seats: Cells::new(ranks, seats),
        len: window.len,
        entries: Cells::new([seat; 2], [window.entries[seat], Entry::EMPTY]),
        turns: Cells::new([seat; 2], turns),
        firsts: Cells { rows, ..Cells::new([row; 2], firsts) },
        first: turn(window.first),
    }
}

/// Whether both show the same; of what is not open, a timestamp means nothing.
fn same<const CAPACITY: usize>(
    a: &any_size::Window<CLOUDS, CAPACITY>,
    b: &any_size::Window<CLOUDS, CAPACITY>,
) -> bool {
    let entry = |window: &any_size::Window<CLOUDS, CAPACITY>| {
        let entry = &window.entries.values[0];
        (entry.slot, entry.local_due, entry.dues)
    };
    let open = [0, 1].map(|cell| a.timestamps.at[cell] < a.len);
    let timestamps =
        [0, 1].iter().all(|c| !open[*c] || a.timestamps.values[*c] == b.timestamps.values[*c]);
    let places = a.seats.at == b.seats.at && a.seats.values == b.seats.values;
    let turns = a.turns.values == b.turns.values && a.firsts.values == b.firsts.values;
    a.len == b.len && timestamps && places && turns && a.first == b.first && entry(a) == entry(b)
}

/// A window after some calls, and after one more: beside it the cells of two of its timestamps.
fn compared<const CAPACITY: usize>() {
    let commit = any_commit();
    let mut window = shipped::Window::<CLOUDS, CAPACITY>::new();
    let mut newest = 0;
    for _ in 0..any_below(CAPACITY + 1) {
        newest += 1 + u64::from(kani::any::<u8>());
        window.push(Timestamp::new(newest), any_entry(commit));
    }
    for _ in 0..=any_below(16) {
        let is_open = window.len > 0 && kani::any();
        let rank = if is_open { any_below(window.len) } else { window.len };
        let Some(seat) = window.seats.get(rank).copied() else { break };
        let other = any_below(CAPACITY + 1);
        let ranks = [rank, if other == rank { CAPACITY } else { other }];
        let kept = window.entries[usize::from(seat)].slot;
        let source = any_source(CLOUDS as u8);
        let call = if is_open {
            match (kept.offer(source), any_below(3)) {
                ((slot, None), 0) => Call::Arm(slot, source, any_due(true)),
                (_, 1) => Call::Set(kept.step(commit, Cause::Failure(source)).0),
                _ => Call::Remove,
            }
        } else {
            newest += 1 + u64::from(kani::any::<u8>());
            Call::Push(Timestamp::new(newest), any_entry(commit))
        };
        let mut cells = seen(&window, ranks, usize::from(seat));
        kani::assert(is_window(&cells), "what holds of every window of a harness holds of it");
        let sought = if is_open { window.timestamps[rank] } else { any_timestamp() };
        let found = window.find(sought).map(|place| (place.rank, place.seat));
        if is_open || found.is_none() {
            cells.timestamps.absent = if is_open { None } else { Some(sought) };
            let by_cells = cells.find(sought).map(|place| (place.rank, place.seat));
            kani::assert(found == by_cells, "cells find what arrays find");
        }
        let rank = rank as u16;
        call!(window, call, shipped::Place { rank, seat });
        call!(cells, call, any_size::Place { rank, seat });
        let after = seen(&window, cells.timestamps.at, usize::from(seat));
        kani::assert(same(&cells, &after), "cells do what arrays do");
        kani::assert(is_window(&after), "it still holds");
        kani::cover!(matches!(call, Call::Arm(..)), "a timer is armed");
        kani::cover!(matches!(call, Call::Remove) && ranks[0] < ranks[1], "another moves up");
    }
}

/// On windows of several capacities.
pub fn cells_do_what_arrays_do() {
    match any_below(6) {
        0 => compared::<1>(),
        1 => compared::<2>(),
        2 => compared::<3>(),
        3 => compared::<16>(),
        4 => compared::<30>(),
        _ => compared::<100>(),
    }
}

/// Whether the code takes from a capacity what the harnesses take from it.
#[must_use]
pub const fn has_its_rows<const CAPACITY: usize>() -> bool {
    let (of_row, rows) = rows(CAPACITY);
    // P9: at most 2√(2 · capacity) of them are looked through.
    let few = (of_row + rows) * (of_row + rows) <= 8 * CAPACITY;
    few && shipped::Window::<CLOUDS, CAPACITY>::ROW == of_row
        && shipped::Window::<CLOUDS, CAPACITY>::ROWS == rows
}
