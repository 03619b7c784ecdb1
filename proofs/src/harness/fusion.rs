//! The machine around one timestamp: any clock, any due instants, any gates, a window of one.
//!
//! What the façade adds to the step of one timestamp is the same code for every window; `window` shows that the window of
//! open timestamps finds, changes and retires the one that is meant.

use crate::any::{
    any_deadline, any_empty, any_instant, any_single, any_timestamp, earliest, window_of_one,
};
use crate::entry::Entry;
use crate::fusion::{At, Fusion};
use crate::priority::Priority;
use crate::slot::{Cause, Decision, Slot};
use crate::source::Source;
use crate::time::{Deadline, Instant};
use crate::told;
use crate::valid::{is_limited, is_valid, is_window, same_turn};
use crate::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};

/// The clouds of most harnesses. What a set of sources does is proved for all 15 in `slot`.
const CLOUDS: usize = 8;

type Single<const CLOUDS: usize> = Fusion<CLOUDS, 1>;

/// Between two inputs, and between two firings.
fn holds<const CLOUDS: usize>(fusion: &Single<CLOUDS>) -> bool {
    let open = &fusion.open;
    let reached = fusion.newest.is_some_and(|newest| newest >= open.timestamps[0]);
    let slot = open.entries[0].slot;
    is_window(open) && (open.len == 0 || reached && is_valid(fusion.commit, slot))
}

/// The later of two instants.
fn later(a: Instant, b: Instant) -> Instant {
    if a < b { b } else { a }
}

/// The armed timers that are due exactly then, by looking at each.
fn due_at<const CLOUDS: usize>(entry: &Entry<CLOUDS>, due: Instant) -> u16 {
    let armed = entry.slot.armed().bits();
    let mut fired = armed & u16::from(entry.local_due == due);
    for (i, of_cloud) in entry.dues.iter().enumerate() {
        fired |= armed & u16::from(*of_cloud == due) << (i + 1);
    }
    fired
}

/// The source that a cloud's priority names, by looking at each.
fn source_of<const CLOUDS: usize>(fusion: &Single<CLOUDS>, priority: Priority) -> Option<Source> {
    let place = fusion.clouds.priorities.iter().position(|known| *known == priority);
    match place {
        _ if priority == Priority::LOCAL => Some(Source::LOCAL),
        Some(place) => Source::new(place as u8 + 1),
        None => None,
    }
}

/// The input is given where nothing is due: `f5_expire_by_the_rule` shows that `at` says so only then.
fn at_rest<const CLOUDS: usize>() -> Single<CLOUDS> {
    let fusion = any_single::<CLOUDS>();
    kani::assume(fusion.next_due().is_none_or(|due| due > fusion.now));
    fusion
}

/// Whether an outcome is what the step of the timestamp decided.
fn tells<const CLOUDS: usize>(
    fusion: &Single<CLOUDS>,
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

/// F0, F5, A1, A2, A21, A22: the clock never goes back. If a timer is due by then, the due instant itself included, all of
/// the earliest instant fire together; else the machine takes inputs and nothing changed.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn f5_expire_by_the_rule() {
    let mut fusion = any_single::<CLOUDS>();
    let (clock, now) = (fusion.now, any_instant());
    let entry = fusion.open.entries[0];
    let timestamp = fusion.open.timestamps[0];
    let due = earliest(&entry);
    let is_due = due.is_some_and(|due| due <= later(clock, now));
    let fired = match told::at(&mut fusion, now) {
        At::Fired(firing) => Some((firing.timestamp, firing.due, firing.timers.sources().bits())),
        At::Ready(_) => None,
    };
    kani::assert(fusion.now == later(clock, now), "F0: the clock never goes back");
    kani::assert(fired.is_some() == is_due, "F5: timers fire exactly if one is due");
    if let Some((of, then, timers)) = fired {
        kani::assert(of == timestamp && Some(then) == due, "F5: the earliest due instant");
        kani::assert(timers == due_at(&entry, then), "A22: all of that instant, no others");
    } else {
        let same = fusion.open.entries[0].slot == entry.slot;
        kani::assert(same && !fusion.is_empty(), "F0: nothing else changes");
    }
    kani::cover!(fired.is_some() && due == Some(later(clock, now)), "it is due just now");
    kani::cover!(fired.is_none() && due.is_some() && now < clock, "the clock was further already");
}

