//! The invariant of the machine, and comparisons of two of its states.
//!
//! It is written from `SPEC.md` and not from the core, so that it can disagree with the core.

use crate::arbitrary::{earliest, first_of, key_of, levels};
use crate::cell_window::{self, DueKey};
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::priority::Priority;
use crate::slot::{Commit, Decision, Slot};
use crate::source::{Source, Sources};
use crate::time::Instant;
use crate::window::Window;
use crate::{Firing, Outcome};

/// Returns `true` if the state of an open timestamp is valid between two inputs, and between two firings.
pub(crate) fn is_valid(commit: Commit, slot: Slot) -> bool {
    let (requested, pending, armed, cached) =
        (slot.requested().bits(), slot.pending().bits(), slot.armed().bits(), slot.cached().bits());
    let local = Sources::LOCAL.bits();
    // Local was always requested, and only requested sources are pending or cached (F1, F2).
    let is_requested = requested & local != 0 && (pending | cached) & !requested == 0;
    // A result leaves pending when it joins cached (F3).
    let apart = pending & cached == 0;
    // With nothing pending it would have been forwarded or missed (F6).
    let waiting = pending != 0;
    // The greatest pending source outranks the greatest cached one (P4). Sets without a common member compare
    // in this way as numbers.
    let prompt = cached == 0 || pending > cached;
    // Under progressive only the source of the last output is cached, and the pending sources outrank it
    // (F9).
    let outranked = if cached == 0 { 0 } else { cached | (cached - 1) };
    let is_last = cached.count_ones() <= 1 && pending & outranked == 0;
    // Exactly these timers are armed (P8); the commit rule says which stay armed (F3).
    let (with_timers, of_rule) = match commit {
        Commit::Eager => (pending | cached, true),
        Commit::Patient => (pending, true),
        Commit::Progressive => (pending, is_last),
    };
    let timers = armed & !local == with_timers & !local && armed & local & !pending == 0;
    is_requested && apart && waiting && prompt && of_rule && timers
}

/// Returns `true` if the deadline is armed until local returned, failed or was given up, as P7 requires for a
/// timestamp opened with a deadline.
pub(crate) fn is_limited(slot: Slot) -> bool {
    !slot.pending().contains(Source::LOCAL) || slot.armed().contains(Source::LOCAL)
}

/// Returns `true` if two keys are equal, field by field.
pub(crate) fn same_key(a: DueKey, b: DueKey) -> bool {
    a.due_minus_one == b.due_minus_one && a.timestamp == b.timestamp
}

/// Returns `true` if the window is valid: the timestamps ascend, no two have the same entry, and
/// the key of each entry and the least of each four are right. Own and the other one are any two
/// timestamps, or any two free entries.
pub(crate) fn is_window<const CLOUDS: usize, const CAPACITY: usize>(
    window: &cell_window::Window<CLOUDS, CAPACITY>,
) -> bool {
    let (timestamps, indices, free) = (&window.timestamps, &window.entry_indices, &window.free);
    let open = window.start..window.start + window.len;
    let [own, other] = timestamps.at;
    let (own_open, other_open) = (open.contains(&own), open.contains(&other));
    let ascend = (own < other) == (timestamps.values[0] < timestamps.values[1]);
    let entry_index = if own_open { indices.values[0] } else { free.values[0] };
    let free_len = CAPACITY - window.len;
    // The next timestamp to be opened gets the last free entry, and a retired one puts its entry back behind
    // them.
    let first_free = if own_open { free_len } else { free_len.wrapping_sub(1) };
    let other_free = free.at[1] < free_len && free.at[1] != free.at[0];
    let apart = (!other_open || indices.values[1] != entry_index)
        && (!other_free || free.values[1] != entry_index);
    let same_indices = indices.at == timestamps.at
        && free.at[0] == first_free
        && window.entries.at[0] == usize::from(entry_index)
        && window.keys.groups[0].at == usize::from(entry_index);
    // A due instant is later than some clock's reading (F2).
    let due = earliest(&window.entries.values[0]);
    let key = if own_open { key_of(due, timestamps.values[0]) } else { DueKey::NEVER };
    window.len <= CAPACITY
        && open.end <= 2 * CAPACITY
        && (own != other || other >= 2 * CAPACITY)
        && (!(own_open && other_open) || ascend)
        && apart
        && same_indices
        && (!own_open || due != Some(Instant::START))
        && same_key(window.keys.groups[0].keys[0], key)
        && has_firsts(window)
}

/// Returns `true` if own's key, on the level that is to be right, is the least of the four below it. The
/// least of all is the key of the last level.
fn has_firsts<const CLOUDS: usize, const CAPACITY: usize>(
    window: &cell_window::Window<CLOUDS, CAPACITY>,
) -> bool {
    let (mut four, mut are_first) = (&window.keys.groups[0], true);
    for (i, level) in window.firsts.groups[..const { levels(CAPACITY) }].iter().enumerate() {
        let is_first = i != window.firsts.right || same_key(level.keys[0], first_of(&four.keys));
        are_first &= is_first && level.at == four.at / 4;
        four = level;
    }
    are_first && same_key(window.first, four.keys[0])
}

