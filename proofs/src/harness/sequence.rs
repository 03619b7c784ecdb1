//! Short runs from the empty machine: what the steps from any state promise, seen once more from the start.
//!
//! Between two steps little of the machine is not known. The machine of each step is put together of this and constants,
//! and what the step leaves is shown to be of that form again: so no step looks at places that are not known.

use crate::any::{
    any_case, any_commit, any_deadline, any_instant, any_timestamp, earlier, earliest, least,
    turn_of,
};
use crate::clouds::{Cloud, Clouds};
use crate::entry::Entry;
use crate::fusion::{At, Fusion};
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::Commit;
use crate::time::{Instant, Timestamp};
use crate::told;
use crate::valid::same_turn;
use crate::window::Window;
use crate::{Admission, DropReason, OpenRefusal, Opening, Outcome};

/// The one cloud. What a set of sources does is proved for all 15 in `slot`.
const CLOUD: Priority = Priority::new(7);

/// The timestamps: fixed, so that where one lies is known.
const TIMESTAMPS: [Timestamp; 2] = [Timestamp::new(5), Timestamp::new(8)];

/// One timestamp's life as seen from outside.
struct Seen {
    /// The due instants of the deadline and of the request, if there are.
    dues: [Option<Instant>; 2],
    /// Whether local's and the cloud's result were held.
    held: [bool; 2],
    /// How often it was forwarded or missed.
    ends: u8,
}

/// What is not known of a machine in which the first timestamp, or both, were opened.
#[derive(Clone, Copy)]
struct Known<const WINDOW: usize> {
    /// Which are open.
    open: [bool; WINDOW],
    entries: [Entry<1>; WINDOW],
    commit: Commit,
    now: Instant,
    is_shut: bool,
}

impl<const WINDOW: usize> Known<WINDOW> {
    /// Takes a machine apart, and shows that there is nothing else to it.
    fn of(fusion: &Fusion<1, WINDOW>, newest: Timestamp) -> Self {
        let known = Self {
            open: core::array::from_fn(|i| is_open(fusion, TIMESTAMPS[i])),
            entries: fusion.open.entries,
            commit: fusion.commit,
            now: fusion.now,
            is_shut: fusion.clouds.gates[0].is_shut(),
        };
        let is_all = match known.which() {
            1 => known.is_all::<1>(fusion, newest),
            2 => known.is_all::<2>(fusion, newest),
            3 => known.is_all::<3>(fusion, newest),
            _ if WINDOW == 1 => known.is_all::<0>(fusion, newest),
            // Which seat is the first empty one hangs on the order of the two ends, and no step follows.
            _ => fusion.is_empty() && fusion.next_due().is_none(),
        };
        kani::assert(is_all, "P9: the window has those that are open");
        known
    }

    /// Whether the machine is what is put together.
    fn is_all<const OPEN: u8>(&self, fusion: &Fusion<1, WINDOW>, newest: Timestamp) -> bool {
        let all = self.machine::<OPEN>(newest);
        fusion.window == all.window
            && fusion.clouds.priorities[0] == all.clouds.priorities[0]
            && fusion.clouds.gates[0] == all.clouds.gates[0]
            && fusion.clouds.len == all.clouds.len
            && fusion.newest == all.newest
            && fusion.open.len == all.open.len
            && (0..all.open.len).all(|i| fusion.open.timestamps[i] == all.open.timestamps[i])
            && (0..WINDOW).all(|i| fusion.open.seats[i] == all.open.seats[i])
            && (0..WINDOW).all(|i| same_turn(fusion.open.turns[i], all.open.turns[i]))
            && same_turn(fusion.open.firsts[0], all.open.first)
            && same_turn(fusion.open.first, all.open.first)
    }

    /// Which are open, as bits.
    fn which(&self) -> u8 {
        (0..WINDOW).fold(0, |bits, i| bits | u8::from(self.open[i]) << i)
    }

    /// The earliest due instant of those of `OPEN`.
    fn next<const OPEN: u8>(&self) -> Option<Instant> {
        let open = (0..WINDOW).filter(|i| OPEN >> i & 1 == 1);
        open.fold(None, |next, i| least(next, earliest(&self.entries[i])))
    }