/// F5, F6, F7: what a firing decides is what the step of its timestamp decides, and the machine stays valid.
///
/// Bounds: window of 1, 4 clouds.
#[kani::proof]
#[kani::unwind(7)]
pub fn f5_firing_is_settled() {
    let mut fusion = any_single::<4>();
    let entry = fusion.open.entries[0];
    let mut is_retired = false;
    let mut waits = false;
    if let At::Fired(Firing { timers, outcome, .. }) = told::at(&mut fusion, any_instant()) {
        let (slot, decision) = entry.slot.step(fusion.commit, Cause::Timers(timers.sources()));
        kani::assert(tells(&fusion, outcome, decision), "F6: what follows is told");
        is_retired = !slot.is_open();
        kani::assert(fusion.is_empty() == is_retired, "F7: what is retired is open no more");
        let same = is_retired || fusion.open.entries[0].slot == slot;
        kani::assert(same, "F5: the timestamp is as the step leaves it");
        waits = !is_retired;
    }
    kani::assert(holds(&fusion), "F5: the machine stays valid");
    kani::cover!(is_retired, "a firing retires the timestamp");
    kani::cover!(waits, "it waits on");
}

/// F1, A11, A14, A25, A31: an open is refused for the first reason that holds and then changes nothing; else the timestamp is
/// open, waits for local, and its deadline is armed if it has one.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn f1_open_by_the_rule() {
    let mut fusion = if kani::any() { at_rest() } else { any_empty::<CLOUDS, 1>() };
    let before = fusion.clone();
    let timestamp = any_timestamp();
    let deadline = if kani::any() { Some(any_deadline()) } else { None };
    let opening = told::open(&mut fusion, timestamp, deadline);
    let due = deadline.map(|deadline| before.now.saturating_add(deadline));
    let expected = if before.newest.is_some_and(|newest| newest >= timestamp) {
        Opening::Refused(OpenRefusal::Order)
    } else if before.len() == 1 {
        Opening::Refused(OpenRefusal::Full)
    } else if due.is_some_and(|due| due <= before.now) {
        Opening::Refused(OpenRefusal::Deadline)
    } else {
        Opening::Accepted
    };
    kani::assert(opening == expected, "F1: the first reason that holds, or none");
    kani::assert(holds(&fusion) && fusion.len() <= 1, "P9: at most the window is open");
    kani::assert(fusion.now == before.now, "F0: the clock stays");
    if opening == Opening::Accepted {
        let entry = &fusion.open.entries[0];
        let is_open = fusion.open.timestamps[0] == timestamp && fusion.len() == 1;
        kani::assert(is_open && entry.slot == Slot::open(deadline.is_some()), "F1: it is open");
        kani::assert(fusion.newest == Some(timestamp), "F1: it is the greatest ever opened");
        kani::assert(fusion.next_due() == due, "P8: its deadline is armed, nothing else");
        kani::assert(due.is_none_or(|due| due > fusion.now), "A20: nothing is due at once");
    } else {
        let same = fusion.newest == before.newest
            && fusion.len() == before.len()
            && fusion.open.entries[0].slot == before.open.entries[0].slot
            && fusion.next_due() == before.next_due();
        kani::assert(same, "F1: a refused open changes nothing");
    }
    kani::cover!(opening == Opening::Refused(OpenRefusal::Full), "the window is full");
    kani::cover!(opening == Opening::Refused(OpenRefusal::Deadline), "the deadline is zero");
    kani::cover!(
        opening == Opening::Accepted && due == Some(Instant::END),
        "the deadline saturates"
    );
    kani::cover!(
        timestamp.as_u64() == u64::MAX && opening == Opening::Accepted,
        "the last timestamp"
    );
}

