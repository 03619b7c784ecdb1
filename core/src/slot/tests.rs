use super::*;
use std::collections::BTreeSet;
use std::vec::Vec;

const RULES: [Commit; 3] = [Commit::Eager, Commit::Patient, Commit::Progressive];
/// The commit rules that hold a result while a better one is pending.
const HOLDING: [Commit; 2] = [Commit::Eager, Commit::Patient];

fn set(members: &[u8]) -> Sources {
    members.iter().filter_map(|index| Source::new(*index)).collect()
}

fn source(index: u8) -> Source {
    Source::new(index).unwrap()
}

/// Returns a slot with these clouds requested.
fn requested(limited: bool, clouds: &[u8]) -> Slot {
    clouds.iter().fold(Slot::open(limited), |slot, cloud| {
        let (slot, refusal) = slot.offer(source(*cloud));
        assert_eq!(refusal, None);
        slot
    })
}

/// Applies causes that must leave the timestamp open.
fn after(commit: Commit, slot: Slot, causes: &[Cause]) -> Slot {
    causes.iter().fold(slot, |slot, cause| {
        let (slot, _) = slot.step(commit, *cause);
        assert!(slot.is_open(), "{cause:?} retired the timestamp");
        slot
    })
}

fn result(index: u8) -> Cause {
    Cause::Result(source(index))
}

fn failure(index: u8) -> Cause {
    Cause::Failure(source(index))
}

fn timers(members: &[u8]) -> Cause {
    Cause::Timers(set(members))
}

fn forwarded(by: u8, cancelled: &[u8]) -> (Slot, Decision) {
    (Slot::RETIRED, Decision::Forwarded { by: source(by), cancelled: set(cancelled) })
}

/// Checks that `from_sets` accepts exactly the states that inputs can lead to.
#[test]
fn valid_states_are_exactly_the_reachable_ones() {
    const SOURCES: u16 = 4;
    for commit in RULES {
        let bits = |slot: Slot| {
            (slot.requested.bits(), slot.pending.bits(), slot.armed.bits(), slot.cached.bits())
        };
        let mut reached = BTreeSet::from([bits(Slot::RETIRED)]);
        let mut frontier: Vec<Slot> = [false, true].map(Slot::open).to_vec();
        while let Some(slot) = frontier.pop() {
            if !reached.insert(bits(slot)) {
                continue;
            }
            for index in 0..SOURCES {
                let index = u8::try_from(index).unwrap();
                frontier.push(slot.offer(source(index)).0);
                frontier.push(slot.step(commit, result(index)).0);
                frontier.push(slot.step(commit, failure(index)).0);
            }
            for fired in 0..1 << SOURCES {
                frontier.push(slot.step(commit, Cause::Timers(Sources::from_bits(fired))).0);
            }
        }
        let all = 0..1 << SOURCES;
        let mut valid = BTreeSet::new();
        for requested in all.clone() {
            for pending in all.clone() {
                for armed in all.clone() {
                    for cached in all.clone() {
                        let [r, p, a, c] =
                            [requested, pending, armed, cached].map(Sources::from_bits);
                        if let Ok(slot) = Slot::from_sets(commit, r, p, a, c) {
                            valid.insert(bits(slot));
                        }
                    }
                }
            }
        }
        assert_eq!(reached, valid, "{commit:?}");
        assert!(valid.len() >= 100, "{} states", valid.len());
    }
}

