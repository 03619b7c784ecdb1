//! Any value of the machine's types; any valid state, made so that nothing need be assumed.

use crate::any_size::{self, Turn};
use crate::cells::Cells;
use crate::clouds::Clouds;
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{Rest, Window};

/// The greatest window that there is.
pub(crate) const WINDOW: usize = 1024;

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

/// Any timestamp; where values are random, `own` half of the time.
pub(crate) fn any_timestamp_beside(own: Timestamp) -> Timestamp {
    if kani::any() { own } else { any_timestamp() }
}

/// Any priority; where values are random, mostly one that is known.
pub(crate) fn any_priority_beside<const CLOUDS: usize>(clouds: &Clouds<CLOUDS>) -> Priority {
    let (known, mut priority) = (kani::any::<u8>(), Priority::new(kani::any()));
    for (i, registered) in clouds.priorities.iter().enumerate() {
        if usize::from(known) % 16 == i + 1 {
            priority = *registered;
        }
    }
    priority
}

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

/// Any open timestamp's entry.
pub(crate) fn any_entry<const CLOUDS: usize>(commit: Commit) -> Entry<CLOUDS> {
    any_entry_of(any_slot(commit, CLOUDS as u8))
}

/// Any with these sets. What is armed is due after the clock's start: a due instant lies after some clock's.
pub(crate) fn any_entry_of<const CLOUDS: usize>(slot: Slot) -> Entry<CLOUDS> {
    let mut entry = Entry { slot, ..Entry::EMPTY };
    let armed = slot.armed().bits();
    entry.local_due = any_due(armed & 1 != 0);
    for (i, due) in entry.dues.iter_mut().enumerate() {
        *due = any_due(armed >> (i + 1) & 1 != 0);
    }
    entry
}

/// Any due instant; that of an armed timer is after the clock's start.
pub(crate) fn any_due(is_armed: bool) -> Instant {
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

/// Any turn, or never.
fn any_turn() -> Turn {
    turn_of(if kani::any() { Some(any_due(true)) } else { None }, any_timestamp())
}

/// How many seats a row has, and how many rows there are: as few of both as can be, for a power of two of seats in each row.
pub(crate) const fn rows(capacity: usize) -> (usize, usize) {
    let mut row = 1;
    while row * row < capacity {
        row *= 2;
    }
    (row, capacity.div_ceil(row))
}

/// Where own is among the open timestamps, and how many are open.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Standing {
    pub(crate) rank: usize,
    pub(crate) len: usize,
}

/// Any number below `end`, by no division.
pub(crate) fn any_below(end: usize) -> usize {
    let any = usize::from(kani::any::<u16>()) & (end.next_power_of_two() - 1);
    if any < end { any } else { any - end }
}

/// Own is open, anywhere among any number.
pub(crate) fn any_standing<const CAPACITY: usize>() -> Standing {
    let rank = any_below(CAPACITY);
    let len = rank + 1 + any_below(CAPACITY);
    Standing { rank, len: if len < CAPACITY { len } else { CAPACITY } }
}

/// Own comes next, behind any number: beyond the last place if all are taken.
pub(crate) fn any_next<const CAPACITY: usize>() -> Standing {
    let len = any_below(CAPACITY + 1);
    Standing { rank: len, len }
}

/// Any place of an array but own's; its end, where there is none, as well.
fn any_beside<const CAPACITY: usize>(own: usize) -> usize {
    let at = any_below(CAPACITY + 1);
    if at == own { CAPACITY } else { at }
}

/// Any window in which own stands there with this entry: in any seat, any other timestamp beside it, and any first turns of the others.
pub(crate) fn any_window<const CLOUDS: usize, const CAPACITY: usize>(
    Standing { rank, len }: Standing,
    entry: Entry<CLOUDS>,
) -> any_size::Window<CLOUDS, CAPACITY> {
    let seat = any_below(CAPACITY);
    let ranks = [rank, any_beside::<CAPACITY>(rank)];
    let seats = [seat, any_beside::<CAPACITY>(seat)];
    let [less, greater] = kani::any_where(|[less, greater]: &[u64; 2]| less < greater);
    let timestamps = if ranks[0] < ranks[1] { [less, greater] } else { [greater, less] };
    let timestamps = timestamps.map(Timestamp::new);
    // What was kept in a seat stays there when it is empty.
    let turn = if rank < len { turn_of(earliest(&entry), timestamps[0]) } else { Turn::NEVER };
    let turns = [turn, any_turn()];
    let firsts = [earlier(turns[0], turns[1]), any_turn()];
    let (of_row, rows) = const { rows(CAPACITY) };
    any_size::Window {
        timestamps: Cells::new(ranks, timestamps),
        seats: Cells::new(ranks, seats.map(|seat| seat as u16)),
        len,
        entries: Cells::new(seats, [entry, Entry::EMPTY]),
        turns: Cells::new(seats, turns),
        firsts: Cells { rows, ..Cells::new([seat / of_row, CAPACITY], firsts) },
        first: earlier(firsts[0], firsts[1]),
    }
}