/// F2, F2g, A11, A19, A20: an offer is refused for the first reason that holds; the gate is asked only then. Admitted, its
/// timer is armed, due after now, and no other due instant changes.
///
/// Bounds: window of 1, 4 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn f2_offer_and_its_due() {
    let mut fusion = at_rest::<4>();
    let (timestamp, cloud) = (any_timestamp(), Priority::new(kani::any()));
    let (deadline, backlog): (Deadline, u64) = (any_deadline(), kani::any());
    let before = fusion.clone();
    let entry = before.open.entries[0];
    let admission = told::offer(&mut fusion, timestamp, cloud, deadline, backlog);
    let due = before.now.saturating_add(deadline);
    let source = source_of(&before, cloud).unwrap_or(Source::LOCAL);
    let reached = before.newest.is_some_and(|newest| newest >= timestamp);
    let (admitted, refusal) = entry.slot.offer(source);
    let mut asked = false;
    let mut expected = Admission::Admitted { due };
    if source == Source::LOCAL || !reached {
        expected = Admission::Refused(OfferRefusal::Unknown);
    } else if timestamp != before.open.timestamps[0] {
        expected = Admission::Refused(OfferRefusal::Closed);
    } else if let Some(reason) = refusal {
        expected = Admission::Refused(reason);
    } else if due <= before.now {
        expected = Admission::Refused(OfferRefusal::Deadline);
    } else {
        asked = true;
    }
    for i in 0..4 {
        let mut gate = before.clouds.gates[i];
        if asked && usize::from(source.index()) == i + 1 && !gate.admits(backlog) {
            expected = Admission::Refused(OfferRefusal::Queue);
        }
        let same = fusion.clouds.gates[i].is_shut() == gate.is_shut();
        kani::assert(same, "F2g: the gate that is asked moves, and no other");
    }
    kani::assert(admission == expected, "F2: the first reason that holds, or none");
    kani::assert(holds(&fusion) && fusion.len() == 1, "F2: the machine stays valid");
    let is_admitted = matches!(expected, Admission::Admitted { .. });
    let after = &fusion.open.entries[0];
    let slot = if is_admitted { admitted } else { entry.slot };
    kani::assert(after.slot == slot, "F2: it joins, or nothing changes");
    for i in 0..4 {
        let own = is_admitted && usize::from(source.index()) == i + 1;
        let expected = if own { due } else { entry.dues[i] };
        kani::assert(after.dues[i] == expected, "P8: its own timer is armed, no other");
    }
    kani::assert(after.local_due == entry.local_due, "P8: the deadline is as it was");
    kani::assert(fusion.now == before.now && fusion.newest == before.newest, "F0: the clock stays");
    kani::cover!(is_admitted && due == Instant::END, "its due instant saturates");
    kani::cover!(admission == Admission::Refused(OfferRefusal::Queue), "its gate is shut");
    kani::cover!(
        admission == Admission::Refused(OfferRefusal::Closed),
        "its timestamp is not open"
    );
    kani::cover!(is_admitted && !entry.slot.cached().is_empty(), "it outranks what is held");
}

/// What a result or a failure does: `Cause` as the step takes it.
fn arrival<const CLOUDS: usize>(cause: fn(Source) -> Cause, is_result: bool) -> Outcome<CLOUDS> {
    let mut fusion = at_rest::<CLOUDS>();
    let (now, newest) = (fusion.now, fusion.newest);
    let (entry, open) = (fusion.open.entries[0], fusion.open.timestamps[0]);
    let (timestamp, priority) = (any_timestamp(), Priority::new(kani::any()));
    let outcome = if is_result {
        told::result(&mut fusion, timestamp, priority)
    } else {
        told::fail(&mut fusion, timestamp, priority)
    };
    let reached = newest.is_some_and(|newest| newest >= timestamp);
    let source = source_of(&fusion, priority).filter(|_| reached);
    let (slot, decision) = match source {
        None => (entry.slot, Decision::Dropped(DropReason::Unknown)),
        Some(_) if timestamp != open => (entry.slot, Decision::Dropped(DropReason::Superseded)),
        Some(source) => entry.slot.step(fusion.commit, cause(source)),
    };
    kani::assert(tells(&fusion, outcome, decision), "P11: the outcome is that of the rule");
    let is_retired = matches!(decision, Decision::Forwarded { .. } | Decision::Missed);
    kani::assert(
        fusion.is_empty() == is_retired,
        "P1: it is retired when it is forwarded or missed",
    );
    let after = &fusion.open.entries[0];
    let same = is_retired || after.slot == slot;
    kani::assert(same, "F3: the timestamp is as the step leaves it");
    kani::assert(fusion.now == now && fusion.newest == newest, "F0: the clock stays");
    // P2: what has a timer comes before its due instant, or is dropped.
    if let (Outcome::Forwarded { .. } | Outcome::Held, Some(source), true) =
        (outcome, source, is_result)
    {
        for i in 0..CLOUDS {
            let own = usize::from(source.index()) == i + 1;
            kani::assert(!own || now < entry.dues[i], "P2 never late: it comes before its due");
        }
        let limited = entry.slot.armed().contains(Source::LOCAL) && source == Source::LOCAL;
        kani::assert(!limited || now < entry.local_due, "P2 never late: local within its deadline");
    }
    outcome
}

