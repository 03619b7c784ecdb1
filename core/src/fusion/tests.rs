use super::*;
use crate::answer::Firing;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::vec::Vec;

type Small = Fusion<3, 4>;

const LOCAL: Priority = Priority::LOCAL;
const NEAR: Priority = Priority::new(5);
const FAR: Priority = Priority::new(9);

fn machine(window: usize, commit: Commit) -> Small {
    Fusion::new(window, commit, &[Cloud::new(FAR, 3), Cloud::new(NEAR, 3)]).unwrap()
}

fn t(count: u64) -> Timestamp {
    Timestamp::new(count)
}

fn ns(nanos: u64) -> Deadline {
    Deadline::from_nanos(nanos)
}

/// Returns the firings due at `now`, in order.
fn fired(fusion: &mut Small, now: u64) -> Vec<Firing<3>> {
    let mut firings = Vec::new();
    while let At::Fired(firing) = fusion.at(Instant::from_nanos(now)) {
        firings.push(firing);
    }
    firings
}

/// Returns the machine at `now`, at which nothing may be due.
fn ready(fusion: &mut Small, now: u64) -> Ready<'_, 3, 4> {
    match fusion.at(Instant::from_nanos(now)) {
        At::Ready(ready) => ready,
        At::Fired(firing) => panic!("{firing:?}"),
    }
}

#[test]
fn configurations_out_of_range_are_refused_with_the_reason() {
    let new = |window, clouds: &[Cloud]| Small::new(window, Commit::Eager, clouds).unwrap_err();
    let cloud = |p| Cloud::new(Priority::new(p), 1);
    assert_eq!(new(0, &[]), ConfigError::Window { window: 0, capacity: 4 });
    assert_eq!(new(5, &[]), ConfigError::Window { window: 5, capacity: 4 });
    let four = [cloud(1), cloud(2), cloud(3), cloud(4)];
    assert_eq!(new(4, &four), ConfigError::TooManyClouds { clouds: 4, capacity: 3 });
    assert_eq!(new(4, &[cloud(0)]), ConfigError::LocalPriority);
    assert_eq!(new(4, &[cloud(7), cloud(7)]), ConfigError::DuplicatePriority(Priority::new(7)));
    assert_eq!(new(4, &[Cloud::new(NEAR, 0)]), ConfigError::Gate(NEAR));
    let never_resumes = Cloud { priority: NEAR, limit: 2, resume: 2 };
    assert_eq!(new(4, &[never_resumes]), ConfigError::Gate(NEAR));
}

#[test]
fn order_of_the_configuration_means_nothing() {
    let clouds = [Cloud::new(NEAR, 3), Cloud::new(FAR, 3)];
    let mirrored = [clouds[1], clouds[0]];
    let new = |clouds| Small::new(4, Commit::Eager, clouds).unwrap();
    assert_eq!(new(&clouds), new(&mirrored));
    assert_eq!(new(&mirrored).source(NEAR), Source::new(1));
    assert_eq!(new(&mirrored).source(FAR), Source::new(2));
    assert_eq!(new(&mirrored).priority(Source::new(2).unwrap()), FAR);
    assert_eq!(new(&mirrored).source(Priority::new(6)), None);
}

#[test]
fn open_is_refused_for_the_first_reason() {
    let mut fusion = machine(1, Commit::Eager);
    let mut ready = ready(&mut fusion, 10);
    assert_eq!(ready.open(t(3), Some(ns(0))), Opening::Refused(OpenRefusal::Deadline));
    assert_eq!(ready.open(t(3), None), Opening::Accepted);
    assert_eq!(ready.open(t(3), Some(ns(0))), Opening::Refused(OpenRefusal::Order));
    assert_eq!(ready.open(t(2), None), Opening::Refused(OpenRefusal::Order));
    assert_eq!(ready.open(t(4), Some(ns(0))), Opening::Refused(OpenRefusal::Full));
}

#[test]
fn offer_is_refused_for_the_first_reason_and_moves_the_gate_only_if_none_holds() {
    let mut fusion = machine(4, Commit::Eager);
    let mut inputs = ready(&mut fusion, 10);
    let unknown = Admission::Refused(OfferRefusal::Unknown);
    assert_eq!(inputs.offer(t(0), NEAR, ns(1), 0), unknown);
    assert_eq!(inputs.open(t(1), None), Opening::Accepted);
    assert_eq!(inputs.open(t(2), None), Opening::Accepted);
    assert_eq!(inputs.offer(t(2), LOCAL, ns(1), 0), unknown);
    assert_eq!(inputs.offer(t(2), Priority::new(6), ns(1), 0), unknown);
    assert_eq!(inputs.offer(t(3), NEAR, ns(1), 0), unknown);
    assert_eq!(inputs.offer(t(0), NEAR, ns(0), 9), Admission::Refused(OfferRefusal::Closed));
    assert_eq!(inputs.offer(t(1), NEAR, ns(0), 9), Admission::Refused(OfferRefusal::Deadline));
    let due = Instant::from_nanos(11);
    assert_eq!(inputs.offer(t(1), NEAR, ns(1), 2), Admission::Admitted { due });
    assert_eq!(inputs.offer(t(1), NEAR, ns(0), 9), Admission::Refused(OfferRefusal::Duplicate));
    assert!(!fusion.gate(NEAR).unwrap().is_shut());
    // The gate shuts at its limit and opens at its resume, which is one less by default.
    let mut inputs = ready(&mut fusion, 10);
    assert_eq!(inputs.offer(t(2), NEAR, ns(1), 3), Admission::Refused(OfferRefusal::Queue));
    assert!(fusion.gate(NEAR).unwrap().is_shut());
    assert!(!fusion.gate(FAR).unwrap().is_shut());
    let mut inputs = ready(&mut fusion, 10);
    assert_eq!(inputs.offer(t(2), NEAR, ns(1), 2), Admission::Admitted { due });
}

