//! One timestamp: from any valid state, under each commit rule, any one cause or offer of any of 15 clouds.

use crate::arbitrary::{any_commit, any_slot, any_source, slot_of};
use crate::rules::{
    Bits, as_progressive, bit, bits, forwarded, last_output, output, outranks, reason_to_drop,
    sent, settled, up_to,
};
use crate::slot::{Cause, Commit, Decision, Slot};
use crate::source::{Source, Sources};
use crate::steps::{offer_to, step};
use crate::valid::{is_limited, is_valid};
use crate::{DropReason, OfferRefusal};

/// The greatest number of clouds in a set of sources.
const CLOUDS: u8 = Source::COUNT - 1;

fn any_cause() -> Cause {
    match kani::any_where(|kind: &u8| *kind < 3) {
        0 => Cause::Result(any_source(CLOUDS)),
        1 => Cause::Failure(any_source(CLOUDS)),
        _ => Cause::Timers(Sources::from_bits(kani::any())),
    }
}

/// The states that harnesses start from are exactly the valid ones, and they are the core's.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn every_valid_state_is_generated_and_accepted() {
    let commit = any_commit();
    let made_of = |[requested, pending, armed, cached]: Bits| {
        slot_of(commit, CLOUDS, requested, pending, cached, armed & 1 != 0)
    };
    let any = kani::any();
    // If values are random, this is a state half of the time.
    let [requested, pending, armed, cached] = if kani::any() { bits(made_of(any)) } else { any };
    let made = made_of([requested, pending, armed, cached]);
    kani::assert(is_valid(commit, made), "what is generated is valid");
    let is_made = bits(made) == [requested, pending, armed, cached];
    let sets = [requested, pending, armed, cached].map(Sources::from_bits);
    let taken = Slot::from_sets(commit, sets[0], sets[1], sets[2], sets[3]);
    let is_retired = requested | pending | armed | cached == 0;
    kani::assert(
        taken.is_ok() == (is_made || is_retired),
        "the core takes for a state what is generated, and nothing else",
    );
    if let Ok(slot) = taken {
        kani::assert(bits(slot) == [requested, pending, armed, cached], "the core keeps the sets");
        kani::assert(is_retired || is_valid(commit, slot), "what the core takes is valid");
    }
    kani::cover!(is_made && cached != 0 && commit == Commit::Eager, "a held result under eager");
    kani::cover!(
        is_made && cached != 0 && commit == Commit::Patient,
        "a held result under patient"
    );
    kani::cover!(is_made && cached > 1 && commit == Commit::Progressive, "a cloud's was sent last");
    kani::cover!(taken.is_err(), "sets that are no state");
}

/// A timestamp that is forwarded or missed is retired with it, and a retired timestamp is never forwarded or
/// missed. Under progressive the outputs rise, the last one or a final retires the timestamp, and it is
/// missed only without an output (P1, F7, F9).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p1_once() {
    let commit = any_commit();
    let cause = any_cause();
    let before = any_slot(commit, CLOUDS);
    let (after, decision) = step(before, commit, cause);
    let ends = last_output(decision).is_some() || decision == Decision::Missed;
    kani::assert(ends != after.is_open(), "P1 once: it is retired when it is forwarded or missed");
    kani::assert(after.is_open() || bits(after) == [0; 4], "P1 once: nothing of it remains");
    let is_missed = decision == Decision::Missed;
    let had_none = before.cached().is_empty();
    kani::assert(!is_missed || had_none, "P1 once: it is missed with nothing available alone");
    if commit == Commit::Progressive {
        let last = bits(before)[3];
        let by = output(decision);
        kani::assert(by.is_none_or(|by| bit(by) > last), "P1 once: the outputs rise in priority");
        let recorded = match by {
            Some(by) => bit(by),
            None => last,
        };
        let is_recorded = !after.is_open() || bits(after)[3] == recorded;
        kani::assert(is_recorded, "P1 once: which was the last one is kept");
    } else {
        let is_of_progressive =
            matches!(decision, Decision::Preliminary { .. } | Decision::Final { .. });
        kani::assert(!is_of_progressive, "P1 once: an output of another rule is the only one");
    }
    let (still, again) = step(Slot::RETIRED, commit, cause);
    let ends_again = !matches!(again, Decision::Dropped(_) | Decision::Waiting);
    kani::assert(!ends_again && still == Slot::RETIRED, "P1 once: a retired timestamp stays so");
    let (still, refusal) = offer_to(Slot::RETIRED, commit, any_source(CLOUDS));
    let is_closed = refusal == Some(OfferRefusal::Closed) && still == Slot::RETIRED;
    kani::assert(is_closed, "P1 once: no offer opens it again");
    kani::cover!(is_missed, "it is missed");
    kani::cover!(ends && output(decision).is_some(), "it is forwarded");
    kani::cover!(!ends && !had_none && output(decision).is_some(), "a better output follows one");
}