/// F3, P2, P11, A13, A16, A18: a result has the outcome of the rule, for any timestamp and priority, and what is held or
/// forwarded came before its due instant.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn p2_never_late_by_the_clock() {
    let outcome = arrival::<CLOUDS>(Cause::Result, true);
    kani::cover!(matches!(outcome, Outcome::Forwarded { .. }), "it is forwarded");
    kani::cover!(matches!(outcome, Outcome::Held), "it is held");
    kani::cover!(matches!(outcome, Outcome::Dropped(DropReason::Unknown)), "it is unknown");
    kani::cover!(matches!(outcome, Outcome::Dropped(DropReason::Superseded)), "it is superseded");
}

/// F4, P11: a failure has the outcome of the rule, for any timestamp and priority.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn f4_fail_has_its_outcome() {
    let outcome = arrival::<CLOUDS>(Cause::Failure, false);
    kani::cover!(matches!(outcome, Outcome::Forwarded { .. }), "the best in hand goes");
    kani::cover!(matches!(outcome, Outcome::Missed), "it leaves nothing to wait for");
    kani::cover!(matches!(outcome, Outcome::Dropped(DropReason::Unknown)), "it is unknown");
}

/// P5, P7: by the latest due instant ever armed the timestamp is retired, if it was opened with a deadline or has local's result.
///
/// The rank is the number of armed timers. Each firing lowers it or retires the timestamp, no firing arms a timer beyond the
/// latest, and when the machine takes inputs at the latest or after it, the rank is 0.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn p7_retired_by_the_latest_due() {
    let mut fusion = any_single::<CLOUDS>();
    let entry = fusion.open.entries[0];
    // The latest due instant ever armed: at least those armed now.
    let latest = any_instant();
    let armed = entry.slot.armed();
    let bounded = |entry: &Entry<CLOUDS>| {
        let armed = entry.slot.armed().bits();
        let mut bounded = armed & 1 == 0 || entry.local_due <= latest;
        for (i, due) in entry.dues.iter().enumerate() {
            bounded &= armed >> (i + 1) & 1 == 0 || *due <= latest;
        }
        bounded
    };
    kani::assume(bounded(&entry));
    let certain = is_limited(entry.slot) || entry.slot.cached().contains(Source::LOCAL);
    let mut retired = false;
    let mut ready = false;
    match told::at(&mut fusion, any_instant()) {
        At::Fired(_) => {
            retired = fusion.is_empty();
            let left = fusion.open.entries[0].slot.armed();
            let fewer = armed.contains_all(left) && left != armed;
            kani::assert(retired || fewer, "P7 no stall: each firing lowers the rank");
            let after = bounded(&fusion.open.entries[0]);
            kani::assert(retired || after, "P7 no stall: nothing is armed beyond the latest");
        }
        At::Ready(_) => {
            ready = true;
            let passed = fusion.now >= latest;
            kani::assert(!passed || armed.is_empty(), "P7 no stall: by the latest the rank is 0");
            kani::assert(!passed || !certain, "P5 local floor: by the latest it is retired");
        }
    }
    kani::cover!(retired && certain, "the last firing retires it");
    kani::cover!(ready && fusion.now >= latest, "local may take its time");
}

