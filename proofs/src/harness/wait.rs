//! Shows that each open timestamp is retired in time, and that late calls decide nothing, for any
//! number of timestamps.

use crate::Outcome;
use crate::arbitrary::{WINDOW, any_instant, any_machine, any_machine_of_own, with_nothing_due};
use crate::entry::Entry;
use crate::fusion::{At, Fusion};
use crate::priority::Priority;
use crate::source::Source;
use crate::steps;
use crate::valid::{is_limited, later, same_firing, same_own};

/// The greatest number of clouds.
const CLOUDS: usize = 15;

/// Returns `true` if each of own's armed timers is due after now.
fn is_ahead<const CLOUDS: usize>(fusion: &Fusion<CLOUDS, WINDOW>) -> bool {
    let entry = &fusion.open.entry;
    let armed = entry.slot.armed().bits();
    let mut ahead = armed & 1 == 0 || entry.local_due > fusion.now;
    for (i, due) in entry.dues.iter().enumerate() {
        ahead &= armed >> (i + 1) & 1 == 0 || *due > fusion.now;
    }
    ahead
}

/// Returns `true` if fewer of own's timers are armed than before, and no additional one.
fn is_lower<const CLOUDS: usize>(before: &Entry<CLOUDS>, after: &Entry<CLOUDS>) -> bool {
    let (armed, left) = (before.slot.armed(), after.slot.armed());
    let mut same = before.local_due == after.local_due;
    for i in 0..CLOUDS {
        same &= before.dues[i] == after.dues[i];
    }
    same && armed.contains_all(left) && left != armed
}

/// A timestamp that was opened with a deadline, or has local's result, is retired by the latest due instant
/// that was ever armed for it (P5, P7).
///
/// The rank is the number of its armed timers. Each firing of the timestamp lowers the rank or retires the
/// timestamp, and no other firing changes it. When the machine takes inputs, each armed timer is due after
/// now. So at or after the latest due instant the rank is 0, and then the timestamp is retired, unless local
/// has no deadline.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p7_retired_by_the_latest_due() {
    let mut fusion = any_machine_of_own::<CLOUDS>();
    let before = fusion.open.clone();
    let slot = before.entry.slot;
    let certain = is_limited(slot) || slot.cached().contains(Source::LOCAL);
    let fired = match steps::at(&mut fusion, any_instant()) {
        At::Fired(firing) => Some(firing.timestamp),
        At::Ready(_) => None,
    };
    let after = &fusion.open;
    if fired == Some(before.own) {
        let lower = !after.is_open || is_lower(&before.entry, &after.entry);
        kani::assert(lower, "P7 no stall: each firing lowers the rank");
    } else {
        kani::assert(same_own(&before, after), "P7 no stall: another's firing leaves the rank");
    }
    if fired.is_none() {
        kani::assert(is_ahead(&fusion), "P7 no stall: by the latest the rank is 0");
        let waits = !slot.armed().is_empty();
        kani::assert(waits || !certain, "P5 local floor: by the latest it is retired");
    }
    kani::cover!(!after.is_open && certain, "the last firing retires it");
    kani::cover!(fired.is_none() && slot.armed().is_empty(), "local may take its time");
    kani::cover!(fired.is_some_and(|of| of != before.own), "another fires first");
}

/// Once local has arrived, a timestamp is retired by the latest due instant of the requests admitted for it,
/// forwarded if local's result was accepted (P12).
///
/// The rank is the number of armed timers, as in P7. When the machine takes inputs and local has arrived, a
/// request is armed and due after now, so the latest due instant has not come.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p12_retired_by_the_last_request() {
    let mut fusion = any_machine_of_own::<CLOUDS>();
    let before = fusion.open.clone();
    let slot = before.entry.slot;
    let arrived = !slot.pending().contains(Source::LOCAL);
    let has = slot.cached().contains(Source::LOCAL);
    let fired = match steps::at(&mut fusion, any_instant()) {
        At::Fired(firing) => Some(firing),
        At::Ready(_) => None,
    };
    let after = &fusion.open;
    if let Some(firing) = fired.filter(|firing| firing.timestamp == before.own) {
        let lower = !after.is_open || is_lower(&before.entry, &after.entry);
        kani::assert(lower, "P12 bounded wait: each firing lowers the rank");
        let goes = matches!(firing.outcome, Outcome::Forwarded { .. } | Outcome::Final { .. });
        let is_sent = after.is_open || !has || goes;
        kani::assert(is_sent, "P12 bounded wait: local's result is forwarded");
    }
    if fired.is_none() {
        let waits = !slot.armed().without(Source::LOCAL).is_empty() && is_ahead(&fusion);
        kani::assert(!arrived || waits, "P12 bounded wait: by the latest it is retired");
    }
    kani::cover!(arrived && !after.is_open, "the last request retires it");
    kani::cover!(fired.is_some() && arrived && after.is_open, "a request is still awaited");
    kani::cover!(fired.is_none() && arrived, "nothing is due yet");
}

/// If local arrives at or after the latest due instant of the requests admitted for it, it retires the
/// timestamp, forwarded if it is a result. The firing of its deadline does so too, by `p12_bounded_wait`
/// (P12).
///
/// No request is armed any more then, because those that are armed when the machine takes inputs are due
/// after now.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p12_retired_by_local_at_last() {
    let mut fusion = with_nothing_due(any_machine_of_own::<CLOUDS>());
    kani::assert(is_ahead(&fusion), "P12 bounded wait: what is armed is due after now");
    let passed = fusion.open.entry.slot.armed().without(Source::LOCAL).is_empty();
    let timestamp = fusion.open.own;
    let is_result: bool = kani::any();
    let outcome = if is_result {
        steps::result(&mut fusion, timestamp, Priority::LOCAL)
    } else {
        steps::fail(&mut fusion, timestamp, Priority::LOCAL)
    };
    let goes = matches!(outcome, Outcome::Forwarded { .. });
    let is_open = fusion.open.is_open;
    kani::assert(!passed || !is_open, "P12 bounded wait: local's arrival retires it");
    kani::assert(!passed || !is_result || goes, "P12 bounded wait: its result is forwarded");
    kani::cover!(passed && outcome == Outcome::Missed, "local fails last, and it is missed");
    kani::cover!(!passed && outcome == Outcome::Held, "local comes first and is held");
}

/// The firings do not depend on how late the call is. Two machines that differ only in their clocks, both
/// called at or after the earliest due instant, fire the same with the same outcome and end in the same state
/// (P10, A2).
///
/// So any number of firings in one late call equals as many calls, each at its due instant.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p10_lateness_decides_nothing() {
    let mut late = any_machine::<CLOUDS>();
    let mut exact = late.clone();
    exact.now = any_instant();
    let Some(due) = late.next_due() else { return };
    let [a, b] = [any_instant(), any_instant()].map(|now| later(now, due));
    let (At::Fired(a), At::Fired(b)) = (steps::at(&mut late, a), steps::at(&mut exact, b)) else {
        kani::assert(false, "P10: a call at the due instant or after it fires");
        return;
    };
    kani::assert(same_firing(&a, &b), "P10: both fire the same with the same outcome");
    kani::assert(same_own(&late.open, &exact.open), "P10: both are left alike");
    let is_own = a.timestamp == late.open.own;
    kani::cover!(is_own && !late.open.is_open && late.now != exact.now, "it retires the timestamp");
    kani::cover!(is_own && late.open.is_open && late.now != exact.now, "it waits on");
}
