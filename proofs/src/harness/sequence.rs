//! Short runs from the empty machine: what the steps from any state promise, seen once more from the start.

use crate::any::{any_commit, any_deadline, any_instant, any_timestamp, earliest};
use crate::clouds::{Cloud, Clouds};
use crate::fusion::{At, Fusion};
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::Commit;
use crate::time::{Instant, Timestamp};
use crate::told;
use crate::window::{Entry, NIL, Node, Place, Window};
use crate::{Admission, DropReason, Opening, Outcome};

/// The one cloud. What a set of sources does is proved for all 15 in `slot`.
const CLOUD: Priority = Priority::new(7);

/// The timestamps: fixed, so that where one lies is known.
const FIRST: Timestamp = Timestamp::new(5);
const SECOND: Timestamp = Timestamp::new(u64::MAX);

/// How many inputs come after the first, which opens.
const INPUTS: usize = 4;

/// One timestamp's life as seen from outside.
struct Seen {
    timestamp: Timestamp,
    /// The due instants of the limit and of the request, if there are.
    dues: [Option<Instant>; 2],
    /// Whether local's and the cloud's result were held.
    held: [bool; 2],
    /// How often it was forwarded or missed.
    ends: u8,
}

/// A machine just made.
fn made<const WINDOW: usize>() -> Fusion<1, WINDOW> {
    let fusion = Fusion::new(WINDOW, any_commit(), &[Cloud::new(CLOUD, 2)]);
    // F2g: the limit is 1 or more, and the window is the capacity.
    fusion.unwrap_or_else(|_| unreachable!("the configuration is sound"))
}

/// F1: opens the timestamp after what is due by then.
fn opens<const WINDOW: usize>(
    fusion: &mut Fusion<1, WINDOW>,
    timestamp: Timestamp,
) -> Option<Seen> {
    let limit = if kani::any() { Some(any_deadline()) } else { None };
    let due = limit.map(|limit| fusion.now.saturating_add(limit));
    let is_past = due.is_some_and(|due| due <= fusion.now);
    let opening = told::open(fusion, timestamp, limit);
    kani::assert(
        (opening == Opening::Accepted) != is_past,
        "F1: it opens unless its limit is past",
    );
    if is_past {
        return None;
    }
    Some(Seen { timestamp, dues: [due, None], held: [false; 2], ends: 0 })
}