    /// The machine with those of `OPEN` open.
    fn machine<const OPEN: u8>(&self, newest: Timestamp) -> Fusion<1, WINDOW> {
        // Each timestamp stays in its seat; the two are one row.
        let mut window = Window { len: 0, entries: self.entries, ..Window::<1, WINDOW>::new() };
        let mut empty = WINDOW;
        for i in (0..WINDOW).rev() {
            if OPEN >> i & 1 == 0 {
                empty -= 1;
                window.seats[empty] = i as u16;
            }
        }
        for i in 0..WINDOW {
            if OPEN >> i & 1 == 1 {
                window.timestamps[window.len] = TIMESTAMPS[i];
                window.seats[window.len] = i as u16;
                window.turns[i] = turn_of(earliest(&self.entries[i]), TIMESTAMPS[i]);
                window.first = earlier(window.first, window.turns[i]);
                window.len += 1;
            }
        }
        window.firsts[0] = window.first;
        let gate = Gate { limit: 2, resume: 1, shut: self.is_shut };
        Fusion {
            commit: self.commit,
            window: WINDOW,
            clouds: Clouds { priorities: [CLOUD], gates: [gate], len: 1 },
            now: self.now,
            newest: Some(newest),
            open: window,
        }
    }

    /// Whether every timestamp but one is as it was.
    fn is_as(&self, before: &Self, but: usize) -> bool {
        (0..WINDOW).filter(|i| *i != but).all(|i| {
            let (a, b) = (&self.entries[i], &before.entries[i]);
            self.open[i] == before.open[i]
                && a.slot == b.slot
                && a.local_due == b.local_due
                && a.dues[0] == b.dues[0]
        })
    }
}

/// Whether a timestamp is open, by looking at each.
fn is_open<const WINDOW: usize>(fusion: &Fusion<1, WINDOW>, timestamp: Timestamp) -> bool {
    (0..WINDOW).any(|i| i < fusion.open.len && fusion.open.timestamps[i] == timestamp)
}

/// A machine just made, at any instant, with the first timestamp opened.
#[inline(never)]
fn start<const WINDOW: usize>() -> Option<(Known<WINDOW>, Seen)> {
    let fusion = Fusion::new(WINDOW, any_commit(), &[Cloud::new(CLOUD, 2)]);
    // F2g: the limit is 1 or more, and the window is the capacity.
    let mut fusion = fusion.unwrap_or_else(|_| unreachable!("the configuration is sound"));
    kani::assert(fusion.is_empty() && fusion.next_due().is_none(), "P9: nothing is open at first");
    let _ = told::at(&mut fusion, any_instant());
    let seen = opens(&mut fusion, TIMESTAMPS[0])?;
    Some((Known::of(&fusion, TIMESTAMPS[0]), seen))
}

/// F1, P9: the second timestamp is opened too, and no third.
#[inline(never)]
fn second(known: &Known<2>) -> Option<(Known<2>, Seen)> {
    let mut fusion = known.machine::<1>(TIMESTAMPS[0]);
    let seen = opens(&mut fusion, TIMESTAMPS[1])?;
    let after = Known::of(&fusion, TIMESTAMPS[1]);
    kani::assert(after.is_as(known, 1), "P9: only its own timestamp changes");
    Some((after, seen))
}

/// P9: no third timestamp is opened.
#[inline(never)]
fn third(known: &Known<2>) -> Opening {
    let mut fusion = known.machine::<3>(TIMESTAMPS[1]);
    let opening = told::open(&mut fusion, any_timestamp(), None);
    let is_refused = matches!(opening, Opening::Refused(OpenRefusal::Full | OpenRefusal::Order));
    kani::assert(is_refused && fusion.len() == 2, "P9: at most the window is open");
    opening
}

/// F1: opens the timestamp.
fn opens<const WINDOW: usize>(
    fusion: &mut Fusion<1, WINDOW>,
    timestamp: Timestamp,
) -> Option<Seen> {
    let deadline = if kani::any() { Some(any_deadline()) } else { None };
    let due = deadline.map(|deadline| fusion.now.saturating_add(deadline));
    let is_past = due.is_some_and(|due| due <= fusion.now);
    if told::open(fusion, timestamp, deadline) != Opening::Accepted {
        kani::assert(is_past, "F1: it opens unless its deadline is past");
        return None;
    }
    kani::assert(!is_past, "F1: it opens only before its deadline");
    Some(Seen { dues: [due, None], held: [false; 2], ends: 0 })
}