/// Any open timestamps beside `own`, at most so many, none greater than `newest`.
fn any_rest<const CLOUDS: usize>(
    commit: Commit,
    own: Timestamp,
    newest: Timestamp,
    most: usize,
) -> Rest<CLOUDS> {
    let len = kani::any::<u16>() as usize % WINDOW;
    let len = if len < most { len } else { most };
    let mut rest = Rest { len, greatest: newest, first: None, entry: any_entry(commit) };
    rest.first = any_first(&rest, own);
    if let Some((due, _)) = rest.first {
        // What fires has a timer that is due then, or several.
        let timers = kani::any::<u16>() & rest.entry.slot.armed().bits();
        let timers = if timers == 0 { u16::MAX } else { timers };
        if timers & 1 != 0 {
            rest.entry.local_due = due;
        }
        for i in 0..CLOUDS {
            if timers >> (i + 1) & 1 != 0 {
                rest.entry.dues[i] = due;
            }
        }
    }
    rest
}

/// Any turn of the rest, or none.
fn any_first<const CLOUDS: usize>(
    rest: &Rest<CLOUDS>,
    own: Timestamp,
) -> Option<(Instant, Timestamp)> {
    if rest.len == 0 || kani::any() {
        return None;
    }
    let timestamp = kani::any_where(|t| *t <= rest.greatest.as_u64() && *t != own.as_u64());
    Some((any_due(true), Timestamp::new(timestamp)))
}

/// Any turn of the rest that is no earlier than `first`, or none.
pub(crate) fn any_rest_after<const CLOUDS: usize>(
    rest: &Rest<CLOUDS>,
    own: Timestamp,
    first: (Instant, Timestamp),
) -> Option<(Instant, Timestamp)> {
    any_first(rest, own).filter(|later| *later >= first)
}

/// A machine with the greatest window that there is, and any timestamps open in it; any clock, clouds and gates.
pub(crate) fn any_machine<const CLOUDS: usize>() -> Fusion<CLOUDS, WINDOW> {
    machine(kani::any())
}

/// The same, and own is open.
pub(crate) fn any_machine_of_own<const CLOUDS: usize>() -> Fusion<CLOUDS, WINDOW> {
    machine(true)
}

fn machine<const CLOUDS: usize>(is_open: bool) -> Fusion<CLOUDS, WINDOW> {
    let commit = any_commit();
    let window = 1 + kani::any::<u16>() as usize % WINDOW;
    let (own, entry) = (any_timestamp(), any_entry(commit));
    let due = if is_open { earliest(&entry) } else { None };
    // F1: no later timestamp is open than the greatest ever opened.
    let mut newest = if is_open || kani::any() { Some(any_timestamp()) } else { None };
    if is_open && newest < Some(own) {
        newest = Some(own);
    }
    let rest = match newest {
        None => Rest::EMPTY,
        Some(newest) => any_rest(commit, own, newest, window - usize::from(is_open)),
    };
    let open = Window { own, is_open, entry, due, rest };
    Fusion { commit, window, clouds: any_clouds(), now: any_instant(), newest, open }
}

/// Any clouds, any gates; all of the capacity are registered.
pub(crate) fn any_clouds<const CLOUDS: usize>() -> Clouds<CLOUDS> {
    let mut priorities = [Priority::LOCAL; CLOUDS];
    let mut below = 0;
    for (i, priority) in priorities.iter_mut().enumerate() {
        // Ascending, with room for those to come.
        let most = u16::MAX - (CLOUDS - 1 - i) as u16;
        let number = kani::any();
        below = if number > below && number <= most { number } else { below + 1 };
        *priority = Priority::new(below);
    }
    Clouds { priorities, gates: core::array::from_fn(|_| any_gate()), len: CLOUDS }
}

pub(crate) fn any_gate() -> Gate {
    let [limit, resume] = kani::any_where(|[limit, resume]: &[u64; 2]| resume < limit);
    Gate { limit, resume, shut: kani::any() }
}

/// A machine in which nothing is due, as it takes an input: `f5_expire_by_the_rule` shows that `at` says so only then.
pub(crate) fn at_rest<const CLOUDS: usize>(
    mut fusion: Fusion<CLOUDS, WINDOW>,
) -> Fusion<CLOUDS, WINDOW> {
    if let Some(due) = fusion.next_due().filter(|due| *due <= fusion.now) {
        fusion.now = Instant::from_nanos(due.as_nanos() - 1);
    }
    fusion
}