/// A result whose timer fired is never forwarded: a forwarded result was available, or arrives while pending
/// (P2, F5, A1).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p2_never_late() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    let arriving = match cause {
        Cause::Result(source) => bit(source) & bits(before)[1],
        Cause::Failure(_) | Cause::Timers(_) => 0,
    };
    let in_time = bits(before)[3] | arriving;
    if let Some(by) = output(decision) {
        kani::assert(in_time & bit(by) != 0, "P2 never late: forwarded means in time");
    }
    kani::assert(bits(after)[3] & !in_time == 0, "P2 never late: held means in time");
    let fired = match cause {
        Cause::Timers(fired) => fired.bits() & bits(before)[2],
        Cause::Result(_) | Cause::Failure(_) => 0,
    };
    kani::assert(bits(after)[1] & fired == 0, "P2 never late: what fired is pending no more");
    let late = any_source(CLOUDS);
    let is_closed = before.requested().contains(late) && bits(before)[1] & bit(late) == 0;
    let (still, dropped) = step(before, commit, Cause::Result(late));
    let is_dropped = matches!(dropped, Decision::Dropped(_)) && still == before;
    kani::assert(!is_closed || is_dropped, "P2 never late: what is closed is dropped");
    kani::cover!(fired != 0 && after.is_open(), "a timer fires");
    kani::cover!(dropped == Decision::Dropped(DropReason::Late), "a result is late");
}

/// A forwarded result outranks every other available one, and the arriving one unless it is the same. Under
/// progressive so does the last output, and a result that is superseded while its timestamp is open is
/// outranked by an output (P3, F6).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p3_best_available() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (_, decision) = step(before, commit, cause);
    let mut available = bits(before)[3];
    if let Cause::Result(source) = cause {
        available |= bit(source) & bits(before)[1];
    }
    let mut held_is_forwarded = false;
    if let Some(by) = output(decision).or(last_output(decision)) {
        kani::assert(available & bit(by) != 0, "P3 best available: it is available");
        kani::assert(!outranks(available, by), "P3 best available: nothing available outranks it");
        held_is_forwarded = before.cached().contains(by) && available != bit(by);
    }
    let superseded = decision == Decision::Dropped(DropReason::Superseded);
    let is_outranked = match cause {
        Cause::Result(source) | Cause::Failure(source) => outranks(bits(before)[3], source),
        Cause::Timers(_) => false,
    };
    kani::assert(!superseded || is_outranked, "P3 best available: an output outranks it");
    kani::cover!(superseded, "it is superseded while its timestamp is open");
    kani::cover!(held_is_forwarded, "the best of several held ones is forwarded");
}

