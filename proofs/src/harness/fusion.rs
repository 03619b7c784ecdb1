//! The machine, for any number of open timestamps: shows each rule for any one of them, and that an input
//! changes no other.
//!
//! The shipped `fusion.rs` runs over the window of `src/window.rs`, which represents one timestamp, *own*,
//! exactly. Own may be any timestamp, so what holds for it holds for each.

use crate::arbitrary::{
    WINDOW, any_commit, any_deadline, any_instant, any_machine, any_priority_or_registered,
    any_timestamp_or, least, with_nothing_due,
};
use crate::clouds::Cloud;
use crate::fusion::{At, Fusion};
use crate::priority::Priority;
use crate::slot::{Cause, Decision, Slot};
use crate::source::Source;
use crate::steps;
use crate::time::{Deadline, Instant};
use crate::valid::{due_at, is_machine, is_outcome_of_decision, later, same_own, source_of};
use crate::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};

/// The greatest number of clouds.
const CLOUDS: usize = 15;

/// The clock never goes back. If a timer is due by then, even exactly then, all timers of one timestamp at
/// the earliest due instant fire together; if several timestamps have one, the least fires. Otherwise the
/// machine takes inputs. No other timestamp changes (F0, F5, A1, A2, A21, A22).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f5_expire_by_the_rule() {
    let mut fusion = any_machine::<CLOUDS>();
    let (clock, now) = (fusion.now, any_instant());
    let before = fusion.clone();
    let (own, others) = (before.open.own, before.open.others.first);
    let key = before.open.due.map(|due| (due, own));
    let is_own = key.is_some_and(|key| others.is_none_or(|first| key < first));
    let next = if is_own { key } else { others };
    let is_due = next.is_some_and(|next| next.0 <= later(clock, now));
    let fired = match steps::at(&mut fusion, now) {
        At::Fired(firing) => Some((firing.timestamp, firing.due, firing.timers.sources().bits())),
        At::Ready(_) => None,
    };
    kani::assert(fusion.now == later(clock, now), "F0: the clock never goes back");
    kani::assert(fired.is_some() == is_due, "F5: timers fire exactly if one is due");
    if let Some((of, then, timers)) = fired {
        let first = next == Some((then, of));
        kani::assert(first, "F5: the earliest due instant, of those due then the least timestamp");
        let all = !is_own || timers == due_at(&before.open.entry, then);
        kani::assert(all, "A22: all of that instant, no others");
    }
    let same = fired.is_some() && is_own || same_own(&before.open, &fusion.open);
    kani::assert(same, "F5: no other timestamp changes");
    let as_many = fired.is_some() || fusion.len() == before.len();
    kani::assert(as_many && fusion.newest == before.newest, "F0: nothing else changes");
    kani::cover!(
        fired.is_some() && is_own && others.is_some_and(|first| key < Some(first)),
        "own is first"
    );
    kani::cover!(fired.is_some() && !is_own && key.is_some(), "another is first");
    kani::cover!(fired.is_none() && next.is_some() && now < clock, "the clock was further already");
}

/// A firing has the outcome that the step of its timestamp decides, and the machine stays valid (F5, F6, F7,
/// F9).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f5_firing_is_settled() {
    let mut fusion = any_machine::<CLOUDS>();
    let (own, entry, len) = (fusion.open.own, fusion.open.entry, fusion.len());
    let mut is_retired = false;
    let mut is_final = false;
    let mut waits = false;
    if let At::Fired(Firing { timestamp, timers, outcome, .. }) =
        steps::at(&mut fusion, any_instant())
    {
        if timestamp == own {
            let (slot, decision) = entry.slot.step(fusion.commit, Cause::Timers(timers.sources()));
            kani::assert(
                is_outcome_of_decision(&fusion, outcome, decision),
                "F6: the firing's outcome is that of the step",
            );
            is_retired = !slot.is_open();
            is_final = matches!(outcome, Outcome::Final { .. });
            waits = !is_retired;
            kani::assert(fusion.open.is_open != is_retired, "F7: what is retired is open no more");
            let same = is_retired || fusion.open.entry.slot == slot;
            kani::assert(same, "F5: the timestamp is as the step leaves it");
            kani::assert(fusion.len() == len - usize::from(is_retired), "F7: it makes room");
        }
    }
    kani::assert(is_machine(&fusion), "F5: the machine stays valid");
    kani::cover!(is_retired, "a firing retires the timestamp");
    kani::cover!(is_final, "the last output is final");
    kani::cover!(waits, "it waits on");
}