/// Whether every armed request is due by then. The deadline of local counts for nothing.
fn asked_by<const CLOUDS: usize>(entry: &Entry<CLOUDS>, latest: Instant) -> bool {
    let armed = entry.slot.armed().bits();
    let mut bounded = true;
    for (i, due) in entry.dues.iter().enumerate() {
        bounded &= armed >> (i + 1) & 1 == 0 || *due <= latest;
    }
    bounded
}

/// P12: once local arrived, a timestamp is retired by the latest due instant of the requests admitted for it, forwarded if
/// local's result was accepted.
///
/// The rank is the number of armed timers, as for P7: each firing lowers it or retires the timestamp, and when the machine takes
/// inputs at the latest or after it, local has not arrived.
///
/// Bounds: window of 1, 8 clouds.
#[kani::proof]
#[kani::unwind(11)]
pub fn p12_retired_by_the_last_request() {
    let mut fusion = any_single::<CLOUDS>();
    let entry = fusion.open.entries[0];
    // The latest due instant of a request ever admitted: at least those armed now.
    let latest = any_instant();
    kani::assume(asked_by(&entry, latest));
    let armed = entry.slot.armed();
    let arrived = !entry.slot.pending().contains(Source::LOCAL);
    let has = entry.slot.cached().contains(Source::LOCAL);
    let fired = match told::at(&mut fusion, any_instant()) {
        At::Fired(firing) => Some(firing.outcome),
        At::Ready(_) => None,
    };
    let after = &fusion.open.entries[0];
    if let Some(outcome) = fired {
        let left = after.slot.armed();
        let fewer = armed.contains_all(left) && left != armed && asked_by(after, latest);
        let goes = matches!(outcome, Outcome::Forwarded { .. });
        kani::assert(fusion.is_empty() || fewer, "P12 bounded wait: each firing lowers the rank");
        let kept = !fusion.is_empty() || !has || goes;
        kani::assert(kept, "P12 bounded wait: local's result is forwarded");
    } else {
        let passed = fusion.now >= latest;
        kani::assert(!passed || !arrived, "P12 bounded wait: by the latest it is retired");
    }
    kani::cover!(fired.is_some() && arrived && fusion.is_empty(), "the last request retires it");
    kani::cover!(fired.is_some() && arrived && !fusion.is_empty(), "a request is still awaited");
    kani::cover!(fired.is_none() && fusion.now >= latest, "local may take its time");
}

/// P12: local's arrival at the latest due instant of the requests admitted for it, or after it, retires a timestamp,
/// forwarded if it is a result; its deadline's firing then does as well, by `p12_bounded_wait`.
///
/// Bounds: window of 1, 2 clouds.
#[kani::proof]
#[kani::unwind(5)]
pub fn p12_retired_by_local_at_last() {
    let mut fusion = at_rest::<2>();
    let entry = fusion.open.entries[0];
    let latest = any_instant();
    kani::assume(asked_by(&entry, latest));
    let passed = fusion.now >= latest;
    let timestamp = fusion.open.timestamps[0];
    let is_result: bool = kani::any();
    let outcome = if is_result {
        told::result(&mut fusion, timestamp, Priority::LOCAL)
    } else {
        told::fail(&mut fusion, timestamp, Priority::LOCAL)
    };
    let goes = matches!(outcome, Outcome::Forwarded { .. });
    kani::assert(!passed || fusion.is_empty(), "P12 bounded wait: local's arrival retires it");
    kani::assert(!passed || !is_result || goes, "P12 bounded wait: its result is forwarded");
    kani::cover!(passed && outcome == Outcome::Missed, "local fails last, and it is missed");
    kani::cover!(!passed && outcome == Outcome::Held, "local comes first and is held");
}