#[test]
fn sets_that_no_inputs_lead_to_are_refused_with_the_reason() {
    let from = |r: &[u8], p: &[u8], a: &[u8], c: &[u8]| {
        Slot::from_sets(Commit::Eager, set(r), set(p), set(a), set(c)).unwrap_err()
    };
    assert_eq!(from(&[1], &[1], &[1], &[]), InvalidSlot::LocalNotRequested);
    assert_eq!(from(&[0], &[0, 1], &[1], &[]), InvalidSlot::NotRequested);
    assert_eq!(from(&[0], &[0], &[], &[2]), InvalidSlot::NotRequested);
    assert_eq!(from(&[0, 1], &[0, 1], &[1], &[0]), InvalidSlot::PendingAndCached);
    assert_eq!(from(&[0, 1], &[], &[], &[]), InvalidSlot::NothingPending);
    assert_eq!(from(&[0, 1], &[0], &[1], &[1]), InvalidSlot::Unforwarded);
    assert_eq!(from(&[0, 1], &[0, 1], &[], &[]), InvalidSlot::Timers);
    assert_eq!(from(&[0, 1], &[1], &[0, 1], &[0]), InvalidSlot::Timers);
    let progressive = |p: &[u8], c: &[u8]| {
        let requested = set(&[0, 1, 2, 3]);
        Slot::from_sets(Commit::Progressive, requested, set(p), set(p).clouds(), set(c))
    };
    assert_eq!(progressive(&[3], &[1, 2]), Err(InvalidSlot::Outranked));
    assert_eq!(progressive(&[1, 3], &[2]), Err(InvalidSlot::Outranked));
    assert!(progressive(&[3], &[2]).is_ok());
}

#[test]
fn result_with_nothing_above_it_is_forwarded_and_cancels_the_pending_clouds() {
    for commit in RULES {
        let slot = requested(true, &[1, 2, 3]);
        assert_eq!(slot.step(commit, result(3)), forwarded(3, &[1, 2]));
        assert_eq!(Slot::open(false).step(commit, result(0)), forwarded(0, &[]));
    }
}

#[test]
fn held_cloud_keeps_its_timer_under_eager_alone() {
    let slot = requested(false, &[1, 2]);
    for (commit, armed) in [(Commit::Eager, set(&[1, 2])), (Commit::Patient, set(&[2]))] {
        let (held, decision) = slot.step(commit, result(1));
        assert_eq!(decision, Decision::Held);
        assert_eq!(held.cached(), set(&[1]));
        assert_eq!(held.pending(), set(&[0, 2]));
        assert_eq!(held.armed(), armed, "{commit:?}");
    }
}

#[test]
fn held_local_loses_its_limit() {
    for commit in HOLDING {
        let (held, decision) = requested(true, &[1]).step(commit, result(0));
        assert_eq!((held.armed(), decision), (set(&[1]), Decision::Held));
    }
}

#[test]
fn eager_cloud_timer_commits_the_best_available_whoever_owns_it() {
    let commit = Commit::Eager;
    let available = after(commit, requested(false, &[1, 2, 3]), &[result(0), result(2)]);
    for timer in [1, 2, 3] {
        let cancelled: &[u8] = if timer == 3 { &[1] } else { &[1, 3] };
        let cancelled: Vec<u8> = cancelled.iter().copied().filter(|c| *c != timer).collect();
        assert_eq!(available.step(commit, timers(&[timer])), forwarded(2, &cancelled));
    }
}

#[test]
fn patient_timer_closes_its_own_request_alone() {
    let commit = Commit::Patient;
    let available = after(commit, requested(false, &[1, 2, 3]), &[result(0)]);
    let (waiting, decision) = available.step(commit, timers(&[2]));
    assert_eq!((waiting.pending(), decision), (set(&[1, 3]), Decision::Waiting));
    let (waiting, decision) = waiting.step(commit, timers(&[3]));
    assert_eq!((waiting.pending(), decision), (set(&[1]), Decision::Waiting));
    assert_eq!(waiting.step(commit, timers(&[1])), forwarded(0, &[]));
}

#[test]
fn limit_alone_commits_nothing_while_something_better_is_pending() {
    for commit in HOLDING {
        let available = after(commit, requested(true, &[1, 2]), &[result(1)]);
        let (waiting, decision) = available.step(commit, timers(&[0]));
        assert_eq!((waiting.pending(), decision), (set(&[2]), Decision::Waiting));
    }
    // Under eager, the timer of a cloud that is due at the same instant commits.
    let available = after(Commit::Eager, requested(true, &[1, 2]), &[result(1)]);
    assert_eq!(available.step(Commit::Eager, timers(&[0, 1])), forwarded(1, &[2]));
}