/// While anything is held, a pending source outranks it. This holds, with the rest of the invariant, for a
/// timestamp that was just opened and after any cause or offer. Under progressive each accepted result is
/// forwarded at once (P4, F9).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p4_prompt() {
    let commit = any_commit();
    kani::assert(is_valid(commit, Slot::open(kani::any())), "P4 prompt: just opened it is valid");
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    kani::assert(!after.is_open() || is_valid(commit, after), "P4 prompt: a cause leaves it valid");
    if let Cause::Result(source) = cause {
        let comes = commit == Commit::Progressive && before.pending().contains(source);
        let goes = output(decision) == Some(source);
        kani::assert(!comes || goes, "P4 prompt: under progressive what comes is forwarded");
    }
    let (offered, refusal) = offer_to(before, commit, any_source(CLOUDS));
    kani::assert(is_valid(commit, offered), "P4 prompt: an offer leaves it valid");
    kani::cover!(decision == Decision::Held, "a result is held");
    kani::cover!(after.is_open() && output(decision).is_some(), "a result is forwarded at once");
    kani::cover!(refusal.is_none() && !before.cached().is_empty(), "a request joins a held result");
}

/// With local's result available, a cloud's timer is armed, no cause takes the result away or misses the
/// timestamp, each firing leaves fewer timers, and the firing of all of them forwards (P5).
///
/// So the number of armed timers ranks what remains: it falls at each firing and is never 0 while local's
/// result waits. Under progressive local's result was forwarded when it came, and a better output or the end
/// of the timestamp replaces it.
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p5_local_floor() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    let is_forwarded = last_output(decision).is_some();
    let had = before.cached().contains(Source::LOCAL);
    let has = after.cached().contains(Source::LOCAL);
    let is_replaced = commit == Commit::Progressive && output(decision).is_some();
    let stays = is_forwarded || has || is_replaced;
    kani::assert(!had || stays, "P5 local floor: what is held stays or is forwarded");
    let comes = cause == Cause::Result(Source::LOCAL) && before.pending().contains(Source::LOCAL);
    kani::assert(!comes || is_forwarded || has, "P5 local floor: what comes is held or forwarded");
    let is_awaited = !after.armed().clouds().is_empty();
    kani::assert(!has || is_awaited, "P5 local floor: while it waits, a timer is armed");
    if let Cause::Timers(fired) = cause {
        let left = before.armed().difference(fired);
        let fewer = !after.is_open() || after.armed() == left;
        kani::assert(fewer, "P5 local floor: each firing leaves fewer timers");
        let last = had && left.clouds().is_empty();
        kani::assert(!last || is_forwarded, "P5 local floor: the last firing forwards");
    }
    kani::cover!(had && after.is_open() && after.armed() != before.armed(), "it waits on");
    kani::cover!(had && is_forwarded && commit == Commit::Patient, "patient forwards it");
}

/// With no request admitted, local's accepted result is forwarded when it arrives (P6, A17).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p6_free_without_cloud() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let (after, decision) = step(before, commit, Cause::Result(Source::LOCAL));
    let alone = before.requested() == Sources::LOCAL;
    let forwarded = Decision::Forwarded { by: Source::LOCAL, cancelled: Sources::EMPTY };
    let goes = decision == forwarded && !after.is_open();
    kani::assert(!alone || goes, "P6 free without cloud: local's result is forwarded at once");
    let waits = decision == Decision::Held;
    let awaited = !before.pending().clouds().is_empty() && commit != Commit::Progressive;
    kani::assert(!waits || awaited, "P6 free without cloud: it waits for a cloud alone");
    kani::cover!(alone && before.armed().contains(Source::LOCAL), "it had a deadline");
    kani::cover!(waits, "it waits for a cloud");
}