/// F0, F5: fires what is due by then.
fn pass<const WINDOW: usize>(fusion: &mut Fusion<1, WINDOW>, seen: &mut Seen, now: Instant) {
    // There are two timers at most.
    for _ in 0..2 {
        let At::Fired(firing) = told::at(fusion, now) else { break };
        let (due, outcome) = (firing.due, firing.outcome);
        kani::assert(due <= fusion.now, "F5: no timer fires before its due instant");
        ended(seen, outcome, None);
    }
    let next = fusion.next_due();
    kani::assert(next.is_none_or(|due| due > fusion.now), "F0: then nothing is due");
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
fn result<const WINDOW: usize>(fusion: &mut Fusion<1, WINDOW>, seen: &mut Seen) {
    let is_cloud: bool = kani::any();
    let priority = if is_cloud { CLOUD } else { Priority::LOCAL };
    let due = if is_cloud { seen.dues[1] } else { seen.dues[0] };
    let outcome = told::result(fusion, seen.timestamp, priority);
    let is_accepted = matches!(outcome, Outcome::Forwarded { .. } | Outcome::Held);
    let in_time = due.is_none_or(|due| fusion.now < due);
    kani::assert(!is_accepted || in_time, "P2 never late: it came before its due instant");
    kani::assert(!is_accepted || !is_cloud || due.is_some(), "F3: it was asked for");
    let is_gone = outcome == Outcome::Dropped(DropReason::Superseded);
    kani::assert(is_gone == (seen.ends == 1), "F3: it is superseded exactly after the end");
    let alone = !is_cloud && seen.dues[1].is_none() && seen.ends == 0 && outcome != Outcome::Held;
    ended(seen, outcome, Some(priority));
    // A limit that fired leaves nothing to wait for without a request.
    kani::assert(!alone || seen.ends == 1, "P6 free without cloud: it goes the moment it arrives");
    if outcome == Outcome::Held {
        seen.held[usize::from(is_cloud)] = true;
    }
}

/// F4: a failure of either source.
fn fail<const WINDOW: usize>(fusion: &mut Fusion<1, WINDOW>, seen: &mut Seen) {
    let priority = if kani::any() { CLOUD } else { Priority::LOCAL };
    let outcome = told::fail(fusion, seen.timestamp, priority);
    kani::assert(outcome != Outcome::Held, "F4: a failure is not held");
    ended(seen, outcome, None);
}

/// F2: an offer of the cloud.
fn offer<const WINDOW: usize>(fusion: &mut Fusion<1, WINDOW>, seen: &mut Seen) {
    let admission = told::offer(fusion, seen.timestamp, CLOUD, any_deadline(), kani::any());
    if let Admission::Admitted { due } = admission {
        let is_first = seen.ends == 0 && seen.dues[1].is_none();
        kani::assert(is_first && due > fusion.now, "P8 timers: it is asked once, while open");
        seen.dues[1] = Some(due);
    }
}

/// What the first timestamp's machine knows between two steps. All else in it is known: so the machine of each step is put
/// together of this and constants, and what the step leaves is shown to be of that form again.
#[derive(Clone, Copy)]
struct Known {
    is_open: bool,
    commit: Commit,
    now: Instant,
    is_shut: bool,
    entry: Entry<1>,
}

impl Known {
    fn of(fusion: &Fusion<1, 1>) -> Self {
        let known = Self {
            is_open: fusion.len() == 1,
            commit: fusion.commit,
            now: fusion.now,
            is_shut: fusion.clouds.gates[0].is_shut(),
            entry: fusion.open.entries[0],
        };
        let is_all = if known.is_open {
            is_same(fusion, &known.machine(true))
        } else {
            is_same(fusion, &known.machine(false))
        };
        kani::assert(is_all, "P9: the window is a tree of one or none");
        known
    }

    fn machine(&self, is_open: bool) -> Fusion<1, 1> {
        let gate = Gate { limit: 2, resume: 1, shut: self.is_shut };
        let mut open = Window { entries: [self.entry], ..Window::new() };
        if is_open {
            let due = earliest(&self.entry);
            let node = Node { timestamp: FIRST, due, below: due, height: 1, ..Node::NIL };
            (open.nodes, open.len) = ([node], 1);
            (open.root, open.last, open.free) = (Place(0), Place(0), NIL);
        }
        Fusion {
            commit: self.commit,
            window: 1,
            clouds: Clouds { priorities: [CLOUD], gates: [gate], len: 1 },
            now: self.now,
            newest: Some(FIRST),
            open,
        }
    }
}

/// Whether the machines are the same but for commit rule, clock and entries.
fn is_same(a: &Fusion<1, 1>, b: &Fusion<1, 1>) -> bool {
    let (of_a, of_b) = (&a.open.nodes[0], &b.open.nodes[0]);
    a.window == b.window
        && a.clouds.priorities[0] == b.clouds.priorities[0]
        && a.clouds.gates[0] == b.clouds.gates[0]
        && a.clouds.len == b.clouds.len
        && a.newest == b.newest
        && a.open.root == b.open.root
        && a.open.last == b.open.last
        && a.open.free == b.open.free
        && a.open.len == b.open.len
        && of_a.timestamp == of_b.timestamp
        && of_a.due == of_b.due
        && of_a.below == of_b.below
        && of_a.left == of_b.left
        && of_a.right == of_b.right
        && of_a.up == of_b.up
        && of_a.height == of_b.height
}

/// F0, F5: one firing at most of the open timestamp, and whether there was one.
fn fires(known: Known, seen: &mut Seen, now: Instant) -> (Known, bool) {
    let mut fusion = known.machine(true);
    let At::Fired(firing) = told::at(&mut fusion, now) else { return (Known::of(&fusion), false) };
    let (due, outcome) = (firing.due, firing.outcome);
    kani::assert(due <= fusion.now, "F5: no timer fires before its due instant");
    ended(seen, outcome, None);
    (Known::of(&fusion), true)
}

/// Any input for the timestamp, open or not.
fn input(known: Known, seen: &mut Seen, is_open: bool) -> Known {
    let mut fusion = known.machine(is_open);
    let next = fusion.next_due();
    kani::assert(next.is_none_or(|due| due > fusion.now), "F0: then nothing is due");
    match kani::any_where(|kind: &u8| *kind < 3) {
        0 => offer(&mut fusion, seen),
        1 => result(&mut fusion, seen),
        _ => fail(&mut fusion, seen),
    }
    Known::of(&fusion)
}

/// Any instant, what is due by then, and any input.
fn inputs(mut known: Known, seen: &mut Seen) -> Known {
    let now = any_instant();
    // There are two timers at most.
    for _ in 0..2 {
        if known.is_open {
            let fired;
            (known, fired) = fires(known, seen, now);
            if !fired {
                break;
            }
        }
    }
    if known.is_open { input(known, seen, true) } else { input(known, seen, false) }
}

/// P1, P2, P3, P5, P6, F0, F5: open, and inputs of either source at any instants: one end at most, of what is in
/// hand, in time.
///
/// Bounds: window of 1, 1 cloud, 3 inputs, a fixed timestamp.
#[kani::proof]
#[kani::unwind(6)]
pub fn p1_once_from_the_empty_machine() {
    let mut fusion = made::<1>();
    kani::assert(fusion.is_empty() && fusion.next_due().is_none(), "P9: nothing is open at first");
    let _ = told::at(&mut fusion, any_instant());
    let Some(mut seen) = opens(&mut fusion, FIRST) else { return };
    let mut known = Known::of(&fusion);
    for _ in 0..INPUTS {
        known = inputs(known, &mut seen);
    }
    kani::assert(known.is_open == (seen.ends == 0), "P1 once: it is open until it ends");
    let asked = seen.dues[1].is_some();
    kani::cover!(asked && seen.held[0], "local's result is held");
    kani::cover!(asked && !known.is_open, "it is retired");
}

/// P9, P1, F1, F2: two timestamps open at once, and an input for the first: the second stays as it is, and no third opens.
///
/// Bounds: window of 2, 1 cloud, 5 inputs at one instant, fixed timestamps.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_two_from_the_empty_machine() {
    let mut fusion = made::<2>();
    let _ = told::at(&mut fusion, any_instant());
    let Some(mut seen) = opens(&mut fusion, FIRST) else { return };
    let opening = told::open(&mut fusion, SECOND, None);
    kani::assert(opening == Opening::Accepted, "F1: there is room for two");
    offer(&mut fusion, &mut seen);
    let third = told::open(&mut fusion, any_timestamp(), None);
    kani::assert(third != Opening::Accepted, "P9: at most the window is open");
    let before = fusion.slot(SECOND);
    result(&mut fusion, &mut seen);
    kani::assert(fusion.slot(SECOND) == before, "P9: only its own timestamp changes");
    let is_open = fusion.slot(FIRST).is_some();
    kani::assert(is_open == (seen.ends == 0), "P1 once: it is open until it ends");
    kani::assert(fusion.len() == 1 + usize::from(is_open), "P9: as many are open as were left");
    kani::cover!(is_open && seen.held[0], "local's result is held");
    kani::cover!(!is_open && seen.dues[1].is_some(), "it is retired");
}