#[test]
fn nothing_available_and_nothing_pending_is_missed() {
    for commit in RULES {
        let slot = after(commit, requested(true, &[1]), &[failure(0)]);
        assert_eq!(slot.step(commit, timers(&[1])), (Slot::RETIRED, Decision::Missed));
        assert_eq!(Slot::open(true).step(commit, timers(&[0])), (Slot::RETIRED, Decision::Missed));
        assert_eq!(Slot::open(false).step(commit, failure(0)), (Slot::RETIRED, Decision::Missed));
    }
}

#[test]
fn failure_of_what_outranks_the_best_forwards_it_at_once() {
    for commit in HOLDING {
        let available = after(commit, requested(false, &[1, 2, 3]), &[result(2)]);
        assert_eq!(available.step(commit, failure(3)), forwarded(2, &[1]));
        let (waiting, decision) = available.step(commit, failure(1));
        assert_eq!((waiting.pending(), decision), (set(&[0, 3]), Decision::Waiting));
    }
}

#[test]
fn drops_name_the_first_reason_and_change_nothing() {
    for commit in RULES {
        let slot = after(commit, requested(false, &[1, 2]), &[failure(1), result(0)]);
        for (cause, reason) in [
            (result(3), DropReason::Unsolicited),
            (failure(3), DropReason::Unsolicited),
            (result(0), DropReason::Duplicate),
            (failure(0), DropReason::Duplicate),
            (result(1), DropReason::Late),
            (failure(1), DropReason::Late),
        ] {
            assert_eq!(slot.step(commit, cause), (slot, Decision::Dropped(reason)), "{cause:?}");
        }
        let superseded = (Slot::RETIRED, Decision::Dropped(DropReason::Superseded));
        assert_eq!(Slot::RETIRED.step(commit, result(0)), superseded);
        assert_eq!(Slot::RETIRED.step(commit, failure(1)), superseded);
    }
}

#[test]
fn timers_that_are_not_armed_count_for_nothing() {
    for commit in RULES {
        let slot = after(commit, requested(false, &[1, 2]), &[result(0)]);
        assert_eq!(slot.step(commit, timers(&[0, 3])), (slot, Decision::Waiting));
        assert_eq!(Slot::RETIRED.step(commit, timers(&[1])), (Slot::RETIRED, Decision::Waiting));
    }
}

#[test]
fn offers_are_refused_when_closed_requested_before_or_outranked() {
    let slot = after(Commit::Eager, requested(false, &[2, 3]), &[result(2)]);
    assert_eq!(slot.offer(source(2)), (slot, Some(OfferRefusal::Duplicate)));
    assert_eq!(slot.offer(source(0)), (slot, Some(OfferRefusal::Duplicate)));
    assert_eq!(slot.offer(source(1)), (slot, Some(OfferRefusal::Outranked)));
    assert_eq!(slot.offer(source(4)).1, None);
    assert_eq!(Slot::RETIRED.offer(source(1)), (Slot::RETIRED, Some(OfferRefusal::Closed)));
}

