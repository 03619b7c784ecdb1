//! The window of open timestamps, of any size: from any window, each way to change it and each query.
//!
//! The shipped `window.rs` runs over cells in place of its arrays (`src/cells.rs`). *Own* is the timestamp
//! that a call is about, at any place and with any entry, among any number; the *other* one is any other
//! timestamp. These harnesses show the table of `src/window.rs`.
//!
//! A capacity is a constant of the code. Each harness takes the least, the greatest and some between;
//! `tests/window.rs` checks what else the code derives from it, for all capacities. A window uses only the
//! earliest due instant of a timestamp's entry, which has a harness of its own.

use crate::arbitrary::{
    any_case, any_commit, any_due, any_entry, any_entry_of, any_key, any_next_position,
    any_open_position, any_source, any_timestamp, any_window, earlier, earliest, key_of, levels,
    slot_of,
};
use crate::cell_window::{DueKey, OpenIndex, Window};
use crate::entry::Entry;
use crate::levels::Group;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::valid::{is_window, same_key};

/// Enough clouds for the earliest of several due instants.
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

/// Returns the place of own.
fn own_index<const CAPACITY: usize>(window: &Window<CLOUDS, CAPACITY>) -> OpenIndex {
    OpenIndex { place: window.timestamps.at[0] as u16, entry: window.entry_indices.values[0] }
}

fn same_entry(a: &Entry<CLOUDS>, b: &Entry<CLOUDS>) -> bool {
    let mut same = a.slot == b.slot && a.local_due == b.local_due;
    for i in 0..CLOUDS {
        same &= a.dues[i] == b.dues[i];
    }
    same
}

/// Returns `true` if the other timestamp, the index of its entry, the other free entry and the keys beside
/// own's are as before. The other timestamp may have moved to `place`.
fn others_stay<const CAPACITY: usize>(
    before: &Window<CLOUDS, CAPACITY>,
    after: &Window<CLOUDS, CAPACITY>,
    place: usize,
) -> bool {
    let mut same = after.timestamps.at[1] == place
        && after.entry_indices.at[1] == place
        && after.timestamps.values[1] == before.timestamps.values[1]
        && after.entry_indices.values[1] == before.entry_indices.values[1]
        && after.free.at[1] == before.free.at[1]
        && after.free.values[1] == before.free.values[1];
    for (now, then) in fours(after).zip(fours(before)) {
        for beside in 1..4 {
            same &= same_key(now.keys[beside], then.keys[beside]);
        }
    }
    same
}

/// Returns the groups of four that include own's key.
fn fours<const CAPACITY: usize>(window: &Window<CLOUDS, CAPACITY>) -> impl Iterator<Item = &Group> {
    let above = &window.firsts.groups[..const { levels(CAPACITY) }];
    window.keys.groups[..1].iter().chain(above)
}

/// Returns `true` if the same timestamps are open, at the same places and with the same entries.
fn same_order<const CAPACITY: usize>(
    before: &Window<CLOUDS, CAPACITY>,
    after: &Window<CLOUDS, CAPACITY>,
) -> bool {
    (after.start, after.len) == (before.start, before.len)
        && after.timestamps.at == before.timestamps.at
        && after.timestamps.values[0] == before.timestamps.values[0]
        && after.entry_indices.values[0] == before.entry_indices.values[0]
        && others_stay(before, after, before.timestamps.at[1])
}

/// Returns the number of keys that were read besides own's. P9 allows three on each level, or none.
fn reads<const CAPACITY: usize>(window: &Window<CLOUDS, CAPACITY>) -> usize {
    fours(window).map(|four| four.reads.get()).sum()
}

/// The earliest due instant of a timestamp is that of one of its armed timers, and none of them is due before
/// (P9).
///
/// It is the least of a list whose members are all looked at; `tests/window.rs` shows this for all sets of
/// 16.
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
    (is_open, position.place > position.start)
}

/// Lookup finds open timestamps and nothing else (P9, F8).
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

fn no_later(a: DueKey, b: DueKey) -> bool {
    same_key(earlier(a, b), a)
}

fn next<const CAPACITY: usize>() -> (bool, bool) {
    let entry = any_entry(any_commit());
    let window = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let own = key_of(earliest(&window.entries.values[0]), window.timestamps.values[0]);
    let due = window.next_due();
    // The least key is the key of one of them.
    let is_first = same_key(window.first, own);
    let is_armed = !same_key(own, DueKey::NEVER);
    // Each level is checked by itself. So no key is before the least of all, because the order is transitive.
    let mut below = &window.keys.groups[0];
    for (i, level) in window.firsts.groups[..const { levels(CAPACITY) }].iter().enumerate() {
        let precedes = i != window.firsts.right || no_later(level.keys[0], below.keys[0]);
        kani::assert(precedes, "P9: no timer is due before the first of its four");
        below = level;
    }
    let is_last = same_key(window.first, below.keys[0]);
    kani::assert(is_last, "P9: the next due instant is that of the last level");
    let [a, b, c] = [any_key(), any_key(), any_key()];
    let is_order = no_later(a, c) || !no_later(a, b) || !no_later(b, c);
    kani::assert(is_order, "P9: so no timer is due before the next due instant");
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
    (false, window.keys.groups[0].keys[1].due_minus_one == own.due_minus_one)
}

