//! The window of open timestamps, of any size: from any window, each way to change it and each question to it.
//!
//! The shipped `window.rs` runs over cells in the place of its arrays (`src/cells.rs`). *Own* is the timestamp that a call is
//! about, at any rank and with any entry of any row, among any number; the *other* one is any of the others. What is shown here is
//! the table of `src/window.rs`.
//!
//! A capacity is a constant of the code. Each harness takes the least and the greatest, and some between; what else the code
//! takes from it, `tests/window.rs` shows of all of them. Of a timestamp's entry a window uses the earliest due instant alone, which
//! is shown by itself.

use crate::arbitrary::{
    any_case, any_commit, any_due, any_entry, any_entry_of, any_next_position, any_open_position,
    any_source, any_timestamp, any_window, earlier, earliest, key_of, rows, slot_of,
};
use crate::cell_window::{DueKey, OpenIndex, Window};
use crate::entry::Entry;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::valid::{is_window, same_key};

/// Enough for the earliest of several due instants.
const CLOUDS: usize = 2;

/// Calls a function for one of the capacities.
macro_rules! of_capacity {
    ($check:ident) => {
        match any_case(6) {
            0 => $check::<1>(),
            1 => $check::<2>(),
            2 => $check::<3>(),
            3 => $check::<16>(),
            4 => $check::<1000>(),
            _ => $check::<1024>(),
        }
    };
}

/// Where own is.
fn own_index<const CAPACITY: usize>(window: &Window<CLOUDS, CAPACITY>) -> OpenIndex {
    OpenIndex { rank: window.timestamps.at[0] as u16, entry: window.entry_indices.values[0] }
}

fn same_entry(a: &Entry<CLOUDS>, b: &Entry<CLOUDS>) -> bool {
    let mut same = a.slot == b.slot && a.local_due == b.local_due;
    for i in 0..CLOUDS {
        same &= a.dues[i] == b.dues[i];
    }
    same
}

/// Whether the other timestamp, the index of its entry, and the first keys of all others are as before. It may have moved to `rank`.
fn others_stay<const CAPACITY: usize>(
    before: &Window<CLOUDS, CAPACITY>,
    after: &Window<CLOUDS, CAPACITY>,
    rank: usize,
) -> bool {
    after.timestamps.at[1] == rank
        && after.entry_indices.at[1] == rank
        && after.timestamps.values[1] == before.timestamps.values[1]
        && after.entry_indices.values[1] == before.entry_indices.values[1]
        && same_key(after.keys.values[1], before.keys.values[1])
        && same_key(after.row_firsts.values[1], before.row_firsts.values[1])
}

/// Whether the same timestamps are open, with the same ranks and entries.
fn same_order<const CAPACITY: usize>(
    before: &Window<CLOUDS, CAPACITY>,
    after: &Window<CLOUDS, CAPACITY>,
) -> bool {
    after.len == before.len
        && after.timestamps.at == before.timestamps.at
        && after.timestamps.values[0] == before.timestamps.values[0]
        && after.entry_indices.values[0] == before.entry_indices.values[0]
        && others_stay(before, after, before.timestamps.at[1])
}

/// How many keys were read: P9 allows those of a row and of the rows, or none.
fn reads<const CAPACITY: usize>(window: &Window<CLOUDS, CAPACITY>) -> usize {
    window.keys.reads.get() + window.row_firsts.reads.get()
}

/// P9: the earliest due instant of a timestamp is that of one of its armed timers, and none of them is due before.
///
/// It is the least of a list of which each member is looked at: that all are, `tests/window.rs` shows for all sets of 16.
///
/// Bounds: 7 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_earliest_of_a_timestamp() {
    let entry = any_entry::<7>(any_commit());
    let (armed, due) = (entry.slot.armed().bits(), entry.next_due());
    let mut is_one = armed == 0 && due.is_none();
    let mut is_least = true;
    for (i, of_source) in [entry.local_due].iter().chain(&entry.dues).enumerate() {
        if armed >> i & 1 != 0 {
            is_one |= due == Some(*of_source);
            is_least &= due <= Some(*of_source);
        }
    }
    kani::assert(is_one, "P9: it is that of an armed timer, if one is");
    kani::assert(is_least, "P9: no armed timer is due before");
    kani::cover!(due.is_none(), "nothing is armed");
    kani::cover!(due < Some(entry.local_due), "local's is not the earliest");
}