/// An open is refused for the first reason that holds, and then changes nothing. Otherwise the timestamp is
/// open and waits for local, and its deadline is armed if it has one. No other timestamp changes (F1, A11,
/// A14, A25, A31).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f1_open_by_the_rule() {
    let mut fusion = with_nothing_due(any_machine::<CLOUDS>());
    let before = fusion.clone();
    let timestamp = any_timestamp_or(fusion.open.own);
    let deadline = if kani::any() { Some(any_deadline()) } else { None };
    let opening = steps::open(&mut fusion, timestamp, deadline);
    let due = deadline.map(|deadline| before.now.saturating_add(deadline));
    let expected = if before.newest.is_some_and(|newest| newest >= timestamp) {
        Opening::Refused(OpenRefusal::Order)
    } else if before.len() == before.window {
        Opening::Refused(OpenRefusal::Full)
    } else if due.is_some_and(|due| due <= before.now) {
        Opening::Refused(OpenRefusal::Deadline)
    } else {
        Opening::Accepted
    };
    let is_accepted = opening == Opening::Accepted;
    let is_own = is_accepted && timestamp == before.open.own;
    kani::assert(opening == expected, "F1: the first reason that holds, or none");
    kani::assert(is_machine(&fusion), "P9: at most the window is open");
    kani::assert(fusion.now == before.now, "F0: the clock stays");
    kani::assert(
        fusion.len() == before.len() + usize::from(is_accepted),
        "F1: it is one more, or none",
    );
    let newest = if is_accepted { Some(timestamp) } else { before.newest };
    kani::assert(fusion.newest == newest, "F1: it is the greatest ever opened");
    if is_own {
        let open = &fusion.open;
        let is_open = open.is_open && open.entry.slot == Slot::open(deadline.is_some());
        kani::assert(is_open, "F1: it is open");
        kani::assert(open.due == due, "P8: its deadline is armed, nothing else");
    } else {
        kani::assert(same_own(&before.open, &fusion.open), "F1: no other timestamp changes");
    }
    let next = if is_accepted { least(before.next_due(), due) } else { before.next_due() };
    kani::assert(fusion.next_due() == next, "P9: the next due instant is the least");
    kani::assert(next.is_none_or(|due| due > fusion.now), "A20: nothing is due at once");
    kani::cover!(opening == Opening::Refused(OpenRefusal::Full), "the window is full");
    kani::cover!(opening == Opening::Refused(OpenRefusal::Deadline), "the deadline is zero");
    kani::cover!(is_own && due == Some(Instant::END), "the deadline saturates");
    kani::cover!(is_own && timestamp.as_u64() == u64::MAX, "the last timestamp");
    kani::cover!(is_own && fusion.len() == fusion.window, "the window is full with it");
}

