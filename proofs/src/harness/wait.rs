//! By when any one of the open timestamps is retired, and that lateness of the calls decides nothing; for any number of them.

use crate::Outcome;
use crate::any::{any_instant, any_latest, any_machine, any_machine_of_own, at_rest};
use crate::entry::Entry;
use crate::fusion::At;
use crate::priority::Priority;
use crate::source::Source;
use crate::time::Instant;
use crate::told;
use crate::valid::{is_limited, later, same_firing, same_own};

/// All clouds that there can be.
const CLOUDS: usize = 15;

/// Whether every armed request is due by then. The deadline of local counts for nothing.
fn asked_by<const CLOUDS: usize>(entry: &Entry<CLOUDS>, latest: Instant) -> bool {
    let armed = entry.slot.armed().bits();
    let mut bounded = true;
    for (i, due) in entry.dues.iter().enumerate() {
        bounded &= armed >> (i + 1) & 1 == 0 || *due <= latest;
    }
    bounded
}

/// Whether every armed timer is due by then.
fn armed_by<const CLOUDS: usize>(entry: &Entry<CLOUDS>, latest: Instant) -> bool {
    let limit = !entry.slot.armed().contains(Source::LOCAL) || entry.local_due <= latest;
    limit && asked_by(entry, latest)
}

/// P5, P7: by the latest due instant ever armed the timestamp is retired, if it was opened with a deadline or has local's result.
///
/// The rank is the number of its armed timers. Each firing of the timestamp lowers it or retires the timestamp, no firing arms
/// a timer beyond the latest or changes another timestamp, and when the machine takes inputs at the latest or after it, the rank is 0.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p7_retired_by_the_latest_due() {
    let mut fusion = any_machine_of_own::<CLOUDS>();
    let before = fusion.open.clone();
    let entry = before.entry;
    // The latest due instant ever armed: at least those armed now.
    let armed = entry.slot.armed();
    let latest = any_latest(&entry, armed);
    let certain = is_limited(entry.slot) || entry.slot.cached().contains(Source::LOCAL);
    let fired = match told::at(&mut fusion, any_instant()) {
        At::Fired(firing) => Some(firing.timestamp),
        At::Ready(_) => None,
    };
    let after = &fusion.open;
    let is_retired = !after.is_open;
    if fired == Some(before.own) {
        let left = after.entry.slot.armed();
        let fewer = armed.contains_all(left) && left != armed;
        kani::assert(is_retired || fewer, "P7 no stall: each firing lowers the rank");
        let within = is_retired || armed_by(&after.entry, latest);
        kani::assert(within, "P7 no stall: nothing is armed beyond the latest");
    } else {
        kani::assert(same_own(&before, after), "P7 no stall: another's firing leaves the rank");
    }
    if fired.is_none() {
        let passed = fusion.now >= latest;
        kani::assert(!passed || armed.is_empty(), "P7 no stall: by the latest the rank is 0");
        kani::assert(!passed || !certain, "P5 local floor: by the latest it is retired");
    }
    kani::cover!(is_retired && certain, "the last firing retires it");
    kani::cover!(fired.is_none() && fusion.now >= latest, "local may take its time");
    kani::cover!(fired.is_some_and(|of| of != before.own), "another fires first");
}

