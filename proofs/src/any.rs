//! Any value of the machine's types; any valid state, made so that nothing need be assumed.

use crate::clouds::Clouds;
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{Turn, Window};

/// Any number below `cases`. A checker that is asked about one case at a time is told which when this is compiled, so that
/// all that hangs on it is a constant; a line `Cases:` tells the runner how many there are.
pub(crate) fn any_case(cases: u8) -> u8 {
    let case = kani::any_where(|case| *case < cases);
    match option_env!("FUSELINE_CASE") {
        None => case,
        Some(only) => {
            let only = only.bytes().fold(0, |number, digit| number * 10 + (digit - b'0'));
            kani::assume(case == only);
            only
        }
    }
}

pub(crate) fn any_commit() -> Commit {
    if kani::any() { Commit::Eager } else { Commit::Patient }
}

/// Local or one of the first `clouds` clouds.
pub(crate) fn any_source(clouds: u8) -> Source {
    Source::new(kani::any_where(|index| *index <= clouds)).unwrap_or(Source::LOCAL)
}

/// Local and the first `clouds` clouds.
pub(crate) const fn sources(clouds: u8) -> Sources {
    Sources::from_bits(u16::MAX >> (15 - clouds))
}

/// Any valid state of an open timestamp that was asked for nothing beyond the first `clouds` clouds.
pub(crate) fn any_slot(commit: Commit, clouds: u8) -> Slot {
    let [requested, pending, cached] = kani::any();
    slot_of(commit, clouds, requested, pending, cached, kani::any())
}

/// Bends any bits to a valid state. Those of a valid state stay as they are, so that none is left out.
pub(crate) fn slot_of(
    commit: Commit,
    clouds: u8,
    requested: u16,
    pending: u16,
    cached: u16,
    limited: bool,
) -> Slot {
    let requested = requested & sources(clouds).bits() | Sources::LOCAL.bits();
    let pending = match pending & requested {
        0 => Sources::LOCAL.bits(),
        pending => pending,
    };
    // P4: what is cached lies below the greatest pending.
    let below = u16::MAX >> pending.leading_zeros() >> 1;
    let cached = cached & requested & !pending & below;
    let kept = match commit {
        Commit::Eager => pending | cached,
        Commit::Patient => pending,
    };
    let deadline = if limited { pending & Sources::LOCAL.bits() } else { 0 };
    let armed = kept & !Sources::LOCAL.bits() | deadline;
    let [requested, pending, armed, cached] =
        [requested, pending, armed, cached].map(Sources::from_bits);
    // `every_valid_state_is_generated_and_accepted` shows that it is no error.
    Slot::from_sets(commit, requested, pending, armed, cached).unwrap_or(Slot::RETIRED)
}

pub(crate) fn any_instant() -> Instant {
    Instant::from_nanos(kani::any())
}

pub(crate) fn any_deadline() -> Deadline {
    Deadline::from_nanos(kani::any())
}

pub(crate) fn any_timestamp() -> Timestamp {
    Timestamp::new(kani::any())
}

/// The seats of a window of four by rank, the empty ones last: two rows of two. Which ranks share a row makes a difference,
/// and these are all three ways; which of the rows, and where in it, makes none.
pub(crate) const SEATINGS: [[u16; 4]; 3] = [[0, 1, 2, 3], [0, 2, 1, 3], [2, 0, 1, 3]];

/// The earliest due instant of an entry's armed timers, by looking at each.
pub(crate) fn earliest<const CLOUDS: usize>(entry: &Entry<CLOUDS>) -> Option<Instant> {
    let armed = entry.slot.armed().bits();
    let mut earliest = if armed & 1 != 0 { Some(entry.local_due) } else { None };
    let mut bit = 2;
    for due in entry.dues {
        if armed & bit != 0 {
            earliest = least(earliest, Some(due));
        }
        bit <<= 1;
    }
    earliest
}

/// The earlier one; none is later than any.
pub(crate) fn least(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a <= b { a } else { b }),
        (Some(due), None) | (None, Some(due)) => Some(due),
        (None, None) => None,
    }
}

/// Any open timestamp's entry. What is armed is due after the clock's start: a due instant lies after some clock's.
pub(crate) fn any_entry<const CLOUDS: usize>(commit: Commit) -> Entry<CLOUDS> {
    let mut entry = Entry { slot: any_slot(commit, CLOUDS as u8), ..Entry::EMPTY };
    let armed = entry.slot.armed().bits();
    entry.local_due = any_due(armed & 1 != 0);
    for (i, due) in entry.dues.iter_mut().enumerate() {
        *due = any_due(armed >> (i + 1) & 1 != 0);
    }
    entry
}

fn any_due(is_armed: bool) -> Instant {
    let nanos: u64 = kani::any();
    Instant::from_nanos(if is_armed && nanos == 0 { 1 } else { nanos })
}