/// An offer is refused for the first reason that holds, and the gate decides last. If it is admitted, its
/// timer is armed and due after now. No other due instant and no other timestamp changes (F2, F2g, A11, A19,
/// A20).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f2_offer_and_its_due() {
    let mut fusion = with_nothing_due(any_machine::<CLOUDS>());
    let timestamp = any_timestamp_or(fusion.open.own);
    let cloud = any_priority_or_registered(&fusion.clouds);
    let (deadline, backlog): (Deadline, u64) = (any_deadline(), kani::any());
    let before = fusion.clone();
    let entry = before.open.entry;
    let admission = steps::offer(&mut fusion, timestamp, cloud, deadline, backlog);
    kani::assert(fusion.now == before.now && fusion.newest == before.newest, "F0: the clock stays");
    kani::assert(
        is_machine(&fusion) && fusion.len() == before.len(),
        "F2: the machine stays valid",
    );
    if timestamp != before.open.own {
        kani::assert(same_own(&before.open, &fusion.open), "F2: no other timestamp changes");
        return;
    }
    let due = before.now.saturating_add(deadline);
    let source = source_of(&before, cloud).unwrap_or(Source::LOCAL);
    let reached = before.newest.is_some_and(|newest| newest >= timestamp);
    let (admitted, refusal) = entry.slot.offer(source);
    let mut reaches_gate = false;
    let mut expected = Admission::Admitted { due };
    if source == Source::LOCAL || !reached {
        expected = Admission::Refused(OfferRefusal::Unknown);
    } else if !before.open.is_open {
        expected = Admission::Refused(OfferRefusal::Closed);
    } else if let Some(reason) = refusal {
        expected = Admission::Refused(reason);
    } else if due <= before.now {
        expected = Admission::Refused(OfferRefusal::Deadline);
    } else {
        reaches_gate = true;
    }
    for i in 0..CLOUDS {
        let mut gate = before.clouds.gates[i];
        if reaches_gate && usize::from(source.index()) == i + 1 && !gate.admits(backlog) {
            expected = Admission::Refused(OfferRefusal::Queue);
        }
        let same = fusion.clouds.gates[i].is_shut() == gate.is_shut();
        kani::assert(same, "F2g: the gate of the offer's cloud moves, and no other");
    }
    kani::assert(admission == expected, "F2: the first reason that holds, or none");
    let is_admitted = matches!(expected, Admission::Admitted { .. });
    let after = &fusion.open.entry;
    let slot = if is_admitted { admitted } else { entry.slot };
    kani::assert(after.slot == slot, "F2: it joins, or nothing changes");
    for i in 0..CLOUDS {
        let own = is_admitted && usize::from(source.index()) == i + 1;
        let expected = if own { due } else { entry.dues[i] };
        kani::assert(after.dues[i] == expected, "P8: its own timer is armed, no other");
    }
    kani::assert(after.local_due == entry.local_due, "P8: the deadline is as it was");
    kani::cover!(is_admitted && due == Instant::END, "its due instant saturates");
    kani::cover!(admission == Admission::Refused(OfferRefusal::Queue), "its gate is shut");
    kani::cover!(admission == Admission::Refused(OfferRefusal::Closed), "it is not open");
    kani::cover!(is_admitted && !entry.slot.cached().is_empty(), "it outranks what is held");
}

/// The reason that `offer_refusal` gives is the one for which the offer is then refused, for any timestamp,
/// cloud, deadline and backlog. Asking changes nothing, not even a gate (F2).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f2_offer_refusal_is_that_of_the_offer() {
    let mut fusion = with_nothing_due(any_machine::<CLOUDS>());
    let timestamp = any_timestamp_or(fusion.open.own);
    let cloud = any_priority_or_registered(&fusion.clouds);
    let (deadline, backlog): (Deadline, u64) = (any_deadline(), kani::any());
    let before = fusion.clone();
    let foreseen = fusion.offer_refusal(timestamp, cloud, deadline, backlog);
    let same = same_own(&before.open, &fusion.open) && fusion.len() == before.len();
    kani::assert(same && fusion.next_due() == before.next_due(), "F2: no timestamp changes");
    let clock = fusion.now == before.now && fusion.newest == before.newest;
    kani::assert(clock, "F0: the clock stays");
    for i in 0..CLOUDS {
        let same = fusion.clouds.gates[i].is_shut() == before.clouds.gates[i].is_shut();
        kani::assert(same, "F2g: no gate moves");
    }
    // The stub window tracks only `own`, so it may answer differently each time it is asked about another
    // timestamp.
    if timestamp != before.open.own {
        return;
    }
    let refusal = match steps::offer(&mut fusion, timestamp, cloud, deadline, backlog) {
        Admission::Refused(reason) => Some(reason),
        Admission::Admitted { .. } => None,
    };
    kani::assert(
        foreseen == refusal,
        "F2: an offer made at once is refused for the same, or admitted",
    );
    kani::cover!(foreseen.is_none(), "it is admitted");
    kani::cover!(foreseen == Some(OfferRefusal::Unknown), "the cloud or the timestamp is unknown");
    kani::cover!(foreseen == Some(OfferRefusal::Closed), "it is not open");
    kani::cover!(foreseen == Some(OfferRefusal::Queue), "its gate is shut");
}