/// Two firings, as far as two machines and their answers agree.
fn same_firing<const CLOUDS: usize>(a: &Firing<CLOUDS>, b: &Firing<CLOUDS>) -> bool {
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

/// P10, A2: what fires does not depend on how late the call is. Two machines that differ in their clocks alone, both called at
/// or after the earliest due instant, fire the same with the same outcome and are left alike.
///
/// So any number of firings in one late call are as many calls, each at its due instant.
///
/// Bounds: window of 1, 2 clouds.
#[kani::proof]
#[kani::unwind(5)]
pub fn p10_lateness_decides_nothing() {
    let mut late = any_single::<2>();
    let mut exact = late.clone();
    exact.now = any_instant();
    let Some(due) = late.next_due() else {
        kani::assert(late.open.entries[0].slot.armed().is_empty(), "P10: nothing is armed");
        return;
    };
    let [a, b] = [any_instant(), any_instant()].map(|now| later(now, due));
    let (At::Fired(a), At::Fired(b)) = (told::at(&mut late, a), told::at(&mut exact, b)) else {
        kani::assert(false, "P10: a call at the due instant or after it fires");
        return;
    };
    kani::assert(same_firing(&a, &b), "P10: both fire the same with the same outcome");
    kani::assert(same_open(&late, &exact), "P10: both are left alike");
    kani::cover!(late.is_empty() && late.now != exact.now, "it retires the timestamp");
    kani::cover!(!late.is_empty() && late.now != exact.now, "it waits on");
}

/// The same timestamp open with the same sets and the same due instants, or none.
fn same_open<const CLOUDS: usize>(a: &Single<CLOUDS>, b: &Single<CLOUDS>) -> bool {
    let (of_a, of_b) = (&a.open.entries[0], &b.open.entries[0]);
    let mut same = of_a.slot == of_b.slot && of_a.local_due == of_b.local_due;
    for i in 0..CLOUDS {
        same &= of_a.dues[i] == of_b.dues[i];
    }
    a.len() == b.len() && a.next_due() == b.next_due() && (a.is_empty() || same)
}

/// The machine with its timestamp open, put together anew, so that what lies where is known to the next step.
fn again<const CLOUDS: usize>(fusion: &Single<CLOUDS>) -> Single<CLOUDS> {
    let open = window_of_one(fusion.open.timestamps[0], fusion.open.entries[0]);
    let same = fusion.len() == 1
        && fusion.open.seats[0] == 0
        && same_turn(fusion.open.turns[0], open.turns[0])
        && same_turn(fusion.open.firsts[0], open.first)
        && same_turn(fusion.open.first, open.first);
    kani::assert(same, "P9: it is a window with one open");
    let (commit, window, now, newest) = (fusion.commit, 1, fusion.now, fusion.newest);
    Fusion { commit, window, clouds: fusion.clouds, now, newest, open }
}

/// P10, A2: two firings in one call are two calls with one firing each: a late call fires what a call at each due instant
/// fires, in the same order, and leaves the same state.
///
/// Bounds: window of 1, 1 cloud and the deadline.
#[kani::proof]
#[kani::unwind(3)]
pub fn p10_two_firings_are_two_calls() {
    let mut coarse = any_single::<1>();
    let mut fine = coarse.clone();
    let now = any_instant();
    let mut fired = 0;
    for _ in 0..2 {
        if fine.is_empty() {
            break;
        }
        (coarse, fine) = (again(&coarse), again(&fine));
        let due = fine.next_due().filter(|due| *due <= later(now, fine.now));
        let Some(due) = due else { break };
        let At::Fired(late) = told::at(&mut coarse, now) else {
            kani::assert(false, "P10: the late call fires it too");
            return;
        };
        let At::Fired(exact) = told::at(&mut fine, due) else {
            kani::assert(false, "P10: a call at the due instant fires it");
            return;
        };
        kani::assert(same_firing(&late, &exact), "P10: both fire the same with the same outcome");
        fired += 1;
    }
    kani::assert(same_open(&coarse, &fine), "P10: both leave the same state");
    kani::cover!(fired == 2 && coarse.is_empty(), "the second firing retires the timestamp");
    kani::cover!(fired == 1 && !coarse.is_empty(), "one fires and it waits on");
}