#[test]
fn result_before_its_due_instant_is_in_time_and_at_it_late() {
    for commit in [Commit::Eager, Commit::Patient] {
        let mut fusion = machine(4, commit);
        let mut inputs = ready(&mut fusion, 0);
        assert_eq!(inputs.open(t(1), None), Opening::Accepted);
        let due = Instant::from_nanos(10);
        assert_eq!(inputs.offer(t(1), FAR, ns(10), 0), Admission::Admitted { due });
        let mut late = fusion.clone();

        let outcome = ready(&mut fusion, 9).result(t(1), FAR);
        assert!(matches!(outcome, Outcome::Forwarded { by: FAR, .. }));

        assert_eq!(fired(&mut late, 10).len(), 1);
        assert_eq!(ready(&mut late, 10).result(t(1), FAR), Outcome::Dropped(DropReason::Late));
    }
}

#[test]
fn clock_that_goes_back_counts_as_the_greatest_seen() {
    let mut fusion = machine(4, Commit::Eager);
    assert_eq!(ready(&mut fusion, 100).open(t(1), None), Opening::Accepted);
    let due = Instant::from_nanos(110);
    assert_eq!(ready(&mut fusion, 3).offer(t(1), FAR, ns(10), 0), Admission::Admitted { due });
    assert_eq!(fusion.now(), Instant::from_nanos(100));
}

#[test]
fn firings_come_by_due_instant_then_by_timestamp() {
    let mut fusion = machine(4, Commit::Eager);
    let mut inputs = ready(&mut fusion, 0);
    for (count, deadline, near) in [(1, 30, 20), (2, 10, 20), (3, 40, 20)] {
        assert_eq!(inputs.open(t(count), Some(ns(deadline))), Opening::Accepted);
        let due = Instant::from_nanos(near);
        assert_eq!(inputs.offer(t(count), NEAR, ns(near), 0), Admission::Admitted { due });
    }
    assert_eq!(fusion.next_due(), Some(Instant::from_nanos(10)));
    let order: Vec<_> = fired(&mut fusion, 1000)
        .iter()
        .map(|firing| (firing.due.as_nanos(), firing.timestamp.as_u64()))
        .collect();
    assert_eq!(order, [(10, 2), (20, 1), (20, 2), (20, 3), (30, 1), (40, 3)]);
    assert_eq!(fusion.next_due(), None);
    assert!(fusion.is_empty());
}

#[test]
fn clock_at_its_end_saturates_and_stays() {
    let mut fusion = machine(4, Commit::Eager);
    let mut inputs = ready(&mut fusion, u64::MAX - 1);
    assert_eq!(inputs.open(t(u64::MAX), None), Opening::Accepted);
    let due = Instant::END;
    let admitted = Admission::Admitted { due };
    assert_eq!(inputs.offer(t(u64::MAX), NEAR, ns(u64::MAX), 0), admitted);
    assert_eq!(inputs.offer(t(u64::MAX), FAR, ns(1), 0), admitted);
    let firings = fired(&mut fusion, u64::MAX);
    assert_eq!(firings.len(), 1);
    assert!(firings[0].timers.contains(NEAR) && firings[0].timers.contains(FAR));
    let mut inputs = ready(&mut fusion, 0);
    assert_eq!(inputs.open(t(u64::MAX), None), Opening::Refused(OpenRefusal::Order));
    assert_eq!(inputs.now(), Instant::END);
}

#[test]
fn retired_timestamp_is_superseded_and_one_beyond_all_unknown() {
    let mut fusion = machine(4, Commit::Eager);
    let mut inputs = ready(&mut fusion, 0);
    assert_eq!(inputs.open(t(5), None), Opening::Accepted);
    assert!(matches!(inputs.result(t(5), LOCAL), Outcome::Forwarded { by: LOCAL, .. }));
    for count in [0, 5] {
        let superseded = Outcome::Dropped(DropReason::Superseded);
        assert_eq!(inputs.result(t(count), FAR), superseded);
        assert_eq!(inputs.fail(t(count), LOCAL), superseded);
    }
    assert_eq!(inputs.result(t(6), FAR), Outcome::Dropped(DropReason::Unknown));
    assert_eq!(inputs.fail(t(5), Priority::new(6)), Outcome::Dropped(DropReason::Unknown));
}