/// Returns `true` if the machine is valid between two inputs, and between two firings, as far as `own` and
/// the window are concerned.
pub(crate) fn is_machine<const CLOUDS: usize, const CAPACITY: usize>(
    fusion: &Fusion<CLOUDS, CAPACITY>,
) -> bool {
    let (open, others) = (&fusion.open, &fusion.open.others);
    // The number of open timestamps is at most the window (P9).
    let fits = fusion.window <= CAPACITY && fusion.len() <= fusion.window;
    // No open timestamp is greater than the greatest that was ever opened (F1).
    let reached = |timestamp| fusion.newest.is_some_and(|newest| newest >= timestamp);
    let own = !open.is_open || reached(open.own) && is_valid(fusion.commit, open.entry.slot);
    let others = others.len == 0 || reached(others.greatest);
    // A due instant is later than some clock's reading (F2).
    let due = open.due.is_none_or(|due| open.is_open && due > Instant::START);
    fits && own && others && due
}

/// Returns `true` if own is the same in both windows, with its timers' due instants.
pub(crate) fn same_own<const CLOUDS: usize, const CAPACITY: usize>(
    a: &Window<CLOUDS, CAPACITY>,
    b: &Window<CLOUDS, CAPACITY>,
) -> bool {
    let mut same = a.entry.slot == b.entry.slot && a.entry.local_due == b.entry.local_due;
    for i in 0..CLOUDS {
        same &= a.entry.dues[i] == b.entry.dues[i];
    }
    a.own == b.own && a.is_open == b.is_open && a.due == b.due && (!a.is_open || same)
}

/// Returns the later of two instants.
pub(crate) fn later(a: Instant, b: Instant) -> Instant {
    if a < b { b } else { a }
}

/// Returns the armed timers that are due exactly then, by looking at each.
pub(crate) fn due_at<const CLOUDS: usize>(entry: &Entry<CLOUDS>, due: Instant) -> u16 {
    let armed = entry.slot.armed().bits();
    let mut fired = armed & u16::from(entry.local_due == due);
    for (i, of_cloud) in entry.dues.iter().enumerate() {
        fired |= armed & u16::from(*of_cloud == due) << (i + 1);
    }
    fired
}

/// Returns the source that a cloud's priority names, by looking at each.
pub(crate) fn source_of<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    priority: Priority,
) -> Option<Source> {
    let index = fusion.clouds.priorities.iter().position(|known| *known == priority);
    match index {
        _ if priority == Priority::LOCAL => Some(Source::LOCAL),
        Some(index) => Source::new(index as u8 + 1),
        None => None,
    }
}

/// Returns `true` if the outcome is what the step of the timestamp decided.
pub(crate) fn is_outcome_of_decision<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    outcome: Outcome<CLOUDS>,
    decision: Decision,
) -> bool {
    match (outcome, decision) {
        (Outcome::Dropped(dropped), Decision::Dropped(reason)) => dropped == reason,
        (Outcome::Held, Decision::Held)
        | (Outcome::Waiting, Decision::Waiting)
        | (Outcome::Missed, Decision::Missed) => true,
        (
            Outcome::Forwarded { by, cancelled },
            Decision::Forwarded { by: source, cancelled: set },
        )
        | (
            Outcome::Preliminary { by, cancelled },
            Decision::Preliminary { by: source, cancelled: set },
        ) => source_of(fusion, by) == Some(source) && cancelled.sources() == set,
        (Outcome::Final { by }, Decision::Final { by: source }) => {
            source_of(fusion, by) == Some(source)
        }
        (
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Missed
            | Outcome::Preliminary { .. }
            | Outcome::Final { .. }
            | Outcome::Forwarded { .. },
            _,
        ) => false,
    }
}

/// Returns `true` if two firings agree, as far as two machines and their answers do.
pub(crate) fn same_firing<const CLOUDS: usize>(a: &Firing<CLOUDS>, b: &Firing<CLOUDS>) -> bool {
    let same = match (a.outcome, b.outcome) {
        (
            Outcome::Forwarded { by: a, cancelled: c },
            Outcome::Forwarded { by: b, cancelled: d },
        ) => a == b && c.sources() == d.sources(),
        (Outcome::Final { by: a }, Outcome::Final { by: b }) => a == b,
        (Outcome::Waiting, Outcome::Waiting) | (Outcome::Missed, Outcome::Missed) => true,
        // A firing sends nothing and leaves its timestamp open (F9).
        (
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Missed
            | Outcome::Preliminary { .. }
            | Outcome::Final { .. }
            | Outcome::Forwarded { .. },
            _,
        ) => false,
    };
    same && a.timestamp == b.timestamp && a.due == b.due && a.timers.sources() == b.timers.sources()
}
