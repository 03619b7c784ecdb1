//! Compares the window over cells with the shipped window over arrays, by random calls.
//!
//! The harnesses prove the shipped `window.rs` with cells in place of its arrays (`cells.rs`). Here both get
//! the same calls. The cells must do what the arrays do, and every window that the calls lead to must meet
//! the conditions that the harnesses start from.

use crate::Entry;
use crate::arbitrary::{
    any_below, any_commit, any_due, any_entry, any_other_index, any_source, any_timestamp, levels,
};
use crate::cell_window;
use crate::cells::Cells;
use crate::levels::{Group, Levels, MOST_LEVELS};
use crate::shipped::window::{self as shipped, DueKey};
use crate::slot::{Cause, Slot};
use crate::source::Source;
use crate::time::{Instant, Timestamp};
use crate::valid::is_window;

const CLOUDS: usize = 2;

/// A call of a window.
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

/// Returns the four keys of a level that include own's.
fn group(at: usize, level: &[DueKey]) -> Group {
    let at_index =
        |index: usize| level.get(index).map_or(cell_window::DueKey::NEVER, |own| key(*own));
    Group {
        at,
        len: level.len(),
        keys: [0, 1, 2, 3].map(|beside| at_index(at ^ beside)),
        ..Group::none()
    }
}

/// Returns the window over cells that two places, two free entries and an entry of a window over arrays make.
fn over_cells<const CAPACITY: usize>(
    window: &shipped::Window<CLOUDS, CAPACITY>,
    places: [usize; 2],
    frees: [usize; 2],
    entry_index: usize,
) -> cell_window::Window<CLOUDS, CAPACITY> {
    let timestamps = window.timestamps.as_flattened();
    let timestamps = places.map(|place| *timestamps.get(place).unwrap_or(&Timestamp::new(0)));
    let indices = window.entry_indices.as_flattened();
    let indices = places.map(|place| *indices.get(place).unwrap_or(&u16::MAX));
    let free = frees.map(|at| *window.free.get(at).unwrap_or(&u16::MAX));
    let groups = || [(); MOST_LEVELS].map(|()| Group::none());
    let mut keys = Levels { groups: groups(), count: 1, right: 0 };
    let right = any_below(MOST_LEVELS);
    let mut firsts = Levels { groups: groups(), count: levels(CAPACITY), right };
    keys.groups[0] = group(entry_index, &window.keys);
    let (mut at, mut len, mut above) = (entry_index, CAPACITY, &window.firsts[..]);
    for level in &mut firsts.groups[..levels(CAPACITY)] {
        (at, len) = (at / 4, len.div_ceil(4));
        *level = group(at, &above[..len]);
        above = &above[len..];
    }
    cell_window::Window {
        timestamps: Cells::new(places, timestamps, 2 * CAPACITY),
        entry_indices: Cells::new(places, indices, 2 * CAPACITY),
        start: window.start,
        len: window.len,
        free: Cells::new(frees, free, CAPACITY),
        entries: Cells::new(
            [entry_index; 2],
            [window.entries[entry_index], Entry::EMPTY],
            CAPACITY,
        ),
        keys,
        firsts,
        first: key(window.first),
    }
}

/// Returns `true` if both show the same. A timestamp and an index that are not open do not count.
fn same<const CAPACITY: usize>(
    a: &cell_window::Window<CLOUDS, CAPACITY>,
    b: &cell_window::Window<CLOUDS, CAPACITY>,
) -> bool {
    let entry = |window: &cell_window::Window<CLOUDS, CAPACITY>| {
        let entry = &window.entries.values[0];
        (entry.slot, entry.local_due, entry.dues)
    };
    let open = a.start..a.start + a.len;
    let same_open = [0, 1].iter().all(|c| {
        !open.contains(&a.timestamps.at[*c])
            || a.timestamps.values[*c] == b.timestamps.values[*c]
                && a.entry_indices.values[*c] == b.entry_indices.values[*c]
    });
    let levels = |window: &cell_window::Window<CLOUDS, CAPACITY>| {
        let all = window.keys.groups.iter().chain(&window.firsts.groups);
        all.map(|four| (four.at, four.len, four.keys)).collect::<std::vec::Vec<_>>()
    };
    (a.start, a.len, a.first) == (b.start, b.len, b.first)
        && same_open
        && a.free.values == b.free.values
        && levels(a) == levels(b)
        && entry(a) == entry(b)
}

/// Makes some calls of a window, and compares each with the same call over the cells of two of its
/// timestamps.
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
        let place = window.start + if is_open { any_below(window.len) } else { window.len };
        let free = (CAPACITY - window.len).wrapping_sub(usize::from(!is_open));
        let index = if is_open {
            window.entry_indices.as_flattened().get(place)
        } else {
            window.free.get(free)
        };
        let Some(entry_index) = index.copied() else { break };
        let places = [place, any_other_index(place, 2 * CAPACITY)];
        let frees = [free, any_other_index(free, CAPACITY)];
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
        let mut cells = over_cells(&window, places, frees, usize::from(entry_index));
        kani::assert(is_window(&cells), "it is a window that harnesses start from");
        let own = cells.timestamps.values[0];
        let sought = if is_open { own } else { any_timestamp() };
        let found = window.find(sought).map(|index| (index.place, index.entry));
        if is_open || found.is_none() {
            cells.timestamps.absent = if is_open { None } else { Some(sought) };
            let by_cells = cells.find(sought).map(|index| (index.place, index.entry));
            kani::assert(found == by_cells, "cells find what arrays find");
        }
        let (place, entry) = (place as u16, entry_index);
        let before = window.start;
        call!(window, call, shipped::OpenIndex { place, entry });
        call!(cells, call, cell_window::OpenIndex { place, entry });
        let after = over_cells(&window, cells.timestamps.at, frees, usize::from(entry_index));
        kani::assert(same(&cells, &after), "cells do what arrays do");
        kani::assert(is_window(&after), "it still holds");
        kani::cover!(matches!(call, Call::Arm(..)), "a timer is armed");
        let moves = matches!(call, Call::Remove) && cells.timestamps.at[1] != places[1];
        kani::cover!(moves && places[0] < places[1], "another moves down");
        kani::cover!(moves && places[0] > places[1], "another moves up");
        kani::cover!(matches!(call, Call::Push(..)) && window.start < before, "all move");
    }
}

/// Compares the windows of several capacities.
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

/// Returns `true` if the code derives the same from a capacity as the harnesses do, and has room for all
/// levels.
#[must_use]
pub const fn has_its_levels<const CAPACITY: usize>() -> bool {
    let (mut len, mut all) = (CAPACITY, 0);
    while len > 1 {
        len = len.div_ceil(4);
        all += len;
    }
    // At most three keys are read on each level, which is 15 at 1024 (P9).
    let few = levels(CAPACITY) <= MOST_LEVELS && CAPACITY <= 1 << (2 * levels(CAPACITY));
    few && all <= CAPACITY
        && shipped::Window::<CLOUDS, CAPACITY>::LEVELS as usize == levels(CAPACITY)
}