/// The turn of a timestamp with this earliest due instant.
pub(crate) fn turn_of(due: Option<Instant>, timestamp: Timestamp) -> Turn {
    match due {
        Some(due) => Turn { key: due.as_nanos() - 1, timestamp },
        None => Turn::NEVER,
    }
}

/// The earlier of two turns: by due instant, then by timestamp.
pub(crate) fn earlier(a: Turn, b: Turn) -> Turn {
    let is_first = a.key < b.key || a.key == b.key && a.timestamp <= b.timestamp;
    if is_first { a } else { b }
}

/// Any window of four with as many open timestamps: any in ascending order, any entries.
pub(crate) fn any_window<const CLOUDS: usize, const SEATING: usize, const LEN: usize>(
    commit: Commit,
) -> Window<CLOUDS, 4> {
    let timestamps = kani::any_where(|of: &[u64; 4]| (1..LEN).all(|i| of[i - 1] < of[i]));
    any_window_at::<CLOUDS, SEATING, LEN>(commit, timestamps)
}

/// Any window of four with the first of these timestamps open: any entries.
pub(crate) fn any_window_at<const CLOUDS: usize, const SEATING: usize, const LEN: usize>(
    commit: Commit,
    timestamps: [u64; 4],
) -> Window<CLOUDS, 4> {
    let seats = const { SEATINGS[SEATING] };
    let timestamps = timestamps.map(Timestamp::new);
    // What was kept in a seat stays there when it is empty.
    let entries = core::array::from_fn(|_| any_entry(commit));
    let mut turns = [Turn::NEVER; 4];
    for rank in 0..LEN {
        let seat = usize::from(seats[rank]);
        turns[seat] = turn_of(earliest(&entries[seat]), timestamps[rank]);
    }
    let rows = [earlier(turns[0], turns[1]), earlier(turns[2], turns[3])];
    // Beyond the rows there is nothing.
    let firsts = [rows[0], rows[1], Turn::NEVER, Turn::NEVER];
    let first = earlier(rows[0], rows[1]);
    Window { timestamps, seats, len: LEN, entries, turns, firsts, first }
}

/// A window of one, with any timestamp open in it.
fn any_window_of_one<const CLOUDS: usize>(commit: Commit) -> Window<CLOUDS, 1> {
    let entry = any_entry(commit);
    window_of_one(any_timestamp(), entry)
}

/// A window of one, with this timestamp open in it.
pub(crate) fn window_of_one<const CLOUDS: usize>(
    timestamp: Timestamp,
    entry: Entry<CLOUDS>,
) -> Window<CLOUDS, 1> {
    let turn = turn_of(earliest(&entry), timestamp);
    Window {
        timestamps: [timestamp],
        seats: [0],
        len: 1,
        entries: [entry],
        turns: [turn],
        firsts: [turn],
        first: turn,
    }
}

/// A machine with a window of one and any timestamp open in it; any clock, clouds and gates.
pub(crate) fn any_single<const CLOUDS: usize>() -> Fusion<CLOUDS, 1> {
    let commit = any_commit();
    let open = any_window_of_one(commit);
    // F1: no later timestamp is open than the greatest ever opened.
    let least = open.timestamps[0];
    let newest = kani::any_where(|newest: &u64| *newest >= least.as_u64());
    let newest = Some(Timestamp::new(newest));
    Fusion { commit, window: 1, clouds: any_clouds(), now: any_instant(), newest, open }
}

/// The same with nothing open, and perhaps nothing ever opened.
pub(crate) fn any_empty<const CLOUDS: usize, const WINDOW: usize>() -> Fusion<CLOUDS, WINDOW> {
    Fusion {
        commit: any_commit(),
        window: WINDOW,
        clouds: any_clouds(),
        now: any_instant(),
        newest: if kani::any() { Some(any_timestamp()) } else { None },
        open: Window::new(),
    }
}

/// Any clouds, any gates; all of the capacity are registered.
pub(crate) fn any_clouds<const CLOUDS: usize>() -> Clouds<CLOUDS> {
    let mut priorities = [Priority::LOCAL; CLOUDS];
    let mut below = 0;
    for (i, priority) in priorities.iter_mut().enumerate() {
        // Ascending, with room for those to come.
        let most = u16::MAX - (CLOUDS - 1 - i) as u16;
        below = kani::any_where(|number| *number > below && *number <= most);
        *priority = Priority::new(below);
    }
    Clouds { priorities, gates: core::array::from_fn(|_| any_gate()), len: CLOUDS }
}

pub(crate) fn any_gate() -> Gate {
    let [limit, resume] = kani::any_where(|[limit, resume]: &[u64; 2]| resume < limit);
    Gate { limit, resume, shut: kani::any() }
}