/// Counts an end: what goes is in hand, and the best.
fn ended(seen: &mut Seen, outcome: Outcome<1>, came: Option<Priority>) {
    if let Outcome::Forwarded { by, .. } = outcome {
        let is_held = if by == CLOUD { seen.held[1] } else { seen.held[0] };
        kani::assert(is_held || came == Some(by), "P3 best in hand: it is in hand");
        kani::assert(by == CLOUD || !seen.held[1], "P3 best in hand: nothing in hand outranks it");
        seen.ends += 1;
    }
    if outcome == Outcome::Missed {
        kani::assert(seen.held == [false; 2], "P5 local floor: what is in hand is not missed");
        seen.ends += 1;
    }
    kani::assert(seen.ends <= 1, "P1 once: it is forwarded or missed once");
}

/// F3: a result of either source.
fn result<const WINDOW: usize>(
    fusion: &mut Fusion<1, WINDOW>,
    timestamp: Timestamp,
    seen: &mut Seen,
) {
    let is_cloud: bool = kani::any();
    let priority = if is_cloud { CLOUD } else { Priority::LOCAL };
    let due = if is_cloud { seen.dues[1] } else { seen.dues[0] };
    let outcome = told::result(fusion, timestamp, priority);
    let is_accepted = matches!(outcome, Outcome::Forwarded { .. } | Outcome::Held);
    let in_time = due.is_none_or(|due| fusion.now < due);
    kani::assert(!is_accepted || in_time, "P2 never late: it came before its due instant");
    kani::assert(!is_accepted || !is_cloud || due.is_some(), "F3: it was asked for");
    let is_gone = outcome == Outcome::Dropped(DropReason::Superseded);
    kani::assert(is_gone == (seen.ends == 1), "F3: it is superseded exactly after the end");
    let alone = !is_cloud && seen.dues[1].is_none() && seen.ends == 0 && outcome != Outcome::Held;
    ended(seen, outcome, Some(priority));
    // A deadline that fired leaves nothing to wait for without a request.
    kani::assert(!alone || seen.ends == 1, "P6 free without cloud: it goes the moment it arrives");
    if outcome == Outcome::Held {
        seen.held[usize::from(is_cloud)] = true;
    }
}

/// F4: a failure of either source.
fn fail<const WINDOW: usize>(
    fusion: &mut Fusion<1, WINDOW>,
    timestamp: Timestamp,
    seen: &mut Seen,
) {
    let priority = if kani::any() { CLOUD } else { Priority::LOCAL };
    let outcome = told::fail(fusion, timestamp, priority);
    kani::assert(outcome != Outcome::Held, "F4: a failure is not held");
    ended(seen, outcome, None);
}

/// F2: an offer of the cloud.
fn offer<const WINDOW: usize>(
    fusion: &mut Fusion<1, WINDOW>,
    timestamp: Timestamp,
    seen: &mut Seen,
) {
    let admission = told::offer(fusion, timestamp, CLOUD, any_deadline(), kani::any());
    if let Admission::Admitted { due } = admission {
        let is_first = seen.ends == 0 && seen.dues[1].is_none();
        kani::assert(is_first && due > fusion.now, "P8 timers: it is asked once, while open");
        seen.dues[1] = Some(due);
    }
}

/// F0, F5: one firing at most, and whether there was one.
#[inline(never)]
fn fires(known: &Known<1>, seen: &mut Seen, now: Instant) -> (Known<1>, bool) {
    let mut fusion = known.machine::<1>(TIMESTAMPS[0]);
    let At::Fired(firing) = told::at(&mut fusion, now) else {
        return (Known::of(&fusion, TIMESTAMPS[0]), false);
    };
    let (timestamp, due, outcome) = (firing.timestamp, firing.due, firing.outcome);
    kani::assert(due <= fusion.now, "F5: no timer fires before its due instant");
    kani::assert(timestamp == TIMESTAMPS[0], "F5: it is of what is open");
    ended(seen, outcome, None);
    (Known::of(&fusion, TIMESTAMPS[0]), true)
}