/// The next due instant is the least armed one, and the least timestamp that is due then fires (P9, F5, A23).
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

fn pushed<const CAPACITY: usize>() -> (usize, bool, bool) {
    let position = any_next_position::<CAPACITY>();
    let before = any_window::<CLOUDS, CAPACITY>(position, any_entry(any_commit()));
    let (timestamp, entry) = (any_timestamp(), any_entry(any_commit()));
    let other = before.timestamps.at[1];
    let is_open = before.start <= other && other < position.place;
    kani::assume(!is_open || before.timestamps.values[1] < timestamp);
    let mut after = before.clone();
    let added = after.push(timestamp, entry);
    kani::assert(added == (position.len < CAPACITY), "P9: there is room for the capacity");
    kani::assert(after.len == position.len + usize::from(added), "P9: it is one more");
    kani::assert(is_window(&after), "P9: it is a window");
    let moved = added && position.place == 2 * CAPACITY;
    kani::assert(after.start == if moved { 0 } else { before.start }, "P9: all move at the end");
    // A place that is not open may be overwritten.
    let place = if moved && !is_open { after.timestamps.at[1] } else { other };
    let place = if moved && is_open { other - before.start } else { place };
    let same = others_stay(&before, &after, place) && reads(&after) == 0;
    kani::assert(same, "P9: only its own timestamp changes, and no other is looked at");
    if added {
        let is_there = after.timestamps.values[0] == timestamp;
        let is_stored = same_entry(&after.entries.values[0], &entry);
        kani::assert(is_there && is_stored, "P9: it is there with its entry");
    }
    (position.len, added, moved && is_open)
}

/// Opening adds the timestamp and changes no other (P9, F1, F8).
///
/// The timestamp is assumed to be greater than all open ones; otherwise the machine refuses it (F1), as
/// `f1_open_by_the_rule` shows.
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_open() {
    let (len, added, moved) = of_capacity!(pushed);
    kani::cover!(len == 0 && added, "it is the first");
    kani::cover!(!added, "it is full");
    kani::cover!(moved, "all move to the start");
}

/// Returns any sets of a timestamp for which this source was not requested, or that was just opened.
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

/// Arming a timer changes no other timestamp, and the next due instant is still the least (P9, F2).
///
/// The request is assumed to be admitted, because the machine arms no other.
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

/// Returns any sets in which no timer is armed that is not armed in these.
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
    let most = const { 3 * levels(CAPACITY) };
    kani::assert(reads(&after) <= most, "P9: at most three keys are read on each level");
    let wanted = Entry { slot, ..entry };
    kani::assert(same_entry(&after.entries.values[0], &wanted), "P9: it has the new state");
    let fewer = entry.slot.armed() != slot.armed();
    (fewer && same_key(after.first, before.first), !same_key(after.first, before.first))
}

/// Closing requests changes no other timestamp, and the next due instant is still the least (P9, F3, F4, F5).
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

fn removed<const CAPACITY: usize>() -> (bool, bool, bool) {
    let entry = any_entry(any_commit());
    let before = any_window::<CLOUDS, CAPACITY>(any_open_position::<CAPACITY>(), entry);
    let [own, other] = before.timestamps.at;
    let open = before.start..before.start + before.len;
    let mut after = before.clone();
    after.remove(own_index(&before));
    kani::assert(is_window(&after), "P9: it is a window");
    kani::assert(after.len + 1 == before.len, "P9: it is one less");
    let places = after.start..after.start + after.len;
    let is_free = !places.contains(&after.timestamps.at[0])
        && after.free.values[0] == before.entry_indices.values[0];
    kani::assert(is_free, "P9: it is open no more, and its entry is the last of the free ones");
    // Each open timestamp has as many before it as it had, not counting own.
    let is_behind = own < other && open.contains(&other);
    let place = if open.contains(&other) {
        after.start + (other - before.start) - usize::from(is_behind)
    } else {
        after.timestamps.at[1]
    };
    let moved = others_stay(&before, &after, place);
    kani::assert(moved, "P9: those before it or behind it move by one place, their entries stay");
    let move_up = after.start > before.start;
    let move_count = if move_up { own - open.start } else { open.end - 1 - own };
    kani::assert(2 * move_count < before.len, "P9: less than half of them move");
    let most = const { 3 * levels(CAPACITY) };
    kani::assert(reads(&after) <= most, "P9: at most three keys are read on each level");
    let changes_place = open.contains(&other) && after.timestamps.at[1] != other;
    (is_behind && changes_place, !is_behind && changes_place, !same_key(after.first, before.first))
}

/// Retiring a timestamp changes no other, leaves a valid window, and frees its entry (P9, F7).
///
/// Cases: 6.
/// Bounds: 2 clouds; capacities 1, 2, 3, 16, 1000, 1024.
#[kani::proof]
#[kani::unwind(18)]
pub fn p9_retire() {
    let (down, up, is_other) = of_capacity!(removed);
    kani::cover!(down, "one behind it moves down");
    kani::cover!(up, "one before it moves up");
    kani::cover!(is_other, "the next due is another");
}