/// An open timestamp waits for local or has an armed timer. A timestamp that was opened with a deadline
/// always has one, and the firing of all its timers retires it. Only an admitted offer arms another timer
/// (P7).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p7_no_stall() {
    let commit = any_commit();
    kani::assert(is_limited(Slot::open(true)), "P7 no stall: a deadline is armed");
    let before = any_slot(commit, CLOUDS);
    let waits = before.pending().contains(Source::LOCAL) || !before.armed().is_empty();
    kani::assert(waits, "P7 no stall: it waits for local or a timer");
    // Only some states show that the timestamp was opened with a deadline; their invariant is `is_limited`.
    let limited = is_limited(before);
    kani::assert(
        !limited || !before.armed().is_empty(),
        "P7 no stall: with a deadline a timer is armed",
    );
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    let stays = !limited || !after.is_open() || is_limited(after);
    kani::assert(stays, "P7 no stall: a cause keeps a limited timestamp limited");
    kani::assert(before.armed().contains_all(after.armed()), "P7 no stall: no cause arms a timer");
    let (offered, _) = offer_to(before, commit, any_source(CLOUDS));
    kani::assert(!limited || is_limited(offered), "P7 no stall: so does an offer");
    let (end, _) = step(before, commit, Cause::Timers(before.armed()));
    kani::assert(!limited || !end.is_open(), "P7 no stall: once all timers fired it is retired");
    kani::cover!(limited && decision == Decision::Missed, "a limited timestamp is missed");
    kani::cover!(!limited && end.is_open(), "one without a deadline waits for local");
}

/// Once local has arrived, an open timestamp waits only for requests, each with an armed timer. The firing of
/// all of them retires it, forwarded if local's result was accepted; under progressive it is final if
/// anything was forwarded, and otherwise missed. Local comes once: nothing makes it pending again (P12).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p12_bounded_wait() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let arrived = !before.pending().contains(Source::LOCAL);
    let requests = before.armed().clouds();
    let is_armed = requests.contains_all(before.pending().clouds());
    kani::assert(is_armed, "P12 bounded wait: a pending request has a timer");
    kani::assert(!arrived || !requests.is_empty(), "P12 bounded wait: it waits for a request");
    let (after, decision) = step(before, commit, any_cause());
    let again = arrived && after.pending().contains(Source::LOCAL);
    kani::assert(!again, "P12 bounded wait: local comes once");
    let comes = !arrived && !after.pending().contains(Source::LOCAL);
    let waits = after.is_open() && after.armed().clouds().is_empty();
    kani::assert(!comes || !waits, "P12 bounded wait: local's arrival leaves a request or none");
    let (offered, _) = offer_to(before, commit, any_source(CLOUDS));
    let again = arrived && offered.pending().contains(Source::LOCAL);
    kani::assert(!again, "P12 bounded wait: no offer makes local pending");
    let (end, last) = step(before, commit, Cause::Timers(requests));
    kani::assert(!arrived || !end.is_open(), "P12 bounded wait: the last request retires it");
    let goes = last_output(last).is_some();
    let has = before.cached().contains(Source::LOCAL);
    kani::assert(!has || goes, "P12 bounded wait: local's result is forwarded");
    let ends = match before.cached().greatest() {
        Some(by) => Decision::Final { by },
        None => Decision::Missed,
    };
    let is_progressive = arrived && commit == Commit::Progressive;
    kani::assert(!is_progressive || last == ends, "P12 bounded wait: it is final or missed");
    kani::cover!(comes && after.is_open(), "local comes, and a request is awaited");
    kani::cover!(comes && decision == Decision::Missed, "local comes last, and it is missed");
    kani::cover!(arrived && !has && last == Decision::Missed, "the last request's timer misses it");
    kani::cover!(has && is_progressive, "local's result was sent last");
}

