//! Compares the window over cells with the shipped window over arrays, by random calls.
//!
//! The harnesses prove the shipped `window.rs` with cells in the place of its arrays (`cells.rs`). Here both get the same calls: the
//! cells must do what the arrays do, and every window that the calls lead to must satisfy what the harnesses start from.

use crate::Entry;
use crate::arbitrary::{
    any_below, any_commit, any_due, any_entry, any_source, any_timestamp, rows,
};
use crate::cell_window;
use crate::cells::Cells;
use crate::shipped::window::{self as shipped, DueKey};
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
    ($window:expr, $call:expr, $index:expr) => {
        match $call {
            Call::Push(timestamp, entry) => drop($window.push(timestamp, entry)),
            Call::Arm(slot, source, due) => $window.arm($index, slot, source, due),
            Call::Set(slot) => $window.set($index, slot),
            Call::Remove => $window.remove($index),
        }
    };
}

fn key(of: DueKey) -> cell_window::DueKey {
    cell_window::DueKey { due_minus_one: of.due_minus_one, timestamp: of.timestamp }
}

/// The first of these keys but for the `own`th.
fn first_except(own: usize, keys: &[DueKey]) -> cell_window::DueKey {
    let others = keys.iter().enumerate().filter(|(at, _)| *at != own).map(|(_, key)| key);
    key(*others.min_by_key(|key| (key.due_minus_one, key.timestamp)).unwrap_or(&DueKey::NEVER))
}

/// The window over cells that two ranks and an entry of a window over arrays make.
fn over_cells<const CAPACITY: usize>(
    window: &shipped::Window<CLOUDS, CAPACITY>,
    ranks: [usize; 2],
    entry_index: usize,
) -> cell_window::Window<CLOUDS, CAPACITY> {
    let timestamps = ranks.map(|rank| *window.timestamps.get(rank).unwrap_or(&Timestamp::new(0)));
    let indices = ranks.map(|rank| *window.entry_indices.get(rank).unwrap_or(&u16::MAX));
    let (of_row, rows) = rows(CAPACITY);
    let row = entry_index / of_row;
    let from = row * of_row;
    let in_row = &window.keys[from..CAPACITY.min(from + of_row)];
    let keys = [key(window.keys[entry_index]), first_except(entry_index - from, in_row)];
    let row_firsts = [key(window.row_firsts[row]), first_except(row, &window.row_firsts[..rows])];
    cell_window::Window {
        timestamps: Cells::new(ranks, timestamps),
        entry_indices: Cells::new(ranks, indices),
        len: window.len,
        entries: Cells::new([entry_index; 2], [window.entries[entry_index], Entry::EMPTY]),
        keys: Cells::new([entry_index; 2], keys),
        row_firsts: Cells { rows, ..Cells::new([row; 2], row_firsts) },
        first: key(window.first),
    }
}

/// Whether both show the same; of what is not open, a timestamp means nothing.
fn same<const CAPACITY: usize>(
    a: &cell_window::Window<CLOUDS, CAPACITY>,
    b: &cell_window::Window<CLOUDS, CAPACITY>,
) -> bool {
    let entry = |window: &cell_window::Window<CLOUDS, CAPACITY>| {
        let entry = &window.entries.values[0];
        (entry.slot, entry.local_due, entry.dues)
    };
    let open = [0, 1].map(|cell| a.timestamps.at[cell] < a.len);
    let timestamps =
        [0, 1].iter().all(|c| !open[*c] || a.timestamps.values[*c] == b.timestamps.values[*c]);
    let same_entries = a.entry_indices.at == b.entry_indices.at
        && a.entry_indices.values == b.entry_indices.values;
    let keys = a.keys.values == b.keys.values && a.row_firsts.values == b.row_firsts.values;
    a.len == b.len
        && timestamps
        && same_entries
        && keys
        && a.first == b.first
        && entry(a) == entry(b)
}

/// Some calls of a window, each compared with the same call over the cells of two of its timestamps.
fn compare<const CAPACITY: usize>() {
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
        let Some(entry_index) = window.entry_indices.get(rank).copied() else { break };
        let other = any_below(CAPACITY + 1);
        let ranks = [rank, if other == rank { CAPACITY } else { other }];
        let current = window.entries[usize::from(entry_index)].slot;
        let source = any_source(CLOUDS as u8);
        let call = if is_open {
            match (current.offer(source), any_below(3)) {
                ((slot, None), 0) => Call::Arm(slot, source, any_due(true)),
                (_, 1) => Call::Set(current.step(commit, Cause::Failure(source)).0),
                _ => Call::Remove,
            }
        } else {
            newest += 1 + u64::from(kani::any::<u8>());
            Call::Push(Timestamp::new(newest), any_entry(commit))
        };
        let mut cells = over_cells(&window, ranks, usize::from(entry_index));
        kani::assert(is_window(&cells), "it is a window that harnesses start from");
        let sought = if is_open { window.timestamps[rank] } else { any_timestamp() };
        let found = window.find(sought).map(|index| (index.rank, index.entry));
        if is_open || found.is_none() {
            cells.timestamps.absent = if is_open { None } else { Some(sought) };
            let by_cells = cells.find(sought).map(|index| (index.rank, index.entry));
            kani::assert(found == by_cells, "cells find what arrays find");
        }
        let rank = rank as u16;
        call!(window, call, shipped::OpenIndex { rank, entry: entry_index });
        call!(cells, call, cell_window::OpenIndex { rank, entry: entry_index });
        let after = over_cells(&window, cells.timestamps.at, usize::from(entry_index));
        kani::assert(same(&cells, &after), "cells do what arrays do");
        kani::assert(is_window(&after), "it still holds");
        kani::cover!(matches!(call, Call::Arm(..)), "a timer is armed");
        kani::cover!(matches!(call, Call::Remove) && ranks[0] < ranks[1], "another moves up");
    }
}

/// On windows of several capacities.
pub fn cells_do_what_arrays_do() {
    match any_below(6) {
        0 => compare::<1>(),
        1 => compare::<2>(),
        2 => compare::<3>(),
        3 => compare::<16>(),
        4 => compare::<30>(),
        _ => compare::<100>(),
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