/// Any input for a timestamp, open or not.
#[inline(never)]
fn input<const WINDOW: usize, const OPEN: u8, const OF: usize>(
    known: &Known<WINDOW>,
    seen: &mut [Seen; WINDOW],
) -> Known<WINDOW> {
    let next = known.next::<OPEN>();
    kani::assert(next.is_none_or(|due| due > known.now), "F0: then nothing is due");
    let mut fusion = known.machine::<OPEN>(TIMESTAMPS[WINDOW - 1]);
    match kani::any_where(|kind: &u8| *kind < 3) {
        0 => offer(&mut fusion, TIMESTAMPS[OF], &mut seen[OF]),
        1 => result(&mut fusion, TIMESTAMPS[OF], &mut seen[OF]),
        _ => fail(&mut fusion, TIMESTAMPS[OF], &mut seen[OF]),
    }
    let after = Known::of(&fusion, TIMESTAMPS[WINDOW - 1]);
    kani::assert(after.is_as(known, OF), "P9: only its own timestamp changes");
    after
}

/// How many inputs come after the first, which opens.
const INPUTS: usize = 3;

/// P1, P2, P3, P5, P6, P9, F0, F5: open, and any inputs at any instants: one end at most, of what is in hand, in time.
///
/// Bounds: window of 1, 1 cloud, 4 inputs, a fixed timestamp.
#[kani::proof]
#[kani::unwind(4)]
pub fn p1_once_from_the_empty_machine() {
    let Some((mut known, seen)) = start::<1>() else { return };
    let mut seen = [seen];
    for _ in 0..INPUTS {
        let now = any_instant();
        // There are two timers at most.
        for _ in 0..2 {
            let mut fired = false;
            if known.open[0] {
                (known, fired) = fires(&known, &mut seen[0], now);
            }
            if !fired {
                break;
            }
        }
        known = if known.open[0] {
            input::<1, 1, 0>(&known, &mut seen)
        } else {
            input::<1, 0, 0>(&known, &mut seen)
        };
    }
    let [seen] = seen;
    kani::assert(known.open[0] == (seen.ends == 0), "P1 once: it is open until it ends");
    let asked = seen.dues[1].is_some();
    kani::cover!(asked && seen.held[0] && known.open[0], "local's result is held");
    kani::cover!(asked && seen.held[0] && !known.open[0], "it is retired with it");
}

/// P9, P1, F1, F2: two timestamps open at once, and inputs for either: the other stays as it is, and no third opens.
///
/// Cases: 4.
/// Bounds: window of 2, 1 cloud, 5 inputs at one instant, fixed timestamps.
#[kani::proof]
#[kani::unwind(5)]
pub fn p9_two_from_the_empty_machine() {
    let case = any_case(4);
    let Some((known, first)) = start() else { return };
    let Some((known, next)) = second(&known) else { return };
    let opening = third(&known);
    let mut seen = [first, next];
    let known = match case {
        0 => then::<0>(&input::<2, 3, 0>(&known, &mut seen), &mut seen),
        1 => then::<1>(&input::<2, 3, 0>(&known, &mut seen), &mut seen),
        2 => then::<0>(&input::<2, 3, 1>(&known, &mut seen), &mut seen),
        _ => then::<1>(&input::<2, 3, 1>(&known, &mut seen), &mut seen),
    };
    for i in 0..2 {
        kani::assert(known.open[i] == (seen[i].ends == 0), "P1 once: it is open until it ends");
    }
    kani::cover!(opening == Opening::Refused(OpenRefusal::Full), "it is full");
    kani::cover!(known.open == [true; 2] && seen[0].held[0], "both stay open");
    kani::cover!(known.open == [false, true] && seen[0].dues[1].is_some(), "one is retired");
    kani::cover!(known.open == [false; 2], "both are retired");
}

/// An input for one of the two, of which one at least is open.
fn then<const OF: usize>(known: &Known<2>, seen: &mut [Seen; 2]) -> Known<2> {
    match known.which() {
        3 => input::<2, 3, OF>(known, seen),
        2 => input::<2, 2, OF>(known, seen),
        _ => input::<2, 1, OF>(known, seen),
    }
}