/// A timer is live from its admission until it fires, its failure is accepted, its result is held under
/// patient, or the timestamp is retired. The timer of local's deadline is live until local's result or
/// failure is accepted. Under progressive a timer also ends when a result that outranks its request is
/// accepted (P8, A3, A52, F3, F9).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p8_timers() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    let accepted = !matches!(decision, Decision::Dropped(_));
    let ended = match cause {
        Cause::Timers(fired) => fired.bits(),
        Cause::Failure(source) if accepted => bit(source),
        Cause::Result(source) if accepted => match commit {
            Commit::Eager => bit(source) & 1,
            Commit::Patient => bit(source),
            Commit::Progressive => up_to(source),
        },
        Cause::Failure(_) | Cause::Result(_) => 0,
    };
    let is_exact = !after.is_open() || bits(after)[2] == bits(before)[2] & !ended;
    kani::assert(is_exact, "P8 timers: those end that must, and no others");
    let source = any_source(CLOUDS);
    let (offered, refusal) = offer_to(before, commit, source);
    let armed = if refusal.is_none() { bit(source) } else { 0 };
    let is_one_more = bits(offered)[2] == bits(before)[2] | armed;
    kani::assert(is_one_more, "P8 timers: an admitted request arms its own");
    let open = [Slot::open(false), Slot::open(true)].map(|slot| slot.armed().bits());
    kani::assert(open == [0, 1], "P8 timers: just opened there is the deadline's or none");
    kani::cover!(
        decision == Decision::Held && after.armed() != before.armed(),
        "a timer ends as a result is held"
    );
    kani::cover!(
        decision == Decision::Held && commit == Commit::Eager && ended == 0,
        "a timer runs on"
    );
    let outranked = bits(before)[2] & ended;
    kani::cover!(after.is_open() && outranked.count_ones() > 1, "the timer of a lower one ends");
}

/// Each result is forwarded, held or dropped, each failure is accepted or dropped, and a firing is never
/// dropped. A dropped input changes nothing, and exactly the clouds still pending are cancelled. Under
/// progressive nothing is held, an output cancels the pending clouds that it outranks, and a final names the
/// last output (P11, F7, F8, F9, A24).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p11_accounted() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let cause = any_cause();
    let (after, decision) = step(before, commit, cause);
    match (cause, decision) {
        (Cause::Result(_) | Cause::Failure(_), Decision::Dropped(_)) => {
            kani::assert(after == before, "P11 accounted: what is dropped changes nothing");
        }
        (Cause::Result(source), Decision::Held) => {
            kani::assert(after.cached().contains(source), "P11 accounted: what is held is cached");
            let holds = commit != Commit::Progressive;
            kani::assert(holds, "P11 accounted: under progressive nothing is held");
        }
        (
            Cause::Result(source),
            Decision::Preliminary { by, .. } | Decision::Forwarded { by, .. },
        ) => {
            kani::assert(by == source, "P11 accounted: a result forwards itself");
        }
        (Cause::Failure(_) | Cause::Timers(_), Decision::Forwarded { .. }) => {
            let holds = commit != Commit::Progressive;
            kani::assert(holds, "P11 accounted: under progressive a result alone is sent");
        }
        (Cause::Failure(_) | Cause::Timers(_), Decision::Final { by }) => {
            let is_last = before.cached().contains(by);
            kani::assert(is_last, "P11 accounted: the last output is final");
        }
        (Cause::Failure(_) | Cause::Timers(_), Decision::Missed | Decision::Waiting) => {}
        (Cause::Result(_), Decision::Waiting | Decision::Final { .. } | Decision::Missed)
        | (Cause::Failure(_), Decision::Held | Decision::Preliminary { .. })
        | (
            Cause::Timers(_),
            Decision::Held | Decision::Dropped(_) | Decision::Preliminary { .. },
        ) => {
            kani::assert(false, "P11 accounted: each input has an answer of its kind");
        }
    }
    if let Decision::Forwarded { by, cancelled } | Decision::Preliminary { by, cancelled } =
        decision
    {
        let ended = match cause {
            Cause::Result(source) | Cause::Failure(source) => bit(source),
            Cause::Timers(fired) => fired.bits() & bits(before)[2],
        };
        let better = if after.is_open() { !up_to(by) } else { 0 };
        let left = bits(before)[1] & !ended & !better & !1;
        kani::assert(cancelled.bits() == left, "P11 accounted: the pending clouds are cancelled");
    }
    kani::cover!(matches!(decision, Decision::Dropped(_)), "an input is dropped");
    kani::cover!(
        matches!(decision, Decision::Preliminary { cancelled, .. } if !cancelled.is_empty()),
        "a lower cloud is cancelled"
    );
    kani::cover!(
        matches!(cause, Cause::Failure(_)) && decision == Decision::Waiting,
        "a failure is accepted"
    );
}

