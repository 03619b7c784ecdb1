//! Short runs from the empty machine: what the steps from any state promise, seen once more from the start.

use crate::any::{any_commit, any_deadline, any_instant, any_timestamp};
use crate::clouds::Cloud;
use crate::fusion::{At, Fusion};
use crate::priority::Priority;
use crate::time::{Instant, Timestamp};
use crate::told;
use crate::{Admission, DropReason, Opening, Outcome};

/// The one cloud. What a set of sources does is proved for all 15 in `slot`.
const CLOUD: Priority = Priority::new(7);

/// The timestamps: fixed, so that where one lies is known.
const FIRST: Timestamp = Timestamp::new(5);
const SECOND: Timestamp = Timestamp::new(u64::MAX);

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

/// P1, P2, P3, P5, P6, F0, F5: open, offer, and one input of either source at any instants: one end at most, of what is in
/// hand, in time.
///
/// Bounds: window of 1, 1 cloud, 3 inputs, a fixed timestamp.
#[kani::proof]
#[kani::unwind(4)]
pub fn p1_once_from_the_empty_machine() {
    let mut fusion = made::<1>();
    kani::assert(fusion.is_empty() && fusion.next_due().is_none(), "P9: nothing is open at first");
    let _ = told::at(&mut fusion, any_instant());
    let Some(mut seen) = opens(&mut fusion, FIRST) else { return };
    offer(&mut fusion, &mut seen);
    let asked = seen.dues[1].is_some();
    pass(&mut fusion, &mut seen, any_instant());
    if kani::any() {
        result(&mut fusion, &mut seen);
    } else {
        fail(&mut fusion, &mut seen);
    }
    let is_open = fusion.slot(FIRST).is_some();
    kani::assert(is_open == (seen.ends == 0), "P1 once: it is open until it ends");
    kani::cover!(asked && seen.held[0], "local's result is held");
    kani::cover!(asked && !is_open, "it is retired");
}

/// P9, P1, F1, F2: two timestamps open at once, and an input for the first: the second stays as it is, and no third opens.
///
/// Bounds: window of 2, 1 cloud, 5 inputs at one instant, fixed timestamps.
#[kani::proof]
#[kani::unwind(4)]
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