/// Machines are equal even if they differ in the due instants of disarmed timers or in places in
/// memory.
#[test]
fn machines_that_answer_alike_are_equal_and_hash_alike() {
    let hash = |fusion: &Small| {
        let mut hasher = DefaultHasher::new();
        fusion.hash(&mut hasher);
        hasher.finish()
    };
    let run = |forwarded_first: u64| {
        let mut fusion = machine(4, Commit::Patient);
        let mut inputs = ready(&mut fusion, 0);
        for count in 1..=4 {
            assert_eq!(inputs.open(t(count), None), Opening::Accepted);
            assert!(matches!(
                inputs.offer(t(count), NEAR, ns(count), 0),
                Admission::Admitted { .. }
            ));
        }
        for count in [forwarded_first, 3 - forwarded_first] {
            assert!(matches!(inputs.result(t(count), NEAR), Outcome::Forwarded { .. }));
        }
        assert_eq!(inputs.open(t(6), None), Opening::Accepted);
        fusion
    };
    let (one, other) = (run(1), run(2));
    assert_eq!(one, other);
    assert_eq!(hash(&one), hash(&other));
    let mut different = other.clone();
    assert_eq!(
        ready(&mut different, 0).fail(t(6), NEAR),
        Outcome::Dropped(DropReason::Unsolicited)
    );
    assert_eq!(one, different);
    assert_eq!(ready(&mut different, 0).result(t(3), LOCAL), Outcome::Held);
    assert_ne!(one, different);
}

#[test]
fn machine_stays_small() {
    assert!(size_of::<Fusion<3, 16>>() <= 1700, "{} bytes", size_of::<Fusion<3, 16>>());
    assert!(size_of::<Fusion<15, 1024>>() <= 192 * 1024);
    assert_eq!(size_of::<Slot>(), 8);
}

#[test]
fn ready_fires_what_at_fires_and_leaves_the_same_machine() {
    let clouds = [Cloud::new(NEAR, 9), Cloud::new(FAR, 9)];
    for commit in [Commit::Eager, Commit::Patient] {
        let mut by_ready = Fusion::<2, 4>::new(4, commit, &clouds).unwrap();
        let mut ready = by_ready.ready(Instant::START, |_| {});
        for count in 0..4 {
            assert_eq!(ready.open(t(count), Some(ns(5 + count))), Opening::Accepted);
            for (cloud, deadline) in [(NEAR, 10 + count % 2), (FAR, 20 - count)] {
                let admission = ready.offer(t(count), cloud, ns(deadline), 0);
                assert!(matches!(admission, Admission::Admitted { .. }));
            }
        }
        // The instants are before the first due instant, at it, between two, and after all.
        for now in [4, 5, 10, 18, 99] {
            let (mut by_at, mut one_by_one) = (by_ready.clone(), std::vec::Vec::new());
            while let At::Fired(firing) = by_at.at(Instant::from_nanos(now)) {
                one_by_one.push(firing);
            }
            let mut at_once = std::vec::Vec::new();
            let ready = by_ready.ready(Instant::from_nanos(now), |firing| at_once.push(firing));
            assert_eq!(ready.now(), Instant::from_nanos(now));
            assert_eq!(at_once, one_by_one);
            assert!(by_ready == by_at);
        }
        assert!(by_ready.is_empty());
    }
}

#[test]
fn what_an_offer_would_be_answered_is_known_before_and_changes_nothing() {
    // Once shut, FAR's gate stays shut at 1 and 2 queued requests.
    let clouds = [Cloud { priority: FAR, limit: 3, resume: 0 }, Cloud::new(NEAR, 3)];
    for script in 0..4_096_u64 {
        let mut fusion = Small::new(2, Commit::Eager, &clouds).unwrap();
        let _ = ready(&mut fusion, 1).open(t(3), Some(ns(50)));
        for (step, bits) in (0..6).map(|step| (step, script >> (2 * step) & 3)) {
            let (cloud, deadline, backlog) = match bits {
                0 => (NEAR, ns(5), 0),
                1 => (FAR, ns(if step % 2 == 0 { 0 } else { 60 }), 5 - step),
                2 => (Priority::new(7), ns(5), 0),
                _ => {
                    let _ = ready(&mut fusion, 2).result(t(3), LOCAL);
                    let _ = ready(&mut fusion, 2).open(t(4 + step), None);
                    continue;
                }
            };
            for timestamp in [3, 4, 5, 90].map(t) {
                let before = fusion.clone();
                let foreseen = fusion.offer_refusal(timestamp, cloud, deadline, backlog);
                assert_eq!(fusion, before);
                let admission = ready(&mut fusion, 2).offer(timestamp, cloud, deadline, backlog);
                let refusal = match admission {
                    Admission::Refused(why) => Some(why),
                    Admission::Admitted { .. } => None,
                };
                assert_eq!(foreseen, refusal, "{script} {step} {timestamp:?}");
            }
        }
    }
}