/// P12: once local arrived, a timestamp is retired by the latest due instant of the requests admitted for it, forwarded if
/// local's result was accepted.
///
/// The rank is the number of its armed timers, as for P7: each firing of the timestamp lowers it or retires the timestamp, and
/// when the machine takes inputs at the latest or after it, local has not arrived.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p12_retired_by_the_last_request() {
    let mut fusion = any_machine_of_own::<CLOUDS>();
    let before = fusion.open.clone();
    let entry = before.entry;
    // The latest due instant of a request ever admitted: at least those armed now.
    let armed = entry.slot.armed();
    let latest = any_latest(&entry, armed.without(Source::LOCAL));
    let arrived = !entry.slot.pending().contains(Source::LOCAL);
    let has = entry.slot.cached().contains(Source::LOCAL);
    let fired = match told::at(&mut fusion, any_instant()) {
        At::Fired(firing) => Some(firing),
        At::Ready(_) => None,
    };
    let after = &fusion.open;
    if let Some(firing) = fired.filter(|firing| firing.timestamp == before.own) {
        let left = after.entry.slot.armed();
        let fewer = armed.contains_all(left) && left != armed && asked_by(&after.entry, latest);
        let goes = matches!(firing.outcome, Outcome::Forwarded { .. });
        kani::assert(!after.is_open || fewer, "P12 bounded wait: each firing lowers the rank");
        let kept = after.is_open || !has || goes;
        kani::assert(kept, "P12 bounded wait: local's result is forwarded");
    } else {
        kani::assert(
            same_own(&before, after),
            "P12 bounded wait: another's firing leaves the rank",
        );
    }
    if fired.is_none() {
        let passed = fusion.now >= latest;
        kani::assert(!passed || !arrived, "P12 bounded wait: by the latest it is retired");
    }
    kani::cover!(arrived && !fusion.open.is_open, "the last request retires it");
    kani::cover!(fired.is_some() && arrived && fusion.open.is_open, "a request is still awaited");
    kani::cover!(fired.is_none() && fusion.now >= latest, "local may take its time");
}

/// P12: local's arrival at the latest due instant of the requests admitted for it, or after it, retires a timestamp,
/// forwarded if it is a result; its deadline's firing then does as well, by `p12_bounded_wait`.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p12_retired_by_local_at_last() {
    let mut fusion = at_rest(any_machine_of_own::<CLOUDS>());
    let entry = &fusion.open.entry;
    let latest = any_latest(entry, entry.slot.armed().without(Source::LOCAL));
    let passed = fusion.now >= latest;
    let timestamp = fusion.open.own;
    let is_result: bool = kani::any();
    let outcome = if is_result {
        told::result(&mut fusion, timestamp, Priority::LOCAL)
    } else {
        told::fail(&mut fusion, timestamp, Priority::LOCAL)
    };
    let goes = matches!(outcome, Outcome::Forwarded { .. });
    let is_open = fusion.open.is_open;
    kani::assert(!passed || !is_open, "P12 bounded wait: local's arrival retires it");
    kani::assert(!passed || !is_result || goes, "P12 bounded wait: its result is forwarded");
    kani::cover!(passed && outcome == Outcome::Missed, "local fails last, and it is missed");
    kani::cover!(!passed && outcome == Outcome::Held, "local comes first and is held");
}

/// P10, A2: what fires does not depend on how late the call is. Two machines that differ in their clocks alone, both called at
/// or after the earliest due instant, fire the same with the same outcome and are left alike.
///
/// So any number of firings in one late call are as many calls, each at its due instant.
///
/// Bounds: 4 clouds.
#[kani::proof]
#[kani::unwind(18)]
pub fn p10_lateness_decides_nothing() {
    let mut late = any_machine::<4>();
    let mut exact = late.clone();
    exact.now = any_instant();
    let Some(due) = late.next_due() else { return };
    let [a, b] = [any_instant(), any_instant()].map(|now| later(now, due));
    let (At::Fired(a), At::Fired(b)) = (told::at(&mut late, a), told::at(&mut exact, b)) else {
        kani::assert(false, "P10: a call at the due instant or after it fires");
        return;
    };
    kani::assert(same_firing(&a, &b), "P10: both fire the same with the same outcome");
    kani::assert(same_own(&late.open, &exact.open), "P10: both are left alike");
    let is_own = a.timestamp == late.open.own;
    kani::cover!(is_own && !late.open.is_open && late.now != exact.now, "it retires the timestamp");
    kani::cover!(is_own && late.open.is_open && late.now != exact.now, "it waits on");
}
