//! The invariant, once, from the words of `SPEC.md` and not from the core.

use crate::any::{earlier, earliest, turn_of};
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::Instant;
use crate::window::{Turn, Window};

/// What holds of every open timestamp between two inputs, and between two firings.
pub(crate) fn is_valid(commit: Commit, slot: Slot) -> bool {
    let (requested, pending, armed, cached) =
        (slot.requested().bits(), slot.pending().bits(), slot.armed().bits(), slot.cached().bits());
    let local = Sources::LOCAL.bits();
    // F1, F2: 0 always was asked for, and only what was asked for is pending or cached.
    let asked = requested & local != 0 && (pending | cached) & !requested == 0;
    // F3: a result leaves pending as it joins cached.
    let apart = pending & cached == 0;
    // F6: with nothing pending it would have been forwarded or missed.
    let waiting = pending != 0;
    // P4: the greatest pending outranks the greatest cached. As numbers, sets without a common member compare so.
    let prompt = cached == 0 || pending > cached;
    // P8: what is armed, and nothing else; F3 says what the commit rule keeps armed.
    let kept = match commit {
        Commit::Eager => pending | cached,
        Commit::Patient => pending,
    };
    let timers = armed & !local == kept & !local && armed & local & !pending == 0;
    asked && apart && waiting && prompt && timers
}

/// P7 for a timestamp opened with a deadline: until local returned, failed or was given up, the deadline is armed.
pub(crate) fn is_limited(slot: Slot) -> bool {
    !slot.pending().contains(Source::LOCAL) || slot.armed().contains(Source::LOCAL)
}

/// Whether two turns are the same, field by field.
pub(crate) fn same_turn(a: Turn, b: Turn) -> bool {
    a.key == b.key && a.timestamp == b.timestamp
}

/// What holds of the window: the timestamps ascend, each seat is taken by one of them or empty, and each seat, each row and
/// the window know their first turn.
pub(crate) fn is_window<const CLOUDS: usize, const CAPACITY: usize>(
    window: &Window<CLOUDS, CAPACITY>,
) -> bool {
    let len = window.len;
    let mut valid = len <= CAPACITY;
    for rank in 1..CAPACITY {
        valid &= rank >= len || window.timestamps[rank - 1] < window.timestamps[rank];
    }
    // By seat, so that no place is looked for.
    let mut turns = [Turn::NEVER; CAPACITY];
    for seat in 0..CAPACITY {
        let due = earliest(&window.entries[seat]);
        let mut times = 0;
        for rank in 0..CAPACITY {
            if usize::from(window.seats[rank]) == seat {
                times += 1;
                if rank < len {
                    turns[seat] = turn_of(due, window.timestamps[rank]);
                    // F2: a due instant lies after some clock's.
                    valid &= due != Some(Instant::START);
                }
            }
        }
        valid &= times == 1 && same_turn(window.turns[seat], turns[seat]);
    }
    let (row, rows) = (Window::<CLOUDS, CAPACITY>::ROW, Window::<CLOUDS, CAPACITY>::ROWS);
    let mut all = Turn::NEVER;
    for i in 0..rows {
        let mut first = Turn::NEVER;
        for seat in row * i..CAPACITY.min(row * (i + 1)) {
            first = earlier(first, turns[seat]);
        }
        valid &= same_turn(window.firsts[i], first);
        all = earlier(all, first);
    }
    valid && same_turn(window.first, all)
}
