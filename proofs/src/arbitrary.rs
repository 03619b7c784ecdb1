//! Any value of the machine's types, and any valid state.
//!
//! Harnesses start from these. States are valid by construction, so that no harness has to assume it;
//! `valid.rs` defines validity. Each function draws from Kani's `any` or, on hosts without Kani, from its
//! stand-in.

use crate::cell_window::{self, DueKey};
use crate::cells::Cells;
use crate::clouds::Clouds;
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::gate::Gate;
use crate::levels::{Group, Levels, MOST_LEVELS};
use crate::priority::Priority;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{Others, Window};

/// The greatest window.
pub(crate) const WINDOW: usize = 1024;

/// Returns any number below `cases`.
///
/// The runner may check one case at a time. `FUSELINE_CASE` then names the case at compile time, so that
/// everything that depends on it is constant. The line `Cases:` of a harness states their number.
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
    match kani::any_where(|rule: &u8| *rule < 3) {
        0 => Commit::Eager,
        1 => Commit::Patient,
        _ => Commit::Progressive,
    }
}

/// Returns local or one of the first `clouds` clouds.
pub(crate) fn any_source(clouds: u8) -> Source {
    Source::new(kani::any_where(|index| *index <= clouds)).unwrap_or(Source::LOCAL)
}

/// Returns local and the first `clouds` clouds.
pub(crate) const fn sources(clouds: u8) -> Sources {
    Sources::from_bits(u16::MAX >> (15 - clouds))
}

/// Returns any valid state of an open timestamp for which nothing beyond the first `clouds` clouds was
/// requested.
pub(crate) fn any_slot(commit: Commit, clouds: u8) -> Slot {
    let [requested, pending, cached] = kani::any();
    slot_of(commit, clouds, requested, pending, cached, kani::any())
}

/// Makes a valid state from any bits. The bits of a valid state stay the same, so no state is missing.
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
    // The cached sources are below the greatest pending one (P4).
    let below = u16::MAX >> pending.leading_zeros() >> 1;
    let cached = cached & requested & !pending & below;
    let (pending, cached, with_timers) = match commit {
        Commit::Eager => (pending, cached, pending | cached),
        Commit::Patient => (pending, cached, pending),
        Commit::Progressive => {
            // One source is cached, and the greatest pending one outranks it (F9).
            let outranked = u16::MAX.checked_shr(cached.leading_zeros()).unwrap_or(0);
            let better = pending & !outranked;
            (better, outranked ^ outranked >> 1, better)
        }
    };
    let deadline = if limited { pending & Sources::LOCAL.bits() } else { 0 };
    let armed = with_timers & !Sources::LOCAL.bits() | deadline;
    let [requested, pending, armed, cached] =
        [requested, pending, armed, cached].map(Sources::from_bits);
    // `every_valid_state_is_generated_and_accepted` shows that this is never an error.
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

/// Returns any timestamp. If values are random, it is `own` half of the time.
pub(crate) fn any_timestamp_or(own: Timestamp) -> Timestamp {
    if kani::any() { own } else { any_timestamp() }
}

/// Returns any priority. If values are random, it is usually a registered one.
pub(crate) fn any_priority_or_registered<const CLOUDS: usize>(clouds: &Clouds<CLOUDS>) -> Priority {
    let (known, mut priority) = (kani::any::<u8>(), Priority::new(kani::any()));
    for (i, registered) in clouds.priorities.iter().enumerate() {
        if usize::from(known) % 16 == i + 1 {
            priority = *registered;
        }
    }
    priority
}

/// Returns the earliest due instant of an entry's armed timers, by looking at each.
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

/// Returns the earlier of two due instants. `None` is later than any.
pub(crate) fn least(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a <= b { a } else { b }),
        (Some(due), None) | (None, Some(due)) => Some(due),
        (None, None) => None,
    }
}

/// Returns the entry of any open timestamp.
pub(crate) fn any_entry<const CLOUDS: usize>(commit: Commit) -> Entry<CLOUDS> {
    any_entry_of(any_slot(commit, CLOUDS as u8))
}

/// Returns any entry with these sets. Armed timers are due after the clock's start, because a due instant is
/// later than some clock's reading.
pub(crate) fn any_entry_of<const CLOUDS: usize>(slot: Slot) -> Entry<CLOUDS> {
    let mut entry = Entry { slot, ..Entry::EMPTY };
    let armed = slot.armed().bits();
    entry.local_due = any_due(armed & 1 != 0);
    for (i, due) in entry.dues.iter_mut().enumerate() {
        *due = any_due(armed >> (i + 1) & 1 != 0);
    }
    entry
}

/// Returns any due instant. The due instant of an armed timer is after the clock's start.
pub(crate) fn any_due(is_armed: bool) -> Instant {
    let nanos: u64 = kani::any();
    Instant::from_nanos(if is_armed && nanos == 0 { 1 } else { nanos })
}

/// Returns the key of a timestamp with this earliest due instant.
pub(crate) fn key_of(due: Option<Instant>, timestamp: Timestamp) -> DueKey {
    match due {
        Some(due) => DueKey { due_minus_one: due.as_nanos() - 1, timestamp },
        None => DueKey::NEVER,
    }
}