fn found<const CAPACITY: usize>() -> (bool, bool) {
    let is_open = kani::any();
    let position =
        if is_open { any_open_position::<CAPACITY>() } else { any_next_position::<CAPACITY>() };
    let mut window = any_window::<CLOUDS, CAPACITY>(position, any_entry(any_commit()));
    let sought = window.timestamps.values[0];
    window.timestamps.absent = if is_open { None } else { Some(sought) };
    let index = own_index(&window);
    let wanted = if is_open { Some(index) } else { None };
    kani::assert(window.find(sought) == wanted, "P9: it finds what is open and nothing else");
    kani::assert(window.len() == position.len, "P9: as many are open");
    if is_open {
        let is_there = same_entry(window.entry(index), &window.entries.values[0]);
        kani::assert(is_there, "P9: its entry is there");
        kani::assert(window.timestamp(index) == sought, "P9: it is of that timestamp");
    }
    (is_open, position.rank > 0)
}

/// P9, F8: lookup finds what is open and nothing else.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_lookup() {
    let (found, is_behind) = of_capacity!(found);
    kani::cover!(found && is_behind, "it finds one behind the first");
    kani::cover!(!found, "there is none");
}

fn next<const CAPACITY: usize>() -> (bool, bool) {
    let entry = any_entry(any_commit());
    let window = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let own = key_of(earliest(&window.entries.values[0]), window.timestamps.values[0]);
    let due = window.next_due();
    // The first key is that of one of them.
    let is_first = same_key(window.first, own);
    let is_armed = !same_key(own, DueKey::NEVER);
    let no_later = same_key(earlier(window.first, own), window.first);
    kani::assert(no_later, "P9: no timer is due before the next due instant");
    kani::assert(reads(&window) == 0, "P9: the next due instant takes one look");
    let is_none = same_key(window.first, DueKey::NEVER);
    kani::assert(due.is_none() == is_none, "P9: nothing is due if nothing is armed");
    if !(is_first && is_armed) {
        return (is_none, false);
    }
    let least = due == earliest(&window.entries.values[0]);
    kani::assert(least, "P9: the next due instant is the least armed one");
    let found = window.first_due();
    kani::assert(
        found == Some(own_index(&window)),
        "F5: of those due then the least timestamp fires",
    );
    (false, window.row_firsts.values[1].due_minus_one == own.due_minus_one)
}

/// P9, F5, A23: the next due instant is the least armed one, and the least timestamp that is due then fires.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_next_due() {
    let (is_none, is_tie) = of_capacity!(next);
    kani::cover!(is_none, "nothing is armed");
    kani::cover!(is_tie, "two are due at one instant");
}

fn pushed<const CAPACITY: usize>() -> (usize, bool) {
    let position = any_next_position::<CAPACITY>();
    let before = any_window::<CLOUDS, CAPACITY>(position, any_entry(any_commit()));
    let (timestamp, entry) = (any_timestamp(), any_entry(any_commit()));
    let is_behind = before.timestamps.at[1] >= before.len;
    kani::assume(is_behind || before.timestamps.values[1] < timestamp);
    let mut after = before.clone();
    let added = after.push(timestamp, entry);
    kani::assert(added == (position.len < CAPACITY), "P9: there is room for the capacity");
    kani::assert(after.len == position.len + usize::from(added), "P9: it is one more");
    kani::assert(is_window(&after), "P9: it is a window");
    let same = others_stay(&before, &after, before.timestamps.at[1]) && reads(&after) == 0;
    kani::assert(same, "P9: only its own timestamp changes, and no other is looked at");
    if added {
        let is_there = after.timestamps.values[0] == timestamp;
        let is_stored = same_entry(&after.entries.values[0], &entry);
        kani::assert(is_there && is_stored, "P9: it is there with its entry");
    }
    (position.len, added)
}

/// P9, F1, F8: opening adds the timestamp and changes no other.
///
/// The timestamp is assumed to be greater than all open ones: F1 refuses it otherwise, which `f1_open_by_the_rule` shows.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_open() {
    let (len, added) = of_capacity!(pushed);
    kani::cover!(len == 0 && added, "it is the first");
    kani::cover!(!added, "it is full");
}

/// Any sets of a timestamp for which this source was not requested, or that was opened just now.
fn any_slot_without(commit: Commit, source: Source) -> Slot {
    let others = !Sources::EMPTY.with(source).bits();
    let [requested, pending, cached] = kani::any::<[u16; 3]>().map(|set| set & others);
    slot_of(commit, CLOUDS as u8, requested, pending, cached, kani::any())
}

