//! Tests the core's parts, for code that builds another machine of them or stores its values.

use fuseline_core::{
    Admission, Cloud, Clouds, Commit, Deadline, Entry, Firing, Fusion, Held, Instant, Opening,
    Outcome, Priority, Slot, Timestamp,
};

const NEAR: Priority = Priority::new(1);
const FAR: Priority = Priority::new(2);
const T: Timestamp = Timestamp::new(7);

/// Returns the machine's answer to a result of `source` while local and the far cloud are pending.
fn answered(commit: Commit, source: Priority) -> Outcome<2> {
    let clouds = [NEAR, FAR].map(|cloud| Cloud::new(cloud, 31));
    let mut fusion = Fusion::<2, 4>::new(4, commit, &clouds).expect("a sound configuration");
    let mut ready = fusion.ready(Instant::START, |firing: Firing<2>| panic!("{firing:?}"));
    assert_eq!(ready.open(T, None), Opening::Accepted);
    let admission = ready.offer(T, FAR, Deadline::from_nanos(9), 0);
    assert!(matches!(admission, Admission::Admitted { .. }), "{admission:?}");
    ready.result(T, source)
}

/// Returns the machine's answer that forwards the far cloud's result at once.
fn forwarded_by_far() -> Outcome<2> {
    let outcome = answered(Commit::Eager, FAR);
    assert!(matches!(outcome, Outcome::Forwarded { by: FAR, .. }), "{outcome:?}");
    outcome
}

/// A preliminary result is sent, and nothing is held (F9).
#[test]
fn a_preliminary_result_is_sent_and_nothing_is_held() {
    let outcome = answered(Commit::Progressive, Priority::LOCAL);
    assert!(matches!(outcome, Outcome::Preliminary { .. }), "{outcome:?}");
    let mut held: Held<&str, 4> = Held::new();
    assert_eq!(held.result(T, Priority::LOCAL, "local", &outcome), Some("local"));
    assert!(held.is_empty());
}

#[test]
fn held_value_is_forwarded_by_anothers_result() {
    let mut held: Held<&str, 4> = Held::new();
    assert!(held.is_empty());
    assert_eq!(held.result::<2>(T, FAR, "far", &Outcome::Held), None);
    assert!(!held.is_empty() && held.len() == 1);
    assert_eq!(held.result(T, NEAR, "near", &forwarded_by_far()), Some("far"));
    assert!(held.is_empty());
}

#[test]
fn of_two_values_of_one_source_the_first_is_kept() {
    let mut held: Held<&str, 4> = Held::default();
    for value in ["first", "second"] {
        assert_eq!(held.result::<2>(T, FAR, value, &Outcome::Held), None);
    }
    assert_eq!(held.failure(T, &forwarded_by_far()), Some("first"));
}

#[test]
fn an_entry_keeps_its_dues_when_its_sets_are_replaced() {
    let due = Instant::from_nanos(5);
    let deadline = Deadline::from_nanos(5);
    let mut entry = Entry::<2>::open(Instant::START, Some(deadline)).expect("it is not due");
    assert_eq!(entry.next_due(), Some(due));
    let closed =
        entry.slot().step(Commit::Eager, fuseline_core::Cause::Timers(entry.armed_at(due))).0;
    entry.set_slot(closed);
    assert_eq!((entry.slot(), entry.next_due()), (closed, None));
    assert_eq!(entry.due(fuseline_core::Source::LOCAL), due);
    assert_ne!(entry.slot(), Slot::open(true));
}

#[test]
fn parts_are_printed_by_what_they_have() {
    let clouds = Clouds::<2>::new(&[Cloud::new(FAR, 31)]).expect("a sound configuration");
    assert!(format!("{clouds:?}").contains("31"), "{clouds:?}");
    let entry = Entry::<2>::new(Slot::open(false));
    assert!(format!("{entry:?}").starts_with("Entry { slot: Slot"), "{entry:?}");
}

#[test]
fn an_entry_has_no_due_for_a_source_beyond_its_clouds() {
    let beyond = fuseline_core::Source::new(3).expect("it is below 16");
    let mut entry = Entry::<2>::new(Slot::open(false));
    entry.set_due(beyond, Instant::from_nanos(5));
    assert_eq!(entry.due(beyond), Instant::END);
}