/// Returns the earlier of two keys, by due instant and then by timestamp.
pub(crate) fn earlier(a: DueKey, b: DueKey) -> DueKey {
    let is_first = a.due_minus_one < b.due_minus_one
        || a.due_minus_one == b.due_minus_one && a.timestamp <= b.timestamp;
    if is_first { a } else { b }
}

/// Returns any key, or never.
pub(crate) fn any_key() -> DueKey {
    key_of(if kani::any() { Some(any_due(true)) } else { None }, any_timestamp())
}

/// Returns the least of four keys.
pub(crate) fn first_of(keys: &[DueKey; 4]) -> DueKey {
    // The order in which the window compares them is easier to prove.
    earlier(keys[0], earlier(earlier(keys[1], keys[2]), keys[3]))
}

/// Returns the number of levels above the keys: a quarter of the keys, then of those, and so on, rounded up,
/// until one is left.
pub(crate) const fn levels(capacity: usize) -> usize {
    let (mut len, mut levels) = (capacity, 0);
    while len > 1 {
        len = len.div_ceil(4);
        levels += 1;
    }
    levels
}

/// The place of own in the arrays of open timestamps, the first place in use, and the number of open
/// timestamps.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct OwnPosition {
    pub(crate) place: usize,
    pub(crate) start: usize,
    pub(crate) len: usize,
}

impl OwnPosition {
    pub(crate) const fn is_open(self) -> bool {
        self.place < self.start + self.len
    }
}

/// Returns any number below `end`, without a division.
pub(crate) fn any_below(end: usize) -> usize {
    let any = usize::from(kani::any::<u16>()) & (end.next_power_of_two() - 1);
    if any < end { any } else { any - end }
}

/// Places own anywhere among any number of open timestamps.
pub(crate) fn any_open_position<const CAPACITY: usize>() -> OwnPosition {
    let before = any_below(CAPACITY);
    let len = before + 1 + any_below(CAPACITY);
    let len = if len < CAPACITY { len } else { CAPACITY };
    let start = any_start::<CAPACITY>(len);
    OwnPosition { place: start + before, start, len }
}

/// Places own behind any number of open timestamps, which may fill the window.
pub(crate) fn any_next_position<const CAPACITY: usize>() -> OwnPosition {
    let len = any_below(CAPACITY + 1);
    let start = any_start::<CAPACITY>(len);
    OwnPosition { place: start + len, start, len }
}

/// Returns any first place for `len` timestamps. If values are random, it is the last one half of the time.
fn any_start<const CAPACITY: usize>(len: usize) -> usize {
    let last = 2 * CAPACITY - len;
    let start = any_below(2 * CAPACITY + 1);
    if kani::any() || start > last { last } else { start }
}

/// Returns any index of an array of this length other than own's, or its end, where there is no element.
pub(crate) fn any_other_index(own: usize, size: usize) -> usize {
    let at = any_below(size + 1);
    if at == own { size } else { at }
}

/// Returns any window in which own has this place and this entry, with any index of the entry, any other
/// timestamp, any other free entry, and any keys beside.
pub(crate) fn any_window<const CLOUDS: usize, const CAPACITY: usize>(
    position: OwnPosition,
    entry: Entry<CLOUDS>,
) -> cell_window::Window<CLOUDS, CAPACITY> {
    let OwnPosition { place, start, len } = position;
    let is_open = position.is_open();
    let entry_index = any_below(CAPACITY);
    let places = [place, any_other_index(place, 2 * CAPACITY)];
    let free_len = CAPACITY - len;
    let free = if is_open { free_len } else { free_len.wrapping_sub(1) };
    let [less, greater] = kani::any_where(|[less, greater]: &[u64; 2]| less < greater);
    let timestamps = if places[0] < places[1] { [less, greater] } else { [greater, less] };
    let timestamps = timestamps.map(Timestamp::new);
    let index_beside = || any_other_index(entry_index, CAPACITY) as u16;
    let (own, meaningless) = (entry_index as u16, kani::any());
    let (indices, frees) = if is_open { (own, meaningless) } else { (meaningless, own) };
    // A free entry keeps its former contents.
    let key = if is_open { key_of(earliest(&entry), timestamps[0]) } else { DueKey::NEVER };
    let (keys, firsts, first) = any_levels::<CAPACITY>(entry_index, key);
    cell_window::Window {
        timestamps: Cells::new(places, timestamps, 2 * CAPACITY),
        entry_indices: Cells::new(places, [indices, index_beside()], 2 * CAPACITY),
        start,
        len,
        free: Cells::new(
            [free, any_other_index(free, CAPACITY)],
            [frees, index_beside()],
            CAPACITY,
        ),
        entries: Cells::new([entry_index, CAPACITY], [entry, Entry::EMPTY], CAPACITY),
        keys,
        firsts,
        first,
    }
}