#[test]
fn progressive_sends_each_better_result_at_once_and_ends_when_nothing_better_is_pending() {
    let commit = Commit::Progressive;
    let sent =
        |by, cancelled: &[u8]| Decision::Preliminary { by: source(by), cancelled: set(cancelled) };
    let (slot, decision) = requested(true, &[1, 2, 3, 4]).step(commit, result(0));
    assert_eq!((slot.cached(), slot.pending()), (set(&[0]), set(&[1, 2, 3, 4])));
    assert_eq!((slot.armed(), decision), (set(&[1, 2, 3, 4]), sent(0, &[])));
    // The output cancels the request that it outranks, and that request's result is superseded.
    let (slot, decision) = slot.step(commit, result(2));
    assert_eq!((slot.cached(), slot.pending()), (set(&[2]), set(&[3, 4])));
    assert_eq!((slot.armed(), decision), (set(&[3, 4]), sent(2, &[1])));
    for outranked in [0, 1] {
        let superseded = (slot, Decision::Dropped(DropReason::Superseded));
        assert_eq!(slot.step(commit, result(outranked)), superseded);
        assert_eq!(slot.step(commit, failure(outranked)), superseded);
    }
    assert_eq!(slot.step(commit, result(2)), (slot, Decision::Dropped(DropReason::Duplicate)));
    assert_eq!(slot.step(commit, result(4)), forwarded(4, &[3]));
    // Once the last better request is closed, the last output is final.
    let slot = after(commit, slot, &[timers(&[4])]);
    let last = (Slot::RETIRED, Decision::Final { by: source(2) });
    assert_eq!(slot.step(commit, timers(&[3])), last);
    assert_eq!(slot.step(commit, failure(3)), last);
}

#[test]
fn progressive_does_not_wait_for_local_once_a_cloud_was_sent() {
    let commit = Commit::Progressive;
    let (slot, decision) = requested(true, &[1, 2]).step(commit, result(1));
    assert_eq!(decision, Decision::Preliminary { by: source(1), cancelled: set(&[]) });
    assert_eq!((slot.pending(), slot.armed()), (set(&[2]), set(&[2])));
    assert_eq!(slot.step(commit, failure(2)).1, Decision::Final { by: source(1) });
}

#[test]
fn progressive_drops_what_is_outranked_as_superseded_also_if_it_was_never_requested() {
    let commit = Commit::Progressive;
    let slot = after(commit, requested(false, &[2, 3]), &[result(2)]);
    assert_eq!(slot.step(commit, result(1)).1, Decision::Dropped(DropReason::Superseded));
    let better = slot.step(commit, result(4)).1;
    assert_eq!(better, Decision::Dropped(DropReason::Unsolicited));
}

/// Progressive admits and retires as patient does, and its last output is patient's output (P13).
#[test]
fn progressive_retires_and_admits_as_patient_does_from_every_pair_of_states() {
    const SOURCES: u8 = 4;
    let mut seen = BTreeSet::new();
    let bits = |slot: Slot| {
        (slot.requested.bits(), slot.pending.bits(), slot.armed.bits(), slot.cached.bits())
    };
    let mut frontier: Vec<(Slot, Slot)> =
        [false, true].map(|limited| (Slot::open(limited), Slot::open(limited))).to_vec();
    while let Some((patient, progressive)) = frontier.pop() {
        if !seen.insert((bits(patient), bits(progressive))) {
            continue;
        }
        assert_eq!(progressive.is_open(), patient.is_open());
        assert_eq!(progressive.cached.greatest(), patient.cached.greatest());
        for index in 0..SOURCES {
            let (a, b) = (patient.offer(source(index)), progressive.offer(source(index)));
            assert_eq!(a.1, b.1);
            frontier.push((a.0, b.0));
        }
        let fired = (0..1 << SOURCES).map(|bits| Cause::Timers(Sources::from_bits(bits)));
        let causes = (0..SOURCES).flat_map(|index| [result(index), failure(index)]).chain(fired);
        for cause in causes {
            let (a, as_patient) = patient.step(Commit::Patient, cause);
            let (b, decision) = progressive.step(Commit::Progressive, cause);
            match (as_patient, decision) {
                (
                    Decision::Forwarded { by: a, .. },
                    Decision::Forwarded { by: b, .. } | Decision::Final { by: b },
                ) => {
                    assert_eq!(a, b);
                }
                (Decision::Missed, Decision::Missed) => {}
                _ => assert!(
                    a.is_open() && b.is_open() || !patient.is_open(),
                    "{cause:?}: {as_patient:?}, {decision:?}"
                ),
            }
            frontier.push((a, b));
        }
    }
    assert!(seen.len() > 100, "{} pairs", seen.len());
}
