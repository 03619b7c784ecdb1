use super::*;
use std::collections::BTreeSet;
use std::vec::Vec;

const RULES: [Commit; 2] = [Commit::Eager, Commit::Patient];

fn set(members: &[u8]) -> Sources {
    members.iter().filter_map(|index| Source::new(*index)).collect()
}

fn source(index: u8) -> Source {
    Source::new(index).unwrap()
}

/// A slot with these clouds requested.
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

/// Every state that inputs can lead to is one that `from_sets` accepts, and the other way round.
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
        assert!(valid.len() > 100, "{} states", valid.len());
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
fn held_local_loses_its_limit_under_both_rules() {
    for commit in RULES {
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
    for commit in RULES {
        let available = after(commit, requested(true, &[1, 2]), &[result(1)]);
        let (waiting, decision) = available.step(commit, timers(&[0]));
        assert_eq!((waiting.pending(), decision), (set(&[2]), Decision::Waiting));
    }
    // With a cloud's timer of the same instant it commits, if eager.
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
    for commit in RULES {
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