/// Returns levels that have this key at this index and any others beside it, and the key of the
/// last level. The levels above may have any keys, but on one of them the key is the least of four.
fn any_levels<const CAPACITY: usize>(index: usize, key: DueKey) -> (Levels, Levels, DueKey) {
    let groups = || [(); MOST_LEVELS].map(|()| Group::none());
    let mut keys = Levels { groups: groups(), count: 1, right: 0 };
    let right = usize::from(kani::any_where(|level: &u8| usize::from(*level) < MOST_LEVELS));
    let mut firsts = Levels { groups: groups(), count: const { levels(CAPACITY) }, right };
    let mut four = any_group(index, CAPACITY, key);
    keys.groups[0] = four.clone();
    for (i, level) in firsts.groups[..const { levels(CAPACITY) }].iter_mut().enumerate() {
        let any = any_key();
        let own = if i == right { first_of(&four.keys) } else { any };
        four = any_group(four.at / 4, four.len.div_ceil(4), own);
        *level = four.clone();
    }
    (keys, firsts, four.keys[0])
}

/// Returns own's key at this place of a level of `len` keys, with any keys beside it.
fn any_group(at: usize, len: usize, own: DueKey) -> Group {
    let mut group = Group { at, len, ..Group::none() };
    group.keys[0] = own;
    for beside in 1..4 {
        let any = any_key();
        if at ^ beside < len {
            group.keys[beside] = any;
        }
    }
    group
}

/// Returns any open timestamps other than `own`, none of them greater than `newest`.
fn any_others<const CLOUDS: usize>(
    commit: Commit,
    own: Timestamp,
    newest: Timestamp,
    most: usize,
) -> Others<CLOUDS> {
    let len = kani::any::<u16>() as usize % WINDOW;
    let len = if len < most { len } else { most };
    let mut others = Others { len, greatest: newest, first: None, entry: any_entry(commit) };
    others.first = any_first(&others, own);
    if let Some((due, _)) = others.first {
        // A timestamp that fires has one or more timers that are due then.
        let timers = kani::any::<u16>() & others.entry.slot.armed().bits();
        let timers = if timers == 0 { u16::MAX } else { timers };
        if timers & 1 != 0 {
            others.entry.local_due = due;
        }
        for i in 0..CLOUDS {
            if timers >> (i + 1) & 1 != 0 {
                others.entry.dues[i] = due;
            }
        }
    }
    others
}

/// Returns any key of the others, or none.
fn any_first<const CLOUDS: usize>(
    others: &Others<CLOUDS>,
    own: Timestamp,
) -> Option<(Instant, Timestamp)> {
    if others.len == 0 || kani::any() {
        return None;
    }
    let timestamp = kani::any_where(|t| *t <= others.greatest.as_u64() && *t != own.as_u64());
    Some((any_due(true), Timestamp::new(timestamp)))
}

/// Returns any key of the others that is no earlier than `first`, or none.
pub(crate) fn any_others_after<const CLOUDS: usize>(
    others: &Others<CLOUDS>,
    own: Timestamp,
    first: (Instant, Timestamp),
) -> Option<(Instant, Timestamp)> {
    any_first(others, own).filter(|later| *later >= first)
}

/// Returns a machine with the greatest window, any open timestamps, and any clock, clouds and gates.
pub(crate) fn any_machine<const CLOUDS: usize>() -> Fusion<CLOUDS, WINDOW> {
    machine(kani::any())
}

/// Returns any machine of that kind in which own is open.
pub(crate) fn any_machine_of_own<const CLOUDS: usize>() -> Fusion<CLOUDS, WINDOW> {
    machine(true)
}

fn machine<const CLOUDS: usize>(is_open: bool) -> Fusion<CLOUDS, WINDOW> {
    let commit = any_commit();
    let window = 1 + kani::any::<u16>() as usize % WINDOW;
    let (own, entry) = (any_timestamp(), any_entry(commit));
    let due = if is_open { earliest(&entry) } else { None };
    // No open timestamp is greater than the greatest that was ever opened (F1).
    let mut newest = if is_open || kani::any() { Some(any_timestamp()) } else { None };
    if is_open && newest < Some(own) {
        newest = Some(own);
    }
    let others = match newest {
        None => Others::EMPTY,
        Some(newest) => any_others(commit, own, newest, window - usize::from(is_open)),
    };
    let open = Window { own, is_open, entry, due, others };
    Fusion { commit, window, clouds: any_clouds(), now: any_instant(), newest, open }
}

/// Returns any clouds with any gates. Their number is the capacity.
pub(crate) fn any_clouds<const CLOUDS: usize>() -> Clouds<CLOUDS> {
    let mut priorities = [Priority::LOCAL; CLOUDS];
    let mut below = 0;
    for (i, priority) in priorities.iter_mut().enumerate() {
        // The priorities ascend, with room for the following ones.
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

/// Returns a machine in which nothing is due, as when it takes an input. `f5_expire_by_the_rule` shows that
/// `at` is `Ready` only then.
pub(crate) fn with_nothing_due<const CLOUDS: usize>(
    mut fusion: Fusion<CLOUDS, WINDOW>,
) -> Fusion<CLOUDS, WINDOW> {
    if let Some(due) = fusion.next_due().filter(|due| *due <= fusion.now) {
        fusion.now = Instant::from_nanos(due.as_nanos() - 1);
    }
    fusion
}