/// Gives a result or a failure, which is the step's `cause`. Returns whether it is own's, and the outcome.
fn arrival<const CLOUDS: usize>(
    cause: fn(Source) -> Cause,
    is_result: bool,
) -> (bool, Outcome<CLOUDS>) {
    let mut fusion = with_nothing_due(any_machine::<CLOUDS>());
    let before = fusion.clone();
    let (now, entry) = (before.now, before.open.entry);
    let timestamp = any_timestamp_or(fusion.open.own);
    let priority = any_priority_or_registered(&fusion.clouds);
    let outcome = if is_result {
        steps::result(&mut fusion, timestamp, priority)
    } else {
        steps::fail(&mut fusion, timestamp, priority)
    };
    kani::assert(fusion.now == now && fusion.newest == before.newest, "F0: the clock stays");
    kani::assert(is_machine(&fusion), "F3: the machine stays valid");
    if timestamp != before.open.own {
        kani::assert(same_own(&before.open, &fusion.open), "F3: no other timestamp changes");
        return (false, outcome);
    }
    let reached = before.newest.is_some_and(|newest| newest >= timestamp);
    let source = source_of(&fusion, priority).filter(|_| reached);
    let (slot, decision) = match source {
        None => (entry.slot, Decision::Dropped(DropReason::Unknown)),
        Some(_) if !before.open.is_open => (entry.slot, Decision::Dropped(DropReason::Superseded)),
        Some(source) => entry.slot.step(fusion.commit, cause(source)),
    };
    kani::assert(
        is_outcome_of_decision(&fusion, outcome, decision),
        "P11: the outcome is that of the rule",
    );
    let is_retired = match decision {
        Decision::Forwarded { .. } | Decision::Final { .. } | Decision::Missed => true,
        Decision::Dropped(_)
        | Decision::Held
        | Decision::Waiting
        | Decision::Preliminary { .. } => false,
    };
    let is_open = before.open.is_open && !is_retired;
    kani::assert(
        fusion.open.is_open == is_open,
        "P1: it is retired when it is forwarded or missed",
    );
    kani::assert(fusion.len() == before.len() - usize::from(is_retired), "F7: it makes room");
    let same = is_retired || fusion.open.entry.slot == slot;
    kani::assert(same, "F3: the timestamp is as the step leaves it");
    // The result of a source with a timer comes before its due instant, or is dropped (P2).
    let is_accepted =
        matches!(outcome, Outcome::Forwarded { .. } | Outcome::Preliminary { .. } | Outcome::Held);
    if let (true, Some(source), true) = (is_accepted, source, is_result) {
        for i in 0..CLOUDS {
            let own = usize::from(source.index()) == i + 1;
            kani::assert(!own || now < entry.dues[i], "P2 never late: it comes before its due");
        }
        let limited = entry.slot.armed().contains(Source::LOCAL) && source == Source::LOCAL;
        kani::assert(!limited || now < entry.local_due, "P2 never late: local within its deadline");
    }
    (true, outcome)
}

/// A result has the outcome of the rule, for any timestamp and priority, and a held or forwarded result came
/// before its due instant. No other timestamp changes (F3, F9, P2, P11, A13, A16, A18).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p2_never_late_by_the_clock() {
    let (is_own, outcome) = arrival::<CLOUDS>(Cause::Result, true);
    kani::cover!(is_own && matches!(outcome, Outcome::Forwarded { .. }), "it is forwarded");
    kani::cover!(is_own && matches!(outcome, Outcome::Held), "it is held");
    let is_preliminary = matches!(outcome, Outcome::Preliminary { .. });
    kani::cover!(is_own && is_preliminary, "a better one may follow it");
    let unknown = Outcome::Dropped(DropReason::Unknown);
    kani::cover!(is_own && outcome == unknown, "it is unknown");
    let superseded = Outcome::Dropped(DropReason::Superseded);
    kani::cover!(is_own && outcome == superseded, "it is superseded");
    kani::cover!(!is_own && matches!(outcome, Outcome::Held), "another's is held");
}