/// An offer is refused for the first reason that holds, and then changes nothing. Otherwise it joins the
/// requests (F2, A17, A26).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn f2_offer_by_the_rule() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let source = any_source(CLOUDS);
    let [requested, pending, armed, cached] = bits(before);
    let (after, refusal) = offer_to(before, commit, source);
    let expected = if requested & bit(source) != 0 {
        Some(OfferRefusal::Duplicate)
    } else if outranks(cached, source) {
        Some(OfferRefusal::Outranked)
    } else {
        None
    };
    kani::assert(refusal == expected, "F2: the first reason that holds, or none");
    let of = if expected.is_none() { bit(source) } else { 0 };
    let joined = [requested | of, pending | of, armed | of, cached];
    kani::assert(
        bits(after) == joined,
        "F2: it is requested, pending and armed, or nothing changes",
    );
    kani::cover!(refusal == Some(OfferRefusal::Outranked), "it is outranked");
    kani::cover!(refusal.is_none(), "it is admitted");
}

/// A result is dropped for the first reason that holds. In time, it is held while a source that outranks it
/// is pending, and otherwise forwarded; under progressive it is forwarded in either case. A machine that
/// drops everything fails here (F3, F9, P4, A52).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn f3_result_by_the_rule() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let source = any_source(CLOUDS);
    let (after, decision) = step(before, commit, Cause::Result(source));
    let [requested, pending, armed, cached] = bits(before);
    let others = pending & !bit(source);
    let (sets, expected) = if let Some(reason) = reason_to_drop(commit, bits(before), source) {
        (bits(before), Decision::Dropped(reason))
    } else if commit == Commit::Progressive {
        sent(bits(before), source)
    } else if outranks(others, source) {
        let disarmed = if commit == Commit::Patient || bit(source) == 1 { bit(source) } else { 0 };
        ([requested, others, armed & !disarmed, cached | bit(source)], Decision::Held)
    } else {
        forwarded(source, others)
    };
    kani::assert(decision == expected, "F3: dropped, held or forwarded by the rule");
    kani::assert(bits(after) == sets, "F3: the sets are those of the rule");
    kani::cover!(decision == Decision::Held, "it is held");
    kani::cover!(matches!(decision, Decision::Forwarded { .. }), "it is forwarded");
    kani::cover!(matches!(decision, Decision::Preliminary { .. }), "a better one may follow it");
    kani::cover!(decision == Decision::Dropped(DropReason::Superseded), "it is superseded");
    kani::cover!(decision == Decision::Dropped(DropReason::Unsolicited), "it is unsolicited");
    kani::cover!(decision == Decision::Dropped(DropReason::Duplicate), "it is a duplicate");
}

/// A failure is dropped for the reasons that drop a result. If it is accepted it closes its request and
/// settles as by no timer (F4, F9, A7, A8, A27, A36, A53).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn f4_fail_by_the_rule() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let source = any_source(CLOUDS);
    let (after, decision) = step(before, commit, Cause::Failure(source));
    let [requested, pending, armed, cached] = bits(before);
    let (sets, expected) = if let Some(reason) = reason_to_drop(commit, bits(before), source) {
        (bits(before), Decision::Dropped(reason))
    } else {
        let closed = [requested, pending & !bit(source), armed & !bit(source), cached];
        settled(commit, closed, false)
    };
    kani::assert(decision == expected, "F4: dropped or settled by the rule");
    kani::assert(bits(after) == sets, "F4: the sets are those of the rule");
    kani::cover!(decision == Decision::Missed, "nothing is left to wait for");
    kani::cover!(matches!(decision, Decision::Forwarded { .. }), "the best available is forwarded");
    kani::cover!(matches!(decision, Decision::Final { .. }), "nothing better will come");
    kani::cover!(decision == Decision::Waiting && cached != 0, "a held result waits on");
}

