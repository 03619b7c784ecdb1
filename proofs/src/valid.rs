//! The invariant, once, from the words of `SPEC.md` and not from the core.

use crate::any::{earlier, earliest, rows, turn_of};
use crate::any_size::{self, Turn};
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::priority::Priority;
use crate::slot::{Commit, Decision, Slot};
use crate::source::{Source, Sources};
use crate::time::Instant;
use crate::window::Window;
use crate::{Firing, Outcome};

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

/// What holds of the window: the timestamps ascend, no two have one seat, and each seat, each row and the window know their
/// first turn. Own and the other one are any two timestamps and any two seats.
pub(crate) fn is_window<const CLOUDS: usize, const CAPACITY: usize>(
    window: &any_size::Window<CLOUDS, CAPACITY>,
) -> bool {
    let (timestamps, seats) = (&window.timestamps, &window.seats);
    let [own, other] = timestamps.at;
    let both_open = own < window.len && other < window.len;
    let ascend = (own < other) == (timestamps.values[0] < timestamps.values[1]);
    let seat = usize::from(seats.values[0]);
    let (of_row, _) = const { rows(CAPACITY) };
    let apart = own != other && seats.values[0] != seats.values[1] || other >= CAPACITY;
    let same_places = seats.at == timestamps.at
        && window.entries.at[0] == seat
        && window.turns.at[0] == seat
        && window.firsts.at[0] == seat / of_row;
    // F2: a due instant lies after some clock's.
    let due = earliest(&window.entries.values[0]);
    let is_open = own < window.len;
    let turn = if is_open { turn_of(due, timestamps.values[0]) } else { Turn::NEVER };
    let row = earlier(window.turns.values[0], window.turns.values[1]);
    let all = earlier(window.firsts.values[0], window.firsts.values[1]);
    window.len <= CAPACITY
        && (!both_open || ascend)
        && apart
        && same_places
        && (!is_open || due != Some(Instant::START))
        && same_turn(window.turns.values[0], turn)
        && same_turn(window.firsts.values[0], row)
        && same_turn(window.first, all)
}

/// What holds of the machine between two inputs, and between two firings, as far as `own` and the window go.
pub(crate) fn is_machine<const CLOUDS: usize, const CAPACITY: usize>(
    fusion: &Fusion<CLOUDS, CAPACITY>,
) -> bool {
    let (open, rest) = (&fusion.open, &fusion.open.rest);
    // P9: at most the window is open.
    let fits = fusion.window <= CAPACITY && fusion.len() <= fusion.window;
    // F1: no later timestamp is open than the greatest ever opened.
    let reached = |timestamp| fusion.newest.is_some_and(|newest| newest >= timestamp);
    let own = !open.is_open || reached(open.own) && is_valid(fusion.commit, open.entry.slot);
    let others = rest.len == 0 || reached(rest.greatest);
    // F2: a due instant lies after some clock's.
    let due = open.due.is_none_or(|due| open.is_open && due > Instant::START);
    fits && own && others && due
}

/// Whether own is the same in both windows, its timers' due instants included.
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

/// The later of two instants.
pub(crate) fn later(a: Instant, b: Instant) -> Instant {
    if a < b { b } else { a }
}

/// The armed timers that are due exactly then, by looking at each.
pub(crate) fn due_at<const CLOUDS: usize>(entry: &Entry<CLOUDS>, due: Instant) -> u16 {
    let armed = entry.slot.armed().bits();
    let mut fired = armed & u16::from(entry.local_due == due);
    for (i, of_cloud) in entry.dues.iter().enumerate() {
        fired |= armed & u16::from(*of_cloud == due) << (i + 1);
    }
    fired
}

/// The source that a cloud's priority names, by looking at each.
pub(crate) fn source_of<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    priority: Priority,
) -> Option<Source> {
    let place = fusion.clouds.priorities.iter().position(|known| *known == priority);
    match place {
        _ if priority == Priority::LOCAL => Some(Source::LOCAL),
        Some(place) => Source::new(place as u8 + 1),
        None => None,
    }
}

/// Whether an outcome is what the step of the timestamp decided.
pub(crate) fn tells<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    outcome: Outcome<CLOUDS>,
    decision: Decision,
) -> bool {
    match (outcome, decision) {
        (Outcome::Dropped(said), Decision::Dropped(reason)) => said == reason,
        (Outcome::Held, Decision::Held)
        | (Outcome::Waiting, Decision::Waiting)
        | (Outcome::Missed, Decision::Missed) => true,
        (
            Outcome::Forwarded { by, cancelled },
            Decision::Forwarded { by: source, cancelled: set },
        ) => source_of(fusion, by) == Some(source) && cancelled.sources() == set,
        (
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Missed
            | Outcome::Forwarded { .. },
            _,
        ) => false,
    }
}

/// Two firings, as far as two machines and their answers agree.
pub(crate) fn same_firing<const CLOUDS: usize>(a: &Firing<CLOUDS>, b: &Firing<CLOUDS>) -> bool {
    let same = match (a.outcome, b.outcome) {
        (
            Outcome::Forwarded { by: a, cancelled: c },
            Outcome::Forwarded { by: b, cancelled: d },
        ) => a == b && c.sources() == d.sources(),
        (Outcome::Waiting, Outcome::Waiting) | (Outcome::Missed, Outcome::Missed) => true,
        (
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Missed
            | Outcome::Forwarded { .. },
            _,
        ) => false,
    };
    same && a.timestamp == b.timestamp && a.due == b.due && a.timers.sources() == b.timers.sources()
}