/// A failure has the outcome of the rule, for any timestamp and priority. No other timestamp changes (F4, F9,
/// P11).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f4_fail_has_its_outcome() {
    let (is_own, outcome) = arrival::<CLOUDS>(Cause::Failure, false);
    kani::cover!(
        is_own && matches!(outcome, Outcome::Forwarded { .. }),
        "the best available is forwarded"
    );
    kani::cover!(is_own && matches!(outcome, Outcome::Missed), "it leaves nothing to wait for");
    kani::cover!(is_own && matches!(outcome, Outcome::Final { .. }), "the last output is final");
    let unknown = Outcome::Dropped(DropReason::Unknown);
    kani::cover!(is_own && outcome == unknown, "it is unknown");
}

/// A new machine has no open timestamp, and its clock is at the start, for any window up to its capacity (F1,
/// A10).
///
/// Bounds: 1 cloud.
#[kani::proof]
#[kani::unwind(18)]
pub fn f1_a_new_machine_is_valid() {
    let window = if kani::any() { WINDOW } else { usize::from(kani::any::<u16>()) };
    let cloud =
        Cloud { priority: Priority::new(kani::any()), limit: kani::any(), resume: kani::any() };
    let commit = any_commit();
    let made = Fusion::<1, WINDOW>::new(window, commit, &[cloud]);
    let fits = (1..=WINDOW).contains(&window);
    let gated = cloud.priority != Priority::LOCAL && cloud.resume < cloud.limit;
    kani::assert(made.is_ok() == (fits && gated), "A10: it is made if it could decide");
    if let Ok(fusion) = &made {
        kani::assert(is_machine(fusion), "F1: it is valid");
        let is_new = fusion.is_empty() && fusion.newest.is_none() && fusion.now == Instant::START;
        kani::assert(is_new, "F1: nothing was opened, and its clock is at its start");
        let same = fusion.window == window && fusion.commit == commit;
        kani::assert(same && fusion.clouds.len == 1, "F1: it is as it was configured");
    }
    kani::cover!(made.is_ok() && window == WINDOW, "the greatest window");
    kani::cover!(made.is_err(), "it is refused");
}

/// The queries return the state and change nothing (F0).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn f0_queries_return_the_state() {
    let fusion = any_machine::<CLOUDS>();
    let open = &fusion.open;
    let priority = any_priority_or_registered(&fusion.clouds);
    let source = source_of(&fusion, priority);
    let slot = if open.is_open { Some(open.entry.slot) } else { None };
    kani::assert(fusion.slot(open.own) == slot, "F0: its sets, if it is open");
    let armed = slot.is_some_and(|slot| source.is_some_and(|of| slot.armed().contains(of)));
    let mut due = open.entry.local_due;
    let mut gate = None;
    for i in 0..CLOUDS {
        if source.is_some_and(|of| usize::from(of.index()) == i + 1) {
            due = open.entry.dues[i];
            gate = Some(fusion.clouds.gates[i].is_shut());
        }
    }
    let own_due = fusion.due(open.own, priority);
    kani::assert(
        own_due == if armed { Some(due) } else { None },
        "F0: when its timer is due, if armed",
    );
    let shut = fusion.gate(priority).map(|gate| gate.is_shut());
    kani::assert(shut == gate, "F0: the cloud's gate");
    kani::assert(fusion.source(priority) == source, "F0: the source of a priority");
    let back = source.is_none_or(|source| fusion.priority(source) == priority);
    kani::assert(back, "F0: the priority of a source");
    let least = least(open.due, open.others.first.map(|first| first.0));
    kani::assert(fusion.next_due() == least, "P9: the next due instant is the least");
    let len = fusion.len();
    kani::assert(fusion.is_empty() == (len < 1), "F0: whether nothing is open");
    kani::assert(fusion.clouds().bits() == u16::MAX << 1, "F0: the sources of the clouds");
    let configured = fusion.window() == fusion.window && fusion.commit() == fusion.commit;
    kani::assert(configured, "F0: how it was made");
    let clock = fusion.now() == fusion.now && fusion.newest() == fusion.newest;
    kani::assert(clock, "F0: its clock, and the greatest timestamp ever opened");
    let (others, own) = (open.others.len, usize::from(open.is_open));
    kani::assert(len == others + own, "F0: how many are open");
    kani::cover!(own_due.is_some() && source != Some(Source::LOCAL), "a cloud's timer is armed");
    kani::cover!(gate.is_some() && slot.is_none(), "it is not open");
}