/// Timers that fire together leave armed and pending and settle once, as by a timer if a cloud's is among
/// them. Timers that are not armed do not count (F5, F6, F9, A4, A5, A9, A22).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn f6_settle_by_the_rule() {
    let commit = any_commit();
    let before = any_slot(commit, CLOUDS);
    let fired: u16 = kani::any();
    let (after, decision) = step(before, commit, Cause::Timers(Sources::from_bits(fired)));
    let [requested, pending, armed, cached] = bits(before);
    let fired = fired & armed;
    let (sets, expected) = if fired == 0 {
        (bits(before), Decision::Waiting)
    } else {
        settled(commit, [requested, pending & !fired, armed & !fired, cached], fired & !1 != 0)
    };
    kani::assert(decision == expected, "F6: settled by the rule");
    kani::assert(bits(after) == sets, "F6: the sets are those of the rule");
    let forwards = matches!(decision, Decision::Forwarded { .. });
    kani::cover!(forwards && commit == Commit::Eager && pending & !fired > cached, "eager commits");
    kani::cover!(forwards && commit == Commit::Patient, "patient has nothing better to wait for");
    kani::cover!(
        fired == 1 && decision == Decision::Waiting && cached != 0,
        "the deadline commits nothing"
    );
    kani::cover!(matches!(decision, Decision::Final { .. }), "the last output is final");
    kani::cover!(decision == Decision::Missed, "nothing came");
}

/// Two timestamps that had the same inputs, one under patient and one under progressive, are related as
/// `as_progressive` says. Both refuse an offer for the same reason. A cause retires both or none, with the
/// same last output, and leaves them related. An output that is not the last is the best available result of
/// patient when it comes (P13, F9).
///
/// Bounds: 15 clouds.
#[kani::proof]
#[kani::unwind(20)]
pub fn p13_as_patient() {
    let limited = kani::any();
    let open = Slot::open(limited);
    kani::assert(as_progressive(bits(open)) == bits(open), "P13 as patient: just opened");
    let patient = any_slot(Commit::Patient, CLOUDS);
    let [requested, pending, armed, cached] = as_progressive(bits(patient));
    let progressive =
        slot_of(Commit::Progressive, CLOUDS, requested, pending, cached, armed & 1 != 0);
    let is_state = bits(progressive) == [requested, pending, armed, cached];
    kani::assert(is_state, "P13 as patient: it is a state of progressive");
    let (cause, source) = (any_cause(), any_source(CLOUDS));
    let (offered, refusal) = offer_to(patient, Commit::Patient, source);
    let (as_offered, same) = offer_to(progressive, Commit::Progressive, source);
    kani::assert(refusal == same, "P13 as patient: an offer is refused for the same reason");
    let related = bits(as_offered) == as_progressive(bits(offered));
    kani::assert(related, "P13 as patient: an offer leaves them related");
    let (patient_after, decided) = step(patient, Commit::Patient, cause);
    let (after, decision) = step(progressive, Commit::Progressive, cause);
    let related = bits(after) == as_progressive(bits(patient_after));
    kani::assert(related, "P13 as patient: a cause retires both or leaves them related");
    let same_last = last_output(decision) == last_output(decided);
    kani::assert(same_last, "P13 as patient: the last output is what patient forwards");
    let both_missed = (decision == Decision::Missed) == (decided == Decision::Missed);
    kani::assert(both_missed, "P13 as patient: both are missed or none");
    if let Decision::Preliminary { by, .. } = decision {
        let is_best = patient_after.cached().greatest() == Some(by);
        kani::assert(is_best && decided == Decision::Held, "P13 as patient: patient holds it");
    }
    let is_last = last_output(decision).is_some();
    kani::cover!(is_last && output(decision).is_none(), "a final ends what patient forwards");
    kani::cover!(
        decided == Decision::Held && matches!(decision, Decision::Dropped(_)),
        "patient holds a lower one"
    );
    kani::cover!(bits(progressive) != bits(patient) && refusal.is_none(), "a request joins both");
    kani::cover!(
        decided == Decision::Waiting && after == progressive && patient_after != patient,
        "a lower request is closed"
    );
}