fn armed<const CAPACITY: usize>() -> (bool, bool) {
    let (commit, source) = (any_commit(), any_source(CLOUDS as u8));
    let entry = any_entry_of(any_slot_without(commit, source));
    let before = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let (slot, refusal) = entry.slot.offer(source);
    kani::assume(refusal.is_none());
    let due = any_due(true);
    let mut after = before.clone();
    after.arm(own_index(&before), slot, source, due);
    kani::assert(is_window(&after), "P9: it is a window");
    let same = same_order(&before, &after) && reads(&after) == 0;
    kani::assert(same, "P9: only its own timestamp changes, and no other is looked at");
    let mut wanted = Entry { slot, ..entry };
    for i in 0..CLOUDS {
        if usize::from(source.index()) == i + 1 {
            wanted.dues[i] = due;
        }
    }
    kani::assert(same_entry(&after.entries.values[0], &wanted), "P9: its timer is armed");
    let is_first = !same_key(after.first, before.first);
    (is_first, !is_first)
}

/// P9, F2: arming a timer changes no other timestamp, and the next due instant is still the least.
///
/// That the request is admitted is assumed: the machine arms no other.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_offer() {
    let (is_first, is_later) = of_capacity!(armed);
    kani::cover!(is_first, "it is the next due");
    kani::cover!(is_later, "another is the next due");
}

/// Any sets in which no timer is armed that is not armed in these.
fn any_less_armed(commit: Commit, slot: Slot) -> Slot {
    let armed = slot.armed().bits() | Sources::LOCAL.bits();
    let [requested, pending, cached]: [u16; 3] = kani::any();
    let cached = match commit {
        Commit::Eager => cached & armed,
        Commit::Patient | Commit::Progressive => cached,
    };
    let limited = kani::any::<bool>() && slot.armed().contains(Source::LOCAL);
    slot_of(commit, CLOUDS as u8, requested, pending & armed, cached, limited)
}

fn set<const CAPACITY: usize>() -> (bool, bool) {
    let commit = any_commit();
    let entry = any_entry(commit);
    let before = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let slot = any_less_armed(commit, entry.slot);
    let mut after = before.clone();
    after.set(own_index(&before), slot);
    kani::assert(is_window(&after), "P9: it is a window");
    kani::assert(same_order(&before, &after), "P9: only its own timestamp changes");
    let (of_row, rows) = const { rows(CAPACITY) };
    kani::assert(reads(&after) <= of_row + rows, "P9: the keys of a row are read, and of the rows");
    let wanted = Entry { slot, ..entry };
    kani::assert(same_entry(&after.entries.values[0], &wanted), "P9: it has the new state");
    let fewer = entry.slot.armed() != slot.armed();
    (fewer && same_key(after.first, before.first), !same_key(after.first, before.first))
}

/// P9, F3, F4, F5: what closes requests changes no other timestamp, and the next due instant is still the least.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_close() {
    let (is_same, is_other) = of_capacity!(set);
    kani::cover!(is_same, "the next due stays");
    kani::cover!(is_other, "the next due is another");
}

fn removed<const CAPACITY: usize>() -> (bool, bool) {
    let entry = any_entry(any_commit());
    let before = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let [rank, other] = before.timestamps.at;
    let mut after = before.clone();
    after.remove(own_index(&before));
    kani::assert(is_window(&after), "P9: it is a window");
    kani::assert(after.len + 1 == before.len, "P9: it is one less");
    let is_free = after.entry_indices.at[0] == after.len
        && after.entry_indices.values[0] == before.entry_indices.values[0];
    kani::assert(is_free, "P9: it is open no more, and its entry is the first of the free ones");
    let is_behind = rank < other && other < before.len;
    let moved = others_stay(&before, &after, other - usize::from(is_behind));
    kani::assert(moved, "P9: those behind it move up by one rank, their entries stay");
    let (of_row, rows) = const { rows(CAPACITY) };
    kani::assert(reads(&after) <= of_row + rows, "P9: the keys of a row are read, and of the rows");
    (is_behind, !same_key(after.first, before.first))
}

/// P9, F7: retiring a timestamp changes no other, leaves a window, and its entry is free again.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_retire() {
    let (is_behind, is_other) = of_capacity!(removed);
    kani::cover!(is_behind, "another moves up");
    kani::cover!(is_other, "the next due is another");
}
